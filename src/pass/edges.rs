//! Antialiased edges: more eye rays where surfaces or albedos change, lit by the pixels nearby that show what they meet.
//!
//! A pixel is at an edge if the first hit of its eye ray and that of one of four neighbours do not lie on one surface
//! ([`same_surface`]), or their albedos differ by a fifth. A tile of 8 x 8 pixels has up to 64 rays for those at its edges, at most
//! [`MAX_RAYS`] for each, which are traced together as eye rays are. In the first [`FULL_PASSES`] passes a second round of up to 64 rays follows, for those of its pixels where surfaces
//! differ, up to [`MAX_RAYS`] for each with those of the first: tiles of thin things have edges at all pixels. A ray takes the radiance L of the nearest of 3 x 3 pixels that shows its
//! surface, with an albedo of its own where the pixel shows its first hit:
//!
//! ```text
//! L_ray = L + throughput (kd_ray - kd) / pi (E_direct + E_indirect)
//! ```
//!
//! So it casts no shadow rays. Where no pixel nearby shows the surface, an emitter shows its emission, and a diffuse surface takes E of the pixel x whose
//! first hit is diffuse and the nearest to that of the ray in space, y, with normals n,
//!
//! ```text
//! L_ray = kd_ray / pi (E_direct + E_indirect)        least |x - y|^2 (1 + TURNED (1 - n_x . n_y))
//! ```
//!
//! Other rays are left out. Were these, too, frames of windows would take the light of the window from the rays that are left. With the pixel's own
//! radiance L_0 and the weight w of the pass, 1 in the first [`FULL_PASSES`] and FULL_PASSES / (number of the pass) after them,
//!
//! ```text
//! L_0 += w (mean of L_0 and the rays' L - L_0)
//! ```
//!
//! and coverage likewise. The layers of irradiance, albedo, normals and depth keep one ray.
//!
//! In flat mirrors without a diffuse base edges are those of the mirror image: a ray that meets one goes on once, and shows
//! both hits ([`Shown`]). Edges that curved mirrors, glass and lobes show are not found, but for those of lamps, by [`lamp_edges`](super::lamp_edges); the outlines of mirrors and glass are. Bias: irradiance at edges is that of a point up to a pixel away; and what is narrower than a pixel gives its pixel too little of
//! its light, or too much if it is dark, since the pixel has rays where its own meets it, and where that misses it nothing tells of it.
//! Both vanish as w does: the mean of N passes has at most (1 + ln(N / F)) F / N of them, F = FULL_PASSES, and eye rays through other points
//! of the pixel in each pass show edges then.
//!
//! Cost of a pixel: 5 first hits, 5 x 30 operations; of a pixel at an edge 1 to 8 rays, each with a surface and 9 first hits, 9 more where none shows its surface; 16 bytes for the
//! light of the first round. In a scene with mirrors 20 bytes a pixel more, and a second ray for each that meets one.

use glam::{Vec2, Vec3, Vec4};

use super::layout::FrameParameters;
use super::{BoundKernel, EyePathState, Kit, Lighting, List, Rays, ShadingPoints, accumulate, groups, push};
use crate::accel::{Bvh, Hit};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::pass::schedule::LIST_GROUPS;
use crate::scene::{Scene, Surface};

/// Maximum number of rays of a pixel.
pub const MAX_RAYS: u32 = 8;

/// Rounds of rays: a tile has room for as many rays at a time as it has pixels.
pub const ROUNDS: u32 = 2;

/// Passes in which the rays count in full.
pub const FULL_PASSES: u32 = 4;

/// Relative difference of squared distances, for each place in the order of 3 x 3, up to which pixels count as equally near to a parallel ray:
/// the first counts.
pub const TIE: f32 = 1e-4;

/// Weight of the angle between normals beside the distance, where a pixel lends its irradiance to a surface that none shows. Higher: from surfaces that
/// face as it does, even if they are farther away.
pub const TURNED: f32 = 8.0;

/// In [`EdgeGuides::second_hits`] and [`Mirrors::hits`] in place of a triangle: no reflection in a flat mirror.
pub const NO_MIRROR: u32 = u32::MAX - 1;

