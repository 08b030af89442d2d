//! Averages the radiance of specular lobes over the neighbours of a pixel that reflect alike, as `discontinuity` averages irradiance.
//!
//! Neighbours reflect alike on one smooth surface ([`SLOPE`]), of the same finish ([`TINT`], alphas within a quarter), and with
//! mirrored directions that differ by no more than alpha, so that the mean blurs what the surface reflects by no more than the lobe
//! does. All pixels of a class follow lobes by the same random numbers, so a window that holds every class averages directions
//! spread over the lobe. Weights are those of the window of `discontinuity`, in its first form, which preserves the sum of radiance
//! over a surface.
//!
//! Bias: detail of reflections finer than the lobe is blurred over the window, less and less ([`Filter::weight`]).
//!
//! Cost: w h times 6 vec4 and 60 operations for each pixel that shows a lobe, 2 vec4 for others.

use glam::{IVec2, Vec3};

use super::layout::{self, Window};
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, Kit, Lighting, List, ShadingPoints};
use crate::bsdf::phong::width_of;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::settings::Filter;

/// Maximum slope of the chord between two points whose lobes are averaged, beyond the turn of the normal.
///
/// Higher: highlights bleed between facets. Lower: tessellated surfaces are not smoothed.
pub const SLOPE: f32 = 0.1;

/// Maximum difference of their reflectances at normal incidence.
///
/// Higher: textures of the reflectance blur. Lower: textured surfaces are not smoothed.
pub const TINT: f32 = 0.05;

/// The pass.
pub struct DiscontinuityLobes {
    /// The lighting with filtered specular radiance; the other quantities are those of the input.
    pub filtered: Lighting,
    kernel: BoundKernel,
    windows: Vec<Window>,
    tiles: Buffer,
    tile_count: u32,
}

impl DiscontinuityLobes {
    /// Prepares the filter of `lighting` for an image of `size`, interleaved in `pattern`; `components` of a pixel, the second ones in
    /// `ideal_tiles`.
    pub fn new(
        kit: &Kit,
        (points, lighting, ideal_tiles): (&ShadingPoints, &Lighting, &List),
        components: u32,
        size: [u32; 2],
        (filter, pattern): (Filter, [u32; 2]),
    ) -> Result<Self> {
        let [width, height] = size;
        let specular = kit.vec4s("discontinuity specular", width * height * components)?;
        let own = Resources::of([("filtered_specular", &specular)]);
        let sets = [&own, &points.resources(), &lighting.resources(), &ideal_tiles.as_tiles()];
        Ok(DiscontinuityLobes {
            kernel: kit.bind(&shaders::DISCONTINUITY_LOBES, &sets)?,
            filtered: Lighting { specular, ..lighting.clone() },
            windows: Window::of_components(&filter, pattern, components),
            tiles: ideal_tiles.work.clone(),
            tile_count: width.div_ceil(8) * height.div_ceil(8),
        })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        for window in &self.windows {
            let push = bytemuck::bytes_of(window);
            match window.component {
                0 => self.kernel.run(rec, push, self.tile_count.into())?,
                _ => self.kernel.run_listed(rec, push, &self.tiles, LIST_GROUPS)?,
            }
        }
        Ok(())
    }
}

/// A pixel with a lobe, for the oracle.
#[derive(Clone, Copy, Debug)]
pub struct Gloss {
    /// Point.
    pub position: Vec3,
    /// Geometric normal.
    pub geometric: Vec3,
    /// Shading normal.
    pub shading: Vec3,
    /// Direction to the eye.
    pub wo: Vec3,
    /// Specular reflectance at normal incidence.
    pub f0: Vec3,
    /// Roughness of the lobe.
    pub alpha: f32,
}

impl Gloss {
    /// Oracle: whether two pixels reflect alike.
    pub fn is_like(&self, other: &Gloss) -> bool {
        let mirrored = |g: &Gloss| 2.0 * g.shading.dot(g.wo) * g.shading - g.wo;
        let chord = other.position - self.position;
        let rise = chord.dot(self.geometric + other.geometric);
        let turn = (2.0 - 2.0 * self.geometric.dot(other.geometric)).max(0.0);
        let [own, others] = [self.alpha, other.alpha].map(width_of);
        let (narrow, wide) = (own.min(others), own.max(others));
        rise * rise <= chord.length_squared() * (turn + SLOPE * SLOPE)
            && wide <= 1.25 * narrow
            && (mirrored(self) - mirrored(other)).length() <= narrow
            && (self.f0 - other.f0).abs().max_element() <= TINT
    }
}

/// Oracle: the filtered specular radiance of all pixels; `None`: the pixel has no lobe, or is not lit.
pub fn reference(
    frame: &layout::FrameParameters,
    window: &Window,
    lobes: &[Option<Gloss>],
    radiance: &[Vec3],
) -> Vec<Vec3> {
    let [width, height, ..] = frame.size.map(|n| n as i32);
    let [reach_x, reach_y] = window.reach;
    let filtered = |i: usize| {
        let Some(own) = &lobes[i] else { return radiance[i] };
        let here = IVec2::new(i as i32 % width, i as i32 / width);
        let offsets = (-reach_y..=reach_y).flat_map(|y| (-reach_x..=reach_x).map(move |x| IVec2::new(x, y)));
        let gain = offsets.filter_map(|offset| {
            let there = here + offset;
            let inside = (0..width).contains(&there.x) && (0..height).contains(&there.y);
            let j = inside.then_some((there.y * width + there.x) as usize)?;
            let other = lobes[j].as_ref().filter(|other| own.is_like(other));
            other.map(|_| window.share(offset) * (radiance[j] - radiance[i]))
        });
        radiance[i] + frame.lens[2] * window.middle * gain.sum::<Vec3>()
    };
    (0..lobes.len()).map(filtered).collect()
}
