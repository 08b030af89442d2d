//! Glossy planes: mirror image, reflectance and summands against their oracles, and whole images.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Vec2, Vec3, Vec4};
use lightsum::bsdf::Reflectance as Finish;
use lightsum::pass::convolve::Form;
use lightsum::pass::{ShadingPoints, accumulate, merge, mirror_image, summands, superpose};
use lightsum::scene::{Camera, Light, Material, Scene, Surface};
use lightsum::settings::{Compensation, Reflectance, Settings, Spread, Superposition};
use lightsum::stage::Stage;
use lightsum::superposition::lobe::{Lobe, Table};
use lightsum::superposition::reflectance::{ReflectanceMap, fresnel_fitted_rgb};

use crate::renderer::path_traced;
use crate::rig::{Builder, Rig, Tally, close, has, is_lit};
use crate::scenes::{self, Soup, camera, compare, render};
use crate::support::gpu_test;
use lightsum::conform::AWKWARD_IMAGES;

/// A room with a glossy floor, a glossy wall of another finish opposite the eye, and an opening to the background.
fn room() -> Scene {
    let mut b = Builder::default();
    let plain = Material::default;
    let gray = b.material(Material { base_color: Vec3::new(0.7, 0.6, 0.5), ..plain() });
    let red = b.material(Material { base_color: Vec3::new(0.8, 0.2, 0.1), ..plain() });
    let lamp = b.material(Material { emission: Vec3::splat(6.0), base_color: Vec3::ZERO, ..plain() });
    let floor = Material { specular: Vec3::new(0.3, 0.25, 0.2), roughness: 0.3, ..plain() };
    let floor = b.material(Material { base_color: Vec3::splat(0.3), ..floor });
    let metal = Material { base_color: Vec3::new(0.63, 0.56, 0.37), metallic: 1.0, roughness: 0.4, ..plain() };
    let metal = b.material(metal);
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    b.quad(Vec3::new(-2.0, 0.0, -2.0), z * 4.0, x * 4.0, floor, 1.0);
    b.quad(Vec3::new(-2.0, 2.2, -2.0), x * 4.0, z * 4.0, gray, 1.0);
    b.quad(Vec3::new(-1.0, 0.0, 2.0), y * 2.2, x * 2.0, metal, 1.0);
    b.quad(Vec3::new(-2.0, 0.0, -2.0), y * 2.2, z * 4.0, red, 1.0);
    b.quad(Vec3::new(-0.5, 2.15, -0.5), x, z * 0.8, lamp, 1.0);
    b.sphere(Vec3::new(0.5, 0.5, 0.8), 0.5, 2, gray, false);
    b.finish(Vec3::new(0.1, 1.2, -1.9), Vec3::new(0.0, 0.7, 1.0))
}

/// One pass with few paths and without gather rays.
fn settings(superposition: Superposition) -> Settings {
    let superposition = Some(superposition);
    Settings { particles: 4, compensation: Compensation::Off, max_specular: 4, superposition, ..Settings::plain() }
}

/// Lights the visible points.
fn light(rig: &Rig) {
    rig.light();
    assert_eq!(rig.lost(), 0);
}

