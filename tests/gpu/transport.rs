//! The whole renderer against closed forms. Each tolerance is stated with its causes: integration by finitely many
//! points of a low-discrepancy sequence, the rounding of single precision (1e-4 at most), and flat facets instead of a
//! sphere.

use std::f32::consts::PI;

use glam::{DVec3, Vec2, Vec3};
use lightsum::gpu::Context;
use lightsum::path_trace::eye_ray;
use lightsum::scene::{Camera, Light, Material, Scene, builtin};
use lightsum::settings::{Clip, Compensation, Sequence, Settings};

use crate::scenes::{Soup, camera, fov, mean, original, probe, render, renderer, settings};
use crate::support::gpu_test;

const TAU64: f64 = std::f64::consts::TAU;
const PI64: f64 = std::f64::consts::PI;

/// Fails unless `value` is within `tolerance` of `expected`, relative.
#[track_caller]
fn near(what: &str, value: f64, expected: f64, tolerance: f64) {
    let error = value / expected - 1.0;
    println!("{what}: {value:.6}, expected {expected:.6} ({error:+.5} of {tolerance})");
    assert!(error.abs() <= tolerance, "{what}: {value} is off {expected} by {error:+.5}; allowed is {tolerance}");
}

/// Mean of the three channels of a layer.
fn grey(layer: &[Vec3]) -> f64 {
    mean(layer).element_sum() / 3.0
}

/// 1 + x + ... + x^(n - 1).
fn series(x: f64, n: u32) -> f64 {
    (0..n).map(|k| x.powi(k as i32)).sum()
}

#[test]
fn furnace_after_each_reflection() {
    gpu_test(|ctx| {
        let halton =
            [(0.5, 1), (0.5, 2), (0.5, 3), (0.5, 4), (0.5, 5), (0.8, 5), (0.2, 3)].map(|c| (Sequence::Halton, c));
        let sobol = [(0.5, 2), (0.5, 5), (0.8, 5)].map(|c| (Sequence::Sobol, c));
        for (sequence, (rho, depth)) in halton.into_iter().chain(sobol) {
            let scene = builtin::furnace(rho, 2.0);
            let camera = Camera { resolution: [16, 16], ..scene.camera.unwrap() };
            let layers = render(ctx, &scene, camera, &Settings { sequence, ..settings(32, depth) }, 32);
            let expected = 2.0 * series(f64::from(rho), depth);
            // Three standard deviations over seeds, which are 0.005 at depth 5 for 1024 paths.
            let tolerance = if depth == 1 { 1e-6 } else { 0.003 * f64::from(depth) };
            near(
                &format!("{sequence:?}, rho {rho}, {} reflections", depth - 1),
                grey(&layers.color),
                expected,
                tolerance,
            );
        }
    });
}

#[test]
fn every_class_of_pixels_sees_all_the_light() {
    gpu_test(|ctx| {
        for pattern in [[3, 3], [2, 1], [8, 8]] {
            let scene = builtin::furnace(0.5, 2.0);
            let camera = Camera { resolution: [24, 24], ..scene.camera.unwrap() };
            let layers = render(ctx, &scene, camera, &Settings { pattern, ..settings(32, 4) }, 24);
            for class in 0..pattern[0] * pattern[1] {
                let of_class =
                    (0..24 * 24u32).filter(|&p| p % 24 % pattern[0] + pattern[0] * (p / 24 % pattern[1]) == class);
                let colors: Vec<Vec3> = of_class.map(|p| layers.color[p as usize]).collect();
                near(&format!("class {class} of {pattern:?}"), grey(&colors), 2.0 * series(0.5, 4), 0.02);
            }
        }
    });
}

