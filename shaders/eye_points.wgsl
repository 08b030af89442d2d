// Turns the last hit of each pixel's eye path into a shading point. See pass/eye_points.rs.
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

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
    let tiles = (frame.size.xy + 7u) / 8u;
    let total = 64u * tiles.x * tiles.y;
    if index >= total {
        return;
    }
    let ordered = point_step.order != ORDER_ANY;
    let by_screen = point_step.order == ORDER_SCREEN;
    // Clusters count their own places.
    if ordered && !by_screen && index == 0u {
        work_out.total = total;
    }
    // Pixels are taken row by row, in the order of memory, which processors prefetch. An ordered list takes them in tiles of 8 x 8, so
    // that neighbours on it are neighbours in the scene.
    let at = divided(index, 8u * tiles.x).yx;
    let tiled = 64u * (at.x / 8u + at.y / 8u * tiles.x) + 8u * (at.y & 7u) + (at.x & 7u);
    let place = select(tiled, place_of(at), by_screen);
    if at.x >= frame.size.x || at.y >= frame.size.y {
        if ordered && !by_screen {
            list_out[place] = NO_POINT;
        }
        return;
    }
    let slot = at.x + at.y * frame.size.x;
    let lit = end_eye_path(slot, ray_direction[slot], hits[slot], point_step.last != 0u);
    list_point(slot, lit, ordered, place);
}
