//! lightsum on the device of wgpu.
//!
//! ```text
//! cargo run --release --manifest-path examples/wgpu/Cargo.toml
//! ```
//!
//! wgpu makes instance, device and queue, and lends them ([`lend`]). lightsum records its passes into a command encoder of wgpu ([`record`]),
//! writes the image into a texture of wgpu ([`adopt`]), and its buffers are bound in a shader of wgpu, in GLSL ([`share`]). The program
//! compares all with what lightsum itself finds, and fails if they differ.

use std::error::Error;

use lightsum::ash::vk;
use lightsum::glam::camera::rh;
use lightsum::glam::{Affine3A, Quat, Vec3};
use lightsum::gpu::{Buffer, Context, ContextOptions, HostDevice, HostImage, Image, Memory, Recorder};
use lightsum::pass::ShadingPoints;
use lightsum::scene::{Material, Mesh, SceneBuilder};
use lightsum::settings::Compensation;
use lightsum::{Camera, Engine, Scene, Settings};
use wgpu::hal::api::Vulkan;

type Result<T, E = Box<dyn Error>> = std::result::Result<T, E>;

/// Rows of 8 bytes a pixel are multiples of 256 bytes, as wgpu wants them.
const SIZE: [u32; 2] = [64, 48];

/// The kernel, after `virtual_lights.glsl`.
const KERNEL: &str = "
layout(set = 0, binding = 6, std430) readonly buffer Position { vec4 position[]; };
layout(set = 0, binding = 7, std430) readonly buffer Normal { vec4 normal[]; };
layout(set = 0, binding = 8, std430) buffer Lit { vec4 lit[]; };
layout(set = 0, binding = 9, std140) uniform Numbers { uvec4 counts; vec4 lengths; };
layout(local_size_x = 64) in;

void main() {
    uint pixel = gl_GlobalInvocationID.x;
    if (pixel >= counts.x) {
        return;
    }
    vec3 x = position[pixel].xyz;
    vec3 sum = vec3(0.0);
    for (uint i = 0u; i < counts.y; i += 1u) {
        vec3 to = to_light(lights[i], x, lengths.y);
        vec3 e = irradiance(lights[i], to, normal[pixel].xyz, lengths.x);
        if (max(e.x, max(e.y, e.z)) > 0.0 && !is_blocked(x, to, counts.z)) {
            sum += e;
        }
    }
    lit[pixel] = vec4(sum, 0.0);
}
";

fn main() -> Result<()> {
    pollster::block_on(run())
}

