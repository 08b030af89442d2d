//! Continues eye paths that met a mirror, glass or a narrow specular lobe until they meet another surface, which becomes the
//! pixel's shading point (Wald et al. 2002, section 4).
//!
//! Where a path first meets a surface of two components it is split, one path for each: transmission and reflection of
//! glass; the diffuse base of a mirror, where the path ends, and its reflection; a glossy surface, where the path ends, and a path
//! along its lobe. The second component has a slot of its own, which follows that of the pixel by the number of pixels, and is a
//! shading point like any other until `merge` or `glossy_light` adds its light to the pixel.
//!
//! In scenes with glass a pixel has a third slot, in images up to [`MAX_PIXELS_OF_THREE`](crate::plan::MAX_PIXELS_OF_THREE). Where the path meets another
//! mirror or glass of two components it splits again: reflection within a ball, or on a ball that a mirror shows. A path that has not split yet, behind a
//! mirror without a base, has both slots left. Where the path ends at its first surface the second component splits in its place. [`third_light`](super::third_light) adds
//! the light of the third component to that of the second. Where no slot is left one component is chosen, with a probability p in proportion to the weights:
//!
//! ```text
//! throughput *= f / p      f = F (mirror), R (reflected), (1 - R) tint / eta^2 (through glass), 1 (a mirror's base)
//!                          f = F G2 / G1 (along a lobe, by visible normals, Heitz 2018), 1 (a glossy surface)
//! ```
//!
//! [`crate::bsdf::ideal`] has the directions and f of mirrors and glass. Emission along the path is added to that of the shading
//! point. After `max_specular` of these steps the path ends: mirrors show their diffuse base, glass is black, and glossy surfaces
//! the highlights of lights alone.
//!
//! **Lobes** with alpha up to [`MAX_FOLLOWED_ALPHA`](crate::plan::MAX_FOLLOWED_ALPHA) are followed. A lobe of density p_l towards
//! a point y at distance r, under the cosine c there, and virtual lights of density q on y's surface both find the light that y
//! sends; the balance heuristic (Veach and Guibas 1995) divides it:
//!
//! ```text
//! path: p_l c / (p_l c + q r^2)      lights: q r^2 / (p_l c + q r^2), in place of clipping
//! ```
//!
//! q is that of particles on emitters (N_0 times radiance over the power), and one mean for all other surfaces (all other lights on a
//! cube of the view's size): any q gives the right limit. Lights without area and mirrors in between are found in one way only, which
//! has all of the light; photons and mirrored lights from other lights leave followed lobes out. Segments beyond the first such surface count in
//! `max_depth`.
//!
//! Where the reflectance F of a lobe is below 1 / [`LOBE_CHANCE`], a path follows it with probability 4 F only, at least 0.2, and carries
//! the inverse, unless alpha is below [`NARROW`]. At lobes all pixels of a class draw the same numbers, so that neighbours differ smoothly ([`path_numbers`]).
//! Over mirrors and glass each pixel chooses for itself, evenly over its passes ([`own_number`]): a reflection of one in twenty comes once in twenty passes.
//!
//! For a glossy plane seen directly (superposition, see `mirror_image`) the first component is the base, where the path
//! ends, and the second the mirror image itself, with throughput 1. So it is for a curved reflector, mirrored by the shading normal, where it is not
//! too concave ([`super::curvature`]); there, and in mirror images, it is a glossy surface like any other. For a frosted pane the first component is the scene
//! behind it, also with throughput 1, and the pane's emission goes with the second.
//!
//! Differs from the paper in that: a path is split twice at most, whatever the weights of the components; point lights light wide
//! lobes, which need no paths of their own.
//!
//! Bias: only eye paths pass mirrors and glass here. Light that reaches a shading point through mirrors and glass
//! (caustics) is missing, and glass casts a shadow like any opaque surface. The throughput is applied when the image is composed, so irradiance, for filters and layers, is that of the
//! visible surface.
//!
//! Cost: for each pixel of a tile that shows narrow lobes, mirrors or glass (see `tiles`), and for each path that continues, 170
//! bytes read and 100 written, 400 operations, and one ray of `trace`. An empty list costs a few microseconds a step.

