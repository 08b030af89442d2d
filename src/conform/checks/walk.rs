//! The walk of the particles against its oracles, path by path.

use crate::accel::Ray;
use crate::bsdf::ideal::Media;
use crate::conform::{Bench, Must};
use crate::light::emitters::Kind;
use crate::pass::layout::PointLight;
use crate::pass::surface::surface_at;
use crate::pass::walk_follow::{self, Fate};
use crate::pass::{walk_reflect, walk_start};
use crate::ring::{Form, Ring};
use crate::scene::Scene;
use crate::settings::{Reflectance, Sequence, Settings};
use crate::stage::Stage;
use glam::{Vec3, Vec4};

use crate::conform::rig::{
    Rig, SINE, STRAYS, Tally, close, gallery_outdoors, gallery_with_alpha, gallery_with_tables, hit_of, ray_of,
    same_lobe, sine_error, untouched, xyz,
};

/// Tolerance, relative to the largest component: divisions and roots are less exact on a device than ours.
const RELATIVE: f32 = 2e-4;

pub fn settings(particles: u32, jitter: bool) -> Settings {
    interleaved(particles, [1, 1], jitter)
}

pub fn interleaved(particles: u32, pattern: [u32; 2], jitter: bool) -> Settings {
    let reflectance = if jitter { Reflectance::Fresnel } else { Reflectance::Schlick };
    Settings { particles, pattern, jitter, reflectance, seed: 7, ..Settings::plain() }
}

/// Whether two lights have the same emission, from positions within `place`. For lights without power, the rest is
/// ignored.
pub fn same_light(a: &PointLight, b: &PointLight, place: f32) -> bool {
    let v = |f: fn(&PointLight) -> [f32; 4], relative, absolute| close(xyz(f(a)), xyz(f(b)), relative, absolute);
    let w = |f: fn(&PointLight) -> [f32; 4]| (f(a)[3] - f(b)[3]).abs() <= 1e-5;
    let dark = |l: &PointLight| xyz(l.emit) == Vec3::ZERO && xyz(l.flux) == Vec3::ZERO;
    if dark(a) || dark(b) {
        return dark(a) && dark(b);
    }
    let tolerance = RELATIVE * b.wi[3].abs();
    // Of a light on an emitter it is a density instead, of any size.
    let same_width = match a.flags() & PointLight::GLOSSY {
        0 => (a.wi[3] - b.wi[3]).abs() <= tolerance,
        _ => same_lobe(a.wi[3], b.wi[3], tolerance),
    };
    a.flags() == b.flags()
        && v(|l| l.position, 1e-5, place)
        && v(|l| l.normal, 0.0, SINE)
        && v(|l| l.emit, RELATIVE, 0.0)
        && v(|l| l.wi, 0.0, SINE)
        && v(|l| l.flux, RELATIVE, 0.0)
        && v(|l| l.f0, RELATIVE, 1e-6)
        && w(|l| l.normal)
        && w(|l| l.emit)
        && same_width
        && w(|l| l.flux)
        && w(|l| l.f0)
}

/// Whether rays start at the same point in the same direction, or both do not start.
fn same_ray([origin, direction, flux]: [Vec4; 3], oracle: &Ray, oracle_flux: glam::Vec3, place: f32) -> bool {
    let ray = ray_of(origin, direction);
    if oracle.t_max == 0.0 || ray.t_max == 0.0 {
        return oracle.t_max == ray.t_max && flux.truncate() == Vec3::ZERO && oracle_flux == Vec3::ZERO;
    }
    ray.t_max == oracle.t_max
        && close(ray.origin, oracle.origin, 1e-5, place)
        && close(ray.direction, oracle.direction, 0.0, 2.0 * SINE)
        && close(flux.truncate(), oracle_flux, 2.0 * SINE, 0.0)
}

/// Values of two lights for [`Tally::check_values`].
pub fn of_lights(found: &PointLight, expected: &PointLight) -> [(Vec3, Vec3); 4] {
    let of = |l: &PointLight| [l.position, l.normal, l.emit, l.flux].map(xyz);
    let (found, expected) = (of(found), of(expected));
    std::array::from_fn(|k| (found[k], expected[k]))
}

