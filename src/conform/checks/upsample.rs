//! Light that pixels take from lit points nearby, against its oracle.

use crate::conform::Bench;
use crate::pass::edges::FirstHit;
use crate::pass::layout::FrameParameters;
use crate::pass::upsample::{self, LitPoint, Pixel};
use crate::pass::upsample_paths::{self, PathPoint};
use crate::pass::{Lighting, ShadingPoints, camera_rays};
use crate::settings::Settings;
use crate::stage::{Eye, Stage};
use glam::{Vec3, Vec4};

use crate::conform::rig::{Rig, STRAYS, Tally, close, gallery, has, hit_of, is_lit, orthographic};

/// The first hit of an eye ray, from its guide.
fn shown(rig: &Rig, frame: &FrameParameters, pixel: u32, guide: [u32; 2]) -> Option<FirstHit> {
    let ray = camera_rays::reference(frame, pixel);
    let hit = hit_of(Vec4::new(f32::from_bits(guide[1]), 0.0, 0.0, f32::from_bits(guide[0])))?;
    let start = ray.origin - Vec4::from(frame.eye).truncate();
    Some(FirstHit::new(rig.scene, rig.bvh(), &hit, [start, ray.direction]))
}

/// The lit points, row by row.
fn lit_points(rig: &Rig) -> Vec<LitPoint> {
    let (eye, lighting) = (&rig.frame().eye, &rig.frame().shade.lighting);
    let frame = rig.parameters.at_rate(Settings::MAX_SHADING_RATE);
    let guides: Vec<[u32; 2]> = rig.get(&eye.guides.as_ref().unwrap().first_hits);
    let [position, kd, wo, emitted] =
        [&eye.points.position, &eye.points.kd, &eye.points.wo, &eye.points.emitted].map(|b| rig.vec4s(b));
    let throughput = rig.vec4s(&eye.paths.throughput);
    let sums = [&lighting.direct, &lighting.indirect, &lighting.specular].map(|b| rig.vec4s(b));
    let point = |i: usize| LitPoint {
        shown: shown(rig, &frame, i as u32, guides[i]),
        is_first: position[i].w == f32::from_bits(guides[i][1]),
        point: [emitted[i], throughput[i], kd[i]].map(Vec4::truncate),
        sums: [0, 1, 2].map(|k| if is_lit(wo[i]) { sums[k][i].truncate() } else { Vec3::ZERO }),
    };
    (0..frame.size[2] as usize).map(point).collect()
}

pub fn upsampling_follows_its_oracle(bench: &Bench) {
    let (gallery, from_afar) = (gallery(), orthographic(gallery()));
    let (mut between, mut nearest, mut emitting, mut bare, mut through) = (0, 0, 0, 0, 0);
    for ((i, size), scene) in bench.images().enumerate().flat_map(|image| [(image, &gallery), (image, &from_afar)]) {
        // Paths through mirrors and glass in half of the images.
        let (antialias, split) = (i % 2 == 0, i % 4 < 2);
        let settings =
            Settings { particles: 3, shading_rate: 2, antialias, split, glossy_paths: false, ..Settings::plain() };
        let rig = bench.rig_at_pass(scene, size, settings, i as u32);
        rig.light();
        let lit = lit_points(&rig);
        let stage = rig.frame().upsample.as_ref().unwrap();
        rig.run(|_, rec| stage.eye.record_first(rec));
        let ray_hits = rig.vec4s(&stage.eye.rays.hits);
        rig.run(|_, rec| stage.eye.record(rec));
        let (points, guides) = (&stage.eye.points, stage.eye.guides.as_ref().unwrap());
        let hits: Vec<[u32; 2]> = rig.get(&guides.first_hits);
        let [kd, wo, before] = [&points.kd, &points.wo, &points.emitted].map(|b| rig.vec4s(b));
        let lighting = &stage.lighting;
        rig.prefill(&[&lighting.direct, &lighting.indirect, &lighting.specular]);
        rig.run(|_, rec| stage.first_hits.record(rec));
        let [after, direct, indirect, specular] =
            [&points.emitted, &lighting.direct, &lighting.indirect, &lighting.specular].map(|b| rig.vec4s(b));
        assert_eq!(rig.lost(), 0);

        let frame = &rig.parameters;
        let (width, lit_size) = (size[0], size.map(|n| n.div_ceil(Settings::MAX_SHADING_RATE)));
        let mut tally = Tally::new(format!("upsampling, {size:?}"));
        for i in 0..(size[0] * size[1]) as usize {
            let ray = camera_rays::reference(frame, i as u32);
            let hit = hit_of(ray_hits[i]);
            tally.check_hit(&rig, &ray, hit, || format!("pixel {i}: {ray:?}"));
            tally.check(specular[i].truncate() == Vec3::ZERO, || format!("pixel {i}: highlight {}", specular[i]));
            let found = [direct[i], indirect[i], after[i] - before[i]].map(Vec4::truncate);
            let Some(first) = shown(&rig, frame, i as u32, hits[i]) else {
                bare += 1;
                tally.check(found[2] == Vec3::ZERO, || format!("pixel {i} shows nothing: {}", found[2]));
                continue;
            };
            let pixel = Pixel {
                at: [i as u32 % width, i as u32 / width],
                shown: first,
                diffuse: has(wo[i], ShadingPoints::LIT) && kd[i].truncate().element_sum() > 0.0,
                emits: before[i].truncate().element_sum() > 0.0,
            };
            let around = |x: u32, y: u32| lit[(x + y * lit_size[0]) as usize];
            let (expected, of_four) = upsample::reference(frame, &pixel, lit_size, around);
            between += u32::from(of_four);
            nearest += u32::from(!of_four);
            emitting += u32::from(pixel.emits);
            if has(wo[i], ShadingPoints::SEEN_BY_SPECULAR) {
                through += 1;
                tally.check(found[2] == Vec3::ZERO, || format!("pixel {i} is lit by its path: {}", found[2]));
                continue;
            }
            let scale = before[i].truncate().length();
            let same = [0, 1, 2].iter().all(|&k| close(found[k], expected[k], 1e-3, 1e-5 * (1.0 + scale)));
            let pairs = [0, 1, 2].map(|k| (found[k], expected[k]));
            tally.check_values(same, &pairs, || format!("pixel {i}: {found:?} for {expected:?}"));
        }
        tally.finish(STRAYS);
    }
    bench.covered(
        between > 1000 && nearest > 100 && emitting > 10 && bare > 10 && through > 10,
        format_args!("{between} between lit points, {nearest} of the nearest, {emitting} emit, {bare} show nothing, {through} mirrors and glass"),
    );
}

