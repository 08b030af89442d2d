//! Sorts the shading points of a list by the Morton codes of their positions, so that the 64 points of a cluster are
//! close together and the shaft from a light to them is narrow, also across silhouettes. With interleaved sampling the
//! classes of pixels follow one another, each in this order, since each has a set of lights of its own; the class takes
//! the topmost bits of the key, and the code loses as many low bits.
//!
//! Codes have 8 bits for each axis of the scene's bounding cube. A stable radix sort by three digits of 8 bits: count
//! the digits in each run of 512 keys, scan the counts in three levels, scatter. Equal codes keep the order of the
//! list, which is that of screen tiles. Before the sort a list has a slot for every ray; dead ones go to its end. So
//! the order, and with it the division into clusters, is the same in every run.
//!
//! Cost for n points: 60 n bytes and about 40 n operations a digit; 22 dispatches, or 23 with classes.

use glam::Vec3;

use super::layout::{FrameParameters, Step};
use super::schedule::TOTAL_GROUPS;
use super::{BoundKernel, Kit, List, ShadingPoints, push};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::plan::StepTable;

/// Keys of one invocation.
pub const RUN: u32 = 512;
/// Values of a digit.
pub const DIGITS: u32 = 256;
/// Shifts of the three digits of the key.
const DIGIT_SHIFTS: [u32; 3] = [0, 8, 16];

/// Buffers for sorting, shared by all lists of a frame.
#[derive(Clone)]
pub struct SortBuffers {
    keys: [Buffer; 2],
    levels: [Buffer; 3],
    /// For each class of pixels, its first cluster and its first point on the list; then one past the last of all.
    pub classes: Buffer,
}

impl SortBuffers {
    /// Pairs of a key and its value, unsorted.
    pub fn unsorted(&self) -> &Buffer {
        &self.keys[0]
    }

    /// The pairs in order, after a sort by three digits.
    pub fn sorted(&self) -> &Buffer {
        &self.keys[1]
    }

    /// Allocates `count` points of `classes` classes.
    pub fn new(kit: &Kit, count: u32, classes: u32) -> Result<SortBuffers> {
        let runs = count.div_ceil(RUN);
        Ok(SortBuffers {
            keys: [kit.array("sort keys 0", count, 8)?, kit.array("sort keys 1", count, 8)?],
            levels: [
                kit.array("sort counts", runs, 4 * u64::from(DIGITS))?,
                kit.array("sort sums", runs, 4)?,
                kit.array("sort tops", runs.div_ceil(DIGITS), 4)?,
            ],
            classes: kit.array("sorted classes", classes + 1, 8)?,
        })
    }
}

/// Steps of the sort.
pub struct SortSteps {
    digits: [u32; 3],
    levels: [u32; 3],
    /// Whether there is more than one class.
    classes: bool,
}

impl SortSteps {
    /// Adds the steps to the table.
    pub fn new(table: &mut StepTable, classes: u32) -> SortSteps {
        let last = DIGIT_SHIFTS[DIGIT_SHIFTS.len() - 1];
        SortSteps {
            digits: DIGIT_SHIFTS
                .map(|shift| table.add(Step { shift, last: u32::from(shift == last), ..Step::default() })),
            levels: [0, 1, 2].map(|level| table.add(Step { level, ..Step::default() })),
            classes: classes > 1,
        }
    }
}

/// The passes over one list.
pub struct Sort {
    work: Buffer,
    keys: BoundKernel,
    count: [BoundKernel; 2],
    sum: [BoundKernel; 2],
    scan: [BoundKernel; 3],
    classes: BoundKernel,
    scatter: [BoundKernel; 2],
}

impl Sort {
    /// Reorders `list.entries` by the positions of `points`.
    pub fn new(
        kit: &Kit,
        list: &List,
        points: &ShadingPoints,
        buffers: &SortBuffers,
        steps: &Resources,
    ) -> Result<Sort> {
        let keys = Resources::of([("keys", buffers.unsorted())]);
        let keys = kit.bind(&shaders::SORT_KEYS, &[&list.resources(), &points.resources(), &keys])?;
        Sort::by_keys(kit, keys, list, buffers, steps)
    }

