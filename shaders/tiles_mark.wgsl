// Marks the tiles of 8 x 8 pixels in which an eye ray hit a mirror, glass, a glossy plane or a narrow lobe. See pass/tiles.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"

@group(0) @binding(9) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> marks: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = (group.x + group.y * groups.x) * 64u + lane;
    let tiles = (frame.size.xy + 7u) / 8u;
    if tile >= tiles.x * tiles.y {
        return;
    }
    let part = part_of_tile(tile);
    let count = part.z * part.w;
    var mark = 0u;
    for (var i = 0u; i < count && mark == 0u; i += 1u) {
        let at = part.xy + vec2<u32>(i % part.z, i / part.z);
        let triangle = bitcast<u32>(hits[at.x + at.y * frame.size.x].w);
        let found = triangle != 0xffffffffu;
        let normals = triangle_normals[select(0u, triangle, found)];
        let ideal = materials[material_of(normals)].flags.z != SURFACE_OPAQUE || glossy_plane(normals) > 0u;
        mark = select(0u, 1u, found && (ideal || is_shiny(normals)));
    }
    marks[tile] = mark;
}
