//! Sorts photons into a grid of cells of size 2r, kept as a hash table (Wald et al. 2002, 4.1), on the device in each
//! frame.
//!
//! ```text
//! cell = floor(z / 2r)      code = cell . (a, b, c) + class d  mod 2^32      bucket = hash(code) mod buckets
//! ```
//!
//! Photons are sorted by bucket (see `sort`, which is stable: within a bucket they keep their order) and stored
//! consecutively; each bucket records its first photon and its end. So a look-up adds in the same order in every run. A
//! photon stores its code, since a bucket may hold several cells. The factors of the code give the 8 cells of a look-up
//! distinct codes, in all classes: no photon is counted twice, and none of another class.
//!
//! Most shading points have no photons around them. A look-up visits 8 cells and is identified by the first; each
//! photon sets a bit for each of the 8 look-ups that visit its cell, so that `photon_find` reads one word for a point
//! where a look-up reads 16.
//!
//! Differs from the paper in that: sets of all classes share one table, with the class in the code; unless
//! [`interleave_photons`](crate::settings::Settings::interleave_photons) is set all photons are of one class here.
//! Cost for n photons: 230 n bytes plus those of the sort, 24 dispatches.

use glam::Vec3;

use super::layout::FrameParameters;
use super::photon_start;
use super::sort::{Sort, SortBuffers, SortSteps};
use super::{BoundKernel, Kit, List, Rays, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::plan::PhotonPlan;
use crate::sampling::random::hash;

/// Maximum number of bits of a bucket number: keys have 24, and photons that are not stored follow all buckets.
pub const MAX_BUCKET_BITS: u32 = 22;

/// Photons in the order of their buckets.
#[derive(Clone)]
pub struct Grid {
    /// Number of photons in the grid, as [`super::layout::DispatchCounts::live`], and the order of all photons.
    pub list: List,
    /// Positions; w: bits of the code.
    pub position: Buffer,
    /// Geometric normals on the side of arrival.
    pub normal: Buffer,
    /// Directions back along the photons' last rays.
    pub wi: Buffer,
    /// Flux if the class had this photon only.
    pub flux: Buffer,
    /// First photon and end of each bucket.
    pub buckets: Buffer,
    /// Bits of the look-ups that visit a cell with photons, 16 for each bucket ([`near_bit`]).
    pub near: Buffer,
}

impl Grid {
    /// Allocates the photons of a plan.
    pub fn new(kit: &Kit, plan: &PhotonPlan) -> Result<Grid> {
        let (count, buckets) = (plan.total(), 1 << plan.bucket_bits());
        Ok(Grid {
            list: List::new(kit, "photon grid", &kit.array("photon order", count, 4)?)?,
            position: kit.vec4s("sorted photon position", count)?,
            normal: kit.vec4s("sorted photon normal", count)?,
            wi: kit.vec4s("sorted photon wi", count)?,
            flux: kit.vec4s("sorted photon flux", count)?,
            buckets: kit.array("photon buckets", buckets, 8)?,
            near: kit.array("photons near", buckets, 2)?,
        })
    }

    /// The buffers by their names in shaders, without the list.
    pub fn resources(&self) -> Resources {
        Resources::of([
            ("sorted_position", &self.position),
            ("sorted_normal", &self.normal),
            ("sorted_wi", &self.wi),
            ("sorted_flux", &self.flux),
            ("buckets", &self.buckets),
            ("near", &self.near),
        ])
    }
}

/// The pass.
pub struct PhotonGrid {
    sort: Sort,
    cells: BoundKernel,
    buckets: Buffer,
    near: Buffer,
    photons: u32,
}

impl PhotonGrid {
    /// Fills `grid` from the stored photons: their `position` (w: 1 if stored), `normal`, direction in `rays`, and
    /// `flux`. `grid.list.work` holds the number of all photons as its total.
    pub fn new(
        kit: &Kit,
        rays: &Rays,
        [flux, position, normal]: [&Buffer; 3],
        grid: &Grid,
        steps: &Resources,
        photons: u32,
    ) -> Result<PhotonGrid> {
        let codes = kit.array("photon codes", photons, 4)?;
        let buffers = SortBuffers::new(kit, photons, 1)?;
        let work = Resources::of([("work", &grid.list.work)]);
        let stored = Resources::of([
            ("codes", &codes),
            ("flux", flux),
            ("photon_position", position),
            ("photon_normal", normal),
        ]);
        let unsorted = Resources::of([("keys", buffers.unsorted())]);
        let keys = kit.bind(&shaders::PHOTON_KEYS, &[&stored, &unsorted, &work])?;
        let sort = Sort::by_keys(kit, keys, &grid.list, &buffers, steps)?;
        let sorted = Resources::of([("keys", buffers.sorted())]);
        let sets = [&stored, &sorted, &work, &rays.resources(), &grid.resources()];
        let cells = kit.bind(&shaders::PHOTON_CELLS, &sets)?;
        Ok(PhotonGrid { sort, cells, buckets: grid.buckets.clone(), near: grid.near.clone(), photons })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder, steps: &SortSteps) -> Result<()> {
        rec.fill(&self.buckets, 0)?;
        rec.fill(&self.near, 0)?;
        self.sort.record(rec, steps)?;
        self.cells.run(rec, &[], groups(self.photons))
    }
}

/// Oracle: the class by which the grid keeps photons apart.
pub fn grid_class(frame: &FrameParameters, class: u32) -> u32 {
    if frame.has(FrameParameters::SHARED_PHOTONS) { 0 } else { class }
}

/// Oracle: that class of a photon.
pub fn class_of(frame: &FrameParameters, photon: u32) -> u32 {
    grid_class(frame, photon_start::class_of(frame, photon))
}

/// Oracle: the code of a cell for a class.
pub fn code_of(cell: [i32; 3], class: u32) -> u32 {
    let [x, y, z] = cell.map(|c| c as u32);
    let sum = x.wrapping_mul(0x9e37_79b1).wrapping_add(y.wrapping_mul(0x85eb_ca77));
    sum.wrapping_add(z.wrapping_mul(0xc2b2_ae3d)).wrapping_add(class.wrapping_mul(0x27d4_eb2f))
}

/// Oracle: code and bucket of a photon stored at `position`.
pub fn place_of(frame: &FrameParameters, photon: u32, position: Vec3) -> (u32, u32) {
    let code = code_of(cell_of(frame, position, 0.0), class_of(frame, photon));
    (code, hash(code) & frame.photons[3])
}

/// Oracle: the bit of the look-ups of a class whose first cell this is.
pub fn near_bit(frame: &FrameParameters, first: [i32; 3], class: u32) -> u32 {
    hash(code_of(first, class)) & (frame.photons[3] << 4 | 15)
}

/// Oracle: the bits that a photon stored at `position` sets.
pub fn near_bits(frame: &FrameParameters, photon: u32, position: Vec3) -> [u32; 8] {
    let [x, y, z] = cell_of(frame, position, 0.0);
    let first = |corner: i32| [x - (corner & 1), y - (corner >> 1 & 1), z - (corner >> 2)];
    std::array::from_fn(|corner| near_bit(frame, first(corner as i32), class_of(frame, photon)))
}

/// Oracle: the cell at `position`, or the cell `before` cells earlier along each axis.
pub fn cell_of(frame: &FrameParameters, position: Vec3, before: f32) -> [i32; 3] {
    let cell = (position * frame.photon[1]).clamp(Vec3::splat(-1e9), Vec3::splat(1e9));
    (cell - before).floor().to_array().map(|c| c as i32)
}

/// Oracle: the stored photons in grid order; `positions` are `None` for photons that are not stored.
pub fn reference(frame: &FrameParameters, positions: &[Option<Vec3>]) -> Vec<u32> {
    let bucket = |photon: u32| positions[photon as usize].map(|p| place_of(frame, photon, p).1);
    let mut order: Vec<u32> = (0..positions.len() as u32).filter(|&i| positions[i as usize].is_some()).collect();
    order.sort_by_key(|&photon| bucket(photon));
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    #[test]
    fn no_two_cells_of_a_look_up_share_a_code_in_any_classes() {
        let classes = Settings::MAX_PATTERN * Settings::MAX_PATTERN;
        // Two of 8 cells differ by -1, 0 or 1 along each axis; two classes by up to 63 either way.
        for x in -1..=1 {
            for y in -1..=1 {
                for z in -1..=1 {
                    for class in 0..classes {
                        let nothing = [x, y, z, class as i32] == [0; 4];
                        assert_eq!(code_of([x, y, z], class) == 0, nothing, "{x} {y} {z}, class {class}");
                    }
                }
            }
        }
    }

    #[test]
    fn photons_are_in_the_cells_that_a_look_up_visits() {
        let frame = FrameParameters {
            photon: [0.5, 1.0, 1.0, 0.0],
            photons: [8, 0, 1, 15],
            pattern: [1, 1, 1, 0],
            ..FrameParameters::default()
        };
        assert_eq!(place_of(&frame, 0, Vec3::new(-0.25, 1.0, 2.5)).0, code_of([-1, 1, 2], 0));
        // Photon 1 is not stored; photons of a bucket keep their order.
        let at = |x: f32| Some(Vec3::new(x, 0.0, 0.0));
        let order = reference(&frame, &[at(3.5), None, at(0.5), at(3.25), at(0.75)]);
        let [near, far] = [0.5, 3.5].map(|x| place_of(&frame, 0, Vec3::new(x, 0.0, 0.0)).1);
        assert_ne!(near, far);
        assert_eq!(order, if near < far { [2, 4, 0, 3] } else { [0, 3, 2, 4] });
    }
}
