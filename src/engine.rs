//! The engine: a scene on a device, recorded pass by pass into the caller's command buffer.
//!
//! ```text
//! host's device --Context::adopt--> Engine::new(context, scene, camera, settings)
//!     record_setup    once, before the first pass: uploads, cleared sums, the image's layout
//!     record_pass     any number of times; each adds one pass to the sums
//!     record_image    the mean of the passes so far, in Engine::image()
//! ```
//!
//! What a host can rely on:
//!
//! - **Nothing is submitted, waited for or read back.** All commands are compute and transfer, outside a render pass.
//! - **Order.** Command buffers are submitted in the order in which they were recorded, each once, all to one queue:
//!   a pass is told apart from the others when it is recorded. A pass that is never submitted is missing from the mean
//!   and does no harm, unless it was the first after a restart or a change of rounds: then make that change again.
//! - **Synchronisation.** Each `record_*` begins with a barrier after everything submitted to the queue before and
//!   ends with one that makes its results visible to compute, transfer and indirect commands. So frames may be in
//!   flight one behind the other, with other engines on the same queue, and a host needs a barrier of its own only to
//!   use the image in other stages (source: COMPUTE_SHADER, SHADER_WRITE) or on another queue family.
//! - **Lifetime.** What recorded commands use is held by the [`Retained`](crate::gpu::Retained) that
//!   [`Recorder::finish`](crate::gpu::Recorder::finish) or [`Context::record_into`] returns. Keep it until they have
//!   finished; the engine itself may go before.
//! - **Changes.** Camera, settings and, for an engine made by [`Engine::new_dynamic`], the scene may change between any two
//!   passes, also while frames are in flight: uploads are recorded at the start of the next pass, from memory that its
//!   `Retained` holds. What changes the image starts the sums over; what changes nothing does not. If the first pass after a
//!   change is never submitted, call [`Engine::upload_again`].
//! - **Lost rays.** A pass in which a ray ran out of steps is left out of the sums and of the mean; [`Film::counts`]
//!   tells how many are in them, and [`Engine::set_rounds`] gives rays more steps.
//!
//! [`Film::counts`]: crate::pass::accumulate::Film::counts

mod edit;

pub use edit::EditTimes;

use crate::accel::Bvh;
use crate::accel::objects::ObjectTrees;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::gpu::{Context, Image, Recorder, Staging};
use crate::light::emitters::Emitters;
use crate::light::mirrors::Mirrors;
use crate::light::targets::Targets;
use crate::pass::Kernels;
use crate::pass::layout::PointLight;
use crate::pass::{delta_choice, importance};
use crate::plan::{EyePlan, LightPlan, ParameterSource, PhotonPlan};
use crate::scene::{Camera, Scene};
use crate::scene_buffers::{Ideal, SceneBuffers, delta_lights};
use crate::settings::{LightChoice, Settings, Traversal};

/// Greatest number of pixels, so that products of it fit; a device's own limits on buffers mostly come first.
const MAX_PIXELS: u64 = 1 << 26;

/// A scene ready to be rendered on a device.
pub struct Engine {
    context: Context,
    kernels: Kernels,
    scene_buffers: SceneBuffers,
    /// Memory that uploads read from, until the caller says that they have finished.
    staging: Option<Staging>,
    frame: Frame,
    parameters: ParameterSource,
    targets: Targets,
    mirrors: Mirrors,
    delta: Vec<PointLight>,
    bvh: Bvh,
    emitters: Emitters,
    reflectivity: f32,
    /// What an engine whose scene may change knows besides.
    moving: Option<Box<edit::Moving>>,
    passes: u32,
    /// `record_setup` has been recorded.
    set_up: bool,
    /// The next pass records the uploads first.
    upload: bool,
    /// The next pass clears the sums first.
    clear: bool,
}

impl Engine {
    /// Builds the acceleration structure and creates all device resources. Nothing runs on the device yet. The scene stays as
    /// it is; [`Engine::new_dynamic`] makes an engine whose scene may change.
    ///
    /// Errors: camera or settings out of range, a scene without light, resources beyond the device's limits or memory.
    pub fn new(context: &Context, scene: &Scene, camera: Camera, settings: Settings) -> Result<Engine> {
        Ok(Self::with_trees(context, scene, camera, settings, false)?.0)
    }

