//! A scene that is being viewed: its engine, which records into the window's command buffers, and the state that the user changes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec2, Vec3};
use lightsum::cluster::{Edit, Edits, PassPoints};
use lightsum::gpu::{Buffer, Context, Image, Memory, Recorder};
use lightsum::output::{Encoding, Tonemap, Wanted};
use lightsum::pass::display::{Curve, Display};
use lightsum::pass::layer::{Layer, ShowLayer};
use lightsum::pass::layout::PointLight;
use lightsum::plan::trace_steps;
use lightsum::scene::path::Pose;
use lightsum::scene::{self, Camera, Light, Scene};
use lightsum::settings::{Exposure, Settings};
use lightsum::standalone::{self, MAX_ROUNDS};
use lightsum::{Engine, Error, Result};

use super::navigate::{self, Mode};
use super::overlay::{self, Kernel};
use super::route::{Placed, Route};
use crate::args::View;
use crate::render::{Job, metadata, moving_settings, pipeline_cache};
use crate::{camera, effect};

/// Size of the image unless flags say otherwise.
pub const SIZE: [u32; 2] = [640, 480];
/// Name of the scope around all of a frame's GPU passes.
pub const WHOLE: &str = "frame";

/// How the image is shown.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// Exposure, stops.
    pub stops: f32,
    /// The exposure is to be set by the next image.
    pub auto: bool,
    /// Tone curve.
    pub tonemap: Tonemap,
    /// A layer in place of the image.
    pub layer: Option<Layer>,
    /// The virtual lights are drawn over it.
    pub lights: bool,
    /// Kernels of mirror images are drawn over it.
    pub kernels: bool,
}

/// A scene and its engine.
pub struct Session {
    /// The scene's name.
    pub name: String,
    /// Its file.
    pub path: PathBuf,
    /// How the camera moves.
    pub mode: Mode,
    /// The camera that the scene was opened with.
    pub home: Camera,
    /// The objects that were moved.
    pub placed: BTreeMap<u32, Placed>,
    /// The keys recorded so far.
    pub route: Route,
    /// The latest change of each thing; those of camera and settings from the start.
    pub edits: Edits,
    engine: Engine,
    /// The scene, where it cannot be edited, since it shows light that was kept.
    still: Option<Scene>,
    /// Size at which the image is shown, and by how much that of the engine is smaller while the camera moves.
    size: [u32; 2],
    coarser: u32,
    /// Settings of the still image.
    settings: Settings,
    /// The object that the user chose.
    chosen: Option<Chosen>,
    origin: DVec3,
    /// Middle of each object's box before it was moved.
    pivots: Vec<Vec3>,
    readback: Buffer,
    /// Virtual lights of the pass in flight, and those of the one before.
    lights: (Option<Buffer>, Vec<PointLight>),
    /// Kernels of the mirror images of the pass in flight, and those of the one before.
    kernels: (Option<[Buffer; 2]>, Vec<Kernel>),
    set_up: bool,
    /// Pass in flight, whose count of lost rays will be read.
    pending: Option<u32>,
    display: Option<Display>,
    layer: Option<(Layer, ShowLayer)>,
}

/// An object that the user chose.
pub struct Chosen {
    /// Its index.
    pub object: u32,
    /// Its materials.
    pub materials: Vec<u32>,
    vertices: Vec<u32>,
}

/// Corners of the boxes of a scene's objects.
fn boxes(scene: &Scene) -> Vec<(Vec3, Vec3)> {
    let mut boxes = vec![(Vec3::INFINITY, Vec3::NEG_INFINITY); scene.objects.len()];
    for triangle in &scene.triangles {
        let (low, high) = &mut boxes[triangle.object as usize];
        for vertex in triangle.vertices {
            let position = scene.positions[vertex as usize];
            (*low, *high) = (low.min(position), high.max(position));
        }
    }
    boxes
}

/// A pass of a frame.
pub enum Pass<'a> {
    /// The frame has none.
    None,
    /// By this process alone.
    Own,
    /// Of points that others have shaded.
    Of(&'a mut PassPoints),
}

