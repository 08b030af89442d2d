//! Radiosity textures: light of adaptive trees against closed forms, and the frame that shows it.

use std::sync::Arc;

use glam::Vec3;
use lightsum::bake::files::{self, Form, Parts};
use lightsum::bake::{self, Lightmap};
use lightsum::gpu::Context;
use lightsum::output::{Metadata, State};
use lightsum::radiosity::{Growth, Options, Order, Radiosity, Solution, TextureOptions};
use lightsum::scene::{KeptLight, Light, Scene, builtin};
use lightsum::settings::{Clip, Compensation, Lookup, Settings};
use lightsum::view::Texel;

use crate::bake::room;
use crate::scenes::{Soup, renderer};
use crate::support::gpu_test;

/// All lights at every point, without clipping.
fn plain() -> Settings {
    Settings { clip: Clip::Distance(0.0), compensation: Compensation::Off, ..Settings::plain() }
}

fn solved(
    ctx: &Context,
    scene: &Scene,
    settings: &Settings,
    options: &Options,
    passes: u32,
) -> (Radiosity, Solution, Lightmap) {
    let radiosity = Radiosity::new(ctx, scene, settings.clone()).unwrap();
    let (solution, _) = radiosity.refine(options, passes, &mut |_| true).unwrap();
    let light = radiosity.lightmap(&solution, &TextureOptions::default(), &bake::Options::default()).unwrap();
    (radiosity, solution, light)
}

/// Mean direct and indirect irradiance over the front of triangles.
fn mean(kept: &KeptLight, triangles: &[u32]) -> [f32; 2] {
    const N: usize = 60;
    let mut sum = [0.0; 2];
    for &triangle in triangles {
        for i in 0..N * N {
            let (s, t) = (((i % N) as f32 + 0.5) / N as f32, ((i / N) as f32 + 0.5) / N as f32);
            // The unit square folded onto the triangle.
            let uv = if s + t > 1.0 { [1.0 - s, 1.0 - t] } else { [s, t] };
            let light = kept.irradiance(triangle, false, uv);
            (0..2).for_each(|k| sum[k] += light[k].x / (triangles.len() * N * N) as f32);
        }
    }
    sum
}

#[test]
fn a_grey_cube_with_a_lit_ceiling_has_its_form_factors() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("cube");
        let (grey, lamp) = (soup.diffuse(0.5, 0.0), soup.diffuse(0.0, 3.0));
        soup.room(Vec3::ZERO, Vec3::ONE, [grey, grey, grey, lamp, grey, grey]);
        // Points near the lamp's edge need what clipping cuts off.
        let settings = Settings { particles: 256, direct_lights: Some(256), max_depth: 2, ..Settings::plain() };
        for order in [Order::First, Order::Zero] {
            let options = Options { epsilon: 0.04, height: 5, start: 256, order, ..Options::default() };
            let (radiosity, solution, light) = solved(ctx, &soup.0, &settings, &options, 8);
            assert_eq!(radiosity.surfaces().len(), 5, "the lamp reflects nothing");
            assert!(solution.rounds.len() > 1, "{:?}", solution.rounds);
            let kept = light.kept(&soup.0);
            // Faces are added x low, x high, y low (the floor), y high.
            for (face, factor) in [(0, 0.200_043_78), (1, 0.200_043_78), (2, 0.199_824_9), (4, 0.200_043_78)] {
                let [direct, _] = mean(&kept, &[2 * face, 2 * face + 1]);
                let found = direct / (3.0 * std::f32::consts::PI);
                assert!((found / factor - 1.0).abs() < 0.012, "{order:?} face {face}: {found} for {factor}");
            }
        }
    });
}

