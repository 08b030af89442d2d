//! A ring of path images for scenes that move (Keller 1997, section 4.3).
//!
//! A pass in a ring is a step: one particle starts from the emitters, and at each reflection it is absorbed by a pseudo-random decision
//! with the probability 1 - rho, so that its path leaves 1 / (1 - rho) lights on average. Nothing that was rendered is thrown away when
//! camera or scene change, and nothing lasts longer than N steps:
//!
//! - [`Form::Images`], as in the paper: the images of the path's lights are summed into one, which replaces the oldest of the N that are
//!   kept; shown is their mean. A step costs the same for every N. An object that moves leaves N faint images behind it.
//! - [`Form::Lights`]: the lights of N paths are kept, those of the oldest are replaced, and all light the image anew. A step costs N
//!   times as much, but camera, objects and shadows are where they are; only the light that comes from them is up to N steps old.
//!
//! Weights: a path that survives is brighter by 1 / rho at each reflection (roulette), so the mean is that of the estimator whose
//! particles are never absorbed. rho is the mean reflectivity of what the view shows, kept off 0 and 1 ([`survival`]).
//!
//! Differs from the paper in that: one sequence serves all steps, so that N consecutive paths are N consecutive points of it; a light on
//! an emitter has a point of its own ([`crate::pass::walk_start`]); lights without area, mirrored lights and photons are those of the step,
//! as in any other pass.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::pass::layout::{FrameParameters, PointLight};
use crate::sampling::dimensions::ROULETTE;
use crate::sampling::random::{key, random_f32};

/// Form of a ring.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// The images of the last N paths are kept, and their mean is shown.
    Images,
    /// The lights of the last N paths are kept, and all of them light each image.
    Lights,
}

/// A ring.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ring {
    /// Form.
    pub form: Form,
    /// Number N of paths, 1 to [`Ring::MAX_LENGTH`]. More: less noise, longer ghosts; memory in proportion for images, time for lights.
    pub length: u32,
    /// Maximum memory of the ring in MiB. Above it a view is refused, with the length that would fit.
    pub memory: u32,
}

/// Bytes of a pixel of a kept image: three mantissas of 16 bits, their exponent, coverage ([`crate::pass::ring`]).
pub const PIXEL_BYTES: u64 = 8;

const MIB: u64 = 1 << 20;

impl Ring {
    /// Length unless another one is asked for.
    pub const LENGTH: u32 = 64;
    /// Maximum length.
    pub const MAX_LENGTH: u32 = 1024;
    /// Maximum memory in MiB unless another one is asked for.
    pub const MEMORY: u32 = 1024;

    /// A ring of this form with the length and memory that are not asked for otherwise.
    pub fn new(form: Form) -> Ring {
        Ring { form, length: Self::LENGTH, memory: Self::MEMORY }
    }

    /// Images that are kept.
    pub fn images(&self) -> u32 {
        if self.form == Form::Images { self.length } else { 1 }
    }

    /// Paths whose lights are kept.
    pub fn paths(&self) -> u32 {
        if self.form == Form::Lights { self.length } else { 1 }
    }

    /// Bytes of the ring for images of this size and paths of at most `max_depth` segments.
    pub fn bytes(&self, [width, height]: [u32; 2], max_depth: u32) -> u64 {
        let image = PIXEL_BYTES * u64::from(width) * u64::from(height);
        u64::from(self.images()) * image + u64::from(self.paths()) * lights_bytes(max_depth)
    }

    /// Checks the memory for images of this size. Errors: [`Error::Setting`], with the length that would fit.
    pub fn check(&self, size: [u32; 2], max_depth: u32) -> Result<()> {
        let (bytes, most) = (self.bytes(size, max_depth), u64::from(self.memory) * MIB);
        if bytes <= most {
            return Ok(());
        }
        let [width, height] = size;
        let fits = |length: &u32| Ring { length: *length, ..*self }.bytes(size, max_depth) <= most;
        let way = match (1..self.length).rev().find(fits) {
            Some(length) => format!("{length} would fit"),
            None => String::from("not even one would fit; raise --ring-memory or lower --resolution"),
        };
        Err(Error::Setting {
            name: "--ring-length",
            message: format!(
                "a ring of {} at {width}x{height} takes {} MiB, and --ring-memory allows {}; {way}",
                self.length,
                bytes.div_ceil(MIB),
                self.memory
            ),
        })
    }
}

/// Bytes of the lights of a path.
fn lights_bytes(max_depth: u32) -> u64 {
    u64::from(max_depth.saturating_sub(1)) * size_of::<PointLight>() as u64
}