/// Values of two rays for [`Tally::check_values`], after those of lights.
fn of_rays([origin, direction, flux]: [Vec4; 3], expected: &Ray, expected_flux: Vec3) -> [(Vec3, Vec3); 7] {
    let mut values = <[(Vec3, Vec3); 7]>::default();
    // Rays that do not start may hold any place.
    if origin.w > 0.0 {
        values[4] = (origin.truncate(), expected.origin);
        values[5] = (direction.truncate(), expected.direction);
    }
    values[6] = (flux.truncate(), expected_flux);
    values
}

/// One walk, each stage from the device's results of the previous stage; returns the kinds of emitters that started
/// particles and the numbers of lights with and without a specular lobe.
fn follow(bench: &Bench, scene: &Scene, settings: Settings) -> (Vec<Kind>, [usize; 2]) {
    let what = format!(
        "{:?}, {} particles of {:?}, jitter {}",
        settings.sequence, settings.particles, settings.pattern, settings.jitter
    );
    let classes = settings.classes();
    let rig = bench.rig(scene, [1, 1], settings);
    let (frame, p) = (rig.frame(), &rig.parameters);
    let plan = &rig.engine.plan().lights;
    let delta: Vec<PointLight> = rig.engine.device_scene().delta.to_vec();
    let particles = &frame.walk.particles;
    rig.prefill(&[&particles.origin, &particles.direction, &particles.hits, &frame.walk.flux]);
    rig.run(|frame, rec| frame.walk.record_start(rec));

    let mut lights: Vec<PointLight> = rig.get(&frame.walk.lights);
    for of_class in lights.chunks(plan.slots() as usize) {
        assert_eq!(of_class[..delta.len()], delta, "{what}: delta lights stay as they are");
    }
    assert_eq!(lights.len() as u32, classes * plan.slots());
    let slot = |n: usize, j: usize| walk_start::light_slot(p, n as u32, plan.first_slot(j)) as usize;
    let mut origins = rig.vec4s(&particles.origin);
    let mut directions = rig.vec4s(&particles.direction);
    let mut fluxes = rig.vec4s(&frame.walk.flux);
    let mut tally = Tally::new(format!("walk_start, {what}"));
    let mut kinds = Vec::new();
    let direct = plan.survivors[0] * classes;
    for i in 0..rig.engine.plan().settings.particles() {
        let (light, ray, flux) = walk_start::reference(p, (rig.engine.emitters(), &rig.scene.textures), i);
        let n = i as usize;
        let emitters = rig.engine.emitters();
        // Points on discs and spheres are placed by sine and cosine.
        let [of_light, of_start] =
            [walk_start::first_light_numbers(p, i), walk_start::walk_numbers(p, 0, i)].map(|u| {
                let emitter = &emitters.list[emitters.choose(u[0]).0 as usize];
                let place = match emitter.kind {
                    Kind::Directional | Kind::Sphere => SINE * emitter.e1.length(),
                    Kind::Environment => 4.0 * SINE * emitter.e2.y,
                    _ => 1e-5,
                };
                (emitter.kind, place)
            });
        let place = of_light.1;
        kinds.push(of_light.0);
        if i < direct {
            let found = &lights[slot(n, 0)];
            tally.check_values(same_light(found, &light, place), &of_lights(found, &light), || {
                format!("particle {i}: {found:?}\nfor {light:?}")
            });
        }
        let same = same_ray([origins[n], directions[n], fluxes[n]], &ray, flux, of_start.1);
        let values = of_rays([origins[n], directions[n], fluxes[n]], &ray, flux);
        tally.check_values(same, &values, || {
            format!("particle {i}: {} {} {}\nfor {ray:?} {flux}", origins[n], directions[n], fluxes[n])
        });
    }
    tally.finish(STRAYS);

    let mut lobes = [0, 0];
    let mut followed = 0;
    let mut media = vec![Media::default(); fluxes.len()];
    for j in 1..plan.survivors.len() {
        let alive = (plan.survivors[j] * classes) as usize;
        rig.prefill(&[&particles.hits]);
        rig.run(|frame, rec| frame.walk.record_rays(rec, j));
        let state =
            || [&particles.hits, &particles.origin, &particles.direction, &frame.walk.flux].map(|b| rig.vec4s(b));
        let mut traced = Tally::new(format!("trace for reflection {j}, {what}"));
        let mut check_trace = |[hits, origins, directions, _]: &[Vec<Vec4>; 4], who: &[usize]| {
            for &n in who {
                let (hit, ray) = (hit_of(hits[n]), ray_of(origins[n], directions[n]));
                traced.check_hit(&rig, &ray, hit, || format!("particle {n}: {hit:?} of {ray:?}"));
            }
        };
        let mut before = state();
        assert_eq!((&before[1], &before[2]), (&origins, &directions), "{what}: tracing leaves rays alone");
        assert!(
            before[0][alive..].iter().all(|&h| untouched(h)),
            "reflection {j}, {what}: dead particles are not traced"
        );
        let mut who: Vec<usize> = (0..alive).collect();
        check_trace(&before, &who);
        // Mirrors and glass.
        let mut tally = Tally::new(format!("walk_follow {j}, {what}"));
        for step in 0..frame.walk.follow_steps(j) {
            rig.run(|frame, rec| frame.walk.record_follow(rec, j, step));
            let after = state();
            let mut flying = Vec::new();
            for &n in &who {
                let [hits, _, directions, fluxes] = &before;
                let (flux, specular) = (fluxes[n].truncate(), fluxes[n].w as u32);
                let d = directions[n].truncate();
                let surface = hit_of(hits[n]).filter(|_| flux != Vec3::ZERO);
                let surface = surface.map(|hit| surface_at(scene, rig.bvh(), &hit, d, p.cones[1] * hit.t));
                let fate = surface.map_or(Fate::Unchanged, |s| {
                    walk_follow::reference(p, scene, (j as u32, specular), n as u32, (d, flux, media[n]), &s)
                });
                let ray = [1, 2, 3].map(|k| after[k][n]);
                let holds = match fate {
                    Fate::Unchanged => {
                        // Bits, since those of no triangle are no number.
                        let bits = |of: &[Vec<Vec4>; 4]| [0, 1, 2, 3].map(|k| of[k][n].to_array().map(f32::to_bits));
                        bits(&before) == bits(&after)
                    }
                    Fate::Stays(flux) => close(ray[2].truncate(), flux, RELATIVE, 1e-7),
                    Fate::Flies(expected, flux, inside) => {
                        media[n] = inside;
                        flying.push(n);
                        specular + 1 == ray[2].w as u32 && same_ray(ray, &expected, flux, 1e-5)
                    }
                };
                tally.check(holds, || format!("particle {n}: {ray:?} for {fate:?}"));
                followed += usize::from(fate != Fate::Unchanged);
            }
            check_trace(&after, &flying);
            (before, who) = (after, flying);
        }
        tally.finish(STRAYS);
        traced.finish(STRAYS);
        let hits;
        [hits, origins, directions, fluxes] = before;

        rig.run(|frame, rec| frame.walk.record_reflect(rec, j));
        lights = rig.get(&frame.walk.lights);
        let after = [&particles.origin, &particles.direction, &frame.walk.flux].map(|b| rig.vec4s(b));
        let mut tally = Tally::new(format!("walk_reflect {j}, {what}"));
        for n in 0..alive {
            let (hit, ray) = (hit_of(hits[n]), ray_of(origins[n], directions[n]));
            let surface = hit.map(|hit| surface_at(scene, rig.bvh(), &hit, ray.direction, p.cones[1] * hit.t));
            let flux = fluxes[n].truncate();
            let (light, next, next_flux) = walk_reflect::reference(
                p,
                &scene.materials,
                j,
                (n as u32, fluxes[n].w as u32),
                ray.direction,
                flux,
                surface.as_ref(),
            );
            let found = &lights[slot(n, j)];
            tally.check_values(same_light(found, &light, 1e-5), &of_lights(found, &light), || {
                format!("particle {n}: {found:?}\nfor {light:?}")
            });
            let same = same_ray([0, 1, 2].map(|k| after[k][n]), &next, next_flux, 1e-5);
            let values = of_rays([0, 1, 2].map(|k| after[k][n]), &next, next_flux);
            tally.check_values(same, &values, || {
                format!("particle {n}: {} {} {}\nfor {next:?} {next_flux}", after[0][n], after[1][n], after[2][n])
            });
            if flux != Vec3::ZERO && hit.is_some() {
                lobes[usize::from(light.flags() & PointLight::GLOSSY != 0)] += 1;
            }
        }
        tally.finish(STRAYS);
        [origins, directions, fluxes] = after;
    }
    assert_eq!(rig.lost(), 0);
    bench.covered(followed > 0 || fluxes.len() < 1000, format_args!("{what}: no particle met a mirror or glass"));
    (kinds, lobes)
}

