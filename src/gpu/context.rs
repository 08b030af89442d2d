//! A device to compute on, our own or a host's.

use std::cmp::Reverse;
use std::collections::HashMap;
use std::ffi::CString;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ash::{ext, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationSizes, AllocatorDebugSettings};
use rayon::prelude::*;

use super::cache::PipelineCache;
use super::compile_ahead::compile_ahead;
use super::device::{DeviceChoice, DeviceInfo, compute_family, enumerate};
use super::instance::{Instance, Messages, vulkan};
use super::kernel::Kernel;
use super::recorder::{Recorder, Retained};
use super::timers::Timers;
use super::usage::{MemoryUse, Usage};
use crate::error::{Error, Result};

/// Time for one submission: on a processor the largest pass of a large scene takes minutes.
const TIMEOUT_SECONDS: u64 = 3600;

/// How to make a [`Context`].
#[derive(Clone, Debug, Default)]
pub struct ContextOptions {
    /// Which device. Default: the fastest kind there is. A host's device is not chosen again.
    pub device: DeviceChoice,
    /// Enable the Khronos validation layer with its synchronisation checks and collect its messages. Default false.
    /// On a host's device: the host's instance has VK_EXT_debug_utils enabled, so collect messages and name objects.
    pub validation: bool,
    /// Run the kernels that restrict every index to its array. Default false: they are slower.
    pub checked_shaders: bool,
    /// Take arrays as storage buffers on every device, as on graphics cards.
    pub no_texel_buffers: bool,
    /// File that keeps compiled pipelines from run to run. Default none.
    pub pipeline_cache: Option<PathBuf>,
    /// Bytes that buffers and images may take. Default: the device's memory, and on a processor no more than what is free; without limit on
    /// a host's device.
    pub max_memory: Option<u64>,
    /// On a host's device: this library may do work of its own, where a method says that it reads back or measures
    /// ([`Film::mean`](crate::film::Film::mean), [`super::download`], [`crate::calibrate`]). It then submits to the host's queue, on the
    /// thread that calls the method, and waits; kernels are compiled ahead. The host uses the queue on no other thread meanwhile. Default
    /// false: nothing is ever submitted, and these methods are refused.
    pub own_work: bool,
}

/// Vulkan handles of a host. The host keeps ownership: they are not destroyed here, and nothing is submitted to the queue
/// or waited for, unless [`ContextOptions::own_work`] allows it.
pub struct HostDevice {
    /// The loader.
    pub entry: ash::Entry,
    /// The instance; it asked for Vulkan 1.1 or later.
    pub instance: ash::Instance,
    /// The physical device; see [`super::Requirements::check`].
    pub physical_device: vk::PhysicalDevice,
    /// The device.
    pub device: ash::Device,
    /// Family, with compute, of the queue that recorded command buffers will be submitted to.
    pub queue_family: u32,
    /// That queue.
    pub queue: vk::Queue,
}

/// A device to compute on. Clones share it; it goes when the last object made from it is gone.
#[derive(Clone)]
pub struct Context {
    pub(super) inner: Arc<Inner>,
    /// Kernels by the addresses of their shaders. Beside `inner`, which every kernel holds.
    kernels: Arc<Mutex<HashMap<usize, Kernel>>>,
    /// Memory of the buffers and images.
    usage: Arc<Mutex<Usage>>,
    /// Whether buffers and images are counted and have no memory.
    measures: bool,
}

/// Fields are dropped in this order: what stands on the device, the device, the instance, the lender.
pub(super) struct Inner {
    allocator: Mutex<Allocator>,
    pub cache: PipelineCache,
    pub debug: Option<ext::debug_utils::Device>,
    /// Whether command buffers get labels. Not under the validation layer: that of 1.3.239 crashed once in
    /// what seems to be its table of labels; the cause has not been found, and the crash was not seen again.
    pub labels: bool,
    pub device: Device,
    pub info: DeviceInfo,
    pub checked_shaders: bool,
    /// Whether we may submit: on our own device, and on a host's that allows it.
    pub own_work: bool,
    pub physical: vk::PhysicalDevice,
    /// Bits of a timestamp that count; 0 without timestamps.
    pub timestamp_bits: u32,
    queue_family: u32,
    /// Vulkan wants one thread at a time on a queue.
    queue: Arc<Mutex<vk::Queue>>,
    pub instance: Instance,
    /// Keeps a lent device.
    _lender: Option<Arc<dyn Send + Sync>>,
}

