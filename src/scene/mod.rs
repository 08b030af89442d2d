//! The scene: geometry, materials, textures, lights and camera as plain data, and the loaders. No Vulkan.
//!
//! Coordinates are the file's own, relative to [`Scene::origin`] and right-handed; radiance is in W/(m^2 sr), linear Rec. 709. A face emits only from its
//! front (counter-clockwise) side unless its material is `two_sided`; surfaces reflect on both sides.

pub mod animation;
mod builder;
pub mod builtin;
mod curved;
mod description;
pub mod environment;
#[cfg(feature = "images")]
pub(crate) mod export;
mod framing;
#[cfg(feature = "gltf")]
pub(crate) mod gltf;
#[cfg(feature = "gltf")]
mod gltf_accessor;
#[cfg(feature = "gltf")]
mod gltf_animation;
#[cfg(feature = "gltf")]
mod gltf_compressed;
#[cfg(feature = "gltf")]
mod gltf_extensions;
#[cfg(feature = "gltf")]
mod gltf_material;
mod kept_light;
#[cfg(feature = "gltf")]
mod ktx2;
mod large_polygon;
mod load;
mod material;
mod matrices;
mod mesh;
pub mod mip;
#[cfg(feature = "mitsuba")]
mod mitsuba;
#[cfg(feature = "mitsuba")]
mod mitsuba_bsdf;
#[cfg(feature = "mitsuba")]
mod mitsuba_emitter;
#[cfg(feature = "mitsuba")]
mod mitsuba_indices;
#[cfg(feature = "mitsuba")]
mod mitsuba_shape;
#[cfg(feature = "mitsuba")]
mod mitsuba_texture;
#[cfg(feature = "mitsuba")]
mod mitsuba_xml;
#[cfg(feature = "obj")]
mod obj;
#[cfg(feature = "obj")]
mod obj_lines;
#[cfg(feature = "obj")]
mod obj_material;
#[cfg(feature = "obj")]
mod obj_texture;
mod objects;
#[cfg(feature = "images")]
pub(crate) mod openexr;
mod origin;
mod pane;
pub mod path;
#[cfg(feature = "ply")]
mod ply;
pub(crate) mod posed;
pub(crate) mod quietly;
pub mod reflectors;
mod sky;
pub mod surfaces;
mod tessellate;
mod texture;
#[cfg(feature = "images")]
mod texture_file;
pub(crate) mod validate;

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::bsdf::sample_texture;
use crate::bsdf::table::Table;
use crate::superposition::depth_images::DepthImages;

pub use animation::Animations;
pub use builder::SceneBuilder;
pub use environment::Environment;
#[cfg(feature = "images")]
pub use export::{VirtualLight, export_lights, exported_files};
pub(crate) use kept_light::mitchell_filter;
pub use kept_light::{KeptFace, KeptLight, KeptPage};
#[cfg(feature = "images")]
use load::extension;
pub use load::{ReadOptions, load, load_with};
use load::{load_model, stem};
pub use material::{Alpha, Material, Surface};
pub use matrices::Frustum;
pub use mesh::Mesh;
pub(crate) use mesh::{check_transform, mirrors, outward_matrix};
pub use mip::KeptLevels;
pub use quietly::{panic_is_caught, silence_caught_panics};
pub(crate) use texture::linear_to_srgb;
#[cfg(feature = "images")]
pub(crate) use texture::srgb_to_linear;
pub use texture::{Cone, TextureUse};

pub use crate::settings::RenderDefaults;

/// Minimum roughness of a lobe in a file: no point light would hit a smoother one.
const MIN_ROUGHNESS: f32 = 0.03;

