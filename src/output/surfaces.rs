//! Layers of the surfaces that an image shows: object, material, texture coordinates and motion.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

#[cfg(feature = "images")]
use super::cryptomatte::Mattes;
use crate::accel::Bvh;
use crate::pass::velocity::{self, Moving};
use crate::path_trace::eye_ray;
use crate::scene::{Camera, Scene, TextureUse};

/// The first surface at the centre of each pixel, not seen through mirrors and glass; all lists are empty, or hold a value for each pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surfaces {
    /// Index of the object in [`Scene::objects`]; -1 on the background.
    pub object: Vec<f32>,
    /// Index of the material in [`Scene::materials`]; -1 on the background.
    pub material: Vec<f32>,
    /// Coordinates of the base texture; 0 on the background and where there are none.
    pub uv: [Vec<f32>; 2],
    /// How far the surface, or the background, moves in the image while the shutter is open: to the right and down, pixels. Empty if the
    /// shutter is open for an instant.
    pub motion: [Vec<f32>; 2],
    /// Names of all objects of the scene, and of all materials.
    pub names: [Vec<String>; 2],
}

/// Cameras as the shutter opens and as it closes, and the triangles that move meanwhile.
pub type Shutter = ([Camera; 2], Moving);

impl Surfaces {
    /// Of the whole image of a camera. `bvh`: that of the scene as it is; `shutter`: [`Engine::while_open`](crate::engine::Engine::while_open).
    pub fn of(scene: &Scene, bvh: &Bvh, camera: &Camera, shutter: Option<&Shutter>) -> Surfaces {
        let [width, height] = camera.resolution;
        let forward = camera.world_from_camera().2;
        let motion_of = |places: [Vec3; 2], depth: Option<f32>| {
            let ends = shutter.map(|(ends, _)| ends.each_ref());
            ends.map_or(Vec2::ZERO, |ends| velocity::reference(ends, places, depth).as_vec2())
        };
        let seen = |i: u32| {
            let [x, y] = [i % width, i / width].map(|n| n as f32 + 0.5);
            let ray = eye_ray(camera, camera.resolution, x, y);
            // Where half of the light passes or more, what is behind counts.
            let Some(hit) = bvh.closest_stop(scene, &ray, |_| 0.5) else {
                let towards = match camera.is_orthographic() {
                    true => ray.origin - camera.eye,
                    false => ray.direction / ray.direction.dot(forward),
                };
                return (-1.0, -1.0, Vec2::ZERO, motion_of([towards; 2], None));
            };
            let triangle = &scene.triangles[bvh.scene_triangle(hit.triangle) as usize];
            let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
            let uv = scene.uv_at(triangle, weights, TextureUse::Base);
            let point = |of: &dyn Fn(usize) -> Vec3| (0..3).map(|k| weights[k] * of(k)).sum::<Vec3>();
            let place = point(&|k| scene.positions[triangle.vertices[k] as usize]);
            let moved = shutter.and_then(|(_, moving)| moving.of(hit.triangle));
            let places = [0, 1].map(|end| place + moved.map_or(Vec3::ZERO, |moved| point(&|k| moved[end][k])));
            let motion = motion_of(places, Some((place - camera.eye).dot(forward)));
            (triangle.object as f32, triangle.material as f32, uv, motion)
        };
        let pixels: Vec<(f32, f32, Vec2, Vec2)> = (0..width * height).into_par_iter().map(seen).collect();
        Surfaces {
            object: pixels.iter().map(|pixel| pixel.0).collect(),
            material: pixels.iter().map(|pixel| pixel.1).collect(),
            uv: [0, 1].map(|axis| pixels.iter().map(|pixel| pixel.2[axis]).collect()),
            motion: match shutter {
                None => Default::default(),
                Some(_) => [0, 1].map(|axis| pixels.iter().map(|pixel| pixel.3[axis]).collect()),
            },
            names: [scene.objects.clone(), scene.materials.iter().map(|material| material.name.clone()).collect()],
        }
    }

    /// Every list of numbers.
    pub(super) fn parts(&mut self) -> [&mut Vec<f32>; 6] {
        let ([u, v], [x, y]) = (&mut self.uv, &mut self.motion);
        [&mut self.object, &mut self.material, u, v, x, y]
    }

    /// Mattes of the objects and of the materials; none without their numbers.
    #[cfg(feature = "images")]
    pub(super) fn mattes(&self) -> Vec<Mattes> {
        let [objects, materials] = &self.names;
        let all = [("CryptoObject", &self.object, objects), ("CryptoMaterial", &self.material, materials)];
        let given = all.into_iter().filter(|(_, numbers, _)| !numbers.is_empty());
        given.map(|(layer, numbers, names)| Mattes::new(layer, numbers, names)).collect()
    }

