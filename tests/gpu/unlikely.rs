//! The light of unlikely components is spread over their neighbours.

use glam::Vec3;
use lightsum::scene::{Material, Surface};
use lightsum::settings::{Filter, Settings};

use crate::scenes::{Soup, camera, mean, render};
use crate::support::gpu_test;

#[test]
fn a_first_frame_of_a_ball_of_glass_has_fewer_dots() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("ball of glass before a bright wall");
        let (wall, dark, lamp) = (soup.diffuse(0.7, 0.0), soup.diffuse(0.1, 0.0), soup.diffuse(0.0, 10.0));
        let glass = soup.material(Material { surface: Surface::Glass, ior: 1.5, ..Material::default() });
        soup.room(Vec3::ZERO, Vec3::splat(2.0), [wall, dark, wall, dark, wall, dark]);
        soup.quad(Vec3::new(0.7, 1.95, 0.7), Vec3::X * 0.6, Vec3::Z * 0.6, lamp);
        soup.ball(Vec3::new(1.0, 0.7, 0.9), 0.4, 32, glass);
        let view = camera(Vec3::new(1.0, 0.9, 2.0), Vec3::new(1.0, 0.7, 0.9), 40.0, [48, 48]);
        let image = |filter, passes, seed| {
            let settings = Settings { particles: 30, photons: 0, pattern: [3, 3], filter, seed, ..Settings::plain() };
            render(ctx, &soup.0, view, &settings, passes).color
        };
        let truth = image(None, 256, 7);
        // In the middle of the ball, where a reflection inside it has a probability of a twentieth.
        let dots = |color: &[Vec3]| {
            let off = |i: usize| (color[i] - truth[i]).abs().element_sum() > 0.3 * truth[i].element_sum();
            let middle = |i: &usize| (16..32).contains(&(i % 48)) && (16..32).contains(&(i / 48));
            (0..48 * 48).filter(middle).filter(|&i| off(i)).count()
        };
        let images = |filter| (0..4).map(|seed| dots(&image(filter, 1, seed))).sum::<usize>();
        let [without, with] = [None, Some(Filter::default())].map(images);
        println!("pixels off by 0.3: {without} without, {with} with");
        assert!(without > 40 && 4 * with < without, "{with} of {without}");
        let many = image(Some(Filter::default()), 128, 3);
        let ratio = mean(&many).element_sum() / mean(&truth).element_sum();
        println!("energy after 128 passes {ratio:.4}");
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    });
}
