//! Mirrors and glass.

use super::{Build, OPTIONS, along, expect, polygon_irradiance};
use glam::Vec3;
use lightsum::accel::{Bvh, Ray};
use lightsum::light::emitters::Emitters;
use lightsum::path_trace::{Options, Rng, SpecularPaths, Tracer};
use lightsum::scene::{Material, Surface};

#[test]
fn glass_leaves_a_furnace_alone() {
    let mut b = Build::default();
    let wall = b.material(0.0, 1.0);
    b.cuboid(Vec3::splat(-2.0), Vec3::splat(2.0), true, wall);
    let glass = b.glass(1.5);
    b.cuboid(Vec3::new(-1.0, -1.0, -0.05), Vec3::new(1.0, 1.0, 0.05), false, glass);
    // Light with more reflections in the pane than 16 segments permit is missing: at most some 0.1 per cent at this
    // angle.
    for direction in [Vec3::new(0.0, 0.0, 1.0), Vec3::new(0.3, 0.2, 1.0), Vec3::new(0.0, 1.0, 1.2)] {
        expect(&b.0, (-direction, direction), 16, 4000, 1.0, 1e-3);
    }
    // A pane transmits (1 - R) / (1 + R); the light is only in front of the eye.
    let mut b = Build::default();
    let lamp = b.material(0.0, 1.0);
    b.quad(Vec3::new(-1.0, -1.0, 2.0), Vec3::Y * 2.0, Vec3::X * 2.0, lamp);
    let glass = b.glass(1.5);
    b.cuboid(Vec3::new(-1.0, -1.0, -0.05), Vec3::new(1.0, 1.0, 0.05), false, glass);
    expect(&b.0, (Vec3::new(0.1, 0.2, -2.0), Vec3::Z), 16, 100_000, 0.96 / 1.04, 0.0);
}

#[test]
fn mirrors_show_and_light() {
    let (k, emitted, albedo) = (0.8f32, 3.0f32, 0.5f32);
    let scene = |with_lamp_facing_mirror: bool| {
        let mut b = Build::default();
        let mirror = b.mirror(k);
        b.quad(Vec3::new(0.0, -10.0, -10.0), Vec3::Y * 20.0, Vec3::Z * 20.0, mirror);
        let floor = b.material(albedo, 0.0);
        b.quad(Vec3::ZERO - Vec3::Z * 5.0, Vec3::Z * 10.0, Vec3::X * 5.0, floor);
        let lamp = b.material(0.0, emitted);
        // At x = 2, facing the mirror (or away from it).
        let (u, v) = if with_lamp_facing_mirror { (Vec3::Z, Vec3::Y) } else { (Vec3::Y, Vec3::Z) };
        b.quad(Vec3::new(2.0, 0.5, -0.5), u, v, lamp);
        b.0
    };
    // The lamp seen in the mirror.
    let eye = Vec3::new(1.0, 0.2, 0.0);
    let image = Vec3::new(-2.0, 1.0, 0.1);
    expect(&scene(true), (eye, image - eye), 2, 4, f64::from(k * emitted), 0.0);
    // The floor: lit directly, and by the mirror image of the lamp.
    let target = Vec3::new(1.0, 0.0, 0.0);
    let lamp = |x: f32| [(0.5, -0.5), (0.5, 0.5), (1.5, 0.5), (1.5, -0.5)].map(|(y, z)| Vec3::new(x, y, z));
    let direct = polygon_irradiance(target, Vec3::Y, &lamp(2.0));
    let mirrored = polygon_irradiance(target, Vec3::Y, &lamp(-2.0)) * f64::from(k);
    let expected = (direct + mirrored) * f64::from(emitted * albedo) / std::f64::consts::PI;
    let eye = Vec3::new(0.8, 1.0, 0.3);
    expect(&scene(true), (eye, target - eye), 3, 200_000, expected, 0.0);
    // A lamp that faces away lights neither.
    assert_eq!(along(&scene(false), eye, target - eye, 3, 1000).0, 0.0);
    // Between two parallel mirrors the light is a geometric series.
    let mut b = Build::default();
    let mirror = b.mirror(0.5);
    (b.0.materials[mirror as usize].emission, b.0.materials[mirror as usize].two_sided) = (Vec3::ONE, true);
    b.quad(Vec3::new(0.0, -1.0, -1.0), Vec3::Y * 2.0, Vec3::Z * 2.0, mirror);
    b.quad(Vec3::new(1.0, -1.0, -1.0), Vec3::Y * 2.0, Vec3::Z * 2.0, mirror);
    expect(&b.0, (Vec3::new(0.5, 0.1, 0.2), Vec3::X), 10, 4, 2.0 * (1.0 - 0.5f64.powi(10)), 0.0);
}

