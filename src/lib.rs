//! Global illumination without noise as a sum over virtual lights, in Vulkan compute.
//!
//! Instant radiosity (Keller 1997): particles leave the emitters along quasi-random paths and leave a point light
//! wherever they meet a surface; what the eye sees is lit by all of these lights, with shadows. What is usually noise
//! becomes a smooth error that the next passes average away. Everything runs in compute shaders on any device with
//! Vulkan 1.1, Mesa's lavapipe on the processor included.
//!
//! # Architecture
//!
//! Data flows down this table; whoever opens the files in this order has read the renderer.
//!
//! | module | role |
//! |---|---|
//! | [`settings`] | every knob: meaning, unit, default, cost |
//! | [`error`] | the one error type |
//! | [`scene`] | what is lit: OBJ, glTF, scene files, built-in scenes; plain data |
//! | [`bsdf`] | how surfaces reflect: Lambert and a GGX lobe; mirrors and glass |
//! | [`accel`] | the bounding volume hierarchy |
//! | [`sampling`] | Halton, Hammersley and Sobol' points, hashes, and which consumer uses which dimension |
//! | [`light`] | the emitters and how particles are spread over them |
//! | [`superposition`] | tables for glossy reflections by convolution: kernels and directional reflectance |
//! | [`plan`] | what a pass will do: surviving particles, dispatches, its parameters |
//! | [`device_scene`] | the scene on the device |
//! | [`pass`] | the GPU passes, one file each beside its CPU oracle, each with a shader of the same stem |
//! | [`frame`] | the frame: each pass once, in order |
//! | [`engine`] | scene and frame together, recorded into a host's command buffer |
//! | [`standalone`] | the engine on a device of its own, with readback; what the command line runs |
//! | [`calibrate`] | which kernel traces shadow rays on a device |
//! | [`path_trace`] | CPU path tracer, the ground truth |
//! | [`output`] | EXR, PNG, statistics, resumable state |
//! | [`fingerprint`] | tells renderings apart |
//! | [`gpu`] | the only code that speaks Vulkan; it knows nothing about light |
//!
//! One pass of the renderer, as [`frame`] records it:
//!
//! 1. walk: [`walk_start`](pass::walk_start) sends particles from the emitters; for each reflection
//!    [`trace`](pass::trace) finds what they hit and [`walk_reflect`](pass::walk_reflect) leaves a light there and
//!    sends the survivors on.
//! 2. eye: [`camera_rays`](pass::camera_rays) and [`trace`](pass::trace) find what the pixels see;
//!    [`tiles`](pass::tiles) of mirrors and glass are followed by [`eye_paths`](pass::eye_paths) and [`trace`](pass::trace) in
//!    turns, split in two where both components count; [`eye_points`](pass::eye_points) and
//!    [`split_points`](pass::split_points) list what is to be lit; [`schedule`](pass::schedule) turns counts into indirect
//!    dispatches, here and everywhere. Then photons, if asked for: [`photon_start`](pass::photon_start) shoots them at mirrors and glass,
//!    [`photon_follow`](pass::photon_follow) and [`trace`](pass::trace) follow them to where they are stored, and
//!    [`photon_grid`](pass::photon_grid) sorts them.
//! 3. For each bounce: [`sort`](pass::sort) brings neighbours together, or [`clusters`](pass::clusters) where the eye's receivers
//!    are the only ones; [`shade`](pass::shade) lights the receivers by
//!    all lights, no nearer than the clip distance, and [`photon_light`](pass::photon_light) what the eye sees by the photons
//!    around it, where [`photon_find`](pass::photon_find) has found some; then [`gather`](pass::gather), [`trace`](pass::trace) and
//!    [`gathered_points`](pass::gathered_points) follow one short ray from each for what clipping cut off, and
//!    [`collect`](pass::collect) brings its light back to the pixels.
//! 4. [`discontinuity`](pass::discontinuity), if asked for, averages irradiance over neighbours on one surface; [`merge`](pass::merge) adds the second way of what was split; [`accumulate`](pass::accumulate) adds the pass to the running sums; [`resolve`](pass::resolve) writes their
//!    mean to an image.
//!
//! Where there are planar mirrors and it is asked for, [`mirror_lights`](pass::mirror_lights) add the light of mirrored virtual lights
//! after that of photons.
//!
//! Where particles choose emitters by contribution, the eye comes before the walk, and [`importance`](pass::importance) stands
//! between them. Where not all point, spot and parallel lights are lit, [`delta_choice`](pass::delta_choice) follows.
//!
//! Where glossy planes mirror the room, [`mirror_image`](pass::mirror_image) takes its image from the second components before
//! [`merge`](pass::merge), [`convolve`](pass::convolve) spreads it, and [`superpose`](pass::superpose) adds it to the planes. Before
//! [`accumulate`](pass::accumulate) come, if asked for, [`summands`](pass::summands), which sums emission, diffuse and specular light apart, and
//! [`lens`](pass::lens), which blurs by [`convolve`](pass::convolve) what is out of focus.
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
//! last.
//!
//! # Features
//!
//! - `hot-reload`: compile the kernels from `shaders/` (or the folder that `LIGHTSUM_SHADERS` names) whenever an
//!   engine is made, for work on them.

#![warn(missing_docs)]
#![deny(unsafe_op_in_unsafe_fn)]
#![deny(unsafe_code)]

// Spoken of everywhere.
pub mod error;
pub mod settings;

// What is lit.
pub mod scene;

// Light transport on the host: what passes are made of and measured against.
pub mod bsdf;

pub mod accel;

pub mod sampling;

pub mod light;

pub mod superposition;

// The frame on the device.
pub mod plan;

pub mod device_scene;

pub mod film;

pub mod view;

pub mod stage;

pub mod pass;

pub mod frame;

// What users hold.
pub mod calibrate;
pub mod engine;
pub mod standalone;
pub mod tiles;

// Ground truth and results.
pub mod path_trace;

pub mod output;

pub mod fingerprint;

// Beneath everything.
#[allow(unsafe_code)]
pub mod gpu;

pub use engine::Engine;
pub use error::{Error, Result};
pub use gpu::Context;
pub use scene::{Camera, Scene};
pub use settings::{Clip, Settings};
pub use standalone::{RenderOptions, Renderer};
