//! The flags, their help and their syntax. `render` decides how they combine.

mod bake;
mod camera;
mod choices;
mod cluster;
mod compare;
mod kept;
mod keys;
mod manual;
mod play;
mod reading;
mod reference;
mod short_help;
mod values;
#[cfg(feature = "viewer")]
mod view;

use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use lightsum::gpu::DeviceChoice;
use lightsum::settings::Exposure;
use lightsum::view::Region;
use std::path::PathBuf;
use std::time::Duration;

pub use bake::Bake;
pub use camera::Camera;
pub use choices::{Curve, Denoiser, SpecularFlag};
pub use cluster::{Cluster, ClusterTasks, Merge, PartFlag, Ranks};
pub use compare::{Compare, Devices, Measure};
pub use kept::KeptLight;
pub use keys::Keys;
pub use manual::Manual;
pub use play::{Play, Pose};
pub use reading::Reading;
pub use reference::Reference;
pub use short_help::{command, parse};
#[cfg(feature = "viewer")]
pub use values::extent;
use values::{address, bytes, checkpoint, crop, exposure, image_path, output_path, resolution, seconds};
pub use values::{check_resolution, is_film};
#[cfg(all(feature = "viewer", feature = "mpi"))]
pub use view::Sent;
#[cfg(feature = "viewer")]
pub use view::{MAX_COARSER, View};

/// Global illumination without noise: a sum over virtual lights (instant radiosity), computed by Vulkan.
#[derive(Debug, Parser)]
#[command(name = "lightsum", version, arg_required_else_help = true)]
pub struct Arguments {
    /// List the Vulkan devices with their indices, then exit.
    #[arg(long)]
    pub list_devices: bool,
    /// Tell more on standard error; -vv: every step.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// Tell errors only: no warnings, no progress.
    #[arg(short, long, global = true)]
    pub quiet: bool,
    /// Write what is told, and what -v would tell, to a file, with the seconds since the start.
    #[arg(long, global = true, value_name = "FILE", hide_short_help = true)]
    pub log_file: Option<PathBuf>,
    /// The subcommand.
    #[command(subcommand)]
    pub command: Option<Command>,
}

impl Arguments {
    /// Whether it is for one process, although a launcher may have started several.
    pub fn is_of_one_process(&self) -> bool {
        match &self.command {
            Some(Command::Render(render)) => render.list_devices || render.cluster.shard.is_some(),
            Some(
                Command::Info(_) | Command::Merge(_) | Command::Compare(_) | Command::Devices(_) | Command::Manual(_),
            )
            | None => true,
            _ => false,
        }
    }
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a scene to an image.
    ///
    /// A flag overrides --set, which overrides --settings, which overrides the scene file's [render], which overrides the preset.
    Render(Box<Render>),
    /// Play the animation of a model, or a recorded path, into images.
    ///
    /// A path has keyframes of camera and objects. Frames, their timings, or both are written. The scene is loaded once; each frame updates only the objects that move. Frames without changes accumulate.
    Animate(Box<Animate>),
    /// Keep the light of a scene in textures: a model with light maps.
    ///
    /// The model is a .glb file, and the maps lie beside it. `render --light-from` shows it again, in a time that does not depend on the number of lights; so do engines that know light
    /// maps, and with --unlit any viewer.
    Bake(Box<Bake>),
    /// Show a scene in a window: walk, move objects, change settings.
    ///
    /// H shows the keys.
    #[cfg(feature = "viewer")]
    View(Box<View>),
    /// Add up films of `render --shard` to an image or a film.
    ///
    /// In any order the image has the bits of one rendering of all passes. Films of a part of them merge too; what is missing is told.
    Merge(Merge),
    /// Print what a scene holds, and what was left out of it.
    ///
    /// Triangles, materials, lights with their power, textures, size, camera, memory.
    Info(Info),
    /// Compare two images: relative RMSE, ratio of energies, FLIP.
    ///
    /// RMSE and energies are those of linear radiance.
    Compare(Compare),
    /// List the Vulkan devices with their indices.
    Devices(Devices),
    /// Print or write completions, pages of the manual and the reference.
    #[command(subcommand, hide = true)]
    Manual(Manual),
}

/// Flags of `info`.
#[derive(Debug, Args)]
pub struct Info {
    /// Scene description (.toml) or bare model (.obj, .ply, .gltf, .glb, .xml).
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub reading: Reading,
}

