//! The convolution against its oracle, and its guarantees: it preserves constants, energy and regions; the error of the
//! fast form is bounded.

use crate::conform::tally::within;
use crate::conform::{Bench, Must};
use crate::gpu::{Staging, download, upload};
use crate::pass::convolve::reference::{Image, reference};
use crate::pass::convolve::{Convolve, Form, Inputs, KERNEL_TEXELS, Library};
use glam::{Vec2, Vec3, Vec4};

/// Textures: a disc, a smooth lobe, a long one-sided lobe, one that is 0 at its centre.
pub fn library() -> Vec<f32> {
    let lobes: [fn(Vec2) -> f32; 4] = [
        |_| 3.0,
        |at| (1.0 - at.length_squared()).powi(2),
        |at| (-12.0 * (at - Vec2::new(0.2, 0.0)).dot((at - Vec2::new(0.2, 0.0)) * Vec2::new(0.2, 1.0))).exp(),
        |at| at.length_squared(),
    ];
    let edge = KERNEL_TEXELS;
    let at = |i: u32| Vec2::new((i % edge) as f32 + 0.5, (i / edge) as f32 + 0.5) * (2.0 / edge as f32) - 1.0;
    let texel = |lobe: fn(Vec2) -> f32, i: u32| if at(i).length() <= 1.0 { lobe(at(i)) } else { 0.0 };
    lobes.iter().flat_map(|&lobe| (0..edge * edge).map(move |i| texel(lobe, i))).collect()
}

/// An input image.
struct Subject {
    size: [u32; 2],
    source: Vec<Vec4>,
    footprint: Vec<Vec4>,
    region: Vec<u32>,
    kernels: Vec<f32>,
    narrowings: Vec<u32>,
    widest: f32,
    form: Form,
    occlusion: bool,
    layers: bool,
}

impl Subject {
    /// Random radiance, depths in steps, every layer and direction, diameters up to `widest`; three regions, partly of
    /// single pixels, and holes.
    fn random(bench: &Bench, size: [u32; 2], widest: f32) -> Subject {
        let mut numbers = bench.numbers(size[0] * 31 + size[1] * 7 + widest as u32);
        let count = (size[0] * size[1]) as usize;
        let source = (0..count).map(|_| numbers.vec3().extend(1.0 + (4.0 * numbers.next()).floor())).collect();
        let footprint = (0..count)
            .map(|_| {
                let angle = numbers.next() * std::f32::consts::TAU;
                Vec4::new(widest * numbers.next(), (4.0 * numbers.next()).floor(), angle.cos(), angle.sin())
            })
            .collect();
        let region = (0..count as u32)
            .map(|i| match numbers.next() {
                n if n < 0.1 => 0,
                n if n < 0.2 => 3,
                _ => 1 + u32::from(i % size[0] > size[0] / 2),
            })
            .collect();
        let (kernels, narrowings, form) = (library(), vec![0, 3, 4, 1], Form::Direct);
        Subject { size, source, footprint, region, kernels, narrowings, widest, form, occlusion: false, layers: false }
    }

    /// The result of the pass.
    fn convolved(&self, bench: &Bench) -> Vec<Vec4> {
        self.convolved_after(bench, &[])
    }

    /// The result of the pass after it has run for other regions.
    fn convolved_after(&self, bench: &Bench, earlier: &[Vec<u32>]) -> Vec<Vec4> {
        let flat = |v: &[Vec4]| v.iter().flat_map(|v| v.to_array()).collect::<Vec<f32>>();
        let source = upload(bench, "source", &flat(&self.source)).must();
        let footprint = upload(bench, "footprint", &flat(&self.footprint)).must();
        let own = upload(bench, "own region", &self.region).must();
        let earlier: Vec<_> = earlier.iter().map(|regions| upload(bench, "earlier region", regions).must()).collect();
        let region = upload(bench, "region", &self.region).must();
        let kernels = upload(bench, "kernels", &self.kernels).must();
        let mut staging = Staging::new();
        let library = Library::new(bench, &mut staging, &kernels, &self.narrowings).must();
        let inputs = Inputs {
            library: &library,
            source: &source,
            footprint: &footprint,
            by_region: self.footprint.len() < self.region.len(),
            region: &region,
            size: self.size,
            widest: self.widest,
            form: self.form,
            occlusion: self.occlusion,
            layers: self.layers,
        };
        let pass = Convolve::new(bench, &mut staging, &inputs).must();
        bench
            .submit_and_wait("convolution", None, |rec| {
                staging.record(rec)?;
                library.record(rec)?;
                rec.fill(&pass.spread, crate::conform::SENTINEL)?;
                for regions in &earlier {
                    rec.copy(regions, &region)?;
                    pass.record(rec)?;
                }
                rec.copy(&own, &region)?;
                pass.record(rec)
            })
            .must();
        download::<[f32; 4]>(bench, &pass.spread).must().into_iter().map(Vec4::from).collect()
    }

