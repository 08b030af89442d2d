//! The light of outliers by unlikely paths comes back.

use glam::Vec3;
use lightsum::scene::{Material, Surface};
use lightsum::settings::{Filter, Settings};

use crate::scenes::{Soup, camera, mean, render};
use crate::support::gpu_test;

#[test]
fn light_behind_glass_comes_back() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("ball of glass under a lamp");
        let (wall, lamp) = (soup.diffuse(0.5, 0.0), soup.diffuse(0.0, 20.0));
        let glass = soup.material(Material { surface: Surface::Glass, ior: 1.5, ..Material::default() });
        soup.room(Vec3::ZERO, Vec3::splat(2.0), [wall; 6]);
        soup.quad(Vec3::new(0.9, 1.95, 0.9), Vec3::X * 0.3, Vec3::Z * 0.3, lamp);
        soup.ball(Vec3::new(1.0, 0.7, 0.9), 0.4, 32, glass);
        // Little but the ball.
        let view = camera(Vec3::new(1.0, 0.9, 2.0), Vec3::new(1.0, 0.7, 0.9), 42.0, [40, 40]);
        let energy = |filter, passes| {
            let settings = Settings { particles: 8, photons: 0, pattern: [3, 3], filter, ..Settings::plain() };
            mean(&render(ctx, &soup.0, view, &settings, passes).color).element_sum()
        };
        let whole = energy(None, 200);
        let [few, many] = [8, 200].map(|passes| energy(Some(Filter::default()), passes) / whole);
        println!("energy after 8 passes {few:.4}, after 200 {many:.4}");
        assert!((0.97..1.01).contains(&few), "{few}");
        assert!((many - 1.0).abs() < 0.003, "{many}");
    });
}
