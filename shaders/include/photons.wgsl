// Caustic photons and the hash grid that they are found in. Needs frame.wgsl and math.wgsl. CPU twins: pass::photon_start,
// pass::photon_grid.

// Photons are interleaved by class: photon i of class k is i * classes + k.
fn photon_class(photon: u32) -> u32 {
    return divided(photon, frame.pattern.z).y;
}

// A photon is aimed at target aim - 1, or at triangle aim - NO_TARGET. Host twin: light::targets::MAX_TARGETS + 1.
const NO_TARGET: u32 = 65u;

// Whether a photon with this aim counts when it first meets a triangle, which belongs to this target.
fn meets_aim(triangle: u32, of_target: u32, aim: u32) -> bool {
    return select(aim == of_target, aim - NO_TARGET == triangle, aim >= NO_TARGET);
}

// In place of the bounces of the light that a photon left: it comes from an emitter without area, which no path from the eye meets.
// Host twin: pass::photon_start::WITHOUT_AREA.
const WITHOUT_AREA: f32 = 0.5;

// Number of photons of a pass.
fn photon_count() -> u32 {
    return frame.photons.x * frame.pattern.z;
}

// The class by which the grid keeps photons apart.
fn grid_class(of_class: u32) -> u32 {
    return select(of_class, 0u, (frame.keys.z & 4u) != 0u);
}

// Code of a cell of the grid, of size 2r, and a class. Codes of the 8 cells around a point differ for any two classes, because no
// sum of some of the factors equals another.
fn code_of(cell: vec3<i32>, photon_class: u32) -> u32 {
    let c = bitcast<vec3<u32>>(cell);
    return c.x * 0x9e3779b1u + c.y * 0x85ebca77u + c.z * 0xc2b2ae3du + photon_class * 0x27d4eb2fu;
}

// A position in cells, clamped to the range of integers.
fn in_cells(p: vec3<f32>) -> vec3<f32> {
    return clamp(p * frame.photon.y, vec3<f32>(-1e9), vec3<f32>(1e9));
}

// Bucket of the hash table.
fn bucket_of(code: u32) -> u32 {
    return hash(code) & frame.photons.w;
}

// The first of the 8 cells that a look-up at a point visits: a ball of radius r meets two cells of size 2r along each axis.
fn first_cell(p: vec3<f32>) -> vec3<i32> {
    return vec3<i32>(floor(in_cells(p) - 0.5));
}

// Bit for the look-ups of a class that begin in a cell, among 16 for each bucket.
fn near_bit(first: vec3<i32>, photon_class: u32) -> u32 {
    return hash(code_of(first, photon_class)) & (frame.photons.w << 4u | 15u);
}
