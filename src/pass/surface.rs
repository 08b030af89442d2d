//! Oracle of `shaders/include/surface.wgsl`: what a ray met.
//!
//! Normals face the side that the ray came from, since surfaces reflect on both; a shading normal that the ray sees from
//! behind gives way to the geometric one. Emission is one-sided unless the material says otherwise.

use glam::Vec3;

use crate::accel::{Bvh, Hit};
use crate::bsdf::{Finish, Reflectance, mean};
use crate::light::cosine;
use crate::scene::{Cone, Scene};

/// The surface at a hit, seen along the ray.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Position.
    pub position: Vec3,
    /// Geometric normal, on the viewer's side.
    pub geometric: Vec3,
    /// Shading normal, likewise.
    pub shading: Vec3,
    /// Radiance emitted back along the ray.
    pub emission: Vec3,
    /// Exitance over pi on this side, mean of the channels.
    pub exitance: f32,
    /// Reflectance; of mirrors the diffuse base, of glass zero.
    pub reflectance: Reflectance,
    /// The same with what is ideal.
    pub finish: Finish,
    /// Seen from its front.
    pub front: bool,
    /// Index of its material.
    pub material: u32,
}

/// Oracle: the surface at a hit of a ray in direction `d`, with textures averaged over a cone of this width there; 0: at a point.
pub fn surface_at(scene: &Scene, bvh: &Bvh, hit: &Hit, d: Vec3, width: f32) -> SurfacePoint {
    let triangle = &scene.triangles[bvh.scene_triangle(hit.triangle) as usize];
    let face = bvh.normal(hit.triangle);
    let front = face.dot(d) < 0.0;
    let geometric = if front { face } else { -face };
    let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
    let corner = |k: usize| triangle.vertices[k] as usize;
    let mut shading = geometric;
    if triangle.smooth {
        let n = (0..3).map(|k| scene.normals[corner(k)] * weights[k]).sum::<Vec3>().normalize_or(geometric);
        let n = if n.dot(geometric) >= 0.0 { n } else { -n };
        shading = if n.dot(d) < 0.0 { n } else { geometric };
    }
    let material = &scene.materials[triangle.material as usize];
    let side = if front { 1.0 } else { -1.0 };
    let cone = Cone { width, cosine: face.dot(d).abs() };
    let mapped = scene.mapped_normal_over(triangle, weights, shading * side, cone) * side;
    shading = if mapped.dot(d) < 0.0 { mapped } else { shading };
    let finish = Finish::over(scene, triangle, weights, cone).along_grain(scene, triangle, shading, front);
    let emits = front || material.two_sided;
    let along_normal = if emits { scene.emission_over(triangle, weights, cone) } else { Vec3::ZERO };
    let emission = along_normal * cosine::falloff(cone.cosine, material.emission_exponent);
    let exitance = mean(along_normal) * cosine::flatness(material.emission_exponent);
    let reflectance = finish.reflectance;
    let material = triangle.material;
    SurfacePoint {
        position: bvh.position(hit),
        geometric,
        shading,
        emission,
        exitance,
        reflectance,
        finish,
        front,
        material,
    }
}
