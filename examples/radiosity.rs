//! Table 5.1 and figure 5.20 of Bastos 1999 in the making of this engine: see docs/radiosity.md.
//!
//! ```sh
//! cargo run --release --example radiosity -- table [ELEMENTS [FRAMES]]
//! cargo run --release --example radiosity -- figure radiosity.png [HEIGHT]
//! ```
//!
//! ELEMENTS: the most that the light is kept on, 100,000 in the documentation. FRAMES: those of which the middle time is
//! told, 16 there. HEIGHT: that of the tree of the reference, 9 there.

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use glam::{Vec2, Vec3};
use lightsum::bake;
use lightsum::gpu::Context;
use lightsum::radiosity::quadtree::Shape;
use lightsum::radiosity::reconstruct::{bilinear, fill, filter, hermite, mitchell};
use lightsum::radiosity::texture::Grid;
use lightsum::radiosity::{Options, Radiosity, TextureOptions};
use lightsum::scene::{Camera, KeptFace, KeptLight, KeptPage, Material, Scene, Triangle};
use lightsum::settings::{Clip, Compensation, Lookup, Settings};
use lightsum::standalone::{self, RenderOptions, Renderer};
use lightsum::view::Texel;

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let settings =
        Settings { particles: 64, clip: Clip::Distance(0.1), compensation: Compensation::Off, ..Settings::plain() };
    let (context, settings) = standalone::open(settings, &RenderOptions::default())?;
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["table"] => table(&context, &settings, 100_000, 16),
        ["table", elements] => table(&context, &settings, elements.parse()?, 16),
        ["table", elements, frames] => table(&context, &settings, elements.parse()?, frames.parse::<u32>()?.max(1)),
        ["figure", path] => figure(&context, &settings, path, 9),
        ["figure", path, height] => figure(&context, &settings, path, height.parse::<u8>()?.clamp(3, 9)),
        _ => Err("expected: table, or figure FILE.png".into()),
    }
}

fn material(scene: &mut Scene, albedo: f32, emission: f32) -> u32 {
    let (base_color, emission) = (Vec3::splat(albedo), Vec3::splat(emission));
    scene.materials.push(Material { base_color, emission, ..Material::default() });
    scene.materials.len() as u32 - 1
}

fn quad(scene: &mut Scene, corners: [Vec3; 4], material: u32) {
    let first = scene.positions.len() as u32;
    scene.positions.extend(corners);
    scene.normals.extend([Vec3::Y; 4]);
    scene.uvs.extend([Vec2::ZERO; 4]);
    for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
        let vertices = [first + a, first + b, first + c];
        scene.triangles.push(Triangle { vertices, material, object: 0, smooth: false });
    }
}

/// A hall of 452 quadrilaterals: room, two lamps, 74 columns of six faces.
fn hall() -> Scene {
    let mut scene = Scene { name: String::from("hall"), ..Scene::default() };
    scene.objects.push(String::from("hall"));
    let (white, grey, lamp) =
        (material(&mut scene, 0.7, 0.0), material(&mut scene, 0.5, 0.0), material(&mut scene, 0.0, 30.0));
    let mut cuboid = |low: Vec3, high: Vec3, inside: bool, material: u32| {
        for axis in 0..3 {
            let [x, y] = [1, 2].map(|k| Vec3::AXES[(axis + k) % 3]);
            let [size_x, size_y] = [x, y].map(|a| a * (high - low));
            for (end, front) in [(low, inside), (high - size_x - size_y, !inside)] {
                let (u, v) = if front { (size_x, size_y) } else { (size_y, size_x) };
                quad(&mut scene, [end, end + u, end + u + v, end + v], material);
            }
        }
    };
    cuboid(Vec3::ZERO, Vec3::new(20.0, 5.0, 16.0), true, white);
    for i in 0..74 {
        let (column, row) = (i % 10, i / 10);
        let height = 0.6 + 0.37 * ((i * 7) % 11) as f32;
        let low = Vec3::new(1.2 + 1.8 * column as f32, 0.0, 1.2 + 1.9 * row as f32);
        cuboid(low, low + Vec3::new(0.5, height, 0.5), false, grey);
    }
    for x in [5.0, 14.0] {
        let low = Vec3::new(x, 4.98, 7.0);
        quad(&mut scene, [low, low + Vec3::X, low + Vec3::X + 2.0 * Vec3::Z, low + 2.0 * Vec3::Z], lamp);
    }
    scene.camera = Some(Camera {
        eye: Vec3::new(0.6, 4.2, 15.4),
        target: Vec3::new(11.0, 1.0, 6.0),
        up: Vec3::Y,
        fov_y: 65.0,
        resolution: [640, 480],
        aperture: 0.0,
        focus: None,
        shutter: 0.0,
        height: None,
        frustum: None,
    });
    scene
}

