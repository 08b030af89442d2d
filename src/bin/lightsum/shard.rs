//! `lightsum render --shard`: a part of the passes of a rendering, in a film.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use lightsum::output::{About, FilmFile, Metadata, Statistics};
use lightsum::settings::{Exposure, Traversal};
use lightsum::standalone::Renderer;
use lightsum::{Error, Result};

use crate::args::{PartFlag, Render, is_film};
use crate::progress::{Progress, duration};
use crate::render::{Job, count, metadata};
use crate::say_aside;
use crate::stop::Stop;

/// Reason to refuse a flag.
const NO_IMAGE: &str = "it concerns an image, and the output is a film of a part of the passes";

/// A part of the passes, and the film of them.
pub struct Part<'a> {
    path: &'a Path,
    part: PartFlag,
    /// The film of an earlier run, to go on with.
    earlier: Option<FilmFile>,
}

impl<'a> Part<'a> {
    /// By the flags; `None`: images are asked for. Reads the film to go on with. Errors: flags that concern images.
    pub fn of(args: &'a Render) -> Result<Option<Part<'a>>> {
        let outputs = &args.output.outputs;
        let path = match (outputs.iter().any(|path| is_film(path)), args.cluster.shard) {
            (false, None) => return Ok(None),
            (true, _) if outputs.len() == 1 => outputs[0].as_path(),
            _ => {
                let message =
                    String::from("a film is the only output: give -o FILE.film alone, and merge it to images");
                return Err(Error::Setting { name: "--shard", message });
            }
        };
        let concerns_images = [
            (args.output.preview.is_some(), "--preview"),
            (args.output.display.is_some(), "--display"),
            (args.output.denoise.is_some(), "--denoise"),
            (args.output.export_lights.is_some(), "--export-lights"),
            (args.reference.reference, "--reference"),
        ];
        if let Some((_, name)) = concerns_images.into_iter().find(|(given, _)| *given) {
            let message = String::from(NO_IMAGE);
            return Err(Error::Setting { name, message });
        }
        let earlier = (args.stop.resume && path.exists()).then(|| FilmFile::read(path)).transpose()?;
        Ok(Some(Part { path, part: args.cluster.shard.unwrap_or(PartFlag { index: 0, count: 1 }), earlier }))
    }

    /// The traversal kernel: all parts must have the same, and measurements on several machines may differ.
    pub fn traversal(&self) -> Traversal {
        self.earlier.as_ref().map_or(Traversal::Auto, |film| film.traversal)
    }

    /// Whether a pass belongs to it.
    fn has(&self, number: u32) -> bool {
        number % self.part.count == self.part.index
    }

    /// Renders the passes and writes the film.
    pub fn run(self, job: &Job, mut renderer: Renderer, args: &Render, interrupted: &AtomicBool) -> Result<()> {
        let stop = Stop::choose(&renderer.scene().render);
        stop.refuse_error(NO_IMAGE)?;
        let metadata = metadata(job, "", String::new());
        let mut about = About { asked: stop.passes(), ..about(metadata, job.encoding.exposure, &renderer) };
        if let Some(earlier) = &self.earlier {
            let size = renderer.engine().view().size();
            earlier.check(self.path, renderer.fingerprint(), size, &renderer.provenance())?;
            let done = earlier.about.done();
            if let Some(other) = done.iter().find(|&number| !self.has(number)) {
                let message =
                    format!("the film has pass {other}, which is none of this part; give the same --shard as before");
                return Err(Error::file(self.path, message));
            }
            if earlier.film.passes() > 0 {
                renderer.load_film(done.end(), &earlier.film)?;
            }
            about.devices.extend(earlier.about.devices.clone());
            (about.passes, about.left_out) = (earlier.about.passes.clone(), earlier.about.left_out.clone());
        }
        let mut film = Film { path: self.path, about, checkpoint: args.stop.checkpoint.0, last: Instant::now() };
        let mut progress = Progress::new();
        let rendered = self.passes(&mut renderer, &mut film, (&stop, interrupted), &mut progress);
        progress.finish();
        if let Err(error) = rendered {
            film.rescue(&renderer);
            return Err(error);
        }
        let broken_off = interrupted.load(Ordering::Relaxed);
        let own = self.own(stop.passes().unwrap_or(0));
        if broken_off && film.about.done().is_empty() {
            return Err(Error::Interrupted);
        }
        film.write(&renderer)?;
        let passes = film.about.passes.count() as u32;
        if let Some(path) = &args.output.stats {
            let (scene, resolution) = (job.name.clone(), job.camera.resolution);
            Statistics { scene, resolution, passes, ..renderer.statistics() }.write(path)?;
        }
        let left = own.saturating_sub(film.about.done().count());
        if broken_off && left > 0 {
            say_aside(&format!("{left} of its passes are left; the same command with --resume goes on"));
        }
        let PartFlag { index, count: parts } = self.part;
        let of = if parts == 1 { String::new() } else { format!(" of part {} of {parts}", index + 1) };
        job.say_where(&format!("{}{of}, rendered in {}", count(passes), duration(progress.elapsed())));
        Ok(())
    }

    /// How many of the passes below `end` belong to it.
    fn own(&self, end: u32) -> u64 {
        u64::from(end.saturating_sub(self.part.index).div_ceil(self.part.count))
    }

    fn passes(
        &self,
        renderer: &mut Renderer,
        film: &mut Film,
        (stop, interrupted): (&Stop, &AtomicBool),
        progress: &mut Progress,
    ) -> Result<()> {
        let before = film.about.done();
        let total = stop.passes().map(|end| self.own(end));
        let numbers = (self.part.index..stop.passes().unwrap_or(u32::MAX)).step_by(self.part.count as usize);
        for (rendered, number) in (1_u32..).zip(numbers.filter(|&number| !before.has(number))) {
            let late = rendered > 1 && stop.is_late(progress.elapsed());
            if late || interrupted.load(Ordering::Relaxed) {
                break;
            }
            film.add(number, renderer.pass_of(number)?);
            film.after_pass(renderer);
            let text = || {
                let rate = f64::from(rendered) / progress.elapsed().as_secs_f64().max(1e-9);
                format!("pass {number}, {rate:.2} passes/s")
            };
            let text = text();
            let of_passes = total.map_or(0.0, |total| f64::from(rendered) / (total - before.count()).max(1) as f64);
            progress.show(|| text, of_passes.max(stop.fraction_of_time(progress.elapsed())));
        }
        Ok(())
    }
}

/// A film of the renderer's image, without passes. `metadata`: provenance of its image.
pub fn about(metadata: Metadata, exposure: Exposure, renderer: &Renderer) -> About {
    let statistics = renderer.statistics();
    let exposure = match exposure {
        Exposure::Stops(stops) => Some(stops),
        Exposure::Auto => None,
    };
    About {
        software: metadata.software,
        scene: metadata.scene,
        settings: metadata.settings,
        seed: metadata.seed,
        camera: metadata.camera,
        devices: [(renderer.provenance().device, [statistics.device, statistics.driver])].into(),
        exposure,
        part: renderer.part().map(|part| [part.origin[0], part.origin[1], part.size[0], part.size[1]]),
        summands: renderer.engine().settings().summands,
        ..About::default()
    }
}

/// The film of a renderer in its file, which is its own checkpoint.
struct Film<'a> {
    path: &'a Path,
    about: About,
    /// Time between two checkpoints; `None`: there are none.
    checkpoint: Option<Duration>,
    last: Instant,
}

