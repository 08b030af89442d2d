//! `--mirror-source images`: samples the mirror images of a scene before it is rendered.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use lightsum::Result;
use lightsum::pass::reproject::MirrorPixels;
use lightsum::scene::Scene;
use lightsum::settings::{MirrorForm, RenderDefaults, Settings};
use lightsum::standalone::{self, RenderOptions, Renderer};
use lightsum::superposition::depth_images::{DepthImages, Options, Plan};

use crate::progress::{Progress, duration};
use crate::say_aside;

/// Whether images with depth are wanted.
pub fn wanted(keys: &RenderDefaults) -> bool {
    keys.mirror_source == Some(MirrorForm::Images)
}

/// The sizes of the images.
fn sizes(keys: &RenderDefaults) -> Options {
    let defaults = Options::default();
    Options {
        hemispheres: keys.mirror_hemispheres.unwrap_or(defaults.hemispheres),
        images: keys.mirror_images.unwrap_or(defaults.images),
        side: keys.mirror_side.unwrap_or(defaults.side),
        layers: keys.mirror_layers.unwrap_or(defaults.layers),
        passes: keys.mirror_passes.unwrap_or(defaults.passes),
        memory: keys.mirror_memory.unwrap_or(defaults.memory),
    }
}

/// The pixels of the latest pass that images with depth show, if there are images.
pub fn pixels(renderer: &Renderer) -> Result<Option<MirrorPixels>> {
    let engine = renderer.engine();
    engine.frame().eye.reproject.as_ref().map(|pass| pass.mirror_pixels(engine.context())).transpose()
}

/// Says how many of them rays show.
pub fn tell(pixels: Option<MirrorPixels>) {
    let Some(MirrorPixels { shown, holes, withheld }) = pixels.filter(|pixels| pixels.shown > 0) else { return };
    let share = |n: u32| 100.0 * f64::from(n) / f64::from(shown);
    say_aside(&format!(
        "of {shown} pixels of mirror images rays show {:.1} % where images have holes and {:.1} % where light depends on the view",
        share(holes),
        share(withheld)
    ));
}

/// Makes the images if they are wanted; says before how many bytes they take.
pub fn sample(scene: &mut Scene, settings: &Settings, options: &RenderOptions, interrupted: &AtomicBool) -> Result<()> {
    if !wanted(&scene.render) {
        return Ok(());
    }
    let start = Instant::now();
    let plan = Plan::new(scene, settings, sizes(&scene.render))?;
    let side = plan.options().side;
    say_aside(&format!(
        "{} hemispheres, {} images with depth of {side}x{side} points, {:.1} MiB",
        plan.hemispheres().len(),
        plan.images(),
        plan.bytes() as f64 / f64::from(1 << 20)
    ));
    let (context, settings) = standalone::open(settings.clone(), options)?;
    let mut progress = Progress::new();
    let images = DepthImages::sample(&context, scene, &settings, plan, &mut |done| {
        progress.show(|| String::from("mirror images"), done);
        !interrupted.load(Ordering::Relaxed)
    })?;
    progress.finish();
    log::info!("mirror images sampled in {}", duration(start.elapsed()));
    scene.mirror_images = Some(Arc::new(images));
    Ok(())
}
