//! A summary of a scene: counts, lights with their power, size, memory, and what its files hold beyond that.

use std::collections::BTreeMap;

use glam::Vec3;
use serde::Serialize;

use crate::accel::Bvh;
use crate::accel::wide::WideBvh;
use crate::device_scene::texels;
use crate::error::Result;
use crate::light::emitters::{Emitter, EmitterRecord, Emitters, Kind};
use crate::pass::layout::{MaterialRecord, TextureRecord};
use crate::sampling::sobol;
use crate::scene::animation::Animation;
use crate::scene::{Camera, Scene};

/// Summary of a scene; the keys of the JSON form are the fields' names.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the scene.
    pub name: String,
    /// Triangles.
    pub triangles: usize,
    /// Objects by name, which can be moved one by one.
    pub objects: usize,
    /// Materials.
    pub materials: usize,
    /// Textures with width and height.
    pub textures: Vec<TextureSummary>,
    /// Lower corner of the bounding box, world coordinates.
    pub low: [f64; 3],
    /// Upper corner.
    pub high: [f64; 3],
    /// The camera; `None`: the scene is framed.
    pub camera: Option<Camera>,
    /// Names of all cameras of a glTF file.
    pub cameras: Vec<String>,
    /// Animations of a glTF file.
    pub animations: Vec<AnimationSummary>,
    /// The emitters, the strongest first.
    pub lights: Vec<LightSummary>,
    /// Emitted flux of all lights, W: mean of red, green and blue.
    pub power: f32,
    /// Bytes of the scene's buffers on a device, without those of the image and its passes, and without targets of photons and planar
    /// mirrors.
    pub device_bytes: u64,
    /// Content of the files that the loader leaves out.
    pub ignored: Vec<String>,
}

/// A texture.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TextureSummary {
    /// Its file or name.
    pub name: String,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// An animation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AnimationSummary {
    /// Its name.
    pub name: String,
    /// Times of its first and last key, seconds.
    pub span: [f64; 2],
}

/// Lights of one kind, or the emissive faces of one material.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LightSummary {
    /// Kind, with the name of the material or of the environment.
    pub name: String,
    /// Number of lights or faces.
    pub count: usize,
    /// Emitted flux of all, W: mean of red, green and blue. Of parallel light and of an environment what passes the scene's bounding
    /// sphere.
    pub power: f32,
}

impl Summary {
    /// Of a valid scene. Builds the tree, for its size.
    pub fn of(scene: &Scene) -> Result<Summary> {
        let emitters = Emitters::of(scene, scene.emitters_are_lights)?;
        let (low, high) = scene.bounds();
        let texture =
            |t: &crate::scene::Texture| TextureSummary { name: t.name.clone(), width: t.width, height: t.height };
        let lights = lights(scene, &emitters);
        Ok(Summary {
            name: scene.name.clone(),
            triangles: scene.triangles.len(),
            objects: scene.objects.len(),
            materials: scene.materials.len(),
            textures: scene.textures.iter().map(texture).collect(),
            low: scene.to_world(low).to_array(),
            high: scene.to_world(high).to_array(),
            camera: scene.camera,
            cameras: scene.cameras.iter().map(|named| named.name.clone()).collect(),
            animations: scene.animations.iter().flat_map(|a| &a.list).map(AnimationSummary::of).collect(),
            power: mean(emitters.power),
            lights,
            device_bytes: device_bytes(scene, &emitters)?,
            ignored: scene.ignored.clone(),
        })
    }
}

impl AnimationSummary {
    fn of(animation: &Animation) -> AnimationSummary {
        AnimationSummary { name: animation.name.clone(), span: [animation.start, animation.end] }
    }
}

fn mean(v: Vec3) -> f32 {
    v.element_sum() / 3.0
}

