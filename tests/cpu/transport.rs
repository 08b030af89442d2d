//! The path tracer against closed forms. Statistical tolerances are five standard errors of the mean, measured from the
//! pixels, which are independent; errors of tessellation are stated where they occur.

use glam::{DVec3, Vec2, Vec3};
use lightsum::accel::{Bvh, Ray};
use lightsum::light::emitters::{Emitters, uniform_sphere};
use lightsum::path_trace::{Options, Rng, SpecularPaths, Tracer, camera_ray, eye_ray, render};
use lightsum::scene::{Camera, Light, Material, Scene, Surface, Texture, Triangle, Wrap};
use std::f32::consts::PI;

mod glass;

/// A scene under construction.
#[derive(Default)]
struct Build(Scene);

impl Build {
    fn material(&mut self, albedo: f32, emission: f32) -> u32 {
        self.add(Material { base_color: Vec3::splat(albedo), emission: Vec3::splat(emission), ..Material::default() })
    }

    fn add(&mut self, material: Material) -> u32 {
        self.0.materials.push(material);
        self.0.materials.len() as u32 - 1
    }

    /// A mirror without a diffuse base.
    fn mirror(&mut self, reflectance: f32) -> u32 {
        let specular = Vec3::splat(reflectance);
        self.add(Material { surface: Surface::Mirror, base_color: Vec3::ZERO, specular, ..Material::default() })
    }

    /// Clear glass.
    fn glass(&mut self, ior: f32) -> u32 {
        self.add(Material { surface: Surface::Glass, base_color: Vec3::ONE, ior, ..Material::default() })
    }

    fn triangle(&mut self, corners: [Vec3; 3], material: u32) {
        let first = self.0.positions.len() as u32;
        self.0.positions.extend(corners);
        self.0.normals.extend([Vec3::Z; 3]);
        self.0.uvs.extend([Vec2::ZERO; 3]);
        let vertices = [first, first + 1, first + 2];
        self.0.triangles.push(Triangle { vertices, material, object: 0, smooth: false });
    }

    /// Parallelogram whose front is the side of cross(u, v).
    fn quad(&mut self, corner: Vec3, u: Vec3, v: Vec3, material: u32) {
        self.triangle([corner, corner + u, corner + u + v], material);
        self.triangle([corner, corner + u + v, corner + v], material);
    }

    /// The faces of a box, fronts inside (or outside).
    fn cuboid(&mut self, low: Vec3, high: Vec3, inside: bool, material: u32) {
        let d = high - low;
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let edge = |k: usize| Vec3::AXES[k] * d[k];
            for (corner, outward) in [(low, false), (low + edge(axis), true)] {
                // cross(u, v) points along the axis.
                let (a, b) = if outward != inside { (u, v) } else { (v, u) };
                self.quad(corner, edge(a), edge(b), material);
            }
        }
    }

    /// A unit sphere, fronts inside, from an octahedron; `material` by octant (bit 0: x < 0, bit 1: y < 0, bit 2: z < 0).
    fn sphere(&mut self, subdivisions: u32, material: impl Fn(usize) -> u32) {
        for octant in 0..8 {
            let sign = |bit: usize| if octant >> bit & 1 == 1 { -1.0 } else { 1.0 };
            let mut faces = vec![[Vec3::X * sign(0), Vec3::Y * sign(1), Vec3::Z * sign(2)]];
            for _ in 0..subdivisions {
                let split = |[a, b, c]: [Vec3; 3]| {
                    let [d, e, f] = [(a + b).normalize(), (b + c).normalize(), (c + a).normalize()];
                    [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
                };
                faces = faces.into_iter().flat_map(split).collect();
            }
            for [a, b, c] in faces {
                let inwards = (b - a).cross(c - a).dot(a) < 0.0;
                self.triangle(if inwards { [a, b, c] } else { [a, c, b] }, material(octant));
            }
        }
    }
}

/// Mean and standard error of the radiance along one ray.
fn along(scene: &Scene, origin: Vec3, direction: Vec3, depth: u32, samples: u32) -> (f64, f64) {
    mean_over(scene, depth, samples, |_| Ray::new(origin, direction.normalize()))
}