    fn expected(&self) -> Vec<Vec4> {
        reference(&Image {
            size: self.size,
            source: &self.source,
            footprint: &self.footprint,
            region: &self.region,
            kernels: &self.kernels,
            narrowings: &self.narrowings,
            occlusion: self.occlusion,
        })
    }
}

#[track_caller]
fn assert_close(found: &[Vec4], expected: &[Vec4], tolerance: f32, what: &str) {
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        let off = (*a - *b).abs().max_element();
        assert!(within(off, tolerance * (1.0 + b.abs().max_element())), "{what}, pixel {i}: {a} for {b}");
    }
}

/// Sizes that reveal off-by-one mistakes, and kernel widths: none, narrow, wider than the image.
const SIZES: [[u32; 2]; 5] = [[1, 1], [27, 1], [8, 8], [31, 17], [2049, 1]];
const WIDTHS: [f32; 5] = [0.0, 1.0, 3.3, 7.0, 70.0];

const FORMS: [Form; 2] = [Form::Direct, Form::Fast];

pub fn convolve_follows_its_oracle(bench: &Bench) {
    for size in bench.images_or(&SIZES) {
        for widest in WIDTHS {
            for occlusion in [false, true] {
                let subject = Subject { occlusion, ..Subject::random(bench, size, widest) };
                let what = format!("{size:?}, widest {widest}, occlusion {occlusion}");
                assert_close(&subject.convolved(bench), &subject.expected(), 2e-4, &what);
            }
        }
    }
    // More taps than one dispatch may take, and a kernel wider than those that are summed for the norm.
    let subject = Subject::random(bench, [300, 2], 420.0);
    assert_close(&subject.convolved(bench), &subject.expected(), 1e-3, "420 pixels wide");
}

/// Three kernels for four region numbers give the bits of the same kernels written for each pixel, and follow the oracle.
pub fn regions_have_kernels_of_their_own(bench: &Bench) {
    for size in [[27, 1], [31, 17], [2049, 1]] {
        for form in FORMS {
            let each = Subject { form, occlusion: true, ..Subject::random(bench, size, 12.0) };
            let kernels = [Vec4::ZERO, Vec4::new(9.0, 2.0, 0.6, 0.8), Vec4::new(4.5, 1.0, 1.0, 0.0)];
            let of_pixel = |&id: &u32| kernels[(id as usize).min(2)];
            let each = Subject { footprint: each.region.iter().map(of_pixel).collect(), ..each };
            let found = each.convolved(bench);
            if form == Form::Direct {
                assert_close(&found, &each.expected(), 2e-4, &format!("{size:?}"));
            }
            let by_region = Subject { footprint: kernels.to_vec(), ..each };
            assert_eq!(found, by_region.convolved(bench), "{size:?} {form:?}");
        }
    }
}

/// For kernels that stay in level 0 the fast form takes the same sum; for wider ones its error is small.
pub fn convolve_fast_errs_little(bench: &Bench) {
    for (layer, widest, greatest) in [
        (0.0, 5.0, 0.006),
        (0.0, 15.0, 0.03),
        (0.0, 31.0, 0.03),
        (0.0, 63.0, 0.06),
        (1.0, 7.0, 0.001),
        (1.0, 15.0, 0.015),
        (1.0, 31.0, 0.015),
        (1.0, 63.0, 0.025),
        (2.0, 7.0, 0.001),
        (2.0, 15.0, 0.02),
        (2.0, 31.0, 0.02),
        (2.0, 63.0, 0.02),
        (3.0, 7.0, 0.002),
        (3.0, 15.0, 0.025),
        (3.0, 31.0, 0.025),
        (3.0, 63.0, 0.025),
    ] {
        // The smooth lobe again, half as wide along v.
        let (layer, narrowing) = if layer == 3.0 { (1.0, 4) } else { (layer, 0) };
        let narrowed =
            |form| Subject { form, narrowings: vec![narrowing; 4], ..natural(bench, [160, 120], widest, layer) };
        let (direct, fast) = (narrowed(Form::Direct), narrowed(Form::Fast));
        let error = relative_rmse(&fast.convolved(bench), &direct.convolved(bench));
        log::info!("layer {layer}, {widest} pixels wide: {error:.4}");
        assert!(within(error, greatest), "layer {layer}, {widest} pixels wide: {error}");
    }
}

