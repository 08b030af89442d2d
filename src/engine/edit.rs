//! Changes of the scene between passes: objects move and deform, materials and lights change.
//!
//! An edit checks its input, takes effect in the engine's copy of the scene at once, and marks what it touches. The
//! next [`Engine::record_pass`] updates hierarchy, emitters and buffers for all edits since the last one, and records
//! the uploads; [`Engine::apply_edits`] does the first half earlier, if a host prefers.

use std::ops::Range;
use std::time::Instant;

use glam::{Affine3A, Vec3};

use super::{Engine, make_frame};
use crate::accel::objects::ObjectTrees;
use crate::device_scene::{SceneChanges, SpecularFeatures};
use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::light::emitters::Emitters;
use crate::plan::{self, check_slots};
use crate::scene::path::Motion;
use crate::scene::posed::similarity;
use crate::scene::validate::{is_degenerate, place};
use crate::scene::{
    Camera, Light, Material, Scene, Surface, Texture, TextureUse, check_transform, mirrors, outward_matrix,
};
use crate::settings::Settings;
use crate::view::View;

/// CPU times of the latest edits, in seconds.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EditTimes {
    /// Vertices: checking and moving them, at the time of the edits.
    pub vertices: f64,
    /// Triangles and trees of the objects that moved.
    pub refit: f64,
    /// The tree of objects.
    pub top_level: f64,
    /// Emitters.
    pub lights: f64,
    /// Staging of uploads, and of new passes where needed.
    pub staging: f64,
    /// Bytes staged.
    pub bytes: u64,
}

/// State for scene edits.
pub(super) struct DynamicScene {
    pub(super) scene: Scene,
    /// Vertices of each object.
    pub(super) vertices: Vec<Range<usize>>,
    /// Triangles of each object.
    triangles: Vec<Vec<u32>>,
    /// Vertices before the transforms.
    pub(super) rest_positions: Vec<Vec3>,
    rest_normals: Vec<Vec3>,
    /// Lights before the transforms.
    rest_lights: Vec<Light>,
    transforms: Vec<Affine3A>,
    trees: ObjectTrees,
    /// Materials of each object.
    materials: Vec<Vec<u32>>,
    /// Mean colours of the textures.
    averages: Vec<Vec3>,
    pending: SceneChanges,
    /// Seconds for vertices since the last upload.
    vertex_seconds: f64,
    times: EditTimes,
}

impl Engine {
    /// [`Engine::new`] for a scene that may change between passes. Every object gets a tree of its own (see
    /// [`crate::accel::objects`]), so that moving one object does not rebuild the others; rays take somewhat longer.
    /// Vertices are renumbered, see [`Scene::separate_objects`].
    pub fn new_dynamic(context: &Context, mut scene: Scene, camera: Camera, settings: Settings) -> Result<Engine> {
        if scene.kept_light.is_some() {
            let message = "kept light is that of a scene as it stands; make the engine by Engine::new";
            return Err(Error::Scene(String::from(message)));
        }
        if scene.mirror_images.is_some() {
            let message = "images with depth are those of a scene as it stands; make the engine by Engine::new";
            return Err(Error::Scene(String::from(message)));
        }
        let vertices = scene.separate_objects();
        let (mut engine, trees) = Self::with_trees(context, &scene, View::whole(camera), settings, true)?;
        let rest = Rest {
            vertices,
            positions: scene.positions.clone(),
            normals: scene.normals.clone(),
            lights: scene.lights.clone(),
            transforms: vec![Affine3A::IDENTITY; scene.objects.len()],
        };
        engine.dynamic = trees.map(|trees| Box::new(DynamicScene::new(scene, rest, trees)));
        Ok(engine)
    }

    /// The scene as edited; `None` if it is static.
    pub fn scene(&self) -> Option<&Scene> {
        self.dynamic.as_ref().map(|moving| &moving.scene)
    }

    /// Moves an object: `transform` maps its initial position (or its vertices from [`Engine::set_vertices`]) to the
    /// new one, regardless of earlier transforms. A sphere light moves along if the object is its surface.
    ///
    /// Fronts stay fronts where a transform mirrors the object; when it begins or ends to mirror, the whole scene is uploaded again.
    ///
    /// Errors, which leave everything unchanged: there is no such object; the transform is not finite or flattens the
    /// object; a triangle would lose its area; a sphere light would no longer be a sphere.
    pub fn set_transform(&mut self, object: u32, transform: Affine3A) -> Result<()> {
        let moving = self.moving()?;
        let name = moving.name(object)?;
        if moving.transforms[object as usize] == transform {
            return Ok(());
        }
        check_transform(&transform).map_err(|message| refused(&name, &message))?;
        moving.place(object, transform, None)?;
        self.changed();
        Ok(())
    }

