//! Direction-dependent reflectance (Bastos 1999, 6.7).
//!
//! A mirror image is modulated by the surface's reflectance towards the eye. The reflectance follows Fresnel's equations
//! for the index that yields the known reflectance at normal incidence ([`fresnel_fitted`], equations 6.10 to 6.14), separately for
//! each colour band, so metals lose their colour towards grazing angles. It is evaluated exactly, or looked up in a [`ReflectanceMap`],
//! which can hold any other isotropic modulation.
//!
//! # Differences from the thesis
//!
//! - Equation 6.9 divides F by pi (N.L)(N.V). That factor belongs to a reflectance distribution; for a mirror image, whose light
//!   comes from one direction and not from a solid angle, it would be F / (pi cos^2): a third of F at normal incidence, and unbounded
//!   at grazing angles. The thesis' own map (figure 6.23) is of F alone. So F modulates; [`rho`] is equation 6.9 as printed.
//! - Equation 6.11 takes (L + V) / 2 for H. It must have unit length, or c would be the squared cosine in a mirror image.
//! - The map is not a sphere map; see [`ReflectanceMap`].

use glam::{Vec3, Vec4};

use crate::bsdf::schlick;
use crate::error::{Error, Result};
use crate::settings;

/// The index of refraction that reflects `f0` at normal incidence (equation 6.14). Infinite for 1.
pub fn effective_index(f0: f64) -> f64 {
    let root = f0.clamp(0.0, 1.0).sqrt();
    (1.0 + root) / (1.0 - root)
}

/// Reflectance in one band, by equation 6.10, of a surface that reflects `f0` (0 to 1) at normal incidence, at an angle of incidence with
/// cosine `cos` (0 to 1).
///
/// This is Fresnel's equation for unpolarised light and a real index of refraction, 1 or more: exact for dielectrics. For
/// metals it dips below `f0` before it rises to 1, at the Brewster angle of light polarised in the plane of incidence; a
/// conductor, whose index is complex, dips less, and Schlick's approximation ([`schlick`]) not at all.
/// 0 reflects nothing at any angle, 1 everything.
pub fn fresnel_fitted(f0: f32, cos: f32) -> f32 {
    if f0 <= 0.0 || f0 >= 1.0 {
        return f0.clamp(0.0, 1.0);
    }
    let n = effective_index(f64::from(f0));
    let c = f64::from(cos).clamp(0.0, 1.0);
    let g = (n * n + c * c - 1.0).sqrt();
    let perpendicular = (g - c) / (g + c);
    let ratio = (c * (g + c) - 1.0) / (c * (g - c) + 1.0);
    (0.5 * perpendicular * perpendicular * (1.0 + ratio * ratio)) as f32
}

/// [`fresnel_fitted`] in three bands.
pub fn fresnel_fitted_rgb(f0: Vec3, cos: f32) -> Vec3 {
    Vec3::from_array(f0.to_array().map(|f0| fresnel_fitted(f0, cos)))
}

/// Reflectance of an ideal mirror that reflects `f0` at normal and by Schlick's formula `f90` at grazing incidence, at an angle of
/// incidence with cosine `cos`. The table takes the equations themselves.
pub fn of_mirror(form: settings::Reflectance, (f0, f90): (Vec3, f32), cos: f32) -> Vec3 {
    match form {
        settings::Reflectance::Schlick => schlick(f0, f90, cos),
        settings::Reflectance::Map | settings::Reflectance::Fresnel => fresnel_fitted_rgb(f0, cos),
    }
}

/// Equation 6.9 in one band, in 1/sr: F / (pi (n.l) (n.v)) for unit directions away from the surface; 0 if either is not above it.
pub fn rho(f0: f32, n: Vec3, l: Vec3, v: Vec3) -> f32 {
    let (cos_l, cos_v) = (n.dot(l), n.dot(v));
    if cos_l <= 0.0 || cos_v <= 0.0 {
        return 0.0;
    }
    fresnel_fitted(f0, v.dot((l + v).normalize())) / (std::f32::consts::PI * cos_l * cos_v)
}

