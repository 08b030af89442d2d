//! Spatially variant splat convolution of a mirror image (Bastos 1999, 7.4.2.1, 7.4.2.2 and 7.4.3, programs 7.12 and
//! 7.17): every pixel q spreads its radiance over the pixels around it by a kernel of its own. This turns the image in
//! a perfect mirror into the image in a glossy surface.
//!
//! Let k_q be the kernel of q: a texture of [`KERNEL_TEXELS`]^2 texels over a square whose edge is the diameter of q
//! (shorter along v by the narrowing that the library states), sampled bilinearly at p - q rotated into the axes of q.
//! With the pixels q of the region of p:
//!
//! ```text
//! w_qp = k_q(p - q) / sum of k_q over the unbounded grid of pixels
//! L'_p = sum_q w_qp L_q / sum_q w_qp
//! ```
//!
//! The first division gives wide and narrow kernels equal weight, so that energy is preserved away from edges; the
//! second, by the weight that reached p, preserves a constant image, without dark rims. Diameters up to one pixel are a
//! delta, and so is a kernel that misses all pixels; kernels whose centre is not 0 converge to a delta continuously. A
//! pixel that no weight reaches keeps its own radiance.
//!
//! **Inputs**, an entry for each pixel, row by row. Radiance; w: depth of the visible point (any unit that orders).
//! Footprint: diameter in pixels, layer of the library (rounded here), vector of the kernel's u axis in the image
//! (x to the right, y down); its length, where above 1, is the factor by which this kernel is narrower along v than the library
//! states, in steps of 2^(1/4), up to [`MAX_STEPS`] with those of the library. Region: 0 if the pixel takes no part and gets 0, else the number of its reflector, up to
//! 65535: sources spread only within their own region. **Output**, [`Convolve::spread`]: radiance; w: the sum of the
//! weights, so that rgb times w is the sum of program 7.17.
//!
//! **Invariant** (program 7.12): a footprint buffer with an entry for each region applies to all of its pixels; factors that vary with
//! direction are applied to the image before or after by the caller.
//!
//! **Direct.** Each pixel gathers the sum as stated. Tiles of 8 x 8 pixels store the maximum reach of the sources that
//! reach them, so that a window is no wider than necessary. The window is cut into rounds of some 8000 taps, one
//! dispatch each. The same rounds sum up the kernels beforehand; kernels wider than [`SUMMED`] are normalised by their
//! integral.
//!
//! **Fast.** A pyramid whose levels each halve the image. A kernel is applied at the level where it is
//! [`levels::STAYS`] / 2 to [`levels::LEAVES`] texels wide, and over the last quarter of that range blended between two
//! levels. Its width is that of a disc with the kernel's standard deviations (their geometric mean), between half the
//! diameter and the diameter. For the sources passed on to a coarser level, a texel holds premultiplied radiance,
//! weight, and the means of diameter, axis and layer. Quadratic B-splines double the resolution on the way back. Going
//! up and down widens a kernel by a variance of (4^l - 1) / 3 square pixels along each axis at level l; this variance
//! is subtracted from the kernel (down to [`levels::MIN_VARIANCE`] of its own). Weights pass through the same filters
//! as radiance, so constants are exact. Regions do not bleed: a texel holds the two regions with the most pixels,
//! separately. Sources of a third region stay at the finer level, with kernels limited to [`levels::LEAVES`] texels,
//! and are then too sharp. For kernels narrow enough for level 0 the sum is the direct one, except that the sums of
//! kernels come from a table (0.2 % off for a disc).
//!
//! Error of the fast form, relative RMSE against the direct one, on an image of soft shades, chequers and a bright
//! ball, with diameters proportional to depth and with depth edges (`tests/gpu/convolve.rs`, 160x120): a disc 0.018,
//! 0.021 and 0.043 for maximum diameters of 15, 31 and 63 pixels; a smooth lobe 0.009, 0.010 and 0.017; the same at
//! half the width along v 0.017, 0.017 and 0.015; a long, one-sided one 0.013, 0.010 and 0.011.
//!
//! **Occlusion**, off as in the thesis: if a source lies behind the target by more than [`DEPTH_TOLERANCE`] of the
//! target's depth, its weights count only within the disc of the target's own diameter, with an edge softened over a
//! pixel. So a blurred background does not bleed over a sharp foreground. In the fast form the rule applies to sources
//! of level 0 only, not to those in the pyramid.
//!
//! **Layers** (depth of field): sources spread over all pixels, with occlusion, and the region number marks the layer:
//! 1, the back layer, which may be hidden; 2, the front layer. In the fast form the pyramid keeps the layers separate
//! everywhere, and a pixel of diameter d takes the fraction (d / [`levels::STAYS`])^2, at most 1, of the back layer's
//! pyramid: none where the pixel is sharp.
//!
//! Differs from the thesis in: the normalisations (it has none), regions, the fast form; its programs scatter, this
//! pass gathers, in a fixed order, so that the same input gives the same bits.
//!
//! Only tiles of 8 x 8 texels with pixels of a region are worked on (`occupied`); where there are none, none are.
//!
//! Cost, for each pixel of such a tile. Direct: a disc of n pixels takes three loads of 16 bytes and some 60 operations for each of its pixels, at
//! each pixel, and half of that for the sums of the kernels. Fast: some 60 loads of 16 bytes a pixel
//! whatever the width, plus the kernel windows, which cost more at finer levels; docs/benchmarks.md has times. Memory:
//! 48 bytes a pixel of the image, 60 more in the fast form; 32, in the fast form 45 of them are set to 0 in each frame.

