// How paths that follow a lobe share its light with virtual lights: the balance heuristic (Veach and Guibas 1995) over the densities of
// both. Needs frame.wgsl. CPU twin: pass::eye_paths::{path_share, highlight_factor}.
//   lobe:   density of the path's direction over solid angle
//   lights_per_area: virtual lights on a unit of area of the surface that it meets
//   cosine: of the angle between the path and that surface's normal

// The part of the path. A path without density followed a mirror: no light stands in for it.
fn path_share(lobe: f32, lights_per_area: f32, distance2: f32, cosine: f32) -> f32 {
    let by_path = lobe * cosine;
    return select(by_path / max(by_path + lights_per_area * distance2, 1e-37), 1.0, lobe == 0.0);
}

// The part of the lights, over the square of the distance.
fn highlight_factor(lobe: f32, lights_per_area: f32, distance2: f32, cosine: f32) -> f32 {
    return lights_per_area / max(lobe * cosine + lights_per_area * distance2, 1e-37);
}

// Virtual lights on a unit of area of an emitter of this exitance over pi, and of other surfaces.
fn lights_on_emitter(exitance: f32) -> f32 {
    return frame.choice.y * exitance;
}

fn lights_on_surfaces() -> f32 {
    return frame.choice.z;
}

// Lights from the environment in a unit of solid angle, by the density of one.
fn lights_from_environment(density: f32) -> f32 {
    return f32(frame.depths[0].x) * density;
}
