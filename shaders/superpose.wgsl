// Adds the spread mirror image, times the plane's reflectance, to its pixels. See pass/superpose.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "listed_tile.wgsl"
#include "math.wgsl"
#include "fresnel_fitted.wgsl"
#include "reflectors.wgsl"

@group(0) @binding(1) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> point_f0: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> shown: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(6) var<storage, read> tiles: array<u32>;
@group(0) @binding(7) var<storage, read> region: array<u32>;
@group(0) @binding(8) var<storage, read> spread: array<vec4<f32>>;     // spread by the tail of the kernel
@group(0) @binding(10) var<storage, read> core: array<vec4<f32>>;       // spread by its core
@group(0) @binding(11) var<storage, read> extras: array<vec4<f32>>;    // two for each pixel of a frosted pane or a curved surface
@group(0) @binding(9) var<storage, read> maps: array<vec4<f32>>;       // reflectance maps

const FORM_MAP: u32 = 1u;
const FORM_FRESNEL: u32 = 2u;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = listed_pixel(group, groups, lane);
    if pixel == NO_POINT {
        return;
    }
    let plane = region[pixel];
    if plane == 0u {
        return;
    }
    let geometric = point_geometric[pixel];
    let f0 = point_f0[pixel].xyz;
    let tables = reflectors[plane - 1u];
    let is_pane = tables.z == FROSTED_PANE;
    let extra = extras[2u * select(0u, pixel, tables.z != 0u)];
    let wo = point_wo[pixel].xyz;
    let mu = select(dot(geometric.xyz, wo), extra.w, tables.z != 0u);
    let shading = point_shading[pixel];
    let lobe = lobe_at(first_layer(tables, shading.w, shading.xyz, wo), mu);
    let form = frame.superposition.y;
    let s = sqrt(clamp(mu, 0.0, 1.0)) * f32(MAP_TEXELS - 1u);
    let i = u32(s);
    let mapped = mix(maps[tables.y + i], maps[tables.y + min(i + 1u, MAP_TEXELS - 1u)], s - f32(i)).xyz;
    let schlick = reflectance_of_lobe(lobe, f0, geometric.w);
    let evaluated = select(schlick, lobe.y * fresnel_fitted(f0, mu), form == FORM_FRESNEL);
    let reflectance = select(select(evaluated, mapped, form == FORM_MAP), lobe.y * extra.xyz, is_pane);
    let l = mix(spread[pixel].xyz, core[pixel].xyz, lobe.w);
    shown[pixel] += vec4<f32>(reflectance * l, 0.0);
}
