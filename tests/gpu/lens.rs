//! Depth of field: the pass against its oracle, circles of confusion in closed form, and images against path tracing
//! through the lens.

use std::f64::consts::PI;

use glam::{Vec3, Vec4};
use lightsum::pass::{ShadingPoints, accumulate, lens};
use lightsum::path_trace::{Options, SpecularPaths};
use lightsum::scene::{Camera, Scene};
use lightsum::settings::{Compensation, Settings};
use lightsum::stage::Stage;

use crate::references::path_traced;
use crate::rig::{Rig, Tally, close, gallery, has, is_lit};
use crate::scenes::{Soup, camera, compare, fov, mean, render, renderer, settings};
use crate::support::gpu_test;
use lightsum::conform::AWKWARD_IMAGES;

#[test]
fn lens_follows_its_oracle() {
    gpu_test(|ctx| {
        let mut scene = gallery();
        let (aperture, focus) = (0.3, 4.0);
        let view = scene.camera.unwrap();
        scene.camera = Some(Camera { aperture, focus: Some(focus), ..view });
        let (mut before, mut behind, mut nothing) = (0, 0, 0);
        for resolution in AWKWARD_IMAGES {
            let rig = Rig::new(ctx, &scene, resolution, Settings { compensation: Compensation::Off, ..settings(4, 5) });
            let frame = rig.frame();
            rig.run(|frame, rec| {
                frame.walk.record(rec)?;
                frame.eye.record(rec)?;
                frame.shade.record(rec)?;
                frame.merge.record(rec)
            });
            assert_eq!(rig.lost(), 0);
            let (lens, r, sums) = (frame.lens.as_ref().unwrap(), &frame.eye.points, &frame.shade.lighting);
            rig.prefill(&[&lens.source, &lens.footprint, &lens.region, &lens.convolution.spread]);
            let [kd, wo, emitted] = [&r.kd, &r.wo, &r.emitted].map(|b| rig.vec4s(b));
            let lights = [&sums.direct, &sums.indirect, &sums.specular].map(|b| rig.vec4s(b));
            let through = rig.vec4s(&frame.eye.paths.throughput);
            rig.run(|_, rec| lens.record_image(rec));
            let (source, footprint) = (rig.vec4s(&lens.source), rig.vec4s(&lens.footprint));
            let region = rig.get::<u32>(&lens.region);
            let mut tally = Tally::new(format!("lens, {resolution:?}"));
            for i in 0..region.len() {
                let light = lights.each_ref().map(|l| if is_lit(wo[i]) { l[i].truncate() } else { Vec3::ZERO });
                let [e, beta, kd] = [emitted[i], through[i], kd[i]].map(Vec4::truncate);
                let l = accumulate::reference(e, beta, kd, light);
                tally.check_values(close(source[i].truncate(), l, 1e-5, 1e-6), &[(source[i].truncate(), l)], || {
                    format!("{i}: {} for {l}", source[i])
                });
                let depth = has(wo[i], ShadingPoints::HIT).then_some(through[i].w);
                assert_eq!(source[i].w, depth.unwrap_or(lens::NOTHING_SEEN));
                let diameter = lens::reference(&rig.parameters, aperture, focus, depth);
                let off = (footprint[i].x - diameter).abs();
                tally.check(off <= 1e-4 * diameter + 1e-4, || format!("{i}: {} for {diameter}", footprint[i]));
                assert_eq!(footprint[i].to_array()[1..], [0.0, 1.0, 0.0]);
                let front = depth.is_some_and(|z| z < focus);
                assert_eq!(region[i], if front { 2 } else { 1 }, "{i}");
                before += usize::from(front);
                behind += usize::from(!front);
                nothing += usize::from(depth.is_none());
            }
            tally.finish(0.0);
            rig.run(|_, rec| lens.convolution.record(rec));
            rig.run(|_, rec| lens.record_add(rec));
            let (spread, added) = (rig.vec4s(&lens.convolution.spread), rig.vec4s(&r.emitted));
            for i in 0..region.len() {
                let expected = emitted[i].truncate() + (spread[i] - source[i]).truncate();
                assert!(close(added[i].truncate(), expected, 1e-6, 1e-6), "{i}: {} for {expected}", added[i]);
            }
        }
        assert!(before > 50 && behind > 50 && nothing > 5, "{before} {behind} {nothing}");
    });
}

