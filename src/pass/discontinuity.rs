//! The discontinuity buffer (Wald et al. 2002, 4.3; row W3): irradiance is averaged over the neighbours of a pixel that lie on
//! its surface, and only then multiplied by the pixel's own reflectance, so that textures stay sharp.
//!
//! Of a pixel i and the pixels j of a window around it, with shares s_ij of the window and a_ij = 1 where both lie on one smooth
//! surface, else 0, irradiance E (W/m^2) becomes
//!
//! ```text
//! E'_i = E_i + sum_j s_ij a_ij (E_j - E_i) / sum_j s_ij             Agreement::Plane
//! E'_i = sum_j s_ij a_ij E_j / sum_j s_ij a_ij                      Agreement::Paper
//! ```
//!
//! for direct and indirect irradiance each; where all agree both are the window's mean. Sums of the filtered passes accumulate like
//! those of unfiltered ones. The radiance of specular lobes stays as it is: it belongs to one direction and one gloss, so it
//! has no neighbours to share it with. Background, emitters, glass, and what reflects nothing diffusely take no part.
//!
//! **What is preserved.** A constant irradiance is, by both, up to rounding. The first has symmetrical weights, so what a
//! pixel gains others lose: the sum of irradiance over a surface is preserved whatever agrees. The second, the paper's, divides
//! by what was included: it smooths more beside edges, and preserves the sum only where all agree.
//!
//! **Window.** With a pattern of n x m classes (interleaved sampling) each class must count alike, or the pattern would
//! show. Along each axis the shares are those of a box of n pixels smoothed by a box that brings it to the window's odd width: convolution
//! with a box of n gives each class the same sum exactly. Width 3: 1 1 1 for n = 1 and 3, 1/2 1 1/2 for n = 2; width 5: 1/2 1 1 1 1/2 for n = 4,
//! 1/3 2/3 1 2/3 1/3 for n = 3.
//!
//! **Agreement.** Both tests treat i and j alike, and both ask for shading normals within 26 degrees, [`LEAST_COSINE`].
//! [`Agreement::Paper`] thresholds the difference of distances from the eye besides, here depths along the whole way and relative to the nearer
//! one, [`PAPER_TOLERANCE`]. It fails on surfaces that recede from the eye, curved ones at their rims, and on parallel planes a
//! little apart. [`Agreement::Plane`] asks of the chord d between the points, with geometric normals n_i and n_j:
//!
//! - |d (n_i + n_j)|^2 <= |d|^2 (|n_i - n_j|^2 + (2 tolerance)^2): seen from the tangent planes the chord rises no more than the surface turns on
//!   the way ([`PLANE_TOLERANCE`]). It holds across planes, and on curved surfaces, where the bound widens with their
//!   curvature, whether tessellated or not; it fails where one plane lies above another;
//! - |d| <= 2 r max(f_i, f_j) for pixels r apart, f what a pixel covers there: the points are no farther apart than
//!   neighbours on a surface so inclined.
//!
//! **Mirrors and glass.** Second components (see `eye_paths`) are filtered among themselves, from and to their own slots, before
//! `merge`. Receivers are compared where they are, and depths and footprints are those of the whole way: what is seen
//! directly is averaged with what a mirror shows only if both are the same piece of a surface, whose irradiance does not depend
//! on the way by which it is seen.
//!
//! Differs from the paper in: the test and the weights unless [`Agreement::Paper`] is chosen (it compares depths in place of distances, and
//! gives no thresholds); windows smoothed as above; caustics are not in yet.
//!
//! Bias: shadows and anything else in the irradiance is blurred over the window, in the limit as well. A pixel's filtered irradiance is
//! what the layers show.
//!
//! Cost of a pixel: six vec4 read, two written, 70 operations for the guides; then for windows up to 3 x 3 22 / 4 times four vec4 read
//! (three without direct light) and 9 x 60 operations, for wider ones of w x h pixels w (h + 3) / 4 times as many and w h x 70;
//! two vec4 written. Second components cost the same for pixels of tiles that show mirrors or glass. 640x480 on two cores by
//! lavapipe: 23 to 31 ms for 3 x 3 (docs/interactive.md). Memory: 48 or 64 bytes a slot.

use glam::{IVec2, Vec3, Vec4};

use super::layout::{self, Window};
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, EyePathState, Kit, Lighting, List, ShadingPoints};
use crate::accel::offset_origin;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::settings::{Agreement, Filter};

