//! For hosts: cameras by matrices, light in images of the host, buffers of a pass in its shaders.

use std::sync::Arc;

use ash::vk;
use glam::camera::{lh, rh};
use glam::{Affine3A, Mat4, Quat, Vec3};
use lightsum::gpu::{Buffer, Context, HostImage, Image, Memory};
use lightsum::output::Layers;
use lightsum::scene::{Camera, Light, Material, Mesh};
use lightsum::settings::{Clip, Compensation, Settings};
use lightsum::view::{Atlas, Texel};
use lightsum::{Engine, Error, Renderer, Scene, View};

use crate::bake::with_light;
use crate::embed::small;
use crate::support::{assert_silent, gpu_test};

#[allow(dead_code, reason = "its main is the example's own")]
#[path = "../../examples/lights_for_rasterizer.rs"]
pub mod lights_for_rasterizer;

/// View and projection of a camera, and the camera that they give, with `change` applied to clip space.
fn by_matrices(camera: &Camera, resolution: [u32; 2], change: Mat4) -> Camera {
    let (_, up, forward) = camera.world_from_camera();
    let [width, height] = camera.resolution.map(|n| n as f32);
    let projection = rh::proj::directx::perspective_infinite_reverse(camera.fov_y.to_radians(), width / height, 0.1);
    Camera::from_matrices(rh::view::look_to_mat4(camera.eye, forward, up), change * projection, resolution).unwrap()
}

/// An image of four passes. Clip and lights do not depend on what the view shows: matte surfaces of the Cornell box, and a fixed distance.
fn image(ctx: &Context, scene: &Scene, camera: Camera, compensation: Compensation) -> Layers {
    let settings = Settings { compensation, clip: Clip::Distance(60.0), ..small().2 };
    let mut renderer = Renderer::with_context(ctx.clone(), scene.clone(), camera, settings).unwrap();
    (0..4).for_each(|_| renderer.pass().unwrap());
    renderer.layers().unwrap()
}

/// Pixels that differ by more than rounding, of those of two images.
fn differ<'a>(a: impl Iterator<Item = &'a Vec3>, b: impl Iterator<Item = &'a Vec3>) -> usize {
    a.zip(b).filter(|(a, b)| a.distance(**b) > 1e-3 * a.length().max(1e-3)).count()
}

#[test]
fn matrices_show_the_image_of_the_camera() {
    gpu_test(|ctx| {
        let (scene, camera, _) = small();
        let expected = image(ctx, &scene, camera, Compensation::Off);
        let found = image(ctx, &scene, by_matrices(&camera, camera.resolution, Mat4::IDENTITY), Compensation::Off);
        // Rays differ by rounding, and a few pass an edge on the other side.
        let pixels = differ(expected.color.iter(), found.color.iter());
        println!("{pixels} of {} pixels differ", expected.color.len());
        assert!(pixels * 100 <= expected.color.len(), "{pixels}");
    });
}

/// The right lower part of an image, as an off-centre projection with half the resolution.
#[test]
fn off_centre_projections_show_a_part_of_the_image() {
    gpu_test(|ctx| {
        let (scene, camera, _) = small();
        let camera = Camera { resolution: [64, 48], ..camera };
        // Columns 24 to 55 and rows 16 to 39: the centre of the part is 8 pixels to the right and 4 below.
        let change =
            Mat4::from_scale(Vec3::new(2.0, 2.0, 1.0)) * Mat4::from_translation(Vec3::new(-0.25, 8.0 / 48.0, 0.0));
        let part = by_matrices(&camera, [32, 24], change);
        assert!(part.shift().iter().all(|s| s.abs() > 0.3), "{part:?}");
        let whole = image(ctx, &scene, camera, Compensation::Off);
        let found = image(ctx, &scene, part, Compensation::Off);
        let cut = |layer: &[Vec3]| -> Vec<Vec3> {
            (16..40).flat_map(|y| layer[64 * y + 24..64 * y + 56].iter().copied()).collect()
        };
        for (name, whole, found) in [
            ("color", &whole.color, &found.color),
            ("albedo", &whole.albedo, &found.albedo),
            ("normal", &whole.normal, &found.normal),
        ] {
            let pixels = differ(cut(whole).iter(), found.iter());
            println!("{name}: {pixels} of {} pixels differ", found.len());
            assert!(pixels * 100 <= found.len(), "{name}: {pixels}");
        }
    });
}

