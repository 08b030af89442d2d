//! Makes the images: elements, hemispheres, rays, and light (Bastos 1999, section 6.6.1).

use std::sync::Arc;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{DepthImages, Element, Hemisphere, Options, Points, Pose};
use crate::accel::{Bvh, Ray, offset_origin};
use crate::bake;
use crate::bake::blocks::{BLOCK, ENTRIES, slot, view_size};
use crate::device_scene::is_shiny;
use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::pass::trace;
use crate::scene::reflectors::Reflector;
use crate::scene::{Scene, Surface};
use crate::settings::Settings;
use crate::standalone::Renderer;
use crate::view::{Atlas, Texel};

/// Most backs of surfaces that a ray passes on its way to a further layer.
const MAX_BACKS: u32 = 16;
/// Edges of a reflector that are tried as the direction of its elements.
const MAX_DIRECTIONS: usize = 64;

/// A point before it is lit: its texel, `None` for one without a colour, and its depth.
#[derive(Clone, Copy)]
struct Found {
    texel: Option<Texel>,
    depth: f32,
}

/// The hemispheres of a scene, before anything is traced.
#[derive(Clone, Debug)]
pub struct Plan {
    hemispheres: Vec<Hemisphere>,
    options: Options,
}

impl Plan {
    /// For the planar glossy reflectors of a scene, as many as the settings' superposition takes.
    ///
    /// Errors: options or settings out of range or without superposition; a scene without planar glossy reflectors, or one that asks for
    /// reflectors that are not flat; more memory than the options allow.
    pub fn new(scene: &Scene, settings: &Settings, options: Options) -> Result<Plan> {
        Ok(Plan { hemispheres: hemispheres(scene, settings, &options)?, options })
    }

    /// The hemispheres with the poses of their images.
    pub fn hemispheres(&self) -> &[Hemisphere] {
        &self.hemispheres
    }

    /// The options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Number of images, each layer counted.
    pub fn images(&self) -> usize {
        self.hemispheres.iter().map(|h| h.poses.len()).sum::<usize>() * self.options.layers as usize
    }

    /// Bytes of the images, on the host and on the device.
    pub fn bytes(&self) -> u64 {
        self.options.bytes(self.hemispheres.len())
    }
}

impl DepthImages {
    /// Makes the planned images of a scene: submits to the device and waits. `go_on` is told the share that is done, and may say no. Takes
    /// about as long as so many passes of an image with as many pixels. Deterministic.
    ///
    /// Errors: [`Error::Interrupted`]; those of a renderer.
    pub fn sample(
        context: &Context,
        scene: &Scene,
        settings: &Settings,
        Plan { hemispheres, options }: Plan,
        go_on: &mut dyn FnMut(f64) -> bool,
    ) -> Result<DepthImages> {
        let bvh = Bvh::build(scene)?;
        let mut found = Vec::new();
        for (hemisphere, pose) in hemispheres.iter().flat_map(|h| h.poses.iter().map(move |pose| (h, pose))) {
            // Tracing is the smaller part by far.
            if !go_on(0.0) {
                return Err(Error::Interrupted);
            }
            found.extend(trace_image(scene, &bvh, hemisphere.plane.0, pose, &options));
        }
        let size = [options.side; 2];
        let points = light(context, scene, settings, (size, options.passes), &found, go_on)?;
        Ok(DepthImages::new(size, options.layers, hemispheres, points))
    }
}

