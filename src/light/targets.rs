//! Targets of photons: mirrors and bodies of glass (Wald et al. 2002, section 4).
//!
//! Triangles of ideal materials that share corners form a body; many bodies are grouped, and a body whose triangles are strewn thinly in
//! its bounding sphere, as those of a frame, is divided. From a point y a photon is shot at a target t, with area A_t and a bounding
//! sphere of radius R_t at distance d_t, chosen with probability
//!
//! ```text
//! p_t = w_t / sum w      w_t = rho_t r_t^2 / max(d_t^2, R_t^2), about its solid angle times its mean reflectance or transmittance rho_t,
//!                              and from an oriented emitter times the greatest cosine towards its sphere
//!                        w_t = rho_t r_t^2 for parallel light
//! ```
//!
//! Where planar mirrors reflect virtual lights ([`crate::light::mirrors`]), photons bring only what they reflect on to other mirrors and glass:
//! a target of such mirrors alone has [`MIRRORED`] of its weight then, so that more photons pass through glass.
//!
//! A target whose area fills its sphere, A_t / (4 pi R_t^2) >= [`FILLS`], is aimed at by its sphere, r_t = R_t: in a direction uniform in
//! the cone of solid angle Omega around it; from inside the sphere, in a direction distributed as the emission. A sparse one is aimed
//! at by its triangles, r_t^2 = A_t / (2 pi), from points farther away than [`FAR`] radii: at a point uniform on its area, at the distance d
//! and with the cosine cos' there. From nearer points it is aimed at and weighed by its sphere too, so that
//! no flux is without bound.
//! The flux of a photon, if it were the only one, is the emission over the density of start and direction:
//!
//! ```text
//!                              by the sphere                        from inside   by triangles
//! surfaces, virtual lights     Phi / pi cos Omega / p_t             Phi / p_t     Phi / pi cos cos' A_t / (d^2 p_t)
//! point, spot                  I(w) / p_e Omega / p_t                             I(w) / p_e cos' A_t / (d^2 p_t)
//! parallel light               E pi R_t^2 / (p_e p_t), from a                     E cos' A_t / (p_e p_t)
//!                              uniform point of the sphere's disc
//! ```
//!
//! with Phi = power / p_e. A photon counts only if the first triangle that it hits belongs to the chosen target, or is the triangle
//! aimed at: each gets light only from its own photons, so targets may hide and overlap each other.

use crate::accel::{Bvh, unit_normal};
use crate::bsdf::{basis, sample_diffuse};
use crate::light::cosine;
use crate::light::emitters::{Emitters, Kind, Start};
use crate::light::mirrors::Mirrors;
use crate::pass::layout::PointLight;
use crate::pass::shade::light_towards;
use crate::scene::{Scene, Surface, Texture};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::collections::HashMap;
use std::f32::consts::{FRAC_1_PI, PI, TAU};
use std::ops::Range;

/// Maximum number of targets: a shader visits all of them for each photon.
pub const MAX_TARGETS: usize = 64;

/// Minimum share of a sphere's area that a target aimed at by the sphere has.
pub const FILLS: f32 = 0.3;

/// A sparse target is aimed at by its triangles from points farther away than this many radii.
pub const FAR: f32 = 4.0;

/// Targets of a smaller share of their sphere's area are divided while there are few.
const STREWN: f32 = 0.05;

/// Factor of the weight of planar mirrors that reflect virtual lights. Higher: fewer photons for caustics of glass. Lower: more noise in light that
/// meets another mirror or glass after such a mirror.
pub const MIRRORED: f32 = 0.25;

/// Bit of a target whose triangles are planar mirrors, beside the first of them, as kernels read it.
pub const PLANAR: u32 = 1 << 31;

/// Minimum mean reflectance in the weight of a triangle, so that none is left out.
const MIN_REFLECTANCE: f32 = 0.05;

/// A bounding sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub center: Vec3,
    /// Radius, slightly larger than that of the triangles.
    pub radius: f32,
}

/// A body of mirrors or glass, part of one, or several.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// Bounding sphere.
    pub sphere: Sphere,
    /// rho_t r_t^2.
    pub weight: f32,
    /// Area of a sparse target.
    pub area: f32,
    /// Its triangles in [`Targets::triangles`]; empty unless it is sparse.
    pub triangles: Range<usize>,
    /// Whether all its triangles are planar mirrors that may reflect virtual lights.
    pub planar: bool,
}