/// Lights by kind or material, the strongest first.
fn lights(scene: &Scene, emitters: &Emitters) -> Vec<LightSummary> {
    let mut faces = vec![Vec::new(); emitters.list.len()];
    // The faces of a divided emitter are those of its first part; the others have its name.
    let mut first_part: Vec<usize> = (0..emitters.list.len()).collect();
    for (&first, parts) in &emitters.parts {
        for &cell in &parts.cells {
            if let Some(of) = first_part.get_mut(cell as usize) {
                *of = first as usize;
            }
        }
    }
    for (t, &emitter) in emitters.of_triangle.iter().enumerate() {
        if let Some(faces) = faces.get_mut(emitter as usize) {
            faces.push(t);
        }
    }
    let name = |e: &Emitter, faces: &[usize]| match e.kind {
        Kind::Triangle | Kind::Quad => {
            let material = faces.first().map_or(0, |&t| scene.triangles[t].material);
            format!("material {:?}", scene.materials[material as usize].name)
        }
        Kind::Sphere => String::from("sphere lights"),
        Kind::Point => String::from("point lights"),
        Kind::Spot => String::from("spot lights"),
        Kind::Directional => String::from("parallel lights"),
        Kind::Imported => String::from("virtual lights"),
        Kind::Environment => {
            let environment = scene.environment.as_ref();
            environment.map_or(String::new(), |e| format!("environment {:?}, {}x{}", e.name, e.width, e.height))
        }
    };
    let mut sums: BTreeMap<String, (usize, f64)> = BTreeMap::new();
    for (i, e) in emitters.list.iter().enumerate() {
        let sum = sums.entry(name(e, &faces[first_part[i]])).or_default();
        sum.0 = match e.kind {
            Kind::Triangle | Kind::Quad => sum.0 + faces[i].len(),
            Kind::Environment => 1,
            _ => sum.0 + 1,
        };
        sum.1 += f64::from(mean(e.power));
    }
    let of = |(name, (count, power)): (String, (usize, f64))| LightSummary { name, count, power: power as f32 };
    let mut all: Vec<LightSummary> = sums.into_iter().map(of).collect();
    all.sort_by(|a, b| b.power.total_cmp(&a.power));
    all
}

/// Bytes of the buffers of [`crate::device_scene::DeviceScene`].
fn device_bytes(scene: &Scene, emitters: &Emitters) -> Result<u64> {
    let bvh = Bvh::build(scene)?;
    let wide = WideBvh::build(&bvh);
    let uvs = if scene.textures.is_empty() && scene.colors.is_empty() { 0 } else { 32 };
    let colors = if scene.colors.is_empty() { 0 } else { 16 };
    let uvs = if scene.second_uvs.is_empty() { uvs } else { 2 * uvs };
    let triangle = 3 * 16 + 16 + uvs + colors;
    let environment = scene.environment.as_ref().map_or(1, |e| e.texels.len());
    let bytes = 32 * bvh.node_count() as usize
        + 16 * wide.nodes.len()
        + triangle * scene.triangles.len()
        + size_of::<MaterialRecord>() * scene.materials.len()
        + size_of::<TextureRecord>() * scene.textures.len()
        + texels::bytes_of(&scene.textures) as usize
        + size_of::<EmitterRecord>() * emitters.list.len()
        + 16 * (3 + environment)
        + 8 * sobol::column_pairs().len();
    Ok(bytes as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    #[test]
    fn a_room_is_summed_up() {
        let scene = builtin::room(800);
        let summary = Summary::of(&scene).unwrap();
        assert_eq!((summary.triangles, summary.materials), (scene.triangles.len(), scene.materials.len()));
        let power: f32 = summary.lights.iter().map(|light| light.power).sum();
        assert!(power > 0.0 && (power / summary.power - 1.0).abs() < 1e-4, "{power} of {}", summary.power);
        let faces: usize = summary.lights.iter().filter(|l| l.name.starts_with("material")).map(|l| l.count).sum();
        assert_eq!(faces, scene.emitters().len());
        assert!(summary.lights.is_sorted_by(|a, b| a.power >= b.power));
        assert!(summary.device_bytes > 64 * summary.triangles as u64);
    }
}
