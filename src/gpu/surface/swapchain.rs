//! The images of a window, and the render pass that draws over them.

use ash::{khr, vk};

use super::WindowDevice;
use crate::error::{Error, Result};
use crate::gpu::image::WHOLE_IMAGE;

/// The parts that a resized window keeps: the format of its images and the render pass that draws over them.
pub(super) struct Format {
    device: WindowDevice,
    pub surface: vk::SurfaceFormatKHR,
    pub render_pass: vk::RenderPass,
}

impl Format {
    /// Images of 8 bits a channel whose numbers are shown as they are: tone curves have been applied before.
    pub fn new(device: &WindowDevice) -> Result<Format> {
        let inner = &device.0;
        // SAFETY: the surface is that of the instance.
        let formats =
            unsafe { inner.surface_functions.get_physical_device_surface_formats(inner.physical, inner.surface) };
        let formats = formats.map_err(device.failed("the window's formats"))?;
        let fits = |format: &&vk::SurfaceFormatKHR| {
            // SAFETY: the physical device is that of the instance.
            let properties =
                unsafe { inner.instance.raw.get_physical_device_format_properties(inner.physical, format.format) };
            matches!(format.format, vk::Format::B8G8R8A8_UNORM | vk::Format::R8G8B8A8_UNORM)
                && format.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR
                && properties.optimal_tiling_features.contains(vk::FormatFeatureFlags::BLIT_DST)
        };
        let Some(&surface) = formats.iter().find(fits) else {
            let name = &inner.info.name;
            let message =
                format!("device {name} shows no images of 8 bits a channel in this window; it has {formats:?}");
            return Err(Error::NoDevice(message));
        };
        let attachments = [vk::AttachmentDescription::default()
            .format(surface.format)
            .samples(vk::SampleCountFlags::TYPE_1)
            .load_op(vk::AttachmentLoadOp::LOAD)
            .store_op(vk::AttachmentStoreOp::STORE)
            .stencil_load_op(vk::AttachmentLoadOp::DONT_CARE)
            .stencil_store_op(vk::AttachmentStoreOp::DONT_CARE)
            .initial_layout(vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)
            .final_layout(vk::ImageLayout::PRESENT_SRC_KHR)];
        let color = [vk::AttachmentReference { attachment: 0, layout: vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL }];
        let subpasses = [vk::SubpassDescription::default()
            .pipeline_bind_point(vk::PipelineBindPoint::GRAPHICS)
            .color_attachments(&color)];
        let create = vk::RenderPassCreateInfo::default().attachments(&attachments).subpasses(&subpasses);
        // SAFETY: the structures are complete and live until the end of the call.
        let render_pass = unsafe { inner.device.create_render_pass(&create, None) };
        let render_pass = render_pass.map_err(device.failed("the window's render pass"))?;
        Ok(Format { device: device.clone(), surface, render_pass })
    }
}

impl Drop for Format {
    fn drop(&mut self) {
        // SAFETY: the presenter has waited for all frames, and has dropped what was made with it.
        unsafe { self.device.device().destroy_render_pass(self.render_pass, None) };
    }
}

/// Images of one size, each with its view, framebuffer, and the semaphore that tells the window of its last command.
pub(super) struct Swapchain {
    device: WindowDevice,
    pub functions: khr::swapchain::Device,
    pub handle: vk::SwapchainKHR,
    pub images: Vec<WindowImage>,
    pub extent: vk::Extent2D,
}

#[derive(Clone, Copy, Default)]
pub(super) struct WindowImage {
    pub image: vk::Image,
    pub view: vk::ImageView,
    pub framebuffer: vk::Framebuffer,
    pub drawn: vk::Semaphore,
}

