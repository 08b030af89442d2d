//! Meshes of objects that are added to a scene in memory.

use glam::{Affine3A, Mat3A, Vec2, Vec3};

use super::posed::normal_matrix;
use super::validate::is_degenerate;
use super::{Scene, Triangle};
use crate::error::{Error, Result};

/// Triangles of an object, in coordinates of its own. Vertices run counter-clockwise about the front of a triangle.
#[non_exhaustive]
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions of the vertices.
    pub positions: Vec<Vec3>,
    /// Corners of the triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Unit normals of the vertices; empty: triangles are flat.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, as [`Scene::uvs`]; empty: zero.
    pub uvs: Vec<Vec2>,
    /// Second texture coordinates; empty: there are none.
    pub second_uvs: Vec<Vec2>,
    /// Factors of the base colour, as [`Scene::colors`]; empty: 1.
    pub colors: Vec<Vec3>,
}

impl Mesh {
    /// A mesh of flat triangles without texture coordinates; set the other fields as needed.
    pub fn new(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Mesh {
        Mesh { positions, triangles, ..Mesh::default() }
    }

    /// The message does not name the object.
    fn check(&self) -> Result<(), String> {
        let count = self.positions.len();
        let lengths = [
            ("normals", self.normals.len()),
            ("texture coordinates", self.uvs.len()),
            ("second texture coordinates", self.second_uvs.len()),
            ("vertex colours", self.colors.len()),
        ];
        if let Some((what, given)) = lengths.into_iter().find(|(_, given)| *given != 0 && *given != count) {
            return Err(format!("{count} positions and {given} {what} should be of one number"));
        }
        if self.triangles.is_empty() {
            return Err(String::from("it has no triangles"));
        }
        let beyond = |corner: &u32| *corner as usize >= count;
        for (i, triangle) in self.triangles.iter().enumerate() {
            if let Some(vertex) = triangle.iter().find(|corner| beyond(corner)) {
                return Err(format!("triangle {i}: vertex {vertex} does not exist, there are {count}"));
            }
        }
        if let Some(v) = self.positions.iter().position(|p| !p.is_finite()) {
            return Err(format!("vertex {v} is at {}", self.positions[v]));
        }
        if let Some(v) = self.normals.iter().position(|n| !n.is_normalized()) {
            return Err(format!("normal {} of vertex {v} is not of unit length", self.normals[v]));
        }
        let uvs = self.uvs.iter().chain(&self.second_uvs);
        if let Some(uv) = uvs.into_iter().find(|uv| !uv.is_finite()) {
            return Err(format!("texture coordinate {uv} is not finite"));
        }
        if let Some(v) = self.colors.iter().position(|c| !(c.min_element() >= 0.0 && c.max_element() <= 1.0)) {
            return Err(format!("the colour of vertex {v}, {}, must be in [0, 1]", self.colors[v]));
        }
        Ok(())
    }
}

/// Whether a transform turns right-handed axes into left-handed ones.
pub(crate) fn mirrors(transform: &Affine3A) -> bool {
    transform.matrix3.determinant() < 0.0
}

/// The message does not name the object.
pub(crate) fn check_transform(transform: &Affine3A) -> Result<(), String> {
    let determinant = transform.matrix3.determinant();
    if !transform.is_finite() || !determinant.is_finite() {
        return Err(format!("its transform is not finite: {transform}"));
    }
    if !determinant.is_normal() {
        return Err(format!("its transform leaves it without volume (determinant {determinant})"));
    }
    Ok(())
}

/// The matrix that turns normals of surfaces that a transform moves, up to a factor above 0, so that they stay on the same side.
pub(crate) fn outward_matrix(matrix: &Mat3A) -> Mat3A {
    let sign = if matrix.determinant() < 0.0 { -1.0 } else { 1.0 };
    normal_matrix(matrix) * sign
}

/// Appends a mesh's values, or as many defaults, to an array that is empty if nothing has a value.
fn extend<T: Copy>(all: &mut Vec<T>, before: usize, values: &[T], count: usize, default: T) {
    if all.is_empty() && values.is_empty() {
        return;
    }
    all.resize(before, default);
    all.extend_from_slice(values);
    all.resize(before + count, default);
}

impl Scene {
    /// Appends an object, placed by a transform, and returns its index. Fronts stay fronts where the transform mirrors. Triangles without
    /// area are left out with a warning.
    ///
    /// Errors, which leave the scene unchanged, name the object.
    pub(crate) fn append(&mut self, name: &str, mesh: &Mesh, material: u32, transform: Affine3A) -> Result<u32> {
        let refused = |message: String| Error::Scene(format!("object {name:?}: {message}"));
        mesh.check().map_err(refused)?;
        check_transform(&transform).map_err(refused)?;
        let Some(of_object) = self.materials.get(material as usize) else {
            let count = self.materials.len();
            return Err(refused(format!("material {material} does not exist, there are {count}")));
        };
        if of_object.second_uvs.contains(&true) && mesh.second_uvs.is_empty() {
            let message = format!("material {:?} takes second texture coordinates, which it lacks", of_object.name);
            return Err(refused(message));
        }
        let emits = of_object.emission.max_element() > 0.0 && of_object.emission_texture.is_none();
        let (before, count) = (self.positions.len(), mesh.positions.len());
        if u32::try_from(before + count).is_err() {
            return Err(refused(String::from("the scene would have more than 2^32 vertices")));
        }
        let place = |p: &Vec3| if transform == Affine3A::IDENTITY { *p } else { transform.transform_point3(*p) };
        let positions: Vec<Vec3> = mesh.positions.iter().map(place).collect();
        if let Some(p) = positions.iter().find(|p| !p.is_finite()) {
            return Err(refused(format!("a vertex would be at {p}")));
        }
        let has_area = |corners: &[u32; 3]| !is_degenerate(corners.map(|v| positions[v as usize]));
        let kept: Vec<[u32; 3]> = mesh.triangles.iter().copied().filter(has_area).collect();
        let without = mesh.triangles.len() - kept.len();
        match (without, kept.is_empty(), emits) {
            (0, ..) => {}
            (_, true, _) => return Err(refused(String::from("no triangle has an area"))),
            (_, _, true) => return Err(refused(format!("{without} triangles without area cannot emit; remove them"))),
            _ => log::warn!("object {name:?}: {without} triangles of zero area are left out"),
        }

        let object = self.add_object(name);
        let outward = outward_matrix(&transform.matrix3);
        let turn = |n: &Vec3| if transform == Affine3A::IDENTITY { *n } else { (outward * *n).normalize_or(*n) };
        self.normals.extend(mesh.normals.iter().map(turn));
        self.normals.resize(before + count, Vec3::Y);
        self.positions.extend(positions);
        self.uvs.extend_from_slice(&mesh.uvs);
        self.uvs.resize(before + count, Vec2::ZERO);
        extend(&mut self.second_uvs, before, &mesh.second_uvs, count, Vec2::ZERO);
        extend(&mut self.lightmap_uvs, before, &[], count, Vec2::NEG_ONE);
        extend(&mut self.colors, before, &mesh.colors, count, Vec3::ONE);
        let (flips, smooth) = (mirrors(&transform), !mesh.normals.is_empty());
        self.triangles.extend(kept.into_iter().map(|[a, b, c]| {
            let corners = if flips { [a, c, b] } else { [a, b, c] };
            Triangle { vertices: corners.map(|v| before as u32 + v), material, object, smooth }
        }));
        Ok(object)
    }
}