#[test]
fn mirror_images_follow_their_oracle() {
    gpu_test(|ctx| {
        let scene = room();
        let (mut planes, mut widened, mut nothing) = ([0; 3], 0, 0);
        for resolution in AWKWARD_IMAGES {
            let rig = Rig::new(ctx, &scene, resolution, settings(Superposition::default()));
            let frame = rig.frame();
            light(&rig);
            let r = &frame.eye.points;
            let [normal, kd, wo, emitted] = [&r.geometric, &r.kd, &r.wo, &r.emitted].map(|b| rig.vec4s(b));
            let sums = &frame.shade.lighting;
            let lights = [&sums.direct, &sums.indirect, &sums.specular].map(|b| rig.vec4s(b));
            let (through, region) = (rig.vec4s(&frame.eye.paths.throughput), rig.get::<u32>(&frame.eye.planes.region));
            let widening = rig.vec4s(&frame.eye.planes.widening);
            let mirrors = frame.glossy_planes.as_ref().unwrap();
            rig.run(|_, rec| mirrors.record_image(rec));
            let (source, footprint) = (rig.vec4s(&mirrors.image.source), rig.vec4s(&mirrors.image.footprint));
            let [cleared, left] = [&r.emitted, &frame.eye.paths.throughput].map(|b| rig.vec4s(b));
            let pixels = region.len();
            let mut tally = Tally::new(format!("mirror image, {resolution:?}"));
            for i in (0..pixels).filter(|&i| region[i] > 0) {
                let k = i + pixels;
                planes[region[i] as usize] += 1;
                let lit = is_lit(wo[k]);
                let light = lights.each_ref().map(|l| if lit { l[k].truncate() } else { Vec3::ZERO });
                let vectors = [emitted[k], through[k], kd[k]].map(Vec4::truncate);
                let l = merge::reference(vectors[0], vectors[1], vectors[2], light);
                tally.check_values(close(source[i].truncate(), l, 1e-5, 1e-6), &[(source[i].truncate(), l)], || {
                    format!("{i}: {} for {l}", source[i])
                });
                let seen = has(wo[k], ShadingPoints::HIT).then_some(through[k].w);
                assert_eq!(source[i].w, seen.unwrap_or(mirror_image::NOTHING_SEEN));
                let (d, n) = (-wo[i].truncate(), normal[i].truncate());
                let lobe = rig.library().look_up(region[i] - 1, -d.dot(n)).unwrap();
                let mut seen_planes = vec![(lobe.tan_beta, through[i].w)];
                let more = widening[i];
                if more.x > 0.0 {
                    // With only one more plane the sums give its lobe and its position.
                    seen_planes.push((more.x.sqrt(), more.y / more.x));
                    let one = (more.z * more.x - more.y * more.y).abs() <= 1e-4 * more.y * more.y;
                    widened += usize::from(one);
                    if !one {
                        continue;
                    }
                }
                nothing += usize::from(seen.is_none());
                let (diameter, axis) = mirror_image::reference(&rig.parameters, d, n, &seen_planes, seen);
                let of = footprint[i];
                // Lateral and radial scales differ towards the corners of a wide view; their mean is exact.
                tally.check((of.x - diameter).abs() <= 2e-3 * diameter + 1e-3, || format!("{i}: {of} for {diameter}"));
                let along = Vec2::new(of.z, of.w);
                tally
                    .check((along - axis).length() < 2e-3 || d.dot(n) < -0.9999, || format!("{i}: {along} for {axis}"));
                tally.check(of.y.fract() == 0.0, || format!("layer of {i}: {}", of.y));
                assert!(cleared[k] == Vec4::ZERO && left[k].truncate() == Vec3::ZERO, "second component of {i}");
            }
            tally.finish(0.0);
        }
        assert!(planes[1] > 50 && planes[2] > 50 && widened > 5 && nothing > 5, "{planes:?} {widened} {nothing}");
    });
}

