use super::*;
use crate::sampling::halton::halton;
use crate::sampling::random::random_f32;

fn direction(theta: f32, phi: f32) -> Vec3 {
    Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

/// Midpoint rule over the hemisphere, uniform in cos^2 and phi, so that the weight is cos d omega = pi / (rows columns).
fn integrate(rows: u32, columns: u32, mut f: impl FnMut(Vec3) -> Vec3) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for i in 0..rows {
        for j in 0..columns {
            sum += f(sample_diffuse([(i as f32 + 0.5) / rows as f32, (j as f32 + 0.5) / columns as f32]));
        }
    }
    sum * (PI / (rows * columns) as f32)
}

const KINDS: [(f32, f32, f32, f32); 6] = [
    // base, metallic, roughness, specular
    (0.8, 0.0, 1.0, 0.0),
    (1.0, 0.0, 0.3, 0.04),
    (1.0, 0.0, 0.7, 0.5),
    (0.9, 1.0, 0.4, 0.04),
    (1.0, 1.0, 1.0, 0.0),
    (1.0, 0.5, 0.5, 1.0),
];

fn reflectances() -> impl Iterator<Item = Reflectance> {
    KINDS.iter().map(|&(b, m, r, s)| Reflectance::new(Vec3::new(b, b * 0.5, b * 0.1), m, r, Vec3::splat(s)))
}

#[test]
fn reciprocal() {
    let n = direction(0.4, 2.0);
    for r in reflectances() {
        for i in 0..200 {
            let (t, b) = basis(n);
            let world = |w: Vec3| t * w.x + b * w.y + n * w.z;
            let wi = world(sample_diffuse([halton(0, i), halton(1, i)]));
            let wo = world(sample_diffuse([halton(2, i), halton(3, i)]));
            let (forward, backward) = (r.eval(&[], n, wi, wo), r.eval(&[], n, wo, wi));
            assert!((forward - backward).abs().max_element() <= 1e-4 * forward.max_element(), "{forward} {backward}");
        }
    }
}

#[test]
fn mean_albedo_is_at_most_one() {
    for &(_, m, r, s) in &KINDS {
        let white = Reflectance::new(Vec3::ONE, m, r, Vec3::splat(s));
        let mut total = 0.0;
        for k in 0..16 {
            // Uniform in cos^2: the plain mean is the cosine-weighted one.
            let wo = sample_diffuse([(k as f32 + 0.5) / 16.0, 0.1]);
            total += integrate(256, 256, |wi| white.eval(&[], Vec3::Z, wi, wo)).x / 16.0;
        }
        assert!(total <= 1.003, "metallic {m}, roughness {r}, specular {s}: {total}");
        assert!(total > 0.4, "metallic {m}, roughness {r}, specular {s}: {total}");
    }
}

#[test]
fn lobe_albedo_is_at_most_one_for_each_direction() {
    for roughness in [0.3, 0.5, 0.8, 1.0] {
        let white = Reflectance::new(Vec3::ONE, 1.0, roughness, Vec3::ZERO);
        for theta in [0.1, 0.7, 1.2, 1.5] {
            let albedo = integrate(400, 400, |wi| white.eval_specular(&[], Vec3::Z, wi, direction(theta, 0.3))).x;
            assert!(albedo <= 1.01 && albedo > 0.3, "roughness {roughness}, theta {theta}: {albedo}");
        }
    }
}

#[test]
fn no_lobe_without_specular() {
    let r = Reflectance::new(Vec3::splat(0.7), 0.0, 0.2, Vec3::ZERO);
    assert_eq!((r.kd, r.f90, r.diffuse_probability()), (Vec3::splat(0.7), 0.0, 1.0));
    assert_eq!(r.eval(&[], Vec3::Z, direction(0.3, 1.0), direction(0.3, 4.14)), Vec3::splat(0.7 / PI));
    assert_eq!(r.eval(&[], Vec3::Z, direction(1.6, 1.0), direction(0.3, 4.14)), Vec3::ZERO);
}

