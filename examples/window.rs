//! A window that shows a scene while its camera circles, and sums passes while it rests: a host by winit and `lightsum::gpu::surface`.
//!
//! ```text
//! cargo run --release --example window -- [SCENE.toml [FRAMES]]
//! ```
//!
//! The camera turns for the first half of every eight seconds, or of FRAMES frames, after which the window closes.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use lightsum::glam::{Quat, Vec3};
use lightsum::gpu::surface::{Outcome, Presenter, Shown, WindowDevice};
use lightsum::gpu::{ContextOptions, DeviceChoice};
use lightsum::output::Tonemap;
use lightsum::pass::display::{Curve, Display};
use lightsum::{Camera, Engine, Settings};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::window::{Window, WindowId};

type Result<T, E = Box<dyn Error>> = std::result::Result<T, E>;

/// Seconds of a turn and the rest after it.
const PERIOD: f32 = 8.0;

fn main() -> Result<()> {
    let mut arguments = std::env::args_os().skip(1);
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scene = arguments.next().map_or_else(|| root.join("scenes/cornell/scene.toml"), PathBuf::from);
    let frames = arguments.next().map(|n| n.to_string_lossy().parse()).transpose()?;
    let mut app = App { scene, frames, shown: 0, view: None, outcome: Ok(()) };
    EventLoop::new()?.run_app(&mut app)?;
    app.outcome
}

struct App {
    scene: PathBuf,
    /// Frames until the window closes; `None`: it stays open.
    frames: Option<u32>,
    shown: u32,
    view: Option<View>,
    outcome: Result<()>,
}

impl ApplicationHandler for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        let made = View::new(events, &self.scene);
        match made {
            Ok(view) => self.view = Some(view),
            Err(error) => {
                self.outcome = Err(error);
                events.exit();
            }
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(view) = &mut self.view else { return };
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::RedrawRequested => {
                let time = match self.frames {
                    None => view.start.elapsed().as_secs_f32() % PERIOD,
                    Some(frames) => PERIOD * self.shown as f32 / frames.max(1) as f32,
                };
                match view.show(time) {
                    Ok(shown) => self.shown += u32::from(shown),
                    Err(error) => self.outcome = Err(error),
                }
                if self.outcome.is_err() || self.frames.is_some_and(|frames| self.shown >= frames) {
                    println!("{} frames, {} passes in the last image", self.shown, view.engine.passes());
                    // While the device is there, and with it all that was made of it.
                    self.view = None;
                    return events.exit();
                }
                view.window.request_redraw();
            }
            _ => {}
        }
    }
}

/// A window and the engine that shows a scene in it.
struct View {
    window: Arc<Window>,
    camera: Camera,
    start: Instant,
    set_up: bool,
    display: Display,
    presenter: Presenter,
    engine: Engine,
}

impl View {
    fn new(events: &ActiveEventLoop, path: &Path) -> Result<View> {
        let scene = lightsum::scene::load(path)?;
        let attributes =
            Window::default_attributes().with_title("lightsum").with_inner_size(PhysicalSize::new(320, 240));
        let window = Arc::new(events.create_window(attributes)?);
        let device = WindowDevice::new(window.clone(), &DeviceChoice::default(), false)?;
        let context = device.lend(&ContextOptions::default())?;
        let size = pixels(&window);
        let camera = Camera { resolution: size, ..scene.camera.ok_or("the scene has no camera")? };
        let engine = Engine::new(&context, &scene, camera, Settings::interactive())?;
        let display = Display::new(&context, engine.image())?;
        let presenter = Presenter::new(&device, &context, size)?;
        window.request_redraw();
        Ok(View { window, camera, start: Instant::now(), set_up: false, display, presenter, engine })
    }

    /// Shows a frame, if the window has an image to draw to; `time` of the turn, seconds.
    fn show(&mut self, time: f32) -> Result<bool> {
        let size = pixels(&self.window);
        self.presenter.resize(size);
        let to_eye = self.camera.eye - self.camera.target;
        let turned = Quat::from_axis_angle(self.camera.up.normalize(), 0.1 * (2.0 * time.min(0.5 * PERIOD) / PERIOD));
        let eye: Vec3 = self.camera.target + turned * to_eye;
        // Another size makes buffers of the image anew; tree and pipelines stay.
        if self.engine.view().size() != size {
            self.engine.resize(size)?;
        }
        self.engine.set_camera(Camera { eye, resolution: size, ..self.camera })?;
        if !self.display.is_of(self.engine.image()) {
            self.presenter.wait()?;
            self.display = Display::new(self.engine.context(), self.engine.image())?;
        }
        let (engine, display, set_up) = (&mut self.engine, &mut self.display, &mut self.set_up);
        let outcome = self.presenter.show(
            None,
            |rec| {
                if !*set_up {
                    engine.record_setup(rec)?;
                }
                engine.record_pass(rec)?;
                engine.record_image(rec)?;
                display.record(rec, 0.0, Curve::Tone(Tonemap::Aces))?;
                *set_up = true;
                Ok(Some(Shown { image: display.shown.clone(), at: [0, 0], size }))
            },
            |_| Ok(()),
        )?;
        match outcome {
            Outcome::Submitted => Ok(true),
            Outcome::Skipped => Ok(false),
            Outcome::Failed(error) => Err(error.into()),
        }
    }
}

/// Width and height of a window's inside; one without area has a pixel.
fn pixels(window: &Window) -> [u32; 2] {
    let size = window.inner_size();
    [size.width.max(1), size.height.max(1)]
}
