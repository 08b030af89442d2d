//! Soft shadows by convolution (Bastos 1999, section 8.2.3.1): the hard shadow of an emitter's centre, convolved with a kernel of the emitter's shape.
//!
//! Let the emitter be a parallelogram with centre c and edges e1, e2, and let something between c and a point x of a plane with normal n block
//! light, d_o from x and d_l from c. Seen from the emitter's point c + u e1 + v e2 it casts on x the shadow that it casts, seen from c, on
//!
//! ```text
//! x' = x + r (u P e1 + v P e2),   r = d_o / d_l,   P e = e - w (n . e) / (n . w),   w = x - c
//! ```
//!
//! where P projects along the rays of c onto the plane. So the share of the emitter that x sees is the hard shadow V of the centre, averaged over a
//! parallelogram of the emitter's shape whose edges are r times as long as the emitter's; for an occluder parallel to a floor the penumbra is
//! s d_o / d_l wide, s the emitter's edge. The kernel is projected to the image like the disc of a mirror image, and
//!
//! ```text
//! V'(x) = sum over samples q of the kernel of [q on the surface of x] V(q) / sum of [q on the surface of x]
//! E(x)  = V'(x) E_0(x)
//! ```
//!
//! with E_0 the irradiance by the whole emitter without shadows, from 16 points on it, so that normals, distances and textures stay sharp. It is clipped like that of
//! virtual lights, and [`near_points`](super::near_points) or [`gather`](super::gather) restore what is cut off.
//!
//! **Rays.** V comes from one shadow ray for each pixel ([`super::visibility`]). One blocked pixel in each quad of 2 x 2 gets a second ray, to the nearest
//! thing that blocks it, which tells r. From the receiver's side that is the rear of a body: near the ground its shadow is sharp.
//!
//! **Search.** The ratio of a pixel's kernel, lit or not, is the mean of those r whose own kernel, about a blocked point, reaches it
//! (as Fernando 2005, "Percentage-closer soft shadows", averages depths), from up to 32 samples of the widest kernel that reaches its tile, denser
//! near the middle; those beside lit pixels count [`EDGE_WEIGHT`] times, because deep in a shadow the nearest thing is not the one whose outline casts its edge. It is found once for each quad, and again for
//! pixels of a quad that show other surfaces. Kernels of more than [`WIDE`] pixels both ways are convolved for quads too, and pixels take what lies between theirs.
//!
//! **Tiles** of 8 x 8 pixels that no blocker reaches, or from which nothing lit is in reach, keep V.
//!
//! Samples are 16, 32 or 64 points (Hammersley) of the parallelogram, the same for all pixels: there is no noise, and a step between
//! light and shadow has as many levels. Kernels reach [`WIDEST`] pixels at most.
//!
//! Differs from the thesis in: there the image of irradiance is convolved, here the visibility alone; the thesis leaves open where lit pixels have the distance of the occluder from. Differs
//! from the emitter in: one layer of pixels; one occluder at a point; V' is the mean over the emitter's area, whatever its parts contribute; what only parts of the emitter other than
//! its centre see is not known.
//!
//! Cost, for each emitter: a shadow ray for each pixel, one ray for each quad with blocked pixels; near edges of shadows up to 96 texels for each quad and
//! up to 36 for each pixel; 300 operations a pixel. 64 bytes of memory a pixel.

use ash::vk;

use super::layout::PointLight;
use super::{BoundKernel, Kit, Lighting, List, Rays, ShadingPoints, groups, push};
use crate::error::Result;
use crate::gpu::{Buffer, Image, Recorder, Resources, shaders};
use crate::settings::SoftShadows;

pub mod reference;

/// Vectors of an emitter's record; `shaders/include/soft_emitter.wgsl`.
const EMITTER: u32 = 6;
/// Edge of a tile, pixels.
pub const TILE: u32 = 8;
/// Greatest half width or height of a kernel, pixels.
pub const WIDEST: f32 = 128.0;
/// Kernels whose shorter side has more pixels are convolved once for a quad.
pub const WIDE: f32 = 6.0;
/// Kernels grow no more at cosines of incidence below.
pub const LEAST_COSINE: f32 = 0.05;
/// Distance from the tangent plane up to which a point counts as one of the surface, over its distance from the pixel's point.
///
/// Higher: light leaks over bends. Lower: kernels on curved surfaces are cut.
pub const TOLERANCE: f32 = 0.1;
/// Pixels by which kernels reach farther in the search.
pub const MARGIN: f32 = 1.5;
/// Weight in the search of blockers beside lit pixels, which are at the outline of what blocks; others count 1.
pub const EDGE_WEIGHT: f32 = 8.0;
/// Least cosine between the normals of one surface.
pub const LEAST_AGREEMENT: f32 = 0.9;
/// Points on an emitter along each of its edges.
pub const ALONG_EDGE: u32 = 4;

