//! Outliers by unlikely paths follow their oracle, and their light comes back.

use glam::{Vec3, Vec4};
use lightsum::pass::{ShadingPoints, outliers};
use lightsum::scene::{Material, Surface};
use lightsum::settings::{Filter, Settings, Superposition};
use lightsum::stage::Stage;

use crate::rig::{AWKWARD_IMAGES, Rig, Tally, close, gallery, has};
use crate::scenes::{Soup, camera, mean, render};
use crate::support::gpu_test;

/// Compares what is taken from each slot of the tiles with the oracle. Returns how many slots lost emission, and how many kept theirs
/// though the path to them was unlikely.
fn follow(rig: &Rig) -> [usize; 2] {
    rig.light();
    rig.run(|frame, rec| {
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
            let expected = match is_listed && !spreads && has(wo[i], ShadingPoints::UNLIKELY) {
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

#[test]
fn outliers_follow_their_oracle() {
    gpu_test(|ctx| {
        let scene = gallery();
        let mut seen = [0; 2];
        for superposition in [None, Some(Superposition::default())] {
            for (i, resolution) in AWKWARD_IMAGES.into_iter().chain([[97, 61], [160, 120]]).enumerate() {
                let settings = Settings {
                    particles: 3,
                    pattern: [3, 3],
                    filter: Some(Filter::default()),
                    superposition,
                    ..Settings::plain()
                };
                // The filter of the later ones has faded.
                let rig = Rig::at_pass(ctx, &scene, resolution, settings, 20 * i as u32);
                follow(&rig).into_iter().zip(&mut seen).for_each(|(n, all)| *all += n);
            }
        }
        println!("{} slots lost emission, {} kept it", seen[0], seen[1]);
        assert!(seen.iter().all(|&n| n > 20), "{seen:?}");
    });
}

#[test]
fn light_behind_glass_comes_back() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("ball of glass under a lamp");
        let (wall, lamp) = (soup.diffuse(0.5, 0.0), soup.diffuse(0.0, 20.0));
        let glass = soup.material(Material { surface: Surface::Glass, ior: 1.5, ..Material::default() });
        soup.room(Vec3::ZERO, Vec3::splat(2.0), [wall; 6]);
        soup.quad(Vec3::new(0.9, 1.95, 0.9), Vec3::X * 0.3, Vec3::Z * 0.3, lamp);
        soup.ball(Vec3::new(1.0, 0.7, 0.9), 0.4, 32, glass);
        // Little but the ball.
        let view = camera(Vec3::new(1.0, 0.9, 2.0), Vec3::new(1.0, 0.7, 0.9), 42.0, [40, 40]);
        let energy = |filter, passes| {
            let settings = Settings { particles: 8, photons: 0, pattern: [3, 3], filter, ..Settings::plain() };
            mean(&render(ctx, &soup.0, view, &settings, passes).color).element_sum()
        };
        let whole = energy(None, 200);
        let [few, many] = [8, 200].map(|passes| energy(Some(Filter::default()), passes) / whole);
        println!("energy after 8 passes {few:.4}, after 200 {many:.4}");
        assert!((0.97..1.01).contains(&few), "{few}");
        assert!((many - 1.0).abs() < 0.003, "{many}");
    });
}
