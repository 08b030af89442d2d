//! Output files: EXR with layers, PNG for display, statistics, and the state for resuming.
//!
//! Every file is written under a temporary name in the same folder and then renamed, so that a reader never sees a partial
//! file and a failed run leaves an existing file unchanged. The next run on the same output removes
//! the temporary files of a killed one ([`claim`]). Same layers, same metadata: same bytes.

mod claim;
#[cfg(feature = "images")]
pub mod compare;
#[cfg(feature = "images")]
mod cryptomatte;
pub mod denoise;
#[cfg(feature = "images")]
mod exr;
mod film_file;
pub mod flip;
mod png;
mod state;
mod stats;
pub mod surfaces;
mod temporary;

pub use claim::{Claim, check_apart, claim};
pub use film_file::{About, FilmFile, Merger};
pub use png::Tonemap;
#[cfg(feature = "images")]
pub(crate) use png::encode as encode_png;
pub use state::{Provenance, State};
pub use stats::Statistics;
pub use surfaces::Surfaces;
pub use temporary::remove_leftovers;

use crate::error::{Error, Result};
use crate::settings::Exposure;
use crate::view::Region;
use glam::Vec3;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use temporary::Temporary;

/// A rendered image with its layers: row by row from the top, linear Rec. 709, `width * height` values each.
///
/// A layer other than `color` may be empty; it is then omitted from the file. In mirrors and through glass, layers show the
/// surface seen there; of two components they show transmission rather than reflection, and the base rather than its gloss.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layers {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Radiance L towards the eye, W/(m^2 sr).
    pub color: Vec<Vec3>,
    /// Albedo (diffuse and specular) of the visible surface, times the weight of mirrors and glass on the way, in [0, 1].
    pub albedo: Vec<Vec3>,
    /// Shading normal in world space, unit length; zero on the background.
    pub normal: Vec<Vec3>,
    /// Distance from the eye along the view direction, scene units, with paths through mirrors and glass unfolded to a straight
    /// line; infinite on the background.
    pub depth: Vec<f32>,
    /// Direct irradiance E from the emitters, W/m^2.
    pub direct: Vec<Vec3>,
    /// Indirect irradiance E, after one or more reflections, W/m^2.
    pub indirect: Vec<Vec3>,
    /// Radiance emitted by the visible surface. With `diffuse` and `specular` it adds up to `color`.
    pub emission: Vec<Vec3>,
    /// Radiance reflected diffusely.
    pub diffuse: Vec<Vec3>,
    /// Radiance reflected or transmitted by the specular lobe, a mirror or glass.
    pub specular: Vec<Vec3>,
    /// Coverage of the pixel by the scene, in [0, 1].
    pub alpha: Vec<f32>,
    /// Objects, materials, texture coordinates and motion.
    pub surfaces: Surfaces,
}

impl Layers {
    /// Every layer of colours, then those of numbers.
    fn parts(&mut self) -> ([&mut Vec<Vec3>; 8], [&mut Vec<f32>; 8]) {
        let colors = [
            &mut self.color,
            &mut self.albedo,
            &mut self.normal,
            &mut self.direct,
            &mut self.indirect,
            &mut self.emission,
            &mut self.diffuse,
            &mut self.specular,
        ];
        let [object, material, u, v, x, y] = self.surfaces.parts();
        (colors, [&mut self.depth, &mut self.alpha, object, material, u, v, x, y])
    }

    /// The part of the image within a region, which must lie in it.
    pub fn cut(mut self, region: Region) -> Layers {
        fn cut<T: Copy>(layer: &mut Vec<T>, width: usize, region: Region) {
            let [x, y] = region.origin.map(|n| n as usize);
            let [columns, rows] = region.size.map(|n| n as usize);
            if !layer.is_empty() {
                *layer = (y..y + rows).flat_map(|y| &layer[y * width + x..][..columns]).copied().collect();
            }
        }
        let width = self.width as usize;
        let (colors, numbers) = self.parts();
        colors.into_iter().for_each(|layer| cut(layer, width, region));
        numbers.into_iter().for_each(|layer| cut(layer, width, region));
        [self.width, self.height] = region.size;
        self
    }

    /// Puts the rows of another image of the same width and layers below those of this one; an empty image becomes the other.
    pub fn append_rows(&mut self, mut other: Layers) {
        let (own, new) = (self.parts(), other.parts());
        own.0.into_iter().zip(new.0).for_each(|(own, new)| own.append(new));
        own.1.into_iter().zip(new.1).for_each(|(own, new)| own.append(new));
        self.width = other.width;
        self.height += other.height;
    }