/// Least scalar product of the shading normals of pixels that agree.
///
/// Lower: rounder things are smoothed, and creases blurred. Higher: noise stays on what turns within a window.
pub const LEAST_COSINE: f32 = 0.9;

/// Slope of a chord against the tangent planes that is taken for none.
///
/// Higher: sheets that lie higher above what they cover are mixed with it. Lower: nothing gained, down to the rounding of points.
pub const PLANE_TOLERANCE: f32 = 0.05;

/// Difference of depths that the paper's test takes for smooth, relative to the nearer one.
///
/// Higher: parallel planes farther apart are mixed. Lower: surfaces that recede from the eye are not smoothed.
pub const PAPER_TOLERANCE: f32 = 0.02;

/// The pass.
pub struct Discontinuity {
    /// Points on the surface; w: octahedral code of the geometric normal.
    pub guide_points: Buffer,
    /// Shading normals; w: squared footprint, or depth, 0 where the slot takes no part.
    pub guide_normals: Buffer,
    /// The sums, filtered where they are filtered, else the same buffers.
    pub filtered: Lighting,
    guides: BoundKernel,
    average: BoundKernel,
    windows: Vec<Window>,
    tiles: Buffer,
    tile_count: u32,
}

/// What the pass reads, and how.
pub struct Inputs<'a> {
    /// What the eye sees.
    pub points: &'a ShadingPoints,
    /// The ways on which it is seen.
    pub paths: &'a EyePathState,
    /// Light at these points.
    pub lighting: &'a Lighting,
    /// Tiles with second components.
    pub ideal_tiles: &'a List,
    /// Components of a pixel, 1 or 2.
    pub components: u32,
    /// Width and height of the image.
    pub size: [u32; 2],
    /// Width and height of the interleaving pattern.
    pub pattern: [u32; 2],
    /// How to filter.
    pub filter: Filter,
}

impl Discontinuity {
    /// Prepares the filter of `inputs.lighting`.
    pub fn new(kit: &Kit, inputs: &Inputs) -> Result<Self> {
        let Inputs { points, paths, lighting, ideal_tiles, components, size, pattern, filter } = *inputs;
        let [width, height] = size;
        let array = |what: &str| kit.vec4s(&format!("discontinuity {what}"), width * height * components);
        let (guide_points, guide_normals) = (array("points")?, array("normals")?);
        let filtered = Lighting {
            direct: if filter.direct { array("direct")? } else { lighting.direct.clone() },
            indirect: array("indirect")?,
            specular: lighting.specular.clone(),
        };
        let windows: Vec<Window> =
            (0..components).map(|component| Window { component, ..Window::new(&filter, pattern) }).collect();
        let paper = filter.agreement == Agreement::Paper;
        let guides = if paper { &shaders::DISCONTINUITY_GUIDES_PAPER } else { &shaders::DISCONTINUITY_GUIDES };
        let wide = windows[0].reach.iter().any(|&reach| reach > 1);
        let average = match (wide, paper, filter.direct) {
            (false, false, true) => &shaders::DISCONTINUITY,
            (false, false, false) => &shaders::DISCONTINUITY_INDIRECT,
            (false, true, true) => &shaders::DISCONTINUITY_PAPER,
            (false, true, false) => &shaders::DISCONTINUITY_PAPER_INDIRECT,
            (true, false, true) => &shaders::DISCONTINUITY_WIDE,
            (true, false, false) => &shaders::DISCONTINUITY_WIDE_INDIRECT,
            (true, true, true) => &shaders::DISCONTINUITY_WIDE_PAPER,
            (true, true, false) => &shaders::DISCONTINUITY_WIDE_PAPER_INDIRECT,
        };
        let own = Resources::of([
            ("guide_points", &guide_points),
            ("guide_normals", &guide_normals),
            ("filtered_direct", &filtered.direct),
            ("filtered_indirect", &filtered.indirect),
        ]);
        let (points, paths, lighting) = (points.resources(), paths.resources(), lighting.resources());
        let bind = |shader| kit.bind(shader, &[&own, &points, &paths, &lighting, &ideal_tiles.as_tiles()]);
        let (guides, average) = (bind(guides)?, bind(average)?);
        let tile_count = width.div_ceil(8) * height.div_ceil(8);
        let tiles = ideal_tiles.work.clone();
        Ok(Discontinuity { guide_points, guide_normals, filtered, guides, average, windows, tiles, tile_count })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        if self.windows.len() > 1 {
            // Second components of the tiles that are not listed take no part.
            rec.fill(&self.guide_normals, 0)?;
        }
        for kernel in [&self.guides, &self.average] {
            for window in &self.windows {
                let push = bytemuck::bytes_of(window);
                match window.component {
                    0 => kernel.run(rec, push, self.tile_count.into())?,
                    _ => kernel.run_listed(rec, push, &self.tiles, LIST_GROUPS)?,
                }
            }
        }
        Ok(())
    }
}