#[test]
fn planes_reflect_as_their_oracle_says() {
    gpu_test(|ctx| {
        let scene = room();
        for reflectance in [Reflectance::Schlick, Reflectance::Map, Reflectance::Fresnel] {
            let superposition = Superposition { spread: Spread::Mirror, ..Superposition::default() };
            let mut compared = 0;
            for resolution in AWKWARD_IMAGES.into_iter().chain([[64, 48]]) {
                let settings = Settings { reflectance, ..settings(superposition) };
                let rig = Rig::new(ctx, &scene, resolution, settings);
                let frame = rig.frame();
                light(&rig);
                let mirrors = frame.glossy_planes.as_ref().unwrap();
                rig.run(|_, rec| mirrors.record_image(rec));
                let before = rig.vec4s(&frame.eye.points.emitted);
                rig.run(|_, rec| mirrors.record_superpose(rec));
                let after = rig.vec4s(&frame.eye.points.emitted);
                let region = rig.get::<u32>(&frame.eye.planes.region);
                let source = rig.vec4s(&mirrors.image.source);
                let [normal, wo] = [&frame.eye.points.geometric, &frame.eye.points.wo].map(|b| rig.vec4s(b));
                let mut maps = HashMap::new();
                for i in 0..region.len() {
                    let more = (after[i] - before[i]).truncate();
                    let Some(plane) = region[i].checked_sub(1) else {
                        assert_eq!(after[i], before[i], "pixel {i} shows no plane");
                        continue;
                    };
                    let mu = normal[i].truncate().dot(wo[i].truncate());
                    let finish: &Finish = &rig.engine.device_scene().finishes[plane as usize].reflectance;
                    let look_up = |mu: f32| rig.library().look_up(plane, mu).unwrap();
                    let map = maps.entry(plane).or_insert_with(|| {
                        ReflectanceMap::new(|mu| look_up(mu).energy * fresnel_fitted_rgb(finish.f0, mu)).unwrap()
                    });
                    let lobe = look_up(mu);
                    let rho = superpose::reference(reflectance, finish, map, [lobe.energy, lobe.grazing], mu);
                    let expected = rho * source[i].truncate();
                    let error = (more - expected).abs().max_element();
                    assert!(
                        error <= 1e-4 * expected.max_element() + 1e-6,
                        "{reflectance:?} {resolution:?} {i}: {more} for {expected}"
                    );
                    compared += usize::from(expected != Vec3::ZERO);
                }
            }
            assert!(compared > 300, "{reflectance:?}: {compared}");
        }
    });
}

#[test]
fn summands_follow_their_oracle_and_add_up() {
    gpu_test(|ctx| {
        for scene in [room(), crate::rig::gallery(), crate::frosted_panes::room()] {
            for resolution in AWKWARD_IMAGES {
                let settings = Settings { summands: true, ..settings(Superposition::default()) };
                let rig = Rig::new(ctx, &scene, resolution, settings);
                let frame = rig.frame();
                light(&rig);
                rig.run(|frame, rec| {
                    frame.glossy_planes.record(rec)?;
                    frame.merge.record(rec)
                });
                let pass = frame.summands.as_ref().unwrap();
                let r = &frame.eye.points;
                let [kd, wo, emitted] = [&r.kd, &r.wo, &r.emitted].map(|b| rig.vec4s(b));
                let sums = &frame.shade.lighting;
                let lights = [&sums.direct, &sums.indirect, &sums.specular].map(|b| rig.vec4s(b));
                let (through, reflected) = (rig.vec4s(&frame.eye.paths.throughput), rig.vec4s(&pass.reflected));
                rig.run(|frame, rec| frame.summands.record(rec));
                let film = frame.output.film.summands.as_ref().unwrap();
                let found = film.each_ref().map(|sum| rig.vec4s(&sum.0[0]));
                let whole = rig.vec4s(&r.emitted);
                for i in 0..reflected.len() {
                    let lit = is_lit(wo[i]);
                    let light = lights.each_ref().map(|l| if lit { l[i].truncate() } else { Vec3::ZERO });
                    let seen = (emitted[i].truncate(), has(wo[i], ShadingPoints::SEEN_BY_SPECULAR));
                    let [beta, kd] = [through[i], kd[i]].map(Vec4::truncate);
                    let expected = summands::reference(seen, beta, kd, light, reflected[i].truncate());
                    for (found, expected) in found.iter().zip(expected) {
                        let found = found[i].truncate();
                        assert!(close(found, expected, 1e-5, 1e-6), "{resolution:?} {i}: {found} for {expected}");
                    }
                    let sum: Vec3 = expected.iter().sum();
                    let image = accumulate::reference(whole[i].truncate(), beta, kd, light);
                    assert!(close(sum, image, 1e-5, 1e-6), "{resolution:?} {i}: {sum} for {image}");
                }
            }
        }
    });
}

