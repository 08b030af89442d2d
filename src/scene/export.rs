//! Writing a scene with its virtual lights as glTF, for other renderers and for reading back.

use std::collections::BTreeMap;
use std::f32::consts::FRAC_PI_2;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use glam::{DVec3, Mat4, Quat, Vec3};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{Alpha, Camera, Light, Material, Scene, Surface, Texture, TextureUse, Wrap};
use crate::error::{Error, Result};
use crate::light::cosine::exitance;
use crate::output::FileSet;

/// A virtual light on a surface: emission to one side of total flux `power`, by a power of the cosine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VirtualLight {
    /// Position.
    pub position: Vec3,
    /// Unit normal of the side that emits.
    pub normal: Vec3,
    /// Flux, W.
    pub power: Vec3,
    /// Exponent of the cosine, at least 1.
    pub exponent: f32,
}

/// `asset.extras.lightsum`.
#[derive(Serialize, Deserialize)]
pub(super) struct AssetExtras {
    /// The lights of the file include the light of its emissive surfaces.
    pub(super) lights_exported: bool,
}

/// `camera.extras.lightsum`: properties that glTF's cameras do not have.
#[derive(Serialize, Deserialize)]
pub(super) struct CameraExtras {
    /// Relative to `origin`.
    pub(super) camera: Camera,
    /// World coordinates of the scene's origin.
    #[serde(default)]
    pub(super) origin: DVec3,
}

/// `node.extras.lightsum` of a virtual light; its position is the node's.
#[derive(Serialize, Deserialize)]
pub(super) struct VirtualExtras {
    #[serde(rename = "virtual")]
    pub(super) is_virtual: bool,
    pub(super) power: Vec3,
    pub(super) normal: Vec3,
    #[serde(default = "lambert")]
    pub(super) exponent: f32,
}

/// The exponent of lights in files without one.
fn lambert() -> f32 {
    1.0
}

/// Of a number that files without it have.
fn is_zero(x: &f32) -> bool {
    *x == 0.0
}

/// `material.extras.lightsum`: properties that glTF's materials do not have, or only rounded.
#[derive(Serialize, Deserialize)]
pub(super) struct MaterialExtras {
    surface: Surface,
    base_color: Vec3,
    metallic: f32,
    roughness: f32,
    specular: Vec3,
    emission: Vec3,
    #[serde(default = "lambert")]
    emission_exponent: f32,
    two_sided: bool,
    ior: f32,
    #[serde(default)]
    thin: bool,
    #[serde(default)]
    frost: f32,
    #[serde(default)]
    reflector: Option<bool>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    phong_exponent: Option<f32>,
    #[serde(default, skip_serializing_if = "is_zero")]
    anisotropy: f32,
    #[serde(default, skip_serializing_if = "is_zero")]
    anisotropy_rotation: f32,
}

impl MaterialExtras {
    fn of(m: &Material) -> Self {
        MaterialExtras {
            surface: m.surface,
            base_color: m.base_color,
            metallic: m.metallic,
            roughness: m.roughness,
            specular: m.specular,
            emission: m.emission,
            emission_exponent: m.emission_exponent,
            two_sided: m.two_sided,
            ior: m.ior,
            thin: m.thin,
            frost: m.frost,
            reflector: m.reflector,
            phong_exponent: m.phong_exponent,
            anisotropy: m.anisotropy,
            anisotropy_rotation: m.anisotropy_rotation,
        }
    }

    /// Restores the exact values of a material read from glTF.
    pub(super) fn apply(self, m: &mut Material) {
        m.surface = self.surface;
        m.base_color = self.base_color;
        m.metallic = self.metallic;
        m.roughness = self.roughness;
        m.specular = self.specular;
        m.emission = self.emission;
        m.emission_exponent = self.emission_exponent;
        m.two_sided = self.two_sided;
        m.ior = self.ior;
        m.thin = self.thin;
        m.frost = self.frost;
        m.reflector = self.reflector;
        m.phong_exponent = self.phong_exponent;
        m.anisotropy = self.anisotropy;
        m.anisotropy_rotation = self.anisotropy_rotation;
    }
}

/// `asset.generator`.
pub(crate) const GENERATOR: &str = concat!("lightsum ", env!("CARGO_PKG_VERSION"));

