// The values that a pass adds to the sums of a pixel. The including shader includes frame.wgsl, math.wgsl and radiance.wgsl, and binds the
// buffers of shading points, lighting and eye paths under the names used here.
struct Addends {
    color: vec4<f32>,     // radiance; w: coverage
    direct: vec4<f32>,    // irradiance; w: depth along the view direction times coverage
    indirect: vec3<f32>,  // irradiance
    albedo: vec3<f32>,
    normal: vec3<f32>,
}

fn addends_of(pixel: u32) -> Addends {
    let through = throughput[pixel];
    let flags = point_wo[pixel].w;
    let hit = select(0.0, 1.0, has_flag(flags, COVERED));
    let ends = select(0.0, 1.0, has_flag(flags, HIT));
    let light = lighting_of(pixel);
    let kd = point_kd[pixel].xyz;
    let seen = emitted[pixel];
    return Addends(
        vec4<f32>(seen.xyz + through.xyz * reflected_radiance(kd, light), hit + seen.w),
        vec4<f32>(light.e_direct, hit * through.w),
        light.e_indirect,
        through.xyz * (kd + point_f0[pixel].xyz),
        ends * point_shading[pixel].xyz,
    );
}
