//! The sides of triangles that light reaches, found by a few passes at probes: points on both sides of each triangle.
//!
//! Models come as sheets without thickness and in mixed orientations, so that neither the front nor what rays meet first tells the
//! side that is seen. Light does: what it does not reach is black anyway.

use std::sync::Arc;

use glam::Vec3;

use super::{BLOCK, Stop};
use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::scene::{Material, Scene, Surface};
use crate::settings::{Compensation, Settings};
use crate::standalone::Renderer;
use crate::view::{Atlas, Texel};

/// Passes of the probes.
const PASSES: u32 = 4;
/// Most probes of a side.
const MAX_PROBES: usize = 16;
/// Probes of all sides that large triangles share.
const SPREAD: f64 = 200_000.0;
/// Entries of a view.
const BATCH: usize = 1 << 18;
/// A side is lit if one of its probes has this part of the mean irradiance.
const LEAST: f32 = 1e-3;

/// Lit sides of a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sides {
    /// The front.
    pub front: bool,
    /// The back.
    pub back: bool,
}

impl Sides {
    /// Number of lit sides.
    pub fn count(self) -> u32 {
        u32::from(self.front) + u32::from(self.back)
    }

    /// Whether a side is lit.
    pub fn has(self, back: bool) -> bool {
        if back { self.back } else { self.front }
    }
}

/// Whether a material reflects diffusely somewhere.
pub fn is_diffuse(m: &Material) -> bool {
    m.surface != Surface::Glass
        && m.base_color != Vec3::ZERO
        && (m.metallic < 1.0 || m.metallic_roughness_texture.is_some())
}

/// Most particles of a pass over the probes.
const PARTICLES: u32 = 32;

/// The lit sides of each triangle, unless `stop` breaks it off. Deterministic. Errors: [`Error::Interrupted`]; those of a renderer.
pub fn lit(context: &Context, scene: &Scene, settings: &Settings, stop: Stop) -> Result<Vec<Sides>> {
    let diffuse: Vec<bool> = scene.materials.iter().map(is_diffuse).collect();
    let area: f64 = (0..scene.triangles.len()).map(|i| f64::from(scene.triangle_area(i))).sum();
    let mut probes = Vec::new();
    for (i, triangle) in (0u32..).zip(&scene.triangles) {
        if !diffuse[triangle.material as usize] {
            continue;
        }
        let share = f64::from(scene.triangle_area(i as usize)) / area * SPREAD;
        let count = (share as usize).clamp(1, MAX_PROBES);
        for back in [false, true] {
            probes.extend((0..count).map(|k| Some(Texel { triangle: i, uv: point(k, count), back })));
        }
    }
    // A few lights each tell more or less light, but always whether there is any.
    let settings = Settings {
        compensation: Compensation::Off,
        pattern: [1, 1],
        light_pool: 0,
        particles: settings.particles.min(PARTICLES),
        direct_lights: Some(Settings::MAX_PARTICLES),
        photons: settings.photons.min(20_000),
        ..super::settings(settings.clone())
    };
    let mut found = Vec::with_capacity(probes.len());
    let mut last: Option<Renderer> = None;
    for batch in probes.chunks(BATCH) {
        let mut texels = batch.to_vec();
        let width = (texels.len() as u32).min(512).next_multiple_of(BLOCK);
        let height = (texels.len() as u32).div_ceil(width);
        texels.resize((width * height) as usize, None);
        let atlas = Arc::new(Atlas::new([width, height], texels));
        let mut renderer = match last.take() {
            Some(mut renderer) => renderer.set_atlas(atlas).map(|()| renderer)?,
            None => Renderer::with_atlas(context.clone(), scene.clone(), atlas, settings.clone())?,
        };
        for _ in 0..PASSES {
            if !renderer.pass_unless(stop)? {
                return Err(Error::Interrupted);
            }
        }
        let layers = renderer.layers()?;
        let light = layers.direct.iter().zip(&layers.indirect).map(|(a, b)| (*a + *b).element_sum());
        found.extend(light.take(batch.len()));
        last = Some(renderer);
    }
    let mean = found.iter().sum::<f32>() / found.len().max(1) as f32;
    let mut sides = vec![Sides::default(); scene.triangles.len()];
    for (probe, light) in probes.iter().flatten().zip(found) {
        if light > LEAST * mean {
            let of = &mut sides[probe.triangle as usize];
            *(if probe.back { &mut of.back } else { &mut of.front }) = true;
        }
    }
    Ok(sides)
}

/// Point k of n in a triangle: the centroid if it is alone, else spread by Hammersley's points.
fn point(k: usize, n: usize) -> [f32; 2] {
    if n == 1 {
        return [1.0 / 3.0; 2];
    }
    let [u, v] = crate::sampling::hammersley::hammersley(k as u32, n as u32);
    let root = u.sqrt();
    // Kept off the edges, where rounding decides what a ray meets.
    let inwards = |w: f32| 0.98 * w + 0.02 / 3.0;
    [inwards(root * (1.0 - v)), inwards(root * v)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probes_lie_in_the_triangle() {
        for n in 1..=MAX_PROBES {
            for k in 0..n {
                let [u, v] = point(k, n);
                assert!(u > 0.0 && v > 0.0 && u + v < 1.0, "{k} of {n}: {u} {v}");
            }
        }
    }

    #[test]
    fn glass_and_metals_have_no_diffuse_side() {
        let of = |surface, base_color, metallic| {
            is_diffuse(&Material { surface, base_color, metallic, ..Material::default() })
        };
        assert!(of(Surface::Opaque, Vec3::X, 0.5) && of(Surface::Mirror, Vec3::X, 0.0));
        assert!(!of(Surface::Glass, Vec3::ONE, 0.0) && !of(Surface::Opaque, Vec3::ZERO, 0.0));
        assert!(!of(Surface::Opaque, Vec3::ONE, 1.0));
    }
}
