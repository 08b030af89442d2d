//! Temporary files beside outputs, and those that killed processes left.
//!
//! A temporary file is locked while it is written, so that one without a lock belongs to no process that lives, on this machine or on another
//! that shares the folder. Where the system cannot lock, nothing is removed.

use crate::error::{Error, Result};
use crate::fingerprint::Fnv;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Names longer than this are shortened: systems allow 255 bytes with what is added here.
const LONGEST: usize = 200;

/// Ends the name of each temporary file.
const SUFFIX: &str = ".tmp";

/// The name of a temporary file, which is removed unless it is renamed.
pub(super) struct Temporary {
    path: PathBuf,
    is_renamed: bool,
}

impl Temporary {
    /// Creates one next to `place`, locked until the file is closed; errors name `path`, as given by the user.
    pub fn create(path: &Path, place: &Path) -> Result<(File, Temporary)> {
        let Some(name) = place.file_name() else {
            return Err(Error::file(path, "is not the name of a file"));
        };
        let mut attempt = 0;
        loop {
            let mut hidden = stem(name);
            hidden.push(format!("{}-{attempt}{SUFFIX}", std::process::id()));
            let temporary = place.with_file_name(hidden);
            match OpenOptions::new().write(true).create_new(true).open(&temporary) {
                Ok(file) => {
                    let is_taken = matches!(file.try_lock(), Err(TryLockError::WouldBlock));
                    if !is_taken && has_name(&file, &temporary) {
                        return Ok((file, Temporary { path: temporary, is_renamed: false }));
                    }
                    // Another process took it for a leftover before it was locked, and removes it.
                    attempt += 1;
                }
                // The name is taken by another thread, or by a killed process with the same id.
                Err(e) if e.kind() == ErrorKind::AlreadyExists && attempt < 100 => attempt += 1,
                Err(e) if e.kind() == ErrorKind::NotFound => {
                    return Err(Error::file(path, "its folder does not exist; make it first"));
                }
                Err(e) => return Err(Error::io("creating a file beside it", path)(e)),
            }
        }
    }

    pub fn rename_to(mut self, place: &Path) -> std::io::Result<()> {
        fs::rename(&self.path, place)?;
        self.is_renamed = true;
        // So that the name outlasts a power failure, where folders can be synchronised.
        #[cfg(unix)]
        if let Some(folder) = place.parent() {
            let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
            let _ = File::open(folder).and_then(|folder| folder.sync_all());
        }
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // After a rename the name may be that of another thread's file.
        if !self.is_renamed {
            // The next run removes a file that this one could not.
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// A name that leaves room for what is added to it; in place of a long one a number that follows from it.
pub fn shortened(name: &OsStr) -> OsString {
    if name.len() <= LONGEST {
        return name.into();
    }
    let mut hash = Fnv::default();
    hash.add(name.as_encoded_bytes());
    OsString::from(format!("{:016x}", hash.0))
}

/// The beginning of the names of all temporary files of an output.
fn stem(name: &OsStr) -> OsString {
    let mut stem = OsString::from(".");
    stem.push(shortened(name));
    stem.push(".");
    stem
}

/// Removes the temporary files of these outputs that no process holds. Files stay that cannot be listed or removed.
pub fn remove_leftovers<'a>(places: impl Iterator<Item = &'a Path>) {
    let mut stems: BTreeMap<&Path, BTreeSet<Vec<u8>>> = BTreeMap::new();
    for place in places {
        if let (Some(folder), Some(name)) = (place.parent(), place.file_name()) {
            stems.entry(folder).or_default().insert(stem(name).into_encoded_bytes());
        }
    }
    for (folder, stems) in stems {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            if stem_of(&entry.file_name()).is_some_and(|stem| stems.contains(stem)) {
                remove_unless_held(&entry.path());
            }
        }
    }
}

/// The stem of a temporary file's name, which the numbers of a process and of an attempt follow.
fn stem_of(name: &OsStr) -> Option<&[u8]> {
    let is_number = |text: &[u8]| !text.is_empty() && text.iter().all(u8::is_ascii_digit);
    let name = name.as_encoded_bytes().strip_suffix(SUFFIX.as_bytes())?;
    let (stem, numbers) = name.split_at(name.iter().rposition(|&byte| byte == b'.')? + 1);
    let dash = numbers.iter().position(|&byte| byte == b'-')?;
    (is_number(&numbers[..dash]) && is_number(&numbers[dash + 1..])).then_some(stem)
}

fn remove_unless_held(path: &Path) {
    // No link is followed, and no pipe opened, which would wait for its reader.
    if !fs::symlink_metadata(path).is_ok_and(|data| data.is_file()) {
        return;
    }
    let Ok(file) = OpenOptions::new().write(true).open(path) else { return };
    if file.try_lock().is_ok() && has_name(&file, path) {
        match fs::remove_file(path) {
            Ok(()) => log::info!("removed {}, which a run that was killed has left", path.display()),
            Err(error) => log::info!("{}: a run that was killed has left it: {error}", path.display()),
        }
    }
}

/// Whether a path still names this open file: its owner may have removed or renamed it before it was locked here.
pub(super) fn has_name(file: &File, path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|named| is_same(&named, file))
}

