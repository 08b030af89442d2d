//! Splats show the indirect light that glossy surfaces reflect (Bastos 1999, equation 7.5): a point x on a surface with hits j, which
//! arrived from omega_j after one bounce or more, sends to the eye
//!
//! ```text
//! L(x, omega) += 1 / (h^2 c(x)) sum_j f_r(omega_j, x, omega) Phi_j / m  k((x - x_j) / h)
//! k(y) = a exp(-8 y^2) for y < 1/2
//! ```
//!
//! with f_r the lobe alone, m the number of particles, a such that k integrates to 1, and c(x) the part of the kernel around x that lies
//! on the surface. Virtual lights on emitters bring the highlights of direct light (7.3.2.1), and the light of the diffuse base.
//!
//! Differs from the thesis in that: kernels are gathered through a grid and not drawn; f_r takes the point's own normal, roughness and
//! direction to the eye, not those of the hit; and c, which is 1 there, keeps planar surfaces as bright at their rims as within. c is
//! exact for surfaces with up to 64 straight edges ([`crate::scene::surfaces`]).
//!
//! Bias: reflections are blurred over h, across shadows too; curved surfaces darken towards their open rims.
//!
//! Cost for each point that `splat_find` has listed: 27 look-ups of 8 bytes; a texel and 20 operations for each of some 2 C^2 candidates,
//! and a texel and 100 operations for each of some pi C^2 / 4 hits within the kernel; 200 operations for each edge. The lanes of a subgroup
//! go through their candidates each in its own cells, and evaluate the lobe for all hits of a block of candidates together: candidate by
//! candidate nearly all evaluations would be masked out. A dispatch takes as many candidates as its loops may.

use glam::Vec3;
use std::f32::consts::PI;

use super::layout::FrameParameters;
use super::shade::ShadingPoint;
use super::splat_grid::Grid;
use super::{BoundKernel, Kit, Lighting, List, ShadingPoints, push};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::scene::Material;

/// Exponent of the kernel: its standard deviation is h / 4.
pub const SHARPNESS: f32 = 8.0;

/// Smallest part of a kernel that a light is divided by. Shader twin: `MIN_COVERED`.
pub const MIN_COVERED: f32 = 1e-3;

/// The pass.
pub struct SplatLight {
    kernel: BoundKernel,
    round_groups: Buffer,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// The shading points of the eye.
    pub points: &'a ShadingPoints,
    /// Slots and surfaces of those that splats show.
    pub found: &'a List,
    /// The hits of particles.
    pub grid: &'a Grid,
    /// State of the store, a [`super::splat_start::SplatState`].
    pub state: &'a Buffer,
    /// Areas and outlines of the surfaces, and h of each.
    pub surfaces: [&'a Buffer; 3],
    /// Indirect dispatches, one for each round.
    pub round_groups: &'a Buffer,
    /// Light of the points.
    pub lighting: &'a Lighting,
}

impl SplatLight {
    /// Adds to the specular radiance of `lighting`.
    pub fn new(kit: &Kit, inputs: &Inputs, (steps, own): (&Resources, &Resources)) -> Result<Self> {
        let [surfaces, edges, width] = inputs.surfaces;
        let set = Resources::of([
            ("found", &inputs.found.entries),
            ("found_work", &inputs.found.work),
            ("splat_state", inputs.state),
            ("surfaces", surfaces),
            ("surface_edges", edges),
            ("surface_width", width),
        ]);
        let sets =
            [&inputs.points.resources(), &inputs.grid.resources(), &inputs.lighting.resources(), &set, steps, own];
        Ok(SplatLight { kernel: kit.bind(&shaders::SPLAT_LIGHT, &sets)?, round_groups: inputs.round_groups.clone() })
    }

    /// Records the rounds; each step holds the first candidate of its round.
    pub fn record(&self, rec: &mut Recorder, steps: &[u32]) -> Result<()> {
        (0..)
            .zip(steps)
            .try_for_each(|(round, &step)| self.kernel.run_listed(rec, &push(step), &self.round_groups, 16 * round))
    }
}

/// A stored hit.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Its position.
    pub position: Vec3,
    /// Its surface, numbered from 1.
    pub surface: u32,
    /// Flux if there were no other particle.
    pub flux: Vec3,
    /// Direction back along its last ray.
    pub wi: Vec3,
    /// Bounces before it, at most 15.
    pub bounces: u32,
}

impl Hit {
    /// As the device stores it; directions in 2 x 14 bits.
    pub fn words(&self) -> [[u32; 4]; 2] {
        let l = self.wi.abs().element_sum();
        let (x, y) = (self.wi.x / l, self.wi.y / l);
        let folded = |own: f32, other: f32| (1.0 - other.abs()) * if own >= 0.0 { 1.0 } else { -1.0 };
        let (u, v) = if self.wi.z >= 0.0 { (x, y) } else { (folded(x, y), folded(y, x)) };
        let [u, v] = [u, v].map(|c| (c.clamp(-1.0, 1.0) * 8191.0 + 8192.5) as u32);
        let [x, y, z] = self.position.to_array().map(f32::to_bits);
        let [r, g, b] = self.flux.to_array().map(f32::to_bits);
        [[x, y, z, self.surface], [r, g, b, u | v << 14 | self.bounces << 28]]
    }

