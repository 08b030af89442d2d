//! Spreads the light of texels that are much brighter than those around them.
//!
//! Light that clipping removed is gathered by one ray for each texel and pass ([`gather`](crate::pass::gather)). A ray that ends beside
//! something bright makes its texel many times too bright in the first passes, and what a texel shows stands still on a surface and is as
//! large as the texel, so that dots are seen that an image would lose. Indirect light above [`ABOVE`] times that of half of the eight texels
//! around goes to these in equal parts; then the same with the eight texels at twice the distance, and so on ([`STRIDES`]), each time
//! within a chart. The sum of the light stays, and that is where it differs from the removal of outliers in images
//! ([`outliers`](crate::pass::outliers)). From [`FULL_PASSES`] passes on a part of it stays in its place, which grows with the passes, as the
//! blur of the filter fades ([`Filter::weight`](crate::settings::Filter::weight)). Direct light, which has true edges, is left as it is.
//!
//! Cost: 9 texels read and 20 comparisons for each texel and distance, on the host.

use glam::Vec3;
use rayon::prelude::*;

/// Light over that of half of the texels around from which a texel is an outlier.
const ABOVE: f32 = 2.0;
/// Distances of the texels around.
const STRIDES: [i64; 3] = [1, 2, 4];
/// Passes from which on less is spread.
const FULL_PASSES: u32 = 64;

/// Spreads the outliers of a page of indirect light after so many passes. `valid`: texels that have a point; the others keep their light.
pub fn spread(light: &mut [Vec3], valid: &[bool], width: u32, passes: u32) {
    let share = FULL_PASSES as f32 / passes.max(FULL_PASSES) as f32;
    let islands = islands(valid, width);
    for stride in STRIDES {
        let islands = &islands;
        let around = |i: usize| {
            let own = islands[i];
            neighbours(i, width, islands.len(), stride).filter(move |&j| islands[j] == own && own != 0)
        };
        let taken: Vec<(Vec3, f32)> = (0..light.len())
            .into_par_iter()
            .map(|i| {
                let (mut found, mut count) = ([0.0; 8], 0);
                for j in around(i) {
                    found[count] = light[j].element_sum();
                    count += 1;
                }
                if count < 4 {
                    return (Vec3::ZERO, 0.0);
                }
                found[..count].sort_by(|a, b| b.total_cmp(a));
                let (own, most) = (light[i].element_sum(), ABOVE * found[(count - 1) / 2]);
                let part = if own > most { share * (1.0 - most / own) } else { 0.0 };
                (part * light[i], 1.0 / count as f32)
            })
            .collect();
        light.par_iter_mut().enumerate().for_each(|(i, light)| {
            let given = around(i).map(|j| taken[j].0 * taken[j].1).sum::<Vec3>();
            *light += given - taken[i].0;
        });
    }
}

/// For each texel the number of the connected texels with a point that it belongs to, 0 without a point.
fn islands(valid: &[bool], width: u32) -> Vec<u32> {
    let (mut islands, mut number, mut open) = (vec![0; valid.len()], 0, Vec::new());
    for first in 0..valid.len() {
        if !valid[first] || islands[first] != 0 {
            continue;
        }
        number += 1;
        islands[first] = number;
        open.push(first);
        while let Some(i) = open.pop() {
            for j in neighbours(i, width, valid.len(), 1) {
                if valid[j] && islands[j] == 0 {
                    islands[j] = number;
                    open.push(j);
                }
            }
        }
    }
    islands
}

/// The eight texels around one at a distance, those that lie on a page of so many.
fn neighbours(i: usize, width: u32, count: usize, stride: i64) -> impl Iterator<Item = usize> {
    let (width, i) = (i64::from(width), i as i64);
    let (x, y) = (i % width, i / width);
    let around =
        (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| (stride * dx, stride * dy))).filter(|&at| at != (0, 0));
    let inside =
        move |&(dx, dy): &(i64, i64)| (0..width).contains(&(x + dx)) && (0..count as i64 / width).contains(&(y + dy));
    around.filter(inside).map(move |(dx, dy)| (i + dx + dy * width) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sum(light: &[Vec3]) -> Vec3 {
        light.iter().sum()
    }

    #[test]
    fn a_dot_is_spread_and_its_light_stays() {
        let mut light = vec![Vec3::new(1.0, 2.0, 3.0); 441];
        light[220] *= 30.0;
        let before = sum(&light);
        spread(&mut light, &[true; 441], 21, 1);
        assert!((sum(&light) - before).length() < 1e-4 * before.length());
        let most = light.iter().map(|l| l.x).fold(0.0, f32::max);
        assert!(most < 2.5, "{most}");
        // Texels at one distance have the same light.
        assert!((light[219] - light[221]).length() < 1e-5 && (light[199] - light[241]).length() < 1e-5);
    }

    #[test]
    fn edges_and_gradients_stay() {
        // On a slope half of the texels around are brighter, and beside an edge of any height half are alike.
        let edge: Vec<Vec3> = (0..64).map(|i| Vec3::splat(if i % 8 < 4 { 1.0 } else { 100.0 })).collect();
        let mut light = edge.clone();
        spread(&mut light, &[true; 64], 8, 1);
        assert_eq!(light, edge);
        let slope: Vec<Vec3> = (0..64).map(|i| Vec3::splat(1.0 + (i % 8) as f32)).collect();
        let mut light = slope.clone();
        spread(&mut light, &[true; 64], 8, 1);
        assert_eq!(light, slope);
    }

    #[test]
    fn texels_without_a_point_take_no_part() {
        let mut light = vec![Vec3::ONE; 25];
        light[12] = Vec3::splat(50.0);
        // A row without points parts the page: no light crosses it.
        let valid: Vec<bool> = (0..25).map(|i| i / 5 != 1).collect();
        spread(&mut light, &valid, 5, 1);
        assert_eq!(light[..10], [Vec3::ONE; 10]);
        assert!((sum(&light).x - 74.0).abs() < 1e-3 && light[12].x < 50.0);
        // Too few around to tell.
        let mut lone = vec![Vec3::ONE, Vec3::splat(9.0), Vec3::ONE];
        spread(&mut lone, &[true; 3], 3, 1);
        assert_eq!(lone[1], Vec3::splat(9.0));
    }

    #[test]
    fn passes_bring_the_light_back() {
        let dot = |passes: u32| {
            let mut light = vec![Vec3::ONE; 49];
            light[24] = Vec3::splat(11.0);
            spread(&mut light, &[true; 49], 7, passes);
            light[24].x
        };
        assert!(dot(1) == dot(64) && dot(256) > dot(64) && dot(100_000) > 10.9);
    }
}
