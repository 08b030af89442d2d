//! Runs the commands of a script, each after a frame that shows what the one before did.

use std::collections::VecDeque;

use lightsum::Result;
use lightsum::settings::Settings;
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::{DeviceId, ElementState, MouseButton, MouseScrollDelta, TouchPhase, WindowEvent};
use winit::event_loop::ActiveEventLoop;
use winit::keyboard::ModifiersState;

use super::app::App;
use super::keys;
use super::script::{Command, Script};

/// Places that the mouse passes in a drag.
const PLACES: u32 = 3;

impl App<'_> {
    /// Runs the next command if what the last one waits for is there.
    pub(super) fn run_script(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let Some(Script(commands)) = &mut self.script else { return Ok(()) };
        let Some(command) = commands.pop_front() else { return Ok(()) };
        if let Some(rest) = self.run(events, command) {
            // Not done, or a part of it is left.
            let Some(Script(commands)) = &mut self.script else { return Ok(()) };
            rest.into_iter().rev().for_each(|command| commands.push_front(command));
        }
        self.wait_for_frame();
        Ok(())
    }

    /// Runs a command; returns what is left of it.
    fn run(&mut self, events: &ActiveEventLoop, command: Command) -> Option<VecDeque<Command>> {
        match command {
            Command::Window(size) => {
                let window = &self.stage.as_ref()?.window;
                if [window.inner_size().width, window.inner_size().height] != size {
                    let _ = window.request_inner_size(PhysicalSize::new(size[0], size[1]));
                    return Some(VecDeque::from([Command::Window(size)]));
                }
            }
            Command::Panel(open) => self.panel.open = open,
            Command::Key(key) => {
                if let Some(action) = keys::action(key) {
                    self.act(action);
                }
            }
            Command::Drag { button, from, to, shift, ctrl } => return Some(steps(button, from, to, shift, ctrl)),
            Command::Hold { shift, ctrl } => {
                self.held = ModifiersState::empty();
                self.held.set(ModifiersState::SHIFT, shift);
                self.held.set(ModifiersState::CONTROL, ctrl);
            }
            Command::Move([x, y]) => {
                let position = PhysicalPosition::new(x, y);
                self.take(events, &WindowEvent::CursorMoved { device_id: DeviceId::dummy(), position });
            }
            Command::Button(button, pressed) => {
                let state = if pressed { ElementState::Pressed } else { ElementState::Released };
                self.take(events, &WindowEvent::MouseInput { device_id: DeviceId::dummy(), state, button });
            }
            Command::Wheel(steps) => {
                let (delta, phase) = (MouseScrollDelta::LineDelta(0.0, steps), TouchPhase::Moved);
                self.take(events, &WindowEvent::MouseWheel { device_id: DeviceId::dummy(), delta, phase });
            }
            // Commands that act on the scene wait until it is loaded.
            command @ (Command::Set(_) | Command::Look(_)) if self.loading.is_some() => {
                return Some(VecDeque::from([command]));
            }
            Command::Set(flags) => {
                let session = self.session.as_mut()?;
                let mut keys = session.scene().map(|scene| scene.render.clone()).unwrap_or_default();
                keys.override_by(&flags.keys.flags);
                let now = session.settings();
                let wanted = Settings::default().with_scene_defaults(&keys);
                let wanted = Settings { traversal: now.traversal, summands: now.summands, ..wanted };
                let result = session.set_settings(wanted);
                if self.check(result).is_some() {
                    self.touched();
                }
            }
            Command::Lights(shown) => self.look.lights = shown,
            Command::Kernels(shown) => self.look.kernels = shown,
            Command::Look(layer) => {
                self.look.layer = layer;
                let session = self.session.as_mut()?;
                if layer.is_some_and(|layer| layer.is_summand()) {
                    let result = session.set_settings(Settings { summands: true, ..session.settings().clone() });
                    self.check(result);
                }
            }
            Command::Drop(path) => {
                self.take(events, &WindowEvent::DroppedFile(path));
                return Some(VecDeque::from([Command::Loaded]));
            }
            Command::Loaded => {
                if self.loading.is_some() {
                    return Some(VecDeque::from([Command::Loaded]));
                }
            }
            Command::Passes(count) => {
                self.limit = count;
                if self.loading.is_some() {
                    return Some(VecDeque::from([Command::Passes(count)]));
                }
                let session = self.session.as_mut()?;
                let passes = session.engine().passes_unchanged();
                if passes > count {
                    session.restart();
                }
                if passes != count || session.is_coarse() {
                    return Some(VecDeque::from([Command::Passes(count)]));
                }
            }
            Command::Screenshot(path) => self.screenshot(Some(&path), ""),
            Command::Path(path) => self.save_path(Some(&path)),
            Command::Quit => events.exit(),
        }
        None
    }
}

/// The parts of a drag.
fn steps(button: MouseButton, from: [f64; 2], to: [f64; 2], shift: bool, ctrl: bool) -> VecDeque<Command> {
    let at = |i: u32| {
        let share = f64::from(i) / f64::from(PLACES);
        Command::Move([0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis])))
    };
    let mut steps = VecDeque::from([Command::Hold { shift, ctrl }, at(0), Command::Button(button, true)]);
    steps.extend((1..=PLACES).map(at));
    steps.extend([Command::Button(button, false), Command::Hold { shift: false, ctrl: false }]);
    steps
}
