//! Guarantees of the discontinuity buffer: it preserves constants and energy, and keeps edges
//! and textures sharp.

use glam::Vec3;
use lightsum::gpu::Context;
use lightsum::pass::discontinuity::{Guide, agree};
use lightsum::scene::{Light, Material, Scene, Texture, Wrap};
use lightsum::settings::{Agreement, Filter, Settings};
use lightsum::stage::Stage;

use crate::rig::{Builder, Rig, close, gallery};
use crate::scenes::{Soup, camera, render};
use crate::support::gpu_test;

use lightsum::conform::checks::discontinuity::{filtered, filtered_with, filters, guides, random};

/// The visible shading points of a scene in its first pass.
fn seen<'a>(ctx: &'a Context, scene: &'a Scene, size: [u32; 2], pattern: [u32; 2]) -> Rig<'a> {
    let rig = Rig::new(ctx, scene, size, Settings { particles: 1, pattern, ..Settings::plain() });
    rig.run(|frame, rec| frame.eye.record(rec));
    rig
}

#[test]
fn constants_and_the_sum_of_irradiance_stay() {
    gpu_test(|ctx| {
        let scene = gallery();
        for (filter, pattern) in filters() {
            let rig = seen(ctx, &scene, [61, 43], pattern);
            let guides = guides(&rig, filter.agreement);
            let constant = vec![Vec3::new(0.3, 7.0, 1e-3); guides.len()];
            let noise = random(guides.len());
            let [_, even] = filtered(ctx, &rig, filter, [&noise, &constant]);
            let [_, spread] = filtered(ctx, &rig, filter, [&constant, &noise]);
            let takes_part = |i: &usize| guides[*i].extent > 0.0;
            let live: Vec<usize> = (0..guides.len()).filter(takes_part).collect();
            assert!(live.iter().all(|&i| even[i] == constant[i]), "{filter:?}: a constant changes");
            let sum = |all: &[Vec3]| live.iter().map(|&i| all[i].as_dvec3()).sum::<glam::DVec3>();
            let ratio = sum(&spread) / sum(&noise);
            let changed = live.iter().filter(|&&i| (spread[i] - noise[i]).length() > 1e-3).count();
            assert!(3 * changed > live.len(), "{filter:?}: {changed} of {} change", live.len());
            if filter.agreement == Agreement::Plane {
                assert!((ratio - 1.0).abs().max_element() < 1e-6, "{filter:?}: the sum becomes {ratio} of what it was");
            }
        }
    });
}

#[test]
fn constants_and_sums_stay_around_sparse_windows() {
    gpu_test(|ctx| {
        let scene = gallery();
        for (filter, pattern) in filters().into_iter().filter(|(filter, _)| filter.has_sparse()) {
            let rig = seen(ctx, &scene, [61, 43], pattern);
            let guides = guides(&rig, filter.agreement);
            let constant = vec![Vec3::new(0.3, 7.0, 1e-3); guides.len()];
            let noise: Vec<Vec3> =
                random(guides.len()).into_iter().map(|e| e * if e.x > 0.9 { 40.0 } else { 1.0 }).collect();
            let given = [&noise[..], &noise[..]];
            let (before, after) = (filtered(ctx, &rig, filter, given), filtered_with(ctx, &rig, filter, given, true));
            let even = filtered_with(ctx, &rig, filter, [&constant, &constant], true);
            let live: Vec<usize> = (0..guides.len()).filter(|&i| guides[i].extent > 0.0).collect();
            for kind in 0..2 {
                assert!(live.iter().all(|&i| even[kind][i] == constant[i]), "{filter:?}: a constant changes");
                let sum = |all: &[Vec3]| live.iter().map(|&i| all[i].as_dvec3()).sum::<glam::DVec3>();
                let ratio = sum(&after[kind]) / sum(&before[kind]);
                assert!((ratio - 1.0).abs().max_element() < 1e-6, "{filter:?}: the sum becomes {ratio} of what it was");
            }
            let roughness = |all: &[Vec3]| {
                let mean = live.iter().map(|&i| all[i]).sum::<Vec3>() / live.len() as f32;
                live.iter().map(|&i| (all[i] - mean).length_squared()).sum::<f32>()
            };
            assert!(roughness(&after[1]) < 0.9 * roughness(&before[1]), "{filter:?}: indirect light is no smoother");
        }
    });
}

