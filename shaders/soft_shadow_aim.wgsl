// Aims a ray from a blocked point of each quad of 2 x 2 pixels at the emitter's centre, to find what blocks it. See pass/soft_shadow.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "soft_shadows.wgsl"
#include "soft_emitter.wgsl"

@group(0) @binding(1) var<storage, read> soft_emitter: array<vec4<f32>>;
@group(0) @binding(3) var source: texture_storage_2d<rgba32float, read>;
@group(0) @binding(4) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> ray_direction: array<vec4<f32>>;     // to the centre; w: half extent of the kernel for a ratio of 1
@group(0) @binding(7) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(8) var<storage, read_write> work_out: DispatchCounts;
@group(0) @binding(9) var<storage, read_write> aimed: array<vec4<f32>>;          // blocked point; w: its word, 0: none
@group(0) @binding(10) var<storage, read_write> soft_tiles: array<atomic<u32>>;     // of each tile: reach, ratio (bits), what it shows, 0

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let view = soft_view();
    let light = soft_light();
    let quad = (group.x + group.y * groups.x) * 64u + lane;
    let quads = (frame.size.xy + 1u) / 2u;
    if quad >= quads.x * quads.y {
        return;
    }
    let corner = 2u * divided(quad, quads.x).yx;
    var chosen = NO_POINT;
    var shows = 0u;
    for (var i = 0u; i < 4u; i += 1u) {
        let at = corner + vec2<u32>(i & 1u, i / 2u);
        let inside = all(at < frame.size.xy);
        let pixel = select(0u, at.x + at.y * frame.size.x, inside);
        let word = textureLoad(source, vec2<i32>(select(corner, at, inside))).w;
        shows |= select(0u, select(0u, SHOWS_LIT, is_lit(word)) | select(0u, SHOWS_BLOCKED, is_blocked(word)), inside);
        chosen = min(chosen, select(NO_POINT, pixel, inside && is_blocked(word)));
    }
    let any_blocked = chosen != NO_POINT;
    let pixel = select(0u, chosen, any_blocked);
    let own = textureLoad(source, vec2<i32>(place_of_pixel(pixel)));
    let x = own.xyz;
    let n = point_geometric[pixel].xyz;
    // A pixel beyond each side of the quad, and those of the quad.
    var at_edge = (shows & SHOWS_LIT) != 0u;
    for (var i = select(4u, 0u, any_blocked); i < 4u; i += 1u) {
        let along = select(-2, 3, (i & 1u) != 0u);
        let at = vec2<i32>(corner) + select(vec2<i32>(along, i32(i / 2u)), vec2<i32>(i32(i & 1u), along), i >= 2u);
        let beside = textureLoad(source, clamp(at, vec2<i32>(0), vec2<i32>(frame.size.xy) - 1));
        let lit_beside = is_lit(beside.w) && on_surface(x, n, beside);
        at_edge = at_edge || lit_beside;
    }
    let kernel = soft_kernel(view, light, x, n);
    let word = BLOCKER_FOUND | select(0u, BLOCKER_AT_EDGE, at_edge) | (bitcast<u32>(own.w) & NORMAL_BITS);
    aimed[quad] = select(vec4<f32>(0.0), vec4<f32>(x, bitcast<f32>(word)), any_blocked);
    if shows != 0u {
        atomicOr(&soft_tiles[4u * soft_tile_of(corner) + 2u], shows);
    }
    if any_blocked {
        ray_origin[quad] = vec4<f32>(x, 1.0);
        ray_direction[quad] = vec4<f32>(light.centre - x, half_extent(kernel));
        list_out[atomicAdd(&work_out.live, 1u)] = quad;
    }
}
