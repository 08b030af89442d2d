//! The chosen object, its place and its materials; lights without area.

use egui::{DragValue, Ui};
use glam::Vec3;
use lightsum::light::cosine::MAX_EXPONENT;
use lightsum::scene::{Light, Material, Surface};

use super::panel::Request;
use super::session::Session;

/// Most lights that are listed.
const LAMPS: u32 = 64;

/// Draws them; asks for what the user changed.
pub fn show(ui: &mut Ui, session: &Session, requests: &mut Vec<Request>) {
    let Some(chosen) = session.chosen() else { return };
    let object = chosen.object;
    let now = session.placed(object);
    let mut placed = now;
    let size = session.engine().plan().scene.extent.size;
    ui.horizontal(|ui| {
        ui.label("place");
        for value in [&mut placed.pose.translation.x, &mut placed.pose.translation.y, &mut placed.pose.translation.z] {
            ui.add(DragValue::new(value).speed(2e-3 * size).max_decimals(3));
        }
    });
    ui.horizontal(|ui| {
        ui.label("turn");
        ui.add(DragValue::new(&mut placed.pose.degrees).speed(1.0).suffix("°"));
        ui.label("scale");
        let mut scale = placed.pose.scale.x;
        if ui.add(DragValue::new(&mut scale).range(0.01..=100.0).speed(0.01)).changed() {
            placed.pose.scale = Vec3::splat(scale);
        }
        if ui.small_button("back").on_hover_text("where the model has it").clicked() {
            placed.pose = Default::default();
        }
    });
    if placed != now {
        requests.push(Request::Place(object, placed));
    }
    let Some(scene) = session.scene() else { return };
    for &index in &chosen.materials {
        let Some(now) = scene.materials.get(index as usize) else { continue };
        ui.separator();
        let mut material = now.clone();
        ui.push_id(index, |ui| edit(ui, &mut material));
        if material != *now {
            requests.push(Request::Material(index, Box::new(material)));
        }
    }
}

fn edit(ui: &mut Ui, material: &mut Material) {
    ui.label(format!("material {}", material.name));
    ui.horizontal(|ui| {
        let surfaces = [(Surface::Opaque, "opaque"), (Surface::Mirror, "mirror"), (Surface::Glass, "glass")];
        for (surface, name) in surfaces {
            ui.selectable_value(&mut material.surface, surface, name);
        }
    });
    ui.horizontal(|ui| {
        ui.label("colour");
        color(ui, &mut material.base_color);
        ui.label("specular");
        color(ui, &mut material.specular);
    });
    ui.horizontal(|ui| {
        ui.label("roughness");
        ui.add(DragValue::new(&mut material.roughness).range(0.0..=1.0).speed(0.005));
        ui.label("metallic");
        ui.add(DragValue::new(&mut material.metallic).range(0.0..=1.0).speed(0.005));
    });
    if material.surface == Surface::Opaque {
        ui.horizontal(|ui| {
            ui.label("anisotropy");
            ui.add(DragValue::new(&mut material.anisotropy).range(0.0..=1.0).speed(0.005));
            ui.label("rotation");
            ui.add(DragValue::new(&mut material.anisotropy_rotation).range(-3.2..=3.2).speed(0.01));
        });
    }
    if material.surface == Surface::Glass {
        ui.horizontal(|ui| {
            ui.label("index of refraction");
            ui.add(DragValue::new(&mut material.ior).range(1.0..=4.0).speed(0.005));
        });
    }
    light(ui, "emission", &mut material.emission);
    if material.emission != Vec3::ZERO {
        ui.horizontal(|ui| {
            ui.label("exponent of the cosine");
            ui.add(DragValue::new(&mut material.emission_exponent).range(1.0..=MAX_EXPONENT).speed(0.1));
        });
    }
}

/// Draws the lights without area; asks for what the user changed.
pub fn lamps(ui: &mut Ui, session: &Session, requests: &mut Vec<Request>) {
    let lights = session.editable().map(|scene| scene.lights.as_slice()).unwrap_or_default();
    let mut rest = lights.iter().filter(|light| !matches!(light, Light::Sphere { .. })).count();
    for (index, now) in (0..).zip(lights) {
        let mut changed = *now;
        let Some((name, strength)) = lamp(&mut changed) else { continue };
        if index >= LAMPS {
            ui.label(format!("and {rest} more"));
            return;
        }
        rest -= 1;
        ui.push_id(index, |ui| light(ui, &format!("{name} {index}"), strength));
        if changed != *now {
            requests.push(Request::Light(index, changed));
        }
    }
}

/// Kind and strength of a light that has no area.
fn lamp(light: &mut Light) -> Option<(&'static str, &mut Vec3)> {
    match light {
        Light::Point { intensity, .. } => Some(("point", intensity)),
        Light::Spot { intensity, .. } => Some(("spot", intensity)),
        Light::Directional { irradiance, .. } => Some(("parallel", irradiance)),
        Light::Imported { power, .. } => Some(("virtual", power)),
        Light::Sphere { .. } => None,
    }
}

/// The strength of a light: a colour of greatest channel 1, and its factor.
fn light(ui: &mut Ui, name: &str, value: &mut Vec3) {
    let mut strength = value.max_element();
    let mut hue = if strength > 0.0 { *value / strength } else { Vec3::ONE };
    ui.horizontal(|ui| {
        ui.label(name);
        let turned = color(ui, &mut hue);
        let speed = (0.01 * strength).max(0.01);
        let raised = ui.add(DragValue::new(&mut strength).range(0.0..=f32::MAX).speed(speed)).changed();
        if turned || raised {
            *value = hue * strength;
        }
    });
}

/// A colour, linear; whether it was changed.
fn color(ui: &mut Ui, value: &mut Vec3) -> bool {
    let mut rgb = value.to_array();
    let changed = ui.color_edit_button_rgb(&mut rgb).changed();
    if changed {
        *value = Vec3::from_array(rgb);
    }
    changed
}
