//! The GPU passes of a frame. Each has a file of its own; the names of its shaders begin with its stem, but for
//! `photon_grid` (`photon_keys`, `photon_cells`), `splat_grid` (`splat_keys`, `splat_cells`), `mirror_lights` (`mirror_*`) and `visibility`, which takes variants of
//! `shade`. `frame.rs` has their order. [`layout`], [`surface`] and [`curvature`] are what the passes share.
//!
//! A pass is made from a [`Kit`], which holds the resources that every pass may bind, and from the buffers of the stage
//! that owns it.
//!
//! A pass file contains: the quantity that the pass computes and its equation, named inputs and outputs, `record`, and
//! `reference`, the CPU oracle that the tests compare the shader with.

pub mod accumulate;
pub mod atlas;
pub mod camera_rays;
pub mod caustics;
pub mod clusters;
pub mod collect;
pub mod convolve;
pub mod curvature;
pub mod delta_choice;
pub mod discontinuity;
pub mod discontinuity_lobes;
pub mod display;
pub mod edges;
pub mod eye_paths;
pub mod eye_points;
pub mod finite;
pub mod g_buffer;
pub mod g_buffer_read;
pub mod gain;
pub mod gather;
pub mod gathered_points;
pub mod glossy_light;
pub mod importance;
pub mod kept_light;
pub mod lamp_edges;
pub mod layer;
pub mod layout;
pub mod lens;
pub mod light_lists;
pub mod light_regions;
pub mod merge;
pub mod mirror_image;
pub mod mirror_lights;
pub mod motion_blur;
pub mod near_aim;
pub mod near_collect;
pub mod near_points;
pub mod outliers;
pub mod photon_find;
pub mod photon_follow;
pub mod photon_grid;
pub mod photon_light;
pub mod photon_lights;
pub mod photon_radius;
pub mod photon_start;
pub mod photon_width;
pub mod probe;
pub mod reproject;
pub mod resolve;
pub mod ring;
pub mod schedule;
pub mod shade;
pub mod soft_shadow;
pub mod sort;
pub mod sparse_windows;
pub mod splat_find;
pub mod splat_follow;
pub mod splat_grid;
pub mod splat_light;
pub mod splat_pack;
pub mod splat_start;
pub mod splat_width;
pub mod split_points;
pub mod summands;
pub mod superpose;
pub mod surface;
pub mod third_light;
pub mod tiles;
pub mod trace;
pub mod unlikely;
pub mod unpack_more;
pub mod unpack_points;
pub mod upsample;
pub mod upsample_paths;
pub mod velocity;
pub mod visibility;
pub mod walk_follow;
pub mod walk_reflect;
pub mod walk_start;

use std::cell::RefCell;
use std::rc::Rc;

use ash::vk;
use bytemuck::Pod;

use crate::device_scene::DeviceScene;
use crate::error::{Error, Result};
use crate::gpu::{Bindings, Buffer, Context, Kernel, Memory, Recorder, Resources, Shader, Staging, shaders};
use crate::settings::Traversal;

/// Invocations in a workgroup of the passes that take one invocation for each of their elements.
pub const GROUP: u64 = 64;

/// Workgroups for `count` invocations.
pub(crate) fn groups(count: u32) -> u64 {
    u64::from(count).div_ceil(GROUP)
}

/// Push constants that select a step.
pub(crate) fn push(step: u32) -> [u8; 4] {
    step.to_le_bytes()
}

/// A device buffer of `count` elements of 16 bytes.
pub(crate) fn vec4s(context: &Context, name: &str, count: u32) -> Result<Buffer> {
    Buffer::new(context, name, 16 * u64::from(count), Memory::Device)
}

