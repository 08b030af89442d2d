//! Light from virtual lights after one planar reflection: the mirror image of a light lights the points that see it
//! through the mirror's outline (Keller 1997, 4.2).
//!
//! For a point at x with normal n, a light at y, its image y' behind a mirror, and the intersection p of the segment
//! from x to y' with the mirror's plane:
//!
//! ```text
//! E += [p on the mirror] V(x, p) V(p, y) F(cos p) I'(y' -> x) cos(x) / max(|x - y'|^2, clip^2)
//! L += f_s(x, wi, wo) times the same
//! ```
//!
//! I' is the intensity of the light with its axes mirrored, F the mirror's reflectance, textures included, as in
//! [`crate::bsdf::ideal`]. Parallel light is mirrored likewise, without falloff. E is part of the indirect irradiance.
//! Distances over the mirror are clipped, and the light thus lost is not gathered.
//!
//! For each class of pixels N pairs of a light of the pass and a mirror are chosen, as [`super::delta_choice`] chooses
//! lights, with probability roughly in proportion to the flux that the mirror reflects,
//!
//! ```text
//! w = F_0 I A |h| / d^3      h: height of y above the plane, d: distance of the mirror's centre; |h| / d at least 0.1,
//!                            d at least that of a disc of area A; I the maximum towards the mirror's bounding sphere
//! w = F_0 E A |cos|          parallel light
//! ```
//!
//! and each is weighted by 1 / probability, so that the mean is the sum over all pairs of positive weight. This leaves
//! out lights in the mirror's plane, and surface lights parallel to it that face away.
//!
//! Few points may see a light over the mirror, such as those on the underside of its frame. The light is seldom chosen then, and a bright dot there when it is.
//! So with a filter a light adds at most [`MOST`] times the irradiance E that its point has already, that of mirrored lights before it
//! included; where there is none, all:
//!
//! ```text
//! E' = E_light - w max(0, E_light - MOST E),    w = 1 in the first FULL_PASSES passes, FULL_PASSES / number of the pass after them
//! ```
//!
//! Each light that a point sees raises the bound of the next one. So a dark wall that the mirror lights loses little. Bias: a loss that
//! fades as log(N) / N over N passes, some 0.0002 of a room's light in the first four.
//!
//! Steps: `mirror_choose` for each class; then for each of the N pairs `mirror_aim` sends a ray towards y' from each point from which
//! it would pass the mirror's bounding disc, and lists these points; `trace` finds the nearest surface, `mirror_turn` tests whether it is the mirror and continues to y, `trace` runs
//! again, and `mirror_light` adds the light.
//!
//! With interleaved sampling a quarter of the classes of pixels takes these lights in each pass and counts for the others, as with near
//! rays; second components behind mirrors and glass always do.
//!
//! Differs from the paper in that: the paper mirrors each particle that meets a mirror, and lights the part of the
//! scene in the pyramid of image and outline by a stencil; here the important pairs are chosen, and rays find the
//! outline. There is a single mirror reflection (more are left to photons), and mirrored lights do not light the hits
//! of gather rays. Their light is added after that of photons; the same seed gives the same bits. Cost: N times two
//! closest hits and some 200 operations for each point on that list, 60 for the others; 18 rounds of some 60 operations for each pair.

use glam::Vec3;

use super::layout::{DispatchCounts, FrameParameters, MirrorRecord, PointLight, Step};
use super::schedule::{LIST_GROUPS, Schedule};
use super::shade::{ShadingPoint, light_towards};
use super::trace::Trace;
use super::{BoundKernel, Kit, Lighting, List, Rays, ShadingPoints, push};
use crate::accel::{Bvh, Ray, offset_origin};
use crate::bsdf::anisotropic::{unpack, with_direction};
use crate::bsdf::mean;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::path_trace::PathVertex;
use crate::plan::{MirrorPlan, Plan, StepTable};
use crate::scene::Scene;
use crate::superposition::reflectance::of_mirror;

