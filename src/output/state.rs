//! The state of an unfinished rendering, from which `--resume` continues bit for bit.
//!
//! Little endian: magic "LSUMSTAT", version u32, width u32, height u32, passes u32, traversal u32, length of the device's name u32,
//! fingerprint u64, length of the accumulators u64, checksum u64 (FNV-1a over all other bytes), the device's name, accumulators.

use super::{temporary, write_file};
use crate::error::{Error, Result};
use crate::settings::Traversal;
use std::path::{Path, PathBuf};

const VERSION: u32 = 3;
/// Bytes of the header up to the checksum.
const FIELDS: usize = 8 + 6 * 4 + 2 * 8;
/// Bytes of the whole header.
const HEADER: usize = FIELDS + 8;

/// What a file of this format holds.
pub(super) struct Kind {
    magic: [u8; 8],
    noun: &'static str,
    /// What to do with a file that cannot be read, or is of another rendering.
    remedy: &'static str,
}

/// An unfinished rendering.
const STATE: Kind = Kind { magic: *b"LSUMSTAT", noun: "state", remedy: "remove it to start anew" };
/// A film to be merged with others.
pub(super) const FILM: Kind = Kind { magic: *b"LSUMFILM", noun: "film", remedy: "remove it and render it again" };

/// The traversals by their numbers in the file.
const TRAVERSALS: [Traversal; 3] = [Traversal::Auto, Traversal::Single, Traversal::Cluster];

/// The device and the kernels of a rendering. Both decide about the last bits of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Provenance {
    /// The device and its driver, [`DeviceInfo::identity`](crate::gpu::DeviceInfo::identity).
    pub device: String,
    /// The traversal kernel: the one that was asked for, or [`Traversal::Auto`] or [`Traversal::Single`] as a measurement chose.
    pub traversal: Traversal,
}

/// State of an unfinished rendering.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct State {
    /// Of scene, camera and settings.
    pub fingerprint: u64,
    /// Device, driver and traversal of the passes.
    pub provenance: Provenance,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Passes done.
    pub passes: u32,
    /// The renderer's sums, and those from which it estimates the error.
    pub accumulators: Vec<u8>,
}

impl State {
    /// The state file that belongs to an output: its name with `.state` appended. In place of a name of more than 200 bytes stands a number
    /// that follows from it.
    pub fn path_for(output: &Path) -> PathBuf {
        let mut name = temporary::shortened(output.file_name().unwrap_or_default());
        name.push(".state");
        output.with_file_name(name)
    }

    /// Writes the state.
    pub fn write(&self, path: &Path) -> Result<()> {
        self.write_as(&STATE, path)
    }

    /// [`State::write`] for a file of some kind.
    pub(super) fn write_as(&self, kind: &Kind, path: &Path) -> Result<()> {
        let Provenance { device, traversal } = &self.provenance;
        let traversal = TRAVERSALS.iter().position(|t| t == traversal).unwrap_or_default() as u32;
        let mut header = Vec::with_capacity(HEADER);
        header.extend(kind.magic);
        for value in [VERSION, self.width, self.height, self.passes, traversal, device.len() as u32] {
            header.extend(value.to_le_bytes());
        }
        header.extend(self.fingerprint.to_le_bytes());
        header.extend((self.accumulators.len() as u64).to_le_bytes());
        let sum = checksum(&[&header, device.as_bytes(), &self.accumulators]);
        header.extend(sum.to_le_bytes());
        write_file(path, &[&header, device.as_bytes(), &self.accumulators])
    }

    /// Reads a state. Errors: [`Error::Io`]; [`Error::File`] if the state is incomplete, damaged or of another version.
    pub fn read(path: &Path) -> Result<State> {
        Self::read_as(&STATE, path)
    }

    /// [`State::read`] for a file of some kind.
    pub(super) fn read_as(kind: &Kind, path: &Path) -> Result<State> {
        let Kind { magic, noun, remedy } = kind;
        let mut bytes = crate::input::read(path)?;
        let refuse = |message: String| Err(Error::file(path, format!("{message}; {remedy}")));
        if bytes.get(..8) != Some(magic) {
            return refuse(format!("this is not a {noun} file of lightsum"));
        }
        if bytes.len() < HEADER {
            return refuse(format!("the {noun} is cut off"));
        }
        // Both slices lie within the header, whose length was checked.
        let u32_at = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let u64_at = |at: usize| u64::from(u32_at(at)) | u64::from(u32_at(at + 4)) << 32;
        let version = u32_at(8);
        if version != VERSION {
            return refuse(format!("the {noun} has version {version}, this program reads {VERSION}"));
        }
        let (width, height, passes) = (u32_at(12), u32_at(16), u32_at(20));
        let (traversal, name) = (u32_at(24), u32_at(28) as usize);
        let (fingerprint, length, sum) = (u64_at(32), u64_at(40), u64_at(FIELDS));
        let (present, expected) = ((bytes.len() - HEADER) as u64, length.saturating_add(name as u64));
        if expected != present {
            return refuse(format!("the {noun} is cut off: {present} of {expected} bytes are there"));
        }
        if sum != checksum(&[&bytes[..FIELDS], &bytes[HEADER..]]) {
            return refuse(format!("the {noun} is damaged: its checksum is wrong"));
        }
        // The name lies within the bytes, whose number was checked.
        let device = String::from_utf8_lossy(&bytes[HEADER..HEADER + name]).into_owned();
        let Some(&traversal) = TRAVERSALS.get(traversal as usize) else {
            return refuse(format!("the {noun} has the unknown traversal {traversal}"));
        };
        bytes.drain(..HEADER + name);
        let provenance = Provenance { device, traversal };
        Ok(State { fingerprint, provenance, width, height, passes, accumulators: bytes })
    }

