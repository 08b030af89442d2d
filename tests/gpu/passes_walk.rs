//! The walk's use of its sequences. The checks of `lightsum-conform` compare its kernels with their oracles.

use lightsum::conform::checks::walk::{interleaved, settings};
use lightsum::light::emitters::Kind;
use lightsum::pass::layout::PointLight;
use lightsum::pass::walk_start;
use lightsum::settings::{Sequence, Settings};
use lightsum::stage::Stage;

use crate::rig::{Rig, gallery_with_tables, xyz};
use crate::support::gpu_test;

#[test]
fn every_emitter_starts_particles() {
    gpu_test(|ctx| {
        let scene = gallery_with_tables();
        let rig = Rig::new(ctx, &scene, [1, 1], settings(2049, false));
        let emitters = rig.engine.emitters();
        let mut started = vec![0; emitters.list.len()];
        let mut sides = [0, 0];
        rig.run(|frame, rec| frame.walk.record(rec));
        let lights: Vec<PointLight> = rig.get(&rig.frame().walk.lights);
        for i in 0..2049 {
            let e = emitters.choose(walk_start::first_light_numbers(&rig.parameters, i)[0]).0 as usize;
            started[e] += 1;
            if emitters.list[e].two_sided {
                let light = &lights[rig.parameters.walk[3] as usize + i as usize];
                sides[usize::from(xyz(light.normal).dot(emitters.list[e].normal) > 0.0)] += 1;
            }
        }
        for (e, (emitter, &count)) in emitters.list.iter().zip(&started).enumerate() {
            // A segment has the right number of points in an interval of this length to within some log^2 N.
            let expected = 2049.0 * emitter.probability;
            assert!((count as f32 - expected).abs() < 24.0, "emitter {e}, {:?}: {count} for {expected}", emitter.kind);
        }
        assert!(sides[0] > 0 && sides[1] > 0, "both sides of a two-sided emitter: {sides:?}");
        let inward = |inward: bool| emitters.list.iter().any(|e| e.kind == Kind::Sphere && e.inward == inward);
        assert!(inward(true) && inward(false));
    });
}

/// The numbers of points in each sixteenth of the unit interval, relative to their mean.
fn shares(points: impl Iterator<Item = f32>) -> [f64; 16] {
    let (mut counts, mut total) = ([0.0; 16], 0.0);
    for x in points {
        counts[(16.0 * x) as usize] += 1.0;
        total += 1.0 / 16.0;
    }
    counts.map(|n| n / total)
}

#[test]
fn survivors_come_from_everywhere_on_the_emitters() {
    gpu_test(|ctx| {
        let scene = gallery_with_tables();
        for sequence in [Sequence::Halton, Sequence::Sobol] {
            for (particles, pattern) in [(32, [1, 1]), (20, [3, 3])] {
                let settings = Settings { sequence, direct_lights: Some(4), ..interleaved(particles, pattern, false) };
                let rig = Rig::new(ctx, &scene, [1, 1], settings);
                let plan = rig.engine.plan();
                let passes: Vec<_> = (0..256).map(|pass| plan.parameters(pass).unwrap()).collect();
                let classes = plan.settings.classes();
                for (j, &alive) in plan.lights.survivors.iter().enumerate() {
                    // Of one class: each has to be lit from everywhere.
                    let of_class = (0..alive).map(|i| i * classes + classes / 2);
                    for d in 0..2 {
                        let numbers = |p, i| match j {
                            0 => walk_start::first_light_numbers(p, i)[d],
                            _ => walk_start::walk_numbers(p, 0, i)[d],
                        };
                        let points = passes.iter().flat_map(|p| of_class.clone().map(move |i| numbers(p, i)));
                        let shares = shares(points);
                        let off = shares.iter().map(|s| (s - 1.0).abs()).fold(0.0, f64::max);
                        // Random points would be within four standard deviations.
                        let random = 4.0 * (16.0 / (256.0 * f64::from(alive))).sqrt();
                        let limit = if j == 0 { 1e-9 } else { random };
                        println!("{sequence:?}, {particles} of {pattern:?}, {j} reflections: {off:.3} of {random:.3}");
                        assert!(off <= limit, "{sequence:?}, {j} reflections, dimension {d}: {shares:?}");
                    }
                }
            }
        }
    });
}
