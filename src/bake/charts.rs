//! Charts: the lit sides of the triangles laid out flat on pages, at one density, without overlap.
//!
//! Charts of the file are kept ([`Scene::lightmap_uvs`]); other sides have new charts on pages after these. `uvunwrap` makes the new ones,
//! object by object and side by side, so that no chart spans two objects: it grows charts from planar regions, flattens them by least squares conformal maps and as-rigid-as-possible steps, and packs their shapes.

use std::collections::{BTreeMap, HashMap};

use glam::Vec2;
use uvunwrap::{Density, MeshInput};

use super::sides::Sides;
use super::{Options, Stop, file_charts, too_dense};
use crate::error::{Error, Result};
use crate::scene::Scene;

/// A side of a triangle on a page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Index of the triangle.
    pub triangle: u32,
    /// Its back, else its front.
    pub back: bool,
    /// Index of the page.
    pub page: u32,
    /// Number of the chart.
    pub chart: u32,
    /// Positions of the triangle's three vertices on the page in texels, x to the right, y down.
    pub corners: [Vec2; 3],
}

/// The layout.
#[derive(Clone, Debug, PartialEq)]
pub struct Charts {
    /// Width and height of each page in texels.
    pub pages: Vec<[u32; 2]>,
    /// The sides that have a place.
    pub faces: Vec<Face>,
    /// Number of charts.
    pub count: u32,
    /// Texels along a unit of length.
    pub density: f32,
}

/// Lays out the lit sides, unless `stop` breaks it off.
///
/// Errors: a chart larger than a page, with a density that would fit; [`Error::Interrupted`].
pub fn lay_out(scene: &Scene, sides: &[Sides], density: f32, options: &Options, stop: Stop) -> Result<Charts> {
    let (mut charts, rest) = file_charts::of_file(scene, sides, density, options);
    if stop() {
        return Err(Error::Interrupted);
    }
    if rest.iter().all(|sides| sides.count() == 0) {
        return Ok(charts);
    }
    let new = unwrap(scene, &rest, density, options, stop)?;
    let (pages, count) = (charts.pages.len() as u32, charts.count);
    charts.faces.extend(new.faces.iter().map(|face| Face {
        page: pages + face.page,
        chart: count + face.chart,
        ..*face
    }));
    charts.pages.extend(new.pages);
    charts.count += new.count;
    Ok(charts)
}

/// New charts of sides.
fn unwrap(scene: &Scene, sides: &[Sides], density: f32, options: &Options, stop: Stop) -> Result<Charts> {
    let mut groups: BTreeMap<(u32, bool), Vec<u32>> = BTreeMap::new();
    for (i, triangle) in (0u32..).zip(&scene.triangles) {
        for back in [false, true].into_iter().filter(|&back| sides[i as usize].has(back)) {
            groups.entry((triangle.object, back)).or_default().push(i);
        }
    }
    let meshes: Vec<Mesh> = groups.iter().map(|(&(_, back), triangles)| Mesh::of(scene, triangles, back)).collect();
    let inputs: Vec<MeshInput> = meshes.iter().map(|mesh| MeshInput::new(&mesh.positions, &mesh.indices)).collect();
    let made = |page_size| {
        let density = Density::Fixed { texels_per_unit: density, page_size };
        let options = uvunwrap::Options { density, padding: options.padding, ..Default::default() };
        uvunwrap::generate_with_progress(&inputs, &options, |_| !stop())
    };
    // One page as small as can be, or several of the greatest size.
    let most = options.max_size;
    let atlas = match made(None) {
        Ok(atlas) if atlas.width <= most && atlas.height <= most => Ok(atlas),
        _ => made(Some(most)),
    };
    let atlas = atlas.map_err(|e| failure(&e, density, options))?;
    let size = Vec2::new(atlas.width as f32, atlas.height as f32);
    let mut faces = Vec::new();
    for (((_, back), triangles), mesh) in groups.iter().zip(&atlas.meshes) {
        for (&triangle, corners) in triangles.iter().zip(mesh.indices.chunks_exact(3)) {
            let of = [corners[0], corners[1], corners[2]].map(|v| mesh.vertices[v as usize]);
            // Triangles too thin for a place of their own collapse onto one, if they have a neighbour.
            let Some((page, chart)) = of.iter().find_map(|v| v.page.zip(v.chart)) else { continue };
            let mut corners = of.map(|v| Vec2::from_array(v.uv) * size);
            if *back {
                corners.swap(1, 2);
            }
            if of.iter().all(|v| v.page == Some(page)) {
                faces.push(Face { triangle, back: *back, page, chart, corners });
            }
        }
    }
    let pages = vec![[atlas.width, atlas.height]; atlas.page_count as usize];
    Ok(Charts { pages, faces, count: atlas.chart_count, density: atlas.texels_per_unit })
}

