//! The photons and the mirrored lights of a pass.

use super::LightPlan;
use crate::error::{Error, Result};
use crate::pass::delta_choice::MAX_CANDIDATES;
use crate::pass::photon_grid::MAX_BUCKET_BITS;
use crate::settings::Settings;

/// Caustic photons of a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhotonPlan {
    /// Photons of each class of pixels.
    pub each: u32,
    /// Number of classes.
    pub classes: u32,
    /// Number of targets: bodies of mirrors or glass.
    pub targets: u32,
    /// Maximum consecutive mirrors and glass surfaces.
    pub steps: u32,
}

impl PhotonPlan {
    /// For a scene with `targets` targets; `None` if there are no photons, or nothing is lit.
    pub fn new(settings: &Settings, targets: u32) -> Option<PhotonPlan> {
        // Eye segment, mirrors and glass, and the segment that leaves the emitter.
        let steps = settings.max_specular.min(settings.max_depth.saturating_sub(2));
        let plan = PhotonPlan { each: settings.photons, classes: settings.classes(), targets, steps };
        (plan.each > 0 && targets > 0 && plan.steps > 0 && settings.max_depth > 1).then_some(plan)
    }

    /// Photons of all classes.
    pub fn total(&self) -> u32 {
        self.each * self.classes
    }

    /// Bits of a bucket number of the hash table: at least twice as many buckets as photons.
    pub fn bucket_bits(&self) -> u32 {
        (self.total().next_power_of_two().trailing_zeros() + 1).min(MAX_BUCKET_BITS)
    }

    /// Photons that one dispatch of the look-up may loop over within `budget`: each takes at most 5 iterations (its
    /// own, 2 for those whose footprint reaches the point, the exit included, 2 for a specular lobe, beside `tables` 4), besides the exit.
    pub fn chunk(budget: u32, tables: bool) -> u32 {
        (budget.saturating_sub(2) / if tables { 7 } else { 5 }).max(1)
    }

    /// Radius of the look-up for a view of this size ([`Extent::size`]), unless `photon_radius` sets it: 0.8 of the size over sqrt(N), at most a
    /// fifteenth of it. It is that of photons which spread over much of the room; where photons are dense, as in caustics, each has a smaller
    /// one of its own ([`photon_width`](crate::pass::photon_width)). Half of it showed single photons on walls, behind a ball of glass before a lamp; half as much
    /// again changes little.
    ///
    /// It shrinks with the fourth root of the passes of an instance: then noise and blur of their mean both vanish, the variance as
    /// one over the root of their number and the bias likewise (after Knaus and Zwicker 2011, whose root is the sixth, for less
    /// noise).
    fn radius(&self, settings: &Settings, size: f32, local: u32) -> f32 {
        let first = (0.8 / (self.each as f32).sqrt()).min(1.0 / 15.0) * size;
        settings.photon_radius.unwrap_or(first / ((local + 1) as f32).powf(0.25))
    }

    /// Photons of a pass that may light one pixel.
    fn in_reach(&self, settings: &Settings) -> u32 {
        if settings.interleave_photons { self.each } else { self.total() }
    }

    /// [`layout::FrameParameters::photons`] and [`layout::FrameParameters::photon`] for pass number `local` of its instance, whose blur is
    /// that of pass number `refined`.
    pub(super) fn parameters(
        &self,
        settings: &Settings,
        lights: &LightPlan,
        size: f32,
        (local, refined): (u32, u32),
    ) -> Result<([u32; 4], [f32; 4])> {
        let total = self.total();
        // A ring goes on for ever: its photons begin the sequence again.
        let local = if settings.ring.is_some() { local % (u32::MAX / total) } else { local };
        let first = local.checked_mul(total).filter(|f| f.checked_add(total).is_some()).ok_or(Error::Setting {
            name: "--passes",
            message: format!("pass {local} of {total} photons leaves the 2^32 points of the sequence"),
        })?;
        let radius = self.radius(settings, size, refined);
        let share =
            1.0 / (std::f64::consts::PI * f64::from(radius) * f64::from(radius) * f64::from(self.in_reach(settings)));
        let integers = [self.each, first, self.targets, (1 << self.bucket_bits()) - 1];
        Ok((integers, [radius, 0.5 / radius, share as f32, f32::from_bits(self.from_emitters(settings, lights))]))
    }