/// Samples of the search for blockers in so many pixels across.
pub fn searches_of(width: f32) -> u32 {
    if width <= 6.0 { 16 } else { 32 }
}

/// Samples of a kernel that is so many pixels wide.
pub fn samples_of(width: f32) -> u32 {
    if width <= 3.0 {
        16
    } else if width <= 32.0 {
        32
    } else {
        64
    }
}

/// The pass over one emitter after the other.
pub struct SoftShadow {
    /// Irradiance of each pixel by these emitters.
    pub direct: Buffer,
    /// The pixels that have soft shadows, in clusters of 64 by tiles of 8 x 8; clusters repeat pixels.
    pub list: List,
    /// Centres of the emitters, in [`PointLight`]s.
    pub lights: Buffer,
    /// Whether each pixel sees the centre.
    pub visible: Buffer,
    /// Point of each pixel; w: its word, see [`reference::Word`].
    pub source: Image,
    /// Rays of quads to what blocks them.
    pub rays: Rays,
    /// The quads with such rays.
    pub blocked: List,
    /// Blocked point of each quad; w: its word, 0: none.
    pub blockers: Image,
    /// Of each tile: greatest reach of its blockers in pixels, greatest ratio, 1 for lit and 2 for blocked pixels, 0.
    pub tiles: Buffer,
    /// Greatest ratio of the blockers that reach each tile; 0: nothing to convolve.
    pub windows: Buffer,
    /// A point of each quad; w: what is known of it, see [`reference::Quad`].
    pub quads: Image,
    farthest: Buffer,
    emitters: Buffer,
    emitter: Buffer,
    write_list: BoundKernel,
    write_source: BoundKernel,
    aim: BoundKernel,
    write_blockers: BoundKernel,
    reach: BoundKernel,
    search: BoundKernel,
    convolve: BoundKernel,
    size: [u32; 2],
}

impl SoftShadow {
    /// Prepares the pass for an image of this size.
    pub fn new(kit: &Kit, points: &ShadingPoints, [width, height]: [u32; 2], steps: &Resources) -> Result<SoftShadow> {
        let pixels = width * height;
        let quads = width.div_ceil(2) * height.div_ceil(2);
        let tiles_of = |edge: u32| width.div_ceil(edge) * height.div_ceil(edge);
        let direct = kit.vec4s("soft direct light", pixels)?;
        let list = List::new(kit, "soft pixels", &kit.array("soft pixels list", 64 * tiles_of(8), 4)?)?;
        let lights = kit.array("soft lights", SoftShadows::MAX_LIGHTS, size_of::<PointLight>() as u64)?;
        let visible = kit.array("soft visibility", pixels, 4)?;
        // Images, because lavapipe loads texels faster than elements of buffers.
        let image = |name: &str, edge: u32| {
            let [across, down] = [width, height].map(|n| n.div_ceil(edge));
            Image::new(kit.context, name, across, down, vk::Format::R32G32B32A32_SFLOAT)
        };
        let source = image("hard shadow", 1)?;
        let rays = Rays::new(kit.context, "blocker", quads)?;
        let blocked = List::new(kit, "blocked quads", &kit.array("blocked quads list", quads, 4)?)?;
        let aimed = kit.vec4s("blocked points", quads)?;
        let blockers = image("blockers", 2)?;
        let tiles = kit.vec4s("soft tiles", tiles_of(TILE))?;
        let windows = kit.array("soft windows", tiles_of(TILE), 4)?;
        let of_quads = image("kernels of quads", 2)?;
        let emitters = kit.vec4s("soft emitters", EMITTER * SoftShadows::MAX_LIGHTS)?;
        let emitter = kit.vec4s("soft emitter", EMITTER)?;
        let farthest = kit.array("reach of blockers", 1, 4)?;
        let own = Resources::of([
            ("soft_direct", &direct),
            ("lights", &lights),
            ("visible", &visible),
            ("soft_emitters", &emitters),
            ("soft_emitter", &emitter),
            ("aimed", &aimed),
            ("soft_tiles", &tiles),
            ("soft_windows", &windows),
            ("farthest", &farthest),
        ])
        .with_image("source", &source)
        .with_image("blockers", &blockers)
        .with_image("soft_quads", &of_quads);
        let of_points = points.resources();
        let sets = [&own, &of_points, &rays.resources(), steps];
        Ok(SoftShadow {
            write_list: kit.bind(&shaders::SOFT_SHADOW_LIST, &[&own, &of_points, &list.as_output()])?,
            write_source: kit.bind(&shaders::SOFT_SHADOW_SOURCE, &sets)?,
            aim: kit.bind(&shaders::SOFT_SHADOW_AIM, &[&sets[..], &[&blocked.as_output()]].concat())?,
            write_blockers: kit.bind(&shaders::SOFT_SHADOW_BLOCKERS, &sets)?,
            reach: kit.bind(&shaders::SOFT_SHADOW_REACH, &sets)?,
            search: kit.bind(&shaders::SOFT_SHADOW_SEARCH, &sets)?,
            convolve: kit.bind(&shaders::SOFT_SHADOW, &sets)?,
            direct,
            list,
            lights,
            visible,
            source,
            rays,
            blocked,
            blockers,
            tiles,
            windows,
            quads: of_quads,
            farthest,
            emitters,
            emitter,
            size: [width, height],
        })
    }

