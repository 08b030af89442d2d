//! Columns of numbers in bytes that compress well, and what columns are made of: colours, normals, depths, positions in few bits.
//!
//! A column is a number that all its values equal, or what is left of each after a guess from those before it: that it equals the last one, or that it
//! differs from it as that from the one before. The guess is told for each column. The remainder is folded so that small numbers of both signs are small, and
//! its bytes lie apart: all lowest ones first.

use glam::Vec3;

/// How a column is told.
const CONSTANT: u8 = 0;
const DIFFERENCES: u8 = 1;
const SECOND_DIFFERENCES: u8 = 2;

/// The form in which a column keeps its values.
pub(super) trait Value: Copy + Into<u32> {
    /// The lowest bits of a word.
    fn of(word: u32) -> Self;
}

impl Value for u8 {
    fn of(word: u32) -> u8 {
        word as u8
    }
}

impl Value for u16 {
    fn of(word: u32) -> u16 {
        word as u16
    }
}

impl Value for u32 {
    fn of(word: u32) -> u32 {
        word
    }
}

/// Signed numbers of so many bits as unsigned ones, of which small ones have high bits 0.
fn folded(difference: u32, unused: u32) -> u32 {
    let difference = (difference << unused) as i32 >> unused;
    ((difference << 1) ^ (difference >> 31)) as u32
}

/// Appends a column of `WIDTH` bytes a value.
pub(super) fn put<const WIDTH: usize>(out: &mut Vec<u8>, values: &[u32]) {
    let Some(&first) = values.first() else { return };
    if values.iter().all(|&value| value == first) {
        out.push(CONSTANT);
        out.extend_from_slice(&first.to_le_bytes()[..WIDTH]);
        return;
    }
    let unused = 32 - 8 * WIDTH as u32;
    let left = |order: u8| -> Vec<u32> {
        let (mut before, mut last) = (0u32, 0u32);
        let next = |&value: &u32| {
            let difference = value.wrapping_sub(before);
            let guess = if order == SECOND_DIFFERENCES { last } else { 0 };
            (before, last) = (value, difference);
            folded(difference.wrapping_sub(guess), unused)
        };
        values.iter().map(next).collect()
    };
    let bits = |left: &[u32]| -> u64 { left.iter().map(|&left| u64::from(32 - left.leading_zeros())).sum() };
    let [first, second] = [left(DIFFERENCES), left(SECOND_DIFFERENCES)];
    let (order, left) = if bits(&second) < bits(&first) { (SECOND_DIFFERENCES, second) } else { (DIFFERENCES, first) };
    out.push(order);
    (0..WIDTH).for_each(|byte| out.extend(left.iter().map(|&left| (left >> (8 * byte)) as u8)));
}

/// The values of [`put`], of which there are so many. `None`: too few bytes, or none of its columns.
pub(super) fn get<T: Value, const WIDTH: usize>(bytes: &mut &[u8], count: usize) -> Option<Vec<T>> {
    if count == 0 {
        return Some(Vec::new());
    }
    let (&order, rest) = bytes.split_first()?;
    let mask = u32::MAX >> (32 - 8 * WIDTH);
    if order == CONSTANT {
        let (own, rest) = rest.split_first_chunk::<WIDTH>()?;
        *bytes = rest;
        let value = own.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte));
        return Some(vec![T::of(value); count]);
    }
    let (own, rest) = rest.split_at_checked(WIDTH * count)?;
    *bytes = rest;
    // All remainders are decoded first: none depends on another, so the processor takes several at once.
    let left = |folded: u32| T::of((folded >> 1) ^ (folded & 1).wrapping_neg());
    let byte = |byte: usize| own[byte * count..][..count].iter().map(|&byte| u32::from(byte));
    let mut values: Vec<T> = match WIDTH {
        1 => byte(0).map(left).collect(),
        2 => byte(0).zip(byte(1)).map(|(a, b)| left(a | b << 8)).collect(),
        3 => byte(0).zip(byte(1)).zip(byte(2)).map(|((a, b), c)| left(a | b << 8 | c << 16)).collect(),
        4 => {
            let all = byte(0).zip(byte(1)).zip(byte(2)).zip(byte(3));
            all.map(|(((a, b), c), d)| left(a | b << 8 | c << 16 | d << 24)).collect()
        }
        _ => return None,
    };
    let (mut value, mut difference) = (0u32, 0u32);
    match order {
        DIFFERENCES => {
            for left in &mut values {
                value = value.wrapping_add((*left).into());
                *left = T::of(value & mask);
            }
        }
        SECOND_DIFFERENCES => {
            for left in &mut values {
                difference = difference.wrapping_add((*left).into());
                value = value.wrapping_add(difference);
                *left = T::of(value & mask);
            }
        }
        _ => return None,
    }
    Some(values)
}

