//! Antialiased edges against their oracle.

use crate::accel::{Hit, Ray, offset_origin};
use crate::conform::Bench;
use crate::pass::edges::{self, FirstHit, Nearby, Shown};
use crate::pass::layout::FrameParameters;
use crate::pass::surface::surface_at;
use crate::pass::{ShadingPoints, accumulate, camera_rays};
use crate::scene::Surface;
use crate::settings::Settings;
use glam::{Vec3, Vec4};

use crate::conform::rig::{Rig, STRAYS, Tally, close, gallery, has, hit_of, is_lit, orthographic};

/// The surfaces that a ray shows, from its hits: the second one is that after a flat mirror.
fn shown(rig: &Rig, ray: [Vec3; 2], first: Option<&Hit>, second: Option<Option<&Hit>>) -> Shown {
    let first = first.map(|hit| FirstHit::new(rig.scene, rig.bvh(), hit, ray));
    match (first, second) {
        (Some(mirror), Some(met)) => Shown::mirrored(rig.scene, rig.bvh(), mirror, ray[1], met),
        (first, _) => Shown { first, second: None },
    }
}

/// Origin of an eye ray, relative to the eye, and its direction.
fn from_eye(frame: &FrameParameters, ray: &Ray) -> [Vec3; 2] {
    [ray.origin - Vec4::from(frame.eye).truncate(), ray.direction]
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
            let ray = from_eye(&rig.parameters, &camera_rays::reference(&rig.parameters, i as u32));
            let hit = |guide: [u32; 2]| hit_of(Vec4::new(f32::from_bits(guide[1]), 0.0, 0.0, f32::from_bits(guide[0])));
            let mirrored = second[i][0] != edges::NO_MIRROR;
            let last = if mirrored { second[i] } else { first[i] };
            let second = mirrored.then(|| hit(second[i]));
            Nearby {
                ray,
                shown: shown(rig, ray, hit(first[i]).as_ref(), second.as_ref().map(Option::as_ref)),
                is_last: position[i].w == f32::from_bits(last[1]),
                point: [emitted[i], throughput[i], kd[i]].map(Vec4::truncate),
                sums: [0, 1, 2].map(|k| if is_lit(wo[i]) { sums[k][i].truncate() } else { Vec3::ZERO }),
            }
        };
        let covered = (0..first.len()).map(|i| has(wo[i], ShadingPoints::COVERED)).collect();
        Pixels { nearby: (0..first.len()).map(nearby).collect(), covered }
    }

    /// Whether the oracle sees an edge at a pixel, and whether surfaces differ there.
    fn is_edge(&self, frame: &FrameParameters, pixel: usize) -> [bool; 2] {
        let [width, height, ..] = frame.size.map(|n| n as usize);
        let (x, y) = (pixel % width, pixel / width);
        let others = [
            (x > 0).then(|| pixel - 1),
            (x + 1 < width).then(|| pixel + 1),
            (y > 0).then(|| pixel - width),
            (y + 1 < height).then(|| pixel + width),
        ];
        let albedo = |i: usize| if self.nearby[i].is_last { self.nearby[i].point[2] } else { Vec3::ZERO };
        let any = |differs: &dyn Fn(usize) -> bool| others.into_iter().flatten().any(differs);
        let of_surfaces = any(&|other| !edges::same_shown(frame, &self.nearby[pixel].shown, &self.nearby[other].shown));
        [of_surfaces || any(&|other| edges::albedos_differ(albedo(pixel), albedo(other))), of_surfaces]
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

/// A round of rays.
struct Round {
    words: Vec<u32>,
    directions: Vec<Vec4>,
    hits: Vec<Vec4>,
    /// Directions and hits after flat mirrors.
    turned: Vec<Vec4>,
    last_hits: Vec<Vec4>,
}

impl Round {
    fn run(rig: &Rig, round: u32) -> Round {
        let stage = rig.frame().edges.as_ref().unwrap();
        let rays = &rig.frame().eye.rays;
        rig.run(|_, rec| stage.record_rays(rec, round));
        let words = rig.get(&stage.pass.edges);
        let [directions, hits] = [&rays.direction, &rays.hits].map(|b| rig.vec4s(b));
        rig.run(|_, rec| stage.record_reflected(rec));
        let [turned, last_hits] = [&rays.direction, &rays.hits].map(|b| rig.vec4s(b));
        rig.run(|_, rec| stage.pass.record_light(rec, round));
        Round { words, directions, hits, turned, last_hits }
    }
}

pub fn edges_follow_their_oracle(bench: &Bench) {
    let (gallery, from_afar) = (gallery(), orthographic(gallery()));
    let (mut marked, mut second, mut unknown, mut lent, mut compared, mut reflected) = (0, 0, 0, 0, 0, 0);
    for ((i, size), scene) in bench.images().enumerate().flat_map(|image| [(image, &gallery), (image, &from_afar)]) {
        let settings = Settings { particles: 3, antialias: true, split: i % 2 == 0, ..Settings::plain() };
        // The second round comes in the first passes alone.
        let pass = if i % 2 == 0 { i / 2 } else { 70 * i };
        let rig = bench.rig_at_pass(scene, size, settings, pass as u32);
        rig.light();
        let before = Pixels::of(&rig);
        let stage = rig.frame().edges.as_ref().unwrap();
        rig.run(|_, rec| stage.pass.record_mark(rec));
        let words: Vec<u32> = rig.get(&stage.pass.edges);
        let rounds: Vec<Round> = (0..edges::ROUNDS).map(|round| Round::run(&rig, round)).collect();
        let emitted = rig.vec4s(&rig.frame().eye.points.emitted);
        assert_eq!(rig.lost(), 0);

        let frame = &rig.parameters;
        let [width, height] = size;
        let mut tally = Tally::new(format!("edges, {size:?}"));
        for tile in 0..width.div_ceil(8) * height.div_ceil(8) {
            let (x, y) = (tile % width.div_ceil(8) * 8, tile / width.div_ceil(8) * 8);
            let (w, h) = ((width - x).min(8), (height - y).min(8));
            let slot = |i: u32| (x + i % w + (y + i / w) * width) as usize;
            let at_edges = |pixel: usize| words[pixel] != 0;
            let of_surfaces = |pixel: usize| words[pixel] == edges::word([0, 1], 0, 0);
            let count = |is: &dyn Fn(usize) -> bool| (0..w * h).filter(|&i| is(slot(i))).count() as u32;
            let counts = [count(&at_edges), count(&of_surfaces)];
            let mut places = [0; 2];
            for i in 0..w * h {
                let pixel = slot(i);
                let edge = before.is_edge(frame, pixel);
                tally.check([at_edges(pixel), of_surfaces(pixel)] == edge, || format!("pixel {pixel}: edge {edge:?}"));
                let own = before.nearby[pixel];
                let [l, throughput, kd] = own.point;
                let own_light = accumulate::reference(l, throughput, kd, own.sums)
                    .extend(f32::from(u8::from(before.covered[pixel])));
                let mut rays = Vec::new();
                if at_edges(pixel) {
                    marked += 1;
                    let each = edges::rays_of(frame, counts, w * h, of_surfaces(pixel));
                    second += each[1];
                    let mut word = 0;
                    for (round, of_round) in rounds.iter().enumerate() {
                        let place = places[round];
                        places[round] += each[round];
                        // A round without rays leaves the place as it is.
                        let of_tile = edges::rays_of(frame, counts, w * h, counts[1] > 0)[round];
                        word = edges::word(each, if of_tile > 0 { place } else { word >> 4 & 63 }, rays.len() as u32);
                        assert_eq!(of_round.words[pixel], word, "pixel {pixel}");
                        for k in 0..each[round] {
                            let ray = slot(place + k);
                            let d = of_round.directions[ray].truncate();
                            let mut moved = *frame;
                            moved.pixel_offset[..2]
                                .copy_from_slice(&edges::offset_in_round(frame, [round as u32, k], each).to_array());
                            let expected = camera_rays::reference(&moved, pixel as u32);
                            assert!(close(d, expected.direction, 1e-5, 1e-6), "ray {k} of {pixel}: {d}");
                            let hit = hit_of(of_round.hits[ray]);
                            tally.check_hit(&rig, &expected, hit, || format!("ray {k} of pixel {pixel}"));
                            let mirror = hit.filter(|hit| edges::is_plain_mirror(scene, rig.bvh(), hit.triangle));
                            let (mut last, mut last_d) = (hit, d);
                            if let Some(mirror) = mirror {
                                reflected += 1;
                                (last, last_d) = (hit_of(of_round.last_hits[ray]), of_round.turned[ray].truncate());
                                let n = FirstHit::new(scene, rig.bvh(), &mirror, [Vec3::ZERO, d]).normal;
                                assert!(close(last_d, d.reflect(n), 1e-5, 1e-6), "ray {k} of {pixel}: {last_d}");
                                let scale = rig.bvh().typical_scale();
                                let origin = offset_origin(rig.bvh().position(&mirror), n, scale);
                                let onward = Ray::new(origin, d.reflect(n));
                                tally.check_hit(&rig, &onward, last, || format!("ray {k} of {pixel} in a mirror"));
                            }
                            let from_eye = [from_eye(frame, &expected)[0], d];
                            let own = shown(&rig, from_eye, hit.as_ref(), mirror.map(|_| last.as_ref()));
                            let length = last.map_or(0.0, |last| last.t) + mirror.map_or(0.0, |mirror| mirror.t);
                            let forward = Vec4::from(frame.forward).truncate();
                            let width = frame.cones[0] * frame.depth_scale(d.dot(forward) * length);
                            let surface = last.map(|hit| surface_at(scene, rig.bvh(), &hit, last_d, width));
                            let material = surface.map_or(([Vec3::ZERO; 2], false), |s| {
                                let opaque = scene.materials[s.material as usize].surface == Surface::Opaque;
                                ([s.reflectance.kd, s.emission], opaque)
                            });
                            let around = before.around(frame, pixel);
                            match edges::reference(frame, (from_eye, &own), material, &around) {
                                Some(l) => {
                                    let is_shown =
                                        around.iter().any(|near| edges::same_shown(frame, &own, &near.shown));
                                    lent += u32::from(!is_shown && material.0[1] == Vec3::ZERO);
                                    rays.push(l.extend(f32::from(u8::from(hit.is_some()))));
                                }
                                None => unknown += 1,
                            }
                        }
                    }
                }
                let mean = edges::mean(own_light, &rays, edges::weight_in_pass(frame));
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
    bench.covered(
        marked > 300 && second > 300 && compared > 100 && unknown > 0 && lent > 20 && reflected > 50,
        format_args!("{marked} at edges, {second} rays in the second round, {compared} change, {unknown} rays unknown, {lent} of lent light, {reflected} reflected"),
    );
}
