//! Flags of `--reference`.

use clap::Args;

use super::SpecularFlag;

/// Path tracing on the CPU, for comparison.
#[derive(Debug, Args)]
#[command(next_help_heading = "Reference")]
pub struct Reference {
    /// Render by path tracing on the CPU instead: same scene, camera and path length, noise instead of structured error.
    #[arg(long, conflicts_with_all = [
        "passes", "time", "target_error", "resume", "checkpoint", "particles", "light_pool", "direct_lights", "interleave", "clip", "clip_fraction", "compensation", "no_compensation", "split", "no_split", "glossy_paths", "no_glossy_paths", "antialias", "no_antialias", "shading_rate",
        "photons", "photon_radius", "interleave_photons", "no_interleave_photons", "mirror_lights", "filter", "superposition", "kernel_width", "convolution", "occlusion", "no_occlusion", "reflectors", "glossy", "splat_particles", "splat_width", "splat_alpha", "soft_shadows", "soft_shadow_lights", "mirror_source", "summands", "no_summands",
        "light_threshold", "light_choice", "power_fraction", "delta_lights", "sequence", "jitter", "no_jitter", "preset", "device", "validation", "lights_per_dispatch", "rounds", "traversal", "cluster_order", "export_lights", "light_from", "stats", "preview", "display",
    ])]
    pub reference: bool,
    /// Samples per pixel of --reference [default: 64]. Time grows linearly, noise falls with the square root.
    #[arg(long, value_name = "N", requires = "reference", value_parser = clap::value_parser!(u32).range(1..))]
    pub spp: Option<u32>,
    /// Paths of --reference that continue at mirrors and glass [default: all].
    #[arg(long, value_name = "WHERE", requires = "reference")]
    pub specular_paths: Option<SpecularFlag>,
}
