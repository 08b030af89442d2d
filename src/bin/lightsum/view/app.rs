//! The window's events and frames.
//!
//! One frame is in flight at a time. When it is done, what it measured is read, and the next one is recorded with all input so far: a pass of
//! the engine if the image wants one, the image for the display, and the panel.

mod events;
mod loading;
mod shared;

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::Vec3;
use lightsum::gpu::surface::{Outcome, Shown};
use lightsum::settings::{Exposure, Settings};
use lightsum::{Error, Result};
use serde_json::{Value, json};
use winit::dpi::{LogicalSize, PhysicalSize};
use winit::event::WindowEvent;
use winit::event_loop::ActiveEventLoop;
use winit::keyboard::{KeyCode, ModifiersState};
use winit::window::{Fullscreen, Window};

use loading::Loading;

use super::clock::Clock;
use super::keys::{Action, MOVES};
use super::navigate::{self, Mode};
use super::others::Others;
use super::panel::{Notice, Panel, Request, WIDTH};
use super::pointer::Pointer;
use super::script::Script;
use super::session::{Look, Pass, SIZE, Session};
use super::stage::Stage;
use crate::args::View;
use crate::say_aside;

/// Between two tries to show a frame in a window that is minimised or hidden.
const HIDDEN: Duration = Duration::from_millis(50);
/// Most seconds that a held key moves the camera for in one frame.
const LONGEST: f32 = 0.25;
/// After the last motion of the camera the image stays coarse for this long.
const SETTLE: Duration = Duration::from_millis(200);
/// Maximum factor that the key for coarser images sets.
const COARSER_KEY: u32 = 4;
/// Part of the size of what is seen that held keys fly in a second.
const SPEED: f32 = 0.3;

/// The program.
pub struct App<'a> {
    pub(super) args: Arc<View>,
    pub(super) stage: Option<Stage>,
    pub(super) session: Option<Session>,
    pub(super) loading: Option<Loading>,
    pub(super) look: Look,
    pub(super) panel: Panel,
    pub(super) clock: Clock,
    /// Passes after which the image stays as it is.
    pub(super) limit: u32,
    /// The commands of a script.
    pub(super) script: Option<Script>,
    /// A frame has shown what the latest command of the script did.
    settled: bool,
    pub(super) held: ModifiersState,
    pointer: Pointer,
    down: HashSet<KeyCode>,
    /// The frame in flight, if any: whether it has a pass, and whether that is the first of its image.
    flight: Option<(bool, bool)>,
    /// Something has changed that no frame shows.
    dirty: bool,
    /// When the panel wants to be drawn again.
    again: Option<Instant>,
    /// The window gives no image until then.
    hidden: Option<Instant>,
    before: Instant,
    /// When the camera last moved.
    moved: Option<Instant>,
    /// The image in the window: upper left corner, width and height, pixels.
    image: [u32; 4],
    /// A size of the image that the device has no room for.
    refused: Option<[u32; 2]>,
    frames: u64,
    /// Of these, frames with a pass of fewer pixels.
    coarse_frames: u64,
    /// Most kernels that were drawn.
    kernels: usize,
    failure: Option<Error>,
    /// Those that shade points of passes.
    others: Option<Box<dyn Others + 'a>>,
    /// They have been asked for the next pass. The view must not change until it is recorded.
    asked: bool,
    /// Events that came meanwhile.
    deferred: Vec<WindowEvent>,
    /// Frames with a pass of theirs.
    shared_frames: u64,
    /// The latest reason why they were not asked.
    alone: Option<String>,
}

