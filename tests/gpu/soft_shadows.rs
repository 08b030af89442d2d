//! Soft shadows by convolution: the passes against their oracles, penumbrae in closed form, and many virtual lights.

use std::collections::BTreeSet;

use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};
use lightsum::accel::Ray;
use lightsum::engine::Engine;
use lightsum::gpu::Context;
use lightsum::light::emitters::Emitters;
use lightsum::pass::layout::PointLight;
use lightsum::pass::soft_shadow::TILE;
use lightsum::pass::soft_shadow::reference::{
    Kernel, Light, Quad, Seen, Tile, Word, on_plane, on_surface, ratio_of, window,
};
use lightsum::pass::{ShadingPoints, shade};
use lightsum::scene::{Camera, Light as SceneLight, Material, Scene};
use lightsum::settings::{Compensation, Filter, Settings, SoftShadows, Traversal};
use lightsum::stage::{self, Stage};
use lightsum::view::View;

use crate::rig::{
    Rig, STRAYS, Tally, close, gallery, gallery_with_alpha, has, hit_of, is_lit, orthographic, ray_of, xyz,
};
use crate::scenes::{Soup, camera, compare, fov, original, render, settings};
use crate::support::gpu_test;
use lightsum::conform::AWKWARD_IMAGES;
use lightsum::conform::checks::light::receivers;

fn soft(settings: Settings) -> Settings {
    Settings { soft_shadows: Some(SoftShadows::default()), ..settings }
}

fn stage<'a>(rig: &'a Rig) -> &'a stage::SoftShadows {
    rig.frame().soft_shadows.as_ref().unwrap()
}

/// A rig after its eye stage.
fn rig<'a>(ctx: &'a Context, scene: &'a Scene, resolution: [u32; 2], traversal: Traversal) -> Rig<'a> {
    let settings = Settings { compensation: Compensation::Off, traversal, ..settings(64, 5) };
    let rig = Rig::new(ctx, scene, resolution, soft(settings));
    // Second components that no path leads to are not written.
    rig.prefill(&[&rig.frame().eye.points.wo]);
    rig.walk_and_look();
    rig
}

/// The pixels with soft shadows are those that the eye sees directly; each is listed in the tile that shows it.
fn check_list(rig: &Rig) -> Vec<u32> {
    let (eye, pass) = (&rig.frame().eye, &stage(rig).pass);
    let [width, height, pixels, _] = rig.parameters.size;
    let wo = rig.vec4s(&eye.points.wo);
    let marked = |i: &u32| has(wo[*i as usize], ShadingPoints::SOFT);
    for i in 0..wo.len() as u32 {
        let expected = i < pixels && is_lit(wo[i as usize]) && !has(wo[i as usize], ShadingPoints::SEEN_BY_SPECULAR);
        assert_eq!(marked(&i), expected, "slot {i} of {width}x{height}");
    }
    rig.run(|_, rec| stage(rig).record_list(rec));
    let listed = rig.sorted(&pass.list);
    assert_eq!(listed.len() % 64, 0);
    let expected: Vec<u32> = (0..pixels).filter(marked).collect();
    assert_eq!(listed.iter().copied().collect::<BTreeSet<_>>().into_iter().collect::<Vec<_>>(), expected);
    let unsorted: Vec<u32> = rig.get(&pass.list.entries);
    let tile_of = |p: u32| (p % width / 8, p / width / 8);
    for cluster in unsorted[..listed.len()].chunks(64) {
        assert!(cluster.iter().all(|&p| tile_of(p) == tile_of(cluster[0])));
    }
    expected
}

/// Shares of an image that the checks met.
#[derive(Debug, Default)]
struct Met {
    blocked: usize,
    reached: usize,
    wide: usize,
    partly: usize,
}

