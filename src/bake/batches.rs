//! Texels that are rendered together: blocks of 64 that lie near each other, many of them in a view.
//!
//! Blocks are clusters of shadow rays, which are the cheaper the smaller their box is, and choose their lights in common. Charts are often
//! smaller than a block, so blocks are not squares of a map: the texels of all charts are halved at the median along the longest axis of
//! their box, until 64 are left. The axes are those of space, and of the normal as far as a block of texels is wide. So all blocks but
//! the last are full, whatever the charts are like.

use std::sync::Arc;

use rayon::prelude::*;

use super::blocks::{self, ENTRIES, view_size};
use super::charts::Charts;
use super::lightmap::Inside;
use super::moves::{self, Moves};
use super::texels;
use crate::view::{Atlas, Texel};

/// Distance in texels that opposite normals count as, half: that of a block's centre from its borders.
const NORMAL: f32 = 4.0;

/// Texels that are rendered together.
pub struct Batch {
    /// The view.
    pub atlas: Arc<Atlas>,
    /// Page and index in it of each block's texels, in the order of the view.
    pub(super) places: Vec<Option<(u32, u32)>>,
}

impl Batch {
    /// Number of texels with a point.
    pub fn texels(&self) -> usize {
        self.places.iter().flatten().count()
    }
}

/// Divides the texels of all pages into views of at most `most` texels. Each has blocks from all over the scene, so that all have much the
/// same light and the same error. Returns also the number of texels inside geometry, which are in none.
pub(super) fn divide(charts: &Charts, most: usize, inside: &Inside) -> (Vec<Batch>, usize) {
    let (pages, owners) = texels::of_charts(charts);
    // Texels that see no side with light are not rendered.
    let holds = |texel: &Option<Texel>| texel.as_ref().is_some_and(|texel| inside.holds(texel));
    let within: Vec<Vec<bool>> = pages.iter().map(|texels| texels.par_iter().map(holds).collect()).collect();
    let mut placed = placed(charts, (&pages, &within), inside);
    neighbours_together(&mut placed);
    let blocks = placed.len().div_ceil(ENTRIES);
    let views = blocks.div_ceil((most / ENTRIES).max(1));
    let staying: Vec<Vec<bool>> =
        within.iter().zip(&charts.pages).map(|(within, &size)| moves::staying(within, size)).collect();
    let mut entries: Vec<Vec<Option<moves::Entry>>> = pages.iter().map(|page| vec![None; page.len()]).collect();
    let of_view = |view: usize| {
        let size = view_size((blocks - view).div_ceil(views));
        let mut places = vec![None; (size[0] * size[1]) as usize];
        for (b, block) in placed.chunks(ENTRIES).skip(view).step_by(views).enumerate() {
            for (i, &Placed { place: (page, at), .. }) in block.iter().enumerate() {
                let slot = blocks::slot(b, i, size[0]);
                places[slot] = Some((page, at));
                if !staying[page as usize][at as usize] {
                    entries[page as usize][at as usize] = Some((view as u32, slot as u32));
                }
            }
        }
        (size, places)
    };
    let views: Vec<([u32; 2], Vec<_>)> = (0..views).map(of_view).collect();
    let texel = |place: &Option<(u32, u32)>| place.and_then(|(page, at)| pages[page as usize][at as usize]);
    let still: Vec<Vec<_>> = views.iter().map(|(_, places)| places.iter().map(texel).collect()).collect();
    let moves = moves::of_views(charts, &owners, &entries, still.clone());
    let batch = |((size, places), (texels, moves)): (([u32; 2], Vec<_>), (Vec<_>, Moves))| Batch {
        atlas: Arc::new(Atlas { size, texels, moving: Some(Arc::new(moves)) }),
        places,
    };
    let batches = views.into_iter().zip(still.into_iter().zip(moves)).map(batch).collect();
    (batches, within.iter().flatten().filter(|&&within| within).count())
}

/// A texel in space and on its page.
#[derive(Clone, Copy, Debug)]
struct Placed {
    /// Position, and normal times a length.
    at: [f32; 6],
    /// Page and index in it.
    place: (u32, u32),
}

