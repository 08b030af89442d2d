//! Structures that host and shaders share, member by member the WGSL structs of the same names; the build checks every
//! offset and size against the compiled shaders.

mod push;

use bytemuck::{Pod, Zeroable};

pub use super::splat_start::SplatParameters;
use crate::settings::Reflectance;
use crate::view::{Region, Task};
pub use push::{DisplayPush, GBufferPush, LayerPush, Push, UnpackMorePush, UnpackPush, Window};

pub use crate::light::emitters::EmitterRecord;

/// Parameters of one pass of the renderer; `shaders/include/frame.wgsl` says what each component is.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct FrameParameters {
    /// Eye point; w: coordinate scale of the scene.
    pub eye: [f32; 4],
    /// Image half width at unit distance; w: clip distance squared.
    pub right: [f32; 4],
    /// Image half height at unit distance; w: clip distance.
    pub up: [f32; 4],
    /// Unit view direction; w: a length beyond every surface.
    pub forward: [f32; 4],
    /// Lower corner of the scene; w: 1 / greatest extent.
    pub bounds_min: [f32; 4],
    /// Sample offset in the pixel; z: least alpha of a virtual light's lobe; w: irradiance that may be dropped.
    pub pixel_offset: [f32; 4],
    /// Width, height, pixels, pass within the instance.
    pub size: [u32; 4],
    /// Place of the view in the whole image, width and height of the whole image.
    pub within: [u32; 4],
    /// First sequence index, particles N of a class, rotation of their segment, delta lights.
    pub walk: [u32; 4],
    /// Keys of the pass and of the instance, bits ([`FrameParameters::JITTER`], [`FrameParameters::SOBOL`],
    /// [`FrameParameters::SHARED_PHOTONS`]), instance.
    pub keys: [u32; 4],
    /// Nodes, emitters, greatest path length, 0 (which no compiler knows, see `include/exact_sum.wgsl`).
    pub scene: [u32; 4],
    /// Width and height of the interleaving pattern, classes, lights of each class.
    pub pattern: [u32; 4],
    /// Caustic photons of each class N, first index of their sequence, targets, buckets - 1 (buckets are a power of 2).
    pub photons: [u32; 4],
    /// Radius r of the look-up, 1 / (2r), 1 / (pi r^2 N), bits of the number of photons of a class that start from emitters.
    pub photon: [f32; 4],
    /// For j reflections: particles N_j, first light slot, bits of 1 / N_j, N_(j+1).
    pub depths: [[u32; 4]; 16],
    /// For dimensions 2j and 2j + 1: Cranley-Patterson shifts, then bits of their bases.
    pub shifts: [[f32; 4]; 16],
    /// For dimensions 2j and 2j + 1: random words; then the point of the gather rays of bounce j.
    pub sobol: [[u32; 4]; 16],
    /// Share of the choice of emitters that goes by power, where it goes by contribution; virtual lights on a unit of area of
    /// an emitter of mean radiance 1, and of other surfaces; maximum alpha of a lobe that eye paths follow, 0: none.
    pub choice: [f32; 4],
    /// Planar reflectors, by their number, that mirror the room; form of their reflectance, as in [`crate::settings::Reflectance`]; 1:
    /// images with depth show what they mirror; bits of the alpha above which splats show lobes, 0: none.
    pub superposition: [u32; 4],
    /// Mirrored lights of each class N, lights to mirror, planar mirrors; neighbours of a class, across and down, that share
    /// near light.
    pub mirrors: [u32; 4],
    /// Lights that a cluster chooses, lights of a cluster (see [`super::light_lists`]); bits of the weight of near light of the same class
    /// (see [`super::near_collect::weight`]); 1 + the only particle whose path begins in this pass, 0: all do.
    pub lists: [u32; 4],
    /// Of the lens: its diameter times the pixels of a unit of length at unit distance, 1 / distance in focus; z: weight of neighbours;
    /// w: photons in a footprint, 0: all have the radius of the look-up (see [`super::photon_width`]).
    pub lens: [f32; 4],
    /// Widths of the cones that textures are averaged over: of a pixel at unit depth, of particles and of gather rays at unit distance
    /// (see [`crate::plan::Cones`]); w: probability that a particle survives a reflection, 0: all do (see [`crate::ring`]).
    pub cones: [f32; 4],
    /// Displacement of the image's centre from the view direction, to the right and up, in half widths and half heights; 1 if
    /// the camera is orthographic, else 0; 1 / number of the pass, from 1, the weight of [`super::sparse_windows`], by which [`super::edges`] fades too.
    pub shift: [f32; 4],
    /// Number of emitters whose shadows are convolved ([`super::soft_shadow`]); zeros.
    pub soft: [u32; 4],
    /// Their numbers.
    pub soft_emitters: [[u32; 4]; 2],
    /// The pixels that take part ([`crate::view::Task`]): first column and row, end of columns and rows; then 1, or 0: all pixels do; 1 + their
    /// class, 0: all classes; zeros.
    pub task: [[u32; 4]; 2],
}

