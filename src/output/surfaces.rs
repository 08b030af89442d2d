//! Layers of the surfaces that an image shows: object, material and texture coordinates.

use glam::Vec2;
use rayon::prelude::*;

use crate::accel::{Bvh, Ray};
use crate::path_trace::camera_direction;
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
}

impl Surfaces {
    /// Of the whole image of a camera. `bvh`: that of the scene as it is.
    pub fn of(scene: &Scene, bvh: &Bvh, camera: &Camera) -> Surfaces {
        let [width, height] = camera.resolution;
        let seen = |i: u32| {
            let [x, y] = [i % width, i / width].map(|n| n as f32 + 0.5);
            let ray = Ray::new(camera.eye, camera_direction(camera, camera.resolution, x, y));
            // Where half of the light passes or more, what is behind counts.
            let Some(hit) = bvh.closest_stop(scene, &ray, |_| 0.5) else { return (-1.0, -1.0, Vec2::ZERO) };
            let triangle = &scene.triangles[bvh.scene_triangle(hit.triangle) as usize];
            let uv = scene.uv_at(triangle, [1.0 - hit.u - hit.v, hit.u, hit.v], TextureUse::Base);
            (triangle.object as f32, triangle.material as f32, uv)
        };
        let pixels: Vec<(f32, f32, Vec2)> = (0..width * height).into_par_iter().map(seen).collect();
        Surfaces {
            object: pixels.iter().map(|pixel| pixel.0).collect(),
            material: pixels.iter().map(|pixel| pixel.1).collect(),
            uv: [0, 1].map(|axis| pixels.iter().map(|pixel| pixel.2[axis]).collect()),
        }
    }

    /// Every list.
    pub(super) fn parts(&mut self) -> [&mut Vec<f32>; 4] {
        let [u, v] = &mut self.uv;
        [&mut self.object, &mut self.material, u, v]
    }

    /// Every list with the name of its channel.
    pub(super) fn channels(&self) -> [(&'static str, &[f32]); 4] {
        let [u, v] = &self.uv;
        [("object.ID", &self.object), ("material.ID", &self.material), ("uv.U", u), ("uv.V", v)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Material;
    use glam::Vec3;

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
        let camera = Camera {
            eye: Vec3::new(0.0, 0.0, 4.0),
            target: Vec3::ZERO,
            up: Vec3::Y,
            fov_y: 90.0,
            resolution: [16, 16],
            aperture: 0.0,
            focus: None,
            shutter: 0.0,
            frustum: None,
        };
        let surfaces = Surfaces::of(&scene, &Bvh::build(&scene).unwrap(), &camera);
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
    }
}
