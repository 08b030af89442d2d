//! Kernels of glossy reflections by angle of view (Bastos 1999, 7.4.2.2 "Getting convolution kernels from BRDFs").
//!
//! A pixel q of a mirror image is spread over a disc of diameter k_r = 4 z_r tan beta (equation 7.7; z_r: distance from the
//! surface to the point mirrored at q). The width of the disc and the distribution of light in it are tabulated here for each
//! material, for [`VIEW_ANGLES`] cosines mu = cos theta_o.
//!
//! # One kernel
//!
//! Let r be the mirror direction of the view, and u, v unit vectors perpendicular to it: u in the plane of incidence, towards the
//! surface normal; v parallel to the surface. The kernel covers the square of side 2 on the plane at unit distance along r, in
//! units of its half widths w = 2 tan beta along u and w' = 2^(-narrowing / 4) w along v; (x, y) in \[-1, 1\]^2 lies in the
//! direction wi = (r + w x u + w' y v) / l, l = |r + w x u + w' y v|, and
//!
//! k(x, y) ~ f(wi, wo) cos theta_i / l^3 within the unit disc, 0 outside and below the horizon,
//!
//! where l^-3 w w' dx dy = d omega_i.
//!
//! # Core and tail
//!
//! The peak of a GGX lobe is much narrower than its tail: one texture, and one level of a pyramid, would lose it. So a
//! kernel is the sum of two parts, each with its own texture and narrowing: the core is the excess over the maximum of the
//! kernel at [`CORE_RADIUS`] of the half width, within that radius; the tail is the rest, with a flat top.
//!
//! A texel is the mean of k over its area; the texels sum to 1. f is the lobe without its
//! Fresnel factor, which is handled by [`reflectance`](super::reflectance). Further values of a kernel:
//!
//! - tan beta: beta is the half angle of the cone about r that receives [`CONE_SHARE`] of the lobe's energy, tan beta at most
//!   [`MAX_TAN_BETA`];
//! - the energy, the integral of f cos theta_i over the hemisphere (directional albedo with F = 1);
//! - narrowing: at grazing angles a lobe is narrow across the plane of incidence, and so is its kernel, by steps of 2^(-1/4): by the
//!   mean distances from r across and along;
//! - grazing, the part of the energy that Schlick's formula weights by F90;
//! - the share of the energy within the ellipse. A splat of this kernel moves the rest, the tail of the lobe, towards the
//!   centre.
//!
//! # Look-up
//!
//! Layer i of [`VIEW_ANGLES`] = N belongs to mu_i = (i + 1) / N. For a material whose first layer is `first`, with `a(i)` =
//! `layers[first + i]`:
//!
//! ```text
//! s = clamp(mu * N - 1, 0, N - 1);  i = floor(s);  j = min(i + 1, N - 1)
//! tan_beta, energy, grazing, core_share = mix(a(i), a(j), s - i)
//! tail = floor(s + 0.5) + 2 first;  core = tail + N
//! weight of texel (p, q) = textures[(tail * 32 + q) * 32 + p],  (x, y) = ((p, q) + 0.5) / 16 - 1
//! ```
//!
//! # Lobes of two widths
//!
//! The kernel of an anisotropic lobe depends on the angle psi between its grain and the plane of incidence too. It is tabulated for [`AZIMUTHS`]
//! angles, each like a lobe of its own: the layers of azimuth k, psi = pi k / [`AZIMUTHS`] from u towards v, begin at
//! `first` + k N, and the look-up takes the nearest.
//!
//! # Differences from the thesis
//!
//! - The thesis takes the cone within which f is not 0, which for most lobes is the hemisphere.
//! - Texels hold means of f cos theta_i over solid angle, not point samples of f: narrow lobes, and lobes at grazing angles,
//!   are narrower than a texel.
//! - The cone is bounded ([`MAX_TAN_BETA`]).
//! - tan beta and energy are interpolated between angles of view, so that the blur has no steps there.
//!
//! Cost: 8 KiB for each layer, 256 KiB a lobe; about 10^5 evaluations of f for each layer, once.

use std::f64::consts::PI;

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::lobe::Lobe;
use crate::bsdf::anisotropic::with_direction;
use crate::error::{Error, Result};

/// Texels along each side of a kernel.
pub const KERNEL_TEXELS: usize = 32;