/// Mean and standard error of the radiance along random rays.
fn mean_over(scene: &Scene, depth: u32, samples: u32, ray: impl Fn(&mut Rng) -> Ray) -> (f64, f64) {
    let bvh = Bvh::build(scene).unwrap();
    bvh.validate(scene).unwrap();
    let emitters = Emitters::of(scene, true).unwrap();
    // The same number of segments, whether the eye sees it directly or not.
    let options = Options { max_depth: depth, max_specular: depth - 1, ..OPTIONS };
    let tracer = Tracer::new(scene, &bvh, &emitters, &options);
    let (mut sum, mut squares) = (0.0, 0.0);
    for i in 0..samples {
        let mut rng = Rng::new(1, 0, i);
        let x = f64::from(tracer.radiance(ray(&mut rng), &mut rng).x);
        sum += x;
        squares += x * x;
    }
    let n = f64::from(samples);
    let mean = sum / n;
    (mean, ((squares / n - mean * mean).max(0.0) / n).sqrt())
}

/// Checks the radiance along one ray; `slack` is the relative tolerance for errors other than noise.
fn expect(scene: &Scene, ray: (Vec3, Vec3), depth: u32, samples: u32, expected: f64, slack: f64) {
    let (mean, error) = along(scene, ray.0, ray.1, depth, samples);
    assert!(error < 0.01 * expected, "too noisy to say: {mean} +- {error}");
    let tolerance = 5.0 * error + (slack + 1e-5) * expected;
    assert!((mean - expected).abs() < tolerance, "depth {depth}: {mean} +- {error}, expected {expected}");
}

/// Irradiance of a polygon of radiance 1 at a point, all of it above the horizon (Lambert).
fn polygon_irradiance(point: Vec3, normal: Vec3, corners: &[Vec3]) -> f64 {
    let v: Vec<DVec3> = corners.iter().map(|c| (c.as_dvec3() - point.as_dvec3()).normalize()).collect();
    let mut sum = 0.0;
    for i in 0..v.len() {
        let (a, b) = (v[i], v[(i + 1) % v.len()]);
        sum += a.dot(b).clamp(-1.0, 1.0).acos() * a.cross(b).normalize().dot(normal.as_dvec3());
    }
    sum.abs() / 2.0
}

#[test]
fn furnace_after_k_reflections() {
    for (rho, emitted) in [(0.5f32, 1.0), (0.8, 1.0), (128.0 / 255.0, 64.0)] {
        let mut b = Build::default();
        let wall = b.material(rho, emitted);
        b.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
        for depth in 1..=8u32 {
            let expected = f64::from(emitted) * (1.0 - f64::from(rho).powi(depth as i32)) / (1.0 - f64::from(rho));
            let ray = (Vec3::new(0.4, 0.6, 0.3), Vec3::new(0.3, -0.8, 0.5));
            expect(&b.0, ray, depth, 8000, expected, 0.0);
        }
    }
}

#[test]
fn irradiance_of_rectangles() {
    let floor = |b: &mut Build| {
        let m = b.material(0.5, 0.0);
        b.quad(Vec3::new(-20.0, 0.0, -20.0), Vec3::Z * 40.0, Vec3::X * 40.0, m);
    };
    // Parallel 1 x 1 at 1 over its corner, over its centre, and 2 x 2 over its centre: E = pi L C.
    for (low, size, factor) in [
        (Vec3::Y, 1.0, 0.1385316060),
        (Vec3::new(-0.5, 1.0, -0.5), 1.0, 0.2394564705),
        (Vec3::new(-1.0, 1.0, -1.0), 2.0, 0.5541264240),
    ] {
        let mut b = Build::default();
        floor(&mut b);
        let lamp = b.material(0.0, 3.0);
        b.quad(low, Vec3::X * size, Vec3::Z * size, lamp);
        // From below the lamp, obliquely.
        let eye = Vec3::new(3.0, 0.5, 2.0);
        expect(&b.0, (eye, -eye), 2, 20_000, 0.5 * 3.0 * factor, 0.0);
        let corners = [low, low + Vec3::X * size, low + Vec3::X * size + Vec3::Z * size, low + Vec3::Z * size];
        let lambert = polygon_irradiance(Vec3::ZERO, Vec3::Y, &corners) / std::f64::consts::PI;
        assert!((lambert - factor).abs() < 1e-9, "{lambert}");
    }
    // Perpendicular: C = 1/(2 pi) [atan(1/Y) - Y/sqrt(X2 + Y2) atan(1/sqrt(X2 + Y2))], X = a/b, Y = c/b; the
    // element is at distance c from the rectangle of height a and width b, in line with its corner. Here all are 1.
    let mut b = Build::default();
    floor(&mut b);
    let lamp = b.material(0.0, 1.0);
    b.quad(Vec3::X, Vec3::Z, Vec3::Y, lamp);
    let corners = [Vec3::X, Vec3::X + Vec3::Z, Vec3::ONE, Vec3::X + Vec3::Y];
    let expected = polygon_irradiance(Vec3::ZERO, Vec3::Y, &corners) / std::f64::consts::PI;
    let h = 2f64.sqrt();
    let howell = (std::f64::consts::FRAC_PI_4 - (1.0 / h) * (1.0 / h).atan()) / std::f64::consts::TAU;
    assert!((expected - howell).abs() < 1e-9, "{expected} {howell}");
    expect(&b.0, (Vec3::new(-1.0, 1.0, 0.2), Vec3::new(1.0, -1.0, -0.2)), 2, 20_000, 0.5 * expected, 0.0);
}

