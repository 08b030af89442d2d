//! Antialiased lamps in mirrors and glass against their oracle.

use crate::accel::Hit;
use crate::conform::Bench;
use crate::pass::lamp_edges::{self, LampRay, MAX_BOUNCES, Turn};
use crate::pass::layout::FrameParameters;
use crate::pass::surface::surface_at;
use crate::pass::{ShadingPoints, accumulate, camera_rays, edges};
use crate::settings::Settings;
use crate::stage::Stage;
use glam::{Vec3, Vec4};
use std::sync::Arc;

use crate::conform::gallery::surroundings;
use crate::conform::rig::{Builder, Rig, STRAYS, Tally, close, gallery, has, is_lit, orthographic};
use crate::scene::{Material, Scene, Surface};

/// The arrays that the pass reads, before it runs.
struct Before {
    emitted: Vec<Vec4>,
    wo: Vec<Vec4>,
    radiance: Vec<Vec3>,
    second_hits: Vec<[u32; 2]>,
}

impl Before {
    fn of(rig: &Rig) -> Before {
        let points = &rig.frame().eye.points;
        let guides = rig.frame().eye.guides.as_ref().unwrap();
        let second_hits = rig.get(guides.second_hits.as_ref().unwrap());
        let [emitted, wo, kd] = [&points.emitted, &points.wo, &points.kd].map(|b| rig.vec4s(b));
        let throughput = rig.vec4s(&rig.frame().eye.paths.throughput);
        let lighting = &rig.frame().shade.lighting;
        let sums = [&lighting.direct, &lighting.indirect, &lighting.specular].map(|b| rig.vec4s(b));
        let radiance = (0..emitted.len()).map(|i| {
            let light = if is_lit(wo[i]) { sums.each_ref().map(|s| s[i].truncate()) } else { [Vec3::ZERO; 3] };
            let [emitted, throughput, kd] = [emitted[i], throughput[i], kd[i]].map(Vec4::truncate);
            accumulate::reference(emitted, throughput, kd, light)
        });
        Before { radiance: radiance.collect(), emitted, wo, second_hits }
    }

    fn shows_lamps(&self, slot: usize) -> bool {
        let word = self.wo[slot];
        let segments = (ShadingPoints::flags(word.w) / ShadingPoints::ONE_SEGMENT) & 15;
        has(word, ShadingPoints::SEEN_BY_SPECULAR) && !has(word, ShadingPoints::LOBE_SAMPLED) && segments == 0
    }

    /// Whether the oracle sees an edge at a component of a pixel of the listed ones.
    fn is_edge(&self, frame: &FrameParameters, pixel: u32, component: u32) -> bool {
        let [width, height, pixels, _] = frame.size;
        let slot = |pixel: u32| (pixel + component * pixels) as usize;
        let alone = component == 0 && self.second_hits[pixel as usize][0] != edges::NO_MIRROR;
        if !self.shows_lamps(slot(pixel)) || alone {
            return false;
        }
        let shown = self.radiance[pixel as usize] + self.radiance[(pixel + pixels) as usize];
        let (x, y) = (pixel % width, pixel / width);
        let others = [
            (x > 0).then(|| (x - 1, y)),
            (x + 1 < width).then(|| (x + 1, y)),
            (y > 0).then(|| (x, y - 1)),
            (y + 1 < height).then(|| (x, y + 1)),
        ];
        others.into_iter().flatten().any(|(u, v)| {
            let other = u + v * width;
            let one_tile = (u / 8, v / 8) == (x / 8, y / 8);
            let written = one_tile || has(self.wo[other as usize], ShadingPoints::SEEN_BY_SPECULAR);
            let [own, theirs] = [pixel, other].map(|pixel| self.emitted[slot(pixel)].truncate());
            written && self.shows_lamps(slot(other)) && lamp_edges::differ(own, shown, theirs)
        })
    }
}

