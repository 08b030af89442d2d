//! Planar reflectors: coplanar triangles of one mirror or glossy material (Bastos 1999, section 6.3). Frosted panes, which blur
//! the image behind them, and curved reflectors are found and numbered with them.

use std::collections::HashMap;

use glam::{IVec3, Vec3};

use super::{Material, Scene, Surface, Triangle};
use crate::bsdf::ideal::frost;

/// Maximum number of reflectors of a scene; the largest planes are kept, then the largest curved ones.
pub const MAX_REFLECTORS: usize = 255;

/// Maximum alpha of a reflector's lobe: rougher planes show no images, and highlights of point lights suffice.
const MAX_ALPHA: f32 = 0.3;

/// Minimum part of the light that a table of a lobe reflects to where a mirror image shows it.
const MIN_IMAGE_SHARE: f32 = 0.8;

/// Minimum reflectance at normal incidence, mean of the channels.
const MIN_F0: f32 = 0.02;

/// Minimum area as a fraction of the area of all triangles.
const MIN_AREA: f64 = 2e-4;

/// The area of all triangles counts as no more than this multiple of the area of all flat reflectors.
const MAX_SHARE: f64 = 1e3;

/// Normals of one plane differ by no more than this in each coordinate.
pub(super) const SAME_NORMAL: f32 = 1e-3;

/// Distances of one plane from the origin differ by no more than this fraction of the diagonal of its faces' box.
const SAME_OFFSET: f32 = 1e-4;

/// Coplanar triangles of one mirror, glossy or frosted material, or a curved surface of a glossy one.
#[derive(Clone, Debug, PartialEq)]
pub struct Reflector {
    /// Index of the material.
    pub material: u32,
    /// Whether it is a frosted pane: it blurs the transmitted image, not the reflected one.
    pub pane: bool,
    /// Whether it is a curved surface; it has no normal then.
    pub curved: bool,
    /// Unit normal on the front side.
    pub normal: Vec3,
    /// The plane is `normal . p = offset`.
    pub offset: f32,
    /// Sum of the triangles' areas.
    pub area: f32,
    /// The triangles.
    pub triangles: Vec<u32>,
}

/// Faces of one material with one normal.
struct Parallel {
    material: u32,
    normal: Vec3,
    /// Offset of each along the normal, and its triangle.
    members: Vec<(f32, u32)>,
}

impl Material {
    /// Whether faces of this material may be reflectors, flat ones, and where asked for curved ones of opaque materials: on request, or for a mirror, a lobe narrow and strong
    /// enough to show images, or frosted glass of any roughness. Textures are ignored, only their factors count, but a
    /// face with a normal map is not flat. One that lets rays pass is none either.
    pub fn may_reflect(&self) -> bool {
        let f0 = self.specular.lerp(self.base_color, self.metallic).element_sum() / 3.0;
        let shows = match self.surface {
            Surface::Opaque => {
                let images = self.lobe.as_ref().is_none_or(|table| table.image_share() >= MIN_IMAGE_SHARE);
                f0 >= MIN_F0 && self.lobe_width() <= MAX_ALPHA && images
            }
            Surface::Mirror => true,
            Surface::Glass => {
                let wanted = self.reflector != Some(false) && !self.has_alpha();
                return frost(self).is_some() && wanted && self.base_color != Vec3::ZERO;
            }
        };
        self.reflector.unwrap_or(shows) && f0 > 0.0 && self.normal_texture.is_none() && !self.has_alpha()
    }
}

impl Scene {
    /// The reflectors: planes, the largest first, then curved surfaces, the largest first. The `reflector` property of a material overrides
    /// the minimum area; only where it is true, faces shaded as part of a curved surface count, as curved reflectors.
    pub fn reflectors(&self) -> Vec<Reflector> {
        let curved = self.curved_reflectors();
        let mut found = self.planar_reflectors(&curved);
        found.extend(curved);
        if found.len() > MAX_REFLECTORS {
            let more = found.len() - MAX_REFLECTORS;
            log::warn!("{more} reflectors beside the {MAX_REFLECTORS} greatest show no mirror images");
            found.truncate(MAX_REFLECTORS);
        }
        found
    }

