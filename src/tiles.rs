//! Images too large for a device's buffers, rendered strip by strip.
//!
//! A strip is a region of the image as wide as the image ([`crate::view`]). Each is rendered with all its passes before
//! the next, bit for bit as in the whole image. Features that need the whole image are refused: superposition, a lens,
//! the choice of emitters by contribution.

use crate::device_scene::SpecularFeatures;
use crate::error::Result;
use crate::gpu::DeviceInfo;
use crate::output::Layers;
use crate::plan::EyePlan;
use crate::scene::{Camera, Scene};
use crate::settings::Settings;
use crate::standalone::Renderer;
use crate::view::{Region, View};

/// Bytes of the largest element that a view has for each slot.
const SLOT_BYTES: u64 = 16;

/// The strips of an image from top to bottom, such that the buffers of each fit the device's bindings; a single one if
/// the whole image fits.
pub fn strips(info: &DeviceInfo, scene: &Scene, camera: &Camera, settings: &Settings) -> Vec<Region> {
    let specular = SpecularFeatures::of(scene, &scene.reflectors());
    let eye = EyePlan::new(settings, specular, &View::whole(*camera));
    let slots = info.max_storage_buffer_range / SLOT_BYTES / u64::from(eye.slots_of_pixel);
    cut(camera.resolution, settings, slots)
}

/// Strips of at most `pixels` pixels each, including the apron of the filter, unless a single row of blocks has more.
pub fn cut([width, height]: [u32; 2], settings: &Settings, pixels: u64) -> Vec<Region> {
    let image = [width, height];
    if u64::from(width) * u64::from(height) <= pixels {
        return vec![Region::whole(image)];
    }
    let block = 8 * settings.pattern[1];
    let strip = |first: u32, rows: u32| Region { origin: [0, first], size: [width, rows.min(height - first)] };
    // The tallest strips of whole blocks that fit with their aprons.
    let fits = |rows: &u32| {
        let mut strips = (0..height).step_by(*rows as usize).map(|first| strip(first, *rows));
        strips.all(|strip| strip.around(settings, image).pixels() <= pixels)
    };
    let rows = (1..=height.div_ceil(block)).rev().map(|n| n * block).find(fits).unwrap_or(block);
    (0..height).step_by(rows as usize).map(|first| strip(first, rows)).collect()
}

/// Renders `passes` passes of each strip and appends the strips to `image`, which holds those of an earlier call that ended by an error, or
/// none. `done` receives the number of passes of all strips so far; if it returns false the rendering ends early, and so does this with
/// false.
pub fn render(
    renderer: &mut Renderer,
    strips: &[Region],
    passes: u32,
    image: &mut Layers,
    mut done: impl FnMut(u32) -> bool,
) -> Result<bool> {
    for (i, &strip) in (0..).zip(strips) {
        if strip.origin[1] < image.height {
            continue;
        }
        renderer.set_crop(Some(strip))?;
        for pass in 0..passes {
            if !done(i * passes + pass) {
                return Ok(false);
            }
            renderer.pass()?;
        }
        image.append_rows(renderer.layers()?);
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_cover_the_image_within_the_limit() {
        let alone = Settings { light_pool: 0, ..Settings::interactive() };
        let small = [([640, 480], 50_000), ([100, 1000], 9_000), ([7, 3], 100), ([301, 211], 30_000)];
        // Clusters choose lights from regions of 96 x 96 pixels, of which a strip needs up to three rows.
        let of_regions = [([640, 480], 200_000), ([100, 1000], 30_000), ([7, 3], 100), ([301, 411], 90_000)];
        for (settings, images) in [(Settings::plain(), small), (alone, small), (Settings::interactive(), of_regions)] {
            for (image, pixels) in images {
                let strips = cut(image, &settings, pixels);
                let mut next = 0;
                for strip in &strips {
                    assert_eq!((strip.origin, strip.size[0]), ([0, next], image[0]));
                    assert!(strip.around(&settings, image).pixels() <= pixels, "{strip:?}");
                    next += strip.size[1];
                }
                assert_eq!(next, image[1]);
                assert_eq!(strips.len() == 1, u64::from(image[0] * image[1]) <= pixels);
            }
        }
        // A row of blocks is the minimum.
        assert_eq!(cut([640, 480], &Settings::plain(), 1).len(), 60);
    }
}
