//! Scenes, cameras and measures shared by the tests of whole images.

use glam::{DVec3, Vec2, Vec3};
use lightsum::gpu::Context;
use lightsum::output::Layers;
use lightsum::scene::{Camera, Material, Scene, Triangle};
use lightsum::settings::{Clip, Compensation, Settings};
use lightsum::standalone::Renderer;

use crate::support::unwatched;

/// A scene under construction.
pub struct Soup(pub Scene);

impl Soup {
    pub fn new(name: &str) -> Soup {
        Soup(Scene { name: name.to_owned(), objects: vec![String::from("all")], ..Scene::default() })
    }

    pub fn material(&mut self, material: Material) -> u32 {
        self.0.materials.push(material);
        self.0.materials.len() as u32 - 1
    }

    pub fn diffuse(&mut self, albedo: impl Into<Color>, emission: impl Into<Color>) -> u32 {
        let (base_color, emission) = (albedo.into().0, emission.into().0);
        self.material(Material { base_color, emission, ..Material::default() })
    }

    pub fn triangle(&mut self, corners: [Vec3; 3], normals: Option<[Vec3; 3]>, uvs: [Vec2; 3], material: u32) {
        let first = self.0.positions.len() as u32;
        self.0.positions.extend(corners);
        self.0.normals.extend(normals.unwrap_or([Vec3::Y; 3]));
        self.0.uvs.extend(uvs);
        let vertices = [first, first + 1, first + 2];
        self.0.triangles.push(Triangle { vertices, material, object: 0, smooth: normals.is_some() });
    }

    /// Parallelogram whose front is the side of cross(u, v); texture coordinates run over [0, 1] along u and v.
    pub fn quad(&mut self, corner: Vec3, u: Vec3, v: Vec3, material: u32) {
        let [a, b, c, d] = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        self.triangle([corner, corner + u, corner + u + v], None, [a, b, c], material);
        self.triangle([corner, corner + u + v, corner + v], None, [a, c, d], material);
    }

    /// A room seen from inside; materials of the faces x low, x high, y low, y high, z low, z high.
    pub fn room(&mut self, low: Vec3, high: Vec3, materials: [u32; 6]) {
        let size = high - low;
        for axis in 0..3 {
            let edge = |k: usize| Vec3::AXES[k] * size[k];
            let (u, v) = (edge((axis + 1) % 3), edge((axis + 2) % 3));
            self.quad(low, u, v, materials[2 * axis]);
            self.quad(low + edge(axis), v, u, materials[2 * axis + 1]);
        }
    }

    /// A sphere of about 2 n^2 faces seen from outside, with smooth normals.
    pub fn ball(&mut self, center: Vec3, radius: f32, n: u32, material: u32) {
        let point = |i: u32, j: u32| {
            let (theta, phi) =
                (std::f32::consts::PI * i as f32 / n as f32, std::f32::consts::TAU * j as f32 / n as f32);
            Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin())
        };
        for i in 0..n {
            for j in 0..n {
                let [a, b, c, d] = [point(i, j), point(i, j + 1), point(i + 1, j + 1), point(i + 1, j)];
                let faces = [(i > 0).then_some([a, b, c]), (i + 1 < n).then_some([a, c, d])];
                for face in faces.into_iter().flatten() {
                    let corners = face.map(|p| center + radius * p);
                    self.triangle(corners, Some(face), [Vec2::ZERO; 3], material);
                }
            }
        }
    }
}

/// A colour, or one number for all channels.
pub struct Color(Vec3);

impl From<f32> for Color {
    fn from(grey: f32) -> Color {
        Color(Vec3::splat(grey))
    }
}

impl From<[f32; 3]> for Color {
    fn from(rgb: [f32; 3]) -> Color {
        Color(rgb.into())
    }
}

