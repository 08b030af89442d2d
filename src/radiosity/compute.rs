//! Radiosity textures of a scene: the passes of an atlas light the points of each round, and the result is a light map.

use std::sync::Arc;

use glam::Vec2;

use super::balls;
use super::batches::{Batches, whole_blocks};
use super::growth::Growth;
use super::layout::{self, Texture};
use super::refine::{Options, Place, Point, Solution};
use super::sphere::PATCHES;
use super::surfaces::{Surface, surfaces};
use super::{Light, quadtree::Shape};
use crate::accel::Bvh;
use crate::bake::charts::{Charts, Face};
use crate::bake::lightmap::Inside;
use crate::bake::sides::{self, Sides};
use crate::bake::{self, Lightmap, Page, Stop, lightmap};
use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::output::Provenance;
use crate::scene::Scene;
use crate::settings::Settings;
use crate::standalone::Renderer;
use crate::view::{Atlas, Texel};

/// Options of the textures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureOptions {
    /// Texels of textures with more than 2 x 2. Default 2^20.
    pub budget: u64,
    /// Width of the filter: 2 (none) to 6. Default 2.
    pub filter: u32,
}

impl Default for TextureOptions {
    fn default() -> Self {
        TextureOptions { budget: 1 << 20, filter: 2 }
    }
}

/// Surfaces of a scene that are to be lit.
pub struct Radiosity {
    context: Context,
    scene: Scene,
    settings: Settings,
    sides: Vec<Sides>,
    surfaces: Vec<Surface>,
    bvh: Bvh,
}

/// Where the time of rounds went, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// Making the passes of a view: tree, upload, kernels.
    pub prepare: f64,
    /// The passes on the device.
    pub passes: f64,
    /// The rest on the host: criteria, splits, tests for points inside of geometry.
    pub host: f64,
}

/// Progress of a refinement: told before each pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Number of the round, from 0.
    pub round: usize,
    /// Points of the round.
    pub points: usize,
    /// Share of the passes of the round that are done, in [0, 1].
    pub done: f64,
}

impl Radiosity {
    /// Finds the lit sides and the surfaces. Errors: settings out of range; no light on a surface that reflects diffusely.
    pub fn new(context: &Context, scene: &Scene, settings: Settings) -> Result<Radiosity> {
        Self::new_unless(context, scene, settings, &|| false)
    }

    /// [`Radiosity::new`], unless `stop` breaks it off. Errors: [`Error::Interrupted`] too.
    pub fn new_unless(context: &Context, scene: &Scene, settings: Settings, stop: Stop) -> Result<Radiosity> {
        let settings = bake::settings(settings);
        let scene = bake::prepare(scene);
        let sides = sides::lit(context, &scene, &settings, stop)?;
        let surfaces = surfaces(&scene, &sides)?;
        if surfaces.is_empty() {
            let message = "no light reaches a surface that reflects diffusely; there is nothing to bake";
            return Err(Error::Scene(String::from(message)));
        }
        let bvh = Bvh::build(&scene)?;
        Ok(Radiosity { context: context.clone(), scene, settings, sides, surfaces, bvh })
    }

    /// The device and the kernels of the passes.
    pub fn provenance(&self) -> Provenance {
        Provenance { device: self.context.info().identity(), traversal: self.settings.traversal }
    }

    /// The surfaces.
    pub fn surfaces(&self) -> &[Surface] {
        &self.surfaces
    }

    /// Bytes of the host for trees with as many leaves as there may be, their samples and the maps.
    pub fn memory(&self, options: &Options, textures: &TextureOptions, pages: &bake::Options) -> u64 {
        // A leaf has about a third of a node above it, and at most four samples of its own with their places.
        const LEAF: u64 = 24 * 4 / 3 + 4 * 48;
        // Light of a texel, and what a page holds of it.
        const TEXEL: u64 = 24 + 48;
        let small = (2 + 2 * u64::from(pages.padding)).pow(2) * self.surfaces.len() as u64;
        let largest = options.elements as u64 * 4;
        LEAF * options.elements as u64 + TEXEL * (textures.budget.min(largest << options.height) + small)
    }

    /// Light at points after `passes` passes, without a test for points inside of geometry: always the same virtual lights, whatever the
    /// points. `progress` is told the share that is done and returns false to break off.
    ///
    /// Errors: [`Error::Interrupted`]; those of a renderer.
    pub fn light(&self, points: &[Texel], passes: u32, progress: &mut dyn FnMut(f64) -> bool) -> Result<Vec<Light>> {
        let mut batches = Batches::new(points.to_vec(), passes);
        while !batches.are_done() {
            if !progress(batches.share()) {
                return Err(Error::Interrupted);
            }
            batches.pass(self, &|| false)?;
        }
        Ok(batches.light()?.unwrap_or_default())
    }

