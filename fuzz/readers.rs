//! The readers of files as functions of bytes, for the fuzzer and for the test that reads the kept corpus.
//!
//! Each takes the bytes of one file; the files beside it are fixed. A reader may return an error; it may not panic, hang, or take more
//! than 2 GiB.

use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use lightsum::accel::Bvh;
use lightsum::estimate::History;
use lightsum::film::HostFilm;
use lightsum::output::{FilmFile, Merger, State};
use lightsum::scene::path::Motion;
use lightsum::scene::{ReadOptions, Scene};
use lightsum::settings::RenderDefaults;
use lightsum::summary::Summary;
use lightsum::superposition::lobe::Table;
use lightsum::{Settings, bake, scene};

/// Reads bytes; true if they are valid.
type Read = fn(&Path, &[u8]) -> bool;

/// The readers by the names of their folders in the corpus.
pub const READERS: [(&str, Read); 20] = [
    ("obj", |place, bytes| model(place, "a.obj", bytes)),
    ("mtl", |place, bytes| beside(place, "room.mtl", bytes, "room.obj")),
    ("gltf", |place, bytes| model(place, "a.gltf", bytes)),
    ("glb", glb),
    ("draco", |place, bytes| compressed(place, DRACO, bytes)),
    ("meshopt", |place, bytes| compressed(place, MESHOPT, bytes)),
    ("ktx2", |place, bytes| beside(place, "a.ktx2", bytes, "ktx2.gltf")),
    ("texture", |place, bytes| beside(place, "color.png", bytes, "room.obj")),
    ("emission", |place, bytes| beside(place, "emission.exr", bytes, "room.obj")),
    ("environment", |place, bytes| beside(place, "sky.exr", bytes, "sky.toml")),
    ("ply", |place, bytes| model(place, "a.ply", bytes)),
    ("mitsuba", |place, bytes| model(place, "a.xml", bytes)),
    ("description", |place, bytes| model(place, "a.toml", bytes)),
    ("path", path),
    ("lobe", lobe),
    ("state", state),
    ("film", film),
    ("film_file", film_file),
    ("settings", settings),
    ("kept_light", kept_light),
];

/// Reads bytes by the reader of a name; true if they are valid.
pub fn read(name: &str, bytes: &[u8]) -> bool {
    let (_, read) = READERS.iter().find(|(reader, _)| *reader == name).expect("a reader of this name");
    PLACE.with(|place| read(&place.0, bytes))
}

const ROOM_OBJ: &str = "mtllib room.mtl\nv -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv -1 2 -1\nv 1 2 -1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
                        o floor\nusemtl floor\nf 4/1 3/2 2/3 1/4\no wall\nusemtl wall\nf 1/1 2/2 6/3 5/4\n\
                        o lamp\nusemtl lamp\nf 5/1 6/2 3/3\n";
const ROOM_MTL: &str = "newmtl floor\nKd 0.5 0.5 0.5\nmap_Kd color.png\nmap_d color.png\nnewmtl wall\nKd 0.7 0.6 0.5\nPr 0.2\n\
                        norm color.png\nnewmtl lamp\nKe 5 5 5\nmap_Ke emission.exr\n";
const KTX2_GLTF: &str = include_str!("fixed/ktx2.gltf");
const DRACO: &str = include_str!("fixed/draco.gltf");
const MESHOPT: &str = include_str!("fixed/meshopt.gltf");

/// A folder with the fixed files, gone with its thread.
struct Place(PathBuf);

impl Place {
    fn new() -> Place {
        // Files in memory are read many times faster.
        let memory = Path::new("/dev/shm");
        let parent = if memory.is_dir() { memory.to_path_buf() } else { std::env::temp_dir() };
        let thread = format!("{:?}", std::thread::current().id());
        let digits: String = thread.chars().filter(char::is_ascii_digit).collect();
        let place = parent.join(format!("lightsum-readers-{}-{digits}", std::process::id()));
        fs::create_dir_all(&place).expect("a folder for the files");
        let files: [(&str, &[u8]); 11] = [
            ("room.obj", ROOM_OBJ.as_bytes()),
            ("room.mtl", ROOM_MTL.as_bytes()),
            ("color.png", include_bytes!("../tests/cpu/data/four texels.png")),
            ("emission.exr", include_bytes!("fixed/emission.exr")),
            ("a.bin", include_bytes!("fixed/a.bin")),
            ("ktx2.gltf", KTX2_GLTF.as_bytes()),
            ("kept.obj", include_bytes!("fixed/kept.obj")),
            ("kept-irradiance-0.exr", include_bytes!("fixed/kept-irradiance-0.exr")),
            ("tiles.png", include_bytes!("../tests/cpu/data/four texels.png")),
            ("sky.toml", b"model = \"room.obj\"\n[environment]\nimage = \"sky.exr\"\n"),
            ("a.mtl", b"newmtl m\nKd 0.1 0.2 0.3\n"),
        ];
        for (name, bytes) in files {
            fs::write(place.join(name), bytes).expect("room for the files");
        }
        Place(place)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        // What is left is small, and the system removes it.
        let _ = fs::remove_dir_all(&self.0);
    }
}

