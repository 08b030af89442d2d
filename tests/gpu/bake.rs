//! Light kept in textures: texels against closed forms, and the frame that shows them against the one that computes all.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use lightsum::accel::{Bvh, Ray};
use lightsum::bake::{Bake, Lightmap, Options};
use lightsum::gpu::Context;
use lightsum::pass::{ShadingPoints, kept_light};
use lightsum::scene::{Camera, KeptFace, KeptLight, KeptPage, Light, Scene, builtin};
use lightsum::settings::{Clip, Compensation, Lookup, Settings};
use lightsum::standalone::Renderer;
use lightsum::view::Atlas;

use crate::rig::{Rig, close, gallery, has};
use crate::scenes::{Soup, renderer};
use crate::support::gpu_test;
use lightsum::conform::AWKWARD_IMAGES;

/// All lights at every point, without clipping.
pub fn plain() -> Settings {
    Settings { clip: Clip::Distance(0.0), compensation: Compensation::Off, ..Settings::plain() }
}

pub fn baked(ctx: &Context, scene: &Scene, settings: &Settings, options: Options, passes: u32) -> (Bake, Lightmap) {
    let bake = Bake::new(ctx, scene, settings.clone(), options).unwrap();
    let image = |i: usize| {
        let mut renderer = bake.renderer(i, None).unwrap();
        (0..passes).for_each(|_| renderer.pass().unwrap());
        renderer.layers().unwrap()
    };
    let images: Vec<_> = (0..bake.batches().len()).map(image).collect();
    let light = bake.finish(&images, passes).unwrap();
    (bake, light)
}

pub fn at_density(density: f32) -> Options {
    Options { density: Some(density), ..Options::default() }
}

/// Mean irradiance over the front of triangles.
fn mean(kept: &KeptLight, triangles: &[u32]) -> Vec3 {
    const N: usize = 60;
    let mut sum = Vec3::ZERO;
    for &triangle in triangles {
        for i in 0..N {
            for j in 0..N {
                let (s, t) = ((i as f32 + 0.5) / N as f32, (j as f32 + 0.5) / N as f32);
                // The unit square folded onto the triangle.
                let uv = if s + t > 1.0 { [1.0 - s, 1.0 - t] } else { [s, t] };
                let [direct, indirect] = kept.irradiance(triangle, false, uv);
                sum += direct + indirect;
            }
        }
    }
    sum / (triangles.len() * N * N) as f32
}

#[test]
fn unit_squares_have_their_form_factors() {
    gpu_test(|ctx| {
        let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
        // The emitter faces the floor from its edge, or from above.
        for (corner, u, v, factor) in [(Vec3::ZERO, y, z, 0.200_043_78), (y, x, z, 0.199_824_9)] {
            let mut soup = Soup::new("squares");
            let (grey, lamp) = (soup.diffuse(0.5, 0.0), soup.diffuse(0.0, 3.0));
            soup.quad(Vec3::ZERO, z, x, grey);
            soup.quad(corner, u, v, lamp);
            let scene = soup.0;
            // Texels on the common edge see the emitter so near that only gathered light tells its irradiance.
            let settings = Settings { particles: 64, max_depth: 2, pattern: [1, 1], ..Settings::default() };
            let (bake, light) = baked(ctx, &scene, &settings, at_density(48.0), 32);
            assert_eq!(bake.charts().faces.len(), 2, "the lamp reflects nothing, and the floor's back has no light");
            let found = mean(&light.kept(&scene), &[0, 1]) / (std::f32::consts::PI * 3.0);
            assert!((found / factor - 1.0).abs().max_element() < 2e-3, "{found} for {factor}");
        }
    });
}

