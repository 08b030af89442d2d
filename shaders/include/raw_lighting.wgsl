// Light that the filter adds to a shading point. Needs radiance.wgsl, and the sums before the filter bound as `raw_direct`,
// `raw_indirect` and `raw_specular`.

fn gained_irradiance(slot: u32) -> vec3<f32> {
    let gain = (direct[slot].xyz - raw_direct[slot].xyz) + (indirect[slot].xyz - raw_indirect[slot].xyz);
    return select(vec3<f32>(0.0), gain, has_flag(point_wo[slot].w, LIT));
}

fn gained_specular(slot: u32) -> vec3<f32> {
    let gain = specular[slot].xyz - raw_specular[slot].xyz;
    return select(vec3<f32>(0.0), gain, has_flag(point_wo[slot].w, LIT));
}
