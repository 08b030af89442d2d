//! glTF 2.0 models, `.gltf` and `.glb`.
//!
//! Nodes are flattened into world space; their transforms are composed in double precision. Each is single precision in
//! the file, as are vertices within their node, so that a far scene keeps its precision only if its distance is in a
//! node's translation. Used: triangles, strips and fans with normals and one set of texture coordinates;
//! metallic-roughness materials with KHR_materials_emissive_strength, _ior, _transmission and _volume (a thickness above
//! 0 makes a body of glass, else it is a pane); KHR_texture_transform; KHR_lights_punctual; the first perspective camera.
//! An emission texture is replaced by its average. Lobes too smooth for point lights become ideal mirrors.

use std::cell::Cell;
use std::collections::{BTreeSet, HashMap};
use std::f32::consts::FRAC_PI_2;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Once;

use glam::{DMat4, DVec3, Mat3, Vec2, Vec3};
use gltf::camera::Projection;
use gltf::json::extras::Extras;
use gltf::khr_lights_punctual::Kind;
use gltf::mesh::Mode;
use gltf::texture::WrappingMode;
use gltf::{Gltf, Node, Primitive, Semantic, buffer, image};
use serde::de::DeserializeOwned;

use super::export::{AssetExtras, CameraExtras, MaterialExtras, VirtualExtras};
use super::gltf_accessor::{Buffers, reason};
use super::{Camera, Light, MIN_ROUGHNESS, Material, Scene, Surface, Texture, Triangle, Wrap, origin};
use crate::error::{Error, Result};

/// Luminous efficacy that converts photometric to radiometric quantities, lm/W.
const EFFICACY: f32 = 683.0;

/// Reads a glTF file; the result is not validated yet.
///
/// With `photometric`, intensities are in candela and irradiances in lux (as Blender writes them), else in W.
pub(super) fn load(path: &Path, photometric: bool) -> Result<Scene> {
    let bytes = std::fs::read(path).map_err(Error::io("reading", path))?;
    // The glTF crate does not check everything in a file (indices inside extensions, percent signs in URIs).
    match quietly(|| read(path, &bytes, photometric)) {
        Ok(result) => result,
        Err(message) => Err(Error::file(path, format!("malformed glTF: {message}"))),
    }
}

/// Which texture coordinates a texture takes, and their transform.
#[derive(Clone, Copy, Debug, PartialEq)]
struct UvMap {
    set: u32,
    offset: Vec2,
    /// Radians, counter-clockwise where v points down.
    rotation: f32,
    scale: Vec2,
}

impl UvMap {
    fn of(info: &gltf::texture::Info) -> UvMap {
        let plain = UvMap { set: info.tex_coord(), offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE };
        info.texture_transform().map_or(plain, |t| UvMap {
            set: t.tex_coord().unwrap_or(plain.set),
            offset: Vec2::from_array(t.offset()),
            rotation: t.rotation(),
            scale: Vec2::from_array(t.scale()),
        })
    }

    /// That of the base colour, which the other textures of a material share, or if it has none that of roughness.
    fn of_material(material: &gltf::Material) -> UvMap {
        let pbr = material.pbr_metallic_roughness();
        let info = pbr.base_color_texture().or(pbr.metallic_roughness_texture());
        info.map_or(UvMap { set: 0, offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE }, |info| UvMap::of(&info))
    }

    fn apply(&self, uv: Vec2) -> Vec2 {
        let (sin, cos) = self.rotation.sin_cos();
        let uv = uv * self.scale;
        self.offset + Vec2::new(cos * uv.x + sin * uv.y, cos * uv.y - sin * uv.x)
    }
}

/// Runs `f` and returns a panic's message instead of printing it.
fn quietly<T>(f: impl FnOnce() -> T) -> Result<T, String> {
    thread_local!(static QUIET: Cell<bool> = const { Cell::new(false) });
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let previous = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !QUIET.get() {
                previous(info);
            }
        }));
    });
    QUIET.set(true);
    let result = catch_unwind(AssertUnwindSafe(f));
    QUIET.set(false);
    result.map_err(|payload| {
        let text = payload.downcast_ref::<String>().map(String::as_str);
        text.or(payload.downcast_ref::<&str>().copied()).unwrap_or("unknown reason").to_string()
    })
}

