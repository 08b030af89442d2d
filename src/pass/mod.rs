//! The passes of a frame, one file each with its shader of the same stem (`shade`, `trace` and `importance` have a second one,
//! `clusters`, `sort`, `tiles`, `photon_grid` and `mirror_lights` one for each of their steps), in the order of `frame.rs`.
//!
//! A pass file reads: what it computes and from which equation, its named inputs and outputs, `record`, and `reference`,
//! the CPU oracle that the tests hold the shader against.

pub mod accumulate;
pub mod camera_rays;
pub mod clusters;
pub mod collect;
pub mod convolve;
pub mod delta_choice;
pub mod discontinuity;
pub mod eye_paths;
pub mod gather;
pub mod importance;
pub mod layout;
pub mod lens;
pub mod merge;
pub mod mirror_image;
pub mod mirror_lights;
pub mod photon_find;
pub mod photon_follow;
pub mod photon_grid;
pub mod photon_light;
pub mod photon_start;
pub mod receivers;
pub mod resolve;
pub mod schedule;
pub mod shade;
pub mod sort;
pub mod summands;
pub mod superpose;
pub mod tiles;
pub mod trace;
pub mod visibility;
pub mod walk_reflect;
pub mod walk_start;

use ash::vk;

use crate::error::{Error, Result};
use crate::gpu::{Buffer, Context, Kernel, Memory, Shader, shaders};
use crate::settings::Traversal;

/// Invocations of a workgroup, in every pass but `schedule` and the cluster form of `shade`.
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

/// A kernel that traces rays, in its two forms.
pub struct Forms {
    /// An invocation traces a ray.
    pub single: Kernel,
    /// A subgroup traces a cluster; `None`: rays are traced one by one.
    pub cluster: Option<Kernel>,
    /// The cluster form counts what it meets.
    pub count: bool,
}

impl Forms {
    /// Those of the pass `shade`.
    pub fn shade(context: &Context, traversal: Traversal) -> Result<Forms> {
        let clusters = [
            (4, &shaders::SHADE_CLUSTER_4),
            (8, &shaders::SHADE_CLUSTER_8),
            (16, &shaders::SHADE_CLUSTER_16),
            (32, &shaders::SHADE_CLUSTER_32),
            (64, &shaders::SHADE_CLUSTER_64),
        ];
        Forms::new(context, traversal, &shaders::SHADE, &clusters)
    }

    /// Those of the pass `trace`.
    pub fn trace(context: &Context, traversal: Traversal) -> Result<Forms> {
        let clusters = [
            (4, &shaders::TRACE_CLUSTER_4),
            (8, &shaders::TRACE_CLUSTER_8),
            (16, &shaders::TRACE_CLUSTER_16),
            (32, &shaders::TRACE_CLUSTER_32),
            (64, &shaders::TRACE_CLUSTER_64),
        ];
        Forms::new(context, traversal, &shaders::TRACE, &clusters)
    }

    /// Those of the pass `visibility`.
    pub fn visibility(context: &Context, traversal: Traversal) -> Result<Forms> {
        let clusters = [
            (4, &shaders::VISIBILITY_CLUSTER_4),
            (8, &shaders::VISIBILITY_CLUSTER_8),
            (16, &shaders::VISIBILITY_CLUSTER_16),
            (32, &shaders::VISIBILITY_CLUSTER_32),
            (64, &shaders::VISIBILITY_CLUSTER_64),
        ];
        Forms::new(context, traversal, &shaders::VISIBILITY, &clusters)
    }

    /// Those of the pass `visibility` for area lights.
    pub fn visibility_area(context: &Context, traversal: Traversal) -> Result<Forms> {
        let clusters = [
            (4, &shaders::VISIBILITY_AREA_CLUSTER_4),
            (8, &shaders::VISIBILITY_AREA_CLUSTER_8),
            (16, &shaders::VISIBILITY_AREA_CLUSTER_16),
            (32, &shaders::VISIBILITY_AREA_CLUSTER_32),
            (64, &shaders::VISIBILITY_AREA_CLUSTER_64),
        ];
        Forms::new(context, traversal, &shaders::VISIBILITY_AREA, &clusters)
    }

