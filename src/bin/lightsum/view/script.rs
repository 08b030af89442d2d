//! A file of commands in place of mouse and keys, for tests and pictures: one command a line, `#` before remarks.
//!
//! ```text
//! window 96x72                    the window's size; waits until it has it
//! panel on|off                    shows or hides the panel
//! key NAME                        a key of the help, such as H or Home
//! drag left 10,10 60,20 [shift]   a drag of a button between two points of the window, in pixels, with shift or ctrl if wanted
//! click 10,10                     a click of the left button
//! wheel -3                        steps of the wheel
//! set --particles 8 ...           the settings that these flags of `view` make
//! look normal|image               a layer, or the image
//! lights on|off                   the virtual lights over it
//! kernels on|off                  the kernels of mirror images over it
//! drop FILE                       a file dropped on the window; waits until it is loaded or refused
//! passes 4                        waits until the image has so many passes, and renders no more
//! screenshot FILE                 writes the image
//! path FILE                       writes the recorded path
//! quit                            closes the window
//! ```
//!
//! Names of files are relative to the folder of the program. Without `quit` the window stays open after the last command.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use clap::Parser;
use lightsum::pass::layer::Layer;
use lightsum::{Error, Result};
use winit::event::MouseButton;
use winit::keyboard::KeyCode;

use super::keys;
use crate::args;

/// A command.
#[derive(Debug)]
pub enum Command {
    Window([u32; 2]),
    Panel(bool),
    Key(KeyCode),
    Drag {
        button: MouseButton,
        from: [f64; 2],
        to: [f64; 2],
        shift: bool,
        ctrl: bool,
    },
    /// Parts of a drag: the keys that are held, the mouse, a button that goes down or up.
    Hold {
        shift: bool,
        ctrl: bool,
    },
    Move([f64; 2]),
    Button(MouseButton, bool),
    Wheel(f32),
    Set(Box<Flags>),
    Look(Option<Layer>),
    Lights(bool),
    Kernels(bool),
    Drop(PathBuf),
    /// Waits for a scene.
    Loaded,
    Passes(u32),
    Screenshot(PathBuf),
    Path(PathBuf),
    Quit,
}

/// Flags of `set`.
#[derive(Debug, Parser)]
#[command(name = "view", no_binary_name = true)]
pub struct Flags {
    #[command(flatten)]
    pub keys: args::Keys,
}

/// The commands that are still to be run.
pub struct Script(pub VecDeque<Command>);

impl Script {
    /// Reads a file. Errors name the line.
    pub fn load(path: &Path) -> Result<Script> {
        let text = lightsum::input::read_text(path)?;
        let lines =
            text.lines().enumerate().map(|(i, line)| (i + 1, line.split('#').next().unwrap_or_default().trim()));
        let commands = lines
            .filter(|(_, line)| !line.is_empty())
            .map(|(number, line)| command(line).map_err(|message| Error::at(path, number, message)));
        Ok(Script(commands.collect::<Result<_>>()?))
    }
}

fn command(line: &str) -> Result<Command, String> {
    let (name, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    let words: Vec<&str> = rest.split_whitespace().collect();
    let file =
        || if rest.trim().is_empty() { Err(format!("{name}: no file is named")) } else { Ok(rest.trim().into()) };
    match (name, words.as_slice()) {
        ("window", [size]) => {
            args::extent(size).map(Command::Window).ok_or_else(|| String::from("expected WIDTHxHEIGHT in pixels"))
        }
        ("panel", ["on"]) => Ok(Command::Panel(true)),
        ("panel", ["off"]) => Ok(Command::Panel(false)),
        ("key", [key]) => keys::by_name(key).map(Command::Key).ok_or_else(|| format!("no key of the help is {key}")),
        ("drag", [button, from, to, held @ ..]) => {
            let button = match *button {
                "left" => MouseButton::Left,
                "middle" => MouseButton::Middle,
                "right" => MouseButton::Right,
                other => return Err(format!("{other} is neither left, middle nor right")),
            };
            if let Some(other) = held.iter().find(|key| !["shift", "ctrl"].contains(key)) {
                return Err(format!("{other} is neither shift nor ctrl"));
            }
            let (shift, ctrl) = (held.contains(&"shift"), held.contains(&"ctrl"));
            Ok(Command::Drag { button, from: point(from)?, to: point(to)?, shift, ctrl })
        }
        ("click", [at]) => {
            let at = point(at)?;
            Ok(Command::Drag { button: MouseButton::Left, from: at, to: at, shift: false, ctrl: false })
        }
        ("wheel", [steps]) => steps.parse().map(Command::Wheel).map_err(|_| format!("{steps} is no number of steps")),
        ("set", flags) => {
            Flags::try_parse_from(flags).map(|flags| Command::Set(Box::new(flags))).map_err(|error| error.to_string())
        }
        ("lights", ["on"]) => Ok(Command::Lights(true)),
        ("lights", ["off"]) => Ok(Command::Lights(false)),
        ("kernels", ["on"]) => Ok(Command::Kernels(true)),
        ("kernels", ["off"]) => Ok(Command::Kernels(false)),
        ("look", ["image"]) => Ok(Command::Look(None)),
        ("look", [layer]) => {
            let named = |known: &Layer| format!("{known:?}").eq_ignore_ascii_case(layer);
            let found = Layer::ALL.into_iter().find(named);
            found.map(|layer| Command::Look(Some(layer))).ok_or_else(|| format!("there is no layer {layer}"))
        }
        ("drop", _) => file().map(Command::Drop),
        ("passes", [count]) => {
            count.parse().map(Command::Passes).map_err(|_| format!("{count} is no number of passes"))
        }
        ("screenshot", _) => file().map(Command::Screenshot),
        ("path", _) => file().map(Command::Path),
        ("quit", []) => Ok(Command::Quit),
        _ => Err(format!("{line:?} is no command of a script")),
    }
}

fn point(text: &str) -> Result<[f64; 2], String> {
    let numbers = text.split_once(',').and_then(|(x, y)| Some([x.parse().ok()?, y.parse().ok()?]));
    numbers.ok_or_else(|| format!("expected X,Y in pixels in place of {text}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_understood() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let text = "window 96x72 # small\n\npanel off\nkey h\ndrag left 1,2 3.5,4 shift\nwheel -2\n\
                    set --particles 8 --interleave 2x2\nlook normal\ndrop a scene.toml\npasses 4\nscreenshot a.exr\nquit\n";
        std::fs::write(&path, text).unwrap();
        let Script(commands) = Script::load(&path).unwrap();
        assert_eq!(commands.len(), 11);
        assert!(matches!(commands[0], Command::Window([96, 72])));
        assert!(matches!(commands[3], Command::Drag { to: [3.5, 4.0], shift: true, ctrl: false, .. }));
        assert!(matches!(&commands[5], Command::Set(flags) if flags.keys.flags.particles == Some(8)));
        assert!(matches!(&commands[7], Command::Drop(path) if path == Path::new("a scene.toml")));
        for (text, wrong) in
            [("passes\n", "passes"), ("\nkey Y", ":2"), ("drag up 1,1 2,2", "up"), ("set --no", "--no")]
        {
            std::fs::write(&path, text).unwrap();
            let message = Script::load(&path).err().unwrap().to_string();
            assert!(message.contains(wrong), "{message}");
        }
    }
}