#[test]
fn an_engine_takes_matrices_and_refuses_those_without_an_image() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = small();
        let mut engine = Engine::new(ctx, &scene, Camera { aperture: 3.0, ..camera }, settings).unwrap();
        let view = lh::view::look_at_mat4(camera.eye, camera.target, Vec3::Y);
        engine.set_matrices(view, lh::proj::directx::perspective(1.0, 33.0 / 21.0, 1.0, 1e4)).unwrap();
        let set = *engine.view().camera().unwrap();
        assert_eq!((set.resolution, set.aperture, set.focus), (camera.resolution, 3.0, Some(camera.focus_distance())));
        assert!(set.half_extents()[0] < 0.0, "a left-handed view mirrors the right-handed one: {set:?}");
        let refused =
            engine.set_matrices(view, lh::proj::directx::orthographic(-1.0, 1.0, -1.0, 1.0, -1.0, 1.0)).unwrap_err();
        assert!(refused.to_string().contains("both sides of the eye"), "{refused}");
        assert_eq!(engine.view().camera(), Some(&set));
    });
}

/// An image as a host makes it.
pub struct HostsImage {
    pub device: ash::Device,
    pub image: HostImage,
    memory: vk::DeviceMemory,
}

impl HostsImage {
    pub fn new(ctx: &Context, format: vk::Format, size: [u32; 2], usage: vk::ImageUsageFlags) -> HostsImage {
        let create = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width: size[0], height: size[1], depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(usage);
        let device = ctx.raw_device().clone();
        // SAFETY: plain Vulkan; any type that the image takes will do.
        unsafe {
            let handle = device.create_image(&create, None).unwrap();
            let needs = device.get_image_memory_requirements(handle);
            let allocate = vk::MemoryAllocateInfo::default()
                .allocation_size(needs.size)
                .memory_type_index(needs.memory_type_bits.trailing_zeros());
            let memory = device.allocate_memory(&allocate, None).unwrap();
            device.bind_image_memory(handle, memory, 0).unwrap();
            HostsImage { device, image: HostImage { handle, format, size, usage }, memory }
        }
    }

    fn lend(&self, ctx: &Context) -> Result<Image, Error> {
        // SAFETY: the image has memory, and lives until the device has finished.
        unsafe { Image::adopt(ctx, "picture", self.image) }
    }
}

impl Drop for HostsImage {
    fn drop(&mut self) {
        // SAFETY: the tests wait for their commands.
        unsafe {
            self.device.destroy_image(self.image.handle, None);
            self.device.free_memory(self.memory, None);
        }
    }
}

/// The number of 16 bits.
fn from_half(bits: u16) -> f32 {
    let (sign, exponent, rest) = (bits >> 15, i32::from(bits >> 10 & 31), f32::from(bits & 1023));
    let size = match exponent {
        0 => rest * 2f32.powi(-24),
        31 => f32::INFINITY,
        e => (1.0 + rest / 1024.0) * 2f32.powi(e - 15),
    };
    if sign == 1 { -size } else { size }
}

const TO_COPY: vk::ImageUsageFlags =
    vk::ImageUsageFlags::from_raw(vk::ImageUsageFlags::STORAGE.as_raw() | vk::ImageUsageFlags::TRANSFER_SRC.as_raw());

/// Records the image of the engine and that of the host, and reads both: the host's in the layout that it asked for.
fn images_of(ctx: &Context, engine: &Engine, format: vk::Format) -> [Vec<[f32; 4]>; 2] {
    let size = engine.view().size();
    let picture = HostsImage::new(ctx, format, size, TO_COPY);
    let lent = picture.lend(ctx).unwrap();
    let texel = if format == vk::Format::R16G16B16A16_SFLOAT { 8 } else { 16 };
    let [own, hosts] = [16, texel]
        .map(|bytes| Buffer::new(ctx, "copy", bytes * u64::from(size[0] * size[1]), Memory::Readback).unwrap());
    let layers = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
    let extent = vk::Extent3D { width: size[0], height: size[1], depth: 1 };
    let copy = [vk::BufferImageCopy::default().image_subresource(layers).image_extent(extent)];
    let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
    ctx.submit_and_wait("images", None, |rec| {
        engine.record_image(rec)?;
        rec.copy_image_to_buffer(engine.image(), &own)?;
        engine.record_image_to(rec, &lent, [vk::ImageLayout::UNDEFINED, layout])?;
        // SAFETY: the command buffer is recording, the image in this layout, and the buffer as large.
        unsafe {
            let (commands, from) = (rec.command_buffer(), picture.image.handle);
            picture.device.cmd_copy_image_to_buffer(commands, from, layout, hosts.handle(), &copy);
        }
        // Once more, from the layout that it left.
        engine.record_image_to(rec, &lent, [layout, vk::ImageLayout::GENERAL])
    })
    .unwrap();
    let of_hosts = match texel {
        8 => hosts.read::<[u16; 4]>().unwrap().into_iter().map(|texel| texel.map(from_half)).collect(),
        _ => hosts.read().unwrap(),
    };
    [own.read().unwrap(), of_hosts]
}

