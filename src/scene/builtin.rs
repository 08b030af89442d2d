//! Generated scenes: analytic ones with a known solution, and stress tests.
//!
//! All are valid: [`Scene::validate`] accepts them unchanged (tested).

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use super::tessellate::{icosphere, octasphere};
use super::{Camera, Light, Material, Scene};

fn camera(eye: Vec3, target: Vec3, up: Vec3, fov_y: f32, resolution: [u32; 2]) -> Option<Camera> {
    Some(Camera {
        eye,
        target,
        up,
        fov_y,
        resolution,
        aperture: 0.0,
        focus: None,
        shutter: 0.0,
        height: None,
        frustum: None,
    })
}

fn diffuse(name: &str, reflectance: f32, radiance: f32) -> Material {
    Material {
        name: name.to_string(),
        base_color: Vec3::splat(reflectance),
        emission: Vec3::splat(radiance),
        ..Material::default()
    }
}

fn named(name: &str) -> Scene {
    Scene { name: name.to_string(), ..Scene::default() }
}

/// A closed unit cube seen from inside, of reflectance `rho` and emitted radiance `le` everywhere: after k reflections
/// every radiance is le (1 - rho^(k+1)) / (1 - rho).
pub fn furnace(rho: f32, le: f32) -> Scene {
    let mut scene = named("furnace");
    let material = scene.add_material(diffuse("wall", rho, le));
    let object = scene.add_object("walls");
    scene.add_box(Vec3::ZERO, Vec3::ONE, true, material, object);
    scene.camera = camera(Vec3::new(0.5, 0.5, 0.3), Vec3::new(0.4, 0.45, 1.0), Vec3::Y, 60.0, [32, 32]);
    scene
}

/// A unit sphere seen from inside whose octant o (bit 0: x < 0, bit 1: y < 0, bit 2: z < 0) has the emitted radiosity and
/// reflectance `patches[o]`, of 8 * 4^subdivisions triangles.
///
/// For the sphere, every form factor is the shading point's share of the area, so the radiosity of patch i is
/// E_i + rho_i (sum_j E_j / 8) / (1 - sum_j rho_j / 8); the tessellation approaches it.
pub fn sphere_enclosure(subdivisions: u32, patches: &[(f32, f32); 8]) -> Scene {
    let mut scene = named("sphere_enclosure");
    let (points, mut faces) = octasphere(subdivisions);
    faces.iter_mut().for_each(|f| f.swap(1, 2));
    let object = scene.add_object("sphere");
    scene.add_mesh(&points, &faces, 0, object);
    for (octant, &(exitance, rho)) in patches.iter().enumerate() {
        scene.add_material(diffuse(&format!("octant {octant}"), rho, exitance / PI));
    }
    // The triangles of one octant follow each other.
    let run = faces.len() / patches.len();
    for (i, triangle) in scene.triangles.iter_mut().enumerate() {
        triangle.material = (i / run) as u32;
    }
    scene.camera = camera(Vec3::ZERO, Vec3::new(0.2, 0.3, 1.0), Vec3::Y, 90.0, [32, 32]);
    scene
}

/// pbrt's test: a unit sphere seen from inside, reflectance 1/2, with `n` point lights of intensity pi / n at its centre,
/// as 1280 triangles. Radiance 1 - 2^-k after k reflections, 1 in the limit, up to the error of the tessellation.
pub fn sphere_point_lights(n: u32) -> Scene {
    let mut scene = named("sphere_point_lights");
    let (points, mut faces) = icosphere(3);
    faces.iter_mut().for_each(|f| f.swap(1, 2));
    let material = scene.add_material(diffuse("sphere", 0.5, 0.0));
    let object = scene.add_object("sphere");
    scene.add_mesh(&points, &faces, material, object);
    let light = Light::Point { position: Vec3::ZERO, intensity: Vec3::splat(PI / n as f32) };
    scene.lights = vec![light; n as usize];
    scene.camera = camera(Vec3::ZERO, Vec3::Z, Vec3::Y, 45.0, [10, 10]);
    scene
}

/// Two unit squares facing each other: a black one at y = 0 that emits radiance 1 upwards, and above it at y = `gap` one of
/// reflectance 1/2. The camera looks up from just above the emitter; the shading point fills the image.
pub fn facing_plates(gap: f32) -> Scene {
    let mut scene = named("facing_plates");
    let emitter = scene.add_material(diffuse("emitter", 0.0, 1.0));
    let receiver = scene.add_material(diffuse("receiver", 0.5, 0.0));
    let object = scene.add_object("emitter");
    scene.add_quad(Vec3::ZERO, Vec3::Z, Vec3::X, emitter, object);
    let object = scene.add_object("receiver");
    scene.add_quad(Vec3::Y * gap, Vec3::X, Vec3::Z, receiver, object);
    let eye = Vec3::new(0.5, 0.05 * gap, 0.5);
    let fov_y = 2.0 * (0.49 / (0.95 * gap)).atan().to_degrees();
    scene.camera = camera(eye, Vec3::new(0.5, gap, 0.5), Vec3::Z, fov_y, [32, 32]);
    scene
}

