//! Scenes in Mitsuba's XML, versions 0.4 to 3: the subset that published scenes use. `docs/mitsuba.md` lists what is read, approximated and left out.
//!
//! Surfaces reflect on both sides, where Mitsuba's are black from behind unless `twosided`. Area lights emit from the front.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use glam::{Affine2, DMat4, DVec3, Vec3};

use super::mitsuba_bsdf::Look;
use super::mitsuba_shape::Mesh;
use super::mitsuba_xml::{Element, MAX_NESTING, read};
use super::{Light, Material, NamedCamera, Scene, Triangle, origin};
use crate::error::{Error, Result};
use crate::input::Inputs;
use crate::settings::Settings;

/// Memory of a vertex and of a triangle of the scene.
const VERTEX_BYTES: usize = 68;
const TRIANGLE_BYTES: usize = size_of::<Triangle>();

/// Reads a scene; the result is not validated yet.
pub(super) fn load(path: &Path, inputs: &Inputs) -> Result<Scene> {
    let root = read(path, inputs)?;
    let mut ids = HashMap::new();
    collect_ids(&root, &mut ids)?;
    for alias in root.children_of("alias") {
        let [id, other] = ["id", "as"].map(|name| alias.attribute(name));
        let (Some(id), Some(other)) = (id, other) else { return Err(alias.error("needs `id` and `as`")) };
        let element = *ids.get(id).ok_or_else(|| alias.error(format!("there is no {id:?}")))?;
        ids.insert(other, element);
    }
    let mut reader = Reader {
        path,
        inputs,
        ids,
        ignored: BTreeSet::new(),
        looks: HashMap::new(),
        textures: HashMap::new(),
        serialized: None,
        positions: Vec::new(),
        lights: Vec::new(),
        cameras: Vec::new(),
        scene: Scene::default(),
    };
    for element in &root.children {
        match element.tag.as_str() {
            "shape" => reader.shape(element, DMat4::IDENTITY)?,
            "emitter" | "luminaire" => reader.emitter(element)?,
            "sensor" | "camera" => reader.sensor(element)?,
            "integrator" => reader.integrator(element)?,
            "medium" => reader.leave_out("participating media"),
            // Definitions are read where they are referred to.
            _ => {}
        }
    }
    Ok(reader.finish())
}

fn collect_ids<'a>(element: &'a Element, ids: &mut HashMap<&'a str, &'a Element>) -> Result<()> {
    if !matches!(element.tag.as_str(), "ref" | "alias")
        && let Some(id) = element.attribute("id")
        && ids.insert(id, element).is_some()
    {
        return Err(element.error("another element has this id"));
    }
    element.children.iter().try_for_each(|child| collect_ids(child, ids))
}

pub(super) struct Reader<'a> {
    path: &'a Path,
    pub(super) inputs: &'a Inputs,
    ids: HashMap<&'a str, &'a Element>,
    ignored: BTreeSet<String>,
    /// Materials of the scene, by what they are made of.
    pub(super) looks: HashMap<(usize, [u32; 3], bool), Option<Look>>,
    pub(super) textures: HashMap<String, u32>,
    /// The last serialized file.
    pub(super) serialized: Option<(PathBuf, Vec<u8>)>,
    /// World positions of the scene's vertices and of its lights.
    positions: Vec<DVec3>,
    lights: Vec<DVec3>,
    /// Cameras, each relative to a point in world space.
    cameras: Vec<(DVec3, NamedCamera)>,
    pub(super) scene: Scene,
}

impl<'a> Reader<'a> {
    /// Notes something that the scene will not show.
    pub(super) fn leave_out(&mut self, what: impl Into<String>) {
        self.ignored.insert(what.into());
    }