/// The points of all components of an eye with their light.
fn path_points(rig: &Rig, (eye, [width, height]): (&Eye, [u32; 2]), lighting: &Lighting) -> Vec<PathPoint> {
    let [position, normal, wo] = [&eye.points.position, &eye.points.geometric, &eye.points.wo].map(|b| rig.vec4s(b));
    let sums = [&lighting.direct, &lighting.indirect, &lighting.specular].map(|b| rig.vec4s(b));
    let marks: Vec<u32> = rig.get(eye.ideal_marks());
    let pixels = (width * height) as usize;
    let tile_of = |i: usize| i % width as usize / 8 + i / width as usize / 8 * width.div_ceil(8) as usize;
    let point = |i: usize| PathPoint {
        position: position[i].truncate(),
        normal: normal[i].truncate(),
        // Further components are written in marked tiles.
        lit: is_lit(wo[i]) && (i < pixels || marks[tile_of(i % pixels)] != 0),
        by_specular: has(wo[i], ShadingPoints::SEEN_BY_SPECULAR),
        sums: [0, 1, 2].map(|k| sums[k][i].truncate()),
    };
    (0..position.len()).map(point).collect()
}

pub fn paths_of_pixels_follow_their_oracle(bench: &Bench) {
    let (gallery, from_afar) = (gallery(), orthographic(gallery()));
    let (mut compared, mut nearest, mut components) = (0, 0, [0; 3]);
    for ((i, size), scene) in bench.images().enumerate().flat_map(|image| [(image, &gallery), (image, &from_afar)]) {
        let settings = Settings { particles: 3, shading_rate: 2, glossy_paths: false, ..Settings::plain() };
        let rig = bench.rig_at_pass(scene, size, settings, i as u32);
        rig.light();
        let (lit_eye, stage) = (&rig.frame().eye, rig.frame().upsample.as_ref().unwrap());
        let lit_size = size.map(|n| n.div_ceil(Settings::MAX_SHADING_RATE));
        let lit = path_points(&rig, (lit_eye, lit_size), &rig.frame().shade.lighting);
        rig.run(|_, rec| stage.eye.record(rec));
        let lighting = &stage.lighting;
        rig.prefill(&[&lighting.direct, &lighting.indirect, &lighting.specular]);
        rig.run(|_, rec| stage.through.as_ref().unwrap().paths.record(rec));
        let after = path_points(&rig, (&stage.eye, size), lighting);
        let depths = rig.vec4s(&stage.eye.paths.throughput);

        let (frame, pixels) = (&rig.parameters, size[0] * size[1]);
        let mut tally = Tally::new(format!("paths of pixels, {size:?}"));
        for (slot, own) in after.iter().enumerate() {
            let (component, pixel) = (slot as u32 / pixels, slot as u32 % pixels);
            if !own.lit || component == 0 && !own.by_specular {
                continue;
            }
            let at = [pixel % size[0], pixel / size[0]];
            let first = component * lit_size[0] * lit_size[1];
            let around = |x: u32, y: u32| lit[(first + x + y * lit_size[0]) as usize];
            let of_first = |x: u32, y: u32| lit[(x + y * lit_size[0]) as usize];
            let own_point = (at, own, depths[slot].w);
            let (expected, of_four) = upsample_paths::reference(frame, own_point, lit_size, [&around, &of_first]);
            let same = [0, 1, 2].iter().all(|&k| close(own.sums[k], expected[k], 1e-3, 1e-5));
            let pairs = [0, 1, 2].map(|k| (own.sums[k], expected[k]));
            tally.check_values(same, &pairs, || format!("component {component} of {pixel}: {own:?} for {expected:?}"));
            compared += u32::from(of_four);
            nearest += u32::from(!of_four);
            components[component as usize] += 1;
        }
        tally.finish(STRAYS);
    }
    bench.covered(
        compared > 100 && nearest > 20 && components.iter().all(|&n| n > 20),
        format_args!("{compared} between lit points, {nearest} of the nearest, {components:?} of the components"),
    );
}
