//! Keys of a scene file, each with a value that is not its default.

use std::fs;
use std::path::Path;

use glam::Vec3;
use lightsum::Scene;
use lightsum::scene::{self, Alpha, Material, RenderDefaults, Surface};
use lightsum::settings::{Compensation, GlossyForm, Settings, ShadowForm, SoftShadows, Splats, Spread};
use lightsum::superposition::lobe::Table;

const MODEL: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl wall\nf 1 2 3\nusemtl lamp\nf 1 3 4\n";
const MATERIALS: &str = "newmtl wall\nKd 0.5 0.4 0.3\nnewmtl lamp\nKd 0 0 0\nKe 1 1 1\n";
const LOBE: &str = "cos_i = [0.2, 1]\ncos_o = [0.5]\nazimuth = [0, 1]\nvalues = [0.2, 0.25, 0.25, 0.3]\n";

fn load(folder: &Path, more: &str) -> lightsum::Result<Scene> {
    for (name, text) in [("a.obj", MODEL), ("a.mtl", MATERIALS), ("lobe.toml", LOBE)] {
        fs::write(folder.join(name), text).unwrap();
    }
    let path = folder.join("a.toml");
    fs::write(&path, format!("model = \"a.obj\"\n{more}")).unwrap();
    scene::load(&path)
}

/// The wall of a scene that says this about it.
fn wall(keys: &str) -> Material {
    let folder = tempfile::tempdir().unwrap();
    let scene = load(folder.path(), &format!("[materials.wall]\n{keys}\n")).unwrap_or_else(|e| panic!("{keys}: {e}"));
    scene.materials.into_iter().find(|m| m.name == "wall").unwrap()
}

#[test]
fn every_key_of_a_material_is_obeyed() {
    let plain = wall("");
    let base_color = Vec3::new(0.5, 0.4, 0.3);
    assert_eq!(plain, Material { name: String::from("wall"), base_color, ..plain.clone() });
    let lobe = Table::new(vec![0.2, 1.0], vec![0.5], vec![0.0, 1.0], vec![0.2, 0.25, 0.25, 0.3]).unwrap();
    for (keys, changed) in [
        ("base_color = [0.1, 0.2, 0.3]", Material { base_color: Vec3::new(0.1, 0.2, 0.3), ..plain.clone() }),
        ("metallic = 0.25", Material { metallic: 0.25, ..plain.clone() }),
        ("phong_exponent = 12.5", Material { phong_exponent: Some(12.5), ..plain.clone() }),
        ("anisotropy = 0.75", Material { anisotropy: 0.75, ..plain.clone() }),
        ("anisotropy_rotation = -0.5", Material { anisotropy_rotation: -0.5, ..plain.clone() }),
        ("roughness = 0.375", Material { roughness: 0.375, ..plain.clone() }),
        ("specular = [0.04, 0.05, 0.06]", Material { specular: Vec3::new(0.04, 0.05, 0.06), ..plain.clone() }),
        ("opacity = 0.25", Material { alpha: Alpha::Blend { opacity: 0.25 }, ..plain.clone() }),
        (
            "opacity = 0.25\nalpha_cutoff = 0.5",
            Material { alpha: Alpha::Mask { opacity: 0.25, cutoff: 0.5 }, ..plain.clone() },
        ),
        ("emission = [1, 2, 3]", Material { emission: Vec3::new(1.0, 2.0, 3.0), ..plain.clone() }),
        ("emission_exponent = 12.5", Material { emission_exponent: 12.5, ..plain.clone() }),
        ("two_sided = true", Material { two_sided: true, ..plain.clone() }),
        ("ior = 1.25", Material { ior: 1.25, ..plain.clone() }),
        ("reflector = true", Material { reflector: Some(true), ..plain.clone() }),
        ("reflector = false", Material { reflector: Some(false), ..plain.clone() }),
        ("lobe = \"lobe.toml\"", Material { lobe: Some(lobe.into()), ..plain.clone() }),
        ("surface = \"mirror\"\nmetallic = 1", Material { surface: Surface::Mirror, metallic: 1.0, ..plain.clone() }),
        ("surface = \"mirror\"", Material { surface: Surface::Mirror, metallic: 1.0, ..plain.clone() }),
        ("surface = \"glass\"\nthin = true", Material { surface: Surface::Glass, thin: true, ..plain.clone() }),
        (
            "surface = \"glass\"\nthin = true\nroughness = 0.5",
            Material { surface: Surface::Glass, thin: true, roughness: 0.5, frost: 0.5, ..plain.clone() },
        ),
    ] {
        assert_ne!(changed, plain, "{keys}: the key has its default");
        assert_eq!(wall(keys), changed, "{keys}");
    }
}

#[test]
fn lobes_out_of_range_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (key, range, outside) in [
        ("emission_exponent", "[1, 1000]", "0.5"),
        ("phong_exponent", "[1, 10000]", "0.5"),
        ("anisotropy", "[0, 1]", "1.5"),
        ("anisotropy_rotation", "[-6.2831855, 6.2831855]", "6.3"),
    ] {
        for value in [outside, "10001.0", "nan", "inf", "-10.0"] {
            let keys = format!("[materials.lamp]\n{key} = {value}\n");
            let error = load(folder.path(), &keys).unwrap_err().to_string();
            assert!(error.contains("a.toml:2") && error.contains("materials.lamp"), "{error}");
            assert!(error.contains(key) && error.contains(range), "{error}");
        }
    }
}