/// A closed room of about `n` triangles (at least some hundreds): tables with spheres on them, lit by one area light.
/// The same n gives the same room.
pub fn room(n: u32) -> Scene {
    let mut scene = named("room");
    let materials: Vec<u32> = [("wall", 0.7), ("floor", 0.4), ("wood", 0.5), ("ball", 0.6)]
        .into_iter()
        .map(|(name, rho)| scene.add_material(diffuse(name, rho, 0.0)))
        .collect();
    let [wall, floor, wood, ball] = [materials[0], materials[1], materials[2], materials[3]];
    let lamp = scene.add_material(diffuse("lamp", 0.0, 20.0));
    let size = Vec3::new(8.0, 3.0, 6.0);
    let object = scene.add_object("walls");
    scene.add_box(Vec3::ZERO, size, true, wall, object);
    // The fifth and sixth triangles of a box are its face of minimum y.
    let first = 4;
    scene.triangles[first..first + 2].iter_mut().for_each(|t| t.material = floor);
    let object = scene.add_object("lamp");
    scene.add_quad(Vec3::new(3.0, 2.95, 2.0), Vec3::X * 2.0, Vec3::Z * 2.0, lamp, object);

    // Finer spheres rather than ever more tables.
    const TABLES: [usize; 2] = [4, 3];
    let tables = (TABLES[0] * TABLES[1]) as u32;
    let subdivisions = (0..7).take_while(|&s| tables * (60 + 20 * 4u32.pow(s)) <= n).last().unwrap_or(0);
    let (sphere, faces) = icosphere(subdivisions);
    let spheres = (n / tables).saturating_sub(60) / faces.len() as u32;
    let mut random = Hash(0x9e37_79b9);
    for table in 0..tables {
        let (i, j) = (table as usize % TABLES[0], table as usize / TABLES[0]);
        let corner = Vec3::new(0.6 + 1.85 * i as f32, 0.0, 0.6 + 1.75 * j as f32);
        let object = scene.add_object(format!("table {table}"));
        let top = corner + Vec3::new(0.0, 0.75, 0.0);
        scene.add_box(top, top + Vec3::new(1.2, 0.04, 0.8), false, wood, object);
        for leg in [[0.02, 0.02], [1.13, 0.02], [0.02, 0.73], [1.13, 0.73]] {
            let foot = corner + Vec3::new(leg[0], 0.0, leg[1]);
            scene.add_box(foot, foot + Vec3::new(0.05, 0.75, 0.05), false, wood, object);
        }
        let object = scene.add_object(format!("spheres {table}"));
        for _ in 0..spheres.max(1) {
            let radius = 0.02 + 0.06 * random.next();
            let place = Vec3::new(0.1 + random.next(), 0.04 + radius, 0.1 + 0.6 * random.next());
            let points: Vec<Vec3> = sphere.iter().map(|p| top + place + radius * *p).collect();
            scene.add_mesh(&points, &faces, ball, object);
        }
    }
    scene.camera = camera(Vec3::new(0.3, 1.7, 5.7), Vec3::new(5.0, 0.8, 2.0), Vec3::Y, 60.0, [64, 48]);
    scene
}

/// `n` long, thin triangles that cross at the centre of a box with an area light: their bounding boxes overlap nearly everywhere,
/// so a ray visits most of any hierarchy.
pub fn deep_scene(n: u32) -> Scene {
    let mut scene = named("deep_scene");
    let wall = scene.add_material(diffuse("wall", 0.6, 0.0));
    let needle = scene.add_material(diffuse("needle", 0.5, 0.0));
    let lamp = scene.add_material(diffuse("lamp", 0.0, 5.0));
    let object = scene.add_object("walls");
    scene.add_box(Vec3::splat(-2.0), Vec3::splat(2.0), true, wall, object);
    let object = scene.add_object("lamp");
    scene.add_quad(Vec3::new(-0.5, 1.99, -0.5), Vec3::X, Vec3::Z, lamp, object);
    let object = scene.add_object("needles");
    let mut random = Hash(0x1234_5678);
    let mut points = Vec::new();
    for _ in 0..n {
        let (z, phi) = (1.0 - 2.0 * random.next(), TAU * random.next());
        let direction = Vec3::new((1.0 - z * z).sqrt() * phi.cos(), (1.0 - z * z).sqrt() * phi.sin(), z);
        let centre = (Vec3::new(random.next(), random.next(), random.next()) - 0.5) * 0.5;
        let side = direction.any_orthonormal_vector() * 0.004;
        points.extend([centre - direction * 1.5 - side, centre - direction * 1.5 + side, centre + direction * 1.5]);
    }
    let faces: Vec<[u32; 3]> = (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    scene.add_mesh(&points, &faces, needle, object);
    scene.camera = camera(Vec3::new(0.0, 0.0, -1.9), Vec3::ZERO, Vec3::Y, 70.0, [32, 32]);
    scene
}

/// A floor of reflectance 1/2, four units square at y = 0, and one triangle at y = 1 with corners (0, 0), (1, 0), (0, 1) in x and
/// z that emits radiance 1 downwards: the minimal scene lit by a triangle.
pub fn single_triangle_light() -> Scene {
    let mut scene = named("single_triangle_light");
    let floor = scene.add_material(diffuse("floor", 0.5, 0.0));
    let lamp = scene.add_material(diffuse("lamp", 0.0, 1.0));
    let object = scene.add_object("floor");
    scene.add_quad(Vec3::new(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, floor, object);
    let object = scene.add_object("lamp");
    scene.add_mesh(&[Vec3::Y, Vec3::Y + Vec3::X, Vec3::Y + Vec3::Z], &[[0, 1, 2]], lamp, object);
    scene.camera = camera(Vec3::new(0.5, 1.5, -2.0), Vec3::new(0.2, 0.0, 0.3), Vec3::Y, 50.0, [32, 32]);
    scene
}

/// A small generator of reproducible numbers in [0, 1) (a Weyl sequence through a finaliser).
struct Hash(u32);

impl Hash {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9);
        let mut x = self.0;
        x = (x ^ x >> 16).wrapping_mul(0x21f0_aaad);
        x = (x ^ x >> 15).wrapping_mul(0x735a_2d97);
        // 24 bits, all that a single-precision number below 1 holds.
        ((x ^ x >> 15) >> 8) as f32 / 16_777_216.0
    }
}
