//! The extent of what a view shows, in place of the scene's bounding box: one distant vertex changes nothing.
//!
//! Rays of a coarse grid of pixels, and from each of their hits one ray by the cosine law, find the surfaces that light
//! passes between. All lengths that nobody has set derive from them: the clip distance, the radius of photons, the offset
//! of ray origins, the grid by which points are sorted.

use glam::Vec3;

use crate::accel::{Bvh, Hit, Ray, offset_origin};
use crate::bsdf::basis;
use crate::path_trace::camera_direction;
use crate::sampling::hammersley::hammersley;
use crate::scene::Camera;
use crate::view::{Atlas, View};

/// Columns and rows of the grid.
const GRID: [u32; 2] = [32, 24];

/// Fewer hits than this do not describe a view; the bounding box does.
const MIN_HITS: usize = 8;

/// The diagonal of a cube over the median length of rays by the cosine law between its faces.
const DIAGONAL: f32 = 2.6;

/// Fraction of the points on either side that bounds leave out.
const OUTLIERS: f64 = 0.02;

/// Lengths of what a view shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// 2.6 times the median length of rays by the cosine law between the surfaces: the diagonal of a room as high as wide.
    pub size: f32,
    /// Corners of a box around the surfaces, without the 2 % of the points farthest out along each axis.
    pub bounds: (Vec3, Vec3),
    /// Largest coordinate of the box, by magnitude; positions are rounded to its ulp.
    pub scale: f32,
}

impl Extent {
    /// For the whole image of a view's camera, or the texels of an atlas. Deterministic. Cost: 1,536 rays.
    pub fn of(bvh: &Bvh, view: &View) -> Extent {
        let starts = match view {
            View::Camera { camera, .. } => seen(bvh, camera),
            View::Atlas(atlas) => texels(bvh, atlas),
        };
        Extent::between(bvh, &starts)
    }

    /// For the whole image of a camera.
    pub fn of_camera(bvh: &Bvh, camera: &Camera) -> Extent {
        Extent::between(bvh, &seen(bvh, camera))
    }

    /// From points and their normals.
    fn between(bvh: &Bvh, starts: &[(Vec3, Vec3)]) -> Extent {
        let mut points: Vec<Vec3> = starts.iter().map(|&(p, _)| p).collect();
        let mut lengths = Vec::new();
        for (i, &(p, n)) in (0..).zip(starts) {
            let (t, b) = basis(n);
            let [u, v] = hammersley(i, starts.len() as u32);
            let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
            let direction = (t * cos + b * sin) * u.sqrt() + n * (1.0 - u).sqrt();
            let ray = Ray::new(offset_origin(p, n, 0.0), direction);
            // The rounding of a distant start may let a ray meet its own surface.
            let near = p.abs().max_element() * 1e-5;
            if let Some(hit) = bvh.closest(&ray).filter(|hit| hit.t > near) {
                lengths.push(hit.t);
                points.push(bvh.position(&hit));
            }
        }
        if lengths.len() < MIN_HITS {
            return Extent { size: bvh.diagonal(), bounds: (bvh.min, bvh.max), scale: bvh.scale() };
        }
        lengths.sort_by(f32::total_cmp);
        let left_out = (points.len() as f64 * OUTLIERS) as usize;
        let along = |axis: usize| {
            let mut sorted: Vec<f32> = points.iter().map(|p| p[axis]).collect();
            sorted.sort_by(f32::total_cmp);
            (sorted[left_out], sorted[sorted.len() - 1 - left_out])
        };
        let [x, y, z] = [0, 1, 2].map(along);
        let bounds = (Vec3::new(x.0, y.0, z.0), Vec3::new(x.1, y.1, z.1));
        let scale = bounds.0.abs().max(bounds.1.abs()).max_element();
        Extent { size: DIAGONAL * lengths[lengths.len() / 2], bounds, scale }
    }
}

/// Points that a camera sees, and their normals on its side.
fn seen(bvh: &Bvh, camera: &Camera) -> Vec<(Vec3, Vec3)> {
    let [columns, rows] = GRID;
    let cells = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y]));
    cells
        .filter_map(|cell| {
            let at = |axis: usize| (cell[axis] as f32 + 0.5) / GRID[axis] as f32 * camera.resolution[axis] as f32;
            let ray = Ray::new(camera.eye, camera_direction(camera, camera.resolution, at(0), at(1)));
            let hit = bvh.closest(&ray)?;
            let n = bvh.normal(hit.triangle);
            Some((bvh.position(&hit), if n.dot(ray.direction) > 0.0 { -n } else { n }))
        })
        .collect()
}

/// Points of some texels, and their normals.
fn texels(bvh: &Bvh, atlas: &Atlas) -> Vec<(Vec3, Vec3)> {
    let texels: Vec<_> = atlas.texels.iter().flatten().collect();
    let step = (texels.len() / (GRID[0] * GRID[1]) as usize).max(1);
    let chosen: Vec<_> = texels.into_iter().step_by(step).collect();
    let numbers: std::collections::HashMap<u32, u32> =
        (0..bvh.triangle_count()).map(|triangle| (bvh.scene_triangle(triangle), triangle)).collect();
    chosen
        .into_iter()
        .filter_map(|texel| {
            let &triangle = numbers.get(&texel.triangle)?;
            let hit = Hit { t: 0.0, u: texel.uv[0], v: texel.uv[1], triangle };
            Some((bvh.position(&hit), bvh.normal(triangle)))
        })
        .collect()
}
