//! Lights and cameras of Mitsuba's scenes.

use std::f32::consts::FRAC_PI_2;
use std::sync::Arc;

use glam::{DMat3, DMat4, DVec3, Vec3};

use super::mitsuba::Reader;
use super::mitsuba_xml::Element;
use super::{Camera, Environment, Light, NamedCamera};
use crate::error::Result;

/// The film that Mitsuba takes where a scene names no size.
const FILM: [u32; 2] = [768, 576];

impl<'a> Reader<'a> {
    /// Radiance of an area light.
    pub(super) fn radiance(&mut self, emitter: &'a Element) -> Result<Vec3> {
        self.emitted(emitter, "radiance")
    }

    pub(super) fn emitter(&mut self, e: &'a Element) -> Result<()> {
        let world = e.transform("to_world")?;
        // The direction of +z, in which lights shine.
        let forward = || world.transform_vector3(DVec3::Z).normalize().as_vec3();
        match e.kind() {
            "point" => {
                let place = e.vector("position")?.unwrap_or(world.w_axis.truncate());
                let intensity = self.emitted(e, "intensity")?;
                self.checked_light(e, place, Light::Point { position: Vec3::ZERO, intensity })
            }
            "spot" => {
                if e.property("texture").is_some() {
                    self.leave_out("textures of spot lights");
                }
                let cutoff = e.number("cutoff_angle")?.unwrap_or(20.0);
                let beam = e.number("beam_width")?.unwrap_or(0.75 * cutoff);
                if !(cutoff > 0.0 && cutoff <= 90.0 && beam >= 0.0 && beam <= cutoff) {
                    return Err(e.error(format!("needs 0 <= beam_width ({beam}) <= cutoff_angle ({cutoff}) <= 90")));
                }
                let (beam, outer) = (beam.to_radians(), cutoff.to_radians().min(FRAC_PI_2));
                let light = Light::Spot {
                    position: Vec3::ZERO,
                    direction: forward(),
                    intensity: self.emitted(e, "intensity")?,
                    inner: inner_angle(beam, outer),
                    outer,
                };
                self.checked_light(e, world.w_axis.truncate(), light)
            }
            "directional" => {
                let direction = match e.vector("direction")? {
                    Some(d) => d.try_normalize().ok_or_else(|| e.error("the direction has no length"))?.as_vec3(),
                    None => forward(),
                };
                let irradiance = self.emitted(e, "irradiance")?;
                self.checked_light(e, DVec3::ZERO, Light::Directional { direction, irradiance })
            }
            "constant" => {
                let radiance = self.emitted(e, "radiance")?;
                self.environment(e, Environment::constant(radiance))
            }
            "envmap" => {
                let scale = e.number("scale")?.unwrap_or(1.0);
                if scale < 0.0 {
                    return Err(e.error(format!("scale {scale} is negative")));
                }
                let mut environment = Environment::load_from(self.inputs, &self.file(e)?)?.scaled(Vec3::splat(scale));
                // The middle of the image lies towards +z, its right towards -x.
                environment.axes = turned(e, world, [-DVec3::X, DVec3::Y, -DVec3::Z])?;
                self.environment(e, environment)
            }
            "sunsky" => {
                let Some(sun) = e.vector("sun_direction")?.and_then(DVec3::try_normalize) else {
                    return Err(e.error("give `sun_direction`; place and time are not read"));
                };
                let (sun_scale, sky_scale) =
                    (e.number("sun_scale")?.unwrap_or(1.0), e.number("sky_scale")?.unwrap_or(1.0));
                if sun_scale != sky_scale {
                    self.leave_out("a scale of the sun other than that of the sky");
                }
                if e.property("albedo").is_some() {
                    self.leave_out("the ground's albedo below the sky (0.2)");
                }
                let turbidity = e.number("turbidity")?.unwrap_or(3.0);
                let [azimuth, elevation] = [sun.y.atan2(sun.x), sun.z.asin()].map(|a| a.to_degrees() as f32);
                let environment = Environment::sun_and_sky(azimuth, elevation, turbidity).map_err(|m| e.error(m))?;
                if sky_scale < 0.0 {
                    return Err(e.error(format!("sky_scale {sky_scale} is negative")));
                }
                let mut environment = environment.scaled(Vec3::splat(sky_scale));
                // The azimuth of our sky is counted from z towards x, with y up.
                environment.axes = turned(e, world, [DVec3::Y, DVec3::Z, DVec3::X])?;
                self.environment(e, environment)
            }
            "area" => Err(e.error("an area light belongs into a shape")),
            other => {
                self.leave_out(format!("emitter {other:?}"));
                Ok(())
            }
        }
    }

