//! The parameters of each pass: sequence segments, random keys, the camera, scene scales.

use glam::Vec3;

use super::{Cones, INSTANCES, Plan};
use crate::error::{Error, Result};
use crate::light::emitters::NO_EMITTER;
use crate::pass::layout;
use crate::pass::near_collect;
use crate::pass::near_points::NEAR_SPREAD;
use crate::pass::photon_width::FOOTPRINT;
use crate::ring::{self, Form, Ring};
use crate::sampling::dimensions::{OFFSET, REPLICA, ROTATION, WINDOW};
use crate::sampling::halton::PRIMES;
use crate::sampling::random::{hash, key, random_f32};
use crate::sampling::sobol::{scrambled, shuffled, sobol, unit};
use crate::settings::{Filter, Sequence};
use crate::view::View;

impl Plan {
    /// Parameters of pass number `pass` (from 0). Passes alternate between the two instances; each instance follows its
    /// own randomised sequence, with N points a pass for each class of pixels: a segment of the sequence.
    ///
    /// The survivors of a pass are the first N_j of its particles. With N a power of the base, the first N_j points of
    /// every segment would fill the same strata every time; so each pass starts at a point of its segment that moves in
    /// golden-ratio steps from a random start: evenly spread, and unrelated to any base. For Sobol' points, all of whose
    /// dimensions have base 2, random starting points give less error.
    pub fn parameters(&self, pass: u32) -> Result<layout::FrameParameters> {
        self.parameters_of(pass, pass == 0)
    }