use glam::Vec3;

use super::mirror_image::{Planes, Tables};
use super::schedule::LIST_GROUPS;
use super::surface::SurfacePoint;
use super::{BoundKernel, EyePathState, Kit, List, Rays, ShadingPoints, layout, push};
use crate::accel::{Ray, offset_origin};
use crate::bsdf::ideal::{BsdfSample, Media, specular_samples};
use crate::bsdf::phong::width_of;
use crate::bsdf::{Normals, mean, pdf_specular, schlick};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::sampling::dimensions::{COMPONENT, EYE_LOBE};
use crate::sampling::random::{hash, key};
use crate::sampling::sobol::unit;
use crate::scene::{Scene, Surface};
use crate::settings::Reflectance;
use crate::superposition::reflectance::fresnel_fitted_rgb;

/// Probability of following a lobe beside its surface, over its reflectance: faint lobes are followed by some classes of pixels
/// only, in some passes. Higher: less noise in faint reflections, more rays.
pub const LOBE_CHANCE: f32 = 4.0;

/// Lobes with a smaller alpha are always followed, and what they show always has near rays: on curved surfaces no filter averages it.
pub const NARROW: f32 = 0.1;

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
    /// Density over solid angle of its direction if it follows a lobe, else 0.
    pub lobe: f32,
    /// Segments beyond the first surface that is neither mirror nor glass.
    pub segments: u32,
    /// It ended where another path follows the lobe.
    pub sampled: bool,
    /// It follows a narrow lobe first.
    pub narrow: bool,
    /// It chose a component of a probability below one half.
    pub unlikely: bool,
    /// Whether it chose one component of a mirror or glass at random.
    pub chose: bool,
    /// Whether it passed at least three mirrors and surfaces of glass.
    pub deep: bool,
    /// Component whose slot receives the next one that splits off; 0: none does.
    pub free: u32,
}

/// Steps of the Kronecker sequences of a path's surfaces, in units of 2^-32, in turns: the powers 1/p and 1/p^2 of the plastic number p, the
/// golden section, and fractions of the roots of primes.
pub const SEQUENCES: [[u32; 4]; 8] = [
    [3_242_174_889, 2_447_445_414, 2_654_435_769, 1_779_033_703],
    [3_144_134_277, 1_013_904_243, 2_773_480_763, 1_359_893_119],
    [2_600_822_925, 528_734_635, 1_541_459_225, 3_418_070_365],
    [1_654_270_251, 2_438_529_371, 355_462_361, 1_731_405_415],
    [2_394_180_231, 3_675_008_525, 1_203_062_813, 2_925_498_711],
    [3_479_995_859, 796_084_093, 1_830_299_339, 2_336_478_295],
    [3_814_765_975, 474_308_611, 1_863_934_769, 3_645_816_497],
    [214_214_161, 639_484_403, 1_477_814_207, 1_891_102_055],
];

/// Oracle: numbers that choose a direction along a lobe (first two) and a component (last), for a class of pixels at the
/// surface of number `step`.
pub fn path_numbers(frame: &layout::FrameParameters, class: u32, step: u32) -> [f32; 3] {
    let n = frame.size[3].wrapping_mul(frame.pattern[2]).wrapping_add(class);
    let steps = SEQUENCES[step as usize % 8];
    let start = |d: u32| key(frame.keys[1], EYE_LOBE, step, d);
    std::array::from_fn(|d| unit(n.wrapping_mul(steps[d]).wrapping_add(start(d as u32))))
}

/// Oracle: number that chooses a component where each pixel chooses for itself.
pub fn own_number(frame: &layout::FrameParameters, slot: u32, step: u32) -> f32 {
    let start = hash(key(frame.keys[1], COMPONENT, frame.sample_of(slot), step));
    unit(start.wrapping_add(frame.size[3].wrapping_mul(SEQUENCES[step as usize % 8][3])))
}

