//! Pixels that take the light of lit points nearby.

use super::{Counts, Eye, Seen, Stage, batch};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::{Buffer, Memory, Recorder, Resources};
use crate::pass::camera_rays::CameraRays;
use crate::pass::edges::EdgeGuides;
use crate::pass::eye_points::{self, EyePoints};
use crate::pass::layout::{FrameParameters, PointStep};
use crate::pass::shade::Chunk;
use crate::pass::trace::{EyeSteps, Trace};
use crate::pass::upsample::{self, Lit};
use crate::pass::{EyePathState, Kit, Lighting, List, Rays, ShadingPoints};
use crate::plan::{Plan, StepTable};

/// The stage.
pub struct Upsample {
    /// Parameters of the pixels.
    pub parameters: Buffer,
    /// Their eye rays.
    pub rays: Rays,
    /// These end at the first hits.
    pub paths: EyePathState,
    /// The first hits.
    pub points: ShadingPoints,
    /// First hits as guides.
    pub guides: EdgeGuides,
    /// The light that lit points lend. Radiance of lobes is in the emission of `points`.
    pub lighting: Lighting,
    counts: Counts,
    camera_rays: CameraRays,
    trace: Trace,
    steps: EyeSteps,
    eye_points: EyePoints,
    pass: upsample::Upsample,
    pixels: u32,
    tile_count: u32,
}

impl Upsample {
    /// Lights the pixels of a plan by the points of `eye`, lit by `lighting`; `None`: the plan lights every pixel itself. Its passes, and those after it, take the kit [`Upsample::kit`].
    pub fn new(
        kit: &Kit,
        scene: &DeviceScene,
        plan: &Plan,
        eye: &Eye,
        lighting: &Lighting,
    ) -> Result<Option<Upsample>> {
        let (true, Some(lit_guides)) = (plan.upsamples(), &eye.guides) else { return Ok(None) };
        let parameters =
            Buffer::new(kit.context, "parameters of pixels", size_of::<FrameParameters>() as u64, Memory::Device)?;
        let kit = &Self::kit_of(kit, &parameters);
        let [width, height] = plan.view.size();
        let (pixels, tile_count) = (width * height, width.div_ceil(8) * height.div_ceil(8));
        let mut table = StepTable::default();
        let shares_origin = !plan.view.is_orthographic();
        let ray_clusters = Chunk::clusters(&plan.settings, scene.clusters(kit.context)).filter(|_| shares_origin);
        let eye_steps = EyeSteps::new(&mut table, plan, pixels, ray_clusters);
        let steps = table.stage(kit, "steps of pixels")?;
        let rays = Rays::new(kit.context, "pixel", pixels)?;
        let paths = EyePathState::new(kit.context, pixels, 0)?;
        let points = ShadingPoints::new(kit.context, "pixel", pixels)?;
        let guides = EdgeGuides::new(kit, &rays, pixels, false)?;
        let of_pixels = Lighting::new(kit.context, "pixel", pixels)?;
        let batch = batch(kit, "pixel rays")?;
        let list = List::new(kit, "pixel points", &kit.array("pixel points list", pixels, 4)?)?;
        let step = PointStep { order: PointStep::ANY, last: u32::from(plan.settings.max_depth == 1), components: 1 };
        let inputs = eye_points::Inputs { rays: &rays, paths: &paths, points: &points, list: &list, step };
        let lit = Lit { guides: lit_guides, points: &eye.points, paths: &eye.paths, lighting };
        Ok(Some(Upsample {
            counts: Counts::new(kit, 1, [&batch, &list])?,
            camera_rays: CameraRays::new(kit, &rays, &paths, &points, pixels)?,
            trace: Trace::of_eye(kit, &rays, &batch, &steps, shares_origin && scene.wide_nodes.is_some())?,
            steps: eye_steps,
            eye_points: EyePoints::new(kit, &inputs, tile_count)?,
            pass: upsample::Upsample::new(kit, &lit, (&guides, &points, &of_pixels), pixels)?,
            parameters,
            rays,
            paths,
            points,
            guides,
            lighting: of_pixels,
            pixels,
            tile_count,
        }))
    }

    fn kit_of<'a>(kit: &Kit<'a>, parameters: &Buffer) -> Kit<'a> {
        kit.with(&Resources::of([("frame", parameters)]))
    }

    /// A kit for passes over its pixels.
    pub fn kit<'a>(&self, kit: &Kit<'a>) -> Kit<'a> {
        Self::kit_of(kit, &self.parameters)
    }

    /// Its pixels.
    pub fn seen(&self) -> Seen<'_> {
        let Upsample { rays, paths, points, pixels, .. } = self;
        Seen { guides: Some(&self.guides), rays, paths, points, pixels: *pixels, plain_mirrors: false }
    }

    /// Records the parameters of a pass.
    pub fn record_start(&self, rec: &mut Recorder, parameters: &FrameParameters) -> Result<()> {
        rec.update(&self.parameters, 0, bytemuck::bytes_of(parameters))
    }

    /// The part that finds what pixels show.
    pub fn record_points(&self, rec: &mut Recorder) -> Result<()> {
        self.counts.record_clear(rec)?;
        self.camera_rays.record(rec)?;
        self.trace.record_eye(rec, &self.steps, self.tile_count, self.pixels)?;
        self.guides.record(rec)?;
        self.eye_points.record(rec)
    }

    /// The part that lights them.
    pub fn record_light(&self, rec: &mut Recorder) -> Result<()> {
        self.pass.record(rec)
    }
}

impl Stage for Upsample {
    const NAME: &'static str = "upsample";

    fn record_setup(&self, rec: &mut Recorder) -> Result<()> {
        rec.fill(&self.lighting.specular, 0)
    }

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_points(rec)?;
        self.record_light(rec)
    }
}
