//! Virtual lights in a shader of the host, as a rasterizer would light its own surfaces by them.
//!
//! ```text
//! cargo run --release --example lights_for_rasterizer
//! ```
//!
//! lightsum traces the particles and leaves the lights; a kernel of the host reads them through `shaders/virtual_lights.wgsl`, asks the tree
//! which are visible, and sums their irradiance. The kernel stands for a fragment shader, and the points that lightsum sees for those of a
//! rasterizer. Its sums are compared with lightsum's own.

use std::error::Error;
use std::path::Path;

use ash::vk;
use lightsum::engine::PassBuffers;
use lightsum::gpu::{Buffer, Context, Memory};
use lightsum::pass::ShadingPoints;
use lightsum::settings::Compensation;
use lightsum::{Camera, Engine, Scene, Settings};
use naga::valid::{Capabilities, ValidationFlags, Validator};

#[allow(dead_code, reason = "its main and its picture are the other example's own")]
#[path = "embed.rs"]
pub mod embed;

pub use embed::Host;

type Result<T, E = Box<dyn Error>> = std::result::Result<T, E>;

/// The host's kernel, after the functions of `virtual_lights.wgsl`.
const KERNEL: &str = "
@group(0) @binding(6) var<storage, read> position: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> normal: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> lit: array<vec4<f32>>;

struct Push { width: u32, pixels: u32, pattern: vec2<u32>, of_class: u32, nodes: u32, clip: f32, far: f32 }
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.x;
    if pixel >= push.pixels {
        return;
    }
    let x = position[pixel].xyz;
    let at = vec2<u32>(pixel % push.width, pixel / push.width) % push.pattern;
    let first = push.of_class * (at.x + push.pattern.x * at.y);
    var sum = vec3<f32>(0.0);
    for (var i = first; i < first + push.of_class; i += 1u) {
        let to = to_light(lights[i], x, push.far);
        let e = irradiance(lights[i], to, normal[pixel].xyz, push.clip);
        if any(e > vec3<f32>(0.0)) && !is_blocked(x, to, push.nodes) {
            sum += e;
        }
    }
    lit[pixel] = vec4<f32>(sum, 0.0);
}
";

/// Buffers of the kernel.
const BINDINGS: u32 = 9;

fn main() -> Result<()> {
    let scene = lightsum::scene::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell/scene.toml"))?;
    let camera = Camera { resolution: [160, 120], ..scene.camera.ok_or("the scene has no camera")? };
    let lit = run(&Host::new(false)?, &scene, camera, Settings::interactive())?;
    let mean = |pixels: &[[f32; 4]]| pixels.iter().map(|e| f64::from(e[0] + e[1] + e[2])).sum::<f64>() / 3.0;
    let count = lit.by_host.len() as f64;
    println!("mean irradiance: {:.4} by the host's kernel, ", mean(&lit.by_host) / count);
    println!("                 {:.4} by lightsum, W/m^2", mean(&lit.by_lightsum) / count);
    Ok(())
}

/// Irradiance of the pixels that reflect light.
pub struct Lit {
    /// By the host's kernel.
    pub by_host: Vec<[f32; 4]>,
    /// By lightsum's.
    pub by_lightsum: Vec<[f32; 4]>,
}

