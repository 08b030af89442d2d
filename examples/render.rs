//! A scene file to an EXR or PNG file.
//!
//! ```text
//! cargo run --release --example render -- [SCENE [IMAGE.exr [PASSES]]]
//! ```
//!
//! The shortest way to use the library: [`Renderer`] opens a device of its own, renders pass by pass and reads the image back.

use std::error::Error;
use std::path::PathBuf;

use lightsum::output::{self, Encoding, Metadata};
use lightsum::{Camera, RenderOptions, Renderer, Settings, scene};

fn main() -> Result<(), Box<dyn Error>> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let mut arguments = std::env::args_os().skip(1);
    let file = arguments.next().map_or_else(|| root.join("scenes/cornell/scene.toml"), PathBuf::from);
    let image = arguments.next().map_or_else(|| PathBuf::from("render.exr"), PathBuf::from);
    let passes = arguments.next().map_or(Ok(16), |n| n.to_string_lossy().parse::<u32>())?;

    let scene = scene::load(&file)?;
    // A bare model may have no camera.
    let camera = scene.camera.unwrap_or_else(|| scene.framed([640, 480], None));
    let camera = Camera { resolution: [320, 240], ..camera };
    // `[render]` of the scene file over the defaults; a program's own choices come last.
    let settings = Settings { seed: 1, ..Settings::default().with_scene_defaults(&scene.render) };

    let name = scene.name.clone();
    let mut renderer = Renderer::new(scene, camera, settings, &RenderOptions::default())?;
    for _ in 0..passes {
        renderer.pass()?;
    }
    if let Some(error) = renderer.error_estimate() {
        println!("{} passes, estimated relative RMSE {error:.4}", renderer.passes());
    }

    let metadata = Metadata { scene: name, passes: renderer.passes(), ..Metadata::default() };
    output::write(&image, &renderer.layers()?, &metadata, &Encoding::default())?;
    println!("wrote {}", image.display());
    Ok(())
}
