//! Rendering without a host: a device of its own, one pass at a time, submitted and waited for. The command line uses
//! it.

mod passes;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

#[cfg(feature = "images")]
use glam::Vec3;

use crate::calibrate;
use crate::engine::{Engine, PosedObject, ShutterEnd};
use crate::error::{Error, Result};
use crate::estimate::History;
use crate::film::HostFilm;
use crate::fingerprint::{Fnv, fingerprint};
use crate::gpu::{Buffer, Context, ContextOptions, DeviceChoice, Timers, download};
#[cfg(feature = "images")]
use crate::light::cosine::exitance;
use crate::output::{Layers, Provenance, Statistics, Wanted};
use crate::pass::layout::PointLight;
use crate::pass::probe;
use crate::scene::{Camera, Scene};
#[cfg(feature = "images")]
use crate::scene::{VirtualLight, export_lights};
use crate::settings::{Compensation, Settings, Traversal};
use crate::tiles;
use crate::view::{Atlas, Region, Texel, View};
use passes::readback;

/// Maximum number of rounds: beyond them, after some ten million steps, a ray is given up as pathological.
pub const MAX_ROUNDS: u32 = 1024;
/// Choice of the device, and options.
#[derive(Clone, Debug, Default)]
pub struct RenderOptions {
    /// The device. Default: the fastest kind available.
    pub device: DeviceChoice,
    /// Run under the validation layer; its messages become errors. Default false.
    pub validation: bool,
    /// Run the kernels that check every index. Default false.
    pub checked_shaders: bool,
    /// [`ContextOptions::max_memory`]. Default: what is free.
    pub max_memory: Option<u64>,
    /// File that keeps compiled pipelines between runs. Default none.
    pub pipeline_cache: Option<PathBuf>,
    /// The kernel for [`Traversal::Auto`], as an earlier run chose it: [`Provenance::traversal`] of its state. Default: the faster one, by a
    /// measurement that is kept beside the pipeline cache.
    pub traversal: Option<Traversal>,
    /// The scene may change between passes, see [`Engine::new_dynamic`]. Default false. Costs memory, and some time for
    /// each ray.
    pub dynamic: bool,
    /// Render a part of the image, see [`Renderer::set_crop`]. Default: all of it.
    pub crop: Option<Region>,
    /// If the image is too large for the device, set the renderer up for the first of [`Renderer::strips`], with [`Compensation::Exact`]
    /// in place of [`Compensation::Near`], which looks at the whole image. Default false: such an image is an error.
    pub strips: bool,
}

/// Times of one pass.
#[non_exhaustive]
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PassTimes {
    /// Wall-clock seconds, from recording to the end of the wait; longer if rays ran out of steps and the pass was
    /// repeated.
    pub seconds: f64,
    /// Seconds of these for recording commands, on the CPU.
    pub record: f64,
    /// Seconds of each GPU pass by its timestamps, in order; empty if the device writes none. "sort" is a part of "eye"
    /// and "gather".
    pub gpu_passes: Vec<(String, f64)>,
    /// Rays, counted as in [`Statistics::rays`].
    pub rays: u64,
}

/// A scene being rendered.
pub struct Renderer {
    context: Context,
    engine: Engine,
    scene: Scene,
    timers: Timers,
    readback: Buffer,
    /// Of the passes in the film; `None`: there are passes without.
    history: Option<History>,
    fingerprint: u64,
    /// Of scene and settings, for a renderer of texels.
    without_atlas: Option<u64>,
    stages: Vec<(String, f64)>,
    gpu_passes: Vec<(String, f64)>,
    last_pass: PassTimes,
    rendered: u32,
    /// Sequence numbers since the start of the image whose passes were left out.
    skipped: u32,
    /// Passes of this run that were left out.
    left_out: u32,
    rays: u64,
    culled: u64,
    photons: u64,
    crop: Option<Region>,
    strips: Vec<Region>,
}

/// The view that contains a part of a camera's image: the blocks around it, or the whole image if the part cannot be
/// rendered alone.
fn view_of(camera: Camera, settings: &Settings, crop: Option<Region>) -> Result<View> {
    let whole = View::whole(camera);
    let Some(crop) = crop else { return Ok(whole) };
    crop.check(camera.resolution)?;
    match whole.needs_whole(settings) {
        Some(why) => {
            log::info!("the whole image is rendered for its part: {why}");
            Ok(whole)
        }
        None => Ok(View::Camera { camera, region: crop.around(settings, camera.resolution) }),
    }
}

