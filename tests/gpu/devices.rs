//! Devices of hosts, and devices that fail: each failure becomes an error that names the work.

use std::ffi::c_void;
use std::sync::atomic::{AtomicI32, Ordering};

use ash::vk;
use lightsum::Error;
use lightsum::gpu::{
    Buffer, Context, ContextOptions, HostDevice, Kernel, Memory, Recorder, Requirements, Staging, Timers,
};

use lightsum::conform::checks::kernels::{fill_push, filled};

use crate::gpu_layer::error;
use crate::support::{SENTINEL, assert_silent, gpu_test, kernels, options};

/// A host's device, made here with ash alone; destroyed after the context that uses it.
struct Host {
    entry: ash::Entry,
    instance: ash::Instance,
    device: ash::Device,
    physical: vk::PhysicalDevice,
    family: u32,
}

impl Host {
    fn new() -> Host {
        // SAFETY: plain Vulkan: `drop` destroys the objects created here from valid structures.
        unsafe {
            let entry = ash::Entry::load().unwrap();
            let layers = [c"VK_LAYER_KHRONOS_validation".as_ptr()];
            let extensions = [ash::ext::debug_utils::NAME.as_ptr()];
            let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_1);
            let create = vk::InstanceCreateInfo::default()
                .application_info(&application)
                .enabled_layer_names(&layers)
                .enabled_extension_names(&extensions);
            let instance = entry.create_instance(&create, None).unwrap();
            let (physical, needs) = instance
                .enumerate_physical_devices()
                .unwrap()
                .into_iter()
                .map(|physical| (physical, Requirements::check(&entry, &instance, physical)))
                .find(|(_, needs)| needs.missing.is_empty())
                .expect("no device suits");
            assert_eq!(needs.api_version, vk::API_VERSION_1_1);
            let family = needs.queue_family.unwrap();
            let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
            let mut names = Vec::new();
            needs.add_to(&mut names);
            let names: Vec<_> = names.iter().map(|name| name.as_ptr()).collect();
            let create = vk::DeviceCreateInfo::default()
                .queue_create_infos(&queues)
                .enabled_extension_names(&names)
                .enabled_features(&needs.features);
            let device = instance.create_device(physical, &create, None).unwrap();
            Host { entry, instance, device, physical, family }
        }
    }

    fn queue(&self) -> vk::Queue {
        // SAFETY: the device was created with one queue of this family.
        unsafe { self.device.get_device_queue(self.family, 0) }
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        // SAFETY: created by `new`, and nothing made from them remains.
        unsafe {
            self.device.destroy_device(None);
            self.instance.destroy_instance(None);
        }
    }
}

