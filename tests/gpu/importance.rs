//! The choice of emitters by contribution: its effect on images.

use glam::Vec3;
use lightsum::settings::{Clip, Settings};

use crate::renderer::cornell;
use crate::scenes::{Soup, camera, compare, mean, render, settings};
use crate::support::gpu_test;

use lightsum::conform::checks::importance::by_contribution;

#[test]
fn with_one_emitter_the_choice_changes_no_bit() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell();
        let base = settings(16, 4);
        let by_power = render(ctx, &scene, camera, &base, 4);
        let chosen = render(ctx, &scene, camera, &by_contribution(base), 4);
        assert!(by_power.color == chosen.color && by_power.indirect == chosen.indirect);
    });
}

#[test]
fn both_choices_have_the_same_limit() {
    gpu_test(|ctx| {
        // Two rooms and a wall of half their height between them, which blocks most of the light that the strong lamps
        // beyond it would contribute.
        let mut soup = Soup::new("two rooms");
        let [grey, red] = [soup.diffuse(0.6, 0.0), soup.diffuse([0.7, 0.2, 0.2], 0.0)];
        let [weak, strong] = [soup.diffuse(0.0, 4.0), soup.diffuse(0.0, [20.0, 25.0, 30.0])];
        soup.room(Vec3::ZERO, Vec3::new(4.0, 2.0, 2.0), [red, grey, grey, grey, grey, grey]);
        soup.room(Vec3::new(1.95, 0.0, 0.0), Vec3::new(2.05, 1.0, 2.0), [grey; 6]);
        // The room's faces look inwards; the wall is seen from outside.
        let wall = soup.0.triangles.len() - 12;
        soup.0.triangles[wall..].iter_mut().for_each(|t| t.vertices.swap(1, 2));
        soup.quad(Vec3::new(0.8, 1.95, 0.8), Vec3::X * 0.4, Vec3::Z * 0.4, weak);
        for k in 0..3 {
            let corner = Vec3::new(2.2 + 0.6 * k as f32, 1.2, 0.9);
            soup.quad(corner, Vec3::X * 0.3, Vec3::Z * 0.3, strong);
        }
        let camera = camera(Vec3::new(1.8, 1.0, 1.0), Vec3::new(0.0, 0.8, 1.0), 70.0, [24, 18]);
        let by_power = render(ctx, &soup.0, camera, &settings(64, 5), 256);
        let chosen = render(ctx, &soup.0, camera, &by_contribution(settings(64, 5)), 256);
        for (what, a, b) in [
            ("all light", &chosen.color, &by_power.color),
            ("direct light", &chosen.direct, &by_power.direct),
            ("indirect light", &chosen.indirect, &by_power.indirect),
        ] {
            let (ratio, error) = compare(a, b);
            println!("{what}: energy {ratio:.4}, relative RMSE {error:.4}");
            assert!(mean(b).x > 0.0 && (ratio - 1.0).abs() < 0.02 && error < 0.1, "{what}: {ratio}, {error}");
        }
    });
}

#[test]
fn of_a_thousand_lights_those_that_matter_are_chosen() {
    gpu_test(|ctx| {
        // A field of 50 x 20 lamps; some ten of them light the visible part.
        let mut soup = Soup::new("a thousand lamps");
        let [grey, lamp] = [soup.diffuse(0.7, 0.0), soup.diffuse(0.0, 10.0)];
        soup.quad(Vec3::ZERO, Vec3::Z * 80.0, Vec3::X * 200.0, grey);
        for i in 0..1000 {
            let corner = Vec3::new(2.0 + 4.0 * (i % 50) as f32, 2.0, 2.0 + 4.0 * (i / 50) as f32);
            soup.quad(corner, Vec3::X * 0.2, Vec3::Z * 0.2, lamp);
        }
        let camera = camera(Vec3::new(40.0, 1.5, 40.0), Vec3::new(40.0, 0.0, 41.0), 60.0, [24, 18]);
        // No shading point is nearer than the clip distance to a lamp, so nothing is gathered.
        let clip = Clip::Distance(0.5);
        let limit = render(ctx, &soup.0, camera, &Settings { clip, ..settings(4096, 2) }, 16).color;
        let (mut by_power, mut chosen) = (0.0, 0.0);
        for seed in 0..3 {
            let base = Settings { seed, clip, ..settings(32, 2) };
            by_power += compare(&render(ctx, &soup.0, camera, &base, 16).color, &limit).1;
            chosen += compare(&render(ctx, &soup.0, camera, &by_contribution(base), 16).color, &limit).1;
        }
        println!("relative RMSE of 512 particles: {:.3} by power, {:.3} by contribution", by_power / 3.0, chosen / 3.0);
        assert!(chosen * 10.0 < by_power, "{chosen} against {by_power}");
    });
}
