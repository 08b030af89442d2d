//! Times of the GPU passes, and the layers (AOVs) of the image.
//!
//! ```text
//! cargo run --release --example passes -- [SCENE [LAYERS.exr]]
//! ```

use std::error::Error;
use std::path::PathBuf;

use glam::Vec3;
use lightsum::output::{self, Encoding, Metadata};
use lightsum::{Camera, RenderOptions, Renderer, Settings, scene};

/// Passes after the first, in which drivers may compile.
const PASSES: u32 = 8;

fn main() -> Result<(), Box<dyn Error>> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let file = arguments.next().unwrap_or_else(|| root.join("scenes/cornell/scene.toml"));
    let image = arguments.next();

    let scene = scene::load(&file)?;
    let camera = scene.camera.unwrap_or_else(|| scene.framed([640, 480], None));
    let camera = Camera { resolution: [320, 240], ..camera };
    // Emission, diffuse and specular light as layers of their own.
    let settings = Settings { summands: true, ..Settings::default().with_scene_defaults(&scene.render) };
    let mut renderer = Renderer::new(scene, camera, settings, &RenderOptions::default())?;

    renderer.pass()?;
    let mut times: Vec<(String, f64)> = Vec::new();
    for _ in 0..PASSES {
        renderer.pass()?;
        for (name, seconds) in &renderer.last_pass().gpu_passes {
            match times.iter_mut().find(|(known, _)| known == name) {
                Some((_, sum)) => *sum += seconds,
                None => times.push((name.clone(), *seconds)),
            }
        }
    }
    println!("{:<16} {:>9}", "GPU pass", "mean ms");
    for (name, sum) in &times {
        println!("{name:<16} {:>9.3}", 1e3 * sum / f64::from(PASSES));
    }

    let layers = renderer.layers()?;
    println!("\n{:<16} mean over the image", "layer");
    for (name, values) in [
        ("color", &layers.color),
        ("emission", &layers.emission),
        ("diffuse", &layers.diffuse),
        ("specular", &layers.specular),
        ("direct", &layers.direct),
        ("indirect", &layers.indirect),
        ("albedo", &layers.albedo),
    ] {
        let mean = values.iter().sum::<Vec3>() / values.len().max(1) as f32;
        println!("{name:<16} {:.4} {:.4} {:.4}", mean.x, mean.y, mean.z);
    }
    if let Some(image) = image {
        output::write(&image, &layers, &Metadata::default(), &Encoding::default())?;
        println!("wrote {}", image.display());
    }
    Ok(())
}
