//! The table of the keys.

use super::value::{Given, Value};
use super::{ALL, Key};
use crate::pass::convolve;
use crate::ring::{self, Ring};
use crate::scene::reflectors::MAX_REFLECTORS;
use crate::settings::{
    Agreement, ClusterOrder, Compensation, Exposure, Filter, GlossyForm, ImageChoice, LightChoice, Lookup, MirrorForm,
    Preset, Reflectance, Sequence, Settings, ShadowForm, SoftShadows, Splats, Spread, Traversal, Window,
};

/// Defines [`RenderDefaults`] and [`KEYS`]: the comment of a key is its help, and its documentation.
macro_rules! keys {
    ($($(#[doc = $text:literal])+ $name:ident: $kind:ty = $key:expr;)+) => {
        /// Keys of `[render]` of a scene file, of `--set`, of files of `--settings`, and of the flags of the same names: those that are
        /// given. Read from files, all values are in range.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct RenderDefaults {
            $($(#[doc = $text])+ pub $name: Option<$kind>,)+
        }

        /// All keys.
        pub const KEYS: &[Key] = &[$($key.described(stringify!($name), &[$($text),+]),)+];

        impl RenderDefaults {
            /// Takes a value of the key's kind, in range or not.
            pub(super) fn put_unchecked(&mut self, name: &str, given: &Given) {
                match name {
                    $(stringify!($name) => self.$name = Value::of(given),)+
                    _ => {}
                }
            }

            /// The values that are given, in the order of [`KEYS`].
            pub fn given(&self) -> Vec<(&'static str, Given)> {
                let mut given = Vec::new();
                $(if let Some(value) = &self.$name {
                    given.push((stringify!($name), Value::given(value)));
                })+
                given
            }

            /// Leaves out all keys that a command does not take.
            pub fn only_for(&mut self, command: &str) {
                $(if !Key::named(stringify!($name)).is_some_and(|key| key.acts_on(command)) {
                    self.$name = None;
                })+
            }

            fn take(&mut self, over: &RenderDefaults) {
                $(if over.$name.is_some() {
                    self.$name = over.$name;
                })+
            }

            /// Whether a key is given.
            pub fn has(&self, name: &str) -> bool {
                match name {
                    $(stringify!($name) => self.$name.is_some(),)+
                    _ => false,
                }
            }
        }
    };
}

const LIGHT: &str = "Light";
const END: &str = "End";
const PLANES: &str = "Glossy planes";
const IMAGES: &str = "Mirror images (of --superposition)";
const SPLATS: &str = "Splats and soft shadows";
const RING: &str = "Ring of paths (for scenes that move)";
const DEVICE: &str = "Device";

/// Commands that show mirror images and splats, which textures do not hold.
const SHOWN: &[&str] = &["render", "animate", "view"];
const PLAYED: &[&str] = &["render", "animate"];
const MOVING: &[&str] = &["animate", "view"];

keys! {
    /// Number of passes, including those of a resumed state.
    ///
    /// Time grows linearly; the error falls at least with the square root. The default applies if none of --passes, --time and
    /// --target-error is given.
    passes: u32 = Key::count("--passes", END, 1, u32::MAX as u64).on(&["render", "bake"]).or_by("64");
    /// Stop after this many seconds of rendering, at the end of the current pass.
    time: f32 = Key::above_0("--time", END, "SECONDS", 1e9).on(&["render", "bake"]).or_by("no limit");
    /// Stop when the estimated relative error of the image is at most E (0.01: one percent), after 8 passes at the earliest.
    ///
    /// The error is the RMSE relative to each pixel, without bias and the worst 0.5 % of the pixels; see
    /// docs/error-estimate.md. Half the error takes up to four times the passes.
    target_error: f32 = Key::above_0("--target-error", END, "E", f32::MAX).on(&["render", "bake"]).or_by("no target");
    /// Preset of the other settings of light, which override it.
    preset: Preset = Key::one_of("--preset", LIGHT, &[
        ("progressive", "Better with every pass, as without a preset: 3x3 interleaved sampling with a filter that fades, 16 particles and a pool of 3600, 8 direct lights, 3000 photons, near light from the pixels that show it"),
        ("interactive", "A smooth image after the first pass: the same with a pool of 1200, 4 direct lights and 1500 photons"),
    ]).called("PRESET").or_by("progressive");
    /// Particles started from the lights in each pass.
    ///
    /// The time of a pass grows linearly; more particles reduce the difference between passes.
    particles: u32 = Key::count("--particles", LIGHT, 1, Settings::MAX_PARTICLES as u64).formerly("paths").or_by("16");
    /// Particles whose lights form a pool from which small parts of the image choose; 0: no pool.
    ///
    /// Each part takes as many lights as --particles leave after reflections, those that matter to it. More: less noise in
    /// indirect light, and some more time. Without effect with --export-lights.
    light_pool: u32 = Key::count("--light-pool", LIGHT, 0, Settings::MAX_PARTICLES as u64).or_by("3600");
    /// Virtual lights on the emitters, for direct light; auto: half of --particles.
    ///
    /// Fewer save shadow rays; shadows of single lights show until passes or a filter average them.
    direct_lights: Option<u32> = Key::count("--direct-lights", LIGHT, 1, Settings::MAX_PARTICLES as u64)
        .also(&[("auto", "Half of --particles")]).nothing_is("auto").called("N|auto").or_by("auto");
    /// Interleaved sampling: size of the pixel pattern.
    ///
    /// Each position in the pattern has its own virtual lights. A larger pattern lights a neighbourhood with more lights at
    /// the same number of shadow rays, traced more slowly; the pattern shows without a filter or many passes.
    interleave: [u32; 2] = Key::new("--interleave", LIGHT, super::Takes::Size { least: 1, most: Settings::MAX_PATTERN }, "NxM").or_by("3x3");
    /// Maximum segments of a light path from eye to emitter.
    ///
    /// 1: emitters only; 2: direct light; 5: direct light and three further reflections, without 5 % of
    /// the light in a grey room and 15 % in a white one.
    max_depth: u32 = Key::count("--max-depth", LIGHT, 1, Settings::MAX_DEPTH as u64).called("K").or_by("16");
    /// Maximum consecutive mirrors and glass surfaces on an eye path.
    ///
    /// Longer chains are black. Each surface costs a ray for every pixel that gets there; no cost in scenes without mirrors
    /// and glass. They do not count in --max-depth.
    max_specular: u32 = Key::count("--max-specular", LIGHT, 0, Settings::MAX_SPECULAR as u64).or_by("8");
    /// At the first two surfaces of glass, follow both transmission and reflection; without it one of them, chosen at random.
    ///
    /// Without: the same limit with a third of the memory, and faster passes, but noise on glass and on mirrors over a diffuse
    /// base. Images above 2.7 million pixels split at the first surface alone.
    split: bool = Key::switch("--split", LIGHT, "true");
    /// Follow the narrow lobes of glossy surfaces by eye paths; without it the highlights of lights alone show them.
    ///
    /// Without: faster, but single highlights show as dots, and clipping darkens them.
    glossy_paths: bool = Key::switch("--glossy-paths", LIGHT, "true");
    /// More eye rays at edges in each pass; without it one for each pixel.
    ///
    /// Without: a little faster, but edges have steps until many passes average them.
    antialias: bool = Key::switch("--antialias", LIGHT, "true");
    /// Pixels on each side of the squares whose light is computed once.
    ///
    /// 2: a pass takes some 0.5 of the time and has 1.3 to 1.5 times the error; surfaces, textures and edges stay sharp, and what mirrors and glass show too,
    /// unless the scene has narrow lobes or --no-split. For frames and first images, since blur of light stays in later passes. Unless it is given, view takes 2 on a processor while the camera
    /// moves, and then 1.
    shading_rate: u32 = Key::count("--shading-rate", LIGHT, 1, Settings::MAX_SHADING_RATE as u64).on(SHOWN).or_by("1");
    /// Caustic photons in each pass, for each class of pixels; 0: no caustics. At most 1048576 over all classes.
    ///
    /// Time grows linearly; more are smoother. No cost in scenes without mirrors and glass.
    photons: u32 = Key::count("--photons", LIGHT, 0, Settings::MAX_PHOTONS as u64).or_by("27000 over all classes; with --preset interactive: 13500");
    /// Radius of the photon density estimate, in scene units; auto: by the size of what is seen and --photons.
    ///
    /// Larger: less noise and more blur. By default it shrinks with the fourth root of the passes, and
    /// photons have smaller ones where they are dense, over fourteen of them and fewer in later passes; a given radius is that of all, and stays.
    photon_radius: Option<f32> = Key::above_0("--photon-radius", LIGHT, "R|auto", f32::MAX)
        .also(&[("auto", "By the size of what is seen and --photons")]).nothing_is("auto").or_by("auto");
    /// Light each class of pixels by its own photons only, in place of all of them.
    ///
    /// The interleaved sampling of Wald et al. 2002, 4.2; noisier where the filter does not reach.
    interleave_photons: bool = Key::switch("--interleave-photons", LIGHT, "false");
    /// Mirrored lights in each pass, for each class of pixels.
    ///
    /// They light visible points through planar mirrors, without the blur and the noise of photons, which then omit these
    /// paths. Each costs two rays for each pixel. No cost in scenes without planar mirrors.
    mirror_lights: u32 = Key::count("--mirror-lights", LIGHT, 0, Settings::MAX_MIRROR_LIGHTS as u64).or_by("4; with --preset interactive: 3");
    /// Clipping distance: closer than this, a virtual light grows no brighter, in scene units.
    ///
    /// Higher: smoother corners, and more light for compensation to restore (slower, a little grain).
    /// Lower: bright blotches that take more passes to vanish; 0 clips nothing.
    clip: f32 = Key::number("--clip", LIGHT, "D", 0.0, f32::MAX).or_by("see --clip-fraction");
    /// Clipping distance as a fraction of the size of what the camera sees: in a room its diagonal, about.
    clip_fraction: f32 = Key::number("--clip-fraction", LIGHT, "F", 0.0, f32::MAX).or_by("0.1");
    /// How to restore the light that clipping cuts off; --no-compensation is short for off.
    compensation: Compensation = Key::one_of("--compensation", LIGHT, &[
        ("off", "Not at all: fastest, but corners are too dark"),
        ("near", "By one short ray for each pixel, whose hit is lit by the irradiance of the pixel that shows it"),
        ("exact", "By short rays bounce by bounce, whose hits are lit by all lights: unbiased in the limit"),
    ]).or_by("near");
    /// Probability with which a particle starts from an emitter.
    light_choice: LightChoice = Key::one_of("--light-choice", LIGHT, &[
        ("power", "Proportional to its power"),
        ("contribution", "Proportional to its estimated contribution to the image, for scenes with many lights"),
    ]).called("BY").or_by("power");
    /// Fraction of --light-choice contribution still drawn by power.
    ///
    /// Lower: lights that matter to the view get more of the particles; underestimated lights are noisier.
    power_fraction: f32 = Key::above_0("--power-fraction", LIGHT, "F", 1.0).formerly("light_floor").or_by("0.2");
    /// Point, spot and directional lights evaluated in each pass, chosen by --light-choice.
    ///
    /// The same limit; fewer save shadow rays in scenes with hundreds of lamps, and are noisier.
    delta_lights: Option<u32> = Key::count("--delta-lights", LIGHT, 1, Settings::MAX_DELTA_LIGHTS as u64)
        .also(&[("all", "All of them")]).nothing_is("all").called("N|all").or_by("all");
    /// Low-discrepancy sequence of the particles.
    sequence: Sequence = Key::one_of("--sequence", LIGHT, &[
        ("halton", "Halton, rotated at random"),
        ("sobol", "Sobol', randomised by XOR; most uniform if --particles is a power of two"),
    ]).called("NAME").or_by("halton");
    /// Jitter the low-discrepancy points in their cells: noise instead of structured error.
    jitter: bool = Key::switch("--jitter", LIGHT, "false");
    /// Drop a light for a cluster of 64 neighbouring points if its irradiance there is at most E.
    ///
    /// Higher: faster and darker, by at most E for each light of a pass. 0 drops only lights that contribute nothing.
    light_threshold: f32 = Key::number("--light-threshold", LIGHT, "E", 0.0, f32::MAX).or_by("0");
    /// Average irradiance over neighbouring pixels of one surface, in a window of this size.
    ///
    /// auto: the size of the interleaving pattern, at least 3x3; else odd numbers from 1 to 9, no smaller than the pattern.
    /// Smooth images from few passes; blurs shadows over the window, but not textures; less with each pass after 64. Larger is
    /// smoother, blurs more and takes longer.
    filter: Option<Window> = Key::new("--filter", LIGHT, super::Takes::Size { least: 1, most: Filter::MAX_WINDOW }, "WxH|auto|off")
        .also(&[("auto", "The size of the interleaving pattern, at least 3x3"), ("off", "No filter")]).nothing_is("off")
        .or_by("auto; off with --interleave 1x1");
    /// Apply --filter to direct light too; without it its shadows stay sharp, and noisy.
    filter_direct: bool = Key::switch("--filter-direct", LIGHT, "true");
    /// Exchange light around pixels on which --filter finds few neighbours: mouldings, leaves, silhouettes; the less the more passes.
    filter_sparse: bool = Key::switch("--filter-sparse", LIGHT, "true");
    /// Test of --filter for pixels of one surface.
    filter_agreement: Agreement = Key::one_of("--filter-agreement", LIGHT, &[
        ("plane", "The points lie in each other's tangent planes, with tolerance for curvature; conserves energy"),
        ("depth-and-normal", "Depths and normals differ little, as in Wald et al. 2002"),
    ]).called("TEST").or_by("plane");
    /// Random seed. Same seed, settings and device: same bits.
    seed: u64 = Key::count("--seed", LIGHT, 0, u64::MAX).or_by("0");
    /// Passes per frame.
    ///
    /// Time grows linearly; more passes reduce flicker.
    moving_passes: u32 = Key::count("--moving-passes", LIGHT, 1, Settings::MAX_MOVING_PASSES as u64).on(&["animate"]).or_by("4");
    /// Look-up of the light of --light-from.
    ///
    /// Bicubic has no bends at texels, and reads four times as many.
    lookup: Lookup = Key::one_of("--lookup", "Output", &[
        ("bilinear", "Between four texels"),
        ("bicubic", "Among sixteen, by Mitchell's filter"),
    ]).on(&["render", "animate", "view"]).or_by("bilinear");
    /// Also write emission, diffuse and specular light as layers of EXR files; they add up to the image exactly.
    summands: bool = Key::switch("--summands", "Output", "false").on(&["render"]);
    /// Exposure of images for display in stops, or auto; each stop doubles the brightness.
    ///
    /// With auto the logarithmic mean of the luminance becomes middle grey.
    exposure: Exposure = Key::number("--exposure", "Output", "STOPS|auto", -100.0, 100.0)
        .also(&[("auto", "The logarithmic mean of the luminance becomes middle grey")]).on(ALL).or_by("0").without_flag();
    /// Show a convolved mirror image of the room on glossy planes, and on curved surfaces with the key `reflector`.
    ///
    /// Without it eye paths follow their lobes, as of other glossy surfaces, so that a single frame shows separate reflections. Costs
    /// the convolution. No cost in scenes without such surfaces.
    superposition: Option<Spread> = Key::one_of("--superposition", PLANES, &[
        ("off", "Eye paths follow the lobes of glossy planes"),
        ("mirror", "No convolution: every glossy plane is a mirror"),
        ("invariant", "One kernel for the whole image, as wide as --kernel-width"),
        ("variant", "The material's kernel, wider for reflected points farther away"),
    ]).nothing_is("off").on(SHOWN).or_by("off");
    /// Reflectance model of mirrors and of the mirror images of glossy planes.
    reflectance: Reflectance = Key::one_of("--reflectance", PLANES, &[
        ("schlick", "Schlick's approximation, as for highlights"),
        ("map", "A table of the Fresnel term"),
        ("fresnel", "The Fresnel term at each pixel"),
    ]).on(SHOWN).or_by("schlick");
    /// Width in pixels of the largest reflector's kernel with --superposition invariant; others are as wide as their lobes are in
    /// proportion.
    kernel_width: u32 = Key::count("--kernel-width", PLANES, 0, 4096).called("PIXELS").on(SHOWN).or_by("15");
    /// Algorithm of the convolution.
    convolution: convolve::Form = Key::one_of("--convolution", PLANES, &[
        ("auto", "Direct for narrow kernels, else fast"),
        ("direct", "The sum over all pixels of each kernel, whose time grows with the square of its width"),
        ("fast", "A pyramid of images, with an error of 1 to 4 %"),
    ]).called("FORM").on(SHOWN).or_by("auto");
    /// Keep the blurred image of far surfaces from bleeding over sharp near ones; without it a little faster.
    occlusion: bool = Key::switch("--occlusion", PLANES, "true").on(SHOWN);
    /// Maximum number of glossy planes and curved surfaces that mirror the room. Fewer cost less.
    ///
    /// The largest planes come first, then the largest curved surfaces.
    reflectors: u32 = Key::count("--reflectors", PLANES, 0, MAX_REFLECTORS as u64).on(SHOWN).or_by("255");
    /// Where the mirror image of a glossy plane comes from.
    ///
    /// Images are sampled before the first pass and reprojected in each; rays fill their holes. They hold diffuse light alone, of a scene
    /// that stands still.
    mirror_source: MirrorForm = Key::one_of("--mirror-source", IMAGES, &[
        ("rays", "A traced ray for each pixel"),
        ("images", "Images with depth, and rays where they have holes"),
    ]).called("SOURCE").on(PLAYED).or_by("rays");
    /// Maximum number of elements that a reflector is cut into, each with a hemisphere of images.
    mirror_hemispheres: u32 = Key::count("--mirror-hemispheres", IMAGES, 1, 256).on(PLAYED).or_by("4");
    /// Images of a hemisphere. More have fewer holes; memory and start in proportion.
    mirror_images: u32 = Key::count("--mirror-images", IMAGES, 1, 256).on(PLAYED).or_by("8");
    /// Width and height of an image in points. Times and memory grow with its square.
    mirror_side: u32 = Key::count("--mirror-side", IMAGES, 8, 1024).called("POINTS").on(PLAYED).or_by("128");
    /// Layers of an image: further ones hold what lies behind the first, for fewer holes.
    mirror_layers: u32 = Key::count("--mirror-layers", IMAGES, 1, 4).on(PLAYED).or_by("1");
    /// Passes that light the images.
    mirror_passes: u32 = Key::count("--mirror-passes", IMAGES, 1, 65_536).on(PLAYED).or_by("32");
    /// Memory that the images may take, such as 64M or 1G. More is refused before they are made.
    mirror_memory: u64 = Key::new("--mirror-memory", IMAGES, super::Takes::Bytes, "BYTES").on(PLAYED).or_by("256M");
    /// Images that fit a view.
    mirror_choice: ImageChoice = Key::one_of("--mirror-choice", IMAGES, &[
        ("angle", "The least angle between their view direction and the mirrored one"),
        ("distance", "The least distance of their centre from the mirrored eye"),
    ]).on(PLAYED).or_by("angle");
    /// Images of each hemisphere in view that a pass merges.
    mirror_merge: u32 = Key::count("--mirror-merge", IMAGES, 1, 256).on(PLAYED).or_by("2");
    /// How glossy surfaces are shown, but for planes under --superposition.
    glossy: GlossyForm = Key::one_of("--glossy", SPLATS, &[
        ("paths", "Highlights of all lights, and eye paths along lobes with alpha up to 0.5"),
        ("splats", "Highlights of direct light, and splats of particles stored on the surfaces"),
    ]).on(SHOWN).or_by("paths");
    /// Particles of --glossy splats. At most as many hits are stored.
    ///
    /// They are traced once, before the first pass. More: sharper reflections with the same noise, 110 bytes each.
    splat_particles: u32 = Key::count("--splat-particles", SPLATS, 1, Splats::MAX_PARTICLES as u64).on(SHOWN).or_by("100000");
    /// C of the diameter of a splat, C sqrt(A / n) for n hits on a surface of area A.
    ///
    /// Higher: less noise, more blur, and time in proportion to its square.
    splat_width: f32 = Key::number("--splat-width", SPLATS, "C", 1.0, 100.0).on(SHOWN).or_by("32");
    /// Lobes up to this GGX alpha (the square of the roughness) are left to paths.
    splat_alpha: f32 = Key::number("--splat-alpha", SPLATS, "ALPHA", 0.0, 1.0).on(SHOWN).or_by("0.1");
    /// How the largest flat emitters cast shadows.
    soft_shadows: ShadowForm = Key::one_of("--soft-shadows", SPLATS, &[
        ("off", "By many virtual lights"),
        ("splat", "By one ray to the emitter's centre for each pixel, and a convolution: no noise, but biased"),
    ]).on(SHOWN).or_by("off");
    /// Number of these emitters, by power. Time grows in proportion.
    soft_shadow_lights: u32 = Key::count("--soft-shadow-lights", SPLATS, 1, SoftShadows::MAX_LIGHTS as u64).on(SHOWN).or_by("4");
    /// Each pass follows one path of light, which replaces the oldest of a ring; a change of the scene or the camera does not start the image over.
    ///
    /// --particles, --light-pool, --direct-lights, --interleave and --filter have no effect in a ring. Objects that move leave ghosts for as
    /// many passes as the ring has paths.
    ring: Option<ring::Form> = Key::one_of("--ring", RING, &[
        ("off", "No ring"),
        ("images", "The images of the paths are kept and their mean is shown: a pass is quick, and all that moves leaves ghosts"),
        ("lights", "The lights of the paths are kept and light each image anew: slower, and only light that comes from what moves is late"),
    ]).nothing_is("off").called("WHAT").on(MOVING).or_by("off");
    /// Number of paths in the ring. More: less noise, longer ghosts; more memory for images, more time for lights.
    ring_length: u32 = Key::count("--ring-length", RING, 1, Ring::MAX_LENGTH as u64).on(MOVING).or_by("64");
    /// Memory that the ring may take, MiB. A ring that needs more is refused, with the length that would fit.
    ring_memory: u32 = Key::count("--ring-memory", RING, 1, u32::MAX as u64).called("MIB").on(MOVING).or_by("1024");
    /// Maximum lights in one dispatch of the shading pass.
    ///
    /// Higher: fewer dispatches, but fewer traversal steps for each light within one. Lower it if the driver resets the
    /// device because a dispatch takes too long.
    lights_per_dispatch: u32 = Key::count("--lights-per-dispatch", DEVICE, 1, 64).or_by("8");
    /// Dispatches over which a ray of a pass may spread.
    ///
    /// A round that no ray needs costs microseconds. Raise it if a rendering reports unfinished rays.
    rounds: u32 = Key::count("--rounds", DEVICE, 1, 1024).or_by("4");
    /// Traversal kernel for shadow rays and eye rays.
    traversal: Traversal = Key::one_of("--traversal", DEVICE, &[
        ("auto", "Clusters if device and scene allow them and they are faster, else single rays"),
        ("single", "Single rays: runs on every supported device"),
        ("cluster", "Clusters of 64 rays: several times faster; an error if the device does not support them"),
    ]).or_by("auto");
    /// Order in which visible points are grouped into clusters.
    cluster_order: ClusterOrder = Key::one_of("--cluster-order", DEVICE, &[
        ("screen", "By pixel if no light is gathered bounce by bounce (--compensation off or near), else as space"),
        ("space", "By position: needs a sort, but clusters are narrower"),
    ]).called("ORDER").or_by("screen");
}

impl RenderDefaults {
    /// Takes a value. Errors: the values that are expected, or the nearest names.
    pub fn put(&mut self, name: &str, given: &Given) -> Result<(), String> {
        let key = Key::find(name)?;
        if !key.allows(given) {
            return Err(format!("{name}: {given}: expected {}", key.expected()));
        }
        self.put_unchecked(key.name, given);
        Ok(())
    }

    /// Reads `KEY=VALUE`, as of `--set`: a value of TOML, or a bare word. Errors: a message.
    pub fn assigned(text: &str) -> Result<RenderDefaults, String> {
        let (name, value) = text.split_once('=').ok_or("expected KEY=VALUE, such as particles=64")?;
        let (key, value) = (Key::find(name.trim())?, value.trim());
        let bare = || toml::Value::String(value.into());
        let parsed = format!("value = {value}").parse::<toml::Table>().ok().filter(|table| table.len() == 1);
        let read = key.read(&parsed.and_then(|mut table| table.remove("value")).unwrap_or_else(bare))?;
        let mut keys = RenderDefaults::default();
        keys.put_unchecked(key.name, &read);
        Ok(keys)
    }

    /// Takes the keys that `over` gives in place of its own. One of several conditions of the end, or ways to give the clipping distance,
    /// replaces all of them.
    pub fn override_by(&mut self, over: &RenderDefaults) {
        if over.passes.is_some() || over.time.is_some() || over.target_error.is_some() {
            (self.passes, self.time, self.target_error) = (None, None, None);
        }
        if over.clip.is_some() || over.clip_fraction.is_some() {
            (self.clip, self.clip_fraction) = (None, None);
        }
        self.take(over);
    }
}
