//! Compressed geometry in glTF files: EXT_meshopt_compression, KHR_meshopt_compression and
//! KHR_draco_mesh_compression.
//!
//! Sizes that a file promises are compared with those that its bytes can hold, or with fixed limits, before memory is taken.

use std::collections::BTreeMap;

use draco_core::{DataType as DracoType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointIndex};
use gltf::accessor::DataType;
use gltf::{Accessor, Document, Primitive, buffer};
use meshopt_rs::index::buffer::decode_index_buffer;
use meshopt_rs::index::sequence::decode_index_sequence;
use meshopt_rs::vertex::buffer::decode_vertex_buffer;
use serde_json::Value;

use super::gltf_extensions::{DRACO, MESHOPT};
use super::quietly::quietly;
use crate::input::half_of_memory;

/// Bytes of all decoded Draco meshes of a file at most, if half of the machine's memory is not less: those of 50 million vertices with all
/// attributes that are read. The bytes of a mesh do not bound it: an attribute that is the same everywhere takes none.
const MOST_DRACO: u64 = 1 << 32;

/// Bytes of vertices that a byte may stand for: at best two bits are 16 bytes.
pub(super) const MOST_MESHOPT: usize = 64;

/// Most vertices and triangles of a Draco mesh.
const MOST_DRACO_ELEMENTS: u64 = 1 << 25;

/// Whether a buffer only says how large what is compressed elsewhere is.
pub(super) fn is_fallback(buffer: &buffer::Buffer) -> bool {
    let fallback = |name: &str| buffer.extension_value(name)?.get("fallback")?.as_bool();
    MESHOPT.into_iter().any(|name| fallback(name).unwrap_or(false))
}

/// The bytes of a compressed view; `None` if it is not compressed. `bytes` gives a range of a buffer: index, offset, length.
pub(super) fn meshopt<'b>(
    view: &buffer::View,
    bytes: impl Fn(usize, usize, usize) -> Option<&'b [u8]>,
) -> Option<Result<Vec<u8>, String>> {
    let (name, extension) = MESHOPT.into_iter().find_map(|name| Some((name, view.extension_value(name)?)))?;
    let number = |name: &str| extension.get(name).and_then(Value::as_u64).and_then(|n| usize::try_from(n).ok());
    let word = |name: &str| extension.get(name).and_then(Value::as_str).unwrap_or("");
    let decoded = || {
        let (Some(buffer), Some(length)) = (number("buffer"), number("byteLength")) else {
            return Err(String::from("`buffer` or `byteLength` is missing"));
        };
        let offset = number("byteOffset").unwrap_or(0);
        let source = bytes(buffer, offset, length).ok_or_else(|| {
            format!("bytes {offset} + {length} reach beyond buffer {buffer}, or there is no such buffer")
        })?;
        let (Some(stride), Some(count)) = (number("byteStride"), number("count")) else {
            return Err(String::from("`byteStride` or `count` is missing"));
        };
        if stride.checked_mul(count) != Some(view.length()) {
            return Err(format!("{count} elements of {stride} bytes are not the {} bytes of the view", view.length()));
        }
        // The decoder does not check everything in damaged bytes.
        let decoded = quietly(|| decode(word("mode"), source, stride, count));
        let mut decoded = decoded.map_err(|message| format!("its bytes are damaged: {message}"))??;
        filter(word("filter"), &mut decoded, stride)?;
        Ok(decoded)
    };
    Some(decoded().map_err(|message| format!("bufferView {}: {name}: {message}", view.index())))
}

