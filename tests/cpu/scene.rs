//! Scene files: valid ones, invalid ones and their errors.

use std::f32::consts::PI;
use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use lightsum::scene::{self, Light, Scene, Surface, Wrap, builtin};
use tempfile::TempDir;

pub fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = TempDir::new().unwrap();
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// The error of a scene, without the name of the folder.
fn refusal(files: &[(&str, &str)], main: &str) -> String {
    let folder = folder(files);
    let error = scene::load(&folder.path().join(main)).expect_err("should be refused").to_string();
    error.replace(&format!("{}/", folder.path().display()), "")
}

fn assert_refused(files: &[(&str, &str)], main: &str, parts: &[&str]) {
    let error = refusal(files, main);
    for part in parts {
        assert!(error.contains(part), "{error:?} lacks {part:?}");
    }
}

pub fn material<'a>(scene: &'a Scene, name: &str) -> &'a scene::Material {
    scene.materials.iter().find(|m| m.name == name).unwrap()
}

const LAMP: &str = "newmtl lamp\nKe 1 1 1\n";
/// Three vertices on lines 2 to 4, one lit triangle on line 7.
const TRIANGLE: &str = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\no thing\nusemtl lamp\nf 1 2 3\n";
const CAMERA: &str = "[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\nfov_y = 40\n";

fn refused_obj(statement: &str, parts: &[&str]) {
    let obj = format!("{TRIANGLE}{statement}\n");
    assert_refused(&[("m.mtl", LAMP), ("a.obj", &obj)], "a.obj", parts);
}

fn refused_mtl(statement: &str, parts: &[&str]) {
    let mtl = format!("{LAMP}{statement}\n");
    assert_refused(&[("m.mtl", &mtl), ("a.obj", TRIANGLE)], "a.obj", parts);
}

fn with_description(toml: &str) -> scene::Scene {
    let folder = folder(&[("m.mtl", LAMP), ("a.obj", TRIANGLE), ("scene.toml", toml)]);
    scene::load(&folder.path().join("scene.toml")).unwrap()
}

fn refused_description(toml: &str, parts: &[&str]) {
    assert_refused(&[("m.mtl", LAMP), ("a.obj", TRIANGLE), ("scene.toml", toml)], "scene.toml", parts);
}

#[test]
fn orthographic_cameras_are_read_and_checked() {
    let place = "model = \"a.obj\"\n[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\n";
    let camera = with_description(&format!("{place}projection = \"orthographic\"\nheight = 2.5\n")).camera.unwrap();
    assert_eq!((camera.height, camera.half_extents()[1], camera.is_orthographic()), (Some(2.5), 1.25, true));
    let usual = with_description(&format!("{place}projection = \"perspective\"\nfov_y = 30\n")).camera.unwrap();
    assert_eq!((usual.height, usual.fov_y), (None, 30.0));
    for (words, parts) in [
        ("projection = \"orthographic\"", ["no `height`", "scene units"]),
        ("projection = \"orthographic\"\nheight = 0", ["height 0", "not in"]),
        ("projection = \"orthographic\"\nheight = nan", ["height NaN", "not in"]),
        ("projection = \"orthographic\"\nheight = 2\nfov_y = 40", ["`fov_y` has no meaning", "leave it out"]),
        ("projection = \"orthographic\"\nheight = 2\naperture = 0.1", ["aperture 0.1", "no lens"]),
        ("fov_y = 40\nheight = 2", ["`height`", "projection = \"orthographic\""]),
        ("projection = \"fisheye\"\nfov_y = 40", ["fisheye", "orthographic"]),
    ] {
        refused_description(&format!("{place}{words}\n"), &["scene.toml", parts[0], parts[1]]);
    }
}

