//! Rays in scenes where some surfaces let light pass ([`crate::scene::Alpha`]).
//!
//! Along a segment the shares that surfaces let pass multiply: shadow rays are exact. A ray that looks for the closest surface stops
//! at each one by chance, as often as the surface covers (Enderton, Sintorn, Shirley and Luebke 2010, "Stochastic Transparency");
//! its mean over many rays is exact.

use super::{Bvh, Hit, Ray};
use crate::sampling::dimensions::ALPHA;
use crate::sampling::random::{hash, key, random_f32};
use crate::scene::Scene;
use glam::Vec3;

impl Bvh {
    /// Share of rays that a surface stops at a hit.
    pub fn coverage(&self, scene: &Scene, hit: &Hit) -> f32 {
        let triangle = &scene.triangles[self.scene_triangle(hit.triangle) as usize];
        scene.coverage(triangle, [1.0 - hit.u - hit.v, hit.u, hit.v])
    }

    /// The nearest hit at which `random`, which gives a number in [0, 1) for a hit, stops the ray.
    pub fn closest_stop(&self, scene: &Scene, ray: &Ray, mut random: impl FnMut(&Hit) -> f32) -> Option<Hit> {
        self.nearest(ray, &mut super::Steps::default(), |hit| {
            let coverage = self.coverage(scene, hit);
            coverage >= 1.0 || random(hit) < coverage
        })
    }

    /// Share of the light that passes all surfaces on the open segment.
    pub fn transmittance(&self, scene: &Scene, ray: &Ray) -> f32 {
        let mut passes = 1.0;
        self.traverse(ray, &mut super::Steps::default(), |_, k| {
            if let Some(hit) = self.intersect(ray, k) {
                passes *= 1.0 - self.coverage(scene, &hit);
            }
            passes <= 0.0
        });
        passes
    }
}

/// Oracle: the number by which the device decides whether a hit stops a ray of direction `d`; `pass`: key of the pass.
pub fn chance(pass: u32, triangle: u32, d: Vec3) -> f32 {
    let [x, y, z] = d.to_array().map(f32::to_bits);
    random_f32(key(pass, ALPHA, triangle, hash(x ^ hash(y ^ hash(z)))))
}
