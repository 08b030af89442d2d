//! Global illumination without noise as a sum over virtual lights, in Vulkan compute.
//!
//! Instant radiosity (Keller 1997): particles leave the emitters along quasi-random paths and leave a point light
//! wherever they meet a surface; everything that the eye sees is lit by all of these lights, with shadows. The usual
//! noise becomes a smooth error that the next passes average away. Everything runs in compute shaders of Vulkan 1.1 on
//! devices with 30 storage buffers in a stage, Mesa's lavapipe on the processor among them.
//!
//! # Architecture
//!
//! Data flows down this table; whoever opens the files in this order has read the renderer.
//!
//! | module | role |
//! |---|---|
//! | [`settings`] | every setting: meaning, unit, default, cost |
//! | [`error`] | the one error type |
//! | [`input`] | the one way to the bytes of a file |
//! | [`scene`] | the scene as plain data: OBJ, PLY, glTF, Mitsuba's XML, scene files, built-in scenes |
//! | [`bsdf`] | reflectance: Lambert and a GGX lobe; mirrors and glass |
//! | [`accel`] | the bounding volume hierarchy |
//! | [`sampling`] | Halton, Hammersley and Sobol' points, hashes, and the dimensions of each consumer |
//! | [`light`] | the emitters, and how particles are spread over them |
//! | [`superposition`] | tables for glossy reflections by convolution: kernels and directional reflectance |
//! | [`device_scene`] | the scene on the device; outlives frames, settings and sizes |
//! | [`view`] | where light is wanted: a camera, a region of its image, an atlas of texels |
//! | [`extent`] | the extent of what a view shows, from which all default lengths derive |
//! | [`film`] | exact sums over passes, on the device and on the host; merging, means |
//! | [`ring`] | images or lights of the latest paths, for scenes that move |
//! | [`plan`] | all that follows from scene, settings and view; the parameters of each pass |
//! | [`pass`] | the GPU passes, one file each with its CPU oracle; its shaders begin with the same stem |
//! | [`stage`] | the stages of a frame, each with its passes, buffers and steps |
//! | [`frame`] | the frame: each stage once, in order |
//! | [`engine`] | scene, view, film and frame together, recorded into a host's command buffer |
//! | [`standalone`] | the engine on a device of its own, with readback; used by the command line |
//! | [`tiles`] | images too large for a device, strip by strip |
//! | [`calibrate`] | the faster kernel for shadow rays on a device |
//! | [`summary`] | what a scene holds, for people and as JSON |
//! | [`path_trace`] | CPU path tracer, the ground truth |
//! | [`bake`] | light kept in textures: charts, texels, files |
//! | [`output`] | EXR, PNG, statistics, resumable state, films |
//! | [`cluster`] | one image on many machines |
//! | [`fingerprint`] | a hash that tells renderings apart |
//! | [`gpu`] | the only code that calls Vulkan; it knows nothing about light |
//!
//! ```text
//! DeviceScene --+
//! Settings -----+--> plan::derive --> Plan --> Frame::new --> Frame (stages) --> Film --> image, layers
//! View ---------+                      |                        ^
//!                                      +-- parameters(pass) ----+
//! ```
//!
//! A *pass* of the renderer adds one sample to every pixel; a *GPU pass* is one step of it. One pass of the renderer, in the order in which [`frame`] records its stages:
//!
//! 1. [`Eye`](stage::Eye): [`camera_rays`](pass::camera_rays) and [`trace`](pass::trace) find the first hits. Tiles of pixels with
//!    mirrors, glass or narrow lobes ([`tiles`](pass::tiles)) are followed by [`eye_paths`](pass::eye_paths) and [`trace`](pass::trace) in turns,
//!    split in two or three where several components count. [`eye_points`](pass::eye_points) and
//!    [`split_points`](pass::split_points) turn hits into shading points on a list, and [`clusters`](pass::clusters) or [`sort`](pass::sort) brings neighbours together. An [`atlas`](pass::atlas) takes the place of
//!    camera rays where texels are lit. Where images with depth show what glossy planes mirror, [`reproject`](pass::reproject) projects their points
//!    first, and rays are traced for the rest. [`velocity`](pass::velocity) finds how far what pixels show moves while the shutter is open. [`schedule`](pass::schedule) turns counts into indirect dispatches, here and everywhere.
//! 2. [`importance`](pass::importance) estimates the contribution of each emitter to the points seen, if emitters are chosen by it.
//! 3. [`Walk`](stage::Walk): [`walk_start`](pass::walk_start) sends particles from the emitters. For each reflection
//!    [`trace`](pass::trace) finds their hits, [`walk_follow`](pass::walk_follow) continues those at mirrors and glass, and
//!    [`walk_reflect`](pass::walk_reflect) leaves a light and sends the survivors on. [`delta_choice`](pass::delta_choice) chooses among lights without area where not all are lit.
//! 4. [`Photons`](stage::Photons): [`photon_lights`](pass::photon_lights) weighs virtual lights,
//!    [`photon_start`](pass::photon_start) shoots photons from them and from emitters at mirrors and glass,
//!    [`photon_follow`](pass::photon_follow) and [`trace`](pass::trace) follow them until they are stored, and
//!    [`photon_radius`](pass::photon_radius) sets the radius of the look-up and [`photon_grid`](pass::photon_grid) sorts them into a hash grid.
//! 5. [`light_lists`](pass::light_lists) chooses the lights of each cluster of points, from a large pool among those that
//!    [`light_regions`](pass::light_regions) took. [`Shade`](stage::Shade): [`shade`](pass::shade) lights the points by them, no nearer than the clip distance.
//!    [`SoftShadows`](stage::SoftShadows): [`soft_shadow`](pass::soft_shadow) lights them by the largest emitters in place of virtual lights on these, if asked for.
//!    Where the scene has kept light, [`kept_light`](pass::kept_light) takes the place of all lights.
//!    [`PhotonLighting`](stage::PhotonLighting): [`photon_find`](pass::photon_find) lists the points near photons,
//!    [`photon_width`](pass::photon_width) sets the widths of these, and
//!    [`photon_light`](pass::photon_light) adds their light. [`mirror_lights`](pass::mirror_lights) adds the light of virtual
//!    lights after one planar mirror.
//! 6. [`Compensation`](stage::Compensation), bounce by bounce, for the light that clipping cut off: [`near_aim`](pass::near_aim) sends rays
//!    towards near emitters, [`gather`](pass::gather), [`trace`](pass::trace) and
//!    [`gathered_points`](pass::gathered_points) follow one short ray from each point, [`shade`](pass::shade)
//!    lights their hits, and [`collect`](pass::collect) brings the light back to the pixels. Or
//!    [`NearLight`](stage::NearLight), once: `near_aim` again,
//!    [`near_points`](pass::near_points) finds the pixels that show the hits of others, and
//!    [`near_collect`](pass::near_collect) takes their irradiance. [`third_light`](pass::third_light) then joins the third components of eye paths to the second ones.
//! 7. [`discontinuity`](pass::discontinuity) averages irradiance over neighbours on one surface, [`sparse_windows`](pass::sparse_windows)
//!    exchanges it where there are few of them, both without that of [`caustics`](pass::caustics),
//!    [`glossy_light`](pass::glossy_light) adds the light of paths along lobes to their pixels, and
//!    [`discontinuity_lobes`](pass::discontinuity_lobes) averages the light of lobes over neighbours that reflect alike.
//!    Light with [soft shadows](pass::soft_shadow::SoftShadowAdd) is added after them.
//!    [`outliers`](pass::outliers) lowers emission that unlikely paths over mirrors and glass found, and [`unlikely`](pass::unlikely) spreads
//!    over their neighbours what else such paths show.
//!    [`gain`](pass::gain) sums what these add to each pixel.
//! 8. [`GlossyPlanes`](stage::GlossyPlanes): [`mirror_image`](pass::mirror_image) takes the image of glossy planes from the second
//!    components, [`convolve`](pass::convolve) spreads it, and [`superpose`](pass::superpose) adds it to the planes.
//! 9. [`merge`](pass::merge) adds the light of the other second components to their pixels, [`summands`](pass::summands) sums
//!    emission, diffuse and specular light apart, [`lens`](pass::lens) blurs by [`convolve`](pass::convolve) what is out of focus, and
//!    [`motion_blur`](pass::motion_blur) what moves.
//! 10. [`Output`](stage::Output): [`finite`](pass::finite) looks, before anything is summed, whether the pass is made of numbers, and
//!     [`accumulate`](pass::accumulate) adds it to the film. In a ring, [`ring`](pass::ring) puts it in place of the oldest image instead.
//!
//! Of these only `Eye`, `Walk`, `Shade` and `Output` always run; the others run where settings and scene ask for them.
//!
//! After any number of passes the film becomes an image, from which the bias of the filters is taken ([`gain`](pass::gain)), in one of two ways. For a host,
//! [`Engine::record_image`](engine::Engine::record_image) has [`resolve`](pass::resolve) write the mean to an image on the
//! device, and [`display`](pass::display) turns it, or a [`layer`](pass::layer) of the film, into the colours of a display. For files, the host reads the film ([`Film::download`](film::Film::download)), computes mean and layers
//! ([`HostFilm::mean`](film::HostFilm::mean)), and [`output`] writes them. After each pass, [`probe`](pass::probe) copies the
//! sums of a few pixels for [`estimate`], which tells how far the image is from its limit.
//!
//! # Use
//!
//! On a device of our own:
//!
//! ```no_run
//! use lightsum::output::{self, Encoding, Metadata};
//! use lightsum::{RenderOptions, Renderer, Settings, scene};
//! use std::path::Path;
//!
//! # fn main() -> lightsum::Result<()> {
//! let scene = scene::load(Path::new("scenes/cornell/scene.toml"))?;
//! let camera = scene.camera.ok_or_else(|| lightsum::Error::Scene("it has no camera".into()))?;
//! let mut renderer = Renderer::new(scene, camera, Settings::default(), &RenderOptions::default())?;
//! for _ in 0..16 {
//!     renderer.pass()?;
//! }
//! output::write(Path::new("cornell.exr"), &renderer.layers()?, &Metadata::default(), &Encoding::default())
//! # }
//! ```
//!
//! On a host's device, recorded into the host's command buffer: [`gpu::Requirements`] says what the device needs,
//! [`Context::adopt`] takes it, and [`Engine`] records. `examples/embed.rs` is such a host from the first line to the
//! last; docs/embedding.md says who does what, and names the limits.
//!
//! # Features
//!
//! Without the default ones the library renders what its host builds and what scene descriptions without models hold, with a third of the
//! dependencies.
//!
//! - `images`: textures and environments in files, and writing images, maps and glTF.
//! - `gltf`, `mitsuba`, `obj`, `ply` (all of them: `formats`, default): readers of these files, with `images`. `gltf` reads textures in KTX 2.0 and
//!   bakes too.
//! - `cli` (default): what the programs need; they read all formats.
//! - `conform` (default): the checks of `lightsum-conform`.
//! - `hot-reload`: compile the kernels from `shaders/` (or the folder that `LIGHTSUM_SHADERS` names) whenever an
//!   engine is made, for work on them.
//! - `mpi`: one rendering on several ranks, started by `mpirun`.
//! - `viewer` (default): `lightsum view`, and [`gpu::surface`], a window's device and images.

