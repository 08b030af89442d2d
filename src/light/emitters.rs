//! The emitters of a scene, and the distribution of particles over them (Keller 1997, 3.2).
//!
//! An emitter is chosen in proportion to its power (mean of the channels) by the composition method: the number that
//! chooses it is rescaled to [0, 1) and used again for the point on it. The point comes from an area-preserving map of the
//! unit square:
//!
//! - quad (two triangles that form a parallelogram): p0 + u e1 + v e2, an isometry up to shear and scale;
//! - triangle: p0 + s (1 - v) e1 + s v e2, s = sqrt(1 - u): slices parallel to the edge opposite p0. It is continuous, but
//!   squeezes one side of the square into p0; the map of Heitz (2019) distorts less at the price of a fold;
//! - sphere: cylindrical equal-area map, z = 1 - 2u, phi = 2 pi v;
//! - part of an environment: a direction, uniform over azimuth and cosine; particles start on the disc of the scene's bounding sphere,
//!   perpendicular to it;
//! - directional light: the disc of the scene's bounding sphere, perpendicular to the direction, (sqrt u, 2 pi v).
//!
//! The radiance of triangles and quads may have a texture (see `patterns`).
//!
//! Point, spot, directional and virtual lights are *delta* lights: they start particles for indirect light, but for direct
//! light a renderer evaluates each of them exactly once instead of their particles' first vertices.

mod make;
mod patterns;

pub use patterns::{Parts, Pattern};

use make::{of_light, of_patch, of_surface};

use crate::accel::unit_normal;
use crate::bsdf::{basis, mean};
use crate::error::{Error, Result};
use crate::light::cosine;
use crate::sampling::ONE_MINUS_EPSILON;
use crate::scene::{Environment, Light, Scene, Texture};
use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};
use std::collections::HashMap;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// "No emitter" in [`Emitters::of_triangle`].
pub const NO_EMITTER: u32 = u32::MAX;

/// Kind of an emitter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// Triangle of a mesh.
    Triangle = 0,
    /// Parallelogram of two triangles of a mesh.
    Quad = 1,
    /// Sphere.
    Sphere = 2,
    /// Isotropic point.
    Point = 3,
    /// Spot.
    Spot = 4,
    /// Parallel light.
    Directional = 5,
    /// Point with emission by a power of the cosine about a normal.
    Imported = 6,
    /// Part of the environment.
    Environment = 7,
}

/// One emitter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emitter {
    /// Its kind.
    pub kind: Kind,
    /// Triangle, quad: first corner. Sphere: centre. Directional: centre of the disc. Environment: centre of the scene.
    /// Else: position.
    pub p0: Vec3,
    /// Triangle, quad: first edge. Directional: radius of the disc along one axis. Sphere: x holds the radius on which
    /// particles start, see [`Emitters::of`]. Spot: x and y hold the cosines of the inner and the outer angle.
    /// Environment: smallest azimuth, its range, and the cosine of the angle from the zenith at the upper edge.
    pub e1: Vec3,
    /// Triangle, quad: second edge. Directional: radius of the disc along the other axis. Environment: range of the cosine, and
    /// radius of the scene.
    pub e2: Vec3,
    /// Triangle, quad, virtual: unit normal of the side that emits. Spot, directional, environment: unit direction of the
    /// light, of the middle of the part.
    pub normal: Vec3,
    /// Triangle, quad, sphere: radiance along the normal, its mean if there is a texture; environment: its mean. Point, spot: radiant intensity. Directional: irradiance across its direction.
    /// Virtual: flux.
    pub radiance: Vec3,
    /// Area of one side; directional: of the disc; environment: solid angle; 0 for points.
    pub area: f32,
    /// Emits from both sides.
    pub two_sided: bool,
    /// A sphere that emits inwards.
    pub inward: bool,
    /// Emitted flux, W.
    pub power: Vec3,
    /// Probability of being chosen, from the distribution as stored.
    pub probability: f32,
    /// Triangle, quad, virtual: exponent of the cosine, see [`cosine`]. Else 1.
    pub exponent: f32,
    /// Texture of a triangle or quad.
    pub pattern: Option<Pattern>,
}

