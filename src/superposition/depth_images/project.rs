//! The images that a frame reprojects, and how (Bastos 1999, sections 6.6.2 to 6.6.4).
//!
//! The eye and its axes are mirrored in the plane of the reflector. A point q = P - eye' of an image lies at the pixel
//!
//! ```text
//! (X / Z, Y / Z),   X = w/2 (q.r + q.f),   Y = h/2 (q.f - q.u),   Z = q.f
//! ```
//!
//! for an image centred on the view direction, with f the mirrored view direction, r and u its axes over the half width and height of the image at unit distance, and w and h in
//! pixels. P is affine in (z x, z y, z), see [`super`], so that X, Y and Z are dot products with (z x, z y, z, 1): the product of the
//! current transformation and the inverse one of the image.
//!
//! **Point size** (equation 6.5), for the points of a leaf of the quadtree from its centroid. A point is a parallelogram of the surface,
//! whose edges are the steps to the next points in its row and column. An edge e of a surface parallel to the mirror has the length
//! depth |du|, and its image that of
//!
//! ```text
//! size = distanceScale directional / window = (depth |du|) / (Z p) sqrt(1 - (d.X)^2)
//! ```
//!
//! to first order, with depths measured along the axes of both views, p the edge of a pixel of the frame at unit distance, so that `window`
//! includes the ratio of the focal lengths, d the direction from the mirrored eye to the centroid, and X that of the edge. Both edges are
//! projected exactly. The point covers the pixels in their parallelogram, [`WIDENING`] times as wide, since edges differ within a node. The
//! box around it is cut off at [`MAX_POINT`]. Of
//! points whose edges are shorter than a pixel only every 2^k-th in both axes is taken, so that those left are as long as the pixel at most
//! (program 6.16).
//!
//! Differs from the thesis in that: `directional` as printed is the dot product d.X, which vanishes where the image is seen head on; points are
//! parallelograms and not squares of the screen, which overlap, so that the nearest of them shift the image; edges lie in the surface, since on walls that stand on the mirror squares parallel to it leave gaps, through which farther walls show; the
//! view direction of the selection is that towards the element's centre, since at the edge of a wide view the images of the view's own
//! direction look past the element; the step of the points is that of a node and not of the image.

use glam::{DVec2, DVec3, Vec3};

use super::quadtree::{Node, TILE};
use super::{DepthImages, Hemisphere, Pose};
use crate::pass::layout::{DepthTile, DepthView, FrameParameters};
use crate::settings::{ImageChoice, MirrorImages};

/// Largest width and height of a point in pixels. Of larger ones pixels stay open, and rays fill them.
pub const MAX_POINT: u32 = 16;

/// By how much of a pixel a point may be smaller than its edges say: rounding must not add a pixel to each point.
const SLACK: f64 = 1.0 / 64.0;

/// By how much parallelograms are wider than their edges say.
pub const WIDENING: f64 = 1.2;

/// How far beyond the edge of the view points count as seen, as a part of its width and height: they cover pixels inside.
const MARGIN: f64 = 0.05;

/// An eye with its axes.
#[derive(Clone, Copy, Debug)]
pub struct Viewer {
    eye: DVec3,
    /// Half width, half height and direction of the view.
    axes: [DVec3; 3],
    size: [f64; 2],
    /// That of the frame.
    shift: [f64; 2],
}

impl Viewer {
    /// That of a frame.
    pub fn of(frame: &FrameParameters) -> Viewer {
        let xyz = |v: [f32; 4]| Vec3::new(v[0], v[1], v[2]).as_dvec3();
        let [width, height, ..] = frame.size.map(f64::from);
        let [across, upwards, ..] = frame.shift.map(f64::from);
        let axes = [frame.right, frame.up, frame.forward].map(xyz);
        Viewer { eye: xyz(frame.eye), axes, size: [width, height], shift: [across, upwards] }
    }

    /// Mirrored in a plane.
    pub fn mirrored(&self, (normal, offset): (Vec3, f32)) -> Viewer {
        let n = normal.as_dvec3();
        let eye = self.eye - 2.0 * (n.dot(self.eye) - f64::from(offset)) * n;
        Viewer { eye, axes: self.axes.map(|v| v - 2.0 * n.dot(v) * n), ..*self }
    }