#![warn(missing_docs)]
#![cfg_attr(not(feature = "formats"), allow(dead_code, reason = "some of it serves readers of formats alone"))]
#![deny(unsafe_op_in_unsafe_fn)]
#![deny(unsafe_code)]

// Used everywhere.
pub mod error;
pub mod extent;
pub mod input;
pub mod settings;

// The scene as data.
pub mod scene;

// Light transport on the host: the material of the passes, and their measure.
pub mod accel;
pub mod bsdf;
pub mod light;
pub mod sampling;
pub mod superposition;

// The frame on the device.
pub mod device_scene;
pub mod film;
pub mod frame;
pub mod pass;
pub mod plan;
pub mod ring;
pub mod stage;
pub mod view;

// Interfaces for users.
pub mod bake;
pub mod calibrate;
pub mod engine;
pub mod estimate;
pub mod radiosity;
pub mod standalone;
pub mod summary;
pub mod tiles;

// Ground truth and results.
pub mod cluster;
pub mod fingerprint;
pub mod output;
pub mod path_trace;

// Vulkan.
#[allow(unsafe_code)]
pub mod gpu;

// The kernels against their oracles. Unit tests do not need it a second time.
#[cfg(all(feature = "conform", not(test)))]
pub mod conform;

pub use engine::Engine;
pub use error::{Error, Result};
pub use gpu::Context;
pub use scene::{Camera, Scene};
pub use settings::{Clip, Settings};
pub use standalone::{RenderOptions, Renderer};
pub use view::View;

// Types of these crates are in the interface, so that a host needs the same versions.
pub use {ash, glam};
