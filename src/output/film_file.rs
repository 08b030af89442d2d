//! Films in files: parts of a rendering, made on any machines, that are added up ([`Merger`]).
//!
//! The format is that of a [`State`] with the magic "LSUMFILM". Its accumulators are the length of a text u32, the text, which says what
//! was rendered ([`About`], JSON), and the sums ([`HostFilm::to_bytes`]).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::state::FILM;
use super::{Layers, Metadata, Provenance, State};
use crate::cluster::Passes;
use crate::error::{Error, Result};
use crate::film::HostFilm;
use crate::settings::{Exposure, Traversal};
use crate::view::Region;

/// Greatest exposure up or down, stops.
const MAX_STOPS: f32 = 100.0;

/// What was rendered.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// Program and version.
    pub software: String,
    /// Name of the scene.
    pub scene: String,
    /// Settings, as JSON.
    pub settings: String,
    /// Seed.
    pub seed: u64,
    /// Camera, as JSON.
    pub camera: String,
    /// Devices of the passes with their drivers: [`DeviceInfo::identity`](crate::gpu::DeviceInfo::identity), then what an image tells.
    pub devices: BTreeMap<String, [String; 2]>,
    /// Exposure of the scene in stops; `None`: by the image.
    pub exposure: Option<f32>,
    /// The part of the film that is the image, column, row, width and height; `None`: all of it.
    pub part: Option<[u32; 4]>,
    /// Passes that the whole rendering shall have; `None`: as many as there are.
    pub asked: Option<u32>,
    /// Whether emission, diffuse and specular light are summed apart.
    pub summands: bool,
    /// The passes in the sums.
    pub passes: Passes,
    /// Passes that were rendered and left out, because some pixel was no number.
    pub left_out: Passes,
}

impl About {
    /// The exposure of the scene.
    pub fn exposure(&self) -> Exposure {
        self.exposure.map_or(Exposure::Auto, Exposure::Stops)
    }

    /// The passes that are done: those in the sums and those that were left out.
    pub fn done(&self) -> Passes {
        self.passes.with(&self.left_out)
    }

    /// The passes of the whole rendering that are neither in the sums nor left out.
    pub fn missing(&self) -> Passes {
        let done = self.done();
        done.missing_below(self.asked.unwrap_or(0).max(done.end()))
    }

    /// Provenance of an image of the film.
    pub fn metadata(&self) -> Metadata {
        let joined = |i: usize| {
            let mut words: Vec<&str> = self.devices.values().map(|device| device[i].as_str()).collect();
            words.dedup();
            words.join("; ")
        };
        Metadata {
            software: self.software.clone(),
            scene: self.scene.clone(),
            settings: self.settings.clone(),
            seed: self.seed,
            passes: self.passes.count() as u32,
            camera: self.camera.clone(),
            device: joined(0),
            driver: joined(1),
        }
    }
}

/// A film with what it is of.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmFile {
    /// What was rendered.
    pub about: About,
    /// Of scene, camera and settings.
    pub fingerprint: u64,
    /// The traversal kernel of the passes.
    pub traversal: Traversal,
    /// The sums.
    pub film: HostFilm,
}

impl FilmFile {
    /// Writes the film.
    pub fn write(&self, path: &Path) -> Result<()> {
        let about = serde_json::to_string(&self.about).map_err(|e| Error::file(path, e.to_string()))?;
        let mut accumulators = (about.len() as u32).to_le_bytes().to_vec();
        accumulators.extend(about.as_bytes());
        accumulators.extend(self.film.to_bytes());
        let [width, height] = self.film.size();
        let provenance = Provenance { device: self.devices(), traversal: self.traversal };
        let (fingerprint, passes) = (self.fingerprint, self.film.passes());
        State { fingerprint, provenance, width, height, passes, accumulators }.write_as(&FILM, path)
    }

