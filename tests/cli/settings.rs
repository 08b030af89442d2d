//! Settings by keys of `[render]`, by `--set` and by files of `--settings`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::time::Instant;

use crate::render::{SCENE, channels, fails, folder, succeeds, text};

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

#[test]
fn statistics_tell_settings_and_count_each_stage_once() {
    let folder = folder();
    let start = Instant::now();
    succeeds(folder.path(), "render scene.toml --passes 2 --particles 7 --seed 5 --float -o a.exr --stats a.json");
    let wall = start.elapsed().as_secs_f64();
    let stats: serde_json::Value = serde_json::from_slice(&fs::read(folder.path().join("a.json")).unwrap()).unwrap();
    let settings = (&stats["settings"]["particles"], &stats["settings"]["seed"], &stats["seed"]);
    assert_eq!(settings, (&7.into(), &5.into(), &5.into()));
    assert_eq!(stats["version"], env!("CARGO_PKG_VERSION"));
    assert!(stats["commit"].as_str().is_some_and(|commit| commit.len() >= 7), "{}", stats["commit"]);
    for key in ["device_bytes", "host_bytes"] {
        assert!(stats[key].as_u64().is_some_and(|bytes| bytes > 0), "{key}: {}", stats[key]);
    }
    let stages = stats["stages"].as_object().unwrap();
    let sum: f64 = stages.values().filter_map(serde_json::Value::as_f64).sum();
    assert!(sum > 0.0 && sum <= wall, "stages of {sum} s in a run of {wall} s: {stages:?}");
    // They are settings of another rendering.
    succeeds(folder.path(), "render scene.toml --passes 2 --float -o b.exr --settings a.json");
    let image = |name: &str| channels(&folder.path().join(name));
    assert!(image("a.exr") == image("b.exr"));
}

#[test]
fn animations_have_layers_and_statistics() {
    let folder = folder();
    fs::write(
        folder.path().join("path.toml"),
        "frames = 2\n[[camera]]\ntime = 0.0\n[[camera]]\ntime = 1.0\neye = [0.1, 0.5, 4.0]\n",
    )
    .unwrap();
    let run = |more: &str| {
        succeeds(folder.path(), &format!("animate scene.toml --path path.toml --moving-passes 1 --particles 4 {more}"))
    };
    run("-o a%d.exr --layers --stats a.json");
    run("-o b%d.exr");
    run("-o c%d.exr --layers --surfaces");
    let seen = channels(&folder.path().join("c1.exr"));
    assert!(
        ["object.ID", "material.ID", "uv.U", "uv.V"].iter().all(|name| seen.contains_key(*name)),
        "{:?}",
        seen.keys()
    );
    for frame in 0..2 {
        let [a, b] = ["a", "b"].map(|name| channels(&folder.path().join(format!("{name}{frame}.exr"))));
        assert!(a.contains_key("normal.X") && a.contains_key("depth.Z"), "{:?}", a.keys());
        assert_eq!(b.keys().collect::<Vec<_>>(), ["A", "B", "G", "R"]);
        assert!(["R", "G", "B"].iter().all(|c| a[*c] == b[*c]), "layers change the image");
    }
    let stats: serde_json::Value = serde_json::from_slice(&fs::read(folder.path().join("a.json")).unwrap()).unwrap();
    assert_eq!((&stats["passes_rendered"], &stats["settings"]["moving_passes"]), (&2.into(), &1.into()));
    for stage in ["load", "render", "write"] {
        assert!(stats["stages"][stage].as_f64().is_some_and(|seconds| seconds >= 0.0), "{stage}: {stats}");
    }
}