/// Exponent of a number above 0: that of the power of two at or below it.
fn exponent_of(value: f32) -> i32 {
    // In double precision no f32 is subnormal.
    (f64::from(value).to_bits() >> 52) as i32 - 1023
}

/// 2 to this power, which is that of a normal number.
fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((1023 + exponent) as u64) << 52)
}

/// Colours as three mantissas and an exponent that they share, as rgb9e5; `shift`: exponent of the largest value of all.
fn encode_color(color: Vec3, shift: i32) -> [u32; 4] {
    let largest = color.max_element();
    if largest <= 0.0 {
        return [0; 4];
    }
    // The exponent by which the largest mantissa rounds to less than 512.
    let mut exponent = (exponent_of(largest) + 1 - shift).max(-31);
    let parts = |exponent: i32| power_of_two(9 - exponent - shift);
    if (f64::from(largest) * parts(exponent)).round() >= 512.0 {
        exponent += 1;
    }
    let parts = parts(exponent);
    let mantissa = |value: f32| (f64::from(value.max(0.0)) * parts).round() as u32;
    [mantissa(color.x), mantissa(color.y), mantissa(color.z), (exponent + 31) as u32]
}

/// The exponent above all of these colours: mantissas may round up to the next one.
fn shift_of(colors: impl Iterator<Item = Vec3>) -> i32 {
    exponent_of(colors.map(Vec3::max_element).fold(f32::MIN_POSITIVE, f32::max)) + 2
}

/// Appends colours.
pub(super) fn put_colors(out: &mut Vec<u8>, colors: &[Vec3]) {
    let shift = shift_of(colors.iter().copied());
    out.extend(shift.to_le_bytes());
    let codes: Vec<[u32; 4]> = colors.iter().map(|&color| encode_color(color, shift)).collect();
    // Nine bits and five: the ninth bit of each goes with the exponent, so that there are four bytes.
    let column = |value: &dyn Fn(&[u32; 4]) -> u32| -> Vec<u32> { codes.iter().map(value).collect() };
    (0..3).for_each(|i| put::<1>(out, &column(&|code| code[i] & 255)));
    put::<1>(out, &column(&|code| code[3] | (code[0] >> 8) << 5 | (code[1] >> 8) << 6 | (code[2] >> 8) << 7));
}

/// Colours, from [`put_colors`].
pub(super) struct Colors {
    mantissas: [Vec<u8>; 3],
    rest: Vec<u8>,
    /// Exponent of the largest value of all.
    pub(super) shift: i32,
    /// 1 in the last place, by exponent.
    steps: [f64; 32],
}

impl Colors {
    /// `None`: too few bytes, or no colours.
    pub(super) fn get(bytes: &mut &[u8], count: usize) -> Option<Colors> {
        let (shift, rest) = bytes.split_first_chunk::<4>()?;
        *bytes = rest;
        let shift = Some(i32::from_le_bytes(*shift)).filter(|shift| shift.abs() < 256)?;
        let mantissas = [get::<_, 1>(bytes, count)?, get::<_, 1>(bytes, count)?, get::<_, 1>(bytes, count)?];
        let steps = std::array::from_fn(|exponent| power_of_two(exponent as i32 - 31 + shift - 9));
        Some(Colors { mantissas, rest: get::<_, 1>(bytes, count)?, shift, steps })
    }

    /// All codes: three mantissas, and ninth bits with an exponent above them.
    pub(super) fn codes(&self) -> impl Iterator<Item = u32> {
        let [r, g, b] = self.mantissas.each_ref().map(|mantissas| mantissas.iter().copied().map(u32::from));
        r.zip(g).zip(b).zip(&self.rest).map(|(((r, g), b), &rest)| r | g << 8 | b << 16 | u32::from(rest) << 24)
    }

    /// One of them.
    pub(super) fn at(&self, i: usize) -> Vec3 {
        let rest = u32::from(self.rest[i]);
        let step = self.steps[rest as usize & 31];
        let value = |axis: usize| {
            let mantissa = u32::from(self.mantissas[axis][i]) | (rest >> (5 + axis) & 1) << 8;
            (f64::from(mantissa) * step) as f32
        };
        Vec3::new(value(0), value(1), value(2))
    }
}

/// Unit vectors, from [`encode_normal`](crate::device_scene::encode_normal).
pub(super) fn decode_normal([x, y]: [u16; 2]) -> Vec3 {
    let [x, y] = [x, y].map(|half| f32::from(half as i16) / 32767.0);
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize()
}

