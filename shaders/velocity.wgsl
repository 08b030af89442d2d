// Writes how far the point that each pixel shows moves in the image while the shutter is open. See pass/velocity.rs.
#include "frame.wgsl"
#include "camera.wgsl"
#include "flags.wgsl"
#include "shutter.wgsl"

@group(0) @binding(1) var<storage, read> shutter: Shutter;
@group(0) @binding(2) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> motion_of: array<u32>;         // 1 + number among the triangles that move; 0: stands still
@group(0) @binding(6) var<storage, read> motion: array<vec4<f32>>;      // six for each of these: displacements of its corners, opening first
@group(0) @binding(7) var<storage, read_write> velocity: array<vec4<f32>>;    // to the right, down; depth

// Depth of pixels that see nothing, beyond every surface. Host twin: pass::mirror_image::NOTHING_SEEN.
const NOTHING_SEEN: f32 = 3.0e38;
// Least depth at the ends of the motion, as a share of the depth now: points nearer to the eye, or behind it, count as being there.
const NEAREST: f32 = 0.05;

// Place in the image of a point, in half widths and half heights. `seen`: the point less the eye, divided by the depth now, unless rays are parallel.
fn projected(seen: vec3<f32>, right: vec4<f32>, up: vec4<f32>, forward: vec4<f32>) -> vec2<f32> {
    let depth = select(max(dot(seen, forward.xyz), NEAREST), 1.0, is_orthographic());
    return vec2<f32>(dot(seen, right.xyz), dot(seen, up.xyz)) / depth - vec2<f32>(right.w, up.w);
}

// Displacement of a point of a triangle.
fn displaced(first: u32, weights: vec3<f32>) -> vec3<f32> {
    return weights.x * motion[first].xyz + weights.y * motion[first + 1u].xyz + weights.z * motion[first + 2u].xyz;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let hit = hits[pixel];
    let word = point_wo[pixel].w;
    let depth = throughput[pixel].w;
    let found = has_flag(word, HIT);
    // Images in mirrors and glass stand still behind them.
    let directly = found && !has_flag(word, SEEN_BY_SPECULAR) && shutter.moving.x > 0u;
    let number = select(0u, motion_of[select(0u, bitcast<u32>(hit.w), directly)], directly);
    var opening = vec3<f32>(0.0);
    var closing = vec3<f32>(0.0);
    // Runs zero times where nothing moves by itself.
    for (var once = select(0u, 1u, number > 0u); once > 0u; once -= 1u) {
        let first = 6u * (number - 1u);
        let weights = vec3<f32>(1.0 - hit.y - hit.z, hit.y, hit.z);
        opening = displaced(first, weights);
        closing = displaced(first + 3u, weights);
    }
    let parallel = is_orthographic();
    let nearness = select(0.0, select(1.0 / max(depth, 1e-30), 1.0, parallel), found);
    let at = vec2<f32>(place_of_pixel(pixel) + frame.within.xy) + frame.pixel_offset.xy;
    let ray = ray_through(at.x, at.y);
    let now = select(ray.d, ray.start + select(0.0, depth, found) * ray.d, parallel);
    let seen = now + nearness * (shutter.shift[0].xyz + opening);
    let begin = projected(seen, shutter.right[0], shutter.up[0], shutter.forward[0]);
    let seen_later = now + nearness * (shutter.shift[1].xyz + closing);
    let end = projected(seen_later, shutter.right[1], shutter.up[1], shutter.forward[1]);
    // Rows count downwards.
    let change = (end - begin) * vec2<f32>(0.5, -0.5) * vec2<f32>(frame.within.zw);
    let bounded = clamp(change, vec2<f32>(-1e5), vec2<f32>(1e5));
    let length = sqrt(dot(bounded, bounded));
    // Comparisons with NaN are false.
    let v = select(vec2<f32>(0.0), bounded * min(1.0, MAX_LENGTH / length), length > 0.0);
    velocity[pixel] = vec4<f32>(v, select(NOTHING_SEEN, depth, found), 0.0);
}
