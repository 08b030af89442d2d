//! glTF 2.0 models, `.gltf` and `.glb`.
//!
//! Nodes are flattened into world space; their transforms are composed in double precision. Each is single precision in
//! the file, as are vertices within their node, so that a far scene keeps its precision only if its distance is in a
//! node's translation. Used: triangles, strips and fans with normals and up to two sets of texture coordinates a material, instances
//! (EXT_mesh_gpu_instancing), quantized attributes (KHR_mesh_quantization), compressed ones
//! ([`super::gltf_compressed`]), skins and morph targets at rest, animations
//! ([`super::gltf_animation`]), KHR_lights_punctual, perspective cameras, and the materials of [`super::gltf_material`].

use std::collections::{BTreeSet, HashMap};
use std::f32::consts::FRAC_PI_2;
use std::path::Path;
use std::sync::Arc;

use glam::{DMat4, DQuat, DVec3, Quat, Vec2, Vec3};
use gltf::accessor::Dimensions;
use gltf::camera::Projection;
use gltf::json::extras::Extras;
use gltf::json::validation::{self, Validate};
use gltf::khr_lights_punctual::Kind;
use gltf::mesh::Mode;
use gltf::{Document, Gltf, Node, Primitive, Semantic};
use serde::de::DeserializeOwned;

use super::animation::{Animation, Animations, Nodes, Part, Skin};
use super::export::{AssetExtras, CameraExtras, VirtualExtras};
use super::gltf_accessor::{Buffers, reason};
use super::gltf_extensions::{Extensions, INSTANCING};
use super::gltf_material::{TextureKey, UvMaps};
use super::quietly::quietly;
use super::{Camera, Light, NamedCamera, Scene, Texture, Triangle, gltf_animation, origin};
use crate::error::{Error, Result};
use crate::input::Inputs;

/// Memory of a vertex, as read, placed and kept, and of an index with its part of a triangle.
const VERTEX_BYTES: u64 = 128;
const INDEX_BYTES: u64 = 12;

/// Luminous efficacy that converts photometric to radiometric quantities, lm/W.
const EFFICACY: f32 = 683.0;

/// Reads a glTF file; the result is not validated yet.
///
/// `photometric`: intensities are in candela and irradiances in lux, else in W; `None`: as the file looks.
pub(super) fn load(path: &Path, photometric: Option<bool>, inputs: &Inputs) -> Result<Scene> {
    let bytes = inputs.read(path)?;
    // Editors may mark the byte order of the text, which JSON does not know.
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    // The glTF crate does not check everything in a file (indices inside extensions, percent signs in URIs).
    match quietly(|| read(path, bytes, photometric, inputs)) {
        Ok(result) => result,
        Err(message) => Err(Error::file(path, format!("malformed glTF: {message}"))),
    }
}

