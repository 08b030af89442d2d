//! Eye rays, closest hits and shading points against their oracles. [`super::paths`] checks the steps between them, at
//! mirrors and glass.

use crate::accel::{Hit, offset_origin};
use crate::bsdf::ideal::Media;
use crate::conform::tally::within;
use crate::conform::{AWKWARD_IMAGES, Bench};
use crate::pass::eye_paths::{self, EyePath};
use crate::pass::surface::surface_at;
use crate::pass::{ShadingPoints, camera_rays};
use crate::scene::{Alpha, Scene, Surface, builtin};
use crate::settings::{Clip, Settings, Superposition, Traversal};
use glam::{Vec3, Vec4};

use crate::conform::rig::{
    Rig, STRAYS, Tally, close, gallery_with_alpha, gallery_with_tables, has, hit_of, is_lit, orthographic, ray_of,
    same_lobe, untouched, xyz,
};

/// Tolerance: a device's divisions, roots and powers are less exact than ours.
const RELATIVE: f32 = 1e-4;

/// The shading points of a bounce, read from the device, each component by its name in shaders/include/point.wgsl.
struct Found {
    position: Vec<Vec4>,
    geometric: Vec<Vec4>,
    shading: Vec<Vec4>,
    kd: Vec<Vec4>,
    f0: Vec<Vec4>,
    wo: Vec<Vec4>,
    emitted: Vec<Vec4>,
    throughput: Vec<Vec4>,
}

impl Found {
    fn of(rig: &Rig) -> Found {
        let r = &rig.frame().eye.points;
        Found {
            position: rig.vec4s(&r.position),
            geometric: rig.vec4s(&r.geometric),
            shading: rig.vec4s(&r.shading),
            kd: rig.vec4s(&r.kd),
            f0: rig.vec4s(&r.f0),
            wo: rig.vec4s(&r.wo),
            emitted: rig.vec4s(&r.emitted),
            throughput: rig.vec4s(&rig.frame().eye.paths.throughput),
        }
    }

    fn any_untouched(&self, i: usize) -> bool {
        let all = [&self.position, &self.geometric, &self.shading, &self.kd, &self.f0, &self.wo, &self.emitted];
        all.iter().any(|array| untouched(array[i]))
    }

