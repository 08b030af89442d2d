//! Hash of scene, camera and settings, so that a state is resumed only by the rendering that it belongs to.

use std::fmt::Debug;

use crate::scene::Scene;
use crate::settings::{Settings, Traversal};

/// FNV-1a, 64 bit.
pub struct Fnv(pub u64);

impl Default for Fnv {
    fn default() -> Self {
        Fnv(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    /// Hashes bytes.
    pub fn add(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.0 = (self.0 ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3);
        }
    }
}

/// Fingerprint of everything that a user chooses and that affects any bit of the image. `rounds` (how often rays may be resumed) and the
/// passes of an animation's frames do not, and are excluded. The partition into dispatches does: it decides which rays of a difficult
/// scene clusters leave to single rays. Device, driver and traversal are told apart by a [`Provenance`](crate::output::Provenance): the
/// machine and a measurement choose them. `view` is a camera or an atlas.
pub fn fingerprint(scene: &Scene, view: &impl Debug, settings: &Settings) -> u64 {
    let mut hash = Fnv::default();
    hash.add(bytemuck::cast_slice(&scene.positions));
    hash.add(bytemuck::cast_slice(&scene.normals));
    hash.add(bytemuck::cast_slice(&scene.uvs));
    hash.add(bytemuck::cast_slice(&scene.second_uvs));
    hash.add(bytemuck::cast_slice(&scene.colors));
    for t in &scene.triangles {
        hash.add(bytemuck::cast_slice(&t.vertices));
        hash.add(&[t.material.to_le_bytes(), t.object.to_le_bytes()].concat());
        hash.add(&[u8::from(t.smooth)]);
    }
    for texture in &scene.textures {
        hash.add(bytemuck::cast_slice(&texture.texels));
        hash.add(format!("{} {} {} {:?}", texture.width, texture.height, texture.srgb, texture.wrap).as_bytes());
    }
    if let Some(kept) = &scene.kept_light {
        hash.add(format!("{:?}", kept.faces).as_bytes());
        for page in &kept.pages {
            hash.add(bytemuck::cast_slice(&page.size));
            hash.add(bytemuck::cast_slice(&page.direct));
            hash.add(bytemuck::cast_slice(&page.indirect));
        }
    }
    if let Some(images) = &scene.mirror_images {
        hash.add(bytemuck::cast_slice(&images.points));
        hash.add(format!("{:?} {} {:?}", images.size, images.layers, images.hemispheres).as_bytes());
    }
    // Debug prints floats in their shortest exact form.
    let settings = Settings { rounds: 1, moving_passes: 1, traversal: Traversal::Auto, ..settings.clone() };
    let words = format!(
        "{:?} {:?} {:?} {:?} {:?} {}",
        scene.materials, scene.lights, scene.environment, view, settings, scene.emitters_are_lights
    );
    hash.add(words.as_bytes());
    hash.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Camera, Light, Material, Surface, Texture, Triangle, Wrap};
    use crate::settings::{Clip, Compensation, Sequence};
    use crate::superposition::depth_images::DepthImages;
    use glam::{Vec2, Vec3};

    fn scene() -> Scene {
        Scene {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            uvs: vec![Vec2::ZERO; 3],
            triangles: vec![Triangle { vertices: [0, 1, 2], material: 0, object: 0, smooth: false }],
            materials: vec![Material { name: String::from("wall"), ..Material::default() }],
            textures: vec![Texture {
                name: String::from("plain"),
                width: 2,
                height: 1,
                texels: vec![[1, 2, 3, 4]; 2],
                srgb: true,
                wrap: [Wrap::Repeat; 2],
            }],
            lights: vec![Light::Point { position: Vec3::ONE, intensity: Vec3::ONE }],
            ..Scene::default()
        }
    }

    fn camera() -> Camera {
        Camera {
            eye: Vec3::ZERO,
            target: Vec3::Z,
            up: Vec3::Y,
            fov_y: 40.0,
            resolution: [4, 3],
            aperture: 0.0,
            focus: None,
            shutter: 0.0,
            height: None,
            frustum: None,
        }
    }