/// A lamp of 2 x 2 with one white half, over its middle, and aside by the polygon of that half.
#[test]
fn irradiance_of_half_a_lamp() {
    for width in [2u32, 256] {
        let mut b = Build::default();
        let floor = b.material(0.5, 0.0);
        b.quad(Vec3::new(-20.0, 0.0, -20.0), Vec3::Z * 40.0, Vec3::X * 40.0, floor);
        let texel = |x: u32| if 2 * x < width { [0, 0, 0, 255] } else { [255; 4] };
        b.0.textures.push(Texture {
            name: String::from("half"),
            width,
            height: 1,
            texels: (0..width).map(texel).collect(),
            srgb: true,
            wrap: [Wrap::Clamp; 2],
        });
        let lamp = b.add(Material {
            base_color: Vec3::ZERO,
            emission: Vec3::splat(3.0),
            emission_texture: Some(0),
            ..Material::default()
        });
        let low = Vec3::new(-1.0, 1.0, -1.0);
        b.quad(low, Vec3::X * 2.0, Vec3::Z * 2.0, lamp);
        for (uv, p) in b.0.uvs.iter_mut().zip(&b.0.positions) {
            *uv = Vec2::new(0.5 + 0.5 * p.x, 0.5 + 0.5 * p.z);
        }
        let eye = Vec3::new(3.0, 0.5, 2.0);
        expect(&b.0, (eye, -eye), 2, 40_000, 0.5 * 0.5 * 3.0 * 0.5541264240, 0.0);
        if width > 2 {
            let corners = [Vec3::Y - Vec3::Z, Vec3::ONE - Vec3::Z * 2.0, Vec3::ONE, Vec3::Y + Vec3::Z];
            let target = Vec3::new(-0.7, 0.0, 0.4);
            let expected = 0.5 * 3.0 / std::f64::consts::PI * polygon_irradiance(target, Vec3::Y, &corners);
            expect(&b.0, (eye, target - eye), 2, 40_000, expected, 2e-3);
        }
    }
}

#[test]
fn cornell_box_floor() {
    // Cornell's light, unoccluded: E = 0.0447126712 at (278, 0, 279.6).
    let mut b = Build::default();
    let floor = b.material(1.0, 0.0);
    b.quad(Vec3::ZERO, Vec3::Z * 559.2, Vec3::X * 552.8, floor);
    let lamp = b.material(0.0, 1.0);
    b.quad(Vec3::new(213.0, 548.3, 227.0), Vec3::X * 130.0, Vec3::Z * 105.0, lamp);
    expect(
        &b.0,
        (Vec3::new(278.0, 100.0, 100.0), Vec3::new(0.0, -100.0, 179.6)),
        2,
        5000,
        0.0447126712 / std::f64::consts::PI,
        0.0,
    );
}

