//! Frames of a window: the host's command buffer, into which the engine and the program record, and its submission.

use ash::vk;

use super::WindowDevice;
use super::swapchain::{Format, Swapchain, WindowImage};
use crate::error::{Error, Result};
use crate::gpu::image::WHOLE_IMAGE;
use crate::gpu::{Context, Image, Recorder, Retained, Timers};

/// Nanoseconds to wait for an image of a window; a hidden one may give none.
const PATIENCE: u64 = 500_000_000;

/// Colour where no image is shown.
const BACKGROUND: [f32; 4] = [0.09, 0.09, 0.1, 1.0];

/// An image in the window: RGBA of 8 bits, layout GENERAL, and the pixels of the window that it fills, each of its pixels as a block.
pub struct Shown {
    /// The image.
    pub image: Image,
    /// Its upper left corner in the window.
    pub at: [u32; 2],
    /// Width and height in the window; what lies outside of the window is left out.
    pub size: [u32; 2],
}

/// The target of a program's own drawing over the image: a command buffer inside a render pass, whose one attachment is the window's image.
pub struct Canvas {
    /// The command buffer.
    pub commands: vk::CommandBuffer,
    /// Width and height of the window, pixels.
    pub extent: vk::Extent2D,
}

/// The outcome of a frame.
#[derive(Debug)]
pub enum Outcome {
    /// It was submitted with all commands.
    Submitted,
    /// The engine's commands failed; the rest was submitted.
    Failed(Error),
    /// Nothing was recorded: the window is minimised or hidden, or changed its size.
    Skipped,
}

/// Shows frames in a window, one in flight at a time.
pub struct Presenter {
    context: Context,
    device: WindowDevice,
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    done: vk::Fence,
    acquired: vk::Semaphore,
    size: [u32; 2],
    /// The swapchain does not fit the window any more.
    outdated: bool,
    in_flight: bool,
    /// Resources that the frame in flight uses.
    retained: Option<(Option<Retained>, Option<Image>)>,
    swapchain: Option<Swapchain>,
    format: Format,
}

