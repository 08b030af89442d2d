// Emitters. Needs math.wgsl. Host twin and CPU twin: light::emitters.

struct EmitterRecord {
    p0: vec4<f32>,          // first corner, centre or position; w: bits of the kind
    e1: vec4<f32>,          // first edge (sphere: x radius; spot: x, y cosines of inner and outer angle; environment: azimuth, its range,
                            // cosine from the zenith); w: area, of the environment solid angle
    e2: vec4<f32>,          // second edge (environment: range of the cosine, radius of the scene); w: bits: 1 two-sided, 2 inward
    normal: vec4<f32>,      // normal or axis; w: probability
    radiance: vec4<f32>,    // radiance along the normal (with a texture its mean), intensity or irradiance; w: upper end of its interval in the distribution
    flux: vec4<f32>,        // flux of a particle: power / probability; with a texture where that is white; w: exponent of the cosine
    uv: vec4<f32>,          // texture coordinates of the first corner; their change along the first edge
    pattern: vec4<f32>,     // their change along the second edge; z: bits of the texture + 1 over those of 1.0, or 0;
                            // w: exitance over that of Lambert's law
}

const EMITTER_TRIANGLE: u32 = 0u;
const EMITTER_QUAD: u32 = 1u;
const EMITTER_SPHERE: u32 = 2u;
const EMITTER_POINT: u32 = 3u;
const EMITTER_SPOT: u32 = 4u;
const EMITTER_DIRECTIONAL: u32 = 5u;
const EMITTER_VIRTUAL: u32 = 6u;
const EMITTER_ENVIRONMENT: u32 = 7u;

// Whether light from it is parallel.
fn is_parallel(kind: u32) -> bool {
    return kind == EMITTER_DIRECTIONAL || kind == EMITTER_ENVIRONMENT;
}

fn uniform_sphere(u: f32, v: f32) -> vec3<f32> {
    let z = 1.0 - 2.0 * u;
    let r = sqrt(max(1.0 - z * z, 0.0));
    return vec3<f32>(r * unit_circle(v), z);
}
