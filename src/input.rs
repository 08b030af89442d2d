//! The one way to the bytes of a file.
//!
//! A scene may come from anywhere and name any path. So only regular files are read: a device would never end, and a pipe would wait
//! for a writer. What a scene's files name must lie below the folder of the scene ([`Inputs`]), and all that is read and decoded for a
//! scene is counted before memory is taken for it: more than half of the machine's memory is refused, unless another limit is set.
//!
//! Or from another machine: one process keeps what it reads ([`keep`]), and others read that in place of files of their own ([`read_from`]).

use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Files by their paths, as they were named.
type Files = BTreeMap<PathBuf, Vec<u8>>;

/// Where files come from.
enum Source {
    Machine,
    /// The machine; what is read is kept.
    Kept(Files),
    /// Another machine: there are no others than these.
    Elsewhere(Files),
}

static SOURCE: Mutex<Source> = Mutex::new(Source::Machine);

fn source() -> MutexGuard<'static, Source> {
    SOURCE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps all files that this process reads from now on, for [`kept`].
pub fn keep() {
    *source() = Source::Kept(Files::new());
}

/// The files read since [`keep`], for [`read_from`] on another machine; they are no longer kept.
pub fn kept() -> Vec<u8> {
    match std::mem::replace(&mut *source(), Source::Machine) {
        Source::Kept(files) => to_bytes(files),
        Source::Machine | Source::Elsewhere(_) => Vec::new(),
    }
}

/// Has this process read the files of [`kept`], and no others; of nothing, its own again. Errors: [`Error::Scene`] if they are cut off.
pub fn read_from(bytes: &[u8]) -> Result<()> {
    let files = from_bytes(bytes).ok_or_else(|| Error::Scene(String::from("the files from rank 0 are cut off")))?;
    *source() = if files.is_empty() { Source::Machine } else { Source::Elsewhere(files) };
    Ok(())
}

/// For each file the lengths of name and content, u64 little endian, and both.
fn to_bytes(files: Files) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (path, content) in files {
        let name = path.to_string_lossy();
        [name.len(), content.len()].iter().for_each(|length| bytes.extend((*length as u64).to_le_bytes()));
        bytes.extend(name.as_bytes());
        bytes.extend(content);
    }
    bytes
}

/// The files of [`to_bytes`]; `None`: they are cut off.
fn from_bytes(mut bytes: &[u8]) -> Option<Files> {
    let mut files = Files::new();
    while !bytes.is_empty() {
        let (lengths, rest) = bytes.split_at_checked(16)?;
        let length = |at: usize| usize::try_from(u64::from_le_bytes(std::array::from_fn(|i| lengths[at + i]))).ok();
        let (name, rest) = rest.split_at_checked(length(0)?)?;
        let (content, rest) = rest.split_at_checked(length(8)?)?;
        files.insert(PathBuf::from(String::from_utf8_lossy(name).as_ref()), content.to_vec());
        bytes = rest;
    }
    Some(files)
}

/// Whether there is a regular file of this name.
pub(crate) fn is_file(path: &Path) -> bool {
    match &*source() {
        Source::Elsewhere(files) => files.contains_key(path),
        Source::Machine | Source::Kept(_) => path.is_file(),
    }
}

/// Reads a whole file that the user named. Errors: [`Error::Io`]; [`Error::File`] if it is no regular file, or larger than half of the
/// machine's memory.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    Inputs::anywhere().read(path)
}

/// Reads a whole file of UTF-8 text. Errors: as [`read`]; [`Error::File`] if it is not UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    Inputs::anywhere().read_text(path)
}

/// The files of one scene: where they may lie, and how much memory they may take together.
#[derive(Debug)]
pub struct Inputs {
    /// Folders below which they lie, without links; empty: anywhere.
    folders: Vec<PathBuf>,
    /// Bytes that they may take, and those that they have taken.
    limit: u64,
    taken: AtomicU64,
    /// Those that were read.
    read: Mutex<Vec<PathBuf>>,
}

impl Inputs {
    /// The files of a scene below its own folder. `limit`: bytes of all files and of what they are decoded to; `None`: half of the
    /// machine's memory.
    pub fn of(scene: &Path, limit: Option<u64>) -> Inputs {
        Inputs { folders: vec![folder_of(scene)], ..Inputs::within(limit) }
    }

    /// Files that lie anywhere.
    pub fn within(limit: Option<u64>) -> Inputs {
        let limit = limit.unwrap_or_else(half_of_memory);
        Inputs { folders: Vec::new(), limit, taken: AtomicU64::new(0), read: Mutex::default() }
    }