/// Input of the unwrapper: one side of an object's triangles, counter-clockwise as seen from it.
struct Mesh {
    positions: Vec<[f32; 3]>,
    indices: Vec<u32>,
}

impl Mesh {
    fn of(scene: &Scene, triangles: &[u32], back: bool) -> Mesh {
        let mut local: HashMap<u32, u32> = HashMap::new();
        let mut mesh = Mesh { positions: Vec::new(), indices: Vec::with_capacity(3 * triangles.len()) };
        for &triangle in triangles {
            let mut vertices = scene.triangles[triangle as usize].vertices;
            if back {
                vertices.swap(1, 2);
            }
            for v in vertices {
                let next = mesh.positions.len() as u32;
                let index = *local.entry(v).or_insert(next);
                if index == next {
                    mesh.positions.push(scene.positions[v as usize].to_array());
                }
                mesh.indices.push(index);
            }
        }
        mesh
    }
}

fn failure(error: &uvunwrap::Error, density: f32, options: &Options) -> Error {
    match *error {
        uvunwrap::Error::ChartTooLarge { width, height, page_size } => {
            let free = page_size.saturating_sub(2 * options.padding) as f64;
            let needed = f64::from(width.max(height).saturating_sub(2 * options.padding)).max(1.0);
            too_dense(f64::from(density), f64::from(density) * free / needed)
        }
        uvunwrap::Error::AtlasTooLarge { texels } => {
            too_dense(f64::from(density), f64::from(density) * (f64::from(1 << 26) / texels as f64).sqrt())
        }
        uvunwrap::Error::Cancelled => Error::Interrupted,
        ref other => Error::Scene(format!("charts: {other}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    const FRONT: Sides = Sides { front: true, back: false };

    /// Twice the signed area of a face on its page.
    fn area2(face: &Face) -> f32 {
        let [a, b, c] = face.corners;
        (b - a).perp_dot(c - a)
    }

    #[test]
    fn charts_keep_areas_and_do_not_overlap() {
        let scene = builtin::room(800);
        let both = Sides { front: true, back: true };
        let density = 12.0;
        let options = Options { max_size: 256, ..Options::default() };
        let charts = unwrap(&scene, &vec![both; scene.triangles.len()], density, &options, &|| false).unwrap();
        assert!(charts.pages.len() > 1, "several pages: {:?}", charts.pages);
        assert_eq!(charts.faces.len(), 2 * scene.triangles.len());
        let mut owner: HashMap<(u32, i32, i32), u32> = HashMap::new();
        for face in &charts.faces {
            let expected = 2.0 * density * density * scene.triangle_area(face.triangle as usize);
            let found = area2(face);
            assert!((found.abs() / expected - 1.0).abs() < 0.3, "{face:?}: {found} for {expected}");
            assert_eq!(found < 0.0, face.back, "the back is mirrored, in the triangle's own order");
            let [w, h] = charts.pages[face.page as usize].map(|n| n as f32);
            for corner in face.corners {
                assert!(corner.x >= 1.0 && corner.y >= 1.0 && corner.x <= w - 1.0 && corner.y <= h - 1.0, "{face:?}");
                // Charts stay apart by twice the padding.
                let place = (face.page, corner.x as i32, corner.y as i32);
                assert_eq!(*owner.entry(place).or_insert(face.chart), face.chart, "two charts in a texel");
            }
        }
    }

    #[test]
    fn a_chart_larger_than_a_page_is_refused_with_a_density_that_fits() {
        let scene = builtin::room(800);
        let sides = vec![FRONT; scene.triangles.len()];
        let options = Options { max_size: 64, ..Options::default() };
        let message = unwrap(&scene, &sides, 50.0, &options, &|| false).unwrap_err().to_string();
        let fits: f32 = message.split("; ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!(message.contains("--density") && fits < 50.0, "{message}");
        unwrap(&scene, &sides, fits, &options, &|| false).unwrap();
    }
}
