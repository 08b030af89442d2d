//! Lines and points over the image: the box of the chosen object, and the virtual lights of the latest pass.

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
