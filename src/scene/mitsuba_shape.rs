//! Shapes of Mitsuba's scenes as triangle meshes in world space.

use std::f32::consts::{PI, TAU};
use std::io::Read;
use std::path::Path;

use flate2::read::ZlibDecoder;
use glam::{DMat3, DMat4, DVec3, Vec2, Vec3};

use super::mitsuba::{Reader, within};
use super::mitsuba_xml::Element;
use super::tessellate::icosphere;
use super::{load_model, stem};
use crate::error::Result;
use crate::input::Inputs;

/// Subdivisions of the icosahedron that represents a sphere: 20,480 triangles.
const SPHERE_SUBDIVISIONS: u32 = 5;

/// Sides of the polygon that represents the circle of a disk or cylinder.
const CIRCLE_SIDES: u32 = 128;

/// A shape in world space.
pub(super) struct Mesh {
    pub(super) name: String,
    pub(super) positions: Vec<DVec3>,
    /// Unit length, of each position; empty: there are none.
    pub(super) normals: Vec<Vec3>,
    /// v runs downwards; of each position, or empty.
    pub(super) uvs: Vec<Vec2>,
    /// Linear; of each position, or empty.
    pub(super) colors: Vec<Vec3>,
    /// Corners, counter-clockwise seen from the front, and whether to shade with the normals.
    pub(super) triangles: Vec<([u32; 3], bool)>,
    /// The file wants flat faces.
    faceted: bool,
    /// Centre and radius, if the shape is a sphere.
    pub(super) sphere: Option<(DVec3, f32)>,
    /// The front of that sphere is inside.
    pub(super) inward: bool,
}

impl Mesh {
    fn new(name: String) -> Mesh {
        Mesh {
            name,
            positions: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            colors: Vec::new(),
            triangles: Vec::new(),
            faceted: false,
            sphere: None,
            inward: false,
        }
    }

    /// Whether u, v and the normal are a right-handed system on most of the area.
    pub(super) fn has_upright_uvs(&self) -> bool {
        if self.uvs.len() != self.positions.len() {
            return true;
        }
        let sign = |(corners, _): &([u32; 3], bool)| {
            let [a, b, c] = corners.map(|v| self.uvs[v as usize]);
            let [p, q, r] = corners.map(|v| self.positions[v as usize]);
            f64::from((b - a).perp_dot(c - a)).signum() * (q - p).cross(r - p).length()
        };
        self.triangles.iter().map(sign).sum::<f64>() >= 0.0
    }

    pub(super) fn place(&mut self, to_world: DMat4) {
        let linear = DMat3::from_mat4(to_world);
        let normal = linear.inverse().transpose();
        for p in &mut self.positions {
            *p = to_world.transform_point3(*p);
        }
        for n in &mut self.normals {
            *n = (normal * n.as_dvec3()).normalize_or(DVec3::Y).as_vec3();
        }
        if linear.determinant() < 0.0 && !self.normals.is_empty() {
            // The normals tell the front.
            self.turn();
        }
    }

    /// Reverses the order of all corners.
    fn turn(&mut self) {
        self.triangles.iter_mut().for_each(|(corners, _)| corners.swap(1, 2));
    }

    fn flip(&mut self) {
        self.turn();
        self.normals.iter_mut().for_each(|n| *n = -*n);
        self.inward = !self.inward;
    }

    /// Gives each vertex the mean normal of its triangles, weighted by their angles there (Thuermer and Wuethrich 1998).
    fn smooth(&mut self) {
        let mut sums = vec![DVec3::ZERO; self.positions.len()];
        for (corners, _) in &self.triangles {
            let at = corners.map(|v| self.positions[v as usize]);
            let normal = (at[1] - at[0]).cross(at[2] - at[0]).normalize_or_zero();
            for k in 0..3 {
                let (to, from) = (at[(k + 1) % 3] - at[k], at[(k + 2) % 3] - at[k]);
                if to != DVec3::ZERO && from != DVec3::ZERO {
                    sums[corners[k] as usize] += normal * to.angle_between(from);
                }
            }
        }
        let usable: Vec<bool> = sums.iter().map(|n| n.length() > 1e-6).collect();
        self.normals = sums.iter().map(|n| n.normalize_or(DVec3::Y).as_vec3()).collect();
        for (corners, smooth) in &mut self.triangles {
            *smooth = corners.iter().all(|&v| usable[v as usize]);
        }
    }