/// Each pass of one emitter from the device's results of those before it.
fn check_emitter(rig: &Rig, k: usize, light: &Light, soft: &[u32], before: &[Vec3], met: &mut Met) {
    let (p, eye, stage) = (&rig.parameters, &rig.frame().eye, stage(rig));
    let pass = &stage.pass;
    let [width, height, pixels, _] = p.size;
    let what = format!("emitter {k}, {width}x{height}");
    let points = receivers(rig, &eye.points);
    rig.run(|_, rec| stage.record_rays(rec, k));
    let visible: Vec<u32> = rig.get(&pass.visible);
    let mut seen = Tally::new(format!("shadow rays, {what}"));
    let faces = |i: usize| light.faces(points[i].position, points[i].geometric);
    for i in soft.iter().map(|&i| i as usize).filter(|&i| faces(i)) {
        let ray = Ray { origin: points[i].position, t_max: 1.0, direction: light.centre - points[i].position };
        seen.check((visible[i] > 0) != rig.bvh().occluded(&ray), || format!("pixel {i}"));
    }
    seen.finish(STRAYS);

    rig.run(|_, rec| stage.record_blockers(rec, k));
    let [source, blockers]: [Vec<Vec4>; 2] = [&pass.source, &pass.blockers].map(|image| rig.texels(image));
    let lit = |i: usize| Word(source[i].w.to_bits()).lit();
    for i in 0..pixels as usize {
        let counts = soft.binary_search(&(i as u32)).is_ok() && faces(i);
        let expected = Word::of_pixel(counts.then_some(visible[i] > 0), points[i].geometric);
        assert_eq!(lit(i), expected.lit(), "{what}: pixel {i}");
        let normal = Word(source[i].w.to_bits()).normal();
        assert!(!counts || normal.dot(points[i].geometric) > 0.998, "{what}: pixel {i}: {normal}");
        assert!(!counts || source[i].xyz() == points[i].position);
    }
    let [origin, direction, hits] = [&pass.rays.origin, &pass.rays.direction, &pass.rays.hits].map(|b| rig.vec4s(b));
    let (across, down) = (width.div_ceil(2), height.div_ceil(2));
    let columns = width.div_ceil(TILE);
    let mut tiles = vec![Tile::default(); (columns * height.div_ceil(TILE)) as usize];
    let mut rays = Tally::new(format!("rays to blockers, {what}"));
    let listed = rig.sorted(&pass.blocked);
    for quad in 0..across * down {
        let corner = [quad % across * 2, quad / across * 2];
        let of_quad = (0..4).map(|i| [corner[0] + i % 2, corner[1] + i / 2]);
        let shown: Vec<usize> =
            of_quad.filter(|at| at[0] < width && at[1] < height).map(|[x, y]| (x + y * width) as usize).collect();
        let tile = &mut tiles[(corner[0] / TILE + corner[1] / TILE * columns) as usize];
        tile.lit |= shown.iter().any(|&i| lit(i) == Some(true));
        let blocked = shown.iter().copied().find(|&i| lit(i) == Some(false));
        tile.blocked |= blocked.is_some();
        let q = quad as usize;
        assert_eq!(listed.binary_search(&quad).is_ok(), blocked.is_some(), "{what}: quad {quad}");
        let Some(i) = blocked else {
            assert_eq!(blockers[q].w, 0.0, "{what}: quad {quad}");
            continue;
        };
        met.blocked += 1;
        let ray = ray_of(origin[q], direction[q]);
        let expected = light.centre - points[i].position;
        assert!(ray.origin == points[i].position && ray.t_max == 1.0, "{what}: quad {quad}");
        assert!(close(ray.direction, expected, 1e-5, 0.0), "{what}: quad {quad}: {ray:?}");
        rays.check_hit(rig, &ray, hit_of(hits[q]), || format!("quad {quad}"));
        let extent = Kernel::of(p, light, points[i].position, points[i].geometric).half_extent();
        assert!((direction[q].w - extent).abs() <= 1e-3 * extent, "{what}: quad {quad}: {} {extent}", direction[q].w);
        let ratio = ratio_of(hit_of(hits[q]).map_or(0.0, |h| h.t), direction[q].w);
        // A pixel beyond each side.
        let beside = [[-2, 0], [3, 0], [0, -2], [1, 3]].map(|[x, y]| [corner[0] as i32 + x, corner[1] as i32 + y]);
        let at_edge = shown.iter().any(|&i| lit(i) == Some(true))
            || beside.iter().any(|&[x, y]| {
                let j = (x.clamp(0, width as i32 - 1) + y.clamp(0, height as i32 - 1) * width as i32) as usize;
                lit(j) == Some(true) && on_surface(points[i].position, points[i].geometric, source[j])
            });
        let expected = Word::of_blocker(ratio, at_edge, Word(source[i].w.to_bits()));
        let found = Word(blockers[q].w.to_bits());
        // The upper half of a float has 8 bits of a number.
        let alike = (found.ratio() - expected.ratio()).abs() <= 0.01 * ratio && found.0 & 0xffff == expected.0 & 0xffff;
        assert!(alike || ratio < 1e-20, "{what}: quad {quad}: {found:?} for {expected:?}");
        assert_eq!(blockers[q].xyz(), points[i].position);
        tile.ratio = tile.ratio.max(ratio);
        tile.reach = tile.reach.max(ratio * direction[q].w + 2.0);
    }
    rays.finish(STRAYS);
    let found: Vec<[u32; 4]> = rig.get(&pass.tiles);
    let windows: Vec<f32> = rig.get(&pass.windows);
    for (i, (tile, found)) in tiles.iter_mut().zip(&found).enumerate() {
        let shows = u32::from(tile.lit) | (2 * u32::from(tile.blocked));
        assert_eq!(found[2], shows, "{what}: tile {i}");
        assert!((f32::from_bits(found[1]) - tile.ratio).abs() <= 1e-5 * tile.ratio, "{what}: tile {i}");
        tile.ratio = f32::from_bits(found[1]);
        assert!((f32::from_bits(found[0]) - tile.reach).abs() <= 1e-4 * tile.reach, "{what}: tile {i}");
        tile.reach = f32::from_bits(found[0]);
    }
    for i in 0..tiles.len() as u32 {
        assert_eq!(windows[i as usize], window(columns, &tiles, i), "{what}: tile {i}");
    }

    rig.run(|_, rec| stage.record_search(rec));
    let quads: Vec<Vec4> = rig.texels(&pass.quads);
    let seen_at = |i: usize| {
        let at = [i as u32 % width, i as u32 / width];
        Seen { frame: p, light, at, x: points[i].position, n: points[i].geometric }
    };
    let quad_of = |at: [u32; 2]| (at[0] / 2 + at[1] / 2 * across) as usize;
    let window_of = |at: [u32; 2]| windows[(at[0] / TILE + at[1] / TILE * columns) as usize];
    let mut search = Tally::new(format!("search, {what}"));
    for quad in 0..across * down {
        let corner = [quad % across * 2, quad / across * 2];
        let of_quad = (0..4).map(|i| [corner[0] + i % 2, corner[1] + i / 2]);
        let mut shown = of_quad.filter(|at| at[0] < width && at[1] < height).map(|[x, y]| (x + y * width) as usize);
        let first = shown.find(|&i| lit(i).is_some()).filter(|_| window_of(corner) > 0.0);
        let expected = first.map_or(Vec4::new(0.0, 0.0, 0.0, -4.0), |i| {
            let known = seen_at(i).quad((&source, &blockers), window_of(corner));
            points[i].position.extend(known.written())
        });
        let found = quads[quad as usize];
        met.reached += usize::from(expected.w != 0.0 && expected.w != -4.0);
        met.wide += usize::from(matches!(Quad::read(expected.w), Some(Quad::Wide(_))));
        let alike = (found.w - expected.w).abs() <= 1e-4 * expected.w.abs() && found.xyz() == expected.xyz();
        search.check(alike, || format!("quad {quad}: {found} for {expected}"));
    }
    search.finish(0.005);

    rig.run(|_, rec| stage.record_convolution(rec, k));
    let after = rig.vec4s(&pass.direct);
    let mut tally = Tally::new(format!("convolution, {what}"));
    for i in 0..pixels as usize {
        if soft.binary_search(&(i as u32)).is_err() {
            assert_eq!(after[i], Vec4::ZERO, "{what}: pixel {i}");
            continue;
        }
        let seen = seen_at(i);
        let of_quad = quads[quad_of(seen.at)];
        let agrees = Quad::read(of_quad.w).is_some() && on_plane(seen.x, seen.n, of_quad.xyz());
        let known = match window_of(seen.at) {
            0.0 => Quad::Open,
            _ if agrees => seen.between(&source, &quads),
            greatest if lit(i).is_some() => match seen.mean_ratio(&blockers, greatest) {
                0.0 => Quad::Open,
                ratio => Quad::Narrow(ratio),
            },
            _ => Quad::Open,
        };
        let share = match known {
            Quad::Open => lit(i).map_or(1.0, f32::from),
            Quad::Narrow(ratio) => seen.lit_share(&source, ratio),
            Quad::Wide(share) => share,
        };
        met.partly += usize::from(share > 0.0 && share < 1.0);
        let expected = share * light.irradiance(seen.x, [points[i].geometric, points[i].shading], p.right[3]);
        let found = after[i].xyz() - before[i];
        tally.check_values(close(found, expected, 1e-3, 1e-5), &[(found, expected)], || {
            format!("pixel {i}: {found} for {expected}")
        });
    }
    tally.finish(0.005);
}

