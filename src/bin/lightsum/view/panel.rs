//! The panel beside the image, and help and messages over it.

use egui::{Align2, Color32, DragValue, RichText, Ui};
use lightsum::output::Tonemap;
use lightsum::pass::layer::Layer;
use lightsum::scene::{Camera, Light, Material};
use lightsum::settings::Settings;
use std::collections::HashMap;

use super::clock::Clock;
use super::keys::{ACTIONS, Action, MOUSE};
use super::navigate::Mode;
use super::route::Placed;
use super::session::{Look, Session, WHOLE};
use super::{objects, options, overlay};
use crate::args::{self, MAX_COARSER};

/// Width of the panel, points.
pub const WIDTH: f32 = 300.0;

/// Requests that the user makes in the panel.
pub enum Request {
    /// The action of a key.
    Do(Action),
    /// Other settings.
    Settings(Box<Settings>),
    /// Another camera.
    Camera(Camera),
    /// An object somewhere else.
    Place(u32, Placed),
    /// Another material.
    Material(u32, Box<Material>),
    /// Another light.
    Light(u32, Light),
    /// The key of the path that was recorded last is not wanted.
    RemoveKey,
}

/// A message in the window.
pub struct Notice {
    /// Its text.
    pub text: String,
    /// It tells of a failure.
    pub is_error: bool,
}

/// State of what is drawn.
pub struct Panel {
    /// The panel is shown.
    pub open: bool,
    /// The help is shown.
    pub help: bool,
    /// No passes are rendered.
    pub paused: bool,
    /// By how much the image is smaller while the camera moves; 1: not at all.
    pub coarser: u32,
    /// Shading rate while the camera moves; `None`: that of the still image.
    pub moving_rate: Option<u32>,
    /// The latest message.
    pub notice: Option<Notice>,
    /// Name of the device and its driver.
    pub device: String,
    /// Help of each flag by its name.
    flags: HashMap<String, String>,
}

impl Panel {
    /// For images that are smaller by this factor, and lit at this rate, while the camera moves.
    pub fn new(coarser: u32, moving_rate: Option<u32>) -> Panel {
        let mut flags = HashMap::new();
        let arguments = args::command();
        for command in arguments.get_subcommands() {
            for flag in command.get_arguments() {
                let help = flag.get_long_help().or(flag.get_help()).map(|help| help.to_string());
                flags.entry(flag.get_id().to_string()).or_insert(help.unwrap_or_default());
            }
        }
        Panel {
            open: true,
            help: false,
            paused: false,
            coarser,
            moving_rate,
            notice: None,
            device: String::new(),
            flags,
        }
    }

    /// Help of a flag.
    pub fn flag(&self, name: &str) -> &str {
        self.flags.get(name).map_or("", String::as_str)
    }

