//! The Vulkan layer itself: memory, kernels, recording, errors.

use std::ffi::c_void;
use std::sync::atomic::{AtomicI32, Ordering};

use ash::vk;
use lightsum::Error;
use lightsum::gpu::{
    Buffer, Context, ContextOptions, DeviceChoice, HostDevice, Image, Kernel, Memory, Recorder, Requirements, Snapshot,
    Staging, Timers, download, list_devices, upload,
};

use crate::support::{AWKWARD_SIZES, FillPush, SENTINEL, assert_silent, gpu_test, kernels, options};

/// The error of an operation that must fail.
fn error<T>(result: lightsum::Result<T>) -> Error {
    match result {
        Ok(_) => panic!("succeeded, but must fail"),
        Err(error) => error,
    }
}

fn fill_push(count: usize, scale: u32) -> FillPush {
    FillPush { count: u32::try_from(count).unwrap(), scale }
}

/// The result of `fill.wgsl` for equal values.
fn filled(count: usize, before: u32, scale: u32) -> Vec<u32> {
    (0..count as u32).map(|i| before.wrapping_mul(scale).wrapping_add(i)).collect()
}

#[test]
fn upload_and_download_give_the_same_back() {
    gpu_test(|ctx| {
        for size in AWKWARD_SIZES {
            let words: Vec<u32> = (0..size as u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
            let buffer = upload(ctx, "words", &words).unwrap();
            assert_eq!(buffer.bytes(), 4 * size as u64);
            assert_eq!(download::<u32>(ctx, &buffer).unwrap(), words);
            let bytes: Vec<u8> = (0..size).map(|i| i as u8).collect();
            let buffer = upload(ctx, "bytes", &bytes).unwrap();
            assert_eq!(download::<u8>(ctx, &buffer).unwrap(), bytes);
        }
        let nothing = upload::<u32>(ctx, "nothing", &[]).unwrap();
        assert!(download::<u32>(ctx, &nothing).unwrap().is_empty());
    });
}

#[test]
fn uploads_beyond_one_chunk_arrive_whole() {
    gpu_test(|ctx| {
        let words: Vec<u32> = (0..(65 << 20) / 4).collect();
        let buffer = upload(ctx, "words", &words).unwrap();
        assert!(download::<u32>(ctx, &buffer).unwrap() == words);
    });
}

#[test]
fn a_dispatch_touches_its_elements_and_no_others() {
    gpu_test(|ctx| {
        let kernel = Kernel::new(ctx, &kernels::FILL).unwrap();
        for size in AWKWARD_SIZES {
            let values = Buffer::new(ctx, "values", 4 * (size as u64 + 7), Memory::Device).unwrap();
            let bindings = kernel.bind(&[("values", (&values).into())]).unwrap();
            ctx.submit_and_wait("fill", None, |rec| {
                rec.fill(&values, SENTINEL)?;
                rec.dispatch(&kernel, &bindings, bytemuck::bytes_of(&fill_push(size, 3)), size.div_ceil(64) as u64)
            })
            .unwrap();
            let result = download::<u32>(ctx, &values).unwrap();
            assert_eq!(result[..size], filled(size, SENTINEL, 3));
            assert_eq!(result[size..], [SENTINEL; 7]);
        }
    });
}

#[test]
fn each_command_sees_what_those_before_it_wrote() {
    gpu_test(|ctx| {
        let kernel = Kernel::new(ctx, &kernels::FILL).unwrap();
        let size = 2049;
        let values = upload(ctx, "values", &vec![1u32; size]).unwrap();
        let copy = Buffer::new(ctx, "copy", values.bytes(), Memory::Readback).unwrap();
        let bindings = kernel.bind(&[("values", (&values).into())]).unwrap();
        ctx.submit_and_wait("chain", None, |rec| {
            let push = fill_push(size, 2);
            for _ in 0..3 {
                rec.dispatch(&kernel, &bindings, bytemuck::bytes_of(&push), 33)?;
            }
            rec.update(&values, 4 * 2048, &7u32.to_le_bytes())?;
            rec.copy(&values, &copy)
        })
        .unwrap();
        // x -> 2x + i three times from 1: 8 + 7i.
        let mut expected: Vec<u32> = (0..size as u32).map(|i| 8 + 7 * i).collect();
        expected[2048] = 7;
        assert_eq!(copy.read::<u32>().unwrap(), expected);
    });
}

#[test]
fn more_than_65535_workgroups_spread_over_two_axes() {
    gpu_test(|ctx| {
        let kernel = Kernel::new(ctx, &kernels::FILL).unwrap();
        let groups = 70_001u64;
        let size = groups as usize * 64 - 5;
        let values = Buffer::new(ctx, "values", 4 * size as u64, Memory::Device).unwrap();
        let bindings = kernel.bind(&[("values", (&values).into())]).unwrap();
        ctx.submit_and_wait("fill", None, |rec| {
            rec.fill(&values, SENTINEL)?;
            rec.dispatch(&kernel, &bindings, bytemuck::bytes_of(&fill_push(size, 0)), groups)
        })
        .unwrap();
        assert!(download::<u32>(ctx, &values).unwrap() == filled(size, SENTINEL, 0));
    });
}

#[test]
fn too_many_workgroups_are_refused() {
    gpu_test(|ctx| {
        let kernel = Kernel::new(ctx, &kernels::FILL).unwrap();
        let values = Buffer::new(ctx, "values", 4, Memory::Device).unwrap();
        let bindings = kernel.bind(&[("values", (&values).into())]).unwrap();
        let push = fill_push(1, 1);
        let result = ctx
            .submit_and_wait("fill", None, |rec| rec.dispatch(&kernel, &bindings, bytemuck::bytes_of(&push), u64::MAX));
        assert!(error(result).to_string().contains("workgroups exceed"));
        // Zero workgroups are no error.
        ctx.submit_and_wait("fill", None, |rec| rec.dispatch(&kernel, &bindings, bytemuck::bytes_of(&push), 0))
            .unwrap();
    });
}

#[test]
fn indirect_dispatches_take_their_size_from_a_buffer() {
    gpu_test(|ctx| {
        let kernel = Kernel::new(ctx, &kernels::FILL).unwrap();
        let size = 2049;
        let values = Buffer::new(ctx, "values", 4 * size as u64, Memory::Device).unwrap();
        let args = Buffer::new(ctx, "args", 16, Memory::Device).unwrap();
        let bindings = kernel.bind(&[("values", (&values).into())]).unwrap();
        let push = fill_push(size, 0);
        ctx.submit_and_wait("indirect", None, |rec| {
            rec.fill(&values, SENTINEL)?;
            rec.update(&args, 4, bytemuck::cast_slice(&[10u32, 2, 1]))?;
            rec.dispatch_indirect(&kernel, &bindings, bytemuck::bytes_of(&push), &args, 4)
        })
        .unwrap();
        let mut expected = filled(size, SENTINEL, 0);
        expected[20 * 64..].fill(SENTINEL);
        assert_eq!(download::<u32>(ctx, &values).unwrap(), expected);
        let outside = ctx.submit_and_wait("indirect", None, |rec| {
            rec.dispatch_indirect(&kernel, &bindings, bytemuck::bytes_of(&push), &args, 8)
        });
        assert!(error(outside).to_string().starts_with("args: "));
    });
}

#[test]
fn subgroups_workgroup_memory_and_atomics_work_at_any_subgroup_size() {
    gpu_test(|ctx| {
        let kernel = Kernel::new(ctx, &kernels::REDUCE).unwrap();
        for size in AWKWARD_SIZES {
            let input: Vec<u32> = (0..size as u32).map(|i| i.wrapping_mul(2_654_435_761) >> 8).collect();
            let values = upload(ctx, "values", &input).unwrap();
            let sums = Buffer::new(ctx, "sums", 16, Memory::Device).unwrap();
            let bindings = kernel.bind(&[("totals", (&sums).into()), ("values", (&values).into())]).unwrap();
            ctx.submit_and_wait("reduce", None, |rec| {
                rec.update(&sums, 0, bytemuck::cast_slice(&[0, 0, SENTINEL, SENTINEL]))?;
                rec.dispatch(&kernel, &bindings, &(size as u32).to_le_bytes(), size.div_ceil(64) as u64)
            })
            .unwrap();
            let sum = input.iter().copied().fold(0, u32::wrapping_add);
            let largest = input.iter().copied().max().unwrap();
            assert_eq!(download::<u32>(ctx, &sums).unwrap(), [sum, largest, SENTINEL, SENTINEL]);
        }
    });
}

#[test]
fn images_are_written_and_copied_out() {
    gpu_test(|ctx| {
        let kernel = Kernel::new(ctx, &kernels::PAINT).unwrap();
        let image = Image::new(ctx, "film", 37, 5, vk::Format::R32G32B32A32_SFLOAT).unwrap();
        let pixels = Buffer::new(ctx, "pixels", image.bytes(), Memory::Readback).unwrap();
        let bindings = kernel.bind(&[("film", (&image).into())]).unwrap();
        ctx.submit_and_wait("paint", None, |rec| {
            rec.image_to_general(&image)?;
            rec.dispatch(&kernel, &bindings, &[], 5)?;
            rec.copy_image_to_buffer(&image, &pixels)
        })
        .unwrap();
        let expected: Vec<[f32; 4]> =
            (0..5).flat_map(|y| (0..37).map(move |x| [x as f32, y as f32, 0.5, 1.0])).collect();
        assert_eq!(pixels.read::<[f32; 4]>().unwrap(), expected);
    });
}

#[test]
fn timers_sum_by_name_in_order() {
    gpu_test(|ctx| {
        let kernel = Kernel::new(ctx, &kernels::FILL).unwrap();
        let size = 1 << 20;
        let values = upload(ctx, "values", &vec![1u32; size]).unwrap();
        let bindings = kernel.bind(&[("values", (&values).into())]).unwrap();
        let timers = Timers::new(ctx, 8).unwrap();
        assert!(timers.read().unwrap().is_empty());
        for _ in 0..2 {
            ctx.submit_and_wait("timed", Some(&timers), |rec| {
                for name in ["second", "first", "second"] {
                    rec.scope(name, |rec| {
                        rec.dispatch(&kernel, &bindings, bytemuck::bytes_of(&fill_push(size, 2)), size as u64 / 64)
                    })?;
                }
                Ok(())
            })
            .unwrap();
            let times = timers.read().unwrap();
            if !ctx.info().timestamps {
                assert!(times.is_empty());
                continue;
            }
            assert_eq!(times.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["second", "first"]);
            assert!(times.iter().all(|(_, seconds)| *seconds > 0.0 && *seconds < 60.0), "{times:?}");
        }
    });
}

#[test]
fn bindings_are_named_exactly_once() {
    gpu_test(|ctx| {
        let kernel = Kernel::new(ctx, &kernels::FILL).unwrap();
        let buffer = Buffer::new(ctx, "buffer", 64, Memory::Device).unwrap();
        let image = Image::new(ctx, "image", 4, 4, vk::Format::R32_SFLOAT).unwrap();
        let message = |resources: &[_]| error(kernel.bind(resources)).to_string();
        assert_eq!(message(&[]), "shader fill: binding values is missing");
        assert_eq!(
            message(&[("values", (&buffer).into()), ("value", (&buffer).into())]),
            "shader fill: has no binding value"
        );
        assert_eq!(
            message(&[("values", (&buffer).into()), ("values", (&buffer).into())]),
            "shader fill: binding values is named twice"
        );
        assert_eq!(
            message(&[("values", (&image).into())]),
            "shader fill: binding values: wants a buffer, but image is an image"
        );
        let bindings = kernel.bind(&[("values", (&buffer).into())]).unwrap();
        let short = ctx.submit_and_wait("fill", None, |rec| rec.dispatch(&kernel, &bindings, &[0; 4], 1));
        assert_eq!(error(short).to_string(), "shader fill: 4 bytes of push constants, 8 are declared");
        let other = Kernel::new(ctx, &kernels::PAINT).unwrap();
        let foreign = ctx.submit_and_wait("paint", None, |rec| rec.dispatch(&other, &bindings, &[], 1));
        assert_eq!(error(foreign).to_string(), "shader paint: the bindings are those of fill");
    });
}

#[test]
fn buffers_beyond_a_limit_or_range_are_refused() {
    gpu_test(|ctx| {
        let limit = ctx.info().max_storage_buffer_range;
        match error(Buffer::new(ctx, "huge", limit + 4, Memory::Device)) {
            Error::DeviceLimit { resource, limit: told, limit_name, .. } => {
                assert_eq!((resource.as_str(), told, limit_name), ("huge", limit, "maxStorageBufferRange"));
            }
            other => panic!("{other}"),
        }
        match error(Buffer::new(ctx, "vast", ctx.info().max_allocation / 4 * 4 + 4, Memory::Upload)) {
            Error::DeviceLimit { limit_name, .. } => assert_eq!(limit_name, "maxMemoryAllocationSize"),
            other => panic!("{other}"),
        }
        let small = Buffer::new(ctx, "small", 64, Memory::Upload).unwrap();
        assert!(error(small.write(60, &[0; 8])).to_string().starts_with("small: "));
        assert!(error(small.read::<u32>()).to_string().contains("Memory::Readback"));
        let outside = ctx.submit_and_wait("copy", None, |rec| rec.copy_range(&small, 32, &small, 0, 64));
        assert!(error(outside).to_string().starts_with("small: "));
    });
}

#[test]
fn an_unknown_device_is_told_with_the_known_ones() {
    gpu_test(|ctx| {
        let ask = |device| {
            let message = error(Context::headless(&ContextOptions { device, ..Default::default() })).to_string();
            assert!(message.contains(&ctx.info().name), "{message} does not list {}", ctx.info().name);
            message
        };
        assert!(ask(DeviceChoice::Name("no such device".into())).contains("no such device"));
        assert!(ask(DeviceChoice::Index(99)).contains("there is no device 99"));
        let listed = list_devices().unwrap();
        assert!(listed.iter().any(|device| device.name == ctx.info().name));
        // A part of the name in different case matches.
        let name = DeviceChoice::Name(ctx.info().name.to_uppercase());
        let found = Context::headless(&ContextOptions { device: name, ..Default::default() }).unwrap();
        assert_eq!(found.info().name, ctx.info().name);
    });
}

#[test]
fn device_choices_are_parsed() {
    for (text, choice) in [
        ("auto", DeviceChoice::Auto),
        ("CPU", DeviceChoice::Cpu),
        (" 2 ", DeviceChoice::Index(2)),
        ("GeForce 3080", DeviceChoice::Name("GeForce 3080".into())),
    ] {
        assert_eq!(text.parse::<DeviceChoice>().unwrap(), choice);
    }
    assert!(matches!("".parse::<DeviceChoice>(), Err(Error::Setting { name: "device", .. })));
}

#[test]
fn a_snapshot_gives_any_piece_and_refuses_what_is_not_there() {
    gpu_test(|ctx| {
        let words: Vec<u32> = (0..1000u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
        let buffer = upload(ctx, "words", &words).unwrap();
        let snapshot = Snapshot::new(ctx, &buffer).unwrap();
        for (first, count) in [(0, 1000), (1, 7), (999, 1), (1000, 0)] {
            let mut piece = vec![SENTINEL; count];
            snapshot.copy(first, &mut piece).unwrap();
            assert_eq!(piece, words[first..first + count]);
        }
        let message = error(snapshot.copy(999, &mut [SENTINEL; 2])).to_string();
        assert!(message.contains("words"), "{message}");
    });
}

#[test]
fn pipelines_are_cached_in_a_file_that_may_be_damaged() {
    gpu_test(|_| {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("pipelines");
        let run = || {
            let ctx = Context::headless(&ContextOptions { pipeline_cache: Some(path.clone()), ..options() }).unwrap();
            Kernel::new(&ctx, &kernels::FILL).unwrap();
            ctx.make_pipelines().unwrap();
            let messages = ctx.messages();
            drop(ctx);
            assert_silent(messages.take());
        };
        run();
        let saved = std::fs::read(&path).unwrap();
        run();
        let mut damaged = saved.clone();
        *damaged.last_mut().unwrap() ^= 1;
        for bad in [&damaged[..], &saved[..9], b"", b"something else"] {
            std::fs::write(&path, bad).unwrap();
            run();
            assert!(std::fs::read(&path).unwrap().starts_with(b"LSPIPES1"), "not written anew");
        }
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "something was left beside the file");
    });
}

#[test]
fn a_pipeline_is_made_when_it_is_first_needed_and_once() {
    gpu_test(|_| {
        let ctx = Context::headless(&options()).unwrap();
        let messages = ctx.messages();
        let [fill, reduce] = [&kernels::FILL, &kernels::REDUCE].map(|shader| Kernel::new(&ctx, shader).unwrap());
        assert_eq!(ctx.pipeline_count(), 0, "binding needs none");
        let values = upload(&ctx, "values", &[SENTINEL; 27]).unwrap();
        let bindings = fill.bind(&[("values", (&values).into())]).unwrap();
        let push = vec![0; fill.shader().push_bytes as usize];
        for _ in 0..2 {
            ctx.submit_and_wait("fill", None, |rec| rec.dispatch(&fill, &bindings, &push, 1)).unwrap();
            assert_eq!(ctx.pipeline_count(), 1, "the kernel that ran");
        }
        // Several threads want the same pipeline.
        std::thread::scope(|scope| (0..4).for_each(|_| _ = scope.spawn(|| ctx.make_pipelines().unwrap())));
        assert_eq!(ctx.pipeline_count(), 2, "and {}", reduce.name());
        drop((ctx, fill, reduce, values, bindings));
        assert_silent(messages.take());
    });
}

#[test]
fn nothing_is_left_when_a_context_goes() {
    gpu_test(|_| {
        let ctx = Context::headless(&options()).unwrap();
        let messages = ctx.messages();
        let kernel = Kernel::new(&ctx, &kernels::FILL).unwrap();
        let values = upload(&ctx, "values", &[SENTINEL; 27]).unwrap();
        let _image = Image::new(&ctx, "image", 8, 8, vk::Format::R16G16B16A16_SFLOAT).unwrap();
        let _timers = Timers::new(&ctx, 2).unwrap();
        let bindings = kernel.bind(&[("values", (&values).into())]).unwrap();
        // The context is destroyed with the last object, in whatever order they are dropped.
        drop(ctx);
        drop(kernel);
        drop(values);
        drop(bindings);
        drop((_image, _timers));
        assert_silent(messages.take());
    });
}

/// A context of its own, since its messages would fail other tests.
#[test]
fn the_validation_layer_is_heard() {
    gpu_test(|_| {
        let ctx = Context::headless(&options()).unwrap();
        let a = Buffer::new(&ctx, "a", 64, Memory::Device).unwrap();
        let b = Buffer::new(&ctx, "b", 64, Memory::Device).unwrap();
        ctx.submit_and_wait("copies", None, |rec| rec.copy(&a, &b)).unwrap();
        assert_silent(ctx.take_messages());
        // Two copies into the same bytes without a barrier: synchronisation validation must report it.
        let device = ctx.raw_device();
        ctx.submit_and_wait("hazard", None, |rec| {
            let region = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: 64 }];
            // SAFETY: valid handles; only the barrier is missing, on purpose.
            unsafe {
                device.cmd_copy_buffer(rec.command_buffer(), a.handle(), b.handle(), &region);
                device.cmd_copy_buffer(rec.command_buffer(), a.handle(), b.handle(), &region);
            }
            Ok(())
        })
        .unwrap();
        let messages = ctx.take_messages();
        assert!(messages.iter().any(|message| message.contains("WRITE_AFTER_WRITE")), "heard only {messages:?}");
    });
}

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
                        assert!(text.starts_with(&format!("the device was lost {name}: ")), "{text}");
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
                        assert!(name != "rays" || bytes == 1000, "{bytes}");
                        assert!(text.starts_with(&format!("{name}: no memory for {bytes} bytes; lower ")), "{text}");
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
    let ctx = Context::headless(&options()).unwrap();
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
            assert!(told >= bytes, "{told} of {bytes}");
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
            .args([
                "-c",
                "ulimit -v 6000000 && exec \"$0\" --ignored --exact gpu_layer::with_little_memory --nocapture",
            ])
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
        .args(["--ignored", "--exact", "gpu_layer::without_drivers"])
        .env("VK_ICD_FILENAMES", "/nonexistent.json")
        .env("VK_DRIVER_FILES", "/nonexistent.json")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && text.contains("1 passed"), "{text}");
}

#[test]
fn every_permutation_becomes_a_pipeline_or_is_refused_with_the_reason() {
    gpu_test(|ctx| {
        let shaders = lightsum::gpu::shaders::ALL;
        assert!(shaders.len() > 100, "permutations are missing from {}", shaders.len());
        let refused: Vec<String> = (shaders.iter().filter_map(|shader| Kernel::new(ctx, shader).err()))
            .map(|error| error.to_string())
            .collect();
        // Kernels that walk trees by subgroups need ballots, which no other kernel does.
        assert!(refused.iter().all(|message| message.contains("subgroup operations")), "{refused:#?}");
        let clusters =
            shaders.iter().filter(|shader| shader.name.contains("cluster_") || shader.name.contains("counters"));
        assert!(refused.is_empty() || refused.len() == clusters.count(), "{refused:#?}");
        ctx.make_pipelines().unwrap();
        assert!(ctx.pipeline_count() + refused.len() >= shaders.len(), "the context keeps them");
    });
}