    #[test]
    fn every_part_of_a_scene_counts() {
        type Change = (&'static str, fn(&mut Scene));
        let base = fingerprint(&scene(), &camera(), &Settings::plain());
        let changes: [Change; 28] = [
            ("position", |s| s.positions[0].y = 1e-30),
            ("normal", |s| s.normals[1].x = 1e-30),
            ("texture coordinate", |s| s.uvs[2].y = 1e-30),
            ("second texture coordinates", |s| s.second_uvs = vec![Vec2::ONE; 3]),
            ("vertex colour", |s| s.colors = vec![Vec3::ONE; 3]),
            ("emission texture", |s| s.materials[0].emission_texture = Some(0)),
            ("set of texture coordinates", |s| s.materials[0].second_uvs[1] = true),
            ("normal texture", |s| s.materials[0].normal_texture = Some(0)),
            ("vertices", |s| s.triangles[0].vertices = [0, 2, 1]),
            ("material of a triangle", |s| s.triangles[0].material = 1),
            ("object of a triangle", |s| s.triangles[0].object = 1),
            ("smooth", |s| s.triangles[0].smooth = true),
            ("surface", |s| s.materials[0].surface = Surface::Glass),
            ("base colour", |s| s.materials[0].base_color.y = 0.81),
            ("base texture", |s| s.materials[0].base_texture = Some(0)),
            ("roughness", |s| s.materials[0].roughness = 0.9),
            ("emission", |s| s.materials[0].emission.z = 1e-30),
            ("exponent of the emission", |s| s.materials[0].emission_exponent = 2.0),
            ("sides", |s| s.materials[0].two_sided = true),
            ("index of refraction", |s| s.materials[0].ior = 1.6),
            ("reflector", |s| s.materials[0].reflector = Some(true)),
            ("texel", |s| s.textures[0].texels[1][2] = 9),
            ("size of a texture", |s| (s.textures[0].width, s.textures[0].height) = (1, 2)),
            ("curve of a texture", |s| s.textures[0].srgb = false),
            ("wrap", |s| s.textures[0].wrap[1] = Wrap::Clamp),
            ("light", |s| s.lights[0] = Light::Point { position: Vec3::ONE, intensity: Vec3::new(1.0, 1.0, 1.5) }),
            ("kind of emitters", |s| s.emitters_are_lights = false),
            ("images with depth", |s| {
                let images = DepthImages::new([8, 8], 1, Vec::new(), vec![[1.0; 4]]);
                s.mirror_images = Some(std::sync::Arc::new(images));
            }),
        ];
        assert_eq!(base, fingerprint(&scene(), &camera(), &Settings::plain()));
        for (what, change) in changes {
            let mut changed = scene();
            change(&mut changed);
            assert_ne!(base, fingerprint(&changed, &camera(), &Settings::plain()), "{what}");
        }
    }

    #[test]
    fn every_part_of_camera_and_settings_counts_but_how_rays_go_on() {
        let of = |camera: Camera, settings: Settings| fingerprint(&scene(), &camera, &settings);
        let (view, usual) = (camera(), Settings::default);
        let base = of(view, usual());
        assert_eq!(base, of(view, Settings { rounds: 9, moving_passes: 7, ..usual() }));
        assert_eq!(base, of(view, Settings { traversal: Traversal::Single, ..usual() }), "a measurement chooses it");
        for changed in [
            Camera { eye: Vec3::X, ..view },
            Camera { target: Vec3::new(0.1, 0.0, 1.0), ..view },
            Camera { up: Vec3::X, ..view },
            Camera { fov_y: 41.0, ..view },
            Camera { resolution: [3, 4], ..view },
            Camera { aperture: 0.1, ..view },
            Camera { focus: Some(2.0), ..view },
            Camera { shutter: 0.1, ..view },
        ] {
            assert_ne!(base, of(changed, usual()), "{changed:?}");
        }
        for changed in [
            Settings { seed: 1, ..usual() },
            Settings { particles: 31, ..usual() },
            Settings { max_depth: 4, ..usual() },
            Settings { clip: Clip::Distance(0.1), ..usual() },
            Settings { compensation: Compensation::Off, ..usual() },
            Settings { sequence: Sequence::Sobol, ..usual() },
            Settings { jitter: true, ..usual() },
            Settings { pattern: [2, 1], ..usual() },
            Settings { lights_per_dispatch: 7, ..usual() },
        ] {
            assert_ne!(base, of(view, changed.clone()), "{changed:?}");
        }
    }
}