    /// Moves the camera to `camera` and the objects of a path to their poses at a time, in seconds, and applies these edits.
    ///
    /// Errors: those of [`Engine::set_camera`] and [`Engine::set_transform`]; they name the line of the path's file.
    pub fn place(&mut self, motion: &Motion, camera: Camera, time: f64) -> Result<()> {
        self.set_camera(camera).map_err(|error| motion.in_file(None, error))?;
        for track in &motion.objects {
            let transform = track.transform(time);
            for &object in &track.objects {
                self.set_transform(object, transform).map_err(|error| motion.in_file(Some(track.line), error))?;
            }
        }
        self.apply_edits().map_err(|error| motion.in_file(None, error))
    }

    /// The transform of an object.
    pub fn transform(&self, object: u32) -> Result<Affine3A> {
        let moving = self.dynamic.as_ref().ok_or_else(still)?;
        moving.name(object)?;
        Ok(moving.transforms[object as usize])
    }

    /// Replaces the vertices of an object: the same number, in the order of [`Engine::scene`], before its transform.
    /// Without `normals`, those of smooth triangles become the mean of their faces'.
    ///
    /// A triangle without area is not there until other vertices give it one.
    ///
    /// Errors, which leave everything unchanged: there is no such object; the number of vertices differs; a triangle
    /// that emits would lose its area; the object is the surface of a sphere light.
    pub fn set_vertices(&mut self, object: u32, positions: &[Vec3], normals: Option<&[Vec3]>) -> Result<()> {
        let moving = self.moving()?;
        let name = moving.name(object)?;
        let range = moving.vertices[object as usize].clone();
        if positions.len() != range.len() || normals.is_some_and(|normals| normals.len() != range.len()) {
            let given = normals.map_or(positions.len(), |normals| normals.len().min(positions.len()));
            return Err(refused(&name, &format!("it has {} vertices, {given} are given", range.len())));
        }
        if moving.sphere(object).is_some() {
            return Err(refused(&name, "it is the surface of a sphere light, which can move but not change its shape"));
        }
        if let Some(n) = normals.iter().flat_map(|normals| normals.iter()).find(|n| !n.is_normalized()) {
            return Err(refused(&name, &format!("normal {n} is not of unit length")));
        }
        let same_normals = normals.is_none_or(|normals| *normals == moving.rest_normals[range.clone()]);
        if *positions == moving.rest_positions[range] && same_normals {
            return Ok(());
        }
        let normals = match normals {
            Some(normals) => normals.to_vec(),
            None => moving.mean_normals(object, positions),
        };
        let transform = moving.transforms[object as usize];
        moving.place(object, transform, Some((positions, normals)))?;
        self.changed();
        Ok(())
    }

    /// Changes a material; if it emits, its triangles become emitters. A material that reflects more than it receives
    /// is scaled down as when a scene is loaded.
    ///
    /// Errors, which leave everything unchanged: there is no such material or texture; a value is out of range; nothing
    /// would emit light.
    pub fn set_material(&mut self, index: u32, mut material: Material) -> Result<()> {
        let (settings, view) = (self.plan.settings.clone(), self.plan.view.clone());
        let moving = self.moving()?;
        let Some(old) = moving.scene.materials.get(index as usize).cloned() else {
            let count = moving.scene.materials.len();
            return Err(Error::Scene(format!("material {index} does not exist, there are {count}")));
        };
        let wrong = |message: String| Error::Scene(format!("material {:?}: {message}", old.name));
        material.check().map_err(wrong)?;
        moving.scene.check_textures(&material).map_err(wrong)?;
        let of_sphere = |light: &Light| matches!(light, Light::Sphere { object, .. } if moving.materials[*object as usize].contains(&index));
        if material.emission_texture.is_some() && moving.scene.lights.iter().any(of_sphere) {
            return Err(wrong(String::from("the material of a sphere light has no emission texture")));
        }
        if material.emission_exponent != 1.0 && moving.scene.lights.iter().any(of_sphere) {
            return Err(wrong(String::from("the material of a sphere light has emission_exponent 1")));
        }
        if material.surface != Surface::Glass {
            material.limit_albedo();
        }
        if material == old {
            return Ok(());
        }
        let pattern = |m: &Material| (m.emission_texture, m.second_uvs[TextureUse::Emission as usize]);
        let emission = material.emission != old.emission
            || material.emission_exponent != old.emission_exponent
            || material.two_sided != old.two_sided
            || pattern(&material) != pattern(&old);
        moving.scene.materials[index as usize] = material;
        if emission {
            moving.match_sphere_lights(index);
        }
        let checked = check_light(&moving.scene, emission).and_then(|()| {
            check_slots(&settings, SpecularFeatures::of(&moving.scene, &moving.scene.reflectors()), &view)
        });
        if let Err(error) = checked {
            moving.scene.materials[index as usize] = old;
            if emission {
                moving.match_sphere_lights(index);
            }
            return Err(error);
        }
        moving.pending.emission |= emission;
        moving.pending.materials.push(index);
        self.changed();
        Ok(())
    }

