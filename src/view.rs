//! The entries to compute light for: the pixels of a camera, a region of them, or an atlas of texels on surfaces.
//!
//! A view yields shading points, one or two for each of its entries, row by row; everything after the eye paths works
//! on shading points, whatever their origin.
//!
//! A **region** of a camera is rendered bit for bit as in the whole image. It starts on the borders of screen blocks
//! ([`Region::around`]), so that clusters and classes of pixels are those of the whole image, and random numbers depend
//! on the pixel's position in the whole image.
//!
//! An **atlas** has a point on a triangle for each texel, seen along its normal from the front or from the back. 8 x 8 texels form a
//! cluster, as pixels do.

use std::fmt::Debug;
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::pass::light_regions::REGION;
use crate::pass::sparse_windows;
use crate::scene::Camera;
use crate::settings::{Compensation, LightChoice, Settings};

/// Pixels beyond two windows one after the other: guides read one pixel further, and the filter's bias is told by two on each side.
const APRON: u32 = 3;
/// Pixels that light crosses around sparse windows.
const SPARSE_APRON: u32 = (sparse_windows::STEPS[0] + sparse_windows::STEPS[1]) as u32;
/// Lit pixels beyond a pixel that may lend it light.
const UPSAMPLE_APRON: u32 = 2;
/// Pixels on all sides for the tiles whose edges decide how many rays they get.
const EDGE_APRON: u32 = 9;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Region {
    /// Its upper left pixel, x to the right, y down.
    pub origin: [u32; 2],
    /// Width and height.
    pub size: [u32; 2],
}

impl Region {
    /// All pixels of an image.
    pub fn whole(size: [u32; 2]) -> Region {
        Region { origin: [0, 0], size }
    }

    /// The smallest region around this one whose pixels, rendered alone, have the bits of the whole image: with an
    /// apron for the filter and for edges, and on the borders of blocks of 8 x 8 pixels of each class, or of regions that choose lights.
    pub fn around(&self, settings: &Settings, image: [u32; 2]) -> Region {
        let chooses = settings.light_pool > 0;
        let span = |axis: usize| {
            let rate = settings.shading_rate;
            let of_filter = settings.filter.map_or(0, |filter| {
                let sparse = if filter.has_sparse() { SPARSE_APRON } else { 0 };
                filter.window(settings.pattern)[axis] / 2 * 2 + sparse + APRON
            });
            let of_lit = of_filter + if rate > 1 { UPSAMPLE_APRON } else { 0 };
            let apron = rate * of_lit + if settings.antialias { EDGE_APRON } else { 0 };
            let block = if chooses { REGION } else { 1 } * 8 * settings.pattern[axis] * rate;
            let first = self.origin[axis].saturating_sub(apron) / block * block;
            let end = (self.origin[axis] + self.size[axis] + apron).div_ceil(block) * block;
            (first, end.min(image[axis]) - first)
        };
        let [(x, width), (y, height)] = [span(0), span(1)];
        Region { origin: [x, y], size: [width, height] }
    }

    /// Errors: it is empty, or extends beyond an image of this size.
    pub fn check(&self, image: [u32; 2]) -> Result<()> {
        let inside = |axis: usize| {
            let end = u64::from(self.origin[axis]) + u64::from(self.size[axis]);
            self.size[axis] > 0 && end <= u64::from(image[axis])
        };
        if inside(0) && inside(1) {
            return Ok(());
        }
        let ([x, y], [width, height], [w, h]) = (self.origin, self.size, image);
        let message = format!("{width}x{height} pixels at {x},{y} are empty or reach beyond the image of {w}x{h}");
        Err(Error::Setting { name: "--crop", message })
    }

    /// Number of pixels.
    pub fn pixels(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1])
    }
}

/// A part of the pixels of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Task {
    /// Within this region of the view.
    pub region: Region,
    /// Of this class of the interleaving pattern; `None`: of all.
    pub class: Option<u32>,
}

