//! Scenes in Mitsuba's XML. Expected values are Mitsuba's own (3.9.1) where they are no matter of course.

use std::io::Write;
use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use lightsum::scene::{self, Alpha, Light, Material, Scene, Surface};
use tempfile::TempDir;

fn folder(files: &[(&str, &[u8])]) -> TempDir {
    let folder = TempDir::new().unwrap();
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    folder
}

fn document(inside: &str) -> String {
    format!("<scene version=\"3.0.0\">\n{inside}\n</scene>\n")
}

fn load_beside(inside: &str, files: &[(&str, &[u8])]) -> Result<Scene, String> {
    let text = document(inside);
    let mut all = vec![("a.xml", text.as_bytes())];
    all.extend(files);
    let folder = folder(&all);
    let scene = scene::load(&folder.path().join("a.xml"));
    scene.map_err(|e| e.to_string().replace(&format!("{}/", folder.path().display()), ""))
}

fn load(inside: &str) -> Scene {
    load_beside(inside, &[]).unwrap()
}

/// A square with a BSDF of these properties.
fn material(kind: &str, properties: &str) -> Material {
    surface(&format!("<bsdf type=\"{kind}\">{properties}</bsdf>")).materials[0].clone()
}

fn surface(bsdf: &str) -> Scene {
    load(&format!("<shape type=\"rectangle\">{bsdf}</shape>"))
}

fn published(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/mitsuba").join(name)
}

fn near(a: Vec3, b: [f32; 3], within: f32) -> bool {
    (a - Vec3::from_array(b)).abs().max_element() <= within
}

#[test]
fn the_scenes_of_the_folder_load() {
    let cornell = scene::load(&published("cornell.xml")).unwrap();
    assert_eq!((cornell.triangles.len(), cornell.objects.len()), (12 + 24, 8));
    let lamp = cornell.emitters();
    assert_eq!(lamp.len(), 2);
    for &i in &lamp {
        let [a, b, c] = cornell.triangle_positions(i as usize);
        assert!((b - a).cross(c - a).y < 0.0, "the lamp shines down");
        assert!((cornell.triangle_area(i as usize) - 0.5 * 0.48 * 0.4).abs() < 1e-6);
    }
    let radiance = cornell.materials[cornell.triangles[lamp[0] as usize].material as usize].emission;
    assert!(near(radiance, [20.71, 10.85, 2.77], 0.1), "{radiance}");
    let camera = cornell.camera.unwrap();
    assert_eq!((camera.resolution, camera.aperture), ([128, 128], 0.0));
    assert!((camera.fov_y - 39.3).abs() < 1e-4 && near(camera.target, [0.0, 0.0, 2.9], 1e-6));
    assert_eq!(cornell.cameras[0].name, "front");
    assert_eq!(cornell.render.max_depth, Some(6));
    assert!(cornell.ignored.is_empty(), "{:?}", cornell.ignored);

    let balls = scene::load(&published("balls.xml")).unwrap();
    assert!(balls.environment.is_some() && balls.ignored.is_empty(), "{:?}", balls.ignored);

    let room = scene::load(&published("room.xml")).unwrap();
    assert!(room.ignored.is_empty(), "{:?}", room.ignored);
    let camera = room.camera.unwrap();
    assert!((camera.aperture - 0.08).abs() < 1e-6 && camera.focus == Some(3.6));
    let glass: Vec<&Material> = room.materials.iter().filter(|m| m.surface == Surface::Glass).collect();
    assert_eq!(glass.iter().map(|m| m.thin).collect::<Vec<_>>(), [false, true]);
}

/// The texture coordinates and the normal of a shape's surface where a ray in direction -`n` through `at` meets it.
fn seen(scene: &Scene, at: Vec3, n: Vec3) -> (Vec2, Vec3) {
    for (i, t) in scene.triangles.iter().enumerate() {
        let [a, b, c] = scene.triangle_positions(i);
        let cross = (b - a).cross(c - a);
        let d = cross.dot(n);
        if d <= 0.0 {
            continue;
        }
        let p = at + n * ((a - at).dot(cross) / d);
        let weight = |u: Vec3, v: Vec3| (u - p).cross(v - p).dot(cross) / cross.length_squared();
        let w = [weight(b, c), weight(c, a), weight(a, b)];
        if w.iter().all(|&w| w >= -1e-6) {
            let uv = (0..3).map(|k| scene.uvs[t.vertices[k] as usize] * w[k]).sum();
            return (uv, cross.normalize());
        }
    }
    panic!("nothing at {at} towards {n}");
}

