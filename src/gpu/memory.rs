//! Buffers with their memory.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ash::vk;
use bytemuck::Pod;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use gpu_allocator::{AllocationError, MemoryLocation};

use super::context::Context;
use crate::error::{Error, Result};

/// Memory of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// On the device, not visible to the host.
    Device,
    /// Written by the host, read by the device.
    Upload,
    /// Written by the device, read by the host.
    Readback,
}

/// A storage buffer that can be copied from and to and hold the arguments of indirect dispatches. Clones share it.
#[derive(Clone)]
pub struct Buffer(pub(super) Arc<BufferInner>);

pub(super) struct BufferInner {
    ctx: Context,
    name: String,
    bytes: u64,
    size: u64,
    memory: Memory,
    handle: vk::Buffer,
    /// None if the context measures, and while dropping.
    allocation: Option<Allocation>,
    /// Bytes in the context's sums.
    counted: u64,
    /// Recordings that use the buffer and are not given back yet, if the host sees it. Locked while the host reads or writes the memory,
    /// since clones may be used from several threads.
    recordings: Mutex<u32>,
}

/// The use of a buffer by commands, until they have been executed.
struct Recorded(Arc<BufferInner>);

impl Recorded {
    fn new(buffer: &Buffer) -> Recorded {
        *buffer.0.recordings.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        Recorded(buffer.0.clone())
    }
}

impl Drop for Recorded {
    fn drop(&mut self) {
        *self.0.recordings.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
    }
}

/// Bytes of a buffer that holds `size` bytes and is read as texels.
///
/// lavapipe (Mesa 22.3) compiles a kernel for each combination of properties of its texel buffers; by mistake these are whether the
/// buffer's size is a power of two and whether the second byte of the size is zero. So they never are.
fn capacity_of_texels(size: u64) -> u64 {
    let mut capacity = size.next_multiple_of(16);
    while capacity.is_power_of_two() || (capacity >> 8) & 0xff == 0 {
        capacity += 272;
    }
    capacity
}

impl Buffer {
    /// Allocates a buffer of `bytes` bytes (rounded up to 4 inside, and to 16 if there are none). The content is undefined.
    pub fn new(ctx: &Context, name: &str, bytes: u64, memory: Memory) -> Result<Buffer> {
        let info = ctx.info();
        let size = if bytes == 0 { 16 } else { bytes.next_multiple_of(4) };
        // Kernels never use host-mapped buffers as a whole; `Kernel::bind` checks every binding again.
        if memory == Memory::Device {
            within(name, size, info.max_storage_buffer_range, "maxStorageBufferRange")?;
        }
        within(name, size, info.max_allocation, "maxMemoryAllocationSize")?;
        let mut usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST
            | vk::BufferUsageFlags::INDIRECT_BUFFER;
        let mut capacity = size;
        if info.texel_buffers {
            usage |= vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER | vk::BufferUsageFlags::STORAGE_TEXEL_BUFFER;
            capacity = capacity_of_texels(size);
        }
        let create = vk::BufferCreateInfo::default().size(capacity).usage(usage);
        let device = ctx.device();
        // SAFETY: a plain creation on a live device; `inner` destroys it from here on.
        let handle = unsafe { device.create_buffer(&create, None) }.map_err(|r| failed(name, size, r))?;
        let mut inner = BufferInner {
            ctx: ctx.clone(),
            name: name.to_owned(),
            bytes,
            size,
            memory,
            handle,
            allocation: None,
            counted: 0,
            recordings: Mutex::new(0),
        };
        // SAFETY: the handle is alive; the memory fits its requirements and is bound once, at the offset it was given.
        unsafe {
            let requirements = device.get_buffer_memory_requirements(handle);
            let location = match memory {
                Memory::Device => MemoryLocation::GpuOnly,
                Memory::Upload => MemoryLocation::CpuToGpu,
                Memory::Readback => MemoryLocation::GpuToCpu,
            };
            ctx.usage().take(name, requirements.size, memory)?;
            inner.counted = requirements.size;
            if !ctx.measures() {
                let allocation = inner.allocation.insert(allocate(ctx, name, requirements, location, true)?);
                device
                    .bind_buffer_memory(handle, allocation.memory(), allocation.offset())
                    .map_err(|r| failed(name, size, r))?;
            }
        }
        ctx.name(handle, name);
        Ok(Buffer(Arc::new(inner)))
    }

