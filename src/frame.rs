//! The frame: each stage once, in order; the outputs of one stage are inputs of later ones.
//!
//! [`Frame::record`] is one pass of the renderer, read from top to bottom; [`Frame::new`] makes the stages in the same
//! order.

use crate::cluster::points::Taken;
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::film::Film;
use crate::gpu::{Buffer, Context, Image, Memory, Recorder, Resources, Staging};
use crate::pass::caustics::Caustics;
use crate::pass::delta_choice::{Candidates, DeltaChoice};
use crate::pass::discontinuity::{self, Discontinuity};
use crate::pass::discontinuity_lobes::DiscontinuityLobes;
use crate::pass::gain::{self, Gain, PathGain};
use crate::pass::glossy_light::GlossyLight;
use crate::pass::importance::Importance;
use crate::pass::kept_light::KeptLight;
use crate::pass::layout;
use crate::pass::lens::{self, Lens};
use crate::pass::light_lists::LightLists;
use crate::pass::merge::Merge;
use crate::pass::mirror_image::Planes;
use crate::pass::mirror_lights::{self, MirrorLights};
use crate::pass::motion_blur::{self, MotionBlur};
use crate::pass::outliers::{self, Outliers};
use crate::pass::soft_shadow::SoftShadowAdd;
use crate::pass::sparse_windows::SparseWindows;
use crate::pass::summands::Summands;
use crate::pass::third_light::ThirdLight;
use crate::pass::unlikely::Unlikely;
use crate::pass::unpack_points;
use crate::pass::velocity::Velocity;
use crate::pass::{Kit, List};
use crate::plan::Plan;
use crate::ring::{Form, Paths};
use crate::settings::LightChoice;
use crate::stage::{
    Compensation, Edges, Eye, GlossyPlanes, LampEdges, NearLight, Output, PhotonLighting, Photons, Shade, SoftShadows,
    Splats, Stage, Upsample, Walk,
};

/// Buffers of a frame that the next one goes on with.
pub struct Kept {
    /// Running sums.
    pub film: Film,
    /// The image for the host.
    pub image: Image,
    /// Lights of a ring, if as many paths are kept.
    pub lights: Option<Buffer>,
}

/// Words of 32 bits of a pixel in each of [`Frame::more_buffers`].
pub(crate) const MORE_WORDS: [usize; MORE] = [1, 4, 8, 4, 4, 4, 4, 4, 4, 4, 4];
/// Number of these arrays.
pub(crate) const MORE: usize = 11;

/// The stages of a frame and its buffers.
pub struct Frame {
    /// Parameters, written at the start of each pass.
    pub parameters: Buffer,
    /// Of this frame, `[0]`: rays lost; `[1]`: pixels whose values are no numbers; `[2]`: 1 + the last of them.
    pub status: Buffer,
    shading_rate: u32,
    /// Finds the visible shading points.
    pub eye: Eye,
    /// Finds how far what each pixel shows moves while the shutter is open.
    pub velocity: Option<Velocity>,
    /// Sets the probabilities by which the particles of this pass choose emitters, from the visible points.
    pub importance: Option<Importance>,
    /// Traces particles from the emitters, which become point lights.
    pub walk: Walk,
    /// Chooses the lights without area that light this pass; `None`: all of them do.
    pub delta_choice: Option<DeltaChoice>,
    /// The lights of each shading point: all of its class, or those that its cluster chooses.
    pub light_lists: LightLists,
    /// Shoots photons from the emitters at mirrors and glass and sorts them into a grid.
    pub photons: Option<Photons>,
    /// Lights the visible points by point lights, with clipped distances.
    pub shade: Shade,
    /// Lights them by the largest emitters, with soft shadows by convolution, and keeps that light apart.
    pub soft_shadows: Option<SoftShadows>,
    /// Lights them by light kept in textures, in place of virtual lights.
    pub kept_light: Option<KeptLight>,
    /// Lights the visible points by photons.
    pub photon_lighting: Option<PhotonLighting>,
    /// Lights the visible points by point lights over planar mirrors.
    pub mirror_lights: Option<MirrorLights>,
    /// Lights lobes of the visible points by particles that are stored on their surfaces.
    pub splats: Option<Splats>,
    /// Restores the light that clipping removed, by short rays, bounce by bounce.
    pub compensation: Option<Compensation>,
    /// Restores it from the irradiance of other pixels.
    pub near_light: Option<NearLight>,
    /// Adds the light of third components to second ones.
    pub third_light: Option<ThirdLight>,
    /// Averages irradiance over neighbours on the same surface.
    pub discontinuity: Option<Discontinuity>,
    /// Exchanges irradiance where the filter found few neighbours.
    pub sparse_windows: Option<SparseWindows>,
    /// Keeps caustics out of the filter.
    pub caustics: Option<Caustics>,
    /// Keeps what the filter added to second components.
    pub path_gain: Option<PathGain>,
    /// Adds the light of paths along specular lobes.
    pub glossy_light: Option<GlossyLight>,
    /// Averages specular radiance over neighbours that reflect alike.
    pub discontinuity_lobes: Option<DiscontinuityLobes>,
    /// Adds the light with soft shadows, which no filter averages.
    pub soft_shadow_add: Option<SoftShadowAdd>,
    /// Antialiases lamps in mirrors and glass.
    pub lamp_edges: Option<LampEdges>,
    /// Lowers emission that unlikely paths found.
    pub outliers: Option<Outliers>,
    /// Spreads what unlikely components show over their neighbours.
    pub unlikely: Option<Unlikely>,
    /// Spreads mirror images over their glossy planes.
    pub glossy_planes: Option<GlossyPlanes>,
    /// Adds the light of second components to their pixels.
    pub merge: Option<Merge>,
    /// Lights pixels by lit points nearby.
    pub upsample: Option<Upsample>,
    /// Antialiases edges.
    pub edges: Option<Edges>,
    /// Sums what the filters added.
    pub gain: Option<Gain>,
    /// Sums emission, diffuse and specular light separately.
    pub summands: Option<Summands>,
    /// Blurs pixels out of focus.
    pub lens: Option<Lens>,
    /// Blurs what moves.
    pub motion_blur: Option<MotionBlur>,
    /// Adds the image to the film.
    pub output: Output,
}

