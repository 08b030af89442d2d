// Spreads near light from the pixels that have near rays over the others, and adds it to their light. See pass/near_collect.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "flags.wgsl"
#include "near.wgsl"

@group(0) @binding(1) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(2) var<storage, read> list: array<u32>;
// Means of `near_add`; w of the first: the lobe.
@group(0) @binding(3) var<storage, read> mean_direct: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> mean_indirect: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> direct: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> indirect: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> specular: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> seen_position: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> seen_geometric: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> seen_wo: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
    // A list in screen order has gaps.
    if place >= max(atomicLoad(&work.live), work.total) {
        return;
    }
    let slot = list[place];
    // `near_add` has added that of third components.
    if slot == NO_POINT || is_third(slot) {
        return;
    }
    let size = vec2<i32>(frame.size.xy);
    let at = vec2<i32>(place_of_pixel(pixel_of(slot)));
    let position = seen_position[slot].xyz;
    let normal = seen_geometric[slot].xyz;
    // Second components have neighbours of any kind.
    let first = slot < frame.size.z;
    let pattern = vec2<i32>(frame.pattern.xy);
    let reach = select(vec2<i32>(0), pattern / 2, first);
    // Place of the window's corner in the pattern.
    let left = vec2<u32>(at + pattern - reach);
    let corner = vec2<i32>(vec2<u32>(divided(left.x, frame.pattern.x).y, divided(left.y, frame.pattern.y).y));
    let begin = near_begin();
    var sum_direct = vec3<f32>(0.0);
    var sum_indirect = vec3<f32>(0.0);
    var sum_specular = vec3<f32>(0.0);
    var weights = 0.0;
    for (var dy = -reach.y; dy <= reach.y; dy += 1) {
        let down = corner.y + reach.y + dy;
        let row = select(down, down - pattern.y, down >= pattern.y);
        for (var dx = -reach.x; dx <= reach.x; dx += 1) {
            let right = corner.x + reach.x + dx;
            let column = select(right, right - pattern.x, right >= pattern.x);
            let to = at + vec2<i32>(dx, dy);
            let inside = all(to >= vec2<i32>(0)) && all(to < size);
            let other = select(slot, u32(to.x + to.y * size.x), inside && first);
            let chord = seen_position[other].xyz - position;
            let height = dot(chord, normal);
            let slope2 = height * height / max(dot(chord, chord), 1e-30);
            let alike = max(dot(normal, seen_geometric[other].xyz), 0.0) / (1.0 + slope2 / (NEAR_STEEP * NEAR_STEEP));
            let counts = inside && has_flag(seen_wo[other].w, LIT);
            let weight = select(0.0, alike, counts);
            // Slots without near rays may hold any value: they are left out, not multiplied by 0. The loop runs zero times for the most of
            // them, since invocations beside each other have pixels of one class.
            let taken = counts && has_near_rays(u32(column + row * pattern.x), begin);
            for (var once = select(0u, 1u, taken); once > 0u; once -= 1u) {
                let near = mean_direct[other];
                let other_indirect = mean_indirect[other].xyz;
                let diffuse = near.w == 0.0;
                sum_direct += select(vec3<f32>(0.0), weight * near.xyz, diffuse);
                sum_indirect += select(vec3<f32>(0.0), weight * other_indirect, diffuse);
                sum_specular += select(weight * (near.xyz + other_indirect), vec3<f32>(0.0), diffuse);
            }
            weights += weight;
        }
    }
    var own_direct = vec3<f32>(0.0);
    var own_indirect = vec3<f32>(0.0);
    var own_specular = vec3<f32>(0.0);
    for (var once = select(0u, 1u, has_near_ray(slot, seen_wo[slot].w)); once > 0u; once -= 1u) {
        let near = mean_direct[slot];
        let near_indirect = mean_indirect[slot].xyz;
        let diffuse = near.w == 0.0;
        own_direct = select(vec3<f32>(0.0), near.xyz, diffuse);
        own_indirect = select(vec3<f32>(0.0), near_indirect, diffuse);
        own_specular = select(near.xyz + near_indirect, vec3<f32>(0.0), diffuse);
    }
    let share = select(0.0, frame.lens.z, first);
    let factor = share / max(weights, 1e-30);
    direct[slot] += vec4<f32>((1.0 - share) * own_direct + factor * sum_direct, 0.0);
    indirect[slot] += vec4<f32>((1.0 - share) * own_indirect + factor * sum_indirect, 0.0);
    specular[slot] += vec4<f32>((1.0 - share) * own_specular + factor * sum_specular, 0.0);
}
