// Starts rays at the pixels at edges. See pass/edges.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "camera.wgsl"
#include "edge_rays.wgsl"

@group(0) @binding(1) var<storage, read_write> edges: array<u32>;   // 1 at edges, then 16 * first ray of the tile + rays
@group(0) @binding(2) var<storage, read_write> marks: array<u32>;   // rays of each tile
@group(0) @binding(3) var<storage, read_write> ray_pixel: array<u32>;
@group(0) @binding(4) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(5) var<storage, read_write> work_out: DispatchCounts;
@group(0) @binding(6) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> ray_direction: array<vec4<f32>>;

// Host twin: pass::edges::MAX_RAYS.
const MAX_RAYS: u32 = 8u;

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
    for (var i = 0u; i < count; i += 1u) {
        marked += edges[ray_of_tile(part, i)];
    }
    let each = min(count / max(marked, 1u), MAX_RAYS);
    marks[tile] = each * marked;
    if marked == 0u {
        return;
    }
    let listed = atomicAdd(&work_out.live, each * marked);
    var rays = 0u;
    for (var i = 0u; i < count; i += 1u) {
        let pixel = ray_of_tile(part, i);
        if edges[pixel] != 0u {
            edges[pixel] = 16u * rays + each;
            let at = place_of_pixel(pixel);
            for (var k = 0u; k < each; k += 1u) {
                let ray = ray_of_tile(part, rays + k);
                let offset = ray_offset(k, each);
                let through = ray_through(f32(at.x + frame.within.x) + offset.x, f32(at.y + frame.within.y) + offset.y);
                let d = through.d;
                ray_origin[ray] = vec4<f32>(frame.eye.xyz + through.start, 3.0e38);
                ray_direction[ray] = vec4<f32>(d / sqrt(dot(d, d)), 0.0);
                ray_pixel[ray] = pixel;
                list_out[listed + rays + k] = ray;
            }
            rays += each;
        }
    }
}