impl Frame {
    /// Makes the stages of a plan for a scene; if glossy planes mirror the room the scene must have their tables.
    /// `kept`: buffers to go on with, of the same size; `None`: new ones.
    pub fn new(
        context: &Context,
        staging: &mut Staging,
        scene: &DeviceScene,
        plan: &Plan,
        kept: Option<Kept>,
    ) -> Result<Frame> {
        let settings = &plan.settings;
        let parameters =
            Buffer::new(context, "frame parameters", size_of::<layout::FrameParameters>() as u64, Memory::Device)?;
        let status = Buffer::new(context, "status", 16, Memory::Device)?;
        let own = Resources::of([("frame", &parameters), ("status", &status)]);
        let kit = &Kit::new(context, staging, scene, settings.traversal, &own);
        let (film, image, lights) = match kept {
            Some(Kept { film, image, lights }) => (film.with_summands(context, settings.summands)?, image, lights),
            None => {
                let (film, image) = Self::new_film(context, plan)?;
                (film, image, None)
            }
        };
        let film = film.with_ring(context, settings.ring.map(|ring| ring.images()))?;

        let eye = Eye::new(kit, scene, plan)?;
        let velocity = match plan.view.has_shutter() {
            false => None,
            true => {
                let seen = (&eye.rays, &eye.paths, &eye.points);
                Some(Velocity::new(kit, seen, plan.eye.pixels, scene.movable_triangles())?)
            }
        };
        let importance = match settings.light_choice {
            LightChoice::Power => None,
            LightChoice::Contribution => Some(Importance::new(kit, &scene.emitter_records, &eye.points)?),
        };
        let emitters = importance.as_ref().map_or(&scene.emitter_records, |importance| &importance.emitters);
        let lights = lights.filter(|_| settings.ring.is_some_and(|ring| ring.form == Form::Lights));
        let walk = Walk::new(kit, scene, plan, emitters, lights.as_ref())?;
        let delta_choice = match plan.chooses_delta(scene) {
            false => None,
            true => {
                let candidates = Candidates::new(&scene.delta, &scene.delta_emitters());
                Some(DeltaChoice::new(kit, &candidates, emitters, &walk.lights, settings.classes())?)
            }
        };
        let light_lists = LightLists::new(kit, plan, &eye, &walk.lights)?;
        let photons = Photons::new(kit, plan, &walk)?;
        let shade = Shade::new(kit, scene, plan, &eye, &light_lists)?;
        let soft_shadows = SoftShadows::new(kit, scene, plan, &eye)?;
        let kept_light = match &scene.kept_light {
            None => None,
            Some(kept) => {
                Some(KeptLight::new(kit, kept, settings.lookup, &eye.rays, &shade.lighting, plan.eye.slots())?)
            }
        };
        let photon_lighting = PhotonLighting::new(kit, plan, photons.as_ref(), (&eye, &shade))?;
        let mirror_lights = match &plan.mirrors {
            None => None,
            Some(mirrors) => {
                let inputs = mirror_lights::Inputs {
                    lights: &walk.lights,
                    points: &eye.points,
                    list: &eye.list,
                    rays: &eye.rays,
                    lighting: &shade.lighting,
                    slots: plan.eye.slots(),
                };
                Some(MirrorLights::new(kit, plan, mirrors, &inputs)?)
            }
        };
        let splats = Splats::new(kit, scene, plan, (&eye, &shade))?;
        let compensation = Compensation::new(kit, scene, plan, (&eye, &light_lists, &walk.lights, &shade))?;
        let near_light = NearLight::new(kit, scene, plan, (&eye, &light_lists, &shade), soft_shadows.as_ref())?;
        // Pixels that see through mirrors and glass themselves take irradiance alone.
        let follows = plan.pixels_follow();
        let third_light = match plan.eye.slots_of_pixel {
            3 if !follows => Some(ThirdLight::new(kit, &eye.points, &eye.paths, &shade.lighting, &eye.ideal_tiles)?),
            _ => None,
        };
        // Kept light has no noise that a filter could take away.
        let filter = settings.filter.filter(|_| kept_light.is_none());
        let (discontinuity, sparse_windows) = match filter {
            None => (None, None),
            Some(filter) => {
                let inputs = discontinuity::Inputs {
                    points: &eye.points,
                    paths: &eye.paths,
                    lighting: &shade.lighting,
                    ideal_tiles: &eye.ideal_tiles,
                    components: plan.eye.components,
                    size: plan.lit_size(),
                    pattern: settings.pattern,
                    filter,
                };
                let pass = Discontinuity::new(kit, &inputs)?;
                let sparse = filter.has_sparse().then(|| SparseWindows::new(kit, &inputs, &pass));
                (Some(pass), sparse.transpose()?)
            }
        };
        let lighting = discontinuity.as_ref().map_or(&shade.lighting, |filter| &filter.filtered);
        let caustics = match (&discontinuity, photon_lighting.as_ref().and_then(|photons| photons.caustic.as_ref())) {
            (Some(filter), Some(caustic)) => {
                let slots = plan.eye.pixels * plan.eye.components;
                Some(Caustics::new(kit, caustic, [&shade.lighting, &filter.filtered], slots)?)
            }
            _ => None,
        };
        let path_gain_of =
            match settings.filter.is_some() && !plan.view.has_lens() && !plan.view.has_shutter() && !plan.upsamples() {
                false => None,
                true => Some(kit.vec4s("gain of paths and edges", plan.eye.pixels)?),
            };
        let path_gain = match &path_gain_of {
            Some(path_gain) if plan.eye.components == 2 => {
                let (points, paths) = (&eye.points, &eye.paths);
                let inputs = gain::Inputs { points, paths, raw: &shade.lighting, filtered: lighting, path_gain };
                Some(PathGain::new(kit, &inputs, &eye.ideal_tiles, &eye.planes.region)?)
            }
            _ => None,
        };
        let glossy_light = match plan.eye.lobes && plan.eye.components == 2 {
            false => None,
            true => Some(GlossyLight::new(kit, &eye.points, &eye.paths, lighting, &eye.ideal_tiles)?),
        };
        let discontinuity_lobes = match settings.filter.filter(|_| scene.specular.lobes) {
            None => None,
            Some(filter) => {
                let inputs = (&eye.points, lighting, &eye.ideal_tiles);
                let (components, size) = (plan.eye.components, plan.lit_size());
                Some(DiscontinuityLobes::new(kit, inputs, components, size, (filter, settings.pattern))?)
            }
        };
        let lighting = discontinuity_lobes.as_ref().map_or(lighting, |filter| &filter.filtered);
        let soft_shadow_add = match &soft_shadows {
            None => None,
            Some(SoftShadows { pass, .. }) => {
                let raw = discontinuity.as_ref().map(|_| &shade.lighting);
                let all: Vec<_> = [lighting].into_iter().chain(raw).collect();
                Some(SoftShadowAdd::new(kit, &eye.points, &pass.direct, &all, plan.eye.pixels)?)
            }
        };
        let lamp_edges = match follows {
            false => LampEdges::new(kit, plan, &eye, (lighting, path_gain_of.as_ref()))?,
            true => None,
        };
        let (outliers, unlikely) = match settings.filter.is_some() && plan.eye.components == 2 && !follows {
            false => (None, None),
            true => {
                let inputs = outliers::Inputs {
                    points: &eye.points,
                    paths: &eye.paths,
                    lighting,
                    tiles: &eye.ideal_tiles,
                    region: &eye.planes.region,
                    path_gain: path_gain_of.as_ref(),
                };
                // Third components have joined the second ones.
                let slots = plan.eye.pixels * plan.eye.components;
                (Some(Outliers::new(kit, &inputs, slots)?), Some(Unlikely::new(kit, &inputs, slots)?))
            }
        };
        let summands = match film.as_summands() {
            None => None,
            Some(sums) => Some(Summands::new(kit, &eye.points, &eye.paths, lighting, &film, &sums)?),
        };
        // Second components and mirror images are added to this buffer.
        let shown = summands.as_ref().map_or(&eye.points.emitted, |summands| &summands.reflected);
        let glossy_planes = GlossyPlanes::new(kit, plan, scene.tables(), &eye, lighting, shown)?;
        let merge = match plan.eye.components {
            1 => None,
            _ if follows => None,
            _ => Some(Merge::new(kit, &eye.points, &eye.paths, lighting, &eye.ideal_tiles, shown)?),
        };
        let upsample = Upsample::new(kit, scene, plan, &eye, [lighting, &shade.lighting])?;
        let (of_pixels, seen, shown_light) = match &upsample {
            None => (kit.clone(), eye.seen(), lighting),
            Some(upsample) => (upsample.kit(kit), upsample.seen(), &upsample.lighting),
        };
        let edges = Edges::new(&of_pixels, scene, plan, &seen, (shown_light, path_gain_of.as_ref()))?;
        let gain = match &path_gain_of {
            None => None,
            Some(path_gain) => {
                let (points, paths) = (&eye.points, &eye.paths);
                let inputs = gain::Inputs { points, paths, raw: &shade.lighting, filtered: lighting, path_gain };
                Some(Gain::new(kit, &inputs, &film)?)
            }
        };
        let lens = match plan.view.has_lens() {
            false => None,
            true => {
                let (points, paths, size) = (&eye.points, &eye.paths, plan.view.size());
                Some(Lens::new(kit, &lens::Inputs { points, paths, lighting, size })?)
            }
        };
        let motion_blur = match &velocity {
            None => None,
            Some(Velocity { velocity, .. }) => {
                let (points, paths, size) = (&eye.points, &eye.paths, plan.view.size());
                Some(MotionBlur::new(kit, &motion_blur::Inputs { velocity, points, paths, lighting, size })?)
            }
        };
        let second = summands.as_ref().map(|summands| &summands.reflected);
        let output = Output::new(&of_pixels, seen, shown_light, second, (film, image))?;
        Ok(Frame {
            parameters,
            status,
            shading_rate: settings.shading_rate,
            eye,
            velocity,
            importance,
            walk,
            delta_choice,
            light_lists,
            photons,
            shade,
            soft_shadows,
            kept_light,
            photon_lighting,
            mirror_lights,
            splats,
            compensation,
            near_light,
            third_light,
            discontinuity,
            sparse_windows,
            caustics,
            path_gain,
            glossy_light,
            discontinuity_lobes,
            soft_shadow_add,
            lamp_edges,
            outliers,
            unlikely,
            glossy_planes,
            merge,
            upsample,
            edges,
            gain,
            summands,
            lens,
            motion_blur,
            output,
        })
    }

