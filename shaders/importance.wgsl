// Estimates the unshadowed contribution of each emitter to points that the eye sees. See pass/importance.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "emitters.wgsl"
#include "cosine.wgsl"
#include "flags.wgsl"

@group(0) @binding(1) var<storage, read> emitters: array<EmitterRecord>;
@group(0) @binding(2) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> point_f0: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> contributions: array<f32>;

const PROBES: u32 = 256u;

// Irradiance at x under shading normal n, without shadows.
fn irradiance(e: EmitterRecord, x: vec3<f32>, n: vec3<f32>) -> f32 {
    let kind = bitcast<u32>(e.p0.w);
    let flags = bitcast<u32>(e.e2.w);
    let edges = e.e1.xyz + e.e2.xyz;
    let middle = select(select(0.0, 0.5, kind == EMITTER_QUAD), 1.0 / 3.0, kind == EMITTER_TRIANGLE);
    let d = e.p0.xyz + edges * middle - x;
    let r2 = dot(d, d);
    let wi = d / max(sqrt(r2), 1e-20);
    let cosine = dot(wi, n);
    let leaving = -dot(wi, e.normal.xyz);
    let emitting = cosine_power(select(max(leaving, 0.0), abs(leaving), (flags & 1u) != 0u), e.flux.w);
    // A minimum distance even without clipping: otherwise one point on a light could outweigh all others.
    let nearest = max(frame.right.w, 1e-8 * frame.eye.w * frame.eye.w);
    let spread = e.e1.w * INV_PI;
    let radius2 = e.e1.x * e.e1.x;
    let radiance = mean3(e.radiance.xyz);
    switch kind {
        case EMITTER_TRIANGLE, EMITTER_QUAD: {
            let from_disc = r2 + spread;
            let wide = clamp(cosine + sqrt(spread / max(from_disc, 1e-30)), 0.0, 1.0);
            return radiance * e.e1.w * emitting * wide / max(from_disc, nearest);
        }
        case EMITTER_SPHERE: {
            let inside = r2 < radius2;
            let wide = clamp(cosine + sqrt(radius2 / max(r2, 1e-30)), 0.0, 1.0);
            let outside = radiance * PI * radius2 * wide / max(r2, nearest);
            let inward = (flags & 2u) != 0u;
            return select(select(outside, 0.0, inward), select(0.0, radiance * PI, inward), inside);
        }
        case EMITTER_POINT: {
            return radiance * max(cosine, 0.0) / max(r2, nearest);
        }
        case EMITTER_SPOT: {
            let s = clamp((leaving - e.e1.y) / max(e.e1.x - e.e1.y, 1e-6), 0.0, 1.0);
            return radiance * s * s * max(cosine, 0.0) / max(r2, nearest);
        }
        case EMITTER_DIRECTIONAL: {
            return radiance * max(-dot(e.normal.xyz, n), 0.0);
        }
        case EMITTER_ENVIRONMENT: {
            let sine = sqrt(min(e.e1.w * (0.5 * INV_PI), 1.0));
            return radiance * e.e1.w * clamp(sine - dot(e.normal.xyz, n), 0.0, 1.0);
        }
        default: {
            return radiance * (INV_PI * cosine_sharpness(e.flux.w)) * emitting * max(cosine, 0.0) / max(r2, nearest);
        }
    }
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
    if index >= frame.scene.y {
        return;
    }
    let e = emitters[index];
    var sum = 0.0;
    for (var i = 0u; i < PROBES; i += 1u) {
        // A Hammersley point of the image.
        let x = u32((f32(i) + 0.5) * (1.0 / f32(PROBES)) * f32(frame.size.x));
        let y = u32(f32(reverseBits(i) >> 8u) * (1.0 / 16777216.0) * f32(frame.size.y));
        let pixel = min(x, frame.size.x - 1u) + min(y, frame.size.y - 1u) * frame.size.x;
        let lit = has_flag(point_wo[pixel].w, LIT);
        let n = point_shading[pixel].xyz;
        let reflected = mean3(point_kd[pixel].xyz) + mean3(point_f0[pixel].xyz);
        sum += select(0.0, reflected * irradiance(e, point_position[pixel].xyz, n), lit);
    }
    contributions[index] = sum * (1.0 / f32(PROBES));
}