#[test]
fn irradiance_of_a_disc() {
    let (radius, height) = (0.7f32, 0.9f32);
    let mut b = Build::default();
    let floor = b.material(0.5, 0.0);
    b.quad(Vec3::new(-9.0, 0.0, -9.0), Vec3::Z * 18.0, Vec3::X * 18.0, floor);
    let lamp = b.material(0.0, 2.0);
    let n = 256;
    let rim = |i: u32| {
        let phi = std::f32::consts::TAU * i as f32 / n as f32;
        Vec3::new(radius * phi.cos(), height, radius * phi.sin())
    };
    for i in 0..n {
        b.triangle([Vec3::Y * height, rim(i), rim(i + 1)], lamp);
    }
    let eye = Vec3::new(2.0, 0.5, 0.0);
    // A polygon of 256 sides lacks 1e-4 of the disc.
    let on_axis = f64::from(radius * radius / (radius * radius + height * height));
    expect(&b.0, (eye, -eye), 2, 20_000, on_axis, 2e-4);
    let (d, h, r) = (0.5f64, f64::from(height), f64::from(radius));
    let root = ((d * d + h * h + r * r).powi(2) - 4.0 * r * r * d * d).sqrt();
    let aside = 0.5 * (1.0 - (d * d + h * h - r * r) / root);
    expect(&b.0, (eye, Vec3::new(0.5, 0.0, 0.0) - eye), 2, 20_000, aside, 2e-4);
}

#[test]
fn irradiance_of_a_sphere() {
    // Sphere light fully above the horizon: E = pi L (R/d)^2 cos. Flat faces of its mesh lie a little inside.
    let mut b = Build::default();
    let floor = b.material(0.5, 0.0);
    b.quad(Vec3::new(-9.0, -3.0, -9.0), Vec3::Z * 18.0, Vec3::X * 18.0, floor);
    let lamp = b.material(0.0, 2.0);
    let first = b.0.triangles.len();
    b.sphere(4, |_| lamp);
    for t in &mut b.0.triangles[first..] {
        t.vertices.swap(1, 2);
        t.object = 1;
    }
    let sphere =
        Light::Sphere { center: Vec3::ZERO, radius: 1.0, radiance: Vec3::splat(2.0), inward: false, object: 1 };
    b.0.lights.push(sphere);
    let target = Vec3::new(1.0, -3.0, 0.0);
    let expected = 0.5 * 2.0 / 10.0 * (3.0 / 10f64.sqrt());
    expect(&b.0, (Vec3::new(4.0, -2.0, 0.0), target - Vec3::new(4.0, -2.0, 0.0)), 2, 30_000, expected, 3e-3);
}

#[test]
fn point_light_in_a_sphere() {
    // L after k reflections: rho I / (pi r^2) (1 + rho + ... + rho^(k-1)): 1 - 2^-k for rho = 1/2, I = pi.
    for lights in [1, 4] {
        let mut b = Build::default();
        let wall = b.material(0.5, 0.0);
        b.sphere(4, |_| wall);
        let light = Light::Point { position: Vec3::ZERO, intensity: Vec3::splat(PI / lights as f32) };
        b.0.lights = vec![light; lights];
        for depth in [2, 3, 5, 9] {
            let expected = 1.0 - 0.5f64.powi(depth as i32 - 1);
            // Radii of the mesh's faces lie between 0.997 and 1.
            expect(&b.0, (Vec3::ZERO, Vec3::new(0.3, 0.4, 0.8)), depth, 4000, expected, 6e-3);
        }
    }
    // The same sphere with an emissive inside: emission 1/2 and reflectance 1/2 give 1, as faces and as sphere light.
    for as_light in [false, true] {
        let mut b = Build::default();
        let wall = b.material(0.5, 0.5);
        b.sphere(3, |_| wall);
        if as_light {
            let radiance = Vec3::splat(0.5);
            b.0.lights = vec![Light::Sphere { center: Vec3::ZERO, radius: 1.0, radiance, inward: true, object: 0 }];
        }
        let slack = if as_light { 2e-2 } else { 1e-3 };
        expect(&b.0, (Vec3::ZERO, Vec3::new(0.3, 0.4, 0.8)), 12, 4000, 1.0 - 0.5f64.powi(12), slack);
    }
}

