//! Edits of a scene and its view, which a window sends to the ranks that shade its points in place of the whole scene.

use std::collections::BTreeMap;

use glam::Affine3A;
use serde::{Deserialize, Serialize};

use crate::engine::Engine;
use crate::error::Result;
use crate::scene::{Camera, Light, Material};
use crate::settings::Settings;
use crate::view::View;

/// A change of what an engine shows, whatever it was before.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Edit {
    /// The camera, with the size of the image.
    Camera(Camera),
    /// The settings. Ranks keep their traversal kernel, and their rounds where these are more.
    Settings(Box<Settings>),
    /// Where an object is.
    Object(u32, Affine3A),
    /// A material, but for its measured lobe.
    Material(u32, Box<Material>),
    /// A light without area.
    Light(u32, Light),
}

/// The thing that an edit changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Thing {
    Camera,
    Settings,
    Object(u32),
    Material(u32),
    Light(u32),
}

impl Edit {
    fn thing(&self) -> Thing {
        match *self {
            Edit::Camera(_) => Thing::Camera,
            Edit::Settings(_) => Thing::Settings,
            Edit::Object(object, _) => Thing::Object(object),
            Edit::Material(index, _) => Thing::Material(index),
            Edit::Light(index, _) => Thing::Light(index),
        }
    }

    /// Makes the change in an engine whose scene may change. Errors: those of the engine's own functions.
    pub fn apply(self, engine: &mut Engine) -> Result<()> {
        match self {
            Edit::Camera(camera) => engine.set_view(View::whole(camera)),
            Edit::Settings(settings) => {
                let now = engine.settings();
                let (traversal, rounds) = (now.traversal, now.rounds.max(settings.rounds));
                engine.set_settings(Settings { traversal, rounds, ..*settings })
            }
            Edit::Object(object, transform) => engine.set_transform(object, transform),
            Edit::Material(index, mut material) => {
                let own = engine.scene().and_then(|scene| scene.materials.get(index as usize));
                material.lobe = own.and_then(|own| own.lobe.clone());
                engine.set_material(index, *material)
            }
            Edit::Light(index, light) => engine.set_light(index, light),
        }
    }
}

/// The latest edit of each thing, and its number in the order of all edits.
#[derive(Clone, Debug, Default)]
pub struct Edits {
    latest: BTreeMap<Thing, (u64, Edit)>,
    number: u64,
}

impl Edits {
    /// Adds an edit, unless it changes nothing.
    pub fn add(&mut self, edit: Edit) {
        let thing = edit.thing();
        if self.latest.get(&thing).is_none_or(|(_, latest)| *latest != edit) {
            self.number += 1;
            self.latest.insert(thing, (self.number, edit));
        }
    }

    /// Number of the latest edit; 0: there is none.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// The edits after the one of this number that no later one makes up for, in their order.
    pub fn since(&self, number: u64) -> Vec<Edit> {
        let mut edits: Vec<&(u64, Edit)> = self.latest.values().filter(|(own, _)| *own > number).collect();
        edits.sort_by_key(|(own, _)| *own);
        edits.into_iter().map(|(_, edit)| edit.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn only_the_latest_edit_of_a_thing_is_sent() {
        let mut edits = Edits::default();
        let object = |object, x| Edit::Object(object, Affine3A::from_translation(Vec3::X * x));
        let settings = Edit::Settings(Box::new(Settings::interactive()));
        assert!((edits.number(), edits.since(0).len()) == (0, 0));
        [object(1, 1.0), object(2, 1.0), settings.clone(), object(1, 2.0)].into_iter().for_each(|edit| edits.add(edit));
        assert_eq!(edits.since(0), [object(2, 1.0), settings, object(1, 2.0)]);
        assert_eq!(edits.since(3), [object(1, 2.0)]);
        // Nothing has changed.
        edits.add(object(1, 2.0));
        assert!((edits.number(), edits.since(4).len()) == (4, 0));
    }

    /// Bits of floats come back from text.
    #[test]
    fn edits_come_back_as_they_were() {
        let third = |n: f32| Vec3::new(n / 3.0, -n / 7.0, 1e-20 * n);
        let material = Material { base_color: third(0.9), roughness: 0.1, ..Material::default() };
        let light =
            Light::Spot { position: third(1.0), direction: third(2.0), intensity: third(1e20), inner: 0.1, outer: 0.3 };
        let transform = Affine3A::from_axis_angle(Vec3::Y, 0.7) * Affine3A::from_translation(third(5.0));
        let camera: Camera = serde_json::from_str("{\"eye\": [0.1, 1e-7, 3.3], \"target\": [0, 0, 0]}").unwrap();
        for edit in [
            Edit::Camera(camera),
            Edit::Settings(Box::default()),
            Edit::Object(3, transform),
            Edit::Material(1, Box::new(material)),
            Edit::Light(0, light),
        ] {
            let text = serde_json::to_string(&edit).unwrap();
            assert_eq!(serde_json::from_str::<Edit>(&text).unwrap(), edit, "{text}");
        }
    }
}
