//! Emission: emitters and the sampling of particles, targets of photons, planar mirrors.

pub mod cosine;
pub mod emitters;
pub mod mirrors;
pub mod targets;
