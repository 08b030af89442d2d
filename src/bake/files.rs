//! Files of kept light: a glTF 2.0 model (`.glb`) with texture coordinates of the maps, the maps beside it as
//! OpenEXR of half floats, and a manifest in the model's `extras.lightsum.lightmap` that says which is which.
//!
//! A triangle that is lit on both sides is there twice, once for each, and every material is one-sided, unless neither side has
//! light. Its back is moved a hair's breadth outwards: rays of programs that trace the model would end on one side where they leave the other.
//! `extras.lightsum.triangles` of a primitive is an accessor of the triangles of the scene that was baked, twice their index,
//! plus 1 for the back; by it `read` gives the light to that scene again.
//!
//! The maps hold irradiance in W/m^2 times 2^exposure. With [`Form::Unlit`] the model has textures of radiance instead, in sRGB,
//! which any viewer shows without lights (KHR_materials_unlit); the maps are written too.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

#[cfg(feature = "gltf")]
pub use super::kept::read;
use super::materials::{self, Materials};
use super::{Charts, Lightmap};
use crate::error::{Error, Result};
use crate::fingerprint::Fnv;
use crate::output::{self, Encoding, FileSet, Layers, Metadata, Tonemap};
use crate::scene::export::{self, GENERATOR, Writer};
use crate::scene::{Scene, TextureUse, Triangle};
use crate::settings::Exposure;

/// Which light the maps hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Parts {
    /// Direct and indirect light in one map.
    #[default]
    Together,
    /// A map of each.
    Apart,
    /// Direct light only.
    Direct,
    /// Indirect light only.
    Indirect,
}

/// Form of the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// With its own materials, textures and lights.
    Lit,
    /// With textures of radiance, which need no light.
    Unlit {
        /// Exposure of the textures.
        exposure: Exposure,
        /// Their tone curve.
        tonemap: Tonemap,
    },
}

/// A page in the manifest.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PageEntry {
    /// Width and height in texels.
    pub size: [u32; 2],
    /// Stops by which the values of the files are brighter than irradiance in W/m^2.
    pub exposure: i32,
    /// File of direct and indirect light together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub irradiance: Option<String>,
    /// File of direct light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direct: Option<String>,
    /// File of indirect light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub indirect: Option<String>,
}

/// The part of an object on a page, in the manifest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectEntry {
    /// Its name.
    pub object: String,
    /// Index of the page.
    pub page: u32,
    /// Left, top, width and height of its rectangle in texels.
    pub rectangle: [u32; 4],
    /// Number of its charts there.
    pub charts: u32,
}

/// `extras.lightsum.lightmap` of the document.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of this form: 1.
    pub version: u32,
    /// Of the scene's geometry, hexadecimal.
    pub geometry: String,
    /// Texels along a unit of length.
    pub density: f32,
    /// Which light the maps hold.
    pub parts: Parts,
    /// Set of texture coordinates that belongs to the maps.
    pub tex_coord: u32,
    /// The pages.
    pub pages: Vec<PageEntry>,
    /// The objects.
    pub objects: Vec<ObjectEntry>,
}

/// `extras.lightsum` of the document.
#[derive(Serialize, Deserialize)]
pub(super) struct RootExtras {
    pub lightmap: Manifest,
}

/// `extras.lightsum` of a primitive.
#[derive(Serialize, Deserialize)]
pub(super) struct PrimitiveExtras {
    /// Index of the page.
    pub page: u32,
    /// Index of the accessor of its triangles.
    pub triangles: usize,
}

/// A side of a triangle to be written, with the place of its light.
#[derive(Clone, Copy)]
struct Side {
    triangle: u32,
    back: bool,
    /// A back whose front is written too.
    apart: bool,
    corners: Option<[Vec2; 3]>,
}

/// Distance of the back from the front where both are written, relative to the diagonal of the scene.
const GAP: f32 = 1e-5;

/// Kind of a primitive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Kind {
    pub material: u32,
    pub smooth: bool,
    /// Page of its light, if it has texels.
    pub page: Option<u32>,
    /// Whether it stands for both sides of its triangles.
    pub both_sides: bool,
    /// Whether it emits what its material does; not the back of a lamp.
    pub emits: bool,
}

/// Name of the map of a page beside the model.
fn map_path(path: &Path, what: &str, page: usize) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    path.with_file_name(format!("{stem}-{what}-{page}.exr"))
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Hash of what the places of light are bound to.
pub(super) fn geometry(scene: &Scene) -> String {
    let mut hash = Fnv::default();
    for i in 0..scene.triangles.len() {
        hash.add(bytemuck::cast_slice(&scene.triangle_positions(i)));
    }
    format!("{:016x}", hash.0)
}