/// An engine, or an error that tells how much memory it needs altogether.
fn engine(context: &Context, scene: &Scene, view: View, settings: Settings) -> Result<Engine> {
    match Engine::with_view(context, scene, view.clone(), settings.clone()) {
        Err(Error::TooMuchMemory { resource, limit, .. }) => {
            let needed = Engine::memory_of(context, scene, view, settings)?;
            Err(Error::TooMuchMemory { resource, needed: needed.of_device(), limit, advice: needed.advice() })
        }
        made => made,
    }
}

/// Opens a device, and chooses the traversal kernel where that is open.
pub fn open(settings: Settings, options: &RenderOptions) -> Result<(Context, Settings)> {
    let context = Context::headless(&ContextOptions {
        device: options.device.clone(),
        validation: options.validation,
        checked_shaders: options.checked_shaders,
        max_memory: options.max_memory,
        pipeline_cache: options.pipeline_cache.clone(),
        ..ContextOptions::default()
    })?;
    let settings = match options.traversal {
        Some(earlier) if settings.traversal == Traversal::Auto => Settings { traversal: earlier, ..settings },
        _ => with_traversal(&context, settings, options.pipeline_cache.as_deref())?,
    };
    Ok((context, settings))
}

/// Chooses the traversal kernel for a device, where that is open and there is a pipeline cache beside which the choice is kept.
pub fn with_traversal(context: &Context, settings: Settings, cache: Option<&Path>) -> Result<Settings> {
    let traversal = match (settings.traversal, cache) {
        (Traversal::Auto, Some(cache)) if calibrate::is_open(context.info()) => calibrate::choose(context, cache)?,
        (traversal, _) => traversal,
    };
    Ok(Settings { traversal, ..settings })
}

impl Renderer {
    /// Opens the device, builds the acceleration structure, uploads the scene.
    pub fn new(scene: Scene, camera: Camera, settings: Settings, options: &RenderOptions) -> Result<Renderer> {
        let start = Instant::now();
        let (context, mut settings) = open(settings, options)?;
        let opened = start.elapsed().as_secs_f64();
        let strips = match options.strips {
            true => tiles::strips(context.info(), &scene, &camera, &settings),
            false => Vec::new(),
        };
        if strips.len() > 1 && settings.compensation == Compensation::Near {
            settings.compensation = Compensation::Exact;
        }
        let crop = if strips.len() > 1 { strips.first().copied() } else { options.crop };
        let mut renderer = if options.dynamic {
            Renderer::with_context_dynamic(context, scene, camera, settings)?
        } else {
            Renderer::with_crop(context, scene, camera, settings, crop)?
        };
        if strips.len() > 1 {
            renderer.strips = strips;
        }
        renderer.stages.insert(0, (String::from("device"), opened));
        Ok(renderer)
    }

    /// [`Renderer::new`] on a device that is open already.
    pub fn with_context(context: Context, scene: Scene, camera: Camera, settings: Settings) -> Result<Renderer> {
        Self::with_crop(context, scene, camera, settings, None)
    }

    /// [`Renderer::with_context`] for a part of the image.
    fn with_crop(
        context: Context,
        scene: Scene,
        camera: Camera,
        settings: Settings,
        crop: Option<Region>,
    ) -> Result<Renderer> {
        let start = Instant::now();
        let mut fingerprint = Fnv(fingerprint(&scene, &camera, &settings));
        if let Some(Region { origin, size }) = crop {
            fingerprint.add(bytemuck::cast_slice(&[origin, size]));
        }
        let view = view_of(camera, &settings, crop)?;
        let engine = engine(&context, &scene, view, settings)?;
        let mut renderer = Self::with_engine(context, scene, engine, fingerprint.0, start)?;
        renderer.crop = crop;
        Ok(renderer)
    }

    /// [`Renderer::with_context`] for texels on surfaces.
    pub fn with_atlas(context: Context, scene: Scene, atlas: Arc<Atlas>, settings: Settings) -> Result<Renderer> {
        let start = Instant::now();
        let without = fingerprint(&scene, &"atlas", &settings);
        let fingerprint = of_atlas(without, &atlas);
        let engine = engine(&context, &scene, View::Atlas(atlas), settings)?;
        let mut renderer = Self::with_engine(context, scene, engine, fingerprint, start)?;
        renderer.without_atlas = Some(without);
        Ok(renderer)
    }