/// Loads a scene, for an image of this size; `None`: the size that flags name, or that of a window.
pub fn prepare(path: &Path, args: &View, size: Option<[u32; 2]>) -> Result<(Scene, Camera, Settings)> {
    let mut scene = scene::load_with(path, &args.shown.reading.options())?;
    args.shown.keys.override_scene(&mut scene, "view")?;
    args.shown.kept.read(&mut scene)?;
    let camera = camera::choose(&scene, &args.shown.camera, size.or(args.shown.resolution).or(Some(SIZE)))?;
    let settings = moving_settings(&scene.render, camera.resolution)?;
    Ok((scene, camera, settings))
}

impl Session {
    /// Loads a scene and makes its engine on a lent device, for an image of this size, as [`prepare`] does. `measured`: with the faster traversal
    /// kernel where flags leave it open.
    pub fn open(
        context: &Context,
        path: &Path,
        args: &View,
        size: Option<[u32; 2]>,
        measured: bool,
    ) -> Result<Session> {
        let (mut scene, camera, settings) = prepare(path, args, size)?;
        effect::warn(&args.shown.keys.typed(), &settings, &scene);
        let cache = pipeline_cache().filter(|_| measured);
        let settings = standalone::with_traversal(context, settings, cache.as_deref())?;
        let (name, origin) = (scene.name.clone(), scene.origin);
        let middle = |(low, high): (Vec3, Vec3)| if low.cmple(high).all() { 0.5 * (low + high) } else { Vec3::ZERO };
        let pivots = boxes(&scene).into_iter().map(middle).collect();
        let (engine, still) = match scene.kept_light {
            None => (Engine::new_dynamic(context, scene, camera, settings)?, None),
            Some(_) => {
                let engine = Engine::new(context, &scene, camera, settings)?;
                // The engine has what is shown.
                scene.textures = Vec::new();
                (engine, Some(scene))
            }
        };
        let still_settings = engine.settings().clone();
        let mut edits = Edits::default();
        edits.add(Edit::Camera(camera));
        edits.add(Edit::Settings(Box::new(engine.settings().clone())));
        Ok(Session {
            name,
            edits,
            path: path.to_path_buf(),
            mode: Mode::default(),
            home: camera,
            chosen: None,
            placed: BTreeMap::new(),
            route: Route::default(),
            engine,
            still,
            size: camera.resolution,
            coarser: 1,
            settings: still_settings,
            origin,
            pivots,
            readback: Buffer::new(context, "lost rays", 16, Memory::Readback)?,
            lights: (None, Vec::new()),
            kernels: (None, Vec::new()),
            set_up: false,
            pending: None,
            display: None,
            layer: None,
        })
    }

    /// The engine.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// The scene as it is now.
    pub fn scene(&self) -> Option<&Scene> {
        self.engine.scene().or(self.still.as_ref())
    }

    /// The scene as it is now, if it can be edited.
    pub fn editable(&self) -> Option<&Scene> {
        self.engine.scene()
    }

    /// The camera, of the size at which the image is shown.
    pub fn camera(&self) -> Camera {
        Camera { resolution: self.size, ..self.rendered() }
    }

    /// The camera of the size at which the image is rendered.
    fn rendered(&self) -> Camera {
        // The view is always that of a camera.
        self.engine.view().camera().copied().unwrap_or(self.home)
    }

    /// Exposure that flags or the scene name.
    pub fn exposure(&self, args: &View) -> Exposure {
        args.shown.exposure.or(self.scene().and_then(|scene| scene.render.exposure)).unwrap_or_default()
    }

    /// Moves the camera; one that cannot see is left out.
    pub fn set_camera(&mut self, camera: Camera) -> Result<()> {
        if camera.check().is_err() {
            return Ok(());
        }
        let camera = Camera { resolution: self.rendered().resolution, ..camera };
        self.engine.set_camera(camera)?;
        self.edits.add(Edit::Camera(camera));
        Ok(())
    }

    /// Changes the size at which the image is shown, and renders it smaller by a factor. Returns whether anything changed.
    pub fn resize(&mut self, size: [u32; 2], coarser: u32) -> Result<bool> {
        let rendered = size.map(|n| n.div_ceil(coarser));
        let changes = rendered != self.engine.view().size();
        if changes {
            self.engine.resize(rendered)?;
            self.edits.add(Edit::Camera(self.rendered()));
        }
        (self.size, self.coarser) = (size, coarser);
        Ok(changes)
    }

