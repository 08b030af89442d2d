// Copies the sums of a few pixels of an instance, for the host. See pass/probe.rs.

@group(0) @binding(0) var<storage, read> probed: array<u32>;
@group(0) @binding(1) var<storage, read> sum_color: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> rest_color: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> tail_color: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> probe: array<vec4<f32>>;  // two for each pixel

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let i = (group.x + group.y * groups.x) * 64u + lane;
    if i >= arrayLength(&probed) {
        return;
    }
    let pixel = probed[i];
    probe[2u * i] = sum_color[pixel];
    probe[2u * i + 1u] = rest_color[pixel] + tail_color[pixel];
}