impl Emitter {
    /// Whether it has no area: evaluated directly, not through particles.
    pub fn is_delta(&self) -> bool {
        matches!(self.kind, Kind::Point | Kind::Spot | Kind::Directional | Kind::Imported)
    }
}

/// The device form of an [`Emitter`], 128 bytes. Numbers that are not floats are stored as the bits of a `u32`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct EmitterRecord {
    /// xyz: `p0`; w: bits of the [`Kind`].
    pub p0: [f32; 4],
    /// xyz: `e1`; w: `area`.
    pub e1: [f32; 4],
    /// xyz: `e2`; w: bits: 1 two-sided, 2 inward.
    pub e2: [f32; 4],
    /// xyz: `normal`; w: `probability`.
    pub normal: [f32; 4],
    /// xyz: `radiance`; w: the upper end of its interval in the distribution, as in [`Emitters::cdf`].
    pub radiance: [f32; 4],
    /// xyz: flux of a particle started here, `power / probability` (0 if never chosen), with a texture where that is white; w: exponent of the cosine.
    pub flux: [f32; 4],
    /// Texture coordinates of the first corner, and their change along the first edge.
    pub uv: [f32; 4],
    /// xy: their change along the second edge; z: bits of the texture + 1 over those of 1.0, or 0 without one; w: exitance over that of
    /// Lambert's law.
    pub pattern: [f32; 4],
}

/// Bit of `EmitterRecord::e2[3]`: emits from both sides.
pub const FLAG_TWO_SIDED: u32 = 1;
/// Bit of `EmitterRecord::e2[3]`: a sphere that emits inwards.
pub const FLAG_INWARD: u32 = 2;

/// Start of a particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Index of the emitter.
    pub emitter: u32,
    /// Starting point, on the emitter itself.
    pub position: Vec3,
    /// Axis of the emission: normal of the emitting side, direction of a spot or parallel light; +z for a point.
    pub normal: Vec3,
    /// Flux of the particle if it were the only one; divide by the number of particles.
    pub flux: Vec3,
    /// Environment: radiance from this direction. Surfaces: exitance over pi, at this point. Else that of the emitter.
    pub radiance: Vec3,
}

/// All emitters of a scene and the distribution to choose from them.
#[derive(Clone, Debug)]
pub struct Emitters {
    /// The emitters.
    pub list: Vec<Emitter>,
    /// Upper ends of the emitters' intervals of [0, 1); the last is 1.
    pub cdf: Vec<f32>,
    /// Indices of the delta lights, which a renderer evaluates one by one.
    pub delta: Vec<usize>,
    /// Total emitted flux, W.
    pub power: Vec3,
    /// Emitter of each triangle of the scene, or [`NO_EMITTER`]; of a divided one its key in `parts`. See [`Emitters::at`].
    pub of_triangle: Vec<u32>,
    /// Parts of emitters with uneven textures.
    pub parts: HashMap<u32, Parts>,
    /// The environment, if the scene has one.
    pub environment: Option<Surroundings>,
}

/// The environment and its emitters.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// The environment.
    pub of: Arc<Environment>,
    /// Emitter of each of its texels, or [`NO_EMITTER`] for black ones.
    pub of_texel: Vec<u32>,
}

impl Emitters {
    /// Collects the emitters. `emissive`: whether emissive triangles and spheres light the scene; else they are only visible.
    ///
    /// Particles of a sphere start on the ideal sphere, or, if a triangle of its mesh is in front of it, on the nearest
    /// concentric sphere in front of all triangles. Flux and area stay those of the ideal sphere.
    pub fn of(scene: &Scene, emissive: bool) -> Result<Emitters> {
        let mut emitters = Emitters {
            list: Vec::new(),
            cdf: Vec::new(),
            delta: Vec::new(),
            power: Vec3::ZERO,
            of_triangle: vec![NO_EMITTER; scene.triangles.len()],
            parts: HashMap::new(),
            environment: None,
        };
        let mut sphere_objects = HashMap::new();
        for light in &scene.lights {
            if let Light::Sphere { object, .. } = light {
                sphere_objects.insert(*object, NO_EMITTER);
            }
            if emissive || !matches!(light, Light::Sphere { .. }) {
                let index = emitters.list.len() as u32;
                emitters.list.push(of_light(scene, light));
                if let Light::Sphere { object, .. } = light {
                    sphere_objects.insert(*object, index);
                }
            }
        }
        if emissive {
            emitters.add_triangles(scene, &sphere_objects);
            patterns::divide(&mut emitters, scene);
        }
        if let Some(environment) = &scene.environment {
            emitters.add_environment(scene, environment);
        }
        emitters.distribute()?;
        Ok(emitters)
    }

