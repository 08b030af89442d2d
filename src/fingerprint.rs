//! Hash of scene, camera and settings, so that a state is resumed only by the rendering that it belongs to.

use crate::scene::{Camera, Scene};
use crate::settings::Settings;

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

/// Fingerprint of everything that affects any bit of the image. `rounds` (how often rays may be resumed) and the passes of an
/// animation's frames do not, and are excluded. The partition into dispatches does: it decides which rays of a difficult scene
/// clusters leave to single rays.
pub fn fingerprint(scene: &Scene, camera: &Camera, settings: &Settings) -> u64 {
    let mut hash = Fnv::default();
    hash.add(bytemuck::cast_slice(&scene.positions));
    hash.add(bytemuck::cast_slice(&scene.normals));
    hash.add(bytemuck::cast_slice(&scene.uvs));
    for t in &scene.triangles {
        hash.add(bytemuck::cast_slice(&t.vertices));
        hash.add(&[t.material.to_le_bytes(), t.object.to_le_bytes()].concat());
        hash.add(&[u8::from(t.smooth)]);
    }
    for texture in &scene.textures {
        hash.add(bytemuck::cast_slice(&texture.texels));
        hash.add(format!("{} {} {} {:?}", texture.width, texture.height, texture.srgb, texture.wrap).as_bytes());
    }
    // Debug prints floats in their shortest exact form.
    let settings = Settings { rounds: 1, moving_passes: 1, ..settings.clone() };
    let words =
        format!("{:?} {:?} {:?} {:?} {}", scene.materials, scene.lights, camera, settings, scene.emitters_are_lights);
    hash.add(words.as_bytes());
    hash.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_counts() {
        let mut scene = Scene::default();
        scene.positions.push(glam::Vec3::X);
        let camera = Camera {
            eye: glam::Vec3::ZERO,
            target: glam::Vec3::Z,
            up: glam::Vec3::Y,
            fov_y: 40.0,
            resolution: [4, 3],
            aperture: 0.0,
            focus: None,
        };
        let settings = Settings::default();
        let base = fingerprint(&scene, &camera, &settings);
        assert_eq!(base, fingerprint(&scene.clone(), &camera, &settings));
        let cut = Settings { rounds: 9, ..settings.clone() };
        assert_eq!(base, fingerprint(&scene, &camera, &cut));
        assert_ne!(base, fingerprint(&scene, &camera, &Settings { seed: 1, ..settings.clone() }));
        assert_ne!(base, fingerprint(&scene, &Camera { resolution: [3, 4], ..camera }, &settings));
        assert_ne!(base, fingerprint(&scene, &Camera { aperture: 0.1, ..camera }, &settings));
        scene.positions[0].y = 1e-30;
        assert_ne!(base, fingerprint(&scene, &camera, &settings));
    }
}
