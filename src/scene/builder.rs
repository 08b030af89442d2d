//! Shapes added to a scene in memory.

use glam::{Vec2, Vec3};

use super::{Material, Scene, Triangle};

impl Scene {
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
