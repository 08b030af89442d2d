//! Curved reflectors: mirror images and kernels against their oracles, and whole images against the path tracer.

use std::f32::consts::{PI, TAU};

use glam::{DVec2, Vec2, Vec3, Vec4};
use lightsum::gpu::Context;
use lightsum::pass::curvature::{bend_at, image_distance};
use lightsum::pass::mirror_image::{self, curved_reference};
use lightsum::scene::{Camera, Material, Scene, Surface};
use lightsum::settings::{Compensation, Settings, Superposition};
use lightsum::superposition::kernels::VIEW_ANGLES;

use crate::renderer::path_traced;
use crate::rig::{Rig, STRAYS, Tally, hit_of};
use crate::scenes::{self, Soup, camera, compare, render};
use crate::support::gpu_test;
use lightsum::conform::AWKWARD_IMAGES;

const METAL: Vec3 = Vec3::new(0.9, 0.8, 0.7);

/// Polished metal that is to mirror the room.
fn metal(roughness: f32) -> Material {
    Material { base_color: METAL, metallic: 1.0, roughness, reflector: Some(true), ..Material::default() }
}

/// A closed surface over two angles, each in `n` steps of the turn, of points and normals.
fn wrapped(soup: &mut Soup, n: u32, material: u32, at: impl Fn(f32, f32) -> (Vec3, Vec3)) {
    let corner = |i: u32, j: u32| at(TAU * i as f32 / n as f32, TAU * j as f32 / n as f32);
    for i in 0..n {
        for j in 0..n {
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            for face in [[a, b, c], [a, c, d]] {
                soup.triangle(face.map(|(p, _)| p), Some(face.map(|(_, n)| n)), [Vec2::ZERO; 3], material);
            }
        }
    }
}

/// A torus about the y axis through `center`.
fn torus(soup: &mut Soup, center: Vec3, [ring, tube]: [f32; 2], n: u32, material: u32) {
    wrapped(soup, n, material, |a, b| {
        let out = Vec3::new(a.cos(), 0.0, -a.sin());
        let normal = out * b.cos() + Vec3::Y * b.sin();
        (center + out * ring + normal * tube, normal)
    });
}

/// The lowest part of a sphere, seen from inside.
fn bowl(soup: &mut Soup, center: Vec3, r: f32, n: i32, material: u32) {
    let at = |i: i32, j: i32| {
        let out = Vec3::new(0.25 * i as f32 / n as f32, -1.0, 0.25 * j as f32 / n as f32).normalize();
        (center + r * out, -out)
    };
    for (i, j) in (-n..n).flat_map(|i| (-n..n).map(move |j| (i, j))) {
        let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
        for face in [[a, b, c], [a, c, d]] {
            soup.triangle(face.map(|(p, _)| p), Some(face.map(|(_, n)| n)), [Vec2::ZERO; 3], material);
        }
    }
}

/// A rounded block like the body of a car, |x/a|^4 + |y/b|^4 + |z/c|^4 = 1.
fn block(soup: &mut Soup, center: Vec3, half: Vec3, n: u32, material: u32) {
    let root = |x: f32| x.signum() * x.abs().sqrt();
    let at = |i: u32, j: u32| {
        let (theta, phi) = (PI * i as f32 / n as f32, TAU * j as f32 / (2 * n) as f32);
        let direction = Vec3::new(theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin());
        let on = Vec3::from_array(direction.to_array().map(root));
        let on = on / on.to_array().map(|x| x.powi(4)).iter().sum::<f32>().powf(0.25);
        (center + half * on, (Vec3::from_array(on.to_array().map(|x| x.powi(3))) / half).normalize())
    };
    for i in 0..n {
        for j in 0..2 * n {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            let faces = [(i + 1 < n).then_some([a, b, c]), (i > 0).then_some([a, c, d])];
            for face in faces.into_iter().flatten() {
                soup.triangle(face.map(|(p, _)| p), Some(face.map(|(_, n)| n)), [Vec2::ZERO; 3], material);
            }
        }
    }
}

/// A room whose walls glow in squares of two colours.
fn glowing_room(low: Vec3, high: Vec3, squares: u32) -> Soup {
    let mut soup = Soup::new("chequered room");
    let colours = [[0.2, 0.25, 0.6], [1.2, 1.0, 0.6], [0.5, 0.1, 0.1], [1.0, 1.1, 1.3]];
    let glow = colours.map(|colour| soup.diffuse(0.0, colour));
    let (size, n) = (high - low, squares as f32);
    for axis in 0..3 {
        let edge = |k: usize| Vec3::AXES[k] * size[k] / n;
        let (u, v) = (edge((axis + 1) % 3), edge((axis + 2) % 3));
        let across = Vec3::AXES[axis] * size[axis];
        for (i, j) in (0..squares).flat_map(|i| (0..squares).map(move |j| (i, j))) {
            let corner = low + u * i as f32 + v * j as f32;
            let colour = glow[((i + j) % 2 + 2 * u32::from(axis == 1)) as usize];
            soup.quad(corner, u, v, colour);
            soup.quad(corner + across, v, u, colour);
        }
    }
    soup
}

