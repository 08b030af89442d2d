//! Images with their memory: ours, and those of a host.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;

use super::context::Context;
use super::memory::{Memory, allocate, failed, release, within};
use crate::error::{Error, Result};

/// A two-dimensional image, kept in the layout GENERAL: one to store to, copied from and sampled as well, or an array of layers that
/// is copied to and read. Clones share it.
#[derive(Clone)]
pub struct Image(pub(super) Arc<ImageInner>);

pub(super) struct ImageInner {
    ctx: Context,
    name: String,
    width: u32,
    height: u32,
    /// `None`: it is no array.
    layers: Option<u32>,
    format: vk::Format,
    texel_bytes: u64,
    handle: vk::Image,
    /// Null if the context measures.
    view: vk::ImageView,
    /// Whether the image itself belongs to the host.
    adopted: bool,
    /// Whether it is only read.
    read_only: bool,
    /// None if the context measures, of the host's images, and while dropping.
    allocation: Option<Allocation>,
    /// Bytes in the context's sums.
    counted: u64,
}

/// The greatest images with layers of R8G8B8A8_UNORM on a device.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayerLimits {
    /// Maximum width and height.
    pub size: [u32; 2],
    /// Maximum number of layers.
    pub layers: u32,
    /// Maximum bytes of one image.
    pub bytes: u64,
}

/// An image that a host lends.
#[derive(Clone, Copy, Debug)]
pub struct HostImage {
    /// Its handle.
    pub handle: vk::Image,
    /// Its format.
    pub format: vk::Format,
    /// Width and height of its first level.
    pub size: [u32; 2],
    /// The usage that it was made with.
    pub usage: vk::ImageUsageFlags,
}

/// Bytes of a texel of an image. Errors: images do not have the format.
fn texel_bytes(name: &str, format: vk::Format) -> Result<u64> {
    match format {
        vk::Format::R32G32B32A32_SFLOAT | vk::Format::R32G32B32A32_UINT => Ok(16),
        vk::Format::R32G32_SFLOAT | vk::Format::R32G32_UINT | vk::Format::R16G16B16A16_SFLOAT => Ok(8),
        vk::Format::R32_SFLOAT | vk::Format::R32_UINT | vk::Format::R8G8B8A8_UNORM => Ok(4),
        _ => Err(Error::Resource {
            name: name.to_owned(),
            message: format!("{format:?} is none of the formats that images may have"),
        }),
    }
}

const STORED: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::STORAGE.as_raw()
        | vk::ImageUsageFlags::TRANSFER_SRC.as_raw()
        | vk::ImageUsageFlags::SAMPLED.as_raw(),
);
const LAYERED: vk::ImageUsageFlags =
    vk::ImageUsageFlags::from_raw(vk::ImageUsageFlags::TRANSFER_DST.as_raw() | vk::ImageUsageFlags::SAMPLED.as_raw());

/// Limits of images of a format and usage.
fn limits_of(
    ctx: &Context,
    format: vk::Format,
    usage: vk::ImageUsageFlags,
) -> std::result::Result<vk::ImageFormatProperties, vk::Result> {
    // SAFETY: the physical device is that of the context.
    unsafe {
        ctx.inner.instance.raw.get_physical_device_image_format_properties(
            ctx.inner.physical,
            format,
            vk::ImageType::TYPE_2D,
            vk::ImageTiling::OPTIMAL,
            usage,
            vk::ImageCreateFlags::empty(),
        )
    }
}

impl Image {
    /// Allocates an image. Its content and layout are undefined until [`super::Recorder::image_to_general`].
    pub fn new(ctx: &Context, name: &str, width: u32, height: u32, format: vk::Format) -> Result<Image> {
        Image::make(ctx, name, [width, height], None, format)
    }

    /// Allocates an array of layers of R8G8B8A8_UNORM texels, within [`Image::layer_limits`]. Its content and layout are undefined
    /// until [`super::Recorder::image_to_general`].
    pub fn layered(ctx: &Context, name: &str, width: u32, height: u32, layers: u32) -> Result<Image> {
        Image::make(ctx, name, [width, height], Some(layers), vk::Format::R8G8B8A8_UNORM)
    }

    /// Limits of [`Image::layered`].
    pub fn layer_limits(ctx: &Context) -> Result<LayerLimits> {
        let most = limits_of(ctx, vk::Format::R8G8B8A8_UNORM, LAYERED).map_err(|r| ctx.failed("textures", r))?;
        Ok(LayerLimits {
            size: [most.max_extent.width, most.max_extent.height],
            layers: most.max_array_layers,
            bytes: most.max_resource_size.min(ctx.info().max_allocation),
        })
    }

