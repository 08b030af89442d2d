//! The finished maps: the light of all batches on their pages, without texels inside geometry, filled beyond the charts.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;
use rayon::prelude::*;

use super::charts::Charts;
use super::sides::Sides;
use super::{Bake, Batch, outliers};
use crate::accel::{Bvh, Hit, Ray, offset_origin};
use crate::error::{Error, Result};
use crate::output::Layers;
use crate::pass::surface::surface_at;
use crate::sampling::hammersley::hammersley;
use crate::scene::{KeptFace, KeptLight, KeptPage, Scene};
use crate::view::Texel;

/// Rays of the test for being inside geometry.
const RAYS: u32 = 64;
/// Rings of texels that are filled beyond those with light.
const MIN_RINGS: u32 = 4;

/// A page of texels, row by row from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Page {
    /// Width and height.
    pub size: [u32; 2],
    /// Irradiance from the emitters, W/m^2.
    pub direct: Vec<Vec3>,
    /// Irradiance after one or more reflections, W/m^2.
    pub indirect: Vec<Vec3>,
    /// Diffuse albedo of the surface.
    pub albedo: Vec<Vec3>,
    /// Radiance that the surface emits.
    pub emission: Vec<Vec3>,
}

impl Page {
    pub(crate) fn new(size: [u32; 2]) -> Page {
        let black = vec![Vec3::ZERO; size[0] as usize * size[1] as usize];
        Page { size, direct: black.clone(), indirect: black.clone(), albedo: black.clone(), emission: black }
    }

    /// Radiance of diffuse light and emission: what a viewer without lights shows.
    pub fn radiance(&self, i: usize) -> Vec3 {
        self.emission[i] + FRAC_1_PI * self.albedo[i] * (self.direct[i] + self.indirect[i])
    }
}

/// Light of a scene on pages.
#[derive(Clone, Debug, PartialEq)]
pub struct Lightmap {
    /// Where each face lies.
    pub charts: Charts,
    /// The light.
    pub pages: Vec<Page>,
    /// Texels inside geometry, which are filled from their neighbours.
    pub inside: usize,
}

impl Bake {
    /// Puts the images of all batches, of this many passes, together; single texels far brighter than those around them have their indirect
    /// light spread. Errors: not an image of each batch.
    pub fn finish(&self, images: &[Layers], passes: u32) -> Result<Lightmap> {
        let fits = |(image, batch): (&Layers, &Batch)| image.indirect.len() == batch.places.len();
        if images.len() != self.batches.len() || !images.iter().zip(&self.batches).all(fits) {
            let message = String::from("there must be an image with all layers for each batch");
            return Err(Error::Resource { name: String::from("bake"), message });
        }
        let mut pages: Vec<Page> = self.charts.pages.iter().map(|&size| Page::new(size)).collect();
        let mut valid: Vec<Vec<bool>> = pages.iter().map(|page| vec![false; page.direct.len()]).collect();
        let bvh = &self.bvh;
        let leaves = bvh.leaf_numbers();
        for (batch, image) in self.batches.iter().zip(images) {
            let texel = |i: usize| {
                let (texel, place) = (batch.atlas.texels[i]?, batch.places[i]?);
                Some((i, place, surface(&self.scene, bvh, &leaves, &texel, 1.0 / self.charts.density)))
            };
            let found: Vec<_> = (0..batch.places.len()).into_par_iter().filter_map(texel).collect();
            for (i, (page, at), [albedo, emission]) in found {
                let (page, at) = (page as usize, at as usize);
                let of = &mut pages[page];
                (of.direct[at], of.indirect[at]) = (image.direct[i], image.indirect[i]);
                (of.albedo[at], of.emission[at]) = (albedo, emission);
                valid[page][at] = true;
            }
        }
        let rings = self.options.padding.max(MIN_RINGS);
        pages.par_iter_mut().zip(valid).for_each(|(page, valid)| {
            outliers::spread(&mut page.indirect, &valid, page.size[0], passes);
            fill(page, valid, rings);
        });
        Ok(Lightmap { charts: self.charts.clone(), pages, inside: self.within })
    }
}

impl Lightmap {
    /// Light that a renderer shows in place of virtual lights: see [`Scene::kept_light`].
    pub fn kept(&self, scene: &Scene) -> KeptLight {
        let mut faces = vec![[None; 2]; scene.triangles.len()];
        for face in &self.charts.faces {
            faces[face.triangle as usize][usize::from(face.back)] =
                Some(KeptFace { page: face.page, corners: face.corners });
        }
        let page =
            |page: &Page| KeptPage { size: page.size, direct: page.direct.clone(), indirect: page.indirect.clone() };
        KeptLight { faces, pages: self.pages.iter().map(page).collect() }
    }
}

/// Test of texels for being inside of geometry.
pub(crate) struct Inside<'a> {
    /// The lit sides.
    pub sides: &'a [Sides],
    /// The tree of the scene.
    pub bvh: &'a Bvh,
    /// [`Bvh::leaf_numbers`].
    pub leaves: &'a [u32],
}

