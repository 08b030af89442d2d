use super::*;
use crate::sampling::halton::halton;
use crate::scene::{Material, Triangle};
use glam::Vec2;

/// A scene of triangles over shared corners; material 0 is dark, 1 emits, 2 emits from both sides.
fn scene(positions: Vec<Vec3>, triangles: &[([u32; 3], u32)], lights: Vec<Light>) -> Scene {
    let emitting = Material { emission: Vec3::new(1.0, 2.0, 3.0), ..Material::default() };
    Scene {
        normals: vec![Vec3::Z; positions.len()],
        uvs: vec![Vec2::ZERO; positions.len()],
        positions,
        triangles: triangles
            .iter()
            .map(|&(vertices, material)| Triangle { vertices, material, object: 0, smooth: false })
            .collect(),
        objects: vec![String::from("object")],
        materials: vec![Material::default(), emitting.clone(), Material { two_sided: true, ..emitting }],
        lights,
        ..Scene::default()
    }
}

fn square() -> Vec<Vec3> {
    vec![Vec3::ZERO, Vec3::X * 2.0, Vec3::new(2.0, 1.0, 0.0), Vec3::Y]
}

#[test]
fn parallelograms_become_quads() {
    // All nine ways to start the two triangles.
    for first in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
        for second in [[0, 2, 3], [2, 3, 0], [3, 0, 2]] {
            let e = Emitters::of(&scene(square(), &[(first, 1), (second, 1)], vec![]), true).unwrap();
            assert_eq!((e.list.len(), e.list[0].kind, e.list[0].area), (1, Kind::Quad, 2.0));
            assert_eq!(e.list[0].normal, Vec3::Z);
            assert_eq!(e.of_triangle, [0, 0]);
            assert!((e.power - Vec3::new(1.0, 2.0, 3.0) * 2.0 * PI).length() < 1e-5);
            for i in 0..64 {
                let p = e.sample_start(&[], halton(0, i), halton(1, i), 0.0).position;
                assert!(p.x >= 0.0 && p.x <= 2.0 && p.y >= 0.0 && p.y <= 1.0 && p.z == 0.0, "{p}");
            }
        }
    }
}

#[test]
fn others_stay_triangles() {
    let mut kite = square();
    kite[3].x = 0.5;
    let mut bent = square();
    bent[3].z = 0.1;
    let back_to_back = [([0, 1, 2], 1), ([2, 1, 0], 1)];
    for (positions, triangles) in [
        (kite, [([0, 1, 2], 1), ([0, 2, 3], 1)]),
        (bent, [([0, 1, 2], 1), ([0, 2, 3], 1)]),
        (square(), [([0, 1, 2], 1), ([0, 2, 3], 2)]),
        (square(), back_to_back),
    ] {
        let e = Emitters::of(&scene(positions, &triangles, vec![]), true).unwrap();
        assert_eq!(e.list.len(), 2);
        assert!(e.list.iter().all(|e| e.kind == Kind::Triangle));
        assert_eq!(e.of_triangle, [0, 1]);
    }
}

#[test]
fn a_strip_pairs_each_triangle_once() {
    let positions = (0..10).map(|i| Vec3::new((i / 2) as f32, (i % 2) as f32, 0.0)).collect();
    let mut triangles = Vec::new();
    for i in 0..4 {
        triangles.push(([2 * i, 2 * i + 2, 2 * i + 3], 1));
        triangles.push(([2 * i, 2 * i + 3, 2 * i + 1], 1));
    }
    let e = Emitters::of(&scene(positions, &triangles, vec![]), true).unwrap();
    assert_eq!(e.list.len(), 4);
    assert!(e.list.iter().all(|q| q.kind == Kind::Quad && q.area == 1.0));
    assert_eq!(e.of_triangle, [0, 0, 1, 1, 2, 2, 3, 3]);
}

#[test]
fn triangles_are_sampled_uniformly() {
    let (a, b, c) = (Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 2.0, 3.5), Vec3::new(0.0, 5.0, 2.0));
    let e = Emitters::of(&scene(vec![a, b, c], &[([0, 1, 2], 1)], vec![]), true).unwrap();
    let n = 4096;
    let mut mean = Vec3::ZERO;
    let mut square = 0.0;
    for i in 0..n {
        let p = e.sample_start(&[], halton(0, i), halton(1, i), 0.0).position;
        mean += p / n as f32;
        square += (p - (a + b + c) / 3.0).length_squared() / n as f32;
    }
    assert!((mean - (a + b + c) / 3.0).length() < 5e-3, "{mean}");
    // Second moment of a triangle about its centroid: (sum of squared edges) / 36.
    let expected = ((a - b).length_squared() + (b - c).length_squared() + (c - a).length_squared()) / 36.0;
    assert!((square - expected).abs() < 5e-3 * expected, "{square} for {expected}");
}

