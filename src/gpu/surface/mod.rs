//! A window's device and its images: what a program needs to show the engine's images beside its own drawing.
//!
//! [`WindowDevice`] is a host like any other: it makes instance, device and queue as [`super::Requirements`] say, with what a window needs
//! besides, and lends them ([`WindowDevice::lend`]) to a [`Context`], whose engine records into the command buffers of a [`Presenter`].
//! One frame is in flight at a time: what it read back, and its timers, may be read when [`Presenter::is_idle`] says so.

mod presenter;
mod swapchain;

pub use presenter::{Canvas, Outcome, Presenter, Shown};

use std::ffi::CStr;
use std::sync::{Arc, Mutex, PoisonError};

use ash::{khr, vk};
use raw_window_handle::{HasDisplayHandle, HasWindowHandle, RawDisplayHandle};

use super::context::{Context, ContextOptions, HostDevice};
use super::device::{DeviceChoice, DeviceInfo, Requirements, enumerate};
use super::instance::{Instance, Messages, vulkan};
use crate::error::{Error, Result};

/// A window that images are shown in, and its connection to the display.
pub trait Window: HasWindowHandle + HasDisplayHandle + Send + Sync + 'static {}

impl<W: HasWindowHandle + HasDisplayHandle + Send + Sync + 'static> Window for W {}

/// Instance, device and surface of a window. Clones share them; contexts that it lends keep them.
#[derive(Clone)]
pub struct WindowDevice(Arc<Inner>);

struct Inner {
    device: ash::Device,
    physical: vk::PhysicalDevice,
    info: DeviceInfo,
    family: u32,
    /// Shared with lent contexts: one thread at a time uses the queue.
    queue: Arc<Mutex<vk::Queue>>,
    /// For uploads of the program's own.
    pool: vk::CommandPool,
    surface_functions: khr::surface::Instance,
    surface: vk::SurfaceKHR,
    // Dropped after `drop` below, in this order.
    instance: Instance,
    _window: Arc<dyn Window>,
}

/// A surface that goes with its owner, until a device takes it over.
struct NewSurface<'a> {
    functions: &'a khr::surface::Instance,
    handle: vk::SurfaceKHR,
}

impl Drop for NewSurface<'_> {
    fn drop(&mut self) {
        // SAFETY: made from the instance of `functions`, and nothing was made from it. Null is ignored.
        unsafe { self.functions.destroy_surface(self.handle, None) };
    }
}

