//! The oracles: each quantity of the pass from its equation.

use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};

use super::{
    ALONG_EDGE, EDGE_WEIGHT, LEAST_AGREEMENT, LEAST_COSINE, MARGIN, TILE, TOLERANCE, WIDE, WIDEST, samples_of,
    searches_of,
};
use crate::accel::offset_origin;
use crate::light::cosine;
use crate::light::emitters::Emitter;
use crate::pass::layout::FrameParameters;

/// An emitter: a parallelogram.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    /// Its centre, with ray-origin offset.
    pub centre: Vec3,
    /// A corner.
    pub corner: Vec3,
    /// The edges from there.
    pub edges: [Vec3; 2],
    /// Unit normal.
    pub normal: Vec3,
    /// Radiance along the normal.
    pub radiance: Vec3,
    /// Exponent of the cosine.
    pub exponent: f32,
}

impl Light {
    /// Of an emitter; `scale`: coordinate scale of the scene.
    pub fn of(e: &Emitter, scale: f32) -> Light {
        Light {
            centre: offset_origin(e.p0 + 0.5 * (e.e1 + e.e2), e.normal, scale),
            corner: e.p0,
            edges: [e.e1, e.e2],
            normal: e.normal,
            radiance: e.radiance,
            exponent: e.exponent,
        }
    }

    /// Whether its centre is above the horizon of a point with normal n, and the point above that of the emitter.
    pub fn faces(&self, x: Vec3, n: Vec3) -> bool {
        let d = self.centre - x;
        d.dot(n) > 0.0 && d.dot(self.normal) < 0.0
    }

    /// Irradiance without shadows at a point with these normals, clipped at the root of `clip2`.
    pub fn irradiance(&self, x: Vec3, [geometric, shading]: [Vec3; 2], clip2: f32) -> Vec3 {
        let area = self.edges[0].cross(self.edges[1]).length();
        let places = (0..ALONG_EDGE * ALONG_EDGE)
            .map(|i| [i % ALONG_EDGE, i / ALONG_EDGE].map(|k| (k as f32 + 0.5) / ALONG_EDGE as f32));
        let sum: f32 = places
            .map(|[u, v]| {
                let d = self.corner + u * self.edges[0] + v * self.edges[1] - x;
                let wi = d.normalize();
                let emitted = -wi.dot(self.normal);
                if emitted <= 0.0 || wi.dot(geometric) <= 0.0 {
                    return 0.0;
                }
                cosine::power(emitted, self.exponent) * wi.dot(shading).max(0.0) / d.length_squared().max(clip2)
            })
            .sum();
        self.radiance * (area * sum / (ALONG_EDGE * ALONG_EDGE) as f32)
    }
}

/// The kernel of a point in the image for a ratio of 1.
#[derive(Clone, Copy, Debug)]
pub struct Kernel {
    /// Pixels along the edges of the light.
    pub edges: [Vec2; 2],
    /// Change of depth along them, over the depth.
    pub depth: Vec2,
}

impl Kernel {
    /// Of a point x with normal n.
    pub fn of(frame: &FrameParameters, light: &Light, x: Vec3, n: Vec3) -> Kernel {
        let xyz = |v: [f32; 4]| Vec4::from_array(v).xyz();
        let w = x - light.centre;
        let height = n.dot(w).min(-LEAST_COSINE * w.length());
        let onto_plane = light.edges.map(|e| e - w * (n.dot(e) / height));
        let [eye, right, up, forward] = [frame.eye, frame.right, frame.up, frame.forward].map(xyz);
        let z = frame.depth_scale((x - eye).dot(forward));
        let half = 0.5 * Vec2::new(frame.within[2] as f32, frame.within[3] as f32);
        // Half widths and half heights at unit distance; rows count downwards.
        let lateral =
            |v: Vec3| half * Vec2::new(v.dot(right) / right.length_squared(), -v.dot(up) / up.length_squared());
        let depths = onto_plane.map(|p| if frame.is_orthographic() { 0.0 } else { p.dot(forward) / z });
        let edge = |k: usize| lateral(onto_plane[k]) / z - lateral(x - eye) / z * depths[k];
        Kernel { edges: [edge(0), edge(1)], depth: Vec2::from(depths) }
    }

    /// Half of the greater side of the box around it.
    pub fn half_extent(&self) -> f32 {
        0.5 * (self.edges[0].abs() + self.edges[1].abs()).max_element()
    }

