//! Lines and points over the image: the box of the chosen object, and of the latest pass virtual lights and kernels of mirror images.

use egui::{Color32, Painter, Pos2, Rect, Stroke};
use glam::Vec3;
use lightsum::scene::Camera;

use super::navigate;
use super::session::Session;

/// Most lights that are drawn; of more, evenly spread ones.
const MOST: usize = 4096;
/// Corners of a box at the ends of its edges: bits of the axes.
const EDGES: [[usize; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

/// Kernels that are drawn in a line.
const KERNELS: usize = 16;
/// Edges of the outline of one.
const OUTLINE_EDGES: u32 = 48;
/// Minimum of pixels between them, each way.
const KERNEL_SPACING: usize = 16;

/// The kernel by which a pixel of a mirror image is spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kernel {
    /// Centre of the pixel, pixels.
    center: [f32; 2],
    /// Diameter, pixels.
    diameter: f32,
    /// Vector of its u axis; it points from the mirror direction to the normal, on curved surfaces along the longer axis. Its length, where
    /// above 1, is the factor by which it is longer than wide there.
    axis: [f32; 2],
}

/// Kernels of evenly spaced pixels, of an image with a footprint (diameter, texture, u axis) and a region for each pixel; region 0 has none.
pub fn kernels(footprints: &[[f32; 4]], regions: &[u32], width: usize) -> Vec<Kernel> {
    let lines = regions.len() / width.max(1);
    let spacing = (width / KERNELS).max(KERNEL_SPACING);
    let places = (spacing / 2..lines).step_by(spacing);
    let places = places.flat_map(|y| (spacing / 2..width).step_by(spacing).map(move |x| [x, y]));
    places
        .filter(|[x, y]| regions[y * width + x] != 0)
        .map(|[x, y]| {
            let [diameter, _, u, v] = footprints[y * width + x];
            Kernel { center: [x as f32 + 0.5, y as f32 + 0.5], diameter, axis: [u, v] }
        })
        .collect()
}

/// Draws them into the place of the image, in points.
pub fn show(painter: &Painter, session: &Session, place: Rect) {
    let camera = session.camera();
    let painter = painter.with_clip_rect(place);
    for light in session.lights().iter().step_by(session.lights().len() / MOST + 1).filter(|light| !light.is_parallel())
    {
        let emit = Vec3::from_slice(&light.emit);
        let position = Vec3::from_slice(&light.position);
        if let (true, Some(at)) = (emit.max_element() > 0.0, at(&camera, position, place)) {
            painter.circle(at, 2.0, color(emit), Stroke::new(0.5, Color32::BLACK));
        }
    }
    let [width, height] = session.engine().view().size().map(|n| n as f32);
    let scale = place.size() / egui::vec2(width, height);
    for kernel in session.kernels() {
        let center = place.min + egui::Vec2::from(kernel.center) * scale;
        let radius = 0.5 * kernel.diameter * scale.x;
        let stroke = Stroke::new(1.0, Color32::from_rgba_unmultiplied(90, 220, 255, 110));
        let axis = egui::Vec2::from(kernel.axis);
        let along = axis.normalized() * radius;
        let across = along.rot90() / axis.length().max(1.0);
        let angles = (0..OUTLINE_EDGES).map(|i| std::f32::consts::TAU * i as f32 / OUTLINE_EDGES as f32);
        let outline = angles.map(|angle| center + along * angle.cos() + across * angle.sin()).collect();
        painter.add(egui::Shape::closed_line(outline, stroke));
        painter.line_segment([center, center + along], stroke);
    }
    let Some((low, high)) = session.bounds() else { return };
    let corner =
        |i: usize| Vec3::from_array([0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] }));
    for ends in EDGES {
        if let [Some(from), Some(to)] = ends.map(|i| at(&camera, corner(i), place)) {
            painter.line_segment([from, to], Stroke::new(1.0, Color32::from_rgb(255, 200, 80)));
        }
    }
}

/// Where a point of the scene is seen; `None`: behind the eye.
fn at(camera: &Camera, point: Vec3, place: Rect) -> Option<Pos2> {
    let [x, y] = navigate::project(camera, point)?;
    let scale = place.size() / egui::vec2(camera.resolution[0] as f32, camera.resolution[1] as f32);
    Some(place.min + egui::vec2(x, y) * scale)
}

/// The hue of a light at full brightness.
fn color(emit: Vec3) -> Color32 {
    let [r, g, b] = (emit / emit.max_element()).clamp(Vec3::ZERO, Vec3::ONE).to_array();
    egui::Rgba::from_rgb(r, g, b).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_are_those_of_evenly_spaced_pixels() {
        let (width, height) = (40, 20);
        let footprints: Vec<[f32; 4]> = (0..width * height).map(|i| [i as f32, 0.0, 0.6, 0.8]).collect();
        let mut regions = vec![1; width * height];
        let at = |x: usize, y: usize| Kernel {
            center: [x as f32 + 0.5, y as f32 + 0.5],
            diameter: (y * width + x) as f32,
            axis: [0.6, 0.8],
        };
        assert_eq!(kernels(&footprints, &regions, width), [at(8, 8), at(24, 8)]);
        regions[8 * width + 8] = 0;
        assert_eq!(kernels(&footprints, &regions, width), [at(24, 8)]);
        assert_eq!(kernels(&[], &[], 0), []);
    }
}
