//! PLY models: ascii and binary, of scanners, sculpting programs and papers.
//!
//! Used: `vertex` with x, y, z, nx, ny, nz, texture coordinates (u, v; s, t; texture_u, texture_v) and colours (red, green, blue, sRGB-encoded); `face` with
//! its list of corners (`vertex_indices` or `vertex_index`), and MeshLab's `texcoord` of the corners; the comment `TextureFile`. Other elements and
//! properties are skipped. Clouds of points and of Gaussian splats are refused: they have no surfaces.

use std::cell::Cell;
use std::fmt;
use std::io::{BufRead, Read};
use std::path::Path;
use std::rc::Rc;

use glam::{DVec3, Vec2, Vec3};
use serde::de::{Deserialize, Deserializer, IgnoredAny, MapAccess, Visitor};
use serde_ply::{DeserializeError, ElementDef, PlyFormat, PlyReader, PropertyType, ScalarType};

use super::tessellate::{MOST_CORNERS, triangulate};
use super::texture::srgb_to_linear;
use super::{Material, Scene, Texture, Triangle, Wrap, origin};
use crate::error::{Error, Result};
use crate::input::Inputs;

/// Reads a PLY file; the result is not validated yet.
pub(super) fn load(path: &Path, inputs: &Inputs) -> Result<Scene> {
    let bytes = inputs.read(path)?;
    let line = Rc::new(Cell::new(1));
    // The crate wants a white space after the last number.
    let source = Lines { bytes: bytes.as_slice().chain(&b"\n"[..]), line: line.clone(), ended: false };
    let at_line = |e: DeserializeError| Error::at(path, line.get(), reason(&e));
    let mut reader = PlyReader::from_reader(source).map_err(at_line)?;
    let header = reader.header().clone();
    refuse_clouds(path, &header.elem_defs)?;
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for element in &header.elem_defs {
        // Lines say nothing in a binary file.
        let failed = |e: DeserializeError| {
            let message = format!("element {:?}: {}", element.name, reason(&e));
            let line = (header.format == PlyFormat::Ascii).then(|| line.get());
            line.map_or_else(|| Error::file(path, message.clone()), |line| Error::at(path, line, message.clone()))
        };
        if element.properties.is_empty() {
            // Rows that take no room could be told in any number.
            reader.next_element::<Nothing>().map_err(failed)?;
            continue;
        }
        match element.name.as_str() {
            "vertex" => vertices = reader.next_element::<Vec<Vertex>>().map_err(failed)?,
            "face" => faces = reader.next_element::<Vec<Face>>().map_err(failed)?,
            _ => drop(reader.next_element::<Vec<Skipped>>().map_err(failed)?),
        }
    }
    let mut scene = Scene::default();
    let textures = header.comments.iter().filter_map(|c| c.strip_prefix("TextureFile "));
    let texture = textures.map(str::trim).next().filter(|name| !name.is_empty());
    if let Some(name) = texture {
        let file = path.parent().unwrap_or(Path::new("")).join(name.replace('\\', "/"));
        let error = |why: String| Error::file(path, format!("texture {}: {why}", file.display()));
        let bytes = inputs.read(&file)?;
        let decoded = Texture::decode(inputs, &bytes, name.to_string(), true, [Wrap::Repeat; 2]);
        scene.textures.push(decoded.map_err(error)?);
    }
    let definition = header.elem_defs.iter().find(|e| e.name == "vertex");
    fill(path, &mut scene, definition, &vertices, &faces)?;
    Ok(scene)
}

/// Tells the line of the byte that was read last.
struct Lines<R> {
    bytes: R,
    line: Rc<Cell<usize>>,
    /// That byte ends the line.
    ended: bool,
}

impl<R: BufRead> Read for Lines<R> {
    fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
        let n = self.bytes.read(to)?;
        if let Some((last, before)) = to[..n].split_last() {
            let lines = before.iter().filter(|&&b| b == b'\n').count();
            self.line.set(self.line.get() + lines + usize::from(self.ended));
            self.ended = *last == b'\n';
        }
        Ok(n)
    }
}

impl<R: BufRead> BufRead for Lines<R> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        self.bytes.fill_buf()
    }

    fn consume(&mut self, amount: usize) {
        if let Ok(Some((last, before))) = self.bytes.fill_buf().map(|b| b[..amount].split_last()) {
            let lines = before.iter().filter(|&&b| b == b'\n').count();
            self.line.set(self.line.get() + lines + usize::from(self.ended));
            self.ended = *last == b'\n';
        }
        self.bytes.consume(amount);
    }
}

fn reason(error: &DeserializeError) -> String {
    match error.0.kind() {
        std::io::ErrorKind::UnexpectedEof => String::from("the file ends too early"),
        _ => error.0.to_string(),
    }
}