    /// Renders other texels from now on, as a new [`Renderer::with_atlas`] would; scene and kernels stay on the device. Errors: the
    /// renderer was not made by [`Renderer::with_atlas`].
    pub fn set_atlas(&mut self, atlas: Arc<Atlas>) -> Result<()> {
        let Some(without) = self.without_atlas else {
            let message = String::from("the renderer shows a camera's image; make one by Renderer::with_atlas");
            return Err(Error::Setting { name: "view", message });
        };
        self.engine.set_atlas(atlas.clone())?;
        // The same texels start anew too.
        self.engine.restart();
        (self.history, self.skipped) = (Some(History::default()), 0);
        self.fingerprint = of_atlas(without, &atlas);
        Ok(())
    }

    /// [`Renderer::with_context`] with a scene that may change: see [`Renderer::engine_mut`].
    pub fn with_context_dynamic(
        context: Context,
        scene: Scene,
        camera: Camera,
        settings: Settings,
    ) -> Result<Renderer> {
        let start = Instant::now();
        let fingerprint = fingerprint(&scene, &camera, &settings);
        let engine = Engine::new_dynamic(&context, scene.clone(), camera, settings)?;
        Self::with_engine(context, scene, engine, fingerprint, start)
    }

    fn with_engine(
        context: Context,
        scene: Scene,
        mut engine: Engine,
        fingerprint: u64,
        start: Instant,
    ) -> Result<Renderer> {
        let built = start.elapsed().as_secs_f64();
        context.submit_and_wait("uploading the scene", None, |rec| engine.record_setup(rec))?;
        engine.setup_finished();
        let readback = readback(&context, &engine)?;
        let timers = Timers::new(&context, 128)?;
        let total = start.elapsed().as_secs_f64();
        Ok(Renderer {
            context,
            engine,
            scene,
            timers,
            readback,
            history: Some(History::default()),
            fingerprint,
            without_atlas: None,
            stages: vec![(String::from("build"), built), (String::from("upload"), total - built)],
            gpu_passes: Vec::new(),
            last_pass: PassTimes::default(),
            rendered: 0,
            skipped: 0,
            left_out: 0,
            rays: 0,
            culled: 0,
            photons: 0,
            crop: None,
            strips: Vec::new(),
        })
    }

    /// Number of passes in the image, with those before its own if it began with a later one ([`Renderer::load_film`]).
    pub fn passes(&self) -> u32 {
        self.engine.passes().saturating_sub(self.skipped)
    }

    /// Times of the latest pass; zeros before the first.
    pub fn last_pass(&self) -> &PassTimes {
        &self.last_pass
    }

    /// [`Engine::set_shutter_ends`], as a part of what the image's fingerprint tells.
    pub fn set_shutter_ends(&mut self, ends: Option<[ShutterEnd; 2]>) -> Result<()> {
        self.engine.set_shutter_ends(ends.clone())?;
        let mut fingerprint = Fnv(self.fingerprint);
        for end in ends.iter().flatten() {
            fingerprint.add(format!("{:?}", end.camera).as_bytes());
            for PosedObject { object, transform, vertices } in &end.objects {
                fingerprint.add(&object.to_le_bytes());
                fingerprint.add(bytemuck::cast_slice(&transform.to_cols_array()));
                fingerprint.add(bytemuck::cast_slice(vertices.as_deref().unwrap_or_default()));
            }
        }
        self.fingerprint = fingerprint.0;
        Ok(())
    }

    /// The engine.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// The engine, to change camera, settings and scene. Record passes only through [`Renderer::pass`].
    pub fn engine_mut(&mut self) -> &mut Engine {
        &mut self.engine
    }

    /// Gives the device back and keeps the scene of the start.
    pub fn into_scene(self) -> Scene {
        self.scene
    }

    /// The scene as it is now.
    pub fn scene(&self) -> &Scene {
        self.engine.scene().unwrap_or(&self.scene)
    }

