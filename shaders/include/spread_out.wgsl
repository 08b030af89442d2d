// Index of the workgroup, permuted by a stride. Some devices give each core a contiguous run of workgroups; the stride shares out
// the expensive parts of an image.
fn spread_out(group: u32, groups: u32) -> u32 {
    let stride = select(7919u, 1u, groups % 7919u == 0u || groups > 500000u);
    return (group * stride) % groups;
}
