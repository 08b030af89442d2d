//! Wavefront OBJ models, read by `tobj`; polygons are cut into triangles.
//!
//! Faces with and without normals or texture coordinates may be mixed, and vertices with and without a colour. Curves,
//! surfaces, points and lines are ignored.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use glam::{DVec3, Vec2, Vec3};

use super::obj_lines::{Statement, decode, keyword, logical_lines, number, through_tobj};
use super::obj_material::Library;
use super::origin;
use super::tessellate::{MOST_CORNERS, triangulate};
use super::texture::srgb_to_linear;
use super::{Scene, Triangle};
use crate::error::{Error, Result};
use crate::input::Inputs;

/// The name of objects and materials whose name is empty.
pub(super) const UNNAMED: &str = "unnamed";

/// Reads an OBJ file with its material libraries; the result is not validated yet.
pub(super) fn load(path: &Path, inputs: &Inputs) -> Result<Scene> {
    let bytes = inputs.read(path)?;
    let text = decode(&bytes);
    let mut checker = Checker::new(path, has_colors(&text));
    // Materials keep their names through tobj and nothing else; the libraries are read afterwards.
    let material = |name: &Path| {
        let name = name.to_string_lossy().into_owned();
        let index = [(name.clone(), 0)].into_iter().collect();
        Ok((vec![tobj::Material { name, ..tobj::Material::default() }], index))
    };
    let options = tobj::LoadOptions { single_index: true, ..tobj::LoadOptions::default() };
    let (models, names) = through_tobj(
        path,
        &text,
        |statement, out| checker.statement(statement, out),
        |mut lines| {
            let (models, materials) = tobj::load_obj_buf(&mut lines, &options, material)?;
            Ok((models, materials?))
        },
    )?;
    drop(text);
    let mut scene = Scene { origin: origin(&models), ..Scene::default() };
    let mut library = Library::default();
    for (line, rest) in &checker.libraries {
        library.read(&mut scene, inputs, path, (*line, rest))?;
    }
    let mut objects = HashMap::new();
    for tobj::Model { mesh, name } in models {
        if mesh.indices.is_empty() {
            continue;
        }
        let object = *objects.entry(name).or_insert_with_key(|name| scene.add_object(name.clone()));
        let material = match mesh.material_id {
            Some(index) => library.named(&mut scene, &names[index].name),
            None => library.unnamed(&mut scene),
        };
        let placement = library.mark_used(material);
        add_mesh(&mut scene, path, &mesh, [material, object], placement)?;
    }
    library.read_textures(&mut scene, inputs)?;
    if !scene.colors.is_empty() {
        scene.colors.resize(scene.positions.len(), Vec3::ONE);
    }
    checker.warn();
    library.warn_undefined(path);
    Ok(scene)
}

/// Whether some vertex has a colour: `tobj` takes colours for the first vertices, so that then each is given one.
fn has_colors(text: &str) -> bool {
    // Faces, most of the lines, need no closer look.
    logical_lines(text)
        .filter(|(_, line)| !line.starts_with('f'))
        .any(|(_, line)| keyword(&line).is_some_and(|(word, rest)| word == "v" && words(rest).nth(5).is_some()))
}

/// The scene's origin, from the bounds of all vertices in use.
fn origin(models: &[tobj::Model]) -> DVec3 {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in models.iter().flat_map(|model| model.mesh.positions.as_chunks().0) {
        low = low.min(DVec3::from_array(*p));
        high = high.max(DVec3::from_array(*p));
    }
    origin::choose(low, high)
}

