//! Antialiased edges against their oracle, and what they are for: outlines and textures as many passes show them.

use glam::{Vec3, Vec4};
use lightsum::accel::{Hit, Ray, offset_origin};
use lightsum::gpu::Context;
use lightsum::pass::edges::{self, FirstHit, Nearby, Shown};
use lightsum::pass::layout::FrameParameters;
use lightsum::pass::surface::surface_at;
use lightsum::pass::{ShadingPoints, accumulate, camera_rays};
use lightsum::scene::{Camera, Light, Material, Scene, Surface, Texture, Wrap};
use lightsum::settings::Settings;

use crate::rig::{AWKWARD_IMAGES, Rig, STRAYS, Tally, close, gallery, has, hit_of, is_lit};
use crate::scenes::{Soup, camera, compare, render};
use crate::support::gpu_test;

/// The surfaces that a ray shows, from its hits: the second one is that after a flat mirror.
fn shown(rig: &Rig, d: Vec3, first: Option<&Hit>, second: Option<Option<&Hit>>) -> Shown {
    let first = first.map(|hit| FirstHit::new(rig.scene, rig.bvh(), hit, d));
    match (first, second) {
        (Some(mirror), Some(met)) => Shown::mirrored(rig.scene, rig.bvh(), mirror, d, met),
        (first, _) => Shown { first, second: None },
    }
}

/// The pixels as eye rays see them.
struct Pixels {
    nearby: Vec<Nearby>,
    covered: Vec<bool>,
}

impl Pixels {
    fn of(rig: &Rig) -> Pixels {
        let (eye, lighting) = (&rig.frame().eye, &rig.frame().shade.lighting);
        let guides = eye.guides.as_ref().unwrap();
        let first: Vec<[u32; 2]> = rig.get(&guides.first_hits);
        let second: Vec<[u32; 2]> = rig.get(guides.second_hits.as_ref().unwrap());
        let [position, kd, wo, emitted] =
            [&eye.points.position, &eye.points.kd, &eye.points.wo, &eye.points.emitted].map(|b| rig.vec4s(b));
        let throughput = rig.vec4s(&eye.paths.throughput);
        let sums = [&lighting.direct, &lighting.indirect, &lighting.specular].map(|b| rig.vec4s(b));
        let nearby = |i: usize| {
            let ray = camera_rays::reference(&rig.parameters, i as u32);
            let hit = |guide: [u32; 2]| hit_of(Vec4::new(f32::from_bits(guide[1]), 0.0, 0.0, f32::from_bits(guide[0])));
            let mirrored = second[i][0] != edges::NO_MIRROR;
            let last = if mirrored { second[i] } else { first[i] };
            let second = mirrored.then(|| hit(second[i]));
            Nearby {
                d: ray.direction,
                shown: shown(rig, ray.direction, hit(first[i]).as_ref(), second.as_ref().map(Option::as_ref)),
                is_last: position[i].w == f32::from_bits(last[1]),
                point: [emitted[i], throughput[i], kd[i]].map(Vec4::truncate),
                sums: [0, 1, 2].map(|k| if is_lit(wo[i]) { sums[k][i].truncate() } else { Vec3::ZERO }),
            }
        };
        let covered = (0..first.len()).map(|i| has(wo[i], ShadingPoints::COVERED)).collect();
        Pixels { nearby: (0..first.len()).map(nearby).collect(), covered }
    }

    /// Whether the oracle sees an edge at a pixel.
    fn is_edge(&self, frame: &FrameParameters, pixel: usize) -> bool {
        let [width, height, ..] = frame.size.map(|n| n as usize);
        let (x, y) = (pixel % width, pixel / width);
        let others = [
            (x > 0).then(|| pixel - 1),
            (x + 1 < width).then(|| pixel + 1),
            (y > 0).then(|| pixel - width),
            (y + 1 < height).then(|| pixel + width),
        ];
        let albedo = |i: usize| if self.nearby[i].is_last { self.nearby[i].point[2] } else { Vec3::ZERO };
        others.into_iter().flatten().any(|other| {
            !edges::same_shown(frame, &self.nearby[pixel].shown, &self.nearby[other].shown)
                || edges::albedos_differ(albedo(pixel), albedo(other))
        })
    }