use serde::{Deserialize, Serialize};

use super::layout::ConvolveStep;
use super::{BoundKernel, vec4s};
use crate::error::{Error, Result};
use crate::gpu::{Buffer, Context, Kernel, Memory, Recorder, Resources, Shader, Staging, shaders};
use crate::superposition::kernels::MAX_NARROWING;

pub mod levels;
mod occupied;
pub mod reference;

pub use reference::reference;

use levels::Levels;
use occupied::Occupied;

/// Edge of a kernel texture in texels.
pub const KERNEL_TEXELS: u32 = 32;

/// Cells between the texel centres of a texture, including a rim of zeros.
const CELLS: u32 = (KERNEL_TEXELS + 1) * (KERNEL_TEXELS + 1);
/// Entries of the table of kernel sums over the grid: diameters up to 16 in eighths of a texel, directions over a
/// quarter turn.
const NORMS: u32 = 129 * 8;

/// Reach of a kernel in radii: texels whose centres lie in the disc, plus the interpolation to the next texels.
pub const SUPPORT: f32 = 1.0885;

/// Relative difference of depths up to which a source counts as not behind a target.
///
/// Higher: things slightly behind an edge spread over it. Lower: surfaces that recede from the eye stop spreading.
pub const DEPTH_TOLERANCE: f32 = 0.01;

/// Maximum steps of 2^(1/4) by which a kernel is narrower along v than along u.
pub const MAX_STEPS: u32 = 15;

/// Maximum number of textures in a library.
pub const MAX_LAYERS: u32 = 4095;

/// Maximum width, in pixels, of kernels that are summed over the grid; a wider one takes its integral, which differs
/// from the sum by less than 1e-4.
pub const SUMMED: f32 = 256.0;

/// Maximum width of an image: a dispatch takes at least one row of the window.
pub const MAX_WIDTH: u32 = 16384;

/// Maximum kernel width, in pixels, that [`Form::Auto`] gathers directly.
pub const NARROW: f32 = 4.0;

/// Algorithm that takes the sum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// Direct up to [`NARROW`], else fast.
    #[default]
    Auto,
    /// Gathers the sum as stated.
    Direct,
    /// Uses the pyramid.
    Fast,
}

/// Inputs and options.
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    /// Kernels.
    pub library: &'a Library,
    /// Radiance; w: depth, in any unit that orders.
    pub source: &'a Buffer,
    /// Kernel diameter in pixels, layer, vector of the u axis, longer than 1 if the kernel is narrower; one entry for each pixel, or `by_region`.
    pub footprint: &'a Buffer,
    /// `footprint` has an entry for each region number, from 0 on; the last serves all further ones, so one serves all.
    pub by_region: bool,
    /// Region number up to 65535; 0: the pixel takes no part.
    pub region: &'a Buffer,
    /// Width and height of the image.
    pub size: [u32; 2],
    /// Upper bound of the diameters, pixels; greater ones are clamped.
    pub widest: f32,
    /// Algorithm.
    pub form: Form,
    /// Sources behind a pixel spread over it no farther than the pixel's own kernel.
    pub occlusion: bool,
    /// Regions 1 and 2 are layers, the back and the front one, that spread over each other; needs `occlusion`.
    pub layers: bool,
}

/// A library of kernels, prepared for sampling.
pub struct Library {
    /// Number of textures.
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
    /// Prepares the textures of `kernels`, one `f32` a texel. `narrowings` states for each by how many steps it is
    /// narrower along v than along u: the edge of a disc is then an ellipse of 2^(-n / 4) times the diameter along v
    /// ([`crate::superposition::kernels`]).
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

    /// Records the preparation; needed once, and again whenever the textures change.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.steps.iter().try_for_each(|(kernel, groups)| kernel.run(rec, &super::push(0), *groups))
    }
}

/// The pass.
pub struct Convolve {
    /// Convolved radiance; w: sum of the weights. 0 for pixels that take no part.
    pub spread: Buffer,
    levels: Levels,
    occupied: Occupied,
    /// Whether another convolution records the list of tiles before this one.
    shares: bool,
    /// Set to 0 before each run, since steps over listed tiles read neighbours: region and layer of each source, of the image and of
    /// coarser levels; regions of coarser entries. And the result, which is 0 outside every region.
    cleared: Vec<Buffer>,
    sources: Sources,
    tiles: BoundKernel,
    reach: [BoundKernel; 2],
    gather: BoundKernel,
}