/// Adds the faces of one object, material and kind; texture coordinates are scaled, then moved, by `placement`.
fn add_mesh(
    scene: &mut Scene,
    path: &Path,
    mesh: &tobj::Mesh,
    [material, object]: [u32; 2],
    [scale, offset]: [Vec2; 2],
) -> Result<()> {
    let (points, _) = mesh.positions.as_chunks::<3>();
    let first = scene.positions.len();
    if first + points.len() > u32::MAX as usize {
        return Err(Error::file(path, "more than 2^32 vertices; split the model"));
    }
    let single = |v: &[f64; 3]| Vec3::from_array(v.map(|x| x as f32));
    let origin = scene.origin;
    scene.positions.extend(points.iter().map(|&p| (DVec3::from_array(p) - origin).as_vec3()));
    // OBJ's v runs upwards from the lower edge.
    let upright = |&[u, v]: &[f64; 2]| Vec2::new(u as f32, v as f32) * scale + offset;
    scene.uvs.extend(mesh.texcoords.as_chunks().0.iter().map(upright).map(|uv| Vec2::new(uv.x, 1.0 - uv.y)));
    scene.uvs.resize(scene.positions.len(), Vec2::ZERO);
    // Zero where the file's normal has no direction.
    let mut directed = vec![false; points.len()];
    for (directed, n) in directed.iter_mut().zip(mesh.normals.as_chunks().0) {
        let normal = single(n).normalize_or_zero();
        *directed = normal != Vec3::ZERO;
        scene.normals.push(if *directed { normal } else { Vec3::Y });
    }
    scene.normals.resize(scene.positions.len(), Vec3::Y);
    let colors = mesh.vertex_color.as_chunks().0.iter();
    scene.colors.extend(colors.map(|c| single(c).clamp(Vec3::ZERO, Vec3::ONE).map(srgb_to_linear)));

    let mut add = |corners: [u32; 3]| {
        let smooth = corners.iter().all(|&c| directed[c as usize]);
        scene.triangles.push(Triangle { vertices: corners.map(|c| first as u32 + c), material, object, smooth });
    };
    if mesh.face_arities.is_empty() {
        mesh.indices.as_chunks().0.iter().for_each(|&corners| add(corners));
        return Ok(());
    }
    let mut rest = mesh.indices.as_slice();
    let mut polygon = Vec::new();
    for &corners in &mesh.face_arities {
        let (face, after) = rest.split_at(corners as usize);
        rest = after;
        if let &[a, b, c] = face {
            add([a, b, c]);
            continue;
        }
        polygon.clear();
        polygon.extend(face.iter().map(|&c| DVec3::from_array(points[c as usize])));
        let refused = |why| Error::file(path, format!("object {:?}: {why}", scene.objects[object as usize]));
        for triangle in triangulate(&polygon).map_err(refused)? {
            add(triangle.map(|k| face[k as usize]));
        }
    }
    Ok(())
}

/// Checks the statements of a model at their lines and writes them as `tobj` reads them.
struct Checker<'a> {
    path: &'a Path,
    /// Whether vertices are given a colour.
    colored: bool,
    positions: usize,
    uvs: usize,
    normals: usize,
    group: String,
    /// Whether the latest face of the group has texture coordinates and normals. `tobj` mixes up the vertices of a mesh
    /// where only some have them: a face of another kind begins a new one.
    kind: Option<[bool; 2]>,
    /// Materials that `tobj` knows.
    materials: HashSet<String>,
    /// `mtllib` statements and their lines.
    libraries: Vec<(usize, String)>,
    line: usize,
    /// Line of the first face with fewer than three corners, and how many there are.
    incomplete: Option<(usize, usize)>,
    /// First unsupported statement, and its line.
    unknown: Option<(String, usize)>,
}

/// Position, texture coordinate and normal of a corner of a face, as written.
type Corner<'w> = (&'w str, Option<&'w str>, Option<&'w str>);

/// The words of a statement before a comment.
fn words(rest: &str) -> impl Iterator<Item = &str> {
    rest.split_whitespace().take_while(|word| !word.starts_with('#'))
}

impl<'a> Checker<'a> {
    fn new(path: &'a Path, colored: bool) -> Self {
        Checker {
            path,
            colored,
            positions: 0,
            uvs: 0,
            normals: 0,
            group: String::from(UNNAMED),
            kind: None,
            materials: HashSet::new(),
            libraries: Vec::new(),
            line: 0,
            incomplete: None,
            unknown: None,
        }
    }

    fn error(&self, message: impl std::fmt::Display) -> Error {
        Error::at(self.path, self.line, format!("object {:?}: {message}", self.group))
    }