impl Swapchain {
    /// Images for a window of this size; `None` while it has no area. `old`: what they replace, of which nothing is in use.
    pub fn new(format: &Format, size: [u32; 2], old: Option<Swapchain>) -> Result<Option<Swapchain>> {
        let device = &format.device;
        let inner = &device.0;
        // SAFETY: the surface is that of the instance.
        let (can, modes) = unsafe {
            (
                inner.surface_functions.get_physical_device_surface_capabilities(inner.physical, inner.surface),
                inner.surface_functions.get_physical_device_surface_present_modes(inner.physical, inner.surface),
            )
        };
        let can = can.map_err(device.failed("the window's capabilities"))?;
        let modes = modes.map_err(device.failed("the window's present modes"))?;
        let usage = vk::ImageUsageFlags::TRANSFER_DST | vk::ImageUsageFlags::COLOR_ATTACHMENT;
        if !can.supported_usage_flags.contains(usage) {
            let name = &inner.info.name;
            return Err(Error::NoDevice(format!("device {name} cannot copy to images of this window")));
        }
        // Some systems leave the size to us.
        let extent = match can.current_extent.width {
            u32::MAX => vk::Extent2D {
                width: size[0].clamp(can.min_image_extent.width, can.max_image_extent.width),
                height: size[1].clamp(can.min_image_extent.height, can.max_image_extent.height),
            },
            _ => can.current_extent,
        };
        if extent.width == 0 || extent.height == 0 {
            return Ok(None);
        }
        let most = if can.max_image_count == 0 { u32::MAX } else { can.max_image_count };
        // The newest image replaces one that waits, so that a frame never waits behind another.
        let newest = modes.contains(&vk::PresentModeKHR::MAILBOX);
        let alpha = [vk::CompositeAlphaFlagsKHR::OPAQUE, vk::CompositeAlphaFlagsKHR::INHERIT];
        let create = vk::SwapchainCreateInfoKHR::default()
            .surface(inner.surface)
            .min_image_count((can.min_image_count + 1).min(most))
            .image_format(format.surface.format)
            .image_color_space(format.surface.color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(usage)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(can.current_transform)
            .composite_alpha(alpha.into_iter().find(|a| can.supported_composite_alpha.contains(*a)).unwrap_or(alpha[0]))
            .present_mode(if newest { vk::PresentModeKHR::MAILBOX } else { vk::PresentModeKHR::FIFO })
            .clipped(true)
            .old_swapchain(old.as_ref().map_or(vk::SwapchainKHR::null(), |old| old.handle));
        let functions = khr::swapchain::Device::new(&inner.instance.raw, &inner.device);
        // SAFETY: all values are within the surface's capabilities; the old one is not in use, and goes after the call.
        let handle = unsafe { functions.create_swapchain(&create, None) };
        drop(old);
        let handle = handle.map_err(device.failed("the window's images"))?;
        let mut swapchain = Swapchain { device: device.clone(), functions, handle, images: Vec::new(), extent };
        // SAFETY: the swapchain is alive; `swapchain` destroys what was made before a failure.
        unsafe {
            let images =
                swapchain.functions.get_swapchain_images(handle).map_err(device.failed("the window's images"))?;
            for image in images {
                swapchain.images.push(WindowImage { image, ..WindowImage::default() });
                // One was pushed.
                let Some(made) = swapchain.images.last_mut() else { continue };
                let view = vk::ImageViewCreateInfo::default()
                    .image(image)
                    .view_type(vk::ImageViewType::TYPE_2D)
                    .format(format.surface.format)
                    .subresource_range(WHOLE_IMAGE);
                made.view =
                    inner.device.create_image_view(&view, None).map_err(device.failed("a view of the window"))?;
                let views = [made.view];
                let framebuffer = vk::FramebufferCreateInfo::default()
                    .render_pass(format.render_pass)
                    .attachments(&views)
                    .width(extent.width)
                    .height(extent.height)
                    .layers(1);
                made.framebuffer = inner
                    .device
                    .create_framebuffer(&framebuffer, None)
                    .map_err(device.failed("a framebuffer of the window"))?;
                made.drawn = inner
                    .device
                    .create_semaphore(&vk::SemaphoreCreateInfo::default(), None)
                    .map_err(device.failed("a semaphore of the window"))?;
            }
        }
        Ok(Some(swapchain))
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        // SAFETY: the presenter has waited for the queue before it drops a swapchain. Null handles are ignored.
        unsafe {
            for image in &self.images {
                self.device.device().destroy_semaphore(image.drawn, None);
                self.device.device().destroy_framebuffer(image.framebuffer, None);
                self.device.device().destroy_image_view(image.view, None);
            }
            self.functions.destroy_swapchain(self.handle, None);
        }
    }
}