#[test]
fn furnace_of_the_scene_file() {
    gpu_test(|ctx| {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/furnace/scene.toml");
        let scene = lightsum::scene::load(path.as_ref()).unwrap();
        let camera = Camera { resolution: [16, 16], ..scene.camera.unwrap() };
        let layers = render(ctx, &scene, camera, &settings(32, 4), 32);
        near("3 reflections", grey(&layers.color), series(0.5, 4), 0.012);
    });
}

/// Fraction of the light of a wall, perpendicular to the shading point's surface and at distance s from the point, that
/// clipping at c removes.
///
/// loss = int cos cos' / (pi d^2) (1 - d^2 / c^2) dA over d < c; with cos cos' = s z / d^2 and z = r sin(phi) this is
/// (2 s / pi) int_0^sqrt(c^2 - s^2) r^2 / (s^2 + r^2)^2 (1 - (s^2 + r^2) / c^2) dr.
fn clipped_share(s: f64, c: f64) -> f64 {
    let (n, end) = (20_000, (c * c - s * s).max(0.0).sqrt());
    let f = |r: f64| r * r / (s * s + r * r).powi(2) * (1.0 - (s * s + r * r) / (c * c));
    let sum: f64 = (0..n).map(|i| f((f64::from(i) + 0.5) / f64::from(n) * end)).sum();
    2.0 * s / PI64 * sum * end / f64::from(n)
}

#[test]
fn clipping_darkens_an_edge_by_its_closed_form_and_compensation_undoes_it() {
    gpu_test(|ctx| {
        let scene = builtin::furnace(0.5, 1.0);
        let clip = 0.2;
        // Near the edge y = 0 of the wall z = 1, far from all others. The limit at the edge itself is 0.5.
        for (s, passes) in [(0.02f32, 8), (0.05, 4), (0.1, 4), (0.25, 4)] {
            let point = Vec3::new(0.5, s, 1.0);
            let camera = probe(Vec3::new(0.5, 0.5, 0.3), point);
            let clipped = Settings {
                clip: Clip::Distance(clip),
                compensation: Compensation::Off,
                lights_per_dispatch: 64,
                ..settings(2048, 2)
            };
            let expected = 1.0 - clipped_share(f64::from(s), f64::from(clip));
            let e = grey(&render(ctx, &scene, camera, &clipped, passes).direct) / PI64;
            near(&format!("clipped at {s}"), e, expected, 0.01);
        }
        // With compensation every point has all its light again: the image is uniform up to the grain of short paths.
        let point = Vec3::new(0.5, 0.0, 1.0);
        let camera = camera(Vec3::new(0.5, 0.5, 0.3), point, 10.0, [8, 8]);
        let compensated = Settings { clip: Clip::Distance(clip), ..settings(32, 2) };
        let layers = render(ctx, &scene, camera, &compensated, 128);
        near("compensated", grey(&layers.direct) / PI64, 1.0, 0.01);
        let extreme = layers.direct.iter().map(|e| (e.x / PI - 1.0).abs()).fold(0.0, f32::max);
        println!("greatest deviation of a pixel {extreme}");
        assert!(extreme < 0.1, "a pixel deviates by {extreme}");
        let plain = Settings { compensation: Compensation::Off, ..compensated };
        let dark = render(ctx, &scene, camera, &plain, 32);
        let darkest = dark.direct.iter().map(|e| e.x / PI).fold(f32::INFINITY, f32::min);
        println!("darkest pixel without compensation {darkest}");
        assert!((0.48..0.6).contains(&darkest), "half of the light is cut off at an edge, here {darkest}");
    });
}

#[test]
fn the_original_estimator_keeps_the_energy_of_a_furnace() {
    gpu_test(|ctx| {
        let scene = builtin::furnace(0.5, 1.0);
        let camera = Camera { resolution: [16, 16], ..scene.camera.unwrap() };
        let layers = render(ctx, &scene, camera, &original(32, 4), 128);
        // Unclipped 1/d^2 has logarithmically growing variance at the edges.
        near("3 reflections", grey(&layers.color), series(0.5, 4), 0.015);
    });
}