/// Writes the model `path` (`.glb`) and its maps, all or none; the model gets its name last. Returns the names of all.
///
/// Errors: [`Error::File`] for another extension; [`Error::Io`].
pub fn write(
    path: &Path,
    scene: &Scene,
    light: &Lightmap,
    (parts, form): (Parts, Form),
    metadata: &Metadata,
) -> Result<Vec<PathBuf>> {
    if path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("glb")) {
        return Err(Error::file(path, "light is kept with a binary glTF model; let the name end in .glb"));
    }
    let (mut files, mut written) = (FileSet::default(), Vec::new());
    let mut pages = Vec::new();
    for (i, page) in light.pages.iter().enumerate() {
        let sum = |i: usize| page.direct[i] + page.indirect[i];
        let greatest = (0..page.direct.len()).map(|i| sum(i).max_element()).fold(0.0, f32::max);
        // Halves end at 65504.
        let exposure = if greatest > 32768.0 { 15 - greatest.log2().ceil() as i32 } else { 0 };
        let mut entry = PageEntry { size: page.size, exposure, ..PageEntry::default() };
        let scale = (exposure as f32).exp2();
        let mut map = |what: &str, values: &dyn Fn(usize) -> Vec3| -> Result<Option<String>> {
            let file = map_path(path, what, i);
            let color = (0..page.direct.len()).map(|i| values(i) * scale).collect();
            let layers = Layers { width: page.size[0], height: page.size[1], color, ..Layers::default() };
            let encoding = Encoding { color_only: true, ..Encoding::default() };
            files.add(&file, &[&output::encode(&file, &layers, metadata, &encoding)?])?;
            let name = file_name(&file);
            written.push(file);
            Ok(Some(name))
        };
        if parts == Parts::Together {
            entry.irradiance = map("irradiance", &sum)?;
        }
        if matches!(parts, Parts::Apart | Parts::Direct) {
            entry.direct = map("direct", &|i| page.direct[i])?;
        }
        if matches!(parts, Parts::Apart | Parts::Indirect) {
            entry.indirect = map("indirect", &|i| page.indirect[i])?;
        }
        pages.push(entry);
    }
    let manifest = Manifest {
        version: 1,
        geometry: geometry(scene),
        density: light.charts.density,
        parts,
        tex_coord: set_of_maps(scene, form),
        pages,
        objects: objects(scene, &light.charts),
    };
    let bytes = model(path, scene, light, form, manifest)?;
    files.add(path, &[&bytes])?;
    files.commit()?;
    written.insert(0, path.to_path_buf());
    Ok(written)
}

/// Set of texture coordinates of the maps: beyond those of the model's own textures.
fn set_of_maps(scene: &Scene, form: Form) -> u32 {
    match form {
        Form::Unlit { .. } => 0,
        Form::Lit if scene.second_uvs.is_empty() => 1,
        Form::Lit => 2,
    }
}

/// The rectangles of the objects.
fn objects(scene: &Scene, charts: &Charts) -> Vec<ObjectEntry> {
    let mut found: BTreeMap<(u32, u32), (Vec2, Vec2, Vec<u32>)> = BTreeMap::new();
    for face in &charts.faces {
        let key = (scene.triangles[face.triangle as usize].object, face.page);
        let (low, high, charts) = found.entry(key).or_insert((Vec2::INFINITY, Vec2::NEG_INFINITY, Vec::new()));
        for corner in face.corners {
            (*low, *high) = (low.min(corner), high.max(corner));
        }
        charts.push(face.chart);
    }
    let entry = |((object, page), (low, high, mut charts)): ((u32, u32), (Vec2, Vec2, Vec<u32>))| {
        charts.sort_unstable();
        charts.dedup();
        let [x, y] = [low.x.floor(), low.y.floor()];
        let rectangle = [x, y, high.x.ceil() - x, high.y.ceil() - y].map(|n| n as u32);
        ObjectEntry { object: scene.objects[object as usize].clone(), page, rectangle, charts: charts.len() as u32 }
    };
    found.into_iter().map(entry).collect()
}

/// The sides of all triangles by object and kind.
fn sides(scene: &Scene, charts: &Charts) -> BTreeMap<u32, BTreeMap<Kind, Vec<Side>>> {
    let mut places = vec![[None; 2]; scene.triangles.len()];
    for face in &charts.faces {
        places[face.triangle as usize][usize::from(face.back)] = Some((face.page, face.corners));
    }
    let mut groups: BTreeMap<u32, BTreeMap<Kind, Vec<Side>>> = BTreeMap::new();
    for ((i, triangle), places) in (0..).zip(&scene.triangles).zip(places) {
        let material = &scene.materials[triangle.material as usize];
        let shines_in_front = material.emission != Vec3::ZERO && !material.two_sided;
        let both_sides = places == [None, None];
        let has_front = places[0].is_some() || shines_in_front;
        let mut add = |back: bool, place: Option<(u32, [Vec2; 3])>| {
            let (Triangle { material, smooth, .. }, page) = (*triangle, place.map(|(page, _)| page));
            let kind = Kind { material, smooth, page, both_sides, emits: !(back && shines_in_front) };
            let side = Side { triangle: i, back, apart: back && has_front, corners: place.map(|(_, corners)| corners) };
            groups.entry(triangle.object).or_default().entry(kind).or_default().push(side);
        };
        match places {
            [None, None] => add(false, None),
            [front, back] => {
                if has_front {
                    add(false, front);
                }
                if back.is_some() {
                    add(true, back);
                }
            }
        }
    }
    groups
}

