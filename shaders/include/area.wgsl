// Area lights: parallelograms. Each shading point sends a ray to its own point of each. A PointLight holds a corner in `position` and the
// edges from there in `wi` and `flux`. CPU twin: pass::visibility::Workload::point.

struct AreaLight {
    corner: vec3<f32>,
    e1: vec3<f32>,
    e2: vec3<f32>,
    centre: vec3<f32>,
    extent: vec3<f32>,      // half of the box around the points, widened by more than their rounding error
}

fn area_light(light: PointLight) -> AreaLight {
    let e1 = light.wi.xyz;
    let e2 = light.flux.xyz;
    let centre = light.position.xyz + 0.5 * (e1 + e2);
    let half_box = 0.5 * (abs(e1) + abs(e2));
    return AreaLight(light.position.xyz, e1, e2, centre, half_box * 1.000001 + abs(centre) * 5e-7);
}

// The point for shading point `p`: the R2 sequence (Roberts 2018) over the lights, rotated randomly for each shading point. Its terms are
// multiples of 1 / x and 1 / x^2 with x^3 = x + 1, in units of 2^-32, so that integer overflow wraps them.
fn area_point(area: AreaLight, p: u32, light: u32) -> vec3<f32> {
    let turn = hash(p);
    let u = f32((turn + light * 0xc13fa9a9u) >> 8u) * (1.0 / 16777216.0);
    let v = f32((hash(turn) + light * 0x91e10da5u) >> 8u) * (1.0 / 16777216.0);
    return area.corner + (area.e1 * u + area.e2 * v);
}
