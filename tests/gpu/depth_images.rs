//! Mirror images by images with depth: the passes against their oracle, and whole images against traced mirror images.

use std::sync::Arc;

use glam::{Vec3, Vec4};
use lightsum::gpu::Context;
use lightsum::pass::reproject::{self, MirrorPixels};
use lightsum::scene::{Camera, Material, Scene};
use lightsum::settings::{Compensation, ImageChoice, MirrorImages, MirrorSource, Settings, Spread, Superposition};
use lightsum::superposition::depth_images::{DepthImages, Hemisphere, Options, Plan, Pose, elements, hemisphere};

use crate::rig::{Builder, Rig, STRAYS, Tally};
use crate::scenes::{compare, render, renderer};
use crate::support::gpu_test;
use lightsum::conform::AWKWARD_IMAGES;

/// The square mirror on the floor is as wide as the room.
const SIDE: f32 = 4.0;
const HEIGHT: f32 = 2.5;

/// A closed room with a mirror for a floor. `full`: with a table and a shiny ball.
fn room(full: bool) -> Scene {
    let mut b = Builder::default();
    let plain = Material::default;
    let gray = b.material(Material { base_color: Vec3::new(0.7, 0.6, 0.5), ..plain() });
    let red = b.material(Material { base_color: Vec3::new(0.8, 0.2, 0.1), ..plain() });
    let lamp = b.material(Material { emission: Vec3::splat(6.0), base_color: Vec3::ZERO, ..plain() });
    let mirror = Material { specular: Vec3::splat(0.5), roughness: 0.1, base_color: Vec3::splat(0.1), ..plain() };
    let floor = b.material(mirror.clone());
    let ball = b.material(Material { reflector: Some(false), ..mirror });
    let (x, y, z) = (Vec3::X * SIDE, Vec3::Y * HEIGHT, Vec3::Z * SIDE);
    b.quad(Vec3::ZERO, z, x, floor, 1.0);
    b.quad(y, x, z, gray, 1.0);
    b.quad(Vec3::ZERO, x, y, gray, 1.0);
    b.quad(z, y, x, gray, 1.0);
    b.quad(Vec3::ZERO, y, z, red, 1.0);
    b.quad(x, z, y, red, 1.0);
    b.quad(Vec3::new(1.6, HEIGHT - 0.05, 1.6), Vec3::X * 0.8, Vec3::Z * 0.8, lamp, 1.0);
    if full {
        // The mirror sees the front of the table's top.
        b.quad(Vec3::new(1.2, 0.7, 2.2), Vec3::X * 1.4, Vec3::Z * 0.8, red, 1.0);
        b.sphere(Vec3::new(3.0, 0.4, 1.5), 0.3, 2, ball, false);
    }
    b.finish(Vec3::new(2.0, 1.4, 0.4), Vec3::new(2.0, 0.4, 3.0))
}

fn settings(choice: Option<MirrorImages>) -> Settings {
    let mirror_source = choice.map_or(MirrorSource::Rays, MirrorSource::Images);
    let superposition = Some(Superposition { spread: Spread::Mirror, mirror_source, ..Superposition::default() });
    Settings { particles: 16, compensation: Compensation::Off, max_specular: 4, superposition, ..Settings::plain() }
}

fn merged(merged: u32) -> Option<MirrorImages> {
    Some(MirrorImages { merged, ..MirrorImages::default() })
}

const OPTIONS: Options = Options { hemispheres: 4, images: 8, side: 32, layers: 1, passes: 2, memory: 1 << 24 };

/// The scene with its sampled images.
fn with_images(ctx: &Context, mut scene: Scene, options: Options) -> Scene {
    let plan = Plan::new(&scene, &settings(None), options).unwrap();
    let bytes = plan.bytes();
    let images = DepthImages::sample(ctx, &scene, &settings(None), plan, &mut |_| true).unwrap();
    assert_eq!(images.bytes(), bytes);
    scene.mirror_images = Some(Arc::new(images));
    scene
}

/// Records the eye stage up to the reprojection.
fn reproject(rig: &Rig) {
    let pass = rig.frame().eye.reproject.as_ref().unwrap();
    rig.prefill(&[&pass.nearest, &pass.chosen, &rig.frame().eye.planes.reprojected]);
    rig.run(|frame, rec| {
        frame.eye.record_first(rec)?;
        frame.eye.record_reprojection(rec)
    });
}