    /// Files that lie anywhere and take half of the machine's memory at most.
    pub fn anywhere() -> Inputs {
        Inputs::within(None)
    }

    /// Files may lie below the folder of this one as well. It is the model that a scene description names.
    pub fn allow_beside(&mut self, model: &Path) {
        if !self.folders.is_empty() {
            self.folders.push(folder_of(model));
        }
    }

    /// The files that were read, each as often as it was.
    pub fn into_files(self) -> Vec<PathBuf> {
        self.read.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts `bytes` of memory that `path` needs. Errors: [`Error::File`] if it is too much together with what was counted before.
    pub fn take(&self, path: &Path, bytes: u64) -> Result<()> {
        let before = self.taken.fetch_add(bytes, Ordering::Relaxed);
        match before.checked_add(bytes) {
            Some(all) if all <= self.limit => Ok(()),
            all => {
                // A file that is left out takes nothing.
                self.taken.fetch_sub(bytes, Ordering::Relaxed);
                let message = format!(
                    "needs {bytes} bytes of memory, with what was read before {}; at most {} are allowed (by default half of this \
                     machine's memory): make the scene smaller, or raise --max-input-memory",
                    all.unwrap_or(u64::MAX),
                    self.limit
                );
                Err(Error::file(path, message))
            }
        }
    }

    /// Reads a whole file of UTF-8 text. Errors: as [`Inputs::read`]; [`Error::File`] if it is not UTF-8.
    pub fn read_text(&self, path: &Path) -> Result<String> {
        let text =
            String::from_utf8(self.read(path)?).map_err(|_| Error::file(path, "is not text in UTF-8; convert it"))?;
        Ok(text.strip_prefix('\u{feff}').map(String::from).unwrap_or(text))
    }

    /// Reads a whole file. Errors: [`Error::Io`]; [`Error::File`] if it is no regular file, lies elsewhere, or is too large.
    pub fn read(&self, path: &Path) -> Result<Vec<u8>> {
        let elsewhere = match &*source() {
            // The machine where it lies has checked its place.
            Source::Elsewhere(files) => Some(files.get(path).cloned().ok_or_else(|| ErrorKind::NotFound.into())),
            Source::Machine | Source::Kept(_) => None,
        };
        let bytes = match elsewhere {
            Some(found) => {
                let bytes = found.map_err(Error::io("reading", path))?;
                self.take(path, bytes.len() as u64)?;
                bytes
            }
            None => self.read_here(path)?,
        };
        self.read.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_path_buf());
        if let Source::Kept(files) = &mut *source() {
            files.insert(path.to_path_buf(), bytes.clone());
        }
        Ok(bytes)
    }

    /// Reads a file of this machine.
    fn read_here(&self, path: &Path) -> Result<Vec<u8>> {
        // Before it is opened: that alone would wait at a pipe.
        let data = std::fs::metadata(path).map_err(Error::io("reading", path))?;
        if !data.is_file() {
            let kind = if data.is_dir() { "a directory" } else { "a device or pipe" };
            return Err(Error::file(path, format!("is {kind}; name a regular file")));
        }
        self.check_place(path)?;
        self.take(path, data.len())?;
        let mut bytes = Vec::with_capacity(data.len() as usize);
        let file = File::open(path).map_err(Error::io("reading", path))?;
        // It may grow meanwhile, and files of the kernel tell no size.
        let rest = data.len() + self.limit.saturating_sub(self.taken.load(Ordering::Relaxed));
        file.take(rest.saturating_add(1)).read_to_end(&mut bytes).map_err(Error::io("reading", path))?;
        self.take(path, (bytes.len() as u64).saturating_sub(data.len()))?;
        Ok(bytes)
    }

    /// Refuses a file outside of the folders.
    fn check_place(&self, path: &Path) -> Result<()> {
        let Some(first) = self.folders.first() else { return Ok(()) };
        let real = path.canonicalize().map_err(Error::io("finding", path))?;
        if self.folders.iter().any(|folder| real.starts_with(folder)) {
            return Ok(());
        }
        let first = first.display();
        let message = format!(
            "lies outside of the scene's folder, {first}; move it there, or give --allow-outside if this scene may read any file"
        );
        Err(Error::file(path, message))
    }
}

/// The folder of a file, without links; as it is told if it does not exist.
fn folder_of(file: &Path) -> PathBuf {
    // Of the file itself, which may be a link.
    let real = file.canonicalize();
    let folder = real.as_deref().unwrap_or(file).parent().unwrap_or(Path::new(""));
    folder.to_path_buf()
}