impl WindowDevice {
    /// Opens a device that can compute, draw, and show images in the window. `validation`: under the Khronos layer.
    ///
    /// Errors: there is no such device; a driver or layer is missing.
    pub fn new(window: Arc<dyn Window>, choice: &DeviceChoice, validation: bool) -> Result<WindowDevice> {
        let no_window = |error| Error::NoDevice(format!("the window has no handle: {error}"));
        let (display, handle) =
            (window.display_handle().map_err(no_window)?.as_raw(), window.window_handle().map_err(no_window)?.as_raw());
        let instance = Instance::with_extensions(validation, &surface_extensions(display)?)?;
        let functions = khr::surface::Instance::new(&instance.entry, &instance.raw);
        // SAFETY: the extensions of the display are enabled; `Inner` keeps the window longer than the surface.
        let surface = unsafe { ash_window::create_surface(&instance.entry, &instance.raw, display, handle, None) };
        let surface = surface.map_err(vulkan("the window's surface"))?;
        let mut surface = NewSurface { functions: &functions, handle: surface };

        let (handles, mut infos): (Vec<_>, Vec<_>) = enumerate(&instance)?.into_iter().unzip();
        let mut families = Vec::new();
        for (&physical, info) in handles.iter().zip(&mut infos) {
            let family = family(&instance, &surface, physical)?;
            if family.is_none() && info.missing.is_empty() {
                info.missing.push(String::from("a queue that computes, draws and shows images in this window"));
            }
            families.push(family);
        }
        let index = choice.pick(&infos)?;
        // `pick` returns an index of the list it was given, and only devices that lack nothing.
        let (physical, info) = (handles[index], infos.swap_remove(index));
        let family = families[index].ok_or_else(|| Error::NoDevice(format!("device {} shows no images", info.name)))?;
        // SAFETY: the physical device is that of the instance, which is that of the entry.
        let requirements = unsafe { Requirements::check(&instance.entry, &instance.raw, physical) };
        let mut extensions = vec![khr::swapchain::NAME];
        requirements.add_to(&mut extensions);
        let extensions: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
        let create = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&extensions)
            .enabled_features(&requirements.features);
        // SAFETY: the device has the family and, since it shows images, the extension; the rest was checked.
        let device = unsafe { instance.raw.create_device(physical, &create, None) };
        let device = device.map_err(vulkan("vkCreateDevice"))?;
        // SAFETY: one queue of this family was created with the device.
        let queue = unsafe { device.get_device_queue(family, 0) };
        let mut inner = Inner {
            device,
            physical,
            info,
            family,
            queue: Arc::new(Mutex::new(queue)),
            pool: vk::CommandPool::null(),
            surface: std::mem::take(&mut surface.handle),
            surface_functions: functions.clone(),
            instance,
            _window: window,
        };
        let create = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::TRANSIENT)
            .queue_family_index(family);
        // SAFETY: a plain creation on a live device, which `inner` destroys with it.
        inner.pool = unsafe { inner.device.create_command_pool(&create, None) }.map_err(vulkan("a command pool"))?;
        Ok(WindowDevice(Arc::new(inner)))
    }

    /// Lends the device to lightsum; the context keeps it. Validation is the device's own, see [`WindowDevice::take_messages`].
    pub fn lend(&self, options: &ContextOptions) -> Result<Context> {
        let inner = &self.0;
        let lent = HostDevice {
            entry: inner.instance.entry.clone(),
            instance: inner.instance.raw.clone(),
            physical_device: inner.physical,
            device: inner.device.clone(),
            queue_family: inner.family,
            queue: *self.queue(),
        };
        let options = ContextOptions { validation: false, ..options.clone() };
        // SAFETY: the handles belong together, the device was made as required, and the context keeps the lender.
        unsafe { Context::adopt_from(lent, inner.queue.clone(), Some(inner.clone()), &options) }
    }

    /// The device and its limits.
    pub fn info(&self) -> &DeviceInfo {
        &self.0.info
    }

    /// The device.
    pub fn device(&self) -> &ash::Device {
        &self.0.device
    }

    /// The instance.
    pub fn instance(&self) -> &ash::Instance {
        &self.0.instance.raw
    }

    /// The physical device.
    pub fn physical(&self) -> vk::PhysicalDevice {
        self.0.physical
    }

    /// Hands out the queue, and a pool of command buffers of its family, for uploads of the program's own. Nobody else uses the queue
    /// meanwhile.
    pub fn with_queue<R>(&self, upload: impl FnOnce(vk::Queue, vk::CommandPool) -> R) -> R {
        upload(*self.queue(), self.0.pool)
    }

    /// The validation layer's messages since the last call; empty without validation.
    pub fn take_messages(&self) -> Vec<String> {
        self.0.instance.messages.take()
    }

    /// The list of messages itself, which outlives the device: leaks are reported while it goes.
    pub fn messages(&self) -> Messages {
        self.0.instance.messages.clone()
    }

    fn queue(&self) -> std::sync::MutexGuard<'_, vk::Queue> {
        // A handle is whole whatever thread left it.
        self.0.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn failed(&self, what: &str) -> impl FnOnce(vk::Result) -> Error + use<> {
        vulkan(what)
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        // SAFETY: contexts and presenters hold this, so all that was made from device and surface is gone. A lost device has no work left.
        unsafe {
            let _ = self.device.device_wait_idle();
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
            self.surface_functions.destroy_surface(self.surface, None);
        }
    }
}

/// The instance extensions for surfaces of this display.
fn surface_extensions(display: RawDisplayHandle) -> Result<Vec<&'static CStr>> {
    let names = ash_window::enumerate_required_extensions(display).map_err(vulkan("surfaces of this display"))?;
    // SAFETY: the names are constants of ash, which end in 0.
    Ok(names.iter().map(|&name| unsafe { CStr::from_ptr(name) }).collect())
}

/// A queue family that computes, draws and shows images in the window; `None`: there is none, or no swapchain.
fn family(instance: &Instance, surface: &NewSurface, physical: vk::PhysicalDevice) -> Result<Option<u32>> {
    // SAFETY: the physical device is that of the instance, like the surface.
    let (extensions, families) = unsafe {
        (
            instance.raw.enumerate_device_extension_properties(physical).unwrap_or_default(),
            instance.raw.get_physical_device_queue_family_properties(physical),
        )
    };
    if !extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(khr::swapchain::NAME)) {
        return Ok(None);
    }
    let wanted = vk::QueueFlags::COMPUTE | vk::QueueFlags::GRAPHICS;
    for (index, _) in (0..).zip(&families).filter(|(_, family)| family.queue_flags.contains(wanted)) {
        // SAFETY: as above; the family exists.
        let shows = unsafe { surface.functions.get_physical_device_surface_support(physical, index, surface.handle) };
        if shows.map_err(vulkan("vkGetPhysicalDeviceSurfaceSupportKHR"))? {
            return Ok(Some(index));
        }
    }
    Ok(None)
}