/// Two planes that face each other, and a floor between them, all with the same finish.
fn facing(finish: Material) -> (Scene, Camera) {
    let mut soup = Soup::new("facing planes");
    let walls = [[0.6, 0.1, 0.1], [0.1, 0.5, 0.2], [0.5, 0.5, 0.4], [0.6, 0.6, 0.6]];
    let walls = walls.map(|albedo| soup.diffuse(albedo, 0.0));
    let shiny = soup.material(finish);
    let faces = [shiny, shiny, walls[0], walls[1], walls[2], shiny];
    soup.room(Vec3::ZERO, Vec3::new(2.0, 1.5, 2.0), faces);
    soup.0.lights.push(Light::Point { position: Vec3::new(1.0, 1.3, 0.6), intensity: Vec3::new(3.0, 2.8, 2.2) });
    soup.ball(Vec3::new(1.2, 0.4, 1.0), 0.25, 12, walls[3]);
    (soup.0, camera(Vec3::new(1.0, 0.9, 0.05), Vec3::new(0.6, 0.5, 1.5), 75.0, [32, 24]))
}

/// Planes with the narrowest lobe are mirrors, in corners and facing each other, seen in each other up to the maximum
/// number of steps.
#[test]
fn planes_that_hardly_spread_are_mirrors() {
    gpu_test(|ctx| {
        let metal = Material { base_color: Vec3::new(0.9, 0.8, 0.7), metallic: 1.0, ..Material::default() };
        let (mirrors, camera) = facing(Material { surface: Surface::Mirror, ..metal.clone() });
        let (planes, _) = facing(Material { roughness: 0.03, ..metal });
        assert_eq!(planes.reflectors().len(), 3);
        for max_specular in [4, 8] {
            let plain = Settings { max_specular, ..scenes::settings(1, 2) };
            let superposition = Some(Superposition::default());
            let expected = render(ctx, &mirrors, camera, &plain, 16);
            let found = render(ctx, &planes, camera, &Settings { superposition, ..plain.clone() }, 16);
            let (energy, error) = compare(&found.color, &expected.color);
            println!("{max_specular} mirrors: energy {energy:.4}, error {error:.4}");
            assert!((energy - 1.0).abs() < 0.01 && error < 0.05, "{max_specular}: {energy} {error}");
        }
    });
}

/// A metal floor that reflects stripes of light, rough enough to blur them.
fn stripes(roughness: f32) -> (Scene, Camera) {
    let mut soup = Soup::new("stripes");
    let black = soup.diffuse([0.0; 3], 0.0);
    let base_color = Vec3::new(0.63, 0.56, 0.37);
    let floor = soup.material(Material { base_color, metallic: 1.0, roughness, ..Material::default() });
    soup.quad(Vec3::new(-3.0, 0.0, 0.0), Vec3::Z * 4.0, Vec3::X * 6.0, floor);
    for i in 0..8 {
        let bright = soup.diffuse([0.0; 3], [[0.2, 0.3, 1.0], [2.0, 1.5, 0.5]][i % 2]);
        let corner = Vec3::new(-4.0 + i as f32, 0.0, 4.0);
        soup.quad(corner, Vec3::Y * 3.0, Vec3::X, bright);
    }
    soup.quad(Vec3::new(-4.0, 3.0, 0.0), Vec3::X * 8.0, Vec3::Z * 4.0, black);
    (soup.0, camera(Vec3::new(0.0, 1.0, 0.2), Vec3::new(0.0, 0.2, 2.2), 50.0, [96, 64]))
}

