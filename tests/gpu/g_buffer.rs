//! Views of a host's G-buffer: records and images against their oracles, and light against that at the points of the engine's own eye.

use ash::vk;
use glam::{DVec3, Mat4, UVec2, Vec3, Vec4};
use lightsum::accel::offset_origin;
use lightsum::gpu::{Buffer, Context, Image, Memory, Recorder, Staging, download};
use lightsum::pass::ShadingPoints;
use lightsum::pass::g_buffer::{self, Record, Records, Told};
use lightsum::pass::g_buffer_read::{self, GBufferImages, GivenImage, Place, Texels};
use lightsum::path_trace::eye_ray;
use lightsum::scene::{Camera, Scene, Surface};
use lightsum::settings::{Clip, Compensation, Settings, SoftShadows, Splats, Superposition};
use lightsum::{Engine, Error, View};

use crate::embed::small;
use crate::hosts::HostsImage;
use crate::rig::{close, gallery, has, orthographic};
use crate::scenes::compare;
use crate::support::{assert_silent, gpu_test};
use lightsum::conform::AWKWARD_IMAGES;
use lightsum::sampling::random::random_f32;

#[allow(dead_code, reason = "its main is the example's own")]
#[allow(clippy::duplicate_mod, reason = "each example has the host that is itself an example")]
#[path = "../../examples/g_buffer.rs"]
mod example;

/// Numbers for tests, in [0, 1).
struct Numbers(u32);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 += 1;
        random_f32(self.0.wrapping_mul(0x9e37_79b9) ^ 0x1234_5678)
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next())
    }
}

/// Records of any kind before a camera: surfaces, nothing, and what tells no surface.
fn records(camera: &Camera, seed: u32) -> Vec<Record> {
    let (right, up, forward) = camera.world_from_camera();
    let mut numbers = Numbers(seed);
    let [width, height] = camera.resolution;
    (0..width * height)
        .map(|i| {
            let at = 2.0 * numbers.vector() - 1.0;
            let depth = 1.0 + 2.0 * numbers.next();
            let place = camera.eye + at.x * right + at.y * up + depth * forward;
            let mut record = Record {
                position: place.extend(1.0),
                normal: (2.0 * numbers.vector() - 1.0).extend(numbers.next()),
                geometric_normal: if i % 3 == 0 { Vec3::ZERO } else { 3.0 * (2.0 * numbers.vector() - 1.0) },
                albedo: 1.2 * numbers.vector(),
                specular: if i % 2 == 0 { Vec3::ZERO } else { 0.5 * numbers.vector() },
                emission: if i % 5 == 0 { 4.0 * numbers.vector() } else { Vec3::ZERO },
            };
            match i % 23 {
                2 => record.position.w = 0.0,
                3 => record.position.x = f32::NAN,
                4 => record.position.w = f32::INFINITY,
                5 => record.normal = Vec4::new(0.0, 0.0, 0.0, 0.5),
                6 => record.normal.y = f32::NEG_INFINITY,
                7 => record.albedo.z = f32::NAN,
                8 => record.specular.x = f32::INFINITY,
                9 => record.emission = Vec3::splat(f32::NAN),
                10 => record.geometric_normal.x = f32::NAN,
                11 => record.position = (camera.eye - forward).extend(1.0),
                12 => record.position.y = 2e9,
                13 => record.emission.y = -3.0,
                14 => record.normal.w = 7.0,
                _ => {}
            }
            record
        })
        .collect()
}

/// Writes records as a host does that has them on the processor.
fn write(ctx: &Context, rec: &mut Recorder, buffers: &Records, records: &[Record]) -> Staging {
    let mut staging = Staging::new();
    let mut stage = |buffer: &Buffer, of: &dyn Fn(&Record) -> Vec4| {
        let data: Vec<Vec4> = records.iter().map(of).collect();
        staging.stage_into(ctx, buffer, 0, &data).unwrap();
    };
    stage(&buffers.position, &|r| r.position);
    stage(&buffers.normal, &|r| r.normal);
    stage(&buffers.geometric_normal, &|r| r.geometric_normal.extend(0.0));
    stage(&buffers.albedo, &|r| r.albedo.extend(0.0));
    stage(&buffers.specular, &|r| r.specular.extend(0.0));
    stage(&buffers.emission, &|r| r.emission.extend(0.0));
    staging.record(rec).unwrap();
    staging
}