    /// Checks that each layer has as many values as the image has pixels.
    fn validate(&self, path: &Path) -> Result<()> {
        let pixels = u64::from(self.width) * u64::from(self.height);
        let check = |name: &str, length: usize, optional: bool| {
            if length as u64 == pixels && pixels > 0 || optional && length == 0 {
                return Ok(());
            }
            let (width, height) = (self.width, self.height);
            Err(Error::file(path, format!("layer {name} has {length} values for an image of {width}x{height} pixels")))
        };
        check("color", self.color.len(), false)?;
        check("albedo", self.albedo.len(), true)?;
        check("normal", self.normal.len(), true)?;
        check("depth", self.depth.len(), true)?;
        check("irradiance_direct", self.direct.len(), true)?;
        check("irradiance_indirect", self.indirect.len(), true)?;
        check("emission", self.emission.len(), true)?;
        check("diffuse", self.diffuse.len(), true)?;
        self.surfaces.channels().iter().try_for_each(|(name, values)| check(name, values.len(), true))?;
        check("specular", self.specular.len(), true)?;
        check("alpha", self.alpha.len(), true)
    }
}

/// Provenance of an image, written as attributes of the EXR file. Empty texts are omitted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metadata {
    /// Program and version.
    pub software: String,
    /// Name of the scene.
    pub scene: String,
    /// Settings, as JSON.
    pub settings: String,
    /// Seed.
    pub seed: u64,
    /// Passes in the image.
    pub passes: u32,
    /// Camera, as JSON.
    pub camera: String,
    /// Name of the device.
    pub device: String,
    /// Name and version of its driver.
    pub driver: String,
}

/// Encoding of an image file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Encoding {
    /// Colour of an EXR file as 32-bit float instead of half: twice the size, no rounding, no overflow at 65504.
    pub float: bool,
    /// Write an EXR file without layers, for programs that read only colour and alpha.
    pub color_only: bool,
    /// Exposure of a PNG file.
    pub exposure: Exposure,
    /// Tone curve of a PNG file.
    pub tonemap: Tonemap,
}

/// Which layers of an image are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// Colour and coverage. A renderer then reads back a third of what all layers need, and does not compute the others.
    Color,
    /// All of them.
    All,
}

impl Wanted {
    /// The layers that files of these names need, written in this encoding.
    pub fn by(paths: &[PathBuf], encoding: &Encoding) -> Wanted {
        let layers = |path: &PathBuf| !encoding.color_only && Format::of(path).is_ok_and(|f| f == Format::Exr);
        if paths.iter().any(layers) { Wanted::All } else { Wanted::Color }
    }
}

/// File formats of images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// OpenEXR: linear, with layers.
    Exr,
    /// PNG: 8 bits for each channel, for display.
    Png,
}

impl Format {
    /// The format for the path's extension, or for that of the file to which the path leads, as `/dev/stdout` may. Devices and pipes without
    /// one take PNG. Errors: [`Error::Setting`] for any other name.
    pub fn of(path: &Path) -> Result<Format> {
        let named = |path: &Path| match path.extension()?.to_string_lossy().to_ascii_lowercase().as_str() {
            "exr" => Some(Format::Exr),
            "png" => Some(Format::Png),
            _ => None,
        };
        let is_stream = || matches!(Target::of(path), Ok(Target::Stream));
        let format =
            named(path).or_else(|| named(&path.canonicalize().ok()?)).or_else(|| is_stream().then_some(Format::Png));
        format.ok_or_else(|| {
            let message = format!("{}: the name must end in .exr or .png", path.display());
            Error::Setting { name: "--output", message }
        })
    }
}

/// Writes an image in the format of the path's extension.
///
/// Errors: [`Error::Setting`] for an unknown extension, [`Error::File`] for layers of the wrong size, [`Error::Io`] if the file
/// cannot be written.
#[cfg(feature = "images")]
pub fn write(path: &Path, layers: &Layers, metadata: &Metadata, encoding: &Encoding) -> Result<()> {
    write_file(path, &[&encode(path, layers, metadata, encoding)?])
}

/// The bytes of [`write()`]. Errors: as that, but for those of the system.
#[cfg(feature = "images")]
pub fn encode(path: &Path, layers: &Layers, metadata: &Metadata, encoding: &Encoding) -> Result<Vec<u8>> {
    let format = Format::of(path)?;
    layers.validate(path)?;
    match format {
        Format::Exr => exr::encode(path, layers, metadata, encoding),
        Format::Png => png::encode(path, layers, encoding.exposure, encoding.tonemap),
    }
}

