//! The points of texels move from pass to pass, so that a texel converges to the mean over the middle of its area: edges of shadows follow
//! the grid less.
//!
//! All texels of a pass have the same offset from their centres, so that neighbours see light alike. Offsets are those of a
//! low-discrepancy sequence; two passes, one of each instance, share one, and the next two have it mirrored, so that their mean is the
//! centre. Where the offset leads out of the texel's chart its nearest point is taken. Texels on the bounds of their chart do not move across
//! them: moving inwards alone they would show the light beside the border. Texels inside of geometry and their neighbours keep
//! their centre: light averaged over what nobody sees would darken the rest.

use std::sync::Arc;

use glam::Vec2;
use rayon::prelude::*;

use super::charts::{self, Charts, Face};
use super::texels::{self, NONE, REACH};
use crate::plan::INSTANCES;
use crate::view::{Moving, Texel};

/// Distance from its centre in which a texel's points lie: half a diagonal.
const HALF: f32 = WIDTH * std::f32::consts::FRAC_1_SQRT_2;
/// Numbers of the sequence, the powers of 1 / 1.3247..., the root of x^3 = x + 1: it fills the square evenly.
const STEPS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];

/// Width of the square in which a texel's points lie, in texels. Look-ups average over two texels already: of the widths 0, 1/2, 3/4 and 1
/// this one has the least error where shadows are hard, and hardly more than 0 where they are soft.
pub(super) const WIDTH: f32 = 0.5;

/// Offset of a pass from the centres, in texels.
pub fn offset(pass: u32) -> Vec2 {
    let step = pass / INSTANCES;
    let (point, mirrored) = (step.div_ceil(2), step > 0 && step.is_multiple_of(2));
    // The centre, then pairs.
    let at = STEPS.map(|step| ((0.5 + f64::from(point) * step).fract() - 0.5) as f32);
    Vec2::from_array(at) * if mirrored { -WIDTH } else { WIDTH }
}

/// The texels of a view that move.
#[derive(Debug)]
pub(super) struct Moves {
    faces: Arc<[Face]>,
    /// The texels at their centres.
    still: Vec<Option<Texel>>,
    centres: Vec<Vec2>,
    /// By how much of the offset an entry moves along each axis, 0 or 1.
    free: Vec<Vec2>,
    /// `starts[i]..starts[i + 1]`: places in `near` of the faces that entry i may lie on; none: it stays.
    starts: Vec<u32>,
    near: Vec<u32>,
}

impl Moves {
    /// The texel of an entry at an offset, if it has faces.
    fn texel(&self, i: usize, offset: Vec2) -> Option<Texel> {
        let near = &self.near[self.starts[i] as usize..self.starts[i + 1] as usize];
        texels::nearest_of(near.iter().map(|&face| &self.faces[face as usize]), self.centres[i] + self.free[i] * offset)
    }
}

impl Moving for Moves {
    fn texels(&self, pass: u32) -> Vec<Option<Texel>> {
        let offset = offset(pass);
        (0..self.still.len()).into_par_iter().map(|i| self.texel(i, offset).or(self.still[i])).collect()
    }
}

/// Which texels of a page stay: those inside of geometry, and their neighbours, of which a part may be.
pub(super) fn staying(inside: &[bool], [width, height]: [u32; 2]) -> Vec<bool> {
    let near = |n: usize, end: u32| n.saturating_sub(1)..(n + 2).min(end as usize);
    let stays = |i: usize| {
        let (x, y) = (i % width as usize, i / width as usize);
        near(y, height).any(|y| near(x, width).any(|x| inside[x + y * width as usize]))
    };
    (0..inside.len()).map(stays).collect()
}

/// Entry of a texel in a view: index of the view, and of the entry there.
pub(super) type Entry = (u32, u32);

