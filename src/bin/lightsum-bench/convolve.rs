//! `convolve`: the convolution of a mirror image, by kernel width and for each algorithm.
//!
//! The lower half of the image is one reflector whose kernels all have one width (the worst case of that width); it
//! shows soft shades, chequers and a bright ball. The axes of the kernels turn from pixel to pixel, except in the
//! invariant form.

use crate::args::Convolve as Flags;
use crate::report::{self, Table, milliseconds, percent};
use crate::scene;
use lightsum::Result;
use lightsum::gpu::{Buffer, Context, Staging, Timers, download, upload};
use lightsum::pass::convolve::{Convolve, Form, Inputs, KERNEL_TEXELS, Library};
use serde_json::json;
use std::time::Instant;

/// For wider kernels the direct form, which takes seconds, is measured only once, without a warm-up.
const DIRECT_REPEATED: u32 = 15;

/// Input of the convolution.
struct Subject {
    size: [u32; 2],
    source: Buffer,
    region: Buffer,
    library: Library,
}

/// Result of one form.
struct Measured {
    times: Vec<f64>,
    image: Vec<[f32; 4]>,
}

impl Subject {
    fn new(context: &Context, size: [u32; 2]) -> Result<Subject> {
        let [width, height] = size;
        let pixels = || (0..width * height).map(|i| [i % width, i / width]);
        let source: Vec<f32> = pixels().flat_map(|at| radiance(at.map(|n| n as f32 / height as f32))).collect();
        let region: Vec<u32> = pixels().map(|[_, y]| u32::from(2 * y >= height)).collect();
        let kernels = upload(context, "kernels", &lobe())?;
        let mut staging = Staging::new();
        let library = Library::new(context, &mut staging, &kernels, &[0])?;
        context.submit_and_wait("preparing kernels", None, |rec| {
            staging.record(rec)?;
            library.record(rec)
        })?;
        Ok(Subject {
            size,
            source: upload(context, "source", &source)?,
            region: upload(context, "region", &region)?,
            library,
        })
    }

    /// Convolves once to warm up, unless `repeats` is 0, and then `repeats` times, at least once.
    fn measure(&self, context: &Context, width: u32, form: Form, invariant: bool, repeats: u32) -> Result<Measured> {
        let count = if invariant { 1 } else { self.size[0] * self.size[1] };
        let footprint: Vec<f32> = (0..count)
            .flat_map(|i| {
                let angle = i as f32 / self.size[0] as f32 * 0.01;
                [width as f32, 0.0, angle.cos(), angle.sin()]
            })
            .collect();
        let footprint = upload(context, "footprint", &footprint)?;
        let mut staging = Staging::new();
        let inputs = Inputs {
            library: &self.library,
            source: &self.source,
            footprint: &footprint,
            by_region: invariant,
            region: &self.region,
            size: self.size,
            widest: width as f32,
            form,
            occlusion: false,
            layers: false,
        };
        let pass = Convolve::new(context, &mut staging, &inputs)?;
        context.submit_and_wait("uploading steps", None, |rec| staging.record(rec))?;
        let timers = Timers::new(context, 4)?;
        let mut times = Vec::new();
        let first = u32::from(repeats == 0);
        for repeat in first..=repeats.max(1) {
            let start = Instant::now();
            context
                .submit_and_wait("convolving", Some(&timers), |rec| rec.scope("convolution", |rec| pass.record(rec)))?;
            let wall = start.elapsed().as_secs_f64();
            let seconds = timers.read()?.first().map_or(wall, |(_, seconds)| *seconds);
            if repeat > 0 {
                times.push(seconds);
            }
        }
        Ok(Measured { times, image: download(context, &pass.spread)? })
    }
}

/// Radiance and depth at a point of the image, in heights.
fn radiance([x, y]: [f32; 2]) -> [f32; 4] {
    let ball = (x - 0.9).hypot(y - 0.7) < 0.1;
    let chequer = ((x * 20.0).floor() + (y * 20.0).floor()) as i32 % 2 == 0;
    let shade = if chequer { 1.0 } else { 0.2 } * (0.6 + 0.4 * (7.0 * x).sin());
    if ball { [4.0, 3.0, 2.0, 0.5] } else { [shade, 0.8 * shade, 0.3 + 0.2 * y, 1.0] }
}

/// A smooth lobe.
fn lobe() -> Vec<f32> {
    let edge = KERNEL_TEXELS;
    let at = |i: u32| (i as f32 + 0.5) * 2.0 / edge as f32 - 1.0;
    (0..edge * edge).map(|i| (1.0 - at(i % edge).powi(2) - at(i / edge).powi(2)).max(0.0).powi(2)).collect()
}

/// Relative RMSE of an image's radiance against another's, over the pixels that are not 0.
fn error(image: &[[f32; 4]], expected: &[[f32; 4]]) -> f64 {
    let channels =
        |v: &[[f32; 4]]| v.iter().filter(|v| v[3] > 0.0).flat_map(|v| [v[0], v[1], v[2]]).collect::<Vec<_>>();
    let (a, b) = (channels(image), channels(expected));
    let squares: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    let sum: f64 = b.iter().map(|&b| f64::from(b)).sum();
    (squares * b.len() as f64).sqrt() / sum.max(f64::MIN_POSITIVE)
}

/// Runs the command.
pub fn run(args: &Flags) -> Result<()> {
    let context = scene::open(&args.common)?;
    let environment = report::environment(context.info());
    let subject = Subject::new(&context, args.common.resolution)?;
    let columns = [("form", 10), ("width px", 8), ("median ms", 9), ("+-", 5), ("relative RMSE", 13)];
    let table = match args.common.json {
        true => None,
        false => {
            report::print_environment(&environment)?;
            Some(Table::head(&columns)?)
        }
    };
    for &width in &args.kernel_width {
        let mut direct = None;
        for name in ["direct", "fast", "invariant"].into_iter().filter(|name| args.form.iter().any(|f| f == name)) {
            let (form, invariant) = match name {
                "direct" => (Form::Direct, false),
                "fast" => (Form::Fast, false),
                _ => (Form::Auto, true),
            };
            let once = form == Form::Direct && width > DIRECT_REPEATED;
            let repeats = if once { 0 } else { args.common.repeats };
            let measured = subject.measure(&context, width, form, invariant, repeats)?;
            let against = direct.as_ref().filter(|_| form == Form::Fast);
            let error = against.map(|expected: &Vec<[f32; 4]>| error(&measured.image, expected));
            let (seconds, spread) = (report::median(&measured.times), report::spread(&measured.times));
            if let Some(table) = &table {
                let error = error.map_or(String::new(), |error| format!("{error:.4}"));
                table.row(&[name.to_owned(), width.to_string(), milliseconds(seconds), percent(spread), error])?;
            } else {
                let line = json!({
                    "mode": "convolve",
                    "resolution": args.common.resolution,
                    "repeats": measured.times.len(),
                    "form": name,
                    "kernel_width": width,
                    "median_seconds": seconds,
                    "spread": spread,
                    "relative_rmse": error,
                });
                report::print_json(line, &environment)?;
            }
            if form == Form::Direct {
                direct = Some(measured.image);
            }
        }
    }
    Ok(())
}
