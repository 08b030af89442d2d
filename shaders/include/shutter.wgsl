// Motion while the shutter is open. See pass/velocity.rs.

// Cameras as it opens and as it closes. Host twin: pass::layout::Shutter.
struct Shutter {
    shift: array<vec4<f32>, 2>,     // eye now less eye then
    right: array<vec4<f32>, 2>,     // image half width at unit distance, orthographic: at any, divided by its square; w: displacement of the image's centre
    up: array<vec4<f32>, 2>,        // likewise its half height
    forward: array<vec4<f32>, 2>,   // unit view direction
    moving: vec4<u32>,              // triangles that move; y, z, w: 0
}

// Maximum length of a velocity, pixels. Host twin: pass::velocity::MAX_LENGTH.
const MAX_LENGTH: f32 = 1023.0;
