// Near rays. Needs frame.wgsl, math.wgsl and flags.wgsl. Host twins: pass::near_points (CLOSER, ONWARD, KEPT too), pass::near_aim,
// pass::near_collect::{SMOOTH, SLOPE, STEEP, LINKS}.

// Each pass sends near rays from half of the classes of pixels, others in the next passes; from all second components behind mirrors,
// glass and narrow lobes, whose light no filter spreads over the classes. Third components are too faint for that.
fn near_classes() -> u32 {
    return max(frame.pattern.z / 2u, 1u);
}

// Place of the first class in the order of this pass; the classes at places below near_classes() have near rays.
fn near_begin() -> u32 {
    let turn = divided(2u * frame.size.w + frame.keys.w, frame.pattern.z).y;
    return divided(turn * near_classes(), frame.pattern.z).y;
}

// Whether a class of pixels has near rays in this pass.
fn has_near_rays(class_number: u32, begin: u32) -> bool {
    let order = begin + class_number;
    return select(order, order - frame.pattern.z, order >= frame.pattern.z) < near_classes();
}

// Whether no filter spreads a slot's light; `flags` are those of its shading point.
fn stands_alone(slot: u32, flags: f32) -> bool {
    return component_of(slot) == 1u && (segments_of(flags) == 0u || has_flag(flags, NARROW_LOBE));
}

fn has_near_ray(slot: u32, flags: f32) -> bool {
    return has_near_rays(class_of(slot), near_begin()) || stands_alone(slot, flags);
}

// Neighbours of a class, across and down, whose near rays have different directions; `near_add` takes the mean over as many.
fn near_spread() -> u32 {
    return frame.mirrors.w;
}

// Point that gives the near ray of a pixel its direction, among those of the passes and of its neighbours.
fn near_point(slot: u32) -> vec2<f32> {
    let order = divided(near_begin() + class_of(slot), frame.pattern.z).y;
    return near_sequence(slot, frame.size.w * near_classes() + order, STREAM_GATHER);
}

// The same for rays towards near emitters, which all classes send.
fn near_aim_point(slot: u32) -> vec2<f32> {
    return near_sequence(slot, frame.size.w * frame.pattern.z + class_of(slot), STREAM_AIM);
}

// Number `of_class` of a Kronecker sequence, for each of the neighbours that share what they find; its steps are the powers 1/p and 1/p^2
// of the plastic number p (Roberts 2018), in units of 2^-32.
fn near_sequence(slot: u32, of_class: u32, stream: u32) -> vec2<f32> {
    let spread = near_spread();
    let at = place_of_pixel(pixel_of(slot));
    let neighbour = vec2<u32>(divided(at.x, frame.pattern.x).x, divided(at.y, frame.pattern.y).x);
    let place = vec2<u32>(divided(neighbour.x, spread).y, divided(neighbour.y, spread).y);
    let of_pixels = (of_class * spread + place.y) * spread + place.x;
    // Eye paths to second components may follow a lobe by such a sequence too: theirs begins anew in each pass.
    let second = slot >= frame.size.z;
    let n = select(of_pixels, class_at(at), second);
    let begins = select(frame.keys.y, frame.keys.x, second);
    let start = vec2<u32>(key(begins, stream, 0u, 0u), key(begins, stream, 0u, 1u));
    return unit(n * vec2<u32>(3242174889u, 2447445414u) + start);
}

// Number of slots that the near ray of a slot stands for.
fn near_ray_weight(slot: u32, flags: f32) -> f32 {
    return select(f32(frame.pattern.z) / f32(near_classes()), 1.0, stands_alone(slot, flags));
}

// Of an emitter that both a ray along the lobe and one aimed at it may find: the share of the one, and over the density of the other its share.
struct NearWeights {
    along_lobe: f32,
    aimed: f32,
}

fn shared_by(along_lobe: f32, aimed: f32, chance: f32) -> NearWeights {
    let sum = along_lobe + chance * aimed;
    return NearWeights(along_lobe / max(sum, 1e-37), select(0.0, chance / max(sum, 1e-37), aimed > 0.0));
}

// Of rays along a diffuse lobe of the probability `diffuse`, of which the part `sent` is sent; `by_aim`: density of the aimed rays.
fn gather_weights(diffuse: f32, sent: f32, cosine: f32, by_aim: f32) -> NearWeights {
    return shared_by(diffuse * sent * max(cosine, 0.0) * INV_PI, by_aim, 1.0);
}

// Of near rays of a slot.
fn near_weights(slot: u32, diffuse: f32, flags: f32, cosine: f32, by_aim: f32) -> NearWeights {
    return gather_weights(diffuse, 1.0 / near_ray_weight(slot, flags), cosine, by_aim);
}

// Of near rays that go on from their hits; from the others one is aimed.
fn onward_weights(cosine: f32, by_aim: f32) -> NearWeights {
    return shared_by(NEAR_ONWARD * max(cosine, 0.0) * INV_PI, by_aim, 1.0 - NEAR_ONWARD);
}

// Point of a ray that is aimed at an emitter from the hit of a near ray.
fn near_hit_point(slot: u32) -> vec2<f32> {
    let sample = sample_of(slot);
    return vec2<f32>(random(key(frame.keys.x, STREAM_AIM, sample, 2u)), random(key(frame.keys.x, STREAM_AIM, sample, 3u)));
}

// Whether a hit counts as diffuse. A pixel knows irradiance; surfaces that are mostly lobe are lit instead.
fn is_matte(kd: vec3<f32>, f0: vec3<f32>) -> bool {
    return mean3(kd) > NEAR_MATTE * mean3(f0);
}

// Search for the pixel that shows a point.
const NEAR_COSINE: f32 = 0.9;   // of the angle between the two normals, at least
const NEAR_HEIGHT: f32 = 1.0;   // distance from the pixel's tangent plane, at most, in widths of a pixel
const NEAR_WIDTH: f32 = 1.0;    // distance between the points beyond the width of the pattern, at most, in widths of a pixel on the surface
const NEAR_MATTE: f32 = 0.5;    // kd over f0, at least

// Neighbours of a class whose near light is averaged: cosine of the angle between their normals, at least, and slope of the chord between
// them against their tangent planes, at most.
const NEAR_SMOOTH: f32 = 0.9;
const NEAR_SLOPE: f32 = 0.1;

// Near light of neighbouring pixels: slope of the chord against the tangent plane at which it counts half.
const NEAR_STEEP: f32 = 0.25;

// Least probability with which a hit that no pixel shows counts.
const NEAR_KEPT: f32 = 0.1;

// Lights are clipped at this part of the clip distance at hits that no pixel shows, and rays go on from them this often.
const NEAR_CLOSER: f32 = 0.5;
const NEAR_ONWARD: f32 = 0.25;

// Maximum number of near rays in a row.
const NEAR_LINKS: u32 = 3u;