    /// Relative error of the image against its limit, as [`crate::estimate`] defines and estimates it; `None`: unknown,
    /// because there are too few passes or because the image began with a film of passes of another renderer. Includes noise
    /// and structured error, but not the bias of clipping or filters. Of an atlas the texels on surfaces that do not emit count.
    pub fn error_estimate(&self) -> Option<f32> {
        let history = self.history.as_ref()?;
        let View::Atlas(atlas) = self.engine.view() else { return history.estimate() };
        // Texels without a point have no error, and what a surface emits is known: lamps would outshine the light on the rest.
        let counts = |pixel: &u32| {
            atlas.texels[*pixel as usize].is_some_and(|texel| {
                let material = self.scene.triangles[texel.triangle as usize].material;
                self.scene.materials[material as usize].emission == glam::Vec3::ZERO
            })
        };
        let counted: Vec<bool> = probe::pixels(atlas.texels.len() as u32).iter().map(counts).collect();
        history.estimate_of(&|i| counted[i])
    }

    /// The image and its layers, for the part of [`Renderer::set_crop`]. Reads about 300 bytes a pixel.
    pub fn layers(&self) -> Result<Layers> {
        self.image(Wanted::All)
    }

    /// The image with the wanted layers, for the part of [`Renderer::set_crop`]. Colour alone reads about 100 bytes a pixel.
    pub fn image(&self, wanted: Wanted) -> Result<Layers> {
        let layers = self.engine.film().mean(&self.context, self.engine.view().size(), wanted)?;
        Ok(match self.part() {
            Some(part) => layers.cut(part),
            None => layers,
        })
    }

    /// Where the part of [`Renderer::set_crop`] lies in the film; `None`: it is all of it.
    pub fn part(&self) -> Option<Region> {
        let (Some(crop), View::Camera { region, .. }) = (self.crop, self.engine.view()) else { return None };
        let origin = [0, 1].map(|axis| crop.origin[axis] - region.origin[axis]);
        Some(Region { origin, ..crop })
    }

    /// Renders a part of the camera's image from now on, bit for bit as in the whole image; `None`: all of it.
    /// Restarts. Settings that need the whole image (superposition, a lens, the choice of emitters by contribution)
    /// still render all of it.
    pub fn set_crop(&mut self, crop: Option<Region>) -> Result<()> {
        let Some(&camera) = self.engine.view().camera() else {
            return Err(Error::Setting { name: "--crop", message: String::from("an atlas has no camera") });
        };
        self.engine.set_view(view_of(camera, self.engine.settings(), crop)?)?;
        // Other parts of the same view start anew too.
        self.engine.restart();
        self.crop = crop;
        Ok(())
    }

    /// The strips in which [`crate::tiles::render`] renders an image that is too large for the device; empty if it
    /// fits.
    pub fn strips(&self) -> &[Region] {
        &self.strips
    }

    /// A copy of the film: the sums of all passes.
    pub fn film(&self) -> Result<HostFilm> {
        self.engine.film().download(&self.context, self.engine.view().size())
    }

    /// The number of passes left out, the sums of all others and what the error is estimated from, as bytes, little endian: with the
    /// number of passes, the complete state for a later run.
    pub fn save_state(&self) -> Result<Vec<u8>> {
        let mut bytes = self.skipped.to_le_bytes().to_vec();
        bytes.extend(self.film()?.to_bytes());
        bytes.extend(self.history.iter().flat_map(History::to_bytes));
        Ok(bytes)
    }

    /// Continues from [`Renderer::save_state`] after `passes` passes of the same scene, camera and settings.
    pub fn load_state(&mut self, passes: u32, bytes: &[u8]) -> Result<()> {
        let (size, summands) = (self.engine.view().size(), self.engine.settings().summands);
        let other = || Error::Scene(String::from("the saved state has sums for another image; start without --resume"));
        let (skipped, bytes) = bytes.split_first_chunk::<4>().ok_or_else(other)?;
        let skipped = u32::from_le_bytes(*skipped);
        let (film, history) = bytes.split_at(HostFilm::byte_count(size, summands).min(bytes.len()));
        let film = HostFilm::from_bytes(film, size, summands)?;
        let pixels = probe::pixels(size[0] * size[1]).len();
        let history = match history {
            [] => None,
            bytes => Some(History::from_bytes(bytes, pixels).ok_or_else(other)?),
        };
        self.load_film(passes.checked_add(skipped).ok_or_else(other)?, &film)?;
        (self.history, self.skipped) = (history, skipped);
        Ok(())
    }