#[test]
fn soft_shadows_follow_their_oracles() {
    gpu_test(|ctx| {
        let (gallery, from_afar) = (gallery(), orthographic(gallery()));
        let mut met = Met::default();
        for (resolution, scene) in AWKWARD_IMAGES.into_iter().flat_map(|size| [(size, &gallery), (size, &from_afar)]) {
            let rig = rig(ctx, scene, resolution, Traversal::Auto);
            let (p, plan) = (&rig.parameters, rig.engine.plan());
            let soft = check_list(&rig);
            let pass = &stage(&rig).pass;
            let centres: Vec<PointLight> = rig.get(&pass.lights);
            assert_eq!(p.soft[0] as usize, plan.soft_emitters.len());
            let mut before = vec![Vec3::ZERO; p.size[2] as usize];
            for (k, &emitter) in plan.soft_emitters.iter().enumerate() {
                let light = Light::of(&rig.engine.emitters().list[emitter as usize], p.eye[3]);
                assert!(close(xyz(centres[k].position), light.centre, 1e-6, 1e-6));
                check_emitter(&rig, k, &light, &soft, &before, &mut met);
                before = rig.vec4s(&pass.direct).into_iter().map(Vec4::xyz).collect();
            }
            assert_eq!(rig.lost(), 0);
        }
        println!("{met:?}");
        assert!(met.blocked > 100 && met.reached > 100 && met.wide > 10 && met.partly > 50, "{met:?}");
    });
}

