use super::*;
use crate::bsdf::phong::{widened_alpha, width_of as width};
use crate::bsdf::{Reflectance, pdf_specular};
use crate::sampling::halton::halton;
use std::f64::consts::PI as PI_64;

const ALPHAS: [[f32; 2]; 4] = [[0.6, 0.15], [0.1, 0.5], [1.0, 0.05], [0.3, 0.3]];

fn white(alpha: f32) -> Reflectance {
    Reflectance { kd: Vec3::ZERO, f0: Vec3::ONE, f90: 1.0, alpha }
}

fn direction(degrees: f32, azimuth: f32) -> Vec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
}

#[test]
fn numbers_hold_both_widths_and_the_direction() {
    for i in 0..500 {
        let n = Vec3::new(halton(0, i) - 0.5, halton(1, i) - 0.5, halton(2, i) - 0.5).normalize();
        let along = n.any_orthonormal_vector().rotate_axis(n, 7.0 * halton(3, i));
        let alphas = Vec2::new(1e-3f32.powf(halton(4, i)), 1e-3f32.powf(halton(5, i)));
        let packed = pack(alphas, along, n);
        let grain = unpack(packed, n).unwrap();
        assert!(packed.is_finite() && packed >= 2.0);
        assert!(((grain.alphas - alphas) / alphas).abs().max_element() < 0.0072, "{grain:?} for {alphas}");
        assert!(grain.along.cross(along).length() < 6e-4, "{grain:?} for {along}");
        assert!(grain.along.cross(grain.across).distance(n) < 1e-5 && grain.along.is_normalized());
        // Again, about another normal and back.
        assert_eq!(pack(grain.alphas, grain.along, n), packed);
        let other = (n + 0.1 * along).normalize();
        let there = unpack(turned(packed, n, other), other).unwrap();
        assert!(there.along.dot(other).abs() < 1e-5 && there.alphas == grain.alphas);
        assert_eq!(turned(0.25, n, other), 0.25);
        assert!((width(packed) / (alphas.x * alphas.y).sqrt() - 1.0).abs() < 0.0072);
        let wide = unpack(widened_alpha(packed, 0.25), n).unwrap();
        assert!((wide.alphas / grain.alphas.max(Vec2::splat(0.25)) - 1.0).abs().max_element() < 1e-5, "{wide:?}");
    }
}

#[test]
fn with_one_width_it_is_the_lobe_of_that_width() {
    let n = direction(20.0, 1.0);
    // A power of two is a step.
    let (two, one) = (white(pack(Vec2::splat(0.25), Vec3::X, n)), white(0.25));
    for i in 0..200 {
        let [wi, wo] = [0, 2].map(|d| (direction(89.0 * halton(d, i), 7.0 * halton(d + 1, i)) + n).normalize());
        let (a, b) = (two.eval_specular(&[], n, wi, wo).x, one.eval_specular(&[], n, wi, wo).x);
        assert!((a - b).abs() <= 1e-4 * b, "{a} for {b}");
        let (a, b) = (pdf_specular(&[], n, wi, wo, two.alpha), pdf_specular(&[], n, wi, wo, 0.25));
        assert!((a - b).abs() <= 1e-4 * b, "{a} for {b}");
    }
}

#[test]
fn a_furnace_keeps_its_light_and_swapped_directions_reflect_alike() {
    for [along, across] in ALPHAS {
        let r = white(pack(Vec2::new(along, across), direction(90.0, 0.7), Vec3::Z));
        for (degrees, azimuth) in [(0.0, 0.0), (40.0, 0.7), (40.0, 2.3), (70.0, 1.3), (85.0, 0.7)] {
            let wo = direction(degrees, azimuth);
            let n = 400;
            let (mut sampled, mut integrated, mut density) = (0.0, 0.0, 0.0);
            for i in 0..n * n {
                let u = [i % n, i / n].map(|k| (k as f32 + 0.5) / n as f32);
                sampled += f64::from(r.sample_lobe(&[], false, Vec3::Z, wo, u[0], u[1]).1.x);
                // Over the hemisphere of half vectors, denser where the normals of a narrow lobe are: t = (pi / 2) s^3.
                let s = f64::from(u[0]);
                let (sin, cos) = (0.5 * PI_64 * s.powi(3)).sin_cos();
                let (y, x) = (2.0 * std::f32::consts::PI * u[1]).sin_cos();
                let h = Vec3::new(x * sin as f32, y * sin as f32, cos as f32);
                let cos_h = wo.dot(h);
                let wi = h * (2.0 * cos_h) - wo;
                let solid_angle = 2.0 * PI_64 * sin * 1.5 * PI_64 * s * s * 4.0 * f64::from(cos_h.max(0.0));
                integrated += f64::from(r.eval_specular(&[], Vec3::Z, wi, wo).x * wi.z.max(0.0)) * solid_angle;
                density += f64::from(pdf_specular(&[], Vec3::Z, wi, wo, r.alpha)) * solid_angle;
                let (one, other) = (r.eval_specular(&[], Vec3::Z, wi, wo).x, r.eval_specular(&[], Vec3::Z, wo, wi).x);
                assert!((one - other).abs() <= 1e-3 * one, "{along} {across}: {one} and {other}");
            }
            let [sampled, integrated, density] = [sampled, integrated, density].map(|sum| sum / f64::from(n * n));
            println!("{along} {across}, {degrees} degrees: {sampled:.4} {integrated:.4}, density {density:.4}");
            assert!((sampled - integrated).abs() < 5e-3, "{along} {across}, {degrees}: {sampled} {integrated}");
            assert!(sampled < 1.005 && sampled > 0.5, "{along} {across}, {degrees}: {sampled}");
            // The rest of the directions goes below the horizon.
            assert!(density < 1.005 && density > 0.6, "{along} {across}, {degrees}: {density}");
        }
    }
}

