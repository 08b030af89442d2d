//! The Vulkan layer itself: memory, kernels, recording, errors.

use ash::vk;
use lightsum::Error;
use lightsum::gpu::{
    Buffer, Context, ContextOptions, DeviceChoice, Image, Kernel, LayerPart, Memory, Snapshot, Timers, list_devices,
    shaders, upload,
};

use lightsum::conform::checks::kernels::fill_push;

use crate::support::{SENTINEL, assert_silent, gpu_test, kernels, options};

/// The error of an operation that must fail.
pub fn error<T>(result: lightsum::Result<T>) -> Error {
    match result {
        Ok(_) => panic!("succeeded, but must fail"),
        Err(error) => error,
    }
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
        let kernel = Kernel::new(ctx, &kernels::FILL).unwrap();
        let bindings = kernel.bind(&[("values", (&small).into())]).unwrap();
        let push = fill_push(1, 0);
        let outside = ctx.submit_and_wait("indirect", None, |rec| {
            rec.dispatch_indirect(&kernel, &bindings, bytemuck::bytes_of(&push), &small, 56)
        });
        assert!(error(outside).to_string().starts_with("small: "));
    });
}

#[test]
fn a_buffer_without_room_for_what_a_kernel_always_reads_is_refused() {
    gpu_test(|ctx| {
        let small = Buffer::new(ctx, "small", 16, Memory::Device).unwrap();
        let mut refused = 0;
        for shader in shaders::ALL {
            let Some(first) = shader.bindings.first().filter(|binding| binding.fixed_bytes > 16) else { continue };
            let kernel = Kernel::new(ctx, shader).unwrap();
            let message = error(kernel.bind(&[(first.name, (&small).into())])).to_string();
            let reads = format!("small has 16 bytes, and the kernel reads {}", first.fixed_bytes);
            assert!(message.ends_with(&reads), "{}: {message}", shader.name);
            refused += 1;
        }
        assert!(refused > 10, "{refused} kernels begin with a structure");
    });
}

#[test]
fn the_host_leaves_buffers_alone_that_commands_use() {
    gpu_test(|ctx| {
        let from = Buffer::new(ctx, "from", 64, Memory::Upload).unwrap();
        let to = Buffer::new(ctx, "to", 64, Memory::Readback).unwrap();
        let kernel = Kernel::new(ctx, &kernels::FILL).unwrap();
        let bindings = kernel.bind(&[("values", (&from).into())]).unwrap();
        from.write(0, &[7; 64]).unwrap();
        let is_refused = |message: String| assert!(message.contains("recorded commands use it"), "{message}");
        ctx.submit_and_wait("copy", None, |rec| {
            rec.copy(&from, &to)?;
            is_refused(error(from.clone().write(0, &[8; 64])).to_string());
            is_refused(error(to.read::<u8>()).to_string());
            Ok(())
        })
        .unwrap();
        assert_eq!(to.read::<u8>().unwrap(), [7; 64]);
        // By a kernel that it is bound to.
        ctx.submit_and_wait("fill", None, |rec| {
            rec.dispatch(&kernel, &bindings, bytemuck::bytes_of(&fill_push(1, 0)), 1)?;
            is_refused(error(from.write(0, &[8; 64])).to_string());
            Ok(())
        })
        .unwrap();
        from.write(0, &[9; 64]).unwrap();
        // By commands that were never executed.
        let abandoned = ctx.submit_and_wait("copy", None, |rec| {
            rec.copy(&from, &to)?;
            rec.copy_range(&from, 64, &to, 0, 64)
        });
        error(abandoned);
        from.write(0, &[9; 64]).unwrap();
    });
}

#[test]
fn timers_time_one_submission_at_a_time() {
    gpu_test(|ctx| {
        let timers = Timers::new(ctx, 4).unwrap();
        let own = Timers::new(ctx, 4).unwrap();
        ctx.submit_and_wait("outer", Some(&timers), |_| {
            let inner = std::thread::scope(|scope| {
                scope.spawn(|| ctx.submit_and_wait("inner", Some(&timers), |_| Ok(()))).join().unwrap()
            });
            assert_eq!(
                error(inner).to_string(),
                "inner: the timers time other commands; give these timers of their own"
            );
            ctx.submit_and_wait("beside", Some(&own), |_| Ok(()))
        })
        .unwrap();
        ctx.submit_and_wait("after", Some(&timers), |_| Ok(())).unwrap();
    });
}

#[test]
fn parts_of_layers_and_arguments_are_checked() {
    gpu_test(|ctx| {
        let image = Image::layered(ctx, "layers", 8, 8, 2).unwrap();
        let texels = Buffer::new(ctx, "texels", 256, Memory::Upload).unwrap();
        let whole = LayerPart { offset: 0, layer: 1, origin: [0; 2], size: [8, 8] };
        let wrong = [
            LayerPart { layer: 2, ..whole },
            LayerPart { origin: [1, 0], ..whole },
            LayerPart { origin: [u32::MAX, 0], ..whole },
            LayerPart { size: [8, u32::MAX], ..whole },
            LayerPart { size: [0, 8], ..whole },
            LayerPart { offset: 4, ..whole },
            LayerPart { offset: 2, size: [1, 1], ..whole },
            LayerPart { offset: u64::MAX, ..whole },
        ];
        ctx.submit_and_wait("layers", None, |rec| {
            rec.image_to_general(&image)?;
            wrong.iter().for_each(|&part| drop(error(rec.copy_to_layers(&texels, &image, &[part]))));
            rec.copy_to_layers(&texels, &image, &[whole])
        })
        .unwrap();
        let kernel = Kernel::new(ctx, &kernels::FILL).unwrap();
        let values = Buffer::new(ctx, "values", 64, Memory::Device).unwrap();
        let bindings = kernel.bind(&[("values", (&values).into())]).unwrap();
        let push = fill_push(1, 0);
        let by_host = ctx.submit_and_wait("indirect", None, |rec| {
            rec.dispatch_indirect(&kernel, &bindings, bytemuck::bytes_of(&push), &texels, 0)
        });
        assert!(error(by_host).to_string().contains("come from kernels"));
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
