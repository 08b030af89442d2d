//! The engine: renders a scene on a device, recorded pass by pass into the caller's command buffer.
//!
//! ```text
//! host's device --Context::adopt--> Engine::new(context, scene, camera, settings)
//!     record_setup    once, before the first pass: uploads, cleared sums, the image's layout
//!     record_pass     any number of times; each adds one pass to the sums
//!     record_image    the mean of the passes so far, in Engine::image()
//! ```
//!
//! Guarantees to hosts:
//!
//! - **Nothing is submitted, waited for or read back.** All commands are compute and transfer, outside a render pass.
//! - **Order.** Submit command buffers to one queue, each once, in the order in which they were recorded: the number of
//!   a pass is fixed when it is recorded. A pass that is never submitted is missing from the mean and does no harm,
//!   unless it was the first after a restart or a change of rounds: then make that change again.
//! - **Synchronisation.** Each `record_*` begins with a barrier after all earlier submissions to the queue and ends
//!   with one that makes its results visible to compute, transfer and indirect commands. So several frames may be in
//!   flight, also with other engines on the same queue, and a host needs a barrier of its own only to use the image in
//!   other stages (source: COMPUTE_SHADER, SHADER_WRITE) or on another queue family.
//! - **Lifetime.** The [`Retained`](crate::gpu::Retained) that [`Recorder::finish`](crate::gpu::Recorder::finish) or
//!   [`Context::record_into`] returns holds the resources of the recorded commands. Keep it until they have finished;
//!   the engine itself may be dropped before.
//! - **Changes.** Camera, settings and, for an engine made by [`Engine::new_dynamic`], the scene may change between any
//!   two passes, also while frames are in flight: uploads are recorded at the start of the next pass, from memory that
//!   its `Retained` holds. A change that affects the image restarts the sums; other changes do not. If the first pass
//!   after a change is never submitted, call [`Engine::upload_again`].
//! - **Rings.** With [`Settings::ring`] a change of camera or scene does not restart: the next pass replaces the oldest image or path. A
//!   change of size or settings does.
//! - **Passes left out.** A pass in which a ray ran out of steps, or with a pixel that is no number (NaN, infinite), is left out of the
//!   sums and of the mean; [`Film::counts`] has the number of passes in them, [`Frame::status`] tells why the latest was left out, and
//!   [`Engine::set_rounds`] gives rays more steps.
//!
//! [`Film::counts`]: crate::film::Film::counts

mod buffers;
mod edit;
mod host;
mod objects;
mod shutter;

pub use buffers::{LightLayout, PassBuffers, TreeBuffers, VirtualLights};
pub use edit::EditTimes;
pub use shutter::{PosedObject, ShutterEnd};

use std::sync::Arc;

use crate::accel::Bvh;
use crate::accel::objects::ObjectTrees;
use crate::cluster::PassPoints;
use crate::cluster::points::Taken;
use crate::device_scene::DeviceScene;
use crate::error::{Error, Result};
use crate::film::Film;
use crate::frame::{Frame, Kept};
use crate::gpu::{Context, Image, MemoryUse, Recorder, Staging};
use crate::light::emitters::Emitters;
use crate::pass::TraversalKernels;
use crate::plan::{self, Plan};
use crate::ring::Paths;
use crate::scene::{Camera, Scene};
use crate::settings::{Settings, Traversal};
use crate::stage::Output;
use crate::view::{Atlas, Region, Task, View};

/// A part of a pass.
pub(crate) enum Part<'a> {
    /// All of it.
    Whole,
    /// The shading of the pixels of a task. Nothing is added to the film.
    Points(&'a Task),
    /// The rest, with shaded points from elsewhere.
    Rest(&'a Taken<'a>),
}

/// Renders a scene on a device.
pub struct Engine {
    context: Context,
    scene: DeviceScene,
    plan: Plan,
    frame: Frame,
    /// Memory that uploads read from, until the caller reports that they have finished.
    staging: Option<Staging>,
    /// State for scene edits; `None` if the scene is static.
    dynamic: Option<Box<edit::DynamicScene>>,
    /// Motion while the shutter is open.
    shutter: shutter::Moves,
    passes: u32,
    /// Passes since the image last changed.
    unchanged: u32,
    /// Paths of a ring of lights; empty: all begin with the next pass.
    paths: Paths,
    /// Whether `record_setup` has been recorded.
    set_up: bool,
    /// Whether the next pass records the uploads first.
    upload: bool,
    /// Whether the next pass clears the sums first.
    clear: bool,
    /// Whether the image is new and has no layout yet.
    new_image: bool,
    /// Whether the next pass traces the particles of splats first.
    particles: bool,
}

