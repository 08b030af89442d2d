//! A host's own G-buffer as the view: a rasterizer draws depths, normals, albedo and emission, and lightsum lights what they show.
//!
//! ```text
//! cargo run --release --example g_buffer -- [IMAGE.png [PASSES]]
//! ```
//!
//! [`Rasterizer`] stands for a deferred renderer: one render pass with four attachments. [`run`] has all that concerns lightsum.

use std::error::Error;
use std::path::{Path, PathBuf};

use ash::vk;
use glam::camera::rh;
use glam::{Mat4, Vec3};
use lightsum::gpu::{Buffer, Context, HostDevice, HostImage, Image, Memory};
use lightsum::pass::g_buffer_read::{GBufferImages, GivenImage, Place};
use lightsum::{Camera, Engine, Scene, Settings, View};

#[allow(dead_code, reason = "its main is the other example's own")]
#[path = "embed.rs"]
pub mod embed;

pub use embed::{Host, Picture};

type Result<T, E = Box<dyn Error>> = std::result::Result<T, E>;

/// The host's shaders. y of clip space points up here; naga turns it for Vulkan.
const SHADERS: &str = "
struct Corner { position: vec4<f32>, normal: vec4<f32>, albedo: vec4<f32>, emission: vec4<f32> }
@group(0) @binding(0) var<storage, read> corners: array<Corner>;
var<immediate> clip_from_world: mat4x4<f32>;

struct Shown {
    @builtin(position) clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
    @location(1) albedo: vec3<f32>,
    @location(2) emission: vec3<f32>,
}

@vertex
fn show(@builtin(vertex_index) i: u32) -> Shown {
    let corner = corners[i];
    let clip = clip_from_world * vec4<f32>(corner.position.xyz, 1.0);
    return Shown(clip, corner.normal.xyz, corner.albedo.xyz, corner.emission.xyz);
}

struct Layers {
    @location(0) normal: vec4<f32>,
    @location(1) albedo: vec4<f32>,
    @location(2) emission: vec4<f32>,
}

@fragment
fn keep(shown: Shown, @builtin(front_facing) front: bool) -> Layers {
    let emission = select(vec3<f32>(0.0), shown.emission, front);
    return Layers(vec4<f32>(shown.normal, 0.0), vec4<f32>(shown.albedo, 1.0), vec4<f32>(emission, 1.0));
}
";

/// Formats of the attachments: depth, normal, albedo, emission.
const FORMATS: [vk::Format; 4] = [
    vk::Format::D32_SFLOAT,
    vk::Format::R16G16B16A16_SFLOAT,
    vk::Format::R8G8B8A8_SRGB,
    vk::Format::R16G16B16A16_SFLOAT,
];

/// Layouts in which the render pass leaves them.
const LAYOUTS: [vk::ImageLayout; 4] = [
    vk::ImageLayout::DEPTH_STENCIL_READ_ONLY_OPTIMAL,
    vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
    vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
    vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
];

/// Depth of pixels that show nothing. Depths are reversed, so 0 is infinitely far away.
const BACKGROUND: f32 = 0.0;

fn main() -> Result<()> {
    let mut arguments = std::env::args_os().skip(1);
    let output = arguments.next().map(PathBuf::from);
    let passes = arguments.next().map_or(Ok(4), |n| n.to_string_lossy().parse::<u32>())?;
    let scene = lightsum::scene::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell/scene.toml"))?;
    let camera = Camera { resolution: [320, 240], ..scene.camera.ok_or("the scene has no camera")? };

    let image = run(&Host::new(false)?, &scene, camera, Settings::default(), passes)?;
    println!("mean radiance {:?} W/(m^2 sr)", image.mean());
    if let Some(path) = output {
        image.write_png(&path)?;
        println!("wrote {}", path.display());
    }
    Ok(())
}