    /// Continues from a film with pass number `passes`: a film of the earlier passes is completed; an empty film gets
    /// only the passes from this number on, to be merged with others. A film of passes tells nothing of their error, so
    /// [`Renderer::error_estimate`] is `None` from then on.
    pub fn load_film(&mut self, passes: u32, film: &HostFilm) -> Result<()> {
        if film.size() != self.engine.view().size() {
            let message = String::from("the film has another size than the image");
            return Err(Error::Resource { name: String::from("film"), message });
        }
        let mut staging = crate::gpu::Staging::new();
        self.engine.film().stage(&self.context, &mut staging, film)?;
        self.context.submit_and_wait("restoring the film", None, |rec| staging.record(rec))?;
        self.engine.set_passes(passes);
        self.skipped = 0;
        self.history = (film.passes() == 0).then(History::default);
        Ok(())
    }

    /// Fingerprint of scene, camera and settings at the start.
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// The device and the kernels of the passes.
    pub fn provenance(&self) -> Provenance {
        Provenance { device: self.context.info().identity(), traversal: self.engine.settings().traversal }
    }

    /// Counts and times so far.
    pub fn statistics(&self) -> Statistics {
        let info = self.context.info();
        let seconds = self.stages.iter().find(|(n, _)| n == "render").map_or(0.0, |(_, s)| *s);
        let p = self.engine.plan();
        let settings = self.engine.settings();
        Statistics {
            version: env!("CARGO_PKG_VERSION").into(),
            commit: env!("LIGHTSUM_COMMIT").into(),
            // Numbers and words only: serialisation cannot fail.
            settings: serde_json::to_value(settings).unwrap_or_default(),
            seed: settings.seed,
            device: info.name.clone(),
            driver: format!("{} {}", info.driver, info.driver_version),
            api: info.api_version.to_string(),
            scene: self.scene.name.clone(),
            resolution: p.view.size(),
            triangles: u64::from(self.engine.bvh().triangle_count()),
            nodes: u64::from(p.scene.nodes),
            device_bytes: self.context.memory_use().device,
            host_bytes: crate::input::most_memory_taken(),
            lights_per_pass: f64::from(p.lights.slots() * p.settings.classes()),
            passes: self.passes(),
            passes_rendered: self.rendered,
            passes_left_out: self.left_out,
            rays: self.rays,
            culled_pairs: self.culled,
            photons: self.photons,
            mirror_pixels: None,
            rays_per_second: if seconds > 0.0 { self.rays as f64 / seconds } else { 0.0 },
            error_estimate: self.error_estimate(),
            stages: self.stages.clone(),
            gpu_passes: self.gpu_passes.clone(),
        }
    }

    /// The virtual lights of the latest pass.
    pub fn lights(&self) -> Result<Vec<PointLight>> {
        download::<PointLight>(&self.context, self.engine.frame().lights())
    }

    /// Writes the virtual lights of the latest pass with the scene as glTF (Keller 1997, 5); returns their number.
    ///
    /// Leaves out the specular lobes of the lights: a file's lights emit by powers of the cosine.
    #[cfg(feature = "images")]
    pub fn export_lights(&mut self, path: &Path) -> Result<usize> {
        if self.passes() == 0 {
            self.pass()?;
        }
        if self.scene().environment.is_some() {
            log::warn!("the file's lights leave out what comes directly from the environment: glTF has no such light");
        }
        // The lights of each class represent all the light; divide it among the classes.
        let classes = self.engine.plan().settings.classes() as f32;
        let lights: Vec<VirtualLight> = self
            .lights()?
            .iter()
            .filter(|l| l.flags() & PointLight::SURFACE != 0 && l.emit[..3].iter().any(|&e| e > 0.0))
            .map(|l| {
                let xyz = |a: [f32; 4]| Vec3::new(a[0], a[1], a[2]);
                VirtualLight {
                    position: xyz(l.position),
                    normal: xyz(l.normal),
                    power: xyz(l.emit) * (exitance(l.exponent()) / classes),
                    exponent: l.exponent(),
                }
            })
            .collect();
        export_lights(path, self.scene(), &lights)?;
        Ok(lights.len())
    }
}

/// The fingerprint of scene and settings, and of texels.
fn of_atlas(without: u64, atlas: &Atlas) -> u64 {
    let mut fingerprint = Fnv(without);
    fingerprint.add(bytemuck::cast_slice(&atlas.size));
    for Texel { triangle, uv: [u, v], back } in atlas.texels.iter().flatten() {
        fingerprint.add(bytemuck::cast_slice(&[*triangle, u.to_bits(), v.to_bits(), u32::from(*back)]));
    }
    fingerprint.add(&[u8::from(atlas.moving.is_some())]);
    fingerprint.0
}
