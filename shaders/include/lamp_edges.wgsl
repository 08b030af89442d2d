// Words of the rays at edges of lamps. Needs frame.wgsl and edge_rays.wgsl.

// Of a pixel: 64 * its first ray in its tile + 4 * the rays of each slot that they seek + bits of the components at edges. The rays seek
// slot 0 where the first component is at an edge, and slot 1 and all further ones where the second one is. Number of these slots:
fn sought_slots(bits: u32, slots: u32) -> u32 {
    return (bits & 1u) + (bits >> 1u & 1u) * (slots - 1u);
}

// Place of ray r of a tile among the rays of the eye: the tile's own places, slot by slot.
fn lamp_ray(part: vec4<u32>, r: u32) -> u32 {
    let at = divided(r, part.z * part.w);
    return ray_of_tile(part, at.y) + at.x * frame.size.z;
}

// Of a ray: the slot that it seeks, the slot that it is in, the one that the next component takes which splits off (0: none does), and
// whether it has met more than flat mirrors.
struct LampWay {
    seeks: u32,
    slot: u32,
    free: u32,
    bends: bool,
}

fn packed_way(way: LampWay) -> u32 {
    return way.seeks | way.slot << 2u | way.free << 4u | select(0u, 64u, way.bends);
}

fn way_of(word: u32) -> LampWay {
    return LampWay(word & 3u, word >> 2u & 3u, word >> 4u & 3u, (word & 64u) != 0u);
}
