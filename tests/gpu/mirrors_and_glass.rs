//! Mirrors and glass in view: against the path tracer, against closed forms, and layer by layer.

use glam::Vec3;
use lightsum::accel::Bvh;
use lightsum::gpu::Context;
use lightsum::light::emitters::Emitters;
use lightsum::path_trace::{self, Options, SpecularPaths};
use lightsum::scene::{Camera, Light, Material, Surface};
use lightsum::settings::{Reflectance, Settings, Traversal};

use crate::renderer::{agrees, bits, path_traced};
use crate::rig::gallery;
use crate::scenes::{Soup, camera, compare, mean, probe, render, settings};
use crate::support::gpu_test;

/// A mirror over a base of colour `base`.
fn mirror(base: impl Into<Vec3>, specular: impl Into<Vec3>) -> Material {
    let (base_color, specular) = (base.into(), specular.into());
    Material { surface: Surface::Mirror, base_color, specular, ..Material::default() }
}

fn glass(ior: f32, thin: bool) -> Material {
    Material { surface: Surface::Glass, base_color: Vec3::new(0.9, 1.0, 0.95), ior, thin, ..Material::default() }
}

/// The faces of a box seen from outside.
fn block(soup: &mut Soup, low: Vec3, high: Vec3, material: u32) {
    let first = soup.0.triangles.len();
    soup.room(low, high, [material; 6]);
    soup.0.triangles[first..].iter_mut().for_each(|t| t.vertices.swap(1, 2));
}

/// A room of coloured walls and a camera that sees most of it. No lamp is visible, not even in mirrors: the row of
/// pixels at its edge would measure the number of passes that hit it, and little else.
///
/// The lamp is a point, or an area: the path tracer does not find a point over mirrors and glass, as particles do.
fn furnished(name: &str, lamp: Lamp, furnish: impl FnOnce(&mut Soup)) -> (Soup, Camera) {
    let mut soup = Soup::new(name);
    let walls = [[0.6, 0.1, 0.1], [0.1, 0.5, 0.2], [0.5, 0.5, 0.4], [0.6, 0.6, 0.6], [0.2, 0.3, 0.6], [0.6, 0.6, 0.5]];
    let walls = walls.map(|albedo| soup.diffuse(albedo, 0.0));
    soup.room(Vec3::ZERO, Vec3::new(2.0, 1.5, 2.0), walls);
    match lamp {
        Lamp::Point => {
            let (position, intensity) = (Vec3::new(1.0, 1.3, 0.6), Vec3::new(3.0, 2.8, 2.2));
            soup.0.lights.push(Light::Point { position, intensity });
        }
        Lamp::Area => {
            let lamp = soup.diffuse(0.0, [12.0, 11.0, 9.0]);
            soup.quad(Vec3::new(0.75, 1.4, 0.35), Vec3::X * 0.5, Vec3::Z * 0.5, lamp);
        }
    }
    furnish(&mut soup);
    (soup, camera(Vec3::new(1.0, 0.9, 0.05), Vec3::new(1.0, 0.4, 1.5), 75.0, [32, 24]))
}

#[derive(Clone, Copy)]
enum Lamp {
    Point,
    Area,
}

/// Direct light of a point and global light of an area, where random choices add noise: with four times the passes the
/// errors are half as large, down to that of the reference.
fn agrees_through_glass(ctx: &Context, room: impl Fn(Lamp) -> (Soup, Camera)) {
    // Light that converges behind a ball of glass: 8,192 particles leave an error of 0.07 to 0.17 over seeds.
    agrees_in(ctx, room, [(0.004, 0.1), (0.012, 0.1)], 1024);
}

/// The same with bounds for the energy and the relative RMSE, of direct and of global light, and passes for the latter.
fn agrees_in(
    ctx: &Context,
    room: impl Fn(Lamp) -> (Soup, Camera),
    [direct_bounds, global_bounds]: [(f64, f64); 2],
    passes: u32,
) {
    let (Soup(scene), camera) = room(Lamp::Point);
    let direct = render(ctx, &scene, camera, &settings(1, 2), 256);
    agrees("direct light", &direct.color, &path_traced(&scene, &camera, 1024, 2), direct_bounds.0, direct_bounds.1);
    // With 8192 particles the energy varies by 0.004 over seeds.
    let (Soup(scene), camera) = room(Lamp::Area);
    let global = render(ctx, &scene, camera, &settings(32, 5), passes);
    agrees("global light", &global.color, &path_traced(&scene, &camera, 4096, 5), global_bounds.0, global_bounds.1);
}