/// Where all pixels agree, each gets the same weight from every class of the pattern: with a constant for each class
/// only the mean of all shows.
#[test]
fn a_pattern_vanishes_on_a_plane() {
    gpu_test(|ctx| {
        let mut b = Builder::default();
        let grey = b.material(Material::default());
        b.quad(Vec3::new(-9.0, 0.0, -9.0), Vec3::Z * 18.0, Vec3::X * 18.0, grey, 1.0);
        b.0.lights.push(Light::Point { position: Vec3::Y, intensity: Vec3::ONE });
        let scene = b.finish(Vec3::new(0.0, 2.0, -0.5), Vec3::ZERO);
        let size = [40, 31];
        for pattern in [[2, 2], [3, 3], [4, 3], [5, 2], [8, 7]] {
            for more in [0, 2] {
                let window = Filter::default().window(pattern).map(|n| (n + more).min(Filter::MAX_WINDOW));
                let filter = Filter { window: Some(window), ..Filter::default() };
                let rig = seen(ctx, &scene, size, pattern);
                let class = |i: u32| i % size[0] % pattern[0] + i / size[0] % pattern[1] * pattern[0];
                let classes = random((pattern[0] * pattern[1]) as usize);
                let irradiance: Vec<Vec3> = (0..size[0] * size[1]).map(|i| classes[class(i) as usize]).collect();
                let [found, _] = filtered(ctx, &rig, filter, [&irradiance, &irradiance]);
                let mean = classes.iter().sum::<Vec3>() / classes.len() as f32;
                let [rx, ry] = window.map(|n| n / 2);
                for y in ry..size[1] - ry {
                    for x in rx..size[0] - rx {
                        let e = found[(x + y * size[0]) as usize];
                        assert!(close(e, mean, 1e-5, 0.0), "{filter:?}, {pattern:?}, {x} {y}: {e} for {mean}");
                    }
                }
            }
        }
    });
}

#[test]
fn edges_of_a_cube_stay_sharp() {
    gpu_test(|ctx| {
        let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
        let mut b = Builder::default();
        let grey = b.material(Material::default());
        b.quad(Vec3::new(-1.0, 1.0, -1.0), z * 2.0, x * 2.0, grey, 1.0);
        b.quad(Vec3::new(-1.0, -1.0, -1.0), y * 2.0, x * 2.0, grey, 1.0);
        b.quad(Vec3::new(1.0, -1.0, -1.0), y * 2.0, z * 2.0, grey, 1.0);
        b.0.lights.push(Light::Point { position: Vec3::new(3.0, 5.0, -4.0), intensity: Vec3::ONE });
        let scene = b.finish(Vec3::new(2.4, 2.2, -2.6), Vec3::ZERO);
        for (filter, pattern) in filters() {
            let rig = seen(ctx, &scene, [61, 43], pattern);
            let normals: Vec<Vec3> =
                rig.vec4s(&rig.frame().eye.points.geometric).iter().map(|n| n.truncate()).collect();
            let guides = guides(&rig, filter.agreement);
            let live: Vec<usize> = (0..guides.len()).filter(|&i| guides[i].extent > 0.0).collect();
            let face: Vec<Vec3> = normals.iter().map(|n| n.abs() * Vec3::new(1.0, 2.0, 4.0)).collect();
            for axis in Vec3::AXES {
                let count = live.iter().filter(|&&i| normals[i].dot(axis).abs() > 0.9).count();
                assert!(count > 100, "{count} pixels show the face {axis}");
            }
            let [_, found] = filtered(ctx, &rig, filter, [&face, &face]);
            assert!(live.iter().all(|&i| found[i] == face[i]), "{filter:?}: faces mix");
        }
    });
}

/// A sheet slightly above the floor, which the paper's test cannot distinguish from it.
#[test]
fn offset_planes_stay_apart() {
    gpu_test(|ctx| {
        let mut b = Builder::default();
        let grey = b.material(Material::default());
        b.quad(Vec3::new(-9.0, 0.0, -9.0), Vec3::Z * 18.0, Vec3::X * 18.0, grey, 1.0);
        b.quad(Vec3::new(0.0, 0.02, -9.0), Vec3::Z * 18.0, Vec3::X * 9.0, grey, 1.0);
        b.0.lights.push(Light::Point { position: Vec3::Y * 2.0, intensity: Vec3::ONE });
        let scene = b.finish(Vec3::new(0.0, 3.0, -1.0), Vec3::ZERO);
        let rig = seen(ctx, &scene, [61, 43], [1, 1]);
        let height: Vec<Vec3> = rig
            .vec4s(&rig.frame().eye.points.position)
            .iter()
            .map(|p| if p.y > 0.01 { Vec3::ONE } else { Vec3::ZERO })
            .collect();
        let mixed = |agreement| {
            let [found, _] = filtered(ctx, &rig, Filter { agreement, ..Filter::default() }, [&height, &height]);
            found.iter().zip(&height).filter(|(a, b)| a != b).count()
        };
        assert_eq!(mixed(Agreement::Plane), 0);
        assert!(mixed(Agreement::DepthAndNormal) >= 43, "the paper's test is better than it was");
    });
}