    /// Changes a point, spot, directional or virtual light, also into another of these kinds. Sphere lights change with
    /// their object and its material.
    ///
    /// Errors, which leave everything unchanged: there is no such light; a value is out of range; it is or becomes a
    /// sphere.
    pub fn set_light(&mut self, index: u32, light: Light) -> Result<()> {
        let moving = self.moving()?;
        let Some(&old) = moving.scene.lights.get(index as usize) else {
            let count = moving.scene.lights.len();
            return Err(Error::Scene(format!("light {index} does not exist, there are {count}")));
        };
        if matches!(old, Light::Sphere { .. }) || matches!(light, Light::Sphere { .. }) {
            let message = "sphere lights change with their object and its material";
            return Err(Error::Scene(format!("light {index}: {message}")));
        }
        light.check().map_err(|message| Error::Scene(format!("light {index}: {message}")))?;
        if light == old {
            return Ok(());
        }
        moving.scene.lights[index as usize] = light;
        if let Err(error) = check_light(&moving.scene, true) {
            moving.scene.lights[index as usize] = old;
            return Err(error);
        }
        moving.pending.lights = true;
        self.changed();
        Ok(())
    }

    /// Uploads the whole scene again with the next pass: for a host that has not submitted the first pass after a change.
    pub fn upload_again(&mut self) {
        if let Some(moving) = &mut self.dynamic {
            moving.pending.everything = true;
        }
        self.particles = true;
        self.restart();
    }

    /// Costs of the latest applied edits; zeros if there were none.
    pub fn edit_times(&self) -> EditTimes {
        self.dynamic.as_ref().map_or(EditTimes::default(), |moving| moving.times)
    }

    /// Updates hierarchy, emitters and passes for the edits, and stages the uploads. [`Engine::record_pass`] does this
    /// itself.
    pub fn apply_edits(&mut self) -> Result<()> {
        self.apply_scene_edits()?;
        self.stage_shutter()
    }

    fn apply_scene_edits(&mut self) -> Result<()> {
        let Some(mut moving) = self.dynamic.take() else { return Ok(()) };
        let result = if moving.pending.is_empty() { Ok(()) } else { self.apply(&mut moving) };
        if result.is_err() {
            // Some of the data may be staged, some not.
            moving.pending.everything = true;
        }
        self.dynamic = Some(moving);
        result
    }