#[test]
fn lenses_are_read_and_checked() {
    let camera = |words: &str| with_description(&format!("model = \"a.obj\"\n{CAMERA}{words}")).camera.unwrap();
    assert!((camera("").aperture, camera("").focus_distance(), camera("").has_lens()) == (0.0, 5.0, false));
    let lens = camera("aperture = 0.25\nfocus = 3\n");
    assert!((lens.aperture, lens.focus_distance(), lens.has_lens()) == (0.25, 3.0, true));
    for (words, part) in [("aperture = -1", "aperture"), ("aperture = nan", "aperture"), ("focus = 0", "focus")] {
        refused_description(&format!("model = \"a.obj\"\n{CAMERA}{words}\n"), &["[camera]", part]);
    }
}

#[test]
fn shutters_are_read_and_checked() {
    let camera = |words: &str| with_description(&format!("model = \"a.obj\"\n{CAMERA}{words}")).camera.unwrap();
    assert!((camera("").shutter, camera("").has_shutter()) == (0.0, false));
    assert!((camera("shutter = 0.02\n").shutter, camera("shutter = 0.02\n").has_shutter()) == (0.02, true));
    for words in ["shutter = -0.1", "shutter = nan", "shutter = inf"] {
        refused_description(&format!("model = \"a.obj\"\n{CAMERA}{words}\n"), &["[camera]", "shutter"]);
    }
}

#[test]
fn vertex_colors_of_obj_are_decoded() {
    let folder = tempfile::tempdir().unwrap();
    let text = "v 0 0 0\nv 1 0 0 1 0.5 0\nv 0 1 0 0 0 2\nv 0 0 1\nf 1 2 3\nf 1 2 4\n";
    std::fs::write(folder.path().join("a.obj"), text).unwrap();
    let scene = scene::load(&folder.path().join("a.obj")).unwrap();
    // sRGB 0.5 is 0.214 (IEC 61966-2-1); what a vertex lacks is white.
    let expected = [Vec3::ONE, Vec3::new(1.0, 0.21404, 0.0), Vec3::Z, Vec3::ONE];
    assert_eq!(scene.colors.len(), 4);
    for (color, expected) in scene.colors.iter().zip(expected) {
        assert!((*color - expected).abs().max_element() < 1e-4, "{color} {expected}");
    }
    assert_refused(&[("a.obj", &text.replace("0.5", "red"))], "a.obj", &["a.obj:2", "red"]);
}

#[test]
fn obj_is_read() {
    let scene = scene::load(&repository("tests/cpu/data/quarters.obj")).unwrap();
    assert_eq!(scene.name, "quarters");
    assert_eq!(scene.objects, ["square", "triangles"]);
    assert_eq!(scene.triangles.len(), 10);
    assert_eq!(scene.emitters(), [2]);
    assert_eq!(scene.bounds(), (Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)));
    assert!((scene.diagonal() - 2.0f32.sqrt()).abs() < 1e-6);
    assert!((scene.triangle_area(0) - 0.5).abs() < 1e-6);

    // Smooth only if all corners have a nonzero normal.
    let smooth: Vec<bool> = scene.triangles.iter().map(|t| t.smooth).collect();
    assert_eq!(smooth, [true, true, false, false, false, false, false, false, false, false]);
    let corner = scene.triangles[0].vertices[1] as usize;
    assert_eq!(scene.normals[corner], Vec3::new(0.6, 0.0, 0.8).normalize());
    assert_eq!(scene.normals[scene.triangles[0].vertices[0] as usize], Vec3::Z);

    let gloss = material(&scene, "gloss");
    assert_eq!((gloss.base_color, gloss.specular, gloss.metallic), (Vec3::splat(0.5), Vec3::splat(0.25), 0.0));
    // alpha = sqrt(2 / 200) = 0.1.
    assert!((gloss.roughness - 0.1f32.sqrt()).abs() < 1e-6);
    let metal = material(&scene, "metal");
    assert_eq!((metal.metallic, metal.roughness), (1.0, 0.4));
    let shared_out = material(&scene, "shared_out");
    assert_eq!((shared_out.metallic, shared_out.specular), (0.0, Vec3::splat(0.72)));
    let mirror = material(&scene, "mirror");
    assert_eq!((mirror.surface, mirror.specular), (Surface::Mirror, Vec3::new(0.9, 0.8, 0.7)));
    assert_eq!(mirror.base_color, Vec3::ZERO, "without Kd it mirrors and nothing else");
    let pane = material(&scene, "pane");
    // One triangle encloses nothing.
    assert_eq!((pane.surface, pane.ior, pane.thin), (Surface::Glass, 1.52, true));
    assert_eq!(pane.base_color, Vec3::new(0.9, 1.0, 0.8), "Tf");
    assert_eq!(material(&scene, "dull").specular, Vec3::ZERO);
    // Scaled down so that no channel reflects more than it receives.
    assert!((material(&scene, "bright").base_color - Vec3::new(0.7, 0.8, 0.9)).abs().max_element() < 1e-6);
    assert_eq!(material(&scene, "lamp").emission, Vec3::new(2.0, 3.0, 4.0));
}