    /// Lights the next images at this rate, or that of the still image if it is higher; `None`: at that.
    pub fn light_at(&mut self, rate: Option<u32>) -> Result<()> {
        let still = self.settings.shading_rate;
        let shading_rate = rate.map_or(still, |rate| rate.max(still));
        if self.engine.settings().shading_rate == shading_rate {
            return Ok(());
        }
        // Rays may have been given more rounds.
        let rounds = self.engine.settings().rounds.max(self.settings.rounds);
        self.apply(Settings { shading_rate, rounds, ..self.settings.clone() })
    }

    /// Whether the image is rendered smaller than it is shown, or fewer points are lit than in the still image.
    pub fn is_coarse(&self) -> bool {
        self.coarser > 1 || self.engine.settings().shading_rate > self.settings.shading_rate
    }

    /// The settings of the still image.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Changes the settings.
    pub fn set_settings(&mut self, settings: Settings) -> Result<()> {
        self.apply(settings.clone())?;
        self.settings = settings;
        Ok(())
    }

    fn apply(&mut self, settings: Settings) -> Result<()> {
        self.layer = None;
        self.engine.set_settings(settings)?;
        self.edits.add(Edit::Settings(Box::new(self.engine.settings().clone())));
        Ok(())
    }

    /// The object under a point of the image, in pixels, and the point of it that is seen.
    pub fn pick(&self, at: Vec2) -> Option<(u32, Vec3)> {
        let hit = self.engine.bvh().closest(&navigate::ray(&self.camera(), at.to_array()))?;
        let triangle = self.engine.bvh().scene_triangle(hit.triangle);
        let object = self.editable()?.triangles.get(triangle as usize)?.object;
        Some((object, self.engine.bvh().position(&hit)))
    }

    /// Where an object is.
    pub fn placed(&self, object: u32) -> Placed {
        let still = Placed {
            axis: self.home.up.normalize(),
            pivot: self.pivots.get(object as usize).copied().unwrap_or_default(),
            pose: Pose::default(),
        };
        self.placed.get(&object).copied().unwrap_or(still)
    }

    /// Moves an object.
    pub fn place(&mut self, object: u32, placed: Placed) -> Result<()> {
        let transform = placed.pose.transform(placed.axis, placed.pivot);
        self.engine.set_transform(object, transform)?;
        self.edits.add(Edit::Object(object, transform));
        self.placed.insert(object, placed);
        Ok(())
    }

    /// Changes a light without area.
    pub fn set_light(&mut self, index: u32, light: Light) -> Result<()> {
        self.engine.set_light(index, light)?;
        self.edits.add(Edit::Light(index, light));
        Ok(())
    }

    /// Changes a material.
    pub fn set_material(&mut self, index: u32, material: scene::Material) -> Result<()> {
        self.engine.set_material(index, material.clone())?;
        self.edits.add(Edit::Material(index, Box::new(material)));
        Ok(())
    }

    /// The object that the user chose.
    pub fn chosen(&self) -> Option<&Chosen> {
        self.chosen.as_ref()
    }

    /// Chooses an object, or none.
    pub fn choose(&mut self, object: Option<u32>) {
        let of = |object: u32| {
            let all = self.scene().map(|scene| scene.triangles.as_slice()).unwrap_or_default();
            let own = || all.iter().filter(|triangle| triangle.object == object);
            let materials = BTreeSet::from_iter(own().map(|triangle| triangle.material)).into_iter().collect();
            let vertices = BTreeSet::from_iter(own().flat_map(|triangle| triangle.vertices)).into_iter().collect();
            Chosen { object, materials, vertices }
        };
        self.chosen = object.map(of);
    }