    /// Whether it is wide both ways.
    fn is_wide(&self, ratio: f32) -> bool {
        (self.edges[0].abs() + self.edges[1].abs()).min_element() * self.bounded(ratio) > WIDE
    }

    /// The greatest ratio whose kernel is not too wide.
    pub fn bounded(&self, ratio: f32) -> f32 {
        ratio.min(WIDEST / self.half_extent().max(1e-6))
    }

    /// Pixels to the sample of the light's point (u, v) from its centre; `along`: these times the ratio.
    pub fn offset(&self, along: Vec2) -> Vec2 {
        (self.edges[0] * along.x + self.edges[1] * along.y) / (1.0 + self.depth.dot(along)).max(0.25)
    }

    /// The pixel at an offset from another.
    fn pixel(&self, at: [u32; 2], along: Vec2, size: [u32; 2]) -> Option<[u32; 2]> {
        let place = (Vec2::new(at[0] as f32, at[1] as f32) + 0.5 + self.offset(along)).floor();
        let inside = place.min_element() >= 0.0 && place.x < size[0] as f32 && place.y < size[1] as f32;
        inside.then_some([place.x as u32, place.y as u32])
    }
}

/// Point i of n = 2^k evenly spread ones in the unit square.
pub fn spread_point(i: u32, n: u32) -> Vec2 {
    Vec2::new((i as f32 + 0.5) / n as f32, (i.reverse_bits() >> 8) as f32 / 16_777_216.0 + 0.5 / n as f32)
}

/// Whether a point lies on the tangent plane of x with normal n.
pub fn on_plane(x: Vec3, n: Vec3, point: Vec3) -> bool {
    let chord = point - x;
    chord.dot(n).powi(2) <= TOLERANCE * TOLERANCE * chord.length_squared()
}

/// Whether a point with its word lies on the surface of x with normal n.
pub fn on_surface(x: Vec3, n: Vec3, point: Vec4) -> bool {
    Word(point.w.to_bits()).normal().dot(n) >= LEAST_AGREEMENT && on_plane(x, n, point.xyz())
}

/// Word about a point: a code of its normal in 14 bits; of a pixel whether it is lit or blocked, of a blocker the upper half of its ratio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Word(pub u32);

impl Word {
    /// Of a pixel's point with normal n that faces the centre and sees it or not; `None`: it does not face it.
    pub fn of_pixel(state: Option<bool>, n: Vec3) -> Word {
        let code = |lit| Self::code(n) | if lit { 0x4000 } else { 0x8000 };
        Word(1f32.to_bits() | state.map_or(0, code))
    }

    /// Of a blocker.
    pub fn of_blocker(ratio: f32, at_edge: bool, of_pixel: Word) -> Word {
        let ratio = ratio.to_bits() & 0xffff_0000;
        Word(ratio | if at_edge { 0x8000 } else { 0 } | of_pixel.0 & 0x3fff)
    }

    /// Whether a pixel is lit or blocked; `None`: neither.
    pub fn lit(self) -> Option<bool> {
        (self.0 & 0xc000 != 0).then_some(self.0 & 0x4000 != 0)
    }

    /// Ratio of a blocker.
    pub fn ratio(self) -> f32 {
        f32::from_bits(self.0 & 0xffff_0000)
    }

    /// Weight of a blocker.
    fn weight(self) -> f32 {
        if self.0 & 0x8000 != 0 { EDGE_WEIGHT } else { 1.0 }
    }

    fn code(n: Vec3) -> u32 {
        let p = n.truncate() / (n.x.abs() + n.y.abs() + n.z.abs());
        let sign = |x: f32| if x >= 0.0 { 1.0 } else { -1.0 };
        let folded = Vec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y));
        let e = if n.z >= 0.0 { p } else { folded };
        let [x, y] = (63.5 * e + 64.0).to_array().map(|v| v.clamp(0.0, 127.0) as u32);
        x | y << 7
    }

    /// The normal, to some degrees.
    pub fn normal(self) -> Vec3 {
        let e = Vec2::from([0, 7].map(|shift| (self.0 >> shift & 127) as f32 / 63.5 - 1.0));
        let z = 1.0 - e.x.abs() - e.y.abs();
        let fold = (-z).max(0.0);
        let unfolded = |x: f32| if x >= 0.0 { x - fold } else { x + fold };
        Vec3::new(unfolded(e.x), unfolded(e.y), z).normalize()
    }
}

/// Ratio of a blocker at the share t of the way to the centre; `extent`: of its kernel for a ratio of 1.
pub fn ratio_of(t: f32, extent: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    (t / (1.0 - t).max(1e-4)).min(WIDEST / extent.max(1e-6))
}