/// Virtual lights on the emitters bring points with soft shadows highlights, but no diffuse light.
#[test]
fn shade_leaves_soft_shadows_out() {
    gpu_test(|ctx| {
        let scene = gallery();
        for traversal in [Traversal::Single, Traversal::Cluster] {
            let rig = rig(ctx, &scene, [31, 17], traversal);
            rig.run(|frame, rec| frame.shade.record(rec));
            let (p, eye) = (&rig.parameters, &rig.frame().eye);
            let lights: Vec<PointLight> = rig.get(rig.frame().lights());
            let others: Vec<PointLight> =
                lights.iter().copied().filter(|l| l.flags() & PointLight::SOFT == 0).collect();
            assert!(others.len() < lights.len());
            let (points, wo) = (receivers(&rig, &eye.points), rig.vec4s(&eye.points.wo));
            let sums = &rig.frame().shade.lighting;
            let found = [&sums.direct, &sums.specular].map(|b| rig.vec4s(b));
            let mut tally = Tally::new(format!("shade beside soft shadows, {traversal:?}"));
            let (mut marked, mut glossy) = (0, 0);
            for slot in rig.list(0) {
                let i = slot as usize;
                let of = |lights: &[PointLight]| {
                    shade::reference(rig.scene, rig.bvh(), &points[i], lights, p.right[3], p.forward[3])
                };
                let soft = has(wo[i], ShadingPoints::SOFT);
                // Long eye paths take no light from long particle paths.
                let segments = ShadingPoints::segments(ShadingPoints::flags(wo[i].w));
                let within = |lights: &[PointLight]| {
                    let most = rig.engine.plan().settings.max_depth as f32 - 2.0;
                    lights.iter().copied().filter(|l| l.f0[3] + segments as f32 <= most).collect::<Vec<_>>()
                };
                let (lights, others) = (within(&lights), within(&others));
                let whole = of(&lights);
                let direct = if soft { of(&others)[0] } else { whole[0] };
                marked += usize::from(soft && direct != whole[0]);
                glossy += usize::from(soft && whole[2] != of(&others)[2]);
                let values = [(found[0][i].xyz(), direct), (found[1][i].xyz(), whole[2])];
                let alike = close(values[0].0, values[0].1, 1e-3, 1e-6) && close(values[1].0, values[1].1, 2e-2, 1e-6);
                tally.check_values(alike, &values, || format!("slot {i}: {values:?}"));
            }
            tally.finish(0.01);
            assert!(marked > 100 && glossy > 20, "{marked} {glossy}");
        }
    });
}

