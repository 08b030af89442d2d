//! Plans a pass before it is recorded: the number of particles that survive each reflection, the slots of their lights,
//! the division of work into dispatches, and the sampling parameters of each pass.

mod cones;
mod eye;
mod lights;
mod parameters;
mod photons;
mod ring;
mod soft_shadows;
mod splats;

pub use self::cones::Cones;
pub use self::eye::{EyePlan, MAX_PIXELS_OF_THREE};
pub use self::lights::LightPlan;
pub use self::photons::{MirrorPlan, PhotonPlan};
pub use self::splats::SplatPlan;
pub use parameters::{MAX_FOLLOWED_ALPHA, MIN_LIGHT_ALPHA};

use std::borrow::Cow;

use crate::device_scene::{DeviceScene, SpecularFeatures};
use crate::error::{Error, Result};
use crate::extent::Extent;
use crate::gpu::Resources;
use crate::pass::Kit;
use crate::pass::delta_choice::{Candidates, MAX_CANDIDATES};
use crate::pass::importance::MAX_EMITTERS;
use crate::pass::layout::{PointLight, Step};
use crate::settings::{ClusterOrder, Compensation, LightChoice, Settings};
use crate::view::{MAX_PIXELS, View};

/// Maximum iterations of all loops of a shader invocation's subgroup together. lavapipe before Mesa 25 silently ends
/// loops after 65,535; on a real device the watchdog sets a similar, higher limit.
pub const LOOP_BUDGET: u32 = 60_000;

/// Loop iterations of a graphics card for one of [`LOOP_BUDGET`], for rays that are traced alone: it has no cap, and its watchdog takes
/// far longer dispatches.
pub const CARD_LOOP_FACTOR: u32 = 16;

/// Maximum iterations of one traversal step: the node, up to four triangles, and the exit of their loop.
const ITERATIONS_PER_STEP: u32 = 6;

/// Number of independent instances of the estimator, for the error estimate (Kollig and Keller 2002).
pub const INSTANCES: u32 = 2;

/// Traversal steps of one shadow ray in one dispatch of the shading pass over `lights` lights, such that the dispatch
/// stays within `budget` (at least [`min_loop_budget`]) for every scene: lights * (steps * 6 + 6) <= budget.
pub fn shade_steps(lights: u32, budget: u32) -> u32 {
    (budget / lights.max(1)).saturating_sub(6) / ITERATIONS_PER_STEP
}

/// Clusters of 64 rays, each traced by a subgroup.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RayClusters {
    /// Subgroup size.
    pub lanes: u32,
    /// Some surfaces let rays pass.
    pub has_alpha: bool,
}

/// Visits of one cluster in one dispatch of the cluster kernel over `lights` lights, such that the dispatch stays within `budget`. A lane holds 64 / lanes rays, and a loop over them takes one more iteration for
/// its exit. Every visit (of a node, child, leaf or triangle) has at most one such loop or a few shorter ones. Each
/// light adds two such loops, specular lobes one for each ray; start and end take a few, and the classes of pixels one
/// each. When the budget runs out, at most the children and the leaves of one node are still unfinished; their triangles may let
/// light pass, and then wait, a few leaves at a time, to be looked up.
pub fn cluster_steps(lights: u32, budget: u32, clusters: RayClusters) -> u32 {
    let rays = 64 / clusters.lanes;
    let visit = (rays + 2).max(10);
    let light = 2 * (rays + 1) + rays * (rays + 3) + 12;
    let alpha_visits = if clusters.has_alpha { alpha_visits(rays) } else { 0 };
    let under_way = 8 * visit + 8 * (3 + 8 * (1 + alpha_visits) * visit);
    budget.saturating_sub(light * lights + under_way + 16 * rays + 60 + Settings::MAX_PATTERN.pow(2)) / visit
}

/// Visits of triangles by a cluster of lanes with so many rays whose loops are as long as those over one more that lets light pass: each
/// ray looks up where it meets the triangle, and one texture, and there is a loop over all rays in each. Shader twin:
/// `shaders/include/cluster_walk.wgsl`.
fn alpha_visits(rays: u32) -> u32 {
    rays + 5
}

/// Minimum visits for clusters: with fewer they would leave most of their work to single rays, so single rays do all of
/// it.
pub const MIN_CLUSTER_STEPS: u32 = 500;

