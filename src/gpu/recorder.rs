//! Writes commands into a command buffer, each followed by one global memory barrier.

use std::sync::Arc;

use ash::vk;

use super::context::Context;
use super::image::Image;
use super::kernel::{Bindings, Kernel};
use super::memory::{Buffer, Memory};
use super::timers::Timers;
use crate::error::{Error, Result};

/// Maximum workgroups along x; kernels compute their linear index as `wg.x + wg.y * num_workgroups.x`.
const MAX_GROUPS_X: u32 = 32768;

/// Maximum bytes of one vkCmdUpdateBuffer.
const UPDATE_BYTES: usize = 65536;

/// Pipeline stages in use: kernels, copies, indirect arguments.
const USERS: vk::PipelineStageFlags = vk::PipelineStageFlags::from_raw(
    vk::PipelineStageFlags::COMPUTE_SHADER.as_raw()
        | vk::PipelineStageFlags::TRANSFER.as_raw()
        | vk::PipelineStageFlags::DRAW_INDIRECT.as_raw(),
);

/// Accesses of those stages.
const USES: vk::AccessFlags = vk::AccessFlags::from_raw(
    vk::AccessFlags::SHADER_READ.as_raw()
        | vk::AccessFlags::SHADER_WRITE.as_raw()
        | vk::AccessFlags::TRANSFER_READ.as_raw()
        | vk::AccessFlags::TRANSFER_WRITE.as_raw()
        | vk::AccessFlags::INDIRECT_COMMAND_READ.as_raw(),
);

/// A rectangle of four-byte texels in a buffer, and its place in an image with layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayerPart {
    /// First byte in the buffer, a multiple of 4.
    pub offset: u64,
    /// The layer.
    pub layer: u32,
    /// Its upper left corner there.
    pub origin: [u32; 2],
    /// Width and height.
    pub size: [u32; 2],
}

/// The resources of recorded commands; keep it until the commands have been executed.
#[must_use = "dropping this destroys what the recorded commands may still use"]
pub struct Retained {
    _objects: Vec<Arc<dyn Send + Sync>>,
}

/// Dispatches of a part: some milliseconds on a graphics card, and some tenths of a second on a processor.
const PART: u32 = 8;

/// Work that is recorded into several command buffers, to be submitted one after the other.
struct Parts {
    pool: vk::CommandPool,
    /// The parts that are complete.
    done: Vec<vk::CommandBuffer>,
    /// Dispatches of the last part.
    dispatches: u32,
    /// The last part takes what is still to come.
    last: bool,
}

/// Records into one command buffer, or into parts.
pub struct Recorder<'a> {
    ctx: Context,
    commands: vk::CommandBuffer,
    timers: Option<&'a Timers>,
    retained: Vec<Arc<dyn Send + Sync>>,
    parts: Option<Parts>,
}

impl<'a> Recorder<'a> {
    /// Starts recording into a command buffer; records the reset of the timers.
    ///
    /// # Safety
    /// The command buffer is in the recording state outside a render pass, was allocated on the context's device for a
    /// family with compute, and is used by nobody else while this lives; the timers are of the same context, and time no other commands until these
    /// have been executed. What
    /// [`Recorder::finish`] returns is kept until the commands have been executed or the command buffer has been reset.
    pub unsafe fn new(ctx: &Context, commands: vk::CommandBuffer, timers: Option<&'a Timers>) -> Recorder<'a> {
        let mut retained: Vec<Arc<dyn Send + Sync>> = Vec::new();
        if let Some(timers) = timers {
            // SAFETY: the caller's promise.
            unsafe { timers.0.reset(commands) };
            retained.push(timers.0.clone());
        }
        Recorder { ctx: ctx.clone(), commands, timers, retained, parts: None }
    }

    /// Goes on in a new command buffer of a pool after some dispatches each, until [`Recorder::last_part`].
    ///
    /// # Safety
    /// The command buffer comes from this pool, which is used by nobody else while this lives.
    pub(super) unsafe fn in_parts(mut self, pool: vk::CommandPool) -> Recorder<'a> {
        self.parts = Some(Parts { pool, done: Vec::new(), dispatches: 0, last: false });
        self
    }

    /// Begins the last part: if the work is submitted in parts, the device runs all later commands or none.
    pub fn last_part(&mut self) {
        if let Some(parts) = &mut self.parts {
            parts.last = true;
        }
    }