    /// Adds a grid of (columns + 1) x (rows + 1) vertices; triangles face the side from which columns run to the right of
    /// upward rows.
    fn grid(&mut self, [columns, rows]: [u32; 2], smooth: bool, vertex: impl Fn(u32, u32) -> (Vec3, Vec3, Vec2)) {
        let first = self.positions.len() as u32;
        for row in 0..=rows {
            for column in 0..=columns {
                let (p, n, uv) = vertex(column, row);
                self.positions.push(p.as_dvec3());
                self.normals.push(n);
                self.uvs.push(uv);
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let a = first + row * (columns + 1) + column;
                let (b, d) = (a + 1, a + columns + 1);
                self.triangles.extend([([a, b, d + 1], smooth), ([a, d + 1, d], smooth)]);
            }
        }
    }
}

impl<'a> Reader<'a> {
    /// The mesh of a shape; `None` if its kind is not read.
    pub(super) fn mesh(&mut self, element: &'a Element) -> Result<Option<Mesh>> {
        let mut to_world = element.transform("to_world")?;
        let name = element.attribute("id").map(str::to_string);
        let label = name.clone().unwrap_or_else(|| element.label());
        let mut mesh = match element.kind() {
            kind @ ("obj" | "ply") => {
                let file = self.file(element)?;
                let mut mesh = of_model(&file, self.inputs)?;
                mesh.name = name.unwrap_or_else(|| stem(&file));
                // The loader turned v upside down as OBJ files need it, and as PLY files do not.
                let keep = kind == "obj";
                let turn = match element.property("flip_tex_coords") {
                    Some(_) => element.boolean("flip_tex_coords")?,
                    None => keep,
                };
                if !turn {
                    mesh.uvs.iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
                }
                mesh
            }
            "serialized" => {
                let index = element.integer("shape_index")?.unwrap_or(0);
                let file = self.file(element)?;
                let bytes = match self.serialized.take() {
                    Some((path, bytes)) if path == file => bytes,
                    _ => self.inputs.read(&file)?,
                };
                let index = usize::try_from(index).map_err(|_| element.error("shape_index is negative"))?;
                let read = serialized(&file, &bytes, index);
                self.serialized = Some((file, bytes));
                let mut mesh = read?;
                mesh.name = label;
                mesh
            }
            "rectangle" => {
                let mut mesh = Mesh::new(label);
                side(&mut mesh, Vec3::ZERO, Vec3::Z, [Vec3::X, Vec3::Y]);
                mesh
            }
            "cube" => {
                let mut mesh = Mesh::new(label);
                // Each side's normal, and the directions in which its u and v grow.
                for (normal, u, v) in [
                    (Vec3::Z, Vec3::Y, Vec3::X),
                    (Vec3::X, Vec3::Y, -Vec3::Z),
                    (Vec3::Y, -Vec3::X, -Vec3::Z),
                    (-Vec3::Z, -Vec3::Y, Vec3::X),
                    (-Vec3::X, Vec3::Y, Vec3::Z),
                    (-Vec3::Y, Vec3::Z, Vec3::X),
                ] {
                    side(&mut mesh, normal, normal, [u, v]);
                }
                mesh
            }
            "disk" => {
                let mut mesh = Mesh::new(label);
                mesh.grid([CIRCLE_SIDES, 1], false, |column, row| {
                    let turn = column as f32 / CIRCLE_SIDES as f32;
                    let (sin, cos) = (TAU * turn).sin_cos();
                    // Rows run inwards, so that columns run to their right.
                    let radius = 1.0 - row as f32;
                    (Vec3::new(cos, sin, 0.0) * radius, Vec3::Z, Vec2::new(radius, turn))
                });
                // Each second triangle has no area: two of its corners are the centre.
                mesh.triangles = mesh.triangles.into_iter().step_by(2).collect();
                mesh
            }
            "sphere" => {
                let center = element.vector("center")?.unwrap_or(DVec3::ZERO);
                let radius = f64::from(element.number("radius")?.unwrap_or(1.0));
                if radius <= 0.0 {
                    return Err(element.error("the radius must be above 0"));
                }
                to_world *= DMat4::from_translation(center) * DMat4::from_scale(DVec3::splat(radius));
                let mut mesh = sphere(label);
                let axes = [to_world.x_axis, to_world.y_axis, to_world.z_axis].map(|axis| axis.truncate());
                let scale = axes[0].length();
                let skewed = axes.iter().any(|a| (a.length() - scale).abs() > 1e-4 * scale);
                let skewed = skewed || axes[0].dot(axes[1]).abs() + axes[1].dot(axes[2]).abs() > 1e-4 * scale * scale;
                if !skewed {
                    mesh.sphere = Some((to_world.w_axis.truncate(), scale as f32));
                }
                mesh
            }
            "cylinder" => {
                let p0 = element.vector("p0")?.unwrap_or(DVec3::ZERO);
                let p1 = element.vector("p1")?.unwrap_or(DVec3::Z);
                let radius = f64::from(element.number("radius")?.unwrap_or(1.0));
                let axis = p1 - p0;
                if radius <= 0.0 || axis == DVec3::ZERO {
                    return Err(element.error("radius and length must be above 0"));
                }
                let (u, v) = axis.normalize().any_orthonormal_pair();
                let frame = DMat4::from_cols(
                    (u * radius).extend(0.0),
                    (v * radius).extend(0.0),
                    axis.extend(0.0),
                    p0.extend(1.0),
                );
                // The standard cylinder needs no turn about its axis.
                let standard = p0 == DVec3::ZERO && axis.truncate() == glam::DVec2::ZERO && axis.z > 0.0;
                let upright = DMat4::from_scale(DVec3::new(radius, radius, axis.z));
                to_world *= if standard { upright } else { frame };
                let mut mesh = Mesh::new(label);
                mesh.grid([CIRCLE_SIDES, 1], true, |column, row| {
                    let turn = column as f32 / CIRCLE_SIDES as f32;
                    let (sin, cos) = (TAU * turn).sin_cos();
                    let normal = Vec3::new(cos, sin, 0.0);
                    (normal + Vec3::Z * row as f32, normal, Vec2::new(turn, row as f32))
                });
                mesh
            }
            "shapegroup" => return Ok(None),
            other => {
                self.leave_out(format!("shape {other:?}"));
                return Ok(None);
            }
        };
        let of_file = matches!(element.kind(), "obj" | "ply" | "serialized");
        if element.property("max_smooth_angle").is_some() {
            self.leave_out("max_smooth_angle of a shape (the normals of its file)");
        }
        let faceted = of_file && (mesh.faceted || element.boolean("face_normals")?);
        if faceted {
            mesh.normals.clear();
            mesh.triangles.iter_mut().for_each(|(_, smooth)| *smooth = false);
        }
        mesh.place(to_world);
        if of_file && !faceted && mesh.normals.is_empty() {
            mesh.smooth();
        }
        if element.boolean("flip_normals")? {
            mesh.flip();
        }
        Ok(Some(mesh))
    }
}

