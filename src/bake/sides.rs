//! The sides of triangles that light reaches, found by a few passes at probes: points on both sides of each triangle.
//!
//! Models come as sheets without thickness and in mixed orientations, so that neither the front nor what rays meet first tells the
//! side that is seen. Light does: what it does not reach is black anyway. The few lights of these passes miss sides that only light of many
//! reflections reaches, such as those that face a dim corridor. So a dark side that sees lit ones is lit too, and so on; but not inside a body that
//! stands on a floor, which is lit as a whole: see `space`.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::Stop;
use super::blocks::BLOCK;
use super::lightmap::{self, Seen};
use super::space::Space;
use crate::accel::Bvh;
use crate::error::{Error, Result};
use crate::film::HostFilm;
use crate::gpu::Context;
use crate::scene::{Material, Scene, Surface};
use crate::settings::{Compensation, Settings};
use crate::standalone::Renderer;
use crate::view::{Atlas, Texel};

/// Ranges of passes: each for the probes of sides that are dark after those before.
const ROUNDS: [std::ops::Range<u32>; 2] = [0..1, 1..4];
/// Triangles whose fronts come together and then their backs: rays of neighbours are alike.
const GROUP: usize = 64;
/// Most probes of a side.
const MAX_PROBES: usize = 16;
/// Probes of all sides that large triangles share.
const SPREAD: f64 = 200_000.0;
/// Entries of a view.
const BATCH: usize = 1 << 18;
/// A side is lit if one of its probes has this part of the mean irradiance of all in the first pass.
const LEAST: f32 = 1e-3;
/// Rays by which a probe on a dark side looks for lit ones.
const RAYS: u32 = 16;
/// Of these, the rays that must end on lit sides. More: sides that see light through a crack alone stay dark.
const SEEN: usize = 2;

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

    fn light(&mut self, back: bool) {
        *(if back { &mut self.back } else { &mut self.front }) = true;
    }
}

/// Whether a material reflects diffusely somewhere.
pub fn is_diffuse(m: &Material) -> bool {
    m.surface != Surface::Glass
        && m.base_color != Vec3::ZERO
        && (m.metallic < 1.0 || m.metallic_roughness_texture.is_some())
}

/// Most particles of a pass over the probes.
const PARTICLES: u32 = 8;