    fn apply(&mut self, moving: &mut DynamicScene) -> Result<()> {
        let mut touched = std::mem::take(&mut moving.pending);
        touched.moved.sort_unstable();
        touched.moved.dedup();
        let (scene, of_objects) = (&moving.scene, &moving.materials);
        let emits = |object: u32| {
            let mut materials = of_objects[object as usize].iter().map(|&m| &scene.materials[m as usize]);
            materials.any(|m| m.emission.max_element() > 0.0)
        };

        let mut staging = self.take_staging();
        let bytes = staging.bytes();
        let of_host = (scene, &mut moving.trees);
        let updated = self.scene.update(&self.context, &mut staging, of_host, &touched, emits, &moving.averages);
        let start = Instant::now();
        let result = updated.and_then(|update| {
            let plan = plan::derive(&self.scene, &self.plan.asked, &self.plan.view)?;
            if update.replaced || !plan.fits_frame_of(&self.plan) {
                let kept = Some(self.kept());
                let frame = make_frame(&self.context, &mut staging, &mut self.scene, &plan, kept)?;
                self.take_frame(frame);
            } else if update.delta {
                self.frame.stage_delta(&self.context, &mut staging, &self.scene)?;
            }
            Ok((update, plan))
        });
        let bytes = staging.bytes() - bytes;
        self.keep_staging(staging);
        let (update, plan) = result?;
        self.plan = plan;
        self.particles = true;
        // Triangles may have another order.
        self.shutter.staged = false;
        moving.times = EditTimes {
            vertices: std::mem::take(&mut moving.vertex_seconds),
            refit: update.changes.refit_seconds,
            top_level: update.changes.top_seconds,
            lights: update.light_seconds,
            staging: update.staging_seconds + start.elapsed().as_secs_f64(),
            bytes,
        };
        Ok(())
    }

    pub(super) fn moving(&mut self) -> Result<&mut DynamicScene> {
        self.dynamic.as_deref_mut().ok_or_else(still)
    }
}

pub(super) fn still() -> Error {
    Error::Resource {
        name: String::from("engine"),
        message: String::from("its scene cannot change; make the engine by Engine::new_dynamic"),
    }
}

pub(super) fn refused(object: &str, message: &str) -> Error {
    Error::Scene(format!("object {object:?}: {message}"))
}

/// Checks that a scene still emits light, after an edit that may have removed the last emitter.
fn check_light(scene: &Scene, changed: bool) -> Result<()> {
    if changed { Emitters::of(scene, scene.emitters_are_lights).map(|_| ()) } else { Ok(()) }
}

/// A scene before the transforms of its objects.
pub(super) struct Rest {
    /// Vertices of each object.
    pub(super) vertices: Vec<Range<usize>>,
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) lights: Vec<Light>,
    pub(super) transforms: Vec<Affine3A>,
}

impl DynamicScene {
    /// A scene with nothing to upload.
    pub(super) fn new(scene: Scene, rest: Rest, trees: ObjectTrees) -> DynamicScene {
        let mut triangles = vec![Vec::new(); scene.objects.len()];
        (0..).zip(&scene.triangles).for_each(|(i, t)| triangles[t.object as usize].push(i));
        DynamicScene {
            triangles,
            rest_lights: rest.lights,
            rest_positions: rest.positions,
            rest_normals: rest.normals,
            transforms: rest.transforms,
            materials: materials_of(&scene),
            averages: scene.textures.iter().map(Texture::average).collect(),
            scene,
            vertices: rest.vertices,
            trees,
            pending: SceneChanges::default(),
            vertex_seconds: 0.0,
            times: EditTimes::default(),
        }
    }

    /// A copy of the scene before its transforms.
    pub(super) fn rest(&self) -> Rest {
        Rest {
            vertices: self.vertices.clone(),
            positions: self.rest_positions.clone(),
            normals: self.rest_normals.clone(),
            lights: self.rest_lights.clone(),
            transforms: self.transforms.clone(),
        }
    }

    /// Adds a material, which no triangle has yet.
    pub(super) fn add_material(&mut self, material: Material) -> u32 {
        self.pending.everything = true;
        self.scene.add_material(material)
    }

    /// Name of an object with triangles.
    pub(super) fn name(&self, object: u32) -> Result<String> {
        let Some(name) = self.scene.objects.get(object as usize) else {
            let count = self.scene.objects.len();
            return Err(Error::Scene(format!("object {object} does not exist, there are {count}")));
        };
        if self.vertices[object as usize].is_empty() {
            return Err(refused(name, "it has no triangles"));
        }
        Ok(name.clone())
    }

    /// The sphere light whose surface an object is.
    pub(super) fn sphere(&self, object: u32) -> Option<usize> {
        let surface = |light: &Light| matches!(light, Light::Sphere { object: o, .. } if *o == object);
        self.scene.lights.iter().position(surface)
    }