#[test]
fn a_rough_floor_reflects_as_much_as_the_path_tracer_says() {
    gpu_test(|ctx| {
        for (roughness, off, greatest) in [(0.2, 0.015, 0.08), (0.4, 0.08, 0.15)] {
            let (scene, camera) = stripes(roughness);
            // Of the rougher lobe a twelfth meets the dark surroundings, which the mirror image does not show: both
            // spreads are too bright by it. Towards the image's edges the lobe extends beyond the mirror image.
            let middle = |image: &[Vec3]| -> Vec<Vec3> {
                let inside = |i: &usize| (24..72).contains(&(i % 96)) && (16..48).contains(&(i / 96));
                (0..image.len()).filter(inside).map(|i| image[i]).collect()
            };
            let reference = middle(&path_traced(&scene, &camera, 1024, 2));
            let shown = |superposition: Option<Superposition>| {
                let settings = Settings { superposition, compensation: Compensation::Off, ..scenes::settings(1, 1) };
                middle(&render(ctx, &scene, camera, &settings, 4).color)
            };
            let [variant, mirror] = [Spread::Variant, Spread::Mirror]
                .map(|spread| shown(Some(Superposition { spread, ..Superposition::default() })))
                .map(|image| compare(&image, &reference));
            println!("roughness {roughness}: spread {variant:.4?}, mirror {mirror:.4?}");
            assert!((variant.0 - 1.0).abs() < off && variant.1 < greatest, "{roughness}: {variant:?}");
            assert!(mirror.1 > 2.0 * variant.1, "{roughness}: {mirror:?}");
        }
    });
}

/// A floor that reflects a small light before a black wall.
fn spot(floor: Material) -> (Scene, Camera) {
    let mut soup = Soup::new("spot");
    let (black, lamp) = (soup.diffuse(0.0, 0.0), soup.diffuse(0.0, 10.0));
    let floor = soup.material(Material { base_color: Vec3::ONE, metallic: 1.0, ..floor });
    soup.quad(Vec3::new(-4.0, 0.0, -1.0), Vec3::Z * 5.5, Vec3::X * 8.0, floor);
    soup.quad(Vec3::new(-5.0, 0.0, 4.52), Vec3::Y * 5.0, Vec3::X * 10.0, black);
    soup.quad(Vec3::new(-0.2, 1.0, 4.5), Vec3::Y * 0.4, Vec3::X * 0.4, lamp);
    (soup.0, camera(Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.0, 0.0, 1.9), 60.0, [48, 36]))
}

/// Mean and second moments of the light of an image below its upper third: x, y, x^2, y^2, x y.
fn shape(image: &[Vec3]) -> [f64; 5] {
    let (mut sum, mut moments) = (0.0, [0.0; 5]);
    for (i, light) in image.iter().enumerate().skip(48 * 10) {
        let [x, y] = [i % 48, i / 48].map(|k| k as f64);
        let light = f64::from(light.y);
        sum += light;
        moments.iter_mut().zip([x, y, x * x, y * y, x * y]).for_each(|(m, v)| *m += light * v);
    }
    let [x, y, xx, yy, xy] = moments.map(|m| m / sum);
    [x, y, xx - x * x, yy - y * y, xy - x * y]
}

/// The grain of a kernel lies in the image at the right angle.
#[test]
fn grains_lie_in_the_image_as_the_path_tracer_says() {
    gpu_test(|ctx| {
        let floor = Material { roughness: 0.2, anisotropy: 0.4, anisotropy_rotation: 0.8, ..Material::default() };
        let (scene, camera) = spot(floor);
        let truth = shape(&path_traced(&scene, &camera, 256, 2));
        // The pyramid of the fast form rounds long kernels.
        for (form, least) in [(Form::Direct, 0.7), (Form::Fast, 0.45)] {
            let settings = Settings {
                superposition: Some(Superposition { form, ..Superposition::default() }),
                compensation: Compensation::Off,
                ..scenes::settings(1, 1)
            };
            let found = shape(&render(ctx, &scene, camera, &settings, 4).color);
            println!("{form:?}: {found:.2?} for {truth:.2?}");
            assert!((0..2).all(|k| (found[k] - truth[k]).abs() < 1.2), "{form:?}: {found:?} for {truth:?}");
            let share = found[4] / truth[4];
            assert!(share > least && share < 1.1, "{form:?}: {found:?} for {truth:?}");
        }
    });
}