/// Draws the scene on the host's device and lights what the images show by `passes` passes.
pub fn run(host: &Host, scene: &Scene, camera: Camera, settings: Settings, passes: u32) -> Result<Picture> {
    let context = host.lend()?;
    let rasterizer = Rasterizer::new(&context, host.handles(), scene, camera.resolution)?;
    // SAFETY: the images belong to the host's device, are as described, and live longer than engine and commands.
    let images = FORMATS.iter().zip(&rasterizer.attachments).map(|(&format, attachment)| unsafe {
        let image = HostImage { handle: attachment.image, format, size: camera.resolution, usage: usage(format) };
        Image::adopt_to_read(&context, "layer of the G-buffer", image)
    });
    let images = images.collect::<lightsum::Result<Vec<_>>>()?;
    let given = |i: usize| GivenImage { image: &images[i], layout: LAYOUTS[i] };

    let mut engine = Engine::with_view(&context, scene, View::GBuffer { camera }, settings)?;
    let readback = embed::Readback::new(host, engine.image().bytes())?;
    let clip_from_world = clip_from_world(&camera);
    let g_buffer = GBufferImages {
        place: Place::Depths {
            depths: given(0),
            // Depths of far points are near 0, where an inverse in single precision is coarse.
            world_from_clip: clip_from_world.as_dmat4().inverse().as_mat4(),
            background: BACKGROUND,
        },
        normal: given(1),
        geometric_normal: None, // Those of shading stand for them.
        albedo: given(2),
        specular: None, // All surfaces of this host are matte.
        emission: Some(given(3)),
        // The error of positions that depths tell.
        offset: 1e-4 * camera.eye.distance(camera.target),
    };

    let commands = host.begin()?;
    rasterizer.record(commands, clip_from_world);
    // SAFETY: the command buffer is recording on the device of this context, outside a render pass; what keeps the recorded objects alive
    // is handed to `submit`, which holds it until the fence has been waited for.
    let recorded = unsafe {
        context.record_into(commands, None, |rec| {
            engine.record_setup(rec)?;
            // It begins with a barrier after all earlier work of the queue: the drawing is visible to it.
            engine.record_g_buffer(rec, &g_buffer)?;
            for _ in 0..passes {
                engine.record_pass(rec)?;
            }
            engine.record_image(rec)
        })
    }?;
    readback.record_copy(commands, &engine);
    host.submit(commands, recorded)?.wait()?;
    Ok(Picture { size: camera.resolution, texels: readback.texels() })
}

/// Projection times view, with reversed depths and y up, as `world_from_clip` is wanted.
fn clip_from_world(camera: &Camera) -> Mat4 {
    let [width, height] = camera.resolution.map(|n| n as f32);
    let near = 1e-2 * camera.eye.distance(camera.target);
    rh::proj::directx::perspective_infinite_reverse(camera.fov_y.to_radians(), width / height, near)
        * rh::view::look_at_mat4(camera.eye, camera.target, camera.up)
}

fn usage(format: vk::Format) -> vk::ImageUsageFlags {
    let attachment = match format {
        vk::Format::D32_SFLOAT => vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT,
        _ => vk::ImageUsageFlags::COLOR_ATTACHMENT,
    };
    attachment | vk::ImageUsageFlags::SAMPLED // lightsum asks for SAMPLED.
}

/// The host's renderer: it draws a scene into four images.
pub struct Rasterizer {
    device: ash::Device,
    size: vk::Extent2D,
    /// Corners of triangles, four vectors each.
    corners: Buffer,
    attachments: Vec<Attachment>,
    render_pass: vk::RenderPass,
    framebuffer: vk::Framebuffer,
    set_layout: vk::DescriptorSetLayout,
    layout: vk::PipelineLayout,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    module: vk::ShaderModule,
    pipeline: vk::Pipeline,
}

/// An image with its memory.
#[derive(Default)]
struct Attachment {
    image: vk::Image,
    memory: vk::DeviceMemory,
    view: vk::ImageView,
}