impl Task {
    /// Cuts an image of this size into at least `count` parts, if it has as many: bands of rows, then by class, class by class. Bands begin where blocks of
    /// pixels do, so that their pixels have the bits of the whole image. Where near light comes from other pixels, which are always of
    /// the same class, there is a part for each class.
    pub fn cut(settings: &Settings, [width, height]: [u32; 2], count: u32) -> Vec<Task> {
        let block = if settings.light_pool > 0 { REGION } else { 1 } * 8 * settings.pattern[1];
        let classes = settings.classes();
        let blocks = height.div_ceil(block);
        let parts = if Task::needs_class(settings) { 1 } else { count.div_ceil(classes).clamp(1, blocks) };
        let rows = block * (blocks / parts);
        let bands =
            (0..height).step_by(rows as usize).map(|y| Region { origin: [0, y], size: [width, rows.min(height - y)] });
        let bands: Vec<Region> = bands.collect();
        (0..classes).flat_map(|class| bands.iter().map(move |&region| Task { region, class: Some(class) })).collect()
    }

    /// Whether pixels depend on others of their class.
    fn needs_class(settings: &Settings) -> bool {
        settings.compensation == Compensation::Near && settings.clips()
    }

    /// Errors: it is empty, extends beyond an image of this size, or has some pixels of a class that depend on others.
    pub fn check(&self, settings: &Settings, image: [u32; 2]) -> Result<()> {
        self.region.check(image)?;
        if !Task::needs_class(settings) || self.region == Region::whole(image) {
            return Ok(());
        }
        let message = String::from("--compensation near looks at all pixels of a class; give them out as one task");
        Err(Error::Setting { name: "--cluster-tasks", message })
    }

    /// Whether a pixel belongs to it.
    pub fn has(&self, [x, y]: [u32; 2], [across, down]: [u32; 2]) -> bool {
        let Region { origin, size } = self.region;
        let inside = |at: u32, axis: usize| at >= origin[axis] && at - origin[axis] < size[axis];
        inside(x, 0) && inside(y, 1) && self.class.is_none_or(|class| x % across + across * (y % down) == class)
    }
}

/// A point of an atlas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    /// Index of the triangle in [`crate::Scene::triangles`].
    pub triangle: u32,
    /// Weights of its second and third vertex.
    pub uv: [f32; 2],
    /// Seen from the back of the triangle, else from its front.
    pub back: bool,
}

/// Texels whose points move from pass to pass.
pub trait Moving: Send + Sync + Debug {
    /// The texels of a pass, as many as the atlas has, and on surfaces where those of the atlas are.
    fn texels(&self, pass: u32) -> Vec<Option<Texel>>;
}

/// Texels on the surfaces of a scene.
#[derive(Clone, Debug)]
pub struct Atlas {
    /// Width and height.
    pub size: [u32; 2],
    /// The texels, row by row; `None` is on no surface and stays black.
    pub texels: Vec<Option<Texel>>,
    /// Where they lie in each pass; `None`: they stay.
    pub moving: Option<Arc<dyn Moving>>,
}

impl Atlas {
    /// Texels that stay.
    pub fn new(size: [u32; 2], texels: Vec<Option<Texel>>) -> Atlas {
        Atlas { size, texels, moving: None }
    }
}

impl PartialEq for Atlas {
    fn eq(&self, other: &Atlas) -> bool {
        let moving = match (&self.moving, &other.moving) {
            (None, None) => true,
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            _ => false,
        };
        moving && self.size == other.size && self.texels == other.texels
    }
}

/// A camera, an atlas, or a G-buffer of a host.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum View {
    /// A region of the pixels of a camera.
    Camera {
        /// The camera, with the resolution of the whole image.
        camera: Camera,
        /// The pixels to render.
        region: Region,
    },
    /// Texels on surfaces.
    Atlas(Arc<Atlas>),
    /// The surfaces that the host itself found at the centres of all pixels of its camera ([`crate::Engine::record_g_buffer`]).
    GBuffer {
        /// The host's camera, with the resolution of its images.
        camera: Camera,
    },
}

impl View {
    /// All pixels of a camera.
    pub fn whole(camera: Camera) -> View {
        View::Camera { camera, region: Region::whole(camera.resolution) }
    }

    /// Width and height in entries: pixels or texels.
    pub fn size(&self) -> [u32; 2] {
        match self {
            View::Camera { region, .. } => region.size,
            View::Atlas(atlas) => atlas.size,
            View::GBuffer { camera } => camera.resolution,
        }
    }

