//! A device on which checks run, with the sizes and the seed that were asked for.

use std::fmt::Display;
use std::ops::Deref;
use std::vec::IntoIter;

use super::rig::Rig;
use crate::gpu::Context;
use crate::pass::TraversalKernels;
use crate::scene::Scene;
use crate::settings::{Settings, Traversal};

/// Sizes that reveal off-by-one mistakes: one, part of a workgroup, a workgroup, many and one more.
pub const AWKWARD_SIZES: [usize; 4] = [1, 27, 64, 2049];

/// The same as images, and a prime width.
pub const AWKWARD_IMAGES: [[u32; 2]; 5] = [[1, 1], [27, 1], [8, 8], [683, 3], [31, 17]];

/// Options of a run of checks.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Choices {
    /// Added to the seed of every check.
    pub seed: u64,
    /// Widths and heights in place of [`AWKWARD_IMAGES`]; lists have as many elements as these have pixels. Empty: no others.
    pub sizes: Vec<[u32; 2]>,
}

/// A device with the choices of a run. It stands for its device wherever one is wanted.
pub struct Bench {
    context: Context,
    choices: Choices,
}

impl Deref for Bench {
    type Target = Context;

    fn deref(&self) -> &Context {
        &self.context
    }
}

impl Bench {
    /// A bench on this device.
    pub fn new(context: &Context, choices: Choices) -> Bench {
        Bench { context: context.clone(), choices }
    }

    /// The device again, for who keeps it.
    pub fn context(&self) -> Context {
        self.context.clone()
    }

    /// Whether sizes and seed are the standard ones. Only then is it known that every case of interest comes up, which checks look at
    /// as well, lest they compare nothing.
    pub fn is_standard(&self) -> bool {
        self.choices == Choices::default()
    }

    /// Sizes of lists.
    pub fn sizes(&self) -> IntoIter<usize> {
        if self.choices.sizes.is_empty() {
            return AWKWARD_SIZES.to_vec().into_iter();
        }
        let elements = |[width, height]: &[u32; 2]| *width as usize * *height as usize;
        self.choices.sizes.iter().map(elements).collect::<Vec<_>>().into_iter()
    }

    /// Sizes of images.
    pub fn images(&self) -> IntoIter<[u32; 2]> {
        self.images_or(&AWKWARD_IMAGES)
    }

    /// The chosen sizes of images, else these.
    pub fn images_or(&self, standard: &[[u32; 2]]) -> IntoIter<[u32; 2]> {
        let sizes = if self.choices.sizes.is_empty() { standard.to_vec() } else { self.choices.sizes.clone() };
        sizes.into_iter()
    }

    /// Panics if a case of interest did not come up in a standard run, with what was seen.
    #[track_caller]
    pub fn covered(&self, holds: bool, seen: impl Display) {
        assert!(holds || !self.is_standard(), "cases of interest did not come up: {seen}");
    }

    /// A generator of numbers, by the run's seed as well.
    pub fn numbers(&self, seed: u32) -> Numbers {
        Numbers(seed.wrapping_add((self.choices.seed as u32).wrapping_mul(0x9e37_79b9)))
    }

    /// [`Rig::new`] with the run's seed.
    pub fn rig<'a>(&'a self, scene: &'a Scene, resolution: [u32; 2], settings: Settings) -> Rig<'a> {
        self.rig_at_pass(scene, resolution, settings, 0)
    }

    /// [`Rig::at_pass`] with the run's seed.
    pub fn rig_at_pass<'a>(&'a self, scene: &'a Scene, resolution: [u32; 2], settings: Settings, pass: u32) -> Rig<'a> {
        let seed = settings.seed.wrapping_add(self.choices.seed);
        Rig::at_pass(self, scene, resolution, Settings { seed, ..settings }, pass)
    }

    /// The feature or limit that the device lacks for rays in clusters, if any.
    pub(super) fn lacks_clusters(&self) -> Option<String> {
        let refused = TraversalKernels::visibility(self, Traversal::Cluster, false).is_err();
        refused.then(|| {
            let size = self.info().subgroup_size;
            format!("subgroups of 4, 8, 16, 32 or 64 invocations with ballots and shuffles; they have {size}")
        })
    }
}

/// A generator of reproducible numbers in [0, 1).
pub struct Numbers(pub u32);

impl Numbers {
    /// The next number.
    #[allow(clippy::should_implement_trait, reason = "it never ends")]
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(1);
        crate::sampling::random::random_f32(self.0)
    }

    /// The next three.
    pub fn vec3(&mut self) -> glam::Vec3 {
        glam::Vec3::new(self.next(), self.next(), self.next())
    }
}
