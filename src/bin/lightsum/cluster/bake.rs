//! `bake` on several ranks: part by part, each by its passes.
//!
//! The master needs a device too: it finds the lit sides and lays out the charts as every rank does, and fills the maps in the end.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

use lightsum::bake::Bake;
use lightsum::output::{self, FilmFile};
use lightsum::settings::Traversal;
use lightsum::{Error, Result, input, standalone};

use super::NOT_HERE;
use super::passes::{self, Limits, Sum};
use super::{Master, claim, refuse_flags};
use crate::args;
use crate::bake::{options, prepare, write};
use crate::progress::Progress;
use crate::stop::{Stop, watch_for_interrupt};

/// The file of the film of a part.
fn film_path(output: &Path, part: usize) -> PathBuf {
    let mut name = OsString::from(output);
    name.push(format!(".{part}.film"));
    PathBuf::from(name)
}

/// Runs the command.
pub fn run(master: &mut Master, args: &args::Bake) -> Result<()> {
    refuse_flags(&[(args.adaptive.options().is_some(), "--adaptive")])?;
    let first = film_path(&args.output, 0);
    let files = [args.output.clone(), first.clone()];
    let _claim = claim(&files)?;
    let earlier = if args.stop.resume && first.exists() { Some(FilmFile::read(&first)?) } else { None };
    let traversal = earlier.map_or(Traversal::Auto, |film| film.traversal);
    input::keep();
    let (scene, settings) = prepare(args)?;
    output::check_apart(files.iter().map(PathBuf::as_path), &scene.files)?;
    let stop = Stop::choose(&scene.render);
    stop.refuse_time(NOT_HERE)?;
    stop.refuse_error(NOT_HERE)?;
    let interrupted = watch_for_interrupt();
    master.load(args.cluster.local_scene, traversal)?;
    let (context, settings) = standalone::open(settings, &options(args, Some(traversal)))?;
    let bake = Bake::new(&context, &scene, settings.clone(), args.options())?;

    let start = Instant::now();
    let paths: Vec<PathBuf> = (0..bake.batches().len()).map(|part| film_path(&args.output, part)).collect();
    let mut progress = Progress::new();
    let (mut sums, mut images) = (Vec::new(), Vec::new());
    let limits = Limits { stop: &stop, interrupted: &interrupted, checkpoint: args.stop.checkpoint.0 };
    for (part, path) in paths.iter().enumerate() {
        if part > 0 {
            master.part(part)?;
        }
        let size = bake.batches()[part].atlas.size;
        if size != master.ready[0].size {
            return master.refuse(1, "it lays out other charts than rank 0: give all ranks devices of one kind");
        }
        let mut sum = Sum::new(master, stop.passes(), Some(path))?;
        if args.stop.resume && path.exists() {
            sum.go_on(master, path, FilmFile::read(path)?)?;
        }
        passes::add(master, &mut sum, &limits, &mut progress)?;
        let broken_off = interrupted.load(Ordering::Relaxed);
        if args.stop.resume || paths.len() > 1 || broken_off {
            sum.checkpoint();
        }
        if broken_off {
            sum.tell();
            if sum.film.is_none() || part + 1 < paths.len() {
                return if sum.film.is_none() { Err(Error::Interrupted) } else { Ok(()) };
            }
        }
        images.extend(sum.film.take().map(|film| film.layers()));
        sums.push(sum);
    }
    progress.finish();
    master.end();
    let passes = sums.iter().map(|sum| sum.passes.count() as u32).min().unwrap_or(0);
    let light = bake.finish(&images, passes)?;
    write(args, (&context, &scene), &settings, &light, (passes, None), start)?;
    if !args.stop.resume {
        sums.iter().for_each(Sum::remove);
    }
    Ok(())
}