    /// Ends recording and the last command buffer; returns all of them with the resources of the commands.
    pub(super) fn finish_parts(self) -> std::result::Result<(Vec<vk::CommandBuffer>, Retained), vk::Result> {
        // SAFETY: the command buffer is recording.
        unsafe { self.ctx.device().end_command_buffer(self.commands) }?;
        let mut all = self.parts.map(|parts| parts.done).unwrap_or_default();
        all.push(self.commands);
        Ok((all, Retained { _objects: self.retained }))
    }

    /// Begins another part if this one has enough dispatches.
    fn next_part(&mut self) -> Result<()> {
        let Some(parts) = &mut self.parts else { return Ok(()) };
        parts.dispatches += 1;
        if parts.last || parts.dispatches < PART {
            return Ok(());
        }
        let device = self.ctx.device();
        let failed = |result| self.ctx.failed("a part of a pass", result);
        let allocate = vk::CommandBufferAllocateInfo::default()
            .command_pool(parts.pool)
            .level(vk::CommandBufferLevel::PRIMARY)
            .command_buffer_count(1);
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the pool is this recorder's alone; the command buffer so far is recording, the new one is begun once.
        unsafe {
            let next = device.allocate_command_buffers(&allocate).map_err(failed)?.swap_remove(0);
            device.end_command_buffer(self.commands).map_err(failed)?;
            device.begin_command_buffer(next, &begin).map_err(failed)?;
            parts.done.push(std::mem::replace(&mut self.commands, next));
        }
        parts.dispatches = 0;
        Ok(())
    }

    /// Ends recording (the command buffer itself stays open) and returns the resources of the commands.
    pub fn finish(self) -> Retained {
        Retained { _objects: self.retained }
    }

    /// The command buffer, for commands of the caller's own.
    pub fn command_buffer(&self) -> vk::CommandBuffer {
        self.commands
    }

    /// Orders the following commands after all earlier work of the queue, from any recorder.
    pub fn begin(&mut self) {
        self.barrier(vk::PipelineStageFlags::ALL_COMMANDS, vk::AccessFlags::MEMORY_WRITE, USERS, USES);
    }

    /// Makes all writes visible to the host.
    pub(super) fn end(&mut self) {
        self.barrier(
            vk::PipelineStageFlags::ALL_COMMANDS,
            vk::AccessFlags::MEMORY_WRITE,
            vk::PipelineStageFlags::HOST,
            vk::AccessFlags::HOST_READ,
        );
    }

    /// Runs `groups` workgroups, spread over x and y. The kernel ignores those beyond `groups`, which it must know.
    pub fn dispatch(&mut self, kernel: &Kernel, bindings: &Bindings, push: &[u8], groups: u64) -> Result<()> {
        let [max_x, max_y, _] = self.ctx.info().max_workgroup_count;
        let x = groups.min(u64::from(max_x.min(MAX_GROUPS_X)));
        let y = if x == 0 { 0 } else { groups.div_ceil(x) };
        if y > u64::from(max_y) {
            return Err(Error::Shader {
                name: kernel.name().to_owned(),
                message: format!("{groups} workgroups exceed the device's {x} x {max_y}; lower the resolution"),
            });
        }
        self.prepare(kernel, bindings, push)?;
        if groups == 0 {
            return Ok(());
        }
        // SAFETY: the command buffer is recording; pipeline, set and push constants were set by `prepare`.
        unsafe { self.ctx.device().cmd_dispatch(self.commands, x as u32, y as u32, 1) };
        self.after_dispatch()
    }

    /// Runs a kernel with no workgroups.
    pub(super) fn dispatch_none(&mut self, kernel: &Kernel, bindings: &Bindings, push: &[u8]) -> Result<()> {
        self.prepare(kernel, bindings, push)?;
        // SAFETY: the command buffer is recording; pipeline, set and push constants were set by `prepare`.
        unsafe { self.ctx.device().cmd_dispatch(self.commands, 0, 0, 0) };
        Ok(())
    }

