// Hits become receivers: surface, material and textures looked up, emission taken. See pass/receivers.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "receiver.wgsl"
#include "surface.wgsl"

@group(0) @binding(12) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read> list_in: array<u32>;
@group(0) @binding(16) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(17) var<storage, read_write> work_in: Work;
@group(0) @binding(18) var<storage, read_write> work_out: Work;
@group(0) @binding(19) var<storage, read> steps: array<Step>;
@group(0) @binding(20) var<storage, read_write> beta: array<vec4<f32>>;
@group(0) @binding(21) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(22) var<storage, read_write> receiver_position: array<vec4<f32>>;
@group(0) @binding(23) var<storage, read_write> receiver_geometric: array<vec4<f32>>;
@group(0) @binding(24) var<storage, read_write> receiver_shading: array<vec4<f32>>;
@group(0) @binding(25) var<storage, read_write> receiver_kd: array<vec4<f32>>;
@group(0) @binding(26) var<storage, read_write> receiver_f0: array<vec4<f32>>;
@group(0) @binding(27) var<storage, read_write> receiver_wo: array<vec4<f32>>;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let step = steps[push.step];
    let eye = step.bounce == 0u;
    // The eye's pixels are taken in tiles of 8 x 8, so that neighbours on the list are neighbours in the scene.
    let tile = group.x + group.y * groups.x;
    let tiles = (frame.size.xy + 7u) / 8u;
    let at = vec2<u32>(8u * (tile % tiles.x) + (lane & 7u), 8u * (tile / tiles.x) + lane / 8u);
    let slot = tile * 64u + lane;
    let total = select(atomicLoad(&work_in.live), tiles.x * tiles.y * 64u, eye);
    if slot >= total {
        return;
    }
    let ordered = step.fresh == 1u;
    if ordered && slot == 0u {
        work_out.total = total;
    }
    if eye && (at.x >= frame.size.x || at.y >= frame.size.y) {
        if ordered {
            list_out[slot] = NO_RECEIVER;
        }
        return;
    }
    // Slots of the eye may lie beyond the other list, and both sides of a select are evaluated.
    let pixel = select(list_in[select(slot, 0u, eye)], at.x + at.y * frame.size.x, eye);
    let hit = hits[pixel];
    let triangle = bitcast<u32>(hit.w);
    let d = ray_direction[pixel].xyz;
    let found = triangle != 0xffffffffu;
    let s = surface_at(select(0u, triangle, found), hit.y, hit.z, d);

    // What the eye sees has weight 1; a gathered point has the part that clipping cut off.
    let share = select(max(1.0 - hit.x * hit.x / max(frame.right.w, 1e-37), 0.0), 1.0, eye);
    let before = select(beta[pixel], vec4<f32>(1.0, 1.0, 1.0, 0.0), eye);
    let weight = select(0.0, share, found);
    emitted[pixel] = vec4<f32>(before.xyz * s.emission * weight, before.w);

    let reflects = mean3(s.reflectance.kd) + mean3(s.reflectance.f0) > 0.0;
    // The last gathered points only emit: light that they reflect would exceed the greatest path length.
    let lit = weight > 0.0 && reflects && step.last == 0u;
    let glossy = s.reflectance.f90 > 0.0;
    let depth = select(-1.0, hit.x, found);
    receiver_position[pixel] = vec4<f32>(offset_origin(s.position, s.geometric, frame.eye.w), depth);
    receiver_geometric[pixel] = vec4<f32>(s.geometric, s.reflectance.f90);
    receiver_shading[pixel] = vec4<f32>(s.shading, s.reflectance.alpha);
    receiver_kd[pixel] = vec4<f32>(select(vec3<f32>(0.0), s.reflectance.kd, found), diffuse_probability(s.reflectance));
    receiver_f0[pixel] = vec4<f32>(select(vec3<f32>(0.0), s.reflectance.f0, found), select(0.0, 1.0, glossy));
    receiver_wo[pixel] = vec4<f32>(-d, select(0.0, 1.0, lit));
    beta[pixel] = vec4<f32>(before.xyz * weight, before.w);
    // The count does not depend on the order of the invocations; a list that is appended to does.
    var place = slot;
    if lit {
        let appended = atomicAdd(&work_out.live, 1u);
        place = select(appended, slot, ordered);
    }
    if lit || ordered {
        list_out[place] = select(NO_RECEIVER, pixel, lit);
    }
}