impl Rasterizer {
    /// Makes images of a size, and the pipeline that draws a scene into them: base colours without textures.
    pub fn new(context: &Context, host: HostDevice, scene: &Scene, [width, height]: [u32; 2]) -> Result<Rasterizer> {
        let mut data: Vec<[f32; 4]> = Vec::new();
        for (i, triangle) in scene.triangles.iter().enumerate() {
            let corners = scene.triangle_positions(i);
            let flat = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
            let material = &scene.materials[triangle.material as usize];
            for (position, vertex) in corners.into_iter().zip(triangle.vertices) {
                let normal = if triangle.smooth { scene.normals[vertex as usize] } else { flat };
                data.extend([position, normal, material.base_color, material.emission].map(of_vector));
            }
        }
        let bytes: Vec<u8> = data.into_iter().flatten().flat_map(f32::to_le_bytes).collect();
        let corners = Buffer::new(context, "corners", bytes.len() as u64, Memory::Upload)?;
        corners.write(0, &bytes)?;
        // SAFETY: the handles are those that were lent.
        let families = unsafe { host.instance.get_physical_device_queue_family_properties(host.physical_device) };
        if !families[host.queue_family as usize].queue_flags.contains(vk::QueueFlags::GRAPHICS) {
            return Err("the queue that lightsum was given cannot draw".into());
        }
        let mut made = Rasterizer {
            device: host.device.clone(),
            size: vk::Extent2D { width, height },
            corners,
            attachments: Vec::new(),
            render_pass: vk::RenderPass::null(),
            framebuffer: vk::Framebuffer::null(),
            set_layout: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            pool: vk::DescriptorPool::null(),
            set: vk::DescriptorSet::null(),
            module: vk::ShaderModule::null(),
            pipeline: vk::Pipeline::null(),
        };
        made.make_images(&host)?;
        made.make_render_pass()?;
        made.make_pipeline()?;
        Ok(made)
    }

    fn make_images(&mut self, host: &HostDevice) -> Result<()> {
        let extent = vk::Extent3D { width: self.size.width, height: self.size.height, depth: 1 };
        for format in FORMATS {
            let create = vk::ImageCreateInfo::default()
                .image_type(vk::ImageType::TYPE_2D)
                .format(format)
                .extent(extent)
                .mip_levels(1)
                .array_layers(1)
                .samples(vk::SampleCountFlags::TYPE_1)
                .usage(usage(format));
            let (device, wanted) = (&self.device, vk::MemoryPropertyFlags::DEVICE_LOCAL);
            self.attachments.push(Attachment::default());
            let Some(made) = self.attachments.last_mut() else { continue }; // One was pushed.
            // SAFETY: plain Vulkan; `drop` destroys what has been made, whatever fails.
            unsafe {
                made.image = device.create_image(&create, None)?;
                let needs = device.get_image_memory_requirements(made.image);
                let memory = host.instance.get_physical_device_memory_properties(host.physical_device);
                let index = (0u32..)
                    .zip(memory.memory_types_as_slice())
                    .find(|(i, t)| needs.memory_type_bits & (1 << i) != 0 && t.property_flags.contains(wanted))
                    .map(|(i, _)| i)
                    .ok_or("no memory for images")?;
                let allocate = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(index);
                made.memory = device.allocate_memory(&allocate, None)?;
                device.bind_image_memory(made.image, made.memory, 0)?;
                let aspect = match format {
                    vk::Format::D32_SFLOAT => vk::ImageAspectFlags::DEPTH,
                    _ => vk::ImageAspectFlags::COLOR,
                };
                let range = vk::ImageSubresourceRange::default().aspect_mask(aspect).level_count(1).layer_count(1);
                let create = vk::ImageViewCreateInfo::default()
                    .image(made.image)
                    .view_type(vk::ImageViewType::TYPE_2D)
                    .format(format)
                    .subresource_range(range);
                made.view = device.create_image_view(&create, None)?;
            }
        }
        Ok(())
    }

