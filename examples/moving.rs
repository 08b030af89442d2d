//! A scene that moves: one block of the Cornell box turns, then the image accumulates at rest.
//!
//! ```text
//! cargo run --release --example moving -- [FOLDER [PASSES]]
//! ```
//!
//! Edits go to the engine between two passes. A pass after an edit starts the image over; passes without one accumulate. With a
//! folder, each frame is written to it as a PNG file. PASSES: those of the last frame, at rest.

use std::error::Error;
use std::path::{Path, PathBuf};

use glam::{Affine3A, Quat, Vec3};
use lightsum::output::{self, Encoding, Metadata};
use lightsum::{Camera, RenderOptions, Renderer, Settings, scene};

/// Frames in which the block turns, and passes of each.
const FRAMES: u32 = 6;
const PASSES: u32 = 2;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1);
    let folder = arguments.next().map(PathBuf::from);
    let at_rest = arguments.next().map_or(Ok(16), |n| n.to_string_lossy().parse::<u32>())?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scene = scene::load(&root.join("scenes/cornell/scene.toml"))?;
    let camera = Camera { resolution: [240, 240], ..scene.camera.ok_or("the scene has no camera")? };
    let block = scene.objects_named("tall_block").first().copied().ok_or("the scene has no tall block")?;
    // The block turns about its own centre.
    let corners: Vec<Vec3> = (0..scene.triangles.len())
        .filter(|&i| scene.triangles[i].object == block)
        .flat_map(|i| scene.triangle_positions(i))
        .collect();
    let center = corners.iter().sum::<Vec3>() / corners.len() as f32;

    // Few passes a frame look smooth with the preset for interactive rates.
    let options = RenderOptions { dynamic: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(scene, camera, Settings::interactive(), &options)?;
    for frame in 0..=FRAMES {
        let angle = 90f32.to_radians() * frame as f32 / FRAMES as f32;
        let turn = Affine3A::from_translation(center)
            * Affine3A::from_quat(Quat::from_rotation_y(angle))
            * Affine3A::from_translation(-center);
        renderer.engine_mut().set_transform(block, turn)?;
        for _ in 0..if frame == FRAMES { at_rest } else { PASSES } {
            renderer.pass()?;
        }
        println!("frame {frame}: {} passes, the last in {:.3} s", renderer.passes(), renderer.last_pass().seconds);
        if let Some(folder) = &folder {
            std::fs::create_dir_all(folder)?;
            let file = folder.join(format!("moving-{frame:02}.png"));
            output::write(&file, &renderer.layers()?, &Metadata::default(), &Encoding::default())?;
        }
    }
    Ok(())
}