/// Records setup, these records and one pass.
fn pass_over(ctx: &Context, engine: &mut Engine, records: &[Record]) {
    ctx.submit_and_wait("setup", None, |rec| engine.record_setup(rec)).unwrap();
    let mut staged = None;
    ctx.submit_and_wait("records", None, |rec| {
        staged = Some(write(ctx, rec, engine.pass_buffers()?.g_buffer.unwrap(), records));
        Ok(())
    })
    .unwrap();
    ctx.submit_and_wait("a pass", None, |rec| engine.record_pass(rec)).unwrap();
}

#[test]
fn records_become_shading_points_by_their_oracle() {
    gpu_test(|ctx| {
        let scene = gallery();
        let settings = Settings { particles: 4, compensation: Compensation::Off, ..Settings::plain() };
        let (mut seen, mut refused, mut nothing) = (0, 0, 0);
        for (k, resolution) in AWKWARD_IMAGES.into_iter().enumerate() {
            for scene in [&scene, &orthographic(scene.clone())] {
                let camera = Camera { resolution, ..scene.camera.unwrap() };
                let records = records(&camera, 1000 * k as u32);
                let mut engine = Engine::with_view(ctx, scene, View::GBuffer { camera }, settings.clone()).unwrap();
                pass_over(ctx, &mut engine, &records);
                let frame = engine.plan().parameters(0).unwrap();
                let points = &engine.frame().eye.points;
                let get = |buffer: &Buffer| download::<Vec4>(ctx, buffer).unwrap();
                let [position, geometric, shading] = [&points.position, &points.geometric, &points.shading].map(get);
                let [kd, f0, wo, emitted] = [&points.kd, &points.f0, &points.wo, &points.emitted].map(get);
                let depth = get(&engine.frame().eye.paths.throughput);
                let mut expected_refused = 0;
                for (i, record) in records.iter().enumerate() {
                    let what = format!("{i} of {resolution:?}: {record:?}");
                    let told = g_buffer::reference(&frame, record);
                    let Told::Surface(point) = told else {
                        expected_refused += u32::from(told == Told::Refused);
                        nothing += usize::from(told == Told::Nothing);
                        assert!(!has(wo[i], ShadingPoints::HIT) && !has(wo[i], ShadingPoints::LIT), "{what}");
                        assert!(kd[i].truncate() == Vec3::ZERO && emitted[i].truncate() == Vec3::ZERO, "{what}");
                        assert!(position[i].is_finite() && geometric[i].is_finite() && wo[i].truncate().is_finite());
                        continue;
                    };
                    seen += 1;
                    assert!(has(wo[i], ShadingPoints::HIT) && has(wo[i], ShadingPoints::COVERED), "{what}");
                    let (found, expected) = (position[i].truncate(), point.position);
                    assert!(close(found, expected, 1e-5, 1e-6), "{what}: {found} for {expected}");
                    let [t, along] = point.distance;
                    assert!(
                        (position[i].w - t).abs() < 1e-4 * t && (depth[i].w - along).abs() < 1e-4 * along,
                        "{what}"
                    );
                    for (found, expected) in [
                        (geometric[i], point.normals.geometric),
                        (shading[i], point.normals.shading),
                        (wo[i], point.wo),
                        (kd[i], point.reflectance.kd),
                        (f0[i], point.reflectance.f0),
                        (emitted[i], point.emission),
                    ] {
                        assert!(close(found.truncate(), expected, 1e-4, 1e-5), "{what}: {found} for {expected}");
                    }
                    assert!((shading[i].w - point.reflectance.alpha).abs() < 1e-5, "{what}: alpha");
                    assert!((geometric[i].w - point.reflectance.f90).abs() < 1e-4, "{what}: f90");
                    assert!((kd[i].w - point.reflectance.diffuse_probability()).abs() < 1e-4, "{what}: probability");
                    let glossy = point.reflectance.f90 > 0.0;
                    assert_eq!(has(wo[i], ShadingPoints::GLOSSY), glossy, "{what}");
                }
                let buffers = engine.pass_buffers().unwrap();
                let counted = download::<u32>(ctx, &buffers.g_buffer.unwrap().refused).unwrap()[0];
                assert_eq!(counted, expected_refused, "{resolution:?}");
                refused += counted;
                // All that was summed are numbers.
                let film = engine.film().download(ctx, resolution).unwrap().mean();
                assert!(film.color.iter().all(|color| color.is_finite()));
            }
        }
        println!("{seen} seen, {refused} refused, {nothing} nothing");
        assert!(seen > 500 && refused > 100 && nothing > 10, "{seen} seen, {refused} refused, {nothing} nothing");
    });
}