/// Bytes of a scene's geometry, and of its kept light on the device.
fn bytes(scene: &Scene, kept: &KeptLight) -> [usize; 2] {
    let geometry = scene.positions.len() * 32 + scene.triangles.len() * size_of::<Triangle>();
    let texels: usize = kept.pages.iter().map(|page| page.direct.len() * 12).sum();
    [geometry, texels]
}

fn table(context: &Context, settings: &Settings, elements: usize, repeats: u32) -> Outcome<()> {
    let scene = hall();
    let radiosity = Radiosity::new(context, &scene, settings.clone())?;
    let options = Options { epsilon: 0.1, height: 7, elements, ..Options::default() };
    let (solution, times) = radiosity.refine(&options, 8, &mut |_| true)?;
    for (i, round) in solution.rounds.iter().enumerate() {
        println!("round {i}: {} points, {} splits", round.points, round.splits);
    }
    println!("{} surfaces, {} leaves, {} points", radiosity.surfaces().len(), solution.elements(), solution.points());
    println!("passes {:.1} s, preparing them {:.1} s, host {:.1} s", times.passes, times.prepare, times.host);
    // As many uniform leaves on every surface as the deepest tree has, and those of a mean height.
    let full: usize = solution.trees.iter().map(|tree| 1usize << (2 * tree.height())).sum();
    println!("full trees of the same heights would have {full} leaves");

    let textures = TextureOptions { budget: 1 << 19, filter: 2 };
    let light = radiosity.lightmap(&solution, &textures, &bake::Options::default())?;
    let count = radiosity.surfaces().iter().zip(&solution.trees).filter(|(_, tree)| tree.height() > 0).count();
    let kept = light.kept(&scene);

    // The elements as polygons, with the light of their corners: 2 x 2 texels each.
    let mut mesh =
        Scene { positions: Vec::new(), normals: Vec::new(), uvs: Vec::new(), triangles: Vec::new(), ..scene.clone() };
    let (mut faces, mut values) = (Vec::new(), Vec::new());
    let place = |surface: &lightsum::radiosity::surfaces::Surface, at: [f32; 2]| {
        let Texel { triangle, uv: [u, v], .. } = surface.texel(at, 20);
        let [a, b, c] = scene.triangle_positions(triangle as usize);
        a + u * (b - a) + v * (c - a)
    };
    for (i, (surface, tree)) in radiosity.surfaces().iter().zip(&solution.trees).enumerate() {
        let height = options.height;
        for (_, element) in tree.leaves().filter(|_| surface.root.shape == Shape::Quad) {
            let corners: Vec<[u32; 2]> = element.corners(Shape::Quad, height).collect();
            let scale = f32::from(1u16 << height);
            let mut positions = corners.iter().map(|c| place(surface, c.map(|n| n as f32 / scale)));
            let positions = std::array::from_fn(|_| positions.next().unwrap_or_default());
            quad(&mut mesh, positions, scene.triangles[surface.faces[0].0 as usize].material);
            let x = 2.0 * (faces.len() / 2) as f32 + 0.5;
            let at = [[x, 0.5], [x + 1.0, 0.5], [x + 1.0, 1.5], [x, 1.5]].map(Vec2::from_array);
            for corners in [[at[0], at[1], at[2]], [at[0], at[2], at[3]]] {
                let mut face = [None; 2];
                face[usize::from(surface.back)] = Some((corners, 0));
                faces.push(face);
            }
            values.push(
                corners
                    .iter()
                    .map(|&c| solution.vertex(i, c, height).flatten().unwrap_or_default())
                    .collect::<Vec<_>>(),
            );
        }
    }
    let lit: std::collections::HashSet<u32> =
        radiosity.surfaces().iter().flat_map(|surface| surface.faces.iter().map(|face| face.0)).collect();
    for triangle in (0..scene.triangles.len() as u32).filter(|t| !lit.contains(t)) {
        // Lamps, and what no light reaches.
        let first = mesh.positions.len() as u32;
        let own = &scene.triangles[triangle as usize];
        mesh.positions.extend(scene.triangle_positions(triangle as usize));
        mesh.normals.extend([Vec3::Y; 3]);
        mesh.uvs.extend([Vec2::ZERO; 3]);
        mesh.triangles.push(Triangle { vertices: [first, first + 1, first + 2], ..*own });
        faces.push([None; 2]);
    }
    // Rows of 1024 elements, so that pages stay small.
    let columns = 1024.min(values.len());
    let size = [2 * columns as u32, 2 * values.len().div_ceil(columns) as u32];
    let mut page = KeptPage { size, direct: vec![Vec3::ZERO; (size[0] * size[1]) as usize], indirect: Vec::new() };
    page.indirect = page.direct.clone();
    for (n, corners) in values.iter().enumerate() {
        let [x, y] = [2 * (n % columns), 2 * (n / columns)];
        for ([dx, dy], light) in [[0, 0], [1, 0], [1, 1], [0, 1]].into_iter().zip(corners) {
            let at = x + dx + (y + dy) * size[0] as usize;
            (page.direct[at], page.indirect[at]) = (light.direct, light.indirect);
        }
    }
    let moved = |(corners, page): ([Vec2; 3], u32), n: usize| {
        let offset = Vec2::new(-2.0 * (n / columns * columns) as f32, 2.0 * (n / columns) as f32);
        KeptFace { page, corners: corners.map(|c| c + offset) }
    };
    let faces: Vec<[Option<KeptFace>; 2]> =
        faces.into_iter().enumerate().map(|(t, face)| face.map(|f| f.map(|f| moved(f, t / 2)))).collect();
    let kept_mesh = KeptLight { faces, pages: vec![page] };

    let quads = |scene: &Scene| scene.triangles.len() / 2;
    println!("\nmodel | polygons | geometry, bytes | light, bytes | textures | frame, ms");
    for (name, scene, kept, textures, lookup) in [
        ("subdivided", &mesh, &kept_mesh, 0, Lookup::Bilinear),
        ("textures, bilinear", &scene, &kept, count, Lookup::Bilinear),
        ("textures, bicubic", &scene, &kept, count, Lookup::Bicubic),
    ] {
        let [geometry, texels] = bytes(scene, kept);
        let shown = Scene { kept_light: Some(Arc::new(kept.clone())), ..scene.clone() };
        let Some(camera) = shown.camera else { continue };
        let settings = Settings { lookup, ..settings.clone() };
        let mut renderer = Renderer::with_context(context.clone(), shown, camera, settings)?;
        let mut frames: Vec<f64> = Vec::new();
        for _ in 0..repeats {
            let start = Instant::now();
            renderer.pass()?;
            frames.push(1000.0 * start.elapsed().as_secs_f64());
        }
        frames.sort_by(f64::total_cmp);
        println!("{name} | {} | {geometry} | {texels} | {textures} | {:.0}", quads(scene), frames[frames.len() / 2]);
    }
    Ok(())
}

