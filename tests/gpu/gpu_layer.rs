//! The Vulkan layer itself: memory, kernels, recording, errors.

use ash::vk;
use lightsum::Error;
use lightsum::gpu::{
    Buffer, Context, ContextOptions, DeviceChoice, Image, Kernel, Memory, Snapshot, Timers, download, list_devices,
    upload,
};

use crate::support::{AWKWARD_SIZES, FillPush, SENTINEL, assert_silent, gpu_test, kernels, options};

/// The error of an operation that must fail.
pub fn error<T>(result: lightsum::Result<T>) -> Error {
    match result {
        Ok(_) => panic!("succeeded, but must fail"),
        Err(error) => error,
    }
}

pub fn fill_push(count: usize, scale: u32) -> FillPush {
    FillPush { count: u32::try_from(count).unwrap(), scale }
}

/// The result of `fill.wgsl` for equal values.
pub fn filled(count: usize, before: u32, scale: u32) -> Vec<u32> {
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
fn kernels_are_compiled_ahead_once_where_the_driver_puts_it_off() {
    gpu_test(|shared| {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("pipelines");
        let list = dir.path().join("pipelines.compiled");
        let compiled = |pipeline_cache| {
            let ctx = Context::headless(&ContextOptions { pipeline_cache, ..options() }).unwrap();
            let messages = ctx.messages();
            for shader in [&kernels::FILL, &kernels::REDUCE, &kernels::TEXTURE_SAMPLES] {
                Kernel::new(&ctx, shader).unwrap();
            }
            let count = ctx.compile_ahead().unwrap();
            drop(ctx);
            assert_silent(messages.take());
            count
        };
        assert_eq!(compiled(None), 0, "without a file to remember by");
        let all = if shared.info().driver == "llvmpipe" { 3 } else { 0 };
        assert_eq!((compiled(Some(path.clone())), compiled(Some(path.clone()))), (all, 0));
        if all > 0 {
            let lines = std::fs::read_to_string(&list).unwrap();
            let one = lines.lines().next().unwrap().to_owned();
            // A list that lacks a kernel, and one that is damaged.
            for (text, missing) in [(one, 2), (String::from("\u{0}?"), 3)] {
                std::fs::write(&list, text).unwrap();
                assert_eq!(compiled(Some(path.clone())), missing);
            }
        }
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
