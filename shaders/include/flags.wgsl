// Flags of shading points and eye paths. Host twin: the constants of pass::ShadingPoints.
//
// A word of flags is stored as the w component of a vector of floats. It is copied as a float, but computed with as an integer only.
// Small integers are the bits of denormal numbers, which processors may flush to zero when they copy them: so the bits of 1.0 are
// in every word that has a flag.
const FLAGS: u32 = 0x3f800000u;

// Of a shading point, in point_wo.w.
const HIT: u32 = 1u;                // the ray that looks for it met a surface
const LIT: u32 = 2u;                // it can reflect light to the eye, and is listed
const GLOSSY: u32 = 4u;             // it has a specular lobe
const COVERED: u32 = 8u;            // the eye's own ray met something, be it a mirror that shows nothing
const SEEN_BY_SPECULAR: u32 = 16u;  // the eye sees it through mirrors or glass

const LOBE_SAMPLED: u32 = 64u;      // a path of its own follows its specular lobe, beside the highlights of lights
const NARROW_LOBE: u32 = 128u;      // the eye path to it follows a narrow lobe first

const UNLIKELY: u32 = 256u;         // the eye path to it chose a component of a probability below one half

// Of an eye path, in emitted.w until the path ends, as the three above.
const LOBE_FOLLOWED: u32 = 32u;     // it ended on the base of a glossy plane: the shading point there has no lobe

// Segments of the eye path beyond its first surface that is neither mirror nor glass, at most 15.
const ONE_SEGMENT: u32 = 512u;

// Of a shading point again.
const SPLATS: u32 = 8192u;          // its lobe shows indirect light by splats
const SOFT: u32 = 16384u;           // convolved shadows bring the diffuse light of large emitters

// Of an eye path again, and of a shading point.
const CHOSE: u32 = 32768u;          // the eye path to it chose one component of a mirror or glass at random

const DEEP: u32 = 262144u;          // the eye path to it passed at least three mirrors and surfaces of glass

// Of an eye path: the component whose slot receives the next one that splits off, 0: none does.
const ONE_FREE: u32 = 65536u;

fn free_component(word: f32) -> u32 {
    return (bitcast<u32>(word) / ONE_FREE) & 3u;
}

fn segments_of(word: f32) -> u32 {
    return (bitcast<u32>(word) / ONE_SEGMENT) & 15u;
}

fn flag_if(flag: u32, holds: bool) -> u32 {
    return select(0u, FLAGS | flag, holds);
}

fn has_flag(word: f32, flag: u32) -> bool {
    return (bitcast<u32>(word) & flag) != 0u;
}