    /// An empty film and image of the plan's size.
    fn new_film(context: &Context, plan: &Plan) -> Result<(Film, Image)> {
        let [width, height] = plan.view.size();
        let film = Film::new(context, width * height, plan.settings.summands)?;
        Ok((film, Image::new(context, "image", width, height, ash::vk::Format::R32G32B32A32_SFLOAT)?))
    }

    /// Records one pass of the renderer. `paths`: those whose lights a ring holds; none without a ring.
    pub fn record(&self, rec: &mut Recorder, parameters: &layout::FrameParameters, paths: &Paths) -> Result<()> {
        self.record_points(rec, parameters, paths)?;
        self.record_rest(rec, parameters)
    }

    /// Records the part of a pass that shades the points that the eye sees.
    pub fn record_points(&self, rec: &mut Recorder, parameters: &layout::FrameParameters, paths: &Paths) -> Result<()> {
        self.record_light(rec, parameters, paths)?;
        self.near_light.as_ref().map_or(Ok(()), |near| near.run_paths(rec, paths))?;
        self.third_light.run(rec)
    }

    /// [`Frame::record_points`] for the pixels of a task: without what their light gives to those of other classes, for [`Frame::record_taken`].
    pub(crate) fn record_task(
        &self,
        rec: &mut Recorder,
        parameters: &layout::FrameParameters,
        paths: &Paths,
    ) -> Result<()> {
        self.record_light(rec, parameters, paths)?;
        self.near_light.as_ref().map_or(Ok(()), |near| near.run_means(rec, paths))?;
        self.third_light.run(rec)
    }

