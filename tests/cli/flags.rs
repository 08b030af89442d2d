//! Each flag of `render` that changes the light changes the image, and a key of a scene file does what its flag does.
//!
//! LIGHTSUM_DEVICE names the device, as for the other tests on one.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use crate::render::{fails, succeeds};

/// A floor that is glossy, a wall and a screen before it, a mirror at the side, and two lamps, one of which hardly matters to the view.
const MODEL: &str = "mtllib room.mtl
v -1 0 -1\nv -1 0 1\nv 1 0 1\nv 1 0 -1
v -0.5 1 -0.5\nv 0.5 1 -0.5\nv 0.5 1 0.5\nv -0.5 1 0.5
v -1 1 -1\nv 1 1 -1
v 1 1 1
v 3 1 -0.5\nv 4 1 -0.5\nv 4 1 0.5\nv 3 1 0.5
v -0.7 0 0.4\nv -0.1 0 0.4\nv -0.1 0.5 0.4\nv -0.7 0.5 0.4
usemtl floor\nf 1 2 3 4
usemtl wall\nf 1 4 10 9\nf 16 17 18 19
usemtl mirror\nf 4 3 11 10
usemtl lamp\nf 5 6 7 8
usemtl other\nf 12 13 14 15
";
const MATERIALS: &str = "newmtl floor\nKd 0.3 0.3 0.3\nKs 0.4 0.4 0.4\nPr 0.2\nillum 2
newmtl wall\nKd 0.2 0.6 0.3
newmtl mirror\nKd 0.2 0.2 0.2\nKs 0.6 0.6 0.6\nillum 3
newmtl lamp\nKd 0 0 0\nKe 10 10 10
newmtl other\nKd 0 0 0\nKe 20 20 20
";
const SCENE: &str = "model = \"room.obj\"
[camera]
eye = [-0.3, 0.5, 4.0]
target = [0.1, 0.4, 0.0]
fov_y = 34.0
resolution = [24, 18]
";

/// Channels of an image by name.
type Image = BTreeMap<String, Vec<f32>>;