    /// The planar reflectors, largest first, without faces of `curved` ones.
    fn planar_reflectors(&self, curved: &[Reflector]) -> Vec<Reflector> {
        let mut of_curved = vec![false; if curved.is_empty() { 0 } else { self.triangles.len() }];
        curved.iter().flat_map(|reflector| &reflector.triangles).for_each(|&i| of_curved[i as usize] = true);
        let candidates: Vec<bool> = self.materials.iter().map(Material::may_reflect).collect();
        let mut of_normal: HashMap<(u32, IVec3), usize> = HashMap::new();
        let mut parallel: Vec<Parallel> = Vec::new();
        for (i, t) in (0u32..).zip(&self.triangles) {
            if !candidates[t.material as usize] || of_curved.get(i as usize) == Some(&true) {
                continue;
            }
            let [a, b, c] = self.triangle_positions(i as usize);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            if self.is_bent(t, normal) {
                continue;
            }
            // Rounding may put equal normals into neighbouring cells: look in both.
            let cell = (normal / SAME_NORMAL).round().as_ivec3();
            let near = (0..27)
                .filter_map(|k| of_normal.get(&(t.material, cell + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1))))
                .copied()
                .find(|&group| (parallel[group].normal - normal).abs().max_element() <= SAME_NORMAL);
            let group = near.unwrap_or_else(|| {
                parallel.push(Parallel { material: t.material, normal, members: Vec::new() });
                of_normal.insert((t.material, cell), parallel.len() - 1);
                parallel.len() - 1
            });
            let middle = (a + b + c) / 3.0;
            let group = &mut parallel[group];
            group.members.push((group.normal.dot(middle), i));
        }
        if parallel.is_empty() {
            return Vec::new();
        }

