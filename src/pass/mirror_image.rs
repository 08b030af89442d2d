//! The mirror image of the room in the visible glossy planes, and the kernel that spreads each of its pixels (Bastos
//! 1999, sections 6.3 and 7.4.2.2).
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
//! Differs from the thesis in that: the diameter takes perspective into account; the kernel holds the fraction of the
//! lobe that `superposition::kernels` states, not all of it.
//!
//! Cost: for each pixel of a tile that shows mirrors, glass or glossy planes, 234 bytes read, 80 written and 150
//! operations; for a pane 32 bytes more.

use glam::{Vec2, Vec3};

use super::schedule::LIST_GROUPS;
use super::{BoundKernel, EyePathState, Kit, Lighting, List, ShadingPoints, vec4s};
use crate::bsdf::MIN_ALPHA;
use crate::bsdf::phong::EXPONENTS;
use crate::device_scene::ReflectorFinish;
use crate::error::Result;
use crate::gpu::{Buffer, Context, Recorder, Resources, Staging, shaders};
use crate::pass::convolve::MAX_LAYERS;
use crate::pass::layout;
use crate::scene::reflectors::Reflector;
use crate::superposition::kernels::{CORE_RADIUS, KernelLibrary, VIEW_ANGLES};
use crate::superposition::lobe::Lobe;
use crate::superposition::reflectance::{MAP_TEXELS, ReflectanceMap, fresnel_fitted_rgb};

// shaders/include/reflectors.wgsl has the same numbers.
const _: () = assert!(VIEW_ANGLES == 32 && MAP_TEXELS == 128 && CORE_RADIUS == 0.3);

/// Maximum number of lobes in the tables.
const MAX_LOBES: usize = MAX_LAYERS as usize / (2 * VIEW_ANGLES);

/// The lobes that are used if there are more than [`MAX_LOBES`]: ln(alpha) in steps of a sixth, 36 lobes in all, and ln(exponent) in steps of 1,
/// 10 lobes.
fn coarsened(lobe: &Lobe) -> Lobe {
    match lobe {
        Lobe::Ggx { alpha } => Lobe::Ggx { alpha: ((alpha.ln() * 6.0).round() / 6.0).exp().max(MIN_ALPHA) },
        Lobe::Cosine { exponent } => Lobe::Cosine { exponent: exponent.ln().round().exp().min(*EXPONENTS.end()) },
        other => other.clone(),
    }
}

/// Tables of the planar reflectors of a scene, on the device.
pub struct Tables {
    /// For each reflector: its first layer, the first texel of its reflectance map, and 1 if it is a frosted pane.
    pub reflectors: Buffer,
    /// Lobe of each layer: tan(beta), energy, its grazing part, fraction of the core.
    pub lobes: Buffer,
    /// Kernel texture of each layer.
    pub textures: Buffer,
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
        let coarse = distinct.len() > MAX_LOBES;
        let (mut reflectors, mut maps) = (Vec::new(), Vec::new());
        for ((i, finish), reflector) in (0u32..).zip(finishes).zip(of) {
            let first = library.add(i, if coarse { coarsened(&finish.lobe) } else { finish.lobe.clone() })?;
            let map = ReflectanceMap::new(|mu| {
                let energy = library.look_up(i, mu).map_or(0.0, |lobe| lobe.energy);
                energy * fresnel_fitted_rgb(finish.reflectance.f0, mu)
            })?;
            reflectors.push([first, i * MAP_TEXELS as u32, u32::from(reflector.pane), 0]);
            maps.extend(map.to_gpu());
        }
        let tables = library.to_gpu();
        Ok(Tables {
            reflectors: staging.stage(context, "reflectors", &reflectors)?,
            lobes: staging.stage(context, "reflector lobes", &tables.layers)?,
            textures: staging.stage(context, "reflector kernels", &tables.textures)?,
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
    /// Reflector that a pixel shows directly, 0: none.
    pub region: Buffer,
    /// Sums over the planes within the mirror image: tan(beta)^2 times 1, z_i, z_i^2. A frosted pane seen directly
    /// counts as one of these planes.
    pub widening: Buffer,
    /// Two vectors for each pixel of a frosted pane: transmittance of the spread light, w: cosine of the viewing angle;
    /// direction of the kernel's u axis, pixels in a unit of length at unit distance.
    pub panes: Buffer,
    /// Radiance and depth of the mirror image where images with depth show it ([`super::reproject`]), depth 0: a ray shows it.
    pub reprojected: Buffer,
}

impl Planes {
    /// Allocates `pixels` pixels, or minimal buffers for what the scene does not have. `images`: images with depth show mirror images.
    pub fn new(kit: &Kit, pixels: u32, mirrors: bool, panes: bool, images: bool) -> Result<Planes> {
        Ok(Planes {
            region: kit.array("region", if mirrors { pixels } else { 4 }, 4)?,
            widening: kit.vec4s("widening", if mirrors { pixels } else { VIEW_ANGLES as u32 })?,
            panes: kit.vec4s("panes", if panes { 2 * pixels } else { 2 })?,
            reprojected: kit.vec4s("reprojected mirror image", if images { pixels } else { 1 })?,
        })
    }

    /// The buffers by their names in shaders.
    pub fn resources(&self) -> Resources {
        Resources::of([
            ("region", &self.region),
            ("widening", &self.widening),
            ("panes", &self.panes),
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
    let size = glam::DVec2::new(f64::from(frame.size[0]), f64::from(frame.size[1]));
    let project = |p: glam::DVec3| {
        let across = glam::DVec2::new(p.dot(right) / right.length_squared(), -p.dot(up) / up.length_squared());
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
