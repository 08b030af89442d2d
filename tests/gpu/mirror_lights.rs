//! Lights mirrored by planar mirrors: the pass against its oracle, against closed forms and the path tracer, and its
//! other guarantees.

use glam::{Vec2, Vec3};
use lightsum::pass::delta_choice;
use lightsum::pass::layout::PointLight;
use lightsum::pass::mirror_lights::{bounded, mirrored, reference, weight};
use lightsum::pass::{ShadingPoints, near_points};
use lightsum::path_trace::{Options, SpecularPaths};
use lightsum::ring::Paths;
use lightsum::scene::{Camera, Light, Material, Scene, Surface};
use lightsum::settings::{Filter, Reflectance, Settings};
use lightsum::stage::Stage;

use crate::references::path_traced;
use crate::renderer::bits;
use crate::rig::{Rig, STRAYS, Tally, close, gallery_with_tables, xyz};
use crate::scenes::{Soup, camera, mean, original, render, settings};
use crate::support::gpu_test;
use lightsum::conform::AWKWARD_IMAGES;
use lightsum::conform::checks::light::receivers;

fn mirror(reflectance: f32) -> Material {
    let specular = Vec3::splat(reflectance);
    Material { surface: Surface::Mirror, base_color: Vec3::ZERO, specular, ..Material::default() }
}

/// The chosen mirrored lights of each class with the numbers of their mirrors + 1.
fn chosen(rig: &Rig) -> Vec<Vec<(PointLight, u32)>> {
    let pass = rig.frame().mirror_lights.as_ref().unwrap();
    let lights: Vec<PointLight> = rig.get(&pass.mirrored);
    let numbers: Vec<u32> = rig.get(&pass.numbers);
    let each = rig.parameters.mirrors[0] as usize;
    lights
        .chunks(each)
        .zip(numbers.chunks(each))
        .map(|(l, n)| l.iter().copied().zip(n.iter().copied()).collect())
        .collect()
}

#[test]
fn lights_and_mirrors_are_chosen_by_their_oracle() {
    gpu_test(|ctx| {
        let scene = gallery_with_tables();
        for (n, paths) in [(1, 1), (7, 27), (64, 64), (1024, 64), (40, 2049)] {
            let base = Settings { mirror_lights: n, pattern: [2, 1], ..settings(paths, 5) };
            let rig = Rig::new(ctx, &scene, [8, 8], base);
            let mirrors = &rig.engine.device_scene().mirrors.list;
            let [each, count, planes, _] = rig.parameters.mirrors;
            assert_eq!((each, planes as usize, mirrors.len()), (n, 2, 2));
            assert_eq!(count, rig.engine.plan().lights.first_slot(3));
            rig.prefill(&[&rig.frame().mirror_lights.as_ref().unwrap().numbers]);
            rig.run(|frame, rec| {
                frame.walk.record(rec)?;
                frame.mirror_lights.as_ref().unwrap().record_choice(rec)
            });
            let lights: Vec<PointLight> = rig.get(&rig.frame().walk.lights);
            let mut found = 0;
            for (class, images) in chosen(&rig).iter().enumerate() {
                let of_class = &lights[class * rig.parameters.pattern[3] as usize..][..count as usize];
                let pairs: Vec<_> = of_class.iter().flat_map(|l| mirrors.iter().map(move |m| (l, m))).collect();
                let weights: Vec<f64> = pairs.iter().map(|(l, m)| weight(l, m)).collect();
                let pi = delta_choice::reference(&weights, n);
                let mut next = 0;
                for &(image, number) in images.iter().filter(|(_, number)| *number > 0) {
                    // Mirrored lights are in the order of their pairs.
                    let same = |i: &usize| {
                        let expected = mirrored(pairs[*i].0, pairs[*i].1);
                        let at = |l: &PointLight| (xyz(l.position), xyz(l.normal));
                        let ((a, n), (b, m)) = (at(&image), at(&expected));
                        *i % mirrors.len() + 1 == number as usize && close(a, b, 1e-5, 1e-5) && close(n, m, 1e-5, 1e-5)
                    };
                    let i = (next..pairs.len()).find(same).expect("the image of a light");
                    next = i + 1;
                    let (whole, part) = (pairs[i].0, &image);
                    let share = xyz(whole.emit).element_sum() / xyz(part.emit).element_sum();
                    assert!(
                        (f64::from(share) - pi[i]).abs() < 0.005 * pi[i] + 3e-6,
                        "{n} of {}: pair {i} has {share} for {}",
                        pairs.len(),
                        pi[i]
                    );
                    found += 1;
                }
                let most = weights.iter().filter(|w| **w > 0.0).count().min(n as usize);
                assert!(images.len() == n as usize && next > 0, "{most} of {n}");
                if most < n as usize {
                    assert_eq!(images.iter().filter(|(_, number)| *number > 0).count(), most);
                }
            }
            assert!(found > 0);
        }
    });
}

