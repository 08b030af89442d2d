// Continues eye paths at mirrors, glass and narrow lobes. See pass/eye_paths.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "point.wgsl"
#include "surface.wgsl"
#include "curvature.wgsl"
#include "ideal.wgsl"
#include "reflectors.wgsl"
#include "lobe_shares.wgsl"

@group(0) @binding(9) var<storage, read_write> work_in: DispatchCounts;
@group(0) @binding(10) var<storage, read> list_in: array<u32>;
@group(0) @binding(11) var<storage, read_write> work_out: DispatchCounts;
@group(0) @binding(12) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(13) var<storage, read> steps: array<Step>;
@group(0) @binding(14) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read_write> throughput: array<vec4<f32>>;
@group(0) @binding(18) var<storage, read_write> media: array<vec4<u32>>;
@group(0) @binding(19) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(20) var<storage, read_write> region: array<u32>;     // reflector that a pixel shows, 0: none
@group(0) @binding(21) var<storage, read_write> widening: array<vec4<f32>>; // widening of its kernel by further glossy planes
@group(0) @binding(22) var<storage, read_write> extras: array<vec4<f32>>;   // two for each pixel of a frosted pane or a curved surface
@group(0) @binding(23) var<storage, read_write> lobe_of: array<f32>;    // density of the ray's direction if it follows a lobe, else 0
@group(0) @binding(24) var<storage, read> reprojected: array<vec4<f32>>;  // radiance and depth by images with depth; depth 0: by a ray
var<immediate> push: Push;

// Probability of following a lobe over its reflectance, and alpha below which it is 1. Host twins: pass::eye_paths.
const LOBE_CHANCE: f32 = 4.0;
const NARROW: f32 = 0.1;

// Steps of the Kronecker sequences of a surface, in units of 2^-32: powers of the plastic number, the golden section, and roots of primes.
// Each surface has its own: one sequence for two would tie their numbers together. Host twin: pass::eye_paths::SEQUENCES.
fn path_steps(bounce: u32) -> vec4<u32> {
    switch bounce & 7u {
        case 0u: { return vec4<u32>(3242174889u, 2447445414u, 2654435769u, 1779033703u); }
        case 1u: { return vec4<u32>(3144134277u, 1013904243u, 2773480763u, 1359893119u); }
        case 2u: { return vec4<u32>(2600822925u, 528734635u, 1541459225u, 3418070365u); }
        case 3u: { return vec4<u32>(1654270251u, 2438529371u, 355462361u, 1731405415u); }
        case 4u: { return vec4<u32>(2394180231u, 3675008525u, 1203062813u, 2925498711u); }
        case 5u: { return vec4<u32>(3479995859u, 796084093u, 1830299339u, 2336478295u); }
        case 6u: { return vec4<u32>(3814765975u, 474308611u, 1863934769u, 3645816497u); }
        default: { return vec4<u32>(214214161u, 639484403u, 1477814207u, 1891102055u); }
    }
}

// Numbers that choose a component (z) and a direction along a lobe (x, y): the same for all pixels of a class, so that neighbouring pixels
// differ smoothly. A sequence over passes and classes, as near rays have (near.wgsl).
fn path_numbers(slot: u32, bounce: u32) -> vec3<f32> {
    let n = frame.size.w * frame.pattern.z + class_of(slot);
    let start = vec3<u32>(
        key(frame.keys.y, STREAM_EYE_LOBE, bounce, 0u),
        key(frame.keys.y, STREAM_EYE_LOBE, bounce, 1u),
        key(frame.keys.y, STREAM_EYE_LOBE, bounce, 2u),
    );
    let point = n * path_steps(bounce).xyz + start;
    return vec3<f32>(unit(point.xy), unit(point.zz).x);
}

// Number that chooses a component where each pixel chooses for itself: a sequence over its passes.
fn own_number(slot: u32, bounce: u32) -> f32 {
    let start = hash(key(frame.keys.y, STREAM_COMPONENT, sample_of(slot), bounce));
    return unit(vec2<u32>(start + frame.size.w * path_steps(bounce).w)).x;
}

