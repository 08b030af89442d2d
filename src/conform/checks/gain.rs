//! The sums of the radiance that the filters add against their oracle.

use crate::conform::Bench;
use crate::pass::gain;
use crate::pass::{Lighting, ShadingPoints};
use crate::settings::{Filter, Settings, Superposition};
use crate::stage::Stage;
use glam::{Vec3, Vec4};

use crate::conform::rig::{Rig, Tally, close, gallery, has};

/// Direct, indirect and specular light of each slot, zero where it is not lit.
fn light(rig: &Rig, lighting: &Lighting, wo: &[Vec4]) -> Vec<[Vec3; 3]> {
    let arrays = [&lighting.direct, &lighting.indirect, &lighting.specular].map(|b| rig.vec4s(b));
    let of_slot = |(i, &wo): (usize, &Vec4)| match has(wo, ShadingPoints::LIT) {
        true => [0, 1, 2].map(|k| arrays[k][i].truncate()),
        false => [Vec3::ZERO; 3],
    };
    // The filter has no third components.
    wo.iter().take(arrays[1].len()).enumerate().map(of_slot).collect()
}

fn three(rig: &Rig) -> [Vec<Vec3>; 2] {
    let frame = rig.frame();
    [&frame.eye.paths.throughput, &frame.eye.points.kd]
        .map(|b| rig.vec4s(b).into_iter().map(Vec4::truncate).collect::<Vec<_>>())
}

/// Records a frame stage by stage and compares what its filters add with the oracle. Returns the numbers of pixels that gained by
/// themselves, by their second component, and at an edge.
fn follow(rig: &Rig) -> [usize; 3] {
    rig.light();
    let (frame, pixels) = (rig.frame(), rig.parameters.size[2] as usize);
    rig.run(|frame, rec| frame.discontinuity.run(rec));
    let wo = rig.vec4s(&frame.eye.points.wo);
    let of_filter = &frame.discontinuity.as_ref().unwrap().filtered;
    let (raw, filtered) = (light(rig, &frame.shade.lighting, &wo), light(rig, of_filter, &wo));
    let [throughput, kd] = three(rig);
    rig.run(|frame, rec| {
        frame.path_gain.run(rec)?;
        frame.glossy_light.run(rec)?;
        frame.discontinuity_lobes.run(rec)?;
        frame.glossy_planes.run(rec)?;
        frame.merge.run(rec)
    });
    let before = rig.vec4s(&frame.eye.points.emitted);
    rig.run(|frame, rec| frame.edges.run(rec));
    let after = rig.vec4s(&frame.eye.points.emitted);
    let listed = rig.ideal_pixels();
    let regions: Vec<u32> = rig.get(&frame.eye.planes.region);
    let mirrors = rig.parameters.superposition[0] > 0;
    let by_path = |pixel: usize| {
        let spreads = mirrors && regions[pixel] > 0;
        if throughput.len() == pixels || spreads || listed.binary_search(&(pixel as u32)).is_err() {
            return Vec3::ZERO;
        }
        let slot = pixel + pixels;
        let [direct, indirect, _] = filtered[slot];
        let same = raw[slot][2];
        gain::reference(throughput[slot], kd[slot], [direct, indirect, same], raw[slot])
    };

    // The second components have joined their pixels by now.
    let last = frame.discontinuity_lobes.as_ref().map_or(of_filter, |lobes| &lobes.filtered);
    let (raw, filtered) = (light(rig, &frame.shade.lighting, &wo), light(rig, last, &wo));
    let [throughput, kd] = three(rig);
    let sums = &frame.output.film.gain.0;
    rig.run(|frame, rec| frame.output.record_clear(rec));
    rig.run(|frame, rec| frame.gain.run(rec));
    let found = rig.vec4s(&sums[0]);
    rig.run(|frame, rec| frame.gain.run(rec));
    let twice = rig.vec4s(&sums[0]);
    let mut tally = Tally::new(format!("gain at {:?}", rig.parameters.size));
    let mut seen = [0; 3];
    for pixel in 0..pixels {
        let own = gain::reference(throughput[pixel], kd[pixel], filtered[pixel], raw[pixel]);
        let path = by_path(pixel);
        let at_edge = after[pixel].truncate() - before[pixel].truncate();
        let expected = own + path + at_edge;
        let grey = expected.element_sum() / 3.0;
        let sum = found[pixel];
        // The pass clears the light of second components and edge rays, so a second run adds the pixel's own gain alone.
        assert!(close(twice[pixel].truncate() - sum.truncate(), own, 1e-4, 1e-6), "pixel {pixel}");
        let holds =
            close(sum.truncate(), expected, 1e-4, 1e-6) && (sum.w - grey * grey).abs() <= 1e-3 * grey * grey + 1e-9;
        tally.check_values(holds, &[(sum.truncate(), expected)], || format!("pixel {pixel}: {sum} for {expected}"));
        seen[0] += usize::from(own != Vec3::ZERO);
        seen[1] += usize::from(path != Vec3::ZERO);
        seen[2] += usize::from(at_edge != Vec3::ZERO);
    }
    tally.finish(0.0);
    seen
}

pub fn the_gain_is_what_the_filters_add(bench: &Bench) {
    let scene = gallery();
    let mut seen = [0; 3];
    for superposition in [None, Some(Superposition::default())] {
        for (i, resolution) in bench.images().enumerate() {
            let settings = Settings {
                particles: 3,
                pattern: [3, 3],
                filter: Some(Filter::default()),
                antialias: i % 2 == 1,
                superposition,
                ..Settings::plain()
            };
            // The filter of the later ones has faded.
            let rig = bench.rig_at_pass(&scene, resolution, settings, 60 * i as u32);
            follow(&rig).into_iter().zip(&mut seen).for_each(|(n, all)| *all += n);
        }
    }
    bench.covered(seen.iter().all(|&n| n > 30), format_args!("{seen:?}"));
}
