//! The light of unlikely components is spread as its oracle says; the sum of light stays.

use crate::conform::Bench;
use crate::pass::{ShadingPoints, unlikely};
use crate::settings::{Filter, Settings, Superposition};
use crate::stage::Stage;
use glam::{DVec3, Vec3};

use crate::conform::rig::{Rig, Tally, close, gallery, has};

/// Compares the change of each slot of the tiles with the oracle. Returns how many slots gave light away, and how many of an unlikely path had
/// no likely one around.
fn follow(rig: &Rig) -> [usize; 2] {
    rig.light();
    rig.run(|frame, rec| {
        frame.discontinuity.run(rec)?;
        frame.path_gain.run(rec)?;
        frame.glossy_light.run(rec)?;
        frame.discontinuity_lobes.run(rec)?;
        frame.outliers.run(rec)
    });
    let (frame, p) = (rig.frame(), &rig.parameters);
    let pixels = p.size[2];
    let Some(pass) = &frame.unlikely else { panic!("an image of the gallery has second components") };
    let points = &frame.eye.points;
    let [wo, kd, before] = [&points.wo, &points.kd, &points.emitted].map(|b| rig.vec4s(b));
    let throughput = rig.vec4s(&frame.eye.paths.throughput);
    let filter = frame.discontinuity.as_ref().unwrap();
    let lighting = frame.discontinuity_lobes.as_ref().map_or(&filter.filtered, |lobes| &lobes.filtered);
    let sums = [&lighting.direct, &lighting.indirect, &lighting.specular].map(|b| rig.vec4s(b));
    let regions: Vec<u32> = rig.get(&frame.eye.planes.region);
    rig.prefill(&[&pass.surplus]);
    let path_gain = &frame.gain.as_ref().unwrap().path_gain;
    let gain_before = rig.vec4s(path_gain);
    rig.run(|frame, rec| frame.unlikely.run(rec));
    let (after, gain_after) = (rig.vec4s(&points.emitted), rig.vec4s(path_gain));
    let radiance = |i: usize| -> Vec3 {
        let light =
            if has(wo[i], ShadingPoints::LIT) { sums.each_ref().map(|s| s[i].truncate()) } else { [Vec3::ZERO; 3] };
        let reflected = kd[i].truncate() * std::f32::consts::FRAC_1_PI * (light[0] + light[1]) + light[2];
        before[i].truncate() + throughput[i].truncate() * reflected
    };
    let listed = rig.ideal_pixels();
    let is_listed = |pixel: u32| listed.binary_search(&pixel).is_ok();
    let takes = |pixel: u32, slot: u32| {
        let spreads = p.superposition[0] > 0 && regions[pixel as usize] > 0;
        is_listed(pixel) && !spreads && has(wo[slot as usize], ShadingPoints::CHOSE)
    };
    let is_unlikely = |slot: u32| has(wo[slot as usize], ShadingPoints::UNLIKELY);
    let mut expected = vec![Vec3::ZERO; before.len()];
    let (mut seen, mut sums) = ([0; 2], [DVec3::ZERO; 2]);
    for pixel in 0..pixels {
        for component in 0..2 {
            let slot = pixel + component * pixels;
            if !takes(pixel, slot) || !is_unlikely(slot) {
                continue;
            }
            let of = |n: u32| n + component * pixels;
            let around: Vec<u32> =
                unlikely::around(p, pixel).into_iter().filter(|&n| takes(n, of(n))).map(of).collect();
            assert!(around.contains(&slot));
            let through = |n: u32| throughput[n as usize].truncate().element_sum() / 3.0;
            let other = |n: u32| unlikely::Other {
                radiance: radiance(n as usize),
                through: through(n),
                likely: !is_unlikely(n),
            };
            let others: Vec<_> = around.iter().map(|&n| other(n)).collect();
            let [surplus, part] = unlikely::reference(p, &other(slot), &others);
            seen[usize::from(surplus == Vec3::ZERO)] += 1;
            expected[slot as usize] -= surplus;
            around.iter().for_each(|&n| expected[n as usize] += through(n) * part);
        }
    }
    let mut tally = Tally::new(format!("unlikely components at {:?}", p.size));
    for pixel in 0..pixels {
        let mut changed = Vec3::ZERO;
        for component in 0..2 {
            let i = (pixel + component * pixels) as usize;
            // Nothing has written the second components of other pixels.
            if !is_listed(pixel) {
                assert_eq!(before[i].to_array().map(f32::to_bits), after[i].to_array().map(f32::to_bits), "slot {i}");
                continue;
            }
            let found = after[i].truncate() - before[i].truncate();
            let near = 1e-5 * (1.0 + before[i].truncate().abs().max_element() + radiance(i).max_element());
            tally.check_values(close(found, expected[i], 1e-3, near), &[(found, expected[i])], || {
                format!("slot {i}: {found} for {}", expected[i])
            });
            changed += found;
            sums[0] += found.as_dvec3();
            sums[1] += found.abs().as_dvec3();
        }
        let noted = gain_after[pixel as usize] - gain_before[pixel as usize];
        assert!(close(noted.truncate(), changed, 1e-4, 1e-4), "pixel {pixel}: {noted} for {changed}");
    }
    tally.finish(0.0);
    assert!(sums[0].abs().max_element() <= 1e-4 * (1.0 + sums[1].max_element()), "light is kept: {sums:?}");
    seen
}

pub fn unlikely_components_follow_their_oracle(bench: &Bench) {
    let scene = gallery();
    let mut seen = [0; 2];
    for superposition in [None, Some(Superposition::default())] {
        for (i, resolution) in bench.images().chain([[97, 61], [240, 180]]).enumerate() {
            let settings = Settings {
                particles: 3,
                pattern: [3, 3],
                filter: Some(Filter::default()),
                superposition,
                ..Settings::plain()
            };
            // The filter of the later ones has faded.
            let rig = bench.rig_at_pass(&scene, resolution, settings, 20 * i as u32);
            if rig.frame().unlikely.is_some() {
                follow(&rig).into_iter().zip(&mut seen).for_each(|(n, all)| *all += n);
            }
        }
    }
    log::info!("{} slots gave light away, {} had no likely one around", seen[0], seen[1]);
    bench.covered(seen[0] > 100 && seen[1] > 5, format_args!("{seen:?}"));
}
