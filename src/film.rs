//! The film: sums of an image over its passes.
//!
//! Sums are exact, so their order does not matter: films of disjoint passes of a rendering, merged in any order, have
//! the same bits as one film of all passes ([`HostFilm::merge`]). A sum of radiance or irradiance is stored as three
//! floats that add up to it (cascaded summation with Knuth's two-sum, as in Ogita, Rump and Oishi 2005). This is exact
//! as long as the addends of a pixel, from the largest to the last bit of the smallest, span at most 2^72; guides are
//! rounded to units first and need two floats.
//!
//! The image of a film is the mean of its radiance less the bias of the filters, as [`crate::pass::gain`] tells it from another sum.
//!
//! [`Film`] is on the device; [`HostFilm`] is its copy on the host, which can be merged with others.

mod mean;

use glam::{DVec4, Vec4};
use rayon::prelude::*;

use self::mean::Sums;
use crate::error::{Error, Result};
use crate::gpu::{Buffer, Context, Memory, Resources, Snapshot, Staging, download};
use crate::output::{Layers, Wanted};
use crate::pass::layer::Layer;
use crate::pass::{gain, vec4s};
use crate::plan::INSTANCES;

/// A sum for each pixel: floats of decreasing magnitude that add up to it.
#[derive(Clone)]
pub struct Sum(pub Vec<Buffer>);

impl Sum {
    fn new(context: &Context, name: &str, pixels: u32, levels: usize) -> Result<Sum> {
        let level = |i: usize| vec4s(context, &format!("film {name} {i}"), pixels);
        Ok(Sum((0..levels).map(level).collect::<Result<_>>()?))
    }
}

/// Floats in a sum of radiance or irradiance.
const RADIANCE: usize = 3;
/// Most passes of a film: sums of the numbers of [`crate::pass::finite`] stay finite.
pub const MAX_PASSES: u32 = 1 << 27;
/// Floats in a sum of guides.
const GUIDE: usize = 2;
/// Unit to which albedos and normals are rounded, a thirtieth of the half floats of an EXR layer.
pub const GUIDE_UNIT: f32 = 1.0 / 65536.0;

/// Images that a ring keeps, on the device ([`crate::pass::ring`]).
#[derive(Clone)]
pub struct RingImages {
    /// Buffers of so many images as one binding can hold.
    pub buffers: Vec<Buffer>,
    /// Images of each buffer but the last.
    pub each: u32,
    /// Number of images.
    pub length: u32,
}

impl RingImages {
    fn new(context: &Context, pixels: u32, length: u32) -> Result<RingImages> {
        let bytes = crate::ring::PIXEL_BYTES * u64::from(pixels);
        let each = (context.info().max_storage_buffer_range / bytes.max(1)).clamp(1, u64::from(length)) as u32;
        let buffer = |i: u32| {
            let images = each.min(length - i * each);
            Buffer::new(context, &format!("ring {i}"), bytes * u64::from(images), Memory::Device)
        };
        Ok(RingImages { buffers: (0..length.div_ceil(each)).map(buffer).collect::<Result<_>>()?, each, length })
    }
}

/// Sums over the passes, on the device; they persist between frames.
#[derive(Clone)]
pub struct Film {
    /// Radiance and coverage, a sum for each instance.
    pub color: Vec<Sum>,
    /// Direct irradiance; w: depth along the view direction times coverage.
    pub direct: Sum,
    /// Indirect irradiance.
    pub indirect: Sum,
    /// Albedo (diffuse and specular) times throughput, in multiples of [`GUIDE_UNIT`].
    pub albedo: Sum,
    /// Shading normal, in multiples of [`GUIDE_UNIT`].
    pub normal: Sum,
    /// Radiance that the filter adds, see [`crate::pass::gain`]; w: square of its mean over the channels.
    pub gain: Sum,
    /// Emission, diffuse and specular light (see `summands`); `None`: not requested.
    pub summands: Option<[Sum; Film::SUMMANDS]>,
    /// `[i]`: number of passes in the sums of instance i, counted by the device: passes that lost rays are left out.
    pub counts: Buffer,
    /// The images whose sum is in the first instance's colour; `None`: passes are summed and not kept.
    pub ring: Option<RingImages>,
    pixels: u32,
}