/// Lights the pixels of a camera on the host's device by the lights of one pass. Settings are changed so that lightsum does no more than the
/// kernel: no filter, no light that clipping cuts off.
pub fn run(host: &Host, scene: &Scene, camera: Camera, settings: Settings) -> Result<Lit> {
    let settings = Settings { filter: None, compensation: Compensation::Off, light_pool: 0, ..settings };
    let context = host.lend()?;
    let mut engine = Engine::new(&context, scene, camera, settings)?;
    let kernel =
        Kernel::new(&context, &compile(&[include_str!("shaders/virtual_lights.wgsl"), KERNEL].concat())?, BINDINGS)?;
    let [width, height] = camera.resolution;
    let bytes = 16 * u64::from(width * height);
    let copy = |name| Buffer::new(&context, name, bytes, Memory::Readback);
    let (lit, direct, indirect, flags) = (copy("lit")?, copy("direct")?, copy("indirect")?, copy("flags")?);

    let commands = host.begin()?;
    // SAFETY: the command buffer is recording on the device of this context, outside a render pass; what keeps the recorded objects alive
    // is handed to `submit`, and kernel and buffers live until the wait is over.
    let recorded = unsafe {
        context.record_into(commands, None, |rec| {
            engine.record_setup(rec)?;
            engine.record_pass(rec)?;
            let buffers = engine.pass_buffers()?;
            // The pass is visible to compute and transfer commands.
            light(&kernel, rec.command_buffer(), &engine, &buffers, &lit);
            rec.copy_range(buffers.direct, 0, &direct, 0, bytes)?;
            rec.copy_range(buffers.indirect, 0, &indirect, 0, bytes)?;
            rec.copy_range(buffers.flags, 0, &flags, 0, bytes)
        })
    }?;
    host.submit(commands, recorded)?.wait()?;

    let reflects = |word: [f32; 4]| ShadingPoints::flags(word[3]) & ShadingPoints::LIT != 0;
    let lit_ones: Vec<bool> = flags.read::<[f32; 4]>()?.into_iter().map(reflects).collect();
    let of_lit = |all: Vec<[f32; 4]>| all.into_iter().zip(&lit_ones).filter(|(_, lit)| **lit).map(|(e, _)| e).collect();
    let sums = direct.read::<[f32; 4]>()?.into_iter().zip(indirect.read::<[f32; 4]>()?);
    let sums = sums.map(|(a, b)| [0, 1, 2, 3].map(|c| a[c] + b[c])).collect();
    Ok(Lit { by_host: of_lit(lit.read()?), by_lightsum: of_lit(sums) })
}

/// Records the kernel that lights the points of a pass.
fn light(kernel: &Kernel, commands: vk::CommandBuffer, engine: &Engine, of_pass: &PassBuffers, lit: &Buffer) {
    let PassBuffers { tree, lights, .. } = of_pass;
    let buffers = [
        lights.buffer,
        tree.node_min,
        tree.node_max,
        tree.v0,
        tree.e1,
        tree.e2,
        of_pass.position,
        of_pass.geometric_normal,
        lit,
    ];
    let ([width, height], pattern) = (engine.view().size(), engine.plan().settings.pattern);
    let layout = lights.layout;
    let words = [width, width * height, pattern[0], pattern[1], layout.of_class, tree.nodes];
    let push =
        [words.map(u32::to_le_bytes).concat(), [layout.clip, layout.far].map(f32::to_le_bytes).concat()].concat();
    kernel.record(commands, &buffers, &push, width * height);
}

/// A pipeline of the host's own.
pub struct Kernel {
    device: ash::Device,
    module: vk::ShaderModule,
    set_layout: vk::DescriptorSetLayout,
    layout: vk::PipelineLayout,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    pipeline: vk::Pipeline,
}

