//! Spatially variant splat convolution of a mirror image (Bastos 1999, 7.4.2.1, 7.4.2.2 and 7.4.3, programs 7.12 and 7.17; rows B10
//! and B11): every pixel q spreads its radiance over the pixels around it by a kernel of its own, which turns the image that a
//! mirror shows into the one that a glossy surface would show.
//!
//! With k_q the kernel of q, a texture of [`KERNEL_TEXELS`]^2 texels over a square whose edge is q's diameter (along v narrower by
//! what the library says), sampled bilinearly at p - q turned into q's axes, and the pixels q of p's region:
//!
//! ```text
//! w_qp = k_q(p - q) / sum of k_q over the unbounded grid of pixels
//! L'_p = sum_q w_qp L_q / sum_q w_qp
//! ```
//!
//! The first division makes wide and narrow kernels weigh alike, so that energy is preserved away from edges; the second, by what
//! reached p, leaves a constant image as it is, with no dark rims. Diameters up to one pixel are a delta, and so is a
//! kernel that misses all pixels; kernels whose middle is not 0 go over into it continuously. A pixel that no weight reaches
//! keeps its own radiance.
//!
//! **Inputs**, an entry for each pixel, row by row: radiance, with the depth of what is seen in w (any unit that orders);
//! footprint: diameter in pixels, layer of the library (rounded here), unit vector of the kernel's u axis in the image (x to the
//! right, y down); region: 0, the pixel takes no part and gets 0, else the number of its reflector, up to 65535: sources
//! spread over their own region only. **Output**, [`Convolve::spread`]: radiance; w: the sum of the weights, so that rgb times w is
//! what program 7.17 sums up.
//!
//! **Invariant** (program 7.12): a footprint buffer of a single entry is that of all pixels; the caller modulates the image before or
//! after by what varies with direction.
//!
//! **Direct.** Each pixel gathers the sum as it is written. Tiles of 8 x 8 pixels know how far the sources that reach them reach, so
//! that a window is no wider than it must be. The window is cut into rounds of some 8000 taps, a dispatch each. The
//! same rounds sum up the kernels beforehand; those wider than [`SUMMED`] are normalised by their integral.
//!
//! **Fast.** A pyramid, each level of which halves the image. A kernel is convolved at the level where it is
//! [`levels::STAYS`] / 2 to [`levels::LEAVES`] texels wide, and over the last quarter of that range in two levels by shares; width is that of a disc
//! with the kernel's standard deviations (their geometric mean), from a half to the whole of the diameter. Of what rises
//! from a level, a texel holds premultiplied radiance, weight, and the means of diameter, axis and layer. On the way back
//! quadratic B-splines double the resolution. Both ways together widen a kernel by a variance of (4^l - 1) / 3 square pixels along
//! each axis at level l, which is taken off the kernel (down to [`levels::LEAST_VARIANCE`] of its own). Weights go the same ways as radiance, so constants are exact.
//! Regions do not bleed: a texel holds the two regions with the most pixels, apart from each other. Sources of a third one
//! stay at the finer level, with kernels no wider than it takes ([`levels::LEAVES`] texels): they are then sharper than they should be.
//! Up to the width that stays in the image itself the sum is the direct one, but for sums of kernels from a table (0.2 % off for
//! a disc).
//!
//! Error of the fast form, relative RMSE against the direct one on an image of soft shades, chequers and a bright ball, diameters
//! proportional to depth with depth edges (`tests/gpu/convolve.rs`, 160x120): a disc 0.018, 0.021 and 0.043 for greatest diameters
//! of 15, 31 and 63 pixels, a smooth lobe 0.009, 0.010 and 0.017, the same of half the width along v 0.017, 0.017 and 0.015, a long one to one side 0.013, 0.010 and 0.011.
//!
//! **Occlusion**, off as in the thesis: of a source that lies behind the target, by more than [`DEPTH_TOLERANCE`] of the target's depth,
//! weights count only within the disc of the target's own diameter, softened over a pixel. So what is blurred behind
//! does not bleed over what is sharp in front. In the fast form the rule
//! holds for sources that stay in the image itself; what rises is not held back.
//!
//! **Layers** (depth of field): sources spread over all pixels, with occlusion, and the numbers of regions say what may be hidden: 1, what
//! lies behind; 2, what lies in front. In the fast form the pyramid keeps the two apart wherever they are, and of what rose behind, a
//! pixel of diameter d takes the share (d / [`levels::STAYS`])^2, at most 1: none of it where the pixel is sharp.
//!
//! Differs from the thesis in: the normalisations (it has none), regions, the fast form; programs scatter, this gathers, in a fixed
//! order, so that the same input gives the same bits.
//!
//! Cost. Direct: for a disc of n pixels three loads of 16 bytes and some 60 operations for each of them and each pixel, and
//! half of that for the sums of the kernels. Fast: some 60 loads of 16 bytes a pixel whatever the width, and the windows of the kernels, the more the
//! finer their level; docs/benchmarks.md has times. Memory: 48 bytes a pixel, and 60 more in the fast form.