#[test]
fn textures_stand_upright() {
    let scene = scene::load(&repository("tests/cpu/data/quarters.obj")).unwrap();
    let texture = &scene.textures[material(&scene, "quarters").base_texture.unwrap() as usize];
    assert_eq!((texture.width, texture.height, texture.srgb), (2, 2, true));
    assert_eq!(texture.wrap, [Wrap::Clamp; 2]);
    // Rows from the top: the texel at v = 0 is the file's first.
    assert_eq!(texture.texels[0], [255, 0, 0, 255]);
    assert_eq!(texture.texels[2], [0, 0, 255, 255]);
    // The upper left corner of the square, (0, 1, 0), gets that of the texture.
    let corner = |p: Vec3| {
        let vertices = scene.triangles[0].vertices.into_iter().chain(scene.triangles[1].vertices);
        scene.uvs[vertices.map(|v| v as usize).find(|&v| scene.positions[v] == p).unwrap()]
    };
    assert_eq!(corner(Vec3::Y), Vec2::ZERO);
    assert_eq!(corner(Vec3::ZERO), Vec2::Y);
    assert_eq!(corner(Vec3::X), Vec2::ONE);
    assert!((texture.average() - 0.5).abs().max_element() < 1e-6);
}

#[test]
fn bad_obj_is_refused() {
    refused_obj("v 1 nan 2", &["a.obj:8:", "thing", "nan is not a finite number"]);
    refused_obj("v 1 1e99 2", &["a.obj:8:", "not a finite number"]);
    refused_obj("v 1 2", &["a.obj:8:", "needs 3 numbers"]);
    refused_obj("v 1 2 x", &["a.obj:8:", "\"x\" is not a number"]);
    refused_obj("vn 0 0 inf", &["a.obj:8:", "normal", "inf"]);
    refused_obj("vt nan 0", &["a.obj:8:", "texture coordinate"]);
    refused_obj("f 1 2 4", &["a.obj:8:", "thing", "vertex index 4", "3 are defined"]);
    refused_obj("f 1 2 -4", &["a.obj:8:", "vertex index -4"]);
    refused_obj("f 0 1 2", &["a.obj:8:", "vertex index 0"]);
    refused_obj("f 1/1 2/1 3/1", &["a.obj:8:", "texture coordinate index 1"]);
    refused_obj("f 1//1 2//1 3//1", &["a.obj:8:", "normal index 1"]);
    refused_obj("f 1 2 two", &["a.obj:8:", "\"two\""]);
    refused_obj("f 1/1/1/1 2 3", &["a.obj:8:"]);
    refused_obj("f 1 2 99999999999999999999", &["a.obj:8:"]);
    // A continued line counts from its first line.
    refused_obj("f 1 \\\n2 \\\n9", &["a.obj:8:", "vertex index 9"]);
    refused_obj("usemtl lamp\nf 1 1 2", &["thing", "triangle 1", "zero area", "lamp"]);
    assert_refused(&[("a.obj", "v 0 0 0\n")], "a.obj", &["a.obj", "no triangles"]);
    assert_refused(&[("a.obj", "v 0 0 0\nv 1 1 1\no flat\nf 1 2 1\n")], "a.obj", &["flat", "no triangle"]);
}

