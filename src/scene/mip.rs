//! Levels of textures: each has half the width and height of the one before, down to a single texel.
//!
//! A texel of a level is the mean of the area that it covers on the level before, in linear light: a box filter, with parts of texels
//! where a width or height is odd. So all levels have one mean. Normal maps are averaged alike; the mean of unit vectors is shorter
//! than one, and whoever reads it normalises it: bumps that are smaller than a texel of the level are flat there.

use std::sync::{Arc, LazyLock, OnceLock};

use fast_srgb8::f32_to_srgb8;
use glam::Vec4;
use rayon::prelude::*;

use super::texture::srgb_to_linear;
use super::{Scene, Texture};

/// Width and height of level `level` of a texture of level 0's `size`, or `None` beyond the last.
pub fn size_of_level(size: [u32; 2], level: u32) -> Option<[u32; 2]> {
    let most = size[0].max(size[1]);
    (most.checked_shr(level)? > 0).then(|| size.map(|n| (n >> level).max(1)))
}

/// Number of levels of a texture, at least 1 if it has texels.
pub fn level_count(size: [u32; 2]) -> u32 {
    u32::BITS - size[0].max(size[1]).leading_zeros()
}

/// A level above 0, in linear light. Each texel is a weight times colour, and the weight.
struct Level {
    size: [u32; 2],
    texels: Vec<Vec4>,
}

/// Weight of the colour of a transparent texel, where colours are weighted by alpha: so that a level has a colour where all is
/// transparent.
const TRANSPARENT: f32 = 1.0 / 1024.0;

/// The levels of a texture after level 0, texel by texel as they are stored.
pub struct Levels<'a> {
    texture: &'a Texture,
    by_alpha: bool,
    last: Option<Level>,
}

impl Texture {
    /// Its levels after the texture itself. `by_alpha`: texels count by their alpha, for surfaces that stop only so many rays.
    pub fn levels(&self, by_alpha: bool) -> Levels<'_> {
        Levels { texture: self, by_alpha, last: None }
    }
}

impl Scene {
    /// Whether colours of a texture count by their alpha where they are averaged: it is the base colour of surfaces that let rays
    /// pass.
    pub fn counts_by_alpha(&self, texture: u32) -> bool {
        self.materials.iter().any(|m| m.base_texture == Some(texture) && m.has_alpha())
    }
}

/// The levels of a scene's textures, each texture's made when first looked up.
#[derive(Debug, Default)]
pub struct KeptLevels(Vec<OnceLock<Vec<Texture>>>);

impl Scene {
    /// Keeps the levels of textures from the first look-up on the host on: a third of a texture's memory. From then on, textures and
    /// which materials use them must stay as they are, until this is called again.
    pub fn keep_levels(&mut self) {
        let none = self.textures.iter().map(|_| OnceLock::new()).collect();
        self.levels = Some(Arc::new(KeptLevels(none)));
    }

    /// Looks a texture up on a level, 1 to the last.
    pub(crate) fn with_level<T>(&self, texture: u32, level: u32, look_up: impl FnOnce(&Texture) -> T) -> T {
        let of = &self.textures[texture as usize];
        let levels = || of.levels(self.counts_by_alpha(texture)).map(|(size, texels)| of.with_texels(size, texels));
        let index = level as usize - 1;
        match self.levels.as_ref().and_then(|kept| kept.0.get(texture as usize)) {
            Some(kept) => look_up(&kept.get_or_init(|| levels().collect())[index]),
            None => look_up(&levels().nth(index).unwrap_or_else(|| of.clone())),
        }
    }
}

impl Texture {
    fn with_texels(&self, [width, height]: [u32; 2], texels: Vec<[u8; 4]>) -> Texture {
        Texture { name: String::new(), width, height, texels, srgb: self.srgb, wrap: self.wrap }
    }
}