    /// Reads a film. Errors: [`Error::Io`]; [`Error::File`] if it is incomplete, damaged or of another version.
    pub fn read(path: &Path) -> Result<FilmFile> {
        let state = State::read_as(&FILM, path)?;
        // The checksum is right, so another program or version wrote it.
        let strange =
            |what: String| Error::file(path, format!("the film is not one of this version ({what}); render it again"));
        let (length, rest) =
            state.accumulators.split_first_chunk::<4>().ok_or_else(|| strange(String::from("it is empty")))?;
        let (text, film) = rest
            .split_at_checked(u32::from_le_bytes(*length) as usize)
            .ok_or_else(|| strange(String::from("its text is cut off")))?;
        let about: About = serde_json::from_slice(text).map_err(|e| strange(e.to_string()))?;
        if state.width == 0 || state.height == 0 {
            return Err(strange(String::from("it has no pixels")));
        }
        if let Some(stops) = about.exposure.filter(|stops| !(-MAX_STOPS..=MAX_STOPS).contains(stops)) {
            return Err(strange(format!("its exposure of {stops} stops is not in [-{MAX_STOPS}, {MAX_STOPS}]")));
        }
        let film = HostFilm::from_bytes(film, [state.width, state.height], about.summands)
            .map_err(|e| strange(e.to_string()))?;
        if about.passes.count() != u64::from(film.passes()) || !about.passes.shared_with(&about.left_out).is_empty() {
            return Err(strange(format!("it names {} passes and has {}", about.passes.count(), film.passes())));
        }
        if let Some([x, y, width, height]) = about.part {
            Region { origin: [x, y], size: [width, height] }.check(film.size()).map_err(|e| strange(e.to_string()))?;
        }
        Ok(FilmFile { about, fingerprint: state.fingerprint, traversal: state.provenance.traversal, film })
    }

    /// The image of the passes in it.
    pub fn layers(&self) -> Layers {
        let layers = self.film.mean();
        match self.about.part {
            Some([x, y, width, height]) => layers.cut(Region { origin: [x, y], size: [width, height] }),
            None => layers,
        }
    }

    /// Checks that it is of a rendering, as [`State::check`] does.
    pub fn check(&self, path: &Path, fingerprint: u64, size: [u32; 2], provenance: &Provenance) -> Result<()> {
        let [width, height] = self.film.size();
        let own = Provenance { device: self.devices(), traversal: self.traversal };
        let (passes, accumulators) = (self.film.passes(), Vec::new());
        let state = State { fingerprint: self.fingerprint, provenance: own, width, height, passes, accumulators };
        state.check_as(&FILM, path, (fingerprint, size, provenance))
    }

    fn devices(&self) -> String {
        self.about.devices.keys().map(String::as_str).collect::<Vec<_>>().join(" and ")
    }

    /// Adds the passes of another film of the same rendering, which must be others.
    pub fn add(&mut self, other: &FilmFile) -> Result<()> {
        self.film.merge(&other.film)?;
        let (own, other) = (&mut self.about, &other.about);
        own.passes = own.passes.with(&other.passes);
        own.left_out = own.left_out.with(&other.left_out);
        own.devices.extend(other.devices.clone());
        own.asked = own.asked.max(other.asked);
        Ok(())
    }

    /// Why another film is of another rendering than this one; `None`: it is of the same.
    fn differs(&self, other: &FilmFile) -> Option<String> {
        let (a, b) = (&self.about, &other.about);
        if a.software != b.software {
            return Some(format!("it is by {}, this one by {}", b.software, a.software));
        }
        if a.scene != b.scene {
            return Some(format!("its scene is {:?}, that of this one is {:?}", b.scene, a.scene));
        }
        if self.film.size() != other.film.size() {
            let [[w, h], [x, y]] = [other.film.size(), self.film.size()];
            return Some(format!("it has {w}x{h} pixels, this one {x}x{y}"));
        }
        if self.traversal != other.traversal {
            let [a, b] = [self.traversal, other.traversal].map(|t| format!("{t:?}").to_lowercase());
            return Some(format!("it is of --traversal {b}, this one of {a}"));
        }
        let keys = differing_keys(&a.settings, &b.settings);
        if !keys.is_empty() {
            return Some(format!("other settings: {}", keys.join(", ")));
        }
        if a.camera != b.camera {
            return Some(String::from("another camera"));
        }
        let differ = self.fingerprint != other.fingerprint || a.part != b.part;
        differ.then(|| String::from("the same names, but another content of scene, camera or settings"))
    }
}

/// The keys at the top of two JSON objects whose values differ.
fn differing_keys(a: &str, b: &str) -> Vec<String> {
    let object = |text: &str| match serde_json::from_str(text) {
        Ok(serde_json::Value::Object(object)) => object,
        _ => serde_json::Map::new(),
    };
    let (a, b) = (object(a), object(b));
    let mut keys: Vec<String> = a.keys().chain(b.keys()).filter(|key| a.get(*key) != b.get(*key)).cloned().collect();
    keys.sort();
    keys.dedup();
    keys
}

/// Adds films up, in any order to the same bits.
#[derive(Debug, Default)]
pub struct Merger {
    sum: Option<FilmFile>,
    /// The files with their devices and passes.
    files: Vec<(PathBuf, String, Passes)>,
}

