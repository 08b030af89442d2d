//! MTL material libraries.
//!
//! `Kd`, `map_Kd` (their product is the base colour), `Ke` (radiance), `Ks` (reflectance at normal incidence), `Ns` or `Pr`
//! (roughness), `Pm` (metallic), `illum` (0, 1 diffuse; 3, 5 diffuse and an ideal mirror of `Ks`; 4, 9 glass that does not
//! bend light; 6, 7 glass that does; others diffuse and specular), `Tf` (tint of glass at each crossing) and `Ni` are
//! used; everything else is ignored. A mirror without `Kd` has no diffuse part; `Kd` and `Ks` of glass are ignored.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use glam::Vec3;
use rayon::prelude::*;

use super::obj::{keyword, logical_lines, number};
use super::{MIN_ROUGHNESS, Material, Scene, Surface, Texture, Wrap};
use crate::error::{Error, Result};

/// A material of a library.
pub(super) struct Entry {
    material: Material,
    map: Option<Map>,
}

/// `map_Kd`: the file, and the place of the statement.
struct Map {
    file: PathBuf,
    wrap: Wrap,
    library: PathBuf,
    line: usize,
}

/// The materials of a model by name. Textures that faces use are read by [`Library::read_textures`].
#[derive(Default)]
pub(super) struct Library {
    by_name: HashMap<String, u32>,
    /// Names used before any library defined them.
    undefined: BTreeSet<String>,
    /// Texture of a material that no face has used yet.
    waiting: HashMap<u32, Map>,
    textures: HashMap<(PathBuf, bool), u32>,
    /// Textures in use that have not been read yet, with the first material that uses each.
    unread: Vec<(u32, Map)>,
}

impl Library {
    /// Adds the materials of a file. The first definition of a name counts.
    pub(super) fn add(&mut self, scene: &mut Scene, entries: Vec<Entry>) {
        for Entry { material, map } in entries {
            let name = material.name.clone();
            let index = match self.by_name.get(&name) {
                Some(&index) if self.undefined.remove(&name) => {
                    scene.materials[index as usize] = material;
                    index
                }
                Some(_) => continue,
                None => scene.add_material(material),
            };
            self.by_name.insert(name, index);
            if let Some(map) = map {
                self.waiting.insert(index, map);
            }
        }
    }

    /// Index of a material; a grey placeholder until a library defines it.
    pub(super) fn named(&mut self, scene: &mut Scene, name: &str) -> u32 {
        if let Some(&index) = self.by_name.get(name) {
            return index;
        }
        let index = scene.add_material(Material { name: name.to_string(), ..Material::default() });
        self.by_name.insert(name.to_string(), index);
        self.undefined.insert(name.to_string());
        index
    }

    /// Index of the grey material of faces before any `usemtl`.
    pub(super) fn unnamed(&mut self, scene: &mut Scene) -> u32 {
        let index = self.named(scene, "default");
        self.undefined.remove("default");
        index
    }

    /// Gives a material its texture when the first face uses it.
    pub(super) fn mark_used(&mut self, scene: &mut Scene, material: u32) {
        if self.waiting.is_empty() {
            return;
        }
        let Some(map) = self.waiting.remove(&material) else { return };
        let next = self.textures.len() as u32;
        let texture = *self.textures.entry((map.file.clone(), map.wrap == Wrap::Clamp)).or_insert(next);
        scene.materials[material as usize].base_texture = Some(texture);
        if texture == next {
            self.unread.push((material, map));
        }
    }

    /// Reads all textures in use, on all cores. Errors: the first that cannot be read.
    pub(super) fn read_textures(&mut self, scene: &mut Scene) -> Result<()> {
        let read = |(material, map): (u32, Map)| {
            let error = |reason: String| {
                let (name, file) = (&scene.materials[material as usize].name, map.file.display());
                let message = format!("material {name:?}: texture {file} cannot be read: {reason}");
                Error::at(&map.library, map.line, message)
            };
            let bytes = std::fs::read(&map.file).map_err(|e| error(e.to_string()))?;
            let name = map.file.to_string_lossy().into_owned();
            Texture::decode(&bytes, name, true, [map.wrap; 2]).map_err(error)
        };
        let unread = std::mem::take(&mut self.unread);
        let textures: Vec<Result<Texture>> = unread.into_par_iter().with_max_len(1).map(read).collect();
        scene.textures = textures.into_iter().collect::<Result<_>>()?;
        Ok(())
    }

    /// Reports names that no library has defined.
    pub(super) fn warn_undefined(&self, path: &Path) {
        if !self.undefined.is_empty() {
            log::warn!("{}: materials {:?} are not defined anywhere; they are grey", path.display(), self.undefined);
        }
    }
}