#[test]
fn surfaces_are_layers_of_the_image_and_of_its_parts() {
    let folder = folder();
    let image = |name: &str| channels(&folder.path().join(name));
    succeeds(folder.path(), "render scene.toml --passes 1 --particles 2 -o a.exr --surfaces");
    succeeds(folder.path(), "render scene.toml --passes 1 --particles 2 -o part.exr --surfaces --crop 4,6,10,5");
    succeeds(folder.path(), "render scene.toml --passes 1 --particles 2 -o b.exr");
    let (whole, part, plain) = (image("a.exr"), image("part.exr"), image("b.exr"));
    let materials: BTreeSet<i32> = whole["material.ID"].iter().map(|id| *id as i32).collect();
    assert!(materials.len() >= 3, "floor, wall and background: {materials:?}");
    // The eye rays of a pass do not go through the centres, so that pixels at edges may differ.
    let differs = |(id, depth): &(&f32, &f32)| (**id == -1.0) != (**depth == f32::INFINITY);
    let edges = whole["material.ID"].iter().zip(&whole["depth.Z"]).filter(differs).count();
    assert!(edges < 32, "{edges} of 320 pixels");
    for name in ["object.ID", "material.ID", "uv.U", "uv.V"] {
        let cut: Vec<f32> = (6..11).flat_map(|y| whole[name][y * 20 + 4..][..10].to_vec()).collect();
        assert!(part[name] == cut && !plain.contains_key(name), "{name}");
    }
    assert!(plain.iter().all(|(name, values)| &whole[name] == values), "layers change the image");

    // The names beside the numbers, as compositing programs read them.
    let attributes =
        exr::prelude::read_first_flat_layer_from_file(folder.path().join("a.exr")).unwrap().layer_data.attributes;
    let texts: BTreeMap<String, String> = attributes
        .other
        .iter()
        .filter_map(|(name, value)| match value {
            exr::prelude::AttributeValue::Text(text) => Some((name.to_string(), text.to_string())),
            _ => None,
        })
        .collect();
    for (layer, of) in [("CryptoObject", "object.ID"), ("CryptoMaterial", "material.ID")] {
        let key = texts.iter().find(|(name, text)| name.ends_with("/name") && *text == layer).unwrap().0;
        let get = |what: &str| &texts[&key.replace("/name", what)];
        assert_eq!((get("/hash").as_str(), get("/conversion").as_str()), ("MurmurHash3_32", "uint32_to_float32"));
        let manifest: BTreeMap<String, String> = serde_json::from_str(get("/manifest")).unwrap();
        let named: BTreeMap<&str, &str> = manifest.iter().map(|(name, hash)| (hash.as_str(), name.as_str())).collect();
        let (ids, coverage) = (&whole[&format!("{layer}00.R")], &whole[&format!("{layer}00.G")]);
        for ((id, coverage), number) in ids.iter().zip(coverage).zip(&whole[of]) {
            let name = named.get(format!("{:08x}", id.to_bits()).as_str());
            assert_eq!(
                (name.is_some(), *coverage),
                (*number >= 0.0, if *number >= 0.0 { 1.0 } else { 0.0 }),
                "{layer}"
            );
        }
        let shown: BTreeSet<u32> = ids.iter().map(|id| id.to_bits()).collect();
        assert!(shown.len() >= 2, "{layer} shows {shown:?}");
    }
}

#[test]
fn the_manual_is_written() {
    let folder = folder();
    for shell in ["bash", "zsh", "fish"] {
        let script = text(&succeeds(folder.path(), &format!("manual completions {shell}")).stdout);
        assert!(script.contains("--light-pool") || script.contains("light-pool"), "{shell}");
    }
    succeeds(folder.path(), "manual man --into .");
    let page = fs::read_to_string(folder.path().join("lightsum-render.1")).unwrap();
    assert!(page.contains("light\\-pool") && folder.path().join("lightsum.1").exists());
    succeeds(folder.path(), "manual reference --into .");
    let reference = fs::read_to_string(folder.path().join("reference.md")).unwrap();
    assert!(reference.starts_with("# Flags and keys") && reference.contains("`--light-pool N`"));
    fails(folder.path(), "manual reference --into missing", 1, &["missing"]);
}
