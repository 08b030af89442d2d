use super::*;
use crate::bsdf::{Reflectance, pdf_specular};
use std::f64::consts::PI;

fn lobe(exponent: f32) -> Reflectance {
    Reflectance { kd: Vec3::ZERO, f0: Vec3::ONE, f90: 1.0, alpha: -exponent }
}

fn from(degrees: f32) -> Vec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    Vec3::new(sin, 0.0, cos)
}

#[test]
fn a_furnace_keeps_its_light_and_swapped_directions_reflect_alike() {
    for (exponent, horizon) in [(1.0, 0.86), (5.0, 0.8), (50.0, 0.8), (500.0, 0.85)] {
        let r = lobe(exponent);
        for degrees in [0.0, 20.0, 40.0, 60.0, 75.0, 88.0] {
            let wo = from(degrees);
            let n = 200;
            // By the lobe's own directions, and on a grid of the sphere about the mirror direction.
            let (mut sampled, mut integrated, mut density) = (0.0, 0.0, 0.0);
            for i in 0..n * n {
                let u = [i % n, i / n].map(|k| (k as f32 + 0.5) / n as f32);
                sampled += f64::from(r.sample_lobe(&[], false, Vec3::Z, wo, u[0], u[1]).1.x);
                // sin t dt, with smaller steps where the lobe is: t = pi s^3.
                let s = f64::from(u[0]);
                let (sin, cos) = (PI * s.powi(3)).sin_cos();
                let solid_angle = 2.0 * PI * sin * 3.0 * PI * s * s;
                let (t, b) = basis(reflect(wo, Vec3::Z));
                let (y, x) = (TAU * u[1]).sin_cos();
                let wi = (t * x + b * y) * sin as f32 + reflect(wo, Vec3::Z) * cos as f32;
                integrated += f64::from(r.eval_specular(&[], Vec3::Z, wi, wo).x * wi.z.max(0.0)) * solid_angle;
                density += f64::from(pdf_specular(&[], Vec3::Z, wi, wo, r.alpha)) * solid_angle;
                let (one, other) = (r.eval_specular(&[], Vec3::Z, wi, wo).x, r.eval_specular(&[], Vec3::Z, wo, wi).x);
                assert!((one - other).abs() <= 1e-3 * one, "exponent {exponent}: {one} and {other}");
            }
            let [sampled, integrated, density] = [sampled, integrated, density].map(|sum| sum / f64::from(n * n));
            println!("exponent {exponent}, {degrees} degrees: {sampled:.4} {integrated:.4}, density {density:.4}");
            assert!((sampled - integrated).abs() < 4e-3, "exponent {exponent}, {degrees}: {sampled} {integrated}");
            assert!((horizon..1.016).contains(&sampled), "exponent {exponent}, {degrees} degrees: {sampled}");
            assert!(degrees > 0.0 || (sampled - 1.0).abs() < 2e-3, "exponent {exponent}: {sampled}");
            // The rest of the directions goes below the horizon.
            assert!(density < 1.001 && density > 0.49, "exponent {exponent}, {degrees} degrees: {density}");
        }
    }
}

#[test]
fn where_the_cosines_are_alike_the_intensity_is_that_of_the_paper() {
    // I = F (d + 1) / (2 pi) cos^d, towards the mirror direction and at the half angle in the plane across.
    for d in [5.0f32, 50.0, 1000.0] {
        for degrees in [0.0, 30.0] {
            let (wo, r) = (from(degrees), reflect(from(degrees), Vec3::Z));
            let half = 2f32.powf(-1.0 / d).acos();
            let across = r * half.cos() + Vec3::Y * half.sin();
            for (w, share) in [(r, 1.0), (across, 0.5)] {
                let found = lobe(d).eval_specular(&[], Vec3::Z, wo, w).x * w.z;
                let expected = share * (d + 1.0) / TAU * w.z / (wo.z.max(w.z) * kept(wo.z, d).max(kept(w.z, d)));
                assert!((found / expected - 1.0).abs() < 2e-3, "{d}, {degrees}: {found} for {expected}");
                // Of narrow lobes nothing is below the horizon.
                let of_paper = share * (d + 1.0) / TAU;
                assert!(d < 500.0 || (found / of_paper - 1.0).abs() < 0.02, "{d}, {degrees}: {found} for {of_paper}");
            }
        }
    }
}

#[test]
fn wide_lobes_stay_and_narrow_ones_are_widened() {
    assert_eq!((width_of(0.3), exponent_of(0.3)), (0.3, None));
    assert_eq!((width_of(-50.0), exponent_of(-50.0)), (0.1, Some(50.0)));
    assert_eq!((widened_alpha(-4.0, 0.25), widened_alpha(-50.0, 0.25)), (-4.0, -8.0));
    let wide = lobe(50.0).widened(&[], Vec3::Z, from(40.0), 0.25);
    assert_eq!(wide.alpha, -8.0);
    let [narrow, wide] = [lobe(50.0), wide].map(|r| r.lobe_albedo(&[], Vec3::Z, from(40.0)));
    assert!((wide / narrow - 1.0).abs() < 0.01, "{wide} for {narrow}");
}