/// Area of all triangles.
fn area(scene: &Scene) -> f64 {
    (0..scene.triangles.len()).map(|i| f64::from(scene.triangle_area(i))).sum()
}

/// Minimum distance of a facet's plane from the origin.
fn inradius(scene: &Scene) -> f64 {
    let plane = |i| {
        let [a, b, c] = scene.triangle_positions(i).map(|p| p.as_dvec3());
        (b - a).cross(c - a).normalize().dot(a).abs()
    };
    (0..scene.triangles.len()).map(plane).fold(f64::INFINITY, f64::min)
}

#[test]
fn a_sphere_with_point_lights_needs_one_path() {
    gpu_test(|ctx| {
        for n in [1, 4] {
            let scene = builtin::sphere_point_lights(n);
            let camera = Camera { resolution: [24, 24], fov_y: 90.0, ..scene.camera.unwrap() };
            let (surface, h) = (area(&scene), inradius(&scene));
            for depth in [2, 3, 5] {
                let mut renderer = renderer(ctx, &scene, camera, &original(1, depth));
                for _ in 0..48 {
                    renderer.pass().unwrap();
                }
                let layers = renderer.layers().unwrap();
                // Direct: a facet at distance h sees the centre at h < d < 1, E = pi cos / d^2 = pi h / d^3.
                for e in &layers.direct {
                    let e = f64::from(e.x) / PI64;
                    assert!((h - 1e-5..1.0 / (h * h) + 1e-5).contains(&e), "{e}");
                }
                // The light that a closed surface receives is exact, only its area is too small for 4 pi. A light does
                // not light its own facet, and lights those around it more: in view, that leaves 0.002 after 48 paths.
                let expected = (1.0 - 0.5f64.powi(depth as i32 - 1)) * 2.0 * TAU64 / surface;
                near(&format!("{n} lights, {} reflections", depth - 1), grey(&layers.color), expected, 0.004);
            }
        }
    });
}

#[test]
fn a_sphere_that_glows_needs_one_path() {
    gpu_test(|ctx| {
        let scene = builtin::sphere_enclosure(5, &[(0.5 * PI, 0.5); 8]);
        // The facets' area, as above, is the only difference from the ideal: their emission is less, their mean
        // irradiance not.
        for depth in [1, 2, 3, 5] {
            let layers = render(ctx, &scene, scene.camera.unwrap(), &original(1, depth), 16);
            let expected = 1.0 - 0.5f64.powi(depth as i32);
            let tolerance = if depth == 1 { 1e-6 } else { 0.004 };
            near(&format!("{} reflections", depth - 1), grey(&layers.color), expected, tolerance);
        }
    });
}

/// The kernel between two points of a sphere, cos cos' / d^2, is 1 / (4 r^2): each light lights every point equally, so
/// a pass is exact for its lights. This reveals a wrong weight, cosine or distance of any light.
#[test]
fn in_a_sphere_every_light_lights_every_point_alike() {
    gpu_test(|ctx| {
        let patches = [(1.0, 0.2), (0.0, 0.8), (2.0, 0.5), (0.0, 0.3), (0.5, 0.6), (0.0, 0.4), (0.0, 0.7), (3.0, 0.1)];
        let scene = builtin::sphere_enclosure(4, &patches);
        let camera = camera(Vec3::ZERO, Vec3::Z, 130.0, [16, 16]);
        for paths in [1, 2, 27] {
            let mut renderer = renderer(ctx, &scene, camera, &original(paths, 6));
            renderer.pass().unwrap();
            let layers = renderer.layers().unwrap();
            let (mut direct, mut indirect) = (0.0, 0.0);
            for light in renderer.lights().unwrap() {
                *(if light.f0[3] == 0.0 { &mut direct } else { &mut indirect }) += f64::from(light.emit[0]) / 4.0;
            }
            assert!(indirect > 0.0);
            // The facets tilt by up to 0.05; over 256 pixels that leaves 0.02 for a single light.
            near(&format!("direct, {paths} paths"), grey(&layers.direct), direct, 0.03);
            near(&format!("indirect, {paths} paths"), grey(&layers.indirect), indirect, 0.03);
        }
    });
}

