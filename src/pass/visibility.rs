//! Counts the lights that each point sees: the kernels of [`shade`](super::shade) with only their shadow rays.
//!
//! For a point at x with normal n and lights at y_j:
//!
//! ```text
//! visible(x) = sum over j of [n . (y_j - x) > 0] V(x, y_j)
//! ```
//!
//! An area light is a parallelogram with corner c and edges e1, e2. Point number i of the workload, at x, sends one ray
//! to each of them, to the position
//!
//! ```text
//! y_j(i) = c_j + u e1_j + v e2_j,   (u, v) = (frac(s_i + j / g), frac(t_i + j / g^2)),   g^3 = g + 1
//! ```
//!
//! of the R2 sequence (Roberts 2018) over the lights, rotated by the hashes s_i and t_i of i. It is computed in
//! integers, so that kernels and oracle trace the same segments. The rays of a cluster then have no common origin:
//! `shade_cluster.wgsl` with AREA takes the light's centre as origin, and each ray starts at an offset q from it. The
//! shaft extends from the box of the light's positions to that of the points; a child's box is moved by -q for each
//! ray; a triangle's edge planes are affine in q, so they are set up once, through the centre, and each ray adds the
//! term of its moment q x d:
//!
//! ```text
//! ((v1 - v2) x (b - q + c - q)) . d = ((v1 - v2) x (b + c)) . d - 2 (v1 - v2) . (q x d)
//! ```
//!
//! The frame does not use this pass. It measures the cost of traversal alone, and the tests compare it with the oracle
//! ray by ray. Cost: that of `shade` without its arithmetic for each visible pair; with area lights more children and
//! triangles in wider shafts, and twice the arithmetic for a triangle and a ray (`docs/benchmarks.md`).

use glam::Vec3;
use rayon::prelude::*;

use super::layout::{DispatchCounts, FrameParameters, PointLight};
use super::shade::{Chunk, ShadowRays};
use super::{Kit, List, TraversalKernels};
use crate::accel::{Bvh, Ray};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::{Buffer, Context, Memory, Recorder, Resources, Staging};
use crate::plan::StepTable;
use crate::sampling::random::hash;
use crate::settings::{Settings, Traversal};

/// Steps of the R2 sequence, 1 / g and 1 / g^2 with g^3 = g + 1, in units of 2^-32.
const R2: [u32; 2] = [0xc13f_a9a9, 0x91e1_0da5];

/// Points and lights with shadow rays between them.
#[derive(Clone, Debug, Default)]
pub struct Workload {
    /// Points, offset from their surfaces, in the order of their clusters.
    pub receivers: Vec<Vec3>,
    /// Their normals.
    pub normals: Vec<Vec3>,
    /// Point lights, or corners of area lights.
    pub lights: Vec<Vec3>,
    /// The two edges of each area light, from its corner; empty: all lights are point lights.
    pub edges: Vec<[Vec3; 2]>,
}

impl Workload {
    /// Whether the lights are area lights.
    pub fn has_areas(&self) -> bool {
        !self.edges.is_empty()
    }

    /// The kernels that trace the workload.
    pub fn kernels(&self, context: &Context, traversal: Traversal) -> Result<TraversalKernels> {
        TraversalKernels::visibility(context, traversal, self.has_areas())
    }

    /// The kernels that trace the workload and count the nodes and triangles that clusters visit.
    pub fn counting_kernels(&self, context: &Context) -> Result<TraversalKernels> {
        TraversalKernels::counters(context, self.has_areas())
    }

    /// The edges of light j.
    fn edges_of(&self, j: usize) -> [Vec3; 2] {
        self.edges.get(j).copied().unwrap_or_default()
    }