async fn run() -> Result<()> {
    let mut description = wgpu::InstanceDescriptor::new_without_display_handle();
    description.backends = wgpu::Backends::VULKAN;
    let instance = wgpu::Instance::new(description);
    let adapter = instance.request_adapter(&wgpu::RequestAdapterOptions::default()).await?;
    let limits = adapter.limits();
    let of_device = wgpu::DeviceDescriptor { required_limits: limits, ..Default::default() };
    let (device, queue) = adapter.request_device(&of_device).await?;
    println!("device: {}", adapter.get_info().name);

    let context = lend(&device)?;
    let scene = room()?;
    let camera = camera()?;
    // No more light than the kernel sums: none that clipping cuts off, no filter, all lights for each pixel.
    let settings = Settings { compensation: Compensation::Off, particles: 8, ..Settings::plain() };
    let mut engine = Engine::new(&context, &scene, camera, settings)?;
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("light"),
        size: extent(),
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let target = adopt(&context, &device, &queue, &texture)?;

    let pixels = u64::from(SIZE[0] * SIZE[1]);
    let copy = |name| Buffer::new(&context, name, 16 * pixels, Memory::Readback);
    let (image, direct, indirect, flags) = (copy("image")?, copy("direct")?, copy("indirect")?, copy("flags")?);
    record(&context, &device, &queue, |rec| {
        engine.record_setup(rec)?;
        engine.record_pass(rec)?;
        engine.record_image(rec)?;
        rec.copy_image_to_buffer(engine.image(), &image)?;
        // wgpu left the texture in GENERAL, and finds it there.
        engine.record_image_to(rec, &target, [vk::ImageLayout::GENERAL; 2])?;
        let of_pass = engine.pass_buffers()?;
        for (from, to) in [(of_pass.direct, &direct), (of_pass.indirect, &indirect), (of_pass.flags, &flags)] {
            rec.copy_range(from, 0, to, 0, 16 * pixels)?;
        }
        Ok(())
    })?;

    let of_texture = read_texture(&device, &queue, &texture)?;
    let lit = light(&device, &queue, &engine)?;
    // Earlier commands of the queue have ended by then too.
    let image: Vec<[f32; 4]> = image.read()?;
    let (image, of_texture) = (mean(image.iter()), mean(of_texture.iter()));
    println!("mean radiance:   {of_texture:?} in wgpu's texture, {image:?} in lightsum's image");

    let reflects = |word: &[f32; 4]| ShadingPoints::flags(word[3]) & ShadingPoints::LIT != 0;
    let flags: Vec<[f32; 4]> = flags.read()?;
    let sums: Vec<[f32; 4]> = direct.read::<[f32; 4]>()?.iter().zip(indirect.read::<[f32; 4]>()?).map(sum).collect();
    let of_lit = |all: &[[f32; 4]]| mean(all.iter().zip(&flags).filter(|(_, word)| reflects(word)).map(|(e, _)| e));
    let (by_wgpu, by_lightsum) = (of_lit(&lit), of_lit(&sums));
    println!("mean irradiance: {by_wgpu:?} by wgpu's kernel, {by_lightsum:?} by lightsum's");

    let apart = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).any(|(a, b)| (a - b).abs() > 0.005 * b || b <= 0.0);
    if apart(of_texture, image) || apart(by_wgpu, by_lightsum) {
        return Err("they differ by more than 0.5 %, or are black".into());
    }
    Ok(())
}

/// A room without a front, four units wide, with a block in it and a lamp below its ceiling.
fn room() -> lightsum::Result<Scene> {
    let mut builder = SceneBuilder::new("room");
    let matte = |name: &str, color: Vec3| Material { name: name.to_owned(), base_color: color, ..Material::default() };
    let white = builder.material(matte("white", Vec3::splat(0.7)))?;
    let blue = builder.material(matte("blue", Vec3::new(0.2, 0.3, 0.6)))?;
    let lamp = builder.material(Material { emission: Vec3::splat(12.0), ..matte("lamp", Vec3::ZERO) })?;
    // Looks up; what is turned looks to where its own up points.
    let corners = [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]].map(|[x, z]| Vec3::new(x, 0.0, z));
    let square = Mesh::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]]);
    let towards = |up: Vec3, scale: f32, at: Vec3| {
        Affine3A::from_scale_rotation_translation(Vec3::splat(scale), Quat::from_rotation_arc(Vec3::Y, up), at)
    };
    for (name, up, scale, at, material) in [
        ("floor", Vec3::Y, 2.0, Vec3::ZERO, white),
        ("ceiling", Vec3::NEG_Y, 2.0, Vec3::Y * 4.0, white),
        ("back", Vec3::Z, 2.0, Vec3::new(0.0, 2.0, -2.0), white),
        ("left", Vec3::X, 2.0, Vec3::new(-2.0, 2.0, 0.0), blue),
        ("right", Vec3::NEG_X, 2.0, Vec3::new(2.0, 2.0, 0.0), white),
        ("block", Vec3::new(0.3, 0.9, 0.4).normalize(), 0.8, Vec3::new(0.3, 1.0, 0.0), blue),
        ("lamp", Vec3::NEG_Y, 0.5, Vec3::Y * 3.95, lamp),
    ] {
        builder.object(name, &square, material, towards(up, scale, at))?;
    }
    builder.build()
}

/// The camera by matrices, as a rasterizer has them.
fn camera() -> lightsum::Result<Camera> {
    let view = rh::view::look_at_mat4(Vec3::new(0.0, 2.0, 8.0), Vec3::new(0.0, 2.0, 0.0), Vec3::Y);
    let aspect = SIZE[0] as f32 / SIZE[1] as f32;
    Camera::from_matrices(view, rh::proj::directx::perspective_infinite_reverse(0.7, aspect, 0.1), SIZE)
}