#[test]
fn a_sphere_of_unequal_patches() {
    gpu_test(|ctx| {
        let patches = [(1.0, 0.2), (0.0, 0.8), (2.0, 0.5), (0.0, 0.3), (0.5, 0.6), (0.0, 0.4), (0.0, 0.7), (3.0, 0.1)];
        let scene = builtin::sphere_enclosure(4, &patches);
        let mean_exitance = patches.iter().map(|p| f64::from(p.0)).sum::<f64>() / 8.0;
        let mean_rho = patches.iter().map(|p| f64::from(p.1)).sum::<f64>() / 8.0;
        let resolution = [24, 24];
        let depth = 12;
        let mut seen = [0; 8];
        for target in [Vec3::Z, Vec3::NEG_Z] {
            let camera = camera(Vec3::ZERO, target, 130.0, resolution);
            let layers = render(ctx, &scene, camera, &original(256, depth), 16);
            let mut sums = [(0.0, 0); 8];
            for (i, color) in layers.color.iter().enumerate() {
                let (x, y) = ((i as u32 % resolution[0]) as f32 + 0.5, (i as u32 / resolution[0]) as f32 + 0.5);
                let d = eye_ray(&camera, resolution, x, y).direction;
                // Pixels that are entirely in one octant.
                if d.abs().min_element() > 0.12 {
                    let octant = usize::from(d.x < 0.0) | usize::from(d.y < 0.0) << 1 | usize::from(d.z < 0.0) << 2;
                    sums[octant].0 += f64::from(color.x);
                    sums[octant].1 += 1;
                }
            }
            for (octant, (sum, count)) in sums.into_iter().enumerate().filter(|(_, (_, count))| *count > 0) {
                // B_i = E_i + rho_i M (1 + r + ... ), M the mean exitance and r the mean reflectance; here to the 11th term.
                let (exitance, rho) = patches[octant];
                let expected = f64::from(exitance) + f64::from(rho) * mean_exitance * series(mean_rho, depth - 1);
                // Over seeds, the reflected part scatters by 0.012 with this many paths; facets leave 0.003.
                near(&format!("octant {octant}"), sum / f64::from(count) * PI64, expected, 0.035);
                seen[octant] += 1;
            }
        }
        assert!(seen.iter().all(|&n| n > 0), "{seen:?}");
    });
}

#[test]
fn facing_plates_exchange_their_form_factor() {
    gpu_test(|ctx| {
        let halton = [(0.5, 0.4152532836), (1.0, 0.1998248957), (2.0, 0.0685895888)].map(|c| (Sequence::Halton, c));
        let sobol = [(Sequence::Sobol, (0.5, 0.4152532836)), (Sequence::Sobol, (1.0, 0.1998248957))];
        for (sequence, (gap, expected)) in halton.into_iter().chain(sobol) {
            let scene = builtin::facing_plates(gap);
            // The surface fills the image, and its points project to pixels uniformly.
            let mut camera = scene.camera.unwrap();
            camera.fov_y = fov(0.5, gap - camera.eye.y);
            camera.resolution = [32, 32];
            let layers = render(ctx, &scene, camera, &Settings { sequence, ..settings(64, 2) }, 16);
            let coverage = layers.alpha.iter().map(|&a| f64::from(a)).sum::<f64>() / layers.alpha.len() as f64;
            assert!(coverage > 0.999, "{coverage}");
            // 1024 points on the emitter for each of 1024 pixels: 1e-3.
            near(&format!("{sequence:?}, gap {gap}"), grey(&layers.direct) / PI64 / coverage, expected, 0.002);
            assert_eq!(mean(&layers.indirect), DVec3::ZERO);
        }
    });
}

