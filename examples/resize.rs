//! A window that changes its size, a crop and two films that become one: the same scene on the device throughout.
//!
//! ```text
//! cargo run --release --example resize -- [SCENE.toml]
//! ```

use std::path::PathBuf;
use std::time::Instant;

use lightsum::view::Region;
use lightsum::{RenderOptions, Renderer, Settings, scene};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let path = std::env::args_os().nth(1).map_or_else(|| root.join("scenes/cornell/scene.toml"), PathBuf::from);
    let scene = scene::load(&path)?;
    let camera = scene.camera.ok_or("the scene has no camera")?;
    let [width, height] = camera.resolution;

    let start = Instant::now();
    let mut renderer = Renderer::new(scene, camera, Settings::interactive(), &RenderOptions::default())?;
    renderer.pass()?;
    println!("{width}x{height}: {:.0} ms with tree, uploads and pipelines", start.elapsed().as_secs_f64() * 1e3);

    // The tree, the scene's buffers and the pipelines stay; only buffers of the image's size are new.
    let start = Instant::now();
    let larger = [width, height].map(|n| n * 5 / 4);
    renderer.engine_mut().resize(larger)?;
    println!("resized to {}x{} in {:.1} ms", larger[0], larger[1], start.elapsed().as_secs_f64() * 1e3);
    renderer.pass()?;
    let whole = renderer.layers()?;

    // A crop has the bits of the whole image.
    let crop = Region { origin: [width / 2, height / 3], size: [width, height].map(|n| n.div_ceil(10)) };
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
    for number in 2..4 {
        renderer.pass_of(number)?;
    }
    let mut merged = renderer.film()?;
    merged.merge(&first)?;
    assert!(merged == all);
    println!("two films of two passes equal one of four");
    Ok(())
}
