// Adds each summand of a pass's image to its own running sums. See pass/summands.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "exact_sum.wgsl"

@group(0) @binding(1) var<storage, read> status: array<u32>;
@group(0) @binding(2) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> reflected: array<vec4<f32>>;  // light of second components and mirror images
@group(0) @binding(10) var<storage, read_write> sum_emission: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> rest_emission: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> sum_diffuse: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read_write> rest_diffuse: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> sum_specular: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> rest_specular: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read_write> tail_emission: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read_write> tail_diffuse: array<vec4<f32>>;
@group(0) @binding(18) var<storage, read_write> tail_specular: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let seen = emitted[pixel].xyz;
    let through = throughput[pixel].xyz;
    let light = lighting_of(pixel);
    let zero = vec3<f32>(0.0);
    let body = diffuse_radiance(through * point_kd[pixel].xyz, light.e_direct + light.e_indirect);
    let gloss = through * light.l_specular + reflected[pixel].xyz;
    // Light seen in a mirror or through glass belongs to the specular summand of the mirror or the glass.
    let by_mirror = has_flag(point_wo[pixel].w, SEEN_BY_SPECULAR);
    let emission = select(seen, zero, by_mirror);
    let diffuse = select(body, zero, by_mirror);
    let mirrored = gloss + select(zero, seen + body, by_mirror);
    // `accumulate` reads no second components, so their light is added here.
    emitted[pixel] = vec4<f32>(seen + reflected[pixel].xyz, 0.0);
    if (status[0] | status[1]) != 0u {
        return;
    }
    let emission_sum = sum_with(sum_emission[pixel], rest_emission[pixel], vec4<f32>(emission, 0.0));
    sum_emission[pixel] = emission_sum.high;
    rest_emission[pixel] = emission_sum.middle;
    if any(emission_sum.error != vec4<f32>(0.0)) {
        tail_emission[pixel] += emission_sum.error;
    }
    let diffuse_sum = sum_with(sum_diffuse[pixel], rest_diffuse[pixel], vec4<f32>(diffuse, 0.0));
    sum_diffuse[pixel] = diffuse_sum.high;
    rest_diffuse[pixel] = diffuse_sum.middle;
    if any(diffuse_sum.error != vec4<f32>(0.0)) {
        tail_diffuse[pixel] += diffuse_sum.error;
    }
    let specular_sum = sum_with(sum_specular[pixel], rest_specular[pixel], vec4<f32>(mirrored, 0.0));
    sum_specular[pixel] = specular_sum.high;
    rest_specular[pixel] = specular_sum.middle;
    if any(specular_sum.error != vec4<f32>(0.0)) {
        tail_specular[pixel] += specular_sum.error;
    }
}
