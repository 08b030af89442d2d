//! A scene on the shared device whose frame is recorded stage by stage.

use std::cell::RefCell;
use std::rc::Rc;

use super::Must;
use crate::accel::{Bvh, Hit, Ray};
use crate::bsdf::anisotropic::unpack;
use crate::engine::Engine;
use crate::frame::Frame;
use crate::gpu::{Buffer, Context, Image, Memory, Recorder, Resources, Staging, download};
use crate::pass::clusters::NO_POINT;
use crate::pass::curvature::bend_at;
use crate::pass::eye_paths::Plane;
use crate::pass::layout::PointLight;
use crate::pass::{Kit, List, ShadingPoints, layout, light_lists, walk_start};
use crate::scene::{Camera, Scene, Surface};
use crate::settings::{Settings, Traversal};
use crate::stage::{Compensation, Stage};
use crate::superposition::kernels::KernelLibrary;
use bytemuck::Pod;
use glam::{Vec3, Vec4};

pub use super::gallery::{
    Builder, gallery, gallery_outdoors, gallery_with_alpha, gallery_with_few_emitters, gallery_with_tables,
    orthographic,
};
pub use super::tally::{STRAYS, Tally, close};

/// A scene whose stages run one by one.
pub struct Rig<'a> {
    pub ctx: &'a Context,
    pub scene: &'a Scene,
    pub engine: Engine,
    pub parameters: layout::FrameParameters,
}

