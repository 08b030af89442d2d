//! LDR-FLIP (Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images"): how different two images look where a viewer
//! flips between them, 0 to 1 for each pixel.
//!
//! Colour: both images are filtered by the contrast sensitivity of the eye in an opponent space, and their distance in L*a*b* (Hunt, HyAB)
//! is mapped to 0 to 1. Features: edges and points of the luminance. The difference of features is an exponent of that of colours.

use std::f32::consts::PI;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

/// Pixels per degree of the visual angle: a screen of 3840 pixels and 0.7 m, seen from 0.7 m.
pub const PIXELS_PER_DEGREE: f32 = 3840.0 * PI / 180.0;

/// The exponent, the share and the value of equations 6 and 7 that compress differences of colour.
const COLOR_EXPONENT: f32 = 0.7;
const KNEE: f32 = 0.4;
const AT_KNEE: f32 = 0.95;
/// Width in degrees, and exponent, of the feature detection.
const FEATURE_WIDTH: f32 = 0.082;
const FEATURE_EXPONENT: f32 = 0.5;

/// Amplitude and falloff of the Gaussians of the contrast sensitivity: achromatic, red-green, blue-yellow.
const SENSITIVITY: [[(f32, f32); 2]; 3] =
    [[(1.0, 0.0047), (0.0, 1e-5)], [(1.0, 0.0053), (0.0, 1e-5)], [(34.1, 0.04), (13.5, 0.025)]];

/// The difference of each pixel of two images of linear Rec. 709, which are clipped at 0 and 1.
///
/// # Panics
///
/// If they do not have `width * height` pixels.
pub fn flip(reference: &[Vec3], test: &[Vec3], [width, height]: [usize; 2]) -> Vec<f32> {
    assert!(reference.len() == width * height && test.len() == width * height, "images of {width}x{height}");
    let [reference, test] = [reference, test].map(|image| Seen::new(image, [width, height]));
    let hunt = |color: Vec3| hunt(lab(color));
    let most = distance(hunt(Vec3::Y), hunt(Vec3::Z)).powf(COLOR_EXPONENT);
    let knee = KNEE * most;
    (0..width * height)
        .into_par_iter()
        .map(|i| {
            let color = distance(hunt(reference.color[i]), hunt(test.color[i])).powf(COLOR_EXPONENT);
            let color = if color < knee {
                AT_KNEE / knee * color
            } else {
                AT_KNEE + (color - knee) / (most - knee) * (1.0 - AT_KNEE)
            };
            let edges = (reference.edges[i] - test.edges[i]).abs();
            let points = (reference.points[i] - test.points[i]).abs();
            let features = (edges.max(points) / 2.0_f32.sqrt()).powf(FEATURE_EXPONENT);
            color.powf(1.0 - features)
        })
        .collect()
}

/// An image as the eye sees it.
struct Seen {
    /// Filtered, linear Rec. 709.
    color: Vec<Vec3>,
    /// Strength of edges and of points.
    edges: Vec<f32>,
    points: Vec<f32>,
}