pub fn walk_start_and_walk_reflect_follow_their_oracles(bench: &Bench) {
    let scene = gallery_with_tables();
    for paths in bench.sizes() {
        for (jitter, sequence) in
            [(false, Sequence::Halton), (true, Sequence::Halton), (false, Sequence::Sobol), (true, Sequence::Sobol)]
        {
            let settings = Settings { sequence, ..settings(paths as u32, jitter) };
            let (kinds, lobes) = follow(bench, &scene, settings);
            if paths < 1000 {
                continue;
            }
            let all = [Kind::Triangle, Kind::Quad, Kind::Sphere, Kind::Point, Kind::Spot, Kind::Directional];
            for kind in all.into_iter().chain([Kind::Imported]) {
                bench.covered(kinds.contains(&kind), format_args!("no particle starts at a {kind:?}"));
            }
            bench.covered(lobes[0] > 100 && lobes[1] > 100, format_args!("diffuse and glossy reflections: {lobes:?}"));
        }
    }
}

pub fn the_walk_of_each_class_follows_its_oracles(bench: &Bench) {
    let scene = gallery_with_alpha();
    follow(bench, &scene, settings(2049, false));
    let scene = gallery_with_tables();
    for (paths, pattern) in [(1, [8, 8]), (27, [3, 3]), (64, [2, 1]), (683, [1, 3])] {
        follow(bench, &scene, interleaved(paths, pattern, paths == 27));
        let direct_lights = Some(paths / 16 + 1);
        follow(bench, &scene, Settings { direct_lights, ..interleaved(paths, pattern, false) });
    }
}