#[test]
fn choice_is_by_power_and_stretches_the_number() {
    let light = |i: f32| Light::Point { position: Vec3::X * i, intensity: Vec3::splat(i) };
    let lights = vec![light(1.0), light(0.0), light(3.0), light(4.0), light(0.0)];
    let e = Emitters::of(&scene(square(), &[([0, 1, 2], 0)], lights), true).unwrap();
    let expected = [0.125, 0.0, 0.375, 0.5, 0.0];
    assert!(e.list.iter().zip(expected).all(|(e, p)| (e.probability - p).abs() < 1e-6));
    assert_eq!(e.cdf.last(), Some(&1.0));
    assert_eq!(e.delta, [0, 1, 2, 3, 4]);
    let mut flux = Vec3::ZERO;
    let n = 64;
    for i in 0..n {
        let u = i as f32 / n as f32;
        let (index, stretched) = e.choose(u);
        assert!(expected[index as usize] > 0.0);
        let lower = [0.0, 0.125, 0.125, 0.5, 1.0][index as usize];
        assert!((stretched - (u - lower) / expected[index as usize]).abs() < 1e-5);
        flux += e.sample_start(&[], u, 0.5, 0.5).flux / n as f32;
    }
    assert!((flux - e.power).length() < 1e-3 * e.power.length(), "{flux} for {}", e.power);
    let (_, stretched) = e.choose(ONE_MINUS_EPSILON);
    assert!(stretched < 1.0);
}

#[test]
fn many_emitters_share_the_unit_interval() {
    let lights = (0..5000).map(|i| Light::Point { position: Vec3::ZERO, intensity: Vec3::splat(1e-3 + i as f32) });
    let e = Emitters::of(&scene(square(), &[([0, 1, 2], 0)], lights.collect()), true).unwrap();
    assert!(e.cdf.windows(2).all(|w| w[0] <= w[1]));
    assert!((e.list.iter().map(|e| f64::from(e.probability)).sum::<f64>() - 1.0).abs() < 1e-6);
    for i in 0..2000 {
        let u = halton(0, i);
        let (index, _) = e.choose(u);
        let direct = e.cdf.iter().position(|&c| c > u).unwrap() as u32;
        assert_eq!(index, direct);
    }
}

#[test]
fn two_sided_emitters_use_both_sides() {
    let e = Emitters::of(&scene(square(), &[([0, 1, 2], 2)], vec![]), true).unwrap();
    assert!((e.power.x - 2.0 * PI).abs() < 1e-5);
    assert_eq!(e.sample_start(&[], 0.5, 0.5, 0.2).normal, -Vec3::Z);
    assert_eq!(e.sample_start(&[], 0.5, 0.5, 0.7).normal, Vec3::Z);
}

#[test]
fn spots_follow_their_falloff() {
    let spot = |inner, outer| Light::Spot {
        position: Vec3::ZERO,
        direction: Vec3::new(0.0, 0.6, 0.8),
        intensity: Vec3::ONE,
        inner,
        outer,
    };
    for (inner, outer) in [(0.0, 0.5), (0.3, 0.9), (0.2, 1.5)] {
        let e = Emitters::of(&scene(square(), &[([0, 1, 2], 0)], vec![spot(inner, outer)]), true).unwrap();
        let (ci, co) = (inner.cos(), outer.cos());
        // Power and the mean cosine by quadrature.
        let n = 100_000;
        let (mut power, mut moment) = (0.0f64, 0.0f64);
        for i in 0..n {
            let cos = co + (1.0 - co) * (i as f32 + 0.5) / n as f32;
            let f = f64::from(spot_falloff(cos, ci, co)) * f64::from(TAU * (1.0 - co)) / n as f64;
            power += f;
            moment += f * f64::from(cos);
        }
        assert!((f64::from(e.power.x) - power).abs() < 1e-3 * power, "{} for {power}", e.power.x);
        let start = e.sample_start(&[], 0.1, 0.2, 0.0);
        let mut cosines = 0.0;
        for i in 0..4096 {
            let w = e.sample_direction(&start, [halton(0, i), halton(1, i)]);
            let cos = w.dot(Vec3::new(0.0, 0.6, 0.8));
            assert!(cos >= co - 1e-5 && (w.length() - 1.0).abs() < 1e-5);
            cosines += f64::from(cos) / 4096.0;
        }
        assert!((cosines - moment / power).abs() < 1e-3, "{cosines} for {}", moment / power);
        assert_eq!(e.list[0].intensity(Vec3::new(0.0, 0.6, 0.8)), Vec3::ONE);
    }
}

