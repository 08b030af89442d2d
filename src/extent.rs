//! The extent of what a view shows, in place of the scene's bounding box: one distant vertex changes nothing.
//!
//! Rays of a coarse grid of pixels, and from each of their hits one ray by the cosine law, find the surfaces that light
//! passes between. Of an atlas the rays start from points spread by area over the triangles that have texels. All lengths that nobody has set derive from them: the clip distance, the radius of photons, the offset
//! of ray origins, the grid by which points are sorted.

use std::collections::BTreeSet;

use glam::Vec3;

use crate::accel::{Bvh, Hit, Ray, offset_origin};
use crate::bsdf::basis;
use crate::path_trace::eye_ray;
use crate::sampling::halton::radical_inverse;
use crate::sampling::hammersley::hammersley;
use crate::scene::Camera;
use crate::view::{Atlas, View};

/// Columns and rows of the grid.
const GRID: [u32; 2] = [32, 24];

/// Fewer hits than this do not describe a view; the bounding box does.
const MIN_HITS: usize = 8;

/// The diagonal of a cube over the median length of rays by the cosine law between its faces.
const DIAGONAL: f32 = 2.6;

/// Sizes around the middle of the points beyond which their coordinates do not count: what is seen of a plane that reaches to the horizon
/// must not move the origins of rays in a room.
const REACH: f32 = 4.0;

/// Fraction of the points on either side that bounds leave out.
const OUTLIERS: f64 = 0.02;

/// The mean reflectivity is rounded to a multiple of this, so that it mostly stays the same while something moves.
const REFLECTIVITY_STEP: f32 = 0.125;

/// Lengths of what a view shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// 2.6 times the median length of rays by the cosine law between the surfaces, rounded up to a step of 2^(1/4): about
    /// the diagonal of a room.
    pub size: f32,
    /// Corners of a box around the surfaces, without the 2 % of the points farthest out along each axis.
    pub bounds: (Vec3, Vec3),
    /// Largest coordinate of the box, by magnitude, but at most that of the middle of the points plus four times the size, rounded up
    /// likewise; positions are rounded to its ulp. Points farther out are rounded to that of their own coordinates.
    pub scale: f32,
    /// Mean reflectivity (Keller 1997, 3.2) of the surfaces that these rays meet, rounded to eighths: the mean over RGB of kd + F0 as
    /// particles see it, textures by their average. Ideal reflection and transmission do not count, because they absorb particles. Keller
    /// weighs by area, so that a vast black plane that no light reaches would leave no particle alive.
    pub reflectivity: f32,
}

impl Extent {
    /// For the whole image of a view's camera, or the texels of an atlas. Deterministic. Cost: 1,536 rays.
    /// `albedos`: see [`crate::scene::Scene::mean_albedos`].
    pub fn of(bvh: &Bvh, albedos: &[f32], view: &View) -> Extent {
        let starts = match view {
            View::Camera { camera, .. } | View::GBuffer { camera } => seen(bvh, camera),
            View::Atlas(atlas) => texels(bvh, atlas),
        };
        Extent::between(bvh, albedos, &starts)
    }

    /// From points and their normals.
    fn between(bvh: &Bvh, albedos: &[f32], starts: &[(Vec3, Vec3)]) -> Extent {
        let mut points: Vec<Vec3> = starts.iter().map(|&(p, _)| p).collect();
        let (mut lengths, mut reflected) = (Vec::new(), 0.0f64);
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
                reflected += f64::from(albedos[bvh.material(hit.triangle) as usize]);
                points.push(bvh.position(&hit));
            }
        }
        if lengths.len() < MIN_HITS {
            return Extent { size: bvh.diagonal(), bounds: (bvh.min, bvh.max), scale: bvh.scale(), reflectivity: 0.5 };
        }
        lengths.sort_by(f32::total_cmp);
        let left_out = (points.len() as f64 * OUTLIERS) as usize;
        let along = |axis: usize| {
            let mut sorted: Vec<f32> = points.iter().map(|p| p[axis]).collect();
            sorted.sort_by(f32::total_cmp);
            [sorted[left_out], sorted[sorted.len() / 2], sorted[sorted.len() - 1 - left_out]]
        };
        let [x, y, z] = [0, 1, 2].map(along);
        let [low, middle, high] = [0, 1, 2].map(|i| Vec3::new(x[i], y[i], z[i]));
        let bounds = (low, high);
        let size = in_steps(DIAGONAL * lengths[lengths.len() / 2]);
        let farthest = low.abs().max(high.abs()).max_element();
        let scale = farthest.min(middle.abs().max_element() + REACH * size);
        let mean = (reflected / lengths.len() as f64) as f32;
        Extent {
            size,
            bounds,
            scale: in_steps(scale),
            reflectivity: (mean / REFLECTIVITY_STEP).round() * REFLECTIVITY_STEP,
        }
    }
}