/// Minimum loop budget of dispatches over `lights` lights: two steps for each.
pub fn min_loop_budget(lights: u32) -> u32 {
    3 * ITERATIONS_PER_STEP * lights.max(1)
}

/// Traversal steps of one ray in one dispatch of the closest-hit pass.
pub fn trace_steps(budget: u32) -> u32 {
    (budget / ITERATIONS_PER_STEP).saturating_sub(1)
}

/// The [`Step`]s of a stage: the parameters of each of its dispatches. Steps are in a buffer and a push constant
/// selects one, since drivers may recompile a kernel for each value of a push constant that decides a branch (lavapipe
/// does).
#[derive(Default)]
pub struct StepTable {
    /// The steps.
    pub steps: Vec<Step>,
}

impl StepTable {
    /// Adds a step and returns its index, the push constant of the dispatch.
    pub fn add(&mut self, step: Step) -> u32 {
        self.steps.push(step);
        self.steps.len() as u32 - 1
    }

    /// Adds the same step for each of `rounds` rounds.
    pub fn add_rounds(&mut self, rounds: u32, step: Step) -> Vec<u32> {
        (0..rounds)
            .map(|round| {
                let clears = if round == 0 { step.clears } else { 0 };
                self.add(Step { round, clears, last: u32::from(round + 1 == rounds), ..step })
            })
            .collect()
    }

    /// Adds the rounds that trace a list of rays one by one.
    pub fn add_list_rounds(&mut self, plan: &Plan) -> Vec<u32> {
        self.add_rounds(plan.trace_rounds(), Step { indirect: 1, steps: plan.trace_steps(), ..Step::default() })
    }

    /// Adds the step that schedules a newly filled list.
    pub fn add_list(&mut self) -> u32 {
        self.add(Step { indirect: 1, ..Step::default() })
    }

    /// Uploads the steps.
    pub fn stage(self, kit: &Kit, name: &str) -> Result<Resources> {
        // Without steps the kernels never read the buffer, but it must exist.
        let steps = if self.steps.is_empty() { vec![Step::default()] } else { self.steps };
        Ok(Resources::of([("steps", &kit.stage(name, &steps)?)]))
    }
}

/// Inputs that the passes of a rendering have in common: settings, view, and everything derived from them and the
/// scene.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The settings as asked for.
    pub asked: Settings,
    /// The settings in effect: those of a ring in place of some.
    pub settings: Settings,
    /// The view.
    pub view: View,
    /// Virtual lights that particles leave.
    pub lights: LightPlan,
    /// Lights that light a shading point: all of these, or those that its cluster chooses.
    pub lists: LightPlan,
    /// Particles of a class of pixels.
    pub particles: u32,
    /// Eye paths.
    pub eye: EyePlan,
    /// Of the pixels that take the light of lit points; `None`: all of them are lit ([`Settings::shading_rate`]).
    pub pixels: Option<EyePlan>,
    /// Caustic photons; `None`: there are none, or no targets.
    pub photons: Option<PhotonPlan>,
    /// Mirrored lights; `None`: there are none.
    pub mirrors: Option<MirrorPlan>,
    /// Splats; `None`: there are none.
    pub splats: Option<SplatPlan>,
    /// Numbers of the emitters whose shadows are convolved, see [`crate::pass::soft_shadow`].
    pub soft_emitters: Vec<u32>,
    /// Sizes of the scene.
    pub scene: SceneSize,
}

/// Sizes of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneSize {
    /// Nodes of the tree.
    pub nodes: u32,
    /// Whether some surfaces let rays pass.
    pub has_alpha: bool,
    /// Loop iterations that the device takes for one of [`LOOP_BUDGET`], for rays traced alone.
    pub loop_factor: u32,
    /// Emitters.
    pub emitters: u32,
    /// Diagonal of the bounding box.
    pub diagonal: f32,
    /// Mean radiance of the emitters with area, times their area on all sides that emit.
    pub emission: f32,
    /// Whether materials have lobes by tables.
    pub tables: bool,
    /// Lengths of the surfaces that the view shows.
    pub extent: Extent,
}

