//! The film's passes, `accumulate`, `resolve` and `probe`, against their oracles.

use crate::conform::tally::within;
use crate::conform::{Bench, Must};
use crate::film::{Film, GUIDE_UNIT, Sum};
use crate::gpu::{Buffer, Context, Image, Memory, Resources, Staging, download, upload};
use crate::pass::accumulate::{self, Accumulate};
use crate::pass::finite::{self, Finite};
use crate::pass::gain;
use crate::pass::layout;
use crate::pass::probe::{self, Probe};
use crate::pass::resolve::Resolve;
use crate::pass::{EyePathState, Lighting, ShadingPoints};
use ash::vk;
use glam::{DVec4, Vec3, Vec4};

use crate::conform::Numbers;
use crate::conform::rig::make;

/// The inputs and outputs of `merge` and `accumulate`, for `pixels` pixels of arbitrary content, each of two
/// components.
pub struct Sheet {
    pub frame: Buffer,
    pub receivers: ShadingPoints,
    pub paths: EyePathState,
    pub sums: Lighting,
    pub film: Film,
}

impl Sheet {
    pub fn new(ctx: &Context, [width, height]: [u32; 2], passes: u32) -> Sheet {
        let pixels = width * height;
        let parameters = layout::FrameParameters {
            size: [width, height, pixels, 0],
            within: [0, 0, width, height],
            pixel_offset: [0.0, 0.0, 0.25, 1.0 / passes as f32],
            ..layout::FrameParameters::default()
        };
        Sheet {
            frame: upload(ctx, "parameters", &[parameters]).must(),
            receivers: ShadingPoints::new(ctx, "test", 2 * pixels).must(),
            paths: EyePathState::new(ctx, 2 * pixels, 0).must(),
            sums: Lighting::new(ctx, "test", 2 * pixels).must(),
            film: Film::new(ctx, pixels, true).must(),
        }
    }

    fn accumulate(&self, bench: &Bench, status: &Buffer) -> Accumulate {
        let shared = Resources::of([("frame", &self.frame), ("status", status)]);
        make(bench, shared, |kit| Accumulate::new(kit, &self.receivers, &self.paths, &self.sums, &self.film))
    }
}

/// Whether each component of an error is within its bound.
fn all_within(error: DVec4, bound: DVec4) -> bool {
    (0..4).all(|k| within(error[k], bound[k]))
}

/// Fills a buffer with numbers up to `scale` and the w components from `w`; returns them.
pub fn fill(ctx: &Context, buffer: &Buffer, numbers: &mut Numbers, scale: f32, w: impl Fn(u32) -> f32) -> Vec<Vec4> {
    let count = (buffer.bytes() / 16) as u32;
    let values: Vec<Vec4> = (0..count).map(|i| (numbers.vec3() * scale).extend(w(i))).collect();
    let mut staging = Staging::new();
    staging.stage_into(ctx, buffer, 0, &values).must();
    ctx.submit_and_wait("fill", None, |rec| staging.record(rec)).must();
    values
}

