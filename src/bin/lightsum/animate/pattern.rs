//! Names of images with a frame number.

use std::path::{Path, PathBuf};

use lightsum::{Error, Result};

/// File name pattern with a frame number.
pub struct Pattern {
    before: String,
    digits: usize,
    after: String,
}

impl Pattern {
    /// Parses a pattern such as `frame-%04d.png`.
    pub fn new(path: &Path) -> Result<Pattern> {
        let wrong = |message: &str| {
            let message = format!("{}: {message}, as in frames/%04d.png", path.display());
            Err(Error::Setting { name: "--output", message })
        };
        let Some(text) = path.to_str() else { return wrong("the name must be readable text") };
        let Some((before, rest)) = text.split_once('%') else { return wrong("there must be a %d for the frame") };
        let Some((digits, after)) = rest.split_once('d') else { return wrong("after % there must be a d") };
        let number = digits.strip_prefix('0').unwrap_or(digits);
        let digits = match number {
            "" if digits.is_empty() => 1,
            _ => match number.parse() {
                Ok(digits @ 1..=9) => digits,
                _ => return wrong("between % and d there may be a width from 01 to 09"),
            },
        };
        if after.contains('%') {
            return wrong("there must be one % alone");
        }
        Ok(Pattern { before: before.to_owned(), digits, after: after.to_owned() })
    }

    pub fn name(&self, frame: usize) -> PathBuf {
        let Pattern { before, digits, after } = self;
        PathBuf::from(format!("{before}{frame:0digits$}{after}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_have_one_number() {
        for (pattern, name) in [("a/%04d.png", "a/0007.png"), ("f-%d.exr", "f-7.exr"), ("%3d.png", "007.png")] {
            assert_eq!(Pattern::new(Path::new(pattern)).unwrap().name(7), Path::new(name));
        }
        for wrong in ["a.png", "a%.png", "a%xd.png", "%d-%d.png", "%00d.png", "%99d.png"] {
            assert!(Pattern::new(Path::new(wrong)).is_err(), "{wrong}");
        }
    }
}