    /// The eye.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// X, Y and Z of a vector from the eye.
    pub fn project(&self, q: DVec3) -> DVec3 {
        let [right, up, forward] = self.axes;
        let [x, y, z] = [q.dot(right) / right.length_squared(), q.dot(up) / up.length_squared(), q.dot(forward)];
        let [across, upwards] = self.shift;
        DVec3::new(0.5 * self.size[0] * (x + (1.0 - across) * z), 0.5 * self.size[1] * ((1.0 + upwards) * z - y), z)
    }

    /// Whether points that are the corners of a convex body may be seen.
    fn may_see(&self, corners: &[Vec3]) -> bool {
        let places: Vec<DVec3> = corners.iter().map(|c| self.project(c.as_dvec3() - self.eye)).collect();
        let [width, height] = self.size;
        let outside: [&dyn Fn(&DVec3) -> bool; 5] = [
            &|p| p.z <= 0.0,
            &|p| p.x < -MARGIN * width * p.z,
            &|p| p.x > (1.0 + MARGIN) * width * p.z,
            &|p| p.y < -MARGIN * height * p.z,
            &|p| p.y > (1.0 + MARGIN) * height * p.z,
        ];
        !outside.iter().any(|outside| places.iter().all(outside))
    }

    /// The edges of the points of a node in pixels.
    pub fn point_edges(&self, node: &Node) -> [DVec2; 2] {
        let q = node.centroid.as_dvec3() - self.eye;
        let center = self.project(q);
        node.steps.map(|step| {
            let step = self.project(step.as_dvec3());
            // The derivative of (X / Z, Y / Z).
            let edge = (step.truncate() - step.z * center.truncate() / center.z) / center.z;
            if center.z > 0.0 { edge } else { DVec2::INFINITY }
        })
    }
}

/// Width and height in pixels, and step, of points with these edges.
pub fn rounded(edges: [DVec2; 2]) -> [u32; 3] {
    let longest = edges.map(DVec2::length).into_iter().fold(1.0 / 1024.0, f64::max);
    // As far as whole images may be one point.
    let step = (1.0 / longest).log2().floor().max(0.0).exp2();
    let extent = WIDENING * (edges[0].abs() + edges[1].abs());
    let [width, height] = extent.to_array().map(|x| (x * step - SLACK).ceil().clamp(1.0, f64::from(MAX_POINT)) as u32);
    [width, height, step as u32]
}

/// The matrix, row by row, by which an offset in pixels from a point has coordinates along these edges times `step`, which are at most 1 in
/// the parallelogram of the point. Zero if the edges have no area: the point then covers its box.
pub fn coordinates([u, v]: [DVec2; 2], step: u32) -> [f32; 4] {
    let scale = 2.0 / (WIDENING * f64::from(step) * u.perp_dot(v));
    let rows = [v.y, -v.x, -u.y, u.x].map(|x| (scale * x) as f32);
    if rows.iter().all(|x| x.is_finite()) { rows } else { [0.0; 4] }
}

/// The images and tiles of a frame.
#[derive(Clone, Debug, Default)]
pub struct Projection {
    /// The images.
    pub views: Vec<DepthView>,
    /// Tiles of their points.
    pub tiles: Vec<DepthTile>,
}

/// The numbers of the images of a hemisphere that fit the mirrored eye, best first: poses in the order of [`Hemisphere::poses`].
pub fn select(hemisphere: &Hemisphere, eye: DVec3, choice: ImageChoice, count: u32) -> Vec<usize> {
    let center = hemisphere.element.center().as_dvec3();
    let towards = (center - eye).normalize_or_zero();
    let far = |pose: &Pose| match choice {
        ImageChoice::Angle => 1.0 - (center - pose.cop.as_dvec3()).normalize_or_zero().dot(towards),
        ImageChoice::Distance => pose.cop.as_dvec3().distance(eye),
    };
    let mut order: Vec<(f64, usize)> = hemisphere.poses.iter().map(far).zip(0..).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    order.into_iter().take(count as usize).map(|(_, i)| i).collect()
}