    /// Compares the shading point of slot `i` with the oracle's surface at the end of its path, which had throughput
    /// `through`, depth `through.w` and cosine `cos_view`, and collected `emission`; `on_base`: it ends on the base of a plane within a mirror
    /// image. Returns whether it is lit.
    fn check(
        &self,
        tally: &mut Tally,
        i: usize,
        rig: &Rig,
        (d, hit): (Vec3, Option<Hit>),
        (path, cos_view, on_base): (&EyePath, f32, bool),
    ) -> bool {
        let (through, emission) = (path.throughput.extend(path.depth), path.emitted);
        let lit = is_lit(self.wo[i]);
        let [hit_something, glossy, covered, by_specular] =
            [ShadingPoints::HIT, ShadingPoints::GLOSSY, ShadingPoints::COVERED, ShadingPoints::SEEN_BY_SPECULAR]
                .map(|flag| has(self.wo[i], flag));
        let end = self.throughput[i];
        let emitted = self.emitted[i].truncate();
        tally.check(by_specular == (through.w > 0.0), || format!("way to {i}"));
        let segments = ShadingPoints::segments(ShadingPoints::flags(self.wo[i].w));
        tally.check(segments == path.segments, || format!("segments {i}: {segments}"));
        tally.check(has(self.wo[i], ShadingPoints::UNLIKELY) == path.unlikely, || format!("chance of {i}"));
        tally.check(has(self.wo[i], ShadingPoints::DEEP) == path.deep, || format!("steps to {i}"));
        tally.check(has(self.wo[i], ShadingPoints::CHOSE) == path.chose, || format!("choice of {i}"));
        let Some(hit) = hit else {
            tally.check(end.truncate() == through.truncate(), || format!("throughput {i}, nothing met"));
            let nothing = [self.kd[i], self.f0[i]].iter().all(|v| v.truncate() == Vec3::ZERO);
            tally.check(nothing && !hit_something && !lit, || format!("slot {i} sees nothing"));
            tally.check(emitted == emission, || format!("emission {i}: {emitted} for {emission}"));
            tally.check(end.w == through.w, || format!("depth {i}: {} for {}", end.w, through.w));
            tally.check(covered == (through.w > 0.0), || format!("coverage {i}"));
            return false;
        };
        let width = rig.parameters.cones[0] * rig.parameters.depth_scale(through.w + cos_view * hit.t);
        let s = surface_at(rig.scene, rig.bvh(), &hit, d, width);
        let r = &s.reflectance;
        // A path along a lobe shares the light that it meets with virtual lights.
        let [of_emission, of_light] = eye_paths::shares_at(&rig.parameters, path, (d, hit.t), &s);
        let carried = through.truncate() * of_light;
        tally.check(close(end.truncate(), carried, RELATIVE, 1e-9), || {
            format!("throughput {i}: {end} for {carried}, {path:?}, t {}", hit.t)
        });
        let sampled = has(self.wo[i], ShadingPoints::LOBE_SAMPLED);
        tally.check(sampled == path.sampled, || format!("lobe of {i}"));
        let place = offset_origin(s.position, s.geometric, rig.parameters.eye[3]);
        let near = |a: f32, b: f32| (a - b).abs() <= RELATIVE;
        // A plane that mirrors the room and is seen directly has no lobe, nor has one on whose base a path in a mirror image ends.
        let mirrors = on_base || through.w == 0.0 && i < rig.parameters.size[2] as usize && rig.plane(&hit) > 0;
        let reflects = r.kd != Vec3::ZERO || (r.f0 != Vec3::ZERO && !mirrors);
        let probability = if mirrors || sampled { 1.0 } else { r.diffuse_probability() };
        tally.check(close(self.position[i].truncate(), place, 1e-5, 1e-6), || {
            format!("position {i}: {}", self.position[i])
        });
        tally.check(self.position[i].w == hit.t, || format!("distance {i}"));
        let depth = through.w + cos_view * hit.t;
        tally.check(within(end.w - depth, 1e-6 * depth), || format!("depth {i}: {} for {depth}", end.w));
        tally.check(close(self.geometric[i].truncate(), s.geometric, 0.0, RELATIVE), || format!("normal {i}"));
        tally.check(close(self.shading[i].truncate(), s.shading, 0.0, RELATIVE), || {
            format!("shading normal {i}: {} for {}", self.shading[i], s.shading)
        });
        let kd = [self.kd[i].truncate(), self.f0[i].truncate()];
        tally.check(close(kd[0], r.kd, RELATIVE, 1e-5) && close(kd[1], r.f0, RELATIVE, 1e-5), || {
            format!("reflectance {i}: {kd:?} for {r:?}")
        });
        tally.check(near(self.geometric[i].w, r.f90), || format!("f90 {i}: {} for {}", self.geometric[i].w, r.f90));
        tally.check(same_lobe(self.shading[i].w, r.alpha, RELATIVE), || {
            format!("alpha {i}: {} for {}", self.shading[i].w, r.alpha)
        });
        tally.check(!reflects || near(self.kd[i].w, probability), || format!("probability {i}"));
        tally.check(glossy == (r.f90 > 0.0 && !mirrors), || format!("lobe {i}"));
        tally.check(close(self.wo[i].truncate(), -d, 0.0, 0.0), || format!("wo {i}"));
        tally.check(hit_something && covered, || format!("flags {i}"));
        let expected = emission + through.truncate() * of_emission * s.emission;
        tally.check(close(emitted, expected, RELATIVE, 0.0), || format!("emission {i}: {emitted} for {expected}"));
        tally.check(lit == (reflects && through.truncate() != Vec3::ZERO), || format!("lit {i}: {lit}"));
        lit
    }
}