/// The moves of views. `owners`: the face of each texel of each page; `entries`: its entry, if it moves; `views`: the texels of the views.
pub(super) fn of_views(
    charts: &Charts,
    owners: &[Vec<u32>],
    entries: &[Vec<Option<Entry>>],
    views: Vec<Vec<Option<Texel>>>,
) -> Vec<Moves> {
    let faces: Arc<[Face]> = charts.faces.clone().into();
    let mut near: Vec<Vec<(u32, u32)>> = vec![Vec::new(); views.len()];
    let zeros: Vec<Vec<Vec2>> = views.iter().map(|view| vec![Vec2::ZERO; view.len()]).collect();
    let (mut centres, mut free) = (zeros.clone(), zeros);
    let bounds = charts::bounds(&charts.faces, charts.count as usize);
    for (index, face) in (0..).zip(charts.faces.iter()) {
        let page = face.page as usize;
        texels::around(face, charts.pages[page], REACH + HALF, |at, centre, distance| {
            let (owner, entry) = (owners[page][at], entries[page][at]);
            if let Some((view, slot)) = entry
                && owner != NONE
                && charts.faces[owner as usize].chart == face.chart
                && distance < REACH + HALF
            {
                near[view as usize].push((slot, index));
                centres[view as usize][slot as usize] = centre;
                let [low, high] = bounds[face.chart as usize];
                let room = (centre - low).abs().min((high - centre).abs());
                free[view as usize][slot as usize] =
                    Vec2::select(room.cmpge(Vec2::splat(0.49 * WIDTH)), Vec2::ONE, Vec2::ZERO);
            }
        });
    }
    let of_view = |still: Vec<Option<Texel>>, near: Vec<(u32, u32)>, (centres, free): (Vec<Vec2>, Vec<Vec2>)| {
        let mut starts = vec![0u32; still.len() + 1];
        near.iter().for_each(|&(slot, _)| starts[slot as usize + 1] += 1);
        (0..still.len()).for_each(|i| starts[i + 1] += starts[i]);
        let mut next = starts.clone();
        let mut sorted = vec![0; near.len()];
        // In the order of the faces.
        for (slot, face) in near {
            let place = &mut next[slot as usize];
            sorted[*place as usize] = face;
            *place += 1;
        }
        Moves { faces: faces.clone(), still, centres, free, starts, near: sorted }
    };
    let of_entries = centres.into_iter().zip(free);
    views.into_iter().zip(near).zip(of_entries).map(|((still, near), of)| of_view(still, near, of)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_fill_the_texel_about_its_centre() {
        assert_eq!((offset(0), offset(1)), (Vec2::ZERO, Vec2::ZERO));
        for pairs in [1, 5, 16] {
            let count = 2 + 4 * pairs;
            let mean = (0..count).map(offset).sum::<Vec2>() / count as f32;
            assert!(mean.length() < 1e-6, "{mean}");
        }
        // As many points in each of 4 x 4 parts, nearly.
        let mut counts = [0; 16];
        for pass in 2..258 {
            let at = (offset(pass) / WIDTH + 0.5) * 4.0;
            assert!(at.min_element() >= 0.0 && at.max_element() <= 4.0);
            counts[at.min(Vec2::splat(3.99)).x as usize + 4 * at.min(Vec2::splat(3.99)).y as usize] += 1;
        }
        assert!(counts.iter().all(|n| (12..=20).contains(n)), "{counts:?}");
    }

    fn face(triangle: u32, chart: u32, corners: [[f32; 2]; 3]) -> Face {
        Face { triangle, back: false, page: 0, chart, corners: corners.map(Vec2::from_array) }
    }

    /// Two charts of two triangles each, one texel apart.
    fn charts() -> Charts {
        let square = |first: u32, x: f32| {
            [
                face(first, first / 2, [[x, 2.0], [x + 4.3, 2.0], [x + 4.3, 6.4]]),
                face(first + 1, first / 2, [[x, 2.0], [x + 4.3, 6.4], [x, 6.4]]),
            ]
        };
        let faces = [square(0, 2.0), square(2, 7.3)].concat();
        Charts { pages: vec![[14, 9]], faces, count: 2, density: 1.0 }
    }

    fn moves() -> (Charts, Moves) {
        let charts = charts();
        let (pages, owners) = texels::of_charts(&charts);
        let entries = vec![(0..pages[0].len() as u32).map(|i| Some((0, i))).collect()];
        let moves = of_views(&charts, &owners, &entries, pages).remove(0);
        (charts, moves)
    }

    #[test]
    fn points_are_the_nearest_of_their_chart() {
        let (charts, moves) = moves();
        assert_eq!(moves.texels(0), moves.still, "the first passes have the centres");
        for pass in [2, 4, 6, 8, 31] {
            let offset = offset(pass);
            for (i, (texel, still)) in moves.texels(pass).iter().zip(&moves.still).enumerate() {
                assert_eq!(texel.is_some(), still.is_some());
                let (Some(texel), Some(still)) = (texel, still) else { continue };
                let chart = |t: u32| charts.faces[t as usize].chart;
                assert_eq!(chart(texel.triangle), chart(still.triangle), "{i}");
                let f = &charts.faces[texel.triangle as usize];
                let [u, v] = texel.uv;
                assert!(u >= 0.0 && v >= 0.0 && u + v <= 1.0 + 1e-6);
                let at = f.corners[0] + u * (f.corners[1] - f.corners[0]) + v * (f.corners[2] - f.corners[0]);
                let x = if chart(texel.triangle) == 0 { 2.0 } else { 7.3 };
                let (low, high) = (Vec2::new(x, 2.0), Vec2::new(x + 4.3, 6.4));
                let centre = Vec2::new((i % 14) as f32 + 0.5, (i / 14) as f32 + 0.5);
                let held = (centre - low).abs().min((high - centre).abs()).cmplt(Vec2::splat(0.49 * WIDTH));
                let wanted = centre + Vec2::select(held, Vec2::ZERO, offset);
                let nearest = wanted.clamp(low, high);
                assert!((at - nearest).length() < 0.06, "{i}: {at} for {nearest}");
            }
        }
    }

    #[test]
    fn texels_inside_of_geometry_and_their_neighbours_stay() {
        let (charts, still) = (charts(), moves().1.still);
        // The page is covered left of x = 3.
        let at = |texel: &Texel| {
            let f = &charts.faces[texel.triangle as usize];
            f.corners[0] + texel.uv[0] * (f.corners[1] - f.corners[0]) + texel.uv[1] * (f.corners[2] - f.corners[0])
        };
        let covered = |i: usize| still[i].is_some_and(|texel| at(&texel).x < 3.0);
        let stays = staying(&(0..still.len()).map(covered).collect::<Vec<_>>(), [14, 9]);
        for (i, stays) in stays.iter().enumerate() {
            let (x, y) = (i % 14, i / 14);
            let mut near = (0..14 * 9usize).filter(|&k| (k % 14).abs_diff(x) <= 1 && (k / 14).abs_diff(y) <= 1);
            assert_eq!(*stays, near.any(covered), "{x} {y}");
        }
        // Without an entry they do not move.
        let (pages, owners) = texels::of_charts(&charts);
        let entries = vec![(0..pages[0].len()).map(|i| (!stays[i]).then_some((0, i as u32))).collect()];
        let moves = of_views(&charts, &owners, &entries, pages).remove(0);
        let moved = moves.texels(2);
        assert!((0..moved.len()).all(|i| !stays[i] || moved[i] == still[i]));
        assert!((0..moved.len()).filter(|&i| moved[i] != still[i]).count() > 30);
    }
}