/// Irradiance from the front of a convex polygon of radiance 1, all of it above the horizon (Lambert).
fn polygon(point: Vec3, normal: Vec3, corners: &[Vec3]) -> f64 {
    let v: Vec<DVec3> = corners.iter().map(|c| (c.as_dvec3() - point.as_dvec3()).normalize()).collect();
    let edge = |i: usize| {
        let (a, b) = (v[i], v[(i + 1) % v.len()]);
        a.dot(b).clamp(-1.0, 1.0).acos() * a.cross(b).normalize().dot(normal.as_dvec3())
    };
    (0..v.len()).map(edge).sum::<f64>().abs() / 2.0
}

/// A floor at y = 0 below the parts added to it.
fn floor() -> Soup {
    let mut soup = Soup::new("floor");
    let white = soup.diffuse(0.5, 0.0);
    soup.quad(Vec3::new(-4.0, 0.0, -4.0), Vec3::Z * 8.0, Vec3::X * 8.0, white);
    soup
}

/// Direct irradiance at a point of the floor, seen obliquely from above; 8192 points on the emitters.
fn irradiance(ctx: &Context, scene: &Scene, point: Vec3) -> DVec3 {
    let camera = probe(point + Vec3::new(-1.5, 0.4, 1.1), point);
    let settings = Settings { lights_per_dispatch: 64, ..original(2048, 2) };
    mean(&render(ctx, scene, camera, &settings, 4).direct)
}

#[test]
fn irradiance_of_rectangles() {
    gpu_test(|ctx| {
        // Configuration factors of a rectangle to a small parallel element: over a corner, over the centre.
        for (low, size, factor) in [
            (Vec3::Y, 1.0, 0.1385316060),
            (Vec3::new(-0.5, 1.0, -0.5), 1.0, 0.2394564705),
            (Vec3::new(-1.0, 1.0, -1.0), 2.0, 0.5541264240),
        ] {
            let mut soup = floor();
            let lamp = soup.diffuse(0.0, [3.0, 1.0, 0.0]);
            soup.quad(low, Vec3::X * size, Vec3::Z * size, lamp);
            let e = irradiance(ctx, &soup.0, Vec3::ZERO);
            near("parallel", e.x, 3.0 * PI64 * factor, 0.002);
            near("its green", e.y, PI64 * factor, 0.002);
            assert_eq!(e.z, 0.0);
        }
        // A wall on the floor, of the same size and distance: C = (atan 1 - atan(1/sqrt 2) / sqrt 2) / (2 pi).
        let mut soup = floor();
        let lamp = soup.diffuse(0.0, 1.0);
        soup.quad(Vec3::X, Vec3::Z, Vec3::Y, lamp);
        let h = 0.5f64.sqrt();
        near("wall", irradiance(ctx, &soup.0, Vec3::ZERO).x, 0.5 * (PI64 / 4.0 - h * h.atan()), 0.002);
        // The back emits nothing, unless the face is two-sided.
        let mut soup = floor();
        let lamp = soup.diffuse(0.0, 1.0);
        let corners = [Vec3::Y, Vec3::new(0.0, 1.0, 1.0), Vec3::ONE, Vec3::new(1.0, 1.0, 0.0)];
        soup.quad(Vec3::Y, Vec3::Z, Vec3::X, lamp);
        assert_eq!(irradiance(ctx, &soup.0, Vec3::ZERO), DVec3::ZERO);
        soup.0.materials[lamp as usize].two_sided = true;
        let expected = polygon(Vec3::ZERO, Vec3::Y, &corners);
        // Each point emits to one side, chosen at random: three standard deviations of 8192 choices.
        near("two-sided", irradiance(ctx, &soup.0, Vec3::ZERO).x, expected, 3.0 / 8192f64.sqrt());
    });
}

