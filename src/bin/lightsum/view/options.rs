//! The settings, each with the help of its flag and the time of the GPU passes that it changes.

use egui::{DragValue, RichText, Ui};
use lightsum::ring::{Form, Ring};
use lightsum::settings::{
    ClusterOrder, Compensation, Filter, GlossyForm, LightChoice, Preset, Sequence, Settings, ShadowForm, SoftShadows,
    Splats, Spread, Superposition,
};

use super::panel::{Panel, Request};
use super::session::Session;

/// The GPU passes whose time a setting changes, by its flag. Settings that are not here change no time, or that of all passes.
const PASSES: [(&str, &[&str]); 27] = [
    ("particles", &["walk", "light_lists", "shade"]),
    ("light_pool", &["walk", "light_lists"]),
    ("direct_lights", &["light_lists", "shade"]),
    ("delta_lights", &["shade"]),
    ("max_depth", &["walk", "shade"]),
    ("max_specular", &["eye"]),
    ("photons", &["photons"]),
    ("photon_radius", &["photons"]),
    ("interleave_photons", &["photons"]),
    ("mirror_lights", &["mirror_lights"]),
    ("clip_fraction", &["near_light", "compensation"]),
    ("light_threshold", &["shade"]),
    ("lights_per_dispatch", &["shade"]),
    ("filter", &["caustics", "discontinuity", "sparse_windows", "discontinuity_lobes", "outliers", "unlikely"]),
    ("no_filter_direct", &["discontinuity", "discontinuity_lobes"]),
    ("no_filter_sparse", &["sparse_windows"]),
    ("compensation", &["near_light", "compensation"]),
    ("superposition", &["mirrors"]),
    ("glossy", &["splats"]),
    ("splat_width", &["splats"]),
    ("soft_shadows", &["soft_shadows"]),
    ("cluster_order", &["sort", "clusters"]),
    ("no_split", &["eye"]),
    ("no_glossy_paths", &["eye", "glossy_light"]),
    ("no_antialias", &["edges"]),
    ("shading_rate", &["upsample"]),
    ("ring", &["ring"]),
];

/// Milliseconds of a frame that a setting changes, by the latest times of the GPU passes; `None`: it is not one of [`PASSES`], or none of
/// its passes runs.
fn cost(flag: &str, times: &[(String, f64)]) -> Option<f64> {
    let (_, passes) = PASSES.iter().find(|(known, _)| *known == flag)?;
    let ran = || times.iter().filter(|(name, _)| passes.contains(&name.as_str()));
    ran().next().map(|_| ran().map(|(_, ms)| ms).sum())
}

/// Draws them; asks for others if the user changed one.
pub fn show(ui: &mut Ui, panel: &Panel, times: &[(String, f64)], session: &Session, requests: &mut Vec<Request>) {
    let panel = &Rows { panel, times };
    let (now, engine) = (session.settings(), session.engine());
    let mut s = now.clone();
    ui.horizontal(|ui| {
        ui.label("preset").on_hover_text(panel.panel.flag("preset"));
        for (preset, name) in [(Preset::Progressive, "progressive"), (Preset::Interactive, "interactive")] {
            if ui.small_button(name).clicked() {
                s.apply_preset(preset);
            }
        }
    });
    egui::Grid::new("settings").num_columns(3).striped(true).show(ui, |ui| {
        numbers(ui, panel, &mut s);
        choices(ui, panel, &mut s);
        // An engine that was made without splats cannot show them.
        if engine.device_scene().surfaces.is_some() {
            glossy(ui, panel, &mut s);
        }
    });
    if s != *now {
        requests.push(Request::Settings(Box::new(s)));
    }
}

/// Source of what a row shows beside its setting.
struct Rows<'a> {
    panel: &'a Panel,
    /// Milliseconds of each GPU pass.
    times: &'a [(String, f64)],
}

/// A row: the name of a flag, which shows its help, what changes it, and the time of its passes.
fn row(ui: &mut Ui, rows: &Rows, flag: &str, change: impl FnOnce(&mut Ui)) {
    ui.label(flag.replace('_', " ")).on_hover_text(rows.panel.flag(flag));
    change(ui);
    if let Some(ms) = cost(flag, rows.times) {
        let passes =
            PASSES.iter().find(|(known, _)| *known == flag).map_or(String::new(), |(_, passes)| passes.join(", "));
        ui.label(RichText::new(format!("{ms:.1} ms")).small()).on_hover_text(format!("GPU time of {passes}"));
    }
    ui.end_row();
}

/// A number of at least `low`.
fn number(ui: &mut Ui, value: &mut u32, low: u32, high: u32) {
    let speed = (f64::from(*value) * 0.02).max(0.1);
    ui.add(DragValue::new(value).range(low..=high).speed(speed));
}

