//! `render` on several ranks.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

use cpu_time::ProcessTime;
use lightsum::output::{self, FilmFile};
use lightsum::settings::Traversal;
use lightsum::{Error, Result, input};
use serde_json::json;

use super::NOT_HERE;
use super::passes::{self, Limits, Sum};
use super::{Master, claim, processor_since, refuse_flags};
use crate::animate::write_json;
use crate::args::{Render, is_film};
use crate::merge;
use crate::progress::{Progress, duration};
use crate::render::{self, Job, count, software, write_images};
use crate::stop::{Stop, watch_for_interrupt};

/// The file of the film while it is rendered.
fn film_path(args: &Render) -> Option<PathBuf> {
    let mut name = args.output.outputs.first()?.as_os_str().to_owned();
    if !is_film(Path::new(&name)) {
        name.push(".film");
    }
    Some(PathBuf::from(name))
}

/// Runs the command.
pub fn run(master: &mut Master, args: &Render) -> Result<()> {
    refuse_flags(&[
        (args.cluster.shard.is_some(), "--shard"),
        (args.output.surfaces, "--surfaces"),
        (args.output.preview.is_some(), "--preview"),
        (args.output.display.is_some(), "--display"),
        (args.output.export_lights.is_some(), "--export-lights"),
        (args.reference.reference, "--reference"),
    ])?;
    let film_path = film_path(args);
    let of_film = film_path.as_ref().filter(|path| !args.output.outputs.contains(path));
    let files = render::outputs(args, of_film);
    let _claim = claim(&files)?;
    let earlier = match film_path.as_ref().filter(|path| args.stop.resume && path.exists()) {
        Some(path) => Some(FilmFile::read(path)?),
        None => None,
    };
    input::keep();
    let (job, scene, _) = render::prepare(args)?;
    output::check_apart(files.iter().map(PathBuf::as_path), &scene.files)?;
    let stop = Stop::choose(&scene.render);
    stop.refuse_error(NOT_HERE)?;
    drop(scene);
    let interrupted = watch_for_interrupt();
    let traversal = earlier.as_ref().map_or(Traversal::Auto, |film| film.traversal);
    master.load(args.cluster.ranks.local_scene, traversal)?;

    let mut sum = Sum::new(master, stop.passes(), film_path.as_deref())?;
    if let (Some(path), Some(earlier)) = (&film_path, earlier) {
        sum.go_on(master, path, earlier)?;
    }
    let (start, processor) = (Instant::now(), ProcessTime::now());
    let mut progress = Progress::new();
    let limits = Limits { stop: &stop, interrupted: &interrupted, checkpoint: args.stop.checkpoint.0 };
    passes::add(master, &mut sum, &limits, &mut progress)?;
    progress.finish();
    let wall = start.elapsed();
    master.end();
    finish(&mut sum, args, &job, interrupted.load(Ordering::Relaxed))?;
    if let Some(path) = &args.output.stats {
        let own = json!({
            "passes": sum.passes.count(),
            "wall": wall.as_secs_f64(),
            "processor": processor_since(processor),
            "films": sum.films,
            "film_bytes": sum.bytes,
            "merging": sum.merging.as_secs_f64(),
        });
        let resolution = job.camera.resolution;
        let value = json!({ "scene": job.name, "resolution": resolution, "master": own, "ranks": master.works() });
        write_json(path, &value)?;
    }
    let ranks = master.link.ranks();
    let passes = count(sum.passes.count() as u32);
    job.say_where(&format!("{passes} on {ranks} ranks, rendered in {}", duration(wall)));
    Ok(())
}

/// Writes the outputs. `broken_off`: passes are left.
fn finish(sum: &mut Sum, args: &Render, job: &Job, broken_off: bool) -> Result<()> {
    let Some(film) = sum.film.as_ref().filter(|film| film.film.passes() > 0) else { return Err(Error::Interrupted) };
    let (films, images): (Vec<PathBuf>, Vec<PathBuf>) = job.outputs.iter().cloned().partition(|path| is_film(path));
    let mut outcome = films.iter().map(|path| film.write(path)).fold(Ok(()), Result::and);
    if !images.is_empty() {
        let mut metadata = film.about.metadata();
        metadata.software = software(job.denoise);
        outcome = outcome.and(write_images(&images, &film.layers(), &metadata, (&job.encoding, job.denoise)));
    }
    merge::tell(film);
    if films.is_empty() {
        if args.stop.resume || broken_off || outcome.is_err() {
            sum.checkpoint();
        } else {
            sum.remove();
        }
    }
    if broken_off || outcome.is_err() {
        sum.tell();
    }
    outcome
}
