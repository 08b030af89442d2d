// Spreads each pixel over the segment that it covers while the shutter is open, what is in front first. See pass/motion_blur.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "segments.wgsl"
#include "motion_tiles.wgsl"
#include "spread_out.wgsl"

@group(0) @binding(1) var<storage, read> motion_windows: array<MotionWindow>;
@group(0) @binding(3) var source: texture_storage_2d<rgba32float, read>;
@group(0) @binding(5) var sweep: texture_storage_2d<rgba32float, read>;
@group(0) @binding(4) var<storage, read_write> emitted: array<vec4<f32>>;

// Light of the surface that the pixel shows, and of what it uncovers as it moves.
struct Own {
    sum: vec4<f32>,     // light, weight
    inside: f32,        // part of the segment that lies in the image
}

// `front`: sources of less depth are left out.
fn own_light(at: vec2<i32>, segment: Segment, front: f32, dither: u32) -> Own {
    let last = vec2<i32>(frame.size.xy) - 1;
    let reach = i32(segment.half + 0.5);
    var own: Own;
    for (var m = -reach; m <= reach; m += 1) {
        let offset = vec2<i32>(m, row_of(m, segment.slope, dither));
        let q = at - select(offset.yx, offset, segment.wide);
        let safe = clamp(q, vec2<i32>(0), last);
        let light = textureLoad(source, safe);
        let weight = select(0.0, share_of(f32(m), segment), all(safe == q));
        own.inside += weight;
        own.sum += select(0.0, weight, light.w >= front) * vec4<f32>(light.xyz, 1.0);
    }
    return own;
}

// Light of nearer surfaces that cover the pixel for a part of the time; w: that part.
fn light_in_front(at: vec2<i32>, front: f32, window: MotionWindow, dither: u32) -> vec4<f32> {
    let last = vec2<i32>(frame.size.xy) - 1;
    let wide = window.wide != 0u;
    let stride = i32(window.stride);
    let along = i32(window.along);
    // Places within a stride change from pass to pass.
    let begin = i32(random(key(frame.keys.x, STREAM_BLUR, 0u, 0u)) * f32(stride));
    var sum = vec4<f32>(0.0);
    for (var m = begin - along; m <= along; m += stride) {
        let line = window.slope * f32(m);
        let reach = min(window.across, window.spread * f32(abs(m) + 1)) + window.margin;
        // Rows of sources whose slopes are the least and the greatest.
        let part = dither_of(-m, dither);
        let high = -i32(floor(part - line - reach));
        for (var r = -i32(floor(part - line + reach)); r <= high; r += stride) {
            let offset = select(vec2<i32>(r, m), vec2<i32>(m, r), wide);
            let q = at + offset;
            let safe = clamp(q, vec2<i32>(0), last);
            let moved = textureLoad(sweep, safe);
            let time = select(0.0, time_on(segment_of(moved), -offset, dither), all(safe == q) && moved.z < front);
            // Runs zero times where nothing in front passes.
            for (var once = select(0u, 1u, time > 0.0); once > 0u; once -= 1u) {
                sum += time * vec4<f32>(textureLoad(source, safe).xyz, 1.0);
            }
        }
    }
    return sum * f32(stride * stride);
}

// A workgroup for each tile.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tiles = (frame.size.xy + 7u) / 8u;
    let count = tiles.x * tiles.y;
    let index = group.x + group.y * groups.x;
    let tile = spread_out(min(index, count - 1u), count);
    // Read where all lanes run (see gpu/wgsl_parameters.rs).
    let window = motion_windows[tile];
    let at = pixel_of_tile(tile, lane);
    if index >= count || window.along < 0.0 || any(at >= frame.size.xy) {
        return;
    }
    let pixel = at.y * frame.size.x + at.x;
    let shown = textureLoad(source, vec2<i32>(at));
    let even = window.even != 0u;
    let front = select(shown.w - abs(shown.w) * DEPTH_TOLERANCE, -1.0, even);
    let dither = key(frame.keys.x, STREAM_BLUR, 0u, 1u);
    let own = own_light(vec2<i32>(at), segment_of(textureLoad(sweep, vec2<i32>(at))), front, dither);
    var over = vec4<f32>(0.0);
    // A loop that runs zero times skips work on every device.
    for (var once = select(1u, 0u, even || front <= window.nearest); once > 0u; once -= 1u) {
        over = light_in_front(vec2<i32>(at), front, window, dither);
    }
    // Light from outside the image is unknown.
    let rest = max(own.inside - over.w, 0.0);
    let blurred = (over.xyz / max(over.w, 1.0) + rest * own.sum.xyz / own.sum.w) / (min(over.w, 1.0) + rest);
    emitted[pixel] += vec4<f32>(blurred - shown.xyz, 0.0);
}
