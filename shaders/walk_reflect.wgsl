// Leaves a light where a particle hits a surface, and reflects the particle. See pass/walk_reflect.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "lights.wgsl"
#include "surface.wgsl"
#include "walk.wgsl"

@group(0) @binding(9) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> flux: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read_write> lights: array<PointLight>;
@group(0) @binding(14) var<storage, read> steps: array<Step>;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let step = steps[push.step];
    let particle = (group.x + group.y * groups.x) * 64u + lane;
    let j = step.bounce;
    let depth = frame.depths[j];
    if particle >= depth.x * frame.pattern.z || !begins(particle) {
        return;
    }
    let hit = hits[particle];
    let triangle = bitcast<u32>(hit.w);
    let weight = roulette(j, particle);
    let found = triangle != 0xffffffffu && weight > 0.0;
    let d = ray_direction[particle].xyz;
    let s = surface_at(select(0u, triangle, triangle != 0xffffffffu), hit.y, hit.z, d, frame.cones.y * hit.x);
    let r = s.reflectance;

    // Flux is deposited by the geometric cosine and reflected by the shading one (Veach 1997, 5.3).
    let skew = min(dot(s.shading, d) / min(dot(s.geometric, d), -1e-7), 4.0);
    let carried = flux[particle];
    let arriving = carried.xyz * select(0.0, skew * weight, found);

    // Paths over mirrors and glass may be too long for the light: from the eye over a point that is lit.
    let fits = f32(j) + carried.w + 2.0 <= f32(frame.scene.z);
    let share = select(0.0, bitcast<f32>(depth.z), fits);
    let glossy = r.f90 > 0.0;
    // A wider lobe of the same energy.
    let lobe = Reflectance(r.kd, r.f90, r.f0, turned_lobe(r.alpha, s.shading, s.geometric));
    let alpha = widened_alpha(lobe.alpha, frame.pixel_offset.z);
    let grown = widening_factor(lobe, s.geometric, -d, alpha);
    let flags = LIGHT_SURFACE | LIGHT_CLIPPED | select(0u, LIGHT_GLOSSY, glossy);
    let position = offset_origin(s.position, s.geometric, frame.eye.w);
    lights[light_slot(particle, depth.y)] = PointLight(
        vec4<f32>(position, bitcast<f32>(flags)),
        vec4<f32>(s.geometric, 0.0),
        vec4<f32>(arriving * share * r.kd * INV_PI, 1.0),
        vec4<f32>(-d, alpha),
        vec4<f32>(arriving * share, grown * r.f90),
        vec4<f32>(grown * r.f0, f32(j) + carried.w),
    );

    // The first N_(j+1) particles continue; the others end here.
    let rays = walk_numbers(j + 1u, particle);
    let p_diffuse = diffuse_probability(r);
    let diffuse = random(key(frame.keys.x, STREAM_LOBE, particle, j)) < p_diffuse;
    let next = sample_lobe(r, diffuse, p_diffuse, s.shading, -d, rays.x, rays.y);
    let cos_geometric = dot(next.wi, s.geometric);
    let cos_shading = dot(next.wi, s.shading);
    let flies = found && particle < depth.w * frame.pattern.z && cos_geometric > 0.0 && cos_shading > 0.0;
    let leave = min(cos_geometric / max(cos_shading, 1e-7), 4.0);
    flux[particle] = vec4<f32>(select(vec3<f32>(0.0), arriving * next.weight * leave, flies), carried.w);
    ray_origin[particle] = vec4<f32>(position, select(0.0, 3.0e38, flies));
    ray_direction[particle] = vec4<f32>(next.wi, 0.0);
}