fn extent() -> wgpu::Extent3d {
    wgpu::Extent3d { width: SIZE[0], height: SIZE[1], depth_or_array_layers: 1 }
}

fn sum((a, b): (&[f32; 4], [f32; 4])) -> [f32; 4] {
    [0, 1, 2, 3].map(|c| a[c] + b[c])
}

fn mean<'a>(texels: impl Iterator<Item = &'a [f32; 4]>) -> [f64; 3] {
    let (mut sums, mut count) = ([0.0; 3], 0.0);
    for texel in texels {
        (0..3).for_each(|c| sums[c] += f64::from(texel[c]));
        count += 1.0;
    }
    sums.map(|sum| sum / count)
}

/// Lends wgpu's device to lightsum, which asks for no extension and no feature. The context, and all that is made of it, goes before the
/// device.
fn lend(device: &wgpu::Device) -> Result<Context> {
    // SAFETY: the device outlives what is lent, and is not destroyed by hand; submissions are wgpu's own.
    unsafe {
        let hal = device.as_hal::<Vulkan>().ok_or("wgpu's device is none of Vulkan")?;
        let instance = hal.shared_instance();
        let lent = HostDevice {
            entry: instance.entry().clone(),
            instance: instance.raw_instance().clone(),
            physical_device: hal.raw_physical_device(),
            device: hal.raw_device().clone(),
            queue_family: hal.queue_family_index(),
            queue: hal.raw_queue(),
        };
        Ok(Context::adopt(lent, &ContextOptions::default())?)
    }
}

/// Records lightsum's commands into a command buffer of wgpu and submits it; what they use is kept until they are done.
fn record(
    context: &Context,
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    commands: impl FnOnce(&mut Recorder) -> lightsum::Result<()>,
) -> Result<()> {
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("lightsum") });
    // SAFETY: the encoder's command buffer is recording outside of a pass, and nothing of wgpu is recorded into it; the resources are kept
    // until the queue has finished.
    let recorded = unsafe {
        encoder.as_hal_mut::<Vulkan, _, _>(|hal| -> Result<_> {
            let buffer = hal.ok_or("wgpu's encoder is none of Vulkan")?.raw_handle();
            Ok(context.record_into(buffer, None, commands)?)
        })
    }?;
    queue.submit([encoder.finish()]);
    queue.on_submitted_work_done(move || drop(recorded));
    Ok(())
}

/// Takes a texture of wgpu as an image to write to. wgpu clears textures that it does not know to be written, so it writes it once, and
/// then brings it to the layout GENERAL.
fn adopt(context: &Context, device: &wgpu::Device, queue: &wgpu::Queue, texture: &wgpu::Texture) -> Result<Image> {
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(8 * SIZE[0]), rows_per_image: None };
    let zeros = vec![0; (8 * SIZE[0] * SIZE[1]) as usize];
    queue.write_texture(texture.as_image_copy(), &zeros, layout, extent());
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let state = wgpu::TextureUses::STORAGE_READ_WRITE;
    let to_general = wgpu::wgt::TextureTransition { texture, selector: None, state };
    encoder.transition_resources(std::iter::empty(), std::iter::once(to_general));
    queue.submit([encoder.finish()]);
    // SAFETY: the image is wgpu's, with memory, as described; it outlives the adopted one.
    unsafe {
        let handle = texture.as_hal::<Vulkan>().ok_or("wgpu's texture is none of Vulkan")?.raw_handle();
        let (format, usage) = (vk::Format::R16G16B16A16_SFLOAT, vk::ImageUsageFlags::STORAGE);
        Ok(Image::adopt(context, "wgpu's texture", HostImage { handle, format, size: SIZE, usage })?)
    }
}

/// A buffer of lightsum as one of wgpu, which keeps it.
fn share(device: &wgpu::Device, buffer: &Buffer) -> wgpu::Buffer {
    let kept = buffer.clone();
    let description = wgpu::BufferDescriptor {
        label: Some(buffer.name()),
        size: buffer.bytes(),
        usage: wgpu::BufferUsages::STORAGE,
        mapped_at_creation: false,
    };
    // SAFETY: the buffer is of this device, has the usage, and lives until wgpu drops its own.
    unsafe {
        let hal = wgpu::hal::vulkan::Buffer::from_raw_externally_owned(buffer.handle(), Box::new(move || drop(kept)));
        device.create_buffer_from_hal::<Vulkan>(hal, &description)
    }
}