    /// The target of the ray from point i to light j.
    pub fn point(&self, i: usize, j: usize) -> Vec3 {
        if !self.has_areas() {
            return self.lights[j];
        }
        let [e1, e2] = self.edges_of(j);
        let turn = hash(i as u32);
        // Fractions in units of 2^-32, where overflow wraps; 24 of the bits make a float.
        let of = |turn: u32, step: u32| (turn.wrapping_add((j as u32).wrapping_mul(step)) >> 8) as f32 / 16_777_216.0;
        self.lights[j] + (e1 * of(turn, R2[0]) + e2 * of(hash(turn), R2[1]))
    }

    /// Whether the target on light j is above the horizon of point i.
    pub fn faces(&self, i: usize, j: usize) -> bool {
        (self.point(i, j) - self.receivers[i]).dot(self.normals[i]) > 0.0
    }

    /// Number of pairs that face each other.
    pub fn segments(&self) -> u64 {
        let of = |i: usize| (0..self.lights.len()).filter(|&j| self.faces(i, j)).count() as u64;
        (0..self.receivers.len()).into_par_iter().map(of).sum()
    }
}

/// The pass over one workload.
pub struct Visibility {
    rays: ShadowRays,
    chunks: Vec<Chunk>,
    work_at_start: Buffer,
    /// Number of lights that each point sees.
    pub visible: Buffer,
    /// `[0]`: rays lost.
    pub status: Buffer,
    /// A [`DispatchCounts`]: number of culled pairs.
    pub work: Buffer,
    /// Statistics of the clusters, if the kernels count; see [`Counts`].
    pub counters: Buffer,
}

/// Inputs and options.
pub struct Inputs<'a> {
    /// The kernels that trace, see [`Workload::kernels`].
    pub kernels: TraversalKernels,
    /// The scene on the device.
    pub scene: &'a DeviceScene,
    /// Rounds, budget and lights of each dispatch.
    pub settings: &'a Settings,
    /// The rays.
    pub workload: &'a Workload,
}

/// Statistics of the clusters of a workload.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Pairs of a cluster and a light that were traced.
    pub pairs: u32,
    /// Rays of these pairs.
    pub rays: u32,
    /// Nodes whose children were tested.
    pub nodes: u32,
    /// Children in the shaft, tested against the rays.
    pub children: u32,
    /// Leaves whose triangles were tested.
    pub leaves: u32,
    /// Triangles in the shaft, tested against the rays.
    pub triangles: u32,
}

impl Counts {
    /// Number of words in [`Visibility::counters`].
    pub const LENGTH: usize = 6;

    /// From the words that the device counted.
    pub fn new([pairs, rays, nodes, children, leaves, triangles]: [u32; Counts::LENGTH]) -> Counts {
        Counts { pairs, rays, nodes, children, leaves, triangles }
    }
}

