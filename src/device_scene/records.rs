//! Conversion of parts of a scene into device records.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::ReflectorFinish;
use crate::accel::Bvh;
use crate::bsdf::anisotropic::pack;
use crate::bsdf::ideal::frost;
use crate::bsdf::{MIN_ALPHA, Reflectance, table};
use crate::light::cosine;
use crate::light::emitters::Emitters;
use crate::pass::layout::{MaterialRecord, PointLight};
use crate::plan::MAX_FOLLOWED_ALPHA;
use crate::scene::reflectors::Reflector;
use crate::scene::{Alpha, Environment, Light, Material, Scene, Surface};
use crate::superposition::lobe::Lobe;

/// The record of the material with this index.
pub(super) fn material_record(index: u32, m: &Material) -> MaterialRecord {
    let with = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
    let (opacity, cutoff) = match m.alpha {
        Alpha::Mask { opacity, cutoff } if m.has_alpha() => (opacity, cutoff),
        Alpha::Blend { opacity } if m.has_alpha() => (opacity, -1.0),
        _ => (1.0, -1.0),
    };
    MaterialRecord {
        base: with(m.base_color, m.metallic),
        specular: with(m.specular, m.roughness),
        emission: with(m.emission, m.ior),
        flags: [
            m.base_texture.map_or(0, |t| t + 1),
            m.metallic_roughness_texture.map_or(0, |t| t + 1),
            match m.surface {
                Surface::Opaque => MaterialRecord::OPAQUE,
                Surface::Mirror => MaterialRecord::MIRROR,
                Surface::Glass if m.thin => MaterialRecord::PANE,
                Surface::Glass => MaterialRecord::GLASS,
            },
            (if m.two_sided { MaterialRecord::TWO_SIDED } else { 0 })
                | (if is_shiny(m) { MaterialRecord::SHINY } else { 0 })
                | (if m.has_alpha() { MaterialRecord::ALPHA } else { 0 })
                | (0..4).filter(|&k| m.second_uvs[k]).map(|k| MaterialRecord::SECOND_UVS << k).sum::<u32>()
                | m.emission_texture.map_or(0, |t| t + 1) << MaterialRecord::EMISSION_SHIFT,
        ],
        normal: [m.normal_texture.map_or(0, |t| t + 1), m.normal_scale.to_bits(), opacity.to_bits(), cutoff.to_bits()],
        lobes: [
            m.emission_exponent,
            cosine::flatness(m.emission_exponent),
            match (&m.lobe, m.phong_exponent) {
                (Some(table), _) => table::number(index, table),
                (None, Some(exponent)) => -exponent,
                (None, None) if m.is_anisotropic() => m.anisotropy * m.anisotropy,
                (None, None) => 0.0,
            },
            // A grain has no sense: half a turn is none. Within it sines of devices are exact enough.
            m.anisotropy_rotation % std::f32::consts::PI,
        ],
    }
}

/// Whether it has a specular lobe, at least at some texel.
pub(super) fn has_lobe(m: &Material) -> bool {
    let whole = Reflectance::new(m.base_color, m.metallic, m.roughness, m.specular);
    m.surface == Surface::Opaque && (m.metallic > 0.0 || whole.f90 > 0.0)
}

/// Whether a texture changes the width of its lobe.
fn has_roughness_texture(m: &Material) -> bool {
    m.metallic_roughness_texture.is_some() && m.lobe.is_none()
}

/// Whether it has a lobe with a greater alpha than this, at least at some texel.
pub(super) fn has_wide_lobe(m: &Material, alpha: f32) -> bool {
    has_lobe(m) && (has_roughness_texture(m) || m.lobe_width().max(MIN_ALPHA) > alpha)
}

/// Whether eye paths may follow its lobe: it is narrow enough, at least at some texel.
pub(crate) fn is_shiny(m: &Material) -> bool {
    has_lobe(m) && (has_roughness_texture(m) || m.lobe_width() <= MAX_FOLLOWED_ALPHA)
}

/// Octahedral encoding of a unit vector, 2 x 16 bit (Meyer et al. 2010).
pub fn encode_normal(n: Vec3) -> u32 {
    let p = n / (n.x.abs() + n.y.abs() + n.z.abs()).max(1e-20);
    let sign = |x: f32| if x >= 0.0 { 1.0 } else { -1.0 };
    let e = if p.z >= 0.0 {
        Vec2::new(p.x, p.y)
    } else {
        Vec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y))
    };
    let snorm = |x: f32| (x.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16;
    u32::from(snorm(e.x)) | u32::from(snorm(e.y)) << 16
}

