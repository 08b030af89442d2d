//! Wavefront OBJ models.
//!
//! A parser of our own rather than a crate: every error has its line, faces with and without normals may be mixed, concave
//! polygons keep their shape, and no input can panic. Curves, surfaces, points and lines are ignored.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

use glam::{DVec3, Vec2, Vec3};

use super::obj_material::{self, Library};
use super::origin;
use super::tessellate::triangulate;
use super::texture::srgb_to_linear;
use super::{Scene, Triangle};
use crate::error::{Error, Result};

/// Reads an OBJ file with its material libraries; the result is not validated yet.
pub(super) fn load(path: &Path) -> Result<Scene> {
    let bytes = std::fs::read(path).map_err(Error::io("reading", path))?;
    let text = String::from_utf8_lossy(&bytes);
    let mut reader = Reader {
        path,
        line: 0,
        positions: Vec::new(),
        colors: Vec::new(),
        uvs: Vec::new(),
        normals: Vec::new(),
        vertices: HashMap::new(),
        objects: HashMap::new(),
        object_name: String::from("unnamed"),
        object: None,
        materials: Library::default(),
        material: None,
        corners: Vec::new(),
        incomplete: None,
        unknown: None,
        scene: Scene { origin: origin(&text), ..Scene::default() },
    };
    for (line, content) in logical_lines(&text) {
        reader.line = line;
        reader.statement(&content)?;
    }
    reader.finish()
}

/// The scene's origin, from the bounds of all vertices. Faces refer to vertices above them and are cut into triangles at once,
/// so that the origin must be known before the first of them. Invalid lines are skipped: the reader reports them.
fn origin(text: &str) -> DVec3 {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (_, line) in logical_lines(text) {
        let Some(("v", rest)) = keyword(&line) else { continue };
        let mut words = rest.split_whitespace().map(position);
        if let (Some(Ok(x)), Some(Ok(y)), Some(Ok(z))) = (words.next(), words.next(), words.next()) {
            low = low.min(DVec3::new(x, y, z));
            high = high.max(DVec3::new(x, y, z));
        }
    }
    origin::choose(low, high)
}

/// Lines with their numbers (from 1); one that ends in a backslash is joined with the next.
pub(super) fn logical_lines(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut lines = (1..).zip(text.lines());
    std::iter::from_fn(move || {
        let (number, line) = lines.next()?;
        let Some(start) = line.strip_suffix('\\') else { return Some((number, Cow::Borrowed(line))) };
        let mut joined = start.to_string();
        for (_, next) in lines.by_ref() {
            joined.push(' ');
            match next.strip_suffix('\\') {
                Some(part) => joined.push_str(part),
                None => {
                    joined.push_str(next);
                    break;
                }
            }
        }
        Some((number, Cow::Owned(joined)))
    })
}

/// Splits a line into its keyword and the rest, without comments.
pub(super) fn keyword(line: &str) -> Option<(&str, &str)> {
    let line = line.trim();
    if line.is_empty() || line.starts_with('#') {
        return None;
    }
    Some(match line.split_once(char::is_whitespace) {
        Some((word, rest)) => (word, rest.trim()),
        None => (line, ""),
    })
}

/// A finite number.
pub(super) fn number(word: &str) -> Result<f32, String> {
    match word.parse::<f32>() {
        Ok(x) if x.is_finite() => Ok(x),
        Ok(_) => Err(format!("{word} is not a finite number")),
        Err(_) => Err(format!("{word:?} is not a number")),
    }
}

/// A coordinate, in double precision: it may be far from the origin. Single precision must be able to represent it.
fn position(word: &str) -> Result<f64, String> {
    number(word)?;
    word.parse::<f64>().map_err(|_| format!("{word:?} is not a number"))
}

/// Corner of a face: indices (from 0) of position, texture coordinate and normal.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Corner {
    position: u32,
    uv: Option<u32>,
    normal: Option<u32>,
}

struct Reader<'a> {
    path: &'a Path,
    line: usize,
    /// Relative to the scene's origin.
    positions: Vec<Vec3>,
    /// Linear; of the first so many positions, or none.
    colors: Vec<Vec3>,
    uvs: Vec<Vec2>,
    /// Unit length, or zero where the file's normal has no direction.
    normals: Vec<Vec3>,
    /// Scene vertex of each distinct corner.
    vertices: HashMap<Corner, u32>,
    objects: HashMap<String, u32>,
    object_name: String,
    /// Index of `object_name` once it has a face.
    object: Option<u32>,
    materials: Library,
    material: Option<u32>,
    /// Corners of the current face, kept to save allocations.
    corners: Vec<Corner>,
    /// Line of the first face with fewer than three corners, and how many there are.
    incomplete: Option<(usize, usize)>,
    /// First unsupported statement, and its line.
    unknown: Option<(String, usize)>,
    scene: Scene,
}

