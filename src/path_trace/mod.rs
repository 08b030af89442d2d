//! Path tracer on the CPU: the ground truth for tests and `--reference`.
//!
//! Paths start at the eye. At each point one emitter is chosen in proportion to its power and a point on it sampled by area;
//! the path continues by sampling the reflectance. The power heuristic weights the two strategies
//! (Veach and Guibas 1995). There is no Russian roulette: paths end after a given number of segments, so that
//! the expectation is the same truncated series that instant radiosity sums.
//!
//! Paths follow mirrors and glass by [`bsdf::ideal`](crate::bsdf::ideal), one component at random, as far as
//! [`SpecularPaths`] allows; frosted panes scatter transmitted light everywhere. Mirrors and glass on the way from the eye do not
//! count as segments; they have their own limit.

mod shutter;
mod surface;

pub use shutter::render_open;
pub use surface::PathVertex;

use crate::accel::{Bvh, Hit, Ray, offset_origin};
use crate::bsdf::Reflectance;
use crate::bsdf::ideal::{BsdfSample, Media, frost, specular_samples};
use crate::error::{Error, Result};
use crate::light::cosine;
use crate::light::emitters::{Emitter, Emitters, Kind, NO_EMITTER};
use crate::pass::finite;
use crate::sampling::dimensions::PIXEL;
use crate::sampling::random::{hash, key, random_f32};
use crate::scene::{Camera, Scene};
use crate::settings;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Options of the path tracer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Width and height in pixels; overrides the camera's.
    pub resolution: [u32; 2],
    /// Samples per pixel.
    pub samples: u32,
    /// Maximum number of segments of a path: 1 emitters seen directly, 2 direct light, 5 three further reflections. Mirrors
    /// and glass on the way from the eye do not count.
    pub max_depth: u32,
    /// Maximum number of consecutive mirrors and glass surfaces on an eye path.
    pub max_specular: u32,
    /// Seed; the same one gives the same bits.
    pub seed: u64,
    /// Paths that follow mirrors and glass.
    pub specular_paths: SpecularPaths,
    /// Reflectance of mirrors.
    pub reflectance: settings::Reflectance,
}

/// Paths that follow mirrors and glass; for other paths mirrors reflect only by their diffuse base, and glass is black.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpecularPaths {
    /// None.
    None,
    /// From the eye to the first other surface.
    Eye,
    /// As the renderer without photons and mirrored lights: from the eye to the first other surface, and beyond the second.
    VirtualLights,
    /// All paths. After the first other surface mirrors and glass count as segments.
    All,
}

impl Options {
    fn validate(&self) -> Result<()> {
        let [width, height] = self.resolution;
        let checks = [
            ("--resolution", width.min(height), "needs at least one pixel each way"),
            ("--passes", self.samples, "needs at least one sample for each pixel"),
            ("--max-depth", self.max_depth, "needs at least one segment"),
        ];
        match checks.iter().find(|(_, value, _)| *value == 0) {
            Some(&(name, _, message)) => Err(Error::Setting { name, message: message.to_string() }),
            None => Ok(()),
        }
    }
}

/// Random numbers of one path: hashes of pixel and running number.
#[derive(Clone, Copy, Debug)]
pub struct Rng {
    seed: u32,
    pixel: u32,
    counter: u32,
}

impl Rng {
    /// Numbers reserved for one path.
    const STRIDE: u32 = 256;

    /// The numbers of a sample in a pixel.
    pub fn new(seed: u64, pixel: u32, sample: u32) -> Rng {
        Rng { seed: (seed as u32) ^ hash((seed >> 32) as u32), pixel, counter: sample.wrapping_mul(Self::STRIDE) }
    }

    /// The next number in [0, 1).
    pub fn next_f32(&mut self) -> f32 {
        let number = random_f32(key(self.seed, PIXEL, self.pixel, self.counter));
        self.counter = self.counter.wrapping_add(1);
        number
    }

    fn pair(&mut self) -> [f32; 2] {
        [self.next_f32(), self.next_f32()]
    }
}

