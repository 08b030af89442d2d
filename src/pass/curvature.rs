//! Oracle of `shaders/include/curvature.wgsl`: how a smooth curved surface mirrors the rays of neighbouring pixels (Igehy 1999, "Tracing Ray
//! Differentials"; Bastos 1999, section 8.1.1).
//!
//! Let d be the direction of an eye ray that meets a surface at distance t, n the interpolated normal there, cos theta = -n.d, and u, v the
//! directions across the ray in the plane of incidence and perpendicular to it. The shape operator S of the surface, dn = S dP, follows
//! from the triangle's edges and the differences of its three normals, both projected onto the tangent plane. A ray turned by x (along u
//! and v) meets the surface t x farther on, and its reflection, unfolded at the tangent plane, is turned by
//!
//! ```text
//! x + t G x      G = 2 diag(1 / cos theta, 1) S diag(1, cos theta), in terms of the tangent directions of u and v
//! ```
//!
//! On a sphere of radius R seen from outside G = diag(2 / (R cos theta), 2 cos theta / R), the reciprocals of the focal lengths. So a point
//! at distance z_r has its virtual image behind the surface at z' with 1 / z' = 1 / z_r + g along an axis of power g, and a lobe is seen 1 +
//! t / z_r + t g times narrower than it is.
//!
//! **Concave** surfaces have powers below 0: images are farther, and larger; where 1 / t + 1 / z_r + g = 0 the eye and the point are
//! conjugate, and a single pixel shows all of the lobe. Reflectors are used where t g >= [`MOST_CONCAVE`] for both axes: there no kernel is
//! more than twice as wide as on a plane, wherever the point. Beyond that the surface shows no mirror image, and its lobe is followed by
//! eye paths, or left to splats.
//!
//! Differs from the exact differentials in that displacements are followed in the tangent plane, not in the facet, so that neighbouring
//! facets agree.

use glam::{DMat3, DVec3, Vec3};

use crate::accel::{Bvh, Hit};
use crate::scene::Scene;

/// Least power of a surface times its distance from the eye at which it is a reflector.
pub const MOST_CONCAVE: f32 = -0.5;

/// Faces steeper than this against the interpolated normal count as flat: least cosine.
pub const STEEPEST: f64 = 0.01;

/// The curvature at a hit as its mirror image is concerned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bend {
    /// Normal that mirrors the ray: the shading normal, or the geometric one where the ray would be sent into the surface.
    pub normal: Vec3,
    /// Direction across the ray in the plane of incidence, on the side of the normal.
    pub u: Vec3,
    /// Cosine between the normal and the view.
    pub mu: f32,
    /// Power along u, mixed, and across, in reciprocal units of length.
    pub power: [f64; 3],
    /// Whether it is flat, convex, or hardly concave.
    pub mild: bool,
}

