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
/// Maximum width and height of an image.
const MAX_SIDE: u32 = 65_536;
/// Greatest length in scene units.
const FARTHEST: f32 = 1e9;
/// Least height of the image of an orthographic camera.
const LOWEST_IMAGE: f32 = 1e-15;
/// Longest time between two files, seconds.
const MAX_SECONDS: f64 = 1e9;

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
    if width.max(height) > MAX_SIDE {
        return Err(format!("{width}x{height} is larger than {MAX_SIDE} pixels each way"));
    }
    match u64::from(width) * u64::from(height) {
        0 => Err(format!("{width}x{height} has no pixels")),
        1..=MAX_PIXELS => Ok(()),
        pixels => Err(format!("{width}x{height} has {pixels} pixels; at most {MAX_PIXELS} are possible")),
    }
}

/// A direction, whose length single precision can square.
pub(super) fn direction(text: &str) -> Result<Vec3, String> {
    let expected = "expected a direction X,Y,Z of a length from 1e-15 to 1e15";
    let v = point(text).map_err(|_| expected)?.as_vec3();
    if v.normalize_or_zero() == Vec3::ZERO { Err(expected.into()) } else { Ok(v) }
}

/// A point of the world, in double precision: it may be far from the origin.
pub(super) fn point(text: &str) -> Result<DVec3, String> {
    let parts: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match parts.as_deref() {
        Some(&[x, y, z]) if DVec3::new(x, y, z).as_vec3().is_finite() => Ok(DVec3::new(x, y, z)),
        _ => Err("expected three finite numbers X,Y,Z".into()),
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

/// A length; the checks of cameras have the same range.
pub(super) fn length(text: &str) -> Result<f32, String> {
    number(text, |v| v > 0.0 && v <= FARTHEST, "a length above 0, at most 1e9")
}

/// A length that may be 0.
pub(super) fn length_or_0(text: &str) -> Result<f32, String> {
    number(text, |v| (0.0..=FARTHEST).contains(&v), "a length from 0 to 1e9")
}

/// A height of the image of an orthographic camera.
pub(super) fn image_height(text: &str) -> Result<f32, String> {
    number(text, |v| (LOWEST_IMAGE..=FARTHEST).contains(&v), "a length from 1e-15 to 1e9")
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
    let seconds = text.parse().ok().filter(|&s: &f64| s <= MAX_SECONDS);
    let duration = seconds.and_then(|s| Duration::try_from_secs_f64(s).ok()).filter(|d| !d.is_zero());
    duration.ok_or_else(|| "expected a number of seconds above 0, at most 1000000000".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flag: its parser, what it takes, what it refuses besides [`NO_NUMBERS`], and a word of its message.
    type Flag<'a> = (&'a dyn Fn(&str) -> Result<(), String>, &'a [&'a str], &'a [&'a str], &'a str);

    /// Texts that every flag for a number refuses.
    const NO_NUMBERS: [&str; 9] = ["nan", "-nan", "inf", "-inf", "infinity", "", " ", "1e999", "1,5x"];

    /// A parser whose value does not matter.
    fn only<T>(parser: impl Fn(&str) -> Result<T, String>) -> impl Fn(&str) -> Result<(), String> {
        move |text| parser(text).map(drop)
    }

    #[test]
    fn numbers_are_taken_at_both_ends_of_their_ranges_and_refused_beyond() {
        let flags: &[Flag] = &[
            (&only(angle), &["1e-3", "179.99"], &["0", "-0", "-1", "180", "1e39"], "between 0 and 180"),
            (&only(image_height), &["1e-15", "1e9"], &["0", "-0", "-1", "9e-16", "1.001e9", "1e39"], "1e-15 to 1e9"),
            (&only(length), &["1e-45", "1e9"], &["0", "-0", "-1", "1.001e9", "1e39"], "above 0, at most 1e9"),
            (&only(length_or_0), &["0", "-0", "1e-45", "1e9"], &["-1e-45", "-1", "1.001e9", "1e39"], "from 0 to 1e9"),
            (&only(distance), &["0", "-0", "1e-45", "3.4e38"], &["-1e-45", "-1", "1e39"], "0 or more"),
            (&only(positive), &["1e-45", "3.4e38"], &["0", "-0", "-1", "1e39"], "above 0"),
            (&only(stops), &["-100", "-0", "0", "100"], &["-100.1", "100.1", "auto", "1e39"], "from -100 to 100"),
            (
                &only(exposure),
                &["-100", "-0", "100", "auto"],
                &["-100.1", "100.1", "Auto", "1e39"],
                "-100 to 100, or auto",
            ),
            (
                &only(seconds),
                &["1e-9", "1e9"],
                &["0", "-0", "-1", "1.1e9", "1e300", "off"],
                "above 0, at most 1000000000",
            ),
            (&only(checkpoint), &["1e-9", "1e9", "off"], &["0", "-0", "-1", "1.1e9", "Off"], "1000000000, or off"),
            (&only(moment), &["-0", "0", "1e300", "-1e300"], &["1 s"], "a number of seconds"),
            (&only(rate), &["0.001", "1000000"], &["0", "-0", "-1", "0.0009", "1000001", "1e39"], "0.001 to 1000000"),
            (
                &only(bytes),
                &["1", "1k", "16777215T", "18446744073709551615"],
                &["0", "-0", "-1", "0G", "1.5G", "16777216T", "18446744073709551616", "1P", "1e9", "G", "1\u{e9}"],
                "bytes above 0",
            ),
            (
                &only(resolution),
                &["1x1", "65536x1024", "1X65536"],
                &[
                    "0x1",
                    "1x0",
                    "-1x1",
                    "-0x1",
                    "65537x1",
                    "1x65537",
                    "8193x8192",
                    "4294967296x1",
                    "1.5x1",
                    "nanx1",
                    "1",
                ],
                "",
            ),
            (
                &only(crop),
                &["0,0,1,1", "4294967295,4294967295,4294967295,4294967295"],
                &["0,0,0,1", "0,0,1,0", "-1,0,1,1", "-0,0,1,1", "4294967296,0,1,1", "0,0,1", "0,0,1,1,1", "nan,0,1,1"],
                "X,Y,WIDTH,HEIGHT",
            ),
            (
                &only(orbit),
                &["-360,-90", "360,90", "-0,-0"],
                &["360.1,0", "-360.1,0", "0,90.1", "0,-90.1", "nan,0", "0,nan", "inf,0", "0,-inf", "0", "0,0,0"],
                "up to 360 and 90",
            ),
            (
                &only(point),
                &["0,-0,3.4e38", "-3.4e38,1e-320,0"],
                &["1e39,0,0", "0,-1e39,0", "0,0,nan", "inf,0,0", "0,0", "0,0,0,0"],
                "three finite numbers",
            ),
            (
                &only(direction),
                &["0,1e-15,0", "0,0,-1e15", "-0,1,0"],
                &["0,0,0", "-0,-0,-0", "0,1e-30,0", "0,1e30,0", "0,nan,0", "0,inf,0", "1,0"],
                "1e-15 to 1e15",
            ),
            (
                &only(address),
                &["127.0.0.1:1", "::1:65535", "host:14158"],
                &["host:0", "host:-0", "host:65536", "host:-1", "host:nan", "host", ":1"],
                "HOST:PORT",
            ),
        ];
        let mut wrong = Vec::new();
        for (parser, good, bad, words) in flags {
            wrong.extend(good.iter().filter_map(|text| Some(format!("refused: {text:?}: {}", parser(text).err()?))));
            for text in bad.iter().copied().chain(NO_NUMBERS) {
                match parser(text) {
                    Ok(()) => wrong.push(format!("accepted: {text:?} ({words})")),
                    Err(message) if message.contains(words) && message.len() > 10 => {}
                    Err(message) => wrong.push(format!("{text:?}: {message:?} lacks {words:?}")),
                }
            }
        }
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }
}
