// The shading point at the end of an eye path. Needs frame.wgsl, math.wgsl, point.wgsl, surface.wgsl and write_point.wgsl.

#include "environment.wgsl"
#include "lobe_shares.wgsl"

@group(0) @binding(28) var<storage, read_write> throughput: array<vec4<f32>>;
@group(0) @binding(29) var<storage, read> lobe_of: array<f32>;      // density of the ray's direction if it follows a lobe, else 0

// Whether light reaches the eye by a path of this throughput.
fn carries(weight: vec3<f32>) -> bool {
    return max(max(weight.x, weight.y), weight.z) > 0.0;
}

// Whether splats show the lobe of this alpha.
fn shows_splats(alpha: f32) -> bool {
    let least = frame.superposition.w;
    return least != 0u && width_of(alpha) > bitcast<f32>(least);
}

// Writes the shading point that a path's last ray met, and returns whether it is lit. `only_emits`: paths are too short for light that
// it reflects.
fn end_eye_path(slot: u32, ray: vec4<f32>, hit: vec4<f32>, only_emits: bool) -> bool {
    let through = throughput[slot];
    let before = emitted[slot];
    // Flat mirrors keep the width of a pixel's cone; curved ones are taken for flat.
    var met = met_by(ray.xyz, hit, frame.cones.x * depth_scale(through.w + ray.w * hit.x));
    // A glossy plane seen directly shows only its base here; the lobe comes with the mirror image. At curved surfaces that depends on the
    // curvature, and `eye_paths` has said so.
    let triangle = select(0u, bitcast<u32>(hit.w), met.found);
    let normals = triangle_normals[triangle];
    let direct = through.w == 0.0 && glossy_plane(normals) > 0u && !is_curved(normals);
    met.without_lobe = direct || has_flag(before.w, LOBE_FOLLOWED);

    // Virtual lights bring the rest of what a path along a lobe meets.
    let segments = segments_of(before.w);
    let follows = met.found && segments > 0u;
    let lobe = select(0.0, lobe_of[select(0u, slot, follows)], follows);
    let cosine = abs(dot(met.surface.geometric, ray.xyz));
    let distance2 = hit.x * hit.x;
    let of_emission = through.xyz * path_share(lobe, lights_on_emitter(met.surface.exitance), distance2, cosine);
    let carried = through.xyz * path_share(lobe, lights_on_surfaces(), distance2, cosine);

    let emission = select(vec3<f32>(0.0), of_emission * met.surface.emission, met.found);
    // A ray that leaves the scene meets the environment. A loop, because it runs zero times where there is none.
    var around = vec3<f32>(0.0);
    let leaves = !met.found && has_environment() && carries(through.xyz);
    for (var i = select(0u, 1u, leaves); i > 0u; i -= 1u) {
        let texel = environment_radiance(ray.xyz);
        let of_lobe = lobe_of[select(0u, slot, segments > 0u)];
        let share = path_share(of_lobe, lights_from_environment(texel.w), 1.0, 1.0);
        around = through.xyz * select(environment_seen(ray.xyz), share * texel.xyz, segments > 0u && of_lobe > 0.0);
    }
    emitted[slot] = vec4<f32>(before.xyz + emission + around, 0.0);
    // The depth of a mirror that shows nothing is its own.
    let depth = through.w + select(0.0, ray.w * hit.x, met.found);
    throughput[slot] = vec4<f32>(carried, depth);

    let sends = reflects(met);
    let reaches = carries(carried);
    let lit = met.found && sends && reaches && !only_emits;
    let by_specular = through.w > 0.0;
    let of_path = bitcast<u32>(before.w) & (LOBE_SAMPLED | NARROW_LOBE | UNLIKELY | CHOSE | DEEP | 15u * ONE_SEGMENT);
    let r = met.surface.reflectance;
    let splats = shows_splats(r.alpha) && r.f90 > 0.0 && !met.without_lobe && !has_flag(before.w, LOBE_SAMPLED);
    let soft = lit && frame.soft.x > 0u && slot < frame.size.z && !by_specular;
    let flags = flag_if(SOFT, soft) | flag_if(SPLATS, splats) | flag_if(LIT, lit) | flag_if(COVERED, met.found || by_specular || has_environment()) | flag_if(SEEN_BY_SPECULAR, by_specular) | of_path;
    write_point(slot, met, flags);
    return lit;
}
