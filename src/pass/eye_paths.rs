//! Continues eye paths that met a mirror or glass until they meet another surface, which becomes the pixel's shading
//! point (Wald et al. 2002, section 4).
//!
//! Where a path first meets a surface of two components it is split, one path for each: transmission and reflection of
//! glass; the diffuse base of a mirror, where the path ends, and its reflection. The second component has a slot of its
//! own, which follows that of the pixel by the number of pixels, and is a shading point like any other until `merge`
//! adds its light to the pixel. Later in the path one component is chosen, with a probability p in proportion to the
//! weights:
//!
//! ```text
//! throughput *= f / p      f = F (mirror), R (reflected), (1 - R) tint / eta^2 (through glass), 1 (a mirror's base)
//! ```
//!
//! [`crate::bsdf::ideal`] has the directions and f. Emission along the path is added to that of the shading point.
//! After `max_specular` of these steps the path ends: mirrors show their diffuse base, glass is black.
//!
//! For a glossy plane seen directly (superposition, see `mirror_image`) the first component is the base, where the path
//! ends, and the second the mirror image itself, with throughput 1. For a frosted pane the first component is the scene
//! behind it, also with throughput 1, and the pane's emission goes with the second.
//!
//! Differs from the paper in that: a path is split once, whatever the weights of the components; the diffuse and glossy
//! lobes of a surface need no paths of their own, since point lights light both.
//!
//! Bias: only eye paths pass mirrors and glass here. Light that reaches a shading point through mirrors and glass
//! (caustics) is missing, and glass casts a shadow like any opaque surface. The throughput is applied when the image is
//! composed, so irradiance, for filters and layers, is that of the visible surface.
//!
//! Cost: for each pixel of a tile that shows mirrors or glass (see `tiles`), and for each path that continues, 170
//! bytes read and 96 written, 300 operations, and one ray of `trace`. An empty list costs a few microseconds a step.

use glam::Vec3;

use super::mirror_image::{Planes, Tables};
use super::schedule::LIST_GROUPS;
use super::surface::SurfacePoint;
use super::{BoundKernel, EyePathState, Kit, List, Rays, ShadingPoints, layout, push};
use crate::accel::{Ray, offset_origin};
use crate::bsdf::ideal::{BsdfSample, Media, specular_samples};
use crate::bsdf::{Normals, mean};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::sampling::dimensions::COMPONENT;
use crate::sampling::random::{key, random_f32};
use crate::scene::Scene;

/// One step of all paths.
pub struct EyePaths {
    kernel: BoundKernel,
    work_in: Buffer,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// Traced rays; overwritten by the next ones.
    pub rays: &'a Rays,
    /// Throughput and media.
    pub paths: &'a EyePathState,
    /// Receives the emission along the paths, in `emitted`.
    pub points: &'a ShadingPoints,
    /// Rays to continue; for the first step, tiles of pixels.
    pub list_in: &'a List,
    /// Rays to trace.
    pub list_out: &'a List,
    /// Receives the glossy planes on the paths.
    pub planes: &'a Planes,
    /// Lobes of glossy planes; `None`: no plane mirrors the room.
    pub tables: Option<&'a Tables>,
}

impl EyePaths {
    /// Replaces `rays` that met a mirror or glass and appends them to `list_out`.
    pub fn new(kit: &Kit, inputs: &Inputs, steps: &Resources) -> Result<Self> {
        let Inputs { rays, paths, points, list_in, list_out, planes, tables } = *inputs;
        // Without tables the kernel never reads these bindings, but they must exist.
        let none = || Resources::of([("reflectors", &planes.region), ("lobes", &planes.widening)]);
        let tables = tables.map_or_else(none, Tables::resources);
        let (rays, paths, points) = (rays.resources(), paths.resources(), points.resources());
        let (list_in_set, list_out) = (list_in.as_input(), list_out.as_output());
        let sets = [&rays, &paths, &points, &list_in_set, &list_out, &planes.resources(), &tables, steps];
        let shaders = [&shaders::EYE_PATHS, &shaders::EYE_PATHS_UNTEXTURED];
        Ok(EyePaths { kernel: kit.bind_surface(shaders, &sets)?, work_in: list_in.work.clone() })
    }

    /// Records the step.
    pub fn record(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        self.kernel.run_listed(rec, &push(step), &self.work_in, LIST_GROUPS)
    }
}

/// A path before or after a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EyePath {
    /// Its slot.
    pub slot: u32,
    /// Its ray; `None`: the path has ended.
    pub ray: Option<Ray>,
    /// Throughput so far.
    pub throughput: Vec3,
    /// Depth of the ray's origin, see [`EyePathState`].
    pub depth: f32,
    /// Bodies of glass around the ray.
    pub media: Media,
    /// Emission along the path.
    pub emitted: Vec3,
}

