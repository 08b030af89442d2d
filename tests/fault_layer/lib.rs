//! A Vulkan layer that makes calls fail, for the tests of the command line in `tests/cli/faults.rs`.
//!
//! It counts the calls of a device that may fail. `LIGHTSUM_FAULT=K:RESULT,K:RESULT...` makes number K (from 1) return that number of
//! VkResult without being made; after VK_ERROR_DEVICE_LOST all submissions and waits of the device return it as well. It writes a line for each
//! such call and for each object that is made or destroyed to the file `LIGHTSUM_FAULT_LOG`:
//!
//! ```text
//! call 17 vkCreateBuffer      fail 18 vkCreateBuffer      made buffer      gone buffer
//! ```
//!
//! Calls are counted over all devices of the process; a lost device is lost alone.
//!
//! `LIGHTSUM_FAULT_RANGE=BYTES` is the `maxStorageBufferRange` of all devices.

#![allow(non_snake_case, reason = "the functions have Vulkan's names")]

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::{CStr, c_char, c_void};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use ash::vk::{self, Handle};

type VoidFunction = vk::PFN_vkVoidFunction;

/// VkNegotiateLayerInterface of vk_layer.h.
#[repr(C)]
pub struct Negotiation {
    kind: i32,
    next: *mut c_void,
    version: u32,
    get_instance: Option<vk::PFN_vkGetInstanceProcAddr>,
    get_device: Option<vk::PFN_vkGetDeviceProcAddr>,
    get_physical_device: Option<vk::PFN_vkGetInstanceProcAddr>,
}

/// VkLayerInstanceLink and VkLayerDeviceLink: the functions of the layer below. The second has another type for an instance, where it
/// is not read.
#[repr(C)]
struct Link {
    next: *mut Link,
    get_instance: vk::PFN_vkGetInstanceProcAddr,
    of_device: vk::PFN_vkGetDeviceProcAddr,
}

/// VkLayerInstanceCreateInfo and VkLayerDeviceCreateInfo, as far as they are read.
#[repr(C)]
struct LinkInfo {
    kind: i32,
    next: *mut LinkInfo,
    function: i32,
    link: *mut Link,
}

/// Functions of the layer below, asked when the instance is made: later on the loader answers with those of the uppermost layer.
#[derive(Clone, Copy)]
struct OfInstance {
    destroy: Option<vk::PFN_vkDestroyInstance>,
    properties: Option<vk::PFN_vkGetPhysicalDeviceProperties>,
    properties2: Option<vk::PFN_vkGetPhysicalDeviceProperties2>,
}

const LOADER_INSTANCE_CREATE_INFO: i32 = 47;
const LOADER_DEVICE_CREATE_INFO: i32 = 48;
const LINK: i32 = 0;

/// An instance or a device: the function of the next layer that tells the others, and its handle.
#[derive(Clone, Copy)]
struct Below<Get> {
    get: Get,
    handle: u64,
}

/// Instances and devices by their keys.
static INSTANCES: Mutex<BTreeMap<usize, Below<vk::PFN_vkGetInstanceProcAddr>>> = Mutex::new(BTreeMap::new());
static DEVICES: Mutex<BTreeMap<usize, Below<vk::PFN_vkGetDeviceProcAddr>>> = Mutex::new(BTreeMap::new());
/// Functions of the layer below for each instance.
static OF_INSTANCES: Mutex<BTreeMap<usize, OfInstance>> = Mutex::new(BTreeMap::new());
/// Keys of the devices that are lost.
static LOST: Mutex<BTreeSet<usize>> = Mutex::new(BTreeSet::new());

