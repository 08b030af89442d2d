//! Colours, spectra and textures of Mitsuba's scenes.

use std::path::PathBuf;

use glam::{Affine2, Mat2, Vec2, Vec3};

use super::linear_to_srgb;
use super::mitsuba::Reader;
use super::mitsuba_xml::{Element, numbers};
use super::sky::{observer, rgb_from_xyz};
use super::texture::srgb_to_linear;
use super::{Texture, Wrap};
use crate::error::{Error, Result};
use crate::input::Inputs;

/// Texels along the side of the texture that stands for a checkerboard.
const CHECKER_SIZE: u32 = 128;

/// A colour, or one at each point of a surface.
pub(super) enum Value {
    Color(Vec3),
    Image(Image),
    /// The colours of the vertices.
    Vertices,
}

/// A texture that is not read yet.
#[derive(Clone)]
pub(super) struct Image {
    source: Source,
    pub(super) map: Affine2,
    /// Factor of its colour.
    pub(super) factor: Vec3,
}

#[derive(Clone)]
enum Source {
    Bitmap {
        file: PathBuf,
        srgb: bool,
        wrap: Wrap,
    },
    /// Two colours of at most 1.
    Checker([Vec3; 2]),
}

impl Image {
    /// Tells it from other images in the table of textures.
    pub(super) fn key(&self) -> String {
        match &self.source {
            Source::Bitmap { file, srgb, wrap } => format!("{} {srgb} {wrap:?}", file.display()),
            Source::Checker(colors) => format!("checkerboard {colors:?}"),
        }
    }

    /// Reads it. Opaque: these scenes have opacity in textures of their own.
    pub(super) fn load(&self, inputs: &Inputs) -> Result<Texture> {
        match &self.source {
            Source::Bitmap { file, srgb, wrap } => {
                let bytes = inputs.read(file)?;
                let mut texture = Texture::decode(inputs, &bytes, file.display().to_string(), *srgb, [*wrap; 2])
                    .map_err(|why| Error::file(file, format!("the texture cannot be read: {why}")))?;
                texture.texels.iter_mut().for_each(|texel| texel[3] = 255);
                Ok(texture)
            }
            Source::Checker(colors) => {
                let texels = colors.map(|c| {
                    let [r, g, b] = c.to_array().map(encode);
                    [r, g, b, 255]
                });
                let half = CHECKER_SIZE / 2;
                let texel = |i: u32| texels[usize::from((i % CHECKER_SIZE < half) != (i / CHECKER_SIZE < half))];
                Ok(Texture {
                    name: String::from("checkerboard"),
                    width: CHECKER_SIZE,
                    height: CHECKER_SIZE,
                    texels: (0..CHECKER_SIZE * CHECKER_SIZE).map(texel).collect(),
                    srgb: true,
                    wrap: [Wrap::Repeat; 2],
                })
            }
        }
    }
}

/// The sRGB encoding of a linear value in eight bits.
pub(super) fn encode(x: f32) -> u8 {
    (255.0 * linear_to_srgb(x.clamp(0.0, 1.0))).round() as u8
}

impl<'a> Reader<'a> {
    /// The colour or texture of this name.
    pub(super) fn color(&mut self, element: &'a Element, name: &str, otherwise: Vec3) -> Result<Value> {
        match element.property(name) {
            Some(property) => self.value(property, false),
            None => Ok(Value::Color(otherwise)),
        }
    }

    /// The colour of this name, of a texture its mean.
    pub(super) fn plain(&mut self, element: &'a Element, name: &str, otherwise: f32) -> Result<Vec3> {
        let value = self.color(element, name, Vec3::splat(otherwise))?;
        self.mean(value, &format!("textures of {name} (their mean is used)"))
    }

    pub(super) fn mean(&mut self, value: Value, what: &str) -> Result<Vec3> {
        match value {
            Value::Color(color) => Ok(color),
            Value::Image(image) => {
                self.leave_out(what);
                Ok(image.factor * image.load(self.inputs)?.average())
            }
            Value::Vertices => {
                self.leave_out(what);
                Ok(Vec3::ONE)
            }
        }
    }