#[test]
fn shapes_have_the_surface_and_texture_coordinates_of_mitsuba() {
    for (kind, at, n, uv) in [
        ("rectangle", [0.3, 0.2, 0.0], Vec3::Z, [0.65, 0.6]),
        ("cube", [0.3, 0.2, 0.0], Vec3::Z, [0.6, 0.65]),
        ("cube", [0.0, 0.3, 0.2], Vec3::X, [0.65, 0.4]),
        ("cube", [0.3, 0.0, 0.2], Vec3::Y, [0.35, 0.4]),
        ("cube", [0.3, 0.2, 0.0], -Vec3::Z, [0.4, 0.65]),
        ("cube", [0.0, 0.3, 0.2], -Vec3::X, [0.65, 0.6]),
        ("cube", [0.3, 0.0, 0.2], -Vec3::Y, [0.6, 0.65]),
        ("disk", [0.3, 0.2, 0.0], Vec3::Z, [0.3606, 0.0936]),
        ("cylinder", [0.0, 0.3, 0.2], Vec3::X, [0.0485, 0.2]),
        ("cylinder", [0.3, 0.0, 0.2], -Vec3::Y, [0.7985, 0.2]),
        ("sphere", [0.0, 0.3, 0.2], Vec3::X, [0.0495, 0.4359]),
        ("sphere", [0.3, 0.2, 0.0], Vec3::Z, [0.0936, 0.1174]),
        ("sphere", [0.3, 0.0, 0.2], -Vec3::Y, [0.7995, 0.4359]),
    ] {
        let scene = load(&format!("<shape type=\"{kind}\"/>"));
        let (found, _) = seen(&scene, Vec3::from_array(at), n);
        assert!((found - Vec2::from_array(uv)).abs().max_element() < 2e-3, "{kind} {n}: {found} {uv:?}");
        let turned = load(&format!("<shape type=\"{kind}\"><boolean name=\"flip_normals\" value=\"true\"/></shape>"));
        for (i, t) in turned.triangles.iter().enumerate() {
            let [a, b, c] = turned.triangle_positions(i);
            let [p, q, r] = scene.triangle_positions(i);
            assert!((b - a).cross(c - a).dot((q - p).cross(r - p)) < 0.0);
            assert_eq!(turned.normals[t.vertices[0] as usize], -scene.normals[t.vertices[0] as usize]);
        }
    }
}

#[test]
fn mirrored_shapes_keep_their_front() {
    for kind in ["rectangle", "disk", "sphere", "cylinder", "cube"] {
        let scene =
            load(&format!("<shape type=\"{kind}\"><transform name=\"to_world\"><scale x=\"-2\"/></transform></shape>"));
        for (i, t) in scene.triangles.iter().enumerate() {
            let [a, b, c] = scene.triangle_positions(i);
            assert!((b - a).cross(c - a).dot(scene.normals[t.vertices[0] as usize]) > 0.0, "{kind}");
        }
    }
}

#[test]
fn transforms_are_put_together_in_order() {
    let scene = load(
        "<shape type=\"sphere\"><point name=\"center\" x=\"1\"/><float name=\"radius\" value=\"0.5\"/>\n\
         <transform name=\"toWorld\"><scale value=\"2\"/><rotate z=\"1\" angle=\"90\"/><translate value=\"1, 2 3\"/>\n\
         <matrix value=\"0 0 1 0 1 0 0 0 0 1 0 0 0 0 0 1\"/></transform></shape>",
    );
    let (low, high) = scene.bounds();
    // (1, 0, 0) -> (2, 0, 0) -> (0, 2, 0) -> (1, 4, 3) -> (3, 1, 4).
    assert!(near(0.5 * (low + high), [3.0, 1.0, 4.0], 1e-4) && near(high - low, [2.0; 3], 2e-3), "{low} {high}");
}