/// Derives the plan of a rendering. Errors: settings or view out of range, or beyond what the scene supports.
pub fn derive(scene: &DeviceScene, asked: &Settings, view: &View) -> Result<Plan> {
    asked.validate()?;
    let settings = &settings_for(scene, asked, view);
    view.check(settings)?;
    ring::check(settings, view)?;
    check_choice(settings, scene)?;
    if settings.summands && view.has_lens() {
        return Err(Error::Setting {
            name: "--summands",
            message: String::from(
                "the lens blurs their sum alone, so that they would not add up; leave it out, or --aperture 0",
            ),
        });
    }
    if settings.summands && view.has_shutter() {
        return Err(Error::Setting {
            name: "--summands",
            message: String::from(
                "an open shutter blurs their sum alone, so that they would not add up; leave it out, or --shutter 0",
            ),
        });
    }
    let extent = Extent::of(&scene.bvh, &scene.albedos, view);
    let (delta, rho) = (scene.delta.len() as u32, extent.reflectivity);
    let mut lights = match &settings.ring {
        None => LightPlan::new(settings, rho, delta),
        Some(ring) => LightPlan::of_ring(settings, ring.paths(), delta),
    };
    if scene.lights_are_complete {
        lights.survivors.clear();
    }
    if scene.kept_light.is_some() {
        lights = LightPlan { survivors: Vec::new(), delta: 0, environment: false };
    }
    let (mut lists, mut particles) = (lights.clone(), settings.particles);
    if settings.light_pool > settings.particles && lights.survivors.len() > 1 {
        let (pool, started) = LightPlan::of_pool(settings, rho, delta);
        let chosen = lights.of_cluster();
        if started > settings.particles {
            (lists, lights, particles) = (chosen, pool, started);
        }
    }
    let environment = scene.emitters.environment.is_some() && scene.kept_light.is_none();
    (lights.environment, lists.environment) = (environment, environment);
    let mut eye = EyePlan::new(settings, scene.specular, view);
    if scene.lights_are_complete {
        eye = EyePlan::new(&Settings { glossy_paths: false, ..settings.clone() }, scene.specular, view);
    }
    check_slots(settings, scene.specular, view)?;
    if eye.images.is_some() && scene.mirror_images.is_none() {
        return Err(Error::Setting {
            name: "--mirror-source",
            message: String::from("the scene has no images with depth; make them by DepthImages::sample, or use rays"),
        });
    }
    Ok(Plan {
        asked: asked.clone(),
        photons: PhotonPlan::new(settings, scene.target_count()),
        mirrors: MirrorPlan::new(settings, scene.mirror_count(), &lights),
        splats: SplatPlan::of(settings, scene, view)?,
        soft_emitters: soft_shadows::emitters(settings, scene, view)?,
        lights,
        lists,
        particles,
        pixels: EyePlan::of_pixels(settings, scene.specular, view, eye),
        eye,
        // Neighbours in an atlas need not be neighbours in the scene.
        settings: Settings { filter: settings.filter.filter(|_| view.camera().is_some()), ..settings.clone() },
        view: view.clone(),
        scene: SceneSize {
            nodes: scene.bvh.node_count(),
            has_alpha: scene.has_alpha,
            loop_factor: scene.loop_factor,
            emitters: scene.emitters.list.len() as u32,
            diagonal: scene.bvh.diagonal(),
            emission: scene.emitters.emission(),
            tables: scene.has_tables(),
            extent,
        },
    })
}

/// The settings for a scene and a view: those of a ring, without what stands in for virtual lights where kept light does, and with light for
/// each pixel where pixels cannot take that of others.
fn settings_for(scene: &DeviceScene, settings: &Settings, view: &View) -> Settings {
    let of_ring = settings.ring.map_or(settings.clone(), |ring| ring::settings(settings, &ring));
    let settings = &Settings { shading_rate: shading_rate(settings, view), ..of_ring };
    if scene.kept_light.is_none() {
        return settings.clone();
    }
    Settings {
        light_pool: 0,
        light_choice: LightChoice::Power,
        delta_lights: None,
        photons: 0,
        mirror_lights: 0,
        compensation: Compensation::Off,
        ..settings.clone()
    }
}

/// [`Settings::shading_rate`] for a view. A lens and a shutter blur lit points, and sums of summands are theirs.
fn shading_rate(settings: &Settings, view: &View) -> u32 {
    let own_rays = matches!(view, View::Camera { .. });
    let upsamples = own_rays && !view.has_lens() && !view.has_shutter() && !settings.summands;
    if upsamples { settings.shading_rate } else { 1 }
}

