// Turns an image of linear radiance into the colours of a display. See pass/display.rs.

// Host twin: pass::layout::DisplayPush.
struct DisplayPush {
    scale: f32,     // factor of the radiance: 2^stops
    curve: u32,     // one of the curves below
}

// Host twin: pass::display::Curve.
const SRGB: u32 = 0u;
const ACES: u32 = 1u;
const AGX: u32 = 2u;
const LINEAR: u32 = 3u;

@group(0) @binding(0) var image: texture_storage_2d<rgba32float, read>;
@group(0) @binding(1) var display: texture_storage_2d<rgba8unorm, write>;
var<immediate> push: DisplayPush;

fn srgb(linear: vec3<f32>) -> vec3<f32> {
    let x = clamp(linear, vec3<f32>(0.0), vec3<f32>(1.0));
    return select(1.055 * pow(max(x, vec3<f32>(1e-9)), vec3<f32>(1.0 / 2.4)) - 0.055, 12.92 * x, x <= vec3<f32>(0.0031308));
}

// The matrices are those of output/png.rs, column by column.
fn aces(color: vec3<f32>) -> vec3<f32> {
    let inward = mat3x3<f32>(0.59719, 0.07600, 0.02840, 0.35458, 0.90834, 0.13383, 0.04823, 0.01566, 0.83777);
    let outward = mat3x3<f32>(1.60475, -0.10208, -0.00327, -0.53108, 1.10813, -0.07276, -0.07367, -0.00605, 1.07602);
    let x = inward * color;
    return outward * ((x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.432951) + 0.238081));
}

fn agx(color: vec3<f32>) -> vec3<f32> {
    let inset = mat3x3<f32>(0.84247905, 0.042328242, 0.042375655, 0.0784336, 0.8784686, 0.0784336, 0.079223745, 0.07916613, 0.879143);
    let outset = mat3x3<f32>(1.196879, -0.05289685, -0.05297163, -0.09802088, 1.1519031, -0.09804345, -0.0990297, -0.09896118, 1.1510737);
    let lowest = -12.47393;
    let highest = 4.026069;
    // The logarithm of 0 may be anything.
    let stops = log2(max(inset * color, vec3<f32>(1e-10)));
    let x = (clamp(stops, vec3<f32>(lowest), vec3<f32>(highest)) - lowest) / (highest - lowest);
    let curved = ((((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x - 0.00232);
    return clamp(outset * curved, vec3<f32>(0.0), vec3<f32>(1.0));
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    let size = textureDimensions(image);
    if pixel >= size.x * size.y {
        return;
    }
    let at = vec2<u32>(pixel % size.x, pixel / size.x);
    let scaled = textureLoad(image, at).xyz * push.scale;
    // NaN becomes black; infinity the maximum number, so that no curve computes inf / inf.
    let color = select(vec3<f32>(0.0), min(scaled, vec3<f32>(1e18)), scaled > vec3<f32>(0.0));
    var shown = clamp(color, vec3<f32>(0.0), vec3<f32>(1.0));
    if push.curve == SRGB {
        shown = srgb(color);
    } else if push.curve == ACES {
        shown = srgb(aces(color));
    } else if push.curve == AGX {
        shown = agx(color);
    }
    textureStore(display, at, vec4<f32>(shown, 1.0));
}