/// Adds a square of half edges u and v about a point, with texture coordinates that grow along them.
fn side(mesh: &mut Mesh, centre: Vec3, normal: Vec3, [u, v]: [Vec3; 2]) {
    let first = mesh.triangles.len();
    mesh.grid([1, 1], false, |column, row| {
        let uv = Vec2::new(column as f32, row as f32);
        let at = uv * 2.0 - 1.0;
        (centre + u * at.x + v * at.y, normal, uv)
    });
    if u.cross(v).dot(normal) < 0.0 {
        mesh.triangles[first..].iter_mut().for_each(|(corners, _)| corners.swap(1, 2));
    }
}

/// The unit sphere, with the azimuth about z as u and the angle from z as v. Triangles across the seam of u have vertices of
/// their own.
fn sphere(name: String) -> Mesh {
    let (points, faces) = icosphere(SPHERE_SUBDIVISIONS);
    let mut mesh = Mesh::new(name);
    let u = |p: Vec3| (p.y.atan2(p.x) / TAU).rem_euclid(1.0);
    for p in &points {
        mesh.positions.push(p.as_dvec3());
        mesh.normals.push(*p);
        mesh.uvs.push(Vec2::new(u(*p), p.z.clamp(-1.0, 1.0).acos() / PI));
    }
    for face in faces {
        let turns = face.map(|v| mesh.uvs[v as usize].x);
        let crosses = turns.iter().any(|a| turns.iter().any(|b| a - b > 0.5));
        let corners = face.map(|v| {
            let i = v as usize;
            if !crosses || mesh.uvs[i].x > 0.5 {
                return v;
            }
            mesh.positions.push(mesh.positions[i]);
            mesh.normals.push(mesh.normals[i]);
            mesh.uvs.push(mesh.uvs[i] + Vec2::X);
            mesh.positions.len() as u32 - 1
        });
        mesh.triangles.push((corners, true));
    }
    mesh
}