impl Reader<'_> {
    fn error(&self, message: impl std::fmt::Display) -> Error {
        Error::at(self.path, self.line, format!("object {:?}: {message}", self.object_name))
    }

    fn statement(&mut self, line: &str) -> Result<()> {
        let Some((word, rest)) = keyword(line) else { return Ok(()) };
        match word {
            // A fourth number is a weight for curves, or begins a vertex colour: both are ignored.
            "v" => {
                let p = self.numbers_by("vertex", rest, position)?;
                self.positions.push(self.scene.from_world(DVec3::from_array(p)));
                // Scanners and sculpting programs write a colour after the position, sRGB-encoded.
                if rest.split_whitespace().count() >= 6 {
                    let [_, _, _, r, g, b] = self.numbers::<6>("vertex with a colour", rest)?;
                    let color = Vec3::new(r, g, b).clamp(Vec3::ZERO, Vec3::ONE);
                    self.colors.resize(self.positions.len() - 1, Vec3::ONE);
                    self.colors.push(color.map(srgb_to_linear));
                }
            }
            "vn" => {
                let n = self.numbers::<3>("normal", rest)?;
                self.normals.push(Vec3::from_array(n).normalize_or_zero());
            }
            "vt" => {
                // OBJ's v runs upwards from the lower edge. A one-dimensional texture has no v.
                let [u, v] = if rest.split_whitespace().count() == 1 {
                    [self.numbers::<1>("texture coordinate", rest)?[0], 0.0]
                } else {
                    self.numbers::<2>("texture coordinate", rest)?
                };
                self.uvs.push(Vec2::new(u, 1.0 - v));
            }
            "f" => self.face(rest)?,
            "o" | "g" => {
                self.object_name = String::from(if rest.is_empty() { "unnamed" } else { rest });
                self.object = None;
            }
            "usemtl" => self.material = Some(self.materials.named(&mut self.scene, rest)),
            "mtllib" => self.library(rest)?,
            "s" | "l" | "p" | "vp" | "usemap" | "maplib" | "mg" | "lod" | "bevel" | "c_interp" | "d_interp" => {}
            _ => {
                if self.unknown.is_none() {
                    self.unknown = Some((word.to_string(), self.line));
                }
            }
        }
        Ok(())
    }

    fn numbers<const N: usize>(&self, what: &str, rest: &str) -> Result<[f32; N]> {
        self.numbers_by(what, rest, number)
    }

    /// The first `N` numbers of a line.
    fn numbers_by<T: Copy + Default, const N: usize>(
        &self,
        what: &str,
        rest: &str,
        number: impl Fn(&str) -> Result<T, String>,
    ) -> Result<[T; N]> {
        let mut values = [T::default(); N];
        let mut words = rest.split_whitespace();
        for value in &mut values {
            let word = words.next().ok_or_else(|| self.error(format!("a {what} needs {N} numbers")))?;
            *value = number(word).map_err(|m| self.error(format!("{what}: {m}")))?;
        }
        Ok(values)
    }

    fn library(&mut self, rest: &str) -> Result<()> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        // One name, with spaces or not; else several, whose own spaces are escaped.
        let mut files = vec![folder.join(rest.replace('\\', "/"))];
        if !files[0].is_file() {
            let escaped = rest.replace("\\ ", "\0");
            let names = escaped.split_whitespace().map(|name| name.replace('\0', " ").replace('\\', "/"));
            files = names.map(|name| folder.join(name)).collect();
        }
        let (found, missing): (Vec<_>, Vec<_>) = files.into_iter().partition(|file| file.is_file());
        for file in found {
            let (entries, ignored) = obj_material::read(&file)?;
            for what in ignored {
                if !self.scene.ignored.contains(&what) {
                    self.scene.ignored.push(what);
                }
            }
            self.materials.add(&mut self.scene, entries);
        }
        if !missing.is_empty() {
            let path = self.path.display();
            log::warn!("{path}:{}: no such material library; its materials are grey: {missing:?}", self.line);
        }
        Ok(())
    }

    fn index(&self, what: &str, word: &str, count: usize) -> Result<u32> {
        let index: i64 =
            word.parse().map_err(|_| self.error(format!("face: {what} index {word:?} is not a whole number")))?;
        // Negative indices count back from the last; zero is invalid.
        let absolute = if index < 0 { index + count as i64 } else { index - 1 };
        match u32::try_from(absolute) {
            Ok(i) if index != 0 && (i as usize) < count => Ok(i),
            _ => Err(self.error(format!("face: {what} index {index} is out of range, {count} are defined so far"))),
        }
    }

    fn corner(&self, word: &str) -> Result<Corner> {
        let mut parts = word.split('/');
        let position = self.index("vertex", parts.next().unwrap_or_default(), self.positions.len())?;
        let mut optional = |what: &str, count: usize| match parts.next() {
            None | Some("") => Ok(None),
            Some(part) => self.index(what, part, count).map(Some),
        };
        let uv = optional("texture coordinate", self.uvs.len())?;
        let normal = optional("normal", self.normals.len())?;
        if parts.next().is_some() {
            return Err(self.error(format!("face: corner {word:?} has more than three indices")));
        }
        Ok(Corner { position, uv, normal })
    }

    fn face(&mut self, rest: &str) -> Result<()> {
        let mut corners = std::mem::take(&mut self.corners);
        corners.clear();
        for word in rest.split_whitespace() {
            corners.push(self.corner(word)?);
        }
        match corners.len() {
            0..3 => {
                let (line, count) = self.incomplete.unwrap_or((self.line, 0));
                self.incomplete = Some((line, count + 1));
            }
            3 => self.triangle([corners[0], corners[1], corners[2]])?,
            _ => {
                let points: Vec<Vec3> = corners.iter().map(|c| self.positions[c.position as usize]).collect();
                for triangle in triangulate(&points) {
                    self.triangle(triangle.map(|k| corners[k]))?;
                }
            }
        }
        self.corners = corners;
        Ok(())
    }

    fn triangle(&mut self, corners: [Corner; 3]) -> Result<()> {
        // A vertex index that fits u32 leaves room for the scene's own numbering.
        if self.scene.positions.len() + 3 > u32::MAX as usize {
            return Err(self.error("more than 2^32 vertices; split the model"));
        }
        let object = match self.object {
            Some(object) => object,
            None => {
                let scene = &mut self.scene;
                let name = &self.object_name;
                *self.objects.entry(name.clone()).or_insert_with(|| scene.add_object(name.clone()))
            }
        };
        self.object = Some(object);
        let material = match self.material {
            Some(material) => material,
            None => self.materials.unnamed(&mut self.scene),
        };
        self.material = Some(material);
        self.materials.mark_used(&mut self.scene, material);
        let direction = |c: &Corner| c.normal.map(|n| self.normals[n as usize]).filter(|n| *n != Vec3::ZERO);
        let smooth = corners.iter().all(|c| direction(c).is_some());
        let vertices = corners.map(|c| {
            *self.vertices.entry(c).or_insert_with(|| {
                let scene = &mut self.scene;
                scene.positions.push(self.positions[c.position as usize]);
                scene.uvs.push(c.uv.map_or(Vec2::ZERO, |uv| self.uvs[uv as usize]));
                scene.normals.push(direction(&c).unwrap_or(Vec3::Y));
                if let Some(&color) = self.colors.get(c.position as usize) {
                    scene.colors.resize(scene.positions.len() - 1, Vec3::ONE);
                    scene.colors.push(color);
                }
                scene.positions.len() as u32 - 1
            })
        });
        self.scene.triangles.push(Triangle { vertices, material, object, smooth });
        Ok(())
    }

    fn finish(mut self) -> Result<Scene> {
        self.materials.read_textures(&mut self.scene)?;
        if !self.scene.colors.is_empty() {
            self.scene.colors.resize(self.scene.positions.len(), Vec3::ONE);
        }
        let path = self.path.display();
        if let Some((line, count)) = self.incomplete {
            log::warn!("{path}:{line}: left out {count} faces with fewer than three corners");
        }
        if let Some((word, line)) = &self.unknown {
            log::warn!("{path}:{line}: unknown statement {word:?} ignored");
        }
        self.materials.warn_undefined(self.path);
        Ok(self.scene)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joined_lines_keep_the_first_number() {
        let lines: Vec<(usize, String)> =
            logical_lines("a\nb \\\nc\\\r\nd\ne").map(|(n, l)| (n, l.into_owned())).collect();
        let expected = [(1, "a"), (2, "b  c d"), (5, "e")].map(|(n, l)| (n, l.to_string()));
        assert_eq!(lines, expected);
    }

    #[test]
    fn numbers_are_finite() {
        assert_eq!(number(".5e-01"), Ok(0.05));
        for bad in ["nan", "inf", "-inf", "1e99", "1.#QNAN", "", "1,5"] {
            assert!(number(bad).is_err(), "{bad}");
        }
    }
}