/// Direct irradiance of all points in the next test.
const BEFORE: f32 = 0.0005;

#[test]
fn mirror_lights_follow_their_oracle() {
    gpu_test(|ctx| {
        let scene = gallery_with_tables();
        let patterns = [[1, 1], [2, 1], [1, 1], [1, 2], [3, 2]];
        let images = AWKWARD_IMAGES.into_iter().zip(patterns);
        let mut cut = 0;
        for ((resolution, pattern), (filter, pass)) in images.flat_map(|image| {
            [(image, (None, 0)), (image, (Some(Filter::default()), 0)), (image, (Some(Filter::default()), 9))]
        }) {
            // Lobes without paths of their own.
            let reflectance = Reflectance::Fresnel;
            let base =
                Settings { mirror_lights: 24, pattern, glossy_paths: false, reflectance, filter, ..settings(27, 5) };
            let rig = Rig::at_pass(ctx, &scene, resolution, base, pass);
            let sums = &rig.frame().shade.lighting;
            rig.run(|frame, rec| {
                frame.walk.record(rec)?;
                frame.eye.record(rec)?;
                frame.mirror_lights.as_ref().unwrap().record_choice(rec)?;
                [&sums.indirect, &sums.specular].into_iter().try_for_each(|b| rec.fill(b, 0))?;
                rec.fill(&sums.direct, BEFORE.to_bits())?;
                frame.mirror_lights.as_ref().unwrap().record_light(rec)
            });
            assert_eq!(rig.lost(), 0);
            let mirrors = &rig.engine.device_scene().mirrors;
            let all = receivers(&rig, &rig.frame().eye.points);
            let (images, indirect, specular) = (chosen(&rig), rig.vec4s(&sums.indirect), rig.vec4s(&sums.specular));
            let words = rig.vec4s(&rig.frame().eye.points.wo);
            let mut tally = Tally::new(format!("mirror_lights at {resolution:?}"));
            let (mut lit, mut shiny) = (0, 0);
            for slot in rig.list(0) {
                let class = lightsum::pass::sort::class_of(&rig.parameters, slot);
                let flags = ShadingPoints::flags(words[slot as usize].w);
                // Classes take turns.
                let takes_turn = near_points::has_near_ray(&rig.parameters, slot, class, flags);
                let weight = if takes_turn { near_points::ray_weight(&rig.parameters, slot, flags) } else { 0.0 };
                let mut expected = [Vec3::ZERO; 2];
                for (image, number) in images[class as usize].iter().filter(|(_, number)| *number > 0) {
                    let planes = (&mirrors.list[..], &mirrors.of_triangle[..]);
                    let receiver = &all[slot as usize];
                    let one = reference(&rig.parameters, &scene, rig.bvh(), planes, receiver, image, number - 1);
                    let part = bounded(&rig.parameters, weight * one[0], Vec3::splat(BEFORE) + expected[0]);
                    expected[0] += part * weight * one[0];
                    expected[1] += part * weight * one[1];
                    cut += u32::from(part < 0.9);
                }
                let found = [indirect[slot as usize].truncate(), specular[slot as usize].truncate()];
                lit += u32::from(expected[0] != Vec3::ZERO);
                shiny += u32::from(expected[1] != Vec3::ZERO);
                let same = close(found[0], expected[0], 2e-3, 1e-6) && close(found[1], expected[1], 2e-2, 1e-5);
                let values = [(found[0], expected[0]), (found[1], expected[1])];
                tally.check_values(same, &values, || format!("slot {slot}: {found:?} for {expected:?}"));
            }
            println!("{resolution:?}: {lit} lit, {shiny} of them shiny");
            // Where classes take turns, fewer points are lit.
            let turns = near_points::ray_weight(&rig.parameters, 0, 0);
            let enough = lit as f32 * turns > 60.0 && shiny as f32 * turns > 20.0;
            assert!(resolution[0] * resolution[1] < 500 || enough);
            tally.finish(STRAYS);
        }
        assert!(cut > 50, "{cut} lights are bounded");
    });
}