    /// `dynamic`: with a hierarchy whose objects can move.
    fn with_trees(
        context: &Context,
        scene: &Scene,
        camera: Camera,
        settings: Settings,
        dynamic: bool,
    ) -> Result<(Engine, Option<ObjectTrees>)> {
        settings.validate()?;
        check_camera(&camera)?;
        check_lens(&settings, &camera)?;
        let kernels = Kernels::for_scene(context, settings.traversal, !scene.textures.is_empty())?;
        let clusters = kernels.shade.cluster.is_some();
        let (bvh, trees) = if dynamic {
            let (trees, bvh) = ObjectTrees::build(scene, clusters)?;
            (bvh, Some(trees))
        } else {
            (Bvh::build(scene)?, None)
        };
        let emitters = Emitters::of(scene, scene.emitters_are_lights)?;
        check_choice(&settings, &emitters)?;
        let delta = delta_lights(scene, bvh.scale());
        let reflectivity = scene.mean_reflectivity();
        let lights = LightPlan::new(&settings, reflectivity, delta.len() as u32);
        let mut staging = Staging::new();
        let mut scene_buffers = match &trees {
            Some(trees) => SceneBuffers::with_wide(context, &mut staging, scene, &bvh, &emitters, trees.wide.as_ref())?,
            None => SceneBuffers::new(context, &mut staging, scene, &bvh, &emitters, clusters)?,
        };
        if scene_buffers.wide_nodes.is_none() && kernels.shade.cluster.is_some() {
            if settings.traversal == Traversal::Cluster {
                return Err(Error::Setting {
                    name: "--traversal",
                    message: String::from("the scene's tree is too deep for the cluster kernel's stack; use auto"),
                });
            }
            log::info!("the scene's tree is too deep for clusters; shadow rays are traced one by one");
        }
        if scene_buffers.ideal.frosted_panes && settings.mirroring_planes() == 0 {
            log::info!("frosted panes are shown clear without --superposition");
        }
        let targets = Targets::of(scene, &bvh);
        scene_buffers.update_targets(context, &mut staging, &targets)?;
        let mirrors = Mirrors::of(scene, &bvh);
        scene_buffers.update_mirrors(context, &mut staging, &mirrors)?;
        check_slots(&settings, scene_buffers.ideal, camera.resolution)?;
        let frame = Frame::new(
            context,
            &kernels,
            &mut staging,
            &scene_buffers,
            &settings,
            &lights,
            &delta,
            camera.has_lens(),
            camera.resolution,
        )?;
        let parameters = ParameterSource {
            photons: PhotonPlan::new(&settings, targets.spheres.len() as u32),
            spreading_planes: scene_buffers.ideal.spreads(),
            settings,
            camera,
            lights,
            nodes: bvh.node_count(),
            emitters: emitters.list.len() as u32,
            diagonal: bvh.diagonal(),
            bounds: (bvh.min, bvh.max),
            coordinate_scale: bvh.scale(),
            mirrors: scene_buffers.mirror_count(),
        };
        let engine = Engine {
            context: context.clone(),
            kernels,
            scene_buffers,
            staging: Some(staging),
            frame,
            parameters,
            targets,
            mirrors,
            delta,
            bvh,
            emitters,
            reflectivity,
            moving: None,
            passes: 0,
            set_up: false,
            upload: false,
            clear: false,
        };
        Ok((engine, trees))
    }

    /// Records the uploads, the clearing of the sums and the image's layout. The passes may follow in the same command
    /// buffer.
    pub fn record_setup(&mut self, rec: &mut Recorder) -> Result<()> {
        self.apply_edits()?;
        rec.begin();
        if let Some(staging) = &self.staging {
            staging.record(rec)?;
        }
        self.frame.record_prepare(rec)?;
        self.frame.record_clear(rec)?;
        self.passes = 0;
        (self.set_up, self.upload, self.clear) = (true, false, false);
        Ok(())
    }

    /// Frees the memory that uploads read from: those of [`Engine::record_setup`], or of the first pass after
    /// [`Engine::set_rounds`] or another change. To be called once they have been recorded; what is in flight is kept by its `Retained`.
    pub fn setup_finished(&mut self) {
        if self.set_up && !self.upload {
            self.staging = None;
        }
    }

    /// Records the next pass.
    ///
    /// After an error the command buffer is not to be submitted; the engine is as before.
    pub fn record_pass(&mut self, rec: &mut Recorder) -> Result<()> {
        if !self.set_up {
            return Err(Error::Resource {
                name: String::from("engine"),
                message: String::from("a pass is recorded before record_setup; record that first"),
            });
        }
        self.apply_edits()?;
        let parameters = self.parameters.frame(self.passes)?;
        if self.upload || self.clear {
            rec.begin();
        }
        if let (true, Some(staging)) = (self.upload, &self.staging) {
            rec.scope("upload", |rec| staging.record(rec))?;
            self.frame.record_prepare(rec)?;
        }
        if self.clear {
            self.frame.record_clear_sums(rec)?;
        }
        self.frame.record(rec, &parameters)?;
        self.passes += 1;
        (self.upload, self.clear) = (false, false);
        Ok(())
    }

