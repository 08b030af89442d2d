use super::*;
use crate::accel::{Ray, offset_origin};
use crate::sampling::halton::halton;
use crate::scene::{Light, Material, Triangle};
use glam::Vec2;

/// Upward mirror squares of side 2 around these centres; the last one is diffuse.
fn squares(middles: &[Vec3], lights: Vec<Light>) -> Scene {
    let mut scene = Scene { lights, objects: vec![String::from("all")], ..Scene::default() };
    scene.materials = vec![Material { surface: Surface::Mirror, ..Material::default() }, Material::default()];
    for (i, &middle) in middles.iter().enumerate() {
        let first = scene.positions.len() as u32;
        for corner in [Vec3::new(-1.0, 0.0, -1.0), Vec3::NEG_X + Vec3::Z, Vec3::X + Vec3::Z, Vec3::X - Vec3::Z] {
            scene.positions.push(middle + corner);
        }
        let material = u32::from(i + 1 == middles.len());
        for vertices in [[0, 1, 2], [0, 2, 3]] {
            let vertices = vertices.map(|v| first + v);
            scene.triangles.push(Triangle { vertices, material, object: 0, smooth: false });
        }
    }
    scene.normals = vec![Vec3::Y; scene.positions.len()];
    scene.uvs = vec![Vec2::ZERO; scene.positions.len()];
    scene
}

#[test]
fn bodies_are_triangles_that_share_corners() {
    // The first two share a corner, the third stands alone, the fourth is no mirror.
    let scene =
        squares(&[Vec3::ZERO, Vec3::new(2.0, 0.0, 2.0), Vec3::new(8.0, 0.0, 0.0), Vec3::new(0.0, -1.0, 0.0)], vec![]);
    let bvh = Bvh::build(&scene).unwrap();
    let targets = Targets::of(&scene, &bvh, &Mirrors::default());
    assert_eq!(targets.list.len(), 2);
    let of_scene_triangle =
        |t: u32| (0..8).find(|&i| bvh.scene_triangle(i) == t).map(|i| targets.of_triangle[i as usize]).unwrap();
    let numbers: Vec<u32> = (0..8).map(of_scene_triangle).collect();
    let (a, b) = (numbers[0], numbers[4]);
    assert!(a != b && a.max(b) == 2 && a.min(b) == 1);
    assert_eq!(numbers, [a, a, a, a, b, b, 0, 0]);
    let sphere = targets.list[a as usize - 1].sphere;
    assert_eq!(sphere.center, Vec3::new(1.0, 0.0, 1.0));
    assert!((sphere.radius - 8f32.sqrt()).abs() < 1e-3 && sphere.radius > 8f32.sqrt());
}

#[test]
fn many_bodies_are_grouped_by_place() {
    let mut middles: Vec<Vec3> =
        (0..200).map(|i| Vec3::new((i % 20) as f32 * 3.0, 0.0, (i / 20) as f32 * 3.0)).collect();
    middles.push(Vec3::NEG_Y);
    let scene = squares(&middles, vec![]);
    let bvh = Bvh::build(&scene).unwrap();
    let targets = Targets::of(&scene, &bvh, &Mirrors::default());
    assert_eq!(targets.list.len(), MAX_TARGETS);
    for i in 0..bvh.triangle_count() {
        let mirror = scene.materials[bvh.material(i) as usize].surface == Surface::Mirror;
        let number = targets.of_triangle[i as usize];
        assert_eq!(number > 0, mirror);
        if mirror {
            let s = targets.list[number as usize - 1].sphere;
            let corners = scene.triangles[bvh.scene_triangle(i) as usize].vertices;
            assert!(corners.iter().all(|&v| scene.positions[v as usize].distance(s.center) < s.radius));
            assert!(s.radius < 8.0, "{s:?}");
        }
    }
}

/// Flux from a light to the mirrors, by photons, as if the first square reflected virtual lights; and the share of the photons aimed at it.
fn arriving(scene: &Scene, count: u32, mirrored_lights: bool) -> (f32, f32) {
    let bvh = Bvh::build(scene).unwrap();
    let emitters = Emitters::of(scene, true).unwrap();
    let of_triangle = (0..bvh.triangle_count()).map(|i| u32::from(bvh.scene_triangle(i) < 2)).collect();
    let targets = Targets::of(scene, &bvh, &Mirrors { of_triangle, ..Mirrors::default() });
    let (mut sum, mut at_first) = (0.0, 0);
    for i in 0..count {
        let start = emitters.sample_start(&[], halton(2, i), halton(3, i), 1.0);
        let origin = offset_origin(start.position, start.normal, 1.0);
        let leave = [halton(0, i), halton(1, i)];
        let Some(shot) = targets.shoot(&emitters, &start, origin, (halton(4, i), mirrored_lights), leave) else {
            continue;
        };
        let Some(hit) = bvh.closest(&Ray::new(shot.origin, shot.direction)) else { continue };
        if targets.meets(shot.aim, hit.triangle) {
            sum += f64::from(shot.flux.x);
            at_first += u32::from(bvh.scene_triangle(hit.triangle) < 2);
        }
    }
    ((sum / f64::from(count)) as f32, at_first as f32 / count as f32)
}