/// The light at the points of an engine's own eye, given to another as a host's, is the same.
#[test]
fn light_is_that_at_the_points_of_the_engines_own_eye() {
    gpu_test(|ctx| {
        let (scene, camera, _) = small();
        for camera in [camera, Camera { height: Some(500.0), ..camera }] {
            let clip = Clip::Distance(60.0);
            let plain = Settings { particles: 8, antialias: false, glossy_paths: false, clip, ..Settings::plain() };
            let usual = Settings { antialias: false, glossy_paths: false, clip, ..Settings::interactive() };
            for (name, settings) in [
                ("clipped", Settings { compensation: Compensation::Off, ..plain.clone() }),
                ("near light by gather rays", plain.clone()),
                ("soft shadows", Settings { soft_shadows: Some(SoftShadows::default()), ..plain.clone() }),
                ("interactive", usual),
            ] {
                let mut own = Engine::new(ctx, &scene, camera, settings.clone()).unwrap();
                ctx.submit_and_wait("the engine's own eye", None, |rec| {
                    own.record_setup(rec)?;
                    own.record_pass(rec)
                })
                .unwrap();
                let get = |buffer: &Buffer| download::<Vec4>(ctx, buffer).unwrap();
                let points = &own.frame().eye.points;
                let [position, geometric, shading] = [&points.position, &points.geometric, &points.shading].map(get);
                let [kd, f0, wo, emitted] = [&points.kd, &points.f0, &points.wo, &points.emitted].map(get);
                let scale = own.plan().parameters(0).unwrap().eye[3];
                let records: Vec<Record> = (0..position.len())
                    .map(|i| {
                        let normal = geometric[i].truncate();
                        let place = offset_origin(position[i].truncate(), -normal, scale);
                        Record {
                            position: place.extend(if has(wo[i], ShadingPoints::HIT) { 1.0 } else { 0.0 }),
                            normal: shading[i].truncate().extend(shading[i].w.sqrt()),
                            geometric_normal: normal,
                            albedo: kd[i].truncate(),
                            specular: f0[i].truncate(),
                            emission: emitted[i].truncate(),
                        }
                    })
                    .collect();
                let view = View::GBuffer { camera };
                let mut given = Engine::with_view(ctx, &scene, view, settings).unwrap();
                pass_over(ctx, &mut given, &records);
                let of = |engine: &Engine| {
                    let buffers = engine.pass_buffers().unwrap();
                    [buffers.direct, buffers.indirect].map(get)
                };
                for (what, a, b) in
                    of(&own).into_iter().zip(of(&given)).zip(["direct", "indirect"]).map(|((a, b), w)| (w, a, b))
                {
                    let lit = |i: &usize| has(wo[*i], ShadingPoints::LIT);
                    let differ =
                        (0..a.len()).filter(lit).filter(|&i| !close(a[i].truncate(), b[i].truncate(), 2e-2, 1e-4));
                    let (differ, all) = (differ.count(), (0..a.len()).filter(lit).count());
                    let sum = |light: &[Vec4]| -> DVec3 {
                        (0..a.len()).filter(lit).map(|i| light[i].truncate().as_dvec3()).sum()
                    };
                    let ratio = sum(&b).element_sum() / sum(&a).element_sum();
                    println!("{name}, {what}: {differ} of {all} differ, energy {ratio:.5}");
                    // Where a pixel's ray passes tells which pixel shows a near hit or a shadow, and for the engine's own eye it was not the centre.
                    let most = match name {
                        "interactive" => all,
                        "soft shadows" => all / 5,
                        _ => all / 50,
                    };
                    assert!(all > 300 && differ <= most, "{name}, {what}: {differ} of {all} differ");
                    assert!((ratio - 1.0).abs() < 0.01, "{name}, {what}: energy {ratio}");
                }
            }
        }
    });
}

