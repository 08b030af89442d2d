//! Textures of MTL materials: `map_Kd`, `map_d`, `norm` and `map_Ke` with their options.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use image::imageops::{FilterType, resize};
use image::{Rgba, RgbaImage};
use rayon::prelude::*;

use super::{Alpha, Material, Scene, Texture, Wrap};
use crate::error::{Error, Result};
use crate::input::Inputs;

/// One texture of a material: the file, and the place of the statement.
#[derive(Clone)]
pub(super) struct Map {
    file: PathBuf,
    pub(super) options: Options,
    library: PathBuf,
    line: usize,
}

/// The options of a map that are used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Options {
    wrap: Wrap,
    /// `-s` and `-o`: the texture coordinates are scaled, then moved.
    scale: Vec2,
    offset: Vec2,
    /// `-bm`.
    pub(super) bump: f32,
}

impl Default for Options {
    fn default() -> Self {
        Options { wrap: Wrap::Repeat, scale: Vec2::ONE, offset: Vec2::ZERO, bump: 1.0 }
    }
}

/// The textures of a material.
#[derive(Clone, Default)]
pub(super) struct Maps {
    pub(super) color: Option<Map>,
    pub(super) alpha: Option<Map>,
    pub(super) normal: Option<Map>,
    pub(super) emission: Option<Map>,
}

impl Maps {
    /// The statements that are used.
    pub(super) const USED: [&str; 4] = ["map_Kd", "map_d", "norm", "map_Ke"];

    /// Those of a material whose statements stand at these lines of a library.
    pub(super) fn new(
        library: &Path,
        from: &tobj::Material,
        lines: &HashMap<&str, usize>,
        ignored: &mut BTreeSet<String>,
    ) -> Maps {
        let unknown = |word: &str| from.unknown_param.get(word);
        let rests = [from.diffuse_texture.as_ref(), from.dissolve_texture.as_ref(), unknown("norm"), unknown("map_Ke")];
        let mut first: Option<Options> = None;
        let mut map = |k: usize| {
            let word = Maps::USED[k];
            let (file, options) = map_options(word, rests[k]?, ignored);
            let first = *first.get_or_insert(options);
            if (first.scale, first.offset) != (options.scale, options.offset) {
                ignored.insert(format!("{word} -s and -o other than those of the material's first map"));
            }
            let file = library.parent().unwrap_or(Path::new("")).join(file.replace('\\', "/"));
            // The reader has noted the line of each statement that it has let pass.
            Some(Map { file, options, library: library.to_path_buf(), line: *lines.get(word)? })
        };
        Maps { color: map(0), alpha: map(1), normal: map(2), emission: map(3) }
    }

    /// Scale and offset of the texture coordinates.
    pub(super) fn placement(&self) -> [Vec2; 2] {
        let first = [&self.color, &self.alpha, &self.normal, &self.emission].into_iter().flatten().next();
        let options = first.map_or(Options::default(), |map| map.options);
        [options.scale, options.offset]
    }
}

/// Files of a texture, whether it is clamped, and what it holds. Only emission of files of floats differs from other colours.
type Key = (Option<PathBuf>, Option<PathBuf>, bool, Content);

/// Memory of a texel of a texture that is enlarged: as it is kept, twice while it is resized, and as floats.
const ENLARGED_BYTES: u64 = 28;

/// A texture, and the factor that its values lack.
type Scaled = (Texture, f32);

#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum Content {
    Color,
    Normal,
    Radiance,
}

/// A texture of a scene before it is read.
struct Job {
    material: u32,
    source: Source,
}

enum Source {
    /// Base colour with opacity.
    Base {
        color: Option<Map>,
        alpha: Option<Map>,
    },
    Normal(Map),
    Emission(Map),
}

/// The textures in use.
#[derive(Default)]
pub(super) struct Textures {
    jobs: Vec<Job>,
    by_key: HashMap<Key, usize>,
    /// Base, normal and emission texture of each material in use, as indices of jobs.
    uses: HashMap<u32, [Option<usize>; 3]>,
}

impl Textures {
    /// Lets the textures of a material be read.
    pub(super) fn want(&mut self, material: u32, maps: &Maps) {
        if self.uses.contains_key(&material) {
            return;
        }
        let Maps { color, alpha, normal, emission } = maps.clone();
        let base = (color.is_some() || alpha.is_some()).then_some(Source::Base { color, alpha });
        let sources = [base, normal.map(Source::Normal), emission.map(Source::Emission)];
        let jobs = sources.map(|source| source.map(|source| self.job(Job { material, source })));
        self.uses.insert(material, jobs);
    }