/// Keeps the first hits of eye rays: triangle (all ones: none) and bits of t.
pub struct EdgeGuides {
    /// Of each pixel.
    pub first_hits: Buffer,
    /// Of each pixel that shows a flat mirror, what its ray meets after that, else [`NO_MIRROR`]; `None`: the scene has no mirrors.
    pub second_hits: Option<Buffer>,
    first: BoundKernel,
    second: Option<BoundKernel>,
    pixels: u32,
}

impl EdgeGuides {
    /// Reads `rays.hits` of so many pixels.
    pub fn new(kit: &Kit, rays: &Rays, pixels: u32, mirrors: bool) -> Result<Self> {
        let first_hits = kit.array("first hits", pixels, 8)?;
        let second_hits = if mirrors { Some(kit.array("second hits", pixels, 8)?) } else { None };
        let (rays, firsts) = (rays.resources(), Resources::of([("first_hits", &first_hits)]));
        let second = match &second_hits {
            Some(hits) => {
                let sets = [&rays, &firsts, &Resources::of([("second_hits", hits)])];
                Some(kit.bind(&shaders::EDGES_GUIDE_MIRRORS, &sets)?)
            }
            None => None,
        };
        let first = kit.bind(&shaders::EDGES_GUIDE, &[&rays, &firsts])?;
        Ok(EdgeGuides { first_hits, second_hits, first, second, pixels })
    }

    /// Records the part after the first hits of the eye's paths.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.first.run(rec, &[], groups(self.pixels))
    }

    /// Records the part after their last hits.
    pub fn record_mirrors(&self, rec: &mut Recorder) -> Result<()> {
        self.second.as_ref().map_or(Ok(()), |kernel| kernel.run(rec, &[], groups(self.pixels)))
    }
}

/// Rays at edges that flat mirrors reflect.
pub struct Mirrors {
    /// Of each ray: triangle of the mirror that it met, or [`NO_MIRROR`], and bits of t.
    pub hits: Buffer,
    turn: BoundKernel,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// First hits.
    pub guides: &'a EdgeGuides,
    /// Visible shading points; their emission receives the result.
    pub points: &'a ShadingPoints,
    /// Throughput of the eye's paths.
    pub paths: &'a EyePathState,
    /// Light at the points.
    pub lighting: &'a Lighting,
    /// Room for the rays.
    pub rays: &'a Rays,
    /// The rays.
    pub list: &'a List,
    /// Receives the rays that mirrors reflect, if there are mirrors.
    pub reflected: Option<&'a List>,
    /// Receives what the rays add, see [`gain`](super::gain).
    pub path_gain: Option<&'a Buffer>,
}

/// The pass.
pub struct Edges {
    /// Of each pixel: 0, or its [`word`].
    pub edges: Buffer,
    /// Rays of each tile; their slots are those of the tile's pixels, row by row.
    pub marks: Buffer,
    /// Pixel of each ray.
    pub ray_pixel: Buffer,
    /// Light along each ray; w: 0 unknown, 1 a miss, 2 a hit.
    pub ray_light: Buffer,
    /// `None`: the scene has no mirrors.
    pub mirrors: Option<Mirrors>,
    mark: BoundKernel,
    rays: BoundKernel,
    light: BoundKernel,
    add: BoundKernel,
    work: Buffer,
    pixels: u32,
    /// Tiles of 8 x 8 pixels.
    pub tile_count: u32,
}