/// A value that may be left to the program.
fn optional<T: egui::emath::Numeric>(ui: &mut Ui, value: &mut Option<T>, start: T, low: T, high: T) {
    ui.horizontal(|ui| {
        let mut given = value.is_some();
        ui.checkbox(&mut given, "");
        match (given, value.as_mut()) {
            (true, Some(value)) => drop(ui.add(DragValue::new(value).range(low..=high).speed(0.1))),
            (true, None) => *value = Some(start),
            (false, _) => {
                *value = None;
                ui.label("auto");
            }
        }
    });
}

fn numbers(ui: &mut Ui, panel: &Rows, s: &mut Settings) {
    row(ui, panel, "particles", |ui| number(ui, &mut s.particles, 1, Settings::MAX_PARTICLES));
    row(ui, panel, "light_pool", |ui| number(ui, &mut s.light_pool, 0, Settings::MAX_PARTICLES));
    row(ui, panel, "direct_lights", |ui| optional(ui, &mut s.direct_lights, 4, 1, Settings::MAX_PARTICLES));
    row(ui, panel, "delta_lights", |ui| optional(ui, &mut s.delta_lights, 64, 1, Settings::MAX_DELTA_LIGHTS));
    row(ui, panel, "interleave", |ui| {
        ui.horizontal(|ui| s.pattern.iter_mut().for_each(|n| number(ui, n, 1, Settings::MAX_PATTERN)));
    });
    row(ui, panel, "shading_rate", |ui| number(ui, &mut s.shading_rate, 1, Settings::MAX_SHADING_RATE));
    row(ui, panel, "max_depth", |ui| number(ui, &mut s.max_depth, 1, Settings::MAX_DEPTH));
    row(ui, panel, "max_specular", |ui| number(ui, &mut s.max_specular, 0, Settings::MAX_SPECULAR));
    let most = Settings::MAX_PHOTONS / s.classes();
    row(ui, panel, "photons", |ui| number(ui, &mut s.photons, 0, most));
    row(ui, panel, "photon_radius", |ui| optional(ui, &mut s.photon_radius, 1.0, 1e-6, 1e9));
    row(ui, panel, "mirror_lights", |ui| number(ui, &mut s.mirror_lights, 0, Settings::MAX_MIRROR_LIGHTS));
    let clip = &mut s.clip;
    row(ui, panel, "clip_fraction", |ui| match clip {
        lightsum::Clip::Fraction(fraction) => drop(ui.add(DragValue::new(fraction).range(0.0..=10.0).speed(0.002))),
        lightsum::Clip::Distance(distance) => {
            drop(ui.add(DragValue::new(distance).range(0.0..=f32::MAX).speed(0.01).prefix("distance ")));
        }
    });
    row(ui, panel, "light_threshold", |ui| {
        ui.add(DragValue::new(&mut s.light_threshold).range(0.0..=f32::MAX).speed(1e-4));
    });
    row(ui, panel, "power_fraction", |ui| {
        ui.add(DragValue::new(&mut s.power_fraction).range(0.001..=1.0).speed(0.005));
    });
    row(ui, panel, "seed", |ui| drop(ui.add(DragValue::new(&mut s.seed))));
    row(ui, panel, "lights_per_dispatch", |ui| number(ui, &mut s.lights_per_dispatch, 1, 64));
    row(ui, panel, "rounds", |ui| number(ui, &mut s.rounds, 1, 1024));
}

fn choices(ui: &mut Ui, panel: &Rows, s: &mut Settings) {
    let mut window = s.filter.map(|filter| filter.window);
    row(ui, panel, "filter", |ui| {
        let named = |window: Option<Option<[u32; 2]>>| match window {
            None => String::from("off"),
            Some(None) => String::from("auto"),
            Some(Some([x, y])) => format!("{x} x {y}"),
        };
        let sizes = [3, 5, 7, 9].map(|n| Some(Some([n, n])));
        egui::ComboBox::new("filter", "").selected_text(named(window)).show_ui(ui, |ui| {
            for choice in [None, Some(None)].into_iter().chain(sizes) {
                ui.selectable_value(&mut window, choice, named(choice));
            }
        });
    });
    if window != s.filter.map(|filter| filter.window) {
        s.filter = window.map(|window| Filter { window, ..s.filter.unwrap_or_default() });
    }
    if let Some(filter) = &mut s.filter {
        let mut not = !filter.direct;
        row(ui, panel, "no_filter_direct", |ui| drop(ui.checkbox(&mut not, "")));
        filter.direct = !not;
        let mut not = !filter.sparse;
        row(ui, panel, "no_filter_sparse", |ui| drop(ui.checkbox(&mut not, "")));
        filter.sparse = !not;
    }
    row(ui, panel, "compensation", |ui| {
        choice(ui, "compensation", &mut s.compensation, &[Compensation::Off, Compensation::Near, Compensation::Exact]);
    });
    ring(ui, panel, s);
    let mut spread = s.superposition.map(|superposition| superposition.spread);
    row(ui, panel, "superposition", |ui| {
        let all = [None, Some(Spread::Mirror), Some(Spread::Invariant), Some(Spread::Variant)];
        let named =
            |spread: Option<Spread>| spread.map_or(String::from("off"), |spread| format!("{spread:?}").to_lowercase());
        egui::ComboBox::new("superposition", "").selected_text(named(spread)).show_ui(ui, |ui| {
            for choice in all {
                ui.selectable_value(&mut spread, choice, named(choice));
            }
        });
    });
    if spread != s.superposition.map(|superposition| superposition.spread) {
        s.superposition = spread.map(|spread| Superposition { spread, ..s.superposition.unwrap_or_default() });
    }
    soft_shadows(ui, panel, s);
    row(ui, panel, "light_choice", |ui| {
        choice(ui, "light_choice", &mut s.light_choice, &[LightChoice::Power, LightChoice::Contribution]);
    });
    row(ui, panel, "sequence", |ui| {
        choice(ui, "sequence", &mut s.sequence, &[Sequence::Halton, Sequence::Sobol]);
    });
    row(ui, panel, "cluster_order", |ui| {
        choice(ui, "cluster_order", &mut s.cluster_order, &[ClusterOrder::Screen, ClusterOrder::Space]);
    });
    for (flag, value) in
        [("no_split", &mut s.split), ("no_glossy_paths", &mut s.glossy_paths), ("no_antialias", &mut s.antialias)]
    {
        let mut not = !*value;
        row(ui, panel, flag, |ui| drop(ui.checkbox(&mut not, "")));
        *value = !not;
    }
    for (flag, value) in
        [("interleave_photons", &mut s.interleave_photons), ("jitter", &mut s.jitter), ("summands", &mut s.summands)]
    {
        row(ui, panel, flag, |ui| drop(ui.checkbox(value, "")));
    }
}