/// Oracle: the part of light that a path of density `lobe` along a lobe brings; 0 stands for a mirror, which has all.
pub fn path_share(lobe: f32, lights: f32, distance2: f32, cosine: f32) -> f32 {
    if lobe == 0.0 { 1.0 } else { lobe * cosine / (lobe * cosine + lights * distance2) }
}

/// Oracle: the part of virtual lights, over the square of the distance.
pub fn highlight_factor(lobe: f32, lights: f32, distance2: f32, cosine: f32) -> f32 {
    // Both may be 0: a dark light where a lobe from a table reflects nothing.
    lights / (lobe * cosine + lights * distance2).max(1e-37)
}

/// Oracle: the parts of the emission of a surface and of the light that it reflects which a path brings.
pub fn shares_at(
    frame: &layout::FrameParameters,
    path: &EyePath,
    (d, t): (Vec3, f32),
    surface: &SurfacePoint,
) -> [f32; 2] {
    let cosine = surface.geometric.dot(d).abs();
    let lights = [frame.choice[1] * surface.exitance, frame.choice[2]];
    lights.map(|lights| path_share(path.lobe, lights, t * t, cosine))
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
    /// A curved surface seen directly, which mirrors the room by this normal.
    Curved {
        /// The normal.
        normal: Vec3,
    },
    /// A frosted pane.
    Frosted,
}

/// Oracle: the path after its hit on `surface` at distance `t`, `cos_view` the cosine between its first segment and the
/// view direction, and `class` that of its pixel; and the component that splits off, if any, where a pixel has slots for `components`
/// of them. `None` if the surface is neither mirror nor glass nor glossy. `plane`: the surface has an image by superposition.
#[allow(clippy::too_many_arguments)]
pub fn reference(
    frame: &layout::FrameParameters,
    scene: &Scene,
    (step, class): (u32, u32),
    components: u32,
    path: &EyePath,
    way: (Vec3, f32, f32),
    surface: &SurfacePoint,
    plane: Option<Plane>,
) -> Option<(EyePath, Option<EyePath>)> {
    let splits = step == 0 && components > 1;
    let free = if splits { 1 } else { path.free };
    let (mut next, mut branch) = followed(frame, scene, (step, class), (splits, free), path, way, surface, plane)?;
    // The path itself takes the slots that are left; where it ends here the other component takes them. Images that are spread leave none.
    let goes_on = |path: &EyePath| path.ray.is_some();
    let branches = branch.as_ref().is_some_and(goes_on);
    let taken = free + u32::from(branches);
    let left = if free > 0 && taken < components && plane.is_none() { taken } else { 0 };
    for path in branch.iter_mut() {
        path.free = if goes_on(&next) { 0 } else { left };
        path.deep |= step > 1;
    }
    if goes_on(&next) {
        next.free = left;
        next.deep |= step > 1;
    } else if branches {
        next.free = 0;
    }
    Some((next, branch))
}