impl Presenter {
    /// For a window of this size in pixels. `context`: lent by the device.
    pub fn new(device: &WindowDevice, context: &Context, size: [u32; 2]) -> Result<Presenter> {
        let mut presenter = Presenter {
            context: context.clone(),
            device: device.clone(),
            pool: vk::CommandPool::null(),
            commands: vk::CommandBuffer::null(),
            done: vk::Fence::null(),
            acquired: vk::Semaphore::null(),
            size,
            outdated: true,
            in_flight: false,
            retained: None,
            swapchain: None,
            format: Format::new(device)?,
        };
        let pool = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER)
            .queue_family_index(device.0.family);
        // SAFETY: plain creations on a live device; `drop` destroys what was made before a failure.
        unsafe {
            let vulkan = device.device();
            presenter.pool = vulkan.create_command_pool(&pool, None).map_err(device.failed("a command pool"))?;
            let allocate =
                vk::CommandBufferAllocateInfo::default().command_pool(presenter.pool).command_buffer_count(1);
            let made = vulkan.allocate_command_buffers(&allocate).map_err(device.failed("a command buffer"))?;
            presenter.commands = made[0]; // One was asked for.
            presenter.done = vulkan
                .create_fence(&vk::FenceCreateInfo::default(), None)
                .map_err(device.failed("a fence of the window"))?;
            presenter.acquired = vulkan
                .create_semaphore(&vk::SemaphoreCreateInfo::default(), None)
                .map_err(device.failed("a semaphore of the window"))?;
        }
        Ok(presenter)
    }

    /// The render pass of [`Canvas`], for pipelines.
    pub fn render_pass(&self) -> vk::RenderPass {
        self.format.render_pass
    }

    /// Tells the window's new size in pixels.
    pub fn resize(&mut self, size: [u32; 2]) {
        self.outdated |= size != self.size;
        self.size = size;
    }

    /// Whether no frame is in flight. Errors: the device was lost.
    pub fn is_idle(&mut self) -> Result<bool> {
        if self.in_flight {
            // SAFETY: the fence was submitted with the frame.
            let done = unsafe { self.device.device().get_fence_status(self.done) };
            self.in_flight = !done.map_err(self.device.failed("in a frame of the window"))?;
        }
        if !self.in_flight {
            self.retained = None;
        }
        Ok(!self.in_flight)
    }

    /// Waits for the frame in flight.
    pub fn wait(&mut self) -> Result<()> {
        if self.in_flight {
            // SAFETY: the fence was submitted with the frame.
            let done = unsafe { self.device.device().wait_for_fences(&[self.done], true, u64::MAX) };
            done.map_err(self.device.failed("in a frame of the window"))?;
        }
        self.is_idle().map(drop)
    }

    /// Shows a frame, after the one in flight: what `record` records and returns, under what `draw` draws.
    ///
    /// Neither is called while the window has no area or gives no image. Resources that `draw` uses must live until the frame is done. Errors: the
    /// device or the surface was lost; those of `draw`.
    pub fn show(
        &mut self,
        timers: Option<&Timers>,
        record: impl FnOnce(&mut Recorder) -> Result<Option<Shown>>,
        draw: impl FnOnce(&Canvas) -> Result<()>,
    ) -> Result<Outcome> {
        self.wait()?;
        let Some(index) = self.acquire()? else { return Ok(Outcome::Skipped) };
        let Some(swapchain) = &self.swapchain else { return Ok(Outcome::Skipped) };
        // Vulkan returns the index of an image of the swapchain.
        let (target, extent) = (swapchain.images[index as usize], swapchain.extent);

        self.begin()?;
        let mut shown = None;
        // SAFETY: the command buffer is recording on the device of the context, outside of a render pass, and belongs to this presenter;
        // what keeps the resources is held until the fence has been waited for.
        let recorded = unsafe {
            self.context.record_into(self.commands, timers, |rec| {
                shown = record(rec)?;
                Ok(())
            })
        };
        let mut failure = None;
        let recorded = match recorded {
            Ok(retained) => Some(retained),
            Err(error) => {
                failure = Some(error);
                self.begin()?;
                None
            }
        };
        self.record_image(&target, extent, shown.as_ref());
        let begin = vk::RenderPassBeginInfo::default()
            .render_pass(self.format.render_pass)
            .framebuffer(target.framebuffer)
            .render_area(vk::Rect2D { offset: vk::Offset2D::default(), extent });
        // SAFETY: the command buffer is recording; the image is in the layout that the pass begins with.
        unsafe {
            self.device.device().cmd_begin_render_pass(self.commands, &begin, vk::SubpassContents::INLINE);
        }
        self.retained = Some((recorded, shown.map(|shown| shown.image)));
        let drawn = draw(&Canvas { commands: self.commands, extent });
        // SAFETY: within the render pass begun above.
        unsafe {
            self.device.device().cmd_end_render_pass(self.commands);
            let ended = self.device.device().end_command_buffer(self.commands);
            ended.map_err(self.device.failed("a frame of the window"))?;
        }
        // Submitted even if drawing failed: the semaphore of the image must be waited for.
        self.submit(index, target.drawn)?;
        drawn?;
        Ok(failure.map_or(Outcome::Submitted, Outcome::Failed))
    }

    /// The next image; `None`: there is none now. Makes new ones if they do not fit the window.
    fn acquire(&mut self) -> Result<Option<u32>> {
        for _ in 0..2 {
            if self.outdated || self.swapchain.is_none() {
                self.rebuild()?;
            }
            let Some(swapchain) = &self.swapchain else { return Ok(None) };
            // SAFETY: the semaphore is not in use: the frame that waited for it is done.
            let next = unsafe {
                let fence = vk::Fence::null();
                swapchain.functions.acquire_next_image(swapchain.handle, PATIENCE, self.acquired, fence)
            };
            match next {
                Ok((index, suboptimal)) => {
                    self.outdated = suboptimal;
                    return Ok(Some(index));
                }
                Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => self.outdated = true,
                Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => return Ok(None),
                Err(result) => return Err(self.device.failed("an image of the window")(result)),
            }
        }
        Ok(None)
    }

    fn rebuild(&mut self) -> Result<()> {
        // Presentation has no fence of its own.
        self.wait_for_queue()?;
        self.swapchain = Swapchain::new(&self.format, self.size, self.swapchain.take())?;
        self.outdated = false;
        Ok(())
    }

    fn wait_for_queue(&self) -> Result<()> {
        let queue = self.device.queue();
        // SAFETY: the queue is this device's, and locked.
        unsafe { self.device.device().queue_wait_idle(*queue) }.map_err(self.device.failed("in a frame of the window"))
    }

    fn begin(&self) -> Result<()> {
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        let device = self.device.device();
        // SAFETY: the command buffer is not in use: the frame before is done.
        let begun = unsafe {
            device
                .reset_command_buffer(self.commands, vk::CommandBufferResetFlags::empty())
                .and_then(|()| device.begin_command_buffer(self.commands, &begin))
        };
        begun.map_err(self.device.failed("a frame of the window"))
    }

    /// Records the background and the image, and readies the window's image for drawing.
    fn record_image(&self, target: &WindowImage, extent: vk::Extent2D, shown: Option<&Shown>) {
        let device = self.device.device();
        let layers = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        let change = |from, to, before, after| {
            vk::ImageMemoryBarrier::default()
                .old_layout(from)
                .new_layout(to)
                .src_access_mask(before)
                .dst_access_mask(after)
                .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .image(target.image)
                .subresource_range(WHOLE_IMAGE)
        };
        const COPY: vk::ImageLayout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        const WRITE: vk::AccessFlags = vk::AccessFlags::TRANSFER_WRITE;
        let transfer = vk::PipelineStageFlags::TRANSFER;
        let blit = shown.and_then(|shown| blit(shown, extent, layers).map(|region| (shown.image.handle(), region)));
        // SAFETY: the command buffer is recording. The image of the window is ours once the semaphore, waited for at the transfer stage, is
        // signalled; the other is in layout GENERAL and visible to transfers, as the recorder left it. The regions lie inside both.
        unsafe {
            let barrier = |from_stage, to_stage, barrier: vk::ImageMemoryBarrier| {
                let none = vk::DependencyFlags::empty();
                device.cmd_pipeline_barrier(self.commands, from_stage, to_stage, none, &[], &[], &[barrier]);
            };
            let none = vk::AccessFlags::empty();
            barrier(transfer, transfer, change(vk::ImageLayout::UNDEFINED, COPY, none, WRITE));
            let color = vk::ClearColorValue { float32: BACKGROUND };
            device.cmd_clear_color_image(self.commands, target.image, COPY, &color, &[WHOLE_IMAGE]);
            if let Some((image, region)) = blit {
                barrier(transfer, transfer, change(COPY, COPY, WRITE, WRITE));
                let (general, nearest) = (vk::ImageLayout::GENERAL, vk::Filter::NEAREST);
                device.cmd_blit_image(self.commands, image, general, target.image, COPY, &[region], nearest);
            }
            let drawing = vk::AccessFlags::COLOR_ATTACHMENT_READ | vk::AccessFlags::COLOR_ATTACHMENT_WRITE;
            let to_draw = change(COPY, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL, WRITE, drawing);
            barrier(transfer, vk::PipelineStageFlags::COLOR_ATTACHMENT_OUTPUT, to_draw);
        }
    }

    fn submit(&mut self, index: u32, drawn: vk::Semaphore) -> Result<()> {
        let Some(swapchain) = &self.swapchain else { return Ok(()) };
        let (acquired, commands, semaphores) = ([self.acquired], [self.commands], [drawn]);
        let stages = [vk::PipelineStageFlags::TRANSFER];
        let submit = [vk::SubmitInfo::default()
            .wait_semaphores(&acquired)
            .wait_dst_stage_mask(&stages)
            .command_buffers(&commands)
            .signal_semaphores(&semaphores)];
        let (swapchains, indices) = ([swapchain.handle], [index]);
        let present =
            vk::PresentInfoKHR::default().wait_semaphores(&semaphores).swapchains(&swapchains).image_indices(&indices);
        let device = self.device.device();
        let queue = self.device.queue();
        // SAFETY: the command buffer is complete and submitted once; the fence is not in use, the queue is locked.
        let presented = unsafe {
            device.reset_fences(&[self.done]).map_err(self.device.failed("a frame of the window"))?;
            let submitted = device.queue_submit(*queue, &submit, self.done);
            submitted.map_err(self.device.failed("in a frame of the window"))?;
            self.in_flight = true;
            swapchain.functions.queue_present(*queue, &present)
        };
        match presented {
            Ok(suboptimal) => self.outdated |= suboptimal,
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => self.outdated = true,
            Err(result) => return Err(self.device.failed("showing a frame")(result)),
        }
        Ok(())
    }
}