/// The surfaces that a rasterizer would have drawn: the first hits of rays through the centres of pixels.
fn rasterized(scene: &Scene, engine: &Engine, camera: &Camera) -> Vec<Option<(Vec3, Vec3, Vec3, Vec3)>> {
    let bvh = engine.bvh();
    let [width, height] = camera.resolution;
    (0..width * height)
        .map(|i| {
            let [x, y] = [i % width, i / width].map(|n| n as f32 + 0.5);
            let ray = eye_ray(camera, camera.resolution, x, y);
            let hit = bvh.closest(&ray)?;
            let material = &scene.materials[bvh.material(hit.triangle) as usize];
            assert_eq!(material.surface, Surface::Opaque);
            let normal = bvh.normal(hit.triangle);
            let front = normal.dot(ray.direction) < 0.0;
            let emission = if front { material.emission } else { Vec3::ZERO };
            Some((bvh.position(&hit), normal, material.base_color, emission))
        })
        .collect()
}

/// An image with these bytes, lent to be read, in a layout.
fn lent(
    ctx: &Context,
    format: vk::Format,
    size: [u32; 2],
    bytes: &[u8],
    layout: vk::ImageLayout,
) -> (HostsImage, Image) {
    let depth = format == vk::Format::D32_SFLOAT;
    let drawn = if depth { vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT } else { vk::ImageUsageFlags::empty() };
    let usage = vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST | drawn;
    let hosts = HostsImage::new(ctx, format, size, usage);
    // SAFETY: the image has memory, and lives until the device has finished.
    let image = unsafe { Image::adopt_to_read(ctx, "layer of the host", hosts.image) }.unwrap();
    let from = Buffer::new(ctx, "texels", bytes.len() as u64, Memory::Device).unwrap();
    let mut staging = Staging::new();
    staging.stage_into(ctx, &from, 0, bytes).unwrap();
    let aspect = if depth { vk::ImageAspectFlags::DEPTH } else { vk::ImageAspectFlags::COLOR };
    let layers = vk::ImageSubresourceLayers::default().aspect_mask(aspect).layer_count(1);
    let extent = vk::Extent3D { width: size[0], height: size[1], depth: 1 };
    let copy = [vk::BufferImageCopy::default().image_subresource(layers).image_extent(extent)];
    ctx.submit_and_wait("texels of the host", None, |rec| {
        staging.record(rec)?;
        rec.change_layout(&image, vk::ImageLayout::UNDEFINED, vk::ImageLayout::TRANSFER_DST_OPTIMAL)?;
        // SAFETY: the command buffer is recording, the image in this layout, and the buffer as large.
        unsafe {
            let (commands, to) = (rec.command_buffer(), hosts.image.handle);
            let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
            hosts.device.cmd_copy_buffer_to_image(commands, from.handle(), to, layout, &copy);
        }
        rec.change_layout(&image, vk::ImageLayout::TRANSFER_DST_OPTIMAL, layout)
    })
    .unwrap();
    (hosts, image)
}

fn floats(values: impl IntoIterator<Item = Vec4>) -> Vec<u8> {
    values.into_iter().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes).collect()
}

fn unorm(values: impl IntoIterator<Item = Vec4>) -> Vec<u8> {
    values.into_iter().flat_map(|v| v.to_array()).map(|x| (255.0 * x.clamp(0.0, 1.0)).round() as u8).collect()
}

