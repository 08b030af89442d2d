//! Light from point lights, with shadows: the sum over lights of Keller 1997, eq. 3, for all pixels at once.
//!
//! For a shading point at x with normal n and each light at y (see `shaders/include/lights.wgsl` for I):
//!
//! ```text
//! E += V(x, y) I(y -> x) cos(x) / max(|x - y|^2, clip^2)          clipped distance
//! L += f_s(x, wi, wo) times the same                              the lobe at the shading point
//! ```
//!
//! E is kept separate from the diffuse albedo, and direct light from indirect light.
//!
//! Bias: clipping removes the fraction 1 - |x - y|^2 / clip^2 from lights nearer than the clip distance; `gather`
//! restores it. Lights without area in the scene (point, spot, parallel) are not clipped: they need no clipping to be
//! exact.
//!
//! The lights are split into chunks, one dispatch each, and each chunk into rounds, so that no invocation exceeds
//! [`crate::plan::LOOP_BUDGET`] iterations; a ray that runs out of steps continues in the next round.
//!
//! Two kernels compute the same sums ([`crate::settings::Traversal`]):
//!
//! - `shade.wgsl`: an invocation takes a shading point and walks the binary tree alone. It runs on every device.
//! - `shade_cluster.wgsl`: a subgroup of 4 to 64 takes 64 neighbouring shading points (see `sort`) and walks the
//!   eight-wide tree for all of them and one light. First, with a lane for each light, it drops lights that no point of
//!   the cluster can see: all points face away, or the light faces away, or the maximum irradiance at the nearest point
//!   of the cluster's box does not exceed [`crate::settings::Settings::light_threshold`]. The rays of a cluster share
//!   the light, so they lie in a narrow shaft: lane k tests child k against the shaft by interval arithmetic, surviving
//!   children are tested against the rays, and the triangles of a leaf are set up one a lane as planes through the
//!   light. The stack holds a word for each node with children left, sixteen in all, in registers. The leaf that
//!   blocked the last light is tried first. Work that exceeds the budget continues in the next round, and in the end in
//!   the first kernel; so does parallel light, which has no position.
//!
//! Visibility is the same except for rays within rounding of a triangle's edge or plane.
//!
//! Cost: for each pair of a shading point and a light that face each other one shadow ray (as in `trace`, any hit ends
//! it; in clusters about a tenth of that on lavapipe, see `docs/benchmarks.md`) and some 60 operations; linear in
//! points and in lights.

use glam::Vec3;

use super::eye_paths::highlight_factor;
use super::layout::{PointLight, Step};
use super::light_lists::LightLists;
use super::schedule::{LIST_GROUPS, ROUND_GROUPS, Schedule};
use super::{BoundKernel, Kit, Lighting, List, ShadingPoints, TraversalKernels, push};
use crate::accel::{Bvh, Ray};
use crate::bsdf::{Reflectance, pdf_specular};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources};
use crate::light::cosine;
use crate::plan::{self, RayClusters, StepTable};
use crate::ring::Paths;
use crate::scene::{Material, Scene};
use crate::settings::Settings;

/// The pass over one set of shading points.
pub struct Shade {
    rays: ShadowRays,
}

/// The two forms of a kernel that traces shadow rays, with their bindings.
pub struct ShadowRays {
    single: BoundKernel,
    cluster: Option<BoundKernel>,
    schedule: Schedule,
    work: Buffer,
    progress: Buffer,
}

/// Initial progress: done with this chunk unless a cluster says otherwise.
const NO_LIGHT_LEFT: u32 = u32::MAX;

/// Rounds of clusters before the single rays continue. In each a cluster finishes at least one light, unless its budget
/// is too small even for that. Enough for the clusters across silhouettes of detailed rooms: with half of them single rays took an eighth of the time of clusters
/// in a room of 414,841 triangles, with eight a thousandth.
const CLUSTER_ROUNDS: u32 = 8;

/// Maximum number of lights of a chunk for clusters: they keep a mask of them in 32 bits.
const CLUSTER_LIGHTS: u32 = 32;

