//! The mirror image of the room in the visible glossy planes and curved surfaces, and the kernel that spreads each of its pixels (Bastos
//! 1999, sections 6.3, 7.4.2.2 and 8.1.1).
//!
//! The eye paths of `eye_paths` follow the mirrored ray of each pixel that shows a glossy plane, which is the view of
//! the mirrored eye (equations 6.3 and 6.4), restricted to the plane's pixels; the ends of these paths are lit like
//! other shading points. This pass turns their light into the source of the convolution:
//!
//! ```text
//! L = L_e + throughput (kd / pi (E_direct + E_indirect) + L_specular)     of the second component
//! k = 4 tan(beta) z_r / (t + z_r) f      diameter in pixels
//! ```
//!
//! tan(beta) belongs to the plane's material at this viewing angle ([`crate::superposition::kernels`]); z_r is the
//! distance from the plane to the reflected point, t that from the eye to the plane, and f the number of pixels in a
//! unit of length at unit distance. 4 z_r tan(beta) is equation 7.7, the width of the lobe at the reflected point; z_r
//! / (t + z_r) is its size as the eye sees it, since the mirror image is as far behind the plane as the room is in
//! front of it. Each kernel is spread in two parts, tail and core, with a footprint each. A mirrored ray that hits
//! nothing counts as infinitely far. The kernel's axes are those of the lobe, whose width differs along and across the
//! plane of incidence.
//!
//! At another glossy plane within the mirror image the path continues to the base or along the mirrored ray, at random
//! as at all mirrors but the first (section 8.1.2, up to `max_specular` steps), and the squares of the lobes' widths at
//! the end of the path add up: sum over planes of (tan(beta_i) (z - z_i))^2, with z the length of the whole path and
//! z_i the length up to the plane.
//!
//! # Images with depth
//!
//! Where images with depth show the mirror image ([`reproject`](super::reproject)) the second component has no path, and L and the depth
//! are those of the nearest point.
//!
//! # Frosted panes
//!
//! A frosted pane is treated likewise, with the room behind it (section 8.2.3.1: translucency). Its lobe is a
//! reflection lobe mirrored to the other side ([`crate::bsdf::ideal::frost`]), so the straight continuation replaces
//! the mirrored ray, and z_r is the distance from the pane to the point behind it. The source is the first component of
//! the pixel instead of the second; it is cleared in the pixel itself. The pane's reflection remains an ideal
//! reflection.
//!
//! # Curved surfaces
//!
//! A curved surface ([`crate::scene::reflectors`]) mirrors by its shading normal. Rays of neighbouring pixels part by its power G, a
//! symmetric matrix over the directions across the ray ([`super::curvature`]): in the plane of incidence 2 / (R cos theta), across it
//! 2 cos theta / R on a sphere of radius R, twice the reciprocal of the focal lengths. With a = z_r / (t + z_r), that of the plane,
//!
//! ```text
//! spread = (1 + a t G)^-1       kernel = spread applied to that of the plane
//! 1 / z' = 1 / z_r + trace(G) / 2      depth of the virtual image
//! ```
//!
//! Along an axis of power g the diameter so is 4 tan(beta) z' / (t + z') f with 1 / z' = 1 / z_r + g. The spread kernel is an ellipse of
//! any direction; the footprint has its long axis, and the factor by which it is narrower across that. The textures follow the plane of
//! incidence, so each lobe of a curved surface has copies of them without narrowing, and copies with exchanged axes for kernels that are
//! longer across it. Kernels are narrowed to [`THINNEST`] pixels at least. Where the copies do not fit among [`MAX_LAYERS`] textures the
//! kernel of the plane takes the ellipse's area.
//!
//! Differs from the thesis in that: the diameter takes perspective into account; the kernel holds the fraction of the
//! lobe that `superposition::kernels` states, not all of it.
//!
//! Cost: for each pixel of a tile that shows mirrors, glass or glossy planes, 234 bytes read, 80 written and 150
//! operations; for a pane or a curved surface 32 bytes more, and for the latter 200 operations.

use std::collections::HashMap;

use glam::{DMat2, DVec2, Vec2, Vec3};