impl Inside<'_> {
    /// Position and normal of a texel.
    pub fn place(&self, texel: &Texel) -> (Vec3, Vec3) {
        let (hit, normal) = at(self.bvh, self.leaves, texel);
        (self.bvh.position(&hit), normal)
    }

    /// Whether a texel sees nothing but sides without light: it lies inside a body, or below what stands on its surface.
    pub fn holds(&self, texel: &Texel) -> bool {
        let dark = |Seen { triangle, back, .. }| !self.sides[triangle as usize].has(back);
        seen(self.bvh, self.leaves, texel, RAYS).all(|side| side.is_some_and(dark))
    }
}

/// The side that a ray from a texel meets first.
pub(crate) struct Seen {
    /// Index of the triangle in the scene.
    pub triangle: u32,
    /// Whether it is the back.
    pub back: bool,
    /// The middle of the ray.
    pub middle: Vec3,
}

/// The sides that rays from a texel meet first; `None`: the ray leaves the scene. The density of the rays goes by the cosine.
pub(crate) fn seen(bvh: &Bvh, leaves: &[u32], texel: &Texel, rays: u32) -> impl Iterator<Item = Option<Seen>> {
    let (origin, normal) = origin(bvh, leaves, texel);
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    (0..rays).map(move |i| {
        let [u, v] = hammersley(i, rays);
        let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
        let direction = (tangent * cos + bitangent * sin) * u.sqrt() + normal * (1.0 - u).sqrt();
        let hit = bvh.closest(&Ray::new(origin, direction))?;
        let back = bvh.normal(hit.triangle).dot(direction) > 0.0;
        Some(Seen { triangle: bvh.scene_triangle(hit.triangle), back, middle: origin + 0.5 * hit.t * direction })
    })
}

/// The middles of rays from a texel along its side, of those that meet something: a thin gap lies open to its rim alone.
pub(crate) fn beside(bvh: &Bvh, leaves: &[u32], texel: &Texel, rays: u32) -> impl Iterator<Item = Vec3> {
    let (origin, normal) = origin(bvh, leaves, texel);
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    (0..rays).filter_map(move |i| {
        let (sin, cos) = (std::f32::consts::TAU * (i as f32 + 0.5) / rays as f32).sin_cos();
        let direction = tangent * cos + bitangent * sin;
        let hit = bvh.closest(&Ray::new(origin, direction))?;
        Some(origin + 0.5 * hit.t * direction)
    })
}

/// The point of a texel, off its side as far as rays that start there, and the normal of the side.
pub(crate) fn origin(bvh: &Bvh, leaves: &[u32], texel: &Texel) -> (Vec3, Vec3) {
    let (hit, normal) = at(bvh, leaves, texel);
    (offset_origin(bvh.position(&hit), normal, bvh.scale()), normal)
}

/// The point of a texel, and the normal of its side.
fn at(bvh: &Bvh, leaves: &[u32], texel: &Texel) -> (Hit, Vec3) {
    let hit = Hit { t: 1.0, u: texel.uv[0], v: texel.uv[1], triangle: leaves[texel.triangle as usize] };
    let front = bvh.normal(hit.triangle);
    (hit, if texel.back { -front } else { front })
}

/// Diffuse albedo and emission at a texel of this width.
pub(crate) fn surface(scene: &Scene, bvh: &Bvh, leaves: &[u32], texel: &Texel, width: f32) -> [Vec3; 2] {
    let (hit, normal) = at(bvh, leaves, texel);
    let point = surface_at(scene, bvh, &hit, -normal, width);
    [point.reflectance.kd, point.emission]
}

/// Gives texels without light the mean of their neighbours, ring by ring.
fn fill(page: &mut Page, mut valid: Vec<bool>, rings: u32) {
    let [width, height] = page.size.map(|n| n as i64);
    for _ in 0..rings {
        let neighbours = |i: usize| {
            let (x, y) = (i as i64 % width, i as i64 / width);
            let around = (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
            let inside = move |&(x, y): &(i64, i64)| x >= 0 && y >= 0 && x < width && y < height;
            around.filter(inside).map(move |(x, y)| (x + y * width) as usize)
        };
        let mean = |i: usize| {
            let near: Vec<usize> = neighbours(i).filter(|&j| valid[j]).collect();
            if valid[i] || near.is_empty() {
                return None;
            }
            let of = |values: &[Vec3]| near.iter().map(|&j| values[j]).sum::<Vec3>() / near.len() as f32;
            Some((i, [of(&page.direct), of(&page.indirect), of(&page.albedo), of(&page.emission)]))
        };
        let ring: Vec<_> = (0..valid.len()).into_par_iter().filter_map(mean).collect();
        for (i, [direct, indirect, albedo, emission]) in ring {
            (page.direct[i], page.indirect[i], page.albedo[i], page.emission[i]) = (direct, indirect, albedo, emission);
            valid[i] = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_fill_ring_by_ring() {
        let mut page = Page::new([9, 1]);
        page.direct[0] = Vec3::splat(4.0);
        page.indirect[8] = Vec3::X;
        let valid = (0..9).map(|i| i == 0 || i == 8).collect();
        fill(&mut page, valid, 2);
        let direct: Vec<f32> = page.direct.iter().map(|e| e.x).collect();
        assert_eq!(direct, [4.0, 4.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(page.indirect[6], Vec3::X);
        let mut page = Page::new([3, 1]);
        (page.direct[0], page.direct[2]) = (Vec3::X, 3.0 * Vec3::X);
        fill(&mut page, vec![true, false, true], 1);
        assert_eq!(page.direct[1], 2.0 * Vec3::X);
    }
}
