//! Targets of photons: mirrors and bodies of glass (Wald et al. 2002, section 4).
//!
//! Triangles of ideal materials that share corners form a body, and each body has a bounding sphere. From a point y a photon is
//! shot at a sphere t of radius R_t at distance d_t, chosen with probability
//!
//! ```text
//! p_t = w_t / sum w      w_t = R_t^2 / max(d_t^2, R_t^2), about its solid angle; 0 behind the plane of an oriented emitter
//!                        w_t = R_t^2 for parallel light
//! ```
//!
//! and in a direction uniform in the cone of solid angle Omega around the sphere; from inside the sphere, in a direction
//! distributed as the emission. The flux of a photon, if it were the only one, is the emission over the density of start and direction:
//!
//! ```text
//! surfaces, virtual lights   Phi / pi cos Omega / p_t       point, spot   I(w) / p_e Omega / p_t       inside   Phi / p_t
//! parallel light             E pi R_t^2 / (p_e p_t), from a uniform point of the sphere's disc
//! ```
//!
//! with Phi = power / p_e. A photon counts only if the first triangle that it hits belongs to the chosen body: each body gets
//! light only from its own photons, so spheres may overlap.

use crate::accel::Bvh;
use crate::bsdf::{basis, sample_diffuse};
use crate::light::emitters::{Emitters, Kind, Start};
use crate::pass::layout::PointLight;
use crate::pass::shade::light_towards;
use crate::scene::{Scene, Surface};
use glam::Vec3;
use std::collections::HashMap;
use std::f32::consts::{FRAC_1_PI, PI, TAU};

/// Maximum number of targets: a shader visits all of them for each photon.
pub const MAX_TARGETS: usize = 64;

/// A bounding sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub center: Vec3,
    /// Radius, slightly larger than that of the triangles.
    pub radius: f32,
}

/// The targets of a scene.
#[derive(Clone, Debug, Default)]
pub struct Targets {
    /// Bounding spheres of the bodies; empty without ideal surfaces.
    pub spheres: Vec<Sphere>,
    /// Target of each triangle of the tree, as index + 1, or 0.
    pub of_triangle: Vec<u32>,
}

/// A photon on its way to a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// The target.
    pub target: u32,
    /// Unit direction.
    pub direction: Vec3,
    /// Origin of the ray.
    pub origin: Vec3,
    /// Flux if it were the only photon; 0: nothing is emitted there.
    pub flux: Vec3,
}

impl Targets {
    /// Finds the bodies. More than [`MAX_TARGETS`] are grouped by position.
    pub fn of(scene: &Scene, bvh: &Bvh) -> Targets {
        let ideal: Vec<u32> = (0..bvh.triangle_count())
            .filter(|&i| scene.materials[bvh.material(i) as usize].surface != Surface::Opaque)
            .collect();
        let corners = |i: u32| {
            let vertices = scene.triangles[bvh.scene_triangle(i) as usize].vertices;
            vertices.map(|v| scene.positions[v as usize])
        };
        let mut bodies: Vec<Vec<u32>> = bodies(&ideal, &corners);
        let mut groups = Vec::new();
        group(&mut bodies, MAX_TARGETS, &corners, &mut groups);

        let mut targets = Targets { spheres: Vec::new(), of_triangle: vec![0; bvh.triangle_count() as usize] };
        for triangles in groups {
            targets.spheres.push(bounding_sphere(&triangles, &corners));
            let number = targets.spheres.len() as u32;
            triangles.iter().for_each(|&i| targets.of_triangle[i as usize] = number);
        }
        targets
    }

    /// Shoots a photon from a start (its ray may begin at `origin`) by three numbers in [0, 1): one for the target, two for the
    /// direction. `None` if all targets are behind the emitter.
    pub fn shoot(
        &self,
        emitters: &Emitters,
        start: &Start,
        origin: Vec3,
        choice: f32,
        leave: [f32; 2],
    ) -> Option<Shot> {
        let e = &emitters.list[start.emitter as usize];
        let oriented = !matches!(e.kind, Kind::Point | Kind::Spot | Kind::Directional);
        let parallel = e.kind == Kind::Directional;
        let (target, p) = self.choose(origin, oriented.then_some(start.normal), parallel, choice)?;
        let sphere = self.spheres[target];
        let shot = |origin: Vec3, direction: Vec3, flux: Vec3| {
            Some(Shot { target: target as u32, origin, direction, flux: flux / p })
        };
        if e.kind == Kind::Directional {
            let (t, b) = basis(e.normal);
            let (r, phi) = (sphere.radius * leave[0].sqrt(), TAU * leave[1]);
            // The disc is in front of the whole scene.
            let centre = sphere.center - e.normal * (2.0 * e.e1.length());
            let from = centre + t * (r * phi.cos()) + b * (r * phi.sin());
            return shot(from, e.normal, e.radiance * (PI * sphere.radius * sphere.radius / e.probability));
        }
        let Some((direction, solid_angle)) = in_cone(&sphere, origin, leave) else {
            return shot(origin, emitters.sample_direction(start, leave), start.flux);
        };
        let intensity = match e.kind {
            Kind::Point | Kind::Spot => e.intensity(direction) / e.probability,
            _ => start.flux * (FRAC_1_PI * start.normal.dot(direction).max(0.0)),
        };
        shot(origin, direction, intensity * solid_angle)
    }

