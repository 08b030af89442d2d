// Adds the light of each pixel that moves to the pixels that it passes in front of. See pass/motion_blur.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "segments.wgsl"
#include "motion_tiles.wgsl"
#include "spread_out.wgsl"

@group(0) @binding(1) var<storage, read> sends: array<f32>;
@group(0) @binding(2) var<storage, read> source: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> sweep: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> front: array<f32>;
@group(0) @binding(5) var<storage, read> farthest: u32;
@group(0) @binding(6) var<storage, read> brightest: u32;
@group(0) @binding(7) var<storage, read_write> passing: array<atomic<u32>>;     // four for each pixel: light and time, see passing_steps

// A workgroup for each tile.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tiles = (frame.size.xy + 7u) / 8u;
    let count = tiles.x * tiles.y;
    let index = group.x + group.y * groups.x;
    let tile = spread_out(min(index, count - 1u), count);
    // Read where all lanes run (see gpu/wgsl_parameters.rs).
    let deepest = sends[tile];
    let steps = passing_steps(farthest, bitcast<f32>(brightest));
    let at = pixel_of_tile(tile, lane);
    if index >= count || deepest < 0.0 || any(at >= frame.size.xy) {
        return;
    }
    let pixel = at.y * frame.size.x + at.x;
    let shown = source[pixel];
    let segment = segment_of(sweep[pixel]);
    let dither = key(frame.keys.x, STREAM_BLUR, 0u, 1u);
    let light = vec4<f32>(shown.xyz, 1.0) / steps;
    let line = line_of(vec2<i32>(at), segment, 1);
    // Within a pixel nothing is spread.
    let sends_light = segment.half > 0.5 && shown.w < depth_in_front(deepest);
    let first = select(line.columns.y + 1, line.columns.x, sends_light);
    for (var m = first; m <= line.columns.y; m += 1) {
        let row = row_of(m, segment.slope, dither);
        let safe = clamp(row, line.rows.x, line.rows.y);
        let passed = u32(line.origin + m * line.along + safe * line.across);
        let time = share_of(f32(m), segment);
        let covers = time > 0.0 && row == safe && shown.w < front[passed];
        // Runs zero times where it passes behind.
        for (var once = select(0u, 1u, covers); once > 0u; once -= 1u) {
            let part = vec4<u32>(round(time * light));
            atomicAdd(&passing[4u * passed], part.x);
            atomicAdd(&passing[4u * passed + 1u], part.y);
            atomicAdd(&passing[4u * passed + 2u], part.z);
            atomicAdd(&passing[4u * passed + 3u], part.w);
        }
    }
}