pub fn the_walk_from_an_environment_follows_its_oracles(bench: &Bench) {
    let scene = gallery_outdoors();
    for (particles, pattern) in [(1, [1, 1]), (27, [3, 3]), (2049, [1, 1])] {
        let (kinds, _) = follow(bench, &scene, interleaved(particles, pattern, false));
        bench.covered(particles == 1 || kinds.contains(&Kind::Environment), format_args!("too few"));
    }
}

/// The lights of a pass by the oracles alone.
fn walk(rig: &Rig) -> Vec<PointLight> {
    let (p, plan) = (&rig.parameters, &rig.engine.plan().lights);
    let classes = p.pattern[2];
    let mut of_class = vec![PointLight::default(); plan.slots() as usize];
    of_class[..plan.delta as usize].copy_from_slice(&rig.engine.device_scene().delta);
    let mut lights = of_class.repeat(classes as usize);
    let slot = |i: u32, j: usize| walk_start::light_slot(p, i, plan.first_slot(j)) as usize;
    let begins = |i: &u32| p.lists[3] == 0 || p.lists[3] == i + 1;
    for i in (0..rig.engine.plan().settings.particles()).filter(begins) {
        let (light, mut ray, mut flux) = walk_start::reference(p, (rig.engine.emitters(), &rig.scene.textures), i);
        if i < plan.survivors[0] * classes {
            lights[slot(i, 0)] = light;
        }
        let (mut media, mut specular) = (Media::default(), 0);
        for j in (1..plan.survivors.len()).take_while(|&j| i < plan.survivors[j] * classes) {
            let hit_surface = |ray: &Ray| {
                let hit = rig.bvh().closest(ray)?;
                Some(surface_at(rig.scene, rig.bvh(), &hit, ray.direction, p.cones[1] * hit.t))
            };
            let mut surface = hit_surface(&ray);
            for _ in 0..rig.frame().walk.follow_steps(j) {
                let Some(s) = surface.filter(|_| flux != Vec3::ZERO) else { break };
                let particle = (ray.direction, flux, media);
                match walk_follow::reference(p, rig.scene, (j as u32, specular), i, particle, &s) {
                    Fate::Unchanged => break,
                    Fate::Stays(left) => {
                        flux = left;
                        break;
                    }
                    Fate::Flies(next, left, inside) => {
                        (ray, flux, media) = (next, left, inside);
                        specular += 1;
                        surface = hit_surface(&ray);
                    }
                }
            }
            let (light, next, next_flux) = walk_reflect::reference(
                p,
                &rig.scene.materials,
                j,
                (i, specular),
                ray.direction,
                flux,
                surface.as_ref(),
            );
            lights[slot(i, j)] = light;
            (ray, flux) = (next, next_flux);
        }
    }
    lights
}

