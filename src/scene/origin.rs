//! The origin of a scene's coordinates: near the geometry of a file, so that single precision suffices.

use glam::{DVec3, Vec3};

use super::{Camera, Scene};

/// A scene whose centre is at most this many times its size from the file's origin keeps the file's coordinates: rounding
/// then costs two bits of 24.
const NEAR: f64 = 4.0;

/// The origin for geometry within a box of world coordinates: zero near the world's origin; else the box's centre,
/// rounded to a grid of a power of two, about a quarter of the box or less. Its coordinates are exact in single precision.
pub(super) fn choose(low: DVec3, high: DVec3) -> DVec3 {
    let size = (high - low).max_element();
    let center = 0.5 * (low + high);
    let distance = center.abs().max_element();
    // Also an empty box.
    if !(size.is_finite() && distance.is_finite() && distance > NEAR * size) {
        return DVec3::ZERO;
    }
    // At most 2^23 steps of the grid, which 24 bits hold.
    let step = (0.25 * size).max(distance * (-22.0f64).exp2());
    let grid = 2.0f64.powi(step.log2().floor() as i32);
    (center / grid).round() * grid
}

impl Scene {
    /// A point of the world in the scene's coordinates: relative to [`Scene::origin`].
    pub fn from_world(&self, point: DVec3) -> Vec3 {
        (point - self.origin).as_vec3()
    }

    /// A point of the scene in world coordinates.
    pub fn to_world(&self, point: Vec3) -> DVec3 {
        self.origin + point.as_dvec3()
    }
}

impl Camera {
    /// The camera as JSON with eye and target in world coordinates, for metadata of images. `origin` is [`Scene::origin`].
    pub fn world_json(&self, origin: DVec3) -> String {
        if origin == DVec3::ZERO {
            return serde_json::to_string(self).unwrap_or_default();
        }
        let mut value = serde_json::to_value(self).unwrap_or_default();
        for (name, point) in [("eye", self.eye), ("target", self.target)] {
            value[name] = serde_json::json!((origin + point.as_dvec3()).to_array());
        }
        value.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_scenes_keep_their_coordinates() {
        let (low, high) = (DVec3::ZERO, DVec3::new(556.0, 548.8, 559.2));
        assert_eq!(choose(low, high), DVec3::ZERO);
        assert_eq!(choose(low + 1900.0, high + 1900.0), DVec3::ZERO);
        assert_eq!(choose(DVec3::INFINITY, DVec3::NEG_INFINITY), DVec3::ZERO);
    }

    #[test]
    fn far_scenes_get_an_origin_nearby_that_single_precision_holds() {
        for exponent in 1..30 {
            for size in [1e-3, 0.7, 559.2] {
                let shift = DVec3::new(-1.0, 0.37, 0.011) * size * 10.0f64.powi(exponent);
                let (low, high) = (shift, shift + size);
                let origin = choose(low, high);
                assert_eq!(origin.as_vec3().as_dvec3(), origin);
                let off = (0.5 * (low + high) - origin).abs().max_element();
                assert!(off <= (0.125 * size).max(shift.length() * 1e-6), "{origin} is {off} from the centre");
            }
        }
    }
}