/// [`reference`] without the flags for free slots and for deep paths.
#[allow(clippy::too_many_arguments)]
fn followed(
    frame: &layout::FrameParameters,
    scene: &Scene,
    (step, class): (u32, u32),
    (splits, free): (bool, u32),
    path: &EyePath,
    (d, t, cos_view): (Vec3, f32, f32),
    surface: &SurfacePoint,
    plane: Option<Plane>,
) -> Option<(EyePath, Option<EyePath>)> {
    let numbers = path_numbers(frame, class, step);
    if let Some(Plane::Glossy { energy, grazing }) = plane {
        return Some(at_plane(frame, step, path, (d, cos_view * t), surface, [energy, grazing]));
    }
    if let Some(Plane::Curved { normal }) = plane {
        let branch = EyePath { slot: path.slot + frame.size[2], emitted: Vec3::ZERO, ..*path };
        let mirrored = mirrored(frame, &branch, (d, cos_view * t), surface, normal);
        return Some((EyePath { ray: None, ..*path }, Some(mirrored)));
    }
    let fits = path.segments + 2 <= frame.scene[2];
    let material = &scene.materials[surface.material as usize];
    if material.surface == Surface::Opaque {
        return at_lobe(frame, scene, numbers, splits, path, (d, t, cos_view), surface);
    }
    let normals = Normals { geometric: surface.geometric, shading: surface.shading, front: surface.front };
    let eta = path.media.relative_index(&scene.materials, surface.material, surface.front);
    let split = specular_samples(material, &surface.finish, &normals, -d, eta, frame.reflectance())?
        .split(surface.reflectance.kd);
    let own = own_number(frame, path.slot, step);
    let follows_both = splits || (free > 0 && split.probability < 1.0);
    let first = follows_both || own < split.probability;
    let (sample, probability) =
        if first { (split.first, split.probability) } else { (split.second, 1.0 - split.probability) };
    let chance = if follows_both { 1.0 } else { probability };
    let on = |slot: u32, sample: BsdfSample, chance: f32| {
        let side = if sample.wi.dot(surface.geometric) > 0.0 { surface.geometric } else { -surface.geometric };
        let origin = offset_origin(surface.position, side, frame.eye[3]);
        let media = if sample.crosses { path.media.crossed(surface.material, surface.front) } else { path.media };
        let throughput = if path.segments > 0 && !fits { Vec3::ZERO } else { path.throughput * sample.weight / chance };
        let goes_on = throughput.max_element() > 0.0;
        EyePath {
            slot,
            ray: goes_on.then_some(Ray { origin, t_max: 3.0e38, direction: sample.wi }),
            throughput,
            depth: if goes_on { path.depth + cos_view * t } else { path.depth },
            media,
            emitted: Vec3::ZERO,
            lobe: if goes_on { 0.0 } else { path.lobe },
            segments: path.segments + u32::from(goes_on && path.segments > 0),
            sampled: false,
            narrow: path.narrow,
            unlikely: path.unlikely || chance < 0.5,
            chose: path.chose || chance < 1.0,
            deep: path.deep,
            free: path.free,
        }
    };
    let mut next = match sample {
        Some(sample) => on(path.slot, sample, chance),
        None => EyePath {
            ray: None,
            throughput: path.throughput / chance,
            unlikely: path.unlikely || chance < 0.5,
            chose: path.chose || chance < 1.0,
            ..*path
        },
    };
    // The emission of a mirror with a base is counted at the base.
    let has_base = split.first.is_none();
    let [emission_share, _] = shares_at(frame, path, (d, t), surface);
    next.emitted =
        path.emitted + if has_base { Vec3::ZERO } else { path.throughput * surface.emission * emission_share };
    let slot = path.slot % frame.size[2] + free * frame.size[2];
    let mut branch = split.second.filter(|_| follows_both).map(|sample| on(slot, sample, 1.0));
    if let (Some(Plane::Frosted), true, Some(branch)) = (plane, splits, &mut branch) {
        branch.emitted = next.emitted - path.emitted;
        next = EyePath { throughput: path.throughput, emitted: path.emitted, ..next };
    }
    Some((next, branch))
}