/// A scene ready for rendering: a flat list of triangles with materials, textures, lights and a camera.
///
/// Every loader ends with [`Scene::validate`], which guarantees: all numbers finite, every index in range, no
/// triangle of zero area, at least one triangle, at least one light or emitter. Call it for a scene built in memory.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name for messages and metadata (file stem or builtin name).
    pub name: String,
    /// World coordinates of the point to which every position in the scene is relative: vertices, lights and camera, also
    /// those given to an engine later. Zero, unless the geometry of a file lies farther from the file's origin than some
    /// times its size: then the loader moves the origin there, because single precision would round it too coarsely.
    /// [`Scene::from_world`] and [`Scene::to_world`] convert.
    pub origin: DVec3,
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Vertex normals, unit length, parallel to `positions`; meaningful only for `smooth` triangles.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, parallel to `positions`; (0, 0) is the texture's upper left corner, v runs downwards.
    pub uvs: Vec<Vec2>,
    /// A second set of texture coordinates, for the textures that [`Material::second_uvs`] names; parallel to `positions`, or empty.
    pub second_uvs: Vec<Vec2>,
    /// Places on a light map as the file has them (TEXCOORD_1 of glTF), parallel to `positions`, or empty; [`crate::bake`] checks them
    /// before it uses them. (-1, -1): none.
    pub lightmap_uvs: Vec<Vec2>,
    /// Factors of the base colour at the vertices, linear, each channel in [0, 1]; parallel to `positions`, or empty: all 1.
    pub colors: Vec<Vec3>,
    /// The triangles.
    pub triangles: Vec<Triangle>,
    /// Names of the objects; [`Triangle::object`] indexes them.
    pub objects: Vec<String>,
    /// The materials.
    pub materials: Vec<Material>,
    /// The textures.
    pub textures: Vec<Texture>,
    /// Lights that are not emissive triangles.
    pub lights: Vec<Light>,
    /// Light from all around, infinitely far away.
    pub environment: Option<Arc<Environment>>,
    /// Whether emissive triangles light the scene. False in a file written by [`export_lights`]: its virtual lights hold
    /// all light, also that of the emissive triangles, which are only visible, and all reflected light, so that no particle
    /// starts from them.
    pub emitters_are_lights: bool,
    /// Light kept in textures: the image shows it in place of all virtual lights and photons. The path tracer does not use it.
    pub kept_light: Option<Arc<KeptLight>>,
    /// Mirror images of its planar reflectors, which superposition shows if its settings say so. They hold the light of the scene as it
    /// stands.
    pub mirror_images: Option<Arc<DepthImages>>,
    /// Whether the emission of surfaces is relative to the white of a screen, as in a glTF file that gives no
    /// KHR_materials_emissive_strength: programs that show such files do not light them by it, so a scene without any other light
    /// gets the default sky too.
    pub emission_is_relative: bool,
    /// The files that it was read from.
    pub files: Vec<PathBuf>,
    /// Content of the files that the loader leaves out, for messages.
    pub ignored: Vec<String>,
    /// Camera of the file, if it has one: the first.
    pub camera: Option<Camera>,
    /// All cameras of a glTF file.
    pub cameras: Vec<NamedCamera>,
    /// How the file moves; `None`: it has no animations. They refer to vertices, lights and cameras by index, so that these must stay
    /// in their places for [`Scene::set_pose`].
    pub animations: Option<Arc<Animations>>,
    /// `[render]` of the scene file: defaults that the command line overrides.
    pub render: RenderDefaults,
    /// Levels of the textures, kept for look-ups on the host: see [`Scene::keep_levels`].
    pub levels: Option<Arc<KeptLevels>>,
}

impl Default for Scene {
    fn default() -> Self {
        Scene {
            name: String::new(),
            origin: DVec3::ZERO,
            positions: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            second_uvs: Vec::new(),
            lightmap_uvs: Vec::new(),
            colors: Vec::new(),
            triangles: Vec::new(),
            objects: Vec::new(),
            materials: Vec::new(),
            textures: Vec::new(),
            lights: Vec::new(),
            environment: None,
            emitters_are_lights: true,
            kept_light: None,
            mirror_images: None,
            emission_is_relative: false,
            files: Vec::new(),
            ignored: Vec::new(),
            camera: None,
            cameras: Vec::new(),
            animations: None,
            render: RenderDefaults::default(),
            levels: None,
        }
    }
}