#[test]
fn images_of_the_host_show_what_the_engine_shows() {
    gpu_test(|ctx| {
        let (mut scene, camera, settings) = small();
        // One lamp is brighter than numbers of 16 bits.
        let lamp = scene.materials.iter_mut().find(|material| material.emission != Vec3::ZERO).unwrap();
        lamp.emission = Vec3::new(1e6, 30.0, 20.0);
        let mut engine = Engine::new(ctx, &scene, camera, settings).unwrap();
        ctx.submit_and_wait("a pass", None, |rec| {
            engine.record_setup(rec)?;
            engine.record_pass(rec)
        })
        .unwrap();
        let [own, hosts] = images_of(ctx, &engine, vk::Format::R32G32B32A32_SFLOAT);
        assert_eq!(own, hosts);
        assert!(own.iter().any(|texel| texel[0] > 65504.0), "no lamp is seen");

        // Another size, with the same tree.
        let nodes = engine.bvh().node_min.as_ptr();
        engine.resize([20, 11]).unwrap();
        ctx.submit_and_wait("a pass", None, |rec| engine.record_pass(rec)).unwrap();
        assert_eq!(engine.bvh().node_min.as_ptr(), nodes);
        let [own, hosts] = images_of(ctx, &engine, vk::Format::R16G16B16A16_SFLOAT);
        assert_eq!(own.len(), 20 * 11);
        for (own, hosts) in own.iter().flatten().zip(hosts.iter().flatten()) {
            let expected = own.min(65504.0);
            // Rounded to 11 bits, or to the step of the least numbers.
            assert!((hosts - expected).abs() <= expected.abs() / 1024.0 + 2f32.powi(-24), "{hosts} for {own}");
        }
    });
}

#[test]
fn images_that_cannot_hold_the_light_are_refused() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = small();
        let mut engine = Engine::new(ctx, &scene, camera, settings).unwrap();
        let float = vk::Format::R32G32B32A32_SFLOAT;
        let refused = |result: Result<Image, Error>, part: &str| {
            let error = result.map(|_| ()).unwrap_err().to_string();
            assert!(error.starts_with("picture: ") && error.contains(part), "{error}");
        };
        let sampled = HostsImage::new(ctx, float, [33, 21], vk::ImageUsageFlags::TRANSFER_SRC);
        refused(sampled.lend(ctx), "make it with STORAGE");
        let depth = HostImage { format: vk::Format::D32_SFLOAT, usage: TO_COPY, ..sampled.image };
        // SAFETY: it is refused before it is used.
        refused(unsafe { Image::adopt(ctx, "picture", depth) }, "none of the formats");
        let other = HostsImage::new(ctx, float, [32, 21], TO_COPY);
        let bytes = HostsImage::new(ctx, vk::Format::R8G8B8A8_UNORM, [33, 21], TO_COPY);
        let right = HostsImage::new(ctx, float, [33, 21], TO_COPY);
        let [other, bytes, right] = [&other, &bytes, &right].map(|image| image.lend(ctx).unwrap());
        ctx.submit_and_wait("images", None, |rec| {
            engine.record_setup(rec)?;
            let layouts = [vk::ImageLayout::UNDEFINED, vk::ImageLayout::GENERAL];
            for (image, layouts, part) in [
                (&other, layouts, "has 32x21 pixels, but the view has 33x21"),
                (&bytes, layouts, "not as R8G8B8A8_UNORM"),
                (&right, [vk::ImageLayout::UNDEFINED; 2], "no image can be brought to the layout UNDEFINED"),
            ] {
                let error = engine.record_image_to(rec, image, layouts).unwrap_err().to_string();
                assert!(error.starts_with("picture: ") && error.contains(part), "{error}");
            }
            Ok(())
        })
        .unwrap();
    });
}