impl FrameParameters {
    /// Bit of `keys[2]`: points are jittered.
    pub const JITTER: u32 = 1;
    /// Bit of `keys[2]`: points are those of Sobol' and not of Halton.
    pub const SOBOL: u32 = 2;
    /// Bit of `keys[2]`: photons of all classes light each pixel.
    pub const SHARED_PHOTONS: u32 = 4;
    /// Bit of `keys[2]`: rays that leave the scene meet an environment.
    pub const ENVIRONMENT: u32 = 8;

    /// Whether eye rays are parallel.
    pub fn is_orthographic(&self) -> bool {
        self.shift[2] != 0.0
    }

    /// Width of a pixel at a depth, as `cones[0]` has it of one at unit depth.
    pub fn depth_scale(&self, depth: f32) -> f32 {
        if self.is_orthographic() { 1.0 } else { depth }
    }

    /// With the pixels of a task alone.
    pub fn of_task(self, task: &Task) -> FrameParameters {
        let Region { origin: [x, y], size: [width, height] } = task.region;
        let class = task.class.map_or(0, |class| class + 1);
        FrameParameters { task: [[x, y, x + width, y + height], [1, class, 0, 0]], ..self }
    }

    /// Those of an image of so many times less pixels each way, which covers this one: its last row and column may reach beyond it.
    pub fn at_rate(self, rate: u32) -> FrameParameters {
        if rate == 1 {
            return self;
        }
        let [width, height] = [0, 1].map(|axis| self.size[axis].div_ceil(rate));
        let [x, y, whole_width, whole_height] = self.within;
        let whole = [whole_width, whole_height].map(|n| n.div_ceil(rate));
        // The coarse image covers this many widths and heights of the fine one.
        let [across, down] = [0, 1].map(|axis| (rate * whole[axis]) as f32 / [whole_width, whole_height][axis] as f32);
        let scaled = |v: [f32; 4], by: f32| [v[0] * by, v[1] * by, v[2] * by, v[3]];
        let [shift_x, shift_y, parallel, fade] = self.shift;
        let [of_pixel, ..] = self.cones;
        FrameParameters {
            right: scaled(self.right, across),
            up: scaled(self.up, down),
            size: [width, height, width * height, self.size[3]],
            within: [x / rate, y / rate, whole[0], whole[1]],
            cones: [rate as f32 * of_pixel, self.cones[1], self.cones[2], self.cones[3]],
            shift: [(across - 1.0 + shift_x) / across, (1.0 - down + shift_y) / down, parallel, fade],
            ..self
        }
    }

    /// Reflectance of mirrors.
    pub fn reflectance(&self) -> Reflectance {
        [Reflectance::Schlick, Reflectance::Map, Reflectance::Fresnel][self.superposition[1] as usize % 3]
    }

    /// Instance of the pass.
    pub fn instance(&self) -> u32 {
        self.keys[3]
    }

    /// Number of a slot in the whole image, by which random numbers are drawn.
    pub fn sample_of(&self, slot: u32) -> u32 {
        let [width, _, pixels, _] = self.size;
        let [x, y, whole_width, whole_height] = self.within;
        let (second, pixel) = (slot / pixels, slot % pixels);
        pixel % width + x + (pixel / width + y + second * whole_height) * whole_width
    }

    /// Whether the shadows of an emitter are convolved.
    pub fn is_soft(&self, emitter: u32) -> bool {
        self.soft_emitters.as_flattened()[..self.soft[0] as usize].contains(&emitter)
    }