    /// Index of an equal job.
    fn job(&mut self, job: Job) -> usize {
        let file = |map: &Option<Map>| map.as_ref().map(|map| map.file.clone());
        let clamped = |map: &Map| map.options.wrap == Wrap::Clamp;
        let key = match &job.source {
            Source::Base { color, alpha } => {
                (file(color), file(alpha), color.as_ref().or(alpha.as_ref()).is_some_and(clamped), Content::Color)
            }
            Source::Normal(map) => (Some(map.file.clone()), None, clamped(map), Content::Normal),
            Source::Emission(map) => (Some(map.file.clone()), None, clamped(map), map.emission()),
        };
        let next = self.jobs.len();
        let index = *self.by_key.entry(key).or_insert(next);
        if index == next {
            self.jobs.push(job);
        } else if matches!(job.source, Source::Base { .. }) {
            // A base texture must be there, one of emission need not.
            self.jobs[index] = job;
        }
        index
    }

    /// Reads all textures, on all cores. A map of opacity, normals or emission that cannot be read is left out. Errors: the first
    /// colour texture that cannot be read.
    pub(super) fn read(&mut self, scene: &mut Scene, inputs: &Inputs) -> Result<()> {
        let materials = &scene.materials;
        let read = |job: Job| {
            let mut missing = Vec::new();
            let name = &materials[job.material as usize].name;
            let texture = job.read(inputs, name, &mut missing)?;
            Ok((texture, missing))
        };
        let jobs = std::mem::take(&mut self.jobs);
        let done: Vec<Result<(Option<Scaled>, Vec<String>)>> = jobs.into_par_iter().with_max_len(1).map(read).collect();
        let mut indices = Vec::with_capacity(done.len());
        for done in done {
            let (texture, missing) = done?;
            missing.into_iter().for_each(|what| scene.leave_out(what));
            indices.push(texture.map(|(texture, factor)| {
                scene.textures.push(texture);
                (scene.textures.len() as u32 - 1, factor)
            }));
        }
        let (mut given, mut opaque) = (false, false);
        for (&material, &jobs) in &self.uses {
            let [base, normal, emission] = jobs.map(|job| indices[job?]);
            let material = &mut scene.materials[material as usize];
            material.base_texture = base.map(|(texture, _)| texture);
            material.normal_texture = normal.map(|(texture, _)| texture);
            let texture = material.base_texture.map(|texture| &scene.textures[texture as usize]);
            material.alpha = material.alpha.unless_opaque(texture);
            given |= material.emission != Vec3::ZERO;
            if let Some((texture, factor)) = emission {
                material.emit_by(texture, factor, scene.textures[texture as usize].average());
            }
            opaque |= material.alpha != Alpha::Opaque && material.emission != Vec3::ZERO;
        }
        scene.emission_is_relative = !given;
        if opaque {
            scene.leave_out(String::from("opacity of surfaces that emit (they are opaque)"));
        }
        Ok(())
    }
}

impl Material {
    /// Lets it emit by a texture times `factor` and its emission: 1 if that is black, as exporters leave it.
    fn emit_by(&mut self, texture: u32, factor: f32, average: Vec3) {
        if self.emission == Vec3::ZERO {
            self.emission = Vec3::ONE;
        }
        self.emission *= factor;
        self.emission_texture = Some(texture);
        if self.emission * average == Vec3::ZERO {
            (self.emission, self.emission_texture) = (Vec3::ZERO, None);
        }
    }
}

impl Job {
    fn read(self, inputs: &Inputs, material: &str, missing: &mut Vec<String>) -> Result<Option<Scaled>> {
        let mut optional = |word: &str, map: &Map, content: Content| {
            let read = map.read(inputs, content);
            read.inspect_err(|reason| {
                let (library, file) = (map.library.display(), map.file.display());
                log::warn!("{library}:{}: material {material:?}: {word} {file}: {reason}", map.line);
                let name = map.file.file_name().unwrap_or_default().display();
                missing.push(format!("{word} {name} (cannot be read)"));
            })
            .ok()
        };
        let (color, alpha) = match self.source {
            Source::Normal(map) => return Ok(optional("norm", &map, Content::Normal)),
            Source::Emission(map) => return Ok(optional("map_Ke", &map, map.emission())),
            Source::Base { color, alpha } => (color, alpha),
        };
        // Opacity is linear, as normals are.
        let alpha = alpha.and_then(|map| optional("map_d", &map, Content::Normal)).map(|(alpha, _)| alpha);
        let Some(map) = color else { return Ok(alpha.map(|alpha| (with_opacity(None, alpha), 1.0))) };
        let (color, _) = map.read(inputs, Content::Color).map_err(|reason| {
            let file = map.file.display();
            let message = format!("material {material:?}: texture {file} cannot be read: {reason}");
            Error::at(&map.library, map.line, message)
        })?;
        let texture = match alpha {
            Some(alpha) => {
                let [width, height] = larger(&color, &alpha).map(u64::from);
                if [width, height] != [color.width, color.height].map(u64::from) {
                    inputs.take(&map.file, width * height * ENLARGED_BYTES)?;
                }
                with_opacity(Some(color), alpha)
            }
            None => color,
        };
        Ok(Some((texture, 1.0)))
    }
}