#[test]
fn models_without_light_get_a_sky() {
    let dark = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let files = folder(&[
        ("a.obj", dark),
        ("a.toml", "model = \"a.obj\"\n[camera]\neye = [0, -3, 1]\ntarget = [0, 0, 0]\nup = [0, 0, 2]\nfov_y = 40\n"),
    ]);
    let sky = |name: &str| scene::load(&files.path().join(name)).unwrap().environment.unwrap();
    assert_eq!((sky("a.obj").name.as_str(), sky("a.obj").axes[1]), ("overcast sky", Vec3::Y));
    assert!((sky("a.toml").axes[1] - Vec3::Z).length() < 1e-6, "the camera's up is the zenith");
}

#[test]
fn environments_are_read() {
    let model = ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let description = |text: &str| format!("model = \"a.obj\"\n[environment]\n{text}\n");
    let constant = folder(&[model, ("a.toml", &description("radiance = [1, 2, 3]"))]);
    let environment = scene::load(&constant.path().join("a.toml")).unwrap().environment.unwrap();
    assert_eq!(environment.texels, [Vec3::new(1.0, 2.0, 3.0)]);

    let files = folder(&[model, ("a.toml", &description("image = \"sky.exr\"\nradiance = [2, 2, 2]\nrotation = 90"))]);
    let at = |name: &str| files.path().join(name);
    let pixels: Vec<f32> = (0..8 * 4 * 3).map(|i| i as f32).collect();
    let image = image::Rgb32FImage::from_raw(8, 4, pixels).unwrap();
    for name in ["sky.exr", "sky.hdr"] {
        image::DynamicImage::from(image.clone()).save(at(name)).unwrap();
        std::fs::write(at("a.toml"), description(&format!("image = \"{name}\"\nradiance = [2, 2, 2]\nrotation = 90")))
            .unwrap();
        let environment = scene::load(&at("a.toml")).unwrap().environment.unwrap();
        assert_eq!((environment.width, environment.height), (8, 4));
        // Radiance files have eight bits a channel.
        assert!((environment.texels[9] - 2.0 * Vec3::new(27.0, 28.0, 29.0)).abs().max_element() < 0.5, "{name}");
        assert!(
            (environment.radiance(Vec3::new(-1.0, 0.05, -0.1)) - environment.texels[12]).abs().max_element() < 1e-6
        );
    }

    let refused =
        |text: &str, parts: &[&str]| assert_refused(&[model, ("a.toml", &description(text))], "a.toml", parts);
    refused("", &["a.toml:2:", "environment", "image", "radiance"]);
    refused("sun = [0, -5]", &["a.toml:2:", "horizon"]);
    refused("sun = [0, 5]\nturbidity = 20", &["a.toml:2:", "turbidity"]);
    refused("sun = [0, 5]\nimage = \"sky.exr\"", &["a.toml:2:", "excludes"]);
    refused("radiance = [1, -1, 0]", &["a.toml:2:", "negative"]);
    refused("radiance = [1, 1, 1]\nup = [0, 0, 0]", &["a.toml:2:", "up"]);
    refused("image = \"none.exr\"", &["none.exr"]);
    refused("image = \"a.obj\"", &["a.obj", ".exr"]);
    let square = image::Rgb32FImage::from_raw(2, 2, vec![1.0; 12]).unwrap();
    image::DynamicImage::from(square).save(at("sky.exr")).unwrap();
    std::fs::write(at("a.toml"), description("image = \"sky.exr\"")).unwrap();
    let error = scene::load(&at("a.toml")).unwrap_err().to_string();
    assert!(error.contains("sky.exr") && error.contains("twice as many"), "{error}");
    let dark = image::Rgb32FImage::from_raw(2, 1, vec![0.0, 1.0, f32::NAN, 1.0, 1.0, 1.0]).unwrap();
    image::DynamicImage::from(dark).save(at("sky.exr")).unwrap();
    let error = scene::load(&at("a.toml")).unwrap_err().to_string();
    assert!(error.contains("pixel 0,0"), "{error}");
}