#[test]
fn a_slab_and_a_ball_of_glass_against_the_path_tracer() {
    gpu_test(|ctx| {
        let room = |lamp| {
            furnished("glass", lamp, |soup: &mut Soup| {
                let (ball, slab) = (soup.material(glass(1.5, false)), soup.material(glass(1.8, false)));
                soup.ball(Vec3::new(0.65, 0.45, 1.2), 0.4, 24, ball);
                block(soup, Vec3::new(1.1, 0.0, 0.9), Vec3::new(1.7, 0.8, 1.1), slab);
            })
        };
        agrees_through_glass(ctx, room);
    });
}

#[test]
fn a_corner_of_mirrors_against_the_path_tracer() {
    gpu_test(|ctx| {
        let room = |lamp| {
            furnished("mirrors", lamp, |soup: &mut Soup| {
                let silver = soup.material(mirror(Vec3::ZERO, [0.9, 0.85, 0.8]));
                // Upright, at right angles, facing the camera; a red block is in front of them.
                let edge = Vec3::new(1.0, 0.05, 1.9);
                soup.quad(edge, Vec3::new(-0.8, 0.0, -0.8), Vec3::Y * 1.2, silver);
                soup.quad(edge, Vec3::Y * 1.2, Vec3::new(0.8, 0.0, -0.8), silver);
                let block_material = soup.diffuse([0.7, 0.2, 0.1], 0.0);
                block(soup, Vec3::new(0.9, 0.0, 1.2), Vec3::new(1.1, 0.5, 1.4), block_material);
            })
        };
        agrees_in(ctx, room, [(0.003, 0.03), (0.01, 0.06)], 256);
    });
}

#[test]
fn varnish_and_panes_against_the_path_tracer() {
    gpu_test(|ctx| {
        let room = |lamp| {
            furnished("varnish", lamp, |soup: &mut Soup| {
                let varnish = soup.material(mirror([0.4, 0.25, 0.1], [0.1; 3]));
                let pane = soup.material(glass(1.5, true));
                soup.quad(Vec3::new(0.1, 0.02, 0.5), Vec3::Z * 1.3, Vec3::X * 1.8, varnish);
                soup.quad(Vec3::new(0.2, 0.1, 1.0), Vec3::Y * 0.9, Vec3::new(0.7, 0.0, 0.3), pane);
                let metal = soup.material(Material { metallic: 1.0, ..mirror([0.9, 0.6, 0.3], Vec3::ZERO) });
                soup.ball(Vec3::new(1.4, 0.4, 1.3), 0.3, 16, metal);
            })
        };
        agrees_through_glass(ctx, room);
    });
}

/// Lamps of radiance 1 in front of and 3 behind the eye, which looks along z from the origin.
fn lamps() -> Soup {
    let mut soup = Soup::new("lamps");
    let (front, back) = (soup.diffuse(0.0, 1.0), soup.diffuse(0.0, 3.0));
    soup.quad(Vec3::new(-9.0, -9.0, 5.0), Vec3::Y * 18.0, Vec3::X * 18.0, front);
    soup.quad(Vec3::new(-9.0, -9.0, -5.0), Vec3::X * 18.0, Vec3::Y * 18.0, back);
    soup
}

/// Mean of an image of small field of view that sees only emitters.
fn glance(ctx: &Context, soup: &Soup, target: Vec3, settings: Settings, passes: u32) -> Vec3 {
    let camera = camera(Vec3::ZERO, target, 1.0, [16, 16]);
    mean(&render(ctx, &soup.0, camera, &Settings { max_depth: 1, ..settings }, passes).color).as_vec3()
}

