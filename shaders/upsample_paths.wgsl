// Lights what pixels see through mirrors and glass by the lit points around them. See pass/upsample_paths.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "listed_tile.wgsl"
#include "flags.wgsl"
#include "lit_points.wgsl"

// Of lit points, in an image of half the width and height.
@group(0) @binding(1) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> specular: array<vec4<f32>>;
// Of pixels.
@group(0) @binding(7) var<storage, read> pixel_position: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> pixel_geometric: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> pixel_wo: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> pixel_throughput: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> pixel_direct: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> pixel_indirect: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read_write> pixel_specular: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(15) var<storage, read> tiles: array<u32>;
@group(0) @binding(16) var<storage, read> lit_marks: array<u32>;     // of tiles of lit points: 1 where further components are written
var<immediate> push: Push;  // component

// Lit points of the component, and where they begin.
struct LitPoints {
    component: u32,
    first: u32,
    size: vec2<u32>,
}

// Whether a lit point is seen as another: both by mirrors and glass or neither, and it has light.
fn is_alike(own: f32, lit: LitPoints, there: vec2<u32>) -> bool {
    let theirs = point_wo[lit.first + there.x + lit.size.x * there.y].w;
    let tile = there / 8u;
    let written = lit.component == 0u || lit_marks[tile.x + tile.y * ((lit.size.x + 7u) / 8u)] != 0u;
    return written && has_flag(theirs, LIT) && has_flag(theirs, SEEN_BY_SPECULAR) == has_flag(own, SEEN_BY_SPECULAR);
}

// Squared distance in space of a lit point, that faces another way the farther.
fn distance2_to(point: u32, position: vec3<f32>, normal: vec3<f32>) -> f32 {
    let apart = point_position[point].xyz - position;
    return dot(apart, apart) * (1.0 + TURNED * (1.0 - dot(normal, point_geometric[point].xyz)));
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = listed_pixel(group, groups, lane);
    let component = push.step;
    let slot = select(pixel + component * frame.size.z, 0u, pixel == NO_POINT);
    let flags = pixel_wo[slot].w;
    // First hits of first components have light already.
    let through = component > 0u || has_flag(flags, SEEN_BY_SPECULAR);
    if pixel == NO_POINT || !has_flag(flags, LIT) || !through {
        return;
    }
    let size = lit_size();
    let first = component * size.x * size.y;
    let lit = LitPoints(component, first, size);
    let among = lit_place_of(place_of_pixel(pixel));
    let position = pixel_position[slot].xyz;
    let normal = pixel_geometric[slot].xyz;
    let tolerance = 2.0 * sqrt(dot(frame.up.xyz, frame.up.xyz)) / f32(frame.within.w) * depth_scale(pixel_throughput[slot].w);

    // Between the four around it, those on its surface.
    var e_direct = vec3<f32>(0.0);
    var e_indirect = vec3<f32>(0.0);
    var l_specular = vec3<f32>(0.0);
    var total = 0.0;
    for (var i = 0u; i < 4u; i += 1u) {
        let there = lit_place(among, i, 2u);
        let point = first + there.x + size.x * there.y;
        let apart = point_position[point].xyz - position;
        let theirs = point_geometric[point].xyz;
        let near = abs(dot(normal, apart)) <= tolerance && abs(dot(theirs, apart)) <= tolerance;
        let shows = near && dot(normal, theirs) > 0.95 && is_alike(flags, lit, there);
        if shows {
            let weight = lit_weight(among, i);
            e_direct += weight * direct[point].xyz;
            e_indirect += weight * indirect[point].xyz;
            l_specular += weight * specular[point].xyz;
            total += weight;
        }
    }
    let scale = 1.0 / max(total, LEAST_WEIGHT);
    e_direct *= scale;
    e_indirect *= scale;
    l_specular *= scale;

    // Else the nearest in space of sixteen that faces as it does, if none is seen alike that of their first components. Zero times for most pixels.
    for (var again = select(0u, 1u, total <= LEAST_WEIGHT); again > 0u; again -= 1u) {
        var alike = 0u;
        var least_alike = 3.0e38;
        var other = 0u;
        var least_other = 3.0e38;
        for (var i = 0u; i < 16u; i += 1u) {
            let there = lit_place(among, i, 4u);
            let point = first + there.x + size.x * there.y;
            let distance2 = distance2_to(point, position, normal);
            let nearer = is_alike(flags, lit, there) && distance2 < least_alike;
            alike = select(alike, point, nearer);
            least_alike = select(least_alike, distance2, nearer);
            let first_one = there.x + size.x * there.y;
            let of_first = distance2_to(first_one, position, normal);
            let lends = has_flag(point_wo[first_one].w, LIT) && of_first < least_other;
            other = select(other, first_one, lends);
            least_other = select(least_other, of_first, lends);
        }
        let chosen = select(other, alike, least_alike < 3.0e38);
        let found = min(least_alike, least_other) < 3.0e38;
        let zero = vec3<f32>(0.0);
        e_direct = select(zero, direct[chosen].xyz, found);
        e_indirect = select(zero, indirect[chosen].xyz, found);
        l_specular = zero;
    }
    pixel_direct[slot] = vec4<f32>(e_direct, 0.0);
    pixel_indirect[slot] = vec4<f32>(e_indirect, 0.0);
    pixel_specular[slot] = vec4<f32>(l_specular, 0.0);
}