use super::schedule::LIST_GROUPS;
use super::{BoundKernel, EyePathState, Kit, Lighting, List, ShadingPoints, vec4s};
use crate::bsdf::MIN_ALPHA;
use crate::bsdf::phong::{EXPONENTS, width_of};
use crate::device_scene::ReflectorFinish;
use crate::error::Result;
use crate::gpu::{Buffer, Context, Recorder, Resources, Staging, shaders};
use crate::pass::convolve::MAX_LAYERS;
use crate::pass::layout;
use crate::scene::reflectors::Reflector;
use crate::superposition::kernels::{
    AZIMUTHS, CORE_RADIUS, GpuKernels, KERNEL_TEXELS, Kernel, KernelLibrary, Part, VIEW_ANGLES,
};
use crate::superposition::lobe::Lobe;
use crate::superposition::reflectance::{MAP_TEXELS, ReflectanceMap, fresnel_fitted_rgb};

// shaders/include/reflectors.wgsl has the same numbers.
const _: () = assert!(VIEW_ANGLES == 32 && AZIMUTHS == 8 && MAP_TEXELS == 128 && CORE_RADIUS == 0.3);

/// Kinds of reflectors besides glossy planes, as `shaders/include/reflectors.wgsl` has them.
const FROSTED_PANE: u32 = 1;
const CURVED_SURFACE: u32 = 2;

/// Maximum number of lobes in the tables.
const MAX_LOBES: usize = MAX_LAYERS as usize / (2 * VIEW_ANGLES);

/// Least width in pixels to which the curvature of a surface narrows a kernel.
pub const THINNEST: f32 = 1.5;

/// The lobes that are used if there are more than [`MAX_LOBES`]: ln(alpha) in steps of a sixth, 36 lobes in all, and ln(exponent) in steps of 1,
/// 10 lobes; one width, the geometric mean, in place of two.
fn coarsened(lobe: &Lobe) -> Lobe {
    match lobe {
        Lobe::Anisotropic { alpha } => coarsened(&one_width(*alpha)),
        Lobe::Ggx { alpha } => Lobe::Ggx { alpha: ((alpha.ln() * 6.0).round() / 6.0).exp().max(MIN_ALPHA) },
        Lobe::Cosine { exponent } => Lobe::Cosine { exponent: exponent.ln().round().exp().min(*EXPONENTS.end()) },
        other => other.clone(),
    }
}

/// The lobe of one width, the geometric mean, in place of two.
fn one_width(alpha: f32) -> Lobe {
    Lobe::Ggx { alpha: width_of(alpha).clamp(MIN_ALPHA, 1.0) }
}

/// Tables of the reflectors of a scene, on the device.
pub struct Tables {
    /// For each reflector: its first layer, the first texel of its reflectance map, its kind (1: frosted pane, 2: curved), and for a curved one
    /// the first of the textures of its own and from bit 12 on the first row of its aspects in `lobes`, 0: it has none. Of a plane 1 if its lobe has two
    /// widths.
    pub reflectors: Buffer,
    /// Lobe of each layer: tan(beta), energy, its grazing part, fraction of the core. Then for lobes on curved surfaces the aspects of tail
    /// and core, for each view angle.
    pub lobes: Buffer,
    /// Kernel texture of each layer.
    pub textures: Buffer,
    /// For each reflector tan(beta) at normal incidence, and the first texture of its lobe.
    pub facing: Vec<(f32, usize)>,
    /// By how many steps each layer is narrower than its texture.
    pub narrowings: Vec<u32>,
    /// Reflectance maps: energy of the lobe times Fresnel's term.
    pub maps: Buffer,
    /// The tables on the host.
    pub library: KernelLibrary,
}