/// Flags of `animate`.
#[derive(Debug, Args)]
pub struct Animate {
    /// Scene description (.toml) or bare model (.obj, .ply, .gltf, .glb, .xml).
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Path file (.toml): frames, and keyframes of camera and objects. See docs/scene-files.md for its format.
    ///
    /// Without it the model plays an animation of its own.
    #[arg(long, value_name = "FILE.toml")]
    pub path: Option<PathBuf>,
    /// Images to write (.exr or .png), with %d or %04d for the frame number. Without it no image is written.
    #[arg(short, long, value_name = "PATTERN", value_parser = PathBufValueParser::new().try_map(image_path))]
    pub output: Option<PathBuf>,
    /// Write the seconds of each frame (edits, recording, GPU passes) as JSON.
    #[arg(long, value_name = "FILE.json")]
    pub timings: Option<PathBuf>,
    /// Write settings, device, counts, rays and the seconds of each stage of all frames together as JSON.
    #[arg(long, value_name = "FILE.json")]
    pub stats: Option<PathBuf>,
    /// Write EXR files with layers: albedo, normal, depth and irradiance.
    #[arg(long)]
    pub layers: bool,
    /// Also write what the centres of the pixels show as layers of EXR files: object and material by their numbers, texture coordinates, and with an open shutter motion in pixels.
    ///
    /// Numbers count from 0 in the order of the scene; -1 is the background. Mirrors and glass are surfaces like others here. The names
    /// are there as Cryptomatte layers, CryptoObject and CryptoMaterial, with one rank and hard edges.
    #[arg(long, requires = "layers")]
    pub surfaces: bool,
    /// Write the colour of EXR files as 32-bit float instead of 16-bit half. Doubles its size.
    #[arg(long)]
    pub float: bool,
    #[command(flatten)]
    pub play: Play,
    #[command(flatten)]
    pub shown: Moving,
    #[command(flatten)]
    pub cluster: Ranks,
    /// Under mpirun, what a rank is asked for.
    ///
    /// frames: whole frames. tiles: points in a part of a frame, shaded, of which rank 0 makes the image: for frames that are wanted soon.
    /// packed-tiles: the same in a tenth of the bytes, rounded.
    #[arg(long, value_name = "TASKS", value_enum, default_value = "frames", help_heading = "Cluster")]
    pub cluster_tasks: ClusterTasks,
}

/// Flags of what shows a scene that moves.
#[derive(Clone, Debug, Args)]
pub struct Moving {
    /// Image size in pixels [default: the scene's, or 640x480]; a window is wider by its panel.
    #[arg(long, value_name = "WxH", value_parser = resolution)]
    pub resolution: Option<[u32; 2]>,
    /// Exposure in stops, or auto: by the brightness of the first image [default: the scene's, or 0].
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true, value_parser = exposure)]
    pub exposure: Option<Exposure>,
    /// Tone curve of the window and of PNG files.
    #[arg(long, value_name = "CURVE", value_enum, default_value = "srgb")]
    pub tonemap: Curve,
    #[command(flatten)]
    pub kept: KeptLight,
    #[command(flatten)]
    pub camera: Camera,
    #[command(flatten)]
    pub reading: Reading,
    #[command(flatten)]
    pub keys: Keys,
    #[command(flatten)]
    pub device: Device,
}

/// Flags of `render`.
#[derive(Debug, Args)]
pub struct Render {
    /// Scene description (.toml) or bare model (.obj, .ply, .gltf, .glb, .xml).
    #[arg(value_name = "SCENE", required_unless_present = "list_devices")]
    pub scene: Option<PathBuf>,
    /// List the Vulkan devices with their indices, then exit.
    #[arg(long)]
    pub list_devices: bool,

    #[command(flatten)]
    pub output: Output,
    #[command(flatten)]
    pub stop: Stop,
    #[command(flatten)]
    pub pose: Pose,
    /// Show camera and objects as a path file (.toml) of `animate` has them at --at [default: at its first frame].
    #[arg(long, value_name = "FILE.toml", help_heading = "Pose")]
    pub path: Option<PathBuf>,
    #[command(flatten)]
    pub reading: Reading,
    #[command(flatten)]
    pub keys: Keys,
    #[command(flatten)]
    pub camera: Camera,
    #[command(flatten)]
    pub device: Device,
    #[command(flatten)]
    pub cluster: Cluster,
    #[command(flatten)]
    pub reference: Reference,
}