/// A length rounded up to a step of 2^(1/4), so that it mostly stays the same while something moves.
fn in_steps(length: f32) -> f32 {
    let exponent = (4.0 * f64::from(length.max(f32::MIN_POSITIVE)).log2()).ceil() * 0.25;
    exponent.exp2() as f32
}

/// Points that a camera sees, and their normals on its side.
fn seen(bvh: &Bvh, camera: &Camera) -> Vec<(Vec3, Vec3)> {
    let [columns, rows] = GRID;
    let cells = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y]));
    cells
        .filter_map(|cell| {
            let at = |axis: usize| (cell[axis] as f32 + 0.5) / GRID[axis] as f32 * camera.resolution[axis] as f32;
            let ray = eye_ray(camera, camera.resolution, at(0), at(1));
            let hit = bvh.closest(&ray)?;
            let n = bvh.normal(hit.triangle);
            Some((bvh.position(&hit), if n.dot(ray.direction) > 0.0 { -n } else { n }))
        })
        .collect()
}

/// Points on the sides of triangles that have texels, and their normals, spread by area: texels that are many because they lie on many
/// small parts tell nothing of the lengths between the surfaces that light comes from.
fn texels(bvh: &Bvh, atlas: &Atlas) -> Vec<(Vec3, Vec3)> {
    let sides: BTreeSet<(u32, bool)> = atlas.texels.iter().flatten().map(|t| (t.triangle, t.back)).collect();
    let numbers = bvh.leaf_numbers();
    let at = |triangle: u32, [u, v]: [f32; 2]| bvh.position(&Hit { t: 0.0, u, v, triangle });
    let mut total = 0.0;
    // The sum of the areas up to each side, with its triangle.
    let sums: Vec<(f64, u32, bool)> = sides
        .into_iter()
        .filter_map(|(triangle, back)| {
            let &leaf = numbers.get(triangle as usize)?;
            let [a, b, c] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|uv| at(leaf, uv));
            total += f64::from((b - a).cross(c - a).length());
            Some((total, leaf, back))
        })
        .collect();
    let count = GRID[0] * GRID[1];
    let point = |i: u32| {
        let wanted = (f64::from(i) + 0.5) / f64::from(count) * total;
        let &(_, triangle, back) = sums.get(sums.partition_point(|(sum, ..)| *sum < wanted))?;
        let (root, along) = (radical_inverse(2, i).sqrt(), radical_inverse(3, i));
        let front = bvh.normal(triangle);
        let place = at(triangle, [root * (1.0 - along), root * along]);
        Some((place, if back { -front } else { front }))
    };
    (0..count).filter_map(point).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::scene::{Scene, Triangle, builtin};
    use crate::view::Texel;

    /// A room with its camera.
    fn room() -> (Scene, Camera) {
        let scene = builtin::room(2_000);
        let camera = scene.camera.unwrap();
        (scene, camera)
    }

    fn of_camera(scene: &Scene, bvh: &Bvh, camera: &Camera) -> Extent {
        Extent::of(bvh, &scene.mean_albedos(), &View::whole(*camera))
    }

    #[test]
    fn the_size_is_about_the_diagonal_of_a_room() {
        let (scene, camera) = room();
        let bvh = Bvh::build(&scene).unwrap();
        let extent = of_camera(&scene, &bvh, &camera);
        let ratio = extent.size / bvh.diagonal();
        assert!((0.4..1.3).contains(&ratio), "{ratio} of the diagonal");
        assert!(extent.scale <= 1.2 * bvh.scale() && extent.scale > 0.5 * bvh.scale(), "{extent:?}");
    }

    #[test]
    fn a_plane_beyond_the_walls_changes_nothing() {
        let (mut scene, camera) = room();
        let alone = of_camera(&scene, &Bvh::build(&scene).unwrap(), &camera);
        let (low, _) = scene.bounds();
        let first = scene.positions.len() as u32;
        let far = 2e6;
        let y = low.y - 1.0;
        scene.positions.extend([[-far, -far], [far, -far], [far, far], [-far, far]].map(|[x, z]| Vec3::new(x, y, z)));
        for vertices in [[0, 2, 1], [0, 3, 2]] {
            let mut triangle = scene.triangles[0];
            triangle.vertices = vertices.map(|v| first + v);
            scene.triangles.push(triangle);
        }
        scene.normals.resize(scene.positions.len(), Vec3::Y);
        let bvh = Bvh::build(&scene).unwrap();
        assert!(bvh.diagonal() > 1e6);
        assert_eq!(of_camera(&scene, &bvh, &camera), alone);
    }

    #[test]
    fn a_distant_plane_in_place_of_a_wall_leaves_the_lengths_of_the_room() {
        let (mut scene, camera) = room();
        let bvh = Bvh::build(&scene).unwrap();
        let alone = of_camera(&scene, &bvh, &camera);
        // The wall that the camera looks at goes, and a plane behind it falls away from the room.
        let forward = (camera.target - camera.eye).normalize();
        let wall = bvh.position(&bvh.closest(&Ray::new(camera.eye, forward)).unwrap());
        let axis = (0..3).max_by(|&i, &j| forward[i].abs().total_cmp(&forward[j].abs())).unwrap();
        let away = forward[axis].signum();
        let positions = scene.positions.clone();
        let edge = if away > 0.0 { bvh.max[axis] } else { bvh.min[axis] };
        scene
            .triangles
            .retain(|t| t.vertices.iter().any(|&v| (positions[v as usize][axis] - edge).abs() > 1e-3 * alone.size));
        let (first, far) = (scene.positions.len() as u32, 1e6 * alone.size);
        let along = |x: f32, y: f32, z: f32| {
            let mut p = wall;
            p[axis] += away * z;
            p[(axis + 1) % 3] += x;
            p[(axis + 2) % 3] += y;
            p
        };
        scene.positions.extend([along(-far, -far, far), along(far, -far, 0.5 * far), along(0.0, far, 2.0 * far)]);
        scene.normals.resize(scene.positions.len(), Vec3::Y);
        scene.triangles.push(Triangle { vertices: [first, first + 1, first + 2], ..scene.triangles[0] });
        let extent = of_camera(&scene, &Bvh::build(&scene).unwrap(), &camera);
        let seen = extent.bounds.0.abs().max(extent.bounds.1.abs()).max_element();
        assert!(seen > 1e4 * alone.size, "the plane is not seen: {extent:?}");
        assert!(extent.size < 4.0 * alone.size && extent.scale < 16.0 * alone.scale, "{extent:?} for {alone:?}");
    }

    #[test]
    fn many_texels_on_a_small_part_change_nothing() {
        let (mut scene, _) = room();
        let texel = |triangle: u32| Some(Texel { triangle, uv: [1.0 / 3.0; 2], back: false });
        let walls: Vec<_> = (0..scene.triangles.len() as u32).map(texel).collect();
        let of = |scene: &Scene, texels: Vec<Option<Texel>>| {
            let view = View::Atlas(Arc::new(Atlas::new([texels.len() as u32, 1], texels)));
            Extent::of(&Bvh::build(scene).unwrap(), &scene.mean_albedos(), &view)
        };
        let alone = of(&scene, walls.clone());
        // Two sheets that face each other.
        let (low, high) = scene.bounds();
        let width = 1e-3 * (high - low).max_element();
        for side in [-1.0, 1.0] {
            let first = scene.positions.len() as u32;
            let corner = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
            scene.positions.extend(corner.map(|[x, z]| 0.5 * (low + high) + width * Vec3::new(x, 0.5 * side, z)));
            let turned = if side < 0.0 { [0, 2, 1] } else { [0, 1, 2] };
            scene.triangles.push(Triangle { vertices: turned.map(|v| first + v), ..scene.triangles[0] });
        }
        scene.normals.resize(scene.positions.len(), Vec3::Y);
        let sheets = (0..10_000).map(|i| texel((walls.len() + i % 2) as u32));
        assert_eq!(of(&scene, walls.iter().copied().chain(sheets).collect()).size, alone.size);
    }

    #[test]
    fn reflectivity_is_that_of_the_surfaces_that_rays_meet() {
        let scene = builtin::furnace(0.3, 1.0);
        let camera = scene.camera.unwrap_or(Camera { eye: Vec3::ZERO, target: Vec3::X, ..room().1 });
        let extent = of_camera(&scene, &Bvh::build(&scene).unwrap(), &camera);
        assert_eq!(extent.reflectivity, 0.25, "0.3 in eighths");
    }

    #[test]
    fn a_view_of_nothing_has_the_extent_of_the_scene() {
        let (scene, camera) = room();
        let bvh = Bvh::build(&scene).unwrap();
        let away = Camera { eye: bvh.max * 3.0, target: bvh.max * 4.0, ..camera };
        let extent = of_camera(&scene, &bvh, &away);
        assert_eq!((extent.size, extent.bounds), (bvh.diagonal(), (bvh.min, bvh.max)));
    }

    #[test]
    fn steps_are_rounded_up() {
        for (length, expected) in [(1.0, 1.0), (1.01, 2f32.powf(0.25)), (0.5, 0.5), (1e-30, 1e-30)] {
            let ratio = in_steps(length) / expected;
            assert!((0.999..1.19).contains(&ratio), "{length}: {ratio}");
        }
    }
}
