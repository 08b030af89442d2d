//! OpenEXR: colour as `R`, `G`, `B`, `A`, every other layer as `layer.channel`, ZIP-compressed, with metadata.

use super::cryptomatte::Mattes;
use super::{Encoding, Layers, Metadata};
use crate::error::{Error, Result};
use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::writer::ChunksWriter;
use exr::meta::BlockDescription;
use exr::meta::attribute::{ChannelDescription, Chromaticities, SampleType, Text};
use exr::meta::header::{Header, ImageAttributes};
use exr::prelude::{AttributeValue, Compression, LayerAttributes, LineOrder, Vec2, f16};
use flate2::write::ZlibEncoder;
use glam::Vec3;
use rayon::prelude::*;
use std::io::{Cursor, Write};
use std::ops::Range;
use std::path::Path;

/// Rows that are compressed together.
const BLOCK_ROWS: usize = 16;
/// Level of the compression: a file of layers is 6 % larger than at level 4, and takes a third of the time.
const LEVEL: u32 = 1;
/// The maximum finite half.
const HALF_MAX: f32 = 65504.0;

/// Encodes the layers as a file's bytes; `path` is for messages.
pub fn encode(path: &Path, layers: &Layers, metadata: &Metadata, encoding: &Encoding) -> Result<Vec<u8>> {
    let mattes = if encoding.color_only { Vec::new() } else { layers.surfaces.mattes() };
    let mut channels = Channels::default();
    channels.vectors("", ["R", "G", "B"], &layers.color, encoding.float);
    channels.scalars("A", &layers.alpha, encoding.float);
    if channels.overflowed > 0 {
        let pixels = channels.overflowed;
        log::warn!(
            "{}: {pixels} values of the colour exceed {HALF_MAX}, the greatest half, and were set to it; \
             --float writes them as they are",
            path.display()
        );
    }
    if !encoding.color_only {
        channels.vectors("albedo.", ["R", "G", "B"], &layers.albedo, false);
        channels.vectors("normal.", ["X", "Y", "Z"], &layers.normal, false);
        channels.scalars("depth.Z", &layers.depth, true);
        channels.vectors("irradiance_direct.", ["R", "G", "B"], &layers.direct, true);
        channels.vectors("irradiance_indirect.", ["R", "G", "B"], &layers.indirect, true);
        channels.vectors("emission.", ["R", "G", "B"], &layers.emission, true);
        channels.vectors("diffuse.", ["R", "G", "B"], &layers.diffuse, true);
        channels.vectors("specular.", ["R", "G", "B"], &layers.specular, true);
        layers.surfaces.channels().into_iter().for_each(|(name, values)| channels.scalars(name, values, true));
        for (name, values) in mattes.iter().flat_map(Mattes::channels) {
            channels.scalars(&name, values, true);
        }
    }

    let mut channels = channels.list;
    // The order that the format demands.
    channels.sort_by(|a, b| a.name.cmp(&b.name));
    let list = channels.iter().map(|channel| {
        let kind = if channel.float { SampleType::F32 } else { SampleType::F16 };
        ChannelDescription::named(Text::from_slice_unchecked(channel.name.as_bytes()), kind)
    });
    let (width, height) = (layers.width as usize, layers.height as usize);
    let shared = ImageAttributes {
        chromaticities: Some(Chromaticities {
            red: Vec2(0.64, 0.33),
            green: Vec2(0.30, 0.60),
            blue: Vec2(0.15, 0.06),
            white: Vec2(0.3127, 0.3290),
        }),
        ..ImageAttributes::with_size((width, height))
    };
    let header = Header::new(Text::default(), (width, height), list.collect())
        .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_attributes(attributes(metadata, &mattes))
        .with_shared_attributes(shared);
    let starts: Vec<usize> = (0..height).step_by(BLOCK_ROWS).collect();
    let rows = |start: usize| start..(start + BLOCK_ROWS).min(height);
    let blocks: Vec<Vec<u8>> = starts.par_iter().map(|&start| compress(block(&channels, rows(start), width))).collect();
    let mut bytes = Vec::new();
    let written = exr::block::write(Cursor::new(&mut bytes), [header].into_iter().collect(), true, |_, writer| {
        for (i, (&start, compressed_pixels_le)) in starts.iter().zip(blocks).enumerate() {
            let block = CompressedScanLineBlock { y_coordinate: start as i32, compressed_pixels_le };
            writer.write_chunk(i, Chunk { layer_index: 0, compressed_block: CompressedBlock::ScanLine(block) })?;
        }
        Ok(())
    });
    written
        .and_then(|()| sort_attributes(&mut bytes))
        .map_err(|e| Error::file(path, format!("encoding failed: {e}")))?;
    Ok(bytes)
}

