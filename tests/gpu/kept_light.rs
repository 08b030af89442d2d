//! How exact kept light is: its order in the width of a texel.

use glam::Vec3;
use lightsum::scene::Light;
use lightsum::settings::Settings;

use crate::bake::{at_density, baked, plain};
use crate::scenes::Soup;
use crate::support::gpu_test;

/// Errors of a map.
#[derive(Debug)]
struct Errors {
    /// Width of its texels.
    width: f64,
    /// Root mean square, relative to the mean irradiance.
    rms: f64,
    /// The greatest, relative to the greatest irradiance.
    worst: f64,
}

#[test]
fn where_light_is_smooth_its_error_falls_with_the_square_of_the_texel() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("plane");
        let white = soup.diffuse(0.7, 0.0);
        soup.quad(Vec3::ZERO, 4.0 * Vec3::Z, 4.0 * Vec3::X, white);
        let (light, intensity) = (Vec3::new(2.3, 2.0, 1.8), 9.0);
        soup.0.lights.push(Light::Point { position: light, intensity: Vec3::splat(intensity) });
        let scene = soup.0;
        let settings = Settings { particles: 1, max_depth: 2, ..plain() };
        let errors = |density: f32| {
            let (bake, map) = baked(ctx, &scene, &settings, at_density(density), 34);
            let [a, b, _] = bake.charts().faces[0].corners;
            let width = 4.0 / f64::from((b - a).abs().max_element());
            let kept = map.kept(&scene);
            let (mut square, mut sum, mut count, mut worst, mut most) = (0.0, 0.0, 0, 0.0f64, 0.0f64);
            const N: u32 = 300;
            for i in 0..N * N {
                let [s, t] = [i % N, i / N].map(|n| (n as f32 + 0.5) / N as f32);
                for triangle in (0..2).filter(|_| s + t < 1.0) {
                    let [a, b, c] = scene.triangle_positions(triangle);
                    let to = light - (a + s * (b - a) + t * (c - a));
                    let expected = f64::from(intensity * to.y) / f64::from(to.length()).powi(3);
                    let [direct, indirect] = kept.irradiance(triangle as u32, false, [s, t]);
                    assert_eq!(indirect, Vec3::ZERO);
                    let difference = (f64::from(direct.y) - expected).abs();
                    (square, sum, count) = (square + difference * difference, sum + expected, count + 1);
                    (worst, most) = (worst.max(difference), most.max(expected));
                }
            }
            Errors { width, rms: (square * f64::from(count)).sqrt() / sum, worst: worst / most }
        };
        let of = [4.0, 8.0, 16.0].map(errors);
        for (coarse, fine) in of.iter().zip(&of[1..]) {
            let halvings = (coarse.width / fine.width).log2();
            let orders = [coarse.rms / fine.rms, coarse.worst / fine.worst].map(|ratio| ratio.log2() / halvings);
            assert!(halvings > 0.9 && orders.iter().all(|order| (order - 2.0).abs() < 0.15), "{orders:?} of {of:?}");
        }
    });
}