/// A camera whose up is y, or z if it looks along y.
pub fn camera(eye: Vec3, target: Vec3, fov_y: f32, resolution: [u32; 2]) -> Camera {
    let along_y = (target - eye).normalize().y.abs() > 0.99;
    Camera {
        eye,
        target,
        up: if along_y { Vec3::Z } else { Vec3::Y },
        fov_y,
        resolution,
        aperture: 0.0,
        focus: None,
        shutter: 0.0,
        height: None,
        frustum: None,
    }
}

/// A camera of one pixel that sees a point and hardly anything around it.
pub fn probe(eye: Vec3, target: Vec3) -> Camera {
    camera(eye, target, 0.01, [1, 1])
}

/// Vertical angle in degrees under which a half-height of `half` is seen from `distance`.
pub fn fov(half: f32, distance: f32) -> f32 {
    2.0 * (half / distance).atan().to_degrees()
}

/// Settings for closed forms: one seed, `depth` segments.
pub fn settings(particles: u32, max_depth: u32) -> Settings {
    Settings { particles, max_depth, photons: 0, mirror_lights: 0, ..Settings::plain() }
}

/// Keller's original estimator: no clipping, hence no compensation.
pub fn original(particles: u32, max_depth: u32) -> Settings {
    Settings { clip: Clip::Distance(0.0), compensation: Compensation::Off, ..settings(particles, max_depth) }
}

/// A renderer on the tests' device.
pub fn renderer(ctx: &Context, scene: &Scene, camera: Camera, settings: &Settings) -> Renderer {
    Renderer::with_context(ctx.clone(), scene.clone(), camera, settings.clone()).expect("the scene is valid")
}

/// The image after some passes. The validation layer watches two passes, which write all buffers that passes write; the
/// image of more passes is made on the same device without the layer.
pub fn render(ctx: &Context, scene: &Scene, camera: Camera, settings: &Settings, passes: u32) -> Layers {
    let image = |ctx: &Context, passes| {
        let mut renderer = renderer(ctx, scene, camera, settings);
        for _ in 0..passes {
            renderer.pass().expect("a pass of a valid scene");
        }
        renderer.layers().expect("the layers come back")
    };
    if passes > WATCHED_ALONE {
        image(ctx, 2);
        image(&unwatched(), passes)
    } else {
        image(ctx, passes)
    }
}

/// Passes of an image up to which a second renderer costs more than the validation layer.
const WATCHED_ALONE: u32 = 8;

/// Mean of a layer over all pixels.
pub fn mean(layer: &[Vec3]) -> DVec3 {
    layer.iter().map(|v| v.as_dvec3()).sum::<DVec3>() / layer.len() as f64
}

/// Energy ratio and relative RMSE of an image against a reference, over the pixels whose reference is not above its
/// 99.5th percentile (so that visible emitters do not count): sqrt(mean((a - b)^2 / (b^2 + 0.01 mean(b)^2))).
pub fn compare(image: &[Vec3], reference: &[Vec3]) -> (f64, f64) {
    assert_eq!(image.len(), reference.len());
    assert!(image.iter().all(|v| v.is_finite()), "a pixel is not finite");
    let brightness = |v: &Vec3| v.as_dvec3().element_sum() / 3.0;
    let mut sorted: Vec<f64> = reference.iter().map(brightness).collect();
    sorted.sort_by(f64::total_cmp);
    let limit = sorted[((sorted.len() - 1) as f64 * 0.995) as usize];
    let pairs: Vec<(DVec3, DVec3)> = (image.iter().zip(reference))
        .filter(|(_, b)| brightness(b) <= limit)
        .map(|(a, b)| (a.as_dvec3(), b.as_dvec3()))
        .collect();
    let count = 3.0 * pairs.len() as f64;
    let level = pairs.iter().map(|(_, b)| b.element_sum()).sum::<f64>() / count;
    let energy = pairs.iter().map(|(a, _)| a.element_sum()).sum::<f64>() / count / level;
    let floor = DVec3::splat(0.01 * level * level);
    let squares: f64 = pairs.iter().map(|(a, b)| ((a - b) * (a - b) / (b * b + floor)).element_sum()).sum();
    (energy, (squares / count).sqrt())
}
