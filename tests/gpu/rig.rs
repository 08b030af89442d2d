//! A scene on the shared device whose frame is recorded stage by stage, and a gallery of everything that stages must
//! handle.

use std::cell::RefCell;
use std::path::Path;
use std::sync::Arc;

use bytemuck::Pod;
use glam::{Vec2, Vec3, Vec4};
use lightsum::accel::{Bvh, Hit, Ray};
use lightsum::device_scene::encode_normal;
use lightsum::engine::Engine;
use lightsum::frame::Frame;
use lightsum::gpu::{Buffer, Context, Recorder, Resources, Staging, download};
use lightsum::pass::clusters::NO_POINT;
use lightsum::pass::eye_paths::Plane;
use lightsum::pass::{Kit, List, ShadingPoints, layout, trace, walk_start};
use lightsum::scene::{
    Alpha, Camera, Environment, Light, Material, Scene, Surface, Texture, TextureUse, Triangle, Wrap,
};
use lightsum::settings::{Settings, Traversal};
use lightsum::stage::{Compensation, Stage};
use lightsum::superposition::kernels::KernelLibrary;

/// Image sizes that reveal off-by-one mistakes: one pixel, part of a workgroup, one workgroup, 2049 pixels, a prime
/// width.
pub const AWKWARD_IMAGES: [[u32; 2]; 5] = [[1, 1], [27, 1], [8, 8], [683, 3], [31, 17]];

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
        let tan = (0.5 * camera.fov_y).to_radians().tan() * (height / width.max(height));
        let camera = Camera { resolution, fov_y: 2.0 * tan.atan().to_degrees(), ..camera };
        let mut engine = Engine::new(ctx, scene, camera, settings).unwrap();
        let parameters = engine.plan().parameters(pass).unwrap();
        ctx.submit_and_wait("setup", None, |rec| {
            engine.record_setup(rec)?;
            engine.frame().record_start(rec, &parameters)
        })
        .unwrap();
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
    pub fn run(&self, record: impl FnOnce(&Frame, &mut Recorder) -> lightsum::Result<()>) {
        self.ctx.submit_and_wait("a stage", None, |rec| record(self.frame(), rec)).unwrap();
    }

    /// Makes one more pass of the frame.
    pub fn make<T>(&self, pass: impl FnOnce(&Kit) -> lightsum::Result<T>) -> T {
        let own = Resources::of([("frame", &self.frame().parameters), ("status", &self.frame().status)]);
        let mut staging = Staging::new();
        let traversal = self.engine.settings().traversal;
        let made = pass(&Kit::new(self.ctx, &mut staging, self.engine.device_scene(), traversal, &own)).unwrap();
        self.run(|_, rec| staging.record(rec));
        made
    }

    /// Fills buffers with a value that no stage writes.
    pub fn prefill(&self, buffers: &[&Buffer]) {
        self.run(|_, rec| buffers.iter().try_for_each(|b| rec.fill(b, crate::support::SENTINEL)));
    }

    pub fn get<T: Pod>(&self, buffer: &Buffer) -> Vec<T> {
        download(self.ctx, buffer).unwrap()
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

    /// Number of the hit's reflector if it is a glossy plane that mirrors the room, else 0.
    pub fn plane(&self, hit: &Hit) -> u32 {
        self.reflector(hit, Surface::Opaque)
    }

    /// Kernels of the glossy planes.
    pub fn library(&self) -> &KernelLibrary {
        &self.engine.device_scene().tables().unwrap().library
    }

    /// The plane of superposition at a hit, seen along `d`.
    pub fn spreading_plane(&self, hit: &Hit, d: Vec3) -> Option<Plane> {
        if self.reflector(hit, Surface::Glass) > 0 {
            return Some(Plane::Frosted);
        }
        let number = self.plane(hit).checked_sub(1)?;
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
pub fn make<T>(ctx: &Context, shared: Resources, pass: impl FnOnce(&Kit) -> lightsum::Result<T>) -> T {
    let mut staging = Staging::new();
    let (uploads, traversal) = (RefCell::new(&mut staging), Traversal::Auto);
    let made =
        pass(&Kit { context: ctx, staging: uploads, shared, textured: false, has_alpha: false, traversal }).unwrap();
    ctx.submit_and_wait("uploads", None, |rec| staging.record(rec)).unwrap();
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
    v.to_array().iter().all(|x| x.to_bits() == crate::support::SENTINEL)
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

/// Whether two vectors agree within `relative` of the larger one, or within `absolute`. NaN agrees with nothing.
pub fn close(a: Vec3, b: Vec3, relative: f32, absolute: f32) -> bool {
    let size = a.abs().max_element().max(b.abs().max_element());
    (a - b).abs().cmple(Vec3::splat(absolute + relative * size)).all()
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

/// Maximum fraction of comparisons that rounding may decide otherwise: at an edge, a horizon, or the threshold of a
/// random choice. On lavapipe none is, on SwiftShader one of 2046 at most.
pub const STRAYS: f64 = 0.001;

/// How much larger than the largest expected value of its kind a found value may be where a comparison fails.
const OUTLIER: f32 = 2.0;

/// Most comparisons that may fail, however many there are.
const MOST: usize = 6;

/// Counts comparisons. One in a thousand may fail where rounding decides (a ray through an edge, a random number at a
/// threshold), of small numbers none. Even there, what was found must be plausible: no NaN, no infinity, no value much
/// larger than all expected ones, no hit off its ray.
pub struct Tally {
    what: String,
    compared: usize,
    failures: Vec<String>,
    /// The largest component of each kind of values that was expected, and that was found where a comparison failed.
    sizes: Vec<[f32; 2]>,
}

impl Tally {
    pub fn new(what: impl Into<String>) -> Tally {
        Tally { what: what.into(), compared: 0, failures: Vec::new(), sizes: Vec::new() }
    }

    pub fn check(&mut self, holds: bool, say: impl FnOnce() -> String) {
        self.compared += 1;
        if !holds {
            self.failures.push(say());
        }
    }

    /// Like [`Tally::check`], for pairs of a found and an expected value, whose place tells their kind: found values
    /// stay plausible whether or not the comparison holds.
    pub fn check_values(&mut self, holds: bool, values: &[(Vec3, Vec3)], say: impl FnOnce() -> String) {
        let kinds = self.sizes.len().max(values.len());
        self.sizes.resize(kinds, [0.0; 2]);
        for ([largest, outlier], (found, expected)) in self.sizes.iter_mut().zip(values) {
            *largest = largest.max(expected.abs().max_element());
            if !holds {
                assert!(found.is_finite(), "{}: {}", self.what, say());
                *outlier = outlier.max(found.abs().max_element());
            }
        }
        self.check(holds, say);
    }

    /// Compares the hit of a ray with the closest one. A hit that differs lies on the ray and in its triangle.
    pub fn check_hit(&mut self, rig: &Rig, ray: &Ray, hit: Option<Hit>, say: impl FnOnce() -> String) {
        let bvh = rig.bvh();
        let holds = same_hit(hit, trace::reference(rig.scene, bvh, ray, rig.parameters.keys[0]));
        if !holds && let Some(hit) = hit {
            let off = (bvh.position(&hit) - ray.origin - ray.direction * hit.t).length();
            let inside = hit.u >= -1e-3 && hit.v >= -1e-3 && hit.u + hit.v <= 1.0 + 2e-3;
            let reached = hit.t >= 0.0 && hit.t <= ray.t_max && off <= 1e-3 * bvh.diagonal();
            assert!(inside && reached, "{}: {hit:?} is off its ray by {off}: {}", self.what, say());
        }
        self.check(holds, say);
    }

    /// Fails if more than the fraction `share` of the comparisons failed, or one of them by too much.
    pub fn finish(self, share: f64) {
        let (failed, allowed) = (self.failures.len(), ((self.compared as f64 * share) as usize).min(MOST));
        if failed > 0 {
            println!("{}: {failed} of {} differ", self.what, self.compared);
        }
        let is_wild =
            |words: &&String| words.split(|c: char| !c.is_alphanumeric()).any(|word| matches!(word, "NaN" | "inf"));
        if let Some(failure) = self.failures.iter().find(is_wild) {
            panic!("{}: {failure}", self.what);
        }
        let shown = self.failures[..failed.min(5)].join("\n");
        assert!(failed <= allowed, "{}: {failed} of {} differ, {allowed} may:\n{shown}", self.what, self.compared);
        for (kind, [largest, outlier]) in self.sizes.iter().enumerate() {
            assert!(
                *outlier <= OUTLIER * largest,
                "{}: value {kind} reaches {outlier}, {largest} at most is expected:\n{shown}",
                self.what
            );
        }
    }
}

/// A generator of reproducible numbers in [0, 1).
pub struct Numbers(pub u32);

impl Numbers {
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(1);
        lightsum::sampling::random::random_f32(self.0)
    }

    pub fn vec3(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next())
    }
}

/// Unit vector of an octahedral code of 2 x 16 bit (Meyer et al. 2010).
fn decode_normal(code: u32) -> Vec3 {
    let snorm = |x: u32| f32::from(x as u16 as i16) / 32767.0;
    let (x, y) = (snorm(code), snorm(code >> 16));
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize()
}

/// Builds scenes.
#[derive(Default)]
pub struct Builder(pub Scene);

impl Builder {
    pub fn material(&mut self, material: Material) -> u32 {
        self.0.materials.push(material);
        self.0.materials.len() as u32 - 1
    }

    pub fn object(&mut self) -> u32 {
        self.0.objects.push(format!("object {}", self.0.objects.len()));
        self.0.objects.len() as u32 - 1
    }

    fn face(&mut self, corners: [(Vec3, Vec3, Vec2); 3], material: u32, object: u32, smooth: bool) {
        let first = self.0.positions.len() as u32;
        for (position, normal, uv) in corners {
            self.0.positions.push(position);
            // Normals that their codes represent exactly, so that only the arithmetic is compared.
            let stored = decode_normal(encode_normal(normal.normalize()));
            assert!((stored - normal.normalize()).length() < 1e-4, "{normal} is stored as {stored}");
            self.0.normals.push(stored);
            self.0.uvs.push(uv);
        }
        self.0.triangles.push(Triangle { vertices: [first, first + 1, first + 2], material, object, smooth });
    }

    pub fn triangle(&mut self, [a, b, c]: [Vec3; 3], material: u32) {
        let object = self.object();
        let n = (b - a).cross(c - a);
        self.face([(a, n, Vec2::ZERO), (b, n, Vec2::X), (c, n, Vec2::Y)], material, object, false);
    }

    /// A parallelogram with texture coordinates from -`uv` to 2 `uv`, seen from the side of cross(u, v).
    pub fn quad(&mut self, corner: Vec3, u: Vec3, v: Vec3, material: u32, uv: f32) {
        let object = self.object();
        let n = u.cross(v);
        let point = |s: f32, t: f32| (corner + u * s + v * t, n, Vec2::new((3.0 * s - 1.0) * uv, (3.0 * t - 1.0) * uv));
        self.face([point(0.0, 0.0), point(1.0, 0.0), point(1.0, 1.0)], material, object, false);
        self.face([point(0.0, 0.0), point(1.0, 1.0), point(0.0, 1.0)], material, object, false);
    }

    /// A sphere of 8 * 4^levels smooth triangles; returns its object.
    pub fn sphere(&mut self, center: Vec3, radius: f32, levels: u32, material: u32, inward: bool) -> u32 {
        let object = self.object();
        for octant in 0..8 {
            let sign = |bit: u32| if octant >> bit & 1 == 0 { 1.0 } else { -1.0 };
            let mut faces = vec![[Vec3::X * sign(0), Vec3::Y * sign(1), Vec3::Z * sign(2)]];
            for _ in 0..levels {
                faces = (faces.iter())
                    .flat_map(|&[a, b, c]| {
                        let (ab, bc, ca) = ((a + b).normalize(), (b + c).normalize(), (c + a).normalize());
                        [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
                    })
                    .collect();
            }
            for [a, mut b, mut c] in faces {
                if ((b - a).cross(c - a).dot(a) < 0.0) != inward {
                    std::mem::swap(&mut b, &mut c);
                }
                let corner = |n: Vec3| (center + n * radius, if inward { -n } else { n }, Vec2::new(n.x, n.y));
                self.face([corner(a), corner(b), corner(c)], material, object, true);
            }
        }
        object
    }

    pub fn texture(&mut self, srgb: bool, wrap: [Wrap; 2]) -> u32 {
        let (width, height) = (4, 3);
        let texels = (0..width * height).map(|i| [40 + 17 * i as u8, 250 - 15 * i as u8, 90 + 60 * (i as u8 % 3), 255]);
        let name = format!("texture {}", self.0.textures.len());
        self.0.textures.push(Texture { name, width, height, texels: texels.collect(), srgb, wrap });
        self.0.textures.len() as u32 - 1
    }

    pub fn finish(mut self, eye: Vec3, target: Vec3) -> Scene {
        let (up, resolution) = (Vec3::Y, [8, 8]);
        self.0.camera = Some(Camera { eye, target, up, fov_y: 75.0, resolution, aperture: 0.0, focus: None });
        self.0.validate(Path::new("test scene")).unwrap();
        self.0
    }
}

/// Lights of every kind that a scene lists besides its emissive faces.
fn listed_lights(b: &mut Builder, glow: u32) {
    let object = b.sphere(Vec3::new(-1.2, 0.5, 1.0), 0.25, 1, glow, false);
    let center = Vec3::new(-1.2, 0.5, 1.0);
    let radiance = Vec3::new(2.0, 1.0, 0.5);
    b.0.lights.push(Light::Sphere { center, radius: 0.25, radiance, inward: false, object });
    b.0.lights.push(Light::Point { position: Vec3::new(0.4, 1.1, -0.6), intensity: Vec3::new(0.3, 0.5, 0.2) });
    b.0.lights.push(Light::Spot {
        position: Vec3::new(1.2, 1.8, 0.2),
        direction: Vec3::new(-0.3, -1.0, 0.2).normalize(),
        intensity: Vec3::new(1.5, 1.2, 1.0),
        inner: 0.3,
        outer: 0.8,
    });
    b.0.lights.push(Light::Directional {
        direction: Vec3::new(0.2, -0.6, 1.0).normalize(),
        irradiance: Vec3::new(0.2, 0.3, 0.4),
    });
    b.0.lights.push(Light::Imported {
        position: Vec3::new(-1.9, 0.3, -0.5),
        normal: Vec3::X,
        power: Vec3::new(0.8, 0.3, 0.1),
    });
    // A closed glowing sphere behind the room: only particles that start in it see it.
    let center = Vec3::new(9.0, 0.0, 0.0);
    let object = b.sphere(center, 0.5, 1, glow, true);
    b.0.lights.push(Light::Sphere { center, radius: 0.5, radiance: Vec3::splat(0.3), inward: true, object });
}

/// Light from all around for a gallery: a sky with a sun, a darker ground, and black towards +x.
pub fn surroundings() -> Environment {
    let texel = |i: u32| match (i % 16, i / 16) {
        (5, 2) => Vec3::new(80.0, 70.0, 60.0),
        (11..14, _) => Vec3::ZERO,
        (x, y @ 0..4) => Vec3::new(0.2 + 0.02 * x as f32, 0.5, 0.3 + 0.1 * y as f32),
        _ => Vec3::splat(0.1),
    };
    let texels = (0..128).map(texel).collect();
    Environment { width: 16, height: 8, texels, ..Environment::constant(Vec3::ONE) }
        .turned(Vec3::new(0.1, 1.0, -0.2), 0.4)
}

/// The gallery under [`surroundings`].
pub fn gallery_outdoors() -> Scene {
    Scene { environment: Some(Arc::new(surroundings())), ..gallery() }
}

/// A room four units wide, open at the camera and in a corner, with every kind of material, texture and light.
pub fn gallery() -> Scene {
    gallery_and(|_| ())
}

/// The gallery with surfaces that let rays pass: leaves, a curtain, veils one behind another, and half a mirror.
pub fn gallery_with_alpha() -> Scene {
    gallery_and(|b| {
        let pattern = b.texture(true, [Wrap::Repeat, Wrap::Mirror]);
        for (i, texel) in b.0.textures[pattern as usize].texels.iter_mut().enumerate() {
            texel[3] = [0, 255, 100, 200, 30][i % 5];
        }
        let base_texture = Some(pattern);
        let mask = Alpha::Mask { opacity: 0.9, cutoff: 0.4 };
        let leaf = b.material(Material { base_texture, alpha: mask, ..Material::default() });
        let curtain = Alpha::Blend { opacity: 0.7 };
        let curtain = b.material(Material {
            base_texture,
            alpha: curtain,
            roughness: 0.4,
            specular: Vec3::splat(0.1),
            ..Material::default()
        });
        let veil = b.material(Material { alpha: Alpha::Blend { opacity: 0.3 }, ..Material::default() });
        let half = Alpha::Blend { opacity: 0.5 };
        let half_mirror = b.material(Material {
            surface: Surface::Mirror,
            specular: Vec3::splat(0.8),
            alpha: half,
            ..Material::default()
        });
        let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
        b.quad(Vec3::new(-1.6, 0.2, -0.4), x * 1.3 + z * 0.2, y * 1.2, leaf, 2.3);
        b.quad(Vec3::new(0.3, 0.3, -0.7), x * 1.1, y * 1.1 + z * 0.1, curtain, 1.6);
        for k in 0..3 {
            b.quad(Vec3::new(-0.6, 0.9, -0.9 + 0.2 * k as f32), x * 1.2, y * 0.7, veil, 1.0);
        }
        b.quad(Vec3::new(-0.47, 0.04, -0.31), x * 0.9, y * 0.6, half_mirror, 1.0);
    })
}

fn gallery_and(more: impl FnOnce(&mut Builder)) -> Scene {
    let mut b = Builder::default();
    let plain = Material::default;
    let rgb = Vec3::new;
    let repeat = b.texture(true, [Wrap::Repeat, Wrap::Mirror]);
    let clamp = b.texture(false, [Wrap::Clamp, Wrap::Repeat]);
    let mirrored = b.texture(true, [Wrap::Mirror, Wrap::Clamp]);
    let rough = b.texture(false, [Wrap::Repeat, Wrap::Repeat]);
    let gray = b.material(Material { base_color: rgb(0.7, 0.6, 0.5), ..plain() });
    let tiles = b.material(Material { base_color: rgb(0.9, 0.8, 0.7), base_texture: Some(repeat), ..plain() });
    let bumps = b.texture(false, [Wrap::Repeat, Wrap::Mirror]);
    for (i, texel) in b.0.textures[bumps as usize].texels.iter_mut().enumerate() {
        *texel = [128 + 25 * (i % 3) as u8, 168 - 20 * (i / 3) as u8, 235, 255];
    }
    let second_uvs = |of: TextureUse| [0, 1, 2, 3].map(|k| k == of as usize);
    let cloth = b.material(Material {
        base_texture: Some(clamp),
        normal_texture: Some(bumps),
        normal_scale: 0.8,
        second_uvs: second_uvs(TextureUse::Normal),
        ..plain()
    });
    let paint =
        b.material(Material { base_texture: Some(mirrored), specular: Vec3::splat(0.04), roughness: 0.5, ..plain() });
    let metal = b.material(Material {
        base_color: rgb(0.9, 0.7, 0.4),
        metallic: 0.9,
        roughness: 0.8,
        metallic_roughness_texture: Some(rough),
        second_uvs: second_uvs(TextureUse::MetallicRoughness),
        specular: Vec3::splat(0.04),
        ..plain()
    });
    let gloss = b.material(Material { specular: rgb(0.2, 0.1, 0.05), roughness: 0.3, ..plain() });
    let mirror = |base_color: Vec3, specular: Vec3| Material {
        surface: Surface::Mirror,
        base_color,
        specular,
        emission: rgb(0.0, 0.02, 0.01),
        two_sided: true,
        ..plain()
    };
    let silver = b.material(mirror(Vec3::ZERO, rgb(0.9, 0.8, 0.7)));
    let varnish = b.material(Material { base_texture: Some(repeat), ..mirror(rgb(0.7, 0.5, 0.3), Vec3::splat(0.2)) });
    let glass = |ior: f32, thin: bool| Material {
        surface: Surface::Glass,
        base_color: rgb(0.8, 0.9, 1.0),
        emission: rgb(0.01, 0.0, 0.02),
        ior,
        thin,
        ..plain()
    };
    let pane = b.material(glass(1.5, true));
    let crystal = b.material(glass(1.7, false));
    let water = b.material(glass(1.33, false));
    let lamp = b.material(Material { emission: rgb(3.0, 2.5, 2.0), base_color: Vec3::ZERO, ..plain() });
    let sheet = b.material(Material { emission: rgb(0.4, 0.6, 0.8), two_sided: true, ..plain() });
    // Lights behind stained glass, half of it black.
    let stained = b.texture(true, [Wrap::Repeat, Wrap::Mirror]);
    for (i, texel) in b.0.textures[stained as usize].texels.iter_mut().enumerate() {
        *texel = if i % 2 == 0 { [0, 0, 0, 255] } else { [60 + 19 * (i as u8 % 7), 200, 255 - 20 * i as u8, 255] };
    }
    let window = b.material(Material {
        emission: rgb(1.5, 1.2, 2.0),
        emission_texture: Some(stained),
        base_texture: Some(repeat),
        ..plain()
    });
    let banner = b.material(Material {
        emission: rgb(0.5, 0.9, 0.4),
        emission_texture: Some(stained),
        second_uvs: second_uvs(TextureUse::Emission),
        two_sided: true,
        ..plain()
    });
    let glow = b.material(Material { emission: rgb(2.0, 1.0, 0.5), base_color: Vec3::ZERO, ..plain() });

    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    b.quad(rgb(-2.0, 0.0, -2.0), z * 4.0, x * 4.0, tiles, 1.7);
    b.quad(rgb(-2.0, 2.2, -2.0), x * 4.0, z * 4.0, gray, 1.0);
    b.quad(rgb(-2.0, 0.0, 2.0), y * 2.2, x * 4.0, cloth, 0.9);
    // The wall on the left ends before the corner: rays past it hit nothing.
    b.quad(rgb(-2.0, 0.0, -2.0), y * 2.2, z * 2.6, paint, 1.3);
    b.quad(rgb(2.0, 0.0, -2.0), z * 4.0, y * 2.2, metal, 0.8);
    b.sphere(rgb(0.6, 0.5, 0.9), 0.5, 2, gloss, false);
    b.sphere(rgb(-0.3, 0.3, 0.2), 0.3, 2, metal, false);
    b.quad(rgb(-1.5, 0.6, 1.9), y * 0.8, x * 0.8, silver, 1.0);
    b.quad(rgb(-0.6, 1.2, 1.9), y * 0.7, x * 0.9, varnish, 1.0);
    b.quad(rgb(1.0, 0.8, 1.8), y * 0.8, x * 0.5, pane, 1.0);
    // One ball of glass partly inside another.
    b.sphere(rgb(-0.9, 1.4, 0.4), 0.35, 2, water, false);
    b.sphere(rgb(-0.8, 1.45, 0.15), 0.2, 2, crystal, false);
    b.quad(rgb(-0.5, 2.15, -0.5), x, z * 0.8, lamp, 1.0);
    b.triangle([rgb(1.2, 2.1, 1.0), rgb(1.8, 2.1, 1.0), rgb(1.5, 2.1, 1.6)], lamp);
    b.triangle([rgb(-1.0, 2.0, 1.2), rgb(-0.6, 1.7, 1.5), rgb(-1.1, 1.5, 1.4)], sheet);
    b.quad(rgb(1.95, 1.2, -0.2), z, y * 0.7, window, 2.0);
    b.triangle([rgb(0.4, 2.0, -0.4), rgb(0.9, 1.8, -0.2), rgb(0.6, 1.5, -0.3)], banner);
    listed_lights(&mut b, glow);
    more(&mut b);
    // Codes of colours are exact for these.
    let color = |i: usize| Vec3::from_array([i % 3, i % 5, i % 7].map(|k| ((1023 - 60 * k) as f32 / 1023.0).powi(2)));
    b.0.second_uvs = b.0.uvs.iter().map(|uv| Vec2::new(0.3 - uv.y, 1.7 * uv.x + 0.1)).collect();
    b.0.colors = (0..b.0.positions.len()).map(color).collect();
    b.finish(rgb(0.1, 1.2, -2.6), rgb(0.0, 0.9, 1.0))
}
