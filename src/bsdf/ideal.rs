//! Ideal reflection and refraction at mirrors, glass and panes: directions and weights of the continued rays.
//!
//! A mirror is the lobe of [`Reflectance`] without roughness: it reflects by Schlick's term, or by Fresnel's equations, into the one
//! mirrored direction, over the diffuse base of the material. Smooth glass reflects the fraction R of Fresnel's equations
//! and transmits 1 - R, refracted by Snell's law and tinted by its base colour at each crossing; radiance changes by the
//! square of the relative index. A pane is glass of no thickness: light passes straight through, and all
//! reflections between its two faces add up to 2R / (1 + R) (the geometric series of R and (1 - R)^2 R^(2k+1)).
//!
//! A frosted pane blurs the image behind it ([`frost`], [`BsdfSample::frosted`]).
//!
//! Bodies of glass can be nested: [`Media`] gives the indices that a ray leaves and enters.
//!
//! Smooth normals lean over at silhouettes. If one would send a ray to the wrong side of the surface, the face normal is used,
//! so that there are no black rims.

use super::{Finish, MIN_ALPHA, Normals, Reflectance, fresnel_dielectric, mean, reflect};
use crate::scene::{Material, Surface};
use crate::settings;
use crate::superposition::reflectance::of_mirror;
use glam::Vec3;

/// Stack of the bodies of glass around a ray, the one entered last first: material index + 1, 0 if empty.
///
/// The rule for nested glass: **the body entered last counts.** Entering (through a front face) pushes a body, leaving
/// (through a back face) removes it from any position; the index is that of the topmost body, and 1 outside all bodies. So a
/// bubble is a body of index 1, and a liquid whose body slightly overlaps its vessel's wall touches it without a gap of air.
/// A ray that leaves a body which it never entered started inside. A fifth body displaces the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Media(pub [u32; 4]);

impl Media {
    /// Index of refraction around the ray.
    pub fn index(&self, materials: &[Material]) -> f32 {
        match self.0[0] {
            0 => 1.0,
            top => materials[top as usize - 1].ior,
        }
    }

    /// After passing a surface of material `material` from its front (`enters`) or from its back.
    pub fn crossed(&self, material: u32, enters: bool) -> Media {
        let [a, b, c, d] = self.0;
        let body = material + 1;
        Media(match (enters, self.0.iter().position(|&m| m == body)) {
            (true, _) => [body, a, b, c],
            (false, None) => self.0,
            (false, Some(0)) => [b, c, d, 0],
            (false, Some(1)) => [a, c, d, 0],
            (false, Some(2)) => [a, b, d, 0],
            (false, Some(_)) => [a, b, c, 0],
        })
    }

    /// Index of refraction behind a surface over that before it, as Fresnel's equations take it. A pane is always entered.
    pub fn relative_index(&self, materials: &[Material], material: u32, front: bool) -> f32 {
        let own = &materials[material as usize];
        let enters = front || own.thin;
        // Outside all bodies and about to leave one: it started inside.
        let near = if self.0[0] == 0 && !enters { own.ior } else { self.index(materials) };
        self.crossed(material, enters).index(materials) / near
    }
}

/// A continuation of a ray: direction and factor of its radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Unit direction.
    pub wi: Vec3,
    /// Factor of the radiance.
    pub weight: Vec3,
    /// Additional factor of flux, for photons: eta^2 if it crosses a surface, because the flux of a beam does not
    /// scale as its radiance does, and the correction for shading normals n over geometric ones g (Veach 1997, 5.3),
    /// (n . wo) (g . wi) / ((g . wo) (n . wi)), at most 4.
    pub adjoint: f32,
    /// Whether it crosses the surface of a body.
    pub crosses: bool,
}

/// GGX alpha of a frosted pane's transmission lobe; `None` for a clear pane.
///
/// The lobe is that of reflection mirrored to the other side, of roughness r scaled by the index of refraction n (Burley 2015,
/// "Extending the Disney BRDF to a BSDF with integrated subsurface scattering", thin surfaces, figure 15):
///
/// ```text
/// alpha = ((0.65 n - 0.35) r)^2
/// ```
///
/// A slope m of one face turns a transmitted ray by (n - 1) m, a slope of a mirror by 2 m. So the lobe of two rough faces has
/// (n - 1) / sqrt 2 of the mirror's width, 0.35 for n = 1.5; the formula gives 0.39.
pub fn frost(material: &Material) -> Option<f32> {
    if material.surface != Surface::Glass || !material.thin {
        return None;
    }
    let roughness = ((0.65 * material.ior - 0.35) * material.frost).clamp(0.0, 1.0);
    let alpha = roughness * roughness;
    (alpha > MIN_ALPHA).then_some(alpha)
}

