//! A clear sky with its sun as an environment.
//!
//! The sky is that of Hosek and Wilkie 2012, "An Analytic Model for Full Spectral Sky-Dome Radiance", in its RGB form. Its
//! sun is a black body behind the air: Rayleigh scattering after Preetham et al. 1999, "A Practical Analytic Model for
//! Daylight", appendix 1, and haze whose extinction is fitted to the solar radiance of Hosek and Wilkie 2013.
//!
//! Unit: spectral radiance, W/(m^2 sr nm), averaged with the weights of the human eye: what level ground receives from a high
//! sun is about 1.5, so that no exposure is needed.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::Vec3;
use hw_skymodel::rgb::{Channel, SkyParams, SkyState};
use rayon::prelude::*;

use super::Environment;

/// Columns of the table; the sun is one to two of them wide.
const WIDTH: u32 = 1024;

/// Integral of the luminous efficiency function over the wavelength, nm.
const LUMINOUS_NM: f32 = 106.857;

/// Diameter of the sun, degrees.
const SUN_DIAMETER: f32 = 0.5358;

/// Albedo of the ground.
const GROUND: f32 = 0.2;

impl Environment {
    /// A clear sky, its sun, and a diffuse grey ground below the horizon.
    ///
    /// `azimuth` of the sun from positive z towards positive x and `elevation` above the horizon, above 0 and at most 90, in
    /// degrees; `turbidity`, the haziness of the air, from 1 (none) to 10; 3 is a clear day. The error is a message.
    ///
    /// The sky's irradiance is that of the model. The sun's is within 5 % of Hosek and Wilkie's at 20 degrees and higher,
    /// in blue within 10 %; below, blue is up to a third too strong.
    pub fn sun_and_sky(azimuth: f32, elevation: f32, turbidity: f32) -> Result<Environment, String> {
        if !(azimuth.is_finite() && elevation > 0.0 && elevation <= 90.0) {
            return Err(format!("the sun at {azimuth}, {elevation} must be above the horizon, at most at 90 degrees"));
        }
        let (azimuth, height) = (azimuth.to_radians(), elevation.to_radians());
        let params = SkyParams { elevation: height.min(FRAC_PI_2), turbidity, albedo: [GROUND; 3] };
        let sky = SkyState::new(&params).map_err(|_| format!("turbidity {turbidity} must be from 1 to 10"))?;
        let sun = Vec3::new(azimuth.sin() * height.cos(), height.sin(), azimuth.cos() * height.cos());
        let mut environment = Environment {
            name: format!("sky with the sun at {elevation} degrees"),
            width: WIDTH,
            height: WIDTH / 2,
            texels: Vec::new(),
            axes: [Vec3::X, Vec3::Y, Vec3::Z],
        };
        let texel = |i: u32| {
            let [x, y] = [i % WIDTH, i / WIDTH].map(|k| k as f32 + 0.5);
            let theta = PI * y / (WIDTH / 2) as f32;
            let gamma = environment.direction(TAU * x / WIDTH as f32, theta.cos()).dot(sun).clamp(-1.0, 1.0).acos();
            let channel = |c| sky.radiance(theta, gamma, c).max(0.0) / LUMINOUS_NM;
            if theta < FRAC_PI_2 {
                Vec3::new(channel(Channel::R), channel(Channel::G), channel(Channel::B))
            } else {
                Vec3::ZERO
            }
        };
        environment.texels = (0..WIDTH * WIDTH / 2).into_par_iter().map(texel).collect();
        environment.add_sun(sun, sun_irradiance(elevation, turbidity));
        let ground = environment.level_irradiance() * (GROUND / PI);
        environment.texels[(WIDTH * WIDTH / 4) as usize..].fill(ground);
        Ok(environment)
    }