impl Map {
    /// Emission in a file of floats keeps its range; other files are shared with base colours.
    fn emission(&self) -> Content {
        let extension = self.file.extension().unwrap_or_default().to_ascii_lowercase();
        if extension == "exr" || extension == "hdr" { Content::Radiance } else { Content::Color }
    }

    fn read(&self, inputs: &Inputs, content: Content) -> Result<Scaled, String> {
        let bytes = inputs.read(&self.file).map_err(|e| e.to_string())?;
        let (name, wrap) = (self.file.to_string_lossy().into_owned(), [self.options.wrap; 2]);
        match content {
            Content::Radiance => Texture::decode_radiance(inputs, &bytes, name, wrap),
            other => Ok((Texture::decode(inputs, &bytes, name, other == Content::Color, wrap)?, 1.0)),
        }
    }
}

/// The colour, or white, with another image as its alpha: that image's alpha if it has one, else its brightness. The smaller
/// of the two is enlarged.
fn with_opacity(color: Option<Texture>, alpha: Texture) -> Texture {
    let has_alpha = alpha.texels.iter().any(|t| t[3] < 255);
    let opacity = |&[r, g, b, a]: &[u8; 4]| {
        let sum = u32::from(r) + u32::from(g) + u32::from(b);
        // At most 255.
        if has_alpha { a } else { ((sum + 1) / 3) as u8 }
    };
    let mut result = color.unwrap_or_else(|| Texture {
        texels: vec![[255; 4]; alpha.texels.len()],
        name: alpha.name.clone(),
        width: alpha.width,
        height: alpha.height,
        srgb: true,
        wrap: alpha.wrap,
    });
    let [width, height] = larger(&result, &alpha);
    let opacity = alpha.texels.iter().map(opacity).map(|a| [a; 4]).collect();
    let opacity = enlarged(opacity, [alpha.width, alpha.height], [width, height]);
    result.texels = enlarged(result.texels, [result.width, result.height], [width, height]);
    (result.width, result.height) = (width, height);
    for (texel, opacity) in result.texels.iter_mut().zip(opacity) {
        texel[3] = opacity[0];
    }
    result
}

/// Size that holds two textures.
fn larger(a: &Texture, b: &Texture) -> [u32; 2] {
    [a.width.max(b.width), a.height.max(b.height)]
}

fn enlarged(texels: Vec<[u8; 4]>, from: [u32; 2], to: [u32; 2]) -> Vec<[u8; 4]> {
    if from == to {
        return texels;
    }
    let image = RgbaImage::from_fn(from[0], from[1], |x, y| Rgba(texels[y as usize * from[0] as usize + x as usize]));
    resize(&image, to[0], to[1], FilterType::Triangle).pixels().map(|pixel| pixel.0).collect()
}

/// Splits the options of a map from its file name, which may hold spaces.
fn map_options<'a>(keyword: &str, rest: &'a str, ignored: &mut BTreeSet<String>) -> (&'a str, Options) {
    let word = |text: &'a str| text.split_once(char::is_whitespace).map_or((text, ""), |(w, r)| (w, r.trim_start()));
    let mut options = Options::default();
    let mut rest = rest.trim().trim_matches('"');
    while rest.starts_with('-') {
        let (option, mut after) = word(rest);
        let (most, numeric) = match option {
            "-clamp" | "-blendu" | "-blendv" | "-cc" | "-texres" | "-imfchan" | "-type" | "-colorspace" => (1, false),
            "-bm" | "-boost" => (1, true),
            "-mm" => (2, true),
            // One to three numbers each.
            "-o" | "-s" | "-t" => (3, true),
            _ => break,
        };
        let mut values = Vec::new();
        for _ in 0..most {
            let (value, next) = word(after);
            let number = value.parse::<f32>().ok().filter(|x| x.is_finite());
            if numeric && number.is_none() {
                break;
            }
            values.extend(number);
            if option == "-clamp" {
                options.wrap = if value == "on" { Wrap::Clamp } else { Wrap::Repeat };
            }
            after = next;
        }
        let pair = |otherwise: f32| Vec2::new(values[0], values.get(1).copied().unwrap_or(otherwise));
        match option {
            "-s" if !values.is_empty() => options.scale = pair(1.0),
            "-o" if !values.is_empty() => options.offset = pair(0.0),
            "-bm" if !values.is_empty() => options.bump = values[0],
            "-mm" | "-t" | "-boost" => {
                ignored.insert(format!("{keyword} {option}"));
            }
            _ => {}
        }
        rest = after;
    }
    (rest.trim().trim_matches('"'), options)
}

