//! Curved reflectors: connected faces of one glossy material that are shaded as a curved surface (Bastos 1999, section 8.1.1).

use std::collections::HashMap;

use glam::Vec3;

use super::reflectors::{Reflector, SAME_NORMAL};
use super::surfaces::{corner, root};
use super::{Material, Scene, Surface};

/// Least cosine between the shading normals of two faces at a common corner that belong to one surface.
const SAME_SHADING: f32 = 0.9999;

/// Different normals at a corner that one is compared with.
const MAX_NORMALS: usize = 16;

/// A corner of smooth faces: material, and bits of the position.
type Corner = (u32, [u32; 3]);

impl Material {
    /// Whether curved faces of this material are curved reflectors: on request only, see docs/superposition.md.
    pub fn may_curve(&self) -> bool {
        self.reflector == Some(true) && self.surface == Surface::Opaque && self.may_reflect()
    }
}

impl Scene {
    /// The curved reflectors, largest first. Faces are connected where they share a corner and its shading normal; a surface is curved if its
    /// normals differ, however little over one face, and flat parts of it belong to it.
    pub(super) fn curved_reflectors(&self) -> Vec<Reflector> {
        let candidates: Vec<bool> = self.materials.iter().map(Material::may_curve).collect();
        if !candidates.contains(&true) {
            return Vec::new();
        }
        let members: Vec<u32> = (0u32..)
            .zip(&self.triangles)
            .filter(|(_, t)| t.smooth && candidates[t.material as usize])
            .map(|(i, _)| i)
            .collect();
        let mut parents: Vec<u32> = (0..members.len() as u32).collect();
        let mut at_corner: HashMap<Corner, Vec<(Vec3, u32)>> = HashMap::new();
        for (member, &i) in (0u32..).zip(&members) {
            let t = &self.triangles[i as usize];
            for (&v, position) in t.vertices.iter().zip(self.triangle_positions(i as usize)) {
                let normal = self.normals[v as usize];
                let met = at_corner.entry((t.material, corner(position))).or_default();
                match met.iter().find(|(other, _)| other.dot(normal) >= SAME_SHADING) {
                    Some(&(_, other)) => {
                        let [one, another] = [root(&mut parents, member), root(&mut parents, other)];
                        parents[one.max(another) as usize] = one.min(another);
                    }
                    None if met.len() < MAX_NORMALS => met.push((normal, member)),
                    None => {}
                }
            }
        }

        let mut parts: HashMap<u32, Vec<u32>> = HashMap::new();
        for (member, &i) in (0u32..).zip(&members) {
            parts.entry(root(&mut parents, member)).or_default().push(i);
        }
        let reflector = |triangles: Vec<u32>| {
            let area: f64 = triangles.iter().map(|&i| f64::from(self.triangle_area(i as usize))).sum();
            Reflector {
                material: self.triangles[triangles[0] as usize].material,
                pane: false,
                curved: true,
                normal: Vec3::ZERO,
                offset: 0.0,
                area: area as f32,
                triangles,
            }
        };
        let corners = |i: &u32| self.triangles[*i as usize].vertices.map(|v| self.normals[v as usize]);
        let is_curved = |triangles: &Vec<u32>| {
            let [first, ..] = corners(&triangles[0]);
            triangles.iter().flat_map(corners).any(|normal| normal.dot(first) < 1.0 - SAME_NORMAL)
        };
        let mut found: Vec<Reflector> = parts.into_values().filter(is_curved).map(reflector).collect();
        found.sort_by(|a, b| b.area.total_cmp(&a.area).then(a.triangles.cmp(&b.triangles)));
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Triangle;
    use crate::scene::tessellate::icosphere;

    /// A smooth ball of 20 * 4^level faces in the first object.
    fn add_ball(scene: &mut Scene, center: Vec3, radius: f32, material: u32, level: u32) {
        let (points, faces) = icosphere(level);
        let placed: Vec<Vec3> = points.iter().map(|p| *p * radius + center).collect();
        let (vertex, triangle) = (scene.positions.len(), scene.triangles.len());
        scene.add_mesh(&placed, &faces, material, 0);
        scene.normals[vertex..].copy_from_slice(&points);
        scene.triangles[triangle..].iter_mut().for_each(|t| t.smooth = true);
    }

    /// Two balls of one glossy material, one of another, and a floor.
    fn balls(reflector: Option<bool>) -> Scene {
        let mut scene = Scene::default();
        let glossy = Material { specular: Vec3::splat(0.3), roughness: 0.2, reflector, ..Material::default() };
        let (shiny, other) = (scene.add_material(glossy), scene.add_material(Material::default()));
        let object = scene.add_object("balls");
        for (x, radius, material) in [(0.0, 1.0, shiny), (3.0, 0.5, shiny), (6.0, 2.0, other)] {
            add_ball(&mut scene, Vec3::X * x, radius, material, 2);
        }
        scene.add_quad(Vec3::NEG_Y, Vec3::Z, Vec3::X, shiny, object);
        scene
    }

    #[test]
    fn finely_divided_surfaces_are_curved_as_well() {
        let mut scene = balls(Some(true));
        add_ball(&mut scene, Vec3::Z * 5.0, 1.0, 0, 6);
        let found = scene.reflectors();
        let kinds: Vec<(bool, usize)> = found.iter().map(|r| (r.curved, r.triangles.len())).collect();
        assert_eq!(kinds, [(false, 2), (true, 20 << 12), (true, 320), (true, 320)]);
    }

    #[test]
    fn connected_smooth_faces_are_one_reflector_where_asked_for() {
        let found = balls(Some(true)).reflectors();
        let curved: Vec<bool> = found.iter().map(|r| r.curved).collect();
        assert_eq!(curved, [false, true, true], "planes come first");
        assert_eq!(found[1].triangles.len(), 320);
        assert!(found[1].area > 3.9 * found[2].area && found[1].material == 0);
        for asked in [None, Some(false)] {
            assert!(balls(asked).reflectors().iter().all(|r| !r.curved));
        }
    }

    #[test]
    fn creases_divide_and_flat_parts_of_a_curved_surface_belong_to_it() {
        // A strip of three quads: the first two bend smoothly into each other, the third is apart by a crease.
        let mut scene = balls(Some(true));
        scene.triangles.clear();
        let (first, object) = (scene.positions.len() as u32, 0);
        let across = Vec3::Z;
        let profile = [Vec3::ZERO, Vec3::X, Vec3::new(2.0, 0.0, 0.0), Vec3::new(3.0, -0.3, 0.0)];
        for p in profile {
            scene.positions.extend([p, p + across]);
            scene.normals.extend([Vec3::Y; 2]);
        }
        let tilted = Vec3::new(0.3, 1.0, 0.0).normalize();
        scene.normals[first as usize + 6] = tilted;
        scene.normals[first as usize + 7] = tilted;
        for i in [0, 2, 4] {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| first + i + k);
            for vertices in [[a, b, c], [b, d, c]] {
                scene.triangles.push(Triangle { vertices, material: 0, object, smooth: true });
            }
        }
        let found = scene.reflectors();
        assert_eq!((found.len(), found[0].curved, found[0].triangles.len()), (1, true, 6));
        // With normals of their own at the common edge the first two quads are a plane again.
        let own = scene.positions.len() as u32;
        for v in [first + 4, first + 5] {
            scene.positions.push(scene.positions[v as usize]);
            scene.normals.push(tilted);
        }
        for t in &mut scene.triangles[4..] {
            t.vertices = t.vertices.map(|v| if v == first + 4 || v == first + 5 { own + v - first - 4 } else { v });
        }
        scene.normals[first as usize + 6] = Vec3::new(0.5, 1.0, 0.0).normalize();
        let found = scene.reflectors();
        let kinds: Vec<(bool, usize)> = found.iter().map(|r| (r.curved, r.triangles.len())).collect();
        assert_eq!(kinds, [(false, 4), (true, 2)]);
    }
}
