//! One material, four ways: highlights of virtual lights, a mirror image, splats and the path tracer show the same lobe.

use glam::Vec3;
use lightsum::path_trace::{Options, SpecularPaths};
use lightsum::scene::{Camera, Material, Scene};
use lightsum::settings::{Settings, Splats, Superposition};

use crate::lobe_tables;
use crate::references::path_traced;
use crate::scenes::{Soup, camera, mean, render, settings};
use crate::support::gpu_test;

/// A metal floor in a room whose walls and ceiling shine and are lit, nearly alike: a lobe sees as much light in the mirror image that the eye
/// sees as beyond it.
fn hall(floor: Material) -> (Scene, Camera) {
    let mut soup = Soup::new("hall");
    let floor = soup.material(Material { base_color: Vec3::new(0.9, 0.8, 0.6), metallic: 1.0, ..floor });
    let (ceiling, walls) = (soup.diffuse(0.7, 0.37), soup.diffuse(0.3, 0.73));
    soup.room(Vec3::ZERO, Vec3::new(3.0, 2.0, 3.0), [walls, walls, floor, ceiling, walls, walls]);
    (soup.0, camera(Vec3::new(1.5, 1.2, 1.1), Vec3::new(1.5, 0.0, 1.7), 70.0, [16, 12]))
}

/// The middle, 6 x 4 pixels, of an image of 16 x 12.
fn middle(image: &[Vec3]) -> Vec<Vec3> {
    (4..8).flat_map(|y| (5..11).map(move |x| image[y * 16 + x])).collect()
}

fn energy_of(image: &[Vec3]) -> f64 {
    mean(image).element_sum() / 3.0
}

#[test]
fn every_way_shows_the_same_lobe() {
    gpu_test(|ctx| {
        let (mut misses, mut of_ggx) = (Vec::new(), None);
        println!("{:<12} {:>12} {:>12} {:>12} {:>12}", "lobe", "path tracer", "highlights", "mirror image", "splats");
        for (name, floor) in [
            ("GGX", Material { roughness: 0.4, ..Material::default() }),
            ("table of GGX", Material { lobe: Some(lobe_tables::ggx(0.16, 65)), ..Material::default() }),
            ("cosine", Material { phong_exponent: Some(20.0), ..Material::default() }),
            (
                "two widths",
                Material { roughness: 0.3, anisotropy: 0.6, anisotropy_rotation: 0.5, ..Material::default() },
            ),
        ] {
            let (scene, wide) = hall(floor);
            // The middle alone: only the mirror image needs what is around it.
            let fov_y = 2.0 * ((0.5 * wide.fov_y).to_radians().tan() / 3.0).atan().to_degrees();
            let view = Camera { fov_y, resolution: [6, 4], ..wide };
            // A plane that mirrors the room does not count as a segment: what it shows is lit as if seen directly.
            let [truth, one_more] = [4, 5].map(|max_depth| {
                let options = Options {
                    resolution: view.resolution,
                    samples: 2048,
                    max_depth,
                    max_specular: 4,
                    seed: 5,
                    specular_paths: SpecularPaths::All,
                    reflectance: Default::default(),
                };
                energy_of(&path_traced(&scene, &view, &options))
            });
            // The first is that of GGX, the second a table of the same.
            let whole = *of_ggx.get_or_insert(truth);
            let differs = name == "table of GGX" && (truth / whole - 1.0).abs() > 0.02;
            misses.extend(differs.then(|| format!("{name} by the path tracer: {}", truth / whole)));
            let plain = settings(2048, 4);
            let highlights = Settings { glossy_paths: false, ..plain.clone() };
            let splats = Settings { splats: Some(Splats { particles: 60_000, ..Splats::default() }), ..plain.clone() };
            let [highlights, splats] =
                [highlights, splats].map(|settings| energy_of(&render(ctx, &scene, view, &settings, 4).color) / truth);
            let image = Settings { superposition: Some(Superposition::default()), ..plain };
            let image = energy_of(&middle(&render(ctx, &scene, wide, &image, 4).color)) / one_more;
            println!("{name:<12} {truth:>12.4} {highlights:>12.4} {image:>12.4} {splats:>12.4}");
            for (way, energy) in [("highlights", highlights), ("mirror image", image), ("splats", splats)] {
                misses.extend(((energy - 1.0).abs() > 0.02).then(|| format!("{name} by {way}: {energy}")));
            }
        }
        assert!(misses.is_empty(), "{misses:?}");
    });
}
