//! Light kept in textures ([`crate::bake`]): the irradiance of surfaces, which a frame shows without virtual lights.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::Scene;
/// Mitchell's filter with B = C = 1/3 at a distance in texels, not negative.
pub fn mitchell_filter(x: f32) -> f32 {
    match x {
        x if x < 1.0 => ((21.0 * x - 36.0) * x * x + 16.0) / 18.0,
        x if x < 2.0 => (((-7.0 * x + 36.0) * x - 60.0) * x + 32.0) / 18.0,
        _ => 0.0,
    }
}

/// A side of a triangle on a page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeptFace {
    /// Index of the page.
    pub page: u32,
    /// Positions of the three vertices on it in texels, x to the right, y down.
    pub corners: [Vec2; 3],
}

/// A page of irradiance, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptPage {
    /// Width and height in texels, each at least 1.
    pub size: [u32; 2],
    /// From the emitters, W/m^2.
    pub direct: Vec<Vec3>,
    /// After one or more reflections, W/m^2.
    pub indirect: Vec<Vec3>,
}

/// Kept light of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptLight {
    /// Front and back of each triangle; `None`: no light reaches it.
    pub faces: Vec<[Option<KeptFace>; 2]>,
    /// The texels.
    pub pages: Vec<KeptPage>,
}

impl KeptLight {
    /// Direct and indirect irradiance at a point of a triangle, by the weights of its second and third vertex: bilinear
    /// between the centres of texels.
    pub fn irradiance(&self, triangle: u32, back: bool, [u, v]: [f32; 2]) -> [Vec3; 2] {
        self.weighted(triangle, back, [u, v], 0..2, |x| (1.0 - x).max(0.0))
    }

    /// The same by the filter (1/3, 1/3) of Mitchell and Netravali 1988 over sixteen texels, and not negative.
    pub fn irradiance_bicubic(&self, triangle: u32, back: bool, uv: [f32; 2]) -> [Vec3; 2] {
        self.weighted(triangle, back, uv, -1..3, mitchell_filter).map(|light| light.max(Vec3::ZERO))
    }

    /// The sum over texels `around` the one whose centre lies before the point, in both axes, by a weight of their distance.
    fn weighted(
        &self,
        triangle: u32,
        back: bool,
        [u, v]: [f32; 2],
        around: Range<i32>,
        weight: fn(f32) -> f32,
    ) -> [Vec3; 2] {
        let Some(face) = self.faces[triangle as usize][usize::from(back)] else { return [Vec3::ZERO; 2] };
        let page = &self.pages[face.page as usize];
        let [a, b, c] = face.corners;
        let at = a + u * (b - a) + v * (c - a) - 0.5;
        let first = at.floor();
        let part = at - first;
        let most = Vec2::new((page.size[0] - 1) as f32, (page.size[1] - 1) as f32);
        let mut sums = [Vec3::ZERO; 2];
        for dy in around.clone() {
            for dx in around.clone() {
                let step = Vec2::new(dx as f32, dy as f32);
                let place = (first + step).clamp(Vec2::ZERO, most);
                let away = (part - step).abs();
                let weight = weight(away.x) * weight(away.y);
                let i = place.x as usize + place.y as usize * page.size[0] as usize;
                sums[0] += weight * page.direct[i];
                sums[1] += weight * page.indirect[i];
            }
        }
        sums
    }