pub fn accumulate_loses_nothing_over_thousands_of_passes(bench: &Bench) {
    const PASSES: u32 = 3000;
    for size in bench.sizes() {
        let s = Sheet::new(bench, [size as u32, 1], PASSES);
        let (r, n) = (&s.receivers, &mut bench.numbers(size as u32));
        // Every third pixel sees nothing; every fifth is not lit, and its sums must be ignored; every seventh looks
        // into a mirror that reflects the background.
        let covered = |i: u32| i % 3 != 2;
        let lit = |i: u32| i % 5 != 4;
        let ends = |i: u32| covered(i) && i % 7 != 6;
        let flags = |i: u32| {
            let all =
                [(ShadingPoints::COVERED, covered(i)), (ShadingPoints::LIT, lit(i)), (ShadingPoints::HIT, ends(i))];
            ShadingPoints::word(all.into_iter().filter(|f| f.1).map(|f| f.0).sum())
        };
        const DEPTH: f32 = 2.5;
        let through = fill(bench, &s.paths.throughput, n, 1.0, |_| DEPTH);
        let shading = fill(bench, &r.shading, n, 1.0, |_| 0.0);
        let kd = fill(bench, &r.kd, n, 1.0, |_| 1.0);
        let f0 = fill(bench, &r.f0, n, 1.0, |_| 1.0);
        fill(bench, &r.wo, n, -1.0, flags);
        // Tiny compared with the large sums: each alone would be rounded away.
        let emitted = fill(bench, &r.emitted, n, 1e-5, |_| 0.0);
        let light = [&s.sums.direct, &s.sums.indirect, &s.sums.specular].map(|b| fill(bench, b, n, 1e-5, |_| 0.0));
        let large = [&s.film.color[1], &s.film.direct, &s.film.indirect].map(|sum| {
            let large = fill(bench, &sum.0[0], n, 1000.0, |_| 0.0);
            let small = fill(bench, &sum.0[1], n, 1e-5, |_| 0.0);
            large.into_iter().zip(small).map(|(a, b)| a.as_dvec4() + b.as_dvec4()).collect::<Vec<_>>()
        });
        let status = upload(bench, "status", &[0u32, 0, 0, 0]).must();
        let pass = s.accumulate(bench, &status);
        bench
            .submit_and_wait("accumulate", None, |rec| {
                for sum in [&s.film.color[1], &s.film.direct, &s.film.indirect] {
                    rec.fill(&sum.0[2], 0)?;
                }
                s.film.albedo.0.iter().chain(&s.film.normal.0).try_for_each(|b| rec.fill(b, 0))?;
                s.film.color[0].0.iter().try_for_each(|b| rec.fill(b, 7))?;
                (0..PASSES).try_for_each(|_| pass.record(rec, 1))
            })
            .must();
        let get = |b: &Buffer| download::<Vec4>(bench, b).must();
        let levels = |sum: &Sum| sum.0.iter().map(get).collect::<Vec<_>>();
        let [color, direct, indirect] = [&s.film.color[1], &s.film.direct, &s.film.indirect].map(levels);
        let (albedo, normal) = (levels(&s.film.albedo), levels(&s.film.normal));
        let total = |sum: &[Vec<Vec4>], i: usize| sum.iter().map(|level| level[i].as_dvec4()).sum::<DVec4>();
        for i in 0..size {
            let is_lit = lit(i as u32);
            let light = [0, 1, 2].map(|k| if is_lit { light[k][i].truncate() } else { Vec3::ZERO });
            let beta = through[i].truncate();
            let radiance = accumulate::reference(emitted[i].truncate(), beta, kd[i].truncate(), light);
            let one_if = |yes: bool| if yes { 1.0 } else { 0.0 };
            let covered = one_if(covered(i as u32));
            let shown = one_if(ends(i as u32));
            for (name, sum, start, x) in [
                ("color", &color, large[0][i], radiance.extend(covered)),
                ("direct", &direct, large[1][i], light[0].extend(covered * DEPTH)),
                ("indirect", &indirect, large[2][i], light[1].extend(0.0)),
            ] {
                let found = total(sum, i);
                let exact = start + x.as_dvec4() * f64::from(PASSES);
                // The sum is exact; the addends are known to a few ulp, PASSES times over.
                let error = (found - exact).abs();
                let bound = exact.abs() * f64::EPSILON * 8.0 + x.as_dvec4().abs() * f64::from(PASSES) * 1e-6;
                assert!(all_within(error, bound), "{name} of pixel {i} of {size}: {found} for {exact}");
            }
            let guides = [
                (total(&albedo, i), (beta * (kd[i].truncate() + f0[i].truncate())).extend(0.0)),
                (total(&normal, i), (shading[i].truncate() * shown).extend(0.0)),
            ];
            for (found, one) in guides {
                let expected = one.as_dvec4() * f64::from(PASSES);
                // An addend is off by half a unit and a few ulp.
                let bound = expected.abs() * 1e-6 + f64::from(PASSES) * f64::from(GUIDE_UNIT);
                assert!(all_within(found - expected, bound), "{found} for {expected}");
            }
        }
        let other = levels(&s.film.color[0]);
        let seven = |v: &Vec4| v.to_array().iter().all(|x| x.to_bits() == 7);
        assert!(other.iter().flatten().all(seven), "the other instance is left alone");
    }
}

