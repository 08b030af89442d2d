//! The film: running sums of an image over its passes.

use crate::error::Result;
use crate::gpu::{Buffer, Context, Memory, Resources};
use crate::pass::vec4s;
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
    pixels: u32,
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
            pixels,
        }
        .with_summands(context, summands)
    }

    /// Pixels.
    pub fn pixels(&self) -> u32 {
        self.pixels
    }

    /// The same sums with or without those of the summands.
    pub fn with_summands(mut self, context: &Context, summands: bool) -> Result<Film> {
        let pixels = self.pixels;
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

    /// By the names that `accumulate` has for them, those of an instance.
    pub fn as_sums(&self, instance: u32) -> Resources {
        Resources::of([
            ("sum_color", &self.color[instance as usize]),
            ("rest_color", &self.color_rest[instance as usize]),
            ("sum_direct", &self.direct[0]),
            ("rest_direct", &self.direct[1]),
            ("sum_indirect", &self.indirect[0]),
            ("rest_indirect", &self.indirect[1]),
            ("sum_albedo", &self.albedo),
            ("sum_normal", &self.normal),
            ("counts", &self.counts),
        ])
    }

    /// By the names that `resolve` has for them.
    pub fn as_means(&self) -> Resources {
        Resources::of([
            ("sum_a", &self.color[0]),
            ("rest_a", &self.color_rest[0]),
            ("sum_b", &self.color[1]),
            ("rest_b", &self.color_rest[1]),
            ("counts", &self.counts),
        ])
    }
}