/// The statements of one `newmtl`.
#[derive(Default)]
struct Statements {
    name: String,
    kd: Option<Vec3>,
    ks: Option<Vec3>,
    tf: Option<Vec3>,
    ke: Vec3,
    ns: f32,
    ni: Option<f32>,
    pr: Option<f32>,
    pm: f32,
    illum: i64,
    map: Option<Map>,
}

impl Statements {
    fn new(name: &str) -> Self {
        Statements { name: name.to_string(), illum: 2, ..Self::default() }
    }

    fn material(self, path: &Path) -> Entry {
        let surface = match self.illum {
            3 | 5 => Surface::Mirror,
            4 | 6 | 7 | 9 => Surface::Glass,
            _ => Surface::Opaque,
        };
        let base_color = match surface {
            Surface::Glass => self.tf.unwrap_or(Vec3::ONE),
            _ if self.map.is_some() => self.kd.unwrap_or(Vec3::ONE),
            Surface::Mirror => self.kd.unwrap_or(Vec3::ZERO),
            Surface::Opaque => self.kd.unwrap_or(Material::default().base_color),
        };
        let specular = match surface {
            Surface::Opaque if self.illum < 2 => Vec3::ZERO,
            Surface::Opaque => self.ks.unwrap_or(Vec3::ZERO),
            Surface::Mirror | Surface::Glass => self.ks.unwrap_or(Vec3::ONE),
        };
        // Phong's exponent n matches a GGX lobe of alpha = sqrt(2 / (n + 2)), and alpha = roughness^2.
        let roughness = self.pr.unwrap_or((2.0 / (self.ns + 2.0)).powf(0.25)).max(MIN_ROUGHNESS);
        // A metal's colour is in Kd, unless the file has already split it: Kd by 1 - Pm and Ks by Pm.
        let shared_out = self.map.is_none() && (base_color * self.pm).cmple(specular * (1.0 - self.pm) + 1e-4).all();
        let mut material = Material {
            name: self.name,
            surface,
            base_color,
            metallic: if shared_out { 0.0 } else { self.pm },
            roughness,
            specular,
            emission: self.ke,
            ior: self.ni.unwrap_or(1.5),
            thin: matches!(self.illum, 4 | 9),
            ..Material::default()
        };
        if surface != Surface::Glass && material.limit_albedo() > 1e-3 {
            let (path, name) = (path.display(), &material.name);
            log::warn!(
                "{path}: material {name:?} reflects more than it receives; lowered Kd to {}",
                material.base_color
            );
        }
        Entry { material, map: self.map }
    }
}

/// Reads a library; also returns the statements that it leaves out.
pub(super) fn read(path: &Path) -> Result<(Vec<Entry>, BTreeSet<String>)> {
    let bytes = std::fs::read(path).map_err(Error::io("reading", path))?;
    let text = String::from_utf8_lossy(&bytes);
    let mut entries = Vec::new();
    let mut current: Option<Statements> = None;
    let mut ignored = BTreeSet::new();
    for (line, content) in logical_lines(&text) {
        let Some((word, rest)) = keyword(&content) else { continue };
        if word == "newmtl" {
            entries.extend(current.replace(Statements::new(rest)).map(|m| m.material(path)));
            continue;
        }
        let Some(m) = &mut current else { continue };
        let error = |message: String| Error::at(path, line, format!("material {:?}: {word}: {message}", m.name));
        match word {
            "Kd" => m.kd = reflectance(path, line, word, rest).map_err(error)?,
            "Ks" => m.ks = reflectance(path, line, word, rest).map_err(error)?,
            "Tf" => m.tf = reflectance(path, line, word, rest).map_err(error)?,
            "Ke" => m.ke = color(rest).map_err(error)?.unwrap_or(Vec3::ZERO),
            "Ns" => m.ns = at_least(rest, 0.0).map_err(error)?,
            "Ni" => m.ni = Some(at_least(rest, 0.001).map_err(error)?),
            "Pr" => m.pr = Some(at_least(rest, 0.0).map_err(error)?.min(1.0)),
            "Pm" => m.pm = at_least(rest, 0.0).map_err(error)?.min(1.0),
            "illum" => m.illum = rest.parse().map_err(|_| error(format!("{rest:?} is not a whole number")))?,
            "map_Kd" => {
                let (name, wrap) = map_options(rest, &mut ignored);
                if name.is_empty() {
                    return Err(error(String::from("no file is named")));
                }
                let file = path.parent().unwrap_or(Path::new("")).join(name.replace('\\', "/"));
                m.map = Some(Map { file, wrap, library: path.to_path_buf(), line });
            }
            _ if word.starts_with("map_") || matches!(word, "bump" | "norm" | "disp" | "decal" | "refl") => {
                ignored.insert(word.to_string());
            }
            _ => {}
        }
    }
    entries.extend(current.map(|m| m.material(path)));
    if !ignored.is_empty() {
        let all: Vec<&str> = ignored.iter().map(String::as_str).collect();
        log::warn!("{}: not supported and left out: {}", path.display(), all.join("; "));
    }
    Ok((entries, ignored))
}