/// Irradiance by a mirrored light over that which its point has already, at most. Higher: brighter dots beside mirrors in the first passes. Lower: less light there.
pub const MOST: f32 = 8.0;

/// Passes in which that bound holds in full.
pub const FULL_PASSES: u32 = 4;

/// The pass over one set of shading points.
pub struct MirrorLights {
    choose: BoundKernel,
    aim: BoundKernel,
    turn: BoundKernel,
    light: BoundKernel,
    trace: Trace,
    /// Steps of each of the N lights.
    each: Vec<u32>,
    /// Rounds for a list of rays.
    rounds: Vec<u32>,
    work: Buffer,
    /// Points from which the present light may be seen through its mirror.
    pub aimed: List,
    cleared: Buffer,
    schedule: Schedule,
    list_step: u32,
    classes: u32,
    /// For each class N mirrored lights, weights applied.
    pub mirrored: Buffer,
    /// Number of the mirror of each light, plus 1; 0: the slot is empty.
    pub numbers: Buffer,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// [`PointLight`]s of the pass.
    pub lights: &'a Buffer,
    /// The shading points.
    pub points: &'a ShadingPoints,
    /// The lit ones among them.
    pub list: &'a List,
    /// Rays, one for each slot; overwritten.
    pub rays: &'a Rays,
    /// Receives the light.
    pub lighting: &'a Lighting,
    /// Number of slots.
    pub slots: u32,
}

impl MirrorLights {
    /// Adds to `lighting` of the points on the list.
    pub fn new(kit: &Kit, plan: &Plan, mirrors: &MirrorPlan, inputs: &Inputs) -> Result<MirrorLights> {
        let Inputs { lights, points, list, rays, lighting, slots } = *inputs;
        let mut table = StepTable::default();
        let each = (0..mirrors.each).map(|first| table.add(Step { first, ..Step::default() })).collect();
        let rounds = table.add_list_rounds(plan);
        let list_step = table.add_list();
        let steps = table.stage(kit, "mirror steps")?;
        let count = mirrors.each * mirrors.classes;
        let mirrored = kit.array("mirrored lights", count, size_of::<PointLight>() as u64)?;
        let numbers = kit.array("mirrors of lights", count, 4)?;
        let own = Resources::of([
            ("lights", lights),
            ("mirrored", &mirrored),
            ("mirror_number", &numbers),
            ("reflectances", &kit.vec4s("reflectances of mirrors", slots)?),
        ]);
        let aimed = List::new(kit, "points that see mirrored lights", &kit.array("mirrored lights list", slots, 4)?)?;
        let (rays_set, list_set, points) = (rays.resources(), aimed.resources(), points.resources());
        let sets = [&own, &rays_set, &list_set, &points, &lighting.resources(), &steps];
        let of_aim = [&own, &rays_set, &list.resources(), &aimed.as_output(), &points, &steps];
        Ok(MirrorLights {
            choose: kit.bind(&shaders::MIRROR_CHOOSE, &sets)?,
            aim: kit.bind(&shaders::MIRROR_AIM, &of_aim)?,
            turn: kit.bind_surface([&shaders::MIRROR_TURN, &shaders::MIRROR_TURN_UNTEXTURED], &sets)?,
            light: kit.bind(&shaders::MIRROR_LIGHT, &sets)?,
            trace: Trace::new(kit, rays, &aimed, &steps)?,
            schedule: Schedule::new(kit, &aimed.work, &steps)?,
            cleared: kit.stage("cleared work of mirrored lights", &[DispatchCounts::of_classes(1)])?,
            aimed,
            each,
            rounds,
            list_step,
            work: list.work.clone(),
            classes: mirrors.classes,
            mirrored,
            numbers,
        })
    }

