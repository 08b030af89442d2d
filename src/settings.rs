//! Every knob of the renderer: meaning, unit, default, and what a higher and a lower value cost.

use crate::error::{Error, Result};
use crate::plan::{LOOP_BUDGET, least_loop_budget};
use crate::scene::RenderDefaults;
use crate::scene::reflectors::MAX_REFLECTORS;
use serde::{Deserialize, Serialize};

/// Distance below which the 1/d^2 of a virtual light stops growing (row W6).
///
/// Below it 1/d^2 is replaced by 1/clip^2, which bounds the bright blotch around each virtual light. Higher: smoother
/// corners, more energy cut off (a bias towards dark corners; with compensation it returns as more short paths, slower and
/// with a little grain). Lower: brighter blotches at few passes; 0 is Keller's original estimator.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Clip {
    /// In scene units.
    Distance(f32),
    /// As a fraction of the diagonal of the scene's bounding box.
    Fraction(f32),
}

/// How shadow rays, and the eye's rays up to the first hit, are traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Traversal {
    /// Clusters where the device and the scene allow it, else single rays. A renderer that keeps a pipeline cache measures
    /// once which are faster (see [`crate::calibrate`]).
    #[default]
    Auto,
    /// One ray for each invocation: runs on every device.
    Single,
    /// A subgroup walks the tree for a cluster of 64 receivers and one light together: several times faster. Needs
    /// subgroups of 4, 8, 16, 32 or 64 with shuffles. Visibility differs from that of single rays only for rays within
    /// rounding of a triangle's edge or plane.
    Cluster,
}

/// By what the receivers that the eye sees are put in clusters of 64.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ClusterOrder {
    /// By their pixels where no light is gathered (without `compensation`), else as `Space`.
    #[default]
    Screen,
    /// By their positions, sorted along a Morton curve.
    Space,
}

/// The low-discrepancy sequence that particles and gather rays follow (row W4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sequence {
    /// Halton's, rotated at random: a prime base for each dimension (Keller 1997).
    #[default]
    Halton,
    /// Sobol's, randomised by XOR: base 2 in all dimensions (Wald et al. 2002, 4.4). Evenest where `paths` is a power of two.
    Sobol,
}

/// By what particles choose the emitter that they start from (row W8).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LightChoice {
    /// By power alone (Keller 1997).
    #[default]
    Power,
    /// By what the eye will see of them, estimated anew in each pass without shadows, mixed with their power: for scenes of many
    /// lights of which few matter to the view.
    Contribution,
}

/// When two neighbouring pixels show one smooth surface, so that their irradiance may be averaged. `pass::discontinuity` gives both
/// tests and their weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Agreement {
    /// Where the way between their points lies in both tangent planes, as far as the surface is not itself curved. What a pixel
    /// gains others lose, so that no energy is made or lost.
    #[default]
    Plane,
    /// Where distances and normals differ little, and the mean of those that agree, as in the paper: mixes parallel planes that lie a
    /// little apart, and leaves noise on surfaces that recede from the eye.
    Paper,
}

/// Averaging of the irradiance of neighbouring pixels that show one surface (Wald et al. 2002, 4.3; row W3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Filter {
    /// Width and height of the window in pixels, odd, 1 to 9, at least the interleaving pattern. Default `None`: as wide as the
    /// pattern, rounded up to odd numbers, at least 3 x 3. Larger: smoother, blurs more, and costs in proportion to
    /// its area.
    pub window: Option<[u32; 2]>,
    /// Direct light is filtered as well. Default true. False keeps its shadows sharp, and its noise; the filter costs a little less.
    pub direct: bool,
    /// When pixels agree. Default `Plane`.
    pub agreement: Agreement,
}

impl Default for Filter {
    fn default() -> Self {
        Filter { window: None, direct: true, agreement: Agreement::default() }
    }
}

impl Filter {
    /// Greatest width and height of `window`.
    pub const MAX_WINDOW: u32 = 9;

    /// Width and height of the window for images interleaved in this pattern.
    pub fn window(&self, pattern: [u32; 2]) -> [u32; 2] {
        self.window.unwrap_or(pattern.map(|n| (n | 1).max(3)))
    }
}