/// The ray of a pinhole or an orthographic camera through a point of the image, in pixels from the upper left corner; its direction is of
/// unit length.
pub fn eye_ray(camera: &Camera, resolution: [u32; 2], x: f32, y: f32) -> Ray {
    let [width, height] = resolution.map(|n| n as f32);
    let (right, up, forward) = camera.world_from_camera();
    let half_extents = Camera { resolution, ..*camera }.half_extents();
    let across = (2.0 * x / width - 1.0 + camera.shift()[0]) * half_extents[0];
    let upwards = (1.0 - 2.0 * y / height + camera.shift()[1]) * half_extents[1];
    let across = right * across + up * upwards;
    match camera.is_orthographic() {
        true => Ray::new(camera.eye + across, forward),
        false => Ray::new(camera.eye, (forward + across).normalize()),
    }
}

/// [`eye_ray`] of a camera with a lens, from a point of the lens chosen uniformly by `u`.
pub fn camera_ray(camera: &Camera, resolution: [u32; 2], x: f32, y: f32, [u0, u1]: [f32; 2]) -> Ray {
    let direction = eye_ray(camera, resolution, x, y).direction;
    let (right, up, forward) = camera.world_from_camera();
    let in_focus = camera.eye + direction * (camera.focus_distance() / direction.dot(forward));
    let (sin, cos) = (std::f32::consts::TAU * u1).sin_cos();
    let origin = camera.eye + 0.5 * camera.aperture * u0.sqrt() * (cos * right + sin * up);
    Ray::new(origin, (in_focus - origin).normalize())
}

/// Renders an image: linear radiance, rows from the top, box pixel filter.
///
/// `progress` receives the finished fraction after each round of samples over the whole image and returns whether to continue; if
/// not, the image is the mean of the rounds so far.
///
/// Paths whose light is no number, by the rule of [`finite`], are left out of the mean of their pixel; the log
/// tells how many. Errors: [`Error::Setting`]; [`Error::NoNumberTraced`] for a pixel without any other path.
pub fn render(
    scene: &Scene,
    bvh: &Bvh,
    emitters: &Emitters,
    camera: &Camera,
    options: &Options,
    progress: impl Fn(f32) -> bool,
) -> Result<Vec<Vec3>> {
    let (image, left_out) = trace(scene, bvh, emitters, camera, options, progress)?;
    tell(left_out);
    Ok(image)
}

/// Warns of paths that were left out.
fn tell(left_out: u64) {
    if left_out > 0 {
        log::warn!("{left_out} paths are left out: their light is no number (NaN, infinite, or 2^100 and more)");
    }
}

/// [`render`], with the number of paths that are left out.
fn trace(
    scene: &Scene,
    bvh: &Bvh,
    emitters: &Emitters,
    camera: &Camera,
    options: &Options,
    progress: impl Fn(f32) -> bool,
) -> Result<(Vec<Vec3>, u64)> {
    options.validate()?;
    let tracer = Tracer::new(scene, bvh, emitters, options);
    let [width, height] = options.resolution;
    let pixels = width as usize * height as usize;
    // Light and number of the paths that count.
    let mut sums = vec![(DVec3::ZERO, 0u32); pixels];
    // Rounds long enough to occupy every core on a small image.
    let round = 65_536usize.div_ceil(pixels).min(1 << 16) as u32;
    let mut done = 0;
    while done < options.samples {
        let end = options.samples.min(done.saturating_add(round));
        sums.par_chunks_mut(width as usize).enumerate().for_each(|(y, row)| {
            for (x, (sum, count)) in row.iter_mut().enumerate() {
                let pixel = (y * width as usize + x) as u32;
                for sample in done..end {
                    let mut rng = Rng::new(options.seed, pixel, sample);
                    let [dx, dy] = rng.pair();
                    let (x, y) = (x as f32 + dx, y as f32 + dy);
                    let ray = if camera.has_lens() {
                        camera_ray(camera, options.resolution, x, y, rng.pair())
                    } else {
                        eye_ray(camera, options.resolution, x, y)
                    };
                    let radiance = tracer.radiance(ray, &mut rng);
                    if finite::reference(&radiance.to_array()) {
                        *sum += radiance.as_dvec3();
                        *count += 1;
                    }
                }
            }
        });
        done = end;
        if !progress(done as f32 / options.samples as f32) {
            break;
        }
    }
    if let Some(pixel) = sums.iter().position(|(_, count)| *count == 0) {
        return Err(Error::NoNumberTraced { paths: done, at: [pixel as u32 % width, pixel as u32 / width] });
    }
    let left_out = sums.iter().map(|(_, count)| u64::from(done - count)).sum();
    let mean = |(sum, count): (DVec3, u32)| (sum / f64::from(count)).as_vec3();
    Ok((sums.into_iter().map(mean).collect(), left_out))
}

