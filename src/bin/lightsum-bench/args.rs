//! The flags.

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use lightsum::gpu::DeviceChoice;
use lightsum::scene::reflectors;
use lightsum::settings::{ClusterOrder, Settings, SoftShadows, Splats, Traversal};
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Maximum number of pixels of an image.
pub const MAX_PIXELS: u64 = 1 << 26;
/// Maximum number of reflectors of a scene.
const MAX_REFLECTORS: u32 = reflectors::MAX_REFLECTORS as u32;

/// Measures the passes of lightsum.
///
/// Results go to standard output, the rest to standard error. Exit codes: 0 done, 1 failed, 2 wrong use.
#[derive(Debug, Parser)]
#[command(name = "lightsum-bench", version, arg_required_else_help = true)]
pub struct Arguments {
    /// The subcommand.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// A frame: each GPU pass by timestamps, and the whole frame by the wall clock, for scenes and settings.
    Frame(Frame),
    /// Shadow rays per second of each kernel, for the pixels of an image and the lights of a pass.
    ShadowRays(ShadowRays),
    /// Scaling with triangles, lights and pixels, in a generated room.
    Scaling(Scaling),
    /// From process start to the second pass, with empty and with filled caches.
    Startup(Startup),
    /// A single start: the process that `startup` measures.
    #[command(hide = true)]
    StartupOnce(StartupOnce),
    /// Shadow rays of each kernel and of Embree on the same rays, in turn.
    Compare(Compare),
    /// Cost of moving an object: vertices, trees, uploads.
    Edits(Edits),
    /// Convolution of mirror images with kernels from 1 to 127 pixels wide; half the image is a reflector.
    Convolve(Convolve),
    /// Motion blur by a camera that moves, with segments from 1 to 63 pixels long.
    Motion(Motion),
    /// Soft shadows by convolution, with penumbrae from 1 to 63 pixels wide, or of a scene by the number of emitters.
    Shadows(Shadows),
    /// A recorded path through a scene, for each number of glossy reflectors: frame times, shares of the passes, slope.
    Walkthrough(Walkthrough),
    /// A cluster's master: from packed points, or exact ones, to an image, part by part.
    Master(Master),
}

/// Flags common to all subcommands.
#[derive(Clone, Debug, Args)]
pub struct Common {
    /// Image size in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = resolution)]
    pub resolution: [u32; 2],
    /// Measurements of each item, after one that is not counted; the tables show medians.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    pub repeats: u32,
    /// Vulkan device: part of its name, its index in lightsum --list-devices, or cpu [default: the fastest kind available].
    #[arg(long, value_name = "NAME|INDEX|cpu")]
    pub device: Option<DeviceChoice>,
    /// Read arrays from storage buffers, as on graphics cards, where a driver on the processor would read texels.
    #[arg(long)]
    pub no_texel_buffers: bool,
    /// Print one JSON object per line instead of tables.
    #[arg(long)]
    pub json: bool,
}

/// Flags of `frame`. Flags of settings can be repeated, or take a list with commas: every combination is measured.
#[derive(Clone, Debug, Args)]
pub struct Frame {
    /// Scene description (.toml), model (.obj, .ply, .gltf, .glb, .xml), or room:N for a generated room of about N triangles.
    #[arg(long = "scene", value_name = "SCENE", default_values = ["scenes/cornell/scene.toml", "room:140000"])]
    pub scenes: Vec<String>,
    #[command(flatten)]
    pub common: Common,
    /// Particles started from the lights in each pass, 1 to 65536 [default: the scene's, or 16].
    #[arg(long, visible_alias = "paths", value_name = "N,...", value_delimiter = ',')]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=i64::from(Settings::MAX_PARTICLES)))]
    pub particles: Vec<u32>,
    /// Maximum segments of a light path, 1 to 16 [default: the scene's, or 5].
    #[arg(long, value_name = "K,...", value_delimiter = ',')]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=i64::from(Settings::MAX_DEPTH)))]
    pub max_depth: Vec<u32>,
    /// Maximum lights in one dispatch of the shading pass, 1 to 64 [default: 8].
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=64))]
    pub lights_per_dispatch: Vec<u32>,
    /// Traversal kernel for shadow rays: auto, single or cluster [default: auto].
    #[arg(long, value_name = "HOW,...", value_delimiter = ',', value_parser = traversal())]
    pub traversal: Vec<Traversal>,
    /// Order in which visible points are grouped into clusters: screen or space [default: screen].
    #[arg(long, value_name = "ORDER,...", value_delimiter = ',', value_parser = cluster_order())]
    pub cluster_order: Vec<ClusterOrder>,
    /// Pixels on each side of the squares whose light is computed once, 1 or 2 [default: 1].
    #[arg(long, value_name = "N,...", value_delimiter = ',')]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=i64::from(Settings::MAX_SHADING_RATE)))]
    pub shading_rate: Vec<u32>,
    /// Maximum number of glossy planes that mirror the room, largest first (--superposition variant): 0 to 255.
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(0..=255))]
    pub reflectors: Vec<u32>,
    /// Particles of splats (--glossy splats), 1 to 4000000.
    #[arg(long, value_name = "N,...", value_delimiter = ',')]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=i64::from(Splats::MAX_PARTICLES)))]
    pub splats: Vec<u32>,
    /// Use the settings of --preset interactive instead of the defaults and the scene's; other flags override them.
    #[arg(long)]
    pub interactive: bool,
    /// Do not restore the light that clipping cuts off, which drops the passes from the second bounce on.
    #[arg(long)]
    pub no_compensation: bool,
    /// Build a tree for each object, as dynamic scenes do, instead of one over all triangles.
    #[arg(long)]
    pub dynamic: bool,
}

