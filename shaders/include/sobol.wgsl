// The Sobol' sequence. CPU twin: sampling::sobol.

// Columns of the generator matrices of dimensions 2j (x) and 2j + 1 (y), 32 for each j.
@group(0) @binding(20) var<storage, read> sobol_columns: array<vec2<u32>>;

// Components 2j and 2j + 1 of point `index`, as words: at most 32 steps.
fn sobol(j: u32, index: u32) -> vec2<u32> {
    var words = vec2<u32>(0u);
    var rest = index;
    for (var at = 32u * j; rest != 0u; at += 1u) {
        words ^= select(vec2<u32>(0u), sobol_columns[at], (rest & 1u) != 0u);
        rest >>= 1u;
    }
    return words;
}
