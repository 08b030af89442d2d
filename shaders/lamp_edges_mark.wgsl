// Marks pixels at edges of lamps in mirrors and glass. See pass/lamp_edges.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "listed_tile.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"

@group(0) @binding(1) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> emitted: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> region: array<u32>;
@group(0) @binding(4) var<storage, read_write> marks: array<u32>;   // of each pixel: bits of components at edges
@group(0) @binding(5) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(10) var<storage, read> tiles: array<u32>;
#if MIRRORS
@group(0) @binding(11) var<storage, read> second_hits: array<vec2<u32>>;

// Triangle of `second_hits` where a pixel shows no reflection in a flat mirror.
const NO_MIRROR: u32 = 0xfffffffeu;
#endif

// Host twin: pass::lamp_edges::CONTRAST.
const CONTRAST: f32 = 0.2;

// Whether the emission of a slot came over mirrors or glass, and by no lobe.
fn shows_lamps(slot: u32) -> bool {
    let word = point_wo[slot].w;
    return has_flag(word, SEEN_BY_SPECULAR) && !has_flag(word, LOBE_SAMPLED) && segments_of(word) == 0u;
}

// Grey of what a slot shows.
fn shown_by(slot: u32) -> f32 {
    return mean3(emitted[slot].xyz + throughput[slot].xyz * reflected_radiance(point_kd[slot].xyz, lighting_of(slot)));
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = listed_pixel(group, groups, lane);
    if pixel == NO_POINT {
        return;
    }
    let at = place_of_pixel(pixel);
    let mirrors = frame.superposition.x > 0u;
    // Images of planes are spread later.
    let spreads = mirrors && region[select(0u, pixel, mirrors)] != 0u;
    // Left, right, above, below.
    let last = frame.size.xy - 1u;
    let low = max(at, vec2<u32>(1u)) - 1u;
    let high = min(at + 1u, last);
    let others = array<vec2<u32>, 4>(vec2<u32>(low.x, at.y), vec2<u32>(high.x, at.y), vec2<u32>(at.x, low.y), vec2<u32>(at.x, high.y));
    let shown = shown_by(pixel) + shown_by(frame.size.z + pixel);
    var bits = 0u;
    for (var component = 0u; component < 2u; component += 1u) {
        let first = component * frame.size.z;
        var counts = shows_lamps(first + pixel) && !spreads;
#if MIRRORS
        // The other pass antialiases what one flat mirror shows.
        counts = counts && (component > 0u || second_hits[pixel].x == NO_MIRROR);
#endif
        let own = mean3(emitted[first + pixel].xyz);
        var edge = false;
        for (var i = 0u; i < 4u; i += 1u) {
            let there = others[i];
            let other = there.x + there.y * frame.size.x;
            // Slots of second components are written in the listed tiles.
            let written = all(there / 8u == at / 8u) || has_flag(point_wo[other].w, SEEN_BY_SPECULAR);
            let slot = select(first + pixel, first + other, written);
            let theirs = mean3(emitted[slot].xyz);
            let differs = abs(theirs - own) > CONTRAST * max(theirs, shown);
            edge = edge || (differs && shows_lamps(slot));
        }
        bits |= select(0u, 1u << component, counts && edge);
    }
    marks[pixel] = bits;
}
