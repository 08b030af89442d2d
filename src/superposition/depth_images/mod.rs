//! Images with depth (Bastos 1999, section 6.6): mirror images that are sampled before the first frame and reprojected in each.
//!
//! 1. **Sampling** ([`DepthImages::sample`], 6.6.1). Each planar reflector is cut into elements. Behind each element lies a hemisphere
//!    with evenly spread centres of projection; the frustum through the corners of the element, off-axis in general, is an image. It holds
//!    the radiance of what it sees, emitted and reflected diffusely, as the passes of an atlas ([`crate::view::Atlas`]) compute it, and
//!    its depth. Further layers hold what lies behind (layered depth images, 6.8).
//! 2. **Selection** ([`project`], 6.6.2). For each element that the eye sees, the images whose view direction has the least angle to the
//!    mirrored view, or whose centres are nearest to the mirrored eye, are merged.
//! 3. **Reprojection** ([`crate::pass::reproject`], 6.6.3). Each point of the selected images is projected to the mirrored view; the nearest
//!    one at a pixel counts.
//! 4. **Reconstruction** ([`project`], 6.6.4). Points cover squares of pixels. [`quadtree`] groups the points of an image: the centroid of
//!    a node gives the size of all of its points, and nodes outside of the view are left out.
//!
//! A point is a pixel of an image. The pixel (x, y) of width w and height h at depth z is the point
//!
//! ```text
//! P = cop + z (base + (x + 1/2) du + (y + 1/2) dv)
//! ```
//!
//! with `cop` the centre of projection, `base` the vector from there to the element's first corner, `du` and `dv` its edges over w and h:
//! the inverse of the image's transformation. z is 1 on the mirror and grows with the distance from its plane, counted from `cop`.
//!
//! Light that depends on the view has no place in an image (6.6). Points on mirrors, glass and lobes that eye paths follow hold no colour,
//! nor do the backs of surfaces, which the inside of furniture on a floor would show; rays are traced where such a point is the nearest
//! one, and where there is none.
//!
//! Differs from the thesis in that: colours are radiance in 32-bit floats and not bytes; holes are filled by traced rays; the radius of a
//! hemisphere is half the shorter side of its element; the number of elements and images does not depend on the room.

pub mod project;
pub mod quadtree;
mod sample;

use glam::Vec3;

use crate::error::{Error, Result};
use quadtree::Quadtree;

pub use sample::{Plan, elements, hemisphere};

/// Numbers and sizes of the images, which are fixed when they are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Maximum number of elements of a reflector, and of hemispheres. Default 4; 1 to 256. More: images nearer to each view, fewer holes;
    /// memory and time of sampling grow in proportion.
    pub hemispheres: u32,
    /// Images of a hemisphere. Default 8; 1 to 256. More: likewise.
    pub images: u32,
    /// Width and height of an image in points. Default 128; 8 to 1024. More: sharper images; memory and times grow with the square.
    pub side: u32,
    /// Layers of an image: 1, or more, which also hold what lies behind the points before. Default 1; 1 to 4. More: fewer holes; memory
    /// and time of a frame in proportion.
    pub layers: u32,
    /// Passes that light the points. Default 32; 1 to 65,536. More: less noise, a longer start.
    pub passes: u32,
    /// Maximum bytes of all images. Default 256 MiB.
    pub memory: u64,
}

impl Default for Options {
    fn default() -> Self {
        Options { hemispheres: 4, images: 8, side: 128, layers: 1, passes: 32, memory: 256 << 20 }
    }
}

/// Bytes of a point: three channels of radiance and the depth.
pub const POINT_BYTES: u64 = 16;

impl Options {
    /// Errors: a value out of range.
    pub fn validate(&self) -> Result<()> {
        let ranges = [
            ("--mirror-hemispheres", self.hemispheres, 1, 256),
            ("--mirror-images", self.images, 1, 256),
            ("--mirror-side", self.side, 8, 1024),
            ("--mirror-layers", self.layers, 1, 4),
            ("--mirror-passes", self.passes, 1, 65_536),
        ];
        match ranges.iter().find(|(_, value, low, high)| !(low..=high).contains(&value)) {
            Some((name, value, low, high)) => {
                Err(Error::Setting { name, message: format!("{value} is not in {low}..={high}") })
            }
            None => Ok(()),
        }
    }

