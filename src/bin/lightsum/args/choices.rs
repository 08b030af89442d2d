//! Values of flags that name one of several ways.

use clap::ValueEnum;
use lightsum::output::Tonemap;
use lightsum::path_trace::SpecularPaths;
use lightsum::settings::{Agreement, ClusterOrder, Compensation, LightChoice, Lookup, Sequence, Traversal};

/// Values of `--light-choice`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LightChoiceFlag {
    /// Proportional to its power
    Power,
    /// Proportional to its estimated contribution to the image, for scenes with many lights
    Contribution,
}

impl From<LightChoiceFlag> for LightChoice {
    fn from(flag: LightChoiceFlag) -> LightChoice {
        match flag {
            LightChoiceFlag::Power => LightChoice::Power,
            LightChoiceFlag::Contribution => LightChoice::Contribution,
        }
    }
}

/// Value of `--delta-lights`; `None` is all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeltaLightsFlag(pub Option<u32>);

/// Values of `--sequence`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SequenceFlag {
    /// Halton, rotated at random
    Halton,
    /// Sobol', randomised by XOR; most uniform if --particles is a power of two
    Sobol,
}

impl From<SequenceFlag> for Sequence {
    fn from(flag: SequenceFlag) -> Sequence {
        match flag {
            SequenceFlag::Halton => Sequence::Halton,
            SequenceFlag::Sobol => Sequence::Sobol,
        }
    }
}

/// Value of `--filter`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilterFlag {
    Off,
    Auto,
    Window([u32; 2]),
}

/// Values of `--filter-agreement`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AgreementFlag {
    /// The points lie in each other's tangent planes, with tolerance for curvature; conserves energy
    Plane,
    /// Depths and normals differ little, as in Wald et al. 2002
    #[value(alias = "paper")]
    DepthAndNormal,
}

impl From<AgreementFlag> for Agreement {
    fn from(flag: AgreementFlag) -> Agreement {
        match flag {
            AgreementFlag::Plane => Agreement::Plane,
            AgreementFlag::DepthAndNormal => Agreement::DepthAndNormal,
        }
    }
}

/// Values of `--compensation`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum CompensationFlag {
    /// Not at all: fastest, but corners are too dark
    Off,
    /// By one short ray for each pixel, whose hit is lit by the irradiance of the pixel that shows it
    Near,
    /// By short rays bounce by bounce, whose hits are lit by all lights: unbiased in the limit
    Exact,
}

impl From<CompensationFlag> for Compensation {
    fn from(flag: CompensationFlag) -> Compensation {
        match flag {
            CompensationFlag::Off => Compensation::Off,
            CompensationFlag::Near => Compensation::Near,
            CompensationFlag::Exact => Compensation::Exact,
        }
    }
}

/// Values of `--traversal`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TraversalFlag {
    /// Clusters if device and scene allow them and they are faster, else single rays
    Auto,
    /// Single rays: runs on every supported device
    Single,
    /// Clusters of 64 rays: several times faster; an error if the device does not support them
    Cluster,
}

impl From<TraversalFlag> for Traversal {
    fn from(flag: TraversalFlag) -> Traversal {
        match flag {
            TraversalFlag::Auto => Traversal::Auto,
            TraversalFlag::Single => Traversal::Single,
            TraversalFlag::Cluster => Traversal::Cluster,
        }
    }
}

/// Values of `--cluster-order`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ClusterOrderFlag {
    /// By pixel if no light is gathered bounce by bounce (--compensation off or near), else as space
    Screen,
    /// By position: needs a sort, but clusters are narrower
    Space,
}

impl From<ClusterOrderFlag> for ClusterOrder {
    fn from(flag: ClusterOrderFlag) -> ClusterOrder {
        match flag {
            ClusterOrderFlag::Screen => ClusterOrder::Screen,
            ClusterOrderFlag::Space => ClusterOrder::Space,
        }
    }
}

/// Values of `--specular-paths`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SpecularFlag {
    /// None: glass is black, and a mirror shows only its diffuse base
    None,
    /// Paths from the eye to the first other surface
    Eye,
    /// Also beyond the second other surface, as without --reference if there are no photons and mirrored lights
    VirtualLights,
    /// All paths
    All,
}

impl From<SpecularFlag> for SpecularPaths {
    fn from(flag: SpecularFlag) -> SpecularPaths {
        match flag {
            SpecularFlag::None => SpecularPaths::None,
            SpecularFlag::Eye => SpecularPaths::Eye,
            SpecularFlag::VirtualLights => SpecularPaths::VirtualLights,
            SpecularFlag::All => SpecularPaths::All,
        }
    }
}

/// Values of `--tonemap`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Curve {
    /// sRGB curve, clipped at 1: exact below, highlights burn out.
    Srgb,
    /// ACES as fitted by Hill: film-like contrast.
    Aces,
    /// AgX as approximated by Wrensch: soft, highlights fade to white.
    Agx,
}

/// Values of `--lookup`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LookupFlag {
    /// Between four texels
    Bilinear,
    /// Among sixteen, by Mitchell's filter
    Bicubic,
}

impl From<LookupFlag> for Lookup {
    fn from(flag: LookupFlag) -> Lookup {
        match flag {
            LookupFlag::Bilinear => Lookup::Bilinear,
            LookupFlag::Bicubic => Lookup::Bicubic,
        }
    }
}

/// Values of `--denoise`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Denoiser {
    /// Open Image Denoise, fed with albedo and normals.
    Oidn,
}

impl From<Curve> for Tonemap {
    fn from(curve: Curve) -> Tonemap {
        match curve {
            Curve::Srgb => Tonemap::Srgb,
            Curve::Aces => Tonemap::Aces,
            Curve::Agx => Tonemap::Agx,
        }
    }
}

/// Values of `--preset`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// Better with every pass, as without a preset: 3x3 interleaved sampling with a filter that fades, 32 particles and a pool of 1200, 8 direct
    /// lights, 3000 photons, near light from the pixels that show it.
    Progressive,
    /// A smooth image after the first pass: the same with 16 particles, 4 direct lights and 1500 photons.
    Interactive,
}