    /// Records all light of the points but near light.
    fn record_light(&self, rec: &mut Recorder, parameters: &layout::FrameParameters, paths: &Paths) -> Result<()> {
        self.record_start(rec, parameters)?;
        self.eye.run(rec)?;
        self.splats.as_ref().map_or(Ok(()), |splats| splats.record_find(rec))?;
        self.velocity.run(rec)?;
        self.importance.run(rec)?;
        self.walk.run(rec)?;
        self.delta_choice.run(rec)?;
        self.light_lists.run(rec)?;
        self.photons.run(rec)?;
        self.shade.run_paths(rec, paths)?;
        self.soft_shadows.run(rec)?;
        self.kept_light.run(rec)?;
        self.photon_lighting.run(rec)?;
        self.mirror_lights.run(rec)?;
        self.splats.run(rec)?;
        self.compensation.run(rec)
    }

    /// Records the part that makes an image of these points, and adds it to the film.
    fn record_rest(&self, rec: &mut Recorder, parameters: &layout::FrameParameters) -> Result<()> {
        self.caustics.as_ref().map_or(Ok(()), |caustics| caustics.run_take(rec))?;
        self.discontinuity.run(rec)?;
        self.sparse_windows.run(rec)?;
        self.caustics.as_ref().map_or(Ok(()), |caustics| caustics.run_add(rec))?;
        self.path_gain.run(rec)?;
        self.glossy_light.run(rec)?;
        self.discontinuity_lobes.run(rec)?;
        self.soft_shadow_add.run(rec)?;
        self.lamp_edges.run(rec)?;
        self.outliers.run(rec)?;
        self.unlikely.run(rec)?;
        self.glossy_planes.run(rec)?;
        self.merge.run(rec)?;
        self.upsample.run(rec)?;
        self.edges.run(rec)?;
        self.output.record_check(rec)?;
        // The sums have all of a pass or nothing.
        rec.last_part();
        self.gain.run(rec)?;
        self.summands.run(rec)?;
        self.lens.run(rec)?;
        self.motion_blur.run(rec)?;
        self.output.record_accumulate(rec, parameters)
    }

