//! Polygons of many corners as triangles.
//!
//! earcut looks at each ear for corners inside it, which takes time quadratic in the number of corners where ears are long and
//! thin. A sweep from the highest corner to the lowest takes n log n: it divides the polygon into pieces whose left and right
//! chains only go down, and cuts each on the way (de Berg et al., *Computational Geometry*, 3rd edition, chapter 3).
//! Orientations are exact.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use glam::DVec2;
use robust::{Coord, orient2d};

/// Cuts a simple counter-clockwise polygon into `points.len() - 2` triangles, none of them clockwise, as indices into `points`.
/// `None`: its edges cross, or touch so that the sweep does not tell its inside.
pub(super) fn cut(points: &[DVec2]) -> Option<Vec<[u32; 3]>> {
    let n = points.len() as u32;
    let corner = |index: u32| Corner { at: points[index as usize], index };
    let mut order: Vec<Corner> = (0..n).map(corner).collect();
    order.sort_unstable_by(Corner::sweep_order);
    let cutter = Cutter { points, triangles: Vec::with_capacity(points.len()) };
    let mut sweep = Sweep { status: BTreeMap::new(), cutter };
    for v in order {
        sweep.meet(corner((v.index + n - 1) % n), v, corner((v.index + 1) % n))?;
    }
    let Sweep { status, cutter: Cutter { triangles, .. } } = sweep;
    let found = status.is_empty() && triangles.len() + 2 == points.len() && covers(&triangles, points);
    found.then_some(triangles)
}

/// Whether triangles, none of them clockwise, cover what the polygon winds around: their edges are those of the polygon, and others
/// that cancel out.
fn covers(triangles: &[[u32; 3]], points: &[DVec2]) -> bool {
    let n = points.len() as u32;
    let of_polygon = (0..n).map(|i| [(i + 1) % n, i]);
    let of_triangles = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let directed = |[a, b]: [u32; 2]| if a < b { (a, b, 1) } else { (b, a, -1) };
    let mut edges: Vec<(u32, u32, i32)> = of_polygon.chain(of_triangles).map(directed).collect();
    edges.sort_unstable();
    let cancel = edges.chunk_by(|e, f| (e.0, e.1) == (f.0, f.1)).all(|same| same.iter().map(|e| e.2).sum::<i32>() == 0);
    cancel && triangles.iter().all(|t| orient(t.map(|i| points[i as usize])) >= 0.0)
}

/// Above 0: counter-clockwise. 0: on a line.
fn orient(corners: [DVec2; 3]) -> f64 {
    let [a, b, c] = corners.map(|p| Coord { x: p.x, y: p.y });
    orient2d(a, b, c)
}

#[derive(Clone, Copy)]
struct Corner {
    at: DVec2,
    index: u32,
}

impl Corner {
    /// Downwards, and on a level from left to right, as if the plane were turned a little.
    fn sweep_order(&self, other: &Corner) -> Ordering {
        let down = other.at.y.partial_cmp(&self.at.y).unwrap_or(Ordering::Equal);
        let right = self.at.x.partial_cmp(&other.at.x).unwrap_or(Ordering::Equal);
        down.then(right).then(self.index.cmp(&other.index))
    }

    fn is_above(&self, other: &Corner) -> bool {
        self.sweep_order(other).is_lt()
    }
}

/// An edge that goes down, with the polygon on its right; or a corner, as both ends. Edges that the sweep meets at the same time are
/// ordered from left to right. The order of edges that cross may contradict itself: the map then loses some of them.
#[derive(Clone, Copy)]
struct Edge {
    upper: Corner,
    lower: Corner,
}

impl Edge {
    /// Less where the edge has `p` on its right.
    fn beside(&self, p: Corner) -> Ordering {
        0.0f64.partial_cmp(&orient([self.upper.at, self.lower.at, p.at])).unwrap_or(Ordering::Equal)
    }
}