/// Cosines of the angle of view at which kernels are tabulated; see [`view_cosine`].
pub const VIEW_ANGLES: usize = 32;

/// Share of a lobe's energy within beta of the mirror direction.
pub const CONE_SHARE: f64 = 0.9;

/// Angles between grain and plane of incidence at which kernels of lobes of two widths are tabulated.
pub const AZIMUTHS: usize = 8;

/// Upper bound of tan beta: the disc then reaches 63 degrees from the mirror direction, and its diameter is four times the
/// distance of the mirrored point.
pub const MAX_TAN_BETA: f64 = 1.0;

/// Value of [`GpuKernels::first_layer`] for materials without kernels.
pub const NO_KERNEL: u32 = u32::MAX;

/// Rings of the quadrature about the mirror direction, and directions on one half of each.
const RINGS: usize = 256;
const DIRECTIONS: usize = 128;

/// Samples of each texel along u and v.
const SAMPLES: [usize; 2] = [8, 16];

/// Cosine of the angle of view of a layer: (layer + 1) / [`VIEW_ANGLES`].
pub fn view_cosine(layer: usize) -> f64 {
    (layer + 1) as f64 / VIEW_ANGLES as f64
}

/// Steps of [`Part::narrowing`] in which the width across the plane of incidence halves.
pub const NARROWINGS_TO_HALF: u32 = 4;

/// Maximum [`Part::narrowing`].
pub const MAX_NARROWING: u32 = 4;

/// Radius of the core over that of the whole kernel.
pub const CORE_RADIUS: f64 = 0.3;

/// A part of a kernel as a texture.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The texture's ellipse is 2^(-narrowing / 4) times as wide across the plane of incidence as along it.
    pub narrowing: u32,
    /// [`KERNEL_TEXELS`] rows along v of as many texels along u; they sum to 1.
    pub texture: Vec<f32>,
}

impl Part {
    /// Width of the ellipse across the plane of incidence over that along it.
    pub fn aspect(&self) -> f32 {
        aspect_of(self.narrowing) as f32
    }
}

/// A lobe seen from one direction.
#[derive(Clone, Debug, PartialEq)]
pub struct Kernel {
    /// Tangent of beta, half the tangent of the half angle of the ellipse along the plane of incidence.
    pub tan_beta: f32,
    /// Integral of f cos theta_i over the hemisphere.
    pub energy: f32,
    /// Integral of f cos theta_i (1 - wo.h)^5, h the half vector: with Schlick's formula the lobe reflects
    /// F0 (energy - grazing) + F90 grazing.
    pub grazing: f32,
    /// Share of the energy within the ellipse of the tail.
    pub captured: f32,
    /// Share of the core in the kernel.
    pub core_share: f32,
    /// The kernel minus its core, of half width 2 tan beta.
    pub tail: Part,
    /// The peak, of half width [`CORE_RADIUS`] 2 tan beta.
    pub core: Part,
}