impl Kernel {
    /// Of SPIR-V with so many storage buffers in its set 0.
    pub fn new(context: &Context, code: &[u32], storage_buffers: u32) -> Result<Kernel> {
        let device = context.raw_device().clone();
        let mut kernel = Kernel {
            device: device.clone(),
            module: vk::ShaderModule::null(),
            set_layout: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            pool: vk::DescriptorPool::null(),
            set: vk::DescriptorSet::null(),
            pipeline: vk::Pipeline::null(),
        };
        let bindings: Vec<_> = (0..storage_buffers)
            .map(|binding| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let push = [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(32)];
        let sizes = [vk::DescriptorPoolSize::default()
            .ty(vk::DescriptorType::STORAGE_BUFFER)
            .descriptor_count(storage_buffers)];
        // SAFETY: plain Vulkan; `kernel` destroys what has been made, whatever fails.
        unsafe {
            kernel.module = device.create_shader_module(&vk::ShaderModuleCreateInfo::default().code(code), None)?;
            let create = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
            kernel.set_layout = device.create_descriptor_set_layout(&create, None)?;
            let layouts = [kernel.set_layout];
            let create = vk::PipelineLayoutCreateInfo::default().set_layouts(&layouts).push_constant_ranges(&push);
            kernel.layout = device.create_pipeline_layout(&create, None)?;
            let create = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
            kernel.pool = device.create_descriptor_pool(&create, None)?;
            let allocate = vk::DescriptorSetAllocateInfo::default().descriptor_pool(kernel.pool).set_layouts(&layouts);
            kernel.set = device.allocate_descriptor_sets(&allocate)?[0]; // One was asked for.
            let stage = vk::PipelineShaderStageCreateInfo::default()
                .stage(vk::ShaderStageFlags::COMPUTE)
                .module(kernel.module)
                .name(c"main");
            let create = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(kernel.layout)];
            let made = device.create_compute_pipelines(vk::PipelineCache::null(), &create, None);
            kernel.pipeline = made.map_err(|(_, result)| result)?[0]; // One was asked for.
        }
        Ok(kernel)
    }

    /// Records the kernel, once, with its buffers, its immediate data and so many invocations.
    pub fn record(&self, commands: vk::CommandBuffer, buffers: &[&Buffer], push: &[u8], invocations: u32) {
        let info =
            |buffer: &&Buffer| [vk::DescriptorBufferInfo::default().buffer(buffer.handle()).range(vk::WHOLE_SIZE)];
        let infos: Vec<_> = buffers.iter().map(info).collect();
        let writes: Vec<_> = infos
            .iter()
            .zip(0..)
            .map(|(info, binding)| {
                vk::WriteDescriptorSet::default()
                    .dst_set(self.set)
                    .dst_binding(binding)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .buffer_info(info)
            })
            .collect();
        let to_host = [vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::SHADER_WRITE)
            .dst_access_mask(vk::AccessFlags::HOST_READ)];
        // SAFETY: the command buffer is recording; the set is not in use yet, and the buffers live until the commands have run.
        unsafe {
            let device = &self.device;
            device.update_descriptor_sets(&writes, &[]);
            let point = vk::PipelineBindPoint::COMPUTE;
            device.cmd_bind_pipeline(commands, point, self.pipeline);
            device.cmd_bind_descriptor_sets(commands, point, self.layout, 0, &[self.set], &[]);
            if !push.is_empty() {
                device.cmd_push_constants(commands, self.layout, vk::ShaderStageFlags::COMPUTE, 0, push);
            }
            device.cmd_dispatch(commands, invocations.div_ceil(64), 1, 1);
            let (from, to) = (vk::PipelineStageFlags::COMPUTE_SHADER, vk::PipelineStageFlags::HOST);
            device.cmd_pipeline_barrier(commands, from, to, vk::DependencyFlags::empty(), &to_host, &[], &[]);
        }
    }
}

impl Drop for Kernel {
    fn drop(&mut self) {
        // SAFETY: the submission has been waited for. Null is ignored.
        unsafe {
            self.device.destroy_pipeline(self.pipeline, None);
            self.device.destroy_descriptor_pool(self.pool, None);
            self.device.destroy_pipeline_layout(self.layout, None);
            self.device.destroy_descriptor_set_layout(self.set_layout, None);
            self.device.destroy_shader_module(self.module, None);
        }
    }
}

/// Capabilities of the kernels: immediate data, and halves stored in pairs in a word.
pub const CAPABILITIES: Capabilities = Capabilities::IMMEDIATES.union(Capabilities::SHADER_FLOAT16_IN_FLOAT32);

/// WGSL as SPIR-V.
pub fn compile(source: &str) -> Result<Vec<u32>> {
    let module = naga::front::wgsl::parse_str(source).map_err(|error| error.emit_to_string(source))?;
    let info = Validator::new(ValidationFlags::all(), CAPABILITIES).validate(&module)?;
    Ok(naga::back::spv::write_vec(&module, &info, &naga::back::spv::Options::default(), None)?)
}
