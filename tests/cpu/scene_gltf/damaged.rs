//! Damaged files: errors, and no panic.

use std::cell::RefCell;
use std::path::Path;

use super::*;

thread_local! {
    /// Places of panics on this thread, if it is watched.
    static PANICS: RefCell<Option<Vec<String>>> = const { RefCell::new(None) };
}

/// Keeps the places of panics on this thread, caught or not, in place of printing them. The loader's own hook must have been
/// set before.
fn watch_panics() {
    PANICS.set(Some(Vec::new()));
    let previous = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        let place = info.location().map(ToString::to_string).unwrap_or_default();
        let is_watched = PANICS.with_borrow_mut(|panics| panics.as_mut().map(|list| list.push(place)).is_some());
        if !is_watched {
            previous(info);
        }
    }));
}

#[test]
fn damaged_files_never_panic() {
    let case = Case::new();
    let data =
        |name: &str| std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cpu/data").join(name)).unwrap();
    std::fs::write(case.path("four texels.png"), data("four texels.png")).unwrap();
    case.load().unwrap();
    watch_panics();
    let toml = "model = \"quarters.obj\"\n[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\nfov_y = 40\n\
                [lights.a]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 2\nradiance = [1, 1, 1]\n";
    let files = [
        ("quarters.mtl", "quarters.obj", data("quarters.mtl")),
        ("quarters.obj", "quarters.obj", data("quarters.obj")),
        ("four texels.png", "quarters.obj", data("four texels.png")),
        ("a.bin", "a.gltf", case.bin.clone()),
        ("a.gltf", "a.gltf", case.document.to_string().into_bytes()),
        ("a.glb", "a.glb", case.glb()),
        ("scene.toml", "scene.toml", toml.as_bytes().to_vec()),
    ];
    for (name, _, bytes) in &files {
        std::fs::write(case.path(name), bytes).unwrap();
    }
    let mut state = 1u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let (mut accepted, mut refused) = (0, 0);
    for (name, main, bytes) in &files {
        assert!(scene::load(&case.path(main)).is_ok(), "{main}");
        for _ in 0..300 {
            let mut damaged = bytes.clone();
            for _ in 0..=random(3) {
                let at = random(damaged.len());
                match random(4) {
                    0 => damaged[at] = random(256) as u8,
                    1 => damaged[at] = b"0123456789-.e[]{}\"/ \n"[random(21)],
                    2 => damaged.truncate(at + 1),
                    _ => drop(damaged.remove(at)),
                }
                if damaged.is_empty() {
                    break;
                }
            }
            std::fs::write(case.path(name), damaged).unwrap();
            // Either a scene or an error. The loader makes an error of a panic in the glTF crate; it must not panic itself.
            match scene::load(&case.path(main)) {
                Ok(scene) => {
                    assert!(!scene.triangles.is_empty());
                    accepted += 1;
                }
                Err(_) => refused += 1,
            }
            let panics = PANICS.replace(Some(Vec::new())).unwrap_or_default();
            let ours = panics.iter().find(|place| !place.contains("/gltf-"));
            assert!(ours.is_none(), "{name}: a panic at {ours:?}");
        }
        std::fs::write(case.path(name), bytes).unwrap();
    }
    assert!(
        accepted > 100 && refused > 100,
        "{accepted} accepted, {refused} refused: the damage is too light or too heavy"
    );
}