    /// Adds the parts of an environment.
    fn add_environment(&mut self, scene: &Scene, of: &Arc<Environment>) {
        let mut of_texel = vec![NO_EMITTER; of.texels.len()];
        for patch in of.patches() {
            let [columns, rows] = patch.texels;
            for row in rows[0]..rows[1] {
                let at = |column: u32| (row * of.width + column) as usize;
                of_texel[at(columns[0])..at(columns[1] - 1) + 1].fill(self.list.len() as u32);
            }
            self.list.push(of_patch(scene, of, &patch));
        }
        self.environment = Some(Surroundings { of: Arc::clone(of), of_texel });
    }

    /// Adds emissive triangles; pairs that form a parallelogram become one quad.
    fn add_triangles(&mut self, scene: &Scene, sphere_objects: &HashMap<u32, u32>) {
        // Half-edges of single triangles so far, from the bits of their ends; -0 and 0 are the same place.
        type Edge = [[u32; 3]; 2];
        let end = |p: Vec3| (p + 0.0).to_array().map(f32::to_bits);
        let mut half_edges: HashMap<Edge, (u32, usize)> = HashMap::new();
        for (t, triangle) in scene.triangles.iter().enumerate() {
            if let Some(&sphere) = sphere_objects.get(&triangle.object) {
                self.of_triangle[t] = sphere;
                if let Some(e) = self.list.get_mut(sphere as usize) {
                    e.keep_in_front(triangle.vertices.map(|v| scene.positions[v as usize]));
                }
                continue;
            }
            let material = &scene.materials[triangle.material as usize];
            if material.emission.max_element() <= 0.0 {
                continue;
            }
            let corners = triangle.vertices.map(|v| scene.positions[v as usize]);
            let partner = (0..3).find_map(|k| {
                let (a, b, c) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
                let &(other, apex) = half_edges.get(&[end(b), end(a)])?;
                let candidate = &scene.triangles[other as usize];
                let opposite = scene.positions[candidate.vertices[apex] as usize];
                let size = (b - a).length().max((c - a).length()).max((c - b).length());
                // The corner across from c must be a + b - c, to the rounding of the coordinates.
                let rounding = 1e-5 * size + 4.0 * f32::EPSILON * (a.abs().max(b.abs()).max_element());
                let fits = ((a + b - c) - opposite).abs().max_element() <= rounding;
                let same = candidate.material == triangle.material;
                (same && fits && patterns::continue_over(scene, triangle, candidate, k, apex)).then_some((other, k))
            });
            if let Some((other, k)) = partner {
                // Corner c with its two edges; counter-clockwise c, a, opposite, b.
                let (a, b, c) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
                let index = self.of_triangle[other as usize];
                self.of_triangle[t] = index;
                self.list[index as usize] = Emitter {
                    pattern: patterns::of_face(scene, triangle, (k + 2) % 3),
                    ..of_surface(Kind::Quad, [c, a - c, b - c], material)
                };
                let v = scene.triangles[other as usize].vertices.map(|v| scene.positions[v as usize]);
                for i in 0..3 {
                    half_edges.remove(&[end(v[i]), end(v[(i + 1) % 3])]);
                }
                continue;
            }
            self.of_triangle[t] = self.list.len() as u32;
            let [a, b, c] = corners;
            self.list.push(Emitter {
                pattern: patterns::of_face(scene, triangle, 0),
                ..of_surface(Kind::Triangle, [a, b - a, c - a], material)
            });
            for k in 0..3 {
                half_edges.insert([end(corners[k]), end(corners[(k + 1) % 3])], (t as u32, (k + 2) % 3));
            }
        }
    }

