//! The lines of OBJ and MTL files on their way to `tobj`.
//!
//! `tobj` says neither at which line it fails nor, for an index out of range, which one it is; it stops at a comment behind a
//! face, at letters that are not UTF-8 and at one number where it expects three. So each statement is checked first, at its
//! line, and written as `tobj` reads it. A line at a time: `tobj` has in hand the last one that it was given.

use std::borrow::Cow;
use std::io::{self, BufRead, Read};
use std::path::Path;

use crate::error::{Error, Result};

/// The text of a file: UTF-8 without its mark, or else Latin-1.
pub(super) fn decode(bytes: &[u8]) -> Cow<'_, str> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(bytes.iter().copied().map(char::from).collect()),
    }
}

/// Lines with their numbers (from 1); one that ends in a backslash is joined with the next.
pub(super) fn logical_lines(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut lines = (1..).zip(text.lines());
    std::iter::from_fn(move || {
        let (number, line) = lines.next()?;
        let Some(start) = line.strip_suffix('\\') else { return Some((number, Cow::Borrowed(line))) };
        let mut joined = start.to_string();
        for (_, next) in lines.by_ref() {
            joined.push(' ');
            match next.strip_suffix('\\') {
                Some(part) => joined.push_str(part),
                None => {
                    joined.push_str(next);
                    break;
                }
            }
        }
        Some((number, Cow::Owned(joined)))
    })
}

/// Splits a line into its keyword and the rest, without comments.
pub(super) fn keyword(line: &str) -> Option<(&str, &str)> {
    let line = line.trim();
    if line.is_empty() || line.starts_with('#') {
        return None;
    }
    Some(match line.split_once(char::is_whitespace) {
        Some((word, rest)) => (word, rest.trim()),
        None => (line, ""),
    })
}

/// A finite number.
pub(super) fn number(word: &str) -> Result<f32, String> {
    match word.parse::<f32>() {
        Ok(x) if x.is_finite() => Ok(x),
        Ok(_) => Err(format!("{word} is not a finite number")),
        Err(_) => Err(format!("{word:?} is not a number")),
    }
}

/// One statement: its line, keyword and rest.
#[derive(Clone, Copy)]
pub(super) struct Statement<'a> {
    pub(super) line: usize,
    pub(super) word: &'a str,
    pub(super) rest: &'a str,
}

/// Gives `text` to a function of `tobj`: for each statement the lines that `rewrite` appends to its buffer.
pub(super) fn through_tobj<T>(
    path: &Path,
    text: &str,
    rewrite: impl FnMut(Statement, &mut String) -> Result<()>,
    read: impl FnOnce(&mut dyn BufRead) -> std::result::Result<T, tobj::LoadError>,
) -> Result<T> {
    let mut feed = Feed { lines: logical_lines(text), rewrite, buffer: String::new(), used: 0, line: 0, error: None };
    let result = read(&mut feed);
    match feed.error {
        Some(error) => Err(error),
        None => result.map_err(|e| Error::at(path, feed.line, e.to_string())),
    }
}

struct Feed<L, R> {
    lines: L,
    rewrite: R,
    /// Lines not read yet, from byte `used`.
    buffer: String,
    used: usize,
    line: usize,
    error: Option<Error>,
}

impl<'a, L, R> BufRead for Feed<L, R>
where
    L: Iterator<Item = (usize, Cow<'a, str>)>,
    R: FnMut(Statement, &mut String) -> Result<()>,
{
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        while self.used == self.buffer.len() {
            self.buffer.clear();
            self.used = 0;
            let Some((line, content)) = self.lines.next() else { break };
            self.line = line;
            let Some((word, rest)) = keyword(&content) else { continue };
            if let Err(error) = (self.rewrite)(Statement { line, word, rest }, &mut self.buffer) {
                self.error = Some(error);
                return Err(io::Error::other("refused"));
            }
        }
        Ok(&self.buffer.as_bytes()[self.used..])
    }

    fn consume(&mut self, amount: usize) {
        self.used += amount;
    }
}

impl<L, R> Read for Feed<L, R>
where
    Self: BufRead,
{
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let available = self.fill_buf()?;
        let amount = available.len().min(into.len());
        into[..amount].copy_from_slice(&available[..amount]);
        self.consume(amount);
        Ok(amount)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joined_lines_keep_the_first_number() {
        let lines: Vec<(usize, String)> =
            logical_lines("a\nb \\\nc\\\r\nd\ne").map(|(n, l)| (n, l.into_owned())).collect();
        let expected = [(1, "a"), (2, "b  c d"), (5, "e")].map(|(n, l)| (n, l.to_string()));
        assert_eq!(lines, expected);
    }

    #[test]
    fn text_is_utf8_or_latin_1() {
        assert_eq!(decode("\u{feff}Türe".as_bytes()), "Türe");
        assert_eq!(decode(b"T\xfcre"), "Türe");
    }

    #[test]
    fn numbers_are_finite() {
        assert_eq!(number(".5e-01"), Ok(0.05));
        for bad in ["nan", "inf", "-inf", "1e99", "1.#QNAN", "", "1,5"] {
            assert!(number(bad).is_err(), "{bad}");
        }
    }
}
