//! Settings of superposition: glossy planes, and where their mirror images come from.

use serde::{Deserialize, Serialize};

use crate::pass::convolve::Form;
use crate::scene::reflectors::MAX_REFLECTORS;

/// Convolution of the mirror image of a glossy plane (Bastos 1999, section 7.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Spread {
    /// None: every glossy plane is a mirror.
    Mirror,
    /// One kernel of fixed width for the whole image: the blur does not depend on the distance from the plane.
    Invariant,
    /// The material's kernel, wider for reflected points farther away.
    #[default]
    Variant,
}

/// Directional reflectance of mirrors and of the mirror images of glossy planes (Bastos 1999, section 6.7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reflectance {
    /// Schlick's approximation, of glossy planes times the lobe's energy, as for point lights.
    #[default]
    Schlick,
    /// A table over directions of the Fresnel term, fitted to the reflectance at normal incidence. Textures of base colour
    /// and metallic enter with their mean. Mirrors, and glossy planes within mirror images, take the equations themselves.
    Map,
    /// The same Fresnel term evaluated at each pixel.
    Fresnel,
}

/// Value of the key `mirror_source`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MirrorForm {
    /// A mirrored ray for each pixel.
    Rays,
    /// Images with depth, and rays where they have holes.
    Images,
}

/// Which images with depth fit a mirrored view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImageChoice {
    /// Those with the least angle between their view direction and the mirrored one.
    #[default]
    Angle,
    /// Those whose centres of projection are nearest to the mirrored eye. As good far from the mirror, worse near the hemispheres.
    Distance,
}

/// The images with depth that a frame merges.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MirrorImages {
    /// Choice of the images. Default `Angle`.
    pub choice: ImageChoice,
    /// Images of each hemisphere in view. Default 2; 1 to 256. More: fewer holes, and the time of reprojection in proportion.
    pub merged: u32,
}

impl Default for MirrorImages {
    fn default() -> Self {
        MirrorImages { choice: ImageChoice::default(), merged: 2 }
    }
}

/// Where the mirror image of a glossy plane comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MirrorSource {
    /// A mirrored ray for each pixel, whose hit point gets the full light of the pass.
    #[default]
    Rays,
    /// Images with depth ([`crate::scene::Scene::mirror_images`]), and rays where they have holes (Bastos 1999, section 6.6). Biased: they
    /// hold diffuse light as it was when they were made.
    Images(MirrorImages),
}

/// Superposition (Bastos 1999): a glossy plane that the eye sees directly shows its lit base plus the mirror image of the room,
/// convolved with the kernel of its material. Without it eye paths follow the lobes of glossy planes, as of other glossy surfaces
/// (`glossy_paths`): without the kernel's bias, and sooner on a processor, but a single frame shows separate reflections.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Superposition {
    /// Convolution. Default `Variant`. `Mirror` and `Invariant` are for comparison, and cost less.
    pub spread: Spread,
    /// Keep the blurred image of far surfaces from bleeding over sharp near ones. Default true. False is the algorithm of
    /// the thesis, which is a little faster.
    pub occlusion: bool,
    /// Diameter in pixels of the first reflector's kernel with `Invariant`; those of others are wider or narrower as their lobes are at
    /// normal incidence. Default 15; 0 to 4096.
    pub kernel_width: u32,
    /// Algorithm of the convolution. Default `Auto`: direct for narrow kernels, else fast. Direct takes the sum as stated, for comparison; its time
    /// grows with the square of the widths.
    pub form: Form,
    /// Number of reflectors that mirror the room, the largest planes first, then the largest curved surfaces. Default 255, the maximum; fewer cost less. The
    /// others are glossy surfaces like any other.
    pub reflectors: u32,
    /// Source of the mirror image. Default `Rays`.
    pub mirror_source: MirrorSource,
}

impl Default for Superposition {
    fn default() -> Self {
        Superposition {
            spread: Spread::default(),
            occlusion: true,
            kernel_width: 15,
            form: Form::default(),
            reflectors: MAX_REFLECTORS as u32,
            mirror_source: MirrorSource::default(),
        }
    }
}