/// Pixels in a unit of length at unit distance.
fn pixels_of_unit(camera: &Camera) -> f32 {
    0.5 * camera.resolution[1] as f32 / (0.5 * camera.fov_y).to_radians().tan()
}

/// The camera with a lens that images a point at depth `z` as a disc of the given diameter in pixels.
fn with_circle(camera: Camera, focus: f32, z: f32, diameter: f32) -> Camera {
    let aperture = diameter / (pixels_of_unit(&camera) * (1.0 / z - 1.0 / focus).abs());
    Camera { aperture, focus: Some(focus), ..camera }
}

/// A small light out of focus becomes a disc of the right width and keeps its energy, in front of and behind the plane
/// in focus.
#[test]
fn points_become_discs() {
    gpu_test(|ctx| {
        let view = camera(Vec3::ZERO, Vec3::Z, 40.0, [65, 65]);
        // In the coarse levels of the pyramid a disc is a few texels wide, and its variance on their grid differs from
        // that of a disc: most at 30 pixels, three quarters of which are spread as three texels of 8 pixels.
        for (z, diameter, tolerance) in [
            (2.0, 5.0, 0.025),
            (2.0, 13.0, 0.03),
            (8.0, 5.0, 0.025),
            (8.0, 13.0, 0.03),
            (2.0, 26.0, 0.05),
            (2.0, 30.0, 0.13),
            (2.0, 36.0, 0.09),
        ] {
            let mut soup = Soup::new("point");
            let glow = soup.diffuse(0.0, 1000.0);
            let half = z / pixels_of_unit(&view);
            let black = soup.diffuse(0.0, 0.0);
            soup.quad(Vec3::new(-9.0, -9.0, 1.001 * z), Vec3::Y * 18.0, Vec3::X * 18.0, black);
            soup.quad(Vec3::new(-half, -half, z), Vec3::Y * 2.0 * half, Vec3::X * 2.0 * half, glow);
            let sharp = render(ctx, &soup.0, view, &settings(1, 1), 16).color;
            let blurred = render(ctx, &soup.0, with_circle(view, 4.0, z, diameter), &settings(1, 1), 16).color;
            let variance = |image: &[Vec3]| {
                let of = |(i, l): (usize, &Vec3)| {
                    let (x, y) = ((i % 65) as f64 - 32.0, (i / 65) as f64 - 32.0);
                    f64::from(l.x) * 0.5 * (x * x + y * y)
                };
                image.iter().enumerate().map(of).sum::<f64>() / image.iter().map(|l| f64::from(l.x)).sum::<f64>()
            };
            // For a disc, the variance along an axis is D^2 / 16.
            let found = 4.0 * (variance(&blurred) - variance(&sharp)).sqrt();
            let energy = mean(&blurred).x / mean(&sharp).x;
            println!("z {z}, D {diameter}: {found:.3}, energy {energy:.4}");
            assert!((found / f64::from(diameter) - 1.0).abs() < tolerance, "z {z}: {found} for {diameter}");
            assert!((energy - 1.0).abs() < 0.002, "z {z}, {diameter}: energy {energy}");
        }
    });
}

/// The edge between two halves of a wall out of focus: the fraction of the disc on either side.
#[test]
fn edges_become_the_disc_s_integral() {
    gpu_test(|ctx| {
        let view = camera(Vec3::ZERO, Vec3::Z, 40.0, [64, 65]);
        let mut soup = Soup::new("edge");
        let (dark, bright) = (soup.diffuse(0.0, 1.0), soup.diffuse(0.0, 3.0));
        let z = 2.0;
        soup.quad(Vec3::new(-9.0, -9.0, z), Vec3::Y * 18.0, Vec3::X * 9.0, dark);
        soup.quad(Vec3::new(0.0, -9.0, z), Vec3::Y * 18.0, Vec3::X * 9.0, bright);
        for (diameter, tolerance) in [(5.0, 0.011), (11.0, 0.026), (24.0, 0.05)] {
            let image = render(ctx, &soup.0, with_circle(view, 4.0, z, diameter), &settings(1, 1), 16).color;
            // The camera's right is -x.
            let share = |x: usize| 0.5 * (f64::from(image[32 * 64 + x].x) - 1.0);
            let mut worst = 0.0f64;
            for x in 8..56 {
                let s = ((31.5 - x as f64) / (0.5 * f64::from(diameter))).clamp(-1.0, 1.0);
                let expected = 0.5 + (s * (1.0 - s * s).sqrt() + s.asin()) / PI;
                worst = worst.max((share(x) - expected).abs());
            }
            println!("D {diameter}: worst {worst:.4}");
            assert!(worst < tolerance, "{diameter}: {worst}");
        }
    });
}

