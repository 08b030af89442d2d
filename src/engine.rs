//! The engine: a scene on a device, recorded pass by pass into the caller's command buffer.
//!
//! ```text
//! host's device --Context::adopt--> Engine::new(context, scene, camera, settings)
//!     record_setup(command buffer)    once, before the first frame: uploads and cleared sums
//!     record_pass(command buffer)     any number of times; each adds one pass to the image
//!     record_image(command buffer)    the mean of the passes so far, in Engine::image()
//! ```
//!
//! The engine never submits, never waits and never reads back. All its commands are compute and transfer; a frame begins with a
//! barrier after everything submitted to the queue before, so frames may be in flight one behind the other on one queue. What
//! the command buffers use is kept alive by the engine: drop it after they have finished.

use crate::accel::Bvh;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::gpu::{Context, Image, Recorder, Staging};
use crate::light::emitters::Emitters;
use crate::pass::Kernels;
use crate::pass::layout::PointLight;
use crate::plan::{LightPlan, ParameterSource};
use crate::scene::{Camera, Scene};
use crate::scene_buffers::{SceneBuffers, delta_lights};
use crate::settings::Settings;

/// Greatest number of pixels: four-channel float arrays of this many fit every limit that Vulkan guarantees here.
const MAX_PIXELS: u64 = 1 << 26;

/// A scene ready to be rendered on a device.
pub struct Engine {
    context: Context,
    kernels: Kernels,
    scene_buffers: SceneBuffers,
    staging: Option<Staging>,
    frame: Frame,
    parameters: ParameterSource,
    delta: Vec<PointLight>,
    bvh: Bvh,
    emitters: Emitters,
    passes: u32,
}

impl Engine {
    /// Builds the acceleration structure and creates all device resources. Nothing runs on the device yet.
    ///
    /// Errors: settings out of range, a scene without light, resources beyond the device's limits or memory.
    pub fn new(context: &Context, scene: &Scene, camera: Camera, settings: Settings) -> Result<Engine> {
        settings.validate()?;
        let [width, height] = camera.resolution;
        if width == 0 || height == 0 || u64::from(width) * u64::from(height) > MAX_PIXELS {
            return Err(Error::Setting {
                name: "--resolution",
                message: format!("{width}x{height} is empty or has more than {MAX_PIXELS} pixels"),
            });
        }
        let bvh = Bvh::build(scene)?;
        let emitters = Emitters::of(scene, scene.emitters_are_lights)?;
        let delta = delta_lights(scene, bvh.scale());
        let lights = LightPlan::new(&settings, scene.mean_reflectivity(), delta.len() as u32);
        let kernels = Kernels::new(context)?;
        let mut staging = Staging::new();
        let scene_buffers = SceneBuffers::new(context, &mut staging, scene, &bvh, &emitters)?;
        let frame =
            Frame::new(context, &kernels, &mut staging, &scene_buffers, &settings, &lights, &delta, camera.resolution)?;
        let parameters = ParameterSource {
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
            delta,
            bvh,
            emitters,
            passes: 0,
        })
    }

    /// Records uploads and the first clearing of the sums. Its command buffer must be submitted before those of the passes.
    pub fn record_setup(&mut self, rec: &mut Recorder) -> Result<()> {
        if let Some(staging) = &self.staging {
            staging.record(rec)?;
        }
        self.passes = 0;
        self.frame.record_clear(rec)
    }

    /// Frees the memory that the uploads of [`Engine::record_setup`] read from. Call it when they have finished.
    pub fn setup_finished(&mut self) {
        self.staging = None;
    }

    /// Records the next pass.
    pub fn record_pass(&mut self, rec: &mut Recorder) -> Result<()> {
        let parameters = self.parameters.frame(self.passes)?;
        self.frame.record(rec, &parameters)?;
        self.passes += 1;
        Ok(())
    }

    /// Records the mean of the passes recorded so far into [`Engine::image`].
    ///
    /// The image is left in layout GENERAL, written by compute shaders; the recorder's barrier makes it visible to later transfer and
    /// compute commands of the queue.
    pub fn record_image(&self, rec: &mut Recorder) -> Result<()> {
        self.frame.record_resolve(rec)
    }

    /// Linear radiance, Rec. 709, RGBA 32-bit float; alpha is coverage. Layout GENERAL from [`Engine::record_setup`] on.
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

    /// Gives rays more rounds. What the passes have summed up is kept.
    pub fn set_rounds(&mut self, rounds: u32) -> Result<()> {
        let settings = Settings { rounds, ..self.parameters.settings.clone() };
        settings.validate()?;
        let mut staging = Staging::new();
        let film = self.frame.film.clone();
        let image = self.frame.image.clone();
        self.frame = Frame::with_film(
            &self.context,
            &self.kernels,
            &mut staging,
            &self.scene_buffers,
            &settings,
            &self.parameters.lights,
            &self.delta,
            (film, image),
        )?;
        self.staging = Some(staging);
        self.parameters.settings = settings;
        Ok(())
    }

    /// Records the uploads of [`Engine::set_rounds`].
    pub fn record_uploads(&self, rec: &mut Recorder) -> Result<()> {
        match &self.staging {
            Some(staging) => staging.record(rec),
            None => Ok(()),
        }
    }

    /// The device.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// The passes and their buffers, for tests and tools.
    pub fn frame(&self) -> &Frame {
        &self.frame
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

    /// The lights lit once in each pass.
    pub fn delta_lights(&self) -> &[PointLight] {
        &self.delta
    }
}
