//! Light that is too faint to be worth its shadow rays.

use glam::Vec3;
use lightsum::gpu::Context;
use lightsum::pass::TraversalKernels;
use lightsum::scene::builtin;
use lightsum::settings::{Compensation, Settings, Traversal};
use lightsum::standalone::Renderer;

use crate::support::gpu_test;

#[test]
fn faint_lights_are_dropped_on_demand() {
    gpu_test(|ctx| {
        let scene = builtin::room(2_000);
        let camera = lightsum::Camera { resolution: [40, 30], ..scene.camera.unwrap() };
        let run = |light_threshold: f32| {
            let settings =
                Settings { light_threshold, particles: 16, compensation: Compensation::Off, ..Settings::plain() };
            let mut renderer = Renderer::with_context(ctx.clone(), scene.clone(), camera, settings).unwrap();
            renderer.pass().unwrap();
            let layers = renderer.layers().unwrap();
            let light: Vec<Vec3> = layers.direct.iter().zip(&layers.indirect).map(|(a, b)| *a + *b).collect();
            (light, renderer.statistics().culled_pairs, renderer.engine().plan().lights.slots())
        };
        let (all, few_culled, lights) = run(0.0);
        let threshold = 0.5;
        let (most, more_culled, _) = run(threshold);
        if !has_clusters(ctx) {
            assert_eq!((few_culled, more_culled), (0, 0), "single rays drop nothing");
            assert_eq!(all, most);
            return;
        }
        assert!(more_culled > few_culled, "{more_culled} pairs were culled, {few_culled} without a threshold");
        let lost = all.iter().zip(&most).map(|(a, b)| (*a - *b).max_element()).fold(0.0, f32::max);
        assert!(lost > 0.0 && lost <= threshold * lights as f32, "{lost} lost");
        assert!(all.iter().zip(&most).all(|(a, b)| b.cmple(*a + 1e-4 * a.abs()).all()), "something became brighter");
        assert!(run(1e9).0.iter().all(|light| *light == Vec3::ZERO));
    });
}

/// Whether this device has a kernel for clusters.
fn has_clusters(ctx: &Context) -> bool {
    TraversalKernels::visibility(ctx, Traversal::Auto, false).unwrap().cluster.is_some()
}