/// Greatest reach in pixels and greatest ratio of a tile's blockers, and whether it shows lit and blocked pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tile {
    /// Reach.
    pub reach: f32,
    /// Ratio.
    pub ratio: f32,
    /// Shows lit pixels.
    pub lit: bool,
    /// Shows blocked pixels.
    pub blocked: bool,
}

/// Greatest ratio of the blockers that reach tile `at`; 0: there are none, or nothing lit is in their reach.
pub fn window(columns: u32, tiles: &[Tile], at: u32) -> f32 {
    let apart = |other: usize| {
        let (x, y) = (other as u32 % columns, other as u32 / columns);
        let tiles_between = x.abs_diff(at % columns).max(y.abs_diff(at / columns));
        (TILE * tiles_between) as f32 - (TILE - 1) as f32
    };
    let reaches = |i: &usize| tiles[*i].blocked && tiles[*i].reach >= apart(*i).max(0.0);
    let (mut ratio, mut reach) = (0.0f32, -1.0f32);
    for i in (0..tiles.len()).filter(reaches) {
        (ratio, reach) = (ratio.max(tiles[i].ratio), reach.max(tiles[i].reach));
    }
    let lit = (0..tiles.len()).any(|i| tiles[i].lit && reach >= apart(i).max(0.0));
    if lit { ratio } else { 0.0 }
}

/// Result of the search for blockers at a quad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quad {
    /// No kernel reaches it.
    Open,
    /// Ratio of its kernel.
    Narrow(f32),
    /// Share of its kernel that is lit.
    Wide(f32),
}

impl Quad {
    /// As a number.
    pub fn written(self) -> f32 {
        match self {
            Quad::Open => 0.0,
            Quad::Narrow(ratio) => ratio,
            Quad::Wide(share) => -1.0 - share,
        }
    }

    /// From its number; `None`: nothing is known.
    pub fn read(number: f32) -> Option<Quad> {
        match number {
            _ if number > 0.0 => Some(Quad::Narrow(number)),
            _ if number < -3.0 => None,
            0.0 => Some(Quad::Open),
            _ => Some(Quad::Wide(-1.0 - number)),
        }
    }
}

/// Point, surface and hard shadow of a pixel, for the search and the convolution.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// Parameters of the pass.
    pub frame: &'a FrameParameters,
    /// The emitter.
    pub light: &'a Light,
    /// The pixel.
    pub at: [u32; 2],
    /// Its point.
    pub x: Vec3,
    /// Its normal.
    pub n: Vec3,
}

