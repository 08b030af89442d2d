//! The point of each texel at its centre (it moves from pass to pass, see `moves`): where it lies on a chart; or, for texels that count a
//! quarter or more in some bilinear look-up within the chart, the nearest point of the chart. Those that count less take the mean of their
//! neighbours in the end: among many small charts they would be more than all others.

use glam::Vec2;

use super::charts::{Charts, Face};
use crate::view::Texel;

/// Distance in texels at which a texel counts a quarter in a look-up straight beside it, and 0.22 in one on its diagonal.
pub(super) const REACH: f32 = 0.75;
/// Number of a face where there is none.
pub(super) const NONE: u32 = u32::MAX;
/// Distance in texels by which points on the border of a chart are moved into their triangle: at the border itself rounding
/// decides on which side of an adjoining wall they lie.
pub(super) const INWARDS: f32 = 0.05;

/// The texels of each page, row by row, at their centres; and the number of the face of each, `u32::MAX` where there is none.
pub fn of_charts(charts: &Charts) -> (Vec<Vec<Option<Texel>>>, Vec<Vec<u32>>) {
    let area = |&[w, h]: &[u32; 2]| w as usize * h as usize;
    let mut pages: Vec<Vec<Option<Texel>>> = charts.pages.iter().map(|size| vec![None; area(size)]).collect();
    let mut owners: Vec<Vec<u32>> = charts.pages.iter().map(|size| vec![NONE; area(size)]).collect();
    let mut distances: Vec<Vec<f32>> = charts.pages.iter().map(|size| vec![REACH; area(size)]).collect();
    for (index, face) in (0..).zip(&charts.faces) {
        let page = face.page as usize;
        around(face, charts.pages[page], REACH, |at, centre, distance| {
            let nearer = &mut distances[page][at];
            // Of faces that share the nearest point the first has it.
            if distance < *nearer {
                *nearer = distance;
                owners[page][at] = index;
                pages[page][at] = Some(texel(face, nearest(face, centre)));
            }
        });
    }
    (pages, owners)
}

/// Calls for each texel of a page whose centre may be as near to a face as `reach`: with its index, its centre and their distance. Faces
/// without area have none.
pub(super) fn around(face: &Face, [width, height]: [u32; 2], reach: f32, mut texel: impl FnMut(usize, Vec2, f32)) {
    let [a, b, c] = face.corners;
    if !has_area(face) {
        return;
    }
    let low = a.min(b).min(c) - reach - 0.5;
    let high = a.max(b).max(c) + reach - 0.5;
    let range =
        |low: f32, high: f32, end: u32| low.ceil().max(0.0) as u32..((high.floor() + 1.0).max(0.0) as u32).min(end);
    for y in range(low.y, high.y, height) {
        for x in range(low.x, high.x, width) {
            let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            texel((x + y * width) as usize, centre, nearest(face, centre).1);
        }
    }
}

fn has_area(face: &Face) -> bool {
    let [a, b, c] = face.corners;
    let area = (b - a).perp_dot(c - a).abs();
    area > 1e-9 && area.is_finite()
}

/// The texel of the nearest point to `p` of some faces with area, of the first of those that share it; `None` without faces.
pub(super) fn nearest_of<'a>(faces: impl Iterator<Item = &'a Face>, p: Vec2) -> Option<Texel> {
    let mut found: Option<(&Face, ([f32; 2], f32))> = None;
    for face in faces {
        let near = nearest(face, p);
        if found.is_none_or(|(_, (_, distance))| near.1 < distance) {
            found = Some((face, near));
        }
        if near.1 == 0.0 {
            break;
        }
    }
    found.map(|(face, near)| texel(face, near))
}

/// The texel of the nearest point of a face, which lies at a distance.
fn texel(face: &Face, (weights, distance): ([f32; 2], f32)) -> Texel {
    let uv = if distance > 0.0 { moved_inwards(face, weights) } else { weights };
    Texel { triangle: face.triangle, uv, back: face.back }
}

