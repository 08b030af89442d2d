//! Motion blur: the passes against their oracles, edges in closed form, sub-frames, and images of the path tracer's shutter.

use glam::{Affine3A, DVec2, Quat, Vec2, Vec3, Vec4};
use lightsum::engine::{Engine, PosedObject, ShutterEnd};
use lightsum::gpu::{Context, Staging};
use lightsum::pass::layout::MotionReach;
use lightsum::pass::motion_blur::reference;
use lightsum::pass::{ShadingPoints, accumulate, lens, motion_blur, velocity};
use lightsum::path_trace::{self, Options, SpecularPaths};
use lightsum::scene::{Camera, Scene};
use lightsum::settings::{Compensation, Settings};
use lightsum::stage::Stage;
use lightsum::standalone::Renderer;

use crate::rig::{Rig, Tally, close, gallery, has, hit_of, is_lit};
use crate::scenes::{Soup, camera, fov, settings};
use crate::support::{gpu_test, unwatched};
use lightsum::conform::AWKWARD_IMAGES;

fn posed(object: u32, transform: Affine3A) -> PosedObject {
    PosedObject { object, transform, vertices: None }
}

/// A rig of a scene whose objects move, and whose shutter is open.
fn rig<'a>(ctx: &'a Context, scene: &'a Scene, camera: Camera, ends: [ShutterEnd; 2]) -> Rig<'a> {
    let settings = Settings { compensation: Compensation::Off, ..settings(4, 5) };
    let mut engine = Engine::new_dynamic(ctx, scene.clone(), camera, settings).unwrap();
    engine.set_shutter_ends(Some(ends)).unwrap();
    let parameters = engine.plan().parameters(0).unwrap();
    ctx.submit_and_wait("setup", None, |rec| {
        engine.record_setup(rec)?;
        engine.frame().record_start(rec, &parameters)
    })
    .unwrap();
    engine.setup_finished();
    Rig { ctx, scene, engine, parameters }
}