impl Ord for Edge {
    fn cmp(&self, other: &Edge) -> Ordering {
        if other.upper.is_above(&self.upper) {
            return other.cmp(self).reverse();
        }
        let at_the_lower_end = || match self.lower.is_above(&other.lower) {
            true => other.beside(self.lower).reverse(),
            false => self.beside(other.lower),
        };
        let ends = (self.upper.index, self.lower.index).cmp(&(other.upper.index, other.lower.index));
        if ends.is_eq() { ends } else { self.beside(other.upper).then_with(at_the_lower_end).then(ends) }
    }
}

impl PartialOrd for Edge {
    fn partial_cmp(&self, other: &Edge) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Edge {
    fn eq(&self, other: &Edge) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Edge {}

#[derive(Clone, Copy, PartialEq)]
enum Side {
    Left,
    Right,
}

/// The part not cut yet, above the sweep, of a piece whose chains only go down.
struct Piece {
    /// Downwards; all but the first are on one side.
    corners: Vec<u32>,
    side: Side,
}

/// The uncut part of the polygon between an edge of the status and the next edge on its right: one piece, or two with the same last
/// corner.
struct Span {
    left: Piece,
    right: Option<Piece>,
}

struct Sweep<'a> {
    status: BTreeMap<Edge, Span>,
    cutter: Cutter<'a>,
}

impl Sweep<'_> {
    /// Goes on to corner `v`, between `before` and `after` in the polygon. `None`: edges cross.
    fn meet(&mut self, before: Corner, v: Corner, after: Corner) -> Option<()> {
        let (ends, begins) = (Edge { upper: before, lower: v }, Edge { upper: v, lower: after });
        let convex = orient([before.at, v.at, after.at]) >= 0.0;
        match (before.is_above(&v), after.is_above(&v)) {
            // The polygon begins here.
            (false, false) if convex => {
                let left = Piece { corners: vec![v.index], side: Side::Left };
                self.status.insert(begins, Span { left, right: None });
            }
            // Two parts of it begin below an inner corner.
            (false, false) => {
                let (_, span) = self.status.range_mut(..Edge { upper: v, lower: v }).next_back()?;
                let right = match span.right.take() {
                    Some(mut right) => {
                        self.cutter.add(&mut span.left, v, Side::Right);
                        self.cutter.add(&mut right, v, Side::Left);
                        right
                    }
                    // A diagonal to the last corner; the piece goes on beyond the other chain.
                    None => {
                        let last = *span.left.corners.last()?;
                        let side = span.left.side;
                        self.cutter.add(&mut span.left, v, side);
                        match side {
                            Side::Left => {
                                let left = Piece { corners: vec![last, v.index], side: Side::Right };
                                std::mem::replace(&mut span.left, left)
                            }
                            Side::Right => Piece { corners: vec![last, v.index], side: Side::Left },
                        }
                    }
                };
                self.status.insert(begins, Span { left: right, right: None });
            }
            // It ends here.
            (true, true) if convex => {
                let Span { left, right } = self.status.remove(&ends)?;
                self.cutter.finish(left, v);
                right.into_iter().for_each(|piece| self.cutter.finish(piece, v));
            }
            // Two parts of it meet above an inner corner.
            (true, true) => {
                let mut right = self.status.remove(&ends)?;
                self.cutter.add_left(&mut right, v);
                let (_, left) = self.status.range_mut(..Edge { upper: v, lower: v }).next_back()?;
                self.cutter.add_right(left, v);
                left.right = Some(right.left);
            }
            (true, false) => {
                let mut span = self.status.remove(&ends)?;
                self.cutter.add_left(&mut span, v);
                self.status.insert(begins, span);
            }
            (false, true) => {
                let (_, span) = self.status.range_mut(..Edge { upper: v, lower: v }).next_back()?;
                self.cutter.add_right(span, v);
            }
        }
        Some(())
    }
}

struct Cutter<'a> {
    points: &'a [DVec2],
    triangles: Vec<[u32; 3]>,
}

