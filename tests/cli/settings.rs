//! Settings by keys of `[render]`, by `--set` and by files of `--settings`.

use std::fs;

use crate::render::{SCENE, channels, fails, folder, succeeds};

#[test]
fn settings_of_an_image_make_it_again() {
    let folder = folder();
    let image = |name: &str| channels(&folder.path().join(name));
    let flags = "--particles 7 --interleave 2x1 --jitter --no-split --filter off --seed 5 --sequence sobol --clip 0.3";
    succeeds(folder.path(), &format!("render scene.toml --passes 1 --float -o a.exr {flags}"));
    succeeds(folder.path(), "render scene.toml --passes 1 --float -o b.exr --settings a.exr");
    succeeds(folder.path(), "render scene.toml --passes 1 --float -o plain.exr");
    assert!(image("a.exr") == image("b.exr"), "the settings of the image make another one");
    assert!(image("a.exr") != image("plain.exr"), "the flags change nothing");
    // A flag overrides --set, which overrides the file, which overrides the scene.
    fs::write(folder.path().join("keys.toml"), format!("{SCENE}[render]\nseed = 1\nfilter = \"5x5\"\nparticles = 9\n"))
        .unwrap();
    let all = "--settings a.exr --set seed=8 --set particles=3 --particles 7 --seed 5";
    succeeds(folder.path(), &format!("render keys.toml --passes 1 --float -o c.exr {all}"));
    assert!(image("a.exr") == image("c.exr"), "another order of precedence");
    fs::write(folder.path().join("some.toml"), "particles = 7\ninterleave = \"2x1\"\njitter = true\nsplit = false\n")
        .unwrap();
    let rest = "--settings some.toml --set filter=off --set seed=5 --set sequence=sobol --set clip=0.3";
    succeeds(folder.path(), &format!("render scene.toml --set passes=1 --float -o d.exr {rest}"));
    assert!(image("a.exr") == image("d.exr"), "keys differ from flags");
}

#[test]
fn unknown_keys_and_wrong_values_are_refused_with_their_place() {
    let folder = folder();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("key.toml", &format!("{SCENE}[render]\nparticels = 3\n"));
    fails(folder.path(), "render key.toml -o old.exr", 1, &["key.toml:8", "particels", "\"particles\""]);
    write("value.toml", &format!("{SCENE}[render]\nseed = 1\nfilter = \"wide\"\n"));
    fails(folder.path(), "render value.toml -o old.exr", 1, &["value.toml:9", "filter", "auto or off"]);
    let with = |more: &str| format!("render scene.toml -o old.exr {more}");
    fails(folder.path(), &with("--set particels=3"), 2, &["--set", "\"particles\""]);
    fails(folder.path(), &with("--set particles=0"), 2, &["--set", "1 to 65536"]);
    fails(folder.path(), &with("--set particles"), 2, &["--set", "KEY=VALUE"]);
    fails(folder.path(), &with("--settings none.toml"), 1, &["none.toml"]);
    write("keys.toml", "seed = 1\nsequense = \"sobol\"\n");
    fails(folder.path(), &with("--settings keys.toml"), 1, &["keys.toml:2", "\"sequence\""]);
    fs::copy(folder.path().join("old.exr"), folder.path().join("no.exr")).unwrap();
    fails(folder.path(), &with("--settings no.exr"), 1, &["no.exr"]);
    fails(folder.path(), "render scene.toml -o keys.toml.exr --settings room.obj", 1, &["room.obj"]);
}