/// The values of a channel, where they lie in the layers.
enum Values<'a> {
    Scalars(&'a [f32]),
    /// One axis of vectors.
    Axis(&'a [Vec3], usize),
}

impl Values<'_> {
    fn get(&self, pixel: usize) -> f32 {
        match self {
            Values::Scalars(values) => values[pixel],
            Values::Axis(values, axis) => values[pixel][*axis],
        }
    }
}

/// A channel of the file.
struct Channel<'a> {
    name: String,
    values: Values<'a>,
    float: bool,
}

/// Channels under construction.
#[derive(Default)]
struct Channels<'a> {
    list: Vec<Channel<'a>>,
    /// Values that a half could not hold.
    overflowed: usize,
}

impl<'a> Channels<'a> {
    fn scalars(&mut self, name: &str, values: &'a [f32], float: bool) {
        self.add(name.into(), Values::Scalars(values), values.len(), float);
    }

    fn vectors(&mut self, prefix: &str, names: [&str; 3], values: &'a [Vec3], float: bool) {
        for (axis, name) in names.into_iter().enumerate() {
            self.add(format!("{prefix}{name}"), Values::Axis(values, axis), values.len(), float);
        }
    }

    fn add(&mut self, name: String, values: Values<'a>, count: usize, float: bool) {
        if count == 0 {
            return;
        }
        if !float {
            // Up to half a step above the maximum is still rounded down to it.
            let overflows = |pixel: &usize| values.get(*pixel).abs() >= HALF_MAX + 16.0;
            self.overflowed += (0..count).into_par_iter().filter(overflows).count();
        }
        self.list.push(Channel { name, values, float });
    }
}

/// The bytes of some rows: for each row, for each channel, the values in order.
fn block(channels: &[Channel], rows: Range<usize>, width: usize) -> Vec<u8> {
    let pixel: usize = channels.iter().map(|channel| if channel.float { 4 } else { 2 }).sum();
    let mut bytes = Vec::with_capacity(rows.len() * width * pixel);
    for row in rows {
        for Channel { values, float, .. } in channels {
            let values = (row * width..(row + 1) * width).map(|pixel| values.get(pixel));
            let start = bytes.len();
            if *float {
                bytes.resize(start + 4 * width, 0);
                let places = bytes[start..].chunks_exact_mut(4);
                places.zip(values).for_each(|(place, value)| place.copy_from_slice(&value.to_le_bytes()));
            } else {
                bytes.resize(start + 2 * width, 0);
                let places = bytes[start..].chunks_exact_mut(2);
                // NaN passes through the clamp and stays visible.
                let half = |value: f32| f16::from_f32(value.clamp(-HALF_MAX, HALF_MAX));
                places.zip(values).for_each(|(place, value)| place.copy_from_slice(&half(value).to_le_bytes()));
            }
        }
    }
    bytes
}

/// Compresses a block as the format says for ZIP: even bytes before odd ones, differences, deflate. A block that does not
/// shrink is stored as it is.
fn compress(bytes: Vec<u8>) -> Vec<u8> {
    let mut split: Vec<u8> = bytes.iter().step_by(2).chain(bytes.iter().skip(1).step_by(2)).copied().collect();
    let mut before = 0;
    for (i, byte) in split.iter_mut().enumerate() {
        let now = *byte;
        if i > 0 {
            *byte = now.wrapping_sub(before).wrapping_add(128);
        }
        before = now;
    }
    let mut encoder = ZlibEncoder::new(Vec::with_capacity(bytes.len()), flate2::Compression::new(LEVEL));
    // Writing to memory does not fail.
    match encoder.write_all(&split).and_then(|()| encoder.finish()) {
        Ok(compressed) if compressed.len() < bytes.len() => compressed,
        _ => bytes,
    }
}

fn attributes(metadata: &Metadata, mattes: &[Mattes]) -> LayerAttributes {
    // The format's texts are bytes, which readers decode as UTF-8, so every name is accepted.
    let text = |s: &str| (!s.is_empty()).then(|| Text::from_slice_unchecked(s.as_bytes()));
    let mut attributes = LayerAttributes { software_name: text(&metadata.software), ..LayerAttributes::default() };
    let seed = metadata.seed.to_string();
    let passes = metadata.passes.to_string();
    let texts = [
        ("scene", &metadata.scene),
        ("settings", &metadata.settings),
        ("seed", &seed),
        ("passes", &passes),
        ("camera", &metadata.camera),
        ("device", &metadata.device),
        ("driver", &metadata.driver),
    ];
    let texts = texts.map(|(name, value)| (String::from(name), value.as_str()));
    for (name, value) in texts.into_iter().chain(mattes.iter().flat_map(Mattes::attributes)) {
        if let Some(value) = text(value) {
            attributes.other.insert(Text::from_slice_unchecked(name.as_bytes()), AttributeValue::Text(value));
        }
    }
    attributes
}