/// A floor at height 0 under a square light of edge `edge` at height 2, whose centre is `aside`, and half a plane at `height`, up to x = -0.5.
fn half_plane(edge: f32, aside: f32, height: Option<f32>) -> Scene {
    let mut soup = Soup::new("half a plane");
    let (white, black) = (soup.diffuse(0.8, 0.0), soup.diffuse(0.0, 0.0));
    let lamp = soup.diffuse(0.0, 20.0);
    soup.quad(Vec3::new(-8.0, 0.0, -8.0), Vec3::Z * 16.0, Vec3::X * 16.0, white);
    soup.quad(Vec3::new(aside - 0.5 * edge, 2.0, -0.5 * edge), Vec3::X * edge, Vec3::Z * edge, lamp);
    if let Some(y) = height {
        soup.quad(Vec3::new(-6.0, y, -8.0), Vec3::Z * 16.0, Vec3::X * 5.5, black);
    }
    soup.0
}

/// The penumbra of half a plane is s d_o / d_l wide, at five distances of the occluder.
#[test]
fn penumbrae_have_the_width_of_the_geometry() {
    gpu_test(|ctx| {
        let (edge, aside, resolution) = (0.5, -1.5, [96, 33]);
        for height in [0.15f32, 0.3, 0.5, 0.65, 0.8] {
            let r = height / (2.0 - height);
            let middle = -0.5 + r * (-0.5 - aside);
            let eye = Vec3::new(middle, 1.5, 0.0);
            // The camera looks down, its up is z and its right -x.
            let half_height = 0.25;
            let view = camera(eye, Vec3::new(middle, 0.0, 0.0), fov(half_height, 1.5), resolution);
            let unit = 0.5 * resolution[1] as f32 / half_height;
            let image = |scene: &Scene| render(ctx, scene, view, &soft(original(4, 2)), 1).color;
            let shadowed = image(&half_plane(edge, aside, Some(height)));
            let open = image(&half_plane(edge, aside, None));
            let share = |x: u32| {
                let i = (16 * resolution[0] + x) as usize;
                shadowed[i].x / open[i].x
            };
            let profile: Vec<f32> = (0..resolution[0]).map(share).collect();
            let (dark, light) = (profile[resolution[0] as usize - 1], profile[0]);
            assert!(dark < 1e-6 && (light - 1.0).abs() < 1e-4, "{height}: {dark} {light}");
            // The steps between neighbours have the moments of a box.
            let steps: Vec<(f32, f32)> =
                profile.windows(2).enumerate().map(|(x, v)| (x as f32 + 1.0, v[0] - v[1])).collect();
            let mean: f32 = steps.iter().map(|(x, step)| x * step).sum();
            let variance: f32 = steps.iter().map(|(x, step)| (x - mean).powi(2) * step).sum();
            let (width, expected) = ((12.0 * variance).sqrt(), edge * r * unit);
            // Samples of pixels add the variance of a pixel.
            let smeared = (expected * expected + 1.0).sqrt();
            println!("{height}: {width:.2} pixels for {expected:.2}, middle {mean:.2}");
            assert!((width / smeared - 1.0).abs() < 0.08, "{height}: {width} for {expected}");
            assert!((mean - 0.5 * resolution[0] as f32).abs() < 0.3, "{height}: middle at {mean}");
            let rises = profile.windows(2).map(|v| v[1] - v[0]).fold(0.0f32, f32::max);
            assert!(rises < 0.02, "{height}: the profile falls but for {rises}");
        }
    });
}