    /// Position in the whole image, and the whole image's width and height.
    pub fn within(&self) -> Region {
        match self {
            View::Camera { camera, region } => Region { origin: region.origin, size: camera.resolution },
            View::Atlas(atlas) => Region::whole(atlas.size),
            View::GBuffer { camera } => Region::whole(camera.resolution),
        }
    }

    /// The camera; `None` for an atlas.
    pub fn camera(&self) -> Option<&Camera> {
        match self {
            View::Camera { camera, .. } | View::GBuffer { camera } => Some(camera),
            View::Atlas(_) => None,
        }
    }

    /// The same with another camera of its resolution; in place of texels the whole image of the camera.
    pub fn with_camera(&self, camera: Camera) -> View {
        match *self {
            View::Camera { region, .. } => View::Camera { camera, region },
            View::Atlas(_) => View::whole(camera),
            View::GBuffer { .. } => View::GBuffer { camera },
        }
    }

    /// Whether a host finds what it shows.
    pub fn is_g_buffer(&self) -> bool {
        matches!(self, View::GBuffer { .. })
    }

    /// Errors: its pixels cannot be shaded task by task.
    pub fn check_tasks(&self, settings: &Settings) -> Result<()> {
        let why = match self {
            View::Atlas(_) => Some("texels are not shaded by several ranks"),
            View::GBuffer { .. } => Some("the pixels of a host's G-buffer are not shaded by several ranks"),
            View::Camera { .. } => match settings {
                Settings { shading_rate: 2.., .. } => Some("--shading-rate lights the pixels of no class alone"),
                Settings { ring: Some(_), .. } => Some("a ring keeps light from pass to pass"),
                Settings { soft_shadows: Some(_), .. } => Some("soft shadows are convolved over the whole image"),
                Settings { light_choice: LightChoice::Contribution, .. } => {
                    Some("--light-choice contribution looks at the whole image")
                }
                _ => None,
            },
        };
        match why {
            None => Ok(()),
            Some(why) => Err(Error::Setting {
                name: "--cluster-tasks",
                message: format!("{why}; give out frames instead of tiles"),
            }),
        }
    }

    /// Whether it shows a part of a larger image.
    pub fn is_part(&self) -> bool {
        self.size() != self.within().size
    }

    /// Whether a lens blurs it.
    pub fn has_lens(&self) -> bool {
        self.camera().is_some_and(Camera::has_lens)
    }

    /// Whether its eye rays are parallel.
    pub fn is_orthographic(&self) -> bool {
        self.camera().is_some_and(Camera::is_orthographic)
    }

    /// Whether its shutter is open for some time.
    pub fn has_shutter(&self) -> bool {
        self.camera().is_some_and(Camera::has_shutter)
    }

    /// Checks it against the settings. Errors: an empty view, a region outside its image or not on the borders of
    /// blocks, a combination whose result would depend on pixels outside the region.
    pub fn check(&self, settings: &Settings) -> Result<()> {
        let resolution = |message: String| Error::Setting { name: "--resolution", message };
        let [width, height] = self.size();
        if width == 0 || height == 0 || u64::from(width) * u64::from(height) > MAX_PIXELS {
            return Err(resolution(format!("{width}x{height} is empty or has more than {MAX_PIXELS} pixels")));
        }
        let refused = |name, message: &str| Err(Error::Setting { name, message: message.to_owned() });
        match self {
            View::GBuffer { camera } => {
                camera.check().map_err(|message| Error::Scene(format!("camera: {message}")))?;
                match settings {
                    _ if camera.has_shutter() => {
                        refused("--shutter", "a G-buffer of the host does not tell how things move; use 0")
                    }
                    Settings { superposition: Some(_), .. } => {
                        refused("--superposition", "a G-buffer of the host does not show what planes mirror; use off")
                    }
                    Settings { splats: Some(_), .. } => refused(
                        "--glossy",
                        "splats belong to triangles, which a G-buffer of the host does not tell; use paths",
                    ),
                    Settings { ring: Some(_), .. } => {
                        refused("--ring", "a ring keeps images of the engine's own camera; leave it out")
                    }
                    _ => Ok(()),
                }
            }
            View::Camera { camera, region } => {
                camera.check().map_err(|message| Error::Scene(format!("camera: {message}")))?;
                region.check(camera.resolution)?;
                let block = 8 * settings.shading_rate;
                if [0, 1].iter().any(|&axis| region.origin[axis] % (block * settings.pattern[axis]) != 0) {
                    let message = format!("{region:?} does not begin at a block of pixels of all classes");
                    return Err(Error::Setting { name: "--crop", message });
                }
                if camera.is_orthographic() && settings.superposition.is_some() {
                    let message = "mirror images are spread as one eye sees them, and the rays of an orthographic camera have none in \
                                   common; use off, or an angle of view";
                    return refused("--superposition", message);
                }
                self.check_part(settings)
            }
            View::Atlas(atlas) => {
                let refuse = |message: &str| refused("view", message);
                if atlas.texels.len() as u64 != u64::from(width) * u64::from(height) {
                    return refuse("an atlas has as many texels as its size says");
                }
                match (settings.superposition, settings.soft_shadows) {
                    (Some(_), _) => refuse("mirror images need a camera; use --superposition off"),
                    (_, Some(_)) => refuse("shadows are convolved in a camera's image; use --soft-shadows off"),
                    (None, None) => Ok(()),
                }
            }
        }
    }