/// The lit sides of each triangle, unless `stop` breaks it off. Deterministic. Errors: [`Error::Interrupted`]; those of a renderer.
pub fn lit(context: &Context, scene: &Scene, settings: &Settings, stop: Stop) -> Result<Vec<Sides>> {
    let diffuse: Vec<bool> = scene.materials.iter().map(is_diffuse).collect();
    let area: f64 = (0..scene.triangles.len()).map(|i| f64::from(scene.triangle_area(i))).sum();
    let numbers: Vec<u32> = (0..scene.triangles.len() as u32).collect();
    let share = |i: u32| f64::from(scene.triangle_area(i as usize)) / area * SPREAD;
    let mut probes = Vec::new();
    for group in numbers.chunks(GROUP) {
        for (&i, back) in [false, true].iter().flat_map(|back| group.iter().map(move |i| (i, *back))) {
            if diffuse[scene.triangles[i as usize].material as usize] {
                let count = (share(i) as usize).clamp(1, MAX_PROBES);
                probes.extend((0..count).map(|k| Texel { triangle: i, uv: point(k, count), back }));
            }
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
    let mut renderer = None;
    let mut light = |probes: &[Texel], passes: std::ops::Range<u32>| -> Result<Vec<f32>> {
        let mut found = Vec::with_capacity(probes.len());
        for batch in probes.chunks(BATCH) {
            let atlas = Arc::new(atlas(batch));
            let mut of = match renderer.take() {
                Some(renderer) => renderer,
                None => Renderer::with_atlas(context.clone(), scene.clone(), atlas.clone(), settings.clone())?,
            };
            of.set_atlas(atlas.clone())?;
            // Passes after those before, and none of their sums.
            let empty = vec![0; HostFilm::byte_count(atlas.size, false)];
            of.load_film(passes.start, &HostFilm::from_bytes(&empty, atlas.size, false)?)?;
            for _ in passes.clone() {
                if !of.pass_unless(stop)? {
                    return Err(Error::Interrupted);
                }
            }
            let layers = of.layers()?;
            let light = layers.direct.iter().zip(&layers.indirect).map(|(a, b)| (*a + *b).element_sum());
            found.extend(light.take(batch.len()));
            renderer = Some(of);
        }
        Ok(found)
    };
    let mut sides = vec![Sides::default(); scene.triangles.len()];
    let (mut least, mut reached) = (None, Vec::new());
    for passes in ROUNDS {
        let found = light(&probes, passes)?;
        let least = *least.get_or_insert_with(|| LEAST * found.iter().sum::<f32>() / found.len().max(1) as f32);
        for (probe, _) in probes.iter().zip(found).filter(|(_, light)| *light > least) {
            sides[probe.triangle as usize].light(probe.back);
            reached.push(*probe);
        }
        probes.retain(|probe| !sides[probe.triangle as usize].has(probe.back));
    }
    spread(scene, (&probes, &reached), |i| share(i) >= 2.0, &mut sides, stop)?;
    Ok(sides)
}

/// Lights dark sides whose probes see enough lit ones, until there are no more. A large side is lit as a whole and seen in part: it counts
/// for probes in the space that light reaches. Errors: [`Error::Interrupted`].
fn spread(
    scene: &Scene,
    (probes, reached): (&[Texel], &[Texel]),
    is_large: impl Fn(u32) -> bool + Sync,
    sides: &mut [Sides],
    stop: Stop,
) -> Result<()> {
    let bvh = Bvh::build(scene)?;
    let leaves = bvh.leaf_numbers();
    let origin = |probe: &Texel| lightmap::origin(&bvh, &leaves, probe).0;
    let points: Vec<Vec3> = reached.par_iter().map(origin).collect();
    let space = Space::new(&bvh, scene, &points);
    let mut dark = Vec::with_capacity(probes.len());
    for chunk in probes.chunks(4096) {
        if stop() {
            return Err(Error::Interrupted);
        }
        let seen = |probe: &Texel| {
            let mut all: Vec<Seen> = lightmap::seen(&bvh, &leaves, probe, RAYS).flatten().collect();
            let open = || {
                let beside = lightmap::beside(&bvh, &leaves, probe, RAYS);
                let points = std::iter::once(origin(probe)).chain(beside).chain(all.iter().map(|seen| seen.middle));
                // More than a crack, as for sides.
                points.filter(|point| space.reaches(*point)).take(SEEN).count() == SEEN
            };
            if all.iter().any(|seen| is_large(seen.triangle)) && !open() {
                all.retain(|seen| !is_large(seen.triangle));
            }
            all.into_iter().map(|Seen { triangle, back, .. }| (triangle, back)).collect::<Vec<_>>()
        };
        dark.par_extend(chunk.par_iter().map(|probe| (*probe, seen(probe))));
    }
    loop {
        let before = dark.len();
        let mut found = Vec::new();
        dark.retain(|(probe, seen)| {
            let lit = seen.iter().filter(|(triangle, back)| sides[*triangle as usize].has(*back)).count() >= SEEN;
            if lit {
                found.push((probe.triangle, probe.back));
            }
            !lit
        });
        for (triangle, back) in found {
            sides[triangle as usize].light(back);
        }
        if dark.len() == before {
            return Ok(());
        }
    }
}

/// The view of a batch of probes.
fn atlas(batch: &[Texel]) -> Atlas {
    let mut texels: Vec<Option<Texel>> = batch.iter().copied().map(Some).collect();
    let width = (texels.len() as u32).min(512).next_multiple_of(BLOCK);
    let height = (texels.len() as u32).div_ceil(width);
    texels.resize((width * height) as usize, None);
    Atlas::new([width, height], texels)
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