/// The bytes of the model.
fn model(path: &Path, scene: &Scene, light: &Lightmap, form: Form, manifest: Manifest) -> Result<Vec<u8>> {
    let mut document = Writer::default();
    let mut materials = Materials::new(path, scene, light, form)?;
    let (low, high) =
        scene.positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
    let gap = GAP * (high - low).length();
    for (object, primitives) in sides(scene, &light.charts) {
        let primitives: Vec<Value> = primitives
            .iter()
            .map(|(&kind, sides)| {
                let material = materials.index(kind)?;
                Ok(primitive(&mut document, (scene, &light.charts, gap), form, kind, sides, material))
            })
            .collect::<Result<_>>()?;
        let name = &scene.objects[object as usize];
        document.meshes.push(json!({ "name": name, "primitives": primitives }));
        document.nodes.push(json!({ "name": name, "mesh": document.meshes.len() - 1 }));
    }
    document.camera(scene);
    if form == Form::Lit {
        document.lights(scene, &[]);
    }
    let Materials { list: materials, images, .. } = materials;
    let samplers: Vec<Value> = images.iter().map(|(_, _, sampler)| sampler.clone()).collect();
    let textures: Vec<Value> = (0..images.len()).map(|i| json!({ "source": i, "sampler": i })).collect();
    let mut embedded = Vec::new();
    for (name, bytes, _) in images {
        let offset = document.bin.len().next_multiple_of(4);
        document.bin.resize(offset, 0);
        document.views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }));
        document.bin.extend(bytes);
        embedded.push(json!({ "name": name, "mimeType": "image/png", "bufferView": document.views.len() - 1 }));
    }
    document.bin.resize(document.bin.len().next_multiple_of(4), 0);
    let roots = document.roots(scene);
    let mut json = json!({
        "asset": { "version": "2.0", "generator": GENERATOR },
        "scene": 0,
        "scenes": [{ "name": scene.name, "nodes": roots }],
        "nodes": document.nodes,
        "meshes": document.meshes,
        "materials": materials,
        "accessors": document.accessors,
        "bufferViews": document.views,
        "buffers": [{ "byteLength": document.bin.len() }],
        "extras": export::extras(RootExtras { lightmap: manifest }),
    });
    let mut extensions: Vec<&str> = match form {
        Form::Lit => vec![
            "KHR_materials_emissive_strength",
            "KHR_materials_ior",
            "KHR_materials_transmission",
            "KHR_materials_volume",
        ],
        Form::Unlit { .. } => vec!["KHR_materials_unlit"],
    };
    if form == Form::Lit && scene.materials.iter().any(|m| m.is_anisotropic()) {
        extensions.push("KHR_materials_anisotropy");
    }
    // glTF does not allow empty arrays.
    if !embedded.is_empty() {
        json["images"] = json!(embedded);
        json["samplers"] = json!(samplers);
        json["textures"] = json!(textures);
    }
    if !document.cameras.is_empty() {
        json["cameras"] = json!(document.cameras);
    }
    if !document.lights.is_empty() {
        extensions.push("KHR_lights_punctual");
        json["extensions"] = json!({ "KHR_lights_punctual": { "lights": document.lights } });
    }
    json["extensionsUsed"] = json!(extensions);
    let mut text = serde_json::to_vec(&json).map_err(|e| Error::file(path, e.to_string()))?;
    text.resize(text.len().next_multiple_of(4), b' ');
    container(path, &text, &document.bin)
}

