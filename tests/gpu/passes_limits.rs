//! Work beyond the limit of one dispatch: split, continued, reported; and the two builds of the kernels.

use glam::Vec3;
use lightsum::accel::{Ray, Steps};
use lightsum::bsdf::Reflectance;
use lightsum::gpu::{Buffer, Context, ContextOptions};
use lightsum::pass::layout::PointLight;
use lightsum::pass::shade::{self, ShadingPoint};
use lightsum::plan::{LOOP_BUDGET, min_loop_budget};
use lightsum::scene::{Camera, Scene, builtin};
use lightsum::settings::{Clip, Settings, Traversal};
use lightsum::stage::Stage;
use lightsum::standalone::Renderer;

use crate::rig::{Rig, close, gallery, xyz};
use crate::support::{SENTINEL, assert_silent, gpu_test, options};

/// Iterations after which lavapipe before Mesa 25 silently ends all loops of a subgroup.
const DRIVER_CAP: u64 = 65_535;

/// The number of lights that one invocation would reach if its loops ended after [`DRIVER_CAP`] iterations, and the
/// iterations for all of them: one a light, a node and a triangle. Fewer than the device's, whose subgroup runs as long
/// as its slowest member.
fn reach(rig: &Rig, receiver: &ShadingPoint, lights: &[PointLight]) -> (usize, u64) {
    let (mut total, mut reached) = (0, 0);
    for light in lights {
        let d = xyz(light.position) - receiver.position;
        let wi = d.normalize();
        let sent = shade::light_towards(&rig.scene.materials, light, wi, d.length_squared(), 0.0);
        let mut steps = Steps::default();
        if sent != Vec3::ZERO && wi.dot(receiver.shading) > 0.0 && wi.dot(receiver.geometric) > 0.0 {
            rig.bvh().occluded_counted(&Ray::between(receiver.position, xyz(light.position)), &mut steps);
        }
        total += 1 + u64::from(steps.nodes) + u64::from(steps.triangles);
        reached += usize::from(total <= DRIVER_CAP);
    }
    (reached, total)
}

#[test]
fn more_work_than_the_driver_lets_one_dispatch_do() {
    gpu_test(|ctx| {
        let scene = builtin::deep_scene(1500);
        let settings = Settings { particles: 4608, clip: Clip::Distance(0.0), ..Settings::plain() };
        let rig = Rig::new(ctx, &scene, [8, 1], settings);
        rig.walk_and_look();
        rig.run(|frame, rec| frame.shade.record(rec));
        assert_eq!(rig.lost(), 0);
        let frame = rig.frame();
        let lights: Vec<PointLight> = rig.get(&frame.walk.lights);
        assert!(lights.len() > 8000, "{} lights", lights.len());
        let r = &frame.eye.points;
        let [position, geometric, shading, kd, wo] =
            [&r.position, &r.geometric, &r.shading, &r.kd, &r.wo].map(|b| rig.vec4s(b));
        let sums = [&frame.shade.lighting.direct, &frame.shade.lighting.indirect].map(|b| rig.vec4s(b));
        let mut compared = 0;
        for i in rig.list(0).into_iter().map(|i| i as usize).step_by(2) {
            let receiver = ShadingPoint {
                sampled: None,
                splats: false,
                position: position[i].truncate(),
                geometric: geometric[i].truncate(),
                shading: shading[i].truncate(),
                reflectance: Reflectance { kd: kd[i].truncate(), f0: Vec3::ZERO, f90: 0.0, alpha: 1.0 },
                wo: wo[i].truncate(),
            };
            let (reached, total) = reach(&rig, &receiver, &lights);
            assert!(total > 20 * DRIVER_CAP, "pixel {i} needs {total} iterations only");
            let whole = shade::reference(rig.scene, rig.bvh(), &receiver, &lights, 0.0, rig.parameters.forward[3]);
            let cut =
                shade::reference(rig.scene, rig.bvh(), &receiver, &lights[..reached], 0.0, rig.parameters.forward[3]);
            let sum = |s: [Vec3; 3]| s[0] + s[1];
            assert!(sum(cut).x < 0.5 * sum(whole).x, "pixel {i}: {reached} lights would do: {cut:?} of {whole:?}");
            // Thousands of additions in the same order, and a few shadow rays through edges.
            for k in 0..2 {
                let found = sums[k][i].truncate();
                assert!(close(found, whole[k], 3e-3, 0.0), "pixel {i}: {found} for {}", whole[k]);
            }
            compared += 1;
        }
        assert!(compared >= 3, "{compared} pixels are lit");
    });
}

