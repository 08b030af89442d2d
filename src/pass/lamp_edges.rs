//! Antialiased lamps in mirrors and glass: more eye rays where what a path's emission shows changes from pixel to pixel.
//!
//! A lamp is far brighter than its surroundings, and curved glass makes it small: one ray a pixel finds all of it or nothing.
//! [`edges`] finds no edges that curved mirrors and glass show. This pass finds those of emission. A component of a pixel is at an edge if the eye
//! sees it over mirrors or glass, and not by one flat mirror alone, and if its emission differs from that of one of four neighbours by more than [`CONTRAST`]
//! times the greater of the pixel's radiance and the neighbour's emission.
//!
//! A tile of 8 x 8 pixels has as many rays as its pixels have slots. They are shared among the slots at edges: for each the pixel's own ray once more, and at most
//! [`MAX_RAYS`] through other points of the pixel. A ray seeks one slot. It splits where the eye's path does ([`eye_paths`](super::eye_paths)) and takes the
//! component that belongs to its slot; where no slot is left it takes the likelier component, divided by its probability. It ends on the first surface that is neither mirror nor glass.
//! It casts no shadow rays and brings emission only:
//!
//! ```text
//! L_ray = sum over its surfaces of throughput L_e
//! L_e(slot) += w (mean of L_ray over the rays that end in the slot, the own one among them - L_ray of the own one)
//! ```
//!
//! The weight w is that of [`edges`]: 1 in the first F = [`FULL_PASSES`](edges::FULL_PASSES) passes, then F / number of the pass. Third components have joined the second ones,
//! so their emission is added there.
//!
//! A slot keeps its emission if its own ray does not end in it: if the ray passes more than [`MAX_BOUNCES`] mirrors and surfaces of glass, or meets a narrow lobe or a reflector of
//! superposition. Rays that miss the glass do not count: its outline is an edge for `edges`.
//!
//! Bias: a lamp smaller than a pixel gives its pixel too little light, since the pixel has more rays only if its own or a neighbour's meets
//! the lamp. The bias fades as w does. Light that surfaces reflect keeps one ray a pixel.
//!
//! Cost: for each pixel of a tile that shows mirrors, glass or narrow lobes 27 vec4 and 150 operations; for each ray and surface 170 bytes read, 100 written, 400 operations,
//! and one ray of `trace`. Memory: 44 bytes a slot.

use glam::Vec3;

use super::edges::{self, EdgeGuides};
use super::layout::FrameParameters;
use super::schedule::LIST_GROUPS;
use super::surface::SurfacePoint;
use super::{BoundKernel, EyePathState, Kit, Lighting, List, Rays, ShadingPoints, push};
use crate::accel::{Ray, offset_origin};
use crate::bsdf::ideal::{Media, specular_samples};
use crate::bsdf::{Normals, mean};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::scene::{Scene, Surface};

/// Difference of emission from which on there is an edge, over what the pixel shows, or the emission of the other one if that is more.
pub const CONTRAST: f32 = 0.2;

/// Maximum number of rays of a component beside its own.
pub const MAX_RAYS: u32 = 4;

/// Maximum number of mirrors and surfaces of glass that a ray passes.
pub const MAX_BOUNCES: u32 = 5;

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// First hits.
    pub guides: &'a EdgeGuides,
    /// Visible shading points; their emission receives the result.
    pub points: &'a ShadingPoints,
    /// Throughput of the eye's paths, and room for the media of the rays.
    pub paths: &'a EyePathState,
    /// Light at the points.
    pub lighting: &'a Lighting,
    /// Tiles with second components.
    pub tiles: &'a List,
    /// Planes that pixels show, whose mirror image is spread.
    pub region: &'a Buffer,
    /// Room for the rays: as many as the pixels have slots.
    pub rays: &'a Rays,
    /// The rays at each of their surfaces; one more, to which nothing is added.
    pub lists: &'a [List],
    /// Receives what the rays add, see [`gain`](super::gain).
    pub path_gain: Option<&'a Buffer>,
}

/// The pass.
pub struct LampEdges {
    /// Of each pixel of the listed tiles: 0, or 64 * its first ray in its tile + 4 * the rays of each slot that it seeks + bits of its components at edges.
    pub marks: Buffer,
    /// Throughput of each ray; w: depth of its origin.
    pub beta: Buffer,
    /// Emission along each ray; w: 1 where it has ended in its slot.
    pub light: Buffer,
    /// Of each ray: slots and whether it has met more than flat mirrors.
    pub way: Buffer,
    mark: BoundKernel,
    start: BoundKernel,
    turns: Vec<(BoundKernel, Buffer)>,
    add: BoundKernel,
    tiles: Buffer,
}