/// Side of a picture.
const SHOWN: usize = 128;

/// A way to rebuild the light: its name and its value at a point of the wall.
type Way = (String, Box<dyn Fn([f32; 2]) -> f32>);

fn figure(context: &Context, settings: &Settings, path: &str, height: u8) -> Outcome<()> {
    // Vertices along a side of the reference.
    let side = (1usize << height) + 1;
    // A wall, its floor, and a lamp before the wall.
    let mut scene = Scene { name: String::from("wall"), ..Scene::default() };
    scene.objects.push(String::from("wall"));
    let (white, lamp) = (material(&mut scene, 0.7, 0.0), material(&mut scene, 0.0, 20.0));
    quad(&mut scene, [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y], white);
    quad(&mut scene, [Vec3::ZERO, Vec3::Z, Vec3::Z + Vec3::X, Vec3::X], white);
    let low = Vec3::new(0.2, 0.62, 0.22);
    quad(&mut scene, [low, low + 0.12 * Vec3::Y, low + Vec3::new(0.12, 0.12, 0.0), low + 0.12 * Vec3::X], lamp);
    let radiosity = Radiosity::new(context, &scene, Settings { direct_lights: Some(64), ..settings.clone() })?;
    let wall = &radiosity.surfaces()[0];
    let at = |i: usize| wall.texel([i % side, i / side].map(|n| n as f32 / (side - 1) as f32), height);
    let points: Vec<Texel> = (0..side * side).map(at).collect();
    let light = radiosity.light(&points, 4, &mut |_| true)?;
    let values = light.iter().map(|light| light.total().x).collect();
    let reference = Grid { size: [side; 2], values };
    let sampled = |height: u8| {
        let step = (side - 1) >> height;
        let reference = reference.clone();
        move |[x, y]: [u32; 2]| reference.at([x as usize * step, y as usize * step])
    };
    let of = sampled(2);
    let coarse = fill(Shape::Quad, 2, |at| Some(of(at)));
    // 5 x 5 samples, the rest by bicubic patches.
    let resampled =
        fill(Shape::Quad, 3, |[x, y]| (x % 2 == 0 && y % 2 == 0).then(|| coarse.at([x as usize / 2, y as usize / 2])));
    let look = |grid: Grid<f32>, look_up: fn(&Grid<f32>, [f32; 2]) -> f32| -> Box<dyn Fn([f32; 2]) -> f32> {
        let scale = (grid.size[0] - 1) as f32;
        Box::new(move |at| look_up(&grid, at.map(|c| c * scale)))
    };
    let mut ways: Vec<Way> = vec![
        (format!("reference, height {height}"), look(reference.clone(), bilinear)),
        (String::from("5 x 5, bilinear"), look(coarse.clone(), bilinear)),
        (String::from("5 x 5, bicubic patches"), look(coarse, hermite)),
    ];
    for width in 2..=6 {
        let grid = filter(&resampled, Shape::Quad, width);
        ways.push((format!("9 x 9, pre-filter {width} x {width}, bilinear"), look(grid, bilinear)));
    }
    ways.push((String::from("9 x 9, no pre-filter, Mitchell"), look(resampled, mitchell)));

    let mean = reference.values.iter().sum::<f32>() / (side * side) as f32;
    let greatest = reference.values.iter().fold(0.0f32, |a, b| a.max(*b));
    let mut picture = image::GrayImage::new(((SHOWN + 4) * ways.len()) as u32, SHOWN as u32);
    println!("way | RMS error / mean | greatest bend / mean");
    for (n, (name, value)) in ways.iter().enumerate() {
        let mut square = 0.0;
        for (i, expected) in reference.values.iter().enumerate() {
            square += f64::from(value([i % side, i / side].map(|n| n as f32 / (side - 1) as f32)) - expected).powi(2);
        }
        // The bend at a line of texels: the change of the slope there, times the width of a cell of 9 x 9.
        let mut bend = 0.0f32;
        for i in 0..64 * 7 {
            let (t, line) = ((i / 7) as f32 / 63.0, ((i % 7) as f32 + 1.0) / 8.0);
            const D: f32 = 1.0 / 512.0;
            for at in [|x: f32, t: f32| [x, t], |x: f32, t: f32| [t, x]] {
                let [low, middle, high] = [-D, 0.0, D].map(|d| value(at(line + d, t)));
                bend = bend.max((low - 2.0 * middle + high).abs() / D / 8.0);
            }
        }
        println!("{name} | {:.4} | {:.3}", (square / (side * side) as f64).sqrt() / f64::from(mean), bend / mean);
        for y in 0..SHOWN {
            for x in 0..SHOWN {
                let at = [x as f32 / (SHOWN - 1) as f32, 1.0 - y as f32 / (SHOWN - 1) as f32];
                let shown = (value(at) / greatest).clamp(0.0, 1.0).powf(1.0 / 2.2);
                picture.put_pixel((x + n * (SHOWN + 4)) as u32, y as u32, image::Luma([(255.0 * shown) as u8]));
            }
        }
    }
    picture.save(path)?;
    Ok(())
}
