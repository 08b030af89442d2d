//! Light at the hits of near rays: from the pixels that show them.
//!
//! A near ray is the first gather ray of the compensation (see `gather`): it restores the share 1 - d^2 / clip^2 of the
//! light from surfaces at a distance d < clip. Where the eye sees its hit, the pixel there knows the irradiance, and no
//! light needs to be sampled; this pass finds that pixel by projection, and checks normal and tangent plane. It takes the
//! nearest pixel of the ray's own class: these have the same lights, so that neighbouring rays find irradiance that
//! varies smoothly. Hits that no pixel shows become shading points, listed in any order: a hit counts with the probability
//! max(1 - d^2 / clip^2, [`KEPT`]), and by the inverse of that, since lighting it costs the same however little of the light clipping removed.
//!
//! Such a hit has no near light of its own: its lights are clipped at [`CLOSER`] of the clip distance, and so that narrow gaps,
//! behind blinds and in shelves, do not lose theirs, the share [`ONWARD`] of the rays goes on from it in place of lighting it, in a
//! direction by the cosine, for what is nearer than that: a path of two near rays, weighted by the inverse of the share, as those that
//! are lit are by the inverse of theirs. At its end the pass runs again ([`NearPoints::onward`]). Not from emitters and lobes, nor where
//! `max_depth` is below 4.
//!
//! Bias: what is near to the ends of such paths is left out. Pixels know irradiance only, so the specular lobe of the hit counts as
//! diffuse reflectance; surfaces with kd / f0 below [`MATTE`] are lit instead. The pixel may lie some pixels away from the hit.
//!
//! Cost: some 200 operations, 230 bytes read and 36 written for a hit that a pixel shows, 150 more for others; and 4
//! texels for each texture. A ray that goes on costs as much again, and a trace of at most half the clip distance.

use glam::Vec3;

use super::layout::FrameParameters;
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, Kit, List, Rays, ShadingPoints};
use crate::bsdf::{basis, sample_diffuse};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, Shader, shaders};
use crate::sampling::dimensions::NEAR;
use crate::sampling::random::{key, random_f32};

/// Minimum cosine of the angle between the normals of hit and pixel.
pub const COSINE: f32 = 0.9;
/// Maximum distance of the hit from the tangent plane of the pixel, in widths of a pixel there.
pub const HEIGHT: f32 = 1.0;
/// Maximum distance between hit and pixel beyond the width of the pattern, in widths of a pixel on the surface.
pub const WIDTH: f32 = 1.0;
/// Minimum kd / f0 of a hit that takes the irradiance of a pixel.
pub const MATTE: f32 = 0.5;
/// Part of the clip distance at which lights are clipped at hits that no pixel shows.
pub const CLOSER: f32 = 0.5;
/// Least probability with which such a hit counts, however little of the light clipping removed. Higher: less noise, more hits to light.
pub const KEPT: f32 = 0.1;
/// Share of the rays that go on from such hits.
pub const ONWARD: f32 = 0.25;
/// Neighbours of a class, across and down, whose near rays have different directions if images are filtered, and whose near light is
/// averaged.
pub const NEAR_SPREAD: u32 = 3;
/// In place of a slot: no pixel shows the hit.
pub const NOT_SHOWN: u32 = u32::MAX;

/// Number of classes that send near rays in a pass.
pub fn ray_classes(classes: u32) -> u32 {
    (classes / 2).max(1)
}

/// Number of a class in the order of the pass; the first [`ray_classes`] send near rays.
pub fn near_order(frame: &FrameParameters, class: u32) -> u32 {
    let classes = frame.pattern[2];
    let turn = (2 * frame.size[3] + frame.instance()) % classes;
    (class + turn * ray_classes(classes)) % classes
}

/// Whether a slot has a near ray in each pass, since no filter spreads its light over the classes: those of second components behind mirrors, glass
/// and narrow lobes. Third ones are too faint to need one. `flags`: [`ShadingPoints::flags`].
pub fn stands_alone(frame: &FrameParameters, slot: u32, flags: u32) -> bool {
    let narrow = flags & ShadingPoints::NARROW_LOBE != 0;
    slot / frame.size[2] == 1 && (narrow || ShadingPoints::segments(flags) == 0)
}

/// Whether a slot of a class sends a near ray in a pass: half of the classes do, others in the next passes; and all
/// slots that stand alone.
pub fn has_near_ray(frame: &FrameParameters, slot: u32, class: u32, flags: u32) -> bool {
    stands_alone(frame, slot, flags) || near_order(frame, class) < ray_classes(frame.pattern[2])
}

/// Number of slots that the near ray of a slot stands for.
pub fn ray_weight(frame: &FrameParameters, slot: u32, flags: u32) -> f32 {
    let pixels = frame.pattern[2] as f32 / ray_classes(frame.pattern[2]) as f32;
    if stands_alone(frame, slot, flags) { 1.0 } else { pixels }
}

/// The pass.
pub struct NearPoints {
    kernel: BoundKernel,
    work: Buffer,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// Traced near rays.
    pub rays: &'a Rays,
    /// Points that they start from.
    pub list_in: &'a List,
    /// The points of the pixels.
    pub seen: &'a ShadingPoints,
    /// Receives the hits that are to be lit.
    pub list_out: &'a List,
    /// Throughput of the near rays; multiplied by the reflectance over pi if a pixel shows the hit. w: the lobe.
    pub beta: &'a Buffer,
    /// Receives the slot of the pixel that shows the hit, or [`NOT_SHOWN`].
    pub near_slot: &'a Buffer,
    /// Receives the hits.
    pub points: &'a ShadingPoints,
    /// Rays that go on from their hits.
    pub onward: &'a List,
}

