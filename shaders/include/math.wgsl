// Sampling and geometry shared by the passes. CPU twins: sampling::{halton, random, sobol::unit}, bsdf::basis, accel::offset_origin.

const PI: f32 = 3.14159265358979;
const INV_PI: f32 = 0.318309886183791;

fn mean3(c: vec3<f32>) -> f32 {
    return (c.x + c.y + c.z) * (1.0 / 3.0);
}

// PCG's output function (Jarzynski and Olano 2020).
fn hash(x: u32) -> u32 {
    let state = x * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// One key of four numbers: seed, consumer, and two indices of the consumer's own.
fn key(seed: u32, stream: u32, a: u32, b: u32) -> u32 {
    return hash(hash(seed ^ (stream * 0x9e3779b9u)) ^ a) + b * 0x85ebca6bu;
}

// Uniform in [0, 1), a multiple of 2^-24.
fn random(k: u32) -> f32 {
    return f32(hash(k) >> 8u) * (1.0 / 16777216.0);
}

// Streams of sampling::dimensions.
const STREAM_SIDE: u32 = 1u;
const STREAM_LOBE: u32 = 2u;
const STREAM_JITTER: u32 = 3u;
const STREAM_GATHER: u32 = 5u;
const STREAM_GATHER_LOBE: u32 = 7u;
const STREAM_COMPONENT: u32 = 10u;
const STREAM_DELTA: u32 = 12u;
const STREAM_MIRROR: u32 = 13u;
const STREAM_WALK_COMPONENT: u32 = 14u;
const STREAM_EYE_LOBE: u32 = 15u;
const STREAM_FIRST_LIGHT: u32 = 16u;
const STREAM_LISTS: u32 = 17u;
const STREAM_NEAR: u32 = 18u;
const STREAM_ALPHA: u32 = 19u;
const STREAM_PHOTON: u32 = 20u;
const STREAM_PHOTON_SIDE: u32 = 21u;
const STREAM_PHOTON_COMPONENT: u32 = 22u;
const STREAM_ROULETTE: u32 = 23u;
const STREAM_GATHER_ROULETTE: u32 = 24u;
const STREAM_SPLAT: u32 = 25u;
const STREAM_SPLAT_SIDE: u32 = 26u;
const STREAM_SPLAT_LOBE: u32 = 27u;
const STREAM_SPLAT_COMPONENT: u32 = 28u;
const STREAM_SPLAT_ROULETTE: u32 = 29u;
const STREAM_BLUR: u32 = 30u;
const STREAM_AIM: u32 = 31u;

const ONE_MINUS_EPSILON: f32 = 0.99999994;

// The digits of i in `base`, mirrored at the radix point; the reversed digits are one integer, which is divided once.
fn radical_inverse(base: u32, i: u32) -> f32 {
    if base == 2u {
        return f32(reverseBits(i) >> 8u) * (1.0 / 16777216.0);
    }
    let limit = 0xffffffffu / base;
    var rest = i;
    var reversed = 0u;
    var power = 1u;
    while rest > 0u && power <= limit {
        let quotient = rest / base;
        reversed = reversed * base + (rest - quotient * base);
        power *= base;
        rest = quotient;
    }
    return min(f32(reversed) / f32(power), ONE_MINUS_EPSILON);
}

// A word as a number in [0, 1): its upper 24 bits, exactly.
fn unit(words: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(words >> vec2<u32>(8u)) * (1.0 / 16777216.0);
}

// Cranley-Patterson rotation.
fn rotate(x: f32, shift: f32) -> f32 {
    let sum = x + shift;
    return select(sum, sum - 1.0, sum >= 1.0);
}

// The point of the unit circle at 2 pi v, v in [0, 1). Vulkan promises sine and cosine to 2^-11 between -pi and pi alone, so
// the angle is taken there, and the length is restored.
fn unit_circle(v: f32) -> vec2<f32> {
    let phi = 2.0 * PI * (v - select(0.0, 1.0, v > 0.5));
    let p = vec2<f32>(cos(phi), sin(phi));
    return p / sqrt(dot(p, p));
}

// Tangent and bitangent of a unit vector (Duff et al. 2017).
fn basis(n: vec3<f32>) -> array<vec3<f32>, 2> {
    let s = select(1.0, -1.0, n.z < 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return array<vec3<f32>, 2>(vec3<f32>(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3<f32>(b, s + n.y * n.y * a, -n.y));
}

// Moves a point off a surface to the side of n (Waechter and Binder 2019); the constants for small coordinates scale with the largest
// coordinate, of the point or `at_least`.
fn offset_origin(p: vec3<f32>, n: vec3<f32>, at_least: f32) -> vec3<f32> {
    let scale = max(at_least, max(abs(p.x), max(abs(p.y), abs(p.z))));
    let ulps = vec3<i32>(256.0 * n);
    let bits = bitcast<vec3<i32>>(p) + select(ulps, -ulps, p < vec3<f32>(0.0));
    let near_zero = p + n * (scale * (1.0 / 65536.0));
    return select(bitcast<vec3<f32>>(bits), near_zero, abs(p) < vec3<f32>(scale * (1.0 / 32.0)));
}

// 1/d without infinities: a component too small to divide by counts as a tiny one of the same sign, so that no product in
// a slab test is 0 * inf and no NaN reaches min or max.
fn safe_inverse(d: vec3<f32>) -> vec3<f32> {
    let tiny = vec3<f32>(1e-30);
    let guarded = select(d, select(tiny, -tiny, d < vec3<f32>(0.0)), abs(d) < tiny);
    return 1.0 / guarded;
}
