//! The oracle: the sums as stated, over the whole image.

use glam::{DVec2, DVec3, Vec2, Vec4};

use super::{ALIKE, ALIKE_SHARE, DEPTH_TOLERANCE, VELOCITY_JUMP};
use crate::sampling::dimensions;
use crate::sampling::random::key;

/// Word by which the rows of segments are dithered, another one in each pass.
#[derive(Clone, Copy, Debug)]
pub struct Dither(u32);

impl Dither {
    /// Of a pass with this seed, [`FrameParameters::keys`](crate::pass::layout::FrameParameters::keys) 0.
    pub fn of(seed: u32) -> Dither {
        Dither(key(seed, dimensions::BLUR, 0, 1))
    }

    /// The row that takes the part of a segment in a column: one of the two beside it.
    fn row(self, column: f64, slope: f64) -> f64 {
        let word = self.0.wrapping_add((column as i32 as u32).wrapping_mul(0x9e37_79b9));
        (column * slope + f64::from(word >> 8) / 16_777_216.0).floor()
    }
}

/// Time, as a share, that a source of velocity `v` spends on the pixel at an offset from it.
pub fn time_on(v: DVec2, offset: DVec2, dither: Dither) -> f64 {
    // The longer side becomes the first axis.
    let turn = |a: DVec2| if v.x.abs() >= v.y.abs() { a } else { DVec2::new(a.y, a.x) };
    let (v, offset) = (turn(v), turn(offset));
    let length = v.x.abs();
    if length <= 1.0 {
        return if offset == DVec2::ZERO { 1.0 } else { 0.0 };
    }
    // From -1/2 to 1/2 the place is v t; the column holds it from `enters` to `leaves`.
    let times = [offset.x - 0.5, offset.x + 0.5].map(|x| (x / length).clamp(-0.5, 0.5));
    let [enters, leaves] = times;
    if dither.row(offset.x, v.y / v.x) == offset.y { leaves - enters } else { 0.0 }
}

/// The image with these velocities; `source`: radiance, w: depth; `even`: whether all sources count as one surface for a pixel ([`even`]).
pub fn reference(
    [width, height]: [u32; 2],
    source: &[Vec4],
    velocity: &[DVec2],
    even: impl Fn(usize) -> bool,
    dither: Dither,
) -> Vec<DVec3> {
    let place = |i: usize| DVec2::new((i as u32 % width).into(), (i as u32 / width).into());
    let light = |i: usize| source[i].truncate().as_dvec3();
    let pixels = (width * height) as usize;
    (0..pixels)
        .map(|p| {
            let front = if even(p) { -1.0 } else { source[p].w - source[p].w.abs() * DEPTH_TOLERANCE };
            let (mut over, mut own, mut inside) = ((DVec3::ZERO, 0.0), (DVec3::ZERO, 0.0), 0.0);
            for q in 0..pixels {
                let offset = place(p) - place(q);
                inside += time_on(velocity[p], offset, dither);
                let (sum, time) = match source[q].w < front {
                    true => (&mut over, time_on(velocity[q], offset, dither)),
                    false => (&mut own, time_on(velocity[p], offset, dither)),
                };
                *sum = (sum.0 + time * light(q), sum.1 + time);
            }
            let rest = f64::max(inside - over.1, 0.0);
            (over.0 / f64::max(over.1, 1.0) + rest * own.0 / own.1) / (f64::min(over.1, 1.0) + rest)
        })
        .collect()
}