#[test]
fn cameras_have_the_field_of_view_of_mitsuba() {
    let fov = |properties: &str| {
        let film = "<film type=\"hdrfilm\"><integer name=\"width\" value=\"200\"/><integer name=\"height\" value=\"100\"/></film>";
        let sensor = format!("<sensor type=\"perspective\">{properties}{film}</sensor>");
        load(&format!("<shape type=\"cube\"/>{sensor}")).camera.unwrap().fov_y.to_radians()
    };
    let tangent = |degrees: f32| (0.5 * degrees.to_radians()).tan();
    let axis = |name: &str| {
        let axis = format!("<float name=\"fov\" value=\"60\"/><string name=\"fov_axis\" value=\"{name}\"/>");
        (0.5 * fov(&axis)).tan() / tangent(60.0)
    };
    for (name, expected) in [("x", 0.5), ("y", 1.0), ("smaller", 1.0), ("larger", 0.5), ("diagonal", 1.0 / 5f32.sqrt())]
    {
        assert!((axis(name) - expected).abs() < 1e-5, "{name}");
    }
    // 50 mm on a frame of 36 mm by 24 mm.
    let expected = 36f32.hypot(24.0) / 100.0 / 5f32.sqrt();
    assert!(((0.5 * fov("")).tan() - expected).abs() < 1e-5);
}

#[test]
fn orthographic_sensors_see_what_mitsubas_see() {
    let sensor = |scale: &str| {
        let film = "<film type=\"hdrfilm\"><integer name=\"width\" value=\"200\"/><integer name=\"height\" value=\"100\"/></film>";
        let placed = "<lookat origin=\"0, 0, 5\" target=\"0, 0, 0\" up=\"0, 1, 0\"/>";
        let transform = format!("<transform name=\"to_world\">{scale}{placed}</transform>");
        load_beside(&format!("<shape type=\"cube\"/><sensor type=\"orthographic\">{transform}{film}</sensor>"), &[])
    };
    // From -1 to 1 across, as the transform scales it.
    let camera = sensor("<scale value=\"3\"/>").unwrap().camera.unwrap();
    let [half_width, half_height] = camera.half_extents();
    assert!((half_width - 3.0).abs() < 1e-5 && (half_height - 1.5).abs() < 1e-5, "{camera:?}");
    assert!(near(camera.eye, [0.0, 0.0, 5.0], 1e-5) && near(camera.world_from_camera().2, [0.0, 0.0, -1.0], 1e-5));
    assert!(sensor("<scale x=\"3\" y=\"2\" z=\"1\"/>").unwrap_err().to_string().contains("alike"));
}

