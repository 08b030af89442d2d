// Rays at edges: where a tile keeps them, and where they lie in their pixels. Needs frame.wgsl.

// Offset of a ray in its pixel. With that of the pixel's own ray they fill the pixel evenly (a golden lattice). Host twin: pass::edges::ray_offset.
fn ray_offset(k: u32, each: u32) -> vec2<f32> {
    return fract(frame.pixel_offset.xy + f32(k + 1u) * vec2<f32>(1.0 / f32(each + 1u), 0.618034));
}

// Slot of a ray: a pixel of the part of the tile in the image, see part_of_tile.
fn ray_of_tile(part: vec4<u32>, i: u32) -> u32 {
    let at = divided(i, part.z);
    return part.x + at.y + (part.y + at.x) * frame.size.x;
}
