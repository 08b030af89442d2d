// Reads the images of a host's G-buffer into records. See pass/g_buffer_read.rs.

// Host twin: pass::layout::GBufferPush.
struct GBufferPush {
    world_from_clip: array<vec4<f32>, 4>,   // columns
    background: f32,    // depth of pixels that see nothing
    offset: f32,        // by which points are moved along their geometric normals
    bits: u32,          // those below
    unused: u32,
}

// Host twins: the constants of pass::layout::GBufferPush.
const BY_DEPTH: u32 = 1u;               // places are told by depth
const HAS_GEOMETRIC: u32 = 2u;
const HAS_SPECULAR: u32 = 4u;
const HAS_EMISSION: u32 = 8u;
const NORMALS_FROM_0: u32 = 16u;        // in [0, 1], for [-1, 1]
const GEOMETRIC_FROM_0: u32 = 32u;

@group(0) @binding(0) var place_image: texture_2d<f32>;
@group(0) @binding(1) var normal_image: texture_2d<f32>;
@group(0) @binding(2) var geometric_image: texture_2d<f32>;
@group(0) @binding(3) var albedo_image: texture_2d<f32>;
@group(0) @binding(4) var specular_image: texture_2d<f32>;
@group(0) @binding(5) var emission_image: texture_2d<f32>;
@group(0) @binding(6) var<storage, read_write> given_position: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> given_normal: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> given_geometric: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> given_albedo: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> given_specular: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> given_emission: array<vec4<f32>>;
var<immediate> push: GBufferPush;

fn has(bit: u32) -> bool {
    return (push.bits & bit) != 0u;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    let size = textureDimensions(place_image);
    if pixel >= size.x * size.y {
        return;
    }
    let place = vec2<u32>(pixel % size.x, pixel / size.x);
    let at = vec2<i32>(place);
    let told = textureLoad(place_image, at, 0);
    let normal = textureLoad(normal_image, at, 0).xyz;
    let geometric = textureLoad(geometric_image, at, 0).xyz;
    let signed_normal = select(normal, 2.0 * normal - 1.0, has(NORMALS_FROM_0));
    let signed_geometric = select(geometric, 2.0 * geometric - 1.0, has(GEOMETRIC_FROM_0));
    // Without one, the shading normal.
    let side = select(signed_normal, signed_geometric, has(HAS_GEOMETRIC));

    // The centre of the pixel in clip space, whose y points up.
    let centre = (vec2<f32>(place) + 0.5) / vec2<f32>(size);
    let clip = vec3<f32>(2.0 * centre.x - 1.0, 1.0 - 2.0 * centre.y, told.x);
    let world = push.world_from_clip[0] * clip.x + push.world_from_clip[1] * clip.y + push.world_from_clip[2] * clip.z + push.world_from_clip[3];
    let by_depth = has(BY_DEPTH);
    let position = select(told.xyz, world.xyz / world.w, by_depth);
    let seen = select(told.w > 0.0, told.x != push.background, by_depth);
    let length2 = dot(side, side);
    let moved = position + side * (push.offset / sqrt(max(length2, 1e-20)));

    let specular = textureLoad(specular_image, at, 0);
    let emission = textureLoad(emission_image, at, 0).xyz;
    given_position[pixel] = vec4<f32>(moved, select(0.0, 1.0, seen));
    given_normal[pixel] = vec4<f32>(signed_normal, select(1.0, specular.w, has(HAS_SPECULAR)));
    given_geometric[pixel] = vec4<f32>(side, 0.0);
    given_albedo[pixel] = vec4<f32>(textureLoad(albedo_image, at, 0).xyz, 0.0);
    given_specular[pixel] = vec4<f32>(select(vec3<f32>(0.0), specular.xyz, has(HAS_SPECULAR)), 0.0);
    given_emission[pixel] = vec4<f32>(select(vec3<f32>(0.0), emission, has(HAS_EMISSION)), 0.0);
}