    fn checked_light(&mut self, e: &Element, place: DVec3, light: Light) -> Result<()> {
        light.check().map_err(|m| e.error(m))?;
        self.add_light(place, light);
        Ok(())
    }

    fn environment(&mut self, e: &Element, environment: Environment) -> Result<()> {
        if self.scene.environment.is_some() {
            return Err(e.error("a second environment; a scene has one"));
        }
        self.scene.environment = Some(Arc::new(environment));
        Ok(())
    }

    pub(super) fn sensor(&mut self, e: &'a Element) -> Result<()> {
        let kind = e.kind();
        if !matches!(kind, "perspective" | "thinlens" | "orthographic") {
            self.leave_out(format!("sensor {kind:?}"));
            return Ok(());
        }
        let world = e.transform("to_world")?;
        if DMat3::from_mat4(world).determinant() < 0.0 {
            self.leave_out("mirroring by the transform of a sensor");
        }
        let resolution = self.film(e)?;
        for name in ["principal_point_offset_x", "principal_point_offset_y"] {
            if e.number(name)?.is_some_and(|offset| offset != 0.0) {
                self.leave_out("the offset of the principal point (the image is centred)");
            }
        }
        let forward = world.transform_vector3(DVec3::Z).normalize();
        let up = world.transform_vector3(DVec3::Y).normalize();
        let lens = kind == "thinlens";
        // It sees from -1 to 1 across, as wide as its transform scales that.
        let parallel = kind == "orthographic";
        let [across, upwards] = [DVec3::X, DVec3::Y].map(|axis| world.transform_vector3(axis).length());
        let aspect = f64::from(resolution[0]) / f64::from(resolution[1]);
        if parallel && (across - upwards).abs() > 1e-4 * across {
            return Err(e.error("the transform of an orthographic sensor must scale its width and height alike"));
        }
        let focus = if lens { e.number("focus_distance")? } else { None };
        let camera = Camera {
            eye: Vec3::ZERO,
            target: (forward * f64::from(focus.unwrap_or(1.0))).as_vec3(),
            up: up.as_vec3(),
            fov_y: if parallel { Camera::default_fov() } else { vertical_angle(e, resolution)? },
            resolution,
            aperture: if lens { 2.0 * e.number("aperture_radius")?.unwrap_or(0.0) } else { 0.0 },
            focus,
            shutter: 0.0,
            height: parallel.then_some((2.0 * across / aspect) as f32),
            frustum: None,
        };
        camera.check().map_err(|m| e.error(m))?;
        self.add_camera(world.w_axis.truncate(), NamedCamera { name: e.label(), camera });
        Ok(())
    }

    fn film(&mut self, sensor: &'a Element) -> Result<[u32; 2]> {
        let Some(film) = self.child(sensor, "film")? else { return Ok(FILM) };
        if ["crop_width", "crop_height"].iter().any(|name| film.property(name).is_some()) {
            self.leave_out("the crop of a film (the whole image is shown)");
        }
        let mut size = FILM;
        for (pixels, name) in size.iter_mut().zip(["width", "height"]) {
            if let Some(n) = film.integer(name)? {
                *pixels = u32::try_from(n).map_err(|_| film.error(format!("{name} {n} is negative")))?;
            }
        }
        if size.contains(&0) {
            return Err(film.error("a film without pixels"));
        }
        Ok(size)
    }
}