impl<'a> App<'a> {
    pub fn new(args: &View, script: Option<Script>, others: Option<Box<dyn Others + 'a>>) -> App<'a> {
        App {
            args: Arc::new(args.clone()),
            stage: None,
            session: None,
            loading: None,
            look: Look {
                stops: 0.0,
                auto: false,
                tonemap: args.shown.tonemap.into(),
                layer: None,
                lights: false,
                kernels: false,
            },
            panel: Panel::new(args.coarser, args.shown.keys.typed().shading_rate),
            clock: Clock::default(),
            // A script says how many passes it waits for.
            limit: if script.is_some() { 1 } else { args.passes },
            script,
            settled: false,
            held: ModifiersState::empty(),
            pointer: Pointer::default(),
            down: HashSet::new(),
            flight: None,
            dirty: true,
            again: None,
            hidden: None,
            before: Instant::now(),
            moved: None,
            image: [0; 4],
            refused: None,
            frames: 0,
            coarse_frames: 0,
            kernels: 0,
            failure: None,
            others,
            asked: false,
            deferred: Vec::new(),
            shared_frames: 0,
            alone: None,
        }
    }

    /// Ends everything; returns what was measured, as JSON.
    pub fn end(self) -> (Value, Result<()>) {
        let App {
            stage, session, loading, clock, frames, coarse_frames, shared_frames, kernels, failure, others, ..
        } = self;
        if let Some(stage) = &stage {
            stage.window.set_visible(false);
        }
        // A scene that is still being loaded keeps the device until it is there.
        drop(loading.map(|loading| loading.done.recv()));
        drop((session, others));
        let watch = stage.as_ref().map(|stage| stage.device.take_messages()).unwrap_or_default();
        let (bytes, messages) = stage.map(Stage::end).unwrap_or_default();
        let messages = [watch, messages.take()].concat();
        let summary = json!({
            "frames": frames,
            "coarse_frames": coarse_frames,
            "shared_frames": shared_frames,
            "kernels": kernels,
            "moving_frame_ms": clock.moving.json(),
            "input_to_image_ms": clock.latency.json(),
            "validation_messages": messages.len(),
            "bytes_not_given_back": bytes,
        });
        let outcome = match (failure, messages.first()) {
            (Some(error), _) => Err(error),
            (None, Some(message)) => {
                Err(Error::Resource { name: "the window".into(), message: format!("validation: {message}") })
            }
            (None, None) if bytes > 0 => Err(Error::Resource {
                name: "the window".into(),
                message: format!("{bytes} bytes of the device were not given back"),
            }),
            (None, None) => Ok(()),
        };
        (summary, outcome)
    }

    /// Shows a message in the window and on standard error.
    pub(super) fn tell(&mut self, is_error: bool, text: String) {
        // The frame that shows a message may fail in the same way; a second message would cause a third.
        if is_error && self.panel.notice.as_ref().is_some_and(|notice| notice.text == text) {
            return;
        }
        say_aside(&if is_error { format!("error: {text}") } else { text.clone() });
        self.panel.notice = Some(Notice { text, is_error });
        self.dirty = true;
    }

    /// Shows an error, unless the program cannot go on.
    pub(super) fn check<T>(&mut self, result: Result<T>) -> Option<T> {
        match result {
            Ok(value) => return Some(value),
            Err(error @ Error::DeviceLost { .. }) => self.failure = Some(error),
            Err(error) => self.tell(true, error.to_string()),
        }
        None
    }

    /// Something changes the image.
    pub(super) fn touched(&mut self) {
        self.clock.input();
        self.panel.paused = false;
        self.dirty = true;
    }

    /// Something moves the camera.
    pub(super) fn camera_moved(&mut self) {
        self.moved = Some(Instant::now());
        self.touched();
    }

    /// Whether the next image may be coarse, since the camera moves. A ring would lose its images.
    fn is_in_motion(&self) -> bool {
        let moves = self.moved.is_some_and(|at| at.elapsed() < SETTLE);
        moves && self.session.as_ref().is_some_and(|session| session.settings().ring.is_none())
    }

    /// Shading rate of the next image; `None`: that of the still one. Ranks shade pixels one by one.
    fn moving_rate(&self) -> Option<u32> {
        self.panel.moving_rate.filter(|_| self.others.is_none() && self.is_in_motion())
    }

    /// Whether a coarse image is to be replaced, since the camera stands still.
    fn refines(&self) -> bool {
        self.session.as_ref().is_some_and(Session::is_coarse) && !self.is_in_motion()
    }

    /// The next command of a script waits for a frame.
    pub(super) fn wait_for_frame(&mut self) {
        (self.settled, self.dirty) = (false, true);
    }

    fn open_window(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let [width, height] = self.args.shown.resolution.unwrap_or(SIZE);
        let attributes = Window::default_attributes().with_title("lightsum").with_visible(false);
        let failed = |error| Error::NoDevice(format!("no window can be opened: {error}"));
        let window = events.create_window(attributes).map_err(failed)?;
        let panel = (f64::from(WIDTH) * window.scale_factor()).round() as u32;
        let _ = window.request_inner_size(PhysicalSize::new(width + panel, height));
        window.set_min_inner_size(Some(LogicalSize::new(16, 16)));
        window.set_visible(true);
        let stage = Stage::new(window, &self.args)?;
        let info = stage.device.info();
        // Passes of graphics cards take milliseconds.
        self.panel.moving_rate = self.panel.moving_rate.or((!info.is_wide()).then_some(Settings::MAX_SHADING_RATE));
        self.panel.device = format!("{} ({} {})", info.name, info.driver, info.driver_version);
        self.stage = Some(stage);
        if let Some(scene) = self.args.scene.clone() {
            self.load(scene);
        }
        Ok(())
    }

    /// Goes on: with the frame in flight, the script, and the next frame.
    fn tick(&mut self, events: &ActiveEventLoop) {
        let done = self.tick_frame(events);
        if self.check(done).is_none() && self.failure.is_none() {
            // Frames that fail one after the other would fill the window with messages.
            self.panel.paused = true;
        }
        if self.failure.is_some() {
            events.exit();
        }
    }

    fn tick_frame(&mut self, events: &ActiveEventLoop) -> Result<()> {
        if !self.asked {
            let deferred = std::mem::take(&mut self.deferred);
            deferred.iter().for_each(|event| self.take(events, event));
        }
        // A script goes step by step; else others begin the next pass while this one is filtered.
        if self.script.is_none() {
            self.ask()?;
        }
        let shaded = self.are_shaded();
        let Some(stage) = &mut self.stage else { return Ok(()) };
        if !stage.presenter.is_idle()? {
            return Ok(());
        }
        if let Some((pass, first)) = self.flight.take() {
            self.frame_done(pass, first)?;
        }
        self.loaded();
        if self.hidden.is_some_and(|until| until > Instant::now()) {
            return Ok(());
        }
        if self.asked {
            return if shaded { self.frame() } else { Ok(()) };
        }
        if self.settled && !self.is_unfit() {
            self.run_script(events)?;
        }
        if self.script.is_some() {
            self.ask()?;
        }
        if self.asked {
            return Ok(());
        }
        let panel_wants = self.again.is_some_and(|at| at <= Instant::now());
        let flies = MOVES.iter().any(|(key, _)| self.down.contains(key));
        if self.dirty || panel_wants || flies || self.wants_pass() || self.refines() || self.is_unfit() {
            self.frame()?;
        }
        Ok(())
    }

    /// Gives the image the size at which it is shown. Returns an error that has not been told.
    fn fit(&mut self) -> Option<Error> {
        let (size, rate) = ([self.image[2], self.image[3]], self.moving_rate());
        let coarser = if self.is_in_motion() { self.panel.coarser } else { 1 };
        let session = self.session.as_mut().filter(|_| size[0] > 0 && size[1] > 0 && self.refused != Some(size))?;
        match session.light_at(rate).and_then(|()| session.resize(size, coarser)) {
            Ok(true) => self.clock.input(),
            Ok(false) => {}
            Err(error) => {
                // An image of the size before is shown enlarged.
                self.refused = Some(size);
                return Some(error);
            }
        }
        None
    }

    fn wants_pass(&self) -> bool {
        !self.panel.paused && self.session.as_ref().is_some_and(|session| session.wants_pass(self.limit))
    }

    /// After the end of a frame.
    fn frame_done(&mut self, pass: bool, first: bool) -> Result<()> {
        self.frames += 1;
        self.settled = true;
        let (Some(stage), Some(session)) = (&self.stage, &mut self.session) else { return Ok(()) };
        let drawn = |session: &Session| [session.lights().is_empty(), session.kernels().is_empty()];
        let before = drawn(session);
        let done = session.finished()?;
        // Lights or kernels that are new to the panel.
        self.dirty |= before != drawn(session);
        self.kernels = self.kernels.max(session.kernels().len());
        self.coarse_frames += u64::from(pass && session.is_coarse());
        if pass && done {
            self.clock.end(first, &stage.timers.read()?);
        }
        if self.look.auto && session.engine().passes() > 0 {
            self.look.auto = false;
            self.look.stops = session.stops(Exposure::Auto)?;
            self.dirty = true;
        }
        Ok(())
    }

    /// Moves the camera by the keys that are down.
    fn fly(&mut self) -> Result<()> {
        let now = Instant::now();
        let seconds = (now - std::mem::replace(&mut self.before, now)).as_secs_f32().min(LONGEST);
        let held = MOVES.iter().filter(|(key, _)| self.down.contains(key));
        let direction: Vec3 = held.map(|(_, by)| Vec3::from_array(*by)).sum();
        let Some(session) = self.session.as_mut().filter(|_| direction != Vec3::ZERO) else { return Ok(()) };
        let size = session.engine().plan().scene.extent.size;
        let speed = SPEED * size * if self.held.shift_key() { 4.0 } else { 1.0 };
        session.set_camera(navigate::fly(session.camera(), direction * speed * seconds))?;
        self.camera_moved();
        Ok(())
    }

    /// Whether the image is not of the size at which it is shown, and can be.
    fn is_unfit(&self) -> bool {
        let size = [self.image[2], self.image[3]];
        let fits = self.session.as_ref().is_none_or(|session| session.camera().resolution == size);
        !fits && size[0] > 0 && size[1] > 0 && self.refused != Some(size)
    }

    /// Draws the panel and records a frame. Of points that others have shaded the view stays as it is.
    fn frame(&mut self) -> Result<()> {
        let shared = self.asked;
        if !shared {
            self.fly()?;
        }
        let Some(stage) = &mut self.stage else { return Ok(()) };
        let (input, window) = (stage.input.take_egui_input(&stage.window), stage.window.inner_size());
        let context = stage.input.egui_ctx().clone();
        let loading = self.loading.as_ref().map(|loading| loading.path.display().to_string());
        let (mut requests, mut place) = (Vec::new(), egui::Rect::ZERO);
        let before = self.look;
        let (panel, look, clock, session) = (&mut self.panel, &mut self.look, &self.clock, self.session.as_ref());
        let drawn = context.run_ui(input, |ui| {
            let (asked, image) = panel.show(ui, session, look, clock, loading.as_deref());
            requests.extend(asked);
            place = image;
        });
        if before.layer != self.look.layer {
            self.panel.notice = None;
        }
        stage.input.handle_platform_output(&stage.window, drawn.platform_output);
        stage.painter.update(drawn.textures_delta)?;
        let scale = drawn.pixels_per_point;
        let shapes = context.tessellate(drawn.shapes, scale);
        let delay = drawn.viewport_output.values().map(|output| output.repaint_delay).min();
        self.again = delay.filter(|delay| *delay < Duration::from_secs(3600)).map(|delay| Instant::now() + delay);
        self.dirty = false;
        self.image = in_pixels(place, scale, window);
        if !shared {
            std::mem::take(&mut requests).into_iter().for_each(|request| self.fulfil(request));
        }
        let refusal = if shared { None } else { self.fit() };

        let own = !shared && self.wants_pass() && (self.others.is_none() || self.alone.is_some());
        let (Some(stage), look) = (&mut self.stage, self.look) else { return Ok(()) };
        stage.presenter.resize([window.width, window.height]);
        let [x, y, width, height] = self.image;
        let mut session = self.session.as_mut().filter(|_| width > 0 && height > 0);
        let first = session.as_ref().is_some_and(|session| session.engine().passes_unchanged() == 0);
        let points = match &mut self.others {
            Some(others) if shared => others.points()?,
            _ => None,
        };
        let mut pass = match points {
            Some(points) => Pass::Of(points),
            None if own => Pass::Own,
            None => Pass::None,
        };
        let has_pass = session.is_some() && !matches!(pass, Pass::None);
        let painter = &mut stage.painter;
        let outcome = stage.presenter.show(
            Some(&stage.timers),
            |rec| {
                let Some(session) = session.as_mut() else { return Ok(None) };
                let image = session.record(rec, &look, std::mem::replace(&mut pass, Pass::None))?;
                Ok(Some(Shown { image, at: [x, y], size: [width, height] }))
            },
            |canvas| painter.draw(canvas, scale, &shapes),
        )?;
        match outcome {
            Outcome::Submitted => {
                session.into_iter().for_each(Session::submitted);
                if has_pass {
                    self.clock.begin();
                }
                self.flight = Some((has_pass, first));
                if shared {
                    self.pass_recorded(has_pass);
                }
            }
            Outcome::Failed(error) => {
                self.flight = Some((false, false));
                self.asked = false;
                return Err(error);
            }
            Outcome::Skipped => self.hidden = Some(Instant::now() + HIDDEN),
        }
        // The view may change again.
        requests.into_iter().for_each(|request| self.fulfil(request));
        refusal.map_or(Ok(()), Err)
    }

    /// Does what the panel was asked for.
    fn fulfil(&mut self, request: Request) {
        if let Request::Do(action) = request {
            return self.act(action);
        }
        let Some(session) = &mut self.session else { return };
        let result = match request {
            Request::Do(_) => Ok(()),
            Request::Settings(settings) => session.set_settings(*settings),
            Request::Camera(camera) => {
                self.moved = Some(Instant::now());
                session.set_camera(camera)
            }
            Request::Place(object, placed) => session.place(object, placed),
            Request::Material(index, material) => session.set_material(index, *material),
            Request::Light(index, light) => session.set_light(index, light),
            Request::RemoveKey => {
                session.route.remove_last();
                Ok(())
            }
        };
        if self.check(result).is_some() {
            self.touched();
        }
    }

    /// Does what a key does.
    pub(super) fn act(&mut self, action: Action) {
        self.dirty = true;
        match action {
            Action::Help => self.panel.help = !self.panel.help,
            Action::Panel => self.panel.open = !self.panel.open,
            Action::FullScreen => {
                if let Some(stage) = &self.stage {
                    let whole = stage.window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
                    stage.window.set_fullscreen(whole);
                }
            }
            Action::Pause => self.panel.paused = !self.panel.paused,
            Action::Coarser => self.panel.coarser = self.panel.coarser % COARSER_KEY + 1,
            Action::Png => self.screenshot(None, "png"),
            Action::Exr => self.screenshot(None, "exr"),
            Action::SavePath => self.save_path(None),
            action => {
                let Some(session) = &mut self.session else { return };
                match action {
                    Action::Mode => {
                        session.mode = if session.mode == Mode::Orbit { Mode::Fly } else { Mode::Orbit };
                    }
                    Action::Home => {
                        let resolution = session.camera().resolution;
                        let home = session.home;
                        let result = session.set_camera(lightsum::Camera { resolution, ..home });
                        self.check(result);
                        self.touched();
                    }
                    Action::Restart => {
                        session.restart();
                        self.touched();
                    }
                    Action::Record => {
                        session.add_key();
                        let count = session.route.len();
                        self.tell(false, format!("key {count} of the path is recorded"));
                    }
                    _ => session.choose(None),
                }
            }
        }
    }

    /// Writes the image; without a name under one that is not taken.
    pub(super) fn screenshot(&mut self, path: Option<&Path>, extension: &str) {
        self.save(path, extension, |session, look, path| session.write(path, look));
    }

    /// Writes the recorded path.
    pub(super) fn save_path(&mut self, path: Option<&Path>) {
        self.save(path, "toml", |session, _, path| session.save_route(path));
    }

    fn save(&mut self, path: Option<&Path>, extension: &str, write: impl FnOnce(&Session, &Look, &Path) -> Result<()>) {
        let (Some(stage), Some(session)) = (&mut self.stage, &self.session) else { return };
        let path = path.map_or_else(|| free_name(&session.name, extension), Path::to_path_buf);
        let look = self.look;
        let written = stage.presenter.wait().and_then(|()| write(session, &look, &path));
        if self.check(written).is_some() {
            self.tell(false, format!("saved {}", path.display()));
        }
    }
}

/// The part of the window, in whole pixels, that a rectangle in points covers.
fn in_pixels(place: egui::Rect, scale: f32, window: PhysicalSize<u32>) -> [u32; 4] {
    let whole = |points: f32, most: u32| ((points * scale).round().max(0.0) as u32).min(most);
    let [left, top] = [whole(place.left(), window.width), whole(place.top(), window.height)];
    let [right, bottom] = [whole(place.right(), window.width), whole(place.bottom(), window.height)];
    [left, top, right.saturating_sub(left), bottom.saturating_sub(top)]
}

/// A name of a file in the program's folder that is not taken.
fn free_name(scene: &str, extension: &str) -> PathBuf {
    let name = |i: u32| PathBuf::from(format!("{scene}-{i:04}.{extension}"));
    (1..10_000).map(name).find(|path| !path.exists()).unwrap_or_else(|| name(10_000))
}