    /// Whether a bit of `keys[2]` is set.
    pub fn has(&self, bit: u32) -> bool {
        self.keys[2] & bit != 0
    }
}

/// Counts that the device finds, and the indirect dispatches made of them.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DispatchCounts {
    /// Shading points in the list.
    pub live: u32,
    /// Rays that ran out of steps in the present round.
    pub unfinished: u32,
    /// Slots of a list that is sorted or in the order of the screen, dead ones included.
    pub total: u32,
    /// Pairs of a cluster and a light that were dropped before any ray was traced.
    pub culled: u32,
    /// Groups for one invocation a shading point; w: more groups, for lists in screen order those of partly filled
    /// clusters, else one for each class of pixels but the first.
    pub list_groups: [u32; 4],
    /// Groups for the next round.
    pub round_groups: [u32; 4],
    /// Groups for one invocation a slot.
    pub total_groups: [u32; 4],
    /// One group if the list has shading points.
    pub once_if_live: [u32; 4],
    /// One group if a next round is needed.
    pub once_if_unfinished: [u32; 4],
}

impl DispatchCounts {
    /// Nothing to do yet, for lists whose shading points belong to so many classes.
    pub fn of_classes(classes: u32) -> DispatchCounts {
        DispatchCounts { list_groups: [0, 0, 0, classes - 1], ..DispatchCounts::default() }
    }

    /// One workgroup for each of so many listed tiles, as [`super::tiles`] spreads them over two dimensions.
    pub fn of_tiles(live: u32) -> DispatchCounts {
        let x = live.min(32768);
        let once_if_live = [live.min(1), 1, 1, 0];
        DispatchCounts {
            live,
            list_groups: [x, live.div_ceil(x.max(1)), 1, 0],
            once_if_live,
            ..DispatchCounts::default()
        }
    }
}

/// Parameters of one dispatch; each pass reads the members that it needs.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Step {
    /// First light, photon or mirrored light of the dispatch.
    pub first: u32,
    /// One past the last; for batches without a list the number of rays.
    pub end: u32,
    /// 0 starts rays, later rounds continue them.
    pub round: u32,
    /// Traversal steps of one ray in this round.
    pub steps: u32,
    /// Maximum number of lights that a single ray takes in this round.
    pub lights: u32,
    /// 1 in the last round, at the last bounce or for the last digit.
    pub last: u32,
    /// 1: work comes from the list; 2: from one in screen order.
    pub indirect: u32,
    /// Reflections of a particle, this one included; mirrors and glass of a path, or gather rays, before this one.
    pub bounce: u32,
    /// 1: sums start at zero.
    pub clears: u32,
    /// Maximum number of bounces of a light: those with more would make paths too long.
    pub bounces: u32,
    /// 1: lights are clipped at half the clip distance.
    pub closer: u32,
    /// Slots of each pixel for the components of its eye path; 1: paths do not split.
    pub components: u32,
    /// 1: planar mirrors reflect virtual lights, so photons leave them out.
    pub mirrored_lights: u32,
    /// Shift of the digit by which the sort counts or scatters.
    pub shift: u32,
    /// Level of the sort's sums.
    pub level: u32,
}

/// How shading points are made of hits.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct PointStep {
    /// Order of the list: [`PointStep::ANY`], [`PointStep::TO_SORT`] or [`PointStep::SCREEN`].
    pub order: u32,
    /// 1: shading points only emit, because the paths to them are as long as allowed.
    pub last: u32,
    /// Slots of each pixel.
    pub components: u32,
}

impl PointStep {
    /// Shading points are appended as they come.
    pub const ANY: u32 = 0;
    /// A fixed order with gaps, which will be sorted: tiles of 8 x 8 for the eye, rays for gathered points.
    pub const TO_SORT: u32 = 1;
    /// Shading points stand in the order of the screen, with gaps, see [`super::clusters`].
    pub const SCREEN: u32 = 2;
}