/// Writes `path` (`.gltf`), its buffer (`.bin`) and its textures (`.png`) beside it, all or none: geometry, materials, camera and lights.
/// Coordinates in the file are those of the world: a node holds [`Scene::origin`], if it is not zero.
///
/// `lights` represent the emissive surfaces, sphere lights and reflections; the scene's own point, spot, directional
/// and virtual lights are written as well. KHR_lights_punctual has no light with a cosine lobe, so each virtual light is a
/// spot over the hemisphere with the intensity along its normal, for a cosine lobe power / pi (W/sr); `extras.lightsum` has the exact light, which
/// reading the file restores. Emissive surfaces stay visible, but do not light the scene a second time when the file is read.
///
/// Errors: [`Error::File`] if the name does not end in `.gltf`; [`Error::Io`] if a file cannot be written.
pub fn export_lights(path: &Path, scene: &Scene, lights: &[VirtualLight]) -> Result<()> {
    if super::extension(path) != "gltf" {
        return Err(Error::file(path, "lights are written as glTF; let the name end in .gltf"));
    }
    let bin_path = path.with_extension("bin");
    let mut document = Writer::default();
    document.meshes(scene);
    document.camera(scene);
    document.lights(scene, lights);
    let images: Vec<PathBuf> = (0..scene.textures.len()).map(|i| texture_path(path, i)).collect();
    let mut files = FileSet::default();
    for (texture, file) in scene.textures.iter().zip(&images) {
        files.add(file, &[&png(texture).map_err(|why| Error::file(file, why))?])?;
    }
    files.add(&bin_path, &[&document.bin])?;
    let json = document.json(scene, &bin_path, &images);
    let text = serde_json::to_vec_pretty(&json).map_err(|e| Error::file(path, e.to_string()))?;
    files.add(path, &[&text])?;
    files.commit()
}

/// The files that [`export_lights`] writes for a scene.
pub fn exported_files(path: &Path, scene: &Scene) -> Vec<PathBuf> {
    let images = (0..scene.textures.len()).map(|i| texture_path(path, i));
    images.chain([path.with_extension("bin"), path.to_path_buf()]).collect()
}

fn texture_path(path: &Path, index: usize) -> PathBuf {
    path.with_file_name(format!("{}-{index}.png", super::stem(path)))
}

pub(crate) fn png(texture: &Texture) -> Result<Vec<u8>, String> {
    let raw = texture.texels.iter().flatten().copied().collect();
    let image = image::RgbaImage::from_raw(texture.width, texture.height, raw).ok_or("size and texels differ")?;
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).map_err(|e| e.to_string())?;
    Ok(bytes.into_inner())
}

/// File name as a relative URI.
pub(crate) fn uri(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut uri = String::new();
    for byte in name.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            uri.push(char::from(byte));
        } else {
            // Writing to a string cannot fail.
            let _ = write!(uri, "%{byte:02X}");
        }
    }
    uri
}

/// The shortest decimal representation of the same single-precision number.
pub(crate) fn number(x: f32) -> Value {
    format!("{x}").parse::<f64>().map_or(Value::Null, Value::from)
}

pub(crate) fn vector<const N: usize>(v: [f32; N]) -> Value {
    v.iter().map(|&x| number(x)).collect()
}

/// Serialises through text, in which single-precision numbers take their shortest form.
pub(crate) fn extras<T: Serialize>(ours: T) -> Value {
    let text = serde_json::to_string(&ours).unwrap_or_default();
    json!({ "lightsum": serde_json::from_str::<Value>(&text).unwrap_or_default() })
}

/// Faces of one object by material and kind of shading.
type Primitives = BTreeMap<(u32, bool), Vec<[u32; 3]>>;

/// A document under construction.
#[derive(Default)]
pub(crate) struct Writer {
    pub(crate) bin: Vec<u8>,
    pub(crate) views: Vec<Value>,
    pub(crate) accessors: Vec<Value>,
    pub(crate) meshes: Vec<Value>,
    pub(crate) nodes: Vec<Value>,
    pub(crate) cameras: Vec<Value>,
    pub(crate) lights: Vec<Value>,
}