#[test]
fn samples_follow_their_density() {
    for [along, across] in ALPHAS {
        let alpha = pack(Vec2::new(along, across), direction(90.0, 0.4), Vec3::Z);
        for (degrees, azimuth) in [(0.0, 0.0), (50.0, 1.0), (75.0, 2.5)] {
            let wo = direction(degrees, azimuth);
            let sample = |u| white(alpha).sample_of_lobe(&[], Vec3::Z, wo, u);
            crate::bsdf::tests::check_sampling("two widths", sample, |wi| pdf_specular(&[], Vec3::Z, wi, wo, alpha));
        }
    }
}

/// The reflection of light from the normal is widest along the grain.
#[test]
fn lobes_are_wide_along_the_grain() {
    let r = white(pack(Vec2::new(0.5, 0.1), Vec3::Y, Vec3::Z));
    let towards = |x: f32, y: f32| r.eval_specular(&[], Vec3::Z, Vec3::new(x, y, 1.0).normalize(), Vec3::Z).x;
    assert!(towards(0.0, 0.6) > 10.0 * towards(0.6, 0.0));
    // At half vectors of slopes in the ratio of the alphas D differs by cos^-4 alone.
    let of_slope = |x: f32, y: f32| {
        let h = Vec3::new(x, y, 1.0).normalize();
        unpack(r.alpha, Vec3::Z).unwrap().distribution(Vec3::Z, h) * h.z.powi(4)
    };
    assert!((of_slope(0.05, 0.0) / of_slope(0.0, 0.25) - 1.0).abs() < 0.02);
}

#[test]
fn the_grain_runs_along_u_or_a_fixed_direction() {
    let edges = [Vec3::X * 2.0, Vec3::Y * 3.0];
    let close = |a: Vec3, b: Vec3| assert!(a.cross(b).length() < 1e-6 && a.is_normalized(), "{a} {b}");
    let turn = 0.3f32;
    let (sin, cos) = turn.sin_cos();
    // An image upright on the plane, u to the right and v downwards: counter-clockwise. Mirrored: clockwise as seen.
    let upright = [Vec2::X, Vec2::NEG_Y];
    close(grain(edges, upright, 0.0, Vec3::Z), Vec3::X);
    close(grain(edges, upright, turn, Vec3::Z), Vec3::new(cos, sin, 0.0));
    close(grain(edges, [Vec2::NEG_X, Vec2::NEG_Y], turn, Vec3::Z), Vec3::new(-cos, sin, 0.0));
    close(grain(edges, [Vec2::Y, Vec2::X], 0.0, Vec3::Z), Vec3::Y);
    // Without coordinates: level on walls, +x on floors.
    let none = [Vec2::ZERO; 2];
    close(grain(edges, none, 0.0, Vec3::Z), Vec3::X);
    close(grain(edges, none, 0.0, Vec3::X), Vec3::Z);
    close(grain(edges, none, turn, Vec3::Y), Vec3::new(cos, 0.0, -sin));
    close(grain(edges, none, 0.0, Vec3::new(0.6, 0.8, 0.0)), Vec3::Z);
    // About a normal that is not that of the face it is perpendicular to it.
    let smooth = Vec3::new(0.3, -0.2, 1.0).normalize();
    let along = grain(edges, upright, turn, smooth);
    assert!(along.dot(smooth).abs() < 1e-6 && along.is_normalized(), "{along}");
}