#[test]
fn bad_mtl_is_refused() {
    refused_mtl("Kd 1 2", &["m.mtl:3:", "lamp", "Kd"]);
    refused_mtl("Kd a b c", &["m.mtl:3:", "\"a\" is not a number"]);
    refused_mtl("Kd -0.5 0 0", &["m.mtl:3:", "negative"]);
    refused_mtl("Ke nan 0 0", &["m.mtl:3:", "nan"]);
    refused_mtl("Ns -1", &["m.mtl:3:", "Ns"]);
    refused_mtl("illum two", &["m.mtl:3:", "illum"]);
    refused_mtl("map_Kd", &["m.mtl:3:", "map_Kd"]);
    refused_mtl("map_Kd nowhere.png", &["m.mtl:3:", "lamp", "nowhere.png"]);
    // A file that is not an image.
    refused_mtl("map_Kd m.mtl", &["m.mtl:3:", "lamp", "m.mtl"]);
}

#[test]
fn odd_obj_is_accepted() {
    let obj = "mtllib nowhere.mtl m.mtl\r\nv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nv 1 1 0\r\ng a b\r\nusemtl lamp\r\n\
               f 1 2 3\r\nf 1 2\r\nf 1 1 2\r\nl 1 2\r\nusemtl unheard of\r\nf 1 2 4\r\nfoo bar\r\n";
    let mtl = "newmtl lamp\nKe 1\nKd 0\n";
    let folder = folder(&[("m.mtl", mtl), ("a.obj", obj)]);
    // The triangle of zero area has a material that emits.
    assert!(scene::load(&folder.path().join("a.obj")).is_err());
    std::fs::write(folder.path().join("a.obj"), obj.replace("f 1 1 2\r\n", "")).unwrap();
    let scene = scene::load(&folder.path().join("a.obj")).unwrap();
    assert_eq!(scene.triangles.len(), 2);
    assert_eq!(scene.objects, ["a b"]);
    assert_eq!(material(&scene, "unheard of").base_color, Vec3::splat(0.8));
    assert_eq!(material(&scene, "lamp").emission, Vec3::ONE);
    // Triangles of zero area are dropped if they do not emit.
    std::fs::write(folder.path().join("a.obj"), format!("{obj}f 2 2 4\r\n").replace("f 1 1 2\r\n", "")).unwrap();
    assert_eq!(scene::load(&folder.path().join("a.obj")).unwrap().triangles.len(), 2);
}

#[test]
fn missing_and_unknown_files_are_named() {
    assert_refused(&[], "none.obj", &["none.obj", "reading failed"]);
    assert_refused(&[], "none.toml", &["none.toml", "reading failed"]);
    assert_refused(&[], "none.glb", &["none.glb", "reading failed"]);
    assert_refused(&[], "scene.blend", &["scene.blend", "\"blend\"", ".gltf"]);
    refused_description("model = \"b.obj\"\n", &["scene.toml:1:", "b.obj", "does not exist"]);
    refused_description("face_normals = true\n", &["scene.toml", "no `model`"]);
}