/// The hemispheres of a scene. Errors: see [`Plan::new`].
fn hemispheres(scene: &Scene, settings: &Settings, options: &Options) -> Result<Vec<Hemisphere>> {
    options.validate()?;
    settings.validate()?;
    let setting = |name, message: &str| Err(Error::Setting { name, message: String::from(message) });
    if settings.mirroring_planes() == 0 {
        let message =
            "superposition shows images; use --superposition variant or mirror with it, and --reflectors above 0";
        return setting("--mirror-source", message);
    }
    let reflectors = scene.reflectors();
    check_flat(scene, &reflectors)?;
    let opaque = |r: &Reflector| !r.curved && scene.materials[r.material as usize].surface == Surface::Opaque;
    let numbered = (1..=settings.mirroring_planes()).zip(&reflectors).filter(|(_, reflector)| opaque(reflector));
    let mut found = Vec::new();
    let mut images = 0;
    for (number, reflector) in numbered {
        for element in elements(scene, reflector, options.hemispheres) {
            let cops = hemisphere(&element, reflector.normal, options.images);
            let poses: Vec<Pose> = cops.iter().map(|cop| Pose::new(*cop, &element, [options.side; 2])).collect();
            let plane = (reflector.normal, reflector.offset);
            let first = images;
            images += poses.len() * options.layers as usize;
            found.push(Hemisphere { reflector: number, plane, element, poses, first });
        }
    }
    if found.is_empty() {
        return setting("--mirror-source", "the scene has no planar glossy reflector to sample; use rays");
    }
    let bytes = options.bytes(found.len());
    if bytes > options.memory {
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        let message = format!(
            "{} hemispheres with {} images of {}x{} points and {} layers need {:.1} MiB, and {:.1} are allowed; take fewer or smaller \
             images, fewer --reflectors, or allow more",
            found.len(),
            options.images,
            options.side,
            options.side,
            options.layers,
            mib(bytes),
            mib(options.memory)
        );
        return Err(Error::Setting { name: "--mirror-memory", message });
    }
    Ok(found)
}

/// Refuses materials that are to reflect and have no flat faces.
fn check_flat(scene: &Scene, reflectors: &[Reflector]) -> Result<()> {
    let asks = |i: &u32| {
        let material = &scene.materials[*i as usize];
        material.reflector == Some(true) && material.surface == Surface::Opaque
    };
    let curved = (0..scene.materials.len() as u32).filter(asks).find(|i| {
        scene.triangles.iter().any(|t| t.material == *i) && !reflectors.iter().any(|reflector| reflector.material == *i)
    });
    match curved {
        Some(i) => Err(Error::Scene(format!(
            "material {:?} is to be a reflector, and none of its faces is flat: images with depth need a plane; use rays, or \
             take `reflector` away",
            scene.materials[i as usize].name
        ))),
        None => Ok(()),
    }
}

/// The elements of a reflector, at most `most`: rectangles of equal size that cover it, nearly square; those that it does not touch are
/// left out.
pub fn elements(scene: &Scene, reflector: &Reflector, most: u32) -> Vec<Element> {
    let n = reflector.normal;
    let corners: Vec<[Vec3; 3]> = reflector.triangles.iter().map(|&t| scene.triangle_positions(t as usize)).collect();
    let of_triangle = |[a, b, c]: &[Vec3; 3]| [*b - *a, *c - *b, *a - *c];
    let directions = corners.iter().take(MAX_DIRECTIONS / 3).flat_map(of_triangle);
    // The smallest rectangle around it along one of its edges.
    let boxed = directions.filter_map(|edge| {
        let u = (edge - n.dot(edge) * n).try_normalize()?;
        let v = u.cross(n);
        let places = corners.iter().flatten().map(|p| Vec2::new(p.dot(u), p.dot(v)));
        let (low, high) = places.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        Some((u, v, low, high))
    });
    let area = |(_, _, low, high): &(Vec3, Vec3, Vec2, Vec2)| (*high - *low).element_product();
    let Some((u, v, low, high)) = boxed.min_by(|a, b| area(a).total_cmp(&area(b))) else { return Vec::new() };
    let extent = high - low;
    let across = (most as f32 * extent.x / extent.y).sqrt().round().clamp(1.0, most as f32) as u32;
    let counts = [across, (most / across).max(1)];
    let size = extent / Vec2::new(counts[0] as f32, counts[1] as f32);
    let in_plane = |p: &Vec3| Vec2::new(p.dot(u), p.dot(v));
    let mut found = Vec::new();
    for y in 0..counts[1] {
        for x in 0..counts[0] {
            let corner = low + size * Vec2::new(x as f32, y as f32);
            if corners.iter().any(|triangle| overlaps((corner, corner + size), &triangle.each_ref().map(in_plane))) {
                let edges = [u * size.x, v * size.y];
                found.push(Element { corner: corner.x * u + corner.y * v + reflector.offset * n, edges });
            }
        }
    }
    found
}