/// Writes the concatenation of `parts` to a file, through a temporary file that is then renamed.
///
/// Devices and pipes are written directly.
pub fn write_file(path: &Path, parts: &[&[u8]]) -> Result<()> {
    let mut files = FileSet::default();
    files.add(path, parts)?;
    files.commit()
}

/// Files that belong together: all are written under temporary names before the first gets its own. If one of them cannot be written all
/// stay as they were.
#[derive(Default)]
pub struct FileSet(Vec<Member>);

/// A file of a set.
struct Member {
    /// Open for its lock, unless it is one of too many.
    lock: Option<File>,
    temporary: Temporary,
    place: PathBuf,
    /// As given by the user.
    path: PathBuf,
}

/// Files of a set that stay open; processes may have 1,024 in all. Later ones have no lock, and only the claim on the output keeps
/// another run from taking them for leftovers.
const MOST_OPEN: usize = 256;

impl FileSet {
    /// Writes the concatenation of `parts` under a temporary name beside `path`; devices and pipes are written directly.
    pub fn add(&mut self, path: &Path, parts: &[&[u8]]) -> Result<()> {
        let write_all = |file: &mut File| parts.iter().try_for_each(|part| file.write_all(part));
        match Target::of(path)? {
            Target::Stream => {
                let mut file = OpenOptions::new().write(true).open(path).map_err(Error::io("opening", path))?;
                write_all(&mut file).map_err(Error::io("writing", path))
            }
            Target::File(place) => {
                let (mut file, temporary) = Temporary::create(path, &place)?;
                write_all(&mut file).and_then(|()| file.sync_all()).map_err(Error::io("writing", path))?;
                let lock = (self.0.len() < MOST_OPEN).then_some(file);
                self.0.push(Member { lock, temporary, place, path: path.to_path_buf() });
                Ok(())
            }
        }
    }

    /// Gives all files their names, in the order in which they were added. Files of several also lose what killed runs left of them;
    /// those of one belong to a [`claim`], which sees to it.
    pub fn commit(self) -> Result<()> {
        let places: Vec<PathBuf> = self.0.iter().map(|member| member.place.clone()).collect();
        self.0.into_iter().try_for_each(|Member { lock, temporary, place, path }| {
            let renamed = temporary.rename_to(&place).map_err(Error::io("renaming the finished file to", &path));
            drop(lock);
            renamed
        })?;
        if places.len() > 1 {
            remove_leftovers(places.iter().map(PathBuf::as_path));
        }
        Ok(())
    }
}

/// Writes a file of a cache, whose folder may not exist yet; what killed runs left of it is removed.
pub(crate) fn write_cache(path: &Path, bytes: &[u8]) -> Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(Error::io("creating", folder))?;
    }
    remove_leftovers([path].into_iter());
    write_file(path, &[bytes])
}

/// Checks before a long rendering whether [`write_file`] can write to a path.
pub fn check_writable(path: &Path) -> Result<()> {
    match Target::of(path)? {
        Target::Stream => Ok(()),
        Target::File(place) => Temporary::create(path, &place).map(drop),
    }
}

/// Whether a path leads where standard output goes.
pub fn is_standard_output(path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let file = |path: &Path| fs::metadata(path).ok().map(|data| (data.dev(), data.ino()));
        file(path).is_some_and(|here| file(Path::new("/dev/stdout")) == Some(here))
    }
    #[cfg(not(unix))]
    {
        let _ = path;
        false
    }
}

/// Kind of a path's target.
enum Target {
    /// A device or pipe, which must not be replaced.
    Stream,
    /// A file, which may not exist yet, with links resolved so that a link is kept and its target replaced.
    File(PathBuf),
}

