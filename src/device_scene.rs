//! The scene, ready for light transport: its tree, emitters, targets and mirrors on the host, and their buffers on the
//! device. It outlives frames, settings and image sizes.
//!
//! On the device: BVH, triangles, materials, emitters, in arrays that each fit one storage binding (128 MiB on the smallest
//! devices: 8 million nodes, 4 million triangles with textures); and textures in images, see [`texels`].

mod records;
pub mod texels;
mod update;

use std::ops::Range;
use std::sync::Arc;

use bytemuck::Pod;
use glam::Vec3;

use crate::accel::Bvh;
use crate::accel::objects::ObjectTrees;
use crate::accel::wide::WideBvh;
use crate::bsdf::Reflectance;
use crate::bsdf::table::{self, Table};
use crate::error::{Error, Result};
use crate::gpu::{Buffer, Context, Resources, Staging};
use crate::light::emitters::Emitters;
use crate::light::mirrors::Mirrors;
use crate::light::targets::Targets;
use crate::pass::kept_light::KeptBuffers;
use crate::pass::layout::PointLight;
use crate::pass::mirror_image::Tables;
use crate::pass::reproject::DepthImageBuffers;
use crate::plan::{CARD_LOOP_FACTOR, RayClusters};
use crate::sampling::sobol;
use crate::scene::reflectors::Reflector;
use crate::scene::{Scene, Surface};
use crate::superposition::lobe::Lobe;

pub(crate) use records::is_shiny;
pub use records::{delta_lights, encode_normal};
use records::{
    environment_record, finishes, has_lobe, has_patterns, material_record, reflector_bits, second_coordinates,
    shading_attributes, vertex_colors,
};
use texels::DeviceTextures;
pub use update::SceneChanges;

/// Words of the stack in `shaders/shade_cluster.wgsl`.
const CLUSTER_STACK: u32 = 16;

/// Maximum number of wide nodes: a word of that stack has 24 bits for one.
const MAX_WIDE_NODES: u32 = 1 << 24;

/// Exclusive upper bound of the number of materials: a word of `normals` has 22 bits for one.
const MAX_MATERIALS: usize = 1 << 22;

/// A scene on the device; written before the first frame, and in part again before frames that follow scene edits.
pub struct DeviceScene {
    /// The acceleration structure.
    pub bvh: Bvh,
    /// The emitters.
    pub emitters: Emitters,
    /// Whether imported lights hold all light, reflected light included: no particle starts from them.
    pub lights_are_complete: bool,
    /// Lights without area, each used once a pass or chosen from.
    pub delta: Vec<PointLight>,
    /// Targets of photons.
    pub targets: Targets,
    /// Planar mirrors.
    pub mirrors: Mirrors,
    /// Flat and curved reflectors; number i + 1 in `normals` is `reflectors[i]`.
    pub reflectors: Vec<Reflector>,
    /// Finishes of the reflectors, with mean texture values.
    pub finishes: Vec<ReflectorFinish>,
    /// Ideal surfaces that eye paths may meet.
    pub specular: SpecularFeatures,
    /// See [`Scene::mean_albedos`].
    pub albedos: Vec<f32>,
    /// Whether there are textures or vertex colours.
    pub textured: bool,
    /// Whether some surfaces let rays pass.
    pub has_alpha: bool,
    /// See [`crate::plan::SceneSize::loop_factor`].
    pub loop_factor: u32,
    /// Whether its objects may move.
    pub movable: bool,
    /// Lower corners of the nodes, and skip indices.
    pub node_min: Buffer,
    /// Upper corners of the nodes, and leaf words.
    pub node_max: Buffer,
    /// Nodes of the eight-wide hierarchy; `None` if it is not used, or deeper than the kernel's stack.
    pub wide_nodes: Option<Buffer>,
    /// First vertices, in the order of the leaves.
    pub v0: Buffer,
    /// First edges.
    pub e1: Buffer,
    /// Second edges.
    pub e2: Buffer,
    /// Vertex normals, octahedral, with reflector, material and smoothness; then vertex colours.
    pub normals: Buffer,
    /// Texture coordinates, two vec4 a triangle; then the second ones.
    pub uvs: Buffer,
    /// [`crate::pass::layout::MaterialRecord`]s.
    pub materials: Buffer,
    /// Tables of the materials' lobes, as `shaders/include/lobe_table.wgsl` reads them.
    pub lobe_tables: Buffer,
    /// The input of the tables.
    lobes: Vec<Option<Arc<Table>>>,
    /// The textures.
    pub textures: DeviceTextures,
    /// [`crate::light::emitters::EmitterRecord`]s.
    pub emitter_records: Buffer,
    /// The environment, or a black one: its axes, with the bits of its size, then its texels.
    pub environment: Buffer,
    /// [`crate::sampling::sobol::column_pairs`], the same for every scene.
    pub sobol_columns: Buffer,
    /// Targets; `None`: there are none.
    pub target_buffers: Option<TargetBuffers>,
    /// Records of the planar mirrors; `None`: there are none.
    pub mirror_buffers: Option<MirrorBuffers>,
    /// Light kept in textures; `None`: virtual lights light the scene.
    pub kept_light: Option<KeptBuffers>,
    /// Mirror images of the reflectors; `None`: rays show what they reflect.
    pub mirror_images: Option<DepthImageBuffers>,
    /// Surfaces of splats; `None`: they were not asked for.
    pub surfaces: Option<SurfaceBuffers>,
    /// Kernels and reflectances of the reflectors, made on first use.
    tables: Option<Tables>,
}

