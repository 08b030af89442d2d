// Where a tile keeps its rays at edges. Needs frame.wgsl.

// Slot of a ray: a pixel of the part of the tile in the image, see part_of_tile.
fn ray_of_tile(part: vec4<u32>, i: u32) -> u32 {
    let at = divided(i, part.z);
    return part.x + at.y + (part.y + at.x) * frame.size.x;
}