/// A kernel of the host, by the snippet of the documentation, against lightsum's sums: classes of pixels and kinds of lights included.
#[test]
fn shaders_of_the_host_light_points_by_virtual_lights() {
    gpu_test(|_| {
        let host = lights_for_rasterizer::Host::new(true).unwrap();
        let witness = host.lend().unwrap();
        let (mut scene, camera, settings) = small();
        let (spot, parallel) = (Vec3::new(200.0, 500.0, 200.0), Vec3::new(0.3, -0.5, 0.8).normalize());
        let direction = Vec3::new(0.2, -1.0, 0.3).normalize();
        let intensity = Vec3::new(3e5, 2e5, 1e5);
        scene.lights.push(Light::Spot { position: spot, direction, intensity, inner: 0.3, outer: 0.7 });
        scene.lights.push(Light::Directional { direction: parallel, irradiance: Vec3::splat(0.5) });
        for pattern in [[1, 1], [2, 3]] {
            let settings = Settings { pattern, clip: Clip::Distance(100.0), particles: 8, ..settings.clone() };
            let lit = lights_for_rasterizer::run(&host, &scene, camera, settings).unwrap();
            assert!(lit.by_host.len() > 33 * 21 / 2, "{} pixels reflect light", lit.by_host.len());
            let apart = |(a, b): &(&[f32; 4], &[f32; 4])| (0..3).any(|c| (a[c] - b[c]).abs() > 1e-3 * b[c] + 1e-5);
            let differ = lit.by_host.iter().zip(&lit.by_lightsum).filter(apart).count();
            println!("{pattern:?}: {differ} of {} pixels differ", lit.by_host.len());
            // Rays within rounding of an edge.
            assert!(differ * 100 <= lit.by_host.len(), "{pattern:?}: {differ}");
        }
        assert_silent(witness.take_messages());
    });
}

/// Reads the light at points after the functions of `kept_light.wgsl` or `.glsl`.
const KEPT_WGSL: &str = "
@group(0) @binding(3) var<storage, read> points: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read_write> light: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&points) {
        let p = points[id.x];
        let kept = kept_irradiance(p.x, bitcast<vec2<f32>>(p.yz), p.w != 0u);
        light[2u * id.x] = vec4<f32>(kept.direct, 0.0);
        light[2u * id.x + 1u] = vec4<f32>(kept.indirect, 0.0);
    }
}
";
const KEPT_GLSL: &str = "
layout(local_size_x = 64) in;
layout(set = 0, binding = 3, std430) readonly buffer Points { uvec4 points[]; };
layout(set = 0, binding = 4, std430) buffer Light { vec4 light[]; };

void main() {
    if (gl_GlobalInvocationID.x < uint(points.length())) {
        uvec4 p = points[gl_GlobalInvocationID.x];
        Kept kept = kept_irradiance(p.x, uintBitsToFloat(p.yz), p.w != 0u);
        light[2u * gl_GlobalInvocationID.x] = vec4(kept.direct, 0.0);
        light[2u * gl_GlobalInvocationID.x + 1u] = vec4(kept.indirect, 0.0);
    }
}
";

/// GLSL as SPIR-V.
fn compile_glsl(source: &str) -> Vec<u32> {
    use naga::valid::{ValidationFlags, Validator};
    let options = naga::front::glsl::Options::from(naga::ShaderStage::Compute);
    let module = naga::front::glsl::Frontend::default().parse(&options, source).unwrap();
    let info = Validator::new(ValidationFlags::all(), lights_for_rasterizer::CAPABILITIES).validate(&module).unwrap();
    naga::back::spv::write_vec(&module, &info, &naga::back::spv::Options::default(), None).unwrap()
}