impl Engine {
    /// Builds the acceleration structure and creates all device resources. Nothing runs on the device yet. The scene is
    /// static; [`Engine::new_dynamic`] makes an engine whose scene may change.
    ///
    /// Errors: camera or settings out of range, a scene without light, resources beyond the device's limits or memory.
    pub fn new(context: &Context, scene: &Scene, camera: Camera, settings: Settings) -> Result<Engine> {
        Self::with_view(context, scene, View::whole(camera), settings)
    }

    /// [`Engine::new`] for a region of a camera's image or for texels on the scene's surfaces.
    pub fn with_view(context: &Context, scene: &Scene, view: View, settings: Settings) -> Result<Engine> {
        Ok(Self::with_trees(context, scene, view, settings, false)?.0)
    }

    /// Memory that [`Engine::with_view`] takes, without taking it: the estimate counts the same buffers and images. Costs the time of an engine
    /// without its kernels. Errors: as [`Engine::with_view`], but that memory does not run out.
    pub fn memory_of(context: &Context, scene: &Scene, view: View, settings: Settings) -> Result<MemoryUse> {
        let measuring = context.measuring();
        // Its objects are counted while they live.
        let _engine = Self::with_trees(&measuring, scene, view, settings, false)?;
        Ok(measuring.memory_use())
    }