thread_local!(static PLACE: Place = Place::new());

/// Places of panics in the library, caught or not, if they are watched.
static PANICS: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Places of the panics in the library since the last call.
#[allow(dead_code, reason = "the test of the kept corpus asks, fuzzers do not")]
pub fn panics() -> Vec<String> {
    std::mem::take(&mut PANICS.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Writes down where the library panics: the loader of glTF makes an error of panics, which only other crates may cause. `then` is
/// told of each.
pub fn watch_panics(then: fn(&str)) {
    scene::silence_caught_panics();
    let previous = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        previous(info);
        let at = info.location().map(ToString::to_string).unwrap_or_default();
        let foreign = ["/registry/", "/rustc/", "/library/", "tests/"].iter().any(|part| at.contains(part));
        if !foreign {
            PANICS.lock().unwrap_or_else(PoisonError::into_inner).push(at);
            then(&info.to_string());
        }
    }));
}

fn put(place: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = place.join(name);
    fs::write(&path, bytes).expect("room for a file");
    path
}

fn options() -> ReadOptions {
    ReadOptions { max_memory: Some(256 << 20), ..ReadOptions::default() }
}

/// A scene, and what is made of each before it is rendered, unless that takes long.
fn model(place: &Path, name: &str, bytes: &[u8]) -> bool {
    load(&put(place, name, bytes))
}

fn load(path: &Path) -> bool {
    let Ok(mut scene) = scene::load_with(path, &options()) else { return false };
    if scene.triangles.len() <= 64 {
        // Errors are allowed.
        let _ = (Summary::of(&scene), Bvh::build(&scene).and_then(|bvh| bvh.validate(&scene)));
        let _ = scene.framed([16, 16], None).check();
        if scene.animations.as_ref().is_some_and(|animations| !animations.list.is_empty()) {
            scene.set_pose(&[0], 0.5);
        }
    }
    true
}

/// A file that a fixed model names.
fn beside(place: &Path, name: &str, bytes: &[u8], main: &str) -> bool {
    let path = place.join(name);
    // Readers of one thread share the folder: the file is put back.
    let kept = fs::read(&path).ok();
    put(place, name, bytes);
    let valid = load(&place.join(main));
    match kept {
        Some(kept) => drop(put(place, name, &kept)),
        None => drop(fs::remove_file(&path)),
    }
    valid
}

/// A file as it is, or the document up to a zero byte and the binary chunk behind it: lengths are seldom right by chance.
fn glb(place: &Path, bytes: &[u8]) -> bool {
    if bytes.starts_with(b"glTF") {
        return model(place, "a.glb", bytes);
    }
    let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    let (document, binary) = (&bytes[..end], &bytes[(end + 1).min(bytes.len())..]);
    model(place, "a.glb", &as_glb(document, binary))
}

fn as_glb(document: &[u8], binary: &[u8]) -> Vec<u8> {
    let chunk = |kind: &[u8; 4], bytes: &[u8], pad: u8| {
        let mut padded = bytes.to_vec();
        padded.resize(bytes.len().next_multiple_of(4), pad);
        [&(padded.len() as u32).to_le_bytes()[..], kind, &padded].concat()
    };
    let chunks = [chunk(b"JSON", document, b' '), chunk(b"BIN\0", binary, 0)].concat();
    [b"glTF\x02\0\0\0", &(chunks.len() as u32 + 12).to_le_bytes()[..], &chunks].concat()
}

/// The compressed buffer of a fixed document.
fn compressed(place: &Path, document: &str, bytes: &[u8]) -> bool {
    model(place, "a.glb", &as_glb(document.as_bytes(), bytes))
}

fn room(place: &Path) -> Scene {
    scene::load(&place.join("room.obj")).expect("a fixed scene")
}

