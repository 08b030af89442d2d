//! Scenes built in memory: by hosts, object by object, and by what the crate itself adds to a scene.

use std::path::Path;
use std::sync::Arc;

use glam::{Affine3A, Vec2, Vec3};

use super::{Camera, Environment, Light, Material, Mesh, Scene, Surface, Texture, Triangle};
use crate::error::{Error, Result};

/// Builds a scene in memory, and checks each part as it comes: errors name the object, material, texture or light.
///
/// ```
/// use lightsum::glam::{Affine3A, Vec3};
/// use lightsum::scene::{Material, Mesh, SceneBuilder};
///
/// # fn main() -> lightsum::Result<()> {
/// let mut builder = SceneBuilder::new("a lamp above a floor");
/// let grey = builder.material(Material { name: "grey".into(), base_color: Vec3::splat(0.5), ..Material::default() })?;
/// let lamp = builder.material(Material { name: "lamp".into(), emission: Vec3::splat(10.0), ..Material::default() })?;
/// let corners = [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]].map(|[x, z]| Vec3::new(x, 0.0, z));
/// let square = Mesh::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]]);
/// builder.object("floor", &square, grey, Affine3A::from_scale(Vec3::splat(5.0)))?;
/// // Mirrored, it looks down: fronts are mirrored with all else.
/// let above = Affine3A::from_translation(Vec3::Y * 3.0) * Affine3A::from_scale(Vec3::new(1.0, -1.0, 1.0));
/// builder.object("lamp", &square, lamp, above)?;
/// let scene = builder.build()?;
/// assert_eq!(scene.triangles.len(), 4);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, Default)]
pub struct SceneBuilder(Scene);

impl SceneBuilder {
    /// An empty scene; messages name it.
    pub fn new(name: impl Into<String>) -> SceneBuilder {
        SceneBuilder(Scene { name: name.into(), ..Scene::default() })
    }

    /// Adds a texture and returns its index. Errors: its texels are not as many as its size says.
    pub fn texture(&mut self, texture: Texture) -> Result<u32> {
        texture.check().map_err(Error::Scene)?;
        self.0.textures.push(texture);
        Ok(self.0.textures.len() as u32 - 1)
    }

    /// Adds a material and returns its index. One that reflects more than it receives is scaled down, as when a file is read. Errors: a
    /// value out of range; a texture that has not been added.
    pub fn material(&mut self, material: Material) -> Result<u32> {
        self.0.checked_material(material).map(|material| self.0.add_material(material))
    }

    /// Adds an object of one material, placed by a transform, and returns its index. A transform that mirrors keeps fronts on the same
    /// side of the surface.
    ///
    /// Errors: indices out of range, numbers that are not finite, arrays of different lengths, no triangle with an area, a transform that
    /// flattens it, a material that does not exist.
    pub fn object(&mut self, name: &str, mesh: &Mesh, material: u32, transform: Affine3A) -> Result<u32> {
        self.0.append(name, mesh, material, transform)
    }

    /// Adds a light that is no surface and returns its index. The surface of a sphere light is an object of its own, which comes first.
    /// Errors: a value out of range.
    pub fn light(&mut self, light: Light) -> Result<u32> {
        let index = self.0.lights.len();
        light.check().map_err(|message| Error::Scene(format!("light {index}: {message}")))?;
        self.0.lights.push(light);
        Ok(index as u32)
    }

    /// Sets the light from all around.
    pub fn environment(&mut self, environment: Environment) {
        self.0.environment = Some(Arc::new(environment));
    }

    /// Sets the scene's own camera. An engine may be given any other. Errors: it has no view.
    pub fn camera(&mut self, camera: Camera) -> Result<()> {
        camera.check().map_err(|message| Error::Scene(format!("camera: {message}")))?;
        self.0.camera = Some(camera);
        Ok(())
    }

    /// The scene. Errors: no triangles, no light.
    pub fn build(mut self) -> Result<Scene> {
        let name = self.0.name.clone();
        let of_memory = |error| match error {
            Error::File { message, .. } => Error::Scene(format!("{name:?}: {message}")),
            error => error,
        };
        self.0.validate(Path::new(&name)).map_err(of_memory)?;
        Ok(self.0)
    }
}

impl Scene {
    /// A material as the scene takes it: in range, with textures that the scene has, and reflecting no more than it receives.
    pub(crate) fn checked_material(&self, mut material: Material) -> Result<Material> {
        let wrong = |message: String| Error::Scene(format!("material {:?}: {message}", material.name));
        material.check().map_err(wrong)?;
        if let Some(texture) = material.textures().find(|&t| t as usize >= self.textures.len()) {
            let count = self.textures.len();
            return Err(wrong(format!("texture {texture} does not exist, there are {count}")));
        }
        if material.surface != Surface::Glass {
            material.limit_albedo();
        }
        Ok(material)
    }

    /// Adds a material and returns its index.
    pub(crate) fn add_material(&mut self, material: Material) -> u32 {
        self.materials.push(material);
        self.materials.len() as u32 - 1
    }

    /// Adds an object's name and returns its index.
    pub(crate) fn add_object(&mut self, name: impl Into<String>) -> u32 {
        self.objects.push(name.into());
        self.objects.len() as u32 - 1
    }

    /// Notes what a file holds and the loader leaves out.
    pub(super) fn leave_out(&mut self, what: String) {
        if !self.ignored.contains(&what) {
            self.ignored.push(what);
        }
    }

    /// Adds a flat-shaded mesh.
    pub(super) fn add_mesh(&mut self, points: &[Vec3], faces: &[[u32; 3]], material: u32, object: u32) {
        let first = self.positions.len() as u32;
        self.positions.extend_from_slice(points);
        self.normals.resize(self.positions.len(), Vec3::Y);
        self.uvs.resize(self.positions.len(), Vec2::ZERO);
        if !self.second_uvs.is_empty() {
            self.second_uvs.resize(self.positions.len(), Vec2::ZERO);
        }
        if !self.lightmap_uvs.is_empty() {
            self.lightmap_uvs.resize(self.positions.len(), Vec2::NEG_ONE);
        }
        if !self.colors.is_empty() {
            self.colors.resize(self.positions.len(), Vec3::ONE);
        }
        self.triangles.extend(faces.iter().map(|face| Triangle {
            vertices: face.map(|v| first + v),
            material,
            object,
            smooth: false,
        }));
    }

    /// Adds a parallelogram; its front is the side to which cross(edge_u, edge_v) points.
    pub(crate) fn add_quad(&mut self, corner: Vec3, edge_u: Vec3, edge_v: Vec3, material: u32, object: u32) {
        let points = [corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v];
        self.add_mesh(&points, &[[0, 1, 2], [0, 2, 3]], material, object);
    }

    /// Adds a box between two corners whose faces look outwards, or inwards for a room.
    pub(super) fn add_box(&mut self, low: Vec3, high: Vec3, inward: bool, material: u32, object: u32) {
        let size = high - low;
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let edge = |k: usize| Vec3::AXES[k] * size[k];
            for (corner, at_high) in [(low, false), (low + edge(axis), true)] {
                // cross(edge u, edge v) points along the axis: outwards only at the high end.
                let (first, second) = if at_high != inward { (u, v) } else { (v, u) };
                self.add_quad(corner, edge(first), edge(second), material, object);
            }
        }
    }
}