/// A ball in such a room.
fn ball(material: Material, resolution: [u32; 2]) -> (Scene, Camera) {
    let mut soup = glowing_room(Vec3::new(-3.0, -1.5, -3.0), Vec3::new(3.0, 3.0, 5.0), 6);
    let material = soup.material(material);
    soup.ball(Vec3::new(0.1, 0.0, 0.0), 1.0, 48, material);
    (soup.0, camera(Vec3::new(0.3, 0.8, 3.4), Vec3::new(0.1, 0.0, 0.0), 42.0, resolution))
}

/// Only what the walls emit, by paths of `depth` segments.
fn settings(superposition: Option<Superposition>, depth: u32) -> Settings {
    Settings { superposition, compensation: Compensation::Off, ..scenes::settings(1, depth) }
}

/// Where an image shows something other than the walls, by its normals.
fn on_object(image: &[Vec3], normals: &[Vec3]) -> Vec<Vec3> {
    image.iter().zip(normals).filter(|(_, n)| n.abs().max_element() < 0.9999).map(|(c, _)| *c).collect()
}

#[test]
fn curved_mirror_images_follow_their_oracle() {
    gpu_test(|ctx| {
        let mut soup = glowing_room(Vec3::new(-3.0, -1.5, -3.0), Vec3::new(3.0, 3.0, 5.0), 4);
        let shiny = soup.material(metal(0.35));
        soup.ball(Vec3::new(0.9, 0.3, 0.4), 0.8, 16, shiny);
        torus(&mut soup, Vec3::new(-0.8, 0.1, 0.3), [0.7, 0.3], 24, shiny);
        // Seen from within its radius of curvature.
        bowl(&mut soup, Vec3::new(0.3, 9.0, 2.6), 9.9, 10, shiny);
        soup.0.camera = Some(camera(Vec3::new(0.2, 0.9, 3.3), Vec3::new(0.0, 0.1, 0.3), 55.0, [8, 8]));
        let scene = soup.0;
        let (mut bent, mut plain, mut exchanged, mut left_out) = (0, 0, 0, 0);
        for resolution in AWKWARD_IMAGES {
            let rig = Rig::new(ctx, &scene, resolution, settings(Some(Superposition::default()), 2));
            let frame = rig.frame();
            rig.run(|frame, rec| frame.eye.record_first(rec));
            let hits = rig.vec4s(&frame.eye.rays.hits);
            let rays = rig.vec4s(&frame.eye.rays.direction);
            rig.light();
            let through = rig.vec4s(&frame.eye.paths.throughput);
            let region = rig.get::<u32>(&frame.eye.planes.region);
            let extras = rig.vec4s(&frame.eye.planes.extras);
            let mirrors = frame.glossy_planes.as_ref().unwrap();
            rig.run(|_, rec| mirrors.record_image(rec));
            let image = [&mirrors.image.source, &mirrors.image.footprint, &mirrors.image.core_footprint];
            let [source, tail, core] = image.map(|b| rig.vec4s(b));
            let tables: Vec<[u32; 4]> = rig.get(&rig.engine.device_scene().tables().unwrap().reflectors);
            let mut tally = Tally::new(format!("curved mirror image, {resolution:?}"));
            for i in 0..region.len() {
                let (d, cos_view) = (rays[i].truncate(), rays[i].w);
                let found = hit_of(hits[i]).map(|hit| (rig.plane(&hit), hit)).filter(|(number, _)| *number > 0);
                let Some((number, hit)) = found else {
                    assert_eq!(region[i], 0, "pixel {i} shows a wall");
                    continue;
                };
                let bend = bend_at(&scene, rig.bvh(), &hit, d, crate::rig::xyz(rig.parameters.right));
                tally.check(region[i] == if bend.mild { number } else { 0 }, || format!("{i}: {} {bend:?}", region[i]));
                if region[i] == 0 {
                    left_out += 1;
                    continue;
                }
                bent += 1;
                // The device's normals have 16 bits in each coordinate.
                let [power, seen] = [extras[2 * i], extras[2 * i + 1]];
                let size = bend.power[0].abs() + bend.power[2].abs() + 0.1;
                let off = bend.power.iter().zip(power.truncate().to_array()).map(|(a, b)| (a - f64::from(b)).abs());
                tally.check(off.fold(0.0, f64::max) < 0.01 * size, || format!("{i}: {power} for {bend:?}"));
                tally.check((power.w - bend.mu).abs() < 1e-3 && seen.w == hit.t, || format!("{i}: {power} {seen}"));

                // From here on with the device's own values.
                let (at, end) = (through[i].w, through[i + region.len()].w);
                let lobe = rig.library().look_up(number - 1, power.w).unwrap();
                let of_plane = [(lobe.tan_beta, at)];
                let axis = Vec2::new(seen.x, seen.y);
                let (diameter, flat) = mirror_image::reference(&rig.parameters, d, bend.normal, &of_plane, Some(end));
                tally.check((axis - flat).length() < 5e-3 || power.w > 0.999, || format!("{i}: {axis} for {flat}"));
                let nearness = 1.0 - f64::from(at) / f64::from(end);
                let [g0, g1, g2] = [power.x, power.y, power.z].map(f64::from);
                let z = f64::from(end - at) / f64::from(cos_view);
                let image = image_distance(z, 0.5 * (g0 + g2));
                let depth = f64::from(at) + f64::from(cos_view) * image;
                let virtual_depth = f64::from(source[i].w);
                tally.check(image < 0.0 || (virtual_depth / depth - 1.0).abs() < 2e-3, || {
                    format!("{i}: {virtual_depth} for {depth}")
                });

                let textures = tables[number as usize - 1][3] & 0xfff;
                let angle = (power.w * VIEW_ANGLES as f32 - 1.0).clamp(0.0, VIEW_ANGLES as f32 - 1.0) + 0.5;
                for (part, first, times, foot) in [
                    (&lobe.nearest.tail, textures, 1.0, tail[i]),
                    (&lobe.nearest.core, textures + 2 * VIEW_ANGLES as u32, 0.3, core[i]),
                ] {
                    let of = |aspect: f64| {
                        let diameter = times * f64::from(diameter);
                        curved_reference(diameter, aspect, [g0, g1, g2], f64::from(hit.t), nearness)
                    };
                    let found = Vec2::new(foot.z, foot.w);
                    let steps = (4.0 * found.length().log2()).round() as u32;
                    let mean = f64::from(foot.x) / (f64::from(steps) / 8.0).exp2();
                    // Rounding decides where the ratio of the axes lies between two steps.
                    let aspect = f64::from(part.aspect());
                    let near = [1.0, 0.995, 1.005].map(|f| of(aspect * f));
                    let matches = near.iter().find(|e| e.steps == steps);
                    let say = || format!("{i}: {foot} for {:?}, axis {axis}", near[0]);
                    tally.check(matches.is_some(), say);
                    let Some(expected) = matches else { continue };
                    let area = expected.diameter / (f64::from(expected.steps) / 8.0).exp2();
                    tally.check((mean / area - 1.0).abs() < 0.01, say);
                    let across = Vec2::new(-axis.y, axis.x);
                    let DVec2 { x, y } = expected.axis;
                    let along = axis * x as f32 + across * y as f32;
                    let diagonal = expected.axis.abs().min_element() > 0.65;
                    let agrees = found.normalize().dot(along) > 0.99;
                    tally.check(agrees || diagonal || steps <= 1, say);
                    let layer = match expected.exchanged {
                        false => first + angle as u32,
                        true => first + 2 * VIEW_ANGLES as u32 - 1 - angle as u32,
                    };
                    let near_edge = angle.fract() < 0.01 || angle.fract() > 0.99;
                    tally.check(foot.y == layer as f32 || near_edge || diagonal, || format!("{} {layer}", say()));
                    *(if expected.exchanged { &mut exchanged } else { &mut plain }) += 1;
                }
            }
            tally.finish(2.0 * STRAYS);
        }
        println!("{bent} pixels, {plain} kernels along, {exchanged} across, {left_out} too concave");
        assert!(bent > 300 && plain > 50 && exchanged > 300 && left_out > 20);
    });
}