#[test]
fn points_are_projected_as_the_oracle_says() {
    gpu_test(|ctx| {
        let mut scene = room(true);
        let reflector = scene.reflectors().remove(0);
        let (mut shown, mut withheld, mut crowded) = (0, 0, 0);
        // Images of 1, 27, 64 and 2049 points, and of a prime width.
        for (size, resolution) in AWKWARD_IMAGES.into_iter().zip(AWKWARD_IMAGES.into_iter().rev()) {
            let hemispheres: Vec<Hemisphere> = (elements(&scene, &reflector, 2).into_iter().enumerate())
                .map(|(i, element)| {
                    let cops = hemisphere(&element, reflector.normal, 5);
                    let poses = cops.iter().map(|cop| Pose::new(*cop, &element, size)).collect();
                    let plane = (reflector.normal, reflector.offset);
                    Hemisphere { reflector: 1, plane, element, poses, first: 10 * i }
                })
                .collect();
            let images = hemispheres.iter().map(|h| 2 * h.poses.len()).sum::<usize>();
            // Depths in steps, some of them equal; points without colour and pixels without a point.
            let count = images * (size[0] * size[1]) as usize;
            let hash = |i: usize| (i as u32).wrapping_mul(2_654_435_769) >> 16;
            let point = |i: usize| {
                let sign = [0.0, -1.0, 1.0, 1.0][hash(i) as usize % 4];
                [i as f32, 1.0, 0.5, sign * (1.5 + (hash(i) % 64) as f32 / 16.0)]
            };
            let points = (0..count).map(point).collect();
            scene.mirror_images = Some(Arc::new(DepthImages::new(size, 2, hemispheres, points)));
            let choice = MirrorImages { choice: ImageChoice::Distance, merged: 3 };
            let rig = Rig::new(ctx, &scene, resolution, settings(Some(choice)));
            reproject(&rig);
            let pass = rig.frame().eye.reproject.as_ref().unwrap();
            let region: Vec<u32> = rig.get(&rig.frame().eye.planes.region);
            let hits = rig.vec4s(&rig.frame().eye.rays.hits);
            for (i, &region) in region.iter().enumerate() {
                assert_eq!(region, crate::rig::hit_of(hits[i]).map_or(0, |hit| rig.plane(&hit)), "region of {i}");
            }
            let projection = pass.projection(&rig.parameters);
            let sizes = projection.tiles.iter().map(|tile| tile.size & 0xffff).max();
            println!("{size:?} at {resolution:?}: {} tiles, points of up to {sizes:?}", projection.tiles.len());
            let images = scene.mirror_images.as_ref().unwrap();
            let expected = reproject::reference(&rig.parameters, &images.points, &projection, &region);
            let found = rig.vec4s(&rig.frame().eye.planes.reprojected);
            let chosen: Vec<u32> = rig.get(&pass.chosen);
            let mut tally = Tally::new(format!("reprojection of {size:?} at {resolution:?}"));
            let mut pixels = MirrorPixels::default();
            for i in 0..region.len() {
                let (value, index) = expected[i].unwrap_or((Vec4::ZERO, u32::MAX));
                let has_color = expected[i].is_some() && images.points[index as usize][3] > 0.0;
                let value = if has_color { value } else { Vec4::ZERO };
                // Depths are sums of products, which a device may round once or twice: of two that are equal either point may win.
                let as_far = (found[i].w - value.w).abs() <= 1e-5 * value.w;
                let same = chosen[i] == index && found[i].truncate() == value.truncate();
                tally.check(as_far && (same || has_color && found[i].w > 0.0), || {
                    format!("{i}: point {} and {}, for {index} and {value}", chosen[i], found[i])
                });
                pixels.shown += u32::from(region[i] > 0);
                pixels.holes += u32::from(region[i] > 0 && expected[i].is_none());
                pixels.withheld += u32::from(expected[i].is_some() && !has_color);
            }
            tally.finish(STRAYS);
            assert_eq!(pass.mirror_pixels(ctx).unwrap(), pixels, "{size:?}");
            shown += pixels.shown - pixels.holes;
            withheld += pixels.withheld;
            crowded += usize::from(sizes > Some(1));
        }
        assert!(shown > 200 && withheld > 10 && crowded > 2, "{shown} {withheld} {crowded}");
    });
}

