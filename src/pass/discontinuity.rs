//! The discontinuity buffer (Wald et al. 2002, 4.3): averages irradiance over the neighbours of a pixel that lie on the
//! same surface, before the multiplication by the pixel's own reflectance, so that textures stay sharp.
//!
//! For a pixel i and the pixels j of a window around it, with window weights s_ij, and a_ij = 1 if both lie on one
//! smooth surface, else 0, the filtered irradiance E (W/m^2) is
//!
//! ```text
//! E'_i = E_i + w sum_j s_ij a_ij (E_j - E_i) / sum_j s_ij           Agreement::Plane
//! E'_i = E_i + w sum_j s_ij a_ij (E_j - E_i) / sum_j s_ij a_ij      Agreement::DepthAndNormal
//! ```
//!
//! for direct and indirect irradiance separately, w the weight of the pass ([`Filter::weight`]), at first 1; where all pixels agree
//! both are the window's mean. Sums of filtered
//! passes accumulate like those of unfiltered ones. Background, emitters, glass, and surfaces without diffuse reflection take
//! no part.
//!
//! **Preserved quantities.** Both forms preserve a constant irradiance up to rounding. The weights of the first are
//! symmetrical, so a gain of one pixel is a loss of others: it preserves the sum of irradiance over a surface,
//! whichever pixels agree. The second, the paper's, divides by the sum of the weights used: it smooths more beside
//! edges, and preserves the sum only where all agree.
//!
//! **Window.** With a pattern of n x m classes (interleaved sampling) all classes need the same total weight, or the
//! pattern would show. Along each axis the weights are those of a box of n pixels convolved with a box that brings it
//! to the window's odd width: convolution with a box of n gives each class exactly the same sum. Width 3: 1 1 1 for n =
//! 1 and 3, 1/2 1 1/2 for n = 2; width 5: 1/2 1 1 1 1/2 for n = 4, 1/3 2/3 1 2/3 1/3 for n = 3.
//!
//! **Agreement.** Both tests are symmetric in i and j, and both require shading normals within 26 degrees,
//! [`MIN_COSINE`]. [`Agreement::DepthAndNormal`] also thresholds the difference of distances from the eye, here depths along
//! the whole path and relative to the smaller one, [`PAPER_TOLERANCE`]. It fails on surfaces that recede from the eye,
//! on curved surfaces at their silhouettes, and on parallel planes a small distance apart. [`Agreement::Plane`]
//! requires of the chord d between the points, with geometric normals n_i and n_j:
//!
//! - |d (n_i + n_j)|^2 <= |d|^2 (|n_i - n_j|^2 + (2 tolerance)^2): the slope of the chord against the tangent planes
//!   does not exceed the turn of the normal between the points ([`PLANE_TOLERANCE`]). It holds across planes, and on
//!   curved surfaces, where the bound grows with curvature, whether tessellated or not; it fails where one plane lies
//!   above another;
//! - |d| <= 2 r max(f_i, f_j) for pixels r apart, f the footprint of a pixel on the surface: the points are no farther
//!   apart than neighbours on a surface of that inclination.
//!
//! **Mirrors and glass.** Second components (see `eye_paths`) are filtered among themselves, in their own slots, before
//! `merge`. Positions are those of the shading points, depths and footprints those of the whole path: a directly
//! visible point is averaged with a point in a mirror only if both belong to the same piece of a surface, whose
//! irradiance does not depend on the path. Behind curved mirrors and glass and along lobes pixels lie farther apart than depth and
//! inclination tell: there, in first components too, the footprint grows to the distance from the neighbours ([`MAX_SPREAD`]).
//!
//! Differs from the paper in: the test and the weights unless [`Agreement::DepthAndNormal`] is chosen (which compares depths
//! instead of distances, with thresholds that the paper does not give); windows smoothed as above; caustics are not
//! included.
//!
//! Bias: shadows and other detail of the irradiance are blurred over the window; the bias of the mean of N passes vanishes as
//! log(N) / N. The layers contain the filtered irradiance.
//!
//! Cost of a pixel: eight vec4 read, four written, 70 operations for the guides; then for windows up to 3 x 3 22 / 4 times
//! four vec4 read (three without direct light) and 9 x 60 operations, for wider ones of w x h pixels w (h + 3) / 4
//! times as many and w h x 70; two vec4 written. Second components cost the same, and four points more to read, for
//! pixels of tiles that show mirrors, glass or narrow lobes. 640x480 on two cores by lavapipe: 23 to 31 ms for 3 x 3 (docs/interactive.md). Memory: 64 or 96 bytes a
//! slot.

