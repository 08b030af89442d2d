// Shading points of a task from the words of their columns. See pass/unpack_points.rs.
#include "math.wgsl"
#include "flags.wgsl"
#include "octahedral.wgsl"
#include "packed.wgsl"

// After the grid of the pixels columns, a word for each element: of all points, pixels before second components, flags and albedo, normal, distance, direct and indirect irradiance;
// of the pixels triangle and distance of each of their hits; of second components the number of the pixel; of rich points, which have more to tell than a diffuse surface, the number among all points, high flags,
// shading normal, specular reflectance, f90, alpha, probability of the diffuse lobe, flags of the path, emission, specular radiance, number among those off their
// ray; of those off their ray direction to the eye, depth, coordinates, throughput.
@group(0) @binding(1) var<storage, read_write> point_position: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> point_geometric: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> point_shading: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> point_kd: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> point_f0: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> point_wo: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> throughput: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> direct: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> indirect: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> specular: array<vec4<f32>>;
#if RICH
#else
@group(0) @binding(12) var<storage, read_write> first_hits: array<vec2<u32>>;
@group(0) @binding(13) var<storage, read_write> second_hits: array<vec2<u32>>;
#endif

// Host twin: pass::layout::UnpackPush.
struct UnpackPush {
    corner: vec4<f32>,  // direction of the first pixel's ray, of an orthographic camera its start less the eye; w: step of coordinates
    across: vec4<f32>,  // by which that changes from a column to the next; w: exponent of throughputs
    down: vec4<f32>,    // and from a row to the next
    eye: vec4<f32>,     // w: coordinate scale of the scene
    forward: vec4<f32>, // unit view direction; w: 1 if the camera is orthographic, else 0
    counts: vec4<u32>,  // points, pixels, rich points, those off their ray
    image: vec4<u32>,   // first word, width of the image, its pixels, hits of a pixel
    exponents: vec4<i32>,   // of direct, indirect irradiance, emission, specular radiance
}
var<immediate> push: UnpackPush;

// Columns of all points, and of rich ones.
const OF_ALL: u32 = 5u;
const OF_RICH: u32 = 11u;

// Flags of packed points. Host twins: cluster::points::packing.
const PLAIN_FLAGS: u32 = 0x7fu;
const RICH: u32 = 0x80u;
const OFF_RAY: u32 = 0x8000u;

// Word of an element of a column of all points; columns of hits follow them.
fn of_all(column: u32, i: u32) -> u32 {
    return packed[push.image.x + GRID + column * push.counts.x + i];
}

// The first word of the columns of pixels, and of the numbers after them.
fn of_pixels() -> u32 {
    return push.image.x + GRID + OF_ALL * push.counts.x;
}

fn of_second() -> u32 {
    return of_pixels() + 2u * push.image.w * push.counts.y;
}

fn shares(word: u32) -> vec3<f32> {
    return vec3<f32>(vec3<u32>(word, word >> 8u, word >> 16u) & vec3<u32>(255u)) / 255.0;
}

// Three mantissas of eight bits, five bits of an exponent, and ninth bits.
fn color(word: u32, shift: i32) -> vec3<f32> {
    let low = vec3<u32>(word, word >> 8u, word >> 16u) & vec3<u32>(255u);
    let ninth = (vec3<u32>(word >> 29u, word >> 30u, word >> 31u) & vec3<u32>(1u)) << vec3<u32>(8u);
    // A product of two powers of two that are normal numbers.
    let exponent = clamp(i32((word >> 24u) & 31u) + shift - 40, -252, 252);
    let half = exponent / 2;
    let powers = bitcast<vec2<f32>>((vec2<i32>(half, exponent - half) + 127) << vec2<u32>(23u));
    return vec3<f32>(low | ninth) * powers.x * powers.y;
}

fn bits_of_depth(code: u32) -> u32 {
    return code << 6u;
}

fn depth(code: u32) -> f32 {
    return bitcast<f32>(bits_of_depth(code));
}

// Writes position, direction to the eye and throughput of a point on the ray of its pixel; `at`: column and row of the pixel.
fn write_on_ray(slot: u32, at: vec2<f32>, flags: u32, distance: f32, normal: vec3<f32>) {
    let through = push.corner.xyz + at.x * push.across.xyz + at.y * push.down.xyz;
    let parallel = push.forward.w != 0.0;
    let start = push.eye.xyz + select(vec3<f32>(0.0), through, parallel);
    let d = select(through / sqrt(dot(through, through)), push.forward.xyz, parallel);
    point_position[slot] = vec4<f32>(offset_origin(start + distance * d, normal, push.eye.w), distance);
    point_wo[slot] = vec4<f32>(-d, bitcast<f32>(FLAGS | flags));
    throughput[slot] = vec4<f32>(1.0, 1.0, 1.0, dot(d, push.forward.xyz) * distance);
}