/// The camera whose mirrored view is that of the image at the pole of the only hemisphere.
fn above_the_pole(size: u32) -> Camera {
    let (up, resolution) = (Vec3::NEG_Z, [size; 2]);
    let eye = Vec3::new(0.5 * SIDE, 0.5 * SIDE, 0.5 * SIDE);
    Camera {
        eye,
        target: eye - Vec3::Y,
        up,
        fov_y: 90.0,
        resolution,
        aperture: 0.0,
        focus: None,
        shutter: 0.0,
        height: None,
        frustum: None,
    }
}

#[test]
fn an_image_at_its_own_centre_is_the_identity() {
    gpu_test(|ctx| {
        for side in [8, 31, 64] {
            let mut scene = room(false);
            // The centre of projection must have room below the ceiling.
            scene.positions.iter_mut().for_each(|p| p.y *= 2.0);
            let options = Options { hemispheres: 1, images: 1, side, ..OPTIONS };
            let mut scene = with_images(ctx, scene, options);
            scene.camera = Some(above_the_pole(side));
            let mut rig = Rig::new(ctx, &scene, [side; 2], settings(merged(1)));
            // The image has the centres of its pixels.
            rig.parameters.pixel_offset[..2].fill(0.5);
            let parameters = rig.parameters;
            rig.run(|frame, rec| frame.record_start(rec, &parameters));
            reproject(&rig);
            let found = rig.vec4s(&rig.frame().eye.planes.reprojected);
            let images = scene.mirror_images.as_ref().unwrap();
            // Seen from the mirrored eye the image is turned as the element is.
            let pose = &images.hemispheres[0].poses[0];
            let place = |x: u32, y: u32| {
                let on_mirror = pose.cop + pose.ray(x, y);
                let [u, v] = [on_mirror.x / SIDE, on_mirror.z / SIDE].map(|s| (s * side as f32) as u32);
                (u + v * side) as usize
            };
            let mut seen = vec![false; found.len()];
            for (i, point) in (0..).zip(&images.points) {
                assert!(point[3] > 0.0 && point[0] > 0.0, "{side}: point {i} sees {point:?}");
                let pixel = place(i % side, i / side);
                let color = found[pixel].truncate().to_array();
                assert_eq!(color.map(f32::to_bits), [point[0], point[1], point[2]].map(f32::to_bits), "{side}: {i}");
                let depth = point[3] * 0.5 * SIDE;
                assert!((found[pixel].w - depth).abs() < 1e-5 * depth, "{side}: depth {} of {depth}", found[pixel].w);
                seen[pixel] = true;
            }
            assert!(seen.iter().all(|&seen| seen), "{side}: each pixel has its point");
        }
    });
}

#[test]
fn a_plane_is_where_its_projection_is() {
    gpu_test(|ctx| {
        // No lamp and no walls: the ceiling alone, seen in the mirror from the side.
        let scene = with_images(ctx, room(false), Options { side: 64, ..OPTIONS });
        let rig = Rig::new(ctx, &scene, [64, 48], settings(merged(2)));
        reproject(&rig);
        let found = rig.vec4s(&rig.frame().eye.planes.reprojected);
        let p = &rig.parameters;
        let xyz = |v: [f32; 4]| Vec3::new(v[0], v[1], v[2]);
        let (mut compared, mut worst) = (0, 0.0_f32);
        for i in 0..found.len() as u32 {
            let at = [(i % 64) as f32 + p.pixel_offset[0], (i / 64) as f32 + p.pixel_offset[1]];
            let (s, t) = (2.0 * at[0] / 64.0 - 1.0, 1.0 - 2.0 * at[1] / 48.0);
            let d = xyz(p.forward) + s * xyz(p.right) + t * xyz(p.up);
            // The way down to the mirror and up to the ceiling.
            let z = (p.eye[1] + HEIGHT) / -d.y;
            let hit = xyz(p.eye) + z * d;
            let inside = |v: f32| v > 0.3 && v < SIDE - 0.3;
            let is_lamp = |v: f32| v > 1.2 && v < 2.8;
            let on_ceiling = z > 0.0 && inside(hit.x) && inside(hit.z) && !(is_lamp(hit.x) && is_lamp(hit.z));
            if on_ceiling && found[i as usize].w > 0.0 {
                compared += 1;
                worst = worst.max((found[i as usize].w / z - 1.0).abs());
            }
        }
        println!("{compared} pixels, depths off by {worst} at most");
        // A point is up to half of its size away from the pixel's centre.
        assert!(compared > 40 && worst < 0.1, "{compared} {worst}");
    });
}

