//! Shading points that the eye sees, directly or through mirrors and glass, or the texels of an atlas.

use super::points::{ListFinish, ListFinishSteps, Turns};
use super::{Counts, PointOrder, Seen, Stage, batch};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::{Buffer, Context, Recorder, Staging};
use crate::pass::atlas::Atlas;
use crate::pass::camera_rays::CameraRays;
use crate::pass::clusters::{self, Clusters};
use crate::pass::edges::EdgeGuides;
use crate::pass::eye_paths::{self, EyePaths};
use crate::pass::eye_points::{self, EyePoints};
use crate::pass::g_buffer::{GBuffer, Records};
use crate::pass::layout::Step;
use crate::pass::mirror_image::Planes;
use crate::pass::reproject::{self, Reproject};
use crate::pass::schedule::Schedule;
use crate::pass::shade::Chunk;
use crate::pass::sort::SortBuffers;
use crate::pass::split_points::SplitPoints;
use crate::pass::tiles::Tiles;
use crate::pass::trace::{EyeSteps, Trace};
use crate::pass::{EyePathState, Kit, List, Rays, ShadingPoints};
use crate::plan::{Plan, StepTable};
use crate::view::View;

/// The stage.
pub struct Eye {
    /// Eye rays; later stages trace rays of their own in them.
    pub rays: Rays,
    /// Light that eye paths carry through mirrors and glass.
    pub paths: EyePathState,
    /// The shading points: a slot for each entry of the view, and where paths are split as many again for the second components, and for third ones.
    pub points: ShadingPoints,
    /// First hits of the pixels, kept for [`super::Edges`].
    pub guides: Option<EdgeGuides>,
    /// Records that the paths leave of glossy planes.
    pub planes: Planes,
    /// Shows what glossy planes mirror by images with depth.
    pub reproject: Option<Reproject>,
    /// Tiles of pixels that show mirrors or glass.
    pub ideal_tiles: List,
    /// For each step through mirrors and glass the rays that go on.
    pub lists: Vec<List>,
    /// The points that are lit.
    pub list: List,
    /// Their order.
    pub order: PointOrder,
    /// Puts the points in clusters by their pixels, in the order [`PointOrder::Screen`].
    pub clusters: Option<Clusters>,
    /// Room to sort in, in the order [`PointOrder::Space`], and for points that gather rays find.
    pub(super) sort_buffers: Option<SortBuffers>,
    pub(super) turns: Turns,
    counts: Counts,
    first: FirstHits,
    tiles: Tiles,
    follow: Vec<Follow>,
    last: LastHits,
    split_points: Option<SplitPoints>,
    finish: ListFinish,
    list_step: u32,
    list_rounds: Vec<u32>,
    tile_count: u32,
    pixels: u32,
    plain_mirrors: bool,
}

/// Where the first hits come from.
enum FirstHits {
    Camera {
        rays: CameraRays,
        trace: Trace,
        steps: EyeSteps,
        pixels: u32,
    },
    Atlas(Atlas),
    /// There are none: the host tells what is seen.
    OfHost,
}

/// Where shading points come from.
enum LastHits {
    Eye(EyePoints),
    GBuffer(GBuffer),
}

/// One step of eye paths through mirrors and glass.
struct Follow {
    pass: EyePaths,
    step: u32,
    schedule: Schedule,
    trace: Trace,
}