#[test]
fn irradiance_of_the_lamp_of_the_cornell_box() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("unoccluded");
        let (white, lamp) = (soup.diffuse(0.5, 0.0), soup.diffuse(0.0, 1.0));
        soup.quad(Vec3::ZERO, Vec3::Z * 559.2, Vec3::X * 552.8, white);
        soup.quad(Vec3::new(213.0, 548.3, 227.0), Vec3::X * 130.0, Vec3::Z * 105.0, lamp);
        let point = Vec3::new(278.0, 0.0, 279.6);
        let settings = Settings { lights_per_dispatch: 64, ..original(512, 2) };
        let layers = render(ctx, &soup.0, probe(Vec3::new(278.0, 100.0, 100.0), point), &settings, 4);
        near("floor", grey(&layers.direct), 0.0447126712, 0.001);
        near("radiance", grey(&layers.color), 0.5 * 0.0447126712 / PI64, 0.001);
    });
}

#[test]
fn irradiance_of_a_sphere_and_a_disc() {
    gpu_test(|ctx| {
        // Sphere of radius r fully above the horizon: E = pi L (r / d)^2 cos.
        let mut soup = floor();
        let lamp = soup.diffuse(0.0, 2.0);
        soup.0.objects.push(String::from("lamp"));
        let (first, radius, center) = (soup.0.triangles.len(), 0.5, Vec3::new(0.0, 1.5, 0.0));
        soup.ball(center, radius, 48, lamp);
        soup.0.triangles[first..].iter_mut().for_each(|t| t.object = 1);
        let radiance = Vec3::splat(2.0);
        soup.0.lights.push(Light::Sphere { center, radius, radiance, inward: false, object: 1 });
        for x in [0.0f32, 1.0] {
            let d2 = f64::from(1.5 * 1.5 + x * x);
            let expected = PI64 * 2.0 * f64::from(radius * radius) / d2 * (1.5 / d2.sqrt());
            // Points start in front of the facets' corners, up to 1e-3 of the radius outside them.
            let e = irradiance(ctx, &soup.0, Vec3::new(x, 0.0, 0.0)).x;
            near(&format!("sphere at {x}"), e, expected, 0.005);
        }
        // Disc: E = pi L r^2 / (r^2 + h^2) on its axis, and at distance d from it
        // (pi L / 2) (1 - (d^2 + h^2 - r^2) / sqrt((d^2 + h^2 + r^2)^2 - 4 r^2 d^2)).
        let (r, h, n) = (0.7f32, 0.9f32, 64);
        let mut soup = floor();
        let lamp = soup.diffuse(0.0, 2.0);
        // A polygon with the area of the disc.
        let around = 2.0 * PI / n as f32;
        let corner = r * (around / around.sin()).sqrt();
        let rim = |i: u32| {
            let (sin, cos) = (around * i as f32).sin_cos();
            Vec3::new(corner * cos, h, corner * sin)
        };
        for i in 0..n {
            soup.triangle([Vec3::Y * h, rim(i), rim(i + 1)], None, [Vec2::ZERO; 3], lamp);
        }
        let (r, h) = (f64::from(r), f64::from(h));
        for d in [0.0f64, 0.5] {
            let root = ((d * d + h * h + r * r).powi(2) - 4.0 * r * r * d * d).sqrt();
            let expected = PI64 * (1.0 - (d * d + h * h - r * r) / root);
            let e = irradiance(ctx, &soup.0, Vec3::new(d as f32, 0.0, 0.0)).x;
            // 64 triangles share 8192 points: slices of 1/128 of a triangle's area, aligned alike in all of them.
            near(&format!("disc at {d}"), e, expected, 0.01);
        }
    });
}