/// A step of the convolution ([`super::convolve`]): a level of the pyramid, or rows of the window;
/// `shaders/include/convolve.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ConvolveStep {
    /// Texels of the level.
    pub size: [u32; 2],
    /// Its tiles of 8 x 8 texels.
    pub tiles: [u32; 2],
    /// Its first entry; from level 1 on two for each texel, one plane after the other.
    pub first: u32,
    /// Its first tile.
    pub first_tile: u32,
    /// Rows of the window in this round: first, one past the last.
    pub rows: [i32; 2],
    /// Bits, see below.
    pub flags: u32,
    /// Textures of the library.
    pub layers: u32,
    /// Edge of a texel in pixels.
    pub texel: f32,
    /// Diameters are no greater, pixels.
    pub widest: f32,
    /// Tiles that a source of the level reaches across.
    pub reach: u32,
    /// Level of the pyramid; 0: the image.
    pub level: u32,
}

impl ConvolveStep {
    /// Sums start at zero.
    pub const FIRST_ROUND: u32 = 1;
    /// Sums are complete.
    pub const LAST_ROUND: u32 = 2;
    /// Nothing rises from this level.
    pub const TOP_LEVEL: u32 = 4;
    /// One footprint is that of all pixels.
    pub const INVARIANT: u32 = 8;
    /// All tiles count as tiles of a region.
    pub const EVERYWHERE: u32 = 16;
}

/// Motion while the shutter is open, for [`super::velocity`]: cameras as it opens and as it closes; `shaders/include/shutter.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Shutter {
    /// Eye now less eye then.
    pub shift: [[f32; 4]; 2],
    /// Image half width at unit distance, divided by its square.
    pub right: [[f32; 4]; 2],
    /// Likewise its half height.
    pub up: [[f32; 4]; 2],
    /// Unit view direction.
    pub forward: [[f32; 4]; 2],
    /// Triangles that move; zeros.
    pub moving: [u32; 4],
}

/// Velocities in a tile of 8 x 8 pixels ([`super::motion_blur`]); `shaders/include/motion_tiles.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct MotionTile {
    /// Least and greatest velocity to the right, then downwards, of the pixels that move.
    pub range: [f32; 4],
    /// Length of the longest of them.
    pub longest: f32,
    /// Bits: 1, some of its pixels move; 2, some do not; 4, velocity jumps between neighbours, one of which it holds.
    pub kinds: u32,
    /// Greatest depth, of those too that do not move.
    pub deepest: f32,
    /// Zero.
    pub unused: u32,
}

/// The sources that reach a tile ([`super::motion_blur`]); `shaders/include/motion_tiles.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct MotionReach {
    /// 1: some do.
    pub reached: u32,
    /// 1: all of them count as one surface.
    pub even: u32,
}

/// One point light of any kind; `shaders/include/lights.wgsl` gives the formula. For the shadow rays to area lights
/// ([`super::visibility`]) `position` is a corner, `wi` and `flux` are the edges from there.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PointLight {
    /// Position with ray-origin offset; w: bits of the flags.
    pub position: [f32; 4],
    /// Normal or axis; w: scale of the spot's falloff; with [`PointLight::DIRECTED`] the exponent of the cosine less 1.
    pub normal: [f32; 4],
    /// Radiant intensity along the normal; w: offset of the spot's falloff.
    pub emit: [f32; 4],
    /// Towards where the particle came from; w: alpha of the lobe, or on an emitter the lights on a unit of its area.
    pub wi: [f32; 4],
    /// Incident flux; w: f90.
    pub flux: [f32; 4],
    /// Lobe's reflectance at normal incidence; w: bounces so far: reflections, mirrors and glass.
    pub f0: [f32; 4],
}

impl PointLight {
    /// Cosine law about the normal.
    pub const SURFACE: u32 = 1;
    /// The clip distance applies.
    pub const CLIPPED: u32 = 2;
    /// Parallel light along the normal.
    pub const DIRECTIONAL: u32 = 4;
    /// Has a specular lobe.
    pub const GLOSSY: u32 = 8;
    /// Parallel light of the environment.
    pub const ENVIRONMENT: u32 = 16;

    /// Emits by a higher power of the cosine, see [`crate::light::cosine`].
    pub const DIRECTED: u32 = 32;
    /// On an emitter whose shadows are convolved ([`super::soft_shadow`]).
    pub const SOFT: u32 = 64;

    /// Exponent of the cosine by which a light on a surface emits.
    pub fn exponent(&self) -> f32 {
        if self.flags() & PointLight::DIRECTED == 0 { 1.0 } else { self.normal[3] + 1.0 }
    }

    /// Parallel light, which comes from no place.
    pub fn is_parallel(&self) -> bool {
        self.flags() & PointLight::DIRECTIONAL != 0
    }

