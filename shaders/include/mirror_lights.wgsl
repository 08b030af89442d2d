// Planar mirrors and the lights that they mirror. Needs math.wgsl and lights.wgsl. Host twin: pass::layout::MirrorRecord.
#include "anisotropic.wgsl"

struct MirrorRecord {
    plane: vec4<f32>,       // unit normal n; w: o with n . p = o on the plane
    middle: vec4<f32>,      // centre of the area; w: area
    ideal: vec4<f32>,       // reflectance at normal incidence without textures; w: maximum distance of a corner from the centre
}

fn height_of(mirror: MirrorRecord, p: vec3<f32>) -> f32 {
    return dot(mirror.plane.xyz, p) - mirror.plane.w;
}

fn mirrored_direction(mirror: MirrorRecord, v: vec3<f32>) -> vec3<f32> {
    return v - 2.0 * dot(mirror.plane.xyz, v) * mirror.plane.xyz;
}

fn mirrored_point(mirror: MirrorRecord, p: vec3<f32>) -> vec3<f32> {
    return p - 2.0 * height_of(mirror, p) * mirror.plane.xyz;
}

// The mirror image of a light. The mirror image of that is the light itself.
fn mirrored_light(mirror: MirrorRecord, l: PointLight) -> PointLight {
    var image = l;
    image.position = vec4<f32>(mirrored_point(mirror, l.position.xyz), l.position.w);
    image.normal = vec4<f32>(mirrored_direction(mirror, l.normal.xyz), l.normal.w);
    image.wi = vec4<f32>(mirrored_direction(mirror, l.wi.xyz), l.wi.w);
    // A loop, because it runs zero times where no lobe has two widths.
    let two = (bitcast<u32>(l.position.w) & LIGHT_GLOSSY) != 0u && is_anisotropic(l.wi.w);
    for (var i = select(0u, 1u, two); i > 0u; i -= 1u) {
        let along = mirrored_direction(mirror, unpack_grain(l.wi.w, l.normal.xyz).along);
        image.wi.w = with_grain(l.wi.w, along, image.normal.xyz);
    }
    return image;
}

// Index of mirrored light `number` of the class of a slot.
fn mirrored_index(slot: u32, number: u32) -> u32 {
    return class_of(slot) * frame.mirrors.x + number;
}
