//! A gallery of everything that stages must handle.

use std::path::Path;
use std::sync::Arc;

use crate::device_scene::encode_normal;
use crate::scene::{Alpha, Camera, Environment, Light, Material, Scene, Surface, Texture, TextureUse, Triangle, Wrap};
use glam::{Vec2, Vec3};

use super::lobe_tables;

/// Unit vector of an octahedral code of 2 x 16 bit (Meyer et al. 2010).
fn decode_normal(code: u32) -> Vec3 {
    let snorm = |x: u32| f32::from(x as u16 as i16) / 32767.0;
    let (x, y) = (snorm(code), snorm(code >> 16));
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize()
}

/// Builds scenes.
#[derive(Default)]
pub struct Builder(pub Scene);

impl Builder {
    pub fn material(&mut self, material: Material) -> u32 {
        self.0.materials.push(material);
        self.0.materials.len() as u32 - 1
    }

    pub fn object(&mut self) -> u32 {
        self.0.objects.push(format!("object {}", self.0.objects.len()));
        self.0.objects.len() as u32 - 1
    }

    fn face(&mut self, corners: [(Vec3, Vec3, Vec2); 3], material: u32, object: u32, smooth: bool) {
        let first = self.0.positions.len() as u32;
        for (position, normal, uv) in corners {
            self.0.positions.push(position);
            // Normals that their codes represent exactly, so that only the arithmetic is compared.
            let stored = decode_normal(encode_normal(normal.normalize()));
            assert!((stored - normal.normalize()).length() < 1e-4, "{normal} is stored as {stored}");
            self.0.normals.push(stored);
            self.0.uvs.push(uv);
        }
        self.0.triangles.push(Triangle { vertices: [first, first + 1, first + 2], material, object, smooth });
    }

    pub fn triangle(&mut self, [a, b, c]: [Vec3; 3], material: u32) {
        let object = self.object();
        let n = (b - a).cross(c - a);
        self.face([(a, n, Vec2::ZERO), (b, n, Vec2::X), (c, n, Vec2::Y)], material, object, false);
    }

    /// A parallelogram with texture coordinates from -`uv` to 2 `uv`, seen from the side of cross(u, v).
    pub fn quad(&mut self, corner: Vec3, u: Vec3, v: Vec3, material: u32, uv: f32) {
        let object = self.object();
        let n = u.cross(v);
        let point = |s: f32, t: f32| (corner + u * s + v * t, n, Vec2::new((3.0 * s - 1.0) * uv, (3.0 * t - 1.0) * uv));
        self.face([point(0.0, 0.0), point(1.0, 0.0), point(1.0, 1.0)], material, object, false);
        self.face([point(0.0, 0.0), point(1.0, 1.0), point(0.0, 1.0)], material, object, false);
    }

