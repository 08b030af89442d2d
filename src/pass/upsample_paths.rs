//! Lights what pixels see through mirrors and glass by the lit points around them, where one point is lit for each square of pixels
//! ([`upsample`](super::upsample)).
//!
//! The pixel's own path has found surface, normal, albedo and throughput, and emission: what mirrors and glass show is as sharp as without
//! upsampling. Of the four lit points around it those of the same component that are seen by such paths too and lie on one plane, to the size of a pixel and to 18 degrees,
//! lend irradiance and radiance of lobes, with the weights of [`upsample`](super::upsample). If none does, the one of sixteen that is near in space and faces as it does lends its
//! irradiance, and if none of these is seen so, the nearest first component.
//!
//! Cost: for each component of a pixel in a tile that shows mirrors or glass 4 lit points, 30 vec4 and 200 operations; 16 more points where none
//! of the four lies on its surface.

use glam::Vec3;

use super::edges::TURNED;
use super::layout::FrameParameters;
use super::schedule::LIST_GROUPS;
use super::upsample::{LEAST_WEIGHT, Lit, Place};
use super::{BoundKernel, Kit, Lighting, push};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::stage::Eye;

/// The pass.
pub struct UpsamplePaths {
    /// Of each component.
    kernels: Vec<BoundKernel>,
    tiles: Buffer,
}

impl UpsamplePaths {
    /// Writes the `lighting` of the pixels of `eye`. Two components take the light of `lit`; third ones, which no filter averages, take `raw`. Where
    /// `lit_marks`, of tiles, is 0 lit points have one component.
    pub fn new(
        kit: &Kit,
        (eye, lighting): (&Eye, &Lighting),
        (lit, raw, lit_marks): (&Lit, &Lighting, &Buffer),
        components: u32,
    ) -> Result<Self> {
        let points = &eye.points;
        let own = Resources::of([
            ("lit_marks", lit_marks),
            ("pixel_position", &points.position),
            ("pixel_geometric", &points.geometric),
            ("pixel_wo", &points.wo),
            ("pixel_throughput", &eye.paths.throughput),
            ("pixel_direct", &lighting.direct),
            ("pixel_indirect", &lighting.indirect),
            ("pixel_specular", &lighting.specular),
        ]);
        let kernel = |component: u32| {
            let light = if component < 2 { lit.lighting } else { raw };
            let sets = [&own, &lit.points.resources(), &light.resources(), &eye.ideal_tiles.as_tiles()];
            kit.bind(&shaders::UPSAMPLE_PATHS, &sets)
        };
        Ok(UpsamplePaths {
            kernels: (0..components).map(kernel).collect::<Result<_>>()?,
            tiles: eye.ideal_tiles.work.clone(),
        })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        let mut components = self.kernels.iter().zip(0..);
        components.try_for_each(|(kernel, i)| kernel.run_listed(rec, &push(i), &self.tiles, LIST_GROUPS))
    }
}

/// A point that a path meets, for the oracle.
#[derive(Clone, Copy, Debug)]
pub struct PathPoint {
    /// Where.
    pub position: Vec3,
    /// Geometric normal on the side of the path.
    pub normal: Vec3,
    /// Reflects light.
    pub lit: bool,
    /// Is seen through mirrors or glass.
    pub by_specular: bool,
    /// Direct and indirect irradiance, and radiance by the specular lobe.
    pub sums: [Vec3; 3],
}

/// Oracle: direct and indirect irradiance and radiance by the specular lobe of a pixel's lit point at a depth; and whether they come from
/// the four points around it. `lit`: by place the points of the same
/// component, and of first ones, in an image of this size.
pub fn reference(
    frame: &FrameParameters,
    (at, own, depth): ([u32; 2], &PathPoint, f32),
    size: [u32; 2],
    lit: [&dyn Fn(u32, u32) -> PathPoint; 2],
) -> ([Vec3; 3], bool) {
    let place = Place::of(frame, at, size);
    let [x, y, z, _] = frame.up;
    let tolerance = 2.0 * Vec3::new(x, y, z).length() / frame.within[3] as f32 * frame.depth_scale(depth);
    let alike = |near: &PathPoint| near.lit && near.by_specular == own.by_specular;
    let (mut sum, mut total) = ([Vec3::ZERO; 3], 0.0);
    for ([x, y], weight) in place.four() {
        let near = lit[0](x, y);
        let apart = near.position - own.position;
        let in_plane = [own.normal, near.normal].iter().all(|n| n.dot(apart).abs() <= tolerance);
        if in_plane && own.normal.dot(near.normal) > 0.95 && alike(&near) {
            total += weight;
            sum = [0, 1, 2].map(|k| sum[k] + weight * near.sums[k]);
        }
    }
    if total > LEAST_WEIGHT {
        return (sum.map(|e| e / total), true);
    }
    let distance2 = |near: &PathPoint| {
        near.position.distance_squared(own.position) * (1.0 + TURNED * (1.0 - own.normal.dot(near.normal)))
    };
    let nearest = |of: usize, lends: &dyn Fn(&PathPoint) -> bool| {
        let all = place.sixteen().map(|[x, y]| lit[of](x, y)).filter(lends);
        all.map(|near| (distance2(&near), near)).reduce(|a, b| if b.0 < a.0 { b } else { a })
    };
    let nearest = nearest(0, &alike).or_else(|| nearest(1, &|near| near.lit));
    (nearest.map_or([Vec3::ZERO; 3], |(_, near)| [near.sums[0], near.sums[1], Vec3::ZERO]), false)
}
