//! The camera of a scene without one.

use glam::Vec3;

use super::{Camera, Scene};

/// A flat thing that is larger by this factor than all that is smaller is the ground.
const GROUND: f32 = 4.0;

/// A thing that is not flat is a backdrop if it is larger by this factor; and what lies farther away by it is a stray.
const BACKDROP: f32 = 20.0;

/// Least number of triangles that a picture is about: those of a cube.
const LEAST: usize = 12;

/// Height of the ground at most, as a share of its extent.
const FLAT: f32 = 0.05;

/// Share of triangles on either side of an axis that may be strays.
const STRAYS: f32 = 0.01;

/// A box: its lowest and highest corner.
type Bounds = (Vec3, Vec3);

fn joined(a: Bounds, b: Bounds) -> Bounds {
    (a.0.min(b.0), a.1.max(b.1))
}

fn diagonal((low, high): Bounds) -> f32 {
    (high - low).length()
}

const EMPTY: Bounds = (Vec3::INFINITY, Vec3::NEG_INFINITY);

impl Scene {
    /// Indices of the triangles that a picture of the scene is about: without a ground or backdrop that is much larger than everything
    /// else, and without strays far away.
    pub fn subject(&self) -> Vec<u32> {
        let bounds = |&i: &u32| {
            let corners = self.triangle_positions(i as usize);
            corners.into_iter().fold(EMPTY, |b, p| joined(b, (p, p)))
        };
        let all: Vec<u32> = (0..self.triangles.len() as u32).collect();
        // The ground as an object of many triangles, then as a few triangles of any object.
        let mut objects: Vec<(Vec<u32>, Bounds)> = vec![(Vec::new(), EMPTY); self.objects.len()];
        for i in all {
            let (triangles, of_object) = &mut objects[self.triangles[i as usize].object as usize];
            triangles.push(i);
            *of_object = joined(*of_object, bounds(&i));
        }
        objects.retain(|(triangles, _)| !triangles.is_empty());
        let kept = without_surroundings(objects, Vec::len).into_iter().flat_map(|(triangles, _)| triangles);
        let kept = without_surroundings(kept.map(|i| (i, bounds(&i))).collect(), |_| 1);
        without_strays(kept).into_iter().map(|(i, _)| i).collect()
    }

    /// A camera that shows [`Scene::subject`] from [`Camera::ORBIT`], or as [`Camera::around`] from another side.
    pub fn framed(&self, resolution: [u32; 2], orbit: Option<[f32; 2]>) -> Camera {
        let subject = self.subject();
        let points = subject.iter().flat_map(|&i| self.triangle_positions(i as usize));
        Camera::around(points, resolution, orbit.unwrap_or(Camera::ORBIT))
    }
}

/// Leaves out the largest things if they are few and much larger than the box of the others: by less if together they are flat. `count`:
/// triangles of a thing.
fn without_surroundings<T>(mut things: Vec<(T, Bounds)>, count: impl Fn(&T) -> usize) -> Vec<(T, Bounds)> {
    things.sort_by(|a, b| diagonal(a.1).total_cmp(&diagonal(b.1)));
    let mut larger = vec![EMPTY; things.len() + 1];
    for k in (0..things.len()).rev() {
        larger[k] = joined(larger[k + 1], things[k].1);
    }
    let (mut smaller, mut triangles) = (EMPTY, 0);
    let mut keep = things.len();
    for k in 1..things.len() {
        smaller = joined(smaller, things[k - 1].1);
        triangles += count(&things[k - 1].0);
        let few = 2 * (things.len() - k) <= k + 3 && triangles >= LEAST;
        let extent = larger[k].1 - larger[k].0;
        let factor = if extent.min_element() <= FLAT * extent.max_element() { GROUND } else { BACKDROP };
        if few && diagonal(smaller) > 0.0 && diagonal(things[k].1) > factor * diagonal(smaller) {
            keep = k;
        }
    }
    things.truncate(keep);
    things
}