pub fn the_walk_against_the_oracle_path_by_path(bench: &Bench) {
    let scene = gallery_with_tables();
    let sine = sine_error(bench, &scene);
    let one = [1, 1];
    let of_ring = |form, length, jitter| {
        let ring = Some(Ring { length, ..Ring::new(form) });
        Settings { ring, ..interleaved(1, [2, 3], jitter) }
    };
    for (settings, pass) in [
        (interleaved(1, one, false), 0),
        (interleaved(27, one, true), 1),
        (interleaved(64, one, false), 2),
        (interleaved(2049, one, false), 0),
        (interleaved(2049, one, true), 3),
        (interleaved(229, [3, 3], false), 2),
        (of_ring(Form::Images, 5, false), 7),
        (of_ring(Form::Lights, 1000, true), 0),
        // One path begins, and the slots of the others stay as they are.
        (of_ring(Form::Lights, 27, false), 5),
    ] {
        let (paths, jitter) = (settings.particles, settings.jitter);
        let what = format!("{:?}", settings.ring);
        let mut rig = bench.rig(&scene, [1, 1], settings);
        rig.parameters = rig.engine.plan().parameters(pass).must();
        let parameters = rig.parameters;
        rig.run(|frame, rec| {
            frame.record_start(rec, &parameters)?;
            frame.walk.record(rec)
        });
        let found: Vec<PointLight> = rig.get(&rig.frame().walk.lights);
        let expected = walk(&rig);
        assert_eq!(found.len(), expected.len());
        let mut tally = Tally::new(format!("walk of {paths} particles, pass {pass}, jitter {jitter}, ring {what}"));
        let extent = rig.bvh().diagonal();
        for (slot, (a, b)) in found.iter().zip(&expected).enumerate() {
            // Rounding differences grow from vertex to vertex, most at curved surfaces and sharp lobes.
            let grown = 30f32.powi(b.f0[3] as i32) * sine;
            let place = close(xyz(a.position), xyz(b.position), 0.0, 1e-5 + extent * grown);
            let power = 1e-3 + 10.0 * grown;
            let power = close(xyz(a.emit), xyz(b.emit), power, 1e-6) && close(xyz(a.flux), xyz(b.flux), power, 1e-6);
            let dark = a.emit[..3] == [0.0; 3] && b.emit[..3] == [0.0; 3] && a.flux[..3] == b.flux[..3];
            let holds = dark || place && power && a.flags() == b.flags();
            tally.check_values(holds, &of_lights(a, b), || format!("light {slot}: {a:?}\nfor {b:?}"));
        }
        // A deflected path changes up to three further lights as well.
        tally.finish(3.0 * STRAYS);
    }
}