#[test]
fn materials_are_those_of_mitsuba_as_far_as_ours_go() {
    let m = material("diffuse", "<rgb name=\"reflectance\" value=\"0.1 0.2 0.3\"/>");
    assert!(near(m.base_color, [0.1, 0.2, 0.3], 1e-6) && m.specular == Vec3::ZERO && m.metallic == 0.0);
    assert!(near(material("diffuse", "").base_color, [0.5; 3], 0.0));
    let m = material("conductor", "<string name=\"material\" value=\"Au\"/>");
    assert_eq!((m.surface, m.metallic), (Surface::Mirror, 1.0));
    // Fresnel at normal incidence for 0.143 + 3.983i, 0.3753 + 2.386i, 1.442 + 1.603i.
    assert!(near(m.base_color, [0.967, 0.801, 0.325], 5e-3), "{}", m.base_color);
    assert_eq!(material("conductor", "").base_color, Vec3::ONE);
    let rough = "<string name=\"distribution\" value=\"ggx\"/><float name=\"alpha\" value=\"0.25\"/>";
    let m = material(
        "roughconductor",
        &format!("{rough}<float name=\"eta\" value=\"1.5\"/><float name=\"k\" value=\"0\"/>"),
    );
    assert!(near(m.base_color, [0.04; 3], 1e-6) && m.roughness == 0.5 && m.surface == Surface::Opaque);
    // Alphas of two widths: the greater one lies along u or along v.
    for (u, v, rotation) in [(0.25, 0.0625, 0.0), (0.0625, 0.25, std::f32::consts::FRAC_PI_2)] {
        let alphas = format!("<float name=\"alpha_u\" value=\"{u}\"/><float name=\"alpha_v\" value=\"{v}\"/>");
        let ggx = "<string name=\"distribution\" value=\"ggx\"/>";
        let m = material("roughconductor", &format!("{ggx}{alphas}"));
        assert_eq!((m.roughness, m.anisotropy, m.anisotropy_rotation), (0.25, 0.2f32.sqrt(), rotation));
    }
    let m = material("dielectric", "<float name=\"int_ior\" value=\"1.6\"/><float name=\"ext_ior\" value=\"1\"/>");
    assert!(m.surface == Surface::Glass && !m.thin && (m.ior - 1.6).abs() < 1e-6);
    let m = material("thindielectric", "<string name=\"int_ior\" value=\"bk7\"/>");
    assert!(m.thin && (m.ior - 1.5046 / 1.000277).abs() < 1e-5);
    let m = material(
        "dielectric",
        "<rgb name=\"specular_transmittance\" value=\"0\"/><float name=\"int_ior\" value=\"1.5\"/>",
    );
    assert!(m.surface == Surface::Mirror && m.base_color == Vec3::ZERO && near(m.specular, [0.04; 3], 1e-4));
    let plastic = "<rgb name=\"diffuse_reflectance\" value=\"0.6\"/><float name=\"int_ior\" value=\"1.5\"/>\
                   <float name=\"ext_ior\" value=\"1\"/>";
    let m = material("plastic", plastic);
    assert!(m.surface == Surface::Mirror && near(m.specular, [0.04; 3], 1e-5) && near(m.base_color, [0.6; 3], 1e-6));
    let m = material("plastic", &format!("{plastic}<boolean name=\"nonlinear\" value=\"true\"/>"));
    assert!(near(m.base_color, [0.6 * 0.4037 / (1.0 - 0.6 * 0.5963); 3], 2e-3), "{}", m.base_color);
    let m = material("roughplastic", &format!("{plastic}{rough}"));
    assert!(m.surface == Surface::Opaque && m.roughness == 0.5);
    let m = material("principled", "<float name=\"roughness\" value=\"0.4\"/><float name=\"metallic\" value=\"1\"/>");
    assert!(m.roughness == 0.4 && m.metallic == 1.0 && near(m.base_color, [0.5; 3], 1e-6));
    assert!(near(material("principled", "<float name=\"specular\" value=\"1\"/>").specular, [0.08; 3], 1e-6));
    let inner = "<bsdf type=\"twosided\"><bsdf type=\"diffuse\"/></bsdf>";
    let m = material("mask", &format!("<float name=\"opacity\" value=\"0.25\"/>{inner}"));
    assert_eq!(m.alpha, Alpha::Blend { opacity: 0.25 });
    assert!(
        load_beside("<shape type=\"rectangle\"><bsdf type=\"null\"/></shape><shape type=\"disk\"/>", &[])
            .is_ok_and(|s| s.objects.len() == 1)
    );
}

#[test]
fn left_out_things_are_named_once() {
    let scene = load(
        "<shape type=\"cube\"><bsdf type=\"hair\"/></shape><shape type=\"cube\"><bsdf type=\"hair\"/></shape>\n\
         <shape type=\"hair\"/><emitter type=\"projector\"/><sensor type=\"distant\"/><medium type=\"homogeneous\"/>\n\
         <shape type=\"disk\"><bsdf type=\"bumpmap\"><texture type=\"noise\"/><bsdf type=\"roughdiffuse\"/></bsdf></shape>",
    );
    let expected = [
        "bsdf \"bumpmap\" (the first inside it)",
        "bsdf \"hair\" (grey)",
        "bsdf \"roughdiffuse\" (diffuse)",
        "emitter \"projector\"",
        "participating media",
        "sensor \"distant\"",
        "shape \"hair\"",
    ];
    assert_eq!(scene.ignored, expected);
}