/// The key of a dispatchable object, which those of one device share: the loader's table of functions, to which it points.
fn key(object: impl Handle) -> usize {
    // SAFETY: the loader makes dispatchable objects so; a handle may be null.
    unsafe { (object.as_raw() as *const usize).as_ref() }.copied().unwrap_or(0)
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The number of the next call. The loader may unload the layer between two instances, so that the log knows those before.
fn next_number() -> u64 {
    static CALLS: OnceLock<AtomicU64> = OnceLock::new();
    let before = || {
        let log = std::env::var_os("LIGHTSUM_FAULT_LOG").and_then(|path| std::fs::read_to_string(path).ok());
        let calls = log.iter().flat_map(|log| log.lines()).filter(|line| !line.starts_with(['m', 'g'])).count();
        AtomicU64::new(calls as u64)
    };
    CALLS.get_or_init(before).fetch_add(1, Ordering::SeqCst) + 1
}

/// The result of call number `call`, if it fails.
fn fault(call: u64) -> Option<vk::Result> {
    static FAULTS: OnceLock<Vec<(u64, vk::Result)>> = OnceLock::new();
    let read = |text: &str| {
        let (call, result) = text.split_once(':')?;
        Some((call.parse().ok()?, vk::Result::from_raw(result.parse().ok()?)))
    };
    let faults = FAULTS.get_or_init(|| {
        std::env::var("LIGHTSUM_FAULT").map(|text| text.split(',').filter_map(read).collect()).unwrap_or_default()
    });
    faults.iter().find(|(number, _)| *number == call).map(|(_, result)| *result)
}

fn log(line: std::fmt::Arguments) {
    static LOG: OnceLock<Option<Mutex<File>>> = OnceLock::new();
    let open = || OpenOptions::new().create(true).append(true).open(std::env::var_os("LIGHTSUM_FAULT_LOG")?).ok();
    if let Some(file) = LOG.get_or_init(|| open().map(Mutex::new)) {
        // One write for a line; a log that cannot be written fails the test that reads it.
        let _ = file.lock().map(|mut file| file.write_all(format!("{line}\n").as_bytes()));
    }
}

/// Whether a lost device refuses this call.
fn needs_device(name: &str) -> bool {
    matches!(name, "vkQueueSubmit" | "vkWaitForFences" | "vkDeviceWaitIdle" | "vkGetQueryPoolResults")
}

/// Makes a call for the device of a key, unless it is its turn to fail.
fn call(key: usize, name: &str, make: impl FnOnce() -> vk::Result) -> vk::Result {
    let number = next_number();
    if let Some(result) = fault(number) {
        if result == vk::Result::ERROR_DEVICE_LOST {
            lock(&LOST).insert(key);
            end_work(key);
        }
        log(format_args!("fail {number} {name}"));
        return result;
    }
    log(format_args!("call {number} {name}"));
    if needs_device(name) && lock(&LOST).contains(&key) {
        return vk::Result::ERROR_DEVICE_LOST;
    }
    make()
}

/// The next layer's function of the device of a key.
unsafe fn next(key: usize, name: &CStr) -> VoidFunction {
    let below = lock(&DEVICES).get(&key).copied()?;
    // SAFETY: it was stored when the device was made, and the caller names a function of that device.
    unsafe { (below.get)(vk::Device::from_raw(below.handle), name.as_ptr()) }
}

/// Lets the device of a key end its work: a lost one does none, so that the caller may destroy what its last commands use.
fn end_work(key: usize) {
    let Some(below) = lock(&DEVICES).get(&key).copied() else { return };
    // SAFETY: the layer below has the function; no other thread submits to this device meanwhile.
    unsafe {
        let wait: Option<vk::PFN_vkDeviceWaitIdle> = std::mem::transmute(next(key, c"vkDeviceWaitIdle"));
        if let Some(wait) = wait {
            // The device is lost whatever comes of this.
            let _ = wait(vk::Device::from_raw(below.handle));
        }
    }
}

/// The link of a chain of structures.
unsafe fn link(mut at: *mut LinkInfo, kind: i32) -> *mut LinkInfo {
    // SAFETY: the loader's chains are valid, and begin alike.
    unsafe {
        while !at.is_null() && ((*at).kind != kind || (*at).function != LINK) {
            at = (*at).next;
        }
    }
    at
}

/// Functions that may fail. `makes`: what they make, one or as many as the number tells; the caller destroys it.
macro_rules! fallible {
    ($($name:ident($of:ident: $owner:ty $(, $argument:ident: $kind:ty)*) $(makes $object:literal $(times $count:expr)?)?;)*) => {
        $(unsafe extern "system" fn $name($of: $owner $(, $argument: $kind)*) -> vk::Result {
            let key = key($of);
            // SAFETY: the layer below has a function of this name and type; the arguments are the caller's.
            let result = call(key, stringify!($name), || unsafe {
                let name = CStr::from_bytes_with_nul_unchecked(concat!(stringify!($name), "\0").as_bytes());
                let make: unsafe extern "system" fn($owner $(, $kind)*) -> vk::Result = std::mem::transmute(next(key, name));
                make($of $(, $argument)*)
            });
            $(if result == vk::Result::SUCCESS {
                let made = 1 $(* $count)?;
                (0..made).for_each(|_| log(format_args!("made {}", $object)));
            })?
            result
        })*

        fn fallible(name: &CStr) -> VoidFunction {
            let address: *const () = match name.to_bytes() {
                $(bytes if bytes == stringify!($name).as_bytes() => $name as *const (),)*
                _ => return None,
            };
            // SAFETY: it is the address of a function.
            Some(unsafe { std::mem::transmute::<*const (), unsafe extern "system" fn()>(address) })
        }
    };
}

type Callbacks = *const vk::AllocationCallbacks<'static>;

fallible! {
    vkAllocateMemory(d: vk::Device, i: *const vk::MemoryAllocateInfo<'static>, c: Callbacks, o: *mut vk::DeviceMemory) makes "memory";
    vkMapMemory(d: vk::Device, m: vk::DeviceMemory, at: u64, size: u64, f: vk::MemoryMapFlags, o: *mut *mut c_void);
    vkCreateBuffer(d: vk::Device, i: *const vk::BufferCreateInfo<'static>, c: Callbacks, o: *mut vk::Buffer) makes "buffer";
    vkBindBufferMemory(d: vk::Device, b: vk::Buffer, m: vk::DeviceMemory, at: u64);
    vkCreateBufferView(d: vk::Device, i: *const vk::BufferViewCreateInfo<'static>, c: Callbacks, o: *mut vk::BufferView) makes "buffer view";
    vkCreateImage(d: vk::Device, i: *const vk::ImageCreateInfo<'static>, c: Callbacks, o: *mut vk::Image) makes "image";
    vkBindImageMemory(d: vk::Device, b: vk::Image, m: vk::DeviceMemory, at: u64);
    vkCreateImageView(d: vk::Device, i: *const vk::ImageViewCreateInfo<'static>, c: Callbacks, o: *mut vk::ImageView) makes "view";
    vkCreateShaderModule(d: vk::Device, i: *const vk::ShaderModuleCreateInfo<'static>, c: Callbacks, o: *mut vk::ShaderModule) makes "module";
    vkCreateDescriptorSetLayout(d: vk::Device, i: *const vk::DescriptorSetLayoutCreateInfo<'static>, c: Callbacks, o: *mut vk::DescriptorSetLayout) makes "set layout";
    vkCreatePipelineLayout(d: vk::Device, i: *const vk::PipelineLayoutCreateInfo<'static>, c: Callbacks, o: *mut vk::PipelineLayout) makes "pipeline layout";
    vkCreateComputePipelines(d: vk::Device, p: vk::PipelineCache, n: u32, i: *const vk::ComputePipelineCreateInfo<'static>, c: Callbacks, o: *mut vk::Pipeline) makes "pipeline" times n;
    vkCreatePipelineCache(d: vk::Device, i: *const vk::PipelineCacheCreateInfo<'static>, c: Callbacks, o: *mut vk::PipelineCache) makes "pipeline cache";
    vkGetPipelineCacheData(d: vk::Device, p: vk::PipelineCache, n: *mut usize, o: *mut c_void);
    vkCreateDescriptorPool(d: vk::Device, i: *const vk::DescriptorPoolCreateInfo<'static>, c: Callbacks, o: *mut vk::DescriptorPool) makes "descriptor pool";
    vkAllocateDescriptorSets(d: vk::Device, i: *const vk::DescriptorSetAllocateInfo<'static>, o: *mut vk::DescriptorSet);
    vkCreateCommandPool(d: vk::Device, i: *const vk::CommandPoolCreateInfo<'static>, c: Callbacks, o: *mut vk::CommandPool) makes "command pool";
    vkAllocateCommandBuffers(d: vk::Device, i: *const vk::CommandBufferAllocateInfo<'static>, o: *mut vk::CommandBuffer);
    vkBeginCommandBuffer(b: vk::CommandBuffer, i: *const vk::CommandBufferBeginInfo<'static>);
    vkEndCommandBuffer(b: vk::CommandBuffer);
    vkCreateQueryPool(d: vk::Device, i: *const vk::QueryPoolCreateInfo<'static>, c: Callbacks, o: *mut vk::QueryPool) makes "query pool";
    vkGetQueryPoolResults(d: vk::Device, p: vk::QueryPool, first: u32, n: u32, size: usize, o: *mut c_void, stride: u64, f: vk::QueryResultFlags);
    vkCreateFence(d: vk::Device, i: *const vk::FenceCreateInfo<'static>, c: Callbacks, o: *mut vk::Fence) makes "fence";
    vkResetFences(d: vk::Device, n: u32, f: *const vk::Fence);
    vkQueueSubmit(q: vk::Queue, n: u32, i: *const vk::SubmitInfo<'static>, f: vk::Fence);
    vkWaitForFences(d: vk::Device, n: u32, f: *const vk::Fence, all: vk::Bool32, time: u64);
    vkDeviceWaitIdle(d: vk::Device);
}

/// Functions that destroy an object.
macro_rules! destroys {
    ($($name:ident($kind:ty) = $object:literal;)*) => {
        $(unsafe extern "system" fn $name(device: vk::Device, object: $kind, callbacks: Callbacks) {
            if !object.is_null() {
                log(format_args!("gone {}", $object));
            }
            // SAFETY: as for those that may fail.
            unsafe {
                let name = CStr::from_bytes_with_nul_unchecked(concat!(stringify!($name), "\0").as_bytes());
                let make: unsafe extern "system" fn(vk::Device, $kind, Callbacks) = std::mem::transmute(next(key(device), name));
                make(device, object, callbacks);
            }
        })*

        fn destroying(name: &CStr) -> VoidFunction {
            let address: *const () = match name.to_bytes() {
                $(bytes if bytes == stringify!($name).as_bytes() => $name as *const (),)*
                _ => return None,
            };
            // SAFETY: it is the address of a function.
            Some(unsafe { std::mem::transmute::<*const (), unsafe extern "system" fn()>(address) })
        }
    };
}

destroys! {
    vkFreeMemory(vk::DeviceMemory) = "memory";
    vkDestroyBuffer(vk::Buffer) = "buffer";
    vkDestroyBufferView(vk::BufferView) = "buffer view";
    vkDestroyImage(vk::Image) = "image";
    vkDestroyImageView(vk::ImageView) = "view";
    vkDestroyShaderModule(vk::ShaderModule) = "module";
    vkDestroyDescriptorSetLayout(vk::DescriptorSetLayout) = "set layout";
    vkDestroyPipelineLayout(vk::PipelineLayout) = "pipeline layout";
    vkDestroyPipeline(vk::Pipeline) = "pipeline";
    vkDestroyPipelineCache(vk::PipelineCache) = "pipeline cache";
    vkDestroyDescriptorPool(vk::DescriptorPool) = "descriptor pool";
    vkDestroyCommandPool(vk::CommandPool) = "command pool";
    vkDestroyQueryPool(vk::QueryPool) = "query pool";
    vkDestroyFence(vk::Fence) = "fence";
}

unsafe extern "system" fn vkCreateInstance(
    info: *const vk::InstanceCreateInfo<'static>,
    callbacks: Callbacks,
    out: *mut vk::Instance,
) -> vk::Result {
    // SAFETY: the loader's chain has the link; it is advanced for the layer below, as the loader's interface asks.
    unsafe {
        let at = link((*info).p_next.cast_mut().cast(), LOADER_INSTANCE_CREATE_INFO);
        if at.is_null() {
            return vk::Result::ERROR_INITIALIZATION_FAILED;
        }
        let below = (*at).link;
        let get = (*below).get_instance;
        (*at).link = (*below).next;
        let create: Option<vk::PFN_vkCreateInstance> =
            std::mem::transmute(get(vk::Instance::null(), c"vkCreateInstance".as_ptr()));
        let Some(create) = create else { return vk::Result::ERROR_INITIALIZATION_FAILED };
        let result = create(info, callbacks, out);
        if result == vk::Result::SUCCESS {
            let below =
                OfInstance {
                    destroy: std::mem::transmute::<VoidFunction, Option<vk::PFN_vkDestroyInstance>>(get(
                        *out,
                        c"vkDestroyInstance".as_ptr(),
                    )),
                    properties: std::mem::transmute::<VoidFunction, Option<vk::PFN_vkGetPhysicalDeviceProperties>>(
                        get(*out, c"vkGetPhysicalDeviceProperties".as_ptr()),
                    ),
                    properties2: std::mem::transmute::<VoidFunction, Option<vk::PFN_vkGetPhysicalDeviceProperties2>>(
                        get(*out, c"vkGetPhysicalDeviceProperties2".as_ptr()),
                    ),
                };
            lock(&INSTANCES).insert(key(*out), Below { get, handle: (*out).as_raw() });
            lock(&OF_INSTANCES).insert(key(*out), below);
            log(format_args!("made instance"));
        }
        result
    }
}

unsafe extern "system" fn vkDestroyInstance(instance: vk::Instance, callbacks: Callbacks) {
    log(format_args!("gone instance"));
    lock(&INSTANCES).remove(&key(instance));
    if let Some(OfInstance { destroy: Some(destroy), .. }) = lock(&OF_INSTANCES).remove(&key(instance)) {
        // SAFETY: it is the function of the layer below; the instance is the caller's.
        unsafe { destroy(instance, callbacks) };
    }
}

unsafe extern "system" fn vkCreateDevice(
    physical: vk::PhysicalDevice,
    info: *const vk::DeviceCreateInfo<'static>,
    callbacks: Callbacks,
    out: *mut vk::Device,
) -> vk::Result {
    // SAFETY: as for the instance; the second function of the link is that of devices.
    let result = call(0, "vkCreateDevice", || unsafe {
        let at = link((*info).p_next.cast_mut().cast(), LOADER_DEVICE_CREATE_INFO);
        if at.is_null() {
            return vk::Result::ERROR_INITIALIZATION_FAILED;
        }
        let below = (*at).link;
        let (get, of_device) = ((*below).get_instance, (*below).of_device);
        (*at).link = (*below).next;
        // A physical device has the key of its instance.
        let Some(instance) = lock(&INSTANCES).get(&key(physical)).map(|below| vk::Instance::from_raw(below.handle))
        else {
            return vk::Result::ERROR_INITIALIZATION_FAILED;
        };
        let create: Option<vk::PFN_vkCreateDevice> = std::mem::transmute(get(instance, c"vkCreateDevice".as_ptr()));
        let Some(create) = create else { return vk::Result::ERROR_INITIALIZATION_FAILED };
        let result = create(physical, info, callbacks, out);
        if result == vk::Result::SUCCESS {
            lock(&LOST).remove(&key(*out));
            lock(&DEVICES).insert(key(*out), Below { get: of_device, handle: (*out).as_raw() });
        }
        result
    });
    if result == vk::Result::SUCCESS {
        log(format_args!("made device"));
    }
    result
}

unsafe extern "system" fn vkDestroyDevice(device: vk::Device, callbacks: Callbacks) {
    log(format_args!("gone device"));
    let key = key(device);
    // SAFETY: the layer below has the function; the device is the caller's.
    unsafe {
        let destroy: Option<vk::PFN_vkDestroyDevice> = std::mem::transmute(next(key, c"vkDestroyDevice"));
        if let Some(destroy) = destroy {
            destroy(device, callbacks);
        }
    }
    lock(&DEVICES).remove(&key);
}

/// The functions for the instance of a physical device, which has the same key.
fn of_instance(physical: vk::PhysicalDevice) -> Option<OfInstance> {
    lock(&OF_INSTANCES).get(&key(physical)).copied()
}

fn limit(limits: &mut vk::PhysicalDeviceLimits) {
    if let Some(range) = std::env::var("LIGHTSUM_FAULT_RANGE").ok().and_then(|range| range.parse().ok()) {
        limits.max_storage_buffer_range = range;
    }
}

unsafe extern "system" fn vkGetPhysicalDeviceProperties(
    physical: vk::PhysicalDevice,
    out: *mut vk::PhysicalDeviceProperties,
) {
    if let Some(get) = of_instance(physical).and_then(|below| below.properties) {
        // SAFETY: the function is that of the layer below; the arguments are the caller's.
        unsafe {
            get(physical, out);
            limit(&mut (*out).limits);
        }
    }
}

unsafe extern "system" fn vkGetPhysicalDeviceProperties2(
    physical: vk::PhysicalDevice,
    out: *mut vk::PhysicalDeviceProperties2<'static>,
) {
    if let Some(get) = of_instance(physical).and_then(|below| below.properties2) {
        // SAFETY: as for the first version.
        unsafe {
            get(physical, out);
            limit(&mut (*out).properties.limits);
        }
    }
}

/// The functions of this layer; `None`: those of the layer below.
fn own(name: &CStr) -> VoidFunction {
    let address: *const () = match name.to_bytes() {
        b"vkGetInstanceProcAddr" => get_instance as *const (),
        b"vkGetDeviceProcAddr" => get_device as *const (),
        b"vkCreateInstance" => vkCreateInstance as *const (),
        b"vkDestroyInstance" => vkDestroyInstance as *const (),
        b"vkCreateDevice" => vkCreateDevice as *const (),
        b"vkDestroyDevice" => vkDestroyDevice as *const (),
        b"vkGetPhysicalDeviceProperties" => vkGetPhysicalDeviceProperties as *const (),
        b"vkGetPhysicalDeviceProperties2" => vkGetPhysicalDeviceProperties2 as *const (),
        _ => return fallible(name).or_else(|| destroying(name)),
    };
    // SAFETY: it is the address of a function.
    Some(unsafe { std::mem::transmute::<*const (), unsafe extern "system" fn()>(address) })
}

unsafe extern "system" fn get_instance(instance: vk::Instance, name: *const c_char) -> VoidFunction {
    // SAFETY: the name ends in 0; the layer below was linked when the instance was made.
    unsafe {
        own(CStr::from_ptr(name)).or_else(|| {
            let below = lock(&INSTANCES).get(&key(instance)).copied()?;
            (below.get)(instance, name)
        })
    }
}

unsafe extern "system" fn get_device(device: vk::Device, name: *const c_char) -> VoidFunction {
    // SAFETY: the name ends in 0.
    unsafe {
        let name = CStr::from_ptr(name);
        own(name).or_else(|| next(key(device), name))
    }
}

/// The loader's first call: tells it the entry points.
///
/// # Safety
/// The pointer is to a structure of the loader.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn vkNegotiateLoaderLayerInterfaceVersion(negotiation: *mut Negotiation) -> vk::Result {
    // SAFETY: the caller's promise.
    unsafe {
        (*negotiation).version = (*negotiation).version.min(2);
        (*negotiation).get_instance = Some(get_instance);
        (*negotiation).get_device = Some(get_device);
        (*negotiation).get_physical_device = None;
    }
    vk::Result::SUCCESS
}
