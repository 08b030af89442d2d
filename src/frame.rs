//! The frame: each pass once, in order, outputs feeding inputs.

mod mirrors;
mod optional;
mod parts;
mod photons;
mod steps;

use crate::error::Result;
use crate::gpu::{Buffer, Context, Image, Memory, Recorder, Staging};
use crate::pass::accumulate::{Accumulate, Film};
use crate::pass::camera_rays::CameraRays;
use crate::pass::clusters::{self, Clusters};
use crate::pass::collect::Collect;
use crate::pass::delta_choice::{Candidates, DeltaChoice};
use crate::pass::discontinuity::{self, Discontinuity};
use crate::pass::eye_paths::{self, EyePaths};
use crate::pass::gather::Gather;
use crate::pass::importance::Importance;
use crate::pass::layout::{self, PointLight, Work};
use crate::pass::lens::{self, Lens};
use crate::pass::merge::Merge;
use crate::pass::mirror_image::{Lobes, Planes, Tables};
use crate::pass::mirror_lights::{self, MirrorLights, MirrorSteps};
use crate::pass::receivers::{self, ReceiversPass};
use crate::pass::resolve::Resolve;
use crate::pass::schedule::Schedule;
use crate::pass::shade::{self, Shade};
use crate::pass::sort::{Sort, SortBuffers};
use crate::pass::summands::Summands;
use crate::pass::tiles::Tiles;
use crate::pass::trace::Trace;
use crate::pass::walk_reflect::WalkReflect;
use crate::pass::walk_start::WalkStart;
use crate::pass::{Kernels, List, Paths, Rays, Receivers, Sums, vec4s};
use crate::plan::{EyePlan, LightPlan, MirrorPlan, PhotonPlan, StepTable};
use crate::scene_buffers::SceneBuffers;
use crate::settings::{LightChoice, Settings};
use photons::PhotonSteps;
use steps::Steps;

pub use mirrors::Mirrors;
pub use photons::Photons;

/// The passes of a frame with their buffers and steps.
pub struct Frame {
    /// Parameters, written at the start of each frame.
    pub parameters: Buffer,
    /// Lights: for each class of pixels delta lights, then particles by number of reflections.
    pub lights: Buffer,
    /// Running sums.
    pub film: Film,
    /// The image for the host.
    pub image: Image,
    /// `[0]`: rays lost in this frame.
    pub status: Buffer,
    /// Particles' rays and fluxes.
    pub particles: Rays,
    /// Flux of each particle.
    pub flux: Buffer,
    /// Eye rays, then gather rays.
    pub rays: Rays,
    /// What eye rays carry through mirrors and glass.
    pub paths: Paths,
    /// What the eye sees: a slot for each pixel, and where paths are split as many again for the second components.
    pub primary: Receivers,
    /// What gather rays hit.
    pub gathered: Receivers,
    /// Light at the primary receivers.
    pub pixel_sums: Sums,
    /// Light at the gathered receivers.
    pub gathered_sums: Sums,
    /// The filter of that light.
    pub discontinuity: Option<Discontinuity>,
    /// Mirror images on glossy planes.
    pub mirrors: Option<Mirrors>,
    /// Sums of the image's summands.
    pub summands: Option<Summands>,
    /// Depth of field; `None`: the camera has no lens.
    pub lens: Option<Lens>,
    /// What the eye's paths note of glossy planes.
    pub planes: Planes,
    /// Throughput of each slot's gather path.
    pub beta: Buffer,
    /// Tiles of pixels that show mirrors or glass.
    pub ideal_tiles: List,
    /// For each step of the eye paths the rays that go on.
    pub eye_lists: Vec<List>,
    /// For each bounce the receivers to light.
    pub lists: Vec<List>,
    /// Puts what the eye sees in clusters by its pixels; `None`: it is sorted, or not put in clusters.
    pub clusters: Option<Clusters>,
    /// Chooses the emitters of a pass by what the eye sees.
    pub importance: Option<Importance>,
    /// Chooses the lights without area that a pass is lit by; `None`: by all.
    pub delta_choice: Option<DeltaChoice>,
    /// Lights mirrored by planar mirrors; `None`: there are none.
    pub mirror_lights: Option<MirrorLights>,
    /// Caustic photons; `None`: there are none, or nothing to shoot them at.
    pub photons: Option<Photons>,
    batch: List,
    clear_work: Buffer,
    walk_start: WalkStart,
    walk_trace: Trace,
    walk_reflect: WalkReflect,
    camera_rays: CameraRays,
    eye_trace: Trace,
    tiles: Tiles,
    eye_paths: Vec<Follow>,
    eye_receivers: ReceiversPass,
    second: Option<Second>,
    bounces: Vec<Bounce>,
    accumulate: Accumulate,
    resolve: Resolve,
    steps: Steps,
    particle_count: u32,
    pixels: u32,
    tile_count: u32,
}