fn read(path: &Path, bytes: &[u8], photometric: bool) -> Result<Scene> {
    let Gltf { document, blob } = Gltf::from_slice(bytes).map_err(|e| Error::file(path, reason(&e)))?;
    let mut reader = Reader {
        path,
        buffers: Buffers::read(path, &document, blob)?,
        light_scale: if photometric { 1.0 / EFFICACY } else { 1.0 },
        materials: HashMap::new(),
        textures: HashMap::new(),
        ignored: BTreeSet::new(),
        positions: Vec::new(),
        lights: Vec::new(),
        eye: DVec3::ZERO,
        scene: Scene::default(),
    };
    if let Some(extras) = ours::<AssetExtras>(&document.as_json().asset.extras) {
        reader.scene.emitters_are_lights = !extras.lights_exported;
    }
    let roots: Vec<Node> = match document.default_scene().or_else(|| document.scenes().next()) {
        Some(scene) => scene.nodes().collect(),
        None => {
            let children: BTreeSet<usize> = document.nodes().flat_map(|n| n.children().map(|c| c.index())).collect();
            document.nodes().filter(|n| !children.contains(&n.index())).collect()
        }
    };
    // An explicit stack: a chain of nodes may be deeper than the thread's stack.
    let mut stack: Vec<(Node, DMat4)> = roots.into_iter().rev().map(|n| (n, DMat4::IDENTITY)).collect();
    let mut visited = vec![false; document.nodes().len()];
    while let Some((node, parent)) = stack.pop() {
        if std::mem::replace(&mut visited[node.index()], true) {
            return Err(Error::file(path, format!("node {} has two parents or is its own ancestor", node.index())));
        }
        let own = node.transform().matrix().map(|column| column.map(f64::from));
        let world = parent * DMat4::from_cols_array_2d(&own);
        if !world.as_mat4().is_finite() {
            return Err(Error::file(path, format!("node {}: its transform is not finite", node.index())));
        }
        reader.node(&node, world)?;
        let children: Vec<Node> = node.children().collect();
        stack.extend(children.into_iter().rev().map(|n| (n, world)));
    }
    if !reader.ignored.is_empty() {
        let ignored: Vec<&str> = reader.ignored.iter().copied().collect();
        log::warn!("{}: not supported and left out: {}", path.display(), ignored.join("; "));
        reader.scene.ignored = ignored.into_iter().map(String::from).collect();
    }
    Ok(reader.finish())
}

/// The exporter's data in an object's `extras.lightsum`.
fn ours<T: DeserializeOwned>(extras: &Extras) -> Option<T> {
    let mut value: serde_json::Value = serde_json::from_str(extras.as_ref()?.get()).ok()?;
    serde_json::from_value(value.get_mut("lightsum")?.take()).ok()
}

/// A texture is read once for each use of an image: index, sRGB, wrap modes.
type TextureKey = (usize, bool, [u32; 2]);

struct Reader<'a> {
    path: &'a Path,
    buffers: Buffers<'a>,
    light_scale: f32,
    materials: HashMap<Option<usize>, u32>,
    textures: HashMap<TextureKey, u32>,
    ignored: BTreeSet<&'static str>,
    /// World positions of the scene's vertices and of its lights, and the point to which the camera is relative.
    positions: Vec<DVec3>,
    lights: Vec<DVec3>,
    eye: DVec3,
    scene: Scene,
}

