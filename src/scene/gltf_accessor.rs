//! glTF buffers, with every bound checked before use.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gltf::accessor::sparse::IndexType;
use gltf::accessor::{DataType, Dimensions};
use gltf::{Accessor, Document, buffer};

use super::gltf_compressed;
use crate::error::{Error, Result};
use crate::input::Inputs;

/// Elements that an accessor without a buffer view may ask to be filled with zeros.
const MOST_ZEROS: usize = 1 << 24;

/// The buffers of a document.
pub(super) struct Buffers<'a> {
    path: &'a Path,
    pub(super) inputs: &'a Inputs,
    data: Vec<buffer::Data>,
    /// Views and accessors that are compressed in the file, by index.
    views: BTreeMap<usize, Vec<u8>>,
    accessors: BTreeMap<usize, Vec<u8>>,
    /// Vectors may consist of integers as they stand.
    quantized: bool,
}

impl<'a> Buffers<'a> {
    /// Reads external files, data URIs and the binary chunk.
    pub(super) fn read(
        (path, inputs): (&'a Path, &'a Inputs),
        document: &Document,
        mut blob: Option<Vec<u8>>,
        quantized: bool,
    ) -> Result<Self> {
        let mut data = Vec::new();
        for buffer in document.buffers() {
            if gltf_compressed::is_fallback(&buffer) {
                data.push(buffer::Data(Vec::new()));
                continue;
            }
            let bytes = match buffer.source() {
                buffer::Source::Uri(uri) => external(inputs, path, uri),
                buffer::Source::Bin => blob.take().ok_or_else(|| reason(&gltf::Error::MissingBlob)),
            };
            let mut bytes = bytes.map_err(|why| Error::file(path, format!("buffer {}: {why}", buffer.index())))?;
            // Some exporters leave out the padding that they count.
            bytes.resize(bytes.len().next_multiple_of(4), 0);
            let bytes = buffer::Data(bytes);
            if bytes.len() < buffer.length() {
                let (index, length) = (buffer.index(), buffer.length());
                let message = format!("buffer {index}: {length} bytes are promised, {} are there", bytes.len());
                return Err(Error::file(path, message));
            }
            data.push(bytes);
        }
        let (views, accessors) = (BTreeMap::new(), BTreeMap::new());
        let mut buffers = Buffers { path, inputs, data, views, accessors, quantized };
        let error = |message: String| Error::file(path, message);
        let (mut taken, all) = (0, buffers.data.iter().map(|data| data.0.len()).sum::<usize>());
        for view in document.views() {
            let range = |buffer: usize, offset: usize, length: usize| {
                buffers.data.get(buffer)?.0.get(offset..offset.checked_add(length)?)
            };
            if let Some(decoded) = gltf_compressed::meshopt(&view, range) {
                let decoded = decoded.map_err(error)?;
                taken += decoded.len();
                if taken > all.saturating_mul(gltf_compressed::MOST_MESHOPT) {
                    let message = format!("bufferView {}: too many views stand for the same bytes", view.index());
                    return Err(error(message));
                }
                buffers.views.insert(view.index(), decoded);
            }
        }
        buffers.accessors = gltf_compressed::draco(document, |view| buffers.view(view), error)?;
        Ok(buffers)
    }

    /// The bytes of a view.
    pub(super) fn view(&self, view: &buffer::View) -> Result<&[u8]> {
        if let Some(decoded) = self.views.get(&view.index()) {
            return Ok(decoded);
        }
        let buffer = view.buffer();
        // There may be more, and there is less in a buffer that only stands for compressed data.
        let whole = &self.data[buffer.index()].0;
        let whole = &whole[..buffer.length().min(whole.len())];
        view.offset().checked_add(view.length()).and_then(|end| whole.get(view.offset()..end)).ok_or_else(|| {
            let (index, offset, length) = (view.index(), view.offset(), view.length());
            let message = format!(
                "bufferView {index}: bytes {offset} + {length} reach beyond buffer {} of {}",
                buffer.index(),
                buffer.length()
            );
            Error::file(self.path, message)
        })
    }