/// Whether all sources that reach a tile count as one surface; `None`: none that moves reaches it.
pub fn even([width, height]: [u32; 2], velocity: &[Vec2], tile: [u32; 2]) -> Option<bool> {
    let of_tile = |[x, y]: [u32; 2]| {
        let rows = (8 * y..height.min(8 * y + 8)).flat_map(move |v| (8 * x..width.min(8 * x + 8)).map(move |u| [u, v]));
        rows.map(move |[u, v]| ((v * width + u) as usize, [u, v]))
    };
    let moves = |i: usize| velocity[i].abs().max_element() > 1.0;
    let reach = |tile| {
        let moving = of_tile(tile).filter(|(i, _)| moves(*i)).map(|(i, _)| velocity[i].abs());
        moving.reduce(Vec2::max).map_or(Vec2::splat(-1.0), |most| 0.5 * most + 1.0)
    };
    let jump = |a: usize, b: usize| (velocity[a] - velocity[b]).abs().max_element() > VELOCITY_JUMP;
    let tiles = || (0..height.div_ceil(8)).flat_map(|y| (0..width.div_ceil(8)).map(move |x| [x, y]));
    let apart = |other: [u32; 2]| Vec2::from([0, 1].map(|k| (8.0 * tile[k].abs_diff(other[k]) as f32 - 7.0).max(0.0)));
    let (mut seen, mut any, mut far) = (Vec::new(), false, reach(tile));
    for other in tiles().filter(|&other| other == tile || reach(other).max(reach(tile)).cmpge(apart(other)).all()) {
        for (i, _) in of_tile(other) {
            seen.push(if moves(i) { velocity[i] } else { Vec2::ZERO });
            any |= moves(i);
        }
        far = far.max(reach(other));
    }
    // Sources come from between this tile and those that reach it.
    let between = tiles().filter(|&other| far.cmpge(apart(other)).all());
    let jumps =
        between.flat_map(of_tile).any(|(i, [x, y])| x > 0 && jump(i, i - 1) || y > 0 && jump(i, i - width as usize));
    let (low, high) = seen.iter().fold((Vec2::MAX, Vec2::MIN), |(low, high), v| (low.min(*v), high.max(*v)));
    let longest = seen.iter().map(|v| v.length()).fold(0.0, f32::max);
    any.then(|| !jumps || (high - low).max_element() <= ALIKE.max(ALIKE_SHARE * longest))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over the grid the times sum to 1; over many words their mean is the source, and their variance is that of the segment.
    #[test]
    fn times_are_those_of_a_segment() {
        for v in [[0.0, 0.0], [0.9, -0.3], [1.1, 0.4], [5.0, 0.0], [-7.3, 2.2], [3.0, -12.6], [0.5, 31.0], [22.0, 22.0]]
        {
            let v = DVec2::from(v);
            let words = 64;
            let moment = |of: &dyn Fn(DVec2) -> f64, word: u32| -> f64 {
                let grid = (-20..=20).flat_map(|y| (-20..=20).map(move |x| DVec2::new(x.into(), y.into())));
                grid.map(|o| time_on(v, o, Dither::of(word)) * of(o)).sum()
            };
            let moments = |of: &dyn Fn(DVec2) -> f64| -> f64 {
                (0..words).map(|word| moment(of, word)).sum::<f64>() / f64::from(words)
            };
            assert!((0..words).all(|word| (moment(&|_| 1.0, word) - 1.0).abs() < 1e-12), "{v}");
            assert!(moments(&|o| o.x).abs() < 0.05 && moments(&|o| o.y).abs() < 0.05, "{v}");
            let along = v.normalize_or_zero();
            let variance = moments(&|o| o.dot(along).powi(2));
            let expected = if v.abs().max_element() > 1.0 { v.length_squared() / 12.0 } else { 0.0 };
            assert!((variance - expected).abs() < 0.35, "{v}: {variance} for {expected}");
            let across = moments(&|o| o.perp_dot(along).powi(2));
            assert!(across < 0.3, "{v}: {across}");
        }
    }

    /// A bright object that moves to the right in front of a dark background: the profile of a box over its edge.
    #[test]
    fn a_moving_edge_has_the_profile_of_a_box() {
        let (width, edge, length) = (40u32, 20.0, 9.0);
        let object = |x: u32| f64::from(x) < edge;
        let source: Vec<Vec4> = (0..width)
            .map(|x| if object(x) { Vec4::new(1.0, 1.0, 1.0, 2.0) } else { Vec4::new(0.0, 0.0, 0.0, 5.0) })
            .collect();
        let velocity: Vec<DVec2> =
            (0..width).map(|x| if object(x) { DVec2::new(length, 0.0) } else { DVec2::ZERO }).collect();
        let image = reference([width, 1], &source, &velocity, |_| false, Dither::of(1));
        for x in 6..34 {
            let expected = (0.5 + (edge - 0.5 - f64::from(x)) / length).clamp(0.0, 1.0);
            let found = image[x as usize].x;
            assert!((found - expected).abs() < 0.013, "{x}: {found} for {expected}");
        }
    }
}