    /// `dynamic`: with a hierarchy of objects that can move.
    fn with_trees(
        context: &Context,
        host_scene: &Scene,
        view: View,
        settings: Settings,
        dynamic: bool,
    ) -> Result<(Engine, Option<ObjectTrees>)> {
        settings.validate()?;
        view.check(&settings)?;
        let mut staging = Staging::new();
        let clusters = TraversalKernels::shade(context, settings.traversal, false)?.cluster.is_some();
        let (mut scene, trees) = if dynamic {
            let (scene, trees) = DeviceScene::new_dynamic(context, &mut staging, host_scene, clusters)?;
            (scene, Some(trees))
        } else {
            (DeviceScene::new(context, &mut staging, host_scene, clusters)?, None)
        };
        if scene.wide_nodes.is_none() && clusters {
            if settings.traversal == Traversal::Cluster {
                return Err(Error::Setting {
                    name: "--traversal",
                    message: String::from("the scene's tree is too deep for the cluster kernel's stack; use auto"),
                });
            }
            log::info!("the scene's tree is too deep for clusters; shadow rays are traced one by one");
        }
        if scene.specular.frosted_panes && settings.mirroring_planes() == 0 {
            log::info!("frosted panes are shown clear without --superposition");
        }
        if let Some(splats) = &settings.splats {
            scene.make_surfaces(context, &mut staging, host_scene, splats.alpha)?;
        }
        let plan = plan::derive(&scene, &settings, &view)?;
        let frame = make_frame(context, &mut staging, &mut scene, &plan, None)?;
        let engine = Engine {
            context: context.clone(),
            scene,
            plan,
            frame,
            staging: Some(staging),
            dynamic: None,
            shutter: shutter::Moves::default(),
            passes: 0,
            unchanged: 0,
            paths: Paths::default(),
            set_up: false,
            upload: false,
            clear: false,
            new_image: false,
            particles: true,
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
        self.frame.record_setup(rec)?;
        self.frame.output.record_clear(rec)?;
        rec.image_to_general(self.image())?;
        (self.passes, self.unchanged, self.paths) = (0, 0, Paths::default());
        (self.set_up, self.upload, self.clear, self.new_image) = (true, false, false, false);
        Ok(())
    }

    /// Frees the memory that uploads read from: those of [`Engine::record_setup`], or of the first pass after
    /// [`Engine::set_rounds`] or another change. Call it once they have been recorded; the `Retained` keeps the memory
    /// in flight.
    pub fn setup_finished(&mut self) {
        if self.set_up && !self.upload {
            self.staging = None;
        }
    }

    /// Records the next pass.
    ///
    /// After an error do not submit the command buffer; the engine is unchanged.
    pub fn record_pass(&mut self, rec: &mut Recorder) -> Result<()> {
        self.record_part(rec, &Part::Whole)
    }

    /// [`Engine::record_pass`] with shaded points of all pixels from elsewhere ([`Renderer::points_of`](crate::Renderer::points_of)), which must stay
    /// as they are until the commands have been executed.
    ///
    /// Errors: some points are missing; pixels depend on others ([`View::check_tasks`]).
    pub fn record_pass_from(&mut self, rec: &mut Recorder, points: &mut PassPoints) -> Result<()> {
        self.apply_edits()?;
        self.plan.view.check_tasks(&self.plan.settings)?;
        let taken = points.stage(&self.context, &self.frame)?;
        self.record_part(rec, &Part::Rest(&taken))
    }

    /// [`Engine::record_pass`] for a part of it.
    pub(crate) fn record_part(&mut self, rec: &mut Recorder, part: &Part) -> Result<()> {
        if !self.set_up {
            return Err(Error::Resource {
                name: String::from("engine"),
                message: String::from("a pass is recorded before record_setup; record that first"),
            });
        }
        self.apply_edits()?;
        let parameters = self.plan.parameters_of(self.passes, self.paths == Paths::default())?;
        let mut paths = self.paths.clone();
        if self.plan.settings.ring.is_some() {
            paths.begin(&parameters);
        }
        let texels = self.frame.eye.stage_texels(&self.context, &self.plan.view, self.passes)?;
        if self.upload || self.clear || texels.is_some() {
            rec.begin();
        }
        self.record_uploads(rec)?;
        if let Some(staging) = &texels {
            rec.scope("texels", |rec| staging.record(rec))?;
        }
        if self.new_image {
            rec.image_to_general(self.image())?;
        }
        if self.clear {
            self.frame.output.record_clear(rec)?;
        }
        if self.particles && self.frame.splats.is_some() {
            self.frame.record_particles(rec, &self.plan.parameters_of(0, true)?)?;
        }
        match part {
            Part::Whole => self.frame.record(rec, &parameters, &paths)?,
            Part::Points(task) => self.frame.record_task(rec, &parameters.of_task(task), &paths)?,
            Part::Rest(points) => self.frame.record_taken(rec, &parameters, points)?,
        }
        self.passes += 1;
        self.unchanged += 1;
        self.paths = paths;
        (self.upload, self.clear, self.new_image, self.particles) = (false, false, false, false);
        Ok(())
    }

    /// Records the uploads that wait.
    fn record_uploads(&self, rec: &mut Recorder) -> Result<()> {
        if let (true, Some(staging)) = (self.upload, &self.staging) {
            rec.scope("upload", |rec| staging.record(rec))?;
            self.frame.record_setup(rec)?;
        }
        Ok(())
    }

    /// Records the mean of the passes so far into [`Engine::image`]; black before the first, and before the first in another size.
    ///
    /// The image stays in layout GENERAL, written by compute shaders; the recorder's barrier makes it visible to later
    /// transfer and compute commands of the queue.
    pub fn record_image(&self, rec: &mut Recorder) -> Result<()> {
        rec.begin();
        if self.new_image {
            // The sums are as new, and hold anything until the next pass clears them.
            self.frame.output.record_clear(rec)?;
            rec.image_to_general(self.image())?;
        }
        self.frame.output.record_resolve(rec)
    }

    /// Linear radiance, Rec. 709, RGBA 32-bit float; alpha is coverage. Layout GENERAL from [`Engine::record_setup`]
    /// on; keep this layout, or restore it before the next [`Engine::record_image`]. Usage: storage, sampled, transfer
    /// source.
    pub fn image(&self) -> &Image {
        &self.frame.output.image
    }

    /// Passes recorded since the sums were cleared.
    pub fn passes(&self) -> u32 {
        self.passes
    }

    /// Passes recorded since camera or scene changed. In a ring, which goes on through changes, fewer than [`Engine::passes`].
    pub fn passes_unchanged(&self) -> u32 {
        self.unchanged
    }

    /// Sets the number of passes, for a caller that has restored the sums of `passes` passes, or to repeat a failed
    /// pass. Before pass 0 the sums are cleared.
    pub fn set_passes(&mut self, passes: u32) {
        self.passes = passes;
        self.unchanged = self.unchanged.min(passes);
        // Rays of the paths that began may be among those lost.
        self.paths = Paths::default();
        self.clear = passes == 0;
        // The pass that failed may have been the one that traced them.
        self.particles = true;
    }

    /// Sets the number of the next pass and keeps the sums, whatever passes they have: for parts of a rendering that are merged.
    /// `again`: the last pass failed.
    pub(crate) fn seek(&mut self, pass: u32, again: bool) {
        self.passes = pass;
        self.paths = Paths::default();
        self.particles |= again;
    }

    /// Changes to a camera of the same resolution, and restarts if it differs, unless a ring goes on. Takes effect with the next pass; commands
    /// recorded earlier keep their camera. A change between pinhole and lens makes new passes. A region of the image
    /// stays the same region.
    pub fn set_camera(&mut self, camera: Camera) -> Result<()> {
        let Region { size: [width, height], .. } = self.plan.view.within();
        if camera.resolution != [width, height] {
            return Err(Error::Setting {
                name: "--resolution",
                message: format!("the engine renders {width}x{height}; use Engine::resize for another size"),
            });
        }
        self.set_view(self.plan.view.with_camera(camera))
    }

    /// Changes the image size from the next pass on, and restarts. The camera keeps its vertical angle of view. Buffers
    /// of the image's size are made anew, and so is [`Engine::image`]; the tree, the scene's buffers and the pipelines
    /// stay.
    ///
    /// Errors, which leave everything unchanged: a size out of range or beyond the device's limits; the view is an
    /// atlas.
    pub fn resize(&mut self, resolution: [u32; 2]) -> Result<()> {
        let Some(camera) = self.plan.view.camera() else {
            return Err(Error::Setting {
                name: "--resolution",
                message: String::from("an atlas has no camera; set another view"),
            });
        };
        self.set_view(match self.plan.view {
            View::GBuffer { .. } => View::GBuffer { camera: Camera { resolution, ..*camera } },
            _ => View::whole(Camera { resolution, ..*camera }),
        })
    }

    /// Changes the view, as [`Engine::set_camera`] and [`Engine::resize`] do: to another camera, another region of its
    /// image, or an atlas.
    pub fn set_view(&mut self, view: View) -> Result<()> {
        if view == self.plan.view {
            return Ok(());
        }
        let plan = plan::derive(&self.scene, &self.plan.asked, &view)?;
        let same_size = view.size() == self.plan.view.size();
        let same_projection = view.is_orthographic() == self.plan.view.is_orthographic();
        self.set_plan(plan)?;
        if !same_projection {
            self.shutter.ends = None;
        }
        self.shutter.staged = false;
        if same_size {
            self.changed();
        } else {
            self.restart();
        }
        Ok(())
    }

    /// Restricts the view to the whole blocks of pixels around a region of the camera's image ([`Region::around`]);
    /// `None`: shows the whole image.
    pub fn set_region(&mut self, region: Option<Region>) -> Result<()> {
        let Some(&camera) = self.plan.view.camera() else {
            return Err(Error::Setting { name: "--crop", message: String::from("an atlas has no camera") });
        };
        if self.plan.view.is_g_buffer() {
            let message = String::from("a G-buffer of the host is lit as a whole; set another view");
            return Err(Error::Setting { name: "--crop", message });
        }
        let whole = Region::whole(camera.resolution);
        let region = region.map_or(whole, |region| region.around(&self.plan.settings, camera.resolution));
        self.set_view(View::Camera { camera, region })
    }

    /// Changes the view to texels on surfaces. An error if the scene may change, since texels are bound to its
    /// triangles.
    pub fn set_atlas(&mut self, atlas: Arc<Atlas>) -> Result<()> {
        if self.dynamic.is_some() {
            return Err(Error::Setting {
                name: "view",
                message: String::from("texels of an atlas stay where they are; make the engine by Engine::new"),
            });
        }
        self.set_view(View::Atlas(atlas))
    }

    /// Restarts: the next pass clears the sums and is pass 0; a ring is emptied. Until then the image keeps its content.
    pub fn restart(&mut self) {
        (self.passes, self.unchanged, self.paths) = (0, 0, Paths::default());
        self.clear = true;
    }

    /// After a change of camera or scene: restarts, unless a ring goes on.
    fn changed(&mut self) {
        self.unchanged = 0;
        if self.plan.settings.ring.is_none() {
            self.restart();
        }
    }

    /// Gives rays more rounds, from the next pass on. Keeps the sums of earlier passes.
    pub fn set_rounds(&mut self, rounds: u32) -> Result<()> {
        let settings = Settings { rounds, ..self.plan.settings.clone() };
        let asked = Settings { rounds, ..self.plan.asked.clone() };
        settings.validate()?;
        if !self.set_up {
            return Err(Error::Resource {
                name: String::from("engine"),
                message: String::from("rounds are changed before record_setup; set them in Settings"),
            });
        }
        self.set_plan(Plan { asked, settings, ..self.plan.clone() })
    }

    /// Changes the settings from the next pass on, and restarts if they change the result of a pass. Settings that only
    /// affect uniforms (seed, clipping distance, jitter, light threshold, light floor, photon radius) cost nothing;
    /// others make new passes and buffers, which takes milliseconds and, while frames are in flight, the memory of
    /// both. The image keeps its content until the next pass.
    ///
    /// Errors, which leave everything unchanged: settings out of range; a different `traversal`, which is fixed when
    /// the engine is made.
    pub fn set_settings(&mut self, settings: Settings) -> Result<()> {
        settings.validate()?;
        let old = &self.plan.asked;
        if settings.traversal != old.traversal {
            return Err(Error::Setting {
                name: "--traversal",
                message: String::from("it is chosen when the engine is made; make another one for another traversal"),
            });
        }
        if settings == *old {
            return Ok(());
        }
        let same_image = Settings { rounds: old.rounds, moving_passes: old.moving_passes, ..settings.clone() } == *old;
        let plan = plan::derive(&self.scene, &settings, &self.plan.view)?;
        self.set_plan(plan)?;
        if !same_image {
            self.restart();
        }
        Ok(())
    }

    /// Switches to another plan: keeps the passes if they fit, else makes new ones, which keep the film and the image
    /// if these fit. Uploads are recorded with the next pass.
    fn set_plan(&mut self, plan: Plan) -> Result<()> {
        if !plan.fits_frame_of(&self.plan) {
            self.make_frame(&plan)?;
        }
        self.plan = plan;
        Ok(())
    }

    fn make_frame(&mut self, plan: &Plan) -> Result<()> {
        let output = &self.frame.output;
        let same_size = plan.view.size() == [output.image.width(), output.image.height()];
        let kept = same_size.then(|| self.kept());
        let mut staging = self.take_staging();
        let frame = make_frame(&self.context, &mut staging, &mut self.scene, plan, kept);
        // Data staged earlier must be uploaded whether or not there are new passes.
        self.keep_staging(staging);
        self.take_frame(frame?);
        self.new_image |= !same_size;
        Ok(())
    }

    /// The buffers that a new frame of the same size goes on with.
    fn kept(&self) -> Kept {
        let Output { film, image, .. } = &self.frame.output;
        let lights = (self.paths != Paths::default()).then(|| self.frame.lights().clone());
        Kept { film: film.clone(), image: image.clone(), lights }
    }

    fn take_frame(&mut self, frame: Frame) {
        if !frame.walk.keeps {
            self.paths = Paths::default();
        }
        self.shutter.staged = false;
        self.frame = frame;
        self.particles = true;
    }

    /// Takes the uploads that have not been recorded yet, to add to them.
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
    pub fn device_scene(&self) -> &DeviceScene {
        &self.scene
    }

    /// Settings, view, and everything derived from them.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The settings, as asked for; [`Plan::settings`] has what a ring makes of them.
    pub fn settings(&self) -> &Settings {
        let Plan { asked, .. } = &self.plan;
        asked
    }

    /// The view.
    pub fn view(&self) -> &View {
        &self.plan.view
    }

    /// The running sums.
    pub fn film(&self) -> &Film {
        &self.frame.output.film
    }

    /// The acceleration structure.
    pub fn bvh(&self) -> &Bvh {
        &self.scene.bvh
    }

    /// The emitters.
    pub fn emitters(&self) -> &Emitters {
        &self.scene.emitters
    }
}

/// Makes the frame of a plan with its pipelines, and the tables that it needs.
fn make_frame(
    context: &Context,
    staging: &mut Staging,
    scene: &mut DeviceScene,
    plan: &Plan,
    kept: Option<Kept>,
) -> Result<Frame> {
    if plan.eye.mirrors {
        scene.make_tables(context, staging)?;
    }
    let frame = Frame::new(context, staging, scene, plan, kept)?;
    context.make_pipelines()?;
    match context.compile_ahead() {
        Ok(compiled) => log::info!("{compiled} kernels compiled ahead"),
        // The first pass compiles them.
        Err(error) => log::warn!("kernels are not compiled ahead: {error}"),
    }
    Ok(frame)
}