impl Reader<'_> {
    fn error(&self, message: String) -> Error {
        Error::file(self.path, message)
    }

    /// Chooses the scene's origin and places everything relative to it.
    fn finish(mut self) -> Scene {
        let low = self.positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = self.positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        self.scene.origin = origin::choose(low, high);
        self.scene.positions = self.positions.iter().map(|&p| self.scene.from_world(p)).collect();
        for (light, place) in self.scene.lights.iter_mut().zip(&self.lights) {
            if let Light::Point { position, .. } | Light::Spot { position, .. } | Light::Imported { position, .. } =
                light
            {
                *position = (*place - self.scene.origin).as_vec3();
            }
        }
        if let Some(camera) = &mut self.scene.camera {
            for point in [&mut camera.eye, &mut camera.target] {
                *point = (self.eye - self.scene.origin + point.as_dvec3()).as_vec3();
            }
        }
        self.scene
    }

    fn node(&mut self, node: &Node, world: DMat4) -> Result<()> {
        if let Some(mesh) = node.mesh() {
            if node.skin().is_some() {
                self.ignored.insert("skins (the mesh is shown as it stands)");
            }
            let name = node.name().or(mesh.name()).map_or_else(|| format!("node {}", node.index()), str::to_string);
            let object = self.scene.add_object(name);
            for primitive in mesh.primitives() {
                self.primitive(&primitive, world, object)?;
            }
        }
        if let Some(light) = node.light() {
            self.light(node, &light, world);
        }
        if let (Some(camera), None) = (node.camera(), self.scene.camera) {
            match camera.projection() {
                Projection::Perspective(p) => {
                    let exact = ours::<CameraExtras>(camera.extras());
                    self.eye = exact.as_ref().map_or(world.w_axis.truncate(), |e| e.origin);
                    let camera = exact.map(|e| e.camera);
                    self.scene.camera = Some(camera.unwrap_or_else(|| perspective(world, p.yfov(), p.aspect_ratio())));
                }
                Projection::Orthographic(_) => {
                    self.ignored.insert("orthographic cameras");
                }
            }
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: &Primitive, world: DMat4, object: u32) -> Result<()> {
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            self.ignored.insert("points and lines");
            return Ok(());
        }
        let Some(positions) = primitive.get(&Semantic::Positions) else { return Ok(()) };
        let positions = self.buffers.vectors::<3>(&positions, "POSITION")?;
        let count = positions.len();
        let material = primitive.material();
        let map = UvMap::of_material(&material);
        let uvs = match primitive.get(&Semantic::TexCoords(map.set)) {
            Some(accessor) => self.buffers.vectors::<2>(&accessor, "TEXCOORD")?,
            None => vec![[0.0; 2]; count],
        };
        let normals = match primitive.get(&Semantic::Normals) {
            Some(accessor) => self.buffers.vectors::<3>(&accessor, "NORMAL")?,
            None => vec![[0.0; 3]; count],
        };
        if uvs.len() != count || normals.len() != count {
            let name = &self.scene.objects[object as usize];
            let message = format!("object {name:?}: attributes of one primitive differ in number of elements");
            return Err(self.error(message));
        }
        if primitive.get(&Semantic::Colors(0)).is_some() {
            self.ignored.insert("vertex colours");
        }
        if primitive.morph_targets().next().is_some() {
            self.ignored.insert("morph targets");
        }
        let indices = match primitive.indices() {
            Some(accessor) => self.buffers.indices(&accessor, count)?,
            None => (0..count as u32).collect(),
        };
        let material = self.material(&material)?;

        let first = self.positions.len();
        if first + count > u32::MAX as usize {
            return Err(self.error(String::from("more than 2^32 vertices; split the model")));
        }
        let first = first as u32;
        let linear = Mat3::from_mat4(world.as_mat4());
        // The cofactor matrix is the inverse transpose up to a factor, and exists for any matrix.
        let cofactors = Mat3::from_cols(
            linear.y_axis.cross(linear.z_axis),
            linear.z_axis.cross(linear.x_axis),
            linear.x_axis.cross(linear.y_axis),
        );
        let mirrored = linear.determinant() < 0.0;
        let in_place = world == DMat4::IDENTITY;
        let mut has_normal = Vec::with_capacity(count);
        for ((p, n), uv) in positions.into_iter().zip(normals).zip(uvs) {
            let (p, n) = (Vec3::from_array(p).as_dvec3(), Vec3::from_array(n));
            let p = if in_place { p } else { world.transform_point3(p) };
            let n = match (in_place && n.is_normalized(), mirrored) {
                (true, _) => n,
                (false, false) => (cofactors * n).normalize_or_zero(),
                (false, true) => (-(cofactors * n)).normalize_or_zero(),
            };
            has_normal.push(n != Vec3::ZERO);
            self.positions.push(p);
            self.scene.normals.push(if n == Vec3::ZERO { Vec3::Y } else { n });
            self.scene.uvs.push(map.apply(Vec2::from_array(uv)));
        }
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

    fn material(&mut self, material: &gltf::Material) -> Result<u32> {
        if let Some(&index) = self.materials.get(&material.index()) {
            return Ok(index);
        }
        let pbr = material.pbr_metallic_roughness();
        let [r, g, b, _] = pbr.base_color_factor();
        let base_texture = match pbr.base_color_texture() {
            Some(info) => Some(self.texture(&info.texture(), true)?),
            None => None,
        };
        let metallic_roughness_texture = match pbr.metallic_roughness_texture() {
            Some(info) => {
                if UvMap::of(&info) != UvMap::of_material(material) {
                    self.ignored.insert("a second set of texture coordinates, or another transform of them");
                }
                Some(self.texture(&info.texture(), false)?)
            }
            None => None,
        };
        let mut emission = Vec3::from_array(material.emissive_factor()) * material.emissive_strength().unwrap_or(1.0);
        if let Some(info) = material.emissive_texture()
            && emission != Vec3::ZERO
        {
            self.ignored.insert("the pattern of emission textures (their average is used)");
            let texture = self.texture(&info.texture(), true)?;
            emission *= self.scene.textures[texture as usize].average();
        }
        if material.normal_texture().is_some() {
            self.ignored.insert("normal maps");
        }
        if material.alpha_mode() != gltf::material::AlphaMode::Opaque {
            self.ignored.insert("alpha (such surfaces are opaque)");
        }
        let ior = material.ior().unwrap_or(1.5);
        let transmission = material.transmission().map_or(0.0, |t| t.transmission_factor());
        // KHR_materials_volume: a surface without thickness has no inside.
        let thin = material.volume().is_none_or(|v| v.thickness_factor() == 0.0);
        // 1 is the default of a file without roughness.
        let roughens = transmission >= 0.5 && thin && pbr.roughness_factor() < 1.0;
        let name = match (material.name(), material.index()) {
            (Some(name), _) => name.to_string(),
            (None, Some(index)) => format!("material {index}"),
            (None, None) => String::from("default"),
        };
        let mut converted = Material {
            name,
            surface: if transmission >= 0.5 { Surface::Glass } else { Surface::Opaque },
            base_color: Vec3::new(r, g, b),
            base_texture,
            metallic: pbr.metallic_factor(),
            roughness: pbr.roughness_factor(),
            metallic_roughness_texture,
            // KHR_materials_ior: an index of 0 means full reflection, as does the formula.
            specular: Vec3::splat(((ior - 1.0) / (ior + 1.0)).powi(2)),
            emission,
            two_sided: material.double_sided(),
            ior: if ior == 0.0 { 1.5 } else { ior },
            thin,
            frost: if roughens { pbr.roughness_factor() } else { 0.0 },
            reflector: None,
            lobe: None,
        };
        if converted.surface == Surface::Opaque
            && metallic_roughness_texture.is_none()
            && converted.roughness < MIN_ROUGHNESS
        {
            converted.surface = Surface::Mirror;
        }
        if let Some(exact) = ours::<MaterialExtras>(material.extras()) {
            exact.apply(&mut converted);
        } else if converted.surface != Surface::Glass {
            converted.limit_albedo();
        }
        let index = self.scene.add_material(converted);
        self.materials.insert(material.index(), index);
        Ok(index)
    }

    fn texture(&mut self, texture: &gltf::Texture, srgb: bool) -> Result<u32> {
        let image = texture.source();
        let sampler = texture.sampler();
        let modes = [sampler.wrap_s(), sampler.wrap_t()];
        let key = (image.index(), srgb, modes.map(|m| m.as_gl_enum()));
        if let Some(&index) = self.textures.get(&key) {
            return Ok(index);
        }
        let wrap = modes.map(|mode| match mode {
            WrappingMode::Repeat => Wrap::Repeat,
            WrappingMode::MirroredRepeat => Wrap::Mirror,
            WrappingMode::ClampToEdge => Wrap::Clamp,
        });
        let numbered = || format!("image {}", image.index());
        let failed = |name: &str, why: String| Error::file(self.path, format!("texture {name}: {why}"));
        let (name, decoded) = match image.source() {
            image::Source::View { view, .. } => {
                let name = image.name().map_or_else(numbered, str::to_string);
                let decoded = Texture::decode(self.buffers.view(&view)?, name.clone(), srgb, wrap);
                (name, decoded)
            }
            image::Source::Uri { uri, .. } => {
                let name = if uri.starts_with("data:") { numbered() } else { uri.to_string() };
                // A buffer source reads files and data URIs alike.
                let bytes = buffer::Data::from_source(buffer::Source::Uri(uri), self.path.parent())
                    .map_err(|e| failed(&name, reason(&e)))?;
                let decoded = Texture::decode(&bytes, name.clone(), srgb, wrap);
                (name, decoded)
            }
        };
        let texture = decoded.map_err(|why| failed(&name, why))?;
        self.scene.textures.push(texture);
        let index = self.scene.textures.len() as u32 - 1;
        self.textures.insert(key, index);
        Ok(index)
    }

    fn light(&mut self, node: &Node, light: &gltf::khr_lights_punctual::Light, world: DMat4) {
        // Relative to its place, until the scene has its origin.
        let (place, position) = (world.w_axis.truncate(), Vec3::ZERO);
        if let Some(exact) = ours::<VirtualExtras>(node.extras()) {
            self.lights.push(place);
            self.scene.lights.push(Light::Imported { position, normal: exact.normal, power: exact.power });
            return;
        }
        let intensity = Vec3::from_array(light.color()) * light.intensity() * self.light_scale;
        if intensity == Vec3::ZERO {
            self.ignored.insert("lights of no intensity");
            return;
        }
        let direction = world.transform_vector3(DVec3::NEG_Z).as_vec3().normalize_or_zero();
        self.lights.push(place);
        self.scene.lights.push(match light.kind() {
            Kind::Point => Light::Point { position, intensity },
            Kind::Directional => Light::Directional { direction, irradiance: intensity },
            Kind::Spot { inner_cone_angle: inner, outer_cone_angle: outer } => {
                Light::Spot { position, direction, intensity, inner, outer: outer.min(FRAC_PI_2) }
            }
        });
    }
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

    #[test]
    fn a_panic_becomes_a_message() {
        assert_eq!(quietly(|| panic!("number {}", 7)), Err::<(), _>(String::from("number 7")));
        assert_eq!(quietly(|| 3), Ok(3));
    }
}