/// Texels of a [`ReflectanceMap`].
pub const MAP_TEXELS: usize = 128;

/// An isotropic modulation tabulated over the angle of view.
///
/// The thesis stores it in a sphere map and lists its drawbacks (end of 6.7.3): directional resolution that is not constant and
/// lowest at grazing angles, where reflectance varies most; interpolation across the map where it should wrap; filters that reach
/// over its edge. All result from two coordinates for a function of one. This map has one, mu = cos theta_o, warped so that its
/// texels are densest at grazing angles: texel i belongs to mu_i = (i / (N - 1))^2, N = [`MAP_TEXELS`], both ends included. There is
/// nothing to wrap. Look-up:
///
/// ```text
/// s = sqrt(mu) * (N - 1);  i = floor(s);  mix(map[i], map[min(i + 1, N - 1)], s - i)
/// ```
///
/// Maximum and mean difference from [`fresnel_fitted`] over mu: 9.0e-5 and 1.4e-5 for glass (F0 = 0.04), 2.7e-4 and 1.3e-5 for
/// F0 = 0.63, 1.2e-3 and 1.7e-5 for F0 = 0.9; the maximum lies within the last thousandth of a degree before grazing.
#[derive(Clone, Debug, PartialEq)]
pub struct ReflectanceMap {
    texels: Vec<Vec3>,
}

impl ReflectanceMap {
    /// From any modulation, a function of mu = cos theta_o from 0 to 1 in three bands.
    ///
    /// Errors: values that are not finite.
    pub fn new(modulation: impl Fn(f32) -> Vec3) -> Result<ReflectanceMap> {
        let texels: Vec<Vec3> = (0..MAP_TEXELS).map(|i| modulation(texel_cosine(i))).collect();
        if let Some(i) = texels.iter().position(|texel| !texel.is_finite()) {
            let (mu, value) = (texel_cosine(i), texels[i]);
            let message = format!("the modulation is {value} at cos theta_o = {mu}; it must be finite from 0 to 1");
            return Err(Error::Resource { name: String::from("reflectance map"), message });
        }
        Ok(ReflectanceMap { texels })
    }

    /// From [`fresnel_fitted`] for the reflectances at normal incidence.
    pub fn fresnel(f0: Vec3) -> Result<ReflectanceMap> {
        ReflectanceMap::new(|mu| fresnel_fitted_rgb(f0, mu))
    }

    /// The look-up for cos theta_o = `mu`, as in a shader.
    pub fn look_up(&self, mu: f32) -> Vec3 {
        let s = mu.clamp(0.0, 1.0).sqrt() * (MAP_TEXELS - 1) as f32;
        let i = s as usize;
        self.texels[i].lerp(self.texels[(i + 1).min(MAP_TEXELS - 1)], s - i as f32)
    }

    /// The texels in device form; the fourth component is 0.
    pub fn to_gpu(&self) -> Vec<[f32; 4]> {
        self.texels.iter().map(|texel| Vec4::from((*texel, 0.0)).to_array()).collect()
    }
}

