//! The stages of a frame. Each owns its passes, buffers and steps, is made from the outputs of earlier stages, and
//! records its work as a whole. [`crate::frame`] puts them in order.

mod compensation;
mod edges;
mod eye;
mod glossy_planes;
mod lamp_edges;
mod near_light;
mod output;
mod photons;
mod points;
mod shade;
mod soft_shadows;
mod splats;
mod upsample;
mod walk;

pub use compensation::{Bounce, Compensation};
pub use edges::Edges;
pub use eye::Eye;
pub use glossy_planes::GlossyPlanes;
pub use lamp_edges::LampEdges;
pub use near_light::NearLight;
pub use output::Output;
pub use photons::{PhotonLighting, Photons};
pub use points::PointOrder;
pub use shade::Shade;
pub use soft_shadows::SoftShadows;
pub use splats::Splats;
pub use upsample::Upsample;
pub use walk::Walk;

use crate::error::Result;
use crate::gpu::{Buffer, Recorder};
use crate::pass::delta_choice::DeltaChoice;
use crate::pass::discontinuity::Discontinuity;
use crate::pass::discontinuity_lobes::DiscontinuityLobes;
use crate::pass::edges::EdgeGuides;
use crate::pass::gain::{Gain, PathGain};
use crate::pass::glossy_light::GlossyLight;
use crate::pass::importance::Importance;
use crate::pass::kept_light::KeptLight;
use crate::pass::layout::DispatchCounts;
use crate::pass::lens::Lens;
use crate::pass::light_lists::LightLists;
use crate::pass::merge::Merge;
use crate::pass::mirror_lights::MirrorLights;
use crate::pass::motion_blur::MotionBlur;
use crate::pass::outliers::Outliers;
use crate::pass::soft_shadow::SoftShadowAdd;
use crate::pass::sparse_windows::SparseWindows;
use crate::pass::summands::Summands;
use crate::pass::third_light::ThirdLight;
use crate::pass::unlikely::Unlikely;
use crate::pass::velocity::Velocity;
use crate::pass::{EyePathState, Kit, List, Rays, ShadingPoints};

/// Eye rays of pixels, their first hits and shading points.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    /// First hits; `None`: edges keep one ray.
    pub guides: Option<&'a EdgeGuides>,
    /// The rays.
    pub rays: &'a Rays,
    /// Throughput of their paths.
    pub paths: &'a EyePathState,
    /// Shading points, one for each pixel and component.
    pub points: &'a ShadingPoints,
    /// Number of pixels.
    pub pixels: u32,
    /// Whether `guides` has reflections in flat mirrors.
    pub plain_mirrors: bool,
}

/// A part of the frame that is recorded as a whole. An optional stage is an `Option` of one.
pub trait Stage {
    /// Label of its commands, and key of its timings.
    const NAME: &'static str;

    /// Records work needed once, after the uploads and before the first frame.
    fn record_setup(&self, _rec: &mut Recorder) -> Result<()> {
        Ok(())
    }

    /// Records its passes.
    fn record(&self, rec: &mut Recorder) -> Result<()>;

    /// Records its passes under its name.
    fn run(&self, rec: &mut Recorder) -> Result<()> {
        rec.scope(Self::NAME, |rec| self.record(rec))
    }
}

impl<S: Stage> Stage for Option<S> {
    const NAME: &'static str = S::NAME;

    fn record_setup(&self, rec: &mut Recorder) -> Result<()> {
        self.as_ref().map_or(Ok(()), |stage| stage.record_setup(rec))
    }

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.as_ref().map_or(Ok(()), |stage| stage.record(rec))
    }

    fn run(&self, rec: &mut Recorder) -> Result<()> {
        self.as_ref().map_or(Ok(()), |stage| stage.run(rec))
    }
}

/// Stages of a single pass.
macro_rules! stages {
    ($($pass:ty = $name:literal),* $(,)?) => {
        $(impl Stage for $pass {
            const NAME: &'static str = $name;

            fn record(&self, rec: &mut Recorder) -> Result<()> {
                <$pass>::record(self, rec)
            }
        })*
    };
}

stages! {
    Importance = "importance",
    KeptLight = "kept_light",
    DeltaChoice = "delta_choice",
    LightLists = "light_lists",
    MirrorLights = "mirror_lights",
    GlossyLight = "glossy_light",
    Discontinuity = "discontinuity",
    SparseWindows = "sparse_windows",
    DiscontinuityLobes = "discontinuity_lobes",
    PathGain = "path_gain",
    Gain = "gain",
    Outliers = "outliers",
    Unlikely = "unlikely",
    SoftShadowAdd = "soft_shadow_add",
    ThirdLight = "third_light",
    Merge = "merge",
    Summands = "summands",
    Velocity = "velocity",
    MotionBlur = "motion_blur",
}

impl Stage for Lens {
    const NAME: &'static str = "lens";

    fn record_setup(&self, rec: &mut Recorder) -> Result<()> {
        Lens::record_setup(self, rec)
    }

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        Lens::record(self, rec)
    }
}

/// Counts to clear when a stage begins.
struct Counts {
    cleared: Buffer,
    of: Vec<Buffer>,
}

impl Counts {
    /// The counts of these lists; their entries belong to `classes` classes of pixels.
    fn new<'a>(kit: &Kit, classes: u32, lists: impl IntoIterator<Item = &'a List>) -> Result<Counts> {
        let of = lists.into_iter().map(|list| list.work.clone()).collect();
        Ok(Counts { cleared: kit.stage("cleared work", &[DispatchCounts::of_classes(classes)])?, of })
    }

    fn record_clear(&self, rec: &mut Recorder) -> Result<()> {
        self.of.iter().try_for_each(|work| rec.copy(&self.cleared, work))
    }
}

/// The list for a batch of rays that are all traced: only its counts are used.
fn batch(kit: &Kit, name: &str) -> Result<List> {
    List::new(kit, name, &kit.array(&format!("{name} list"), 4, 4)?)
}
