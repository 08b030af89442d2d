//! Reads the images of a host's G-buffer into the [`Records`] of [`g_buffer`](super::g_buffer).
//!
//! Places are told by position, or by depth with the inverse of the matrix from world to clip space:
//!
//! ```text
//! p = M (2 x - 1, 1 - 2 y, z, 1),  divided by its last component      x, y: the centre of the pixel in [0, 1], from the upper left corner
//! ```
//!
//! Normals of formats without signs (UNORM) stand for 2 n - 1, others for themselves.
//!
//! Cost: up to 6 texels read and 96 bytes written a pixel, some 60 operations.

use ash::vk;
use glam::{Mat4, UVec2, Vec2, Vec3, Vec4};

use super::g_buffer::{Record, Records};
use super::layout::GBufferPush;
use super::{BoundKernel, groups};
use crate::error::{Error, Result};
use crate::gpu::{Context, Image, Kernel, Recorder, Resources, shaders};

/// An image of a G-buffer and the layout that it has before and after it is read.
#[derive(Clone, Copy)]
pub struct GivenImage<'a> {
    /// Made by [`Image::adopt_to_read`], of the view's size.
    pub image: &'a Image,
    /// Its layout, in which it is left.
    pub layout: vk::ImageLayout,
}

/// Where the surfaces of a G-buffer are.
#[non_exhaustive]
#[derive(Clone, Copy)]
pub enum Place<'a> {
    /// Positions relative to [`crate::Scene::origin`], in R32G32B32A32_SFLOAT; w: above 0 where a surface is seen. Half floats are too coarse
    /// for shadow rays.
    Positions(GivenImage<'a>),
    /// Depths in D32_SFLOAT or R32_SFLOAT.
    Depths {
        /// The depths, of any range, reversed or not.
        depths: GivenImage<'a>,
        /// From clip space, whose y axis points up, to positions relative to [`crate::Scene::origin`]: the inverse of projection times view, as
        /// [`crate::Camera::from_matrices`] takes them.
        world_from_clip: Mat4,
        /// The depth of pixels that see nothing: the value that the image is cleared with.
        background: f32,
    },
}

/// A G-buffer of a host: one sample at the centre of each pixel, rows from the top.
#[derive(Clone, Copy)]
pub struct GBufferImages<'a> {
    /// Where the surfaces are.
    pub place: Place<'a>,
    /// Shading normals in world space, of any length: [`NORMAL_FORMATS`].
    pub normal: GivenImage<'a>,
    /// Geometric normals likewise. `None`: those of shading stand for them, at the price of shadows at the horizon of rounded surfaces.
    pub geometric_normal: Option<GivenImage<'a>>,
    /// Diffuse albedo, linear Rec. 709 (formats of sRGB are converted by the device); of metals 0: [`COLOR_FORMATS`].
    pub albedo: GivenImage<'a>,
    /// Specular reflectance at normal incidence; alpha: roughness in [0, 1], whose square is the alpha of the GGX lobe: [`COLOR_FORMATS`] but
    /// B10G11R11_UFLOAT_PACK32, which has no alpha. `None`: all surfaces are matte.
    pub specular: Option<GivenImage<'a>>,
    /// Emitted radiance, W/(m^2 sr): [`COLOR_FORMATS`]. `None`: lamps are black where they are seen.
    pub emission: Option<GivenImage<'a>>,
    /// By which points are moved along their geometric normals, scene units: the error of the host's positions, or 0. Without it, points that
    /// lie below the triangles of the engine's scene are in their shadow.
    pub offset: f32,
}

/// Formats of normals.
pub const NORMAL_FORMATS: [vk::Format; 7] = [
    vk::Format::R32G32B32A32_SFLOAT,
    vk::Format::R16G16B16A16_SFLOAT,
    vk::Format::R16G16B16A16_SNORM,
    vk::Format::R16G16B16A16_UNORM,
    vk::Format::R8G8B8A8_SNORM,
    vk::Format::R8G8B8A8_UNORM,
    vk::Format::A2B10G10R10_UNORM_PACK32,
];