/// A longer u axis narrows its kernel along v by its length, beside what the library states, up to 15 steps in all.
pub fn convolve_narrows_kernels_by_their_axes(bench: &Bench) {
    for size in bench.images_or(&SIZES) {
        let mut subject = Subject::random(bench, size, 17.0);
        for (i, foot) in subject.footprint.iter_mut().enumerate() {
            let length = (0.25 * (i % 18) as f32).exp2();
            (foot.z, foot.w) = (foot.z * length, foot.w * length);
        }
        assert_close(&subject.convolved(bench), &subject.expected(), 2e-4, &format!("{size:?}"));
    }
    for (widest, stretch, greatest) in [(7.0, 2.0, 0.01), (31.0, 2.0, 0.03), (31.0, 4.0, 0.08), (63.0, 8.0, 0.1)] {
        let stretched = |form| {
            let mut subject = Subject { form, ..natural(bench, [160, 120], widest, 1.0) };
            subject.footprint.iter_mut().for_each(|foot| (foot.z, foot.w) = (foot.z * stretch, foot.w * stretch));
            subject.convolved(bench)
        };
        let error = relative_rmse(&stretched(Form::Fast), &stretched(Form::Direct));
        log::info!("{widest} pixels, {stretch} times as long as wide: {error:.4}");
        assert!(within(error, greatest), "{widest}, {stretch}: {error}");
    }
}

fn relative_rmse(image: &[Vec4], expected: &[Vec4]) -> f32 {
    let mean = expected.iter().map(|v| v.truncate().element_sum()).sum::<f32>() / (3 * expected.len()) as f32;
    let squares = image.iter().zip(expected).map(|(a, b)| (a.truncate() - b.truncate()).length_squared()).sum::<f32>();
    (squares / (3 * expected.len()) as f32).sqrt() / mean
}

/// Each region has one colour, which must not bleed into others and must be constant up to the edges.
pub fn convolve_keeps_constants_and_regions(bench: &Bench) {
    let colours = [Vec3::ZERO, Vec3::new(1.0, 0.5, 0.2), Vec3::new(0.1, 3.0, 7.0), Vec3::new(100.0, 0.0, 40.0)];
    for size in bench.images_or(&SIZES) {
        for widest in WIDTHS {
            for form in FORMS {
                let mut subject = Subject { form, ..Subject::random(bench, size, widest) };
                for (light, &region) in subject.source.iter_mut().zip(&subject.region) {
                    // Pixels that take no part may hold any value.
                    *light = if region == 0 { Vec4::NAN } else { colours[region as usize].extend(light.w) };
                }
                for (i, (found, &region)) in subject.convolved(bench).iter().zip(&subject.region).enumerate() {
                    let off = (found.truncate() - colours[region as usize]).abs().max_element();
                    assert!(within(off, 1e-4), "{form:?}, {size:?}, widest {widest}, pixel {i} of {region}: {found}");
                    assert!((region != 0) == (found.w > 0.0), "weight of pixel {i}: {found}");
                }
            }
        }
    }
}

/// Wide and narrow kernels have equal weight: away from edges the energy is preserved.
pub fn convolve_keeps_energy(bench: &Bench) {
    for (form, tolerance) in [(Form::Direct, 1e-4), (Form::Fast, 0.02)] {
        for widest in [2.0, 9.0, 33.0] {
            let size = [101, 97];
            let mut subject = Subject { form, ..Subject::random(bench, size, widest) };
            subject.region.fill(1);
            for (i, light) in subject.source.iter_mut().enumerate() {
                let at = Vec2::new((i as u32 % size[0]) as f32, (i as u32 / size[0]) as f32);
                let away = (at - Vec2::splat(49.0)).abs().max_element();
                *light = if away < 20.0 { *light } else { Vec3::ZERO.extend(light.w) };
            }
            let sum = |v: &[Vec4]| v.iter().map(|v| v.truncate()).sum::<Vec3>();
            let spread: Vec<Vec4> = subject.convolved(bench).iter().map(|v| v.truncate().extend(1.0) * v.w).collect();
            let ratio = sum(&spread) / sum(&subject.source);
            assert!(within((ratio - 1.0).abs().max_element(), tolerance), "{form:?}, widest {widest}: {ratio}");
        }
    }
}