impl Merger {
    /// Adds a film that was read from a file. Errors, which leave the sum as it was: it is of another rendering, or has passes that are
    /// in another file too; they name both files.
    pub fn add(&mut self, path: &Path, film: FilmFile) -> Result<()> {
        let refuse = |other: &Path, why: String| {
            Err(Error::file(
                path,
                format!("does not add up with {}: {why}; merge films of one rendering", other.display()),
            ))
        };
        let (devices, done) = (film.devices(), film.about.done());
        match (&mut self.sum, self.files.first()) {
            (Some(sum), Some((first, of_first, _))) => {
                if let Some(why) = sum.differs(&film) {
                    return refuse(first, why);
                }
                for (other, _, passes) in &self.files {
                    let shared = passes.shared_with(&done);
                    if !shared.is_empty() {
                        let noun = if shared.count() == 1 { "pass" } else { "passes" };
                        return refuse(other, format!("{noun} {shared} would count twice"));
                    }
                }
                if devices != *of_first {
                    log::warn!(
                        "{} is of {devices}, {} of {of_first}: the image is as good, but its last bits are those of neither",
                        path.display(),
                        first.display()
                    );
                }
                sum.add(&film)?;
            }
            _ => self.sum = Some(FilmFile { film: film.film.canonical(), ..film }),
        }
        self.files.push((path.to_path_buf(), devices, done));
        Ok(())
    }

