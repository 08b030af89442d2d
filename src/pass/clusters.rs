//! Clusters in the order of the screen: the receivers of what the eye sees are put in clusters of 64 by their pixels, where `sort`
//! does it by their positions in space.
//!
//! A block of pixels is 8 times as wide and high as the interleaving pattern; in it each class has 8 x 8 pixels, which are a
//! cluster. So clusters need no sort, the receivers of one are near each other in memory, and so are the clusters that come
//! one after the other. In return a cluster may reach across silhouettes, and tracing it costs more there.
//!
//! Every pixel, and after all of them every second component, has a place of its own ([`place_of`]), into which `eye_points` and
//! `split_points` write its slot. Clusters without any receiver, above all those of second components, are left out of the list; in the others
//! places without one hold 0xffffffff.
//!
//! Cost for n pixels: 20 n bytes, a few operations; one workgroup that goes over all n / 64 clusters; 3 dispatches. With second
//! components, as much again for those.

use super::layout::Frame;
use super::schedule::{Schedule, TOTAL_GROUPS};
use super::{BoundKernel, Kit, List, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Slot of a place that holds no receiver.
pub const NO_RECEIVER: u32 = u32::MAX;

/// Clusters of one component of an image.
pub fn count([width, height]: [u32; 2], [across, down]: [u32; 2]) -> u32 {
    width.div_ceil(8 * across) * height.div_ceil(8 * down) * across * down
}

/// The pass.
pub struct Clusters {
    /// Slot of the receiver of each place; `eye_points` and `split_points` write it.
    pub places: Buffer,
    /// For each cluster on the list its class, and its number among all.
    pub listed: Buffer,
    mark: BoundKernel,
    list: BoundKernel,
    fill: BoundKernel,
    schedule: Schedule,
    work: Buffer,
    count: u32,
}

impl Clusters {
    /// Fills `list` from the places; `count` clusters in all.
    pub fn new(kit: &Kit, list: &List, count: u32, steps: &Resources) -> Result<Clusters> {
        let places = kit.array("cluster places", count, 4 * 64)?;
        let marks = kit.array("cluster marks", count, 4)?;
        // As long as the table of classes is, whose kernel looks one beyond.
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

    /// Records that no place holds a receiver, before `eye_points` and `split_points` write those that do.
    pub fn record_clear(&self, rec: &mut Recorder) -> Result<()> {
        rec.fill(&self.places, NO_RECEIVER)
    }

    /// Records the pass; `step` is that of a list that was just filled.
    pub fn record(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        self.mark.run(rec, &[], groups(self.count))?;
        self.list.run(rec, &[], 1)?;
        self.schedule.record(rec, step)?;
        self.fill.run_listed(rec, &[], &self.work, TOTAL_GROUPS)
    }
}

/// Oracle: the place of a pixel among those of its component.
pub fn place_of(frame: &Frame, [x, y]: [u32; 2]) -> u32 {
    let [width, ..] = frame.size;
    let [across, down, classes, _] = frame.pattern;
    let blocks = width.div_ceil(8 * across);
    let block = x / (8 * across) + blocks * (y / (8 * down));
    let class = x % across + across * (y % down);
    64 * (block * classes + class) + 8 * (y / down % 8) + x / across % 8
}

/// Oracle: the list of these receivers, slots of pixels and of second components.
pub fn reference(frame: &Frame, receivers: &[u32]) -> Vec<u32> {
    let [width, height, pixels, _] = frame.size;
    let [across, down, ..] = frame.pattern;
    let places = 64 * count([width, height], [across, down]);
    let mut all = vec![NO_RECEIVER; 2 * places as usize];
    for &slot in receivers {
        let (component, pixel) = (slot / pixels, slot % pixels);
        all[(component * places + place_of(frame, [pixel % width, pixel / width])) as usize] = slot;
    }
    all.chunks(64).filter(|cluster| cluster.iter().any(|&slot| slot != NO_RECEIVER)).flatten().copied().collect()
}