impl BsdfSample {
    /// A sample of a frosted pane's transmission, of normal `n` and lobe `alpha`, instead of this straight one; `u`
    /// chooses it. Its weight is zero if it would not leave the pane.
    pub fn frosted(self, n: Vec3, wo: Vec3, alpha: f32, u: [f32; 2]) -> BsdfSample {
        let lobe = Reflectance { kd: Vec3::ZERO, f0: Vec3::ONE, f90: 1.0, alpha };
        let (wi, share) = lobe.sample_lobe(&[], false, n, wo, u[0], u[1]);
        BsdfSample { wi: wi - 2.0 * n.dot(wi) * n, weight: self.weight * share, ..self }
    }
}

/// The continuations of a ray at a mirror or glass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpecularSamples {
    /// Reflection.
    pub reflected: BsdfSample,
    /// Transmission; `None` at mirrors and at total reflection.
    pub transmitted: Option<BsdfSample>,
}

/// The two components of a surface: a path chooses one at random, or is split.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpecularSplit {
    /// Glass: transmission. Total reflection, or a mirror without diffuse base: reflection. `None`: the diffuse base of a
    /// mirror, which ends the path.
    pub first: Option<BsdfSample>,
    /// The reflection, if `first` is another component.
    pub second: Option<BsdfSample>,
    /// Probability of the first when one is chosen: 1 if there is no second.
    pub probability: f32,
}

impl SpecularSamples {
    /// At a surface of diffuse base `kd`. The probabilities are proportional to the weights, so that neither choice has the larger weight.
    pub fn split(self, kd: Vec3) -> SpecularSplit {
        let (base, reflected) = (mean(kd), mean(self.reflected.weight));
        let (first, probability) = match self.transmitted {
            Some(through) => (Some(through), 1.0 - reflected),
            None if base > 0.0 => (None, base / (base + reflected)),
            None => (Some(self.reflected), 1.0),
        };
        SpecularSplit { first, second: (probability < 1.0).then_some(self.reflected), probability }
    }
}

/// The continuations at a surface of this material, `form` the reflectance of mirrors, `eta` the index of refraction behind it over that in front of it; `None`
/// for opaque surfaces.
pub fn specular_samples(
    material: &Material,
    finish: &Finish,
    normals: &Normals,
    wo: Vec3,
    eta: f32,
    form: settings::Reflectance,
) -> Option<SpecularSamples> {
    match material.surface {
        Surface::Opaque => None,
        Surface::Mirror => Some(mirror(normals, wo, (finish.ideal, finish.ideal_f90), form)),
        Surface::Glass if material.thin => Some(pane(normals, wo, eta, finish.ideal)),
        Surface::Glass => Some(glass(normals, wo, eta, finish.ideal)),
    }
}

/// A mirror of reflectance `f0` at normal and by Schlick's formula `f90` at grazing incidence.
pub fn mirror(normals: &Normals, wo: Vec3, (f0, f90): (Vec3, f32), form: settings::Reflectance) -> SpecularSamples {
    let n = upright(normals, wo, 1.0);
    let reflectance = of_mirror(form, (f0, f90), n.dot(wo));
    SpecularSamples { reflected: reflected(normals, wo, n, reflectance), transmitted: None }
}

/// Glass of relative index `eta` (far over near).
pub fn glass(normals: &Normals, wo: Vec3, eta: f32, tint: Vec3) -> SpecularSamples {
    let n = upright(normals, wo, eta);
    let (r, cos_t) = fresnel_dielectric(n.dot(wo), eta);
    let transmitted = cos_t.map(|cos_t| {
        let wi = refract(wo, n, eta, cos_t);
        let adjoint = eta * eta * skew_of(normals, n, wo, wi);
        BsdfSample { wi, weight: tint * ((1.0 - r) / (eta * eta)), adjoint, crosses: true }
    });
    SpecularSamples { reflected: reflected(normals, wo, n, Vec3::splat(r)), transmitted }
}

/// A pane of relative index `eta`.
pub fn pane(normals: &Normals, wo: Vec3, eta: f32, tint: Vec3) -> SpecularSamples {
    let n = upright(normals, wo, 1.0);
    let (r, _) = fresnel_dielectric(n.dot(wo), eta);
    let both = 2.0 * r / (1.0 + r);
    let transmitted =
        (both < 1.0).then(|| BsdfSample { wi: -wo, weight: tint * (1.0 - both), adjoint: 1.0, crosses: false });
    SpecularSamples { reflected: reflected(normals, wo, n, Vec3::splat(both)), transmitted }
}