impl Kernel {
    /// The kernel of a lobe for cos theta_o = `mu`, above 0 and at most 1.
    pub fn new(lobe: &Lobe, mu: f64) -> Kernel {
        let view = View::new(lobe, mu);
        let samples = view.samples();
        let mut cumulative = vec![0.0; RINGS + 1];
        let (mut energy, mut grazing) = (0.0, 0.0);
        let of_one = view.sides().len() * DIRECTIONS;
        for (ring, of_ring) in samples.chunks_exact(of_one).enumerate() {
            for sample in of_ring {
                energy += sample.energy;
                grazing += sample.energy * (1.0 - sample.cos_h).powi(5);
            }
            cumulative[ring + 1] = energy;
        }
        let empty = || Part { narrowing: 0, texture: point() };
        if energy <= 0.0 {
            let (tail, core) = (empty(), empty());
            return Kernel { tan_beta: 0.0, energy: 0.0, grazing: 0.0, captured: 0.0, core_share: 0.0, tail, core };
        }
        let beta = angle_of(&cumulative, CONE_SHARE * energy);
        let tan_beta = if beta < MAX_TAN_BETA.atan() { beta.tan() } else { MAX_TAN_BETA };
        let (width, core_width) = (2.0 * tan_beta, CORE_RADIUS * 2.0 * tan_beta);
        let level = view.max_at(core_width);
        let core_of = |s: &Sample| if s.at.length() < core_width { (1.0 - level / s.density).max(0.0) } else { 0.0 };
        let tail_narrowing = narrowing_of(&samples, width, |s| 1.0 - core_of(s));
        let core_narrowing = narrowing_of(&samples, core_width, core_of);
        let within = |(i, s): (usize, &Sample)| {
            // The edge of the ellipse cuts through rings.
            let [inner, outer] = [0.0, 1.0].map(|edge| ring_angle((i / of_one) as f64 + edge).tan());
            let stretch = s.at.x.hypot(s.at.y / aspect_of(tail_narrowing)) / s.at.length();
            let share = (width / stretch - inner) / (outer - inner);
            if s.at.is_finite() && outer > inner { share.clamp(0.0, 1.0) * s.energy } else { 0.0 }
        };
        let captured: f64 = samples.iter().enumerate().map(within).sum();
        let core: f64 = samples.iter().filter(|s| s.energy > 0.0).map(|s| s.energy * core_of(s)).sum();
        let in_core = |k: f64, at: DVec2| if at.length() < core_width { (k - level).max(0.0) } else { 0.0 };
        Kernel {
            tan_beta: tan_beta as f32,
            energy: energy as f32,
            grazing: grazing as f32,
            captured: (captured / energy) as f32,
            core_share: if captured > 0.0 { (core / captured).min(1.0) as f32 } else { 0.0 },
            tail: Part {
                narrowing: tail_narrowing,
                texture: view.texture(width, aspect_of(tail_narrowing), |k, at| k - in_core(k, at)),
            },
            core: Part {
                narrowing: core_narrowing,
                texture: view.texture(core_width, aspect_of(core_narrowing), in_core),
            },
        }
    }
}

impl Kernel {
    /// The kernel of the lobe mirrored in the plane of incidence.
    fn mirrored(&self) -> Kernel {
        let mut image = self.clone();
        for part in [&mut image.tail, &mut image.core] {
            part.texture = part.texture.rchunks(KERNEL_TEXELS).flatten().copied().collect();
        }
        image
    }
}

/// Part of a lobe.
struct Sample {
    /// Position on the plane at unit distance along the mirror direction; infinite if behind it.
    at: DVec2,
    /// Cosine of the angle between view and half vector.
    cos_h: f64,
    /// f cos theta_i d omega_i.
    energy: f64,
    /// f cos theta_i / l^3, the kernel there.
    density: f64,
}

fn aspect_of(narrowing: u32) -> f64 {
    (-f64::from(narrowing) / f64::from(NARROWINGS_TO_HALF)).exp2()
}

/// Narrowing from the mean distances from the mirror direction, across and along, of a part of the kernel within the disc of a
/// half width.
fn narrowing_of(samples: &[Sample], half_width: f64, part: impl Fn(&Sample) -> f64) -> u32 {
    let near = samples.iter().filter(|s| s.at.length() < half_width && s.energy > 0.0);
    let sums = near.map(|s| s.at.abs() * (s.energy * part(s))).sum::<DVec2>();
    if sums.y <= 0.0 || sums.y >= sums.x {
        return 0;
    }
    ((sums.x / sums.y).log2() * f64::from(NARROWINGS_TO_HALF)).min(f64::from(MAX_NARROWING)) as u32
}

/// The kernel of a lobe without energy in its disc.
fn point() -> Vec<f32> {
    let mut texture = vec![0.0; KERNEL_TEXELS * KERNEL_TEXELS];
    let half = KERNEL_TEXELS / 2;
    for (i, j) in [(half - 1, half - 1), (half, half - 1), (half - 1, half), (half, half)] {
        texture[j * KERNEL_TEXELS + i] = 0.25;
    }
    texture
}

/// A lobe, a view direction in the xz plane, and the frame about its mirror direction.
struct View<'a> {
    lobe: &'a Lobe,
    /// It is its own mirror image in the plane of incidence.
    symmetric: bool,
    wo: Vec3,
    /// Mirror direction.
    r: DVec3,
    /// Perpendicular to it, towards the normal.
    u: DVec3,
}

