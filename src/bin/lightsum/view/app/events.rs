//! Events of the window, from the system or from a script.

use std::time::{Duration, Instant};

use glam::Vec2;
use winit::application::ApplicationHandler;
use winit::event::{ElementState, MouseScrollDelta, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::WindowId;

use super::super::keys::{self, MOVES};
use super::super::session::Session;
use super::{App, HIDDEN};

/// Between two looks whether the frame in flight is done.
const GLANCE: Duration = Duration::from_millis(1);
/// Pixels of a trackpad that count as a step of the wheel.
const WHEEL: f64 = 40.0;

impl App<'_> {
    fn key(&mut self, key: KeyCode, pressed: bool) {
        if !pressed {
            self.down.remove(&key);
            return;
        }
        if MOVES.iter().any(|(known, _)| *known == key) {
            self.down.insert(key);
            self.before = Instant::now();
            self.dirty = true;
        } else if let Some(action) = keys::action(key) {
            self.act(action);
        }
    }

    fn over_image(&self, [x, y]: [f64; 2]) -> Vec2 {
        let [left, top, ..] = self.image;
        Vec2::new(x as f32 - left as f32, y as f32 - top as f32)
    }

    /// Takes an event of the window, from the system or from a script.
    pub(in crate::view) fn take(&mut self, events: &ActiveEventLoop, event: &WindowEvent) {
        let Some(stage) = &mut self.stage else { return };
        let response = stage.input.on_window_event(&stage.window, event);
        self.dirty |= response.repaint;
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::DroppedFile(path) => self.load(path.clone()),
            WindowEvent::ModifiersChanged(held) => self.held = held.state(),
            WindowEvent::Focused(false) => self.down.clear(),
            WindowEvent::KeyboardInput { event, .. } => {
                if let PhysicalKey::Code(key) = event.physical_key
                    && (!response.consumed || event.state == ElementState::Released)
                    && !event.repeat
                {
                    self.key(key, event.state == ElementState::Pressed);
                }
            }
            WindowEvent::CursorMoved { position, .. } => {
                let at = self.over_image([position.x, position.y]);
                let Some(session) = &mut self.session else { return };
                let moved = self.pointer.go(at, self.held, session);
                if self.check(moved) == Some(true) {
                    self.camera_moved();
                }
            }
            WindowEvent::MouseInput { state, button, .. } => {
                let Some(session) = &mut self.session else { return };
                match state {
                    ElementState::Pressed if !response.consumed => self.pointer.press(*button, session),
                    ElementState::Pressed => {}
                    ElementState::Released => self.pointer.release(session),
                }
            }
            WindowEvent::MouseWheel { delta, .. } if !response.consumed => {
                let steps = match delta {
                    MouseScrollDelta::LineDelta(_, y) => *y,
                    MouseScrollDelta::PixelDelta(by) => (by.y / WHEEL) as f32,
                };
                let Some(session) = &mut self.session else { return };
                let moved = self.pointer.wheel(steps, session);
                if self.check(moved).is_some() {
                    self.camera_moved();
                }
            }
            _ => {}
        }
    }
}

impl ApplicationHandler for App<'_> {
    fn new_events(&mut self, events: &ActiveEventLoop, cause: StartCause) {
        if cause == StartCause::Init {
            events.set_control_flow(ControlFlow::Wait);
        }
    }

    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.stage.is_none()
            && let Err(error) = self.open_window(events)
        {
            self.failure = Some(error);
            events.exit();
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let of_user = matches!(
            event,
            WindowEvent::CursorMoved { .. }
                | WindowEvent::MouseInput { .. }
                | WindowEvent::MouseWheel { .. }
                | WindowEvent::KeyboardInput { .. }
                | WindowEvent::ModifiersChanged(_)
        );
        // A script is not disturbed.
        if of_user && self.script.is_some() {
            return;
        }
        match event {
            WindowEvent::CloseRequested => self.take(events, &event),
            event if self.asked => self.deferred.push(event),
            event => self.take(events, &event),
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        self.tick(events);
        let coarse = self.session.as_ref().is_some_and(Session::is_coarse);
        let busy = self.flight.is_some() || self.asked || self.loading.is_some() || self.script.is_some() || coarse;
        events.set_control_flow(match self.again {
            _ if self.hidden.is_some_and(|until| until > Instant::now()) => {
                ControlFlow::WaitUntil(Instant::now() + HIDDEN)
            }
            _ if busy => ControlFlow::WaitUntil(Instant::now() + GLANCE),
            _ if self.dirty || self.wants_pass() => ControlFlow::Poll,
            Some(again) => ControlFlow::WaitUntil(again),
            None => ControlFlow::Wait,
        });
    }
}