fn ring(ui: &mut Ui, panel: &Rows, s: &mut Settings) {
    let mut form = s.ring.map(|ring| ring.form);
    row(ui, panel, "ring", |ui| {
        let named = |form: Option<Form>| form.map_or(String::from("off"), |form| format!("{form:?}").to_lowercase());
        egui::ComboBox::new("ring", "").selected_text(named(form)).show_ui(ui, |ui| {
            for choice in [None, Some(Form::Images), Some(Form::Lights)] {
                ui.selectable_value(&mut form, choice, named(choice));
            }
        });
    });
    if form != s.ring.map(|ring| ring.form) {
        s.ring = form.map(|form| Ring { form, ..s.ring.unwrap_or(Ring::new(form)) });
    }
    if let Some(ring) = &mut s.ring {
        row(ui, panel, "ring_length", |ui| number(ui, &mut ring.length, 1, Ring::MAX_LENGTH));
    }
}

/// Splats. Their alpha is settled when the scene is loaded.
fn glossy(ui: &mut Ui, panel: &Rows, s: &mut Settings) {
    let mut form = if s.splats.is_some() { GlossyForm::Splats } else { GlossyForm::Paths };
    row(ui, panel, "glossy", |ui| choice(ui, "glossy", &mut form, &[GlossyForm::Paths, GlossyForm::Splats]));
    s.splats = Splats::chosen(s.splats, Some(form), (None, None, None));
    if let Some(splats) = &mut s.splats {
        row(ui, panel, "splat_particles", |ui| number(ui, &mut splats.particles, 1, Splats::MAX_PARTICLES));
        row(ui, panel, "splat_width", |ui| {
            ui.add(DragValue::new(&mut splats.width).range(1.0..=100.0).speed(0.2));
        });
    }
}

fn soft_shadows(ui: &mut Ui, panel: &Rows, s: &mut Settings) {
    let mut form = if s.soft_shadows.is_some() { ShadowForm::Splat } else { ShadowForm::Off };
    row(ui, panel, "soft_shadows", |ui| choice(ui, "soft_shadows", &mut form, &[ShadowForm::Off, ShadowForm::Splat]));
    s.soft_shadows = SoftShadows::chosen(s.soft_shadows, Some(form), None);
    if let Some(soft) = &mut s.soft_shadows {
        row(ui, panel, "soft_shadow_lights", |ui| number(ui, &mut soft.lights, 1, SoftShadows::MAX_LIGHTS));
    }
}

/// One of several named values.
fn choice<T: PartialEq + Copy + std::fmt::Debug>(ui: &mut Ui, id: &str, value: &mut T, all: &[T]) {
    let named = |value: &T| format!("{value:?}").to_lowercase();
    egui::ComboBox::new(id, "").selected_text(named(value)).show_ui(ui, |ui| {
        for one in all {
            ui.selectable_value(value, *one, named(one));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_cost_the_time_of_their_passes() {
        let times = [("walk", 2.0), ("shade", 5.0), ("edges", 1.0)].map(|(name, ms)| (String::from(name), ms));
        assert_eq!(cost("particles", &times), Some(7.0));
        assert_eq!(cost("no_antialias", &times), Some(1.0));
        assert_eq!((cost("photons", &times), cost("seed", &times)), (None, None));
    }
}