impl Film {
    /// Number of summands of the image.
    pub const SUMMANDS: usize = 3;

    /// Sums for `pixels` pixels, with those of the summands if `summands`. Clear them before the first pass.
    pub fn new(context: &Context, pixels: u32, summands: bool) -> Result<Film> {
        let sum = |name: &str, levels: usize| Sum::new(context, name, pixels, levels);
        Film {
            color: (0..INSTANCES).map(|i| sum(&format!("color of instance {i}"), RADIANCE)).collect::<Result<_>>()?,
            direct: sum("direct", RADIANCE)?,
            indirect: sum("indirect", RADIANCE)?,
            albedo: sum("albedo", GUIDE)?,
            normal: sum("normal", GUIDE)?,
            gain: sum("gain", RADIANCE)?,
            summands: None,
            counts: Buffer::new(context, "film counts", 16, Memory::Device)?,
            ring: None,
            pixels,
        }
        .with_summands(context, summands)
    }

    /// Number of pixels.
    pub fn pixels(&self) -> u32 {
        self.pixels
    }

    /// The same sums with or without those of the summands.
    pub fn with_summands(mut self, context: &Context, summands: bool) -> Result<Film> {
        if summands != self.summands.is_some() {
            let sum = |name: &str| Sum::new(context, name, self.pixels, RADIANCE);
            self.summands = match summands {
                true => Some([sum("emission")?, sum("diffuse")?, sum("specular")?]),
                false => None,
            };
        }
        Ok(self)
    }

    /// The same sums with a ring of so many images, or none. Clear the film before the first step of another ring.
    pub fn with_ring(mut self, context: &Context, images: Option<u32>) -> Result<Film> {
        if images != self.ring.as_ref().map(|ring| ring.length) {
            self.ring = images.map(|images| RingImages::new(context, self.pixels, images)).transpose()?;
        }
        Ok(self)
    }

    /// All sums in a fixed order.
    fn sums(&self) -> impl Iterator<Item = &Sum> {
        let first = self.color.iter().chain([&self.direct, &self.indirect, &self.albedo, &self.normal, &self.gain]);
        first.chain(self.summands.iter().flatten())
    }

    /// All buffers.
    pub fn buffers(&self) -> impl Iterator<Item = &Buffer> {
        let ring = self.ring.iter().flat_map(|ring| &ring.buffers);
        self.sums().flat_map(|sum| &sum.0).chain([&self.counts]).chain(ring)
    }

    /// The sums of an instance by the names in `accumulate`.
    pub fn as_sums(&self, instance: u32) -> Resources {
        let [color, direct, indirect] = [&self.color[instance as usize].0, &self.direct.0, &self.indirect.0];
        Resources::of([
            ("sum_color", &color[0]),
            ("rest_color", &color[1]),
            ("tail_color", &color[2]),
            ("sum_direct", &direct[0]),
            ("rest_direct", &direct[1]),
            ("tail_direct", &direct[2]),
            ("sum_indirect", &indirect[0]),
            ("rest_indirect", &indirect[1]),
            ("tail_indirect", &indirect[2]),
            ("sum_albedo", &self.albedo.0[0]),
            ("rest_albedo", &self.albedo.0[1]),
            ("sum_normal", &self.normal.0[0]),
            ("rest_normal", &self.normal.0[1]),
            ("sum_gain", &self.gain.0[0]),
            ("rest_gain", &self.gain.0[1]),
            ("counts", &self.counts),
        ])
    }

    /// The sums of the filter's gain by their names in `gain`.
    pub fn as_gain(&self) -> Resources {
        let [sum, rest, tail] = [0, 1, 2].map(|level| &self.gain.0[level]);
        Resources::of([("sum_gain", sum), ("rest_gain", rest), ("tail_gain", tail)])
    }

    /// The sums by the names in `summands`.
    pub fn as_summands(&self) -> Option<Resources> {
        let [Sum(emission), Sum(diffuse), Sum(specular)] = self.summands.as_ref()?;
        Some(Resources::of([
            ("sum_emission", &emission[0]),
            ("rest_emission", &emission[1]),
            ("tail_emission", &emission[2]),
            ("sum_diffuse", &diffuse[0]),
            ("rest_diffuse", &diffuse[1]),
            ("tail_diffuse", &diffuse[2]),
            ("sum_specular", &specular[0]),
            ("rest_specular", &specular[1]),
            ("tail_specular", &specular[2]),
        ]))
    }