/// Steps of a chunk of lights.
pub struct Chunk {
    /// Its rounds. If `clusters`, the first eight are taken by clusters; what they leave continues ray by ray.
    pub rounds: Vec<u32>,
    /// Whether all its lights have a position, so that clusters can take them.
    pub clusters: bool,
    /// Its lights: the first, and one past the last.
    pub lights: (u32, u32),
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// The shading points.
    pub points: &'a ShadingPoints,
    /// The lit ones among them.
    pub list: &'a List,
    /// The lights of each point.
    pub lists: &'a LightLists,
    /// Progress of the shadow rays of each point.
    pub progress: &'a Buffer,
    /// Receives the light.
    pub lighting: &'a Lighting,
    /// Starts of the classes of pixels on a sorted list, see [`super::sort::SortBuffers`], or classes of the clusters
    /// in screen order, see [`super::clusters::Clusters::listed`]; `None`: the points form no clusters.
    pub classes: Option<&'a Buffer>,
}

impl Shade {
    /// Adds to `lighting` of the points in `list`; the first chunk initialises the sums.
    pub fn new(kit: &Kit, inputs: &Inputs, steps: &Resources) -> Result<Self> {
        let Inputs { points, list, lists, progress, lighting, classes } = *inputs;
        let own = lists.resources();
        let classes = classes.map(|classes| Resources::of([("classes", classes)]));
        let kernels = TraversalKernels::shade(kit.context, kit.traversal, kit.has_alpha)?;
        let sets = [&points.resources(), &lighting.resources(), &own];
        Ok(Shade { rays: ShadowRays::new(kit, &kernels, &sets, classes.as_ref(), (list, progress), steps)? })
    }

    /// Records the chunks, each in its rounds.
    pub fn record<'a>(&self, rec: &mut Recorder, chunks: impl IntoIterator<Item = &'a Chunk>) -> Result<()> {
        self.rays.record(rec, chunks)
    }
}

impl ShadowRays {
    /// Binds both forms to `sets`, and the cluster form also to `of_clusters`; without these there is no cluster form.
    pub fn new(
        kit: &Kit,
        kernels: &TraversalKernels,
        sets: &[&Resources],
        of_clusters: Option<&Resources>,
        (list, progress): (&List, &Buffer),
        steps: &Resources,
    ) -> Result<ShadowRays> {
        let own = Resources::of([("progress", progress)]);
        let list_set = list.resources();
        let all = [sets, &[&own, &list_set, steps]].concat();
        let cluster = match (kernels.cluster, of_clusters) {
            (Some(kernel), Some(more)) => Some(kit.bind(kernel, &[&all[..], &[more]].concat())?),
            _ => None,
        };
        Ok(ShadowRays {
            single: kit.bind(kernels.single, &all)?,
            cluster,
            schedule: Schedule::new(kit, &list.work, steps)?,
            work: list.work.clone(),
            progress: progress.clone(),
        })
    }

    /// Records the chunks, each in its rounds.
    pub fn record<'a>(&self, rec: &mut Recorder, chunks: impl IntoIterator<Item = &'a Chunk>) -> Result<()> {
        for chunk in chunks {
            if chunk.clusters && self.cluster.is_some() {
                rec.fill(&self.progress, NO_LIGHT_LEFT)?;
            }
            for (round, &step) in chunk.rounds.iter().enumerate() {
                let groups = if round == 0 { LIST_GROUPS } else { ROUND_GROUPS };
                // Both kernels take 64 rays a workgroup.
                let kernel = match &self.cluster {
                    Some(cluster) if round < CLUSTER_ROUNDS as usize && chunk.clusters => cluster,
                    _ => &self.single,
                };
                kernel.run_listed(rec, &push(step), &self.work, groups)?;
                self.schedule.record_round(rec, step, round)?;
            }
        }
        Ok(())
    }
}

impl Chunk {
    /// Whether its dispatches may add light: all do but those of dark slots of a ring. The first one initialises the sums.
    pub fn is_lit(&self, paths: &Paths, delta: u32) -> bool {
        self.lights.0 == 0 || paths.light(self.lights, delta)
    }

