//! The mean of a film: its sums become an image with layers, piece by piece on all cores.

use std::convert::Infallible;

use glam::{DVec4, Vec3, Vec4};
use rayon::prelude::*;

use super::{ALBEDO, DIRECT, EMISSION, GAIN, INDIRECT, NORMAL, add};
use crate::error::Error;
use crate::gpu::Snapshot;
use crate::output::{Layers, Wanted};
use crate::pass::gain;
use crate::plan::INSTANCES;

/// Pixels of a piece: its sums fit a core's own cache.
const PIECE: usize = 1024;

/// One level of a sum, on the host or on the device.
pub(super) trait Level: Sync {
    /// Why it may be unreadable.
    type Error: Send;

    /// Copies its values from pixel `first` on.
    fn copy(&self, first: usize, values: &mut [Vec4]) -> Result<(), Self::Error>;
}

impl Level for Vec<Vec4> {
    type Error = Infallible;

    fn copy(&self, first: usize, values: &mut [Vec4]) -> Result<(), Infallible> {
        values.iter_mut().zip(&self[first..]).for_each(|(value, own)| *value = *own);
        Ok(())
    }
}

impl Level for Snapshot {
    type Error = Error;

    fn copy(&self, first: usize, values: &mut [Vec4]) -> Result<(), Error> {
        Snapshot::copy(self, first, values)
    }
}

/// The levels of all sums in the film's order. Those that the wanted layers do not need may be empty.
pub(super) struct Sums<'a, L> {
    pub size: [u32; 2],
    pub counts: [u32; INSTANCES as usize],
    pub levels: Vec<&'a [L]>,
    /// Whether the last three are those of the summands.
    pub summands: bool,
}

/// The means of a piece.
fn means<L: Level>(levels: &[L], passes: u32, first: usize, count: usize) -> Result<Vec<DVec4>, L::Error> {
    let mut sums = vec![(DVec4::ZERO, DVec4::ZERO); count];
    let mut values = vec![Vec4::ZERO; count];
    for level in levels {
        level.copy(first, &mut values)?;
        // After few passes the lower levels are often empty.
        if values.iter().any(|value| *value != Vec4::ZERO) {
            sums.iter_mut().zip(&values).for_each(|(sum, value)| *sum = add(*sum, value.as_dvec4()));
        }
    }
    let scale = 1.0 / f64::from(passes.max(1));
    Ok(sums.into_iter().map(|(high, low)| (high + low) * scale).collect())
}

/// Colour, emission, diffuse and specular light of a pixel, and the bias to be taken from the last two.
type Summands<'a> = (((&'a mut Vec3, &'a Vec3), &'a mut Vec3), (&'a mut Vec3, &'a Vec3));

/// The part of reflected light that is left without the bias, for each channel.
fn kept_share(reflected: Vec3, bias: Vec3) -> Vec3 {
    let share = |of: f32, bias: f32| if of > 0.0 { (1.0 - bias / of).max(0.0) } else { 1.0 };
    Vec3::new(share(reflected.x, bias.x), share(reflected.y, bias.y), share(reflected.z, bias.z))
}

