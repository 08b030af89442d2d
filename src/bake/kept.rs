//! Kept light, read again from the files of a bake.

use std::ops::RangeInclusive;
use std::path::Path;

use glam::{Vec2, Vec3};
use gltf::Gltf;
use gltf::accessor::Iter;

use super::files::{Manifest, PageEntry, PrimitiveExtras, RootExtras, geometry};
use crate::error::{Error, Result};
use crate::input::Inputs;
use crate::scene::gltf::ours;
use crate::scene::quietly::quietly;
use crate::scene::{KeptFace, KeptLight, KeptPage, Scene, openexr};

/// Stops by which maps may be brighter than irradiance: their factors are numbers of single precision.
const EXPOSURES: RangeInclusive<i32> = -126..=126;

/// Reads the kept light of a scene from a file of [`super::files::write()`]. Errors: [`Error::Io`]; [`Error::File`] if the file is malformed, holds
/// no light or a part of it, or is of another scene.
pub fn read(path: &Path, scene: &Scene) -> Result<KeptLight> {
    let bytes = crate::input::read(path)?;
    // The glTF crate does not check all that it reads.
    let (manifest, faces) = quietly(|| read_faces(path, &bytes, scene))
        .map_err(|message| Error::file(path, format!("malformed glTF: {message}")))??;
    let mut pages = Vec::new();
    for (i, entry) in manifest.pages.iter().enumerate() {
        if !EXPOSURES.contains(&entry.exposure) {
            let (low, high) = EXPOSURES.into_inner();
            let message = format!("page {i} has the exposure {}; it must lie between {low} and {high}", entry.exposure);
            return Err(Error::file(path, message));
        }
        let map = |name: &Option<String>| name.as_ref().map(|name| read_map(path, name, entry)).transpose();
        let black = || vec![Vec3::ZERO; entry.size[0] as usize * entry.size[1] as usize];
        let (direct, indirect) = match (map(&entry.irradiance)?, map(&entry.direct)?, map(&entry.indirect)?) {
            (Some(both), None, None) => (both, black()),
            (None, Some(direct), Some(indirect)) => (direct, indirect),
            _ => {
                let message = "it holds a part of the light alone; bake with --parts together or apart";
                return Err(Error::file(path, message));
            }
        };
        pages.push(KeptPage { size: entry.size, direct, indirect });
    }
    let kept = KeptLight { faces, pages };
    kept.check(scene).map_err(|message| Error::file(path, format!("{message}; bake it anew")))?;
    Ok(kept)
}

/// Light of each side by [`KeptLight::faces`].
type Faces = Vec<[Option<KeptFace>; 2]>;

fn read_faces(path: &Path, bytes: &[u8], scene: &Scene) -> Result<(Manifest, Faces)> {
    let refuse = |message: String| Error::file(path, message);
    let Gltf { document, blob } = Gltf::from_slice(bytes).map_err(|e| refuse(format!("malformed glTF: {e}")))?;
    let none = || refuse(String::from("it holds no kept light; lightsum bake writes files that do"));
    let manifest = ours::<RootExtras>(&document.as_json().extras).ok_or_else(none)?.lightmap;
    if manifest.version != 1 {
        return Err(refuse(format!("its light has version {}, this program reads 1", manifest.version)));
    }
    if manifest.geometry != geometry(scene) {
        return Err(refuse(String::from("its light is of another scene, or of an earlier state of it; bake it anew")));
    }
    let blob = blob.ok_or_else(none)?;
    let mut faces = vec![[None; 2]; scene.triangles.len()];
    for primitive in document.meshes().flat_map(|mesh| mesh.primitives()) {
        let Some(PrimitiveExtras { page, triangles }) = ours(primitive.extras()) else { continue };
        let size = manifest.pages.get(page as usize).map(|entry| Vec2::new(entry.size[0] as f32, entry.size[1] as f32));
        let size = size.ok_or_else(|| refuse(format!("a primitive names page {page}, which does not exist")))?;
        let reader = primitive.reader(|_| Some(&blob));
        let missing = || refuse(String::from("a primitive lacks what its kept light needs; bake it anew"));
        let accessor = document.accessors().nth(triangles).ok_or_else(missing)?;
        let numbers = Iter::<u32>::new(accessor, |_| Some(&blob)).ok_or_else(missing)?;
        let places: Vec<Vec2> =
            reader.read_tex_coords(manifest.tex_coord).ok_or_else(missing)?.into_f32().map(Vec2::from_array).collect();
        let indices: Vec<u32> = reader.read_indices().ok_or_else(missing)?.into_u32().collect();
        for (number, corners) in numbers.zip(indices.chunks_exact(3)) {
            let back = number & 1 == 1;
            let face = faces.get_mut((number >> 1) as usize).ok_or_else(missing)?;
            let mut of = [Vec2::ZERO; 3];
            for (corner, &v) in of.iter_mut().zip(corners) {
                *corner = *places.get(v as usize).ok_or_else(missing)? * size;
            }
            if back {
                of.swap(1, 2);
            }
            face[usize::from(back)] = Some(KeptFace { page, corners: of });
        }
    }
    Ok((manifest, faces))
}

/// The irradiance of a map beside the model.
fn read_map(path: &Path, name: &str, entry: &PageEntry) -> Result<Vec<Vec3>> {
    let file = path.with_file_name(name);
    if Path::new(name).file_name().is_none_or(|own| own != name) {
        return Err(Error::file(path, format!("map {name:?} does not lie beside the model")));
    }
    let bytes = crate::input::read(&file)?;
    let inputs = Inputs::anywhere();
    let reserve = |bytes| inputs.take(&file, bytes).map_err(|e| e.to_string());
    let openexr::Pixels { size, values } = openexr::decode(&bytes, &reserve).map_err(|e| Error::file(&file, e))?;
    if size != entry.size {
        let ([w, h], [a, b]) = (size, entry.size);
        return Err(Error::file(&file, format!("the map has {w}x{h} texels where {} says {a}x{b}", path.display())));
    }
    let scale = (-entry.exposure as f32).exp2();
    Ok(values.into_iter().map(|[r, g, b, _]| Vec3::new(r, g, b) * scale).collect())
}