    /// Records the mean of the passes so far into [`Engine::image`]; black before the first.
    ///
    /// The image stays in layout GENERAL, written by compute shaders; the recorder's barrier makes it visible to later
    /// transfer and compute commands of the queue.
    pub fn record_image(&self, rec: &mut Recorder) -> Result<()> {
        rec.begin();
        self.frame.record_resolve(rec)
    }

    /// Linear radiance, Rec. 709, RGBA 32-bit float; alpha is coverage. Layout GENERAL from [`Engine::record_setup`]
    /// on; leave it so, or bring it back before the next [`Engine::record_image`]. Usage: storage, sampled, transfer
    /// source.
    pub fn image(&self) -> &Image {
        &self.frame.image
    }

    /// Passes recorded since the sums were cleared.
    pub fn passes(&self) -> u32 {
        self.passes
    }

    /// Takes up after `passes` passes whose sums were put back by the caller, or steps back over a pass that failed.
    pub fn set_passes(&mut self, passes: u32) {
        self.passes = passes;
    }

    /// Looks from another camera of the same resolution, and starts over if it is another. Takes effect with the next pass;
    /// commands recorded before keep the camera they were recorded with. A pinhole in place of a lens, or the other way round, makes
    /// new passes and buffers, as [`Engine::set_settings`] does.
    pub fn set_camera(&mut self, camera: Camera) -> Result<()> {
        check_camera(&camera)?;
        let [width, height] = self.parameters.camera.resolution;
        if camera.resolution != [width, height] {
            return Err(Error::Setting {
                name: "--resolution",
                message: format!("the engine was made for {width}x{height}; make another one for another size"),
            });
        }
        check_lens(&self.parameters.settings, &camera)?;
        if camera != self.parameters.camera {
            if camera.has_lens() != self.parameters.camera.has_lens() {
                let (settings, lights) = (self.parameters.settings.clone(), self.parameters.lights.clone());
                self.rebuild_frame(&settings, &lights, &camera)?;
            }
            self.parameters.camera = camera;
            self.restart();
        }
        Ok(())
    }

    /// Starts over: the next pass clears the sums and is the first again. Until it, the image keeps what it shows.
    pub fn restart(&mut self) {
        self.passes = 0;
        self.clear = true;
    }

    /// Gives rays more rounds, from the next pass on. What the passes have summed up is kept.
    pub fn set_rounds(&mut self, rounds: u32) -> Result<()> {
        let settings = Settings { rounds, ..self.parameters.settings.clone() };
        settings.validate()?;
        if !self.set_up {
            return Err(Error::Resource {
                name: String::from("engine"),
                message: String::from("rounds are changed before record_setup; set them in Settings"),
            });
        }
        self.rebuild_frame(&settings, &self.parameters.lights.clone(), &self.parameters.camera.clone())?;
        self.parameters.settings = settings;
        Ok(())
    }

    /// Renders with other settings from the next pass on, and starts over if they change what a pass computes. Seed, clipping
    /// distance, jitter and light threshold cost nothing; most others make new passes and buffers, which takes milliseconds
    /// and, while frames are in flight, the memory of both. The image stays, and shows what it shows until the next pass.
    ///
    /// Errors, after which everything is as before: settings out of range; another `traversal`, which is chosen when the engine
    /// is made.
    pub fn set_settings(&mut self, settings: Settings) -> Result<()> {
        settings.validate()?;
        let old = &self.parameters.settings;
        if settings.traversal != old.traversal {
            return Err(Error::Setting {
                name: "--traversal",
                message: String::from("it is chosen when the engine is made; make another one for another traversal"),
            });
        }
        let same_image = Settings { rounds: old.rounds, moving_passes: old.moving_passes, ..settings.clone() } == *old;
        if same_image && settings.rounds != old.rounds && self.set_up {
            self.set_rounds(settings.rounds)?;
        } else if settings != *old {
            let as_parameters = Settings {
                seed: settings.seed,
                clip: settings.clip,
                jitter: settings.jitter,
                light_threshold: settings.light_threshold,
                moving_passes: settings.moving_passes,
                ..old.clone()
            };
            if settings != as_parameters || settings.clips() != old.clips() {
                check_slots(&settings, self.scene_buffers.ideal, self.parameters.camera.resolution)?;
                check_choice(&settings, &self.emitters)?;
                check_lens(&settings, &self.parameters.camera)?;
                let lights = LightPlan::new(&settings, self.reflectivity, self.delta.len() as u32);
                self.rebuild_frame(&settings, &lights, &self.parameters.camera.clone())?;
                self.parameters.lights = lights;
                self.parameters.photons = PhotonPlan::new(&settings, self.scene_buffers.target_count());
            }
            if !same_image {
                self.restart();
            }
        }
        self.parameters.settings = settings;
        Ok(())
    }