impl View<'_> {
    fn new(lobe: &Lobe, mu: f64) -> View<'_> {
        let sin = (1.0 - mu * mu).max(0.0).sqrt();
        let symmetric = lobe.mirrored() == *lobe;
        View {
            lobe,
            symmetric,
            wo: DVec3::new(sin, 0.0, mu).as_vec3(),
            r: DVec3::new(-sin, 0.0, mu),
            u: DVec3::new(mu, 0.0, sin),
        }
    }

    /// Signs of v that must be looked at: others are mirror images.
    fn sides(&self) -> &'static [f64] {
        if self.symmetric { &[1.0] } else { &[-1.0, 1.0] }
    }

    /// f cos theta_i in the direction r + x u + y v, of any length.
    fn f_cos(&self, along_r: f64, x: f64, y: f64) -> f64 {
        let wi = (self.r * along_r + self.u * x + DVec3::Y * y).normalize();
        if wi.z <= 0.0 { 0.0 } else { f64::from(self.lobe.eval(wi.as_vec3(), self.wo)) * wi.z }
    }

    /// The lobe in parts, ring by ring about r.
    ///
    /// Rings are dense about r, for narrow lobes, and directions are dense in the plane of incidence, where a lobe at grazing
    /// angles is a ridge. Each part also represents its mirror image in that plane, unless there are two [`View::sides`].
    fn samples(&self) -> Vec<Sample> {
        let sides = self.sides();
        let mut samples = Vec::with_capacity(RINGS * DIRECTIONS * sides.len());
        for ring in 0..RINGS {
            let angle = ring_angle(ring as f64 + 0.5);
            let (sin, cos) = angle.sin_cos();
            // d omega = sin dangle dphi, and dangle = 4 angle / rings dring.
            let ring_area = (2.0 * PI / (DIRECTIONS * sides.len()) as f64) * sin * 4.0 * angle / (ring as f64 + 0.5);
            for (side, k) in sides.iter().flat_map(|side| (0..DIRECTIONS).map(move |k| (side, k))) {
                // phi = pi t - sin(2 pi t) / 2 for t from 0 to 1, so dphi ~ 1 - cos(2 pi t).
                let t = 2.0 * PI * (k as f64 + 0.5) / DIRECTIONS as f64;
                let (sin_phi, cos_phi) = (0.5 * (t - t.sin()) * side).sin_cos();
                let wi = self.r * cos + self.u * (sin * cos_phi) + DVec3::Y * (sin * sin_phi);
                let f_cos = self.f_cos(cos, sin * cos_phi, sin * sin_phi);
                samples.push(Sample {
                    at: if cos > 0.0 { DVec2::new(cos_phi, sin_phi) * (sin / cos) } else { DVec2::INFINITY },
                    cos_h: (0.5 * (1.0 + wi.dot(self.wo.as_dvec3()))).max(0.0).sqrt(),
                    energy: f_cos * (1.0 - t.cos()) * ring_area,
                    density: f_cos * cos.powi(3),
                });
            }
        }
        samples
    }

    /// The kernel at position `at` of the plane: f cos theta_i / l^3.
    fn density(&self, at: DVec2) -> f64 {
        let length2 = 1.0 + at.length_squared();
        self.f_cos(1.0, at.x, at.y) / (length2 * length2.sqrt())
    }

    /// The kernel's maximum at a distance from the mirror direction.
    fn max_at(&self, distance: f64) -> f64 {
        let angle = |k: usize| k as f64 * (PI / DIRECTIONS as f64);
        let of = |side: &f64| {
            (0..=DIRECTIONS).map(|k| self.density(DVec2::from_angle(angle(k) * side) * distance)).fold(0.0, f64::max)
        };
        self.sides().iter().map(of).fold(0.0, f64::max)
    }

    /// The texels of a part of the kernel for a half width along u, and that along v over it.
    fn texture(&self, half_width: f64, aspect: f64, part: impl Fn(f64, DVec2) -> f64) -> Vec<f32> {
        let half = KERNEL_TEXELS / 2;
        let texel = 1.0 / half as f64;
        let sides = self.sides();
        // Two halves need no more samples than one for both: without symmetry no ridge lies along an axis.
        let [columns, rows] = SAMPLES.map(|n| n / sides.len());
        let half_of = |side: &f64| {
            let mut means = vec![0.0; KERNEL_TEXELS * half];
            for (index, mean) in means.iter_mut().enumerate() {
                let (i, j) = (index % KERNEL_TEXELS, index / KERNEL_TEXELS);
                for b in 0..rows {
                    // Dense towards v = 0, where a lobe at grazing angles is a ridge narrower than a texel: v = t^2 dv, so dv ~ t dt.
                    let t = (b as f64 + 0.5) / rows as f64;
                    let y = (j as f64 + t * t) * texel;
                    for a in 0..columns {
                        let x = (i as f64 + (a as f64 + 0.5) / columns as f64) * texel - 1.0;
                        if x * x + y * y < 1.0 {
                            let at = DVec2::new(x, y * aspect * side) * half_width;
                            *mean += t * part(self.density(at), at);
                        }
                    }
                }
            }
            means
        };
        // For one side alone the other mirrors it.
        let halves: Vec<Vec<f64>> = sides.iter().map(half_of).collect();
        let [below, above] = [&halves[0], &halves[sides.len() - 1]];
        let total = below.iter().sum::<f64>() + above.iter().sum::<f64>();
        if total <= 0.0 {
            return point();
        }
        let row = |j: usize| if j < half { (below, half - 1 - j) } else { (above, j - half) };
        let texels = (0..KERNEL_TEXELS).flat_map(|j| {
            let (means, j) = row(j);
            &means[j * KERNEL_TEXELS..][..KERNEL_TEXELS]
        });
        texels.map(|mean| (mean / total) as f32).collect()
    }
}