use ash::vk;
use glam::{IVec2, Vec3, Vec4};

use super::layout::{self, Window};
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, EyePathState, Kit, Lighting, List, ShadingPoints};
use crate::accel::offset_origin;
use crate::error::Result;
use crate::gpu::{Buffer, Image, Recorder, Resources, shaders};
use crate::settings::{Agreement, Filter};

/// Minimum scalar product of the shading normals of pixels that agree.
///
/// Lower: surfaces of higher curvature are smoothed, and creases blurred. Higher: noise remains on surfaces that curve
/// within a window.
pub const MIN_COSINE: f32 = 0.9;

/// Maximum slope of a chord against the tangent planes.
///
/// Higher: irradiance bleeds between sheets farther above each other. Lower: no gain, down to the rounding of points.
pub const PLANE_TOLERANCE: f32 = 0.05;

/// Maximum difference of depths by the paper's test, relative to the smaller depth.
///
/// Higher: parallel planes farther apart bleed into each other. Lower: surfaces that recede from the eye are not
/// smoothed.
pub const PAPER_TOLERANCE: f32 = 0.02;

/// Least lack of a window that is not taken for rounding.
pub const LEAST_LACK: f32 = 1e-4;

/// Maximum ratio of the footprint of a point seen by mirrors, glass or lobes, as its neighbours in its tile of 8 x 8 pixels tell it, over that by depth and
/// inclination. Of the two neighbours along an axis the nearer one counts, since an edge may lie before the other.
///
/// Higher: what strongly curved mirrors show is blurred over more of the scene. Lower: it remains noisy.
pub const MAX_SPREAD: f32 = 16.0;

/// The pass.
pub struct Discontinuity {
    /// Inputs of the filter, as images because lavapipe loads texels faster than elements of buffers. Second components lie below the first.
    images: Vec<Image>,
    /// The lighting; filtered quantities have buffers of their own, the others share those of the input. w of indirect irradiance: the lack
    /// of the window, see [`lacks`].
    pub filtered: Lighting,
    guides: BoundKernel,
    average: BoundKernel,
    windows: Vec<Window>,
    tiles: Buffer,
    tile_count: u32,
}

/// Inputs and options.
pub struct Inputs<'a> {
    /// Shading points that the eye sees.
    pub points: &'a ShadingPoints,
    /// State of the eye paths to these points.
    pub paths: &'a EyePathState,
    /// Lighting of these points.
    pub lighting: &'a Lighting,
    /// Tiles with second components.
    pub ideal_tiles: &'a List,
    /// Components of a pixel, 1 or 2.
    pub components: u32,
    /// Width and height of the image.
    pub size: [u32; 2],
    /// Width and height of the interleaving pattern.
    pub pattern: [u32; 2],
    /// The filter.
    pub filter: Filter,
}

