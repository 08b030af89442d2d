//! One operation each of what drivers must do: copies, dispatches, barriers, subgroups, atomics, images.

use crate::conform::kernels::{self, FillPush};
use crate::conform::{Bench, Must, SENTINEL};
use crate::gpu::{Buffer, Image, Kernel, Memory, Shader, download, upload};
use ash::vk;

pub fn upload_and_download_give_the_same_back(bench: &Bench) {
    for size in bench.sizes() {
        let words: Vec<u32> = (0..size as u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
        let buffer = upload(bench, "words", &words).must();
        assert_eq!(buffer.bytes(), 4 * size as u64);
        assert_eq!(download::<u32>(bench, &buffer).must(), words);
        let bytes: Vec<u8> = (0..size).map(|i| i as u8).collect();
        let buffer = upload(bench, "bytes", &bytes).must();
        assert_eq!(download::<u8>(bench, &buffer).must(), bytes);
    }
    let nothing = upload::<u32>(bench, "nothing", &[]).must();
    assert!(download::<u32>(bench, &nothing).must().is_empty());
}

pub fn uploads_beyond_one_chunk_arrive_whole(bench: &Bench) {
    let words: Vec<u32> = (0..(65 << 20) / 4).collect();
    let buffer = upload(bench, "words", &words).must();
    assert!(download::<u32>(bench, &buffer).must() == words);
}

pub fn fill_push(count: usize, scale: u32) -> FillPush {
    FillPush { count: u32::try_from(count).unwrap(), scale }
}

/// The result of `fill.wgsl` for equal values.
pub fn filled(count: usize, before: u32, scale: u32) -> Vec<u32> {
    (0..count as u32).map(|i| before.wrapping_mul(scale).wrapping_add(i)).collect()
}

pub fn a_dispatch_touches_its_elements_and_no_others(bench: &Bench) {
    dispatch_touches_its_elements(bench, &kernels::FILL);
}

pub(super) fn dispatch_touches_its_elements(bench: &Bench, shader: &'static Shader) {
    let kernel = Kernel::new(bench, shader).must();
    for size in bench.sizes() {
        let values = Buffer::new(bench, "values", 4 * (size as u64 + 7), Memory::Device).must();
        let bindings = kernel.bind(&[("values", (&values).into())]).must();
        bench
            .submit_and_wait("fill", None, |rec| {
                rec.fill(&values, SENTINEL)?;
                rec.dispatch(&kernel, &bindings, bytemuck::bytes_of(&fill_push(size, 3)), size.div_ceil(64) as u64)
            })
            .must();
        let result = download::<u32>(bench, &values).must();
        assert_eq!(result[..size], filled(size, SENTINEL, 3));
        assert_eq!(result[size..], [SENTINEL; 7]);
    }
}

pub fn each_command_sees_what_those_before_it_wrote(bench: &Bench) {
    let kernel = Kernel::new(bench, &kernels::FILL).must();
    let size = 2049;
    let values = upload(bench, "values", &vec![1u32; size]).must();
    let copy = Buffer::new(bench, "copy", values.bytes(), Memory::Readback).must();
    let bindings = kernel.bind(&[("values", (&values).into())]).must();
    bench
        .submit_and_wait("chain", None, |rec| {
            let push = fill_push(size, 2);
            for _ in 0..3 {
                rec.dispatch(&kernel, &bindings, bytemuck::bytes_of(&push), 33)?;
            }
            rec.update(&values, 4 * 2048, &7u32.to_le_bytes())?;
            rec.copy(&values, &copy)
        })
        .must();
    // x -> 2x + i three times from 1: 8 + 7i.
    let mut expected: Vec<u32> = (0..size as u32).map(|i| 8 + 7 * i).collect();
    expected[2048] = 7;
    assert_eq!(copy.read::<u32>().must(), expected);
}

pub fn more_than_65535_workgroups_spread_over_two_axes(bench: &Bench) {
    let kernel = Kernel::new(bench, &kernels::FILL).must();
    let groups = 70_001u64;
    let size = groups as usize * 64 - 5;
    let values = Buffer::new(bench, "values", 4 * size as u64, Memory::Device).must();
    let bindings = kernel.bind(&[("values", (&values).into())]).must();
    bench
        .submit_and_wait("fill", None, |rec| {
            rec.fill(&values, SENTINEL)?;
            rec.dispatch(&kernel, &bindings, bytemuck::bytes_of(&fill_push(size, 0)), groups)
        })
        .must();
    assert!(download::<u32>(bench, &values).must() == filled(size, SENTINEL, 0));
}

pub fn indirect_dispatches_take_their_size_from_a_buffer(bench: &Bench) {
    let kernel = Kernel::new(bench, &kernels::FILL).must();
    let size = 2049;
    let values = Buffer::new(bench, "values", 4 * size as u64, Memory::Device).must();
    let args = Buffer::new(bench, "args", 16, Memory::Device).must();
    let bindings = kernel.bind(&[("values", (&values).into())]).must();
    let push = fill_push(size, 0);
    bench
        .submit_and_wait("indirect", None, |rec| {
            rec.fill(&values, SENTINEL)?;
            rec.update(&args, 4, bytemuck::cast_slice(&[10u32, 2, 1]))?;
            rec.dispatch_indirect(&kernel, &bindings, bytemuck::bytes_of(&push), &args, 4)
        })
        .must();
    let mut expected = filled(size, SENTINEL, 0);
    expected[20 * 64..].fill(SENTINEL);
    assert_eq!(download::<u32>(bench, &values).must(), expected);
}

pub fn subgroups_workgroup_memory_and_atomics_work_at_any_subgroup_size(bench: &Bench) {
    let kernel = Kernel::new(bench, &kernels::REDUCE).must();
    for size in bench.sizes() {
        let input: Vec<u32> = (0..size as u32).map(|i| i.wrapping_mul(2_654_435_761) >> 8).collect();
        let values = upload(bench, "values", &input).must();
        let sums = Buffer::new(bench, "sums", 16, Memory::Device).must();
        let bindings = kernel.bind(&[("totals", (&sums).into()), ("values", (&values).into())]).must();
        bench
            .submit_and_wait("reduce", None, |rec| {
                rec.update(&sums, 0, bytemuck::cast_slice(&[0, 0, SENTINEL, SENTINEL]))?;
                rec.dispatch(&kernel, &bindings, &(size as u32).to_le_bytes(), size.div_ceil(64) as u64)
            })
            .must();
        let sum = input.iter().copied().fold(0, u32::wrapping_add);
        let largest = input.iter().copied().max().unwrap_or(0);
        assert_eq!(download::<u32>(bench, &sums).must(), [sum, largest, SENTINEL, SENTINEL]);
    }
}

pub fn images_are_written_and_copied_out(bench: &Bench) {
    let kernel = Kernel::new(bench, &kernels::PAINT).must();
    let image = Image::new(bench, "film", 37, 5, vk::Format::R32G32B32A32_SFLOAT).must();
    let pixels = Buffer::new(bench, "pixels", image.bytes(), Memory::Readback).must();
    let bindings = kernel.bind(&[("film", (&image).into())]).must();
    bench
        .submit_and_wait("paint", None, |rec| {
            rec.image_to_general(&image)?;
            rec.dispatch(&kernel, &bindings, &[], 5)?;
            rec.copy_image_to_buffer(&image, &pixels)
        })
        .must();
    let expected: Vec<[f32; 4]> = (0..5).flat_map(|y| (0..37).map(move |x| [x as f32, y as f32, 0.5, 1.0])).collect();
    assert_eq!(pixels.read::<[f32; 4]>().must(), expected);
}
