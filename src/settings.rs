//! The renderer's settings: meaning, unit, default, and the cost of higher and lower values.

pub mod keys;
mod soft_shadows;
mod splats;
mod superposition;

pub use keys::RenderDefaults;
pub use soft_shadows::{ShadowForm, SoftShadows};
pub use splats::{GlossyForm, Splats};
pub use superposition::{ImageChoice, MirrorForm, MirrorImages, MirrorSource, Reflectance, Spread, Superposition};

use crate::error::{Error, Result};
use crate::plan::{LOOP_BUDGET, min_loop_budget};
use crate::ring::Ring;
use glam::Vec3;
use keys::Key;
use serde::{Deserialize, Serialize};

/// Clipping distance: the distance below which the 1/d^2 of a virtual light stops growing (Wald et al. 2002).
///
/// Closer than this, 1/d^2 is replaced by 1/clip^2, which bounds the bright blotch around each virtual light. Higher: smoother
/// corners, more energy cut off (a bias towards dark corners; compensation restores it with short extra paths, slower and
/// with a little grain). Lower: brighter blotches at few passes; 0 is Keller's original estimator.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clip {
    /// In scene units.
    Distance(f32),
    /// As a fraction of the size of what the view shows ([`crate::extent::Extent::size`]): in a room its diagonal, about.
    Fraction(f32),
}

/// Restores the light that clipping cuts off, by short rays to what is near (Kollig and Keller 2004).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Compensation {
    /// Do not: fastest, but corners are too dark.
    Off,
    /// One ray for each shading point; where the eye sees its hit, the irradiance of that pixel lights it. Slightly biased
    /// (see [`crate::pass::near_collect`]); for an atlas as `Exact`.
    #[default]
    Near,
    /// Rays bounce by bounce, and their hits are lit by all lights: unbiased in the limit, and slower.
    Exact,
}

/// Traversal kernel for shadow rays, and for eye rays up to the first hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Traversal {
    /// Clusters if the device and the scene allow them, else single rays. A renderer that keeps a pipeline cache measures
    /// once which is faster (see [`crate::calibrate`]).
    #[default]
    Auto,
    /// One ray per invocation. Runs on every supported device.
    Single,
    /// A subgroup walks the tree for a cluster of 64 shading points and one light together: several times faster. Needs
    /// subgroups of 4, 8, 16, 32 or 64 with shuffles. Visibility differs from single rays only for rays within rounding of
    /// a triangle's edge or plane.
    Cluster,
}

/// Order in which visible points are grouped into clusters of 64.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClusterOrder {
    /// By pixel if no light is gathered bounce by bounce (`compensation`), else as `Space`.
    #[default]
    Screen,
    /// By position, sorted along a Morton curve.
    Space,
}

/// Low-discrepancy sequence for particles and gather rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sequence {
    /// Halton, rotated at random: a prime base for each dimension (Keller 1997).
    #[default]
    Halton,
    /// Sobol', randomised by XOR: base 2 in all dimensions (Wald et al. 2002, 4.4). Most uniform if `particles` is a power of two.
    Sobol,
}

/// Probability with which a particle starts from an emitter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LightChoice {
    /// Proportional to power (Keller 1997).
    #[default]
    Power,
    /// Proportional to the emitter's contribution to the image, estimated in each pass without shadows, mixed with power
    /// (after Wald et al. 2002). For scenes with many lights of which few matter to the view.
    Contribution,
}

/// Look-up in the textures of kept light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lookup {
    /// Between four texels.
    #[default]
    Bilinear,
    /// Among sixteen by the filter (1/3, 1/3) of Mitchell and Netravali 1988: without bends at texels, and a little blurred.
    Bicubic,
}

/// Test that decides whether two neighbouring pixels show one smooth surface, so that their irradiance may be averaged.
/// `pass::discontinuity` gives both tests and their weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Agreement {
    /// The segment between the two points lies in both tangent planes, with tolerance for curvature. Symmetric weights
    /// conserve energy.
    #[default]
    Plane,
    /// Depth and normal differ by less than a threshold; the result is the mean of the pixels that agree (Wald et al. 2002,
    /// 4.3). Mixes parallel planes that lie close together, and leaves noise on surfaces at grazing angles.
    DepthAndNormal,
}

