//! Light kept in textures (the illumination maps of Keller 1997, 4.3): each texel holds the irradiance
//!
//! E = sum over the virtual lights of V I cos cos' / d^2
//!
//! at a point of a surface, as the passes of an atlas ([`crate::view::Atlas`]) compute it; shown at run time times reflectance.
//! View-independent and diffuse only.
//!
//! 1. [`sides`] tells which sides of each triangle light reaches: models made of single sheets, in either orientation, are
//!    charted where they are lit, on both sides if need be.
//! 2. [`charts`] lays the lit sides out on the pages of an atlas: by the file's own coordinates where they are good, else anew.
//! 3. [`texels`] gives each texel its point: its centre on the chart, or near a chart's border the nearest point of it, so that
//!    bilinear look-ups meet light of their own surface only.
//! 4. `moves` moves the points within their texels from pass to pass.
//! 5. Blocks of 64 neighbouring texels form one or more atlas views ([`Bake::batches`]), each rendered like an image, with the error
//!    estimate and the state of one.
//! 6. [`Lightmap`] collects them: texels inside geometry are masked, and what is masked or outside of charts is filled from
//!    neighbours.
//! 7. [`files`] writes and reads glTF with the maps beside it; [`crate::scene::KeptLight`] is what a renderer shows.

mod batches;
pub(crate) mod blocks;
pub mod charts;
mod file_charts;
#[cfg(feature = "images")]
pub mod files;
#[cfg(feature = "gltf")]
mod kept;
pub(crate) mod lightmap;
#[cfg(feature = "images")]
mod materials;
mod moves;
mod outliers;
pub mod sides;
mod space;
pub mod texels;

pub use batches::Batch;
pub use lightmap::{Lightmap, Page};

use crate::accel::Bvh;
use crate::engine::Engine;
use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::scene::{Material, Scene};
use crate::settings::{Compensation, Settings};
use crate::standalone::Renderer;
use crate::view::{MAX_PIXELS, View};
use blocks::{ACROSS, ENTRIES};
use charts::Charts;
use lightmap::Inside;
use sides::Sides;

/// Most texels of a batch: more do not trace faster.
const MAX_BATCH: u64 = 1 << 18;
/// Bytes of a device for each texel of a batch: of the film, and of the shading points of each bounce with their light and rays.
const FILM_BYTES: u64 = 19 * 16;
const POINT_BYTES: u64 = 15 * 16;

/// Asked now and then whether to break off.
pub type Stop<'a> = &'a (dyn Fn() -> bool + Sync);

/// Options of a bake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Texels along a unit of length. Default `None`: such that the surfaces have some 2^19 texels.
    pub density: Option<f32>,
    /// Greatest width and height of a page. Default 2048; 64 to 8192.
    pub max_size: u32,
    /// Texels around each chart that hold its light, for mip maps. Default 2; 1 to 16.
    pub padding: u32,
    /// Charts are made anew although the file has texture coordinates of light maps. Default false.
    pub new_charts: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options { density: None, max_size: 2048, padding: 2, new_charts: false }
    }
}

/// Texels of the surfaces without [`Options::density`].
const DEFAULT_TEXELS: f64 = (1 << 19) as f64;

impl Options {
    /// Errors: a value out of range.
    pub fn validate(&self) -> Result<()> {
        let setting = |name, message| Err(Error::Setting { name, message });
        if let Some(density) = self.density.filter(|d| !(d.is_finite() && *d > 0.0)) {
            return setting("--density", format!("{density} is not a number of texels above 0"));
        }
        if !(64..=8192).contains(&self.max_size) {
            return setting("--max-size", format!("{} is not in 64..=8192", self.max_size));
        }
        if !(1..=16).contains(&self.padding) {
            return setting("--padding", format!("{} is not in 1..=16", self.padding));
        }
        Ok(())
    }
}

/// Settings for texels: one class, or as many as are asked for, so that neighbours have alike errors and the maps are smooth; what an
/// atlas cannot have is off. With a light pool each block of texels chooses lights from it.
pub fn settings(settings: Settings) -> Settings {
    Settings {
        superposition: None,
        soft_shadows: None,
        filter: None,
        antialias: false,
        shading_rate: 1,
        summands: false,
        compensation: if settings.compensation == Compensation::Near {
            Compensation::Exact
        } else {
            settings.compensation
        },
        ..settings
    }
}

/// A bake: what is to be computed, before the first pass.
pub struct Bake {
    context: Context,
    /// The scene, as texels see it: see [`prepare`].
    scene: Scene,
    settings: Settings,
    options: Options,
    charts: Charts,
    batches: Vec<Batch>,
    /// Texels inside geometry, which are in no batch.
    within: usize,
    bvh: Bvh,
}

impl Bake {
    /// Finds the lit sides, makes charts and texels.
    ///
    /// Errors: options or settings out of range; a density at which the texels do not fit, with one that would.
    pub fn new(context: &Context, scene: &Scene, settings: Settings, options: Options) -> Result<Bake> {
        Self::new_unless(context, scene, settings, options, &|| false)
    }

    /// [`Bake::new`], unless `stop` breaks it off. Errors: [`Error::Interrupted`] too.
    pub fn new_unless(
        context: &Context,
        scene: &Scene,
        settings: Settings,
        options: Options,
        stop: Stop,
    ) -> Result<Bake> {
        options.validate()?;
        let settings = self::settings(settings);
        let scene = prepare(scene);
        let start = std::time::Instant::now();
        let sides = sides::lit(context, &scene, &settings, stop)?;
        log::debug!("lit sides found in {:.1} s", start.elapsed().as_secs_f64());
        Self::with_sides((context, stop), scene, settings, options, sides)
    }