/// Flags of `edits`.
#[derive(Clone, Debug, Args)]
pub struct Edits {
    /// Scene description (.toml), model (.obj, .ply, .gltf, .glb, .xml), or room:N for a generated room of about N triangles.
    #[arg(long = "scene", value_name = "SCENE", default_values = ["room:12000", "room:1200000"])]
    pub scenes: Vec<String>,
    #[command(flatten)]
    pub common: Common,
    /// Name of the object to move [default: the one with the most triangles].
    #[arg(long, value_name = "NAME")]
    pub object: Option<String>,
}

/// Flags of `master`.
#[derive(Clone, Debug, Args)]
pub struct Master {
    /// Scene description (.toml), model (.obj, .ply, .gltf, .glb, .xml), or room:N for a generated room of about N triangles.
    #[arg(long = "scene", value_name = "SCENE")]
    #[arg(default_values = ["scenes/cornell/scene.toml", "scenes/glass-ball/scene.toml", "scenes/indirect-room/scene.toml"])]
    pub scenes: Vec<String>,
    #[command(flatten)]
    pub common: Common,
    /// Tasks of a frame at least, 1 to 4096; one for each class of pixels at least.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub tasks: u32,
    /// Points are not rounded (--cluster-tasks tiles).
    #[arg(long, conflicts_with = "unpack_on_device")]
    pub exact: bool,
    /// The device unpacks points, as a graphics card does, where the master would on a processor.
    #[arg(long)]
    pub unpack_on_device: bool,
}

/// Flags of `convolve`.
#[derive(Clone, Debug, Args)]
pub struct Convolve {
    #[command(flatten)]
    pub common: Common,
    /// Widths of the kernels in pixels, 1 to 4096.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_value = "1,7,15,31,63,127")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub kernel_width: Vec<u32>,
    /// Algorithms: direct takes seconds from 31 pixels on; the error of fast is measured against direct.
    #[arg(long, value_name = "FORM,...", value_delimiter = ',', default_value = "direct,fast,invariant")]
    #[arg(value_parser = ["direct", "fast", "invariant"])]
    pub form: Vec<String>,
}

/// Where mirror images come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Source {
    /// Mirrored rays.
    #[default]
    Rays,
    /// Images with depth.
    Images,
}

impl Source {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Source::Rays => "rays",
            Source::Images => "images",
        }
    }
}

/// Flags of `motion`.
#[derive(Clone, Debug, Args)]
pub struct Motion {
    /// Scene description (.toml), model (.obj, .ply, .gltf, .glb, .xml), or room:N for a generated room of about N triangles.
    #[arg(long, value_name = "SCENE", default_value = "scenes/six-rooms/scene.toml")]
    pub scene: String,
    #[command(flatten)]
    pub common: Common,
    /// Pixels that the middle of the image moves while the shutter is open (onwards: its left and right edges), 0 to 1023.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_value = "0,7,15,31,63")]
    #[arg(value_parser = clap::value_parser!(u32).range(0..=1023))]
    pub pixels: Vec<u32>,
    /// Motion of the camera: turn, sideways or onwards.
    #[arg(long, value_name = "HOW,...", value_delimiter = ',', default_value = "turn,sideways,onwards")]
    #[arg(value_parser = ["turn", "sideways", "onwards"])]
    pub camera: Vec<String>,
}