    /// The clusters, if the budget of a dispatch suffices for them.
    pub fn clusters(settings: &Settings, clusters: Option<RayClusters>) -> Option<RayClusters> {
        let steps = |clusters| plan::cluster_steps(Chunk::size(settings, true), settings.loop_budget, clusters);
        clusters.filter(|&clusters| steps(clusters) >= plan::MIN_CLUSTER_STEPS)
    }

    /// Maximum number of lights in a chunk. Chunks for clusters are larger: a cluster loads its points once for all
    /// lights.
    pub fn size(settings: &Settings, clusters: bool) -> u32 {
        let single = settings.lights_per_dispatch;
        if clusters { (4 * single).min(CLUSTER_LIGHTS) } else { single }
    }

    /// Steps for the lights `first..end` of a chunk. `clusters`: from [`Chunk::clusters`], if they take the chunk;
    /// `by_screen`: the list is in screen order.
    pub fn new(
        table: &mut StepTable,
        settings: &Settings,
        (first, end): (u32, u32),
        clusters: Option<RayClusters>,
        by_screen: bool,
    ) -> Chunk {
        // Single rays take at most this number of lights in a round; a larger chunk has more rounds in proportion.
        let most = settings.lights_per_dispatch;
        let rounds = settings.rounds * (end - first).div_ceil(most).max(1);
        let steps = plan::shade_steps(most, settings.loop_budget);
        let clears = u32::from(first == 0);
        let indirect = if by_screen { 2 } else { 1 };
        let chunk = Step { first, end, steps, lights: most, indirect, clears, ..Step::default() };
        let Some(clusters) = clusters else {
            return Chunk { rounds: table.add_rounds(rounds, chunk), clusters: false, lights: (first, end) };
        };
        let cluster_steps = plan::cluster_steps(Chunk::size(settings, true), settings.loop_budget, clusters);
        let clears = |round: u32| if round == 0 { chunk.clears } else { 0 };
        let together =
            (0..CLUSTER_ROUNDS).map(|round| Step { round, clears: clears(round), steps: cluster_steps, ..chunk });
        // The work that clusters leave over has all rounds of the single rays ahead.
        let one_by_one = (1..=rounds).map(|round| Step { round, clears: 0, last: u32::from(round == rounds), ..chunk });
        let rounds = together.chain(one_by_one).map(|step| table.add(step)).collect();
        Chunk { rounds, clusters: true, lights: (first, end) }
    }
}

/// A shading point, for the oracle.
#[derive(Clone, Copy, Debug)]
pub struct ShadingPoint {
    /// Point, with ray-origin offset.
    pub position: Vec3,
    /// Geometric normal.
    pub geometric: Vec3,
    /// Shading normal.
    pub shading: Vec3,
    /// Reflectance.
    pub reflectance: Reflectance,
    /// Direction to the viewer.
    pub wo: Vec3,
    /// If a path of its own follows its lobe: virtual lights on a unit of area of surfaces that do not emit.
    pub sampled: Option<f32>,
    /// Whether splats show indirect light of its lobe.
    pub splats: bool,
}

/// Factor of the square of the clip distance for direct highlights where splats show the rest of a lobe. Shader twin: `SPLAT_CLIP`.
pub const SPLAT_CLIP: f32 = 0.01;

impl ShadingPoint {
    /// Its reflectance as far as light is gathered for it: without a lobe that has a path of its own or splats, since nothing of that
    /// is clipped.
    pub fn gathering(&self) -> Reflectance {
        let r = self.reflectance;
        if self.sampled.is_some() || self.splats { Reflectance { f0: Vec3::ZERO, f90: 0.0, ..r } } else { r }
    }
}