/// How pixels become sources.
enum Sources {
    /// Each is weighted by the sum of its kernel.
    Direct { weigh: BoundKernel },
    /// They are reduced into the pyramid.
    Fast { reduce: BoundKernel, reduce_coarse: BoundKernel, tiles_coarse: BoundKernel, gather_coarse: BoundKernel },
}

impl Convolve {
    /// Prepares the convolution of `inputs.source`.
    pub fn new(context: &Context, staging: &mut Staging, inputs: &Inputs) -> Result<Self> {
        inputs.check()?;
        let occupied = Occupied::new(context, staging, inputs.region, inputs.size, inputs.layers)?;
        Self::over(context, staging, inputs, occupied, false)
    }

    /// [`Convolve::new`] for inputs of the same size and regions as those of `first`, which is recorded before in each frame: its list of
    /// tiles serves both.
    pub fn after(context: &Context, staging: &mut Staging, inputs: &Inputs, first: &Convolve) -> Result<Self> {
        inputs.check()?;
        Self::over(context, staging, inputs, first.occupied.clone(), true)
    }

    fn over(
        context: &Context,
        staging: &mut Staging,
        inputs: &Inputs,
        occupied: Occupied,
        shares: bool,
    ) -> Result<Self> {
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
            bind(
                context,
                shader,
                &[&shared, occupied.resources(), &Resources::of([("masses", masses), ("shapes", shapes)]), own],
            )
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
        let [fine, raised] = [fine, raised].map(|[_, shapes]| shapes);
        let cleared = if fast { vec![spread.clone(), fine, raised, members] } else { vec![spread.clone(), fine] };
        Ok(Convolve { spread, levels, occupied, shares, cleared, sources, tiles, reach, gather })
    }

    /// The form in use.
    pub fn form(&self) -> Form {
        match self.sources {
            Sources::Direct { .. } => Form::Direct,
            Sources::Fast { .. } => Form::Fast,
        }
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        let Convolve { levels, occupied, .. } = self;
        if !self.shares {
            occupied.record(rec)?;
        }
        self.cleared.iter().try_for_each(|buffer| rec.fill(buffer, 0))?;
        match &self.sources {
            Sources::Direct { weigh } => {
                for step in levels.weigh.clone() {
                    occupied.run_listed(rec, weigh, step, 0)?;
                }
                self.record_tiles(rec, &self.tiles, 0)?;
            }
            Sources::Fast { reduce, reduce_coarse, tiles_coarse, gather_coarse } => {
                occupied.run_listed(rec, reduce, 0, 1)?;
                self.record_tiles(rec, &self.tiles, 0)?;
                for level in 1..levels.count {
                    occupied.run_listed(rec, reduce_coarse, level, level + 1)?;
                    self.record_tiles(rec, tiles_coarse, level)?;
                }
                for level in (1..levels.count).rev() {
                    occupied.run_listed(rec, gather_coarse, level, level)?;
                }
            }
        }
        for step in levels.gather.clone() {
            occupied.run_listed(rec, &self.gather, step, 0)?;
        }
        Ok(())
    }

    /// Records the reach of the sources that reach each tile of a level.
    fn record_tiles(&self, rec: &mut Recorder, tiles: &BoundKernel, level: usize) -> Result<()> {
        let [across, down] = &self.reach;
        [tiles, across, down].into_iter().try_for_each(|step| self.occupied.run_all(rec, step, level))
    }
}

fn run(rec: &mut Recorder, kernel: &BoundKernel, step: usize, groups: u64) -> Result<()> {
    kernel.run(rec, &super::push(step as u32), groups)
}

impl Inputs<'_> {
    /// Checks that the buffers fit the size of the image.
    fn check(&self) -> Result<()> {
        let pixels = u64::from(self.size[0]) * u64::from(self.size[1]);
        for (buffer, element) in [(self.source, 16), (self.footprint, 16), (self.region, 4)] {
            let of_regions = self.by_region && buffer.handle() == self.footprint.handle() && buffer.bytes() >= element;
            if buffer.bytes() != element * pixels && !of_regions {
                let [width, height] = self.size;
                let message =
                    format!("{} bytes, {element} for each of {width}x{height} pixels are needed", buffer.bytes());
                return Err(Error::Resource { name: buffer.name().to_owned(), message });
            }
        }
        Ok(())
    }

    /// The form that `Auto` resolves to.
    fn chosen(&self) -> Form {
        match self.form {
            Form::Auto if self.widest <= NARROW => Form::Direct,
            Form::Auto => Form::Fast,
            form => form,
        }
    }
}