/// Renders a scene with flags.
#[track_caller]
fn render(folder: &Path, scene: &str, flags: &str) -> Image {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsum"));
    command.args(["render", scene, "--float", "-o", "a.exr", "-o", "a.png"]).args(flags.split_whitespace());
    if let Ok(device) = std::env::var("LIGHTSUM_DEVICE") {
        command.args(["--device", &device]);
    }
    command.current_dir(folder).env_remove("RUST_LOG").env("XDG_CACHE_HOME", crate::render::cache());
    let output = command.output().expect("the program starts");
    assert!(output.status.success(), "{flags}: {}", String::from_utf8_lossy(&output.stderr));
    let image = exr::prelude::read_first_flat_layer_from_file(folder.join("a.exr")).unwrap();
    let list = image.layer_data.channel_data.list;
    let image: Image = list.iter().map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect())).collect();
    // Where nothing is seen, the depth is infinite.
    let is_sound = |name: &str, v: f32| v.is_finite() || name == "depth.Z" && v == f32::INFINITY;
    for (name, channel) in &image {
        assert!(channel.iter().all(|&v| is_sound(name, v)), "{flags}: a value of {name} is not finite");
    }
    image
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, text) in [("room.obj", MODEL), ("room.mtl", MATERIALS), ("scene.toml", SCENE)] {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// Ratio of the energies of two images.
fn energy(image: &Image, of: &Image) -> f64 {
    let sum = |image: &Image| ["R", "G", "B"].iter().flat_map(|c| &image[*c]).map(|&v| f64::from(v)).sum::<f64>();
    sum(image) / sum(of)
}

#[test]
fn each_flag_of_the_light_changes_the_image_and_hardly_its_energy() {
    let folder = folder();
    let image = |flags: &str| render(folder.path(), "scene.toml", &format!("--passes 2 --particles 32 {flags}"));
    let plain = image("");
    // The same lights, chosen, placed or traced otherwise; how far the energy may be off after two passes.
    for (flags, tolerance) in [
        ("--direct-lights 4", 0.1),
        ("--light-pool 0", 0.1),
        ("--compensation exact", 0.1),
        ("--light-choice contribution", 0.1),
        ("--light-choice contribution --power-fraction 0.9", 0.1),
        ("--sequence sobol", 0.1),
        ("--light-threshold 1", 0.1),
        ("--mirror-lights 8", 0.3),
        ("--preset interactive", 0.1),
    ] {
        let changed = image(flags);
        let ratio = energy(&changed, &plain);
        println!("{flags}: energy {ratio}");
        assert!(changed != plain, "{flags} changes nothing");
        assert!((ratio - 1.0).abs() < tolerance, "{flags}: energy {ratio}");
    }
    assert!(image("--light-choice contribution") != image("--light-choice contribution --power-fraction 0.9"));
    // Without a pool to choose from the order of clusters decides by rounding alone which lights are seen.
    let plain = image("--light-pool 0");
    let ordered = image("--light-pool 0 --cluster-order space");
    let differ = |(a, b): &(&f32, &f32)| (**a - **b).abs() > 1e-3 * a.abs().max(1e-3);
    let strays = plain.iter().flat_map(|(name, channel)| channel.iter().zip(&ordered[name])).filter(differ).count();
    assert!(strays <= 20, "{strays} values depend on the order of clusters");
}

#[test]
fn each_flag_of_glossy_planes_changes_their_reflection() {
    let folder = folder();
    let image = |flags: &str| render(folder.path(), "scene.toml", &format!("--passes 1 --particles 8 {flags}"));
    let all = [
        "--superposition off",
        "--superposition mirror",
        "--superposition invariant",
        "--superposition invariant --kernel-width 5",
        "--superposition variant",
        "--superposition variant --reflectance map",
        "--superposition variant --reflectance fresnel",
        "--superposition variant --no-occlusion",
        "--superposition variant --convolution direct",
    ];
    let images = all.map(image);
    for (i, flags) in all.iter().enumerate() {
        for other in 0..i {
            assert!(images[i] != images[other], "{flags} and {} give the same image", all[other]);
        }
    }
    assert!(image("") == images[0], "glossy planes show no room by themselves");
    let ratio = energy(&images[8], &images[4]);
    assert!((ratio - 1.0).abs() < 0.05, "both forms of the convolution have the same light: {ratio}");
    assert!(
        image("--superposition variant --reflectors 0") != images[4],
        "no reflector is left, and it shows the same"
    );
}

#[test]
fn images_with_depth_show_about_what_rays_show() {
    let folder = folder();
    let flags = "--passes 2 --particles 32 --superposition mirror";
    let images = "--mirror-source images --mirror-hemispheres 2 --mirror-images 3 --mirror-side 16 --mirror-passes 4";
    let rays = render(folder.path(), "scene.toml", &format!("{flags} --mirror-source rays"));
    let image = |more: &str| render(folder.path(), "scene.toml", &format!("{flags} {images} {more}"));
    let image = image("--stats s.json --mirror-merge 1 --mirror-choice distance --mirror-layers 2");
    let stats: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.path().join("s.json")).unwrap()).expect("statistics are JSON");
    assert!(stats["mirror_pixels"]["shown"].as_u64().is_some_and(|shown| shown > 20), "{stats}");
    let ratio = energy(&image, &rays);
    assert!(image != rays && (ratio - 1.0).abs() < 0.1, "energy {ratio}");

    let refused = |flags: &str, names: &[&str]| {
        fails(folder.path(), &format!("render scene.toml -o old.exr --mirror-source images {flags}"), 2, names);
    };
    refused("", &["--mirror-source", "--superposition variant"]);
    refused("--superposition mirror --reflectors 0", &["--mirror-source", "--reflectors"]);
    refused("--superposition mirror --mirror-memory 1M", &["--mirror-memory", "MiB", "1.0 are allowed"]);
    fs::write(folder.path().join("plain.mtl"), "newmtl floor\nKd 1 1 1\nnewmtl lamp\nKd 0 0 0\nKe 1 1 1\n").unwrap();
    let plain = MODEL.replace("room.mtl", "plain.mtl").replace("usemtl wall", "usemtl floor");
    let plain = plain.replace("usemtl mirror", "usemtl floor").replace("usemtl other", "usemtl lamp");
    fs::write(folder.path().join("plain.obj"), plain).unwrap();
    fs::write(folder.path().join("plain.toml"), SCENE.replace("room.obj", "plain.obj")).unwrap();
    let flags = "render plain.toml -o old.exr --superposition mirror --mirror-source images";
    fails(folder.path(), flags, 2, &["--mirror-source", "no planar glossy reflector"]);
}