/// Output files and their encoding.
#[derive(Debug, Args)]
#[command(next_help_heading = "Output")]
pub struct Output {
    /// Image to write: .exr (linear, with layers) or .png (for display). Can be repeated. A .film is for `merge`. `/dev/stdout` and other pipes
    /// take PNG.
    #[arg(short, long = "output", value_name = "FILE", value_parser = PathBufValueParser::new().try_map(output_path))]
    #[arg(required_unless_present_any = ["list_devices", "export_lights", "stats", "display"])]
    pub outputs: Vec<PathBuf>,
    /// Image size in pixels [default: the scene's, or 640x480]. Time and memory grow with the number of pixels.
    #[arg(long, value_name = "WxH", value_parser = resolution)]
    pub resolution: Option<[u32; 2]>,
    /// Render this part of the image alone: left, top, width and height in pixels.
    /// It has the bits of the whole image. With --compensation exact it costs the blocks of pixels around it; with near,
    /// superposition, a lens or `--light-choice contribution` the whole image is rendered all the same.
    #[arg(long, value_name = "X,Y,W,H", value_parser = crop)]
    pub crop: Option<Region>,
    /// Exposure of PNG files in stops, or auto; each stop doubles the brightness [default: the scene's, or 0].
    ///
    /// With auto the logarithmic mean of the luminance becomes middle grey.
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true, value_parser = exposure)]
    pub exposure: Option<Exposure>,
    /// Tone curve of PNG files.
    #[arg(long, value_name = "CURVE", value_enum, default_value = "srgb")]
    pub tonemap: Curve,
    /// Write the colour of EXR files as 32-bit float instead of 16-bit half. Doubles its size.
    #[arg(long)]
    pub float: bool,
    /// Rewrite the images every so many seconds while they are rendered. A file is always whole.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = seconds, requires = "outputs")]
    pub preview: Option<Duration>,
    /// Show the image in the viewer tev while it is rendered; tev listens at 127.0.0.1:14158.
    ///
    /// Sent at most twice a second. If the connection is lost, the rendering goes on without.
    #[arg(long, value_name = "HOST:PORT", value_parser = address)]
    pub display: Option<String>,
    /// Also write what the centres of the pixels show as layers of EXR files: object and material by their numbers, texture coordinates, and with an open shutter motion in pixels.
    ///
    /// Numbers count from 0 in the order of the scene; -1 is the background. Mirrors and glass are surfaces like others here. The names
    /// are there as Cryptomatte layers, CryptoObject and CryptoMaterial, with one rank and hard edges.
    #[arg(long, conflicts_with_all = ["no_layers", "reference", "shard"])]
    pub surfaces: bool,
    /// Write EXR files without layers: smaller, and for programs that read only colour and alpha.
    #[arg(long)]
    pub no_layers: bool,
    /// Remove noise by a neural network (in builds with the feature oidn). Its error is its own: for a look, not for measuring.
    #[arg(long, value_name = "WAY", value_enum, conflicts_with_all = ["summands", "reference"])]
    pub denoise: Option<Denoiser>,
    #[command(flatten)]
    pub kept: KeptLight,
    /// Write device, counts, rays and the seconds of each stage and GPU pass as JSON.
    #[arg(long, value_name = "FILE.json")]
    pub stats: Option<PathBuf>,
    /// Write the scene with the virtual lights of a pass as glTF (KHR_lights_punctual).
    ///
    /// lightsum and other renderers can load the file. All pixels share them, unless --interleave says otherwise. Without
    /// --output or --stats no image is rendered.
    #[arg(long, value_name = "FILE.gltf", conflicts_with = "light_from")]
    pub export_lights: Option<PathBuf>,
}

/// Stopping conditions: the first one met ends the rendering.
#[derive(Debug, Args)]
#[command(next_help_heading = "End")]
pub struct Stop {
    /// Resume from the state file next to the first output (OUTPUT.state) if it exists, and write it at the end.
    ///
    /// Scene, camera and settings must be the same. The result equals that of an uninterrupted run bit for bit. An
    /// interrupt (Ctrl-C, SIGTERM, SIGHUP) writes image and state with or without this flag, and so does an error in a pass.
    #[arg(long, requires = "outputs")]
    pub resume: bool,
    /// Seconds between checkpoints of the state file, from which --resume goes on after a crash, or off.
    ///
    /// A rendering that ends before the first one writes none; one that is done removes them, unless --resume is given. Images in strips
    /// have none. A checkpoint takes some 150 bytes a pixel.
    #[arg(long, value_name = "SECONDS", default_value = "60", allow_negative_numbers = true, value_parser = checkpoint)]
    pub checkpoint: CheckpointFlag,
}

/// Time between checkpoints; `None`: there are none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckpointFlag(pub Option<Duration>);

/// Device and execution.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Device")]
pub struct Device {
    /// Vulkan device: part of its name, its index in --list-devices, or cpu [default: the fastest kind available].
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<DeviceChoice>,
    /// Run under the Vulkan validation layer, which must be installed. Slower.
    #[arg(long)]
    pub validation: bool,
    /// Memory that a rendering may take on the device, such as 512M or 4G [default: what is free].
    ///
    /// A rendering that needs more is refused before its first pass.
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub max_device_memory: Option<u64>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;
    use clap::error::ErrorKind;
    use glam::DVec3;