const SHOWN: vk::ImageLayout = vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL;

/// The reversed depth of a rasterizer: matrices, and the images of what it shows.
#[test]
fn images_of_a_rasterizer_are_lit_as_the_engine_lights_them() {
    gpu_test(|ctx| {
        let (scene, camera, _) = small();
        let camera = Camera { resolution: [48, 40], ..camera };
        let settings =
            Settings { max_depth: 4, compensation: Compensation::Off, clip: Clip::Distance(60.0), ..Settings::plain() };
        let view = View::GBuffer { camera };
        let mut engine = Engine::with_view(ctx, &scene, view, settings.clone()).unwrap();
        ctx.submit_and_wait("setup", None, |rec| engine.record_setup(rec)).unwrap();
        let shown = rasterized(&scene, &engine, &camera);

        let [width, height] = camera.resolution;
        let aspect = width as f32 / height as f32;
        let projection =
            glam::camera::rh::proj::directx::perspective_infinite_reverse(camera.fov_y.to_radians(), aspect, 10.0);
        let clip_from_world = projection * glam::camera::rh::view::look_at_mat4(camera.eye, camera.target, camera.up);
        let world_from_clip = clip_from_world.as_dmat4().inverse().as_mat4();
        let depth_of = |p: Vec3| {
            let clip = clip_from_world.as_dmat4() * p.as_dvec3().extend(1.0);
            (clip.z / clip.w) as f32
        };
        let depth: Vec<f32> = shown.iter().map(|hit| hit.map_or(0.0, |(p, ..)| depth_of(p))).collect();
        let of = |what: &dyn Fn((Vec3, Vec3, Vec3, Vec3)) -> Vec3| -> Vec<Vec4> {
            shown.iter().map(|hit| hit.map_or(Vec4::ZERO, |hit| what(hit).extend(1.0))).collect()
        };
        let size = camera.resolution;
        let bytes = |depth: &[f32]| -> Vec<u8> { depth.iter().flat_map(|z| z.to_le_bytes()).collect() };
        let depth_layout = vk::ImageLayout::DEPTH_STENCIL_READ_ONLY_OPTIMAL;
        let (_a, depths) = lent(ctx, vk::Format::D32_SFLOAT, size, &bytes(&depth), depth_layout);
        let (_b, positions) =
            lent(ctx, vk::Format::R32G32B32A32_SFLOAT, size, &floats(of(&|(p, ..)| p)), vk::ImageLayout::GENERAL);
        let normals = of(&|(_, n, ..)| n);
        let (_c, normal) = lent(ctx, vk::Format::R32G32B32A32_SFLOAT, size, &floats(normals.clone()), SHOWN);
        let coded = normals.iter().map(|n| (0.5 * n + 0.5).truncate().extend(1.0));
        let (_d, normal_unorm) = lent(ctx, vk::Format::R8G8B8A8_UNORM, size, &unorm(coded), SHOWN);
        let (_e, albedo) = lent(ctx, vk::Format::R8G8B8A8_UNORM, size, &unorm(of(&|(_, _, c, _)| c)), SHOWN);
        let (_f, emission) = lent(ctx, vk::Format::R32G32B32A32_SFLOAT, size, &floats(of(&|(.., e)| e)), SHOWN);
        let given = |image, layout| GivenImage { image, layout };
        let by_depth = GBufferImages {
            place: Place::Depths { depths: given(&depths, depth_layout), world_from_clip, background: 0.0 },
            normal: given(&normal, SHOWN),
            geometric_normal: None,
            albedo: given(&albedo, SHOWN),
            specular: None,
            emission: Some(given(&emission, SHOWN)),
            offset: 0.02,
        };
        let by_position = GBufferImages {
            place: Place::Positions(given(&positions, vk::ImageLayout::GENERAL)),
            normal: given(&normal_unorm, SHOWN),
            geometric_normal: Some(given(&normal, SHOWN)),
            offset: 0.0,
            ..by_depth
        };

        // The records are those of the oracle.
        for (images, depth_told) in [(by_depth, Some((world_from_clip, 0.0))), (by_position, None)] {
            ctx.submit_and_wait("a G-buffer", None, |rec| engine.record_g_buffer(rec, &images)).unwrap();
            let buffers = engine.pass_buffers().unwrap().g_buffer.unwrap();
            let get = |buffer: &Buffer| download::<Vec4>(ctx, buffer).unwrap();
            let [position, normal, geometric] =
                [&buffers.position, &buffers.normal, &buffers.geometric_normal].map(get);
            let [albedo, specular, emission] = [&buffers.albedo, &buffers.specular, &buffers.emission].map(get);
            for (i, hit) in shown.iter().enumerate() {
                let (p, n, c, e) = hit.unwrap_or_default();
                let round = |x: f32| (255.0 * x.clamp(0.0, 1.0)).round() / 255.0;
                let coded = |n: Vec3| (0.5 * n + 0.5).map(round) * 2.0 - 1.0;
                let exact = depth_told.is_some();
                let nothing_seen = hit.is_none();
                let texels = Texels {
                    place: if exact {
                        Vec4::new(depth[i], 0.0, 0.0, 1.0)
                    } else {
                        p.extend(if nothing_seen { 0.0 } else { 1.0 })
                    },
                    normal: if exact { n } else { coded(if nothing_seen { -Vec3::ONE } else { n }) },
                    geometric_normal: (!exact).then_some(n),
                    albedo: c.map(round),
                    specular: None,
                    emission: Some(e),
                };
                let at = UVec2::new(i as u32 % width, i as u32 / width);
                let expected = g_buffer_read::reference(&texels, at, UVec2::from(size), depth_told, images.offset);
                assert_eq!(position[i].w, expected.position.w, "{i}");
                if nothing_seen {
                    continue;
                }
                let (found, wanted) = (position[i].truncate(), expected.position.truncate());
                assert!(
                    close(found, wanted, 1e-4, 1e-3) && close(found, p, 1e-3, 0.1),
                    "{i}: {found} for {wanted}, {p}"
                );
                assert!(
                    (normal[i] - expected.normal).abs().max_element() < 1e-5,
                    "{i}: {} for {expected:?}",
                    normal[i]
                );
                for (found, expected) in [
                    (geometric[i], expected.geometric_normal),
                    (albedo[i], expected.albedo),
                    (specular[i], expected.specular),
                    (emission[i], expected.emission),
                ] {
                    assert!(close(found.truncate(), expected, 1e-5, 1e-5), "{i}: {found} for {expected}");
                }
            }
        }

        // Within surfaces the picture is that of the engine's own eye; of edges it shows one point a pixel.
        let within = |i: &usize| {
            let (x, y) = (*i as u32 % width, *i as u32 / width);
            let inside = x > 0 && y > 0 && x + 1 < width && y + 1 < height;
            let alike = |j: u32| match (shown[*i], shown[j as usize]) {
                (Some((_, n, c, e)), Some((_, m, d, f))) => {
                    n.dot(m) > 0.99 && c == d && e == Vec3::ZERO && f == Vec3::ZERO
                }
                _ => false,
            };
            inside && (y - 1..y + 2).all(|y| (x - 1..x + 2).all(|x| alike(x + y * width)))
        };
        let pixels: Vec<usize> = (0..shown.len()).filter(within).collect();
        assert!(pixels.len() > 400, "{}", pixels.len());
        let cut = |layer: &[Vec3]| -> Vec<Vec3> { pixels.iter().map(|&i| layer[i]).collect() };
        let own = crate::scenes::render(ctx, &scene, camera, &settings, 24);
        for (what, images) in [("depths", by_depth), ("positions", by_position)] {
            engine.restart();
            for pass in 0..24 {
                ctx.submit_and_wait("a pass", None, |rec| {
                    if pass == 0 {
                        engine.record_g_buffer(rec, &images)?;
                    }
                    engine.record_pass(rec)
                })
                .unwrap();
            }
            let layers = engine.film().download(ctx, size).unwrap().mean();
            let (energy, rmse) = compare(&cut(&layers.color), &cut(&own.color));
            println!("{what}: energy {energy:.4}, relative RMSE {rmse:.4}");
            assert!((energy - 1.0).abs() < 0.01 && rmse < 0.08, "{what}: energy {energy}, RMSE {rmse}");
            let refused = &engine.pass_buffers().unwrap().g_buffer.unwrap().refused;
            assert_eq!(download::<u32>(ctx, refused).unwrap(), [0], "{what}");
        }
        // Another size needs images of that size, and sees nothing until it has them.
        engine.resize([20, 11]).unwrap();
        let mut error = None;
        ctx.submit_and_wait("a pass", None, |rec| {
            error = engine.record_g_buffer(rec, &by_depth).err();
            engine.record_pass(rec)
        })
        .unwrap();
        assert!(error.unwrap().to_string().contains("but the view has 20x11"));
        let layers = engine.film().download(ctx, [20, 11]).unwrap().mean();
        assert!(layers.color.iter().all(|color| *color == Vec3::ZERO));
    });
}