/// Appends codes of [`encode_normal`](crate::device_scene::encode_normal).
pub(super) fn put_normals(out: &mut Vec<u8>, codes: &[u32]) {
    put::<2>(out, &codes.iter().map(|code| code & 0xffff).collect::<Vec<_>>());
    put::<2>(out, &codes.iter().map(|code| code >> 16).collect::<Vec<_>>());
}

/// Unit vectors, from [`put_normals`].
pub(super) struct Normals([Vec<u16>; 2]);

impl Normals {
    /// `None`: too few bytes, or no normals.
    pub(super) fn get(bytes: &mut &[u8], count: usize) -> Option<Normals> {
        Some(Normals([get::<_, 2>(bytes, count)?, get::<_, 2>(bytes, count)?]))
    }

    /// All codes, one half above the other.
    pub(super) fn codes(&self) -> impl Iterator<Item = u32> {
        self.0[0].iter().zip(&self.0[1]).map(|(&x, &y)| u32::from(x) | u32::from(y) << 16)
    }

    /// The code of one of them, for [`decode_normal`].
    pub(super) fn code(&self, i: usize) -> [u16; 2] {
        [self.0[0][i], self.0[1][i]]
    }

    /// One of them.
    pub(super) fn at(&self, i: usize) -> Vec3 {
        decode_normal(self.code(i))
    }
}

/// Parts of 1 in 8 bits.
pub(super) fn byte(share: f32) -> u32 {
    (share.clamp(0.0, 1.0) * 255.0).round() as u32
}

/// From [`byte`].
pub(super) fn share(byte: u8) -> f32 {
    f32::from(byte) / 255.0
}

/// Bits of a depth that are left out: its relative error is at most 2^-18.
const DEPTH_BITS: u32 = 6;

/// A depth, 0 or more, in 26 bits.
pub(super) fn encode_depth(depth: f32) -> u32 {
    depth.to_bits().saturating_add(1 << (DEPTH_BITS - 1)) >> DEPTH_BITS
}

/// From [`encode_depth`].
pub(super) fn decode_depth(code: u32) -> f32 {
    f32::from_bits(code << DEPTH_BITS)
}

/// Coordinates in 24 bits, in steps of 2^-16 to 2^-17 of a scale.
#[derive(Clone, Copy)]
pub(super) struct Steps(f64);

impl Steps {
    /// For a scale above 0.
    pub(super) fn of(scale: f32) -> Steps {
        Steps(power_of_two(exponent_of(scale.max(f32::MIN_POSITIVE)) - 16))
    }

    /// `None`: it is too large.
    pub(super) fn encode(self, value: f32) -> Option<u32> {
        let steps = (f64::from(value) / self.0).round();
        (steps.abs() < f64::from(1 << 23)).then_some(steps as i32 as u32 & 0x00ff_ffff)
    }

    /// Length of a step.
    pub(super) fn size(self) -> f32 {
        self.0 as f32
    }