    /// Requested size, bytes.
    pub fn bytes(&self) -> u64 {
        self.0.bytes
    }

    /// The buffer's name in messages.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Vulkan's handle.
    pub fn handle(&self) -> vk::Buffer {
        self.0.handle
    }

    /// Its memory.
    pub fn memory(&self) -> Memory {
        self.0.memory
    }

    /// Bytes of the Vulkan buffer: a multiple of 4, not 0.
    pub(super) fn size(&self) -> u64 {
        self.0.size
    }

    pub(super) fn belongs_to(&self, ctx: &Context) -> bool {
        Arc::ptr_eq(&self.0.ctx.inner, &ctx.inner)
    }

    pub(super) fn misuse(&self, message: String) -> Error {
        Error::Resource { name: self.0.name.clone(), message }
    }

    /// Checks that `offset..offset + bytes` lies inside.
    pub(super) fn check_range(&self, offset: u64, bytes: u64) -> Result<()> {
        match offset.checked_add(bytes) {
            Some(end) if end <= self.0.size => Ok(()),
            _ => Err(self.misuse(format!("bytes {offset} + {bytes} lie outside the buffer's {}", self.0.size))),
        }
    }

    /// Keeps it for commands, and from the host meanwhile.
    pub(super) fn recorded(&self) -> Arc<dyn Send + Sync> {
        match self.0.memory {
            Memory::Device => self.0.clone(),
            Memory::Upload | Memory::Readback => Arc::new(Recorded::new(self)),
        }
    }

    /// Locks it for the host. Errors: commands that use it may not have been executed yet.
    fn for_host(&self) -> Result<MutexGuard<'_, u32>> {
        let recordings = self.0.recordings.lock().unwrap_or_else(PoisonError::into_inner);
        if *recordings == 0 {
            return Ok(recordings);
        }
        Err(self.misuse(String::from(
            "recorded commands use it; let them be executed and drop what keeps their resources before the host does",
        )))
    }

    /// Whether it has memory: not if its context measures.
    pub(super) fn is_backed(&self) -> bool {
        self.0.allocation.is_some()
    }

    /// The mapped memory of a buffer of this kind.
    fn mapped(&self, memory: Memory, verb: &str) -> Result<*mut u8> {
        let pointer = self.0.allocation.as_ref().and_then(Allocation::mapped_ptr);
        match pointer {
            Some(pointer) if self.0.memory == memory => Ok(pointer.as_ptr().cast()),
            _ => Err(self.misuse(format!("only a buffer of Memory::{memory:?} can be {verb} by the host"))),
        }
    }

    /// Writes into a buffer of [`Memory::Upload`]. Errors: it is none, the bytes lie outside, or commands were recorded that use it, unless
    /// they have been executed and [`super::Retained`] was dropped.
    pub fn write(&self, offset: u64, bytes: &[u8]) -> Result<()> {
        if self.0.ctx.measures() {
            return self.check_range(offset, bytes.len() as u64);
        }
        let pointer = self.mapped(Memory::Upload, "written")?;
        self.check_range(offset, bytes.len() as u64)?;
        let _host = self.for_host()?;
        // SAFETY: the range lies inside the mapped allocation, which neither the device nor another thread touches meanwhile. The
        // allocator maps host-coherent memory only, so nothing is to be flushed.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), pointer.add(offset as usize), bytes.len()) };
        Ok(())
    }

    /// Reads a buffer of [`Memory::Readback`] as a whole. Errors: as for [`Buffer::write`].
    pub fn read<T: Pod>(&self) -> Result<Vec<T>> {
        let count = self.count_of::<T>()?;
        let mut values = vec![T::zeroed(); count];
        self.read_into(0, bytemuck::cast_slice_mut(&mut values))?;
        Ok(values)
    }

    pub(super) fn read_into(&self, offset: u64, bytes: &mut [u8]) -> Result<()> {
        let pointer = self.mapped(Memory::Readback, "read")?;
        self.check_range(offset, bytes.len() as u64)?;
        let _host = self.for_host()?;
        // SAFETY: as in `write`; coherent memory needs no invalidation.
        unsafe { std::ptr::copy_nonoverlapping(pointer.add(offset as usize), bytes.as_mut_ptr(), bytes.len()) };
        Ok(())
    }

    /// Whether the host can read the buffer where it lies, at the speed of its own memory.
    pub(super) fn is_seen_by_host(&self) -> bool {
        let wanted = vk::MemoryPropertyFlags::HOST_COHERENT | vk::MemoryPropertyFlags::HOST_CACHED;
        let allocation = self.0.allocation.as_ref();
        self.0.memory == Memory::Device
            && allocation.is_some_and(|a| a.mapped_ptr().is_some() && a.memory_properties().contains(wanted))
    }

    /// Reads bytes of a buffer that [`Buffer::is_seen_by_host`], from any number of threads. The commands that wrote it must
    /// have been waited for.
    pub(super) fn read_in_place(&self, offset: u64, bytes: &mut [u8]) -> Result<()> {
        self.check_range(offset, bytes.len() as u64)?;
        let pointer = self.0.allocation.as_ref().filter(|_| self.is_seen_by_host()).and_then(Allocation::mapped_ptr);
        let pointer = pointer.ok_or_else(|| self.misuse(String::from("the host does not see its memory")))?;
        // SAFETY: the range lies inside the mapped allocation. The host never writes a buffer of this kind, and the device
        // has done so before; coherent memory needs no invalidation.
        unsafe {
            let from = pointer.as_ptr().cast::<u8>().add(offset as usize);
            std::ptr::copy_nonoverlapping(from, bytes.as_mut_ptr(), bytes.len());
        }
        Ok(())
    }

    /// Number of `T` in the buffer.
    pub(super) fn count_of<T: Pod>(&self) -> Result<usize> {
        let size = size_of::<T>() as u64;
        if size == 0 || !self.0.bytes.is_multiple_of(size) {
            return Err(self.misuse(format!(
                "{} bytes are no whole number of {} ({size} bytes each)",
                self.0.bytes,
                std::any::type_name::<T>()
            )));
        }
        Ok((self.0.bytes / size) as usize)
    }
}