/// Without anything between, light and pixels are those of the whole emitter, to the last shade.
#[test]
fn open_floors_are_lit_by_the_whole_emitter() {
    gpu_test(|ctx| {
        let scene = half_plane(0.5, 0.3, None);
        let view = camera(Vec3::new(0.0, 1.5, -1.0), Vec3::ZERO, 50.0, [48, 36]);
        let image = render(ctx, &scene, view, &soft(original(4, 2)), 1).color;
        let many = render(ctx, &scene, view, &original(256, 2), 4).color;
        let (energy, error) = compare(&image, &many);
        println!("energy {energy:.4}, error {error:.4}");
        assert!((energy - 1.0).abs() < 0.005 && error < 0.02, "{energy} {error}");
        // A constant stays one: no pixel of the floor differs from the closed form.
        let engine = Engine::new(ctx, &scene, view, soft(original(4, 2))).unwrap();
        let p = engine.plan().parameters(0).unwrap();
        let light = Light::of(&Emitters::of(&scene, true).unwrap().list[0], p.eye[3]);
        let (right, up, forward) = view.world_from_camera();
        let tan = (0.5 * view.fov_y.to_radians()).tan();
        for (i, found) in image.iter().enumerate() {
            let at = Vec2::new((i % 48) as f32 + p.pixel_offset[0], (i / 48) as f32 + p.pixel_offset[1]);
            let (s, t) = (at.x / 24.0 - 1.0, 1.0 - at.y / 18.0);
            let d = forward + right * (s * tan * 48.0 / 36.0) + up * (t * tan);
            let x = view.eye - d * (view.eye.y / d.y);
            let expected = light.irradiance(x, [Vec3::Y; 2], 0.0) * 0.8 / std::f32::consts::PI;
            assert!(close(*found, expected, 2e-3, 0.0), "pixel {i}: {found} for {expected}");
        }
    });
}

/// A room with a lamp below its ceiling, a ball and two boards.
fn room() -> (Scene, Camera) {
    let mut soup = Soup::new("room");
    let (gray, red) = (soup.diffuse(0.6, 0.0), soup.diffuse([0.7, 0.2, 0.2], 0.0));
    let lamp = soup.diffuse(0.0, 12.0);
    soup.room(Vec3::new(-1.5, 0.0, -1.5), Vec3::new(1.5, 2.0, 2.0), [red, gray, gray, gray, gray, gray]);
    soup.quad(Vec3::new(-0.25, 1.98, 0.0), Vec3::X * 0.5, Vec3::Z * 0.5, lamp);
    soup.ball(Vec3::new(-0.5, 0.6, 0.6), 0.3, 12, gray);
    soup.quad(Vec3::new(0.2, 0.5, 0.1), Vec3::Z * 0.7, Vec3::X * 0.6, red);
    soup.quad(Vec3::new(0.2, 0.0, 1.1), Vec3::Y * 0.7, Vec3::X * 0.7, gray);
    (soup.0, camera(Vec3::new(0.0, 1.3, -1.3), Vec3::new(0.0, 0.5, 0.8), 70.0, [64, 48]))
}