    /// A radiant quantity of this name, 1 if there is none.
    pub(super) fn emitted(&mut self, element: &'a Element, name: &str) -> Result<Vec3> {
        let Some(property) = element.property(name) else { return Ok(Vec3::ONE) };
        let value = self.value(property, true)?;
        let color = self.mean(value, "the pattern of emission textures (their mean is used)")?;
        if color.is_finite() && color.min_element() >= 0.0 {
            return Ok(color);
        }
        Err(property.error(format!("{color} must be finite and not negative")))
    }

    fn value(&mut self, property: &'a Element, emission: bool) -> Result<Value> {
        let property = self.resolve(property)?;
        match property.tag.as_str() {
            "float" | "rgb" => property.channels().map(Value::Color),
            "srgb" => property.channels().map(|c| Value::Color(c.map(srgb_to_linear))),
            "spectrum" => spectrum(property, emission).map(Value::Color),
            "texture" => self.texture_of(property),
            other => Err(property.error(format!("colours of the kind <{other}> are not read"))),
        }
    }

    pub(super) fn texture_of(&mut self, element: &'a Element) -> Result<Value> {
        let map = uv_map(element)?;
        match element.kind() {
            "bitmap" => {
                let file = self.file(element)?;
                let wrap = match element.string("wrap_mode").unwrap_or("repeat") {
                    "repeat" => Wrap::Repeat,
                    "mirror" => Wrap::Mirror,
                    "clamp" => Wrap::Clamp,
                    other => {
                        self.leave_out(format!("wrap_mode {other:?} (repeat)"));
                        Wrap::Repeat
                    }
                };
                if element.string("filter_type") == Some("nearest") {
                    self.leave_out("filter_type \"nearest\" (bilinear)");
                }
                let linear = element.number("gamma")? == Some(1.0);
                let extension = super::extension(&file);
                if matches!(extension.as_str(), "exr" | "hdr" | "pfm") {
                    self.leave_out("values above 1 of textures of high dynamic range");
                }
                let srgb = !(element.boolean("raw")? || linear);
                Ok(Value::Image(Image { source: Source::Bitmap { file, srgb, wrap }, map, factor: Vec3::ONE }))
            }
            "checkerboard" => {
                let colors = [self.plain(element, "color0", 0.4)?, self.plain(element, "color1", 0.2)?];
                // The texture holds the share of the brighter channel, which eight bits resolve best.
                let factor = colors[0].max(colors[1]).clamp(Vec3::splat(1e-6), Vec3::ONE);
                let shares = colors.map(|c| c.clamp(Vec3::ZERO, Vec3::ONE) / factor);
                Ok(Value::Image(Image { source: Source::Checker(shares), map, factor }))
            }
            "mesh_attribute" if element.string("name") == Some("vertex_color") => Ok(Value::Vertices),
            "vertexcolors" => Ok(Value::Vertices),
            "scale" => {
                let scale = element.number("scale")?.unwrap_or(1.0);
                let inner = self.child(element, "texture")?.ok_or_else(|| element.error("no texture inside"))?;
                match self.texture_of(inner)? {
                    Value::Image(image) => Ok(Value::Image(Image { factor: image.factor * scale, ..image })),
                    other => Ok(other),
                }
            }
            other => {
                self.leave_out(format!("texture {other:?} (grey)"));
                Ok(Value::Color(Vec3::splat(0.5)))
            }
        }
    }
}

/// `to_uv`, or the offsets and scales of version 0.6.
fn uv_map(element: &Element) -> Result<Affine2> {
    let m = element.transform("to_uv")?;
    let [x, y, w] = [m.x_axis, m.y_axis, m.w_axis].map(|axis| Vec2::new(axis.x as f32, axis.y as f32));
    let map = Affine2::from_mat2_translation(Mat2::from_cols(x, y), w);
    let number = |name: &str, otherwise: f32| Ok::<f32, Error>(element.number(name)?.unwrap_or(otherwise));
    let scale = Vec2::new(number("uscale", 1.0)?, number("vscale", 1.0)?);
    let offset = Vec2::new(number("uoffset", 0.0)?, number("voffset", 0.0)?);
    Ok(map * Affine2::from_scale_angle_translation(scale, 0.0, offset))
}