fn decode(mode: &str, bytes: &[u8], stride: usize, count: usize) -> Result<Vec<u8>, String> {
    let packed = |indices: Vec<u32>| match stride {
        2 => Ok(indices.iter().flat_map(|&i| (i as u16).to_le_bytes()).collect()),
        4 => Ok(indices.iter().flat_map(|i| i.to_le_bytes()).collect()),
        _ => Err(format!("indices of {stride} bytes, where there are only those of 2 and 4")),
    };
    let damaged = |_| String::from("its bytes are damaged");
    let beyond = || format!("{count} elements cannot be in {} bytes", bytes.len());
    match mode {
        "ATTRIBUTES" => {
            // Only KHR_meshopt_compression allows it.
            if bytes.first() == Some(&0xa1) {
                return Err(String::from(
                    "attributes in version 1 of the format are not read; compress them in version 0",
                ));
            }
            if count.saturating_mul(stride) > bytes.len().saturating_mul(MOST_MESHOPT) {
                return Err(beyond());
            }
            vertices(bytes, stride, count).unwrap_or_else(|| Err(format!("elements of {stride} bytes do not exist")))
        }
        "TRIANGLES" => {
            if !count.is_multiple_of(3) || count / 3 > bytes.len() {
                return Err(beyond());
            }
            let mut indices = vec![0u32; count];
            decode_index_buffer(&mut indices, bytes).map_err(damaged)?;
            packed(indices)
        }
        "INDICES" => {
            if count > bytes.len() {
                return Err(beyond());
            }
            let mut indices = vec![0u32; count];
            decode_index_sequence(&mut indices, bytes).map_err(damaged)?;
            packed(indices)
        }
        _ => Err(format!("there is no mode {mode:?}")),
    }
}

/// Vertices by their size, which the decoder must know at compile time; `None`: there are no vertices of this size.
fn vertices(bytes: &[u8], stride: usize, count: usize) -> Option<Result<Vec<u8>, String>> {
    fn of<const N: usize>(bytes: &[u8], count: usize) -> Result<Vec<u8>, String> {
        let mut vertices = vec![[0u8; N]; count];
        let decoded = decode_vertex_buffer(&mut vertices, bytes);
        decoded.map(|()| vertices.into_flattened()).map_err(|_| String::from("its bytes are damaged"))
    }
    macro_rules! by_size {
        ($($size:literal)*) => {
            match stride {
                $($size => Some(of::<$size>(bytes, count)),)*
                _ => None,
            }
        };
    }
    by_size! {
        4 8 12 16 20 24 28 32 36 40 44 48 52 56 60 64 68 72 76 80 84 88 92 96 100 104 108 112 116 120 124 128
        132 136 140 144 148 152 156 160 164 168 172 176 180 184 188 192 196 200 204 208 212 216 220 224 228 232 236 240
        244 248 252 256
    }
}

/// Applies a filter in place, by the text of the extension. Those of `meshopt-rs` read the components of quaternions without sign.
fn filter(name: &str, data: &mut [u8], stride: usize) -> Result<(), String> {
    let number = |b: &[u8]| i16::from_le_bytes([b[0], b[1]]);
    // Halves away from zero.
    let rounded = |x: f32| x.round() as i32;
    match (name, stride) {
        ("" | "NONE", _) => {}
        ("OCTAHEDRAL", 4 | 8) => {
            let wide = stride == 8;
            let most = if wide { 32767.0 } else { 127.0 };
            for element in data.chunks_exact_mut(stride) {
                let read = |i: usize| {
                    if wide { f32::from(number(&element[2 * i..])) } else { f32::from(element[i] as i8) }
                };
                // The third component is 1 in the same unit.
                let (mut x, mut y, one) = (read(0), read(1), read(2));
                let z = one - x.abs() - y.abs();
                let below = z.min(0.0);
                x += if x >= 0.0 { below } else { -below };
                y += if y >= 0.0 { below } else { -below };
                let length = (x * x + y * y + z * z).sqrt();
                let scale = if length > 0.0 { most / length } else { 0.0 };
                for (i, v) in [x, y, z].into_iter().enumerate() {
                    let v = rounded(v * scale);
                    if wide {
                        element[2 * i..][..2].copy_from_slice(&(v as i16).to_le_bytes());
                    } else {
                        element[i] = v as i8 as u8;
                    }
                }
            }
        }
        ("QUATERNION", 8) => {
            for element in data.chunks_exact_mut(8) {
                let [x, y, z, last] = [0, 2, 4, 6].map(|at| number(&element[at..]));
                // The last holds the unit, and in its lowest bits which component is missing.
                let (unit, missing) = (f32::from(last | 3), (last & 3) as usize);
                let [x, y, z] = [x, y, z].map(|v| f32::from(v) / unit * std::f32::consts::FRAC_1_SQRT_2);
                let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
                for (i, v) in [w, x, y, z].into_iter().enumerate() {
                    let v = rounded(v * 32767.0) as i16;
                    element[2 * ((missing + i) % 4)..][..2].copy_from_slice(&v.to_le_bytes());
                }
            }
        }
        ("EXPONENTIAL", stride) if stride.is_multiple_of(4) => {
            for element in data.chunks_exact_mut(4) {
                let bits = i32::from_le_bytes([element[0], element[1], element[2], element[3]]);
                let (mantissa, exponent) = (bits << 8 >> 8, bits >> 24);
                let value = f64::from(mantissa) * f64::from(exponent).exp2();
                element.copy_from_slice(&(value as f32).to_le_bytes());
            }
        }
        ("COLOR", _) => return Err(String::from("the filter \"COLOR\" is not read; compress colours without it")),
        _ => return Err(format!("there is no filter {name:?} of elements of {stride} bytes")),
    }
    Ok(())
}