impl Tables {
    /// Makes the tables for these reflectors and their finishes. Takes some 200 ms of one core for each distinct lobe.
    pub fn new(
        context: &Context,
        staging: &mut Staging,
        finishes: &[ReflectorFinish],
        of: &[Reflector],
    ) -> Result<Tables> {
        let mut library = KernelLibrary::new();
        let mut distinct: Vec<&Lobe> = Vec::new();
        for finish in finishes {
            if !distinct.contains(&&finish.lobe) {
                distinct.push(&finish.lobe);
            }
        }
        let tables = |lobe: &&Lobe| if matches!(lobe, Lobe::Anisotropic { .. }) { AZIMUTHS } else { 1 };
        let coarse = distinct.iter().map(tables).sum::<usize>() > MAX_LOBES;
        let (mut reflectors, mut maps): (Vec<[u32; 4]>, _) = (Vec::new(), Vec::new());
        for ((i, finish), reflector) in (0u32..).zip(finishes).zip(of) {
            let lobe = match &finish.lobe {
                lobe if coarse => coarsened(lobe),
                // Curvature has the kernel's axes on curved surfaces.
                Lobe::Anisotropic { alpha } if reflector.curved => one_width(*alpha),
                lobe => lobe.clone(),
            };
            let first = library.add(i, lobe.clone())?;
            let map =
                ReflectanceMap::new(|mu| library.mean_energy(i, mu) * fresnel_fitted_rgb(finish.reflectance.f0, mu))?;
            let kind = u32::from(reflector.pane) * FROSTED_PANE + u32::from(reflector.curved) * CURVED_SURFACE;
            let two_widths = u32::from(matches!(lobe, Lobe::Anisotropic { .. }));
            reflectors.push([first, i * MAP_TEXELS as u32, kind, two_widths]);
            maps.extend(map.to_gpu());
        }
        let facing = (0..)
            .zip(&reflectors)
            .map(|(i, record)| (library.look_up(i, 1.0).map_or(0.0, |lobe| lobe.tan_beta), 2 * record[0] as usize));
        let facing = facing.collect();
        let mut tables = library.to_gpu();
        let mut of_lobe = HashMap::new();
        for record in reflectors.iter_mut().filter(|record| record[2] == CURVED_SURFACE) {
            let layers = &library.layers()[record[0] as usize..][..VIEW_ANGLES];
            record[3] = *of_lobe.entry(record[0]).or_insert_with(|| add_curved(&mut tables, layers));
        }
        Ok(Tables {
            reflectors: staging.stage(context, "reflectors", &reflectors)?,
            lobes: staging.stage(context, "reflector lobes", &tables.layers)?,
            textures: staging.stage(context, "reflector kernels", &tables.textures)?,
            facing,
            narrowings: tables.narrowings,
            maps: staging.stage(context, "reflectance maps", &maps)?,
            library,
        })
    }

    /// The buffers by their names in shaders, without the kernels.
    pub fn resources(&self) -> Resources {
        Resources::of([("reflectors", &self.reflectors), ("lobes", &self.lobes), ("maps", &self.maps)])
    }
}

/// Adds the textures of a lobe for curved surfaces: those of the tails without narrowing, then the same with their axes exchanged in the
/// opposite order; likewise those of the cores. Returns the word for [`Tables::reflectors`], 0 if they do not fit.
fn add_curved(tables: &mut GpuKernels, layers: &[Kernel]) -> u32 {
    let (texture, row) = (tables.narrowings.len(), tables.layers.len());
    if texture + 4 * VIEW_ANGLES > MAX_LAYERS as usize {
        return 0;
    }
    let parts: [fn(&Kernel) -> &Part; 2] = [|kernel| &kernel.tail, |kernel| &kernel.core];
    for part in parts {
        for kernel in layers {
            tables.textures.extend(&part(kernel).texture);
        }
        for kernel in layers.iter().rev() {
            let own = &part(kernel).texture;
            let texels = (0..KERNEL_TEXELS * KERNEL_TEXELS).map(|i| (i % KERNEL_TEXELS, i / KERNEL_TEXELS));
            tables.textures.extend(texels.map(|(x, y)| own[x * KERNEL_TEXELS + y]));
        }
    }
    tables.narrowings.resize(texture + 4 * VIEW_ANGLES, 0);
    tables.layers.extend(layers.iter().map(|kernel| [kernel.tail.aspect(), kernel.core.aspect(), 0.0, 0.0]));
    texture as u32 | (row as u32) << 12
}

/// A mirror image and the kernels that spread it, pixel by pixel.
#[derive(Clone)]
pub struct Image {
    /// Radiance; w: depth of the visible point along the view direction, on the unfolded path.
    pub source: Buffer,
    /// Tail of the kernel: diameter in pixels, texture, direction of the u axis.
    pub footprint: Buffer,
    /// Core of the kernel, likewise.
    pub core_footprint: Buffer,
}

