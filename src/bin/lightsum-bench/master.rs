//! `master`: the master of a cluster whose tasks are parts of a frame, part by part, by the clocks of the wall and of the processor. Clients and
//! master are one process, and only the master's parts are measured.
//!
//! A frame is one pass of the interactive settings without near light and superposition. The clock of the processor counts all threads, those of a driver
//! that computes on the processor too: it tells the time on one core, on a busy machine too.

use std::time::Instant;

use cpu_time::ProcessTime;
use lightsum::cluster::points::{PassPoints, Shape, TaskPoints};
use lightsum::output::Wanted;
use lightsum::scene::Camera;
use lightsum::settings::{Compensation, Settings};
use lightsum::view::Task;
use lightsum::{Renderer, Result};
use serde_json::{Value, json};

use crate::args::Master;
use crate::report::{self, Table, milliseconds, percent};
use crate::scene;

/// The parts of a frame in order: key and label in the table.
const PARTS: [(&str, &str); 4] = [
    ("unpack", "points from bytes"),
    ("stage", "points to the device"),
    ("pass", "upload, filter, film"),
    ("image", "image read back"),
];

/// Runs the command.
pub fn run(args: &Master) -> Result<()> {
    scene::check(&args.scenes)?;
    let context = scene::open(&args.common)?;
    let environment = report::environment(context.info());
    if !args.common.json {
        report::print_environment(&environment)?;
    }
    for name in &args.scenes {
        let scene = scene::load(name)?;
        let camera = scene::camera(&scene, args.common.resolution);
        let settings = Settings { compensation: Compensation::Off, superposition: None, ..Settings::interactive() };
        let sent = Sent::new(Renderer::with_context(context.clone(), scene.clone(), camera, settings.clone())?, args)?;
        let mut master = Renderer::with_context(context.clone(), scene, camera, settings)?;
        let (mut measured, mut points) = (Measured::default(), PassPoints::of(master.engine()));
        if args.unpack_on_device {
            points = points.unpacked_on_device(true);
        }
        for repeat in 0..=args.common.repeats {
            let times = sent.frame(&mut master, &mut points)?;
            if repeat > 0 {
                measured.add(times, &master);
            }
        }
        if args.common.json {
            report::print_json(measured.line(name, &sent, camera, args), &environment)?;
        } else {
            measured.print(name, &sent, camera, args)?;
        }
    }
    Ok(())
}

/// Bytes that clients send for a frame.
struct Sent {
    shape: Shape,
    exact: bool,
    loads: Vec<(Task, Vec<u8>)>,
    bytes: usize,
    /// Processor seconds of a client to make bytes of the frame's points.
    pack: f64,
}

impl Sent {
    fn new(mut client: Renderer, args: &Master) -> Result<Sent> {
        let engine = client.engine();
        let (shape, parameters) = (Shape::of(engine), engine.plan().parameters(0)?);
        let tasks = Task::cut(&engine.plan().settings, engine.view().size(), args.tasks);
        let (mut loads, mut pack) = (Vec::new(), 0.0);
        for task in tasks {
            let points = client.points_of(0, &task)?;
            let start = ProcessTime::now();
            let load = if args.exact { points.to_bytes() } else { points.pack(&shape, &parameters) };
            pack += start.elapsed().as_secs_f64();
            loads.push((task, load));
        }
        let bytes = loads.iter().map(|(_, load)| load.len()).sum();
        Ok(Sent { shape, exact: args.exact, loads, bytes, pack })
    }

    /// Seconds of the parts of a frame, by the wall and of the processor.
    fn frame(&self, master: &mut Renderer, points: &mut PassPoints) -> Result<[[f64; 2]; PARTS.len()]> {
        let mut times = [[0.0; 2]; PARTS.len()];
        let mut clock = Clock::new();
        let mut lap = |part: usize| {
            let [wall, processor] = clock.lap();
            times[part][0] += wall;
            times[part][1] += processor;
        };
        points.clear();
        master.engine_mut().restart();
        for (task, load) in &self.loads {
            match self.exact {
                true => points.take(TaskPoints::from_bytes(*task, load)?)?,
                false => points.take_packed(*task, load)?,
            }
        }
        lap(0);
        master.prepare(points)?;
        lap(1);
        master.pass_from(0, points)?;
        lap(2);
        let image = master.image(Wanted::Color)?;
        lap(3);
        drop(image);
        Ok(times)
    }
}