/// Values that make a pixel no number, and some that do not.
const EXTREME: [f32; 6] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 3e38, 1e29, -3e30];

/// Fills a buffer with numbers below 1 and w components from `w`, and one in 40 of the components with extreme values; returns them.
fn spoil(bench: &Bench, buffer: &Buffer, n: &mut Numbers, w: impl Fn(u32) -> f32) -> Vec<Vec4> {
    let mut values = fill(bench, buffer, n, 1.0, w);
    for value in &mut values {
        for axis in 0..3 {
            let (chance, which) = (n.next(), n.next());
            if chance < 0.025 {
                value[axis] = EXTREME[(which * EXTREME.len() as f32) as usize];
            }
        }
    }
    let mut staging = Staging::new();
    staging.stage_into(bench, buffer, 0, &values).must();
    bench.submit_and_wait("spoil", None, |rec| staging.record(rec)).must();
    values
}

pub fn finite_counts_the_pixels_that_are_no_numbers(bench: &Bench) {
    let mut kinds = [0; 2];
    for size in bench.images() {
        let s = Sheet::new(bench, size, 1);
        let (r, n, pixels) = (&s.receivers, &mut bench.numbers(size[0]), size[0] * size[1]);
        let summands = size[0] % 2 == 1;
        let (covered, lit) = (|i: u32| i % 3 != 2, |i: u32| i % 5 != 4);
        let flags = |i: u32| {
            let all = [(ShadingPoints::COVERED, covered(i)), (ShadingPoints::LIT, lit(i))];
            ShadingPoints::word(all.into_iter().filter(|f| f.1).map(|f| f.0).sum())
        };
        let depth = |i: u32| if i % 101 == 100 { f32::INFINITY } else { 2.5 };
        fill(bench, &r.wo, n, 1.0, flags);
        let through = spoil(bench, &s.paths.throughput, n, depth);
        let [kd, emitted] = [&r.kd, &r.emitted].map(|b| spoil(bench, b, n, |_| 0.0));
        let light = [&s.sums.direct, &s.sums.indirect, &s.sums.specular].map(|b| spoil(bench, b, n, |_| f32::NAN));
        let shown = Buffer::new(bench, "shown", 16 * u64::from(pixels), Memory::Device).must();
        let more = spoil(bench, &shown, n, |_| f32::NAN);

        let one_if = |yes: bool| if yes { 1.0 } else { 0.0 };
        let is_number = |pixel: u32| {
            let i = pixel as usize;
            let light = [0, 1, 2].map(|k| if lit(pixel) { light[k][i].truncate() } else { Vec3::ZERO });
            let beta = through[i].truncate();
            let radiance = accumulate::reference(emitted[i].truncate(), beta, kd[i].truncate(), light);
            let second = if summands { more[i].truncate() } else { Vec3::ZERO };
            let all = [radiance, light[0], light[1], second].map(|v| v.to_array());
            finite::reference(&[all.concat(), vec![one_if(covered(pixel)) * through[i].w]].concat())
        };
        let bad: Vec<u32> = (0..pixels).filter(|&pixel| !is_number(pixel)).collect();
        let status = upload(bench, "status", &[0u32; 4]).must();
        let shared = Resources::of([("frame", &s.frame), ("status", &status)]);
        let pass =
            make(bench, shared, |kit| Finite::new(kit, r, &s.paths, &s.sums, summands.then_some(&shown), pixels));
        bench.submit_and_wait("finite", None, |rec| pass.record(rec)).must();
        let found = download::<u32>(bench, &status).must();
        let last = bad.last().map_or(0, |pixel| pixel + 1);
        assert_eq!(found, [0, bad.len() as u32, last, 0], "{size:?}");
        kinds[0] += bad.len();
        kinds[1] += pixels as usize - bad.len();
    }
    bench.covered(kinds.iter().all(|&count| count > 300), format_args!("{kinds:?}"));
}

