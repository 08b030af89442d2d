// The mirror image on glossy planes, and the kernel that spreads each of its pixels. See pass/mirror_image.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "reflectors.wgsl"

@group(0) @binding(1) var<storage, read> receiver_position: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> receiver_geometric: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> receiver_kd: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> receiver_wo: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> throughput: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> work: Work;
@group(0) @binding(11) var<storage, read> tiles: array<u32>;
@group(0) @binding(12) var<storage, read> region: array<u32>;
@group(0) @binding(18) var<storage, read_write> core_footprint: array<vec4<f32>>; // the same for the peak of the kernel
@group(0) @binding(17) var<storage, read> widening: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> source: array<vec4<f32>>;     // radiance; w: depth of what is seen
@group(0) @binding(16) var<storage, read_write> footprint: array<vec4<f32>>;  // of the tail: diameter, texture, direction of the kernel's u axis

// Radius of the core over that of the whole kernel.
const CORE_RADIUS: f32 = 0.3;
// Farther than everything.
const NOTHING_SEEN: f32 = 3.0e38;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x + group.y * groups.x;
    if index >= atomicLoad(&work.live) {
        return;
    }
    let across = (frame.size.x + 7u) / 8u;
    let at = vec2<u32>(8u * (tiles[index] % across) + (lane & 7u), 8u * (tiles[index] / across) + lane / 8u);
    if at.x >= frame.size.x || at.y >= frame.size.y {
        return;
    }
    let pixel = at.x + at.y * frame.size.x;
    let slot = pixel + frame.size.z;
    let plane = region[pixel];
    if plane == 0u {
        return;
    }
    let through = throughput[slot];
    let lit = receiver_wo[slot].w > 0.0;
    let reflected = receiver_kd[slot].xyz * INV_PI * (direct[slot].xyz + indirect[slot].xyz) + specular[slot].xyz;
    let l = emitted[slot].xyz + select(vec3<f32>(0.0), through.xyz * reflected, lit);
    // This second component is no part of the pixel by itself.
    emitted[slot] = vec4<f32>(0.0);
    throughput[slot] = vec4<f32>(0.0, 0.0, 0.0, through.w);

    let found = receiver_position[slot].w >= 0.0;
    let wo = receiver_wo[pixel].xyz;
    let normal = receiver_geometric[pixel].xyz;
    let mu = dot(normal, wo);
    let tail = tail_of(reflectors[plane - 1u].x, mu);
    let tan_beta = lobe_at(reflectors[plane - 1u].x, mu).x;
    // What the eye sees of the disc at the reflected point: tan(beta) z_r / (t + z_r), from each plane on the way. Far away only the
    // angles count.
    let more = widening[pixel];
    let end = select(NOTHING_SEEN, through.w, found);
    let own = tan_beta * (1.0 - throughput[pixel].w / end);
    let others = more.x + (more.z / end - 2.0 * more.y) / end;
    let half = sqrt(own * own + max(others, 0.0));

    // Behind the plane the virtual image goes on in the direction of the ray. The kernel's u axis, which points from the mirror
    // direction to the normal, is mirrored as well.
    let d = -wo;
    let u = mu * wo - normal;
    let right = frame.right.xyz / dot(frame.right.xyz, frame.right.xyz);
    let up = frame.up.xyz / dot(frame.up.xyz, frame.up.xyz);
    let f = dot(d, frame.forward.xyz);
    let g = dot(u, frame.forward.xyz);
    let size = vec2<f32>(frame.size.xy);
    let moved = vec2<f32>(dot(u, right) * f - dot(d, right) * g, dot(d, up) * g - dot(u, up) * f) * size;
    let length2 = dot(moved, moved);
    let axis = select(vec2<f32>(1.0, 0.0), moved / sqrt(length2), length2 > 1e-20);
    // Pixels for a unit of length at unit distance, the mean of both directions.
    let scale = 0.5 * size.y * sqrt(dot(up, up)) / (f * sqrt(f));
    let diameter = 4.0 * half * scale;
    source[pixel] = vec4<f32>(l, end);
    footprint[pixel] = vec4<f32>(diameter, f32(tail), axis);
    core_footprint[pixel] = vec4<f32>(CORE_RADIUS * diameter, f32(tail + VIEW_ANGLES), axis);
}