/// Flags of `shadows`.
#[derive(Clone, Debug, Args)]
pub struct Shadows {
    /// Scene description (.toml), model (.obj, .ply, .gltf, .glb, .xml), or room:N for a generated room of about N triangles [default: boards
    /// above a floor, by --pixels].
    #[arg(long, value_name = "SCENE", conflicts_with = "pixels")]
    pub scene: Option<String>,
    #[command(flatten)]
    pub common: Common,
    /// Widths of the penumbrae of the boards in the middle of the image, pixels, 1 to 255.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_value = "1,7,15,31,63")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=255))]
    pub pixels: Vec<u32>,
    /// Numbers of emitters whose shadows are convolved, of --scene; 0: none.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_value = "0,1,4", requires = "scene")]
    #[arg(value_parser = clap::value_parser!(u32).range(0..=i64::from(SoftShadows::MAX_LIGHTS)))]
    pub lights: Vec<u32>,
}

/// Flags of `walkthrough`.
#[derive(Clone, Debug, Args)]
pub struct Walkthrough {
    /// Scene description (.toml) or model (.obj, .ply, .gltf, .glb, .xml).
    #[arg(long, value_name = "SCENE", default_value = "scenes/six-rooms/scene.toml")]
    pub scene: String,
    /// Path file, as lightsum animate --path plays it.
    #[arg(long, value_name = "FILE", default_value = "scenes/six-rooms/walk.toml")]
    pub path: PathBuf,
    /// Numbers of glossy planes that mirror the room, largest first: one number, or a range with both its ends [default: from none to all
    /// of the scene].
    #[arg(long, value_name = "A..B", value_parser = reflectors)]
    pub reflectors: Option<RangeInclusive<u32>>,
    /// Sources of mirror images, each played with all these numbers: rays, images (with depth, sampled before the first frame) or both,
    /// with a comma.
    #[arg(long, value_name = "SOURCE,...", default_value = "rays", value_delimiter = ',', value_parser = mirror_source())]
    pub mirror_source: Vec<Source>,
    /// Number of frames, spread evenly over the path [default: the path's].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub frames: Option<u32>,
    /// Play only every K-th frame.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    /// Image size in pixels.
    #[arg(long, value_name = "WxH", default_value = "720x486", value_parser = resolution)]
    pub resolution: [u32; 2],
    /// Vulkan device: part of its name, its index in lightsum --list-devices, or cpu [default: the fastest kind available].
    #[arg(long, value_name = "NAME|INDEX|cpu")]
    pub device: Option<DeviceChoice>,
    /// Print one JSON object for each number of reflectors instead of tables.
    #[arg(long)]
    pub json: bool,
    /// Write all frames with their times, and the means of the tables, to this JSON file.
    #[arg(long, value_name = "FILE.json")]
    pub timings: Option<PathBuf>,
    /// Draw frame times along the path (of the last source), and frames per second over the number of reflectors, as an SVG file.
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// Write the images to this folder, which must exist: SOURCE-REFLECTORS-FRAME.exr.
    #[arg(long, value_name = "DIR")]
    pub images: Option<PathBuf>,
}

/// Flags of `shadow-rays`.
#[derive(Clone, Debug, Args)]
pub struct ShadowRays {
    /// Scene description (.toml), model (.obj, .ply, .gltf, .glb, .xml), or room:N for a generated room of about N triangles.
    #[arg(long = "scene", value_name = "SCENE", default_value = "room:140000")]
    pub scenes: Vec<String>,
    #[command(flatten)]
    pub common: Common,
    /// Number of point lights, chosen evenly from those of a pass.
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub lights: u32,
    /// Also count, in a separate run, the nodes, children, leaves and triangles that clusters visit for each light.
    #[arg(long)]
    pub counters: bool,
    /// Count the shading points whose number of visible lights differs from that of rays traced on the CPU.
    #[arg(long)]
    pub verify: bool,
    /// Measure only this kernel.
    #[arg(long, value_name = "KERNEL", value_parser = ["single", "cluster"])]
    pub only: Option<String>,
    /// Maximum lights in one dispatch, 1 to 64 [default: the renderer's].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub lights_per_dispatch: Option<u32>,
    /// Clusters of pixels of one class of this interleaving pattern, which lie further apart, as in frames.
    #[arg(long, value_name = "WxH", default_value = "1x1", value_parser = pattern)]
    pub interleave: [u32; 2],
    /// Area lights instead of point lights: each shading point traces a ray to its own point on a square in front of each light.
    ///
    /// The value is the edge of the square as a fraction of the scene's diagonal, 0 to 0.5 [without a value: 0.05].
    #[arg(long, value_name = "SHARE", num_args = 0..=1, default_missing_value = "0.05", value_parser = share)]
    pub area: Option<f64>,
    /// Write triangles, shading points in cluster order, normals and lights as little-endian arrays to this folder.
    #[arg(long, value_name = "DIR")]
    pub dump_rays: Option<PathBuf>,
}

