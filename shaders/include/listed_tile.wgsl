// Kernels over a list of tiles, a workgroup for each. Needs frame.wgsl, work.wgsl, and the list bound as `work` and `tiles`.

// Pixel of an invocation; NO_POINT: none.
fn listed_pixel(group: vec3<u32>, groups: vec3<u32>, lane: u32) -> u32 {
    let index = group.x + group.y * groups.x;
    let listed = index < atomicLoad(&work.live);
    let at = pixel_of_tile(tiles[select(0u, index, listed)], lane);
    let inside = listed && at.x < frame.size.x && at.y < frame.size.y;
    return select(NO_POINT, at.x + at.y * frame.size.x, inside);
}