#[test]
fn lights_shine_where_they_should() {
    let scene = load(
        "<shape type=\"cube\"/>\n<emitter type=\"point\"><point name=\"position\" value=\"1, 2, 3\"/>\
         <rgb name=\"intensity\" value=\"4\"/></emitter>\n\
         <emitter type=\"spot\"><transform name=\"to_world\"><lookat origin=\"0,5,0\" target=\"0,0,0\" up=\"1,0,0\"/></transform>\
         </emitter>\n<emitter type=\"directional\"><vector name=\"direction\" x=\"0\" y=\"-2\" z=\"0\"/></emitter>",
    );
    assert_eq!(scene.lights[0], Light::Point { position: Vec3::new(1.0, 2.0, 3.0), intensity: Vec3::splat(4.0) });
    let Light::Spot { position, direction, inner, outer, .. } = scene.lights[1] else { panic!("no spot") };
    assert!(near(position, [0.0, 5.0, 0.0], 0.0) && near(direction, [0.0, -1.0, 0.0], 1e-6));
    assert!((outer.to_degrees() - 20.0).abs() < 1e-4 && inner < outer);
    assert_eq!(scene.lights[2], Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::ONE });
    let ball = load(
        "<shape type=\"sphere\"><transform name=\"to_world\"><scale value=\"2\"/><translate x=\"3\"/></transform>\
         <emitter type=\"area\"><rgb name=\"radiance\" value=\"7\"/></emitter></shape>",
    );
    let Light::Sphere { center, radius, radiance, inward, .. } = ball.lights[0] else { panic!("no sphere") };
    assert!(near(center, [3.0, 0.0, 0.0], 1e-6) && (radius - 2.0).abs() < 1e-6 && radiance.x == 7.0 && !inward);
    assert!(ball.emitters().is_empty(), "the ideal sphere is sampled");
}

#[test]
fn environments_lie_as_in_mitsuba() {
    // Red grows with the column; towards +x the column is a quarter, towards +z a half.
    let mut hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n".to_vec();
    for i in 0..32u8 {
        hdr.extend([i % 8 * 16, 0, 0, 129]);
    }
    let sky =
        "<emitter type=\"envmap\"><string name=\"filename\" value=\"sky.hdr\"/>TURN</emitter><shape type=\"cube\"/>";
    let seen = |turn: &str, d: Vec3| {
        let scene = load_beside(&sky.replace("TURN", turn), &[("sky.hdr", &hdr)]).unwrap();
        scene.environment.unwrap().seen(d).x * 64.0 / 16.0 * 2.0
    };
    let at_middle = seen("", Vec3::Z);
    assert!((seen("", Vec3::X) - at_middle).abs() > 0.1);
    assert!(seen("", Vec3::X) < at_middle && seen("", Vec3::NEG_X) > at_middle);
    let turn = "<transform name=\"to_world\"><rotate y=\"1\" angle=\"90\"/></transform>";
    assert!((seen(turn, Vec3::X) - at_middle).abs() < 1e-4, "a quarter turn takes +z to +x");
    let sun = "<emitter type=\"sunsky\"><vector name=\"sun_direction\" x=\"1\" y=\"2\" z=\"2\"/></emitter><shape type=\"cube\"/>";
    let environment = load(sun).environment.unwrap();
    let towards = Vec3::new(1.0, 2.0, 2.0) / 3.0;
    assert!(environment.radiance(towards).y > 1000.0 * environment.radiance(Vec3::new(1.0, -2.0, 2.0) / 3.0).y);
}

/// A picture of 2x2 texels.
fn picture(texels: [[u8; 3]; 4]) -> Vec<u8> {
    let mut file = b"BM".to_vec();
    let rows: Vec<u8> = [2, 3, 0, 1]
        .iter()
        .enumerate()
        .flat_map(|(i, &t): (usize, &usize)| {
            let [r, g, b] = texels[t];
            let mut bytes = vec![b, g, r];
            if i % 2 == 1 {
                bytes.extend([0, 0]);
            }
            bytes
        })
        .collect();
    file.extend((54 + rows.len() as u32).to_le_bytes());
    file.extend([0; 4]);
    file.extend(54u32.to_le_bytes());
    file.extend(40u32.to_le_bytes());
    file.extend(2i32.to_le_bytes());
    file.extend(2i32.to_le_bytes());
    file.extend([1, 0, 24, 0]);
    file.extend([0; 24]);
    file.extend(rows);
    file
}