#[test]
fn a_host_records_us_into_its_own_command_buffer() {
    gpu_test(|_| {
        let host = Host::new();
        let handles = HostDevice {
            entry: host.entry.clone(),
            instance: host.instance.clone(),
            physical_device: host.physical,
            device: host.device.clone(),
            queue_family: host.family,
            queue: host.queue(),
        };
        // SAFETY: the handles belong together and outlive the context; debug utils are enabled.
        let ctx = unsafe { Context::adopt(handles, &options()) }.unwrap();
        assert!(ctx.is_adopted());
        let refused = error(ctx.submit_and_wait("work", None, |_| Ok(())));
        assert!(refused.to_string().contains("the host's"), "{refused}");

        let size = 27;
        let kernel = Kernel::new(&ctx, &kernels::FILL).unwrap();
        let timers = Timers::new(&ctx, 1).unwrap();
        let mut staging = Staging::new();
        let values = staging.stage(&ctx, "values", &vec![SENTINEL; size + 1]).unwrap();
        let result = Buffer::new(&ctx, "result", values.bytes(), Memory::Readback).unwrap();
        // SAFETY: plain Vulkan as a host does it; `retained` lives until the queue is idle.
        unsafe {
            let pool = vk::CommandPoolCreateInfo::default().queue_family_index(host.family);
            let pool = host.device.create_command_pool(&pool, None).unwrap();
            let commands = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            let commands = host.device.allocate_command_buffers(&commands).unwrap();
            host.device.begin_command_buffer(commands[0], &vk::CommandBufferBeginInfo::default()).unwrap();
            let mut rec = Recorder::new(&ctx, commands[0], Some(&timers));
            rec.begin();
            staging.record(&mut rec).unwrap();
            rec.scope("fill", |rec| {
                let bindings = kernel.bind(&[("values", (&values).into())])?;
                rec.dispatch(&kernel, &bindings, bytemuck::bytes_of(&fill_push(size, 1)), 1)
            })
            .unwrap();
            rec.copy(&values, &result).unwrap();
            let retained = rec.finish();
            // The recorded resources stay alive without us.
            drop((staging, kernel, values));
            host.device.end_command_buffer(commands[0]).unwrap();
            let submit = [vk::SubmitInfo::default().command_buffers(&commands)];
            host.device.queue_submit(host.queue(), &submit, vk::Fence::null()).unwrap();
            host.device.queue_wait_idle(host.queue()).unwrap();
            drop(retained);
            host.device.destroy_command_pool(pool, None);
        }
        let read = result.read::<u32>().unwrap();
        assert_eq!(read[..size], filled(size, SENTINEL, 1));
        assert_eq!(read[size], SENTINEL);
        assert_eq!(timers.read().unwrap().len(), usize::from(ctx.info().timestamps));
        drop((timers, result));
        assert_silent(ctx.take_messages());
        drop(ctx);
    });
}

/// The result that the device of the test below has for its buffers and queries.
static ANSWER: AtomicI32 = AtomicI32::new(0);

unsafe extern "system" fn no_buffer(
    _: vk::Device,
    _: *const vk::BufferCreateInfo<'_>,
    _: *const vk::AllocationCallbacks<'_>,
    _: *mut vk::Buffer,
) -> vk::Result {
    vk::Result::from_raw(ANSWER.load(Ordering::Relaxed))
}

unsafe extern "system" fn no_queries(
    _: vk::Device,
    _: *const vk::QueryPoolCreateInfo<'_>,
    _: *const vk::AllocationCallbacks<'_>,
    _: *mut vk::QueryPool,
) -> vk::Result {
    vk::Result::from_raw(ANSWER.load(Ordering::Relaxed))
}

/// A host's device whose functions fail stands for one that fails.
#[test]
fn failures_of_the_device_become_errors_that_name_the_work() {
    gpu_test(|_| {
        let host = Host::new();
        let raw = host.device.handle();
        // SAFETY: the functions replaced have the types that Vulkan gives them and write nothing.
        let device = unsafe {
            ash::Device::load_with(
                |name| match name.to_bytes() {
                    b"vkCreateBuffer" => no_buffer as *const c_void,
                    b"vkCreateQueryPool" => no_queries as *const c_void,
                    _ => match (host.instance.fp_v1_0().get_device_proc_addr)(raw, name.as_ptr()) {
                        Some(function) => function as *const c_void,
                        None => std::ptr::null(),
                    },
                },
                raw,
            )
        };
        let handles = HostDevice {
            entry: host.entry.clone(),
            instance: host.instance.clone(),
            physical_device: host.physical,
            device,
            queue_family: host.family,
            queue: host.queue(),
        };
        // SAFETY: the handles belong together and outlive the context; debug utils are enabled.
        let ctx = unsafe { Context::adopt(handles, &options()) }.unwrap();
        for result in [
            vk::Result::ERROR_OUT_OF_HOST_MEMORY,
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY,
            vk::Result::ERROR_DEVICE_LOST,
            vk::Result::ERROR_INITIALIZATION_FAILED,
        ] {
            ANSWER.store(result.as_raw(), Ordering::Relaxed);
            let buffer = error(Buffer::new(&ctx, "rays", 1000, Memory::Device));
            let mut errors = vec![("rays", buffer)];
            if ctx.info().timestamps {
                errors.push(("timers", error(Timers::new(&ctx, 2))));
            }
            for (name, error) in errors {
                let text = error.to_string();
                match (result, error) {
                    (vk::Result::ERROR_DEVICE_LOST, Error::DeviceLost { during }) => {
                        assert_eq!(during, name);
                        assert!(text.starts_with(&format!("the device was lost ({name}): ")), "{text}");
                        assert!(text.contains("--lights-per-dispatch"), "{text}");
                    }
                    (vk::Result::ERROR_INITIALIZATION_FAILED, Error::Vulkan { what, result: told }) => {
                        assert_eq!((what.as_str(), told), (name, result));
                    }
                    (
                        vk::Result::ERROR_OUT_OF_HOST_MEMORY | vk::Result::ERROR_OUT_OF_DEVICE_MEMORY,
                        Error::OutOfMemory { resource, bytes },
                    ) => {
                        assert_eq!(resource, name);
                        assert_eq!(bytes, (name == "rays").then_some(1000));
                        let told = if name == "rays" { " for 1000 bytes" } else { "" };
                        assert!(text.starts_with(&format!("{name}: no memory{told}; lower ")), "{text}");
                    }
                    (_, other) => panic!("{result:?} of {name} is told as {other:?}"),
                }
            }
        }
        assert_silent(ctx.take_messages());
        drop(ctx);
    });
}