    /// The element itself, or that which it refers to.
    pub(super) fn resolve(&self, element: &'a Element) -> Result<&'a Element> {
        let mut element = element;
        for _ in 0..MAX_NESTING {
            if element.tag != "ref" {
                return Ok(element);
            }
            let id = element.attribute("id").ok_or_else(|| element.error("no id"))?;
            element = self.ids.get(id).ok_or_else(|| element.error(format!("there is no {id:?}")))?;
        }
        Err(element.error("references go round in a circle"))
    }

    /// The first child of this tag, directly or by reference.
    pub(super) fn child(&self, element: &'a Element, tag: &str) -> Result<Option<&'a Element>> {
        for child in &element.children {
            if child.tag == tag || child.tag == "ref" {
                let child = self.resolve(child)?;
                if child.tag == tag {
                    return Ok(Some(child));
                }
            }
        }
        Ok(None)
    }

    /// A file that an element names, relative to its own file or else to that of the whole scene.
    pub(super) fn file(&self, element: &Element) -> Result<PathBuf> {
        let name = element.string("filename").ok_or_else(|| element.error("no filename"))?;
        let file = element.path(name);
        if crate::input::is_file(&file) {
            return Ok(file);
        }
        let other = self.path.parent().unwrap_or(Path::new("")).join(name.replace('\\', "/"));
        if crate::input::is_file(&other) {
            Ok(other)
        } else {
            Err(element.error(format!("file {} does not exist", file.display())))
        }
    }

    fn integrator(&mut self, element: &'a Element) -> Result<()> {
        if let Some(depth) = element.integer("max_depth")? {
            // Negative: no limit.
            let most = i64::from(Settings::MAX_DEPTH);
            let depth = if depth < 0 { most } else { depth.clamp(1, most) };
            self.scene.render.max_depth = Some(depth as u32);
        }
        Ok(())
    }

    /// Adds a light; `place` is where it stands in world space.
    pub(super) fn add_light(&mut self, place: DVec3, light: Light) {
        self.lights.push(place);
        self.scene.lights.push(light);
    }

    pub(super) fn add_camera(&mut self, place: DVec3, camera: NamedCamera) {
        self.cameras.push((place, camera));
    }

    /// Adds a shape, placed by a transform after its own: that of an instance.
    fn shape(&mut self, element: &'a Element, instance: DMat4) -> Result<()> {
        if element.kind() == "instance" {
            let group = self.child(element, "shape")?.filter(|group| group.kind() == "shapegroup");
            let group = group.ok_or_else(|| element.error("no shapegroup"))?;
            let placed = element.transform("to_world")?;
            for shape in group.children_of("shape").filter(|shape| shape.kind() != "instance") {
                self.shape(shape, placed)?;
            }
            return Ok(());
        }
        let emission = match self.child(element, "emitter")?.or(self.child(element, "luminaire")?) {
            Some(emitter) if emitter.kind() == "area" => self.radiance(emitter)?,
            Some(emitter) => {
                self.leave_out(format!("emitter {:?} of a shape", emitter.kind()));
                Vec3::ZERO
            }
            None => Vec3::ZERO,
        };
        let Some(mut mesh) = self.mesh(element)? else { return Ok(()) };
        if instance != DMat4::IDENTITY {
            mesh.place(instance);
            mesh.sphere = None;
        }
        let bsdf = self.child(element, "bsdf")?;
        let Some(look) = self.look(element, bsdf, emission, mesh.has_upright_uvs())? else { return Ok(()) };
        let object = self.scene.add_object(mesh.name.clone());
        if let (Some((center, radius)), true) = (mesh.sphere, emission != Vec3::ZERO) {
            let light = Light::Sphere { center: Vec3::ZERO, radius, radiance: emission, inward: mesh.inward, object };
            light.check().map_err(|m| element.error(m))?;
            self.add_light(center, light);
        }
        self.add_mesh(element, mesh, &look, object)
    }

    fn add_mesh(&mut self, element: &Element, mesh: Mesh, look: &Look, object: u32) -> Result<()> {
        let first = self.positions.len();
        let count = mesh.positions.len();
        let fits = first.checked_add(count).is_some_and(|all| u32::try_from(all).is_ok());
        if !fits {
            return Err(element.error("more than 2^32 vertices; split the scene"));
        }
        // Instances repeat a mesh: as it will be, in double precision meanwhile, with the triangles that the tree takes.
        self.inputs.take(self.path, (count * VERTEX_BYTES + mesh.triangles.len() * TRIANGLE_BYTES) as u64)?;
        if let Some(i) = mesh.positions.iter().position(|p| !p.as_vec3().is_finite()) {
            return Err(element.error(format!("vertex {i} is at {}", mesh.positions[i])));
        }
        self.positions.extend(&mesh.positions);
        let normal = |i: usize| mesh.normals.get(i).copied().unwrap_or(Vec3::Y);
        self.scene.normals.extend((0..count).map(normal));
        let map: Affine2 = look.map;
        let uv = |i: usize| mesh.uvs.get(i).map_or(glam::Vec2::ZERO, |&uv| map.transform_point2(uv));
        self.scene.uvs.extend((0..count).map(uv));
        if look.vertex_colors && !mesh.colors.is_empty() {
            self.scene.colors.resize(first, Vec3::ONE);
            self.scene.colors.extend(&mesh.colors);
        } else if !self.scene.colors.is_empty() {
            self.scene.colors.resize(first + count, Vec3::ONE);
        }
        let first = first as u32;
        let material = look.material;
        let triangle = |(corners, smooth): &([u32; 3], bool)| Triangle {
            vertices: corners.map(|v| first + v),
            material,
            object,
            smooth: *smooth,
        };
        self.scene.triangles.extend(mesh.triangles.iter().map(triangle));
        Ok(())
    }

    /// Adds a material and returns its index.
    pub(super) fn add_material(&mut self, element: &Element, material: Material) -> Result<u32> {
        material.check().map_err(|m| element.error(format!("material {:?}: {m}", material.name)))?;
        Ok(self.scene.add_material(material))
    }

    /// Chooses the scene's origin and places everything relative to it.
    fn finish(mut self) -> Scene {
        let low = self.positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = self.positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let mut scene = self.scene;
        scene.origin = origin::choose(low, high);
        scene.positions = self.positions.iter().map(|&p| scene.from_world(p)).collect();
        let origin = scene.origin;
        for (light, place) in scene.lights.iter_mut().zip(&self.lights) {
            let place = (*place - origin).as_vec3();
            match light {
                Light::Point { position, .. } | Light::Spot { position, .. } => *position = place,
                Light::Sphere { center, .. } => *center = place,
                Light::Directional { .. } | Light::Imported { .. } => {}
            }
        }
        for (place, mut named) in self.cameras {
            for point in [&mut named.camera.eye, &mut named.camera.target] {
                *point = (place - origin + point.as_dvec3()).as_vec3();
            }
            scene.cameras.push(named);
        }
        scene.camera = scene.cameras.first().map(|named| named.camera);
        if !self.ignored.is_empty() {
            let ignored: Vec<String> = std::mem::take(&mut self.ignored).into_iter().collect();
            log::warn!("{}: not supported, left out or approximated: {}", self.path.display(), ignored.join("; "));
            scene.ignored = ignored;
        }
        scene
    }
}

/// An error of a file beside the XML.
pub(super) fn within(path: &Path, message: impl Into<String>) -> Error {
    Error::file(path, message)
}
