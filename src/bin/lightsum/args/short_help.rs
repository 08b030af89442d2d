//! The command as a whole: the short help (`-h`), which fits a screen, and opposites of switches.

use clap::{Arg, ArgAction, Command, CommandFactory, FromArgMatches};

use super::Arguments;

/// The flags that the short help of a command shows, each with a text that fits its line. Heads are at most 20 wide: beyond that clap puts
/// texts on lines of their own.
const COMMON: [(&str, &[(&str, &str)]); 4] = [
    (
        "render",
        &[
            ("scene", "Scene (.toml) or model (.obj, .ply, .gltf, .glb, .xml)"),
            ("outputs", "Image to write (.exr, .png); can be repeated"),
            ("resolution", "Size of the image [default: 640x480]"),
            ("exposure", "Exposure of PNG files, or auto [default: 0]"),
            ("passes", "Number of passes [default: 64]"),
            ("time", "Stop after so many seconds"),
            ("target_error", "Stop at this relative error, such as 0.01"),
            ("preset", "Preset"),
            ("particles", "Particles a pass [default: 16]"),
            ("seed", "Random seed [default: 0]"),
            ("eye", "Eye point"),
            ("target", "Point at the centre of the image"),
            ("device", "Device: name, index or cpu"),
            ("set", "Set any key of [render]; can be repeated"),
            ("stats", "Write times and counts as JSON"),
        ],
    ),
    (
        "animate",
        &[
            ("scene", "Scene (.toml) or model (.obj, .ply, .gltf, .glb, .xml)"),
            ("path", "Keyframes of camera and objects"),
            ("output", "Images to write, such as frame-%04d.png"),
            ("moving_passes", "Passes per frame [default: 4]"),
            ("animation", "Animation of the model: its name, or all"),
            ("fps", "Frames per second [default: 24]"),
            ("resolution", "Size of the image [default: 640x480]"),
            ("exposure", "Exposure, or auto [default: 0]"),
            ("preset", "Preset"),
            ("particles", "Particles a pass [default: 16]"),
            ("device", "Device: name, index or cpu"),
            ("set", "Set any key of [render]; can be repeated"),
        ],
    ),
    (
        "bake",
        &[
            ("scene", "Scene (.toml) or model (.obj, .ply, .gltf, .glb, .xml)"),
            ("outputs", "Model to write, with its maps beside it"),
            ("density", "Texels along a unit of length"),
            ("unlit", "Textures of light times albedo for any viewer"),
            ("adaptive", "Split surfaces where light differs by more"),
            ("passes", "Number of passes [default: 64]"),
            ("time", "Stop after so many seconds"),
            ("target_error", "Stop at this relative error, such as 0.01"),
            ("resume", "Go on from OUTPUT.state"),
            ("preset", "Preset"),
            ("particles", "Particles in each pass"),
            ("seed", "Random seed [default: 0]"),
            ("device", "Device: name, index or cpu"),
            ("set", "Set any key of [render]; can be repeated"),
        ],
    ),
    (
        "view",
        &[
            ("scene", "Scene (.toml) or model (.obj, .ply, .gltf, .glb, .xml)"),
            ("passes", "Passes of the still image [default: 1024]"),
            ("coarser", "Render N times smaller while it moves"),
            ("resolution", "Size of the image [default: 640x480]"),
            ("exposure", "Exposure, or auto [default: 0]"),
            ("preset", "Preset"),
            ("ring", "Ring of paths"),
            ("particles", "Particles a pass [default: 16]"),
            ("max_depth", "Maximum segments of a path [default: 16]"),
            ("eye", "Eye point"),
            ("target", "Point at the centre of the image"),
            ("device", "Device: name, index or cpu"),
            ("set", "Set any key of [render]; can be repeated"),
        ],
    ),
];

/// Switches that ask for something else than a rendering.
const WITHOUT_OPPOSITE: [&str; 4] = ["list_devices", "reference", "json", "quiet"];

/// The command line.
pub fn command() -> Command {
    Arguments::command().mut_subcommands(|command| with_short_help(with_opposites(command)))
}

/// Reads the command line. Help, and wrong use, end the program.
pub fn parse() -> Arguments {
    let matches = command().get_matches();
    Arguments::from_arg_matches(&matches).unwrap_or_else(|error| error.format(&mut command()).exit())
}

/// Shows the common flags in the short help, and in the long one before all others.
fn with_short_help(command: Command) -> Command {
    let Some((_, common)) = COMMON.iter().find(|(name, _)| *name == command.get_name()) else { return command };
    command.mut_args(|arg| match common.iter().find(|(id, _)| *id == arg.get_id().as_str()) {
        Some((_, short)) => {
            let long = arg.get_long_help().or(arg.get_help()).cloned().unwrap_or_default();
            arg.help(*short).long_help(long).help_heading(None).hide_short_help(false)
        }
        None => arg.hide_short_help(true),
    })
}

/// Gives every switch an opposite, if it has none; the last one of both counts.
fn with_opposites(command: Command) -> Command {
    let known: Vec<String> = command.get_arguments().map(|arg| arg.get_id().to_string()).collect();
    let opposite = |id: &str| id.strip_prefix("no_").map_or(format!("no_{id}"), String::from);
    let is_switch = |arg: &&Arg| matches!(arg.get_action(), ArgAction::SetTrue);
    let lonely: Vec<String> = (command.get_arguments().filter(is_switch))
        .map(|arg| arg.get_id().to_string())
        .filter(|id| !known.contains(&opposite(id)) && !WITHOUT_OPPOSITE.contains(&id.as_str()))
        .collect();
    lonely.iter().fold(command, |command, id| {
        let other = opposite(id);
        let arg = Arg::new(other.clone()).long(other.replace('_', "-")).action(ArgAction::SetTrue).hide(true);
        let help = format!("Not --{}", id.replace('_', "-"));
        command.mut_arg(id, |arg| arg.overrides_with(other.clone())).arg(arg.help(help).overrides_with(id.clone()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::{Command as Chosen, Render};

    fn parse(line: &str) -> Box<Render> {
        let words = ["lightsum", "render", "a.toml", "-o", "a.exr"].into_iter().chain(line.split_whitespace());
        let matches = command().try_get_matches_from(words).unwrap_or_else(|error| panic!("{line}: {error}"));
        match Arguments::from_arg_matches(&matches).unwrap().command {
            Some(Chosen::Render(render)) => render,
            _ => unreachable!("the line names the command"),
        }
    }

    #[test]
    fn the_command_is_consistent_and_common_flags_exist() {
        command().debug_assert();
        let command = command();
        for (name, common) in COMMON {
            // Without the window there is no such command.
            let Some(command) = command.find_subcommand(name) else { continue };
            for (id, _) in common {
                assert!(command.get_arguments().any(|arg| arg.get_id() == *id), "{name}: {id}");
            }
        }
    }

    #[test]
    fn the_last_of_a_switch_and_its_opposite_counts() {
        let of = |line: &str| {
            let render = parse(line);
            let (output, device) = (&render.output, &render.device);
            [output.float, output.no_layers, render.stop.resume, device.validation]
        };
        assert_eq!(of(""), [false; 4]);
        assert_eq!(of("--float --no-layers --resume --validation"), [true; 4]);
        assert_eq!(
            of("--float --no-layers --resume --validation --no-float --layers --no-resume --no-validation"),
            [false; 4]
        );
        assert_eq!(
            of("--no-float --layers --no-resume --no-validation --float --no-layers --resume --validation"),
            [true; 4]
        );
    }
}