/// Lights the points that lightsum sees by its virtual lights, in a compute shader of wgpu.
fn light(device: &wgpu::Device, queue: &wgpu::Queue, engine: &Engine) -> Result<Vec<[f32; 4]>> {
    let source = ["#version 450\n", include_str!("../../shaders/virtual_lights.glsl"), KERNEL].concat();
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("virtual lights"),
        source: wgpu::ShaderSource::Glsl {
            shader: source.into(),
            stage: wgpu::naga::ShaderStage::Compute,
            defines: &[],
        },
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("virtual lights"),
        layout: None,
        module: &module,
        entry_point: Some("main"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let of_pass = engine.pass_buffers()?;
    let (tree, lights) = (of_pass.tree, of_pass.lights);
    let pixels = SIZE[0] * SIZE[1];
    let mut buffers: Vec<wgpu::Buffer> = [
        lights.buffer,
        tree.node_min,
        tree.node_max,
        tree.v0,
        tree.e1,
        tree.e2,
        of_pass.position,
        of_pass.geometric_normal,
    ]
    .map(|buffer| share(device, buffer))
    .into();
    let make = |size: u64, usage| {
        device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
    };
    let lit = make(16 * u64::from(pixels), wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
    let numbers = make(32, wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST);
    let counts = [pixels, lights.layout.of_class, tree.nodes, 0].map(u32::to_le_bytes).concat();
    let lengths = [lights.layout.clip, lights.layout.far, 0.0, 0.0].map(f32::to_le_bytes).concat();
    queue.write_buffer(&numbers, 0, &[counts, lengths].concat());
    buffers.extend([lit.clone(), numbers]);
    let entries: Vec<_> = (0..)
        .zip(&buffers)
        .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
        .collect();
    let layout = pipeline.get_bind_group_layout(0);
    let group = wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries };
    let group = device.create_bind_group(&group);
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(pixels.div_ceil(64), 1, 1);
    }
    let out = make(lit.size(), wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
    encoder.copy_buffer_to_buffer(&lit, 0, &out, 0, lit.size());
    queue.submit([encoder.finish()]);
    let bytes = read_buffer(device, &out)?;
    let float = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    Ok(bytes.chunks_exact(16).map(|texel| [0, 4, 8, 12].map(|at| float(&texel[at..]))).collect())
}

/// The texels of a texture of halves.
fn read_texture(device: &wgpu::Device, queue: &wgpu::Queue, texture: &wgpu::Texture) -> Result<Vec<[f32; 4]>> {
    let size = u64::from(8 * SIZE[0] * SIZE[1]);
    let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
    let out = device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(8 * SIZE[0]), rows_per_image: None };
    let to = wgpu::TexelCopyBufferInfo { buffer: &out, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), to, extent());
    queue.submit([encoder.finish()]);
    let half = |bytes: &[u8]| from_half(u16::from_le_bytes([bytes[0], bytes[1]]));
    let bytes = read_buffer(device, &out)?;
    Ok(bytes.chunks_exact(8).map(|texel| [0, 2, 4, 6].map(|at| half(&texel[at..]))).collect())
}

/// The content of a buffer that can be mapped, after all work.
fn read_buffer(device: &wgpu::Device, buffer: &wgpu::Buffer) -> Result<Vec<u8>> {
    buffer.map_async(wgpu::MapMode::Read, .., |result| {
        if let Err(error) = result {
            eprintln!("mapping: {error}");
        }
    });
    device.poll(wgpu::PollType::wait_indefinitely())?;
    Ok(buffer.get_mapped_range(..)?.to_vec())
}

/// A finite number of 16 bits.
fn from_half(bits: u16) -> f32 {
    let (exponent, rest) = (i32::from(bits >> 10 & 31), f32::from(bits & 1023));
    let size = if exponent == 0 { rest * 2f32.powi(-24) } else { (1.0 + rest / 1024.0) * 2f32.powi(exponent - 15) };
    if bits >> 15 == 1 { -size } else { size }
}