#[test]
fn unequal_patches_in_a_sphere() {
    // F_ij = A_j / A: B_i = E_i + rho_i (sum E_j / 8) / (1 - sum rho_j / 8).
    let exitance = [PI, 0.0, 0.0, 0.3, 0.0, 2.0, 0.0, 0.0];
    let rho = [0.1, 0.5, 0.9, 0.3, 0.0, 0.6, 0.4, 0.2];
    let mut b = Build::default();
    for i in 0..8 {
        b.material(rho[i], exitance[i] / PI);
    }
    b.sphere(4, |octant| octant as u32);
    let total = f64::from(exitance.iter().sum::<f32>()) / 8.0 / (1.0 - f64::from(rho.iter().sum::<f32>()) / 8.0);
    for octant in 0..8usize {
        // Mean over the octant, since the mesh's normal differs from the sphere's by up to 0.04 at a point.
        let ray = |rng: &mut Rng| {
            let d = uniform_sphere([rng.next_f32(), rng.next_f32()]).abs();
            let sign = |bit: usize| if octant >> bit & 1 == 1 { -1.0 } else { 1.0 };
            Ray::new(Vec3::ZERO, d * Vec3::new(sign(0), sign(1), sign(2)))
        };
        let expected = (f64::from(exitance[octant]) + f64::from(rho[octant]) * total) / std::f64::consts::PI;
        let (mean, error) = mean_over(&b.0, 16, 20_000, ray);
        assert!(
            (mean - expected).abs() <= 5.0 * error + 2e-3 * expected && error <= 0.01 * expected,
            "octant {octant}: {mean} +- {error}, expected {expected}"
        );
    }
}

#[test]
fn delta_lights_by_hand() {
    let target = Vec3::new(0.5, 0.0, 0.25);
    let eye = Vec3::new(2.0, 1.5, 1.0);
    let position = Vec3::new(0.0, 2.0, 0.0);
    let to_light = position - target;
    let (d2, cos) = (to_light.length_squared(), to_light.normalize().y);
    let wi = to_light.normalize();
    let axis = Vec3::new(0.0, -1.0, 0.1).normalize();
    let (inner, outer) = (0.1f32, 0.6f32);
    let s = ((-axis.dot(wi)) - outer.cos()) / (inner.cos() - outer.cos());
    assert!(s > 0.0 && s < 1.0);
    let sun = Vec3::new(0.6, -0.8, 0.0);
    for (light, irradiance) in [
        (Light::Point { position, intensity: Vec3::splat(5.0) }, 5.0 * cos / d2),
        (Light::Spot { position, direction: axis, intensity: Vec3::splat(5.0), inner, outer }, 5.0 * s * s * cos / d2),
        (
            Light::Imported { position, normal: -Vec3::Y, power: Vec3::splat(5.0), exponent: 1.0 },
            5.0 / PI * cos * cos / d2,
        ),
        (
            Light::Imported { position, normal: -Vec3::Y, power: Vec3::splat(5.0), exponent: 20.0 },
            5.0 * 21.0 / (2.0 * PI) * cos.powi(20) * cos / d2,
        ),
        (Light::Directional { direction: sun, irradiance: Vec3::splat(5.0) }, 5.0 * 0.8),
    ] {
        let mut b = Build::default();
        let floor = b.material(0.6, 0.0);
        b.quad(Vec3::new(-3.0, 0.0, -3.0), Vec3::Z * 6.0, Vec3::X * 6.0, floor);
        b.0.lights = vec![light];
        expect(&b.0, (eye, target - eye), 2, 4, f64::from(0.6 / PI * irradiance), 1e-4);
        // An occluder.
        let blocker = b.material(0.5, 0.0);
        let middle = if let Light::Directional { .. } = light { target - sun } else { (position + target) * 0.5 };
        b.quad(middle - Vec3::new(0.1, 0.0, 0.1), Vec3::X * 0.2, Vec3::Z * 0.2, blocker);
        let (shadowed, _) = along(&b.0, eye, target - eye, 2, 4);
        assert_eq!(shadowed, 0.0, "{light:?}");
    }
}

#[test]
fn lights_of_many_kinds_add_up() {
    let mut b = Build::default();
    let floor = b.material(0.6, 0.0);
    b.quad(Vec3::new(-3.0, 0.0, -3.0), Vec3::Z * 6.0, Vec3::X * 6.0, floor);
    let lamp = b.material(0.0, 2.0);
    let corner = Vec3::new(-0.5, 1.0, -0.5);
    b.quad(corner, Vec3::X, Vec3::Z, lamp);
    b.0.lights = vec![
        Light::Point { position: Vec3::new(0.0, 0.5, 0.0), intensity: Vec3::ONE },
        Light::Directional { direction: Vec3::new(0.8, -0.6, 0.0), irradiance: Vec3::ONE },
    ];
    let irradiance = 2.0 * 0.2394564705 * std::f64::consts::PI + 1.0 / 0.25 + 0.6;
    let eye = Vec3::new(2.0, 0.5, 0.0);
    expect(&b.0, (eye, -eye), 2, 40_000, 0.6 * irradiance / std::f64::consts::PI, 0.0);
}