/// The texels of all pages that are not `within` geometry, page by page.
fn placed(charts: &Charts, (pages, within): (&[Vec<Option<Texel>>], &[Vec<bool>]), inside: &Inside) -> Vec<Placed> {
    let length = NORMAL / charts.density;
    let texel = |page: u32, at: usize, texel: &Texel| {
        let (position, normal) = inside.place(texel);
        let ([x, y, z], [a, b, c]) = (position.to_array(), (length * normal).to_array());
        Placed { at: [x, y, z, a, b, c], place: (page, at as u32) }
    };
    let of_page = |(page, texels): (u32, &Vec<Option<Texel>>)| {
        let outside = texels.iter().enumerate().filter(|(at, _)| !within[page as usize][*at]);
        let found: Vec<Placed> = outside.filter_map(|(at, of)| Some(texel(page, at, of.as_ref()?))).collect();
        found
    };
    (0..).zip(pages).flat_map(of_page).collect()
}

/// Sorts texels so that each 64 are neighbours, and so are twice, four times as many.
fn neighbours_together(texels: &mut [Placed]) {
    let blocks = texels.len().div_ceil(ENTRIES);
    if blocks < 2 {
        return;
    }
    let (mut low, mut high) = ([f32::INFINITY; 6], [f32::NEG_INFINITY; 6]);
    for texel in texels.iter() {
        low = std::array::from_fn(|k| low[k].min(texel.at[k]));
        high = std::array::from_fn(|k| high[k].max(texel.at[k]));
    }
    let width = |&k: &usize| high[k] - low[k];
    let axis = (0..6).max_by(|a, b| width(a).total_cmp(&width(b))).unwrap_or(0);
    let (left, right) = {
        let middle = blocks / 2 * ENTRIES;
        // Places tell equal ones apart, so the order is one.
        texels.select_nth_unstable_by(middle, |a, b| a.at[axis].total_cmp(&b.at[axis]).then(a.place.cmp(&b.place)));
        texels.split_at_mut(middle)
    };
    rayon::join(|| neighbours_together(left), || neighbours_together(right));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::random::{key, random_f32};

    #[test]
    fn blocks_are_full_and_small_and_hold_each_texel_once() {
        // A floor and a wall of 32 x 32 texels each in disorder, and 7 more.
        let count = 2 * 32 * 32 + 7;
        let texel = |i: u32| {
            let (x, y) = ((i % 32) as f32, (i / 32 % 32) as f32);
            let (position, normal) = match i / 1024 {
                0 => ([x, y, 0.0], [0.0, 0.0, NORMAL]),
                1 => ([x, 0.0, y], [0.0, NORMAL, 0.0]),
                _ => ([40.0 + x, 0.0, 0.0], [NORMAL, 0.0, 0.0]),
            };
            let at = [position[0], position[1], position[2], normal[0], normal[1], normal[2]];
            Placed { at, place: (0, i) }
        };
        let mut all: Vec<Placed> = (0..count).map(texel).collect();
        all.sort_by_key(|t| random_f32(key(1, t.place.1, 2, 3)).to_bits());
        neighbours_together(&mut all);
        let mut widths = 0.0;
        let mut seen: Vec<u32> = all.iter().map(|t| t.place.1).collect();
        for block in all.chunks(ENTRIES).take(32) {
            assert_eq!(block.len(), ENTRIES);
            let width = |k: usize| {
                let of = || block.iter().map(|t| t.at[k]);
                of().fold(f32::MIN, f32::max) - of().fold(f32::MAX, f32::min)
            };
            widths += (0..3).map(width).fold(0.0, f32::max);
        }
        // Squares are 7 wide.
        assert!(widths / 32.0 < 12.0, "{widths}");
        seen.sort_unstable();
        assert!(seen.into_iter().eq(0..count));
        let places = |texels: &[Placed]| texels.iter().map(|t| t.place).collect::<Vec<_>>();
        let first = places(&all);
        all.sort_by_key(|t| t.place);
        neighbours_together(&mut all);
        type Places<'a> = &'a [(u32, u32)];
        let same = |(a, b): (Places, Places)| {
            let sorted = |places: Places| {
                let mut places = places.to_vec();
                places.sort_unstable();
                places
            };
            sorted(a) == sorted(b)
        };
        assert!(first.chunks(ENTRIES).zip(places(&all).chunks(ENTRIES)).all(same), "whatever the order before");
    }
}
