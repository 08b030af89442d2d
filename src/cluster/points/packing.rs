//! Shaded points in few bytes (Wald et al. 2002, 4.2), with bounded errors.
//!
//! A plain point, whose eye ray ends on a diffuse surface, takes 20 bytes: flags 1, albedo 3, normal 4, distance 4, direct and indirect irradiance 4
//! each; its first hit, where edges are antialiased, 8 more. Its position follows from the ray. Points with more to tell (emission, mirrors, glass, lobes, a shading
//! normal of their own, and all second components) take 57 bytes more. Columns of differences between neighbours are then compressed (zlib).
//!
//! | value | form | error |
//! |---|---|---|
//! | irradiance, emission, throughput, specular radiance | three mantissas of 9 bits, a shared exponent of 5 | 2^-9 of the largest component; below 2^-38 of the task's largest, that |
//! | albedo, specular reflectance | 8 bits | 1/510 |
//! | normals, directions | octahedral, 2 x 16 bits | length [`NORMAL_ERROR`] |
//! | distance, depth, alpha, f90, probability, first hits | 32 bits | 0 |
//! | position of a plain point | ray and distance | [`POSITION_ERROR`] of the scene's scale |
//!
//! Values that are no numbers, or reflectances above 1, are sent as they are, with all points of the task, so that the master leaves the pass out.

use std::collections::BTreeSet;
use std::io::{Read, Write};

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use glam::{Vec3, Vec4};

use super::{Shape, TaskPoints, strange};
use crate::accel::offset_origin;
use crate::device_scene::encode_normal;
use crate::error::Result;
use crate::pass::layout::FrameParameters;
use crate::pass::{ShadingPoints, camera_rays, finite};
use crate::view::Task;

/// Length of the error of a unit vector: each of two coordinates on the octahedron errs by half a step, h = 1 / 65534, the third by their sum, so the vector by up to
/// sqrt(6) h; and it is 1 / sqrt(3) long at least, so that sqrt(18) h is left of that after normalisation.
pub const NORMAL_ERROR: f32 = 6.5e-5;
/// Error of a position, relative to the scale of the scene's coordinates, [`FrameParameters::eye`]: that of the offset of ray origins.
pub const POSITION_ERROR: f32 = 2e-5;

/// Forms of the bytes.
const EXACT: u8 = 0;
const PACKED: u8 = 1;
/// Flags of plain points; the bit above them marks the others.
const PLAIN_FLAGS: u32 = 0x7f;
const RICH: u32 = 0x80;

// Arrays of `Frame::point_buffers`, by their place there.
const POSITION: usize = 0;
const GEOMETRIC: usize = 1;
const SHADING: usize = 2;
const KD: usize = 3;
const F0: usize = 4;
const WO: usize = 5;
const EMITTED: usize = 6;
const THROUGHPUT: usize = 7;
const DIRECT: usize = 8;
const INDIRECT: usize = 9;
const SPECULAR: usize = 10;

/// A column's values, as differences from one to the next, byte by byte.
fn put(out: &mut Vec<u8>, width: u32, values: impl Iterator<Item = u32>) {
    let unused = 32 - 8 * width;
    let mut before = 0u32;
    let differences: Vec<u32> = values
        .map(|value| {
            let difference = (value.wrapping_sub(before) << unused) as i32 >> unused;
            before = value;
            ((difference << 1) ^ (difference >> 31)) as u32
        })
        .collect();
    (0..width).for_each(|byte| out.extend(differences.iter().map(|&difference| (difference >> (8 * byte)) as u8)));
}

/// The values of [`put`], of which there are so many. `None`: too few bytes.
fn get(bytes: &mut &[u8], width: u32, count: usize) -> Option<Vec<u32>> {
    let (own, rest) = bytes.split_at_checked(width as usize * count)?;
    *bytes = rest;
    let mask = u32::MAX >> (32 - 8 * width);
    let mut before = 0u32;
    let value = |i: usize| {
        let folded = (0..width as usize).fold(0, |sum, byte| sum | u32::from(own[byte * count + i]) << (8 * byte));
        let difference = (folded >> 1) ^ (folded & 1).wrapping_neg();
        before = before.wrapping_add(difference) & mask;
        before
    };
    Some((0..count).map(value).collect())
}