/// Axes of an environment in the world.
fn turned(e: &Element, world: DMat4, axes: [DVec3; 3]) -> Result<[Vec3; 3]> {
    let axes = axes.map(|axis| world.transform_vector3(axis).normalize());
    let skew = axes[0].dot(axes[1]).abs() + axes[1].dot(axes[2]).abs() + axes[2].dot(axes[0]).abs();
    if skew > 1e-3 {
        return Err(e.error("the transform of an environment must be a rotation"));
    }
    Ok(axes.map(|axis| axis.as_vec3()))
}

/// Full vertical angle of view, degrees.
fn vertical_angle(e: &Element, [width, height]: [u32; 2]) -> Result<f32> {
    let (w, h) = (f64::from(width), f64::from(height));
    let diagonal = w.hypot(h);
    let (angle, axis) = match e.number("fov")? {
        Some(fov) => (f64::from(fov), e.string("fov_axis").unwrap_or("x")),
        None => {
            // Of a frame of 36 mm by 24 mm.
            let length = e.string("focal_length").unwrap_or("50mm").trim().trim_end_matches("mm").trim();
            let length: f64 = length.parse().map_err(|_| e.error(format!("focal_length {length:?} is no length")))?;
            (2.0 * (0.5 * 36.0f64.hypot(24.0) / length).atan().to_degrees(), "diagonal")
        }
    };
    if !(angle > 0.0 && angle < 180.0) {
        return Err(e.error(format!("fov {angle} must lie between 0 and 180 degrees")));
    }
    let size = match axis {
        "x" => w,
        "y" => h,
        "diagonal" => diagonal,
        "smaller" => w.min(h),
        "larger" => w.max(h),
        other => return Err(e.error(format!("fov_axis {other:?} is not x, y, diagonal, smaller or larger"))),
    };
    let tangent = (0.5 * angle.to_radians()).tan() * h / size;
    Ok((2.0 * tangent.atan()).to_degrees() as f32)
}

/// Half angle of the full cone of our spot that has the power of Mitsuba's, whose intensity falls linearly with the angle from
/// `beam` to `outer`; ours falls as the square of the cosine's share.
fn inner_angle(beam: f32, outer: f32) -> f32 {
    let (beam, outer) = (f64::from(beam), f64::from(outer));
    let theirs = power(|theta| ((outer - theta) / (outer - beam).max(1e-9)).clamp(0.0, 1.0), outer);
    let ours = |inner: f64| {
        let (from, to) = (outer.cos(), inner.cos());
        power(|theta| ((theta.cos() - from) / (to - from).max(1e-12)).clamp(0.0, 1.0).powi(2), outer)
    };
    let (mut low, mut high) = (0.0, outer * (1.0 - 1e-4));
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if ours(middle) < theirs { low = middle } else { high = middle }
    }
    low as f32
}

/// Power over 2 pi of an intensity by angle from the axis.
fn power(intensity: impl Fn(f64) -> f64, outer: f64) -> f64 {
    const STEPS: u32 = 512;
    let step = outer / f64::from(STEPS);
    let ring = |i: u32| {
        let theta = (f64::from(i) + 0.5) * step;
        intensity(theta) * theta.sin() * step
    };
    (0..STEPS).map(ring).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spots_keep_their_power() {
        for (beam, outer) in [(0.3f32, 0.4f32), (0.0, 1.2), (0.2, 0.9), (0.999, 1.0)] {
            let inner = inner_angle(beam, outer);
            assert!(inner >= 0.0 && inner < outer, "{inner}");
            let (b, o, i) = (f64::from(beam), f64::from(outer), f64::from(inner));
            let theirs = power(|t| ((o - t) / (o - b)).clamp(0.0, 1.0), o);
            let ours = power(|t| ((t.cos() - o.cos()) / (i.cos() - o.cos())).clamp(0.0, 1.0).powi(2), o);
            assert!((ours / theirs - 1.0).abs() < 2e-3, "{beam} {outer}: {ours} {theirs}");
        }
    }
}
