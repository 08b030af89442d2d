// Takes the irradiance of caustics from the light that the filters average, or adds it after them. See pass/caustics.rs.
// TAKE: takes it. Without: adds it to both.
#include "frame.wgsl"

@group(0) @binding(1) var<storage, read> caustic: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> raw_indirect: array<vec4<f32>>;
#if TAKE
#else
@group(0) @binding(3) var<storage, read_write> indirect: array<vec4<f32>>;
#endif

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let slot = (group.x + group.y * groups.x) * 64u + lane;
    if slot >= arrayLength(&caustic) {
        return;
    }
    let light = vec4<f32>(caustic[slot].xyz, 0.0);
    // Zero times for most points.
    for (var i = select(0u, 1u, any(light.xyz != vec3<f32>(0.0))); i > 0u; i -= 1u) {
#if TAKE
        raw_indirect[slot] -= light;
#else
        raw_indirect[slot] += light;
        indirect[slot] += light;
#endif
    }
}