/// One step of eye paths through mirrors and glass.
struct Follow {
    pass: EyePaths,
    schedule: Schedule,
    trace: Trace,
}

/// What split paths need besides.
struct Second {
    receivers: ReceiversPass,
    merge: Merge,
}

/// The passes of one bounce; bounce 0 is what the eye sees.
struct Bounce {
    /// How its receivers are found, for bounces after the first.
    arrive: Option<Arrive>,
    /// Turns the number of its receivers into dispatches.
    schedule: Schedule,
    /// Brings neighbours together on the list of its receivers.
    sort: Option<Sort>,
    /// Lights its receivers; the last bounce only emits.
    shade: Option<Shade>,
}

/// From the receivers of the bounce before to those of this one, and their light back to the pixels.
struct Arrive {
    gather: Gather,
    trace: Trace,
    receivers: ReceiversPass,
    collect: Collect,
}

impl Frame {
    #[allow(clippy::too_many_arguments)]
    /// Creates the passes for an image of this size. `delta` are the lights without area; `lens`: what is out of focus is blurred.
    pub fn new(
        context: &Context,
        kernels: &Kernels,
        staging: &mut Staging,
        scene: &SceneBuffers,
        settings: &Settings,
        plan: &LightPlan,
        delta: &[PointLight],
        lens: bool,
        [width, height]: [u32; 2],
    ) -> Result<Frame> {
        let film = Film::new(context, width * height, settings.summands)?;
        let image = Image::new(context, "image", width, height, ash::vk::Format::R32G32B32A32_SFLOAT)?;
        Self::with_film(context, kernels, staging, scene, settings, plan, delta, lens, (film, image))
    }

