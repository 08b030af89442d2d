//! Shaded points in few bytes (Wald et al. 2002, 4.2), with bounded errors.
//!
//! A plain point, whose eye ray ends on a diffuse surface, takes 20 bytes: flags 1, albedo 3, normal 4, distance 4, direct and indirect irradiance 4
//! each; its first hit, where edges are antialiased, 5 to 9 more. Its place follows from the ray. Points with more to tell (emission, lobes, a shading
//! normal of their own, and all below) take 33 bytes more, and those whose place and path do not follow from the pixel's ray (in mirrors, behind glass, all
//! second components) another 21. Columns (`columns.rs`) of what is left after a guess from the neighbours are then compressed (zlib).
//!
//! | value | form | error |
//! |---|---|---|
//! | irradiance, emission, throughput, specular radiance | three mantissas of 9 bits, a shared exponent of 5 | 2^-9 of the largest component; below 2^-38 of the task's largest, that |
//! | albedo, specular reflectance | 8 bits | 1/510 |
//! | normals, directions | octahedral, 2 x 16 bits | length [`NORMAL_ERROR`] |
//! | alpha, f90, probability, triangles of first hits | 32 bits | 0 |
//! | distances, those of first hits too | 26 bits | relative, [`DEPTH_ERROR`] |
//! | position on the pixel's ray | ray and distance | [`POSITION_ERROR`] of the scene's scale |
//! | other positions | 3 x 24 bits | 2^-17 of the scale, less than that |
//! | depth | from the ray, or 26 bits | relative, [`DEPTH_ERROR`] |
//!
//! Velocities, near light that spreads, caustics, and the data by which mirror images spread are sent exactly.
//!
//! Values that are no numbers, reflectances above 1, and positions beyond 64 times the scale are sent as they are, with all points of the task, so that the master
//! leaves the pass out where it has to.

use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::{Vec3, Vec4};
use zune_inflate::{DeflateDecoder, DeflateOptions};

use super::columns::{
    Colors, Normals, Steps, byte, decode_depth, decode_normal, encode_depth, get, put, put_colors, put_normals, share,
};
use super::more::{More, put_more};
use super::{Listed, Shape, TaskPoints, strange};
use crate::accel::{Ray, offset_origin};
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
/// Relative error of a depth or distance: 2^-18 by rounding, and that of a depth that is told by the ray and its distance.
pub const DEPTH_ERROR: f32 = 1e-5;

/// Forms of the bytes.
const EXACT: u8 = 0;
const PACKED: u8 = 1;
/// Flags of plain points; the bit above them marks the others.
const PLAIN_FLAGS: u32 = 0x7f;
pub(super) const RICH: u32 = 0x80;
/// Marks, beside the flags above those, points whose place and path do not follow from the pixel's ray.
pub(super) const OFF_RAY: u32 = 0x8000;

// Arrays of `Frame::point_buffers`, by their place there.
const POSITION: usize = 0;
const GEOMETRIC: usize = 1;
const SHADING: usize = 2;
const KD: usize = 3;
const F0: usize = 4;
pub(super) const WO: usize = 5;
const EMITTED: usize = 6;
const THROUGHPUT: usize = 7;
const DIRECT: usize = 8;
const INDIRECT: usize = 9;
const SPECULAR: usize = 10;
/// Number of arrays.
pub(super) const ARRAYS: usize = 11;
/// Those that hold zeros for plain points.
pub(super) const ZERO_IF_PLAIN: [usize; 3] = [F0, EMITTED, SPECULAR];

/// A point, as the arrays hold it.
pub(super) type Point = [Vec4; ARRAYS];

fn flags(point: &Point) -> u32 {
    ShadingPoints::flags(point[WO].w)
}

/// The part of a point that follows from its ray from the eye and its distance: position and distance, direction to the eye, depth.
fn on_ray(parameters: &FrameParameters, ray: &Ray, distance: f32, normal: Vec3) -> (Vec4, Vec3, f32) {
    let forward = Vec4::from(parameters.forward).truncate();
    let position = offset_origin(ray.origin + distance * ray.direction, normal, parameters.eye[3]);
    (position.extend(distance), -ray.direction, ray.direction.dot(forward) * distance)
}

/// Whether it has more to tell than a plain point that hit a surface or nothing.
fn is_rich(point: &Point) -> bool {
    flags(point) & !PLAIN_FLAGS != 0
        || flags(point) & (ShadingPoints::SEEN_BY_SPECULAR | ShadingPoints::GLOSSY) != 0
        || point[EMITTED] != Vec4::ZERO
        || point[SPECULAR].truncate() != Vec3::ZERO
        || point[F0].truncate() != Vec3::ZERO
        || point[SHADING].truncate() != point[GEOMETRIC].truncate()
}