    /// Moves an object's vertices, or new ones, by a transform.
    fn place(&mut self, object: u32, transform: Affine3A, rest: Option<(&[Vec3], Vec<Vec3>)>) -> Result<()> {
        let start = Instant::now();
        let name = self.name(object)?;
        let range = self.vertices[object as usize].clone();
        let rest_positions = rest.as_ref().map_or(&self.rest_positions[range.clone()], |rest| rest.0);
        let reshaped = rest.is_some();
        let still = transform == Affine3A::IDENTITY;
        let positions: Vec<Vec3> = if still {
            rest_positions.to_vec()
        } else {
            rest_positions.iter().map(|&p| transform.transform_point3(p)).collect()
        };
        positions.iter().try_for_each(|&p| place("a vertex at", p)).map_err(|why| refused(&name, &why))?;
        let (mut smooth, first) = (false, range.start);
        for &k in &self.triangles[object as usize] {
            let triangle = &self.scene.triangles[k as usize];
            smooth |= triangle.smooth;
            if !is_degenerate(triangle.vertices.map(|v| positions[v as usize - first])) {
                continue;
            }
            let emits = self.scene.materials[triangle.material as usize].emission.max_element() > 0.0;
            if emits || !reshaped && !is_degenerate(triangle.vertices.map(|v| rest_positions[v as usize - first])) {
                return Err(refused(&name, &format!("triangle {k} of the scene would have no area")));
            }
        }
        if let Some(index) = self.sphere(object)
            && let Light::Sphere { center, radius, radiance, inward, object } = self.rest_lights[index]
        {
            let Some(scale) = similarity(&transform.matrix3) else {
                let message = "it is the surface of a sphere light, and its transform would make it no sphere";
                return Err(refused(&name, message));
            };
            let (center, radius) =
                if still { (center, radius) } else { (transform.transform_point3(center), radius * scale) };
            self.scene.lights[index] = Light::Sphere { center, radius, radiance, inward, object };
        }
        if let Some((positions, normals)) = rest {
            self.rest_positions[range.clone()].copy_from_slice(positions);
            self.rest_normals[range.clone()].copy_from_slice(&normals);
        }
        self.scene.positions[range.clone()].copy_from_slice(&positions);
        if still {
            self.scene.normals[range.clone()].copy_from_slice(&self.rest_normals[range]);
        } else if smooth {
            let outward = outward_matrix(&transform.matrix3);
            for (normal, rest) in self.scene.normals[range.clone()].iter_mut().zip(&self.rest_normals[range]) {
                *normal = (outward * *rest).normalize_or(*rest);
            }
        }
        if mirrors(&transform) != mirrors(&self.transforms[object as usize]) {
            self.triangles[object as usize].iter().for_each(|&k| self.scene.triangles[k as usize].vertices.swap(1, 2));
            // Attributes of corners change their places.
            self.pending.everything = true;
        }
        self.transforms[object as usize] = transform;
        self.pending.moved.push(object);
        self.vertex_seconds += start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Unit normals of an object's vertices: the area-weighted mean of the faces around each.
    fn mean_normals(&self, object: u32, positions: &[Vec3]) -> Vec<Vec3> {
        let first = self.vertices[object as usize].start;
        // Of a mirrored object the corners run the other way.
        let side = if mirrors(&self.transforms[object as usize]) { -1.0 } else { 1.0 };
        let mut sums = vec![Vec3::ZERO; positions.len()];
        for &k in &self.triangles[object as usize] {
            let corners = self.scene.triangles[k as usize].vertices.map(|v| v as usize - first);
            let [a, b, c] = corners.map(|v| positions[v]);
            let twice_area = (b - a).cross(c - a) * side;
            corners.iter().for_each(|&v| sums[v] += twice_area);
        }
        sums.into_iter().map(|sum| sum.normalize_or(Vec3::Y)).collect()
    }

    /// Gives sphere lights the emission of the material of their surface.
    fn match_sphere_lights(&mut self, material: u32) {
        let emission = self.scene.materials[material as usize].emission;
        for light in self.scene.lights.iter_mut().chain(&mut self.rest_lights) {
            if let Light::Sphere { object, radiance, .. } = light
                && self.materials[*object as usize].contains(&material)
            {
                *radiance = emission;
            }
        }
    }
}

/// The materials of each object of a scene.
fn materials_of(scene: &Scene) -> Vec<Vec<u32>> {
    let mut materials = vec![Vec::new(); scene.objects.len()];
    for triangle in &scene.triangles {
        let of_object: &mut Vec<u32> = &mut materials[triangle.object as usize];
        if !of_object.contains(&triangle.material) {
            of_object.push(triangle.material);
        }
    }
    materials
}