/// Oracle for glossy surfaces: the path ends there, and another one follows the lobe if it is narrow; unless it `splits` one of them
/// is chosen. `None` if the surface has no lobe narrow enough, and the path just ends.
fn at_lobe(
    frame: &layout::FrameParameters,
    scene: &Scene,
    numbers: [f32; 3],
    splits: bool,
    path: &EyePath,
    (d, t, cos_view): (Vec3, f32, f32),
    surface: &SurfacePoint,
) -> Option<(EyePath, Option<EyePath>)> {
    let (r, n) = (surface.reflectance, surface.shading);
    if r.f90 <= 0.0 || width_of(r.alpha) > frame.choice[3] || path.segments + 2 > frame.scene[2] {
        return None;
    }
    let base = mean(r.kd);
    let share = (base / (base + mean(schlick(r.f0, r.f90, -n.dot(d))))).clamp(0.25, 0.75);
    let alone = crate::bsdf::Reflectance { kd: Vec3::ZERO, ..r };
    let (wi, weight) = alone.sample_lobe(&scene.materials, false, n, -d, numbers[0], numbers[1]);
    let weight = if wi.dot(surface.geometric) > 0.0 { weight } else { Vec3::ZERO };
    let along = |slot: u32, throughput: Vec3| {
        let origin = offset_origin(surface.position, surface.geometric, frame.eye[3]);
        EyePath {
            slot,
            ray: (throughput.max_element() > 0.0).then_some(Ray { origin, t_max: 3.0e38, direction: wi }),
            throughput,
            depth: path.depth + cos_view * t,
            lobe: pdf_specular(&scene.materials, n, wi, -d, r.alpha),
            segments: path.segments + 1,
            ..*path
        }
    };
    if splits {
        let chance =
            if width_of(r.alpha) < NARROW { 1.0 } else { (LOBE_CHANCE * weight.max_element()).clamp(0.2, 1.0) };
        let weight = if numbers[2] < chance { weight / chance } else { Vec3::ZERO };
        let along = along(path.slot + frame.size[2], path.throughput * weight);
        let branch = EyePath { emitted: Vec3::ZERO, narrow: width_of(r.alpha) < NARROW, ..along };
        return Some((EyePath { ray: None, sampled: true, ..*path }, Some(branch)));
    }
    if numbers[2] < share {
        let throughput = path.throughput / share;
        return Some((EyePath { ray: None, sampled: true, throughput, ..*path }, None));
    }
    let [_, of_path] = shares_at(frame, path, (d, t), surface);
    let next = along(path.slot, path.throughput * weight / (1.0 - share) * of_path);
    // A path without light ends here, and keeps its depth.
    let ended = EyePath { ray: None, throughput: Vec3::ZERO, ..*path };
    Some((if next.ray.is_some() { next } else { ended }, None))
}

/// The path mirrored by a normal of a surface.
fn mirrored(
    frame: &layout::FrameParameters,
    path: &EyePath,
    (d, depth): (Vec3, f32),
    surface: &SurfacePoint,
    n: Vec3,
) -> EyePath {
    let origin = offset_origin(surface.position, surface.geometric, frame.eye[3]);
    let ray = Some(Ray { origin, t_max: 3.0e38, direction: d - 2.0 * d.dot(n) * n });
    EyePath { ray, depth: path.depth + depth, ..*path }
}

/// Oracle for glossy planes: both components at the first hit, one of them at later hits.
fn at_plane(
    frame: &layout::FrameParameters,
    step: u32,
    path: &EyePath,
    (d, depth): (Vec3, f32),
    surface: &SurfacePoint,
    [energy, grazing]: [f32; 2],
) -> (EyePath, Option<EyePath>) {
    let n = surface.geometric;
    let mirrored = mirrored(frame, path, (d, depth), surface, n);
    if step == 0 {
        let branch = EyePath { slot: path.slot + frame.size[2], emitted: Vec3::ZERO, ..mirrored };
        return (EyePath { ray: None, ..*path }, Some(branch));
    }
    let r = &surface.reflectance;
    let reflectance = match frame.reflectance() {
        Reflectance::Schlick => r.f0 * (energy - grazing) + r.f90 * grazing,
        Reflectance::Map | Reflectance::Fresnel => energy * fresnel_fitted_rgb(r.f0, -n.dot(d)),
    };
    let probability = mean(r.kd) / (mean(r.kd) + mean(reflectance));
    let stays = own_number(frame, path.slot, step) < probability;
    let chance = if stays { probability } else { 1.0 - probability };
    let (unlikely, chose) = (path.unlikely || chance < 0.5, path.chose || chance < 1.0);
    if stays {
        return (EyePath { ray: None, throughput: path.throughput / chance, unlikely, chose, ..*path }, None);
    }
    if path.segments > 0 && path.segments + 2 > frame.scene[2] {
        return (EyePath { ray: None, throughput: Vec3::ZERO, unlikely, chose, ..*path }, None);
    }
    // After a lobe segments count, and the plane's image is found in one way only.
    let (segments, lobe) = if path.segments > 0 { (path.segments + 1, 0.0) } else { (0, path.lobe) };
    (EyePath { throughput: path.throughput * reflectance / chance, unlikely, chose, segments, lobe, ..mirrored }, None)
}
