// Materials. Host twin: pass::layout::MaterialRecord.

struct MaterialRecord {
    base: vec4<f32>,        // base colour; w: metallic
    specular: vec4<f32>,    // dielectric reflectance at normal incidence; w: roughness
    emission: vec4<f32>,    // radiance along the normal, with a texture where that is white; w: index of refraction
    flags: vec4<u32>,       // base texture + 1, metallic-roughness texture + 1, kind of surface, bits below
    normal: vec4<u32>,      // normal texture + 1, bits of its scale, of the opacity and of the cutoff of alpha (negative: none)
    lobes: vec4<f32>,       // exponent of the emitted cosine, exitance over that of Lambert's law; minus the exponent of a lobe by phong.wgsl,
                            // 0: GGX, up to 1: square of the strength of its anisotropy, above: the number of a table by lobe_table.wgsl; rotation
                            // of its grain
}

const MATERIAL_TWO_SIDED: u32 = 1u; // emits on both sides
const MATERIAL_SHINY: u32 = 2u;     // its lobe may be narrow enough for eye paths to follow
const MATERIAL_ALPHA: u32 = 4u;     // rays may pass
const MATERIAL_SECOND_UVS: u32 = 8u;// the first of four bits: base, metallic-roughness, normal, emission texture lies by the second coordinates
const MATERIAL_EMISSION_SHIFT: u32 = 8u;    // emission texture + 1

const SURFACE_OPAQUE: u32 = 0u;
const SURFACE_MIRROR: u32 = 1u;
const SURFACE_GLASS: u32 = 2u;
const SURFACE_PANE: u32 = 3u;       // thin glass