    fn make_render_pass(&mut self) -> Result<()> {
        let attachments: Vec<_> = FORMATS
            .into_iter()
            .zip(LAYOUTS)
            .map(|(format, layout)| {
                vk::AttachmentDescription::default()
                    .format(format)
                    .samples(vk::SampleCountFlags::TYPE_1)
                    .load_op(vk::AttachmentLoadOp::CLEAR)
                    .store_op(vk::AttachmentStoreOp::STORE)
                    .stencil_load_op(vk::AttachmentLoadOp::DONT_CARE)
                    .stencil_store_op(vk::AttachmentStoreOp::DONT_CARE)
                    .initial_layout(vk::ImageLayout::UNDEFINED)
                    .final_layout(layout)
            })
            .collect();
        let refer = |attachment, layout| vk::AttachmentReference { attachment, layout };
        let depth = refer(0, vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL);
        let colors = [1, 2, 3].map(|i| refer(i, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL));
        let subpass = [vk::SubpassDescription::default()
            .pipeline_bind_point(vk::PipelineBindPoint::GRAPHICS)
            .color_attachments(&colors)
            .depth_stencil_attachment(&depth)];
        let create = vk::RenderPassCreateInfo::default().attachments(&attachments).subpasses(&subpass);
        // SAFETY: plain Vulkan; `drop` destroys what has been made, whatever fails.
        unsafe {
            self.render_pass = self.device.create_render_pass(&create, None)?;
            let views: Vec<_> = self.attachments.iter().map(|attachment| attachment.view).collect();
            let create = vk::FramebufferCreateInfo::default()
                .render_pass(self.render_pass)
                .attachments(&views)
                .width(self.size.width)
                .height(self.size.height)
                .layers(1);
            self.framebuffer = self.device.create_framebuffer(&create, None)?;
        }
        Ok(())
    }

    fn make_pipeline(&mut self) -> Result<()> {
        let code = compile(SHADERS)?;
        let bindings = [vk::DescriptorSetLayoutBinding::default()
            .binding(0)
            .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
            .descriptor_count(1)
            .stage_flags(vk::ShaderStageFlags::VERTEX)];
        let push = [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::VERTEX).size(64)];
        let sizes = [vk::DescriptorPoolSize::default().ty(vk::DescriptorType::STORAGE_BUFFER).descriptor_count(1)];
        let viewport = [vk::Viewport {
            width: self.size.width as f32,
            height: self.size.height as f32,
            max_depth: 1.0,
            ..vk::Viewport::default()
        }];
        let scissor = [vk::Rect2D { extent: self.size, ..vk::Rect2D::default() }];
        // SAFETY: plain Vulkan; `drop` destroys what has been made, whatever fails.
        unsafe {
            let device = &self.device;
            self.module = device.create_shader_module(&vk::ShaderModuleCreateInfo::default().code(&code), None)?;
            let create = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
            self.set_layout = device.create_descriptor_set_layout(&create, None)?;
            let layouts = [self.set_layout];
            let create = vk::PipelineLayoutCreateInfo::default().set_layouts(&layouts).push_constant_ranges(&push);
            self.layout = device.create_pipeline_layout(&create, None)?;
            let create = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
            self.pool = device.create_descriptor_pool(&create, None)?;
            let allocate = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.pool).set_layouts(&layouts);
            self.set = device.allocate_descriptor_sets(&allocate)?[0]; // One was asked for.
            let buffer = [vk::DescriptorBufferInfo::default().buffer(self.corners.handle()).range(vk::WHOLE_SIZE)];
            let write = vk::WriteDescriptorSet::default()
                .dst_set(self.set)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .buffer_info(&buffer);
            device.update_descriptor_sets(&[write], &[]);

