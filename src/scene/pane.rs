//! Tells thin panes from bodies of glass in model formats without that distinction.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::{Scene, Surface};

/// The area vectors of a closed surface cancel, those of a sheet add up; vessels without thickness are in between.
const OPEN: f64 = 0.05;

impl Scene {
    /// Makes glass thin if most of its area is in sheets: connected triangles (by position) whose area vectors do not
    /// cancel. Tolerates small cracks in a body.
    pub(super) fn find_panes(&mut self) {
        for material in 0..self.materials.len() {
            let m = &self.materials[material];
            if m.surface != Surface::Glass || m.thin {
                continue;
            }
            let [open, all] = self.open_area(material as u32);
            if open > 0.5 * all {
                let m = &mut self.materials[material];
                log::info!("the surfaces of glass {:?} enclose nothing: they are panes that bend no light", m.name);
                m.thin = true;
            }
        }
    }

    /// Area of a material's triangles in sheets, and in all.
    fn open_area(&self, material: u32) -> [f64; 2] {
        let triangles = || (0..self.triangles.len()).filter(|&i| self.triangles[i].material == material);
        let mut corners: HashMap<[u32; 3], usize> = HashMap::new();
        let mut parents: Vec<usize> = Vec::new();
        let mut first_corner = Vec::new();
        for i in triangles() {
            let places = self.triangle_positions(i).map(|p| {
                *corners.entry(key(p)).or_insert_with(|| {
                    parents.push(parents.len());
                    parents.len() - 1
                })
            });
            let root = find(&mut parents, places[0]);
            for &place in &places[1..] {
                let other = find(&mut parents, place);
                parents[other] = root;
            }
            first_corner.push(places[0]);
        }
        // Area vector and area of each sheet or body, by its root.
        let mut parts: HashMap<usize, (DVec3, f64)> = HashMap::new();
        for (i, corner) in triangles().zip(first_corner) {
            let [a, b, c] = self.triangle_positions(i).map(|p| p.as_dvec3());
            let area = 0.5 * (b - a).cross(c - a);
            let (sum, total) = parts.entry(find(&mut parents, corner)).or_default();
            *sum += area;
            *total += area.length();
        }
        let open = parts.values().filter(|(sum, total)| sum.length() > OPEN * total).map(|(_, total)| total);
        [open.sum(), parts.values().map(|(_, total)| total).sum()]
    }
}

/// Corners at the same place are one; 0 and -0 are the same place.
fn key(p: Vec3) -> [u32; 3] {
    (p + 0.0).to_array().map(f32::to_bits)
}

/// The root of a corner's set.
fn find(parents: &mut [usize], mut i: usize) -> usize {
    while parents[i] != i {
        parents[i] = parents[parents[i]];
        i = parents[i];
    }
    i
}

#[cfg(test)]
mod tests {
    use super::super::Material;
    use super::super::tessellate::icosphere;
    use super::*;

    fn thin(build: impl FnOnce(&mut Scene, u32)) -> bool {
        let mut scene = Scene::default();
        let glass = scene.add_material(Material { surface: Surface::Glass, ..Material::default() });
        build(&mut scene, glass);
        scene.find_panes();
        scene.materials[0].thin
    }

    #[test]
    fn sheets_are_panes_and_bodies_are_not() {
        assert!(thin(|s, m| s.add_quad(Vec3::ZERO, Vec3::X, Vec3::Y, m, 0)));
        assert!(!thin(|s, m| s.add_box(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.01), false, m, 0)));
        let (points, faces) = icosphere(2);
        assert!(!thin(|s, m| s.add_mesh(&points, &faces, m, 0)));
        // A crack does not make a pane of a ball; a hemisphere is one.
        assert!(!thin(|s, m| s.add_mesh(&points, &faces[1..], m, 0)));
        let dome: Vec<[u32; 3]> =
            faces.iter().copied().filter(|f| f.iter().all(|&v| points[v as usize].y > -0.1)).collect();
        assert!(thin(|s, m| s.add_mesh(&points, &dome, m, 0)));
        // Windows on opposite walls: their areas cancel only together.
        assert!(thin(|s, m| {
            s.add_quad(Vec3::ZERO, Vec3::X, Vec3::Y, m, 0);
            s.add_quad(Vec3::Z, Vec3::Y, Vec3::X, m, 0);
        }));
        // A ball and a small sheet of one material: bodies prevail.
        assert!(!thin(|s, m| {
            s.add_mesh(&points, &faces, m, 0);
            s.add_quad(Vec3::Z * 5.0, Vec3::X, Vec3::Y, m, 0);
        }));
    }
}
