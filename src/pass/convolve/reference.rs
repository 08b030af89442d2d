//! The oracle, written after the thesis's program.

use glam::{DVec2, DVec3, Vec4};

use super::{DEPTH_TOLERANCE, KERNEL_TEXELS, MAX_STEPS};

/// Inputs of the oracle.
#[derive(Clone, Copy)]
pub struct Image<'a> {
    /// Width and height.
    pub size: [u32; 2],
    /// Radiance; w: depth.
    pub source: &'a [Vec4],
    /// Kernel diameter in pixels, layer, vector of the u axis.
    pub footprint: &'a [Vec4],
    /// Region of each pixel.
    pub region: &'a [u32],
    /// Textures, one after the other.
    pub kernels: &'a [f32],
    /// Steps by which each texture is narrower along v; four steps halve it.
    pub narrowings: &'a [u32],
    /// Sources behind a pixel spread over it no farther than the pixel's own kernel.
    pub occlusion: bool,
}

/// A kernel scaled to maximum texel 1: the texture sampled bilinearly at `at`, in radii.
pub fn kernel(texture: &[f32], at: DVec2) -> f64 {
    let edge = KERNEL_TEXELS as i32;
    let centre = |i: i32| (f64::from(i) + 0.5) * 2.0 / f64::from(edge) - 1.0;
    let texel = |x: i32, y: i32| {
        let outside = x.min(y) < 0 || x.max(y) >= edge || DVec2::new(centre(x), centre(y)).length_squared() > 1.0;
        if outside { 0.0 } else { f64::from(texture[(y * edge + x) as usize].max(0.0)) }
    };
    let place = (at + 1.0) * (0.5 * f64::from(edge)) - 0.5;
    let (low, part) = (place.floor(), place - place.floor());
    let (x, y) = (low.x as i32, low.y as i32);
    let row = |y: i32| texel(x, y) * (1.0 - part.x) + texel(x + 1, y) * part.x;
    row(y) * (1.0 - part.y) + row(y + 1) * part.y
}

/// The kernel of one pixel on the grid.
struct Splat<'a> {
    texture: &'a [f32],
    axis: DVec2,
    radius: f64,
    /// Ratio of the radius along u to that along v.
    ratio: f64,
    /// Sum over the unbounded grid; 0: the kernel is a delta.
    sum: f64,
}

impl<'a> Splat<'a> {
    fn new(footprint: Vec4, kernels: &'a [f32], narrowings: &[u32]) -> Splat<'a> {
        let texels = (KERNEL_TEXELS * KERNEL_TEXELS) as usize;
        let layers = kernels.len() / texels;
        let layer = (footprint.y.max(0.0).round() as usize).min(layers - 1);
        let texture = &kernels[layer * texels..(layer + 1) * texels];
        let axis = DVec2::new(f64::from(footprint.z), f64::from(footprint.w));
        let own = (4.0 * axis.length().clamp(1.0, 16.0).log2()).round() as u32;
        let axis = axis.try_normalize().unwrap_or(DVec2::X);
        let ratio = (0.25 * f64::from((narrowings[layer] + own).min(MAX_STEPS))).exp2();
        let mut splat = Splat { texture, axis, radius: 0.5 * f64::from(footprint.x), ratio, sum: 0.0 };
        if footprint.x > 1.0 {
            let reach = splat.reach();
            let peak = texture.iter().fold(0.0f32, |a, &b| a.max(b));
            let sum: f64 =
                (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y))).map(|(x, y)| splat.at(x, y)).sum();
            splat.sum = if sum > 1e-3 * f64::from(peak) { sum } else { 0.0 };
        }
        splat
    }

    /// Maximum reach in pixels.
    fn reach(&self) -> i32 {
        (1.1 * self.radius) as i32
    }

    fn at(&self, x: i32, y: i32) -> f64 {
        let offset = DVec2::new(x.into(), y.into());
        kernel(self.texture, DVec2::new(self.axis.dot(offset), self.ratio * self.axis.perp_dot(offset)) / self.radius)
    }
}

/// Program 7.17: scatters the radiance of every pixel, then divides each pixel by the weights that reached it.
pub fn reference(image: &Image) -> Vec<Vec4> {
    let [width, height] = image.size.map(|n| n as i32);
    let mut sums = vec![(DVec3::ZERO, 0.0f64); image.source.len()];
    for q in 0..sums.len() {
        if image.region[q] == 0 {
            continue;
        }
        let splat = Splat::new(image.footprint[q], image.kernels, image.narrowings);
        let light = image.source[q].truncate().as_dvec3();
        let (qx, qy) = (q as i32 % width, q as i32 / width);
        if splat.sum == 0.0 {
            sums[q].0 += light;
            sums[q].1 += 1.0;
            continue;
        }
        let reach = splat.reach();
        for y in (qy - reach).max(0)..=(qy + reach).min(height - 1) {
            for x in (qx - reach).max(0)..=(qx + reach).min(width - 1) {
                let p = (y * width + x) as usize;
                if image.region[p] != image.region[q] {
                    continue;
                }
                let mut weight = splat.at(x - qx, y - qy) / splat.sum;
                if image.occlusion {
                    weight *= unhidden(image, p, q, DVec2::new((x - qx).into(), (y - qy).into()).length());
                }
                sums[p].0 += light * weight;
                sums[p].1 += weight;
            }
        }
    }
    let finish = |p: usize| match (image.region[p], sums[p]) {
        (0, _) => Vec4::ZERO,
        (_, (sum, weight)) if weight > 0.0 => (sum / weight).as_vec3().extend(weight as f32),
        _ => image.source[p].truncate().extend(0.0),
    };
    (0..sums.len()).map(finish).collect()
}

/// Fraction of the light from q to p that p's own kernel leaves if q lies behind p.
fn unhidden(image: &Image, p: usize, q: usize, apart: f64) -> f64 {
    let own = image.source[p].w;
    if image.source[q].w <= own + own.abs() * DEPTH_TOLERANCE {
        return 1.0;
    }
    let diameter = image.footprint[p].x;
    let radius = if diameter > 1.0 { 0.5 * f64::from(diameter) } else { 0.5 };
    (radius.max(0.5) + 0.5 - apart).clamp(0.0, 1.0)
}