    fn parse(line: &str) -> Result<Box<Render>, clap::Error> {
        let arguments = Arguments::try_parse_from(["lightsum", "render"].into_iter().chain(line.split_whitespace()))?;
        match arguments.command {
            Some(Command::Render(render)) => Ok(render),
            _ => unreachable!("the line names the command"),
        }
    }

    #[test]
    fn the_definition_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn every_flag_and_every_value_has_help() {
        let mut root = Arguments::command();
        root.build();
        for command in root.get_subcommands().chain([&root]) {
            // clap writes the help of these two.
            for argument in command.get_arguments().filter(|a| !["help", "version"].contains(&a.get_id().as_str())) {
                let name = format!("{} {}", command.get_name(), argument.get_id());
                let words = argument.get_help().map(ToString::to_string).unwrap_or_default();
                assert!(words.len() > 10, "{name}: {words:?}");
                let is_bare = |value: &clap::builder::PossibleValue| value.get_help().is_none();
                let takes_values = argument.get_action().takes_values();
                assert!(!takes_values || !argument.get_possible_values().iter().any(is_bare), "{name}: a value");
            }
        }
    }

    #[test]
    fn values_are_understood() {
        let line =
            "a.toml -o a.exr --output b.png --resolution 17x5 --eye -1,2.5,-3e2 --up 0,0,1 --exposure -1.5 --time 0.5";
        let render = parse(line).unwrap();
        assert_eq!(render.output.outputs, [PathBuf::from("a.exr"), PathBuf::from("b.png")]);
        assert_eq!(render.output.resolution, Some([17, 5]));
        assert_eq!(render.camera.eye, Some(DVec3::new(-1.0, 2.5, -300.0)));
        assert_eq!(render.output.exposure, Some(Exposure::Stops(-1.5)));
        assert_eq!(render.keys.flags.time, Some(0.5));
        for (text, number) in [("all", None), ("12", Some(12))] {
            let render = parse(&format!("a.toml -o a.exr --delta-lights {text}")).unwrap();
            assert_eq!(render.keys.flags.delta_lights, Some(number));
        }
        parse("--list-devices").unwrap();
        parse("a.obj --export-lights l.gltf").unwrap();
    }

    #[test]
    fn wrong_use_is_refused() {
        for line in [
            "a.toml -o a.jpg",
            "a.toml -o a.exr --resolution 0x5",
            "a.toml -o a.exr --resolution 8193x8192",
            "a.toml -o a.exr --resolution 65536x65536",
            "a.toml -o a.exr --resolution 640",
            "a.toml -o a.exr --eye 1,2",
            "a.toml -o a.exr --eye 1,2,nan",
            "a.toml -o a.exr --fov 180",
            "a.toml -o a.exr --aperture -1",
            "a.toml -o a.exr --aperture nan",
            "a.toml -o a.exr --focus 0",
            "a.toml -o a.exr --shutter -0.1",
            "a.toml -o a.exr --shutter nan",
            "a.toml -o a.exr --shutter inf",
            "a.toml -o a.exr --focus -2",
            "a.toml -o a.exr --time 0",
            "a.toml -o a.exr --time nan",
            "a.toml -o a.exr --time 1e300",
            "a.toml -o a.exr --clip -1",
            "a.toml -o a.exr --delta-lights 2049",
            "a.toml -o a.exr --delta-lights none",
            "a.toml -o a.exr --target-error 0",
            "a.toml -o a.exr --exposure inf",
            "a.toml -o a.exr --glossy splats --splat-particles 0",
            "a.toml -o a.exr --glossy splats --splat-width 0.5",
            "a.toml -o a.exr --glossy splats --splat-alpha nan",
        ] {
            let kind = parse(line).unwrap_err().kind();
            assert!(matches!(kind, ErrorKind::ValueValidation | ErrorKind::UnknownArgument), "{line}: {kind:?}");
        }
        for line in ["a.toml -o a.exr --clip 1 --clip-fraction 1", "a.toml -o a.exr --reference --passes 4"] {
            assert_eq!(parse(line).unwrap_err().kind(), ErrorKind::ArgumentConflict, "{line}");
        }
        for line in ["a.toml", "-o a.exr", "a.toml -o a.exr --spp 4"] {
            assert_eq!(parse(line).unwrap_err().kind(), ErrorKind::MissingRequiredArgument, "{line}");
        }
    }

    #[test]
    fn the_greatest_image_is_allowed() {
        assert!(check_resolution([8192, 8192]).is_ok());
    }
}