/// Flags of `scaling`.
#[derive(Clone, Debug, Args)]
pub struct Scaling {
    /// The variable: triangles from 1,000 to 4,000,000, paths from 1 to 256, or pixels from a quarter of --resolution to
    /// twice it each way [default: each in turn].
    #[arg(long = "series", value_name = "WHAT,...", value_delimiter = ',', value_parser = series())]
    pub series: Vec<Series>,
    #[command(flatten)]
    pub common: Common,
    /// Maximum number of triangles; 4,000,000 take 2 GiB of memory.
    #[arg(long, value_name = "N", default_value_t = 4_000_000, value_parser = clap::value_parser!(u32).range(300..=8_000_000))]
    pub max_triangles: u32,
    /// Maximum number of particles.
    #[arg(long, visible_alias = "max-paths", value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=i64::from(Settings::MAX_PARTICLES)))]
    pub max_particles: u32,
}

/// The variable of a series of `scaling`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Series {
    /// Triangles of the room.
    Triangles,
    /// Particles started in each pass.
    Lights,
    /// Pixels.
    Resolution,
}

/// Flags of `startup`.
#[derive(Clone, Debug, Args)]
pub struct Startup {
    /// Scene description (.toml), model (.obj, .ply, .gltf, .glb, .xml), or room:N for a generated room of about N triangles.
    #[arg(long = "scene", value_name = "SCENE", default_values = ["scenes/cornell/scene.toml", "room:140000"])]
    pub scenes: Vec<String>,
    #[command(flatten)]
    pub common: Common,
}

/// Flags of `startup-once`.
#[derive(Clone, Debug, Args)]
pub struct StartupOnce {
    /// The scene.
    #[arg(long)]
    pub scene: String,
    /// Image size in pixels.
    #[arg(long, value_parser = resolution)]
    pub resolution: [u32; 2],
    /// The device.
    #[arg(long)]
    pub device: DeviceChoice,
    /// File that keeps compiled pipelines.
    #[arg(long)]
    pub pipeline_cache: PathBuf,
}

/// Flags of `compare`.
#[derive(Clone, Debug, Args)]
pub struct Compare {
    #[command(flatten)]
    pub rays: ShadowRays,
    /// Program that traces a dumped workload with Embree: PATH DIR prints one JSON line for each packet size.
    #[arg(long, value_name = "PATH")]
    pub embree: PathBuf,
    /// Number of turns of each program.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    pub turns: u32,
}

fn resolution(text: &str) -> Result<[u32; 2], String> {
    let parts = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    match parts {
        Some([w, h]) if w > 0 && h > 0 && u64::from(w) * u64::from(h) <= MAX_PIXELS => Ok([w, h]),
        _ => Err("is not a size like 640x480 of at most 2^26 pixels".into()),
    }
}

fn pattern(text: &str) -> Result<[u32; 2], String> {
    match resolution(text) {
        Ok(pattern) if pattern.iter().all(|&n| n <= Settings::MAX_PATTERN) => Ok(pattern),
        _ => Err("is not a pattern like 3x3 of at most 8x8".into()),
    }
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(share) if (0.0..=0.5).contains(&share) => Ok(share),
        _ => Err("is not a number from 0 to 0.5".into()),
    }
}

/// A range with both its ends, or one number.
fn reflectors(text: &str) -> Result<RangeInclusive<u32>, String> {
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    match (first.parse(), last.parse()) {
        (Ok(first), Ok(last)) if first > last => Err(format!("is empty; {last}..{first} is not")),
        (Ok(first), Ok(last)) if last <= MAX_REFLECTORS => Ok(first..=last),
        _ => Err(format!("is not a number or a range like 0..5, up to {MAX_REFLECTORS}")),
    }
}

fn traversal() -> impl TypedValueParser<Value = Traversal> {
    PossibleValuesParser::new(["auto", "single", "cluster"]).map(|name| match name.as_str() {
        "single" => Traversal::Single,
        "cluster" => Traversal::Cluster,
        _ => Traversal::Auto,
    })
}

