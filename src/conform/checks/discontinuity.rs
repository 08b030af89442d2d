//! The discontinuity buffer against its oracle, for irradiance and for the light of lobes.

use crate::conform::rig::{Rig, STRAYS, Tally, close, gallery, has, is_lit, untouched};
use crate::conform::{Bench, Must, Numbers};
use crate::gpu::{Context, upload};
use crate::pass::discontinuity::{self, Discontinuity, Guide, Inputs, PixelPoint, guide};
use crate::pass::discontinuity_lobes::{self, DiscontinuityLobes, Gloss};
use crate::pass::layout::Window;
use crate::pass::sparse_windows::{self, SparseWindows};
use crate::pass::{Lighting, ShadingPoints};
use crate::scene::Scene;
use crate::settings::{Agreement, Filter, Settings};
use crate::stage::Stage;
use glam::{Vec3, Vec4};

/// The guides of all slots by the oracle; second components of tiles that are not listed take no part.
pub fn guides(rig: &Rig, agreement: Agreement) -> Vec<Guide> {
    let (r, pixels) = (&rig.frame().eye.points, rig.parameters.size[2] as usize);
    let [position, geometric, shading, kd, wo] =
        [&r.position, &r.geometric, &r.shading, &r.kd, &r.wo].map(|b| rig.vec4s(b));
    let throughput = rig.vec4s(&rig.frame().eye.paths.throughput);
    let listed = rig.ideal_pixels();
    let of_slot = |i: usize| {
        if i >= pixels && listed.binary_search(&((i - pixels) as u32)).is_err() {
            return Guide::default();
        }
        let receiver = PixelPoint {
            position: position[i],
            geometric: geometric[i],
            shading: shading[i],
            kd: kd[i],
            wo: wo[i],
            depth: throughput[i].w,
        };
        // Neighbours in the tile of 8 x 8 pixels.
        let [width, height, ..] = rig.parameters.size.map(|n| n as usize);
        let (x, y) = (i % pixels % width, i % pixels / width);
        let may_spread = i >= pixels || has(wo[i], ShadingPoints::SEEN_BY_SPECULAR);
        let lit = |j: usize, inside: bool| (may_spread && inside && is_lit(wo[j])).then(|| position[j].truncate());
        let neighbours = [
            [lit(i.wrapping_sub(1), x % 8 > 0), lit(i + 1, x % 8 < 7 && x + 1 < width)],
            [lit(i.wrapping_sub(width), y % 8 > 0), lit(i + width, y % 8 < 7 && y + 1 < height)],
        ];
        guide(&rig.parameters, agreement, &receiver, neighbours)
    };
    // Third components are not filtered.
    (0..rig.engine.plan().eye.components as usize * pixels).map(of_slot).collect()
}

/// The filtered lighting for this direct and indirect irradiance of all slots.
pub fn filtered(ctx: &Context, rig: &Rig, filter: Filter, irradiance: [&[Vec3]; 2]) -> [Vec<Vec3>; 2] {
    filtered_with(ctx, rig, filter, irradiance, false)
}

/// The same; `sparse`: with the exchange around sparse windows.
pub fn filtered_with(
    ctx: &Context,
    rig: &Rig,
    filter: Filter,
    irradiance: [&[Vec3]; 2],
    sparse: bool,
) -> [Vec<Vec3>; 2] {
    let frame = rig.frame();
    let [direct, indirect] = irradiance.map(|all| {
        let wide: Vec<Vec4> = all.iter().map(|e| e.extend(0.0)).collect();
        upload(ctx, "irradiance", bytemuck::cast_slice::<Vec4, f32>(&wide)).must()
    });
    let [width, height, pixels, _] = rig.parameters.size;
    let [pattern_width, pattern_height, ..] = rig.parameters.pattern;
    let inputs = Inputs {
        points: &frame.eye.points,
        paths: &frame.eye.paths,
        lighting: &Lighting { direct, indirect, specular: frame.shade.lighting.specular.clone() },
        ideal_tiles: &frame.eye.ideal_tiles,
        components: irradiance[0].len() as u32 / pixels,
        size: [width, height],
        pattern: [pattern_width, pattern_height],
        filter,
    };
    let pass = rig.make(|kit| Discontinuity::new(kit, &inputs));
    let exchange = sparse.then(|| rig.make(|kit| SparseWindows::new(kit, &inputs, &pass)));
    rig.prefill(&[&pass.filtered.indirect]);
    if filter.direct {
        rig.prefill(&[&pass.filtered.direct]);
    }
    rig.run(|_, rec| {
        pass.record(rec)?;
        exchange.as_ref().map_or(Ok(()), |exchange| exchange.record(rec))
    });
    [&pass.filtered.direct, &pass.filtered.indirect].map(|b| rig.vec4s(b).iter().map(|e| e.truncate()).collect())
}