    /// Checks it against a scene; returns what is wrong.
    pub(crate) fn check(&self, scene: &Scene) -> Result<(), String> {
        if self.faces.len() != scene.triangles.len() {
            let (faces, triangles) = (self.faces.len(), scene.triangles.len());
            return Err(format!("it has light for {faces} triangles, and the scene has {triangles}"));
        }
        for (i, page) in self.pages.iter().enumerate() {
            let count = page.size[0] as usize * page.size[1] as usize;
            if count == 0 || page.direct.len() != count || page.indirect.len() != count {
                return Err(format!("page {i} has not as many texels as its size says"));
            }
            let good = |e: &Vec3| e.is_finite() && e.min_element() >= 0.0;
            if !page.direct.iter().chain(&page.indirect).all(good) {
                return Err(format!("page {i} has an irradiance below 0 or not finite"));
            }
        }
        for face in self.faces.iter().flatten().flatten() {
            let Some(page) = self.pages.get(face.page as usize) else {
                return Err(format!("there is no page {}", face.page));
            };
            let size = Vec2::new(page.size[0] as f32, page.size[1] as f32);
            if !face.corners.iter().all(|c| c.cmpge(Vec2::ZERO).all() && c.cmple(size).all()) {
                return Err(format!("a face lies outside of page {}", face.page));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept() -> KeptLight {
        let corners = [Vec2::new(0.5, 0.5), Vec2::new(2.5, 0.5), Vec2::new(0.5, 1.5)];
        let direct = (0..6).map(|i| Vec3::splat((i % 3 + 10 * (i / 3)) as f32)).collect();
        let page = KeptPage { size: [3, 2], direct, indirect: vec![Vec3::Y; 6] };
        KeptLight { faces: vec![[Some(KeptFace { page: 0, corners }), None]], pages: vec![page] }
    }

    #[test]
    fn linear_fields_are_exact() {
        for (u, v) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.3, 0.4), (0.25, 0.125)] {
            let [direct, indirect] = kept().irradiance(0, false, [u, v]);
            assert!((direct - Vec3::splat(2.0 * u + 10.0 * v)).abs().max_element() < 1e-5, "{u} {v}: {direct}");
            assert!((indirect - Vec3::Y).abs().max_element() < 1e-6);
        }
        assert_eq!(kept().irradiance(0, true, [0.2, 0.2]), [Vec3::ZERO; 2], "a side without light");
    }

    #[test]
    fn the_bicubic_look_up_is_the_filter_over_texels() {
        let mut kept = kept();
        let value = |x: usize, y: usize| ((7 * x + 5 * y) % 4) as f32;
        let direct = (0..48).map(|i| Vec3::splat(value(i % 8, i / 8))).collect();
        kept.pages[0] = KeptPage { size: [8, 6], direct, indirect: vec![Vec3::Y; 48] };
        kept.faces[0][0] = Some(KeptFace { page: 0, corners: [Vec2::ZERO, Vec2::new(8.0, 0.0), Vec2::new(0.0, 6.0)] });
        // Well inside of the page, over all of its texels.
        let [direct, indirect] = kept.irradiance_bicubic(0, false, [0.43, 0.41]);
        let mut expected = 0.0;
        for y in 0..6 {
            for x in 0..8 {
                let away = (Vec2::new(8.0 * 0.43, 6.0 * 0.41) - Vec2::new(x as f32 + 0.5, y as f32 + 0.5)).abs();
                expected += value(x, y) * mitchell_filter(away.x) * mitchell_filter(away.y);
            }
        }
        assert!((direct.x - expected).abs() < 1e-5 && (indirect.y - 1.0).abs() < 1e-6, "{direct} {expected}");
    }

    #[test]
    fn what_does_not_fit_is_told() {
        let scene = Scene { triangles: vec![super::super::builtin::room(100).triangles[0]], ..Scene::default() };
        let told = |change: fn(&mut KeptLight)| {
            let mut kept = kept();
            change(&mut kept);
            kept.check(&scene).map_or_else(|message| message, |()| String::new())
        };
        assert_eq!(told(|_| ()), "");
        assert!(told(|k| k.faces.clear()).contains("0 triangles"));
        assert!(told(|k| k.pages[0].size[0] = 4).contains("as many texels"));
        assert!(told(|k| k.pages[0].direct[1].x = -1.0).contains("below 0"));
        assert!(told(|k| k.pages[0].indirect[5].y = f32::NAN).contains("not finite"));
        assert!(told(|k| k.faces[0][0].as_mut().unwrap().page = 1).contains("no page 1"));
        assert!(told(|k| k.faces[0][0].as_mut().unwrap().corners[2].x = 3.1).contains("outside"));
    }
}