/// Centres and radii of the balls below.
const BALLS: [(Vec3, f32); 2] = [(Vec3::new(0.5, -0.5, 3.0), 0.5), (Vec3::new(-0.5, -0.3, 1.8), 0.25)];

/// A ball in front of a wall with bright bars, both lit by a lamp, and a ball nearer than both.
fn balls() -> (Scene, Camera) {
    let mut soup = Soup::new("balls");
    let (gray, red) = (soup.diffuse(0.7, 0.0), soup.diffuse([0.7, 0.3, 0.2], 0.0));
    let (blue, lamp) = (soup.diffuse([0.2, 0.3, 0.7], 0.0), soup.diffuse(0.0, 12.0));
    soup.room(Vec3::new(-2.0, -1.0, -1.0), Vec3::new(2.0, 1.5, 6.0), [red, blue, gray, gray, gray, gray]);
    soup.quad(Vec3::new(-0.7, 1.49, 2.0), Vec3::X * 1.4, Vec3::Z * 1.4, lamp);
    let bar = soup.diffuse(0.0, 3.0);
    for i in 0..6 {
        let corner = Vec3::new(-1.8 + 0.6 * i as f32, -0.8, 5.99);
        soup.quad(corner, Vec3::Y * 2.0, Vec3::X * 0.3, bar);
    }
    for ((center, radius), material) in BALLS.into_iter().zip([red, blue]) {
        soup.ball(center, radius, 16, material);
    }
    (soup.0, camera(Vec3::new(0.0, 0.0, -0.5), Vec3::new(0.0, -0.2, 3.0), 50.0, [64, 48]))
}

/// The part in focus is unchanged, up to rounding, whatever is blurred behind it: the background does not bleed over
/// it.
#[test]
fn what_is_in_focus_stays_sharp() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("board");
        let (glow, far) = (soup.diffuse(0.0, 2.0), soup.diffuse(0.0, 50.0));
        soup.quad(Vec3::new(-0.5, -0.5, 2.0), Vec3::Y, Vec3::X, glow);
        soup.quad(Vec3::new(-9.0, -9.0, 8.0), Vec3::Y * 18.0, Vec3::X * 18.0, far);
        let view = camera(Vec3::ZERO, Vec3::Z, fov(1.0, 2.0), [61, 47]);
        for diameter in [5.0, 31.0] {
            let lens = with_circle(view, 2.0, 8.0, diameter);
            let [sharp, blurred] = [view, lens].map(|camera| render(ctx, &soup.0, camera, &settings(1, 1), 1).color);
            let mut seen = 0;
            for (i, (a, b)) in sharp.iter().zip(&blurred).enumerate().filter(|(_, (a, _))| a.x == 2.0) {
                seen += 1;
                assert!(close(*a, *b, 1e-5, 0.0), "{diameter}, pixel {i}: {b} for {a}");
            }
            assert!(seen > 300, "{seen}");
        }
    });
}

/// Pixels where the rim of a ball of [`balls`] is blurred by a lens: half its circle of confusion on either side.
fn rims(view: &Camera, aperture: f32, focus: f32) -> Vec<bool> {
    let forward = (view.target - view.eye).normalize();
    let right = forward.cross(view.up).normalize();
    let (up, scale, [width, height]) = (right.cross(forward), pixels_of_unit(view), view.resolution);
    let discs = BALLS.map(|(center, radius)| {
        let v = center - view.eye;
        let z = v.dot(forward);
        let x = 0.5 * width as f32 + v.dot(right) / z * scale;
        let y = 0.5 * height as f32 - v.dot(up) / z * scale;
        let blur = aperture * (1.0 / (z - radius) - 1.0 / focus).abs() * scale;
        (x, y, radius / z * scale, 0.5 * blur + 1.5)
    });
    let near =
        |px: f32, py: f32| discs.iter().any(|(x, y, radius, reach)| ((px - x).hypot(py - y) - radius).abs() < *reach);
    (0..width * height).map(|i| near((i % width) as f32 + 0.5, (i / width) as f32 + 0.5)).collect()
}