fn read(path: &Path, bytes: &[u8], photometric: Option<bool>, inputs: &Inputs) -> Result<Scene> {
    let failed = |e: gltf::Error| Error::file(path, reason(&e));
    let Gltf { document, blob } = Gltf::from_slice_without_validation(bytes).map_err(failed)?;
    let mut root = document.into_json();
    let extensions = Extensions::take(path, &mut root)?;
    check(path, &root)?;
    let document = Document::from_json_without_validation(root);
    let mut reader = Reader {
        path,
        document: &document,
        buffers: Buffers::read((path, inputs), &document, blob, extensions.quantized)?,
        light_scale: if photometric.unwrap_or_else(|| looks_photometric(path, &document)) {
            1.0 / EFFICACY
        } else {
            1.0
        },
        materials: HashMap::new(),
        textures: HashMap::new(),
        images: HashMap::new(),
        ignored: extensions.left_out,
        physical_emission: false,
        positions: Vec::new(),
        lights: Vec::new(),
        cameras: Vec::new(),
        worlds: Vec::new(),
        skins: Vec::new(),
        parts: Vec::new(),
        nodes_of_lights: Vec::new(),
        nodes_of_cameras: Vec::new(),
        scene: Scene::default(),
    };
    if let Some(extras) = ours::<AssetExtras>(&document.as_json().asset.extras) {
        reader.scene.emitters_are_lights = !extras.lights_exported;
    }
    let all: Vec<Node> = document.nodes().collect();
    let roots: Vec<usize> = match document.default_scene().or_else(|| document.scenes().next()) {
        Some(scene) => scene.nodes().map(|node| node.index()).collect(),
        None => {
            let children: BTreeSet<usize> = document.nodes().flat_map(|n| n.children().map(|c| c.index())).collect();
            (0..all.len()).filter(|i| !children.contains(i)).collect()
        }
    };
    let nodes = gltf_animation::nodes(&document, &roots).map_err(|message| Error::file(path, message))?;
    reader.worlds = nodes.worlds(&nodes.matrices);
    reader.skins = reader.skins()?;
    let shown = reader.shown(&nodes, &roots);
    for &node in nodes.order.iter().filter(|&&node| shown[node]) {
        if !reader.worlds[node].as_mat4().is_finite() {
            return Err(Error::file(path, format!("node {node}: its transform is not finite")));
        }
        reader.node(&all[node], &nodes.weights[node])?;
    }
    let animations = reader.animations()?;
    if !reader.ignored.is_empty() {
        let ignored: Vec<String> = std::mem::take(&mut reader.ignored).into_iter().collect();
        log::warn!("{}: not supported and left out: {}", path.display(), ignored.join("; "));
        reader.scene.ignored = ignored;
    }
    Ok(reader.finish(animations, nodes))
}

/// Refuses an invalid document.
fn check(path: &Path, root: &gltf::json::Root) -> Result<()> {
    let mut errors = Vec::new();
    root.validate(root, gltf::json::Path::new, &mut |at, error| errors.push((at(), error)));
    // The glTF crate demands a view of every accessor; by the standard one without is full of zeros.
    errors.retain(|(at, error)| !(*error == validation::Error::Missing && at.as_str().ends_with(".bufferView")));
    if !errors.is_empty() {
        return Err(Error::file(path, reason(&gltf::Error::Validation(errors))));
    }
    // The crate does not check this index.
    for (i, animation) in root.animations.iter().enumerate() {
        let absent = animation.channels.iter().map(|c| c.target.node.value()).find(|&node| node >= root.nodes.len());
        if let Some(node) = absent {
            return Err(Error::file(path, format!("animation {i} moves node {node}, of {} nodes", root.nodes.len())));
        }
    }
    // Nor that an image lies somewhere, and in a view has a type, which it then unwraps.
    for (i, image) in root.images.iter().enumerate() {
        let problem = match (&image.buffer_view, &image.mime_type, &image.uri) {
            (None, _, None) => "has neither uri nor bufferView",
            (Some(_), None, _) => "lies in a buffer view and has no mimeType",
            _ => continue,
        };
        return Err(Error::file(path, format!("image {i} {problem}; add it, or remove the image")));
    }
    Ok(())
}

/// The exporter's data in an object's `extras.lightsum`.
pub(crate) fn ours<T: DeserializeOwned>(extras: &Extras) -> Option<T> {
    let mut value: serde_json::Value = serde_json::from_str(extras.as_ref()?.get()).ok()?;
    serde_json::from_value(value.get_mut("lightsum")?.take()).ok()
}

pub(super) struct Reader<'a> {
    pub(super) path: &'a Path,
    pub(super) document: &'a Document,
    pub(super) buffers: Buffers<'a>,
    light_scale: f32,
    pub(super) materials: HashMap<Option<usize>, u32>,
    pub(super) textures: HashMap<TextureKey, u32>,
    /// Images by their numbers, decoded ahead; `None`: a texture has taken it.
    pub(super) images: HashMap<usize, Option<Result<Texture>>>,
    ignored: BTreeSet<String>,
    /// Whether some emissive material gives its strength.
    pub(super) physical_emission: bool,
    /// World positions of the scene's vertices and of its lights.
    positions: Vec<DVec3>,
    lights: Vec<DVec3>,
    /// Cameras, each relative to a point in world space.
    cameras: Vec<(DVec3, NamedCamera)>,
    /// World transforms of the nodes.
    worlds: Vec<DMat4>,
    skins: Vec<Skin>,
    /// The vertices as the file has them, if it has animations.
    parts: Vec<Part>,
    /// Indices of lights and of cameras with their nodes.
    nodes_of_lights: Vec<(usize, usize)>,
    nodes_of_cameras: Vec<(usize, usize)>,
    pub(super) scene: Scene,
}