/// How a glossy plane spreads its mirror image (Bastos 1999, section 7.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Spread {
    /// Not at all: every glossy plane is a mirror.
    Mirror,
    /// By one kernel of a fixed width for the whole image: as blurred near the plane as far from it.
    Invariant,
    /// By the kernel of the material, wider where the reflected point is farther.
    #[default]
    Variant,
}

/// How the reflectance of a glossy plane in a direction is found (Bastos 1999, section 6.7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reflectance {
    /// From the lobe's energy and Schlick's formula, as point lights are reflected.
    #[default]
    Schlick,
    /// From a table over directions that holds Fresnel's term fitted to the reflectance at normal incidence. Textures of base colour
    /// and metal count with their mean.
    Map,
    /// The same term evaluated at each pixel.
    Fresnel,
}

/// Superposition (Bastos 1999): a glossy plane that the eye sees directly shows its base, lit as everything is, and the mirror
/// image of the room, spread by the kernel of its material. Without it glossy planes show the highlights of the virtual lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Superposition {
    /// Default `Variant`. `Mirror` and `Invariant` are for comparison, and cost less.
    pub spread: Spread,
    /// Default `Schlick`.
    pub reflectance: Reflectance,
    /// The blurred image of what is far does not run over the sharp one of what is near. Default true. False is the program of
    /// the thesis, which is a little faster.
    pub occlusion: bool,
    /// Diameter in pixels of the kernel of `Invariant`. Default 15; 0 to 4096.
    pub kernel_width: u32,
    /// Planar reflectors that mirror the room, the greatest first. Default 255, which is the most; fewer cost less. The others
    /// show highlights alone.
    pub reflectors: u32,
}

impl Default for Superposition {
    fn default() -> Self {
        Superposition {
            spread: Spread::default(),
            reflectance: Reflectance::default(),
            occlusion: true,
            kernel_width: 15,
            reflectors: MAX_REFLECTORS as u32,
        }
    }
}