/// Colours as three mantissas and an exponent that they share, as rgb9e5; `shift`: exponent of the largest value of all.
fn encode_color(color: Vec3, shift: i32) -> [u32; 4] {
    let largest = color.max_element();
    if largest <= 0.0 {
        return [0; 4];
    }
    // The exponent by which the largest mantissa rounds to less than 512.
    let mut exponent = (f64::from(largest).log2().floor() as i32 + 1 - shift).max(-31);
    let step = |exponent: i32| f64::from(exponent + shift - 9).exp2();
    if (f64::from(largest) / step(exponent)).round() >= 512.0 {
        exponent += 1;
    }
    let mantissa = |value: f32| (f64::from(value.max(0.0)) / step(exponent)).round() as u32;
    [mantissa(color.x), mantissa(color.y), mantissa(color.z), (exponent + 31) as u32]
}

fn decode_color([x, y, z, exponent]: [u32; 4], shift: i32) -> Vec3 {
    let step = f64::from(exponent as i32 - 31 + shift - 9).exp2();
    Vec3::from_array([x, y, z].map(|mantissa| (f64::from(mantissa) * step) as f32))
}

/// The exponent above all of these colours: mantissas may round up to the next one.
fn shift_of(colors: impl Iterator<Item = Vec3>) -> i32 {
    let largest = colors.map(Vec3::max_element).fold(f32::MIN_POSITIVE, f32::max);
    f64::from(largest).log2().floor() as i32 + 2
}

fn put_colors(out: &mut Vec<u8>, colors: &[Vec3]) {
    let shift = shift_of(colors.iter().copied());
    out.extend(shift.to_le_bytes());
    let codes: Vec<[u32; 4]> = colors.iter().map(|&color| encode_color(color, shift)).collect();
    // Nine bits and five: the ninth bit of each goes with the exponent, so that there are four bytes.
    (0..3).for_each(|i| put(out, 1, codes.iter().map(|code| code[i] & 255)));
    put(out, 1, codes.iter().map(|code| code[3] | (code[0] >> 8) << 5 | (code[1] >> 8) << 6 | (code[2] >> 8) << 7));
}

fn get_colors(bytes: &mut &[u8], count: usize) -> Option<Vec<Vec3>> {
    let (shift, rest) = bytes.split_first_chunk::<4>()?;
    *bytes = rest;
    let shift = i32::from_le_bytes(*shift);
    let [x, y, z, rest] = [get(bytes, 1, count)?, get(bytes, 1, count)?, get(bytes, 1, count)?, get(bytes, 1, count)?];
    let color = |i: usize| {
        let high = |bit: u32| (rest[i] >> bit & 1) << 8;
        decode_color([x[i] | high(5), y[i] | high(6), z[i] | high(7), rest[i] & 31], shift)
    };
    Some((0..count).map(color).collect())
}

/// Unit vectors, from [`encode_normal`].
fn decode_normal(code: u32) -> Vec3 {
    let [x, y] = [code as u16, (code >> 16) as u16].map(|half| f32::from(half as i16) / 32767.0);
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize()
}

fn put_normals(out: &mut Vec<u8>, normals: impl Iterator<Item = Vec3> + Clone) {
    put(out, 2, normals.clone().map(|normal| encode_normal(normal) & 0xffff));
    put(out, 2, normals.map(|normal| encode_normal(normal) >> 16));
}

fn get_normals(bytes: &mut &[u8], count: usize) -> Option<Vec<Vec3>> {
    let [low, high] = [get(bytes, 2, count)?, get(bytes, 2, count)?];
    Some(low.into_iter().zip(high).map(|(low, high)| decode_normal(low | high << 16)).collect())
}

/// Parts of 1 in 8 bits.
fn byte(share: f32) -> u32 {
    (share.clamp(0.0, 1.0) * 255.0).round() as u32
}

fn share(byte: u32) -> f32 {
    byte as f32 / 255.0
}

/// A point, as the arrays hold it.
type Point = [Vec4; 11];

/// A point of a ray that starts at the eye, before it is packed: what the ray and its distance tell.
fn on_ray(parameters: &FrameParameters, pixel: u32, distance: f32, normal: Vec3) -> (Vec4, Vec3, f32) {
    let ray = camera_rays::reference(parameters, pixel);
    let forward = Vec4::from(parameters.forward).truncate();
    let position = offset_origin(ray.origin + distance * ray.direction, normal, parameters.eye[3]);
    (position.extend(distance), -ray.direction, ray.direction.dot(forward) * distance)
}

/// Whether it has more to tell than a plain point.
fn is_rich(point: &Point, is_second: bool) -> bool {
    let flags = ShadingPoints::flags(point[WO].w);
    let [emitted, throughput] = [point[EMITTED], point[THROUGHPUT]];
    is_second
        || flags & !PLAIN_FLAGS != 0
        || flags & (ShadingPoints::SEEN_BY_SPECULAR | ShadingPoints::GLOSSY) != 0
        || emitted != Vec4::ZERO
        || throughput.truncate() != Vec3::ONE
        || point[SPECULAR].truncate() != Vec3::ZERO
        || point[F0].truncate() != Vec3::ZERO
        || point[SHADING].truncate() != point[GEOMETRIC].truncate()
}