/// In constant light the floor reflects what its lobe does as a whole, however much of it lies beyond the mirror image.
#[test]
fn a_rough_floor_in_constant_light_reflects_the_energy_of_its_lobe() {
    gpu_test(|ctx| {
        for (roughness, anisotropy, anisotropy_rotation) in [(0.2, 0.0, 0.0), (0.4, 0.0, 0.0), (0.3, 0.5, 0.6)] {
            let mut soup = Soup::new("constant");
            let lamp = soup.diffuse(0.0, 1.0);
            let base_color = Vec3::new(0.63, 0.56, 0.37);
            let floor = soup.material(Material {
                base_color,
                metallic: 1.0,
                roughness,
                anisotropy,
                anisotropy_rotation,
                ..Material::default()
            });
            soup.room(Vec3::new(-4.0, -0.5, -3.0), Vec3::new(4.0, 3.0, 5.0), [lamp; 6]);
            soup.quad(Vec3::new(-3.9, 0.0, -2.9), Vec3::Z * 7.8, Vec3::X * 7.8, floor);
            let camera = stripes(roughness).1;
            let reference = path_traced(&soup.0, &camera, 1024, 2);
            let settings = Settings {
                superposition: Some(Superposition::default()),
                compensation: Compensation::Off,
                ..scenes::settings(1, 1)
            };
            let found = render(ctx, &soup.0, camera, &settings, 16).color;
            let shown: Vec<usize> = (0..found.len()).filter(|&i| reference[i].x < 0.9).collect();
            let of = |image: &[Vec3]| -> Vec<Vec3> { shown.iter().map(|&i| image[i]).collect() };
            let (energy, error) = compare(&of(&found), &of(&reference));
            println!("roughness {roughness}: energy {energy:.4}, error {error:.4} of {} pixels", shown.len());
            assert!(shown.len() > 4000 && (energy - 1.0).abs() < 0.003 && error < 0.02, "{energy} {error}");
        }
    });
}

/// With a table of the lobe's values instead, the image is nearly the same.
#[test]
fn a_tabulated_lobe_spreads_as_the_lobe_does() {
    gpu_test(|ctx| {
        let (mut scene, camera) = stripes(0.4);
        let lobe = Lobe::Ggx { alpha: 0.16 };
        let cos: Vec<f32> = (0..64).map(|i| (1.57 * (1.0 - i as f32 / 63.0)).cos()).collect();
        let azimuth: Vec<f32> =
            (0..48).map(|k| std::f32::consts::PI * (1.0 - (1.0 - k as f32 / 47.0).powi(2))).collect();
        let direction = |cos: f32, azimuth: f32| {
            let sin = (1.0 - cos * cos).sqrt();
            Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
        };
        let pairs = cos.iter().flat_map(|&i| cos.iter().map(move |&o| (i, o)));
        let values = pairs
            .flat_map(|(i, o)| azimuth.iter().map(move |&a| (i, o, a)))
            .map(|(i, o, a)| lobe.eval(direction(i, a), direction(o, 0.0)))
            .collect();
        let settings = Settings {
            superposition: Some(Superposition::default()),
            compensation: Compensation::Off,
            ..scenes::settings(1, 1)
        };
        let expected = render(ctx, &scene, camera, &settings, 1).color;
        scene.materials[1].lobe = Some(Arc::new(Table::new(cos.clone(), cos, azimuth, values).unwrap()));
        let found = render(ctx, &scene, camera, &settings, 1).color;
        let (energy, error) = compare(&found, &expected);
        println!("energy {energy:.4}, error {error:.4}");
        assert!((energy - 1.0).abs() < 0.01 && error < 0.02 && error > 0.0, "{energy} {error}");
    });
}