/// Without spreading the mirror image is unchanged, bit for bit.
pub fn convolve_by_nothing_is_the_mirror_image(bench: &Bench) {
    for form in FORMS {
        for (diameter, widest) in [(0.0, 0.0), (0.0, 100.0), (1.0, 20.0), (-5.0, 8.0), (f32::NAN, 8.0)] {
            let mut subject = Subject { form, ..Subject::random(bench, [31, 17], widest) };
            subject.footprint.iter_mut().for_each(|foot| foot.x = diameter);
            for (i, found) in subject.convolved(bench).iter().enumerate() {
                let part = if subject.region[i] == 0 { 0.0 } else { 1.0 };
                assert_eq!(*found, subject.source[i].truncate().extend(1.0) * part, "{form:?}, pixel {i}");
            }
        }
    }
}

pub fn convolve_takes_one_footprint_for_all(bench: &Bench) {
    for form in FORMS {
        for widest in [3.0, 25.0] {
            let one = Vec4::new(widest, 2.0, 0.8, 0.6);
            let same = || Subject { form, ..Subject::random(bench, [31, 17], widest) };
            let everywhere = Subject { footprint: vec![one; 31 * 17], ..same() };
            let alone = Subject { footprint: vec![one], ..same() };
            assert_eq!(everywhere.convolved(bench), alone.convolved(bench), "{form:?}");
        }
    }
}

/// A ring with an empty centre reaches no pixel of a region of one pixel, which keeps its own radiance.
pub fn what_no_weight_reaches_keeps_its_own(bench: &Bench) {
    let edge = KERNEL_TEXELS as usize;
    let ring = |i: usize| {
        let at = Vec2::new((i % edge) as f32, (i / edge) as f32) - 15.5;
        if (8.0..15.0).contains(&at.length()) { 1.0 } else { 0.0 }
    };
    for form in FORMS {
        let mut subject = Subject { form, ..Subject::random(bench, [9, 9], 7.0) };
        subject.kernels = (0..edge * edge).map(ring).collect();
        subject.narrowings = vec![0];
        subject.footprint.fill(Vec4::new(7.0, 0.0, 1.0, 0.0));
        subject.region.fill(0);
        subject.region[40] = 5;
        let found = subject.convolved(bench)[40];
        assert_eq!(found, subject.source[40].truncate().extend(0.0), "{form:?}");
    }
}

pub fn convolve_gives_the_same_bits_again(bench: &Bench) {
    for form in FORMS {
        let subject = Subject { form, occlusion: true, ..Subject::random(bench, [61, 43], 30.0) };
        let bits = || subject.convolved(bench).iter().map(|v| v.to_array().map(f32::to_bits)).collect::<Vec<_>>();
        assert_eq!(bits(), bits(), "{form:?}");
    }
}

/// Layers spread over each other: in the direct form as if they were one region; so too in the fast form, except that a
/// pixel's own width limits the light of the back layer's pyramid.
pub fn layers_spread_over_each_other(bench: &Bench) {
    for (size, widest) in [([27, 1], 3.3), ([31, 17], 6.0), ([2049, 1], 4.0)] {
        for form in FORMS {
            let mut subject = Subject { form, occlusion: true, layers: true, ..Subject::random(bench, size, widest) };
            subject.region.iter_mut().for_each(|r| *r = (*r).min(2));
            let mut one = Subject { form, occlusion: true, ..Subject::random(bench, size, widest) };
            one.region = subject.region.iter().map(|&r| r.min(1)).collect();
            let what = format!("{size:?}, widest {widest}, {form:?}");
            // None of these kernels leaves level 0.
            let (expected, tolerance) = match form {
                Form::Fast => (one.convolved(bench), 1e-5),
                _ => (one.expected(), 2e-4),
            };
            assert_close(&subject.convolved(bench), &expected, tolerance, &what);
        }
    }
    // A blurred stripe in front spreads over a sharp board, which occludes a blurred wall.
    let mut subject = Subject::random(bench, [96, 64], 30.0);
    (subject.occlusion, subject.layers, subject.form) = (true, true, Form::Fast);
    for i in 0..96 * 64 {
        let (light, depth, width, layer) = match i % 96 {
            0..32 => (Vec3::X, 1.0, 20.0, 2),
            32..64 => (Vec3::Y, 2.0, 0.0, 1),
            _ => (Vec3::Z, 4.0, 30.0, 1),
        };
        subject.source[i] = light.extend(depth);
        subject.footprint[i] = Vec4::new(width, 0.0, 1.0, 0.0);
        subject.region[i] = layer;
    }
    let found = subject.convolved(bench);
    let at = |x: usize| found[32 * 96 + x].truncate();
    for x in 0..96 {
        let l = at(x);
        assert!((l.element_sum() - 1.0).abs() < 1e-4, "{x}: {l}");
        // The wall stays behind the board, which stays in place.
        assert!((32..64).contains(&x) || l.y < 1e-4, "{x}: {l}");
        assert!(x >= 64 || l.z < 1e-4, "{x}: {l}");
    }
    assert!(at(33).x > 0.25 && at(38).x > 0.02 && at(48).x < 1e-3, "{} {} {}", at(33), at(38), at(48));
}