    /// Runs the number of workgroups in `args`: x, y, z as u32 at `offset`, written by an earlier command.
    pub fn dispatch_indirect(
        &mut self,
        kernel: &Kernel,
        bindings: &Bindings,
        push: &[u8],
        args: &Buffer,
        offset: u64,
    ) -> Result<()> {
        self.check_buffer(args)?;
        if args.memory() != Memory::Device {
            return Err(args.misuse(String::from("arguments of a dispatch come from kernels, in Memory::Device")));
        }
        args.check_range(offset, size_of::<vk::DispatchIndirectCommand>() as u64)?;
        if !offset.is_multiple_of(4) {
            return Err(args.misuse(format!("arguments of a dispatch at byte {offset}, which is no multiple of 4")));
        }
        self.prepare(kernel, bindings, push)?;
        self.retained.push(args.recorded());
        // SAFETY: as above; the arguments lie inside a buffer with indirect usage.
        unsafe { self.ctx.device().cmd_dispatch_indirect(self.commands, args.handle(), offset) };
        self.after_dispatch()
    }

    /// Binds everything for a dispatch.
    fn prepare(&mut self, kernel: &Kernel, bindings: &Bindings, push: &[u8]) -> Result<()> {
        let misuse = |message: String| Error::Shader { name: kernel.name().to_owned(), message };
        if !Arc::ptr_eq(&kernel.0, &bindings.0.kernel.0) {
            return Err(misuse(format!("the bindings are those of {}", bindings.0.kernel.name())));
        }
        if !Arc::ptr_eq(&kernel.0.ctx.inner, &self.ctx.inner) {
            return Err(misuse("belongs to another context".into()));
        }
        let wanted = kernel.shader().push_bytes as usize;
        if push.len() != wanted {
            return Err(misuse(format!("{} bytes of push constants, {wanted} are declared", push.len())));
        }
        let device = self.ctx.device();
        let pipeline = kernel.pipeline()?;
        // SAFETY: the command buffer is recording; the set was allocated with the pipeline's layout.
        unsafe {
            device.cmd_bind_pipeline(self.commands, vk::PipelineBindPoint::COMPUTE, pipeline);
            if bindings.0.set != vk::DescriptorSet::null() {
                device.cmd_bind_descriptor_sets(
                    self.commands,
                    vk::PipelineBindPoint::COMPUTE,
                    kernel.0.layout,
                    0,
                    &[bindings.0.set],
                    &[],
                );
            }
            if !push.is_empty() {
                device.cmd_push_constants(self.commands, kernel.0.layout, vk::ShaderStageFlags::COMPUTE, 0, push);
            }
        }
        // The bindings keep the kernel and all its resources.
        self.retained.push(bindings.0.clone());
        self.retained.extend(bindings.0.seen_by_host.iter().map(Buffer::recorded));
        Ok(())
    }

    /// Writes bytes that are stored in the command buffer itself; offset and length are multiples of 4.
    pub fn update(&mut self, buffer: &Buffer, offset: u64, bytes: &[u8]) -> Result<()> {
        self.check_buffer(buffer)?;
        buffer.check_range(offset, bytes.len() as u64)?;
        if !offset.is_multiple_of(4) || !bytes.len().is_multiple_of(4) {
            return Err(buffer.misuse(format!("update of bytes {offset} + {}: no multiples of 4", bytes.len())));
        }
        self.retained.push(buffer.recorded());
        for (piece, at) in bytes.chunks(UPDATE_BYTES).zip((offset..).step_by(UPDATE_BYTES)) {
            // SAFETY: the command buffer is recording; range and alignment were checked above.
            unsafe { self.ctx.device().cmd_update_buffer(self.commands, buffer.handle(), at, piece) };
        }
        self.after_transfer(buffer);
        Ok(())
    }

    /// Fills a buffer with a repeated value.
    pub fn fill(&mut self, buffer: &Buffer, value: u32) -> Result<()> {
        self.check_buffer(buffer)?;
        self.retained.push(buffer.recorded());
        // SAFETY: the command buffer is recording; the size is that of the buffer, a multiple of 4.
        unsafe { self.ctx.device().cmd_fill_buffer(self.commands, buffer.handle(), 0, buffer.size(), value) };
        self.after_transfer(buffer);
        Ok(())
    }

    /// Copies a buffer as a whole to the start of another that is at least as big.
    pub fn copy(&mut self, src: &Buffer, dst: &Buffer) -> Result<()> {
        self.copy_range(src, 0, dst, 0, src.bytes())
    }

