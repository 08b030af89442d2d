//! Tables of lobes for tests, each made once.

use std::f32::consts::{PI, TAU};
use std::sync::{Arc, OnceLock};

use crate::bsdf::Reflectance;
use crate::superposition::lobe::Table;
use glam::Vec3;

/// Even steps of the angle from grazing on.
fn cosines(count: usize) -> Vec<f32> {
    (0..count).map(|i| (0.5 * PI * i as f32 / (count - 1) as f32).sin().min(1.0)).collect()
}

/// Azimuths, dense towards the plane of mirror reflection.
fn azimuths(count: usize) -> Vec<f32> {
    (0..count).map(|i| PI * (1.0 - (1.0 - i as f32 / (count - 1) as f32).powi(2))).collect()
}

/// The values of GGX at `count` nodes of each axis.
pub fn ggx(alpha: f32, count: usize) -> Arc<Table> {
    let lobe = Reflectance { kd: Vec3::ZERO, f0: Vec3::ONE, f90: 1.0, alpha };
    let f = |wi: Vec3, wo: Vec3| {
        // GGX has no bound towards the horizon.
        let [wi, wo] = [wi, wo].map(|w| Vec3::new(w.x, w.y, w.z.max(1e-3)).normalize());
        lobe.eval_specular(&[], Vec3::Z, wi, wo).x
    };
    Arc::new(Table::tabulate(&cosines(count), &azimuths(count), f).unwrap())
}

/// A narrow lobe.
pub fn narrow() -> Arc<Table> {
    static TABLE: OnceLock<Arc<Table>> = OnceLock::new();
    TABLE.get_or_init(|| ggx(0.15, 49)).clone()
}

/// A lobe about the direction that light comes from.
pub fn retro_reflective() -> Arc<Table> {
    static TABLE: OnceLock<Arc<Table>> = OnceLock::new();
    let f = |wi: Vec3, wo: Vec3| 0.8 * 12.0 / TAU * wi.dot(wo).max(0.0).powi(11);
    let turned = azimuths(33).into_iter().rev().map(|a| (PI - a).max(0.0)).collect::<Vec<_>>();
    TABLE.get_or_init(|| Arc::new(Table::tabulate(&cosines(33), &turned, f).unwrap())).clone()
}

/// A lobe that is brightest where the half vector leans 26 degrees from the normal: a ring about the mirror direction.
pub fn off_specular() -> Arc<Table> {
    static TABLE: OnceLock<Arc<Table>> = OnceLock::new();
    let f = |wi: Vec3, wo: Vec3| {
        let lean = (wi + wo).normalize_or(Vec3::X).z.clamp(0.0, 1.0).acos();
        0.3 * (-((lean - 0.45) / 0.15).powi(2)).exp()
    };
    let azimuths: Vec<f32> = (0..33).map(|i| PI * i as f32 / 32.0).collect();
    TABLE.get_or_init(|| Arc::new(Table::tabulate(&cosines(33), &azimuths, f).unwrap())).clone()
}