impl NearPoints {
    /// Writes `points`, `list_out` and `near_slot`, and multiplies `beta`; some rays go on, as `onward` lists.
    pub fn new(kit: &Kit, inputs: &Inputs) -> Result<Self> {
        Self::of(kit, inputs, inputs.list_in, [&shaders::NEAR_POINTS, &shaders::NEAR_POINTS_UNTEXTURED])
    }

    /// The same at the hits of the rays that went on.
    pub fn onward(kit: &Kit, inputs: &Inputs) -> Result<Self> {
        let shaders = [&shaders::NEAR_POINTS_ONWARD, &shaders::NEAR_POINTS_ONWARD_UNTEXTURED];
        Self::of(kit, inputs, inputs.onward, shaders)
    }

    fn of(kit: &Kit, inputs: &Inputs, list_in: &List, shaders: [&'static Shader; 2]) -> Result<Self> {
        let Inputs { rays, seen, list_out, beta, near_slot, points, onward, .. } = *inputs;
        let own = Resources::of([
            ("beta", beta),
            ("near_slot", near_slot),
            ("seen_position", &seen.position),
            ("seen_geometric", &seen.geometric),
            ("seen_wo", &seen.wo),
            ("onward", &onward.entries),
            ("onward_work", &onward.work),
        ]);
        let sets = [&rays.resources(), &list_in.as_input(), &list_out.as_output(), &points.resources(), &own];
        Ok(NearPoints { kernel: kit.bind_surface(shaders, &sets)?, work: list_in.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run_listed(rec, &[], &self.work, LIST_GROUPS)
    }
}

/// Oracle: probability with which a hit that no pixel shows counts, where clipping removed this share of the light; `None`: the hit of this slot does not count.
pub fn kept(frame: &FrameParameters, slot: u32, share: f32) -> Option<f32> {
    let probability = share.max(KEPT);
    (random_f32(key(frame.keys[0], NEAR, frame.sample_of(slot), 3)) < probability).then_some(probability)
}

/// Oracle: of the near ray of a slot that may go on from its hit, with the shading normal there, the direction in which it does.
pub fn goes_on(frame: &FrameParameters, slot: u32, shading: Vec3) -> Option<Vec3> {
    let number = |k: u32| random_f32(key(frame.keys[0], NEAR, frame.sample_of(slot), k));
    let local = sample_diffuse([number(1), number(2)]);
    let (t, b) = basis(shading);
    (number(0) < ONWARD).then(|| t * local.x + b * local.y + shading * local.z)
}

/// The point of a pixel, for the oracle.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Position.
    pub position: Vec3,
    /// Geometric normal, on the eye's side.
    pub geometric: Vec3,
    /// Direction to the eye.
    pub wo: Vec3,
    /// Flags of [`ShadingPoints`].
    pub flags: u32,
}

/// Oracle: the pixel of a class nearest to where the eye ray to `p` falls, if it is in the image.
pub fn pixel_of(frame: &FrameParameters, p: Vec3, class: u32) -> Option<u32> {
    let xyz = |a: [f32; 4]| Vec3::new(a[0], a[1], a[2]);
    let (d, right, up) = (p - xyz(frame.eye), xyz(frame.right), xyz(frame.up));
    let z = d.dot(xyz(frame.forward));
    let scale = frame.depth_scale(z.max(1e-30));
    let [x, y, width, height] = frame.within.map(|n| n as f32);
    let s = d.dot(right) / (scale * right.length_squared()) - frame.shift[0];
    let t = d.dot(up) / (scale * up.length_squared()) - frame.shift[1];
    let nearest = |at: f32, pattern: u32, place: u32| {
        ((at - place as f32) / pattern as f32 + 0.5).floor() * pattern as f32 + place as f32
    };
    let [across, down, ..] = frame.pattern;
    let column = nearest((0.5 + 0.5 * s) * width - x - frame.pixel_offset[0], across, class % across);
    let row = nearest((0.5 - 0.5 * t) * height - y - frame.pixel_offset[1], down, class / across);
    let [columns, rows] = [frame.size[0] as f32, frame.size[1] as f32];
    let inside = z > 0.0 && column >= 0.0 && row >= 0.0 && column < columns && row < rows;
    inside.then(|| column as u32 + row as u32 * frame.size[0])
}

/// Oracle: whether a pixel shows the point `p` of a surface with normal `n`.
pub fn shows(frame: &FrameParameters, seen: &Seen, p: Vec3, n: Vec3) -> bool {
    let xyz = |a: [f32; 4]| Vec3::new(a[0], a[1], a[2]);
    let z = (p - xyz(frame.eye)).dot(xyz(frame.forward));
    let width = 2.0 * frame.depth_scale(z) * xyz(frame.right).length() / frame.within[2] as f32;
    let apart = seen.position - p;
    let cosine = seen.geometric.dot(seen.wo).abs().max(0.1);
    let direct = seen.flags & (ShadingPoints::LIT | ShadingPoints::SEEN_BY_SPECULAR) == ShadingPoints::LIT;
    direct
        && seen.geometric.dot(n) > COSINE
        && seen.geometric.dot(apart).abs() <= HEIGHT * width
        && apart.length() * cosine <= (WIDTH + frame.pattern[0].max(frame.pattern[1]) as f32) * width
}