#[test]
fn what_glass_lets_through_and_reflects() {
    gpu_test(|ctx| {
        let with = |split: bool| Settings { split, max_specular: 16, ..settings(1, 1) };
        for thin in [true, false] {
            let mut soup = lamps();
            let glass = soup.material(Material { base_color: Vec3::ONE, ..glass(1.5, thin) });
            let low = Vec3::new(-2.0, -2.0, 1.0);
            if thin {
                soup.quad(low, Vec3::X * 4.0, Vec3::Y * 4.0, glass);
            } else {
                block(&mut soup, low, Vec3::new(2.0, 2.0, 1.1), glass);
            }
            // R = 0.04 at each face: 2 R / (1 + R) is reflected, the rest transmitted.
            let expected = (0.96 + 3.0 * 0.08) / 1.04;
            for (split, tolerance) in [(true, if thin { 1e-5 } else { 0.006 }), (false, 0.01)] {
                // 65,536 choices of 1 or 3, one in 25 for the rarer: a standard deviation of 0.0015, more without a
                // split.
                let found = glance(ctx, &soup, Vec3::Z, with(split), 256).x;
                println!("thin {thin}, split {split}: {found} for {expected}");
                assert!((found - expected).abs() < tolerance, "thin {thin}, split {split}: {found} for {expected}");
            }
        }
        // Water over glass without a gap: 1 / (1 + sum of r / (1 - r)) over the three faces passes.
        let mut soup = lamps();
        soup.0.materials[1].emission = Vec3::splat(1e-3);
        let bodies = [(1.5, 1.0, 2.0), (1.33, 1.9, 3.0)];
        for (ior, from, to) in bodies {
            let material = soup.material(Material { base_color: Vec3::ONE, ..glass(ior, false) });
            block(&mut soup, Vec3::new(-2.0, -2.0, from), Vec3::new(2.0, 2.0, to), material);
        }
        let r = |a: f32, b: f32| ((a - b) / (a + b)).powi(2);
        let lost: f32 = [r(1.0, 1.5), r(1.5, 1.33), r(1.33, 1.0)].map(|r| r / (1.0 - r)).iter().sum();
        let found = glance(ctx, &soup, Vec3::Z, with(true), 256).x;
        println!("water over glass: {found} for {}", 1.0 / (1.0 + lost));
        assert!((found - 1.0 / (1.0 + lost)).abs() < 0.004, "{found}");
    });
}

#[test]
fn a_corner_of_mirrors_sends_light_back() {
    gpu_test(|ctx| {
        let k = 0.9f32;
        let mut soup = Soup::new("corner");
        let silver = soup.material(mirror(Vec3::ZERO, [k; 3]));
        for axis in 0..3 {
            let (u, v) = (Vec3::AXES[(axis + 1) % 3], Vec3::AXES[(axis + 2) % 3]);
            soup.quad(Vec3::splat(-4.0), u * 8.0, v * 8.0, silver);
        }
        // From the eye at the origin into the corner at (-4, -4, -4); the lamp behind the eye is seen in the
        // reflection.
        let lamp = soup.diffuse(0.0, 2.0);
        soup.0.materials[lamp as usize].two_sided = true;
        let d = Vec3::new(-1.0, -1.1, -1.2).normalize();
        let (u, v) = d.any_orthonormal_pair();
        soup.quad(-d * 2.0 - 2.0 * (u + v), u * 4.0, v * 4.0, lamp);
        // Mirrors of 0.9 reflect 0.9 + 0.1 (1 - cos)^5 at an angle.
        let all: f32 = d.abs().to_array().iter().map(|cos| k + (1.0 - k) * (1.0 - cos).powi(5)).product();
        for (max_specular, expected) in [(8, 2.0 * all), (3, 2.0 * all), (2, 0.0)] {
            let found = glance(ctx, &soup, d, Settings { max_specular, ..settings(1, 1) }, 2).x;
            assert!((found - expected).abs() < 1e-3 * all, "{max_specular} mirrors: {found} for {expected}");
        }
    });
}

#[test]
fn split_paths_have_the_same_limit_and_less_noise() {
    gpu_test(|ctx| {
        let (soup, camera) = furnished("varnish", Lamp::Point, |soup| {
            let varnish = soup.material(mirror([0.3, 0.2, 0.1], [0.3; 3]));
            soup.quad(Vec3::new(0.1, 0.02, 0.5), Vec3::Z * 1.3, Vec3::X * 1.8, varnish);
            let pane = soup.material(glass(3.0, true));
            soup.quad(Vec3::new(0.2, 0.1, 1.0), Vec3::Y * 0.9, Vec3::new(0.7, 0.0, 0.3), pane);
        });
        let reference = path_traced(&soup.0, &camera, 1024, 2);
        let image = |split: bool, passes: u32| {
            render(ctx, &soup.0, camera, &Settings { split, ..settings(32, 2) }, passes).color
        };
        // One choice in each pass: its noise falls with the square root of the number of passes.
        agrees("one component at random", &image(false, 256), &reference, 0.005, 0.06);
        agrees("both components", &image(true, 256), &reference, 0.003, 0.05);
        let error = |split: bool| compare(&image(split, 8), &reference).1;
        let (one, both) = (error(false), error(true));
        println!("after 8 passes: {one} with a choice, {both} with a split");
        assert!(both < 0.7 * one, "{both} and {one}");
    });
}