impl Discontinuity {
    /// Prepares the filter of `inputs.lighting`.
    pub fn new(kit: &Kit, inputs: &Inputs) -> Result<Self> {
        let Inputs { points, paths, lighting, ideal_tiles, components, size, pattern, filter } = *inputs;
        let [width, height] = size;
        let array = |what: &str| kit.vec4s(&format!("discontinuity {what}"), width * height * components);
        let image = |what: &str| {
            let name = format!("discontinuity {what}");
            Image::new(kit.context, &name, width, height * components, vk::Format::R32G32B32A32_SFLOAT)
        };
        // Points on the surface, w: octahedral code of the geometric normal; shading normals, w: squared footprint, or depth, 0 if the slot
        // takes no part; irradiance.
        let names = ["guide_points", "guide_normals", "guide_indirect", "guide_direct"];
        let names = if filter.direct { &names[..] } else { &names[..3] };
        let images = names.iter().map(|name| image(name)).collect::<Result<Vec<_>>>()?;
        let filtered = Lighting {
            direct: if filter.direct { array("direct")? } else { lighting.direct.clone() },
            indirect: array("indirect")?,
            specular: lighting.specular.clone(),
        };
        let windows = Window::of_components(&filter, pattern, components);
        let paper = filter.agreement == Agreement::DepthAndNormal;
        let guides = match (paper, filter.direct) {
            (false, true) => &shaders::DISCONTINUITY_GUIDES,
            (false, false) => &shaders::DISCONTINUITY_GUIDES_INDIRECT,
            (true, true) => &shaders::DISCONTINUITY_GUIDES_PAPER,
            (true, false) => &shaders::DISCONTINUITY_GUIDES_PAPER_INDIRECT,
        };
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
        let own = Resources::of([("filtered_direct", &filtered.direct), ("filtered_indirect", &filtered.indirect)]);
        let own = names.iter().zip(&images).fold(own, |own, (name, image)| own.with_image(name, image));
        let (points, paths, lighting) = (points.resources(), paths.resources(), lighting.resources());
        let bind = |shader| kit.bind(shader, &[&own, &points, &paths, &lighting, &ideal_tiles.as_tiles()]);
        let (guides, average) = (bind(guides)?, bind(average)?);
        let tile_count = width.div_ceil(8) * height.div_ceil(8);
        let tiles = ideal_tiles.work.clone();
        Ok(Discontinuity { images, filtered, guides, average, windows, tiles, tile_count })
    }