    /// Draws everything; returns what the user asks for, and the place of the image in points.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        session: Option<&Session>,
        look: &mut Look,
        clock: &Clock,
        loading: Option<&str>,
    ) -> (Vec<Request>, egui::Rect) {
        let mut requests = Vec::new();
        if self.open {
            egui::Panel::left("panel").exact_size(WIDTH).resizable(false).show(ui, |ui| {
                egui::ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
                    self.contents(ui, session, look, clock, &mut requests);
                });
            });
        }
        let image = ui.available_rect_before_wrap();
        if let Some(session) = session {
            overlay::show(ui.painter(), session, image);
        }
        self.over(ui, session, loading, image);
        (requests, image)
    }

    fn contents(
        &mut self,
        ui: &mut Ui,
        session: Option<&Session>,
        look: &mut Look,
        clock: &Clock,
        requests: &mut Vec<Request>,
    ) {
        ui.label(RichText::new(&self.device).small()).on_hover_text(self.flag("device"));
        let Some(session) = session else {
            ui.separator();
            ui.label("Drop a scene on the window.");
            return;
        };
        let engine = session.engine();
        let [width, height] = engine.view().size();
        ui.heading(&session.name).on_hover_text(session.path.display().to_string());
        ui.horizontal(|ui| {
            ui.label(format!("{width} x {height}, pass {}", engine.passes()));
            if ui.small_button(if self.paused { "go on" } else { "stop" }).clicked() {
                requests.push(Request::Do(Action::Pause));
            }
            if ui.small_button("again").on_hover_text("start the image over").clicked() {
                requests.push(Request::Do(Action::Restart));
            }
        });
        if let Some(ring) = &engine.settings().ring {
            let mib = ring.bytes([width, height], engine.settings().max_depth) as f64 / (1 << 20) as f64;
            ui.label(format!("ring of {}, {mib:.0} MiB", ring.length)).on_hover_text(self.flag("ring"));
        }
        ui.separator();
        self.image(ui, session, look, requests);
        ui.collapsing("Camera", |ui| {
            camera(ui, session, requests);
            ui.horizontal(|ui| {
                ui.label("coarser in motion").on_hover_text(self.flag("coarser"));
                ui.add(DragValue::new(&mut self.coarser).range(1..=MAX_COARSER).speed(0.05));
            });
            ui.horizontal(|ui| {
                ui.label("shading rate in motion").on_hover_text(self.flag("shading_rate"));
                let rate = self.moving_rate.get_or_insert(1);
                ui.add(DragValue::new(rate).range(1..=Settings::MAX_SHADING_RATE).speed(0.05));
            });
        });
        ui.collapsing("Settings", |ui| options::show(ui, self, &clock.passes, session, requests));
        let object = session.chosen().and_then(|chosen| session.scene()?.objects.get(chosen.object as usize));
        let title = object.map_or(String::from("Object"), |name| format!("Object: {name}"));
        egui::CollapsingHeader::new(title).id_salt("object").default_open(true).show(ui, |ui| match object {
            Some(_) => objects::show(ui, session, requests),
            None if session.editable().is_none() => drop(ui.label("Objects stay as their light was kept.")),
            None => drop(ui.label("Click an object to choose it.")),
        });
        if session
            .editable()
            .is_some_and(|scene| scene.lights.iter().any(|light| !matches!(light, Light::Sphere { .. })))
        {
            ui.collapsing("Lights", |ui| objects::lamps(ui, session, requests));
        }
        egui::CollapsingHeader::new("Time").default_open(true).show(ui, |ui| times(ui, clock));
        ui.separator();
        ui.label(RichText::new("H shows the keys.").small());
    }

    fn image(&mut self, ui: &mut Ui, session: &Session, look: &mut Look, requests: &mut Vec<Request>) {
        ui.horizontal(|ui| {
            ui.label("exposure").on_hover_text(self.flag("exposure"));
            ui.add(DragValue::new(&mut look.stops).speed(0.05).range(-100.0..=100.0).suffix(" stops"));
            if ui.small_button("auto").clicked() {
                look.auto = true;
            }
        });
        ui.horizontal(|ui| {
            ui.label("curve").on_hover_text(self.flag("tonemap"));
            for (tonemap, name) in [(Tonemap::Srgb, "sRGB"), (Tonemap::Aces, "ACES"), (Tonemap::Agx, "AgX")] {
                ui.selectable_value(&mut look.tonemap, tonemap, name);
            }
        });
        let name =
            |layer: Option<Layer>| layer.map_or(String::from("image"), |layer| format!("{layer:?}").to_lowercase());
        let before = look.layer;
        egui::ComboBox::new("layer", "shown").selected_text(name(look.layer)).show_ui(ui, |ui| {
            // Summands get their sums when they are chosen.
            let offered = |layer: &Layer| layer.is_summand() || session.shows(*layer);
            for layer in [None].into_iter().chain(Layer::ALL.into_iter().filter(offered).map(Some)) {
                ui.selectable_value(&mut look.layer, layer, name(layer));
            }
        });
        let settings = session.settings();
        if look.layer != before && look.layer.is_some_and(Layer::is_summand) && !settings.summands {
            requests.push(Request::Settings(Box::new(Settings { summands: true, ..settings.clone() })));
        }
        ui.checkbox(&mut look.lights, "virtual lights")
            .on_hover_text("those of the latest pass, as points, the hidden ones too");
        if session.has_kernels() {
            ui.checkbox(&mut look.kernels, "kernels").on_hover_text(
                "by which the mirror images of the latest pass are spread: widths of some, and their u axes",
            );
        }
        ui.horizontal(|ui| {
            for (name, action) in [("save PNG", Action::Png), ("save EXR", Action::Exr)] {
                if ui.button(name).clicked() {
                    requests.push(Request::Do(action));
                }
            }
        });
    }

    fn over(&mut self, ui: &mut Ui, session: Option<&Session>, loading: Option<&str>, image: egui::Rect) {
        let context = ui.ctx().clone();
        if let Some(name) = loading {
            banner(
                &context,
                "loading",
                image.center_top(),
                Align2::CENTER_TOP,
                Color32::WHITE,
                &format!("loading {name}"),
            );
        } else if session.is_none() && !self.open {
            let text = "drop a scene on the window; P shows the panel";
            banner(&context, "empty", image.center(), Align2::CENTER_CENTER, Color32::WHITE, text);
        }
        if let Some(notice) = &self.notice {
            let color = if notice.is_error { Color32::from_rgb(255, 140, 120) } else { Color32::LIGHT_GREEN };
            banner(&context, "notice", image.center_bottom(), Align2::CENTER_BOTTOM, color, &notice.text);
        }
        if !self.help {
            return;
        }
        egui::Window::new("Keys").open(&mut self.help).resizable(false).default_pos(image.left_top()).show(
            &context,
            |ui| {
                egui::Grid::new("keys").num_columns(2).show(ui, |ui| {
                    let keys = ACTIONS.iter().map(|(_, key, _, help)| (*key, *help));
                    for (key, help) in MOUSE.into_iter().chain(keys) {
                        ui.label(RichText::new(key).strong());
                        ui.label(help);
                        ui.end_row();
                    }
                });
            },
        );
    }
}