/// Leaves out triangles that are far from nearly all others.
fn without_strays(triangles: Vec<(u32, Bounds)>) -> Vec<(u32, Bounds)> {
    let whole = triangles.iter().fold(EMPTY, |b, t| joined(b, t.1));
    let aside = (STRAYS * triangles.len() as f32) as usize;
    if aside == 0 {
        return triangles;
    }
    let mut core = EMPTY;
    for axis in 0..3 {
        let mut places: Vec<f32> = triangles.iter().map(|t| 0.5 * (t.1.0[axis] + t.1.1[axis])).collect();
        places.sort_by(f32::total_cmp);
        (core.0[axis], core.1[axis]) = (places[aside], places[places.len() - 1 - aside]);
    }
    let reach = diagonal(core);
    if !(reach > 0.0 && diagonal(whole) > BACKDROP * reach) {
        return triangles;
    }
    let near = |t: &(u32, Bounds)| t.1.0.cmpge(core.0 - reach).all() && t.1.1.cmple(core.1 + reach).all();
    triangles.into_iter().filter(near).collect()
}

impl Camera {
    /// Azimuth and elevation, degrees, from which a model without a camera is seen: its front in glTF, from a little above.
    pub const ORBIT: [f32; 2] = [20.0, 20.0];

    /// A camera whose image is filled by some points. `orbit`: azimuth from positive z towards positive x and elevation towards positive
    /// y of the camera as seen from them, degrees.
    pub fn around(points: impl Iterator<Item = Vec3> + Clone, resolution: [u32; 2], orbit: [f32; 2]) -> Camera {
        /// Vertical angle of view, degrees.
        const FOV: f32 = 45.0;
        /// Margin around the points.
        const MARGIN: f32 = 1.1;
        let (low, high) = points.clone().fold(EMPTY, |b, p| joined(b, (p, p)));
        let middle = 0.5 * (low + high);
        let [(sin_a, cos_a), (sin_e, cos_e)] = orbit.map(|angle| angle.to_radians().sin_cos());
        let back = Vec3::new(sin_a * cos_e, sin_e, cos_a * cos_e);
        let up = Vec3::new(-sin_a * sin_e, cos_e, -cos_a * sin_e);
        let right = up.cross(back);
        let tan_y = (0.5 * FOV.to_radians()).tan() / MARGIN;
        let tan_x = tan_y * resolution[0] as f32 / resolution[1] as f32;
        // How far the planes through the eye and the edges of the image must lie outwards, to the right, left, top and bottom.
        let mut sides = [f32::NEG_INFINITY; 4];
        let mut front = f32::NEG_INFINITY;
        for p in points {
            let p = p - middle;
            let (x, y, z) = (p.dot(right), p.dot(up), p.dot(back));
            let of_point = [x + tan_x * z, -x + tan_x * z, y + tan_y * z, -y + tan_y * z];
            for (side, outwards) in sides.iter_mut().zip(of_point) {
                *side = side.max(outwards);
            }
            front = front.max(z);
        }
        let [r, l, t, b] = sides;
        // Even a pointlike thing is viewed from a distance above 0.
        let least = front + (0.05 * (high - low).length()).max(f32::MIN_POSITIVE);
        let distance = ((r + l) / (2.0 * tan_x)).max((t + b) / (2.0 * tan_y)).max(least);
        let target = middle + right * (0.5 * (r - l)) + up * (0.5 * (t - b));
        Camera {
            eye: target + distance * back,
            target,
            up,
            fov_y: FOV,
            resolution,
            aperture: 0.0,
            focus: None,
            shutter: 0.0,
            height: None,
            frustum: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Triangle};

    fn corners((low, high): Bounds) -> impl Iterator<Item = Vec3> + Clone {
        (0..8).map(move |corner: u32| {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
            Vec3::new(pick(0), pick(1), pick(2))
        })
    }

    #[test]
    fn the_whole_box_is_seen_and_fills_the_image() {
        for bounds in [
            (Vec3::new(-1.0, -2.0, -3.0), Vec3::new(5.0, 2.0, 7.0)),
            (Vec3::new(1e4, 0.0, 0.0), Vec3::new(1.5e4, 1.0, 1.0)),
            (Vec3::ZERO, Vec3::new(0.0, 0.01, 3.0)),
        ] {
            for resolution in [[640, 480], [100, 900]] {
                for orbit in [Camera::ORBIT, [0.0, 0.0], [200.0, -35.0], [90.0, 90.0]] {
                    let camera = Camera::around(corners(bounds), resolution, orbit);
                    let (right, up, forward) = camera.world_from_camera();
                    let tan_y = (0.5 * camera.fov_y.to_radians()).tan();
                    let tan_x = tan_y * resolution[0] as f32 / resolution[1] as f32;
                    let mut used = [0.0f32; 2];
                    for corner in corners(bounds) {
                        let to = corner - camera.eye;
                        let (x, y, z) = (to.dot(right), to.dot(up), to.dot(forward));
                        used = [used[0].max(x.abs() / (z * tan_x)), used[1].max(y.abs() / (z * tan_y))];
                        assert!(z > 0.0, "{bounds:?} {orbit:?}");
                    }
                    // The margin is a tenth, but for a stick that is seen from its end.
                    let fills = used[0].max(used[1]);
                    assert!(
                        fills < 0.95 && (fills > 0.8 || orbit[0] == 0.0 || orbit[0] == 90.0),
                        "{fills} {bounds:?} {orbit:?}"
                    );
                }
            }
        }
    }

    /// Adds a box as one object, each face of `n` x `n` quads.
    fn add(scene: &mut Scene, (low, high): Bounds, n: u32) {
        let object = scene.add_object(String::from("box"));
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for (side, [i, j]) in (0..2 * n * n).map(|k| (k / (n * n), [k % n, k / n % n])) {
                let at = |i: u32, j: u32| {
                    let mut p = if side == 0 { low } else { high };
                    p[u] = low[u] + (high - low)[u] * i as f32 / n as f32;
                    p[v] = low[v] + (high - low)[v] * j as f32 / n as f32;
                    p
                };
                let first = scene.positions.len() as u32;
                scene.positions.extend([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                for vertices in [[0, 1, 2], [0, 2, 3]] {
                    let vertices = vertices.map(|k| first + k);
                    scene.triangles.push(Triangle { vertices, material: 0, object, smooth: false });
                }
            }
        }
    }

    /// The box of the subject of a scene of boxes with faces of n x n quads; `together`: as one object.
    fn subject(boxes: &[(Bounds, u32)], together: bool) -> Bounds {
        let mut scene = Scene { materials: vec![Material::default()], ..Scene::default() };
        for &(bounds, n) in boxes {
            add(&mut scene, bounds, n);
        }
        if together {
            scene.triangles.iter_mut().for_each(|t| t.object = 0);
        }
        let points = scene.subject().into_iter().flat_map(|i| scene.triangle_positions(i as usize));
        points.fold(EMPTY, |b, p| joined(b, (p, p)))
    }

    #[test]
    fn grounds_backdrops_and_strays_are_left_out() {
        let thing = (Vec3::ZERO, Vec3::new(1.0, 2.0, 1.0));
        let ground = (Vec3::new(-50.0, -0.1, -50.0), Vec3::new(50.0, 0.0, 50.0));
        let dome = (Vec3::splat(-500.0), Vec3::splat(500.0));
        let room = (Vec3::splat(-5.0), Vec3::splat(5.0));
        let far = (Vec3::splat(3e4), Vec3::splat(3e4 + 1.0));
        for together in [false, true] {
            assert_eq!(subject(&[(thing, 4), (ground, 1)], together), thing);
            assert_eq!(subject(&[(dome, 1), (thing, 4), (ground, 1)], together), thing);
            assert_eq!(subject(&[(thing, 4), (room, 1)], together), room, "a room is no ground");
            assert_eq!(subject(&[(thing, 40), (far, 1)], together), thing);
            assert_eq!(subject(&[(thing, 4)], together), thing);
        }
        // A ground of many triangles is an object.
        assert_eq!(subject(&[(thing, 4), (ground, 100)], false), thing);
        // Two things alike, far apart, are both shown.
        assert_eq!(subject(&[(thing, 4), (far, 4)], false), joined(thing, far));
        // A plane alone.
        assert_eq!(subject(&[(ground, 1)], false), ground);
    }
}