impl Reader<'_> {
    /// Notes something that the scene will not show.
    pub(super) fn leave_out(&mut self, what: &str) {
        if !self.ignored.contains(what) {
            self.ignored.insert(what.to_string());
        }
    }

    pub(super) fn error(&self, message: String) -> Error {
        Error::file(self.path, message)
    }

    /// Which nodes are in the document's scene.
    fn shown(&self, nodes: &Nodes, roots: &[usize]) -> Vec<bool> {
        let mut shown = vec![false; self.worlds.len()];
        roots.iter().for_each(|&root| shown[root] = true);
        for &node in &nodes.order {
            shown[node] |= nodes.parents[node].is_some_and(|parent| shown[parent]);
        }
        shown
    }

    /// Chooses the scene's origin and places everything relative to it.
    fn finish(mut self, list: Vec<Animation>, nodes: Nodes) -> Scene {
        let low = self.positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = self.positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        self.scene.origin = origin::choose(low, high);
        self.scene.emission_is_relative = !self.physical_emission;
        self.scene.positions = self.positions.iter().map(|&p| self.scene.from_world(p)).collect();
        for (light, place) in self.scene.lights.iter_mut().zip(&self.lights) {
            if let Light::Point { position, .. } | Light::Spot { position, .. } | Light::Imported { position, .. } =
                light
            {
                *position = (*place - self.scene.origin).as_vec3();
            }
        }
        for (place, mut named) in self.cameras {
            for point in [&mut named.camera.eye, &mut named.camera.target] {
                *point = (place - self.scene.origin + point.as_dvec3()).as_vec3();
            }
            self.scene.cameras.push(named);
        }
        self.scene.camera = self.scene.cameras.first().map(|named| named.camera);
        if !list.is_empty() {
            let (lights, cameras) = (self.nodes_of_lights, self.nodes_of_cameras);
            let (skins, parts, origin) = (self.skins, self.parts, self.scene.origin);
            let mut animations = Animations { list, nodes, skins, parts, lights, cameras, origin };
            animations.keep_moving();
            self.scene.animations = Some(Arc::new(animations));
        }
        self.scene
    }

    /// `weights`: those of the node's morph targets.
    fn node(&mut self, node: &Node, weights: &[f32]) -> Result<()> {
        let world = self.worlds[node.index()];
        if let Some(mesh) = node.mesh() {
            let name = node.name().or(mesh.name()).map_or_else(|| format!("node {}", node.index()), str::to_string);
            let object = self.scene.add_object(name);
            for instance in self.instances(node)? {
                for primitive in mesh.primitives() {
                    self.primitive(&primitive, (node, weights), instance, object)?;
                }
            }
        }
        if let Some(light) = node.light() {
            self.light(node, &light, world);
        }
        if let Some(camera) = node.camera() {
            let exact = ours::<CameraExtras>(camera.extras());
            let place = exact.as_ref().map_or(world.w_axis.truncate(), |e| e.origin);
            let number = || format!("camera {}", self.cameras.len());
            let name = node.name().or(camera.name()).map_or_else(number, str::to_string);
            if exact.is_none() {
                self.nodes_of_cameras.push((self.cameras.len(), node.index()));
            }
            let seen = || match camera.projection() {
                Projection::Perspective(p) => perspective(world, p.yfov(), p.aspect_ratio()),
                Projection::Orthographic(o) => orthographic(world, [o.xmag(), o.ymag()]),
            };
            let camera = exact.map_or_else(seen, |e| e.camera);
            self.cameras.push((place, NamedCamera { name, camera }));
        }
        Ok(())
    }

    /// Transforms of the instances of a node's mesh (EXT_mesh_gpu_instancing); one identity without that extension.
    fn instances(&self, node: &Node) -> Result<Vec<DMat4>> {
        let Some(extension) = node.extension_value(INSTANCING) else { return Ok(vec![DMat4::IDENTITY]) };
        let accessor = |name: &str| -> Result<Option<gltf::Accessor>> {
            let Some(index) = extension.pointer(&format!("/attributes/{name}")) else { return Ok(None) };
            let found = index.as_u64().and_then(|i| self.document.accessors().nth(usize::try_from(i).ok()?));
            let missing = || self.error(format!("node {}: {INSTANCING}: there is no accessor {index}", node.index()));
            found.ok_or_else(missing).map(Some)
        };
        let vectors = |name: &str| accessor(name)?.map(|a| self.buffers.vectors::<3>(&a, name)).transpose();
        let (moved, scaled) = (vectors("TRANSLATION")?, vectors("SCALE")?);
        let turned = accessor("ROTATION")?.map(|a| self.buffers.vectors::<4>(&a, "ROTATION")).transpose()?;
        let counts = [moved.as_ref().map(Vec::len), scaled.as_ref().map(Vec::len), turned.as_ref().map(Vec::len)];
        let mut counts = counts.into_iter().flatten();
        let count = counts.next().unwrap_or(1);
        if counts.any(|other| other != count) {
            let message = format!("node {}: attributes of {INSTANCING} differ in number of elements", node.index());
            return Err(self.error(message));
        }
        let vector = |of: &Option<Vec<[f32; 3]>>, i: usize, otherwise: DVec3| {
            of.as_ref().map_or(otherwise, |v| Vec3::from_array(v[i]).as_dvec3())
        };
        let transform = |i: usize| {
            let turn = turned.as_ref().map_or(DQuat::IDENTITY, |v| Quat::from_array(v[i]).as_dquat());
            let turn = if turn.length() > 0.0 { turn.normalize() } else { DQuat::IDENTITY };
            let (scale, place) = (vector(&scaled, i, DVec3::ONE), vector(&moved, i, DVec3::ZERO));
            DMat4::from_scale_rotation_translation(scale, turn, place)
        };
        Ok((0..count).map(transform).collect())
    }

    fn primitive(
        &mut self,
        primitive: &Primitive,
        (node, weights): (&Node, &[f32]),
        instance: DMat4,
        object: u32,
    ) -> Result<()> {
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            self.leave_out("points and lines");
            return Ok(());
        }
        let Some(positions) = primitive.get(&Semantic::Positions) else { return Ok(()) };
        let positions = self.buffers.vectors::<3>(&positions, "POSITION")?;
        let count = positions.len();
        // Nodes and instances repeat a mesh, and accessors without bytes repeat zeros.
        let indices = primitive.indices().map_or(count, |accessor| accessor.count());
        let bytes = (count as u64 * VERTEX_BYTES).saturating_add(indices as u64 * INDEX_BYTES);
        self.buffers.inputs.take(self.path, bytes)?;
        let material = primitive.material();
        let maps = UvMaps::of(&material);
        let coordinates = |set: u32| match primitive.get(&Semantic::TexCoords(set)) {
            Some(accessor) => self.buffers.vectors::<2>(&accessor, "TEXCOORD"),
            None => Ok(vec![[0.0; 2]; count]),
        };
        let uvs = coordinates(maps.first.set)?;
        let second_uvs = maps.second.map(|map| coordinates(map.set)).transpose()?;
        let lightmap_uvs = match primitive.get(&Semantic::TexCoords(1)) {
            Some(accessor) => Some(self.buffers.vectors::<2>(&accessor, "TEXCOORD")?),
            None => None,
        };
        let normals = match primitive.get(&Semantic::Normals) {
            Some(accessor) => self.buffers.vectors::<3>(&accessor, "NORMAL")?,
            None => vec![[0.0; 3]; count],
        };
        let differs = |uvs: &Option<Vec<[f32; 2]>>| uvs.as_ref().is_some_and(|uvs| uvs.len() != count);
        if uvs.len() != count || normals.len() != count || differs(&second_uvs) || differs(&lightmap_uvs) {
            let name = &self.scene.objects[object as usize];
            let message = format!("object {name:?}: attributes of one primitive differ in number of elements");
            return Err(self.error(message));
        }
        let colors = match primitive.get(&Semantic::Colors(0)) {
            Some(accessor) if accessor.dimensions() == Dimensions::Vec4 => {
                let colors = self.buffers.vectors::<4>(&accessor, "COLOR")?;
                Some(colors.into_iter().map(|[r, g, b, _]| [r, g, b]).collect())
            }
            Some(accessor) => Some(self.buffers.vectors::<3>(&accessor, "COLOR")?),
            None => None,
        };
        if colors.as_ref().is_some_and(|colors| colors.len() != count) {
            let name = &self.scene.objects[object as usize];
            return Err(
                self.error(format!("object {name:?}: a primitive of {count} vertices has another number of colours"))
            );
        }
        let name = &self.scene.objects[object as usize];
        let targets = self.targets(primitive, count, name)?;
        let skinned = match node.skin().map(|skin| skin.index()) {
            Some(skin) => self.skinned(primitive, count, (skin, self.skins[skin].joints.len()), name)?,
            None => None,
        };
        let indices = match primitive.indices() {
            Some(accessor) => self.buffers.indices(&accessor, count)?,
            None => (0..count as u32).collect(),
        };
        let material = self.material(&material)?;

        let first = self.positions.len();
        if first + count > u32::MAX as usize {
            return Err(self.error(String::from("more than 2^32 vertices; split the model")));
        }
        if let Some(colors) = colors {
            // Vertices without colours are white.
            self.scene.colors.resize(first, Vec3::ONE);
            self.scene.colors.extend(colors.into_iter().map(|c| Vec3::from_array(c).clamp(Vec3::ZERO, Vec3::ONE)));
        } else if !self.scene.colors.is_empty() {
            self.scene.colors.resize(first + count, Vec3::ONE);
        }
        if let (Some(map), Some(uvs)) = (maps.second, second_uvs) {
            self.scene.second_uvs.resize(first, Vec2::ZERO);
            self.scene.second_uvs.extend(uvs.into_iter().map(|uv| map.apply(Vec2::from_array(uv))));
        } else if !self.scene.second_uvs.is_empty() {
            self.scene.second_uvs.resize(first + count, Vec2::ZERO);
        }
        if let Some(uvs) = lightmap_uvs {
            self.scene.lightmap_uvs.resize(first, Vec2::NEG_ONE);
            self.scene.lightmap_uvs.extend(uvs.into_iter().map(Vec2::from_array));
        } else if !self.scene.lightmap_uvs.is_empty() {
            self.scene.lightmap_uvs.resize(first + count, Vec2::NEG_ONE);
        }
        let vectors = |of: Vec<[f32; 3]>| of.into_iter().map(Vec3::from_array).collect();
        let (positions, normals) = (vectors(positions), vectors(normals));
        let (node, mirrored) = (node.index(), false);
        let mut part = Part { node, instance, first, positions, normals, targets, skinned, mirrored };
        let transforms = part.transforms(&self.worlds, &self.skins);
        // Of a skin what most joints do.
        let turns: f64 = transforms.iter().map(|t| t.determinant()).filter(|d| *d != 0.0).map(f64::signum).sum();
        part.mirrored = turns < 0.0;
        let mirrored = part.mirrored;
        let (positions, normals) = part.place(&transforms, weights);
        let has_normal: Vec<bool> = normals.iter().map(|n| *n != Vec3::ZERO).collect();
        self.positions.extend(positions);
        self.scene.normals.extend(normals.into_iter().map(|n| if n == Vec3::ZERO { Vec3::Y } else { n }));
        self.scene.uvs.extend(uvs.into_iter().map(|uv| maps.first.apply(Vec2::from_array(uv))));
        if self.document.animations().len() > 0 {
            self.parts.push(part);
        }
        let first = first as u32;
        for mut corners in assemble(primitive.mode(), &indices) {
            if mirrored {
                corners.swap(1, 2);
            }
            let smooth = corners.iter().all(|&v| has_normal[v as usize]);
            let vertices = corners.map(|v| first + v);
            self.scene.triangles.push(Triangle { vertices, material, object, smooth });
        }
        Ok(())
    }

    fn light(&mut self, node: &Node, light: &gltf::khr_lights_punctual::Light, world: DMat4) {
        // Relative to its place, until the scene has its origin.
        let (place, position) = (world.w_axis.truncate(), Vec3::ZERO);
        if let Some(exact) = ours::<VirtualExtras>(node.extras()) {
            self.lights.push(place);
            let VirtualExtras { normal, power, exponent, .. } = exact;
            self.scene.lights.push(Light::Imported { position, normal, power, exponent });
            return;
        }
        let intensity = Vec3::from_array(light.color()) * light.intensity() * self.light_scale;
        if intensity == Vec3::ZERO {
            self.leave_out("lights of no intensity");
            return;
        }
        let direction = world.transform_vector3(DVec3::NEG_Z).as_vec3().normalize_or_zero();
        self.nodes_of_lights.push((self.lights.len(), node.index()));
        self.lights.push(place);
        self.scene.lights.push(match light.kind() {
            Kind::Point => Light::Point { position, intensity },
            Kind::Directional => Light::Directional { direction, irradiance: intensity },
            Kind::Spot { inner_cone_angle: inner, outer_cone_angle: outer } => {
                // The checks of ranges refuse a number that is no angle.
                let outer = if outer.is_finite() { outer.min(FRAC_PI_2) } else { outer };
                Light::Spot { position, direction, intensity, inner, outer }
            }
        });
    }
}

