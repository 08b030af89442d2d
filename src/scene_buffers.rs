//! The scene on the device: BVH, triangles, materials, textures, emitters, in arrays that each keep within one storage
//! binding (128 MiB on the smallest devices: 8 million nodes, 4 million triangles with textures).

use std::ops::Range;

use crate::accel::Bvh;
use crate::accel::objects::Changes;
use crate::accel::wide::WideBvh;
use crate::bsdf::Reflectance;
use crate::bsdf::ideal::frost;
use crate::error::{Error, Result};
use crate::gpu::{Bound, Buffer, Context, Staging};
use crate::light::emitters::Emitters;
use crate::light::mirrors::Mirrors;
use crate::light::targets::Targets;
use crate::pass::layout::{MaterialRecord, PointLight, TextureRecord};
use crate::sampling::sobol;
use crate::scene::reflectors::Reflector;
use crate::scene::{Light, Scene, Surface, Texture, Wrap};
use crate::superposition::lobe::Lobe;
use bytemuck::Pod;
use glam::{Vec2, Vec3};

/// Words of the stack in `shaders/shade_cluster.wgsl`.
const CLUSTER_STACK: u32 = 16;

/// Greatest number of wide nodes: a word of that stack has 24 bits for one.
const MAX_WIDE_NODES: u32 = 1 << 24;

/// More materials than the words of `normals` have numbers for.
const MAX_MATERIALS: usize = 1 << 23;

/// Device buffers of a scene; written before the first frame, and in part again before a frame in which the scene changes.
#[derive(Clone)]
pub struct SceneBuffers {
    /// Lower corners of the nodes and skips.
    pub node_min: Buffer,
    /// Upper corners of the nodes and leaves.
    pub node_max: Buffer,
    /// Nodes of the eight-wide hierarchy; `None` if it is not wanted, or deeper than the kernel's stack.
    pub wide_nodes: Option<Buffer>,
    /// First vertices, in the order of the leaves.
    pub v0: Buffer,
    /// First edges.
    pub e1: Buffer,
    /// Second edges.
    pub e2: Buffer,
    /// Vertex normals, octahedral, with reflector, material and smoothness.
    pub normals: Buffer,
    /// Texture coordinates, two vec4 a triangle.
    pub uvs: Buffer,
    /// [`MaterialRecord`]s.
    pub materials: Buffer,
    /// [`TextureRecord`]s.
    pub textures: Buffer,
    /// RGBA8 texels of all textures.
    pub texels: Buffer,
    /// [`crate::light::emitters::EmitterRecord`]s.
    pub emitters: Buffer,
    /// Which of them are the lights without area, in the order of [`delta_lights`].
    pub delta_emitters: Vec<u32>,
    /// [`crate::sampling::sobol::column_pairs`], the same for every scene.
    pub sobol_columns: Buffer,
    /// What eye paths will meet.
    pub ideal: Ideal,
    /// What photons are shot at; `None`: there is nothing.
    pub targets: Option<TargetBuffers>,
    /// Planar reflectors, number i + 1 in `normals` being `reflectors[i]`.
    pub reflectors: Vec<Reflector>,
    /// What they are made of, textures by their mean.
    pub finishes: Vec<Finish>,
    /// Planar mirrors; `None`: there are none.
    pub mirrors: Option<MirrorBuffers>,
}

/// Planar mirrors on the device.
#[derive(Clone)]
pub struct MirrorBuffers {
    /// Number of mirrors, at least 1.
    pub count: u32,
    /// [`crate::pass::layout::MirrorRecord`]s.
    pub records: Buffer,
    /// For each triangle the number of its mirror + 1, or 0.
    pub of_triangle: Buffer,
}

/// Targets on the device.
#[derive(Clone)]
pub struct TargetBuffers {
    /// Number of targets, at least 1.
    pub count: u32,
    /// Their spheres: centre, radius.
    pub spheres: Buffer,
    /// For each triangle the number of its target + 1, or 0.
    pub of_triangle: Buffer,
}