/// A scene with its acceleration structure and emitters.
#[derive(Clone, Copy, Debug)]
pub struct Tracer<'a> {
    scene: &'a Scene,
    bvh: &'a Bvh,
    emitters: &'a Emitters,
    has_alpha: bool,
    scale: f32,
    max_depth: u32,
    max_specular: u32,
    specular_paths: SpecularPaths,
    reflectance: settings::Reflectance,
}

impl<'a> Tracer<'a> {
    /// Applies the options for path lengths and specular paths.
    pub fn new(scene: &'a Scene, bvh: &'a Bvh, emitters: &'a Emitters, options: &Options) -> Tracer<'a> {
        let Options { max_depth, max_specular, specular_paths, reflectance, .. } = *options;
        let scale = bvh.typical_scale();
        // Imported lights include reflected light.
        let max_depth = if scene.emitters_are_lights { max_depth } else { max_depth.min(2) };
        let has_alpha = scene.has_alpha();
        Tracer { scene, bvh, emitters, has_alpha, scale, max_depth, max_specular, specular_paths, reflectance }
    }

    /// One estimate of the radiance that arrives against a ray of unit direction.
    pub fn radiance(&self, mut ray: Ray, rng: &mut Rng) -> Vec3 {
        let mut radiance = Vec3::ZERO;
        let mut beta = Vec3::ONE;
        // Position and density of the last reflection with emitter sampling; None after the eye or an ideal mirror, whose
        // light no other strategy finds.
        let mut last: Option<(Vec3, f32)> = None;
        // Whether there were only ideal mirrors and glass since the eye, and their number.
        let (mut directly, mut seen_through) = (true, 0);
        // Number of other surfaces on the path.
        let mut reflections = 0;
        let mut media = Media::default();
        let mut segment = 1;
        loop {
            let Some(hit) = self.closest(&ray, rng) else {
                radiance += beta * self.surroundings(ray.direction, last.map(|(_, pdf)| pdf));
                break;
            };
            let point = PathVertex::of(self.scene, self.bvh, &hit, -ray.direction);
            radiance += beta * self.emission(&point, last, directly);
            let n = point.normals;
            let followed = match self.specular_paths {
                SpecularPaths::None => false,
                SpecularPaths::Eye => directly && seen_through < self.max_specular,
                SpecularPaths::VirtualLights if !directly => reflections > 1,
                SpecularPaths::VirtualLights | SpecularPaths::All => !directly || seen_through < self.max_specular,
            };
            let (sample, probability) = if followed { self.ideal(&point, &media, rng) } else { (None, 1.0) };
            beta /= probability;
            if !(directly && sample.is_some()) {
                if segment == self.max_depth {
                    break;
                }
                segment += 1;
            }
            if let Some(sample) = sample {
                seen_through += u32::from(directly);
                beta *= sample.weight;
                last = None;
                if sample.crosses {
                    media = media.crossed(point.material_index, n.front);
                }
                let side = if n.geometric.dot(sample.wi) > 0.0 { n.geometric } else { -n.geometric };
                ray = Ray::new(offset_origin(point.position, side, self.scale), sample.wi);
            } else {
                let reflectance = point.finish(self.scene).reflectance;
                radiance += beta * self.direct(&point, &reflectance, rng);
                let choice = rng.next_f32();
                let wi = reflectance.sample(&self.scene.materials, n.shading, point.wo, choice, rng.pair());
                let pdf = reflectance.pdf(&self.scene.materials, n.shading, wi, point.wo);
                // Written so that NaN also ends the path.
                if !(n.above(wi) && pdf > 0.0) {
                    break;
                }
                beta *= reflectance.eval(&self.scene.materials, n.shading, wi, point.wo) * (n.shading.dot(wi) / pdf);
                last = Some((point.position, pdf));
                directly = false;
                reflections += 1;
                ray = Ray::new(offset_origin(point.position, n.geometric, self.scale), wi);
            }
            if beta.max_element() <= 0.0 {
                break;
            }
        }
        radiance
    }

    /// A continuation at a mirror or glass and the probability of this choice; `None`: the path reflects non-ideally.
    fn ideal(&self, point: &PathVertex, media: &Media, rng: &mut Rng) -> (Option<BsdfSample>, f32) {
        let finish = point.finish(self.scene);
        let eta = media.relative_index(&self.scene.materials, point.material_index, point.normals.front);
        let Some(samples) = specular_samples(point.material, &finish, &point.normals, point.wo, eta, self.reflectance)
        else {
            return (None, 1.0);
        };
        let split = samples.split(finish.reflectance.kd);
        match split.second {
            Some(second) if rng.next_f32() >= split.probability => (Some(second), 1.0 - split.probability),
            _ => {
                let n = point.normals.geometric;
                let through = split.first.map(|sample| match frost(point.material) {
                    Some(alpha) if sample.wi.dot(n) < 0.0 => sample.frosted(n, point.wo, alpha, rng.pair()),
                    _ => sample,
                });
                (through, split.probability)
            }
        }
    }

    /// Emission of a point hit by a path, weighted against the sampling of emitters at `last`.
    fn emission(&self, point: &PathVertex, last: Option<(Vec3, f32)>, directly: bool) -> Vec3 {
        let emission = point.emission(self.scene);
        if emission.max_element() <= 0.0 {
            return Vec3::ZERO;
        }
        let index = self.emitters.of_triangle[point.triangle as usize];
        match last {
            // Emission that does not light the scene counts only for the eye.
            _ if index == NO_EMITTER => {
                if directly {
                    emission
                } else {
                    Vec3::ZERO
                }
            }
            None => emission,
            Some((from, pdf)) => {
                let cos = point.normals.geometric.dot(point.wo);
                let distance2 = (point.position - from).length_squared();
                let part = self.emitters.list.get(self.emitters.at(point.triangle, point.position) as usize);
                let pdf_light = part.map_or(0.0, |e| area_pdf(e, distance2, cos));
                emission * power_heuristic(pdf, pdf_light)
            }
        }
    }

    /// Radiance of the environment met by a path, weighted against the sampling of emitters at its last reflection, whose density
    /// is `pdf`.
    fn surroundings(&self, direction: Vec3, pdf: Option<f32>) -> Vec3 {
        let Some(environment) = &self.emitters.environment else { return Vec3::ZERO };
        match pdf {
            None => environment.of.seen(direction),
            Some(pdf) => {
                let weight = power_heuristic(pdf, self.emitters.environment_pdf(direction));
                environment.of.radiance(direction) * weight
            }
        }
    }

    /// One estimate of the light that comes from emitters directly, with one shadow ray.
    fn direct(&self, point: &PathVertex, reflectance: &Reflectance, rng: &mut Rng) -> Vec3 {
        let (index, u0) = self.emitters.choose(rng.next_f32());
        let u1 = rng.next_f32();
        let e = &self.emitters.list[index as usize];
        let n = point.normals;
        let from = offset_origin(point.position, n.geometric, self.scale);
        // f_r cos, or 0 below the surface.
        let reflected = |wi: Vec3| {
            if n.above(wi) {
                reflectance.eval(&self.scene.materials, n.shading, wi, point.wo) * n.shading.dot(wi)
            } else {
                Vec3::ZERO
            }
        };
        if let (Kind::Environment, Some(environment)) = (e.kind, &self.emitters.environment) {
            let wi = e.sample_sky(&environment.of, u0, u1);
            let pdf = e.probability / e.area;
            let weight = power_heuristic(pdf, reflectance.pdf(&self.scene.materials, n.shading, wi, point.wo));
            let light = reflected(wi) * environment.of.radiance(wi) * (weight / pdf);
            return self.unless(light, Ray::new(from, wi));
        }
        if e.kind == Kind::Directional {
            let wi = -e.normal;
            let light = reflected(wi) * e.radiance / e.probability;
            return self.unless(light, Ray::new(from, wi));
        }
        let (target, axis) = e.sample_point(u0, u1, 1.0);
        let to_light = target - point.position;
        let distance2 = to_light.length_squared();
        if distance2 <= 0.0 {
            return Vec3::ZERO;
        }
        let wi = to_light / distance2.sqrt();
        if e.is_delta() {
            let light = reflected(wi) * e.intensity(-wi) / (distance2 * e.probability);
            let target = if e.kind == Kind::Imported { offset_origin(target, axis, self.scale) } else { target };
            return self.unless(light, Ray::between(from, target));
        }
        let axis = if e.two_sided && axis.dot(wi) > 0.0 { -axis } else { axis };
        let cos = -axis.dot(wi);
        if cos <= 0.0 {
            return Vec3::ZERO;
        }
        let pdf = area_pdf(e, distance2, cos);
        let weight = power_heuristic(pdf, reflectance.pdf(&self.scene.materials, n.shading, wi, point.wo));
        let radiance = e.radiance_at(&self.scene.textures, u0, u1) * cosine::falloff(cos, e.exponent);
        let light = reflected(wi) * radiance * (weight / pdf);
        self.unless(light, Ray::between(from, offset_origin(target, axis, self.scale)))
    }

    /// The surface that a ray ends at.
    fn closest(&self, ray: &Ray, rng: &mut Rng) -> Option<Hit> {
        if !self.has_alpha {
            return self.bvh.closest(ray);
        }
        self.bvh.closest_stop(self.scene, ray, |_| rng.next_f32())
    }

    /// `light` as far as it passes the surfaces on its way.
    fn unless(&self, light: Vec3, shadow: Ray) -> Vec3 {
        if self.has_alpha && light.max_element() > 0.0 {
            return light * self.bvh.transmittance(self.scene, &shadow);
        }
        if light.max_element() > 0.0 && !self.bvh.occluded(&shadow) { light } else { Vec3::ZERO }
    }
}

/// Density over solid angle of choosing an emitter and a point on it by area.
fn area_pdf(e: &Emitter, distance2: f32, cos: f32) -> f32 {
    e.probability * distance2 / (e.area * cos.max(f32::MIN_POSITIVE))
}

/// Weight of a sample of density `a` that another strategy finds with density `b`.
fn power_heuristic(a: f32, b: f32) -> f32 {
    // The ratio first: squares of large densities would overflow.
    let ratio = b / a;
    1.0 / (1.0 + ratio * ratio)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Triangle, builtin};

