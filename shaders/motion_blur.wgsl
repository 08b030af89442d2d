// Spreads each pixel over the segment that it covers while the shutter is open, what is in front first. See pass/motion_blur.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "segments.wgsl"
#include "motion_tiles.wgsl"
#include "spread_out.wgsl"

@group(0) @binding(1) var<storage, read> motion_reach: array<MotionReach>;
@group(0) @binding(2) var<storage, read> source: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> sweep: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> front: array<f32>;
@group(0) @binding(5) var<storage, read> farthest: u32;
@group(0) @binding(6) var<storage, read> brightest: u32;
@group(0) @binding(7) var<storage, read> passing: array<vec4<u32>>;
@group(0) @binding(8) var<storage, read_write> emitted: array<vec4<f32>>;

// Light of the surface that the pixel shows, and of what it uncovers as it moves.
struct Own {
    sum: vec4<f32>,     // light, weight
    inside: f32,        // part of the segment that lies in the image
}

// `nearest`: sources of less depth are left out.
fn own_light(at: vec2<i32>, segment: Segment, nearest: f32, dither: u32) -> Own {
    let line = line_of(at, segment, -1);
    var own: Own;
    for (var m = line.columns.x; m <= line.columns.y; m += 1) {
        let row = row_of(m, segment.slope, dither);
        let safe = clamp(row, line.rows.x, line.rows.y);
        let light = source[u32(line.origin + m * line.along + safe * line.across)];
        let weight = select(0.0, share_of(f32(m), segment), row == safe);
        own.inside += weight;
        own.sum += select(0.0, weight, light.w >= nearest) * vec4<f32>(light.xyz, 1.0);
    }
    return own;
}

// A workgroup for each tile.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tiles = (frame.size.xy + 7u) / 8u;
    let count = tiles.x * tiles.y;
    let index = group.x + group.y * groups.x;
    let tile = spread_out(min(index, count - 1u), count);
    // Read where all lanes run (see gpu/wgsl_parameters.rs).
    let reached = motion_reach[tile].reached != 0u;
    let steps = passing_steps(farthest, bitcast<f32>(brightest));
    let at = pixel_of_tile(tile, lane);
    if index >= count || !reached || any(at >= frame.size.xy) {
        return;
    }
    let pixel = at.y * frame.size.x + at.x;
    let shown = source[pixel];
    let dither = key(frame.keys.x, STREAM_BLUR, 0u, 1u);
    let own = own_light(vec2<i32>(at), segment_of(sweep[pixel]), front[pixel], dither);
    let over = vec4<f32>(passing[pixel]) * steps;
    // Light from outside the image is unknown.
    let rest = max(own.inside - over.w, 0.0);
    let blurred = (over.xyz / max(over.w, 1.0) + rest * own.sum.xyz / own.sum.w) / (min(over.w, 1.0) + rest);
    emitted[pixel] += vec4<f32>(blurred - shown.xyz, 0.0);
}