#[test]
fn orthographic_cameras_by_flag_and_by_file() {
    let folder = folder();
    let image = |scene: &str, flags: &str| render(folder.path(), scene, &format!("--passes 1 --particles 8 {flags}"));
    let plan = SCENE.replace("fov_y = 34.0", "projection = \"orthographic\"\nheight = 2.0");
    fs::write(folder.path().join("plan.toml"), plan).unwrap();
    let by_file = image("plan.toml", "");
    assert!(by_file == image("scene.toml", "--ortho 2") && by_file != image("scene.toml", ""));
    assert!(image("plan.toml", "--fov 34") == image("scene.toml", ""), "an angle of view makes it a perspective one");
    // The path tracer has the same rays.
    let reference = render(folder.path(), "plan.toml", "--reference --spp 64");
    let ratio = energy(&image("plan.toml", "--passes 16"), &reference);
    assert!((ratio - 1.0).abs() < 0.1, "energy {ratio}");
    for (flags, names) in [
        ("--ortho 0", ["--ortho", "1e-15 to 1e9"]),
        ("--ortho 2 --fov 40", ["--ortho", "--fov"]),
        ("--ortho 2 --aperture 0.1", ["--aperture", "no lens"]),
        ("--ortho 2 --superposition variant", ["--superposition", "use off"]),
    ] {
        fails(folder.path(), &format!("render scene.toml -o b.png {flags}"), 2, &names);
    }
}

#[test]
fn soft_shadows_change_the_image_and_hardly_its_energy() {
    let folder = folder();
    let image = |scene: &str, flags: &str| render(folder.path(), scene, &format!("--passes 2 --particles 32 {flags}"));
    let (plain, soft) = (image("scene.toml", ""), image("scene.toml", "--soft-shadows splat"));
    let ratio = energy(&soft, &plain);
    assert!(soft != plain && (ratio - 1.0).abs() < 0.1, "energy {ratio}");
    assert!(image("scene.toml", "--soft-shadows splat --soft-shadow-lights 1") != soft, "the scene has two lamps");
    fs::write(folder.path().join("soft.toml"), format!("{SCENE}[render]\nsoft_shadows = \"splat\"\n")).unwrap();
    assert!(image("soft.toml", "") == soft && image("soft.toml", "--soft-shadows off") == plain);
    fails(folder.path(), "bake scene.toml -o a.glb --soft-shadows splat", 2, &["--soft-shadows"]);
    fails(folder.path(), "render scene.toml -o b.png --soft-shadows splat --reference", 2, &["--soft-shadows"]);
}

#[test]
fn splats_by_keys_are_those_by_flags() {
    let folder = folder();
    let keys = "glossy = \"splats\"\nsplat_particles = 3000\nsplat_width = 40\nsplat_alpha = 0.01\n\
                soft_shadows = \"splat\"\nsoft_shadow_lights = 1\n";
    fs::write(folder.path().join("keys.toml"), format!("{SCENE}[render]\n{keys}")).unwrap();
    let image = |scene: &str, flags: &str| render(folder.path(), scene, &format!("--passes 2 --particles 8 {flags}"));
    let flags = "--glossy splats --splat-particles 3000 --splat-width 40 --splat-alpha 0.01 --soft-shadows splat \
                 --soft-shadow-lights 1";
    let by_keys = image("keys.toml", "");
    assert!(by_keys == image("scene.toml", flags), "keys and flags give different images");
    // Each key counts, and flags override them.
    for other in ["--glossy paths", "--splat-particles 2000", "--splat-width 20", "--soft-shadow-lights 2"] {
        assert!(by_keys != image("keys.toml", other), "{other} changes nothing");
    }
    assert!(image("keys.toml", "--glossy paths --soft-shadows off") == image("scene.toml", ""));
}