/// Settings of one rendering. See each field for meaning, unit, default and cost.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// Particles N started from the lights in each pass, for each class of pixels (see `pattern`). Default 32. Cost of a pass grows linearly with it (the
    /// shadow rays of a pixel are about N / (1 - rho)); more give less difference between passes.
    pub paths: u32,
    /// Lights that the particles of a class leave on the emitters themselves. Default `None`: one for each particle. Fewer
    /// save shadow rays: 4 for soft shadows of a filtered image (Wald et al. 2002, 5.1.1) beside some 18 for indirect light;
    /// the shadows of the single lights show until passes or a filter mix them. 1 to `paths`.
    pub direct_lights: Option<u32>,
    /// Interleaved sampling (Wald et al. 2002, 4.2; row W1): the pixel grid is cut into patterns of this width and height,
    /// and each place in the pattern, a class of pixels, has virtual lights of its own. Default 1 x 1: all pixels share one
    /// set; 1 to 8 each way. Larger: as many shadow rays for each pixel, but a neighbourhood sees that many times as many
    /// lights; before a filter or many passes the pattern shows, and the pixels of a cluster lie farther apart, so tracing
    /// them is slower.
    pub pattern: [u32; 2],
    /// Averages irradiance over neighbouring pixels that show one surface. Default `None`. A few passes, or interleaved ones, look
    /// smooth by it; shadows and other detail of the light (never textures) are blurred over the window, in the limit as well.
    pub filter: Option<Filter>,
    /// Greatest number of segments of a light path from eye to emitter: 1 emitters only, 2 direct light, 5 direct light
    /// and three further reflections. Default 5. Higher is brighter and slower; 1 to 16.
    pub max_depth: u32,
    /// Mirrors, and surfaces of glass, that a path from the eye follows in a row until it meets something else; they do not
    /// count in `max_depth`. Default 8; 0 to 64. What lies behind more is black. Each costs a ray for every pixel that gets
    /// there, and a few dispatches even if none does; scenes without mirrors and glass do not pay.
    pub max_specular: u32,
    /// Split the eye's path where it first meets a surface of two components (glass: seen through and reflected; a mirror
    /// over a diffuse base), one path for each. Default true. False chooses one at random in each pass: the same limit
    /// with half the memory and time for such pixels, but noise. Scenes without such surfaces do not pay.
    pub split: bool,
    /// Caustic photons (Wald et al. 2002, 4.1; row W2) for each class of pixels and pass, shot from the lights at mirrors and
    /// glass and stored where they arrive. Default 0: mirrors and glass throw no light on; at most 2^20 over all classes. More:
    /// smoother caustics from each pass; the cost of a pass grows linearly with them, and with those around a pixel. Scenes
    /// without mirrors and glass do not pay.
    pub photons: u32,
    /// Distance within which photons light a point, in scene units. Default `None`: a quarter of the scene's diagonal over
    /// sqrt(photons), at most 0.05 of the diagonal. Larger: less noise, more blur, and more photons to look at. The blur does not
    /// go away with more passes.
    pub photon_radius: Option<f32>,
    /// Mirror images on glossy planes. Default `None`. Costs a ray for each pixel that shows such a plane, the light of what it meets,
    /// and the convolution. Biased: what each point of the plane sees is taken from the mirror image that the eye sees there. Needs
    /// `split` and `max_specular` of 1 or more; scenes without such planes do not pay.
    pub superposition: Option<Superposition>,
    /// Emission, diffuse and specular light are summed apart as well, so that each can be written as a layer whose sum is the image.
    /// Default false. True costs some milliseconds and 112 bytes a pixel.
    pub summands: bool,
    /// Mirrored lights (Keller 1997, 4.2; row K6) of each class of pixels and pass: pairs of a light of the pass and a planar mirror,
    /// chosen by how much light the mirror reflects of it, which light what the eye sees through the mirror's outline. Default 0:
    /// planar mirrors throw no light on but by photons; 0 to 1024. More: less noise; each costs two rays for each pixel. Where there are
    /// some, photons leave out what they do. Scenes without planar mirrors do not pay, nor does a `max_depth` below 3.
    pub mirror_lights: u32,
    /// Clipping distance. Default 0.1 of the scene's diagonal.
    pub clip: Clip,
    /// Gather the part that clipping cuts off by short extra paths (Kollig and Keller 2004), so that the limit is
    /// unbiased. Default true. False saves the extra rays and darkens corners.
    pub compensation: bool,
    /// Irradiance below which a light is dropped for a whole cluster of receivers before any ray is traced, in units of the
    /// scene's radiance times pi. Default 0: only what sends nothing at all is dropped. Higher is faster and darker: a
    /// receiver loses at most this much for each light of a pass. Single rays drop nothing by it.
    pub light_threshold: f32,
    /// The points that place particles on the lights and choose their directions and those of gather rays. Default `Halton`.
    /// Both have the same limit and cost; `docs/benchmarks.md` compares their errors.
    pub sequence: Sequence,
    /// By what particles choose emitters. Default `Power`. `Contribution` has the same limit; it costs a little time for each
    /// emitter and pass, and takes particles away from lights that matter by reflections or from behind walls only.
    pub light_choice: LightChoice,
    /// Share of that choice which goes by power all the same, above 0 to 1. Default 0.2. Higher: less is gained where few lights
    /// matter. Lower: more noise in what lights do whose contribution was underestimated; their particles are at most 1 / share
    /// times as strong as by power alone.
    pub light_floor: f32,
    /// Point, spot and parallel lights, and imported virtual ones, that are lit in each pass and for each class of pixels, chosen
    /// in proportion to what `light_choice` goes by (row W8). Default `None`: all of them; 1 to 2048. The limit is the same. Fewer:
    /// less time for a pass of a scene of many lamps, in proportion to the shadow rays that are saved, but more noise. A scene
    /// that has no more of them does not change in any bit.
    pub delta_lights: Option<u32>,
    /// Jitter the low-discrepancy points in their cells (Keller, 4.1). Default false. True trades structured error for noise.
    pub jitter: bool,
    /// Seed of every pseudo-random decision. Default 0. Same seed, device and settings: same bits.
    pub seed: u64,
    /// Lights that one dispatch of the shading pass may loop over. Default 8. Higher: fewer dispatches, but the
    /// traversal steps that each light may take within one dispatch shrink (their product is bounded).
    pub lights_per_dispatch: u32,
    /// Rounds that a ray may take in a pass; it is carried on where the one before stopped. Default 4. Rounds that no ray
    /// needs cost a few microseconds each. A ray left over after the last is reported, never dropped silently.
    pub rounds: u32,
    /// Loop iterations that one invocation's subgroup may take in one dispatch. Default [`LOOP_BUDGET`]. Lower: shorter
    /// dispatches, for a device whose watchdog ends long ones, but more rounds.
    pub loop_budget: u32,
    /// How shadow rays and the eye's rays are traced. Default `Auto`.
    pub traversal: Traversal,
    /// By what receivers are put in clusters. Default `Screen`. `Space` sorts them, which takes some 45 ms for 640x480 pixels on two cores;
    /// its clusters are narrower across silhouettes, so tracing them takes less. Images differ by rounding at most.
    pub cluster_order: ClusterOrder,
    /// Passes that each frame of an animation gets (moderate oversampling while something moves, Wald et al. 2002, 5.2; row
    /// W7). Default 4; 1 to 4096. Cost grows linearly; more flicker less. Does not change what a pass computes.
    pub moving_passes: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            paths: 32,
            direct_lights: None,
            pattern: [1, 1],
            filter: None,
            max_depth: 5,
            max_specular: 8,
            split: true,
            photons: 0,
            photon_radius: None,
            superposition: None,
            summands: false,
            mirror_lights: 0,
            clip: Clip::Fraction(0.1),
            compensation: true,
            light_threshold: 0.0,
            sequence: Sequence::Halton,
            light_choice: LightChoice::Power,
            light_floor: 0.2,
            delta_lights: None,
            jitter: false,
            seed: 0,
            lights_per_dispatch: 8,
            rounds: 4,
            loop_budget: LOOP_BUDGET,
            traversal: Traversal::Auto,
            cluster_order: ClusterOrder::Screen,
            moving_passes: 4,
        }
    }
}