    /// Copies `bytes` bytes.
    pub fn copy_range(&mut self, src: &Buffer, src_at: u64, dst: &Buffer, dst_at: u64, bytes: u64) -> Result<()> {
        self.check_buffer(src)?;
        self.check_buffer(dst)?;
        src.check_range(src_at, bytes)?;
        dst.check_range(dst_at, bytes)?;
        if src.handle() == dst.handle() && src_at < dst_at + bytes && dst_at < src_at + bytes {
            return Err(src.misuse(format!("copy of bytes {src_at} + {bytes} onto themselves at {dst_at}")));
        }
        if bytes == 0 {
            return Ok(());
        }
        self.retained.extend([src.recorded(), dst.recorded()]);
        let regions = [vk::BufferCopy { src_offset: src_at, dst_offset: dst_at, size: bytes }];
        // SAFETY: the command buffer is recording; both ranges lie inside their buffers and do not overlap.
        unsafe { self.ctx.device().cmd_copy_buffer(self.commands, src.handle(), dst.handle(), &regions) };
        self.after_transfer(dst);
        Ok(())
    }

    /// Copies an image, row by row without padding, to the start of a buffer that is at least as big.
    pub fn copy_image_to_buffer(&mut self, image: &Image, buffer: &Buffer) -> Result<()> {
        self.check_buffer(buffer)?;
        self.check_image(image)?;
        buffer.check_range(0, image.bytes())?;
        self.retained.extend([image.0.clone() as Arc<dyn Send + Sync>, buffer.recorded()]);
        let regions = [vk::BufferImageCopy::default()
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                mip_level: 0,
                base_array_layer: 0,
                layer_count: 1,
            })
            .image_extent(vk::Extent3D { width: image.width(), height: image.height(), depth: 1 })];
        // SAFETY: the command buffer is recording; the buffer is big enough; images are kept in GENERAL.
        unsafe {
            self.ctx.device().cmd_copy_image_to_buffer(
                self.commands,
                image.handle(),
                vk::ImageLayout::GENERAL,
                buffer.handle(),
                &regions,
            );
        }
        self.after_transfer(buffer);
        Ok(())
    }

    /// Copies rectangles, row by row without padding, from a buffer into the layers of an image.
    pub fn copy_to_layers(&mut self, buffer: &Buffer, image: &Image, parts: &[LayerPart]) -> Result<()> {
        self.check_buffer(buffer)?;
        self.check_image(image)?;
        for part in parts {
            let inside = |k: usize, edge: u32| part.origin[k].checked_add(part.size[k]).is_some_and(|end| end <= edge);
            if !inside(0, image.width()) || !inside(1, image.height()) || part.layer >= image.layers() {
                return Err(Error::Resource {
                    name: image.name().to_owned(),
                    message: format!("{part:?} lies outside {}x{}x{}", image.width(), image.height(), image.layers()),
                });
            }
            if part.size.contains(&0) || !part.offset.is_multiple_of(4) {
                return Err(buffer.misuse(format!("{part:?} is empty, or begins at no multiple of 4 bytes")));
            }
            buffer.check_range(part.offset, 4 * u64::from(part.size[0]) * u64::from(part.size[1]))?;
        }
        if parts.is_empty() {
            return Ok(());
        }
        self.retained.extend([image.0.clone() as Arc<dyn Send + Sync>, buffer.recorded()]);
        let region = |part: &LayerPart| {
            vk::BufferImageCopy::default()
                .buffer_offset(part.offset)
                .image_subresource(vk::ImageSubresourceLayers {
                    aspect_mask: vk::ImageAspectFlags::COLOR,
                    mip_level: 0,
                    base_array_layer: part.layer,
                    layer_count: 1,
                })
                .image_offset(vk::Offset3D { x: part.origin[0] as i32, y: part.origin[1] as i32, z: 0 })
                .image_extent(vk::Extent3D { width: part.size[0], height: part.size[1], depth: 1 })
        };
        let regions: Vec<_> = parts.iter().map(region).collect();
        // SAFETY: the command buffer is recording; all parts lie inside the buffer and the image, which is kept in GENERAL.
        unsafe {
            self.ctx.device().cmd_copy_buffer_to_image(
                self.commands,
                buffer.handle(),
                image.handle(),
                vk::ImageLayout::GENERAL,
                &regions,
            );
        }
        self.barrier(vk::PipelineStageFlags::TRANSFER, vk::AccessFlags::TRANSFER_WRITE, USERS, USES);
        Ok(())
    }

    /// Brings an image from the undefined layout to GENERAL; its content is lost.
    pub fn image_to_general(&mut self, image: &Image) -> Result<()> {
        self.change_layout(image, vk::ImageLayout::UNDEFINED, vk::ImageLayout::GENERAL)
    }

    /// Brings an image from one layout to another, after all earlier commands and before all later ones, of any stage. From UNDEFINED its
    /// content is lost.
    pub fn change_layout(&mut self, image: &Image, before: vk::ImageLayout, after: vk::ImageLayout) -> Result<()> {
        self.check_image(image)?;
        if matches!(after, vk::ImageLayout::UNDEFINED | vk::ImageLayout::PREINITIALIZED) {
            return Err(Error::Resource {
                name: image.name().to_owned(),
                message: format!("no image can be brought to the layout {after:?}"),
            });
        }
        self.retained.push(image.0.clone());
        let barriers = [vk::ImageMemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
            .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE)
            .old_layout(before)
            .new_layout(after)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(image.handle())
            .subresource_range(image.whole())];
        // SAFETY: the command buffer is recording; the image is alive. All earlier use of the image is waited for.
        unsafe {
            self.ctx.device().cmd_pipeline_barrier(
                self.commands,
                vk::PipelineStageFlags::ALL_COMMANDS,
                vk::PipelineStageFlags::ALL_COMMANDS,
                vk::DependencyFlags::empty(),
                &[],
                &[],
                &barriers,
            );
        }
        Ok(())
    }

    /// Records under a name: a label for debuggers, and a scope of the timers.
    pub fn scope(&mut self, name: &str, record: impl FnOnce(&mut Self) -> Result<()>) -> Result<()> {
        // Not across parts: Mesa 22.3 crashes where a label is closed in another command buffer.
        let labels = self.ctx.inner.labels && self.parts.is_none();
        let debug = self.ctx.inner.debug.clone().filter(|_| labels);
        let label = std::ffi::CString::new(name).unwrap_or_default();
        if let Some(debug) = &debug {
            let label = vk::DebugUtilsLabelEXT::default().label_name(&label);
            // SAFETY: the extension is enabled and the command buffer is recording; the label is closed below.
            unsafe { debug.cmd_begin_debug_utils_label(self.commands, &label) };
        }
        // SAFETY: the command buffer is recording on the timers' device; they were reset at its start.
        let query = self.timers.and_then(|timers| unsafe { timers.0.begin(self.commands, name) });
        let result = record(self);
        if let (Some(timers), Some(query)) = (self.timers, query) {
            // SAFETY: as above; the command buffer may be that of a later part.
            unsafe { timers.0.end(self.commands, query) };
        }
        if let Some(debug) = &debug {
            // SAFETY: closes the label opened above.
            unsafe { debug.cmd_end_debug_utils_label(self.commands) };
        }
        result
    }

    fn check_buffer(&self, buffer: &Buffer) -> Result<()> {
        if buffer.belongs_to(&self.ctx) {
            return Ok(());
        }
        Err(buffer.misuse("belongs to another context".into()))
    }

    fn check_image(&self, image: &Image) -> Result<()> {
        if image.belongs_to(&self.ctx) {
            return Ok(());
        }
        Err(Error::Resource { name: image.name().to_owned(), message: "belongs to another context".into() })
    }

    fn after_dispatch(&mut self) -> Result<()> {
        self.barrier(vk::PipelineStageFlags::COMPUTE_SHADER, vk::AccessFlags::SHADER_WRITE, USERS, USES);
        self.next_part()
    }

    fn after_transfer(&mut self, dst: &Buffer) {
        let (mut stages, mut access) = (USERS, USES);
        if dst.memory() == Memory::Readback {
            stages |= vk::PipelineStageFlags::HOST;
            access |= vk::AccessFlags::HOST_READ;
        }
        self.barrier(vk::PipelineStageFlags::TRANSFER, vk::AccessFlags::TRANSFER_WRITE, stages, access);
    }

    fn barrier(
        &mut self,
        src_stages: vk::PipelineStageFlags,
        src_access: vk::AccessFlags,
        dst_stages: vk::PipelineStageFlags,
        dst_access: vk::AccessFlags,
    ) {
        let barrier = [vk::MemoryBarrier::default().src_access_mask(src_access).dst_access_mask(dst_access)];
        // SAFETY: the command buffer is recording; a queue with compute knows all these stages.
        unsafe {
            self.ctx.device().cmd_pipeline_barrier(
                self.commands,
                src_stages,
                dst_stages,
                vk::DependencyFlags::empty(),
                &barrier,
                &[],
                &[],
            );
        }
    }
}