#if RICH
fn of_rich(column: u32, k: u32) -> u32 {
    let first = of_second() + push.counts.x - push.counts.y;
    return packed[first + column * push.counts.z + k];
}

fn of_those_off_ray(column: u32, m: u32) -> u32 {
    let first = of_second() + push.counts.x - push.counts.y + OF_RICH * push.counts.z;
    return packed[first + column * push.counts.w + m];
}

fn coordinate(word: u32) -> f32 {
    return f32(bitcast<i32>(word << 8u) >> 8u) * push.corner.w;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let k = (group.x + group.y * groups.x) * 64u + lane;
    if k >= push.counts.z {
        return;
    }
    let i = of_rich(0u, k);
    var at = pixel_of(push.image.x, i);
    var slot = at.x + at.y * push.image.y;
    if i >= push.counts.y {
        let pixel = packed[of_second() + i - push.counts.y];
        at = vec2<u32>(pixel % push.image.y, pixel / push.image.y);
        slot = pixel + push.image.z;
    }
    let word = of_all(0u, i);
    let normal = decode_normal(of_all(1u, i));
    let distance = depth(of_all(2u, i));
    let high = of_rich(1u, k);
    let flags = (word & PLAIN_FLAGS) | ((high & ~OFF_RAY) << 7u);
    direct[slot] = vec4<f32>(color(of_all(3u, i), push.exponents.x), 0.0);
    indirect[slot] = vec4<f32>(color(of_all(4u, i), push.exponents.y), 0.0);
    point_geometric[slot] = vec4<f32>(normal, bitcast<f32>(of_rich(4u, k)));
    point_shading[slot] = vec4<f32>(decode_normal(of_rich(2u, k)), bitcast<f32>(of_rich(5u, k)));
    point_kd[slot] = vec4<f32>(shares(word >> 8u), bitcast<f32>(of_rich(6u, k)));
    point_f0[slot] = vec4<f32>(shares(of_rich(3u, k)), 0.0);
    emitted[slot] = vec4<f32>(color(of_rich(8u, k), push.exponents.z), bitcast<f32>(of_rich(7u, k)));
    specular[slot] = vec4<f32>(color(of_rich(9u, k), push.exponents.w), 0.0);
    if (high & OFF_RAY) == 0u {
        write_on_ray(slot, vec2<f32>(at), flags, distance, normal);
        return;
    }
    let m = of_rich(10u, k);
    let position = vec3<f32>(coordinate(of_those_off_ray(2u, m)), coordinate(of_those_off_ray(3u, m)), coordinate(of_those_off_ray(4u, m)));
    point_position[slot] = vec4<f32>(position, distance);
    point_wo[slot] = vec4<f32>(decode_normal(of_those_off_ray(0u, m)), bitcast<f32>(FLAGS | flags));
    throughput[slot] = vec4<f32>(color(of_those_off_ray(5u, m), i32(push.across.w)), depth(of_those_off_ray(1u, m)));
}
#else
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let i = (group.x + group.y * groups.x) * 64u + lane;
    if i >= push.counts.x {
        return;
    }
    let word = of_all(0u, i);
    let at = pixel_of(push.image.x, i);
    let slot = at.x + at.y * push.image.y;
    if i < push.counts.y && push.image.w > 0u {
        let first = of_pixels() + i;
        first_hits[slot] = vec2<u32>(packed[first], bits_of_depth(packed[first + push.counts.y]));
        if push.image.w > 1u {
            let second = first + 2u * push.counts.y;
            second_hits[slot] = vec2<u32>(packed[second], bits_of_depth(packed[second + push.counts.y]));
        }
    }
    if (word & RICH) != 0u {
        return;
    }
    let normal = decode_normal(of_all(1u, i));
    point_geometric[slot] = vec4<f32>(normal, 0.0);
    point_shading[slot] = vec4<f32>(normal, 0.0);
    point_kd[slot] = vec4<f32>(shares(word >> 8u), 1.0);
    point_f0[slot] = vec4<f32>(0.0);
    emitted[slot] = vec4<f32>(0.0);
    direct[slot] = vec4<f32>(color(of_all(3u, i), push.exponents.x), 0.0);
    indirect[slot] = vec4<f32>(color(of_all(4u, i), push.exponents.y), 0.0);
    specular[slot] = vec4<f32>(0.0);
    write_on_ray(slot, vec2<f32>(at), word & PLAIN_FLAGS, depth(of_all(2u, i)), normal);
}
#endif