#[test]
fn a_trace_of_more_steps_than_the_driver_lets_one_dispatch_do() {
    gpu_test(|ctx| {
        // Rays past tens of thousands of needles, and the walk of particles between them.
        let scene = builtin::deep_scene(40_000);
        let settings = Settings { particles: 8, rounds: 16, ..Settings::plain() };
        let rig = Rig::new(ctx, &scene, [4, 2], settings);
        rig.run(|frame, rec| frame.eye.record(rec));
        assert_eq!(rig.lost(), 0);
        let [origin, direction, hits] =
            [&rig.frame().eye.rays.origin, &rig.frame().eye.rays.direction, &rig.frame().eye.rays.hits]
                .map(|b| rig.vec4s(b));
        let mut most = 0;
        for i in 0..8 {
            let mut steps = Steps::default();
            let ray = crate::rig::ray_of(origin[i], direction[i]);
            let expected = rig.bvh().closest_counted(&ray, &mut steps);
            assert!(
                crate::rig::same_hit(crate::rig::hit_of(hits[i]), expected),
                "ray {i}: {} for {expected:?}",
                hits[i]
            );
            most = most.max(steps.nodes + steps.triangles);
        }
        assert!(most > lightsum::plan::trace_steps(LOOP_BUDGET), "one round does for {most} steps");
    });
}

/// Settings with which no ray finishes in one round.
fn starved() -> Settings {
    Settings {
        particles: 4,
        max_depth: 3,
        lights_per_dispatch: 2,
        loop_budget: min_loop_budget(2),
        rounds: 1,
        ..Settings::plain()
    }
}

#[test]
fn rays_that_run_out_of_steps_are_reported_and_leave_no_trace() {
    gpu_test(|ctx| {
        let scene = builtin::deep_scene(60);
        let mut rig = Rig::new(ctx, &scene, [27, 1], starved());
        let film: Vec<Buffer> = rig.frame().output.film.buffers().cloned().collect();
        rig.prefill(&film.iter().collect::<Vec<_>>());
        ctx.submit_and_wait("a pass", None, |rec| rig.engine.record_pass(rec)).unwrap();
        let lost = rig.lost();
        assert!(lost > 27, "{lost} rays lost");
        for buffer in &film {
            let words: Vec<u32> = rig.get(buffer);
            assert!(words.iter().all(|&w| w == SENTINEL), "{} is written", buffer.name());
        }
    });
}

fn render(ctx: &Context, scene: &Scene, resolution: [u32; 2], settings: Settings, passes: u32) -> Renderer {
    let camera = Camera { resolution, ..scene.camera.unwrap() };
    let mut renderer = Renderer::with_context(ctx.clone(), scene.clone(), camera, settings).unwrap();
    (0..passes).for_each(|_| renderer.pass().unwrap());
    renderer
}

#[test]
fn a_renderer_recovers_lost_rays_by_more_rounds() {
    gpu_test(|ctx| {
        let scene = builtin::deep_scene(60);
        // One kernel alone, because another one may round otherwise.
        let starved = || Settings { traversal: Traversal::Single, ..starved() };
        let hungry = render(ctx, &scene, [9, 3], starved(), 2);
        assert!(hungry.engine().plan().settings.rounds > 1);
        let fed = Settings { loop_budget: LOOP_BUDGET, rounds: 4, ..starved() };
        let fed = render(ctx, &scene, [9, 3], fed, 2);
        assert_eq!(fed.engine().plan().settings.rounds, 4);
        assert_eq!(hungry.passes(), 2);
        // A continued ray has the same numbers as an uninterrupted one.
        assert!(hungry.save_state().unwrap() == fed.save_state().unwrap(), "the images differ");
        assert!(fed.layers().unwrap().color.iter().any(|c| c.x > 0.0));
    });
}

#[test]
fn a_ray_that_no_number_of_rounds_helps_is_an_error() {
    gpu_test(|ctx| {
        let scene = builtin::deep_scene(9000);
        let settings = Settings { lights_per_dispatch: 1, loop_budget: min_loop_budget(1), ..starved() };
        let settings = Settings { rounds: 1024, particles: 1, max_depth: 1, ..settings };
        let camera = Camera { resolution: [2, 1], ..scene.camera.unwrap() };
        let mut renderer = Renderer::with_context(ctx.clone(), scene, camera, settings).unwrap();
        let error = renderer.pass().unwrap_err();
        assert!(matches!(error, lightsum::Error::Unfinished { steps: 2048, .. }), "{error}");
    });
}

#[test]
fn both_builds_of_the_kernels_give_the_same_image() {
    gpu_test(|ctx| {
        let scene = gallery();
        let other = ContextOptions { checked_shaders: !options().checked_shaders, ..options() };
        let other = Context::headless(&other).unwrap();
        let settings = Settings { particles: 16, max_depth: 4, ..Settings::plain() };
        let [a, b] = [ctx, &other].map(|c| render(c, &scene, [31, 17], settings.clone(), 2).layers().unwrap());
        assert_silent(other.take_messages());
        for (name, a, b) in
            [("color", &a.color, &b.color), ("direct", &a.direct, &b.direct), ("albedo", &a.albedo, &b.albedo)]
        {
            // Two programs with the same arithmetic; a device may contract it differently, and a ray at an edge may
            // flip.
            let different = a.iter().zip(b).filter(|(a, b)| !close(**a, **b, 1e-4, 1e-6)).count();
            assert!(different * 100 <= a.len(), "{name}: {different} of {} pixels differ", a.len());
        }
        assert_eq!(a.alpha, b.alpha);
        assert!(a.color.iter().any(|c| c.x > 0.0));
    });
}
