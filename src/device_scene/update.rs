//! Brings a changed scene up to date on the device.

use std::slice::from_ref;
use std::sync::Arc;

use bytemuck::Zeroable;
use glam::Vec3;

use super::records::{finishes, has_patterns, has_wide_lobe, material_record, reflector_bits, shading_attributes};
use super::{
    DeviceScene, MirrorBuffers, SpecularFeatures, SurfaceBuffers, TargetBuffers, delta_lights, fits_kernel, write,
};
use crate::accel::objects::{Changes, ObjectTrees};
use crate::accel::wide::WideBvh;
use crate::bsdf::table::{self, Table};
use crate::error::{Error, Result};
use crate::gpu::{Context, Staging};
use crate::light::emitters::Emitters;
use crate::light::mirrors::Mirrors;
use crate::light::targets::{PLANAR, TargetTriangle, Targets};
use crate::pass::layout::{MaterialRecord, PointLight};
use crate::scene::reflectors::Reflector;
use crate::scene::surfaces::Surfaces;
use crate::scene::{Light, Scene};

/// Parts of the scene touched by edits.
#[derive(Default)]
pub struct SceneChanges {
    /// Objects that moved, without duplicates.
    pub moved: Vec<u32>,
    /// Materials that changed.
    pub materials: Vec<u32>,
    /// Whether lights of the scene changed.
    pub lights: bool,
    /// Whether emission of materials changed.
    pub emission: bool,
    /// Whether the device's content is unknown, so that everything is uploaded.
    pub everything: bool,
}

/// Results of an update.
#[derive(Default)]
pub struct Update {
    /// Whether passes must be made anew, because buffers were replaced or a property that they were made for has
    /// changed.
    pub replaced: bool,
    /// Whether the lights without area changed.
    pub delta: bool,
    /// Bytes of trees, and timings.
    pub changes: Changes,
    /// Seconds for emitters and lights.
    pub light_seconds: f64,
    /// Seconds for staging uploads.
    pub staging_seconds: f64,
}

impl SceneChanges {
    /// Whether nothing was touched.
    pub fn is_empty(&self) -> bool {
        self.moved.is_empty() && self.materials.is_empty() && !self.lights && !self.emission && !self.everything
    }
}

impl DeviceScene {
    /// Brings host and device up to date with `scene`. `emits`: whether an object has emissive triangles;
    /// `averages`: mean colours of the textures.
    pub fn update(
        &mut self,
        context: &Context,
        staging: &mut Staging,
        (scene, trees): (&Scene, &mut ObjectTrees),
        touched: &SceneChanges,
        emits: impl Fn(u32) -> bool,
        averages: &[Vec3],
    ) -> Result<Update> {
        let bounds = (self.bvh.min, self.bvh.max);
        let changes = match &touched.moved[..] {
            [] => Changes::default(),
            moved => trees.update(&mut self.bvh, scene, moved),
        };
        let extended = bounds != (self.bvh.min, self.bvh.max);

        let start = std::time::Instant::now();
        // The discs that emit parallel light and that of the environment are as large as the scene.
        let parallel = |light: &Light| matches!(light, Light::Directional { .. });
        let has_discs = scene.environment.is_some() || scene.lights.iter().any(parallel);
        let other_emitters = touched.everything
            || touched.emission
            || touched.lights
            || touched.moved.iter().any(|&object| emits(object))
            || extended && has_discs;
        let emitters = if other_emitters { Some(Emitters::of(scene, scene.emitters_are_lights)?) } else { None };
        let other_delta = touched.lights || extended || touched.everything;
        let light_seconds = start.elapsed().as_secs_f64();

        let start = std::time::Instant::now();
        // Other kernels trace where surfaces let rays pass, and others find surfaces with texture coordinates.
        let everything =
            touched.everything || self.has_alpha != scene.has_alpha() || self.textured != has_patterns(scene);
        let mut replaced = everything;
        let splat_alpha = self.surfaces.as_ref().map(|surfaces| surfaces.alpha);
        if everything {
            let bvh = self.bvh.clone();
            let kept = self.delta.clone();
            *self = DeviceScene::with_tree(context, staging, scene, bvh, trees.wide.as_ref())?;
            self.delta = kept;
            self.movable = true;
        } else {
            if !touched.moved.is_empty() {
                replaced |= self.update_hierarchy(context, staging, scene, trees.wide.as_ref(), &changes)?;
            }
            replaced |= self.update_materials(context, staging, scene, &touched.materials)?;
            self.albedos = scene.materials.iter().map(|material| material.mean_albedo(averages)).collect();
            if let Some(emitters) = emitters {
                let records = emitters.records();
                let all = 0..records.len();
                replaced |= write(context, staging, &mut self.emitter_records, &records, from_ref(&all))?;
                self.emitters = emitters;
            }
            if !touched.moved.is_empty() || !touched.materials.is_empty() {
                replaced |= self.update_reflectors(context, staging, scene)?;
                replaced |= self.update_mirrors(context, staging, scene)?;
                replaced |= self.update_targets(context, staging, scene)?;
            }
        }
        if let Some(alpha) =
            splat_alpha.filter(|_| everything || !touched.moved.is_empty() || !touched.materials.is_empty())
        {
            self.make_surfaces(context, staging, scene, alpha)?;
            replaced = true;
        }
        if other_delta {
            let delta = delta_lights(scene, self.bvh.typical_scale());
            let parallel = |light: &PointLight| light.flags() & PointLight::DIRECTIONAL;
            replaced |= !delta.iter().map(parallel).eq(self.delta.iter().map(parallel));
            self.delta = delta;
        }
        let staging_seconds = start.elapsed().as_secs_f64();
        Ok(Update { replaced, delta: other_delta, changes, light_seconds, staging_seconds })
    }