/// A device that is destroyed with its owner if it is our own.
pub(super) struct Device {
    pub raw: ash::Device,
    owned: bool,
}

impl Drop for Device {
    fn drop(&mut self) {
        if self.owned {
            // SAFETY: created by us; all that was made from it has been dropped before (order of `Inner`'s fields), and
            // every submission has been waited for. A wait that fails (device lost) changes nothing about that.
            unsafe {
                let _ = self.raw.device_wait_idle();
                self.raw.destroy_device(None);
            }
        }
    }
}

impl Context {
    /// A device of our own, without a window.
    pub fn headless(options: &ContextOptions) -> Result<Context> {
        let instance = Instance::create(options.validation)?;
        let (handles, infos): (Vec<_>, Vec<_>) = enumerate(&instance)?.into_iter().unzip();
        let index = options.device.pick(&infos)?;
        let physical = handles[index]; // `pick` returns an index of the list it was given.
        // SAFETY: the handle comes from this instance.
        let family = unsafe { compute_family(&instance.raw, physical) };
        let (queue_family, _) = family.ok_or_else(|| Error::NoDevice("the device has no compute queue".into()))?;
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(queue_family).queue_priorities(&[1.0])];
        let create = vk::DeviceCreateInfo::default().queue_create_infos(&queues);
        // SAFETY: the physical device and the family are valid; no extension or feature is asked for.
        let raw = unsafe { instance.raw.create_device(physical, &create, None) }.map_err(vulkan("vkCreateDevice"))?;
        let device = Device { raw, owned: true };
        // SAFETY: one queue of this family was created with the device.
        let queue = unsafe { device.raw.get_device_queue(queue_family, 0) };
        let queue = Arc::new(Mutex::new(queue));
        // SAFETY: all handles belong together.
        unsafe { Context::assemble(instance, physical, device, (queue_family, queue, None), index, options) }
    }

    /// Stands on a host's device.
    ///
    /// # Safety
    /// The handles are valid, belong together and outlive the context and all objects made from it; the instance asked
    /// for Vulkan 1.1 or later and [`super::Requirements::check`] found nothing missing; with `options.validation` the
    /// instance has VK_EXT_debug_utils enabled.
    pub unsafe fn adopt(host: HostDevice, options: &ContextOptions) -> Result<Context> {
        let queue = Arc::new(Mutex::new(host.queue));
        // SAFETY: the caller's promise.
        unsafe { Context::adopt_from(host, queue, None, options) }
    }

    /// The same; `queue` is locked by all who use the host's queue, and the context keeps `lender`.
    ///
    /// # Safety
    /// As for [`Context::adopt`], but that `lender` may be what keeps the handles valid.
    pub(super) unsafe fn adopt_from(
        host: HostDevice,
        queue: Arc<Mutex<vk::Queue>>,
        lender: Option<Arc<dyn Send + Sync>>,
        options: &ContextOptions,
    ) -> Result<Context> {
        // SAFETY: the caller's promise.
        unsafe {
            let index = match host.instance.enumerate_physical_devices() {
                Ok(list) => list.iter().position(|other| *other == host.physical_device).unwrap_or(0),
                Err(result) => return Err(vulkan("vkEnumeratePhysicalDevices")(result)),
            };
            let instance = Instance::adopt(host.entry, host.instance, options.validation)?;
            let device = Device { raw: host.device, owned: false };
            let queue = (host.queue_family, queue, lender);
            Context::assemble(instance, host.physical_device, device, queue, index, options)
        }
    }

    /// # Safety
    /// The handles are valid and belong together.
    unsafe fn assemble(
        instance: Instance,
        physical: vk::PhysicalDevice,
        device: Device,
        (queue_family, queue, lender): (u32, Arc<Mutex<vk::Queue>>, Option<Arc<dyn Send + Sync>>),
        index: usize,
        options: &ContextOptions,
    ) -> Result<Context> {
        const MIB: u64 = 1 << 20;
        // SAFETY: the caller's promise.
        let (mut info, families) = unsafe {
            (
                DeviceInfo::query(&instance.raw, physical, index),
                instance.raw.get_physical_device_queue_family_properties(physical),
            )
        };
        let family = families.get(queue_family as usize);
        if !info.missing.is_empty() || !family.is_some_and(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE)) {
            let lacks =
                if info.missing.is_empty() { "compute on this queue".into() } else { info.missing.join(" and ") };
            return Err(Error::NoDevice(format!("device {} lacks {lacks}", info.name)));
        }
        let timestamp_bits = family.map_or(0, |f| f.timestamp_valid_bits);
        info.timestamps = timestamp_bits > 0;
        // Kernels with bounds checks restrict the indices of arrays.
        info.texel_buffers &= !options.no_texel_buffers && !options.checked_shaders;
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw.clone(),
            device: device.raw.clone(),
            physical_device: physical,
            debug_settings: AllocatorDebugSettings::default(),
            buffer_device_address: false,
            // Small blocks first: a processor's memory is the host's, and a test needs little of it.
            allocation_sizes: AllocationSizes::new(8 * MIB, 8 * MIB)
                .with_max_device_memblock_size(256 * MIB)
                .with_max_host_memblock_size(64 * MIB),
        })
        .map_err(|e| Error::NoDevice(format!("device {}: {e}", info.name)))?;
        // SAFETY: the cache is dropped before the device (order of `Inner`'s fields).
        let cache = unsafe { PipelineCache::load(device.raw.clone(), &info, options.pipeline_cache.clone()) }?;
        let debug = instance.debug_utils.then(|| ext::debug_utils::Device::new(&instance.raw, &device.raw));
        let own_work = device.owned || options.own_work;
        let unified = info.is_unified();
        let limit = options.max_memory.unwrap_or(if device.owned { info.free_memory() } else { u64::MAX });
        let inner = Inner {
            allocator: Mutex::new(allocator),
            cache,
            debug,
            labels: !options.validation,
            device,
            info,
            checked_shaders: options.checked_shaders,
            own_work,
            physical,
            timestamp_bits,
            queue_family,
            queue,
            instance,
            _lender: lender,
        };
        let usage = Arc::new(Mutex::new(Usage::new(limit, unified)));
        Ok(Context { inner: Arc::new(inner), kernels: Arc::default(), usage, measures: false })
    }

    /// The same device for finding out how much memory objects need: the buffers and images that are made from it are counted apart
    /// ([`Context::memory_use`]) and have no memory, kernels are not bound to them, and nothing is submitted.
    pub(crate) fn measuring(&self) -> Context {
        let usage = Arc::new(Mutex::new(Usage::new(u64::MAX, self.info().is_unified())));
        Context { inner: self.inner.clone(), kernels: self.kernels.clone(), usage, measures: true }
    }

    /// Whether it is a [`Context::measuring`].
    pub(super) fn measures(&self) -> bool {
        self.measures
    }

    /// Memory of the buffers and images of this context.
    pub fn memory_use(&self) -> MemoryUse {
        self.usage().use_of_all()
    }

    pub(super) fn usage(&self) -> MutexGuard<'_, Usage> {
        // Sums are sound whatever thread left them.
        self.usage.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The device and its limits.
    pub fn info(&self) -> &DeviceInfo {
        &self.inner.info
    }

    /// The device is a host's.
    pub fn is_adopted(&self) -> bool {
        !self.inner.device.owned
    }

    /// Bytes of memory in use by buffers and images of this context: 0 once all of them are gone.
    pub fn allocated_bytes(&self) -> u64 {
        self.allocator().generate_report().total_allocated_bytes
    }

    /// Takes the validation layer's messages since the last call; empty without validation.
    pub fn take_messages(&self) -> Vec<String> {
        self.inner.instance.messages.take()
    }

    /// The list of messages itself, which outlives the context: leaks are reported while it goes.
    pub fn messages(&self) -> Messages {
        self.inner.instance.messages.clone()
    }

    /// Records commands, submits them to our own queue and waits until they are done. Writes of earlier submissions are
    /// visible to the commands, and their writes are visible to the host and to later submissions.
    ///
    /// `what` names the work in errors. Refused on a host's device, which submits its command buffers itself, unless
    /// [`ContextOptions::own_work`] allows it.
    pub fn submit_and_wait(
        &self,
        what: &str,
        timers: Option<&Timers>,
        record: impl FnOnce(&mut Recorder<'_>) -> Result<()>,
    ) -> Result<()> {
        self.submit(what, timers, None, record).map(drop)
    }

    /// The same in parts: before each but the first `stop` is asked whether to break off. Returns whether all was done; commands after
    /// [`Recorder::last_part`] are done as a whole or not at all.
    pub fn submit_unless(
        &self,
        what: &str,
        timers: Option<&Timers>,
        stop: &dyn Fn() -> bool,
        record: impl FnOnce(&mut Recorder<'_>) -> Result<()>,
    ) -> Result<bool> {
        self.submit(what, timers, Some(stop), record)
    }

    fn submit(
        &self,
        what: &str,
        timers: Option<&Timers>,
        stop: Option<&dyn Fn() -> bool>,
        record: impl FnOnce(&mut Recorder<'_>) -> Result<()>,
    ) -> Result<bool> {
        if !self.inner.own_work {
            return Err(Error::Resource {
                name: what.to_owned(),
                message:
                    "the device is the host's, which submits its own command buffers; record into one of them, or set \
                          ContextOptions::own_work"
                        .into(),
            });
        }
        if timers.is_some_and(|timers| !timers.belongs_to(self)) {
            return Err(Error::Resource {
                name: what.to_owned(),
                message: "the timers belong to another context".into(),
            });
        }
        if self.measures {
            return Ok(true);
        }
        let _turn = timers.map(|timers| timers.take_turn(what)).transpose()?;
        let submission = Submission::new(self, what)?;
        let device = self.device();
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the command buffer is new and this thread's alone.
        unsafe { device.begin_command_buffer(submission.commands, &begin) }.map_err(|r| self.failed(what, r))?;
        // SAFETY: it is recording, on our own queue family; the retained objects are held until the wait is over.
        let mut recorder = unsafe { Recorder::new(self, submission.commands, timers) };
        if stop.is_some() {
            // SAFETY: the pool is the submission's alone.
            recorder = unsafe { recorder.in_parts(submission.pool) };
        }
        recorder.begin();
        record(&mut recorder)?;
        recorder.end();
        let (parts, retained) = recorder.finish_parts().map_err(|r| self.failed(what, r))?;
        for (i, part) in parts.into_iter().enumerate() {
            if i > 0 && stop.is_some_and(|stop| stop()) {
                return Ok(false);
            }
            // SAFETY: as above; the command buffer is complete and submitted once, the queue is locked meanwhile, and the fence is not in
            // use: the part before was waited for.
            unsafe {
                if i > 0 {
                    device.reset_fences(&[submission.fence]).map_err(|r| self.failed(what, r))?;
                }
                let commands = [part];
                let submit = [vk::SubmitInfo::default().command_buffers(&commands)];
                let queue = self.inner.queue.lock().unwrap_or_else(PoisonError::into_inner);
                device.queue_submit(*queue, &submit, submission.fence).map_err(|r| self.failed(what, r))?;
                drop(queue);
                let waited = device.wait_for_fences(&[submission.fence], true, TIMEOUT_SECONDS * 1_000_000_000);
                if let Err(result) = waited {
                    // A lost device, lack of memory, or a hang, after which this waits for ever too, unless the driver resets the
                    // device. Nothing may be destroyed that still runs.
                    if result == vk::Result::TIMEOUT {
                        log::warn!("{}; waiting for the driver to reset the device", self.failed(what, result));
                    }
                    let _ = device.device_wait_idle();
                    return Err(self.failed(what, result));
                }
            }
        }
        drop(retained);
        Ok(true)
    }

    /// Records into a host's command buffer; the returned object keeps alive the resources of the commands.
    ///
    /// After an error nothing is kept alive: end or reset the command buffer, but do not submit it.
    ///
    /// # Safety
    /// As for [`Recorder::new`]: the command buffer is recording outside a render pass, was allocated on this device
    /// for a family with compute, and is used by nobody else meanwhile; the timers are of this context and time no other
    /// commands until these have been executed. The returned object is kept until the commands have been executed or the command buffer has been reset.
    pub unsafe fn record_into(
        &self,
        commands: vk::CommandBuffer,
        timers: Option<&Timers>,
        record: impl FnOnce(&mut Recorder<'_>) -> Result<()>,
    ) -> Result<Retained> {
        // SAFETY: the caller's promise.
        let mut recorder = unsafe { Recorder::new(self, commands, timers) };
        record(&mut recorder)?;
        Ok(recorder.finish())
    }

    /// The error for a failed call while `what` was made or run.
    pub(super) fn failed(&self, what: &str, result: vk::Result) -> Error {
        match result {
            vk::Result::TIMEOUT => Error::Timeout { during: what.to_owned(), seconds: TIMEOUT_SECONDS },
            result => vulkan(what)(result),
        }
    }

    /// Makes the pipelines of all kernels so far, on all cores: drivers spend milliseconds on each, and the kernels of a
    /// frame are many. Errors: the first failure, kernels with much code before those with little.
    pub fn make_pipelines(&self) -> Result<()> {
        if self.measures {
            return Ok(());
        }
        let mut kernels: Vec<_> =
            self.kernels().values().map(|kernel| (kernel.waiting_bytes(), kernel.clone())).collect();
        kernels.retain(|(bytes, _)| *bytes > 0);
        // The longest work first, so that no core waits for it in the end.
        kernels.sort_by_key(|(bytes, kernel)| (Reverse(*bytes), kernel.name()));
        let made: Vec<_> = kernels.par_iter().with_max_len(1).map(|(_, kernel)| kernel.pipeline().map(drop)).collect();
        made.into_iter().collect()
    }

    /// Compiles the kernels so far on all cores, with a driver that would compile them one by one when they first run (lavapipe),
    /// unless the list beside the pipeline cache has them. Returns the number of those compiled. Without a file of the pipeline cache,
    /// and on a host's device that does not allow [`ContextOptions::own_work`], it does nothing.
    pub fn compile_ahead(&self) -> Result<usize> {
        if self.measures {
            return Ok(0);
        }
        let mut kernels: Vec<_> = self.kernels().values().map(Kernel::shader).collect();
        kernels.sort_by_key(|shader| (Reverse(shader.spirv.len()), shader.name));
        compile_ahead(self, kernels)
    }

    pub(super) fn pipeline_cache_path(&self) -> Option<&Path> {
        self.inner.cache.path()
    }

    /// Pipelines made so far and kept.
    pub fn pipeline_count(&self) -> usize {
        self.kernels().values().filter(|kernel| kernel.is_made()).count()
    }

    pub(super) fn kernels(&self) -> MutexGuard<'_, HashMap<usize, Kernel>> {
        // A map of complete entries is sound whatever thread left it.
        self.kernels.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The same device for a kernel, which must not hold the table that holds it.
    pub(super) fn without_kernels(&self) -> Context {
        Context { kernels: Arc::default(), ..self.clone() }
    }

    /// The device, for calls of the caller's own.
    pub fn raw_device(&self) -> &ash::Device {
        &self.inner.device.raw
    }

    pub(super) fn device(&self) -> &ash::Device {
        &self.inner.device.raw
    }

    pub(super) fn allocator(&self) -> MutexGuard<'_, Allocator> {
        // The allocator's state is sound between its calls, which do not panic; poison comes from elsewhere.
        self.inner.allocator.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Names an object for debuggers and for the layer's messages.
    pub(super) fn name<H: vk::Handle>(&self, handle: H, name: &str) {
        if let (Some(debug), Ok(name)) = (&self.inner.debug, CString::new(name)) {
            let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(handle).object_name(&name);
            // SAFETY: the extension is enabled, the handle is alive. A name that is refused is no loss.
            let _ = unsafe { debug.set_debug_utils_object_name(&info) };
        }
    }
}

/// A command buffer for one submission, its pool and its fence.
struct Submission<'a> {
    ctx: &'a Context,
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    fence: vk::Fence,
}

impl<'a> Submission<'a> {
    fn new(ctx: &'a Context, what: &str) -> Result<Submission<'a>> {
        let device = ctx.device();
        let mut submission = Submission {
            ctx,
            pool: vk::CommandPool::null(),
            commands: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
        };
        let pool = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::TRANSIENT)
            .queue_family_index(ctx.inner.queue_family);
        // SAFETY: plain creations on a live device; `drop` destroys what was made before a failure.
        unsafe {
            submission.pool = device.create_command_pool(&pool, None).map_err(|r| ctx.failed(what, r))?;
            submission.fence =
                device.create_fence(&vk::FenceCreateInfo::default(), None).map_err(|r| ctx.failed(what, r))?;
            let allocate = vk::CommandBufferAllocateInfo::default()
                .command_pool(submission.pool)
                .level(vk::CommandBufferLevel::PRIMARY)
                .command_buffer_count(1);
            submission.commands =
                device.allocate_command_buffers(&allocate).map_err(|r| ctx.failed(what, r))?.swap_remove(0);
        }
        ctx.name(submission.commands, what);
        ctx.name(submission.fence, what);
        Ok(submission)
    }
}

impl Drop for Submission<'_> {
    fn drop(&mut self) {
        // SAFETY: nothing of this is in use any more: it was waited for, or never submitted. Null handles are ignored.
        unsafe {
            self.ctx.device().destroy_fence(self.fence, None);
            self.ctx.device().destroy_command_pool(self.pool, None);
        }
    }
}