/// Discontinuity buffer: averages the irradiance of neighbouring pixels that show one surface (Wald et al. 2002, 4.3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Filter {
    /// Width and height of the window in pixels, odd, 1 to 9, at least the interleaving pattern. Default `None`: the pattern's
    /// size rounded up to odd numbers, at least 3 x 3. Larger: smoother, blurs more, and costs in proportion to
    /// its area.
    pub window: Option<[u32; 2]>,
    /// Filter direct light too. Default true. False keeps its shadows sharp, and its noise; the filter costs a little less.
    pub direct: bool,
    /// Test for agreement between pixels. Default `Plane`.
    pub agreement: Agreement,
    /// Exchange irradiance around pixels whose windows found few that agree ([`crate::pass::sparse_windows`]). Default true. No effect with
    /// the paper's test.
    #[serde(default = "yes")]
    pub sparse: bool,
}

fn yes() -> bool {
    true
}

impl Default for Filter {
    fn default() -> Self {
        Filter { window: None, direct: true, agreement: Agreement::default(), sparse: true }
    }
}

impl Filter {
    /// Maximum width and height of `window`.
    pub const MAX_WINDOW: u32 = 9;
    /// Passes that are filtered in full; later ones less, see [`Filter::weight`].
    pub const FULL_PASSES: u32 = 64;

    /// Weight of the filter in pass number `pass` (from 0): 1 in the first [`Filter::FULL_PASSES`], F, of them and F / (pass + 1) after.
    /// The mean of N passes has at most (1 + ln(N / F)) F / N of the filter's bias, and the noise of later passes, which few pixels
    /// still see, falls with their number.
    pub fn weight(pass: u32) -> f32 {
        Self::FULL_PASSES as f32 / (pass + 1).max(Self::FULL_PASSES) as f32
    }

    /// Weight of the exchange around sparse windows in pass number `pass` (from 0): 1 / (pass + 1). The mean of N passes has at most
    /// (1 + ln N) / N of its bias.
    pub fn sparse_weight(pass: u32) -> f32 {
        1.0 / (pass + 1) as f32
    }

    /// Whether irradiance is exchanged around sparse windows.
    pub fn has_sparse(&self) -> bool {
        self.sparse && self.agreement == Agreement::Plane
    }

    /// Width and height of the window for images interleaved in this pattern.
    pub fn window(&self, pattern: [u32; 2]) -> [u32; 2] {
        self.window.unwrap_or(pattern.map(|n| (n | 1).max(3)))
    }
}

/// Value of the key `filter`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Window {
    /// As wide as the pattern, at least 3 x 3.
    Auto,
    /// Width and height.
    Size([u32; 2]),
}

/// Values of several settings at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// Better with every pass: the defaults.
    Progressive,
    /// A smooth image after the first pass: [`Settings::interactive`].
    Interactive,
}

/// Exposure of an image for display.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// Radiance is multiplied by 2^stops.
    Stops(f32),
    /// The logarithmic mean of the luminance of all pixels that are not black becomes middle grey, 0.18 (Reinhard et al. 2002,
    /// "Photographic Tone Reproduction for Digital Images", equation 2).
    Auto,
}

impl Default for Exposure {
    fn default() -> Exposure {
        Exposure::Stops(0.0)
    }
}

impl Exposure {
    /// Stops for an image of linear radiance; of a black image 0.
    pub fn stops(self, image: &[Vec3]) -> f32 {
        if let Exposure::Stops(stops) = self {
            return stops;
        }
        let luminance = |c: &Vec3| c.dot(Vec3::new(0.2126, 0.7152, 0.0722));
        let logarithms = image.iter().map(luminance).filter(|l| *l > 0.0 && l.is_finite()).map(|l| f64::from(l).log2());
        let (sum, count) = logarithms.fold((0.0, 0u32), |(sum, count), l| (sum + l, count + 1));
        if count == 0 { 0.0 } else { (0.18f64.log2() - sum / f64::from(count)) as f32 }
    }
}

