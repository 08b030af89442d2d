// Light from all around. Needs math.wgsl. Host twin and CPU twin: scene::environment.

// Three axes, w of the first two: bits of width and height; then of each texel, rows from the zenith, its radiance and the density of
// a light in its direction.
@group(0) @binding(40) var<storage, read> environment: array<vec4<f32>>;

fn environment_size() -> vec2<u32> {
    return vec2<u32>(bitcast<u32>(environment[0].w), bitcast<u32>(environment[1].w));
}

// Column and row of a direction, in texels from the upper left corner.
fn environment_place(direction: vec3<f32>) -> vec2<f32> {
    let x = dot(direction, environment[0].xyz);
    let y = clamp(dot(direction, environment[1].xyz), -1.0, 1.0);
    let z = dot(direction, environment[2].xyz);
    return vec2<f32>(0.5 + atan2(x, -z) * (0.5 * INV_PI), acos(y) * INV_PI) * vec2<f32>(environment_size());
}

fn environment_texel(column: u32, row: u32) -> vec4<f32> {
    let size = environment_size();
    return environment[3u + min(row, size.y - 1u) * size.x + min(column, size.x - 1u)];
}

// Radiance that lights surfaces from a direction: that of its texel; w: density over solid angle of a light from there.
fn environment_radiance(direction: vec3<f32>) -> vec4<f32> {
    let at = vec2<u32>(environment_place(direction));
    return environment_texel(at.x, at.y);
}

// Radiance seen in a direction, interpolated between texels.
fn environment_seen(direction: vec3<f32>) -> vec3<f32> {
    let width = environment_size().x;
    let at = environment_place(direction) - 0.5;
    let corner = floor(at);
    let between = at - corner;
    // The left neighbour of the first column is the last one.
    let left = u32(i32(corner.x) + i32(width)) % width;
    let right = (left + 1u) % width;
    let top = u32(max(corner.y, 0.0));
    let bottom = u32(max(corner.y + 1.0, 0.0));
    let upper = mix(environment_texel(left, top), environment_texel(right, top), between.x);
    let lower = mix(environment_texel(left, bottom), environment_texel(right, bottom), between.x);
    return mix(upper, lower, between.y).xyz;
}

// Direction towards the environment from an azimuth, in radians from the left edge, and the cosine of the angle from the zenith.
fn environment_direction(azimuth: f32, cosine: f32) -> vec3<f32> {
    let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    let around = azimuth - PI;
    return environment[0].xyz * (sine * sin(around)) + environment[1].xyz * cosine - environment[2].xyz * (sine * cos(around));
}