#[test]
fn a_furnace_is_even() {
    gpu_test(|ctx| {
        let (rho, le) = (0.5, 2.0);
        let scene = builtin::furnace(rho, le);
        let settings = Settings { particles: 64, max_depth: 6, ..Settings::plain() };
        let size = scene.diagonal();
        let (_, light) = baked(ctx, &scene, &settings, at_density(24.0 / size), 16);
        let kept = light.kept(&scene);
        let all: Vec<u32> = (0..scene.triangles.len() as u32).collect();
        // Direct light and four reflections.
        let expected = std::f32::consts::PI * le * (1.0 - rho.powi(5)) / (1.0 - rho);
        let sides = |t: u32| if kept.faces[t as usize][0].is_some() { 0 } else { 1 };
        let of = |t: u32| {
            let [direct, indirect] = kept.irradiance(t, sides(t) == 1, [0.3, 0.3]);
            (direct + indirect).x / expected
        };
        let values: Vec<f32> = all.iter().map(|&t| of(t)).collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        assert!((mean - 1.0).abs() < 0.02, "{mean}");
        assert!(values.iter().all(|v| (v - 1.0).abs() < 0.15), "{values:?}");
    });
}

/// A room with a lamp and a block that stands on its floor; with a screen without thickness, if asked for.
pub fn room(screen: bool) -> Scene {
    let mut soup = Soup::new("room");
    let (white, red) = (soup.diffuse(0.7, 0.0), soup.diffuse([0.6, 0.2, 0.1], 0.0));
    let lamp = soup.diffuse(0.0, 12.0);
    soup.room(Vec3::ZERO, Vec3::new(3.0, 2.0, 3.0), [red, white, white, white, white, white]);
    soup.quad(Vec3::new(1.2, 1.99, 1.2), Vec3::X * 0.6, Vec3::Z * 0.6, lamp);
    // A block, seen from outside.
    let (low, size) = (Vec3::new(0.6, 0.0, 0.6), Vec3::new(0.8, 0.7, 0.8));
    for axis in 0..3 {
        let edge = |k: usize| Vec3::AXES[k] * size[k];
        let (u, v) = (edge((axis + 1) % 3), edge((axis + 2) % 3));
        soup.quad(low, v, u, white);
        soup.quad(low + edge(axis), u, v, white);
    }
    if screen {
        soup.quad(Vec3::new(2.0, 0.3, 1.0), Vec3::Y, Vec3::Z, red);
    }
    let mut scene = soup.0;
    scene.camera = Some(Camera {
        eye: Vec3::new(1.5, 1.2, 2.9),
        target: Vec3::new(1.4, 0.7, 0.8),
        up: Vec3::Y,
        fov_y: 70.0,
        resolution: [72, 54],
        aperture: 0.0,
        focus: None,
        shutter: 0.0,
        height: None,
        frustum: None,
    });
    scene
}

/// Relative error of an image: of its pixels but the worst 0.5 %, since pixels on edges show one surface or another.
pub fn error(image: &[Vec3], reference: &[Vec3]) -> f32 {
    let level = reference.iter().copied().sum::<Vec3>().element_sum() / (3 * reference.len()) as f32;
    let square = |(a, b): (&Vec3, &Vec3)| (*a - *b).length_squared() / (b.length_squared() + 0.03 * level * level);
    let mut squares: Vec<f32> = image.iter().zip(reference).map(square).collect();
    squares.sort_by(f32::total_cmp);
    squares.truncate(squares.len() * 995 / 1000);
    (squares.iter().sum::<f32>() / squares.len() as f32).sqrt()
}