/// A mirror on the floor, a point light above its left end, and a wall on its right.
fn beam() -> (Scene, Vec3) {
    let mut soup = Soup::new("beam");
    let (plane, wall) = (soup.material(mirror(0.8)), soup.diffuse(0.5, 0.0));
    soup.quad(Vec3::ZERO, Vec3::Z, Vec3::X, plane);
    soup.quad(Vec3::new(2.0, 0.0, -1.0), Vec3::Z * 3.0, Vec3::Y * 5.0, wall);
    let light = Vec3::new(-0.5, 1.0, 0.5);
    soup.0.lights.push(Light::Point { position: light, intensity: Vec3::new(4.0, 3.0, 2.0) });
    soup.0.camera = Some(camera(Vec3::new(-3.0, 2.5, 0.5), Vec3::new(2.0, 2.5, 0.5), 70.0, [8, 8]));
    (soup.0, light)
}

#[test]
fn a_mirror_throws_the_light_of_the_image_on_a_wall() {
    gpu_test(|ctx| {
        let (scene, light) = beam();
        let rig = Rig::new(ctx, &scene, [61, 47], Settings { mirror_lights: 3, ..settings(4, 3) });
        rig.run(|frame, rec| frame.record(rec, &rig.parameters, &Paths::default()));
        let indirect = rig.vec4s(&rig.frame().shade.lighting.indirect);
        let image = light * Vec3::new(1.0, -1.0, 1.0);
        let all = receivers(&rig, &rig.frame().eye.points);
        let (mut bright, mut dark, mut sum) = (0, 0, 0.0);
        for slot in rig.list(0) {
            let r = &all[slot as usize];
            let d = image - r.position;
            let through = r.position + d * (r.position.y / (r.position.y - image.y));
            let outside =
                Vec2::new(through.x, through.z).clamp(Vec2::ZERO, Vec2::ONE) - Vec2::new(through.x, through.z);
            let wi = d.normalize();
            // Schlick's term of a mirror of 0.8, whose f90 is 1.
            let reflected = 0.8 + 0.2 * (1.0 + wi.y).powi(5);
            let e = Vec3::new(4.0, 3.0, 2.0) * (reflected * wi.dot(r.shading).max(0.0) / d.length_squared());
            let expected = if outside == Vec2::ZERO { e } else { Vec3::ZERO };
            let found = indirect[slot as usize].truncate();
            let edge = (through.x.min(1.0 - through.x)).min(through.z.min(1.0 - through.z)).abs() < 1e-3;
            assert!(edge || close(found, expected, 1e-4, 1e-7), "{}: {found} for {expected}", r.position);
            bright += u32::from(expected != Vec3::ZERO);
            dark += u32::from(expected == Vec3::ZERO);
            sum += found.x;
        }
        println!("{bright} pixels see the image, {dark} do not");
        assert!(bright > 200 && dark > 200 && sum > 0.0);
    });
}

#[test]
fn strips_are_left_to_photons() {
    gpu_test(|ctx| {
        // A strip 20 times as long as wide covers 0.06 of the disc around it.
        for (width, count) in [(1.0, 1), (0.2, 1), (0.05, 0)] {
            let (mut scene, _) = beam();
            let corners = scene.triangles.iter().take(2).flat_map(|t| t.vertices).collect::<Vec<_>>();
            for corner in corners {
                scene.positions[corner as usize].x = scene.positions[corner as usize].x.min(width);
            }
            let rig = Rig::new(ctx, &scene, [8, 8], Settings { photons: 0, ..settings(4, 3) });
            assert_eq!(rig.engine.device_scene().mirror_count(), count, "a mirror 1 long and {width} wide");
        }
    });
}

