//! `motion`: motion blur, by the number of pixels that the middle of the image moves and by what the camera does.

use crate::args::Motion as Flags;
use crate::passes::Passes;
use crate::report::{self, Table, milliseconds, percent};
use crate::scene;
use lightsum::engine::ShutterEnd;
use lightsum::settings::Settings;
use lightsum::{Camera, Renderer, Result};
use serde_json::json;

/// The camera `pixels` pixels of motion from its place, from -1/2 to 1/2 of them as `part` goes; by `how` it turns, or moves sideways or onwards.
fn moved(camera: Camera, how: &str, pixels: f32, part: f32) -> Camera {
    let (right, _, forward) = camera.world_from_camera();
    let [width, height] = camera.resolution.map(|n| n as f32);
    let distance = (camera.target - camera.eye).length();
    let focal = 0.5 * height / camera.half_extents()[1];
    match how {
        "turn" => Camera { target: camera.target + right * (part * pixels / focal * distance), ..camera },
        "sideways" => {
            let by = right * (part * pixels / focal * distance);
            Camera { eye: camera.eye + by, target: camera.target + by, ..camera }
        }
        // A point at the distance of the target, at the left or right edge of the image, moves by `pixels`.
        _ => Camera { eye: camera.eye + forward * (part * pixels / (0.5 * width) * distance), ..camera },
    }
}

/// Runs the command.
pub fn run(args: &Flags) -> Result<()> {
    scene::check(std::slice::from_ref(&args.scene))?;
    let context = scene::open(&args.common)?;
    let environment = report::environment(context.info());
    let loaded = scene::load(&args.scene)?;
    let camera = Camera { shutter: 1.0, ..scene::camera(&loaded, args.common.resolution) };
    let mut renderer = Renderer::with_context(context, loaded, camera, Settings::interactive())?;
    let columns = [("camera", 10), ("pixels", 6), ("velocity ms", 11), ("+-", 5), ("motion blur ms", 14), ("+-", 5)];
    let table = match args.common.json {
        true => None,
        false => {
            report::print_environment(&environment)?;
            Some(Table::head(&columns)?)
        }
    };
    for how in &args.camera {
        for &pixels in &args.pixels {
            let end = |part| ShutterEnd { camera: moved(camera, how, pixels as f32, part), objects: Vec::new() };
            renderer.set_shutter_ends(Some([end(-0.5), end(0.5)]))?;
            let passes = Passes::measure(&mut renderer, args.common.repeats)?;
            let of = |name: &str| {
                let found = passes.gpu.iter().find(|(pass, _)| pass == name);
                found.map_or((0.0, 0.0), |(_, seconds)| (report::median(seconds), report::spread(seconds)))
            };
            let (velocity, blur) = (of("velocity"), of("motion_blur"));
            if let Some(table) = &table {
                let times = [velocity, blur].map(|(median, spread)| [milliseconds(median), percent(spread)]);
                let cells = [vec![how.clone(), pixels.to_string()], times.concat()].concat();
                table.row(&cells)?;
            } else {
                let line = json!({
                    "mode": "motion",
                    "scene": args.scene,
                    "resolution": args.common.resolution,
                    "repeats": args.common.repeats,
                    "camera": how,
                    "pixels": pixels,
                    "velocity_seconds": velocity.0,
                    "motion_blur_seconds": blur.0,
                    "spread": blur.1,
                });
                report::print_json(line, &environment)?;
            }
        }
    }
    Ok(())
}
