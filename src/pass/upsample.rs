//! Lights each pixel by the lit points around it that show its surface, where a pass lights an image of half the width and height
//! ([`Settings::shading_rate`](crate::Settings)): a joint bilateral upsampling (Kopf et al. 2007) whose guide is the first hit itself.
//!
//! The pixel at x, whose own eye ray has found surface, normal and albedo, lies between four lit points at x_i. Those that show its surface
//! ([`same_surface`]) lend irradiance and the radiance of their lobes:
//!
//! ```text
//! L = L_e + kd / pi (E_direct + E_indirect) + L_s        E and L_s: means over the four with weights (1 - |x - x_i|)(1 - |y - y_i|)
//! ```
//!
//! [`upsample_paths`](super::upsample_paths) lights points that the pixel's own path meets after mirrors and glass. Where paths follow lobes, planes mirror the room, or one of two components is
//! chosen, they end at the first hit, and mirrors and glass take the whole radiance of lit points, so that what they show is blurred. Where none of the four shows the surface the nearest of
//! sixteen that does lends; a diffuse surface that none shows takes the irradiance of the lit point of them that is near in space and faces as it
//! does, as at [`edges`](super::edges); another surface takes the radiance of the nearest, of its material if one is. An emitter keeps its own
//! emission, and so does the environment.
//!
//! Differs from Kopf: weights are of the image alone and agreement is a test of surfaces, as in the filter before ([`discontinuity`](super::discontinuity)),
//! which has smoothed the irradiance already. Bias: irradiance is linear between lit points, two pixels apart; it stays in all passes.
//!
//! Cost of a pixel: 5 first hits and 4 lit points, 150 vec4 and 500 operations; 16 more of both where none of the four shows its surface.

use glam::Vec3;

use super::accumulate;
use super::edges::{EdgeGuides, FirstHit, TURNED, same_surface};
use super::layout::FrameParameters;
use super::{BoundKernel, EyePathState, Kit, Lighting, ShadingPoints, groups};
use crate::error::Result;
use crate::gpu::{Recorder, Resources, shaders};
use crate::settings::Settings;
use crate::stage::Seen;

/// Added to the squared distance of a lit point of another material, lit points.
pub const OTHER_MATERIAL: f32 = 100.0;

/// Least weight, of one, of the four lit points around a pixel that show its surface.
pub const LEAST_WEIGHT: f32 = 1e-6;
/// Pixels on each side of a square with one lit point.
const RATE: u32 = Settings::MAX_SHADING_RATE;

/// Points that are lit, in an image of half the width and height.
pub struct Lit<'a> {
    /// First hits.
    pub guides: &'a EdgeGuides,
    /// The points.
    pub points: &'a ShadingPoints,
    /// Throughput of the eye's paths.
    pub paths: &'a EyePathState,
    /// Their light.
    pub lighting: &'a Lighting,
}

/// The pass.
pub struct Upsample {
    kernel: BoundKernel,
    pixels: u32,
}

impl Upsample {
    /// Adds to the emission of what is `seen`, and writes its irradiance to `lighting`.
    pub fn new(kit: &Kit, lit: &Lit, seen: &Seen, lighting: &Lighting) -> Result<Self> {
        let (Seen { points, pixels, .. }, guides) = (*seen, seen.guides.unwrap_or(lit.guides));
        let own = Resources::of([
            ("lit_hits", &lit.guides.first_hits),
            ("first_hits", &guides.first_hits),
            ("pixel_kd", &points.kd),
            ("pixel_wo", &points.wo),
            ("pixel_emitted", &points.emitted),
            ("pixel_direct", &lighting.direct),
            ("pixel_indirect", &lighting.indirect),
            ("pixel_specular", &lighting.specular),
        ]);
        let sets = [&own, &lit.points.resources(), &lit.paths.resources(), &lit.lighting.resources()];
        Ok(Upsample { kernel: kit.bind(&shaders::UPSAMPLE, &sets)?, pixels })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.pixels))
    }
}

/// A lit point near a pixel, for the oracle.
#[derive(Clone, Copy, Debug)]
pub struct LitPoint {
    /// The first hit of its eye ray; `None`: it met nothing.
    pub shown: Option<FirstHit>,
    /// Whether the point is that hit.
    pub is_first: bool,
    /// Emission, throughput and albedo.
    pub point: [Vec3; 3],
    /// Direct and indirect irradiance, radiance by the specular lobe; zero if it is not lit.
    pub sums: [Vec3; 3],
}

/// The pixel that takes light, for the oracle.
#[derive(Clone, Copy, Debug)]
pub struct Pixel {
    /// Column and row.
    pub at: [u32; 2],
    /// The first hit of its eye ray.
    pub shown: FirstHit,
    /// Whether it reflects diffusely.
    pub diffuse: bool,
    /// Whether it emits.
    pub emits: bool,
}

/// Where a pixel lies among lit points, for the oracle.
pub struct Place {
    square: [i32; 2],
    place: [f32; 2],
    size: [u32; 2],
}