            let stage =
                |stage, name| vk::PipelineShaderStageCreateInfo::default().stage(stage).module(self.module).name(name);
            let stages = [stage(vk::ShaderStageFlags::VERTEX, c"show"), stage(vk::ShaderStageFlags::FRAGMENT, c"keep")];
            let vertices = vk::PipelineVertexInputStateCreateInfo::default();
            let triangles =
                vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::TRIANGLE_LIST);
            let viewports = vk::PipelineViewportStateCreateInfo::default().viewports(&viewport).scissors(&scissor);
            let faces = vk::PipelineRasterizationStateCreateInfo::default()
                .front_face(vk::FrontFace::COUNTER_CLOCKWISE)
                .line_width(1.0);
            let samples =
                vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
            let depth = vk::PipelineDepthStencilStateCreateInfo::default()
                .depth_test_enable(true)
                .depth_write_enable(true)
                .depth_compare_op(vk::CompareOp::GREATER);
            let all = vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::RGBA);
            let all = [all; 3];
            let colors = vk::PipelineColorBlendStateCreateInfo::default().attachments(&all);
            let create = vk::GraphicsPipelineCreateInfo::default()
                .stages(&stages)
                .vertex_input_state(&vertices)
                .input_assembly_state(&triangles)
                .viewport_state(&viewports)
                .rasterization_state(&faces)
                .multisample_state(&samples)
                .depth_stencil_state(&depth)
                .color_blend_state(&colors)
                .layout(self.layout)
                .render_pass(self.render_pass);
            let made = device.create_graphics_pipelines(vk::PipelineCache::null(), &[create], None);
            self.pipeline = made.map_err(|(_, result)| result)?[0]; // One was asked for.
        }
        Ok(())
    }

    /// Records the drawing. The images are left in [`LAYOUTS`].
    pub fn record(&self, commands: vk::CommandBuffer, clip_from_world: Mat4) {
        let black = vk::ClearValue { color: vk::ClearColorValue { float32: [0.0; 4] } };
        let far = vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: BACKGROUND, stencil: 0 } };
        let clear = [far, black, black, black];
        let begin = vk::RenderPassBeginInfo::default()
            .render_pass(self.render_pass)
            .framebuffer(self.framebuffer)
            .render_area(vk::Rect2D { extent: self.size, ..vk::Rect2D::default() })
            .clear_values(&clear);
        let push: Vec<u8> = clip_from_world.to_cols_array().into_iter().flat_map(f32::to_le_bytes).collect();
        // Four vectors of 16 bytes a corner.
        let corners = (self.corners.bytes() / 64) as u32;
        // SAFETY: the command buffer is recording, and all handles live until the commands have run.
        unsafe {
            let (device, point) = (&self.device, vk::PipelineBindPoint::GRAPHICS);
            device.cmd_begin_render_pass(commands, &begin, vk::SubpassContents::INLINE);
            device.cmd_bind_pipeline(commands, point, self.pipeline);
            device.cmd_bind_descriptor_sets(commands, point, self.layout, 0, &[self.set], &[]);
            device.cmd_push_constants(commands, self.layout, vk::ShaderStageFlags::VERTEX, 0, &push);
            device.cmd_draw(commands, corners, 1, 0, 0);
            device.cmd_end_render_pass(commands);
        }
    }
}

impl Drop for Rasterizer {
    fn drop(&mut self) {
        // SAFETY: submissions that use them have been waited for. Null is ignored.
        unsafe {
            let device = &self.device;
            device.destroy_pipeline(self.pipeline, None);
            device.destroy_shader_module(self.module, None);
            device.destroy_descriptor_pool(self.pool, None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
            device.destroy_framebuffer(self.framebuffer, None);
            device.destroy_render_pass(self.render_pass, None);
            for attachment in &self.attachments {
                device.destroy_image_view(attachment.view, None);
                device.destroy_image(attachment.image, None);
                device.free_memory(attachment.memory, None);
            }
        }
    }
}

fn of_vector(v: Vec3) -> [f32; 4] {
    v.extend(0.0).to_array()
}

/// WGSL as SPIR-V.
fn compile(source: &str) -> Result<Vec<u32>> {
    use naga::valid::{Capabilities, ValidationFlags, Validator};
    let module = naga::front::wgsl::parse_str(source).map_err(|error| error.emit_to_string(source))?;
    let info = Validator::new(ValidationFlags::all(), Capabilities::IMMEDIATES).validate(&module)?;
    Ok(naga::back::spv::write_vec(&module, &info, &naga::back::spv::Options::default(), None)?)
}
