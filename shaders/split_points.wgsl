// Turns the last hits of second and third components of eye paths into shading points. See pass/split_points.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "point.wgsl"
#include "surface.wgsl"
#include "clusters.wgsl"
#include "write_point.wgsl"
#include "end_eye_path.wgsl"

@group(0) @binding(12) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(15) var<storage, read_write> work_out: DispatchCounts;
@group(0) @binding(16) var<storage, read> point_step: PointStep;
@group(0) @binding(17) var<storage, read> tiles: array<u32>;
@group(0) @binding(18) var<storage, read_write> work: DispatchCounts;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x + group.y * groups.x;
    let count = atomicLoad(&work.live);
    if index >= count {
        return;
    }
    let ordered = point_step.order != ORDER_ANY;
    let by_screen = point_step.order == ORDER_SCREEN;
    // The tiles of second components follow those of all pixels, and then those of third ones.
    let across = (frame.size.xy + 7u) / 8u;
    let first_tile = across.x * across.y;
    if ordered && index == 0u && lane == 0u {
        work_out.total = 64u * (first_tile + (point_step.components - 1u) * count);
    }
    let at = pixel_of_tile(tiles[index], lane);
    let inside = at.x < frame.size.x && at.y < frame.size.y;
    for (var component = 1u; component < point_step.components; component += 1u) {
        let of_tile = first_tile + (component - 1u) * count + index;
        let place = select(64u * of_tile + lane, component * place_count() + place_of(at), by_screen);
        if !inside {
            if ordered && !by_screen {
                list_out[place] = NO_POINT;
            }
            continue;
        }
        let slot = component * frame.size.z + at.x + at.y * frame.size.x;
        // A path that did not split has no further component, and no ray.
        let has_ray = carries(throughput[slot].xyz);
        let hit = select(vec4<f32>(0.0, 0.0, 0.0, bitcast<f32>(0xffffffffu)), hits[slot], has_ray);
        let ray = select(vec4<f32>(0.0), ray_direction[slot], has_ray);
        let lit = end_eye_path(slot, ray, hit, point_step.last != 0u);
        list_point(slot, lit, ordered, place);
    }
}