/// Formats of reflectance and emission.
pub const COLOR_FORMATS: [vk::Format; 8] = [
    vk::Format::R32G32B32A32_SFLOAT,
    vk::Format::R16G16B16A16_SFLOAT,
    vk::Format::R8G8B8A8_UNORM,
    vk::Format::R8G8B8A8_SRGB,
    vk::Format::B8G8R8A8_UNORM,
    vk::Format::B8G8R8A8_SRGB,
    vk::Format::A2B10G10R10_UNORM_PACK32,
    vk::Format::B10G11R11_UFLOAT_PACK32,
];

/// Formats of depths.
pub const DEPTH_FORMATS: [vk::Format; 2] = [vk::Format::D32_SFLOAT, vk::Format::R32_SFLOAT];

/// Whether normals of a format are stored in [0, 1].
fn counts_from_0(format: vk::Format) -> bool {
    use vk::Format as F;
    matches!(format, F::R16G16B16A16_UNORM | F::R8G8B8A8_UNORM | F::A2B10G10R10_UNORM_PACK32)
}

impl<'a> GBufferImages<'a> {
    /// Each image once, with its name and the formats that it may have.
    fn named(&self) -> Vec<(&'static str, GivenImage<'a>, &'static [vk::Format])> {
        let place = match self.place {
            Place::Positions(image) => ("positions", image, &NORMAL_FORMATS[..1]),
            Place::Depths { depths, .. } => ("depths", depths, &DEPTH_FORMATS[..]),
        };
        let optional = [
            ("geometric normals", self.geometric_normal, &NORMAL_FORMATS[..]),
            ("specular reflectance", self.specular, &COLOR_FORMATS[..COLOR_FORMATS.len() - 1]),
            ("emission", self.emission, &COLOR_FORMATS[..]),
        ];
        let optional = optional.into_iter().filter_map(|(what, image, formats)| Some((what, image?, formats)));
        let always =
            [place, ("normals", self.normal, &NORMAL_FORMATS[..]), ("albedo", self.albedo, &COLOR_FORMATS[..])];
        always.into_iter().chain(optional).collect()
    }

    /// Errors: an image of another size than the view, of a format that does not hold its numbers, or without a layout; a matrix or an offset
    /// that is not finite.
    pub fn check(&self, [width, height]: [u32; 2]) -> Result<()> {
        for (what, GivenImage { image, layout }, formats) in self.named() {
            let misuse = |message: String| Err(Error::Resource { name: image.name().to_owned(), message });
            if [image.width(), image.height()] != [width, height] {
                let size = format!("{}x{}", image.width(), image.height());
                return misuse(format!("has {size} pixels of {what}, but the view has {width}x{height}"));
            }
            if !formats.contains(&image.format()) {
                return misuse(format!("{:?} holds no {what}; take one of {formats:?}", image.format()));
            }
            if matches!(layout, vk::ImageLayout::UNDEFINED | vk::ImageLayout::PREINITIALIZED) {
                return misuse(format!("is read in the layout {layout:?}, in which it holds nothing"));
            }
        }
        let refuse = |message: String| Err(Error::Resource { name: String::from("G-buffer"), message });
        if let Place::Depths { world_from_clip, background, .. } = self.place
            && (!world_from_clip.is_finite() || world_from_clip.determinant() == 0.0 || !background.is_finite())
        {
            return refuse(format!(
                "the matrix from clip space, {world_from_clip}, is not finite or singular, or the background {background} is not finite"
            ));
        }
        if !self.offset.is_finite() {
            return refuse(format!("points are moved by {}, which is not finite", self.offset));
        }
        Ok(())
    }

    fn push(&self) -> GBufferPush {
        let (world_from_clip, background, by_depth) = match self.place {
            Place::Positions(_) => (Mat4::IDENTITY, 0.0, 0),
            Place::Depths { world_from_clip, background, .. } => (world_from_clip, background, GBufferPush::BY_DEPTH),
        };
        let bit = |set: bool, bit: u32| if set { bit } else { 0 };
        let from_0 = |image: GivenImage| counts_from_0(image.image.format());
        GBufferPush {
            world_from_clip: world_from_clip.to_cols_array_2d(),
            background,
            offset: self.offset,
            bits: by_depth
                | bit(self.geometric_normal.is_some(), GBufferPush::HAS_GEOMETRIC)
                | bit(self.specular.is_some(), GBufferPush::HAS_SPECULAR)
                | bit(self.emission.is_some(), GBufferPush::HAS_EMISSION)
                | bit(from_0(self.normal), GBufferPush::NORMALS_FROM_0)
                | bit(self.geometric_normal.is_some_and(from_0), GBufferPush::GEOMETRIC_FROM_0),
            unused: 0,
        }
    }