/// Counts of a frame with images.
fn pixels_of(ctx: &Context, scene: &Scene, settings: Settings) -> MirrorPixels {
    let rig = Rig::new(ctx, scene, [64, 48], settings);
    reproject(&rig);
    rig.frame().eye.reproject.as_ref().unwrap().mirror_pixels(ctx).unwrap()
}

#[test]
fn more_images_and_layers_have_fewer_holes() {
    gpu_test(|ctx| {
        // Few images, far from the eye's.
        let options = Options { hemispheres: 1, ..OPTIONS };
        let scene = with_images(ctx, room(true), options);
        let mut before = u32::MAX;
        for images in [1, 2] {
            let pixels = pixels_of(ctx, &scene, settings(merged(images)));
            println!("{images} images: {pixels:?}");
            assert!(pixels.holes < before && pixels.shown > 500, "{images}: {pixels:?}");
            before = pixels.holes;
        }
        let one = pixels_of(ctx, &scene, settings(merged(1)));
        let scene = with_images(ctx, room(true), Options { layers: 2, ..options });
        let two = pixels_of(ctx, &scene, settings(merged(1)));
        println!("1 layer {one:?}, 2 layers {two:?}");
        assert!(two.holes < one.holes && two.shown == one.shown, "{one:?} {two:?}");
        // The ball's light depends on the view.
        assert!(one.withheld > 0 && two.withheld > 0);
    });
}

#[test]
fn images_show_what_rays_show() {
    gpu_test(|ctx| {
        let scene = with_images(ctx, room(true), Options { side: 64, passes: 8, ..OPTIONS });
        let camera = Camera { resolution: [64, 48], ..scene.camera.unwrap() };
        let of = |settings: &Settings, passes| render(ctx, &scene, camera, settings, passes).color;
        let rays = of(&settings(None), 8);
        let images = of(&settings(merged(4)), 8);
        let (energy, error) = compare(&images, &rays);
        println!("energy {energy:.4}, relative error {error:.4}");
        assert!((energy - 1.0).abs() < 0.02 && error < 0.15 && error > 1e-4, "{energy} {error}");
        // Holes are filled: no pixel is much darker than by rays, but at the rim of the lamp.
        let lamp = 2.0;
        let is_dark = |(a, b): &(&Vec3, &Vec3)| b.element_sum() < lamp && a.element_sum() < 0.3 * b.element_sum();
        let dark = images.iter().zip(&rays).filter(is_dark).count();
        println!("{dark} dark pixels");
        assert!(dark < 4, "{dark} dark pixels");
        assert_eq!(images, of(&settings(merged(4)), 8), "the same bits again");
        // Without images the scene that holds them is rendered as the one that does not.
        let plain = Scene { mirror_images: None, ..scene.clone() };
        assert_eq!(of(&settings(None), 1), render(ctx, &plain, camera, &settings(None), 1).color);
        // One image alone, and rays for the holes.
        let (energy, error) = compare(&of(&settings(merged(1)), 8), &rays);
        assert!((energy - 1.0).abs() < 0.02 && error < 0.2, "{energy} {error}");
    });
}

#[test]
fn images_are_refused_where_there_are_none_or_things_move() {
    gpu_test(|ctx| {
        let scene = room(false);
        let camera = scene.camera.unwrap();
        let refused = |result: lightsum::Result<lightsum::Renderer>| result.err().expect("it is refused").to_string();
        let context = || ctx.clone();
        let none = lightsum::Renderer::with_context(context(), scene.clone(), camera, settings(merged(2)));
        assert!(refused(none).contains("no images with depth"));
        let scene = with_images(ctx, scene, Options { side: 8, images: 1, ..OPTIONS });
        let moving = lightsum::Renderer::with_context_dynamic(context(), scene.clone(), camera, settings(merged(2)));
        assert!(refused(moving).contains("images with depth"));
        let stopped = Plan::new(&scene, &settings(None), OPTIONS).unwrap();
        let error = DepthImages::sample(ctx, &scene, &settings(None), stopped, &mut |_| false).unwrap_err();
        assert!(matches!(error, lightsum::Error::Interrupted));
        renderer(ctx, &scene, camera, &settings(merged(2))).pass().unwrap();
    });
}
