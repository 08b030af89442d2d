//! Clusters in screen order: groups the shading points that the eye sees into clusters of 64 by their pixels; `sort`
//! groups them by their positions in space instead.
//!
//! A block of pixels is 8 times as wide and high as the interleaving pattern; each class has 8 x 8 pixels in it, which
//! form a cluster. So clusters need no sort, the points of a cluster are near each other in memory, and so are
//! consecutive clusters. The price: a cluster may reach across silhouettes, and tracing it costs more there.
//!
//! Every pixel has a place of its own ([`place_of`]), and after all pixels every second component has one, and then every third one; `eye_points` and `split_points`
//! write the slot of the shading point into it. The list leaves out clusters without any point, most of them of second
//! components; in the others, places without a point hold 0xffffffff.
//!
//! Cost for n pixels: 20 n bytes, a few operations a pixel; one workgroup that visits all n / 64 clusters; 3
//! dispatches. Second components cost the same once more, and so do third ones.

use super::layout::FrameParameters;
use super::schedule::{Schedule, TOTAL_GROUPS};
use super::{BoundKernel, Kit, List, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Slot in a place without a shading point.
pub const NO_POINT: u32 = u32::MAX;

/// Number of clusters of one component of an image.
pub fn count([width, height]: [u32; 2], [across, down]: [u32; 2]) -> u32 {
    width.div_ceil(8 * across) * height.div_ceil(8 * down) * across * down
}

/// The pass.
pub struct Clusters {
    /// Slot of the shading point of each place; `eye_points` and `split_points` write it.
    pub places: Buffer,
    /// Class and number of each cluster on the list.
    pub listed: Buffer,
    mark: BoundKernel,
    list: BoundKernel,
    fill: BoundKernel,
    schedule: Schedule,
    work: Buffer,
    count: u32,
}

impl Clusters {
    /// Fills `list` from the places of `count` clusters.
    pub fn new(kit: &Kit, list: &List, count: u32, steps: &Resources) -> Result<Clusters> {
        let places = kit.array("cluster places", count, 4 * 64)?;
        let marks = kit.array("cluster marks", count, 4)?;
        // The length of the table of classes of `sort`: the kernel reads one entry past the end.
        let listed = kit.array("listed clusters", count + 1, 8)?;
        let own = Resources::of([("places", &places), ("marks", &marks), ("clusters", &listed)]);
        let bind = |shader| kit.bind(shader, &[&list.resources(), &own]);
        Ok(Clusters {
            mark: bind(&shaders::CLUSTERS_MARK)?,
            list: bind(&shaders::CLUSTERS_LIST)?,
            fill: bind(&shaders::CLUSTERS_FILL)?,
            schedule: Schedule::new(kit, &list.work, steps)?,
            work: list.work.clone(),
            count,
            places,
            listed,
        })
    }

    /// Records the clearing of all places, before `eye_points` and `split_points` write them.
    pub fn record_clear(&self, rec: &mut Recorder) -> Result<()> {
        rec.fill(&self.places, NO_POINT)
    }

    /// Records the pass; `step` is that of a newly filled list.
    pub fn record(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        self.mark.run(rec, &[], groups(self.count))?;
        self.list.run(rec, &[], 1)?;
        self.schedule.record(rec, step)?;
        self.fill.run_listed(rec, &[], &self.work, TOTAL_GROUPS)
    }
}

/// Oracle: the place of a pixel within its component.
pub fn place_of(frame: &FrameParameters, [x, y]: [u32; 2]) -> u32 {
    let [width, ..] = frame.size;
    let [across, down, classes, _] = frame.pattern;
    let blocks = width.div_ceil(8 * across);
    let block = x / (8 * across) + blocks * (y / (8 * down));
    let class = x % across + across * (y % down);
    64 * (block * classes + class) + 8 * (y / down % 8) + x / across % 8
}

/// Oracle: the list for these slots of pixels and their components.
pub fn reference(frame: &FrameParameters, receivers: &[u32]) -> Vec<u32> {
    let [width, height, pixels, _] = frame.size;
    let [across, down, ..] = frame.pattern;
    let places = 64 * count([width, height], [across, down]);
    let mut all = vec![NO_POINT; 3 * places as usize];
    for &slot in receivers {
        let (component, pixel) = (slot / pixels, slot % pixels);
        all[(component * places + place_of(frame, [pixel % width, pixel / width])) as usize] = slot;
    }
    all.chunks(64).filter(|cluster| cluster.iter().any(|&slot| slot != NO_POINT)).flatten().copied().collect()
}
