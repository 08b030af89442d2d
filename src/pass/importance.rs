//! Chooses the emitters that particles start from by their estimated contribution to the image (Wald et al. 2002,
//! 5.1.4): in a scene of very many lights each pass uses a few, and more often those that matter to the view.
//!
//! The contribution of emitter e is estimated at 256 visible points x, spread over the image, without shadows:
//!
//! ```text
//! C(e) = 1/256 sum over x of rho(x) E(e, x),   E = L A cos(e) cos(x) / max(|x - y|^2 + A / pi, clip^2)   [W / m^2]
//! ```
//!
//! y is the centre of the emitter, which is exact for points on the axis of a disc. cos(x) is increased by the sine of
//! the disc's angular radius, so that emitters partly above the horizon count. rho is the mean reflectance. Then
//!
//! ```text
//! p(e) = s P(e) / sum P + (1 - s) C(e) / sum C,   flux of a particle = P(e) / p(e)
//! ```
//!
//! P is the power and s [`crate::settings::Settings::power_fraction`]: every emitter with power has positive probability,
//! so direct and indirect light have the same limits as with a choice by power alone, and no particle has more than 1 /
//! s times the flux. p is the length of the interval as stored, so rounding costs variance but no bias; as in a choice
//! by power, only emitters below 2^-24 of the total may be lost.
//!
//! Two kernels: `importance` has an invocation for each emitter; `importance_scan` is one workgroup whose lanes take
//! runs of emitters and sum in a fixed order, so that the same frame gives the same bits.
//!
//! Differs from the paper in that: the paper does not say how it chooses lights. Particles of all path lengths start
//! from the chosen emitters. Lights without area are all used, once each, or chosen by the same probabilities in
//! [`super::delta_choice`].
//! Cost: 256 times some 60 operations an emitter.

use glam::Vec3;

use super::layout::{self, EmitterRecord};
use super::shade::ShadingPoint;
use super::{BoundKernel, Kit, ShadingPoints, groups};
use crate::bsdf::mean;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::light::cosine;
use crate::light::emitters::{Emitter, Emitters, Kind, spot_falloff};
use crate::sampling::halton::radical_inverse;

/// Points of the image at which contributions are estimated.
pub const PROBES: u32 = 256;

/// Maximum number of emitters: the three runs of a lane of `importance_scan` stay within the loop budget.
pub const MAX_EMITTERS: u32 = 1 << 20;

/// The pass.
pub struct Importance {
    estimate: BoundKernel,
    scan: BoundKernel,
    count: u32,
    /// [`EmitterRecord`]s with the new distribution and fluxes.
    pub emitters: Buffer,
}

impl Importance {
    /// Reads `emitters`, distributed by power, and the visible `points`.
    pub fn new(kit: &Kit, emitters: &Buffer, points: &ShadingPoints) -> Result<Self> {
        let count = (emitters.bytes() / size_of::<EmitterRecord>() as u64) as u32;
        let contributions = kit.array("contributions", count, 4)?;
        let chosen = kit.array("emitters by contribution", 1, emitters.bytes())?;
        let own = Resources::of([("contributions", &contributions), ("chosen", &chosen)]);
        Ok(Importance {
            estimate: kit.bind(&shaders::IMPORTANCE, &[&points.resources(), &own])?,
            scan: kit.bind(&shaders::IMPORTANCE_SCAN, &[&own])?,
            count,
            emitters: chosen,
        })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.estimate.run(rec, &[], groups(self.count))?;
        self.scan.run(rec, &[], 1)
    }
}

/// Oracle: pixels of the estimate's points.
pub fn probes([width, height]: [u32; 2]) -> impl Iterator<Item = u32> {
    (0..PROBES).map(move |i| {
        let x = ((i as f32 + 0.5) * (1.0 / PROBES as f32) * width as f32) as u32;
        let y = (radical_inverse(2, i) * height as f32) as u32;
        x.min(width - 1) + y.min(height - 1) * width
    })
}

/// Oracle: irradiance (mean of the channels) at `x` with normal `n` from an unoccluded emitter.
pub fn irradiance(frame: &layout::FrameParameters, e: &Emitter, x: Vec3, n: Vec3) -> f32 {
    let middle = match e.kind {
        Kind::Triangle => e.p0 + (e.e1 + e.e2) / 3.0,
        Kind::Quad => e.p0 + (e.e1 + e.e2) / 2.0,
        _ => e.p0,
    };
    let d = middle - x;
    let r2 = d.length_squared();
    let wi = d / r2.sqrt().max(1e-20);
    let (cos, leaving) = (wi.dot(n), -wi.dot(e.normal));
    let emitting = cosine::power(if e.two_sided { leaving.abs() } else { leaving.max(0.0) }, e.exponent);
    let nearest = frame.right[3].max(1e-8 * frame.eye[3] * frame.eye[3]);
    let falloff = 1.0 / r2.max(nearest);
    let pi = std::f32::consts::PI;
    // Cosine towards a disc or sphere with this sine of the angular radius.
    let widened = |sin: f32| (cos + sin).clamp(0.0, 1.0);
    let geometry = match e.kind {
        Kind::Triangle | Kind::Quad => {
            let from_disc = r2 + e.area / pi;
            e.area * emitting * widened((e.area / pi / from_disc).sqrt()) / from_disc.max(nearest)
        }
        Kind::Sphere => match (r2 < e.e1.x * e.e1.x, e.inward) {
            (true, true) => pi,
            (false, false) => pi * e.e1.x * e.e1.x * widened(e.e1.x / r2.sqrt()) * falloff,
            _ => 0.0,
        },
        Kind::Point => cos.max(0.0) * falloff,
        Kind::Spot => spot_falloff(leaving, e.e1.x, e.e1.y) * cos.max(0.0) * falloff,
        Kind::Directional => (-e.normal.dot(n)).max(0.0),
        Kind::Environment => {
            let sin = (e.area / (2.0 * pi)).min(1.0).sqrt();
            e.area * (sin - e.normal.dot(n)).clamp(0.0, 1.0)
        }
        Kind::Imported => cosine::sharpness(e.exponent) * emitting * cos.max(0.0) * falloff / pi,
    };
    mean(e.radiance) * geometry
}

/// Oracle: probabilities of the emitters; `receivers`: the lit shading points at [`probes`].
pub fn reference(frame: &layout::FrameParameters, emitters: &Emitters, receivers: &[ShadingPoint]) -> Vec<f64> {
    let contribution = |e: &Emitter| -> f64 {
        let one = |r: &ShadingPoint| {
            let reflected = mean(r.reflectance.kd) + mean(r.reflectance.f0);
            f64::from(reflected * irradiance(frame, e, r.position, r.shading))
        };
        receivers.iter().map(one).sum()
    };
    let contributions: Vec<f64> = emitters.list.iter().map(contribution).collect();
    let total: f64 = contributions.iter().sum();
    let floor = f64::from(frame.choice[0]);
    let one = |(e, c): (&Emitter, &f64)| {
        let by_power = f64::from(e.probability);
        floor * by_power + (1.0 - floor) * if total > 0.0 { c / total } else { by_power }
    };
    emitters.list.iter().zip(&contributions).map(one).collect()
}