/// The file that a map names, without its options.
pub(super) fn map_file(rest: &str) -> &str {
    map_options("", rest, &mut BTreeSet::new()).0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_come_before_the_file() {
        let mut ignored = BTreeSet::new();
        let mut parse = |rest: &'static str| map_options("map_Kd", rest, &mut ignored);
        let plain = Options::default();
        assert_eq!(parse("wood.png"), ("wood.png", plain));
        let scaled = Options { wrap: Wrap::Clamp, scale: Vec2::new(2.0, 3.0), ..plain };
        assert_eq!(parse("-clamp on -s 2 3 my wood 2.png"), ("my wood 2.png", scaled));
        let moved = Options { offset: Vec2::new(1.0, -2.0), bump: 0.5, ..plain };
        assert_eq!(parse("-o 1 -2 1 -mm 0 1 -bm 0.5 -blendu on dir\\wood.png"), ("dir\\wood.png", moved));
        assert_eq!(parse("\"my wood.png\""), ("my wood.png", plain));
        assert_eq!(parse("-strange.png"), ("-strange.png", plain));
        assert_eq!(parse("-s wood.png"), ("wood.png", plain));
        assert_eq!(parse("-o nan 1 wood.png").1, plain);
        assert_eq!(ignored.into_iter().collect::<Vec<_>>(), ["map_Kd -mm"]);
    }

    /// A long row and a high column of texels are small; the image that holds both is not.
    #[test]
    fn colour_and_opacity_are_counted_before_they_are_joined() {
        let folder = tempfile::tempdir().unwrap();
        let map = |name: &str, size: [u32; 2]| {
            let file = folder.path().join(name);
            image::GrayImage::new(size[0], size[1]).save(&file).unwrap();
            Some(Map { file, options: Options::default(), library: folder.path().join("a.mtl"), line: 7 })
        };
        let source = Source::Base { color: map("row.png", [20_000, 1]), alpha: map("column.png", [1, 20_000]) };
        let inputs = Inputs::within(Some(1 << 30));
        let message = Job { material: 0, source }.read(&inputs, "m", &mut Vec::new()).err().unwrap().to_string();
        assert!(message.contains("row.png") && message.contains("11200000000 bytes of memory"), "{message}");
    }

    fn texture(width: u32, height: u32, texels: Vec<[u8; 4]>) -> Texture {
        Texture { name: String::from("t"), width, height, texels, srgb: true, wrap: [Wrap::Repeat; 2] }
    }

    #[test]
    fn opacity_becomes_the_alpha_of_the_colour() {
        let color = texture(2, 1, vec![[1, 2, 3, 255], [4, 5, 6, 9]]);
        let grey = texture(2, 1, vec![[100, 100, 100, 255], [7, 7, 7, 255]]);
        let joined = with_opacity(Some(color.clone()), grey.clone());
        assert_eq!(joined.texels, [[1, 2, 3, 100], [4, 5, 6, 7]]);
        // An image with an alpha of its own.
        let cut = texture(2, 1, vec![[255, 255, 255, 0], [7, 7, 7, 255]]);
        assert_eq!(with_opacity(None, cut).texels, [[255, 255, 255, 0], [255; 4]]);
        // Other sizes: each side takes the larger.
        let tall = texture(1, 4, vec![[40, 40, 40, 255]; 4]);
        let joined = with_opacity(Some(color), tall);
        assert_eq!((joined.width, joined.height, joined.texels.len()), (2, 4, 8));
        assert!(joined.texels.iter().all(|t| t[3] == 40));
        assert_eq!(joined.texels[0][..3], [1, 2, 3]);
    }
}
