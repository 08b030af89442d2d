// Writes shading points and lists them. Needs work.wgsl, math.wgsl, bsdf.wgsl, point.wgsl and surface.wgsl.
// The shader binds `list_out` and `work_out`.
#include "list_point.wgsl"

@group(0) @binding(21) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(22) var<storage, read_write> point_position: array<vec4<f32>>;
@group(0) @binding(23) var<storage, read_write> point_geometric: array<vec4<f32>>;
@group(0) @binding(24) var<storage, read_write> point_shading: array<vec4<f32>>;
@group(0) @binding(25) var<storage, read_write> point_kd: array<vec4<f32>>;
@group(0) @binding(26) var<storage, read_write> point_f0: array<vec4<f32>>;
@group(0) @binding(27) var<storage, read_write> point_wo: array<vec4<f32>>;

// The hit of a ray in direction d at distance t.
struct Met {
    surface: Surface,
    d: vec3<f32>,
    t: f32,
    found: bool,            // false: it met nothing, and the surface is any
    without_lobe: bool,     // the specular lobe is left out
}

// `width`: that of the cone around the ray where it ends.
fn met_by(d: vec3<f32>, hit: vec4<f32>, width: f32) -> Met {
    let triangle = bitcast<u32>(hit.w);
    let found = triangle != 0xffffffffu;
    return Met(surface_at(select(0u, triangle, found), hit.y, hit.z, d, width), d, hit.x, found, false);
}

// As `met_by`, for gather rays: its lobe is widened as that of a light, so that no light shines at it from an extremely narrow one.
fn gathered_by(d: vec3<f32>, hit: vec4<f32>) -> Met {
    var met = met_by(d, hit, frame.cones.z * hit.x);
    met.surface.reflectance.alpha = widened_alpha(met.surface.reflectance.alpha, frame.pixel_offset.z);
    return met;
}

// Whether it reflects any light.
fn reflects(met: Met) -> bool {
    let lobe = select(mean3(met.surface.reflectance.f0), 0.0, met.without_lobe);
    return mean3(met.surface.reflectance.kd) + lobe > 0.0;
}

// `flags`: those besides HIT and GLOSSY.
fn write_point(slot: u32, met: Met, flags: u32) {
    let s = met.surface;
    let r = s.reflectance;
    let glossy = r.f90 > 0.0 && !met.without_lobe;
    // Of a lobe with a path of its own, or with splats, nothing is clipped, and nothing has to be gathered.
    let sampled = (flags & (LOBE_SAMPLED | SPLATS)) != 0u;
    let diffuse = select(diffuse_probability(r), 1.0, met.without_lobe || sampled);
    let word = flags | flag_if(HIT, met.found) | flag_if(GLOSSY, glossy);
    point_position[slot] = vec4<f32>(offset_origin(s.position, s.geometric, frame.eye.w), select(0.0, met.t, met.found));
    point_geometric[slot] = vec4<f32>(s.geometric, r.f90);
    point_shading[slot] = vec4<f32>(s.shading, r.alpha);
    point_kd[slot] = vec4<f32>(select(vec3<f32>(0.0), r.kd, met.found), diffuse);
    point_f0[slot] = vec4<f32>(select(vec3<f32>(0.0), r.f0, met.found), 0.0);
    point_wo[slot] = vec4<f32>(-met.d, bitcast<f32>(word));
}