/// Counts samples in cells of the hemisphere and compares with the density integrated over each.
pub(super) fn check_sampling(name: &str, sample: impl Fn([f32; 2]) -> Vec3, pdf: impl Fn(Vec3) -> f32) {
    let (rows, columns, count) = (12usize, 16usize, 1u32 << 18);
    let cell = |w: Vec3| {
        let row = ((1.0 - w.z) * rows as f32) as usize;
        let phi = w.y.atan2(w.x) / TAU;
        let column = ((phi - phi.floor()) * columns as f32) as usize;
        row.min(rows - 1) * columns + column.min(columns - 1)
    };
    let mut counts = vec![0u32; rows * columns];
    for i in 0..count {
        let w = sample([random_f32(2 * i), random_f32(2 * i + 1)]);
        if w.z > 0.0 {
            counts[cell(w)] += 1;
        }
    }
    let fine = 24;
    let (mut chi2, mut cells) = (0.0f64, 0);
    for row in 0..rows {
        for column in 0..columns {
            let mut expected = 0.0f64;
            for i in 0..fine {
                for j in 0..fine {
                    let z = 1.0 - (row as f32 + (i as f32 + 0.5) / fine as f32) / rows as f32;
                    let phi = (column as f32 + (j as f32 + 0.5) / fine as f32) / columns as f32 * TAU;
                    let s = (1.0 - z * z).sqrt();
                    expected += f64::from(pdf(Vec3::new(s * phi.cos(), s * phi.sin(), z)));
                }
            }
            let area = f64::from(TAU) / (rows * columns * fine * fine) as f64;
            expected *= area * f64::from(count);
            if expected > 20.0 {
                let difference = f64::from(counts[row * columns + column]) - expected;
                chi2 += difference * difference / expected;
                cells += 1;
            }
        }
    }
    // Mean 1 a cell, deviation sqrt(2 / cells); the quadrature's own error takes some of the margin.
    let limit = 1.0 + 6.0 * (2.0 / f64::from(cells)).sqrt();
    assert!(cells > 20 && chi2 / f64::from(cells) < limit, "{name}: chi^2 {chi2} of {cells} cells");
}

#[test]
fn samples_follow_their_density() {
    check_sampling("diffuse", sample_diffuse, |w| w.z / PI);
    for (theta, alpha) in [(0.0, 0.5), (0.6, 0.4), (1.3, 0.3), (1.0, 1.0)] {
        let wo = direction(theta, 0.8);
        check_sampling(
            "specular",
            |u| sample_specular(wo, Vec2::splat(alpha), u),
            |wi| pdf_specular(&[], Vec3::Z, wi, wo, alpha),
        );
    }
    for r in reflectances() {
        let wo = direction(0.8, 2.0);
        check_sampling(
            "both",
            |u| r.sample(&[], Vec3::Z, wo, random_f32(u[0].to_bits()), u),
            |wi| r.pdf(&[], Vec3::Z, wi, wo),
        );
    }
}

#[test]
fn white_furnace_by_sampling() {
    // The sampled estimate of the albedo equals the quadrature's.
    for r in reflectances() {
        let wo = direction(0.9, 0.2);
        let expected = integrate(500, 500, |wi| r.eval(&[], Vec3::Z, wi, wo));
        let count = 1u32 << 16;
        let mut estimate = Vec3::ZERO;
        for i in 0..count {
            let wi = r.sample(&[], Vec3::Z, wo, halton(2, i), [halton(0, i), halton(1, i)]);
            let pdf = r.pdf(&[], Vec3::Z, wi, wo);
            if pdf > 0.0 {
                estimate += r.eval(&[], Vec3::Z, wi, wo) * (wi.z / pdf / count as f32);
            }
        }
        let error = (estimate - expected).abs().max_element();
        assert!(error < 0.004 * expected.max_element().max(0.1), "{r:?}: {estimate} for {expected}");
    }
}

#[test]
fn narrow_lobes_keep_their_energy() {
    // Roughness 0: alpha is at its floor. Sampled weight F G2 / G1 must average to nearly F.
    let r = Reflectance::new(Vec3::ONE, 1.0, 0.0, Vec3::ZERO);
    let wo = direction(0.5, 1.0);
    let mut total = 0.0;
    for i in 0..4096 {
        let wi = sample_specular(wo, Vec2::splat(r.alpha), [halton(0, i), halton(1, i)]);
        total += r.eval_specular(&[], Vec3::Z, wi, wo).x * wi.z / pdf_specular(&[], Vec3::Z, wi, wo, r.alpha) / 4096.0;
    }
    assert!((total - 1.0).abs() < 1e-3, "{total}");
}

