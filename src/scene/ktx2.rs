//! KTX 2.0 textures: 8-bit colours, plain or compressed by Zstandard or zlib, and Basis Universal (ETC1S, UASTC) and ASTC, which are
//! unpacked.
//!
//! The largest level is read; smaller ones are made from it where they are needed. Of an array the first layer is read.

use std::io::Read;

use basisu::{DecodeFlags, TargetFormat, Transcoder};
use ktx2::{Format, Reader, SupercompressionScheme};

use super::quietly::quietly;
use super::texture_file::Reserve;

/// Most texels of a texture: as many as 16384 x 16384.
const MOST_TEXELS: u64 = 1 << 28;

/// Bytes of a texel.
const TEXEL_BYTES: u64 = 4;

/// Most bytes of the blocks of a level of all layers.
const MOST_BLOCKS: u64 = 1 << 30;

/// Width, height and RGBA texels as the file encodes them. `reserve` is asked before memory is taken. Error: the reason.
pub(super) fn decode(bytes: &[u8], reserve: Reserve) -> Result<(u32, u32, Vec<[u8; 4]>), String> {
    let reader = Reader::new(bytes).map_err(|e| format!("invalid KTX 2.0 file: {e:?}"))?;
    let header = reader.header();
    let (width, height) = (header.pixel_width, header.pixel_height);
    if header.pixel_depth != 0 || header.face_count != 1 || width == 0 || height == 0 {
        return Err(String::from("it is no flat image but a line, a cube or a volume"));
    }
    let texels = u64::from(width) * u64::from(height);
    if texels > MOST_TEXELS {
        return Err(format!("{width}x{height} texels are more than {MOST_TEXELS}"));
    }
    let Some(order) = header.format.and_then(plain) else {
        return transcode(bytes, &reader, texels, reserve).map(|texels| (width, height, texels));
    };
    let Some(level) = reader.levels().next() else { return Err(String::from("it has no level")) };
    // At most 2^30; an array has further layers behind the first.
    let length = texels as usize * order.len();
    reserve(length as u64 + texels * TEXEL_BYTES)?;
    let mut data = Vec::new();
    let read = match header.supercompression_scheme {
        None => level.data.take(length as u64).read_to_end(&mut data).map_err(|e| e.to_string()),
        Some(SupercompressionScheme::Zstandard) => {
            let decoder = ruzstd::StreamingDecoder::new(level.data).map_err(|e| e.to_string())?;
            decoder.take(length as u64).read_to_end(&mut data).map_err(|e| e.to_string())
        }
        Some(SupercompressionScheme::ZLIB) => {
            let decoder = flate2::read::ZlibDecoder::new(level.data);
            decoder.take(length as u64).read_to_end(&mut data).map_err(|e| e.to_string())
        }
        Some(other) => Err(format!("its compression, {other:?}, does not go with its format")),
    };
    if read? != length {
        return Err(format!("{} bytes are there, {width}x{height} texels need {length}", data.len()));
    }
    let texel = |t: &[u8]| {
        let mut rgba = [0, 0, 0, 255];
        order.iter().zip(t).for_each(|(&channel, &value)| rgba[channel] = value);
        // One or two channels as in glTF: the others are 0.
        rgba
    };
    Ok((width, height, data.chunks_exact(order.len()).map(texel).collect()))
}

/// Places in RGBA of the channels of an 8-bit format.
fn plain(format: Format) -> Option<&'static [usize]> {
    Some(match format {
        Format::R8_UNORM | Format::R8_SRGB => &[0],
        Format::R8G8_UNORM | Format::R8G8_SRGB => &[0, 1],
        Format::R8G8B8_UNORM | Format::R8G8B8_SRGB => &[0, 1, 2],
        Format::B8G8R8_UNORM | Format::B8G8R8_SRGB => &[2, 1, 0],
        Format::R8G8B8A8_UNORM | Format::R8G8B8A8_SRGB => &[0, 1, 2, 3],
        Format::B8G8R8A8_UNORM | Format::B8G8R8A8_SRGB => &[2, 1, 0, 3],
        _ => return None,
    })
}

