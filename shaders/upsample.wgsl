// Lights each pixel by the lit points around it that show its surface. See pass/upsample.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "camera.wgsl"
#include "edges.wgsl"
#include "radiance.wgsl"
#include "lit_points.wgsl"

// Of lit points, in an image of half the width and height.
@group(0) @binding(9) var<storage, read> lit_hits: array<vec2<u32>>;    // triangle (all ones: none), bits of t
@group(0) @binding(10) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read> emitted: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read> specular: array<vec4<f32>>;
// Of pixels.
@group(0) @binding(18) var<storage, read> first_hits: array<vec2<u32>>;
@group(0) @binding(19) var<storage, read> pixel_kd: array<vec4<f32>>;
@group(0) @binding(20) var<storage, read> pixel_wo: array<vec4<f32>>;
@group(0) @binding(21) var<storage, read_write> pixel_emitted: array<vec4<f32>>;
@group(0) @binding(22) var<storage, read_write> pixel_direct: array<vec4<f32>>;
@group(0) @binding(23) var<storage, read_write> pixel_indirect: array<vec4<f32>>;
@group(0) @binding(24) var<storage, read_write> pixel_specular: array<vec4<f32>>;

// Added to the squared distance of a lit point of another material, lit points. Host twin: pass::upsample::OTHER_MATERIAL.
const OTHER_MATERIAL: f32 = 100.0;

// Light that a lit point lends, or a sum of it.
struct Lent {
    e_direct: vec3<f32>,
    e_indirect: vec3<f32>,
    l: vec3<f32>,   // radiance that does not depend on the pixel's albedo
}

// First hit of the eye ray to a lit point.
fn lit_hit(place: vec2<u32>, guide: vec2<u32>) -> FirstHit {
    return first_hit(guide.x, bitcast<f32>(guide.y), eye_ray(RATE * place, f32(RATE) * frame.pixel_offset.xy));
}

// Whether a lit point is the first hit of its eye ray, and not seen through mirrors or glass.
fn is_first(point: u32) -> bool {
    return point_position[point].w == bitcast<f32>(lit_hits[point].y);
}

// `emits`: the pixel shows its own emission.
fn lent_by(point: u32, emits: bool) -> Lent {
    let light = lighting_of(point);
    let through = throughput[point].xyz;
    let seen = emitted[point].xyz;
    let zero = vec3<f32>(0.0);
    let first = is_first(point);
    let own = select(seen, zero, emits) + through * light.l_specular;
    let whole = seen + through * reflected_radiance(point_kd[point].xyz, light);
    return Lent(select(zero, light.e_direct, first), select(zero, light.e_indirect, first), select(whole, own, first));
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let at = place_of_pixel(pixel);
    let guide = first_hits[pixel];
    let own = first_hit(guide.x, bitcast<f32>(guide.y), eye_ray(at, frame.pixel_offset.xy));
    let emits = mean3(pixel_emitted[pixel].xyz) > 0.0;
    let among = lit_place_of(at);
    let width = lit_size().x;

    // Between the four around it, those that show the surface.
    var sum = Lent(vec3<f32>(0.0), vec3<f32>(0.0), vec3<f32>(0.0));
    var total = 0.0;
    for (var i = 0u; i < 4u; i += 1u) {
        let there = lit_place(among, i, 2u);
        let point = there.x + width * there.y;
        let shows = same_surface(own, lit_hit(there, lit_hits[point]));
        let weight = select(0.0, lit_weight(among, i), shows);
        let lent = lent_by(point, emits);
        sum.e_direct += weight * lent.e_direct;
        sum.e_indirect += weight * lent.e_indirect;
        sum.l += weight * lent.l;
        total += weight;
    }
    let scale = 1.0 / max(total, LEAST_WEIGHT);
    var light = Lent(scale * sum.e_direct, scale * sum.e_indirect, scale * sum.l);

    // Where none does the nearest of sixteen that shows it; else for a diffuse surface one whose point is near in space and faces as it does, for others
    // the nearest, of its material if one is. Zero times for most pixels.
    let diffuse = has_flag(pixel_wo[pixel].w, LIT) && mean3(pixel_kd[pixel].xyz) > 0.0;
    for (var again = select(0u, 1u, total <= LEAST_WEIGHT && own.found); again > 0u; again -= 1u) {
        var chosen = 0u;
        var rank = 0u;
        var least = 3.0e38;
        for (var i = 0u; i < 16u; i += 1u) {
            let there = lit_place(among, i, 4u);
            let point = there.x + width * there.y;
            let theirs = lit_hit(there, lit_hits[point]);
            let offset = vec2<f32>(vec2<i32>(there) - among.square) - among.place;
            let in_image = dot(offset, offset);
            let apart = theirs.position - own.position;
            let in_space = dot(apart, apart) * (1.0 + TURNED * (1.0 - dot(theirs.normal, own.normal)));
            let lends = theirs.found && is_first(point) && mean3(point_kd[point].xyz) > 0.0;
            let other = select(OTHER_MATERIAL, 0.0, theirs.found && theirs.material == own.material);
            // Higher ranks first.
            let r = select(select(1u, 2u, diffuse && lends), 3u, same_surface(own, theirs));
            let distance2 = select(select(in_image + other, in_space, r == 2u), in_image, r == 3u);
            let better = r > rank || (r == rank && distance2 < least);
            chosen = select(chosen, point, better);
            least = select(least, distance2, better);
            rank = select(rank, r, better);
        }
        let lent = lent_by(chosen, emits);
        // Other surfaces take the whole radiance of a lit point.
        let whole = emitted[chosen].xyz + throughput[chosen].xyz * reflected_radiance(point_kd[chosen].xyz, lighting_of(chosen));
        let zero = vec3<f32>(0.0);
        let l = select(select(select(whole, zero, emits), zero, rank == 2u), lent.l, rank == 3u);
        light = Lent(select(zero, lent.e_direct, rank > 1u), select(zero, lent.e_indirect, rank > 1u), l);
    }
    // upsample_paths lights pixels whose paths passed mirrors or glass.
    let l = select(vec3<f32>(0.0), light.l, own.found && !has_flag(pixel_wo[pixel].w, SEEN_BY_SPECULAR));
    pixel_emitted[pixel] += vec4<f32>(l, 0.0);
    pixel_direct[pixel] = vec4<f32>(light.e_direct, 0.0);
    pixel_indirect[pixel] = vec4<f32>(light.e_indirect, 0.0);
    pixel_specular[pixel] = vec4<f32>(0.0);
}