impl<'a> Rig<'a> {
    /// Sets up the scene for its first pass, with parameters written and counters cleared.
    pub fn new(ctx: &'a Context, scene: &'a Scene, resolution: [u32; 2], settings: Settings) -> Rig<'a> {
        Rig::at_pass(ctx, scene, resolution, settings, 0)
    }

    /// Likewise for another pass.
    pub fn at_pass(ctx: &'a Context, scene: &'a Scene, resolution: [u32; 2], settings: Settings, pass: u32) -> Rig<'a> {
        let camera = scene.camera.unwrap();
        // The scene's angle of view, but along the longer side: a narrow image would see hardly anything with it.
        let [width, height] = resolution.map(|n| n as f32);
        let along = height / width.max(height);
        let tan = (0.5 * camera.fov_y).to_radians().tan() * along;
        let whole = camera.height.map(|height| height * along);
        let camera = Camera { resolution, fov_y: 2.0 * tan.atan().to_degrees(), height: whole, ..camera };
        let mut engine = Engine::new(ctx, scene, camera, settings).must();
        let parameters = engine.plan().parameters(pass).must();
        ctx.submit_and_wait("setup", None, |rec| {
            engine.record_setup(rec)?;
            engine.frame().record_start(rec, &parameters)
        })
        .must();
        engine.setup_finished();
        Rig { ctx, scene, engine, parameters }
    }

    pub fn frame(&self) -> &Frame {
        self.engine.frame()
    }

    /// The stage that restores the light that clipping removed.
    pub fn compensation(&self) -> &Compensation {
        self.frame().compensation.as_ref().unwrap()
    }

    /// Runs the walk and the eye stage.
    pub fn walk_and_look(&self) {
        self.run(|frame, rec| {
            frame.walk.record(rec)?;
            frame.eye.record(rec)
        });
    }

    /// Runs the walk, the eye stage and shading.
    pub fn light(&self) {
        self.walk_and_look();
        self.run(|frame, rec| frame.shade.record(rec));
    }

    pub fn bvh(&self) -> &Bvh {
        self.engine.bvh()
    }

    /// Runs commands of the frame.
    pub fn run(&self, record: impl FnOnce(&Frame, &mut Recorder) -> crate::Result<()>) {
        self.ctx.submit_and_wait("a stage", None, |rec| record(self.frame(), rec)).must();
    }

    /// Makes one more pass of the frame.
    pub fn make<T>(&self, pass: impl FnOnce(&Kit) -> crate::Result<T>) -> T {
        let own = Resources::of([("frame", &self.frame().parameters), ("status", &self.frame().status)]);
        let mut staging = Staging::new();
        let traversal = self.engine.settings().traversal;
        let made = pass(&Kit::new(self.ctx, &mut staging, self.engine.device_scene(), traversal, &own)).must();
        self.run(|_, rec| staging.record(rec));
        made
    }

    /// Fills buffers with a value that no stage writes.
    pub fn prefill(&self, buffers: &[&Buffer]) {
        self.run(|_, rec| buffers.iter().try_for_each(|b| rec.fill(b, super::SENTINEL)));
    }

    pub fn get<T: Pod>(&self, buffer: &Buffer) -> Vec<T> {
        download(self.ctx, buffer).must()
    }

    /// Texels of an image, row by row.
    pub fn texels<T: Pod>(&self, image: &Image) -> Vec<T> {
        let buffer = Buffer::new(self.ctx, "texels", image.bytes(), Memory::Device).must();
        self.run(|_, rec| rec.copy_image_to_buffer(image, &buffer));
        self.get(&buffer)
    }

    /// The lights of all lists; entries that nobody wrote hold dark ones.
    pub fn listed_lights(&self) -> Vec<PointLight> {
        let lists = &self.frame().light_lists;
        let lights: Vec<PointLight> = self.get(&lists.lights);
        let light = |entry: [u32; 2]| match lights.get(entry[0] as usize) {
            Some(_) => light_lists::listed_light(&lights, entry),
            None => PointLight::default(),
        };
        self.get(&lists.listed).into_iter().map(light).collect()
    }

    pub fn vec4s(&self, buffer: &Buffer) -> Vec<Vec4> {
        self.get(buffer)
    }

    pub fn work(&self, bounce: usize) -> layout::DispatchCounts {
        self.get(&self.frame().point_lists().nth(bounce).unwrap().work)[0]
    }

    /// The shading points on the list of a bounce, sorted.
    pub fn list(&self, bounce: usize) -> Vec<u32> {
        if bounce > 0 || self.frame().eye.clusters.is_none() {
            return self.sorted(self.frame().point_lists().nth(bounce).unwrap());
        }
        // Lists in screen order have gaps.
        let work = self.work(0);
        let mut slots: Vec<u32> = self.get(&self.frame().eye.list.entries);
        slots.truncate(work.total as usize);
        slots.retain(|&slot| slot != NO_POINT);
        assert_eq!(slots.len(), work.live as usize, "receivers on the list");
        slots.sort_unstable();
        slots
    }

    /// The slots whose paths continued in a step of the eye paths, sorted.
    pub fn eye_list(&self, step: usize) -> Vec<u32> {
        self.sorted(&self.frame().eye.lists[step])
    }

    /// Pixels in tiles that show mirrors or glass, after the first step of the eye paths; in order.
    pub fn ideal_pixels(&self) -> Vec<u32> {
        let [width, height, ..] = self.parameters.size;
        let tiles = self.sorted(&self.frame().eye.ideal_tiles);
        let of_tile = |pixel: u32| pixel % width / 8 + pixel / width / 8 * width.div_ceil(8);
        (0..width * height).filter(|&pixel| tiles.binary_search(&of_tile(pixel)).is_ok()).collect()
    }

    /// The entries of a list without gaps, sorted.
    pub fn sorted(&self, list: &List) -> Vec<u32> {
        let live = self.get::<layout::DispatchCounts>(&list.work)[0].live;
        let mut slots: Vec<u32> = self.get(&list.entries);
        slots.truncate(live as usize);
        slots.sort_unstable();
        slots
    }

    /// Number of the hit's reflector if it is a glossy plane or frosted pane of superposition, else 0.
    fn reflector(&self, hit: &Hit, kind: Surface) -> u32 {
        let triangle = self.bvh().scene_triangle(hit.triangle);
        let material = self.scene.triangles[triangle as usize].material;
        let reflectors = &self.engine.device_scene().reflectors;
        let number = reflectors.iter().position(|r| r.triangles.contains(&triangle)).map_or(0, |i| i as u32 + 1);
        let counts = self.scene.materials[material as usize].surface == kind;
        if counts && number <= self.engine.plan().settings.mirroring_planes() { number } else { 0 }
    }

    /// Number of the hit's reflector if it is a glossy plane or curved surface that mirrors the room, else 0.
    pub fn plane(&self, hit: &Hit) -> u32 {
        self.reflector(hit, Surface::Opaque)
    }

    /// Kernels of the glossy planes.
    pub fn library(&self) -> &KernelLibrary {
        &self.engine.device_scene().tables().unwrap().library
    }

    /// The plane, or curved surface, of superposition at a hit of an eye ray along `d`.
    pub fn spreading_plane(&self, hit: &Hit, d: Vec3) -> Option<Plane> {
        if self.reflector(hit, Surface::Glass) > 0 {
            return Some(Plane::Frosted);
        }
        let number = self.plane(hit).checked_sub(1)?;
        if self.engine.device_scene().reflectors[number as usize].curved {
            let bend = bend_at(self.scene, self.bvh(), hit, d, xyz(self.parameters.right));
            return bend.mild.then_some(Plane::Curved { normal: bend.normal });
        }
        let mu = self.bvh().normal(hit.triangle).dot(d).abs();
        let lobe = self.library().look_up(number, mu)?;
        Some(Plane::Glossy { energy: lobe.energy, grazing: lobe.grazing })
    }

    /// Whether a region (the number of a reflector) is a frosted pane.
    pub fn is_pane(&self, region: u32) -> bool {
        region > 0 && self.engine.device_scene().reflectors[region as usize - 1].pane
    }

    /// Rays lost so far.
    pub fn lost(&self) -> u32 {
        self.get::<u32>(&self.frame().status)[0]
    }
}