impl Film<'_> {
    /// Notes a pass that is in the sums, or was left out.
    fn add(&mut self, number: u32, kept: bool) {
        if kept { self.about.passes.add(number) } else { self.about.left_out.add(number) }
    }

    fn write(&self, renderer: &Renderer) -> Result<()> {
        let (fingerprint, traversal) = (renderer.fingerprint(), renderer.provenance().traversal);
        let film = renderer.film()?.canonical();
        FilmFile { about: self.about.clone(), fingerprint, traversal, film }.write(self.path)
    }

    /// Writes the film if the last checkpoint is old enough. A failure is told, and the rendering goes on.
    fn after_pass(&mut self, renderer: &Renderer) {
        if self.checkpoint.is_none_or(|every| self.last.elapsed() < every) {
            return;
        }
        if let Err(error) = self.write(renderer) {
            log::warn!("no checkpoint, rendering goes on: {error}");
        }
        self.last = Instant::now();
    }

    /// After an error in a pass: writes the passes before it, as far as the device still gives them.
    fn rescue(&self, renderer: &Renderer) {
        if self.about.passes.is_empty() {
            return;
        }
        match self.write(renderer) {
            Ok(()) => say_aside(&format!(
                "{} before the error are in {}; the same command with --resume goes on",
                count(self.about.passes.count() as u32),
                self.path.display()
            )),
            Err(error) => log::warn!("the passes since the last checkpoint are lost: {error}"),
        }
    }
}
