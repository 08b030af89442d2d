// Work lists. Host twins: pass::layout::{DispatchCounts, Step, PointStep}.

// Counts found by the device.
struct DispatchCounts {
    live: atomic<u32>,          // shading points in the list
    unfinished: atomic<u32>,    // rays of the present round that ran out of steps
    total: u32,                 // places of a list that is sorted or in screen order, with places without a shading point
    culled: atomic<u32>,        // pairs of a cluster and a light dropped before any ray was traced
    list_groups: vec4<u32>,     // indirect dispatch: one invocation for each shading point in the list; w: additional groups
    round_groups: vec4<u32>,    // indirect dispatch: the next round; 0 if no ray needs it
    total_groups: vec4<u32>,    // indirect dispatch: one invocation for each slot
    once_if_live: vec4<u32>,    // indirect dispatch: one group if the list has shading points
    once_if_unfinished: vec4<u32>,  // indirect dispatch: one group if a next round is needed
}

// A place of a list that holds no shading point.
const NO_POINT: u32 = 0xffffffffu;

// Parameters of one dispatch, fixed when the frame is made; each pass reads the members that it needs. They are in a buffer, because
// push constants are compiled into the code by some drivers: there each new value would compile the kernel again.
struct Step {
    first: u32,                 // first light, photon or mirrored light of the dispatch
    end: u32,                   // one past the last; for batches without a list the number of rays
    round: u32,                 // 0 starts rays, later rounds continue them
    steps: u32,                 // traversal steps of one ray in this round
    lights: u32,                // maximum number of lights that a single ray takes in this round
    last: u32,                  // 1: the last round (rays left over are lost), the last bounce or the last digit
    indirect: u32,              // 1: the shading points come from the list; 2: from one in screen order
    bounce: u32,                // reflections of a particle, this one included; mirrors and glass of a path, or gather rays, before this one
    clears: u32,                // 1: sums start at zero
    bounces: u32,               // maximum number of bounces of a light: those with more would make paths too long
    closer: u32,                // 1: lights are clipped at half the clip distance
    components: u32,            // slots of each pixel for the components of its eye path; 1: paths do not split
    mirrored_lights: u32,       // 1: planar mirrors reflect virtual lights, so photons leave them out
    shift: u32,                 // of the digit by which the sort counts or scatters
    level: u32,                 // of the sort's sums
}

// How shading points are made of hits.
struct PointStep {
    order: u32,                 // that of the list, ORDER_...
    last: u32,                  // 1: shading points only emit, because the paths to them are as long as allowed
    components: u32,            // slots of each pixel
}

const ORDER_ANY: u32 = 0u;      // shading points are appended as they come
const ORDER_TO_SORT: u32 = 1u;  // a fixed order with gaps, to be sorted: tiles of 8 x 8 for the eye, rays for gathered points
const ORDER_SCREEN: u32 = 2u;   // that of the screen, with gaps, see clusters.wgsl

struct Push {
    step: u32,                  // index into steps
}

// Linear index of the workgroup, permuted: neighbouring groups cost alike, and some drivers give each thread a contiguous run of
// groups.
fn spread_group(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return spread_index(group.x + group.y * groups.x, groups.x * groups.y);
}

fn spread_index(linear: u32, count: u32) -> u32 {
    let stride = select(7919u, 1u, count % 7919u == 0u || count > 500000u);
    return (linear * stride) % count;
}

// The same for groups whose neighbours read the same lines of memory: runs of 64 groups stay together, and so do the remaining ones.
fn spread_runs(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    let linear = group.x + group.y * groups.x;
    let runs = groups.x * groups.y / 64u;
    let run = linear / 64u;
    return 64u * select(run, spread_index(run, max(runs, 1u)), run < runs) + linear % 64u;
}