/// Glossy planes on the eye paths. Without planes that mirror the room, minimal buffers that mark no plane.
#[derive(Clone)]
pub struct Planes {
    /// Reflector that a pixel shows directly, 0: none; at too concave places of a curved one 0.
    pub region: Buffer,
    /// Sums over the planes within the mirror image: tan(beta)^2 times 1, z_i, z_i^2. A frosted pane seen directly
    /// counts as one of these planes.
    pub widening: Buffer,
    /// Two vectors for each pixel of a frosted pane or a curved surface: transmittance of the spread light, or the power along u, mixed, and
    /// across, w: cosine of the viewing angle; direction of the kernel's u axis, pixels in a unit of length at unit distance, for a
    /// curved surface the distance from the eye.
    pub extras: Buffer,
    /// Radiance and depth of the mirror image where images with depth show it ([`super::reproject`]), depth 0: a ray shows it.
    pub reprojected: Buffer,
}

impl Planes {
    /// Allocates `pixels` pixels, or minimal buffers for what the scene does not have. `extras`: there are frosted panes or curved surfaces;
    /// `images`: images with depth show mirror images.
    pub fn new(kit: &Kit, pixels: u32, mirrors: bool, extras: bool, images: bool) -> Result<Planes> {
        Ok(Planes {
            region: kit.array("region", if mirrors { pixels } else { 4 }, 4)?,
            widening: kit.vec4s("widening", if mirrors { pixels } else { VIEW_ANGLES as u32 })?,
            extras: kit.vec4s("panes and curved surfaces", if extras { 2 * pixels } else { 2 })?,
            reprojected: kit.vec4s("reprojected mirror image", if images { pixels } else { 1 })?,
        })
    }

    /// The buffers by their names in shaders.
    pub fn resources(&self) -> Resources {
        Resources::of([
            ("region", &self.region),
            ("widening", &self.widening),
            ("extras", &self.extras),
            ("reprojected", &self.reprojected),
        ])
    }
}

impl Image {
    /// Allocates `pixels` pixels.
    pub fn new(context: &Context, pixels: u32) -> Result<Image> {
        let array = |name: &str| vec4s(context, name, pixels);
        Ok(Image {
            source: array("mirror image")?,
            footprint: array("footprint")?,
            core_footprint: array("core footprint")?,
        })
    }

    /// The buffers by their names in shaders.
    pub fn resources(&self) -> Resources {
        Resources::of([
            ("source", &self.source),
            ("footprint", &self.footprint),
            ("core_footprint", &self.core_footprint),
        ])
    }
}

/// The pass.
pub struct MirrorImage {
    kernel: BoundKernel,
    tiles: Buffer,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// Shading points of both components.
    pub points: &'a ShadingPoints,
    /// Throughput and depth.
    pub paths: &'a EyePathState,
    /// Lighting of the points.
    pub lighting: &'a Lighting,
    /// Tiles that show mirrors, glass or glossy planes.
    pub tiles: &'a List,
    /// Glossy planes on the eye paths.
    pub planes: &'a Planes,
    /// Lobes and kernels.
    pub tables: &'a Tables,
    /// Output.
    pub image: &'a Image,
}