#[test]
fn velocities_follow_their_oracle() {
    gpu_test(|ctx| {
        let scene = gallery();
        let (mut moving, mut still, mut mirrored, mut nothing) = (0, 0, 0, 0);
        for (resolution, height) in AWKWARD_IMAGES.into_iter().flat_map(|size| [(size, None), (size, Some(3.2))]) {
            let now = Camera { resolution, shutter: 0.5, height, ..scene.camera.unwrap() };
            let shift = Vec3::new(0.02, 0.01, -0.03);
            let [a, b] =
                [-1.0, 1.0].map(|s| Camera { eye: now.eye + s * shift, target: now.target + s * 0.2 * Vec3::X, ..now });
            let cameras = [a, Camera { fov_y: now.fov_y * 1.1, height: height.map(|h| 1.1 * h), ..b }];
            let turn = |s: f32| {
                Affine3A::from_rotation_translation(Quat::from_rotation_y(0.1 * s), Vec3::new(0.1, 0.05, 0.02) * s)
            };
            let objects: Vec<u32> = (0..scene.objects.len() as u32).filter(|o| o % 3 != 0).collect();
            let listed = |scene: &Scene, o: u32| scene.triangles.iter().any(|t| t.object == o);
            let ends = [-1.0, 1.0].map(|s: f32| ShutterEnd {
                camera: cameras[usize::from(s > 0.0)],
                objects: objects.iter().filter(|o| listed(&scene, **o)).map(|&o| posed(o, turn(s))).collect(),
            });
            let rig = rig(ctx, &scene, now, ends);
            rig.walk_and_look();
            let pass = rig.frame().velocity.as_ref().unwrap();
            rig.prefill(&[&pass.velocity]);
            rig.run(|_, rec| pass.record(rec));
            let found = rig.vec4s(&pass.velocity);
            let (hits, wo) = (rig.vec4s(&rig.frame().eye.rays.hits), rig.vec4s(&rig.frame().eye.points.wo));
            let through = rig.vec4s(&rig.frame().eye.paths.throughput);
            let mut tally = Tally::new(format!("velocity, {resolution:?}"));
            for (i, v) in found.iter().enumerate() {
                let at = [i as u32 % resolution[0], i as u32 / resolution[0]].map(|n| n as f32);
                let offset = rig.parameters.pixel_offset;
                let ray = path_trace::eye_ray(&now, resolution, at[0] + offset[0], at[1] + offset[1]);
                let (d, start) = (ray.direction, ray.origin - now.eye);
                let towards = d / d.dot(now.world_from_camera().2);
                let seen = if height.is_some() { start } else { towards };
                let hit = hit_of(hits[i]).filter(|_| has(wo[i], ShadingPoints::HIT));
                let depth = hit.map(|_| through[i].w);
                let unfolded = depth.map_or(seen, |z| ray.origin + z * towards);
                let object = hit.filter(|_| !has(wo[i], ShadingPoints::SEEN_BY_SPECULAR)).map(|hit| {
                    let triangle = rig.bvh().scene_triangle(hit.triangle);
                    rig.engine.scene().unwrap().triangles[triangle as usize].object
                });
                let moves = object.filter(|o| objects.contains(o));
                let places = [-1.0, 1.0].map(|s| moves.map_or(unfolded, |_| turn(s).transform_point3(unfolded)));
                let expected = velocity::reference(cameras.each_ref(), places, depth);
                assert_eq!((v.z, v.w), (depth.unwrap_or(lens::NOTHING_SEEN), 0.0));
                let v = DVec2::new(v.x.into(), v.y.into());
                let agrees = (v - expected).length() < 2e-3 * expected.length() + 2e-3;
                tally.check(agrees, || format!("{i}: {v} for {expected}"));
                match (hit, moves) {
                    (None, _) => nothing += 1,
                    (_, Some(_)) => moving += 1,
                    _ if object.is_none() => mirrored += 1,
                    _ => still += 1,
                }
            }
            tally.finish(0.01);
        }
        println!("{moving} {still} {mirrored} {nothing}");
        assert!(moving > 100 && still > 100 && mirrored > 5 && nothing > 5);
    });
}

/// Velocity by the number of a pixel.
type Pattern = Box<dyn Fn(u32) -> DVec2>;

