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
//! - **Lost rays.** A pass in which a ray ran out of steps is left out of the sums and of the mean; [`Film::counts`]
//!   tells how many are in them, and [`Engine::set_rounds`] gives rays more steps.
//!
//! [`Film::counts`]: crate::pass::accumulate::Film::counts

use crate::accel::Bvh;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::gpu::{Context, Image, Recorder, Staging};
use crate::light::emitters::Emitters;
use crate::light::targets::Targets;
use crate::pass::Kernels;
use crate::pass::importance;
use crate::pass::layout::PointLight;
use crate::plan::{EyePlan, LightPlan, ParameterSource, PhotonPlan};
use crate::scene::{Camera, Scene};
use crate::scene_buffers::{SceneBuffers, delta_lights};
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
    delta: Vec<PointLight>,
    bvh: Bvh,
    emitters: Emitters,
    passes: u32,
    /// `record_setup` has been recorded.
    set_up: bool,
    /// The next pass records the uploads first.
    upload: bool,
    /// The next pass clears the sums first.
    clear: bool,
}

impl Engine {
    /// Builds the acceleration structure and creates all device resources. Nothing runs on the device yet.
    ///
    /// Errors: camera or settings out of range, a scene without light, resources beyond the device's limits or memory.
    pub fn new(context: &Context, scene: &Scene, camera: Camera, settings: Settings) -> Result<Engine> {
        settings.validate()?;
        check_camera(&camera)?;
        let bvh = Bvh::build(scene)?;
        let emitters = Emitters::of(scene, scene.emitters_are_lights)?;
        let count = emitters.list.len();
        if settings.light_choice == LightChoice::Contribution && count > importance::MAX_EMITTERS as usize {
            return Err(Error::Setting {
                name: "--light-choice",
                message: format!(
                    "contribution takes up to {} emitters, and the scene has {count}; use power",
                    importance::MAX_EMITTERS
                ),
            });
        }
        let delta = delta_lights(scene, bvh.scale());
        let lights = LightPlan::new(&settings, scene.mean_reflectivity(), delta.len() as u32);
        let kernels = Kernels::new(context, settings.traversal)?;
        let mut staging = Staging::new();
        let mut scene_buffers =
            SceneBuffers::new(context, &mut staging, scene, &bvh, &emitters, kernels.shade.cluster.is_some())?;
        if scene_buffers.wide_nodes.is_none() && kernels.shade.cluster.is_some() {
            if settings.traversal == Traversal::Cluster {
                return Err(Error::Setting {
                    name: "--traversal",
                    message: String::from("the scene's tree is too deep for the cluster kernel's stack; use auto"),
                });
            }
            log::info!("the scene's tree is too deep for clusters; shadow rays are traced one by one");
        }
        let targets = photon_targets(&settings, scene, &bvh);
        scene_buffers.add_targets(context, &mut staging, &targets)?;
        let [width, height] = camera.resolution;
        let slots = EyePlan::new(&settings, scene_buffers.ideal, width * height).components;
        if u64::from(width * height) * u64::from(slots) > MAX_PIXELS {
            return Err(Error::Setting {
                name: "--resolution",
                message: format!(
                    "{width}x{height} has more than {} pixels, too many to see glass in two ways; use --no-split",
                    MAX_PIXELS / 2
                ),
            });
        }
        let frame =
            Frame::new(context, &kernels, &mut staging, &scene_buffers, &settings, &lights, &delta, camera.resolution)?;
        let parameters = ParameterSource {
            photons: PhotonPlan::new(&settings, targets.spheres.len() as u32),
            settings,
            camera,
            lights,
            nodes: bvh.node_count(),
            emitters: emitters.list.len() as u32,
            diagonal: bvh.diagonal(),
            bounds: (bvh.min, bvh.max),
            coordinate_scale: bvh.scale(),
        };
        Ok(Engine {
            context: context.clone(),
            kernels,
            scene_buffers,
            staging: Some(staging),
            frame,
            parameters,
            targets,
            delta,
            bvh,
            emitters,
            passes: 0,
            set_up: false,
            upload: false,
            clear: false,
        })
    }

    /// Records the uploads, the clearing of the sums and the image's layout. The passes may follow in the same command
    /// buffer.
    pub fn record_setup(&mut self, rec: &mut Recorder) -> Result<()> {
        rec.begin();
        if let Some(staging) = &self.staging {
            staging.record(rec)?;
        }
        self.frame.record_clear(rec)?;
        self.passes = 0;
        (self.set_up, self.upload, self.clear) = (true, false, false);
        Ok(())
    }

    /// Frees the memory that uploads read from: those of [`Engine::record_setup`], or of the first pass after
    /// [`Engine::set_rounds`]. To be called once they have been recorded; what is in flight is kept by its `Retained`.
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
        let parameters = self.parameters.frame(self.passes)?;
        if self.upload || self.clear {
            rec.begin();
        }
        if let (true, Some(staging)) = (self.upload, &self.staging) {
            staging.record(rec)?;
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

    /// Looks from another camera of the same resolution, and starts over. Takes effect with the next pass; commands
    /// recorded before keep the camera they were recorded with.
    pub fn set_camera(&mut self, camera: Camera) -> Result<()> {
        check_camera(&camera)?;
        let [width, height] = self.parameters.camera.resolution;
        if camera.resolution != [width, height] {
            return Err(Error::Setting {
                name: "--resolution",
                message: format!("the engine was made for {width}x{height}; make another one for another size"),
            });
        }
        self.parameters.camera = camera;
        self.restart();
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
        let mut staging = Staging::new();
        self.frame = Frame::with_film(
            &self.context,
            &self.kernels,
            &mut staging,
            &self.scene_buffers,
            &settings,
            &self.parameters.lights,
            &self.delta,
            (self.frame.film.clone(), self.frame.image.clone()),
        )?;
        self.staging = Some(staging);
        self.upload = true;
        self.parameters.settings = settings;
        Ok(())
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

    /// The lights lit once in each pass.
    pub fn delta_lights(&self) -> &[PointLight] {
        &self.delta
    }
}

/// What photons are shot at; nothing unless there are photons.
fn photon_targets(settings: &Settings, scene: &Scene, bvh: &Bvh) -> Targets {
    if settings.photons > 0 { Targets::of(scene, bvh) } else { Targets::default() }
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
