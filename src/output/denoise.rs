//! Open Image Denoise, a neural network that removes noise, by the system's library (feature `oidn`).
//!
//! Input: the radiance, and albedo and normal of the visible surface, taken as noisy, since they have the noise of few
//! samples at edges. Cost: the library's, some 3 microseconds a pixel on two cores, and 60 bytes a pixel beside its own memory.
//! A frame here has little noise that the network could remove (`docs/defaults.md`), and the bias of what it does is unknown.

use super::Layers;
use crate::error::{Error, Result};

/// Name of the setting, for errors.
const NAME: &str = "--denoise";

/// Checks that this build can denoise, before anything is rendered. Errors: [`Error::Setting`] without the feature `oidn`, and where
/// the library finds no device to run on.
#[cfg(feature = "oidn")]
pub fn check() -> Result<()> {
    oidn::Device::new().map(drop).map_err(failed)
}

/// Errors always, as the feature `oidn` is off.
#[cfg(not(feature = "oidn"))]
pub fn check() -> Result<()> {
    Err(missing())
}

/// Replaces the colour by its denoised version. Errors: those of [`check`], and [`Error::Setting`] if the layers lack albedo or normal
/// or the library fails.
#[cfg(feature = "oidn")]
pub fn denoise(layers: &mut Layers) -> Result<()> {
    use glam::Vec3;

    let pixels = layers.color.len();
    if [layers.albedo.len(), layers.normal.len()] != [pixels; 2] {
        return Err(Error::Setting { name: NAME, message: String::from("the layers albedo and normal are needed") });
    }
    let floats = bytemuck::cast_slice::<Vec3, f32>;
    let device = oidn::Device::new().map_err(failed)?;
    let buffer = |layer: &[Vec3]| device.create_buffer(floats(layer)).map_err(failed);
    let (albedo, normal) = (buffer(&layers.albedo)?, buffer(&layers.normal)?);
    let mut filter = oidn::RayTracing::try_new(&device).map_err(failed)?;
    filter.hdr(true).image_dimensions(layers.width as usize, layers.height as usize);
    filter.albedo_normal_buffer(albedo, normal).map_err(failed)?;
    let mut denoised = vec![Vec3::ZERO; pixels];
    filter.filter(floats(&layers.color), bytemuck::cast_slice_mut(&mut denoised)).map_err(failed)?;
    layers.color = denoised;
    Ok(())
}

/// Errors always, as the feature `oidn` is off: see [`check`].
#[cfg(not(feature = "oidn"))]
pub fn denoise(_: &mut Layers) -> Result<()> {
    Err(missing())
}

#[cfg(feature = "oidn")]
fn failed(error: oidn::Error) -> Error {
    Error::Setting { name: NAME, message: format!("Open Image Denoise failed: {error}") }
}

#[cfg(not(feature = "oidn"))]
fn missing() -> Error {
    let message = "this build lacks Open Image Denoise; install its library and build with --features oidn";
    Error::Setting { name: NAME, message: String::from(message) }
}

#[cfg(all(test, feature = "oidn"))]
mod tests {
    use super::*;
    use crate::sampling::random::hash;
    use glam::Vec3;

    /// A wall with noise of known variance; one half is darker.
    fn noisy() -> (Layers, Vec<Vec3>) {
        let (width, height) = (97u32, 64u32);
        let level = |i: u32| if i % width < width / 2 { 0.2 } else { 0.6 };
        let clean: Vec<Vec3> = (0..width * height).map(|i| Vec3::splat(level(i))).collect();
        let noise = |i: u32| 0.5 + hash(i) as f32 / u32::MAX as f32;
        let color = (0..width * height).map(|i| clean[i as usize] * noise(i)).collect();
        let layers = Layers {
            width,
            height,
            color,
            albedo: clean.clone(),
            normal: vec![Vec3::Z; clean.len()],
            ..Layers::default()
        };
        (layers, clean)
    }

    #[test]
    fn noise_goes_and_energy_stays() {
        let (mut layers, clean) = noisy();
        let error = |color: &[Vec3]| -> f32 {
            let squares = color.iter().zip(&clean).map(|(a, b)| (*a - *b).length_squared());
            (squares.sum::<f32>() / clean.iter().map(|b| b.length_squared()).sum::<f32>()).sqrt()
        };
        let before = error(&layers.color);
        denoise(&mut layers).unwrap();
        let after = error(&layers.color);
        assert!(after < 0.2 * before, "{before} before, {after} after");
        let sum = |color: &[Vec3]| color.iter().sum::<Vec3>().x;
        let energy = sum(&layers.color) / sum(&clean);
        assert!((energy - 1.0).abs() < 0.02, "energy {energy}");
    }

    #[test]
    fn missing_layers_are_an_error() {
        let (mut layers, _) = noisy();
        layers.normal.clear();
        assert!(denoise(&mut layers).unwrap_err().to_string().contains("normal"));
    }
}