impl Target {
    /// Factor of its weight.
    fn part(&self, mirrored_lights: bool) -> f32 {
        if self.planar && mirrored_lights { MIRRORED } else { 1.0 }
    }

    /// Whether a sparse target is aimed at by its triangles from a point, `to` its centre.
    fn is_far(&self, to: Vec3) -> bool {
        let reach = FAR * self.sphere.radius;
        to.length_squared() >= reach * reach
    }

    /// Weight in the choice from a point, on a surface with this normal if it has one. `mirrored_lights`: planar mirrors reflect virtual lights.
    pub fn weight_from(&self, origin: Vec3, normal: Option<Vec3>, mirrored_lights: bool) -> f32 {
        let (to, radius) = (self.sphere.center - origin, self.sphere.radius);
        let by_sphere = !self.triangles.is_empty() && !self.is_far(to);
        let weight = self.weight
            * self.part(mirrored_lights)
            * if by_sphere { TAU * (radius * radius) / self.area } else { 1.0 };
        let distance2 = to.length_squared();
        weight / distance2.max(radius * radius) * normal.map_or(1.0, |normal| greatest_cosine(to, radius, normal))
    }
}

/// The greatest cosine between a normal and the directions to a sphere, `to` its centre.
fn greatest_cosine(to: Vec3, radius: f32, normal: Vec3) -> f32 {
    let distance2 = to.length_squared().max(1e-37);
    let sine2 = (radius * radius / distance2).min(1.0);
    let half = (1.0 - sine2).sqrt();
    let axis = (to.dot(normal) / distance2.sqrt()).clamp(-1.0, 1.0);
    match () {
        () if axis >= half => 1.0,
        () if axis <= 0.0 && axis * axis >= sine2 => 0.0,
        () => axis * half + ((1.0 - axis * axis) * sine2).sqrt(),
    }
}

/// A triangle of a sparse target, as kernels read it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct TargetTriangle {
    /// First vertex; w: area of the target's triangles up to this one, included.
    pub v0: [f32; 4],
    /// First edge; w: bits of its number in the tree.
    pub e1: [f32; 4],
    /// Second edge.
    pub e2: [f32; 4],
}

/// The targets of a scene.
#[derive(Clone, Debug, Default)]
pub struct Targets {
    /// Empty without ideal surfaces.
    pub list: Vec<Target>,
    /// Triangles of the sparse targets, one target after the other.
    pub triangles: Vec<TargetTriangle>,
    /// Target of each triangle of the tree, as index + 1, or 0.
    pub of_triangle: Vec<u32>,
}

/// A photon on its way to a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Target + 1; or [`MAX_TARGETS`] + 1 + the number of the triangle aimed at.
    pub aim: u32,
    /// Unit direction.
    pub direction: Vec3,
    /// Origin of the ray.
    pub origin: Vec3,
    /// Flux if it were the only photon; 0: nothing is emitted there.
    pub flux: Vec3,
}

impl Targets {
    /// Finds the bodies. More than [`MAX_TARGETS`] are grouped by position.
    pub fn of(scene: &Scene, bvh: &Bvh, mirrors: &Mirrors) -> Targets {
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

        let area = |i: u32| {
            let [a, b, c] = corners(i);
            0.5 * (b - a).cross(c - a).length()
        };
        divide(&mut groups, &corners, &area);

        let averages: Vec<Vec3> = scene.textures.iter().map(Texture::average).collect();
        let mut targets = Targets { of_triangle: vec![0; bvh.triangle_count() as usize], ..Targets::default() };
        for triangles in groups {
            let sphere = bounding_sphere(&triangles, &corners);
            let areas: f32 = triangles.iter().map(|&i| area(i)).sum();
            let reflected = triangles.iter().map(|&i| {
                let material = &scene.materials[bvh.material(i) as usize];
                area(i) * material.mean_ideal(&averages).max(MIN_REFLECTANCE)
            });
            let rho = reflected.sum::<f32>() / areas.max(f32::MIN_POSITIVE);
            let sparse = fill(areas, &sphere) < FILLS;
            let first = targets.triangles.len();
            if sparse {
                let mut sum = 0.0;
                targets.triangles.extend(triangles.iter().map(|&i| {
                    let [a, b, c] = corners(i);
                    sum += area(i);
                    TargetTriangle {
                        v0: a.extend(sum).to_array(),
                        e1: (b - a).extend(f32::from_bits(i)).to_array(),
                        e2: (c - a).extend(0.0).to_array(),
                    }
                }));
            }
            let r2 = if sparse { areas / TAU } else { sphere.radius * sphere.radius };
            let planar =
                triangles.iter().all(|&i| mirrors.of_triangle.get(i as usize).is_some_and(|&mirror| mirror > 0));
            let number = targets.list.len() as u32 + 1;
            triangles.iter().for_each(|&i| targets.of_triangle[i as usize] = number);
            targets.list.push(Target {
                sphere,
                weight: rho * r2,
                area: areas,
                triangles: first..targets.triangles.len(),
                planar,
            });
        }
        targets
    }