#[test]
fn kept_light_shows_the_image_that_computes_all_of_it() {
    gpu_test(|ctx| {
        let mut scene = room(true);
        let camera = scene.camera.unwrap();
        // The same lights for pixels and texels: what differs is the texels' part.
        let settings = Settings { particles: 48, clip: Clip::Distance(0.4), ..plain() };
        const PASSES: u32 = 8;
        let image = |scene: &Scene| {
            let mut renderer = renderer(ctx, scene, camera, &settings);
            (0..PASSES).for_each(|_| renderer.pass().unwrap());
            (renderer.layers().unwrap(), renderer.statistics())
        };
        let (reference, _) = image(&scene);
        let mut errors = Vec::new();
        for density in [6.0, 12.0, 48.0] {
            scene.kept_light = None;
            let (bake, light) = baked(ctx, &scene, &settings, at_density(density), PASSES);
            assert!(light.inside > 0, "the floor below the block");
            let of_screen =
                bake.charts().faces.iter().filter(|f| f.triangle >= scene.triangles.len() as u32 - 2).count();
            assert_eq!(of_screen, 4, "both sides of the screen have charts");
            scene.kept_light = Some(Arc::new(light.kept(&scene)));
            let (kept, statistics) = image(&scene);
            assert_eq!(statistics.lights_per_pass, 0.0);
            errors.push(error(&kept.color, &reference.color));
        }
        assert!(errors[2] <= 0.02, "{errors:?}");
        // Shadows of single lights are steps, whose error falls with the root of a texel's width; elsewhere it falls faster.
        assert!(errors[1] < 0.75 * errors[0] && errors[2] < 0.6 * errors[1], "{errors:?}");
    });
}

#[test]
fn sides_that_only_many_reflections_reach_have_texels() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("winding corridor");
        let (grey, lamp) = (soup.diffuse(0.3, 0.0), soup.diffuse(0.0, 12.0));
        soup.room(Vec3::ZERO, Vec3::new(7.0, 1.0, 1.0), [grey; 6]);
        soup.quad(Vec3::new(0.2, 0.99, 0.2), Vec3::X * 0.4, Vec3::Z * 0.4, lamp);
        for i in 1..7 {
            let gap = if i % 2 == 0 { 0.15 } else { 0.0 };
            soup.quad(Vec3::new(i as f32, 0.0, gap), Vec3::Y, Vec3::Z * 0.85, grey);
        }
        // A block on the floor, without a bottom: from within it sees the floor, which is lit as a whole.
        let (low, [x, y, z]) = (Vec3::new(0.3, 0.0, 0.4), Vec3::AXES.map(|axis| axis * 0.3));
        for (corner, u, v) in [(low, z, y), (low + x, y, z), (low + y, z, x), (low, y, x), (low + z, x, y)] {
            soup.quad(corner, u, v, grey);
        }
        let bake = Bake::new(ctx, &soup.0, plain(), at_density(4.0)).unwrap();
        let mut sides: Vec<_> = bake.charts().faces.iter().map(|face| (face.triangle, face.back)).collect();
        sides.sort_unstable();
        sides.dedup();
        // The room's sides from within, both of each of the walls, and the block's from outside; not the room from outside.
        assert_eq!(sides.len(), 12 + 6 * 2 * 2 + 5 * 2, "{sides:?}");
        let block = soup.0.triangles.len() as u32 - 10;
        assert!(
            sides.iter().filter(|(triangle, _)| *triangle < 12 || *triangle >= block).all(|(_, back)| !back),
            "{sides:?}"
        );
    });
}

#[test]
fn blocks_that_choose_from_a_pool_have_less_error_and_no_less_light() {
    gpu_test(|ctx| {
        let scene = room(true);
        for compensation in [Compensation::Off, Compensation::Exact] {
            let indirect = |particles, light_pool| {
                let clip = Clip::Distance(0.4);
                let settings =
                    Settings { particles, light_pool, clip, compensation, direct_lights: Some(4), ..plain() };
                let light = baked(ctx, &scene, &settings, at_density(6.0), 16).1;
                light.pages.into_iter().flat_map(|page| page.indirect).map(Vec3::element_sum).collect::<Vec<_>>()
            };
            let reference = indirect(256, 0);
            let all = reference.iter().sum::<f32>();
            let of = |light: Vec<f32>| {
                let squares = light.iter().zip(&reference).map(|(a, b)| (a - b).powi(2)).sum::<f32>();
                ((squares * reference.len() as f32).sqrt() / all, light.iter().sum::<f32>() / all)
            };
            let ((alone, _), (pool, energy)) = (of(indirect(8, 0)), of(indirect(8, 256)));
            assert!(pool < 0.7 * alone, "{compensation:?}: {pool} without a pool {alone}");
            assert!((energy - 1.0).abs() < 0.02, "{compensation:?}: {energy}");
        }
    });
}