    fn with_sides(
        (context, stop): (&Context, Stop),
        scene: Scene,
        settings: Settings,
        options: Options,
        sides: Vec<Sides>,
    ) -> Result<Bake> {
        let area: f64 =
            (0..scene.triangles.len()).map(|i| f64::from(scene.triangle_area(i)) * f64::from(sides[i].count())).sum();
        if area <= 0.0 {
            return Err(Error::Scene(String::from(
                "no light reaches a surface that reflects diffusely; there is nothing to bake",
            )));
        }
        let density = options.density.map_or_else(|| (DEFAULT_TEXELS / area).sqrt(), f64::from);
        let most = MAX_PIXELS as f64;
        if area * density * density > most {
            return Err(too_dense(density, (most / area).sqrt()));
        }
        let start = std::time::Instant::now();
        let charts = charts::lay_out(&scene, &sides, density as f32, &options, stop)?;
        log::debug!("charts made in {:.1} s", start.elapsed().as_secs_f64());
        let bvh = Bvh::build(&scene)?;
        let inside = Inside { sides: &sides, bvh: &bvh, leaves: &bvh.leaf_numbers() };
        let (batches, within) = batches::divide(&charts, batch_texels(context, &settings), &inside);
        if batches.is_empty() {
            let message =
                "every texel of the surfaces that light reaches lies inside geometry; there is nothing to bake";
            return Err(Error::Scene(String::from(message)));
        }
        log::debug!("texels made in {:.1} s", start.elapsed().as_secs_f64());
        Ok(Bake { context: context.clone(), scene, settings, options, charts, batches, within, bvh })
    }

    /// The charts.
    pub fn charts(&self) -> &Charts {
        &self.charts
    }

    /// The options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The views to render, each by [`Bake::renderer`].
    pub fn batches(&self) -> &[Batch] {
        &self.batches
    }

    /// Texels with a point, of all batches.
    pub fn texels(&self) -> usize {
        self.batches.iter().map(Batch::texels).sum()
    }

    /// Bytes that buffers and images need on the device, and bytes that the host needs for the maps. The first are counted by
    /// [`Engine::memory_of`] for the largest batch. Errors: those of an engine.
    pub fn memory(&self) -> Result<[u64; 2]> {
        let largest = self.batches.iter().max_by_key(|batch| batch.atlas.texels.len());
        let device = match largest {
            Some(batch) => {
                let view = View::Atlas(batch.atlas.clone());
                Engine::memory_of(&self.context, &self.scene, view, self.settings.clone())?.device
            }
            None => 0,
        };
        let maps: u64 = self.charts.pages.iter().map(|&[w, h]| u64::from(w) * u64::from(h)).sum();
        Ok([device, maps * (24 + 16 + 24)])
    }

    /// A renderer of batch `i`. `last`: that of another batch, which leaves it scene and kernels.
    pub fn renderer(&self, i: usize, last: Option<Renderer>) -> Result<Renderer> {
        let atlas = self.batches[i].atlas.clone();
        match last {
            Some(mut renderer) => renderer.set_atlas(atlas).map(|()| renderer),
            None => Renderer::with_atlas(self.context.clone(), self.scene.clone(), atlas, self.settings.clone()),
        }
    }
}

fn too_dense(density: f64, fits: f64) -> Error {
    let message = format!("{density} texels a unit make too many or too large charts; {:.3} would fit", 0.95 * fits);
    Error::Setting { name: "--density", message }
}

/// The scene for texels: without normal maps, whose detail lies between texels, and with textures that reflect a little everywhere,
/// because points that reflect nothing are not lit and would darken their neighbours in a look-up.
pub(crate) fn prepare(scene: &Scene) -> Scene {
    let mut scene = Scene { kept_light: None, ..scene.clone() };
    for material in &mut scene.materials {
        material.normal_texture = None;
    }
    // Emission keeps its texels as they are.
    for i in 0..scene.textures.len() as u32 {
        let reflects = |m: &Material| [m.base_texture, m.metallic_roughness_texture].contains(&Some(i));
        let emits = |m: &Material| m.emission_texture == Some(i);
        if scene.materials.iter().any(reflects) && scene.materials.iter().any(emits) {
            let copy = scene.textures.len() as u32;
            scene.textures.push(scene.textures[i as usize].clone());
            scene.materials.iter_mut().filter(|m| emits(m)).for_each(|m| m.emission_texture = Some(copy));
        }
    }
    for i in 0..scene.textures.len() {
        let base = scene.materials.iter().any(|m| m.base_texture == Some(i as u32));
        let metal = scene.materials.iter().any(|m| m.metallic_roughness_texture == Some(i as u32));
        for texel in &mut scene.textures[i].texels {
            if base && texel[..3] == [0; 3] {
                texel[..3].copy_from_slice(&[1; 3]);
            }
            if metal {
                texel[2] = texel[2].min(254);
            }
        }
    }
    scene.keep_levels();
    scene
}

fn texel_bytes(settings: &Settings) -> u64 {
    let bounces = match settings.compensation {
        Compensation::Exact if settings.clips() => u64::from(settings.max_depth),
        _ => 1,
    };
    FILM_BYTES + POINT_BYTES * bounces
}

/// Most texels of a batch on this device: a quarter of its memory, and what its bindings hold.
pub(crate) fn batch_texels(context: &Context, settings: &Settings) -> usize {
    let info = context.info();
    let memory = info.device_memory / 4 / texel_bytes(settings);
    let block_row = (ACROSS * ENTRIES) as u64;
    memory.min(info.max_storage_buffer_range / 16).clamp(block_row, MAX_BATCH) as usize
}
