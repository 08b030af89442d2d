//! Images of the path tracer, each computed once and then kept.

use std::fmt::{self, Write};
use std::fs;
use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use glam::Vec3;
use lightsum::accel::Bvh;
use lightsum::light::emitters::Emitters;
use lightsum::path_trace::{self, Options};
use lightsum::scene::{Camera, Scene};

/// Modules of the library that a reference depends on.
const SOURCES: [&str; 7] = ["accel", "bsdf", "light", "path_trace", "sampling", "scene", "settings"];

/// The path tracer's image. It is kept in Cargo's folder for tests, by a hash of the scene, the camera, the options, the
/// sources of the path tracer and the versions of the libraries.
pub fn path_traced(scene: &Scene, camera: &Camera, options: &Options) -> Vec<Vec3> {
    let mut hash = Hash(DefaultHasher::new());
    hash.0.write_u64(sources());
    // Debug prints floats in their shortest exact form.
    write!(hash, "{scene:?} {camera:?} {options:?}").unwrap();
    let [width, height] = options.resolution;
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("references");
    let path = folder.join(format!("{:016x}", hash.0.finish()));
    let bytes = width as usize * height as usize * size_of::<Vec3>();
    if let Some(kept) = fs::read(&path).ok().filter(|kept| kept.len() == bytes) {
        return bytemuck::pod_collect_to_vec(&kept);
    }
    let bvh = Bvh::build(scene).unwrap();
    let emitters = Emitters::of(scene, scene.emitters_are_lights).unwrap();
    let image = path_trace::render(scene, &bvh, &emitters, camera, options, |_| true).unwrap();
    fs::create_dir_all(&folder).unwrap();
    // Written beside its place and then renamed: another test may read it meanwhile.
    let new = folder.join(format!("{:016x}.{}.new", hash.0.finish(), std::process::id()));
    fs::write(&new, bytemuck::cast_slice(&image)).unwrap();
    fs::rename(&new, &path).unwrap();
    image
}

/// Hash of the sources and of the lock file.
fn sources() -> u64 {
    static SUM: OnceLock<u64> = OnceLock::new();
    *SUM.get_or_init(|| {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut files = vec![root.join("Cargo.lock")];
        for name in SOURCES {
            let before = files.len();
            let file = root.join(format!("src/{name}.rs"));
            files.extend(file.exists().then_some(file));
            add_folder(&root.join("src").join(name), &mut files);
            assert!(files.len() > before, "the library has no module {name}: the references depend on another one now");
        }
        files.sort();
        let mut hash = DefaultHasher::new();
        for file in files {
            hash.write(&fs::read(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display())));
        }
        hash.finish()
    })
}

/// Adds the files of a folder and of those in it.
fn add_folder(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() { add_folder(&path, files) } else { files.push(path) }
    }
}

/// Hashes text as it is written.
struct Hash(DefaultHasher);

impl Write for Hash {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.write(text.as_bytes());
        Ok(())
    }
}
