// Elements shared out among the 64 lanes of one workgroup: each lane takes a stretch of consecutive ones.

struct Stretch {
    first: u32,
    end: u32,       // one past the last
}

fn stretch_of(lane: u32, count: u32) -> Stretch {
    let length = (count + 63u) / 64u;
    let first = min(lane * length, count);
    return Stretch(first, min(first + length, count));
}

var<workgroup> stretch_sums: array<u32, 64>;

// Sum over the lanes before this one, of which `own` is its own value. All lanes call it together, once.
fn sum_before(lane: u32, own: u32) -> u32 {
    stretch_sums[lane] = own;
    workgroupBarrier();
    var sum = 0u;
    for (var k = 0u; k < lane; k += 1u) {
        sum += stretch_sums[k];
    }
    return sum;
}
