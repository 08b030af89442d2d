// The shading point at the end of an eye path. Needs frame.wgsl, point.wgsl, surface.wgsl and write_point.wgsl.

@group(0) @binding(28) var<storage, read_write> throughput: array<vec4<f32>>;

// Whether light reaches the eye by a path of this throughput.
fn carries(weight: vec3<f32>) -> bool {
    return max(max(weight.x, weight.y), weight.z) > 0.0;
}

// Writes the shading point that a path's last ray met, and returns whether it is lit. `only_emits`: paths are too short for light that
// it reflects.
fn end_eye_path(slot: u32, ray: vec4<f32>, hit: vec4<f32>, only_emits: bool) -> bool {
    let through = throughput[slot];
    let before = emitted[slot];
    var met = met_by(ray.xyz, hit);
    // A glossy plane seen directly shows only its base here; the lobe comes with the mirror image.
    let triangle = select(0u, bitcast<u32>(hit.w), met.found);
    let direct = through.w == 0.0 && glossy_plane(triangle_normals[triangle]) > 0u;
    met.without_lobe = direct || has_flag(before.w, LOBE_FOLLOWED);

    let emission = select(vec3<f32>(0.0), through.xyz * met.surface.emission, met.found);
    emitted[slot] = vec4<f32>(before.xyz + emission, 0.0);
    // The depth of a mirror that shows nothing is its own.
    let depth = through.w + select(0.0, ray.w * hit.x, met.found);
    throughput[slot] = vec4<f32>(through.xyz, depth);

    let sends = reflects(met);
    let reaches = carries(through.xyz);
    let lit = met.found && sends && reaches && !only_emits;
    let by_specular = through.w > 0.0;
    let flags = flag_if(LIT, lit) | flag_if(COVERED, met.found || by_specular) | flag_if(SEEN_BY_SPECULAR, by_specular);
    write_point(slot, met, flags);
    return lit;
}