/// Kernels of the host, by the snippets of the documentation, against the look-up on the processor.
#[test]
fn shaders_of_the_host_read_light_that_was_kept() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = small();
        let scene = with_light(scene);
        let kept = scene.kept_light.clone().unwrap();
        let mut engine = Engine::new(ctx, &scene, camera, settings).unwrap();
        let leaves = engine.bvh().leaf_numbers();
        let places = [[0.2f32, 0.3], [0.0, 0.0], [0.7, 0.3], [1.0 / 3.0, 1.0 / 3.0]];
        let points: Vec<(u32, [f32; 2], bool)> = (0..scene.triangles.len() as u32)
            .flat_map(|triangle| places.map(|uv| (triangle, uv)))
            .flat_map(|(triangle, uv)| [false, true].map(|back| (triangle, uv, back)))
            .collect();
        let words: Vec<[u32; 4]> = points
            .iter()
            .map(|&(triangle, [u, v], back)| [leaves[triangle as usize], u.to_bits(), v.to_bits(), u32::from(back)])
            .collect();
        let bytes = 16 * words.len() as u64;
        let asked = Buffer::new(ctx, "points", bytes, Memory::Upload).unwrap();
        asked.write(0, &words.iter().flatten().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>()).unwrap();
        let wgsl = [include_str!("../../examples/shaders/kept_light.wgsl"), KEPT_WGSL].concat();
        let glsl = ["#version 450\n", include_str!("../../examples/shaders/kept_light.glsl"), KEPT_GLSL].concat();
        let sources = [("WGSL", lights_for_rasterizer::compile(&wgsl).unwrap()), ("GLSL", compile_glsl(&glsl))];
        for (language, code) in sources {
            let kernel = lights_for_rasterizer::Kernel::new(ctx, &code, 5).unwrap();
            let found = Buffer::new(ctx, "light", 2 * bytes, Memory::Readback).unwrap();
            ctx.submit_and_wait("kept light", None, |rec| {
                engine.record_setup(rec)?;
                let light = engine.pass_buffers()?.kept_light.unwrap();
                let buffers = [&light.faces, &light.pages, &light.texels, &asked, &found];
                kernel.record(rec.command_buffer(), &buffers, &[], points.len() as u32);
                Ok(())
            })
            .unwrap();
            engine.setup_finished();
            let found = found.read::<[f32; 4]>().unwrap();
            let greatest = |page: u32| {
                let page = &kept.pages[page as usize];
                page.direct.iter().chain(&page.indirect).map(|e| e.max_element()).fold(0.0, f32::max)
            };
            for (i, &(triangle, uv, back)) in points.iter().enumerate() {
                let expected = kept.irradiance(triangle, back, uv);
                let face = kept.faces[triangle as usize][usize::from(back)];
                let scale = face.map_or(0.0, |face| greatest(face.page));
                for part in 0..2 {
                    let [x, y, z, _] = found[2 * i + part];
                    let error = Vec3::new(x, y, z).distance(expected[part]);
                    // Texels are halves.
                    assert!(error <= 2e-3 * scale, "{language} {triangle} {uv:?} {back}: {error} of {scale}");
                }
            }
        }
    });
}

/// The image of an engine whose scene may change, after some passes.
fn image_of(ctx: &Context, engine: &mut Engine) -> Vec<[f32; 4]> {
    let out = Buffer::new(ctx, "image", engine.image().bytes(), Memory::Readback).unwrap();
    ctx.submit_and_wait("passes", None, |rec| {
        if engine.passes() == 0 {
            engine.record_setup(rec)?;
        }
        (0..2).try_for_each(|_| engine.record_pass(rec))?;
        engine.record_image(rec)?;
        rec.copy_image_to_buffer(engine.image(), &out)
    })
    .unwrap();
    engine.setup_finished();
    out.read().unwrap()
}

/// A wedge that has another shape when it is mirrored, with smooth normals and colours.
fn wedge() -> Mesh {
    let positions = [[0., 0., 0.], [150., 0., 0.], [0., 0., 150.], [0., 200., 0.]].map(Vec3::from);
    let mut mesh = Mesh::new(positions.to_vec(), vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]);
    let centre = positions.iter().sum::<Vec3>() / 4.0;
    mesh.normals = positions.iter().map(|p| (p - centre).normalize()).collect();
    mesh.colors = vec![Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE];
    mesh
}