fn path(place: &Path, bytes: &[u8]) -> bool {
    thread_local!(static ROOM: RefCell<Option<Scene>> = const { RefCell::new(None) });
    ROOM.with_borrow_mut(|kept| {
        let scene = kept.get_or_insert_with(|| room(place));
        let camera = scene.framed([16, 16], None);
        let Ok(motion) = Motion::load(&put(place, "path.toml", bytes), scene, camera) else { return false };
        for &time in motion.times.iter().take(8) {
            let _ = (motion.camera(time).map(|camera| camera.check()), motion.pose(&mut scene.clone(), time));
        }
        true
    })
}

fn lobe(place: &Path, bytes: &[u8]) -> bool {
    Table::load(&put(place, "lobe.toml", bytes)).is_ok()
}

/// A file with the header of a state or film, with its checksum put right.
fn checked(bytes: &[u8]) -> Vec<u8> {
    const CHECKSUM: usize = 48;
    let mut bytes = bytes.to_vec();
    if bytes.len() >= CHECKSUM + 8 {
        let mut sum = lightsum::fingerprint::Fnv::default();
        sum.add(&bytes[..CHECKSUM]);
        sum.add(&bytes[CHECKSUM + 8..]);
        bytes[CHECKSUM..CHECKSUM + 8].copy_from_slice(&sum.0.to_le_bytes());
    }
    bytes
}

/// A state whose sums are those of an image of its size.
fn state(place: &Path, bytes: &[u8]) -> bool {
    let Ok(state) = State::read(&put(place, "a.state", &checked(bytes))) else { return false };
    let size = [state.width, state.height];
    // Another size is refused before its sums are read.
    let all = state.accumulators.get(4..).unwrap_or_default();
    size == [1, 1] && [false, true].into_iter().any(|summands| sums(all, size, summands))
}

fn sums(bytes: &[u8], size: [u32; 2], summands: bool) -> bool {
    let (film, history) = bytes.split_at(HostFilm::byte_count(size, summands).min(bytes.len()));
    let Ok(film) = HostFilm::from_bytes(film, size, summands) else { return false };
    let mut twice = film.clone().canonical();
    let _ = (twice.merge(&film), twice.passes(), twice.mean());
    let history = History::from_bytes(history, 1);
    if let Some(history) = &history {
        let _ = (history.passes(), history.estimate());
    }
    history.is_some()
}

/// The sums of an image of one pixel; with summands if the first byte is odd.
fn film(_: &Path, bytes: &[u8]) -> bool {
    bytes.split_first().is_some_and(|(first, bytes)| sums(bytes, [1, 1], first & 1 == 1))
}

/// A film as it is, or width, height, the text up to a zero byte, and the sums: lengths are seldom right by chance.
fn film_file(place: &Path, bytes: &[u8]) -> bool {
    let path = match bytes {
        [b'L', b'S', b'U', b'M', ..] => put(place, "a.film", &checked(bytes)),
        [width, height, rest @ ..] => {
            let end = rest.iter().position(|&b| b == 0).unwrap_or(rest.len());
            let (text, sums) = (&rest[..end], &rest[(end + 1).min(rest.len())..]);
            let numbers = [3, u32::from(*width), u32::from(*height), 0, 0, 0].map(u32::to_le_bytes).concat();
            let length = (4 + text.len() + sums.len()) as u64;
            let text_length = (text.len() as u32).to_le_bytes();
            let parts = [b"LSUMFILM", &numbers[..], &[0; 8], &length.to_le_bytes(), &[0; 8], &text_length, text, sums];
            put(place, "a.film", &checked(&parts.concat()))
        }
        _ => put(place, "a.film", bytes),
    };
    let Ok(film) = FilmFile::read(&path) else { return false };
    let _ = (film.layers(), film.about.metadata(), film.about.missing().to_string(), film.about.exposure());
    let mut merger = Merger::default();
    // Its passes would count twice, unless there are none.
    let _ = (merger.add(Path::new("first.film"), film.clone()), merger.add(&path, film));
    merger.finish().is_some_and(|sum| sum.write(&place.join("b.film")).is_ok())
}

/// A file of settings: TOML, JSON or OpenEXR.
fn settings(place: &Path, bytes: &[u8]) -> bool {
    let Ok(keys) = RenderDefaults::load(&put(place, "settings", bytes)) else { return false };
    // They may be at odds with each other.
    let _ = Settings::default().with_scene_defaults(&keys).validate();
    true
}

fn kept_light(place: &Path, bytes: &[u8]) -> bool {
    thread_local!(static ROOM: RefCell<Option<Scene>> = const { RefCell::new(None) });
    ROOM.with_borrow_mut(|kept| {
        let scene = kept.get_or_insert_with(|| scene::load(&place.join("kept.obj")).expect("a fixed scene"));
        bake::files::read(&put(place, "kept.glb", bytes), scene).is_ok()
    })
}
