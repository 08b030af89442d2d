// Looks for the light at the hits of near rays: in the pixels that show them, or else they are listed to be lit. See
// pass/near_points.rs.
// ONWARD: at the hits of near rays that went on from a hit.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "point.wgsl"
#include "surface.wgsl"
#include "write_point.wgsl"
#include "near.wgsl"
#if ONWARD
#include "emitters.wgsl"
@group(0) @binding(34) var<storage, read> emitters: array<EmitterRecord>;
#include "aim.wgsl"
#endif

@group(0) @binding(29) var<storage, read> seen_position: array<vec4<f32>>;
@group(0) @binding(30) var<storage, read> seen_geometric: array<vec4<f32>>;
@group(0) @binding(31) var<storage, read> seen_wo: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read> hits: array<vec4<f32>>;
#if ONWARD
@group(0) @binding(13) var<storage, read> ray_direction: array<vec4<f32>>;
#else
@group(0) @binding(13) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(20) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(32) var<storage, read_write> onward: array<u32>;
@group(0) @binding(33) var<storage, read_write> onward_work: DispatchCounts;
#endif
@group(0) @binding(14) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(15) var<storage, read_write> work_out: DispatchCounts;
@group(0) @binding(16) var<storage, read_write> near_slot: array<u32>;
@group(0) @binding(17) var<storage, read> list_in: array<u32>;
@group(0) @binding(18) var<storage, read_write> work_in: DispatchCounts;
@group(0) @binding(19) var<storage, read_write> beta: array<vec4<f32>>;

// The nearest pixel of a class that shows a point of a surface with normal n, or NO_POINT.
fn pixel_showing(p: vec3<f32>, n: vec3<f32>, of_class: u32) -> u32 {
    let d = p - frame.eye.xyz;
    let z = depth_scale(max(dot(d, frame.forward.xyz), 1e-30));
    let half_width = dot(frame.right.xyz, frame.right.xyz);
    let half_height = dot(frame.up.xyz, frame.up.xyz);
    let s = dot(d, frame.right.xyz) / (z * half_width) - frame.shift.x;
    let t = dot(d, frame.up.xyz) / (z * half_height) - frame.shift.y;
    let whole = vec2<f32>(frame.within.zw);
    // The eye ray of a pixel passes at this offset from its corner.
    let at = vec2<f32>(0.5 + 0.5 * s, 0.5 - 0.5 * t) * whole - vec2<f32>(frame.within.xy) - frame.pixel_offset.xy;
    let pattern = vec2<f32>(frame.pattern.xy);
    let place = vec2<f32>(divided(of_class, frame.pattern.x).yx);
    let pixel = floor((at - place) / pattern + 0.5) * pattern + place;
    let inside = dot(d, frame.forward.xyz) > 0.0 && all(pixel >= vec2<f32>(0.0)) && all(pixel < vec2<f32>(frame.size.xy));
    let safe = vec2<u32>(select(vec2<f32>(0.0), pixel, vec2<bool>(inside)));
    let slot = safe.x + safe.y * frame.size.x;
    let normal = seen_geometric[slot].xyz;
    let word = seen_wo[slot];
    let apart = seen_position[slot].xyz - p;
    // Width of a pixel at this depth, and on the surface.
    let width = 2.0 * z * sqrt(half_width) / whole.x;
    let cosine = max(abs(dot(normal, word.xyz)), 0.1);
    let reach = (NEAR_WIDTH + max(pattern.x, pattern.y)) * width;
    let agrees = dot(normal, n) > NEAR_COSINE
        && abs(dot(normal, apart)) <= NEAR_HEIGHT * width
        && dot(apart, apart) * cosine * cosine <= reach * reach;
    let shows = has_flag(word.w, LIT) && !has_flag(word.w, SEEN_BY_SPECULAR);
    return select(NO_POINT, slot, inside && agrees && shows);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
    if index >= atomicLoad(&work_in.live) {
        return;
    }
    let slot = list_in[index];
    let met = gathered_by(ray_direction[slot].xyz, hits[slot]);
    // The share of light that clipping removed.
#if ONWARD
    let clip2 = NEAR_CLOSER * NEAR_CLOSER * frame.right.w;
#else
    let clip2 = frame.right.w;
#endif
    let share = max(1.0 - met.t * met.t / max(clip2, 1e-37), 0.0);
    let before = beta[slot];
    let weight = select(vec3<f32>(0.0), before.xyz * share, met.found);
    let r = met.surface.reflectance;
    let sends = mean3(weight) > 0.0 && reflects(met);
    let matte = is_matte(r.kd, r.f0);
    let shown = pixel_showing(met.surface.position, met.surface.geometric, class_of(slot));
    let q = select(NO_POINT, shown, sends && matte);
    near_slot[slot] = q;
    // From the irradiance there to that of the pixel or to the radiance of its lobe.
    let link = weight * (r.kd + r.f0) * INV_PI;
    let is_shown = q != NO_POINT;
    // Light that a hit reflects has three segments at least.
    var lit = sends && !is_shown && frame.scene.z > 2u;
    var chance = 1.0;
    var kept = true;
#if ONWARD
    let goes_on = false;
    // The points still hold the hit that it comes from, where other rays aim at emitters.
    let normal = point_shading[slot].xyz;
    let wi = ray_direction[slot].xyz;
    let by_aim = aimed_density(point_position[slot].xyz, normal, NEAR_CLOSER * frame.up.w, wi);
    let of_emitters = onward_weights(dot(wi, normal), by_aim).along_lobe;
    emitted[slot] = vec4<f32>(of_emitters * weight * met.surface.emission, 1.0);
#else
    // The less light clipping removed, the fewer of the hits that no pixel shows count.
    let sample = sample_of(slot);
    let share_kept = select(1.0, max(share, NEAR_KEPT), lit);
    kept = random(key(frame.keys.x, STREAM_NEAR, sample, 3u)) < share_kept;
    lit = lit && kept;
    // Some rays go on from such a hit, for near light of its own, and it is not lit.
    let s = met.surface;
    let may_go_on = lit && matte && mean3(s.emission) == 0.0 && frame.scene.z > 3u;
    let goes_on = may_go_on && random(key(frame.keys.x, STREAM_NEAR, sample, 0u)) < NEAR_ONWARD;
    lit = lit && !goes_on;
    chance = share_kept * select(1.0, select(1.0 - NEAR_ONWARD, NEAR_ONWARD, goes_on), may_go_on);
    emitted[slot] = vec4<f32>(ray_direction[slot].w * weight * s.emission, 0.0);
    if goes_on {
        let u = random(key(frame.keys.x, STREAM_NEAR, sample, 1u));
        let v = random(key(frame.keys.x, STREAM_NEAR, sample, 2u));
        let d = sample_lobe(r, true, 1.0, s.shading, -met.d, u, v);
        let reach = select(0.0, NEAR_CLOSER * frame.up.w, dot(d.wi, s.geometric) > 0.0);
        ray_origin[slot] = vec4<f32>(offset_origin(s.position, s.geometric, frame.eye.w), reach);
        ray_direction[slot] = vec4<f32>(d.wi, 0.0);
        onward[atomicAdd(&onward_work.live, 1u)] = slot;
    }
#endif
    let through = select(vec3<f32>(0.0), weight / chance, kept) * select(vec3<f32>(1.0), r.kd, goes_on);
    beta[slot] = vec4<f32>(select(through, link, is_shown), before.w);
    if is_shown {
        point_wo[slot] = vec4<f32>(0.0);
    } else {
        write_point(slot, met, flag_if(LIT, lit));
    }
    list_point(slot, lit, false, 0u);
}