/// Half of the machine's memory in bytes; 4 GiB where the system does not tell.
pub(crate) fn half_of_memory() -> u64 {
    told_memory("/proc/meminfo", "MemTotal:").map_or(4 << 30, |bytes| bytes / 2)
}

/// Bytes of memory that can be had without swapping; without limit where the system does not tell.
pub(crate) fn free_memory() -> u64 {
    told_memory("/proc/meminfo", "MemAvailable:").unwrap_or(u64::MAX)
}

/// Most bytes of memory that this process had at once so far, where the system tells.
pub(crate) fn most_memory_taken() -> Option<u64> {
    told_memory("/proc/self/status", "VmHWM:")
}

/// A size that the kernel tells in a file, bytes.
fn told_memory(file: &str, name: &str) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    let kib: u64 = text.lines().find_map(|line| line.strip_prefix(name)?.split_whitespace().next()?.parse().ok())?;
    kib.checked_mul(1024)
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
        let inputs = Inputs::within(Some(7));
        assert_eq!(inputs.read(&path).unwrap(), b"abc");
        inputs.take(&path, 2).unwrap();
        let message = inputs.read(&path).unwrap_err().to_string();
        assert!(message.contains("3 bytes") && message.contains("before 8; at most 7"), "{message}");
        // What was refused does not count.
        inputs.take(&path, 2).unwrap();
        assert!(
            inputs.take(&path, 1).is_err() && inputs.take(&path, u64::MAX).is_err() && inputs.take(&path, 0).is_ok()
        );
        std::fs::write(&path, [0xff, 0xfe]).unwrap();
        assert!(read_text(&path).unwrap_err().to_string().contains("UTF-8"));
        std::fs::write(&path, "\u{feff}a = 1").unwrap();
        assert_eq!(read_text(&path).unwrap(), "a = 1", "without the mark of the byte order");
    }

    #[test]
    fn files_travel_whole() {
        let files: Files = [("a/b.toml", "x"), ("empty", ""), ("c", "content")]
            .map(|(name, content)| (PathBuf::from(name), content.as_bytes().to_vec()))
            .into();
        let bytes = to_bytes(files.clone());
        assert_eq!(from_bytes(&bytes), Some(files));
        assert_eq!(from_bytes(&[]), Some(Files::new()));
        assert_eq!(from_bytes(&bytes[..bytes.len() - 1]), None);
        assert_eq!(from_bytes(&[255; 20]), None);
    }

    #[test]
    fn files_lie_below_the_scene_or_its_model() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["scene", "scene/textures", "models", "scene2"] {
            std::fs::create_dir_all(at(name)).unwrap();
        }
        for name in
            ["scene/scene.toml", "scene/textures/a.png", "models/a.obj", "models/b.png", "scene2/c.png", "d.png"]
        {
            std::fs::write(at(name), "x").unwrap();
        }
        let refused = |inputs: &Inputs, name: &str| {
            let message = inputs.read(&at(name)).unwrap_err().to_string();
            assert!(
                message.contains("outside of the scene's folder") && message.contains("--allow-outside"),
                "{message}"
            );
        };
        let mut inputs = Inputs::of(&at("scene/scene.toml"), None);
        for inside in ["scene/textures/a.png", "scene/../scene/textures/../textures/a.png"] {
            assert_eq!(inputs.read(&at(inside)).unwrap(), b"x", "{inside}");
        }
        ["scene/../d.png", "d.png", "scene2/c.png", "models/b.png"]
            .iter()
            .for_each(|outside| refused(&inputs, outside));
        inputs.allow_beside(&at("models/a.obj"));
        assert_eq!(inputs.read(&at("models/b.png")).unwrap(), b"x");
        refused(&inputs, "d.png");
        assert_eq!(Inputs::anywhere().read(&at("d.png")).unwrap(), b"x");
    }

    #[cfg(unix)]
    #[test]
    fn links_lead_nowhere_else() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("scene")).unwrap();
        std::fs::write(at("secret"), "x").unwrap();
        std::fs::write(at("scene/scene.toml"), "x").unwrap();
        std::os::unix::fs::symlink(at("secret"), at("scene/link.png")).unwrap();
        std::os::unix::fs::symlink(at("scene/scene.toml"), at("scene.toml")).unwrap();
        assert!(Inputs::of(&at("scene/scene.toml"), None).read(&at("scene/link.png")).is_err());
        // The scene itself may be a link: its files lie beside what it leads to.
        assert_eq!(Inputs::of(&at("scene.toml"), None).read(&at("scene/scene.toml")).unwrap(), b"x");
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
        assert!(free_memory() > 1 << 20 && free_memory() < 2 * half_of_memory());
    }
}
