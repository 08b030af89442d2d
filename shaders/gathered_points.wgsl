// Turns the hits of gather rays into shading points. See pass/gathered_points.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "point.wgsl"
#include "surface.wgsl"
#include "write_point.wgsl"

@group(0) @binding(12) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(15) var<storage, read_write> work_out: DispatchCounts;
@group(0) @binding(16) var<storage, read> point_step: PointStep;
@group(0) @binding(17) var<storage, read> list_in: array<u32>;
@group(0) @binding(18) var<storage, read_write> work_in: DispatchCounts;
@group(0) @binding(19) var<storage, read_write> beta: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
    let count = atomicLoad(&work_in.live);
    if index >= count {
        return;
    }
    let ordered = point_step.order != ORDER_ANY;
    if ordered && index == 0u {
        work_out.total = count;
    }
    let slot = list_in[index];
    let ray = ray_direction[slot];
    let met = gathered_by(ray.xyz, hits[slot]);
    // The share of light that clipping removed.
    let share = max(1.0 - met.t * met.t / max(frame.right.w, 1e-37), 0.0);
    let weight = select(0.0, share, met.found);
    let before = beta[slot];
    emitted[slot] = vec4<f32>(before.xyz * met.surface.emission * weight * ray.w, 0.0);
    beta[slot] = vec4<f32>(before.xyz * weight, before.w);
    // The last points only emit: light that they reflect would exceed the greatest path length.
    let sends = reflects(met);
    let lit = weight > 0.0 && sends && point_step.last == 0u;
    write_point(slot, met, flag_if(LIT, lit));
    list_point(slot, lit, ordered, index);
}