#[test]
fn rough_metal_reflects_an_area_light() {
    // Quadrature of f_r cos cos' / d^2 over the lamp against sampling lobe and lamp; narrow lobes need the former, wide
    // ones the latter.
    use lightsum::bsdf::Reflectance;
    for roughness in [0.15f32, 0.4, 1.0] {
        let mut b = Build::default();
        let metal = b.add(Material { base_color: Vec3::splat(0.9), metallic: 1.0, roughness, ..Material::default() });
        b.quad(Vec3::new(-3.0, 0.0, -3.0), Vec3::Z * 6.0, Vec3::X * 6.0, metal);
        let lamp = b.material(0.0, 2.0);
        let corner = Vec3::new(-1.5, 1.0, -0.5);
        b.quad(corner, Vec3::X, Vec3::Z, lamp);
        let eye = Vec3::new(1.0, 1.0, 0.1);
        let (wo, reflectance) = (eye.normalize(), Reflectance::new(Vec3::splat(0.9), 1.0, roughness, Vec3::ZERO));
        let n = 1000;
        let mut expected = 0.0;
        for i in 0..n {
            for j in 0..n {
                let y = corner + Vec3::new((i as f32 + 0.5) / n as f32, 0.0, (j as f32 + 0.5) / n as f32);
                let wi = y.normalize();
                let f = reflectance.eval(&[], Vec3::Y, wi, wo).x * wi.y * wi.y / y.length_squared();
                expected += 2.0 * f64::from(f) / f64::from(n * n);
            }
        }
        expect(&b.0, (eye, -eye), 2, 40_000, expected, 1e-4);
    }
}

/// A box with a lamp, a mirror and a coloured wall, and its camera.
fn room() -> (Scene, Camera) {
    let mut b = Build::default();
    let wall = b.material(0.7, 0.0);
    b.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
    let lamp = b.material(0.3, 10.0);
    b.quad(Vec3::new(0.4, 0.99, 0.4), Vec3::X * 0.2, Vec3::Z * 0.2, lamp);
    let mirror = b.mirror(1.0);
    b.quad(Vec3::new(0.2, 0.2, 0.99), Vec3::Y * 0.5, Vec3::X * 0.5, mirror);
    let camera = Camera {
        eye: Vec3::new(0.5, 0.5, 0.05),
        target: Vec3::new(0.5, 0.5, 1.0),
        up: Vec3::Y,
        fov_y: 80.0,
        resolution: [20, 12],
        aperture: 0.0,
        focus: None,
        shutter: 0.0,
        height: None,
        frustum: None,
    };
    (b.0, camera)
}

const OPTIONS: Options = Options {
    resolution: [20, 12],
    samples: 8,
    max_depth: 5,
    max_specular: 8,
    seed: 3,
    specular_paths: SpecularPaths::All,
    reflectance: lightsum::settings::Reflectance::Schlick,
};

#[test]
fn images_repeat_bit_for_bit() {
    let (scene, camera) = room();
    let bvh = Bvh::build(&scene).unwrap();
    let emitters = Emitters::of(&scene, true).unwrap();
    let image = |options: Options| render(&scene, &bvh, &emitters, &camera, &options, |_| true).unwrap();
    let first = image(OPTIONS);
    assert_eq!(first.len(), 240);
    assert!(first.iter().all(|p| p.is_finite()) && first.iter().any(|p| p.x > 0.0));
    assert_eq!(first, image(OPTIONS));
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(first, one_thread.install(|| image(OPTIONS)));
    assert_ne!(first, image(Options { seed: 4, ..OPTIONS }));
    assert_ne!(first, image(Options { seed: 3 + (1 << 32), ..OPTIONS }));
    // The mirror, near the centre of the image, is black if it is not followed.
    let black = image(Options { specular_paths: SpecularPaths::None, ..OPTIONS });
    assert_eq!(black[6 * 20 + 10], Vec3::ZERO);
    assert!(first[6 * 20 + 10].x > 0.0);
}