    /// Those of the pass `visibility` that count what clusters meet.
    pub fn counters(context: &Context) -> Result<Forms> {
        let clusters = [
            (4, &shaders::COUNTERS_4),
            (8, &shaders::COUNTERS_8),
            (16, &shaders::COUNTERS_16),
            (32, &shaders::COUNTERS_32),
            (64, &shaders::COUNTERS_64),
        ];
        let forms = Forms::new(context, Traversal::Cluster, &shaders::VISIBILITY, &clusters)?;
        Ok(Forms { count: true, ..forms })
    }

    /// The same for area lights.
    pub fn counters_area(context: &Context) -> Result<Forms> {
        let clusters = [
            (4, &shaders::COUNTERS_AREA_4),
            (8, &shaders::COUNTERS_AREA_8),
            (16, &shaders::COUNTERS_AREA_16),
            (32, &shaders::COUNTERS_AREA_32),
            (64, &shaders::COUNTERS_AREA_64),
        ];
        let forms = Forms::new(context, Traversal::Cluster, &shaders::VISIBILITY_AREA, &clusters)?;
        Ok(Forms { count: true, ..forms })
    }

    /// `clusters`: shaders by the size of the subgroup.
    fn new(
        context: &Context,
        traversal: Traversal,
        single: &'static Shader,
        clusters: &[(u32, &'static Shader)],
    ) -> Result<Forms> {
        let info = context.info();
        let operations = vk::SubgroupFeatureFlags::BASIC | vk::SubgroupFeatureFlags::SHUFFLE;
        let able = info.subgroup_operations.contains(operations);
        let shader = clusters.iter().find(|(size, _)| able && *size == info.subgroup_size);
        let cluster = match (traversal, shader) {
            (Traversal::Auto | Traversal::Cluster, Some((_, shader))) => Some(Kernel::new(context, shader)?),
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
        Ok(Forms { single: Kernel::new(context, single)?, cluster, count: false })
    }
}

/// The compiled shaders, shared by all passes that run them.
pub struct Kernels {
    /// `accumulate.wgsl`
    pub accumulate: Kernel,
    /// `camera_rays.wgsl`
    pub camera_rays: Kernel,
    /// `clusters_fill.wgsl`
    pub clusters_fill: Kernel,
    /// `clusters_list.wgsl`
    pub clusters_list: Kernel,
    /// `clusters_mark.wgsl`
    pub clusters_mark: Kernel,
    /// `collect.wgsl`
    pub collect: Kernel,
    /// `delta_choice.wgsl`
    pub delta_choice: Kernel,
    /// `eye_paths.wgsl`
    pub eye_paths: Kernel,
    /// `gather.wgsl`
    pub gather: Kernel,
    /// `importance.wgsl`
    pub importance: Kernel,
    /// `importance_scan.wgsl`
    pub importance_scan: Kernel,
    /// `merge.wgsl`
    pub merge: Kernel,
    /// `mirror_image.wgsl`
    pub mirror_image: Kernel,
    /// `mirror_aim.wgsl`
    pub mirror_aim: Kernel,
    /// `mirror_choose.wgsl`
    pub mirror_choose: Kernel,
    /// `mirror_light.wgsl`
    pub mirror_light: Kernel,
    /// `mirror_turn.wgsl`
    pub mirror_turn: Kernel,
    /// `photon_cells.wgsl`
    pub photon_cells: Kernel,
    /// `photon_find.wgsl`
    pub photon_find: Kernel,
    /// `photon_follow.wgsl`
    pub photon_follow: Kernel,
    /// `photon_keys.wgsl`
    pub photon_keys: Kernel,
    /// `photon_light.wgsl`
    pub photon_light: Kernel,
    /// `photon_start.wgsl`
    pub photon_start: Kernel,
    /// `receivers.wgsl`
    pub receivers: Kernel,
    /// `resolve.wgsl`
    pub resolve: Kernel,
    /// `schedule.wgsl`
    pub schedule: Kernel,
    /// `shade.wgsl` and `shade_cluster.wgsl`
    pub shade: Forms,
    /// `sort_classes.wgsl`
    pub sort_classes: Kernel,
    /// `sort_keys.wgsl`
    pub sort_keys: Kernel,
    /// `sort_count.wgsl`
    pub sort_count: Kernel,
    /// `sort_sum.wgsl`
    pub sort_sum: Kernel,
    /// `sort_scan.wgsl`
    pub sort_scan: Kernel,
    /// `sort_scatter.wgsl`
    pub sort_scatter: Kernel,
    /// `summands.wgsl`
    pub summands: Kernel,
    /// `superpose.wgsl`
    pub superpose: Kernel,
    /// `tiles_mark.wgsl`
    pub tiles_mark: Kernel,
    /// `tiles_list.wgsl`
    pub tiles_list: Kernel,
    /// `trace.wgsl` and `trace_cluster.wgsl`
    pub trace: Forms,
    /// `walk_reflect.wgsl`
    pub walk_reflect: Kernel,
    /// `walk_start.wgsl`
    pub walk_start: Kernel,
}

impl Kernels {
    /// Creates the pipelines for any scene.
    pub fn new(context: &Context, traversal: Traversal) -> Result<Kernels> {
        Self::for_scene(context, traversal, true)
    }

    /// Creates the pipelines for scenes that are `textured`, or for those that are not.
    pub fn for_scene(context: &Context, traversal: Traversal, textured: bool) -> Result<Kernels> {
        let surface = |with: &'static Shader, without| Kernel::new(context, if textured { with } else { without });
        Ok(Kernels {
            accumulate: Kernel::new(context, &shaders::ACCUMULATE)?,
            camera_rays: Kernel::new(context, &shaders::CAMERA_RAYS)?,
            clusters_fill: Kernel::new(context, &shaders::CLUSTERS_FILL)?,
            clusters_list: Kernel::new(context, &shaders::CLUSTERS_LIST)?,
            clusters_mark: Kernel::new(context, &shaders::CLUSTERS_MARK)?,
            collect: Kernel::new(context, &shaders::COLLECT)?,
            delta_choice: Kernel::new(context, &shaders::DELTA_CHOICE)?,
            eye_paths: surface(&shaders::EYE_PATHS, &shaders::EYE_PATHS_UNTEXTURED)?,
            gather: Kernel::new(context, &shaders::GATHER)?,
            importance: Kernel::new(context, &shaders::IMPORTANCE)?,
            importance_scan: Kernel::new(context, &shaders::IMPORTANCE_SCAN)?,
            merge: Kernel::new(context, &shaders::MERGE)?,
            mirror_image: Kernel::new(context, &shaders::MIRROR_IMAGE)?,
            mirror_aim: Kernel::new(context, &shaders::MIRROR_AIM)?,
            mirror_choose: Kernel::new(context, &shaders::MIRROR_CHOOSE)?,
            mirror_light: Kernel::new(context, &shaders::MIRROR_LIGHT)?,
            mirror_turn: surface(&shaders::MIRROR_TURN, &shaders::MIRROR_TURN_UNTEXTURED)?,
            photon_cells: Kernel::new(context, &shaders::PHOTON_CELLS)?,
            photon_find: Kernel::new(context, &shaders::PHOTON_FIND)?,
            photon_follow: surface(&shaders::PHOTON_FOLLOW, &shaders::PHOTON_FOLLOW_UNTEXTURED)?,
            photon_keys: Kernel::new(context, &shaders::PHOTON_KEYS)?,
            photon_light: Kernel::new(context, &shaders::PHOTON_LIGHT)?,
            photon_start: Kernel::new(context, &shaders::PHOTON_START)?,
            receivers: surface(&shaders::RECEIVERS, &shaders::RECEIVERS_UNTEXTURED)?,
            resolve: Kernel::new(context, &shaders::RESOLVE)?,
            schedule: Kernel::new(context, &shaders::SCHEDULE)?,
            shade: Forms::shade(context, traversal)?,
            sort_classes: Kernel::new(context, &shaders::SORT_CLASSES)?,
            sort_keys: Kernel::new(context, &shaders::SORT_KEYS)?,
            sort_count: Kernel::new(context, &shaders::SORT_COUNT)?,
            sort_sum: Kernel::new(context, &shaders::SORT_SUM)?,
            sort_scan: Kernel::new(context, &shaders::SORT_SCAN)?,
            sort_scatter: Kernel::new(context, &shaders::SORT_SCATTER)?,
            summands: Kernel::new(context, &shaders::SUMMANDS)?,
            superpose: Kernel::new(context, &shaders::SUPERPOSE)?,
            tiles_mark: Kernel::new(context, &shaders::TILES_MARK)?,
            tiles_list: Kernel::new(context, &shaders::TILES_LIST)?,
            trace: Forms::trace(context, traversal)?,
            walk_reflect: surface(&shaders::WALK_REFLECT, &shaders::WALK_REFLECT_UNTEXTURED)?,
            walk_start: Kernel::new(context, &shaders::WALK_START)?,
        })
    }
}

/// A batch of rays and what they hit, in parallel arrays.
#[derive(Clone)]
pub struct Rays {
    /// Origins; w: greatest t.
    pub origin: Buffer,
    /// Unit directions; w, of eye paths: cosine of the first segment to the direction of view.
    pub direction: Buffer,
    /// t, u, v, bits of the triangle (all ones: none).
    pub hits: Buffer,
    /// Where the traversal stopped: light, node.
    pub progress: Buffer,
}

impl Rays {
    /// Room for `count` rays; `name` tells batches apart.
    pub fn new(context: &Context, name: &str, count: u32) -> Result<Rays> {
        Ok(Rays {
            origin: vec4s(context, &format!("{name} ray origins"), count)?,
            direction: vec4s(context, &format!("{name} ray directions"), count)?,
            hits: vec4s(context, &format!("{name} hits"), count)?,
            progress: Buffer::new(context, &format!("{name} progress"), 8 * u64::from(count), Memory::Device)?,
        })
    }
}

/// What eye paths carry to their receivers.
#[derive(Clone)]
pub struct Paths {
    /// Throughput of the mirrors and glass on the way; w: depth along the direction of view, as if the way were straight, and
    /// negative where the eye's own ray met nothing.
    pub throughput: Buffer,
    /// Bodies of glass around the ray, [`crate::bsdf::ideal::Media`].
    pub media: Buffer,
}

impl Paths {
    /// Room for `count` paths, `ideal` of which may meet mirrors and glass.
    pub fn new(context: &Context, count: u32, ideal: u32) -> Result<Paths> {
        Ok(Paths {
            throughput: vec4s(context, "eye throughput", count)?,
            media: vec4s(context, "eye media", ideal.max(1))?,
        })
    }
}

/// Receivers, slot by slot; `shaders/include/receiver.wgsl` says what each array holds.
#[derive(Clone)]
pub struct Receivers {
    /// Points; w: distance along the ray, negative where it hit nothing.
    pub position: Buffer,
    /// Geometric normals; w: f90.
    pub geometric: Buffer,
    /// Shading normals; w: alpha.
    pub shading: Buffer,
    /// Diffuse albedo; w: probability of the diffuse lobe.
    pub kd: Buffer,
    /// Specular reflectance; w: has a lobe.
    pub f0: Buffer,
    /// Direction back along the ray; w: is lit.
    pub wo: Buffer,
    /// Emitted radiance times throughput; w: eye's first lobe (0 diffuse, 1 specular); of what the eye sees 1 where it sees it
    /// by way of mirrors or glass.
    pub emitted: Buffer,
}

impl Receivers {
    /// Room for `count` receivers.
    pub fn new(context: &Context, name: &str, count: u32) -> Result<Receivers> {
        let array = |what: &str| vec4s(context, &format!("{name} {what}"), count);
        Ok(Receivers {
            position: array("position")?,
            geometric: array("geometric normal")?,
            shading: array("shading normal")?,
            kd: array("kd")?,
            f0: array("f0")?,
            wo: array("wo")?,
            emitted: array("emitted")?,
        })
    }
}

/// Light that arrives at receivers, in parallel arrays.
#[derive(Clone)]
pub struct Sums {
    /// Irradiance from the emitters.
    pub direct: Buffer,
    /// Irradiance from everything else.
    pub indirect: Buffer,
    /// Radiance that the specular lobe sends to wo.
    pub specular: Buffer,
}

impl Sums {
    /// Room for `count` receivers.
    pub fn new(context: &Context, name: &str, count: u32) -> Result<Sums> {
        let array = |what: &str| vec4s(context, &format!("{name} {what}"), count);
        Ok(Sums { direct: array("direct")?, indirect: array("indirect")?, specular: array("specular")? })
    }
}

/// A list of receivers, or of tiles, and how many it holds.
#[derive(Clone)]
pub struct List {
    /// Slots: pixels, and after them the pixels' second components. Or numbers of tiles.
    pub pixels: Buffer,
    /// A [`layout::Work`].
    pub work: Buffer,
}