#[test]
fn bases_are_orthonormal() {
    let mut normals =
        vec![Vec3::Z, -Vec3::Z, Vec3::X, -Vec3::Y, Vec3::new(1e-20, 0.0, -1.0), Vec3::new(0.0, 1.0, -0.0)];
    normals.extend((0..200).map(|i| direction(halton(0, i) * PI, halton(1, i) * TAU)));
    for n in normals {
        let (t, b) = basis(n);
        for x in [t.dot(b), t.dot(n), b.dot(n), t.length() - 1.0, b.length() - 1.0] {
            assert!(x.abs() < 1e-6, "{n}");
        }
        assert!(t.cross(b).dot(n) > 0.99, "{n} is left-handed");
    }
}

#[test]
fn normals_face_the_viewer() {
    let seen_from_behind = Normals::facing(Vec3::Z, direction(0.3, 0.0), -Vec3::Z);
    assert!(!seen_from_behind.front);
    assert_eq!(seen_from_behind.geometric, -Vec3::Z);
    assert_eq!(seen_from_behind.shading, -direction(0.3, 0.0));
    let n = Normals::facing(Vec3::Z, direction(0.5, 0.0), Vec3::Z);
    assert!(n.above(Vec3::Z) && !n.above(direction(1.5, PI)) && !n.above(direction(1.7, 0.0)));
}

#[test]
fn fresnel_values() {
    // Unpolarised, n = 1.5 from outside.
    for (degrees, expected) in [
        (0.0f32, 0.04),
        (30.0, 0.041523),
        (45.0, 0.050240),
        (56.3099, 0.073964),
        (60.0, 0.089187),
        (70.0, 0.171043),
        (75.0, 0.253061),
        (80.0, 0.387704),
        (85.0, 0.612800),
        (89.0, 0.904185),
    ] {
        let (r, _) = fresnel_dielectric(degrees.to_radians().cos(), 1.5);
        assert!((r - expected).abs() < 3e-6, "{degrees}: {r}");
    }
    assert!((fresnel_dielectric(1.0, 1.33).0 - 0.020059).abs() < 1e-6);
    assert!((fresnel_dielectric(60f32.to_radians().cos(), 1.33).0 - 0.059126).abs() < 1e-6);
    // From inside.
    for (degrees, expected) in [(40.0f32, 0.245291), (41.0, 0.379751)] {
        assert!((fresnel_dielectric(degrees.to_radians().cos(), 1.0 / 1.5).0 - expected).abs() < 2e-5);
    }
    assert_eq!(fresnel_dielectric(41.9f32.to_radians().cos(), 1.0 / 1.5), (1.0, None));
    // Hemispherical means.
    for (eta, expected) in [(1.5, 0.0918), (1.0 / 1.5, 0.5963)] {
        let mean = integrate(4000, 1, |w| Vec3::splat(fresnel_dielectric(w.z, eta).0)).x / PI;
        assert!((mean - expected).abs() < 2e-4, "{mean}");
    }
}

fn checker(wrap: Wrap, srgb: bool) -> Texture {
    Texture {
        name: String::from("checker"),
        width: 2,
        height: 2,
        texels: vec![[0, 0, 0, 255], [255, 0, 0, 255], [0, 255, 0, 255], [128, 128, 128, 128]],
        srgb,
        wrap: [wrap; 2],
    }
}

#[test]
fn texture_lookup() {
    let t = checker(Wrap::Repeat, false);
    // Texel centres.
    assert_eq!(sample_texture(&t, [0.25, 0.25]), Vec4::new(0.0, 0.0, 0.0, 1.0));
    assert_eq!(sample_texture(&t, [0.75, 0.25]), Vec4::new(1.0, 0.0, 0.0, 1.0));
    assert_eq!(sample_texture(&t, [0.25, 0.75]), Vec4::new(0.0, 1.0, 0.0, 1.0));
    // Periodic, also far out and below 0.
    for shift in [-3.0, -1.0, 1.0, 64.0] {
        assert_eq!(sample_texture(&t, [0.75 + shift, 0.25 - shift]), Vec4::new(1.0, 0.0, 0.0, 1.0));
    }
    // Between texels, and across the border.
    assert_eq!(sample_texture(&t, [0.5, 0.25]).x, 0.5);
    assert_eq!(sample_texture(&t, [0.0, 0.25]).x, 0.5);
    assert_eq!(sample_texture(&checker(Wrap::Clamp, false), [0.0, 0.25]).x, 0.0);
    assert_eq!(sample_texture(&checker(Wrap::Clamp, false), [9.0, 0.25]).x, 1.0);
    let m = checker(Wrap::Mirror, false);
    assert_eq!(sample_texture(&m, [0.0, 0.25]).x, 0.0);
    assert_eq!(sample_texture(&m, [1.25, 0.25]).x, 1.0);
    assert_eq!(sample_texture(&m, [-0.75, 0.25]).x, 1.0);
    // Decoded before filtering; alpha linear.
    let s = sample_texture(&checker(Wrap::Repeat, true), [0.75, 0.75]);
    assert!((s.x - 0.215861).abs() < 1e-5 && (s.w - 128.0 / 255.0).abs() < 1e-6, "{s}");
    assert_eq!(sample_texture(&checker(Wrap::Repeat, true), [0.5, 0.25]).x, 0.5);
}