/// The visible shading points of a scene in a pass.
fn seen_in_pass<'a>(bench: &'a Bench, scene: &'a Scene, size: [u32; 2], pattern: [u32; 2], pass: u32) -> Rig<'a> {
    let rig = bench.rig_at_pass(scene, size, Settings { particles: 1, pattern, ..Settings::plain() }, pass);
    rig.run(|frame, rec| frame.eye.record(rec));
    rig
}

pub fn random(count: usize) -> Vec<Vec3> {
    let mut numbers = Numbers(count as u32);
    (0..count).map(|_| numbers.vec3()).collect()
}

pub fn filters() -> Vec<(Filter, [u32; 2])> {
    let filter = |window, direct, agreement| Filter { window, direct, agreement, sparse: true };
    vec![
        (filter(None, true, Agreement::Plane), [1, 1]),
        (filter(None, false, Agreement::Plane), [2, 3]),
        (filter(Some([3, 1]), true, Agreement::DepthAndNormal), [2, 1]),
        (filter(Some([1, 3]), false, Agreement::DepthAndNormal), [1, 1]),
        (filter(None, true, Agreement::Plane), [5, 4]),
        (filter(Some([9, 5]), false, Agreement::Plane), [3, 2]),
        (filter(Some([5, 7]), true, Agreement::DepthAndNormal), [4, 1]),
        (filter(Some([1, 9]), false, Agreement::DepthAndNormal), [1, 8]),
    ]
}

pub fn lobes_follow_their_oracle(bench: &Bench) {
    let scene = gallery();
    let mut averaged = 0;
    for size in bench.images_or(&[[1, 1], [27, 1], [64, 3], [2049, 1], [97, 61]]) {
        for (i, (filter, pattern)) in filters().into_iter().enumerate() {
            // The filter of the later ones has faded.
            let rig = seen_in_pass(bench, &scene, size, pattern, 40 * i as u32);
            let frame = rig.frame();
            let r = &frame.eye.points;
            let [position, geometric, shading, f0, wo] =
                [&r.position, &r.geometric, &r.shading, &r.f0, &r.wo].map(|b| rig.vec4s(b));
            let pixels = (size[0] * size[1]) as usize;
            let lobe = |i: usize| Gloss {
                position: position[i].truncate(),
                geometric: geometric[i].truncate(),
                shading: shading[i].truncate(),
                wo: wo[i].truncate(),
                f0: f0[i].truncate(),
                alpha: shading[i].w,
            };
            let takes_part = |i: usize| has(wo[i], ShadingPoints::GLOSSY) && is_lit(wo[i]);
            let lobes: Vec<_> = (0..pixels).map(|i| takes_part(i).then(|| lobe(i))).collect();
            let radiance = random(wo.len());
            let wide: Vec<Vec4> = radiance.iter().map(|l| l.extend(0.0)).collect();
            let specular = upload(bench, "radiance", bytemuck::cast_slice::<Vec4, f32>(&wide)).must();
            let lighting = Lighting { specular, ..frame.shade.lighting.clone() };
            let components = (wo.len() / pixels) as u32;
            let inputs = (r, &lighting, &frame.eye.ideal_tiles);
            let pass = rig.make(|kit| DiscontinuityLobes::new(kit, inputs, components, size, (filter, pattern)));
            rig.run(|_, rec| pass.record(rec));
            let found = rig.vec4s(&pass.filtered.specular);
            let window = Window::new(&filter, pattern);
            let expected = discontinuity_lobes::reference(&rig.parameters, &window, &lobes, &radiance);
            let mut tally = Tally::new(format!("lobes, {size:?}, {filter:?}, pattern {pattern:?}"));
            for i in 0..pixels {
                let (l, e) = (found[i].truncate(), expected[i]);
                tally.check_values(close(l, e, 1e-4, 1e-5), &[(l, e)], || format!("pixel {i}: {l} for {e}"));
                averaged += usize::from((e - radiance[i]).length() > 1e-3);
            }
            // Second components keep their own.
            for i in rig.ideal_pixels().into_iter().map(|pixel| pixel as usize + pixels).filter(|&i| i < wo.len()) {
                tally.check(found[i].truncate() == radiance[i], || format!("slot {i}"));
            }
            tally.finish(STRAYS);
        }
    }
    bench.covered(averaged > 2000, format_args!("{averaged} pixels are averaged"));
}