#[test]
fn description_is_read() {
    let toml = format!(
        "model = \"a.obj\"\ntwo_sided = true\n{CAMERA}up = [0, 2, 0]\nresolution = [32, 16]\n\
         [render]\npasses = 7\nclip_fraction = 0.1\nmax_specular = 3\nsplit = false\n\
         [materials.lamp]\nemission = [3, 2, 1]\nroughness = 0.25\nsurface = \"mirror\"\n\
         [lights.a_point]\ntype = \"point\"\nposition = [1, 2, 3]\nintensity = [4, 5, 6]\n\
         [lights.b_spot]\ntype = \"spot\"\nposition = [1, 2, 3]\ndirection = [0, -2, 0]\nintensity = [1, 1, 1]\n\
         inner = 30\nouter = 90\n\
         [lights.c_sun]\ntype = \"directional\"\ndirection = [0, 0, -3]\nirradiance = [1, 1, 1]\n\
         [lights.d_ball]\ntype = \"sphere\"\ncenter = [0, 5, 0]\nradius = 0.5\nradiance = [9, 9, 9]\n\
         [lights.e_panel]\ntype = \"quad\"\ncorner = [0, 3, 0]\nedge_u = [2, 0, 0]\nedge_v = [0, 0, 1]\nradiance = [5, 5, 5]\n"
    );
    let scene = with_description(&toml);
    let camera = scene.camera.unwrap();
    assert_eq!((camera.resolution, camera.fov_y), ([32, 16], 40.0));
    assert_eq!(camera.world_from_camera(), (Vec3::X, Vec3::Y, Vec3::NEG_Z));
    assert_eq!((scene.render.passes, scene.render.clip_fraction, scene.render.seed), (Some(7), Some(0.1), None));
    let lamp = material(&scene, "lamp");
    assert_eq!((lamp.emission, lamp.roughness), (Vec3::new(3.0, 2.0, 1.0), 0.25));
    // No other key sets its mirror reflectance, so its base colour does.
    assert_eq!((lamp.surface, lamp.metallic, lamp.two_sided), (Surface::Mirror, 1.0, true));
    assert_eq!((scene.render.max_specular, scene.render.split), (Some(3), Some(false)));
    assert_eq!(scene.lights.len(), 4);
    assert_eq!(
        scene.lights[0],
        Light::Point { position: Vec3::new(1.0, 2.0, 3.0), intensity: Vec3::new(4.0, 5.0, 6.0) }
    );
    let Light::Spot { direction, inner, outer, .. } = scene.lights[1] else { panic!("{:?}", scene.lights[1]) };
    assert_eq!((direction, outer), (Vec3::NEG_Y, PI / 2.0));
    assert!((inner - PI / 6.0).abs() < 1e-6);
    assert_eq!(scene.lights[2], Light::Directional { direction: Vec3::NEG_Z, irradiance: Vec3::ONE });
    let Light::Sphere { object, radius, inward: false, .. } = scene.lights[3] else { panic!("{:?}", scene.lights[3]) };
    assert_eq!((scene.objects[object as usize].as_str(), radius), ("d_ball", 0.5));

    // The sphere's triangles: 1280, facing outwards, with nearly its area, and no emitters of their own.
    let ball: Vec<usize> = (0..scene.triangles.len()).filter(|&i| scene.triangles[i].object == object).collect();
    assert_eq!(ball.len(), 1280);
    let area: f32 = ball.iter().map(|&i| scene.triangle_area(i)).sum();
    assert!((area / (4.0 * PI * 0.25) - 1.0).abs() < 0.01, "{area}");
    for &i in &ball {
        let [a, b, c] = scene.triangle_positions(i);
        assert!((b - a).cross(c - a).dot(a - Vec3::new(0.0, 5.0, 0.0)) > 0.0);
    }
    // The model's triangle and the two of the panel, which faces cross(edge_u, edge_v): downwards.
    let emitters = scene.emitters();
    assert_eq!(emitters.len(), 3);
    for &i in &emitters[1..] {
        let [a, b, c] = scene.triangle_positions(i as usize);
        assert_eq!((b - a).cross(c - a).normalize(), Vec3::NEG_Y);
        assert!((scene.triangle_area(i as usize) - 1.0).abs() < 1e-6);
    }
}

#[test]
fn inward_sphere_faces_its_centre() {
    let toml = "model = \"a.obj\"\n[lights.shell]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 20\nradiance = [1, 1, 1]\n\
                inward = true\n";
    let scene = with_description(toml);
    for i in 1..scene.triangles.len() {
        let [a, b, c] = scene.triangle_positions(i);
        assert!((b - a).cross(c - a).dot(a) < 0.0);
    }
}

#[test]
fn face_normals_are_the_default() {
    let obj = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nusemtl lamp\nf 1//1 2//1 3//1\n";
    for (line, smooth) in [("", false), ("face_normals = true\n", false), ("face_normals = false\n", true)] {
        let toml = format!("model = \"a.obj\"\n{line}");
        let folder = folder(&[("m.mtl", LAMP), ("a.obj", obj), ("scene.toml", &toml)]);
        assert_eq!(scene::load(&folder.path().join("scene.toml")).unwrap().triangles[0].smooth, smooth);
        assert!(scene::load(&folder.path().join("a.obj")).unwrap().triangles[0].smooth);
    }
}