    /// The sums of a layer by the names in `layer`; `None`: they are not kept.
    pub fn as_layer(&self, layer: Layer) -> Option<Resources> {
        let named = |sum: &Sum| Resources::of([("sum", &sum.0[0]), ("rest", &sum.0[1])]);
        let of = match layer {
            Layer::Direct | Layer::Depth => &self.direct,
            Layer::Indirect => &self.indirect,
            Layer::Albedo | Layer::Classes | Layer::Clusters => &self.albedo,
            Layer::Normal => &self.normal,
            Layer::Emission | Layer::Diffuse | Layer::Specular => {
                let [emission, diffuse, specular] = self.summands.as_ref()?;
                let own = match layer {
                    Layer::Emission => emission,
                    Layer::Diffuse => diffuse,
                    _ => specular,
                };
                return Some(named(own).with("sum_diffuse", &diffuse.0[0]).with("sum_specular", &specular.0[0]));
            }
        };
        Some(named(of))
    }

    /// The sums by the names in `resolve`.
    pub fn as_means(&self) -> Resources {
        let [a, b] = [&self.color[0].0, &self.color[1].0];
        Resources::of([
            ("sum_a", &a[0]),
            ("rest_a", &a[1]),
            ("sum_b", &b[0]),
            ("rest_b", &b[1]),
            ("sum_gain", &self.gain.0[0]),
            ("rest_gain", &self.gain.0[1]),
            ("counts", &self.counts),
        ])
    }

    /// Reads the film back.
    pub fn download(&self, context: &Context, size: [u32; 2]) -> Result<HostFilm> {
        let sums = self.sums().map(|sum| HostSum::of(context, sum, self.pixels)).collect::<Result<_>>()?;
        Ok(HostFilm { size, counts: self.download_counts(context)?, sums, summands: self.summands.is_some() })
    }

    /// The mean of all passes, as an image with the wanted layers. Reads back what these need and nothing else.
    pub fn mean(&self, context: &Context, size: [u32; 2], wanted: Wanted) -> Result<Layers> {
        let counts = self.download_counts(context)?;
        let needed = |i: usize| match i {
            0..DIRECT => counts[i] > 0,
            DIRECT..GAIN => wanted == Wanted::All,
            GAIN => counts.iter().sum::<u32>() >= gain::MIN_PASSES,
            _ => true,
        };
        let levels = |(i, sum): (usize, &Sum)| match needed(i) {
            true => sum.0.iter().map(|level| Snapshot::new(context, level)).collect(),
            false => Ok(Vec::new()),
        };
        let levels = self.sums().enumerate().map(levels).collect::<Result<Vec<_>>>()?;
        let levels = levels.iter().map(Vec::as_slice).collect();
        Sums { size, counts, levels, summands: self.summands.is_some() }.mean(wanted)
    }

    /// Number of passes of each instance in the sums.
    fn download_counts(&self, context: &Context) -> Result<[u32; INSTANCES as usize]> {
        let counts = download::<u32>(context, &self.counts)?;
        Ok(std::array::from_fn(|i| counts[i]))
    }

    /// Stages the content of a film of the same size and summands.
    pub fn stage(&self, context: &Context, staging: &mut Staging, film: &HostFilm) -> Result<()> {
        for (sum, host) in self.sums().zip(&film.sums) {
            for (buffer, level) in sum.0.iter().zip(&host.0) {
                staging.stage_into(context, buffer, 0, level)?;
            }
        }
        staging.stage_into(context, &self.counts, 0, &film.counts)
    }
}

/// A sum on the host, level by level.
#[derive(Clone, Debug, PartialEq)]
struct HostSum(Vec<Vec<Vec4>>);

impl HostSum {
    fn of(context: &Context, sum: &Sum, pixels: u32) -> Result<HostSum> {
        let level = |buffer: &Buffer| {
            let mut level = download::<Vec4>(context, buffer)?;
            level.truncate(pixels as usize);
            Ok(level)
        };
        Ok(HostSum(sum.0.iter().map(level).collect::<Result<_>>()?))
    }