/// The triangles of a model, without its materials.
fn of_model(file: &Path, inputs: &Inputs) -> Result<Mesh> {
    let scene = load_model(file, None, inputs)?;
    let mut mesh = Mesh::new(String::new());
    mesh.positions = scene.positions.iter().map(|&p| scene.to_world(p)).collect();
    if scene.triangles.iter().any(|t| t.smooth) {
        mesh.normals = scene.normals;
    }
    mesh.uvs = scene.uvs;
    mesh.colors = scene.colors;
    mesh.triangles = scene.triangles.iter().map(|t| (t.vertices, t.smooth)).collect();
    Ok(mesh)
}

/// Reads one shape of a serialized file: a header, shapes deflated one by one, and a table of their places.
fn serialized(file: &Path, bytes: &[u8], index: usize) -> Result<Mesh> {
    const MAGIC: u16 = 0x041c;
    let short = || within(file, "the serialized file ends too early");
    let word = |at: usize| -> Result<u16> {
        let bytes = bytes.get(at..at.saturating_add(2)).ok_or_else(short)?;
        Ok(u16::from_le_bytes([bytes[0], bytes[1]]))
    };
    let version = word(2)?;
    if word(0)? != MAGIC || !matches!(version, 3 | 4) {
        return Err(within(file, format!("not a serialized file of version 3 or 4, but {version}")));
    }
    let number = |at: usize, size: usize| -> Result<u64> {
        let part = bytes.get(at..at.saturating_add(size)).ok_or_else(short)?;
        Ok(part.iter().rev().fold(0, |n, &b| n << 8 | u64::from(b)))
    };
    let end = bytes.len().checked_sub(4).ok_or_else(short)?;
    let count = number(end, 4)? as usize;
    if index >= count {
        return Err(within(file, format!("shape {index} does not exist, there are {count}")));
    }
    let size = if version == 4 { 8 } else { 4 };
    let entry = (count - index).checked_mul(size).and_then(|back| end.checked_sub(back)).ok_or_else(short)?;
    let start = usize::try_from(number(entry, size)?).map_err(|_| short())?;
    let data = bytes.get(start.saturating_add(4)..end).ok_or_else(short)?;
    Packed { file, source: ZlibDecoder::new(data) }.mesh(version)
}

/// The deflated part of a serialized shape.
struct Packed<'a> {
    file: &'a Path,
    source: ZlibDecoder<&'a [u8]>,
}