/// The elements of all accessors that primitives have in Draco's form, packed, by the accessors' indices. `bytes` gives those of a
/// view.
pub(super) fn draco<'b>(
    document: &Document,
    bytes: impl Fn(&buffer::View) -> crate::Result<&'b [u8]>,
    error: impl Fn(String) -> crate::Error,
) -> crate::Result<BTreeMap<usize, Vec<u8>>> {
    let mut elements = BTreeMap::new();
    for mesh in document.meshes() {
        for primitive in mesh.primitives() {
            let Some(extension) = primitive.extension_value(DRACO) else { continue };
            let error = |message: String| {
                let (mesh, primitive) = (mesh.index(), primitive.index());
                error(format!("mesh {mesh}, primitive {primitive}: {DRACO}: {message}"))
            };
            let view = extension.get("bufferView").and_then(Value::as_u64);
            let view = view.and_then(|i| document.views().nth(usize::try_from(i).ok()?));
            let view = view.ok_or_else(|| error(String::from("it names no bufferView that is there")))?;
            let bytes = bytes(&view)?;
            if primitive_is_decoded(&primitive, &elements) {
                continue;
            }
            decode_draco(&primitive, extension, bytes, &mut elements).map_err(error)?;
        }
    }
    Ok(elements)
}

/// Whether another primitive has had the same accessors decoded.
fn primitive_is_decoded(primitive: &Primitive, elements: &BTreeMap<usize, Vec<u8>>) -> bool {
    let mut accessors = primitive.attributes().map(|(_, accessor)| accessor).chain(primitive.indices());
    accessors.all(|accessor| elements.contains_key(&accessor.index()))
}

