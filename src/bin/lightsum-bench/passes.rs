//! Repeated passes of one renderer.

use crate::report::{self, Fields};
use lightsum::{Renderer, Result};
use serde_json::{Value, json};

/// Times of the passes of one renderer, without the warm-up.
#[derive(Default)]
pub struct Passes {
    /// Seconds of each by the wall clock.
    pub seconds: Vec<f64>,
    /// Rays of each.
    pub rays: Vec<f64>,
    /// For each GPU pass, in order, its seconds in each of the passes.
    pub gpu: Vec<(String, Vec<f64>)>,
}

impl Passes {
    /// Renders one pass to warm up and then `repeats`.
    pub fn measure(renderer: &mut Renderer, repeats: u32) -> Result<Passes> {
        renderer.pass()?;
        let mut passes = Passes::default();
        for _ in 0..repeats {
            renderer.pass()?;
            let last = renderer.last_pass();
            passes.seconds.push(last.seconds);
            passes.rays.push(last.rays as f64);
            for (name, seconds) in &last.gpu_passes {
                match passes.gpu.iter_mut().find(|(known, _)| known == name) {
                    Some((_, all)) => all.push(*seconds),
                    None => passes.gpu.push((name.clone(), vec![*seconds])),
                }
            }
        }
        Ok(passes)
    }

    /// Median of the rays a second.
    pub fn rays_per_second(&self) -> f64 {
        let rates: Vec<f64> = self.rays.iter().zip(&self.seconds).map(|(rays, seconds)| rays / seconds).collect();
        report::median(&rates)
    }

    /// The fields of a JSON line: scene, settings and times.
    pub fn fields(&self, scene: &str, renderer: &Renderer) -> Fields {
        let (engine, gpu) = (renderer.engine(), &self.gpu);
        let p = engine.plan();
        let gpu_passes = gpu.iter().map(|(name, seconds)| {
            let mut pass = report::fields(report::summary(seconds));
            pass.insert("pass".into(), name.as_str().into());
            Value::Object(pass)
        });
        let mut fields = report::fields(json!({
            "scene": scene,
            "triangles": engine.bvh().triangle_count(),
            "nodes": engine.bvh().node_count(),
            "scene_bytes": engine.device_scene().bytes(),
            "resolution": p.view.size(),
            "lights": p.lights.slots(),
            "settings": report::settings(&p.settings),
            "kernel": kernel(renderer),
            "repeats": self.seconds.len(),
            "rays": report::median(&self.rays),
            "rays_per_second": self.rays_per_second(),
            "gpu_passes": gpu_passes.collect::<Vec<_>>(),
        }));
        fields.extend(report::fields(report::summary(&self.seconds)));
        fields
    }
}

/// The traversal kernel in use for shadow rays.
pub fn kernel(renderer: &Renderer) -> &'static str {
    match renderer.engine().device_scene().wide_nodes {
        Some(_) => "cluster",
        None => "single",
    }
}