#[test]
fn a_stopped_image_is_the_mean_so_far() {
    let (scene, camera) = room();
    let bvh = Bvh::build(&scene).unwrap();
    let emitters = Emitters::of(&scene, true).unwrap();
    let told = std::sync::Mutex::new(Vec::new());
    let options = Options { samples: 600, max_depth: 2, ..OPTIONS };
    let stopped = render(&scene, &bvh, &emitters, &camera, &options, |f| {
        told.lock().unwrap().push(f);
        false
    })
    .unwrap();
    let told = told.into_inner().unwrap();
    assert!(told.len() == 1 && told[0] > 0.0 && told[0] < 1.0);
    let samples = (told[0] * 600.0).round() as u32;
    let whole = render(&scene, &bvh, &emitters, &camera, &Options { samples, ..options }, |_| true).unwrap();
    assert_eq!(stopped, whole);
}

#[test]
fn camera_looks_the_right_way() {
    let (_, camera) = room();
    let at = |x, y| eye_ray(&camera, [20, 12], x, y).direction;
    assert!((at(10.0, 6.0) - Vec3::Z).length() < 1e-6);
    // Looking along +z with y up, +x is to the left; the angle of view is the vertical one.
    assert!(at(0.0, 6.0).x > 0.0 && at(20.0, 6.0).x < 0.0);
    let top = at(10.0, 0.0);
    assert!(top.y > 0.0 && (top.angle_between(Vec3::Z).to_degrees() - 40.0).abs() < 1e-3);
    // Square pixels.
    let (right, up) = (at(11.0, 6.0), at(10.0, 5.0));
    assert!((right.x / right.z + up.y / up.z).abs() < 1e-6);
}

/// Rays through a point of the image meet in the plane in focus, from any point of the lens.
#[test]
fn rays_of_a_lens_meet_in_focus() {
    let (_, camera) = room();
    let camera = Camera { aperture: 0.2, focus: Some(0.7), ..camera };
    let mut rng = Rng::new(3, 1, 4);
    let mut mean_square = 0.0;
    for i in 0..1000 {
        let (x, y) = (20.0 * rng.next_f32(), 12.0 * rng.next_f32());
        let d = eye_ray(&camera, [20, 12], x, y).direction;
        let ray = camera_ray(&camera, [20, 12], x, y, [rng.next_f32(), rng.next_f32()]);
        let from = ray.origin - camera.eye;
        assert!(from.z.abs() < 1e-6 && from.length() <= 0.1 + 1e-6, "{i}: {from}");
        mean_square += from.length_squared() / 1000.0;
        let [a, b] = [camera.eye + d * (0.7 / d.z), ray.origin + ray.direction * (0.7 / ray.direction.z)];
        assert!((a - b).length() < 1e-5, "{i}: {a} {b}");
    }
    // For a disc, half the square of its radius.
    assert!((mean_square - 0.005).abs() < 0.0005, "{mean_square}");
}

#[test]
fn settings_out_of_range_are_errors() {
    let (scene, camera) = room();
    let bvh = Bvh::build(&scene).unwrap();
    let emitters = Emitters::of(&scene, true).unwrap();
    for options in [
        Options { resolution: [0, 5], ..OPTIONS },
        Options { samples: 0, ..OPTIONS },
        Options { max_depth: 0, ..OPTIONS },
    ] {
        assert!(render(&scene, &bvh, &emitters, &camera, &options, |_| true).is_err());
    }
}

#[test]
fn emitters_that_are_no_lights_are_only_seen() {
    let (mut scene, camera) = room();
    scene.lights.push(Light::Point { position: Vec3::splat(0.5), intensity: Vec3::splat(1e-9) });
    let bvh = Bvh::build(&scene).unwrap();
    let emitters = Emitters::of(&scene, false).unwrap();
    let tracer = Tracer::new(&scene, &bvh, &emitters, &OPTIONS);
    let towards = |target: Vec3| {
        let direction = (target - camera.eye).normalize();
        (0..200).map(|i| tracer.radiance(Ray::new(camera.eye, direction), &mut Rng::new(0, 0, i)).x).sum::<f32>()
            / 200.0
    };
    assert!((towards(Vec3::new(0.5, 0.99, 0.5)) - 10.0).abs() < 1e-4);
    assert!(towards(Vec3::new(0.5, 0.0, 0.5)) < 1e-6);
}