    fn statement(&mut self, Statement { line, word, rest }: Statement, out: &mut String) -> Result<()> {
        self.line = line;
        match word {
            "v" => {
                self.numbers("vertex", "v", 3, rest, out)?;
                self.positions += 1;
                // Scanners and sculpting programs write a colour after the position, sRGB-encoded. A fourth number alone is a
                // weight for curves.
                if self.colored && words(rest).count() >= 6 {
                    out.pop();
                    let color = words(rest).skip(3).map(|word| [" ", word]).take(3).flatten().collect::<String>();
                    self.numbers("colour of a vertex", "", 3, &color, out)?;
                } else if self.colored {
                    out.pop();
                    out.push_str(" 1 1 1\n");
                }
            }
            "vn" => {
                self.numbers("normal", "vn", 3, rest, out)?;
                self.normals += 1;
            }
            "vt" => {
                // A one-dimensional texture has no v.
                let count = words(rest).count().clamp(1, 2);
                self.numbers("texture coordinate", "vt", count, rest, out)?;
                if count == 1 {
                    out.pop();
                    out.push_str(" 0\n");
                }
                self.uvs += 1;
            }
            "f" => self.face(rest, out)?,
            "o" | "g" => {
                self.group = String::from(if rest.is_empty() { UNNAMED } else { rest });
                self.kind = None;
            }
            "usemtl" => {
                let name = if rest.is_empty() { UNNAMED } else { rest };
                if !self.materials.contains(name) {
                    self.materials.insert(name.to_string());
                    line_of(out, ["mtllib ", name]);
                }
                line_of(out, ["usemtl ", name]);
            }
            "mtllib" => {
                if !self.libraries.iter().any(|(_, known)| known == rest) {
                    self.libraries.push((line, rest.to_string()));
                }
            }
            "s" | "l" | "p" | "vp" | "usemap" | "maplib" | "mg" | "lod" | "bevel" | "c_interp" | "d_interp" => {}
            _ => {
                self.unknown.get_or_insert_with(|| (word.to_string(), line));
            }
        }
        Ok(())
    }

    /// The first `count` numbers of a statement. Single precision must be able to hold them.
    fn numbers(&self, what: &str, keyword: &str, count: usize, rest: &str, out: &mut String) -> Result<()> {
        out.push_str(keyword);
        let mut words = words(rest);
        for _ in 0..count {
            let word = words.next().ok_or_else(|| self.error(format!("a {what} needs {count} numbers")))?;
            number(word).map_err(|m| self.error(format!("{what}: {m}")))?;
            out.push(' ');
            out.push_str(word);
        }
        out.push('\n');
        Ok(())
    }

    fn index(&self, what: &str, word: &str, count: usize) -> Result<()> {
        let index: i64 =
            word.parse().map_err(|_| self.error(format!("face: {what} index {word:?} is not a whole number")))?;
        // Negative indices count back from the last; zero is invalid.
        if index == 0 || index.unsigned_abs() > count as u64 {
            return Err(self.error(format!("face: {what} index {index} is out of range, {count} are defined so far")));
        }
        Ok(())
    }

    fn corner<'w>(&self, word: &'w str) -> Result<Corner<'w>> {
        let mut parts = word.split('/');
        let position = parts.next().unwrap_or_default();
        self.index("vertex", position, self.positions)?;
        let mut optional = |what: &str, count: usize| match parts.next() {
            None | Some("") => Ok(None),
            Some(part) => self.index(what, part, count).map(|()| Some(part)),
        };
        let uv = optional("texture coordinate", self.uvs)?;
        let normal = optional("normal", self.normals)?;
        if parts.next().is_some() {
            return Err(self.error(format!("face: corner {word:?} has more than three indices")));
        }
        Ok((position, uv, normal))
    }

    fn face(&mut self, rest: &str, out: &mut String) -> Result<()> {
        // The kinds of index that all corners have, and those that some have.
        let (mut all, mut some, mut count) = ([true; 2], [false; 2], 0usize);
        for word in words(rest) {
            let (_, uv, normal) = self.corner(word)?;
            for (kind, part) in [uv, normal].into_iter().enumerate() {
                all[kind] &= part.is_some();
                some[kind] |= part.is_some();
            }
            count += 1;
        }
        if count > MOST_CORNERS {
            return Err(self.error(format!("a face of {count} corners, at most {MOST_CORNERS} can be cut; split it")));
        }
        if count < 3 {
            self.incomplete.get_or_insert((self.line, 0)).1 += 1;
            return Ok(());
        }
        if self.kind != Some(all) {
            line_of(out, ["o ", &self.group]);
            self.kind = Some(all);
        }
        if all == some && !rest.contains('#') {
            line_of(out, ["f ", rest]);
            return Ok(());
        }
        out.push('f');
        for word in words(rest) {
            let (position, uv, normal) = self.corner(word)?;
            let [uv, normal] = [uv.filter(|_| all[0]), normal.filter(|_| all[1])].map(Option::unwrap_or_default);
            out.extend([" ", position, "/", uv, "/", normal]);
        }
        out.push('\n');
        Ok(())
    }

    fn warn(&self) {
        let path = self.path.display();
        if let Some((line, count)) = self.incomplete {
            log::warn!("{path}:{line}: left out {count} faces with fewer than three corners");
        }
        if let Some((word, line)) = &self.unknown {
            log::warn!("{path}:{line}: unknown statement {word:?} ignored");
        }
    }
}

fn line_of(out: &mut String, parts: [&str; 2]) {
    out.extend(parts);
    out.push('\n');
}