/// A colour: three numbers, or one for all channels; `None` for the spectral form, which is not supported.
fn color(rest: &str) -> Result<Option<Vec3>, String> {
    let mut words = rest.split_whitespace().peekable();
    match words.peek() {
        Some(&"spectral") => return Ok(None),
        // CIE XYZ of the same observer: to linear Rec. 709.
        Some(&"xyz") => {
            words.next();
            let c = channels(words)?;
            let rows = [
                Vec3::new(3.2406, -1.5372, -0.4986),
                Vec3::new(-0.9689, 1.8758, 0.0415),
                Vec3::new(0.0557, -0.204, 1.057),
            ];
            return Ok(Some(Vec3::from_array(rows.map(|row| row.dot(c))).max(Vec3::ZERO)));
        }
        _ => {}
    }
    let c = channels(words)?;
    if c.min_element() < 0.0 { Err(format!("{rest} is negative")) } else { Ok(Some(c)) }
}

fn channels<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<Vec3, String> {
    let first = number(words.next().ok_or("three numbers are needed")?)?;
    match (words.next(), words.next()) {
        (None, _) => Ok(Vec3::splat(first)),
        (Some(second), Some(third)) => Ok(Vec3::new(first, number(second)?, number(third)?)),
        (Some(_), None) => Err(String::from("three numbers are needed")),
    }
}

/// A colour of at most 1.
fn reflectance(path: &Path, line: usize, word: &str, rest: &str) -> Result<Option<Vec3>, String> {
    let c = color(rest)?;
    if c.is_some_and(|c| c.max_element() > 1.0) {
        log::warn!("{}:{line}: {word} {rest} reflects more than it receives; lowered to 1", path.display());
    }
    Ok(c.map(|c| c.min(Vec3::ONE)))
}

fn at_least(rest: &str, low: f32) -> Result<f32, String> {
    let x = number(rest.split_whitespace().next().ok_or("a number is needed")?)?;
    if x < low { Err(format!("{x} is below {low}")) } else { Ok(x) }
}

/// Splits the options of a map from its file name, which may hold spaces.
fn map_options<'a>(rest: &'a str, ignored: &mut BTreeSet<String>) -> (&'a str, Wrap) {
    let word = |text: &'a str| text.split_once(char::is_whitespace).map_or((text, ""), |(w, r)| (w, r.trim_start()));
    let mut wrap = Wrap::Repeat;
    let mut rest = rest.trim().trim_matches('"');
    while rest.starts_with('-') {
        let (option, mut after) = word(rest);
        let (values, numeric) = match option {
            "-clamp" => {
                wrap = if word(after).0 == "on" { Wrap::Clamp } else { Wrap::Repeat };
                (1, false)
            }
            "-blendu" | "-blendv" | "-cc" | "-texres" | "-bm" | "-boost" | "-imfchan" | "-type" | "-colorspace" => {
                (1, false)
            }
            "-mm" => (2, true),
            // One to three numbers each.
            "-o" | "-s" | "-t" => (3, true),
            _ => break,
        };
        for _ in 0..values {
            let (value, next) = word(after);
            if numeric && value.parse::<f32>().is_err() {
                break;
            }
            after = next;
        }
        if numeric {
            ignored.insert(format!("map_Kd {option}"));
        }
        rest = after;
    }
    (rest.trim().trim_matches('"'), wrap)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_come_before_the_file() {
        let mut ignored = BTreeSet::new();
        let mut parse = |rest: &'static str| map_options(rest, &mut ignored);
        assert_eq!(parse("wood.png"), ("wood.png", Wrap::Repeat));
        assert_eq!(parse("-clamp on -s 2 3 my wood 2.png"), ("my wood 2.png", Wrap::Clamp));
        assert_eq!(parse("-o 1 1 1 -mm 0 1 -blendu on dir\\wood.png"), ("dir\\wood.png", Wrap::Repeat));
        assert_eq!(parse("\"my wood.png\""), ("my wood.png", Wrap::Repeat));
        assert_eq!(parse("-strange.png"), ("-strange.png", Wrap::Repeat));
        assert!(ignored.contains("map_Kd -s"));
    }

    #[test]
    fn colours() {
        assert_eq!(color("0.5"), Ok(Some(Vec3::splat(0.5))));
        assert_eq!(color("1 2 3"), Ok(Some(Vec3::new(1.0, 2.0, 3.0))));
        assert_eq!(color("spectral file.rfl"), Ok(None));
        // The white of the D65 illuminant.
        let white = color("xyz 0.9505 1.0 1.089").unwrap().unwrap();
        assert!((white - 1.0).abs().max_element() < 2e-3, "{white}");
        for bad in ["", "1 2", "-1 0 0", "a b c", "nan 0 0"] {
            assert!(color(bad).is_err(), "{bad}");
        }
    }
}
