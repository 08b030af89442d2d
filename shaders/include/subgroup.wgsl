// Reductions over a subgroup. LANES4, LANES16, LANES32, LANES64: its size, else 8.

// Lanes of the subgroup.
#if LANES4
const LANES: u32 = 4u;
#else
#if LANES16
const LANES: u32 = 16u;
#else
#if LANES32
const LANES: u32 = 32u;
#else
#if LANES64
const LANES: u32 = 64u;
#else
const LANES: u32 = 8u;
#endif
#endif
#endif
#endif

// Shuffles between fixed lanes: on a driver that runs the lanes as one vector each shuffle is a single instruction.
fn or_reduce(x: u32) -> u32 {
    var y = x;
    y |= subgroupShuffleXor(y, 1u);
    y |= subgroupShuffleXor(y, 2u);
    if LANES > 4u {
        y |= subgroupShuffleXor(y, 4u);
    }
    if LANES > 8u {
        y |= subgroupShuffleXor(y, 8u);
    }
    if LANES > 16u {
        y |= subgroupShuffleXor(y, 16u);
    }
    if LANES > 32u {
        y |= subgroupShuffleXor(y, 32u);
    }
    return y;
}

fn min_reduce(x: vec3<f32>) -> vec3<f32> {
    var y = x;
    y = min(y, subgroupShuffleXor(y, 1u));
    y = min(y, subgroupShuffleXor(y, 2u));
    if LANES > 4u {
        y = min(y, subgroupShuffleXor(y, 4u));
    }
    if LANES > 8u {
        y = min(y, subgroupShuffleXor(y, 8u));
    }
    if LANES > 16u {
        y = min(y, subgroupShuffleXor(y, 16u));
    }
    if LANES > 32u {
        y = min(y, subgroupShuffleXor(y, 32u));
    }
    return y;
}

fn max_reduce(x: vec3<f32>) -> vec3<f32> {
    return -min_reduce(-x);
}

// The minimum if the lanes from eight on repeat the first eight.
fn min_of_eight(x: u32) -> u32 {
    var y = x;
    y = min(y, subgroupShuffleXor(y, 1u));
    y = min(y, subgroupShuffleXor(y, 2u));
    if LANES > 4u {
        y = min(y, subgroupShuffleXor(y, 4u));
    }
    return y;
}

fn min_reduce_u32(x: u32) -> u32 {
    var y = min_of_eight(x);
    if LANES > 8u {
        y = min(y, subgroupShuffleXor(y, 8u));
    }
    if LANES > 16u {
        y = min(y, subgroupShuffleXor(y, 16u));
    }
    if LANES > 32u {
        y = min(y, subgroupShuffleXor(y, 32u));
    }
    return y;
}
