//! A window that changes its size, a crop and two films that become one: the same scene on the device throughout.
//!
//! ```text
//! cargo run --release --example resize -- [SCENE.toml]
//! ```

use std::path::PathBuf;
use std::time::Instant;

use lightsum::view::Region;
use lightsum::{Camera, RenderOptions, Renderer, Settings, scene};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let path = std::env::args_os().nth(1).map_or_else(|| root.join("scenes/cornell/scene.toml"), PathBuf::from);
    let scene = scene::load(&path)?;
    let camera = Camera { resolution: [640, 480], ..scene.camera.ok_or("the scene has no camera")? };

    let start = Instant::now();
    let mut renderer = Renderer::new(scene, camera, Settings::interactive(), &RenderOptions::default())?;
    renderer.pass()?;
    println!("640x480: {:.0} ms with tree, uploads and pipelines", start.elapsed().as_secs_f64() * 1e3);

    // The tree, the scene's buffers and the pipelines stay; only buffers of the image's size are new.
    let start = Instant::now();
    renderer.engine_mut().resize([800, 600])?;
    println!("resized to 800x600 in {:.1} ms", start.elapsed().as_secs_f64() * 1e3);
    renderer.pass()?;
    let whole = renderer.layers()?;

    // A crop has the bits of the whole image.
    let crop = Region { origin: [300, 200], size: [64, 48] };
    renderer.set_crop(Some(crop))?;
    renderer.pass()?;
    assert_eq!(renderer.layers()?.color, whole.cut(crop).color);
    println!("the crop equals the image there");

    // Two films of two passes each add up to one of four.
    renderer.set_crop(None)?;
    renderer.engine_mut().restart();
    (0..2).try_for_each(|_| renderer.pass())?;
    let first = renderer.film()?;
    (0..2).try_for_each(|_| renderer.pass())?;
    let all = renderer.film()?.canonical();
    renderer.engine_mut().restart();
    renderer.engine_mut().set_passes(2);
    (0..2).try_for_each(|_| renderer.pass())?;
    let mut merged = renderer.film()?;
    merged.merge(&first)?;
    assert!(merged == all);
    println!("two films of two passes equal one of four");
    Ok(())
}
