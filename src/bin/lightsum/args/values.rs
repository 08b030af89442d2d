//! Parsers of flag values.

use std::path::{Path, PathBuf};
use std::time::Duration;

use glam::{DVec3, Vec3};
use lightsum::output::Format;
use lightsum::settings::Exposure;
use lightsum::view::Region;

use super::CheckpointFlag;

/// Maximum number of pixels of an image.
pub const MAX_PIXELS: u64 = 1 << 26;

pub(super) fn image_path(path: PathBuf) -> Result<PathBuf, String> {
    match Format::of(&path) {
        Ok(_) => Ok(path),
        Err(_) => Err("the name must end in .exr or .png".into()),
    }
}

/// An image or a film.
pub(super) fn output_path(path: PathBuf) -> Result<PathBuf, String> {
    match is_film(&path) || Format::of(&path).is_ok() {
        true => Ok(path),
        false => Err("the name must end in .exr, .png or .film".into()),
    }
}

/// Whether a file of this name holds a film.
pub fn is_film(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("film"))
}

/// Two numbers separated by an x.
pub fn extent(text: &str) -> Option<[u32; 2]> {
    text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]))
}

/// Four numbers separated by commas.
pub(super) fn crop(text: &str) -> Result<Region, String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, width, height]) if width > 0 && height > 0 => Ok(Region { origin: [x, y], size: [width, height] }),
        _ => Err("expected X,Y,WIDTH,HEIGHT in pixels, such as 100,50,64,48".into()),
    }
}

pub(super) fn resolution(text: &str) -> Result<[u32; 2], String> {
    let size = extent(text).ok_or("expected WIDTHxHEIGHT in pixels, such as 640x480")?;
    check_resolution(size).map(|()| size)
}

/// Refuses an image without pixels or with too many.
pub fn check_resolution([width, height]: [u32; 2]) -> Result<(), String> {
    match u64::from(width) * u64::from(height) {
        0 => Err(format!("{width}x{height} has no pixels")),
        1..=MAX_PIXELS => Ok(()),
        pixels => Err(format!("{width}x{height} has {pixels} pixels; at most {MAX_PIXELS} are possible")),
    }
}

pub(super) fn vector(text: &str) -> Result<Vec3, String> {
    point(text).map(|v| v.as_vec3())
}

/// A point of the world, in double precision: it may be far from the origin.
pub(super) fn point(text: &str) -> Result<DVec3, String> {
    let parts: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match parts.as_deref() {
        Some(&[x, y, z]) if DVec3::new(x, y, z).as_vec3().is_finite() => Ok(DVec3::new(x, y, z)),
        _ => Err("expected three numbers X,Y,Z".into()),
    }
}

pub(super) fn number(text: &str, good: impl Fn(f32) -> bool, expected: &str) -> Result<f32, String> {
    text.parse().ok().filter(|&v| f32::is_finite(v) && good(v)).ok_or_else(|| format!("expected {expected}"))
}

pub(super) fn exposure(text: &str) -> Result<Exposure, String> {
    if text == "auto" {
        return Ok(Exposure::Auto);
    }
    number(text, |v| v.abs() <= 100.0, "a number of stops from -100 to 100, or auto").map(Exposure::Stops)
}

pub(super) fn stops(text: &str) -> Result<f32, String> {
    number(text, |v| v.abs() <= 100.0, "a number of stops from -100 to 100")
}

pub(super) fn distance(text: &str) -> Result<f32, String> {
    number(text, |v| v >= 0.0, "a number of 0 or more")
}

pub(super) fn positive(text: &str) -> Result<f32, String> {
    number(text, |v| v > 0.0, "a number above 0")
}

pub(super) fn angle(text: &str) -> Result<f32, String> {
    number(text, |v| v > 0.0 && v < 180.0, "an angle in degrees between 0 and 180")
}

pub(super) fn orbit(text: &str) -> Result<[f32; 2], String> {
    let parts: Option<Vec<f32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match parts.as_deref() {
        Some(&[azimuth, elevation]) if azimuth.abs() <= 360.0 && elevation.abs() <= 90.0 => Ok([azimuth, elevation]),
        _ => Err("expected AZIMUTH,ELEVATION in degrees, up to 360 and 90".into()),
    }
}

pub(super) fn checkpoint(text: &str) -> Result<CheckpointFlag, String> {
    match text {
        "off" => Ok(CheckpointFlag(None)),
        _ => seconds(text).map(|every| CheckpointFlag(Some(every))).map_err(|expected| expected + ", or off"),
    }
}

/// A number of bytes, with K, M, G or T for powers of 1024.
pub(super) fn bytes(text: &str) -> Result<u64, String> {
    let (number, shift) = match text.char_indices().last() {
        Some((at, unit)) if unit.is_ascii_alphabetic() => (
            &text[..at],
            ["K", "M", "G", "T"].iter().position(|u| u.eq_ignore_ascii_case(&text[at..])).map(|i| 10 * (i + 1)),
        ),
        _ => (text, Some(0)),
    };
    let bytes =
        number.parse::<u64>().ok().zip(shift).and_then(|(n, shift)| n.checked_mul(1 << shift)).filter(|&n| n > 0);
    bytes.ok_or_else(|| "expected a number of bytes above 0, such as 1000000, 512M or 4G".into())
}

/// A time that may be 0 or negative, seconds.
pub(super) fn moment(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|t: &f64| t.is_finite()).ok_or_else(|| "expected a number of seconds".into())
}

/// A number per second.
pub(super) fn rate(text: &str) -> Result<f64, String> {
    number(text, |v| (1e-3..=1e6).contains(&v), "a number from 0.001 to 1000000").map(f64::from)
}

/// A host and a port, which is looked up later.
pub(super) fn address(text: &str) -> Result<String, String> {
    let is_one = |(host, port): (&str, &str)| !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0);
    match text.rsplit_once(':').is_some_and(is_one) {
        true => Ok(text.to_owned()),
        false => Err("expected HOST:PORT, such as 127.0.0.1:14158".into()),
    }
}

pub(super) fn seconds(text: &str) -> Result<Duration, String> {
    let duration = text.parse().ok().and_then(|s| Duration::try_from_secs_f64(s).ok()).filter(|d| !d.is_zero());
    duration.ok_or_else(|| "expected a number of seconds above 0".into())
}