/// Cosine of the angle of view of a texel.
fn texel_cosine(texel: usize) -> f32 {
    let s = texel as f32 / (MAP_TEXELS - 1) as f32;
    s * s
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::fresnel_dielectric;
    use crate::superposition::kernels::KernelLibrary;
    use crate::superposition::lobe::Lobe;

    /// Polished gold of the thesis (figure 6.23).
    const GOLD: Vec3 = Vec3::new(0.63, 0.56, 0.37);
    /// Glass of index 1.5.
    const GLASS: f32 = 0.04;

    /// Cosines from 0 to 1, dense at grazing angles: x^3.
    fn cosines() -> impl Iterator<Item = f32> {
        (0..=10_000).map(|i| (i as f32 / 10_000.0).powi(3))
    }

    /// Maximum difference, its cosine, and the mean over the cosine.
    fn difference(a: impl Fn(f32) -> f32, b: impl Fn(f32) -> f32) -> (f32, f32, f32) {
        let (mut greatest, mut at, mut sum) = (0.0, 0.0, 0.0);
        for c in cosines() {
            let d = (a(c) - b(c)).abs();
            // dc = 3 x^2 dx.
            sum += d * 3.0 * c.powf(2.0 / 3.0) / 10_000.0;
            if d > greatest {
                (greatest, at) = (d, c);
            }
        }
        (greatest, at, sum)
    }

    /// Reflectance of a conductor for unpolarised light (Born and Wolf), with a complex index eta + i kappa.
    fn conductor(eta: f64, kappa: f64, cos: f64) -> f64 {
        let sin2 = 1.0 - cos * cos;
        let t = eta * eta - kappa * kappa - sin2;
        let a2_plus_b2 = (t * t + 4.0 * eta * eta * kappa * kappa).sqrt();
        let a = (0.5 * (a2_plus_b2 + t)).max(0.0).sqrt();
        let perpendicular = (a2_plus_b2 + cos * cos - 2.0 * a * cos) / (a2_plus_b2 + cos * cos + 2.0 * a * cos);
        let (p, q) = (cos * cos * a2_plus_b2 + sin2 * sin2, 2.0 * a * cos * sin2);
        0.5 * perpendicular * (1.0 + (p - q) / (p + q))
    }

    #[test]
    fn fitted_is_fresnel_for_dielectrics() {
        for n in [1.05f32, 1.333, 1.5, 2.4, 8.0] {
            let f0 = ((n - 1.0) / (n + 1.0)).powi(2);
            assert!((effective_index(f64::from(f0)) / f64::from(n) - 1.0).abs() < 1e-6);
            let (greatest, at, _) = difference(|c| fresnel_fitted(f0, c), |c| fresnel_dielectric(c, n).0);
            assert!(greatest < 2e-6, "n = {n}: {greatest} at {at}");
        }
        // Glass at 60 degrees of incidence, by hand: sin = 0.866 / 1.5, cos_t = 0.8165.
        assert!((fresnel_fitted(GLASS, 0.5) - 0.0892).abs() < 1e-4);
    }

    #[test]
    fn fitted_at_its_ends() {
        for f0 in [1e-9, 1e-4, GLASS, 0.5, 0.999, 1.0 - f32::EPSILON] {
            assert!((fresnel_fitted(f0, 1.0) / f0 - 1.0).abs() < 1e-6, "{f0}");
            assert!((fresnel_fitted(f0, 0.0) - 1.0).abs() < 1e-6, "{f0}");
            assert!(cosines().all(|c| (0.0..=1.0).contains(&fresnel_fitted(f0, c))), "{f0}");
        }
        assert!(cosines().all(|c| fresnel_fitted(0.0, c) == 0.0 && fresnel_fitted(1.0, c) == 1.0));
    }

    #[test]
    fn gold_loses_its_colour_at_grazing_angles() {
        let map = ReflectanceMap::fresnel(GOLD).unwrap();
        assert!((map.look_up(1.0) - GOLD).abs().max_element() < 1e-6);
        assert!((map.look_up(0.0) - Vec3::ONE).abs().max_element() < 1e-6);
        // Blue over red: past white where red light, and not yet blue, is near its Brewster angle, then back to white.
        let blue = |c: f32| map.look_up(c).z / map.look_up(c).x;
        let measured = [1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.0].map(blue);
        let expected = [0.587, 0.616, 0.837, 1.114, 1.216, 1.141, 1.0];
        for (a, b) in measured.iter().zip(expected) {
            assert!((a - b).abs() < 2e-3, "{measured:?}");
        }
    }

    /// The figures of the documentation.
    #[test]
    fn map_against_exact_evaluation() {
        for (f0, greatest, mean) in
            [(GLASS, 9.1e-5, 1.4e-5), (0.37, 1.4e-4, 1e-5), (0.63, 2.8e-4, 1.4e-5), (0.9, 1.2e-3, 1.7e-5)]
        {
            let map = ReflectanceMap::fresnel(Vec3::splat(f0)).unwrap();
            let found = difference(|c| map.look_up(c).x, |c| fresnel_fitted(f0, c));
            assert!(found.0 < greatest && found.2 < mean, "{f0}: {found:?}");
        }
    }

    /// Schlick's approximation, which the renderer uses, minus the fitted equations: the figures of the documentation.
    #[test]
    fn schlick_against_fitted() {
        for (f0, greatest, mean) in
            [(GLASS, 0.036, 0.013), (0.37, 0.208, 0.061), (0.56, 0.335, 0.098), (0.63, 0.377, 0.107)]
        {
            let found = difference(|c| schlick(Vec3::splat(f0), 1.0, c).x, |c| fresnel_fitted(f0, c));
            assert!((found.0 - greatest).abs() < 1e-3 && (found.2 - mean).abs() < 1e-3, "{f0}: {found:?}");
        }
    }

    /// Both against conductors of the same reflectance at normal incidence: the figures of the documentation.
    #[test]
    fn conductors_against_fitted_and_schlick() {
        // About gold in red light and in blue, iron.
        for (eta, kappa, fitted, schlicks) in
            [(0.18, 3.1, 0.494, 0.015), (1.37, 1.77, 0.203, 0.022), (3.0, 3.3, 0.158, 0.188)]
        {
            let exact = |c: f32| conductor(eta, kappa, f64::from(c)) as f32;
            let f0 = exact(1.0);
            let (a, b) = (
                difference(exact, |c| fresnel_fitted(f0, c)).0,
                difference(exact, |c| schlick(Vec3::splat(f0), 1.0, c).x).0,
            );
            assert!((a - fitted).abs() < 1e-3 && (b - schlicks).abs() < 1e-3, "{eta} + {kappa} i: {a} {b}");
        }
    }

    #[test]
    fn any_modulation_can_be_tabulated() {
        let mut library = KernelLibrary::new();
        library.add(0, Lobe::Ggx { alpha: 0.2 }).unwrap();
        let energy = |mu: f32| library.look_up(0, mu).unwrap().energy;
        let modulation = |mu: f32| fresnel_fitted_rgb(GOLD, mu) * energy(mu);
        let map = ReflectanceMap::new(modulation).unwrap();
        let (greatest, at, _) = difference(|c| map.look_up(c).x, |c| modulation(c).x);
        assert!(greatest < 2e-3, "{greatest} at {at}");
        let gpu = map.to_gpu();
        assert_eq!(gpu.len(), MAP_TEXELS);
        assert_eq!(gpu[MAP_TEXELS - 1], [map.look_up(1.0).x, map.look_up(1.0).y, map.look_up(1.0).z, 0.0]);
        let refused = ReflectanceMap::new(|mu| Vec3::splat(1.0 / mu)).unwrap_err().to_string();
        assert!(
            refused.starts_with("reflectance map: the modulation is [inf, inf, inf] at cos theta_o = 0"),
            "{refused}"
        );
    }

    #[test]
    fn rho_is_equation_6_9() {
        let at = |cos: f32, x: f32| Vec3::new(x * (1.0 - cos * cos).sqrt(), 0.0, cos);
        // In a mirror image H is the normal.
        let found = rho(0.63, Vec3::Z, at(0.5, 1.0), at(0.5, -1.0));
        assert!((found / (fresnel_fitted(0.63, 0.5) / (std::f32::consts::PI * 0.25)) - 1.0).abs() < 1e-5, "{found}");
        // Retroreflection: F is that of normal incidence.
        let found = rho(0.63, Vec3::Z, at(0.8, 1.0), at(0.8, 1.0));
        assert!((found / (0.63 / (std::f32::consts::PI * 0.64)) - 1.0).abs() < 1e-5, "{found}");
        // Reciprocal.
        let (forward, backward) =
            (rho(0.3, Vec3::Z, at(0.9, 1.0), at(0.2, 1.0)), rho(0.3, Vec3::Z, at(0.2, 1.0), at(0.9, 1.0)));
        assert!((forward / backward - 1.0).abs() < 1e-5, "{forward} {backward}");
        assert_eq!(rho(0.63, Vec3::Z, Vec3::new(0.6, 0.0, -0.8), Vec3::Z), 0.0);
    }
}