    /// Finds and stages the targets of photons, after the planar mirrors. Returns whether buffers were replaced; passes that bind them must then
    /// be made anew.
    pub(super) fn update_targets(&mut self, context: &Context, staging: &mut Staging, scene: &Scene) -> Result<bool> {
        let sizes = |targets: &Targets| (targets.list.len(), targets.triangles.len());
        let before = sizes(&self.targets);
        self.targets = Targets::of(scene, &self.bvh, &self.mirrors);
        let targets = &self.targets;
        let records = targets.list.iter().flat_map(|t| {
            let planar = if t.planar { PLANAR } else { 0 };
            let ends = [t.triangles.start as u32 | planar, t.triangles.end as u32].map(f32::from_bits);
            [t.sphere.center.extend(t.sphere.radius).to_array(), [t.weight, t.area, ends[0], ends[1]]]
        });
        let records: Vec<[f32; 4]> = records.collect();
        let none = [TargetTriangle::zeroed()];
        let triangles = if targets.triangles.is_empty() { &none } else { &targets.triangles[..] };
        match &self.target_buffers {
            None if records.is_empty() => return Ok(false),
            Some(old) if before == sizes(targets) => {
                staging.stage_into(context, &old.list, 0, &records)?;
                staging.stage_into(context, &old.triangles, 0, triangles)?;
                staging.stage_into(context, &old.of_triangle, 0, &targets.of_triangle)?;
                return Ok(false);
            }
            _ => {}
        }
        self.target_buffers = match records.is_empty() {
            true => None,
            false => Some(TargetBuffers {
                list: staging.stage(context, "photon targets", &records)?,
                triangles: staging.stage(context, "triangles of photon targets", triangles)?,
                of_triangle: staging.stage(context, "photon targets of triangles", &targets.of_triangle)?,
            }),
        };
        Ok(true)
    }

    /// Finds and stages the surfaces of splats, for lobes with a greater alpha than this.
    pub fn make_surfaces(&mut self, context: &Context, staging: &mut Staging, scene: &Scene, alpha: f32) -> Result<()> {
        let surfaces = Surfaces::of(scene, |m| has_wide_lobe(&scene.materials[m as usize], alpha));
        let mut first = 0;
        let mut records: Vec<[u32; 4]> = (surfaces.list.iter())
            .map(|surface| {
                let end = first + surface.edges.len() as u32;
                [surface.area.to_bits(), std::mem::replace(&mut first, end), end, 0]
            })
            .collect();
        let edges = surfaces.list.iter().flat_map(|surface| surface.edges.iter().flatten());
        let mut edges: Vec<[f32; 4]> = edges.map(|p| p.extend(0.0).to_array()).collect();
        let of_leaf = (0..self.bvh.triangle_count()).map(|t| surfaces.of_triangle[self.bvh.scene_triangle(t) as usize]);
        let of_leaf: Vec<u32> = of_leaf.collect();
        let count = records.len() as u32;
        records.resize(records.len().max(1), [0; 4]);
        edges.resize(edges.len().max(2), [0.0; 4]);
        self.surfaces = Some(SurfaceBuffers {
            count,
            records: staging.stage(context, "surfaces", &records)?,
            edges: staging.stage(context, "edges of surfaces", &edges)?,
            of_triangle: staging.stage(context, "surfaces of triangles", &of_leaf)?,
            alpha,
        });
        Ok(())
    }

