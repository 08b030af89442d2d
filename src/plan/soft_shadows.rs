//! The emitters whose shadows are convolved.

use crate::bsdf::mean;
use crate::device_scene::DeviceScene;
use crate::error::{Error, Result};
use crate::light::emitters::{Emitters, Kind};
use crate::settings::Settings;
use crate::view::View;

/// Numbers of the emitters whose shadows are convolved; empty: none. Errors: the scene cannot have them.
pub(super) fn emitters(settings: &Settings, scene: &DeviceScene, view: &View) -> Result<Vec<u32>> {
    let Some(soft) = settings.soft_shadows.filter(|_| view.camera().is_some() && settings.max_depth > 1) else {
        return Ok(Vec::new());
    };
    let refused = |message: &str| Err(Error::Setting { name: "--soft-shadows", message: message.to_owned() });
    if scene.kept_light.is_some() {
        return refused("kept light holds its shadows already; use off, or leave out --light-from");
    }
    if scene.lights_are_complete {
        return refused("the scene's imported lights hold the light of its emitters already; use off");
    }
    if scene.has_alpha {
        return refused("some surfaces of the scene let light pass, which a hard shadow cannot show; use off");
    }
    let chosen = largest(&scene.emitters, soft.lights);
    if chosen.is_empty() {
        log::info!("no soft shadows by convolution: no emitter is a parallelogram that emits evenly from one side");
    }
    Ok(chosen)
}

/// The emitters of greatest power among the parallelograms that emit evenly from one side, at most `most`; the first of equal ones first.
fn largest(emitters: &Emitters, most: u32) -> Vec<u32> {
    let fits = |i: &u32| {
        let e = &emitters.list[*i as usize];
        e.kind == Kind::Quad && !e.two_sided && e.pattern.is_none() && mean(e.power) > 0.0
    };
    let power = |i: u32| mean(emitters.list[i as usize].power);
    let mut chosen: Vec<u32> = (0..emitters.list.len() as u32).filter(fits).collect();
    chosen.sort_by(|&a, &b| power(b).total_cmp(&power(a)));
    chosen.truncate(most as usize);
    chosen
}