/// Oracle: the perpendicular irradiance that `light` sends towards a point in direction `-wi` (wi from the point to the
/// light) at squared distance `r2`, visibility aside.
pub fn light_towards(materials: &[Material], light: &PointLight, wi: Vec3, r2: f32, clip2: f32) -> Vec3 {
    let xyz = |a: [f32; 4]| Vec3::new(a[0], a[1], a[2]);
    let flags = light.flags();
    let normal = xyz(light.normal);
    let cos = -wi.dot(normal);
    // Of lights that emit by a power of the cosine it is 1 where they emit.
    let spot = (cos * light.normal[3] + light.emit[3]).clamp(0.0, 1.0);
    let cosine_law = if flags & PointLight::SURFACE != 0 { cosine::power(cos.max(0.0), light.exponent()) } else { 1.0 };
    let mut intensity = xyz(light.emit) * (cosine_law * spot * spot);
    if flags & PointLight::GLOSSY != 0 && cos > 0.0 {
        let lobe = Reflectance { kd: Vec3::ZERO, f0: xyz(light.f0), f90: light.flux[3], alpha: light.wi[3] };
        intensity += xyz(light.flux) * lobe.eval_specular(materials, normal, xyz(light.wi), -wi) * cos;
    }
    let clip2 = if flags & PointLight::CLIPPED != 0 { clip2 } else { 0.0 };
    let falloff = if flags & PointLight::DIRECTIONAL != 0 { 1.0 } else { 1.0 / r2.max(clip2) };
    intensity * falloff
}

/// Oracle: the share of a light's highlight, over the square of the distance, at a point whose lobe a path follows; `surfaces`:
/// virtual lights on a unit of area of other surfaces.
fn highlight_falloff(
    materials: &[Material],
    light: &PointLight,
    receiver: &ShadingPoint,
    (wi, r2): (Vec3, f32),
    surfaces: f32,
) -> f32 {
    if light.flags() & PointLight::DIRECTIONAL != 0 {
        let lobe = pdf_specular(materials, receiver.shading, wi, receiver.wo, receiver.reflectance.alpha);
        let found = light.flags() & PointLight::ENVIRONMENT != 0;
        return if found { light.wi[3] / (light.wi[3] + lobe).max(1e-37) } else { 1.0 };
    }
    if light.flags() & PointLight::SURFACE == 0 {
        return 1.0 / r2;
    }
    let lobe = pdf_specular(materials, receiver.shading, wi, receiver.wo, receiver.reflectance.alpha);
    let lights = if light.f0[3] == 0.0 { light.wi[3] } else { surfaces };
    let normal = Vec3::new(light.normal[0], light.normal[1], light.normal[2]);
    highlight_factor(lobe, lights, r2, -wi.dot(normal))
}

/// Oracle: direct irradiance, indirect irradiance and specular radiance of a shading point under all lights.
pub fn reference(
    scene: &Scene,
    bvh: &Bvh,
    receiver: &ShadingPoint,
    lights: &[PointLight],
    clip2: f32,
    far: f32,
) -> [Vec3; 3] {
    let materials = &scene.materials;
    let mut sums = [Vec3::ZERO; 3];
    for light in lights {
        let at = Vec3::new(light.position[0], light.position[1], light.position[2]);
        let axis = Vec3::new(light.normal[0], light.normal[1], light.normal[2]);
        let d = if light.flags() & PointLight::DIRECTIONAL != 0 { -far * axis } else { at - receiver.position };
        let r2 = d.length_squared();
        if r2 == 0.0 {
            continue;
        }
        let wi = d / r2.sqrt();
        let cos = wi.dot(receiver.shading);
        if cos <= 0.0 || wi.dot(receiver.geometric) <= 0.0 {
            continue;
        }
        let e = light_towards(materials, light, wi, r2, clip2) * cos;
        if e == Vec3::ZERO {
            continue;
        }
        let passes = bvh.transmittance(scene, &Ray { origin: receiver.position, t_max: 1.0, direction: d });
        let e = e * passes;
        sums[usize::from(light.f0[3] != 0.0)] += e;
        if receiver.splats {
            if light.f0[3] == 0.0 {
                let l = light_towards(materials, light, wi, r2, SPLAT_CLIP * clip2) * (cos * passes);
                sums[2] += l * receiver.reflectance.eval_specular(materials, receiver.shading, receiver.wo, wi);
            }
        } else if receiver.reflectance.f90 > 0.0 {
            let l = receiver.sampled.map_or(e, |surfaces| {
                // The intensity: the light at unit distance, not clipped.
                let falloff = highlight_falloff(materials, light, receiver, (wi, r2), surfaces);
                light_towards(materials, light, wi, 1.0, 0.0) * (cos * falloff * passes)
            });
            sums[2] += l * receiver.reflectance.eval_specular(materials, receiver.shading, receiver.wo, wi);
        }
    }
    sums
}