impl Scene {
    /// Corners of triangle `i`.
    pub fn triangle_positions(&self, i: usize) -> [Vec3; 3] {
        self.triangles[i].vertices.map(|v| self.positions[v as usize])
    }

    /// Factor of the base colour at a point of a triangle, by the weights of its corners.
    pub fn color_at(&self, triangle: &Triangle, weights: [f32; 3]) -> Vec3 {
        if self.colors.is_empty() {
            return Vec3::ONE;
        }
        triangle.vertices.iter().zip(weights).map(|(&v, w)| self.colors[v as usize] * w).sum()
    }

    /// Whether some surface in use lets rays pass.
    pub fn has_alpha(&self) -> bool {
        let passes: Vec<bool> = self.materials.iter().map(Material::has_alpha).collect();
        passes.contains(&true) && self.triangles.iter().any(|t| passes[t.material as usize])
    }

    /// Share of rays that a triangle stops at a point, by the weights of its corners.
    pub fn coverage(&self, triangle: &Triangle, weights: [f32; 3]) -> f32 {
        let material = &self.materials[triangle.material as usize];
        if !material.has_alpha() {
            return 1.0;
        }
        let texture = || {
            material.base_texture.map_or(1.0, |texture| {
                let uv = self.uv_at(triangle, weights, TextureUse::Base);
                sample_texture(&self.textures[texture as usize], uv.to_array()).w
            })
        };
        match material.alpha {
            Alpha::Opaque => 1.0,
            Alpha::Mask { opacity, cutoff } => f32::from(opacity * texture() >= cutoff),
            Alpha::Blend { opacity } => opacity * texture(),
        }
    }

    /// Area of triangle `i`.
    pub fn triangle_area(&self, i: usize) -> f32 {
        let [a, b, c] = self.triangle_positions(i);
        0.5 * (b - a).cross(c - a).length()
    }

    /// Minimum and maximum corner of the bounding box of all triangles.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let mut low = Vec3::INFINITY;
        let mut high = Vec3::NEG_INFINITY;
        for i in 0..self.triangles.len() {
            for p in self.triangle_positions(i) {
                low = low.min(p);
                high = high.max(p);
            }
        }
        (low, high)
    }

    /// Length of the diagonal of [`Scene::bounds`].
    pub fn diagonal(&self) -> f32 {
        let (low, high) = self.bounds();
        (high - low).length()
    }

    /// Indices of the emissive triangles that light the scene: without those of sphere lights, which are sampled on the
    /// ideal sphere, and none if virtual lights represent them.
    pub fn emitters(&self) -> Vec<u32> {
        if !self.emitters_are_lights {
            return Vec::new();
        }
        let mut sampled_elsewhere = vec![false; self.objects.len()];
        for light in &self.lights {
            if let Light::Sphere { object, .. } = light {
                sampled_elsewhere[*object as usize] = true;
            }
        }
        let emits = |t: &Triangle| {
            self.materials[t.material as usize].emission.max_element() > 0.0 && !sampled_elsewhere[t.object as usize]
        };
        (0u32..).zip(&self.triangles).filter(|(_, t)| emits(t)).map(|(i, _)| i).collect()
    }

    /// For each material the table of its lobe.
    pub(crate) fn lobes(&self) -> Vec<Option<Arc<Table>>> {
        self.materials.iter().map(|material| material.lobe.clone()).collect()
    }

    /// For each material the mean over RGB of the reflectance kd + F0 that particles see, textures by their average; ideal reflection and
    /// transmission do not count, because they absorb particles.
    pub fn mean_albedos(&self) -> Vec<f32> {
        let averages: Vec<Vec3> = self.textures.iter().map(Texture::average).collect();
        self.materials.iter().map(|material| material.mean_albedo(&averages)).collect()
    }
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
    /// Shade with interpolated vertex normals; else with the face normal.
    pub smooth: bool,
}