/// Planar mirrors on the device.
#[derive(Clone)]
pub struct MirrorBuffers {
    /// [`crate::pass::layout::MirrorRecord`]s.
    pub records: Buffer,
    /// For each triangle the number of its mirror + 1, or 0.
    pub of_triangle: Buffer,
}

/// Targets on the device.
#[derive(Clone)]
pub struct TargetBuffers {
    /// Two vec4 each: centre and radius of the sphere; weight, area, bits of first and end of its triangles.
    pub list: Buffer,
    /// [`crate::light::targets::TargetTriangle`]s of the sparse ones; at least one, which may be no target's.
    pub triangles: Buffer,
    /// For each triangle the number of its target + 1, or 0.
    pub of_triangle: Buffer,
}

/// Surfaces of splats on the device.
#[derive(Clone)]
pub struct SurfaceBuffers {
    /// Their number.
    pub count: u32,
    /// Bits of the area, first edge and end of its edges, of each; at least one.
    pub records: Buffer,
    /// Two vec4 for each edge of an outline; at least one, which may be no surface's.
    pub edges: Buffer,
    /// For each triangle the number of its surface + 1, or 0.
    pub of_triangle: Buffer,
    /// Lobes with a greater alpha count.
    pub alpha: f32,
}

/// Finish of a reflector, with mean texture values.
#[derive(Clone, Debug, PartialEq)]
pub struct ReflectorFinish {
    /// Reflectance and roughness.
    pub reflectance: Reflectance,
    /// The lobe that spreads its mirror image.
    pub lobe: Lobe,
}

/// Kinds of ideally reflecting or refracting surfaces in a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SpecularFeatures {
    /// Whether there are mirrors or glass.
    pub any: bool,
    /// Whether some have two components: glass, mirrors over a diffuse base.
    pub splits: bool,
    /// Whether there are mirrors without a diffuse base.
    pub plain_mirrors: bool,
    /// Whether there is glass.
    pub glass: bool,
    /// Whether there are surfaces with a specular lobe.
    pub lobes: bool,
    /// Whether there are lobes that eye paths may follow.
    pub shiny: bool,
    /// Whether there are reflectors with a lobe; superposition treats them as mirrors over a base.
    pub glossy_planes: bool,
    /// Whether some of them are curved.
    pub curved: bool,
    /// Whether there are frosted panes among the planar reflectors; superposition spreads the scene behind them.
    pub frosted_panes: bool,
}

impl SpecularFeatures {
    /// Whether superposition has planes to spread images over.
    pub fn spreads(&self) -> bool {
        self.glossy_planes || self.frosted_panes
    }

    /// From the materials in use.
    pub(crate) fn of(scene: &Scene, reflectors: &[Reflector]) -> SpecularFeatures {
        let mut used = vec![false; scene.materials.len()];
        scene.triangles.iter().for_each(|t| used[t.material as usize] = true);
        let glossy = |r: &Reflector| scene.materials[r.material as usize].surface == Surface::Opaque;
        let mut ideal = SpecularFeatures {
            glossy_planes: reflectors.iter().any(glossy),
            curved: reflectors.iter().any(|r| r.curved),
            frosted_panes: reflectors.iter().any(|r| r.pane),
            ..SpecularFeatures::default()
        };
        for (m, _) in scene.materials.iter().zip(used).filter(|(_, used)| *used) {
            ideal.any |= m.surface != Surface::Opaque;
            ideal.plain_mirrors |= m.surface == Surface::Mirror && m.base_color == Vec3::ZERO;
            ideal.glass |= m.surface == Surface::Glass;
            ideal.lobes |= has_lobe(m);
            ideal.shiny |= is_shiny(m);
            ideal.splits |= match m.surface {
                Surface::Opaque => false,
                Surface::Mirror => {
                    m.base_color != Vec3::ZERO && (m.metallic < 1.0 || m.metallic_roughness_texture.is_some())
                }
                Surface::Glass => true,
            };
        }
        ideal
    }
}

