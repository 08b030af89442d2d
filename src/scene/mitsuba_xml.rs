//! Elements of a scene in Mitsuba's XML: files included, parameters put in, names in one style.

use std::path::{Path, PathBuf};
use std::rc::Rc;

use glam::{DMat4, DVec3, DVec4, Vec3};
use roxmltree::{Document, Node, ParsingOptions};

use crate::error::{Error, Result};
use crate::input::Inputs;

/// Greatest depth of elements within elements, and of files within files.
pub(super) const MAX_NESTING: usize = 32;

/// Greatest number of elements of a scene, with those of included files.
const MAX_ELEMENTS: u32 = 4_000_000;

/// Greatest number of files, each as often as it is included.
const MAX_FILES: u32 = 4096;

/// Greatest length of an attribute with the values of parameters in it: each may stand for several others.
const MAX_VALUE: usize = 1 << 20;

/// An element of the scene; its names are in lower case with underscores, as Mitsuba 3 has them (0.6: `toWorld`).
pub(super) struct Element {
    pub(super) tag: String,
    attributes: Vec<(String, String)>,
    pub(super) children: Vec<Element>,
    file: Rc<PathBuf>,
    line: usize,
}

/// Reads a file and those that it includes.
pub(super) fn read(path: &Path, inputs: &Inputs) -> Result<Element> {
    Reader { inputs, parameters: Vec::new(), elements: 0, files: 0 }.file(path, 0)
}

struct Reader<'a> {
    inputs: &'a Inputs,
    /// Names and values, in the order of their definition; the first definition of a name counts.
    parameters: Vec<(String, String)>,
    elements: u32,
    files: u32,
}

impl Reader<'_> {
    fn file(&mut self, path: &Path, depth: usize) -> Result<Element> {
        self.files += 1;
        if self.files > MAX_FILES {
            return Err(Error::file(path, format!("more than {MAX_FILES} files are included; join them")));
        }
        let bytes = self.inputs.read(path)?;
        let text = String::from_utf8_lossy(&bytes);
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        // Without a DTD there are no entities that could expand.
        let options = ParsingOptions { nodes_limit: MAX_ELEMENTS * 4, ..ParsingOptions::default() };
        let document = Document::parse_with_options(text, options)
            .map_err(|e| Error::at(path, e.pos().row as usize, format!("not well-formed XML: {e}")))?;
        let lines: Vec<usize> = text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(at, _)| at).collect();
        let root = document.root_element();
        if root.tag_name().name() != "scene" {
            let message = format!("the root element is <{}>; a scene of Mitsuba has <scene>", root.tag_name().name());
            return Err(Error::file(path, message));
        }
        self.element(&Rc::new(path.to_path_buf()), &lines, root, depth)
    }

    fn element(&mut self, file: &Rc<PathBuf>, lines: &[usize], node: Node, depth: usize) -> Result<Element> {
        let line = lines.partition_point(|&at| at < node.range().start) + 1;
        let error = |message: String| Error::at(file, line, message);
        self.elements += 1;
        if depth > MAX_NESTING || self.elements > MAX_ELEMENTS {
            return Err(error(format!("elements are nested deeper than {MAX_NESTING}, or there are too many")));
        }
        let mut element = Element {
            tag: node.tag_name().name().to_string(),
            attributes: Vec::new(),
            children: Vec::new(),
            file: file.clone(),
            line,
        };
        for attribute in node.attributes() {
            let value = self.filled_in(attribute.value()).map_err(error)?;
            let value = if attribute.name() == "name" { snake_case(&value) } else { value };
            element.attributes.push((attribute.name().to_string(), value));
        }
        for child in node.children().filter(Node::is_element) {
            let inner = self.element(file, lines, child, depth + 1)?;
            match inner.tag.as_str() {
                "default" => {
                    let name = child.attribute("name").unwrap_or_default();
                    if name.is_empty() {
                        return Err(inner.error("a parameter without a name"));
                    }
                    let value = inner.attribute("value").unwrap_or_default().to_string();
                    self.parameters.push((name.to_string(), value));
                }
                "include" => {
                    let name = inner.attribute("filename").ok_or_else(|| inner.error("no filename"))?;
                    let path = inner.path(name);
                    if !crate::input::is_file(&path) {
                        return Err(inner.error(format!("included file {} does not exist", path.display())));
                    }
                    let mut included = self.file(&path, depth + 1)?;
                    element.children.append(&mut included.children);
                }
                _ => element.children.push(inner),
            }
        }
        Ok(element)
    }

    /// The text with the values of parameters in place of `$name`.
    fn filled_in(&self, text: &str) -> Result<String, String> {
        let mut parts = text.split('$');
        let mut filled = parts.next().unwrap_or_default().to_string();
        for part in parts {
            let end = part.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(part.len());
            let (name, rest) = part.split_at(end);
            let known = self.parameters.iter().find(|(known, _)| known == name);
            let (_, value) = known.ok_or_else(|| format!("parameter ${name} has no <default>"))?;
            filled += value;
            filled += rest;
            if filled.len() > MAX_VALUE {
                return Err(format!("parameter ${name} makes a value of more than {MAX_VALUE} bytes"));
            }
        }
        Ok(filled)
    }
}