/// The images of the first `reflectors` reflectors that the frame reprojects, and the tiles of their points.
pub fn project(images: &DepthImages, frame: &FrameParameters, reflectors: u32, choice: &MirrorImages) -> Projection {
    let viewer = Viewer::of(frame);
    let mut found = Projection::default();
    for hemisphere in images.hemispheres.iter().filter(|h| h.reflector <= reflectors) {
        let (normal, offset) = hemisphere.plane;
        let in_front = normal.as_dvec3().dot(viewer.eye) > f64::from(offset);
        if !in_front || !viewer.may_see(&hemisphere.element.corners()) {
            continue;
        }
        let mirrored = viewer.mirrored(hemisphere.plane);
        for i in select(hemisphere, mirrored.eye, choice.choice, choice.merged) {
            let pose = &hemisphere.poses[i];
            for layer in 0..images.layers as usize {
                let image = hemisphere.first + i * images.layers as usize + layer;
                found.add(images, image, pose, hemisphere.reflector, &mirrored);
            }
        }
    }
    found
}

impl Projection {
    /// Adds an image.
    fn add(&mut self, images: &DepthImages, image: usize, pose: &Pose, region: u32, viewer: &Viewer) {
        let view = self.views.len() as u32;
        let before = self.tiles.len();
        let sees = |node: &Node| viewer.may_see(&corners(node.bounds));
        images.trees[image].visit(sees, |node| {
            let edges = viewer.point_edges(node);
            let [width, height, step] = rounded(edges);
            let (size, inside) = (width | height << 16, coordinates(edges, step));
            for y in (0..node.size[1]).step_by(TILE as usize) {
                for x in (0..node.size[0]).step_by(TILE as usize) {
                    let corner = (node.corner[0] + x) | (node.corner[1] + y) << 16;
                    self.tiles.push(DepthTile { view, corner, size, step, inside });
                }
            }
        });
        if self.tiles.len() > before {
            self.views.push(depth_view(pose, viewer, image as u32 * images.per_image(), images.size, region));
        }
    }
}

/// The record of an image whose points begin at `first`.
pub fn depth_view(pose: &Pose, viewer: &Viewer, first: u32, size: [u32; 2], region: u32) -> DepthView {
    let eye = pose.cop.as_dvec3() - viewer.eye;
    let [du, dv, base, eye] =
        [pose.du.as_dvec3(), pose.dv.as_dvec3(), pose.base.as_dvec3(), eye].map(|v| viewer.project(v));
    let row = |axis: usize| [du[axis] as f32, dv[axis] as f32, base[axis] as f32, eye[axis] as f32];
    DepthView { x: row(0), y: row(1), z: row(2), points: [first, size[0], size[1], region] }
}

fn corners((low, high): (Vec3, Vec3)) -> [Vec3; 8] {
    let of = |bit: usize, axis: usize| if bit & (1 << axis) == 0 { low[axis] } else { high[axis] };
    std::array::from_fn(|i| Vec3::new(of(i, 0), of(i, 1), of(i, 2)))
}

#[cfg(test)]
mod tests {
    use super::super::{Element, hemisphere};
    use super::*;

    /// An eye at (x, y, 4) that looks down at the plane z = 0, and a square element around the origin there.
    fn frame(x: f32, y: f32, size: [u32; 2], tan: f32) -> FrameParameters {
        FrameParameters {
            eye: [x, y, 4.0, 1.0],
            right: [tan * size[0] as f32 / size[1] as f32, 0.0, 0.0, 0.0],
            up: [0.0, tan, 0.0, 0.0],
            forward: [0.0, 0.0, -1.0, 0.0],
            size: [size[0], size[1], size[0] * size[1], 0],
            ..FrameParameters::default()
        }
    }

    fn element() -> Element {
        Element { corner: Vec3::new(-1.0, 1.0, 0.0), edges: [Vec3::X * 2.0, Vec3::Y * -2.0] }
    }

    fn of(poses: Vec<Pose>, size: [u32; 2], depth: f32) -> DepthImages {
        let points = vec![[1.0, 1.0, 1.0, depth]; (size[0] * size[1]) as usize * poses.len()];
        let plane = (Vec3::Z, 0.0);
        DepthImages::new(size, 1, vec![Hemisphere { reflector: 1, plane, element: element(), poses, first: 0 }], points)
    }

    const CHOICE: MirrorImages = MirrorImages { choice: ImageChoice::Angle, merged: 1 };

