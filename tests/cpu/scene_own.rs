//! The scenes of this repository, and the generated ones.

use std::f32::consts::PI;
use std::path::Path;

use glam::Vec3;
use lightsum::scene::{self, Scene, Surface, builtin};

use crate::scene::{material, repository};

#[test]
fn own_scenes_load() {
    let mut names: Vec<String> = std::fs::read_dir(repository("scenes"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        // Files in Mitsuba's format have tests of their own.
        .filter(|name| name != "mitsuba")
        .collect();
    names.sort();
    let triangles = [
        ("balls-and-sheets", 3762),
        ("brushed-metal", 394),
        ("chequered-ball", 1092),
        ("cornell", 32),
        ("frosted-pane", 312),
        ("furnace", 12),
        ("glass-ball", 800),
        ("glossy-balls", 18_256),
        ("glossy-box", 34),
        ("glossy-floor", 4068),
        ("indirect-room", 9436),
        ("keller-room", 804),
        ("measured-lobes", 2890),
        ("outdoors", 6734),
        ("plates", 4),
        ("six-rooms", 140_812),
    ];
    assert_eq!(names, triangles.map(|(name, _)| name));
    for (name, triangles) in triangles {
        let scene = scene::load(&repository(&format!("scenes/{name}/scene.toml"))).unwrap();
        assert_eq!(scene.triangles.len(), triangles, "{name}");
        assert_eq!(scene.name, name);
        assert!(scene.camera.is_some() && (scene.environment.is_some() || !scene.emitters().is_empty()));
        let readme = std::fs::read_to_string(repository(&format!("scenes/{name}/README.md"))).unwrap();
        assert!(readme.contains("Licence"), "{name}");
    }
}

#[test]
fn cornell_box_is_cornells() {
    let scene = scene::load(&repository("scenes/cornell/scene.toml")).unwrap();
    assert_eq!((scene.triangles.len(), scene.materials.len(), scene.objects.len()), (32, 4, 8));
    assert_eq!(scene.bounds(), (Vec3::ZERO, Vec3::new(556.0, 548.8, 559.2)));
    let emitters = scene.emitters();
    assert_eq!(emitters.len(), 2);
    let area: f32 = emitters.iter().map(|&i| scene.triangle_area(i as usize)).sum();
    assert!((area - 130.0 * 105.0).abs() < 0.1, "{area}");
    assert_eq!(material(&scene, "light").emission, Vec3::new(18.387, 13.9873, 6.75357));
    // Blocks face outwards, walls and lamp into the room.
    for (i, t) in scene.triangles.iter().enumerate() {
        let [a, b, c] = scene.triangle_positions(i);
        let outward = (b - a).cross(c - a);
        let centre = match scene.objects[t.object as usize].as_str() {
            "short_block" => Vec3::new(186.0, 80.0, 169.0),
            "tall_block" => Vec3::new(368.0, 160.0, 351.0),
            _ => Vec3::new(278.0, 274.0, 280.0),
        };
        let block = scene.objects[t.object as usize].ends_with("block");
        assert_eq!(outward.dot((a + b + c) / 3.0 - centre) > 0.0, block, "{}", scene.objects[t.object as usize]);
    }
}

#[test]
fn keller_room_has_402_quads() {
    let scene = scene::load(&repository("scenes/keller-room/scene.toml")).unwrap();
    assert_eq!(scene.triangles.len(), 2 * 402);
    assert_eq!(scene.camera.unwrap().resolution, [720, 576]);
    assert_eq!(scene.emitters().len(), 2);
    let obj = std::fs::read_to_string(repository("scenes/keller-room/room.obj")).unwrap();
    let quads = obj.lines().filter(|l| l.starts_with("f ")).map(|l| l.split_whitespace().count() - 1);
    assert_eq!(quads.filter(|&n| n == 4).count(), 402);
}

#[test]
fn the_glass_ball_is_a_body_in_a_room_of_800_triangles() {
    let scene = scene::load(&repository("scenes/glass-ball/scene.toml")).unwrap();
    assert_eq!((scene.triangles.len(), scene.emitters().len()), (800, 2));
    let (glass, mirror) = (material(&scene, "glass"), material(&scene, "mirror"));
    assert_eq!((glass.surface, glass.thin, mirror.surface), (Surface::Glass, false, Surface::Mirror));
    // Only the ball is smooth; it is closed and faces outwards.
    let mut ball = scene.clone();
    ball.triangles.retain(|t| t.smooth);
    assert_eq!(ball.triangles.len(), 672);
    assert!(ball.triangles.iter().all(|t| std::ptr::eq(&scene.materials[t.material as usize], glass)));
    let sphere = 4.0 / 3.0 * PI * 0.25f32.powi(3);
    assert!((volume(&ball) / sphere - 1.0).abs() < 0.05, "{} of {sphere}", volume(&ball));
}

#[test]
fn the_frosted_pane_is_the_only_reflector_of_its_room() {
    let scene = scene::load(&repository("scenes/frosted-pane/scene.toml")).unwrap();
    let reflectors = scene.reflectors();
    assert_eq!(reflectors.len(), 1);
    let material = &scene.materials[reflectors[0].material as usize];
    assert_eq!((material.name.as_str(), material.frost, reflectors[0].pane), ("pane", 0.4, true));
    assert_eq!((reflectors[0].normal, reflectors[0].offset), (Vec3::Z, 0.0));
}

#[test]
fn the_glossy_floor_is_the_only_reflector_of_its_room() {
    let scene = scene::load(&repository("scenes/glossy-floor/scene.toml")).unwrap();
    let reflectors = scene.reflectors();
    assert_eq!(reflectors.len(), 1);
    assert_eq!(scene.materials[reflectors[0].material as usize].name, "floor");
    assert_eq!((reflectors[0].normal, reflectors[0].offset), (Vec3::Y, 0.0));
    assert_smooth_normals_agree(&scene);
}

#[test]
fn the_chequered_room_has_a_curved_reflector() {
    let scene = scene::load(&repository("scenes/chequered-ball/scene.toml")).unwrap();
    let reflectors = scene.reflectors();
    assert_eq!((reflectors.len(), reflectors[0].curved, reflectors[0].triangles.len()), (1, true, 728));
    assert_smooth_normals_agree(&scene);
}

#[test]
fn the_house_has_five_reflectors_of_different_roughness() {
    let scene = scene::load(&repository("scenes/six-rooms/scene.toml")).unwrap();
    let reflectors = scene.reflectors();
    let mut found: Vec<(&str, f32)> = reflectors
        .iter()
        .map(|r| &scene.materials[r.material as usize])
        .map(|m| (m.name.as_str(), m.roughness))
        .collect();
    found.sort_by(|a, b| a.0.cmp(b.0));
    let expected = [
        ("reflector_1", 0.2),
        ("reflector_2", 0.3),
        ("reflector_3", 0.15),
        ("reflector_4", 0.1),
        ("reflector_5", 0.25),
    ];
    assert_eq!(found, expected);
    // One lamp of two triangles below each ceiling.
    let lamps = scene.emitters();
    let ceilings = lamps.iter().filter(|&&i| {
        let t = scene.triangles[i as usize];
        scene.materials[t.material as usize].name == "ceiling_light"
    });
    assert_eq!(ceilings.count(), 2 * 6);
    assert_smooth_normals_agree(&scene);
}

/// Checks that normals of smooth triangles are on the triangles' front side.
fn assert_smooth_normals_agree(scene: &Scene) {
    for (i, t) in scene.triangles.iter().enumerate().filter(|(_, t)| t.smooth) {
        let [a, b, c] = scene.triangle_positions(i);
        let face = (b - a).cross(c - a).normalize();
        for v in t.vertices {
            let normal = scene.normals[v as usize];
            assert!(face.dot(normal) > 0.3, "{}: {face} {normal}", scene.objects[t.object as usize]);
        }
    }
}

/// Signed volume by the divergence theorem: negative if a closed surface faces inwards.
fn volume(scene: &Scene) -> f32 {
    (0..scene.triangles.len())
        .map(|i| {
            let [a, b, c] = scene.triangle_positions(i);
            a.dot(b.cross(c)) / 6.0
        })
        .sum()
}

#[test]
fn generated_scenes_are_valid() {
    let patches = [(1.0, 0.1), (0.0, 0.2), (2.0, 0.3), (0.0, 0.4), (0.5, 0.5), (0.0, 0.6), (0.0, 0.7), (3.0, 0.8)];
    let scenes = [
        builtin::furnace(0.5, 1.0),
        builtin::sphere_enclosure(4, &patches),
        builtin::sphere_point_lights(1),
        builtin::sphere_point_lights(4),
        builtin::facing_plates(0.5),
        builtin::room(20_000),
        builtin::deep_scene(1000),
        builtin::single_triangle_light(),
    ];
    for mut scene in scenes {
        let triangles = scene.triangles.len();
        scene.validate(Path::new(&scene.name.clone())).unwrap();
        assert_eq!(scene.triangles.len(), triangles, "{} has triangles of no area", scene.name);
        assert!(scene.camera.is_some(), "{}", scene.name);
    }
    // Closed and seen from inside.
    assert!((volume(&builtin::furnace(0.5, 1.0)) + 1.0).abs() < 1e-5);
    assert!((volume(&scene::load(&repository("scenes/furnace/scene.toml")).unwrap()) + 1.0).abs() < 1e-5);
    assert!((volume(&builtin::sphere_enclosure(5, &patches)) / (-4.0 / 3.0 * PI) - 1.0).abs() < 0.01);

    let enclosure = builtin::sphere_enclosure(4, &patches);
    assert_eq!(enclosure.triangles.len(), 8 * 256);
    for (i, t) in enclosure.triangles.iter().enumerate() {
        let centre: Vec3 = enclosure.triangle_positions(i).into_iter().sum();
        let octant = u32::from(centre.x < 0.0) | u32::from(centre.y < 0.0) << 1 | u32::from(centre.z < 0.0) << 2;
        assert_eq!(t.material, octant);
    }
    assert!((enclosure.materials[7].emission.x * PI - 3.0).abs() < 1e-6);

    let plates = builtin::facing_plates(0.5);
    let normal = |i: usize| {
        let [a, b, c] = plates.triangle_positions(i);
        (b - a).cross(c - a).normalize()
    };
    assert_eq!((normal(0), normal(2)), (Vec3::Y, Vec3::NEG_Y));
    for n in [2_000, 20_000, 200_000] {
        let triangles = builtin::room(n).triangles.len() as f32;
        assert!((triangles / n as f32 - 1.0).abs() < 0.35, "{n}: {triangles}");
    }
    let (a, b) = (builtin::room(3_000), builtin::room(3_000));
    assert_eq!(a.positions, b.positions);
    assert_eq!(builtin::deep_scene(1000).triangles.len(), 1014);
}

#[test]
fn descriptions_are_read_as_editors_write_them() {
    let folder = tempfile::tempdir().unwrap();
    let model = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl lampe\nf 1 2 3 # a comment\n";
    std::fs::write(folder.path().join("m.obj"), model).unwrap();
    std::fs::write(folder.path().join("m.mtl"), "newmtl lampe\nKe 1 1 1\n").unwrap();
    let plain = "model = \"m.obj\"\n[materials.lampe]\nroughness = 0.5\n";
    for text in [
        plain.to_string(),
        format!("\u{feff}{plain}"),
        plain.replace('\n', "\r\n"),
        plain.replace(' ', "\t"),
        format!("\u{feff}{}", plain.replace('\n', " # a comment\r\n")),
    ] {
        std::fs::write(folder.path().join("scene.toml"), &text).unwrap();
        let scene = scene::load(&folder.path().join("scene.toml")).unwrap_or_else(|e| panic!("{text:?}: {e}"));
        assert_eq!(material(&scene, "lampe").roughness, 0.5, "{text:?}");
    }
}
