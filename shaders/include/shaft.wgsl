// Shaft: a volume around all rays of a cluster. Boxes outside it are dropped for all rays at once.
// AREA: the rays come from an area light, each from its own point of it.

#if AREA
// A box that moves with t: at t = 0 around the points of the area light (the origin is the light's centre), at t = 1 around the
// shading points. On each axis its lower side is -extent + t slope_lo and its upper side extent + t slope_hi.
struct Shaft {
    extent: vec3<f32>,          // half of the light's box
    inverse_lo: vec3<f32>,      // 1 / slope of the lower side, finite
    inverse_hi: vec3<f32>,      // 1 / slope of the upper side, finite
    rising_lo: vec3<bool>,      // the lower side rises with t
    rising_hi: vec3<bool>,      // the upper side rises with t
}

// `lo`, `hi`: box of the shading points.
fn make_shaft(lo: vec3<f32>, hi: vec3<f32>, extent: vec3<f32>) -> Shaft {
    let tiny = vec3<f32>(1e-30);
    let slope_lo = lo + extent;
    let slope_hi = hi - extent;
    var shaft: Shaft;
    shaft.extent = extent;
    shaft.rising_lo = slope_lo >= vec3<f32>(0.0);
    shaft.rising_hi = slope_hi >= vec3<f32>(0.0);
    shaft.inverse_lo = 1.0 / select(min(slope_lo, -tiny), max(slope_lo, tiny), shaft.rising_lo);
    shaft.inverse_hi = 1.0 / select(min(slope_hi, -tiny), max(slope_hi, tiny), shaft.rising_hi);
    return shaft;
}

// Whether the shaft may meet a box: at some t its lower side lies below the upper side of the box on every axis, and its upper
// side above the lower side of the box. Conservative: may say yes for a box outside the shaft.
fn shaft_meets(shaft: Shaft, lo: vec3<f32>, hi: vec3<f32>) -> bool {
    let t_lo = (hi + shaft.extent) * shaft.inverse_lo;
    let t_hi = (lo - shaft.extent) * shaft.inverse_hi;
    let zero = vec3<f32>(0.0);
    let one = vec3<f32>(1.0);
    let near3 = max(select(t_lo, zero, shaft.rising_lo), select(zero, t_hi, shaft.rising_hi));
    let far3 = min(select(one, t_lo, shaft.rising_lo), select(t_hi, one, shaft.rising_hi));
    let near = max(max(near3.x, near3.y), max(near3.z, 0.0));
    let far = min(min(far3.x, far3.y), min(far3.z, 1.0)) * 1.000002;
    return near <= far;
}
#else
// All points t d with d in the box of the cluster's directions. For points x of a box, t is on each axis at least x_lo * enter_lo
// and x_hi * enter_hi, and at most x * leave + never with x the side that is left last.
struct Shaft {
    enter_lo: vec3<f32>,    // 1 / maximum d if that is positive, else 0
    enter_hi: vec3<f32>,    // 1 / minimum d if that is negative, else 0
    leave: vec3<f32>,       // 1 / the d nearest to 0; 0 on an axis whose d take both signs, which bounds no t from above
    never: vec3<f32>,       // huge on such an axis, else 0
    positive: vec3<bool>,   // all d are positive
}

fn make_shaft(lo: vec3<f32>, hi: vec3<f32>) -> Shaft {
    // Smaller values count as 0, so that there are no infinities.
    let tiny = vec3<f32>(1e-30);
    let positive = lo > tiny;
    let negative = hi < -tiny;
    let one_sign = positive | negative;
    var shaft: Shaft;
    shaft.enter_lo = select(vec3<f32>(0.0), 1.0 / hi, hi > tiny);
    shaft.enter_hi = select(vec3<f32>(0.0), 1.0 / lo, lo < -tiny);
    shaft.leave = select(vec3<f32>(0.0), 1.0 / select(hi, lo, positive), one_sign);
    shaft.never = select(vec3<f32>(3.0e38), vec3<f32>(0.0), one_sign);
    shaft.positive = positive;
    return shaft;
}

// The interval of t <= t_max in which the shaft meets a box; it misses the box if the interval is empty. Integers order like
// floats here: negative values need no order.
fn shaft_span(shaft: Shaft, lo: vec3<f32>, hi: vec3<f32>, t_max: f32) -> vec2<f32> {
    let enter = max(bitcast<vec3<i32>>(lo * shaft.enter_lo), bitcast<vec3<i32>>(hi * shaft.enter_hi));
    let leave = bitcast<vec3<i32>>(select(lo, hi, shaft.positive) * shaft.leave + shaft.never);
    let t_near = bitcast<f32>(max(max(enter.x, enter.y), max(enter.z, 0)));
    let t_far = bitcast<f32>(min(min(leave.x, leave.y), min(leave.z, bitcast<i32>(t_max)))) * 1.000002;
    return vec2<f32>(t_near, t_far);
}

// Whether the shaft may meet a box. Conservative: may say yes for a box outside the shaft.
fn shaft_meets(shaft: Shaft, lo: vec3<f32>, hi: vec3<f32>) -> bool {
    let span = shaft_span(shaft, lo, hi, 1.0);
    return span.x <= span.y;
}
#endif