/// Emitters of radiance 1 in front of and `behind` behind the eye, which looks along z from the origin.
fn lamps(behind: f32) -> Build {
    let mut b = Build::default();
    let (front, back) = (b.material(0.0, 1.0), b.material(0.0, behind));
    b.quad(Vec3::new(-9.0, -9.0, 5.0), Vec3::Y * 18.0, Vec3::X * 18.0, front);
    b.quad(Vec3::new(-9.0, -9.0, -5.0), Vec3::X * 18.0, Vec3::Y * 18.0, back);
    b
}

#[test]
fn panes_and_slabs_let_the_same_light_through() {
    // A pane of one sheet and a slab: (1 - R) / (1 + R) of the radiance in front of, 2 R / (1 + R) of that behind the
    // eye.
    for thin in [true, false] {
        let mut b = lamps(3.0);
        let glass = b.glass(1.5);
        b.0.materials[glass as usize].thin = thin;
        let (low, high) = (Vec3::new(-2.0, -2.0, 1.0), Vec3::new(2.0, 2.0, 1.1));
        if thin {
            b.quad(low, Vec3::X * 4.0, Vec3::Y * 4.0, glass);
        } else {
            b.cuboid(low, high, false, glass);
        }
        expect(&b.0, (Vec3::new(0.1, 0.2, 0.0), Vec3::Z), 16, 200_000, 0.96 / 1.04 + 3.0 * 0.08 / 1.04, 0.0);
        // The tint counts once for a pane, and for a slab at each of its faces: T^2 t^2 / (1 - R^2 t^2).
        b.0.materials[glass as usize].base_color = Vec3::splat(0.5);
        b.0.materials[1].emission = Vec3::splat(1e-6);
        let expected = if thin { 0.5 * 0.96 / 1.04 } else { 0.96 * 0.96 * 0.25 / (1.0 - 0.04 * 0.04) };
        // For the slab this assumes that reflections inside are untinted, as they are.
        expect(&b.0, (Vec3::new(0.1, 0.2, 0.0), Vec3::Z), 16, 200_000, expected, 1e-4);
    }
}

#[test]
fn glass_bends_light_and_a_pane_does_not() {
    // From the origin at 45 degrees, past a strip of light behind a plate of thickness 1: shifted by 1 - tan(28.1) across.
    for (thin, expected) in [(false, true), (true, false)] {
        let mut b = Build::default();
        let lamp = b.material(0.0, 1.0);
        let shift = 1.0 - (0.5f32.sqrt() / 1.5).asin().tan();
        b.quad(Vec3::new(3.0 - shift - 0.05, -1.0, 3.0), Vec3::Y * 2.0, Vec3::X * 0.1, lamp);
        let glass = b.glass(1.5);
        b.0.materials[glass as usize].thin = thin;
        b.cuboid(Vec3::new(-5.0, -5.0, 1.0), Vec3::new(5.0, 5.0, 2.0), false, glass);
        let (mean, _) = along(&b.0, Vec3::ZERO, Vec3::new(1.0, 0.0, 1.0).normalize(), 16, 2000);
        assert_eq!(mean > 0.5, expected, "thin {thin}: {mean}");
    }
}

#[test]
fn bodies_of_glass_in_each_other() {
    // Transmittance of a row of faces at normal incidence that reflect r each: 1 / (1 + sum of r / (1 - r)).
    let row = |indices: &[f64]| {
        let r = |pair: &[f64]| ((pair[0] - pair[1]) / (pair[0] + pair[1])).powi(2);
        1.0 / (1.0 + indices.windows(2).map(r).map(|r| r / (1.0 - r)).sum::<f64>())
    };
    let (wide, eye) = (Vec3::new(2.0, 2.0, 0.0), Vec3::new(0.1, 0.2, 0.0));
    let slab = |b: &mut Build, from: f32, to: f32, ior: f32| {
        let glass = b.glass(ior);
        b.cuboid(Vec3::Z * from - wide, Vec3::Z * to + wide, false, glass);
    };
    for (name, slabs, indices) in [
        ("a gap in glass", [(1.0, 3.0, 1.5), (1.5, 2.5, 1.0)], &[1.0, 1.5, 1.0, 1.5, 1.0][..]),
        ("denser glass in glass", [(1.0, 3.0, 1.5), (1.5, 2.5, 2.0)], &[1.0, 1.5, 2.0, 1.5, 1.0]),
        ("water that overlaps glass", [(1.0, 2.0, 1.5), (1.9, 3.0, 1.33)], &[1.0, 1.5, 1.33, 1.0]),
        ("glass that overlaps water", [(1.9, 3.0, 1.5), (1.0, 2.0, 1.33)], &[1.0, 1.33, 1.5, 1.0]),
        ("glass in glass of its own index", [(1.0, 3.0, 1.5), (1.5, 2.5, 1.5)], &[1.0, 1.5, 1.0]),
    ] {
        let mut b = lamps(1e-6);
        for (from, to, ior) in slabs {
            slab(&mut b, from, to, ior);
        }
        println!("{name}: {}", row(indices));
        expect(&b.0, (eye, Vec3::Z), 32, 200_000, row(indices), 1e-4);
    }
}

