// Images with depth as a frame sees them. Needs frame.wgsl. Host twins: pass::layout; superposition::depth_images::project has the equations.

struct DepthView {
    x: vec4<f32>,       // X of a point from (z x, z y, z, 1); its pixel is (X / Z, Y / Z)
    y: vec4<f32>,       // Y
    z: vec4<f32>,       // Z, the depth in the mirrored view
    points: vec4<u32>,  // first point, width, height, number of the reflector
}

struct DepthTile {
    inside: vec4<f32>,  // rows of a matrix: the coordinates of an offset in pixels along the edges of a point, at most 1 inside
    view: u32,
    corner: u32,        // column of its first point; row in the upper half of the word
    size: u32,          // width of the box around a point in pixels; height in the upper half
    step: u32,          // only points of every so many-th column and row count, a power of two
}

const NO_IMAGE: u32 = 0xffffffffu;