/// Finishes of reflectors, with mean texture values; for frosted panes only the lobe.
pub(super) fn finishes(scene: &Scene, reflectors: &[Reflector]) -> Vec<ReflectorFinish> {
    let mean = |texture: Option<u32>| texture.map_or(Vec3::ONE, |t| scene.textures[t as usize].average());
    let finish = |reflector: &Reflector| {
        let m = &scene.materials[reflector.material as usize];
        if let Some(alpha) = frost(m) {
            // The transmittance of a pane is applied where it is seen.
            let reflectance = Reflectance { kd: Vec3::ZERO, f0: Vec3::ZERO, f90: 0.0, alpha };
            return ReflectorFinish { reflectance, lobe: m.lobe.clone().map_or(Lobe::Ggx { alpha }, Lobe::Table) };
        }
        let (base, mr) = (mean(m.base_texture), mean(m.metallic_roughness_texture));
        let reflectance = Reflectance::new(m.base_color * base, m.metallic * mr.z, m.roughness * mr.y, m.specular);
        let lobe = match (&m.lobe, m.phong_exponent) {
            (Some(table), _) => Lobe::Table(table.clone()),
            (None, Some(exponent)) => Lobe::Cosine { exponent },
            (None, None) if m.is_anisotropic() => {
                let alphas = Vec2::new(m.alpha_along(reflectance.alpha), reflectance.alpha);
                Lobe::Anisotropic { alpha: pack(alphas, Vec3::X, Vec3::Z) }
            }
            (None, None) => Lobe::Ggx { alpha: reflectance.alpha },
        };
        ReflectorFinish { reflectance, lobe }
    };
    reflectors.iter().map(finish).collect()
}

/// Bit of the last word of a triangle's normals: its reflector is curved. Shader twin: `shaders/include/surface.wgsl`.
const CURVED: u32 = 1 << 23;

/// For each triangle the bits that state its reflector in the last word of its normals: the number from bit 24 on, 0: none, and
/// [`CURVED`]; empty if there are no reflectors.
pub(super) fn reflector_bits(scene: &Scene, reflectors: &[Reflector]) -> Vec<u32> {
    let mut bits = vec![0; if reflectors.is_empty() { 0 } else { scene.triangles.len() }];
    for (number, reflector) in (1..=u32::from(u8::MAX)).zip(reflectors) {
        let word = number << 24 | if reflector.curved { CURVED } else { 0 };
        reflector.triangles.iter().for_each(|&i| bits[i as usize] = word);
    }
    bits
}

/// Whether surfaces need texture coordinates: there are textures, since edits may give one to any material, or vertex colours, or the grain
/// of a lobe follows them.
pub(super) fn has_patterns(scene: &Scene) -> bool {
    let follows = !scene.uvs.is_empty() && scene.materials.iter().any(Material::is_anisotropic);
    follows || !(scene.textures.is_empty() && scene.colors.is_empty())
}

/// Colours of the vertices of triangles, in the scene's order: three words of 10 bits for each channel's square root.
pub(super) fn vertex_colors(scene: &Scene) -> Vec<[u32; 4]> {
    let channel = |c: f32| (c.clamp(0.0, 1.0).sqrt() * 1023.0).round() as u32;
    let word = |c: Vec3| channel(c.x) | channel(c.y) << 10 | channel(c.z) << 20;
    let of = |t: &crate::scene::Triangle| {
        let [a, b, c] = t.vertices.map(|v| word(scene.colors[v as usize]));
        [a, b, c, 0]
    };
    if scene.colors.is_empty() { Vec::new() } else { scene.triangles.iter().map(of).collect() }
}

/// Second texture coordinates of triangles, in the scene's order; two vec4 each.
pub(super) fn second_coordinates(scene: &Scene) -> Vec<[f32; 4]> {
    let of = |t: &crate::scene::Triangle| {
        let [a, b, c] = t.vertices.map(|v| scene.second_uvs[v as usize]);
        [[a.x, a.y, b.x, b.y], [c.x, c.y, 0.0, 0.0]]
    };
    if scene.second_uvs.is_empty() { Vec::new() } else { scene.triangles.iter().flat_map(of).collect() }
}