#[cfg(unix)]
fn is_same(named: &fs::Metadata, file: &File) -> bool {
    use std::os::unix::fs::MetadataExt;
    file.metadata().is_ok_and(|own| (own.dev(), own.ino()) == (named.dev(), named.ino()))
}

#[cfg(not(unix))]
fn is_same(_: &fs::Metadata, _: &File) -> bool {
    // An open file keeps its name.
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn leftovers_go_and_all_else_stays() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let gone = [".a.exr.1-0.tmp", ".a.exr.4194304-17.tmp", ".a.exr.state.77-3.tmp"];
        let stays = [
            ".a.exr.1-0.tmpx",
            ".a.exr.1.tmp",
            ".a.exr.x-0.tmp",
            ".a.exr.1-0-0.tmp",
            ".b.exr.1-0.tmp",
            "a.exr.1-0.tmp",
        ];
        gone.iter().chain(&stays).for_each(|name| fs::write(at(name), "part").unwrap());
        let (file, held) = Temporary::create(Path::new("a.exr"), &at("a.exr")).unwrap();
        let (image, state) = (at("a.exr"), at("a.exr.state"));
        remove_leftovers([image.as_path(), &state].into_iter());
        let mut expected: Vec<_> = stays.iter().map(ToString::to_string).collect();
        expected.push(held.path.file_name().unwrap().to_string_lossy().into_owned());
        expected.sort();
        assert_eq!(names(folder.path()), expected);
        held.rename_to(&image).unwrap();
        drop(file);
        remove_leftovers([image.as_path(), &state].into_iter());
        assert!(image.exists());
    }

    #[test]
    fn a_claim_and_a_set_remove_leftovers() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at(".a.exr.1-0.tmp"), "part").unwrap();
        drop(super::super::claim([at("a.exr").as_path()]).unwrap());
        assert!(names(folder.path()).is_empty());
        fs::write(at(".b.png.1-0.tmp"), "part").unwrap();
        let mut files = super::super::FileSet::default();
        for name in ["a.gltf", "b.png"] {
            files.add(&at(name), &[b"new"]).unwrap();
        }
        files.commit().unwrap();
        assert_eq!(names(folder.path()), ["a.gltf", "b.png"]);
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_file_stays() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("other"), "").unwrap();
        std::os::unix::fs::symlink(at("other"), at(".a.1-0.tmp")).unwrap();
        fs::create_dir(at(".a.2-0.tmp")).unwrap();
        remove_leftovers([at("a").as_path()].into_iter());
        assert_eq!(names(folder.path()), [".a.1-0.tmp", ".a.2-0.tmp", "other"]);
    }

    #[test]
    fn names_may_be_as_long_as_the_system_allows() {
        let folder = tempfile::tempdir().unwrap();
        let name = format!("{}.exr", "n".repeat(251));
        super::super::write_file(&folder.path().join(&name), &[b"x"]).unwrap();
        assert_eq!(names(folder.path()), [name]);
        assert_ne!(stem(OsStr::new(&"a".repeat(201))), stem(OsStr::new(&"b".repeat(201))));
    }

    #[test]
    fn many_threads_write_beside_a_remover() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("a.bin");
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| (0..100).for_each(|_| super::super::write_file(&place, &[b"whole"]).unwrap()));
            }
            scope.spawn(|| (0..400).for_each(|_| remove_leftovers([place.as_path()].into_iter())));
        });
        assert_eq!(fs::read(&place).unwrap(), b"whole");
        assert_eq!(names(folder.path()), ["a.bin"]);
    }
}