/// The example's rasterizer, and the light on what it draws, under the validation layer.
#[test]
fn the_example_lights_what_it_draws() {
    gpu_test(|_| {
        let host = example::Host::new(true).unwrap();
        let witness = host.lend().unwrap();
        let (scene, camera, _) = small();
        let camera = Camera { resolution: [48, 40], ..camera };
        let settings =
            Settings { max_depth: 4, compensation: Compensation::Off, clip: Clip::Distance(60.0), ..Settings::plain() };
        let given = example::run(&host, &scene, camera, settings.clone(), 16).unwrap();
        let own = example::embed::run(&host, &scene, camera, settings, 16).unwrap();
        // Of edges one shows a point a pixel, and the other a mean.
        let pixels = |picture: &example::Picture| -> Vec<Vec3> {
            picture.texels.iter().map(|&[r, g, b, _]| Vec3::new(r, g, b)).collect()
        };
        let (given, own) = (pixels(&given), pixels(&own));
        let within = |i: &usize| {
            let (x, y) = (i % 48, i / 48);
            let around = |dx: usize, dy: usize| own[(x + dx - 1) + 48 * (y + dy - 1)];
            x > 0
                && y > 0
                && x < 47
                && y < 39
                && (0..9).all(|k| around(k % 3, k / 3).distance(own[*i]) < 0.3 * own[*i].length())
        };
        let chosen: Vec<usize> = (0..own.len()).filter(within).collect();
        assert!(chosen.len() > 500, "{}", chosen.len());
        let cut = |image: &[Vec3]| -> Vec<Vec3> { chosen.iter().map(|&i| image[i]).collect() };
        let (energy, rmse) = compare(&cut(&given), &cut(&own));
        println!("{} pixels: energy {energy:.4}, relative RMSE {rmse:.4}", chosen.len());
        assert!((energy - 1.0).abs() < 0.01 && rmse < 0.08, "energy {energy}, RMSE {rmse}");
        assert_silent(witness.take_messages());
    });
}