/// Whether the lights of a document are in candela and lux: by the standard all are, but many programs write radiant
/// units. Blender writes either; a lamp of 1 W becomes 54 cd, and sunlight of 1 W/m^2 683 lx.
fn looks_photometric(path: &Path, document: &Document) -> bool {
    /// No lamp of a room is as strong in W/sr or W/m^2.
    const STRONG: f32 = 100.0;
    let generator = document.as_json().asset.generator.as_deref().unwrap_or("");
    let strongest = document.lights().into_iter().flatten().map(|light| light.intensity()).fold(0.0, f32::max);
    let is = generator.contains("Blender") && strongest >= STRONG;
    if is {
        log::warn!(
            "{}: its lights are taken to be in candela and lux, as Blender writes them, and divided by {EFFICACY} lm/W \
             (--photometric off, or photometric = false in a scene.toml, leaves them)",
            path.display()
        );
    }
    is
}

/// Corners of the triangles of a primitive.
fn assemble(mode: Mode, indices: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => {
            let turned = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
            indices.windows(3).enumerate().map(turned).collect()
        }
        Mode::TriangleFan => indices.windows(2).skip(1).map(|w| [w[0], w[1], indices[0]]).collect(),
        _ => indices.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
    }
}

/// A camera relative to its eye.
fn perspective(world: DMat4, fov_y: f32, aspect: Option<f32>) -> Camera {
    let width = aspect.map_or(640.0, |a| (480.0 * a).round().clamp(1.0, 4800.0));
    Camera {
        eye: Vec3::ZERO,
        target: world.transform_vector3(DVec3::NEG_Z).as_vec3().normalize_or_zero(),
        up: world.transform_vector3(DVec3::Y).as_vec3(),
        fov_y: fov_y.to_degrees(),
        resolution: [width as u32, 480],
        aperture: 0.0,
        focus: None,
        shutter: 0.0,
        height: None,
        frustum: None,
    }
}

/// An orthographic camera relative to its eye, with half of the width and height that it sees; near and far planes cut nothing off.
fn orthographic(world: DMat4, [half_width, half_height]: [f32; 2]) -> Camera {
    let aspect = (half_width / half_height).abs();
    Camera {
        height: Some(2.0 * half_height.abs()),
        ..perspective(world, Camera::default_fov().to_radians(), Some(aspect))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_their_orientation() {
        let indices = [0, 1, 2, 3, 4];
        assert_eq!(assemble(Mode::TriangleStrip, &indices), vec![[0, 1, 2], [2, 1, 3], [2, 3, 4]]);
        assert_eq!(assemble(Mode::TriangleFan, &indices), vec![[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
        assert_eq!(assemble(Mode::Triangles, &indices), vec![[0, 1, 2]]);
        assert!(assemble(Mode::TriangleFan, &[]).is_empty());
    }
}