/// Runs the eye's stages and compares all but the steps at mirrors and glass; returns the first hits.
fn look(rig: &Rig) -> Vec<Option<Hit>> {
    let (frame, [width, height, pixels, _]) = (rig.frame(), rig.parameters.size);
    let r = &frame.eye.points;
    rig.prefill(&[&frame.eye.rays.origin, &frame.eye.rays.direction, &frame.eye.rays.hits, &frame.eye.list.entries]);
    rig.prefill(&[&r.position, &r.geometric, &r.shading, &r.kd, &r.f0, &r.wo, &r.emitted, &frame.eye.paths.throughput]);
    rig.run(|frame, rec| frame.eye.record_first(rec));
    let what = format!("{width}x{height}");
    let origins = rig.vec4s(&frame.eye.rays.origin);
    let directions = rig.vec4s(&frame.eye.rays.direction);
    let hits = rig.vec4s(&frame.eye.rays.hits);
    let [through, emitted] = [&frame.eye.paths.throughput, &r.emitted].map(|b| rig.vec4s(b));
    let mut traced = Tally::new(format!("trace, {what}"));
    for i in 0..pixels as usize {
        let expected = camera_rays::reference(&rig.parameters, i as u32);
        let ray = ray_of(origins[i], directions[i]);
        // Parallel rays start at sums of products, which a device may round once or twice.
        assert!(close(ray.origin, expected.origin, 1e-6, 0.0), "{what}, pixel {i}: {ray:?} for {expected:?}");
        assert_eq!(ray.t_max, expected.t_max, "{what}, pixel {i}");
        assert!(close(ray.direction, expected.direction, 0.0, 1e-6), "{what}, pixel {i}: {ray:?} for {expected:?}");
        let cos_view = expected.direction.dot(xyz(rig.parameters.forward));
        assert!(within(directions[i].w - cos_view, 1e-6), "{what}, pixel {i}: {} for {cos_view}", directions[i].w);
        assert_eq!((through[i], emitted[i]), (Vec4::new(1.0, 1.0, 1.0, 0.0), Vec4::ZERO), "{what}, pixel {i}");
        let hit = hit_of(hits[i]);
        traced.check_hit(rig, &ray, hit, || format!("pixel {i}: {hit:?} of {ray:?}"));
    }
    traced.finish(STRAYS);

    rig.run(|frame, rec| (0..frame.eye.lists.len()).try_for_each(|step| frame.eye.record_step(rec, step)));
    let [through, met, directions] =
        [&frame.eye.paths.throughput, &r.emitted, &frame.eye.rays.direction].map(|b| rig.vec4s(b));
    let last_hits = rig.vec4s(&frame.eye.rays.hits);
    let lobes: Vec<f32> = rig.get(&frame.eye.paths.lobe_of);
    rig.run(|frame, rec| frame.eye.record_points(rec));
    assert_eq!(rig.lost(), 0);
    let found = Found::of(rig);
    let ideal = rig.ideal_pixels();
    let mut surfaces = Tally::new(format!("receivers, {what}"));
    let mut lit = Vec::new();
    for i in 0..through.len() {
        let pixel = i as u32 % pixels;
        if i as u32 >= pixels && ideal.binary_search(&pixel).is_err() {
            assert!(untouched(found.wo[i]), "{what}: {pixel} has no second component");
            continue;
        }
        assert!(!found.any_untouched(i), "{what}: slot {i} has a receiver");
        let is_dead = i >= pixels as usize && through[i].truncate() == Vec3::ZERO;
        let (ray, hit) = if is_dead { (Vec4::ZERO, None) } else { (directions[i], hit_of(last_hits[i])) };
        let flags = ShadingPoints::flags(met[i].w);
        let segments = ShadingPoints::segments(flags);
        let path = EyePath {
            slot: i as u32,
            ray: None,
            throughput: through[i].truncate(),
            depth: through[i].w,
            media: Media::default(),
            emitted: met[i].truncate(),
            lobe: if segments > 0 { lobes[i] } else { 0.0 },
            segments,
            sampled: flags & ShadingPoints::LOBE_SAMPLED != 0,
            narrow: flags & ShadingPoints::NARROW_LOBE != 0,
            unlikely: flags & ShadingPoints::UNLIKELY != 0,
            chose: flags & ShadingPoints::CHOSE != 0,
            deep: flags & ShadingPoints::DEEP != 0,
            free: ShadingPoints::free_component(flags),
        };
        let on_base = flags & ShadingPoints::LOBE_FOLLOWED != 0;
        if found.check(&mut surfaces, i, rig, (ray.truncate(), hit), (&path, ray.w, on_base)) {
            lit.push(i as u32);
        }
    }
    surfaces.finish(0.0);
    assert_eq!(rig.list(0), lit, "{what}: the list names the lit receivers, each once");
    assert_eq!(rig.work(0).list_groups[0], (lit.len() as u32).div_ceil(64));
    hits.into_iter().take(pixels as usize).map(hit_of).collect()
}

pub fn camera_rays_trace_and_receivers_follow_their_oracles(bench: &Bench) {
    let scene = gallery_with_tables();
    let from_afar = orthographic(scene.clone());
    let mut seen = vec![0; scene.materials.len()];
    let mut missed = 0;
    let views = |r| [(r, &scene, None), (r, &scene, Some(Superposition::default())), (r, &from_afar, None)];
    for (resolution, scene, superposition) in bench.images().flat_map(views) {
        // Points seen through mirrors and glass, and in the last image glass itself as well.
        let max_specular = if resolution == AWKWARD_IMAGES[4] { 1 } else { 8 };
        let settings = Settings { particles: 1, max_specular, superposition, ..Settings::plain() };
        let rig = bench.rig(scene, resolution, settings);
        for hit in look(&rig) {
            match hit {
                Some(hit) => seen[rig.bvh().material(hit.triangle) as usize] += 1,
                None => missed += 1,
            }
        }
    }
    for (material, count) in scene.materials.iter().zip(&seen) {
        bench.covered(*count > 0, format_args!("material {material:?} is not seen"));
    }
    bench.covered(missed > 0, format_args!("every ray hits"));
    assert!(scene.materials.iter().any(|m| m.surface == Surface::Mirror));
}

