//! Emitters with a texture: L(x) = factor times the texture at x.
//!
//! Points on an emitter are uniform over its area, and a particle that starts at x carries the flux of L(x). Its share of all
//! particles follows from the mean of L, an integral over the emitter by midpoints no more than half a texel apart (farther apart only where
//! there are too many). An uneven emitter is divided by quarters into parts, each chosen in proportion to its own mean, so that few
//! particles carry more or less than the mean of their part. A part is left out only if none of its texels emits: the sum over particles
//! is unbiased whatever the means are.

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::{Emitter, Emitters, Kind, NO_EMITTER};
use crate::bsdf::{mean, sample_texture};
use crate::scene::{Scene, Texture, TextureUse, Triangle};

/// An emitter is divided if its texture exceeds its mean by this factor.
const UNEVEN: f32 = 2.0;

/// Parts of all emitters of a scene, about.
const PARTS: f64 = 4096.0;

/// Most divisions of one emitter, each into four.
const MAX_LEVELS: u32 = 5;

/// A part is at least as wide in texels.
const MIN_TEXELS: f32 = 4.0;

/// Midpoints of all emitters of a scene, about.
const MIDPOINTS: f64 = (1 << 24) as f64;

/// Texels of the box around a part that are asked whether any emits; of a larger box some are taken to.
const BOX_TEXELS: f64 = 65_536.0;

/// Mean of a part whose midpoints are black although some of its texels emit, as a share of the texture's mean.
const LEAST_MEAN: f32 = 1e-3;

/// The texture of a triangle or quad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pattern {
    /// Index of the texture.
    pub texture: u32,
    /// Texture coordinates of the first corner, and their change along both edges.
    pub uvs: [Vec2; 3],
    /// Radiance where the texture is white.
    pub factor: Vec3,
}

impl Pattern {
    fn uv(&self, [a, b]: [f32; 2]) -> Vec2 {
        self.uvs[0] + self.uvs[1] * a + self.uvs[2] * b
    }

    /// Radiance at coordinates along both edges.
    pub fn radiance(&self, textures: &[Texture], place: [f32; 2]) -> Vec3 {
        self.factor * sample_texture(&textures[self.texture as usize], self.uv(place).to_array()).truncate()
    }
}

/// The parts of a divided emitter.
#[derive(Clone, Debug)]
pub struct Parts {
    kind: Kind,
    corner: DVec3,
    /// Vectors whose products with a point relative to the corner are its coordinates along the edges.
    across: [DVec3; 2],
    levels: u32,
    /// Emitter of each part, in the order of quarters of quarters; [`NO_EMITTER`] where it is black.
    pub cells: Vec<u32>,
}

impl Parts {
    /// Emitter of the part at a position.
    pub fn at(&self, position: Vec3) -> u32 {
        let d = position.as_dvec3() - self.corner;
        let mut place = self.across.map(|v| v.dot(d) as f32);
        let mut cell = 0;
        for _ in 0..self.levels {
            let (quarter, within) = quarter_at(self.kind, place);
            (cell, place) = (4 * cell + quarter, within);
        }
        self.cells[cell]
    }
}

/// The quarter of a triangle or quad at coordinates along its edges, and the coordinates within it.
fn quarter_at(kind: Kind, [a, b]: [f32; 2]) -> (usize, [f32; 2]) {
    let upper = |x: f32| usize::from(x >= 0.5);
    match kind {
        Kind::Quad => (upper(a) + 2 * upper(b), [2.0 * a - upper(a) as f32, 2.0 * b - upper(b) as f32]),
        _ if a >= 0.5 => (1, [2.0 * a - 1.0, 2.0 * b]),
        _ if b >= 0.5 => (2, [2.0 * a, 2.0 * b - 1.0]),
        _ if a + b <= 0.5 => (0, [2.0 * a, 2.0 * b]),
        _ => (3, [1.0 - 2.0 * a, 1.0 - 2.0 * b]),
    }
}

/// Corner and sign of the edges of a quarter, in halves of the edges of the whole.
fn quarter(kind: Kind, k: usize) -> ([f32; 2], f32) {
    match (kind, k) {
        (Kind::Quad, _) => ([(k % 2) as f32, (k / 2) as f32], 1.0),
        (_, 1) => ([1.0, 0.0], 1.0),
        (_, 2) => ([0.0, 1.0], 1.0),
        (_, 3) => ([1.0, 1.0], -1.0),
        _ => ([0.0, 0.0], 1.0),
    }
}