/// Checks the number of emitters, and of lights without area, against the maximum that can be chosen from.
fn check_choice(settings: &Settings, scene: &DeviceScene) -> Result<()> {
    let delta = scene.delta.len();
    if settings.delta_lights.is_some() && delta > MAX_CANDIDATES {
        return Err(Error::Setting {
            name: "--delta-lights",
            message: format!("it chooses among up to {MAX_CANDIDATES} lights, and the scene has {delta}; use all"),
        });
    }
    let count = scene.emitters.list.len();
    if settings.light_choice == LightChoice::Power || count <= MAX_EMITTERS as usize {
        return Ok(());
    }
    Err(Error::Setting {
        name: "--light-choice",
        message: format!("contribution takes up to {MAX_EMITTERS} emitters, and the scene has {count}; use power"),
    })
}

/// Checks the number of the eye's shading points, in a scene with these surfaces, against its maximum.
pub(crate) fn check_slots(settings: &Settings, specular: SpecularFeatures, view: &View) -> Result<()> {
    let [width, height] = lit_size(settings, view);
    let eye = EyePlan::new(settings, specular, view);
    if u64::from(width) * u64::from(height) * u64::from(eye.slots_of_pixel) <= MAX_PIXELS {
        return Ok(());
    }
    Err(Error::Setting {
        name: "--resolution",
        message: format!(
            "{width}x{height} has more than {} pixels, too many to see glass in two ways; use --no-split",
            MAX_PIXELS / 2
        ),
    })
}

/// Width and height of the image whose points are lit.
fn lit_size(settings: &Settings, view: &View) -> [u32; 2] {
    view.size().map(|n| n.div_ceil(settings.shading_rate))
}

/// Whether gather rays bring back what clipping cut off.
fn gathers_exactly(settings: &Settings, view: &View) -> bool {
    let exact = match settings.compensation {
        Compensation::Off => false,
        // Texels of an atlas do not see each other.
        Compensation::Near => view.camera().is_none(),
        Compensation::Exact => true,
    };
    exact && settings.clips()
}

impl Plan {
    /// Steps of a ray that is traced alone, in one dispatch.
    pub fn trace_steps(&self) -> u32 {
        let budget = self.settings.loop_budget;
        // A budget that is set is kept: it bounds the time of a dispatch.
        trace_steps(if budget == LOOP_BUDGET { budget * self.scene.loop_factor } else { budget })
    }

    /// Dispatches over which such a ray may spread: a ray meets each node once, so small trees need one.
    pub fn trace_rounds(&self) -> u32 {
        // A surface that lets rays pass may take a step for each of its triangles.
        let needed = if self.scene.has_alpha { u32::MAX } else { self.scene.nodes.div_ceil(self.trace_steps()) };
        self.settings.rounds.min(needed.max(1))
    }

    /// Width and height of the image whose points are lit: that of the view, or a part of it ([`Settings::shading_rate`]).
    pub fn lit_size(&self) -> [u32; 2] {
        lit_size(&self.settings, &self.view)
    }

    /// Whether pixels take the light of points nearby.
    pub fn upsamples(&self) -> bool {
        self.pixels.is_some()
    }

    /// Whether these pixels see through mirrors and glass themselves.
    pub fn pixels_follow(&self) -> bool {
        self.pixels.is_some_and(|pixels| pixels.components == 2)
    }

    /// The plan of the eye of these pixels.
    pub(crate) fn of_pixels(&self) -> Option<Plan> {
        let settings = Settings {
            shading_rate: 1,
            superposition: None,
            // Nothing sorts them.
            compensation: Compensation::Off,
            cluster_order: ClusterOrder::Screen,
            ..self.settings.clone()
        };
        Some(Plan { eye: self.pixels?, settings, ..self.clone() })
    }

    /// Number of sets of shading points: the eye's, and one for each gather ray.
    pub fn bounces(&self) -> u32 {
        if gathers_exactly(&self.settings, &self.view) { self.settings.max_depth } else { 1 }
    }

    /// Whether clusters choose among the lights after reflections.
    pub fn chooses_lights(&self) -> bool {
        self.lists != self.lights
    }

    /// Whether edges get more eye rays.
    pub fn antialiases(&self) -> bool {
        let settings = &self.settings;
        let own_rays = matches!(self.view, View::Camera { .. });
        settings.antialias && !settings.summands && own_rays && !self.view.has_lens()
    }

    /// Whether near light comes from the irradiance of other pixels.
    pub fn reuses_pixels(&self) -> bool {
        let settings = &self.settings;
        let near = settings.compensation == Compensation::Near && self.view.camera().is_some();
        near && settings.clips() && self.lights_points()
    }