#[test]
fn a_furnace_and_a_sphere_are_even() {
    gpu_test(|ctx| {
        let (rho, le) = (0.5, 2.0);
        let settings = Settings { particles: 64, max_depth: 6, ..Settings::plain() };
        let options = Options { epsilon: 0.3, height: 3, start: 96, ..Options::default() };
        let scene = builtin::furnace(rho, le);
        let (_, _, light) = solved(ctx, &scene, &settings, &options, 8);
        // Direct light and four reflections.
        let expected = std::f32::consts::PI * le * (1.0 - rho.powi(5)) / (1.0 - rho);
        let kept = light.kept(&scene);
        let all: Vec<u32> = (0..scene.triangles.len() as u32).collect();
        let found = mean(&kept, &all).iter().sum::<f32>();
        assert!((found / expected - 1.0).abs() < 0.03, "{found} for {expected}");
        // In a sphere every point has the same irradiance.
        let patches = [(1.0, 0.2), (0.0, 0.8), (0.0, 0.3), (2.0, 0.6), (0.0, 0.5), (0.5, 0.1), (0.0, 0.7), (0.0, 0.4)];
        let scene = builtin::sphere_enclosure(3, &patches);
        let settings = Settings { particles: 512, max_depth: 12, ..settings };
        let (_, _, light) = solved(ctx, &scene, &settings, &options, 8);
        let all: Vec<u32> = (0..scene.triangles.len() as u32).collect();
        let found = mean(&light.kept(&scene), &all).iter().sum::<f32>();
        let [emitted, rho] = [patches.iter().map(|p| p.0).sum::<f32>(), patches.iter().map(|p| p.1).sum()];
        let expected = emitted / 8.0 / (1.0 - rho / 8.0);
        assert!((found / expected - 1.0).abs() < 0.03, "{found} for {expected}");
        // The triangles of an octant follow each other.
        let kept = light.kept(&scene);
        let run = all.len() / patches.len();
        for (octant, (&(own, rho), triangles)) in patches.iter().zip(all.chunks_exact(run)).enumerate() {
            let of = |triangles: &[u32]| mean(&kept, triangles).iter().sum::<f32>();
            let ratio = (own + rho * of(triangles)) / (own + rho * expected);
            assert!((ratio - 1.0).abs() < 0.03, "octant {octant}: {ratio} of its radiosity");
            // Each triangle has the noise of its few points.
            let squares = triangles.iter().map(|&t| (of(&[t]) / expected - 1.0).powi(2));
            let uneven = (squares.sum::<f32>() / run as f32).sqrt();
            assert!(uneven < 0.08, "octant {octant}: its triangles differ by {uneven}");
        }
    });
}

#[test]
fn a_ball_under_a_point_light_has_its_closed_form() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("ball");
        let white = soup.diffuse(0.6, 0.0);
        let (centre, radius) = (Vec3::new(1.0, 2.0, -1.0), 0.5);
        soup.ball(centre, radius, 24, white);
        soup.quad(Vec3::new(-2.0, 0.0, -3.0), 4.0 * Vec3::Z, 5.0 * Vec3::X, white);
        let (light, intensity) = (centre + Vec3::new(1.5, 1.1, 0.7), 4.0);
        soup.0.lights.push(Light::Point { position: light, intensity: Vec3::splat(intensity) });
        let scene = soup.0;
        let settings = Settings { particles: 1, max_depth: 2, ..plain() };
        let options = Options { epsilon: 0.02, height: 5, ..Options::default() };
        let (radiosity, solution, light_map) = solved(ctx, &scene, &settings, &options, 2);
        let patches = radiosity.surfaces().iter().filter(|surface| surface.patch.is_some()).count();
        assert_eq!((patches, radiosity.surfaces().len()), (6, 7));
        assert!(solution.trees[1..].iter().all(|tree| tree.height() > 1));
        // What the file gives back is what the engine shows.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ball.glb");
        files::write(&path, &scene, &light_map, (Parts::Together, Form::Lit), &Metadata::default()).unwrap();
        let read = files::read(&path, &scene).unwrap();
        let kept = light_map.kept(&scene);
        let (mut worst, mut sum, mut of, mut count) = (0.0f32, 0.0, 0.0, 0);
        let greatest = intensity / ((light - centre).length() - radius).powi(2);
        for (i, triangle) in (0u32..).zip(&scene.triangles) {
            let corners = scene.triangle_positions(i as usize);
            if !triangle.smooth {
                continue;
            }
            for uv in [[0.33, 0.33], [0.05, 0.05], [0.9, 0.05], [0.05, 0.9], [0.48, 0.48]] {
                let [a, b, c] = corners;
                let normal = (a + uv[0] * (b - a) + uv[1] * (c - a) - centre).normalize();
                let to = light - (centre + radius * normal);
                let cos = normal.dot(to.normalize());
                let found = kept.irradiance(i, false, uv)[0].x;
                let from_file: Vec3 = read.irradiance(i, false, uv).into_iter().sum();
                assert!((from_file.x - found).abs() <= 2e-3 * greatest, "{from_file} {found}");
                if cos > 0.15 {
                    let expected = intensity * cos / to.length_squared();
                    worst = worst.max((found - expected).abs() / greatest);
                    (sum, of, count) = (sum + found, of + expected, count + 1);
                } else if cos < -0.15 {
                    assert!(found < 0.01 * greatest, "{found}");
                }
            }
        }
        assert!(count > 1000 && worst < 0.03 && (sum / of - 1.0).abs() < 0.03, "{worst} {} {count}", sum / of);
    });
}