/// Run by the test below in a process of its own, whose address space is limited.
#[test]
#[ignore = "run by memory_that_runs_out_is_told_with_the_resource in a process with little memory"]
fn with_little_memory() {
    // The driver shall refuse, not the count of what is free.
    let ctx = Context::headless(&ContextOptions { max_memory: Some(u64::MAX), ..options() }).unwrap();
    let bytes = (1 << 30).min(ctx.info().max_allocation);
    let mut held = Vec::new();
    let error = loop {
        match Buffer::new(&ctx, "huge", bytes, Memory::Upload) {
            Ok(buffer) => held.push(buffer),
            Err(error) => break error,
        }
        assert!(held.len() < 64, "{} buffers of {bytes} bytes were made", held.len());
    };
    println!("{} buffers, then {error}", held.len());
    match error {
        Error::OutOfMemory { resource, bytes: told } => {
            assert_eq!(resource, "huge");
            assert!(told >= Some(bytes), "{told:?} of {bytes}");
        }
        other => panic!("{other:?}"),
    }
    // Refused buffers leave no memory behind.
    drop(held);
    Buffer::new(&ctx, "small", 1 << 20, Memory::Upload).unwrap().write(0, &[1; 1 << 10]).unwrap();
    assert_silent(ctx.take_messages());
}

/// A driver for the processor takes its memory from the process.
#[cfg(target_os = "linux")]
#[test]
fn memory_that_runs_out_is_told_with_the_resource() {
    gpu_test(|ctx| {
        if ctx.info().device_type != vk::PhysicalDeviceType::CPU {
            return;
        }
        let output = std::process::Command::new("sh")
            .args(["-c", "ulimit -v 6000000 && exec \"$0\" --ignored --exact devices::with_little_memory --nocapture"])
            .arg(std::env::current_exe().unwrap())
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        println!("{text}");
        assert!(output.status.success() && text.contains("1 passed"), "{text}");
    });
}

/// Run by the test below in a process of its own, since the loader reads its environment once.
#[test]
#[ignore = "run by a_missing_driver_is_told_with_its_package in an environment without drivers"]
fn without_drivers() {
    let error = error(Context::headless(&ContextOptions::default()));
    assert!(matches!(error, Error::NoDevice(_)), "{error}");
    assert!(error.to_string().contains("mesa-vulkan-drivers"), "{error}");
}

#[test]
fn a_missing_driver_is_told_with_its_package() {
    let output = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--ignored", "--exact", "devices::without_drivers"])
        .env("VK_ICD_FILENAMES", "/nonexistent.json")
        .env("VK_DRIVER_FILES", "/nonexistent.json")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && text.contains("1 passed"), "{text}");
}
