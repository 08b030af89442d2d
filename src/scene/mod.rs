//! What is lit: plain data, no Vulkan.
//!
//! Coordinates are the file's own, right-handed; radiance is in W/(m^2 sr), linear Rec. 709. A face emits from its
//! front (counter-clockwise) side alone unless its material is `two_sided`; surfaces reflect on both sides.

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

/// A scene ready to be rendered: one flat triangle soup with materials, textures, lights and a camera.
///
/// Every loader ends in [`Scene::validate`], so code after it may rely on: all numbers finite, every index in range, no
/// triangle of zero area, at least one triangle, at least one light or emitter.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Name for messages and metadata (file stem or builtin name).
    pub name: String,
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Vertex normals, unit length, parallel to `positions`; meaningful only for `smooth` triangles.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, parallel to `positions`; (0, 0) is the texture's upper left corner, v runs downwards.
    pub uvs: Vec<Vec2>,
    /// The triangles.
    pub triangles: Vec<Triangle>,
    /// Names of the objects that triangles came from, for messages.
    pub objects: Vec<String>,
    /// The materials.
    pub materials: Vec<Material>,
    /// The textures.
    pub textures: Vec<Texture>,
    /// Lights that are not emissive triangles.
    pub lights: Vec<Light>,
    /// Camera of the file, if it has one.
    pub camera: Option<Camera>,
    /// `[render]` of the scene file: defaults below the command line.
    pub render: RenderDefaults,
}

/// One triangle, counter-clockwise seen from its front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// Indices into `positions`, `normals`, `uvs`.
    pub vertices: [u32; 3],
    /// Index into `materials`.
    pub material: u32,
    /// Index into `objects`.
    pub object: u32,
    /// Interpolate the vertex normals for shading; else the face's own normal serves.
    pub smooth: bool,
}

/// What happens to light at a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Surface {
    /// Lambert plus a GGX lobe.
    #[default]
    Opaque,
    /// Ideal mirror of colour `specular` (MTL illum 3, 5). Shaded black for now; absorbs particles.
    Mirror,
    /// Smooth dielectric of index `ior` (MTL illum 4, 6, 7, 9). Shaded black for now; absorbs particles.
    Glass,
}

/// A material: reflectance f_r = kd/pi + ks D G F / (4 cos cos').
///
/// kd = base_color (1 - metallic), F0 = mix(specular, base_color, metallic), GGX alpha = roughness^2.
/// There is no specular lobe where F0 is 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file.
    pub name: String,
    /// Kind of surface.
    pub surface: Surface,
    /// Base colour, each channel in [0, 1]; multiplied by `base_texture` where there is one.
    pub base_color: Vec3,
    /// Index into `textures` (sRGB).
    pub base_texture: Option<u32>,
    /// 0 dielectric .. 1 metal.
    pub metallic: f32,
    /// Perceptual roughness in [0, 1].
    pub roughness: f32,
    /// Index into `textures` (linear; green: roughness, blue: metallic, as in glTF).
    pub metallic_roughness_texture: Option<u32>,
    /// Reflectance at normal incidence of the dielectric part, in [0, 1]; 0 for a purely Lambertian material.
    pub specular: Vec3,
    /// Emitted radiance.
    pub emission: Vec3,
    /// Emits from both sides.
    pub two_sided: bool,
    /// Index of refraction (glass).
    pub ior: f32,
}

impl Default for Material {
    fn default() -> Self {
        Material {
            name: String::from("default"),
            surface: Surface::Opaque,
            base_color: Vec3::splat(0.8),
            base_texture: None,
            metallic: 0.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            specular: Vec3::ZERO,
            emission: Vec3::ZERO,
            two_sided: false,
            ior: 1.5,
        }
    }
}

/// How texture coordinates outside [0, 1] are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Wrap {
    /// Periodic.
    #[default]
    Repeat,
    /// Periodic with every other period mirrored.
    Mirror,
    /// The border's texel.
    Clamp,
}

/// An 8-bit texture, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Name for messages (its file).
    pub name: String,
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// RGBA texels, `width * height`.
    pub texels: Vec<[u8; 4]>,
    /// Colour channels are sRGB-encoded; else linear.
    pub srgb: bool,
    /// Wrap modes along u and v.
    pub wrap: [Wrap; 2],
}

/// A light that is not an emissive triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// Isotropic point: radiant intensity in W/sr.
    Point {
        /// Position.
        position: Vec3,
        /// Radiant intensity.
        intensity: Vec3,
    },
    /// Spot as in KHR_lights_punctual: full inside `inner`, smooth to zero at `outer`.
    Spot {
        /// Position.
        position: Vec3,
        /// Unit direction of the axis.
        direction: Vec3,
        /// Radiant intensity on the axis.
        intensity: Vec3,
        /// Half angle of the full cone, radians.
        inner: f32,
        /// Half angle where it ends, radians, above `inner`, at most pi/2.
        outer: f32,
    },
    /// Parallel light.
    Directional {
        /// Unit direction in which light travels.
        direction: Vec3,
        /// Irradiance on a plane perpendicular to `direction`, W/m^2.
        irradiance: Vec3,
    },
    /// Sphere that emits outwards. Its surface is present as triangles of object `object` (so that it is seen and
    /// blocks light); those triangles are not emitters of their own: samples are taken on the ideal sphere.
    Sphere {
        /// Centre.
        center: Vec3,
        /// Radius, above 0.
        radius: f32,
        /// Emitted radiance.
        radiance: Vec3,
        /// Emits inwards instead (a closed glowing enclosure).
        inward: bool,
        /// Index into `objects` of its triangles.
        object: u32,
    },
    /// A virtual light with cosine emission from one side, as written by `--export-lights`: radiance
    /// `power / pi` per unit area and cosine, that is intensity `power / pi * cos(theta)`.
    Virtual {
        /// Position.
        position: Vec3,
        /// Unit normal.
        normal: Vec3,
        /// Emitted flux, W.
        power: Vec3,
    },
}

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Eye point.
    pub eye: Vec3,
    /// Point in the image's centre.
    pub target: Vec3,
    /// Upward direction.
    #[serde(default = "Camera::default_up")]
    pub up: Vec3,
    /// Full vertical angle of view, degrees, in (0, 180).
    pub fov_y: f32,
    /// Width and height in pixels.
    #[serde(default = "Camera::default_resolution")]
    pub resolution: [u32; 2],
}

impl Camera {
    fn default_up() -> Vec3 {
        Vec3::Y
    }
    fn default_resolution() -> [u32; 2] {
        [640, 480]
    }
}

/// `[render]` of a scene file; each key as the command-line flag of the same name.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RenderDefaults {
    /// Number of passes.
    pub passes: Option<u32>,
    /// Particles started for each pass.
    pub paths: Option<u32>,
    /// Segments of a path.
    pub max_depth: Option<u32>,
    /// Clipping distance in scene units.
    pub clip: Option<f32>,
    /// Clipping distance as a fraction of the scene's diagonal.
    pub clip_fraction: Option<f32>,
    /// Gather what clipping cuts off.
    pub compensation: Option<bool>,
    /// Seed.
    pub seed: Option<u64>,
    /// Exposure in stops for PNG output.
    pub exposure: Option<f32>,
}