/// The narrowest lobe on a ball is an ideal mirror with the same normals.
#[test]
fn a_curved_surface_that_hardly_spreads_is_a_mirror() {
    gpu_test(|ctx| {
        let superposition = Some(Superposition::default());
        let (mirror, camera) = ball(Material { surface: Surface::Mirror, ..metal(0.0) }, [48, 36]);
        let (glossy, _) = ball(metal(0.03), [48, 36]);
        assert!(glossy.reflectors().len() == 1 && glossy.reflectors()[0].curved);
        let expected = render(ctx, &mirror, camera, &settings(superposition, 2), 8);
        let found = render(ctx, &glossy, camera, &settings(superposition, 2), 8);
        let (energy, error) = compare(&found.color, &expected.color);
        println!("as a mirror: energy {energy:.4}, error {error:.4}");
        assert!((energy - 1.0).abs() < 0.01 && error < 0.05, "{energy} {error}");
    });
}

/// Passes of an image.
const PASSES: u32 = 9;

/// Images of an object: by superposition and along its lobe, of some passes each, and the path tracer's.
fn shown(ctx: &Context, scene: &Scene, view: Camera, depth: u32) -> [Vec<Vec3>; 3] {
    let images = [Some(Superposition::default()), None].map(|s| render(ctx, scene, view, &settings(s, depth), PASSES));
    let normals = &images[1].normal;
    let reference = on_object(&path_traced(scene, &view, 512, depth), normals);
    let [spread, followed] = images.each_ref().map(|image| on_object(&image.color, normals));
    assert!(reference.len() > 200, "{} pixels", reference.len());
    [spread, followed, reference]
}

