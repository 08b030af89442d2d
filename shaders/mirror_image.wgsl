// Writes the mirror image on glossy planes and the scene behind frosted panes, and the kernel that spreads each of their pixels.
// See pass/mirror_image.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "listed_tile.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "reflectors.wgsl"

@group(0) @binding(2) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> throughput: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(11) var<storage, read> tiles: array<u32>;
@group(0) @binding(12) var<storage, read> region: array<u32>;
@group(0) @binding(18) var<storage, read_write> core_footprint: array<vec4<f32>>; // the same for the peak of the kernel
@group(0) @binding(17) var<storage, read> widening: array<vec4<f32>>;
@group(0) @binding(19) var<storage, read> panes: array<vec4<f32>>;      // two for each pixel of a frosted pane
@group(0) @binding(15) var<storage, read_write> source: array<vec4<f32>>;     // radiance; w: depth of the point seen
@group(0) @binding(16) var<storage, read_write> footprint: array<vec4<f32>>;  // of the tail: diameter, texture, direction of the u axis

@group(0) @binding(20) var<storage, read> reprojected: array<vec4<f32>>; // radiance and depth by images with depth; depth 0: by a ray

// Radius of the core over that of the whole kernel.
const CORE_RADIUS: f32 = 0.3;
// Depth of pixels that see nothing, beyond every surface.
const NOTHING_SEEN: f32 = 3.0e38;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = listed_pixel(group, groups, lane);
    if pixel == NO_POINT {
        return;
    }
    let plane = region[pixel];
    if plane == 0u {
        return;
    }
    // The mirror image of a glossy plane is a second component, the scene behind a frosted pane a first one.
    let tables = reflectors[plane - 1u];
    let is_pane = tables.z != 0u;
    let slot = select(pixel + frame.size.z, pixel, is_pane);
    let through = throughput[slot];
    let l = emitted[slot].xyz + through.xyz * reflected_radiance(point_kd[slot].xyz, lighting_of(slot));
    // The pixel shows this component only after it has been spread.
    emitted[slot] = vec4<f32>(0.0);
    throughput[slot] = vec4<f32>(0.0, 0.0, 0.0, through.w);

    // Images with depth bring the light of pixels that no ray was traced for.
    let image = reprojected[select(0u, pixel, frame.superposition.z != 0u)];
    let sampled = frame.superposition.z != 0u && !is_pane && image.w > 0.0;
    let found = sampled || has_flag(point_wo[slot].w, HIT);
    let wo = point_wo[pixel].xyz;
    let normal = point_geometric[pixel].xyz;
    let at_pane = 2u * select(0u, pixel, is_pane);
    let mu = select(dot(normal, wo), panes[at_pane].w, is_pane);
    let tail = tail_of(tables.x, mu);
    let tan_beta = lobe_at(tables.x, mu).x;
    // Size of the disc at the reflected point, as the eye sees it: tan(beta) z_r / (t + z_r) for each plane on the path. For points
    // far away only the angles count. A pane seen directly counts among the other planes.
    let more = widening[pixel];
    let end = select(NOTHING_SEEN, select(through.w, image.w, sampled), found);
    let own = select(tan_beta * (1.0 - throughput[pixel].w / end), 0.0, is_pane);
    let others = more.x + (more.z / end - 2.0 * more.y) / end;
    let half = sqrt(own * own + max(others, 0.0));

    // Behind the plane the virtual image goes on in the direction of the ray. The kernel's u axis, which points from the mirror
    // direction to the normal, is mirrored as well.
    let disc = select(image_of_disc(-wo, mu * wo - normal), panes[at_pane + 1u].xyz, is_pane);
    let diameter = 4.0 * half * disc.z;
    source[pixel] = vec4<f32>(select(l, image.xyz, sampled), end);
    footprint[pixel] = vec4<f32>(diameter, f32(tail), disc.xy);
    core_footprint[pixel] = vec4<f32>(CORE_RADIUS * diameter, f32(tail + VIEW_ANGLES), disc.xy);
}
