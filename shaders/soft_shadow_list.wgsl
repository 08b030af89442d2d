// Lists the pixels that have soft shadows, tile by tile, and writes the centres of the emitters. See pass/soft_shadow.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "flags.wgsl"
#include "emitters.wgsl"
#include "lights.wgsl"
#include "soft_shadows.wgsl"

@group(0) @binding(1) var<storage, read> emitters: array<EmitterRecord>;
@group(0) @binding(2) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(4) var<storage, read_write> work_out: DispatchCounts;
@group(0) @binding(5) var<storage, read_write> lights: array<PointLight>;
@group(0) @binding(6) var<storage, read_write> soft_emitters: array<vec4<f32>>;     // six for each, see soft_emitter.wgsl

// One invocation for each tile of 8 x 8 pixels.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = (group.x + group.y * groups.x) * 64u + lane;
    let zero = vec4<f32>(0.0);
    if tile < frame.soft.x {
        let e = emitters[frame.soft_emitters[tile / 4u][tile & 3u]];
        let centre = offset_origin(e.p0.xyz + 0.5 * (e.e1.xyz + e.e2.xyz), e.normal.xyz, frame.eye.w);
        lights[tile] = PointLight(vec4<f32>(centre, 0.0), zero, zero, zero, zero, zero);
        soft_emitters[6u * tile] = vec4<f32>(centre, e.e1.w);
        soft_emitters[6u * tile + 1u] = vec4<f32>(e.e1.xyz, e.flux.w);
        soft_emitters[6u * tile + 2u] = e.e2;
        soft_emitters[6u * tile + 3u] = e.normal;
        soft_emitters[6u * tile + 4u] = e.p0;
        soft_emitters[6u * tile + 5u] = e.radiance;
    }
    let tiles = (frame.size.xy + 7u) / 8u;
    if tile >= tiles.x * tiles.y {
        return;
    }
    let part = part_of_tile(tile);
    var some = NO_POINT;
    for (var y = part.y; y < part.y + part.w; y += 1u) {
        for (var x = part.x; x < part.x + part.z; x += 1u) {
            let pixel = x + y * frame.size.x;
            some = min(some, select(NO_POINT, pixel, has_flag(point_wo[pixel].w, SOFT)));
        }
    }
    if some == NO_POINT {
        return;
    }
    // Clusters of rays have no gaps: pixels without soft shadows repeat another one.
    let first = atomicAdd(&work_out.live, 64u);
    for (var i = 0u; i < 64u; i += 1u) {
        let at = pixel_of_tile(tile, i);
        let inside = all(at < frame.size.xy);
        let pixel = select(some, at.x + at.y * frame.size.x, inside);
        list_out[first + i] = select(some, pixel, has_flag(point_wo[pixel].w, SOFT));
    }
}
