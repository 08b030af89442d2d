//! A scene built in memory: a room with a glossy ball, a lamp and a spotlight.
//!
//! ```text
//! cargo run --release --example build_scene -- [IMAGE.png [PASSES]]
//! ```
//!
//! A [`Scene`] is plain data: vertices, triangles, materials, lights. Faces emit from the side from which their vertices run
//! counter-clockwise. [`Scene::validate`] makes the checks that a loader makes.

use std::error::Error;
use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use lightsum::output::{self, Encoding, Metadata};
use lightsum::scene::{Light, Material, Triangle};
use lightsum::{Camera, RenderOptions, Renderer, Scene, Settings};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1);
    let image = arguments.next().map_or_else(|| PathBuf::from("build_scene.png"), PathBuf::from);
    let passes = arguments.next().map_or(Ok(16), |n| n.to_string_lossy().parse::<u32>())?;

    let scene = room()?;
    let camera = scene.camera.ok_or("the room has a camera")?;
    let mut renderer = Renderer::new(scene, camera, Settings::default(), &RenderOptions::default())?;
    for _ in 0..passes {
        renderer.pass()?;
    }
    output::write(&image, &renderer.layers()?, &Metadata::default(), &Encoding::default())?;
    println!("wrote {}", image.display());
    Ok(())
}

/// A room four units wide and deep and three high, y up, in metres.
fn room() -> lightsum::Result<Scene> {
    let mut scene = Scene { name: String::from("room"), ..Scene::default() };
    let white = material(&mut scene, Material { base_color: Vec3::splat(0.7), ..named("white") });
    let blue = material(&mut scene, Material { base_color: Vec3::new(0.2, 0.3, 0.6), ..named("blue") });
    let gold = Material { base_color: Vec3::new(0.9, 0.7, 0.3), metallic: 1.0, roughness: 0.4, ..named("gold") };
    let gold = material(&mut scene, gold);
    // Radiance in W/(m^2 sr).
    let lamp = material(&mut scene, Material { emission: Vec3::splat(12.0), ..named("lamp") });

    let (x, y, z) = (4.0 * Vec3::X, 3.0 * Vec3::Y, 4.0 * Vec3::Z);
    let walls = object(&mut scene, "walls");
    quad(&mut scene, Vec3::ZERO, z, x, white, walls); // floor
    quad(&mut scene, y, x, z, white, walls); // ceiling
    quad(&mut scene, Vec3::ZERO, x, y, white, walls); // back
    quad(&mut scene, Vec3::ZERO, y, z, blue, walls); // left
    quad(&mut scene, x, z, y, white, walls); // right
    let panel = object(&mut scene, "lamp");
    quad(&mut scene, Vec3::new(1.5, 2.98, 1.5), Vec3::X, Vec3::Z, lamp, panel);
    let ball = object(&mut scene, "ball");
    sphere(&mut scene, Vec3::new(1.8, 0.7, 1.4), 0.7, gold, ball);

    scene.lights.push(Light::Spot {
        position: Vec3::new(3.6, 2.6, 3.6),
        direction: Vec3::new(-1.0, -1.2, -1.0).normalize(),
        intensity: Vec3::new(10.0, 8.0, 6.0), // W/sr
        inner: 0.3,
        outer: 0.5,
    });
    scene.camera = Some(Camera {
        eye: Vec3::new(2.0, 1.5, 7.0),
        target: Vec3::new(2.0, 1.3, 0.0),
        up: Vec3::Y,
        fov_y: 40.0,
        resolution: [320, 240],
        aperture: 0.0,
        focus: None,
        shutter: 0.0,
        height: None,
        frustum: None,
    });
    // The path only names the scene in messages.
    scene.validate(Path::new("room"))?;
    Ok(scene)
}

fn named(name: &str) -> Material {
    Material { name: name.to_owned(), ..Material::default() }
}

fn material(scene: &mut Scene, material: Material) -> u32 {
    scene.materials.push(material);
    scene.materials.len() as u32 - 1
}

fn object(scene: &mut Scene, name: &str) -> u32 {
    scene.objects.push(name.to_owned());
    scene.objects.len() as u32 - 1
}

/// A parallelogram; its front is the side to which cross(u, v) points.
fn quad(scene: &mut Scene, corner: Vec3, u: Vec3, v: Vec3, material: u32, object: u32) {
    let normal = u.cross(v).normalize();
    let first = vertices(scene, [corner, corner + u, corner + u + v, corner + v].map(|p| (p, normal)));
    for corners in [[0, 1, 2], [0, 2, 3]] {
        scene.triangles.push(Triangle { vertices: corners.map(|c| first + c), material, object, smooth: false });
    }
}

/// A sphere with smooth normals, by longitude and latitude.
fn sphere(scene: &mut Scene, center: Vec3, radius: f32, material: u32, object: u32) {
    const AROUND: u32 = 32;
    const RINGS: u32 = 16;
    let points = (0..=RINGS).flat_map(|ring| {
        (0..AROUND).map(move |i| {
            let (theta, phi) =
                (std::f32::consts::PI * ring as f32 / RINGS as f32, std::f32::consts::TAU * i as f32 / AROUND as f32);
            let normal = Vec3::new(theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin());
            (center + radius * normal, normal)
        })
    });
    let first = vertices(scene, points);
    for ring in 0..RINGS {
        for i in 0..AROUND {
            let at = |ring: u32, i: u32| first + ring * AROUND + i % AROUND;
            let (a, b, c, d) = (at(ring, i), at(ring + 1, i), at(ring + 1, i + 1), at(ring, i + 1));
            // At the poles one of the two triangles has no area.
            let upper = (ring > 0).then_some([a, b, d]);
            let lower = (ring + 1 < RINGS).then_some([b, c, d]);
            for vertices in upper.into_iter().chain(lower) {
                scene.triangles.push(Triangle { vertices, material, object, smooth: true });
            }
        }
    }
}

/// Appends vertices (position, normal) without texture coordinates; returns the index of the first.
fn vertices(scene: &mut Scene, points: impl IntoIterator<Item = (Vec3, Vec3)>) -> u32 {
    let first = scene.positions.len() as u32;
    for (position, normal) in points {
        scene.positions.push(position);
        scene.normals.push(normal);
        scene.uvs.push(Vec2::ZERO);
    }
    first
}