pub fn rays_through_surfaces_follow_their_oracles(bench: &Bench) {
    let scene = gallery_with_alpha();
    let mut seen = vec![0; scene.materials.len()];
    for (pass, resolution) in (0..).zip(bench.images()) {
        let settings = Settings { particles: 1, ..Settings::plain() };
        let rig = bench.rig_at_pass(&scene, resolution, settings, pass);
        let hits = look(&rig);
        hits.iter().flatten().for_each(|hit| seen[rig.bvh().material(hit.triangle) as usize] += 1);
    }
    for (material, count) in scene.materials.iter().zip(&seen).filter(|(material, _)| material.has_alpha()) {
        bench.covered(*count > 0, format_args!("material {material:?} is not seen"));
    }
}

/// The image of both sides of a sheet from close by.
pub fn emission_of_each_side(bench: &Bench) {
    for (two_sided, expected) in [(false, [1.0, 0.0]), (true, [1.0, 1.0])] {
        let mut scene = builtin::single_triangle_light();
        scene.materials[1].two_sided = two_sided;
        // The lamp looks down.
        for (side, expected) in expected.into_iter().enumerate() {
            let y = if side == 0 { 0.5 } else { 1.5 };
            let camera = scene.camera.as_mut().unwrap();
            (camera.eye, camera.target, camera.up) = (Vec3::new(0.25, y, 0.25), Vec3::new(0.25, 1.0, 0.25), Vec3::X);
            camera.fov_y = 5.0;
            let rig = bench.rig(&scene, [8, 8], Settings { particles: 1, ..Settings::plain() });
            look(&rig);
            let emitted = rig.vec4s(&rig.frame().eye.points.emitted);
            assert!(emitted.iter().all(|e| e.truncate() == Vec3::splat(expected)), "{two_sided} {side}");
        }
    }
}

/// A deep scene all of whose surfaces but its lamp let a fifth of the light pass.
fn veiled(layers: u32) -> Scene {
    let mut scene = builtin::deep_scene(layers);
    scene.materials.iter_mut().for_each(|m| m.alpha = Alpha::Blend { opacity: 0.8 });
    scene
}

/// Eye hits, and irradiance at the shading points, of a scene with the work cut into rounds.
fn in_rounds(bench: &Bench, scene: &Scene, traversal: Traversal, loop_budget: u32, rounds: u32) -> [Vec<[u32; 4]>; 3] {
    let settings = Settings {
        particles: 3,
        max_depth: 3,
        lights_per_dispatch: 1,
        clip: Clip::Fraction(0.0),
        loop_budget,
        rounds,
        traversal,
        ..Settings::plain()
    };
    let rig = bench.rig(scene, [27, 1], settings);
    rig.light();
    assert_eq!(rig.lost(), 0, "with {loop_budget} iterations and {rounds} rounds");
    let sums = &rig.frame().shade.lighting;
    // Sums of pixels without a shading point are not written.
    let points = rig.list(0);
    let at_points = |b| {
        let all: Vec<[u32; 4]> = rig.get(b);
        points.iter().map(|&slot| all[slot as usize]).collect()
    };
    [rig.get(&rig.frame().eye.rays.hits), at_points(&sums.direct), at_points(&sums.indirect)]
}

pub fn rays_carried_on_over_many_rounds_end_alike(bench: &Bench) {
    let plain = builtin::deep_scene(60);
    // A product of shares depends on their order, and clusters visit the tree in another one than single rays.
    let cases = [(&plain, Traversal::Single), (&plain, Traversal::Auto), (&veiled(60), Traversal::Single)];
    for (scene, traversal) in cases {
        let at_once = in_rounds(bench, scene, traversal, crate::plan::LOOP_BUDGET, 1);
        // Two steps a round.
        let in_many = in_rounds(bench, scene, traversal, crate::plan::min_loop_budget(1), 100);
        assert_eq!(crate::plan::trace_steps(18), 2);
        assert_eq!(crate::plan::shade_steps(1, 18), 2);
        let what = format!("one round and many, {traversal:?}");
        if traversal == Traversal::Single {
            assert!(at_once == in_many, "{what}: hits or sums depend on the rounds");
        } else {
            // Of the two kernels that share the rays each may round in its own way.
            let mut tally = Tally::new(what);
            for (one, many) in at_once.iter().flatten().zip(in_many.iter().flatten()) {
                let [a, b] = [one, many].map(|word| Vec4::from_array(word.map(f32::from_bits)));
                let same = close(a.truncate(), b.truncate(), 1e-5, 1e-7) && one[3] == many[3];
                tally.check(same, || format!("{a} {b}"));
            }
            tally.finish(STRAYS);
        }
        assert!(
            at_once[1].iter().any(|e| f32::from_bits(e[0]) > 0.0)
                && at_once[2].iter().any(|e| f32::from_bits(e[0]) > 0.0)
        );
    }
}