/// Emission along an eye ray that seeks a slot; `None`: no result.
fn followed(rig: &Rig, start: LampRay, slots: u32) -> Option<Vec3> {
    let (frame, scene, bvh) = (&rig.parameters, rig.scene, rig.bvh());
    let mut path = start;
    for bounce in 0..=MAX_BOUNCES {
        let hit: Option<Hit> = bvh.closest(&path.ray);
        let d = path.ray.direction;
        let surface = hit.as_ref().map(|hit| {
            let depth = path.depth + path.cos_view * hit.t;
            let surface = surface_at(scene, bvh, hit, d, frame.cones[0] * frame.depth_scale(depth));
            let smooth = scene.triangles[bvh.scene_triangle(hit.triangle) as usize].smooth;
            (surface, hit.t, smooth)
        });
        let met = surface.as_ref().map(|(surface, t, smooth)| (surface, *t, *smooth));
        match path.turned((frame, scene), slots, met, bounce == MAX_BOUNCES) {
            Turn::On(next) => path = next,
            Turn::Ended(light) => return light,
        }
    }
    None
}

/// A room, open at the camera, whose walls are full of lamps, with two balls of glass in each other, a ball of chrome, a flat mirror, one over a
/// base, and a pane.
fn lamps() -> Scene {
    let mut b = Builder::default();
    let grey = b.material(Material::default());
    let lamp = b.material(Material { emission: Vec3::new(9.0, 7.0, 5.0), ..Material::default() });
    let mirror = |base: f32| Material {
        surface: Surface::Mirror,
        base_color: Vec3::splat(base),
        specular: Vec3::splat(0.6),
        ..Material::default()
    };
    let glass = |ior: f32, thin: bool| Material { surface: Surface::Glass, ior, thin, ..Material::default() };
    let [plain, coated] = [mirror(0.0), mirror(0.3)].map(|material| b.material(material));
    let [crystal, water, pane] = [glass(1.5, false), glass(1.33, false), glass(1.5, true)].map(|m| b.material(m));
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    // Corner, sides.
    let walls = [
        (Vec3::new(-2.0, 0.0, 2.0), 4.0 * x, -4.0 * z),
        (Vec3::new(-2.0, 3.0, -2.0), 4.0 * x, 4.0 * z),
        (Vec3::new(-2.0, 0.0, -2.0), 4.0 * x, 3.0 * y),
        (Vec3::new(-2.0, 0.0, 2.0), -4.0 * z, 3.0 * y),
        (Vec3::new(2.0, 0.0, -2.0), 4.0 * z, 3.0 * y),
    ];
    for (corner, u, v) in walls {
        b.quad(corner, u, v, grey, 1.0);
        let off = 0.02 * u.cross(v).normalize();
        for place in 0..20 {
            let (i, j) = (place % 5, place / 5);
            b.quad(
                corner + off + (i as f32 + 0.4) / 5.0 * u + (j as f32 + 0.4) / 4.0 * v,
                0.05 * u,
                0.06 * v,
                lamp,
                1.0,
            );
        }
    }
    b.sphere(Vec3::new(-0.5, 1.4, 0.3), 0.8, 3, crystal, false);
    b.sphere(Vec3::new(-0.4, 1.3, 0.4), 0.3, 2, water, false);
    b.sphere(Vec3::new(1.0, 0.6, 0.7), 0.5, 3, plain, false);
    b.quad(Vec3::new(0.4, 1.2, -1.7), 1.4 * x, 1.4 * y, plain, 1.0);
    b.quad(Vec3::new(-1.8, 0.1, 1.4), 1.4 * x, -1.4 * z, coated, 1.0);
    b.quad(Vec3::new(0.6, 1.3, 0.5), 0.9 * x, 0.9 * y, pane, 1.0);
    b.finish(Vec3::new(0.1, 1.5, 2.9), Vec3::new(0.1, 1.3, 0.0))
}