impl Iterator for Levels<'_> {
    /// Width and height; texels.
    type Item = ([u32; 2], Vec<[u8; 4]>);

    fn next(&mut self) -> Option<Self::Item> {
        let texture = self.texture;
        let decode = Decode::of(texture, self.by_alpha);
        let level = match &self.last {
            None => halved([texture.width, texture.height], |i| decode.decode(texture.texels[i]))?,
            Some(level) => halved(level.size, |i| level.texels[i])?,
        };
        let texels = level.texels.par_iter().map(|&v| decode.encode(v)).collect();
        let size = level.size;
        self.last = Some(level);
        Some((size, texels))
    }
}

/// How texels are stored.
#[derive(Clone, Copy)]
struct Decode {
    srgb: bool,
    by_alpha: bool,
}

impl Decode {
    fn of(texture: &Texture, by_alpha: bool) -> Decode {
        Decode { srgb: texture.srgb, by_alpha }
    }

    /// Weight times colour, and a number that alpha follows from: the weight, or alpha itself where all texels count alike.
    fn decode(self, [r, g, b, a]: [u8; 4]) -> Vec4 {
        static LINEAR: LazyLock<[f32; 256]> =
            LazyLock::new(|| std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0)));
        let channel = |c: u8| if self.srgb { LINEAR[usize::from(c)] } else { f32::from(c) / 255.0 };
        let color = Vec4::new(channel(r), channel(g), channel(b), 0.0);
        let alpha = f32::from(a) / 255.0;
        if self.by_alpha {
            let weight = alpha + TRANSPARENT;
            (color * weight).with_w(weight)
        } else {
            color.with_w(alpha)
        }
    }

    fn encode(self, v: Vec4) -> [u8; 4] {
        let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
        let (color, alpha) = if self.by_alpha { (v / v.w, v.w - TRANSPARENT) } else { (v, v.w) };
        let channel = |c: f32| if self.srgb { f32_to_srgb8(c) } else { byte(c) };
        [channel(color.x), channel(color.y), channel(color.z), byte(alpha)]
    }
}

/// The level after one of this size; `None` after the last.
fn halved(size: [u32; 2], texel: impl Fn(usize) -> Vec4 + Sync) -> Option<Level> {
    let [width, height] = size_of_level(size, 1)?;
    let (columns, rows) = (spans(size[0], width), spans(size[1], height));
    let row_of = |y: usize| {
        let (rows, texel) = (&rows[y], &texel);
        columns.iter().map(move |column| {
            let mut sum = Vec4::ZERO;
            for (y, down) in (rows.first..).zip(rows.weights) {
                for (x, across) in (column.first..).zip(column.weights) {
                    if down * across > 0.0 {
                        sum += texel(y * size[0] as usize + x) * (down * across);
                    }
                }
            }
            sum
        })
    };
    let mut texels = vec![Vec4::ZERO; width as usize * height as usize];
    texels.par_chunks_mut(width as usize).enumerate().for_each(|(y, row)| {
        row.iter_mut().zip(row_of(y)).for_each(|(texel, mean)| *texel = mean);
    });
    Some(Level { size: [width, height], texels })
}

/// Texels of the level before that a texel covers along one axis.
struct Span {
    first: usize,
    /// Shares of the texel, with sum 1.
    weights: [f32; 3],
}

