//! The keys and what they do.

use winit::keyboard::KeyCode;

/// Something that a key does once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Shows or hides the help.
    Help,
    /// Shows or hides the panel.
    Panel,
    /// Orbit or flight.
    Mode,
    /// Renders fewer pixels while the camera moves, or all.
    Coarser,
    /// Back to the camera of the scene.
    Home,
    /// Starts the image over.
    Restart,
    /// Stops and goes on with passes.
    Pause,
    /// Records a key of the path.
    Record,
    /// Writes the recorded path.
    SavePath,
    /// Writes the image as PNG.
    Png,
    /// Writes the image as EXR.
    Exr,
    /// No object is chosen any more.
    Deselect,
    /// Whole screen or window.
    FullScreen,
}

/// Keys that do something once, their names, and help.
pub const ACTIONS: [(KeyCode, &str, Action, &str); 13] = [
    (KeyCode::KeyH, "H", Action::Help, "this help"),
    (KeyCode::KeyP, "P", Action::Panel, "the panel"),
    (KeyCode::KeyO, "O", Action::Mode, "orbit or fly"),
    (KeyCode::KeyM, "M", Action::Coarser, "coarser while the camera moves: 1, 2, 3, 4"),
    (KeyCode::Home, "Home", Action::Home, "back to the scene's camera"),
    (KeyCode::KeyR, "R", Action::Restart, "start the image over"),
    (KeyCode::Space, "Space", Action::Pause, "stop, go on"),
    (KeyCode::KeyK, "K", Action::Record, "record a key of camera and moved objects"),
    (KeyCode::KeyL, "L", Action::SavePath, "save the keys as a path for animate"),
    (KeyCode::F12, "F12", Action::Png, "save the image as PNG"),
    (KeyCode::F11, "F11", Action::Exr, "save the image as EXR"),
    (KeyCode::Escape, "Esc", Action::Deselect, "choose no object"),
    (KeyCode::KeyF, "F", Action::FullScreen, "whole screen or window"),
];

/// Keys that move the camera while they are down: to the right, up, forward.
pub const MOVES: [(KeyCode, [f32; 3]); 6] = [
    (KeyCode::KeyD, [1.0, 0.0, 0.0]),
    (KeyCode::KeyA, [-1.0, 0.0, 0.0]),
    (KeyCode::KeyE, [0.0, 1.0, 0.0]),
    (KeyCode::KeyQ, [0.0, -1.0, 0.0]),
    (KeyCode::KeyW, [0.0, 0.0, 1.0]),
    (KeyCode::KeyS, [0.0, 0.0, -1.0]),
];

/// Mouse and held keys, and what they do.
pub const MOUSE: [(&str, &str); 8] = [
    ("W A S D", "forward, left, back, right; Shift: four times as fast"),
    ("Q E", "down, up"),
    ("left drag", "turn the view; a click chooses an object"),
    ("left drag on the chosen object", "move it across the view; Shift: level; Ctrl: turn it"),
    ("right drag", "turn the view"),
    ("middle drag", "move the view"),
    ("wheel", "nearer, farther"),
    ("drop a file", "open it"),
];

/// The action of a key.
pub fn action(key: KeyCode) -> Option<Action> {
    ACTIONS.iter().find(|(code, ..)| *code == key).map(|(.., action, _)| *action)
}

/// A key by its name in the help.
pub fn by_name(name: &str) -> Option<KeyCode> {
    ACTIONS.iter().find(|(_, known, ..)| known.eq_ignore_ascii_case(name)).map(|(code, ..)| *code)
}