impl Place {
    /// For lit points of an image of this size.
    pub fn of(frame: &FrameParameters, at: [u32; 2], size: [u32; 2]) -> Place {
        let place = |k: usize| (at[k] % RATE) as f32 - frame.pixel_offset[k] * (RATE - 1) as f32;
        Place { square: at.map(|n| (n / RATE) as i32), place: [0, 1].map(|k| place(k) / RATE as f32), size }
    }

    fn around(&self, side: i32) -> impl Iterator<Item = [u32; 2]> {
        let corner = [0, 1].map(|k| self.square[k] + self.place[k].floor() as i32 - (side / 2 - 1));
        let last = self.size.map(|n| n as i32 - 1);
        let at = move |i: i32| [(corner[0] + i % side), (corner[1] + i / side)];
        (0..side * side).map(move |i| [0, 1].map(|k| at(i)[k].clamp(0, last[k]) as u32))
    }

    /// The four lit points around it with their weights.
    pub fn four(&self) -> impl Iterator<Item = ([u32; 2], f32)> {
        let between = self.place.map(|x| x - x.floor());
        let part = move |k: usize, beyond: bool| if beyond { between[k] } else { 1.0 - between[k] };
        self.around(2).enumerate().map(move |(i, at)| (at, part(0, i & 1 == 1) * part(1, i > 1)))
    }

    /// The sixteen around it.
    pub fn sixteen(&self) -> impl Iterator<Item = [u32; 2]> {
        self.around(4)
    }

    /// Squared distance from a lit point, lit points.
    pub fn distance2(&self, at: [u32; 2]) -> f32 {
        let [dx, dy] = [0, 1].map(|k| (at[k] as i32 - self.square[k]) as f32 - self.place[k]);
        dx * dx + dy * dy
    }
}

impl LitPoint {
    /// Direct and indirect irradiance that it lends, and radiance that does not depend on the pixel's albedo.
    fn lends(&self, emits: bool) -> [Vec3; 3] {
        let ([emitted, throughput, kd], [direct, indirect, specular]) = (self.point, self.sums);
        match (self.is_first, emits) {
            (false, _) => [Vec3::ZERO, Vec3::ZERO, accumulate::reference(emitted, throughput, kd, self.sums)],
            (true, false) => [direct, indirect, emitted + throughput * specular],
            (true, true) => [direct, indirect, throughput * specular],
        }
    }

    fn is_diffuse(&self) -> bool {
        self.shown.is_some() && self.is_first && self.point[2].element_sum() > 0.0
    }
}

/// Oracle: direct and indirect irradiance of a pixel, and what is added to its emission; and whether they come from the four points around
/// it. `lit(x, y)`: the lit points of an image of this size.
pub fn reference(
    frame: &FrameParameters,
    pixel: &Pixel,
    size: [u32; 2],
    lit: impl Fn(u32, u32) -> LitPoint,
) -> ([Vec3; 3], bool) {
    let place = Place::of(frame, pixel.at, size);
    let shows = |near: &LitPoint| same_surface(frame, Some(&pixel.shown), near.shown.as_ref());
    let (mut sum, mut total) = ([Vec3::ZERO; 3], 0.0);
    for ([x, y], weight) in place.four() {
        let near = lit(x, y);
        if shows(&near) {
            total += weight;
            sum = [0, 1, 2].map(|k| sum[k] + weight * near.lends(pixel.emits)[k]);
        }
    }
    if total > LEAST_WEIGHT {
        return (sum.map(|e| e / total), true);
    }
    // Of two with one key the first is nearest.
    let nearest = |key: &dyn Fn(&LitPoint, f32) -> Option<f32>| {
        let of = |[x, y]: [u32; 2]| {
            let near = lit(x, y);
            Some((key(&near, place.distance2([x, y]))?, near))
        };
        place.sixteen().filter_map(of).reduce(|a, b| if b.0 < a.0 { b } else { a }).map(|(_, near)| near)
    };
    if let Some(near) = nearest(&|near, distance2| shows(near).then_some(distance2)) {
        return (near.lends(pixel.emits), false);
    }
    let in_space = |near: &LitPoint, _| {
        let theirs = near.shown.filter(|_| near.is_diffuse())?;
        let facing = theirs.normal.dot(pixel.shown.normal);
        Some(theirs.position.distance_squared(pixel.shown.position) * (1.0 + TURNED * (1.0 - facing)))
    };
    if let Some(near) = nearest(&in_space).filter(|_| pixel.diffuse) {
        return ([near.sums[0], near.sums[1], Vec3::ZERO], false);
    }
    let in_image = |near: &LitPoint, distance2: f32| {
        let same = near.shown.is_some_and(|theirs| theirs.material == pixel.shown.material);
        Some(distance2 + if same { 0.0 } else { OTHER_MATERIAL })
    };
    let whole = nearest(&in_image).filter(|_| !pixel.emits).map_or(Vec3::ZERO, |near| {
        let [emitted, throughput, kd] = near.point;
        accumulate::reference(emitted, throughput, kd, near.sums)
    });
    ([Vec3::ZERO, Vec3::ZERO, whole], false)
}