impl Visibility {
    /// Creates the pass and stages the workload.
    pub fn new(context: &Context, staging: &mut Staging, inputs: &Inputs) -> Result<Visibility> {
        let Inputs { kernels, scene, settings, workload } = *inputs;
        let count = workload.receivers.len() as u32;
        let vec4s = |v: &[Vec3]| v.iter().map(|v| v.extend(0.0).to_array()).collect::<Vec<_>>();
        let record = |j: usize| {
            let [wi, flux] = workload.edges_of(j).map(|edge| edge.extend(0.0).to_array());
            PointLight { position: workload.lights[j].extend(0.0).to_array(), wi, flux, ..PointLight::default() }
        };
        let records: Vec<_> = (0..workload.lights.len()).map(record).collect();
        let list: Vec<u32> = (0..count).collect();
        let groups = count.div_ceil(64);
        let x = groups.min(32_768);
        let list_groups = [x, groups.div_ceil(x.max(1)), 1, 0];
        let once_if_live = [count.min(1), 1, 1, 0];
        let work = DispatchCounts { live: count, list_groups, once_if_live, ..DispatchCounts::default() };
        let frame = FrameParameters { scene: [scene.bvh.node_count(), 0, 0, 0], ..FrameParameters::default() };

        let mut table = StepTable::default();
        let lights = workload.lights.len() as u32;
        let ray_clusters = Chunk::clusters(settings, scene.clusters(context).filter(|_| kernels.cluster.is_some()));
        let size = Chunk::size(settings, ray_clusters.is_some());
        let chunks = (0..lights.div_ceil(size))
            .map(|i| Chunk::new(&mut table, settings, (i * size, lights.min((i + 1) * size)), ray_clusters, false))
            .collect();
        let frame = staging.stage(context, "visibility frame", &[frame])?;
        let status = Buffer::new(context, "visibility status", 16, Memory::Device)?;
        let own = Resources::of([("frame", &frame), ("status", &status)]);
        let kit = Kit::new(context, staging, scene, settings.traversal, &own);
        let steps = Resources::of([("steps", &kit.stage("visibility steps", &table.steps)?)]);
        let visible = kit.array("visible lights", count, 4)?;
        let progress = kit.array("visibility progress", count, 8)?;
        let counters = kit.array("visibility counters", Counts::LENGTH as u32, 4)?;
        let list = List { entries: kit.stage("visibility list", &list)?, work: kit.stage("visibility work", &[work])? };
        let set = Resources::of([
            ("point_position", &kit.stage("visibility receivers", &vec4s(&workload.receivers))?),
            ("point_geometric", &kit.stage("visibility normals", &vec4s(&workload.normals))?),
            ("lights", &kit.stage("visibility lights", &records)?),
            ("visible", &visible),
            ("counters", &counters),
        ]);
        let nothing_more = Resources::new();
        let of_clusters = scene.wide_nodes.as_ref().map(|_| &nothing_more);
        let rays = ShadowRays::new(&kit, &kernels, &[&set], of_clusters, (&list, &progress), &steps)?;
        let work_at_start = kit.stage("visibility work at start", &[work])?;
        Ok(Visibility { rays, chunks, work_at_start, visible, status, work: list.work, counters })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        rec.fill(&self.status, 0)?;
        rec.fill(&self.counters, 0)?;
        rec.copy(&self.work_at_start, &self.work)?;
        self.rays.record(rec, &self.chunks)
    }
}

/// Oracle: the number of lights that each point sees, ray by ray.
pub fn reference(bvh: &Bvh, workload: &Workload) -> Vec<u32> {
    let sees = |i: usize, j: usize| {
        let origin = workload.receivers[i];
        let ray = Ray { origin, t_max: 1.0, direction: workload.point(i, j) - origin };
        workload.faces(i, j) && !bvh.occluded(&ray)
    };
    let count = |i: usize| (0..workload.lights.len()).filter(|&j| sees(i, j)).count() as u32;
    (0..workload.receivers.len()).into_par_iter().map(count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_spread_over_an_area_light() {
        let (corner, e1, e2) = (Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 0.0, 0.0), Vec3::new(0.0, 0.0, 2.0));
        let workload = Workload { lights: vec![corner; 64], edges: vec![[e1, e2]; 64], ..Workload::default() };
        // Over the lights of one point, and over the points of one light: every cell of four by four gets its share.
        for (receivers, lights, least) in [(7..8, 0..64, 2), (0..640, 5..6, 20)] {
            let mut cells = [0; 16];
            for (i, j) in receivers.flat_map(|i| lights.clone().map(move |j| (i, j))) {
                let p = (workload.point(i, j) - corner) / Vec3::new(4.0, 1.0, 2.0);
                assert!((0.0..1.0).contains(&p.x) && p.y == 0.0 && (0.0..1.0).contains(&p.z), "{p}");
                cells[(p.x * 4.0) as usize * 4 + (p.z * 4.0) as usize] += 1;
            }
            assert!(cells.iter().all(|&n| n >= least), "{cells:?}");
        }
        let points = Workload { edges: Vec::new(), ..workload };
        assert_eq!(points.point(3, 4), corner);
    }
}