    fn make(
        ctx: &Context,
        name: &str,
        [width, height]: [u32; 2],
        layers: Option<u32>,
        format: vk::Format,
    ) -> Result<Image> {
        let misuse = |message: String| Error::Resource { name: name.to_owned(), message };
        let texel_bytes = texel_bytes(name, format)?;
        if width == 0 || height == 0 || layers == Some(0) {
            return Err(misuse(format!("an image of {width}x{height} pixels and {layers:?} layers is empty")));
        }
        let usage = if layers.is_some() { LAYERED } else { STORED };
        let most = limits_of(ctx, format, usage).map_err(|r| match r {
            vk::Result::ERROR_FORMAT_NOT_SUPPORTED => {
                misuse(format!("the device cannot store to images of {format:?}"))
            }
            r => ctx.failed(name, r),
        })?;
        if width > most.max_extent.width || height > most.max_extent.height {
            return Err(misuse(format!(
                "{width}x{height} pixels exceed the device's {}x{}; lower the resolution",
                most.max_extent.width, most.max_extent.height
            )));
        }
        let count = layers.unwrap_or(1);
        if count > most.max_array_layers {
            return Err(misuse(format!("{count} layers exceed the device's {}", most.max_array_layers)));
        }
        let create = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width, height, depth: 1 })
            .mip_levels(1)
            .array_layers(count)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(usage)
            .initial_layout(vk::ImageLayout::UNDEFINED);
        let size = u64::from(width) * u64::from(height) * u64::from(count) * texel_bytes;
        within(name, size, most.max_resource_size, "maxResourceSize")?;
        let device = ctx.device();
        // SAFETY: the format, the extent, the layers and the size were checked; `inner` destroys it from here on.
        let handle = unsafe { device.create_image(&create, None) }.map_err(|r| failed(name, size, r))?;
        let mut inner = ImageInner {
            ctx: ctx.clone(),
            name: name.to_owned(),
            width,
            height,
            layers,
            format,
            texel_bytes,
            handle,
            view: vk::ImageView::null(),
            adopted: false,
            read_only: false,
            allocation: None,
            counted: 0,
        };
        // SAFETY: the handle is alive; the memory fits its requirements and is bound once, before the view is made.
        unsafe {
            let requirements = device.get_image_memory_requirements(handle);
            ctx.usage().take(name, requirements.size, Memory::Device)?;
            inner.counted = requirements.size;
            if ctx.measures() {
                return Ok(Image(Arc::new(inner)));
            }
            let allocation =
                inner.allocation.insert(allocate(ctx, name, requirements, MemoryLocation::GpuOnly, false)?);
            device
                .bind_image_memory(handle, allocation.memory(), allocation.offset())
                .map_err(|r| failed(name, size, r))?;
            inner.make_view(vk::ImageUsageFlags::empty())?;
        }
        ctx.name(handle, name);
        Ok(Image(Arc::new(inner)))
    }

    /// Takes a host's image, which stays the host's: it is stored to, by a view of our own.
    ///
    /// Errors: a format that images may not have; no usage STORAGE; an empty image; the device cannot store to it.
    ///
    /// # Safety
    /// The image belongs to the device of the context, is as described, has one sample and one layer at least, and has memory. It
    /// outlives all clones of the returned image, and what was recorded with them.
    pub unsafe fn adopt(ctx: &Context, name: &str, image: HostImage) -> Result<Image> {
        let texel_bytes = texel_bytes(name, image.format)?;
        // SAFETY: the caller's promise.
        unsafe { Image::of_host(ctx, name, image, vk::ImageUsageFlags::STORAGE, texel_bytes) }
    }

    /// Takes a host's image that is only read ([`crate::pass::g_buffer_read`]), of any format with colours or depths that can be sampled.
    ///
    /// Errors: no usage SAMPLED; an empty image; the device cannot read it.
    ///
    /// # Safety
    /// As for [`Image::adopt`].
    pub unsafe fn adopt_to_read(ctx: &Context, name: &str, image: HostImage) -> Result<Image> {
        // Nothing is copied from it.
        // SAFETY: the caller's promise.
        unsafe { Image::of_host(ctx, name, image, vk::ImageUsageFlags::SAMPLED, 0) }
    }

    /// Takes a host's image for one usage.
    ///
    /// # Safety
    /// As for [`Image::adopt`].
    unsafe fn of_host(
        ctx: &Context,
        name: &str,
        image: HostImage,
        wanted: vk::ImageUsageFlags,
        texel_bytes: u64,
    ) -> Result<Image> {
        let HostImage { handle, format, size: [width, height], usage } = image;
        let misuse = |message: String| Error::Resource { name: name.to_owned(), message };
        if width == 0 || height == 0 || handle == vk::Image::null() {
            return Err(misuse(format!("an image of {width}x{height} pixels, or none, holds nothing")));
        }
        if !usage.contains(wanted) {
            return Err(misuse(format!("has the usage {usage:?}; make it with {wanted:?}")));
        }
        let mut inner = ImageInner {
            ctx: ctx.clone(),
            name: name.to_owned(),
            width,
            height,
            layers: None,
            format,
            texel_bytes,
            handle,
            view: vk::ImageView::null(),
            adopted: true,
            read_only: !wanted.contains(vk::ImageUsageFlags::STORAGE),
            allocation: None,
            counted: 0,
        };
        // SAFETY: the caller promises that the image is alive, as described, and has memory.
        unsafe { inner.make_view(wanted)? };
        Ok(Image(Arc::new(inner)))
    }

    /// The image's name in messages.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Vulkan's handle.
    pub fn handle(&self) -> vk::Image {
        self.0.handle
    }

    /// A view of the whole image.
    pub fn view(&self) -> vk::ImageView {
        self.0.view
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.0.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.0.height
    }

    /// The format.
    pub fn format(&self) -> vk::Format {
        self.0.format
    }

    /// Number of its layers, 1 if it is no array.
    pub fn layers(&self) -> u32 {
        self.0.layers.unwrap_or(1)
    }

    /// Whether it is an array of layers.
    pub(super) fn is_layered(&self) -> bool {
        self.0.layers.is_some()
    }

    /// Whether it was adopted to be read.
    pub(super) fn is_read_only(&self) -> bool {
        self.0.read_only
    }

    /// Its one level and all layers.
    pub(super) fn whole(&self) -> vk::ImageSubresourceRange {
        self.0.whole()
    }

    /// Whether it has memory: not if its context measures.
    pub(super) fn is_backed(&self) -> bool {
        self.0.view != vk::ImageView::null()
    }

    /// Bytes of the image without padding, as [`super::Recorder::copy_image_to_buffer`] writes it.
    pub fn bytes(&self) -> u64 {
        u64::from(self.0.width) * u64::from(self.0.height) * u64::from(self.layers()) * self.0.texel_bytes
    }

    pub(super) fn belongs_to(&self, ctx: &Context) -> bool {
        Arc::ptr_eq(&self.0.ctx.inner, &ctx.inner)
    }
}