    /// A sphere of 8 * 4^levels smooth triangles; returns its object.
    pub fn sphere(&mut self, center: Vec3, radius: f32, levels: u32, material: u32, inward: bool) -> u32 {
        let object = self.object();
        for octant in 0..8 {
            let sign = |bit: u32| if octant >> bit & 1 == 0 { 1.0 } else { -1.0 };
            let mut faces = vec![[Vec3::X * sign(0), Vec3::Y * sign(1), Vec3::Z * sign(2)]];
            for _ in 0..levels {
                faces = (faces.iter())
                    .flat_map(|&[a, b, c]| {
                        let (ab, bc, ca) = ((a + b).normalize(), (b + c).normalize(), (c + a).normalize());
                        [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
                    })
                    .collect();
            }
            for [a, mut b, mut c] in faces {
                if ((b - a).cross(c - a).dot(a) < 0.0) != inward {
                    std::mem::swap(&mut b, &mut c);
                }
                let corner = |n: Vec3| (center + n * radius, if inward { -n } else { n }, Vec2::new(n.x, n.y));
                self.face([corner(a), corner(b), corner(c)], material, object, true);
            }
        }
        object
    }

    pub fn texture(&mut self, srgb: bool, wrap: [Wrap; 2]) -> u32 {
        let (width, height) = (4, 3);
        let texels = (0..width * height).map(|i| [40 + 17 * i as u8, 250 - 15 * i as u8, 90 + 60 * (i as u8 % 3), 255]);
        let name = format!("texture {}", self.0.textures.len());
        self.0.textures.push(Texture { name, width, height, texels: texels.collect(), srgb, wrap });
        self.0.textures.len() as u32 - 1
    }

    pub fn finish(mut self, eye: Vec3, target: Vec3) -> Scene {
        let (up, resolution) = (Vec3::Y, [8, 8]);
        self.0.camera = Some(Camera {
            eye,
            target,
            up,
            fov_y: 75.0,
            resolution,
            aperture: 0.0,
            focus: None,
            shutter: 0.0,
            height: None,
            frustum: None,
        });
        self.0.validate(Path::new("test scene")).unwrap();
        self.0
    }
}

/// The scene from an orthographic camera at the place of its own.
pub fn orthographic(scene: Scene) -> Scene {
    Scene { camera: scene.camera.map(|camera| Camera { height: Some(3.4), ..camera }), ..scene }
}

/// Lights of every kind that a scene lists besides its emissive faces.
fn listed_lights(b: &mut Builder, glow: u32) {
    let object = b.sphere(Vec3::new(-1.2, 0.5, 1.0), 0.25, 1, glow, false);
    let center = Vec3::new(-1.2, 0.5, 1.0);
    let radiance = Vec3::new(2.0, 1.0, 0.5);
    b.0.lights.push(Light::Sphere { center, radius: 0.25, radiance, inward: false, object });
    b.0.lights.push(Light::Point { position: Vec3::new(0.4, 1.1, -0.6), intensity: Vec3::new(0.3, 0.5, 0.2) });
    b.0.lights.push(Light::Spot {
        position: Vec3::new(1.2, 1.8, 0.2),
        direction: Vec3::new(-0.3, -1.0, 0.2).normalize(),
        intensity: Vec3::new(1.5, 1.2, 1.0),
        inner: 0.3,
        outer: 0.8,
    });
    b.0.lights.push(Light::Directional {
        direction: Vec3::new(0.2, -0.6, 1.0).normalize(),
        irradiance: Vec3::new(0.2, 0.3, 0.4),
    });
    b.0.lights.push(Light::Imported {
        position: Vec3::new(-1.9, 0.3, -0.5),
        normal: Vec3::X,
        power: Vec3::new(0.8, 0.3, 0.1),
        exponent: 2.5,
    });
    // A closed glowing sphere behind the room: only particles that start in it see it.
    let center = Vec3::new(9.0, 0.0, 0.0);
    let object = b.sphere(center, 0.5, 1, glow, true);
    b.0.lights.push(Light::Sphere { center, radius: 0.5, radiance: Vec3::splat(0.3), inward: true, object });
}

/// Light from all around for a gallery: a sky with a sun, a darker ground, and black towards +x.
pub fn surroundings() -> Environment {
    let texel = |i: u32| match (i % 16, i / 16) {
        (5, 2) => Vec3::new(80.0, 70.0, 60.0),
        (11..14, _) => Vec3::ZERO,
        (x, y @ 0..4) => Vec3::new(0.2 + 0.02 * x as f32, 0.5, 0.3 + 0.1 * y as f32),
        _ => Vec3::splat(0.1),
    };
    let texels = (0..128).map(texel).collect();
    Environment { width: 16, height: 8, texels, ..Environment::constant(Vec3::ONE) }
        .turned(Vec3::new(0.1, 1.0, -0.2), 0.4)
}

/// The gallery under [`surroundings`].
pub fn gallery_outdoors() -> Scene {
    Scene { environment: Some(Arc::new(surroundings())), ..gallery() }
}

/// A room four units wide, open at the camera and in a corner, with every kind of material, texture and light.
pub fn gallery() -> Scene {
    gallery_and(|_| ())
}

/// The gallery with lobes from tables, narrow and back towards the light.
pub fn gallery_with_tables() -> Scene {
    gallery_and(|b| {
        let enamel = b.material(Material {
            base_color: Vec3::new(0.4, 0.5, 0.6),
            specular: Vec3::new(0.3, 0.2, 0.1),
            lobe: Some(lobe_tables::narrow()),
            ..Material::default()
        });
        let velvet = b.material(Material {
            base_color: Vec3::new(0.6, 0.5, 0.7),
            metallic: 0.8,
            lobe: Some(lobe_tables::retro_reflective()),
            ..Material::default()
        });
        b.sphere(Vec3::new(1.4, 0.3, -0.2), 0.3, 2, enamel, false);
        b.quad(Vec3::new(-1.9, 0.02, -0.2), Vec3::Z * 1.6, Vec3::X * 1.1, velvet, 1.0);
    })
}

/// The gallery with few emitters in reach of its surfaces: a parallelogram, a triangle and a sphere.
pub fn gallery_with_few_emitters() -> Scene {
    let emission = Vec3::new(3.0, 2.0, 1.0);
    let mut scene = gallery_and(|b| {
        let lamp = b.material(Material { emission, ..Material::default() });
        // Both face the room.
        b.quad(Vec3::new(-1.8, 1.2, -0.8), Vec3::new(0.9, 0.1, 0.0), Vec3::new(0.2, 0.5, 0.1), lamp, 1.0);
        b.triangle([Vec3::new(1.0, 0.6, -0.9), Vec3::new(1.7, 0.6, -0.7), Vec3::new(1.2, 1.3, -0.8)], lamp);
    });
    for material in scene.materials.iter_mut().filter(|material| material.emission != emission) {
        (material.emission, material.emission_texture) = (Vec3::ZERO, None);
    }
    scene.lights.retain(|light| matches!(light, Light::Sphere { inward: false, .. }));
    scene
}

/// The gallery with surfaces that let rays pass: leaves, a curtain, veils one behind another, and half a mirror.
pub fn gallery_with_alpha() -> Scene {
    gallery_and(|b| {
        let pattern = b.texture(true, [Wrap::Repeat, Wrap::Mirror]);
        for (i, texel) in b.0.textures[pattern as usize].texels.iter_mut().enumerate() {
            texel[3] = [0, 255, 100, 200, 30][i % 5];
        }
        let base_texture = Some(pattern);
        let mask = Alpha::Mask { opacity: 0.9, cutoff: 0.4 };
        let leaf = b.material(Material { base_texture, alpha: mask, ..Material::default() });
        let curtain = Alpha::Blend { opacity: 0.7 };
        let curtain = b.material(Material {
            base_texture,
            alpha: curtain,
            roughness: 0.4,
            specular: Vec3::splat(0.1),
            ..Material::default()
        });
        let veil = b.material(Material { alpha: Alpha::Blend { opacity: 0.3 }, ..Material::default() });
        let half = Alpha::Blend { opacity: 0.5 };
        let half_mirror = b.material(Material {
            surface: Surface::Mirror,
            specular: Vec3::splat(0.8),
            alpha: half,
            ..Material::default()
        });
        let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
        b.quad(Vec3::new(-1.6, 0.2, -0.4), x * 1.3 + z * 0.2, y * 1.2, leaf, 2.3);
        b.quad(Vec3::new(0.3, 0.3, -0.7), x * 1.1, y * 1.1 + z * 0.1, curtain, 1.6);
        for k in 0..3 {
            b.quad(Vec3::new(-0.6, 0.9, -0.9 + 0.2 * k as f32), x * 1.2, y * 0.7, veil, 1.0);
        }
        b.quad(Vec3::new(-0.47, 0.04, -0.31), x * 0.9, y * 0.6, half_mirror, 1.0);
    })
}

fn gallery_and(more: impl FnOnce(&mut Builder)) -> Scene {
    let mut b = Builder::default();
    let plain = Material::default;
    let rgb = Vec3::new;
    let repeat = b.texture(true, [Wrap::Repeat, Wrap::Mirror]);
    let clamp = b.texture(false, [Wrap::Clamp, Wrap::Repeat]);
    let mirrored = b.texture(true, [Wrap::Mirror, Wrap::Clamp]);
    let rough = b.texture(false, [Wrap::Repeat, Wrap::Repeat]);
    let gray = b.material(Material { base_color: rgb(0.7, 0.6, 0.5), ..plain() });
    let tiles = b.material(Material { base_color: rgb(0.9, 0.8, 0.7), base_texture: Some(repeat), ..plain() });
    let bumps = b.texture(false, [Wrap::Repeat, Wrap::Mirror]);
    for (i, texel) in b.0.textures[bumps as usize].texels.iter_mut().enumerate() {
        *texel = [128 + 25 * (i % 3) as u8, 168 - 20 * (i / 3) as u8, 235, 255];
    }
    let second_uvs = |of: TextureUse| [0, 1, 2, 3].map(|k| k == of as usize);
    let cloth = b.material(Material {
        base_texture: Some(clamp),
        normal_texture: Some(bumps),
        normal_scale: 0.8,
        second_uvs: second_uvs(TextureUse::Normal),
        ..plain()
    });
    let paint = b.material(Material {
        base_texture: Some(mirrored),
        specular: Vec3::splat(0.04),
        phong_exponent: Some(9.0),
        ..plain()
    });
    let metal = b.material(Material {
        base_color: rgb(0.9, 0.7, 0.4),
        metallic: 0.9,
        roughness: 0.8,
        metallic_roughness_texture: Some(rough),
        second_uvs: second_uvs(TextureUse::MetallicRoughness),
        specular: Vec3::splat(0.04),
        anisotropy: 0.6,
        ..plain()
    });
    let gloss = b.material(Material {
        specular: rgb(0.2, 0.1, 0.05),
        roughness: 0.3,
        anisotropy: 0.5,
        anisotropy_rotation: 0.7,
        ..plain()
    });
    let mirror = |base_color: Vec3, specular: Vec3| Material {
        surface: Surface::Mirror,
        base_color,
        specular,
        emission: rgb(0.0, 0.02, 0.01),
        two_sided: true,
        ..plain()
    };
    let silver = b.material(mirror(Vec3::ZERO, rgb(0.9, 0.8, 0.7)));
    let varnish = b.material(Material { base_texture: Some(repeat), ..mirror(rgb(0.7, 0.5, 0.3), Vec3::splat(0.2)) });
    let glass = |ior: f32, thin: bool| Material {
        surface: Surface::Glass,
        base_color: rgb(0.8, 0.9, 1.0),
        emission: rgb(0.01, 0.0, 0.02),
        ior,
        thin,
        ..plain()
    };
    let pane = b.material(glass(1.5, true));
    let crystal = b.material(glass(1.7, false));
    let water = b.material(glass(1.33, false));
    let lamp = b.material(Material { emission: rgb(3.0, 2.5, 2.0), base_color: Vec3::ZERO, ..plain() });
    let sheet =
        b.material(Material { emission: rgb(0.8, 1.2, 1.6), emission_exponent: 3.0, two_sided: true, ..plain() });
    // Lights behind stained glass, half of it black.
    let stained = b.texture(true, [Wrap::Repeat, Wrap::Mirror]);
    for (i, texel) in b.0.textures[stained as usize].texels.iter_mut().enumerate() {
        *texel = if i % 2 == 0 { [0, 0, 0, 255] } else { [60 + 19 * (i as u8 % 7), 200, 255 - 20 * i as u8, 255] };
    }
    let window = b.material(Material {
        emission: rgb(3.0, 2.4, 4.0),
        emission_exponent: 3.0,
        emission_texture: Some(stained),
        base_texture: Some(repeat),
        ..plain()
    });
    let banner = b.material(Material {
        emission: rgb(0.5, 0.9, 0.4),
        emission_texture: Some(stained),
        second_uvs: second_uvs(TextureUse::Emission),
        two_sided: true,
        ..plain()
    });
    let glow = b.material(Material { emission: rgb(2.0, 1.0, 0.5), base_color: Vec3::ZERO, ..plain() });

    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    b.quad(rgb(-2.0, 0.0, -2.0), z * 4.0, x * 4.0, tiles, 1.7);
    b.quad(rgb(-2.0, 2.2, -2.0), x * 4.0, z * 4.0, gray, 1.0);
    b.quad(rgb(-2.0, 0.0, 2.0), y * 2.2, x * 4.0, cloth, 0.9);
    // The wall on the left ends before the corner: rays past it hit nothing.
    b.quad(rgb(-2.0, 0.0, -2.0), y * 2.2, z * 2.6, paint, 1.3);
    b.quad(rgb(2.0, 0.0, -2.0), z * 4.0, y * 2.2, metal, 0.8);
    b.sphere(rgb(0.6, 0.5, 0.9), 0.5, 2, gloss, false);
    b.sphere(rgb(-0.3, 0.3, 0.2), 0.3, 2, metal, false);
    b.quad(rgb(-1.5, 0.6, 1.9), y * 0.8, x * 0.8, silver, 1.0);
    b.quad(rgb(-0.6, 1.2, 1.9), y * 0.7, x * 0.9, varnish, 1.0);
    b.quad(rgb(1.0, 0.8, 1.8), y * 0.8, x * 0.5, pane, 1.0);
    // One ball of glass partly inside another.
    b.sphere(rgb(-0.9, 1.4, 0.4), 0.35, 2, water, false);
    b.sphere(rgb(-0.8, 1.45, 0.15), 0.2, 2, crystal, false);
    b.quad(rgb(-0.5, 2.15, -0.5), x, z * 0.8, lamp, 1.0);
    b.triangle([rgb(1.2, 2.1, 1.0), rgb(1.8, 2.1, 1.0), rgb(1.5, 2.1, 1.6)], lamp);
    b.triangle([rgb(-1.0, 2.0, 1.2), rgb(-0.6, 1.7, 1.5), rgb(-1.1, 1.5, 1.4)], sheet);
    b.quad(rgb(1.95, 1.2, -0.2), z, y * 0.7, window, 2.0);
    b.triangle([rgb(0.4, 2.0, -0.4), rgb(0.9, 1.8, -0.2), rgb(0.6, 1.5, -0.3)], banner);
    listed_lights(&mut b, glow);
    more(&mut b);
    // Codes of colours are exact for these.
    let color = |i: usize| Vec3::from_array([i % 3, i % 5, i % 7].map(|k| ((1023 - 60 * k) as f32 / 1023.0).powi(2)));
    b.0.second_uvs = b.0.uvs.iter().map(|uv| Vec2::new(0.3 - uv.y, 1.7 * uv.x + 0.1)).collect();
    b.0.colors = (0..b.0.positions.len()).map(color).collect();
    b.finish(rgb(0.1, 1.2, -2.6), rgb(0.0, 0.9, 1.0))
}