#[test]
fn widened_lobes_reflect_as_much() {
    let n = direction(0.3, 1.0);
    for f0 in [0.04, 0.5, 1.0] {
        for alpha in [0.01, 0.1, 0.2] {
            let r = Reflectance { kd: Vec3::ZERO, f0: Vec3::splat(f0), f90: 1.0, alpha };
            for theta in [0.0, 0.5, 1.0, 1.3] {
                let (t, b) = basis(n);
                let local = direction(theta, 0.7);
                let wo = t * local.x + b * local.y + n * local.z;
                let wide = r.widened(&[], n, wo, 0.25);
                assert_eq!(wide.alpha, 0.25);
                // Of the wide lobe by another rule: the hemisphere's midpoints.
                let world = |w: Vec3| t * w.x + b * w.y + n * w.z;
                let albedo = integrate(400, 800, |w| wide.eval_specular(&[], n, world(w), wo)).x;
                let points =
                    (0..4096).map(|i| r.sample_lobe(&[], false, n, wo, (i as f32 + 0.5) / 4096.0, halton(2, i)).1.x);
                let exact = points.sum::<f32>() / 4096.0;
                assert!(
                    (albedo / exact - 1.0).abs() < 0.03,
                    "f0 {f0}, alpha {alpha}, theta {theta}: {albedo} for {exact}"
                );
            }
            assert_eq!(r.widened(&[], n, n, alpha), r);
        }
    }
}

#[test]
fn normal_maps_lean_along_u_and_against_v() {
    let texel = |n: Vec3| (n.normalize() + 1.0) * 0.5;
    let (edges, n) = ([Vec3::X * 2.0, Vec3::Y * 3.0], Vec3::Z);
    let along = |local: Vec3, uv: [Vec2; 2]| mapped_normal(texel(local), 1.0, edges, uv, n);
    let (right, up) = (Vec3::new(1.0, 0.0, 1.0), Vec3::new(0.0, 1.0, 1.0));
    let close = |a: Vec3, b: Vec3| assert!((a - b.normalize()).length() < 1e-6, "{a} {b}");
    // An image upright on the plane: u to the right, v downwards.
    let upright = [Vec2::X, Vec2::NEG_Y];
    close(along(right, upright), Vec3::new(1.0, 0.0, 1.0));
    close(along(up, upright), Vec3::new(0.0, 1.0, 1.0));
    // Mirrored: u to the left.
    close(along(right, [Vec2::NEG_X, Vec2::NEG_Y]), Vec3::new(-1.0, 0.0, 1.0));
    close(along(up, [Vec2::NEG_X, Vec2::NEG_Y]), Vec3::new(0.0, 1.0, 1.0));
    // Turned by a quarter.
    close(along(right, [Vec2::Y, Vec2::X]), Vec3::new(0.0, 1.0, 1.0));
    close(along(up, [Vec2::Y, Vec2::X]), Vec3::new(-1.0, 0.0, 1.0));
    // No area, and the whole range of the scale.
    close(along(right, [Vec2::X, Vec2::X]), n);
    close(mapped_normal(texel(right), 0.0, edges, upright, n), n);
    // About a normal that is not that of the face, the result leans from that normal, and has unit length.
    let smooth = Vec3::new(0.3, -0.2, 1.0).normalize();
    let mapped = mapped_normal(texel(Vec3::new(0.0, 0.0, 1.0)), 1.0, edges, upright, smooth);
    close(mapped, smooth);
    let mapped = mapped_normal(texel(right), 1.0, edges, upright, smooth);
    assert!((mapped.dot(smooth) - 0.5f32.sqrt()).abs() < 1e-5 && mapped.x > smooth.x, "{mapped}");
}