/// A part of an emitter after some divisions.
fn part(whole: &Emitter, levels: u32, cell: usize) -> Emitter {
    let mut e = *whole;
    for level in (0..levels).rev() {
        let ([a, b], sign) = quarter(e.kind, cell >> (2 * level) & 3);
        let (half_1, half_2) = (e.e1 * 0.5, e.e2 * 0.5);
        (e.p0, e.e1, e.e2) = (e.p0 + half_1 * a + half_2 * b, half_1 * sign, half_2 * sign);
        e.area *= 0.25;
        if let Some(pattern) = &mut e.pattern {
            let [uv, along_1, along_2] = pattern.uvs;
            let (half_1, half_2) = (along_1 * 0.5, along_2 * 0.5);
            pattern.uvs = [uv + half_1 * a + half_2 * b, half_1 * sign, half_2 * sign];
        }
    }
    e
}

/// Mean radiance of an emitter, and the largest mean of the channels.
#[derive(Clone, Copy)]
struct Measure {
    mean: Vec3,
    peak: f32,
}

/// Longest edge in texels.
fn extent(pattern: &Pattern, texture: &Texture) -> f32 {
    let size = Vec2::new(texture.width as f32, texture.height as f32);
    let [_, along_1, along_2] = pattern.uvs;
    [along_1, along_2, along_2 - along_1].map(|d| (d * size).abs().max_element()).into_iter().fold(0.0, f32::max)
}

/// Measures an emitter by at most about `limit` squared midpoints.
fn measure(kind: Kind, pattern: &Pattern, textures: &[Texture], limit: f32) -> Measure {
    let texture = &textures[pattern.texture as usize];
    let n = (2.0 * extent(pattern, texture)).ceil().clamp(2.0, limit) as u32;
    let (mut sum, mut peak) = (glam::DVec3::ZERO, 0.0f32);
    let mut add = |a: f32, b: f32| {
        let radiance = pattern.radiance(textures, [a / n as f32, b / n as f32]);
        sum += radiance.as_dvec3();
        peak = peak.max(mean(radiance));
    };
    for j in 0..n {
        let y = j as f32;
        if kind == Kind::Quad {
            (0..n).for_each(|i| add(i as f32 + 0.5, y + 0.5));
            continue;
        }
        let third = 1.0 / 3.0;
        (0..n - j).for_each(|i| add(i as f32 + third, y + third));
        (0..n - j - 1).for_each(|i| add(i as f32 + 2.0 * third, y + 2.0 * third));
    }
    let mut of = Measure { mean: (sum / f64::from(n * n)).as_vec3(), peak };
    if mean(of.mean) <= 0.0 && may_emit(kind, pattern, texture) {
        let least = LEAST_MEAN * pattern.factor * texture.average().max(Vec3::splat(f32::MIN_POSITIVE));
        of = Measure { mean: least, peak: of.peak.max(mean(least)) };
    }
    of
}

/// Whether some texel of the box around an emitter may emit.
fn may_emit(kind: Kind, pattern: &Pattern, texture: &Texture) -> bool {
    let size = Vec2::new(texture.width as f32, texture.height as f32);
    let far = if kind == Kind::Quad { [1.0, 1.0] } else { [0.0, 0.0] };
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], far].map(|place| pattern.uv(place) * size);
    let low = corners.into_iter().fold(Vec2::INFINITY, Vec2::min) - 1.5;
    let high = corners.into_iter().fold(Vec2::NEG_INFINITY, Vec2::max) + 1.5;
    let texels = (high - low).as_dvec2().ceil();
    if texels.x * texels.y > BOX_TEXELS {
        return texture.texels.iter().any(|t| t[..3] != [0; 3]);
    }
    let emits = |x: u32, y: u32| {
        let centre = (low.floor() + Vec2::new(x as f32, y as f32) + 0.5) / size;
        (pattern.factor * sample_texture(texture, centre.to_array()).truncate()).max_element() > 0.0
    };
    (0..=texels.y as u32).any(|y| (0..=texels.x as u32).any(|x| emits(x, y)))
}

impl Emitter {
    /// The same with this mean radiance.
    fn of_mean(self, radiance: Vec3) -> Emitter {
        Emitter { radiance, power: radiance * self.white_power(), ..self }
    }
}