#[test]
fn bad_description_is_refused() {
    let model = "model = \"a.obj\"\n";
    let refused = |rest: &str, parts: &[&str]| refused_description(&format!("{model}{rest}"), parts);
    refused("[camera\n", &["scene.toml:2:"]);
    refused("modle = 3\n", &["scene.toml:2:", "modle"]);
    refused("face_normals = 1\n", &["scene.toml:2:"]);
    refused("[camera]\neye = [0, 0, 1]\ntarget = [0, 0, 0]\nfov_y = 40\nfov_x = 3\n", &["scene.toml:6:", "fov_x"]);
    refused("[camera]\neye = [0, 0, 1]\ntarget = [0, 0, 0]\n", &["scene.toml:2:", "fov_y"]);
    refused("[camera]\neye = [0, 0]\ntarget = [0, 0, 0]\nfov_y = 40\n", &["scene.toml:3:"]);
    refused("[camera]\neye = [0, 0, 0]\ntarget = [0, 0, 0]\nfov_y = 40\n", &["scene.toml:2:", "coincide"]);
    refused("[camera]\neye = [0, 5, 0]\ntarget = [0, 0, 0]\nfov_y = 40\n", &["scene.toml:2:", "parallel"]);
    refused("[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\nfov_y = 180\n", &["scene.toml:2:", "fov_y 180"]);
    refused("[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\nfov_y = nan\n", &["scene.toml:2:", "fov_y"]);
    refused("[camera]\neye = [0, 0, inf]\ntarget = [0, 0, 0]\nfov_y = 4\n", &["scene.toml:2:", "eye"]);
    refused(&format!("{CAMERA}resolution = [0, 5]\n"), &["scene.toml:2:", "resolution 0x5"]);
    refused("[render]\npases = 3\n", &["scene.toml:3:", "pases", "passes"]);
    refused("[render]\npasses = -3\n", &["scene.toml:3:"]);
    refused("[materials.lmap]\nroughness = 1\n", &["scene.toml:2:", "lmap", "\"lamp\""]);
    refused("[materials.lamp]\nroughness = 2\n", &["scene.toml:2:", "lamp", "roughness 2"]);
    refused("[materials.lamp]\nbase_color = [1, 1, 1.5]\n", &["scene.toml:2:", "base_color 1.5"]);
    refused("[materials.lamp]\nemission = [-1, 0, 0]\n", &["scene.toml:2:", "emission"]);
    refused("[materials.lamp]\nruoghness = 1\n", &["scene.toml:3:", "ruoghness"]);
    refused("[materials.lamp]\nthin = 1\n", &["scene.toml:3:"]);
    refused("[materials.lamp]\nsurface = \"shiny\"\n", &["scene.toml:3:", "shiny", "mirror"]);
    refused("[lights.l]\ntype = \"lamp\"\n", &["scene.toml:3:", "lamp", "quad"]);
    refused("[lights.l]\nposition = [0, 0, 0]\n", &["scene.toml:2:", "type"]);
    refused("[lights.l]\ntype = \"point\"\nposition = [0, 0, 0]\n", &["scene.toml:2:", "intensity"]);
    let point = "[lights.l]\ntype = \"point\"\nposition = [0, 0, 0]\n";
    refused(&format!("{point}intensity = [1, -1, 1]\n"), &["scene.toml:2:", "[lights.l]", "intensity"]);
    refused(&format!("{point}intensity = [0, 0, 0]\n"), &["scene.toml:2:", "zero"]);
    refused(&format!("{point}intensity = [1, 1, 1]\nradius = 1\n"), &["scene.toml:2:", "radius"]);
    let spot = "[lights.l]\ntype = \"spot\"\nposition = [0, 0, 0]\ndirection = [0, 1, 0]\nintensity = [1, 1, 1]\n";
    refused(&format!("{spot}inner = 40\nouter = 30\n"), &["scene.toml:2:", "inner", "outer"]);
    refused(&format!("{spot}outer = 91\n"), &["scene.toml:2:", "90"]);
    let sphere = "[lights.l]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradiance = [1, 1, 1]\n";
    refused(&format!("{sphere}radius = 0\n"), &["scene.toml:2:", "radius 0"]);
    let quad = "[lights.l]\ntype = \"quad\"\ncorner = [0, 0, 0]\nedge_u = [1, 0, 0]\nradiance = [1, 1, 1]\n";
    refused(&format!("{quad}edge_v = [2, 0, 0]\n"), &["scene.toml:2:", "span an area"]);
    let sun = "[lights.l]\ntype = \"directional\"\nirradiance = [1, 1, 1]\n";
    refused(&format!("{sun}direction = [0, 0, 0]\n"), &["scene.toml:2:", "no length"]);
}