/// The part of an image that lies in the window, and its place there; `None`: it has none.
fn blit(shown: &Shown, extent: vk::Extent2D, layers: vk::ImageSubresourceLayers) -> Option<vk::ImageBlit> {
    let image = [shown.image.width(), shown.image.height()];
    let mut corners = [[0i32; 2]; 4];
    for (axis, window) in [extent.width, extent.height].into_iter().enumerate() {
        let inside = window.saturating_sub(shown.at[axis]).min(shown.size[axis]);
        // The pixels that are seen, whole or in part.
        let seen = (u64::from(inside) * u64::from(image[axis])).div_ceil(u64::from(shown.size[axis].max(1)));
        if inside == 0 || seen == 0 {
            return None;
        }
        corners[1][axis] = seen as i32;
        corners[2][axis] = shown.at[axis] as i32;
        corners[3][axis] = (shown.at[axis] + inside) as i32;
    }
    let [from, to, at, end] = corners.map(|[x, y]| vk::Offset3D { x, y, z: 0 });
    let [from, to, at, end] = [from, vk::Offset3D { z: 1, ..to }, at, vk::Offset3D { z: 1, ..end }];
    Some(
        vk::ImageBlit::default()
            .src_subresource(layers)
            .src_offsets([from, to])
            .dst_subresource(layers)
            .dst_offsets([at, end]),
    )
}

impl Drop for Presenter {
    fn drop(&mut self) {
        // A lost device has no work left.
        let _ = self.wait_for_queue();
        self.retained = None;
        self.swapchain = None;
        // SAFETY: the queue has been waited for. Null handles are ignored.
        unsafe {
            let device = self.device.device();
            device.destroy_semaphore(self.acquired, None);
            device.destroy_fence(self.done, None);
            device.destroy_command_pool(self.pool, None);
        }
    }
}