pub fn accumulate_is_the_exact_sum(bench: &Bench) {
    let s = Sheet::new(bench, [64, 1], 1);
    let (r, n) = (&s.receivers, &mut bench.numbers(5));
    let flags = ShadingPoints::word(ShadingPoints::COVERED | ShadingPoints::LIT | ShadingPoints::HIT);
    fill(bench, &r.wo, n, 1.0, |_| flags);
    fill(bench, &s.paths.throughput, n, 1.0, |_| 1.0);
    let direct = fill(bench, &s.sums.direct, n, 1.0, |_| 0.0);
    let albedo = fill(bench, &r.kd, n, 1.0, |_| 0.0);
    let f0 = spoil(bench, &r.f0, n, |_| 0.0);
    assert!(f0.iter().any(|v| !v.is_finite()));
    fill(bench, &r.shading, n, 1.0, |_| 0.0);
    let old: Vec<Vec<Vec4>> = (s.film.direct.0.iter().zip([3000.0, 1e-4, 1e-12]))
        .map(|(level, scale)| fill(bench, level, n, scale, |_| 0.0))
        .collect();
    let old_albedo: Vec<Vec<Vec4>> =
        (s.film.albedo.0.iter().zip([1e6, 0.0])).map(|(level, scale)| fill(bench, level, n, scale, |_| 0.0)).collect();
    let through = download::<Vec4>(bench, &s.paths.throughput).must();
    for status in [[1u32, 0, 0, 0], [0, 1, 5, 0], [0; 4]] {
        let left_out = status != [0; 4];
        let status = upload(bench, "status", &status).must();
        let pass = s.accumulate(bench, &status);
        bench.submit_and_wait("accumulate", None, |rec| pass.record(rec, 0)).must();
        let get = |sum: &Sum| sum.0.iter().map(|b| download::<Vec4>(bench, b).must()).collect::<Vec<_>>();
        let (found, found_albedo) = (get(&s.film.direct), get(&s.film.albedo));
        for i in 0..64 {
            let (before, before_albedo) = ([0, 1, 2].map(|k| old[k][i]), [0, 1].map(|k| old_albedo[k][i]));
            let one = through[i].truncate() * (albedo[i].truncate() + f0[i].truncate());
            let (expected, expected_albedo) = match left_out {
                // A pass that lost rays, or with a value that is no number, has no effect.
                true => (before, before_albedo),
                false => (
                    accumulate::sum_with(before, direct[i].truncate().extend(through[i].w)),
                    accumulate::sum_of_guides(before_albedo, one),
                ),
            };
            // Additions and subtractions are exactly rounded on every device.
            assert_eq!([0, 1, 2].map(|k| found[k][i]), expected, "pixel {i}, left out: {left_out}");
            assert_eq!([0, 1].map(|k| found_albedo[k][i]), expected_albedo, "albedo of pixel {i}");
        }
    }
}

pub fn resolve_writes_the_mean_of_the_film(bench: &Bench) {
    for (passes, [width, height]) in (1u32..).zip(bench.images()) {
        let s = Sheet::new(bench, [width, height], passes);
        let n = &mut bench.numbers(passes);
        let image = Image::new(bench, "image", width, height, vk::Format::R32G32B32A32_SFLOAT).must();
        let out = Buffer::new(bench, "copied image", image.bytes(), Memory::Readback).must();
        let sum = [0, 1].map(|i| fill(bench, &s.film.color[i].0[0], n, 100.0, |i| i as f32));
        let rest = [0, 1].map(|i| fill(bench, &s.film.color[i].0[1], n, 1e-3, |_| 0.0));
        let pass = Resolve::new(bench, &s.film, &image).must();
        let mut counts = Staging::new();
        counts.stage_into(bench, &s.film.counts, 0, &[passes.div_ceil(2), passes / 2]).must();
        bench
            .submit_and_wait("resolve", None, |rec| {
                counts.record(rec)?;
                s.film.gain.0.iter().try_for_each(|level| rec.fill(level, 0))?;
                rec.image_to_general(&image)?;
                pass.record(rec)?;
                rec.copy_image_to_buffer(&image, &out)
            })
            .must();
        for (i, found) in out.read::<Vec4>().must().into_iter().enumerate() {
            let whole = [0, 1].map(|k| sum[k][i].as_dvec4() + rest[k][i].as_dvec4());
            let mean = (whole[0] + whole[1]) / f64::from(passes);
            let error = (found.as_dvec4() - mean).abs();
            assert!(all_within(error, mean.abs() * 5e-7), "{width}x{height}, pixel {i}: {found} for {mean}");
        }
    }
}