    /// Records the choice of lights and mirrors, and the light of the chosen pairs.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_choice(rec)?;
        self.record_light(rec)
    }

    /// Records the choice of lights and mirrors.
    pub fn record_choice(&self, rec: &mut Recorder) -> Result<()> {
        self.choose.run(rec, &[], u64::from(self.classes))
    }

    /// Records the light of the chosen pairs.
    pub fn record_light(&self, rec: &mut Recorder) -> Result<()> {
        for &step in &self.each {
            let run =
                |rec: &mut Recorder, kernel: &BoundKernel, work| kernel.run_listed(rec, &push(step), work, LIST_GROUPS);
            rec.copy(&self.cleared, &self.aimed.work)?;
            run(rec, &self.aim, &self.work)?;
            self.schedule.record(rec, self.list_step)?;
            self.trace.record(rec, &self.rounds, None)?;
            run(rec, &self.turn, &self.aimed.work)?;
            self.trace.record(rec, &self.rounds, None)?;
            run(rec, &self.light, &self.aimed.work)?;
        }
        Ok(())
    }
}

fn xyz(a: [f32; 4]) -> Vec3 {
    Vec3::new(a[0], a[1], a[2])
}

/// Oracle: the weight of a pair.
pub fn weight(light: &PointLight, mirror: &MirrorRecord) -> f64 {
    let (n, normal) = (xyz(mirror.plane), xyz(light.normal));
    let (area, f0, emit) = (mirror.middle[3], mean(xyz(mirror.ideal)), mean(xyz(light.emit)));
    let has = |flag: u32| light.flags() & flag != 0;
    if has(PointLight::DIRECTIONAL) {
        return f64::from(f0 * emit * area * n.dot(normal).abs());
    }
    let height = n.dot(xyz(light.position)) - mirror.plane[3];
    let to = xyz(mirror.middle) - xyz(light.position);
    let far = to.length().max((area / std::f32::consts::PI).sqrt());
    let mut intensity = emit;
    if has(PointLight::GLOSSY) {
        intensity += mean(xyz(light.flux)) * mean(xyz(light.f0)) / std::f32::consts::PI;
    }
    if has(PointLight::SURFACE) {
        if normal.dot(n) * height.signum() > 0.99999 {
            return 0.0;
        }
        intensity *= ((normal.dot(to) + mirror.ideal[3]) / far).clamp(0.0, 1.0);
    }
    let angle = if height == 0.0 { 0.0 } else { area * (height.abs() / far).clamp(0.1, 1.0) / (far * far) };
    f64::from(f0 * intensity * angle)
}

/// Oracle: the mirror image of a light.
pub fn mirrored(light: &PointLight, mirror: &MirrorRecord) -> PointLight {
    let n = xyz(mirror.plane);
    let direction = |v: [f32; 4]| (xyz(v) - 2.0 * n.dot(xyz(v)) * n).extend(v[3]).to_array();
    let height = n.dot(xyz(light.position)) - mirror.plane[3];
    let position = (xyz(light.position) - 2.0 * height * n).extend(light.position[3]).to_array();
    let (normal, mut wi) = (direction(light.normal), direction(light.wi));
    if let Some(grain) = unpack(wi[3], xyz(light.normal)).filter(|_| light.flags() & PointLight::GLOSSY != 0) {
        let along = grain.along - 2.0 * n.dot(grain.along) * n;
        wi[3] = with_direction(wi[3], along, xyz(normal));
    }
    PointLight { position, normal, wi, ..*light }
}