impl LampEdges {
    /// For an image of so many pixels with so many slots in all.
    pub fn new(kit: &Kit, inputs: &Inputs, [pixels, slots]: [u32; 2], steps: &Resources) -> Result<Self> {
        let Inputs { guides, points, paths, lighting, tiles, region, rays, lists, path_gain } = *inputs;
        let marks = kit.array("lamp edges", pixels, 4)?;
        let beta = kit.vec4s("throughput at lamp edges", slots)?;
        let light = kit.vec4s("light at lamp edges", slots)?;
        let way = kit.array("ways at lamp edges", slots, 4)?;
        let own = Resources::of([
            ("marks", &marks),
            ("lamp_beta", &beta),
            ("lamp_light", &light),
            ("lamp_way", &way),
            ("region", region),
            // Without flat mirrors or the sum of the gain the kernels have no such bindings.
            ("second_hits", guides.second_hits.as_ref().unwrap_or(&marks)),
            ("path_gain", path_gain.unwrap_or(&light)),
        ]);
        let (points, rays, paths) = (points.resources(), rays.resources(), paths.resources());
        let of_tiles = tiles.as_tiles();
        let mark =
            if guides.second_hits.is_some() { &shaders::LAMP_EDGES_MARK_MIRRORS } else { &shaders::LAMP_EDGES_MARK };
        let add = if path_gain.is_some() { &shaders::LAMP_EDGES_ADD_GAIN } else { &shaders::LAMP_EDGES_ADD };
        let start = [&own, &of_tiles, &rays, &paths, &lists[0].as_output(), steps];
        let turn = [&shaders::LAMP_EDGES_TURN, &shaders::LAMP_EDGES_TURN_UNTEXTURED];
        let turns = lists.windows(2).map(|pair| {
            let sets = [&own, &rays, &paths, &pair[0].as_input(), &pair[1].as_output(), steps];
            Ok((kit.bind_surface(turn, &sets)?, pair[0].work.clone()))
        });
        Ok(LampEdges {
            mark: kit.bind(mark, &[&own, &of_tiles, &points, &paths, &lighting.resources()])?,
            start: kit.bind(&shaders::LAMP_EDGES_RAYS, &start)?,
            turns: turns.collect::<Result<_>>()?,
            add: kit.bind(add, &[&own, &of_tiles, &points, steps])?,
            tiles: tiles.work.clone(),
            marks,
            beta,
            light,
            way,
        })
    }

    /// Records the part that finds edges.
    pub fn record_mark(&self, rec: &mut Recorder) -> Result<()> {
        self.mark.run_listed(rec, &[], &self.tiles, LIST_GROUPS)
    }

    /// Records the part that starts rays at them; `step` has the slots of a pixel.
    pub fn record_rays(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        self.start.run_listed(rec, &push(step), &self.tiles, LIST_GROUPS)
    }

    /// Records what rays do at their surface of number `bounce`, from 0, once they are traced.
    pub fn record_turn(&self, rec: &mut Recorder, bounce: usize, step: u32) -> Result<()> {
        let (kernel, work) = &self.turns[bounce];
        kernel.run_listed(rec, &push(step), work, LIST_GROUPS)
    }

    /// Records the part that adds their light to the points.
    pub fn record_add(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        self.add.run_listed(rec, &push(step), &self.tiles, LIST_GROUPS)
    }
}

/// Oracle: whether the emission of a component of a pixel that shows this radiance in all differs from a neighbour's.
pub fn differ(own: Vec3, shown: Vec3, theirs: Vec3) -> bool {
    (mean(theirs) - mean(own)).abs() > CONTRAST * mean(theirs).max(mean(shown))
}

/// Oracle: the slots that the rays of a pixel seek, whose components at edges these are.
pub fn sought(components: [bool; 2], slots: u32) -> impl Iterator<Item = u32> {
    (0..slots).filter(move |&slot| components[slot.min(1) as usize])
}

/// Oracle: rays of each of so many sought slots of a tile of `pixels` pixels, the own one among them; 0: it would be the only one.
pub fn rays_of(sought: u32, pixels: u32, slots: u32) -> u32 {
    let each = (pixels * slots / sought.max(1)).min(MAX_RAYS + 1);
    if each > 1 { each } else { 0 }
}

/// Oracle: a ray between two of its surfaces.
#[derive(Clone, Copy, Debug)]
pub struct LampRay {
    /// The ray.
    pub ray: Ray,
    /// Cosine between its first segment and the view direction.
    pub cos_view: f32,
    /// Throughput so far.
    pub beta: Vec3,
    /// Depth of the origin.
    pub depth: f32,
    /// Bodies of glass around it.
    pub media: Media,
    /// Emission so far.
    pub light: Vec3,
    /// Slots: the one that it seeks, the one that it is in, and that of the next component which splits off, 0: none.
    pub slots: [u32; 3],
    /// Whether it has met more than flat mirrors.
    pub bends: bool,
}

