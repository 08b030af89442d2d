//! Buffers and images in files of their own.

use super::*;

/// A triangle whose material has a base texture from a file.
fn textured(uri: &str) -> Case {
    Case::with(|c| {
        c.document["images"] = json!([{ "uri": uri }]);
        c.document["textures"] = json!([{ "source": 0 }]);
        c.document["materials"][0]["pbrMetallicRoughness"] = json!({ "baseColorTexture": { "index": 0 } });
    })
}

#[test]
fn names_are_decoded_and_relative_to_the_model() {
    let case = textured("my%20images/w%C3%A4nde.png");
    std::fs::create_dir(case.path("my images")).unwrap();
    std::fs::write(case.path("my images/w\u{e4}nde.png"), png(&[[9, 8, 7, 255]], 1)).unwrap();
    assert_eq!(case.load().unwrap().textures[0].texels, [[9, 8, 7, 255]]);
    // The same by its absolute address, which is not encoded. It lies outside of the folder of this model.
    let absolute = textured(&format!("file://{}", case.path("my images/w\u{e4}nde.png").display()));
    let message = absolute.load().unwrap_err().to_string();
    assert!(message.contains("w\u{e4}nde.png: lies outside") && message.contains("--allow-outside"), "{message}");
    let anywhere = scene::ReadOptions { allow_outside: true, ..Default::default() };
    let scene = scene::load_with(&absolute.path("a.gltf"), &anywhere).unwrap();
    assert_eq!(scene.textures[0].texels, [[9, 8, 7, 255]]);
}

#[cfg(unix)]
#[test]
fn only_regular_files_are_read() {
    let refused = |case: &Case, name: &str, words: &[&str]| {
        let message = case.load().unwrap_err().to_string();
        assert!(message.contains(name) && words.iter().all(|word| message.contains(word)), "{message}");
    };
    // Each is tried as a buffer and as an image.
    let both = |uri: &str, make: &dyn Fn(&Case), reason: &str| {
        let name = uri.trim_start_matches("file://");
        let case = Case::with(|c| c.document["buffers"][0]["uri"] = json!(uri));
        make(&case);
        refused(&case, name, &["buffer 0", reason]);
        let case = textured(uri);
        make(&case);
        refused(&case, name, &["texture", reason]);
    };
    both("folder", &|case| std::fs::create_dir(case.path("folder")).unwrap(), "is a directory");
    both(
        "pipe",
        &|case| assert!(std::process::Command::new("mkfifo").arg(case.path("pipe")).status().unwrap().success()),
        "a device or pipe",
    );
    both("link", &|case| std::os::unix::fs::symlink("/dev/zero", case.path("link")).unwrap(), "a device or pipe");
    both("file:///dev/zero", &|_| {}, "a device or pipe");
    both("none.bin", &|_| {}, "none.bin");
    // A file without content that is larger than any memory.
    let sparse = |case: &Case| std::fs::File::create(case.path("large")).unwrap().set_len(1 << 43).unwrap();
    both("large", &sparse, "memory");
}