impl Writer {
    /// Adds an accessor with its own view and returns its index.
    pub(crate) fn accessor(
        &mut self,
        components: impl Iterator<Item = [u8; 4]>,
        count: usize,
        mut accessor: Value,
    ) -> usize {
        let offset = self.bin.len();
        self.bin.extend(components.flatten());
        self.views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": self.bin.len() - offset }));
        accessor["bufferView"] = json!(self.views.len() - 1);
        accessor["count"] = json!(count);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// One mesh and node for each object, one primitive for each of its materials and kinds of shading.
    fn meshes(&mut self, scene: &Scene) {
        let mut groups: BTreeMap<u32, Primitives> = BTreeMap::new();
        for t in &scene.triangles {
            groups.entry(t.object).or_default().entry((t.material, t.smooth)).or_default().push(t.vertices);
        }
        for (object, primitives) in groups {
            let primitives: Vec<Value> = primitives
                .iter()
                .map(|(&(material, smooth), faces)| self.primitive(scene, material, smooth, faces))
                .collect();
            let name = &scene.objects[object as usize];
            self.meshes.push(json!({ "name": name, "primitives": primitives }));
            self.nodes.push(json!({ "name": name, "mesh": self.meshes.len() - 1 }));
        }
    }

    fn primitive(&mut self, scene: &Scene, material: u32, smooth: bool, faces: &[[u32; 3]]) -> Value {
        let mut used: Vec<u32> = faces.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        let local = |v: &u32| used.binary_search(v).unwrap_or_default() as u32;
        let indices = faces.iter().flatten().map(|v| local(v).to_le_bytes());
        let indices = self.accessor(indices, faces.len() * 3, json!({ "componentType": 5125, "type": "SCALAR" }));
        let at = |v: &u32| scene.positions[*v as usize];
        let low = used.iter().map(at).fold(Vec3::INFINITY, Vec3::min);
        let high = used.iter().map(at).fold(Vec3::NEG_INFINITY, Vec3::max);
        let shape = json!({ "componentType": 5126, "type": "VEC3", "min": vector(low.to_array()), "max": vector(high.to_array()) });
        let positions = used.iter().flat_map(|v| at(v).to_array()).map(f32::to_le_bytes);
        let mut attributes = json!({ "POSITION": self.accessor(positions, used.len(), shape) });
        if smooth {
            let normals = used.iter().flat_map(|v| scene.normals[*v as usize].to_array()).map(f32::to_le_bytes);
            let shape = json!({ "componentType": 5126, "type": "VEC3" });
            attributes["NORMAL"] = json!(self.accessor(normals, used.len(), shape));
        }
        let m = &scene.materials[material as usize];
        let sets = [("TEXCOORD_0", &scene.uvs), ("TEXCOORD_1", &scene.second_uvs)];
        let wanted = [m.textures().next().is_some() || m.is_anisotropic(), m.second_uvs.contains(&true)];
        for ((name, set), _) in sets.into_iter().zip(wanted).filter(|(_, wanted)| *wanted) {
            let uvs = used.iter().flat_map(|v| set[*v as usize].to_array()).map(f32::to_le_bytes);
            let shape = json!({ "componentType": 5126, "type": "VEC2" });
            attributes[name] = json!(self.accessor(uvs, used.len(), shape));
        }
        if !scene.colors.is_empty() {
            let colors = used.iter().flat_map(|v| scene.colors[*v as usize].to_array()).map(f32::to_le_bytes);
            let shape = json!({ "componentType": 5126, "type": "VEC3" });
            attributes["COLOR_0"] = json!(self.accessor(colors, used.len(), shape));
        }
        json!({ "attributes": attributes, "indices": indices, "material": material })
    }

    pub(crate) fn camera(&mut self, scene: &Scene) {
        let Some(camera) = scene.camera else { return };
        let [width, height] = camera.resolution.map(|r| r as f32);
        let near = number(scene.diagonal() * 1e-4);
        let extras = extras(CameraExtras { camera, origin: scene.origin });
        self.cameras.push(match camera.height {
            None => json!({
                "type": "perspective",
                "perspective": {
                    "yfov": number(camera.fov_y.to_radians()),
                    "aspectRatio": number(width / height),
                    "znear": near,
                },
                "extras": extras,
            }),
            Some(_) => {
                let [x, y] = camera.half_extents();
                let far = number(scene.diagonal() + camera.eye.length());
                json!({
                    "type": "orthographic",
                    "orthographic": { "xmag": number(x.abs()), "ymag": number(y), "znear": near, "zfar": far },
                    "extras": extras,
                })
            }
        });
        let (right, up, forward) = camera.world_from_camera();
        let world = Mat4::from_cols(right.extend(0.0), up.extend(0.0), (-forward).extend(0.0), camera.eye.extend(1.0));
        self.nodes.push(json!({ "name": "camera", "camera": 0, "matrix": vector(world.to_cols_array()) }));
    }

    pub(crate) fn lights(&mut self, scene: &Scene, lights: &[VirtualLight]) {
        for light in &scene.lights {
            match *light {
                Light::Point { position, intensity } => {
                    self.light("point", json!({ "type": "point" }), intensity, Some(position), None, None);
                }
                Light::Spot { position, direction, intensity, inner, outer } => {
                    let cone = json!({ "innerConeAngle": number(inner), "outerConeAngle": number(outer) });
                    let kind = json!({ "type": "spot", "spot": cone });
                    self.light("spot", kind, intensity, Some(position), Some(direction), None);
                }
                Light::Directional { direction, irradiance } => {
                    self.light(
                        "directional",
                        json!({ "type": "directional" }),
                        irradiance,
                        None,
                        Some(direction),
                        None,
                    );
                }
                Light::Imported { position, normal, power, exponent } => {
                    self.virtual_light(&VirtualLight { position, normal, power, exponent });
                }
                // Its surface is a mesh, its light among the virtual lights.
                Light::Sphere { .. } => {}
            }
        }
        for light in lights {
            self.virtual_light(light);
        }
    }

    fn virtual_light(&mut self, &VirtualLight { position, normal, power, exponent }: &VirtualLight) {
        let cone = json!({ "innerConeAngle": 0.0, "outerConeAngle": number(FRAC_PI_2) });
        let exact = extras(VirtualExtras { is_virtual: true, power, normal, exponent });
        let kind = json!({ "type": "spot", "spot": cone });
        self.light("virtual", kind, power / exitance(exponent), Some(position), Some(normal), Some(exact));
    }

    fn light(
        &mut self,
        name: &str,
        mut kind: Value,
        intensity: Vec3,
        position: Option<Vec3>,
        direction: Option<Vec3>,
        extras: Option<Value>,
    ) {
        let greatest = intensity.max_element();
        kind["intensity"] = number(greatest);
        kind["color"] = vector((if greatest > 0.0 { intensity / greatest } else { Vec3::ONE }).to_array());
        self.lights.push(kind);
        let mut node = json!({
            "name": format!("{name} {}", self.lights.len() - 1),
            "extensions": { "KHR_lights_punctual": { "light": self.lights.len() - 1 } },
        });
        if let Some(position) = position {
            node["translation"] = vector(position.to_array());
        }
        if let Some(direction) = direction {
            node["rotation"] = vector(Quat::from_rotation_arc(Vec3::NEG_Z, direction).normalize().to_array());
        }
        if let Some(extras) = extras {
            node["extras"] = extras;
        }
        self.nodes.push(node);
    }

    /// Nodes of the scene's root: all, or one that moves them to the scene's place in the world.
    pub(crate) fn roots(&mut self, scene: &Scene) -> Vec<usize> {
        let roots: Vec<usize> = (0..self.nodes.len()).collect();
        if scene.origin == DVec3::ZERO {
            return roots;
        }
        // A chosen origin is exact in single precision, to which readers may round it.
        self.nodes.push(json!({ "name": "origin", "translation": scene.origin.to_array(), "children": roots }));
        vec![self.nodes.len() - 1]
    }

    fn json(mut self, scene: &Scene, bin_path: &Path, images: &[PathBuf]) -> Value {
        let of_materials = ["emissive_strength", "ior", "transmission", "volume"];
        let mut extensions: Vec<String> = of_materials.iter().map(|name| format!("KHR_materials_{name}")).collect();
        let roots = self.roots(scene);
        let mut document = json!({
            "asset": {
                "version": "2.0",
                "generator": GENERATOR,
                "extras": extras(AssetExtras { lights_exported: true }),
            },
            "scene": 0,
            "scenes": [{ "name": scene.name, "nodes": roots }],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": scene.materials.iter().map(material).collect::<Vec<_>>(),
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{ "uri": uri(bin_path), "byteLength": self.bin.len() }],
        });
        // glTF does not allow empty arrays.
        if !self.cameras.is_empty() {
            document["cameras"] = json!(self.cameras);
        }
        if scene.materials.iter().any(Material::is_anisotropic) {
            extensions.push(String::from("KHR_materials_anisotropy"));
        }
        if !self.lights.is_empty() {
            extensions.push(String::from("KHR_lights_punctual"));
            document["extensions"] = json!({ "KHR_lights_punctual": { "lights": self.lights } });
        }
        if !scene.textures.is_empty() {
            let indices = 0..scene.textures.len();
            document["images"] = images.iter().map(|file| json!({ "uri": uri(file) })).collect();
            document["samplers"] = scene.textures.iter().map(sampler).collect();
            document["textures"] = indices.map(|i| json!({ "source": i, "sampler": i })).collect();
        }
        document["extensionsUsed"] = json!(extensions);
        document
    }
}