/// The inputs that all passes have in common: the device, pending uploads, and the resources that any kernel may bind
/// by name (the parameters and status of the frame, the scene).
#[derive(Clone)]
pub struct Kit<'a> {
    /// The device.
    pub context: &'a Context,
    /// Uploads, recorded before the first frame.
    pub staging: Rc<RefCell<&'a mut Staging>>,
    /// Resources that every pass may bind.
    pub shared: Resources,
    /// Whether the scene has textures. If not, kernels without texture look-up are chosen.
    pub textured: bool,
    /// Whether some surfaces let rays pass.
    pub has_alpha: bool,
    /// Whether materials have tables of lobes. If so, kernels that evaluate them are chosen.
    pub tables: bool,
    /// Selects the form of the kernels that trace rays.
    pub traversal: Traversal,
}

impl<'a> Kit<'a> {
    /// For passes over a scene; `own` resources are shared as well.
    pub fn new(
        context: &'a Context,
        staging: &'a mut Staging,
        scene: &DeviceScene,
        traversal: Traversal,
        own: &Resources,
    ) -> Kit<'a> {
        Kit {
            context,
            staging: Rc::new(RefCell::new(staging)),
            shared: scene.resources().and(own),
            textured: scene.textured,
            has_alpha: scene.has_alpha,
            tables: scene.has_tables(),
            traversal,
        }
    }

    /// The same with other resources of these names.
    pub fn with(&self, own: &Resources) -> Kit<'a> {
        Kit { shared: own.clone().and(&self.shared), ..self.clone() }
    }

    /// Makes a kernel, or its variant for tables of lobes, and binds its resources by name, from `sets` or else from the shared resources.
    pub fn bind(&self, shader: &'static Shader, sets: &[&Resources]) -> Result<BoundKernel> {
        let for_tables = |other: &&&'static Shader| other.name.strip_suffix("_tables") == Some(shader.name);
        let shader = shaders::ALL.iter().filter(|_| self.tables).find(for_tables).unwrap_or(&shader);
        Ok(BoundKernel(Kernel::new(self.context, shader)?.bind_from(sets, &self.shared)?))
    }

    /// [`Kit::bind`] for a kernel that looks up materials; chooses its variant with textures or without.
    pub fn bind_surface(&self, [textured, plain]: [&'static Shader; 2], sets: &[&Resources]) -> Result<BoundKernel> {
        self.bind(if self.textured { textured } else { plain }, sets)
    }

    /// A device buffer whose content is uploaded before the first frame.
    pub fn stage<T: Pod>(&self, name: &str, data: &[T]) -> Result<Buffer> {
        self.staging.borrow_mut().stage(self.context, name, data)
    }

    /// A device buffer of `count` elements of `bytes` bytes.
    pub fn array(&self, name: &str, count: u32, bytes: u64) -> Result<Buffer> {
        Buffer::new(self.context, name, bytes * u64::from(count), Memory::Device)
    }

    /// A device buffer of `count` elements of 16 bytes.
    pub fn vec4s(&self, name: &str, count: u32) -> Result<Buffer> {
        vec4s(self.context, name, count)
    }

    /// A buffer for the counts of a list that the device fills.
    pub fn work(&self, name: &str) -> Result<Buffer> {
        self.array(name, 1, size_of::<layout::DispatchCounts>() as u64)
    }
}

/// A kernel and its bindings.
#[derive(Clone)]
pub struct BoundKernel(Bindings);

impl BoundKernel {
    /// Records `groups` workgroups.
    pub fn run(&self, rec: &mut Recorder, push: &[u8], groups: u64) -> Result<()> {
        rec.dispatch(self.0.kernel(), &self.0, push, groups)
    }

    /// Records the number of workgroups that a [`layout::DispatchCounts`] has at `offset`.
    pub fn run_listed(&self, rec: &mut Recorder, push: &[u8], work: &Buffer, offset: u64) -> Result<()> {
        rec.dispatch_indirect(self.0.kernel(), &self.0, push, work, offset)
    }
}

/// The two forms of a kernel that traces rays.
#[derive(Clone, Copy)]
pub struct TraversalKernels {
    /// One invocation traces one ray.
    pub single: &'static Shader,
    /// A subgroup traces a cluster of rays; `None`: rays are traced one by one.
    pub cluster: Option<&'static Shader>,
    /// Whether the cluster form counts the nodes and triangles that it visits.
    pub count: bool,
}