fn banner(context: &egui::Context, id: &'static str, at: egui::Pos2, align: Align2, color: Color32, text: &str) {
    egui::Area::new(egui::Id::new(id)).fixed_pos(at).pivot(align).interactable(false).show(context, |ui| {
        egui::Frame::popup(ui.style()).show(ui, |ui| ui.colored_label(color, text));
    });
}

fn camera(ui: &mut Ui, session: &Session, requests: &mut Vec<Request>) {
    let mut camera = session.camera();
    let before = camera;
    ui.horizontal(|ui| {
        let other = match session.mode {
            Mode::Orbit => "orbit: fly instead",
            Mode::Fly => "fly: orbit instead",
        };
        if ui.button(other).clicked() {
            requests.push(Request::Do(Action::Mode));
        }
        if ui.button("home").clicked() {
            requests.push(Request::Do(Action::Home));
        }
    });
    ui.horizontal(|ui| {
        if let Some(height) = &mut camera.height {
            ui.label("height").on_hover_text("of the image of this orthographic camera, scene units");
            let speed = 0.01 * *height;
            ui.add(DragValue::new(height).range(1e-9..=1e9).speed(speed));
        } else {
            ui.label("angle of view");
            ui.add(DragValue::new(&mut camera.fov_y).range(1.0..=170.0).speed(0.2).suffix("°"));
        }
    });
    if !camera.is_orthographic() {
        ui.horizontal(|ui| {
            ui.label("lens").on_hover_text("its diameter, scene units; 0: everything is sharp");
            let speed = 1e-3 * (camera.target - camera.eye).length();
            ui.add(DragValue::new(&mut camera.aperture).range(0.0..=f32::MAX).speed(speed));
        });
    }
    if let Some(scene) = session.scene() {
        for (name, point) in [("eye", camera.eye), ("target", camera.target)] {
            let world = scene.to_world(point);
            ui.label(format!("{name} {:.3}, {:.3}, {:.3}", world.x, world.y, world.z));
        }
    }
    if camera != before {
        requests.push(Request::Camera(camera));
    }
    ui.separator();
    ui.label(format!("path: {} keys", session.route.len()));
    ui.horizontal(|ui| {
        if ui.button("record").on_hover_text("a key of camera and moved objects, a second after the last").clicked() {
            requests.push(Request::Do(Action::Record));
        }
        if ui.add_enabled(session.route.len() > 0, egui::Button::new("remove")).clicked() {
            requests.push(Request::RemoveKey);
        }
        if ui.add_enabled(session.route.len() > 0, egui::Button::new("save")).clicked() {
            requests.push(Request::Do(Action::SavePath));
        }
    });
}

fn times(ui: &mut Ui, clock: &Clock) {
    let text = |name: &str, value: Option<f64>| value.map(|ms| format!("{name} {ms:.0} ms"));
    let line = [text("frame", clock.moving.last()), text("input to image", clock.latency.last())];
    let line: Vec<String> = line.into_iter().flatten().collect();
    if !line.is_empty() {
        ui.label(line.join(", ")).on_hover_text("of a view that moves");
    }
    if clock.passes.is_empty() {
        ui.label("The device writes no timestamps, or nothing has run.");
        return;
    }
    let whole = clock.passes.iter().find(|(name, _)| name == WHOLE).map_or(0.0, |(_, ms)| *ms);
    ui.label(format!("GPU {whole:.1} ms")).on_hover_text("by timestamps; some passes are parts of others");
    let passes = || clock.passes.iter().filter(|(name, _)| name != WHOLE);
    let most = passes().map(|(_, ms)| *ms).fold(1e-9, f64::max);
    for (name, ms) in passes() {
        let bar = egui::ProgressBar::new((ms / most) as f32).desired_height(14.0).corner_radius(1.0);
        ui.add(bar.text(RichText::new(format!("{name} {ms:.1}")).small()));
    }
}