    /// Every list of numbers with the name of its channel.
    pub(super) fn channels(&self) -> [(&'static str, &[f32]); 6] {
        let ([u, v], [x, y]) = (&self.uv, &self.motion);
        let surface = [("object.ID", &self.object), ("material.ID", &self.material)];
        let [object, material] = surface.map(|(name, values)| (name, values.as_slice()));
        [object, material, ("uv.U", u), ("uv.V", v), ("motion.X", x), ("motion.Y", y)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Material;
    use glam::Vec3;

    /// Looks along -z; at unit distance a unit is 8 pixels.
    fn camera() -> Camera {
        Camera {
            eye: Vec3::new(0.0, 0.0, 4.0),
            target: Vec3::ZERO,
            up: Vec3::Y,
            fov_y: 90.0,
            resolution: [16, 16],
            aperture: 0.0,
            focus: None,
            shutter: 0.0,
            height: None,
            frustum: None,
        }
    }

    /// A square of two units before a larger one, at whose centre the eye looks: each pixel is known by similar triangles.
    #[test]
    fn squares_are_seen_where_similar_triangles_say() {
        let mut scene = Scene::default();
        for (name, half, z) in [("far", 4.0, -2.0), ("near", 1.0, 0.0)] {
            let (object, material) = (scene.add_object(name), scene.add_material(Material::default()));
            let corner = Vec3::new(-half, -half, z);
            scene.add_quad(corner, 2.0 * half * Vec3::X, 2.0 * half * Vec3::Y, material, object);
        }
        scene.uvs = scene.positions.iter().map(|p| 0.125 * p.truncate() + Vec2::splat(0.5)).collect();
        let camera = camera();
        let bvh = Bvh::build(&scene).unwrap();
        let surfaces = Surfaces::of(&scene, &bvh, &camera, None);
        let mut counts = [0; 3];
        for i in 0..256 {
            let slope = Vec2::new((i % 16) as f32 + 0.5, -((i / 16) as f32 + 0.5)) / 8.0 + Vec2::new(-1.0, 1.0);
            let (near, far) = (4.0 * slope, 6.0 * slope);
            let (index, at) = match () {
                () if near.abs().max_element() < 1.0 => (1.0, near),
                () if far.abs().max_element() < 4.0 => (0.0, far),
                () => (-1.0, Vec2::splat(-4.0)),
            };
            counts[(index + 1.0) as usize] += 1;
            assert_eq!((surfaces.object[i], surfaces.material[i]), (index, index), "pixel {i}");
            let uv = Vec2::new(surfaces.uv[0][i], surfaces.uv[1][i]);
            assert!(uv.abs_diff_eq(0.125 * at + Vec2::splat(0.5), 1e-5), "pixel {i}: {uv}");
        }
        assert!(counts.iter().all(|count| *count > 10), "{counts:?}");
        assert!(surfaces.motion.iter().all(Vec::is_empty));
    }

    /// The near square moves by half a unit, the camera by a quarter: by similar triangles.
    #[test]
    fn motion_is_that_of_similar_triangles() {
        let mut scene = Scene::default();
        for (name, half, z) in [("far", 9.0, -2.0), ("near", 1.0, 0.0)] {
            let (object, material) = (scene.add_object(name), scene.add_material(Material::default()));
            let corner = Vec3::new(-half, -half, z);
            scene.add_quad(corner, 2.0 * half * Vec3::X, 2.0 * half * Vec3::Y, material, object);
        }
        let camera = camera();
        let bvh = Bvh::build(&scene).unwrap();
        let ends = [-0.125, 0.125].map(|x| Camera {
            eye: camera.eye + x * Vec3::X,
            target: camera.target + x * Vec3::X,
            ..camera
        });
        let near = |leaf: u32| scene.triangles[bvh.scene_triangle(leaf) as usize].object == 1;
        let moving = Moving {
            of_triangle: (0..4).map(|leaf| u32::from(near(leaf))).collect(),
            displacements: vec![[-0.25, 0.25].map(|y| [y * Vec3::Y; 3])],
        };
        let surfaces = Surfaces::of(&scene, &bvh, &camera, Some(&(ends, moving)));
        for i in 0..256 {
            let expected = match surfaces.object[i] {
                1.0 => Vec2::new(-0.25, -0.5) * 8.0 / 4.0,
                _ => Vec2::new(-0.25, 0.0) * 8.0 / 6.0,
            };
            let found = Vec2::new(surfaces.motion[0][i], surfaces.motion[1][i]);
            assert!(found.abs_diff_eq(expected, 1e-5), "pixel {i}: {found} for {expected}");
        }
        assert!(surfaces.object.contains(&1.0) && surfaces.object.contains(&0.0));
    }
}