    #[test]
    fn paths_that_are_no_numbers_are_left_out_and_counted() {
        // Every path sees 2 W/(m^2 sr), but for those that meet the one triangle whose light is beyond numbers.
        let sound = builtin::furnace(0.0, 2.0);
        let camera = Camera { fov_y: 90.0, resolution: [8, 8], ..sound.camera.unwrap() };
        let options = Options {
            resolution: [8, 8],
            samples: 64,
            max_depth: 1,
            max_specular: 0,
            seed: 3,
            specular_paths: SpecularPaths::None,
            reflectance: settings::Reflectance::default(),
        };
        let traced = |scene: &Scene| {
            let (bvh, emitters) = (Bvh::build(scene).unwrap(), Emitters::of(scene, true).unwrap());
            trace(scene, &bvh, &emitters, &camera, &options, |_| true)
        };
        let (image, left_out) = traced(&sound).unwrap();
        assert!(left_out == 0 && image.iter().all(|l| *l == Vec3::splat(2.0)), "{left_out}: {image:?}");
        let mut faulty = sound.clone();
        faulty.materials.push(faulty.materials[0].clone());
        let bright = faulty.materials.len() as u32 - 1;
        faulty.materials[bright as usize].emission = Vec3::splat(2e30);
        // A triangle that covers a part of pixel 4,4.
        let direction = eye_ray(&camera, [8, 8], 4.5, 4.5).direction;
        let (right, up, _) = camera.world_from_camera();
        let first = faulty.positions.len() as u32;
        faulty.positions.extend([right - up, -right - up, up].map(|at| camera.eye + 0.3 * direction + 0.01 * at));
        faulty.normals.extend([-direction; 3]);
        faulty.uvs.extend([glam::Vec2::ZERO; 3]);
        faulty.materials[bright as usize].two_sided = true;
        let vertices = [first, first + 1, first + 2];
        faulty.triangles.push(Triangle { vertices, material: bright, ..faulty.triangles[0] });
        let (image, left_out) = traced(&faulty).unwrap();
        assert!(left_out > 0 && left_out < 64, "{left_out}");
        assert!(image.iter().all(|l| *l == Vec3::splat(2.0)), "{image:?}");
        // A pixel without any path that counts.
        faulty.triangles.iter_mut().for_each(|triangle| triangle.material = bright);
        let message = traced(&faulty).unwrap_err().to_string();
        assert!(message.starts_with("all 64 paths of pixel 0,0 have light that is no number"), "{message}");
    }
}