impl Cutter<'_> {
    /// Adds the next corner down the left chain of a span.
    fn add_left(&mut self, span: &mut Span, v: Corner) {
        if let Some(right) = span.right.take() {
            self.finish(std::mem::replace(&mut span.left, right), v);
        }
        self.add(&mut span.left, v, Side::Left);
    }

    /// Adds the next corner down the right chain of a span.
    fn add_right(&mut self, span: &mut Span, v: Corner) {
        if let Some(right) = span.right.take() {
            self.finish(right, v);
        }
        self.add(&mut span.left, v, Side::Right);
    }

    /// Adds the next corner down a chain of a piece and cuts off all triangles that have no room for later corners.
    fn add(&mut self, piece: &mut Piece, v: Corner, side: Side) {
        if piece.side != side {
            self.fan(piece, v);
            piece.corners.drain(..piece.corners.len() - 1);
            piece.side = side;
        }
        while let [.., a, b] = piece.corners[..] {
            let triangle = counter_clockwise([a, b, v.index], side);
            if orient(triangle.map(|i| self.points[i as usize])) <= 0.0 {
                break;
            }
            self.triangles.push(triangle);
            piece.corners.pop();
        }
        piece.corners.push(v.index);
    }

    /// Cuts the rest of a piece that ends in `v`.
    fn finish(&mut self, piece: Piece, v: Corner) {
        self.fan(&piece, v);
    }

    /// Cuts the triangles of `v` and each edge of the chain on the other side.
    fn fan(&mut self, piece: &Piece, v: Corner) {
        let triangles = piece.corners.windows(2).map(|edge| counter_clockwise([edge[0], edge[1], v.index], piece.side));
        self.triangles.extend(triangles);
    }
}

