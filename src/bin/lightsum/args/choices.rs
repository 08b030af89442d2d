//! Values of flags that name one of several ways.

use clap::ValueEnum;
use lightsum::output::Tonemap;
use lightsum::path_trace::SpecularPaths;

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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Curve {
    /// sRGB curve, clipped at 1: exact below, highlights burn out.
    #[default]
    Srgb,
    /// ACES as fitted by Hill: film-like contrast.
    Aces,
    /// AgX as approximated by Wrensch: soft, highlights fade to white.
    Agx,
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

/// Values of `--denoise`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Denoiser {
    /// Open Image Denoise, fed with albedo and normals.
    Oidn,
}