impl Edges {
    /// For an image of this width and height.
    pub fn new(kit: &Kit, inputs: &Inputs, [width, height]: [u32; 2]) -> Result<Self> {
        let (pixels, tile_count) = (width * height, width.div_ceil(8) * height.div_ceil(8));
        let edges = kit.array("edges", pixels, 4)?;
        let sums = kit.vec4s("light of rays at edges before", pixels)?;
        let marks = kit.array("rays of tiles", tile_count, 4)?;
        let ray_pixel = kit.array("pixels of edge rays", pixels, 4)?;
        let ray_light = kit.vec4s("light of edge rays", pixels)?;
        let own = Resources::of([
            ("edges", &edges),
            ("marks", &marks),
            ("edge_sums", &sums),
            ("ray_pixel", &ray_pixel),
            ("ray_light", &ray_light),
            ("first_hits", &inputs.guides.first_hits),
        ]);
        let (points, paths, lighting) = (inputs.points, inputs.paths, inputs.lighting);
        let lit = points.resources().and(&paths.resources()).and(&lighting.resources());
        let (rays, list) = (inputs.rays.resources(), inputs.list);
        let (mut mark, mut light) = (
            [&shaders::EDGES_MARK, &shaders::EDGES_MARK_UNTEXTURED],
            [&shaders::EDGES_LIGHT, &shaders::EDGES_LIGHT_UNTEXTURED],
        );
        let mut of_mirrors = Resources::default();
        let mut mirrors = None;
        if let (Some(second_hits), Some(reflected)) = (&inputs.guides.second_hits, inputs.reflected) {
            mark = [&shaders::EDGES_MARK_MIRRORS, &shaders::EDGES_MARK_MIRRORS_UNTEXTURED];
            light = [&shaders::EDGES_LIGHT_MIRRORS, &shaders::EDGES_LIGHT_MIRRORS_UNTEXTURED];
            let hits = kit.array("mirrors of edge rays", pixels, 8)?;
            of_mirrors = Resources::of([("second_hits", second_hits), ("mirror_hits", &hits)]);
            let sets = [&rays, &list.resources(), &reflected.as_output(), &of_mirrors];
            mirrors = Some(Mirrors { turn: kit.bind(&shaders::EDGES_TURN, &sets)?, hits });
        }
        Ok(Edges {
            mark: kit.bind_surface(mark, &[&own, &lit, &of_mirrors])?,
            rays: kit.bind(&shaders::EDGES_RAYS, &[&own, &rays, &list.as_output()])?,
            light: kit.bind_surface(light, &[&own, &lit, &rays, &list.resources(), &of_mirrors])?,
            mirrors,
            add: match inputs.path_gain {
                None => kit.bind(&shaders::EDGES_ADD, &[&own, &lit])?,
                Some(path_gain) => {
                    let path_gain = Resources::of([("path_gain", path_gain)]);
                    kit.bind(&shaders::EDGES_ADD_GAIN, &[&own, &lit, &path_gain])?
                }
            },
            work: list.work.clone(),
            edges,
            marks,
            ray_pixel,
            ray_light,
            pixels,
            tile_count,
        })
    }

    /// Records the part that finds edges.
    pub fn record_mark(&self, rec: &mut Recorder) -> Result<()> {
        self.mark.run(rec, &[], groups(self.pixels))
    }

    /// Records the part that starts the rays of a round there.
    pub fn record_rays(&self, rec: &mut Recorder, round: u32) -> Result<()> {
        self.rays.run(rec, &push(round), groups(self.tile_count))
    }

    /// Records the part that reflects traced rays where they met mirrors.
    pub fn record_turn(&self, rec: &mut Recorder) -> Result<()> {
        self.mirrors.as_ref().map_or(Ok(()), |mirrors| mirrors.turn.run_listed(rec, &[], &self.work, LIST_GROUPS))
    }

    /// Records the part that lights traced rays and adds their light to the image.
    pub fn record_light(&self, rec: &mut Recorder, round: u32) -> Result<()> {
        self.light.run_listed(rec, &push(round), &self.work, LIST_GROUPS)?;
        self.add.run(rec, &push(round), groups(self.pixels))
    }
}

/// Oracle: the first hit of an eye ray.
#[derive(Clone, Copy, Debug)]
pub struct FirstHit {
    /// Its triangle.
    pub triangle: u32,
    /// The triangle's material.
    pub material: u32,
    /// Seen from the front.
    pub front: bool,
    /// Geometric normal towards the eye.
    pub normal: Vec3,
    /// Position from the eye.
    pub position: Vec3,
    /// Distance.
    pub t: f32,
}

impl FirstHit {
    /// Of a ray in direction `d` that starts at `start`, relative to the eye.
    pub fn new(scene: &Scene, bvh: &Bvh, hit: &Hit, [start, d]: [Vec3; 2]) -> FirstHit {
        let face = bvh.normal(hit.triangle);
        let front = face.dot(d) < 0.0;
        let material = scene.triangles[bvh.scene_triangle(hit.triangle) as usize].material;
        let normal = if front { face } else { -face };
        FirstHit { triangle: hit.triangle, material, front, normal, position: start + hit.t * d, t: hit.t }
    }
}

