// Planar mirrors, and lights that are mirrored by them. Needs bsdf.wgsl and lights.wgsl. Host twin: pass::layout::MirrorRecord.
struct MirrorRecord {
    plane: vec4<f32>,       // unit normal n; w: o with n . p = o on the plane
    middle: vec4<f32>,      // middle of the area; w: area
    ideal: vec4<f32>,       // reflectance at normal incidence without textures; w: greatest distance of a corner from the middle
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

// From a point to a light, not of unit length.
fn way_to(l: PointLight, x: vec3<f32>) -> vec3<f32> {
    let parallel = (bitcast<u32>(l.position.w) & LIGHT_DIRECTIONAL) != 0u;
    return select(l.position.xyz - x, -frame.forward.w * l.normal.xyz, parallel);
}

// Intensity of a light towards a point that sees it in direction wi.
fn intensity_of(l: PointLight, wi: vec3<f32>) -> vec3<f32> {
    let flags = bitcast<u32>(l.position.w);
    let cosine = -dot(wi, l.normal.xyz);
    let spot = clamp(cosine * l.normal.w + l.emit.w, 0.0, 1.0);
    let plain = l.emit.xyz * (select(1.0, max(cosine, 0.0), (flags & LIGHT_SURFACE) != 0u) * spot * spot);
    let lobe = Reflectance(vec3<f32>(0.0), l.flux.w, l.f0.xyz, l.wi.w);
    let shiny = (flags & LIGHT_GLOSSY) != 0u && cosine > 0.0;
    return plain + select(vec3<f32>(0.0), l.flux.xyz * eval_specular(lobe, l.normal.xyz, l.wi.xyz, -wi) * cosine, shiny);
}
