//! Surface properties at the hit of a ray.

use crate::accel::{Bvh, Hit};
use crate::bsdf::{Finish, Normals};
use crate::light::cosine;
use crate::scene::{Material, Scene};
use glam::Vec3;

/// A vertex of a path: a point on a surface, seen from a direction.
#[derive(Clone, Copy, Debug)]
pub struct PathVertex<'a> {
    /// Position, from the barycentric coordinates.
    pub position: Vec3,
    /// Unit direction back along the ray.
    pub wo: Vec3,
    /// Normals, turned to the side of `wo`.
    pub normals: Normals,
    /// Index of the triangle in the scene.
    pub triangle: u32,
    /// The triangle's material.
    pub material: &'a Material,
    /// Its index in the scene.
    pub material_index: u32,
    /// Weights of the triangle's corners.
    pub weights: [f32; 3],
}

impl<'a> PathVertex<'a> {
    /// The point of a hit, seen from unit direction `wo`.
    pub fn of(scene: &'a Scene, bvh: &Bvh, hit: &Hit, wo: Vec3) -> PathVertex<'a> {
        let index = bvh.scene_triangle(hit.triangle);
        let triangle = &scene.triangles[index as usize];
        let [a, b, c] = triangle.vertices.map(|v| v as usize);
        let w = 1.0 - hit.u - hit.v;
        let geometric = bvh.normal(hit.triangle);
        let shading = if triangle.smooth {
            // Opposite vertex normals can cancel; then the face normal is used.
            (scene.normals[a] * w + scene.normals[b] * hit.u + scene.normals[c] * hit.v).normalize_or(geometric)
        } else {
            geometric
        };
        let mut normals = Normals::facing(geometric, shading, wo);
        let weights = [w, hit.u, hit.v];
        let side = if normals.front { 1.0 } else { -1.0 };
        let mapped = scene.mapped_normal(triangle, weights, normals.shading * side) * side;
        // A normal seen from behind would make the surface black.
        normals.shading = if mapped.dot(wo) > 0.0 { mapped } else { normals.shading };
        PathVertex {
            position: bvh.position(hit),
            wo,
            normals,
            triangle: index,
            material: &scene.materials[triangle.material as usize],
            material_index: triangle.material,
            weights,
        }
    }

    /// Emitted radiance towards `wo`.
    pub fn emission(&self, scene: &Scene) -> Vec3 {
        let seen = self.normals.front || self.material.two_sided;
        if !seen {
            return Vec3::ZERO;
        }
        let cos = self.normals.geometric.dot(self.wo);
        let along_normal = scene.emission_at(&scene.triangles[self.triangle as usize], self.weights);
        along_normal * cosine::falloff(cos, self.material.emission_exponent)
    }

    /// The material with its textures applied.
    pub fn finish(&self, scene: &Scene) -> Finish {
        let (triangle, n) = (&scene.triangles[self.triangle as usize], &self.normals);
        Finish::at(scene, triangle, self.weights).along_grain(scene, triangle, n.shading, n.front)
    }
}
