// Kernels of soft shadows. Needs frame.wgsl and math.wgsl. CPU twin: pass::soft_shadow::reference.

// Edge of a tile, pixels. Host twin: pass::soft_shadow::TILE.
const SOFT_TILE: u32 = 8u;
// Bits of a tile: it has lit pixels, or blocked ones.
const SHOWS_LIT: u32 = 1u;
const SHOWS_BLOCKED: u32 = 2u;
// Greatest half width or height of a kernel, pixels. Host twin: pass::soft_shadow::WIDEST.
const WIDEST: f32 = 128.0;
// Kernels grow no more at cosines of incidence below. Host twin: pass::soft_shadow::LEAST_COSINE.
const LEAST_COSINE: f32 = 0.05;
// Distance from the tangent plane up to which points count as one surface, over their distance. Host twin: pass::soft_shadow::TOLERANCE.
const TOLERANCE: f32 = 0.1;
// Least cosine between the normals of one surface. Host twin: pass::soft_shadow::LEAST_AGREEMENT.
const LEAST_AGREEMENT: f32 = 0.9;

// Words about a point, as the bits of a float that is neither denormal nor no number: a code of its normal in the lowest bits,
// and of a pixel what it shows, or of a blocker the upper half of its ratio.
const NORMAL_BITS: u32 = 0x3fffu;
const PIXEL_WORD: u32 = 0x3f800000u;
const PIXEL_LIT: u32 = 0x4000u;
const PIXEL_BLOCKED: u32 = 0x8000u;
const BLOCKER_FOUND: u32 = 0xbf800000u;     // its ratio is not known yet
const BLOCKER_AT_EDGE: u32 = 0x8000u;       // lit pixels are beside it
const RATIO_BITS: u32 = 0xffff0000u;

// Values of a quad, stored with a point of it: above 0 the ratio of its kernel; 0 if no kernel reaches it; of wide kernels QUAD_LIT less the
// share that is lit; or nothing.
const QUAD_LIT: f32 = -1.0;
const QUAD_UNKNOWN: f32 = -4.0;
// Kernels whose shorter side has more pixels are wide: one serves a quad. Host twin: pass::soft_shadow::WIDE.
const WIDE: f32 = 6.0;

// An emitter: a parallelogram about its centre.
struct SoftLight {
    centre: vec3<f32>,      // with ray-origin offset
    e1: vec3<f32>,
    e2: vec3<f32>,
    normal: vec3<f32>,
}

// The camera, as kernels are projected.
struct SoftView {
    eye: vec3<f32>,
    forward: vec3<f32>,
    right: vec3<f32>,       // over its square, like `up`
    up: vec3<f32>,
    scale: vec2<f32>,       // half of the size of the image; rows count downwards
    parallel: bool,         // an orthographic camera
}

// Kernels load it, and the emitter, before their first branch: behind one, lavapipe loads them lane by lane.
fn soft_view() -> SoftView {
    let right = frame.right.xyz;
    let up = frame.up.xyz;
    let scale = vec2<f32>(0.5, -0.5) * vec2<f32>(frame.within.zw);
    return SoftView(frame.eye.xyz, frame.forward.xyz, right / dot(right, right), up / dot(up, up), scale, is_orthographic());
}

// The kernel of a point x with normal n in the image, for a ratio of 1: pixels along the edges of the light, and the change of depth
// along them, over the depth.
struct SoftKernel {
    a: vec2<f32>,
    b: vec2<f32>,
    depth: vec2<f32>,
}

fn soft_kernel(view: SoftView, light: SoftLight, x: vec3<f32>, n: vec3<f32>) -> SoftKernel {
    let w = x - light.centre;
    let height = min(dot(n, w), -LEAST_COSINE * sqrt(dot(w, w)));
    // Along the rays of the centre onto the tangent plane.
    let p = light.e1 - w * (dot(n, light.e1) / height);
    let q = light.e2 - w * (dot(n, light.e2) / height);
    let d = x - view.eye;
    let z = select(max(dot(d, view.forward), 1e-30), 1.0, view.parallel);
    let scale = view.scale / z;
    let at = vec2<f32>(dot(d, view.right), dot(d, view.up)) / z;
    // Parallel rays show a thing of one size at any depth.
    let depth = select(vec2<f32>(dot(p, view.forward), dot(q, view.forward)), vec2<f32>(0.0), view.parallel);
    let a = scale * (vec2<f32>(dot(p, view.right), dot(p, view.up)) - at * depth.x);
    let b = scale * (vec2<f32>(dot(q, view.right), dot(q, view.up)) - at * depth.y);
    return SoftKernel(a, b, depth / z);
}

