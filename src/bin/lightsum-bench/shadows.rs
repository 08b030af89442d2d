//! `shadows`: soft shadows by convolution, by the width of the penumbrae, or of a scene by the number of emitters.

use crate::args::Shadows as Flags;
use crate::passes::Passes;
use crate::report::{self, Table, milliseconds};
use crate::scene;
use glam::Vec3;
use lightsum::scene::{Material, Scene, Triangle};
use lightsum::settings::{Settings, SoftShadows};
use lightsum::{Camera, Renderer, Result};
use serde_json::json;

/// Height of the boards above the floor, and of the lamp.
const HEIGHTS: [f32; 2] = [0.5, 2.5];
/// Edge of a board, and distance from one to the next.
const BOARD: [f32; 2] = [0.4, 0.7];
/// Boards across and down.
const BOARDS: u32 = 12;

/// Passes of the stage, in order; the first is the sum of the others.
const PASSES: [&str; 5] = ["soft_shadows", "soft_rays", "soft_blockers", "soft_search", "soft_convolve"];

/// A scene to measure.
struct Subject {
    name: String,
    scene: Scene,
    camera: Camera,
    emitters: u32,
    pixels: Option<u32>,
}

/// Adds a parallelogram whose front is the side of cross(u, v).
fn add_quad(scene: &mut Scene, corner: Vec3, u: Vec3, v: Vec3, material: u32) {
    let first = scene.positions.len() as u32;
    scene.positions.extend([corner, corner + u, corner + u + v, corner + v]);
    scene.normals.extend([u.cross(v).normalize(); 4]);
    scene.uvs.extend([glam::Vec2::ZERO; 4]);
    for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
        let vertices = [first + a, first + b, first + c];
        scene.triangles.push(Triangle { vertices, material, object: 0, smooth: false });
    }
}

/// Boards above a floor under a square lamp, whose penumbrae are so many pixels wide in the middle of the image.
fn boards(pixels: u32, resolution: [u32; 2]) -> Subject {
    let (eye, fov_y) = (Vec3::new(0.0, 4.0, -4.0), 40.0f32);
    let camera = Camera {
        eye,
        target: Vec3::ZERO,
        up: Vec3::Y,
        fov_y,
        resolution,
        aperture: 0.0,
        focus: None,
        shutter: 0.0,
        height: None,
        frustum: None,
    };
    let unit = 0.5 * resolution[1] as f32 / (0.5 * fov_y.to_radians()).tan() / eye.length();
    let [low, high] = HEIGHTS;
    let lamp = pixels as f32 / unit * (high - low) / low;
    let mut scene = Scene { name: format!("boards:{pixels}"), objects: vec![String::from("all")], ..Scene::default() };
    scene.materials = vec![
        Material { base_color: Vec3::splat(0.7), ..Material::default() },
        Material { base_color: Vec3::ZERO, emission: Vec3::splat(4.0 / lamp.powi(2)), ..Material::default() },
    ];
    add_quad(&mut scene, Vec3::new(-8.0, 0.0, -8.0), Vec3::Z * 16.0, Vec3::X * 16.0, 0);
    add_quad(&mut scene, Vec3::new(-0.5 * lamp, high, -0.5 * lamp), Vec3::X * lamp, Vec3::Z * lamp, 1);
    let [edge, step] = BOARD;
    for i in 0..BOARDS * BOARDS {
        let [x, z] = [i % BOARDS, i / BOARDS].map(|k| (k as f32 - 0.5 * (BOARDS - 1) as f32) * step - 0.5 * edge);
        add_quad(&mut scene, Vec3::new(x, low, z), Vec3::Z * edge, Vec3::X * edge, 0);
    }
    Subject { name: scene.name.clone(), scene, camera, emitters: 1, pixels: Some(pixels) }
}

/// The scenes that are asked for.
fn subjects(args: &Flags) -> Result<Vec<Subject>> {
    let resolution = args.common.resolution;
    let Some(name) = &args.scene else {
        return Ok(args.pixels.iter().map(|&pixels| boards(pixels, resolution)).collect());
    };
    let loaded = scene::load(name)?;
    let of = |&emitters: &u32| Subject {
        name: name.clone(),
        camera: scene::camera(&loaded, resolution),
        scene: loaded.clone(),
        emitters,
        pixels: None,
    };
    Ok(args.lights.iter().map(of).collect())
}

/// Runs the command.
pub fn run(args: &Flags) -> Result<()> {
    scene::check(args.scene.as_slice())?;
    let context = scene::open(&args.common)?;
    let environment = report::environment(context.info());
    let subjects = subjects(args)?;
    let columns = [
        ("scene", 30),
        ("emitters", 8),
        ("rays ms", 7),
        ("blockers ms", 11),
        ("search ms", 9),
        ("convolve ms", 11),
        ("all ms", 7),
        ("shade ms", 8),
        ("frame ms", 8),
    ];
    let table = match args.common.json {
        true => None,
        false => {
            report::print_environment(&environment)?;
            Some(Table::head(&columns)?)
        }
    };
    for subject in subjects {
        let Subject { name, scene, camera, emitters, pixels } = subject;
        let soft_shadows = (emitters > 0).then_some(SoftShadows { lights: emitters });
        let settings = Settings { soft_shadows, ..Settings::interactive() };
        let mut renderer = Renderer::with_context(context.clone(), scene, camera, settings)?;
        let emitters = renderer.engine().plan().soft_emitters.len();
        let passes = Passes::measure(&mut renderer, args.common.repeats)?;
        // A pass has a part for each emitter.
        let of = |name: &str| {
            let found = passes.gpu.iter().find(|(pass, _)| pass == name).map_or(&[][..], |(_, seconds)| seconds);
            let parts = (found.len() / args.common.repeats as usize).max(1);
            report::median(&found.chunks(parts).map(|parts| parts.iter().sum()).collect::<Vec<f64>>())
        };
        let [all, rays, blockers, search, convolve] = PASSES.map(of);
        let (shade, frame) = (of("shade"), report::median(&passes.seconds));
        if let Some(table) = &table {
            let times = [rays, blockers, search, convolve, all, shade, frame].map(milliseconds);
            table.row(&[vec![name, emitters.to_string()], times.to_vec()].concat())?;
        } else {
            let line = json!({
                "mode": "shadows",
                "scene": name,
                "resolution": args.common.resolution,
                "repeats": args.common.repeats,
                "emitters": emitters,
                "pixels": pixels,
                "rays_seconds": rays,
                "blockers_seconds": blockers,
                "search_seconds": search,
                "convolve_seconds": convolve,
                "all_seconds": all,
                "shade_seconds": shade,
                "frame_seconds": frame,
            });
            report::print_json(line, &environment)?;
        }
    }
    Ok(())
}
