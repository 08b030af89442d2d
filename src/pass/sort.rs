//! The receivers on a list are put in the order of the Morton codes of their positions, so that the 64 receivers of a cluster lie
//! close together and the shaft from a light to them is narrow, also across silhouettes. With interleaved sampling the classes
//! of pixels stand one after the other, each in this order, for each is lit by a set of lights of its own; the class takes the
//! topmost bits of the key, and the code loses as many at its end.
//!
//! Codes have 8 bits for each axis of the scene's bounding cube. A stable radix sort by three digits of 8 bits: count the digit in
//! each run of 512 keys, scan the counts in three levels, scatter. Equal codes keep the list's order, which is that of
//! screen tiles. Before the sort a list has a slot for every ray, dead ones too, which go to its end: so the order, and with
//! it which receivers share a cluster, is the same in every run.
//!
//! Cost for n receivers: 60 n bytes and about 40 n operations a digit; 22 dispatches, or 23 with classes.

use glam::Vec3;

use super::layout::{Frame, Step};
use super::schedule::TOTAL_GROUPS;
use super::{Kernels, List, Receivers, push};
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Context, Kernel, Memory, Recorder};
use crate::plan::StepTable;

/// Keys that one invocation handles.
pub const RUN: u32 = 512;
/// Values of a digit.
pub const DIGITS: u32 = 256;
/// Bits of the key, three digits.
const DIGIT_SHIFTS: [u32; 3] = [0, 8, 16];

/// Room to sort in, shared by all lists of a frame.
#[derive(Clone)]
pub struct SortBuffers {
    keys: [Buffer; 2],
    levels: [Buffer; 3],
    /// For each class of pixels its first cluster and its first receiver on the list; then one past the last of all.
    pub classes: Buffer,
}

impl SortBuffers {
    /// Keys and what they stand for, as they come.
    pub fn unsorted(&self) -> &Buffer {
        &self.keys[0]
    }

    /// The same in order, after a sort by three digits.
    pub fn sorted(&self) -> &Buffer {
        &self.keys[1]
    }