/// The clocks of the wall and of the processor.
struct Clock {
    wall: Instant,
    processor: ProcessTime,
}

impl Clock {
    fn new() -> Clock {
        Clock { wall: Instant::now(), processor: ProcessTime::now() }
    }

    /// Seconds since the last lap.
    fn lap(&mut self) -> [f64; 2] {
        let now = Clock::new();
        let seconds = [
            now.wall.duration_since(self.wall).as_secs_f64(),
            now.processor.duration_since(self.processor).as_secs_f64(),
        ];
        *self = now;
        seconds
    }
}

/// Times of the frames of a scene.
#[derive(Default)]
struct Measured {
    /// For each part the seconds of each frame, by the wall and of the processor.
    parts: [[Vec<f64>; 2]; PARTS.len()],
    frames: [Vec<f64>; 2],
    /// For each GPU pass, in order, its seconds in each frame.
    gpu: Vec<(String, Vec<f64>)>,
}

impl Measured {
    fn add(&mut self, times: [[f64; 2]; PARTS.len()], master: &Renderer) {
        for clock in 0..2 {
            self.frames[clock].push(times.iter().map(|part| part[clock]).sum());
            self.parts.iter_mut().zip(&times).for_each(|(part, seconds)| part[clock].push(seconds[clock]));
        }
        for (name, seconds) in &master.last_pass().gpu_passes {
            match self.gpu.iter_mut().find(|(known, _)| known == name) {
                Some((_, all)) => all.push(*seconds),
                None => self.gpu.push((name.clone(), vec![*seconds])),
            }
        }
    }

    fn line(&self, name: &str, sent: &Sent, camera: Camera, args: &Master) -> Value {
        let [width, height] = camera.resolution;
        let parts = PARTS.iter().zip(&self.parts).map(|((key, _), [wall, processor])| {
            json!({ "part": key, "wall": report::summary(wall), "processor": report::summary(processor) })
        });
        let gpu = self.gpu.iter().map(|(name, seconds)| json!({ "pass": name, "wall": report::summary(seconds) }));
        json!({
            "mode": "master",
            "scene": name,
            "resolution": camera.resolution,
            "exact": sent.exact,
            "unpack_on_device": args.unpack_on_device,
            "tasks": sent.loads.len(),
            "components": sent.shape.components,
            "bytes_per_pixel": sent.bytes as f64 / f64::from(width) / f64::from(height),
            "pack_seconds": sent.pack,
            "parts": parts.collect::<Vec<_>>(),
            "gpu_passes": gpu.collect::<Vec<_>>(),
            "frame": { "wall": report::summary(&self.frames[0]), "processor": report::summary(&self.frames[1]) },
            "megapixels_per_second": megapixels(camera, report::median(&self.frames[1])),
            "repeats": args.common.repeats,
        })
    }

    fn print(&self, name: &str, sent: &Sent, camera: Camera, args: &Master) -> Result<()> {
        let [width, height] = camera.resolution;
        report::say("")?;
        report::say(&format!(
            "{name}: {width}x{height}, {} components, {} tasks, {:.2} bytes a pixel, {} processor ms to make them, {} frames",
            sent.shape.components,
            sent.loads.len(),
            sent.bytes as f64 / f64::from(width) / f64::from(height),
            milliseconds(sent.pack),
            args.common.repeats,
        ))?;
        let table = Table::head(&[("part", 22), ("processor ms", 12), ("+-", 5), ("Mpixel/s", 8), ("wall ms", 9)])?;
        let row = |label: &str, [wall, processor]: &[Vec<f64>; 2]| {
            let median = report::median(processor);
            table.row(&[
                label.to_owned(),
                milliseconds(median),
                percent(report::spread(processor)),
                format!("{:.1}", megapixels(camera, median)),
                milliseconds(report::median(wall)),
            ])
        };
        PARTS.iter().zip(&self.parts).try_for_each(|((_, label), part)| row(label, part))?;
        row("frame", &self.frames)?;
        for (pass, seconds) in &self.gpu {
            let label = format!("  pass: {pass}");
            table.row(&[label, String::new(), String::new(), String::new(), milliseconds(report::median(seconds))])?;
        }
        Ok(())
    }
}

/// Millions of pixels a second of an image that takes so many seconds.
fn megapixels(camera: Camera, seconds: f64) -> f64 {
    let [width, height] = camera.resolution;
    f64::from(width) * f64::from(height) / seconds.max(1e-9) * 1e-6
}