/// Refuses a file without faces, saying what it holds.
fn refuse_clouds(path: &Path, elements: &[ElementDef]) -> Result<()> {
    let of = |name: &str| elements.iter().find(|e| e.name == name && e.count > 0);
    let Some(vertex) = of("vertex") else { return Err(Error::file(path, "no vertices")) };
    if ["f_dc_0", "scale_0", "rot_0"].iter().all(|name| vertex.has_property(name)) {
        let message = format!("a cloud of {} Gaussian splats, which have no surfaces to light", vertex.count);
        return Err(Error::file(path, message));
    }
    if let Some(missing) = ["x", "y", "z"].into_iter().find(|name| !vertex.has_property(name)) {
        return Err(Error::file(path, format!("element \"vertex\" has no property {missing:?}")));
    }
    match of("face") {
        Some(face) if face.has_property("vertex_indices") || face.has_property("vertex_index") => Ok(()),
        Some(_) => Err(Error::file(path, "element \"face\" has no property \"vertex_indices\" or \"vertex_index\"")),
        None if of("tristrips").is_some() => {
            Err(Error::file(path, "its surface is in strips of triangles, which are not read; convert it to faces"))
        }
        None => {
            let message = format!("a cloud of {} points without faces; reconstruct its surface first", vertex.count);
            Err(Error::file(path, message))
        }
    }
}

/// Meaning of a property of a vertex or face.
enum Key {
    /// x, y, z; nx, ny, nz; u, v; red, green, blue.
    Number(usize),
    Corners,
    CornerUvs,
    Other,
}

impl<'de> Deserialize<'de> for Key {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Key, D::Error> {
        struct Names;
        impl Visitor<'_> for Names {
            type Value = Key;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("the name of a property")
            }
            fn visit_bytes<E>(self, name: &[u8]) -> Result<Key, E> {
                Ok(match name {
                    b"x" => Key::Number(0),
                    b"y" => Key::Number(1),
                    b"z" => Key::Number(2),
                    b"nx" => Key::Number(3),
                    b"ny" => Key::Number(4),
                    b"nz" => Key::Number(5),
                    b"u" | b"s" | b"texture_u" => Key::Number(6),
                    b"v" | b"t" | b"texture_v" => Key::Number(7),
                    b"red" | b"diffuse_red" | b"r" => Key::Number(8),
                    b"green" | b"diffuse_green" | b"g" => Key::Number(9),
                    b"blue" | b"diffuse_blue" | b"b" => Key::Number(10),
                    b"vertex_indices" | b"vertex_index" => Key::Corners,
                    b"texcoord" => Key::CornerUvs,
                    _ => Key::Other,
                })
            }
        }
        deserializer.deserialize_identifier(Names)
    }
}

/// The numbers of [`Key::Number`]; NaN where the file has no such property.
struct Vertex([f64; 11]);

struct Face {
    corners: Vec<i64>,
    /// u and v of each corner, or empty.
    uvs: Vec<f32>,
}

struct Skipped;

/// An element whose rows are not read.
struct Nothing;

impl<'de> Deserialize<'de> for Nothing {
    fn deserialize<D: Deserializer<'de>>(_: D) -> Result<Nothing, D::Error> {
        Ok(Nothing)
    }
}

/// Reads a row of an element.
trait Row: Sized {
    fn empty() -> Self;
    fn property<'de, A: MapAccess<'de>>(&mut self, key: Key, from: &mut A) -> Result<(), A::Error>;
}

impl Row for Vertex {
    fn empty() -> Vertex {
        Vertex([f64::NAN; 11])
    }

    fn property<'de, A: MapAccess<'de>>(&mut self, key: Key, from: &mut A) -> Result<(), A::Error> {
        match key {
            Key::Number(i) => self.0[i] = from.next_value()?,
            _ => drop(from.next_value::<IgnoredAny>()?),
        }
        Ok(())
    }
}

impl Row for Face {
    fn empty() -> Face {
        Face { corners: Vec::new(), uvs: Vec::new() }
    }

    fn property<'de, A: MapAccess<'de>>(&mut self, key: Key, from: &mut A) -> Result<(), A::Error> {
        match key {
            Key::Corners => self.corners = from.next_value()?,
            Key::CornerUvs => self.uvs = from.next_value()?,
            _ => drop(from.next_value::<IgnoredAny>()?),
        }
        Ok(())
    }
}

impl Row for Skipped {
    fn empty() -> Skipped {
        Skipped
    }

    fn property<'de, A: MapAccess<'de>>(&mut self, _: Key, from: &mut A) -> Result<(), A::Error> {
        from.next_value::<IgnoredAny>().map(drop)
    }
}

struct RowVisitor<T>(std::marker::PhantomData<T>);

impl<'de, T: Row> Visitor<'de> for RowVisitor<T> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a row of properties")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<T, A::Error> {
        let mut row = T::empty();
        while let Some(key) = map.next_key::<Key>()? {
            row.property(key, &mut map)?;
        }
        Ok(row)
    }
}

macro_rules! row {
    ($type:ty) => {
        impl<'de> Deserialize<'de> for $type {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                deserializer.deserialize_map(RowVisitor(std::marker::PhantomData))
            }
        }
    };
}

row!(Vertex);
row!(Face);
row!(Skipped);