/// Sorts the header's attributes by name.
///
/// The encoder keeps them in a hash map whose order changes from run to run; sorted, the same image gives the same
/// bytes. The header's length does not change, so offsets in the file stay valid.
fn sort_attributes(bytes: &mut [u8]) -> exr::error::UnitResult {
    /// Magic number and version.
    const START: usize = 8;
    let damaged = || exr::error::Error::Invalid("header".into());
    let mut list: Vec<(Vec<u8>, Vec<u8>)> = Vec::new();
    let mut at = START;
    loop {
        let rest = bytes.get(at..).ok_or_else(damaged)?;
        let name = rest.iter().position(|&b| b == 0).ok_or_else(damaged)?;
        if name == 0 {
            break;
        }
        let kind = rest[name + 1..].iter().position(|&b| b == 0).ok_or_else(damaged)?;
        let size_at = name + 1 + kind + 1;
        let size = rest.get(size_at..size_at + 4).and_then(|b| b.try_into().ok()).ok_or_else(damaged)?;
        let end = size_at + 4 + usize::try_from(i32::from_le_bytes(size)).map_err(|_| damaged())?;
        list.push((rest[..name].to_vec(), rest.get(..end).ok_or_else(damaged)?.to_vec()));
        at += end;
    }
    list.sort();
    let sorted: Vec<u8> = list.into_iter().flat_map(|(_, attribute)| attribute).collect();
    bytes[START..at].copy_from_slice(&sorted);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::write;
    use exr::prelude::{AnyChannels, FlatSamples, Layer};

    fn sample() -> (Layers, Metadata) {
        let (width, height) = (37, 21);
        let pixels = (width * height) as usize;
        let ramp = |scale: f32| -> Vec<Vec3> {
            (0..pixels).map(|i| Vec3::new(i as f32, 0.5 * i as f32, 1.0 + i as f32) * scale).collect()
        };
        let mut depth: Vec<f32> = (0..pixels).map(|i| 1.0 + i as f32 / 3.0).collect();
        depth[5] = f32::INFINITY;
        let layers = Layers {
            width,
            height,
            color: ramp(0.125),
            albedo: ramp(1.0 / 1024.0),
            normal: vec![Vec3::new(0.0, 0.0, 1.0); pixels],
            depth,
            direct: ramp(0.1),
            indirect: ramp(0.3),
            emission: ramp(0.05),
            diffuse: ramp(0.07),
            specular: ramp(0.005),
            alpha: vec![1.0; pixels],
            ..Layers::default()
        };
        let metadata = Metadata {
            software: "lightsum test".into(),
            scene: "Büro 🌞".into(),
            settings: "{\"paths\":32}".into(),
            seed: u64::MAX,
            passes: 7,
            camera: "{}".into(),
            device: "device".into(),
            driver: "driver 1.2".into(),
        };
        (layers, metadata)
    }

    fn read(path: &Path) -> (Layer<AnyChannels<FlatSamples>>, ImageAttributes) {
        let image = exr::prelude::read_first_flat_layer_from_file(path).unwrap();
        (image.layer_data, image.attributes)
    }

    fn channel(layer: &Layer<AnyChannels<FlatSamples>>, name: &str) -> Vec<f32> {
        let found = layer.channel_data.list.iter().find(|c| c.name.as_slice() == name.as_bytes());
        found.unwrap_or_else(|| panic!("no channel {name}")).sample_data.values_as_f32().collect()
    }

    #[test]
    fn layers_and_metadata_come_back() {
        let (layers, metadata) = sample();
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        write(&path, &layers, &metadata, &Encoding { float: true, ..Default::default() }).unwrap();
        let (layer, attributes) = read(&path);
        assert_eq!((layer.size.0, layer.size.1), (37, 21));
        let names: Vec<String> = layer.channel_data.list.iter().map(|c| c.name.to_string()).collect();
        let mut expected: Vec<String> =
            ["R", "G", "B", "A", "depth.Z", "normal.X", "normal.Y", "normal.Z"].map(String::from).into();
        for name in ["albedo", "irradiance_direct", "irradiance_indirect", "emission", "diffuse", "specular"] {
            expected.extend(["R", "G", "B"].map(|c| format!("{name}.{c}")));
        }
        expected.sort();
        assert_eq!(names, expected);
        for (axis, name) in ["R", "G", "B"].into_iter().enumerate() {
            let exact = |values: &[Vec3]| values.iter().map(|v| v[axis]).collect::<Vec<f32>>();
            assert_eq!(channel(&layer, name), exact(&layers.color));
            assert_eq!(channel(&layer, &format!("irradiance_direct.{name}")), exact(&layers.direct));
            assert_eq!(channel(&layer, &format!("irradiance_indirect.{name}")), exact(&layers.indirect));
            assert_eq!(channel(&layer, &format!("emission.{name}")), exact(&layers.emission));
            assert_eq!(channel(&layer, &format!("diffuse.{name}")), exact(&layers.diffuse));
            assert_eq!(channel(&layer, &format!("specular.{name}")), exact(&layers.specular));
            let albedo = channel(&layer, &format!("albedo.{name}"));
            assert!(albedo.iter().zip(exact(&layers.albedo)).all(|(a, b)| (a - b).abs() <= 0.0005 * b));
        }
        assert_eq!(channel(&layer, "normal.Z"), vec![1.0; 37 * 21]);
        assert_eq!(channel(&layer, "depth.Z"), layers.depth);

        assert_eq!(layer.attributes.software_name.as_ref().unwrap().as_slice(), b"lightsum test");
        assert!(attributes.chromaticities.is_some());
        let text = |name: &str| {
            let key = Text::from_slice_unchecked(name.as_bytes());
            match layer.attributes.other.get(&key).or(attributes.other.get(&key)) {
                Some(AttributeValue::Text(t)) => String::from_utf8(t.as_slice().to_vec()).unwrap(),
                other => panic!("{name}: {other:?}"),
            }
        };
        assert_eq!(text("scene"), metadata.scene);
        assert_eq!(text("settings"), metadata.settings);
        assert_eq!(text("seed"), u64::MAX.to_string());
        assert_eq!(text("passes"), "7");
        assert_eq!(text("driver"), metadata.driver);
    }

    #[test]
    fn same_image_same_bytes() {
        let (layers, metadata) = sample();
        let first = encode(Path::new("a.exr"), &layers, &metadata, &Encoding::default()).unwrap();
        for _ in 0..8 {
            assert!(encode(Path::new("a.exr"), &layers, &metadata, &Encoding::default()).unwrap() == first);
        }
    }

    #[test]
    fn blocks_that_do_not_shrink_are_stored_and_come_back() {
        // Noise, in more rows than a block has and an odd number of bytes with an odd width of halves.
        let (width, height) = (33, 35);
        let mut state = 1u32;
        let mut noise = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            f32::from_bits(state >> 9 | 0x3f80_0000)
        };
        let color = (0..width * height).map(|_| Vec3::new(noise(), noise(), noise())).collect();
        let layers = Layers { width, height, color, ..Layers::default() };
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        write(&path, &layers, &Metadata::default(), &Encoding { float: true, ..Encoding::default() }).unwrap();
        let layer = read(&path).0;
        for (axis, name) in ["R", "G", "B"].into_iter().enumerate() {
            assert_eq!(channel(&layer, name), layers.color.iter().map(|v| v[axis]).collect::<Vec<f32>>());
        }
        let bytes: Vec<u8> = (0..64).map(|i| (i * i * 37) as u8).collect();
        assert_eq!(compress(bytes.clone()), bytes, "stored");
    }

    #[test]
    fn half_is_clamped_and_float_is_not() {
        let values = [-1e9, 65504.0, 65519.0, 1e9, f32::INFINITY, 0.5];
        let layers = Layers {
            width: 6,
            height: 1,
            color: values.iter().map(|&v| Vec3::splat(v)).collect(),
            ..Layers::default()
        };
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        let metadata = Metadata::default();
        write(&path, &layers, &metadata, &Encoding::default()).unwrap();
        let (layer, _) = read(&path);
        assert_eq!(layer.channel_data.list.len(), 3);
        assert_eq!(channel(&layer, "G"), [-65504.0, 65504.0, 65504.0, 65504.0, 65504.0, 0.5]);
        write(&path, &layers, &metadata, &Encoding { float: true, ..Default::default() }).unwrap();
        assert_eq!(channel(&read(&path).0, "G"), values);

        let mut channels = Channels::default();
        channels.scalars("A", &values, false);
        assert_eq!(channels.overflowed, 3);
    }

    #[test]
    fn colour_alone_has_four_channels() {
        let (layers, metadata) = sample();
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        write(&path, &layers, &metadata, &Encoding { color_only: true, ..Encoding::default() }).unwrap();
        let names: Vec<String> = read(&path).0.channel_data.list.iter().map(|c| c.name.to_string()).collect();
        assert_eq!(names, ["A", "B", "G", "R"]);
    }

    #[test]
    fn a_damaged_header_is_an_error() {
        assert!(sort_attributes(&mut [0; 8]).is_err());
        assert!(sort_attributes(&mut [0, 0, 0, 0, 0, 0, 0, 0, b'a', 0, b'b', 0, 255, 255, 255, 255]).is_err());
        assert!(sort_attributes(&mut [0; 9]).is_ok());
    }
}