pub fn lamps_follow_their_oracle(bench: &Bench) {
    let outdoors = Scene { environment: Some(Arc::new(surroundings())), ..lamps() };
    let scenes = [lamps(), orthographic(outdoors), gallery()];
    let (mut marked, mut ended, mut bright, mut compared) = (0, 0, 0, 0);
    for ((i, size), scene) in
        bench.images().enumerate().flat_map(|image| scenes.iter().map(move |scene| (image, scene)))
    {
        let settings =
            Settings { particles: 3, antialias: true, split: true, glossy_paths: false, ..Settings::plain() };
        let rig = bench.rig_at_pass(scene, size, settings, 7 * i as u32);
        rig.light();
        rig.run(|frame, rec| frame.third_light.run(rec));
        let before = Before::of(&rig);
        rig.run(|frame, rec| frame.lamp_edges.run(rec));
        let pass = &rig.frame().lamp_edges.as_ref().unwrap().pass;
        assert_eq!(rig.lost(), 0);
        let words: Vec<u32> = rig.get(&pass.marks);
        let (light, after) = (rig.vec4s(&pass.light), rig.vec4s(&rig.frame().eye.points.emitted));
        let frame = &rig.parameters;
        let slots = rig.engine.plan().eye.slots_of_pixel;
        let listed = rig.ideal_pixels();
        let [width, height] = size;
        let pixels = width * height;
        let mut tally = Tally::new(format!("lamp edges, {size:?}"));
        for tile in 0..width.div_ceil(8) * height.div_ceil(8) {
            let (x, y) = (tile % width.div_ceil(8) * 8, tile / width.div_ceil(8) * 8);
            let (w, h) = ((width - x).min(8), (height - y).min(8));
            let pixel_of = |i: u32| x + i % w + (y + i / w) * width;
            let in_tile: Vec<u32> =
                (0..w * h).map(pixel_of).filter(|pixel| listed.binary_search(pixel).is_ok()).collect();
            let bits_of = |&pixel: &u32| words[pixel as usize] & 3;
            let sought = |bits: u32| lamp_edges::sought([bits & 1 != 0, bits & 2 != 0], slots);
            let all: u32 = in_tile.iter().map(bits_of).map(|bits| sought(bits).count() as u32).sum();
            let each = lamp_edges::rays_of(all, w * h, slots);
            let mut first = 0;
            for &pixel in &in_tile {
                let bits = bits_of(&pixel);
                for component in 0..2 {
                    let edge = before.is_edge(frame, pixel, component);
                    let what = || format!("component {component} of pixel {pixel}: edge {edge}");
                    tally.check((bits >> component & 1 == 1) == edge, what);
                }
                let mut changes = [Vec3::ZERO; 2];
                if bits != 0 {
                    marked += 1;
                    assert_eq!(words[pixel as usize], 64 * first + 4 * each + bits, "pixel {pixel}");
                }
                for slot in sought(bits).filter(|_| each > 0) {
                    let found = |k: u32| {
                        let (r, part) = ((first + k) % (w * h), (first + k) / (w * h));
                        let l = light[(pixel_of(r) + part * pixels) as usize];
                        (l.w > 0.0).then_some(l.truncate())
                    };
                    for k in 0..each {
                        let mut moved = *frame;
                        if k > 0 {
                            moved.pixel_offset[..2]
                                .copy_from_slice(&edges::ray_offset(frame, k - 1, each - 1).to_array());
                        }
                        let start = LampRay::new(frame, camera_rays::reference(&moved, pixel), slot);
                        let expected = followed(&rig, start, slots);
                        let same = match (found(k), expected) {
                            (Some(a), Some(b)) => close(a, b, 5e-3, 1e-4),
                            (a, b) => a.is_none() && b.is_none(),
                        };
                        ended += u32::from(expected.is_some());
                        bright += u32::from(expected.is_some_and(|l| l.element_sum() > 0.0));
                        tally.check(same, || {
                            format!("ray {k} of {pixel} to slot {slot}: {:?} for {expected:?}", found(k))
                        });
                    }
                    let others: Vec<Option<Vec3>> = (1..each).map(found).collect();
                    changes[slot.min(1) as usize] += lamp_edges::change(frame, found(0), &others);
                    first += each;
                }
                for (component, change) in changes.into_iter().enumerate() {
                    let slot = pixel as usize + component * pixels as usize;
                    let (e, found) = (before.emitted[slot].truncate() + change, after[slot].truncate());
                    tally.check(close(found, e, 1e-4, 1e-5), || format!("slot {slot}: {found} for {e}"));
                    compared += u32::from(change.length() > 1e-3);
                }
            }
        }
        tally.finish(STRAYS);
    }
    bench.covered(
        marked > 200 && ended > 1000 && bright > 300 && compared > 100,
        format_args!("{marked} at edges, {ended} rays end, {bright} at lamps, {compared} change"),
    );
}