#[test]
fn tables_of_lobes_that_are_no_reflectance_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (table, words) in [
        (LOBE.replace("0.3]", "nan]"), "value 3, at cos_i 1, cos_o 0.5, azimuth 1, is NaN"),
        (LOBE.replace("[0.2, 0.25", "[-0.2, 0.25"), "value 0"),
        (LOBE.replace(", 0.3]", "]"), "3 values for 2 x 1 x 2 nodes"),
        (LOBE.replace("0.2, 0.25, 0.25, 0.3", "2.0, 2.5, 2.5, 3.0"), "is reflected"),
        (LOBE.replace("[0.2, 0.25", "[0.0, 0.0"), "exchanged directions differ"),
    ] {
        fs::write(folder.path().join("other.toml"), &table).unwrap();
        let error = load(folder.path(), "[materials.wall]\nlobe = \"other.toml\"\n").unwrap_err().to_string();
        assert!(error.contains("other.toml") && error.contains(words), "{table}: {error}");
    }
    let error = load(folder.path(), "[materials.wall]\nlobe = \"none.toml\"\n").unwrap_err().to_string();
    assert!(error.contains("none.toml") && error.contains("reading failed"), "{error}");
}

#[test]
fn every_key_of_the_rendering_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let keys = "[render]\npasses = 3\nparticles = 5\ndirect_lights = 4\ninterleave = [2, 3]\nmax_depth = 6\nmax_specular = 7\n\
                split = false\nglossy_paths = false\nphotons = 8\nphoton_radius = 0.5\nsuperposition = \"invariant\"\nclip = 0.25\n\
                soft_shadows = \"splat\"\nsoft_shadow_lights = 2\nglossy = \"splats\"\nsplat_particles = 500\n\
                splat_width = 24\nsplat_alpha = 0.2\ncompensation = false\nseed = 9\nexposure = -1.5\n";
    let expected = RenderDefaults {
        passes: Some(3),
        particles: Some(5),
        direct_lights: Some(Some(4)),
        interleave: Some([2, 3]),
        max_depth: Some(6),
        max_specular: Some(7),
        split: Some(false),
        glossy_paths: Some(false),
        photons: Some(8),
        photon_radius: Some(Some(0.5)),
        superposition: Some(Some(Spread::Invariant)),
        soft_shadows: Some(ShadowForm::Splat),
        soft_shadow_lights: Some(2),
        glossy: Some(GlossyForm::Splats),
        splat_particles: Some(500),
        splat_width: Some(24.0),
        splat_alpha: Some(0.2),
        clip: Some(0.25),
        compensation: Some(Compensation::Off),
        seed: Some(9),
        exposure: Some(lightsum::settings::Exposure::Stops(-1.5)),
        ..RenderDefaults::default()
    };
    assert_eq!(load(folder.path(), keys).unwrap().render, expected);
    let settings = Settings::default().with_scene_defaults(&expected);
    assert_eq!(settings.soft_shadows, Some(SoftShadows { lights: 2 }));
    assert_eq!(settings.splats, Some(Splats { particles: 500, width: 24.0, alpha: 0.2 }));
    // Without the form the numbers turn nothing on, and the forms "off" and "paths" turn it off.
    let numbers = load(folder.path(), "[render]\nsoft_shadow_lights = 2\nsplat_width = 24\n").unwrap().render;
    let plain = Settings::default().with_scene_defaults(&numbers);
    assert_eq!((plain.soft_shadows, plain.splats), (None, None));
    let off = load(folder.path(), "[render]\nsoft_shadows = \"off\"\nglossy = \"paths\"\n").unwrap().render;
    let plain = settings.with_scene_defaults(&off);
    assert_eq!((plain.soft_shadows, plain.splats), (None, None));
    for (key, words) in [
        ("soft_shadows = \"soft\"", "expected off or splat"),
        ("glossy = \"splat\"", "expected paths or splats"),
        ("splat_particles = -1", "from 1 to 4000000"),
        ("splat_width = \"wide\"", "from 1 to 100"),
        ("soft_shadow_lights = 9", "from 1 to 8"),
        ("splat_particles = 0", "from 1 to 4000000"),
        ("splat_width = 0.5", "from 1 to 100"),
        ("splat_alpha = 2", "from 0 to 1"),
    ] {
        let error = load(folder.path(), &format!("[render]\n{key}\n")).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("a.toml:3"), "{key}: {error}");
    }
    let fraction = load(folder.path(), "[render]\nclip_fraction = 0.125\n").unwrap().render;
    assert_eq!(fraction, RenderDefaults { clip_fraction: Some(0.125), ..RenderDefaults::default() });
    for (value, expected) in
        [("true", Compensation::Exact), ("\"near\"", Compensation::Near), ("\"off\"", Compensation::Off)]
    {
        let read = load(folder.path(), &format!("[render]\ncompensation = {value}\n")).unwrap().render.compensation;
        assert_eq!(read, Some(expected));
    }
    let error = load(folder.path(), "[render]\ncompensation = \"nearly\"\n").unwrap_err().to_string();
    assert!(error.contains("off, near or exact") && error.contains("a.toml:3"), "{error}");
    // Its former name.
    let particles = load(folder.path(), "[render]\npaths = 6\n").unwrap().render.particles;
    assert_eq!(particles, Some(6));
    let error = load(folder.path(), "[render]\npath = 5\n").unwrap_err().to_string();
    assert!(error.contains("path") && error.contains("a.toml:3"), "{error}");
}