    /// Records a pass whose shaded points are uploaded.
    pub(crate) fn record_taken(
        &self,
        rec: &mut Recorder,
        parameters: &layout::FrameParameters,
        points: &Taken,
    ) -> Result<()> {
        self.record_start(rec, parameters)?;
        if self.glossy_planes.is_none() {
            rec.fill(&self.eye.planes.region, 0)?;
        }
        rec.scope("points", |rec| points.record(rec))?;
        self.near_light.as_ref().map_or(Ok(()), |near| near.run_spread(rec))?;
        self.record_rest(rec, parameters)
    }

    /// The shaded points, as [`Frame::record_points`] leaves them: buffers of 16 bytes for each slot, and of 8 bytes for each pixel.
    pub fn point_buffers(&self) -> [Vec<&Buffer>; 2] {
        let (points, light) = (&self.eye.points, &self.shade.lighting);
        let by_slot = vec![
            &points.position,
            &points.geometric,
            &points.shading,
            &points.kd,
            &points.f0,
            &points.wo,
            &points.emitted,
            &self.eye.paths.throughput,
            &light.direct,
            &light.indirect,
            &light.specular,
        ];
        let guides = self.eye.guides.iter();
        let by_pixel = guides.flat_map(|guides| [&guides.first_hits].into_iter().chain(&guides.second_hits)).collect();
        [by_slot, by_pixel]
    }

    /// Where packed points are unpacked to.
    pub(crate) fn unpacked<'a>(&'a self, packed: &'a Buffer) -> unpack_points::Inputs<'a> {
        let guides = self.eye.guides.as_ref();
        unpack_points::Inputs {
            packed,
            points: &self.eye.points,
            paths: &self.eye.paths,
            lighting: &self.shade.lighting,
            hits: [guides.map(|guides| &guides.first_hits), guides.and_then(|guides| guides.second_hits.as_ref())],
        }
    }