/// Against the path tracer's lens. The largest difference is at the rims of blurred objects, whose background no pixel
/// shows.
#[test]
fn images_agree_with_path_tracing() {
    gpu_test(|ctx| {
        let (scene, view) = balls();
        let options = Options {
            resolution: view.resolution,
            samples: 1600,
            max_depth: 2,
            max_specular: 0,
            seed: 7,
            specular_paths: SpecularPaths::None,
            reflectance: Default::default(),
        };
        // Circles of up to 5 and of up to 16 pixels. Limits of the error elsewhere and at rims.
        for (aperture, limits) in [(0.5, [0.115, 0.27]), (1.5, [0.095, 0.28])] {
            let focus = 3.4;
            let lens = Camera { aperture, focus: Some(focus), ..view };
            let [sharp, blurred] = [view, lens].map(|camera| render(ctx, &scene, camera, &settings(32, 2), 64).color);
            let reference = path_traced(&scene, &lens, &options);
            let at_rim = rims(&view, aperture, focus);
            for (rim, limit) in [false, true].into_iter().zip(limits) {
                let part = |image: &[Vec3]| -> Vec<Vec3> {
                    (image.iter().zip(&at_rim)).filter(|(_, at_rim)| **at_rim == rim).map(|(l, _)| *l).collect()
                };
                let [sharp, blurred, reference] = [&sharp, &blurred, &reference].map(|image| part(image));
                let ((energy, error), (_, without)) = (compare(&blurred, &reference), compare(&sharp, &reference));
                let pixels = reference.len();
                println!("aperture {aperture}, rim {rim}, {pixels} pixels: {energy:.4} {error:.4}, sharp {without:.4}");
                assert!((energy - 1.0).abs() < if rim { 0.05 } else { 0.013 }, "{aperture}: energy {energy}");
                assert!(error < limit, "{aperture}: {error}; without a lens {without}");
            }
        }
    });
}

/// The lens follows the camera: the image is that of an engine made for it, bit for bit.
#[test]
fn apertures_come_and_go() {
    gpu_test(|ctx| {
        let (scene, view) = balls();
        let settings = settings(4, 3);
        let wide = Camera { aperture: 0.2, ..view };
        let near = Camera { focus: Some(1.0), ..wide };
        let mut moving = renderer(ctx, &scene, view, &settings);
        for camera in [wide, near, view, near] {
            moving.engine_mut().set_camera(camera).unwrap();
            moving.pass().unwrap();
            moving.pass().unwrap();
            let fresh = render(ctx, &scene, camera, &settings, 2);
            assert!(moving.layers().unwrap().color == fresh.color, "{camera:?}");
        }
    });
}

#[test]
fn summands_of_a_lens_are_refused() {
    gpu_test(|ctx| {
        let (scene, view) = balls();
        let wide = Camera { aperture: 0.2, ..view };
        let summands = Settings { summands: true, ..settings(4, 3) };
        let both = |error: lightsum::Error| {
            let text = error.to_string();
            assert!(text.contains("--summands") && text.contains("--aperture"), "{text}");
        };
        both(lightsum::engine::Engine::new(ctx, &scene, wide, summands.clone()).err().unwrap());
        let mut sharp = renderer(ctx, &scene, view, &summands);
        both(sharp.engine_mut().set_camera(wide).unwrap_err());
        let mut blurred = renderer(ctx, &scene, wide, &settings(4, 3));
        both(blurred.engine_mut().set_settings(summands).unwrap_err());
        for (camera, word) in [
            (Camera { aperture: -1.0, ..view }, "aperture"),
            (Camera { aperture: f32::NAN, ..view }, "aperture"),
            (Camera { focus: Some(0.0), ..view }, "focus"),
            (Camera { focus: Some(f32::INFINITY), ..view }, "focus"),
        ] {
            let text = sharp.engine_mut().set_camera(camera).unwrap_err().to_string();
            assert!(text.contains(word), "{text}");
        }
    });
}