/// The spans of `to` texels over `from`, which is 2 `to`, 2 `to` + 1, or 1.
fn spans(from: u32, to: u32) -> Vec<Span> {
    let span = |i: u32| {
        // Places in units of 1 / to of a texel.
        let (from, to) = (u64::from(from), u64::from(to));
        let (start, end) = (u64::from(i) * from, (u64::from(i) + 1) * from);
        let first = start / to;
        let covered = |k: u64| end.min((first + k + 1) * to).saturating_sub(start.max((first + k) * to));
        Span { first: first as usize, weights: [0, 1, 2].map(|k| covered(k) as f32 / from as f32) }
    };
    (0..to).map(span).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Wrap;

    fn texture(width: u32, height: u32, srgb: bool) -> Texture {
        let byte = |i: u32, k: u32| (crate::sampling::random::hash(4 * i + k) >> 24) as u8;
        let texels = (0..width * height).map(|i| [0, 1, 2, 3].map(|k| byte(i, k))).collect();
        Texture { name: String::from("noise"), width, height, texels, srgb, wrap: [Wrap::Repeat; 2] }
    }

    #[test]
    fn levels_end_at_one_texel() {
        for (size, count) in [([1, 1], 1), ([2, 1], 2), ([27, 3], 5), ([4096, 4096], 13), ([1, 31], 5), ([5, 7], 3)] {
            assert_eq!(level_count(size), count, "{size:?}");
            assert!(size_of_level(size, count).is_none() && size_of_level(size, 40).is_none());
            assert_eq!(size_of_level(size, count - 1), Some([1, 1]));
        }
        for (width, height) in [(1, 1), (27, 3), (13, 17), (64, 2)] {
            let sizes: Vec<_> = texture(width, height, true).levels(false).map(|(size, _)| size).collect();
            let expected = (1..level_count([width, height])).map(|i| size_of_level([width, height], i).unwrap());
            assert_eq!(sizes, expected.collect::<Vec<_>>());
        }
    }

    #[test]
    fn all_levels_have_the_mean_of_the_texture() {
        for (width, height, srgb) in [(27, 3, false), (13, 17, true), (64, 32, true), (1, 31, false), (97, 101, true)] {
            let whole = texture(width, height, srgb);
            for (level, (size, texels)) in (1..).zip(whole.levels(false)) {
                let coarse = Texture { width: size[0], height: size[1], texels, ..whole.clone() };
                let off = (coarse.average() - whole.average()).abs().max_element();
                // Half a step of the encoding, which is widest near white, and less where many texels are averaged.
                let bound = if srgb { 5e-3 } else { 2.1e-3 };
                assert!(off < bound, "{width}x{height}, level {level}: {off}");
                assert_eq!(coarse.texels.len(), (size[0] * size[1]) as usize);
            }
        }
    }

    #[test]
    fn an_odd_width_is_halved_by_area() {
        let row = |bytes: &[u8]| {
            let texels: Vec<_> = bytes.iter().map(|&b| [b, b, b, 255]).collect();
            Texture { texels, ..texture(bytes.len() as u32, 1, false) }
        };
        // Two texels of 2.5: 100, 200 and half of 40; the other half, 60 and 250.
        let five = row(&[100, 200, 40, 60, 250]);
        let (size, texels) = five.levels(false).next().unwrap();
        assert_eq!(size, [2, 1]);
        assert_eq!(texels.iter().map(|t| t[0]).collect::<Vec<_>>(), [128, 132]);
    }

    #[test]
    fn light_is_averaged_and_not_its_code() {
        let checks = Texture { texels: vec![[0, 0, 0, 255], [255; 4]], ..texture(2, 1, true) };
        assert_eq!(checks.levels(false).next().unwrap().1, [[188, 188, 188, 255]]);
    }

    #[test]
    fn kept_levels_are_those_made_anew() {
        let mut scene = Scene { textures: vec![texture(27, 3, true), texture(64, 32, false)], ..Scene::default() };
        let look_up = |scene: &Scene| {
            (0..2)
                .flat_map(|index| (1..=4).map(move |level| (index, level)))
                .map(|(index, level)| scene.with_level(index, level, Texture::clone))
                .collect::<Vec<_>>()
        };
        let anew = look_up(&scene);
        scene.keep_levels();
        assert!(look_up(&scene) == anew && look_up(&scene) == anew);
        assert_eq!((anew[0].width, anew[7].height), (13, 2));
    }

    #[test]
    fn transparent_texels_do_not_bleed() {
        let texels = vec![[255, 0, 0, 255], [0, 255, 0, 0]];
        let leaf = Texture { texels, ..texture(2, 1, false) };
        let [r, g, _, a] = leaf.levels(true).next().unwrap().1[0];
        assert!(r >= 254 && g <= 1 && a == 128, "{r} {g} {a}");
        assert_eq!(leaf.levels(false).next().unwrap().1[0], [128, 128, 0, 128]);
        let clear = Texture { texels: vec![[200, 100, 50, 0]; 2], ..texture(2, 1, false) };
        assert_eq!(clear.levels(true).next().unwrap().1[0], [200, 100, 50, 0]);
    }
}