// Half of the greater side of the box around a kernel.
fn half_extent(kernel: SoftKernel) -> f32 {
    let size = abs(kernel.a) + abs(kernel.b);
    return 0.5 * max(size.x, size.y);
}

// Whether a kernel is wide both ways.
fn is_wide(kernel: SoftKernel, ratio: f32) -> bool {
    let size = abs(kernel.a) + abs(kernel.b);
    return min(size.x, size.y) * bounded_ratio(ratio, half_extent(kernel)) > WIDE;
}

// The greatest ratio whose kernel is not too wide.
fn bounded_ratio(ratio: f32, extent: f32) -> f32 {
    return min(ratio, WIDEST / max(extent, 1e-6));
}

// Pixels from x to the point whose hard shadow is that of x under the light's point u e1 + v e2 from the centre. `along`: (u, v) times the ratio.
fn kernel_offset(kernel: SoftKernel, along: vec2<f32>) -> vec2<f32> {
    return (kernel.a * along.x + kernel.b * along.y) / max(1.0 + dot(kernel.depth, along), 0.25);
}

// Point i of n = 2^k evenly spread ones in the unit square (Hammersley).
fn spread_point(i: u32, n: u32) -> vec2<f32> {
    let share = 1.0 / f32(n);
    return vec2<f32>((f32(i) + 0.5) * share, f32(reverseBits(i) >> 8u) * (1.0 / 16777216.0) + 0.5 * share);
}

// Whether a point lies on the tangent plane of x with normal n.
fn on_plane(x: vec3<f32>, n: vec3<f32>, point: vec3<f32>) -> bool {
    let chord = point - x;
    let rise = dot(chord, n);
    return rise * rise <= TOLERANCE * TOLERANCE * dot(chord, chord);
}

// Code of a unit vector, 2 x 7 bits (octahedral, Meyer et al. 2010).
fn normal_code(n: vec3<f32>) -> u32 {
    let p = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
    let folded = (1.0 - abs(p.yx)) * select(vec2<f32>(-1.0), vec2<f32>(1.0), p >= vec2<f32>(0.0));
    let e = vec2<u32>(clamp(63.5 * select(folded, p, n.z >= 0.0) + 64.0, vec2<f32>(0.0), vec2<f32>(127.0)));
    return e.x | (e.y << 7u);
}

// Whether a point whose word is given lies on the surface of x with normal n.
fn on_surface(x: vec3<f32>, n: vec3<f32>, point: vec4<f32>) -> bool {
    let code = bitcast<u32>(point.w);
    let e = vec2<f32>(vec2<u32>(code & 127u, (code >> 7u) & 127u)) / 63.5 - 1.0;
    let z = 1.0 - abs(e.x) - abs(e.y);
    let fold = max(-z, 0.0);
    let normal = vec3<f32>(e - select(vec2<f32>(-fold), vec2<f32>(fold), e >= vec2<f32>(0.0)), z);
    let cosine = dot(normal, n);
    let alike = cosine > 0.0 && cosine * cosine >= LEAST_AGREEMENT * LEAST_AGREEMENT * dot(normal, normal);
    return alike && on_plane(x, n, point.xyz);
}

fn is_lit(word: f32) -> bool {
    return (bitcast<u32>(word) & PIXEL_LIT) != 0u;
}

fn is_blocked(word: f32) -> bool {
    return (bitcast<u32>(word) & PIXEL_BLOCKED) != 0u;
}

// 0: no blocker.
fn ratio_in(word: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(word) & RATIO_BITS);
}

// Index of the quad of 2 x 2 pixels around a pixel.
fn quad_of(at: vec2<u32>) -> u32 {
    return at.x / 2u + at.y / 2u * ((frame.size.x + 1u) / 2u);
}

// Tile of a pixel.
fn soft_tile_of(at: vec2<u32>) -> u32 {
    return at.x / SOFT_TILE + at.y / SOFT_TILE * ((frame.size.x + SOFT_TILE - 1u) / SOFT_TILE);
}