/// Unpacks blocks of 4x4 texels or more.
fn transcode(bytes: &[u8], reader: &Reader<&[u8]>, texels: u64, reserve: Reserve) -> Result<Vec<[u8; 4]>, String> {
    let name = || reader.header().format.map_or_else(|| String::from("of no name"), |format| format!("{format:?}"));
    // A block has at most 16 bytes, and there is at least one in each row and column.
    let layers = u64::from(reader.header().layer_count.max(1));
    let most = (texels + 4 * u64::from(reader.header().pixel_width + reader.header().pixel_height) + 16) * layers;
    let most = most.min(MOST_BLOCKS);
    if reader.levels().any(|level| level.uncompressed_byte_length > most) {
        return Err(format!("a level has more bytes than {texels} texels need, or than {MOST_BLOCKS}"));
    }
    let largest = reader.levels().map(|level| level.uncompressed_byte_length).max().unwrap_or(0);
    // Blocks, and texels twice: as they are unpacked and as they are kept.
    reserve(largest + 2 * texels * TEXEL_BYTES)?;
    // The transcoder does not check everything in a file.
    let unpacked = quietly(|| {
        let open = Transcoder::new(bytes);
        let transcoder = open.map_err(|_| format!("its format, {}, is not read, or the file is damaged", name()))?;
        if !transcoder.supports(TargetFormat::Rgba32) {
            return Err(format!("its format, {}, is not read: it is not of 8 bits", name()));
        }
        let unpacked = transcoder.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE);
        unpacked.map_err(|_| String::from("its blocks are damaged"))
    });
    let unpacked = unpacked.map_err(|message| format!("its blocks are damaged: {message}"))??;
    let (unpacked, _) = unpacked.as_chunks::<4>();
    if unpacked.len() as u64 != texels {
        return Err(format!("{} of {texels} texels are there", unpacked.len()));
    }
    Ok(unpacked.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::texture_file::is_ktx2;

    fn decode(bytes: &[u8]) -> Result<(u32, u32, Vec<[u8; 4]>), String> {
        super::decode(bytes, &|_| Ok(()))
    }

    #[test]
    fn memory_is_reserved_before_it_is_taken() {
        let refuse = |bytes: u64| Err(format!("{bytes} are too many"));
        // 16384 x 16384 texels of one byte, of which none is there.
        let error = super::decode(&file(9, [1 << 14; 2], 0, &[0]), &refuse).unwrap_err();
        assert_eq!(error, format!("{} are too many", 5u64 << 28));
        // One texel as a block of UASTC: four bytes by the file, and the texel twice.
        let error = super::decode(&file(0, [1, 1], 0, &[0; 16]), &refuse).unwrap_err();
        assert_eq!(error, "12 are too many");
    }

    /// A file with one level.
    fn file(format: u32, size: [u32; 2], scheme: u32, data: &[u8]) -> Vec<u8> {
        let mut bytes = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
        // The descriptor of a format: its length, and a basic block without samples.
        let descriptor: [u32; 7] = [28, 0, 2 | 24 << 16, 1 | 1 << 8 | 1 << 16, 0, 4, 0];
        let numbers = [format, 1, size[0], size[1], 0, 0, 1, 1, scheme, 104, 28, 0, 0, 0, 0, 0, 0];
        bytes.extend(numbers.iter().flat_map(|n: &u32| n.to_le_bytes()));
        for n in [132, data.len() as u64, 4 * u64::from(size[0]) * u64::from(size[1])] {
            bytes.extend(n.to_le_bytes());
        }
        bytes.extend(descriptor.iter().flat_map(|n| n.to_le_bytes()));
        bytes.extend(data);
        bytes
    }

    #[test]
    fn plain_colors_are_read() {
        let rgba = [1, 2, 3, 4, 5, 6, 7, 8];
        assert_eq!(decode(&file(37, [2, 1], 0, &rgba)).unwrap(), (2, 1, vec![[1, 2, 3, 4], [5, 6, 7, 8]]));
        assert_eq!(decode(&file(50, [1, 2], 0, &rgba)).unwrap().2, [[3, 2, 1, 4], [7, 6, 5, 8]]);
        assert_eq!(decode(&file(9, [3, 1], 0, &rgba)).unwrap().2, [1, 2, 3].map(|x| [x, 0, 0, 255]));
        let mut packed = Vec::new();
        flate2::read::ZlibEncoder::new(&rgba[..], flate2::Compression::fast()).read_to_end(&mut packed).unwrap();
        assert_eq!(decode(&file(43, [2, 1], 3, &packed)).unwrap().2, [[1, 2, 3, 4], [5, 6, 7, 8]]);
        // A frame of Zstandard with one raw block: magic, descriptor of 1-byte content size, size, block header.
        let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0x20, 8, 8 << 3 | 1, 0, 0];
        frame.extend(rgba);
        assert_eq!(decode(&file(43, [2, 1], 2, &frame)).unwrap().2, [[1, 2, 3, 4], [5, 6, 7, 8]]);
    }

    #[test]
    fn bad_files_are_refused_with_the_reason() {
        let refused = |bytes: &[u8], word: &str| {
            let error = decode(bytes).unwrap_err();
            assert!(error.contains(word), "{word}: {error}");
        };
        refused(&file(37, [2, 2], 0, &[0; 8]), "8 bytes are there");
        refused(&file(37, [1 << 20, 1 << 20], 2, &[0; 8]), "1048576x1048576");
        refused(&file(37, [2, 0], 0, &[0; 8]), "no flat image");
        refused(&file(37, [2, 1], 2, &[1; 8]), "");
        refused(&file(97, [2, 1], 0, &[0; 16]), "R16G16B16A16_SFLOAT");
        refused(&file(0, [4, 4], 2, &[0; 16]), "of no name");
        let whole = file(37, [2, 1], 0, &[0; 8]);
        (0..whole.len()).for_each(|length| assert!(decode(&whole[..length]).is_err(), "{length}"));
        assert!(is_ktx2(&whole) && !is_ktx2(b"\x89PNG\r\n\x1a\n"));
    }
}