impl Seen {
    fn new(image: &[Vec3], size: [usize; 2]) -> Seen {
        let opponent: Vec<Vec3> = image.par_iter().map(|color| opponent(color.clamp(Vec3::ZERO, Vec3::ONE))).collect();
        let planes: [Vec<f32>; 3] = std::array::from_fn(|c| opponent.iter().map(|color| color[c]).collect());
        let luminance: Vec<f32> = planes[0].iter().map(|y| (y + 16.0) / 116.0).collect();
        let mut channel = 0;
        let [y, cx, cz] = planes.map(|plane| {
            channel += 1;
            sensitive(&plane, size, SENSITIVITY[channel - 1])
        });
        let back = |i: usize| linear(Vec3::new(y[i], cx[i], cz[i])).clamp(Vec3::ZERO, Vec3::ONE);
        let color = (0..image.len()).into_par_iter().map(back).collect();

        let deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
        let radius = (3.0 * deviation).ceil() as i32;
        let at = || (-radius..=radius).map(|x| x as f32);
        let gaussian: Vec<f32> = at().map(|x| (-x * x / (2.0 * deviation * deviation)).exp()).collect();
        let of = |shape: &dyn Fn(f32) -> f32| {
            let raw: Vec<f32> = at().zip(&gaussian).map(|(x, g)| shape(x) * g).collect();
            let across: f32 = gaussian.iter().sum();
            // Positive and negative weights sum to one each.
            let sum = |sign: f32| across * raw.iter().map(|v| (sign * v).max(0.0)).sum::<f32>();
            let sums = [sum(1.0), sum(-1.0)];
            let along: Vec<f32> = raw.iter().map(|v| v / if *v > 0.0 { sums[0] } else { sums[1] }).collect();
            let horizontal = convolve(&luminance, size, &along, &gaussian);
            let vertical = convolve(&luminance, size, &gaussian, &along);
            horizontal.iter().zip(&vertical).map(|(x, y)| x.hypot(*y)).collect()
        };
        let edges = of(&|x| -x);
        let points = of(&|x| x * x / (deviation * deviation) - 1.0);
        Seen { color, edges, points }
    }
}

/// A channel filtered by the contrast sensitivity.
fn sensitive(plane: &[f32], size: [usize; 2], gaussians: [(f32, f32); 2]) -> Vec<f32> {
    let widest = SENSITIVITY.iter().flatten().map(|(_, falloff)| *falloff).fold(0.0, f32::max);
    let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let (mut sum, mut total) = (vec![0.0; plane.len()], 0.0);
    for (amplitude, falloff) in gaussians.into_iter().filter(|(amplitude, _)| *amplitude > 0.0) {
        let at = |x: i32| x as f32 / PIXELS_PER_DEGREE;
        let kernel: Vec<f32> = (-radius..=radius).map(|x| (-PI * PI * at(x) * at(x) / falloff).exp()).collect();
        let factor = amplitude * (PI / falloff).sqrt();
        let filtered = convolve(plane, size, &kernel, &kernel);
        sum.iter_mut().zip(filtered).for_each(|(sum, value)| *sum += factor * value);
        total += factor * kernel.iter().sum::<f32>().powi(2);
    }
    sum.iter_mut().for_each(|value| *value /= total);
    sum
}

/// A separable convolution; beyond the border the image goes on as its last pixel.
fn convolve(plane: &[f32], [width, height]: [usize; 2], along: &[f32], across: &[f32]) -> Vec<f32> {
    let near =
        |at: usize, i: usize, kernel: &[f32], length: usize| (at + i).saturating_sub(kernel.len() / 2).min(length - 1);
    let mut rows = vec![0.0; plane.len()];
    rows.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(row, plane)| {
        for (x, value) in row.iter_mut().enumerate() {
            *value = along.iter().enumerate().map(|(i, weight)| weight * plane[near(x, i, along, width)]).sum();
        }
    });
    let mut all = vec![0.0; plane.len()];
    all.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (i, weight) in across.iter().enumerate() {
            let start = width * near(y, i, across, height);
            row.iter_mut().zip(&rows[start..start + width]).for_each(|(sum, value)| *sum += weight * value);
        }
    });
    all
}