    /// Checks that the state belongs to this rendering. Another device or driver is told by a warning: the passes so far have its bits,
    /// and those to come differ in the last ones. Errors: [`Error::File`] for another size, fingerprint or traversal.
    pub fn check(&self, path: &Path, fingerprint: u64, size: [u32; 2], provenance: &Provenance) -> Result<()> {
        self.check_as(&STATE, path, (fingerprint, size, provenance))
    }

    /// [`State::check`] for a file of some kind.
    pub(super) fn check_as(
        &self,
        Kind { noun, .. }: &Kind,
        path: &Path,
        (fingerprint, [width, height], provenance): (u64, [u32; 2], &Provenance),
    ) -> Result<()> {
        if (self.width, self.height) != (width, height) {
            let message = format!(
                "the {noun} is of {}x{} pixels, this rendering is {width}x{height}; \
                 give --resolution {}x{} or remove the {noun} to start anew",
                self.width, self.height, self.width, self.height
            );
            return Err(Error::file(path, message));
        }
        if self.fingerprint != fingerprint {
            let message = format!(
                "the {noun} is of another scene, camera or settings; give the same ones as before or remove the {noun} to start anew"
            );
            return Err(Error::file(path, message));
        }
        let Provenance { device, traversal } = &self.provenance;
        if *traversal != provenance.traversal {
            let message = format!(
                "the {noun} is of --traversal {}, this rendering has {}; leave the flag out to go on with that of the {noun}",
                format!("{traversal:?}").to_lowercase(),
                format!("{:?}", provenance.traversal).to_lowercase()
            );
            return Err(Error::file(path, message));
        }
        if *device != provenance.device {
            log::warn!(
                "{}: the passes so far are of {device}, the others will be of {}: the image is as good, \
                 but its last bits are those of neither",
                path.display(),
                provenance.device
            );
        }
        Ok(())
    }
}

/// FNV-1a, 64 bits.
fn checksum(parts: &[&[u8]]) -> u64 {
    let step = |hash: u64, &byte: &u8| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    parts.iter().copied().flatten().fold(0xcbf2_9ce4_8422_2325, step)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> State {
        let accumulators = (0..1000u32).flat_map(u32::to_le_bytes).collect();
        let provenance = Provenance { device: "a device, of 1984".into(), traversal: Traversal::Single };
        State { fingerprint: 0x0123_4567_89ab_cdef, provenance, width: 50, height: 20, passes: 3, accumulators }
    }

    #[test]
    fn the_checksum_is_fnv_1a() {
        // Published test vectors of the algorithm.
        assert_eq!(checksum(&[b""]), 0xcbf2_9ce4_8422_2325);
        assert_eq!(checksum(&[b"a"]), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(checksum(&[b"foo", b"bar"]), 0x8594_4171_f739_67e8);
    }

    #[test]
    fn a_state_comes_back() {
        let directory = tempfile::tempdir().unwrap();
        let path = State::path_for(&directory.path().join("a.exr"));
        assert_eq!(path.file_name().unwrap(), "a.exr.state");
        sample().write(&path).unwrap();
        let read = State::read(&path).unwrap();
        assert_eq!(read, sample());
        let made = &sample().provenance;
        read.check(&path, sample().fingerprint, [50, 20], made).unwrap();
        let other_device = Provenance { device: "another".into(), ..made.clone() };
        read.check(&path, sample().fingerprint, [50, 20], &other_device).unwrap();
        let other_size = read.check(&path, sample().fingerprint, [20, 50], made).unwrap_err().to_string();
        assert!(other_size.contains("50x20") && other_size.contains("20x50"), "{other_size}");
        let other_scene = read.check(&path, 1, [50, 20], made).unwrap_err().to_string();
        assert!(other_scene.contains("another scene"), "{other_scene}");
        let clusters = Provenance { traversal: Traversal::Cluster, ..made.clone() };
        let other_kernel = read.check(&path, sample().fingerprint, [50, 20], &clusters).unwrap_err().to_string();
        assert!(other_kernel.contains("--traversal single") && other_kernel.contains("has cluster"), "{other_kernel}");
    }

    #[test]
    fn a_state_that_is_not_whole_is_refused_with_its_reason() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.state");
        sample().write(&path).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let reason = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            State::read(&path).unwrap_err().to_string()
        };
        assert!(reason(b"").contains("not a state file"));
        assert!(reason(b"something else altogether, and long enough to hold a header").contains("not a state file"));
        for length in [8, HEADER - 1, HEADER, whole.len() - 1] {
            assert!(reason(&whole[..length]).contains("cut off"), "{length}");
        }
        let mut longer = whole.clone();
        longer.push(0);
        assert!(reason(&longer).contains("cut off"));
        for place in [12, 20, 24, 32, FIELDS, HEADER, HEADER + 20, whole.len() - 1] {
            let mut damaged = whole.clone();
            damaged[place] ^= 1;
            assert!(reason(&damaged).contains("damaged"), "{place}");
        }
        let mut newer = whole.clone();
        newer[8] = 4;
        assert!(reason(&newer).contains("version 4"));
        let mut longer_name = whole.clone();
        longer_name[28..32].fill(255);
        assert!(reason(&longer_name).contains("cut off"));
        let absent = directory.path().join("absent");
        assert!(State::read(&absent).unwrap_err().to_string().contains("absent"));
    }
}
