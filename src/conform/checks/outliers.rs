//! Outliers by unlikely paths against their oracle.

use crate::conform::Bench;
use crate::pass::{ShadingPoints, outliers};
use crate::settings::{Filter, Settings, Superposition};
use crate::stage::Stage;
use glam::{Vec3, Vec4};

use crate::conform::rig::{Rig, Tally, close, gallery, has};

/// Compares what is taken from each slot of the tiles with the oracle. Returns how many slots lost emission, and how many kept theirs
/// though the path to them was unlikely.
fn follow(rig: &Rig) -> [usize; 2] {
    rig.light();
    rig.run(|frame, rec| {
        frame.third_light.run(rec)?;
        frame.discontinuity.run(rec)?;
        frame.path_gain.run(rec)?;
        frame.glossy_light.run(rec)?;
        frame.discontinuity_lobes.run(rec)
    });
    let (frame, p) = (rig.frame(), &rig.parameters);
    let pixels = p.size[2];
    let points = &frame.eye.points;
    let [wo, kd, before] = [&points.wo, &points.kd, &points.emitted].map(|b| rig.vec4s(b));
    let throughput = rig.vec4s(&frame.eye.paths.throughput);
    let filter = frame.discontinuity.as_ref().unwrap();
    let lighting = frame.discontinuity_lobes.as_ref().map_or(&filter.filtered, |lobes| &lobes.filtered);
    let sums = [&lighting.direct, &lighting.indirect, &lighting.specular].map(|b| rig.vec4s(b));
    let regions: Vec<u32> = rig.get(&frame.eye.planes.region);
    let Some(pass) = &frame.outliers else {
        assert!(wo.len() == pixels as usize, "without second components there are no outliers");
        return [0; 2];
    };
    rig.prefill(&[&pass.removed]);
    let path_gain = &frame.gain.as_ref().unwrap().path_gain;
    let gain_before = rig.vec4s(path_gain);
    rig.run(|frame, rec| frame.outliers.run(rec));
    let (after, gain_after) = (rig.vec4s(&points.emitted), rig.vec4s(path_gain));
    let radiance = |i: usize| -> Vec3 {
        let light =
            if has(wo[i], ShadingPoints::LIT) { sums.each_ref().map(|s| s[i].truncate()) } else { [Vec3::ZERO; 3] };
        let irradiance = light[0] + light[1];
        let reflected = kd[i].truncate() * std::f32::consts::FRAC_1_PI * irradiance + light[2];
        before[i].truncate() + throughput[i].truncate() * reflected
    };
    let listed = rig.ideal_pixels();
    let mut tally = Tally::new(format!("outliers at {:?}", p.size));
    let mut seen = [0; 2];
    for pixel in 0..pixels {
        let mut taken = Vec3::ZERO;
        for component in 0..2 {
            let i = (pixel + component * pixels) as usize;
            let is_listed = listed.binary_search(&pixel).is_ok();
            let spreads = p.superposition[0] > 0 && is_listed && regions[pixel as usize] > 0;
            let expected = match is_listed && !spreads && has(wo[i], ShadingPoints::UNLIKELY | ShadingPoints::DEEP) {
                false => Vec3::ZERO,
                true => {
                    let around = outliers::around(p, pixel);
                    let others: Vec<Vec3> =
                        around.iter().map(|n| radiance((n + component * pixels) as usize)).collect();
                    let taken = outliers::reference(p, before[i].truncate(), radiance(i), &others);
                    seen[usize::from(taken == Vec3::ZERO)] += 1;
                    taken
                }
            };
            let bits = |v: Vec4| v.to_array().map(f32::to_bits);
            // Nothing has written the second components of other pixels.
            if !is_listed {
                assert_eq!(bits(before[i]), bits(after[i]), "slot {i}");
                continue;
            }
            let found = before[i].truncate() - after[i].truncate();
            let near = 1e-5 * (1.0 + before[i].max_element());
            tally.check_values(close(found, expected, 1e-3, near), &[(found, expected)], || {
                format!("slot {i}: {found} for {expected}")
            });
            taken += found;
        }
        let noted = gain_before[pixel as usize] - gain_after[pixel as usize];
        assert!(close(noted.truncate(), taken, 1e-4, 1e-5), "pixel {pixel}: {noted} for {taken}");
    }
    tally.finish(0.0);
    seen
}

pub fn outliers_follow_their_oracle(bench: &Bench) {
    let scene = gallery();
    let mut seen = [0; 2];
    for superposition in [None, Some(Superposition::default())] {
        for (i, resolution) in bench.images().chain([[97, 61], [160, 120]]).enumerate() {
            let settings = Settings {
                particles: 3,
                pattern: [3, 3],
                filter: Some(Filter::default()),
                superposition,
                ..Settings::plain()
            };
            // The filter of the later ones has faded.
            let rig = bench.rig_at_pass(&scene, resolution, settings, 20 * i as u32);
            follow(&rig).into_iter().zip(&mut seen).for_each(|(n, all)| *all += n);
        }
    }
    log::info!("{} slots lost emission, {} kept it", seen[0], seen[1]);
    bench.covered(seen.iter().all(|&n| n > 20), format_args!("{seen:?}"));
}