/// Oracle: the curvature at a hit of an eye ray in direction `d`, by differences of rays turned by a small angle. `right`: direction that
/// stands in for u where the ray is perpendicular to the surface.
pub fn bend_at(scene: &Scene, bvh: &Bvh, hit: &Hit, d: Vec3, right: Vec3) -> Bend {
    let triangle = &scene.triangles[bvh.scene_triangle(hit.triangle) as usize];
    let [a, b, c] = scene.triangle_positions(bvh.scene_triangle(hit.triangle) as usize).map(|p| p.as_dvec3());
    let normals = triangle.vertices.map(|v| scene.normals[v as usize].as_dvec3());
    let t = f64::from(hit.t);
    let d = d.as_dvec3();
    let face = (b - a).cross(c - a).normalize();
    let geometric = if face.dot(d) < 0.0 { face } else { -face };
    let smooth = |u: f64, v: f64| {
        let blend = normals[0] * (1.0 - u - v) + normals[1] * u + normals[2] * v;
        if blend.dot(geometric) >= 0.0 { blend.normalize() } else { -blend.normalize() }
    };
    let at = [f64::from(hit.u), f64::from(hit.v)];
    let shading = smooth(at[0], at[1]);
    let mirrored = |d: DVec3, n: DVec3| d - 2.0 * d.dot(n) * n;
    let above = shading.dot(d) < 0.0 && mirrored(d, shading).dot(geometric) > 0.0;
    let n = if above { shading } else { geometric };
    let mu = -n.dot(d);
    let aslant = n + mu * d;
    let right = right.as_dvec3();
    let u = if aslant.length_squared() > 1e-10 { aslant.normalize() } else { (right - d * right.dot(d)).normalize() };
    let across = d.cross(u);

    let curved = face.dot(n).abs() > STEEPEST;
    let surface = DMat3::from_cols(b - a, c - a, n);
    let normal_at = |p: DVec3| {
        if !curved {
            return n;
        }
        let moved = surface.inverse() * p;
        (n + smooth(at[0] + moved.x, at[1] + moved.y) - shading).normalize()
    };
    // The reflection of the ray turned by a small angle towards w, unfolded.
    let reflected = |w: DVec3| {
        let turned = (d + w).normalize();
        let on_plane = turned * (d.dot(n) / turned.dot(n)) * t - d * t;
        mirrored(mirrored(turned, normal_at(on_plane)), n)
    };
    let small = 1e-5;
    let power_of = |w: DVec3| ((reflected(small * w) - reflected(-small * w)) / (2.0 * small) - w) / t;
    let [of_u, of_across] = [u, across].map(power_of);
    let power = [of_u.dot(u), 0.5 * (of_u.dot(across) + of_across.dot(u)), of_across.dot(across)];
    let half = 0.5 * (power[0] - power[2]);
    let least = 0.5 * (power[0] + power[2]) - half.hypot(power[1]);
    Bend { normal: n.as_vec3(), u: u.as_vec3(), mu: mu as f32, power, mild: t * least >= f64::from(MOST_CONCAVE) }
}