impl TaskPoints {
    /// The points in few bytes; `parameters`: those of their pass.
    pub fn pack(&self, shape: &Shape, parameters: &FrameParameters) -> Vec<u8> {
        let (form, bytes) = match self.columns(shape, parameters) {
            Some(columns) => (PACKED, columns),
            None => (EXACT, self.to_bytes()),
        };
        let mut encoder = ZlibEncoder::new(vec![form], Compression::fast());
        // Memory takes all bytes.
        encoder.write_all(&bytes).and_then(|()| encoder.finish()).unwrap_or_default()
    }

    /// The points of a task from [`TaskPoints::pack`]. Errors: the bytes are cut off or damaged, or of another task.
    pub fn unpack(task: Task, shape: &Shape, bytes: &[u8]) -> Result<TaskPoints> {
        let (form, packed) = bytes.split_first().ok_or_else(strange)?;
        let mut bytes = Vec::new();
        let most = 512 * u64::from(shape.size[0]) * u64::from(shape.size[1]) + 4096;
        ZlibDecoder::new(packed).take(most).read_to_end(&mut bytes).map_err(|_| strange())?;
        match *form {
            EXACT => TaskPoints::from_bytes(task, &bytes),
            PACKED => TaskPoints::from_columns(task, shape, &bytes).ok_or_else(strange),
            _ => Err(strange()),
        }
    }

    /// A point by its place among the slots.
    fn point(&self, i: usize, slots: usize) -> Point {
        std::array::from_fn(|array| Vec4::from_array(self.values[array * slots + i].map(f32::from_bits)))
    }

    /// `None`: some value is no number, or some reflectance no part of 1.
    fn columns(&self, shape: &Shape, parameters: &FrameParameters) -> Option<Vec<u8>> {
        let tiles: BTreeSet<u32> = self.tiles.iter().copied().collect();
        let (pixels, slots) = shape.slots(&self.task, &tiles);
        let mut points: Vec<Point> = (0..slots.len()).map(|i| self.point(i, slots.len())).collect();
        for point in &mut points {
            let flags = ShadingPoints::flags(point[WO].w);
            if flags & ShadingPoints::LIT == 0 {
                // Nothing wrote them.
                [DIRECT, INDIRECT, SPECULAR].into_iter().for_each(|array| point[array] = Vec4::ZERO);
            }
            if flags & ShadingPoints::HIT == 0 {
                [GEOMETRIC, SHADING].into_iter().for_each(|array| point[array] = Vec3::Z.extend(0.0));
                [POSITION, KD, F0].into_iter().for_each(|array| point[array] = Vec4::ZERO);
            }
        }
        let is_number = |point: &Point| {
            let checked = [POSITION, KD, F0, EMITTED, THROUGHPUT, DIRECT, INDIRECT, SPECULAR];
            checked.iter().all(|&array| finite::reference(&point[array].truncate().to_array()))
        };
        let is_share = |point: &Point| {
            [KD, F0]
                .iter()
                .all(|&array| point[array].truncate().clamp(Vec3::ZERO, Vec3::ONE) == point[array].truncate())
        };
        if !points.iter().all(|point| is_number(point) && is_share(point)) {
            return None;
        }
        let mut out = Vec::new();
        out.extend((self.tiles.len() as u32).to_le_bytes());
        let p = parameters;
        let rows = [p.eye, p.right, p.up, p.forward, p.pixel_offset, p.shift];
        rows.iter().for_each(|row| out.extend_from_slice(bytemuck::bytes_of(row)));
        out.extend_from_slice(bytemuck::bytes_of(&p.within));
        put(&mut out, 4, self.tiles.iter().copied());

        let rich: Vec<bool> = points.iter().enumerate().map(|(i, point)| is_rich(point, i >= pixels)).collect();
        let flags = |point: &Point| ShadingPoints::flags(point[WO].w);
        put(
            &mut out,
            1,
            points.iter().zip(&rich).map(|(p, &rich)| flags(p) & PLAIN_FLAGS | if rich { RICH } else { 0 }),
        );
        (0..3).for_each(|axis| put(&mut out, 1, points.iter().map(|point| byte(point[KD][axis]))));
        put_normals(&mut out, points.iter().map(|point| point[GEOMETRIC].truncate()));
        put(&mut out, 4, points.iter().map(|point| point[POSITION].w.to_bits()));
        let colors =
            |points: &[Point], array: usize| -> Vec<Vec3> { points.iter().map(|p| p[array].truncate()).collect() };
        [DIRECT, INDIRECT].iter().for_each(|&array| put_colors(&mut out, &colors(&points, array)));

        let more: Vec<Point> = points.iter().zip(&rich).filter(|(_, rich)| **rich).map(|(point, _)| *point).collect();
        put(&mut out, 2, more.iter().map(|point| flags(point) >> 7));
        put_normals(&mut out, more.iter().map(|point| point[SHADING].truncate()));
        put_normals(&mut out, more.iter().map(|point| point[WO].truncate()));
        (0..3).for_each(|axis| put(&mut out, 1, more.iter().map(|point| byte(point[F0][axis]))));
        [GEOMETRIC, SHADING, KD, EMITTED, THROUGHPUT]
            .iter()
            .for_each(|&array| put(&mut out, 4, more.iter().map(|point| point[array].w.to_bits())));
        (0..3).for_each(|axis| put(&mut out, 4, more.iter().map(|point| point[POSITION][axis].to_bits())));
        [EMITTED, THROUGHPUT, SPECULAR].iter().for_each(|&array| put_colors(&mut out, &colors(&more, array)));
        for hits in self.hits.chunks(pixels.max(1)) {
            put(&mut out, 4, hits.iter().map(|hit| hit[0]));
            put(&mut out, 4, hits.iter().zip(&points).map(|(hit, point)| hit[1] ^ point[POSITION].w.to_bits()));
        }
        Some(out)
    }