// At a lobe: its surface, where lights shine on base and lobe, and a direction along the lobe. `follows`: the path is short enough.
fn split_of_lobe(s: Surface, wo: vec3<f32>, follows: bool, point: vec2<f32>) -> SpecularSplit {
    let r = s.reflectance;
    let sample = sample_lobe(r, false, 0.0, s.shading, wo, point.x, point.y);
    let base = mean3(r.kd);
    let narrow = r.f90 > 0.0 && width_of(r.alpha) <= frame.choice.w && follows;
    // Highlights of lights need their part even if there is no base.
    let share = clamp(base / (base + mean3(schlick(r, dot(s.shading, wo)))), 0.25, 0.75);
    var split: SpecularSplit;
    split.stays = true;
    split.probability = select(1.0, share, narrow);
    split.first_weight = vec3<f32>(1.0);
    split.second_wi = sample.wi;
    split.second_weight = select(vec3<f32>(0.0), sample.weight, dot(sample.wi, s.geometric) > 0.0);
    return split;
}

// Probability of following a lobe of this weight beside its surface. Over narrow ones no filter averages.
fn lobe_chance(weight: vec3<f32>, alpha: f32) -> f32 {
    return select(clamp(LOBE_CHANCE * max(max(weight.x, weight.y), weight.z), 0.2, 1.0), 1.0, alpha < NARROW);
}