#[test]
fn the_same_seed_gives_the_same_bits_through_glass() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = Camera { resolution: [31, 17], ..scene.camera.unwrap() };
        for traversal in [Traversal::Single, Traversal::Auto] {
            let base = Settings { traversal, ..settings(16, 4) };
            let image = |settings: Settings| bits(&render(ctx, &scene, camera, &settings, 3));
            let first = image(base.clone());
            assert!(image(base.clone()) == first, "a second renderer");
            assert!(image(Settings { rounds: 9, ..base.clone() }) == first, "nine rounds");
            assert!(image(Settings { lights_per_dispatch: 1, ..base.clone() }) == first, "a light a dispatch");
            assert!(image(Settings { split: false, ..base.clone() }) != first, "no split");
            assert!(image(Settings { max_specular: 1, ..base.clone() }) != first, "less deep");
            assert!(image(Settings { seed: 1, ..base }) != first, "another seed");
        }
    });
}

#[test]
fn layers_show_what_is_seen() {
    gpu_test(|ctx| {
        // A mirror on the left, a pane on the right, two units in front of the eye; behind both a wall, five units
        // away, and a wall behind the eye, three units away.
        let mut soup = Soup::new("layers");
        let (wall, back) = (soup.diffuse([0.5, 0.4, 0.3], 0.0), soup.diffuse([0.2, 0.3, 0.4], 0.0));
        soup.quad(Vec3::new(-9.0, -9.0, 5.0), Vec3::Y * 18.0, Vec3::X * 18.0, wall);
        soup.quad(Vec3::new(-9.0, -9.0, -3.0), Vec3::X * 18.0, Vec3::Y * 18.0, back);
        let lamp = soup.diffuse(0.0, 5.0);
        soup.quad(Vec3::new(-1.0, 6.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0, lamp);
        let silver = soup.material(mirror(Vec3::ZERO, [0.9, 0.8, 0.7]));
        let pane = soup.material(Material { base_color: Vec3::new(1.0, 0.5, 1.0), ..glass(1.5, true) });
        // Looking along z with y up, x runs to the left.
        soup.quad(Vec3::new(0.0, -3.0, 2.0), Vec3::Y * 6.0, Vec3::X * 3.0, silver);
        soup.quad(Vec3::new(-3.0, -3.0, 2.0), Vec3::Y * 6.0, Vec3::X * 3.0, pane);
        let camera = camera(Vec3::ZERO, Vec3::Z, 30.0, [16, 8]);
        let layers = render(ctx, &soup.0, camera, &settings(16, 3), 4);
        let expect = |x: usize, albedo: Vec3, normal: Vec3, depth: f32| {
            let i = 4 * 16 + x;
            let found = (layers.albedo[i], layers.normal[i], layers.depth[i], layers.alpha[i]);
            let same = (found.0 - albedo).abs().max_element() < 5e-3
                && (found.1 - normal).length() < 1e-3
                && (found.2 - depth).abs() < 1e-3
                && found.3 == 1.0;
            assert!(same, "pixel {x}: {found:?}");
            // The pixel's radiance is albedo times irradiance; for the pane plus its reflection.
            let through = layers.albedo[i] * (layers.direct[i] + layers.indirect[i]) / std::f32::consts::PI;
            let rest = layers.color[i] - through;
            let share = rest.max_element() / through.max_element();
            assert!(if x < 8 { share.abs() < 1e-3 } else { (0.01..0.3).contains(&share) }, "pixel {x}: {share}");
        };
        // The image of the back wall is seven units away: two to the mirror and five beyond.
        expect(4, Vec3::new(0.9, 0.8, 0.7) * Vec3::new(0.2, 0.3, 0.4), Vec3::Z, 7.0);
        expect(11, Vec3::new(1.0, 0.5, 1.0) * Vec3::new(0.5, 0.4, 0.3) * (0.96 / 1.04), Vec3::NEG_Z, 5.0);
        // A mirror that reflects the background still covers its pixels, at its own depth.
        let second = soup.0.triangles.split_off(4);
        soup.0.triangles.truncate(2);
        soup.0.triangles.extend(second);
        let layers = render(ctx, &soup.0, camera, &settings(16, 3), 1);
        let i = 4 * 16 + 4;
        assert_eq!((layers.alpha[i], layers.color[i], layers.normal[i]), (1.0, Vec3::ZERO, Vec3::ZERO));
        assert!((layers.depth[i] - 2.0).abs() < 1e-4, "{}", layers.depth[i]);
    });
}

/// A ball of clear glass, a mirror that reflects everything, or both, in a room whose walls emit 0.8 and reflect 0.2: everything is 1.
#[test]
fn glass_and_mirrors_in_a_furnace_are_invisible() {
    gpu_test(|ctx| {
        let center = Vec3::new(0.8, 0.8, 1.1);
        for (what, ball, panel) in [("glass", true, false), ("a mirror", false, true), ("both", true, true)] {
            let mut soup = Soup::new("furnace");
            let wall = soup.diffuse(0.2, 0.8);
            soup.room(Vec3::ZERO, Vec3::splat(2.0), [wall; 6]);
            if ball {
                let glass = soup.material(Material { base_color: Vec3::ONE, ..glass(1.5, false) });
                soup.ball(center, 0.35, 24, glass);
            }
            if panel {
                let mirror = soup.material(mirror(Vec3::ZERO, Vec3::ONE));
                soup.quad(Vec3::new(1.3, 0.3, 1.7), Vec3::new(0.4, 0.0, -0.4), Vec3::Y, mirror);
            }
            let camera = camera(Vec3::new(1.0, 1.0, 0.1), Vec3::new(1.0, 0.9, 1.5), 70.0, [48, 48]);
            let forward = (camera.target - camera.eye).normalize();
            let (right, half) = (forward.cross(Vec3::Y).normalize(), 35f32.to_radians().tan());
            let shows_ball = |pixel: &u32| {
                let [x, y] = [pixel % 48, pixel / 48].map(|i| half * ((i as f32 + 0.5) / 24.0 - 1.0));
                let d = (forward + x * right - y * right.cross(forward)).normalize();
                let to = center - camera.eye;
                to.distance(to.dot(d) * d) < 0.33
            };
            // Paths of 16 segments: glass takes two, and what is cut off is below 0.2^6.
            let of = |settings: Settings| Settings { max_depth: 16, max_specular: 16, ..settings };
            for (preset, settings) in [
                ("default", Settings::default()),
                ("interactive", Settings::interactive()),
                ("one lit point for four pixels", Settings { shading_rate: 2, ..Settings::default() }),
            ] {
                // As many lit points.
                let rate = settings.shading_rate;
                let camera = Camera { resolution: [48 * rate; 2], ..camera };
                let layers = render(ctx, &soup.0, camera, &of(settings), 24);
                let grey = |pixels: &[Vec3]| mean(pixels).element_sum() / 3.0;
                let pixels = (0..48 * 48).filter(shows_ball).map(|i| rate * (i % 48) + rate * rate * 48 * (i / 48));
                let of_ball: Vec<Vec3> = pixels.map(|i| layers.color[i as usize]).collect();
                let (all, inside) = (grey(&layers.color), if ball { grey(&of_ball) } else { 1.0 });
                println!("{what}, {preset}: {all:.4}, the ball {inside:.4}");
                assert!((all - 1.0).abs() < 0.005 && (inside - 1.0).abs() < 0.005, "{what}, {preset}: {all}, {inside}");
            }
        }
    });
}

#[test]
fn a_mirror_reflects_by_the_equations_that_are_asked_for() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("mirror");
        let floor = soup.material(mirror(Vec3::ZERO, Vec3::splat(0.04)));
        soup.quad(Vec3::new(-9.0, 0.0, -9.0), Vec3::Z * 18.0, Vec3::X * 18.0, floor);
        let sky = soup.diffuse(0.0, 2.0);
        soup.quad(Vec3::new(-9.0, 2.0, -9.0), Vec3::X * 18.0, Vec3::Z * 18.0, sky);
        // At 60 degrees of incidence.
        let view = probe(Vec3::new(3f32.sqrt(), 1.0, 0.0), Vec3::ZERO);
        let schlick = 0.04 + 0.96 / 32.0;
        for (reflectance, expected) in
            [(Reflectance::Schlick, schlick), (Reflectance::Map, 0.0892), (Reflectance::Fresnel, 0.0892)]
        {
            let settings = Settings { reflectance, ..settings(1, 2) };
            let found = mean(&render(ctx, &soup.0, view, &settings, 1).color).x;
            assert!((found - 2.0 * expected).abs() < 2e-4, "{reflectance:?}: {found}");
            let options = Options {
                resolution: [1, 1],
                samples: 4,
                max_depth: 2,
                max_specular: 4,
                seed: 1,
                specular_paths: SpecularPaths::All,
                reflectance,
            };
            let traced = path_trace::render(
                &soup.0,
                &Bvh::build(&soup.0).unwrap(),
                &Emitters::of(&soup.0, true).unwrap(),
                &view,
                &options,
                |_| true,
            );
            let traced = f64::from(traced.unwrap()[0].x);
            assert!((traced - 2.0 * expected).abs() < 2e-4, "{reflectance:?}: {traced} by the path tracer");
        }
    });
}