/// Whether place and path of a point do not follow from its pixel's ray within the bounds.
fn is_off_ray(parameters: &FrameParameters, point: &Point, pixel: u32) -> bool {
    let code = encode_normal(point[GEOMETRIC].truncate());
    let normal = decode_normal([code as u16, (code >> 16) as u16]);
    let ray = camera_rays::reference(parameters, pixel);
    let distance = decode_depth(encode_depth(point[POSITION].w));
    let (position, wo, depth) = on_ray(parameters, &ray, distance, normal);
    let hit = flags(point) & ShadingPoints::HIT != 0;
    let apart = (position - point[POSITION]).truncate().abs().max_element();
    let [found, exact] = [depth, point[THROUGHPUT].w];
    let there =
        !hit || apart <= POSITION_ERROR * parameters.eye[3] && (found - exact).abs() <= DEPTH_ERROR * exact.abs();
    let from_eye = (wo - point[WO].truncate()).length() <= NORMAL_ERROR;
    !(there && from_eye && point[THROUGHPUT].truncate() == Vec3::ONE)
}

/// Points in columns, as they are sent.
pub(super) struct Columns {
    pub(super) parameters: FrameParameters,
    pub(super) steps: Steps,
    pub(super) flags: Vec<u8>,
    pub(super) kd: [Vec<u8>; 3],
    pub(super) normals: Normals,
    pub(super) distances: Vec<u32>,
    pub(super) light: [Colors; 2],
    // Of rich points.
    pub(super) high: Vec<u16>,
    pub(super) shading: Normals,
    pub(super) f0: [Vec<u8>; 3],
    /// f90, alpha, probability of the diffuse lobe, flags of the path.
    pub(super) words: [Vec<u32>; 4],
    pub(super) shown: [Colors; 2],
    // Of those off their ray.
    pub(super) wo: Normals,
    pub(super) depths: Vec<u32>,
    pub(super) places: [Vec<u32>; 3],
    pub(super) throughput: Colors,
    /// Hits of the pixels, array by array.
    pub(super) hits: Vec<Hits>,
    pub(super) more: More,
    /// The first of the second components.
    pub(super) second: Cursor,
}

/// Hits of the pixels in one array.
pub(super) struct Hits {
    pub(super) triangles: Vec<u32>,
    /// Codes of distances.
    pub(super) distances: Vec<u32>,
}

impl Hits {
    /// That of a pixel, as the device has it.
    pub(super) fn at(&self, i: usize) -> [u32; 2] {
        [self.triangles[i], decode_depth(self.distances[i]).to_bits()]
    }
}

/// A point of some columns: its number among all, among the rich, and among those off their ray.
#[derive(Clone, Copy, Default)]
pub(super) struct Cursor {
    pub(super) next: usize,
    rich: usize,
    off_ray: usize,
    /// The latest normal with its code: the next point often has the same.
    normal: ([u16; 2], Vec3),
}

impl Cursor {
    /// At a point that only its number tells.
    pub(super) fn at(next: usize) -> Cursor {
        Cursor { next, ..Cursor::default() }
    }
}

fn three<T>(mut get: impl FnMut() -> Option<T>) -> Option<[T; 3]> {
    Some([get()?, get()?, get()?])
}