    /// Whether a photon with this [`Shot::aim`] counts when it first meets a triangle of the tree.
    pub fn meets(&self, aim: u32, triangle: u32) -> bool {
        let by_triangle = (MAX_TARGETS as u32 + 1).checked_add(triangle) == Some(aim);
        by_triangle || aim <= MAX_TARGETS as u32 && aim == self.of_triangle[triangle as usize]
    }

    /// Shoots a photon from a start (its ray may begin at `origin`) by three numbers in [0, 1): one for the target, two for the
    /// direction. `None` if all targets are behind the emitter. `mirrored_lights`: see [`Target::weight_from`].
    pub fn shoot(
        &self,
        emitters: &Emitters,
        start: &Start,
        origin: Vec3,
        (choice, mirrored_lights): (f32, bool),
        leave: [f32; 2],
    ) -> Option<Shot> {
        let e = &emitters.list[start.emitter as usize];
        let parallel = matches!(e.kind, Kind::Directional | Kind::Environment);
        let oriented = !parallel && !matches!(e.kind, Kind::Point | Kind::Spot);
        // Irradiance across parallel light over the probability, and a way back that leads out of the scene.
        let (irradiance, back) = match e.kind {
            Kind::Environment => (start.radiance * (e.area / e.probability), e.e2.y),
            _ => (e.radiance / e.probability, e.e1.length()),
        };
        let axis = start.normal;
        let (target, p) = self.choose(origin, oriented.then_some(start.normal), parallel, (choice, mirrored_lights))?;
        let sphere = self.list[target].sphere;
        let shot = |origin: Vec3, direction: Vec3, flux: Vec3| {
            Some(Shot { aim: target as u32 + 1, origin, direction, flux: flux / p })
        };
        let intensity = |direction: Vec3| match e.kind {
            Kind::Point | Kind::Spot => e.intensity(direction) / e.probability,
            _ => {
                let falloff = cosine::power(start.normal.dot(direction).max(0.0), e.exponent);
                start.flux * (FRAC_1_PI * cosine::sharpness(e.exponent) * falloff)
            }
        };
        if let Some(place) = self.place(target, origin, parallel, leave) {
            let (origin, direction, flux) = if parallel {
                // In front of the whole scene.
                let from = place.position - axis * (2.0 * back);
                (from, axis, irradiance * (place.facing(axis) * place.area))
            } else {
                let (direction, over_density) = place.from(origin);
                (origin, direction, intensity(direction) * over_density)
            };
            return Some(Shot { aim: MAX_TARGETS as u32 + 1 + place.triangle, origin, direction, flux: flux / p });
        }
        if parallel {
            let (t, b) = basis(axis);
            let (r, phi) = (sphere.radius * leave[0].sqrt(), TAU * leave[1]);
            // The disc is in front of the whole scene.
            let centre = sphere.center - axis * (2.0 * back);
            let from = centre + t * (r * phi.cos()) + b * (r * phi.sin());
            return shot(from, axis, irradiance * (PI * sphere.radius * sphere.radius));
        }
        let Some((direction, solid_angle)) = in_cone(&sphere, origin, leave) else {
            return shot(origin, emitters.sample_direction(start, leave), start.flux);
        };
        shot(origin, direction, intensity(direction) * solid_angle)
    }

    /// Shoots a photon from a virtual light, as [`Targets::shoot`]; its flux is that of this light alone.
    pub fn shoot_from(&self, light: &PointLight, choice: (f32, bool), leave: [f32; 2]) -> Option<Shot> {
        let xyz = |v: [f32; 4]| Vec3::new(v[0], v[1], v[2]);
        let (origin, normal) = (xyz(light.position), xyz(light.normal));
        let (target, p) = self.choose(origin, Some(normal), false, choice)?;
        let place = self.place(target, origin, false, leave);
        let (direction, over_density) = match &place {
            Some(place) => place.from(origin),
            None => in_cone(&self.list[target].sphere, origin, leave).unwrap_or_else(|| {
                // By the cosine.
                let local = sample_diffuse(leave);
                let (t, b) = basis(normal);
                (t * local.x + b * local.y + normal * local.z, PI / local.z)
            }),
        };
        // Lights that photons start from have no lobe.
        let flux = light_towards(&[], light, -direction, 1.0, 0.0) * (over_density / p);
        let aim = place.map_or(target as u32 + 1, |place| MAX_TARGETS as u32 + 1 + place.triangle);
        Some(Shot { aim, origin, direction, flux })
    }