/// Settings of a rendering. Each field documents meaning, unit, default and cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Particles N started from the lights in each pass, for each class of pixels (see `pattern`). Default 16; 1 to 65,536. The
    /// cost of a pass is linear in N (about N / (1 - rho) shadow rays per pixel); more particles reduce the difference
    /// between passes.
    pub particles: u32,
    /// Particles of each class of pixels whose lights form a pool, from which each cluster of shading points chooses as many as
    /// `particles` would leave after reflections, by what they contribute there (see `pass::light_lists`). Default 3600; 0: no pool, all
    /// lights light all points; at most 65,536, of which a pass takes no more than leave 8,192 lights. Useful above
    /// `particles`. More: less noise in
    /// indirect light, above all where few particles arrive; some 10 to 25 ms more for each thousand in a frame of 640x480 on two cores. The limit is the same. Where
    /// `compensation` is exact, the points that its rays hit have the lights that their class of pixels chooses by power.
    pub light_pool: u32,
    /// Virtual lights on the emitters for direct light, per class. Default `None`: half of `particles`; more than `particles` count
    /// as that many. Fewer save shadow rays: 4 for soft shadows of a filtered image (Wald et al. 2002, 5.1.1) beside some 15 for indirect light;
    /// shadows of single lights show until passes or a filter average them.
    pub direct_lights: Option<u32>,
    /// Interleaved sampling (Wald et al. 2002, 4.2): width and height of the pattern that tiles the pixel grid. Each position
    /// in the pattern is a class of pixels with its own set of virtual lights. Default 3 x 3; 1 to 8 each way; 1 x 1: all pixels share
    /// one set. Larger: a neighbourhood of pixels sees that many times as many lights at the same number of shadow
    /// rays per pixel; the pattern shows without a filter or many passes, and tracing is slower because the pixels of a
    /// cluster lie farther apart.
    pub pattern: [u32; 2],
    /// Discontinuity buffer. Default: a window as wide as the pattern. Makes few or interleaved passes look smooth; blurs shadows and
    /// other detail of the lighting (never textures) over the window, less with each pass after the first [`Filter::FULL_PASSES`]
    /// and not at all in the limit. `None`: no filter. An atlas of texels is not filtered.
    pub filter: Option<Filter>,
    /// Maximum number of segments of a light path from eye to emitter: 1 emitters only, 2 direct light, 5 direct light
    /// and three further reflections. Default 16; 1 to 16. With fewer, light that was reflected more often is missing: with 5 some 5 %
    /// of a grey room's light, 15 % of a white one's.
    pub max_depth: u32,
    /// Maximum number of consecutive interactions with mirrors and glass on an eye path; they do not count in `max_depth`.
    /// Default 8; 0 to 64. Longer chains are black. Each interaction costs a ray for every pixel that gets there, and a few
    /// dispatches even if none does. No cost in scenes without mirrors and glass.
    pub max_specular: u32,
    /// Split the eye path at its first surface with two components (glass: transmission and reflection; a mirror over a
    /// diffuse base), one path for each, and in scenes with glass once more at the next. Default true. False chooses one at random in each pass: the same limit
    /// with a third to a half of the memory and time for such pixels, but noise. No cost in scenes without such surfaces.
    pub split: bool,
    /// Eye paths follow specular lobes with alpha up to 0.5 as they follow mirrors, in a direction drawn from the lobe, and share the
    /// lobe's light with the virtual lights (balance heuristic). Default true. False leaves lobes to the lights alone, whose
    /// highlights show one by one on narrow lobes, and clips them; faster. Costs a ray, and the lighting of its hit, for each pixel
    /// that shows such a surface. No cost in scenes without, nor where imported lights replace all others.
    pub glossy_paths: bool,
    /// More eye rays at pixels where surface or albedo change, lit by the pixels nearby that show what they meet
    /// (see [`crate::pass::edges`]): edges are smooth from the first frame. Default `true`. Some 8 to 14 % of an interactive frame on lavapipe. Their bias fades
    /// like that of the filter. Not with [`Settings::summands`], an aperture or an atlas.
    pub antialias: bool,
    /// Pixels on each side of the squares whose light is computed once: 1 or 2. Default 1. With 2 a pass lights an image of half the width and
    /// height, and each pixel takes light from the lit points that show its surface, with an albedo and edges of its own
    /// (see [`crate::pass::upsample`]): a pass takes some 0.5 of the time and has 1.3 to 1.5 times the error. Pixels see through mirrors and glass by paths of their own; where the scene has narrow lobes,
    /// planes mirror the room or `split` is off, what these show is blurred over two pixels, in later passes too. For first images and frames of a camera. Without effect on an atlas or a G-buffer, and with
    /// [`Settings::summands`], an aperture or an open shutter.
    pub shading_rate: u32,
    /// Caustic photons (Wald et al. 2002, 4.1) for each class of pixels and pass, shot from the lights at mirrors and
    /// glass and stored where they arrive. Default 3000, interactive 1500; 0: no caustics; at most 2^20 over all classes. More:
    /// smoother caustics from each pass; the cost of a pass is linear in their number, and in those near a pixel. No cost in
    /// scenes without mirrors and glass.
    pub photons: u32,
    /// Radius of the photon density estimate, in scene units. Default `None`: 0.8 of the size of what the view shows over
    /// sqrt(photons), at most 1/15 of that size, shrinking with the fourth root of the passes.
    /// Up to three times that where few photons are stored, down to half of it where many are ([`crate::pass::photon_radius`]), and less where they are dense
    /// ([`crate::pass::photon_width`]), over fourteen photons in the first passes and fewer in later ones. A given radius is that of all photons, and is kept. Larger: less noise, more blur, and more
    /// photons to visit.
    pub photon_radius: Option<f32>,
    /// Each class of pixels is lit by its own photons only (Wald et al. 2002, 4.2). Default false: those of all classes light every
    /// pixel, which look-ups find as fast where photons are few, so that no pattern shows on thin and curved things.
    pub interleave_photons: bool,
    /// Mirror images on glossy planes. Default `None`. Costs one ray for each pixel that shows such a plane, the lighting of its
    /// hit point, and the convolution. Biased: the incident light at each point of the plane is taken from the mirror image
    /// that the eye sees there. Needs `split` and `max_specular` of 1 or more. No cost in scenes without such planes.
    pub superposition: Option<Superposition>,
    /// Glossy surfaces shown by splats of particles ([`crate::stage::Splats`]). Default `None`. Costs the particles once, and in
    /// each pass some 2000 look-ups for each pixel of one class that shows such a surface. No cost in scenes without.
    pub splats: Option<Splats>,
    /// Shadows of large emitters by convolution. Default `None`. Costs a shadow ray for each pixel and emitter, and the convolution at the
    /// shadows' edges, in place of the shadow rays to the virtual lights on these emitters.
    pub soft_shadows: Option<SoftShadows>,
    /// Directional reflectance of mirrors and of mirror images of glossy planes. Default `Schlick`. Highlights and paths along lobes keep
    /// Schlick's approximation, which their lobes are normalised with.
    pub reflectance: Reflectance,
    /// Also sum emission, diffuse and specular light separately, as layers that add up to the image.
    /// Default false. True costs some milliseconds a pass and 112 bytes a pixel.
    pub summands: bool,
    /// Mirrored lights (Keller 1997, 4.2) for each class of pixels and pass: pairs of a virtual light and a planar mirror,
    /// chosen by the power that the mirror reflects, which light visible points through the mirror's outline. Default 4,
    /// interactive 3; 0 to 1024; 0: light after a planar mirror comes from photons only. More: less noise; each costs up to two rays
    /// per pixel. Photons omit the paths that mirrored lights cover. No cost in scenes without planar mirrors, or if `max_depth` is
    /// below 3.
    pub mirror_lights: u32,
    /// Clipping distance. Default 0.1 of the size of what the view shows.
    pub clip: Clip,
    /// Restores the light that clipping cuts off. Default `Near`.
    pub compensation: Compensation,
    /// Irradiance, in units of the scene's radiance times pi, below which a light is dropped for a whole cluster of shading points
    /// before any ray is traced. Default 0: drops only lights that contribute nothing. Higher is faster and darker: a
    /// shading point loses at most this much for each light of a pass. No effect on single rays.
    pub light_threshold: f32,
    /// Sequence that places particles on the lights and chooses their directions and those of gather rays. Default `Halton`.
    /// Both have the same limit and cost; `docs/benchmarks.md` compares their errors.
    pub sequence: Sequence,
    /// Distribution of particles over emitters. Default `Power`. `Contribution` has the same limit; it costs a little time for
    /// each emitter and pass, and takes particles away from lights that reach the view only by reflection or from behind walls.
    pub light_choice: LightChoice,
    /// Look-up of kept light ([`crate::scene::Scene::kept_light`]). Default bilinear. Bicubic reads four times as many texels; without
    /// effect where there is no kept light.
    pub lookup: Lookup,
    /// Fraction of emitter samples still drawn by power (defensive sampling), above 0 to 1. Default 0.2. Higher: less gain if
    /// few lights matter. Lower: more noise from lights whose contribution was underestimated; the weight of their particles
    /// is at most 1 / fraction times that of sampling by power alone.
    pub power_fraction: f32,
    /// Number of point, spot, directional and imported virtual lights evaluated in each pass for each class of pixels, chosen
    /// in proportion to the estimate of `light_choice`. Default `None`: all; 1 to 2048. The limit is the same. Fewer:
    /// faster passes in scenes with many lamps, in proportion to the shadow rays saved, but more noise. The image of a scene
    /// with no more lights than this does not change in any bit.
    pub delta_lights: Option<u32>,
    /// Jitter the low-discrepancy points in their cells (Keller 1997, 4.1). Default false. True trades structured error for
    /// noise.
    pub jitter: bool,
    /// Seed of every pseudo-random decision. Default 0. Same seed, device and settings: same bits.
    pub seed: u64,
    /// Maximum number of lights in one dispatch of the shading pass. Default 8; 1 to 64. Higher: fewer dispatches, but fewer
    /// traversal steps for each light within one dispatch (their product is bounded).
    pub lights_per_dispatch: u32,
    /// Dispatches over which a ray may spread in a pass; each resumes where the one before stopped. Default 4; 1 to 1024.
    /// Rounds that no ray needs cost a few microseconds each; where no ray can need them, because the tree is small, they are left out. A ray left over after the last is reported, never dropped
    /// silently.
    pub rounds: u32,
    /// Maximum loop iterations of one subgroup in one dispatch. Default [`LOOP_BUDGET`]. Lower: shorter
    /// dispatches, for a device whose watchdog ends long ones, but more rounds. With the default a graphics card takes
    /// [`CARD_LOOP_FACTOR`](crate::plan::CARD_LOOP_FACTOR) times as many for rays that are traced alone.
    pub loop_budget: u32,
    /// Traversal kernel for shadow rays and eye rays. Default `Auto`.
    pub traversal: Traversal,
    /// Order of shading points in clusters. Default `Screen`. `Space` sorts them, which takes some 45 ms for 640x480 pixels on two
    /// cores; its clusters are narrower at silhouettes and faster to trace. With a pool of lights
    /// (`light_pool`) each class then chooses from it by power alone, with more noise; without one images differ by rounding at most.
    pub cluster_order: ClusterOrder,
    /// Passes per frame of an animation (moderate oversampling while something moves, Wald et al. 2002, 5.2). Default 4; 1 to
    /// 4096. The cost is linear; more passes flicker less. Does not change the result of a pass.
    pub moving_passes: u32,
    /// Keeps the images or lights of the latest paths while something moves ([`crate::ring`]). Default `None`. Replaces `particles`,
    /// `light_pool`, `direct_lights`, `pattern` and `filter`: one path a pass lights all pixels. For a camera's image, without `summands`.
    pub ring: Option<Ring>,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            particles: 16,
            light_pool: 3600,
            direct_lights: None,
            pattern: [3, 3],
            filter: Some(Filter::default()),
            max_depth: Self::MAX_DEPTH,
            max_specular: 8,
            split: true,
            glossy_paths: true,
            antialias: true,
            shading_rate: 1,
            photons: 3000,
            photon_radius: None,
            interleave_photons: false,
            superposition: None,
            splats: None,
            soft_shadows: None,
            reflectance: Reflectance::Schlick,
            summands: false,
            mirror_lights: 4,
            clip: Clip::Fraction(0.1),
            compensation: Compensation::Near,
            light_threshold: 0.0,
            sequence: Sequence::Halton,
            light_choice: LightChoice::Power,
            lookup: Lookup::Bilinear,
            power_fraction: 0.2,
            delta_lights: None,
            jitter: false,
            seed: 0,
            lights_per_dispatch: 8,
            rounds: 4,
            loop_budget: LOOP_BUDGET,
            traversal: Traversal::Auto,
            cluster_order: ClusterOrder::Screen,
            moving_passes: 4,
            ring: None,
        }
    }
}

