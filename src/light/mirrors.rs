//! Planar mirrors, for mirrored lights (Keller 1997, 4.2).

use glam::Vec3;
use std::f32::consts::PI;

use crate::accel::Bvh;
use crate::pass::layout::MirrorRecord;
use crate::scene::{Material, Scene, Surface};

/// Maximum number of mirrors; the largest by area are kept.
pub const MAX_MIRRORS: usize = 64;

/// Minimum share of the disc around a mirror that it covers, that of a strip 12 times as long as wide. Of thinner ones and of frames
/// few points see a light, which then is a bright spot, and most rays are lost; photons bring their light.
pub const MIN_COVERED: f32 = 0.1;

/// The planar mirrors of a scene.
#[derive(Clone, Debug, Default)]
pub struct Mirrors {
    /// The mirrors, the largest first.
    pub list: Vec<MirrorRecord>,
    /// Mirror of each triangle of the tree, as index + 1, or 0.
    pub of_triangle: Vec<u32>,
}

impl Mirrors {
    /// Collects the scene's ideal planar reflectors, without strips and frames ([`MIN_COVERED`]).
    pub fn of(scene: &Scene, bvh: &Bvh) -> Mirrors {
        let ideal = |m: &Material| m.surface == Surface::Mirror;
        if !scene.materials.iter().any(ideal) {
            return Mirrors::default();
        }
        let mut mirrors = Mirrors::default();
        let mut of_scene = vec![0; scene.triangles.len()];
        let planes = scene.reflectors().into_iter().filter(|r| ideal(&scene.materials[r.material as usize]));
        for plane in planes {
            if mirrors.list.len() == MAX_MIRRORS {
                break;
            }
            let corners = |&t: &u32| scene.triangle_positions(t as usize);
            let third = |t: &u32| corners(t).iter().sum::<Vec3>() * (scene.triangle_area(*t as usize) / 3.0);
            let middle = plane.triangles.iter().map(third).sum::<Vec3>() / plane.area;
            let to_corners = plane.triangles.iter().flat_map(corners).map(|p| p.distance(middle));
            let radius = to_corners.fold(0.0, f32::max);
            if plane.area < MIN_COVERED * PI * radius * radius {
                continue;
            }
            let m = &scene.materials[plane.material as usize];
            let ideal = m.specular.lerp(m.base_color, m.metallic);
            mirrors.list.push(MirrorRecord {
                plane: plane.normal.extend(plane.offset).to_array(),
                middle: middle.extend(plane.area).to_array(),
                ideal: ideal.extend(radius).to_array(),
            });
            let number = mirrors.list.len() as u32;
            plane.triangles.iter().for_each(|&t| of_scene[t as usize] = number);
        }
        if !mirrors.list.is_empty() {
            mirrors.of_triangle = (0..bvh.triangle_count()).map(|t| of_scene[bvh.scene_triangle(t) as usize]).collect();
        }
        mirrors
    }
}