/// The container of a binary glTF: header, text, buffer.
fn container(path: &Path, text: &[u8], bin: &[u8]) -> Result<Vec<u8>> {
    let total = 12 + 8 + text.len() + 8 + bin.len();
    let word = |n: usize| u32::try_from(n).map(u32::to_le_bytes);
    let large = |_| Error::file(path, "the model would have more than 4 GiB; bake parts of the scene");
    let mut bytes = Vec::with_capacity(total);
    bytes.extend(b"glTF");
    bytes.extend(2u32.to_le_bytes());
    bytes.extend(word(total).map_err(large)?);
    for (kind, chunk) in [(b"JSON", text), (b"BIN\0", bin)] {
        bytes.extend(word(chunk.len()).map_err(large)?);
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    Ok(bytes)
}

fn primitive(
    document: &mut Writer,
    (scene, charts, gap): (&Scene, &Charts, f32),
    form: Form,
    Kind { material, smooth, page, .. }: Kind,
    sides: &[Side],
    index: usize,
) -> Value {
    let size = page.map_or(Vec2::ONE, |page| Vec2::from_array(charts.pages[page as usize].map(|n| n as f32)));
    // A vertex of the file is one of the scene with its place and side, moved with its triangle.
    let mut numbers: HashMap<(u32, bool, [u32; 2], [u32; 3]), u32> = HashMap::new();
    let mut vertices: Vec<(u32, bool, Vec2)> = Vec::new();
    let mut positions: Vec<Vec3> = Vec::new();
    let mut indices: Vec<u32> = Vec::with_capacity(3 * sides.len());
    for side in sides {
        let corners = side.corners.unwrap_or_default();
        let order = if side.back { [0, 2, 1] } else { [0, 1, 2] };
        let [a, b, c] = scene.triangle_positions(side.triangle as usize);
        let outwards = if side.apart { gap * (c - a).cross(b - a).normalize_or_zero() } else { Vec3::ZERO };
        for k in order {
            let v = scene.triangles[side.triangle as usize].vertices[k];
            let place = (corners[k] / size).clamp(Vec2::ZERO, Vec2::ONE);
            let next = vertices.len() as u32;
            let position = scene.positions[v as usize] + outwards;
            let key = (v, side.back, place.to_array().map(f32::to_bits), position.to_array().map(f32::to_bits));
            let number = *numbers.entry(key).or_insert(next);
            if number == next {
                positions.push(position);
                vertices.push((v, side.back, place));
            }
            indices.push(number);
        }
    }
    let words = |values: &[u32]| values.iter().map(|v| v.to_le_bytes()).collect::<Vec<_>>().into_iter();
    let scalar = || json!({ "componentType": 5125, "type": "SCALAR" });
    let indices = document.accessor(words(&indices), indices.len(), scalar());
    let float3 = || json!({ "componentType": 5126, "type": "VEC3" });
    let float2 = || json!({ "componentType": 5126, "type": "VEC2" });
    let count = vertices.len();
    let mut add =
        |values: Vec<f32>, shape: Value| document.accessor(values.into_iter().map(f32::to_le_bytes), count, shape);
    let mut shape = float3();
    shape["min"] = export::vector(positions.iter().copied().fold(Vec3::INFINITY, Vec3::min).to_array());
    shape["max"] = export::vector(positions.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max).to_array());
    let mut attributes = json!({ "POSITION": add(positions.iter().flat_map(|p| p.to_array()).collect(), shape) });
    if smooth {
        let normal = |&(v, back, _): &(u32, bool, Vec2)| scene.normals[v as usize] * if back { -1.0 } else { 1.0 };
        attributes["NORMAL"] = json!(add(vertices.iter().flat_map(|v| normal(v).to_array()).collect(), float3()));
    }
    let m = &scene.materials[material as usize];
    let mut set = |number: u32, values: Vec<f32>| {
        attributes[format!("TEXCOORD_{number}")] = json!(add(values, float2()));
    };
    let own = |uvs: &[Vec2]| vertices.iter().flat_map(|(v, ..)| uvs[*v as usize].to_array()).collect::<Vec<f32>>();
    match form {
        Form::Lit => {
            // Sets are numbered without gaps.
            if page.is_some() || m.textures().next().is_some() || m.is_anisotropic() {
                set(0, own(&scene.uvs));
                if !scene.second_uvs.is_empty() {
                    set(1, own(&scene.second_uvs));
                }
            }
        }
        Form::Unlit { .. } if page.is_none() && materials::is_pattern(m) => {
            let second = m.second_uvs[TextureUse::Emission as usize];
            set(0, own(if second { &scene.second_uvs } else { &scene.uvs }));
        }
        Form::Unlit { .. } => {}
    }
    if page.is_some() {
        set(set_of_maps(scene, form), vertices.iter().flat_map(|(.., place)| place.to_array()).collect());
    }
    if form == Form::Lit && !scene.colors.is_empty() {
        let colors = vertices.iter().flat_map(|(v, ..)| scene.colors[*v as usize].to_array()).collect();
        attributes["COLOR_0"] = json!(add(colors, float3()));
    }
    let mut value = json!({ "attributes": attributes, "indices": indices, "material": index });
    if let Some(page) = page {
        let numbers: Vec<u32> = sides.iter().map(|side| side.triangle << 1 | u32::from(side.back)).collect();
        let triangles = document.accessor(words(&numbers), numbers.len(), scalar());
        value["extras"] = export::extras(PrimitiveExtras { page, triangles });
    }
    value
}
