use std::f32::consts::PI;

use super::*;
use crate::sampling::halton::halton;
use crate::scene::{Material, Triangle, Wrap};

/// A square of side 2 in the plane z = 0 whose texture, of `width` x `height` texels, spans it once; `split`: its second triangle has
/// coordinates of its own.
fn square(width: u32, height: u32, split: bool, texel: impl Fn(u32, u32) -> u8) -> Scene {
    let texels = (0..width * height).map(|i| [texel(i % width, i / width); 3]).map(|[g, ..]| [g, g, g, 255]);
    let texture = Texture {
        name: String::from("screen"),
        width,
        height,
        texels: texels.collect(),
        srgb: false,
        wrap: [Wrap::Clamp; 2],
    };
    let corners = [Vec3::ZERO, Vec3::X * 2.0, Vec3::new(2.0, 2.0, 0.0), Vec3::Y * 2.0];
    let uvs = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    let order = [0, 1, 2, 0, 2, 3];
    let shift = |k: usize| if split && k >= 3 { Vec2::new(-3.0, 0.0) } else { Vec2::ZERO };
    let face = |vertices: [u32; 3]| Triangle { vertices, material: 0, object: 0, smooth: false };
    Scene {
        positions: order.map(|v| corners[v]).to_vec(),
        normals: vec![Vec3::Z; 6],
        uvs: (0..6).map(|k| uvs[order[k]] + shift(k)).collect(),
        triangles: vec![face([0, 1, 2]), face([3, 4, 5])],
        objects: vec![String::from("screen")],
        materials: vec![Material {
            emission: Vec3::new(1.0, 2.0, 3.0),
            emission_texture: Some(0),
            ..Material::default()
        }],
        textures: vec![texture],
        ..Scene::default()
    }
}

/// Sums over starts of flux, and of flux times x.
fn moments(e: &Emitters, scene: &Scene) -> [f32; 2] {
    const STARTS: u32 = 1 << 15;
    let mut sums = [0.0f64; 2];
    for i in 0..STARTS {
        let start = e.sample_start(&scene.textures, halton(0, i), halton(1, i), 0.5);
        let flux = f64::from(start.flux.x) / f64::from(STARTS);
        sums = [sums[0] + flux, sums[1] + flux * f64::from(start.position.x)];
    }
    sums.map(|sum| sum as f32)
}

#[test]
fn a_ramp_is_lit_by_its_integral() {
    // Texels of 0, 1, ... 63 over 255: between centres L = (64 u - 0.5) / 255, beyond the outer ones it is constant.
    for split in [false, true] {
        let scene = square(64, 1, split, |x, _| x as u8);
        let e = Emitters::of(&scene, true).unwrap();
        // The second triangle of a split square repeats the first texel, which is black.
        let power = if split { 2.0 / 3.0 * 0.5 } else { 0.5 } * 63.0 / 255.0 * 4.0 * PI;
        assert!((e.power.x / power - 1.0).abs() < 0.01, "{} of {power}", e.power.x);
        assert_eq!(e.of_triangle.iter().filter(|&&i| i == NO_EMITTER).count(), usize::from(split));
        let kinds: Vec<Kind> = e.list.iter().map(|e| e.kind).collect();
        assert!(kinds.iter().all(|&kind| kind == if split { Kind::Triangle } else { Kind::Quad }), "{kinds:?}");
        // The mean of x: of the density x over the square 4/3, of x over its lower triangle 3/2.
        let [flux, first] = moments(&e, &scene);
        assert!((flux / power - 1.0).abs() < 0.01, "{flux} of {power}");
        assert!((first / flux - if split { 1.5 } else { 4.0 / 3.0 }).abs() < 0.01, "{}", first / flux);
    }
}