/// Addressing of texture coordinates outside [0, 1].
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
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
    /// A virtual light that emits to one side, as written by `--export-lights`: intensity
    /// `power * (d + 1) / (2 pi) * cos(theta)^d`, d the exponent.
    Imported {
        /// Position.
        position: Vec3,
        /// Unit normal.
        normal: Vec3,
        /// Emitted flux, W.
        power: Vec3,
        /// Exponent of the cosine in [1, [`MAX_EXPONENT`](crate::light::cosine::MAX_EXPONENT)]; 1: Lambert.
        exponent: f32,
    },
}

/// A camera: a pinhole, a thin lens, or an orthographic one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Eye point.
    pub eye: Vec3,
    /// Point at the image's centre.
    pub target: Vec3,
    /// Up direction.
    #[serde(default = "Camera::default_up")]
    pub up: Vec3,
    /// Full vertical angle of view, degrees, in (0, 180). Without meaning if `height` is set.
    #[serde(default = "Camera::default_fov")]
    pub fov_y: f32,
    /// Width and height in pixels.
    #[serde(default = "Camera::default_resolution")]
    pub resolution: [u32; 2],
    /// Diameter of the lens in scene units. Default 0: a pinhole. The blur of surfaces out of focus grows in proportion. The
    /// cost of the convolution ([`crate::pass::lens`]) hardly depends on the diameter, except for 0.
    #[serde(default)]
    pub aperture: f32,
    /// Distance of the focal plane from the eye along the viewing direction, scene units. Default `None`: that of `target`.
    #[serde(default)]
    pub focus: Option<f32>,
    /// Time for which the shutter is open, seconds, half of it before the moment that is shown and half after. Default 0: an instant.
    /// The blur of what moves grows in proportion, and so does the cost of its convolution ([`crate::pass::motion_blur`]). The engine is
    /// told what moves meanwhile by [`crate::Engine::set_shutter_ends`].
    #[serde(default)]
    pub shutter: f32,
    /// Height of the image in scene units, in [1e-15, 1e9], of an orthographic camera: its rays are parallel to the direction of view and start in the
    /// plane through `eye` across it, so that what lies behind that plane is not seen. Default `None`: rays start at `eye`. An orthographic
    /// camera has no lens (`aperture` 0), and no mirror images by [`Settings::superposition`](crate::Settings::superposition); depth is the
    /// distance from the plane.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<f32>,
    /// The image on the plane at unit distance (orthographic: at any), where it is not that of `fov_y` or `height`: off-centre, or with pixels that are not square. Default
    /// `None`. [`Camera::from_matrices`] sets it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frustum: Option<Frustum>,
}

/// A camera of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedCamera {
    /// Its name in the file.
    pub name: String,
    /// The camera.
    pub camera: Camera,
}

impl Camera {
    fn default_up() -> Vec3 {
        Vec3::Y
    }
    fn default_resolution() -> [u32; 2] {
        [640, 480]
    }
    /// The angle of a camera that tells none, degrees.
    pub(crate) fn default_fov() -> f32 {
        45.0
    }

    /// Whether its rays are parallel.
    pub fn is_orthographic(&self) -> bool {
        self.height.is_some()
    }

    /// Whether the aperture is above 0: surfaces out of focus are blurred.
    pub fn has_lens(&self) -> bool {
        self.aperture > 0.0
    }

    /// Whether the shutter is open for some time: what moves is blurred.
    pub fn has_shutter(&self) -> bool {
        self.shutter > 0.0
    }

    /// Distance of the focal plane along the viewing direction.
    pub fn focus_distance(&self) -> f32 {
        self.focus.unwrap_or_else(|| (self.target - self.eye).length())
    }

    /// The camera's axes in world space: unit vectors to the image's right, its top and into the scene.
    pub fn world_from_camera(&self) -> (Vec3, Vec3, Vec3) {
        let forward = (self.target - self.eye).normalize();
        let right = forward.cross(self.up).normalize();
        (right, right.cross(forward), forward)
    }
}
