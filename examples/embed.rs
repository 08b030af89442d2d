//! A host with its own Vulkan device: lightsum records into its command buffer.
//!
//! ```text
//! cargo run --release --example embed -- [IMAGE.png [SCENE.toml]]
//! ```
//!
//! The host here is minimal. `impl Host` does the work of any Vulkan application (instance, device, command buffers,
//! submission, memory); [`Host::new`], [`Host::lend`] and [`run`] contain everything specific to lightsum.

use std::error::Error;
use std::path::{Path, PathBuf};

use ash::{ext, vk};
use lightsum::gpu::{Context, ContextOptions, HostDevice, Requirements, Retained};
use lightsum::{Camera, Engine, Scene, Settings};

type Result<T, E = Box<dyn Error>> = std::result::Result<T, E>;

fn main() -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let output = arguments.next();
    let scene = lightsum::scene::load(&arguments.next().unwrap_or_else(|| root.join("scenes/cornell/scene.toml")))?;
    let camera = Camera { resolution: [320, 240], ..scene.camera.ok_or("the scene has no camera")? };

    let host = Host::new(false)?;
    let image = run(&host, &scene, camera, Settings::default(), 4)?;
    println!("mean radiance {:?} W/(m^2 sr)", image.mean());
    if let Some(path) = output {
        image.write_png(&path)?;
        println!("wrote {}", path.display());
    }
    Ok(())
}

/// Renders `passes` passes on the host's device. Everything is recorded into one command buffer, which the host
/// submits.
pub fn run(host: &Host, scene: &Scene, camera: Camera, settings: Settings, passes: u32) -> Result<Picture> {
    let context = host.lend()?;
    let mut engine = Engine::new(&context, scene, camera, settings)?;
    let readback = Readback::new(host, engine.image().bytes())?;

    let commands = host.begin()?;
    // SAFETY: the command buffer is recording on the device of this context, outside a render pass; what keeps the
    // recorded objects alive is handed to `submit`, which holds it until the fence has been waited for.
    let recorded = unsafe {
        context.record_into(commands, None, |rec| {
            engine.record_setup(rec)?;
            for _ in 0..passes {
                engine.record_pass(rec)?;
            }
            engine.record_image(rec)
        })
    }?;
    readback.record_copy(commands, &engine);
    host.submit(commands, recorded)?.wait()?;

    Ok(Picture { size: [engine.image().width(), engine.image().height()], texels: readback.texels() })
}

/// The host: instance, device, queue and command pool.
pub struct Host {
    entry: ash::Entry,
    instance: ash::Instance,
    physical_device: vk::PhysicalDevice,
    device: ash::Device,
    queue_family: u32,
    queue: vk::Queue,
    pool: vk::CommandPool,
    validation: bool,
}