    /// Records the reading of the images, which were checked, into `records` of their size. Waits for all earlier commands of the queue, and
    /// leaves the images in their layouts.
    pub fn record(&self, context: &Context, rec: &mut Recorder, records: &Records) -> Result<()> {
        let place = match self.place {
            Place::Positions(image) | Place::Depths { depths: image, .. } => image,
        };
        let images = [
            ("place_image", place),
            ("normal_image", self.normal),
            ("geometric_image", self.geometric_normal.unwrap_or(self.normal)),
            ("albedo_image", self.albedo),
            ("specular_image", self.specular.unwrap_or(self.albedo)),
            ("emission_image", self.emission.unwrap_or(self.albedo)),
        ];
        let bound = images.iter().fold(Resources::new(), |set, (name, given)| set.with_image(name, given.image));
        let kernel = Kernel::new(context, &shaders::G_BUFFER_READ)?
            .bind_from(&[&bound, &records.resources()], &Resources::new())?;
        // An image that stands for several is brought there and back once.
        let mut distinct: Vec<GivenImage> = Vec::new();
        for (_, given, _) in self.named() {
            if distinct.iter().all(|other| other.image.handle() != given.image.handle()) {
                distinct.push(given);
            }
        }
        let general = vk::ImageLayout::GENERAL;
        distinct.iter().try_for_each(|given| rec.change_layout(given.image, given.layout, general))?;
        rec.scope("g_buffer_read", |rec| {
            BoundKernel(kernel).run(
                rec,
                bytemuck::bytes_of(&self.push()),
                groups(place.image.width() * place.image.height()),
            )
        })?;
        distinct.iter().try_for_each(|given| rec.change_layout(given.image, general, given.layout))
    }
}

/// Texels of a pixel, for the oracle; those of images that are not given are `None`.
#[derive(Clone, Copy, Debug)]
pub struct Texels {
    /// Position, or depth in x.
    pub place: Vec4,
    /// Shading normal, with its sign.
    pub normal: Vec3,
    /// Geometric normal, with its sign.
    pub geometric_normal: Option<Vec3>,
    /// Albedo.
    pub albedo: Vec3,
    /// Specular reflectance and roughness.
    pub specular: Option<Vec4>,
    /// Emission.
    pub emission: Option<Vec3>,
}

/// Oracle: the record of a pixel. `depth`: matrix and background if places are told by depth.
pub fn reference(texels: &Texels, at: UVec2, size: UVec2, depth: Option<(Mat4, f32)>, offset: f32) -> Record {
    let side = texels.geometric_normal.unwrap_or(texels.normal);
    let (position, seen) = match depth {
        None => (texels.place.truncate(), texels.place.w > 0.0),
        Some((world_from_clip, background)) => {
            let centre = (at.as_vec2() + 0.5) / size.as_vec2();
            let clip = Vec2::new(2.0 * centre.x - 1.0, 1.0 - 2.0 * centre.y);
            let p = world_from_clip.as_dmat4() * clip.extend(texels.place.x).extend(1.0).as_dvec4();
            ((p.truncate() / p.w).as_vec3(), texels.place.x != background)
        }
    };
    Record {
        position: (position + side.normalize_or_zero() * offset).extend(if seen { 1.0 } else { 0.0 }),
        normal: texels.normal.extend(texels.specular.map_or(1.0, |s| s.w)),
        geometric_normal: side,
        albedo: texels.albedo,
        specular: texels.specular.map_or(Vec3::ZERO, Vec4::truncate),
        emission: texels.emission.unwrap_or(Vec3::ZERO),
    }
}