impl Columns {
    /// Of a task, with its tiles. `None`: too few bytes, too many, or none of columns.
    fn get(mut bytes: &[u8], shape: &Shape, task: &Task) -> Option<(Vec<u32>, Columns)> {
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
        let (size, within) = ([shape.size[0], shape.size[1], 0, 0], rows[6]);
        let parameters =
            FrameParameters { eye, right, up, forward, pixel_offset, shift, size, within, ..Default::default() };
        let tiles = get::<u32, 4>(bytes, tile_count)?;
        let [pixels, second] = shape.counts(task, &Listed::new(shape, &tiles));
        let count = pixels + second;

        let flags = get::<u8, 1>(bytes, count)?;
        let kd = three(|| get::<_, 1>(bytes, count))?;
        let (normals, distances) = (Normals::get(bytes, count)?, get::<_, 4>(bytes, count)?);
        let light = [Colors::get(bytes, count)?, Colors::get(bytes, count)?];

        let is_rich = |&&flags: &&u8| u32::from(flags) & RICH != 0;
        let (rich, rich_pixels) =
            (flags.iter().filter(is_rich).count(), flags[..pixels].iter().filter(is_rich).count());
        let high = get::<u16, 2>(bytes, rich)?;
        let shading = Normals::get(bytes, rich)?;
        let f0 = three(|| get::<_, 1>(bytes, rich))?;
        let mut words = || get::<_, 4>(bytes, rich);
        let words = [words()?, words()?, words()?, words()?];
        let shown = [Colors::get(bytes, rich)?, Colors::get(bytes, rich)?];

        let is_off_ray = |&&high: &&u16| u32::from(high) & OFF_RAY != 0;
        let off_ray = high.iter().filter(is_off_ray).count();
        let off_ray_pixels = high[..rich_pixels].iter().filter(is_off_ray).count();
        let wo = Normals::get(bytes, off_ray)?;
        let depths = get::<_, 4>(bytes, off_ray)?;
        let places = three(|| get::<_, 3>(bytes, off_ray))?;
        let throughput = Colors::get(bytes, off_ray)?;

        let mut hits = Vec::with_capacity(shape.arrays[1]);
        for _ in 0..shape.arrays[1] {
            let (triangles, is_other) = (get::<u32, 4>(bytes, pixels)?, get::<u8, 1>(bytes, pixels)?);
            let other = || is_other.iter().enumerate().filter(|(_, is_other)| **is_other != 0).map(|(i, _)| i);
            let codes = get::<u32, 4>(bytes, other().count())?;
            let mut own = distances[..pixels].to_vec();
            other().zip(codes).for_each(|(i, code)| own[i] = code);
            hits.push(Hits { triangles, distances: own });
        }
        let more = More::get(bytes, shape, pixels)?;
        let steps = Steps::of(parameters.eye[3]);
        let second = Cursor { next: pixels, rich: rich_pixels, off_ray: off_ray_pixels, ..Cursor::default() };
        let columns = Columns {
            parameters,
            steps,
            flags,
            kd,
            normals,
            distances,
            light,
            high,
            shading,
            f0,
            words,
            shown,
            wo,
            depths,
            places,
            throughput,
            hits,
            more,
            second,
        };
        bytes.is_empty().then_some((tiles, columns))
    }

    /// Of bytes that [`TaskPoints::pack`] made, with their tiles, or points that were sent as they are. Errors: as for [`TaskPoints::unpack`].
    pub(super) fn unpack(task: Task, shape: &Shape, bytes: &[u8]) -> Result<Packed> {
        let (form, packed) = bytes.split_first().ok_or_else(strange)?;
        task.region.check(shape.size)?;
        let options = DeflateOptions::default().set_limit(512 * shape.pixels() + 4096).set_size_hint(8 * packed.len());
        let bytes = DeflateDecoder::new_with_options(packed, options).decode_zlib().map_err(|_| strange())?;
        match *form {
            EXACT => Ok(Packed::Exact(TaskPoints::from_bytes(task, &bytes)?)),
            PACKED => {
                let (tiles, columns) = Columns::get(&bytes, shape, &task).ok_or_else(strange)?;
                Ok(Packed::Columns(tiles, Box::new(columns)))
            }
            _ => Err(strange()),
        }
    }

    /// Whether a point is plain: [`ZERO_IF_PLAIN`].
    pub(super) fn is_plain(&self, cursor: &Cursor) -> bool {
        u32::from(self.flags[cursor.next]) & RICH == 0
    }