    #[test]
    fn an_image_at_the_mirrored_eye_is_its_own_projection() {
        // The frustum through the element is the view of the mirrored eye.
        let size = [16, 16];
        let pose = Pose::new(Vec3::new(0.0, 0.0, -4.0), &element(), size);
        let found = project(&of(vec![pose], size, 3.0), &frame(0.0, 0.0, size, 0.25), 1, &CHOICE);
        assert_eq!((found.views.len(), found.tiles.len()), (1, 4));
        assert!(found.tiles.iter().all(|tile| (tile.size, tile.step) == (2 | 2 << 16, 1)), "{:?}", found.tiles);
        let view = found.views[0];
        for (x, y, depth) in [(0.5_f32, 0.5_f32, 1.0_f32), (3.5, 9.5, 7.0), (15.5, 2.5, 1.5)] {
            let dot = |row: [f32; 4]| row[0] * depth * x + row[1] * depth * y + row[2] * depth + row[3];
            let z = dot(view.z);
            assert!((z - 4.0 * depth).abs() < 1e-5 * z);
            assert!((dot(view.x) / z - x).abs() < 1e-4 && (dot(view.y) / z - y).abs() < 1e-4, "{x} {y}");
        }
    }

    #[test]
    fn points_have_the_size_of_their_square() {
        // A plane z = 6 seen head on from 4 in front of the mirror: its image is 10 away. Pixels of the image are 2/16 on the
        // mirror and 7 times as wide there.
        let size = [16, 16];
        let images = of(vec![Pose::new(Vec3::new(0.0, 0.0, -1.0), &element(), size)], size, 7.0);
        let frame = frame(0.0, 0.0, [160, 160], 0.5);
        let exact = 7.0 * 2.0 / 16.0 / (10.0 / 160.0);
        let viewer = Viewer::of(&frame).mirrored((Vec3::Z, 0.0));
        let node = &images.trees[0].0[0];
        let [u, v] = viewer.point_edges(node);
        assert!(
            (u - DVec2::new(exact, 0.0)).length() < 1e-4 && (v - DVec2::new(0.0, exact)).length() < 1e-4,
            "{u} {v}"
        );
        let tiles = project(&images, &frame, 1, &CHOICE).tiles;
        assert!(tiles.iter().all(|tile| (tile.size, tile.step) == (16 | 16 << 16, 1)), "{tiles:?}");
        // From the side, with the centroid in the middle of the view: the formula of the module is exact.
        let (eye, pixel) = (DVec3::new(-9.0, 2.0, -4.0), 2.0 * 0.5 / 160.0);
        let q = node.centroid.as_dvec3() - eye;
        let d = q.normalize();
        let right = d.any_orthonormal_vector();
        let viewer = Viewer { eye, axes: [0.5 * right, 0.5 * d.cross(right), d], size: [160.0; 2], shift: [0.0; 2] };
        for (edge, along) in viewer.point_edges(node).into_iter().zip([DVec3::X, DVec3::NEG_Y]) {
            let formula = 7.0 * 2.0 / 16.0 / (q.length() * pixel) * (1.0 - d.dot(along).powi(2)).sqrt();
            assert!((edge.length() - formula).abs() < 1e-4 * formula, "{edge} {formula}");
        }
    }