impl Settings {
    /// Maximum `max_depth`: the table of sampling dimensions ends there.
    pub const MAX_DEPTH: u32 = 16;
    /// Maximum `max_specular`.
    pub const MAX_SPECULAR: u32 = 64;
    /// Maximum width and height of `pattern`.
    pub const MAX_PATTERN: u32 = 8;
    /// Maximum `mirror_lights`.
    pub const MAX_MIRROR_LIGHTS: u32 = 1024;
    /// Maximum number of photons over all classes.
    pub const MAX_PHOTONS: u32 = 1 << 20;
    /// Maximum `delta_lights`.
    pub const MAX_DELTA_LIGHTS: u32 = 2048;
    /// Maximum `shading_rate`.
    pub const MAX_SHADING_RATE: u32 = 2;
    /// Maximum `moving_passes`.
    pub const MAX_MOVING_PASSES: u32 = 4096;
    /// Maximum `particles`.
    pub const MAX_PARTICLES: u32 = 65_536;

    /// One set of virtual lights for the whole image, all of them at every point, exact compensation, no filter, one eye ray a pixel and
    /// paths of at most five segments: the estimator of Keller 1997, whose passes add up without bias but for clipping. For
    /// comparisons with it.
    pub fn plain() -> Settings {
        Settings {
            particles: 32,
            light_pool: 0,
            direct_lights: Some(Self::MAX_PARTICLES),
            max_depth: 5,
            pattern: [1, 1],
            filter: None,
            antialias: false,
            photons: 2000,
            interleave_photons: true,
            compensation: Compensation::Exact,
            ..Settings::default()
        }
    }