    /// The images that the test of agreement reads.
    pub fn guides(&self) -> Resources {
        let names = ["guide_points", "guide_normals"];
        names.iter().zip(&self.images).fold(Resources::new(), |all, (name, image)| all.with_image(name, image))
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        for image in &self.images {
            rec.image_to_general(image)?;
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
    /// The windows of each component.
    pub fn of_components(filter: &Filter, pattern: [u32; 2], components: u32) -> Vec<Window> {
        (0..components).map(|component| Window { component, ..Window::new(filter, pattern) }).collect()
    }

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

    /// Weight of the neighbour at an offset, relative to the centre pixel's.
    pub fn share(&self, offset: IVec2) -> f32 {
        let axis = |shares: [f32; 4], away: i32| match away.unsigned_abs() as usize {
            0 => 1.0,
            away => shares.get(away - 1).copied().unwrap_or(0.0),
        };
        axis(self.shares_x, offset.x) * axis(self.shares_y, offset.y)
    }
}

/// Weights of the pixels 0, 1, ... away from the centre of a window of this odd width: a box of `classes` pixels
/// convolved with a box that brings it to the width. The centre has weight 1.
fn shares(width: u32, classes: u32) -> Vec<f32> {
    let other = width + 1 - classes;
    let reach = width as i32 / 2;
    // Pixels in the overlap of the two boxes, one shifted by `away`.
    let overlap = |away: i32| (reach + 1 - away).clamp(0, classes.min(other) as i32) as f32;
    (0..=reach).map(|away| overlap(away) / overlap(0)).collect()
}

/// Quantities of a shading point that the test compares.
#[derive(Clone, Copy, Debug, Default)]
pub struct Guide {
    /// Point on the surface.
    pub point: Vec3,
    /// Geometric normal.
    pub geometric: Vec3,
    /// Shading normal.
    pub shading: Vec3,
    /// Squared double footprint of a pixel, or with the paper's test the depth; 0: the point takes no part.
    pub extent: f32,
}

/// A shading point, as earlier passes left it.
#[derive(Clone, Copy, Debug)]
pub struct PixelPoint {
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
    /// Depth along the path from the eye.
    pub depth: f32,
}

/// Oracle: the guide of a shading point. `neighbours`: of a second component, the positions of its lit neighbours before and after
/// along each axis, within its tile; of a first one, none.
pub fn guide(
    frame: &layout::FrameParameters,
    agreement: Agreement,
    receiver: &PixelPoint,
    neighbours: [[Option<Vec3>; 2]; 2],
) -> Guide {
    let length = |v: [f32; 4]| Vec4::from(v).truncate().length();
    let [width, height, ..] = frame.size;
    let geometric = receiver.geometric.truncate();
    let pixel = 2.0 * (length(frame.right) / width as f32).max(length(frame.up) / height as f32);
    let covered = frame.depth_scale(receiver.depth) * pixel / geometric.dot(receiver.wo.truncate()).max(0.02);
    let distance = |p: Vec3| p.distance(receiver.position.truncate());
    let nearer = |axis: [Option<Vec3>; 2]| axis.into_iter().flatten().map(distance).reduce(f32::min);
    let spread = neighbours.into_iter().filter_map(nearer).fold(covered, f32::max).min(MAX_SPREAD * covered);
    let takes_part =
        ShadingPoints::flags(receiver.wo.w) & ShadingPoints::LIT != 0 && receiver.kd.truncate() != Vec3::ZERO;
    Guide {
        point: offset_origin(receiver.position.truncate(), -geometric, frame.eye[3]),
        geometric,
        shading: receiver.shading.truncate(),
        extent: match agreement {
            _ if !takes_part => 0.0,
            Agreement::Plane => (2.0 * spread).powi(2),
            Agreement::DepthAndNormal => receiver.depth,
        },
    }
}

/// Oracle: whether two shading points, `apart` pixels from each other, lie on one smooth surface.
pub fn agree(frame: &layout::FrameParameters, agreement: Agreement, a: &Guide, b: &Guide, apart: f32) -> bool {
    let alike = a.extent.min(b.extent) > 0.0 && a.shading.dot(b.shading) >= MIN_COSINE;
    alike
        && match agreement {
            Agreement::DepthAndNormal => (a.extent - b.extent).abs() <= PAPER_TOLERANCE * a.extent.min(b.extent),
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
    frame: &layout::FrameParameters,
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
            Agreement::DepthAndNormal => 1.0 / agreed.max(1.0),
        };
        irradiance[i] + frame.lens[2] * weight * gain
    };
    (0..irradiance.len()).map(filtered).collect()
}

/// Oracle: the lack of the windows of all pixels of one component, the share of their weight that found no pixel that agrees; 0 by the paper's test.
pub fn lacks(frame: &layout::FrameParameters, agreement: Agreement, window: &Window, guides: &[Guide]) -> Vec<f32> {
    let [width, height, ..] = frame.size.map(|n| n as i32);
    let [reach_x, reach_y] = window.reach;
    let lack = |i: usize| {
        let here = IVec2::new(i as i32 % width, i as i32 / width);
        let offsets = (-reach_y..=reach_y).flat_map(|dy| (-reach_x..=reach_x).map(move |dx| IVec2::new(dx, dy)));
        let agreeing = offsets.filter(|&offset| {
            let there = here + offset;
            let inside = (0..width).contains(&there.x) && (0..height).contains(&there.y);
            let other = if inside { guides[(there.y * width + there.x) as usize] } else { Guide::default() };
            agree(frame, agreement, &guides[i], &other, offset.as_vec2().length())
        });
        let missing = 1.0 - window.middle * agreeing.map(|offset| window.share(offset)).sum::<f32>();
        if guides[i].extent > 0.0 && missing > LEAST_LACK { missing } else { 0.0 }
    };
    match agreement {
        Agreement::Plane => (0..guides.len()).map(lack).collect(),
        Agreement::DepthAndNormal => vec![0.0; guides.len()],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    #[test]
    fn the_filter_fades() {
        let full = Filter::FULL_PASSES;
        assert!((0..full).all(|pass| Filter::weight(pass) == 1.0));
        assert!((Filter::weight(2 * full - 1) - 0.5).abs() < 1e-6);
        // The share of the bias that is left after N passes.
        let passes = 100 * full;
        let mean = (0..passes).map(|pass| f64::from(Filter::weight(pass))).sum::<f64>() / f64::from(passes);
        assert!(mean < (1.0 + 100f64.ln()) / 100.0, "{mean}");
    }

    #[test]
    fn windows_that_leave_out_a_class_or_have_no_middle_are_refused() {
        let valid = |window, pattern| {
            let filter = Some(Filter { window, ..Filter::default() });
            Settings { filter, pattern, ..Settings::plain() }.validate().is_ok()
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
