// Starts rays at the pixels at edges. See pass/edges.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "camera.wgsl"
#include "edge_rays.wgsl"
#include "edge_rounds.wgsl"

@group(0) @binding(1) var<storage, read_write> edges: array<u32>;   // not 0: at an edge, see edge_rounds.wgsl
@group(0) @binding(2) var<storage, read_write> marks: array<u32>;   // rays of each tile
@group(0) @binding(3) var<storage, read_write> ray_pixel: array<u32>;
@group(0) @binding(4) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(5) var<storage, read_write> work_out: DispatchCounts;
@group(0) @binding(6) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> ray_direction: array<vec4<f32>>;
var<immediate> push: Push;  // number of the round

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = (group.x + group.y * groups.x) * 64u + lane;
    let tiles = (frame.size.xy + 7u) / 8u;
    if tile >= tiles.x * tiles.y {
        return;
    }
    let part = part_of_tile(tile);
    let count = part.z * part.w;
    var marked = 0u;
    var between_surfaces = 0u;
    for (var i = 0u; i < count; i += 1u) {
        let word = edges[ray_of_tile(part, i)];
        marked += select(0u, 1u, word != 0u);
        between_surfaces += select(0u, 1u, rays_in_round(1u, word) > 0u);
    }
    let first = min(count / max(marked, 1u), MAX_RAYS);
    // In passes in which the rays do not count in full one round does.
    let more = min(count / max(between_surfaces, 1u), MAX_RAYS - first);
    let second = select(0u, more, weight_in_pass() == 1.0);
    let live = select(second * between_surfaces, first * marked, push.step == 0u);
    marks[tile] = live;
    if live == 0u {
        return;
    }
    let listed = atomicAdd(&work_out.live, live);
    var rays = 0u;
    for (var i = 0u; i < count; i += 1u) {
        let pixel = ray_of_tile(part, i);
        let before = edges[pixel];
        if before != 0u {
            let word = edge_word(first, rays, before, select(0u, second, rays_in_round(1u, before) > 0u));
            edges[pixel] = word;
            let at = place_of_pixel(pixel);
            let now = rays_in_round(push.step, word);
            for (var k = 0u; k < now; k += 1u) {
                let ray = ray_of_tile(part, rays + k);
                let offset = offset_in_round(push.step, k, word);
                let through = ray_through(f32(at.x + frame.within.x) + offset.x, f32(at.y + frame.within.y) + offset.y);
                let d = through.d;
                ray_origin[ray] = vec4<f32>(frame.eye.xyz + through.start, 3.0e38);
                ray_direction[ray] = vec4<f32>(d / sqrt(dot(d, d)), 0.0);
                ray_pixel[ray] = pixel;
                list_out[listed + rays + k] = ray;
            }
            rays += now;
        }
    }
}
