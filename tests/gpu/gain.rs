//! The image leaves out the filter's bias.

use ash::vk;
use glam::{DVec4, Vec3, Vec4};
use lightsum::film::Film;
use lightsum::gpu::{Buffer, Image, Memory, Staging};
use lightsum::pass::gain;
use lightsum::pass::resolve::Resolve;
use lightsum::settings::{Filter, Settings};

use crate::rig::close;
use crate::scenes::{Soup, camera, compare, render, settings};
use crate::support::gpu_test;
use lightsum::conform::checks::film::fill;
use lightsum::conform::{AWKWARD_IMAGES, Numbers};

/// The image of a device film is its mean less the part of the gain that the oracle calls bias, and so is the host's.
#[test]
fn bias_is_taken_from_the_image() {
    gpu_test(|ctx| {
        let mut taken = 0;
        for (passes, [width, height]) in [3, 4, 9, 64, 1000].into_iter().zip(AWKWARD_IMAGES) {
            let film = Film::new(ctx, width * height, false).unwrap();
            let n = &mut Numbers(passes);
            let colors = [0, 1].map(|i| fill(ctx, &film.color[i].0[0], n, 100.0, |_| 1.0));
            // Squares of gains that all passes have, nearly: then their variance is small.
            let spread = |i: u32| 1.0 + 0.4 * i as f32 / (width * height) as f32 * passes as f32;
            let gains: Vec<Vec4> = fill(ctx, &film.gain.0[0], n, 10.0, |_| 0.0)
                .into_iter()
                .zip(0..)
                .map(|(gain, i)| {
                    let grey = gain.truncate().element_sum() / 3.0;
                    gain.truncate().extend(grey * grey / passes as f32 * spread(i))
                })
                .collect();
            let image = Image::new(ctx, "image", width, height, vk::Format::R32G32B32A32_SFLOAT).unwrap();
            let out = Buffer::new(ctx, "copied image", image.bytes(), Memory::Readback).unwrap();
            let pass = Resolve::new(ctx, &film, &image).unwrap();
            let mut staging = Staging::new();
            staging.stage_into(ctx, &film.counts, 0, &[passes.div_ceil(2), passes / 2]).unwrap();
            staging.stage_into(ctx, &film.gain.0[0], 0, &gains).unwrap();
            ctx.submit_and_wait("resolve", None, |rec| {
                for buffer in film.color.iter().flat_map(|sum| &sum.0[1..]).chain(&film.gain.0[1..]) {
                    rec.fill(buffer, 0)?;
                }
                staging.record(rec)?;
                rec.image_to_general(&image)?;
                pass.record(rec)?;
                rec.copy_image_to_buffer(&image, &out)
            })
            .unwrap();
            let host = film.mean(ctx, [width, height], lightsum::output::Wanted::Color).unwrap();
            let moments: Vec<[f64; 2]> =
                gains.iter().map(|g| gain::moments(g.as_dvec4() / f64::from(passes), passes)).collect();
            for (i, found) in out.read::<Vec4>().unwrap().into_iter().enumerate() {
                let (x, y) = (i as i64 % i64::from(width), i as i64 / i64::from(width));
                let near = (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (x + dx, y + dy)));
                let inside = near.filter(|(x, y)| (0..width.into()).contains(x) && (0..height.into()).contains(y));
                let share = gain::share(inside.map(|(x, y)| moments[(y * i64::from(width) + x) as usize]), passes);
                assert!((0.0..=1.0).contains(&share) && (passes >= gain::MIN_PASSES || share == 0.0), "{share}");
                let whole = colors[0][i].as_dvec4() + colors[1][i].as_dvec4();
                let less: DVec4 = (gains[i].truncate().as_dvec3() * share).extend(0.0);
                let expected = ((whole - less) / f64::from(passes)).as_vec4().truncate();
                let bound = 1e-4 / passes as f32 * 100.0;
                for (name, found) in [("device", found.truncate()), ("host", host.color[i])] {
                    assert!(
                        close(found, expected, 1e-5, bound),
                        "{name}, pixel {i} of {width}x{height}: {found} for {expected}"
                    );
                }
                taken += usize::from(share > 0.1 && share < 0.9);
            }
        }
        assert!(taken > 100, "{taken}");
    });
}

/// A wide filter blurs the shadow of a sheet, in the layers of irradiance too; the image has it nearly as sharp as without the filter.
#[test]
fn the_blur_of_the_filter_vanishes() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("a sheet over a floor");
        let floor = soup.diffuse(0.7, 0.0);
        let lamp = soup.diffuse(0.0, 5.0);
        soup.quad(Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::Z * -4.0, floor);
        soup.quad(Vec3::new(-0.6, 0.15, 0.6), Vec3::X * 1.2, Vec3::Z * -1.2, floor);
        soup.quad(Vec3::new(-1.5, 3.0, -0.2), Vec3::X * 0.4, Vec3::Z * 0.4, lamp);
        let camera = camera(Vec3::new(0.5, 2.0, 3.0), Vec3::ZERO, 45.0, [60, 40]);
        let wide = Some(Filter { window: Some([9, 9]), ..Filter::default() });
        let settings = |filter| Settings { pattern: [3, 3], filter, ..settings(16, 2) };
        let sharp = render(ctx, &soup.0, camera, &settings(None), 1000).color;
        let filtered = render(ctx, &soup.0, camera, &settings(wide), 64);
        let irradiance = filtered.direct.iter().zip(&filtered.indirect).map(|(direct, indirect)| *direct + *indirect);
        let blurred: Vec<Vec3> =
            filtered.albedo.iter().zip(irradiance).map(|(kd, e)| *kd * e * std::f32::consts::FRAC_1_PI).collect();
        let (energy, error) = compare(&filtered.color, &sharp);
        let (_, before) = compare(&blurred, &sharp);
        assert!(before > 0.1 && error < 0.5 * before, "{error}, {before} with the blur");
        assert!((energy - 1.0).abs() < 0.01, "{energy}");
    });
}