/// The one level and all layers of an [`Image`] of colours.
pub(super) const WHOLE_IMAGE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: vk::REMAINING_ARRAY_LAYERS,
};

impl ImageInner {
    fn whole(&self) -> vk::ImageSubresourceRange {
        let aspect_mask = match self.format {
            vk::Format::D16_UNORM | vk::Format::X8_D24_UNORM_PACK32 | vk::Format::D32_SFLOAT => {
                vk::ImageAspectFlags::DEPTH
            }
            _ => vk::ImageAspectFlags::COLOR,
        };
        vk::ImageSubresourceRange { aspect_mask, ..WHOLE_IMAGE }
    }

    /// Makes the view of the whole image. `usage`: that of the view alone; empty: that of the image.
    ///
    /// # Safety
    /// The image is alive and has memory.
    unsafe fn make_view(&mut self, usage: vk::ImageUsageFlags) -> Result<()> {
        let of_layers = self.layers.map(|_| vk::ImageViewType::TYPE_2D_ARRAY);
        let range = vk::ImageSubresourceRange { layer_count: self.layers.unwrap_or(1), ..self.whole() };
        let mut of_view = vk::ImageViewUsageCreateInfo::default().usage(usage);
        let mut create = vk::ImageViewCreateInfo::default()
            .image(self.handle)
            .view_type(of_layers.unwrap_or(vk::ImageViewType::TYPE_2D))
            .format(self.format)
            .subresource_range(range);
        if !usage.is_empty() {
            create = create.push_next(&mut of_view);
        }
        // SAFETY: the caller's promise; the view is destroyed with this.
        let made = unsafe { self.ctx.device().create_image_view(&create, None) };
        self.view = made.map_err(|r| failed(&self.name, u64::from(self.width) * u64::from(self.height), r))?;
        self.ctx.name(self.view, &self.name);
        Ok(())
    }
}

impl Drop for ImageInner {
    fn drop(&mut self) {
        // SAFETY: as for buffers; a view that was never made is null, which is ignored. Images of the host stay.
        unsafe {
            self.ctx.device().destroy_image_view(self.view, None);
            if !self.adopted {
                self.ctx.device().destroy_image(self.handle, None);
            }
        }
        self.ctx.usage().give_back(&self.name, self.counted, Memory::Device);
        release(&self.ctx, &self.name, self.allocation.take());
    }
}