    fn exact(&self, pixel: usize) -> (DVec4, DVec4) {
        self.0.iter().fold((DVec4::ZERO, DVec4::ZERO), |sum, level| add(sum, level[pixel].as_dvec4()))
    }

    /// Adds another sum. The resulting levels depend only on the exact sum.
    fn merge(&mut self, other: Option<&HostSum>) {
        let levels = self.0.len();
        let merged: Vec<Vec<Vec4>> = (0..self.0[0].len())
            .into_par_iter()
            .map(|pixel| {
                let own = self.exact(pixel);
                let mut rest = match other.map(|other| other.exact(pixel)) {
                    Some((high, low)) => add(add(own, high), low),
                    None => own,
                };
                (0..levels)
                    .map(|_| {
                        let level = rest.0.as_vec4();
                        rest = add(rest, -level.as_dvec4());
                        level
                    })
                    .collect()
            })
            .collect();
        for (i, level) in self.0.iter_mut().enumerate() {
            *level = merged.iter().map(|levels| levels[i]).collect();
        }
    }
}

/// Adds to a sum of two doubles, without error within their 106 bits; the larger one is the rounded sum.
fn add((high, low): (DVec4, DVec4), x: DVec4) -> (DVec4, DVec4) {
    let (sum, error) = two_sum(high, x);
    two_sum(sum, low + error)
}

/// a + b and its rounding error (Knuth 1969).
fn two_sum(a: DVec4, b: DVec4) -> (DVec4, DVec4) {
    let sum = a + b;
    let of_b = sum - a;
    (sum, (a - (sum - of_b)) + (b - of_b))
}

/// A film on the host.
#[derive(Clone, Debug, PartialEq)]
pub struct HostFilm {
    size: [u32; 2],
    counts: [u32; INSTANCES as usize],
    sums: Vec<HostSum>,
    summands: bool,
}

/// Numbers of floats of all sums, in their order.
fn levels(summands: bool) -> Vec<usize> {
    let mut levels = vec![RADIANCE; INSTANCES as usize + 2];
    levels.extend([GUIDE, GUIDE, RADIANCE]);
    levels.extend(if summands { vec![RADIANCE; Film::SUMMANDS] } else { Vec::new() });
    levels
}

/// Indices of the sums after those of the instances' radiance.
const DIRECT: usize = INSTANCES as usize;
const INDIRECT: usize = DIRECT + 1;
const ALBEDO: usize = DIRECT + 2;
const NORMAL: usize = DIRECT + 3;
const GAIN: usize = DIRECT + 4;
/// The first of the summands.
const EMISSION: usize = DIRECT + 5;

impl HostFilm {
    /// Width and height.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Number of passes in the sums.
    pub fn passes(&self) -> u32 {
        self.counts.iter().sum()
    }

    /// Adds the passes of another film of the same size, which must be different passes of the same rendering. The
    /// result has the same bits for every order of merging; these are the bits of [`HostFilm::canonical`] of a film of
    /// all passes.
    pub fn merge(&mut self, other: &HostFilm) -> Result<()> {
        if (self.size, self.summands) != (other.size, other.summands) {
            let [[w, h], [v, u]] = [self.size, other.size];
            let message = format!("films of {w}x{h} and {v}x{u} pixels, or with other layers, do not add up");
            return Err(Error::Resource { name: String::from("film"), message });
        }
        if self.passes() + other.passes() > MAX_PASSES {
            let message = format!("films of more than {MAX_PASSES} passes do not add up; render fewer");
            return Err(Error::Resource { name: String::from("film"), message });
        }
        self.sums.iter_mut().zip(&other.sums).for_each(|(sum, other)| sum.merge(Some(other)));
        self.counts.iter_mut().zip(other.counts).for_each(|(count, other)| *count += other);
        Ok(())
    }

    /// The same sums in canonical form, which equal sums share; the device's form depends on the order of the passes.
    pub fn canonical(mut self) -> HostFilm {
        self.sums.iter_mut().for_each(|sum| sum.merge(None));
        self
    }

    /// The mean of all passes, as an image with its layers.
    pub fn mean(&self) -> Layers {
        let levels = self.sums.iter().map(|sum| sum.0.as_slice()).collect();
        let Ok(layers) =
            Sums { size: self.size, counts: self.counts, levels, summands: self.summands }.mean(Wanted::All);
        layers
    }