/// Oracle: irradiance and specular radiance that a mirrored light of mirror `number` adds at a shading point.
pub fn reference(
    frame: &FrameParameters,
    scene: &Scene,
    bvh: &Bvh,
    (mirrors, of_triangle): (&[MirrorRecord], &[u32]),
    receiver: &ShadingPoint,
    image: &PointLight,
    number: u32,
) -> [Vec3; 2] {
    let none = [Vec3::ZERO; 2];
    let mirror = &mirrors[number as usize];
    let far = frame.forward[3];
    let way = |light: &PointLight, x: Vec3| match light.flags() & PointLight::DIRECTIONAL {
        0 => xyz(light.position) - x,
        _ => -far * xyz(light.normal),
    };
    let d = way(image, receiver.position);
    let (r2, wi) = (d.length_squared(), d.normalize_or_zero());
    let cos = wi.dot(receiver.shading);
    let side = xyz(mirror.plane).dot(receiver.position) - mirror.plane[3];
    if cos <= 0.0 || wi.dot(receiver.geometric) <= 0.0 || side * xyz(mirror.plane).dot(wi) >= 0.0 {
        return none;
    }
    let Some(hit) = bvh.closest(&Ray::new(receiver.position, wi)) else { return none };
    if of_triangle[hit.triangle as usize] != number + 1 {
        return none;
    }
    let point = PathVertex::of(scene, bvh, &hit, -wi);
    let finish = point.finish(scene);
    let reflected = of_mirror(frame.reflectance(), (finish.ideal, finish.ideal_f90), point.normals.shading.dot(-wi));
    let origin = offset_origin(point.position, point.normals.geometric, frame.eye[3]);
    let direction = way(&mirrored(image, mirror), origin);
    if bvh.occluded(&Ray { origin, t_max: 1.0, direction }) {
        return none;
    }
    let e = light_towards(&scene.materials, image, wi, r2, frame.right[3]) * reflected * cos;
    // A path along the lobe brings the light of surfaces.
    let left_out = receiver.sampled.is_some() && image.flags() & PointLight::SURFACE != 0;
    let gloss = if receiver.reflectance.f90 > 0.0 && !left_out {
        receiver.reflectance.eval_specular(&scene.materials, receiver.shading, receiver.wo, wi)
    } else {
        Vec3::ZERO
    };
    [e, e * gloss]
}

/// Oracle: the part of the irradiance `e` by a mirrored light that a point receives which has `already` so much.
pub fn bounded(frame: &FrameParameters, e: Vec3, already: Vec3) -> f32 {
    let most = MOST * mean(already);
    if most <= 0.0 || frame.mirrors[3] <= 1 {
        return 1.0;
    }
    let weight = (FULL_PASSES as f32 * frame.shift[3]).min(1.0);
    1.0 - weight * (1.0 - most / mean(e).max(1e-30)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_stands_behind_the_mirror_and_faces_it() {
        // The plane y = 1, seen from above.
        let mirror = MirrorRecord {
            plane: [0.0, 1.0, 0.0, 1.0],
            middle: [0.0, 1.0, 0.0, 4.0],
            ideal: [0.5, 0.5, 0.5, std::f32::consts::SQRT_2],
        };
        let light = PointLight {
            position: [2.0, 4.0, 3.0, f32::from_bits(PointLight::SURFACE)],
            normal: [0.6, -0.8, 0.0, 0.0],
            emit: [3.0, 3.0, 3.0, 1.0],
            ..PointLight::default()
        };
        let image = mirrored(&light, &mirror);
        assert_eq!(image.position[..3], [2.0, -2.0, 3.0]);
        assert_eq!(image.normal[..3], [0.6, 0.8, 0.0]);
        assert_eq!(mirrored(&image, &mirror), light);
        // F_0 I A h / d^3, with the maximum cosine at the light; it faces away from the centre by (-2, -3, -3) . (0.6,
        // -0.8, 0).
        let d = 22f64.sqrt();
        let wide = (1.2 + 2f64.sqrt()) / d;
        assert!((weight(&light, &mirror) - 0.5 * 3.0 * wide * 4.0 * 3.0 / d.powi(3)).abs() < 1e-5);
        let away = PointLight { normal: [0.0, 1.0, 0.0, 0.0], ..light };
        assert_eq!(weight(&away, &mirror), 0.0);
        let parallel = PointLight { position: [0.0, 0.0, 0.0, f32::from_bits(PointLight::DIRECTIONAL)], ..light };
        assert!((weight(&parallel, &mirror) - 0.5 * 3.0 * 4.0 * 0.8).abs() < 1e-6);
    }
}
