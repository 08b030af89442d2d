//! Shading points from the G-buffer of a host ([`View::GBuffer`](crate::View::GBuffer)): records of position, normals, reflectance and
//! emission for each pixel, in place of the rays of the eye.
//!
//! Replaces `camera_rays`, the `trace` of its rays and `eye_points`. A record stands for what the host's rasterizer shows at the centre of
//! a pixel; light comes from the engine's own scene, which is also what shadow rays meet. A pixel that sees nothing shows the environment.
//!
//! Normals count on the side of the eye; a shading normal that the eye sees from behind is replaced by the geometric one. Albedo,
//! specular reflectance and roughness are clamped to [0, 1], emission to [0, 1e30]. **Refused** are records with a number that is
//! not finite, a position farther from the origin than [`FARTHEST`] or behind the eye, or a normal of no length: their pixels see
//! nothing, and are counted ([`Records::refused`]).
//!
//! Differs from the engine's own eye in: one layer, so that nothing is seen in mirrors and through glass, and lobes are shown by virtual
//! lights alone; no more rays at edges; textures are what the host has made of them.
//!
//! Cost: 112 bytes read and 128 written a pixel, some 150 operations.

use glam::{Vec3, Vec4};

use super::layout::{FrameParameters, PointStep};
use super::{BoundKernel, EyePathState, Kit, List, ShadingPoints, vec4s};
use crate::accel::offset_origin;
use crate::bsdf::{Normals, Reflectance};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Greatest coordinate of a position.
pub const FARTHEST: f32 = 1e9;
/// Greatest emission that is taken.
pub const BRIGHTEST: f32 = 1e30;
/// Components of normals whose longest is shorter than this tell no direction, nor do longer ones than its inverse.
const SHORTEST: f32 = 1e-6;

/// The records, a vec4 for each pixel, row by row from the top. Their positions are zero until they are written, so that nothing is seen.
pub struct Records {
    /// Position relative to [`crate::Scene::origin`]; w: above 0 where a surface is seen.
    pub position: Buffer,
    /// Shading normal, of any length; w: roughness in [0, 1], whose square is the alpha of the GGX lobe.
    pub normal: Buffer,
    /// Geometric normal, of any length, off which shadow rays start; zero: that of shading. w: unused.
    pub geometric_normal: Buffer,
    /// Diffuse albedo, linear Rec. 709; that of a metal is 0. w: unused.
    pub albedo: Buffer,
    /// Specular reflectance at normal incidence; 0: matte. w: unused.
    pub specular: Buffer,
    /// Emitted radiance, W/(m^2 sr). w: unused.
    pub emission: Buffer,
    /// One word: pixels of the latest pass whose records were refused.
    pub refused: Buffer,
}

impl Records {
    /// Of so many pixels.
    pub fn new(kit: &Kit, pixels: u32) -> Result<Records> {
        let array = |what: &str| vec4s(kit.context, &format!("G-buffer {what}"), pixels);
        Ok(Records {
            position: kit.stage("G-buffer position", &vec![[0f32; 4]; pixels as usize])?,
            normal: array("normal")?,
            geometric_normal: array("geometric normal")?,
            albedo: array("albedo")?,
            specular: array("specular")?,
            emission: array("emission")?,
            refused: kit.array("refused records", 1, 4)?,
        })
    }

    /// The buffers by their names in shaders.
    pub fn resources(&self) -> Resources {
        Resources::of([
            ("given_position", &self.position),
            ("given_normal", &self.normal),
            ("given_geometric", &self.geometric_normal),
            ("given_albedo", &self.albedo),
            ("given_specular", &self.specular),
            ("given_emission", &self.emission),
            ("refused", &self.refused),
        ])
    }
}

/// The pass.
pub struct GBuffer {
    kernel: BoundKernel,
    /// The records of all pixels, which the host writes.
    pub records: Records,
    tiles: u32,
}

