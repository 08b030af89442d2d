//! The shutter by time samples: each shows the scene at a moment of its own.

use glam::{DVec3, Vec3};

use super::{Options, tell, trace};
use crate::accel::Bvh;
use crate::error::Result;
use crate::light::emitters::Emitters;
use crate::scene::{Camera, Scene};

/// Maximum number of moments: scene and hierarchy are made anew for each.
const MOMENTS: u32 = 64;

/// Renders what a camera sees while its shutter is open: the mean over moments, in the middles of equal parts of the time, with equal numbers of
/// samples, up to one more. `at` gives scene and camera at a part of the time in (0, 1), and `progress` is that of [`render`](super::render).
///
/// Errors: those of `at`, of [`Bvh::build`], of [`Emitters::of`] and of [`render`](super::render).
pub fn render_open(
    at: impl Fn(f64) -> Result<(Scene, Camera)>,
    options: &Options,
    progress: impl Fn(f32) -> bool,
) -> Result<Vec<Vec3>> {
    let moments = options.samples.clamp(1, MOMENTS);
    let [width, height] = options.resolution;
    let mut sums = vec![DVec3::ZERO; width as usize * height as usize];
    let (mut weight, mut left_out) = (0.0, 0);
    // Should it be broken off, what there is covers the time evenly.
    let stride = (1..moments).rev().find(|&n| 2 * n <= moments.max(2) && gcd(n, moments) == 1).unwrap_or(1);
    for i in 0..moments {
        let moment = (i * stride) % moments;
        let (scene, camera) = at((f64::from(moment) + 0.5) / f64::from(moments))?;
        let (bvh, emitters) = (Bvh::build(&scene)?, Emitters::of(&scene, scene.emitters_are_lights)?);
        let samples = (options.samples + moment) / moments;
        let seed = options.seed.wrapping_add(u64::from(moment) << 32);
        let going_on = std::cell::Cell::new(true);
        let done = |fraction: f32| {
            let whole = (i as f32 + fraction) / moments as f32;
            going_on.set(progress(whole.min(1.0)));
            going_on.get()
        };
        let (image, lost) = trace(&scene, &bvh, &emitters, &camera, &Options { samples, seed, ..*options }, done)?;
        left_out += lost;
        sums.iter_mut().zip(&image).for_each(|(sum, l)| *sum += l.as_dvec3() * f64::from(samples));
        weight += f64::from(samples);
        if !going_on.get() {
            break;
        }
    }
    tell(left_out);
    Ok(sums.into_iter().map(|sum| (sum / weight).as_vec3()).collect())
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}