    /// A uniform point on a sparse target that is far enough; `None`: it is aimed at by its sphere.
    fn place(&self, target: usize, origin: Vec3, parallel: bool, [x, y]: [f32; 2]) -> Option<Place> {
        let target = &self.list[target];
        if target.triangles.is_empty() || !parallel && !target.is_far(target.sphere.center - origin) {
            return None;
        }
        let triangles = &self.triangles[target.triangles.clone()];
        let at = x * target.area;
        let i = triangles.partition_point(|t| t.v0[3] <= at).min(triangles.len() - 1);
        let (t, before) = (&triangles[i], if i > 0 { triangles[i - 1].v0[3] } else { 0.0 });
        let [v0, e1, e2] = [t.v0, t.e1, t.e2].map(|v| Vec3::new(v[0], v[1], v[2]));
        let root = ((at - before) / (t.v0[3] - before).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0).sqrt();
        let position = v0 + e1 * (1.0 - root) + e2 * (y * root);
        Some(Place { position, normal: unit_normal(e1, e2), area: target.area, triangle: t.e1[3].to_bits() })
    }

    /// Chooses a target for a start, by solid angle (for parallel light: by area), and the probability of the choice. `normal`: of
    /// the surface that emits.
    fn choose(
        &self,
        origin: Vec3,
        normal: Option<Vec3>,
        parallel: bool,
        (choice, mirrored_lights): (f32, bool),
    ) -> Option<(usize, f32)> {
        let weight = |target: &Target| {
            if parallel {
                target.weight * target.part(mirrored_lights)
            } else {
                target.weight_from(origin, normal, mirrored_lights)
            }
        };
        let weights: Vec<f32> = self.list.iter().map(weight).collect();
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

/// A point on a sparse target.
struct Place {
    position: Vec3,
    normal: Vec3,
    /// Area of the target.
    area: f32,
    /// Number in the tree.
    triangle: u32,
}

impl Place {
    /// Cosine between its normal, on either side, and a direction.
    fn facing(&self, direction: Vec3) -> f32 {
        self.normal.dot(direction).abs()
    }

    /// The direction to it, and one over the density of that direction.
    fn from(&self, origin: Vec3) -> (Vec3, f32) {
        let to = self.position - origin;
        let direction = to.normalize();
        (direction, self.facing(direction) * self.area / to.length_squared())
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

/// Share of the sphere's area that this area has.
fn fill(area: f32, sphere: &Sphere) -> f32 {
    area / (4.0 * PI * sphere.radius * sphere.radius)
}

/// Divides strewn groups, the widest first, while there are fewer than [`MAX_TARGETS`].
fn divide(groups: &mut Vec<Vec<u32>>, corners: &impl Fn(u32) -> [Vec3; 3], area: &impl Fn(u32) -> f32) {
    let width = |triangles: &Vec<u32>| {
        let sphere = bounding_sphere(triangles, corners);
        let strewn = triangles.len() > 1 && fill(triangles.iter().map(|&i| area(i)).sum(), &sphere) < STREWN;
        if strewn { sphere.radius } else { 0.0 }
    };
    let mut widths: Vec<f32> = groups.iter().map(width).collect();
    while groups.len() < MAX_TARGETS {
        let Some(widest) = (0..groups.len()).max_by(|&a, &b| widths[a].total_cmp(&widths[b])) else { return };
        if widths[widest] == 0.0 {
            return;
        }
        let mut triangles = std::mem::take(&mut groups[widest]);
        let (low, high) = box_of(&triangles, corners);
        let axis = (high - low).max_position();
        triangles.sort_by(|&a, &b| {
            let middle = |i: u32| corners(i).map(|p| p[axis]).iter().sum::<f32>();
            middle(a).total_cmp(&middle(b)).then(a.cmp(&b))
        });
        let second = triangles.split_off(triangles.len() / 2);
        (widths[widest], groups[widest]) = (width(&triangles), triangles);
        widths.push(width(&second));
        groups.push(second);
    }
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
