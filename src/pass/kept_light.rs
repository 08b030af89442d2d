//! Lights shading points by the irradiance that textures keep ([`crate::bake`]), bilinear between texels, in place of all virtual
//! lights: the walkthrough of view-independent light (Keller 1997, 4.3). The bicubic look-up takes Mitchell's filter (1/3, 1/3) instead
//! (Bastos 1999, 5.5.3.3).
//!
//! Texels hold halves in a unit of their page, so that none overflows: relative error 2^-11. Paths through mirrors, glass and along
//! lobes show the light that is kept where they end; a lobe that paths do not follow reflects nothing.
//!
//! Cost: 4 vec4 and 4 texels of 12 bytes read, 3 vec4 written, and 60 operations a point, whatever the number of lights; bicubic 16 texels and 160 operations.

use glam::Vec3;

use super::{BoundKernel, Kit, Lighting, Rays, groups};
use crate::accel::Bvh;
use crate::error::{Error, Result};
use crate::gpu::{Buffer, Context, Recorder, Resources, Staging, shaders};
use crate::scene::KeptLight as Light;
use crate::settings::Lookup;

/// Kept light on the device.
#[derive(Clone)]
pub struct KeptBuffers {
    /// Two vec4 for each triangle in the order of the leaves: (u, v) of its first two corners, of the third, bits of 1 + its page, or 0.
    pub faces: Buffer,
    /// Of each page its first texel, width, height, and bits of the unit of its texels.
    pub pages: Buffer,
    /// Three words a texel, row by row: halves of direct, then of indirect irradiance, in units of the page.
    pub texels: Buffer,
}

/// Unit of the texels of a page: a power of two with which they fill the range of halves, but for a factor of 2 to 4.
fn unit(greatest: f32) -> f32 {
    /// The greatest power of two that is a half.
    const GREATEST: f32 = 32768.0;
    if greatest > 0.0 { (greatest.log2().ceil()).exp2() / GREATEST } else { 1.0 }
}

/// Nearest half, of a number not negative and at most 32768.
fn half(x: f32) -> u32 {
    u32::from(half::f16::from_f32(x).to_bits())
}

fn words([a, b]: [Vec3; 2]) -> [u32; 3] {
    let of = |low: f32, high: f32| half(low) | half(high) << 16;
    [of(a.x, a.y), of(a.z, b.x), of(b.y, b.z)]
}

impl KeptBuffers {
    /// Stages the light of a scene with this tree.
    pub fn new(context: &Context, staging: &mut Staging, bvh: &Bvh, light: &Light) -> Result<KeptBuffers> {
        let of_leaf = |leaf: u32| light.faces[bvh.scene_triangle(leaf) as usize];
        let record = |face: Option<crate::scene::KeptFace>| {
            let Some(face) = face else { return [[0.0; 4]; 2] };
            let [a, b, c] = face.corners;
            [[a.x, a.y, b.x, b.y], [c.x, c.y, f32::from_bits(face.page + 1), 0.0]]
        };
        let faces: Vec<[f32; 4]> = (0..bvh.triangle_count()).flat_map(of_leaf).flat_map(record).collect();
        let (mut pages, mut texels) = (Vec::new(), Vec::new());
        for page in &light.pages {
            let all = page.direct.iter().chain(&page.indirect);
            let unit = unit(all.map(|e| e.max_element()).fold(0.0, f32::max));
            pages.push([texels.len() as u32, page.size[0], page.size[1], unit.to_bits()]);
            texels.extend(page.direct.iter().zip(&page.indirect).map(|(a, b)| words([*a / unit, *b / unit])));
        }
        if pages.is_empty() {
            return Err(Error::Scene(String::from("the kept light has no page; bake it anew")));
        }
        Ok(KeptBuffers {
            faces: staging.stage(context, "faces of kept light", &faces)?,
            pages: staging.stage(context, "pages of kept light", &pages)?,
            texels: staging.stage(context, "texels of kept light", &texels)?,
        })
    }

    fn resources(&self) -> Resources {
        Resources::of([("kept_faces", &self.faces), ("kept_pages", &self.pages), ("kept_texels", &self.texels)])
    }
}

/// The pass.
pub struct KeptLight {
    kernel: BoundKernel,
    slots: u32,
}

impl KeptLight {
    /// Writes the `lighting` of so many slots where their last `rays` ended.
    pub fn new(
        kit: &Kit,
        kept: &KeptBuffers,
        lookup: Lookup,
        rays: &Rays,
        lighting: &Lighting,
        slots: u32,
    ) -> Result<Self> {
        let sets = [&kept.resources(), &rays.resources(), &lighting.resources()];
        let shader = match lookup {
            Lookup::Bilinear => &shaders::KEPT_LIGHT,
            Lookup::Bicubic => &shaders::KEPT_LIGHT_BICUBIC,
        };
        Ok(KeptLight { kernel: kit.bind(shader, &sets)?, slots })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.slots))
    }
}

/// Oracle: direct and indirect irradiance at a point of a triangle, with texels as halves.
pub fn reference(light: &Light, lookup: Lookup, triangle: u32, back: bool, uv: [f32; 2]) -> [Vec3; 2] {
    let mut light = light.clone();
    for page in &mut light.pages {
        let greatest = page.direct.iter().chain(&page.indirect).map(|e| e.max_element()).fold(0.0, f32::max);
        let unit = unit(greatest);
        for e in page.direct.iter_mut().chain(&mut page.indirect) {
            *e = e.map(|x| half::f16::from_f32(x / unit).to_f32() * unit);
        }
    }
    match lookup {
        Lookup::Bilinear => light.irradiance(triangle, back, uv),
        Lookup::Bicubic => light.irradiance_bicubic(triangle, back, uv),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_use_the_range_of_halves() {
        for greatest in [1e-30, 0.3, 1.0, 65504.0, 1e6, 3e30] {
            let of = greatest / unit(greatest);
            assert!((16384.0..=32768.0).contains(&of), "{greatest}: {of}");
        }
        assert_eq!(unit(0.0), 1.0);
        let [a, b, c] = words([Vec3::new(1.0, 2.0, 0.5), Vec3::new(0.0, 32768.0, 1.0)]);
        assert_eq!([a, b, c], [0x4000_3c00, 0x0000_3800, 0x3c00_7800]);
    }
}