/// Oracle: whether first hits lie on one surface; `None`: the ray met nothing.
pub fn same_surface(frame: &FrameParameters, a: Option<&FirstHit>, b: Option<&FirstHit>) -> bool {
    let (Some(a), Some(b)) = (a, b) else { return a.is_none() && b.is_none() };
    let [x, y, z, _] = frame.up;
    let tolerance = 2.0 * Vec3::new(x, y, z).length() / frame.within[3] as f32 * frame.depth_scale(a.t.max(b.t));
    let between = b.position - a.position;
    let near = [a.normal, b.normal].iter().all(|n| n.dot(between).abs() <= tolerance);
    a.triangle == b.triangle
        || (a.material == b.material && a.front == b.front && a.normal.dot(b.normal) > 0.95 && near)
}

/// Oracle: what an eye ray shows: its first hit, and behind a flat mirror the next one, its position and t those of both segments. `None`
/// inside: the ray met nothing.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// The first hit.
    pub first: Option<FirstHit>,
    /// The hit after a flat mirror; `None`: the first hit is none.
    pub second: Option<Option<FirstHit>>,
}

impl Shown {
    /// A hit `met` after the reflection of a ray in direction `d` by a flat mirror.
    pub fn mirrored(scene: &Scene, bvh: &Bvh, mirror: FirstHit, d: Vec3, met: Option<&Hit>) -> Shown {
        let beyond = |hit: &Hit| {
            let own = FirstHit::new(scene, bvh, hit, [mirror.position, d.reflect(mirror.normal)]);
            FirstHit { t: mirror.t + own.t, ..own }
        };
        Shown { first: Some(mirror), second: Some(met.map(beyond)) }
    }
}

/// Oracle: whether a triangle is of a flat mirror without a diffuse base.
pub fn is_plain_mirror(scene: &Scene, bvh: &Bvh, triangle: u32) -> bool {
    let triangle = &scene.triangles[bvh.scene_triangle(triangle) as usize];
    let material = &scene.materials[triangle.material as usize];
    !triangle.smooth && material.surface == Surface::Mirror && material.base_color == Vec3::ZERO
}

/// Oracle: whether two rays show one surface, in mirrors too.
pub fn same_shown(frame: &FrameParameters, a: &Shown, b: &Shown) -> bool {
    let second = match (&a.second, &b.second) {
        (Some(a), Some(b)) => same_surface(frame, a.as_ref(), b.as_ref()),
        (a, b) => a.is_none() && b.is_none(),
    };
    second && same_surface(frame, a.first.as_ref(), b.first.as_ref())
}

/// Oracle: whether the albedos that two pixels show differ; zero where the eye's path goes on.
pub fn albedos_differ(a: Vec3, b: Vec3) -> bool {
    (a - b).abs().cmpgt(0.1 * (a + b)).any()
}

/// Oracle: rays in each round of a pixel of a tile of `pixels` pixels, of which so many are at edges, and so many at edges of surfaces.
pub fn rays_of(
    frame: &FrameParameters,
    [marked, of_surfaces]: [u32; 2],
    pixels: u32,
    is_of_surfaces: bool,
) -> [u32; 2] {
    let first = (pixels / marked.max(1)).min(MAX_RAYS);
    let second = (pixels / of_surfaces.max(1)).min(MAX_RAYS - first);
    [first, if is_of_surfaces && weight_in_pass(frame) == 1.0 { second } else { 0 }]
}

/// Oracle: word of a pixel in [`Edges::edges`], from its rays in each round, the place of its first ray, and how many of its rays of the
/// rounds before have known light.
pub fn word([first, second]: [u32; 2], place: u32, known: u32) -> u32 {
    first | (place << 4) | ((1 + known) << 10) | (second << 15)
}

/// Oracle: offset of ray k of a round of a pixel that has so many in each.
pub fn offset_in_round(frame: &FrameParameters, [round, k]: [u32; 2], [first, second]: [u32; 2]) -> Vec2 {
    ray_offset(frame, round * first + k, first + second)
}