/// Orders two corners, downwards on one chain, and a third below them on the other.
fn counter_clockwise([a, b, v]: [u32; 3], side: Side) -> [u32; 3] {
    if side == Side::Left { [a, b, v] } else { [b, a, v] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn twice_area(points: &[DVec2]) -> f64 {
        (0..points.len()).map(|i| points[i].perp_dot(points[(i + 1) % points.len()])).sum()
    }

    /// A pseudo-random number in [0, 1).
    fn random(seed: usize) -> f64 {
        let mut x = (seed as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (x >> 11) as f64 / (1u64 << 53) as f64
    }

    fn check(name: &str, points: &[DVec2]) {
        for start in [0, points.len() / 3] {
            let mut points = points.to_vec();
            points.rotate_left(start);
            let triangles = cut(&points).unwrap_or_else(|| panic!("{name} is not cut"));
            assert_eq!(triangles.len(), points.len() - 2, "{name}");
            let twice = triangles.iter().map(|t| {
                let [a, b, c] = t.map(|i| points[i as usize]);
                (b - a).perp_dot(c - a)
            });
            assert!(triangles.iter().all(|t| orient(t.map(|i| points[i as usize])) >= 0.0), "{name}");
            let ratio = twice.sum::<f64>() / twice_area(&points);
            assert!((ratio - 1.0).abs() < 1e-9, "{name}: {ratio}");
        }
    }

    fn star(n: usize) -> Vec<DVec2> {
        let angle = |i: usize| std::f64::consts::TAU * i as f64 / n as f64;
        (0..n).map(|i| DVec2::from_angle(angle(i)) * [1.0, 0.5][i % 2]).collect()
    }

    fn comb(n: usize) -> Vec<DVec2> {
        let tooth = |i: usize| DVec2::new((n - i) as f64 / n as f64, (i % 2) as f64);
        (0..n - 1).map(tooth).chain([DVec2::new(0.5, -1.0)]).collect()
    }

    fn spiral(n: usize) -> Vec<DVec2> {
        let corner = |i: usize| {
            let (k, width) = if i <= n / 2 { (n / 2 - i, 0.02) } else { (i - n / 2, 0.0) };
            DVec2::from_angle(-0.01 * k as f64) * (1.0 + 1e-4 * k as f64 + width)
        };
        (0..n).map(corner).collect()
    }

    /// The way around a random tree of `width` x `height` cells: 4 corners for each. `jitter` up to 0.2.
    fn maze(width: usize, height: usize, jitter: f64) -> Vec<DVec2> {
        // Each cell is joined to the next above or on its right.
        let up = |x: usize, y: usize| y + 1 < height && (x + 1 == width || random(y * width + x) < 0.5);
        let right = |x: usize, y: usize| x + 1 < width && !up(x, y);
        let (mut x, mut y) = (0, 0);
        let mut points = Vec::new();
        for i in 0..4 * width * height {
            let offset = jitter * DVec2::new(2.0 * random(2 * i) - 1.0, 2.0 * random(2 * i + 1) - 1.0);
            points.push(DVec2::new(x as f64, y as f64) + offset);
            let (cx, cy) = (x / 2, y / 2);
            match (x % 2, y % 2) {
                (0, 0) if cy > 0 && up(cx, cy - 1) => y -= 1,
                (0, 0) => x += 1,
                (1, 0) if right(cx, cy) => x += 1,
                (1, 0) => y += 1,
                (1, 1) if up(cx, cy) => y += 1,
                (1, 1) => x -= 1,
                _ if cx > 0 && right(cx - 1, cy) => x -= 1,
                _ => y -= 1,
            }
        }
        assert_eq!((x, y), (0, 0));
        points
    }

    #[test]
    fn small_polygons() {
        for n in 3..40 {
            check("star", &star(2 * n));
            check("comb", &comb(2 * n));
            let radial =
                |i: usize| DVec2::from_angle(std::f64::consts::TAU * i as f64 / n as f64) * (0.1 + random(i + n * n));
            check("radial", &(0..n).map(radial).collect::<Vec<_>>());
        }
        for size in 1..14 {
            check("maze", &maze(size, 14 - size, 0.0));
            check("shaken maze", &maze(size, 14 - size, 0.2));
        }
    }

    #[test]
    fn two_hundred_thousand_corners() {
        let n = 200_000;
        check("star", &star(n));
        check("comb", &comb(n));
        check("spiral", &spiral(n));
        check("maze", &maze(250, 200, 0.0));
        check("shaken maze", &maze(250, 200, 0.2));
    }

    #[test]
    fn touching_polygons() {
        let polygon = |points: &[[f64; 2]]| points.iter().map(|&p| DVec2::from_array(p)).collect::<Vec<_>>();
        // A square with a square hole, which a slit joins to the outline.
        let ring = polygon(&[
            [0.0, 0.0],
            [3.0, 0.0],
            [3.0, 3.0],
            [0.0, 3.0],
            [0.0, 0.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [2.0, 2.0],
            [2.0, 1.0],
            [1.0, 1.0],
        ]);
        // A tip on a side.
        let tip = polygon(&[[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 0.0], [0.0, 2.0]]);
        // Two squares that meet in a corner.
        let squares =
            polygon(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0], [1.0, 1.0], [0.0, 1.0]]);
        let mut found = [0; 3];
        for (which, points) in [ring, tip, squares].into_iter().enumerate() {
            for turn in 0..4 {
                for start in 0..points.len() {
                    let mut points: Vec<DVec2> = points.iter().map(|&p| (0..turn).fold(p, |p, _| p.perp())).collect();
                    points.rotate_left(start);
                    if let Some(triangles) = cut(&points) {
                        found[which] += 1;
                        let twice: f64 = triangles.iter().map(|t| orient(t.map(|i| points[i as usize]))).sum();
                        assert_eq!(twice, twice_area(&points));
                    }
                }
            }
        }
        // Depends on where the polygon begins.
        assert!(found.into_iter().all(|count| count > 0), "{found:?}");
    }

    #[test]
    fn any_polygon_ends() {
        // Crossing and touching itself, with repeated and collinear corners.
        let mut found = 0;
        for n in 0..60 {
            for k in 0..100 {
                let place = |i: usize| (5.0 * random(i + 1000 * k)).floor();
                let points: Vec<DVec2> = (0..n).map(|i| DVec2::new(place(i), place(i + 100))).collect();
                if let Some(triangles) = cut(&points) {
                    found += 1;
                    let twice: f64 = triangles.iter().map(|t| orient(t.map(|i| points[i as usize]))).sum();
                    assert_eq!(twice, twice_area(&points));
                }
            }
        }
        assert!(found > 50, "{found}");
        assert_eq!(cut(&[DVec2::ZERO, DVec2::ONE, DVec2::X, DVec2::Y]), None);
        assert_eq!(cut(&[DVec2::ZERO, DVec2::Y, DVec2::X]), None);
    }
}