fn decode_draco(
    primitive: &Primitive,
    extension: &Value,
    bytes: &[u8],
    elements: &mut BTreeMap<usize, Vec<u8>>,
) -> Result<(), String> {
    let mut limits = DecodeLimits::default();
    (limits.max_points, limits.max_faces) = (MOST_DRACO_ELEMENTS, MOST_DRACO_ELEMENTS);
    let taken: usize = elements.values().map(Vec::len).sum();
    limits.max_decoded_bytes = MOST_DRACO.min(half_of_memory()).saturating_sub(taken as u64);
    let mut mesh = Mesh::new();
    let decoded = quietly(|| {
        let mut source = DecoderBuffer::new(bytes).with_limits(limits);
        MeshDecoder::new().decode(&mut source, &mut mesh).map_err(|e| e.to_string())
    });
    decoded.map_err(|message| format!("its bytes are damaged: {message}"))??;
    let count = mesh.num_points();
    let fits = |accessor: &Accessor, there: usize| {
        let (index, promised) = (accessor.index(), accessor.count());
        let message = || format!("accessor {index} promises {promised} elements, {there} are there");
        (promised == there).then_some(()).ok_or_else(message)
    };
    if let Some(accessor) = primitive.indices() {
        fits(&accessor, 3 * mesh.num_faces())?;
        let corners = mesh.faces().iter().flatten().map(|point| point.0);
        if corners.clone().any(|corner| corner as usize >= count) {
            return Err(format!("a triangle has a corner beyond the {count} that are there"));
        }
        let packed: Vec<u8> = match accessor.data_type() {
            DataType::U8 => corners.map(|i| i as u8).collect(),
            DataType::U16 => corners.flat_map(|i| (i as u16).to_le_bytes()).collect(),
            _ => corners.flat_map(u32::to_le_bytes).collect(),
        };
        if count as u64 > 1 << (8 * accessor.data_type().size()) {
            return Err(format!("accessor {} cannot count {count} vertices", accessor.index()));
        }
        elements.insert(accessor.index(), packed);
    }
    for (semantic, accessor) in primitive.attributes() {
        let name = semantic.to_string();
        // Others stand in the file as they are.
        let Some(id) = extension.pointer(&format!("/attributes/{name}")).and_then(Value::as_u64) else { continue };
        let attribute = u32::try_from(id).ok().and_then(|id| mesh.attribute_by_unique_id(id));
        let attribute = attribute.ok_or_else(|| format!("there is no attribute {id} for {name}"))?;
        fits(&accessor, count)?;
        let kind = match attribute.data_type() {
            DracoType::Int8 => DataType::I8,
            DracoType::Uint8 => DataType::U8,
            DracoType::Int16 => DataType::I16,
            DracoType::Uint16 => DataType::U16,
            DracoType::Uint32 => DataType::U32,
            DracoType::Float32 => DataType::F32,
            other => return Err(format!("{name} consists of {other:?}, which glTF does not have")),
        };
        let width = accessor.dimensions().multiplicity();
        if kind != accessor.data_type() || usize::from(attribute.num_components()) != width {
            let (index, components) = (accessor.index(), attribute.num_components());
            return Err(format!("accessor {index} of {name} differs from {components} numbers of {kind:?}"));
        }
        let (size, data) = (accessor.size(), attribute.buffer().data());
        let stride = usize::try_from(attribute.byte_stride()).unwrap_or(0).max(size);
        let mut packed = Vec::with_capacity(count * size);
        for point in 0..count as u32 {
            let value = attribute.mapped_index(PointIndex(point)).0 as usize;
            let element = value.checked_mul(stride).and_then(|at| data.get(at..)?.get(..size));
            packed.extend_from_slice(element.ok_or_else(|| format!("{name} has no value for vertex {point}"))?);
        }
        elements.insert(accessor.index(), packed);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_give_the_values_of_the_extension() {
        // An octahedron's corner, a face's middle and a point of the lower half, in units of 127 and 100.
        let mut bytes: Vec<u8> =
            [[127i8, 0, 127, 5], [0, 0, 100, 6], [80, -60, 100, 7]].concat().iter().map(|&x| x as u8).collect();
        filter("OCTAHEDRAL", &mut bytes, 4).unwrap();
        // The third: z = -40, x = 80 - 40, y = -60 + 40, of length 60.
        let expected = [[127i8, 0, 0, 5], [0, 0, 127, 6], [85, -42, -85, 7]].concat();
        assert_eq!(bytes.iter().map(|&b| b as i8).collect::<Vec<_>>(), expected);

        let quaternions = |values: [i16; 4]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
        // Unit 1023; y is missing, and the stored ones are those after it: z, w, x.
        let mut bytes = quaternions([-1023, 0, 0, 1020 | 1]);
        filter("QUATERNION", &mut bytes, 8).unwrap();
        let half = 23170;
        assert_eq!(bytes, quaternions([0, half, -half, 0]));

        let mut bytes: Vec<u8> = [-3i32 << 24 | 20, 2 << 24 | 0xff_fffe].iter().flat_map(|x| x.to_le_bytes()).collect();
        filter("EXPONENTIAL", &mut bytes, 8).unwrap();
        assert_eq!(bytes, [2.5f32, -8.0].iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>());
        assert!(filter("QUATERNION", &mut [0; 4], 4).is_err() && filter("OTHER", &mut [0; 4], 4).is_err());
    }

    #[test]
    fn promises_beyond_the_bytes_are_refused_before_memory_is_taken() {
        for mode in ["ATTRIBUTES", "TRIANGLES", "INDICES"] {
            let error = decode(mode, &[0xa0; 40], 4, 3 << 50).unwrap_err();
            assert!(error.contains("cannot be in 40 bytes"), "{mode}: {error}");
            assert!(decode(mode, &[0xa0; 40], 4, 3).unwrap_err().contains("damaged"), "{mode}");
        }
        assert!(decode("ATTRIBUTES", &[0xa0; 40], 6, 1).is_err() && decode("VERTICES", &[0xa0; 40], 4, 1).is_err());
    }
}
