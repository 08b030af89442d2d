//! The discontinuity buffer against its oracle, and its guarantees: it preserves constants and energy, and keeps edges
//! and textures sharp.

use glam::{Vec3, Vec4};
use lightsum::gpu::{Context, upload};
use lightsum::pass::discontinuity::{self, Discontinuity, Guide, Inputs, PixelPoint, agree, guide};
use lightsum::pass::discontinuity_lobes::{self, DiscontinuityLobes, Gloss};
use lightsum::pass::layout::Window;
use lightsum::pass::{Lighting, ShadingPoints};
use lightsum::scene::{Light, Material, Scene, Texture, Wrap};
use lightsum::settings::{Agreement, Filter, Settings};
use lightsum::stage::Stage;

use crate::rig::{Builder, Numbers, Rig, STRAYS, Tally, close, gallery, has, is_lit, untouched};
use crate::scenes::{Soup, camera, render};
use crate::support::gpu_test;

/// The guides of all slots by the oracle; second components of tiles that are not listed take no part.
fn guides(rig: &Rig, agreement: Agreement) -> Vec<Guide> {
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
        let lit = |j: usize, inside: bool| (i >= pixels && inside && is_lit(wo[j])).then(|| position[j].truncate());
        let neighbours = [
            [lit(i.wrapping_sub(1), x % 8 > 0), lit(i + 1, x % 8 < 7 && x + 1 < width)],
            [lit(i.wrapping_sub(width), y % 8 > 0), lit(i + width, y % 8 < 7 && y + 1 < height)],
        ];
        guide(&rig.parameters, agreement, &receiver, neighbours)
    };
    (0..position.len()).map(of_slot).collect()
}