#[test]
fn directional_light_covers_the_scene() {
    let direction = Vec3::new(0.6, 0.0, -0.8);
    let light = Light::Directional { direction, irradiance: Vec3::splat(3.0) };
    let e = Emitters::of(&scene(square(), &[([0, 1, 2], 0)], vec![light]), true).unwrap();
    let disc = e.list[0];
    let radius = disc.e1.length();
    for p in square() {
        let from_axis = (p - disc.p0).cross(direction).length();
        assert!(from_axis <= radius * 1.000_01 && (p - disc.p0).dot(direction) >= -1e-5);
    }
    assert!((disc.power.x - 3.0 * PI * radius * radius).abs() < 1e-3);
    let start = e.sample_start(&[], 0.3, 0.4, 0.0);
    assert_eq!(e.sample_direction(&start, [0.1, 0.9]), direction);
    assert!((start.position - disc.p0).dot(direction).abs() < 1e-5);
}

#[test]
fn spheres_own_their_triangles() {
    let octahedron = [Vec3::X, Vec3::Y, -Vec3::X, -Vec3::Y, Vec3::Z, -Vec3::Z].map(|p| p * 0.5 + 1.0);
    let faces = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [1, 0, 5], [2, 1, 5], [3, 2, 5], [0, 3, 5]];
    for inward in [false, true] {
        let light = Light::Sphere { center: Vec3::ONE, radius: 0.5, radiance: Vec3::splat(2.0), inward, object: 0 };
        let s = scene(octahedron.to_vec(), &faces.map(|f| (f, 1)), vec![light]);
        let e = Emitters::of(&s, true).unwrap();
        assert_eq!(e.list.len(), 1);
        assert_eq!(e.of_triangle, [0; 8]);
        assert!((e.power.x - 2.0 * PI * PI).abs() < 1e-4);
        // The octahedron's faces are at 0.5 / sqrt 3 from the centre.
        let start = if inward { 0.5 / 3f32.sqrt() } else { 0.5 };
        for i in 0..32 {
            let s = e.sample_start(&[], halton(0, i), halton(1, i), 0.0);
            let outward = s.position - Vec3::ONE;
            assert!((outward.length() - start).abs() < 1e-5);
            assert!((s.normal.dot(outward.normalize()) - if inward { -1.0 } else { 1.0 }).abs() < 1e-5);
        }
        assert!(Emitters::of(&s, false).is_err());
    }
}

#[test]
fn directions_of_points_and_virtual_lights() {
    let lights = vec![
        Light::Point { position: Vec3::ZERO, intensity: Vec3::ONE },
        Light::Imported { position: Vec3::X, normal: -Vec3::Y, power: Vec3::ONE, exponent: 1.0 },
    ];
    let e = Emitters::of(&scene(square(), &[([0, 1, 2], 1)], lights), true).unwrap();
    assert_eq!(e.delta, [0, 1]);
    let (mut sum, mut cosine) = (Vec3::ZERO, 0.0);
    for i in 0..4096 {
        let u = [halton(0, i), halton(1, i)];
        let start =
            |emitter, normal| Start { emitter, position: Vec3::ZERO, normal, flux: Vec3::ONE, radiance: Vec3::ONE };
        sum += e.sample_direction(&start(0, Vec3::Z), u) / 4096.0;
        cosine += e.sample_direction(&start(1, -Vec3::Y), u).dot(-Vec3::Y) / 4096.0;
    }
    assert!(sum.length() < 2e-3, "{sum}");
    assert!((cosine - 2.0 / 3.0).abs() < 1e-3, "{cosine}");
    // Intensity of the virtual light: its power over the hemisphere is the flux.
    let mut flux = 0.0;
    for i in 0..4096 {
        flux += e.list[1].intensity(uniform_sphere([halton(0, i), halton(1, i)])).x * 4.0 * PI / 4096.0;
    }
    assert!((flux - 1.0).abs() < 2e-3, "{flux}");
}

#[test]
fn records_hold_the_same() {
    let light = Light::Point { position: Vec3::X, intensity: Vec3::ONE };
    let e = Emitters::of(&scene(square(), &[([0, 1, 2], 2)], vec![light]), true).unwrap();
    let records = e.records();
    assert_eq!(std::mem::size_of::<EmitterRecord>(), 128);
    assert_eq!(records[0].p0, [1.0, 0.0, 0.0, f32::from_bits(Kind::Point as u32)]);
    assert_eq!(records[1].e2[3].to_bits(), FLAG_TWO_SIDED);
    assert_eq!((records[1].normal[3], records[1].radiance[3]), (e.list[1].probability, 1.0));
    assert_eq!(records[1].flux[0], e.sample_start(&[], 0.99, 0.0, 0.0).flux.x);
}

#[test]
fn darkness_is_an_error() {
    let message = Emitters::of(&scene(square(), &[([0, 1, 2], 0)], vec![]), true).unwrap_err().to_string();
    assert!(message.contains("light"), "{message}");
}
