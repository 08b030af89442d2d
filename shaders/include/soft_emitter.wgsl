// The emitter whose shadow is convolved. Needs soft_shadows.wgsl and, bound as `soft_emitter`, its record, six vectors: centre with ray-origin
// offset, area; first edge, exponent of the cosine; second edge; normal; corner; radiance. It has a buffer of its own, because processors
// load from places that are known at compilation once for all lanes.

fn soft_light() -> SoftLight {
    return SoftLight(soft_emitter[0].xyz, soft_emitter[1].xyz, soft_emitter[2].xyz, soft_emitter[3].xyz);
}