        let total: f64 = (0..self.triangles.len()).map(|i| f64::from(self.triangle_area(i))).sum();
        let flat: f64 =
            parallel.iter().flat_map(|p| &p.members).map(|&(_, i)| f64::from(self.triangle_area(i as usize))).sum();
        // A ground plane as wide as the horizon must not make all others too small.
        let total = total.min(MAX_SHARE * flat);
        let mut found = Vec::new();
        for Parallel { material, normal, mut members } in parallel {
            members.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let corners = members.iter().flat_map(|&(_, i)| self.triangle_positions(i as usize));
            let (low, high) =
                corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
            let apart = SAME_OFFSET * (high - low).length();
            for plane in members.chunk_by(|a, b| b.0 - a.0 <= apart) {
                let triangles: Vec<u32> = plane.iter().map(|&(_, i)| i).collect();
                let area: f64 = triangles.iter().map(|&i| f64::from(self.triangle_area(i as usize))).sum();
                let asked_for = self.materials[material as usize].reflector == Some(true);
                if asked_for || area >= MIN_AREA * total {
                    let offset = plane[plane.len() / 2].0;
                    let pane = self.materials[material as usize].surface == Surface::Glass;
                    let area = area as f32;
                    found.push(Reflector { material, pane, curved: false, normal, offset, area, triangles });
                }
            }
        }
        found.sort_by(|a, b| b.area.total_cmp(&a.area).then(a.triangles.cmp(&b.triangles)));
        found
    }

    /// Whether a face is shaded as part of a curved surface.
    fn is_bent(&self, t: &Triangle, normal: Vec3) -> bool {
        let straight = |&v: &u32| self.normals[v as usize].dot(normal).abs() > 1.0 - SAME_NORMAL;
        t.smooth && !t.vertices.iter().all(straight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glossy(scene: &mut Scene) -> u32 {
        let specular = Vec3::splat(0.3);
        scene.add_material(Material { specular, roughness: 0.2, ..Material::default() })
    }

    /// A floor of `n` x `n` quads at a height, and a wall.
    fn room(n: u32, height: f32) -> Scene {
        let mut scene = Scene::default();
        let material = glossy(&mut scene);
        let object = scene.add_object("floor");
        for i in 0..n * n {
            let side = 4.0 / n as f32;
            let corner = Vec3::new((i % n) as f32 * side, height, (i / n) as f32 * side);
            scene.add_quad(corner, Vec3::Z * side, Vec3::X * side, material, object);
        }
        scene.add_quad(Vec3::ZERO, Vec3::X * 4.0, Vec3::Y * 3.0, material, object);
        scene
    }

    #[test]
    fn coplanar_faces_are_one_reflector() {
        let found = room(27, 0.3).reflectors();
        assert_eq!(found.len(), 2);
        assert_eq!(found[0].triangles.len(), 2 * 27 * 27);
        assert!((found[0].area - 16.0).abs() < 1e-3 && (found[0].offset - 0.3).abs() < 1e-6);
        assert!((found[0].normal - Vec3::Y).length() < 1e-6);
        assert_eq!(found[1].triangles.len(), 2);
    }

    #[test]
    fn planes_apart_and_other_materials_are_others() {
        let mut scene = room(1, 0.0);
        let (other, object) = (glossy(&mut scene), scene.add_object("table"));
        scene.add_quad(Vec3::new(1.0, 1.0, 1.0), Vec3::Z, Vec3::X, 0, object);
        scene.add_quad(Vec3::new(2.0, 0.0, 1.0), Vec3::Z, Vec3::X, other, object);
        let found = scene.reflectors();
        assert_eq!(found.len(), 4);
        assert_eq!(found.iter().filter(|r| r.material == other).count(), 1);
    }

    #[test]
    fn rough_curved_and_small_faces_are_none_unless_asked_for() {
        let mut scene = room(1, 0.0);
        scene.materials[0].roughness = 0.8;
        assert!(scene.reflectors().is_empty());
        scene.materials[0].reflector = Some(true);
        assert_eq!(scene.reflectors().len(), 2);
        scene.materials[0] = Material { surface: Surface::Mirror, ..Material::default() };
        scene.materials[0].metallic = 1.0;
        assert_eq!(scene.reflectors().len(), 2);
        scene.materials[0].reflector = Some(false);
        assert!(scene.reflectors().is_empty());

        let mut scene = room(1, 0.0);
        let object = scene.add_object("crumb");
        scene.add_quad(Vec3::ONE, Vec3::Z * 0.01, Vec3::X * 0.01, 0, object);
        assert_eq!(scene.reflectors().len(), 2);
        scene.materials[0].reflector = Some(true);
        assert_eq!(scene.reflectors().len(), 3);

        let mut scene = room(1, 0.0);
        scene.triangles.iter_mut().for_each(|t| t.smooth = true);
        scene.normals = vec![Vec3::ONE.normalize(); scene.positions.len()];
        assert!(scene.reflectors().is_empty());
    }

    #[test]
    fn frosted_panes_are_found_and_clear_ones_are_not() {
        let mut scene = room(1, 0.0);
        let pane = Material { surface: Surface::Glass, thin: true, ior: 1.5, ..Material::default() };
        let (clear, object) = (scene.add_material(pane.clone()), scene.add_object("window"));
        let frosted = scene.add_material(Material { frost: 0.4, ..pane.clone() });
        let body = scene.add_material(Material { frost: 0.4, thin: false, ..pane });
        for (i, material) in [clear, frosted, body].into_iter().enumerate() {
            scene.add_quad(Vec3::new(i as f32, 1.0, 1.0), Vec3::X, Vec3::Y, material, object);
        }
        let found = scene.reflectors();
        let panes: Vec<u32> = found.iter().filter(|r| r.pane).map(|r| r.material).collect();
        assert_eq!((found.len(), panes), (3, vec![frosted]));
        let alpha = frost(&scene.materials[frosted as usize]).unwrap();
        assert!((alpha - 0.0625).abs() < 1e-6, "{alpha}");
        scene.materials[frosted as usize].reflector = Some(false);
        assert_eq!(scene.reflectors().len(), 2);
        // Too smooth to tell from clear.
        (scene.materials[clear as usize].frost, scene.materials[frosted as usize].reflector) = (0.05, None);
        assert_eq!(scene.reflectors().len(), 3);
    }

    #[test]
    fn a_ball_has_none() {
        let mut scene = room(1, 0.0);
        let object = scene.add_object("ball");
        let (points, faces) = super::super::tessellate::icosphere(4);
        scene.add_mesh(&points, &faces, 0, object);
        assert_eq!(scene.reflectors().len(), 2);
    }
}
