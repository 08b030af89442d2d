//! Length of eye paths, of lit points and of pixels that take their light.

use super::lit_size;
use crate::device_scene::SpecularFeatures;
use crate::settings::{MirrorImages, Settings};
use crate::view::View;

/// Length of eye paths, and the slots that they need.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EyePlan {
    /// Lit pixels ([`Plan::lit_size`](super::Plan::lit_size)).
    pub pixels: u32,
    /// Maximum consecutive mirrors and glass surfaces.
    pub steps: u32,
    /// Components of each pixel that are filtered and shown: 2 if paths are split.
    pub components: u32,
    /// Slots of each pixel: one for each of these components, and one for the third component where paths may split twice.
    pub slots_of_pixel: u32,
    /// Whether they may meet mirrors without a diffuse base.
    pub plain_mirrors: bool,
    /// Whether glossy planes mirror the room.
    pub mirrors: bool,
    /// Whether some of these planes are frosted panes, which show the scene behind them.
    pub panes: bool,
    /// Whether some of them are curved surfaces.
    pub curved: bool,
    /// Images with depth that show what glossy planes mirror; `None`: rays do.
    pub images: Option<MirrorImages>,
    /// Whether paths follow narrow specular lobes.
    pub lobes: bool,
}

/// Maximum number of lobes, mirrors and glass on an eye path in a scene without mirrors and glass.
const MAX_LOBES: u32 = 3;

/// Largest image whose paths have third components, pixels: an array of 16 bytes a slot then fits the smallest storage buffer that Vulkan
/// allows a device to have.
pub const MAX_PIXELS_OF_THREE: u64 = (1 << 27) / 16 / 3;

impl EyePlan {
    /// For a scene with these surfaces. The texels of an atlas and the pixels of a host are shaded as they are: only camera paths follow
    /// mirrors.
    pub fn new(settings: &Settings, specular: SpecularFeatures, view: &View) -> EyePlan {
        let [width, height] = lit_size(settings, view);
        let pixels = width * height;
        let View::Camera { camera, .. } = view else {
            return EyePlan::of_first_hits(pixels);
        };
        let spreads = settings.mirroring_planes() > 0;
        let mirrors = specular.spreads() && spreads;
        let panes = specular.frosted_panes && spreads;
        let curved = specular.curved && spreads;
        let lobes = specular.shiny && settings.glossy_paths && settings.max_depth > 1 && settings.max_specular > 0;
        let steps = match (specular.any || mirrors, lobes) {
            (true, _) => settings.max_specular,
            (false, true) => settings.max_specular.min(MAX_LOBES),
            (false, false) => 0,
        };
        let splits = settings.split && (specular.splits || mirrors || lobes) && steps > 0;
        let plain_mirrors = specular.plain_mirrors && steps > 0;
        let images = settings.mirror_images().filter(|_| mirrors);
        let components = if splits { 2 } else { 1 };
        // A part of an image splits as the whole does.
        let [across, down] = camera.resolution.map(|n| u64::from(n.div_ceil(settings.shading_rate)));
        let again = splits && specular.glass && steps > 1 && across * down <= MAX_PIXELS_OF_THREE;
        let slots_of_pixel = components + u32::from(again);
        EyePlan { pixels, steps, components, slots_of_pixel, plain_mirrors, mirrors, panes, curved, images, lobes }
    }

    /// Paths that end at the first hit.
    fn of_first_hits(pixels: u32) -> EyePlan {
        EyePlan {
            pixels,
            steps: 0,
            components: 1,
            slots_of_pixel: 1,
            plain_mirrors: false,
            mirrors: false,
            panes: false,
            curved: false,
            images: None,
            lobes: false,
        }
    }

    /// For pixels that take the light of points which `lit` sees; `None`: all are lit. Where paths follow lobes, or planes mirror the room, or one
    /// component of two is chosen, they end at the first hit.
    pub(super) fn of_pixels(
        settings: &Settings,
        specular: SpecularFeatures,
        view: &View,
        lit: EyePlan,
    ) -> Option<EyePlan> {
        if settings.shading_rate == 1 {
            return None;
        }
        let all = EyePlan::new(&Settings { shading_rate: 1, ..settings.clone() }, specular, view);
        let follows = lit.components == 2 && !lit.lobes && !lit.mirrors && all.slots_of_pixel == lit.slots_of_pixel;
        Some(if follows { all } else { EyePlan::of_first_hits(all.pixels) })
    }

    /// Slots of all shading points of the eye.
    pub fn slots(&self) -> u32 {
        self.pixels * self.slots_of_pixel
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Camera;
    use crate::view::Region;

    #[test]
    fn only_images_with_glass_have_third_components_and_parts_have_those_of_the_whole() {
        let camera = crate::scene::builtin::furnace(0.5, 1.0).camera.expect("the room has one");
        let view = |resolution| View::whole(Camera { resolution, ..camera });
        let glass = SpecularFeatures { any: true, splits: true, glass: true, ..SpecularFeatures::default() };
        let slots = |settings: &Settings, features: SpecularFeatures, view: &View| {
            let eye = EyePlan::new(settings, features, view);
            (eye.components, eye.slots_of_pixel)
        };
        let defaults = Settings::plain();
        assert_eq!(slots(&defaults, glass, &view([640, 480])), (2, 3));
        assert_eq!(slots(&defaults, SpecularFeatures { glass: false, ..glass }, &view([640, 480])), (2, 2));
        assert_eq!(slots(&Settings { split: false, ..defaults.clone() }, glass, &view([640, 480])), (1, 1));
        // A path of one step has no second surface.
        assert_eq!(slots(&Settings { max_specular: 1, ..defaults.clone() }, glass, &view([640, 480])), (2, 2));
        let large = [1 << 12, 1 << 11];
        assert!(u64::from(large[0] * large[1]) > MAX_PIXELS_OF_THREE);
        assert_eq!(slots(&defaults, glass, &view(large)), (2, 2));
        let part = View::Camera {
            camera: Camera { resolution: large, ..camera },
            region: Region { origin: [0, 0], size: [64, 64] },
        };
        assert_eq!(slots(&defaults, glass, &part), (2, 2));
    }

    #[test]
    fn pixels_follow_mirrors_and_glass_where_no_lobe_does() {
        let camera = crate::scene::builtin::furnace(0.5, 1.0).camera.expect("the room has one");
        let view = View::whole(Camera { resolution: [101, 67], ..camera });
        let glass = SpecularFeatures { any: true, splits: true, glass: true, ..SpecularFeatures::default() };
        let shiny = SpecularFeatures { shiny: true, ..glass };
        let slots = |settings: &Settings, features| {
            let lit = EyePlan::new(settings, features, &view);
            let pixels = EyePlan::of_pixels(settings, features, &view, lit)?;
            assert_eq!((lit.pixels, pixels.pixels), (51 * 34, 101 * 67));
            Some((pixels.steps, pixels.slots_of_pixel))
        };
        let half = Settings { shading_rate: 2, ..Settings::default() };
        assert_eq!(slots(&Settings::default(), glass), None);
        assert_eq!(slots(&half, glass), Some((half.max_specular, 3)));
        for (settings, features) in [
            (half.clone(), shiny),
            (half.clone(), SpecularFeatures::default()),
            (Settings { split: false, ..half.clone() }, glass),
        ] {
            assert_eq!(slots(&settings, features), Some((0, 1)));
        }
        assert_eq!(slots(&Settings { glossy_paths: false, ..half.clone() }, shiny), Some((half.max_specular, 3)));
    }
}
