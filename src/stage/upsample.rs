//! Pixels that take the light of lit points nearby.

use super::{Eye, LampEdges, Seen, Stage};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::{Buffer, Memory, Recorder, Resources};
use crate::pass::layout::FrameParameters;
use crate::pass::merge::Merge;
use crate::pass::outliers::{self, Outliers};
use crate::pass::third_light::ThirdLight;
use crate::pass::unlikely::Unlikely;
use crate::pass::upsample::{Lit, Upsample as FirstHits};
use crate::pass::upsample_paths::UpsamplePaths;
use crate::pass::{Kit, Lighting};
use crate::plan::Plan;

/// The stage.
pub struct Upsample {
    /// Parameters of the pixels.
    pub parameters: Buffer,
    /// Finds their shading points.
    pub eye: Eye,
    /// The light that lit points lend. Where a pixel shows its first hit, radiance of lobes is in its emission.
    pub lighting: Lighting,
    /// Lights first hits.
    pub first_hits: FirstHits,
    /// Where pixels see through mirrors and glass.
    pub through: Option<Through>,
}

/// Mirrors and glass.
pub struct Through {
    /// Lights what is seen through them.
    pub paths: UpsamplePaths,
    third_light: Option<ThirdLight>,
    lamp_edges: Option<LampEdges>,
    outliers: Option<(Outliers, Unlikely)>,
    merge: Merge,
}

impl Upsample {
    /// Lights the pixels of a plan by the points of `lit_eye`, with `lighting` after filters and `raw` before them; `None`: the plan lights every pixel itself. Its passes, and those after it, take the kit [`Upsample::kit`].
    pub fn new(
        kit: &Kit,
        scene: &DeviceScene,
        plan: &Plan,
        lit_eye: &Eye,
        [lighting, raw]: [&Lighting; 2],
    ) -> Result<Option<Upsample>> {
        let (Some(plan), Some(guides)) = (plan.of_pixels(), &lit_eye.guides) else { return Ok(None) };
        let parameters =
            Buffer::new(kit.context, "parameters of pixels", size_of::<FrameParameters>() as u64, Memory::Device)?;
        let kit = &Self::kit_of(kit, &parameters);
        let eye = Eye::new(kit, scene, &plan)?;
        let of_pixels = Lighting::new(kit.context, "pixel", plan.eye.slots())?;
        let lit = Lit { guides, points: &lit_eye.points, paths: &lit_eye.paths, lighting };
        let lit_marks = lit_eye.ideal_marks();
        let first_hits = FirstHits::new(kit, &lit, &eye.seen(), &of_pixels)?;
        let through = match plan.eye.components {
            1 => None,
            _ => Some(Through::new(kit, &plan, (&eye, &of_pixels), (&lit, raw, lit_marks))?),
        };
        Ok(Some(Upsample { first_hits, through, parameters, eye, lighting: of_pixels }))
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
        self.eye.seen()
    }

    /// Records the parameters of a pass.
    pub fn record_start(&self, rec: &mut Recorder, parameters: &FrameParameters) -> Result<()> {
        rec.update(&self.parameters, 0, bytemuck::bytes_of(parameters))
    }
}

impl Through {
    fn new(
        kit: &Kit,
        plan: &Plan,
        (eye, lighting): (&Eye, &Lighting),
        (lit, raw, lit_marks): (&Lit, &Lighting, &Buffer),
    ) -> Result<Through> {
        let (points, paths, tiles) = (&eye.points, &eye.paths, &eye.ideal_tiles);
        let outliers = match plan.settings.filter.is_some() {
            false => None,
            true => {
                let region = &eye.planes.region;
                let inputs = outliers::Inputs { points, paths, lighting, tiles, region, path_gain: None };
                let slots = plan.eye.pixels * plan.eye.components;
                Some((Outliers::new(kit, &inputs, slots)?, Unlikely::new(kit, &inputs, slots)?))
            }
        };
        Ok(Through {
            paths: UpsamplePaths::new(kit, (eye, lighting), (lit, raw, lit_marks), plan.eye.slots_of_pixel)?,
            third_light: match plan.eye.slots_of_pixel {
                3 => Some(ThirdLight::new(kit, points, paths, lighting, tiles)?),
                _ => None,
            },
            lamp_edges: LampEdges::new(kit, plan, eye, (lighting, None))?,
            outliers,
            merge: Merge::new(kit, points, paths, lighting, tiles, &points.emitted)?,
        })
    }

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.paths.record(rec)?;
        self.third_light.record(rec)?;
        self.lamp_edges.record(rec)?;
        if let Some((outliers, unlikely)) = &self.outliers {
            outliers.record(rec)?;
            unlikely.record(rec)?;
        }
        self.merge.record(rec)
    }
}

impl Stage for Upsample {
    const NAME: &'static str = "upsample";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        rec.scope("upsample_eye", |rec| self.eye.record(rec))?;
        rec.scope("upsample_first", |rec| self.first_hits.record(rec))?;
        let through = self.through.as_ref();
        through.map_or(Ok(()), |through| rec.scope("upsample_paths", |rec| through.record(rec)))
    }
}
