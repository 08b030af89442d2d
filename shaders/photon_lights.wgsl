// Weights by which photons start from virtual lights. See pass/photon_lights.rs.
// SUM: sums them up within each class.
#include "frame.wgsl"
#include "math.wgsl"
#include "emitters.wgsl"
#include "lights.wgsl"
#if SUM
#include "stretches.wgsl"
#else
#include "targets.wgsl"
#endif

@group(0) @binding(1) var<storage, read> lights: array<PointLight>;
@group(0) @binding(2) var<storage, read> targets: array<vec4<f32>>;
// Of the lights after reflections of a class, at their places among all lights.
@group(0) @binding(3) var<storage, read_write> light_sums: array<f32>;

#if SUM
var<workgroup> sums: array<f32, 64>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let first = group.x * frame.pattern.w + frame.depths[1].y;
    let stretch = stretch_of(lane, frame.pattern.w - frame.depths[1].y);
    var own = 0.0;
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        own += light_sums[first + i];
    }
    sums[lane] = own;
    workgroupBarrier();
    var sum = 0.0;
    for (var k = 0u; k < lane; k += 1u) {
        sum += sums[k];
    }
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        sum += light_sums[first + i];
        light_sums[first + i] = sum;
    }
}
#else
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
    if index >= frame.pattern.w * frame.pattern.z {
        return;
    }
    let l = lights[index];
    let gloss = select(0.0, mean3(l.flux.xyz) * mean3(l.f0.xyz) * INV_PI, (bitcast<u32>(l.position.w) & LIGHT_GLOSSY) != 0u);
    var sum = 0.0;
    for (var t = 0u; t < frame.photons.z; t += 1u) {
        sum += weight_of(t, EMITTER_VIRTUAL, l.position.xyz, l.normal.xyz);
    }
    light_sums[index] = (mean3(l.emit.xyz) + gloss) * sum;
}
#endif