    /// Makes new passes that go on with the sums and the image; their uploads are recorded with the next pass.
    fn rebuild_frame(&mut self, settings: &Settings, lights: &LightPlan, camera: &Camera) -> Result<()> {
        let mut staging = self.take_staging();
        let frame = Frame::with_film(
            &self.context,
            &self.kernels,
            &mut staging,
            &self.scene_buffers,
            settings,
            lights,
            &self.delta,
            camera.has_lens(),
            (self.frame.film.clone(), self.frame.image.clone()),
        );
        // What was staged before has to be uploaded whether or not there are new passes.
        self.keep_staging(staging);
        self.frame = frame?;
        Ok(())
    }

    /// Uploads that have not been recorded yet, to add to them.
    fn take_staging(&mut self) -> Staging {
        let waiting = self.upload || !self.set_up;
        self.staging.take().filter(|_| waiting).unwrap_or_default()
    }

    fn keep_staging(&mut self, staging: Staging) {
        self.staging = Some(staging);
        self.upload = self.set_up;
    }

    /// The device.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// The passes and their buffers, for tests and tools.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The scene on the device.
    pub fn scene_buffers(&self) -> &SceneBuffers {
        &self.scene_buffers
    }

    /// What parameters are made of.
    pub fn parameters(&self) -> &ParameterSource {
        &self.parameters
    }

    /// The acceleration structure.
    pub fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    /// The emitters.
    pub fn emitters(&self) -> &Emitters {
        &self.emitters
    }

    /// What photons are shot at; empty where there are none.
    pub fn targets(&self) -> &Targets {
        &self.targets
    }

    /// The planar mirrors; empty where there are none.
    pub fn mirrors(&self) -> &Mirrors {
        &self.mirrors
    }

    /// The lights without area, lit once in each pass or chosen from.
    pub fn delta_lights(&self) -> &[PointLight] {
        &self.delta
    }
}

/// Checks that emitters, and lights without area, are not too many to choose from.
fn check_choice(settings: &Settings, emitters: &Emitters) -> Result<()> {
    let delta = emitters.delta.len();
    if settings.delta_lights.is_some() && delta > delta_choice::MAX_CANDIDATES {
        let most = delta_choice::MAX_CANDIDATES;
        return Err(Error::Setting {
            name: "--delta-lights",
            message: format!("it chooses among up to {most} lights, and the scene has {delta}; use all"),
        });
    }
    let count = emitters.list.len();
    if settings.light_choice == LightChoice::Power || count <= importance::MAX_EMITTERS as usize {
        return Ok(());
    }
    Err(Error::Setting {
        name: "--light-choice",
        message: format!(
            "contribution takes up to {} emitters, and the scene has {count}; use power",
            importance::MAX_EMITTERS
        ),
    })
}

/// Checks that the receivers of the eye are not too many.
fn check_slots(settings: &Settings, ideal: Ideal, [width, height]: [u32; 2]) -> Result<()> {
    let slots = EyePlan::new(settings, ideal, width * height).components;
    if u64::from(width * height) * u64::from(slots) <= MAX_PIXELS {
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

/// Checks that an image that a lens blurs is not to be written as summands, each of which would be sharp.
fn check_lens(settings: &Settings, camera: &Camera) -> Result<()> {
    if !(settings.summands && camera.has_lens()) {
        return Ok(());
    }
    Err(Error::Setting {
        name: "--summands",
        message: String::from(
            "the lens blurs their sum alone, so that they would not add up; leave it out, or --aperture 0",
        ),
    })
}

fn check_camera(camera: &Camera) -> Result<()> {
    let [width, height] = camera.resolution;
    if width == 0 || height == 0 || u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(Error::Setting {
            name: "--resolution",
            message: format!("{width}x{height} is empty or has more than {MAX_PIXELS} pixels"),
        });
    }
    camera.check().map_err(|message| Error::Scene(format!("camera: {message}")))
}