    /// Maximum number of mirrors and glass that a particle passes before its j-th reflection.
    pub fn walk_steps(&self, scene: &DeviceScene, j: u32) -> u32 {
        let allowed = (self.settings.max_depth - 2).saturating_sub(j);
        if scene.specular.any { allowed.min(self.settings.max_specular) } else { 0 }
    }

    /// Whether lights light the visible points.
    pub fn lights_points(&self) -> bool {
        self.settings.max_depth > 1 && self.lights.slots() > 0
    }

    /// Whether a pass chooses among the lights without area.
    pub fn chooses_delta(&self, scene: &DeviceScene) -> bool {
        scene.kept_light.is_none() && (self.lights.delta as usize) < scene.delta.len()
    }

    /// The initial lights without area in the first slots of each class, before any choice.
    pub fn delta_slots<'a>(&self, scene: &'a DeviceScene) -> Cow<'a, [PointLight]> {
        if !self.chooses_delta(scene) {
            return Cow::Borrowed(&scene.delta);
        }
        let mut all = Candidates::new(&scene.delta, &scene.delta_emitters()).lights;
        all.truncate(self.lights.delta as usize);
        Cow::Owned(all)
    }

    /// Whether passes made for another plan can run with the parameters of this one: the plans differ only in uniforms.
    /// The scene must be the same, or have kept its buffers.
    pub fn fits_frame_of(&self, other: &Plan) -> bool {
        let of_uniforms = Settings {
            seed: other.settings.seed,
            clip: other.settings.clip,
            jitter: other.settings.jitter,
            light_threshold: other.settings.light_threshold,
            power_fraction: other.settings.power_fraction,
            photon_radius: other.settings.photon_radius,
            interleave_photons: other.settings.interleave_photons,
            moving_passes: other.settings.moving_passes,
            ..self.settings.clone()
        };
        let same_view = match (&self.view, &other.view) {
            (View::Camera { .. }, View::Camera { .. }) | (View::GBuffer { .. }, View::GBuffer { .. }) => {
                self.view.size() == other.view.size()
                    && self.view.has_lens() == other.view.has_lens()
                    && self.view.has_shutter() == other.view.has_shutter()
                    && self.view.is_orthographic() == other.view.is_orthographic()
            }
            (one, another) => one == another,
        };
        of_uniforms == other.settings
            && self.settings.clips() == other.settings.clips()
            && same_view
            && self.soft_emitters.len() == other.soft_emitters.len()
            && self.scene.tables == other.scene.tables
            && self.trace_rounds() == other.trace_rounds()
            && self.scene.extent.reflectivity == other.scene.extent.reflectivity
            && (&self.lights, &self.lists, self.eye, self.pixels, self.photons, self.mirrors, self.splats)
                == (&other.lights, &other.lists, other.eye, other.pixels, other.photons, other.mirrors, other.splats)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_dispatch_exceeds_the_loop_budget() {
        for lights in 1..=64 {
            for budget in [LOOP_BUDGET, min_loop_budget(lights)] {
                let steps = shade_steps(lights, budget);
                assert!(steps > 1);
                assert!(lights * (steps * ITERATIONS_PER_STEP + 6) <= budget, "{lights} lights");
                assert!(trace_steps(budget) > 1 && trace_steps(budget) * ITERATIONS_PER_STEP < budget);
            }
            // No visit takes more than this number of iterations, whatever its kind.
            for lanes in [4, 8, 16, 32, 64] {
                for has_alpha in [false, true] {
                    let rays = 64 / lanes;
                    let visits = cluster_steps(lights, LOOP_BUDGET, RayClusters { lanes, has_alpha });
                    assert!(visits > MIN_CLUSTER_STEPS, "{lights} lights, {lanes} lanes");
                    // Of eight triangles in eight leaves: each ray looks each one up, with a loop over the rays and one for a texture.
                    let look_ups = if has_alpha { 64 * (rays * (rays + 4) + 3 * (rays + 1) + 2) } else { 0 };
                    let under_way = 8 * 9 * (rays + 2) + look_ups;
                    let iterations = visits * (rays + 2) + lights * (rays + 1) * (rays + 4) + under_way + 64;
                    assert!(iterations <= LOOP_BUDGET, "{lights} lights, {lanes} lanes: {iterations}");
                }
            }
        }
    }
}