    /// Reads what the device stored.
    pub fn of(words: [[u32; 4]; 2]) -> Hit {
        let [[x, y, z, surface], [r, g, b, word]] = words;
        let coordinate = |shift: u32| ((word >> shift & 16_383) as f32 - 8192.0) / 8191.0;
        let (u, v) = (coordinate(0), coordinate(14));
        let z_of = 1.0 - u.abs() - v.abs();
        let fold = (-z_of).max(0.0);
        let towards_axis = |c: f32| if c >= 0.0 { c - fold } else { c + fold };
        Hit {
            position: Vec3::from([x, y, z].map(f32::from_bits)),
            surface,
            flux: Vec3::from([r, g, b].map(f32::from_bits)),
            wi: Vec3::new(towards_axis(u), towards_axis(v), z_of).normalize(),
            bounces: word >> 28,
        }
    }
}

/// Oracle: k at a distance over h.
pub fn kernel(y: f32) -> f32 {
    let whole = PI / SHARPNESS * (1.0 - (-0.25 * SHARPNESS).exp());
    if y < 0.5 { (-SHARPNESS * y * y).exp() / whole } else { 0.0 }
}

/// Oracle: the part of a kernel of width h around x that lies within an outline in the plane with normal n, by adding up directions.
pub fn coverage(x: Vec3, n: Vec3, edges: &[[Vec3; 2]], h: f32) -> f32 {
    if edges.is_empty() {
        return 1.0;
    }
    let (t, b) = n.any_orthonormal_pair();
    let flat = |p: Vec3| glam::DVec2::new(f64::from((p - x).dot(t)), f64::from((p - x).dot(b))) / f64::from(h);
    let edges: Vec<[glam::DVec2; 2]> = edges.iter().map(|edge| edge.map(flat)).collect();
    let within = |r: f64| 1.0 - (-f64::from(SHARPNESS) * r.min(0.5).powi(2)).exp();
    let turns = 20_000;
    let mut sum = 0.0;
    for i in 0..turns {
        let d = glam::DVec2::from_angle(std::f64::consts::TAU * (f64::from(i) + 0.5) / f64::from(turns));
        for [a, c] in &edges {
            // Where the ray crosses the edge, and whether it leaves or enters there.
            let e = *c - *a;
            let denominator = d.perp_dot(e);
            let (r, s) = (a.perp_dot(e) / denominator, a.perp_dot(d) / denominator);
            if r > 0.0 && (0.0..1.0).contains(&s) {
                sum += within(r) * denominator.signum();
            }
        }
    }
    (sum / f64::from(turns) / within(1.0)).abs() as f32
}

/// Oracle: radiance that splats on a surface add at a shading point with `segments` of the eye path before it. `outline`: h and the part
/// of the kernel that lies on the surface.
pub fn reference(
    frame: &FrameParameters,
    materials: &[Material],
    (receiver, segments): (&ShadingPoint, u32),
    (surface, h, covered): (u32, f32, f32),
    hits: &[Hit],
    particles: u32,
) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for hit in hits.iter().filter(|hit| hit.surface == surface && hit.bounces + 2 + segments <= frame.scene[2]) {
        let (cos_geometric, cos_shading) = (hit.wi.dot(receiver.geometric), hit.wi.dot(receiver.shading));
        if cos_geometric > 0.0 && cos_shading > 0.0 {
            let skew = (cos_shading / cos_geometric.max(1e-7)).min(4.0);
            let k = kernel(hit.position.distance(receiver.position) / h);
            let f = receiver.reflectance.eval_specular(materials, receiver.shading, receiver.wo, hit.wi);
            sum += hit.flux * f * (skew * k);
        }
    }
    sum / (h * h * particles as f32 * covered.clamp(MIN_COVERED, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hits_come_back_as_they_are_stored() {
        for wi in [Vec3::X, Vec3::NEG_Z, Vec3::new(-0.6, 0.0, 0.8), Vec3::new(0.36, -0.48, -0.8)] {
            let hit = Hit { position: Vec3::new(1.0, -2.0, 0.5), surface: 7, flux: Vec3::splat(0.25), wi, bounces: 9 };
            let back = Hit::of(hit.words());
            assert!((back.wi - wi).length() < 3e-4, "{} for {wi}", back.wi);
            assert_eq!((back.position, back.surface, back.flux, back.bounces), (hit.position, 7, hit.flux, 9));
        }
    }

    #[test]
    fn a_kernel_integrates_to_one() {
        let n = 2000;
        let sum: f64 = (0..n)
            .map(|i| {
                let y = 0.5 * (f64::from(i) + 0.5) / f64::from(n);
                f64::from(kernel(y as f32)) * std::f64::consts::TAU * y * 0.5 / f64::from(n)
            })
            .sum();
        assert!((sum - 1.0).abs() < 1e-5, "{sum}");
        // The shader's constants.
        assert!((kernel(0.0) - 1.156_518 * SHARPNESS / PI).abs() < 1e-4);
    }

    #[test]
    fn a_kernel_is_covered_half_at_an_edge_and_a_quarter_at_a_corner() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y];
        let edges: Vec<[Vec3; 2]> = (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]).collect();
        for (x, expected) in
            [(Vec3::new(0.5, 0.5, 0.0), 1.0), (Vec3::new(1e-6, 0.5, 0.0), 0.5), (Vec3::new(1e-6, 1e-6, 0.0), 0.25)]
        {
            let found = coverage(x, Vec3::Z, &edges, 0.4);
            assert!((found - expected).abs() < 1e-3, "{x}: {found}");
        }
        assert_eq!(coverage(Vec3::ZERO, Vec3::Z, &[], 0.4), 1.0);
    }
}