    /// The sum; `None`: no film was added.
    pub fn finish(self) -> Option<FilmFile> {
        self.sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::INSTANCES;
    use crate::sampling::random::{key, random_f32};

    const SIZE: [u32; 2] = [3, 2];

    /// A film of some passes, whose sums are of numbers that differ in magnitude.
    fn film(passes: &[u32]) -> FilmFile {
        let mut sum: Option<HostFilm> = None;
        for &pass in passes {
            let words = HostFilm::byte_count(SIZE, false) / 4 - 2;
            let value =
                |i: usize| (random_f32(key(pass, i as u32, 7, 0)) - 0.3) * 10f32.powi((i as i32 + pass as i32) % 7 - 3);
            // Each sum has its value in its first level alone.
            let levels = [3, 3, 3, 3, 2, 2, 3].iter().flat_map(|&n| (0..n).map(|level| level == 0));
            let first: Vec<bool> = levels.flat_map(|first| [first; 4 * 6]).collect();
            let mut bytes: Vec<u8> =
                (0..words).flat_map(|i| if first[i] { value(i) } else { 0.0 }.to_le_bytes()).collect();
            bytes.extend([1 - pass % 2, pass % 2].iter().flat_map(|count| count.to_le_bytes()));
            let one = HostFilm::from_bytes(&bytes, SIZE, false).unwrap();
            match &mut sum {
                Some(sum) => sum.merge(&one).unwrap(),
                None => sum = Some(one),
            }
        }
        let about = About {
            scene: String::from("room"),
            settings: String::from("{\"seed\":1,\"clip\":2}"),
            camera: String::from("front"),
            devices: [(String::from("a device"), [String::from("device"), String::from("driver 1")])].into(),
            asked: Some(12),
            passes: passes.iter().copied().collect(),
            ..About::default()
        };
        FilmFile { about, fingerprint: 5, traversal: Traversal::Auto, film: sum.unwrap() }
    }

    fn merged(parts: &[Vec<u32>]) -> FilmFile {
        let mut merger = Merger::default();
        for (i, part) in parts.iter().enumerate() {
            merger.add(Path::new(&format!("{i}.film")), film(part)).unwrap();
        }
        merger.finish().unwrap()
    }

    #[test]
    fn every_partition_in_every_order_gives_the_same_bits() {
        let all: Vec<u32> = (0..12).collect();
        let whole = merged(std::slice::from_ref(&all));
        // Miri takes minutes for each.
        for seed in 0..if cfg!(miri) { 3 } else { 60 } {
            let random = |i: u32, n: u32| (random_f32(key(seed, i, 3, 1)) * n as f32) as u32;
            let mut parts = vec![Vec::new(); 1 + seed as usize % 7];
            all.iter().for_each(|&pass| parts[random(pass, 1 + seed % 7) as usize].push(pass));
            parts.retain(|part| !part.is_empty());
            // In a random order, and the last two merged before the others.
            parts.sort_by_key(|part| random(100 + part[0], 1000));
            assert_eq!(merged(&parts), whole, "{parts:?}");
            if parts.len() > 2 {
                let (first, last) = parts.split_at(parts.len() - 2);
                let mut merger = Merger::default();
                merger.add(Path::new("last"), merged(last)).unwrap();
                merger.add(Path::new("first"), merged(first)).unwrap();
                assert_eq!(merger.finish().unwrap(), whole, "{parts:?}");
            }
        }
        assert!(whole.about.missing().is_empty());
        assert_eq!(merged(&[vec![3, 1]]).about.missing().to_string(), "0, 2 and 4 to 11");
    }

    #[test]
    fn a_film_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.film");
        let mut one = film(&[0, 4, 5]);
        one.about.part = Some([1, 0, 2, 2]);
        one.about.left_out.add(7);
        one.about.exposure = Some(-0.1);
        one.write(&path).unwrap();
        assert_eq!(FilmFile::read(&path).unwrap(), one);
        assert_eq!((one.layers().width, one.layers().height), (2, 2));
        let whole = std::fs::read(&path).unwrap();
        let reason = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let message = FilmFile::read(&path).unwrap_err().to_string();
            assert!(message.contains("a.film: "), "{message}");
            message
        };
        assert!(reason(&whole[..whole.len() / 2]).contains("the film is cut off"));
        assert!(reason(b"LSUMSTAT").contains("not a film file"));
        let mut damaged = whole.clone();
        damaged[whole.len() - 30] ^= 4;
        assert!(reason(&damaged).contains("the film is damaged"));
    }

    #[test]
    fn texts_and_sums_that_do_not_belong_together_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.film");
        let mut many = film(&[0, 1]);
        many.about.passes.add(2);
        many.write(&path).unwrap();
        assert!(FilmFile::read(&path).unwrap_err().to_string().contains("names 3 passes and has 2"));
        let mut outside = film(&[0, 1]);
        outside.about.part = Some([2, 0, 2, 2]);
        outside.write(&path).unwrap();
        assert!(FilmFile::read(&path).unwrap_err().to_string().contains("not one of this version"));
        let mut blinding = film(&[0, 1]);
        blinding.about.exposure = Some(101.0);
        blinding.write(&path).unwrap();
        assert!(FilmFile::read(&path).unwrap_err().to_string().contains("101 stops"));
    }

    #[test]
    fn sizes_that_do_not_belong_to_the_sums_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.film");
        let about = serde_json::to_string(&About::default()).unwrap();
        // 2^60 pixels of 19 levels of 16 bytes are 0 bytes of 2^64.
        for (width, height, word) in [(1 << 31, 1 << 29, "bytes"), (u32::MAX, u32::MAX, "bytes"), (0, 7, "no pixels")] {
            let accumulators =
                [&(about.len() as u32).to_le_bytes()[..], about.as_bytes(), &[0; 4 * INSTANCES as usize]].concat();
            let provenance = Provenance { device: String::from("a device"), traversal: Traversal::Auto };
            let state = State { fingerprint: 5, provenance, width, height, passes: 0, accumulators };
            state.write_as(&FILM, &path).unwrap();
            let message = FilmFile::read(&path).unwrap_err().to_string();
            assert!(message.contains(word) && message.contains("a.film"), "{width}x{height}: {message}");
        }
    }

    #[test]
    fn other_renderings_and_passes_are_refused_with_names() {
        let mut merger = Merger::default();
        merger.add(Path::new("a.film"), film(&[0, 2])).unwrap();
        let mut refused = |change: &dyn Fn(&mut FilmFile), names: &[&str]| {
            let mut other = film(&[1, 3]);
            change(&mut other);
            let message = merger.add(Path::new("b.film"), other).unwrap_err().to_string();
            let all = ["a.film", "b.film"].iter().chain(names).all(|name| message.contains(name));
            assert!(all, "{names:?}: {message}");
        };
        refused(&|film| film.about.scene = String::from("hall"), &["hall", "room"]);
        refused(&|film| film.about.settings = String::from("{\"seed\":1,\"clip\":3}"), &["settings: clip"]);
        refused(&|film| film.about.camera = String::from("back"), &["another camera"]);
        refused(&|film| film.traversal = Traversal::Single, &["--traversal single"]);
        refused(&|film| film.fingerprint = 6, &["another content"]);
        refused(&|film| film.about.software = String::from("lightsum 9"), &["lightsum 9"]);
        refused(&|film| film.about.passes = [2, 3].into_iter().collect(), &["pass 2 would count twice"]);
        // What was refused is not in the sum, and another device is.
        let mut other = film(&[1, 3]);
        let devices = [(String::from("b device"), [String::from("other"), String::from("driver 2")])];
        other.about.devices = devices.into();
        merger.add(Path::new("b.film"), other).unwrap();
        let sum = merger.finish().unwrap();
        assert_eq!(sum.film, merged(&[vec![0, 1, 2, 3]]).film);
        assert_eq!(sum.about.metadata().device, "device; other");
        assert_eq!(sum.about.metadata().driver, "driver 1; driver 2");
        assert_eq!(sum.about.metadata().passes, 4);
    }
}