    /// Shoots a photon from a virtual light, as [`Targets::shoot`]; its flux is that of this light alone.
    pub fn shoot_from(&self, light: &PointLight, choice: f32, leave: [f32; 2]) -> Option<Shot> {
        let xyz = |v: [f32; 4]| Vec3::new(v[0], v[1], v[2]);
        let (origin, normal) = (xyz(light.position), xyz(light.normal));
        let (target, p) = self.choose(origin, Some(normal), false, choice)?;
        let (direction, over_density) = in_cone(&self.spheres[target], origin, leave).unwrap_or_else(|| {
            // By the cosine.
            let local = sample_diffuse(leave);
            let (t, b) = basis(normal);
            (t * local.x + b * local.y + normal * local.z, PI / local.z)
        });
        let flux = light_towards(light, -direction, 1.0, 0.0) * (over_density / p);
        Some(Shot { target: target as u32, origin, direction, flux })
    }

    /// Chooses a target for a start, by solid angle (for parallel light: by area), and the probability of the choice. `normal`: of
    /// the surface that emits.
    fn choose(&self, origin: Vec3, normal: Option<Vec3>, parallel: bool, choice: f32) -> Option<(usize, f32)> {
        let weight = |s: &Sphere| {
            let (to, r2) = (s.center - origin, s.radius * s.radius);
            match normal {
                _ if parallel => r2,
                Some(normal) if to.dot(normal) <= -s.radius => 0.0,
                _ => r2 / to.length_squared().max(r2),
            }
        };
        let weights: Vec<f32> = self.spheres.iter().map(weight).collect();
        let sum: f32 = weights.iter().sum();
        let last = weights.iter().rposition(|&w| w > 0.0)?;
        let mut rest = choice * sum;
        let mut target = last;
        for (t, &w) in weights.iter().enumerate().take(last) {
            if rest < w {
                target = t;
                break;
            }
            rest -= w;
        }
        Some((target, weights[target] / sum))
    }
}

/// A direction in the cone around a sphere, and the cone's solid angle; `None` from within the sphere.
fn in_cone(sphere: &Sphere, origin: Vec3, leave: [f32; 2]) -> Option<(Vec3, f32)> {
    let to = sphere.center - origin;
    let sin2 = sphere.radius * sphere.radius / to.length_squared();
    if sin2 >= INSIDE {
        return None;
    }
    // 1 - cos of the cone, without cancellation.
    let cap = sin2 / (1.0 + (1.0 - sin2).sqrt());
    let h = leave[0] * cap;
    let (sin, phi) = ((h * (2.0 - h)).sqrt(), TAU * leave[1]);
    let axis = to.normalize();
    let (t, b) = basis(axis);
    Some((t * (sin * phi.cos()) + b * (sin * phi.sin()) + axis * (1.0 - h), TAU * cap))
}

/// Squared sine of a sphere's half angle above which a point counts as inside the sphere.
pub const INSIDE: f32 = 0.999;

/// Triangles that share corners.
fn bodies(ideal: &[u32], corners: &impl Fn(u32) -> [Vec3; 3]) -> Vec<Vec<u32>> {
    // A union-find forest over `ideal`: each entry is closer to the root.
    fn root(parent: &mut [usize], mut i: usize) -> usize {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    }
    let mut parent: Vec<usize> = (0..ideal.len()).collect();
    let mut at: HashMap<[u32; 3], usize> = HashMap::new();
    for (k, &i) in ideal.iter().enumerate() {
        for corner in corners(i) {
            // -0 and 0 are the same place.
            let place = (corner + 0.0).to_array().map(f32::to_bits);
            let other = *at.entry(place).or_insert(k);
            let (a, b) = (root(&mut parent, k), root(&mut parent, other));
            parent[a.max(b)] = a.min(b);
        }
    }
    let mut bodies: Vec<Vec<u32>> = Vec::new();
    let mut number: HashMap<usize, usize> = HashMap::new();
    for (k, &i) in ideal.iter().enumerate() {
        let body = *number.entry(root(&mut parent, k)).or_insert_with(|| {
            bodies.push(Vec::new());
            bodies.len() - 1
        });
        bodies[body].push(i);
    }
    bodies
}

fn box_of(triangles: &[u32], corners: &impl Fn(u32) -> [Vec3; 3]) -> (Vec3, Vec3) {
    let all = triangles.iter().flat_map(|&i| corners(i));
    all.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
}

/// Puts bodies into at most `most` groups: halves along the longest axis, and halves of these.
fn group(bodies: &mut [Vec<u32>], most: usize, corners: &impl Fn(u32) -> [Vec3; 3], groups: &mut Vec<Vec<u32>>) {
    if bodies.len() <= most {
        groups.extend(bodies.iter().cloned());
        return;
    }
    if most == 1 {
        groups.push(bodies.concat());
        return;
    }
    let (low, high) = box_of(&bodies.concat(), corners);
    let axis = (high - low).max_position();
    let middle = |body: &Vec<u32>| {
        let (low, high) = box_of(body, corners);
        low[axis] + high[axis]
    };
    bodies.sort_by(|a, b| middle(a).total_cmp(&middle(b)));
    let (first, second) = bodies.split_at_mut(bodies.len() / 2);
    group(first, most / 2, corners, groups);
    group(second, most - most / 2, corners, groups);
}

/// Bounding sphere around the centre of their box, with a margin for rounding.
fn bounding_sphere(triangles: &[u32], corners: &impl Fn(u32) -> [Vec3; 3]) -> Sphere {
    let (low, high) = box_of(triangles, corners);
    let center = (low + high) * 0.5;
    let farthest = triangles.iter().flat_map(|&i| corners(i)).map(|p| p.distance(center)).fold(0.0, f32::max);
    // Offsets of rays' origins are a few 1e-5 of the coordinates.
    let rounding = 1e-4 * farthest + 1e-5 * center.abs().max_element();
    Sphere { center, radius: farthest + rounding }
}

#[cfg(test)]
mod tests;