#[test]
fn balls_reflect_as_much_as_the_path_tracer_says() {
    gpu_test(|ctx| {
        for (roughness, off, greatest) in [(0.1, 0.02, 0.16), (0.2, 0.02, 0.14), (0.3, 0.02, 0.1)] {
            let (scene, view) = ball(metal(roughness), [48, 36]);
            let [spread, followed, reference] = shown(ctx, &scene, view, 2);
            let (found, paths) = (compare(&spread, &reference), compare(&followed, &reference));
            println!("roughness {roughness}: {found:.4?}, eye paths {paths:.4?} of {} pixels", spread.len());
            assert!((found.0 - 1.0).abs() < off && found.1 < greatest, "{roughness}: {found:?}");
        }
    });
}

#[test]
fn rings_and_bodies_reflect_as_much_as_the_path_tracer_says() {
    gpu_test(|ctx| {
        for body in [false, true] {
            let mut soup = glowing_room(Vec3::new(-3.0, -1.5, -3.0), Vec3::new(3.0, 3.0, 5.0), 6);
            let shiny = soup.material(metal(0.25));
            if body {
                block(&mut soup, Vec3::new(0.0, -0.1, 0.0), Vec3::new(1.4, 0.6, 0.8), 24, shiny);
            } else {
                torus(&mut soup, Vec3::ZERO, [1.0, 0.45], 48, shiny);
            }
            let view = camera(Vec3::new(1.2, 1.7, 3.1), Vec3::ZERO, 42.0, [48, 36]);
            let [spread, followed, reference] = shown(ctx, &soup.0, view, 4);
            let (found, paths) = (compare(&spread, &reference), compare(&followed, &reference));
            println!("body {body}: {found:.4?}, eye paths {paths:.4?} of {} pixels", spread.len());
            assert!((found.0 - 1.0).abs() < 0.05 && found.1 < 0.2, "{body}: {found:?}");
        }
    });
}

/// Where a flat floor is a reflector as well, its mirror image keeps its bits.
#[test]
fn planes_keep_their_mirror_image_beside_a_curved_one() {
    gpu_test(|ctx| {
        let superposition = Some(Superposition::default());
        let images = [None, Some(true)].map(|reflector| {
            let mut soup = glowing_room(Vec3::new(-3.0, -1.5, -3.0), Vec3::new(3.0, 3.0, 5.0), 4);
            let floor = soup.material(Material { reflector: None, ..metal(0.2) });
            let shiny = soup.material(Material { reflector, roughness: 0.8, ..metal(0.8) });
            soup.quad(Vec3::new(-2.0, -1.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, floor);
            soup.ball(Vec3::new(0.0, 0.2, -1.0), 0.5, 12, shiny);
            let view = camera(Vec3::new(0.3, 0.8, 3.4), Vec3::ZERO, 42.0, [40, 30]);
            assert_eq!(soup.0.reflectors().len(), if reflector.is_some() { 2 } else { 1 });
            soup.0.camera = Some(view);
            let rig = Rig::new(ctx, &soup.0, [40, 30], settings(superposition, 2));
            rig.light();
            let mirrors = rig.frame().glossy_planes.as_ref().unwrap();
            rig.run(|_, rec| mirrors.record_image(rec));
            let region = rig.get::<u32>(&rig.frame().eye.planes.region);
            let image = [&mirrors.image.source, &mirrors.image.footprint, &mirrors.image.core_footprint];
            let image = image.map(|b| rig.vec4s(b));
            let of_floor = (0..region.len()).filter(|&i| region[i] == 1);
            of_floor.map(|i| image.each_ref().map(|buffer| buffer[i])).collect::<Vec<[Vec4; 3]>>()
        });
        assert!(images[0].len() > 100 && images[0] == images[1], "{} pixels", images[0].len());
    });
}
