// Each texel gathers what the texels around it spread. See pass/convolve.rs.
// FINE: the level is the image itself. PYRAMID: adds the sums of coarser levels. OCCLUDED: limits light from behind.
// LAYERS: regions 1 and 2 spread over each other.
#include "convolve.wgsl"
#include "convolve_kernel.wgsl"
#include "convolve_occupied.wgsl"

#if FINE
@group(0) @binding(2) var<storage, read> source: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> region: array<u32>;
@group(0) @binding(12) var<storage, read_write> spread: array<vec4<f32>>;
#endif
#if OCCLUDED
@group(0) @binding(3) var<storage, read> footprint: array<vec4<f32>>;

// A source lies behind a pixel if its depth is greater by more than this share. Host twin: pass::convolve::DEPTH_TOLERANCE.
const DEPTH_TOLERANCE: f32 = 0.01;
#if LAYERS

// Regions that are layers.
const BEHIND: u32 = 1u;
const FRONT: u32 = 2u;
// Kernels up to this wide stay in the image. Host twin: pass::convolve::levels::STAYS.
const STAYS: f32 = 6.0;
#endif
#endif
@group(0) @binding(6) var<storage, read> masses: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> shapes: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> tiles: array<vec4<i32>>;
#if PYRAMID
@group(0) @binding(9) var<storage, read> members: array<u32>;
@group(0) @binding(13) var<storage, read_write> levels: array<vec4<f32>>;     // radiance, weight that reached each entry, per texel
#endif

// A texel and the regions that it gathers for, 0: none.
struct Place {
    at: vec2<i32>,
    id0: u32,
    id1: u32,
}

struct Sums {
    sum0: vec4<f32>,
    sum1: vec4<f32>,
}

#if PYRAMID
// Upsampling by quadratic B-splines: sums over those of the four texels around that hold the region.
struct Above {
    sum: vec4<f32>,
    share: f32,
}

fn above_at(so_far: Above, at: vec2<i32>, share: f32, id: u32, above: ConvolveStep) -> Above {
    let size = vec2<i32>(above.size);
    let inside = clamp(at, vec2<i32>(0), size - 1);
    let entry = above.first + u32(inside.y * size.x + inside.x);
    let plane = above.size.x * above.size.y;
    let held0 = (members[entry] & 0xffffu) == id;
    let held1 = (members[entry + plane] & 0xffffu) == id;
    let taken = id != 0u && (held0 || held1) && all(inside == at);
    let found = levels[select(entry + plane, entry, held0)];
    var result = so_far;
    result.sum += select(vec4<f32>(0.0), share * found, taken);
    result.share += select(0.0, share, taken);
    return result;
}

// Light of a region upsampled from the next coarser level, per texel of this level.
fn brought(at: vec2<i32>, id: u32, above: ConvolveStep) -> vec4<f32> {
    let near = at / 2;
    let far = near + 2 * (at & vec2<i32>(1)) - 1;
    var result: Above;
    result = above_at(result, near, 0.5625, id, above);
    result = above_at(result, vec2<i32>(far.x, near.y), 0.1875, id, above);
    result = above_at(result, vec2<i32>(near.x, far.y), 0.1875, id, above);
    result = above_at(result, far, 0.0625, id, above);
    return result.sum * (0.25 / max(result.share, 1e-3));
}
#endif

