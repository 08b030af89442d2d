//! `lightsum merge`: films of one rendering become an image, or a film.

use std::path::{Path, PathBuf};

use lightsum::output::{self, Encoding, FilmFile, Merger};
use lightsum::{Error, Result};

use crate::args::{Merge, is_film};
use crate::render::{count, software, write_images};
use crate::{effect, say, say_aside};

/// Runs the command.
pub fn run(args: &Merge) -> Result<()> {
    let files = || args.outputs.iter().map(PathBuf::as_path);
    files().try_for_each(output::check_writable)?;
    let _claim = output::claim(files())?;
    output::check_apart(files(), &args.films)?;
    if args.denoise.is_some() {
        output::denoise::check()?;
    }
    let mut merger = Merger::default();
    // One after the other: a film takes some 300 bytes a pixel.
    for path in &args.films {
        merger.add(path, FilmFile::read(path)?)?;
    }
    let sum = merger.finish().filter(|sum| sum.film.passes() > 0);
    let Some(sum) = sum else {
        let first = args.films.first().map_or(Path::new("films"), PathBuf::as_path);
        return Err(Error::file(first, "there is no pass in these films; render some first"));
    };
    let (films, images): (Vec<PathBuf>, Vec<PathBuf>) = args.outputs.iter().cloned().partition(|path| is_film(path));
    effect::warn_display(args.exposure, args.tonemap, &images);
    let encoding = Encoding {
        float: args.float,
        color_only: args.no_layers,
        exposure: args.exposure.unwrap_or_else(|| sum.about.exposure()),
        tonemap: args.tonemap.into(),
    };
    // A failure to write one file must not prevent the others.
    let mut outcome = films.iter().map(|path| sum.write(path)).fold(Ok(()), Result::and);
    if !images.is_empty() {
        let mut metadata = sum.about.metadata();
        if args.denoise.is_some() {
            metadata.software = software(true);
        }
        outcome = outcome.and(write_images(&images, &sum.layers(), &metadata, (&encoding, args.denoise.is_some())));
    }
    outcome?;
    tell(&sum);
    let names: Vec<String> = args.outputs.iter().map(|path| path.display().to_string()).collect();
    let films = args.films.len();
    let noun = if films == 1 { "film" } else { "films" };
    say(&format!("{}: {} of {films} {noun} -> {}", sum.about.scene, count(sum.film.passes()), names.join(", ")));
    Ok(())
}

/// Says what is missing in a film, and what was left out.
pub fn tell(sum: &FilmFile) {
    let about = &sum.about;
    let missing = about.missing();
    if !missing.is_empty() {
        let all = missing.count() + about.done().count();
        say_aside(&format!("{} of {all} passes are missing: {missing}", missing.count()));
    }
    if !about.left_out.is_empty() {
        let (left, asked) = (&about.left_out, about.asked.unwrap_or(0));
        say_aside(&format!(
            "left out, with pixels that are no numbers: {left}; for as many passes as were asked for, render the parts again with \
             --resume --passes {}",
            u64::from(asked) + left.count()
        ));
    }
}
