// Sums the light of near rays, from pixel to pixel. See pass/near_collect.rs.
// SOFT_SHADOWS: light with soft shadows is kept apart.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "near.wgsl"

@group(0) @binding(1) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(2) var<storage, read> list: array<u32>;
// Of the gathered points.
@group(0) @binding(3) var<storage, read> beta: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> emitted: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> near_slot: array<u32>;
// After 1, 2, 3 near rays: of direct light, indirect light and emission the shares that the maximum path length allows; of indirect
// light at points that were lit for the first near ray.
@group(0) @binding(11) var<storage, read> shares: array<vec4<f32>, 3>;
// Of the pixels.
@group(0) @binding(12) var<storage, read> pixel_direct: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read> pixel_indirect: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read> seen_wo: array<vec4<f32>>;
#if SOFT_SHADOWS
@group(0) @binding(17) var<storage, read> soft_direct: array<vec4<f32>>;
#endif
// Light through near rays: direct and indirect irradiance. w of the first: the lobe, as in beta.
@group(0) @binding(15) var<storage, read_write> near_direct: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read_write> near_indirect: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
    if place >= atomicLoad(&work.live) {
        return;
    }
    let slot = list[place];
    var at = slot;
    var through = vec3<f32>(1.0);
    var e_direct = vec3<f32>(0.0);
    var e_indirect = vec3<f32>(0.0);
    // Near rays so far.
    var k = 0u;
    while k < NEAR_LINKS && at != NO_POINT {
        let b = through * beta[at].xyz;
        let q = near_slot[at];
        let shown = q != NO_POINT;
        let safe = select(at, q, shown);
        // A ray that went on stands for two.
        let e_own = emitted[at];
        let went_on = e_own.w != 0.0;
        let links = k + select(0u, 1u, went_on);
        let share = select(vec4<f32>(0.0), shares[min(links, NEAR_LINKS - 1u)], links < NEAR_LINKS);
#if SOFT_SHADOWS
        // Second components have none.
        let of_pixel = safe < frame.size.z;
        let direct_light = pixel_direct[safe].xyz + select(vec3<f32>(0.0), soft_direct[select(0u, safe, of_pixel)].xyz, of_pixel);
#else
        let direct_light = pixel_direct[safe].xyz;
#endif
        let by_pixel = share.x * direct_light + share.y * pixel_indirect[safe].xyz;
        let gathered = lighting_of(at);
        let lit = diffuse_radiance(point_kd[at].xyz, share.x * gathered.e_direct + share.w * gathered.e_indirect) + share.w * gathered.l_specular;
        // An emitter hit by the first near ray is direct light.
        let e = share.z * through * e_own.xyz;
        let is_direct = links == 0u;
        e_direct += select(vec3<f32>(0.0), e, is_direct);
        e_indirect += b * select(lit, by_pixel, shown) + select(e, vec3<f32>(0.0), is_direct);
        // A near ray stands for pixels without one, but once: those that it leads to are of its class, and have one too.
        through = b / near_ray_weight(at, seen_wo[at].w);
        // That pixel may have no near ray, or one from its lobe, which is not irradiance.
        at = select(NO_POINT, q, shown && has_near_rays(class_of(safe), near_begin()) && beta[safe].w == 0.0);
        k = links + 1u;
    }
    near_direct[slot] = vec4<f32>(e_direct, beta[slot].w);
    near_indirect[slot] = vec4<f32>(e_indirect, 0.0);
}