// Continues the path of a slot and puts it on the list.
fn go_on(slot: u32, s: Surface, wi: vec3<f32>, cos_view: f32) {
    let side = select(-s.geometric, s.geometric, dot(wi, s.geometric) > 0.0);
    ray_origin[slot] = vec4<f32>(offset_origin(s.position, side, frame.eye.w), 3.0e38);
    ray_direction[slot] = vec4<f32>(wi, cos_view);
    list_out[atomicAdd(&work_out.live, 1u)] = slot;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let step = steps[push.step];
    let first_hit = step.bounce == 0u;
    // First hits are taken in tiles of 8 x 8 pixels, later hits from a list.
    let group_index = group.x + group.y * groups.x;
    let index = select(group_index * 64u + lane, group_index, first_hit);
    if index >= atomicLoad(&work_in.live) {
        return;
    }
    let listed = list_in[index];
    let at_pixel = pixel_of_tile(listed, lane);
    if first_hit && (at_pixel.x >= frame.size.x || at_pixel.y >= frame.size.y) {
        return;
    }
    let slot = select(listed, at_pixel.x + at_pixel.y * frame.size.x, first_hit);
    // The slots of further components have no throughput unless the path splits.
    let splits = first_hit && step.components > 1u;
    for (var i = 1u; first_hit && i < step.components; i += 1u) {
        throughput[slot + i * frame.size.z] = vec4<f32>(0.0);
        emitted[slot + i * frame.size.z] = vec4<f32>(0.0);
    }
    let hit = hits[slot];
    let triangle = bitcast<u32>(hit.w);
    let found = triangle != 0xffffffffu;
    let at = select(0u, triangle, found);
    let normals = triangle_normals[at];
    // For a glossy plane seen directly the second component is the mirror image; the lobe is applied to it later.
    // Within a mirror image a path takes the base or the mirror image of further glossy planes at random.
    let mirrors = frame.superposition.x > 0u;
    let pixel = pixel_of(slot);
    let shows = select(0u, region[select(0u, pixel, mirrors)], mirrors && !first_hit);
    let image_is_first = reflectors[max(shows, 1u) - 1u].z == FROSTED_PANE;
    let in_image = shows > 0u && image_is_first == (slot < frame.size.z);
    // A curved surface shows its mirror image where it is seen directly and hardly concave; elsewhere paths follow its lobe.
    let reflects = select(0u, glossy_plane(normals), found && (splits || (in_image && !is_curved(normals))));
    let bends = reflects > 0u && is_curved(normals);
    var bend: Bend;
    for (var i = select(0u, 1u, bends); i > 0u; i -= 1u) {
        bend = bend_at(at, hit.y, hit.z, ray_direction[slot].xyz, hit.x);
    }
    let plane = select(reflects, 0u, bends && !bend.mild);
    // A frosted pane seen directly shows the scene behind it; the lobe is applied to that later.
    let pane = select(0u, frosted_pane(normals), found && (splits || in_image));
    let frosted = splits && pane > 0u;
    if splits && mirrors {
        region[slot] = max(plane, pane);
        widening[slot] = vec4<f32>(0.0);
    }
    let shiny = plane == 0u && found && is_shiny(normals);
    let ideal = plane > 0u || shiny || (found && materials[material_of(normals)].flags.z != SURFACE_OPAQUE);
    // A loop, because it runs zero times if no ray of the subgroup hit a mirror or glass.
    for (var i = select(0u, 1u, ideal); i > 0u; i -= 1u) {
        let ray = ray_direction[slot];
        let before = throughput[slot];
        let depth = before.w + ray.w * hit.x;
        let s = surface_at(at, hit.y, hit.z, ray.xyz, frame.cones.x * depth_scale(depth));
        let inside = select(media[slot], vec4<u32>(0u), first_hit);
        let other = specular_split(s, -ray.xyz, relative_index(inside, s));
        var split = other;
        // Segments after the first reflection that was not ideal count (the path's own first one does not); the next one must fit.
        let met = select(emitted[slot], vec4<f32>(0.0), first_hit);
        let segments = segments_of(met.w);
        let from_lobe = segments > 0u;
        let fits = segments + 2u <= frame.scene.z;
        let lobe_before = select(0.0, lobe_of[select(0u, slot, from_lobe)], from_lobe);
        let cos_hit = abs(dot(s.geometric, ray.xyz));
        let distance2 = hit.x * hit.x;
        let mu = dot(s.geometric, -ray.xyz);
        let tables = reflectors[max(max(plane, pane), 1u) - 1u];
        let lobe = lobe_at(first_layer(tables, s.reflectance.alpha, s.shading, -ray.xyz), mu);
        if plane > 0u {
            // Within a mirror image the equations stand for the table too.
            let schlicks = reflectance_of_lobe(lobe, s.reflectance.f0, s.reflectance.f90);
            let reflectance = select(schlicks, lobe.y * fresnel_fitted(s.reflectance.f0, mu), is_fresnel());
            split = split_of_plane(s, -ray.xyz, select(reflectance, vec3<f32>(1.0), splits));
        }
        let bent = bends && plane > 0u;
        if bent {
            split.second_wi = reflected(-ray.xyz, bend.normal);
            extras[2u * slot] = vec4<f32>(bend.power, bend.mu);
            extras[2u * slot + 1u] = vec4<f32>(image_of_disc(ray.xyz, -bend.u), hit.x);
        }
        if frosted {
            let disc = image_of_disc(ray.xyz, -mu * ray.xyz - s.geometric);
            extras[2u * slot] = vec4<f32>(split.first_weight, mu);
            extras[2u * slot + 1u] = vec4<f32>(disc, 0.0);
            split.first_weight = vec3<f32>(1.0);
        }
        let numbers = path_numbers(slot, step.bounce);
        if shiny {
            split = split_of_lobe(s, -ray.xyz, fits, numbers.xy);
        }

        // Follows both components as long as slots are free, or one at random.
        // Nothing averages what neighbours see in mirrors and glass: each chooses for itself.
        let own = own_number(slot, step.bounce);
        let free = select(free_component(met.w), 1u, splits);
        let is_ideal = plane == 0u && !shiny;
        let follows_both = splits || (free > 0u && is_ideal && split.probability < 1.0);
        let branch = pixel + select(1u, free, follows_both) * frame.size.z;
        let takes_first = follows_both || select(own, numbers.z, shiny) < split.probability;
        let stays = takes_first && split.stays;
        let wi = select(split.second_wi, split.first_wi, takes_first);
        let chance = select(select(1.0 - split.probability, split.probability, takes_first), 1.0, follows_both);
        let weight = select(select(split.second_weight, split.first_weight, takes_first), vec3<f32>(1.0), stays);
        // Where the path stays `eye_points` applies the share.
        let share = select(1.0, path_share(lobe_before, lights_on_surfaces(), distance2, cos_hit), shiny && !stays);
        let after = select(before.xyz * weight / chance * share, vec3<f32>(0.0), !stays && from_lobe && !fits);
        let goes_on = !stays && max(max(after.x, after.y), after.z) > 0.0;
        throughput[slot] = vec4<f32>(after, select(before.w, depth, goes_on));
        // A mirror over a base emits from the base: `eye_points` adds that where the path stays.
        // The path stopped on the base; do not also shade the lobe.
        let without_lobe = flag_if(LOBE_FOLLOWED, stays && plane > 0u && (in_image || bent));
        let emission_share = path_share(lobe_before, lights_on_emitter(s.exitance), distance2, cos_hit);
        let emission = select(before.xyz * s.emission * emission_share, vec3<f32>(0.0), split.stays);
        let sampled = flag_if(LOBE_SAMPLED, stays && shiny && split.probability < 1.0);
        let longer = select(segments, min(segments + 1u, 15u), goes_on && (from_lobe || shiny));
        let unlikely = flag_if(UNLIKELY, has_flag(met.w, UNLIKELY) || (chance < 0.5 && !shiny));
        let chose = flag_if(CHOSE, has_flag(met.w, CHOSE) || (chance < 1.0 && !shiny));
        let is_deep = step.bounce > 1u;
        let deep = flag_if(DEEP, has_flag(met.w, DEEP) || (is_deep && goes_on));
        let narrow = flag_if(NARROW_LOBE, has_flag(met.w, NARROW_LOBE));
        // Faint lobes are followed by some classes only.
        let follow = select(1.0, lobe_chance(split.second_weight, width_of(s.reflectance.alpha)), shiny);
        let may_follow = numbers.z < follow && (fits || !from_lobe);
        let second = select(vec3<f32>(0.0), before.xyz * split.second_weight / follow, may_follow);
        // Where images with depth show the mirror image no ray is needed.
        let has_images = frame.superposition.z != 0u && plane > 0u;
        let by_image = has_images && reprojected[select(0u, pixel, has_images)].w > 0.0;
        let branches = follows_both && !by_image && split.probability < 1.0 && max(max(second.x, second.y), second.z) > 0.0;
        // The path itself takes the slots that are left; where it ends here the other component takes them. Images that are spread leave none.
        let taken = select(free, free + 1u, branches);
        let left = select(0u, taken, free > 0u && taken < step.components && plane == 0u && !frosted);
        let here = select(select(free_component(met.w), 0u, branches), left, goes_on);
        let left_here = flag_if(here * ONE_FREE, here > 0u);
        let left_there = flag_if(left * ONE_FREE, !goes_on && left > 0u);
        let met_flags = flag_if(longer * ONE_SEGMENT, longer > 0u) | without_lobe | sampled | unlikely | chose | deep | narrow | left_here;
        emitted[slot] = vec4<f32>(met.xyz + select(emission, vec3<f32>(0.0), frosted), bitcast<f32>(met_flags));
        if goes_on && (from_lobe || shiny) {
            let density = lobe_density(s.reflectance.alpha, s.shading, -ray.xyz, wi);
            lobe_of[slot] = select(0.0, density, shiny);
        }
        if frosted {
            emitted[branch] = vec4<f32>(emission, 0.0);
        }
        if goes_on && (in_image || frosted) {
            let t2 = select(0.0, lobe.x * lobe.x, max(plane, pane) > 0u);
            widening[pixel] += vec4<f32>(t2, t2 * depth, t2 * depth * depth, 0.0);
        }
        let beyond = crossed(inside, s.material + 1u, s.front);
        if goes_on {
            media[slot] = select(inside, beyond, takes_first && split.crosses);
            go_on(slot, s, wi, ray.w);
        }
        if branches {
            throughput[branch] = vec4<f32>(second, depth);
            media[branch] = inside;
            let in_lobe = shiny || from_lobe;
            let starts_narrow = flag_if(NARROW_LOBE, shiny && width_of(s.reflectance.alpha) < NARROW);
            let of_branch = flag_if(min(segments + 1u, 15u) * ONE_SEGMENT, in_lobe) | starts_narrow | narrow | flag_if(DEEP, is_deep) | left_there
                | flag_if(UNLIKELY, has_flag(met.w, UNLIKELY)) | flag_if(CHOSE, has_flag(met.w, CHOSE));
            emitted[branch] = vec4<f32>(select(vec3<f32>(0.0), emission, frosted), bitcast<f32>(of_branch));
            if in_lobe {
                let density = lobe_density(s.reflectance.alpha, s.shading, -ray.xyz, split.second_wi);
                lobe_of[branch] = select(0.0, density, shiny);
            }
            go_on(branch, s, split.second_wi, ray.w);
        }
    }
}
