//! Charts: the lit sides of the triangles laid out flat on pages, at one density, without overlap.
//!
//! Charts of the file are kept ([`Scene::lightmap_uvs`]); other sides have new charts on pages after these. `uvunwrap` makes the new ones,
//! object by object and side by side, so that no chart spans two objects: it grows charts from planar regions, flattens them by least squares conformal maps and as-rigid-as-possible steps, and packs their shapes.

use std::collections::{BTreeMap, HashMap};

use glam::Vec2;
use uvunwrap::{Density, MeshInput};

use super::moves::WIDTH;
use super::sides::Sides;
use super::texels::INWARDS;
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

/// Rounding of positions on a page, in texels.
const ROUNDING: f32 = 1e-2;

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
    fit_to_centres(&mut faces, atlas.chart_count as usize);
    let pages = vec![[atlas.width, atlas.height]; atlas.page_count as usize];
    Ok(Charts { pages, faces, count: atlas.chart_count, density: atlas.texels_per_unit })
}

/// Scales and moves each chart so that its bounds lie on centres of texels, the outermost ones just inside: then no look-up reaches beyond them,
/// and a chart of n by m texels needs (n + 1) (m + 1). Where a chart is narrower than half a texel, one column or row of texels holds it:
/// it takes the half texel over which points move.
///
/// Charts keep their first column and row and take at most one more than before, where the padding is.
fn fit_to_centres(faces: &mut [Face], count: usize) {
    // Scale, and place of the point 0, of each chart and axis.
    let fit = |low: f32, high: f32| {
        let (first, width) = ((low + ROUNDING).floor() + 0.5, (high - low).max(f32::MIN_POSITIVE));
        let (start, end) = match width.round() {
            0.0 => (first - 0.5 * WIDTH, first + 0.5 * WIDTH),
            texels => (first - INWARDS, first + texels + INWARDS),
        };
        let scale = (end - start) / width;
        (scale, start - scale * low)
    };
    let fits: Vec<[(f32, f32); 2]> =
        bounds(faces, count).iter().map(|[low, high]| [fit(low.x, high.x), fit(low.y, high.y)]).collect();
    for face in faces {
        let [x, y] = fits[face.chart as usize];
        face.corners = face.corners.map(|c| Vec2::new(x.0 * c.x + x.1, y.0 * c.y + y.1));
    }
}

/// Least and greatest positions of each chart.
pub(super) fn bounds(faces: &[Face], count: usize) -> Vec<[Vec2; 2]> {
    let mut bounds = vec![[Vec2::INFINITY, Vec2::NEG_INFINITY]; count];
    for face in faces {
        let [low, high] = &mut bounds[face.chart as usize];
        for corner in face.corners {
            (*low, *high) = (low.min(corner), high.max(corner));
        }
    }
    bounds
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
    use glam::Vec3;

    use super::*;
    use crate::scene::{Triangle, builtin};

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
        let bounds = bounds(&charts.faces, charts.count as usize);
        for face in &charts.faces {
            let [low, high] = bounds[face.chart as usize];
            for (low, high) in [(low.x, high.x), (low.y, high.y)] {
                let on_centres = [low + INWARDS, high - INWARDS].iter().all(|x| (x.fract() - 0.5).abs() < 1e-3);
                let in_middle = ((0.5 * (low + high)).fract() - 0.5).abs() < 1e-3 && (high - low - WIDTH).abs() < 1e-3;
                assert!(on_centres && high - low > 0.9 || in_middle, "{low} to {high}");
            }
            let expected = 2.0 * density * density * scene.triangle_area(face.triangle as usize);
            let found = area2(face);
            // Narrow charts become as wide as a whole number of texels.
            let narrow = (high - low).min_element() < 4.0;
            assert!(narrow || (found.abs() / expected - 1.0).abs() < 0.3, "{face:?}: {found} for {expected}");
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
    fn triangles_without_area_leave_the_others_as_they_are() {
        // A square, and beside it a triangle of its own.
        let square = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        let alone = [3.0, 4.0, 3.5].map(|x| Vec3::new(x, if x == 3.5 { 1.0 } else { 0.0 }, 0.0));
        let good = [[0, 1, 2], [0, 2, 3], [4, 5, 6]];
        let (a, b, c) = (square[0], square[1], 0.5 * square[1]);
        let far = Vec3::new(-70.0, 30.0, 10.0);
        let mut expected: Option<Vec<Face>> = None;
        let ways: [(&str, [Vec3; 3]); 5] = [
            ("a point", [far; 3]),
            ("two corners at a place", [far, far, far + Vec3::Y]),
            ("corners on a line", [far, far + 0.5 * Vec3::X, far + Vec3::X]),
            ("on an edge of another", [a, c, b]),
            ("an edge of another, twice", [a, b, b]),
        ];
        for (way, corners) in ways {
            for shared in [false, true] {
                let mut scene = Scene { objects: vec![String::from("o")], ..Scene::default() };
                scene.positions.extend(square.iter().chain(&alone).chain(&corners));
                // With the vertices of the square where they are the same places.
                let vertex = |k: usize| square.iter().position(|p| shared && *p == corners[k]).unwrap_or(7 + k) as u32;
                for vertices in good.into_iter().chain([[0, 1, 2].map(vertex)]) {
                    scene.triangles.push(Triangle { vertices, material: 0, object: 0, smooth: false });
                }
                let charts = unwrap(&scene, &[FRONT; 4], 20.0, &Options::default(), &|| false).unwrap();
                let case = format!("{way}, shared {shared}: {charts:?}");
                match &expected {
                    Some(expected) => assert_eq!(charts.faces[..3], expected[..], "{case}"),
                    None => expected = Some(charts.faces[..3].to_vec()),
                }
                assert!((charts.pages.len(), charts.count) == (1, 2) && charts.faces.len() <= 4, "{case}");
                // It has no place, or one on the chart of the square.
                let [low, high] = bounds(&charts.faces[..3], 2)[charts.faces[0].chart as usize];
                for face in &charts.faces[3..] {
                    let within = face.corners.iter().all(|c| c.cmpge(low).all() && c.cmple(high).all());
                    assert!(face.chart == charts.faces[0].chart && within, "{case}");
                }
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