/// Whether a rectangle and a triangle have a common area: no edge of either separates them.
fn overlaps((low, high): (Vec2, Vec2), triangle: &[Vec2; 3]) -> bool {
    let rectangle = [low, Vec2::new(high.x, low.y), high, Vec2::new(low.x, high.y)];
    let edges = (0..3).map(|i| (triangle[(i + 1) % 3] - triangle[i]).perp());
    let span = |points: &[Vec2], axis: Vec2| {
        points.iter().map(|p| p.dot(axis)).fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)))
    };
    let slack = 1e-4 * (high - low).max_element();
    [Vec2::X, Vec2::Y].into_iter().chain(edges).all(|axis| {
        let ((a, b), (c, d)) = (span(&rectangle, axis), span(triangle, axis));
        a + slack * axis.length() < d && c + slack * axis.length() < b
    })
}

/// `count` centres of projection on the hemisphere behind an element whose reflector has this normal: at equal steps of the height, the
/// pole first, and turned by the golden angle each. Its base fits into the element.
pub fn hemisphere(element: &Element, normal: Vec3, count: u32) -> Vec<Vec3> {
    const GOLDEN_ANGLE: f32 = 2.399_963_2;
    let [u, v] = element.edges;
    let radius = 0.5 * u.length().min(v.length());
    let (u, v) = (u.normalize_or_zero(), v.normalize_or_zero());
    let place = |i: u32| {
        let height = 1.0 - i as f32 / count as f32;
        let (sine, cosine) = (i as f32 * GOLDEN_ANGLE).sin_cos();
        let aside = (1.0 - height * height).max(0.0).sqrt() * (cosine * u + sine * v);
        element.center() + radius * (aside - height * normal)
    };
    (0..count).map(place).collect()
}

/// The points of all layers of an image, layer by layer.
fn trace_image(scene: &Scene, bvh: &Bvh, normal: Vec3, pose: &Pose, options: &Options) -> Vec<Found> {
    let side = options.side;
    let rays = 0..side * side;
    let by_pixel: Vec<Vec<Found>> = rays
        .into_par_iter()
        .map(|i| trace_ray(scene, bvh, normal, pose, (i % side, i / side), options.layers))
        .collect();
    (0..options.layers as usize).flat_map(|layer| by_pixel.iter().map(move |points| points[layer])).collect()
}

/// The points along one ray.
fn trace_ray(scene: &Scene, bvh: &Bvh, normal: Vec3, pose: &Pose, (x, y): (u32, u32), layers: u32) -> Vec<Found> {
    let along = pose.ray(x, y);
    let direction = along.normalize_or_zero();
    let mut origin = offset_origin(pose.cop + along, normal, bvh.scale());
    let mut found = Vec::new();
    let mut backs = 0;
    while (found.len() as u32) < layers && backs <= MAX_BACKS {
        let ray = Ray { origin, t_max: 3.0e38, direction };
        let Some(hit) = trace::reference(scene, bvh, &ray, 0) else { break };
        let face = bvh.normal(hit.triangle);
        let back = face.dot(direction) > 0.0;
        let position = bvh.position(&hit);
        let side = if back { face } else { -face };
        origin = offset_origin(position, side, bvh.scale());
        if back && !found.is_empty() {
            // Further layers hold fronts alone.
            backs += 1;
            continue;
        }
        let triangle = bvh.scene_triangle(hit.triangle);
        let material = &scene.materials[scene.triangles[triangle as usize].material as usize];
        let holds = !back && material.surface == Surface::Opaque && !is_shiny(material);
        let depth = (position - pose.cop).dot(along) / along.length_squared();
        // Rounding may put a hit at an edge outside of its triangle.
        let u = hit.u.clamp(0.0, 1.0);
        let uv = [u, hit.v.clamp(0.0, 1.0 - u)];
        found.push(Found { texel: holds.then_some(Texel { triangle, uv, back }), depth });
    }
    found.resize(layers as usize, Found { texel: None, depth: 0.0 });
    found
}

/// Settings for the light of the points: all of them share their particles, and what is diffuse is summed on its own.
fn light_settings(settings: &Settings) -> Settings {
    let photons = settings.photons * settings.classes();
    // A pool as large as that of all classes costs hardly more, and has less error.
    let light_pool = (settings.light_pool * settings.classes()).min(Settings::MAX_PARTICLES);
    Settings { pattern: [1, 1], photons, light_pool, summands: true, ..bake::settings(settings.clone()) }
}

