//! Pixels of OpenEXR files.
//!
//! The `image` crate decodes on threads of its own, where a damaged file ends the program, and takes memory for whatever window a file
//! claims. Here a file is decoded on the calling thread, and its windows are counted first.

use std::io::Cursor;

use exr::prelude::{AttributeValue, ReadChannels, ReadLayers, Text, Vec2, read};

use super::quietly::quietly;
use super::texture_file::Reserve;

/// Pixels of a display window, from the top row on.
pub(crate) struct Pixels {
    /// Width and height.
    pub size: [u32; 2],
    /// Red, green, blue, and alpha, which is 1 if the file has none. 0 outside of the data window.
    pub values: Vec<[f32; 4]>,
}

/// Decodes the first layer with R, G and B. `reserve` is asked before memory is taken. Error: the reason.
pub(crate) fn decode(bytes: &[u8], reserve: Reserve) -> Result<Pixels, String> {
    // The crate does not check everything in a file.
    quietly(|| decode_unsafely(bytes, reserve)).unwrap_or_else(|message| Err(format!("malformed OpenEXR: {message}")))
}

/// Whether a file is OpenEXR, by its first bytes.
pub(crate) fn is_one(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01])
}

/// An attribute of the first layer that is a text; `None`: there is none of this name. Error: the reason.
pub(crate) fn text_attribute(bytes: &[u8], name: &str) -> Result<Option<String>, String> {
    let read = || {
        let reader = exr::block::read(Cursor::new(bytes), false).map_err(|e| e.to_string())?;
        let attributes = reader.headers().first().map(|header| &header.own_attributes.other);
        Ok(match attributes.and_then(|attributes| attributes.get(&Text::from(name))) {
            Some(AttributeValue::Text(text)) => Some(text.to_string()),
            _ => None,
        })
    };
    quietly(read).unwrap_or_else(Err).map_err(|message: String| format!("malformed OpenEXR: {message}"))
}

/// May panic with malformed files.
fn decode_unsafely(bytes: &[u8], reserve: Reserve) -> Result<Pixels, String> {
    let reader = exr::block::read(Cursor::new(bytes), false).map_err(|e| e.to_string())?;
    let of_rgb = reader.headers().iter().find(|header| {
        let has = |name: &str| header.channels.find_index_of_channel(&Text::from(name)).is_some();
        !header.deep && ["R", "G", "B"].into_iter().all(has)
    });
    let header = of_rgb.ok_or("no layer has the channels R, G and B")?;
    let window = header.shared_attributes.display_window;
    let offset = header.own_attributes.layer_position - window.position;
    let (width, height) = (window.size.width(), window.size.height());
    for header in reader.headers() {
        // Blocks are decoded one after the other.
        let block = header.max_block_pixel_size();
        let pixel = header.channels.bytes_per_pixel as u64;
        // Decoded, and once more while it is put in order.
        let most = (block.width() as u64).saturating_mul(block.height() as u64).saturating_mul(2 * pixel);
        reserve(most)?;
    }
    let pixels = (width as u64).saturating_mul(height as u64);
    // As they are decoded, and in the form that the caller makes of them.
    reserve(pixels.saturating_mul(2 * size_of::<[f32; 4]>() as u64))?;
    let [Ok(columns), Ok(rows)] = [width, height].map(i32::try_from) else {
        return Err(format!("{width}x{height} pixels are too many"));
    };
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .rgba_channels(
            move |_, _| vec![[0.0; 4]; width * height],
            move |values: &mut Vec<[f32; 4]>, at: Vec2<usize>, (r, g, b, a): (f32, f32, f32, f32)| {
                let Vec2(x, y) = at.to_i32() + offset;
                if (0..columns).contains(&x) && (0..rows).contains(&y) {
                    values[y as usize * width + x as usize] = [r, g, b, a];
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_chunks(reader)
        .map_err(|e| e.to_string())?;
    Ok(Pixels { size: [columns as u32, rows as u32], values: image.layer_data.channel_data.pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of 3 x 2 pixels with a channel A or without.
    fn file(alpha: bool) -> Vec<u8> {
        let value = |i: u32| i as f32 * 0.25;
        let mut bytes = Cursor::new(Vec::new());
        let format = image::ImageFormat::OpenExr;
        if alpha {
            let values = (0..24).map(value).collect();
            image::Rgba32FImage::from_raw(3, 2, values).unwrap().write_to(&mut bytes, format).unwrap();
        } else {
            let values = (0..18).map(value).collect();
            image::Rgb32FImage::from_raw(3, 2, values).unwrap().write_to(&mut bytes, format).unwrap();
        }
        bytes.into_inner()
    }

    #[test]
    fn pixels_are_those_of_the_file() {
        for alpha in [false, true] {
            let Pixels { size, values } = decode(&file(alpha), &|_| Ok(())).unwrap();
            assert_eq!(size, [3, 2]);
            let expected = |i: usize| match alpha {
                true => [0, 1, 2, 3].map(|k| (4 * i + k) as f32 * 0.25),
                false => [3 * i, 3 * i + 1, 3 * i + 2, 4].map(|k| k as f32 * 0.25),
            };
            assert_eq!(values, (0..6).map(expected).collect::<Vec<_>>());
        }
    }

    #[test]
    fn windows_are_counted_before_memory_is_taken() {
        let error = decode(&file(false), &|bytes| Err(format!("{bytes} are too many"))).err().unwrap();
        assert!(error.ends_with("are too many"), "{error}");
        // A data window of 2^26 x 2 pixels.
        let mut bytes = file(false);
        let at = bytes.windows(10).position(|w| w == b"dataWindow").unwrap() + b"dataWindow\0box2i\0".len() + 4;
        bytes[at + 8..at + 12].copy_from_slice(&((1i32 << 26) - 1).to_le_bytes());
        assert!(decode(&bytes, &|bytes| if bytes > 1 << 20 { Err(String::new()) } else { Ok(()) }).is_err());
    }

    #[test]
    fn damaged_files_are_errors() {
        let whole = file(true);
        for at in 0..whole.len() {
            for value in [0, 0x7f, 0xff] {
                let mut damaged = whole.clone();
                damaged[at] = value;
                // Errors are allowed, memory beyond a megabyte is not.
                let _ = decode(&damaged, &|bytes| if bytes > 1 << 20 { Err(String::new()) } else { Ok(()) });
            }
            assert!(decode(&whole[..at], &|_| Ok(())).is_err(), "{at}");
        }
    }
}