impl Target {
    fn of(path: &Path) -> Result<Target> {
        match fs::metadata(path) {
            Ok(data) if data.is_dir() => Err(Error::file(path, "is a directory; give the name of a file")),
            Ok(data) if data.is_file() => Ok(Target::File(fs::canonicalize(path).map_err(Error::io("finding", path))?)),
            Ok(_) => Ok(Target::Stream),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(Target::File(path.to_path_buf())),
            Err(e) => Err(Error::io("writing", path)(e)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(directory: &Path) -> Vec<String> {
        let entries = fs::read_dir(directory).unwrap();
        entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn a_file_is_replaced_and_nothing_else_is_left() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.bin");
        write_file(&path, &[b"one", b"two"]).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"onetwo");
        write_file(&path, &[b"three"]).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"three");
        check_writable(&path).unwrap();
        check_writable(&directory.path().join("b.bin")).unwrap();
        assert_eq!(names(directory.path()), ["a.bin"]);
    }

    #[test]
    fn files_that_belong_together_are_replaced_together() {
        let directory = tempfile::tempdir().unwrap();
        let path = |name: &str| directory.path().join(name);
        fs::write(path("a.bin"), "old").unwrap();
        let mut files = FileSet::default();
        files.add(&path("a.bin"), &[b"new"]).unwrap();
        assert!(files.add(&path("absent/b.bin"), &[b"new"]).is_err());
        drop(files);
        assert_eq!(
            (names(directory.path()), fs::read(path("a.bin")).unwrap()),
            (vec!["a.bin".into()], b"old".to_vec())
        );
        let mut files = FileSet::default();
        files.add(&path("a.bin"), &[b"new"]).unwrap();
        files.add(&path("b.bin"), &[b"new"]).unwrap();
        assert_eq!(fs::read(path("a.bin")).unwrap(), b"old");
        files.commit().unwrap();
        assert_eq!(names(directory.path()).len(), 2);
        assert!(["a.bin", "b.bin"].map(|name| fs::read(path(name)).unwrap() == b"new") == [true; 2]);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_is_kept_and_its_target_replaced() {
        let directory = tempfile::tempdir().unwrap();
        let (target, link) = (directory.path().join("target"), directory.path().join("link"));
        fs::write(&target, "old").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        write_file(&link, &[b"new"]).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&target).unwrap(), b"new");
    }

    #[test]
    fn errors_name_the_file_and_leave_nothing() {
        let directory = tempfile::tempdir().unwrap();
        let absent = directory.path().join("absent").join("a.exr");
        for error in [write_file(&absent, &[b"x"]), check_writable(&absent)] {
            let message = error.unwrap_err().to_string();
            assert!(message.contains("absent") && message.contains("a.exr"), "{message}");
        }
        let file = directory.path().join("file");
        fs::write(&file, "").unwrap();
        assert!(check_writable(&file.join("a.exr")).is_err());
        let message = write_file(directory.path(), &[b"x"]).unwrap_err().to_string();
        assert!(message.contains("is a directory"), "{message}");
        assert_eq!(names(directory.path()), ["file"]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_device_is_an_error_that_names_it() {
        let message = write_file(Path::new("/dev/full"), &[b"x"]).unwrap_err().to_string();
        assert!(message.contains("/dev/full") && message.contains("writing"), "{message}");
    }

    #[test]
    fn a_failed_write_leaves_no_file() {
        let directory = tempfile::tempdir().unwrap();
        let (_, temporary) = Temporary::create(Path::new("a"), &directory.path().join("a")).unwrap();
        assert_eq!(names(directory.path()).len(), 1);
        drop(temporary);
        assert!(names(directory.path()).is_empty());
    }

    #[test]
    fn the_extension_names_the_format() {
        assert_eq!(Format::of(Path::new("x/a.EXR")).unwrap(), Format::Exr);
        assert_eq!(Format::of(Path::new("a.b.png")).unwrap(), Format::Png);
        for name in ["a.jpg", "exr", "a"] {
            let message = Format::of(Path::new(name)).unwrap_err().to_string();
            assert!(message.contains("--output") && message.contains(name), "{message}");
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn streams_without_an_extension_take_png() {
        assert_eq!(Format::of(Path::new("/dev/null")).unwrap(), Format::Png);
        let directory = tempfile::tempdir().unwrap();
        let (target, link) = (directory.path().join("a.exr"), directory.path().join("link"));
        fs::write(&target, "").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        assert_eq!(Format::of(&link).unwrap(), Format::Exr);
        assert!(is_standard_output(Path::new("/dev/stdout")) && !is_standard_output(&link));
    }

    #[test]
    fn only_an_exr_file_with_layers_wants_them() {
        let paths = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        let (with, without) = (Encoding::default(), Encoding { color_only: true, ..Encoding::default() });
        assert_eq!(Wanted::by(&paths(&["a.png", "b.exr"]), &with), Wanted::All);
        assert_eq!(Wanted::by(&paths(&["a.png", "b.exr"]), &without), Wanted::Color);
        assert_eq!(Wanted::by(&paths(&["a.png"]), &with), Wanted::Color);
        assert_eq!(Wanted::by(&[], &with), Wanted::Color);
    }

    #[test]
    fn a_layer_of_another_length_is_refused() {
        let mut layers = Layers { width: 2, height: 1, color: vec![Vec3::ONE; 2], ..Layers::default() };
        layers.depth = vec![1.0];
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        let message = write(&path, &layers, &Metadata::default(), &Encoding::default()).unwrap_err().to_string();
        assert!(message.contains("layer depth has 1 values"), "{message}");
        layers.depth.clear();
        write(&path, &layers, &Metadata::default(), &Encoding::default()).unwrap();
    }
}
