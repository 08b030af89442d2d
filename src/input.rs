//! The one way to the bytes of a file.
//!
//! A scene may come from anywhere and name any path. So only regular files are read: a device would never end, and a pipe would wait
//! for a writer. A file larger than half of the machine's memory is refused before memory is taken for it.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Reads a whole file. Errors: [`Error::Io`]; [`Error::File`] if it is no regular file, or too large.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    read_at_most(path, half_of_memory())
}

/// Reads a whole file of UTF-8 text. Errors: as [`read`]; [`Error::File`] if it is not UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    String::from_utf8(read(path)?).map_err(|_| Error::file(path, "is not text in UTF-8; convert it"))
}

fn read_at_most(path: &Path, limit: u64) -> Result<Vec<u8>> {
    // Before it is opened: that alone would wait at a pipe.
    let data = std::fs::metadata(path).map_err(Error::io("reading", path))?;
    if !data.is_file() {
        let kind = if data.is_dir() { "a directory" } else { "a device or pipe" };
        return Err(Error::file(path, format!("is {kind}; name a regular file")));
    }
    let too_large = |bytes: u64| {
        let message =
            format!("has {bytes} bytes or more, over half of this machine's memory ({limit}); make it smaller");
        Err(Error::file(path, message))
    };
    if data.len() > limit {
        return too_large(data.len());
    }
    let mut bytes = Vec::with_capacity(data.len() as usize);
    // It may grow meanwhile, and files of the kernel tell no size.
    let file = File::open(path).map_err(Error::io("reading", path))?;
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(Error::io("reading", path))?;
    if bytes.len() as u64 > limit { too_large(bytes.len() as u64) } else { Ok(bytes) }
}

/// Half of the machine's memory in bytes; 4 GiB where the system does not tell.
pub(crate) fn half_of_memory() -> u64 {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let total = text.lines().find_map(|line| line.strip_prefix("MemTotal:")?.split_whitespace().next()?.parse().ok());
    total.map_or(4 << 30, |kib: u64| kib * 512)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regular_files_within_the_limit_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "abc").unwrap();
        assert_eq!(read(&path).unwrap(), b"abc");
        assert_eq!(read_text(&path).unwrap(), "abc");
        assert_eq!(read_at_most(&path, 3).unwrap(), b"abc");
        let message = read_at_most(&path, 2).unwrap_err().to_string();
        assert!(message.contains("3 bytes") && message.contains("memory (2)"), "{message}");
        std::fs::write(&path, [0xff, 0xfe]).unwrap();
        assert!(read_text(&path).unwrap_err().to_string().contains("UTF-8"));
    }

    #[test]
    fn other_things_are_refused_with_their_kind() {
        let folder = tempfile::tempdir().unwrap();
        assert!(read(folder.path()).unwrap_err().to_string().contains("is a directory"));
        assert!(read(&folder.path().join("absent")).unwrap_err().to_string().contains("absent"));
    }

    #[cfg(unix)]
    #[test]
    fn devices_and_pipes_are_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let link = folder.path().join("link");
        std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
        for path in [&pipe, &link, Path::new("/dev/zero")] {
            let message = read(path).unwrap_err().to_string();
            assert!(message.contains("a device or pipe"), "{message}");
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn files_of_the_kernel_tell_no_size_and_are_read() {
        assert!(!read(Path::new("/proc/self/status")).unwrap().is_empty());
        assert!(half_of_memory() > 1 << 20);
    }
}