/// Images and views that hold no G-buffer are refused by name.
#[test]
fn what_holds_no_g_buffer_is_refused() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = small();
        let size = camera.resolution;
        let pixels = (size[0] * size[1]) as usize;
        let zeros = vec![Vec4::ZERO; pixels];
        let (_a, floats_image) = lent(ctx, vk::Format::R32G32B32A32_SFLOAT, size, &floats(zeros.clone()), SHOWN);
        let (_b, bytes_image) = lent(ctx, vk::Format::R8G8B8A8_UNORM, size, &unorm(zeros), SHOWN);
        let (_c, small_image) = lent(ctx, vk::Format::R8G8B8A8_UNORM, [2, 3], &[0; 24], SHOWN);
        let given = |image| GivenImage { image, layout: SHOWN };
        let images = GBufferImages {
            place: Place::Positions(given(&floats_image)),
            normal: given(&floats_image),
            geometric_normal: None,
            albedo: given(&bytes_image),
            specular: None,
            emission: None,
            offset: 0.0,
        };
        let mut engine = Engine::with_view(ctx, &scene, View::GBuffer { camera }, settings.clone()).unwrap();
        let mut own = Engine::new(ctx, &scene, camera, settings.clone()).unwrap();
        let attempt = |engine: &mut Engine, images: GBufferImages, part: &str| {
            let mut error = None;
            ctx.submit_and_wait("refused", None, |rec| {
                error = engine.record_g_buffer(rec, &images).err();
                Ok(())
            })
            .unwrap();
            let error = error.unwrap_or_else(|| panic!("{part} is taken"));
            assert!(matches!(error, Error::Resource { .. }) && error.to_string().contains(part), "{error}");
        };
        attempt(&mut engine, images, "record_setup comes before");
        ctx.submit_and_wait("setup", None, |rec| {
            engine.record_setup(rec)?;
            own.record_setup(rec)
        })
        .unwrap();
        attempt(&mut own, images, "View::GBuffer");
        let place = Place::Positions(given(&bytes_image));
        attempt(&mut engine, GBufferImages { place, ..images }, "holds no positions");
        let matrix = Place::Depths { depths: given(&bytes_image), world_from_clip: Mat4::IDENTITY, background: 1.0 };
        attempt(&mut engine, GBufferImages { place: matrix, ..images }, "holds no depths");
        attempt(&mut engine, GBufferImages { albedo: given(&small_image), ..images }, "has 2x3 pixels of albedo");
        let undefined = GivenImage { image: &floats_image, layout: vk::ImageLayout::UNDEFINED };
        attempt(&mut engine, GBufferImages { emission: Some(undefined), ..images }, "in which it holds nothing");
        attempt(&mut engine, GBufferImages { offset: f32::NAN, ..images }, "not finite");
        let (_d, depths) = lent(ctx, vk::Format::R32_SFLOAT, size, &vec![0; 4 * pixels], SHOWN);
        let singular = Place::Depths { depths: given(&depths), world_from_clip: Mat4::ZERO, background: 1.0 };
        attempt(&mut engine, GBufferImages { place: singular, ..images }, "singular");
        let stored = HostsImage::new(ctx, vk::Format::R32_SFLOAT, size, vk::ImageUsageFlags::STORAGE);
        // SAFETY: the image has memory, and lives until the device has finished.
        let unread = unsafe { Image::adopt_to_read(ctx, "not sampled", stored.image) }.err().unwrap();
        assert!(unread.to_string().contains("make it with SAMPLED"), "{unread}");

        let refused = |camera: Camera, settings: Settings, names: &[&str]| {
            let error = Engine::with_view(ctx, &scene, View::GBuffer { camera }, settings).err().unwrap().to_string();
            assert!(names.iter().all(|name| error.contains(name)), "{error}");
        };
        refused(Camera { shutter: 1.0, ..camera }, settings.clone(), &["--shutter", "use 0"]);
        let mirrors = Settings { superposition: Some(Superposition::default()), ..settings.clone() };
        refused(camera, mirrors, &["--superposition", "use off"]);
        refused(camera, Settings { splats: Some(Splats::default()), ..settings.clone() }, &["--glossy", "use paths"]);
        refused(Camera { resolution: [0, 5], ..camera }, settings, &["0x5"]);
        assert!(engine.set_region(None).unwrap_err().to_string().contains("as a whole"));
        // Pixels that see nothing stay black, with a coverage of 0.
        ctx.submit_and_wait("a pass", None, |rec| {
            engine.record_g_buffer(rec, &images)?;
            engine.record_pass(rec)
        })
        .unwrap();
        let layers = engine.film().download(ctx, size).unwrap().mean();
        assert!(layers.color.iter().all(|c| *c == Vec3::ZERO) && layers.alpha.iter().all(|a| *a == 0.0));
        // The camera moves, and the kind of the view stays.
        engine.set_camera(Camera { eye: camera.eye + Vec3::X, ..camera }).unwrap();
        assert!(engine.view().is_g_buffer());
    });
}
