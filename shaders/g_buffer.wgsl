// Turns the records of a host's G-buffer into shading points. See pass/g_buffer.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "point.wgsl"
#include "clusters.wgsl"
#include "camera.wgsl"
#include "environment.wgsl"
#include "list_point.wgsl"

@group(0) @binding(1) var<storage, read> given_position: array<vec4<f32>>;  // w: above 0 where a surface is seen
@group(0) @binding(2) var<storage, read> given_normal: array<vec4<f32>>;    // of shading, of any length; w: roughness
@group(0) @binding(3) var<storage, read> given_geometric: array<vec4<f32>>; // zero: as that of shading
@group(0) @binding(4) var<storage, read> given_albedo: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> given_specular: array<vec4<f32>>;  // reflectance at normal incidence
@group(0) @binding(6) var<storage, read> given_emission: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> refused: array<atomic<u32>>; // [0]: pixels whose records are no numbers or tell no surface
@group(0) @binding(8) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(9) var<storage, read_write> work_out: DispatchCounts;
@group(0) @binding(10) var<storage, read> point_step: PointStep;
@group(0) @binding(21) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(22) var<storage, read_write> point_position: array<vec4<f32>>;
@group(0) @binding(23) var<storage, read_write> point_geometric: array<vec4<f32>>;
@group(0) @binding(24) var<storage, read_write> point_shading: array<vec4<f32>>;
@group(0) @binding(25) var<storage, read_write> point_kd: array<vec4<f32>>;
@group(0) @binding(26) var<storage, read_write> point_f0: array<vec4<f32>>;
@group(0) @binding(27) var<storage, read_write> point_wo: array<vec4<f32>>;
@group(0) @binding(28) var<storage, read_write> throughput: array<vec4<f32>>;

// Host twins: pass::g_buffer::{FARTHEST, BRIGHTEST}.
const FARTHEST: f32 = 1e9;
const BRIGHTEST: f32 = 1e30;

// Whether all are numbers, by their bits: comparisons with NaN are what the driver makes of them.
fn are_numbers(v: vec4<f32>) -> bool {
    return all((bitcast<vec4<u32>>(v) & vec4<u32>(0x7f800000u)) != vec4<u32>(0x7f800000u));
}

fn is_direction(v: vec3<f32>) -> bool {
    let longest = max(max(abs(v.x), abs(v.y)), abs(v.z));
    return longest > 1e-6 && longest < 1e6;
}

fn unit_length(v: vec3<f32>) -> vec3<f32> {
    return v / sqrt(max(dot(v, v), 1e-20));
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
    let tiles = (frame.size.xy + 7u) / 8u;
    let total = 64u * tiles.x * tiles.y;
    if index >= total {
        return;
    }
    // The order is that of eye_points.wgsl.
    let ordered = point_step.order != ORDER_ANY;
    let by_screen = point_step.order == ORDER_SCREEN;
    if ordered && !by_screen && index == 0u {
        work_out.total = total;
    }
    let at = divided(index, 8u * tiles.x).yx;
    let tiled = 64u * (at.x / 8u + at.y / 8u * tiles.x) + 8u * (at.y & 7u) + (at.x & 7u);
    let place = select(tiled, place_of(at), by_screen);
    if at.x >= frame.size.x || at.y >= frame.size.y {
        if ordered && !by_screen {
            list_out[place] = NO_POINT;
        }
        return;
    }
    let slot = at.x + at.y * frame.size.x;
    let position = given_position[slot];
    let normal = given_normal[slot];
    let side = given_geometric[slot];
    let albedo = given_albedo[slot];
    let specular = given_specular[slot];
    let emission = given_emission[slot];

    let numbers = are_numbers(position) && are_numbers(normal) && are_numbers(side)
        && are_numbers(albedo) && are_numbers(specular) && are_numbers(emission);
    let claims = !are_numbers(vec4<f32>(position.w)) || position.w > 0.0;
    let to = select(vec3<f32>(0.0), position.xyz - frame.eye.xyz, numbers);
    let depth = dot(to, frame.forward.xyz);
    let parallel = is_orthographic();
    let near_enough = all(abs(position.xyz) <= vec3<f32>(FARTHEST));
    let found = claims && numbers && near_enough && is_direction(normal.xyz) && depth > 0.0;
    if claims && !found {
        atomicAdd(&refused[0], 1u);
    }

    // The ray through the pixel's centre, where nothing is seen.
    let ray = ray_through(f32(at.x + frame.within.x) + 0.5, f32(at.y + frame.within.y) + 0.5);
    let distance = sqrt(max(dot(to, to), 1e-37));
    let d = select(unit_length(ray.d), select(to / distance, frame.forward.xyz, parallel), found);
    let t = select(distance, depth, parallel);

    // Both normals on the side of the eye.
    let shading_given = select(-d, unit_length(normal.xyz), found);
    let has_side = found && is_direction(side.xyz);
    let geometric_given = select(shading_given, unit_length(side.xyz), has_side);
    let geometric = select(geometric_given, -geometric_given, dot(geometric_given, d) > 0.0);
    let turned = select(-shading_given, shading_given, dot(shading_given, geometric) >= 0.0);
    let shading = select(geometric, turned, dot(turned, d) < 0.0);

    let none = vec3<f32>(0.0);
    let one = vec3<f32>(1.0);
    let kd = select(none, clamp(albedo.xyz, none, one), found);
    let f0 = select(none, clamp(specular.xyz, none, one), found);
    let f90 = clamp(50.0 * max(max(f0.x, f0.y), f0.z), 0.0, 1.0);
    let roughness = select(1.0, clamp(normal.w, 0.0, 1.0), found);
    let r = Reflectance(kd, f90, f0, max(roughness * roughness, 1e-3));
    let lit = found && mean3(kd) + mean3(f0) > 0.0 && point_step.last == 0u;
    let soft = lit && frame.soft.x > 0u;
    let flags = flag_if(SOFT, soft) | flag_if(LIT, lit) | flag_if(COVERED, found || has_environment()) | flag_if(HIT, found) | flag_if(GLOSSY, f90 > 0.0);

    // A loop, because it runs zero times where there is none.
    var around = none;
    for (var i = select(0u, 1u, !found && has_environment()); i > 0u; i -= 1u) {
        around = environment_seen(d);
    }
    let light = select(around, clamp(emission.xyz, none, vec3<f32>(BRIGHTEST)), found);
    emitted[slot] = vec4<f32>(light, 0.0);
    throughput[slot] = vec4<f32>(one, select(0.0, depth, found));
    let p = select(none, position.xyz, found);
    point_position[slot] = vec4<f32>(select(none, offset_origin(p, geometric, frame.eye.w), found), select(0.0, t, found));
    point_geometric[slot] = vec4<f32>(geometric, f90);
    point_shading[slot] = vec4<f32>(shading, r.alpha);
    point_kd[slot] = vec4<f32>(kd, diffuse_probability(r));
    point_f0[slot] = vec4<f32>(f0, 0.0);
    point_wo[slot] = vec4<f32>(-d, bitcast<f32>(flags));
    list_point(slot, lit, ordered, place);
}
