// Chooses a number of pairs of a light and a planar mirror for each class of pixels. See pass/mirror_lights.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "lights.wgsl"
#include "mirror_lights.wgsl"

@group(0) @binding(1) var<storage, read> lights: array<PointLight>;
@group(0) @binding(2) var<storage, read> mirrors: array<MirrorRecord>;
@group(0) @binding(3) var<storage, read_write> mirrored: array<PointLight>;
@group(0) @binding(4) var<storage, read_write> mirror_number: array<u32>;

var<private> class_lights: u32;

// Approximate flux of a light that a mirror reflects; candidate i is light i / M and mirror i % M.
fn weight_of(i: u32) -> f32 {
    let l = lights[class_lights + i / frame.mirrors.z];
    let mirror = mirrors[i % frame.mirrors.z];
    let flags = bitcast<u32>(l.position.w);
    let n = mirror.plane.xyz;
    let height = height_of(mirror, l.position.xyz);
    let to = mirror.middle.xyz - l.position.xyz;
    let far2 = max(dot(to, to), max(mirror.middle.w * INV_PI, 1e-30));
    let far = sqrt(far2);
    // Maximum cosine at the light over directions to the mirror's bounding sphere.
    let surface = (flags & LIGHT_SURFACE) != 0u;
    let wide = clamp((dot(l.normal.xyz, to) + mirror.ideal.w) / far, 0.0, 1.0);
    let turned_away = surface && dot(l.normal.xyz, n) * sign(height) > 0.99999;
    let gloss = select(0.0, mean3(l.flux.xyz) * mean3(l.f0.xyz) * INV_PI, (flags & LIGHT_GLOSSY) != 0u);
    let intensity = (mean3(l.emit.xyz) + gloss) * select(1.0, wide, surface);
    let angle = mirror.middle.w * clamp(abs(height) / far, 0.1, 1.0) / far2;
    let point_like = select(intensity * angle, 0.0, height == 0.0 || turned_away);
    let parallel = mean3(l.emit.xyz) * mirror.middle.w * abs(dot(l.normal.xyz, n));
    return mean3(mirror.ideal.xyz) * select(point_like, parallel, (flags & LIGHT_DIRECTIONAL) != 0u);
}

#include "systematic.wgsl"

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let slots = frame.mirrors.x;
    let count = frame.mirrors.y * frame.mirrors.z;
    let stretch = stretch_of(lane, count);
    let first_slot = group.x * slots;
    class_lights = group.x * frame.pattern.w;

    for (var k = lane; k < slots; k += 64u) {
        mirror_number[first_slot + k] = 0u;
    }
    let scale = scale_of(lane, stretch, count, slots);
    var share_sum = 0u;
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        let weight = weight_of(i);
        share_sum += select(0u, share_of(weight, scale), weight > 0.0);
    }
    storageBarrier();
    var begin = sum_before(lane, share_sum);
    let offset = offset_of(STREAM_MIRROR, group.x);
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        let weight = weight_of(i);
        let share = select(0u, share_of(weight, scale), weight > 0.0);
        let slot = slot_at(begin, offset);
        if slot * ONE + offset < begin + share {
            let number = i % frame.mirrors.z;
            let mirror = mirrors[number];
            let factor = f32(ONE) / f32(share);
            var l = mirrored_light(mirror, lights[class_lights + i / frame.mirrors.z]);
            l.emit = vec4<f32>(l.emit.xyz * factor, l.emit.w);
            l.flux = vec4<f32>(l.flux.xyz * factor, l.flux.w);
            mirrored[first_slot + slot] = l;
            mirror_number[first_slot + slot] = number + 1u;
        }
        begin += share;
    }
}