#[test]
fn light_by_way_of_mirrors_has_the_energy_of_the_path_tracer() {
    gpu_test(|ctx| {
        // A corner of floor and wall, a mirror on the other wall, a mirror over a diffuse base on the floor, a lamp above.
        let mut soup = Soup::new("mirror corner");
        let (plane, grey, lamp) = (soup.material(mirror(0.9)), soup.diffuse(0.6, 0.0), soup.diffuse(0.0, 6.0));
        let varnish = soup.material(Material { base_color: Vec3::new(0.6, 0.4, 0.2), ..mirror(0.3) });
        soup.quad(Vec3::ZERO, Vec3::Z * 3.0, Vec3::X * 3.0, grey);
        soup.quad(Vec3::new(0.0, 0.0, 3.0), Vec3::Y * 3.0, Vec3::X * 3.0, grey);
        soup.quad(Vec3::new(3.0, 0.2, 0.5), Vec3::Z * 2.0, Vec3::Y * 2.0, plane);
        soup.quad(Vec3::new(0.5, 0.01, 1.0), Vec3::Z * 1.5, Vec3::X * 1.5, varnish);
        soup.quad(Vec3::new(1.0, 2.5, 1.0), Vec3::X * 0.8, Vec3::Z * 0.8, lamp);
        let view = camera(Vec3::new(-1.5, 2.0, -2.0), Vec3::new(1.5, 0.8, 2.0), 50.0, [24, 18]);
        let options = Options {
            resolution: view.resolution,
            samples: 4096,
            max_depth: 3,
            max_specular: 8,
            seed: 1,
            specular_paths: SpecularPaths::All,
            reflectance: Default::default(),
        };
        let truth = path_traced(&soup.0, &view, &options);
        let image = |mirror_lights| {
            let base = Settings { mirror_lights, ..original(32, 3) };
            render(ctx, &soup.0, view, &base, 96).color
        };
        let level = mean(&truth).x;
        let [off, few, many] = [0, 4, 24].map(|n| mean(&image(n)).x / level);
        println!("energy {off:.4} without mirrored lights, {few:.4} with 4, {many:.4} with 24");
        assert!((many - 1.0).abs() < 0.01 && (few - 1.0).abs() < 0.02, "{few}, {many}");
        assert!(off < 0.97, "{off}");
    });
}

#[test]
fn photons_leave_out_what_mirrored_lights_do() {
    gpu_test(|ctx| {
        let (scene, _) = beam();
        let view = Camera { resolution: [31, 17], ..scene.camera.unwrap() };
        let image = |mirror_lights, photons| {
            let base = Settings { mirror_lights, photons, ..settings(4, 3) };
            bits(&render(ctx, &scene, view, &base, 3))
        };
        let mirrored = image(2, 0);
        assert!(image(2, 500) == mirrored, "photons add nothing");
        assert!(image(0, 500) != image(0, 0) && image(0, 500) != mirrored);
    });
}

#[test]
fn the_same_seed_gives_the_same_mirrored_lights() {
    gpu_test(|ctx| {
        let scene = gallery_with_tables();
        let view = Camera { resolution: [31, 17], ..scene.camera.unwrap() };
        let base = Settings { mirror_lights: 5, photons: 100, pattern: [2, 2], ..settings(8, 4) };
        let image = |settings: Settings| bits(&render(ctx, &scene, view, &settings, 2));
        let first = image(base.clone());
        assert!(image(base.clone()) == first, "a second renderer");
        assert!(image(Settings { rounds: 9, ..base.clone() }) == first, "nine rounds");
        assert!(image(Settings { mirror_lights: 0, ..base.clone() }) != first, "no mirrored lights");
        let off = |settings| Rig::new(ctx, &scene, [8, 8], settings).frame().mirror_lights.is_none();
        assert!(off(Settings { mirror_lights: 0, ..base.clone() }) && off(Settings { max_depth: 2, ..base }));
    });
}
