// Numbers of the particles of splats, the same for all passes. Needs frame.wgsl and math.wgsl. CPU twin: pass::splat_start::numbers.
#include "sobol.wgsl"

// Two coordinates of a particle: for its start (j = 0), for the direction that leaves the emitter (1) or its hit j - 2.
fn splat_numbers(j: u32, particle: u32) -> vec2<f32> {
    let words = sobol(j, particle);
    return unit(vec2<u32>(
        scrambled(words.x, key(frame.keys.y, STREAM_SPLAT, 2u * j, 0u)),
        scrambled(words.y, key(frame.keys.y, STREAM_SPLAT, 2u * j + 1u, 0u)),
    ));
}