// Adds the light that the sources of one plane spread to a place.
fn gathered(so_far: Sums, place: Place, reach: i32, plane: u32, limit: vec2<f32>, here: ConvolveStep) -> Sums {
    var result = so_far;
    let size = vec2<i32>(here.size);
    let rows = min(reach, size.y - 1);
    let low = max(-rows, here.rows.x);
    let high = min(rows, here.rows.y - 1);
    for (var y = low; y <= high; y += 1) {
        let columns = min(chord(reach, y), size.x - 1);
        let row = place.at.y + y;
        let safe_row = clamp(row, 0, size.y - 1);
        let start = i32(here.first + plane) + safe_row * size.x;
        for (var x = -columns; x <= columns; x += 1) {
            let column = place.at.x + x;
            let safe = clamp(column, 0, size.x - 1);
            let entry = start + safe;
            let shape = shapes[entry];
            let packed = bitcast<u32>(shape.w);
            let offset = vec2<f32>(vec2<i32>(-x, -y));
#if FINE
            var weight = kernel_at(shape.xy, narrowed(packed >> 28u), (packed >> 16u) & 0xfffu, offset);
#else
            var weight = kernel_at(shape.xy, shape.z, (packed >> 16u) & 0xfffu, offset);
#endif
            weight = select(0.0, weight, row == safe_row && column == safe);
#if OCCLUDED
            // Sources behind the pixel spread no farther than the pixel's own kernel.
            let near_enough = clamp(limit.x + 0.5 - sqrt(dot(offset, offset)), 0.0, 1.0);
            weight *= select(1.0, near_enough, shape.z > limit.y);
#endif
            let mass = masses[entry] * weight;
            let id = packed & 0xffffu;
#if LAYERS
            result.sum0 += select(vec4<f32>(0.0), mass, id != 0u);
#else
            result.sum0 += select(vec4<f32>(0.0), mass, id == place.id0);
#endif
#if FINE
#else
            result.sum1 += select(vec4<f32>(0.0), mass, id == place.id1);
#endif
        }
    }
    return result;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let here = steps[push.step];
    let number = occupied_tile(here, group, groups);
    if number == NO_TILE {
        return;
    }
    let tile = tiles[here.first_tile + number];
    let at = texel_of(here, number, lane);
    let texel = at.y * here.size.x + at.x;
    let inside = all(at < here.size);
    let entry = here.first + texel;
    var sums: Sums;
    var place: Place;
    place.at = vec2<i32>(at);
#if FINE
    if !inside {
        return;
    }
    place.id0 = region[entry] & 0xffffu;
    // A loop that runs zero times skips work on every device.
    for (var once = 0; once < tile.z; once += 1) {
        let own = source[entry];
        let first = (here.flags & FIRST_ROUND) != 0u;
        if !first {
            sums.sum0 = spread[entry];
        }
        var limit = vec2<f32>(0.0);
#if OCCLUDED
        let foot = footprint[select(entry, min(place.id0, arrayLength(&footprint) - 1u), (here.flags & INVARIANT) != 0u)];
        limit.x = max(0.5, 0.5 * select(0.0, min(foot.x, here.widest), foot.x > 1.0));
        limit.y = own.w + abs(own.w) * DEPTH_TOLERANCE;
#endif
        sums = gathered(sums, place, tile.x, 0u, limit, here);
#if PYRAMID
#if LAYERS
        // The pixel's own kernel limits the light that comes from behind through coarser levels.
        let through = min(2.0 * limit.x / STAYS, 1.0);
        sums.sum0 += brought(place.at, FRONT, steps[push.step + 1u]);
        sums.sum0 += select(0.0, through * through, foot.x > 1.0) * brought(place.at, BEHIND, steps[push.step + 1u]);
#else
        sums.sum0 += brought(place.at, place.id0, steps[push.step + 1u]);
#endif
#endif
        let last = (here.flags & LAST_ROUND) != 0u;
        let reached = sums.sum0.w > 0.0;
        let mean = select(own.xyz, sums.sum0.xyz / sums.sum0.w, reached);
        let written = select(sums.sum0, vec4<f32>(mean, sums.sum0.w), last);
        spread[entry] = select(vec4<f32>(0.0), written, place.id0 != 0u);
    }
#else
    if !inside {
        return;
    }
    let plane = here.size.x * here.size.y;
    place.id0 = members[entry] & 0xffffu;
    place.id1 = members[entry + plane] & 0xffffu;
    for (var once = 0; once < tile.z; once += 1) {
        sums = gathered(sums, place, tile.x, 0u, vec2<f32>(0.0), here);
        sums = gathered(sums, place, tile.y, plane, vec2<f32>(0.0), here);
        if (here.flags & TOP_LEVEL) == 0u {
            let above = steps[push.step + 1u];
            sums.sum0 += brought(place.at, place.id0, above);
            sums.sum1 += brought(place.at, place.id1, above);
        }
        levels[entry] = select(vec4<f32>(0.0), sums.sum0, place.id0 != 0u);
        levels[entry + plane] = select(vec4<f32>(0.0), sums.sum1, place.id1 != 0u);
    }
#endif
}
