// One workgroup paints one row: pixel (x, y) becomes (x, y, 0.5, 1).
@group(0) @binding(0) var film: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) x: u32) {
    if x >= textureDimensions(film).x { return; }
    textureStore(film, vec2<u32>(x, group.x), vec4<f32>(f32(x), f32(group.x), 0.5, 1.0));
}
