//! Packed points of tasks, unpacked by the device, against their oracle.

use glam::Vec4;

use crate::cluster::points::{PassPoints, PointReader, Shape, TaskPoints};
use crate::conform::rig::{Rig, STRAYS, Tally, gallery, has, orthographic};
use crate::conform::{Bench, Must};
use crate::frame::MORE_WORDS;
use crate::gpu::Staging;
use crate::pass::ShadingPoints;
use crate::sampling::random::key;
use crate::settings::Settings;
use crate::view::Task;

/// Arrays of `Frame::point_buffers`, by what may be rounded in the first three components; the last one's bits are told but for depths.
const POSITION: usize = 0;
const WO: usize = 5;
const THROUGHPUT: usize = 7;

pub fn packed_points_follow_their_oracle(bench: &Bench) {
    let (gallery, from_afar) = (gallery(), orthographic(gallery()));
    let (mut plain, mut through, mut second, mut none, mut further) = (0, 0, 0, 0, [0; 2]);
    for ((i, size), scene) in bench.images().enumerate().flat_map(|image| [(image, &gallery), (image, &from_afar)]) {
        // Hits of eye rays and classes in some images.
        let (antialias, pattern) = (i % 2 == 0, if i % 3 == 0 { [3, 2] } else { [1, 1] });
        // Caustics apart from other light in those images.
        let (filter, interleave_photons) = (Settings::default().filter.filter(|_| antialias), !antialias);
        let settings = Settings { particles: 3, antialias, pattern, filter, interleave_photons, ..Settings::plain() };
        let rig = bench.rig_at_pass(scene, size, settings, i as u32);
        rig.light();
        fill_further(&rig, i as u32);
        let shape = Shape::of(&rig.engine);
        let (mut points, mut expected) = (PassPoints::new(shape).unpacked_on_device(true), Vec::new());
        for task in Task::cut(rig.engine.settings(), size, 5) {
            let reader = PointReader::new(rig.ctx, &rig.engine, &task).must();
            rig.run(|frame, rec| reader.record(rec, frame));
            let packed = reader.read(&rig.engine).must().pack(&shape, &rig.parameters);
            points.take_packed(task, &packed).must();
            expected.push(TaskPoints::unpack(task, &shape, &packed).must());
        }
        let [by_slot, by_pixel] = rig.frame().point_buffers();
        rig.prefill(&by_slot);
        rig.prefill(&by_pixel);
        rig.frame().more_buffers().iter().flatten().for_each(|(buffer, _)| rig.prefill(&[buffer]));
        let taken = points.stage(rig.ctx, rig.frame()).must();
        assert!(taken.unpacks(), "the device was to unpack them");
        rig.run(|_, rec| taken.record(rec));
        let values: Vec<Vec<Vec4>> = by_slot.iter().map(|buffer| rig.vec4s(buffer)).collect();
        let hits: Vec<Vec<[u32; 2]>> = by_pixel.iter().map(|buffer| rig.get(buffer)).collect();

        let (pixels, scale) = (shape.size[0] as usize * shape.size[1] as usize, rig.parameters.eye[3]);
        let mut tally = Tally::new(format!("packed points, {size:?}"));
        for task in &expected {
            let slots = task.slots(&shape);
            let own = slots.iter().filter(|&&slot| slot < pixels).count();
            for (array, found) in hits.iter().enumerate() {
                for (&pixel, expected) in slots[..own].iter().zip(&task.hits[array * own..]) {
                    let found = found[pixel];
                    tally
                        .check(found == *expected, || format!("hit {array} of pixel {pixel}: {found:?}, {expected:?}"));
                }
            }
            for (array, found) in values.iter().enumerate() {
                for (&slot, expected) in slots.iter().zip(&task.values[array * slots.len()..]) {
                    let (found, expected) = (found[slot], Vec4::from(expected.map(f32::from_bits)));
                    let [a, b] = [found, expected].map(Vec4::truncate);
                    let most = if array == POSITION { 2e-6 * scale } else { 2e-6 * (1e-30 + b.abs().max_element()) };
                    let last = match array {
                        THROUGHPUT => (found.w - expected.w).abs() <= 2e-6 * expected.w.abs(),
                        _ => found.w.to_bits() == expected.w.to_bits(),
                    };
                    let same = (a - b).abs().max_element() <= most && last;
                    tally.check_values(same, &[(a, b)], || format!("array {array}, slot {slot}: {found}, {expected}"));
                    if array == WO {
                        second += u32::from(slot >= pixels);
                        let by_specular = has(expected, ShadingPoints::SEEN_BY_SPECULAR);
                        through += u32::from(slot < pixels && by_specular);
                        plain += u32::from(slot < pixels && !by_specular);
                    }
                }
            }
        }
        // Further words have their bits, but for what nothing reads.
        for (array, buffer) in rig.frame().more_buffers().iter().enumerate() {
            let Some((buffer, at)) = buffer else { continue };
            let (all, of_pixel) = (rig.get::<u32>(buffer), shape.more[array]);
            for (pixel, words) in expected.iter().flat_map(|task| task.further(&shape, array)) {
                let found = &all[(at / 4) as usize + of_pixel * pixel..][..of_pixel];
                let nothing = words.iter().all(|&word| word == 0);
                further[usize::from(nothing)] += 1;
                tally.check(found == words, || format!("array {array}, pixel {pixel}: {found:?}, {words:?}"));
            }
        }
        // Nobody's second components are none, whatever was there.
        let mut others = vec![true; values[WO].len()];
        expected.iter().flat_map(|task| task.slots(&shape)).for_each(|slot| others[slot] = false);
        for (slot, _) in others.iter().enumerate().filter(|(_, others)| **others) {
            none += 1;
            tally.check(values.iter().all(|array| array[slot] == Vec4::ZERO), || format!("slot {slot} of nobody"));
        }
        tally.finish(STRAYS);
    }
    bench.covered(
        plain > 1000 && through > 100 && second > 100 && none > 100 && further.iter().all(|&count| count > 500),
        format_args!(
            "{plain} seen directly, {through} through mirrors and glass, {second} second components, {none} of nobody, {further:?} with and without further words"
        ),
    );
}

/// Fills further arrays with words, of a third of the pixels.
fn fill_further(rig: &Rig, number: u32) {
    let mut staging = Staging::new();
    for (array, buffer) in (0..).zip(rig.frame().more_buffers()) {
        let (Some((buffer, at)), words) = (buffer, MORE_WORDS[array as usize]) else { continue };
        let [width, height, ..] = rig.parameters.size;
        let word = |i: u32| {
            let has = key(number, array, i / words as u32, 0).is_multiple_of(3);
            if has { key(number, array, i, 1) } else { 0 }
        };
        let all: Vec<u32> = (0..width * height * words as u32).map(word).collect();
        staging.stage_into(rig.ctx, buffer, at, &all).must();
    }
    rig.run(|_, rec| staging.record(rec));
}
