//! GPU passes: the timestamps of each pass of a frame, on small scenes that together cover the passes.
//!
//! ```text
//! cargo bench --bench gpu                      # all; needs a Vulkan device
//! cargo bench --bench gpu -- glossy            # those whose name contains "glossy"
//! LIGHTSUM_DEVICE=cpu cargo bench --bench gpu  # on a device by name, index or kind
//! ```
//!
//! Each frame renders [`FRAMES`] times after a warm-up; each of criterion's samples is the timestamp of one of them. The name of
//! a benchmark is `FRAME/PASS`, with the label of the pass; `frame` is the whole frame by the wall clock. `lightsum-bench frame`
//! measures scenes and settings of your choice.

use std::path::Path;
use std::time::Duration;

use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use glam::Vec3;
use lightsum::gpu::{Context, ContextOptions, DeviceChoice};
use lightsum::scene::{self, Light};
use lightsum::settings::{Filter, LightChoice, Superposition};
use lightsum::{Camera, Renderer, Settings};

/// Frames measured for each configuration.
const FRAMES: usize = 20;
/// Size of the images.
const RESOLUTION: [u32; 2] = [160, 120];

/// A frame to measure.
struct Frame {
    name: &'static str,
    scene: &'static str,
    /// Diameter of the lens in scene units.
    aperture: f32,
    /// Point lights added to the scene.
    lamps: u32,
    settings: Settings,
}

fn frames() -> Vec<Frame> {
    let base = Settings { particles: 8, ..Settings::default() };
    vec![
        // Walk, eye, shading, gathering.
        Frame { name: "cornell", scene: "cornell", aperture: 0.0, lamps: 0, settings: base.clone() },
        // The preset for interactive rates: interleaving, photons, filter; eye paths through glass.
        Frame { name: "interactive", scene: "glass-ball", aperture: 0.0, lamps: 0, settings: Settings::interactive() },
        // Mirror images, their convolution, and a lens.
        Frame {
            name: "glossy",
            scene: "glossy-floor",
            aperture: 0.1,
            lamps: 0,
            settings: Settings { superposition: Some(Superposition::default()), ..base.clone() },
        },
        // Emitters by contribution, mirrored lights, summands.
        Frame {
            name: "choices",
            scene: "glass-ball",
            aperture: 0.0,
            lamps: 0,
            settings: Settings {
                light_choice: LightChoice::Contribution,
                mirror_lights: 8,
                summands: true,
                filter: Some(Filter::default()),
                ..base.clone()
            },
        },
        // A random choice of a few among many point lights.
        Frame {
            name: "lamps",
            scene: "cornell",
            aperture: 0.0,
            lamps: 64,
            settings: Settings { delta_lights: Some(8), ..base },
        },
    ]
}

/// Seconds of the whole frame and of each pass, one value for each rendered frame.
fn measure(context: &Context, frame: &Frame) -> lightsum::Result<Vec<(String, Vec<f64>)>> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(frame.scene).join("scene.toml");
    let mut scene = scene::load(&file)?;
    let (low, high) = scene.bounds();
    scene.lights.extend((0..frame.lamps).map(|i| {
        // A grid of 8 lamps a row, half way up; their light does not matter.
        let place = Vec3::new((i % 8) as f32 + 0.5, 4.0, (i / 8) as f32 + 0.5) / 8.0;
        Light::Point { position: low + (high - low) * place, intensity: Vec3::ONE }
    }));
    let camera = scene.camera.unwrap_or_else(|| scene.framed(RESOLUTION, None));
    let camera = Camera { resolution: RESOLUTION, aperture: frame.aperture, ..camera };
    let mut renderer = Renderer::with_context(context.clone(), scene, camera, frame.settings.clone())?;
    // Drivers may compile at the first dispatch.
    renderer.pass()?;
    let mut times = vec![(String::from("frame"), Vec::new())];
    for _ in 0..FRAMES {
        renderer.pass()?;
        let last = renderer.last_pass();
        times[0].1.push(last.seconds);
        for (pass, seconds) in &last.gpu_passes {
            match times.iter_mut().find(|(known, _)| known == pass) {
                Some((_, all)) => all.push(*seconds),
                None => times.push((pass.clone(), vec![*seconds])),
            }
        }
    }
    Ok(times)
}

fn passes(criterion: &mut Criterion) {
    let device = match std::env::var("LIGHTSUM_DEVICE") {
        Ok(name) => name.parse().expect("any text names a device"),
        Err(_) => DeviceChoice::default(),
    };
    let options = ContextOptions { device, ..ContextOptions::default() };
    let context = Context::headless(&options).expect("the benchmarks of GPU passes need a Vulkan device");
    println!("{}", context.info().name);
    for frame in frames() {
        let times = measure(&context, &frame).expect("the frame renders");
        let mut group = criterion.benchmark_group(frame.name);
        group.sampling_mode(SamplingMode::Flat);
        for (pass, seconds) in &times {
            let mut samples = seconds.iter().cycle();
            group.bench_function(pass, |b| {
                b.iter_custom(|iterations| {
                    let seconds = samples.next().copied().unwrap_or_default();
                    // Criterion divides by the iterations, and needs a time above 0.
                    Duration::from_secs_f64(seconds.max(1e-9)) * u32::try_from(iterations).unwrap_or(u32::MAX)
                });
            });
        }
    }
}

/// The frames are rendered before criterion asks for their times, so it needs neither a warm-up nor time for measuring.
fn settings() -> Criterion {
    Criterion::default()
        .sample_size(FRAMES)
        .warm_up_time(Duration::from_nanos(1))
        .measurement_time(Duration::from_millis(10))
        .without_plots()
}

criterion_group! { name = gpu; config = settings(); targets = passes }
criterion_main!(gpu);