#[test]
fn textures_keep_their_place() {
    let image = picture([[255, 0, 0], [0, 255, 0], [0, 0, 255], [128, 128, 255]]);
    let files: &[(&str, &[u8])] = &[("a.bmp", &image)];
    let bitmap = |name: &str, more: &str| {
        format!("<texture name=\"{name}\" type=\"bitmap\"><string name=\"filename\" value=\"a.bmp\"/>{more}</texture>")
    };
    let with = |bsdf: &str| load_beside(&format!("<shape type=\"rectangle\">{bsdf}</shape>"), files).unwrap();
    let map = "<transform name=\"to_uv\"><scale x=\"2\" y=\"3\"/><translate x=\"0.5\"/></transform>";
    let scene = with(&format!("<bsdf type=\"diffuse\">{}</bsdf>", bitmap("reflectance", map)));
    assert_eq!(scene.textures[0].texels[..2], [[255, 0, 0, 255], [0, 255, 0, 255]]);
    assert!(scene.textures[0].srgb && scene.materials[0].base_color == Vec3::ONE);
    let (uv, _) = seen(&scene, Vec3::new(-1.0, 1.0, 0.0), Vec3::Z);
    assert!((uv - Vec2::new(0.5, 3.0)).length() < 1e-5, "{uv}");

    let raw = "<boolean name=\"raw\" value=\"true\"/>";
    let masked = format!("<bsdf type=\"mask\">{}<bsdf type=\"diffuse\"/></bsdf>", bitmap("opacity", raw));
    let scene = with(&masked);
    let alphas: Vec<u8> = scene.textures[0].texels.iter().map(|t| t[3]).collect();
    assert_eq!(alphas, [54, 182, 18, 137], "the luminance of each texel");
    assert_eq!(scene.materials[0].alpha, Alpha::Blend { opacity: 1.0 });

    // On the rectangle v grows upwards with the picture's rows, so that its y is turned.
    let normals = format!("<bsdf type=\"normalmap\">{}<bsdf type=\"diffuse\"/></bsdf>", bitmap("normalmap", raw));
    let scene = with(&normals);
    assert_eq!(scene.textures[0].texels[3], [128, 127, 255, 255]);
    let scene = load_beside(&format!("<shape type=\"cube\">{normals}</shape>"), files).unwrap();
    assert_eq!(scene.textures[0].texels[3], [128, 128, 255, 255]);

    let checks = "<bsdf type=\"diffuse\"><texture name=\"reflectance\" type=\"checkerboard\"/></bsdf>";
    let scene = with(checks);
    let color = |u: f32, v: f32| {
        let texel = lightsum::bsdf::sample_texture(&scene.textures[0], [u, v]).truncate();
        (texel * scene.materials[0].base_color).x
    };
    assert!((color(0.1, 0.1) - 0.4).abs() < 2e-3 && (color(0.6, 0.6) - 0.4).abs() < 2e-3);
    assert!((color(0.6, 0.1) - 0.2).abs() < 2e-3);
}