fn cluster_order() -> impl TypedValueParser<Value = ClusterOrder> {
    PossibleValuesParser::new(["screen", "space"]).map(|name| match name.as_str() {
        "space" => ClusterOrder::Space,
        _ => ClusterOrder::Screen,
    })
}

fn mirror_source() -> impl TypedValueParser<Value = Source> {
    PossibleValuesParser::new(["rays", "images"]).map(|name| match name.as_str() {
        "images" => Source::Images,
        _ => Source::Rays,
    })
}

fn series() -> impl TypedValueParser<Value = Series> {
    PossibleValuesParser::new(["triangles", "lights", "resolution"]).map(|name| match name.as_str() {
        "triangles" => Series::Triangles,
        "lights" => Series::Lights,
        _ => Series::Resolution,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;
    use clap::error::ErrorKind;

    fn parse(line: &str) -> Result<Command, clap::Error> {
        Arguments::try_parse_from(["lightsum-bench"].into_iter().chain(line.split_whitespace())).map(|a| a.command)
    }

    #[test]
    fn the_definition_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn settings_are_lists() {
        let Ok(Command::Frame(frame)) = parse(
            "frame --particles 8,32 --particles 1 --max-depth 2 --traversal single,cluster --repeats 3 --resolution 17X5",
        ) else {
            panic!("the line is right")
        };
        assert_eq!((frame.particles, frame.max_depth), (vec![8, 32, 1], vec![2]));
        assert_eq!(frame.traversal, [Traversal::Single, Traversal::Cluster]);
        assert_eq!((frame.common.repeats, frame.common.resolution), (3, [17, 5]));
        assert!(frame.lights_per_dispatch.is_empty() && !frame.no_compensation && !frame.common.json);
    }

    #[test]
    fn reflectors_are_a_range_with_both_ends() {
        assert_eq!(super::reflectors("0..5"), Ok(0..=5));
        assert_eq!(super::reflectors("3"), Ok(3..=3));
        for wrong in ["5..0", "", "..", "0..", "0..256", "-1..2", "0-5"] {
            assert!(super::reflectors(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn scenes_replace_the_default_ones() {
        let Ok(Command::Startup(default)) = parse("startup") else { panic!("the line is right") };
        assert_eq!(default.scenes, ["scenes/cornell/scene.toml", "room:140000"]);
        let Ok(Command::Startup(given)) = parse("startup --scene a.obj --scene b.glb --device cpu") else {
            panic!("the line is right")
        };
        assert_eq!(given.scenes, ["a.obj", "b.glb"]);
        assert_eq!(given.common.device, Some(DeviceChoice::Cpu));
    }

    #[test]
    fn series_are_chosen() {
        let Ok(Command::Scaling(scaling)) = parse("scaling --series lights,triangles --max-particles 4") else {
            panic!("the line is right")
        };
        assert_eq!(scaling.series, [Series::Lights, Series::Triangles]);
        assert_eq!((scaling.max_particles, scaling.max_triangles), (4, 4_000_000));
    }

    #[test]
    fn wrong_use_is_refused() {
        for (line, kind) in [
            ("frame --particles 0", ErrorKind::ValueValidation),
            ("frame --particles 1,70000", ErrorKind::ValueValidation),
            ("frame --max-depth 17", ErrorKind::ValueValidation),
            ("frame --traversal best", ErrorKind::InvalidValue),
            ("frame --resolution 0x5", ErrorKind::ValueValidation),
            ("frame --resolution 8193x8192", ErrorKind::ValueValidation),
            ("frame --repeats 0", ErrorKind::ValueValidation),
            ("shadow-rays --area 0.6", ErrorKind::ValueValidation),
            ("shadow-rays --area large", ErrorKind::ValueValidation),
            ("shadow-rays --interleave 9x1", ErrorKind::ValueValidation),
            ("frame --pathz 3", ErrorKind::UnknownArgument),
            ("scaling --series colours", ErrorKind::InvalidValue),
            ("scaling --max-triangles 10", ErrorKind::ValueValidation),
            ("convolve --kernel-width 0", ErrorKind::ValueValidation),
            ("convolve --form slow", ErrorKind::InvalidValue),
            ("compare", ErrorKind::MissingRequiredArgument),
            ("paint", ErrorKind::InvalidSubcommand),
        ] {
            assert_eq!(parse(line).expect_err(line).kind(), kind, "{line}");
        }
    }
}