/// Greatest value of a colour channel, by the type of its property.
fn full_scale(definition: Option<&ElementDef>, names: [&str; 3]) -> f64 {
    let property = definition.and_then(|d| names.iter().find_map(|name| d.get_property(name)));
    match property.map(|p| &p.property_type) {
        Some(PropertyType::Scalar(ScalarType::U8 | ScalarType::I8)) => 255.0,
        Some(PropertyType::Scalar(ScalarType::U16 | ScalarType::I16)) => 65_535.0,
        Some(PropertyType::Scalar(ScalarType::U32 | ScalarType::I32)) => f64::from(u32::MAX),
        _ => 1.0,
    }
}

fn fill(
    path: &Path,
    scene: &mut Scene,
    definition: Option<&ElementDef>,
    vertices: &[Vertex],
    faces: &[Face],
) -> Result<()> {
    let mut positions = Vec::with_capacity(vertices.len());
    for (i, Vertex(n)) in vertices.iter().enumerate() {
        let p = DVec3::new(n[0], n[1], n[2]);
        if !p.as_vec3().is_finite() {
            return Err(Error::file(path, format!("vertex {i} is at {p}")));
        }
        positions.push(p);
    }
    if u32::try_from(positions.len()).is_err() {
        return Err(Error::file(path, "more than 2^32 vertices; split the model"));
    }
    let low = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    scene.origin = origin::choose(low, high);
    scene.positions = positions.iter().map(|&p| scene.from_world(p)).collect();
    let triple = |n: &[f64; 11], at: usize| DVec3::new(n[at], n[at + 1], n[at + 2]);
    let directions = || vertices.iter().map(|v| triple(&v.0, 3).as_vec3().try_normalize());
    scene.normals = directions().map(|n| n.unwrap_or(Vec3::Y)).collect();
    let smooth: Vec<bool> = directions().map(|n| n.is_some()).collect();
    // The file's v runs upwards.
    let uv = |n: &[f64; 11]| Vec2::new(n[6] as f32, 1.0 - n[7] as f32);
    scene.uvs = vertices.iter().map(|v| Some(uv(&v.0)).filter(|uv| uv.is_finite()).unwrap_or(Vec2::ZERO)).collect();
    let scale = full_scale(definition, ["red", "diffuse_red", "r"]);
    let colored = vertices.iter().any(|v| triple(&v.0, 8).is_finite());
    if colored {
        let color = |v: &Vertex| {
            let c = (triple(&v.0, 8) / scale).as_vec3();
            if c.is_finite() { c.clamp(Vec3::ZERO, Vec3::ONE).map(srgb_to_linear) } else { Vec3::ONE }
        };
        scene.colors = vertices.iter().map(color).collect();
    }
    // Colours and textures hold the whole reflectance.
    let base_texture = (!scene.textures.is_empty()).then_some(0);
    let base_color = if colored || base_texture.is_some() { Vec3::ONE } else { Material::default().base_color };
    let material = scene.add_material(Material { base_color, base_texture, ..Material::default() });
    let object = scene.add_object(super::stem(path));
    let mut incomplete = 0;
    for (i, face) in faces.iter().enumerate() {
        let index = |&corner: &i64| match u32::try_from(corner) {
            Ok(v) if (v as usize) < vertices.len() => Ok(v),
            _ => Err(Error::file(
                path,
                format!("face {i}: vertex {corner} does not exist, there are {}", vertices.len()),
            )),
        };
        let mut corners: Vec<u32> = face.corners.iter().map(index).collect::<Result<_>>()?;
        if corners.len() < 3 {
            incomplete += 1;
            continue;
        }
        if corners.len() > MOST_CORNERS {
            let message =
                format!("face {i} has {} corners, at most {MOST_CORNERS} can be cut; split it", corners.len());
            return Err(Error::file(path, message));
        }
        let smooth = corners.iter().all(|&v| smooth[v as usize]);
        if face.uvs.len() == 2 * corners.len() && face.uvs.iter().all(|x| x.is_finite()) {
            for (corner, uv) in corners.iter_mut().zip(face.uvs.chunks_exact(2)) {
                let v = *corner as usize;
                scene.positions.push(scene.positions[v]);
                scene.normals.push(scene.normals[v]);
                scene.uvs.push(Vec2::new(uv[0], 1.0 - uv[1]));
                if colored {
                    scene.colors.push(scene.colors[v]);
                }
                *corner = u32::try_from(scene.positions.len() - 1)
                    .map_err(|_| Error::file(path, "more than 2^32 corners; split the model"))?;
            }
        }
        let points: Vec<DVec3> = corners.iter().map(|&v| scene.positions[v as usize].as_dvec3()).collect();
        let refused = |why| Error::file(path, format!("face {i}: {why}"));
        for triangle in triangulate(&points).map_err(refused)? {
            let vertices = triangle.map(|k| corners[k as usize]);
            scene.triangles.push(Triangle { vertices, material, object, smooth });
        }
    }
    if incomplete > 0 {
        log::warn!("{}: left out {incomplete} faces with fewer than three corners", path.display());
    }
    Ok(())
}