    /// Preset for interactive frame rates, as in Wald et al. 2002, 5.1: 3 x 3 interleaved sampling with a 3 x 3 filter as by default, but
    /// with half the direct lights and photons, three mirrored lights and a third of the pool.
    pub fn interactive() -> Settings {
        Settings { light_pool: 1200, direct_lights: Some(4), photons: 1500, mirror_lights: 3, ..Settings::default() }
    }

    /// Checks every range of the table of keys, and what must fit together. Errors: [`Error::Setting`], which names the flag.
    pub fn validate(&self) -> Result<()> {
        let refuse = |name, message| Err(Error::Setting { name, message });
        let given = self.keys().given();
        let keys = given.iter().filter_map(|(name, given)| Some((Key::named(name)?, given)));
        if let Some((key, given)) = keys.into_iter().find(|(key, given)| !key.allows(given)) {
            return refuse(key.flag, format!("{given} is not {}", key.expected()));
        }
        let range = |name, value: u32, low: u32, high: u32| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                refuse(name, format!("{value} is not in {low}..={high}"))
            }
        };
        range("loop_budget", self.loop_budget, min_loop_budget(self.lights_per_dispatch), LOOP_BUDGET)?;
        range("--photons", self.photons, 0, Self::MAX_PHOTONS / self.classes())?;
        if self.ring.is_some() && self.summands {
            return refuse("--summands", String::from("a ring keeps whole images; leave it out, or --ring"));
        }
        for (size, least) in self.filter.iter().flat_map(|f| f.window(self.pattern).into_iter().zip(self.pattern)) {
            range("--filter", size, least, Filter::MAX_WINDOW)?;
            if size % 2 == 0 {
                return refuse("--filter", format!("{size} is even; a window has a middle, take {}", size + 1));
            }
        }
        if self.superposition.is_some() && (!self.split || self.max_specular == 0) {
            let message = "a plane and its mirror image are two components: take away --no-split and --max-specular 0, or turn it off";
            return refuse("--superposition", String::from(message));
        }
        if self.splats.is_some() && self.ring.is_some() {
            let message = "a ring replaces its light path by path, splats keep theirs; leave out one of them";
            return refuse("--ring", String::from(message));
        }
        Ok(())
    }

    /// Number of pixel classes: positions in the pattern.
    pub fn classes(&self) -> u32 {
        self.pattern[0] * self.pattern[1]
    }

    /// Particles of a pass: `particles` for each class.
    pub fn particles(&self) -> u32 {
        self.particles * self.classes()
    }

    /// Number of reflectors, flat and curved, that mirror the room if they are glossy.
    pub fn mirroring_planes(&self) -> u32 {
        self.superposition.map_or(0, |superposition| superposition.reflectors)
    }

    /// The images with depth that glossy planes show, if they show any.
    pub fn mirror_images(&self) -> Option<MirrorImages> {
        match self.superposition?.mirror_source {
            MirrorSource::Rays => None,
            MirrorSource::Images(images) => Some(images),
        }
    }

    /// Whether the clipping distance is above 0.
    pub fn clips(&self) -> bool {
        !matches!(self.clip, Clip::Distance(0.0) | Clip::Fraction(0.0))
    }

    /// Clipping distance in scene units for a scene of this diagonal.
    pub fn clip_distance(&self, diagonal: f32) -> f32 {
        match self.clip {
            Clip::Distance(d) => d,
            Clip::Fraction(f) => f * diagonal,
        }
    }
}
