//! Written models with light maps: the light that they give back, patterns, manifests, lamps.

use glam::{Vec2, Vec3};
use lightsum::bake::Options;
use lightsum::bake::files::{self, Form, Manifest, Parts};
use lightsum::bsdf::sample_texture;
use lightsum::output::{Metadata, Tonemap};
use lightsum::scene::{KeptLight, Scene, Texture, TextureUse, Wrap};
use lightsum::settings::{Clip, Exposure, Settings};

use crate::bake::{at_density, baked, plain, room};
use crate::rig::close;
use crate::scenes::Soup;
use crate::support::gpu_test;

#[test]
fn files_give_the_light_back() {
    gpu_test(|ctx| {
        let scene = room(true);
        let settings = Settings { particles: 16, clip: Clip::Distance(0.4), ..plain() };
        let options = Options { density: Some(10.0), max_size: 64, ..Options::default() };
        let (_, light) = baked(ctx, &scene, &settings, options, 2);
        assert!(light.pages.len() > 1, "several pages");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("room.glb");
        let write = |parts, form| files::write(&path, &scene, &light, (parts, form), &Metadata::default()).unwrap();
        let expected = light.kept(&scene);
        let unlit = Form::Unlit { exposure: Exposure::Stops(0.0), tonemap: Tonemap::Srgb };
        for (parts, form) in [(Parts::Together, Form::Lit), (Parts::Apart, Form::Lit), (Parts::Together, unlit)] {
            let written = write(parts, form);
            let maps = if parts == Parts::Apart { 2 } else { 1 } * light.pages.len();
            assert_eq!(written.len(), 1 + maps);
            let read = files::read(&path, &scene).unwrap();
            for triangle in 0..scene.triangles.len() as u32 {
                for back in [false, true] {
                    let of = |kept: &KeptLight| kept.irradiance(triangle, back, [0.3, 0.2]);
                    let ([a, b], [c, d]) = (of(&read), of(&expected));
                    assert!(close(a + b, c + d, 2e-3, 1e-4), "{triangle} {back}: {a} {b} for {c} {d}");
                    assert!(parts != Parts::Apart || close(a, c, 2e-3, 1e-4));
                }
            }
            // The model itself is a scene again.
            let model = lightsum::scene::load(&path).unwrap();
            assert!(model.triangles.len() >= scene.triangles.len());
        }
        let refused = |scene: &Scene| files::read(&path, scene).unwrap_err().to_string();
        let mut moved = scene.clone();
        moved.positions[0].x += 0.1;
        assert!(refused(&moved).contains("another scene"), "{}", refused(&moved));
        write(Parts::Indirect, Form::Lit);
        assert!(refused(&scene).contains("--parts"));
        write(Parts::Together, Form::Lit);
        std::fs::remove_file(folder.path().join("room-irradiance-1.exr")).unwrap();
        assert!(refused(&scene).contains("room-irradiance-1.exr"));
        std::fs::write(&path, b"glTF and nothing else").unwrap();
        assert!(refused(&scene).contains("room.glb"));
        let other = folder.path().join("room.gltf");
        let message = files::write(&other, &scene, &light, (Parts::Together, Form::Lit), &Metadata::default());
        assert!(message.unwrap_err().to_string().contains(".glb"));
    });
}