#[test]
fn resumed_runs_with_splats_and_soft_shadows_equal_unbroken_ones() {
    let folder = folder();
    let file = |name: &str| fs::read(folder.path().join(name)).unwrap();
    for flags in ["--glossy splats --splat-particles 3000 --splat-alpha 0.01", "--soft-shadows splat"] {
        let run = |output: &str, passes: u32, more: &str| {
            let line = format!("render scene.toml -o {output} --float --particles 8 --passes {passes} {flags} {more}");
            succeeds(folder.path(), &line);
        };
        run("whole.exr", 5, "");
        run("parts.exr", 2, "--resume");
        assert!(file("whole.exr") != file("parts.exr"), "{flags}: the passes make no difference");
        run("parts.exr", 5, "--resume");
        assert!(file("whole.exr") == file("parts.exr"), "{flags}");
        fs::remove_file(folder.path().join("parts.exr.state")).unwrap();
    }
}

#[test]
fn the_summands_add_up_to_the_image() {
    let folder = folder();
    let image = render(folder.path(), "scene.toml", "--passes 2 --particles 8 --summands --superposition variant");
    for c in ["R", "G", "B"] {
        let [emission, diffuse, specular] =
            ["emission", "diffuse", "specular"].map(|layer| &image[&format!("{layer}.{c}")]);
        assert!([emission, diffuse, specular].iter().all(|layer| layer.iter().any(|&v| v > 0.0)));
        for i in 0..24 * 18 {
            assert_eq!(image[c][i], emission[i] + diffuse[i] + specular[i], "{c} of pixel {i}");
        }
    }
}

#[test]
fn a_key_of_the_scene_does_what_its_flag_does() {
    let folder = folder();
    let write =
        |name: &str, keys: &str| fs::write(folder.path().join(name), format!("{SCENE}[render]\n{keys}")).unwrap();
    write(
        "keys.toml",
        "passes = 3\nparticles = 12\ndirect_lights = 4\ninterleave = [2, 1]\nmax_depth = 4\nmax_specular = 3\n\
         photons = 16\nphoton_radius = 0.3\nsuperposition = \"invariant\"\nclip = 0.4\ncompensation = false\nseed = 5\n\
         exposure = -2.0\n",
    );
    let flags = "--passes 3 --particles 12 --direct-lights 4 --interleave 2x1 --max-depth 4 --max-specular 3 \
                 --photons 16 --photon-radius 0.3 --superposition invariant --clip 0.4 --no-compensation --seed 5 \
                 --exposure -2.0";
    let png = || fs::read(folder.path().join("a.png")).unwrap();
    let by_keys = (render(folder.path(), "keys.toml", ""), png());
    let by_flags = (render(folder.path(), "scene.toml", flags), png());
    assert!(by_keys == by_flags, "keys and flags give different images");
    write("fraction.toml", "passes = 1\nclip_fraction = 0.3\nsplit = false\n");
    let by_key = render(folder.path(), "fraction.toml", "");
    assert!(by_key == render(folder.path(), "scene.toml", "--passes 1 --clip-fraction 0.3 --no-split"));
    assert!(by_key != render(folder.path(), "scene.toml", "--passes 1 --no-split"), "the fraction has its default");
    assert!(by_key != render(folder.path(), "scene.toml", "--passes 1 --clip-fraction 0.3"), "paths are split");
    // A flag overrides the key of its name.
    let overridden = render(folder.path(), "fraction.toml", "--clip-fraction 0.1");
    assert!(overridden == render(folder.path(), "scene.toml", "--passes 1 --clip-fraction 0.1 --no-split"));
}