    /// Passes on the point at a cursor, which goes on to the next one, array by array; of a plain one not the arrays [`ZERO_IF_PLAIN`].
    /// `ray`: of its pixel.
    pub(super) fn put_next(&self, cursor: &mut Cursor, ray: impl FnOnce() -> Ray, mut put: impl FnMut(usize, Vec4)) {
        let i = cursor.next;
        cursor.next += 1;
        let (flags, distance, code) = (u32::from(self.flags[i]), decode_depth(self.distances[i]), self.normals.code(i));
        // No normal is 0: the first one is decoded.
        if cursor.normal.1 == Vec3::ZERO || cursor.normal.0 != code {
            cursor.normal = (code, decode_normal(code));
        }
        let normal = cursor.normal.1;
        let kd = Vec3::from_array(self.kd.each_ref().map(|axis| share(axis[i])));
        put(DIRECT, self.light[0].at(i).extend(0.0));
        put(INDIRECT, self.light[1].at(i).extend(0.0));
        if flags & RICH == 0 {
            put(KD, kd.extend(1.0));
            put(GEOMETRIC, normal.extend(0.0));
            put(SHADING, normal.extend(0.0));
            self.put_on_ray(flags, &ray(), (distance, normal), put);
            return;
        }
        let k = cursor.rich;
        cursor.rich += 1;
        let high = u32::from(self.high[k]);
        let [f90, alpha, diffuse, of_path] = self.words.each_ref().map(|words| f32::from_bits(words[k]));
        put(GEOMETRIC, normal.extend(f90));
        put(SHADING, self.shading.at(k).extend(alpha));
        put(KD, kd.extend(diffuse));
        put(F0, Vec3::from_array(self.f0.each_ref().map(|axis| share(axis[k]))).extend(0.0));
        put(EMITTED, self.shown[0].at(k).extend(of_path));
        put(SPECULAR, self.shown[1].at(k).extend(0.0));
        let flags = flags & PLAIN_FLAGS | (high & !OFF_RAY) << 7;
        if high & OFF_RAY == 0 {
            self.put_on_ray(flags, &ray(), (distance, normal), put);
            return;
        }
        let m = cursor.off_ray;
        cursor.off_ray += 1;
        let place = Vec3::from_array(self.places.each_ref().map(|axis| self.steps.decode(axis[m])));
        put(POSITION, place.extend(distance));
        put(WO, self.wo.at(m).extend(ShadingPoints::word(flags)));
        put(THROUGHPUT, self.throughput.at(m).extend(decode_depth(self.depths[m])));
    }

    fn put_on_ray(&self, flags: u32, ray: &Ray, (distance, normal): (f32, Vec3), mut put: impl FnMut(usize, Vec4)) {
        let (position, wo, depth) = on_ray(&self.parameters, ray, distance, normal);
        put(POSITION, position);
        put(WO, wo.extend(ShadingPoints::word(flags)));
        put(THROUGHPUT, Vec3::ONE.extend(depth));
    }

    /// The point at a cursor, as [`Columns::put_next`] tells it.
    fn next(&self, cursor: &mut Cursor, ray: impl FnOnce() -> Ray) -> Point {
        let mut point = [Vec4::ZERO; ARRAYS];
        self.put_next(cursor, ray, |array, value| point[array] = value);
        point
    }
}

/// Points as they come in.
pub(super) enum Packed {
    Exact(TaskPoints),
    /// With their tiles.
    Columns(Vec<u32>, Box<Columns>),
}

impl TaskPoints {
    /// The points in few bytes; `parameters`: those of their pass.
    pub fn pack(&self, shape: &Shape, parameters: &FrameParameters) -> Vec<u8> {
        let (form, bytes) = match self.columns(shape, parameters) {
            Some(columns) => (PACKED, columns),
            None => (EXACT, self.to_bytes()),
        };
        let mut encoder = ZlibEncoder::new(vec![form], Compression::default());
        // Memory takes all bytes.
        encoder.write_all(&bytes).and_then(|()| encoder.finish()).unwrap_or_default()
    }

    /// The points of a task from [`TaskPoints::pack`]. Errors: the bytes are cut off or damaged, or of another task.
    pub fn unpack(task: Task, shape: &Shape, bytes: &[u8]) -> Result<TaskPoints> {
        let (tiles, columns) = match Columns::unpack(task, shape, bytes)? {
            Packed::Exact(points) => return Ok(points),
            Packed::Columns(tiles, columns) => (tiles, columns),
        };
        let slots = shape.slots(&task, &Listed::new(shape, &tiles));
        let mut values = vec![[0; 4]; slots.len() * ARRAYS];
        let mut cursor = Cursor::default();
        for (i, &slot) in slots.iter().enumerate() {
            let point = columns.next(&mut cursor, || camera_rays::reference(&columns.parameters, slot as u32));
            let words = point.iter().map(|value| value.to_array().map(f32::to_bits));
            words.enumerate().for_each(|(array, words)| values[array * slots.len() + i] = words);
        }
        let pixels = columns.second.next;
        let hits = columns.hits.iter().flat_map(|hits| (0..pixels).map(|i| hits.at(i))).collect();
        Ok(TaskPoints { task, tiles, values, hits, more: columns.more.all(shape, pixels) })
    }

    /// A point by its place among the slots.
    fn point(&self, i: usize, slots: usize) -> Point {
        std::array::from_fn(|array| Vec4::from_array(self.values[array * slots + i].map(f32::from_bits)))
    }

