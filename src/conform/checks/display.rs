//! `layer` and `display` against their oracles.

use crate::conform::tally::within;
use crate::conform::{Bench, Must};
use crate::film::Film;
use crate::gpu::{Buffer, Image, Memory, Staging, download};
use crate::output::{Tonemap, Wanted};
use crate::pass::display::{self, Curve, Display};
use crate::pass::layer::{self, Layer, ShowLayer};
use glam::{Vec3, Vec4};

use super::film::fill;

/// An empty film of some passes.
fn film(bench: &Bench, pixels: u32, counts: [u32; 2]) -> Film {
    let film = Film::new(bench, pixels, true).must();
    let mut staging = Staging::new();
    staging.stage_into(bench, &film.counts, 0, &[counts[0], counts[1], 0, 0]).must();
    bench
        .submit_and_wait("film", None, |rec| {
            film.buffers().try_for_each(|buffer| rec.fill(buffer, 0))?;
            staging.record(rec)
        })
        .must();
    film
}

fn texels<T: bytemuck::Pod>(
    bench: &Bench,
    image: &Image,
    record: impl FnOnce(&mut crate::gpu::Recorder) -> crate::Result<()>,
) -> Vec<T> {
    let readback = Buffer::new(bench, "texels", image.bytes(), Memory::Readback).must();
    bench
        .submit_and_wait("texels", None, |rec| {
            record(rec)?;
            rec.copy_image_to_buffer(image, &readback)
        })
        .must();
    readback.read().must()
}

/// A pattern whose sides differ.
const PATTERN: [u32; 2] = [3, 2];

pub fn layers_are_those_of_files(bench: &Bench) {
    for size in bench.images() {
        let pixels = size[0] * size[1];
        let film = film(bench, pixels, [3, 2]);
        let n = &mut bench.numbers(pixels);
        // Every fourth pixel sees nothing; half of another one is covered.
        let covered = |i: u32| if i % 4 == 3 { 0.0 } else { 2.0 };
        for color in &film.color {
            fill(bench, &color.0[0], n, 10.0, covered);
        }
        fill(bench, &film.direct.0[0], n, 5.0, |i| covered(i) * 3.0);
        let summands = film.summands.as_ref().unwrap();
        for sum in [&film.indirect, &film.albedo, &film.normal].into_iter().chain(summands) {
            fill(bench, &sum.0[0], n, 5.0, |_| 0.0);
            fill(bench, &sum.0[1], n, 1e-3, |_| 0.0);
        }
        // Of some pixels the filter is biased.
        fill(bench, &film.gain.0[0], n, 2.0, |i| if i % 2 == 0 { 0.5 } else { 50.0 });
        let files = film.mean(bench, size, Wanted::All).must();
        for wanted in Layer::ALL {
            let mut show = ShowLayer::new(bench, &film, size, wanted).must();
            let image = show.image.clone();
            let found: Vec<Vec4> = texels(bench, &image, |rec| show.record(rec, 2.5, PATTERN));
            for (pixel, found) in found.iter().enumerate() {
                let expected = layer::reference(&files, pixel, wanted, 2.5, PATTERN);
                let error = (found.truncate() - expected).abs().max_element();
                assert!(
                    within(error, 2e-5 * (1.0 + expected.length())),
                    "{wanted:?} {pixel} of {size:?}: {found} for {expected}"
                );
            }
            let lit = found.iter().filter(|texel| texel.truncate().length() > 0.0).count();
            assert!(lit * 2 > found.len(), "{wanted:?} of {size:?} is black");
        }
    }
    let plain = Film::new(bench, 4, false).must();
    let error = ShowLayer::new(bench, &plain, [2, 2], Layer::Diffuse).err().unwrap().to_string();
    assert!(error.contains("summands"), "{error}");
}

pub fn a_display_shows_what_png_files_hold(bench: &Bench) {
    for size in bench.images() {
        let film = film(bench, size[0] * size[1], [1, 0]);
        // From far below to far above what a display can show, and what no radiance should be.
        let value = |i: u32| match i % 97 {
            0 => Vec3::ZERO,
            1 => Vec3::new(-1.0, f32::NAN, f32::INFINITY),
            i => Vec3::new(i as f32 * 0.3 - 20.0, i as f32 * 0.2 - 10.0, 1.5 - i as f32 * 0.1).map(f32::exp2),
        };
        let values: Vec<Vec4> = (0..size[0] * size[1]).map(|i| value(i).extend(0.0)).collect();
        let mut staging = Staging::new();
        staging.stage_into(bench, &film.albedo.0[0], 0, &values).must();
        bench.submit_and_wait("radiance", None, |rec| staging.record(rec)).must();
        assert_eq!(download::<Vec4>(bench, &film.albedo.0[0]).must().len(), values.len());
        let mut show = ShowLayer::new(bench, &film, size, Layer::Albedo).must();
        let mut display = Display::new(bench, &show.image).must();
        let tones = [Tonemap::Srgb, Tonemap::Aces, Tonemap::Agx].map(Curve::Tone);
        for curve in tones.into_iter().chain([Curve::Linear]) {
            for stops in [0.0, -2.5, 3.0] {
                let shown = display.shown.clone();
                let found: Vec<[u8; 4]> = texels(bench, &shown, |rec| {
                    show.record(rec, 1.0, [1, 1])?;
                    display.record(rec, stops, curve)
                });
                for (i, found) in (0..).zip(found) {
                    let expected = display::reference(value(i), stops, curve) * 255.0;
                    let off = Vec3::from_array([0, 1, 2].map(|c| f32::from(found[c]))) - expected;
                    // Rounding, and half a unit for the functions of the device.
                    assert!(within(off.abs().max_element(), 1.0), "{curve:?} {stops} {i}: {found:?} for {expected}");
                    assert_eq!(found[3], 255);
                }
            }
        }
    }
}