impl Host {
    /// Opens the first device that lightsum can use; with `validation`, under the Khronos layer.
    pub fn new(validation: bool) -> Result<Host> {
        // SAFETY: plain Vulkan. All pointers are to values that live until the end of the call they are given to.
        unsafe {
            let entry = ash::Entry::load()?;
            let (layers, extensions) = if validation {
                (vec![c"VK_LAYER_KHRONOS_validation".as_ptr()], vec![ext::debug_utils::NAME.as_ptr()])
            } else {
                (vec![], vec![])
            };
            // At least `Requirements::api_version`.
            let version = vk::API_VERSION_1_1;
            let application = vk::ApplicationInfo::default().application_name(c"embed").api_version(version);
            let checks = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
            let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&checks);
            let mut create = vk::InstanceCreateInfo::default()
                .application_info(&application)
                .enabled_layer_names(&layers)
                .enabled_extension_names(&extensions);
            if validation {
                create = create.push_next(&mut features);
            }
            let instance = entry.create_instance(&create, None)?;

            // Check before the device is created: a host can then enable the requirements, or do without lightsum.
            let mut refused = String::new();
            let mut chosen = None;
            for physical_device in instance.enumerate_physical_devices().unwrap_or_default() {
                let requirements = Requirements::check(&entry, &instance, physical_device);
                match requirements.queue_family {
                    Some(family) if requirements.missing.is_empty() => {
                        chosen = Some((physical_device, family, requirements));
                        break;
                    }
                    _ => refused += &format!("; a device lacks {}", requirements.missing.join(" and ")),
                }
            }
            let Some((physical_device, queue_family, requirements)) = chosen else {
                instance.destroy_instance(None);
                return Err(format!("no Vulkan device that lightsum can use{refused}").into());
            };

            // A host adds its own extensions and features to these lists.
            let mut extensions = Vec::new();
            requirements.add_to(&mut extensions);
            let extensions: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
            let queues =
                [vk::DeviceQueueCreateInfo::default().queue_family_index(queue_family).queue_priorities(&[1.0])];
            let create = vk::DeviceCreateInfo::default()
                .queue_create_infos(&queues)
                .enabled_extension_names(&extensions)
                .enabled_features(&requirements.features);
            let device = match instance.create_device(physical_device, &create, None) {
                Ok(device) => device,
                Err(error) => {
                    instance.destroy_instance(None);
                    return Err(error.into());
                }
            };
            let queue = device.get_device_queue(queue_family, 0);
            let pool = vk::CommandPool::null();
            // From here on `drop` tidies up.
            let mut host = Host { entry, instance, physical_device, device, queue_family, queue, pool, validation };
            let create = vk::CommandPoolCreateInfo::default().queue_family_index(queue_family);
            host.pool = host.device.create_command_pool(&create, None)?;
            Ok(host)
        }
    }

    /// Lends the device to lightsum. The context and all objects made from it must be dropped before the host.
    pub fn lend(&self) -> Result<Context> {
        // On a host's device `validation` means: VK_EXT_debug_utils is enabled, so collect the layer's messages.
        let options = ContextOptions { validation: self.validation, ..ContextOptions::default() };
        // SAFETY: the handles belong together, the device was checked and made as required, and the host outlives the
        // context.
        Ok(unsafe { Context::adopt(self.handles(), &options) }?)
    }

    /// The handles that are lent.
    pub fn handles(&self) -> HostDevice {
        HostDevice {
            entry: self.entry.clone(),
            instance: self.instance.clone(),
            physical_device: self.physical_device,
            device: self.device.clone(),
            queue_family: self.queue_family,
            queue: self.queue,
        }
    }

    /// A command buffer in the recording state.
    pub fn begin(&self) -> Result<vk::CommandBuffer> {
        let allocate = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the pool is alive and used by this thread alone.
        unsafe {
            let commands = self.device.allocate_command_buffers(&allocate)?[0]; // One was asked for.
            self.device.begin_command_buffer(commands, &begin)?;
            Ok(commands)
        }
    }

    /// Submits a command buffer with lightsum's commands; `recorded` keeps their resources alive.
    pub fn submit(&self, commands: vk::CommandBuffer, recorded: Retained) -> Result<Submission<'_>> {
        // SAFETY: the command buffer is recording, and submitted once; nobody else uses the queue meanwhile.
        unsafe {
            self.device.end_command_buffer(commands)?;
            let fence = self.device.create_fence(&vk::FenceCreateInfo::default(), None)?;
            let buffers = [commands];
            let submit = [vk::SubmitInfo::default().command_buffers(&buffers)];
            if let Err(error) = self.device.queue_submit(self.queue, &submit, fence) {
                self.device.destroy_fence(fence, None);
                return Err(error.into());
            }
            Ok(Submission { host: self, commands, fence, _recorded: recorded })
        }
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        // SAFETY: what borrows the host is gone, and so is the context, as `lend` demands.
        unsafe {
            let _ = self.device.device_wait_idle();
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
            self.instance.destroy_instance(None);
        }
    }
}

/// A submission in flight.
pub struct Submission<'a> {
    host: &'a Host,
    commands: vk::CommandBuffer,
    fence: vk::Fence,
    /// Keeps the commands' resources alive; dropped after the wait.
    _recorded: Retained,
}

impl Submission<'_> {
    /// Waits until the commands have been executed.
    pub fn wait(self) -> Result<()> {
        // SAFETY: the fence was submitted with the commands.
        Ok(unsafe { self.host.device.wait_for_fences(&[self.fence], true, u64::MAX) }?)
    }
}

impl Drop for Submission<'_> {
    fn drop(&mut self) {
        // SAFETY: the wait here is over at once after `wait`; otherwise nothing may go before it. A lost device has no
        // work left.
        unsafe {
            let _ = self.host.device.wait_for_fences(&[self.fence], true, u64::MAX);
            self.host.device.destroy_fence(self.fence, None);
            self.host.device.free_command_buffers(self.host.pool, &[self.commands]);
        }
    }
}

/// Host memory that receives a copy of the image.
pub struct Readback<'a> {
    host: &'a Host,
    buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    bytes: u64,
}