pub fn probe_copies_the_sums_of_an_instance(bench: &Bench) {
    let mut partly = 0;
    for [width, height] in bench.images().chain([[97, 61]]) {
        let s = Sheet::new(bench, [width, height], 1);
        let n = &mut bench.numbers(width);
        let levels = [0, 1].map(|i: usize| {
            let scales = [100.0, 1e-5, 1e-12];
            [0, 1, 2].map(|level: usize| fill(bench, &s.film.color[i].0[level], n, scales[level], |k| k as f32))
        });
        let passes = 9;
        // Squares of gains: between those of passes that are all alike, and those of noise.
        let mut gain = [0, 1].map(|level: usize| fill(bench, &s.film.gain.0[level], n, [1.0, 1e-6][level], |_| 0.0));
        for (sum, k) in gain[0].iter_mut().zip(0..) {
            let grey = sum.truncate().element_sum() / 3.0;
            sum.w = grey * grey / passes as f32 * (1.0 + 8.0 * (k % 100) as f32 / 100.0);
        }
        let mut counts = Staging::new();
        counts.stage_into(bench, &s.film.counts, 0, &[5u32, 4, 0, 0]).must();
        counts.stage_into(bench, &s.film.gain.0[0], 0, &gain[0]).must();
        bench.submit_and_wait("counts", None, |rec| counts.record(rec)).must();
        let moments: Vec<_> = (gain[0].iter().zip(&gain[1]))
            .map(|(sum, rest)| gain::moments((*sum + *rest).as_dvec4() / f64::from(passes), passes))
            .collect();
        let share = |pixel: u32| {
            let (x, y) = (pixel % width, pixel / width);
            let around = (y.saturating_sub(2)..height.min(y + 3))
                .flat_map(|y| (x.saturating_sub(2)..width.min(x + 3)).map(move |x| y * width + x));
            gain::share(around.map(|i| moments[i as usize]), passes) as f32
        };
        let shared = Resources::of([("frame", &s.frame)]);
        let pass = make(bench, shared, |kit| Probe::new(kit, &s.film));
        for (instance, levels) in (0..).zip(&levels) {
            bench.submit_and_wait("probe", None, |rec| pass.record(rec, instance)).must();
            let found = download::<Vec4>(bench, &pass.out).must();
            for (found, pixel) in found.chunks_exact(3).zip(probe::pixels(width * height)) {
                let of = |levels: &[Vec<Vec4>]| levels.iter().map(|level| level[pixel as usize]).collect::<Vec<_>>();
                let (color, gain) = (of(levels), of(&gain));
                let expected = probe::reference([color[0], color[1], color[2]], [gain[0], gain[1]], share(pixel));
                // Additions are exactly rounded on every device.
                let same = found[..2] == expected[..2] && found[2].truncate() == expected[2].truncate();
                assert!(same, "instance {instance} of {width}x{height}: {found:?} for {expected:?}");
                assert!(within(found[2].w - expected[2].w, 1e-3), "{} for {}", found[2].w, expected[2].w);
                partly += usize::from(found[2].w > 0.05 && found[2].w < 0.95);
            }
        }
    }
    bench.covered(partly > 100, format_args!("{partly}"));
}