/// `toWorld` as `to_world`, `intIOR` as `int_ior`.
fn snake_case(name: &str) -> String {
    let mut snake = String::new();
    let mut after_lower = false;
    for c in name.chars() {
        if c.is_ascii_uppercase() && after_lower {
            snake.push('_');
        }
        after_lower = c.is_ascii_lowercase() || c.is_ascii_digit();
        snake.push(c.to_ascii_lowercase());
    }
    snake
}

/// Numbers that commas or white space separate.
pub(super) fn numbers(text: &str) -> Result<Vec<f64>, String> {
    let words = text.split(|c: char| c == ',' || c.is_whitespace()).filter(|word| !word.is_empty());
    words.map(number).collect()
}

/// A number that single precision can hold.
fn number(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(x) if (x as f32).is_finite() => Ok(x),
        Ok(_) => Err(format!("{word} is not a finite number")),
        Err(_) => Err(format!("{word:?} is not a number")),
    }
}

impl Element {
    /// An error at the element.
    pub(super) fn error(&self, message: impl std::fmt::Display) -> Error {
        let name = self.attribute("name").or(self.attribute("id")).or(self.attribute("type"));
        let name = name.map(|n| format!(" {n:?}")).unwrap_or_default();
        Error::at(&self.file, self.line, format!("<{}>{name}: {message}", self.tag))
    }

    pub(super) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// The attribute `type`.
    pub(super) fn kind(&self) -> &str {
        self.attribute("type").unwrap_or_default()
    }

    /// A name for what the element stands for.
    pub(super) fn label(&self) -> String {
        self.attribute("id").map_or_else(|| format!("{} of line {}", self.kind(), self.line), str::to_string)
    }