    /// [`Plan::parameters`]; `begins`: all paths of a ring of lights begin in this pass, not the newest alone.
    pub fn parameters_of(&self, pass: u32, begins: bool) -> Result<layout::FrameParameters> {
        let s = &self.settings;
        // A ring has one sequence, of which each step takes one point, and its errors are those of as many passes as it keeps images.
        let (instance, local, refined) = match &s.ring {
            None => (pass % INSTANCES, pass / INSTANCES, pass),
            Some(ring) => (0, pass, pass.min(ring.images() - 1)),
        };
        let of_pass = if s.ring.is_some() { 1 } else { self.particles * s.classes() };
        let first = local.checked_mul(of_pass).filter(|f| f.checked_add(of_pass).is_some()).ok_or(Error::Setting {
            name: "--passes",
            message: format!("pass {pass} of {of_pass} particles leaves the 2^32 points of the sequence"),
        })?;
        let seed_key = hash(hash(s.seed as u32) ^ (s.seed >> 32) as u32);
        let instance_key = seed_key.wrapping_add(hash(instance));
        let pass_key = hash(instance_key ^ hash(local));

        let [width, height] = self.view.size();
        let whole = self.view.within();
        let lookout = Lookout::of(&self.view);
        let extent = &self.scene.extent;
        let clip = s.clip_distance(extent.size);

        let start = hash(key(instance_key, WINDOW, 0, 0));
        let turn = match s.sequence {
            Sequence::Halton => start.wrapping_add(local.wrapping_mul(0x9e37_79b9)),
            Sequence::Sobol => hash(start ^ hash(local)),
        };
        // Path p of a ring has the slot p mod N, whatever the step.
        let rotation = match &s.ring {
            None => ((u64::from(turn) * u64::from(self.particles)) >> 32) as u32,
            Some(_) => (self.particles - local % self.particles) % self.particles,
        };
        let mut depths = [[0; 4]; 16];
        let mut shifts = [[0.0; 4]; 16];
        let mut words = [[0; 4]; 16];
        for j in 0..16 {
            let alive = self.lights.survivors.get(j).copied().unwrap_or(0);
            let next = self.lights.survivors.get(j + 1).copied().unwrap_or(0);
            depths[j] = [alive, self.lights.first_slot(j), (1.0 / alive.max(1) as f32).to_bits(), next];
            let replica = shuffled(local, key(instance_key, REPLICA, j as u32, 0));
            for d in 0..2 {
                words[j][d] = hash(key(instance_key, ROTATION, (2 * j + d) as u32, 0));
                words[j][d + 2] = sobol(d, replica);
                shifts[j][d] = random_f32(key(instance_key, ROTATION, (2 * j + d) as u32, 0));
                shifts[j][d + 2] = f32::from_bits(PRIMES[2 * j + d]);
            }
        }
        // The newest path of a ring of lights; the first step begins all of them.
        let only = match &s.ring {
            Some(Ring { form: Form::Lights, .. }) if !begins => 1 + (local + self.particles - 1) % self.particles,
            _ => 0,
        };
        let bit = |set: bool, bit: u32| if set { bit } else { 0 };
        let bits = bit(s.jitter, layout::FrameParameters::JITTER)
            | bit(s.sequence == Sequence::Sobol, layout::FrameParameters::SOBOL)
            | bit(!s.interleave_photons, layout::FrameParameters::SHARED_PHOTONS)
            | bit(self.lights.environment, layout::FrameParameters::ENVIRONMENT);
        let offset = if self.view.is_g_buffer() { [0.5; 2] } else { pixel_offset(seed_key, pass) };
        let cones = Cones::of(&self.view, self.particles, refined);
        let (photons, photon) = match self.photons {
            Some(plan) => plan.parameters(s, &self.lights, extent.size, (local, refined / INSTANCES))?,
            None => ([0; 4], [0.0; 4]),
        };
        let splats = s.splats.filter(|_| self.splats.is_some());
        let least_alpha = splats.map_or(0, |splats| splats.alpha.max(f32::MIN_POSITIVE).to_bits());
        let superposition = match s.superposition.filter(|_| self.eye.mirrors) {
            Some(superposition) => {
                let images = u32::from(self.eye.images.is_some());
                [superposition.reflectors, s.reflectance as u32, images, least_alpha]
            }
            None => [0, s.reflectance as u32, 0, least_alpha],
        };
        let xyzw = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
        let (lowest, highest) = extent.bounds;
        Ok(layout::FrameParameters {
            eye: xyzw(lookout.eye, extent.scale),
            right: xyzw(lookout.right, clip * clip),
            up: xyzw(lookout.up, clip),
            forward: xyzw(lookout.forward, 4.0 * self.scene.diagonal),
            bounds_min: xyzw(lowest, 1.0 / (highest - lowest).max_element().max(1e-30)),
            pixel_offset: [offset[0], offset[1], MIN_LIGHT_ALPHA, s.light_threshold],
            size: [width, height, width * height, local],
            within: [whole.origin[0], whole.origin[1], whole.size[0], whole.size[1]],
            walk: [first, self.particles, rotation, self.lights.delta],
            keys: [pass_key, instance_key, bits, instance],
            scene: [self.scene.nodes, self.scene.emitters, s.max_depth, 0],
            pattern: [s.pattern[0], s.pattern[1], s.classes(), self.lights.slots()],
            photons,
            photon,
            depths,
            shifts,
            sobol: words,
            choice: [
                s.power_fraction,
                self.lights.survivors.first().map_or(0.0, |&n| n as f32) / self.scene.emission.max(f32::MIN_POSITIVE),
                self.reflected_lights() / surface_area(extent.size),
                match splats {
                    _ if !self.eye.lobes => 0.0,
                    None => MAX_FOLLOWED_ALPHA,
                    Some(splats) => splats.alpha.min(MAX_FOLLOWED_ALPHA),
                },
            ],
            superposition,
            mirrors: {
                let [each, lights, mirrors] = self.mirrors.map_or([0; 3], |m| [m.each, m.lights, m.mirrors]);
                [each, lights, mirrors, if s.filter.is_some() { NEAR_SPREAD } else { 1 }]
            },
            lists: [
                self.lists.slots() - self.lists.first_slot(1),
                self.lists.slots(),
                near_collect::weight(refined).to_bits(),
                only,
            ],
            lens: [
                lookout.lens[0],
                lookout.lens[1],
                Filter::weight(refined),
                if s.photon_radius.is_some() { 0.0 } else { FOOTPRINT / ((1 + refined / INSTANCES) as f32).sqrt() },
            ],
            cones: [
                cones.pixel,
                cones.particle,
                cones.gather,
                s.ring.map_or(0.0, |_| ring::survival(extent.reflectivity)),
            ],
            shift: [
                lookout.shift[0],
                lookout.shift[1],
                if lookout.parallel { 1.0 } else { 0.0 },
                Filter::sparse_weight(refined),
            ],
            soft: [self.soft_emitters.len() as u32, 0, 0, 0],
            soft_emitters: [0, 1]
                .map(|half| [0, 1, 2, 3].map(|k| self.soft_emitters.get(4 * half + k).copied().unwrap_or(NO_EMITTER))),
            task: [[0; 4]; 2],
        })
    }
}

impl Plan {
    /// Lights after reflections that light a point, in the mean.
    fn reflected_lights(&self) -> f32 {
        if self.settings.ring.is_none() {
            return self.lists.survivors.iter().skip(1).sum::<u32>() as f32;
        }
        let rho = ring::survival(self.scene.extent.reflectivity);
        self.particles as f32 * rho / (1.0 - rho)
    }
}

