// Emission with a power of the cosine (Keller 1997, 4.2). CPU twin: light::cosine.

// Power of a cosine that is not negative; exact for an exponent of 1.
fn cosine_power(cosine: f32, exponent: f32) -> f32 {
    var power = cosine;
    // A loop, because it runs zero times where all lights have the cosine law.
    for (var i = select(1u, 0u, exponent == 1.0); i > 0u; i -= 1u) {
        power = pow(max(cosine, 1e-20), exponent);
    }
    return power;
}

// Radiance at an angle over that along the normal.
fn cosine_falloff(cosine: f32, exponent: f32) -> f32 {
    return select(cosine_power(cosine, exponent - 1.0), 1.0, exponent == 1.0);
}

// Intensity along the normal over that of the cosine law for the same flux.
fn cosine_sharpness(exponent: f32) -> f32 {
    return 0.5 * exponent + 0.5;
}