/// Probability to survive a reflection where the mean reflectivity is `rho`. In black or white surroundings weights stay bounded, and
/// so does the length of paths.
pub fn survival(rho: f32) -> f32 {
    rho.clamp(0.125, 0.875)
}

/// Oracle: whether a particle survives its j-th reflection.
pub fn survives(frame: &FrameParameters, particle: u32, j: u32) -> bool {
    let probability = frame.cones[3];
    probability == 0.0 || random_f32(key(frame.keys[0], ROULETTE, particle, j)) < probability
}

/// Lights that a particle's path has at most, the one on the emitter included; fewer if it leaves the scene.
pub fn path_lights(frame: &FrameParameters, particle: u32) -> u32 {
    let depths = frame.depths.iter().take_while(|depth| depth[0] > 0).count() as u32;
    (1..depths).find(|&j| !survives(frame, particle, j)).unwrap_or(depths)
}

/// The number of lights of each path of a ring of lights, and which slots of lights can be lit.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Paths(Vec<u32>);

impl Paths {
    /// Takes over the paths that begin in a pass.
    pub fn begin(&mut self, frame: &FrameParameters) {
        let particles = frame.walk[1];
        match frame.lists[3].checked_sub(1).filter(|_| self.0.len() as u32 == particles) {
            Some(only) => self.0[only as usize] = path_lights(frame, only),
            None => self.0 = (0..particles).map(|particle| path_lights(frame, particle)).collect(),
        }
    }

    /// Whether some of the slots `first..end` may hold light, of which `delta` come before those of paths; without paths all may.
    pub fn light(&self, (first, end): (u32, u32), delta: u32) -> bool {
        let particles = self.0.len() as u32;
        if particles == 0 || first < delta {
            return true;
        }
        (first - delta..end - delta).any(|slot| self.0[(slot % particles) as usize] > slot / particles)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_that_does_not_fit_names_the_length_that_would() {
        let ring = Ring { form: Form::Images, length: 128, memory: 406 };
        assert_eq!(Ring { memory: 405, ..ring }.bytes([720, 576], 1), 128 * 720 * 576 * 8);
        ring.check([720, 576], 5).unwrap();
        let refused = Ring { memory: 100, ..ring }.check([720, 576], 5).unwrap_err().to_string();
        assert!(refused.contains("takes 406 MiB") && refused.contains("31 would fit"), "{refused}");
        let refused = Ring { memory: 1, ..ring }.check([720, 576], 5).unwrap_err().to_string();
        assert!(refused.contains("not even one"), "{refused}");
        let lights = Ring { form: Form::Lights, ..ring };
        assert_eq!(lights.bytes([720, 576], 3), 720 * 576 * 8 + 128 * 2 * size_of::<PointLight>() as u64);
    }

    #[test]
    fn paths_have_as_many_lights_as_the_paper_says() {
        // 1 + rho + rho^2 + ..., of which 15 terms are allowed.
        const PATHS: u32 = 20_000;
        for rho in [0.25f32, 0.5, 0.75] {
            let mut frame = FrameParameters { cones: [0.0, 0.0, 0.0, rho], ..FrameParameters::default() };
            frame.depths[..15].fill([1; 4]);
            let counts = (0..PATHS).map(|path| {
                frame.keys[0] = crate::sampling::random::hash(path);
                f64::from(path_lights(&frame, 0))
            });
            let (sum, squares) = counts.fold((0.0, 0.0), |(sum, squares), n| (sum + n, squares + n * n));
            let mean = sum / f64::from(PATHS);
            let sigma = ((squares / f64::from(PATHS) - mean * mean) / f64::from(PATHS)).sqrt();
            let expected = (1.0 - f64::from(rho).powi(15)) / (1.0 - f64::from(rho));
            assert!((mean - expected).abs() < 3.0 * sigma, "{rho}: {mean} for {expected}, sigma {sigma}");
        }
    }

    #[test]
    fn slots_beyond_the_end_of_all_paths_are_dark() {
        let paths = Paths(vec![1, 3]);
        // Two delta lights; then slot j N + k of path k.
        let lit = |first, end| paths.light((first, end), 2);
        assert!(lit(0, 1) && lit(2, 3) && lit(3, 4) && lit(5, 6) && lit(7, 8) && lit(4, 6));
        assert!(!lit(4, 5) && !lit(6, 7) && !lit(8, 20));
        assert!(Paths::default().light((9, 10), 2));
    }
}