    /// From [`Steps::encode`].
    pub(super) fn decode(self, code: u32) -> f32 {
        (f64::from((code << 8) as i32 >> 8) * self.0) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cluster::points::packing::NORMAL_ERROR;
    use crate::device_scene::encode_normal;
    use crate::sampling::random::{key, random_f32};

    fn random(i: u32, j: u32) -> f32 {
        random_f32(key(7, i, j, 3))
    }

    fn comes_back<T: Value, const WIDTH: usize>(values: &[u32], order: u8) {
        let mask = u32::MAX >> (32 - 8 * WIDTH);
        let values: Vec<u32> = values.iter().map(|value| value & mask).collect();
        let mut bytes = Vec::new();
        put::<WIDTH>(&mut bytes, &values);
        assert_eq!((bytes.len(), bytes[0]), (if order == CONSTANT { WIDTH } else { WIDTH * values.len() } + 1, order));
        let rest = &mut &bytes[..];
        let found: Vec<u32> = get::<T, WIDTH>(rest, values.len()).unwrap().into_iter().map(Into::into).collect();
        assert_eq!(found, values);
        assert!(rest.is_empty() && get::<T, WIDTH>(rest, 1).is_none());
        assert!(get::<T, WIDTH>(&mut &bytes[..bytes.len() - 1], values.len()).is_none());
        bytes[0] = 3;
        assert!(get::<T, WIDTH>(&mut &bytes[..], values.len()).is_none());
    }

    #[test]
    fn columns_come_back() {
        let scattered: Vec<u32> = (0..300).map(|i| key(1, i, 2, 3)).chain([0, u32::MAX, 0, 1, 1 << 31]).collect();
        let steep: Vec<u32> = (0..300).map(|i| 1000 + 7 * i).collect();
        for (values, order) in [(scattered, DIFFERENCES), (steep, SECOND_DIFFERENCES), (vec![0x8765_4321; 9], CONSTANT)]
        {
            comes_back::<u16, 2>(&values, order);
            comes_back::<u32, 3>(&values, order);
            comes_back::<u32, 4>(&values, order);
        }
        comes_back::<u8, 1>(&[255, 0, 1, 128, 127], DIFFERENCES);
        comes_back::<u8, 1>(&[7, 7], CONSTANT);
        assert_eq!(get::<u8, 1>(&mut &[][..], 0), Some(Vec::new()));
    }

    fn color(color: Vec3, others: &[Vec3]) -> Vec3 {
        let mut bytes = Vec::new();
        put_colors(&mut bytes, &[&[color], others].concat());
        Colors::get(&mut &bytes[..], 1 + others.len()).unwrap().at(0)
    }

    #[test]
    fn colors_err_by_at_most_their_bound_and_reach_it() {
        let mut worst = 0.0f32;
        for i in 0..20_000 {
            // Over 60 powers of two.
            let scale = (60.0 * random(i, 0) - 30.0).exp2();
            let exact = scale * Vec3::new(random(i, 1), random(i, 2), random(i, 3));
            let error = (color(exact, &[]) - exact).abs().max_element();
            worst = worst.max(error / exact.max_element());
        }
        let bound = (-9f32).exp2();
        assert!(worst <= bound && worst > 0.9 * bound, "{} of the bound", worst / bound);
        // Dark ones beside bright ones err by a part of these.
        let [bright, dark] = [Vec3::splat(1000.0), Vec3::new(1e-9, 2e-9, 0.0)];
        let error = (color(dark, &[bright]) - dark).abs().max_element();
        assert!(error <= 1000.0 * (-38f32).exp2(), "{error}");
        assert_eq!(color(Vec3::ZERO, &[bright]), Vec3::ZERO);
        // A mantissa that rounds up to the next power of two.
        assert_eq!(color(Vec3::new(0.999_99, 0.5, 0.0), &[]), Vec3::new(1.0, 0.5, 0.0));
        // The ends of the range.
        let end = Vec3::splat(f32::MIN_POSITIVE);
        assert_eq!(color(end, &[]), end);
        let end = Vec3::splat((126f32).exp2());
        assert_eq!(color(end, &[]), end);
    }

    #[test]
    fn normals_err_by_at_most_their_bound_and_come_near_it() {
        let mut worst = 0.0f32;
        for i in 0..20_000 {
            let z = 2.0 * random(i, 0) - 1.0;
            let (sin, cos) = (std::f32::consts::TAU * random(i, 1)).sin_cos();
            let normal = Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
            let mut bytes = Vec::new();
            put_normals(&mut bytes, &[encode_normal(normal)]);
            worst = worst.max((Normals::get(&mut &bytes[..], 1).unwrap().at(0) - normal).length());
        }
        assert!(worst <= NORMAL_ERROR && worst > 0.8 * NORMAL_ERROR, "{worst}");
    }

    #[test]
    fn depths_and_coordinates_err_by_at_most_their_bounds_and_reach_them() {
        let (mut depths, mut coordinates) = (0.0f32, 0.0f32);
        for i in 0..20_000 {
            let depth = (200.0 * random(i, 0) - 100.0).exp2();
            depths = depths.max((decode_depth(encode_depth(depth)) - depth).abs() / depth);
            let (scale, value) = ((20.0 * random(i, 1) - 10.0).exp2(), 2.0 * random(i, 2) - 1.0);
            let steps = Steps::of(scale);
            let found = steps.decode(steps.encode(scale * value).unwrap());
            coordinates = coordinates.max((found - scale * value).abs() / scale);
        }
        let bounds = [-18f32, -17.0].map(f32::exp2);
        assert!(depths <= bounds[0] && depths > 0.9 * bounds[0], "{depths}");
        assert!(coordinates <= bounds[1] * 1.01 && coordinates > 0.9 * bounds[1], "{coordinates}");
        assert_eq!([0.0, 1.0].map(|depth| decode_depth(encode_depth(depth))), [0.0, 1.0]);
        assert!(Steps::of(1.0).encode(127.0).is_some() && Steps::of(1.0).encode(-128.0).is_none());
        assert_eq!(Steps::of(1.0).decode(Steps::of(1.0).encode(-127.5).unwrap()), -127.5);
    }
}