/// Makes a pass that shares these resources with no other pass, and has no scene.
pub fn make<T>(ctx: &Context, shared: Resources, pass: impl FnOnce(&Kit) -> crate::Result<T>) -> T {
    let mut staging = Staging::new();
    let (uploads, traversal) = (Rc::new(RefCell::new(&mut staging)), Traversal::Auto);
    let made = pass(&Kit {
        context: ctx,
        staging: uploads,
        shared,
        textured: false,
        has_alpha: false,
        tables: false,
        traversal,
    })
    .must();
    ctx.submit_and_wait("uploads", None, |rec| staging.record(rec)).must();
    made
}

/// Tolerance for a device's sine and cosine: Vulkan permits 2^-11. SwiftShader comes close to it, lavapipe does not.
pub const SINE: f32 = 5e-4;

/// Maximum difference of the directions in which particles start from the lights of a scene from the oracle's: the
/// error of the device's sine and cosine, the only inexact operations in them besides roots.
pub fn sine_error(ctx: &Context, scene: &Scene) -> f32 {
    let rig = Rig::new(ctx, scene, [1, 1], Settings { particles: 2049, ..Settings::plain() });
    rig.run(|frame, rec| frame.walk.record_start(rec));
    let directions = rig.vec4s(&rig.frame().walk.particles.direction);
    let error = |i: usize| {
        let (_, ray, _) =
            walk_start::reference(&rig.parameters, (rig.engine.emitters(), &rig.scene.textures), i as u32);
        (directions[i].truncate() - ray.direction).length()
    };
    let worst = (0..directions.len()).map(error).fold(1e-6, f32::max);
    assert!(worst < SINE, "sines and cosines are off by {worst}");
    worst
}

/// Whether two alphas stand for one lobe, plain ones within a tolerance; of two widths the numbers of both may be one step apart.
pub fn same_lobe(a: f32, b: f32, tolerance: f32) -> bool {
    match [a, b].map(|alpha| unpack(alpha, Vec3::Z)) {
        [Some(a), Some(b)] => {
            ((a.alphas - b.alphas) / b.alphas).abs().max_element() < 0.015 && a.along.cross(b.along).length() < 2e-3
        }
        _ => (a - b).abs() <= tolerance,
    }
}

/// Whether a point has a flag, by its `wo`.
pub fn has(wo: Vec4, flag: u32) -> bool {
    ShadingPoints::flags(wo.w) & flag != 0
}

/// Whether a point is lit, by its `wo`.
pub fn is_lit(wo: Vec4) -> bool {
    has(wo, ShadingPoints::LIT)
}

/// Whether nothing was written here since [`Rig::prefill`].
pub fn untouched(v: Vec4) -> bool {
    v.to_array().iter().all(|x| x.to_bits() == super::SENTINEL)
}

pub fn xyz(a: [f32; 4]) -> Vec3 {
    Vec3::new(a[0], a[1], a[2])
}

/// The hit that `trace` wrote.
pub fn hit_of(v: Vec4) -> Option<Hit> {
    let triangle = v.w.to_bits();
    (triangle != u32::MAX).then_some(Hit { t: v.x, u: v.y, v: v.z, triangle })
}

/// The ray that a stage wrote.
pub fn ray_of(origin: Vec4, direction: Vec4) -> Ray {
    Ray { origin: origin.truncate(), t_max: origin.w, direction: direction.truncate() }
}

/// Whether two hits are on one triangle at one point, or on two at one distance (an edge, coincident faces).
pub fn same_hit(a: Option<Hit>, b: Option<Hit>) -> bool {
    match (a, b) {
        (None, None) => true,
        (Some(a), Some(b)) => {
            let distance = (a.t - b.t).abs() <= 1e-4 * a.t.max(b.t);
            let place = (a.u - b.u).abs().max((a.v - b.v).abs()) <= 1e-3;
            distance && (a.triangle != b.triangle || place)
        }
        _ => false,
    }
}