#[test]
fn a_mirror_over_a_base_reflects_and_shows_its_colour() {
    // Half a room of radiance 1: the base reflects kd, the mirror F, and kd is reduced by the mean of F.
    let (base, f0) = (0.6f32, 0.1f32);
    let mut b = Build::default();
    let lamp = b.material(0.0, 1.0);
    b.cuboid(Vec3::splat(-50.0), Vec3::splat(50.0), true, lamp);
    let coat = b.add(Material {
        surface: Surface::Mirror,
        base_color: Vec3::splat(base),
        specular: Vec3::splat(f0),
        ..Material::default()
    });
    b.quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, coat);
    let kd = base * (1.0 - (f0 + (1.0 - f0) / 21.0));
    for degrees in [0.0f32, 60.0, 85.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let fresnel = f0 + (1.0 - f0) * (1.0 - cos).powi(5);
        let eye = Vec3::new(sin, cos, 0.0);
        expect(&b.0, (eye, -eye), 2, 40_000, f64::from(kd + fresnel), 0.0);
    }
}

#[test]
fn a_corner_of_mirrors_sends_light_back() {
    // Three mirrors at right angles: light returns to its origin, attenuated by each.
    let k = 0.9f32;
    let mut b = Build::default();
    let mirror = b.mirror(k);
    for axis in 0..3 {
        let (u, v) = (Vec3::AXES[(axis + 1) % 3], Vec3::AXES[(axis + 2) % 3]);
        b.quad(Vec3::ZERO, u * 4.0, v * 4.0, mirror);
    }
    let eye = Vec3::new(1.0, 1.3, 1.6);
    // A lamp behind the eye, visible only in the reflection.
    let lamp = b.material(0.0, 1.0);
    b.0.materials[lamp as usize].two_sided = true;
    let back = eye.normalize();
    let (u, v) = back.any_orthonormal_pair();
    b.quad(eye + back * 2.0 - (u + v), u * 2.0, v * 2.0, lamp);
    for towards in [Vec3::new(-1.0, -1.1, -1.2), Vec3::new(-1.1, -1.3, -1.6), Vec3::new(-0.9, -1.4, -1.6)] {
        let (mean, _) = along(&b.0, eye, towards.normalize(), 4, 4);
        // Mirrors of 0.9 reflect slightly more at an angle: 0.9 + 0.1 (1 - cos)^5 at each.
        let d = towards.normalize();
        let expected: f32 = d.abs().to_array().iter().map(|cos| k + (1.0 - k) * (1.0 - cos).powi(5)).product();
        assert!((mean - f64::from(expected)).abs() < 1e-5, "{towards}: {mean} for {expected}");
        assert_eq!(along(&b.0, eye, d, 3, 4).0, 0.0, "two mirrors do not bring it back");
    }
}

#[test]
fn mirrors_and_glass_are_followed_as_far_as_asked() {
    let mut b = Build::default();
    let lamp = b.material(0.5, 1.0);
    b.cuboid(Vec3::splat(-2.0), Vec3::splat(2.0), true, lamp);
    let mirror = b.mirror(1.0);
    b.quad(Vec3::new(-1.0, -1.0, 1.0), Vec3::Y * 2.0, Vec3::X * 2.0, mirror);
    let (bvh, emitters) = (Bvh::build(&b.0).unwrap(), Emitters::of(&b.0, true).unwrap());
    let radiance = |target: Vec3, options: Options| {
        let tracer = Tracer::new(&b.0, &bvh, &emitters, &options);
        let ray = Ray::new(Vec3::ZERO, target.normalize());
        (0..4000).map(|i| tracer.radiance(ray, &mut Rng::new(0, 0, i)).x).sum::<f32>() / 4000.0
    };
    let with = |specular_paths, max_specular| Options { max_depth: 1, max_specular, specular_paths, ..OPTIONS };
    for (options, expected) in [
        (with(SpecularPaths::All, 1), 1.0),
        (with(SpecularPaths::Eye, 1), 1.0),
        (with(SpecularPaths::Eye, 0), 0.0),
        (with(SpecularPaths::All, 0), 0.0),
        (with(SpecularPaths::None, 1), 0.0),
    ] {
        assert_eq!(radiance(Vec3::Z, options), expected, "{options:?}");
    }
    // Beside the mirror the wall is lit by all of the room that the mirror does not block, and by mirrors if they are
    // followed.
    let wall = |specular_paths| radiance(Vec3::new(0.0, 1.9, 1.5), Options { max_depth: 3, ..with(specular_paths, 8) });
    let [none, eye, all] = [SpecularPaths::None, SpecularPaths::Eye, SpecularPaths::All].map(wall);
    assert_eq!(none, eye);
    assert!(all > eye + 0.02, "{all} {eye}");
}