/// Solid angle of a square of half side `a` seen from height `h` above its centre.
fn square_angle(a: f32, h: f32) -> f32 {
    4.0 * (a * a / (h * (h * h + 2.0 * a * a).sqrt())).atan()
}

#[test]
fn the_flux_that_arrives_is_what_the_light_sends() {
    // The last square of each scene is no mirror.
    let middles = [Vec3::ZERO, Vec3::new(6.0, 1.0, 0.0), Vec3::new(0.0, -1.0, 0.0)];
    let at = Vec3::new(0.0, 2.0, 0.0);
    let single = [Vec3::ZERO, Vec3::new(0.0, -1.0, 0.0)];
    let point = |position: Vec3| Light::Point { position, intensity: Vec3::splat(3.0) };
    let down =
        Light::Spot { position: at, direction: Vec3::NEG_Y, intensity: Vec3::splat(3.0), inner: 1.2, outer: 1.3 };
    let slanted = Vec3::new(0.6, -0.8, 0.0);
    let parallel = Light::Directional { direction: slanted, irradiance: Vec3::splat(2.0) };
    let angle = square_angle(1.0, 2.0);
    let near = square_angle(1.0, 0.1);
    for (what, scene, expected) in [
        ("a point", squares(&single, vec![point(at)]), 3.0 * angle),
        ("a point within the sphere", squares(&single, vec![point(Vec3::Y * 0.1)]), 3.0 * near),
        ("a spot that covers it", squares(&single, vec![down]), 3.0 * angle),
        ("parallel light", squares(&middles, vec![parallel]), 2.0 * 2.0 * 4.0 * 0.8),
        (
            "two points over two mirrors",
            squares(&middles, vec![point(at), point(Vec3::new(6.0, 3.0, 0.0))]),
            // Each mirror sees the other's light from the side.
            3.0 * (2.0 * angle + side_angle(Vec3::new(-6.0, 1.0, 0.0)) + side_angle(Vec3::new(6.0, 3.0, 0.0))),
        ),
    ] {
        let [(found, often), (mirrored, seldom)] = [false, true].map(|mirrored| arriving(&scene, 20_000, mirrored));
        assert!((found / expected - 1.0).abs() < 0.01, "{what}: {found} for {expected}");
        assert!((mirrored / expected - 1.0).abs() < 0.02, "{what}, mirrored lights: {mirrored} for {expected}");
        // Beside another target fewer photons go to a mirror whose reflection is left to mirrored lights.
        let several = scene.triangles.len() > 4;
        assert_eq!(seldom < 0.9 * often, several, "{what}: {seldom} of the photons, {often} without mirrored lights");
    }
}

/// Solid angle of the square around the origin from `eye`, by a sum over cells.
fn side_angle(eye: Vec3) -> f32 {
    let n = 200;
    let place = |i: i32| (i as f32 + 0.5) / n as f32 * 2.0 - 1.0;
    let area = (2.0 / n as f32).powi(2);
    let cell = |i: i32| {
        let p = Vec3::new(place(i % n), 0.0, place(i / n));
        eye.y * area / (eye - p).length().powi(3)
    };
    (0..n * n).map(cell).sum()
}

#[test]
fn a_long_body_is_divided_and_gets_the_same_flux() {
    let mut middles: Vec<Vec3> = (0..10).map(|i| Vec3::X * (2.0 * i as f32)).collect();
    let at = Vec3::new(6.0, 5.0, 1.0);
    let expected: f32 = middles.iter().map(|&middle| 3.0 * side_angle(at - middle)).sum();
    middles.push(Vec3::NEG_Y);
    let scene = squares(&middles, vec![Light::Point { position: at, intensity: Vec3::splat(3.0) }]);
    let targets = Targets::of(&scene, &Bvh::build(&scene).unwrap(), &Mirrors::default());
    assert!(targets.list.len() > 1, "{:?}", targets.list);
    assert_eq!(targets.triangles.len(), 20);
    let (found, _) = arriving(&scene, 20_000, false);
    assert!((found / expected - 1.0).abs() < 0.01, "{found} for {expected}");
    // Nearly every photon arrives, of those that are aimed at triangles from far enough.
    let far = Vec3::new(6.0, 40.0, 1.0);
    let scene = squares(&middles, vec![Light::Point { position: far, intensity: Vec3::splat(3.0) }]);
    let bvh = Bvh::build(&scene).unwrap();
    let (emitters, targets) = (Emitters::of(&scene, true).unwrap(), Targets::of(&scene, &bvh, &Mirrors::default()));
    let start = emitters.sample_start(&[], 0.5, 0.5, 1.0);
    let meets = |i: u32| {
        let shot = targets.shoot(&emitters, &start, far, (halton(4, i), false), [halton(0, i), halton(1, i)]).unwrap();
        bvh.closest(&Ray::new(far, shot.direction)).is_some_and(|hit| targets.meets(shot.aim, hit.triangle))
    };
    assert!((0..1000).filter(|&i| meets(i)).count() > 990);
}
