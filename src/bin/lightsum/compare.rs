//! `lightsum compare`: how much two images differ.

use glam::Vec3;
use lightsum::output::compare::{Picture, compare};
use lightsum::output::{self, Encoding, Layers, Metadata};
use lightsum::{Error, Result};

use crate::args::{Compare, Measure};
use crate::render::SOFTWARE;
use crate::say;

/// Prints the measures; returns whether the images differ by no more than is allowed.
pub fn run(args: &Compare) -> Result<bool> {
    if let Some(path) = &args.output {
        output::check_writable(path)?;
        output::check_apart([path.as_path()], &[args.image.clone(), args.reference.clone()])?;
    }
    let _claim = output::claim(args.output.as_deref())?;
    let (image, reference) = (Picture::read(&args.image)?, Picture::read(&args.reference)?);
    let (found, map) =
        compare(&image, &reference, args.exposure).map_err(|message| Error::file(&args.image, message))?;
    if found.no_numbers > 0 {
        log::warn!("{} pixels are no numbers (NaN or infinite) and are left out", found.no_numbers);
    }
    if let Some(path) = &args.output {
        let [width, height] = found.resolution;
        let color: Vec<Vec3> = map.iter().map(|value| Vec3::splat(*value)).collect();
        let layers = Layers { width, height, alpha: vec![1.0; color.len()], color, ..Layers::default() };
        let metadata = Metadata { software: SOFTWARE.into(), ..Metadata::default() };
        output::write(path, &layers, &metadata, &Encoding::default())?;
    }
    if args.json {
        let text = serde_json::to_string_pretty(&found).map_err(|e| Error::file(&args.image, e.to_string()))?;
        say(&text);
    } else {
        let energy = found.energy.map_or(String::from("none, the reference is black"), |energy| format!("{energy:.6}"));
        say(&format!("relative RMSE {:.6}, energy {energy}, FLIP {:.6}", found.relative_rmse, found.flip));
    }
    let measured = match args.measure {
        Measure::Rmse => found.relative_rmse,
        Measure::Flip => found.flip,
        Measure::Energy => found.energy.map_or(f64::INFINITY, |energy| (energy - 1.0).abs()),
    };
    Ok(args.fail_above.is_none_or(|limit| measured <= f64::from(limit)) && found.no_numbers < map.len().max(1))
}
