// Clusters of the screen: in each block of pixels, 8 times as wide and high as the interleaving pattern, every class of pixels has
// one cluster of 8 x 8. Needs frame.wgsl. CPU twin: pass::clusters::place_of.

// Index of a pixel's shading point among the places of its component: clusters of 64, class by class, block by block.
fn place_of(at: vec2<u32>) -> u32 {
    let pattern = frame.pattern.xy;
    let across_pattern = divided(at.x, pattern.x);
    let down_pattern = divided(at.y, pattern.y);
    let in_pattern = vec2<u32>(across_pattern.x, down_pattern.x);
    let place = vec2<u32>(across_pattern.y, down_pattern.y);
    let block = in_pattern / 8u;
    let across = (frame.size.x + 8u * pattern.x - 1u) / (8u * pattern.x);
    let cluster = (block.x + across * block.y) * frame.pattern.z + place.x + pattern.x * place.y;
    return 64u * cluster + 8u * (in_pattern.y & 7u) + (in_pattern.x & 7u);
}

// Number of places of one component.
fn place_count() -> u32 {
    let block = 8u * frame.pattern.xy;
    let blocks = (frame.size.xy + block - 1u) / block;
    return 64u * blocks.x * blocks.y * frame.pattern.z;
}