    /// The corners of the chosen object's box.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let scene = self.scene()?;
        let vertices = self.chosen.as_ref()?.vertices.iter().map(|&vertex| scene.positions[vertex as usize]);
        vertices
            .fold(None, |bounds, p| Some(bounds.map_or((p, p), |(low, high): (Vec3, Vec3)| (low.min(p), high.max(p)))))
    }

    /// Starts the image over.
    pub fn restart(&mut self) {
        self.engine.restart();
    }

    /// Whether the image may take another pass.
    pub fn wants_pass(&self, limit: u32) -> bool {
        self.engine.passes_unchanged() < limit
    }

    /// Why the pixels of a pass cannot be shaded by others, if there is a reason.
    pub fn stands_alone(&self, look: &Look) -> Option<String> {
        if look.lights {
            return Some(String::from("its virtual lights are drawn over the image"));
        }
        let plan = self.engine.plan();
        plan.view.check_tasks(&plan.settings).err().map(|error| match error {
            Error::Setting { message, .. } => message,
            error => error.to_string(),
        })
    }

    /// Records a pass, if there is one, and what is shown; returns that.
    pub fn record(&mut self, rec: &mut Recorder, look: &Look, pass: Pass) -> Result<Image> {
        let before = self.engine.passes();
        let mut shown = Err(Error::Interrupted);
        let outcome = rec.scope(WHOLE, |rec| {
            shown = self.record_all(rec, look, pass);
            Ok(())
        });
        let shown = outcome.and(shown);
        if shown.is_err() {
            // Nothing of this will be submitted.
            self.pending = None;
            self.set_up = false;
            self.display = None;
            self.layer = None;
            self.engine.set_passes(before);
            self.engine.upload_again();
        }
        shown
    }

    fn record_all(&mut self, rec: &mut Recorder, look: &Look, pass: Pass) -> Result<Image> {
        if !self.set_up {
            self.engine.record_setup(rec)?;
            self.set_up = true;
        }
        let has_pass = !matches!(pass, Pass::None);
        if has_pass {
            self.pending = Some(self.engine.passes());
            match pass {
                Pass::Of(points) => self.engine.record_pass_from(rec, points)?,
                _ => self.engine.record_pass(rec)?,
            }
            rec.copy_range(&self.engine.frame().status, 0, &self.readback, 0, self.readback.bytes())?;
        }
        self.record_lights(rec, look.lights)?;
        self.record_kernels(rec, look.kernels)?;
        let (context, image) = (self.engine.context().clone(), self.engine.image().clone());
        let is_new = !self.display.as_ref().is_some_and(|display| display.is_of(&image));
        if has_pass || is_new {
            self.engine.record_image(rec)?;
        }
        let (stops, source) = match look.layer.filter(|layer| self.shows(*layer)) {
            None => (look.stops, image),
            Some(wanted) => {
                let size = [image.width(), image.height()];
                let fits = |(layer, show): &(Layer, ShowLayer)| {
                    *layer == wanted && [show.image.width(), show.image.height()] == size
                };
                if !self.layer.as_ref().is_some_and(fits) {
                    let show = ShowLayer::new(&context, self.engine.film(), size, wanted)?;
                    self.layer = Some((wanted, show));
                }
                let camera = self.camera();
                let Some((_, show)) = &mut self.layer else { return Ok(image) };
                show.record(rec, (camera.target - camera.eye).length(), self.engine.plan().settings.pattern)?;
                (if wanted.is_light() { look.stops } else { 0.0 }, show.image.clone())
            }
        };
        let curve = look.layer.map_or(Curve::Tone(look.tonemap), |layer| layer.curve(look.tonemap));
        if !self.display.as_ref().is_some_and(|display| display.is_of(&source)) {
            self.display = Some(Display::new(&context, &source)?);
        }
        let Some(display) = &mut self.display else { return Ok(source) };
        display.record(rec, stops, curve)?;
        Ok(display.shown.clone())
    }

    /// Whether a layer can be shown as things are: summands need sums of their own, and clusters the order of the screen.
    pub fn shows(&self, layer: Layer) -> bool {
        match layer {
            Layer::Clusters => self.engine.frame().eye.clusters.is_some(),
            layer => !layer.is_summand() || self.engine.settings().summands,
        }
    }

    /// Copies the virtual lights of the latest pass, if they are wanted.
    fn record_lights(&mut self, rec: &mut Recorder, wanted: bool) -> Result<()> {
        let lights = self.engine.frame().lights();
        let buffer = match self.lights.0.take().filter(|buffer| buffer.bytes() == lights.bytes()) {
            _ if !wanted || self.engine.passes() == 0 => return Ok(()),
            Some(buffer) => buffer,
            None => Buffer::new(self.engine.context(), "virtual lights read back", lights.bytes(), Memory::Readback)?,
        };
        rec.copy(lights, &buffer)?;
        self.lights.0 = Some(buffer);
        Ok(())
    }

    /// Virtual lights of the latest pass, if they are wanted; some emit nothing.
    pub fn lights(&self) -> &[PointLight] {
        &self.lights.1
    }

    /// Whether mirror images are spread by kernels.
    pub fn has_kernels(&self) -> bool {
        self.engine.frame().glossy_planes.is_some()
    }

    /// Copies the kernels of the latest pass, if they are wanted.
    fn record_kernels(&mut self, rec: &mut Recorder, wanted: bool) -> Result<()> {
        let old = self.kernels.0.take();
        let Some(planes) = self.engine.frame().glossy_planes.as_ref().filter(|_| wanted && self.engine.passes() > 0)
        else {
            return Ok(());
        };
        let sources = [&planes.image.footprint, &self.engine.frame().eye.planes.region];
        let fits = |old: &[Buffer; 2]| [0, 1].iter().all(|&i| old[i].bytes() == sources[i].bytes());
        let new =
            |source: &Buffer| Buffer::new(self.engine.context(), "kernels read back", source.bytes(), Memory::Readback);
        let copies = match old.filter(fits) {
            Some(old) => old,
            None => [new(sources[0])?, new(sources[1])?],
        };
        for (source, copy) in sources.into_iter().zip(&copies) {
            rec.copy(source, copy)?;
        }
        self.kernels.0 = Some(copies);
        Ok(())
    }

    /// Kernels of some pixels of the latest pass, if they are wanted.
    pub fn kernels(&self) -> &[Kernel] {
        &self.kernels.1
    }

    /// After the submission of what was recorded.
    pub fn submitted(&mut self) {
        self.engine.setup_finished();
    }

    /// After the end of a frame: gives rays that were lost more rounds, and repeats their pass. Returns whether a pass was done.
    ///
    /// Errors: rays do not finish in any number of rounds.
    pub fn finished(&mut self) -> Result<bool> {
        self.lights.1 = self.lights.0.as_ref().map_or(Ok(Vec::new()), Buffer::read)?;
        let width = self.engine.view().size()[0] as usize;
        self.kernels.1 = match &self.kernels.0 {
            Some([footprints, regions]) => overlay::kernels(&footprints.read()?, &regions.read()?, width),
            None => Vec::new(),
        };
        let Some(pass) = self.pending.take() else { return Ok(false) };
        let lost = self.readback.read::<u32>()?[0];
        if lost == 0 {
            return Ok(true);
        }
        let rounds = self.engine.settings().rounds;
        if rounds >= MAX_ROUNDS {
            let steps = u64::from(rounds) * u64::from(trace_steps(self.engine.settings().loop_budget));
            return Err(Error::Unfinished { pass: "shade or trace", rays: lost, steps });
        }
        log::info!("{lost} rays ran out of steps in pass {pass}; going on with {} rounds", 4 * rounds);
        if self.engine.passes() == pass + 1 {
            self.engine.set_passes(pass);
        }
        self.engine.set_rounds((4 * rounds).min(MAX_ROUNDS))?;
        Ok(false)
    }

    /// Stops of an exposure for the image so far, which must not be in flight.
    pub fn stops(&self, exposure: Exposure) -> Result<f32> {
        match exposure {
            Exposure::Stops(stops) => Ok(stops),
            Exposure::Auto => Ok(exposure.stops(&self.layers(Wanted::Color)?.color)),
        }
    }

    fn layers(&self, wanted: Wanted) -> Result<lightsum::output::Layers> {
        self.engine.film().mean(self.engine.context(), self.engine.view().size(), wanted)
    }

    /// Writes the image, which must not be in flight, as EXR or PNG.
    pub fn write(&self, path: &Path, look: &Look) -> Result<()> {
        let encoding =
            Encoding { float: false, color_only: false, exposure: Exposure::Stops(look.stops), tonemap: look.tonemap };
        let job = Job {
            name: self.name.clone(),
            camera: self.rendered(),
            origin: self.origin,
            settings: self.settings.clone(),
            outputs: vec![path.to_path_buf()],
            encoding,
            denoise: false,
            crop: None,
            surfaces: false,
            stages: Vec::new(),
        };
        let info = self.engine.context().info();
        let driver = format!("{} {}", info.driver, info.driver_version);
        let mut metadata = metadata(&job, &info.name, driver);
        metadata.passes = self.engine.passes();
        job.write_outputs(&self.layers(job.wanted())?, &metadata)
    }

    /// Writes the recorded path.
    pub fn save_route(&self, path: &Path) -> Result<()> {
        match self.scene() {
            Some(scene) => self.route.save(path, scene),
            None => Ok(()),
        }
    }

    /// Records a key of the path.
    pub fn add_key(&mut self) {
        let camera = self.camera();
        self.route.add(camera, &self.placed);
    }
}
