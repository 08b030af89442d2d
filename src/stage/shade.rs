//! Lights the visible shading points by the virtual lights of the pass.

use super::points::chunks;
use super::{Eye, Stage};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::Recorder;
use crate::pass::light_lists::LightLists;
use crate::pass::shade::{self, Chunk};
use crate::pass::{Kit, Lighting};
use crate::plan::{Plan, StepTable};
use crate::ring::Paths;

/// The stage.
pub struct Shade {
    /// Light at the shading points; later stages add to it.
    pub lighting: Lighting,
    pass: shade::Shade,
    chunks: Vec<Chunk>,
    delta: u32,
}

impl Shade {
    /// Lights the points of `eye` by the lights of `lists`.
    pub fn new(kit: &Kit, scene: &DeviceScene, plan: &Plan, eye: &Eye, lists: &LightLists) -> Result<Shade> {
        let mut table = StepTable::default();
        let chunks = chunks(&mut table, plan, (kit.context, scene), 0, eye.order);
        let steps = table.stage(kit, "shade steps")?;
        let lighting = Lighting::new(kit.context, "eye", plan.eye.slots())?;
        let inputs = shade::Inputs {
            points: &eye.points,
            list: &eye.list,
            lists,
            progress: &eye.rays.progress,
            lighting: &lighting,
            classes: eye.classes(),
        };
        Ok(Shade { pass: shade::Shade::new(kit, &inputs, &steps)?, lighting, chunks, delta: plan.lists.delta })
    }

    /// Records its passes for lights of these paths.
    pub fn run_paths(&self, rec: &mut Recorder, paths: &Paths) -> Result<()> {
        let lit = self.chunks.iter().filter(|chunk| chunk.is_lit(paths, self.delta));
        rec.scope(Self::NAME, |rec| self.pass.record(rec, lit))
    }
}

impl Stage for Shade {
    const NAME: &'static str = "shade";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.pass.record(rec, &self.chunks)
    }
}