/// XYZ of linear Rec. 709.
fn xyz_from_linear() -> Mat3 {
    let rows = [
        [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
        [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
        [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
    ];
    Mat3::from_cols_array_2d(&rows).transpose()
}

/// XYZ relative to white.
fn relative_xyz(color: Vec3) -> Vec3 {
    let matrix = xyz_from_linear();
    (matrix * color) / (matrix * Vec3::ONE)
}

/// YCxCz of linear Rec. 709.
fn opponent(color: Vec3) -> Vec3 {
    let t = relative_xyz(color);
    Vec3::new(116.0 * t.y - 16.0, 500.0 * (t.x - t.y), 200.0 * (t.y - t.z))
}

/// The reverse of [`opponent`].
fn linear(color: Vec3) -> Vec3 {
    let y = (color.x + 16.0) / 116.0;
    let matrix = xyz_from_linear();
    matrix.inverse() * (Vec3::new(y + color.y / 500.0, y, y - color.z / 200.0) * (matrix * Vec3::ONE))
}

/// L*a*b* of linear Rec. 709.
fn lab(color: Vec3) -> Vec3 {
    const DELTA: f32 = 6.0 / 29.0;
    let root = |t: f32| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 };
    let t = relative_xyz(color).map(root);
    Vec3::new(116.0 * t.y - 16.0, 500.0 * (t.x - t.y), 200.0 * (t.y - t.z))
}

/// Colours are less saturated where it is dark (Hunt).
fn hunt(lab: Vec3) -> Vec3 {
    Vec3::new(lab.x, 0.01 * lab.x * lab.y, 0.01 * lab.x * lab.z)
}

/// HyAB: the difference of lightness plus the Euclidean distance of the chromatic components.
fn distance(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::srgb_to_linear;

    /// A pattern of whole numbers, in sRGB.
    fn pattern([width, height]: [usize; 2], k: usize) -> Vec<Vec3> {
        let value = |x: usize, y: usize, c: usize| {
            if c == k % 3 {
                ((x * 7 + y * 3 + k * c) % 11) as f32 / 10.0
            } else {
                ((x / 5 + y / 4 + c) % 3) as f32 / 2.0
            }
        };
        let pixel = |i: usize| Vec3::from_array(std::array::from_fn(|c| value(i % width, i / width, c)));
        (0..width * height).map(pixel).collect()
    }

    fn mean(a: &[Vec3], b: &[Vec3], size: [usize; 2]) -> (f32, f32) {
        let [a, b] = [a, b].map(|image| image.iter().map(|color| color.map(srgb_to_linear)).collect::<Vec<Vec3>>());
        let map = flip(&a, &b, size);
        (map.iter().sum::<f32>() / map.len() as f32, map[0])
    }

    /// The oracle is NVIDIA's own program (flip-evaluator): means and first pixels.
    #[test]
    fn patterns_differ_as_much_as_by_the_authors_program() {
        for (size, a, b, expected) in [
            ([33, 25], 0, 1, (0.732_501, 0.521_263)),
            ([33, 25], 1, 2, (0.738_589, 0.878_540)),
            ([60, 17], 0, 1, (0.737_599, 0.521_263)),
            ([60, 17], 1, 2, (0.742_551, 0.878_540)),
        ] {
            let found = mean(&pattern(size, a), &pattern(size, b), size);
            let error = (found.0 - expected.0).abs().max((found.1 - expected.1).abs());
            assert!(error < 1e-3, "{size:?}, {a} and {b}: {found:?}, not {expected:?}");
        }
        for (size, expected) in [([33, 25], 0.306_795), ([60, 17], 0.308_209)] {
            let a = pattern(size, 0);
            let b: Vec<Vec3> = a.iter().map(|color| (*color * 0.9 + 0.02).min(Vec3::ONE)).collect();
            let (found, first) = mean(&a, &b, size);
            assert!((found - expected).abs() < 1e-3 && (first - 0.336_506).abs() < 1e-3, "{found}, {first}");
            assert_eq!(mean(&a, &a, size), (0.0, 0.0));
        }
    }

    #[test]
    fn colours_come_back_from_the_opponent_space() {
        for color in [Vec3::new(0.2, 0.5, 0.9), Vec3::ZERO, Vec3::ONE] {
            assert!(linear(opponent(color)).abs_diff_eq(color, 1e-5), "{color}");
        }
        assert!(lab(Vec3::ONE).abs_diff_eq(Vec3::new(100.0, 0.0, 0.0), 1e-3));
    }
}