#[test]
fn points_that_move_follow_hard_shadows_better_than_centres() {
    gpu_test(|ctx| {
        // A point light beyond a square that hangs over the floor, turned against the texels.
        let mut soup = Soup::new("hard shadow");
        let white = soup.diffuse(0.7, 0.0);
        soup.quad(Vec3::ZERO, 4.0 * Vec3::Z, 4.0 * Vec3::X, white);
        let (u, v) = (Vec3::new(0.8, 0.0, 0.5), Vec3::new(-0.5, 0.0, 0.8));
        soup.quad(Vec3::new(1.9, 1.0, 1.3), v, u, white);
        let (light, intensity) = (Vec3::new(2.1, 4.0, 2.2), Vec3::splat(9.0));
        soup.0.lights.push(Light::Point { position: light, intensity });
        let scene = soup.0;
        let settings = Settings { particles: 1, max_depth: 2, ..plain() };
        const PASSES: u32 = 34;
        let (bake, moved) = baked(ctx, &scene, &settings, at_density(5.0), PASSES);
        let still: Vec<_> = bake
            .batches()
            .iter()
            .map(|batch| {
                let atlas = Atlas::new(batch.atlas.size, batch.atlas.texels.clone());
                let mut renderer =
                    Renderer::with_atlas(ctx.clone(), scene.clone(), Arc::new(atlas), settings.clone()).unwrap();
                (0..PASSES).for_each(|_| renderer.pass().unwrap());
                renderer.layers().unwrap()
            })
            .collect();
        let still = bake.finish(&still, PASSES).unwrap();
        let bvh = Bvh::build(&scene).unwrap();
        let error = |map: &Lightmap| {
            let kept = map.kept(&scene);
            let (mut sum, mut of) = (0.0, 0.0);
            const N: u32 = 200;
            for i in 0..N * N {
                let [s, t] = [i % N, i / N].map(|n| (n as f32 + 0.5) / N as f32);
                if s + t > 1.0 {
                    continue;
                }
                for triangle in [0, 1] {
                    let [a, b, c] = scene.triangle_positions(triangle);
                    let point = a + s * (b - a) + t * (c - a);
                    let to = light - point;
                    let seen = bvh.closest(&Ray::new(point + 1e-3 * Vec3::Y, to.normalize())).is_none();
                    let expected = if seen { intensity.x * to.y / to.length().powi(3) } else { 0.0 };
                    let [direct, _] = kept.irradiance(triangle as u32, false, [s, t]);
                    sum += (direct.x - expected).powi(2);
                    of += expected * expected;
                }
            }
            (sum / of).sqrt()
        };
        let [moved, still] = [error(&moved), error(&still)];
        assert!(moved < 0.95 * still && still < 0.3, "{moved} {still}");
    });
}