pub(crate) fn sampler(texture: &Texture) -> Value {
    let [s, t] = texture.wrap.map(|wrap| match wrap {
        Wrap::Repeat => 10497,
        Wrap::Mirror => 33648,
        Wrap::Clamp => 33071,
    });
    json!({ "wrapS": s, "wrapT": t })
}

pub(crate) fn material(m: &Material) -> Value {
    let mirror = m.surface == Surface::Mirror;
    let color = if mirror { m.specular } else { m.base_color };
    let (alpha_mode, opacity) = match m.alpha {
        Alpha::Opaque => ("OPAQUE", 1.0),
        Alpha::Mask { opacity, .. } => ("MASK", opacity),
        Alpha::Blend { opacity } => ("BLEND", opacity),
    };
    let mut pbr = json!({
        "baseColorFactor": vector(color.extend(opacity).to_array()),
        "metallicFactor": number(if mirror { 1.0 } else { m.metallic }),
        "roughnessFactor": number(match m.surface {
            Surface::Mirror => 0.0,
            Surface::Glass if m.thin => m.frost,
            _ => m.roughness,
        }),
    });
    let info =
        |texture: u32, of: TextureUse| json!({ "index": texture, "texCoord": u32::from(m.second_uvs[of as usize]) });
    if let Some(texture) = m.base_texture {
        pbr["baseColorTexture"] = info(texture, TextureUse::Base);
    }
    if let Some(texture) = m.metallic_roughness_texture {
        pbr["metallicRoughnessTexture"] = info(texture, TextureUse::MetallicRoughness);
    }
    let mut material = json!({
        "name": m.name,
        "pbrMetallicRoughness": pbr,
        "doubleSided": true,
        "alphaMode": alpha_mode,
        "extras": extras(MaterialExtras::of(m)),
    });
    if let Alpha::Mask { cutoff, .. } = m.alpha {
        material["alphaCutoff"] = number(cutoff);
    }
    if let Some(texture) = m.normal_texture {
        material["normalTexture"] = info(texture, TextureUse::Normal);
        material["normalTexture"]["scale"] = number(m.normal_scale);
    }
    if let Some(texture) = m.emission_texture {
        material["emissiveTexture"] = info(texture, TextureUse::Emission);
    }
    if m.is_anisotropic() {
        material["extensions"]["KHR_materials_anisotropy"] =
            json!({ "anisotropyStrength": number(m.anisotropy), "anisotropyRotation": number(m.anisotropy_rotation) });
    }
    let greatest = m.emission.max_element();
    if greatest > 0.0 {
        material["emissiveFactor"] = vector((m.emission / greatest).to_array());
        material["extensions"]["KHR_materials_emissive_strength"] = json!({ "emissiveStrength": number(greatest) });
    }
    if m.surface == Surface::Glass {
        material["extensions"]["KHR_materials_ior"] = json!({ "ior": number(m.ior) });
        material["extensions"]["KHR_materials_transmission"] = json!({ "transmissionFactor": 1.0 });
        if !m.thin {
            material["extensions"]["KHR_materials_volume"] = json!({ "thicknessFactor": 1.0 });
        }
    }
    material
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_exact() {
        assert_eq!(number(0.1).to_string(), "0.1");
        for bits in (0..u32::MAX).step_by(7_919_317) {
            let x = f32::from_bits(bits);
            if x.is_finite() {
                let back: f32 = serde_json::from_str(&number(x).to_string()).unwrap();
                assert_eq!(back, x);
            }
        }
    }

    #[test]
    fn uris_are_encoded() {
        assert_eq!(uri(Path::new("dir/my lights:1.bin")), "my%20lights%3A1.bin");
    }
}
