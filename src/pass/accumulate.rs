//! The pass's image is added to the running sums:
//! L = L_e + throughput (kd / pi * (E_direct + E_indirect) + L_specular), the throughput that of mirrors and glass before the
//! receiver (see `eye_paths`), L_e with what `merge` added.
//!
//! The layers are those of the receiver: irradiance as it is there, albedo times throughput (so that their product is the
//! diffuse radiance), its normal, and its depth as if the way through mirrors and glass were straight, which in a plane
//! mirror is the depth of the image. Coverage counts what the eye's own ray meets, so a mirror that shows nothing covers.
//!
//! Colour and irradiance are summed with compensation (Kahan 1965), so thousands of passes lose nothing to f32; colour
//! is kept for each of the two independent instances, whose difference estimates the error. A pass in which rays were
//! lost is left out (see `schedule`). Cost: 24 vec4 and 40 operations a pixel.

use glam::{Vec3, Vec4};

use super::{Kernels, Paths, Receivers, Sums, groups, vec4s};
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Context, Kernel, Memory, Recorder};
use crate::plan::INSTANCES;

/// Running sums over the passes; these persist between frames.
#[derive(Clone)]
pub struct Film {
    /// Radiance and coverage, a sum for each instance.
    pub color: Vec<Buffer>,
    /// What rounding took from it.
    pub color_rest: Vec<Buffer>,
    /// Direct irradiance and what rounding took.
    pub direct: [Buffer; 2],
    /// Indirect irradiance and what rounding took.
    pub indirect: [Buffer; 2],
    /// Albedo (diffuse and specular) times throughput, and coverage.
    pub albedo: Buffer,
    /// Shading normal; w: depth along the view direction times coverage.
    pub normal: Buffer,
    /// Emission, diffuse and specular light (see `summands`), each with what rounding took; `None`: not asked for.
    pub summands: Option<[[Buffer; 2]; Film::SUMMANDS]>,
    /// `[i]`: passes in the sums of instance i, counted by the device: a pass in which rays were lost is left out.
    pub counts: Buffer,
}

impl Film {
    /// Number of the image's summands.
    pub const SUMMANDS: usize = 3;

    /// Sums for `pixels` pixels, those of the `summands` among them. Clear them before the first pass.
    pub fn new(context: &Context, pixels: u32, summands: bool) -> Result<Film> {
        let array = |name: &str| vec4s(context, name, pixels);
        let each = |name: &str| (0..INSTANCES).map(|i| array(&format!("{name} {i}"))).collect::<Result<Vec<_>>>();
        Film {
            color: each("film color")?,
            color_rest: each("film color rest")?,
            direct: [array("film direct")?, array("film direct rest")?],
            indirect: [array("film indirect")?, array("film indirect rest")?],
            albedo: array("film albedo")?,
            normal: array("film normal")?,
            summands: None,
            counts: Buffer::new(context, "film counts", 16, Memory::Device)?,
        }
        .with_summands(context, pixels, summands)
    }

    /// The same sums with or without those of the summands.
    pub fn with_summands(mut self, context: &Context, pixels: u32, summands: bool) -> Result<Film> {
        if summands != self.summands.is_some() {
            let pair = |name: &str| -> Result<_> {
                Ok([
                    vec4s(context, &format!("film {name}"), pixels)?,
                    vec4s(context, &format!("film {name} rest"), pixels)?,
                ])
            };
            self.summands = match summands {
                true => Some([pair("emission")?, pair("diffuse")?, pair("specular")?]),
                false => None,
            };
        }
        Ok(self)
    }

    /// All buffers in a fixed order: the renderer's whole state besides the number of passes.
    pub fn buffers(&self) -> Vec<&Buffer> {
        let pairs = self.direct.iter().chain(&self.indirect);
        self.color
            .iter()
            .chain(&self.color_rest)
            .chain(pairs)
            .chain(self.summands.iter().flatten().flatten())
            .chain([&self.albedo, &self.normal, &self.counts])
            .collect()
    }
}

/// The pass, for each instance.
pub struct Accumulate {
    kernel: Kernel,
    bindings: Vec<Bindings>,
    pixels: u32,
}

impl Accumulate {
    /// Adds to `film` unless `status[0]` says that rays were lost.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        kernels: &Kernels,
        frame: &Buffer,
        receivers: &Receivers,
        paths: &Paths,
        sums: &Sums,
        film: &Film,
        status: &Buffer,
        pixels: u32,
    ) -> Result<Self> {
        let kernel = kernels.accumulate.clone();
        let bindings = (film.color.iter().zip(&film.color_rest))
            .map(|(color, color_rest)| {
                kernel.bind(&[
                    ("frame", frame.into()),
                    ("status", status.into()),
                    ("receiver_position", (&receivers.position).into()),
                    ("receiver_shading", (&receivers.shading).into()),
                    ("receiver_kd", (&receivers.kd).into()),
                    ("receiver_f0", (&receivers.f0).into()),
                    ("receiver_wo", (&receivers.wo).into()),
                    ("emitted", (&receivers.emitted).into()),
                    ("throughput", (&paths.throughput).into()),
                    ("direct", (&sums.direct).into()),
                    ("indirect", (&sums.indirect).into()),
                    ("specular", (&sums.specular).into()),
                    ("sum_color", color.into()),
                    ("rest_color", color_rest.into()),
                    ("sum_direct", (&film.direct[0]).into()),
                    ("rest_direct", (&film.direct[1]).into()),
                    ("sum_indirect", (&film.indirect[0]).into()),
                    ("rest_indirect", (&film.indirect[1]).into()),
                    ("sum_albedo", (&film.albedo).into()),
                    ("sum_normal", (&film.normal).into()),
                    ("counts", (&film.counts).into()),
                ])
            })
            .collect::<Result<_>>()?;
        Ok(Accumulate { kernel, bindings, pixels })
    }

    /// Records the pass for an instance.
    pub fn record(&self, rec: &mut Recorder, instance: u32) -> Result<()> {
        rec.dispatch(&self.kernel, &self.bindings[instance as usize], &[], groups(self.pixels))
    }
}

/// Oracle: one compensated addition; returns the new sum and rest.
pub fn compensated_add(sum: Vec4, rest: Vec4, x: Vec4) -> (Vec4, Vec4) {
    let y = x - rest;
    let t = sum + y;
    (t, (t - sum) - y)
}

/// Oracle: the radiance of a pixel.
pub fn reference(emitted: Vec3, throughput: Vec3, kd: Vec3, sums: [Vec3; 3]) -> Vec3 {
    emitted + throughput * (kd * std::f32::consts::FRAC_1_PI * (sums[0] + sums[1]) + sums[2])
}