/// A spectrum as a colour: one value for all wavelengths, three for the channels, or pairs `wavelength:value`.
///
/// That of an emitter is seen as it is; a reflectance under the illuminant D65.
fn spectrum(element: &Element, emission: bool) -> Result<Vec3> {
    if element.attribute("filename").is_some() {
        return Err(element.error("spectra in files of their own are not read; give them as `value`"));
    }
    let text = element.value()?;
    if !text.contains(':') {
        let color = element.channels()?;
        let uniform = numbers(text).is_ok_and(|n| n.len() == 1);
        return Ok(if uniform && emission { color * integrate(|_| 1.0, |_| 1.0) } else { color });
    }
    let mut points = Vec::new();
    for pair in text.split(|c: char| c == ',' || c.is_whitespace()).filter(|word| !word.is_empty()) {
        let pair = numbers(&pair.replace(':', " ")).map_err(|m| element.error(m))?;
        let [nm, value] = pair[..] else { return Err(element.error("pairs of a wavelength and a value are needed")) };
        if points.last().is_some_and(|&(last, _)| last >= nm as f32) {
            return Err(element.error("wavelengths must grow"));
        }
        points.push((nm as f32, value as f32));
    }
    let value = |nm: f32| {
        let after = points.partition_point(|&(at, _)| at <= nm);
        match (after.checked_sub(1).map(|i| points[i]), points.get(after)) {
            (Some((x0, y0)), Some(&(x1, y1))) => y0 + (y1 - y0) * (nm - x0) / (x1 - x0),
            (Some((x0, y0)), None) if nm == x0 => y0,
            _ => 0.0,
        }
    };
    let color = if emission { integrate(value, |_| 1.0) } else { integrate(value, d65) };
    Ok(color.max(Vec3::ZERO))
}

/// Linear Rec. 709 of a spectrum times an illuminant; luminance 1 of the illuminant alone.
fn integrate(value: impl Fn(f32) -> f32, light: impl Fn(f32) -> f32) -> Vec3 {
    let steps = || (0..=94).map(|i| 360.0 + 5.0 * i as f32);
    let xyz: Vec3 = steps().map(|nm| observer(nm) * (value(nm) * light(nm))).sum();
    let whole: f32 = steps().map(|nm| observer(nm).y * light(nm)).sum();
    rgb_from_xyz(xyz / whole)
}

/// The illuminant D65 of the CIE, relative, at each 20 nm from 360 nm.
fn d65(nm: f32) -> f32 {
    const TABLE: [f32; 25] = [
        46.64, 49.98, 82.75, 93.43, 104.86, 117.81, 115.92, 109.35, 104.79, 104.41, 100.0, 95.79, 90.01, 87.7, 83.29,
        80.03, 80.21, 78.28, 71.61, 75.09, 46.42, 63.38, 59.45, 60.0, 60.0,
    ];
    let at = ((nm - 360.0) / 20.0).clamp(0.0, 23.999);
    let i = at as usize;
    TABLE[i] + (TABLE[i + 1] - TABLE[i]) * at.fract()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spectra_are_colours() {
        // By Mitsuba 3.9.1.
        let white = integrate(|_| 1.0, |_| 1.0);
        assert!((white - Vec3::new(1.2048, 0.9483, 0.9089)).abs().max_element() < 0.01, "{white}");
        let grey = integrate(|_| 0.5, d65);
        assert!((grey - 0.5).abs().max_element() < 0.01, "{grey}");
        let ramp = |nm: f32| match nm {
            ..400.0 => 0.0,
            ..500.0 => 0.1 + (nm - 400.0) * 0.002,
            ..600.0 => 0.3 + (nm - 500.0) * 0.003,
            ..=700.0 => 0.6 + (nm - 600.0) * 0.002,
            _ => 0.0,
        };
        let brown = integrate(ramp, d65);
        assert!((brown - Vec3::new(0.7056, 0.4265, 0.1742)).abs().max_element() < 0.01, "{brown}");
    }

    #[test]
    fn encoding_is_the_inverse_of_decoding() {
        for value in 0..=255u8 {
            assert_eq!(encode(srgb_to_linear(f32::from(value) / 255.0)), value);
        }
    }
}
