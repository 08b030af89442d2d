//! MTL material libraries, read by `tobj`.
//!
//! `Kd`, `map_Kd` (their product is the base colour), `Ke` (radiance), `Ks` (reflectance at normal incidence), `Ns` or `Pr`
//! (roughness), `Pm` (metallic), `illum` (0, 1 diffuse; 3, 5 diffuse and an ideal mirror of `Ks`; 4, 9 glass that does not
//! bend light; 6, 7 glass that does; others diffuse and specular), `Tf` (tint of glass at each crossing), `Ni`, `d` or 1 - `Tr`
//! (opacity), `map_d` (a factor of it), `norm` (normals) and `map_Ke` (emission, times `Ke`) are used; everything else is ignored.
//! A mirror without `Kd` has no diffuse part; `Kd`, `Ks` and opacity of glass are ignored. Where `map_Ke` stands without `Ke`, or with
//! a black one, as exporters write it, it is multiplied by 1; a model with no other emission gets the default sky too
//! ([`Scene::emission_is_relative`]).

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use glam::{Vec2, Vec3};

use super::obj::UNNAMED;
use super::obj_lines::{Statement, decode, number, through_tobj};
use super::obj_texture::{Maps, Textures, map_file};
use super::{Alpha, MIN_ROUGHNESS, Material, Scene, Surface};
use crate::error::{Error, Result};
use crate::input::Inputs;

/// The materials of a model by name. Textures that faces use are read by [`Library::read_textures`].
#[derive(Default)]
pub(super) struct Library {
    by_name: HashMap<String, u32>,
    /// Names that no library defines.
    undefined: BTreeSet<String>,
    maps: HashMap<u32, Maps>,
    textures: Textures,
}

impl Library {
    /// Adds the materials of the files that a `mtllib` statement names. The first definition of a name counts.
    pub(super) fn read(
        &mut self,
        scene: &mut Scene,
        inputs: &Inputs,
        model: &Path,
        (line, rest): (usize, &str),
    ) -> Result<()> {
        let folder = model.parent().unwrap_or(Path::new(""));
        // One name, with spaces or not; else several, whose own spaces are escaped.
        let mut files = vec![folder.join(rest.replace('\\', "/"))];
        if !crate::input::is_file(&files[0]) {
            let escaped = rest.replace("\\ ", "\0");
            let names = escaped.split_whitespace().map(|name| name.replace('\0', " ").replace('\\', "/"));
            files = names.map(|name| folder.join(name)).collect();
        }
        let (found, missing): (Vec<_>, Vec<_>) = files.into_iter().partition(|file| crate::input::is_file(file));
        for file in found {
            let (materials, ignored) = read(&file, inputs)?;
            for (material, maps) in materials {
                if !self.by_name.contains_key(&material.name) {
                    let name = material.name.clone();
                    let index = scene.add_material(material);
                    self.by_name.insert(name, index);
                    self.maps.insert(index, maps);
                }
            }
            for what in ignored {
                scene.leave_out(what);
            }
        }
        if !missing.is_empty() {
            let model = model.display();
            log::warn!("{model}:{line}: no such material library; its materials are grey: {missing:?}");
        }
        Ok(())
    }

    /// Index of a material; grey if no library defines it.
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

    /// Lets the textures of a material be read; returns scale and offset of its texture coordinates.
    pub(super) fn mark_used(&mut self, material: u32) -> [Vec2; 2] {
        let Some(maps) = self.maps.get(&material) else { return [Vec2::ONE, Vec2::ZERO] };
        self.textures.want(material, maps);
        maps.placement()
    }

    /// Reads all textures in use. Errors: the first colour texture that cannot be read.
    pub(super) fn read_textures(&mut self, scene: &mut Scene, inputs: &Inputs) -> Result<()> {
        self.textures.read(scene, inputs)
    }

    /// Reports names that no library has defined.
    pub(super) fn warn_undefined(&self, path: &Path) {
        if !self.undefined.is_empty() {
            log::warn!("{}: materials {:?} are not defined anywhere; they are grey", path.display(), self.undefined);
        }
    }
}

/// Materials of a file, with their maps.
type Described = Vec<(Material, Maps)>;

/// Reads a library; also returns what it leaves out.
fn read(path: &Path, inputs: &Inputs) -> Result<(Described, BTreeSet<String>)> {
    let bytes = inputs.read(path)?;
    let mut current: Option<String> = None;
    let mut ignored = BTreeSet::new();
    // Lines of the maps of each material.
    let mut places: HashMap<String, HashMap<&str, usize>> = HashMap::new();
    let rewrite = |Statement { line, word, rest }: Statement, out: &mut String| {
        if word == "newmtl" {
            let name = if rest.is_empty() { UNNAMED } else { rest };
            current = Some(name.to_string());
            out.extend(["newmtl ", name, "\n"]);
            return Ok(());
        }
        let Some(material) = &current else { return Ok(()) };
        let refused = |message: String| Error::at(path, line, format!("material {material:?}: {word}: {message}"));
        let rest = match word {
            "Kd" | "Ks" | "Tf" => reflectance(path, line, word, rest).map_err(refused)?,
            "Ke" => color(rest).map_err(refused)?.map(three),
            "Ns" | "Pr" | "Pm" | "Tr" => Some(at_least(rest, 0.0).map_err(refused)?.to_string()),
            "d" => Some(at_least(rest.trim_start_matches("-halo"), 0.0).map_err(refused)?.to_string()),
            "Ni" => Some(at_least(rest, 0.001).map_err(refused)?.to_string()),
            "illum" => {
                let model: i64 = rest.parse().map_err(|_| refused(format!("{rest:?} is not a whole number")))?;
                Some(model.clamp(0, 255).to_string())
            }
            _ => match Maps::USED.into_iter().find(|used| *used == word) {
                Some(used) => {
                    if map_file(rest).is_empty() {
                        return Err(refused(String::from("no file is named")));
                    }
                    places.entry(material.clone()).or_default().insert(used, line);
                    Some(rest.to_string())
                }
                None => {
                    if word.starts_with("map_") || matches!(word, "bump" | "disp" | "decal" | "refl") {
                        ignored.insert(word.to_string());
                    }
                    None
                }
            },
        };
        if let Some(rest) = rest {
            out.extend([word, " ", &rest, "\n"]);
        }
        Ok(())
    };
    let (read, _) = through_tobj(path, &decode(&bytes), rewrite, |mut lines| tobj::load_mtl_buf(&mut lines))?;
    let mut materials = Vec::with_capacity(read.len());
    for statements in read {
        let places = places.remove(&statements.name).unwrap_or_default();
        let maps = Maps::new(path, &statements, &places, &mut ignored);
        materials.push((material(path, &statements, &maps), maps));
    }
    if !ignored.is_empty() {
        let all: Vec<&str> = ignored.iter().map(String::as_str).collect();
        log::warn!("{}: not supported and left out: {}", path.display(), all.join("; "));
    }
    Ok((materials, ignored))
}