/// Angle from the mirror direction after a number of rings.
fn ring_angle(rings: f64) -> f64 {
    PI * (rings / RINGS as f64).powi(4)
}

/// The angle that contains a given energy.
fn angle_of(cumulative: &[f64], energy: f64) -> f64 {
    let ring = cumulative.partition_point(|&c| c < energy).clamp(1, RINGS) - 1;
    let (low, high) = (cumulative[ring], cumulative[ring + 1]);
    ring_angle(ring as f64 + if high > low { (energy - low) / (high - low) } else { 1.0 })
}

/// The kernels of all glossy materials of a scene. Materials with equal lobes share theirs.
#[derive(Clone, Debug, Default)]
pub struct KernelLibrary {
    /// One lobe for each [`VIEW_ANGLES`] layers; the azimuths of a lobe of two widths stand one behind the other.
    lobes: Vec<Lobe>,
    layers: Vec<Kernel>,
    /// First layer of each material; [`NO_KERNEL`] if none was added.
    first_layer: Vec<u32>,
}

/// The tables in device form; the look-up is in the [module's documentation](self).
#[derive(Clone, Debug, PartialEq)]
pub struct GpuKernels {
    /// [`KERNEL_TEXELS`]^2 texels each: for every lobe the tails of its layers, then their cores.
    pub textures: Vec<f32>,
    /// [`Part::narrowing`] of each texture.
    pub narrowings: Vec<u32>,
    /// (tan beta, energy, grazing, share of the core) of each layer.
    pub layers: Vec<[f32; 4]>,
    /// First layer of each material up to the last one with kernels, [`NO_KERNEL`] for those without.
    pub first_layer: Vec<u32>,
}

impl KernelLibrary {
    /// An empty library.
    pub fn new() -> KernelLibrary {
        KernelLibrary::default()
    }

    /// Adds a material by its index in the scene, or changes its lobe; returns its first layer.
    ///
    /// Errors: a lobe whose parameters are out of range.
    pub fn add(&mut self, material: u32, lobe: Lobe) -> Result<u32> {
        lobe.check().map_err(|message| Error::Resource { name: format!("kernels of material {material}"), message })?;
        let index = match &lobe {
            Lobe::Anisotropic { alpha } => {
                let of_azimuth = |k: usize| {
                    let (sin, cos) = (std::f32::consts::PI * k as f32 / AZIMUTHS as f32).sin_cos();
                    Lobe::Anisotropic { alpha: with_direction(*alpha, Vec3::new(cos, sin, 0.0), Vec3::Z) }
                };
                let first = self.index_of(of_azimuth(0));
                // If the first was known, then so are the others behind it.
                (1..AZIMUTHS).for_each(|k| {
                    self.index_of(of_azimuth(k));
                });
                first
            }
            _ => self.index_of(lobe),
        };
        let first = (index * VIEW_ANGLES) as u32;
        let material = material as usize;
        if self.first_layer.len() <= material {
            self.first_layer.resize(material + 1, NO_KERNEL);
        }
        self.first_layer[material] = first;
        Ok(first)
    }