    /// The flags.
    pub fn flags(&self) -> u32 {
        self.position[3].to_bits()
    }
}

/// A material as the shaders see it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MaterialRecord {
    /// Base colour; w: metallic.
    pub base: [f32; 4],
    /// Dielectric reflectance at normal incidence; w: roughness.
    pub specular: [f32; 4],
    /// Radiance along the normal, with a texture where that is white; w: index of refraction.
    pub emission: [f32; 4],
    /// Base texture + 1, metallic-roughness texture + 1, kind of surface, [`MaterialRecord::TWO_SIDED`],
    /// [`MaterialRecord::SHINY`], [`MaterialRecord::ALPHA`], [`MaterialRecord::SECOND_UVS`], emission texture + 1.
    pub flags: [u32; 4],
    /// Normal texture + 1, bits of its scale, of the opacity and of the cutoff of alpha (negative: none).
    pub normal: [u32; 4],
    /// Exponent of the emitted cosine, exitance over that of Lambert's law; minus the exponent of a [`crate::bsdf::phong`] lobe, 0: GGX, above: square of
    /// the strength of its anisotropy; rotation of its grain ([`crate::bsdf::anisotropic`]).
    pub lobes: [f32; 4],
}

impl MaterialRecord {
    /// Emits on both sides.
    pub const TWO_SIDED: u32 = 1;
    /// Its lobe may be narrow enough for eye paths to follow.
    pub const SHINY: u32 = 2;
    /// Rays may pass.
    pub const ALPHA: u32 = 4;
    /// The first of four bits, one for each [`crate::scene::TextureUse`]: the texture lies by the second coordinates.
    pub const SECOND_UVS: u32 = 8;
    /// Place of the emission texture + 1 among the bits.
    pub const EMISSION_SHIFT: u32 = 8;
    /// Kind: diffuse base and a lobe.
    pub const OPAQUE: u32 = 0;
    /// Kind: diffuse base and an ideal mirror.
    pub const MIRROR: u32 = 1;
    /// Kind: the surface of a body of glass.
    pub const GLASS: u32 = 2;
    /// Kind: thin glass.
    pub const PANE: u32 = 3;
}

/// A planar mirror; `shaders/include/mirror_lights.wgsl` says what each component is.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct MirrorRecord {
    /// Unit normal n; w: o with n . p = o on the plane.
    pub plane: [f32; 4],
    /// Middle of the area; w: area.
    pub middle: [f32; 4],
    /// Reflectance at normal incidence without textures; w: greatest distance of a corner from the middle.
    pub ideal: [f32; 4],
}

/// A texture's place among the texels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TextureRecord {
    /// Record of its level 0.
    pub first: u32,
    /// Record of its last level.
    pub last: u32,
    /// Bit 0: sRGB; bits 1-2: wrap of u, 3-4 of v (0 repeat, 1 mirror, 2 clamp).
    pub flags: u32,
    /// Root of its number of texels.
    pub extent: f32,
}

/// A level of a texture on the device: a rectangle in an image.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LevelRecord {
    /// Column, and row << 16, of its upper left corner in the layer.
    pub origin: u32,
    /// Width, and height << 16.
    pub size: u32,
    /// Layer of the image.
    pub layer: u32,
    /// Number of the image.
    pub page: u32,
}

/// An image with depth as a frame sees it; `shaders/include/reproject.wgsl` says what each component is.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct DepthView {
    /// X of a point from (z x, z y, z, 1), see [`crate::superposition::depth_images::project`].
    pub x: [f32; 4],
    /// Y.
    pub y: [f32; 4],
    /// Z.
    pub z: [f32; 4],
    /// Its first point, width, height, number of its reflector.
    pub points: [u32; 4],
}

/// A tile of 8 x 8 points of an image with depth.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct DepthTile {
    /// Rows of a matrix: the coordinates of an offset in pixels along the edges of a point, at most 1 inside.
    pub inside: [f32; 4],
    /// Index of its [`DepthView`].
    pub view: u32,
    /// Column of its first point, and its row in the upper half of the word.
    pub corner: u32,
    /// Width of the box around a point in pixels, and its height in the upper half of the word.
    pub size: u32,
    /// Only points of every so many-th column and row count.
    pub step: u32,
}
