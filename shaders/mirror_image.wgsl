// Writes the mirror image on glossy surfaces and the scene behind frosted panes, and the kernel that spreads each of their pixels.
// See pass/mirror_image.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "listed_tile.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "reflectors.wgsl"

@group(0) @binding(1) var<storage, read> point_shading: array<vec4<f32>>;
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
@group(0) @binding(19) var<storage, read> extras: array<vec4<f32>>;     // two for each pixel of a frosted pane or a curved surface
@group(0) @binding(15) var<storage, read_write> source: array<vec4<f32>>;     // radiance; w: depth of the point seen
@group(0) @binding(16) var<storage, read_write> footprint: array<vec4<f32>>;  // of the tail: diameter, texture, direction of the u axis

@group(0) @binding(20) var<storage, read> reprojected: array<vec4<f32>>; // radiance and depth by images with depth; depth 0: by a ray

// Radius of the core over that of the whole kernel.
const CORE_RADIUS: f32 = 0.3;
// Depth of pixels that see nothing, beyond every surface.
const NOTHING_SEEN: f32 = 3.0e38;
// Least width in pixels to which a curved surface narrows a kernel, and most steps of 2^(1/4) by which it is narrower than long.
const THINNEST: f32 = 1.5;
const MAX_STEPS: f32 = 15.0;

// Footprint of a part of a kernel on a curved surface. `disc`: direction of the u axis; `diameter`: that on a plane, along u; `spread`:
// map of displacements on a plane to those here, along u, mixed, and across; `aspect`: width of the part across over that along u on a
// plane; `texture`: that of a plane; `own`: the first of the part's textures for curved surfaces, 0: there are none; `angle`: of view.
fn curved_footprint(disc: vec2<f32>, diameter: f32, spread: vec3<f32>, aspect: f32, texture: u32, own: u32, angle: u32) -> vec4<f32> {
    // The ellipse onto which the part's own is mapped.
    let along = spread.xy;
    let across = aspect * spread.yz;
    let uu = along.x * along.x + across.x * across.x;
    let uv = along.x * along.y + across.x * across.y;
    let vv = along.y * along.y + across.y * across.y;
    let half = 0.5 * (uu - vv);
    let apart = sqrt(half * half + uv * uv);
    let area = diameter * diameter * aspect * abs(spread.x * spread.z - spread.y * spread.y);
    let major = diameter * sqrt(0.5 * (uu + vv) + apart);
    let minor = max(area / max(major, 1e-30), min(aspect * major, THINNEST));
    let steps = min(floor(4.0 * log2(max(major, 1e-30) / max(minor, 1e-30)) + 0.5), MAX_STEPS);
    let round = steps <= 0.0 || major <= 1.0;

    // The texture follows the plane of incidence; if the long axis lies across it, the texture with its axes exchanged is taken.
    let direction = select(vec2<f32>(uv, apart - half), vec2<f32>(apart + half, uv), half >= 0.0);
    let length2 = dot(direction, direction);
    let found = select(vec2<f32>(1.0, 0.0), direction / sqrt(max(length2, 1e-37)), length2 > 1e-30 && !round);
    let exchanged = abs(found.y) > abs(found.x);
    let forward = select(found.x, -found.y, exchanged);
    let axis = select(-found, found, forward >= 0.0);
    let in_image = axis.x * disc + axis.y * vec2<f32>(-disc.y, disc.x);
    let mean = sqrt(major * minor);
    let stretch = select(steps, 0.0, round);
    // The exchanged textures follow in the opposite order: a mean of neighbours of both kinds is a round one.
    let layer = own + select(angle, 2u * VIEW_ANGLES - 1u - angle, exchanged);
    let ellipse = vec4<f32>(mean * exp2(0.125 * stretch), f32(layer), in_image * exp2(0.25 * stretch));
    return select(ellipse, vec4<f32>(mean / sqrt(aspect), f32(texture), disc), own == 0u);
}

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
    let is_pane = tables.z == FROSTED_PANE;
    let is_bent = tables.z == CURVED_SURFACE;
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
    let has_extras = is_pane || is_bent;
    let extra = extras[2u * select(0u, pixel, has_extras)];
    let seen_as = extras[2u * select(0u, pixel, has_extras) + 1u];
    let mu = select(dot(normal, wo), extra.w, has_extras);
    let shading = point_shading[pixel];
    let first = first_layer(tables, shading.w, shading.xyz, wo);
    let tail = tail_of(first, mu);
    let tan_beta = lobe_at(first, mu).x;
    // Size of the disc at the reflected point, as the eye sees it: tan(beta) z_r / (t + z_r) for each plane on the path. For points
    // far away only the angles count. A pane seen directly counts among the other planes.
    let more = widening[pixel];
    let end = select(NOTHING_SEEN, select(through.w, image.w, sampled), found);
    let at_surface = throughput[pixel].w;
    let nearness = 1.0 - at_surface / end;
    let own = select(tan_beta * nearness, 0.0, is_pane);
    let others = more.x + (more.z / end - 2.0 * more.y) / end;
    let half = sqrt(own * own + max(others, 0.0));

    // Behind the plane the virtual image goes on in the direction of the ray. The kernel's u axis, which points from the mirror
    // direction to the normal, is mirrored as well.
    let disc = select(image_of_disc(-wo, mu * wo - normal), seen_as.xyz, has_extras);
    let diameter = 4.0 * half * disc.z;

    // At a curved surface the power moves the virtual image of the point, and narrows the kernel along each axis.
    let distance = select(1.0, seen_as.w, is_bent);
    let cos_view = at_surface / distance;
    let reciprocal = cos_view / max(end - at_surface, 1e-30) + 0.5 * (extra.x + extra.z);
    let virtual_end = min(at_surface + cos_view / max(reciprocal, 1e-37), NOTHING_SEEN);
    let times = nearness * distance;
    let m = vec3<f32>(1.0, 0.0, 1.0) + times * extra.xyz;
    let spread = vec3<f32>(m.z, -m.y, m.x) / max(m.x * m.z - m.y * m.y, 1e-6);
    let bent = select(0u, tables.w, is_bent);
    let angle = u32(view_place(mu) + 0.5);
    let aspects = lobes[select(tables.x, (bent >> 12u) + angle, bent != 0u)].xy;
    let own_tail = bent & 0xfffu;
    let own_core = select(0u, own_tail + 2u * VIEW_ANGLES, bent != 0u);
    let bent_tail = curved_footprint(disc.xy, diameter, spread, select(1.0, aspects.x, bent != 0u), tail, own_tail, angle);
    let core_diameter = CORE_RADIUS * diameter;
    let bent_core = curved_footprint(disc.xy, core_diameter, spread, select(1.0, aspects.y, bent != 0u), tail + VIEW_ANGLES, own_core, angle);

    source[pixel] = vec4<f32>(select(l, image.xyz, sampled), select(end, virtual_end, is_bent));
    footprint[pixel] = select(vec4<f32>(diameter, f32(tail), disc.xy), bent_tail, is_bent);
    let flat_core = vec4<f32>(core_diameter, f32(tail + VIEW_ANGLES), disc.xy);
    core_footprint[pixel] = select(flat_core, bent_core, is_bent);
}
