//! Points lit in batches, each one view of the device, pass by pass.

use std::sync::Arc;

use super::Light;
use super::compute::Radiosity;
use crate::bake::blocks::{ENTRIES, slot, view_size};
use crate::error::Result;
use crate::output::Layers;
use crate::standalone::Renderer;
use crate::view::{Atlas, Texel};

/// Points under way. The passes of all batches have the same virtual lights.
pub(super) struct Batches {
    points: Vec<Texel>,
    passes: u32,
    /// Light of the batches that are done.
    found: Vec<Light>,
    /// The present batch: how many points it has, and the entry of each; empty before it is begun.
    slots: Vec<usize>,
    /// Of the present batch, or of the one before.
    renderer: Option<Renderer>,
}

impl Batches {
    /// Points to be lit by `passes` passes, at least one.
    pub fn new(points: Vec<Texel>, passes: u32) -> Batches {
        Batches { points, passes: passes.max(1), found: Vec::new(), slots: Vec::new(), renderer: None }
    }

    /// Other points, after all are done: scene and kernels stay on the device.
    pub fn restart(&mut self, points: Vec<Texel>) {
        self.points = points;
        self.found.clear();
        self.slots.clear();
    }

    /// The points.
    pub fn points(&self) -> &[Texel] {
        &self.points
    }

    /// Whether all have their light.
    pub fn are_done(&self) -> bool {
        self.found.len() == self.points.len()
    }

    /// Share that is done, in [0, 1].
    pub fn share(&self) -> f64 {
        let present = self.slots.len() as f64 * f64::from(self.begun()) / f64::from(self.passes);
        (self.found.len() as f64 + present) / self.points.len().max(1) as f64
    }

    /// Passes of the present batch.
    pub fn begun(&self) -> u32 {
        self.renderer.as_ref().filter(|_| !self.slots.is_empty()).map_or(0, Renderer::passes)
    }

    /// Makes the view of the next batch unless there is one. Does nothing if all are done.
    pub fn prepare(&mut self, of: &Radiosity) -> Result<()> {
        if !self.slots.is_empty() || self.are_done() {
            return Ok(());
        }
        let rest = &self.points[self.found.len()..];
        let (atlas, slots) = view(&rest[..rest.len().min(of.batch_points())]);
        match &mut self.renderer {
            Some(renderer) => renderer.set_atlas(Arc::new(atlas))?,
            none => *none = Some(of.renderer_of(Arc::new(atlas))?),
        }
        self.slots = slots;
        Ok(())
    }

    /// Renders a pass of the present batch. False: `stop` broke it off, or all are done.
    pub fn pass(&mut self, of: &Radiosity, stop: &dyn Fn() -> bool) -> Result<bool> {
        self.prepare(of)?;
        let Some(renderer) = self.renderer.as_mut().filter(|_| !self.slots.is_empty()) else { return Ok(false) };
        if !renderer.pass_unless(stop)? {
            return Ok(false);
        }
        if renderer.passes() >= self.passes {
            let light = light(&self.slots, &renderer.layers()?);
            self.found.extend(light);
            self.slots.clear();
        }
        Ok(true)
    }

    /// The light of all points, after fewer passes if there is one batch only and it has any; `None`: there is more to do.
    pub fn light(&self) -> Result<Option<Vec<Light>>> {
        if self.are_done() {
            return Ok(Some(self.found.clone()));
        }
        match &self.renderer {
            Some(renderer) if self.have_light() => Ok(Some(light(&self.slots, &renderer.layers()?))),
            _ => Ok(None),
        }
    }

    /// Whether [`Batches::light`] has some.
    pub fn have_light(&self) -> bool {
        self.are_done() || self.slots.len() == self.points.len() && self.begun() > 0
    }

    /// The finished work: light of earlier batches, passes and state of the present one.
    pub fn state(&self) -> Result<(&[Light], u32, Vec<u8>)> {
        match &self.renderer {
            Some(renderer) if self.begun() > 0 => Ok((&self.found, renderer.passes(), renderer.save_state()?)),
            _ => Ok((&self.found, 0, Vec::new())),
        }
    }

    /// Goes on from [`Batches::state`] of the same points; false: there are fewer points.
    pub fn go_on(&mut self, of: &Radiosity, found: Vec<Light>, passes: u32, state: &[u8]) -> Result<bool> {
        if found.len() > self.points.len() {
            return Ok(false);
        }
        self.found = found;
        if passes > 0 {
            self.prepare(of)?;
            let Some(renderer) = self.renderer.as_mut().filter(|_| !self.slots.is_empty()) else { return Ok(false) };
            renderer.load_state(passes, state)?;
        }
        Ok(true)
    }
}

/// Light at the entries of points.
pub(super) fn light(slots: &[usize], layers: &Layers) -> Vec<Light> {
    slots.iter().map(|&i| Light { direct: layers.direct[i], indirect: layers.indirect[i] }).collect()
}

/// A view of points, in blocks, and the entry of each point.
pub(super) fn view(points: &[Texel]) -> (Atlas, Vec<usize>) {
    let size = view_size(points.len().div_ceil(ENTRIES));
    let places: Vec<usize> = (0..points.len()).map(|i| slot(i / ENTRIES, i % ENTRIES, size[0])).collect();
    let mut texels = vec![None; (size[0] * size[1]) as usize];
    places.iter().zip(points).for_each(|(&place, point)| texels[place] = Some(*point));
    (Atlas::new(size, texels), places)
}

/// Most points of a batch: whole blocks.
pub(super) fn whole_blocks(texels: usize) -> usize {
    (texels / ENTRIES).max(1) * ENTRIES
}
