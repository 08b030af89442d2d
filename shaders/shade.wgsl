// Lights shading points by every point light of a chunk, with shadows. See pass/shade.rs.
// ALPHA: some surfaces let light pass.
// VISIBILITY: only counts the lights visible to each shading point. See pass/visibility.rs.
// AREA: with VISIBILITY, the lights are area lights and each ray goes to its own point of one.
#include "frame.wgsl"
#include "work.wgsl"
#include "bvh.wgsl"
#include "triangle.wgsl"
#include "math.wgsl"
#if ALPHA
#include "alpha.wgsl"
#endif
#include "bsdf.wgsl"
#include "lights.wgsl"
#include "point.wgsl"
#if AREA
#include "area.wgsl"
#endif
#if VISIBILITY
#else
#include "light_at.wgsl"
#include "listed_light.wgsl"
#endif

@group(0) @binding(6) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> point_geometric: array<vec4<f32>>;
#if VISIBILITY
#else
@group(0) @binding(8) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> point_f0: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> point_wo: array<vec4<f32>>;
#endif
@group(0) @binding(11) var<storage, read> lights: array<PointLight>;
@group(0) @binding(12) var<storage, read> list: array<u32>;
@group(0) @binding(13) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(14) var<storage, read> steps: array<Step>;
@group(0) @binding(15) var<storage, read_write> progress: array<vec2<u32>>;
#if VISIBILITY
@group(0) @binding(16) var<storage, read_write> visible: array<u32>;
#else
@group(0) @binding(16) var<storage, read_write> direct: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read_write> indirect: array<vec4<f32>>;
@group(0) @binding(18) var<storage, read_write> specular: array<vec4<f32>>;
@group(0) @binding(19) var<storage, read> first_light: array<u32>;
@group(0) @binding(29) var<storage, read> listed_lights: array<vec2<u32>>;
#endif
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let step = steps[push.step];
    let place = spread_group(group, groups) * 64u + lane;
    // A sorted list, or one in the order of the screen, may have slots without a shading point.
    if place >= max(atomicLoad(&work.live), work.total) {
        return;
    }
    let slot = list[place];
    if slot == NO_POINT {
        return;
    }
#if VISIBILITY
    let lights_at = 0u;
#else
    let lights_at = first_light[slot];
#endif
    let nodes = frame.scene.x;
    var light = step.first;
    var node = 0u;
#if ALPHA
    // Share of the light that the surfaces on its way let pass. The next round finds that of an unfinished ray beside the sums.
    var passes = 1.0;
#endif
    if step.round > 0u {
        let at = progress[slot];
        light = at.x;
        node = at.y;
#if ALPHA
        passes = select(1.0, specular[slot].w, node > 0u);
#endif
    }
    let origin = point_position[slot].xyz;
    let geometric = point_geometric[slot];
#if VISIBILITY
    var seen = select(0u, visible[slot], step.clears == 0u);
#else
    let shading = point_shading[slot];
    let f0 = point_f0[slot];
    let wo = point_wo[slot];
    let glossy = has_flag(wo.w, GLOSSY);
    let sampled = has_flag(wo.w, LOBE_SAMPLED);
    let splats = has_flag(wo.w, SPLATS);
    let soft = has_flag(wo.w, SOFT);
    let used = f32(segments_of(wo.w));
    // The first chunk starts the sums; values of an earlier frame are not read.
    var e_direct = select(vec3<f32>(0.0), direct[slot].xyz, step.clears == 0u);
    var e_indirect = select(vec3<f32>(0.0), indirect[slot].xyz, step.clears == 0u);
    var l_specular = select(vec3<f32>(0.0), specular[slot].xyz, step.clears == 0u);