#[test]
fn a_frame_with_kept_light_costs_the_same_with_any_number_of_lights() {
    gpu_test(|ctx| {
        let mut rays = Vec::new();
        for lights in [1, 40] {
            let mut scene = room(true);
            let lamp =
                |i: u32| Light::Point { position: Vec3::new(0.5 + 0.05 * i as f32, 1.5, 1.0), intensity: Vec3::ONE };
            scene.lights.extend((0..lights).map(lamp));
            let corners = [Vec2::ONE, Vec2::new(2.0, 1.0), Vec2::new(1.0, 2.0)];
            let face = Some(KeptFace { page: 0, corners });
            let page = KeptPage { size: [3, 3], direct: vec![Vec3::ONE; 9], indirect: vec![Vec3::X; 9] };
            let faces = vec![[face; 2]; scene.triangles.len()];
            scene.kept_light = Some(Arc::new(KeptLight { faces, pages: vec![page] }));
            let camera = scene.camera.unwrap();
            let mut renderer = renderer(ctx, &scene, camera, &Settings::default());
            renderer.pass().unwrap();
            renderer.pass().unwrap();
            let layers = renderer.layers().unwrap();
            let [direct, indirect] = [&layers.direct, &layers.indirect].map(|e| e[72 * 27 + 36]);
            assert!(close(direct, Vec3::ONE, 1e-3, 0.0) && close(indirect, Vec3::X, 1e-3, 1e-6), "{direct} {indirect}");
            rays.push(renderer.statistics().rays);
        }
        assert_eq!(rays[0], rays[1]);
    });
}

/// A scene with random kept light on two pages; every fifth side has none.
pub fn with_light(mut scene: Scene) -> Scene {
    let random = |i: u32| (lightsum::sampling::random::hash(i) >> 8) as f32 / (1u32 << 24) as f32;
    let page = |size: [u32; 2], scale: f32| {
        let value = |i: u32| Vec3::new(random(3 * i), random(3 * i + 1), random(3 * i + 2)) * scale;
        let count = size[0] * size[1];
        KeptPage { size, direct: (0..count).map(value).collect(), indirect: (count..2 * count).map(value).collect() }
    };
    let pages = vec![page([7, 5], 3.0), page([1, 9], 2e5)];
    let side = |i: u32| {
        let page = i % 2;
        let size = pages[page as usize].size;
        let corner = |k: u32| Vec2::new(random(i * 7 + k) * size[0] as f32, random(i * 11 + k) * size[1] as f32);
        (i % 5 != 3).then(|| KeptFace { page, corners: [corner(0), corner(1), corner(2)] })
    };
    let faces = (0..scene.triangles.len() as u32).map(|i| [side(2 * i), side(2 * i + 1)]).collect();
    scene.kept_light = Some(Arc::new(KeptLight { faces, pages }));
    scene
}

#[test]
fn kept_light_follows_its_oracle() {
    gpu_test(|ctx| {
        let scene = with_light(gallery());
        let kept = scene.kept_light.clone().unwrap();
        for (size, lookup) in
            AWKWARD_IMAGES.into_iter().flat_map(|s| [Lookup::Bilinear, Lookup::Bicubic].map(|l| (s, l)))
        {
            let rig = Rig::new(ctx, &scene, size, Settings { lookup, ..Settings::plain() });
            let frame = rig.frame();
            rig.prefill(&[
                &frame.shade.lighting.direct,
                &frame.shade.lighting.indirect,
                &frame.shade.lighting.specular,
            ]);
            rig.run(|frame, rec| {
                frame.eye.record_first(rec)?;
                (0..frame.eye.steps()).try_for_each(|step| frame.eye.record_step(rec, step))?;
                frame.eye.record_points(rec)?;
                frame.kept_light.as_ref().unwrap().record(rec)
            });
            let (hits, directions) = (rig.vec4s(&frame.eye.rays.hits), rig.vec4s(&frame.eye.rays.direction));
            let wo = rig.vec4s(&frame.eye.points.wo);
            let lighting = &frame.shade.lighting;
            let (direct, indirect) = (rig.vec4s(&lighting.direct), rig.vec4s(&lighting.indirect));
            let mut compared = 0;
            for pixel in 0..(size[0] * size[1]) as usize {
                if !has(wo[pixel], ShadingPoints::HIT) {
                    continue;
                }
                compared += 1;
                let leaf = hits[pixel].w.to_bits();
                let back = rig.bvh().normal(leaf).dot(directions[pixel].truncate()) >= 0.0;
                let uv = [hits[pixel].y, hits[pixel].z];
                let expected = kept_light::reference(&kept, lookup, rig.bvh().scene_triangle(leaf), back, uv);
                let page = &kept.pages[kept.faces[rig.bvh().scene_triangle(leaf) as usize][usize::from(back)]
                    .map_or(0, |f| f.page as usize)];
                let scale = page.direct.iter().map(|e| e.max_element()).fold(0.0, f32::max);
                for (found, expected) in [(direct[pixel], expected[0]), (indirect[pixel], expected[1])] {
                    assert!(
                        close(found.truncate(), expected, 1e-3, 1e-3 * scale),
                        "{size:?}, {pixel}: {found} {expected}"
                    );
                }
            }
            assert!(compared > 0 || size == [1, 1], "{size:?}");
        }
    });
}