impl Eye {
    /// For the view of a plan.
    pub fn new(kit: &Kit, scene: &DeviceScene, plan: &Plan) -> Result<Eye> {
        let (settings, eye) = (&plan.settings, plan.eye);
        let (size, slots, pixels) = (plan.lit_size(), eye.slots(), eye.pixels);
        let order = PointOrder::of(plan, scene);
        let tile_count = size[0].div_ceil(8) * size[1].div_ceil(8);
        let cluster_count = clusters::count(size, settings.pattern) * eye.slots_of_pixel;
        // Lists hold whole tiles.
        let listed = 64 * cluster_count.max(tile_count * eye.slots_of_pixel);
        let lit = plan.lights_points();

        let mut table = StepTable::default();
        // Clusters of rays share their origin.
        let shares_origin = !plan.view.is_orthographic();
        let ray_clusters = Chunk::clusters(settings, scene.clusters(kit.context)).filter(|_| shares_origin);
        let first_steps = EyeSteps::new(&mut table, plan, pixels, ray_clusters);
        let follow_steps: Vec<u32> = (0..eye.steps)
            .map(|bounce| {
                let (components, indirect) = (eye.slots_of_pixel, u32::from(bounce > 0));
                table.add(Step { components, bounce, indirect, ..Step::default() })
            })
            .collect();
        let list_rounds = table.add_list_rounds(plan);
        let list_step = table.add_list();
        let finish_steps = ListFinishSteps::new(&mut table, settings.classes());
        let steps = table.stage(kit, "eye steps")?;

        let rays = Rays::new(kit.context, "eye", slots)?;
        let paths = EyePathState::new(kit.context, slots, if eye.steps > 0 { slots } else { 0 })?;
        let points = ShadingPoints::new(kit.context, "eye", slots)?;
        let guides = if plan.antialiases() || plan.upsamples() {
            Some(EdgeGuides::new(kit, &rays, pixels, eye.plain_mirrors)?)
        } else {
            None
        };
        let planes = Planes::new(kit, pixels, eye.mirrors, eye.panes || eye.curved, eye.images.is_some())?;
        let reproject = match (eye.images, &scene.mirror_images) {
            (Some(choice), Some(images)) => {
                let (region, reprojected, reflectors) =
                    (&planes.region, &planes.reprojected, settings.mirroring_planes());
                let inputs = reproject::Inputs { rays: &rays, images, region, reprojected, pixels, reflectors, choice };
                Some(Reproject::new(kit, &inputs)?)
            }
            _ => None,
        };
        let turns = Turns::new(kit, listed)?;
        let list = turns.list(kit, "eye points", 0)?;
        let lists = (0..follow_steps.len()).map(|i| turns.list(kit, "eye paths", i)).collect::<Result<Vec<_>>>()?;
        let ideal_tiles = List::new(kit, "ideal tiles", &kit.array("ideal tiles", tile_count, 4)?)?;
        let batch = batch(kit, "eye rays")?;
        let clusters = match order {
            PointOrder::Screen => Some(Clusters::new(kit, &list, cluster_count, &steps)?),
            _ => None,
        };
        let sorts = order == PointOrder::Space || order == PointOrder::Screen && plan.bounces() > 1;
        let sort_buffers = if sorts { Some(SortBuffers::new(kit, listed, settings.classes())?) } else { None };
        // Clusters of the screen are filled from places, one for each pixel.
        let places = clusters.as_ref().map_or(&list.entries, |clusters| &clusters.places);
        let filled = List { entries: places.clone(), work: list.work.clone() };

        let first = match &plan.view {
            View::Camera { .. } => FirstHits::Camera {
                rays: CameraRays::new(kit, &rays, &paths, &points, pixels)?,
                trace: Trace::of_eye(kit, &rays, &batch, &steps, shares_origin && scene.wide_nodes.is_some())?,
                steps: first_steps,
                pixels,
            },
            View::Atlas(atlas) => FirstHits::Atlas(Atlas::new(kit, &scene.bvh, atlas, &rays, &paths, &points)?),
            View::GBuffer { .. } => FirstHits::OfHost,
        };
        let tables = if eye.mirrors { scene.tables() } else { None };
        let follow = (lists.iter().zip(follow_steps).enumerate())
            .map(|(i, (list_out, step))| {
                let list_in = i.checked_sub(1).map_or(&ideal_tiles, |before| &lists[before]);
                let (rays, paths, points, planes) = (&rays, &paths, &points, &planes);
                let inputs = eye_paths::Inputs { rays, paths, points, list_in, list_out, planes, tables };
                Ok(Follow {
                    pass: EyePaths::new(kit, &inputs, &steps)?,
                    step,
                    schedule: Schedule::new(kit, &list_out.work, &steps)?,
                    trace: Trace::new(kit, rays, list_out, &steps)?,
                })
            })
            .collect::<Result<_>>()?;
        let step = order.step(eye.slots_of_pixel, lit, settings.max_depth == 1);
        let inputs = eye_points::Inputs { rays: &rays, paths: &paths, points: &points, list: &filled, step };
        let split_points = match eye.components {
            1 => None,
            _ => Some(SplitPoints::new(kit, &inputs, &ideal_tiles)?),
        };
        let sort = sort_buffers.as_ref().filter(|_| lit && order == PointOrder::Space);
        Ok(Eye {
            counts: Counts::new(kit, settings.classes(), lists.iter().chain([&list, &batch]))?,
            tiles: Tiles::new(kit, &rays, &ideal_tiles, tile_count)?,
            last: match first {
                FirstHits::OfHost => {
                    let records = Records::new(kit, pixels)?;
                    LastHits::GBuffer(GBuffer::new(kit, records, (&points, &paths), (&filled, step), tile_count)?)
                }
                _ => LastHits::Eye(EyePoints::new(kit, &inputs, tile_count)?),
            },
            split_points,
            finish: ListFinish::new(kit, &list, &points, sort, finish_steps, &steps)?,
            first,
            follow,
            list_step,
            list_rounds,
            tile_count,
            pixels,
            plain_mirrors: eye.plain_mirrors,
            rays,
            paths,
            points,
            guides,
            planes,
            reproject,
            ideal_tiles,
            lists,
            list,
            order,
            clusters,
            sort_buffers,
            turns,
        })
    }