    /// Refuses a region whose pixels depend on others.
    fn check_part(&self, settings: &Settings) -> Result<()> {
        let why = match self.needs_whole(settings) {
            Some(why) if self.is_part() => why,
            _ => return Ok(()),
        };
        let message = format!("{why}; render the image as a whole");
        Err(Error::Setting { name: "--crop", message })
    }

    /// The reason why a part of the image cannot be rendered alone with the same bits, if there is one.
    pub fn needs_whole(&self, settings: &Settings) -> Option<&'static str> {
        match settings {
            _ if self.has_lens() => Some("a lens blurs over the whole image"),
            _ if self.has_shutter() => Some("an open shutter blurs over the whole image"),
            Settings { superposition: Some(_), .. } => Some("mirror images spread over the whole image"),
            Settings { soft_shadows: Some(_), .. } => Some("soft shadows are convolved over the whole image"),
            Settings { compensation: Compensation::Near, .. } if settings.clips() => {
                Some("--compensation near looks at the whole image (exact does not)")
            }
            Settings { light_choice: LightChoice::Contribution, .. } => {
                Some("--light-choice contribution looks at the whole image")
            }
            _ => None,
        }
    }
}

/// Maximum number of entries of a view, so that products with it fit; a device's own limits on buffers usually are
/// lower.
pub const MAX_PIXELS: u64 = 1 << 26;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_are_a_partition_of_the_image() {
        for (pattern, light_pool, size, count) in [
            ([3, 3], 0, [83, 61], 1),
            ([1, 1], 0, [40, 200], 7),
            ([2, 3], 0, [83, 115], 24),
            ([3, 3], 16, [230, 300], 99),
        ] {
            let settings = Settings { pattern, light_pool, ..Settings::plain() };
            let tasks = Task::cut(&settings, size, count);
            let block = if light_pool > 0 { 32 } else { 8 } * pattern[1];
            assert!(tasks.iter().all(|task| task.region.origin[1] % block == 0));
            let blocks = size[1].div_ceil(block) * settings.classes();
            assert!(tasks.len() as u32 >= count.min(blocks), "{} of {count} tasks", tasks.len());
            for (x, y) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))) {
                assert_eq!(tasks.iter().filter(|task| task.has([x, y], pattern)).count(), 1, "{x},{y}");
            }
        }
    }

    #[test]
    fn regions_grow_to_whole_blocks() {
        let plain = Settings::plain();
        let crop = Region { origin: [17, 9], size: [30, 5] };
        assert_eq!(crop.around(&plain, [640, 480]), Region { origin: [16, 8], size: [32, 8] });
        // Blocks of a 3 x 2 pattern are 24 x 16 pixels; the image may end within one.
        let pattern = Settings { pattern: [3, 2], ..plain.clone() };
        assert_eq!(crop.around(&pattern, [60, 480]), Region { origin: [0, 0], size: [48, 16] });
        let at_edge = Region { origin: [50, 470], size: [10, 10] };
        assert_eq!(at_edge.around(&pattern, [60, 480]), Region { origin: [48, 464], size: [12, 16] });
        let filtered = Settings { filter: Settings::interactive().filter, ..plain };
        assert_eq!(crop.around(&filtered, [640, 480]), Region { origin: [8, 0], size: [48, 24] });
    }
}
