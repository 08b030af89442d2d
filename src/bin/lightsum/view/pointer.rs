//! The mouse over the image: it turns and moves the view, chooses objects and moves them.

use glam::{Vec2, Vec3};
use lightsum::Result;
use winit::event::MouseButton;
use winit::keyboard::ModifiersState;

use super::navigate;
use super::route::Placed;
use super::session::Session;

/// Pixels that the mouse may move within a click.
const CLICK: f32 = 4.0;
/// Degrees that a pixel of the mouse turns an object.
const TURN: f32 = 0.5;

/// A button that is down, or not.
#[derive(Clone, Copy, Debug, Default)]
enum Drag {
    #[default]
    None,
    /// Turns the view; a click that chooses an object, if it ends where it began.
    Turn { from: Vec2, click: bool },
    /// Moves the view.
    Pan,
    /// Moves or turns an object, from how it was and where it was taken.
    Object { object: u32, before: Placed, from: Vec2, point: Vec3 },
}

/// The mouse.
#[derive(Default)]
pub struct Pointer {
    /// Where it is, pixels of the image.
    pub at: Vec2,
    drag: Drag,
}

impl Pointer {
    /// A button goes down over the image.
    pub fn press(&mut self, button: MouseButton, session: &Session) {
        self.drag = match button {
            MouseButton::Left => {
                let object = session
                    .pick(self.at)
                    .filter(|(object, _)| session.chosen().is_some_and(|chosen| chosen.object == *object));
                match object {
                    Some((object, point)) => {
                        Drag::Object { object, before: session.placed(object), from: self.at, point }
                    }
                    None => Drag::Turn { from: self.at, click: true },
                }
            }
            MouseButton::Right => Drag::Turn { from: self.at, click: false },
            MouseButton::Middle => Drag::Pan,
            _ => Drag::None,
        };
    }

    /// A button goes up.
    pub fn release(&mut self, session: &mut Session) {
        if let Drag::Turn { from, click: true } = std::mem::take(&mut self.drag)
            && from.distance(self.at) < CLICK
        {
            session.choose(session.pick(self.at).map(|(object, _)| object));
        }
    }

    /// The mouse moves to a point of the image. Returns whether anything in it moved.
    pub fn go(&mut self, to: Vec2, held: ModifiersState, session: &mut Session) -> Result<bool> {
        let by = (to - self.at).to_array();
        self.at = to;
        match self.drag {
            Drag::None => return Ok(false),
            Drag::Turn { from, click } => {
                // Within a click nothing moves.
                if click && from.distance(to) < CLICK {
                    return Ok(false);
                }
                let by = if click { (to - from).to_array() } else { by };
                self.drag = Drag::Turn { from: to, click: false };
                session.set_camera(navigate::turn(session.camera(), session.mode, by))?;
            }
            Drag::Pan => session.set_camera(navigate::pan(session.camera(), by))?,
            Drag::Object { object, before, from, point } => {
                let camera = session.camera();
                let mut placed = before;
                if held.control_key() {
                    placed.pose.degrees += TURN * (to.x - from.x);
                } else {
                    let (_, _, forward) = camera.world_from_camera();
                    let normal = if held.shift_key() { camera.up.normalize() } else { forward };
                    let ray = |at: Vec2| navigate::ray(&camera, at.to_array());
                    // The point that was taken stays under the mouse.
                    let Some(now) = navigate::on_plane(&ray(to), point, normal) else { return Ok(false) };
                    let start = navigate::on_plane(&ray(from), point, normal).unwrap_or(point);
                    placed.pose.translation += now - start;
                }
                session.place(object, placed)?;
            }
        }
        Ok(true)
    }

    /// The wheel turns.
    pub fn wheel(&mut self, steps: f32, session: &mut Session) -> Result<()> {
        session.set_camera(navigate::dolly(session.camera(), session.mode, steps))
    }
}