/// A near bright ball in front of a blurred far wall: with occlusion the wall does not bleed over it.
pub fn what_lies_behind_stays_behind(bench: &Bench) {
    let mut subject = Subject::random(bench, [48, 48], 15.0);
    let near = |i: usize| (Vec2::new((i % 48) as f32, (i / 48) as f32) - 23.5).length() < 8.0;
    subject.region.fill(1);
    for i in 0..48 * 48 {
        let (light, depth, width) = if near(i) { (1.0, 1.0, 0.0) } else { (0.0, 2.0, 15.0) };
        subject.source[i] = Vec3::splat(light).extend(depth);
        subject.footprint[i] = Vec4::new(width, 1.0, 1.0, 0.0);
    }
    let least = |subject: &Subject| {
        let found = subject.convolved(bench);
        (0..48 * 48).filter(|&i| near(i)).map(|i| found[i].x).fold(1.0, f32::min)
    };
    let [without, with] = [false, true].map(|occlusion| {
        subject.occlusion = occlusion;
        least(&subject)
    });
    assert!(without < 0.75 && with > 0.99, "{without} without, {with} with occlusion");
}

/// Soft shades, a chequered wall farther away and a bright ball near by; diameters grow with depth.
fn natural(bench: &Bench, size: [u32; 2], widest: f32, layer: f32) -> Subject {
    let mut subject = Subject::random(bench, size, widest);
    for (i, (light, foot)) in subject.source.iter_mut().zip(&mut subject.footprint).enumerate() {
        let at = Vec2::new((i as u32 % size[0]) as f32, (i as u32 / size[0]) as f32) / size[1] as f32;
        let wall = at.x > 0.6;
        let ball = (at - Vec2::new(0.7, 0.5)).length() < 0.2;
        let chequer = ((at.x * 12.0).floor() + (at.y * 12.0).floor()) as i32 % 2 == 0;
        let depth = if ball {
            0.15
        } else if wall {
            1.0
        } else {
            0.2 + 0.8 * at.y.min(1.0)
        };
        let shade = Vec3::new(0.4 + 0.3 * (5.0 * at.x).sin(), 0.5 + 0.4 * (3.0 * at.y).cos(), 0.3 + 0.2 * at.x);
        let radiance = if ball {
            Vec3::new(2.0, 1.5, 1.0)
        } else if wall && chequer {
            0.1 * shade
        } else {
            shade
        };
        *light = radiance.extend(depth);
        let angle = 0.7 + at.x;
        *foot = Vec4::new(widest * depth, layer, angle.cos(), angle.sin());
    }
    subject.region.fill(1);
    subject.narrowings.fill(0);
    subject
}

/// Tiles without pixels of a region are left out; nothing of what they held in an earlier frame comes back.
pub fn convolve_forgets_regions_that_have_moved(bench: &Bench) {
    for (form, occlusion) in [(Form::Fast, true), (Form::Fast, false), (Form::Direct, false)] {
        let size = [75, 43];
        let within = |low: u32, high: u32| {
            let here = |i: u32| (low..high).contains(&(i % size[0])) && i / size[0] > 20;
            (0..size[0] * size[1]).map(|i| u32::from(here(i))).collect::<Vec<u32>>()
        };
        let subject = Subject { form, occlusion, region: within(3, 20), ..Subject::random(bench, size, 21.0) };
        let fresh = subject.convolved(bench);
        assert!(fresh.iter().zip(&subject.region).all(|(l, &region)| (region == 0) == (*l == Vec4::ZERO)));
        for earlier in [within(15, 75), within(0, 0), vec![1; subject.region.len()]] {
            assert!(subject.convolved_after(bench, &[earlier]) == fresh, "{form:?}, occlusion {occlusion}");
        }
        let nowhere = Subject { region: within(0, 0), ..subject };
        assert!(nowhere.convolved_after(bench, &[vec![1; nowhere.region.len()]]).iter().all(|l| *l == Vec4::ZERO));
    }
}