/// The camera in the form of the frame's parameters.
struct Lookout {
    eye: Vec3,
    right: Vec3,
    up: Vec3,
    forward: Vec3,
    lens: [f32; 2],
    shift: [f32; 2],
    parallel: bool,
}

impl Lookout {
    /// That of a view; an atlas has none, and its passes do not read it.
    fn of(view: &View) -> Lookout {
        let Some(camera) = view.camera() else {
            return Lookout {
                eye: Vec3::ZERO,
                right: Vec3::X,
                up: Vec3::Y,
                forward: Vec3::Z,
                lens: [0.0; 2],
                shift: [0.0; 2],
                parallel: false,
            };
        };
        let height = camera.resolution[1] as f32;
        let (right, up, forward) = camera.world_from_camera();
        let [tan_x, tan_y] = camera.half_extents();
        Lookout {
            eye: camera.eye,
            right: right * tan_x,
            up: up * tan_y,
            forward,
            lens: [0.5 * height / tan_y * camera.aperture, 1.0 / camera.focus_distance()],
            shift: camera.shift(),
            parallel: camera.is_orthographic(),
        }
    }
}

/// Specular lobes of virtual lights are widened to this alpha, so that no light has an extremely narrow lobe. Bias:
/// light that sharper lobes reflect onto other surfaces is spread over a wider cone, with the same energy. Lobes at
/// shading points are exact.
pub const MIN_LIGHT_ALPHA: f32 = 0.25;

/// Eye paths follow specular lobes up to this alpha; wider ones are left to virtual lights alone. Higher: more pixels cost a second
/// path; lower: highlights of single lights show on smooth surfaces.
pub const MAX_FOLLOWED_ALPHA: f32 = 0.5;

/// Area over which the lights on surfaces are assumed to spread: that of a cube of the view's size. Only the division of
/// highlights between lights and eye paths depends on it.
fn surface_area(size: f32) -> f32 {
    (6.0 * size * size).max(f32::MIN_POSITIVE)
}

/// Offset of the sample in its pixel (Keller 1997, 4.1): points of one scrambled (0, 2)-sequence for both instances, so
/// that any 2^k passes that start at a multiple of 2^k have one point in each elementary interval.
///
/// The two passes of a pair, one of each instance, lie in opposite halves of the pixel. Which instance has the left half
/// depends on the parity of two of every three digits of the pair's number. So the points of each instance alone are
/// evenly spread too, as the error estimate requires, which compares the instances; by most other rules they are not.
///
/// The pairs are shuffled, which preserves nets: the lights of a pass follow sequences in base 2 by the number of the pass
/// too, and otherwise each part of a pixel would always meet the same part of the points on the emitters.
fn pixel_offset(seed_key: u32, pass: u32) -> [f32; 2] {
    let pair = shuffled(pass / INSTANCES, key(seed_key, OFFSET, 2, 0));
    let swapped = (pair & 0xb6db_6db6).count_ones() & 1;
    let index = pair << 1 | ((pass % INSTANCES) ^ swapped);
    [0, 1].map(|d| unit(scrambled(sobol(d, index), key(seed_key, OFFSET, d as u32, 0))))
}

const _: () = assert!(INSTANCES == 2, "the lowest bit of a pass is its instance");

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers of the points in the elementary intervals of `digits[d]` binary digits along dimension d.
    fn counts(points: impl Iterator<Item = [f32; 2]>, digits: [u32; 2]) -> Vec<u32> {
        let mut counts = vec![0; 1 << (digits[0] + digits[1])];
        for p in points {
            let cell = [0, 1].map(|d| (p[d] * (1 << digits[d]) as f32) as usize);
            counts[cell[0] << digits[1] | cell[1]] += 1;
        }
        counts
    }

    #[test]
    fn pixel_offsets_of_consecutive_passes_are_nets() {
        for seed in 0..4 {
            for m in 0..=8 {
                for start in [0, 3 << m] {
                    for x in 0..=m {
                        let points = (start..start + (1 << m)).map(|pass| pixel_offset(hash(seed), pass));
                        assert!(counts(points, [x, m - x]).iter().all(|&n| n == 1), "2^{m} from {start}");
                    }
                }
            }
        }
    }

    #[test]
    fn pixel_offsets_of_each_instance_are_spread_over_the_pixel() {
        for instance in 0..INSTANCES {
            for m in 5..=10 {
                let points = (0..1 << m).map(|local| pixel_offset(1, INSTANCES * local + instance));
                for digits in [[3, 0], [0, 3], [2, 1], [1, 2]] {
                    let even = counts(points.clone(), digits).into_iter().all(|n| n == 1 << (m - 3));
                    assert!(even, "instance {instance}, 2^{m} passes, {digits:?}");
                }
            }
        }
    }
}
