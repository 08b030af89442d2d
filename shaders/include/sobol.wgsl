// The Sobol' sequence. CPU twin: sampling::sobol.

// Columns of the generator matrices of dimensions 2j (x) and 2j + 1 (y), 32 for each j.
@group(0) @binding(20) var<storage, read> sobol_columns: array<vec2<u32>>;

// A word whose digits are scrambled by a nested uniform permutation.
fn scrambled(word: u32, seed: u32) -> u32 {
    // In the reversed word each bit depends on those below it alone.
    var x = reverseBits(word) + seed;
    x ^= x * 0x6c50b47cu;
    x ^= x * 0xb82f1e52u;
    x ^= x * 0xc7afe638u;
    x ^= x * 0x8d22f6e6u;
    return reverseBits(x);
}

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