    /// The elements of an accessor, packed.
    fn elements(&self, accessor: &Accessor) -> Result<Vec<u8>> {
        let error = |message: String| Error::file(self.path, format!("accessor {}: {message}", accessor.index()));
        let (size, count) = (accessor.size(), accessor.count());
        let mut packed = match (self.accessors.get(&accessor.index()), accessor.view()) {
            (Some(decoded), _) => decoded.clone(),
            (None, Some(view)) => {
                let bytes = self.view(&view)?;
                let stride = view.stride().unwrap_or(size);
                if stride < size {
                    return Err(error(format!("stride {stride} is below the size of an element, {size}")));
                }
                strided(bytes, accessor.offset(), stride, size, count).ok_or_else(|| {
                    error(format!("{count} elements reach beyond bufferView {} of {} bytes", view.index(), bytes.len()))
                })?
            }
            (None, None) if count <= MOST_ZEROS => vec![0; count * size],
            (None, None) => return Err(error(format!("{count} elements, but no bufferView to read them from"))),
        };
        if let Some(sparse) = accessor.sparse() {
            let (indices, values) = (sparse.indices(), sparse.values());
            let width = match indices.index_type() {
                IndexType::U8 => 1,
                IndexType::U16 => 2,
                IndexType::U32 => 4,
            };
            let beyond = || error(String::from("sparse elements reach beyond their bufferView"));
            let at = strided(self.view(&indices.view())?, indices.offset(), width, width, sparse.count());
            let with = strided(self.view(&values.view())?, values.offset(), size, size, sparse.count());
            let (at, with) = (at.ok_or_else(beyond)?, with.ok_or_else(beyond)?);
            for (index, value) in at.chunks_exact(width).zip(with.chunks_exact(size)) {
                let index = little_endian(index) as usize;
                if index >= count {
                    return Err(error(format!("sparse index {index} is out of range, there are {count} elements")));
                }
                packed[index * size..][..size].copy_from_slice(value);
            }
        }
        Ok(packed)
    }

    /// An accessor of `N`-vectors, scalars (1) or 4x4 matrices (16): floats, integers marked as normalised, or with
    /// KHR_mesh_quantization any of 8 or 16 bits.
    pub(super) fn vectors<const N: usize>(&self, accessor: &Accessor, what: &str) -> Result<Vec<[f32; N]>> {
        let error =
            |message: String| Error::file(self.path, format!("accessor {} ({what}): {message}", accessor.index()));
        // A 2x2 matrix has as many numbers as a vector.
        if accessor.dimensions().multiplicity() != N || accessor.dimensions() == Dimensions::Mat2 {
            return Err(error(format!("{:?} where {N} numbers are needed", accessor.dimensions())));
        }
        let (kind, normalized) = (accessor.data_type(), accessor.normalized());
        let component: fn(&[u8]) -> f32 = match (kind, normalized) {
            (DataType::F32, _) => |b| f32::from_bits(little_endian(b)),
            (DataType::U8, true) => |b| f32::from(b[0]) / 255.0,
            (DataType::I8, true) => |b| (f32::from(b[0] as i8) / 127.0).max(-1.0),
            (DataType::U16, true) => |b| little_endian(b) as f32 / 65535.0,
            (DataType::I16, true) => |b| (f32::from(little_endian(b) as i16) / 32767.0).max(-1.0),
            (DataType::U8, false) if self.quantized => |b| f32::from(b[0]),
            (DataType::I8, false) if self.quantized => |b| f32::from(b[0] as i8),
            (DataType::U16, false) if self.quantized => |b| little_endian(b) as f32,
            (DataType::I16, false) if self.quantized => |b| f32::from(little_endian(b) as i16),
            _ => return Err(error(format!("components of type {kind:?} must be floats or normalised integers"))),
        };
        let packed = self.elements(accessor)?;
        let vectors: Vec<[f32; N]> = packed
            .chunks_exact(N * kind.size())
            .map(|element| {
                let mut vector = [0.0; N];
                for (value, bytes) in vector.iter_mut().zip(element.chunks_exact(kind.size())) {
                    *value = component(bytes);
                }
                vector
            })
            .collect();
        if let Some(i) = vectors.iter().position(|v| v.iter().any(|x| !x.is_finite())) {
            return Err(error(format!("element {i} is {:?}: not finite", vectors[i])));
        }
        Ok(vectors)
    }

    /// An accessor of numbers, with the rules of [`Buffers::vectors`].
    pub(super) fn scalars(&self, accessor: &Accessor, what: &str) -> Result<Vec<f32>> {
        Ok(self.vectors::<1>(accessor, what)?.into_iter().flatten().collect())
    }