/// The points with their radiance, by passes of atlas views.
fn light(
    context: &Context,
    scene: &Scene,
    settings: &Settings,
    (size, passes): ([u32; 2], u32),
    found: &[Found],
    go_on: &mut dyn FnMut(f64) -> bool,
) -> Result<Points> {
    let settings = light_settings(settings);
    let depth = |f: &Found| if f.texel.is_some() { f.depth } else { -f.depth };
    let mut points: Points = found.iter().map(|f| [0.0, 0.0, 0.0, depth(f)]).collect();
    // Blocks of neighbouring points, without those that have no point to light.
    let mut blocks: Vec<Vec<Option<usize>>> = Vec::new();
    for (image, _) in found.chunks((size[0] * size[1]) as usize).enumerate() {
        let first = image * (size[0] * size[1]) as usize;
        for y in (0..size[1]).step_by(BLOCK as usize) {
            for x in (0..size[0]).step_by(BLOCK as usize) {
                let at = |i: u32| {
                    let (x, y) = (x + i % BLOCK, y + i / BLOCK);
                    let point = first + (x + y * size[0]) as usize;
                    (x < size[0] && y < size[1] && found[point].texel.is_some()).then_some(point)
                };
                let block: Vec<Option<usize>> = (0..BLOCK * BLOCK).map(at).collect();
                if block.iter().any(Option::is_some) {
                    blocks.push(block);
                }
            }
        }
    }
    let per_batch = (bake::batch_texels(context, &settings) / ENTRIES).max(1);
    let batches = blocks.len().div_ceil(per_batch);
    let own = Scene { mirror_images: None, ..scene.clone() };
    let mut last: Option<Renderer> = None;
    for (number, blocks) in blocks.chunks(per_batch).enumerate() {
        let (atlas, places) = atlas(blocks, found);
        let mut renderer = match last.take() {
            Some(mut renderer) => renderer.set_atlas(atlas).map(|()| renderer)?,
            None => Renderer::with_atlas(context.clone(), own.clone(), atlas, settings.clone())?,
        };
        for pass in 0..passes {
            let done = (f64::from(pass) / f64::from(passes) + number as f64) / batches as f64;
            if !go_on(done) {
                return Err(Error::Interrupted);
            }
            renderer.pass()?;
        }
        let layers = renderer.layers()?;
        for (slot, point) in places.iter().enumerate().filter_map(|(slot, point)| point.map(|point| (slot, point))) {
            let l = layers.emission[slot] + layers.diffuse[slot];
            points[point][..3].copy_from_slice(&l.to_array());
        }
        last = Some(renderer);
    }
    Ok(points)
}