impl Seen<'_> {
    fn size(&self) -> [u32; 2] {
        [self.frame.size[0], self.frame.size[1]]
    }

    /// Mean ratio of the blockers whose kernels reach it; `blockers`: a point of each quad, w: its word.
    pub fn mean_ratio(&self, blockers: &[Vec4], greatest: f32) -> f32 {
        let kernel = Kernel::of(self.frame, self.light, self.x, self.n);
        let widest = kernel.bounded(greatest);
        let margin = MARGIN / Vec2::from(kernel.edges.map(Vec2::length)).max(Vec2::splat(1e-6));
        let across = self.size()[0].div_ceil(2);
        let blocker = |[x, y]: [u32; 2]| blockers[(x / 2 + y / 2 * across) as usize];
        let counts = |b: &Vec4| b.w > 0.0 && on_surface(self.x, self.n, *b);
        let count = searches_of(2.0 * (widest * kernel.half_extent() + MARGIN));
        let samples = (0..count).filter_map(|i| {
            let p = 2.0 * spread_point(i, count) - 1.0;
            let along = (0.5 * widest + margin) * p * p.abs();
            let found = blocker(kernel.pixel(self.at, along, self.size())?);
            along.abs().cmple(0.5 * Word(found.w.to_bits()).ratio() + margin).all().then_some(found)
        });
        let found = [blocker(self.at)].into_iter().chain(samples).filter(counts).map(|b| Word(b.w.to_bits()));
        let (sum, weight) = found
            .fold((0.0, 0.0f32), |(sum, weight), word| (sum + word.weight() * word.ratio(), weight + word.weight()));
        sum / weight.max(1.0)
    }

    /// Searches for blockers at this point of a quad; `source`: point of each pixel, w: its word.
    pub fn quad(&self, (source, blockers): (&[Vec4], &[Vec4]), greatest: f32) -> Quad {
        let ratio = self.mean_ratio(blockers, greatest);
        let kernel = Kernel::of(self.frame, self.light, self.x, self.n);
        match ratio {
            0.0 => Quad::Open,
            _ if kernel.is_wide(ratio) => Quad::Wide(self.lit_share(source, ratio)),
            _ => Quad::Narrow(ratio),
        }
    }

    /// Share that is lit by the four quads around it, of each a point, w: what is known; or the ratio of its kernel if its own is narrow.
    pub fn between(&self, source: &[Vec4], quads: &[Vec4]) -> Quad {
        let [across, down] = self.size().map(|n| n.div_ceil(2));
        let of = |[x, y]: [u32; 2]| quads[(x + y * across) as usize];
        let hard = self.hard(source);
        // The point of a quad is that of its first pixel, but at outlines.
        let place = self.at.map(|at| 0.5 * at as f32);
        let (mut narrow, mut others) = ((0.0, 0.0f32), (0.0, 0.0f32));
        for step in [[0, 0], [1, 0], [0, 1], [1, 1]] {
            let [(x, share_x), (y, share_y)] = [(0, across - 1), (1, down - 1)].map(|(k, last): (usize, u32)| {
                let (first, part) = (place[k].floor(), place[k] - place[k].floor());
                ((first as i32 + step[k]).clamp(0, last as i32) as u32, if step[k] == 1 { part } else { 1.0 - part })
            });
            let (found, weight) = (of([x, y]), share_x * share_y);
            let add = |sum: &mut (f32, f32), value: f32| *sum = (sum.0 + weight * value, sum.1 + weight);
            match Quad::read(found.w) {
                Some(_) if !on_plane(self.x, self.n, found.xyz()) => {}
                None => {}
                Some(Quad::Narrow(ratio)) => add(&mut narrow, ratio),
                Some(Quad::Wide(share)) => add(&mut others, share),
                Some(Quad::Open) => add(&mut others, hard),
            }
        }
        match Quad::read(of(self.at.map(|n| n / 2)).w) {
            Some(Quad::Narrow(_)) => Quad::Narrow(narrow.0 / narrow.1.max(1e-6)),
            _ => Quad::Wide(if others.1 > 0.0 { others.0 / others.1.max(1e-6) } else { hard }),
        }
    }

    /// Share that is lit without a kernel.
    fn hard(&self, source: &[Vec4]) -> f32 {
        let own = source[(self.at[0] + self.at[1] * self.size()[0]) as usize];
        Word(own.w.to_bits()).lit().map_or(1.0, f32::from)
    }

    /// Share of its kernel that is lit; `source`: point of each pixel, w: its word.
    pub fn lit_share(&self, source: &[Vec4], ratio: f32) -> f32 {
        let width = self.size()[0];
        let of = |[x, y]: [u32; 2]| source[(x + y * width) as usize];
        let kernel = Kernel::of(self.frame, self.light, self.x, self.n);
        let bounded = kernel.bounded(ratio);
        let count = samples_of(2.0 * bounded * kernel.half_extent());
        let samples = (0..count)
            .filter_map(|i| kernel.pixel(self.at, bounded * (spread_point(i, count) - 0.5), self.size()))
            .map(of)
            .filter(|s| on_surface(self.x, self.n, *s))
            .filter_map(|s| Word(s.w.to_bits()).lit());
        let (sum, weight) = samples.fold((0.0, 0.0), |(sum, weight), lit| (sum + f32::from(lit), weight + 1.0));
        if weight > 0.0 { sum / weight } else { self.hard(source) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> FrameParameters {
        let [forward, right, up] = [Vec3::new(0.6, -0.48, 0.64), Vec3::new(0.8, 0.36, -0.48), Vec3::new(0.0, 0.8, 0.6)];
        let with = |v: Vec3| v.extend(0.0).to_array();
        FrameParameters {
            eye: with(Vec3::new(-1.0, 2.0, -1.5)),
            right: with(0.7 * right),
            up: with(0.5 * up),
            forward: with(forward),
            size: [640, 480, 640 * 480, 0],
            within: [0, 0, 640, 480],
            ..FrameParameters::default()
        }
    }

    /// Place of a point in the image, pixels.
    fn project(frame: &FrameParameters, p: Vec3) -> Vec2 {
        let xyz = |v: [f32; 4]| Vec4::from_array(v).xyz();
        let d = p - xyz(frame.eye);
        let z = d.dot(xyz(frame.forward));
        let along = |axis: Vec3| d.dot(axis) / (z * axis.length_squared());
        Vec2::new(320.0, 240.0) * Vec2::new(1.0 + along(xyz(frame.right)), 1.0 - along(xyz(frame.up)))
    }

    /// An occluder between x and a point of the light has its shadow from the light's centre at the kernel's sample for that point.
    #[test]
    fn kernels_follow_the_shadow_of_an_occluder() {
        let frame = frame();
        let light = Light {
            centre: Vec3::new(0.3, 3.0, 1.0),
            corner: Vec3::ZERO,
            edges: [Vec3::new(0.4, 0.1, 0.0), Vec3::new(0.05, -0.1, 0.5)],
            normal: -Vec3::Y,
            radiance: Vec3::ONE,
            exponent: 1.0,
        };
        for n in [Vec3::Y, Vec3::new(0.2, 0.9, -0.3).normalize()] {
            for (x, t) in
                [(Vec3::new(0.5, 0.0, 1.0), 0.3), (Vec3::new(1.0, 0.2, 0.4), 0.6), (Vec3::new(0.2, 0.4, 1.9), 0.05)]
            {
                for [u, v] in [[0.5, 0.5], [-0.5, 0.2], [0.0, -0.4]] {
                    let of_light = light.centre + u * light.edges[0] + v * light.edges[1];
                    let occluder = x + t * (of_light - x);
                    // From the centre through the occluder to the plane of x.
                    let d = occluder - light.centre;
                    let seen = light.centre + d * ((x - light.centre).dot(n) / d.dot(n));
                    let offset = project(&frame, seen) - project(&frame, x);
                    let found = Kernel::of(&frame, &light, x, n).offset(Vec2::new(u, v) * ratio_of(t, 0.0));
                    // The map is that of first order in the light's slope against the plane.
                    let slope = n.dot(of_light - light.centre) / n.dot(x - light.centre);
                    let first_order = 1.5 * ratio_of(t, 0.0) * slope.abs();
                    let tolerance = 0.02 + (2e-3 + first_order) * offset.length();
                    assert!((found - offset).length() < tolerance, "{n} {x} {t}: {found} for {offset}");
                }
            }
        }
    }

    #[test]
    fn words_keep_normals_and_ratios() {
        for i in 0..500u32 {
            let [u, v] = [spread_point(i, 512).x, spread_point(i, 512).y];
            let n = crate::bsdf::sample_diffuse([u, v]) * if i % 2 == 0 { 1.0 } else { -1.0 };
            let pixel = Word::of_pixel(Some(i % 3 == 0), n);
            assert!(pixel.normal().dot(n) > 0.999, "{n}: {}", pixel.normal());
            assert_eq!(pixel.lit(), Some(i % 3 == 0));
            let blocker = Word::of_blocker(0.01 * (i + 1) as f32, true, pixel);
            assert!((blocker.ratio() / (0.01 * (i + 1) as f32) - 1.0).abs() < 0.01);
            assert_eq!(blocker.normal(), pixel.normal());
        }
        assert_eq!(Word::of_pixel(None, Vec3::Z).lit(), None);
    }

    #[test]
    fn spread_points_fill_every_column_and_row() {
        for n in [16, 32, 64] {
            for axis in 0..2 {
                let mut filled: Vec<u32> = (0..n).map(|i| (spread_point(i, n)[axis] * n as f32) as u32).collect();
                filled.sort_unstable();
                assert!(filled.into_iter().eq(0..n), "{n}");
            }
        }
    }

    #[test]
    fn irradiance_is_that_of_a_small_square() {
        let light = Light {
            centre: Vec3::new(0.0, 2.0, 0.0),
            corner: Vec3::new(-0.01, 2.0, -0.01),
            edges: [0.02 * Vec3::X, 0.02 * Vec3::Z],
            normal: -Vec3::Y,
            radiance: Vec3::new(10.0, 5.0, 1.0),
            exponent: 1.0,
        };
        let found = light.irradiance(Vec3::ZERO, [Vec3::Y; 2], 0.0);
        assert!((found - light.radiance * 4e-4 / 4.0).length() < 1e-4 * found.length(), "{found}");
        assert_eq!(light.irradiance(Vec3::ZERO, [-Vec3::Y; 2], 0.0), Vec3::ZERO);
        // Within the clip distance it is that at this distance.
        let clipped = light.irradiance(Vec3::ZERO, [Vec3::Y; 2], 16.0);
        assert!((clipped - found / 4.0).length() < 1e-3 * found.length(), "{clipped}");
    }
}
