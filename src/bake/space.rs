//! The space that light reaches: cells of a grid, from those before lit sides through all whose centres see one another.
//!
//! A large side, such as a floor, is lit as a whole if a part of it is, and what stands on it sees it from within. The space inside a
//! closed body joins no lit one, so its sides stay dark.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use crate::accel::{Bvh, Ray};
use crate::scene::Scene;

/// Cells that the box around the scene has, about.
const CELLS: f32 = (1 << 18) as f32;
/// Most cells along an axis.
const MOST: i32 = 1 << 12;

/// The space that light reaches.
pub(super) struct Space<'a> {
    bvh: &'a Bvh,
    low: Vec3,
    /// Width of a cell.
    width: f32,
    size: IVec3,
    reached: Vec<AtomicBool>,
}

impl<'a> Space<'a> {
    /// The space around points that light reaches.
    pub fn new(bvh: &'a Bvh, scene: &Scene, points: &[Vec3]) -> Space<'a> {
        let low = scene.positions.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = scene.positions.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        // A flat scene is a cell high, and a long one has no more cells than fit along an axis.
        let extent = (high - low).max(Vec3::splat((high - low).max_element() / 64.0)).max(Vec3::splat(1e-30));
        let width = (extent.element_product() / CELLS).cbrt().max(extent.max_element() / MOST as f32);
        // A ring of cells around the scene.
        let size = (extent / width).ceil().as_ivec3() + 2;
        let count = size.as_usizevec3().element_product();
        let reached = (0..count).map(|_| AtomicBool::new(false)).collect();
        let space = Space { bvh, low: low - width, width, size, reached };
        space.fill(points);
        space
    }

    fn index(&self, cell: IVec3) -> Option<usize> {
        let fits = cell.cmpge(IVec3::ZERO).all() && cell.cmplt(self.size).all();
        fits.then(|| (cell.x + self.size.x * (cell.y + self.size.y * cell.z)) as usize)
    }

    fn cell(&self, point: Vec3) -> IVec3 {
        // Those beyond the grid lie just beyond it.
        let cell = ((point - self.low) / self.width).floor();
        cell.clamp(Vec3::splat(-2.0), self.size.as_vec3() + 1.0).as_ivec3()
    }

    fn centre(&self, cell: IVec3) -> Vec3 {
        self.low + (cell.as_vec3() + 0.5) * self.width
    }

    fn sees(&self, from: Vec3, cell: IVec3) -> bool {
        !self.bvh.occluded(&Ray::between(from, self.centre(cell)))
    }

    /// Marks a cell that a point sees; whether it was not marked before.
    fn mark(&self, from: Vec3, cell: IVec3) -> bool {
        self.index(cell).is_some_and(|i| {
            !self.reached[i].load(Relaxed) && self.sees(from, cell) && !self.reached[i].swap(true, Relaxed)
        })
    }

    fn fill(&self, points: &[Vec3]) {
        let first = |point: &Vec3| Some(self.cell(*point)).filter(|cell| self.mark(*point, *cell));
        let mut front: Vec<IVec3> = points.par_iter().filter_map(first).collect();
        const AROUND: [IVec3; 6] = [IVec3::X, IVec3::Y, IVec3::Z, IVec3::NEG_X, IVec3::NEG_Y, IVec3::NEG_Z];
        while !front.is_empty() {
            let next = |cell: &IVec3| {
                let (cell, centre) = (*cell, self.centre(*cell));
                AROUND.into_iter().map(move |to| cell + to).filter(move |to| self.mark(centre, *to))
            };
            front = front.par_iter().flat_map_iter(next).collect();
        }
    }

    /// Whether a point sees one of the eight nearest centres of cells, if that is in this space.
    pub fn reaches(&self, point: Vec3) -> bool {
        let corner = self.cell(point - 0.5 * self.width);
        let near = (0..8).map(|i| corner + IVec3::new(i & 1, i >> 1 & 1, i >> 2));
        let mut reached = near.filter(|cell| self.index(*cell).is_some_and(|i| self.reached[i].load(Relaxed)));
        reached.any(|cell| self.sees(point, cell))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Triangle};

    /// A box without a face, if one is named by its number.
    fn add_box(scene: &mut Scene, low: Vec3, size: Vec3, without: Option<usize>) {
        for face in (0..6).filter(|face| Some(*face) != without) {
            let axis = face / 2;
            let side = |k: usize| Vec3::AXES[(axis + k) % 3] * size;
            let corner = low + if face % 2 == 1 { side(0) } else { Vec3::ZERO };
            let n = scene.positions.len() as u32;
            scene.positions.extend([corner, corner + side(1), corner + side(1) + side(2), corner + side(2)]);
            for vertices in [[n, n + 1, n + 2], [n, n + 2, n + 3]] {
                scene.triangles.push(Triangle { vertices, material: 0, object: 0, smooth: false });
            }
        }
        scene.normals.resize(scene.positions.len(), Vec3::X);
        scene.uvs.resize(scene.positions.len(), glam::Vec2::ZERO);
    }

    #[test]
    fn light_reaches_through_gaps_and_not_into_bodies() {
        let mut scene = Scene { materials: vec![Material::default()], ..Scene::default() };
        add_box(&mut scene, Vec3::ZERO, Vec3::splat(4.0), None);
        // On the floor, without a bottom; and one that is open above.
        add_box(&mut scene, Vec3::new(1.0, 0.0, 1.0), Vec3::new(0.5, 1.0, 0.5), Some(2));
        add_box(&mut scene, Vec3::new(2.5, 0.0, 1.0), Vec3::new(0.5, 1.0, 0.5), Some(3));
        let bvh = Bvh::build(&scene).unwrap();
        let space = Space::new(&bvh, &scene, &[Vec3::new(3.9, 3.9, 3.9)]);
        assert!(space.reaches(Vec3::new(0.01, 0.01, 0.01)));
        assert!(space.reaches(Vec3::new(2.51, 0.01, 1.01)));
        for point in [[1.25, 0.5, 1.25], [1.01, 0.01, 1.01], [1.49, 0.99, 1.49], [-0.01, 1.0, 1.0]] {
            assert!(!space.reaches(Vec3::from_array(point)), "{point:?}");
        }
        // No light, no space; a point outside of the grid is in none.
        assert!(!Space::new(&bvh, &scene, &[]).reaches(Vec3::splat(3.0)));
        assert!(!space.reaches(Vec3::splat(1e9)));
    }
}