impl Settings {
    /// Greatest `max_depth`: the table of sampling dimensions ends there.
    pub const MAX_DEPTH: u32 = 16;
    /// Greatest `max_specular`.
    pub const MAX_SPECULAR: u32 = 64;
    /// Greatest width and height of `pattern`.
    pub const MAX_PATTERN: u32 = 8;
    /// Greatest `mirror_lights`.
    pub const MAX_MIRROR_LIGHTS: u32 = 1024;
    /// Greatest number of photons of all classes together.
    pub const MAX_PHOTONS: u32 = 1 << 20;
    /// Greatest `delta_lights`.
    pub const MAX_DELTA_LIGHTS: u32 = 2048;
    /// Greatest `moving_passes`.
    pub const MAX_MOVING_PASSES: u32 = 4096;
    /// Greatest `paths`.
    pub const MAX_PATHS: u32 = 65_536;

    /// For frames in a fraction of a second, as in Wald et al. 2002, 5.1: 3 x 3 interleaved sampling with a filter as wide, 4 direct
    /// lights and some 18 others, 500 photons, no compensation of what clipping cuts off. Biased by clipping and by the filter.
    pub fn interactive() -> Settings {
        Settings {
            paths: 20,
            direct_lights: Some(4),
            pattern: [3, 3],
            compensation: false,
            photons: 56,
            filter: Some(Filter::default()),
            ..Settings::default()
        }
    }

    /// Takes over what a scene file's `[render]` says.
    pub fn with_scene_defaults(mut self, render: &RenderDefaults) -> Self {
        self.paths = render.paths.unwrap_or(self.paths);
        self.direct_lights = render.direct_lights.or(self.direct_lights);
        self.pattern = render.interleave.unwrap_or(self.pattern);
        self.max_depth = render.max_depth.unwrap_or(self.max_depth);
        self.max_specular = render.max_specular.unwrap_or(self.max_specular);
        self.split = render.split.unwrap_or(self.split);
        self.photons = render.photons.unwrap_or(self.photons);
        self.photon_radius = render.photon_radius.or(self.photon_radius);
        if let Some(spread) = render.superposition {
            self.superposition = Some(Superposition { spread, ..self.superposition.unwrap_or_default() });
        }
        self.compensation = render.compensation.unwrap_or(self.compensation);
        self.seed = render.seed.unwrap_or(self.seed);
        if let Some(f) = render.clip_fraction {
            self.clip = Clip::Fraction(f);
        }
        if let Some(d) = render.clip {
            self.clip = Clip::Distance(d);
        }
        self
    }

