// Widens the radius of the look-up where few photons were stored, and narrows it where many were. See pass/photon_radius.rs.
// It writes the parameters that other kernels read, so it declares them itself.
#include "frame_parameters.wgsl"

@group(0) @binding(0) var<storage, read_write> frame: FrameParameters;
@group(0) @binding(1) var<storage, read> photon_position: array<vec4<f32>>;     // w: 1 if stored

// Host twins: pass::photon_radius::{EXPECTED, MANY, WIDEST, NARROWEST}.
const EXPECTED: f32 = 0.05;
const MANY: f32 = 0.1;
const WIDEST: f32 = 3.0;
const NARROWEST: f32 = 0.5;

var<workgroup> sums: array<u32, 64>;

@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) lane: u32) {
    let count = frame.photons.x * frame.pattern.z;
    let length = (count + 63u) / 64u;
    let first = min(lane * length, count);
    var own = 0u;
    for (var i = first; i < min(first + length, count); i += 1u) {
        own += select(0u, 1u, photon_position[i].w > 0.0);
    }
    sums[lane] = own;
    workgroupBarrier();
    if lane == 0u && frame.lens.w > 0.0 {
        var stored = 0u;
        for (var k = 0u; k < 64u; k += 1u) {
            stored += sums[k];
        }
        let ratio = f32(count) / f32(max(stored, 1u));
        let wide = clamp(sqrt(EXPECTED * ratio), 1.0, WIDEST) * clamp(sqrt(MANY * ratio), NARROWEST, 1.0);
        frame.photon.x *= wide;
        frame.photon.y /= wide;
        frame.photon.z /= wide * wide;
    }
}