    /// Finds and stages the planar mirrors. Returns whether buffers were replaced, as above.
    pub(super) fn update_mirrors(&mut self, context: &Context, staging: &mut Staging, scene: &Scene) -> Result<bool> {
        let before = self.mirrors.list.len();
        self.mirrors = Mirrors::of(scene, &self.bvh);
        let mirrors = &self.mirrors;
        let count = mirrors.list.len();
        match &self.mirror_buffers {
            None if count == 0 => return Ok(false),
            Some(old) if before == count => {
                staging.stage_into(context, &old.records, 0, &mirrors.list)?;
                staging.stage_into(context, &old.of_triangle, 0, &mirrors.of_triangle)?;
                return Ok(false);
            }
            _ => {}
        }
        self.mirror_buffers = match count {
            0 => None,
            _ => Some(MirrorBuffers {
                records: staging.stage(context, "planar mirrors", &mirrors.list)?,
                of_triangle: staging.stage(context, "planar mirrors of triangles", &mirrors.of_triangle)?,
            }),
        };
        Ok(true)
    }

    /// Stages the `changes` of the hierarchy. Returns whether buffers were replaced, so that they must be bound again.
    /// If the wide tree has become too deep for the kernel, it is dropped until it fits again.
    pub fn update_hierarchy(
        &mut self,
        context: &Context,
        staging: &mut Staging,
        scene: &Scene,
        wide: Option<&WideBvh>,
        changes: &Changes,
    ) -> Result<bool> {
        let bvh = &self.bvh;
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
        let of_triangle = reflector_bits(scene, &self.reflectors);
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

    /// Finds the reflectors again and stages the changes. No other edits may come between the update of the
    /// hierarchy and this one. Returns whether passes must be made anew.
    fn update_reflectors(&mut self, context: &Context, staging: &mut Staging, scene: &Scene) -> Result<bool> {
        let bvh = &self.bvh;
        let reflectors = scene.reflectors();
        let same = |(a, b): (&Reflector, &Reflector)| {
            a.material == b.material && a.curved == b.curved && a.triangles == b.triangles
        };
        let renumbered =
            reflectors.len() != self.reflectors.len() || !reflectors.iter().zip(&self.reflectors).all(same);
        self.reflectors = reflectors;
        if renumbered {
            let bits = reflector_bits(scene, &self.reflectors);
            let (normals, _) = shading_attributes(scene, bvh, &bits, 0..bvh.triangle_count() as usize);
            staging.stage_into(context, &self.normals, 0, &normals)?;
        }
        let specular = SpecularFeatures::of(scene, &self.reflectors);
        let mut replaced = std::mem::replace(&mut self.specular, specular) != specular;
        let before = std::mem::replace(&mut self.finishes, finishes(scene, &self.reflectors));
        if before != self.finishes {
            replaced |= self.tables.take().is_some();
        }
        Ok(replaced)
    }

    /// Stages some materials, and the tables of lobes if they have others. Returns whether passes must be made anew.
    fn update_materials(
        &mut self,
        context: &Context,
        staging: &mut Staging,
        scene: &Scene,
        changed: &[u32],
    ) -> Result<bool> {
        scene.check_tables().map_err(Error::Scene)?;
        for &index in changed {
            let record = material_record(index, &scene.materials[index as usize]);
            let at = u64::from(index) * size_of::<MaterialRecord>() as u64;
            staging.stage_into(context, &self.materials, at, &[record])?;
        }
        let lobes = scene.lobes();
        let same = |(one, other): (&Option<Arc<Table>>, &Option<Arc<Table>>)| {
            one.as_ref().map(Arc::as_ptr) == other.as_ref().map(Arc::as_ptr)
        };
        if lobes.len() == self.lobes.len() && lobes.iter().zip(&self.lobes).all(same) {
            return Ok(false);
        }
        self.lobes = lobes;
        let words = table::words(&scene.materials);
        let all = 0..words.len();
        write(context, staging, &mut self.lobe_tables, &words, from_ref(&all))?;
        // Other kernels evaluate tables.
        Ok(true)
    }
}
