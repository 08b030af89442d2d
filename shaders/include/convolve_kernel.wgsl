// Samples kernels. See pass/convolve.rs. Needs convolve.wgsl.

@group(0) @binding(1) var<storage, read> quads: array<vec4<f32>>;      // the four texels around each cell of each layer

// Value of a kernel at an offset between two pixels. axis: u axis / radius; ratio: inverse radius along v over that along u.
fn kernel_at(axis: vec2<f32>, ratio: f32, layer: u32, offset: vec2<f32>) -> f32 {
    let u = axis.x * offset.x + axis.y * offset.y;
    let v = ratio * (axis.x * offset.y - axis.y * offset.x);
    let at = vec2<f32>(u, v) * 16.0 + 16.5;
    let inside = clamp(at, vec2<f32>(0.0), vec2<f32>(32.9999));
    let cell = vec2<u32>(inside);
    let part = inside - vec2<f32>(cell);
    let quad = quads[layer * CELLS_OF_LAYER + cell.y * CELLS + cell.x];
    let rows = mix(quad.xz, quad.yw, vec2<f32>(part.x));
    return select(0.0, mix(rows.x, rows.y, part.y), all(at == inside));
}

// Radius along u over that along v; it doubles every four steps.
fn narrowed(steps: u32) -> f32 {
    return exp2(0.25 * f32(steps));
}

// Half the number of columns that a disc of radius `reach` + 1 covers, `row` rows from its centre.
fn chord(reach: i32, row: i32) -> i32 {
    let radius = f32(reach + 1);
    return i32(sqrt(max(radius * radius - f32(row * row), 0.0)));
}