/// Neighbours on a ball, which recedes from the eye towards its silhouette.
#[test]
fn curved_surfaces_agree() {
    gpu_test(|ctx| {
        let mut b = Builder::default();
        let grey = b.material(Material::default());
        b.sphere(Vec3::ZERO, 1.0, 3, grey, false);
        b.0.lights.push(Light::Point { position: Vec3::new(1.0, 3.0, -3.0), intensity: Vec3::ONE });
        let scene = b.finish(Vec3::new(0.0, 0.0, -2.5), Vec3::ZERO);
        let rig = seen(ctx, &scene, [61, 43], [1, 1]);
        let share = |agreement| {
            let guides = guides(&rig, agreement);
            let pairs: Vec<(&Guide, &Guide)> = (0..guides.len() - 1)
                .filter(|i| i % 61 != 60)
                .map(|i| (&guides[i], &guides[i + 1]))
                .filter(|(a, b)| a.extent.min(b.extent) > 0.0)
                .collect();
            let agreeing = pairs.iter().filter(|(a, b)| agree(&rig.parameters, agreement, a, b, 1.0)).count();
            agreeing as f64 / pairs.len() as f64
        };
        let [plane, paper] = [share(Agreement::Plane), share(Agreement::DepthAndNormal)];
        println!("neighbours on a ball that agree: {plane:.3} by planes, {paper:.3} by distances");
        assert!(plane > 0.93 && plane > paper, "{plane} by planes, {paper} by distances");
    });
}

#[test]
fn textures_stay_sharp() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("textured plane");
        let texels = (0..64 * 64).map(|i| if (i + i / 64) % 2 == 0 { [255; 4] } else { [60, 90, 120, 255] });
        soup.0.textures.push(Texture {
            name: String::from("chequers"),
            width: 64,
            height: 64,
            texels: texels.collect(),
            srgb: false,
            wrap: [Wrap::Repeat; 2],
        });
        let cloth =
            soup.material(Material { base_texture: Some(0), base_color: Vec3::splat(0.8), ..Material::default() });
        let lamp = soup.diffuse(0.0, 5.0);
        soup.quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, cloth);
        soup.quad(Vec3::new(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z, lamp);
        let view = camera(Vec3::new(0.0, 1.5, -0.4), Vec3::ZERO, 40.0, [48, 40]);
        // One particle: four points on the lamp leave steps hardly larger than the changes along the plane.
        let settings = Settings { particles: 1, pattern: [3, 3], ..Settings::plain() };
        let plain = render(ctx, &soup.0, view, &settings, 1);
        let filter = Some(Filter::default());
        let smooth = render(ctx, &soup.0, view, &Settings { filter, ..settings }, 1);
        assert!(plain.albedo == smooth.albedo, "the reflectance is filtered");
        assert!(plain.direct != smooth.direct, "the irradiance is not filtered");
        let steps =
            |layer: &[Vec3]| -> f32 { layer.windows(2).map(|w| (w[1].x - w[0].x).abs() / w[0].x.max(1e-6)).sum() };
        let (contrast, noise) = (steps(&smooth.albedo), [steps(&plain.direct), steps(&smooth.direct)]);
        assert!(noise[1] < 0.5 * noise[0], "steps of irradiance fall only from {} to {}", noise[0], noise[1]);
        assert!(contrast > 5.0 * noise[1], "contrast {contrast} beside {}", noise[1]);
        for i in 0..smooth.color.len() {
            let expected = smooth.albedo[i] / std::f32::consts::PI * (smooth.direct[i] + smooth.indirect[i]);
            assert!(close(smooth.color[i], expected, 1e-3, 1e-6), "pixel {i}: {} for {expected}", smooth.color[i]);
        }
    });
}

/// Filtered passes add up like any others, and without the filter the image is unfiltered.
#[test]
fn filtered_passes_accumulate() {
    gpu_test(|ctx| {
        let scene = gallery();
        let view = lightsum::scene::Camera { resolution: [31, 17], ..scene.camera.unwrap() };
        let plain = Settings { particles: 2, pattern: [2, 2], ..Settings::plain() };
        let settings = Settings { filter: Some(Filter::default()), ..plain.clone() };
        let [one, three] = [1, 3].map(|passes| render(ctx, &scene, view, &settings, passes));
        let again = render(ctx, &scene, view, &settings, 3);
        assert!(three.color == again.color && three.indirect == again.indirect, "the same settings give other bits");
        assert!(one.color != three.color && three.color.iter().all(|c| c.is_finite()));
        let rig = Rig::new(ctx, &scene, [8, 8], plain);
        assert!(rig.frame().discontinuity.is_none());
    });
}