    /// `None`: some value is no number, some reflectance no part of 1, or some position far outside.
    fn columns(&self, shape: &Shape, parameters: &FrameParameters) -> Option<Vec<u8>> {
        let listed = Listed::new(shape, &self.tiles);
        let (slots, [pixels, _]) = (shape.slots(&self.task, &listed), shape.counts(&self.task, &listed));
        let mut points: Vec<Point> = (0..slots.len()).map(|i| self.point(i, slots.len())).collect();
        for point in &mut points {
            if flags(point) & ShadingPoints::LIT == 0 {
                // Nothing wrote them.
                [DIRECT, INDIRECT, SPECULAR].into_iter().for_each(|array| point[array] = Vec4::ZERO);
            }
            if flags(point) & ShadingPoints::HIT == 0 {
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
        put::<4>(&mut out, &self.tiles);

        // Second components are always told in full.
        let is_off = |i: usize| i >= pixels || is_off_ray(parameters, &points[i], slots[i] as u32);
        let off_ray: Vec<bool> = (0..slots.len()).map(is_off).collect();
        let rich: Vec<bool> = points.iter().zip(&off_ray).map(|(point, &off_ray)| off_ray || is_rich(point)).collect();
        let of = |points: &[Point], word: &dyn Fn(&Point) -> u32| -> Vec<u32> { points.iter().map(word).collect() };
        let shares = |out: &mut Vec<u8>, points: &[Point], array: usize| {
            (0..3).for_each(|axis| put::<1>(out, &of(points, &|point| byte(point[array][axis]))));
        };
        let directions = |out: &mut Vec<u8>, points: &[Point], array: usize| {
            put_normals(out, &of(points, &|point| encode_normal(point[array].truncate())));
        };
        let colors = |out: &mut Vec<u8>, points: &[Point], array: usize| {
            put_colors(out, &points.iter().map(|point| point[array].truncate()).collect::<Vec<_>>());
        };
        let marked = points.iter().zip(&rich).map(|(p, &rich)| flags(p) & PLAIN_FLAGS | if rich { RICH } else { 0 });
        put::<1>(&mut out, &marked.collect::<Vec<_>>());
        shares(&mut out, &points, KD);
        directions(&mut out, &points, GEOMETRIC);
        put::<4>(&mut out, &of(&points, &|point| encode_depth(point[POSITION].w)));
        [DIRECT, INDIRECT].into_iter().for_each(|array| colors(&mut out, &points, array));

        let chosen = |which: &[bool]| -> Vec<Point> {
            points.iter().zip(which).filter(|(_, which)| **which).map(|(point, _)| *point).collect()
        };
        let more = chosen(&rich);
        let marks = off_ray.iter().zip(&rich).filter(|(_, rich)| **rich);
        let marks = marks.map(|(&off_ray, _)| if off_ray { OFF_RAY } else { 0 });
        put::<2>(&mut out, &more.iter().zip(marks).map(|(point, mark)| flags(point) >> 7 | mark).collect::<Vec<_>>());
        directions(&mut out, &more, SHADING);
        shares(&mut out, &more, F0);
        [GEOMETRIC, SHADING, KD, EMITTED]
            .into_iter()
            .for_each(|array| put::<4>(&mut out, &of(&more, &|point| point[array].w.to_bits())));
        [EMITTED, SPECULAR].into_iter().for_each(|array| colors(&mut out, &more, array));

        let off_ray = chosen(&off_ray);
        let steps = Steps::of(parameters.eye[3]);
        directions(&mut out, &off_ray, WO);
        put::<4>(&mut out, &of(&off_ray, &|point| encode_depth(point[THROUGHPUT].w)));
        for axis in 0..3 {
            let places: Option<Vec<u32>> = off_ray.iter().map(|point| steps.encode(point[POSITION][axis])).collect();
            put::<3>(&mut out, &places?);
        }
        colors(&mut out, &off_ray, THROUGHPUT);
        for hits in self.hits.chunks(pixels.max(1)) {
            put::<4>(&mut out, &hits.iter().map(|hit| hit[0]).collect::<Vec<_>>());
            // Those of points on their rays are those of the points.
            let codes = hits.iter().map(|hit| encode_depth(f32::from_bits(hit[1])));
            let codes: Vec<(u32, bool)> =
                codes.zip(&points).map(|(code, point)| (code, code != encode_depth(point[POSITION].w))).collect();
            put::<1>(&mut out, &codes.iter().map(|(_, is_other)| u32::from(*is_other)).collect::<Vec<_>>());
            put::<4>(
                &mut out,
                &codes.iter().filter(|(_, is_other)| *is_other).map(|(code, _)| *code).collect::<Vec<_>>(),
            );
        }
        put_more(&mut out, shape, &self.more, pixels);
        Some(out)
    }
}