    /// Number of tiles or quads of this edge.
    fn count(&self, edge: u32) -> u32 {
        self.size[0].div_ceil(edge) * self.size[1].div_ceil(edge)
    }

    /// Records the list of pixels and the centres; its counts must be cleared.
    pub fn record_list(&self, rec: &mut Recorder) -> Result<()> {
        self.write_list.run(rec, &[], groups(self.count(8).max(SoftShadows::MAX_LIGHTS)))
    }

    /// Records the hard shadow of emitter k, and the rays to what blocks its light; the counts of their list must be cleared.
    pub fn record_source(&self, rec: &mut Recorder, k: u32) -> Result<()> {
        let bytes = self.emitter.bytes();
        rec.copy_range(&self.emitters, u64::from(k) * bytes, &self.emitter, 0, bytes)?;
        // They held values of another emitter.
        [&self.source, &self.blockers, &self.quads].into_iter().try_for_each(|image| rec.image_to_general(image))?;
        rec.fill(&self.tiles, 0)?;
        rec.fill(&self.farthest, 0)?;
        self.write_source.run(rec, &[], groups(self.size[0] * self.size[1]))?;
        self.aim.run(rec, &[], groups(self.count(2)))
    }

    /// Records the ratios of the blockers, and which of them reach each tile.
    pub fn record_blockers(&self, rec: &mut Recorder) -> Result<()> {
        self.write_blockers.run(rec, &[], groups(self.count(2)))?;
        self.reach.run(rec, &[], groups(self.count(TILE)))
    }

    /// Records the widths of the kernels, and the convolution by wide ones.
    pub fn record_search(&self, rec: &mut Recorder) -> Result<()> {
        self.search.run(rec, &[], u64::from(self.count(16)))
    }

    /// Records the convolution by narrow kernels, and the light of the emitter; `step` says whether it is the first.
    pub fn record_convolution(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        self.convolve.run(rec, &push(step), u64::from(self.count(8)))
    }
}

/// Adds the light of these emitters to that of its pixels, after the filters: it has no noise that they could take away.
pub struct SoftShadowAdd {
    kernels: Vec<BoundKernel>,
    pixels: u32,
}

impl SoftShadowAdd {
    /// To the light after the filters, and to that before them where they differ, so that no filter seems to have added it.
    pub fn new(
        kit: &Kit,
        points: &ShadingPoints,
        direct: &Buffer,
        lightings: &[&Lighting],
        pixels: u32,
    ) -> Result<SoftShadowAdd> {
        let own = Resources::of([("soft_direct", direct)]);
        let of_points = points.resources();
        let bind = |lighting: &&Lighting| {
            kit.bind(&shaders::SOFT_SHADOW_ADD, &[&own, &of_points, &Resources::of([("direct", &lighting.direct)])])
        };
        Ok(SoftShadowAdd { kernels: lightings.iter().map(bind).collect::<Result<_>>()?, pixels })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernels.iter().try_for_each(|kernel| kernel.run(rec, &[], groups(self.pixels)))
    }
}