#[test]
fn all_rounds_have_the_same_lights() {
    gpu_test(|ctx| {
        let scene = room(false);
        let settings = Settings { particles: 32, ..plain() };
        let radiosity = Radiosity::new(ctx, &scene, settings).unwrap();
        let point = |i: u32| Texel { triangle: 10 + i % 2, uv: [0.01 * (i % 40) as f32 + 0.1, 0.3], back: false };
        let all: Vec<Texel> = (0..700).map(point).collect();
        let light = |points: &[Texel]| radiosity.light(points, 3, &mut |_| true).unwrap();
        let whole = light(&all);
        let part = light(&all[300..371]);
        for (a, b) in whole[300..371].iter().zip(&part) {
            let difference = (a.total() - b.total()).abs().max_element();
            assert!(difference <= 1e-5 * a.total().max_element(), "{a:?} {b:?}");
        }
        assert!(whole[0].total() != whole[1].total() && whole[0].total().max_element() > 0.0);
    });
}

#[test]
fn growth_that_is_broken_off_goes_on_bit_for_bit() {
    gpu_test(|ctx| {
        let scene = room(false);
        let radiosity = Radiosity::new(ctx, &scene, Settings { particles: 8, ..plain() }).unwrap();
        let options = Options { epsilon: 0.2, height: 4, ..Options::default() };
        let whole = radiosity.refine(&options, 3, &mut |_| true).unwrap().0;
        assert!(whole.rounds.len() > 2, "{:?}", whole.rounds);
        let mut growth = Growth::new(&radiosity, &options, 3).unwrap();
        assert!(!growth.has_light() && matches!(growth.solution(), Err(lightsum::Error::Interrupted)));
        let mut passes = 0;
        while !growth.is_done() {
            if growth.progress().points == 0 {
                assert!(growth.pass(&|| true).unwrap(), "there is nothing to break off");
                continue;
            }
            // A pass that is broken off, then the state of another run.
            assert!(!growth.pass(&|| true).unwrap());
            let state = growth.state().unwrap();
            let path = tempfile::tempdir().unwrap();
            let path = path.path().join("a.state");
            state.write(&path).unwrap();
            let mut next = Growth::new(&radiosity, &options, 3).unwrap();
            assert_eq!(next.fingerprint(), state.fingerprint);
            next.go_on(&State::read(&path).unwrap()).unwrap();
            assert_eq!((next.rounds(), next.progress()), (growth.rounds(), growth.progress()));
            assert!(next.pass(&|| false).unwrap());
            growth = next;
            passes += 1;
            // The light that there is becomes a map: from the first pass on.
            let part = growth.solution().unwrap();
            let light = radiosity.lightmap(&part, &TextureOptions::default(), &bake::Options::default()).unwrap();
            assert!(light.pages[0].direct.iter().any(|light| light.x > 0.0));
        }
        assert_eq!(passes, 3 * whole.rounds.iter().filter(|round| round.points > 0).count());
        let resumed = growth.solution().unwrap();
        let bits = |solution: &Solution| solution.lit().iter().map(|&place| (place, solution.at(place))).collect();
        let (a, b): (Vec<_>, Vec<_>) = (bits(&resumed), bits(&whole));
        let other = a.iter().zip(&b).filter(|(a, b)| a != b).count();
        assert!(
            resumed == whole,
            "{other} of {} samples differ, first {:?}",
            a.len(),
            a.iter().zip(&b).find(|(a, b)| a != b)
        );
        // Other trees refuse the state.
        let state = growth.state().unwrap();
        let other = Growth::new(&radiosity, &options, 4).unwrap();
        assert_ne!(other.fingerprint(), state.fingerprint);
        let mut short = state.clone();
        short.accumulators.truncate(100);
        let refused = Growth::new(&radiosity, &options, 3).unwrap().go_on(&short).unwrap_err().to_string();
        assert!(refused.contains("--resume"), "{refused}");
    });
}