/// Oracle: what becomes of a ray at a surface.
#[derive(Clone, Copy, Debug)]
pub enum Turn {
    /// It goes on.
    On(LampRay),
    /// It has ended with this emission; `None`: without a result.
    Ended(Option<Vec3>),
}

impl LampRay {
    /// An eye ray that seeks a slot.
    pub fn new(frame: &FrameParameters, ray: Ray, seeks: u32) -> LampRay {
        let [x, y, z, _] = frame.forward;
        let (cos_view, media) = (ray.direction.dot(Vec3::new(x, y, z)), Media::default());
        LampRay {
            ray,
            cos_view,
            beta: Vec3::ONE,
            depth: 0.0,
            media,
            light: Vec3::ZERO,
            slots: [seeks, 0, 1],
            bends: false,
        }
    }

    fn ended(&self, more: Vec3) -> Turn {
        let [seeks, slot, _] = self.slots;
        Turn::Ended(Some(self.light + more).filter(|_| seeks == slot && self.bends))
    }

    /// After a hit on `surface` at distance `t`, of a mirror of a smooth surface or not; `None`: it met nothing. `last`: it goes on no more.
    /// `slots`: those of a pixel.
    pub fn turned(
        &self,
        (frame, scene): (&FrameParameters, &Scene),
        slots: u32,
        hit: Option<(&SurfacePoint, f32, bool)>,
        last: bool,
    ) -> Turn {
        let d = self.ray.direction;
        let Some((surface, t, smooth)) = hit else {
            return self.ended(scene.environment.as_ref().map_or(Vec3::ZERO, |all| self.beta * all.seen(d)));
        };
        let material = &scene.materials[surface.material as usize];
        let normals = Normals { geometric: surface.geometric, shading: surface.shading, front: surface.front };
        let eta = self.media.relative_index(&scene.materials, surface.material, surface.front);
        let samples = specular_samples(material, &surface.finish, &normals, -d, eta, frame.reflectance());
        let Some(samples) = samples.filter(|_| material.surface != Surface::Opaque) else {
            return self.ended(self.beta * surface.emission);
        };
        let split = samples.split(surface.reflectance.kd);
        let [seeks, slot, free] = self.slots;
        let splits = split.probability < 1.0 && free > 0 && free < slots;
        let turns_off = splits && seeks == free;
        let first = if splits { !turns_off } else { split.probability >= 0.5 };
        let chance = match (splits, first) {
            (true, _) => 1.0,
            (false, true) => split.probability,
            (false, false) => 1.0 - split.probability,
        };
        let has_base = split.first.is_none();
        let emission = if has_base { Vec3::ZERO } else { self.beta * surface.emission };
        let left = if free + 1 < slots && (!turns_off || has_base) { free + 1 } else { 0 };
        let next = LampRay {
            beta: self.beta / chance,
            light: if turns_off { Vec3::ZERO } else { self.light + emission },
            slots: [seeks, if turns_off { free } else { slot }, if splits { left } else { free }],
            bends: self.bends || smooth || material.surface != Surface::Mirror || has_base,
            depth: self.depth + self.cos_view * t,
            ..*self
        };
        let Some(sample) = (if first { split.first } else { split.second }) else {
            return next.ended(next.beta * surface.emission);
        };
        let beta = next.beta * sample.weight;
        if last || beta.max_element() <= 0.0 {
            return Turn::Ended(None);
        }
        let side = if sample.wi.dot(surface.geometric) > 0.0 { surface.geometric } else { -surface.geometric };
        let origin = offset_origin(surface.position, side, frame.eye[3]);
        let media = if sample.crosses { self.media.crossed(surface.material, surface.front) } else { self.media };
        Turn::On(LampRay { ray: Ray { origin, t_max: 3.0e38, direction: sample.wi }, beta, media, ..next })
    }
}

/// Oracle: what is added to the emission of a slot: `own` is that of its own ray, `others` those of the other ones.
pub fn change(frame: &FrameParameters, own: Option<Vec3>, others: &[Option<Vec3>]) -> Vec3 {
    let Some(own) = own else { return Vec3::ZERO };
    let known: Vec<Vec3> = others.iter().flatten().copied().collect();
    let mean = (own + known.iter().sum::<Vec3>()) / (1 + known.len()) as f32;
    edges::weight_in_pass(frame) * (mean - own)
}