#[test]
fn lights_without_area_follow_inverse_square_and_cosine() {
    gpu_test(|ctx| {
        // Each in its own channel.
        let mut soup = floor();
        let (position, axis) = (Vec3::new(0.3, 2.0, -0.2), Vec3::new(0.2, -1.0, 0.1).normalize());
        let (inner, outer) = (0.2f32, 0.7f32);
        let sun = Vec3::new(-0.5, -1.0, 0.3).normalize();
        soup.0.lights = vec![
            Light::Point { position, intensity: Vec3::X * 3.0 },
            Light::Spot { position, direction: axis, intensity: Vec3::Y * 5.0, inner, outer },
            Light::Directional { direction: sun, irradiance: Vec3::Z * 7.0 },
        ];
        let mut partly = 0;
        for (x, z) in [(0.3, -0.2), (0.9, 0.3), (-0.6, 0.4), (2.5, 1.0)] {
            let point = Vec3::new(x, 0.0, z);
            let e = irradiance(ctx, &soup.0, point);
            let to_point = (point - position).as_dvec3();
            let (d2, cos) = (to_point.length_squared(), -to_point.normalize().y);
            // Shadow rays start 6e-5 off the floor, the 65,536th part of the maximum coordinate.
            near("point", e.x, 3.0 * cos / d2, 2e-4);
            let along = to_point.normalize().dot(axis.as_dvec3());
            let (c_in, c_out) = (f64::from(inner).cos(), f64::from(outer).cos());
            let ramp = ((along - c_out) / (c_in - c_out)).clamp(0.0, 1.0);
            partly += u32::from(ramp > 0.0 && ramp < 1.0);
            near("spot", e.y + 1.0, 5.0 * ramp * ramp * cos / d2 + 1.0, 2e-4);
            near("sun", e.z, 7.0 * -f64::from(sun.y), 1e-4);
        }
        assert!(partly > 0, "a point lies in the spot's penumbra");
    });
}

#[test]
fn mean_irradiance_of_a_room_of_one_albedo() {
    gpu_test(|ctx| {
        // CIE 171:2006, case 5.8: a room of 4 m with a source of 10,000 lm at its centre; mean irradiance Phi / (S (1 -
        // rho)).
        for (rho, published) in [(0.05f32, 109.65), (0.3, 148.81), (0.5, 208.33)] {
            let mut soup = Soup::new("CIE 5.8");
            let wall = soup.diffuse(rho, 0.0);
            soup.room(Vec3::splat(-2.0), Vec3::splat(2.0), [wall; 6]);
            let intensity = Vec3::splat(10_000.0 / (4.0 * PI));
            soup.0.lights.push(Light::Point { position: Vec3::ZERO, intensity });
            // By symmetry one wall has the mean of all six; it fills the image evenly.
            let camera = camera(Vec3::ZERO, Vec3::Z, 90.0, [16, 16]);
            let depth = 12;
            let settings = Settings { lights_per_dispatch: 64, ..settings(512, depth) };
            let layers = render(ctx, &soup.0, camera, &settings, 16);
            let exact = 10_000.0 / 96.0 * series(f64::from(rho), depth - 1);
            assert!((exact / published - 1.0).abs() < 1e-3, "the series is cut off after 11 terms: {exact}");
            near(&format!("total, rho {rho}"), grey(&layers.direct) + grey(&layers.indirect), published, 0.01);
            near(&format!("direct, rho {rho}"), grey(&layers.direct), 10_000.0 / 96.0, 0.002);
        }
    });
}

