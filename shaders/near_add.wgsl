// Adds near light, averaged over neighbours of the same class, to the light of its pixels. See pass/near_collect.rs.
// MEAN: writes the averages in place of adding them, but for third components, which have no neighbours.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "flags.wgsl"
#include "near.wgsl"

@group(0) @binding(1) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(2) var<storage, read> list: array<u32>;
@group(0) @binding(3) var<storage, read> near_direct: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> near_indirect: array<vec4<f32>>;
#if MEAN
@group(0) @binding(5) var<storage, read_write> mean_direct: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> mean_indirect: array<vec4<f32>>;
#endif
@group(0) @binding(8) var<storage, read> seen_position: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> seen_geometric: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> seen_wo: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> direct: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> indirect: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> specular: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
    if place >= atomicLoad(&work.live) {
        return;
    }
    let slot = list[place];
    let own = near_direct[slot];
    var e_direct = own.xyz;
    let own_indirect = near_indirect[slot].xyz;
    var e_indirect = own_indirect;

    let pixel = pixel_of(slot);
    let size = vec2<i32>(frame.size.xy);
    let at = vec2<i32>(place_of_pixel(pixel));
    let position = seen_position[slot].xyz;
    let normal = seen_geometric[slot].xyz;
    // Second components have neighbours of any kind.
    let reach = select(0, i32(near_spread() / 2u), slot < frame.size.z);
    let part = bitcast<f32>(frame.lists.z) / f32(near_spread() * near_spread());
    for (var dy = -reach; dy <= reach; dy += 1) {
        for (var dx = -reach; dx <= reach; dx += 1) {
            let to = at + vec2<i32>(dx, dy) * vec2<i32>(frame.pattern.xy);
            let inside = all(to >= vec2<i32>(0)) && all(to < size);
            let other = slot - pixel + select(pixel, u32(to.x + to.y * size.x), inside);
            let chord = seen_position[other].xyz - position;
            let other_normal = seen_geometric[other].xyz;
            let turn = max(2.0 - 2.0 * dot(normal, other_normal), 0.0);
            let rise = dot(chord, normal + other_normal);
            let smooth_between = dot(normal, other_normal) >= NEAR_SMOOTH && rise * rise <= dot(chord, chord) * (turn + NEAR_SLOPE * NEAR_SLOPE);
            // Slots that are not lit may hold any value: they are left out, not multiplied by 0.
            let alike = inside && smooth_between && has_flag(seen_wo[other].w, LIT);
            for (var once = select(0u, 1u, alike); once > 0u; once -= 1u) {
                let near = near_direct[other];
                let taken = own.w == near.w;
                e_direct += select(vec3<f32>(0.0), part * (near.xyz - own.xyz), taken);
                e_indirect += select(vec3<f32>(0.0), part * (near_indirect[other].xyz - own_indirect), taken);
            }
        }
    }
#if MEAN
    mean_direct[slot] = vec4<f32>(e_direct, own.w);
    mean_indirect[slot] = vec4<f32>(e_indirect, 0.0);
    if !is_third(slot) {
        return;
    }
#endif
    // Light through the specular lobe is radiance.
    if own.w == 0.0 {
        direct[slot] += vec4<f32>(e_direct, 0.0);
        indirect[slot] += vec4<f32>(e_indirect, 0.0);
    } else {
        specular[slot] += vec4<f32>(e_direct + e_indirect, 0.0);
    }
}