    /// All sums and counts as bytes, little endian.
    pub fn to_bytes(&self) -> Vec<u8> {
        let floats = self.sums.iter().flat_map(|sum| sum.0.iter().flatten()).flat_map(|v| v.to_array());
        let counts = self.counts.iter().flat_map(|count| count.to_le_bytes());
        floats.flat_map(|x| x.to_bits().to_le_bytes()).chain(counts).collect()
    }

    /// Number of bytes of [`HostFilm::to_bytes`]; the greatest `usize` for sizes beyond any memory.
    pub fn byte_count(size: [u32; 2], summands: bool) -> usize {
        let pixels = (size[0] as usize).saturating_mul(size[1] as usize);
        pixels.saturating_mul(16 * levels(summands).iter().sum::<usize>()).saturating_add(4 * INSTANCES as usize)
    }

    /// Restores a film of this size, with or without summands, from [`HostFilm::to_bytes`]. Errors: wrong number of
    /// bytes; more passes than [`MAX_PASSES`]; a sum that is no number.
    pub fn from_bytes(bytes: &[u8], size: [u32; 2], summands: bool) -> Result<HostFilm> {
        let levels = levels(summands);
        let expected = Self::byte_count(size, summands);
        if bytes.len() != expected {
            return Err(Error::Scene(format!(
                "the saved state has {} bytes where this image needs {expected}; start without --resume",
                bytes.len()
            )));
        }
        let pixels = size[0] as usize * size[1] as usize;
        let mut words = bytes.chunks_exact(4).map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]]));
        // The length was checked: no word is missing.
        let mut word = || words.next().unwrap_or(0);
        let mut level = || (0..pixels).map(|_| Vec4::from_array([(); 4].map(|()| f32::from_bits(word())))).collect();
        let sums: Vec<HostSum> = levels.iter().map(|&count| HostSum((0..count).map(|_| level()).collect())).collect();
        let counts = [(); INSTANCES as usize].map(|()| word());
        if counts.iter().map(|&count| u64::from(count)).sum::<u64>() > u64::from(MAX_PASSES) {
            return Err(Error::Scene(String::from("the saved state has too many passes; start without --resume")));
        }
        let is_number = |sum: &HostSum| sum.0.iter().flatten().all(|value: &Vec4| value.is_finite());
        if !sums.iter().all(is_number) {
            return Err(Error::Scene(String::from(
                "the saved state has a sum that is no number; start without --resume",
            )));
        }
        Ok(HostFilm { size, counts, sums, summands })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A film of one pixel whose sums of radiance have these levels, and those of guides the first; no filter added to it.
    fn film(levels: &[f32]) -> HostFilm {
        let level = |count: usize, i: usize| if count == GUIDE && i > 0 { 0.0 } else { levels[i] };
        let sum = |count: usize| HostSum((0..count).map(|i| vec![Vec4::splat(level(count, i))]).collect());
        let mut sums: Vec<HostSum> = super::levels(false).into_iter().map(sum).collect();
        sums[GAIN].0.iter_mut().for_each(|level| level.fill(Vec4::ZERO));
        HostFilm { size: [1, 1], counts: [1, 0], sums, summands: false }
    }

    #[test]
    fn equal_sums_have_one_form() {
        // 1 + 2^-30 + 2^-50 in three forms. Powers by division, which is exact; `powi` need not be.
        let power = |n: u32| 1.0 / (1u64 << n) as f32;
        let (a, b) = (power(30), power(50));
        let forms = [[1.0, a, b], [1.0 + power(23), a - power(23), b], [a, b, 1.0]];
        for form in forms {
            assert_eq!(film(&form).canonical().sums[0], film(&[1.0, a, b]).canonical().sums[0], "{form:?}");
        }
        assert_ne!(film(&[1.0, a, 2.0 * b]).canonical().sums[0], film(&[1.0, a, b]).canonical().sums[0]);
    }

    #[test]
    fn passes_beyond_the_most_are_refused() {
        let mut bytes = film(&[1.0, 0.0, 0.0]).to_bytes();
        let at = bytes.len() - 4 * INSTANCES as usize;
        let mut restored = |counts: [u32; 2]| {
            bytes[at..].copy_from_slice(bytemuck::cast_slice(&counts.map(u32::to_le)));
            HostFilm::from_bytes(&bytes, [1, 1], false)
        };
        let mut full = restored([MAX_PASSES - 1, 1]).unwrap();
        assert_eq!(full.passes(), MAX_PASSES);
        for counts in [[MAX_PASSES, 1], [u32::MAX, u32::MAX]] {
            assert!(restored(counts).unwrap_err().to_string().contains("too many passes"));
        }
        let message = full.merge(&film(&[1.0, 0.0, 0.0])).unwrap_err().to_string();
        assert!(message.contains("do not add up"), "{message}");
        assert_eq!(full.passes(), MAX_PASSES, "unchanged");
    }

    #[test]
    fn sums_that_are_no_numbers_are_refused() {
        let restored = |value: f32| {
            let mut bytes = film(&[1.0, 0.0, 0.0]).to_bytes();
            bytes[4..8].copy_from_slice(&value.to_le_bytes());
            HostFilm::from_bytes(&bytes, [1, 1], false)
        };
        for value in [0.0, -0.0, -1.0, f32::MIN, f32::MAX, 1e-45] {
            restored(value).unwrap();
        }
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let message = restored(value).unwrap_err().to_string();
            assert!(message.contains("no number"), "{message}");
        }
    }

    #[test]
    fn merging_knows_no_order() {
        let parts: Vec<HostFilm> = (0..40)
            .map(|i| film(&[1.0 + 0.37 * i as f32, 1e-9 * i as f32, 2f32.powi(-55) * (40 - i) as f32]))
            .collect();
        let merged = |order: &mut dyn Iterator<Item = usize>| {
            let mut film = parts[order.next().unwrap()].clone();
            order.for_each(|i| film.merge(&parts[i]).unwrap());
            film
        };
        let forth = merged(&mut (0..40));
        assert_eq!(forth, merged(&mut (0..40).rev()));
        assert_eq!(forth, merged(&mut (0..40).map(|i| i * 7 % 40)));
        assert_eq!(forth.passes(), 40);
        let exact: f64 = parts.iter().map(|p| f64::from(p.sums[0].0[0][0].x)).sum();
        assert!((f64::from(forth.mean().color[0].x) - exact / 40.0).abs() < 1e-6);
    }

    #[test]
    fn summands_share_the_bias_and_add_up() {
        let sum = |values: [f32; 4], count: usize| {
            let level = |i: usize| vec![if i == 0 { Vec4::from_array(values) } else { Vec4::ZERO }];
            HostSum((0..count).map(level).collect())
        };
        // Eight passes: emission 1, diffuse 2, specular 6, of which the filter adds 0.8 in each pass.
        let mut sums: Vec<HostSum> = super::levels(true).into_iter().map(|count| sum([0.0; 4], count)).collect();
        sums[GAIN] = sum([6.4, 6.4, 6.4, 8.0 * 0.64], RADIANCE);
        for (i, value) in [1.0, 2.0, 6.0].into_iter().enumerate() {
            sums[EMISSION + i] = sum([8.0 * value; 4], RADIANCE);
        }
        let layers = HostFilm { size: [1, 1], counts: [4, 4], sums, summands: true }.mean();
        let near = |found: glam::Vec3, expected: f32| assert!((found - expected).abs().max_element() < 1e-5, "{found}");
        near(layers.emission[0], 1.0);
        near(layers.diffuse[0], 1.8);
        near(layers.specular[0], 5.4);
        near(layers.color[0], 8.2);
    }

    #[test]
    fn bytes_come_back() {
        let one = film(&[0.25, 1e-9, -3e-18]);
        assert_eq!(HostFilm::from_bytes(&one.to_bytes(), [1, 1], false).unwrap(), one);
        for (bytes, summands) in [(one.to_bytes(), true), (one.to_bytes()[1..].to_vec(), false)] {
            assert!(HostFilm::from_bytes(&bytes, [1, 1], summands).unwrap_err().to_string().contains("--resume"));
        }
        let mut one = one;
        assert!(one.merge(&HostFilm { size: [2, 1], ..film(&[0.0; 3]) }).is_err());
    }
}