use super::layout::ConvolveStep;
use super::{BoundKernel, vec4s};
use crate::error::{Error, Result};
use crate::gpu::{Buffer, Context, Kernel, Memory, Recorder, Resources, Shader, Staging, shaders};
use crate::superposition::kernels::MAX_NARROWING;

pub mod levels;
pub mod reference;

pub use reference::reference;

use levels::Levels;

/// Edge of a kernel texture in texels.
pub const KERNEL_TEXELS: u32 = 32;

/// Cells of a texture between the centres of its texels, with a rim of zeros around.
const CELLS: u32 = (KERNEL_TEXELS + 1) * (KERNEL_TEXELS + 1);
/// Entries of the table of a kernel's sums over the grid: eighths of a texel up to 16, directions of a quarter turn.
const NORMS: u32 = 129 * 8;

/// How far a kernel reaches, in radii: texels whose centres lie in the disc, and the way to the next ones.
pub const SUPPORT: f32 = 1.0885;

/// Relative difference of depths up to which a source does not lie behind a target.
///
/// Higher: what lies a little behind spreads over edges before it. Lower: surfaces that recede from the eye stop spreading.
pub const DEPTH_TOLERANCE: f32 = 0.01;

/// Most textures of a library.
pub const MAX_LAYERS: u32 = 4095;

/// Widest kernel, in pixels, whose sum over the grid is taken; that of a wider one is its integral, which differs from it
/// by less than 1e-4.
pub const SUMMED: f32 = 256.0;

/// Longest row of an image: a dispatch takes at least one row of the window.
pub const MAX_WIDTH: u32 = 16384;

/// Widest kernels, in pixels, that [`Form::Auto`] gathers directly.
pub const NARROW: f32 = 4.0;

/// How the sum is taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Form {
    /// Direct up to [`NARROW`], else fast.
    #[default]
    Auto,
    /// As it is written.
    Direct,
    /// By the pyramid.
    Fast,
}

/// What the pass reads, and how.
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    /// Kernels.
    pub library: &'a Library,
    /// Radiance; w: depth, in any unit that orders.
    pub source: &'a Buffer,
    /// Kernel diameter in pixels, layer, unit vector of the u axis; for each pixel, or one for all.
    pub footprint: &'a Buffer,
    /// Number of the region up to 65535, 0: the pixel takes no part.
    pub region: &'a Buffer,
    /// Width and height of the image.
    pub size: [u32; 2],
    /// Diameters are taken to be no greater, pixels.
    pub widest: f32,
    /// How.
    pub form: Form,
    /// What lies behind a pixel spreads no farther over it than the pixel's own kernel.
    pub occlusion: bool,
    /// Regions 1 and 2 are layers, one behind the other, that spread over each other; needs `occlusion`.
    pub layers: bool,
}

/// A library of kernels in the form that the pass samples.
pub struct Library {
    /// Textures.
    pub layers: u32,
    quads: Buffer,
    moments: Buffer,
    norms: Buffer,
    steps: Vec<(BoundKernel, u64)>,
}

fn bind(context: &Context, shader: &'static Shader, sets: &[&Resources]) -> Result<BoundKernel> {
    Ok(BoundKernel(Kernel::new(context, shader)?.bind_from(sets, &Resources::new())?))
}

