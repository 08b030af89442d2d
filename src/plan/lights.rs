//! The lights of a pass: how many particles survive each reflection, and the slots of the lights that they leave.

use crate::pass::light_lists::MAX_POOL;
use crate::settings::Settings;

/// Lights of a pass: slots in the light buffer.
///
/// Every class of pixels has the same number of slots, one class after the other. Slots of a class: the delta lights
/// (those without area, and imported ones), then for each number of reflections j the N_j particles that survive it,
/// so light i of these has the slot `class * slots() + first_slot(j) + i`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LightPlan {
    /// Number N_j of particles that leave a light after j reflections, j = 0..=max_depth - 2; empty if nothing is lit.
    pub survivors: Vec<u32>,
    /// Slots for point, spot, directional and imported lights: one for each, or one for each light that a pass chooses.
    pub delta: u32,
    /// Whether lights on emitters may be parallel light of an environment.
    pub environment: bool,
}

impl LightPlan {
    /// N_j = floor(rho^j N) (Keller 1997, 3.2), but at least 1: otherwise long paths would be missing from the limit.
    /// [`Settings::direct_lights`] limits N_0; [`Settings::delta_lights`] limits the number of `delta` lights of the
    /// scene that light a pass.
    pub fn new(settings: &Settings, mean_reflectivity: f32, delta: u32) -> LightPlan {
        LightPlan::of_particles(settings, settings.particles, mean_reflectivity, delta)
    }

    /// For another number of particles that reflect; N_0 is that of the settings.
    fn of_particles(settings: &Settings, particles: u32, mean_reflectivity: f32, delta: u32) -> LightPlan {
        let mut survivors = Vec::new();
        let mut expected = f64::from(particles);
        for _ in 1..settings.max_depth {
            survivors.push((expected.floor() as u32).max(1));
            expected *= f64::from(mean_reflectivity.clamp(0.0, 1.0));
        }
        if let Some(first) = survivors.first_mut() {
            *first = settings.direct_lights.unwrap_or(settings.particles.div_ceil(2)).min(settings.particles);
        }
        LightPlan { survivors, delta: settings.delta_lights.map_or(delta, |most| most.min(delta)), environment: false }
    }

    /// The lights of so many paths of a ring, each of which may be as long as is allowed: light k of j reflections has the slot
    /// `first_slot(j) + k`.
    pub(super) fn of_ring(settings: &Settings, paths: u32, delta: u32) -> LightPlan {
        let plan = LightPlan::of_particles(settings, paths, 1.0, delta);
        LightPlan { survivors: vec![paths; plan.survivors.len()], ..plan }
    }

    /// The lights of a pool from which clusters choose, and the number of particles that leave them: `light_pool`, or fewer so that
    /// there are at most [`MAX_POOL`] of them.
    pub(super) fn of_pool(settings: &Settings, mean_reflectivity: f32, delta: u32) -> (LightPlan, u32) {
        let plan = |particles: u32| LightPlan::of_particles(settings, particles, mean_reflectivity, delta);
        let fits = |particles: &u32| {
            let plan = plan(*particles);
            plan.slots() - plan.first_slot(1) <= MAX_POOL
        };
        let particles = std::iter::successors(Some(settings.light_pool), |n| Some(n - n.div_ceil(16)));
        let particles = particles.take_while(|&n| n > settings.particles).find(fits).unwrap_or(settings.particles);
        (plan(particles), particles)
    }

    /// The lights of a cluster that chooses as many as this plan has after reflections. Reflections that a single particle survives
    /// count as one light all together: they carry little light, and long paths would double the shadow rays.
    pub(super) fn of_cluster(&self) -> LightPlan {
        let after = self.survivors.get(1..).unwrap_or_default();
        let reflected = after.iter().filter(|&&n| n > 1).sum::<u32>() + u32::from(after.contains(&1));
        let mut survivors = vec![0; self.survivors.len()];
        survivors[0] = self.survivors[0];
        survivors[1] = reflected;
        LightPlan { survivors, ..*self }
    }

    /// First slot of the lights with j reflections.
    pub fn first_slot(&self, j: usize) -> u32 {
        self.delta + self.survivors.iter().take(j).sum::<u32>()
    }

    /// Number of slots of a class.
    pub fn slots(&self) -> u32 {
        self.first_slot(self.survivors.len())
    }

    /// First slot of the lights that have a place: clusters cannot take parallel light.
    pub fn first_placed(&self) -> u32 {
        self.first_slot(usize::from(self.environment))
    }

    /// Chunks of at most `size` lights that together hold every light with at most `reflections` reflections. Lights
    /// that may be parallel have chunks of their own.
    pub fn chunks(&self, size: u32, reflections: usize) -> Vec<(u32, u32)> {
        let cut = |first: u32, end: u32| {
            (0..(end - first).div_ceil(size)).map(move |i| (first + i * size, end.min(first + (i + 1) * size)))
        };
        let placed = self.first_placed();
        cut(0, placed).chain(cut(placed, self.first_slot(reflections + 1).max(placed))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn survivors_follow_the_paper() {
        let settings = Settings { particles: 32, max_depth: 6, ..Settings::plain() };
        let plan = LightPlan::new(&settings, 0.5, 3);
        assert_eq!(plan.survivors, [32, 16, 8, 4, 2]);
        assert_eq!(plan.first_slot(0), 3);
        assert_eq!(plan.first_slot(2), 51);
        assert_eq!(plan.slots(), 65);
        let plan = LightPlan::new(&Settings { direct_lights: Some(4), ..settings.clone() }, 0.5, 0);
        assert_eq!(plan.survivors, [4, 16, 8, 4, 2]);
        let plan = LightPlan::new(&Settings { direct_lights: None, ..settings.clone() }, 0.5, 0);
        assert_eq!(plan.survivors, [16, 16, 8, 4, 2]);
        let plan = LightPlan::new(&Settings { particles: 3, max_depth: 5, ..settings }, 0.5, 0);
        assert_eq!(plan.survivors, [3, 1, 1, 1], "no depth dies out");
    }

    #[test]
    fn long_paths_cost_clusters_one_light() {
        let settings = Settings { particles: 32, direct_lights: Some(8), ..Settings::plain() };
        let plan = |max_depth| LightPlan::new(&Settings { max_depth, ..settings.clone() }, 0.5, 3);
        assert_eq!(plan(5).of_cluster().survivors, [8, 28, 0, 0]);
        assert_eq!(plan(16).of_cluster().slots() - plan(5).of_cluster().slots(), 2 + 1);
    }

    #[test]
    fn chunks_cover_every_light_once() {
        let plan = LightPlan { survivors: vec![32, 17, 9], delta: 5, environment: false };
        for (reflections, lights) in [(0, 37), (1, 54), (2, 63), (5, 63)] {
            let mut next = 0;
            for (first, end) in plan.chunks(8, reflections) {
                assert_eq!(first, next);
                assert!(end > first && end - first <= 8 && (first >= plan.delta || end <= plan.delta));
                next = end;
            }
            assert_eq!(next, lights);
        }
        assert_eq!(LightPlan { survivors: Vec::new(), delta: 0, environment: false }.chunks(8, 3), []);
    }
}