/// Normals and texture coordinates of triangles in leaf order; the latter only if the scene [`has_patterns`]. After the normals of
/// all triangles come their [`vertex_colors`], after the coordinates [`second_coordinates`]; the coordinates hold the places of a
/// triangle's, 0 if there are none.
pub(super) fn shading_attributes(
    scene: &Scene,
    bvh: &Bvh,
    reflectors: &[u32],
    range: Range<usize>,
) -> (Vec<[u32; 4]>, Vec<[f32; 4]>) {
    let textured = has_patterns(scene);
    let colored = if scene.colors.is_empty() { 0 } else { scene.triangles.len() };
    let mut normals = Vec::with_capacity(range.len());
    let mut uvs = Vec::new();
    for i in range {
        let index = bvh.scene_triangle(i as u32) as usize;
        let t = &scene.triangles[index];
        let mut n = [0; 4];
        if t.smooth {
            for (n, &v) in n.iter_mut().zip(&t.vertices) {
                *n = encode_normal(scene.normals[v as usize]);
            }
        }
        let reflector = reflectors.get(index).copied().unwrap_or(0);
        n[3] = reflector | t.material << 1 | u32::from(t.smooth);
        normals.push(n);
        if textured {
            let [a, b, c] = t.vertices.map(|v| scene.uvs.get(v as usize).copied().unwrap_or(Vec2::ZERO));
            uvs.push([a.x, a.y, b.x, b.y]);
            let colors = if colored > 0 { (colored + index) as u32 } else { 0 };
            let second = if scene.second_uvs.is_empty() { 0 } else { 2 * (scene.triangles.len() + index) as u32 };
            uvs.push([c.x, c.y, f32::from_bits(colors), f32::from_bits(second)]);
        }
    }
    (normals, uvs)
}

/// The lights without area, which every pass uses exactly once, or chooses from: point, spot and parallel lights, and
/// imported virtual lights.
pub fn delta_lights(scene: &Scene, coordinate_scale: f32) -> Vec<PointLight> {
    let with = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
    let flags = f32::from_bits;
    let directed = |exponent: f32| if exponent == 1.0 { 0 } else { PointLight::DIRECTED };
    scene
        .lights
        .iter()
        .filter_map(|light| match *light {
            Light::Point { position, intensity } => Some(PointLight {
                position: with(position, flags(0)),
                normal: with(Vec3::Z, 0.0),
                emit: with(intensity, 1.0),
                ..PointLight::default()
            }),
            Light::Spot { position, direction, intensity, inner, outer } => {
                // KHR_lights_punctual: clamp((cos - cos outer) / (cos inner - cos outer))^2.
                let scale = 1.0 / (inner.cos() - outer.cos()).max(1e-6);
                Some(PointLight {
                    position: with(position, flags(0)),
                    normal: with(direction, scale),
                    emit: with(intensity, -outer.cos() * scale),
                    ..PointLight::default()
                })
            }
            Light::Directional { direction, irradiance } => Some(PointLight {
                position: with(Vec3::ZERO, flags(PointLight::DIRECTIONAL)),
                normal: with(direction, 0.0),
                emit: with(irradiance, 1.0),
                ..PointLight::default()
            }),
            Light::Imported { position, normal, power, exponent } => Some(PointLight {
                position: with(
                    crate::accel::offset_origin(position, normal, coordinate_scale),
                    flags(PointLight::SURFACE | PointLight::CLIPPED | directed(exponent)),
                ),
                normal: with(normal, exponent - 1.0),
                emit: with(power * (std::f32::consts::FRAC_1_PI * cosine::sharpness(exponent)), 1.0),
                ..PointLight::default()
            }),
            Light::Sphere { .. } => None,
        })
        .collect()
}

/// The environment of a scene, or a black one: its axes, w of the first two the bits of its size; then the radiance of each texel and
/// the density of lights in its direction, by power.
pub(super) fn environment_record(scene: &Scene, emitters: &Emitters) -> Vec<[f32; 4]> {
    let black = Environment::constant(Vec3::ZERO);
    let environment = scene.environment.as_deref().unwrap_or(&black);
    let sizes = [environment.width, environment.height, 0].map(f32::from_bits);
    let axes = environment.axes.into_iter().zip(sizes).map(|(axis, size)| axis.extend(size));
    let density = |texel: usize| match &emitters.environment {
        Some(surroundings) => emitters.density_of(surroundings.of_texel[texel]),
        None => 0.0,
    };
    let texels = environment.texels.iter().enumerate().map(|(i, texel)| texel.extend(density(i)));
    axes.chain(texels).map(|v| v.to_array()).collect()
}