    /// Writes to `list.entries` the values of other keys, in the order of the keys; `list.work` has their number as its
    /// total. `keys` is the kernel that writes [`SortBuffers::unsorted`]. [`SortSteps`] has the number of digits.
    pub fn by_keys(
        kit: &Kit,
        keys: BoundKernel,
        list: &List,
        buffers: &SortBuffers,
        steps: &Resources,
    ) -> Result<Sort> {
        let SortBuffers { keys: pairs, levels, classes } = buffers;
        let bind = |shader, own: Resources| kit.bind(shader, &[&list.resources(), &own, steps]);
        let count = |i: usize| bind(&shaders::SORT_COUNT, Resources::of([("keys", &pairs[i]), ("counts", &levels[0])]));
        let sum = |i: usize| bind(&shaders::SORT_SUM, Resources::of([("below", &levels[i]), ("sums", &levels[i + 1])]));
        // The top level has no bases; any buffer that the kernel does not write takes the binding.
        let scan = |i: usize| {
            let bases = &levels[if i == 2 { 1 } else { i + 1 }];
            bind(&shaders::SORT_SCAN, Resources::of([("values", &levels[i]), ("bases", bases)]))
        };
        let scatter = |i: usize| {
            let own = Resources::of([("keys", &pairs[i]), ("counts", &levels[0]), ("sorted", &pairs[1 - i])]);
            bind(&shaders::SORT_SCATTER, own)
        };
        Ok(Sort {
            work: list.work.clone(),
            keys,
            count: [count(0)?, count(1)?],
            sum: [sum(0)?, sum(1)?],
            scan: [scan(0)?, scan(1)?, scan(2)?],
            classes: bind(&shaders::SORT_CLASSES, Resources::of([("counts", &levels[0]), ("classes", classes)]))?,
            scatter: [scatter(0)?, scatter(1)?],
        })
    }

    /// Records the sort.
    pub fn record(&self, rec: &mut Recorder, steps: &SortSteps) -> Result<()> {
        let run = |rec: &mut Recorder, kernel: &BoundKernel, step: u32| {
            kernel.run_listed(rec, &push(step), &self.work, TOTAL_GROUPS)
        };
        self.keys.run_listed(rec, &[], &self.work, TOTAL_GROUPS)?;
        for (i, &digit) in steps.digits.iter().enumerate() {
            run(rec, &self.count[i % 2], digit)?;
            run(rec, &self.sum[0], steps.levels[1])?;
            run(rec, &self.sum[1], steps.levels[2])?;
            for level in [2, 1, 0] {
                run(rec, &self.scan[level], steps.levels[level])?;
            }
            if steps.classes && i + 1 == steps.digits.len() {
                self.classes.run(rec, &[], 1)?;
            }
            run(rec, &self.scatter[i % 2], digit)?;
        }
        Ok(())
    }
}

/// Oracle: the key of a position.
pub fn morton(frame: &FrameParameters, position: Vec3) -> u32 {
    let [x, y, z, scale] = frame.bounds_min;
    let unit = (position - Vec3::new(x, y, z)) * scale;
    let cell = (unit * 256.0).clamp(Vec3::ZERO, Vec3::splat(255.0)).as_uvec3();
    let code: u32 = (0..8).fold(0, |code, bit| {
        let of = |c: u32, axis: u32| (c >> bit & 1) << (3 * bit + axis);
        code | of(cell.x, 0) | of(cell.y, 1) | of(cell.z, 2)
    });
    code.min(0xff_fffe)
}

/// Oracle: the class of a slot: the position of its pixel in the pattern.
pub fn class_of(frame: &FrameParameters, slot: u32) -> u32 {
    let [width, _, pixels, _] = frame.size;
    let [across, down, ..] = frame.pattern;
    let pixel = slot % pixels;
    pixel % width % across + across * (pixel / width % down)
}

/// Oracle: the list by classes and keys; equal ones keep their order.
pub fn reference(frame: &FrameParameters, list: &[u32], positions: &[Vec3]) -> Vec<u32> {
    let mut sorted = list.to_vec();
    let classes = frame.pattern[2];
    let bits = if classes > 1 { 32 - classes.leading_zeros() } else { 0 };
    sorted.sort_by_key(|&slot| (class_of(frame, slot), morton(frame, positions[slot as usize]) >> bits));
    sorted
}