#[test]
fn passes_after_the_rounds_are_those_that_follow() {
    gpu_test(|ctx| {
        let scene = room(false);
        let radiosity = Radiosity::new(ctx, &scene, Settings { particles: 8, ..plain() }).unwrap();
        let options = Options { epsilon: 0.3, height: 3, ..Options::default() };
        let mut solution = radiosity.refine(&options, 2, &mut |_| true).unwrap().0;
        let parts = radiosity.parts(&solution);
        let [part] = &parts[..] else { panic!("{}", parts.len()) };
        assert_eq!(part.len() + solution.inside(), solution.points());
        let mut renderer = radiosity.renderer(part, 2, None).unwrap();
        (0..3).for_each(|_| renderer.pass().unwrap());
        assert_eq!(renderer.passes(), 5);
        part.add(&mut solution, 2, &renderer.layers().unwrap(), 3);
        // The light of five passes at once.
        let places = solution.lit();
        let points: Vec<Texel> = solution
            .points_of(&places)
            .iter()
            .map(|p| radiosity.surfaces()[p.root as usize].texel(p.at, options.height))
            .collect();
        let expected = radiosity.light(&points, 5, &mut |_| true).unwrap();
        for (&place, expected) in places.iter().zip(expected) {
            let found = solution.at(place).total();
            let difference = (found - expected.total()).abs().max_element();
            assert!(difference <= 1e-5 * expected.total().max_element().max(1e-3), "{found} {expected:?}");
        }
    });
}

#[test]
fn the_frame_shows_textures_as_it_shows_maps() {
    gpu_test(|ctx| {
        let mut scene = room(false);
        let camera = scene.camera.unwrap();
        let settings = Settings { particles: 48, clip: Clip::Distance(0.4), ..plain() };
        const PASSES: u32 = 8;
        let image = |scene: &Scene, lookup: Lookup| {
            let mut renderer = renderer(ctx, scene, camera, &Settings { lookup, ..settings.clone() });
            (0..PASSES).for_each(|_| renderer.pass().unwrap());
            renderer.layers().unwrap().color
        };
        let full = image(&scene, Lookup::Bilinear);
        let error = |kept: &[Vec3]| {
            let lit = || full.iter().zip(kept).filter(|(f, _)| f.max_element() < 11.0);
            let square = |v: Vec3| f64::from(v.length_squared());
            let (sum, of) = lit().fold((0.0, 0.0), |(a, b), (f, k)| (a + square(*f - *k), b + square(*f)));
            let energy = |i: usize| -> f32 { lit().map(|p| [p.0, p.1][i].element_sum()).sum() };
            ((sum / of).sqrt(), energy(1) / energy(0))
        };
        let options = |epsilon: f32, height: u8| Options { epsilon, height, ..Options::default() };
        let mut errors = Vec::new();
        for (epsilon, height) in [(0.3, 3), (0.03, 7)] {
            let (radiosity, solution, light) = solved(ctx, &scene, &settings, &options(epsilon, height), PASSES);
            scene.kept_light = Some(Arc::new(light.kept(&scene)));
            for lookup in [Lookup::Bilinear, Lookup::Bicubic] {
                let (rmse, energy) = error(&image(&scene, lookup));
                assert!((energy - 1.0).abs() < 0.03, "{height} {lookup:?}: energy {energy}");
                errors.push(rmse);
            }
            scene.kept_light = None;
            // The same bits again.
            let again = radiosity.refine(&options(epsilon, height), PASSES, &mut |_| true).unwrap().0;
            assert_eq!(again, solution);
        }
        assert!(errors[2] < 0.05 && errors[2] < 0.6 * errors[0], "{errors:?}");
        assert!(errors[3] < 0.06, "{errors:?}");
    });
}

#[test]
fn interrupts_and_scenes_without_light_are_told() {
    gpu_test(|ctx| {
        let radiosity = Radiosity::new(ctx, &room(false), plain()).unwrap();
        let mut calls = 0;
        let broken = radiosity.refine(&Options::default(), 4, &mut |_| {
            calls += 1;
            calls < 3
        });
        assert!(matches!(broken, Err(lightsum::Error::Interrupted)) && calls == 3);
        let mut dark = room(false);
        dark.materials.iter_mut().for_each(|m| m.base_color = Vec3::ZERO);
        assert!(Radiosity::new(ctx, &dark, plain()).err().unwrap().to_string().contains("nothing to bake"));
    });
}
