// A point on a surface for each texel, as if a ray had met it along its normal. See pass/atlas.rs.
// RESTS: none for most of the blocks that have had no light so far.
#include "frame.wgsl"

@group(0) @binding(1) var<storage, read> texels: array<vec4<u32>>;         // triangle (none: all ones), bits of u and v, 1 from the back
@group(0) @binding(2) var<storage, read> triangle_e1: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> triangle_e2: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> hits: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> throughput: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> emitted: array<vec4<f32>>;

#if RESTS
@group(0) @binding(8) var<storage, read> sum_direct: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> sum_indirect: array<vec4<f32>>;

// Host twins: pass::atlas::{FIRST, TURNS}.
const FIRST: u32 = 4u;
const TURNS: u32 = 4u;

var<workgroup> lit: atomic<u32>;
#endif

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x + group.y * groups.x;
#if RESTS
    // A workgroup takes a block of 8 x 8 texels.
    let across = frame.size.x / 8u;
    let at = 8u * vec2<u32>(index % across, index / across) + vec2<u32>(lane & 7u, lane / 8u);
    let slot = at.x + at.y * frame.size.x;
    let inside = at.y < frame.size.y;
    let place = select(0u, slot, inside);
    if lane == 0u {
        atomicStore(&lit, 0u);
    }
    workgroupBarrier();
    if inside && any(sum_direct[place].xyz + sum_indirect[place].xyz > vec3<f32>(0.0)) {
        atomicStore(&lit, 1u);
    }
    workgroupBarrier();
    let rests = atomicLoad(&lit) == 0u && frame.size.w >= FIRST && (frame.size.w + index) % TURNS != 0u;
#else
    let slot = index * 64u + lane;
    let inside = slot < frame.size.z;
    let rests = false;
#endif
    if !inside {
        return;
    }
    let texel = texels[slot];
    let covered = texel.x != 0xffffffffu && !rests;
    let triangle = select(0u, texel.x, covered);
    let face = cross(triangle_e1[triangle].xyz, triangle_e2[triangle].xyz);
    // The largest component first: squares of small faces would underflow.
    let scaled = face / max(max(abs(face.x), abs(face.y)), max(abs(face.z), 1e-37));
    let normal = scaled / sqrt(dot(scaled, scaled));
    hits[slot] = vec4<f32>(select(0.0, 1.0, covered), bitcast<f32>(texel.y), bitcast<f32>(texel.z), bitcast<f32>(texel.x));
    ray_direction[slot] = vec4<f32>(select(-normal, normal, texel.w != 0u), 1.0);
    throughput[slot] = vec4<f32>(1.0, 1.0, 1.0, 0.0);
    emitted[slot] = vec4<f32>(0.0);
}