impl Library {
    /// Prepares the textures of `kernels`, one `f32` a texel. Each is so many steps narrower along v than along u: a disc's edge is
    /// then an ellipse of 2^(-n / 4) times the diameter along v ([`crate::superposition::kernels`]).
    pub fn new(context: &Context, staging: &mut Staging, kernels: &Buffer, narrowings: &[u32]) -> Result<Library> {
        let layers = narrowings.len() as u32;
        let texels = u64::from(layers) * u64::from(KERNEL_TEXELS * KERNEL_TEXELS);
        if layers == 0 || layers > MAX_LAYERS || kernels.bytes() != 4 * texels {
            let message = format!("{} bytes hold no library of {layers} kernels, 1 to {MAX_LAYERS}", kernels.bytes());
            return Err(Error::Resource { name: kernels.name().to_owned(), message });
        }
        let quads = vec4s(context, "kernel cells", (layers + 1) * CELLS)?;
        let moments = vec4s(context, "kernel moments", 2 * layers)?;
        let norms = Buffer::new(context, "kernel sums", 4 * u64::from(layers * NORMS), Memory::Device)?;
        let parameters = ConvolveStep { layers, ..ConvolveStep::default() };
        let parameters = staging.stage(context, "kernel library", &[parameters])?;
        let narrowings: Vec<u32> = narrowings.iter().map(|&n| n.min(MAX_NARROWING)).collect();
        let narrowings = staging.stage(context, "kernel narrowings", &narrowings)?;
        let buffers = Resources::of([
            ("narrowings", &narrowings),
            ("steps", &parameters),
            ("kernels", kernels),
            ("quads", &quads),
            ("moments", &moments),
            ("norms", &norms),
        ]);
        let steps = vec![
            (bind(context, &shaders::CONVOLVE_MOMENTS, &[&buffers])?, super::groups(layers)),
            (bind(context, &shaders::CONVOLVE_QUADS, &[&buffers])?, super::groups((layers + 1) * CELLS)),
            (bind(context, &shaders::CONVOLVE_NORMS, &[&buffers])?, super::groups(layers * NORMS)),
        ];
        Ok(Library { layers, quads, moments, norms, steps })
    }

    /// Records the preparation: once, and again whenever the textures change.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.steps.iter().try_for_each(|(kernel, groups)| kernel.run(rec, &super::push(0), *groups))
    }
}

/// The pass.
pub struct Convolve {
    /// Convolved radiance; w: sum of the weights. 0 where a pixel takes no part.
    pub spread: Buffer,
    levels: Levels,
    sources: Sources,
    tiles: BoundKernel,
    reach: [BoundKernel; 2],
    gather: BoundKernel,
}

/// How sources are made of pixels.
enum Sources {
    /// Each by the sum of its kernel.
    Direct { weigh: BoundKernel },
    /// By the pyramid.
    Fast { reduce: BoundKernel, reduce_coarse: BoundKernel, tiles_coarse: BoundKernel, gather_coarse: BoundKernel },
}

impl Convolve {
    /// Prepares the convolution of `inputs.source`.
    pub fn new(context: &Context, staging: &mut Staging, inputs: &Inputs) -> Result<Self> {
        inputs.check()?;
        let levels = Levels::new(inputs)?;
        let fast = inputs.chosen() == Form::Fast;
        let [width, height] = inputs.size;
        let (pixels, coarse) = (width * height, levels.entries.max(1));
        let array = |what: &str, count: u32| vec4s(context, &format!("convolution {what}"), count);
        let spread = array("spread", pixels)?;
        let fine = [array("masses", pixels)?, array("shapes", pixels)?];
        let raised = [array("coarse masses", coarse)?, array("coarse shapes", coarse)?];
        let (rising, brought) = (array("rising", 2 * coarse)?, array("levels", coarse)?);
        let members = Buffer::new(context, "convolution members", 4 * u64::from(coarse), Memory::Device)?;
        let tiles = [array("tiles", levels.tiles)?, array("tiles across", levels.tiles)?];
        let steps = staging.stage(context, "convolution steps", &levels.steps)?;
        let shared = Resources::of([
            ("steps", &steps),
            ("quads", &inputs.library.quads),
            ("moments", &inputs.library.moments),
            ("norms", &inputs.library.norms),
            ("source", inputs.source),
            ("footprint", inputs.footprint),
            ("region", inputs.region),
            ("rising", &rising),
            ("members", &members),
            ("levels", &brought),
            ("spread", &spread),
        ]);
        let make = |shader, [masses, shapes]: &[Buffer; 2], own: &Resources| {
            bind(context, shader, &[&shared, &Resources::of([("masses", masses), ("shapes", shapes)]), own])
        };
        let none = Resources::new();
        let found = Resources::of([("tiles", &tiles[0])]);
        let across = Resources::of([("from_tiles", &tiles[0]), ("to_tiles", &tiles[1])]);
        let down = Resources::of([("from_tiles", &tiles[1]), ("to_tiles", &tiles[0])]);
        let gather = match (fast, inputs.occlusion, inputs.layers) {
            (true, false, _) => &shaders::CONVOLVE,
            (true, true, false) => &shaders::CONVOLVE_OCCLUDED,
            (true, true, true) => &shaders::CONVOLVE_LAYERS,
            (false, false, _) => &shaders::CONVOLVE_DIRECT,
            (false, true, false) => &shaders::CONVOLVE_DIRECT_OCCLUDED,
            (false, true, true) => &shaders::CONVOLVE_DIRECT_LAYERS,
        };
        let reduce = match inputs.layers {
            false => [&shaders::CONVOLVE_REDUCE, &shaders::CONVOLVE_REDUCE_COARSE],
            true => [&shaders::CONVOLVE_REDUCE_LAYERS, &shaders::CONVOLVE_REDUCE_COARSE_LAYERS],
        };
        let sources = if fast {
            Sources::Fast {
                reduce: make(reduce[0], &fine, &none)?,
                reduce_coarse: make(reduce[1], &raised, &none)?,
                tiles_coarse: make(&shaders::CONVOLVE_TILES_COARSE, &raised, &found)?,
                gather_coarse: make(&shaders::CONVOLVE_COARSE, &raised, &found)?,
            }
        } else {
            Sources::Direct { weigh: make(&shaders::CONVOLVE_WEIGH, &fine, &none)? }
        };
        let tiles = make(&shaders::CONVOLVE_TILES, &fine, &found)?;
        let reach = [
            make(&shaders::CONVOLVE_REACH_ACROSS, &fine, &across)?,
            make(&shaders::CONVOLVE_REACH_DOWN, &fine, &down)?,
        ];
        let gather = make(gather, &fine, &found)?;
        Ok(Convolve { spread, levels, sources, tiles, reach, gather })
    }

