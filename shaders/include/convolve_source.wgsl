// Sources of the full image. See pass/convolve.rs. Needs convolve.wgsl.

@group(0) @binding(2) var<storage, read> source: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> footprint: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> region: array<u32>;

struct Footprint {
    diameter: f32,          // pixels; 0: the source does not spread
    axis: vec2<f32>,        // unit vector
    steps: u32,             // by which the kernel is narrower along v than the library states
    layer: f32,
}

fn load_footprint(pixel: u32, here: ConvolveStep) -> Footprint {
    let found = footprint[select(pixel, 0u, (here.flags & INVARIANT) != 0u)];
    var result: Footprint;
    // Comparisons with NaN are false.
    let spreads = found.x > 1.0;
    result.diameter = select(0.0, min(found.x, here.widest), spreads);
    let length = sqrt(dot(found.zw, found.zw));
    let directed = length > 0.0 && length < 1e30;
    result.axis = select(vec2<f32>(1.0, 0.0), found.zw / length, directed);
    result.steps = select(0u, steps_of(length), directed);
    result.layer = select(0.0, clamp(found.y, 0.0, f32(here.layers - 1u)), found.y > 0.0);
    return result;
}

// Number of the region: 16 bits.
fn region_of(pixel: u32) -> u32 {
    return region[pixel] & 0xffffu;
}