/// The material of one `newmtl`. Its numbers have been checked.
fn material(path: &Path, from: &tobj::Material, maps: &Maps) -> Material {
    let unknown = |word: &str| from.unknown_param.get(word);
    let other_number = |word: &str| unknown(word).and_then(|rest| number(rest).ok());
    let three = |c: Option<[f64; 3]>| c.map(|c| Vec3::from_array(c.map(|x| x as f32)));
    let (kd, ks) = (three(from.diffuse), three(from.specular));
    let illum = from.illumination_model.unwrap_or(2);
    let surface = match illum {
        3 | 5 => Surface::Mirror,
        4 | 6 | 7 | 9 => Surface::Glass,
        _ => Surface::Opaque,
    };
    let base_color = match surface {
        Surface::Glass => unknown("Tf").and_then(|rest| color(rest).ok()?).unwrap_or(Vec3::ONE),
        _ if maps.color.is_some() => kd.unwrap_or(Vec3::ONE),
        Surface::Mirror => kd.unwrap_or(Vec3::ZERO),
        Surface::Opaque => kd.unwrap_or(Material::default().base_color),
    };
    let specular = match surface {
        Surface::Opaque if illum < 2 => Vec3::ZERO,
        Surface::Opaque => ks.unwrap_or(Vec3::ZERO),
        Surface::Mirror | Surface::Glass => ks.unwrap_or(Vec3::ONE),
    };
    // Phong's exponent n matches a GGX lobe of alpha = sqrt(2 / (n + 2)), and alpha = roughness^2.
    let ns = from.shininess.unwrap_or(0.0) as f32;
    let roughness = other_number("Pr").map_or((2.0 / (ns + 2.0)).powf(0.25), |pr| pr.min(1.0)).max(MIN_ROUGHNESS);
    // A metal's colour is in Kd, unless the file has already split it: Kd by 1 - Pm and Ks by Pm.
    let pm = other_number("Pm").unwrap_or(0.0).min(1.0);
    let shared_out = maps.color.is_none() && (base_color * pm).cmple(specular * (1.0 - pm) + 1e-4).all();
    let opacity = match (from.dissolve, other_number("Tr")) {
        (Some(d), _) => (d as f32).min(1.0),
        (None, Some(tr)) => 1.0 - tr.min(1.0),
        (None, None) => 1.0,
    };
    let emission = three(from.emissive).unwrap_or(Vec3::ZERO);
    let alpha = match surface {
        Surface::Opaque | Surface::Mirror if opacity < 1.0 || maps.alpha.is_some() => Alpha::Blend { opacity },
        _ => Alpha::Opaque,
    };
    let mut material = Material {
        name: from.name.clone(),
        surface,
        base_color,
        metallic: if shared_out { 0.0 } else { pm },
        roughness,
        normal_scale: maps.normal.as_ref().map_or(1.0, |map| map.options.bump),
        specular,
        alpha,
        emission,
        ior: from.optical_density.map_or(1.5, |ni| ni as f32),
        thin: matches!(illum, 4 | 9),
        ..Material::default()
    };
    if surface != Surface::Glass && material.limit_albedo() > 1e-3 {
        let (path, name) = (path.display(), &material.name);
        log::warn!("{path}: material {name:?} reflects more than it receives; lowered Kd to {}", material.base_color);
    }
    material
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

/// A colour of at most 1, as three numbers.
fn reflectance(path: &Path, line: usize, word: &str, rest: &str) -> Result<Option<String>, String> {
    let c = color(rest)?;
    if c.is_some_and(|c| c.max_element() > 1.0) {
        log::warn!("{}:{line}: {word} {rest} reflects more than it receives; lowered to 1", path.display());
    }
    Ok(c.map(|c| three(c.min(Vec3::ONE))))
}

fn at_least(rest: &str, low: f32) -> Result<f32, String> {
    let x = number(rest.split_whitespace().next().ok_or("a number is needed")?)?;
    if x < low { Err(format!("{x} is below {low}")) } else { Ok(x) }
}

/// A colour as three numbers.
fn three(c: Vec3) -> String {
    format!("{} {} {}", c.x, c.y, c.z)
}

#[cfg(test)]
mod tests {
    use super::*;

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
