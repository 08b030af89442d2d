// Starts rays at the pixels at edges of lamps. See pass/lamp_edges.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "camera.wgsl"
#include "edge_rays.wgsl"
#include "lamp_edges.wgsl"

@group(0) @binding(1) var<storage, read_write> marks: array<u32>;   // of each pixel, see lamp_edges.wgsl
@group(0) @binding(2) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(3) var<storage, read_write> work_out: DispatchCounts;
@group(0) @binding(4) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> media: array<vec4<u32>>;
@group(0) @binding(7) var<storage, read_write> lamp_beta: array<vec4<f32>>;     // throughput; w: depth of the ray's origin
@group(0) @binding(8) var<storage, read_write> lamp_light: array<vec4<f32>>;    // emission so far; w: 1 where the ray has ended in its slot
@group(0) @binding(9) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(10) var<storage, read> tiles: array<u32>;
@group(0) @binding(11) var<storage, read_write> lamp_way: array<u32>;
@group(0) @binding(12) var<storage, read> steps: array<Step>;
var<immediate> push: Push;

// Host twin: pass::lamp_edges::MAX_RAYS.
const MAX_RAYS: u32 = 4u;

var<workgroup> sought: array<u32, 64>;      // number of slots that the rays of each pixel seek
var<workgroup> listed: u32;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x + group.y * groups.x;
    let has_tile = index < atomicLoad(&work.live);
    let slots = steps[push.step].components;
    let part = part_of_tile(tiles[select(0u, index, has_tile)]);
    let count = part.z * part.w;
    let pixel = ray_of_tile(part, min(lane, count - 1u));
    let bits = select(0u, marks[pixel], has_tile && lane < count);
    let own = sought_slots(bits, slots);
    sought[lane] = own;
    workgroupBarrier();
    var before = 0u;
    var all = 0u;
    for (var i = 0u; i < 64u; i += 1u) {
        before += select(0u, sought[i], i < lane);
        all += sought[i];
    }
    // One of them is the pixel's own; alone it says nothing.
    let room = min(count * slots / max(all, 1u), MAX_RAYS + 1u);
    let each = select(0u, room, room > 1u);
    if lane == 0u && all > 0u {
        listed = atomicAdd(&work_out.live, each * all);
    }
    workgroupBarrier();
    if own == 0u {
        return;
    }
    let first = each * before;
    marks[pixel] = 64u * first + 4u * each + bits;
    let at = place_of_pixel(pixel);
    for (var k = 0u; k < each * own; k += 1u) {
        let ray = lamp_ray(part, first + k);
        let of_slot = divided(k, each);
        let offset = select(ray_offset(max(of_slot.y, 1u) - 1u, each - 1u), frame.pixel_offset.xy, of_slot.y == 0u);
        let through = ray_through(f32(at.x + frame.within.x) + offset.x, f32(at.y + frame.within.y) + offset.y);
        let length = sqrt(dot(through.d, through.d));
        ray_origin[ray] = vec4<f32>(frame.eye.xyz + through.start, 3.0e38);
        ray_direction[ray] = vec4<f32>(through.d / length, dot(through.d, frame.forward.xyz) / length);
        media[ray] = vec4<u32>(0u);
        lamp_beta[ray] = vec4<f32>(1.0, 1.0, 1.0, 0.0);
        lamp_light[ray] = vec4<f32>(0.0);
        lamp_way[ray] = packed_way(LampWay(of_slot.x + 1u - (bits & 1u), 0u, 1u, false));
        list_out[listed + first + k] = ray;
    }
}