impl Window {
    /// The window of a filter for images interleaved in this pattern.
    pub fn new(filter: &Filter, pattern: [u32; 2]) -> Window {
        let axes = [0, 1].map(|axis| shares(filter.window(pattern)[axis], pattern[axis]));
        let away = |axis: usize| std::array::from_fn(|i| axes[axis].get(i + 1).copied().unwrap_or(0.0));
        let whole = |axis: usize| axes[axis][0] + 2.0 * axes[axis][1..].iter().sum::<f32>();
        Window {
            shares_x: away(0),
            shares_y: away(1),
            reach: [axes[0].len() as i32 - 1, axes[1].len() as i32 - 1],
            middle: 1.0 / (whole(0) * whole(1)),
            component: 0,
        }
    }

    /// Share of the neighbour at an offset, the middle pixel's being 1.
    pub fn share(&self, offset: IVec2) -> f32 {
        let axis = |shares: [f32; 4], away: i32| match away.unsigned_abs() as usize {
            0 => 1.0,
            away => shares.get(away - 1).copied().unwrap_or(0.0),
        };
        axis(self.shares_x, offset.x) * axis(self.shares_y, offset.y)
    }
}

/// Shares of the pixels 0, 1, ... away from the middle of a window of this odd width over `classes` classes: a box of as many pixels,
/// smoothed by another one that brings it to the width. The middle one's is 1.
fn shares(width: u32, classes: u32) -> Vec<f32> {
    let other = width + 1 - classes;
    let reach = width as i32 / 2;
    // Pixels that both boxes cover when one is moved across the other.
    let overlap = |away: i32| (reach + 1 - away).clamp(0, classes.min(other) as i32) as f32;
    (0..=reach).map(|away| overlap(away) / overlap(0)).collect()
}

/// What is compared of a receiver.
#[derive(Clone, Copy, Debug, Default)]
pub struct Guide {
    /// Point on the surface.
    pub point: Vec3,
    /// Geometric normal.
    pub geometric: Vec3,
    /// Shading normal.
    pub shading: Vec3,
    /// Twice what a pixel covers there, squared, or with the paper's test the depth; 0: it takes no part.
    pub extent: f32,
}

/// A receiver as the passes before left it.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// Position, ray-origin offset applied.
    pub position: Vec4,
    /// Geometric normal.
    pub geometric: Vec4,
    /// Shading normal.
    pub shading: Vec4,
    /// Diffuse albedo.
    pub kd: Vec4,
    /// Direction to the eye; w: [`ShadingPoints::flags`].
    pub wo: Vec4,
    /// Depth along the way from the eye.
    pub depth: f32,
}

/// Oracle: the guide of a receiver.
pub fn guide(frame: &layout::Frame, agreement: Agreement, receiver: &Receiver) -> Guide {
    let length = |v: [f32; 4]| Vec4::from(v).truncate().length();
    let [width, height, ..] = frame.size;
    let geometric = receiver.geometric.truncate();
    let pixel = 2.0 * (length(frame.right) / width as f32).max(length(frame.up) / height as f32);
    let covered = receiver.depth * pixel / geometric.dot(receiver.wo.truncate()).max(0.02);
    let takes_part =
        ShadingPoints::flags(receiver.wo.w) & ShadingPoints::LIT != 0 && receiver.kd.truncate() != Vec3::ZERO;
    Guide {
        point: offset_origin(receiver.position.truncate(), -geometric, frame.eye[3]),
        geometric,
        shading: receiver.shading.truncate(),
        extent: match agreement {
            _ if !takes_part => 0.0,
            Agreement::Plane => (2.0 * covered).powi(2),
            Agreement::Paper => receiver.depth,
        },
    }
}

