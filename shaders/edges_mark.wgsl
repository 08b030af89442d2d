// Marks pixels at edges. See pass/edges.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "camera.wgsl"
#include "edges.wgsl"
#include "edge_rays.wgsl"
#include "edge_rounds.wgsl"

@group(0) @binding(9) var<storage, read> first_hits: array<vec2<u32>>;
@group(0) @binding(10) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> edges: array<u32>;
#if MIRRORS
@group(0) @binding(13) var<storage, read> second_hits: array<vec2<u32>>;

fn shown_at(at: vec2<u32>, pixel: u32) -> Shown {
    return shown_by(first_hits[pixel], second_hits[pixel], eye_ray(at, frame.pixel_offset.xy));
}
#else

fn hit_of(at: vec2<u32>, pixel: u32) -> FirstHit {
    let guide = first_hits[pixel];
    return first_hit(guide.x, bitcast<f32>(guide.y), eye_ray(at, frame.pixel_offset.xy));
}
#endif

// Albedo of what the pixel shows; zero where the eye's path goes on.
fn albedo_of(pixel: u32) -> vec3<f32> {
    var hit = first_hits[pixel];
#if MIRRORS
    let second = second_hits[pixel];
    hit = select(hit, second, second.x != NO_MIRROR);
#endif
    let is_last = point_position[pixel].w == bitcast<f32>(hit.y);
    return select(vec3<f32>(0.0), point_kd[pixel].xyz, is_last);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let at = place_of_pixel(pixel);
    // Left, right, above, below.
    let last = frame.size.xy - 1u;
    let low = max(at, vec2<u32>(1u)) - 1u;
    let high = min(at + 1u, last);
    let row = at.y * frame.size.x;
    var others = array<u32, 4>(low.x + row, high.x + row, at.x + low.y * frame.size.x, at.x + high.y * frame.size.x);
    let triangle = first_hits[pixel].x;
    var differ = 0u;
    for (var i = 0u; i < 4u; i += 1u) {
        differ |= select(0u, 1u << i, first_hits[others[i]].x != triangle);
#if MIRRORS
        differ |= select(0u, 1u << i, second_hits[others[i]].x != second_hits[pixel].x);
#endif
    }
    // Zero times for most pixels.
#if MIRRORS
    let own = shown_at(at, pixel);
#else
    let own = hit_of(at, pixel);
#endif
    var surfaces = false;
    while differ != 0u {
        let i = firstTrailingBit(differ);
        differ &= differ - 1u;
        let neighbour = select(vec2<u32>(at.x, select(low.y, high.y, i == 3u)), vec2<u32>(select(low.x, high.x, i == 1u), at.y), i < 2u);
#if MIRRORS
        let apart = !same_shown(own, shown_at(neighbour, neighbour.x + neighbour.y * frame.size.x));
#else
        let apart = !same_surface(own, hit_of(neighbour, neighbour.x + neighbour.y * frame.size.x));
#endif
        surfaces = surfaces || apart;
    }
    var edge = surfaces;
#if UNTEXTURED
#else
    let kd = albedo_of(pixel);
    for (var i = 0u; i < 4u; i += 1u) {
        let other = albedo_of(others[i]);
        let contrast = any(abs(other - kd) > 0.1 * (other + kd));
        edge = edge || contrast;
    }
#endif
    edges[pixel] = select(0u, AT_EDGE, edge) | select(0u, SURFACES_DIFFER, surfaces);
}