    /// Adds a sun of some irradiance across its direction: each texel gets the share of the disc that lies in it.
    fn add_sun(&mut self, sun: Vec3, irradiance: Vec3) {
        /// Points along each side of a texel.
        const POINTS: u32 = 8;
        let cosine = (0.5 * SUN_DIAMETER).to_radians().cos();
        let side = |k: u32, i: u32| (k * POINTS + i) as f32 + 0.5;
        let shares = |i: usize| {
            let (x, y) = (i as u32 % self.width, i as u32 / self.width);
            let inside = |p: &u32| {
                let azimuth = TAU * side(x, p % POINTS) / (POINTS * self.width) as f32;
                let theta = PI * side(y, p / POINTS) / (POINTS * self.height) as f32;
                self.direction(azimuth, theta.cos()).dot(sun) >= cosine
            };
            (0..POINTS * POINTS).filter(inside).count() as f32
        };
        // Only texels near the sun, above the horizon.
        let reach = (0.5 * SUN_DIAMETER + 360.0 / self.width as f32).to_radians().cos();
        let centre = |i: usize| {
            let [x, y] = [i as u32 % self.width, i as u32 / self.width].map(|k| k as f32 + 0.5);
            self.direction(TAU * x / self.width as f32, (PI * y / self.height as f32).cos())
        };
        let near: Vec<(usize, f32)> = (0..self.texels.len() / 2)
            .into_par_iter()
            .filter(|&i| centre(i).dot(sun) >= reach)
            .map(|i| (i, shares(i)))
            .filter(|(_, share)| *share > 0.0)
            .collect();
        let whole: f32 = near.iter().map(|&(i, share)| share * self.solid_angle_at(i)).sum();
        for (i, share) in near {
            self.texels[i] += irradiance * (share / whole);
        }
    }

    fn solid_angle_at(&self, texel: usize) -> f32 {
        self.row_solid_angle(texel as u32 / self.width)
    }

    /// Irradiance of level ground.
    fn level_irradiance(&self) -> Vec3 {
        let share = |i: usize| {
            let up = (PI * ((i as u32 / self.width) as f32 + 0.5) / self.height as f32).cos();
            (self.texels[i] * (up * self.solid_angle_at(i))).as_dvec3()
        };
        (0..self.texels.len() / 2).map(share).sum::<glam::DVec3>().as_vec3()
    }
}

/// Irradiance across the direction of the sun, linear Rec. 709.
fn sun_irradiance(elevation: f32, turbidity: f32) -> Vec3 {
    /// Step of the wavelength, nm.
    const STEP: f32 = 5.0;
    let solid_angle = TAU * (1.0 - f64::from(0.5 * SUN_DIAMETER).to_radians().cos()) as f32;
    // Relative optical mass after Kasten, as Preetham et al. have it.
    let mass = 1.0 / (elevation.to_radians().sin() + 0.15 * (3.885 + elevation).powf(-1.253));
    let mut xyz = Vec3::ZERO;
    for i in 0..=80 {
        let nm = 380.0 + STEP * i as f32;
        let um = nm * 1e-3;
        let rayleigh = 0.008735 * um.powf(-4.08);
        let haze = (0.025 * turbidity - 0.02) * (um / 0.55).powf(-0.6);
        let transmittance = (-(rayleigh + haze) * mass).exp();
        xyz += observer(nm) * (black_body(um) * transmittance * STEP);
    }
    (rgb_from_xyz(xyz) * (solid_angle / LUMINOUS_NM)).max(Vec3::ZERO)
}

/// Linear Rec. 709 of CIE XYZ.
pub(super) fn rgb_from_xyz(xyz: Vec3) -> Vec3 {
    // sRGB's matrix, IEC 61966-2-1, by columns.
    glam::Mat3::from_cols(
        Vec3::new(3.240_454, -0.969_266, 0.055_643),
        Vec3::new(-1.537_139, 1.876_011, -0.204_026),
        Vec3::new(-0.498_531, 0.041_556, 1.057_225),
    ) * xyz
}

/// Radiance of the sun outside the air at a wavelength in micrometres, W/(m^2 sr nm): Planck's law at 5778 K, times a factor
/// fitted together with the haze.
fn black_body(um: f32) -> f32 {
    const FITTED: f32 = 0.875;
    // 2 h c^2 in W um^5/(m^2 sr nm) and h c / k in um K.
    FITTED * 1.191_043e5 / (um.powi(5) * ((14_387.77 / (um * 5778.0)).exp() - 1.0))
}

