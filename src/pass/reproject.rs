//! Reprojects images with depth to the pixels of their planar reflectors (Bastos 1999, sections 6.6.3 and 6.6.4).
//!
//! [`crate::superposition::depth_images::project`] chooses images and sizes of points on the host. A point at depth z of its image lies at the
//! pixel (X / Z, Y / Z), X, Y and Z being dot products of (z x, z y, z, 1), and covers the pixels in a parallelogram around it that show its reflector.
//! The nearest point counts, without any order among the invocations:
//!
//! ```text
//! 1. nearest[pixel] = min of the bits of Z          atomicMin; floats above 0 have the order of their bits
//! 2. chosen[pixel]  = min of the points' indices with Z = nearest[pixel]
//! ```
//!
//! So the bits of the result do not depend on the device's schedule. Both dispatches compute Z by the same instructions. A device that
//! rounded them differently would leave holes.
//!
//! Output: `reprojected`, radiance and depth of the chosen point for each pixel; depth 0 where a ray is to be traced, because no point was
//! projected there or the nearest one has no colour. [`eye_paths`](super::eye_paths) traces no mirrored ray at the other pixels, and
//! [`mirror_image`](super::mirror_image) takes their radiance from here. Depth is that of the mirror image along the view direction, like
//! that of an unfolded path. A frosted pane is no reflector of these images.
//!
//! Differs from the thesis in that: points of equal depth have an order; points do not cover other reflectors or what stands before them.
//!
//! Cost: 36 bytes read and 3 written for each pixel in three small dispatches; for each point 16 bytes read and an atomic operation for each pixel of
//! its box, twice. Boxes are at most [`MAX_POINT`](crate::superposition::depth_images::project::MAX_POINT) pixels wide and high, so that no loop
//! takes more than 256 turns.

use std::sync::Arc;

use glam::Vec4;
use serde::Serialize;

use super::{BoundKernel, Kit, Rays, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Context, Recorder, Resources, Staging, download, shaders};
use crate::pass::layout::{DepthTile, DepthView, FrameParameters};
use crate::settings::MirrorImages;
use crate::superposition::depth_images::DepthImages;
use crate::superposition::depth_images::project::{Projection, project};
use crate::superposition::depth_images::quadtree::TILE;

/// Images with depth on the device.
#[derive(Clone)]
pub struct DepthImageBuffers {
    /// The points of all images.
    pub points: Buffer,
    /// Poses and quadtrees, which stay on the host.
    pub images: Arc<DepthImages>,
}

impl DepthImageBuffers {
    /// Stages the points.
    pub fn new(context: &Context, staging: &mut Staging, images: &Arc<DepthImages>) -> Result<DepthImageBuffers> {
        let points = staging.stage(context, "points of images with depth", &images.points)?;
        Ok(DepthImageBuffers { points, images: images.clone() })
    }
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// First hits.
    pub rays: &'a Rays,
    /// The images.
    pub images: &'a DepthImageBuffers,
    /// Receives the reflector that each pixel shows.
    pub region: &'a Buffer,
    /// Output.
    pub reprojected: &'a Buffer,
    /// Number of pixels.
    pub pixels: u32,
    /// Number of reflectors that show images.
    pub reflectors: u32,
    /// Which images are merged.
    pub choice: MirrorImages,
}

/// The pass.
pub struct Reproject {
    /// Tiles; pixels that show reflectors; of these the holes, and those whose nearest point has no colour; workgroups of the tiles.
    pub counts: Buffer,
    /// Bits of the least depth at each pixel.
    pub nearest: Buffer,
    /// The point of that depth.
    pub chosen: Buffer,
    images: Arc<DepthImages>,
    choice: MirrorImages,
    reflectors: u32,
    views: Buffer,
    tiles: Buffer,
    regions: BoundKernel,
    depth: BoundKernel,
    color: BoundKernel,
    resolve: BoundKernel,
    pixels: u32,
}

/// Place of the workgroups among the counts.
const GROUPS_AT: u64 = 16;
/// Most workgroups in a row of a dispatch.
const MAX_ROW: u32 = 32_768;

/// Counts of the pixels of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct MirrorPixels {
    /// Pixels that show a reflector with images.
    pub shown: u32,
    /// Of these, those that no point reached.
    pub holes: u32,
    /// Those whose nearest point has no colour, because its light depends on the view.
    pub withheld: u32,
}

