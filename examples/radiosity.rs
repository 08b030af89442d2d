//! Table 5.1 and figures 5.20 and 5.21 of Bastos 1999 in the making of this engine: see docs/radiosity.md.
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
use lightsum::radiosity::reconstruct::{bilinear, filter, hermite, mitchell};
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

/// Side of a picture, and the black between two.
const SHOWN: usize = 128;
const GAP: usize = 4;

/// Cells along a side of 9 x 9 samples, by the width of which bends are told.
const CELLS: f32 = 8.0;

/// Light by place on the wall, each coordinate from 0 to 1.
type Function<'a> = Box<dyn Fn([f32; 2]) -> f32 + 'a>;

/// A look-up at a point in cells of a texture.
type LookUp = fn(&Grid<f32>, [f32; 2]) -> f32;

fn look(grid: &Grid<f32>, look_up: LookUp) -> Function<'_> {
    let scale = (grid.size[0] - 1) as f32;
    Box::new(move |at| look_up(grid, at.map(|c| c * scale)))
}

/// A texture of so many texels a side, those of its border on the border of the wall.
fn resample(light: &Function, side: usize) -> Grid<f32> {
    let at = |i: usize| [i % side, i / side].map(|n| n as f32 / (side - 1) as f32);
    Grid { size: [side; 2], values: (0..side * side).map(|i| light(at(i))).collect() }
}

/// The texel that has a place, as texels are shown.
fn nearest(grid: &Grid<f32>, at: [f32; 2]) -> f32 {
    let side = grid.size[0];
    grid.at(at.map(|c| ((c * side as f32 / (side - 1) as f32) as usize).min(side - 1)))
}

/// RMS of the difference at the vertices of the reference.
fn difference(light: &Function, expected: &Grid<f32>) -> f32 {
    let found = resample(light, expected.size[0]);
    let squares = found.values.iter().zip(&expected.values).map(|(a, b)| f64::from(a - b).powi(2));
    (squares.sum::<f64>() / expected.values.len() as f64).sqrt() as f32
}

/// The greatest change of the slope along an axis from one of some 512 steps to the next, times the width of a cell of 9 x 9.
/// A line of texels lies between two steps.
fn bend(light: &Function, side: usize) -> f32 {
    let steps = 512 / (side - 1) * (side - 1);
    let width = 1.0 / steps as f32;
    let mut greatest = 0.0f32;
    for line in 1..steps {
        for across in 0..64 {
            let [x, y] = [line as f32 * width, across as f32 / 63.0];
            for at in [|x: f32, y: f32| [x, y], |x: f32, y: f32| [y, x]] {
                let [low, middle, high] = [-width, 0.0, width].map(|d| light(at(x + d, y)));
                greatest = greatest.max((low - 2.0 * middle + high).abs() / width / CELLS);
            }
        }
    }
    greatest
}

/// Light of a small lamp on the wall behind it, at the vertices of a full tree.
fn wall_light(context: &Context, settings: &Settings, height: u8) -> Outcome<Grid<f32>> {
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
    Ok(Grid { size: [side; 2], values: light.iter().map(|light| light.total().x).collect() })
}

fn figure(context: &Context, settings: &Settings, path: &str, height: u8) -> Outcome<()> {
    let reference = wall_light(context, settings, height)?;
    let mean = reference.values.iter().sum::<f32>() / reference.values.len() as f32;
    let goal = look(&reference, bilinear);
    let samples = resample(&goal, 5);
    let patches = look(&samples, hermite);
    let fine_patches = resample(&patches, reference.size[0]);

    let greatest = [&reference, &samples, &fine_patches].map(|grid| grid.values.iter().copied().fold(0.0, f32::max));
    let [of_reference, of_samples, of_patches] = greatest.map(|light| light / mean);
    println!("greatest light / mean: {of_reference:.2}, of 5 x 5 samples {of_samples:.2}, of patches {of_patches:.2}");

    // Of each way to rebuild the light: its error, and its difference from the patches, which the filter and the look-up make;
    // its error where all texels are computed instead of 5 x 5.
    println!(
        "reconstruction | RMS error / mean | RMS from the patches / mean | RMS error of computed texels / mean | bend / mean"
    );
    for (name, light, side) in [
        ("reference", &goal, reference.size[0]),
        ("5 x 5, bilinear", &look(&samples, bilinear), 5),
        ("5 x 5, patches", &patches, 5),
    ] {
        let [error, blur] = [&reference, &fine_patches].map(|expected| difference(light, expected) / mean);
        println!("{name} | {error:.4} | {blur:.4} | | {:.3}", bend(light, side) / mean);
    }
    for side in [8, 9, 17, 33, 65, 129, 257] {
        let [texture, computed] = [&patches, &goal].map(|light| resample(light, side));
        let filters = (2..=6).map(|width| (format!("{width} x {width}, bilinear"), width, bilinear as LookUp));
        for (name, width, look_up) in filters.chain([(String::from("2 x 2, Mitchell"), 2, mitchell as LookUp)]) {
            let [texture, computed] = [&texture, &computed].map(|grid| filter(grid, Shape::Quad, width));
            let light = look(&texture, look_up);
            let [error, blur] = [&reference, &fine_patches].map(|expected| difference(&light, expected) / mean);
            let own = difference(&look(&computed, look_up), &reference) / mean;
            println!("{side} x {side}, {name} | {error:.4} | {blur:.4} | {own:.4} | {:.3}", bend(&light, side) / mean);
        }
    }

    // Figure 5.20, a to g; figure 5.21, the filtered textures of 8 x 8 and their look-ups; the widest filter on finer textures.
    let texture = resample(&patches, 8);
    let filtered: Vec<Grid<f32>> = (2..=6).map(|width| filter(&texture, Shape::Quad, width)).collect();
    let finer: Vec<Grid<f32>> =
        [9, 17, 33, 65, 129, 257].map(|side| filter(&resample(&patches, side), Shape::Quad, 6)).into();
    let rows: [Vec<Function>; 4] = [
        vec![
            look(&samples, nearest),
            look(&reference, bilinear),
            look(&texture, nearest),
            look(&samples, bilinear),
            look(&samples, hermite),
            look(&texture, bilinear),
            look(&texture, mitchell),
        ],
        filtered.iter().map(|grid| look(grid, nearest)).collect(),
        filtered.iter().map(|grid| look(grid, bilinear)).collect(),
        finer.iter().map(|grid| look(grid, bilinear)).collect(),
    ];
    let [columns, lines] = [rows[0].len(), rows.len()].map(|n| (n * (SHOWN + GAP) - GAP) as u32);
    let mut picture = image::GrayImage::new(columns, lines);
    for (j, row) in rows.iter().enumerate() {
        for (i, light) in row.iter().enumerate() {
            for (x, y) in (0..SHOWN * SHOWN).map(|n| (n % SHOWN, n / SHOWN)) {
                let at = [x as f32 / (SHOWN - 1) as f32, 1.0 - y as f32 / (SHOWN - 1) as f32];
                let shown = (light(at) / greatest[0]).clamp(0.0, 1.0).powf(1.0 / 2.2);
                let [x, y] = [x + i * (SHOWN + GAP), y + j * (SHOWN + GAP)].map(|n| n as u32);
                picture.put_pixel(x, y, image::Luma([(255.0 * shown) as u8]));
            }
        }
    }
    picture.save(path)?;
    Ok(())
}
