// Divides the light of each pixel by the sum of its kernel over the grid. Several rounds add up that sum. See pass/convolve.rs.
#include "convolve.wgsl"
#include "convolve_kernel.wgsl"
#include "convolve_source.wgsl"
#include "convolve_occupied.wgsl"

@group(0) @binding(5) var<storage, read> moments: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> masses: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> shapes: array<vec4<f32>>;

// Wider kernels are normalised by their integral. Host twin: pass::convolve::SUMMED.
const SUMMED: f32 = 256.0;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let here = steps[push.step];
    let tile = occupied_tile(here, group, groups);
    if tile == NO_TILE {
        return;
    }
    let at = texel_of(here, tile, lane);
    if any(at >= here.size) {
        return;
    }
    let pixel = at.x + at.y * here.size.x;
    let id = region_of(pixel);
    let foot = load_footprint(pixel, here);
    let layer = u32(foot.layer + 0.5);
    let moves = id != 0u && foot.diameter > 0.0;
    let axis = foot.axis * (2.0 / max(foot.diameter, 1.0));
    let of_layer = u32(moments[2u * layer + 1u].y);
    let narrowing = min(of_layer + foot.steps, MAX_STEPS);
    let ratio = narrowed(narrowing);
    let summed = moves && foot.diameter <= SUMMED;
    let reach = select(-1, i32(0.5 * SUPPORT * foot.diameter), summed);
    let before = masses[pixel].w;
    var sum = select(before, 0.0, (here.flags & FIRST_ROUND) != 0u);
    let low = max(-reach, here.rows.x);
    let high = min(reach, here.rows.y - 1);
    for (var y = low; y <= high; y += 1) {
        let columns = chord(reach, y);
        for (var x = -columns; x <= columns; x += 1) {
            sum += kernel_at(axis, ratio, layer, vec2<f32>(vec2<i32>(x, y)));
        }
    }
    if (here.flags & LAST_ROUND) == 0u {
        masses[pixel].w = sum;
        return;
    }
    let extra = exp2(-0.25 * f32(narrowing - of_layer));
    let whole = select(moments[2u * layer].z * foot.diameter * foot.diameter * extra, sum, summed);
    let spreads = moves && whole > MIN_SUM;
    let light = source[pixel];
    let weight = select(1.0, 1.0 / whole, spreads);
    masses[pixel] = select(vec4<f32>(0.0), vec4<f32>(light.xyz * weight, weight), id != 0u);
    let packed = bitcast<f32>(id | (select(here.layers, layer, spreads) << 16u) | (narrowing << 28u));
    shapes[pixel] = vec4<f32>(select(vec2<f32>(DELTA, 0.0), axis, spreads), light.w, packed);
}
