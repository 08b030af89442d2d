// Adds what splats reflect to the specular radiance of shading points. See pass/splat_light.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "point.wgsl"
#include "splats.wgsl"
#include "splat_look_up.wgsl"
#include "splat_kernel.wgsl"

@group(0) @binding(1) var<storage, read_write> found_work: DispatchCounts;
@group(0) @binding(2) var<storage, read> found: array<vec2<u32>>;       // slot, surface + 1
@group(0) @binding(3) var<storage, read> steps: array<Step>;
@group(0) @binding(4) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> point_f0: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(9) var sorted_hits: texture_storage_2d<rgba32uint, read>;
@group(0) @binding(10) var<storage, read> splat_buckets: array<vec2<u32>>;
@group(0) @binding(11) var<storage, read> splat_state: array<u32>;
@group(0) @binding(12) var<storage, read> surfaces: array<vec4<u32>>;
@group(0) @binding(13) var<storage, read> surface_width: array<f32>;
@group(0) @binding(14) var<storage, read> surface_edges: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> specular: array<vec4<f32>>;
var<immediate> push: Push;

// Candidates between two evaluations.
const BLOCK: u32 = 32u;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
    if place >= atomicLoad(&found_work.live) {
        return;
    }
    let slot = found[place].x;
    let surface = found[place].y;
    let width = surface_width[surface - 1u];
    let position = point_position[slot].xyz;
    let geometric = point_geometric[slot];
    let shading = point_shading[slot];
    let f0 = point_f0[slot];
    let wo = point_wo[slot];
    let lobe = point_lobe(geometric, shading, f0);
    // Bounces that make the whole path as long as allowed.
    let bounces = frame.scene.z - min(2u + segments_of(wo.w), frame.scene.z);
    let scale2 = 1.0 / (width * width);

    let look_up = splat_look_up(position, surface, width);
    // The candidates of all cells are counted through; a dispatch takes those from `first` on.
    let first = steps[push.step].first;
    let last = first + splat_parameters.chunk;
    var before = 0u;
    // Cells with candidates: first, end, code.
    var cells: array<vec3<u32>, SPLAT_CELLS>;
    var count = 0u;
    for (var c = 0u; c < SPLAT_CELLS; c += 1u) {
        let cell = splat_cell(look_up, c);
        let begin = clamp(first, before, before + cell.count) - before;
        let end = clamp(last, before, before + cell.count) - before;
        before += cell.count;
        cells[count] = vec3<u32>(cell.first + begin, cell.first + end, cell.code);
        count += select(0u, 1u, end > begin);
    }
    // Lanes collect hits within their kernels, each from its own cells, before they evaluate them: of the candidates only some are within, and
    // in each step others of the lanes.
    var within: array<vec2<u32>, BLOCK>;     // number of a hit; bits of its part
    var cell = select(vec3<u32>(0u), cells[0], count > 0u);
    var current = 0u;
    var j = cell.x;
    var l = vec3<f32>(0.0);
    for (var blocks = 0u; current < count; blocks += 1u) {
        var n = 0u;
        for (var i = 0u; i < BLOCK && current < count; i += 1u) {
            let place = textureLoad(sorted_hits, sorted_place(2u * j));
            let off = bitcast<vec3<f32>>(place.xyz) - position;
            let part = dot(off, off) * scale2;
            within[n] = vec2<u32>(j, bitcast<u32>(part));
            n += select(0u, 1u, place.w == cell.z && part < 0.25);
            j += 1u;
            // A loop, because it runs zero times where no lane comes to the end of its cell.
            for (var next = select(0u, 1u, j == cell.y); next > 0u; next -= 1u) {
                current += 1u;
                cell = cells[min(current, SPLAT_CELLS - 1u)];
                j = cell.x;
            }
        }
        for (var i = 0u; i < n; i += 1u) {
            let arrives = textureLoad(sorted_hits, sorted_place(2u * within[i].x + 1u));
            let wi = arrival_of(arrives.w);
            let cos_geometric = dot(wi, geometric.xyz);
            let cos_shading = dot(wi, shading.xyz);
            // Flux arrives by the geometric cosine and is reflected by the shading one (Veach 1997, 5.3).
            let skew = min(cos_shading / max(cos_geometric, 1e-7), 4.0);
            let counts = cos_geometric > 0.0 && cos_shading > 0.0 && (arrives.w >> 28u) <= bounces;
            let weight = select(0.0, skew * splat_kernel(bitcast<f32>(within[i].y)), counts);
            l += bitcast<vec3<f32>>(arrives.xyz) * (weight * eval_specular(lobe, shading.xyz, wo.xyz, wi));
        }
    }

    // The part of the kernel that lies on the surface.
    let edges = surfaces[surface - 1u].yz;
    var covered = select(0.0, 1.0, edges.x == edges.y);
    for (var i = edges.x; i < edges.y; i += 1u) {
        covered += edge_part(position, geometric.xyz, surface_edges[2u * i].xyz, surface_edges[2u * i + 1u].xyz, width);
    }
    let share = f32(frame.pattern.z) * scale2 / (f32(max(splat_state[SPLAT_PARTICLES], 1u)) * clamp(abs(covered), MIN_COVERED, 1.0));
    specular[slot] += vec4<f32>(l * share, 0.0);
}
