//! Objects that come and go: the trees of all objects are built anew, pipelines, film and images stay.

use glam::{Affine3A, Vec2, Vec3};

use super::edit::{DynamicScene, Rest, refused};
use super::{Engine, make_frame};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::pass::TraversalKernels;
use crate::plan;
use crate::scene::{Material, Mesh, Scene};

impl Engine {
    /// Adds a material to a scene that may change, and returns its index. One that reflects more than it receives is scaled down.
    ///
    /// Errors, which leave everything unchanged: a value out of range, a texture that does not exist; the scene is static.
    pub fn add_material(&mut self, material: Material) -> Result<u32> {
        let moving = self.moving()?;
        let material = moving.scene.checked_material(material)?;
        let index = moving.add_material(material);
        self.changed();
        Ok(index)
    }

    /// Adds an object of one material to a scene that may change, and returns its index; `transform` may be changed by
    /// [`Engine::set_transform`]. Its vertices are those of the mesh, in the same order ([`Engine::set_vertices`]).
    ///
    /// Cost: trees of all objects and a copy of the scene, at once; everything is uploaded with the next pass.
    ///
    /// Errors, which leave everything unchanged and name the object: as [`crate::scene::SceneBuilder::object`]; the scene is static, or
    /// would be too large.
    pub fn add_object(&mut self, name: &str, mesh: &Mesh, material: u32, transform: Affine3A) -> Result<u32> {
        let moving = self.moving()?;
        let (mut scene, mut rest) = (moving.scene.clone(), moving.rest());
        let first = scene.positions.len();
        let object = scene.append(name, mesh, material, transform)?;
        rest.vertices.push(first..scene.positions.len());
        rest.positions.extend_from_slice(&mesh.positions);
        rest.normals.extend_from_slice(&mesh.normals);
        rest.normals.resize(rest.positions.len(), Vec3::Y);
        rest.transforms.push(transform);
        self.replace_scene(scene, rest)?;
        Ok(object)
    }

    /// Removes the triangles of an object from a scene that may change. The indices of other objects stay; that of this one remains
    /// without triangles. Cost: as [`Engine::add_object`].
    ///
    /// Errors, which leave everything unchanged: there is no such object; it is the surface of a sphere light; nothing would emit light,
    /// or nothing would be left; the scene is static.
    pub fn remove_object(&mut self, object: u32) -> Result<()> {
        let moving = self.moving()?;
        let name = moving.name(object)?;
        if moving.sphere(object).is_some() {
            return Err(refused(&name, "it is the surface of a sphere light, which stays; move it away"));
        }
        let (mut scene, mut rest) = (moving.scene.clone(), moving.rest());
        scene.triangles.retain(|triangle| triangle.object != object);
        if scene.triangles.is_empty() {
            return Err(refused(&name, "no other object has triangles; a scene has some"));
        }
        let range = rest.vertices[object as usize].clone();
        let (start, count) = (range.start, range.len());
        for triangle in &mut scene.triangles {
            triangle.vertices = triangle.vertices.map(|v| if v as usize >= range.end { v - count as u32 } else { v });
        }
        for vertices in &mut rest.vertices {
            if vertices.start >= range.end {
                *vertices = vertices.start - count..vertices.end - count;
            }
        }
        rest.vertices[object as usize] = start..start;
        remove_vertices(&mut scene, start, count);
        for array in [&mut rest.positions, &mut rest.normals] {
            array.drain(start..start + count);
        }
        // They name vertices by index.
        scene.animations = None;
        self.replace_scene(scene, rest)
    }

    /// Goes on with another scene that may change.
    fn replace_scene(&mut self, scene: Scene, rest: Rest) -> Result<()> {
        let clusters = TraversalKernels::shade(&self.context, self.plan.asked.traversal, false)?.cluster.is_some();
        let kept = self.kept();
        let mut staging = self.take_staging();
        let made =
            DeviceScene::new_dynamic(&self.context, &mut staging, &scene, clusters).and_then(|(mut made, trees)| {
                if let Some(splats) = &self.plan.asked.splats {
                    made.make_surfaces(&self.context, &mut staging, &scene, splats.alpha)?;
                }
                let plan = plan::derive(&made, &self.plan.asked, &self.plan.view)?;
                let frame = make_frame(&self.context, &mut staging, &mut made, &plan, Some(kept))?;
                Ok((made, trees, plan, frame))
            });
        self.keep_staging(staging);
        let (made, trees, plan, frame) = made?;
        (self.scene, self.plan) = (made, plan);
        self.take_frame(frame);
        self.dynamic = Some(Box::new(DynamicScene::new(scene, rest, trees)));
        self.changed();
        Ok(())
    }
}

/// Removes vertices that no triangle has.
fn remove_vertices(scene: &mut Scene, start: usize, count: usize) {
    fn drain<T>(array: &mut Vec<T>, start: usize, count: usize) {
        if !array.is_empty() {
            array.drain(start..start + count);
        }
    }
    for array in [&mut scene.positions, &mut scene.normals, &mut scene.colors] {
        drain::<Vec3>(array, start, count);
    }
    for array in [&mut scene.uvs, &mut scene.second_uvs, &mut scene.lightmap_uvs] {
        drain::<Vec2>(array, start, count);
    }
}
