// Choice of a number of lights, one light after the other. CPU twin: pass::light_lists::chosen. Needs frame.wgsl and math.wgsl.

// Points that no light has taken yet, and the shares of the lights that have not been asked. The shares of all lights add up to the number
// of all points.
struct Choice {
    points: u32,
    shares: f32,
}

// Points that the next light takes: in the mean over u in [0, 1) its share, rounded up or down, of the points that are left.
fn take(choice: ptr<function, Choice>, share: f32, u: f32) -> u32 {
    let expected = share * f32((*choice).points) / max((*choice).shares, 1e-30);
    let taken = min(u32(min(expected + u, 1e6)), (*choice).points);
    (*choice).points -= taken;
    (*choice).shares -= share;
    return taken;
}

// Numbers u of the lights of a class in this pass start here. Classes have numbers in between.
struct Numbers {
    key: u32,
    shift: u32,
}

fn numbers_of(class_number: u32, consumer: u32) -> Numbers {
    return Numbers(hash(key(frame.keys.y, STREAM_LISTS, frame.size.w, consumer)), class_number * (0xffffffffu / frame.pattern.z));
}

fn number_of(numbers: Numbers, light: u32) -> f32 {
    return f32((hash(numbers.key ^ light) + numbers.shift) >> 8u) * (1.0 / 16777216.0);
}