    #[test]
    fn small_points_are_skipped_and_large_ones_are_cut_off() {
        let square = |size: f64| [DVec2::new(size, 0.0), DVec2::new(0.0, size)];
        for (size, expected) in [
            (1.0, [2, 1]),
            (1.1, [2, 1]),
            (2.0, [3, 1]),
            (0.99, [2, 1]),
            (0.51, [1, 1]),
            (0.5, [2, 2]),
            (0.26, [1, 2]),
            (0.25, [2, 4]),
            (0.1, [1, 8]),
            (0.0, [1, 1024]),
            (12.9, [16, 1]),
            (400.0, [MAX_POINT, 1]),
            (f64::INFINITY, [MAX_POINT, 1]),
        ] {
            let [width, height, step] = rounded(square(size));
            assert_eq!([width, step], expected, "{size}");
            assert_eq!(width, height);
        }
        // The points that are left never lie farther apart than a pixel or their own width.
        for i in 1..4000 {
            let size = f64::from(i) / 250.0;
            let [width, _, step] = rounded(square(size));
            assert!(size * f64::from(step) <= f64::from(width) + SLACK + 1e-9, "{size}: {width} {step}");
        }
        // Turned and lengthened ones have the box around them.
        let edges = [DVec2::new(3.0, -1.0), DVec2::new(0.5, 2.5)];
        assert_eq!(rounded(edges), [5, 5, 1]);
        assert_eq!(rounded([DVec2::new(6.0, 0.0), DVec2::new(0.0, 0.3)]), [8, 1, 1]);
        // Corners of the wider parallelogram have the coordinates 1 and -1.
        let rows = coordinates(edges, 1).map(f64::from);
        for (s, t) in [(1.0, 1.0), (1.0, -1.0), (-0.5, 0.25)] {
            let at = 0.5 * WIDENING * (s * edges[0] + t * edges[1]);
            let found = [rows[0] * at.x + rows[1] * at.y, rows[2] * at.x + rows[3] * at.y];
            assert!((found[0] - s).abs() < 1e-6 && (found[1] - t).abs() < 1e-6, "{found:?}");
        }
        assert_eq!(coordinates([DVec2::X, DVec2::X], 1), [0.0; 4]);
        assert_eq!(coordinates([DVec2::INFINITY; 2], 1), [0.0; 4]);
    }

    #[test]
    fn images_are_selected_by_angle_or_distance() {
        let poses: Vec<Pose> =
            hemisphere(&element(), Vec3::Z, 9).iter().map(|cop| Pose::new(*cop, &element(), [8, 8])).collect();
        let images = of(poses.clone(), [8, 8], 2.0);
        let of_hemisphere = &images.hemispheres[0];
        for eye in [DVec3::new(0.0, 0.0, -5.0), DVec3::new(3.0, 1.0, -2.0), DVec3::new(-0.3, 0.4, -0.2)] {
            for choice in [ImageChoice::Angle, ImageChoice::Distance] {
                let order = select(of_hemisphere, eye, choice, 9);
                let far = |i: usize| match choice {
                    ImageChoice::Angle => poses[i].cop.as_dvec3().angle_between(eye),
                    ImageChoice::Distance => poses[i].cop.as_dvec3().distance(eye),
                };
                assert!(
                    order.windows(2).all(|pair| far(pair[0]) <= far(pair[1]) + 1e-7),
                    "{eye} {choice:?}: {order:?}"
                );
                assert_eq!(select(of_hemisphere, eye, choice, 2), order[..2]);
            }
        }
        // Straight above the element: the pole.
        assert_eq!(select(of_hemisphere, DVec3::new(0.0, 0.0, -5.0), ImageChoice::Angle, 1), [0]);
    }

    #[test]
    fn unseen_elements_nodes_and_reflectors_are_left_out() {
        let size = [32, 32];
        let images = of(vec![Pose::new(Vec3::new(0.0, 0.0, -1.0), &element(), size)], size, 3.0);
        let tiles = |frame: &FrameParameters, reflectors| project(&images, frame, reflectors, &CHOICE).tiles.len();
        let seen = frame(0.0, 0.0, [64, 64], 1.0);
        assert_eq!(tiles(&seen, 1), 16);
        assert_eq!(tiles(&seen, 0), 0);
        // Behind the mirror, and past it.
        assert_eq!(tiles(&FrameParameters { eye: [0.0, 0.0, -4.0, 1.0], ..seen }, 1), 0);
        assert_eq!(tiles(&FrameParameters { forward: [0.0, 0.0, 1.0, 0.0], ..seen }, 1), 0);
        assert_eq!(tiles(&frame(40.0, 0.0, [64, 64], 1.0), 1), 0);
        // Points of nodes beyond the view: those of a slanted plane, whose depths differ.
        let mut slanted = images.points.clone();
        (0..1024).for_each(|i| slanted[i][3] = 1.5 + i as f32 % 32.0 / 4.0);
        let images = DepthImages::new(size, 1, images.hemispheres.clone(), slanted);
        let narrow = project(&images, &frame(0.9, 0.0, [64, 64], 0.05), 1, &CHOICE);
        assert!((1..16).contains(&narrow.tiles.len()), "{}", narrow.tiles.len());
    }
}
