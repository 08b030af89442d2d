//! Hits become receivers: position, normals, textures, material, emission.
//!
//! What the eye sees, directly or by way of mirrors and glass (`eye_paths`), enters with its emission, the term L_e of Keller
//! 1997, eq. 1, times the throughput of that way. What a gather ray hits enters with the share 1 - d^2 / clip^2 that the
//! clipped lights leave open (Kollig and Keller 2004), emission included; mirrors enter with their diffuse base alone, and
//! glass is black.
//! Receivers that can send light to the eye are put on a list; its order is not fixed, but nothing depends on it.
//!
//! A glossy plane that mirrors the room (see `mirror_image`) and is seen directly is a receiver without a lobe.
//!
//! Normals face the side that the ray came from, since surfaces reflect on both; a shading normal that the ray sees from
//! behind gives way to the geometric one. Emission is one-sided unless the material says otherwise.
//!
//! Cost: 112 bytes read and 128 written for a hit, some 150 operations, and 4 texels for each texture.

use glam::{Vec2, Vec3};

use super::{BoundKernel, EyePathState, Kit, List, Rays, ShadingPoints, push};
use crate::accel::{Bvh, Hit};
use crate::bsdf::{Finish, Reflectance};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::scene::Scene;

use super::schedule::LIST_GROUPS;

/// The pass for one bounce.
pub struct ReceiversPass {
    kernel: BoundKernel,
    work_in: Buffer,
}

/// What the pass reads and writes.
pub struct Inputs<'a> {
    /// Traced rays.
    pub rays: &'a Rays,
    /// Rays to take, for bounces after the first; for the second components of the eye's paths, their tiles.
    pub list_in: &'a List,
    /// Receivers found.
    pub list_out: &'a List,
    /// Throughput along the gather path; w: eye's first lobe.
    pub beta: &'a Buffer,
    /// Throughput along the eye's path.
    pub paths: &'a EyePathState,
    /// Output.
    pub points: &'a ShadingPoints,
}

impl ReceiversPass {
    /// Writes `points`, `beta` and `list_out` from `rays`, and the depth of eye paths.
    pub fn new(kit: &Kit, inputs: &Inputs, steps: &Resources) -> Result<Self> {
        let Inputs { rays, list_in, list_out, beta, paths, points } = *inputs;
        let beta = Resources::of([("beta", beta)]);
        let (rays, paths, points) = (rays.resources(), paths.resources(), points.resources());
        let sets = [&rays, &list_in.as_input(), &list_out.as_output(), &beta, &paths, &points, steps];
        let shaders = [&shaders::RECEIVERS, &shaders::RECEIVERS_UNTEXTURED];
        Ok(ReceiversPass { kernel: kit.bind_surface(shaders, &sets)?, work_in: list_in.work.clone() })
    }

    /// Records the pass over all tiles of 8 x 8 pixels; `None`: over the rays, or tiles, of the list.
    pub fn record(&self, rec: &mut Recorder, step: u32, tiles: Option<u64>) -> Result<()> {
        match tiles {
            Some(tiles) => self.kernel.run(rec, &push(step), tiles),
            None => self.kernel.run_listed(rec, &push(step), &self.work_in, LIST_GROUPS),
        }
    }
}

/// What a hit point is made of, seen along the ray.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Position.
    pub position: Vec3,
    /// Geometric normal, on the viewer's side.
    pub geometric: Vec3,
    /// Shading normal, likewise.
    pub shading: Vec3,
    /// Radiance emitted back along the ray.
    pub emission: Vec3,
    /// Reflectance; of mirrors the diffuse base, of glass zero.
    pub reflectance: Reflectance,
    /// The same with what is ideal.
    pub finish: Finish,
    /// Seen from its front.
    pub front: bool,
    /// Index of its material.
    pub material: u32,
}

/// Oracle: the surface at a hit of a ray in direction `d`.
pub fn surface_at(scene: &Scene, bvh: &Bvh, hit: &Hit, d: Vec3) -> SurfacePoint {
    let triangle = &scene.triangles[bvh.scene_triangle(hit.triangle) as usize];
    let face = bvh.normal(hit.triangle);
    let front = face.dot(d) < 0.0;
    let geometric = if front { face } else { -face };
    let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
    let corner = |k: usize| triangle.vertices[k] as usize;
    let mut shading = geometric;
    if triangle.smooth {
        let n = (0..3).map(|k| scene.normals[corner(k)] * weights[k]).sum::<Vec3>().normalize_or(geometric);
        let n = if n.dot(geometric) >= 0.0 { n } else { -n };
        shading = if n.dot(d) < 0.0 { n } else { geometric };
    }
    let material = &scene.materials[triangle.material as usize];
    let uv = (0..3).map(|k| scene.uvs.get(corner(k)).map_or(Vec2::ZERO, |uv| *uv) * weights[k]).sum::<Vec2>();
    let finish = Finish::at(scene, material, uv.to_array());
    let emission = if front || material.two_sided { material.emission } else { Vec3::ZERO };
    let reflectance = finish.reflectance;
    let material = triangle.material;
    SurfacePoint { position: bvh.position(hit), geometric, shading, emission, reflectance, finish, front, material }
}