impl GBuffer {
    /// Writes the `points` of all pixels, in so many tiles of 8 x 8, their depths in `paths`, and lists those that are lit.
    pub fn new(
        kit: &Kit,
        records: Records,
        (points, paths): (&ShadingPoints, &EyePathState),
        (list, step): (&List, PointStep),
        tiles: u32,
    ) -> Result<GBuffer> {
        let own = records.resources().and(&Resources::of([("point_step", &kit.stage("point step", &[step])?)]));
        let sets = [&own, &points.resources(), &paths.resources(), &list.as_output()];
        Ok(GBuffer { kernel: kit.bind(&shaders::G_BUFFER, &sets)?, records, tiles })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        rec.fill(&self.records.refused, 0)?;
        self.kernel.run(rec, &[], u64::from(self.tiles))
    }
}

/// The record of a pixel, for the oracle; the components of [`Records`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Record {
    /// [`Records::position`].
    pub position: Vec4,
    /// [`Records::normal`].
    pub normal: Vec4,
    /// [`Records::geometric_normal`].
    pub geometric_normal: Vec3,
    /// [`Records::albedo`].
    pub albedo: Vec3,
    /// [`Records::specular`].
    pub specular: Vec3,
    /// [`Records::emission`].
    pub emission: Vec3,
}

/// The shading point of a record, for the oracle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Position with ray-origin offset.
    pub position: Vec3,
    /// Distance along its ray, and depth along the view direction.
    pub distance: [f32; 2],
    /// Both normals, on the side of the eye.
    pub normals: Normals,
    /// Its reflectance.
    pub reflectance: Reflectance,
    /// Unit direction back along its ray.
    pub wo: Vec3,
    /// Emission.
    pub emission: Vec3,
}

/// The meaning of a record, for the oracle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Told {
    /// Nothing is seen.
    Nothing,
    /// Its numbers tell no surface.
    Refused,
    /// A surface.
    Surface(Point),
}

/// Oracle: the shading point of a record.
pub fn reference(frame: &FrameParameters, record: &Record) -> Told {
    let xyz = |v: [f32; 4]| Vec4::from(v).truncate();
    let Record { position, normal, geometric_normal, albedo, specular, emission } = *record;
    if position.w.is_finite() && position.w <= 0.0 {
        return Told::Nothing;
    }
    let vectors = [geometric_normal, albedo, specular, emission];
    let finite = position.is_finite() && normal.is_finite() && vectors.iter().all(|v| v.is_finite());
    let is_direction = |v: Vec3| (SHORTEST..1.0 / SHORTEST).contains(&v.abs().max_element());
    let p = position.truncate();
    let to = p - xyz(frame.eye);
    let depth = to.dot(xyz(frame.forward));
    if !finite || p.abs().max_element() > FARTHEST || !is_direction(normal.truncate()) || depth <= 0.0 {
        return Told::Refused;
    }
    let (d, t) = match frame.is_orthographic() {
        true => (xyz(frame.forward), depth),
        false => (to.normalize(), to.length()),
    };
    let shading = normal.truncate().normalize();
    let given = if is_direction(geometric_normal) { geometric_normal.normalize() } else { shading };
    let geometric = if given.dot(d) > 0.0 { -given } else { given };
    let unit = |v: Vec3| v.clamp(Vec3::ZERO, Vec3::ONE);
    let reflectance =
        Reflectance { kd: unit(albedo), ..Reflectance::new(Vec3::ZERO, 0.0, normal.w.clamp(0.0, 1.0), unit(specular)) };
    let mut normals = Normals::facing(geometric, shading, -d);
    // Behind the shading normal the geometric one replaces it.
    if normals.shading.dot(d) >= 0.0 {
        normals.shading = geometric;
    }
    Told::Surface(Point {
        position: offset_origin(p, geometric, frame.eye[3]),
        distance: [t, depth],
        normals,
        reflectance,
        wo: -d,
        emission: emission.clamp(Vec3::ZERO, Vec3::splat(BRIGHTEST)),
    })
}
