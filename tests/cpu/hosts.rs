//! Promises to hosts that need no device: types that may go to other threads, scenes built in memory.

use lightsum::glam::{Affine3A, Quat, Vec2, Vec3};
use lightsum::scene::{Light, Material, Mesh, SceneBuilder, Texture, Wrap};

/// Types that a host moves to another thread, or reads on several.
#[test]
fn a_host_may_use_any_thread() {
    fn check<T: Send + Sync>() {}
    check::<lightsum::Context>();
    check::<lightsum::Engine>();
    check::<lightsum::Renderer>();
    check::<lightsum::Scene>();
    check::<lightsum::Settings>();
    check::<lightsum::View>();
    check::<lightsum::Error>();
    check::<SceneBuilder>();
    check::<lightsum::film::Film>();
    check::<lightsum::film::HostFilm>();
    check::<lightsum::gpu::Buffer>();
    check::<lightsum::gpu::Image>();
    check::<lightsum::gpu::Retained>();
    check::<lightsum::gpu::Staging>();
    check::<lightsum::pass::display::Display>();
}

/// A square in the plane y = 0 whose front looks up.
fn square() -> Mesh {
    let corners = [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]].map(|[x, z]| Vec3::new(x, 0.0, z));
    let mut mesh = Mesh::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]]);
    mesh.normals = vec![Vec3::Y; 4];
    mesh
}

fn lamp() -> Material {
    Material { name: String::from("lamp"), emission: Vec3::ONE, ..Material::default() }
}

#[test]
fn a_scene_is_built_object_by_object() {
    let mut builder = SceneBuilder::new("plates");
    let white = builder.material(Material { name: String::from("white"), ..Material::default() }).unwrap();
    let light = builder.material(lamp()).unwrap();
    let turned = Affine3A::from_rotation_translation(Quat::from_rotation_x(1.0), Vec3::new(1.0, 2.0, 3.0));
    let mirrored = Affine3A::from_scale(Vec3::new(1.0, -2.0, 1.0));
    let mut coloured = square();
    coloured.colors = vec![Vec3::new(0.1, 0.2, 0.3); 4];
    for (name, mesh, material, transform) in [
        ("floor", square(), white, Affine3A::IDENTITY),
        ("turned", coloured, white, turned),
        ("ceiling", square(), light, Affine3A::from_translation(Vec3::Y) * mirrored),
        ("turned ceiling", square(), light, turned * mirrored),
    ] {
        builder.object(name, &mesh, material, transform).unwrap();
    }
    let scene = builder.build().unwrap();
    assert_eq!(scene.objects, ["floor", "turned", "ceiling", "turned ceiling"]);
    assert_eq!((scene.colors[0], scene.colors[5]), (Vec3::ONE, Vec3::new(0.1, 0.2, 0.3)));
    let up = turned.transform_vector3(Vec3::Y);
    for (object, front) in [Vec3::Y, up, -Vec3::Y, -up].into_iter().enumerate() {
        for (i, triangle) in scene.triangles.iter().enumerate().filter(|(_, t)| t.object as usize == object) {
            let [a, b, c] = scene.triangle_positions(i);
            let face = (b - a).cross(c - a).normalize();
            assert!(face.distance(front) < 1e-6, "face of {object}: {face} for {front}");
            for v in triangle.vertices {
                let normal = scene.normals[v as usize];
                assert!(normal.distance(front) < 1e-6, "normal of {object}: {normal} for {front}");
            }
        }
    }
}