impl Drop for BufferInner {
    fn drop(&mut self) {
        // SAFETY: whoever recorded commands with this buffer retained it until they were done.
        unsafe { self.ctx.device().destroy_buffer(self.handle, None) };
        self.ctx.usage().give_back(&self.name, self.counted, self.memory);
        release(&self.ctx, &self.name, self.allocation.take());
    }
}

pub(super) fn allocate(
    ctx: &Context,
    name: &str,
    requirements: vk::MemoryRequirements,
    location: MemoryLocation,
    linear: bool,
) -> Result<Allocation> {
    within(name, requirements.size, ctx.info().max_allocation, "maxMemoryAllocationSize")?;
    let desc = AllocationCreateDesc {
        name,
        requirements,
        location,
        linear,
        allocation_scheme: AllocationScheme::GpuAllocatorManaged,
    };
    let (resource, bytes) = (name.to_owned(), requirements.size);
    ctx.allocator().allocate(&desc).map_err(|error| match error {
        AllocationError::OutOfMemory => Error::OutOfMemory { resource, bytes: Some(bytes) },
        // The allocator tells other results of Vulkan in words alone.
        AllocationError::Internal(text) if text.contains("ERROR_DEVICE_LOST") => Error::DeviceLost { during: resource },
        error => {
            let message = format!("{error} ({bytes} bytes); try again, or choose another device (--list-devices)");
            Error::Resource { name: resource, message }
        }
    })
}

/// Checks a size against a limit of the device.
pub(super) fn within(name: &str, bytes: u64, limit: u64, limit_name: &'static str) -> Result<()> {
    if bytes <= limit {
        return Ok(());
    }
    let advice = "lower the resolution or --particles, or simplify the scene";
    Err(Error::DeviceLimit { resource: name.to_owned(), bytes, limit, limit_name, advice })
}

pub(super) fn release(ctx: &Context, name: &str, allocation: Option<Allocation>) {
    if let Some(allocation) = allocation
        && let Err(error) = ctx.allocator().free(allocation)
    {
        log::warn!("{name}: memory not given back: {error}");
    }
}

pub(super) fn failed(name: &str, bytes: u64, result: vk::Result) -> Error {
    match result {
        vk::Result::ERROR_OUT_OF_HOST_MEMORY | vk::Result::ERROR_OUT_OF_DEVICE_MEMORY => {
            Error::OutOfMemory { resource: name.to_owned(), bytes: Some(bytes) }
        }
        result => super::instance::vulkan(name)(result),
    }
}