/// An object that comes, is mirrored and goes shows the image of a new engine each time.
#[test]
fn objects_come_and_go_and_are_mirrored() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = small();
        let placed = |scale: f32| {
            Affine3A::from_scale_rotation_translation(
                Vec3::new(scale, 1.0, 1.0),
                Quat::from_rotation_y(0.4),
                Vec3::new(250.0, 20.0, 100.0),
            )
        };
        let new = |scene: &Scene| Engine::new_dynamic(ctx, scene.clone(), camera, settings.clone()).unwrap();
        let mut engine = new(&scene);
        let empty = image_of(ctx, &mut engine);
        let count = engine.scene().unwrap().objects.len() as u32;
        let paint = Material { name: String::from("paint"), base_color: Vec3::splat(0.8), ..Material::default() };
        let material = engine.add_material(paint).unwrap();
        let wedge = wedge();
        assert_eq!(engine.add_object("wedge", &wedge, material, placed(1.0)).unwrap(), count);
        assert_eq!(engine.passes(), 0, "the image starts anew");
        let with = image_of(ctx, &mut engine);
        assert!(with != empty);
        for scale in [-1.0, 1.0, -1.5] {
            engine.set_transform(count, placed(scale)).unwrap();
            let moved = image_of(ctx, &mut engine);
            assert_eq!(moved == with, scale == 1.0, "by {scale}");
            let mut fresh = new(engine.scene().unwrap());
            assert_eq!(moved, image_of(ctx, &mut fresh), "by {scale}, a new engine");
            // Added there, it is the same.
            let mut added = new(&scene);
            let material = added.add_material(engine.scene().unwrap().materials[material as usize].clone()).unwrap();
            added.add_object("wedge", &wedge, material, placed(scale)).unwrap();
            assert_eq!(moved, image_of(ctx, &mut added), "by {scale}, added");
        }
        // The objects after one that goes keep their indices, and may move.
        let block = engine.scene().unwrap().objects_named("tall_block")[0];
        engine.remove_object(block).unwrap();
        engine.set_transform(count, placed(2.0)).unwrap();
        let without = image_of(ctx, &mut engine);
        let mut fresh = new(engine.scene().unwrap());
        assert_eq!(without, image_of(ctx, &mut fresh));
        let refused = |error: Error, part: &str| assert!(error.to_string().contains(part), "{error}");
        refused(engine.remove_object(block).unwrap_err(), "it has no triangles");
        refused(engine.remove_object(99).unwrap_err(), "object 99 does not exist");
        refused(engine.add_object("wedge", &wedge, 99, placed(1.0)).unwrap_err(), "\"wedge\": material 99");
        let lamp = engine.scene().unwrap().objects_named("light")[0];
        refused(engine.remove_object(lamp).unwrap_err(), "light");
        assert_eq!(without, image_of(ctx, &mut new(engine.scene().unwrap())), "what is refused changes nothing");
        let mut still = Engine::new(ctx, &scene, camera, settings).unwrap();
        refused(still.add_object("wedge", &wedge, 0, placed(1.0)).unwrap_err(), "Engine::new_dynamic");
    });
}

/// A visibility buffer of the host: texels that it writes on the device, over those that the engine was made with.
#[test]
fn texels_written_on_the_device_are_lit() {
    gpu_test(|ctx| {
        let (scene, _, settings) = small();
        // The same sides of triangles in both, so that lengths that follow from the view are the same.
        let texel = |i: u32| {
            let uv = [0.2 + 0.001 * i as f32, 0.3];
            (!i.is_multiple_of(7)).then_some(Texel { triangle: i % scene.triangles.len() as u32, uv, back: false })
        };
        let texels: Vec<_> = (0..16 * 9).map(texel).collect();
        let of = |texels: Vec<_>| {
            let view = View::Atlas(Arc::new(Atlas::new([16, 9], texels)));
            Engine::with_view(ctx, &scene, view, settings.clone()).unwrap()
        };
        let (mut wanted, mut other) = (of(texels.clone()), of(texels.into_iter().rev().collect()));
        let expected = image_of(ctx, &mut wanted);
        let unwritten = image_of(ctx, &mut other);
        assert!(unwritten != expected && expected.iter().any(|texel| texel[1] > 0.0));
        other.restart();
        ctx.submit_and_wait("texels of the host", None, |rec| {
            let [from, to] = [&wanted, &other].map(|engine| engine.pass_buffers().unwrap().texels.unwrap().clone());
            other.record_setup(rec)?;
            rec.copy(&from, &to)?;
            (0..2).try_for_each(|_| other.record_pass(rec))
        })
        .unwrap();
        let out = Buffer::new(ctx, "image", other.image().bytes(), Memory::Readback).unwrap();
        ctx.submit_and_wait("the image", None, |rec| {
            other.record_image(rec)?;
            rec.copy_image_to_buffer(other.image(), &out)
        })
        .unwrap();
        assert_eq!(out.read::<[f32; 4]>().unwrap(), expected);
    });
}
