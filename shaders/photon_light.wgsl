// Lights shading points by the photons around them. See pass/photon_light.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "point.wgsl"
#include "photons.wgsl"
#include "photon_look_up.wgsl"

@group(0) @binding(1) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(2) var<storage, read> list: array<u32>;
@group(0) @binding(3) var<storage, read> steps: array<Step>;
@group(0) @binding(4) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> point_f0: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> sorted_position: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> sorted_normal: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> sorted_wi: array<vec4<f32>>;    // w: r^2 over the squared radius of its footprint
@group(0) @binding(12) var<storage, read> sorted_flux: array<vec4<f32>>;  // w: WITHOUT_AREA, or other
@group(0) @binding(13) var<storage, read> buckets: array<u32>;
@group(0) @binding(14) var<storage, read_write> indirect: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> specular: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read_write> caustic: array<vec4<f32>>;   // minimal where no filter needs it
@group(0) @binding(17) var<storage, read_write> stored: DispatchCounts;     // photons
var<immediate> push: Push;

// Host twin: pass::caustics::SHARP.
const SHARP: f32 = 4.0;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
    if place >= atomicLoad(&work.live) {
        return;
    }
    let step = steps[push.step];
    if step.first >= atomicLoad(&stored.live) {
        return;
    }
    let slot = list[place];
    let point_class = grid_class(class_of(slot));
    let position = point_position[slot].xyz;
    let geometric = point_geometric[slot];
    let shading = point_shading[slot];
    let f0 = point_f0[slot];
    let wo = point_wo[slot];
    let glossy = has_flag(wo.w, GLOSSY) && !has_flag(wo.w, SPLATS);
    let sampled = has_flag(wo.w, LOBE_SAMPLED);
    let lobe = point_lobe(geometric, shading, f0);
    let radius2 = frame.photon.x * frame.photon.x;
    let share = frame.photon.z;

    let cells = look_up(position, point_class, step.first, step.end);
    var e = vec3<f32>(0.0);
    var sharp = vec3<f32>(0.0);
    var l = vec3<f32>(0.0);
    // One loop for all cells: most cells are empty, and a SIMD driver runs every loop at least once.
    for (var j = 0u; j < cells.total; j += 1u) {
        let found = looked_up(cells, j);
        let i = found.y;
        let photon = sorted_position[i];
        let off = photon.xyz - position;
        // Its density falls from the middle to the edge, so that no disc shows.
        let narrowed = sorted_wi[i].w;
        let kernel = 2.0 * (narrowed - narrowed * narrowed * dot(off, off) / radius2);
        let near = bitcast<u32>(photon.w) == found.x && kernel > 0.0;
        // Zero times for most photons, whose footprints are small.
        for (var k = select(0u, 1u, near); k > 0u; k -= 1u) {
            let wi = sorted_wi[i].xyz;
            let carried = sorted_flux[i];
            let cos_geometric = dot(wi, geometric.xyz);
            let cos_shading = dot(wi, shading.xyz);
            let faces = dot(sorted_normal[i].xyz, geometric.xyz) > MIN_COSINE && cos_geometric > 0.0 && cos_shading > 0.0;
            // Flux arrives by the geometric cosine and is reflected by the shading one (Veach 1997, 5.3).
            let skew = min(cos_shading / max(cos_geometric, 1e-7), 4.0);
            let arriving = carried.xyz * select(0.0, skew * share * kernel, faces);
            e += arriving;
            sharp += select(vec3<f32>(0.0), arriving, narrowed >= SHARP);
            // A path along the lobe brings this light, unless no path can meet its emitter.
            let shines = glossy && (!sampled || carried.w == WITHOUT_AREA);
            for (var m = select(0u, 1u, faces && shines); m > 0u; m -= 1u) {
                l += arriving * eval_specular(lobe, shading.xyz, wo.xyz, wi);
            }
        }
    }
    indirect[slot] += vec4<f32>(e, 0.0);
    if slot < arrayLength(&caustic) {
        caustic[slot] += vec4<f32>(sharp, 0.0);
    }
    specular[slot] += vec4<f32>(l, 0.0);
}