    /// As [`Frame::new`], going on with the sums and image of another frame.
    #[allow(clippy::too_many_arguments)]
    pub fn with_film(
        context: &Context,
        kernels: &Kernels,
        staging: &mut Staging,
        scene: &SceneBuffers,
        settings: &Settings,
        plan: &LightPlan,
        delta: &[PointLight],
        lens: bool,
        (film, image): (Film, Image),
    ) -> Result<Frame> {
        let pixels = image.width() * image.height();
        let film = film.with_summands(context, pixels, settings.summands)?;
        let particle_count = settings.particles();
        let eye = EyePlan::new(settings, scene.ideal, pixels);
        let slots = eye.slots();
        // The eye's receivers are listed in whole tiles.
        let tile_count = image.width().div_ceil(8) * image.height().div_ceil(8);
        let cluster_count = clusters::count([image.width(), image.height()], settings.pattern) * eye.components;
        let listed = 64 * cluster_count.max(tile_count * eye.components);
        let mut table = StepTable::default();
        let slots_of_delta = plan.delta as usize;
        let candidates = (slots_of_delta < delta.len()).then(|| Candidates::new(delta, &scene.delta_emitters));
        let delta = candidates.as_ref().map_or(delta, |all| &all.lights[..slots_of_delta]);
        let steps = Steps::new(&mut table, settings, plan, delta, scene.cluster_lanes(context), &eye);
        let targets = scene.targets.as_ref();
        let photon_plan = targets.and_then(|t| PhotonPlan::new(settings, t.count));
        let mirror_plan = MirrorPlan::new(settings, scene.mirror_count(), plan)?;
        let mirror_steps = mirror_plan.map(|plan| MirrorSteps::new(&mut table, &plan, &steps.list_trace));
        let photon_steps = photon_plan.map(|plan| PhotonSteps::new(&mut table, settings, &plan, mirror_plan.is_some()));
        let step_buffer = staging.stage(context, "steps", &table.steps)?;

        let device = |name: &str, bytes: u64| Buffer::new(context, name, bytes, Memory::Device);
        let parameters = device("frame parameters", size_of::<layout::Frame>() as u64)?;
        let status = device("status", 16)?;
        let mut of_class = delta.to_vec();
        of_class.resize(plan.slots().max(1) as usize, PointLight::default());
        let light_contents = of_class.repeat(settings.classes() as usize);
        let lights = staging.stage(context, "lights", &light_contents)?;
        let particles = Rays::new(context, "particle", particle_count)?;
        let flux = vec4s(context, "particle flux", particle_count)?;
        let rays = Rays::new(context, "pixel", slots)?;
        let paths = Paths::new(context, slots, if eye.steps > 0 { slots } else { 0 })?;
        let primary = Receivers::new(context, "primary", slots)?;
        let gathered = Receivers::new(context, "gathered", slots)?;
        let pixel_sums = Sums::new(context, "pixel", slots)?;
        let gathered_sums = Sums::new(context, "gathered", slots)?;
        let beta = vec4s(context, "beta", slots)?;
        let planes = Planes::new(context, pixels, eye.mirrors, eye.panes)?;
        let tables = match eye.mirrors {
            true => Some(Tables::new(context, staging, &scene.finishes, &scene.reflectors)?),
            false => None,
        };

        // Receivers of a bounce are listed while those of the one before are still needed, so two lists take turns.
        let list_pixels = [0, 1].map(|i| device(&format!("list {i}"), 4 * u64::from(listed)));
        let [even, odd] = list_pixels;
        let list_pixels = [even?, odd?];
        let take_turns = |name: &str, count: usize| -> Result<Vec<List>> {
            let list = |b: usize| {
                let work = device(&format!("{name} {b}"), size_of::<Work>() as u64)?;
                Ok(List { pixels: list_pixels[b % 2].clone(), work })
            };
            (0..count).map(list).collect()
        };
        let lists = take_turns("work", steps.bounces.len())?;
        let eye_lists = take_turns("eye work", steps.eye_paths.len())?;
        let clusters = if steps.by_screen {
            let list = &lists[0];
            Some(Clusters::new(context, kernels, &parameters, list, &step_buffer, &status, cluster_count)?)
        } else {
            None
        };
        // Where what the eye sees is put down.
        let seen_places = clusters.as_ref().map_or(&lists[0].pixels, |clusters| &clusters.places);
        let seen_list = List { pixels: seen_places.clone(), work: lists[0].work.clone() };
        let ideal_tiles = List {
            pixels: device("ideal tiles", 4 * u64::from(tile_count))?,
            work: device("ideal tile work", size_of::<Work>() as u64)?,
        };
        let marks = device("tile marks", 4 * u64::from(tile_count))?;
        let batch = List { pixels: list_pixels[0].clone(), work: device("batch work", size_of::<Work>() as u64)? };
        let clear_work = staging.stage(context, "cleared work", &[Work::of_classes(settings.classes())])?;

        let trace =
            |rays: &Rays, list: &List| Trace::new(kernels, &parameters, scene, rays, list, &step_buffer, &status);
        let receivers_pass = |list_in: &List, list_out: &List, receivers: &Receivers| {
            ReceiversPass::new(
                kernels,
                &receivers::Inputs {
                    frame: &parameters,
                    scene,
                    rays: &rays,
                    list_in,
                    list_out,
                    beta: &beta,
                    paths: &paths,
                    receivers,
                    steps: &step_buffer,
                },
            )
        };
        let eye_paths = (0..eye_lists.len())
            .map(|k| {
                let list_out = &eye_lists[k];
                let inputs = eye_paths::Inputs {
                    frame: &parameters,
                    scene,
                    rays: &rays,
                    paths: &paths,
                    receivers: &primary,
                    list_in: k.checked_sub(1).map_or(&ideal_tiles, |before| &eye_lists[before]),
                    list_out,
                    planes: &planes,
                    lobes: Lobes::of(tables.as_ref(), &planes),
                    steps: &step_buffer,
                };
                Ok(Follow {
                    pass: EyePaths::new(kernels, &inputs)?,
                    schedule: Schedule::new(kernels, &list_out.work, &step_buffer, &status)?,
                    trace: trace(&rays, list_out)?,
                })
            })
            .collect::<Result<_>>()?;
        let discontinuity = match settings.filter {
            None => None,
            Some(filter) => Some(Discontinuity::new(
                context,
                &discontinuity::Inputs {
                    frame: &parameters,
                    receivers: &primary,
                    paths: &paths,
                    sums: &pixel_sums,
                    ideal_tiles: &ideal_tiles,
                    components: eye.components,
                    size: [image.width(), image.height()],
                    pattern: settings.pattern,
                    filter,
                },
            )?),
        };
        // What is put together to the image.
        let seen_sums = discontinuity.as_ref().map_or(&pixel_sums, |pass| &pass.filtered);
        let summands = match &film.summands {
            None => None,
            Some(of_film) => {
                let reflected = Summands::reflected(context, pixels)?;
                let (status, sums) = (&status, seen_sums);
                let pass =
                    Summands::new(kernels, &parameters, &primary, &paths, sums, of_film, reflected, status, pixels)?;
                Some(pass)
            }
        };
        // What second components and mirror images are added to.
        let shown = summands.as_ref().map_or(&primary.emitted, |pass| &pass.reflected);
        let mirrors = match (settings.superposition, tables) {
            (Some(superposition), Some(tables)) => {
                let inputs = mirrors::Inputs {
                    frame: &parameters,
                    receivers: &primary,
                    paths: &paths,
                    sums: seen_sums,
                    shown,
                    tiles: &ideal_tiles,
                    planes: &planes,
                    size: [image.width(), image.height()],
                };
                Some(Mirrors::new(context, kernels, staging, &superposition, tables, &inputs)?)
            }
            _ => None,
        };
        let second = match eye.components {
            1 => None,
            _ => Some(Second {
                receivers: receivers_pass(&ideal_tiles, &seen_list, &primary)?,
                merge: Merge::new(kernels, &parameters, &primary, &paths, seen_sums, &ideal_tiles, shown)?,
            }),
        };
        let lens = match lens {
            false => None,
            true => {
                let inputs = lens::Inputs {
                    frame: &parameters,
                    receivers: &primary,
                    paths: &paths,
                    sums: seen_sums,
                    size: [image.width(), image.height()],
                };
                Some(Lens::new(context, staging, &inputs)?)
            }
        };
        let sort_buffers = match &scene.wide_nodes {
            Some(_) if !steps.by_screen => Some(SortBuffers::new(context, listed, settings.classes())?),
            _ => None,
        };
        let classes = sort_buffers.as_ref().map(|buffers| &buffers.classes);
        let bounces = (0..steps.bounces.len())
            .map(|b| {
                let (receivers, sums) = if b == 0 { (&primary, &pixel_sums) } else { (&gathered, &gathered_sums) };
                let list = &lists[b];
                let arrive = match b.checked_sub(1).map(|before| &lists[before]) {
                    None => None,
                    Some(before) => {
                        let from = if b == 1 { &primary } else { &gathered };
                        Some(Arrive {
                            gather: Gather::new(kernels, &parameters, from, before, &rays, &beta, &step_buffer)?,
                            trace: trace(&rays, before)?,
                            receivers: receivers_pass(before, list, &gathered)?,
                            collect: Collect::new(
                                kernels,
                                &gathered,
                                before,
                                &beta,
                                &gathered_sums,
                                &pixel_sums,
                                &step_buffer,
                            )?,
                        })
                    }
                };
                let inputs = shade::Inputs {
                    frame: &parameters,
                    scene,
                    receivers,
                    list,
                    lights: &lights,
                    rays: &rays,
                    sums,
                    steps: &step_buffer,
                    status: &status,
                    classes: classes.or(clusters.as_ref().map(|clusters| &clusters.listed)),
                };
                let lit = !steps.bounces[b].shade.is_empty();
                let shade = if lit { Some(Shade::new(kernels, &inputs)?) } else { None };
                let sort = match (&shade, &sort_buffers) {
                    (Some(_), Some(buffers)) => {
                        Some(Sort::new(kernels, &parameters, list, receivers, buffers, &step_buffer)?)
                    }
                    _ => None,
                };
                Ok(Bounce { arrive, schedule: Schedule::new(kernels, &list.work, &step_buffer, &status)?, sort, shade })
            })
            .collect::<Result<_>>()?;

        let importance = match settings.light_choice {
            LightChoice::Power => None,
            LightChoice::Contribution => {
                Some(Importance::new(context, kernels, &parameters, &scene.emitters, &primary)?)
            }
        };
        let emitters = importance.as_ref().map_or(&scene.emitters, |importance| &importance.emitters);
        let delta_choice = match &candidates {
            None => None,
            Some(all) => {
                let classes = settings.classes();
                Some(DeltaChoice::new(context, kernels, staging, &parameters, all, emitters, &lights, classes)?)
            }
        };
        let mirror_lights = match (&scene.mirrors, mirror_plan, mirror_steps) {
            (Some(mirrors), Some(plan), Some(numbers)) => {
                let inputs = mirror_lights::Inputs {
                    frame: &parameters,
                    scene,
                    mirrors,
                    lights: &lights,
                    receivers: &primary,
                    list: &lists[0],
                    rays: &rays,
                    sums: &pixel_sums,
                    steps: &step_buffer,
                    status: &status,
                };
                Some(MirrorLights::new(context, kernels, &plan, numbers, slots, &inputs)?)
            }
            _ => None,
        };
        let photons = match (targets, photon_plan, photon_steps) {
            (Some(targets), Some(plan), Some(numbers)) => {
                let inputs = photons::Inputs {
                    parameters: &parameters,
                    scene,
                    targets,
                    receivers: &primary,
                    list: &lists[0],
                    sums: &pixel_sums,
                    steps: &step_buffer,
                    status: &status,
                };
                Some(Photons::new(context, kernels, staging, &plan, numbers, &inputs)?)
            }
            _ => None,
        };

        Ok(Frame {
            walk_start: WalkStart::new(
                kernels,
                &parameters,
                [emitters, &scene.sobol_columns],
                &particles,
                &flux,
                &lights,
                particle_count,
            )?,
            walk_trace: trace(&particles, &batch)?,
            walk_reflect: WalkReflect::new(kernels, &parameters, scene, &particles, &flux, &lights, &step_buffer)?,
            camera_rays: CameraRays::new(kernels, &parameters, &rays, &paths, &primary, pixels)?,
            eye_trace: Trace::of_eye(kernels, &parameters, scene, &rays, &batch, &step_buffer, &status)?,
            eye_receivers: receivers_pass(&batch, &seen_list, &primary)?,
            tiles: Tiles::new(kernels, &parameters, scene, &rays, &marks, &ideal_tiles, tile_count)?,
            eye_paths,
            clusters,
            second,
            bounces,
            accumulate: Accumulate::new(kernels, &parameters, &primary, &paths, seen_sums, &film, &status, pixels)?,
            resolve: Resolve::new(kernels, &film, &image, pixels)?,
            parameters,
            lights,
            film,
            image,
            status,
            particles,
            flux,
            rays,
            paths,
            primary,
            gathered,
            pixel_sums,
            gathered_sums,
            discontinuity,
            mirrors,
            summands,
            lens,
            planes,
            beta,
            ideal_tiles,
            eye_lists,
            lists,
            importance,
            delta_choice,
            mirror_lights,
            photons,
            batch,
            clear_work,
            steps,
            particle_count,
            pixels,
            tile_count,
        })
    }

