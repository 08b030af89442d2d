//! Rays aimed at near emitters, and the light that they add, against their oracles.

use crate::conform::rig::{Rig, STRAYS, Tally, close, hit_of, ray_of};
use crate::error::Result;
use crate::gpu::Recorder;
use crate::pass::near_aim::{self, Part};
use crate::pass::shade::ShadingPoint;
use crate::pass::surface::surface_at;
use crate::pass::{Lighting, List};
use glam::Vec3;

/// Rays that have been traced, whose light is not added yet.
pub struct Aimed<'a> {
    /// Name in messages.
    pub what: String,
    /// Distance within which emitters are aimed at.
    pub reach: f32,
    /// The points that have a ray.
    pub list: &'a List,
    /// Light of the points.
    pub lighting: &'a Lighting,
    /// Sample point of a slot.
    pub point: &'a dyn Fn(u32) -> [f32; 2],
    /// Share over density of the ray of a slot and point, by its cosine and its density.
    pub weight: &'a dyn Fn(u32, &ShadingPoint, f32, f32) -> f32,
    /// Records the part that adds the light.
    pub record_light: &'a dyn Fn(&mut Recorder) -> Result<()>,
}

/// The emitters that a point can aim at.
pub fn parts_of(rig: &Rig, point: &ShadingPoint, reach: f32) -> Vec<(Part, f32)> {
    near_aim::parts(&rig.engine.emitters().list, point.position, point.shading, reach)
}

impl Aimed<'_> {
    /// They leave those of the slots that `is_source` names, and add light of the emitters that they meet. Returns how many.
    pub fn check(&self, rig: &Rig, slots: &[u32], from: &[ShadingPoint], is_source: impl Fn(usize) -> bool) -> usize {
        let (p, eye, reach) = (&rig.parameters, &rig.frame().eye, self.reach);
        let aimed = rig.sorted(self.list);
        let [origin, direction, hits] = [&eye.rays.origin, &eye.rays.direction, &eye.rays.hits].map(|b| rig.vec4s(b));
        let old = rig.vec4s(&self.lighting.direct);
        rig.run(|_, rec| (self.record_light)(rec));
        let new = rig.vec4s(&self.lighting.direct);
        let mut rays = Tally::new(self.what.clone());
        let mut light = Tally::new(format!("light of {}", self.what));
        for &slot in slots {
            let i = slot as usize;
            let point = &from[i];
            let parts = parts_of(rig, point, reach);
            let expected = near_aim::direction(&parts, (self.point)(slot)).filter(|_| is_source(i)).and_then(|wi| {
                let (cosine, by_aim) = (wi.dot(point.shading), near_aim::density(&parts, wi));
                let weight = (self.weight)(slot, point, cosine, by_aim);
                (cosine > 0.0 && wi.dot(point.geometric) > 0.0 && by_aim > 0.0).then_some((wi, cosine * weight))
            });
            let is_aimed = aimed.binary_search(&slot).is_ok();
            let ray = ray_of(origin[i], direction[i]);
            let same = is_aimed == expected.is_some()
                && expected.is_none_or(|(wi, weight)| {
                    let start = ray.origin == point.position && ray.t_max == reach;
                    start && close(ray.direction, wi, 0.0, 1e-3) && (direction[i].w - weight).abs() <= 5e-3 * weight
                });
            rays.check(same, || format!("slot {i}: {:?} for {expected:?}", is_aimed.then_some((ray, direction[i].w))));
            let hit = hit_of(hits[i]).filter(|_| is_aimed);
            let found = hit.map_or(Vec3::ZERO, |hit| {
                let emission = surface_at(rig.scene, rig.bvh(), &hit, ray.direction, p.cones[2] * hit.t).emission;
                direction[i].w * (1.0 - (hit.t / reach).powi(2)).max(0.0) * emission
            });
            let added = (new[i] - old[i]).truncate();
            let sum = old[i].truncate() + found;
            light.check(close(new[i].truncate(), sum, 1e-4, 1e-6), || format!("slot {i}: {added} for {found}"));
        }
        rays.finish(STRAYS);
        light.finish(STRAYS);
        aimed.len()
    }
}