    /// Grows the trees; every round's points have the light of `passes` passes. `progress` returns false to break off.
    ///
    /// Errors: [`Error::Interrupted`]; options out of range; those of a renderer.
    pub fn refine(
        &self,
        options: &Options,
        passes: u32,
        progress: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<(Solution, Times)> {
        let mut growth = Growth::new(self, options, passes)?;
        while !growth.is_done() {
            if !progress(growth.progress()) {
                return Err(Error::Interrupted);
            }
            growth.pass(&|| false)?;
        }
        let times = growth.times();
        Ok((growth.solution()?, times))
    }

    /// Most points that are rendered together.
    pub(super) fn batch_points(&self) -> usize {
        whole_blocks(bake::batch_texels(&self.context, &self.settings))
    }

    /// The points of samples.
    pub(super) fn texels(&self, solution: &Solution, places: &[Place]) -> Vec<Texel> {
        let height = solution.options().height;
        let texel = |p: Point| self.surfaces[p.root as usize].texel(p.at, height);
        solution.points_of(places).into_iter().map(texel).collect()
    }

    /// A renderer of a view of points.
    pub(super) fn renderer_of(&self, atlas: Arc<Atlas>) -> Result<Renderer> {
        Renderer::with_atlas(self.context.clone(), self.scene.clone(), atlas, self.settings.clone())
    }

    /// Scene and settings, on which the light of points depends.
    pub(super) fn scene_and_settings(&self) -> (&Scene, &Settings) {
        (&self.scene, &self.settings)
    }

    /// Numbers of the triangles in the order of the tree's leaves, for [`Radiosity::is_inside`].
    pub(super) fn leaves(&self) -> Vec<u32> {
        self.bvh.leaf_numbers()
    }

    /// Whether a dark point lies inside of geometry.
    pub(super) fn is_inside(&self, leaves: &[u32], point: &Texel) -> bool {
        Inside { sides: &self.sides, bvh: &self.bvh, leaves }.holds(point)
    }

    /// The light map: textures of all surfaces, within the budget, each in its rectangle of a page.
    ///
    /// Errors: a texture larger than a page; a width of the filter out of range.
    pub fn lightmap(&self, solution: &Solution, textures: &TextureOptions, pages: &bake::Options) -> Result<Lightmap> {
        check(solution.options(), textures, pages)?;
        let TextureOptions { budget, filter } = *textures;
        let most = pages.max_size.saturating_sub(2 * pages.padding);
        let mut textures = layout::textures(&self.surfaces, solution, budget, filter, most);
        let sizes = layout::place(&mut textures, pages.padding, pages.max_size);
        let leaves = self.bvh.leaf_numbers();
        let mut filled: Vec<Page> = sizes.iter().map(|&size| Page::new(size)).collect();
        let mut faces = Vec::new();
        let (mut texels, mut area) = (0.0, 0.0);
        for (chart, texture) in (0..).zip(&textures) {
            let surface = &self.surfaces[texture.surface];
            let count = texture.grid.size.map(|n| n as f32).iter().product::<f32>();
            let of_all = surface.root.area * if surface.patch.is_some() { PATCHES as f32 } else { 1.0 };
            let width = (of_all / count).sqrt();
            self.fill(&mut filled[texture.page as usize], (surface, texture), &leaves, (width, pages.padding));
            texels += f64::from(count);
            area += f64::from(of_all);
            let ball = surface.patch.iter().flat_map(|(ball, _)| ball.faces());
            for (triangle, corners) in surface.faces.iter().copied().chain(ball) {
                let corners = match texture.grid.size {
                    [1, 1] => [texture.place(Vec2::ZERO); 3],
                    _ => corners.map(|at| texture.place(at)),
                };
                faces.push(Face { triangle, back: surface.back, page: texture.page, chart, corners });
            }
        }
        let density = (texels / area).sqrt() as f32;
        let charts = Charts { pages: sizes, faces, count: textures.len() as u32, density };
        Ok(Lightmap { charts, pages: filled, inside: solution.inside() })
    }

    /// Writes a texture and the padding around it.
    fn fill(
        &self,
        page: &mut Page,
        (surface, texture): (&Surface, &Texture),
        leaves: &[u32],
        (width, padding): (f32, u32),
    ) {
        let ([across, down], pad) = (texture.size().map(i64::from), i64::from(padding));
        for y in -pad..down + pad {
            for x in -pad..across + pad {
                let [column, row] = [(0, x), (1, y)].map(|(k, i)| (i64::from(texture.origin[k]) + i) as usize);
                let at = column + row * page.size[0] as usize;
                let light = layout::texel(texture, [x, y]);
                (page.direct[at], page.indirect[at]) = (light.direct, light.indirect);
                let texel = match &surface.patch {
                    Some((ball, _)) => ball.texel(balls::direction([x, y], texture.grid.size)),
                    None => {
                        let on = match (across, surface.root.shape) {
                            (1, Shape::Triangle) => [1.0 / 3.0; 2],
                            (1, Shape::Quad) => [0.5, 0.4],
                            _ => [x, y].map(|i| i as f32 / (across - 1) as f32),
                        };
                        surface.texel(on, Options::MAX_HEIGHT)
                    }
                };
                [page.albedo[at], page.emission[at]] = lightmap::surface(&self.scene, &self.bvh, leaves, &texel, width);
            }
        }
    }
}

/// Errors: a width of the filter out of range; trees whose textures do not fit on a page.
pub fn check(options: &Options, textures: &TextureOptions, pages: &bake::Options) -> Result<()> {
    options.validate()?;
    pages.validate()?;
    if !(2..=6).contains(&textures.filter) {
        return Err(Error::Setting { name: "--prefilter", message: format!("{} is not in 2..=6", textures.filter) });
    }
    let side = (1u32 << options.height) + 1 + 2 * pages.padding;
    if side > pages.max_size {
        let message = format!(
            "trees of height {} make textures of {side} texels with their padding, and --max-size is {}; {} would fit",
            options.height,
            pages.max_size,
            (pages.max_size - 1 - 2 * pages.padding).max(2).ilog2()
        );
        return Err(Error::Setting { name: "--height", message });
    }
    Ok(())
}
