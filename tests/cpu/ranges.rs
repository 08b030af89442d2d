//! Numbers of files: each is accepted at both ends of its range, and refused beyond them and where it is no number.

mod models;

use std::fs;
use std::path::Path;

use lightsum::scene::path::Motion;
use lightsum::scene::{self, Camera};
use lightsum::superposition::lobe::Table;
use tempfile::TempDir;

const OBJ: &str = "mtllib room.mtl\no floor\nusemtl floor\nv -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nf 4 3 2 1\n\
                   o lamp\nusemtl lamp\nv -1 2 -1\nv 1 2 -1\nv 1 2 1\nf 1 2 3\no pane\nusemtl pane\nf 1 2 7\n";
const MTL: &str = "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKe 5 5 5\nnewmtl pane\nKd 0.5 0.5 0.5\n";

/// Values that every key for a number refuses.
const NO_NUMBERS: [&str; 4] = ["nan", "-nan", "inf", "-inf"];

/// A number of a file: the file with `@` for the number, what is accepted, and what is refused besides [`NO_NUMBERS`].
type Number<'a> = (&'a str, &'a [&'a str], &'a [&'a str]);

fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [("room.obj", OBJ), ("room.mtl", MTL)] {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// Reads the file of each number with each value.
fn check(numbers: &[Number], no_numbers: &[&str], read: impl Fn(&str) -> Result<(), String>) {
    let mut wrong = Vec::new();
    for (text, good, bad) in numbers {
        for value in *good {
            let file = text.replace('@', value);
            wrong.extend(read(&file).err().map(|message| format!("refused: {file}: {message}")));
        }
        for value in bad.iter().chain(no_numbers) {
            let file = text.replace('@', value);
            wrong.extend(read(&file).ok().map(|()| format!("accepted: {file}")));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

fn read_description(folder: &Path, text: &str) -> Result<(), String> {
    let path = folder.join("scene.toml");
    fs::write(&path, format!("model = \"room.obj\"\n{text}\n")).unwrap();
    scene::load(&path).map(drop).map_err(|e| e.to_string())
}

/// Of a coordinate.
const PLACES: (&[&str], &[&str]) =
    (&["0.0", "-0.0", "1e-30", "1e9", "-1e9"], &["1.001e9", "-1.001e9", "1e30", "1e300"]);
/// Of a radiometric quantity beside others above 0.
const POWERS: (&[&str], &[&str]) = (&["0.0", "-0.0", "1e-45", "3.4e38"], &["-1e-45", "-1.0", "1e39"]);
/// Of a fraction.
const FRACTIONS: (&[&str], &[&str]) = (&["0.0", "-0.0", "1e-45", "1.0"], &["-1e-45", "1.0000002", "1e39"]);
/// Of an angle that may be any.
const ANY: (&[&str], &[&str]) = (&["0.0", "-0.0", "1e-45", "-1e30", "3.4e38"], &["1e39"]);
/// Of a length above 0.
const LENGTHS: (&[&str], &[&str]) = (&["1e-30", "1e9"], &["0.0", "-0.0", "-1.0", "1.001e9", "1e39"]);

#[test]
fn numbers_of_a_description() {
    let folder = folder();
    let numbers: &[Number] = &[
        ("[camera]\neye = [@, 1, 3]\ntarget = [0, 1, 0]\nfov_y = 40", PLACES.0, PLACES.1),
        ("[camera]\neye = [0, 1, 3]\ntarget = [0, 1, @]\nfov_y = 40", PLACES.0, PLACES.1),
        (
            "[camera]\neye = [0, 1, 3]\ntarget = [0, 1, 0]\nfov_y = 40\nup = [0, @, 0]",
            &["1e-15", "-1.0", "1e15"],
            &["0.0", "-0.0", "1e39"],
        ),
        (
            "[camera]\neye = [0, 1, 3]\ntarget = [0, 1, 0]\nfov_y = @",
            &["1e-3", "179.99"],
            &["0.0", "-0.0", "-1.0", "180.0", "1e39"],
        ),
        (
            "[camera]\neye = [0, 1, 3]\ntarget = [0, 1, 0]\nprojection = \"orthographic\"\nheight = @",
            &["1.01e-15", "1e9"],
            &["0.0", "-0.0", "-1.0", "1e-16", "1.001e9", "1e39"],
        ),
        (
            "[camera]\neye = [0, 1, 3]\ntarget = [0, 1, 0]\nfov_y = 40\nresolution = [@, 7]",
            &["1", "65536"],
            &["0", "-1", "65537", "1.5"],
        ),
        (
            "[camera]\neye = [0, 1, 3]\ntarget = [0, 1, 0]\nfov_y = 40\naperture = @",
            &["0.0", "-0.0", "1e-30", "1e9"],
            &["-1e-45", "1.001e9", "1e39"],
        ),
        ("[camera]\neye = [0, 1, 3]\ntarget = [0, 1, 0]\nfov_y = 40\nfocus = @", LENGTHS.0, LENGTHS.1),
        (
            "[camera]\neye = [0, 1, 3]\ntarget = [0, 1, 0]\nfov_y = 40\nshutter = @",
            &["0.0", "-0.0", "1e-45", "3.4e38"],
            &["-1e-45", "1e39"],
        ),
        ("[lights.a]\ntype = \"point\"\nposition = [0, @, 0]\nintensity = [1, 1, 1]", PLACES.0, PLACES.1),
        ("[lights.a]\ntype = \"point\"\nposition = [0, 1, 0]\nintensity = [1, @, 1]", POWERS.0, POWERS.1),
        ("[lights.a]\ntype = \"point\"\nposition = [0, 1, 0]\nintensity = [0, 0, @]", &["1e-45"], &["0.0", "-0.0"]),
        (
            "[lights.a]\ntype = \"spot\"\nposition = [0, 1, 0]\ndirection = [0, @, 0]\nintensity = [1, 1, 1]\nouter = 30",
            &["-1.0", "1e-15", "1e15"],
            &["0.0", "-0.0", "1e39"],
        ),
        (
            "[lights.a]\ntype = \"spot\"\nposition = [0, 1, 0]\ndirection = [0, -1, 0]\nintensity = [1, 1, 1]\nouter = 30\ninner = @",
            &["0.0", "-0.0", "29.9"],
            &["-0.01", "30.0", "40.0"],
        ),
        (
            "[lights.a]\ntype = \"spot\"\nposition = [0, 1, 0]\ndirection = [0, -1, 0]\nintensity = [1, 1, 1]\nouter = @",
            &["1e-3", "90.0"],
            &["0.0", "-0.0", "-1.0", "90.01"],
        ),
        ("[lights.a]\ntype = \"directional\"\ndirection = [0, -1, 0]\nirradiance = [1, 1, @]", POWERS.0, POWERS.1),
        (
            "[lights.a]\ntype = \"sphere\"\ncenter = [@, 1, 0]\nradius = 0.1\nradiance = [1, 1, 1]",
            &["0.0", "-0.0", "1e4"],
            PLACES.1,
        ),
        (
            "[lights.a]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = @\nradiance = [1, 1, 1]",
            &["1e-8", "9.9e8"],
            LENGTHS.1,
        ),
        ("[lights.a]\ntype = \"sphere\"\ncenter = [0, 1, 0]\nradius = 0.1\nradiance = [1, @, 1]", POWERS.0, POWERS.1),
        (
            "[lights.a]\ntype = \"quad\"\ncorner = [@, 1, 0]\nedge_u = [1, 0, 0]\nedge_v = [0, 0, 1]\nradiance = [1, 1, 1]",
            &["0.0", "-0.0", "1e4"],
            PLACES.1,
        ),
        (
            "[lights.a]\ntype = \"quad\"\ncorner = [0, 1, 0]\nedge_u = [@, 0, 0]\nedge_v = [0, 0, 1]\nradiance = [1, 1, 1]",
            &["1e-6", "-1e-6", "1e6"],
            &["0.0", "-0.0", "1.001e9", "1e39"],
        ),
        (
            "[lights.a]\ntype = \"quad\"\ncorner = [0, 1, 0]\nedge_u = [1, 0, 0]\nedge_v = [0, 0, 1]\nradiance = [1, 1, 1]\nemission_exponent = @",
            &["1.0", "1000.0"],
            &["0.999", "0.0", "-1.0", "1000.1"],
        ),
        ("[environment]\nradiance = [1, @, 1]", POWERS.0, POWERS.1),
        ("[environment]\nradiance = [1, 1, 1]\nrotation = @", ANY.0, ANY.1),
        ("[environment]\nup = [0, @, 0]\nradiance = [1, 1, 1]", &["-1.0", "1e-15", "1e15"], &["0.0", "-0.0", "1e39"]),
        ("[environment]\nsun = [@, 45]", &["-0.0", "720.0", "-30.0"], &["1e39"]),
        ("[environment]\nsun = [30, @]", &["0.1", "90.0"], &["0.0", "-0.0", "-1.0", "90.01"]),
        ("[environment]\nsun = [30, 45]\nturbidity = @", &["1.0", "10.0"], &["0.99", "0.0", "-0.0", "10.01"]),
        ("[materials.floor]\nbase_color = [0.5, @, 0.5]", FRACTIONS.0, FRACTIONS.1),
        ("[materials.floor]\nspecular = [0.0, @, 0.0]", FRACTIONS.0, FRACTIONS.1),
        ("[materials.floor]\nmetallic = @", FRACTIONS.0, FRACTIONS.1),
        ("[materials.floor]\nroughness = @", FRACTIONS.0, FRACTIONS.1),
        ("[materials.floor]\nanisotropy = @", FRACTIONS.0, FRACTIONS.1),
        ("[materials.floor]\nopacity = @", FRACTIONS.0, FRACTIONS.1),
        ("[materials.floor]\nalpha_cutoff = @", &["0.0", "-0.0", "3.4e38"], &["-1e-45", "1e39"]),
        ("[materials.floor]\nphong_exponent = @", &["1.0", "10000.0"], &["0.999", "0.0", "-1.0", "10000.1"]),
        ("[materials.floor]\nanisotropy_rotation = @", &["-6.283185", "-0.0", "6.283185"], &["-6.2832", "6.2832"]),
        ("[materials.lamp]\nemission = [1, @, 1]", POWERS.0, POWERS.1),
        ("[materials.lamp]\nemission_exponent = @", &["1.0", "1000.0"], &["0.999", "0.0", "-0.0", "1000.1"]),
        ("[materials.pane]\nsurface = \"glass\"\nior = @", &["0.001", "10.0"], &["0.0009", "0.0", "-0.0", "10.1"]),
    ];
    check(numbers, &NO_NUMBERS, |text| read_description(folder.path(), text));
}

#[test]
fn numbers_of_a_path() {
    let folder = folder();
    let mut scene = scene::load(&folder.path().join("room.obj")).unwrap();
    let camera = Camera { resolution: [8, 8], ..scene.framed([8, 8], None) };
    let path = folder.path().join("path.toml");
    let numbers: &[Number] = &[
        ("frames = @\n[[camera]]\ntime = 0.0", &["1", "1000000"], &["0", "-1", "1000001", "1.5"]),
        ("times = [@]\n[[camera]]\ntime = 0.0", &["-0.0", "1e300", "-1e300"], &[]),
        ("frames = 1\n[[camera]]\ntime = @", &["-0.0", "1e300", "-1e300"], &[]),
        ("frames = 1\n[[camera]]\ntime = 0.0\neye = [@, 1, 3]\ntarget = [0, 1, 0]", PLACES.0, PLACES.1),
        ("frames = 1\n[[camera]]\ntime = 0.0\neye = [0, 1, 3]\ntarget = [0, 1, @]", PLACES.0, PLACES.1),
        ("frames = 1\n[[camera]]\ntime = 0.0\nfov = @", &["1e-3", "179.99"], &["0.0", "-0.0", "180.0"]),
        (
            "frames = 1\n[[object]]\nname = \"pane\"\naxis = [0, @, 0]\nkeys = [{ time = 0.0 }]",
            &["-1.0", "1e-15", "1e15"],
            &["0.0", "-0.0", "1e39"],
        ),
        (
            "frames = 1\n[[object]]\nname = \"pane\"\npivot = [@, 0, 0]\nkeys = [{ time = 0.0 }]",
            &["-0.0", "1e9", "-1e9"],
            &["1e39", "1e300"],
        ),
        (
            "frames = 1\n[[object]]\nname = \"pane\"\nkeys = [{ time = 0.0, translation = [@, 0, 0] }]",
            &["-0.0", "9e8", "-9e8"],
            &["1.001e9", "-1.001e9", "1e30", "1e39"],
        ),
        (
            "frames = 1\n[[object]]\nname = \"pane\"\nkeys = [{ time = 0.0, degrees = @ }]",
            &["-0.0", "-1e6", "1e6"],
            &["1e39"],
        ),
        (
            "frames = 1\n[[object]]\nname = \"pane\"\nkeys = [{ time = 0.0, scale = @ }]",
            &["1e-3", "1e6"],
            &["0.0", "-0.0", "-1.0", "1e10", "1e39"],
        ),
        (
            "frames = 1\n[[object]]\nname = \"pane\"\nkeys = [{ time = 0.0, scale = [1, @, 1] }]",
            &["1e-3", "1e6"],
            &["0.0", "-0.0", "-1.0", "1e39"],
        ),
    ];
    let rest = scene.clone();
    let scene = std::cell::RefCell::new(&mut scene);
    check(numbers, &NO_NUMBERS, |text| {
        fs::write(&path, text).unwrap();
        let mut scene = scene.borrow_mut();
        **scene = rest.clone();
        let motion = Motion::load(&path, &scene, camera).map_err(|e| e.to_string())?;
        for &time in motion.times.iter().take(4) {
            motion.camera(time).map_or(Ok(()), |camera| camera.check())?;
            motion.pose(&mut scene, time).map_err(|e| e.to_string())?;
        }
        Ok(())
    });
}

#[test]
fn numbers_of_a_lobe_table() {
    let folder = folder();
    let path = folder.path().join("lobe.toml");
    let numbers: &[Number] = &[
        (
            "cos_i = [@]\ncos_o = [1.0]\nazimuth = [0.0]\nvalues = [0.1]",
            &["0.0", "-0.0", "1e-45", "1.0"],
            &["-1e-45", "1.01"],
        ),
        ("cos_i = [1.0]\ncos_o = [@]\nazimuth = [0.0]\nvalues = [0.1]", &["0.0", "-0.0", "1.0"], &["-1e-45", "1.01"]),
        (
            "cos_i = [1.0]\ncos_o = [1.0]\nazimuth = [@]\nvalues = [0.1]",
            &["0.0", "-0.0", "3.14159265"],
            &["-1e-45", "3.15"],
        ),
        (
            "cos_i = [0.2, 0.8]\ncos_o = [1.0]\nazimuth = [0.0]\nvalues = [0.1, @]",
            &["0.1", "0.12"],
            &["-1e-45", "-1.0", "1e30", "1e39"],
        ),
    ];
    check(numbers, &NO_NUMBERS, |text| {
        fs::write(&path, text).unwrap();
        Table::load(&path).map(drop).map_err(|e| e.to_string())
    });
}

#[test]
fn numbers_of_a_model() {
    let folder = folder();
    let obj = folder.path().join("a.obj");
    let at = "mtllib a.mtl\nusemtl lamp\nv @ 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let mapped = "mtllib a.mtl\nusemtl lamp\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt @ 0\nf 1/1 2/1 3/1\n";
    let read = |text: &str| {
        let (text, material) = text.split_once('|').unwrap_or((text, "Ke 1 1 1\n"));
        fs::write(&obj, text).unwrap();
        fs::write(folder.path().join("a.mtl"), format!("newmtl lamp\n{material}")).unwrap();
        scene::load(&obj).map(drop).map_err(|e| e.to_string())
    };
    let numbers: &[Number] = &[
        (at, &["0.0", "-0.0", "9e8", "-9e8"], &["4e38", "1e300"]),
        (mapped, &["0.0", "-0.0", "1e9", "-1e9"], &["4e38"]),
    ];
    check(numbers, &NO_NUMBERS, read);
    // Relative to each other: vertices far apart have no origin that is near to all.
    check(&[(at, &[], &["1e10", "-1e12", "1e30"])], &[], read);
    let emits: &[Number] = &[(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nmtllib a.mtl\nusemtl lamp\nf 1 2 3\n|Ke 1 1 @\n",
        &["0.0", "-0.0", "1e-45", "3.4e38"],
        &["-1.0", "1e39"],
    )];
    check(emits, &NO_NUMBERS, read);
}