    /// Place of a lobe, which is tabulated unless it is known.
    fn index_of(&mut self, lobe: Lobe) -> usize {
        if let Some(known) = self.lobes.iter().position(|known| *known == lobe) {
            return known;
        }
        let image = lobe.mirrored();
        match self.lobes.iter().position(|known| *known == image) {
            Some(image) => {
                let layers: Vec<Kernel> =
                    self.layers[image * VIEW_ANGLES..][..VIEW_ANGLES].iter().map(Kernel::mirrored).collect();
                self.layers.extend(layers);
            }
            None => {
                let layers = (0..VIEW_ANGLES).into_par_iter().map(|layer| Kernel::new(&lobe, view_cosine(layer)));
                self.layers.par_extend(layers);
            }
        }
        self.lobes.push(lobe);
        self.lobes.len() - 1
    }

    /// First layer of a material.
    pub fn first_layer(&self, material: u32) -> Option<u32> {
        self.first_layer.get(material as usize).copied().filter(|&first| first != NO_KERNEL)
    }

    /// All layers.
    pub fn layers(&self) -> &[Kernel] {
        &self.layers
    }

    /// Mean energy of a material's lobe for cos theta_o = `mu`, over the azimuths at which it is tabulated; 0 without kernels.
    pub fn mean_energy(&self, material: u32, mu: f32) -> f32 {
        let Some(first) = self.first_layer(material) else { return 0.0 };
        let count = if self.lobes[first as usize / VIEW_ANGLES].is_isotropic() { 1 } else { AZIMUTHS };
        let of = |k: usize| self.look_up_from(first + (k * VIEW_ANGLES) as u32, mu).energy;
        (0..count).map(of).sum::<f32>() / count as f32
    }

    /// The look-up for cos theta_o = `mu`, as in a shader, of a lobe of two widths at azimuth 0; `None` without kernels.
    pub fn look_up(&self, material: u32, mu: f32) -> Option<LookUp<'_>> {
        Some(self.look_up_from(self.first_layer(material)?, mu))
    }

    /// The look-up in the layers that begin at `first`, one of them for each angle of view.
    fn look_up_from(&self, first: u32, mu: f32) -> LookUp<'_> {
        let layers = &self.layers[first as usize..][..VIEW_ANGLES];
        let s = (mu * VIEW_ANGLES as f32 - 1.0).clamp(0.0, (VIEW_ANGLES - 1) as f32);
        let i = s as usize;
        let (a, b, t) = (&layers[i], &layers[(i + 1).min(VIEW_ANGLES - 1)], s - i as f32);
        let mix = |a: f32, b: f32| a + (b - a) * t;
        LookUp {
            tan_beta: mix(a.tan_beta, b.tan_beta),
            energy: mix(a.energy, b.energy),
            grazing: mix(a.grazing, b.grazing),
            captured: mix(a.captured, b.captured),
            core_share: mix(a.core_share, b.core_share),
            nearest: &layers[(s + 0.5) as usize],
        }
    }

    /// The tables in device form.
    pub fn to_gpu(&self) -> GpuKernels {
        let parts = || {
            self.layers
                .chunks(VIEW_ANGLES)
                .flat_map(|of_lobe| of_lobe.iter().map(|k| &k.tail).chain(of_lobe.iter().map(|k| &k.core)))
        };
        GpuKernels {
            textures: parts().flat_map(|part| part.texture.iter().copied()).collect(),
            narrowings: parts().map(|part| part.narrowing).collect(),
            layers: self.layers.iter().map(|k| [k.tan_beta, k.energy, k.grazing, k.core_share]).collect(),
            first_layer: self.first_layer.clone(),
        }
    }
}

/// A kernel between the tabulated angles of view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookUp<'a> {
    /// Interpolated [`Kernel::tan_beta`].
    pub tan_beta: f32,
    /// Interpolated [`Kernel::energy`].
    pub energy: f32,
    /// Interpolated [`Kernel::grazing`].
    pub grazing: f32,
    /// Interpolated [`Kernel::captured`].
    pub captured: f32,
    /// Interpolated [`Kernel::core_share`].
    pub core_share: f32,
    /// The nearest layer, for its textures.
    pub nearest: &'a Kernel,
}

#[cfg(test)]
mod tests;