    /// Of each tile of 8 x 8 pixels: 1 if it is one of `ideal_tiles`, else 0.
    pub fn ideal_marks(&self) -> &Buffer {
        &self.tiles.marks
    }

    /// Its pixels.
    pub fn seen(&self) -> Seen<'_> {
        let Eye { rays, paths, points, pixels, plain_mirrors, .. } = self;
        let guides = self.guides.as_ref();
        Seen { guides, rays, paths, points, pixels: *pixels, plain_mirrors: *plain_mirrors }
    }

    /// Classes of the clusters, for the kernels that take clusters; `None`: there are none.
    pub fn classes(&self) -> Option<&Buffer> {
        match &self.clusters {
            Some(clusters) => Some(&clusters.listed),
            None => self.sort_buffers.as_ref().map(|buffers| &buffers.classes),
        }
    }

    /// Records of the texels, if the view is an atlas.
    pub fn texels(&self) -> Option<&Buffer> {
        match &self.first {
            FirstHits::Camera { .. } | FirstHits::OfHost => None,
            FirstHits::Atlas(atlas) => Some(&atlas.records),
        }
    }

    /// Records of the pixels, if the view is a G-buffer of the host.
    pub fn g_buffer(&self) -> Option<&Records> {
        match &self.last {
            LastHits::Eye(_) => None,
            LastHits::GBuffer(pass) => Some(&pass.records),
        }
    }

    /// Stages the texels of a pass, if the view is an atlas whose texels move.
    pub fn stage_texels(&self, ctx: &Context, view: &View, pass: u32) -> Result<Option<Staging>> {
        let (View::Atlas(view), FirstHits::Atlas(atlas)) = (view, &self.first) else { return Ok(None) };
        let Some(moving) = &view.moving else { return Ok(None) };
        let mut staging = Staging::new();
        atlas.stage(ctx, &mut staging, &moving.texels(pass))?;
        Ok(Some(staging))
    }

    /// The part up to the first hits.
    pub fn record_first(&self, rec: &mut Recorder) -> Result<()> {
        self.counts.record_clear(rec)?;
        rec.fill(&self.planes.region, 0)?;
        match &self.first {
            FirstHits::Camera { rays, trace, steps, pixels } => {
                rays.record(rec)?;
                trace.record_eye(rec, steps, self.tile_count, *pixels)?;
                self.guides.as_ref().map_or(Ok(()), |guides| guides.record(rec))
            }
            FirstHits::Atlas(atlas) => atlas.record(rec),
            FirstHits::OfHost => Ok(()),
        }
    }

    /// The part in which images with depth are reprojected.
    pub fn record_reprojection(&self, rec: &mut Recorder) -> Result<()> {
        match &self.reproject {
            Some(reproject) => rec.scope("reproject", |rec| reproject.record(rec)),
            None => Ok(()),
        }
    }

    /// Steps through mirrors and glass.
    pub fn steps(&self) -> usize {
        self.follow.len()
    }

    /// The part from mirrors and glass to what is seen through them; steps from 0.
    pub fn record_step(&self, rec: &mut Recorder, step: usize) -> Result<()> {
        let Some(follow) = self.follow.get(step) else { return Ok(()) };
        if step == 0 {
            self.record_tiles(rec)?;
        }
        follow.pass.record(rec, follow.step)?;
        let from = step.checked_sub(1).map_or(&self.ideal_tiles, |before| &self.lists[before]);
        follow.schedule.record_filled_from(rec, self.list_step, Some(&from.work))?;
        follow.trace.record(rec, &self.list_rounds, None)
    }

    /// The part of the first step that finds where there are mirrors and glass.
    pub fn record_tiles(&self, rec: &mut Recorder) -> Result<()> {
        self.tiles.record(rec)
    }

    /// The part in which the last hits become shading points on a list.
    pub fn record_points(&self, rec: &mut Recorder) -> Result<()> {
        if let Some(guides) = &self.guides {
            guides.record_mirrors(rec)?;
        }
        if let Some(clusters) = &self.clusters {
            clusters.record_clear(rec)?;
        }
        match &self.last {
            LastHits::Eye(pass) => pass.record(rec)?,
            LastHits::GBuffer(pass) => rec.scope("g_buffer", |rec| pass.record(rec))?,
        }
        if let Some(pass) = &self.split_points {
            pass.record(rec)?;
        }
        match &self.clusters {
            Some(clusters) => rec.scope("clusters", |rec| clusters.record(rec, self.list_step)),
            None => self.finish.record(rec),
        }
    }
}

impl Stage for Eye {
    const NAME: &'static str = "eye";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_first(rec)?;
        self.record_reprojection(rec)?;
        (0..self.steps()).try_for_each(|step| self.record_step(rec, step))?;
        self.record_points(rec)
    }
}