/// A plane with an image by superposition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Plane {
    /// Mirrors the room with a lobe of this energy.
    Glossy {
        /// Albedo of the lobe without its Fresnel term.
        energy: f32,
        /// The part of it that is weighted by F90.
        grazing: f32,
    },
    /// A frosted pane.
    Frosted,
}

/// Oracle: the path after its hit on `surface` at distance `t`, `cos_view` the cosine between its first segment and the
/// view direction; and the second component if the path is split (its slot is `split_offset` after that of the path; 0: paths
/// are not split). `None` if the surface is neither mirror nor glass. `plane`: the surface has an image by
/// superposition.
#[allow(clippy::too_many_arguments)]
pub fn reference(
    frame: &layout::FrameParameters,
    scene: &Scene,
    step: u32,
    split_offset: u32,
    path: &EyePath,
    (d, t, cos_view): (Vec3, f32, f32),
    surface: &SurfacePoint,
    plane: Option<Plane>,
) -> Option<(EyePath, Option<EyePath>)> {
    if let Some(Plane::Glossy { energy, grazing }) = plane {
        return Some(at_plane(frame, step, split_offset, path, (d, cos_view * t), surface, [energy, grazing]));
    }
    let material = &scene.materials[surface.material as usize];
    let normals = Normals { geometric: surface.geometric, shading: surface.shading, front: surface.front };
    let eta = path.media.relative_index(&scene.materials, surface.material, surface.front);
    let split = specular_samples(material, &surface.finish, &normals, -d, eta)?.split(surface.reflectance.kd);
    let splits = step == 0 && split_offset > 0;
    let first =
        splits || random_f32(key(frame.keys[0], COMPONENT, frame.sample_of(path.slot), step)) < split.probability;
    let (sample, probability) =
        if first { (split.first, split.probability) } else { (split.second, 1.0 - split.probability) };
    let chance = if splits { 1.0 } else { probability };
    let on = |slot: u32, sample: BsdfSample, chance: f32| {
        let side = if sample.wi.dot(surface.geometric) > 0.0 { surface.geometric } else { -surface.geometric };
        let origin = offset_origin(surface.position, side, frame.eye[3]);
        let media = if sample.crosses { path.media.crossed(surface.material, surface.front) } else { path.media };
        let throughput = path.throughput * sample.weight / chance;
        let goes_on = throughput.max_element() > 0.0;
        EyePath {
            slot,
            ray: goes_on.then_some(Ray { origin, t_max: 3.0e38, direction: sample.wi }),
            throughput,
            depth: if goes_on { path.depth + cos_view * t } else { path.depth },
            media,
            emitted: Vec3::ZERO,
        }
    };
    let mut next = match sample {
        Some(sample) => on(path.slot, sample, chance),
        None => EyePath { ray: None, throughput: path.throughput / chance, ..*path },
    };
    // The emission of a mirror with a base is counted at the base.
    let has_base = split.first.is_none();
    next.emitted = path.emitted + if has_base { Vec3::ZERO } else { path.throughput * surface.emission };
    let mut branch = split.second.filter(|_| splits).map(|sample| on(path.slot + split_offset, sample, 1.0));
    if let (Some(Plane::Frosted), true, Some(branch)) = (plane, splits, &mut branch) {
        branch.emitted = next.emitted - path.emitted;
        next = EyePath { throughput: path.throughput, emitted: path.emitted, ..next };
    }
    Some((next, branch))
}

/// Oracle for glossy planes: both components at the first hit, one of them at later hits.
fn at_plane(
    frame: &layout::FrameParameters,
    step: u32,
    split_offset: u32,
    path: &EyePath,
    (d, depth): (Vec3, f32),
    surface: &SurfacePoint,
    [energy, grazing]: [f32; 2],
) -> (EyePath, Option<EyePath>) {
    let n = surface.geometric;
    let origin = offset_origin(surface.position, n, frame.eye[3]);
    let ray = Some(Ray { origin, t_max: 3.0e38, direction: d - 2.0 * d.dot(n) * n });
    let mirrored = EyePath { ray, depth: path.depth + depth, ..*path };
    if step == 0 {
        let branch = EyePath { slot: path.slot + split_offset, emitted: Vec3::ZERO, ..mirrored };
        return (EyePath { ray: None, ..*path }, Some(branch));
    }
    let r = &surface.reflectance;
    let reflectance = r.f0 * (energy - grazing) + r.f90 * grazing;
    let probability = mean(r.kd) / (mean(r.kd) + mean(reflectance));
    if random_f32(key(frame.keys[0], COMPONENT, frame.sample_of(path.slot), step)) < probability {
        return (EyePath { ray: None, throughput: path.throughput / probability, ..*path }, None);
    }
    (EyePath { throughput: path.throughput * reflectance / (1.0 - probability), ..mirrored }, None)
}