#[test]
fn uneven_emitters_are_divided() {
    // One bright texel of 32 x 32.
    let scene = square(32, 32, false, |x, y| if (x, y) == (20, 9) { 255 } else { 0 });
    let e = Emitters::of(&scene, true).unwrap();
    let bright = PI * 4.0 / 1024.0;
    assert!((e.power.x / bright - 1.0).abs() < 0.01, "{} of {bright}", e.power.x);
    // Its light, spread over 2 x 2 texels by interpolation, touches at most 2 x 2 parts of 4 x 4 texels.
    assert!((1..=4).contains(&e.list.len()), "{} parts", e.list.len());
    assert!(e.list.iter().all(|part| (part.area - 4.0 / 64.0).abs() < 1e-6));
    let [flux, first] = moments(&e, &scene);
    assert!((flux / bright - 1.0).abs() < 0.02, "{flux} of {bright}");
    assert!((first / flux - 20.5 / 16.0).abs() < 0.01, "{}", first / flux);
    // Each start is on the part that its position belongs to, whose density is the probability over the area.
    for i in 0..1000 {
        let start = e.sample_start(&scene.textures, halton(0, i), halton(1, i), 0.5);
        assert_eq!(e.at(u32::from(start.position.y > start.position.x), start.position), start.emitter);
        let part = &e.list[start.emitter as usize];
        let (flux, expected) = (start.flux, start.radiance * (PI * part.area / part.probability));
        assert!((flux - expected).abs().max_element() <= 1e-5 * expected.max_element(), "{flux} {expected}");
    }
    assert_eq!(e.at(0, Vec3::new(1.9, 0.1, 0.0)), NO_EMITTER);
}

#[test]
fn divided_triangles_cover_themselves() {
    // Bright near one corner of the first triangle, which is no quad: its neighbour's coordinates lie elsewhere.
    let scene = square(64, 64, true, |x, y| if x > 40 && y < 20 { 250 } else { u8::from(x % 7 == 0) });
    let e = Emitters::of(&scene, true).unwrap();
    let parts = &e.parts[&e.of_triangle[0]];
    let area: f32 = parts.cells.iter().filter(|&&c| c != NO_EMITTER).map(|&c| e.list[c as usize].area).sum();
    assert!(parts.cells.len() > 1 && (area - 2.0).abs() < 1e-5, "{} parts, area {area}", parts.cells.len());
    for i in 0..2000 {
        // Away from the borders of parts.
        let [u, v] = [halton(0, i) + 0.1234567, halton(1, i) + 0.3141593].map(f32::fract);
        let start = e.sample_start(&scene.textures, u, v, 0.5);
        if start.position.y > start.position.x {
            continue;
        }
        assert_eq!(e.at(0, start.position), start.emitter, "{}", start.position);
        let (x, y) = (start.position.x / 2.0, start.position.y / 2.0);
        let texel = sample_texture(&scene.textures[0], [x, y]).x;
        assert!((start.radiance.x - texel).abs() < 1e-4, "{} {texel}", start.radiance.x);
    }
}

#[test]
fn black_textures_emit_nothing() {
    let message = Emitters::of(&square(8, 8, false, |_, _| 0), true).unwrap_err().to_string();
    assert!(message.contains("total power of 0"), "{message}");
}

#[test]
fn particles_have_the_flux_of_their_point_by_the_record() {
    let scene = square(16, 16, false, |x, y| (x * y) as u8);
    let e = Emitters::of(&scene, true).unwrap();
    let (records, textures) = (e.records(), &scene.textures);
    for i in 0..100 {
        let [u, v] = [halton(0, i), halton(1, i)];
        let start = e.sample_start(textures, u, v, 0.5);
        let r = &records[start.emitter as usize];
        let (_, along) = e.choose(u);
        let uv = [r.uv[0] + along * r.uv[2] + v * r.pattern[0], r.uv[1] + along * r.uv[3] + v * r.pattern[1]];
        assert_eq!(r.pattern[2].to_bits(), 1f32.to_bits() | 1);
        let flux = r.flux[0] * sample_texture(&textures[0], uv).x;
        assert!((flux - start.flux.x).abs() <= 1e-4 * start.flux.x.max(1e-3), "{flux} {}", start.flux.x);
    }
}