#endif

    // A dispatch takes a bounded number of lights; the next round continues a larger chunk.
    let end = min(step.end, light + step.lights);
    while light < end {
        let at_light = lights_at + light;
#if AREA
        let l_position = vec4<f32>(area_point(area_light(lights[at_light]), slot, at_light), 0.0);
#else
#if VISIBILITY
        let l_position = lights[at_light].position;
#else
        let listed = listed_lights[at_light];
        let times = bitcast<f32>(listed.y);
        let l_position = lights[listed.x].position;
#endif
#endif
#if VISIBILITY
        let d = l_position.xyz - origin;
        let lit = dot(d, geometric.xyz) > 0.0;
#else
        let l_normal = lights[listed.x].normal;
        let l_emit = vec4<f32>(lights[listed.x].emit.xyz * times, lights[listed.x].emit.w);
        let l_f0 = lights[listed.x].f0;
        let flags = bitcast<u32>(l_position.w);
        let d = to_light(l_position, l_normal, origin);
        let r2 = dot(d, d);
        let wi = d / sqrt(max(r2, 1e-37));
        let cos_light = -dot(wi, l_normal.xyz);
        var intensity = plain_intensity(l_normal, l_emit, flags, cos_light);
        // Rare work is in loops that mostly run zero times: a SIMD driver executes an `if` for all lanes.
        for (var i = select(0u, 1u, lobe_shines(flags, cos_light)); i > 0u; i -= 1u) {
            intensity += lobe_intensity(listed_light(at_light), wi, cos_light);
        }
        let cos_receiver = dot(wi, shading.xyz);
        let lit = cos_receiver > 0.0 && dot(wi, geometric.xyz) > 0.0 && mean3(intensity) > 0.0 && r2 > 0.0
            && l_f0.w + used <= f32(step.bounces) && (glossy || !soft || (flags & LIGHT_SOFT) == 0u);
#endif

        // Shadow ray from the shading point (t = 0) to the light (t = 1): any triangle strictly between blocks it.
        let inverse = safe_inverse(d);
        var left = step.steps;
        node = select(nodes, node, lit);
        var blocked = false;
#if ALPHA
        // A surface that lets light pass interrupts the walk and is looked up outside of it: in the walk the code of the look-up took
        // longer than all other code (lavapipe), where it ran and where it did not. The walk goes on in the same leaf, which it always
        // finishes.
        var resume = 0u;
        loop {
        var waiting = NO_TRIANGLE;
        while node < nodes && (left > 0u || resume > 0u) && waiting == NO_TRIANGLE {
#else
        while node < nodes && left > 0u {
#endif
            left = max(left, 1u) - 1u;
            let lo = node_min[node];
            let hi = node_max[node];
            let span = slab(lo.xyz, hi.xyz, origin, inverse, 1.0);
            let inside = span.x <= span.y;
            let leaf = bitcast<u32>(hi.w);
            let first = leaf >> 3u;
            let end = first + select(0u, leaf & 7u, inside);
#if ALPHA
            for (var i = max(first, resume); i < end && waiting == NO_TRIANGLE; i += 1u) {
                for (var j = select(0u, 1u, intersect_triangle(i, origin, d, 1.0).ok); j > 0u; j -= 1u) {
                    let lets_pass = has_alpha(i);
                    waiting = select(NO_TRIANGLE, i, lets_pass);
                    blocked = blocked || !lets_pass;
                }
            }
            resume = select(waiting + 1u, 0u, waiting == NO_TRIANGLE);
            let stays = waiting != NO_TRIANGLE;
#else
            for (var i = first; i < end; i += 1u) {
                blocked = blocked || intersect_triangle(i, origin, d, 1.0).ok;
            }
            let stays = false;
#endif
            node = select(select(bitcast<u32>(lo.w), node + 1u, inside && leaf == 0u), node, stays);
            node = select(node, nodes, blocked);
        }
#if ALPHA
            if waiting == NO_TRIANGLE || blocked {
                break;
            }
            let hit = intersect_triangle(waiting, origin, d, 1.0);
            passes *= 1.0 - coverage_at(waiting, hit.u, hit.v);
            blocked = passes <= 0.0;
            node = select(node, nodes, blocked);
        }
#endif
        if node < nodes {
            break;
        }
        node = 0u;
#if ALPHA
        intensity *= passes;
        passes = 1.0;
#endif

#if VISIBILITY
        seen += select(0u, 1u, lit && !blocked);
#else
        let e = intensity * select(0.0, cos_receiver * falloff_beyond(flags, r2, select(1.0, 0.25, step.closer == 1u)), lit && !blocked);
        let is_direct = l_f0.w == 0.0;
        e_direct += select(vec3<f32>(0.0), e, is_direct && !(soft && (flags & LIGHT_SOFT) != 0u));
        e_indirect += select(e, vec3<f32>(0.0), is_direct);
        for (var i = select(0u, 1u, glossy && lit && !blocked && (is_direct || !splats)); i > 0u; i -= 1u) {
            let lobe = lobe_density(shading.w, shading.xyz, wo.xyz, wi);
            let divided = intensity * (cos_receiver * highlight_falloff(l_f0, lights[listed.x].wi, flags, r2, cos_light, lobe));
            let near = intensity * (cos_receiver * falloff_beyond(flags, r2, SPLAT_CLIP));
            l_specular += select(select(e, near, splats), divided, sampled) * eval_specular(point_lobe(geometric, shading, f0), shading.xyz, wo.xyz, wi);
        }
#endif
        light += 1u;
    }
#if VISIBILITY
    visible[slot] = seen;
#else
    direct[slot] = vec4<f32>(e_direct, 0.0);
    indirect[slot] = vec4<f32>(e_indirect, 0.0);
#if ALPHA
    specular[slot] = vec4<f32>(l_specular, select(0.0, passes, node > 0u));
#else
    specular[slot] = vec4<f32>(l_specular, 0.0);
#endif
#endif
    progress[slot] = vec2<u32>(light, node);
    if light < step.end {
        atomicAdd(&work.unfinished, 1u);
    }
}
