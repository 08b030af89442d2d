// Lit points around a pixel that takes their light: one for each square of pixels. Needs frame.wgsl.

// Pixels on each side of a square. Host twin: Settings::MAX_SHADING_RATE.
const RATE: u32 = 2u;
// Host twin: pass::upsample::LEAST_WEIGHT.
const LEAST_WEIGHT: f32 = 1e-6;
// Weight of the angle between normals beside the distance in space. Host twin: pass::edges::TURNED.
const TURNED: f32 = 8.0;

// Width and height of the image of lit points.
fn lit_size() -> vec2<u32> {
    return (frame.size.xy + RATE - 1u) / RATE;
}

// Where a pixel lies among lit points.
struct LitPlace {
    square: vec2<i32>,      // its square
    place: vec2<f32>,       // of its sample, from the sample of the square
}

fn lit_place_of(at: vec2<u32>) -> LitPlace {
    let place = (vec2<f32>(at % RATE) - frame.pixel_offset.xy * f32(RATE - 1u)) / f32(RATE);
    return LitPlace(vec2<i32>(at / RATE), place);
}

// Lit point i of a square of `side` x `side` around a pixel, 2 or 4; beyond the image the nearest one inside.
fn lit_place(among: LitPlace, i: u32, side: u32) -> vec2<u32> {
    let corner = among.square + vec2<i32>(floor(among.place)) - i32(side / 2u - 1u);
    let at = corner + vec2<i32>(i32(i % side), i32(i / side));
    return vec2<u32>(clamp(at, vec2<i32>(0), vec2<i32>(lit_size()) - 1));
}

// Weight of lit point i of 2 x 2.
fn lit_weight(among: LitPlace, i: u32) -> f32 {
    let between = among.place - floor(among.place);
    let across = select(1.0 - between.x, between.x, (i & 1u) == 1u);
    return across * select(1.0 - between.y, between.y, i > 1u);
}
