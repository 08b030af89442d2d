//! Glossy planes: mirror image, reflectance and summands against their oracles, and whole images.

use glam::{Vec2, Vec3, Vec4};
use lightsum::bsdf::Reflectance as Finish;
use lightsum::pass::{accumulate, merge, mirror_image, summands, superpose};
use lightsum::scene::{Material, Scene};
use lightsum::settings::{Reflectance, Settings, Spread, Superposition};
use lightsum::superposition::reflectance::{ReflectanceMap, fresnel_fitted_rgb};

use crate::rig::{AWKWARD_IMAGES, Builder, Rig, Tally, close};
use crate::support::gpu_test;

/// A room with a glossy floor, a glossy wall of another finish across from the eye, and an opening to nothing.
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

/// One pass at few paths without gather rays.
fn settings(superposition: Superposition) -> Settings {
    let superposition = Some(superposition);
    Settings { paths: 4, compensation: false, max_specular: 4, superposition, ..Settings::default() }
}

/// Lights what the eye sees.
fn light(rig: &Rig) {
    rig.run(|frame, rec| {
        frame.record_walk(rec)?;
        frame.record_eye(rec)?;
        frame.record_shade(rec, 0)
    });
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
            let r = &frame.primary;
            let [position, normal, kd, wo, emitted] =
                [&r.position, &r.geometric, &r.kd, &r.wo, &r.emitted].map(|b| rig.vec4s(b));
            let sums = &frame.pixel_sums;
            let lights = [&sums.direct, &sums.indirect, &sums.specular].map(|b| rig.vec4s(b));
            let (through, region) = (rig.vec4s(&frame.paths.throughput), rig.get::<u32>(&frame.planes.region));
            let widening = rig.vec4s(&frame.planes.widening);
            let mirrors = frame.mirrors.as_ref().unwrap();
            rig.run(|_, rec| mirrors.record_image(rec));
            let (source, footprint) = (rig.vec4s(&mirrors.image.source), rig.vec4s(&mirrors.image.footprint));
            let [cleared, left] = [&r.emitted, &frame.paths.throughput].map(|b| rig.vec4s(b));
            let pixels = region.len();
            let mut tally = Tally::new(format!("mirror image, {resolution:?}"));
            for i in (0..pixels).filter(|&i| region[i] > 0) {
                let k = i + pixels;
                planes[region[i] as usize] += 1;
                let lit = wo[k].w > 0.0;
                let light = lights.each_ref().map(|l| if lit { l[k].truncate() } else { Vec3::ZERO });
                let vectors = [emitted[k], through[k], kd[k]].map(Vec4::truncate);
                let l = merge::reference(vectors[0], vectors[1], vectors[2], light);
                tally.check(close(source[i].truncate(), l, 1e-5, 1e-6), || format!("{i}: {} for {l}", source[i]));
                let seen = (position[k].w >= 0.0).then_some(through[k].w);
                assert_eq!(source[i].w, seen.unwrap_or(mirror_image::NOTHING_SEEN));
                let (d, n) = (-wo[i].truncate(), normal[i].truncate());
                let lobe = mirrors.tables.library.look_up(region[i] - 1, -d.dot(n)).unwrap();
                let mut seen_planes = vec![(lobe.tan_beta, through[i].w)];
                let more = widening[i];
                if more.x > 0.0 {
                    // With one plane more its lobe and its place can be had from the sums.
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
            tally.finish(0.003);
        }
        assert!(planes[1] > 50 && planes[2] > 50 && widened > 5 && nothing > 5, "{planes:?} {widened} {nothing}");
    });
}

#[test]
fn planes_reflect_as_their_oracle_says() {
    gpu_test(|ctx| {
        let scene = room();
        for reflectance in [Reflectance::Schlick, Reflectance::Map, Reflectance::Fresnel] {
            let superposition = Superposition { reflectance, spread: Spread::Mirror, ..Superposition::default() };
            let rig = Rig::new(ctx, &scene, [64, 48], settings(superposition));
            let frame = rig.frame();
            light(&rig);
            let mirrors = frame.mirrors.as_ref().unwrap();
            rig.run(|_, rec| mirrors.record_image(rec));
            let before = rig.vec4s(&frame.primary.emitted);
            rig.run(|_, rec| mirrors.record_superpose(rec));
            let after = rig.vec4s(&frame.primary.emitted);
            let region = rig.get::<u32>(&frame.planes.region);
            let source = rig.vec4s(&mirrors.image.source);
            let [normal, wo] = [&frame.primary.geometric, &frame.primary.wo].map(|b| rig.vec4s(b));
            let mut compared = 0;
            for i in 0..region.len() {
                let more = (after[i] - before[i]).truncate();
                let Some(plane) = region[i].checked_sub(1) else {
                    assert_eq!(after[i], before[i], "pixel {i} shows no plane");
                    continue;
                };
                let mu = normal[i].truncate().dot(wo[i].truncate());
                let finish: &Finish = &rig.engine.scene_buffers().finishes[plane as usize];
                let look_up = |mu: f32| mirrors.tables.library.look_up(plane, mu).unwrap().energy;
                let map = ReflectanceMap::new(|mu| look_up(mu) * fresnel_fitted_rgb(finish.f0, mu)).unwrap();
                let rho = superpose::reference(reflectance, finish, &map, look_up(mu), mu);
                let expected = rho * source[i].truncate();
                let error = (more - expected).abs().max_element();
                assert!(error <= 1e-4 * expected.max_element() + 1e-6, "{reflectance:?} {i}: {more} for {expected}");
                compared += usize::from(expected != Vec3::ZERO);
            }
            assert!(compared > 50, "{reflectance:?}: {compared}");
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
                    frame.record_mirrors(rec)?;
                    frame.record_merge(rec)
                });
                let pass = frame.summands.as_ref().unwrap();
                let r = &frame.primary;
                let [kd, wo, emitted] = [&r.kd, &r.wo, &r.emitted].map(|b| rig.vec4s(b));
                let sums = &frame.pixel_sums;
                let lights = [&sums.direct, &sums.indirect, &sums.specular].map(|b| rig.vec4s(b));
                let (through, reflected) = (rig.vec4s(&frame.paths.throughput), rig.vec4s(&pass.reflected));
                rig.run(|frame, rec| frame.record_summands(rec));
                let film = frame.film.summands.as_ref().unwrap();
                let found = film.each_ref().map(|[sum, _]| rig.vec4s(sum));
                let whole = rig.vec4s(&r.emitted);
                for i in 0..reflected.len() {
                    let lit = wo[i].w > 0.0;
                    let light = lights.each_ref().map(|l| if lit { l[i].truncate() } else { Vec3::ZERO });
                    let seen = (emitted[i].truncate(), emitted[i].w > 0.0);
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
