//! The choice of lights for clusters of shading points keeps the energy.

use glam::Vec3;
use lightsum::conform::checks::light_lists::settings;
use lightsum::scene::Scene;
use lightsum::settings::{Compensation, Settings, Traversal};

use crate::scenes::{Soup, camera, mean, render};
use crate::support::gpu_test;

/// A room whose lamp shines at the ceiling from behind a shelf.
fn room() -> Scene {
    let mut soup = Soup::new("room");
    let (white, red, lamp) = (soup.diffuse(0.7, 0.0), soup.diffuse([0.6, 0.1, 0.1], 0.0), soup.diffuse(0.0, 20.0));
    soup.room(Vec3::ZERO, Vec3::splat(2.0), [white, red, white, white, white, white]);
    soup.quad(Vec3::new(0.4, 1.2, 0.4), Vec3::X * 0.6, Vec3::Z * 0.6, white);
    soup.quad(Vec3::new(0.5, 1.3, 0.9), Vec3::Z * -0.3, Vec3::X * 0.3, lamp);
    soup.0
}

#[test]
fn a_pool_keeps_the_energy() {
    gpu_test(|ctx| {
        let scene = room();
        let view = camera(Vec3::new(1.7, 0.9, 1.8), Vec3::new(0.6, 0.7, 0.4), 60.0, [48, 48]);
        let base = Settings { compensation: Compensation::Off, ..settings([3, 3], Traversal::Cluster) };
        let energy = |light_pool, particles, passes| {
            let settings = Settings { light_pool, particles, ..base.clone() };
            mean(&render(ctx, &scene, view, &settings, passes).color).element_sum()
        };
        let without = energy(0, 24, 96);
        // From the larger one regions choose first.
        for pool in [100, 700] {
            let ratio = energy(pool, 6, 96) / without;
            println!("energy with a pool of {pool} over energy without: {ratio:.4}");
            assert!((ratio - 1.0).abs() < 0.02, "{pool}: {ratio}");
        }
    });
}