    /// The form that was chosen.
    pub fn form(&self) -> Form {
        match self.sources {
            Sources::Direct { .. } => Form::Direct,
            Sources::Fast { .. } => Form::Fast,
        }
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        let levels = &self.levels;
        match &self.sources {
            Sources::Direct { weigh } => {
                for step in levels.weigh.clone() {
                    run(rec, weigh, step, levels.pixel_groups(0))?;
                }
                self.record_tiles(rec, &self.tiles, 0)?;
            }
            Sources::Fast { reduce, reduce_coarse, tiles_coarse, gather_coarse } => {
                run(rec, reduce, 0, levels.pixel_groups(1))?;
                self.record_tiles(rec, &self.tiles, 0)?;
                for level in 1..levels.count {
                    run(rec, reduce_coarse, level, levels.pixel_groups(level + 1))?;
                    self.record_tiles(rec, tiles_coarse, level)?;
                }
                for level in (1..levels.count).rev() {
                    run(rec, gather_coarse, level, levels.tile_count(level))?;
                }
            }
        }
        for step in levels.gather.clone() {
            run(rec, &self.gather, step, levels.tile_count(0))?;
        }
        Ok(())
    }

    /// How far the sources that reach the tiles of a level reach.
    fn record_tiles(&self, rec: &mut Recorder, tiles: &BoundKernel, level: usize) -> Result<()> {
        let [across, down] = &self.reach;
        [tiles, across, down].into_iter().try_for_each(|step| run(rec, step, level, self.levels.tile_groups(level)))
    }
}

fn run(rec: &mut Recorder, kernel: &BoundKernel, step: usize, groups: u64) -> Result<()> {
    kernel.run(rec, &super::push(step as u32), groups)
}

impl Inputs<'_> {
    /// Finds buffers that are not of the image's size.
    fn check(&self) -> Result<()> {
        let pixels = u64::from(self.size[0]) * u64::from(self.size[1]);
        for (buffer, element) in [(self.source, 16), (self.footprint, 16), (self.region, 4)] {
            let one_for_all = buffer.handle() == self.footprint.handle() && buffer.bytes() == element;
            if buffer.bytes() != element * pixels && !one_for_all {
                let [width, height] = self.size;
                let message =
                    format!("{} bytes, {element} for each of {width}x{height} pixels are needed", buffer.bytes());
                return Err(Error::Resource { name: buffer.name().to_owned(), message });
            }
        }
        Ok(())
    }

    /// The form that is used.
    fn chosen(&self) -> Form {
        match self.form {
            Form::Auto if self.widest <= NARROW => Form::Direct,
            Form::Auto => Form::Fast,
            form => form,
        }
    }
}