impl DeviceScene {
    /// Builds the tree, finds emitters, targets and mirrors, creates the buffers and stages their contents. `clusters`:
    /// includes what the cluster kernels need.
    ///
    /// Errors: a scene without light, or beyond the device's limits or memory.
    pub fn new(context: &Context, staging: &mut Staging, scene: &Scene, clusters: bool) -> Result<DeviceScene> {
        let bvh = Bvh::build(scene)?;
        let wide = clusters.then(|| WideBvh::build(&bvh));
        Self::with_tree(context, staging, scene, bvh, wide.as_ref())
    }

    /// As [`DeviceScene::new`], with a tree of object trees whose objects may move.
    pub fn new_dynamic(
        context: &Context,
        staging: &mut Staging,
        scene: &Scene,
        clusters: bool,
    ) -> Result<(DeviceScene, ObjectTrees)> {
        let (trees, bvh) = ObjectTrees::build(scene, clusters)?;
        let scene = Self::with_tree(context, staging, scene, bvh, trees.wide.as_ref())?;
        Ok((DeviceScene { movable: true, ..scene }, trees))
    }

    fn with_tree(
        context: &Context,
        staging: &mut Staging,
        scene: &Scene,
        bvh: Bvh,
        wide: Option<&WideBvh>,
    ) -> Result<DeviceScene> {
        let emitters = Emitters::of(scene, scene.emitters_are_lights)?;
        let has_alpha = scene.has_alpha();
        let wide_nodes = match wide.filter(|wide| fits_kernel(wide)) {
            Some(wide) => Some(staging.stage(context, "scene wide nodes", &wide.nodes)?),
            None => None,
        };
        if scene.materials.len() >= MAX_MATERIALS {
            let count = scene.materials.len();
            return Err(Error::Scene(format!(
                "{count} materials; the device's tables number fewer than {MAX_MATERIALS}"
            )));
        }
        scene.check_tables().map_err(Error::Scene)?;
        let reflectors = scene.reflectors();
        let of_triangle = reflector_bits(scene, &reflectors);
        let (mut normals, mut uvs) = shading_attributes(scene, &bvh, &of_triangle, 0..bvh.triangle_count() as usize);
        normals.extend(vertex_colors(scene));
        if has_patterns(scene) {
            uvs.extend(second_coordinates(scene));
        }
        let materials: Vec<_> = (0..).zip(&scene.materials).map(|(i, m)| material_record(i, m)).collect();
        let mut device_scene = DeviceScene {
            node_min: staging.stage(context, "scene node minima", &bvh.node_min)?,
            node_max: staging.stage(context, "scene node maxima", &bvh.node_max)?,
            wide_nodes,
            v0: staging.stage(context, "scene triangle vertices", &bvh.v0)?,
            e1: staging.stage(context, "scene triangle edges 1", &bvh.e1)?,
            e2: staging.stage(context, "scene triangle edges 2", &bvh.e2)?,
            normals: staging.stage(context, "scene normals", &normals)?,
            uvs: staging.stage(context, "scene texture coordinates", &uvs)?,
            materials: staging.stage(context, "scene materials", &materials)?,
            lobe_tables: staging.stage(context, "scene lobe tables", &table::words(&scene.materials))?,
            lobes: scene.lobes(),
            textures: DeviceTextures::new(context, staging, scene)?,
            emitter_records: staging.stage(context, "scene emitters", &emitters.records())?,
            environment: staging.stage(context, "scene environment", &environment_record(scene, &emitters))?,
            sobol_columns: staging.stage(context, "columns of Sobol'", &sobol::column_pairs())?,
            delta: delta_lights(scene, bvh.typical_scale()),
            specular: SpecularFeatures::of(scene, &reflectors),
            albedos: scene.mean_albedos(),
            textured: has_patterns(scene),
            has_alpha,
            loop_factor: match context.info().device_type {
                ash::vk::PhysicalDeviceType::CPU => 1,
                _ => CARD_LOOP_FACTOR,
            },
            movable: false,
            finishes: finishes(scene, &reflectors),
            reflectors,
            targets: Targets::default(),
            mirrors: Mirrors::default(),
            target_buffers: None,
            mirror_buffers: None,
            kept_light: match &scene.kept_light {
                Some(light) => Some(KeptBuffers::new(context, staging, &bvh, light)?),
                None => None,
            },
            mirror_images: match &scene.mirror_images {
                Some(images) => Some(DepthImageBuffers::new(context, staging, images)?),
                None => None,
            },
            surfaces: None,
            tables: None,
            emitters,
            lights_are_complete: !scene.emitters_are_lights,
            bvh,
        };
        device_scene.update_mirrors(context, staging, scene)?;
        device_scene.update_targets(context, staging, scene)?;
        Ok(device_scene)
    }