impl Packed<'_> {
    /// So many bytes; room is made as they come.
    fn bytes(&mut self, count: u64) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let failed = |e: std::io::Error| within(self.file, format!("cannot be inflated: {e}"));
        self.source.by_ref().take(count).read_to_end(&mut bytes).map_err(failed)?;
        if (bytes.len() as u64) < count {
            return Err(within(self.file, "the serialized shape ends too early"));
        }
        Ok(bytes)
    }

    fn number(&mut self, size: u64) -> Result<u64> {
        Ok(self.bytes(size)?.iter().rev().fold(0, |n, &b| n << 8 | u64::from(b)))
    }

    fn floats(&mut self, double: bool, count: u64) -> Result<Vec<f64>> {
        let size = if double { 8 } else { 4 };
        let total = count.checked_mul(size).ok_or_else(|| within(self.file, "too many vertices"))?;
        let bytes = self.bytes(total)?;
        let float = |b: &[u8]| match *b {
            [a, b, c, d] => f64::from(f32::from_le_bytes([a, b, c, d])),
            _ => f64::from_bits(b.iter().rev().fold(0, |n, &byte| n << 8 | u64::from(byte))),
        };
        Ok(bytes.chunks_exact(size as usize).map(float).collect())
    }

    fn mesh(mut self, version: u16) -> Result<Mesh> {
        let flags = self.number(4)?;
        let (normals, uvs, colors) = (flags & 1 != 0, flags & 2 != 0, flags & 8 != 0);
        let double = flags & 0x2000 != 0;
        if version == 4 {
            // A name that ends in zero.
            while self.number(1)? != 0 {}
        }
        let (vertices, faces) = (self.number(8)?, self.number(8)?);
        let threefold = vertices.checked_mul(3).ok_or_else(|| within(self.file, "too many vertices"))?;
        let triples = |n: Vec<f64>| n.chunks_exact(3).map(DVec3::from_slice).collect::<Vec<_>>();
        let mut mesh = Mesh::new(String::new());
        mesh.faceted = flags & 0x10 != 0;
        mesh.positions = triples(self.floats(double, threefold)?);
        if normals {
            let unit = |n: &DVec3| n.normalize_or(DVec3::Y).as_vec3();
            mesh.normals = triples(self.floats(double, threefold)?).iter().map(unit).collect();
        }
        if uvs {
            let n = self.floats(double, threefold / 3 * 2)?;
            mesh.uvs = n.chunks_exact(2).map(|uv| Vec2::new(uv[0] as f32, uv[1] as f32)).collect();
        }
        if colors {
            let clamped = |c: &DVec3| c.as_vec3().clamp(Vec3::ZERO, Vec3::ONE);
            mesh.colors = triples(self.floats(double, threefold)?).iter().map(clamped).collect();
        }
        if mesh.uvs.iter().any(|uv| !uv.is_finite()) || mesh.normals.iter().any(|n| !n.is_finite()) {
            return Err(within(self.file, "a normal or texture coordinate is not finite"));
        }
        let wide = if u32::try_from(vertices).is_ok() { 4 } else { 8 };
        let size = faces.checked_mul(3 * wide).ok_or_else(|| within(self.file, "too many triangles"))?;
        let indices = self.bytes(size)?;
        for (i, face) in indices.chunks_exact(3 * wide as usize).enumerate() {
            let mut corners = [0; 3];
            for (corner, bytes) in corners.iter_mut().zip(face.chunks_exact(wide as usize)) {
                let v = bytes.iter().rev().fold(0u64, |n, &b| n << 8 | u64::from(b));
                let known = u32::try_from(v).ok().filter(|_| v < vertices);
                *corner = known.ok_or_else(|| within(self.file, format!("triangle {i}: vertex {v} does not exist")))?;
            }
            mesh.triangles.push((corners, normals));
        }
        Ok(mesh)
    }
}