#[test]
fn seams_between_objects_have_no_steps() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("floor of two parts");
        let (grey, lamp) = (soup.diffuse(0.5, 0.0), soup.diffuse(0.0, 5.0));
        soup.quad(Vec3::ZERO, Vec3::Z, Vec3::X, grey);
        soup.quad(Vec3::X, Vec3::Z, Vec3::X, grey);
        soup.quad(Vec3::new(0.3, 0.8, 0.3), Vec3::X * 0.7, Vec3::Z * 0.4, lamp);
        let mut scene = soup.0;
        scene.objects.push(String::from("other part"));
        scene.triangles[2].object = 1;
        scene.triangles[3].object = 1;
        let settings = Settings { particles: 64, max_depth: 2, pattern: [1, 1], ..Settings::default() };
        let (bake, light) = baked(ctx, &scene, &settings, at_density(24.0), 8);
        assert_eq!(bake.charts().count, 2);
        let kept = light.kept(&scene);
        // Triangles of a quad: corner, u, u + v and corner, u + v, v; the seam is u + v to v of the first, corner to u of the second.
        assert_ne!(kept.irradiance(0, false, [0.3, 0.3])[0], Vec3::ZERO);
        let (mut step, mut slope) = (0.0f32, 0.0f32);
        for i in 0..=50 {
            let s = i as f32 / 50.0;
            // On the seam x = 1 at z = s, from both sides; and a texel further.
            let a = kept.irradiance(1, false, [s, 1.0 - s])[0];
            let b = kept.irradiance(2, false, [s, 0.0])[0];
            let inner = |h: f32| {
                // Point (1 - h, s) of the first quad, by z = u + v weights and x = v weights.
                let (x, z) = (1.0 - h, s);
                if z <= x { kept.irradiance(1, false, [z, x - z])[0] } else { kept.irradiance(0, false, [z - x, x])[0] }
            };
            let h = 1.0 / 24.0;
            slope = slope.max((inner(2.0 * h) - inner(3.0 * h)).abs().max_element());
            step = step.max((a - b).abs().max_element());
        }
        assert!(step <= slope, "a step of {step} where neighbouring texels differ by {slope}");
    });
}

#[test]
fn what_does_not_fit_is_refused_with_a_density_that_would() {
    gpu_test(|ctx| {
        let scene = room(true);
        let refused = |options: Options| Bake::new(ctx, &scene, plain(), options).err().unwrap().to_string();
        for density in [1e5, 400.0] {
            let message = refused(Options { density: Some(density), max_size: 256, ..Options::default() });
            let fits: f32 = message.split("charts; ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
            assert!(fits < density && message.contains("--density"), "{message}");
        }
        assert!(refused(Options { max_size: 9000, ..Options::default() }).contains("--max-size"));
        assert!(refused(Options { padding: 0, ..Options::default() }).contains("--padding"));
        assert!(refused(at_density(f32::NAN)).contains("--density"));
        let mut dark = builtin::single_triangle_light();
        dark.materials.iter_mut().for_each(|m| m.base_color = Vec3::ZERO);
        let message = Bake::new(ctx, &dark, plain(), Options::default()).err().unwrap().to_string();
        assert!(message.contains("nothing to bake"), "{message}");
    });
}