#[test]
fn errors_of_a_builder_name_what_is_wrong() {
    let mut builder = SceneBuilder::new("plates");
    let white = builder.material(Material { name: String::from("white"), ..Material::default() }).unwrap();
    let light = builder.material(lamp()).unwrap();
    let still = Affine3A::IDENTITY;
    let but = |change: fn(&mut Mesh)| {
        let mut mesh = square();
        change(&mut mesh);
        mesh
    };
    let flat = Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0));
    for (mesh, material, transform, part) in [
        (but(|m| m.triangles[1][2] = 17), white, still, "triangle 1: vertex 17 does not exist, there are 4"),
        (but(|m| m.triangles.clear()), white, still, "it has no triangles"),
        (but(|m| m.positions[2].y = f32::NAN), white, still, "vertex 2 is at"),
        (but(|m| m.normals[1] = Vec3::ONE), white, still, "normal [1, 1, 1] of vertex 1 is not of unit length"),
        (but(|m| m.normals.truncate(3)), white, still, "4 positions and 3 normals"),
        (but(|m| m.uvs = vec![Vec2::INFINITY; 4]), white, still, "texture coordinate [inf, inf] is not finite"),
        (but(|m| m.colors = vec![Vec3::splat(2.0); 4]), white, still, "the colour of vertex 0"),
        (but(|m| m.positions = vec![Vec3::ONE; 4]), white, still, "no triangle has an area"),
        (but(|m| m.triangles.push([0, 0, 1])), light, still, "1 triangles without area cannot emit"),
        (square(), 2, still, "material 2 does not exist, there are 2"),
        (square(), white, flat, "without volume"),
        (square(), white, Affine3A::from_translation(Vec3::splat(f32::INFINITY)), "not finite"),
    ] {
        let error = builder.object("plate", &mesh, material, transform).unwrap_err().to_string();
        assert!(error.starts_with("scene: object \"plate\": ") && error.contains(part), "{part}: {error}");
    }
    let wrong = Material { roughness: 2.0, ..lamp() };
    assert!(builder.material(wrong).unwrap_err().to_string().contains("material \"lamp\": roughness 2"));
    let untextured = Material { base_texture: Some(0), ..lamp() };
    assert!(builder.material(untextured).unwrap_err().to_string().contains("texture 0 does not exist, there are 0"));
    let (texels, wrap) = (vec![[0; 4]; 3], [Wrap::Repeat; 2]);
    let texture = Texture { name: String::from("brick"), width: 2, height: 2, texels, srgb: true, wrap };
    assert!(builder.texture(texture).unwrap_err().to_string().contains("texture \"brick\""));
    let point = Light::Point { position: Vec3::NAN, intensity: Vec3::ONE };
    assert!(builder.light(point).unwrap_err().to_string().contains("light 0: position"));

    // Nothing of what was refused is in the scene.
    let empty = builder.clone().build().unwrap_err().to_string();
    assert!(empty.contains("\"plates\": no triangles"), "{empty}");
    builder.object("floor", &square(), white, still).unwrap();
    let dark = builder.clone().build().unwrap_err().to_string();
    assert!(dark.contains("\"plates\": nothing emits light"), "{dark}");
    builder.object("lamp", &square(), light, Affine3A::from_translation(Vec3::Y)).unwrap();
    assert_eq!(builder.build().unwrap().triangles.len(), 4);
}

/// Numbers of docs/embedding.md.
#[test]
fn the_documentation_tells_the_limits_and_sizes() {
    let page = include_str!("../../docs/embedding.md");
    let most = lightsum::gpu::shaders::ALL.iter().map(|shader| shader.storage_buffers()).max().unwrap();
    assert!(page.contains(&format!("A kernel binds up to {most} storage buffers;")), "{most} storage buffers");
    let light = size_of::<lightsum::pass::layout::PointLight>();
    assert!(page.contains(&format!("`PointLight`, {light} bytes")), "{light} bytes");
    // As the snippets declare it.
    for snippet in [
        include_str!("../../examples/shaders/virtual_lights.wgsl"),
        include_str!("../../examples/shaders/virtual_lights.glsl"),
    ] {
        let members = snippet.split("struct PointLight {").nth(1).unwrap().split('}').next().unwrap();
        assert_eq!(16 * members.matches("vec4").count(), light);
    }
}
