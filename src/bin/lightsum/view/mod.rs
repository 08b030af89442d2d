//! `lightsum view`: a window on a scene.
//!
//! The window's program is a host of the engine like any other: it makes the device ([`lightsum::gpu::surface`]), lends it, and has the
//! engine record its passes into the command buffer of each frame, in which the panel is drawn too. Under `mpirun` other processes shade the
//! points of these passes ([`Others`]).

mod app;
mod clock;
mod keys;
mod navigate;
mod objects;
mod options;
mod others;
mod overlay;
mod painter;
mod panel;
mod play;
mod pointer;
mod route;
mod script;
mod session;
mod stage;

use lightsum::{Error, Result};
use winit::event_loop::EventLoop;

use crate::args::View;
use crate::say;
use app::App;
pub use others::Others;
use script::Script;
#[cfg(feature = "mpi")]
pub use session::prepare;

/// Runs the command. `others`: those that shade points for it.
pub fn run(args: &View, others: Option<Box<dyn Others + '_>>) -> Result<()> {
    let script = args.script.as_deref().map(Script::load).transpose()?;
    let scripted = script.is_some();
    let no_window = |error: &dyn std::fmt::Display| {
        let error = error.to_string();
        Error::NoDevice(format!(
            "no window can be opened: {}; set DISPLAY or WAYLAND_DISPLAY (over ssh: ssh -X), or use `lightsum render`, which needs \
             no display",
            words(&error)
        ))
    };
    let events = event_loop().map_err(|error| no_window(&error))?;
    let mut app = App::new(args, script, others);
    events.run_app(&mut app).map_err(|error| no_window(&error))?;
    let (summary, outcome) = app.end();
    if scripted {
        say(&summary.to_string());
    }
    outcome
}

/// The words of an error without the place in winit's sources that they begin with, and without a full stop.
fn words(error: &str) -> &str {
    let place = error.split_once(".rs:").and_then(|(_, rest)| rest.split_once(": "));
    place.map_or(error, |(_, words)| words).trim_end_matches('.')
}

/// The connection to the display. winit panics where a library that it loads is missing; that is an error here like any other.
fn event_loop() -> Result<EventLoop<()>, String> {
    let told = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let made = std::panic::catch_unwind(EventLoop::new);
    std::panic::set_hook(told);
    match made {
        Ok(made) => made.map_err(|error| error.to_string()),
        Err(panic) => {
            Err(panic.downcast_ref::<String>().cloned().unwrap_or_else(|| String::from("a library is missing")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::words;

    #[test]
    fn errors_are_told_without_places_in_sources() {
        assert_eq!(
            words("os error at /a/winit/src/platform_impl/linux/mod.rs:765: no DISPLAY is set."),
            "no DISPLAY is set"
        );
        assert_eq!(words("libX.so could not be loaded"), "libX.so could not be loaded");
    }
}