    /// More of the shaded points, of which each pixel has [`MORE_WORDS`]: the reflector that it shows, where that is not 0 what spreads its mirror image
    /// ([`Planes`]), its velocity, the near light that spreads from it and from its second component, direct and indirect, and the caustics that both show; each with the place where
    /// the array begins, bytes. `None`: there is no such array.
    pub(crate) fn more_buffers(&self) -> [Option<(&Buffer, u64)>; MORE] {
        let Planes { region, widening, extras, reprojected } = &self.eye.planes;
        let planes = [region, widening, extras, reprojected].map(|buffer| {
            // Arrays that a scene does not need are minimal.
            Some(buffer).filter(|_| self.glossy_planes.is_some())
        });
        let velocity = self.velocity.as_ref().map(|velocity| &velocity.velocity);
        let pixels = u64::from(self.output.image.width()) * u64::from(self.output.image.height());
        let [a, b, c, d] = planes;
        let means = self.near_light.as_ref().map(|near| near.means()).unwrap_or_default();
        let mean = |k: usize| means.get(k).copied();
        let whole = [a, b, c, d, velocity, mean(0), mean(1)].map(|buffer| Some((buffer?, 0)));
        let second = [mean(0), mean(1)].map(|buffer| Some((buffer?, 16 * pixels)));
        let caustic = self.caustics.as_ref().map(|caustics| &caustics.caustic);
        let caustics = [0, 16 * pixels].map(|at| Some((caustic?, at)));
        let mut all = whole.into_iter().chain(second).chain(caustics);
        std::array::from_fn(|i| {
            let needed = 4 * MORE_WORDS[i] as u64 * pixels;
            all.next().flatten().filter(|(buffer, at)| buffer.bytes() >= at + needed)
        })
    }

    /// Records the parameters of a pass, and clears the counts of its status.
    pub fn record_start(&self, rec: &mut Recorder, parameters: &layout::FrameParameters) -> Result<()> {
        rec.begin();
        let of_lit = parameters.at_rate(self.shading_rate);
        rec.update(&self.parameters, 0, bytemuck::bytes_of(&of_lit))?;
        rec.fill(&self.status, 0)?;
        if let Some(reproject) = &self.eye.reproject {
            reproject.record_start(rec, &of_lit)?;
        }
        self.upsample.as_ref().map_or(Ok(()), |upsample| upsample.record_start(rec, parameters))?;
        self.summands.as_ref().map_or(Ok(()), |summands| summands.record_clear(rec))
    }

    /// Records the particles of splats anew, before a pass; nothing where there are none. `parameters`: those of the first pass.
    pub fn record_particles(&self, rec: &mut Recorder, parameters: &layout::FrameParameters) -> Result<()> {
        rec.begin();
        self.splats
            .as_ref()
            .map_or(Ok(()), |splats| splats.record_particles(rec, &parameters.at_rate(self.shading_rate)))
    }

    /// Records work needed once, after the uploads of a new frame and before its first pass.
    pub fn record_setup(&self, rec: &mut Recorder) -> Result<()> {
        self.glossy_planes.record_setup(rec)?;
        self.gain.as_ref().map_or(Ok(()), |gain| gain.record_clear(rec))?;
        self.lens.record_setup(rec)
    }

    /// Stages changed lights without area; their number and kinds must not have changed.
    pub fn stage_delta(&self, context: &Context, staging: &mut Staging, scene: &DeviceScene) -> Result<()> {
        match &self.delta_choice {
            Some(choice) => {
                let candidates = Candidates::new(&scene.delta, &scene.delta_emitters());
                choice.stage(context, staging, &candidates)
            }
            None => self.walk.stage_delta(context, staging, &scene.delta),
        }
    }

    /// The lists of shading points: those of the eye, then those of each bounce of the compensation or of near light.
    pub fn point_lists(&self) -> impl Iterator<Item = &List> {
        let gathered = self.compensation.iter().flat_map(|c| c.bounces.iter().map(|b| &b.list));
        [&self.eye.list].into_iter().chain(gathered).chain(self.near_light.iter().map(|near| &near.list))
    }

    /// [`layout::PointLight`]s of the pass.
    pub fn lights(&self) -> &Buffer {
        &self.walk.lights
    }
}