/// Against the same emitter as many virtual lights, beside as many lights as one pass of a preset has.
#[test]
fn images_agree_with_many_virtual_lights() {
    gpu_test(|ctx| {
        let (scene, view) = room();
        // The first pass of each has the same place in its pixels.
        let many = render(ctx, &scene, view, &original(1024, 2), 1).color;
        let image = |settings: &Settings| compare(&render(ctx, &scene, view, settings, 1).color, &many);
        let (energy, error) = image(&soft(original(4, 2)));
        let errors = [4, 16, 64].map(|lights| image(&original(lights, 2)).1);
        println!("energy {energy:.4}, error {error:.4}; of 4, 16, 64 lights {errors:.4?}");
        assert!((energy - 1.0).abs() < 0.02 && error < 0.08 && error < errors[0], "{energy} {error} {errors:?}");
    });
}

/// With reflections, interleaving, the filter and near light, the energy is that of the ordinary image.
#[test]
fn interactive_frames_keep_their_energy() {
    gpu_test(|ctx| {
        let (scene, view) = room();
        let preset = Settings { photons: 0, ..Settings::interactive() };
        let ordinary = render(ctx, &scene, view, &preset, 32).color;
        let image = render(ctx, &scene, view, &soft(preset.clone()), 8).color;
        let (energy, error) = compare(&image, &ordinary);
        println!("energy {energy:.4}, error {error:.4}");
        assert!((energy - 1.0).abs() < 0.02 && error < 0.1, "{energy} {error}");
    });
}

/// The filter averages none of it: an image of nothing but light with soft shadows has the same bits with and without one.
#[test]
fn no_filter_averages_soft_shadows() {
    gpu_test(|ctx| {
        let (scene, view) = room();
        let image = |filter| render(ctx, &scene, view, &soft(Settings { filter, ..original(4, 2) }), 3).color;
        assert!(image(None) == image(Some(Filter::default())));
    });
}

/// Emitters that are no parallelograms, or emit from both sides, keep their virtual lights, and no bit changes.
#[test]
fn scenes_without_such_emitters_change_no_bit() {
    gpu_test(|ctx| {
        let (mut scene, view) = room();
        for material in scene.materials.iter_mut().filter(|m| m.emission != Vec3::ZERO) {
            *material = Material { two_sided: true, ..material.clone() };
        }
        let settings = Settings { photons: 0, ..Settings::interactive() };
        let image = |settings: &Settings| render(ctx, &scene, view, settings, 2).color;
        assert!(image(&settings) == image(&soft(settings.clone())));
    });
}

#[test]
fn soft_shadows_are_refused_where_they_make_no_sense() {
    gpu_test(|ctx| {
        let (scene, view) = room();
        let refused =
            |scene: &Scene, settings: Settings| Engine::new(ctx, scene, view, settings).err().unwrap().to_string();
        let kept = SceneLight::Imported { position: Vec3::Y, normal: Vec3::Y, power: Vec3::ONE, exponent: 1.0 };
        let imported = Scene { emitters_are_lights: false, lights: vec![kept], ..scene.clone() };
        for (scene, settings, words) in [
            (&imported, soft(settings(4, 2)), "imported lights"),
            (&gallery_with_alpha(), soft(settings(4, 2)), "let light pass"),
            (
                &scene,
                Settings { soft_shadows: Some(SoftShadows { lights: 9 }), ..settings(4, 2) },
                "--soft-shadow-lights",
            ),
        ] {
            let text = refused(scene, settings);
            assert!(text.contains("--soft-shadow") && text.contains(words), "{text}");
        }
        let part = View::Camera { camera: view, region: lightsum::view::Region { origin: [0, 0], size: [32, 24] } };
        let text = part.check(&soft(settings(4, 2))).unwrap_err().to_string();
        assert!(text.contains("soft shadows"), "{text}");
    });
}