/// The view of some blocks, and the point of each of its texels.
fn atlas(blocks: &[Vec<Option<usize>>], found: &[Found]) -> (Arc<Atlas>, Vec<Option<usize>>) {
    let size = view_size(blocks.len());
    let mut places = vec![None; (size[0] * size[1]) as usize];
    for (b, block) in (0..).zip(blocks) {
        for (i, point) in (0..).zip(block) {
            places[slot(b, i, size[0])] = *point;
        }
    }
    let texels = places.iter().map(|point| point.and_then(|point| found[point].texel)).collect();
    (Arc::new(Atlas::new(size, texels)), places)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Material;

    fn floor(extent: Vec3) -> (Scene, Reflector) {
        let mut scene = Scene::default();
        let material =
            scene.add_material(Material { specular: Vec3::splat(0.4), roughness: 0.2, ..Material::default() });
        let object = scene.add_object("floor");
        scene.add_quad(Vec3::new(1.0, 0.5, 2.0), Vec3::Z * extent.z, Vec3::X * extent.x, material, object);
        let reflector = scene.reflectors().remove(0);
        (scene, reflector)
    }

    #[test]
    fn elements_cover_the_reflector_and_are_nearly_square() {
        let (scene, reflector) = floor(Vec3::new(6.0, 0.0, 2.0));
        for (most, expected) in [(1, 1), (3, 3), (4, 4), (12, 12), (13, 12)] {
            let found = elements(&scene, &reflector, most);
            assert_eq!(found.len(), expected, "{most}");
            let area: f32 = found.iter().map(|e| e.edges[0].length() * e.edges[1].length()).sum();
            assert!((area - 12.0).abs() < 1e-4);
            for e in &found {
                let turned = e.edges[0].cross(e.edges[1]).normalize();
                assert!((turned + reflector.normal).length() < 1e-5, "{turned}");
                let inside = |p: Vec3| p.x > 0.999 && p.x < 7.001 && p.z > 1.999 && p.z < 4.001;
                assert!(e.corners().iter().all(|p| inside(*p) && (p.y - 0.5).abs() < 1e-5), "{e:?}");
            }
        }
    }

    #[test]
    fn elements_beside_the_reflector_are_left_out() {
        // An L of two quads covers three of four quarters.
        let (mut scene, _) = floor(Vec3::new(2.0, 0.0, 1.0));
        scene.add_quad(Vec3::new(1.0, 0.5, 3.0), Vec3::Z, Vec3::X, 0, 0);
        let reflectors = scene.reflectors();
        assert_eq!(reflectors.len(), 1);
        assert_eq!(elements(&scene, &reflectors[0], 4).len(), 3);
    }

    #[test]
    fn centres_of_projection_are_spread_over_the_hemisphere() {
        let (scene, reflector) = floor(Vec3::new(2.0, 0.0, 3.0));
        let element = elements(&scene, &reflector, 1)[0];
        for count in [1, 2, 23, 64] {
            let found = hemisphere(&element, reflector.normal, count);
            for (i, cop) in found.iter().enumerate() {
                let from = *cop - element.center();
                assert!((from.length() - 1.0).abs() < 1e-5 && from.dot(reflector.normal) < 0.0, "{i}: {from}");
            }
            assert!((found[0] - (element.center() - reflector.normal)).length() < 1e-6, "the pole comes first");
            // The mean of a hemisphere's points is at half its height, a little more since the pole is one of them.
            let mean = found.iter().sum::<Vec3>() / count as f32 - element.center();
            let height = -mean.dot(reflector.normal);
            assert!((height - 0.5 - 0.5 / count as f32).abs() < 1e-5, "{count}: {height}");
            assert!(count < 23 || (mean + height * reflector.normal).length() < 0.1, "{count}: {mean}");
        }
    }

    #[test]
    fn what_cannot_be_sampled_is_refused() {
        let (mut scene, _) = floor(Vec3::new(2.0, 0.0, 3.0));
        let superposition = crate::settings::Superposition::default();
        let settings = Settings { superposition: Some(superposition), ..Settings::default() };
        let refused = |scene: &Scene, settings: &Settings, options: Options| {
            hemispheres(scene, settings, &options).unwrap_err().to_string()
        };
        assert_eq!(hemispheres(&scene, &settings, &Options::default()).unwrap().len(), 4);
        let message = refused(&scene, &Settings::default(), Options::default());
        assert!(message.contains("--superposition"), "{message}");
        let message = refused(&scene, &settings, Options { memory: 1 << 20, ..Options::default() });
        assert!(message.contains("8.0 MiB") && message.contains("1.0 are allowed"), "{message}");
        let message = refused(&scene, &settings, Options { side: 4, ..Options::default() });
        assert!(message.contains("8..=1024"), "{message}");
        let none = Settings {
            superposition: Some(crate::settings::Superposition { reflectors: 0, ..superposition }),
            ..settings.clone()
        };
        assert!(refused(&scene, &none, Options::default()).contains("superposition"));
        // A curved face is no mirror of ours.
        scene.materials[0].name = String::from("bowl");
        scene.materials[0].reflector = Some(true);
        scene.triangles.iter_mut().for_each(|t| t.smooth = true);
        scene.normals = vec![Vec3::ONE.normalize(); scene.positions.len()];
        let message = refused(&scene, &settings, Options::default());
        assert!(message.contains("bowl") && message.contains("flat"), "{message}");
        scene.materials[0].reflector = Some(false);
        assert!(refused(&scene, &settings, Options::default()).contains("no planar glossy reflector"));
    }
}