/// Replaces emitters with a texture by their parts and leaves out black ones.
pub(super) fn divide(emitters: &mut Emitters, scene: &Scene) {
    let count = emitters.list.iter().filter(|e| e.pattern.is_some()).count();
    if count == 0 {
        return;
    }
    let limit = (MIDPOINTS / count as f64).sqrt().clamp(8.0, 256.0) as f32;
    let measured = |e: &Emitter, limit: f32| e.pattern.map(|p| measure(e.kind, &p, &scene.textures, limit));
    let measures: Vec<Option<Measure>> = emitters.list.par_iter().map(|e| measured(e, limit)).collect();
    let weight = |(e, m): (&Emitter, &Option<Measure>)| m.map_or(0.0, |m| f64::from(mean(m.mean) * e.area));
    let total: f64 = emitters.list.iter().zip(&measures).map(weight).sum();

    let old = std::mem::take(&mut emitters.list);
    let mut index_of = Vec::with_capacity(old.len());
    for (e, whole) in old.iter().zip(&measures) {
        let first = emitters.list.len() as u32;
        let (Some(pattern), Some(whole)) = (e.pattern, *whole) else {
            index_of.push(first);
            emitters.list.push(*e);
            continue;
        };
        if mean(whole.mean) <= 0.0 {
            index_of.push(NO_EMITTER);
            continue;
        }
        let share = weight((e, &Some(whole))) / total;
        let most = (extent(&pattern, &scene.textures[pattern.texture as usize]) / MIN_TEXELS).max(1.0).log2();
        let wanted = 0.5 * (PARTS * share).max(1.0).log2();
        let levels = (wanted as f32).min(most).min(MAX_LEVELS as f32) as u32;
        index_of.push(first);
        if levels == 0 || whole.peak < UNEVEN * mean(whole.mean) {
            emitters.list.push(e.of_mean(whole.mean));
            continue;
        }
        let parts: Vec<Emitter> = (0..1usize << (2 * levels)).map(|cell| part(e, levels, cell)).collect();
        let fine = (limit / (1u32 << levels) as f32).max(8.0);
        let means: Vec<Vec3> =
            parts.par_iter().map(|e| measured(e, fine).map_or(Vec3::ZERO, |measure| measure.mean)).collect();
        let mut cells = Vec::with_capacity(parts.len());
        for (e, radiance) in parts.into_iter().zip(means) {
            let bright = mean(radiance) > 0.0;
            cells.push(if bright { emitters.list.len() as u32 } else { NO_EMITTER });
            if bright {
                emitters.list.push(e.of_mean(radiance));
            }
        }
        let (e1, e2) = (e.e1.as_dvec3(), e.e2.as_dvec3());
        let n = e1.cross(e2);
        let across = [e2.cross(n) / e1.dot(e2.cross(n)), n.cross(e1) / e2.dot(n.cross(e1))];
        emitters.parts.insert(first, Parts { kind: e.kind, corner: e.p0.as_dvec3(), across, levels, cells });
    }
    for index in &mut emitters.of_triangle {
        *index = index_of.get(*index as usize).copied().unwrap_or(NO_EMITTER);
    }
}

/// The texture of an emissive triangle whose emitter begins at this corner.
pub(super) fn of_face(scene: &Scene, triangle: &Triangle, corner: usize) -> Option<Pattern> {
    let material = &scene.materials[triangle.material as usize];
    let texture = material.emission_texture?;
    let uvs = scene.corner_uvs(triangle, TextureUse::Emission);
    let first = uvs[corner];
    let uvs = [first, uvs[(corner + 1) % 3] - first, uvs[(corner + 2) % 3] - first];
    Some(Pattern { texture, uvs, factor: material.emission })
}

/// Whether the texture of an emissive triangle goes on over its edge `k` into a neighbour, so that both form one quad. `apex`: corner of
/// the neighbour across from the edge.
pub(super) fn continue_over(scene: &Scene, triangle: &Triangle, neighbour: &Triangle, k: usize, apex: usize) -> bool {
    if scene.materials[triangle.material as usize].emission_texture.is_none() {
        return true;
    }
    let (own, other) =
        (scene.corner_uvs(triangle, TextureUse::Emission), scene.corner_uvs(neighbour, TextureUse::Emission));
    let (a, b, c) = (own[k], own[(k + 1) % 3], own[(k + 2) % 3]);
    let size = (a - c).abs().max_element().max((b - c).abs().max_element());
    let rounding = 1e-5 * size + 4.0 * f32::EPSILON * a.abs().max(b.abs()).max(c.abs()).max_element();
    let same = |p: Vec2, q: Vec2| (p - q).abs().max_element() <= rounding;
    same(other[(apex + 1) % 3], b) && same(other[(apex + 2) % 3], a) && same(other[apex], a + b - c)
}

#[cfg(test)]
mod tests;
