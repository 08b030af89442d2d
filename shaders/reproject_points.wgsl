// Projects the points of images with depth to the pixels of their reflectors: the least depth, or with COLOR the first point that has it.
// See pass/reproject.rs.
#include "frame.wgsl"
#include "reproject.wgsl"

@group(0) @binding(1) var<storage, read> depth_points: array<vec4<f32>>;    // radiance, depth; below 0: no colour; 0: no point
@group(0) @binding(2) var<storage, read> depth_views: array<DepthView>;
@group(0) @binding(3) var<storage, read> depth_tiles: array<DepthTile>;
@group(0) @binding(4) var<storage, read> reproject_counts: array<u32>;      // tiles, ...
@group(0) @binding(5) var<storage, read> region: array<u32>;
#if COLOR
@group(0) @binding(6) var<storage, read> nearest: array<u32>;
@group(0) @binding(7) var<storage, read_write> chosen: array<atomic<u32>>;
#else
@group(0) @binding(6) var<storage, read_write> nearest: array<atomic<u32>>;
#endif

// Beyond every image, and exact as a float.
const FAR: f32 = 1048576.0;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x + group.y * groups.x;
    if index >= reproject_counts[0] {
        return;
    }
    let tile = depth_tiles[index];
    let view = depth_views[tile.view];
    let at = vec2<u32>(tile.corner & 0xffffu, tile.corner >> 16u) + vec2<u32>(lane & 7u, lane >> 3u);
    let inside = at.x < view.points.y && at.y < view.points.z;
    let kept = ((at.x | at.y) & (tile.step - 1u)) == 0u;
    let point = view.points.x + select(0u, at.x + at.y * view.points.y, inside);
    let depth = abs(depth_points[point].w);
    let q = vec3<f32>(depth * (f32(at.x) + 0.5), depth * (f32(at.y) + 0.5), depth);
    let x = view.x.x * q.x + view.x.y * q.y + view.x.z * q.z + view.x.w;
    let y = view.y.x * q.x + view.y.y * q.y + view.y.z * q.z + view.y.w;
    let z = view.z.x * q.x + view.z.y * q.y + view.z.z * q.z + view.z.w;
    let counts = inside && kept && depth > 0.0 && z > 0.0;
    // The pixels whose samples lie in the box around the point.
    let extent = vec2<u32>(tile.size & 0xffffu, tile.size >> 16u);
    let middle = vec2<f32>(x, y) / select(1.0, z, counts) - frame.pixel_offset.xy;
    let first = vec2<i32>(floor(clamp(middle - 0.5 * vec2<f32>(extent) + 1.0, vec2<f32>(-FAR), vec2<f32>(FAR))));
    let size = vec2<i32>(frame.size.xy);
    let total = select(0u, extent.x * extent.y, counts);
    for (var i = 0u; i < total; i += 1u) {
        let pixel = first + vec2<i32>(vec2<u32>(i % extent.x, i / extent.x));
        let away = vec2<f32>(pixel) - middle;
        let s = tile.inside.x * away.x + tile.inside.y * away.y;
        let t = tile.inside.z * away.x + tile.inside.w * away.y;
        let covers = max(abs(s), abs(t)) <= 1.0 && all(pixel >= vec2<i32>(0)) && all(pixel < size);
        let slot = select(0u, u32(pixel.x + pixel.y * size.x), covers);
        if covers && region[slot] == view.points.w {
#if COLOR
            if nearest[slot] == bitcast<u32>(z) {
                atomicMin(&chosen[slot], point);
            }
#else
            // The bits of floats above 0 are in their order.
            atomicMin(&nearest[slot], bitcast<u32>(z));
#endif
        }
    }
}