    /// Room for `count` receivers of so many classes.
    pub fn new(context: &Context, count: u32, classes: u32) -> Result<SortBuffers> {
        let runs = u64::from(count.div_ceil(RUN));
        let device = |name: &str, bytes: u64| Buffer::new(context, name, bytes, Memory::Device);
        Ok(SortBuffers {
            keys: [device("sort keys 0", 8 * u64::from(count))?, device("sort keys 1", 8 * u64::from(count))?],
            levels: [
                device("sort counts", 4 * runs * u64::from(DIGITS))?,
                device("sort sums", 4 * runs)?,
                device("sort tops", 4 * runs.div_ceil(u64::from(DIGITS)))?,
            ],
            classes: device("sorted classes", 8 * u64::from(classes + 1))?,
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
    /// Adds them to the table.
    pub fn new(table: &mut StepTable, classes: u32) -> SortSteps {
        let last = DIGIT_SHIFTS[DIGIT_SHIFTS.len() - 1];
        SortSteps {
            digits: DIGIT_SHIFTS
                .map(|first| table.add(Step { first, last: u32::from(first == last), ..Step::default() })),
            levels: [0, 1, 2].map(|first| table.add(Step { first, ..Step::default() })),
            classes: classes > 1,
        }
    }
}

/// The passes over one list.
pub struct Sort {
    work: Buffer,
    keys: (Kernel, Bindings),
    count: (Kernel, [Bindings; 2]),
    sum: (Kernel, [Bindings; 2]),
    scan: (Kernel, [Bindings; 3]),
    classes: (Kernel, Bindings),
    scatter: (Kernel, [Bindings; 2]),
}

impl Sort {
    /// Reorders `list.pixels` by the positions of `receivers`.
    pub fn new(
        kernels: &Kernels,
        frame: &Buffer,
        list: &List,
        receivers: &Receivers,
        buffers: &SortBuffers,
        steps: &Buffer,
    ) -> Result<Sort> {
        let keys = kernels.sort_keys.bind(&[
            ("frame", frame.into()),
            ("work", (&list.work).into()),
            ("list", (&list.pixels).into()),
            ("receiver_position", (&receivers.position).into()),
            ("keys", buffers.unsorted().into()),
        ])?;
        Sort::by_keys(kernels, frame, (kernels.sort_keys.clone(), keys), list, buffers, steps)
    }

    /// Puts into `list.pixels`, as many as `list.work` has in total, what other keys stand for, in their order. `keys` is the
    /// kernel that writes [`SortBuffers::unsorted`]: pairs of a key and what it stands for. [`SortSteps`] say how many digits keys have.
    pub fn by_keys(
        kernels: &Kernels,
        frame: &Buffer,
        keys_by: (Kernel, Bindings),
        list: &List,
        buffers: &SortBuffers,
        steps: &Buffer,
    ) -> Result<Sort> {
        let SortBuffers { keys, levels, classes } = buffers;
        let work = &list.work;
        let common = |k: &Kernel, more: &[(&str, &Buffer)]| {
            let mut named = vec![("work", work.into()), ("steps", steps.into())];
            named.extend(more.iter().map(|&(name, buffer)| (name, buffer.into())));
            k.bind(&named)
        };
        let count = |i: usize| common(&kernels.sort_count, &[("keys", &keys[i]), ("counts", &levels[0])]);
        let sum = |i: usize| common(&kernels.sort_sum, &[("below", &levels[i]), ("sums", &levels[i + 1])]);
        // The top level has no bases; any buffer that it does not write stands in.
        let scan = |i: usize| {
            common(&kernels.sort_scan, &[("values", &levels[i]), ("bases", &levels[if i == 2 { 1 } else { i + 1 }])])
        };
        let scatter = |i: usize| {
            let named = [("keys", &keys[i]), ("counts", &levels[0]), ("sorted", &keys[1 - i]), ("list", &list.pixels)];
            common(&kernels.sort_scatter, &named)
        };
        let class_bindings = kernels.sort_classes.bind(&[
            ("frame", frame.into()),
            ("work", work.into()),
            ("counts", (&levels[0]).into()),
            ("classes", classes.into()),
        ])?;
        Ok(Sort {
            work: work.clone(),
            keys: keys_by,
            count: (kernels.sort_count.clone(), [count(0)?, count(1)?]),
            sum: (kernels.sort_sum.clone(), [sum(0)?, sum(1)?]),
            scan: (kernels.sort_scan.clone(), [scan(0)?, scan(1)?, scan(2)?]),
            classes: (kernels.sort_classes.clone(), class_bindings),
            scatter: (kernels.sort_scatter.clone(), [scatter(0)?, scatter(1)?]),
        })
    }

    /// Records the sort.
    pub fn record(&self, rec: &mut Recorder, steps: &SortSteps) -> Result<()> {
        let run = |rec: &mut Recorder, kernel: &Kernel, bindings: &Bindings, step: u32| {
            rec.dispatch_indirect(kernel, bindings, &push(step), &self.work, TOTAL_GROUPS)
        };
        rec.dispatch_indirect(&self.keys.0, &self.keys.1, &[], &self.work, TOTAL_GROUPS)?;
        for (i, &digit) in steps.digits.iter().enumerate() {
            run(rec, &self.count.0, &self.count.1[i % 2], digit)?;
            run(rec, &self.sum.0, &self.sum.1[0], steps.levels[1])?;
            run(rec, &self.sum.0, &self.sum.1[1], steps.levels[2])?;
            for level in [2, 1, 0] {
                run(rec, &self.scan.0, &self.scan.1[level], steps.levels[level])?;
            }
            if steps.classes && i + 1 == steps.digits.len() {
                rec.dispatch(&self.classes.0, &self.classes.1, &[], 1)?;
            }
            run(rec, &self.scatter.0, &self.scatter.1[i % 2], digit)?;
        }
        Ok(())
    }
}

/// Oracle: the key of a position.
pub fn morton(frame: &Frame, position: Vec3) -> u32 {
    let [x, y, z, scale] = frame.bounds_min;
    let unit = (position - Vec3::new(x, y, z)) * scale;
    let cell = (unit * 256.0).clamp(Vec3::ZERO, Vec3::splat(255.0)).as_uvec3();
    let code: u32 = (0..8).fold(0, |code, bit| {
        let of = |c: u32, axis: u32| (c >> bit & 1) << (3 * bit + axis);
        code | of(cell.x, 0) | of(cell.y, 1) | of(cell.z, 2)
    });
    code.min(0xff_fffe)
}

/// Oracle: the class of a slot, the place of its pixel in the pattern.
pub fn class_of(frame: &Frame, slot: u32) -> u32 {
    let [width, _, pixels, _] = frame.size;
    let [across, down, ..] = frame.pattern;
    let pixel = slot % pixels;
    pixel % width % across + across * (pixel / width % down)
}

/// Oracle: the list in the order of classes and keys, equal ones in the order they had.
pub fn reference(frame: &Frame, list: &[u32], positions: &[Vec3]) -> Vec<u32> {
    let mut sorted = list.to_vec();
    let classes = frame.pattern[2];
    let bits = if classes > 1 { 32 - classes.leading_zeros() } else { 0 };
    sorted.sort_by_key(|&slot| (class_of(frame, slot), morton(frame, positions[slot as usize]) >> bits));
    sorted
}