impl<'a> Readback<'a> {
    /// Host-visible, coherent memory of `bytes` bytes.
    pub fn new(host: &'a Host, bytes: u64) -> Result<Readback<'a>> {
        let create = vk::BufferCreateInfo::default().size(bytes).usage(vk::BufferUsageFlags::TRANSFER_DST);
        // SAFETY: plain Vulkan; `readback` destroys what has been made, whatever fails.
        unsafe {
            let device = &host.device;
            let buffer = device.create_buffer(&create, None)?;
            let mut readback = Readback { host, buffer, memory: vk::DeviceMemory::null(), bytes };
            let wanted = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
            let requirements = device.get_buffer_memory_requirements(buffer);
            let properties = host.instance.get_physical_device_memory_properties(host.physical_device);
            let index = (0u32..)
                .zip(properties.memory_types_as_slice())
                .find(|(i, t)| requirements.memory_type_bits & (1 << i) != 0 && t.property_flags.contains(wanted))
                .map(|(i, _)| i)
                .ok_or("no memory that the host can read")?;
            let allocate =
                vk::MemoryAllocateInfo::default().allocation_size(requirements.size).memory_type_index(index);
            readback.memory = device.allocate_memory(&allocate, None)?;
            device.bind_buffer_memory(buffer, readback.memory, 0)?;
            Ok(readback)
        }
    }

    /// Records the copy of the engine's image. The image is in layout GENERAL, and what `record_image` wrote is visible
    /// to copies already; other uses, say sampling in a fragment shader, would need a barrier before, from
    /// COMPUTE_SHADER and SHADER_WRITE.
    pub fn record_copy(&self, commands: vk::CommandBuffer, engine: &Engine) {
        let image = engine.image();
        let layers = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        let extent = vk::Extent3D { width: image.width(), height: image.height(), depth: 1 };
        let region = [vk::BufferImageCopy::default().image_subresource(layers).image_extent(extent)];
        let to_host = [vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::TRANSFER_WRITE)
            .dst_access_mask(vk::AccessFlags::HOST_READ)];
        // SAFETY: the command buffer is recording; the buffer was made to hold the image.
        unsafe {
            let device = &self.host.device;
            device.cmd_copy_image_to_buffer(commands, image.handle(), vk::ImageLayout::GENERAL, self.buffer, &region);
            device.cmd_pipeline_barrier(
                commands,
                vk::PipelineStageFlags::TRANSFER,
                vk::PipelineStageFlags::HOST,
                vk::DependencyFlags::empty(),
                &to_host,
                &[],
                &[],
            );
        }
    }

    /// The texels, once the copy has been executed; none if the memory cannot be mapped.
    pub fn texels(&self) -> Vec<[f32; 4]> {
        // SAFETY: the memory is host-visible and coherent, not mapped elsewhere, and no command writes to it any more.
        unsafe {
            let device = &self.host.device;
            let Ok(mapped) = device.map_memory(self.memory, 0, self.bytes, vk::MemoryMapFlags::empty()) else {
                return Vec::new();
            };
            let texels = std::slice::from_raw_parts(mapped.cast::<[f32; 4]>(), self.bytes as usize / 16).to_vec();
            device.unmap_memory(self.memory);
            texels
        }
    }
}

impl Drop for Readback<'_> {
    fn drop(&mut self) {
        // SAFETY: submissions that use the buffer have been waited for. Null is ignored.
        unsafe {
            self.host.device.destroy_buffer(self.buffer, None);
            self.host.device.free_memory(self.memory, None);
        }
    }
}

/// An image in the host's hands: linear radiance, Rec. 709; alpha is coverage.
pub struct Picture {
    /// Width and height.
    pub size: [u32; 2],
    /// Row by row from the top.
    pub texels: Vec<[f32; 4]>,
}

impl Picture {
    /// The mean of red, green and blue.
    pub fn mean(&self) -> [f64; 3] {
        let count = self.texels.len().max(1) as f64;
        [0, 1, 2].map(|c| self.texels.iter().map(|texel| f64::from(texel[c])).sum::<f64>() / count)
    }

    /// Writes the image for display: radiance 1 is white, with the curve of sRGB.
    pub fn write_png(&self, path: &Path) -> Result<()> {
        let srgb = |x: f32| {
            let x = x.clamp(0.0, 1.0);
            let y = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
            (255.0 * y + 0.5) as u8
        };
        let bytes = self.texels.iter().flat_map(|texel| [0, 1, 2].map(|c| srgb(texel[c]))).collect();
        let [width, height] = self.size;
        let image = image::RgbImage::from_raw(width, height, bytes).ok_or("the image could not be read back")?;
        Ok(image.save_with_format(path, image::ImageFormat::Png)?)
    }
}