    /// Bytes of the images of so many hemispheres.
    pub fn bytes(&self, hemispheres: usize) -> u64 {
        let points = u64::from(self.side) * u64::from(self.side) * u64::from(self.images) * u64::from(self.layers);
        hemispheres as u64 * points * POINT_BYTES
    }
}

/// Where an image was taken from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Centre of projection.
    pub cop: Vec3,
    /// From there to the first corner of the element.
    pub base: Vec3,
    /// Edge of the element over the number of columns.
    pub du: Vec3,
    /// Edge over the number of rows.
    pub dv: Vec3,
}

impl Pose {
    /// Of a frustum from `cop` through an element, for an image of this size.
    pub fn new(cop: Vec3, element: &Element, [width, height]: [u32; 2]) -> Pose {
        let [u, v] = element.edges;
        Pose { cop, base: element.corner - cop, du: u / width as f32, dv: v / height as f32 }
    }

    /// From the centre of projection to the centre of a pixel on the mirror.
    pub fn ray(&self, x: u32, y: u32) -> Vec3 {
        self.base + (x as f32 + 0.5) * self.du + (y as f32 + 0.5) * self.dv
    }

    /// The point of a pixel at a depth.
    pub fn point(&self, x: u32, y: u32, depth: f32) -> Vec3 {
        self.cop + depth * self.ray(x, y)
    }
}

/// A rectangle of a reflector's plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// Its first corner.
    pub corner: Vec3,
    /// Its edges, perpendicular to each other: seen from the front of the reflector, the second one is a quarter turn clockwise from the
    /// first.
    pub edges: [Vec3; 2],
}

impl Element {
    /// Its centre.
    pub fn center(&self) -> Vec3 {
        self.corner + 0.5 * (self.edges[0] + self.edges[1])
    }

    /// Its corners, in turn.
    pub fn corners(&self) -> [Vec3; 4] {
        let [u, v] = self.edges;
        [self.corner, self.corner + u, self.corner + u + v, self.corner + v]
    }
}

/// A hemisphere behind an element.
#[derive(Clone, Debug, PartialEq)]
pub struct Hemisphere {
    /// Number of the reflector, from 1.
    pub reflector: u32,
    /// Normal of the reflector, and its plane's distance from the origin.
    pub plane: (Vec3, f32),
    /// The element.
    pub element: Element,
    /// Poses of its images.
    pub poses: Vec<Pose>,
    /// The number of its first image; those of further layers of an image follow it.
    pub first: usize,
}

/// Points of all images, those of an image row by row: radiance, and depth. A depth below 0 is that of a point without a colour, 0 that of
/// a pixel that sees nothing.
pub type Points = Vec<[f32; 4]>;

/// The images with depth of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthImages {
    /// Width and height of an image in points.
    pub size: [u32; 2],
    /// Layers of an image.
    pub layers: u32,
    /// The hemispheres, by reflectors.
    pub hemispheres: Vec<Hemisphere>,
    /// The points.
    pub points: Points,
    /// The points of each image in groups.
    pub trees: Vec<Quadtree>,
}

impl DepthImages {
    /// From hemispheres and the points of their images.
    pub fn new(size: [u32; 2], layers: u32, hemispheres: Vec<Hemisphere>, points: Points) -> DepthImages {
        let poses = hemispheres.iter().flat_map(|h| &h.poses).flat_map(|pose| (0..layers).map(move |_| pose));
        let per_image = (size[0] * size[1]) as usize;
        let trees =
            poses.zip(points.chunks(per_image)).map(|(pose, points)| Quadtree::new(pose, size, points)).collect();
        DepthImages { size, layers, hemispheres, points, trees }
    }

    /// Points of an image.
    pub fn per_image(&self) -> u32 {
        self.size[0] * self.size[1]
    }

    /// Number of images, each layer counted.
    pub fn images(&self) -> usize {
        self.trees.len()
    }

    /// Bytes of the points.
    pub fn bytes(&self) -> u64 {
        self.points.len() as u64 * POINT_BYTES
    }
}