    /// A file relative to that of the element.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.file.parent().unwrap_or(Path::new("")).join(name.replace('\\', "/"))
    }

    pub(super) fn children_of<'a>(&'a self, tag: &'a str) -> impl Iterator<Item = &'a Element> {
        self.children.iter().filter(move |child| child.tag == tag)
    }

    /// The child of this name.
    pub(super) fn property(&self, name: &str) -> Option<&Element> {
        self.children.iter().find(|child| child.attribute("name") == Some(name))
    }

    /// The attribute `value`.
    pub(super) fn value(&self) -> Result<&str> {
        self.attribute("value").ok_or_else(|| self.error("no value"))
    }

    pub(super) fn numbers(&self) -> Result<Vec<f64>> {
        numbers(self.value()?).map_err(|m| self.error(m))
    }

    /// The number of this name.
    pub(super) fn number(&self, name: &str) -> Result<Option<f32>> {
        let Some(property) = self.property(name).filter(|p| matches!(p.tag.as_str(), "float" | "integer" | "spectrum"))
        else {
            return Ok(None);
        };
        match property.numbers()?[..] {
            [x] => Ok(Some(x as f32)),
            _ => Err(property.error("one number is needed")),
        }
    }

    pub(super) fn integer(&self, name: &str) -> Result<Option<i64>> {
        let Some(x) = self.number(name)? else { return Ok(None) };
        if x.fract() == 0.0 { Ok(Some(x as i64)) } else { Err(self.error(format!("{name} {x} is not a whole number"))) }
    }

    pub(super) fn string(&self, name: &str) -> Option<&str> {
        self.property(name).filter(|p| p.tag == "string").and_then(|p| p.attribute("value"))
    }

    pub(super) fn boolean(&self, name: &str) -> Result<bool> {
        let Some(property) = self.property(name) else { return Ok(false) };
        match property.value()?.to_ascii_lowercase().as_str() {
            "true" => Ok(true),
            "false" => Ok(false),
            other => Err(property.error(format!("{other:?} is neither true nor false"))),
        }
    }

    /// The point or vector of this name.
    pub(super) fn vector(&self, name: &str) -> Result<Option<DVec3>> {
        self.property(name).map(|p| p.axes(0.0)).transpose()
    }

    /// x, y and z, or `value`: three numbers or one for all.
    fn axes(&self, otherwise: f64) -> Result<DVec3> {
        if let Some(value) = self.attribute("value") {
            return self.triple(value);
        }
        let axis = |name: &str| match self.attribute(name) {
            Some(word) => number(word.trim()).map_err(|m| self.error(format!("{name}: {m}"))),
            None => Ok(otherwise),
        };
        Ok(DVec3::new(axis("x")?, axis("y")?, axis("z")?))
    }

    fn triple(&self, text: &str) -> Result<DVec3> {
        match numbers(text).map_err(|m| self.error(m))?[..] {
            [x] => Ok(DVec3::splat(x)),
            [x, y, z] => Ok(DVec3::new(x, y, z)),
            _ => Err(self.error(format!("three numbers are needed, not {text:?}"))),
        }
    }

    /// The transform of this name; the identity if there is none.
    pub(super) fn transform(&self, name: &str) -> Result<DMat4> {
        let Some(transform) = self.property(name) else { return Ok(DMat4::IDENTITY) };
        let mut whole = DMat4::IDENTITY;
        for step in &transform.children {
            whole = step.step()? * whole;
        }
        let determinant = whole.determinant();
        if !(whole.as_mat4().is_finite() && determinant.is_finite() && determinant != 0.0) {
            return Err(transform.error("the transform cannot be inverted"));
        }
        if whole.row(3) != DVec4::W {
            return Err(transform.error("a projective transform"));
        }
        Ok(whole)
    }

    /// One step of a transform.
    fn step(&self) -> Result<DMat4> {
        Ok(match self.tag.as_str() {
            "translate" => DMat4::from_translation(self.axes(0.0)?),
            "scale" => DMat4::from_scale(self.axes(1.0)?),
            "rotate" => {
                let axis = self.axes(0.0)?.try_normalize().ok_or_else(|| self.error("the axis has no direction"))?;
                let angle = self.attribute("angle").ok_or_else(|| self.error("no angle"))?;
                DMat4::from_axis_angle(axis, number(angle.trim()).map_err(|m| self.error(m))?.to_radians())
            }
            "matrix" => {
                let n = self.numbers()?;
                match n.len() {
                    16 => DMat4::from_cols_slice(&n).transpose(),
                    9 => DMat4::from_mat3(glam::DMat3::from_cols_slice(&n).transpose()),
                    _ => return Err(self.error(format!("a matrix has 16 or 9 numbers, not {}", n.len()))),
                }
            }
            "lookat" | "lookAt" | "look_at" => {
                let point = |name: &str| self.attribute(name).map(|text| self.triple(text)).transpose();
                let eye = point("origin")?.ok_or_else(|| self.error("no origin"))?;
                let target = point("target")?.ok_or_else(|| self.error("no target"))?;
                let forward = (target - eye).normalize_or_zero();
                let up = point("up")?.filter(|up| *up != DVec3::ZERO);
                let up = up.unwrap_or_else(|| forward.any_orthonormal_vector());
                let left = up.cross(forward).try_normalize();
                let left = left.ok_or_else(|| self.error("origin, target and up span no view"))?;
                let up = forward.cross(left);
                DMat4::from_cols(left.extend(0.0), up.extend(0.0), forward.extend(0.0), eye.extend(1.0))
            }
            _ => return Err(self.error("not a step of a transform that is read")),
        })
    }

    /// The colour that `#rrggbb` stands for, or that of `value`, as it stands.
    pub(super) fn channels(&self) -> Result<Vec3> {
        let text = self.value()?.trim();
        let Some(digits) = text.strip_prefix('#') else { return self.triple(text).map(|c| c.as_vec3()) };
        let code = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6);
        let code = code.ok_or_else(|| self.error(format!("{text:?} is not a colour like #8090a0")))?;
        let channel = |shift: u32| super::texture::srgb_to_linear((code >> shift & 255) as f32 / 255.0);
        Ok(Vec3::new(channel(16), channel(8), channel(0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_all_versions_are_one() {
        for (name, expected) in
            [("toWorld", "to_world"), ("intIOR", "int_ior"), ("extEta", "ext_eta"), ("to_uv", "to_uv"), ("k", "k")]
        {
            assert_eq!(snake_case(name), expected);
        }
    }

    #[test]
    fn parameters_are_put_in() {
        let parameters = [("a", "1"), ("ab", "2"), ("a", "3")].map(|(n, v)| (n.to_string(), v.to_string())).to_vec();
        let reader = Reader { inputs: &Inputs::anywhere(), parameters, elements: 0, files: 0 };
        assert_eq!(reader.filled_in("$a,$ab-$a.png"), Ok(String::from("1,2-1.png")));
        assert!(reader.filled_in("$b").is_err());
    }
}