    /// The 3 x 3 pixels around one.
    fn around(&self, frame: &FrameParameters, pixel: usize) -> Vec<Nearby> {
        let [width, height, ..] = frame.size.map(|n| n as usize);
        let (x, y) = (pixel % width, pixel / width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        rows.flat_map(|y| columns.clone().map(move |x| x + y * width)).map(|i| self.nearby[i]).collect()
    }
}

#[test]
fn edges_follow_their_oracle() {
    gpu_test(|ctx| {
        let scene = gallery();
        let (mut marked, mut unknown, mut compared, mut reflected) = (0, 0, 0, 0);
        for (i, size) in AWKWARD_IMAGES.into_iter().enumerate() {
            let settings = Settings { particles: 3, antialias: true, split: i % 2 == 0, ..Settings::plain() };
            let rig = Rig::at_pass(ctx, &scene, size, settings, 70 * i as u32);
            rig.light();
            let before = Pixels::of(&rig);
            let stage = rig.frame().edges.as_ref().unwrap();
            rig.run(|_, rec| stage.record_rays(rec));
            let rays = &rig.frame().eye.rays;
            let [directions, hits] = [&rays.direction, &rays.hits].map(|b| rig.vec4s(b));
            rig.run(|_, rec| stage.record_reflected(rec));
            let [turned, last_hits] = [&rays.direction, &rays.hits].map(|b| rig.vec4s(b));
            rig.run(|_, rec| stage.pass.record_light(rec));
            let words: Vec<u32> = rig.get(&stage.pass.edges);
            let emitted = rig.vec4s(&rig.frame().eye.points.emitted);
            assert_eq!(rig.lost(), 0);

            let frame = &rig.parameters;
            let [width, height] = size;
            let mut tally = Tally::new(format!("edges, {size:?}"));
            for tile in 0..width.div_ceil(8) * height.div_ceil(8) {
                let (x, y) = (tile % width.div_ceil(8) * 8, tile / width.div_ceil(8) * 8);
                let (w, h) = ((width - x).min(8), (height - y).min(8));
                let slot = |i: u32| (x + i % w + (y + i / w) * width) as usize;
                let at_edges: Vec<usize> = (0..w * h).map(slot).filter(|&pixel| words[pixel] != 0).collect();
                let each = edges::rays_of(at_edges.len() as u32, w * h);
                for i in 0..w * h {
                    let pixel = slot(i);
                    let edge = before.is_edge(frame, pixel);
                    tally.check((words[pixel] != 0) == edge, || format!("pixel {pixel}: edge {edge}"));
                    let own = before.nearby[pixel];
                    let [l, throughput, kd] = own.point;
                    let own_light = accumulate::reference(l, throughput, kd, own.sums)
                        .extend(f32::from(u8::from(before.covered[pixel])));
                    let mut rays = Vec::new();
                    if words[pixel] != 0 {
                        marked += 1;
                        let place = at_edges.iter().position(|&other| other == pixel).unwrap() as u32;
                        assert_eq!(words[pixel], 16 * place * each + each, "pixel {pixel}");
                        for k in 0..each {
                            let ray = slot(place * each + k);
                            let d = directions[ray].truncate();
                            let mut moved = *frame;
                            moved.pixel_offset[..2].copy_from_slice(&edges::ray_offset(frame, k, each).to_array());
                            let expected = camera_rays::reference(&moved, pixel as u32);
                            assert!(close(d, expected.direction, 1e-5, 1e-6), "ray {k} of {pixel}: {d}");
                            let hit = hit_of(hits[ray]);
                            tally.check_hit(&rig, &expected, hit, || format!("ray {k} of pixel {pixel}"));
                            let mirror = hit.filter(|hit| edges::is_plain_mirror(&scene, rig.bvh(), hit.triangle));
                            let (mut last, mut last_d) = (hit, d);
                            if let Some(mirror) = mirror {
                                reflected += 1;
                                (last, last_d) = (hit_of(last_hits[ray]), turned[ray].truncate());
                                let n = FirstHit::new(&scene, rig.bvh(), &mirror, d).normal;
                                assert!(close(last_d, d.reflect(n), 1e-5, 1e-6), "ray {k} of {pixel}: {last_d}");
                                let scale = rig.bvh().typical_scale();
                                let origin = offset_origin(rig.bvh().position(&mirror), n, scale);
                                let onward = Ray::new(origin, d.reflect(n));
                                tally.check_hit(&rig, &onward, last, || format!("ray {k} of {pixel} in a mirror"));
                            }
                            let own = shown(&rig, d, hit.as_ref(), mirror.map(|_| last.as_ref()));
                            let length = last.map_or(0.0, |last| last.t) + mirror.map_or(0.0, |mirror| mirror.t);
                            let forward = Vec4::from(frame.forward).truncate();
                            let width = frame.cones[0] * d.dot(forward) * length;
                            let surface = last.map(|hit| surface_at(&scene, rig.bvh(), &hit, last_d, width));
                            let material = surface.map_or([Vec3::ZERO; 2], |s| [s.reflectance.kd, s.emission]);
                            let around = before.around(frame, pixel);
                            match edges::reference(frame, (d, &own), material, &around) {
                                Some(l) => rays.push(l.extend(f32::from(u8::from(hit.is_some())))),
                                None => unknown += 1,
                            }
                        }
                    }
                    let mean = edges::mean(own_light, &rays, frame.lens[2]);
                    let change = (mean - own_light).truncate();
                    let found = emitted[pixel];
                    let e = own.point[0] + change;
                    let same = close(found.truncate(), e, 2e-3, 1e-4 * (1.0 + own_light.truncate().length()));
                    tally.check_values(same, &[(found.truncate(), e)], || format!("pixel {pixel}: {found} for {e}"));
                    let coverage = mean.w - own_light.w;
                    tally.check((found.w - coverage).abs() < 1e-5, || format!("coverage {pixel}: {}", found.w));
                    compared += usize::from(change.length() > 1e-3);
                }
            }
            tally.finish(STRAYS);
        }
        assert!(
            marked > 300 && compared > 100 && unknown > 0 && reflected > 50,
            "{marked} at edges, {compared} change, {unknown} rays unknown, {reflected} reflected"
        );
    });
}

/// A white card, turned by some degrees, so far before a wall with squares of two colours, lit from the eye.
fn card_and_squares(eye: Vec3, before: f32) -> Scene {
    let mut soup = Soup::new("card and squares");
    let texel = |i: u32| if (i / 8 + i).is_multiple_of(2) { [240, 220, 40, 255] } else { [20, 40, 90, 255] };
    let texels = (0..64).map(texel).collect();
    let name = String::from("squares");
    soup.0.textures.push(Texture { name, width: 8, height: 8, texels, srgb: false, wrap: [Wrap::Clamp; 2] });
    let wall = soup.material(Material { base_texture: Some(0), base_color: Vec3::ONE, ..Material::default() });
    let card = soup.diffuse(0.9, 0.0);
    soup.quad(Vec3::new(-2.0, -2.0, 0.0), 4.0 * Vec3::X, 4.0 * Vec3::Y, wall);
    let (sin, cos) = 0.3f32.sin_cos();
    soup.quad(Vec3::new(-0.6, -0.5, before), Vec3::new(cos, sin, 0.0), Vec3::new(-sin, cos, 0.0), card);
    soup.0.lights.push(Light::Point { position: eye, intensity: Vec3::splat(100.0) });
    soup.0
}

/// Root mean square, over four seeds, of the relative RMSE of one pass against 512, with and without antialiased edges.
fn errors_of_one_pass(ctx: &Context, scene: &Scene, camera: Camera) -> [f64; 2] {
    let settings = |antialias, seed| Settings { antialias, seed, max_depth: 2, particles: 1, ..Settings::plain() };
    let many = render(ctx, scene, camera, &settings(false, 1000), 512).color;
    let mut squares = [0.0; 2];
    for seed in 0..4 {
        for (square, antialias) in squares.iter_mut().zip([true, false]) {
            let (energy, error) = compare(&render(ctx, scene, camera, &settings(antialias, seed), 1).color, &many);
            println!("seed {seed}, antialiased {antialias}: energy {energy:.4}, relative RMSE {error:.4}");
            *square += error * error;
        }
    }
    squares.map(|sum| (sum / 4.0).sqrt())
}

#[test]
fn one_pass_shows_edges_as_many_do() {
    gpu_test(|ctx| {
        // Nobody sees a shadow, so only eye rays matter.
        let eye = Vec3::new(0.3, 0.2, 6.0);
        let [smooth, plain] =
            errors_of_one_pass(ctx, &card_and_squares(eye, 0.5), camera(eye, Vec3::ZERO, 35.0, [61, 47]));
        assert!(smooth < 0.5 * plain, "{smooth} with more rays at edges, {plain} without");
    });
}

#[test]
fn one_pass_shows_edges_in_a_mirror_as_many_do() {
    gpu_test(|ctx| {
        // The same on the wall, seen in a mirror behind the light: a shadow of the card would show.
        let light = Vec3::new(0.3, 0.2, 6.0);
        let mut soup = Soup(card_and_squares(light, 0.001));
        let silver = soup.material(Material {
            surface: Surface::Mirror,
            base_color: Vec3::ZERO,
            specular: Vec3::new(0.9, 0.8, 0.7),
            ..Material::default()
        });
        soup.quad(Vec3::new(6.0, -6.0, 8.0), -12.0 * Vec3::X, 12.0 * Vec3::Y, silver);
        let eye = Vec3::new(0.1, 0.1, 3.0);
        let [smooth, plain] = errors_of_one_pass(ctx, &soup.0, camera(eye, Vec3::new(0.0, 0.0, 16.0), 12.0, [61, 47]));
        assert!(smooth < 0.6 * plain, "{smooth} with more rays at edges, {plain} without");
    });
}