/// Colour matching functions of the CIE's observer of 1931, as sums of Gaussians (Wyman et al. 2013, "Simple Analytic
/// Approximations to the CIE XYZ Color Matching Functions").
pub(super) fn observer(nm: f32) -> Vec3 {
    let lobe = |height: f32, at: f32, below: f32, above: f32| {
        let t = (nm - at) * if nm < at { below } else { above };
        height * (-0.5 * t * t).exp()
    };
    Vec3::new(
        lobe(1.056, 599.8, 0.0264, 0.0323) + lobe(0.362, 442.0, 0.0624, 0.0374) + lobe(-0.065, 501.1, 0.0490, 0.0382),
        lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322),
        lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Turbidity, elevation, irradiance of level ground from the sky, and across the sun's direction from the sun: by the
    /// emitter `sunsky` of Mitsuba 3.9.1 over ground of albedo 0.2.
    const MITSUBA: [(f32, f32, [f32; 3], [f32; 3]); 6] = [
        (2.0, 20.0, [0.0966, 0.1619, 0.2523], [1.3414, 0.9913, 0.5629]),
        (2.0, 80.0, [0.1348, 0.2316, 0.4225], [1.5429, 1.3074, 1.0307]),
        (3.0, 20.0, [0.1207, 0.1809, 0.2602], [1.2822, 0.9435, 0.5371]),
        (3.0, 45.0, [0.1522, 0.2365, 0.3972], [1.4674, 1.2052, 0.8877]),
        (6.0, 20.0, [0.2185, 0.2507, 0.2854], [1.0368, 0.7468, 0.4300]),
        (6.0, 80.0, [0.3212, 0.4084, 0.5472], [1.4112, 1.1846, 0.9384]),
    ];

    #[test]
    fn irradiance_is_that_of_mitsuba() {
        for (turbidity, elevation, sky, sun) in MITSUBA {
            let environment = Environment::sun_and_sky(33.0, elevation, turbidity).unwrap();
            let of_sun = sun_irradiance(elevation, turbidity);
            let of_sky = environment.level_irradiance() - of_sun * elevation.to_radians().sin();
            let (sky_ratio, sun_ratio) = (of_sky / Vec3::from_array(sky), of_sun / Vec3::from_array(sun));
            println!("turbidity {turbidity}, {elevation} degrees: sky {sky_ratio:.3}, sun {sun_ratio:.3}");
            assert!((sky_ratio - 1.0).abs().max_element() < 0.03, "{sky_ratio}");
            assert!((sun_ratio - 1.0).abs().max_element() < 0.1 && (sun_ratio.y - 1.0).abs() < 0.05, "{sun_ratio}");
        }
    }

    #[test]
    fn the_sun_stands_where_it_should() {
        for (azimuth, elevation) in [(0.0, 30.0), (90.0, 30.0), (-135.0, 3.0), (10.0, 90.0)] {
            let environment = Environment::sun_and_sky(azimuth, elevation, 3.0).unwrap();
            let (a, e) = (f32::to_radians(azimuth), f32::to_radians(elevation));
            let sun = Vec3::new(a.sin() * e.cos(), e.sin(), a.cos() * e.cos());
            let brightest = environment.texels.iter().map(|t| t.y).fold(0.0, f32::max);
            assert!(environment.radiance(sun).y > 0.3 * brightest, "{azimuth} {elevation}");
            // The ground reflects a fifth of what it receives.
            let ground = environment.radiance(Vec3::NEG_Y) * PI / GROUND / environment.level_irradiance();
            assert!((ground - 1.0).abs().max_element() < 1e-4);
        }
    }

    #[test]
    fn suns_below_the_horizon_and_strange_air_are_refused() {
        for (azimuth, elevation, turbidity) in [
            (0.0, 0.0, 3.0),
            (0.0, -3.0, 3.0),
            (f32::NAN, 9.0, 3.0),
            (0.0, 91.0, 3.0),
            (0.0, 9.0, 0.5),
            (0.0, 9.0, 11.0),
        ] {
            assert!(
                Environment::sun_and_sky(azimuth, elevation, turbidity).is_err(),
                "{azimuth} {elevation} {turbidity}"
            );
        }
    }
}