    fn from_columns(task: Task, shape: &Shape, mut bytes: &[u8]) -> Option<TaskPoints> {
        let bytes = &mut bytes;
        let mut word = || {
            let (word, rest) = bytes.split_first_chunk::<4>()?;
            *bytes = rest;
            Some(u32::from_le_bytes(*word))
        };
        let tile_count = word()?.min(shape.tile_count()) as usize;
        let mut rows = [[0u32; 4]; 7];
        for value in rows.as_flattened_mut() {
            *value = word()?;
        }
        let [eye, right, up, forward, pixel_offset, shift] = std::array::from_fn(|i| rows[i].map(f32::from_bits));
        let size = [shape.size[0], shape.size[1], 0, 0];
        let parameters = FrameParameters {
            eye,
            right,
            up,
            forward,
            pixel_offset,
            shift,
            size,
            within: rows[6],
            ..Default::default()
        };
        let tiles = get(bytes, 4, tile_count)?;
        let (pixels, slots) = shape.slots(&task, &tiles.iter().copied().collect());
        let count = slots.len();

        let flags = get(bytes, 1, count)?;
        let kd = [get(bytes, 1, count)?, get(bytes, 1, count)?, get(bytes, 1, count)?];
        let normals = get_normals(bytes, count)?;
        let distances = get(bytes, 4, count)?;
        let (direct, indirect) = (get_colors(bytes, count)?, get_colors(bytes, count)?);
        let rich = flags.iter().filter(|&&flags| flags & RICH != 0).count();
        let high = get(bytes, 2, rich)?;
        let (shading, wo) = (get_normals(bytes, rich)?, get_normals(bytes, rich)?);
        let f0 = [get(bytes, 1, rich)?, get(bytes, 1, rich)?, get(bytes, 1, rich)?];
        let mut last = || get(bytes, 4, rich);
        let [f90, alpha, diffuse, of_emitted, depth] = [last()?, last()?, last()?, last()?, last()?];
        let place = [get(bytes, 4, rich)?, get(bytes, 4, rich)?, get(bytes, 4, rich)?];
        let [emitted, throughput, specular] =
            [get_colors(bytes, rich)?, get_colors(bytes, rich)?, get_colors(bytes, rich)?];

        let mut values = vec![[0; 4]; count * shape.arrays[0]];
        let mut next = 0;
        for i in 0..count {
            let distance = f32::from_bits(distances[i]);
            let mut point: Point = [Vec4::ZERO; 11];
            point[KD] = Vec3::from_array(kd.each_ref().map(|axis| share(axis[i]))).extend(1.0);
            (point[DIRECT], point[INDIRECT]) = (direct[i].extend(0.0), indirect[i].extend(0.0));
            if flags[i] & RICH == 0 {
                let (position, wo, depth) = on_ray(&parameters, slots[i] as u32, distance, normals[i]);
                point[POSITION] = position;
                (point[GEOMETRIC], point[SHADING]) = (normals[i].extend(0.0), normals[i].extend(0.0));
                point[WO] = wo.extend(ShadingPoints::word(flags[i]));
                point[THROUGHPUT] = Vec3::ONE.extend(depth);
            } else {
                let k = next;
                next += 1;
                let at = Vec3::from_array(place.each_ref().map(|axis| f32::from_bits(axis[k])));
                point[POSITION] = at.extend(distance);
                point[GEOMETRIC] = normals[i].extend(f32::from_bits(f90[k]));
                point[SHADING] = shading[k].extend(f32::from_bits(alpha[k]));
                point[KD].w = f32::from_bits(diffuse[k]);
                point[F0] = Vec3::from_array(f0.each_ref().map(|axis| share(axis[k]))).extend(0.0);
                point[WO] = wo[k].extend(ShadingPoints::word(flags[i] & PLAIN_FLAGS | high[k] << 7));
                point[EMITTED] = emitted[k].extend(f32::from_bits(of_emitted[k]));
                point[THROUGHPUT] = throughput[k].extend(f32::from_bits(depth[k]));
                point[SPECULAR] = specular[k].extend(0.0);
            }
            point
                .iter()
                .enumerate()
                .for_each(|(array, value)| values[array * count + i] = value.to_array().map(f32::to_bits));
        }
        let mut hits = Vec::with_capacity(pixels * shape.arrays[1]);
        for _ in 0..shape.arrays[1] {
            let (triangles, differences) = (get(bytes, 4, pixels)?, get(bytes, 4, pixels)?);
            hits.extend((0..pixels).map(|i| [triangles[i], differences[i] ^ distances[i]]));
        }
        bytes.is_empty().then_some(TaskPoints { task, tiles, values, hits })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::random::{key, random_f32};

    fn random(i: u32, j: u32) -> f32 {
        random_f32(key(7, i, j, 3))
    }

    #[test]
    fn columns_come_back() {
        let values: Vec<u32> = (0..300).map(|i| key(1, i, 2, 3)).chain([0, u32::MAX, 0, 1, 1 << 31]).collect();
        for width in [1, 2, 4] {
            let mask = u32::MAX >> (32 - 8 * width);
            let mut bytes = Vec::new();
            put(&mut bytes, width, values.iter().map(|value| value & mask));
            assert_eq!(bytes.len(), values.len() * width as usize);
            let rest = &mut &bytes[..];
            let expected: Vec<u32> = values.iter().map(|value| value & mask).collect();
            assert_eq!(get(rest, width, values.len()), Some(expected));
            assert!(rest.is_empty() && get(rest, width, 1).is_none());
        }
    }

    #[test]
    fn colors_err_by_at_most_their_bound_and_reach_it() {
        let mut worst = 0.0f32;
        for i in 0..20_000 {
            // Over 60 powers of two.
            let scale = (60.0 * random(i, 0) - 30.0).exp2();
            let color = scale * Vec3::new(random(i, 1), random(i, 2), random(i, 3));
            let shift = shift_of([color].into_iter());
            let error = (decode_color(encode_color(color, shift), shift) - color).abs().max_element();
            worst = worst.max(error / color.max_element());
        }
        let bound = (-9f32).exp2();
        assert!(worst <= bound && worst > 0.9 * bound, "{} of the bound", worst / bound);
        // Dark ones beside bright ones err by a part of these.
        let [bright, dark] = [Vec3::splat(1000.0), Vec3::new(1e-9, 2e-9, 0.0)];
        let shift = shift_of([bright, dark].into_iter());
        let error = (decode_color(encode_color(dark, shift), shift) - dark).abs().max_element();
        assert!(error <= 1000.0 * (-38f32).exp2(), "{error}");
        assert_eq!(decode_color(encode_color(Vec3::ZERO, shift), shift), Vec3::ZERO);
        // A mantissa that rounds up to the next power of two.
        let nearly = Vec3::new(0.999_99, 0.5, 0.0);
        let shift = shift_of([nearly].into_iter());
        assert_eq!(decode_color(encode_color(nearly, shift), shift), Vec3::new(1.0, 0.5, 0.0));
    }

    #[test]
    fn normals_err_by_at_most_their_bound_and_come_near_it() {
        let mut worst = 0.0f32;
        for i in 0..20_000 {
            let z = 2.0 * random(i, 0) - 1.0;
            let (sin, cos) = (std::f32::consts::TAU * random(i, 1)).sin_cos();
            let normal = Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
            worst = worst.max((decode_normal(encode_normal(normal)) - normal).length());
        }
        assert!(worst <= NORMAL_ERROR && worst > 0.8 * NORMAL_ERROR, "{worst}");
    }
}
