// Writes one ray for each pixel, through the pass's offset in the pixel. See pass/camera_rays.rs.
#include "frame.wgsl"
#include "camera.wgsl"

@group(0) @binding(1) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> throughput: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> emitted: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let place = place_of_pixel(pixel);
    let at = vec2<f32>(place + frame.within.xy) + frame.pixel_offset.xy;
    let ray = ray_through(at.x, at.y);
    let d = ray.d;
    // A ray of negative length meets nothing.
    ray_origin[pixel] = vec4<f32>(frame.eye.xyz + ray.start, select(-1.0, 3.0e38, in_task(place)));
    let length = sqrt(dot(d, d));
    ray_direction[pixel] = vec4<f32>(d / length, dot(d, frame.forward.xyz) / length);
    throughput[pixel] = vec4<f32>(1.0, 1.0, 1.0, 0.0);
    emitted[pixel] = vec4<f32>(0.0);
}