impl<L: Level> Sums<'_, L> {
    /// The mean of all passes.
    pub fn mean(&self, wanted: Wanted) -> Result<Layers, L::Error> {
        let [width, height] = self.size;
        let (mut color, alpha) = self.color()?;
        let [mut emission, mut diffuse, mut specular] = [const { Vec::new() }; 3];
        if self.summands {
            [emission, diffuse, specular] = [self.rgb(EMISSION)?, self.rgb(EMISSION + 1)?, self.rgb(EMISSION + 2)?];
            let sum = |(i, color): (usize, &mut Vec3)| *color = emission[i] + diffuse[i] + specular[i];
            color.par_iter_mut().enumerate().for_each(sum);
        }
        if let Some(bias) = self.bias()? {
            if !self.summands {
                color.par_iter_mut().zip(&bias).for_each(|(color, bias)| *color -= *bias);
            } else {
                let of_pixel = |(((color, emission), diffuse), (specular, bias)): Summands| {
                    let kept = kept_share(*diffuse + *specular, *bias);
                    (*diffuse, *specular) = (*diffuse * kept, *specular * kept);
                    *color = *emission + *diffuse + *specular;
                };
                let pixels =
                    color.par_iter_mut().zip(&emission).zip(&mut diffuse).zip(specular.par_iter_mut().zip(&bias));
                pixels.for_each(of_pixel);
            }
        }
        if wanted == Wanted::Color {
            return Ok(Layers { width, height, color, alpha, ..Layers::default() });
        }
        let (direct, depth) = self.direct(&alpha)?;
        Ok(Layers {
            width,
            height,
            albedo: self.rgb(ALBEDO)?,
            normal: self.map(NORMAL, |n| n.truncate().normalize_or_zero())?,
            depth,
            direct,
            indirect: self.rgb(INDIRECT)?,
            emission,
            diffuse,
            specular,
            color,
            alpha,
            ..Layers::default()
        })
    }

    /// The bias of the filter that is to be taken from the colour, see [`gain`]; `None`: nothing.
    fn bias(&self) -> Result<Option<Vec<Vec3>>, L::Error> {
        let passes = self.passes();
        if passes < gain::MIN_PASSES {
            return Ok(None);
        }
        let mut gains = vec![DVec4::ZERO; self.pixels()];
        gains.par_chunks_mut(PIECE).enumerate().try_for_each(|(piece, gains)| {
            gains.copy_from_slice(&means(self.levels[GAIN], passes, piece * PIECE, gains.len())?);
            Ok(())
        })?;
        if gains.par_iter().all(|gain| *gain == DVec4::ZERO) {
            return Ok(None);
        }
        let [width, height] = self.size.map(|n| n as usize);
        let moments: Vec<[f64; 2]> = gains.par_iter().map(|&mean| gain::moments(mean, passes)).collect();
        let near = |x: usize, end: usize| x.saturating_sub(2)..(x + 3).min(end);
        let of_pixel = |(i, mean): (usize, &DVec4)| {
            let rows = near(i / width, height);
            let around = rows.flat_map(|y| near(i % width, width).map(move |x| y * width + x));
            (mean.truncate() * gain::share(around.map(|j| moments[j]), passes)).as_vec3()
        };
        Ok(Some(gains.par_iter().enumerate().map(of_pixel).collect()))
    }

    fn passes(&self) -> u32 {
        self.counts.iter().sum()
    }

    fn pixels(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Radiance and coverage.
    fn color(&self) -> Result<(Vec<Vec3>, Vec<f32>), L::Error> {
        let (mut color, mut alpha) = (vec![Vec3::ZERO; self.pixels()], vec![0.0; self.pixels()]);
        let pieces = color.par_chunks_mut(PIECE).zip(alpha.par_chunks_mut(PIECE)).enumerate();
        pieces.try_for_each(|(piece, (color, alpha))| {
            let mut sum = vec![Vec4::ZERO; color.len()];
            // All passes have equal weight, in either instance.
            for (levels, count) in self.levels.iter().zip(self.counts).filter(|(_, count)| *count > 0) {
                let share = count as f32 / self.passes() as f32;
                let means = means(levels, count, piece * PIECE, sum.len())?;
                sum.iter_mut().zip(means).for_each(|(sum, mean)| *sum += mean.as_vec4() * share);
            }
            for ((color, alpha), sum) in color.iter_mut().zip(alpha).zip(sum) {
                (*color, *alpha) = (sum.truncate(), sum.w);
            }
            Ok(())
        })?;
        Ok((color, alpha))
    }

    /// Direct irradiance and depth.
    fn direct(&self, alpha: &[f32]) -> Result<(Vec<Vec3>, Vec<f32>), L::Error> {
        let (mut direct, mut depth) = (vec![Vec3::ZERO; self.pixels()], vec![0.0; self.pixels()]);
        let pieces = direct.par_chunks_mut(PIECE).zip(depth.par_chunks_mut(PIECE)).zip(alpha.par_chunks(PIECE));
        pieces.enumerate().try_for_each(|(piece, ((direct, depth), alpha))| {
            let means = means(self.levels[DIRECT], self.passes(), piece * PIECE, direct.len())?;
            for (((direct, depth), &alpha), mean) in direct.iter_mut().zip(depth).zip(alpha).zip(means) {
                let mean = mean.as_vec4();
                (*direct, *depth) = (mean.truncate(), if alpha > 0.0 { mean.w / alpha } else { f32::INFINITY });
            }
            Ok(())
        })?;
        Ok((direct, depth))
    }

    fn rgb(&self, sum: usize) -> Result<Vec<Vec3>, L::Error> {
        self.map(sum, Vec4::truncate)
    }

    fn map(&self, sum: usize, layer: impl Fn(Vec4) -> Vec3 + Sync) -> Result<Vec<Vec3>, L::Error> {
        let mut values = vec![Vec3::ZERO; self.pixels()];
        values.par_chunks_mut(PIECE).enumerate().try_for_each(|(piece, values)| {
            let means = means(self.levels[sum], self.passes(), piece * PIECE, values.len())?;
            values.iter_mut().zip(means).for_each(|(value, mean)| *value = layer(mean.as_vec4()));
            Ok(())
        })?;
        Ok(values)
    }
}
