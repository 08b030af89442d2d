// Work lists. Host twins: pass::layout::{Work, Step, PointStep}.

// Counts found by the device.
struct Work {
    live: atomic<u32>,          // receivers in the list
    unfinished: atomic<u32>,    // rays of the present round that ran out of steps
    total: u32,                 // slots of a list that is sorted or in the order of the screen, with slots without a receiver
    culled: atomic<u32>,        // pairs of a cluster and a light dropped before any ray was traced
    list_groups: vec4<u32>,     // indirect dispatch: one invocation for each receiver in the list; w: additional groups
    round_groups: vec4<u32>,    // indirect dispatch: the next round; 0 if no ray needs it
    total_groups: vec4<u32>,    // indirect dispatch: one invocation for each slot
}

// A slot of a list that holds no receiver.
const NO_RECEIVER: u32 = 0xffffffffu;

// Parameters of one dispatch, fixed when the frame is made.
struct Step {
    first: u32,                 // first light of the chunk; for the eye's path the first slot of second components, 0: none
    end: u32,                   // one past the last
    round: u32,                 // 0 starts rays, later rounds carry them on
    bounce: u32,                // 0: what the eye sees; mirrors and glass so far; the most lights that a single ray takes
    steps: u32,                 // traversal steps of one ray in this round
    last: u32,                  // 1: the last round (rays left over are lost), or the last bounce
    indirect: u32,              // 1: the receivers come from the list; 2: from one in the order of the screen
    fresh: u32,                 // 1: sums start at zero; for photons, 1: there are mirrored lights
}

// How receivers are made of hits.
struct PointStep {
    order: u32,                 // that of the list, ORDER_...
    last: u32,                  // 1: receivers only emit, because the paths to them are as long as allowed
}

const ORDER_ANY: u32 = 0u;      // receivers are appended as they come
const ORDER_RAYS: u32 = 1u;     // that of the rays, with gaps, to be sorted
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