pub fn discontinuity_follows_its_oracle(bench: &Bench) {
    let scene = gallery();
    let mut averaged = [0; 2];
    for size in bench.images_or(&[[1, 1], [27, 1], [64, 3], [2049, 1], [31, 17]]) {
        for (i, (filter, pattern)) in filters().into_iter().enumerate() {
            // The filter of the later ones has faded.
            let rig = seen_in_pass(bench, &scene, size, pattern, 40 * i as u32);
            let guides = guides(&rig, filter.agreement);
            let pixels = (size[0] * size[1]) as usize;
            let irradiance = [random(guides.len()), random(guides.len() + 1)[1..].to_vec()];
            let found = filtered(bench, &rig, filter, [&irradiance[0], &irradiance[1]]);
            let window = Window::new(&filter, pattern);
            let listed = rig.ideal_pixels();
            let mut tally = Tally::new(format!("discontinuity, {size:?}, {filter:?}, pattern {pattern:?}"));
            for (component, averaged) in averaged.iter_mut().enumerate().take(guides.len() / pixels) {
                let slots = component * pixels..(component + 1) * pixels;
                for (kind, (found, irradiance)) in found.iter().zip(&irradiance).enumerate() {
                    let expected = discontinuity::reference(
                        &rig.parameters,
                        filter.agreement,
                        &window,
                        &guides[slots.clone()],
                        &irradiance[slots.clone()],
                    );
                    for (pixel, slot) in slots.clone().enumerate() {
                        let is_filtered = kind == 1 || filter.direct;
                        if component == 1 && is_filtered && listed.binary_search(&(pixel as u32)).is_err() {
                            tally
                                .check(untouched(found[slot].extend(f32::from_bits(crate::conform::SENTINEL))), || {
                                    format!("slot {slot} is not listed")
                                });
                            continue;
                        }
                        let e = if is_filtered { expected[pixel] } else { irradiance[slot] };
                        let same = close(found[slot], e, 1e-4, 1e-5);
                        tally.check_values(same, &[(found[slot], e)], || {
                            format!("slot {slot}: {} for {e}", found[slot])
                        });
                        *averaged += usize::from(is_filtered && (e - irradiance[slot]).length() > 1e-3);
                    }
                }
            }
            tally.finish(0.0);
        }
    }
    bench.covered(averaged[0] > 10_000 && averaged[1] > 100, format_args!("hardly anything is averaged: {averaged:?}"));
}

pub fn sparse_windows_follow_their_oracle(bench: &Bench) {
    let scene = gallery();
    // Slots of first and second components whose indirect irradiance changes, and whose direct irradiance does.
    let mut changed = [[0; 2]; 2];
    for size in bench.images_or(&[[1, 1], [27, 1], [64, 3], [2049, 1], [61, 43]]) {
        let planes = filters().into_iter().filter(|(filter, _)| filter.has_sparse());
        for (i, (filter, pattern)) in planes.enumerate() {
            // It has faded in the later ones.
            let rig = seen_in_pass(bench, &scene, size, pattern, i as u32);
            let guides = guides(&rig, filter.agreement);
            let pixels = (size[0] * size[1]) as usize;
            // Some are much brighter than those around.
            let uneven = |e: Vec3| e * if e.x > 0.9 { 40.0 } else { 1.0 };
            let irradiance: [Vec<Vec3>; 2] =
                [0, 1].map(|k| random(guides.len() + k)[k..].iter().copied().map(uneven).collect());
            let given = [&irradiance[0][..], &irradiance[1][..]];
            let before = filtered(bench, &rig, filter, given);
            let after = filtered_with(bench, &rig, filter, given, true);
            let window = Window::new(&filter, pattern);
            let listed = rig.ideal_pixels();
            let mut tally = Tally::new(format!("sparse windows, {size:?}, {filter:?}, pattern {pattern:?}"));
            for (component, changed) in changed.iter_mut().enumerate().take(guides.len() / pixels) {
                let slots = component * pixels..(component + 1) * pixels;
                let guides = &guides[slots.clone()];
                let lacks = discontinuity::lacks(&rig.parameters, filter.agreement, &window, guides);
                let [direct, indirect] = before.each_ref().map(|all| &all[slots.clone()]);
                let expected = [
                    sparse_windows::direct(&rig.parameters, guides, &lacks, direct),
                    sparse_windows::indirect(&rig.parameters, guides, &lacks, indirect),
                ];
                for (pixel, slot) in slots.enumerate() {
                    if component == 1 && listed.binary_search(&(pixel as u32)).is_err() {
                        let all = [(0, filter.direct), (1, true)].into_iter().filter(|&(_, is_filtered)| is_filtered);
                        let sentinel = f32::from_bits(crate::conform::SENTINEL);
                        let kept = all.map(|(kind, _)| after[kind][slot]).all(|e| untouched(e.extend(sentinel)));
                        tally.check(kept, || format!("slot {slot} is not listed"));
                        continue;
                    }
                    for kind in 0..2 {
                        let (old, found) = (before[kind][slot], after[kind][slot]);
                        let e = if kind == 1 || filter.direct { expected[kind][pixel] } else { old };
                        tally.check_values(close(found, e, 1e-4, 1e-4), &[(found, e)], || {
                            format!("slot {slot}: {found} for {e}, {old} before")
                        });
                        changed[kind] += usize::from((e - old).length() > 1e-3);
                    }
                }
            }
            tally.finish(STRAYS);
        }
    }
    bench.covered(changed[0].iter().all(|&n| n > 500) && changed[1][1] > 50, format_args!("{changed:?} slots change"));
}