    /// Makes the tables of the glossy planes on first use: some 200 ms for each kind of lobe.
    pub fn make_tables(&mut self, context: &Context, staging: &mut Staging) -> Result<()> {
        if self.tables.is_none() {
            self.tables = Some(Tables::new(context, staging, &self.finishes, &self.reflectors)?);
        }
        Ok(())
    }

    /// Tables of the glossy planes, once made.
    pub fn tables(&self) -> Option<&Tables> {
        self.tables.as_ref()
    }

    /// Indices of the emitters without area, in the order of [`DeviceScene::delta`].
    pub fn delta_emitters(&self) -> Vec<u32> {
        self.emitters.delta.iter().map(|&i| i as u32).collect()
    }

    /// Triangles that may move: all or none.
    pub fn movable_triangles(&self) -> u32 {
        if self.movable { self.bvh.triangle_count() } else { 0 }
    }

    /// Number of targets of photons.
    pub fn target_count(&self) -> u32 {
        self.targets.list.len() as u32
    }

    /// Number of planar mirrors.
    pub fn mirror_count(&self) -> u32 {
        self.mirrors.list.len() as u32
    }

    /// Clusters of rays, if the scene has what their kernels need.
    pub fn clusters(&self, context: &Context) -> Option<RayClusters> {
        let clusters = RayClusters { lanes: context.info().subgroup_size, has_alpha: self.has_alpha };
        self.wide_nodes.as_ref().map(|_| clusters)
    }

    /// All buffers by their names in shaders.
    pub fn resources(&self) -> Resources {
        let mut all = Resources::of([
            ("node_min", &self.node_min),
            ("node_max", &self.node_max),
            ("triangle_v0", &self.v0),
            ("triangle_e1", &self.e1),
            ("triangle_e2", &self.e2),
            ("triangle_normals", &self.normals),
            ("triangle_uvs", &self.uvs),
            ("materials", &self.materials),
            ("lobe_tables", &self.lobe_tables),
            ("emitters", &self.emitter_records),
            ("environment", &self.environment),
            ("sobol_columns", &self.sobol_columns),
        ])
        .and(&self.textures.resources());
        if let Some(wide_nodes) = &self.wide_nodes {
            all = all.with("wide_nodes", wide_nodes);
        }
        if let Some(mirrors) = &self.mirror_buffers {
            all = all.with("mirrors", &mirrors.records).with("mirror_of", &mirrors.of_triangle);
        }
        if let Some(targets) = &self.target_buffers {
            all = all.with("targets", &targets.list).with("target_triangles", &targets.triangles);
            all = all.with("target_of", &targets.of_triangle);
            // Photons read the mirror of a triangle only if lights are mirrored; without mirrors this buffer takes the
            // binding.
            all = all.with("mirror_of", &targets.of_triangle);
        }
        all
    }

    /// Whether materials have lobes by tables.
    pub fn has_tables(&self) -> bool {
        self.lobes.iter().any(Option::is_some)
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        self.resources().bytes()
    }
}

/// Whether the cluster kernel can walk a tree: its stack holds every path, and its words every node.
fn fits_kernel(wide: &WideBvh) -> bool {
    wide.stack_bound() <= CLUSTER_STACK && wide.node_count() <= MAX_WIDE_NODES
}

/// Stages ranges of a buffer's new content, or replaces the buffer if it is too small. Returns whether it was replaced.
fn write<T: Pod>(
    context: &Context,
    staging: &mut Staging,
    buffer: &mut Buffer,
    data: &[T],
    ranges: &[Range<usize>],
) -> Result<bool> {
    if size_of_val(data) as u64 > buffer.bytes() {
        *buffer = staging.stage(context, buffer.name(), data)?;
        return Ok(true);
    }
    staging.stage_ranges(context, buffer, data, ranges)?;
    Ok(false)
}
