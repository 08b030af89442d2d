//! Emitters of surfaces, lights and parts of an environment.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use super::{Emitter, Kind};
use crate::accel::unit_normal;
use crate::bsdf::basis;
use crate::light::cosine::exitance;
use crate::scene::environment::Patch;
use crate::scene::{Environment, Light, Material, Scene};

/// An emitter with everything at 0 but its kind and place.
fn blank(kind: Kind, p0: Vec3) -> Emitter {
    Emitter {
        kind,
        p0,
        e1: Vec3::ZERO,
        e2: Vec3::ZERO,
        normal: Vec3::Z,
        radiance: Vec3::ZERO,
        area: 0.0,
        two_sided: false,
        inward: false,
        power: Vec3::ZERO,
        probability: 0.0,
        exponent: 1.0,
        pattern: None,
    }
}

/// A triangle or quad: Phi = 2 pi / (d + 1) L A, twice that if both sides emit.
pub(super) fn of_surface(kind: Kind, [p0, e1, e2]: [Vec3; 3], material: &Material) -> Emitter {
    let Material { emission: radiance, two_sided, emission_exponent: exponent, .. } = *material;
    let parallelogram = e1.cross(e2).length();
    let area = if kind == Kind::Quad { parallelogram } else { 0.5 * parallelogram };
    let sides = if two_sided { 2.0 } else { 1.0 };
    let power = radiance * (exitance(exponent) * area * sides);
    Emitter { e1, e2, normal: unit_normal(e1, e2), radiance, area, two_sided, power, exponent, ..blank(kind, p0) }
}

pub(super) fn of_light(scene: &Scene, light: &Light) -> Emitter {
    match *light {
        Light::Point { position, intensity } => {
            Emitter { radiance: intensity, power: intensity * (4.0 * PI), ..blank(Kind::Point, position) }
        }
        Light::Spot { position, direction, intensity, inner, outer } => {
            let (inner, outer) = (inner.cos(), outer.cos());
            Emitter {
                e1: Vec3::new(inner, outer, 0.0),
                normal: direction,
                radiance: intensity,
                power: intensity * (TAU * ((1.0 - inner) + (inner - outer) * (1.0 / 3.0))),
                ..blank(Kind::Spot, position)
            }
        }
        Light::Directional { direction, irradiance } => {
            let (low, high) = bounds(scene);
            // Half the diagonal reaches every point of the box.
            let radius = 0.5 * (high - low).length();
            let (t, b) = basis(direction);
            let area = PI * radius * radius;
            Emitter {
                e1: t * radius,
                e2: b * radius,
                normal: direction,
                radiance: irradiance,
                area,
                power: irradiance * area,
                ..blank(Kind::Directional, (low + high) * 0.5 - direction * radius)
            }
        }
        Light::Sphere { center, radius, radiance, inward, object: _ } => {
            let area = 4.0 * PI * radius * radius;
            Emitter {
                e1: Vec3::new(radius, 0.0, 0.0),
                radiance,
                area,
                inward,
                power: radiance * (PI * area),
                ..blank(Kind::Sphere, center)
            }
        }
        Light::Imported { position, normal, power, exponent } => {
            Emitter { normal, radiance: power, power, exponent, ..blank(Kind::Imported, position) }
        }
    }
}

/// A part of an environment: Phi = L Omega pi R^2 through the disc of the scene.
pub(super) fn of_patch(scene: &Scene, environment: &Environment, patch: &Patch) -> Emitter {
    let (low, high) = bounds(scene);
    let radius = 0.5 * (high - low).length();
    let ([azimuth, around], [cosine, down]) = (patch.azimuth, patch.cosine);
    Emitter {
        e1: Vec3::new(azimuth, around, cosine),
        e2: Vec3::new(down, radius, 0.0),
        normal: -environment.direction(azimuth + 0.5 * around, cosine + 0.5 * down),
        radiance: patch.radiance,
        area: patch.solid_angle,
        power: patch.radiance * (patch.solid_angle * PI * radius * radius),
        ..blank(Kind::Environment, (low + high) * 0.5)
    }
}

/// Corners of the bounding box of all triangles.
fn bounds(scene: &Scene) -> (Vec3, Vec3) {
    let corners = scene.triangles.iter().flat_map(|t| t.vertices).map(|v| scene.positions[v as usize]);
    corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
}