#[test]
fn walls_absorb_what_lamps_emit() {
    gpu_test(|ctx| {
        // A cube with an emissive ceiling and different walls: the sum of (1 - rho) E A over them is the emitted power.
        let albedos = [0.1f32, 0.5, 0.3, 0.2, 0.4, 0.6];
        let mut soup = Soup::new("cube");
        let materials: Vec<u32> = (0..6).map(|i| soup.diffuse(albedos[i], if i == 3 { 1.0 } else { 0.0 })).collect();
        soup.room(Vec3::splat(-1.0), Vec3::ONE, materials.try_into().unwrap());
        let mut absorbed = 0.0;
        for (i, &rho) in albedos.iter().enumerate() {
            let target = Vec3::AXES[i / 2] * if i % 2 == 0 { -1.0 } else { 1.0 };
            let camera = camera(Vec3::ZERO, target, 90.0, [8, 8]);
            let layers = render(ctx, &soup.0, camera, &settings(512, 10), 32);
            absorbed += (1.0 - f64::from(rho)) * 4.0 * (grey(&layers.direct) + grey(&layers.indirect));
        }
        // After nine reflections at most 0.5^9 of the power is in flight. Over seeds, 1024 paths vary by 0.013; these
        // 16,384 by 0.003.
        near("absorbed", absorbed, PI64 * 4.0, 0.01);
    });
}

/// The scene, moved by `by`, as it comes from an OBJ file.
fn scene_from_file(folder: &std::path::Path, scene: &Scene, by: Vec3) -> Scene {
    let mut obj = String::from("mtllib a.mtl\n");
    for p in &scene.positions {
        let p = p.as_dvec3() + by.as_dvec3();
        obj += &format!("v {} {} {}\n", p.x, p.y, p.z);
    }
    for t in &scene.triangles {
        let [a, b, c] = t.vertices.map(|v| v + 1);
        obj += &format!("usemtl m{}\nf {a} {b} {c}\n", t.material);
    }
    let material = |(i, m): (usize, &Material)| {
        format!("newmtl m{i}\nKd {0} {0} {0}\nKe {1} {1} {1}\n", m.base_color.x, m.emission.x)
    };
    let mtl: String = scene.materials.iter().enumerate().map(material).collect();
    std::fs::write(folder.join("a.mtl"), mtl).unwrap();
    std::fs::write(folder.join("a.obj"), obj).unwrap();
    lightsum::scene::load(&folder.join("a.obj")).unwrap()
}

#[test]
fn no_light_passes_a_wall_without_thickness() {
    gpu_test(|ctx| {
        // A long room divided by one quad whose edges are in the other walls; the lamp is beyond it. Also far from the
        // origin, from a file: its coordinates are then relative to the room.
        let folder = tempfile::tempdir().unwrap();
        for corner in [Vec3::ZERO, Vec3::new(500.0, -300.0, 700.0)] {
            let mut soup = Soup::new("two rooms");
            let (wall, lamp) = (soup.diffuse(0.7, 0.0), soup.diffuse(0.0, 50.0));
            soup.room(Vec3::ZERO, Vec3::new(1.0, 1.0, 2.0), [wall; 6]);
            soup.quad(Vec3::Z, Vec3::X, Vec3::Y, wall);
            soup.quad(Vec3::new(0.25, 0.95, 1.25), Vec3::X * 0.5, Vec3::Z * 0.5, lamp);
            let scene = scene_from_file(folder.path(), &soup.0, corner);
            let corner = scene.from_world(corner.as_dvec3());
            let dark = camera(corner + Vec3::new(0.5, 0.5, 0.1), corner + Vec3::new(0.5, 0.45, 1.0), 90.0, [24, 24]);
            for settings in [settings(64, 5), original(64, 5)] {
                let layers = render(ctx, &scene, dark, &settings, 8);
                let lit = layers.color.iter().filter(|c| **c != Vec3::ZERO).count();
                println!("at {corner}: {lit} pixels are lit, mean {}", grey(&layers.color));
                assert_eq!(lit, 0, "light leaks at {corner}: mean {}", grey(&layers.color));
            }
            let bright = camera(corner + Vec3::new(0.5, 0.5, 1.9), corner + Vec3::new(0.5, 0.45, 1.0), 90.0, [8, 8]);
            assert!(grey(&render(ctx, &scene, bright, &settings(64, 5), 1).color) > 1.0);
        }
    });
}
