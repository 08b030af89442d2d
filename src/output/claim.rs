//! The outputs of a run: apart from its inputs and from each other, and written by no other run meanwhile.

use super::{Target, remove_leftovers, temporary};
use crate::error::{Error, Result};
use crate::fingerprint::Fnv;
use std::collections::HashSet;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Outputs that belong to this process until it is dropped: others that claim them are refused.
///
/// A lock of the system in the folder for temporary files stands for each output, so that a killed process leaves none locked. It holds
/// between the processes of one machine, as far as they can open each other's locks.
#[derive(Debug, Default)]
pub struct Claim(Vec<(File, PathBuf)>);

/// Claims outputs, and removes the temporary files that killed runs left beside them; devices and pipes belong to nobody. Errors:
/// [`Error::File`] if one is named twice, or claimed by another process.
pub fn claim<'a>(outputs: impl IntoIterator<Item = &'a Path>) -> Result<Claim> {
    let mut claim = Claim::default();
    let mut places = Vec::new();
    for output in outputs {
        let Target::File(_) = Target::of(output)? else { continue };
        let place = place_of(output);
        if places.contains(&place) {
            return Err(twice(output));
        }
        let mut hash = Fnv::default();
        hash.add(place.as_os_str().as_encoded_bytes());
        places.push(place);
        let path = std::env::temp_dir().join(format!("lightsum-{:016x}.lock", hash.0));
        match lock(&path) {
            Ok(Some(mut file)) => {
                // Its owner, for the message below; nothing depends on it.
                let _ = file.set_len(0).and_then(|()| write!(file, "{}", std::process::id()));
                claim.0.push((file, path));
            }
            Ok(None) if fs::read_to_string(&path).is_ok_and(|owner| owner == std::process::id().to_string()) => {
                return Err(twice(output));
            }
            Ok(None) => {
                return Err(Error::file(
                    output,
                    "another lightsum writes this file; wait for it, or give another name",
                ));
            }
            // As where the folder is full or the file is another user's: no lock is no reason not to render.
            Err(error) => log::info!("{}: not locked: {error}", output.display()),
        }
    }
    remove_leftovers(places.iter().map(PathBuf::as_path));
    Ok(claim)
}

fn twice(output: &Path) -> Error {
    Error::file(output, "is the name of two outputs; give each a name of its own")
}

impl Drop for Claim {
    fn drop(&mut self) {
        // While the lock is held, so that nobody else's file is removed. A lock file that cannot be removed does no harm.
        self.0.iter().for_each(|(_, path)| drop(fs::remove_file(path)));
    }
}

/// Locks a file; `None`: another process has.
fn lock(path: &Path) -> std::io::Result<Option<File>> {
    loop {
        let file = OpenOptions::new().create(true).truncate(false).write(true).open(path)?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => return Ok(None),
            Err(TryLockError::Error(error)) => return Err(error),
            // Its owner may have removed it after it was opened here: then the lock is that of a file without a name.
            Ok(()) if temporary::has_name(&file, path) => return Ok(Some(file)),
            Ok(()) => {}
        }
    }
}

/// Refuses outputs that are inputs of the run: they would be overwritten. Errors: [`Error::File`].
pub fn check_apart<'a>(outputs: impl IntoIterator<Item = &'a Path>, inputs: &[PathBuf]) -> Result<()> {
    let inputs: HashSet<PathBuf> = inputs.iter().map(|input| place_of(input)).collect();
    for output in outputs {
        if inputs.contains(&place_of(output)) {
            return Err(Error::file(output, "is a file that this scene is read from; give the output another name"));
        }
    }
    Ok(())
}

/// The place of a file without links, whether or not it exists.
fn place_of(path: &Path) -> PathBuf {
    if let Ok(real) = path.canonicalize() {
        return real;
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    path.file_name().map_or(folder.clone(), |name| folder.join(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_output_belongs_to_one_claim() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let message = |outputs: &[PathBuf]| claim(outputs.iter().map(PathBuf::as_path)).unwrap_err().to_string();
        let first = claim([at("a.exr").as_path(), &at("b.exr")]).unwrap();
        // Here by this process; what another one is told is tested by processes.
        assert!(message(&[at("c.exr"), at("b.exr")]).contains("b.exr: is the name of two outputs"));
        // The refused claim holds no lock.
        drop(claim([at("c.exr").as_path()]).unwrap());
        // By whatever name.
        std::fs::create_dir(at("x")).unwrap();
        assert!(message(&[folder.path().join("x/../a.exr")]).contains("two outputs"));
        drop(first);
        drop(claim([at("a.exr").as_path(), &at("b.exr")]).unwrap());
        assert!(message(&[at("a.exr"), at("a.exr")]).contains("two outputs"));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn streams_belong_to_nobody() {
        let null = Path::new("/dev/null");
        let both = [claim([null, null]).unwrap(), claim([null]).unwrap()];
        assert!(both.iter().all(|claim| claim.0.is_empty()));
    }

    #[test]
    fn outputs_are_no_inputs() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("scene.toml"), "").unwrap();
        std::fs::create_dir(at("out")).unwrap();
        let inputs = [at("scene.toml"), at("gone.png")];
        check_apart([at("out/scene.toml").as_path(), &at("a.exr")], &inputs).unwrap();
        for wrong in ["scene.toml", "out/../scene.toml", "gone.png"] {
            let message = check_apart([at(wrong).as_path()], &inputs).unwrap_err().to_string();
            assert!(message.contains("is read from"), "{message}");
        }
    }
}
