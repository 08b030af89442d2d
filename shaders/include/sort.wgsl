// Shared by the passes of the sort. Host twin: pass::sort. One invocation handles a run of keys or a stretch of counts, so
// the sort is stable, needs neither workgroup memory nor barriers, and its loops are bounded.
const RUN: u32 = 512u;          // keys for one invocation
const DIGITS: u32 = 256u;       // values of a digit; also counts for one invocation
const TOP: u32 = 1024u;         // maximum length of the topmost level: 2^26 keys

// Number of upper bits of a 24-bit key that hold one of k classes and tell it from slots without a shading point.
fn class_bits(k: u32) -> u32 {
    return select(0u, 32u - countLeadingZeros(k), k > 1u);
}

fn ceil_div(a: u32, b: u32) -> u32 {
    return (a + b - 1u) / b;
}

// Length of a level: 0 the counts of all digits in all runs, 1 and 2 sums over stretches of the level below.
fn level_length(level: u32, total: u32) -> u32 {
    let runs = ceil_div(total, RUN);
    return select(select(ceil_div(runs, DIGITS), runs, level == 1u), runs * DIGITS, level == 0u);
}