/// A serialized file of two shapes: a triangle with normals in double precision, and a square.
fn serialized() -> Vec<u8> {
    let packed = |flags: u32, name: &str, numbers: &[u8], faces: &[u32], vertices: u64| {
        let mut data = flags.to_le_bytes().to_vec();
        data.extend(name.as_bytes());
        data.push(0);
        data.extend(vertices.to_le_bytes());
        data.extend((faces.len() as u64 / 3).to_le_bytes());
        data.extend(numbers);
        faces.iter().for_each(|f| data.extend(f.to_le_bytes()));
        let mut shape = vec![0x1c, 0x04, 4, 0];
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        encoder.write_all(&data).unwrap();
        shape.extend(encoder.finish().unwrap());
        shape
    };
    let doubles: Vec<u8> =
        [0.0f64, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
    let floats: Vec<u8> =
        [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.25, 0.0, 1.0]
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
    let mut file = packed(0x2001, "one", &doubles, &[0, 1, 2], 3);
    let second = file.len() as u64;
    file.extend(packed(0x1012, "two", &floats, &[0, 1, 2, 0, 2, 3], 4));
    file.extend(0u64.to_le_bytes());
    file.extend(second.to_le_bytes());
    file.extend(2u32.to_le_bytes());
    file
}

#[test]
fn serialized_shapes_are_read() {
    let file = serialized();
    let shape = |index: u32| {
        format!(
            "<shape type=\"serialized\"><string name=\"filename\" value=\"a.serialized\"/>\
                 <integer name=\"shape_index\" value=\"{index}\"/></shape>"
        )
    };
    let load = |bytes: &[u8], index: u32| load_beside(&shape(index), &[("a.serialized", bytes)]);
    let scene = load(&file, 0).unwrap();
    assert!(scene.triangles.len() == 1 && scene.triangles[0].smooth && scene.normals[0] == Vec3::Z);
    let scene = load(&file, 1).unwrap();
    assert!(scene.triangles.len() == 2 && !scene.triangles[0].smooth);
    assert_eq!(scene.uvs[2], Vec2::new(1.0, 0.25), "v runs downwards");
    assert!(load(&file, 2).unwrap_err().contains("shape 2 does not exist, there are 2"));
    for length in 0..file.len() {
        let _ = load(&file[..length], 1);
    }
    for at in 0..file.len() {
        let mut changed = file.clone();
        changed[at] ^= 0xff;
        let _ = load(&changed, 0);
    }
}

#[test]
fn models_keep_their_normals_and_texture_coordinates() {
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/2\n";
    let shape = |more: &str| format!("<shape type=\"obj\"><string name=\"filename\" value=\"m.obj\"/>{more}</shape>");
    let load = |more: &str| load_beside(&shape(more), &[("m.obj", obj.as_bytes())]).unwrap();
    let scene = load("");
    assert!(scene.triangles.iter().all(|t| t.smooth), "a mesh without normals gets smooth ones");
    let n = scene.normals[0];
    assert!((n - Vec3::new(1.0, 0.0, 1.0).normalize()).length() < 1e-5, "{n}");
    assert_eq!(scene.uvs[2], Vec2::new(0.0, 0.0));
    let scene =
        load("<boolean name=\"face_normals\" value=\"true\"/><boolean name=\"flip_tex_coords\" value=\"false\"/>");
    assert!(scene.triangles.iter().all(|t| !t.smooth) && scene.uvs[2] == Vec2::new(0.0, 1.0));
}

#[test]
fn files_and_parameters_are_put_in() {
    let inner = document(
        "<default name=\"size\" value=\"9\"/><bsdf type=\"diffuse\" id=\"c\"><rgb name=\"reflectance\" value=\"$grey\"/></bsdf>",
    );
    let scene = load_beside(
        "<default name=\"size\" value=\"3\"/><default name=\"grey\" value=\"0.3\"/><include filename=\"b.xml\"/>\n\
         <alias id=\"c\" as=\"d\"/><shape type=\"sphere\"><float name=\"radius\" value=\"$size\"/><ref id=\"d\"/></shape>",
        &[("b.xml", inner.as_bytes())],
    )
    .unwrap();
    assert!((scene.bounds().1.x - 3.0).abs() < 1e-3 && scene.materials[0].base_color == Vec3::splat(0.3));
    let deep =
        (0..40).fold(String::from("<bsdf type=\"diffuse\"/>"), |s, _| format!("<bsdf type=\"twosided\">{s}</bsdf>"));
    let million = "<a>".repeat(200_000);
    let own = document("<include filename=\"a.xml\"/>");
    for (inside, files, reason) in [
        ("<shape type=\"cube\">\n<ref id=\"x\"/></shape>", vec![], "a.xml:3: <ref> \"x\": there is no \"x\""),
        (
            "<shape type=\"sphere\"><float name=\"radius\" value=\"$r\"/></shape>",
            vec![],
            "a.xml:2: parameter $r has no <default>",
        ),
        (
            "\n<shape type=\"sphere\"><float name=\"radius\" value=\"one\"/></shape>",
            vec![],
            "a.xml:3: <float> \"radius\": \"one\" is not",
        ),
        (
            "<shape type=\"sphere\"><float name=\"radius\" value=\"1e99\"/></shape>",
            vec![],
            "1e99 is not a finite number",
        ),
        ("<shape type=\"sphere\"><float name=\"radius\" value=\"-1\"/></shape>", vec![], "must be above 0"),
        (
            "<shape type=\"obj\"><string name=\"filename\" value=\"no.obj\"/></shape>",
            vec![],
            "file no.obj does not exist",
        ),
        ("<include filename=\"no.xml\"/>", vec![], "included file no.xml does not exist"),
        ("<include filename=\"a.xml\"/>", vec![("b.xml", own.as_bytes())], "nested deeper"),
        (
            "<shape type=\"cube\"><transform name=\"to_world\"><scale x=\"0\"/></transform></shape>",
            vec![],
            "cannot be inverted",
        ),
        (
            "<shape type=\"cube\"><transform name=\"to_world\"><matrix value=\"1 2\"/></transform></shape>",
            vec![],
            "16 or 9 numbers",
        ),
        ("<emitter type=\"area\"/>", vec![], "belongs into a shape"),
        ("<shape", vec![], "not well-formed XML"),
        (&deep, vec![], "nested deeper"),
        (&million, vec![], "a.xml"),
        (
            "<bsdf type=\"twosided\" id=\"x\"><ref id=\"x\"/></bsdf><shape type=\"cube\"><ref id=\"x\"/></shape>",
            vec![],
            "within BSDFs",
        ),
        (
            "<shape type=\"cube\"><bsdf type=\"conductor\"><string name=\"material\" value=\"Fe\"/></bsdf></shape>",
            vec![],
            "\"Fe\" is not known",
        ),
        ("<emitter type=\"constant\"/><emitter type=\"constant\"/>", vec![], "a second environment"),
        (
            "<bsdf type=\"diffuse\" id=\"x\"/>\n<shape type=\"cube\" id=\"x\"/>",
            vec![],
            "a.xml:3: <shape> \"x\": another element",
        ),
    ] {
        let message = load_beside(inside, &files).unwrap_err();
        assert!(message.contains(reason), "{message:?} does not say {reason:?}");
    }
    let bomb = "<!DOCTYPE s [<!ENTITY a \"xx\"><!ENTITY b \"&a;&a;\">]>\n<scene version=\"3.0.0\">&b;</scene>";
    let folder = folder(&[("a.xml", bomb.as_bytes())]);
    assert!(scene::load(&folder.path().join("a.xml")).unwrap_err().to_string().contains("DTD"));
}

#[test]
fn a_description_may_name_an_xml_or_a_ply_file() {
    let xml = document("<shape type=\"cube\" id=\"block\"><bsdf type=\"diffuse\" id=\"paint\"/></shape>");
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let toml = "model = \"a.xml\"\n[materials.paint]\nbase_color = [0.1, 0.2, 0.3]\n";
    let folder = folder(&[
        ("a.xml", xml.as_bytes()),
        ("a.ply", ply.as_bytes()),
        ("x.toml", toml.as_bytes()),
        ("p.toml", b"model = \"a.ply\"\n"),
    ]);
    let scene = scene::load(&folder.path().join("x.toml")).unwrap();
    assert!(scene.materials[0].base_color == Vec3::new(0.1, 0.2, 0.3) && scene.objects == ["block"]);
    assert_eq!(scene::load(&folder.path().join("p.toml")).unwrap().triangles.len(), 1);
}

#[test]
fn far_scenes_get_an_origin() {
    let scene = load(
        "<shape type=\"cube\"><transform name=\"to_world\"><translate x=\"1000000\"/></transform></shape>\n\
         <emitter type=\"point\"><point name=\"position\" x=\"1000000\" y=\"3\"/></emitter>\n\
         <sensor type=\"perspective\"><transform name=\"to_world\"><translate x=\"1000000.5\" z=\"9\"/></transform></sensor>",
    );
    assert!(scene.origin.x > 9e5);
    assert_eq!(scene.to_world(scene.camera.unwrap().eye).x, 1_000_000.5);
    let Light::Point { position, .. } = scene.lights[0] else { panic!("no point light") };
    assert_eq!(scene.to_world(position).y, 3.0);
}