/// Oracle: weight of the rays in a pass.
pub fn weight_in_pass(frame: &FrameParameters) -> f32 {
    (FULL_PASSES as f32 * frame.shift[3]).min(1.0)
}

/// Oracle: offset of ray k of `each` rays of a pixel (with its own ray's a golden lattice).
pub fn ray_offset(frame: &FrameParameters, k: u32, each: u32) -> Vec2 {
    let own = Vec2::new(frame.pixel_offset[0], frame.pixel_offset[1]);
    (own + (k + 1) as f32 * Vec2::new(1.0 / (each + 1) as f32, 0.618_034)).fract()
}

/// A pixel near a ray, for the oracle.
#[derive(Clone, Copy, Debug)]
pub struct Nearby {
    /// Origin of its eye ray, relative to the eye, and direction.
    pub ray: [Vec3; 2],
    /// The surfaces that it shows.
    pub shown: Shown,
    /// Whether its shading point is the last of these hits.
    pub is_last: bool,
    /// Emission, throughput and albedo.
    pub point: [Vec3; 3],
    /// Direct and indirect irradiance, radiance by the specular lobe; zero if it is not lit.
    pub sums: [Vec3; 3],
}

/// Oracle: light along an eye ray (origin relative to the eye, and direction) that shows `own`, its last hit of this albedo and emission, and
/// whether it is opaque; `None`: unknown.
pub fn reference(
    frame: &FrameParameters,
    (ray, own): ([Vec3; 2], &Shown),
    ([kd, emission], opaque): ([Vec3; 2], bool),
    nearby: &[Nearby],
) -> Option<Vec3> {
    let tie = if frame.is_orthographic() { TIE } else { 0.0 };
    let distance = |(i, pixel): &(usize, &Nearby)| {
        let between = pixel.ray[0].distance_squared(ray[0]) + pixel.ray[1].distance_squared(ray[1]);
        between * (1.0 + tie * *i as f32)
    };
    let shows = |(_, pixel): &(usize, &Nearby)| same_shown(frame, own, &pixel.shown);
    let nearest = nearby.iter().enumerate().filter(shows).min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let found = own.second.unwrap_or(own.first).is_some();
    let Some((_, nearest)) = nearest else {
        let first = own.first.filter(|_| own.second.is_none())?;
        if emission.element_sum() > 0.0 {
            return Some(emission);
        }
        let lender = lender(&first, nearby).filter(|_| opaque && kd.element_sum() > 0.0)?;
        return Some(accumulate::reference(Vec3::ZERO, Vec3::ONE, kd, [lender.sums[0], lender.sums[1], Vec3::ZERO]));
    };
    let [emitted, throughput, their_kd] = nearest.point;
    let kd = if nearest.is_last && found { kd } else { their_kd };
    Some(accumulate::reference(emitted, throughput, kd, nearest.sums).max(Vec3::ZERO))
}

/// Oracle: the pixel that lends its irradiance to a first hit.
fn lender<'a>(own: &FirstHit, nearby: &'a [Nearby]) -> Option<&'a Nearby> {
    let distance = |pixel: &Nearby| {
        let theirs = pixel.shown.first?;
        let facing = theirs.normal.dot(own.normal);
        let diffuse = pixel.is_last && pixel.shown.second.is_none() && pixel.point[2].element_sum() > 0.0;
        diffuse.then(|| theirs.position.distance_squared(own.position) * (1.0 + TURNED * (1.0 - facing)))
    };
    let nearer = |(at, a): (f32, &'a Nearby), (bt, b): (f32, &'a Nearby)| if bt < at { (bt, b) } else { (at, a) };
    nearby.iter().filter_map(|pixel| Some((distance(pixel)?, pixel))).reduce(nearer).map(|(_, pixel)| pixel)
}

/// Oracle: the image of a pixel and its coverage, of its own and of its rays' light; w: coverage.
pub fn mean(own: Vec4, rays: &[Vec4], weight: f32) -> Vec4 {
    let sum = own + rays.iter().sum::<Vec4>();
    own + weight * (sum / (1 + rays.len()) as f32 - own)
}