/// A few patterns that tiles must bound.
fn patterns([width, _]: [u32; 2]) -> [(&'static str, Pattern); 7] {
    let hashed =
        |i: u32| DVec2::from([0, 1].map(|k| f64::from(lightsum::sampling::random::random_f32(2 * i + k)) - 0.5));
    let striped = [DVec2::new(13.0, 3.0), DVec2::ZERO, DVec2::new(-2.0, 17.5)];
    let one_tile = |x: u32| if (8..16).contains(&x) { DVec2::new(-11.0, 4.0) } else { DVec2::ZERO };
    [
        ("rest", Box::new(|_| DVec2::ZERO)),
        ("alike", Box::new(|_| DVec2::new(5.3, -2.1))),
        ("any", Box::new(move |i| 24.0 * hashed(i))),
        ("stripes", Box::new(move |i| striped[(i % width / 5 % 3) as usize])),
        ("one tile", Box::new(move |i| one_tile(i % width))),
        ("sloping", Box::new(|i| DVec2::new(6.0 + 0.003 * f64::from(i % 683), 2.0))),
        ("growing", Box::new(move |i| DVec2::new(0.11, 0.02) * f64::from(i % width))),
    ]
}

#[test]
fn motion_blur_follows_its_oracle() {
    gpu_test(|ctx| {
        let scene = gallery();
        let (mut changed, mut together) = (0, 0);
        for resolution in AWKWARD_IMAGES {
            let now = Camera { resolution, shutter: 1.0, ..scene.camera.unwrap() };
            let still = || ShutterEnd { camera: now, objects: Vec::new() };
            let rig = rig(ctx, &scene, now, [still(), still()]);
            rig.light();
            rig.run(|frame, rec| frame.merge.record(rec));
            assert_eq!(rig.lost(), 0);
            let frame = rig.frame();
            let (blur, velocities) = (frame.motion_blur.as_ref().unwrap(), &frame.velocity.as_ref().unwrap().velocity);
            let (r, sums) = (&frame.eye.points, &frame.shade.lighting);
            let [kd, wo, before] = [&r.kd, &r.wo, &r.emitted].map(|b| rig.vec4s(b));
            let lights = [&sums.direct, &sums.indirect, &sums.specular].map(|b| rig.vec4s(b));
            let through = rig.vec4s(&frame.eye.paths.throughput);
            let pixels = (resolution[0] * resolution[1]) as usize;
            let source: Vec<Vec4> = (0..pixels)
                .map(|i| {
                    let light = lights.each_ref().map(|l| if is_lit(wo[i]) { l[i].truncate() } else { Vec3::ZERO });
                    let [e, beta, kd] = [before[i], through[i], kd[i]].map(Vec4::truncate);
                    let depth = if has(wo[i], ShadingPoints::HIT) { through[i].w } else { lens::NOTHING_SEEN };
                    accumulate::reference(e, beta, kd, light).extend(depth)
                })
                .collect();
            let dither = reference::Dither::of(rig.parameters.keys[0]);
            for (name, pattern) in patterns(resolution) {
                let moves: Vec<DVec2> = (0..pixels as u32).map(&pattern).collect();
                let mut staging = Staging::new();
                let depth: Vec<f32> = source.iter().map(|l| l.w).collect();
                let with_depth = |(v, z): (&DVec2, &f32)| [v.x as f32, v.y as f32, *z, 0.0];
                let velocity: Vec<[f32; 4]> = moves.iter().zip(&depth).map(with_depth).collect();
                staging.stage_into(ctx, velocities, 0, &velocity).unwrap();
                staging.stage_into(ctx, &r.emitted, 0, &before[..pixels]).unwrap();
                rig.run(|_, rec| staging.record(rec));
                rig.prefill(&[&blur.reach]);
                rig.run(|_, rec| blur.record(rec));
                let after = rig.vec4s(&r.emitted);
                if name == "rest" {
                    assert!(after[..pixels] == before[..pixels], "{resolution:?}");
                    continue;
                }
                let reach: Vec<MotionReach> = rig.get(&blur.reach);
                let columns = resolution[0].div_ceil(8);
                let short: Vec<Vec2> = moves.iter().map(|v| v.as_vec2()).collect();
                for (i, reach) in (0..).zip(&reach) {
                    let even = reference::even(resolution, &short, [i % columns, i / columns]);
                    let found = (reach.reached == 1).then_some(reach.even == 1);
                    assert_eq!(found, even, "{name}, {resolution:?}, tile {i}: {reach:?}");
                    together += usize::from(even == Some(true));
                }
                let tile_of = |p: u32| p % resolution[0] / 8 + p / resolution[0] / 8 * columns;
                let even = |p: usize| reach[tile_of(p as u32) as usize].even == 1;
                let expected = motion_blur::reference(resolution, &source, &moves, even, dither);
                let mut tally = Tally::new(format!("motion blur, {name}, {resolution:?}"));
                for i in 0..pixels {
                    let found = (after[i] - before[i] + source[i]).truncate();
                    let expected = expected[i].as_vec3();
                    changed += usize::from(!close(source[i].truncate(), expected, 0.01, 1e-3));
                    tally.check_values(close(found, expected, 2e-4, 2e-4), &[(found, expected)], || {
                        format!("{i}: {found} for {expected}, not moved {}", source[i])
                    });
                }
                // Sources on the border of being in front may count as either.
                tally.finish(0.002);
            }
        }
        assert!(changed > 1500 && together > 50, "{changed} {together}");
    });
}

/// A scene of two objects, the wall and the board in front of it, that the camera sees from the origin.
fn board(light: [f32; 3], corner: Vec3, size: Vec3) -> (Scene, u32) {
    let mut soup = Soup::new("board");
    let (wall, glow) = (soup.diffuse(0.0, 1.0), soup.diffuse(0.0, light));
    soup.quad(Vec3::new(-30.0, -30.0, 8.0), Vec3::Y * 60.0, Vec3::X * 60.0, wall);
    soup.0.objects.push(String::from("board"));
    let first = soup.0.triangles.len();
    soup.quad(corner, Vec3::Y * size.y, Vec3::X * size.x, glow);
    soup.0.triangles[first..].iter_mut().for_each(|t| t.object = 1);
    (soup.0, 1)
}

/// Pixels of a unit of length at unit distance.
fn pixels_of_unit(camera: &Camera) -> f32 {
    0.5 * camera.resolution[1] as f32 / (0.5 * camera.fov_y).to_radians().tan()
}

/// The image of a scene while an object moves by `path`, seen by a camera with an open shutter.
fn swept(ctx: &Context, (scene, object): (&Scene, u32), camera: Camera, path: Vec3, passes: u32) -> Vec<Vec3> {
    let mut renderer = Renderer::with_context_dynamic(ctx.clone(), scene.clone(), camera, settings(1, 1)).unwrap();
    let end = |s: f32| ShutterEnd { camera, objects: vec![posed(object, Affine3A::from_translation(s * path))] };
    renderer.engine_mut().set_shutter_ends(Some([end(-0.5), end(0.5)])).unwrap();
    (0..passes).for_each(|_| renderer.pass().unwrap());
    renderer.layers().unwrap().color
}

/// The edge of a board that moves gets the profile of a box as long as the way, along the motion, on both sides.
#[test]
fn moving_edges_have_the_profile_of_a_box() {
    gpu_test(|ctx| {
        let view = Camera { shutter: 1.0, ..camera(Vec3::ZERO, Vec3::Z, 40.0, [96, 33]) };
        let z = 2.0;
        // Its edge is on the image's vertical line through the middle; the camera's right is -x.
        let (scene, object) = board([3.0, 3.0, 3.0], Vec3::new(0.0, -9.0, z), Vec3::new(9.0, 18.0, 0.0));
        for (length, slope) in [(5.0, 0.0), (17.0, 0.0), (31.0, 0.0), (31.0, 0.4), (-20.0, -0.7)] {
            let path = Vec3::new(-length, -slope * length, 0.0) * z / pixels_of_unit(&view);
            let image = swept(ctx, (&scene, object), view, path, 1);
            let share = |x: usize| 0.5 * (image[16 * 96 + x].x - 1.0);
            let mut worst = 0.0f32;
            for x in 8..88 {
                let expected = (0.5 + (47.5 - x as f32) / length.abs()).clamp(0.0, 1.0);
                worst = worst.max((share(x) - expected).abs());
            }
            println!("{length}, {slope}: worst {worst:.4}");
            assert!(worst < 0.6 / length.abs(), "{length}, {slope}: {worst}");
        }
    });
}

/// The background of a moving object keeps its bits beyond the reach of the object, and there are no other bits where nothing moves.
#[test]
fn zero_velocity_changes_no_bit() {
    gpu_test(|ctx| {
        let view = camera(Vec3::ZERO, Vec3::Z, fov(1.0, 2.0), [61, 47]);
        let open = Camera { shutter: 1.0, ..view };
        let (mut scene, object) = board([2.0, 0.5, 0.1], Vec3::new(-0.2, -0.2, 2.0), Vec3::new(0.4, 0.4, 0.0));
        scene.materials[0].base_color = Vec3::splat(0.5);
        let render = |camera: Camera, path: Option<Vec3>| {
            let settings = settings(4, 2);
            let mut renderer = Renderer::with_context_dynamic(ctx.clone(), scene.clone(), camera, settings).unwrap();
            let end = |s: f32, path: Vec3| ShutterEnd {
                camera,
                objects: vec![posed(object, Affine3A::from_translation(s * path))],
            };
            let ends = path.map(|path| [end(-0.5, path), end(0.5, path)]);
            renderer.engine_mut().set_shutter_ends(ends).unwrap();
            renderer.pass().unwrap();
            renderer.pass().unwrap();
            renderer.layers().unwrap().color
        };
        let sharp = render(view, None);
        assert!(sharp == render(open, None), "nothing moves");
        assert!(sharp == render(open, Some(Vec3::ZERO)), "an object moves by nothing");
        let image = render(open, Some(Vec3::new(0.8, 0.0, 0.0)));
        // 0.4 to either side of a board of half width 0.2: 14.1 pixels from the middle, and 0.2 above and below: 4.7.
        let far = |i: usize| {
            let (x, y) = ((i % 61) as f32 - 30.0, (i / 61) as f32 - 23.0);
            x.abs() > 16.0 || y.abs() > 6.0
        };
        let changed = |i: &usize| image[*i] != sharp[*i];
        assert!((0..sharp.len()).filter(|i| far(*i)).all(|i| !changed(&i)));
        assert!((0..sharp.len()).filter(changed).count() > 150);
    });
}

/// Centre and radius of the ball below.
const BALL: (Vec3, f32) = (Vec3::new(0.0, -0.1, 2.4), 0.45);

/// A ball, the second object, in front of a wall with bright bars, in a room with a lamp.
fn ball() -> (Scene, Camera) {
    let mut soup = Soup::new("ball");
    let (gray, lamp) = (soup.diffuse(0.6, 0.0), soup.diffuse(0.0, 12.0));
    let (blue, glow) = (soup.diffuse([0.3, 0.4, 0.8], 0.0), soup.diffuse(0.3, [2.0, 0.7, 0.3]));
    soup.room(Vec3::new(-2.0, -1.0, -1.0), Vec3::new(2.0, 1.5, 5.0), [gray; 6]);
    soup.quad(Vec3::new(-0.7, 1.49, 2.0), Vec3::X * 1.4, Vec3::Z * 1.4, lamp);
    let bar = soup.diffuse(0.0, 1.5);
    for i in 0..6 {
        soup.quad(Vec3::new(-1.8 + 0.6 * i as f32, -0.8, 4.99), Vec3::Y * 2.0, Vec3::X * 0.3, bar);
    }
    soup.0.objects.push(String::from("ball"));
    let first = soup.0.triangles.len();
    soup.ball(BALL.0, BALL.1, 16, blue);
    for (i, triangle) in soup.0.triangles[first..].iter_mut().enumerate() {
        triangle.object = 1;
        // Patches that glow.
        triangle.material = if i / 4 % 3 == 0 { glow } else { blue };
    }
    (soup.0, camera(Vec3::new(0.0, 0.0, -0.5), Vec3::new(0.0, -0.1, 3.0), 50.0, [64, 48]))
}

/// Ball and camera at a part, from 0 to 1, of the time for which the shutter is open.
fn at(view: Camera, (ball, eye): (f32, f32), part: f32) -> (Affine3A, Camera) {
    let s = part - 0.5;
    let turned = Affine3A::from_translation(BALL.0)
        * Affine3A::from_rotation_translation(
            Quat::from_rotation_y(0.8 * ball * s),
            Vec3::new(1.0, 0.2, 0.1) * ball * s,
        )
        * Affine3A::from_translation(-BALL.0);
    let shift = Vec3::new(0.25, 0.0, 0.1) * eye * s;
    (turned, Camera { eye: view.eye + shift, target: view.target - 0.3 * shift, ..view })
}

/// Energy ratio and root mean square error of an image, as a share of the root mean square of the reference: what emits is much brighter than the
/// rest, so relative errors of dark pixels tell nothing.
fn compare_bright(image: &[Vec3], reference: &[Vec3]) -> (f32, f32) {
    let sum = |of: &dyn Fn(Vec3, Vec3) -> f32| image.iter().zip(reference).map(|(a, b)| of(*a, *b)).sum::<f32>();
    let energy = sum(&|a, _| a.element_sum()) / sum(&|_, b| b.element_sum());
    (energy, (sum(&|a, b| (a - b).length_squared()) / sum(&|_, b| b.length_squared())).sqrt())
}

/// One blurred frame against the mean of 64 sharp ones, of what emits. The errors are those of the middle of an image that holds all that emits,
/// the energy is that of all of it: where the lamp lay across an edge, the energy was off by 5 % for what came in and went out.
#[test]
fn one_frame_stands_for_many_sub_frames() {
    gpu_test(|ctx| {
        let (scene, narrow) = ball();
        let (width, height) = (96, 72);
        let wider = 2.0 * (1.5 * (0.5 * narrow.fov_y).to_radians().tan()).atan().to_degrees();
        let view = Camera { resolution: [width, height], fov_y: wider, ..narrow };
        // The part that the narrow view shows.
        let middle = |image: &[Vec3]| -> Vec<Vec3> {
            let [x, y] = [0, 1].map(|k| {
                let margin = (view.resolution[k] - narrow.resolution[k]) / 2;
                margin..margin + narrow.resolution[k]
            });
            let inside = |i: &usize| x.contains(&(*i as u32 % width)) && y.contains(&(*i as u32 / width));
            (0..image.len()).filter(inside).map(|i| image[i]).collect()
        };
        let (frames, mut errors) = (64, Vec::new());
        for (speeds, limits) in [((1.0, 0.0), [0.07, 0.11]), ((0.0, 2.0), [0.16, 0.2]), ((1.0, 2.0), [0.16, 0.2])] {
            let moving = |camera: Camera| {
                Renderer::with_context_dynamic(ctx.clone(), scene.clone(), camera, settings(1, 1)).unwrap()
            };
            let mut sharp = moving(view);
            let mut frame = |part: f32| {
                let (transform, camera) = at(view, speeds, part);
                sharp.engine_mut().set_transform(1, transform).unwrap();
                sharp.engine_mut().set_camera(camera).unwrap();
                sharp.pass().unwrap();
                sharp.layers().unwrap().color
            };
            let mut mean = vec![Vec3::ZERO; (width * height) as usize];
            for i in 0..frames {
                let image = frame((i as f32 + 0.5) / frames as f32);
                mean.iter_mut().zip(&image).for_each(|(sum, l)| *sum += *l / frames as f32);
            }
            let now = frame(0.5);
            let mut blurred = moving(Camera { shutter: 0.1, ..view });
            let end = |part| {
                let (transform, camera) = at(view, speeds, part);
                ShutterEnd { camera, objects: vec![posed(1, transform)] }
            };
            blurred.engine_mut().set_shutter_ends(Some([end(0.0), end(1.0)])).unwrap();
            blurred.pass().unwrap();
            let image = blurred.layers().unwrap().color;
            let (whole, _) = compare_bright(&image, &mean);
            let [image, mean, now] = [&image, &mean, &now].map(|image| middle(image));
            let ((energy, error), (_, without)) = (compare_bright(&image, &mean), compare_bright(&now, &mean));
            println!("{speeds:?}: energy {whole:.4}, in the middle {energy:.4}, error {error:.4}, sharp {without:.4}");
            errors.push((whole, error / limits[0], without / limits[1]));
        }
        let good =
            |&(energy, error, without): &(f32, f32, f32)| (energy - 1.0).abs() < 0.02 && error < 1.0 && without > 1.0;
        assert!(errors.iter().all(good), "{errors:?}");
    });
}

/// Against the path tracer's shutter, with direct light.
#[test]
fn images_agree_with_path_tracing() {
    gpu_test(|ctx| {
        let (scene, view) = ball();
        let open = Camera { shutter: 0.1, ..view };
        let speeds = (1.0, 3.0);
        let options = Options {
            resolution: view.resolution,
            samples: 256,
            max_depth: 2,
            max_specular: 0,
            seed: 7,
            reflectance: Default::default(),
            specular_paths: SpecularPaths::None,
        };
        let moment = |part: f64| {
            let (transform, camera) = at(view, speeds, part as f32);
            let mut scene = scene.clone();
            let ranges = scene.separate_objects();
            for p in &mut scene.positions[ranges[1].clone()] {
                *p = transform.transform_point3(*p);
            }
            for n in &mut scene.normals[ranges[1].clone()] {
                *n = transform.transform_vector3(*n);
            }
            Ok((scene, camera))
        };
        let traced = path_trace::render_open(moment, &options, |_| true).unwrap();
        let image = |camera: Camera| {
            let context = unwatched();
            let mut renderer = Renderer::with_context_dynamic(context, scene.clone(), camera, settings(16, 2)).unwrap();
            let end = |part| {
                let (transform, camera) = at(view, speeds, part);
                ShutterEnd { camera, objects: vec![posed(1, transform)] }
            };
            renderer.engine_mut().set_shutter_ends(Some([end(0.0), end(1.0)])).unwrap();
            (0..16).for_each(|_| renderer.pass().unwrap());
            renderer.layers().unwrap().color
        };
        let ((energy, error), (_, without)) =
            (compare_bright(&image(open), &traced), compare_bright(&image(view), &traced));
        println!("energy {energy:.4}, error {error:.4}, without a shutter {without:.4}");
        assert!((energy - 1.0).abs() < 0.02 && error < 0.1 && without > 0.2, "{energy} {error} {without}");
        // The validation layer watches one frame.
        let mut renderer = Renderer::with_context_dynamic(ctx.clone(), scene.clone(), open, settings(16, 2)).unwrap();
        renderer.pass().unwrap();
    });
}

#[test]
fn wrong_shutters_are_refused() {
    gpu_test(|ctx| {
        let (scene, view) = ball();
        let open = Camera { shutter: 0.1, ..view };
        let summands = Settings { summands: true, ..settings(4, 2) };
        let text = Engine::new(ctx, &scene, open, summands).err().unwrap().to_string();
        assert!(text.contains("--summands") && text.contains("--shutter"), "{text}");
        let mut still = Engine::new(ctx, &scene, open, settings(4, 2)).unwrap();
        for shutter in [-0.1, f32::NAN, f32::INFINITY] {
            let text = still.set_camera(Camera { shutter, ..view }).unwrap_err().to_string();
            assert!(text.contains("shutter"), "{text}");
        }
        let end = |camera: Camera, objects: Vec<PosedObject>| {
            Some([ShutterEnd { camera, objects }, ShutterEnd { camera, objects: Vec::new() }])
        };
        let moves = vec![posed(1, Affine3A::IDENTITY)];
        assert!(still.set_shutter_ends(end(open, moves.clone())).unwrap_err().to_string().contains("new_dynamic"));
        let small = Camera { resolution: [8, 8], ..open };
        assert!(still.set_shutter_ends(end(small, Vec::new())).unwrap_err().to_string().contains("64x48"));
        let blind = Camera { target: open.eye, ..open };
        assert!(still.set_shutter_ends(end(blind, Vec::new())).unwrap_err().to_string().contains("coincide"));
        let mut moving = Engine::new_dynamic(ctx, scene, open, settings(4, 2)).unwrap();
        moving.set_shutter_ends(end(open, moves.clone())).unwrap();
        let far = Affine3A::from_scale(Vec3::splat(f32::MAX));
        let few = PosedObject { vertices: Some(vec![Vec3::ZERO]), ..moves[0].clone() };
        for (objects, words) in [
            (vec![posed(7, Affine3A::IDENTITY)], "does not exist"),
            (vec![posed(1, far)], "\"ball\": as the shutter opens"),
            (vec![few], "vertices, 1 are given"),
        ] {
            let text = moving.set_shutter_ends(end(open, objects)).unwrap_err().to_string();
            assert!(text.contains(words), "{text}");
        }
    });
}
