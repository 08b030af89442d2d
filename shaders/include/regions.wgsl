// Regions of the image that choose lights for their clusters: 4 x 4 blocks of clusters, for each class and component. Needs frame.wgsl.

// Host twins: pass::light_regions::{REGION, CHOSEN}.
const REGION: u32 = 4u;
const REGION_LIGHTS: u32 = 256u;

struct Region {
    at: vec2<u32>,          // column and row of regions
    class_number: u32,
    component: u32,
    blocks: vec2<u32>,      // blocks of the image, across and down
}

fn blocks_of_image() -> vec2<u32> {
    let block = 8u * frame.pattern.xy;
    return (frame.size.xy + block - 1u) / block;
}

fn region_at(index: u32) -> Region {
    let blocks = blocks_of_image();
    let regions = (blocks + REGION - 1u) / REGION;
    let number = index / frame.pattern.z;
    let in_component = number % (regions.x * regions.y);
    let at = vec2<u32>(in_component % regions.x, in_component / regions.x);
    return Region(at, index % frame.pattern.z, number / (regions.x * regions.y), blocks);
}

// Number of the cluster of a region's class in a block.
fn cluster_of(region: Region, block: vec2<u32>) -> u32 {
    let of_component = region.blocks.x * region.blocks.y;
    return (region.component * of_component + block.y * region.blocks.x + block.x) * frame.pattern.z + region.class_number;
}

// Index of the region and class of a cluster of this number, among those of all components.
fn region_of_cluster(number: u32) -> u32 {
    let blocks = blocks_of_image();
    let regions = (blocks + REGION - 1u) / REGION;
    let block_number = number / frame.pattern.z;
    let component = block_number / (blocks.x * blocks.y);
    let in_component = block_number % (blocks.x * blocks.y);
    let block = vec2<u32>(in_component % blocks.x, in_component / blocks.x);
    let at = block / REGION;
    return (component * regions.x * regions.y + at.y * regions.x + at.x) * frame.pattern.z + number % frame.pattern.z;
}