/// Weights of the second and third corner at the point of a face that is nearest to `p`, and its distance.
fn nearest(face: &Face, p: Vec2) -> ([f32; 2], f32) {
    let [a, b, c] = face.corners;
    let (e1, e2, to) = (b - a, c - a, p - a);
    let area = e1.perp_dot(e2);
    let (u, v) = (to.perp_dot(e2) / area, e1.perp_dot(to) / area);
    if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
        return ([u, v], 0.0);
    }
    let on_edge = |from: Vec2, to: Vec2, weights: fn(f32) -> [f32; 2]| {
        let along = to - from;
        let t = ((p - from).dot(along) / along.length_squared().max(1e-30)).clamp(0.0, 1.0);
        (weights(t), (from + t * along - p).length().max(1e-6))
    };
    let edges = [on_edge(a, b, |t| [t, 0.0]), on_edge(b, c, |t| [1.0 - t, t]), on_edge(c, a, |t| [0.0, 1.0 - t])];
    edges.into_iter().min_by(|x, y| x.1.total_cmp(&y.1)).unwrap_or(([1.0 / 3.0; 2], REACH))
}

/// Moves a point of a face towards its middle by [`INWARDS`], or halfway if that is nearer.
fn moved_inwards(face: &Face, [u, v]: [f32; 2]) -> [f32; 2] {
    let [a, b, c] = face.corners;
    let point = a + u * (b - a) + v * (c - a);
    let middle = (a + b + c) / 3.0;
    let t = (INWARDS / (middle - point).length().max(1e-6)).min(0.5);
    [u, v].map(|w| w + t * (1.0 / 3.0 - w))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn face(corners: [[f32; 2]; 3]) -> Face {
        Face { triangle: 7, back: false, page: 0, chart: 0, corners: corners.map(Vec2::from_array) }
    }

    #[test]
    fn texels_lie_at_their_centres_or_at_the_nearest_point() {
        let square = [face([[2.0, 2.0], [6.0, 2.0], [6.0, 6.0]]), face([[2.0, 2.0], [6.0, 6.0], [2.0, 6.0]])];
        let charts = Charts { pages: vec![[8, 8]], faces: square.to_vec(), count: 1, density: 1.0 };
        let texels = &of_charts(&charts).0[0];
        for (i, texel) in texels.iter().enumerate() {
            let centre = Vec2::new((i % 8) as f32 + 0.5, (i / 8) as f32 + 0.5);
            let clamped = centre.clamp(Vec2::splat(2.0), Vec2::splat(6.0));
            let distance = (centre - clamped).length();
            assert_eq!(texel.is_some(), distance < REACH, "{centre}");
            let Some(texel) = texel else { continue };
            let [u, v] = texel.uv;
            let on = |f: &Face| f.corners[0] + u * (f.corners[1] - f.corners[0]) + v * (f.corners[2] - f.corners[0]);
            let error = square.iter().map(|f| (on(f) - clamped).length()).fold(f32::MAX, f32::min);
            assert!(error <= if distance > 0.0 { 1.01 * INWARDS } else { 1e-5 }, "{centre}: {error}");
            assert!(u >= 0.0 && v >= 0.0 && u + v <= 1.0);
        }
    }

    #[test]
    fn every_look_up_on_a_chart_finds_the_texels_that_count() {
        let slanted = face([[3.1, 2.7], [12.4, 5.2], [6.6, 13.9]]);
        let charts = Charts { pages: vec![[17, 17]], faces: vec![slanted], count: 1, density: 1.0 };
        let texels = &of_charts(&charts).0[0];
        for i in 0..=40 {
            for j in 0..=40 - i {
                let [a, b, c] = slanted.corners;
                let p = a + (b - a) * (i as f32 / 40.0) + (c - a) * (j as f32 / 40.0) - 0.5;
                for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let at = (p.x.floor() as usize + x) + (p.y.floor() as usize + y) * 17;
                    let weight = |p: f32, far: usize| if far == 1 { p - p.floor() } else { 1.0 - (p - p.floor()) };
                    assert!(texels[at].is_some() || weight(p.x, x) * weight(p.y, y) < 0.2501, "{p}");
                }
            }
        }
    }

    #[test]
    fn thin_faces_and_borders_of_a_page_are_no_trouble() {
        let line = face([[1.0, 1.0], [3.0, 3.0], [2.0, 2.0]]);
        let corner = face([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
        let charts = Charts { pages: vec![[3, 2]], faces: vec![line, corner], count: 2, density: 1.0 };
        let texels = &of_charts(&charts).0[0];
        assert!(texels[0].is_some() && texels.iter().flatten().all(|t| t.uv.iter().all(|w| w.is_finite())));
    }
}