    /// Records what must happen once before the first frame: sums cleared, image in its layout.
    pub fn record_clear(&self, rec: &mut Recorder) -> Result<()> {
        self.record_clear_sums(rec)?;
        rec.image_to_general(&self.image)
    }

    /// Records what must happen once after the uploads of a new frame, before its first pass.
    pub fn record_prepare(&self, rec: &mut Recorder) -> Result<()> {
        self.mirrors.as_ref().map_or(Ok(()), |mirrors| mirrors.record_setup(rec))?;
        self.lens.as_ref().map_or(Ok(()), |lens| lens.record_setup(rec))
    }

    /// Records the clearing of the sums alone.
    pub fn record_clear_sums(&self, rec: &mut Recorder) -> Result<()> {
        self.film.buffers().into_iter().try_for_each(|buffer| rec.fill(buffer, 0))
    }

    /// Records one pass of the renderer: particles leave the lights and become point lights, photons leave them by way of
    /// mirrors and glass; what the eye sees is lit by both; what clipping cut off is gathered, bounce by bounce; irradiance is
    /// filtered; mirror images are spread over glossy planes; second components are added to their pixels; what is out of focus
    /// is blurred; the image is added to the sums.
    pub fn record(&self, rec: &mut Recorder, parameters: &layout::Frame) -> Result<()> {
        self.record_start(rec, parameters)?;
        if self.importance.is_some() {
            // Who is to be lit decides from where.
            rec.scope("eye", |rec| self.record_eye(rec))?;
            rec.scope("importance", |rec| self.record_importance(rec))?;
            rec.scope("walk", |rec| self.record_walk(rec))?;
        } else {
            rec.scope("walk", |rec| self.record_walk(rec))?;
            rec.scope("eye", |rec| self.record_eye(rec))?;
        }
        self.record_delta_choice(rec)?;
        self.record_photons(rec)?;
        self.record_mirror_choice(rec)?;
        for bounce in 0..self.bounces.len() {
            rec.scope("gather", |rec| self.record_gather(rec, bounce))?;
            rec.scope("shade", |rec| self.record_shade(rec, bounce))?;
            self.record_photon_light(rec, bounce)?;
            self.record_mirror_light(rec, bounce)?;
            rec.scope("collect", |rec| self.record_collect(rec, bounce))?;
        }
        self.record_discontinuity(rec)?;
        self.record_mirrors(rec)?;
        self.record_merge(rec)?;
        self.record_summands(rec)?;
        self.record_lens(rec)?;
        rec.scope("accumulate", |rec| self.accumulate.record(rec, parameters.keys[3]))
    }

    /// Parameters and cleared counters.
    pub fn record_start(&self, rec: &mut Recorder, parameters: &layout::Frame) -> Result<()> {
        rec.begin();
        rec.update(&self.parameters, 0, bytemuck::bytes_of(parameters))?;
        rec.fill(&self.status, 0)?;
        rec.fill(&self.planes.region, 0)?;
        rec.copy(&self.clear_work, &self.batch.work)?;
        for list in self.lists.iter().chain(&self.eye_lists) {
            rec.copy(&self.clear_work, &list.work)?;
        }
        self.summands.as_ref().map_or(Ok(()), |summands| summands.record_clear(rec))?;
        self.photons.as_ref().map_or(Ok(()), |photons| photons.record_clear(rec))
    }

    /// Records the mean of all passes into [`Frame::image`].
    pub fn record_resolve(&self, rec: &mut Recorder) -> Result<()> {
        rec.scope("resolve", |rec| self.resolve.record(rec))
    }
}