#[test]
fn mean_albedos_are_what_particles_see() {
    assert_eq!(builtin::furnace(0.3, 1.0).mean_albedos(), [0.3]);
    let mut plates = builtin::facing_plates(1.0);
    let albedo_of_lamp = |plates: &Scene| plates.mean_albedos()[1];
    assert_eq!(plates.mean_albedos(), [0.0, 0.5]);
    plates.materials[1].specular = Vec3::splat(0.2);
    assert!((albedo_of_lamp(&plates) - 0.7).abs() < 1e-6);
    // Particles see only the diffuse base of a mirror, and nothing of glass.
    plates.materials[1].surface = Surface::Mirror;
    assert_eq!(albedo_of_lamp(&plates), 0.5);
    plates.materials[1].surface = Surface::Glass;
    assert_eq!(albedo_of_lamp(&plates), 0.0);
    // A metal reflects its base colour; its dielectric part does not count.
    plates.materials[1].surface = Surface::Opaque;
    plates.materials[1].metallic = 1.0;
    plates.materials[1].specular = Vec3::ONE;
    assert!((albedo_of_lamp(&plates) - 0.5).abs() < 1e-6);
}

#[test]
fn validation_finds_broken_data() {
    let broken = |change: &dyn Fn(&mut Scene), parts: &[&str]| {
        let mut scene = builtin::furnace(0.5, 1.0);
        change(&mut scene);
        let error = scene.validate(Path::new("made")).unwrap_err().to_string();
        assert!(parts.iter().all(|p| error.contains(p)), "{error}");
    };
    broken(&|s| s.triangles[3].vertices[1] = 99, &["made", "\"walls\"", "triangle 3", "vertex 99"]);
    broken(&|s| s.triangles[3].material = 9, &["triangle 3", "material 9"]);
    broken(&|s| s.triangles[3].object = 9, &["triangle 3", "object 9"]);
    broken(&|s| s.positions[0].x = f32::NAN, &["\"walls\"", "vertex 0", "NaN"]);
    broken(&|s| s.uvs[0].x = f32::INFINITY, &["vertex 0", "not finite"]);
    broken(&|s| s.uvs.clear(), &["texture coordinates"]);
    broken(&|s| (s.triangles[0].smooth, s.normals[0]) = (true, Vec3::ZERO), &["unit length"]);
    broken(&|s| s.materials[0].base_texture = Some(0), &["\"wall\"", "texture 0"]);
    broken(&|s| s.materials[0].base_color.y = 1.5, &["\"wall\"", "base_color 1.5"]);
    broken(&|s| s.materials[0].metallic = f32::NAN, &["\"wall\"", "metallic NaN"]);
    broken(&|s| s.materials[0].emission = Vec3::ZERO, &["nothing emits light"]);
    broken(&|s| s.emitters_are_lights = false, &["nothing emits light"]);
    broken(&|s| s.triangles.clear(), &["no triangles"]);
    let light = Light::Sphere { center: Vec3::ZERO, radius: -1.0, radiance: Vec3::ONE, inward: false, object: 0 };
    broken(&|s| s.lights.push(light), &["light 0", "radius -1"]);
}