/// The cluster form of a kernel for subgroup sizes 4, 8, 16, 32 and 64.
type BySubgroup = [&'static Shader; 5];

impl TraversalKernels {
    /// Kernels of the pass `shade`, for a scene where some surfaces let light pass or not.
    pub fn shade(context: &Context, traversal: Traversal, has_alpha: bool) -> Result<TraversalKernels> {
        const CLUSTERS: BySubgroup = [
            &shaders::SHADE_CLUSTER_4,
            &shaders::SHADE_CLUSTER_8,
            &shaders::SHADE_CLUSTER_16,
            &shaders::SHADE_CLUSTER_32,
            &shaders::SHADE_CLUSTER_64,
        ];
        const WITH_ALPHA: BySubgroup = [
            &shaders::SHADE_CLUSTER_ALPHA_4,
            &shaders::SHADE_CLUSTER_ALPHA_8,
            &shaders::SHADE_CLUSTER_ALPHA_16,
            &shaders::SHADE_CLUSTER_ALPHA_32,
            &shaders::SHADE_CLUSTER_ALPHA_64,
        ];
        match has_alpha {
            false => TraversalKernels::new(context, traversal, &shaders::SHADE, CLUSTERS),
            true => TraversalKernels::new(context, traversal, &shaders::SHADE_ALPHA, WITH_ALPHA),
        }
    }

    /// Kernels of the pass `trace`, for a scene where some surfaces let rays pass or not.
    pub fn trace(context: &Context, traversal: Traversal, has_alpha: bool) -> Result<TraversalKernels> {
        const CLUSTERS: BySubgroup = [
            &shaders::TRACE_CLUSTER_4,
            &shaders::TRACE_CLUSTER_8,
            &shaders::TRACE_CLUSTER_16,
            &shaders::TRACE_CLUSTER_32,
            &shaders::TRACE_CLUSTER_64,
        ];
        const WITH_ALPHA: BySubgroup = [
            &shaders::TRACE_CLUSTER_ALPHA_4,
            &shaders::TRACE_CLUSTER_ALPHA_8,
            &shaders::TRACE_CLUSTER_ALPHA_16,
            &shaders::TRACE_CLUSTER_ALPHA_32,
            &shaders::TRACE_CLUSTER_ALPHA_64,
        ];
        match has_alpha {
            false => TraversalKernels::new(context, traversal, &shaders::TRACE, CLUSTERS),
            true => TraversalKernels::new(context, traversal, &shaders::TRACE_ALPHA, WITH_ALPHA),
        }
    }

    /// Kernels of the pass `trace` for rays at edges.
    pub fn trace_edges(context: &Context, traversal: Traversal, has_alpha: bool) -> Result<TraversalKernels> {
        const CLUSTERS: BySubgroup = [
            &shaders::TRACE_EDGES_4,
            &shaders::TRACE_EDGES_8,
            &shaders::TRACE_EDGES_16,
            &shaders::TRACE_EDGES_32,
            &shaders::TRACE_EDGES_64,
        ];
        const WITH_ALPHA: BySubgroup = [
            &shaders::TRACE_EDGES_ALPHA_4,
            &shaders::TRACE_EDGES_ALPHA_8,
            &shaders::TRACE_EDGES_ALPHA_16,
            &shaders::TRACE_EDGES_ALPHA_32,
            &shaders::TRACE_EDGES_ALPHA_64,
        ];
        match has_alpha {
            false => TraversalKernels::new(context, traversal, &shaders::TRACE, CLUSTERS),
            true => TraversalKernels::new(context, traversal, &shaders::TRACE_ALPHA, WITH_ALPHA),
        }
    }

    /// Kernels of the pass `visibility`, to point lights or to area lights.
    pub fn visibility(context: &Context, traversal: Traversal, area: bool) -> Result<TraversalKernels> {
        const CLUSTERS: BySubgroup = [
            &shaders::VISIBILITY_CLUSTER_4,
            &shaders::VISIBILITY_CLUSTER_8,
            &shaders::VISIBILITY_CLUSTER_16,
            &shaders::VISIBILITY_CLUSTER_32,
            &shaders::VISIBILITY_CLUSTER_64,
        ];
        const AREA_CLUSTERS: BySubgroup = [
            &shaders::VISIBILITY_AREA_CLUSTER_4,
            &shaders::VISIBILITY_AREA_CLUSTER_8,
            &shaders::VISIBILITY_AREA_CLUSTER_16,
            &shaders::VISIBILITY_AREA_CLUSTER_32,
            &shaders::VISIBILITY_AREA_CLUSTER_64,
        ];
        match area {
            false => TraversalKernels::new(context, traversal, &shaders::VISIBILITY, CLUSTERS),
            true => TraversalKernels::new(context, traversal, &shaders::VISIBILITY_AREA, AREA_CLUSTERS),
        }
    }

    /// Kernels of the pass `visibility` that count the nodes and triangles that clusters visit.
    pub fn counters(context: &Context, area: bool) -> Result<TraversalKernels> {
        const CLUSTERS: BySubgroup = [
            &shaders::COUNTERS_4,
            &shaders::COUNTERS_8,
            &shaders::COUNTERS_16,
            &shaders::COUNTERS_32,
            &shaders::COUNTERS_64,
        ];
        const AREA_CLUSTERS: BySubgroup = [
            &shaders::COUNTERS_AREA_4,
            &shaders::COUNTERS_AREA_8,
            &shaders::COUNTERS_AREA_16,
            &shaders::COUNTERS_AREA_32,
            &shaders::COUNTERS_AREA_64,
        ];
        let (single, clusters) = match area {
            false => (&shaders::VISIBILITY, CLUSTERS),
            true => (&shaders::VISIBILITY_AREA, AREA_CLUSTERS),
        };
        let kernels = TraversalKernels::new(context, Traversal::Cluster, single, clusters)?;
        Ok(TraversalKernels { count: true, ..kernels })
    }

    fn new(
        context: &Context,
        traversal: Traversal,
        single: &'static Shader,
        clusters: BySubgroup,
    ) -> Result<TraversalKernels> {
        let info = context.info();
        let operations = vk::SubgroupFeatureFlags::BASIC | vk::SubgroupFeatureFlags::SHUFFLE;
        let able = info.subgroup_operations.contains(operations);
        let of_size = [4, 8, 16, 32, 64].iter().zip(clusters).find(|(size, _)| able && **size == info.subgroup_size);
        let cluster = match (traversal, of_size) {
            (Traversal::Auto | Traversal::Cluster, Some((_, shader))) => Some(shader),
            (Traversal::Auto, None) | (Traversal::Single, _) => None,
            (Traversal::Cluster, None) => {
                let size = info.subgroup_size;
                return Err(Error::Setting {
                    name: "--traversal",
                    message: format!(
                        "{} has subgroups of {size}; clusters need subgroups of 4, 8, 16, 32 or 64 with shuffles; use auto",
                        info.name
                    ),
                });
            }
        };
        Ok(TraversalKernels { single, cluster, count: false })
    }
}

/// A batch of rays and their hits, in parallel arrays.
#[derive(Clone)]
pub struct Rays {
    /// Origins; w: maximum t.
    pub origin: Buffer,
    /// Unit directions; w, for eye paths: cosine between the first segment and the view direction.
    pub direction: Buffer,
    /// t, u, v, bits of the triangle (all ones: none).
    pub hits: Buffer,
    /// Where the traversal stopped: light, node.
    pub progress: Buffer,
}

impl Rays {
    /// Allocates `count` rays; `name` prefixes the buffer names.
    pub fn new(context: &Context, name: &str, count: u32) -> Result<Rays> {
        Ok(Rays {
            origin: vec4s(context, &format!("{name} ray origins"), count)?,
            direction: vec4s(context, &format!("{name} ray directions"), count)?,
            hits: vec4s(context, &format!("{name} hits"), count)?,
            progress: Buffer::new(context, &format!("{name} progress"), 8 * u64::from(count), Memory::Device)?,
        })
    }

    /// The buffers by their names in shaders.
    pub fn resources(&self) -> Resources {
        Resources::of([
            ("ray_origin", &self.origin),
            ("ray_direction", &self.direction),
            ("hits", &self.hits),
            ("progress", &self.progress),
        ])
    }
}

/// State that eye paths carry to their shading points.
#[derive(Clone)]
pub struct EyePathState {
    /// Product of the throughputs of the mirrors and glass on the path; w: depth of the unfolded (straightened) path
    /// along the view direction.
    pub throughput: Buffer,
    /// Glass media around the ray, [`crate::bsdf::ideal::Media`].
    pub media: Buffer,
    /// Density over solid angle of the direction of a ray that follows a lobe, else 0.
    pub lobe_of: Buffer,
}

impl EyePathState {
    /// Allocates `count` paths, `ideal` of which may meet mirrors and glass.
    pub fn new(context: &Context, count: u32, ideal: u32) -> Result<EyePathState> {
        Ok(EyePathState {
            throughput: vec4s(context, "eye throughput", count)?,
            media: vec4s(context, "eye media", ideal.max(1))?,
            lobe_of: Buffer::new(context, "eye lobe densities", 4 * u64::from(ideal.max(1)), Memory::Device)?,
        })
    }

    /// The buffers by their names in shaders.
    pub fn resources(&self) -> Resources {
        Resources::of([("throughput", &self.throughput), ("media", &self.media), ("lobe_of", &self.lobe_of)])
    }
}

/// Shading points (a G-buffer), slot by slot; `shaders/include/point.wgsl` documents each array.
#[derive(Clone)]
pub struct ShadingPoints {
    /// Points; w: distance along the ray.
    pub position: Buffer,
    /// Geometric normals; w: f90.
    pub geometric: Buffer,
    /// Shading normals; w: alpha.
    pub shading: Buffer,
    /// Diffuse albedo; w: probability of the diffuse lobe.
    pub kd: Buffer,
    /// Specular reflectance.
    pub f0: Buffer,
    /// Direction back along the ray; w: [`ShadingPoints::flags`].
    pub wo: Buffer,
    /// Emitted radiance times throughput; w: flags of the eye's path until it ends.
    pub emitted: Buffer,
}

impl ShadingPoints {
    /// Flag: its ray hit a surface.
    pub const HIT: u32 = 1;
    /// Flag: it can reflect light to the eye, and is listed.
    pub const LIT: u32 = 2;
    /// Flag: it has a specular lobe.
    pub const GLOSSY: u32 = 4;
    /// Flag: the eye's own ray hit something, if only a mirror that shows the background.
    pub const COVERED: u32 = 8;
    /// Flag: the eye sees it through mirrors or glass.
    pub const SEEN_BY_SPECULAR: u32 = 16;
    /// Flag of an eye path: it ended on the base of a glossy plane.
    pub const LOBE_FOLLOWED: u32 = 32;
    /// Flag: a path of its own follows its specular lobe.
    pub const LOBE_SAMPLED: u32 = 64;
    /// Flag: the eye path to it follows a narrow lobe first.
    pub const NARROW_LOBE: u32 = 128;
    /// Flag: the eye path to it chose, at a mirror or glass, a component of a probability below one half.
    pub const UNLIKELY: u32 = 256;
    /// One segment of the eye path beyond its first surface that is neither mirror nor glass; up to 15 of them.
    pub const ONE_SEGMENT: u32 = 512;
    /// Flag: splats show indirect light of its specular lobe.
    pub const SPLATS: u32 = 8192;
    /// Flag: convolved shadows bring the diffuse light of large emitters.
    pub const SOFT: u32 = 16384;
    /// Flag: the eye path to it chose one component of a mirror or glass at random.
    pub const CHOSE: u32 = 32768;
    /// Flag: the eye path to it passed at least three mirrors and surfaces of glass.
    pub const DEEP: u32 = 262_144;
    /// One component, counted from the first, of an eye path: that whose slot receives the next one that splits off.
    pub const ONE_FREE: u32 = 65536;

    /// The bits of 1.0, which are in every word with a flag, see `shaders/include/flags.wgsl`.
    const FLAGS: u32 = 0x3f80_0000;

    /// The flags that a word holds: none, unless a pass wrote it.
    pub fn flags(word: f32) -> u32 {
        let flags = word.to_bits() ^ ShadingPoints::FLAGS;
        if flags < 2 * ShadingPoints::DEEP { flags } else { 0 }
    }

    /// Segments of the eye path beyond its first surface that is neither mirror nor glass, of [`ShadingPoints::flags`].
    pub fn segments(flags: u32) -> u32 {
        (flags / ShadingPoints::ONE_SEGMENT) & 15
    }

    /// Component of an eye path whose slot receives the next one that splits off, of [`ShadingPoints::flags`]; 0: none does.
    pub fn free_component(flags: u32) -> u32 {
        (flags / ShadingPoints::ONE_FREE) & 3
    }

    /// The word that holds these flags.
    pub fn word(flags: u32) -> f32 {
        f32::from_bits(ShadingPoints::FLAGS | flags)
    }

    /// Allocates `count` points.
    pub fn new(context: &Context, name: &str, count: u32) -> Result<ShadingPoints> {
        let array = |what: &str| vec4s(context, &format!("{name} {what}"), count);
        Ok(ShadingPoints {
            position: array("position")?,
            geometric: array("geometric normal")?,
            shading: array("shading normal")?,
            kd: array("kd")?,
            f0: array("f0")?,
            wo: array("wo")?,
            emitted: array("emitted")?,
        })
    }

    /// The buffers by their names in shaders.
    pub fn resources(&self) -> Resources {
        Resources::of([
            ("point_position", &self.position),
            ("point_geometric", &self.geometric),
            ("point_shading", &self.shading),
            ("point_kd", &self.kd),
            ("point_f0", &self.f0),
            ("point_wo", &self.wo),
            ("emitted", &self.emitted),
        ])
    }
}

/// Light that arrives at shading points, in parallel arrays.
#[derive(Clone)]
pub struct Lighting {
    /// Irradiance from the emitters.
    pub direct: Buffer,
    /// Irradiance from all other light.
    pub indirect: Buffer,
    /// Radiance that the specular lobe sends to wo.
    pub specular: Buffer,
}

impl Lighting {
    /// Allocates `count` points.
    pub fn new(context: &Context, name: &str, count: u32) -> Result<Lighting> {
        let array = |what: &str| vec4s(context, &format!("{name} {what}"), count);
        Ok(Lighting { direct: array("direct")?, indirect: array("indirect")?, specular: array("specular")? })
    }

    /// The buffers by their names in shaders.
    pub fn resources(&self) -> Resources {
        Resources::of([("direct", &self.direct), ("indirect", &self.indirect), ("specular", &self.specular)])
    }
}

/// A list of shading points or of tiles, and its length.
#[derive(Clone)]
pub struct List {
    /// Slots: first one for each pixel, then one for the second component of each pixel, then one for the third. Or numbers of tiles.
    pub entries: Buffer,
    /// A [`layout::DispatchCounts`].
    pub work: Buffer,
}

impl List {
    /// A list in `entries`, with counts of its own.
    pub fn new(kit: &Kit, name: &str, entries: &Buffer) -> Result<List> {
        Ok(List { entries: entries.clone(), work: kit.work(&format!("{name} work"))? })
    }

    /// Bound as the only list of a kernel.
    pub fn resources(&self) -> Resources {
        Resources::of([("list", &self.entries), ("work", &self.work)])
    }

    /// Bound as the list that a kernel reads.
    pub fn as_input(&self) -> Resources {
        Resources::of([("list_in", &self.entries), ("work_in", &self.work)])
    }

    /// Bound as the list that a kernel fills.
    pub fn as_output(&self) -> Resources {
        Resources::of([("list_out", &self.entries), ("work_out", &self.work)])
    }

    /// Bound as a list of tiles.
    pub fn as_tiles(&self) -> Resources {
        Resources::of([("tiles", &self.entries), ("work", &self.work)])
    }
}