fn reflected(normals: &Normals, wo: Vec3, n: Vec3, weight: Vec3) -> BsdfSample {
    let wi = reflect(wo, n);
    BsdfSample { wi, weight, adjoint: skew_of(normals, n, wo, wi), crosses: false }
}

/// Factor of flux for a shading normal `n` that deviates from the face normal.
fn skew_of(normals: &Normals, n: Vec3, wo: Vec3, wi: Vec3) -> f32 {
    let g = normals.geometric;
    (n.dot(wo) * g.dot(wi) / (g.dot(wo) * n.dot(wi))).abs().min(4.0)
}

/// The shading normal, or the geometric one if rays by the shading normal would end up on the wrong side.
fn upright(normals: &Normals, wo: Vec3, eta: f32) -> Vec3 {
    let (n, face) = (normals.shading, normals.geometric);
    let cos = n.dot(wo);
    let above = cos > 0.0 && reflect(wo, n).dot(face) > 0.0;
    let below = match fresnel_dielectric(cos, eta) {
        (_, Some(cos_t)) => refract(wo, n, eta, cos_t).dot(face) < 0.0,
        _ => true,
    };
    if above && below { n } else { face }
}

/// Snell's law: the direction behind the surface, `cos_t` its cosine.
fn refract(wo: Vec3, n: Vec3, eta: f32, cos_t: f32) -> Vec3 {
    (n * (n.dot(wo) / eta - cos_t) - wo / eta).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCHLICK: settings::Reflectance = settings::Reflectance::Schlick;

    fn flat(wo: Vec3) -> Normals {
        Normals::facing(Vec3::Z, Vec3::Z, wo)
    }

    fn from(degrees: f32) -> Vec3 {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Vec3::new(sin, 0.0, cos)
    }

    #[test]
    fn glass_bends_by_snell_and_keeps_the_energy() {
        for (degrees, eta) in [(0.0, 1.5), (30.0, 1.5), (60.0, 1.5), (89.0, 1.5), (30.0, 1.0 / 1.5), (50.0, 1.0)] {
            let wo = from(degrees);
            let samples = glass(&flat(wo), wo, eta, Vec3::ONE);
            let through = samples.transmitted.unwrap();
            let sine = |w: Vec3| w.x.hypot(w.y);
            assert!((sine(through.wi) * eta - sine(wo)).abs() < 1e-6, "{degrees} degrees, eta {eta}");
            assert!(through.wi.z < 0.0 && through.wi.x <= 0.0 && through.wi.is_normalized());
            assert!((samples.reflected.wi - Vec3::new(-wo.x, 0.0, wo.z)).length() < 1e-6);
            // Power, not radiance: the beam's solid angle goes by the square of the index.
            let power = samples.reflected.weight.x * samples.reflected.adjoint + through.weight.x * through.adjoint;
            assert!((power - 1.0).abs() < 1e-6, "{power}");
        }
        // Normal incidence 0.04; beyond the critical angle of 41.81 degrees nothing leaves glass.
        assert!((glass(&flat(Vec3::Z), Vec3::Z, 1.5, Vec3::ONE).reflected.weight.x - 0.04).abs() < 1e-6);
        let total = glass(&flat(from(42.0)), from(42.0), 1.0 / 1.5, Vec3::ONE);
        assert_eq!((total.reflected.weight, total.transmitted), (Vec3::ONE, None));
        let tinted = glass(&flat(Vec3::Z), Vec3::Z, 1.0, Vec3::new(0.5, 1.0, 0.25));
        assert_eq!(tinted.transmitted.unwrap().weight, Vec3::new(0.5, 1.0, 0.25));
        assert_eq!(tinted.reflected.weight, Vec3::ZERO);
    }

    #[test]
    fn a_pane_is_the_sum_over_reflections_between_two_faces() {
        for degrees in [0.0, 45.0, 80.0] {
            let wo = from(degrees);
            let samples = pane(&flat(wo), wo, 1.5, Vec3::ONE);
            // R + (1 - R)^2 (R + R^3 + ...), both faces of one R, for the ray inside is bent by the same angle.
            let r = f64::from(fresnel_dielectric(wo.z, 1.5).0);
            let series: f64 = r + (0..200).map(|k| (1.0 - r).powi(2) * r.powi(2 * k + 1)).sum::<f64>();
            assert!((f64::from(samples.reflected.weight.x) - series).abs() < 1e-6, "{degrees}: {series}");
            let through = samples.transmitted.unwrap();
            assert_eq!(through.wi, -wo);
            assert!((through.weight.x + samples.reflected.weight.x - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn a_frosted_pane_scatters_by_its_lobe() {
        let material = Material { surface: Surface::Glass, thin: true, frost: 0.5, ..Material::default() };
        let alpha = frost(&material).unwrap();
        assert!((alpha - 0.3125f32.powi(2)).abs() < 1e-6, "{alpha}");
        for degrees in [0.0, 40.0, 75.0] {
            let wo = from(degrees);
            let through = pane(&flat(wo), wo, 1.5, Vec3::new(1.0, 0.5, 0.2)).transmitted.unwrap();
            // The share that leaves the pane, and how the light is spread about the way straight on, from samples and from the lobe.
            let lobe = Reflectance { kd: Vec3::ZERO, f0: Vec3::ONE, f90: 1.0, alpha };
            let n = 256;
            let (mut sampled, mut integrated) = ([0.0; 2], [0.0; 2]);
            for i in 0..n * n {
                let u = [(i % n) as f32 + 0.5, (i / n) as f32 + 0.5].map(|x| x / n as f32);
                let sample = through.frosted(Vec3::Z, wo, alpha, u);
                assert!(sample.weight == Vec3::ZERO || sample.wi.z < 0.0);
                let share = f64::from(sample.weight.x / through.weight.x) / f64::from(n * n);
                let near = |wi: Vec3| if wi.dot(-wo) > 0.98 { 1.0 } else { 0.0 };
                sampled = [sampled[0] + share, sampled[1] + share * near(sample.wi)];
                // Cosine-weighted directions behind the pane.
                let up = super::super::sample_diffuse(u);
                let f = f64::from(lobe.eval_specular(&[], Vec3::Z, up, wo).x * std::f32::consts::PI) / f64::from(n * n);
                integrated = [integrated[0] + f, integrated[1] + f * near(Vec3::new(up.x, up.y, -up.z))];
            }
            for (a, b) in sampled.into_iter().zip(integrated) {
                assert!((a - b).abs() < 0.01, "{degrees} degrees: {sampled:?} for {integrated:?}");
            }
            assert!(sampled[1] > 0.2 && sampled[1] < 0.9 * sampled[0], "{sampled:?}");
        }
    }

    #[test]
    fn a_mirror_follows_schlick() {
        let f0 = Vec3::new(0.9, 0.5, 0.0);
        let straight = mirror(&flat(Vec3::Z), Vec3::Z, (f0, 1.0), SCHLICK).reflected;
        assert_eq!((straight.wi, straight.weight), (Vec3::Z, f0));
        let samples = mirror(&flat(from(60.0)), from(60.0), (f0, 1.0), SCHLICK);
        let expected = f0 + (1.0 - f0) * 0.5f32.powi(5);
        assert!((samples.reflected.weight - expected).length() < 1e-6 && samples.transmitted.is_none());
        // Or Fresnel's equations: glass at 60 degrees of incidence.
        let glass = (Vec3::splat(0.04), 1.0);
        for form in [settings::Reflectance::Map, settings::Reflectance::Fresnel] {
            let weight = mirror(&flat(from(60.0)), from(60.0), glass, form).reflected.weight;
            assert!((weight - 0.0892).abs().max_element() < 1e-4, "{weight}");
        }
    }

    #[test]
    fn the_components_of_a_split_add_up() {
        let wo = from(60.0);
        let samples = [
            (glass(&flat(wo), wo, 1.5, Vec3::ONE), Vec3::ZERO),
            (pane(&flat(wo), wo, 1.5, Vec3::ONE), Vec3::ZERO),
            (glass(&flat(wo), wo, 1.0 / 1.5, Vec3::ONE), Vec3::ZERO),
            (glass(&flat(wo), wo, 1.0, Vec3::ONE), Vec3::ZERO),
            (mirror(&flat(wo), wo, (Vec3::splat(0.2), 1.0), SCHLICK), Vec3::splat(0.6)),
            (mirror(&flat(wo), wo, (Vec3::ZERO, 0.0), SCHLICK), Vec3::splat(0.6)),
            (mirror(&flat(wo), wo, (Vec3::splat(0.2), 1.0), SCHLICK), Vec3::ZERO),
        ];
        let splits = samples.map(|(samples, kd)| samples.split(kd));
        let probability = |i: usize| splits[i].probability;
        assert!((probability(0) - (1.0 - 0.0892)).abs() < 1e-4, "{}", probability(0));
        assert!(splits[0].first.unwrap().crosses && !splits[0].second.unwrap().crosses);
        assert!(!splits[1].first.unwrap().crosses && splits[1].first.unwrap().wi == -wo);
        // Total reflection, nothing to reflect, a base with nothing above it, a mirror with nothing below it.
        for (i, base) in [(2, false), (3, false), (5, true), (6, false)] {
            assert_eq!((splits[i].second, probability(i), splits[i].first.is_none()), (None, 1.0, base), "{i}");
        }
        assert!(splits[2].first.unwrap().wi.z > 0.0 && splits[3].first.unwrap().wi.z < 0.0);
        let reflected = splits[4].second.unwrap().weight.x;
        assert!(splits[4].first.is_none() && (probability(4) - 0.6 / (0.6 + reflected)).abs() < 1e-6);
    }

    #[test]
    fn no_ray_goes_to_the_wrong_side_of_a_face() {
        // Normals that lean over by up to 60 degrees, directions down to the horizon.
        for lean in [-60.0, -30.0, 0.0, 30.0, 60.0] {
            for degrees in [-89.9, -70.0, -20.0, 0.0, 45.0, 75.0, 89.9] {
                let wo = from(degrees);
                let normals = Normals::facing(Vec3::Z, from(lean), wo);
                for eta in [1.5, 1.0 / 1.5, 1.0] {
                    for samples in [glass(&normals, wo, eta, Vec3::ONE), pane(&normals, wo, eta, Vec3::ONE)] {
                        assert!(samples.reflected.wi.z > 0.0, "{lean} {degrees} {eta}: {samples:?}");
                        assert!(
                            samples.transmitted.is_none_or(|w| w.wi.z < 0.0),
                            "{lean} {degrees} {eta}: {samples:?}"
                        );
                    }
                }
                assert!(mirror(&normals, wo, (Vec3::ONE, 1.0), SCHLICK).reflected.wi.z > 0.0);
            }
        }
    }

    #[test]
    fn the_body_entered_last_counts() {
        let of = |ior: f32| Material { ior, ..Material::default() };
        let materials = [of(1.5), of(1.33), of(1.0)];
        let [glass, water, bubble] = [0, 1, 2];
        let air = Media::default();
        let relative = |media: Media, body, enters| media.relative_index(&materials, body, enters);
        assert_eq!(relative(air, glass, true), 1.5);
        let in_glass = air.crossed(glass, true);
        assert_eq!(in_glass.index(&materials), 1.5);
        assert_eq!(relative(in_glass, glass, false), 1.0 / 1.5);
        assert_eq!(in_glass.crossed(glass, false), air);
        // A bubble, and out of it again.
        assert_eq!(relative(in_glass, bubble, true), 1.0 / 1.5);
        let in_bubble = in_glass.crossed(bubble, true);
        assert_eq!(relative(in_bubble, bubble, false), 1.5);
        assert_eq!(in_bubble.crossed(bubble, false), in_glass);
        // Water overlaps the wall of its vessel: from glass into water, then the wall's inner face, which is not seen.
        let both = in_glass.crossed(water, true);
        assert_eq!(relative(in_glass, water, true), 1.33 / 1.5);
        assert_eq!(relative(both, glass, false), 1.0);
        let in_water = both.crossed(glass, false);
        assert_eq!(in_water, air.crossed(water, true));
        // And on the far side.
        assert_eq!(relative(in_water, glass, true), 1.5 / 1.33);
        let wall = in_water.crossed(glass, true);
        assert_eq!(relative(wall, water, false), 1.0);
        assert_eq!(wall.crossed(water, false), in_glass);
        // An eye in glass.
        assert_eq!(relative(air, glass, false), 1.0 / 1.5);
        assert_eq!(air.crossed(glass, false), air);
        // The fifth body pushes out the first.
        let five = (0..5).fold(air, |media, body| media.crossed(body, true));
        assert_eq!(five, Media([5, 4, 3, 2]));
        assert_eq!(five.crossed(3, false), Media([5, 3, 2, 0]));
        assert_eq!(five.crossed(2, false), Media([5, 4, 2, 0]));
        assert_eq!(five.crossed(1, false), Media([5, 4, 3, 0]));
    }
}