    /// Checks every range; the error names the flag.
    pub fn validate(&self) -> Result<()> {
        let range = |name, value: u32, low: u32, high: u32| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(Error::Setting { name, message: format!("{value} is not in {low}..={high}") })
            }
        };
        range("--paths", self.paths, 1, Self::MAX_PATHS)?;
        range("--direct-lights", self.direct_lights.unwrap_or(1), 1, self.paths)?;
        range("--delta-lights", self.delta_lights.unwrap_or(1), 1, Self::MAX_DELTA_LIGHTS)?;
        range("--interleave", self.pattern[0], 1, Self::MAX_PATTERN)?;
        range("--interleave", self.pattern[1], 1, Self::MAX_PATTERN)?;
        range("--max-depth", self.max_depth, 1, Self::MAX_DEPTH)?;
        range("--max-specular", self.max_specular, 0, Self::MAX_SPECULAR)?;
        range("--mirror-lights", self.mirror_lights, 0, Self::MAX_MIRROR_LIGHTS)?;
        range("--lights-per-dispatch", self.lights_per_dispatch, 1, 64)?;
        range("--rounds", self.rounds, 1, 1024)?;
        range("--moving-passes", self.moving_passes, 1, Self::MAX_MOVING_PASSES)?;
        range("loop_budget", self.loop_budget, least_loop_budget(self.lights_per_dispatch), LOOP_BUDGET)?;
        range("--photons", self.photons, 0, Self::MAX_PHOTONS / self.classes())?;
        if let Some(r) = self.photon_radius.filter(|r| !(r.is_finite() && *r > 0.0)) {
            return Err(Error::Setting { name: "--photon-radius", message: format!("{r} is not a distance above 0") });
        }
        for (size, least) in self.filter.iter().flat_map(|f| f.window(self.pattern).into_iter().zip(self.pattern)) {
            range("--filter", size, least, Filter::MAX_WINDOW)?;
            if size % 2 == 0 {
                return Err(Error::Setting {
                    name: "--filter",
                    message: format!("{size} is even; a window has a middle, take {}", size + 1),
                });
            }
        }
        if let Some(superposition) = &self.superposition {
            range("--kernel-width", superposition.kernel_width, 0, 4096)?;
            range("--reflectors", superposition.reflectors, 0, MAX_REFLECTORS as u32)?;
            if !self.split || self.max_specular == 0 {
                return Err(Error::Setting {
                    name: "--superposition",
                    message: String::from(
                        "a plane and its mirror image are two components: take away --no-split and --max-specular 0, or turn it off",
                    ),
                });
            }
        }
        let (Clip::Distance(c) | Clip::Fraction(c)) = self.clip;
        if !(c.is_finite() && c >= 0.0) {
            return Err(Error::Setting { name: "--clip", message: format!("{c} is not a distance of 0 or more") });
        }
        let f = self.light_floor;
        if !(f > 0.0 && f <= 1.0) {
            return Err(Error::Setting { name: "--light-floor", message: format!("{f} is not a share above 0 to 1") });
        }
        let t = self.light_threshold;
        if !(t.is_finite() && t >= 0.0) {
            return Err(Error::Setting {
                name: "--light-threshold",
                message: format!("{t} is not an irradiance of 0 or more"),
            });
        }
        Ok(())
    }

    /// Classes of pixels: places in the pattern.
    pub fn classes(&self) -> u32 {
        self.pattern[0] * self.pattern[1]
    }

    /// Particles of a pass: `paths` for each class.
    pub fn particles(&self) -> u32 {
        self.paths * self.classes()
    }

    /// Planar reflectors, by their number, that mirror the room if they are glossy.
    pub fn mirroring_planes(&self) -> u32 {
        self.superposition.map_or(0, |superposition| superposition.reflectors)
    }

    /// Whether there is a clipping distance at all.
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