/// What a planar reflector is made of, textures by their mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Finish {
    /// Reflectance and roughness.
    pub reflectance: Reflectance,
    /// The lobe that spreads its mirror image.
    pub lobe: Lobe,
}

/// Which surfaces of a scene reflect or refract ideally.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ideal {
    /// There are mirrors or glass.
    pub any: bool,
    /// Some have two components: glass, mirrors over a diffuse base.
    pub forks: bool,
    /// There are planar reflectors with a lobe, which superposition takes for mirrors over a base.
    pub glossy_planes: bool,
    /// There are frosted panes among the planar reflectors, which superposition spreads what is behind over.
    pub frosted_panes: bool,
}

impl Ideal {
    /// There are planes that superposition spreads images over.
    pub fn spreads(&self) -> bool {
        self.glossy_planes || self.frosted_panes
    }

    /// Looks at the materials that triangles have.
    pub(crate) fn of(scene: &Scene, reflectors: &[Reflector]) -> Ideal {
        let mut used = vec![false; scene.materials.len()];
        scene.triangles.iter().for_each(|t| used[t.material as usize] = true);
        let glossy = |r: &Reflector| scene.materials[r.material as usize].surface == Surface::Opaque;
        let mut ideal = Ideal {
            glossy_planes: reflectors.iter().any(glossy),
            frosted_panes: reflectors.iter().any(|r| r.pane),
            ..Ideal::default()
        };
        for (m, _) in scene.materials.iter().zip(used).filter(|(_, used)| *used) {
            ideal.any |= m.surface != Surface::Opaque;
            ideal.forks |= match m.surface {
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

impl SceneBuffers {
    /// Creates the buffers and stages their contents; `clusters`: with what the cluster kernel needs.
    pub fn new(
        context: &Context,
        staging: &mut Staging,
        scene: &Scene,
        bvh: &Bvh,
        emitters: &Emitters,
        clusters: bool,
    ) -> Result<SceneBuffers> {
        let wide = clusters.then(|| WideBvh::build(bvh));
        Self::with_wide(context, staging, scene, bvh, emitters, wide.as_ref())
    }

    /// As [`SceneBuffers::new`], with an eight-wide tree that is there already.
    pub fn with_wide(
        context: &Context,
        staging: &mut Staging,
        scene: &Scene,
        bvh: &Bvh,
        emitters: &Emitters,
        wide: Option<&WideBvh>,
    ) -> Result<SceneBuffers> {
        let wide_nodes = match wide.filter(|wide| fits_kernel(wide)) {
            Some(wide) => Some(staging.stage(context, "scene wide nodes", &wide.nodes)?),
            None => None,
        };
        let (textures, texels) = pack_textures(&scene.textures)?;
        if scene.materials.len() >= MAX_MATERIALS {
            let count = scene.materials.len();
            return Err(Error::Scene(format!(
                "{count} materials; the device's tables number fewer than {MAX_MATERIALS}"
            )));
        }
        let reflectors = scene.reflectors();
        let of_triangle = reflector_numbers(scene, &reflectors);
        let (normals, uvs) = shading_attributes(scene, bvh, &of_triangle, 0..bvh.triangle_count() as usize);
        let materials: Vec<_> = scene.materials.iter().map(material_record).collect();
        Ok(SceneBuffers {
            node_min: staging.stage(context, "scene node minima", &bvh.node_min)?,
            node_max: staging.stage(context, "scene node maxima", &bvh.node_max)?,
            wide_nodes,
            v0: staging.stage(context, "scene triangle vertices", &bvh.v0)?,
            e1: staging.stage(context, "scene triangle edges 1", &bvh.e1)?,
            e2: staging.stage(context, "scene triangle edges 2", &bvh.e2)?,
            normals: staging.stage(context, "scene normals", &normals)?,
            uvs: staging.stage(context, "scene texture coordinates", &uvs)?,
            materials: staging.stage(context, "scene materials", &materials)?,
            textures: staging.stage(context, "scene textures", &textures)?,
            texels: staging.stage(context, "scene texels", &texels)?,
            emitters: staging.stage(context, "scene emitters", &emitters.records())?,
            delta_emitters: emitters.delta.iter().map(|&i| i as u32).collect(),
            sobol_columns: staging.stage(context, "columns of Sobol'", &sobol::column_pairs())?,
            ideal: Ideal::of(scene, &reflectors),
            targets: None,
            finishes: finishes(scene, &reflectors),
            reflectors,
            mirrors: None,
        })
    }

    /// Number of targets of photons.
    pub fn target_count(&self) -> u32 {
        self.targets.as_ref().map_or(0, |targets| targets.count)
    }

    /// Stages what photons are shot at, or what it has become. True: buffers were replaced, and whoever has bound them must bind
    /// the new ones.
    pub fn update_targets(&mut self, context: &Context, staging: &mut Staging, targets: &Targets) -> Result<bool> {
        let count = targets.spheres.len() as u32;
        let spheres: Vec<[f32; 4]> = targets.spheres.iter().map(|s| s.center.extend(s.radius).to_array()).collect();
        match &self.targets {
            None if count == 0 => return Ok(false),
            Some(old) if old.count == count => {
                staging.stage_into(context, &old.spheres, 0, &spheres)?;
                staging.stage_into(context, &old.of_triangle, 0, &targets.of_triangle)?;
                return Ok(false);
            }
            _ => {}
        }
        self.targets = match count {
            0 => None,
            _ => Some(TargetBuffers {
                count,
                spheres: staging.stage(context, "photon targets", &spheres)?,
                of_triangle: staging.stage(context, "photon targets of triangles", &targets.of_triangle)?,
            }),
        };
        Ok(true)
    }

    /// Number of planar mirrors.
    pub fn mirror_count(&self) -> u32 {
        self.mirrors.as_ref().map_or(0, |mirrors| mirrors.count)
    }

    /// Stages the planar mirrors, or what they have become. True: buffers were replaced, as above.
    pub fn update_mirrors(&mut self, context: &Context, staging: &mut Staging, mirrors: &Mirrors) -> Result<bool> {
        let count = mirrors.list.len() as u32;
        match &self.mirrors {
            None if count == 0 => return Ok(false),
            Some(old) if old.count == count => {
                staging.stage_into(context, &old.records, 0, &mirrors.list)?;
                staging.stage_into(context, &old.of_triangle, 0, &mirrors.of_triangle)?;
                return Ok(false);
            }
            _ => {}
        }
        self.mirrors = match count {
            0 => None,
            _ => Some(MirrorBuffers {
                count,
                records: staging.stage(context, "planar mirrors", &mirrors.list)?,
                of_triangle: staging.stage(context, "planar mirrors of triangles", &mirrors.of_triangle)?,
            }),
        };
        Ok(true)
    }

    /// Stages what `changes` says of the hierarchy. True: buffers were replaced, and whoever has bound them must bind the new
    /// ones. A wide tree that has become too deep is given up until it fits again.
    pub fn update_hierarchy(
        &mut self,
        context: &Context,
        staging: &mut Staging,
        scene: &Scene,
        bvh: &Bvh,
        wide: Option<&WideBvh>,
        changes: &Changes,
    ) -> Result<bool> {
        let mut replaced = write(context, staging, &mut self.node_min, &bvh.node_min, &changes.nodes)?;
        replaced |= write(context, staging, &mut self.node_max, &bvh.node_max, &changes.nodes)?;
        match (wide.filter(|wide| fits_kernel(wide)), &mut self.wide_nodes) {
            (Some(wide), Some(buffer)) => replaced |= write(context, staging, buffer, &wide.nodes, &changes.wide)?,
            (Some(wide), none) => {
                *none = Some(staging.stage(context, "scene wide nodes", &wide.nodes)?);
                replaced = true;
            }
            (None, buffer) => replaced |= buffer.take().is_some(),
        }
        staging.stage_ranges(context, &self.v0, &bvh.v0, &changes.triangles)?;
        staging.stage_ranges(context, &self.e1, &bvh.e1, &changes.triangles)?;
        staging.stage_ranges(context, &self.e2, &bvh.e2, &changes.triangles)?;
        let of_triangle = reflector_numbers(scene, &self.reflectors);
        for range in &changes.triangles {
            let reordered = changes.reordered.contains(range);
            let smooth = |k: usize| scene.triangles[bvh.scene_triangle(k as u32) as usize].smooth;
            if !reordered && !range.clone().any(smooth) {
                continue;
            }
            let (normals, uvs) = shading_attributes(scene, bvh, &of_triangle, range.clone());
            staging.stage_into(context, &self.normals, (16 * range.start) as u64, &normals)?;
            if reordered && !uvs.is_empty() {
                staging.stage_into(context, &self.uvs, (32 * range.start) as u64, &uvs)?;
            }
        }
        Ok(replaced)
    }

    /// Looks for planar reflectors again, and stages what has become of them. Nothing else may have moved since the hierarchy was
    /// updated. True: they are made of something else, and tables of them must be made anew.
    pub fn update_reflectors(
        &mut self,
        context: &Context,
        staging: &mut Staging,
        scene: &Scene,
        bvh: &Bvh,
    ) -> Result<bool> {
        let reflectors = scene.reflectors();
        let same = |(a, b): (&Reflector, &Reflector)| a.material == b.material && a.triangles == b.triangles;
        let renumbered =
            reflectors.len() != self.reflectors.len() || !reflectors.iter().zip(&self.reflectors).all(same);
        self.reflectors = reflectors;
        if renumbered {
            let numbers = reflector_numbers(scene, &self.reflectors);
            let (normals, _) = shading_attributes(scene, bvh, &numbers, 0..bvh.triangle_count() as usize);
            staging.stage_into(context, &self.normals, 0, &normals)?;
        }
        self.ideal = Ideal::of(scene, &self.reflectors);
        let before = std::mem::replace(&mut self.finishes, finishes(scene, &self.reflectors));
        Ok(before != self.finishes)
    }

    /// Stages some materials.
    pub fn update_materials(
        &mut self,
        context: &Context,
        staging: &mut Staging,
        scene: &Scene,
        changed: &[u32],
    ) -> Result<()> {
        for &index in changed {
            let record = material_record(&scene.materials[index as usize]);
            let at = u64::from(index) * size_of::<MaterialRecord>() as u64;
            staging.stage_into(context, &self.materials, at, &[record])?;
        }
        Ok(())
    }

    /// Stages other emitters. True: the buffer was replaced.
    pub fn update_emitters(&mut self, context: &Context, staging: &mut Staging, emitters: &Emitters) -> Result<bool> {
        let records = emitters.records();
        self.delta_emitters = emitters.delta.iter().map(|&i| i as u32).collect();
        let all = 0..records.len();
        write(context, staging, &mut self.emitters, &records, &[all])
    }

    /// Lanes of the subgroup that takes a cluster, if the scene has what clusters need.
    pub fn cluster_lanes(&self, context: &Context) -> Option<u32> {
        self.wide_nodes.as_ref().map(|_| context.info().subgroup_size)
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        let SceneBuffers {
            node_min,
            node_max,
            wide_nodes,
            v0,
            e1,
            e2,
            normals,
            uvs,
            materials,
            textures,
            texels,
            emitters,
            delta_emitters: _,
            sobol_columns,
            ideal: _,
            targets,
            reflectors: _,
            finishes: _,
            mirrors,
        } = self;
        let always =
            [node_min, node_max, v0, e1, e2, normals, uvs, materials, textures, texels, emitters, sobol_columns];
        let of_photons = targets.iter().flat_map(|t| [&t.spheres, &t.of_triangle]);
        let of_mirrors = mirrors.iter().flat_map(|m| [&m.records, &m.of_triangle]);
        always.into_iter().chain(wide_nodes).chain(of_photons).chain(of_mirrors).map(Buffer::bytes).sum()
    }

    /// The bindings of `shaders/include/surface.wgsl`.
    pub fn surface_bindings(&self) -> Vec<(&'static str, Bound<'_>)> {
        vec![
            ("triangle_normals", (&self.normals).into()),
            ("triangle_uvs", (&self.uvs).into()),
            ("triangle_v0", (&self.v0).into()),
            ("triangle_e1", (&self.e1).into()),
            ("triangle_e2", (&self.e2).into()),
            ("materials", (&self.materials).into()),
            ("textures", (&self.textures).into()),
            ("texels", (&self.texels).into()),
        ]
    }
}

/// Whether the cluster kernel can walk a tree: its stack holds every path, and its words every node.
fn fits_kernel(wide: &WideBvh) -> bool {
    wide.stack_bound() <= CLUSTER_STACK && wide.node_count() <= MAX_WIDE_NODES
}

/// Stages ranges of what a buffer is to hold, or replaces it where it is too small. True: it was replaced.
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

fn material_record(m: &crate::scene::Material) -> MaterialRecord {
    let with = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
    MaterialRecord {
        base: with(m.base_color, m.metallic),
        specular: with(m.specular, m.roughness),
        emission: with(m.emission, m.ior),
        flags: [
            m.base_texture.map_or(0, |t| t + 1),
            m.metallic_roughness_texture.map_or(0, |t| t + 1),
            match m.surface {
                Surface::Opaque => MaterialRecord::OPAQUE,
                Surface::Mirror => MaterialRecord::MIRROR,
                Surface::Glass if m.thin => MaterialRecord::PANE,
                Surface::Glass => MaterialRecord::GLASS,
            },
            u32::from(m.two_sided),
        ],
    }
}

/// All textures one after the other in one array, since a device need not index descriptors dynamically.
fn pack_textures(textures: &[Texture]) -> Result<(Vec<TextureRecord>, Vec<u32>)> {
    let total: u64 = textures.iter().map(|t| u64::from(t.width) * u64::from(t.height)).sum();
    if total > u64::from(u32::MAX) {
        return Err(Error::Scene(format!("{total} texels in all textures exceed 2^32; use smaller textures")));
    }
    let mut records = Vec::with_capacity(textures.len());
    let mut texels = Vec::with_capacity(total as usize);
    for t in textures {
        let wrap = |w: Wrap| match w {
            Wrap::Repeat => 0,
            Wrap::Mirror => 1,
            Wrap::Clamp => 2,
        };
        records.push(TextureRecord {
            first: texels.len() as u32,
            width: t.width,
            height: t.height,
            flags: u32::from(t.srgb) | wrap(t.wrap[0]) << 1 | wrap(t.wrap[1]) << 3,
        });
        texels.extend(t.texels.iter().map(|&t| u32::from_le_bytes(t)));
    }
    Ok((records, texels))
}

/// Octahedral encoding of a unit vector, 2 x 16 bit (Meyer et al. 2010).
pub fn encode_normal(n: Vec3) -> u32 {
    let p = n / (n.x.abs() + n.y.abs() + n.z.abs()).max(1e-20);
    let sign = |x: f32| if x >= 0.0 { 1.0 } else { -1.0 };
    let e = if p.z >= 0.0 {
        Vec2::new(p.x, p.y)
    } else {
        Vec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y))
    };
    let snorm = |x: f32| (x.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16;
    u32::from(snorm(e.x)) | u32::from(snorm(e.y)) << 16
}

/// What reflectors are made of, textures by their mean; of frosted panes the lobe alone.
fn finishes(scene: &Scene, reflectors: &[Reflector]) -> Vec<Finish> {
    let mean = |texture: Option<u32>| texture.map_or(Vec3::ONE, |t| scene.textures[t as usize].average());
    let finish = |reflector: &Reflector| {
        let m = &scene.materials[reflector.material as usize];
        if let Some(alpha) = frost(m) {
            // What a pane lets through is weighed where it is seen.
            let reflectance = Reflectance { kd: Vec3::ZERO, f0: Vec3::ZERO, f90: 0.0, alpha };
            return Finish { reflectance, lobe: m.lobe.clone().map_or(Lobe::Ggx { alpha }, Lobe::Table) };
        }
        let (base, mr) = (mean(m.base_texture), mean(m.metallic_roughness_texture));
        let reflectance = Reflectance::new(m.base_color * base, m.metallic * mr.z, m.roughness * mr.y, m.specular);
        let ggx = Lobe::Ggx { alpha: reflectance.alpha };
        Finish { reflectance, lobe: m.lobe.clone().map_or(ggx, Lobe::Table) }
    };
    reflectors.iter().map(finish).collect()
}

/// For each triangle the number of its reflector, 0 for none; nothing at all if there are none.
fn reflector_numbers(scene: &Scene, reflectors: &[Reflector]) -> Vec<u8> {
    let mut numbers = vec![0; if reflectors.is_empty() { 0 } else { scene.triangles.len() }];
    for (number, reflector) in (1..=u8::MAX).zip(reflectors) {
        reflector.triangles.iter().for_each(|&i| numbers[i as usize] = number);
    }
    numbers
}

/// Normals and texture coordinates of triangles in the order of the leaves; the latter only where there are textures, which
/// any material may come to use.
fn shading_attributes(
    scene: &Scene,
    bvh: &Bvh,
    reflectors: &[u8],
    range: Range<usize>,
) -> (Vec<[u32; 4]>, Vec<[f32; 4]>) {
    let textured = !scene.textures.is_empty();
    let mut normals = Vec::with_capacity(range.len());
    let mut uvs = Vec::new();
    for i in range {
        let index = bvh.scene_triangle(i as u32) as usize;
        let t = &scene.triangles[index];
        let mut n = [0; 4];
        if t.smooth {
            for (n, &v) in n.iter_mut().zip(&t.vertices) {
                *n = encode_normal(scene.normals[v as usize]);
            }
        }
        let reflector = reflectors.get(index).copied().unwrap_or(0);
        n[3] = u32::from(reflector) << 24 | t.material << 1 | u32::from(t.smooth);
        normals.push(n);
        if textured {
            let [a, b, c] = t.vertices.map(|v| scene.uvs.get(v as usize).copied().unwrap_or(Vec2::ZERO));
            uvs.push([a.x, a.y, b.x, b.y]);
            uvs.push([c.x, c.y, 0.0, 0.0]);
        }
    }
    (normals, uvs)
}

/// The lights that every pass lights exactly once, or chooses from: point, spot and parallel lights, and imported virtual lights.
pub fn delta_lights(scene: &Scene, coordinate_scale: f32) -> Vec<PointLight> {
    let with = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
    let flags = f32::from_bits;
    scene
        .lights
        .iter()
        .filter_map(|light| match *light {
            Light::Point { position, intensity } => Some(PointLight {
                position: with(position, flags(0)),
                normal: with(Vec3::Z, 0.0),
                emit: with(intensity, 1.0),
                ..PointLight::default()
            }),
            Light::Spot { position, direction, intensity, inner, outer } => {
                // KHR_lights_punctual: clamp((cos - cos outer) / (cos inner - cos outer))^2.
                let scale = 1.0 / (inner.cos() - outer.cos()).max(1e-6);
                Some(PointLight {
                    position: with(position, flags(0)),
                    normal: with(direction, scale),
                    emit: with(intensity, -outer.cos() * scale),
                    ..PointLight::default()
                })
            }
            Light::Directional { direction, irradiance } => Some(PointLight {
                position: with(Vec3::ZERO, flags(PointLight::DIRECTIONAL)),
                normal: with(direction, 0.0),
                emit: with(irradiance, 1.0),
                ..PointLight::default()
            }),
            Light::Virtual { position, normal, power } => Some(PointLight {
                position: with(
                    crate::accel::offset_origin(position, normal, coordinate_scale),
                    flags(PointLight::SURFACE | PointLight::CLIPPED),
                ),
                normal: with(normal, 0.0),
                emit: with(power * std::f32::consts::FRAC_1_PI, 1.0),
                ..PointLight::default()
            }),
            Light::Sphere { .. } => None,
        })
        .collect()
}