#[test]
fn patterns_and_second_coordinates_are_kept() {
    gpu_test(|ctx| {
        let mut scene = room(true);
        let texels = vec![[0, 0, 0, 255], [255, 128, 0, 255], [40, 40, 255, 255], [255; 4]];
        let wrap = [Wrap::Repeat; 2];
        scene.textures = vec![Texture { name: String::from("stripes"), width: 2, height: 2, texels, srgb: true, wrap }];
        scene.uvs = scene.positions.iter().map(|p| Vec2::new(p.x, p.z)).collect();
        scene.second_uvs = scene.uvs.iter().map(|uv| 0.7 * *uv + 0.1).collect();
        let lamp = scene.materials.iter().position(|m| m.emission != Vec3::ZERO).unwrap();
        scene.materials[lamp].emission_texture = Some(0);
        scene.materials[lamp].second_uvs[TextureUse::Emission as usize] = true;
        // A surface that reflects and emits by one texture, which is black.
        let red = scene.materials.iter().position(|m| m.base_color.x != m.base_color.y).unwrap();
        scene.textures.push(Texture { width: 1, height: 1, texels: vec![[0, 0, 0, 255]], ..scene.textures[0].clone() });
        scene.materials[red].base_texture = Some(1);
        scene.materials[red].emission_texture = Some(1);
        scene.materials[red].emission = Vec3::splat(1000.0);
        let (_, light) = baked(ctx, &scene, &Settings { particles: 8, ..plain() }, at_density(8.0), 2);
        let emission = light.pages.iter().flat_map(|page| &page.emission);
        assert!(emission.into_iter().all(|e| *e == Vec3::ZERO), "black stays black where it emits");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        let extras = || {
            let json = gltf::Gltf::open(&path).unwrap().document.into_json();
            let extras: serde_json::Value = serde_json::from_str(json.extras.as_ref().unwrap().get()).unwrap();
            serde_json::from_value::<Manifest>(extras["lightsum"]["lightmap"].clone()).unwrap()
        };
        let unlit = Form::Unlit { exposure: Exposure::Stops(-4.0), tonemap: Tonemap::Srgb };
        for (form, set) in [(Form::Lit, 2), (unlit, 0)] {
            files::write(&path, &scene, &light, (Parts::Together, form), &Metadata::default()).unwrap();
            assert_eq!(extras().tex_coord, set);
            let (read, expected) = (files::read(&path, &scene).unwrap(), light.kept(&scene));
            for triangle in 0..scene.triangles.len() as u32 {
                let of = |kept: &KeptLight| kept.irradiance(triangle, false, [0.3, 0.2]).iter().sum::<Vec3>();
                assert!(close(of(&read), of(&expected), 2e-3, 1e-4), "{triangle}");
            }
            let model = lightsum::scene::load(&path).unwrap();
            let at = |scene: &Scene, i: usize| {
                let [a, b, c] = scene.triangle_positions(i);
                (0.5 * a + 0.2 * b + 0.3 * c, scene.triangles[i], [0.5, 0.2, 0.3])
            };
            let lamps = (0..scene.triangles.len()).filter(|&i| scene.triangles[i].material as usize == lamp);
            for i in lamps {
                let (point, triangle, weights) = at(&scene, i);
                let near = |&j: &usize| (at(&model, j).0 - point).length() < 1e-4;
                let (_, same, _) = at(&model, (0..model.triangles.len()).find(near).unwrap());
                let expected = scene.emission_at(&triangle, weights);
                let found = match form {
                    Form::Lit => model.emission_at(&same, weights),
                    Form::Unlit { .. } => {
                        let texture = model.materials[same.material as usize].base_texture.unwrap();
                        let uv = model.uv_at(&same, weights, TextureUse::Base).to_array();
                        16.0 * sample_texture(&model.textures[texture as usize], uv).truncate()
                    }
                };
                assert!(close(found, expected, 0.03, 0.03), "{form:?}, {i}: {found} for {expected}");
            }
        }
    });
}

#[test]
fn manifests_name_every_object_and_its_place() {
    gpu_test(|ctx| {
        let mut scene = room(true);
        scene.objects.push(String::from("screen"));
        let last = scene.triangles.len() - 1;
        scene.triangles[last].object = 1;
        scene.triangles[last - 1].object = 1;
        let (_, light) = baked(ctx, &scene, &Settings { particles: 8, ..plain() }, at_density(8.0), 1);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        files::write(&path, &scene, &light, (Parts::Together, Form::Lit), &Metadata::default()).unwrap();
        let document = gltf::Gltf::open(&path).unwrap().document;
        let extras = document.as_json().extras.as_ref().unwrap().get().to_owned();
        let extras: serde_json::Value = serde_json::from_str(&extras).unwrap();
        let manifest: Manifest = serde_json::from_value(extras["lightsum"]["lightmap"].clone()).unwrap();
        let screen = manifest.objects.iter().find(|entry| entry.object == "screen").unwrap();
        let [_, _, width, height] = screen.rectangle;
        // Both sides of 1 x 1, each at least 8 x 8 texels.
        assert!(screen.charts == 2 && width * height >= 2 * 64, "{screen:?}");
        assert_eq!(manifest.pages[0].irradiance.as_deref(), Some("a-irradiance-0.exr"));
    });
}

/// A lamp that shines downwards and whose back reflects the light of the ceiling: the model has a side for each, and the back is not a second
/// lamp.
#[test]
fn backs_of_lamps_do_not_shine_in_the_model() {
    gpu_test(|ctx| {
        let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
        let mut soup = Soup::new("lamp");
        let (grey, lamp) = (soup.diffuse(0.7, 0.0), soup.diffuse(0.5, 3.0));
        soup.quad(Vec3::ZERO, z * 4.0, x * 4.0, grey);
        soup.quad(y * 2.0, x * 4.0, z * 4.0, grey);
        soup.quad(Vec3::new(1.5, 1.6, 1.5), x, z, lamp);
        let scene = soup.0;
        let (_, light) = baked(ctx, &scene, &plain(), at_density(8.0), 4);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lamp.glb");
        files::write(&path, &scene, &light, (Parts::Together, Form::Lit), &Metadata::default()).unwrap();
        let model = lightsum::scene::load(&path).unwrap();
        let (mut shining, mut dark) = (0, 0);
        for triangle in &model.triangles {
            let [a, b, c] = triangle.vertices.map(|v| model.positions[v as usize]);
            if (a.y - 1.6).abs() > 1e-4 {
                continue;
            }
            let is_front = (b - a).cross(c - a).y < 0.0;
            // The back lies apart, a hair's breadth above.
            assert!(if is_front { a.y == 1.6 } else { a.y > 1.60001 }, "{a}");
            let emission = model.materials[triangle.material as usize].emission;
            assert_eq!(emission != Vec3::ZERO, is_front, "{emission}");
            *if is_front { &mut shining } else { &mut dark } += 1;
        }
        assert_eq!((shining, dark), (2, 2));
    });
}
