//! `edits`: cost of moving an object, by the CPU's clock and, for the upload, by GPU timestamps.
//!
//! The object moves by a hundredth of the scene's diagonal, there and back in turn; a pass is rendered after each move.

use crate::args::Edits;
use crate::report::{self, Table, milliseconds, percent};
use crate::scene;
use glam::{Affine3A, Vec3};
use lightsum::settings::Settings;
use lightsum::{Error, Renderer, Result, Scene};
use serde_json::{Value, json};

/// The measured steps in order: key and label in the table.
const STEPS: [(&str, &str); 7] = [
    ("vertices", "check and move vertices"),
    ("refit", "triangles and tree of the object"),
    ("top_level", "tree over the objects"),
    ("lights", "emitters and particles"),
    ("staging", "staging"),
    ("upload", "copies on the device"),
    ("pass", "the pass after it, copies included"),
];

/// Runs the command.
pub fn run(args: &Edits) -> Result<()> {
    scene::check(&args.scenes)?;
    let context = scene::open(&args.common)?;
    let environment = report::environment(context.info());
    if !args.common.json {
        report::print_environment(&environment)?;
    }
    for name in &args.scenes {
        let scene = scene::load(name)?;
        let object = choose(&scene, args.object.as_deref())?;
        let own = scene.triangles.iter().filter(|t| t.object == object).count();
        let (triangles, objects, what) =
            (scene.triangles.len(), scene.objects.len(), scene.objects[object as usize].clone());
        let camera = scene::camera(&scene, args.common.resolution);
        let settings = Settings::default().with_scene_defaults(&scene.render);
        let mut renderer = Renderer::with_context_dynamic(context.clone(), scene, camera, settings)?;
        let mut times: [Vec<f64>; STEPS.len()] = Default::default();
        let step = Vec3::splat(0.01 * renderer.engine().bvh().diagonal());
        renderer.pass()?;
        for repeat in 0..=args.common.repeats {
            let place = if repeat % 2 == 0 { step } else { Vec3::ZERO };
            renderer.engine_mut().set_transform(object, Affine3A::from_translation(place))?;
            renderer.pass()?;
            let (edit, pass) = (renderer.engine().edit_times(), renderer.last_pass());
            let upload = pass.gpu_passes.iter().find(|(name, _)| name == "upload").map_or(0.0, |(_, s)| *s);
            let all = [edit.vertices, edit.refit, edit.top_level, edit.lights, edit.staging, upload, pass.seconds];
            if repeat > 0 {
                times.iter_mut().zip(all).for_each(|(times, seconds)| times.push(seconds));
            }
        }
        let bytes = renderer.engine().edit_times().bytes;
        if args.common.json {
            let mut line = report::fields(json!({
                "mode": "edits",
                "scene": name,
                "triangles": triangles,
                "objects": objects,
                "object": what,
                "object_triangles": own,
                "bytes": bytes,
                "repeats": args.common.repeats,
            }));
            line.extend(STEPS.iter().zip(&times).map(|((key, _), times)| (key.to_string(), report::summary(times))));
            report::print_json(Value::Object(line), &environment)?;
            continue;
        }
        report::say("")?;
        report::say(&format!(
            "{name}: {triangles} triangles, {objects} objects; {what:?} of {own} moves, {bytes} bytes are uploaded"
        ))?;
        let table = Table::head(&[("step", 36), ("median ms", 9), ("+-", 5)])?;
        for ((_, what), times) in STEPS.iter().zip(&times) {
            table.row(&[(*what).to_owned(), milliseconds(report::median(times)), percent(report::spread(times))])?;
        }
    }
    Ok(())
}

/// The object of this name, or the one with the most triangles.
fn choose(scene: &Scene, name: Option<&str>) -> Result<u32> {
    if let Some(name) = name {
        return scene.objects_named(name).first().copied().ok_or_else(|| Error::Setting {
            name: "--object",
            message: format!("the scene has no object {name:?}; the nearest are {}", scene.objects_like(name)),
        });
    }
    let mut counts = vec![0u32; scene.objects.len()];
    scene.triangles.iter().for_each(|t| counts[t.object as usize] += 1);
    // Every loaded scene has triangles, hence an object.
    Ok((0..).zip(counts).max_by_key(|&(_, count)| count).map_or(0, |(object, _)| object))
}