    /// Photons of each class that start from emitters; the others start from virtual lights after reflections: half of them, if a
    /// path that reaches the eye by mirror or glass may be so long.
    pub fn from_emitters(&self, settings: &Settings, lights: &LightPlan) -> u32 {
        if settings.max_depth < 4 || lights.survivors.len() < 2 { self.each } else { self.each.div_ceil(2) }
    }
}

/// Mirrored lights of a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MirrorPlan {
    /// Mirrored lights of each class of pixels.
    pub each: u32,
    /// Number of classes.
    pub classes: u32,
    /// Lights of each class that may be mirrored: the first ones.
    pub lights: u32,
    /// Number of planar mirrors.
    pub mirrors: u32,
}

impl MirrorPlan {
    /// For a scene with `mirrors` planar mirrors; `None` if nothing is mirrored. The mirror adds a segment to the path:
    /// eye segment, mirror, shadow ray and j reflections are j + 3.
    pub fn new(settings: &Settings, mirrors: u32, lights: &LightPlan) -> Option<MirrorPlan> {
        let (each, classes, depth) = (settings.mirror_lights, settings.classes(), settings.max_depth as usize);
        if each == 0 || mirrors == 0 || depth < 3 {
            return None;
        }
        let lights = lights.first_slot(depth - 2);
        // The largest mirrors, as many as there may be pairs.
        let mirrors = mirrors.min(MAX_CANDIDATES as u32 / lights.max(1));
        (mirrors > 0).then_some(MirrorPlan { each, classes, lights, mirrors })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{LOOP_BUDGET, min_loop_budget};

    #[test]
    fn photons_are_looked_up_within_the_loop_budget() {
        for budget in [min_loop_budget(1), min_loop_budget(64), LOOP_BUDGET] {
            // Every photon of the chunk, with the loops for its footprint and for the lobe; in addition the exit.
            for (tables, each) in [(false, 5), (true, 7)] {
                let chunk = PhotonPlan::chunk(budget, tables);
                assert!(chunk >= 1 && each * chunk < budget.max(25), "{budget}: {chunk}");
            }
        }
        let settings = Settings { photons: 500, pattern: [5, 5], ..Settings::plain() };
        let plan = PhotonPlan::new(&settings, 1).unwrap();
        assert_eq!((plan.total(), plan.bucket_bits()), (12_500, 15));
        assert_eq!(PhotonPlan { each: Settings::MAX_PHOTONS, classes: 1, ..plan }.bucket_bits(), 21);
        assert_eq!(PhotonPlan::new(&Settings { photons: 0, ..Settings::plain() }, 1), None);
        assert_eq!(PhotonPlan::new(&settings, 0), None);
        assert_eq!(PhotonPlan::new(&Settings { max_depth: 1, ..settings.clone() }, 1), None);
        // Without a radius from the user the size of the view and the number decide.
        assert!((plan.radius(&settings, 10.0, 0) - 8.0 / 500f32.sqrt()).abs() < 1e-6);
        assert!((plan.radius(&settings, 10.0, 15) - 4.0 / 500f32.sqrt()).abs() < 1e-6);
        assert_eq!(plan.radius(&Settings { photon_radius: Some(0.3), ..settings }, 10.0, 15), 0.3);
    }

    #[test]
    fn lights_are_chosen_and_mirrored_as_far_as_paths_allow() {
        let settings = Settings { particles: 32, max_depth: 5, mirror_lights: 4, ..Settings::plain() };
        let lights = LightPlan::new(&Settings { delta_lights: Some(3), ..settings.clone() }, 0.5, 300);
        assert_eq!((lights.delta, LightPlan::new(&settings, 0.5, 300).delta), (3, 300));
        // Eye, mirror, shadow ray and up to two reflections.
        let plan = MirrorPlan::new(&settings, 2, &lights).unwrap();
        assert_eq!((plan.lights, plan.mirrors, plan.each), (3 + 32 + 16 + 8, 2, 4));
        assert_eq!(MirrorPlan::new(&settings, 0, &lights), None);
        assert_eq!(MirrorPlan::new(&Settings { max_depth: 2, ..settings.clone() }, 2, &lights), None);
        // Pairs are limited: with many lights fewer mirrors count, the largest, and photons take the others.
        let many = LightPlan { survivors: vec![30_000, 1, 1, 1], delta: 0, environment: false };
        assert_eq!(MirrorPlan::new(&settings, 64, &many).unwrap().mirrors, 4);
        let most = LightPlan { survivors: vec![200_000, 1, 1, 1], delta: 0, environment: false };
        assert_eq!(MirrorPlan::new(&settings, 64, &most), None);
    }
}