impl Reproject {
    /// Projects to `reprojected`.
    pub fn new(kit: &Kit, inputs: &Inputs) -> Result<Reproject> {
        let Inputs { rays, images: DepthImageBuffers { points, images }, region, reprojected, pixels, .. } = inputs;
        let merged = inputs.choice.merged as usize;
        let of_images: usize = images.hemispheres.iter().map(|h| h.poses.len().min(merged)).sum();
        let most = of_images as u32 * images.layers;
        let per_view = images.size.iter().map(|n| n.div_ceil(TILE)).product::<u32>();
        let counts = kit.array("reprojection counts", 8, 4)?;
        let nearest = kit.array("nearest depths", *pixels, 4)?;
        let chosen = kit.array("chosen points", *pixels, 4)?;
        let views = kit.array("views of images", most.max(1), size_of::<DepthView>() as u64)?;
        let tiles = kit.array("tiles of images", (most * per_view).max(1), size_of::<DepthTile>() as u64)?;
        let own = Resources::of([
            ("depth_points", points),
            ("depth_views", &views),
            ("depth_tiles", &tiles),
            ("reproject_counts", &counts),
            ("region", region),
            ("nearest", &nearest),
            ("chosen", &chosen),
            ("reprojected", reprojected),
        ]);
        Ok(Reproject {
            images: images.clone(),
            choice: inputs.choice,
            reflectors: inputs.reflectors,
            regions: kit.bind(&shaders::REPROJECT_REGIONS, &[&rays.resources(), &own])?,
            depth: kit.bind(&shaders::REPROJECT_DEPTH, &[&own])?,
            color: kit.bind(&shaders::REPROJECT_COLOR, &[&own])?,
            resolve: kit.bind(&shaders::REPROJECT_RESOLVE, &[&own])?,
            pixels: *pixels,
            counts,
            nearest,
            chosen,
            views,
            tiles,
        })
    }

    /// The images that a frame reprojects, and the tiles of their points.
    pub fn projection(&self, parameters: &FrameParameters) -> Projection {
        project(&self.images, parameters, self.reflectors, &self.choice)
    }

    /// The counts of the latest frame, which must have ended.
    pub fn mirror_pixels(&self, context: &Context) -> Result<MirrorPixels> {
        let counts = download::<u32>(context, &self.counts)?;
        Ok(MirrorPixels { shown: counts[1], holes: counts[2], withheld: counts[3] })
    }

    /// Records the choice of images for a frame, before the pass.
    pub fn record_start(&self, rec: &mut Recorder, parameters: &FrameParameters) -> Result<()> {
        let Projection { views, tiles } = self.projection(parameters);
        let count = tiles.len() as u32;
        let row = count.min(MAX_ROW);
        let counts = [count, 0, 0, 0, row, count.div_ceil(row.max(1)), 1, 0];
        rec.update(&self.counts, 0, bytemuck::cast_slice(&counts))?;
        if count > 0 {
            rec.update(&self.views, 0, bytemuck::cast_slice(&views))?;
            rec.update(&self.tiles, 0, bytemuck::cast_slice(&tiles))?;
        }
        Ok(())
    }

    /// Records the pass, after the first hits.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.regions.run(rec, &[], groups(self.pixels))?;
        self.depth.run_listed(rec, &[], &self.counts, GROUPS_AT)?;
        self.color.run_listed(rec, &[], &self.counts, GROUPS_AT)?;
        self.resolve.run(rec, &[], groups(self.pixels))
    }
}

/// Oracle: radiance and depth of the nearest point at each pixel, with its index; `None`: no point reaches it. `region`: the reflector
/// that each pixel shows.
pub fn reference(
    frame: &FrameParameters,
    points: &[[f32; 4]],
    Projection { views, tiles }: &Projection,
    region: &[u32],
) -> Vec<Option<(Vec4, u32)>> {
    let [width, height, ..] = frame.size.map(|n| n as i32);
    let mut found: Vec<Option<(Vec4, u32)>> = vec![None; region.len()];
    for tile in tiles {
        let view = &views[tile.view as usize];
        let [first, columns, rows, reflector] = view.points;
        for (dx, dy) in (0..TILE * TILE).map(|i| (i % TILE, i / TILE)) {
            let (x, y) = ((tile.corner & 0xffff) + dx, (tile.corner >> 16) + dy);
            if x >= columns || y >= rows || x % tile.step != 0 || y % tile.step != 0 {
                continue;
            }
            let index = first + x + y * columns;
            let point = Vec4::from(points[index as usize]);
            let depth = point.w.abs();
            let q = [depth * (x as f32 + 0.5), depth * (y as f32 + 0.5), depth];
            let of = |row: [f32; 4]| row[0] * q[0] + row[1] * q[1] + row[2] * q[2] + row[3];
            let z = of(view.z);
            if depth == 0.0 || z <= 0.0 {
                continue;
            }
            let extent = [tile.size & 0xffff, tile.size >> 16];
            let middle = [of(view.x) / z - frame.pixel_offset[0], of(view.y) / z - frame.pixel_offset[1]];
            let corner = [0, 1].map(|axis| (middle[axis] - 0.5 * extent[axis] as f32 + 1.0).floor() as i32);
            let [across, down] = extent.map(|n| n as i32);
            for (i, j) in (0..down).flat_map(|j| (0..across).map(move |i| (i, j))) {
                let (px, py) = (corner[0].saturating_add(i), corner[1].saturating_add(j));
                let (away_x, away_y) = (px as f32 - middle[0], py as f32 - middle[1]);
                let [a, b, c, d] = tile.inside;
                let outside = (a * away_x + b * away_y).abs() > 1.0 || (c * away_x + d * away_y).abs() > 1.0;
                if outside || px < 0 || py < 0 || px >= width || py >= height {
                    continue;
                }
                let pixel = (px + py * width) as usize;
                let nearer = |(before, at): (Vec4, u32)| (z, index) < (before.w, at);
                if region[pixel] == reflector && found[pixel].is_none_or(nearer) {
                    found[pixel] = Some((point.truncate().extend(z), index));
                }
            }
        }
    }
    found
}