/// Distance of the virtual image behind a surface of this power of a point at distance `z`; negative: a real image before it.
pub fn image_distance(z: f64, power: f64) -> f64 {
    1.0 / (1.0 / z + power)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::Ray;
    use crate::pass::mirror_image::curved_reference;
    use crate::scene::{Material, Triangle};

    /// A patch of a sphere of radius `r` about the origin, fine around the z axis, with exact normals.
    fn patch(r: f32, reach: f32) -> Scene {
        let mut scene = Scene::default();
        let material = scene.add_material(Material::default());
        let object = scene.add_object("patch");
        let n = 20;
        let at = |i: i32, j: i32| Vec3::new(i as f32 * reach / n as f32, j as f32 * reach / n as f32, r).normalize();
        for i in -n..=n {
            for j in -n..=n {
                scene.positions.push(r * at(i, j));
                scene.normals.push(at(i, j));
            }
        }
        let index = |i: i32, j: i32| ((i + n) * (2 * n + 1) + j + n) as u32;
        for i in -n..n {
            for j in -n..n {
                for vertices in [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]] {
                    let vertices = vertices.map(|(a, b)| index(i + a, j + b));
                    scene.triangles.push(Triangle { vertices, material, object, smooth: true });
                }
            }
        }
        scene
    }

    /// The bend at the pole of a sphere seen from distance `t` at `angle` from the normal, from outside or from inside.
    fn bend(r: f32, angle: f32, t: f32, inside: bool) -> Bend {
        let scene = patch(r, 0.2 * r);
        let bvh = Bvh::build(&scene).unwrap();
        let side = if inside { -1.0 } else { 1.0 };
        // Slightly off the vertices of the mesh.
        let target = Vec3::new(0.001 * r, 0.0017 * r, r);
        let to_eye = Vec3::new(angle.sin(), 0.0, side * angle.cos());
        let ray = Ray { origin: target + t * to_eye, direction: -to_eye, t_max: 3e38 };
        let hit = bvh.closest(&ray).unwrap();
        bend_at(&scene, &bvh, &hit, ray.direction, Vec3::X)
    }

    #[test]
    fn spheres_have_the_focal_lengths_of_textbooks() {
        for angle in [0.0, 0.5, 1.0, 1.3f32] {
            for r in [0.5, 2.0] {
                let bend = bend(r, angle, 3.0, false);
                let cos = f64::from(bend.mu);
                let r = f64::from(r);
                let expected = [2.0 / (r * cos), 0.0, 2.0 * cos / r];
                for (found, expected) in bend.power.iter().zip(expected) {
                    assert!((found - expected).abs() < 0.01 * 2.0 / (r * cos), "{angle}: {:?}", bend.power);
                }
                assert!(bend.mild && (cos - f64::from(angle.cos())).abs() < 0.02);
            }
        }
    }

    #[test]
    fn images_and_kernels_head_on_in_closed_form() {
        let (r, t) = (2.0, 3.0);
        let bend = bend(r as f32, 0.0, t as f32, false);
        for z in [0.1, 1.0, 10.0, 1e6] {
            let virtual_image = z * r / (r + 2.0 * z);
            let found = image_distance(z, bend.power[0]);
            assert!((found / virtual_image - 1.0).abs() < 2e-3, "{z}: {found} for {virtual_image}");
            // 4 tan(beta) f pixels wide at infinite distance.
            let plane = 40.0 * z / (t + z);
            let kernel = curved_reference(plane, 1.0, bend.power, t, z / (t + z));
            let expected = 40.0 * virtual_image / (t + virtual_image);
            assert!((kernel.diameter / expected - 1.0).abs() < 2e-3 && kernel.steps == 0, "{z}: {kernel:?}");
        }
    }

    #[test]
    fn kernels_at_an_angle_have_two_axes() {
        let (r, t, z, angle): (f64, f64, f64, f64) = (2.0, 3.0, 5.0, 1.0);
        let bend = bend(r as f32, angle as f32, t as f32, false);
        let kernel = curved_reference(40.0 * z / (t + z), 1.0, bend.power, t, z / (t + z));
        let width = |focal: f64| {
            let image = image_distance(z, 1.0 / focal);
            40.0 * image / (t + image)
        };
        let cos = angle.cos();
        let (along, across) = (width(0.5 * r * cos), width(0.5 * r / cos));
        // The ratio of the axes is rounded to steps; their product is kept.
        assert_eq!(f64::from(kernel.steps), (4.0 * (across / along).log2()).round());
        let expected = (along * across).sqrt() * (f64::from(kernel.steps) / 8.0).exp2();
        assert!((kernel.diameter / expected - 1.0).abs() < 0.01, "{kernel:?} for {along}, {across}");
        assert!(kernel.exchanged && kernel.axis.y < -0.999, "{kernel:?}");
    }

    #[test]
    fn large_radii_have_the_kernel_of_a_plane() {
        let (t, z) = (1.0, 4.0);
        for angle in [0.0, 0.9] {
            let bend = bend(1e4, angle, t as f32, false);
            for aspect in [1.0, 0.5f64.powf(0.75)] {
                let kernel = curved_reference(20.0, aspect, bend.power, t, z / (t + z));
                assert!((kernel.diameter / 20.0 - 1.0).abs() < 1e-3 && kernel.axis.x > 0.999, "{kernel:?}");
                assert_eq!(f64::from(kernel.steps), (-4.0 * aspect.log2()).round());
            }
        }
    }

    #[test]
    fn concave_surfaces_are_reflectors_up_to_a_distance() {
        let r = 2.0;
        for (t, mild) in [(0.4, true), (0.49, true), (0.51, false), (1.5, false)] {
            let bend = bend(r, 0.0, t, true);
            assert!((bend.power[0] + 1.0).abs() < 0.01, "{:?}", bend.power);
            assert_eq!(bend.mild, mild, "{t}");
        }
        // Images grow and change sign at the focal length.
        assert!((image_distance(0.5, -1.0) - 1.0).abs() < 1e-9 && image_distance(1.5, -1.0) < 0.0);
        // At the limit the kernel is at most twice as wide as on a plane.
        let kernel = curved_reference(10.0, 1.0, [-1.0, 0.0, -1.0], 0.5, 1.0);
        assert!((kernel.diameter - 20.0).abs() < 1e-6, "{kernel:?}");
    }
}