    /// Builds the distribution by power.
    fn distribute(&mut self) -> Result<()> {
        let weight = |e: &Emitter| f64::from(mean(e.power));
        // No emitters sum up to -0.
        let total = self.list.iter().map(weight).sum::<f64>() + 0.0;
        // The comparison is written so that NaN fails it.
        if !(total > 0.0 && total.is_finite()) {
            let mend =
                if total > 0.0 { "lower their emission" } else { "give the scene a light or an emissive material" };
            return Err(Error::Scene(format!(
                "the {} lights and emissive faces have a total power of {total} W; {mend}",
                self.list.len()
            )));
        }
        let (mut sum, mut lower) = (0.0, 0.0f32);
        // Emitters without power after the last one with power must not get the rounding remainder.
        let last = self.list.iter().rposition(|e| weight(e) > 0.0).unwrap_or(0);
        for (i, e) in self.list.iter_mut().enumerate() {
            sum += weight(e);
            let upper = if i >= last { 1.0 } else { (sum / total) as f32 };
            e.probability = upper - lower;
            lower = upper;
            self.cdf.push(upper);
            self.power += e.power;
            if e.is_delta() {
                self.delta.push(i);
            }
        }
        Ok(())
    }

    /// Chooses an emitter with `u` in [0, 1): the first whose interval ends above `u`. Also returns `u` rescaled to [0, 1).
    pub fn choose(&self, u: f32) -> (u32, f32) {
        let (mut low, mut high) = (0, self.cdf.len() - 1);
        while low < high {
            let middle = (low + high) / 2;
            if self.cdf[middle] > u {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        let lower = if low > 0 { self.cdf[low - 1] } else { 0.0 };
        let stretched = (u - lower) / self.list[low].probability;
        (low as u32, stretched.clamp(0.0, ONE_MINUS_EPSILON))
    }

    /// The emitter of a triangle at a position on it, or [`NO_EMITTER`].
    pub fn at(&self, triangle: u32, position: Vec3) -> u32 {
        let index = self.of_triangle[triangle as usize];
        self.parts.get(&index).map_or(index, |parts| parts.at(position))
    }

    /// Start of a particle from three numbers in [0, 1): the first also chooses the emitter, `side` the side of a
    /// two-sided one. `textures`: those of the scene.
    pub fn sample_start(&self, textures: &[Texture], u0: f32, u1: f32, side: f32) -> Start {
        let (emitter, u0) = self.choose(u0);
        let e = &self.list[emitter as usize];
        if let (Kind::Environment, Some(environment)) = (e.kind, &self.environment) {
            let towards = e.sample_sky(&environment.of, u0, u1);
            let radiance = environment.of.radiance(towards);
            let disc = PI * e.e2.y * e.e2.y;
            let flux = radiance * (e.area * disc / e.probability);
            return Start { emitter, position: e.p0 + towards * e.e2.y, normal: -towards, flux, radiance };
        }
        let (position, normal) = e.sample_point(u0, u1, side);
        if e.pattern.is_some() {
            let radiance = e.radiance_at(textures, u0, u1);
            let flux = radiance * (e.white_power() / e.probability);
            let radiance = radiance * cosine::flatness(e.exponent);
            return Start { emitter, position, normal, flux, radiance };
        }
        let radiance = e.radiance * cosine::flatness(e.exponent);
        Start { emitter, position, normal, flux: e.power / e.probability, radiance }
    }

    /// Direction in which a particle leaves its start; distributed as the emitter's radiance times the cosine.
    pub fn sample_direction(&self, start: &Start, u: [f32; 2]) -> Vec3 {
        let e = &self.list[start.emitter as usize];
        let around = |w: Vec3| {
            let (t, b) = basis(start.normal);
            t * w.x + b * w.y + start.normal * w.z
        };
        match e.kind {
            Kind::Triangle | Kind::Quad | Kind::Sphere | Kind::Imported => around(cosine::sample(u, e.exponent)),
            Kind::Point => uniform_sphere(u),
            Kind::Spot => {
                // Exact inversion of the falloff's integral over the cosine: first the full cone, then the ramp, whose
                // falloff is the square of a number s from 1 to 0.
                let (inner, outer) = (e.e1.x, e.e1.y);
                let (full, ramp) = (1.0 - inner, (inner - outer) * (1.0 / 3.0));
                let x = u[0] * (full + ramp);
                let cos = if x < full {
                    1.0 - x
                } else {
                    let s3 = (1.0 - (x - full) / ramp).clamp(0.0, 1.0);
                    outer + s3.powf(1.0 / 3.0) * (inner - outer)
                };
                let sin = (1.0 - cos * cos).max(0.0).sqrt();
                let phi = TAU * u[1];
                around(Vec3::new(sin * phi.cos(), sin * phi.sin(), cos))
            }
            Kind::Directional => e.normal,
            Kind::Environment => start.normal,
        }
    }

    /// Point at which the ray of a particle begins, given the numbers of its direction.
    pub fn ray_origin(&self, start: &Start, u: [f32; 2]) -> Vec3 {
        let e = &self.list[start.emitter as usize];
        if e.kind != Kind::Environment {
            return start.position;
        }
        let (t, b) = basis(start.normal);
        let (r, phi) = (e.e2.y * u[0].sqrt(), TAU * u[1]);
        start.position + t * (r * phi.cos()) + b * (r * phi.sin())
    }

    /// Density over solid angle of choosing a direction towards the environment.
    pub fn environment_pdf(&self, towards: Vec3) -> f32 {
        let Some(environment) = &self.environment else { return 0.0 };
        let [x, y] = environment.of.texel_at(towards);
        self.density_of(environment.of_texel[(y * environment.of.width + x) as usize])
    }

    /// Density over solid angle of the directions of a part of the environment, 0 for [`NO_EMITTER`].
    pub fn density_of(&self, emitter: u32) -> f32 {
        self.list.get(emitter as usize).map_or(0.0, |e| e.probability / e.area)
    }

    /// Mean exitance over pi times area over all emitters: their power over pi.
    pub fn emission(&self) -> f32 {
        self.list.iter().map(|e| mean(e.power)).sum::<f32>() / PI
    }

    /// The emitters in device form.
    pub fn records(&self) -> Vec<EmitterRecord> {
        let vec4 = |a: Vec3, w: f32| [a.x, a.y, a.z, w];
        let one = |(e, &end): (&Emitter, &f32)| {
            let flags = if e.two_sided { FLAG_TWO_SIDED } else { 0 } | if e.inward { FLAG_INWARD } else { 0 };
            let whole = e.pattern.map_or(e.power, |p| p.factor * e.white_power());
            let flux = if e.probability > 0.0 { whole / e.probability } else { Vec3::ZERO };
            let [uv, along_1, along_2] = e.pattern.map_or([Vec2::ZERO; 3], |p| p.uvs);
            let texture = e.pattern.map_or(0, |p| 1f32.to_bits() | (p.texture + 1));
            EmitterRecord {
                p0: vec4(e.p0, f32::from_bits(e.kind as u32)),
                e1: vec4(e.e1, e.area),
                e2: vec4(e.e2, f32::from_bits(flags)),
                normal: vec4(e.normal, e.probability),
                radiance: vec4(e.radiance, end),
                flux: vec4(flux, e.exponent),
                uv: [uv.x, uv.y, along_1.x, along_1.y],
                pattern: [along_2.x, along_2.y, f32::from_bits(texture), cosine::flatness(e.exponent)],
            }
        };
        self.list.iter().zip(&self.cdf).map(one).collect()
    }
}

impl Emitter {
    /// Point on the emitter from the unit square, and the axis of its emission there.
    pub fn sample_point(&self, u0: f32, u1: f32, side: f32) -> (Vec3, Vec3) {
        let flipped = if self.two_sided && side < 0.5 { -self.normal } else { self.normal };
        match self.kind {
            Kind::Triangle | Kind::Quad => {
                let [a, b] = self.along_edges(u0, u1);
                (self.p0 + self.e1 * a + self.e2 * b, flipped)
            }
            Kind::Sphere => {
                let n = uniform_sphere([u0, u1]);
                (self.p0 + n * self.e1.x, if self.inward { -n } else { n })
            }
            Kind::Directional => {
                let r = u0.sqrt();
                let phi = TAU * u1;
                (self.p0 + self.e1 * (r * phi.cos()) + self.e2 * (r * phi.sin()), self.normal)
            }
            Kind::Point => (self.p0, Vec3::Z),
            Kind::Spot | Kind::Imported | Kind::Environment => (self.p0, self.normal),
        }
    }

    /// Coordinates along the edges of a triangle or quad from the unit square.
    fn along_edges(&self, u0: f32, u1: f32) -> [f32; 2] {
        let s = (1.0 - u0).sqrt();
        if self.kind == Kind::Triangle { [s * (1.0 - u1), s * u1] } else { [u0, u1] }
    }

    /// Radiance along the normal at the point of [`Emitter::sample_point`]; `textures`: those of the scene.
    pub fn radiance_at(&self, textures: &[Texture], u0: f32, u1: f32) -> Vec3 {
        self.pattern.map_or(self.radiance, |pattern| pattern.radiance(textures, self.along_edges(u0, u1)))
    }

    /// Power of a triangle or quad of radiance 1 along its normal: 2 pi / (d + 1) times the area of its sides.
    fn white_power(&self) -> f32 {
        cosine::exitance(self.exponent) * self.area * if self.two_sided { 2.0 } else { 1.0 }
    }

    /// Direction towards a part of an environment from the unit square.
    pub fn sample_sky(&self, environment: &Environment, u0: f32, u1: f32) -> Vec3 {
        environment.direction(self.e1.x + self.e1.y * u1, self.e1.z + self.e2.x * u0)
    }

    /// Moves the starting radius of a sphere in front of one of its triangles.
    fn keep_in_front(&mut self, corners: [Vec3; 3]) {
        let [a, b, c] = corners.map(|p| p - self.p0);
        if self.inward {
            // The plane's distance is at most that of the triangle's nearest point.
            self.e1.x = self.e1.x.min(a.dot(unit_normal(b - a, c - a)).abs());
        } else {
            self.e1.x = self.e1.x.max(a.length()).max(b.length()).max(c.length());
        }
    }

    /// Radiant intensity of a point-like emitter (point, spot, virtual) in a unit direction that leaves it.
    pub fn intensity(&self, direction: Vec3) -> Vec3 {
        match self.kind {
            Kind::Point => self.radiance,
            Kind::Spot => self.radiance * spot_falloff(self.normal.dot(direction), self.e1.x, self.e1.y),
            Kind::Imported => {
                let falloff = cosine::power(self.normal.dot(direction).max(0.0), self.exponent);
                self.radiance * (falloff * cosine::sharpness(self.exponent) * (1.0 / PI))
            }
            Kind::Triangle | Kind::Quad | Kind::Sphere | Kind::Directional | Kind::Environment => Vec3::ZERO,
        }
    }
}

/// Falloff of a spot as in KHR_lights_punctual: 1 inside the inner cone, 0 outside the outer, a squared ramp of the cosine
/// between.
pub fn spot_falloff(cos: f32, cos_inner: f32, cos_outer: f32) -> f32 {
    let s = ((cos - cos_outer) / (cos_inner - cos_outer).max(1e-6)).clamp(0.0, 1.0);
    s * s
}

/// Uniform direction: cylindrical equal-area map of the unit square.
pub fn uniform_sphere(u: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u[0];
    let r = (1.0 - z * z).max(0.0).sqrt();
    let phi = TAU * u[1];
    Vec3::new(r * phi.cos(), r * phi.sin(), z)
}

#[cfg(test)]
mod tests;
