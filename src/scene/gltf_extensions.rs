//! Extensions of glTF: those that are read, and what becomes of a file with others.

use std::collections::BTreeSet;
use std::path::Path;

use gltf::json::Root;

use crate::error::{Error, Result};

/// Instances of a mesh.
pub(super) const INSTANCING: &str = "EXT_mesh_gpu_instancing";
/// WebP images.
pub(super) const WEBP: &str = "EXT_texture_webp";
/// Views compressed by meshoptimizer, by the names of both extensions; the newer one allows another form of attributes as well.
pub(super) const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
/// Meshes compressed by Draco.
pub(super) const DRACO: &str = "KHR_draco_mesh_compression";
/// Images in KTX 2.0 files.
pub(super) const BASISU: &str = "KHR_texture_basisu";
/// A clear lobe over another one.
pub(super) const CLEARCOAT: &str = "KHR_materials_clearcoat";
/// Lobes that differ with the direction.
pub(super) const ANISOTROPY: &str = "KHR_materials_anisotropy";
/// Materials by diffuse and specular colour.
pub(super) const GLOSSINESS: &str = "KHR_materials_pbrSpecularGlossiness";
/// Integers as attributes.
const QUANTIZATION: &str = "KHR_mesh_quantization";

/// Extensions that the loader reads, at least in part; it tells which part of one it leaves out.
const READ: [&str; 18] = [
    INSTANCING,
    MESHOPT[0],
    MESHOPT[1],
    WEBP,
    DRACO,
    CLEARCOAT,
    ANISOTROPY,
    GLOSSINESS,
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    QUANTIZATION,
    BASISU,
    "KHR_texture_transform",
];

/// Consequences of a document's extensions for its loader.
pub(super) struct Extensions {
    /// Attributes may be integers.
    pub quantized: bool,
    /// Extensions that are not read.
    pub left_out: BTreeSet<String>,
}

impl Extensions {
    /// Takes the requirements out of a document, since the glTF crate calls a document invalid that requires an extension
    /// which the crate does not know.
    ///
    /// Errors: an extension is required that is not read, unless it is one of materials.
    pub(super) fn take(path: &Path, root: &mut Root) -> Result<Extensions> {
        let unknown = |name: &&String| !READ.contains(&name.as_str());
        let without = |name: &&&String| !name.starts_with("KHR_materials_");
        let missing: Vec<&str> =
            root.extensions_required.iter().filter(unknown).filter(|n| without(&n)).map(String::as_str).collect();
        if !missing.is_empty() {
            let message = format!(
                "it requires {}, which this version does not read; export the model without it",
                missing.join(", ")
            );
            return Err(Error::file(path, message));
        }
        let all = || root.extensions_used.iter().chain(&root.extensions_required);
        let left_out = all().filter(unknown).cloned().collect();
        let quantized = all().any(|name| name == QUANTIZATION);
        root.extensions_required.clear();
        Ok(Extensions { quantized, left_out })
    }
}
