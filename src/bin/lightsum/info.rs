//! `lightsum info`: what a scene holds.

use crate::{args, say};
use lightsum::summary::Summary;
use lightsum::{Error, Result, scene};

/// Prints the summary of a scene.
pub fn run(args: &args::Info) -> Result<()> {
    let scene = scene::load_with(&args.scene, &args.reading.options())?;
    let summary = Summary::of(&scene)?;
    if args.json {
        let text = serde_json::to_string_pretty(&summary).map_err(|e| Error::file(&args.scene, e.to_string()))?;
        say(&text);
        return Ok(());
    }
    let Summary { name, triangles, objects, materials, textures, low, high, .. } = &summary;
    say(&format!(
        "{name}: {triangles} triangles in {objects} objects, {materials} materials, {} textures",
        textures.len()
    ));
    let size: Vec<String> = low.iter().zip(high).map(|(low, high)| format!("{:.4}", high - low)).collect();
    let at: Vec<String> = low.iter().zip(high).map(|(low, high)| format!("{:.4}", 0.5 * (low + high))).collect();
    say(&format!("size: {} around {}", size.join(" x "), at.join(", ")));
    match summary.camera {
        Some(camera) => {
            let [width, height] = camera.resolution;
            let eye = scene.to_world(camera.eye);
            let target = scene.to_world(camera.target);
            let shown = match camera.height {
                None => format!("{} degrees", camera.fov_y),
                Some(height) => format!("orthographic, {height} high"),
            };
            say(&format!("camera: from {eye:.4} to {target:.4}, {shown}, {width}x{height}"));
        }
        None => say("camera: none; the scene is framed from the front and above"),
    }
    if summary.cameras.len() > 1 {
        say(&format!("cameras by name: {}", summary.cameras.join(", ")));
    }
    for animation in &summary.animations {
        let [start, end] = animation.span;
        say(&format!("animation: {:?}, {:.3} s from {start:.3} s", animation.name, end - start));
    }
    say(&format!("lights: {}", watts(summary.power)));
    for light in &summary.lights {
        say(&format!("  {}: {}, {}", light.name, light.count, watts(light.power)));
    }
    for texture in textures {
        say(&format!("texture: {}, {}x{}", texture.name, texture.width, texture.height));
    }
    say(&format!("memory on a device: {:.1} MiB for the scene", summary.device_bytes as f64 / f64::from(1 << 20)));
    for what in &summary.ignored {
        say(&format!("left out: {what}"));
    }
    Ok(())
}

/// A power with four digits or more.
fn watts(power: f32) -> String {
    let digits = (3 - power.max(1e-6).log10().floor() as i32).clamp(0, 9) as usize;
    format!("{power:.digits$} W")
}