/// Oracle: whether two receivers, `apart` pixels from each other, lie on one smooth surface.
pub fn agree(frame: &layout::Frame, agreement: Agreement, a: &Guide, b: &Guide, apart: f32) -> bool {
    let alike = a.extent.min(b.extent) > 0.0 && a.shading.dot(b.shading) >= LEAST_COSINE;
    alike
        && match agreement {
            Agreement::Paper => (a.extent - b.extent).abs() <= PAPER_TOLERANCE * a.extent.min(b.extent),
            Agreement::Plane => {
                let chord = b.point - a.point;
                let turn = (a.geometric - b.geometric).length().hypot(2.0 * PLANE_TOLERANCE);
                // Two millionths of the scene, for the rounding of points.
                let rounding = frame.eye[3] / 524_288.0;
                chord.dot(a.geometric + b.geometric).abs() <= (chord.length() * turn).hypot(rounding)
                    && chord.length() <= apart * a.extent.max(b.extent).sqrt()
            }
        }
}

/// Oracle: the filtered irradiance of all pixels of one component.
pub fn reference(
    frame: &layout::Frame,
    agreement: Agreement,
    window: &Window,
    guides: &[Guide],
    irradiance: &[Vec3],
) -> Vec<Vec3> {
    let [width, height, ..] = frame.size.map(|n| n as i32);
    let [reach_x, reach_y] = window.reach;
    let filtered = |i: usize| {
        let here = IVec2::new(i as i32 % width, i as i32 / width);
        let (mut gain, mut agreed) = (Vec3::ZERO, 0.0);
        for dy in -reach_y..=reach_y {
            for dx in -reach_x..=reach_x {
                let offset = IVec2::new(dx, dy);
                let there = here + offset;
                if !(0..width).contains(&there.x) || !(0..height).contains(&there.y) {
                    continue;
                }
                let j = (there.y * width + there.x) as usize;
                if agree(frame, agreement, &guides[i], &guides[j], offset.as_vec2().length()) {
                    gain += window.share(offset) * (irradiance[j] - irradiance[i]);
                    agreed += window.share(offset);
                }
            }
        }
        let weight = match agreement {
            Agreement::Plane => window.middle,
            Agreement::Paper => 1.0 / agreed.max(1.0),
        };
        irradiance[i] + weight * gain
    };
    (0..irradiance.len()).map(filtered).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    #[test]
    fn windows_that_leave_out_a_class_or_have_no_middle_are_refused() {
        let valid = |window, pattern| {
            let filter = Some(Filter { window, ..Filter::default() });
            Settings { filter, pattern, ..Settings::default() }.validate().is_ok()
        };
        assert!((1..=8).all(|n| (1..=8).all(|m| valid(None, [n, m]))));
        assert!(valid(Some([1, 9]), [1, 8]));
        for (window, pattern) in [([4, 3], [1, 1]), ([3, 5], [1, 6]), ([3, 11], [1, 1]), ([0, 3], [1, 1])] {
            assert!(!valid(Some(window), pattern), "{window:?} over {pattern:?}");
        }
    }

    #[test]
    fn windows_known_by_hand() {
        assert_eq!(shares(1, 1), [1.0]);
        assert_eq!(shares(3, 1), [1.0, 1.0]);
        assert_eq!(shares(3, 2), [1.0, 0.5]);
        assert_eq!(shares(3, 3), [1.0, 1.0]);
        assert_eq!(shares(5, 3), [1.0, 2.0 / 3.0, 1.0 / 3.0]);
        assert_eq!(shares(5, 4), [1.0, 1.0, 0.5]);
        assert_eq!(shares(9, 1), [1.0; 5]);
    }

    #[test]
    fn every_class_counts_alike_in_every_window() {
        for classes in 1..=8_u32 {
            for width in (classes | 1..=9).step_by(2) {
                let window = Window::new(&Filter { window: Some([width, 1]), ..Filter::default() }, [classes, 1]);
                let reach = window.reach[0];
                assert_eq!(reach, width as i32 / 2);
                let mut sums = vec![0.0; classes as usize];
                for x in -reach..=reach {
                    sums[x.rem_euclid(classes as i32) as usize] += window.share(IVec2::new(x, 0)) * window.middle;
                }
                let alike = sums.iter().all(|sum| (sum * classes as f32 - 1.0).abs() < 1e-6);
                assert!(alike, "{classes} classes, width {width}: {sums:?}");
            }
        }
    }
}