/// The filtered lighting for this direct and indirect irradiance of all slots.
fn filtered(ctx: &Context, rig: &Rig, filter: Filter, irradiance: [&[Vec3]; 2]) -> [Vec<Vec3>; 2] {
    let frame = rig.frame();
    let [direct, indirect] = irradiance.map(|all| {
        let wide: Vec<Vec4> = all.iter().map(|e| e.extend(0.0)).collect();
        upload(ctx, "irradiance", bytemuck::cast_slice::<Vec4, f32>(&wide)).unwrap()
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
    rig.prefill(&[&pass.filtered.indirect]);
    if filter.direct {
        rig.prefill(&[&pass.filtered.direct]);
    }
    rig.run(|_, rec| pass.record(rec));
    [&pass.filtered.direct, &pass.filtered.indirect].map(|b| rig.vec4s(b).iter().map(|e| e.truncate()).collect())
}

/// The visible shading points of a scene in its first pass.
fn seen<'a>(ctx: &'a Context, scene: &'a Scene, size: [u32; 2], pattern: [u32; 2]) -> Rig<'a> {
    seen_in_pass(ctx, scene, size, pattern, 0)
}

fn seen_in_pass<'a>(ctx: &'a Context, scene: &'a Scene, size: [u32; 2], pattern: [u32; 2], pass: u32) -> Rig<'a> {
    let rig = Rig::at_pass(ctx, scene, size, Settings { particles: 1, pattern, ..Settings::plain() }, pass);
    rig.run(|frame, rec| frame.eye.record(rec));
    rig
}

fn random(count: usize) -> Vec<Vec3> {
    let mut numbers = Numbers(count as u32);
    (0..count).map(|_| numbers.vec3()).collect()
}

fn filters() -> Vec<(Filter, [u32; 2])> {
    let filter = |window, direct, agreement| Filter { window, direct, agreement };
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

#[test]
fn lobes_follow_their_oracle() {
    gpu_test(|ctx| {
        let scene = gallery();
        let mut averaged = 0;
        for size in [[1, 1], [27, 1], [64, 3], [2049, 1], [97, 61]] {
            for (i, (filter, pattern)) in filters().into_iter().enumerate() {
                // The filter of the later ones has faded.
                let rig = seen_in_pass(ctx, &scene, size, pattern, 40 * i as u32);
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
                let specular = upload(ctx, "radiance", bytemuck::cast_slice::<Vec4, f32>(&wide)).unwrap();
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
        assert!(averaged > 2000, "{averaged} pixels are averaged");
    });
}

#[test]
fn discontinuity_follows_its_oracle() {
    gpu_test(|ctx| {
        let scene = gallery();
        let mut averaged = [0; 2];
        for size in [[1, 1], [27, 1], [64, 3], [2049, 1], [31, 17]] {
            for (i, (filter, pattern)) in filters().into_iter().enumerate() {
                // The filter of the later ones has faded.
                let rig = seen_in_pass(ctx, &scene, size, pattern, 40 * i as u32);
                let guides = guides(&rig, filter.agreement);
                let pixels = (size[0] * size[1]) as usize;
                let irradiance = [random(guides.len()), random(guides.len() + 1)[1..].to_vec()];
                let found = filtered(ctx, &rig, filter, [&irradiance[0], &irradiance[1]]);
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
                                tally.check(
                                    untouched(found[slot].extend(f32::from_bits(crate::support::SENTINEL))),
                                    || format!("slot {slot} is not listed"),
                                );
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
        assert!(averaged[0] > 10_000 && averaged[1] > 100, "hardly anything is averaged: {averaged:?}");
    });
}

#[test]
fn constants_and_the_sum_of_irradiance_stay() {
    gpu_test(|ctx| {
        let scene = gallery();
        for (filter, pattern) in filters() {
            let rig = seen(ctx, &scene, [61, 43], pattern);
            let guides = guides(&rig, filter.agreement);
            let constant = vec![Vec3::new(0.3, 7.0, 1e-3); guides.len()];
            let noise = random(guides.len());
            let [_, even] = filtered(ctx, &rig, filter, [&noise, &constant]);
            let [_, spread] = filtered(ctx, &rig, filter, [&constant, &noise]);
            let takes_part = |i: &usize| guides[*i].extent > 0.0;
            let live: Vec<usize> = (0..guides.len()).filter(takes_part).collect();
            assert!(live.iter().all(|&i| even[i] == constant[i]), "{filter:?}: a constant changes");
            let sum = |all: &[Vec3]| live.iter().map(|&i| all[i].as_dvec3()).sum::<glam::DVec3>();
            let ratio = sum(&spread) / sum(&noise);
            let changed = live.iter().filter(|&&i| (spread[i] - noise[i]).length() > 1e-3).count();
            assert!(3 * changed > live.len(), "{filter:?}: {changed} of {} change", live.len());
            if filter.agreement == Agreement::Plane {
                assert!((ratio - 1.0).abs().max_element() < 1e-6, "{filter:?}: the sum becomes {ratio} of what it was");
            }
        }
    });
}

/// Where all pixels agree, each gets the same weight from every class of the pattern: with a constant for each class
/// only the mean of all shows.
#[test]
fn a_pattern_vanishes_on_a_plane() {
    gpu_test(|ctx| {
        let mut b = Builder::default();
        let grey = b.material(Material::default());
        b.quad(Vec3::new(-9.0, 0.0, -9.0), Vec3::Z * 18.0, Vec3::X * 18.0, grey, 1.0);
        b.0.lights.push(Light::Point { position: Vec3::Y, intensity: Vec3::ONE });
        let scene = b.finish(Vec3::new(0.0, 2.0, -0.5), Vec3::ZERO);
        let size = [40, 31];
        for pattern in [[2, 2], [3, 3], [4, 3], [5, 2], [8, 7]] {
            for more in [0, 2] {
                let window = Filter::default().window(pattern).map(|n| (n + more).min(Filter::MAX_WINDOW));
                let filter = Filter { window: Some(window), ..Filter::default() };
                let rig = seen(ctx, &scene, size, pattern);
                let class = |i: u32| i % size[0] % pattern[0] + i / size[0] % pattern[1] * pattern[0];
                let classes = random((pattern[0] * pattern[1]) as usize);
                let irradiance: Vec<Vec3> = (0..size[0] * size[1]).map(|i| classes[class(i) as usize]).collect();
                let [found, _] = filtered(ctx, &rig, filter, [&irradiance, &irradiance]);
                let mean = classes.iter().sum::<Vec3>() / classes.len() as f32;
                let [rx, ry] = window.map(|n| n / 2);
                for y in ry..size[1] - ry {
                    for x in rx..size[0] - rx {
                        let e = found[(x + y * size[0]) as usize];
                        assert!(close(e, mean, 1e-5, 0.0), "{filter:?}, {pattern:?}, {x} {y}: {e} for {mean}");
                    }
                }
            }
        }
    });
}

#[test]
fn edges_of_a_cube_stay_sharp() {
    gpu_test(|ctx| {
        let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
        let mut b = Builder::default();
        let grey = b.material(Material::default());
        b.quad(Vec3::new(-1.0, 1.0, -1.0), z * 2.0, x * 2.0, grey, 1.0);
        b.quad(Vec3::new(-1.0, -1.0, -1.0), y * 2.0, x * 2.0, grey, 1.0);
        b.quad(Vec3::new(1.0, -1.0, -1.0), y * 2.0, z * 2.0, grey, 1.0);
        b.0.lights.push(Light::Point { position: Vec3::new(3.0, 5.0, -4.0), intensity: Vec3::ONE });
        let scene = b.finish(Vec3::new(2.4, 2.2, -2.6), Vec3::ZERO);
        for (filter, pattern) in filters() {
            let rig = seen(ctx, &scene, [61, 43], pattern);
            let normals: Vec<Vec3> =
                rig.vec4s(&rig.frame().eye.points.geometric).iter().map(|n| n.truncate()).collect();
            let guides = guides(&rig, filter.agreement);
            let live: Vec<usize> = (0..guides.len()).filter(|&i| guides[i].extent > 0.0).collect();
            let face: Vec<Vec3> = normals.iter().map(|n| n.abs() * Vec3::new(1.0, 2.0, 4.0)).collect();
            for axis in Vec3::AXES {
                let count = live.iter().filter(|&&i| normals[i].dot(axis).abs() > 0.9).count();
                assert!(count > 100, "{count} pixels show the face {axis}");
            }
            let [_, found] = filtered(ctx, &rig, filter, [&face, &face]);
            assert!(live.iter().all(|&i| found[i] == face[i]), "{filter:?}: faces mix");
        }
    });
}

/// A sheet slightly above the floor, which the paper's test cannot distinguish from it.
#[test]
fn offset_planes_stay_apart() {
    gpu_test(|ctx| {
        let mut b = Builder::default();
        let grey = b.material(Material::default());
        b.quad(Vec3::new(-9.0, 0.0, -9.0), Vec3::Z * 18.0, Vec3::X * 18.0, grey, 1.0);
        b.quad(Vec3::new(0.0, 0.02, -9.0), Vec3::Z * 18.0, Vec3::X * 9.0, grey, 1.0);
        b.0.lights.push(Light::Point { position: Vec3::Y * 2.0, intensity: Vec3::ONE });
        let scene = b.finish(Vec3::new(0.0, 3.0, -1.0), Vec3::ZERO);
        let rig = seen(ctx, &scene, [61, 43], [1, 1]);
        let height: Vec<Vec3> = rig
            .vec4s(&rig.frame().eye.points.position)
            .iter()
            .map(|p| if p.y > 0.01 { Vec3::ONE } else { Vec3::ZERO })
            .collect();
        let mixed = |agreement| {
            let [found, _] = filtered(ctx, &rig, Filter { agreement, ..Filter::default() }, [&height, &height]);
            found.iter().zip(&height).filter(|(a, b)| a != b).count()
        };
        assert_eq!(mixed(Agreement::Plane), 0);
        assert!(mixed(Agreement::DepthAndNormal) >= 43, "the paper's test is better than it was");
    });
}

/// Neighbours on a ball, which recedes from the eye towards its silhouette.
#[test]
fn curved_surfaces_agree() {
    gpu_test(|ctx| {
        let mut b = Builder::default();
        let grey = b.material(Material::default());
        b.sphere(Vec3::ZERO, 1.0, 3, grey, false);
        b.0.lights.push(Light::Point { position: Vec3::new(1.0, 3.0, -3.0), intensity: Vec3::ONE });
        let scene = b.finish(Vec3::new(0.0, 0.0, -2.5), Vec3::ZERO);
        let rig = seen(ctx, &scene, [61, 43], [1, 1]);
        let share = |agreement| {
            let guides = guides(&rig, agreement);
            let pairs: Vec<(&Guide, &Guide)> = (0..guides.len() - 1)
                .filter(|i| i % 61 != 60)
                .map(|i| (&guides[i], &guides[i + 1]))
                .filter(|(a, b)| a.extent.min(b.extent) > 0.0)
                .collect();
            let agreeing = pairs.iter().filter(|(a, b)| agree(&rig.parameters, agreement, a, b, 1.0)).count();
            agreeing as f64 / pairs.len() as f64
        };
        let [plane, paper] = [share(Agreement::Plane), share(Agreement::DepthAndNormal)];
        println!("neighbours on a ball that agree: {plane:.3} by planes, {paper:.3} by distances");
        assert!(plane > 0.93 && plane > paper, "{plane} by planes, {paper} by distances");
    });
}

#[test]
fn textures_stay_sharp() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("textured plane");
        let texels = (0..64 * 64).map(|i| if (i + i / 64) % 2 == 0 { [255; 4] } else { [60, 90, 120, 255] });
        soup.0.textures.push(Texture {
            name: String::from("chequers"),
            width: 64,
            height: 64,
            texels: texels.collect(),
            srgb: false,
            wrap: [Wrap::Repeat; 2],
        });
        let cloth =
            soup.material(Material { base_texture: Some(0), base_color: Vec3::splat(0.8), ..Material::default() });
        let lamp = soup.diffuse(0.0, 5.0);
        soup.quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, cloth);
        soup.quad(Vec3::new(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z, lamp);
        let view = camera(Vec3::new(0.0, 1.5, -0.4), Vec3::ZERO, 40.0, [48, 40]);
        // One particle: four points on the lamp leave steps hardly larger than the changes along the plane.
        let settings = Settings { particles: 1, pattern: [3, 3], ..Settings::plain() };
        let plain = render(ctx, &soup.0, view, &settings, 1);
        let filter = Some(Filter::default());
        let smooth = render(ctx, &soup.0, view, &Settings { filter, ..settings }, 1);
        assert!(plain.albedo == smooth.albedo, "the reflectance is filtered");
        assert!(plain.direct != smooth.direct, "the irradiance is not filtered");
        let steps =
            |layer: &[Vec3]| -> f32 { layer.windows(2).map(|w| (w[1].x - w[0].x).abs() / w[0].x.max(1e-6)).sum() };
        let (contrast, noise) = (steps(&smooth.albedo), [steps(&plain.direct), steps(&smooth.direct)]);
        assert!(noise[1] < 0.5 * noise[0], "steps of irradiance fall only from {} to {}", noise[0], noise[1]);
        assert!(contrast > 5.0 * noise[1], "contrast {contrast} beside {}", noise[1]);
        for i in 0..smooth.color.len() {
            let expected = smooth.albedo[i] / std::f32::consts::PI * (smooth.direct[i] + smooth.indirect[i]);
            assert!(close(smooth.color[i], expected, 1e-3, 1e-6), "pixel {i}: {} for {expected}", smooth.color[i]);
        }
    });
}

/// Filtered passes add up like any others, and without the filter the image is unfiltered.
#[test]
fn filtered_passes_accumulate() {
    gpu_test(|ctx| {
        let scene = gallery();
        let view = lightsum::scene::Camera { resolution: [31, 17], ..scene.camera.unwrap() };
        let plain = Settings { particles: 2, pattern: [2, 2], ..Settings::plain() };
        let settings = Settings { filter: Some(Filter::default()), ..plain.clone() };
        let [one, three] = [1, 3].map(|passes| render(ctx, &scene, view, &settings, passes));
        let again = render(ctx, &scene, view, &settings, 3);
        assert!(three.color == again.color && three.indirect == again.indirect, "the same settings give other bits");
        assert!(one.color != three.color && three.color.iter().all(|c| c.is_finite()));
        let rig = Rig::new(ctx, &scene, [8, 8], plain);
        assert!(rig.frame().discontinuity.is_none());
    });
}