impl MirrorImage {
    /// Writes `image` where `region` is not 0, and clears the second components there, so that `merge` adds nothing; at
    /// frosted panes it clears the first components, so that `accumulate` adds nothing.
    pub fn new(kit: &Kit, inputs: &Inputs) -> Result<Self> {
        let Inputs { points, paths, lighting, tiles, planes, tables, image } = *inputs;
        let (points, paths, lighting) = (points.resources(), paths.resources(), lighting.resources());
        let (planes, tables, image) = (planes.resources(), tables.resources(), image.resources());
        let sets = [&points, &paths, &lighting, &tiles.as_tiles(), &planes, &tables, &image];
        Ok(MirrorImage { kernel: kit.bind(&shaders::MIRROR_IMAGE, &sets)?, tiles: tiles.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run_listed(rec, &[], &self.tiles, LIST_GROUPS)
    }
}

/// Depth of a mirrored ray that hits nothing.
pub const NOTHING_SEEN: f32 = 3.0e38;

/// Oracle: diameter in pixels and direction of the u axis of the kernel at a pixel that shows the first of `planes`
/// along `d`. `planes` has tan(beta) and the distance along the view direction of each plane; `seen` is the distance of
/// the reflected point, `None` if there is none. Computed by projecting points: the diameter is the geometric mean of
/// the disc's images along u and across.
pub fn reference(
    frame: &layout::FrameParameters,
    d: Vec3,
    normal: Vec3,
    planes: &[(f32, f32)],
    seen: Option<f32>,
) -> (f32, Vec2) {
    let xyz = |v: [f32; 4]| Vec3::new(v[0], v[1], v[2]).as_dvec3();
    let [right, up, forward] = [frame.right, frame.up, frame.forward].map(xyz);
    let size = DVec2::new(f64::from(frame.size[0]), f64::from(frame.size[1]));
    let project = |p: glam::DVec3| {
        let across = DVec2::new(p.dot(right) / right.length_squared(), -p.dot(up) / up.length_squared());
        0.5 * size * (across / p.dot(forward) + 1.0)
    };
    let (d, normal) = (d.as_dvec3(), normal.as_dvec3());
    // A small disc perpendicular to the virtual ray.
    let u = (-normal - (-normal).dot(d) * d).normalize_or(d.any_orthonormal_vector());
    let v = d.cross(u);
    let small = 1e-6;
    let [along, across] = [u, v].map(|w| (project(d + small * w) - project(d - small * w)) / (2.0 * small));
    let area = along.perp_dot(across).abs();
    let of_plane = |&(tan_beta, depth): &(f32, f32)| {
        f64::from(tan_beta) * seen.map_or(1.0, |seen| 1.0 - f64::from(depth) / f64::from(seen))
    };
    let half = planes.iter().map(|plane| of_plane(plane).powi(2)).sum::<f64>().sqrt();
    ((4.0 * half * area.sqrt()) as f32, along.normalize().as_vec2())
}

/// Kernel on a curved surface, as the convolution takes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipse {
    /// Diameter along the long axis, pixels.
    pub diameter: f64,
    /// Steps of 2^(1/4) by which it is narrower across.
    pub steps: u32,
    /// Direction of the texture's u axis, in components along u and across it.
    pub axis: DVec2,
    /// Whether the texture has its axes exchanged.
    pub exchanged: bool,
}

/// Oracle: the kernel of a part whose ellipse on a plane is `diameter` pixels long along u and `aspect` times as wide, on a surface of
/// this power (along u, mixed, and across) at distance `t` from the eye; `nearness` is z_r / (t + z_r). Found by turning the ellipse's
/// radius.
pub fn curved_reference(diameter: f64, aspect: f64, power: [f64; 3], t: f64, nearness: f64) -> Ellipse {
    let power = DMat2::from_cols(DVec2::new(power[0], power[1]), DVec2::new(power[1], power[2]));
    let map = (DMat2::IDENTITY + nearness * t * power).inverse() * DMat2::from_diagonal(DVec2::new(1.0, aspect));
    const ANGLES: u32 = 20_000;
    let radii = (0..ANGLES).map(|i| map * DVec2::from_angle(std::f64::consts::TAU * f64::from(i) / f64::from(ANGLES)));
    let (long, short) = radii.fold((DVec2::ZERO, DVec2::splat(1e30)), |(long, short), radius| {
        let length = radius.length();
        (if length > long.length() { radius } else { long }, if length < short.length() { radius } else { short })
    });
    let major = diameter * long.length();
    let minor = (diameter * short.length()).max((aspect * major).min(f64::from(THINNEST)));
    let steps = (4.0 * (major / minor).log2()).round().min(15.0);
    let mean = (major * minor).sqrt();
    if steps < 1.0 || major <= 1.0 {
        return Ellipse { diameter: mean, steps: 0, axis: DVec2::X, exchanged: false };
    }
    let along = long.normalize();
    let exchanged = along.y.abs() > along.x.abs();
    let backward = if exchanged { along.y > 0.0 } else { along.x < 0.0 };
    let axis = if backward { -along } else { along };
    Ellipse { diameter: mean * (steps / 8.0).exp2(), steps: steps as u32, axis, exchanged }
}