    /// An accessor of four indices of joints.
    pub(super) fn joints(&self, accessor: &Accessor) -> Result<Vec<[u16; 4]>> {
        let kind = accessor.data_type();
        if accessor.dimensions() != Dimensions::Vec4 || !matches!(kind, DataType::U8 | DataType::U16) {
            let (index, dimensions) = (accessor.index(), accessor.dimensions());
            let message = format!(
                "accessor {index} (JOINTS): {dimensions:?} of {kind:?} where four unsigned integers of 8 or 16 bits are needed"
            );
            return Err(Error::file(self.path, message));
        }
        let packed = self.elements(accessor)?;
        let four = |element: &[u8]| {
            let mut joints = [0; 4];
            for (joint, bytes) in joints.iter_mut().zip(element.chunks_exact(kind.size())) {
                *joint = little_endian(bytes) as u16;
            }
            joints
        };
        Ok(packed.chunks_exact(4 * kind.size()).map(four).collect())
    }

    /// An accessor of vertex indices, each below `limit`.
    pub(super) fn indices(&self, accessor: &Accessor, limit: usize) -> Result<Vec<u32>> {
        let error =
            |message: String| Error::file(self.path, format!("accessor {} (indices): {message}", accessor.index()));
        let kind = accessor.data_type();
        if accessor.dimensions() != Dimensions::Scalar || !matches!(kind, DataType::U8 | DataType::U16 | DataType::U32)
        {
            return Err(error(format!("{:?} of {kind:?} where unsigned integers are needed", accessor.dimensions())));
        }
        let indices: Vec<u32> = self.elements(accessor)?.chunks_exact(kind.size()).map(little_endian).collect();
        match indices.iter().find(|&&i| i as usize >= limit) {
            Some(i) => Err(error(format!("vertex {i} is out of range, there are {limit}"))),
            None => Ok(indices),
        }
    }
}

/// Packs `count` elements of `size` bytes, `stride` apart; `None` if they reach beyond the bytes.
fn strided(bytes: &[u8], offset: usize, stride: usize, size: usize, count: usize) -> Option<Vec<u8>> {
    if count == 0 {
        return Some(Vec::new());
    }
    let end = stride.checked_mul(count - 1)?.checked_add(size)?.checked_add(offset)?;
    let bytes = bytes.get(offset..end)?;
    Some(bytes.chunks(stride).flat_map(|element| &element[..size]).copied().collect())
}

/// Unsigned integer of 1, 2 or 4 bytes.
fn little_endian(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
}

/// The bytes that a URI of the document stands for: those of a file next to it, or of the URI itself.
pub(super) fn external(inputs: &Inputs, document: &Path, uri: &str) -> Result<Vec<u8>, String> {
    let of_file = |path: PathBuf| inputs.read(&path).map_err(|e| e.to_string());
    match uri.split_once(':') {
        Some(("data", _)) => {
            buffer::Data::from_source(buffer::Source::Uri(uri), None).map(|data| data.0).map_err(|e| reason(&e))
        }
        Some(("file", path)) => of_file(PathBuf::from(path.strip_prefix("//").unwrap_or(path))),
        Some((scheme, _)) => Err(format!("URIs of the kind {scheme:?} are not read; use a file or \"data:\"")),
        None => {
            let name = urlencoding::decode(uri).map_err(|_| format!("the URI {uri:?} is not UTF-8"))?;
            of_file(document.parent().unwrap_or(Path::new("")).join(&*name))
        }
    }
}

/// Message of a glTF error, without Rust's names.
pub(super) fn reason(error: &gltf::Error) -> String {
    match error {
        gltf::Error::Validation(errors) => {
            let list: Vec<String> = errors.iter().take(3).map(|(at, what)| format!("{at}: {what}")).collect();
            format!("invalid glTF: {}", list.join("; "))
        }
        gltf::Error::MissingBlob => String::from("there is no binary chunk to read it from"),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strides_are_checked() {
        let bytes: Vec<u8> = (0..10).collect();
        assert_eq!(strided(&bytes, 1, 4, 2, 2), Some(vec![1, 2, 5, 6]));
        // The last element needs no padding up to the stride.
        assert_eq!(strided(&bytes, 0, 4, 2, 3), Some(vec![0, 1, 4, 5, 8, 9]));
        assert_eq!(strided(&bytes, 1, 4, 2, 3), None);
        assert_eq!(strided(&bytes, 0, usize::MAX, 2, 3), None);
        assert_eq!(strided(&bytes, usize::MAX, 4, 2, 1), None);
        assert_eq!(strided(&bytes, 0, 4, 2, 0), Some(vec![]));
    }

    #[test]
    fn integers_are_little_endian() {
        assert_eq!(little_endian(&[1, 2]), 0x201);
        assert_eq!(little_endian(&[0xff; 4]), u32::MAX);
    }
}
