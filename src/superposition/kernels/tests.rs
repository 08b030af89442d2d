//! Kernels against their lobes, which are integrated here independently: in f64, from their equations, over points
//! distributed as the lobe itself.

use super::super::lobe::{MAX_EXPONENT, Table};
use super::*;
use crate::bsdf::MIN_ALPHA;
use crate::bsdf::anisotropic::{pack, unpack};
use glam::Vec2;
use std::sync::Arc;

/// One point of a quadrature: a direction and f cos theta_i d omega_i there. The weights sum to the energy.
type Point = (DVec3, f64);

const ROWS: usize = 900;

fn view(mu: f64) -> DVec3 {
    DVec3::new((1.0 - mu * mu).sqrt(), 0.0, mu)
}

/// Points of a lattice in the unit square mapped to directions. No lattice line is parallel to an edge of the square, so rings
/// about the mirror direction are sampled evenly.
fn quadrature(mut point: impl FnMut(f64, f64) -> Point) -> Vec<Point> {
    let weight = ((ROWS * ROWS) as f64).recip();
    let mut samples = Vec::with_capacity(ROWS * ROWS);
    for i in 0..ROWS {
        for j in 0..ROWS {
            let b = j as f64 + 0.5;
            let a = i as f64 + (b * 0.618_033_988_749_895).fract();
            let (wi, f) = point(a / ROWS as f64, b / ROWS as f64);
            if wi.z > 0.0 {
                samples.push((wi, f * weight));
            }
        }
    }
    samples
}

/// GGX with F = 1 by its microfacet normals m (Walter et al. 2007): D(m) (n.m) d omega_m is uniform in (q, phi) for
/// tan^2 theta_m = alpha^2 (1 - q) / q, and f cos theta_i d omega_i = D G2 (wo.m) / cos theta_o d omega_m. At grazing angles
/// a few of the steepest normals, q near 0, have large weights: q = a^3 samples them densely.
fn ggx_samples(alpha: f64, mu: f64) -> Vec<Point> {
    ggx_samples_of([alpha; 2], DVec2::X, mu)
}

/// The same with alphas along a direction of the surface and across it: for the slopes divided by them all stays as it is.
fn ggx_samples_of(alphas: [f64; 2], along: DVec2, mu: f64) -> Vec<Point> {
    let wo = view(mu);
    let across = along.perp();
    let lambda = |w: DVec3| {
        let (x, y) = (alphas[0] * w.truncate().dot(along), alphas[1] * w.truncate().dot(across));
        0.5 * ((1.0 + (x * x + y * y) / (w.z * w.z)).sqrt() - 1.0)
    };
    quadrature(|a, b| {
        let q = a * a * a;
        let slope = ((1.0 - q) / q).sqrt();
        let (sin_phi, cos_phi) = (2.0 * PI * b).sin_cos();
        let m =
            (along * (alphas[0] * slope * cos_phi) + across * (alphas[1] * slope * sin_phi)).extend(1.0).normalize();
        let dot = wo.dot(m);
        let wi = m * (2.0 * dot) - wo;
        let weight = 3.0 * a * a * dot / (mu * m.z) / (1.0 + lambda(wo) + lambda(wi));
        if dot > 0.0 { (wi, weight) } else { (DVec3::NEG_Z, 0.0) }
    })
}

/// Phong: cos^n about the mirror direction is uniform in (a, phi) for cos^(n + 1) = a.
fn phong_samples(n: f64, mu: f64) -> Vec<Point> {
    let (r, u) = frame(mu);
    quadrature(|a, b| {
        let cos = a.powf(1.0 / (n + 1.0));
        let sin = (1.0 - cos * cos).sqrt();
        let (sin_phi, cos_phi) = (2.0 * PI * b).sin_cos();
        let wi = r * cos + (u * cos_phi + DVec3::Y * sin_phi) * sin;
        (wi, (n + 2.0) / (n + 1.0) * wi.z)
    })
}

fn frame(mu: f64) -> (DVec3, DVec3) {
    let wo = view(mu);
    let r = DVec3::new(-wo.x, 0.0, wo.z);
    // Perpendicular to r, towards the normal.
    (r, (DVec3::Z - r * r.z + DVec3::X * if mu == 1.0 { 1.0 } else { 0.0 }).normalize())
}

/// A quadrature sorted into the texels of a kernel.
struct Exact {
    energy: f64,
    grazing: f64,
    /// Shares of the energy within beta and within the tail's ellipse, and of the core in the latter.
    cone: f64,
    captured: f64,
    core_share: f64,
    tail: Texels,
    core: Texels,
}

/// Energy in the texels of a part, and its moments, divided by its sum.
struct Texels {
    texture: Vec<f64>,
    moments: Moments,
}

/// Means of x, y, x^2 and y^2.
type Moments = [f64; 4];

impl Texels {
    /// Of a part of half width `width`, from the points' positions and weights.
    fn new(width: f64, aspect: f64, points: impl Iterator<Item = (DVec2, f64)>) -> Texels {
        let mut t = Texels { texture: vec![0.0; point().len()], moments: [0.0; 4] };
        let mut sum = 0.0;
        for (at, weight) in points {
            let (x, y) = (at.x / width, at.y / (width * aspect));
            if x.hypot(y) < 1.0 {
                let texel = |x: f64| ((x + 1.0) * (KERNEL_TEXELS / 2) as f64) as usize;
                t.texture[texel(y) * KERNEL_TEXELS + texel(x)] += weight;
                t.moments.iter_mut().zip([x, y, x * x, y * y]).for_each(|(m, x)| *m += weight * x);
                sum += weight;
            }
        }
        t.moments.iter_mut().chain(&mut t.texture).for_each(|m| *m /= sum);
        t
    }
}

fn exact(lobe: &Lobe, points: &[Point], mu: f64, kernel: &Kernel) -> Exact {
    let (r, u) = frame(mu);
    let wo = view(mu);
    let width = 2.0 * f64::from(kernel.tan_beta);
    let density = |wi: DVec3| f64::from(lobe.eval(wi.as_vec3(), wo.as_vec3())) * wi.z * wi.dot(r).powi(3);
    let rim = |k: usize| {
        let at = DVec2::from_angle(k as f64 * PI / 180.0) * (CORE_RADIUS * width);
        density((r + u * at.x + DVec3::Y * at.y).normalize())
    };
    let level = (0..360).map(rim).fold(0.0, f64::max);
    let (mut energy, mut grazing, mut cone, mut captured, mut core) = (0.0, 0.0, 0.0, 0.0, 0.0);
    // Position of each point, and its weights in core and tail.
    let mut seen = Vec::new();
    for &(wi, weight) in points {
        energy += weight;
        grazing += weight * (1.0 - (0.5 * (1.0 + wi.dot(wo))).sqrt()).powi(5);
        let cos = wi.dot(r);
        if cos > 0.0 {
            let at = DVec2::new(wi.dot(u), wi.y) / cos;
            let peak = if at.length() < CORE_RADIUS * width { (1.0 - level / density(wi)).max(0.0) } else { 0.0 };
            cone += if at.length() < 0.5 * width { weight } else { 0.0 };
            captured += if at.x.hypot(at.y / f64::from(kernel.tail.aspect())) < width { weight } else { 0.0 };
            core += weight * peak;
            seen.push((at, weight * peak, weight * (1.0 - peak)));
        }
    }
    let aspects = [&kernel.tail, &kernel.core].map(|part| f64::from(part.aspect()));
    Exact {
        energy,
        grazing,
        cone: cone / energy,
        captured: captured / energy,
        core_share: core / captured,
        tail: Texels::new(width, aspects[0], seen.iter().map(|&(at, _, tail)| (at, tail))),
        core: Texels::new(CORE_RADIUS * width, aspects[1], seen.iter().map(|&(at, core, _)| (at, core))),
    }
}

fn moments(texture: &[f32]) -> Moments {
    let mut sum = [0.0; 4];
    for (index, &texel) in texture.iter().enumerate() {
        let centre = |i: usize| (i as f64 + 0.5) / (KERNEL_TEXELS / 2) as f64 - 1.0;
        let (x, y) = (centre(index % KERNEL_TEXELS), centre(index / KERNEL_TEXELS));
        sum.iter_mut().zip([x, y, x * x, y * y]).for_each(|(m, x)| *m += f64::from(texel) * x);
    }
    sum
}

/// All values of a kernel against a quadrature of its lobe.
fn check(lobe: &Lobe, mu: f64, points: &[Point]) {
    let kernel = Kernel::new(lobe, mu);
    let expected = exact(lobe, points, mu, &kernel);
    let about = |found: f64, expected: f64, tolerance: f64, what: &str| {
        assert!((found - expected).abs() <= tolerance, "{lobe:?} at {mu}: {what} {found} for {expected}");
    };
    about(f64::from(kernel.energy), expected.energy, 5e-4 * expected.energy, "energy");
    about(f64::from(kernel.grazing), expected.grazing, 2e-3 * expected.grazing + 1e-6, "grazing");
    about(f64::from(kernel.captured), expected.captured, 2e-3, "captured");
    about(f64::from(kernel.core_share), expected.core_share, 5e-3, "share of the core");
    if f64::from(kernel.tan_beta) < MAX_TAN_BETA {
        about(CONE_SHARE, expected.cone, 2e-3, "share of the cone");
    } else {
        assert!(expected.cone < CONE_SHARE + 2e-3, "{lobe:?} at {mu}: {} within the widest cone", expected.cone);
    }
    let mut all_misplaced = 0.0;
    for (part, expected, what) in [(&kernel.tail, &expected.tail, "tail"), (&kernel.core, &expected.core, "core")] {
        about(part.texture.iter().map(|&t| f64::from(t)).sum(), 1.0, 1e-5, "sum");
        if what == "core" && kernel.core_share < 1e-3 {
            continue;
        }
        let misplaced: f64 =
            part.texture.iter().zip(&expected.texture).map(|(&a, b)| 0.5 * (f64::from(a) - b).abs()).sum();
        let share = if what == "core" { kernel.core_share } else { 1.0 - kernel.core_share };
        all_misplaced += misplaced * f64::from(share);
        // Means to a sixteenth of a texel, second moments to that of a point of light between two texels: a quarter of a texel squared.
        let texel = 2.0 / KERNEL_TEXELS as f64;
        let tolerances = [texel / 16.0, texel / 16.0, texel * texel / 4.0, texel * texel / 4.0];
        for ((found, expected), tolerance) in moments(&part.texture).iter().zip(expected.moments).zip(tolerances) {
            about(*found, expected, tolerance, what);
        }
    }
    assert!(all_misplaced < 0.01, "{lobe:?} at {mu}: {all_misplaced} of the kernel lies in wrong texels");
}

#[test]
fn kernels_of_two_widths_are_those_of_the_lobe() {
    for (alphas, azimuth) in [([0.3, 0.08], 0.6f32), ([0.04, 0.15], 0.0)] {
        let along = Vec3::new(azimuth.cos(), azimuth.sin(), 0.0);
        let alpha = pack(Vec2::from_array(alphas), along, Vec3::Z);
        let grain = unpack(alpha, Vec3::Z).unwrap();
        let lobe = Lobe::Anisotropic { alpha };
        for mu in [1.0, 0.7, 0.3] {
            let along = grain.along.as_dvec3().truncate();
            check(&lobe, mu, &ggx_samples_of(grain.alphas.as_dvec2().to_array(), along, mu));
        }
        let [kernel, image] = [&lobe, &lobe.mirrored()].map(|lobe| Kernel::new(lobe, 0.5));
        let apart = |a: &Part, b: &Part| a.texture.iter().zip(&b.texture).map(|(a, b)| (a - b).abs()).sum::<f32>();
        let image_of = kernel.mirrored();
        assert!(apart(&image_of.tail, &image.tail) < 1e-4 && apart(&image_of.core, &image.core) < 1e-4);
        assert!((kernel.tan_beta - image.tan_beta).abs() < 1e-5 && (kernel.energy - image.energy).abs() < 1e-5);
    }
}

#[test]
fn ggx_kernels_are_those_of_the_lobe() {
    for alpha in [MIN_ALPHA, 0.01, 0.1, 0.25, 0.5, 1.0] {
        for mu in [1.0, 0.7, 0.3, view_cosine(0)] {
            check(&Lobe::Ggx { alpha }, mu, &ggx_samples(f64::from(alpha), mu));
        }
    }
}

#[test]
fn phong_kernels_are_those_of_the_lobe() {
    for exponent in [1.0, 30.0, 1000.0, MAX_EXPONENT] {
        for mu in [1.0, 0.7, 0.3, view_cosine(0)] {
            check(&Lobe::Phong { exponent }, mu, &phong_samples(f64::from(exponent), mu));
        }
    }
    let head_on = Kernel::new(&Lobe::Phong { exponent: 30.0 }, 1.0);
    assert!((head_on.energy - 1.0).abs() < 1e-4, "{}", head_on.energy);
}

#[test]
fn ggx_reflects_no_more_than_it_receives_and_widens_with_alpha() {
    for layer in [0, 1, 3, 7, 15, 31] {
        let kernels: Vec<Kernel> = [MIN_ALPHA, 0.003, 0.01, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0]
            .iter()
            .map(|&alpha| Kernel::new(&Lobe::Ggx { alpha }, view_cosine(layer)))
            .collect();
        assert!(kernels.iter().all(|k| k.energy > 0.3 && k.energy <= 1.0 + 1e-4), "{layer}");
        let widest = |k: &Kernel| f64::from(k.tan_beta) == MAX_TAN_BETA;
        assert!(kernels.iter().all(|k| widest(k) || f64::from(k.captured) >= CONE_SHARE), "{layer}");
        assert!(kernels.iter().all(|k| k.captured > 0.0 && k.captured <= 1.0), "{layer}");
        let wider = |pair: &[Kernel]| pair[0].tan_beta < pair[1].tan_beta || widest(&pair[0]) && widest(&pair[1]);
        assert!(kernels.windows(2).all(wider), "{layer}");
    }
}

/// Slopes of the microfacets are distributed as tan^2 theta_m = alpha^2 a / (1 - a), and a mirror turns by twice their angle.
#[test]
fn cone_of_a_narrow_lobe_head_on() {
    let alpha = 0.01f64;
    let kernel = Kernel::new(&Lobe::Ggx { alpha: alpha as f32 }, 1.0);
    let expected = (2.0 * (alpha * (CONE_SHARE / (1.0 - CONE_SHARE)).sqrt()).atan()).tan();
    assert!((f64::from(kernel.tan_beta) / expected - 1.0).abs() < 2e-3, "{} for {expected}", kernel.tan_beta);
}

#[test]
fn symmetric_head_on_and_narrow_across_at_grazing_angles() {
    let lobe = Lobe::Ggx { alpha: 0.1 };
    let head_on = Kernel::new(&lobe, 1.0).core.texture;
    let at = |texture: &[f32], i: usize, j: usize| texture[j * KERNEL_TEXELS + i];
    let brightest = at(&head_on, KERNEL_TEXELS / 2, KERNEL_TEXELS / 2);
    for i in 0..KERNEL_TEXELS {
        for j in 0..KERNEL_TEXELS {
            let here = at(&head_on, i, j);
            // Mirrored in u, and turned by a right angle.
            for there in [at(&head_on, KERNEL_TEXELS - 1 - i, j), at(&head_on, j, i)] {
                assert!((here - there).abs() < 2e-3 * brightest, "{i} {j}: {here} {there}");
            }
        }
    }
    // Across the plane of incidence over along it, by standard deviations: as cos theta_o. Figures of the documentation.
    for (mu, expected) in [(1.0, 1.0), (0.9, 0.901), (0.5, 0.501), (0.2, 0.203)] {
        let core = Kernel::new(&Lobe::Ggx { alpha: 0.03 }, mu).core;
        let [x, y, xx, yy] = moments(&core.texture);
        let ratio = ((yy - y * y) / (xx - x * x)).sqrt() * f64::from(core.aspect());
        assert!((ratio - expected).abs() < 5e-3, "{mu}: {ratio}");
    }
}

/// A table of f at the given nodes.
fn tabulate(lobe: &Lobe, cos: &[f32], azimuths: usize) -> Lobe {
    // Squared towards pi, where the mirror direction is.
    let azimuth: Vec<f32> = (0..azimuths)
        .map(|k| {
            let t = 1.0 - k as f32 / (azimuths - 1) as f32;
            std::f32::consts::PI * (1.0 - t * t)
        })
        .collect();
    let direction = |cos: f32, azimuth: f32| {
        let sin = (1.0 - cos * cos).sqrt();
        Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
    };
    let mut values = Vec::new();
    for &i in cos {
        for &o in cos {
            values.extend(azimuth.iter().map(|&a| lobe.eval(direction(i, a), direction(o, 0.0))));
        }
    }
    Lobe::Table(Arc::new(Table::new(cos.to_vec(), cos.to_vec(), azimuth, values).unwrap()))
}

#[test]
fn table_of_a_lobe_has_its_kernels() {
    let lobe = Lobe::Ggx { alpha: 0.1 };
    // Even steps of the angle, from almost grazing.
    let cos: Vec<f32> = (0..96).map(|i| (1.57 * (1.0 - i as f32 / 95.0)).cos()).collect();
    let table = tabulate(&lobe, &cos, 64);
    for mu in [1.0, 0.6, 0.25] {
        let (expected, found) = (Kernel::new(&lobe, mu), Kernel::new(&table, mu));
        let difference: f32 = expected.core.texture.iter().zip(&found.core.texture).map(|(a, b)| (a - b).abs()).sum();
        assert!(difference < 0.02, "at {mu}: textures differ by {difference}");
        assert!((found.tan_beta / expected.tan_beta - 1.0).abs() < 0.01);
        assert!((found.energy / expected.energy - 1.0).abs() < 0.01);
    }
}

#[test]
fn lobe_without_light_at_its_mirror_direction() {
    let table = |values: Vec<f32>| {
        let azimuth = vec![0.0, 1.0, 1.1];
        // Towards the normal itself no azimuth is left out.
        let cosines = vec![0.5, 0.999];
        Lobe::Table(Arc::new(Table::new(cosines.clone(), cosines, azimuth, values.repeat(4)).unwrap()))
    };
    let black = Kernel::new(&table(vec![0.0; 3]), 0.5);
    assert_eq!((black.tan_beta, black.energy, black.captured), (0.0, 0.0, 0.0));
    assert_eq!(black.tail.texture.iter().sum::<f32>(), 1.0);
    // Purely retroreflective.
    let back = Kernel::new(&table(vec![0.9, 0.9, 0.0]), view_cosine(0));
    assert!(back.energy > 0.1 && back.captured < 1e-6, "{} {}", back.energy, back.captured);
    assert_eq!(f64::from(back.tan_beta), MAX_TAN_BETA);
    assert_eq!(back.tail.texture, black.tail.texture);
}

#[test]
fn library_shares_lobes_and_finds_layers() {
    let mut library = KernelLibrary::new();
    let (a, b) = (Lobe::Ggx { alpha: 0.2 }, Lobe::Phong { exponent: 50.0 });
    assert_eq!(library.add(3, a.clone()).unwrap(), 0);
    assert_eq!(library.add(1, b).unwrap(), VIEW_ANGLES as u32);
    assert_eq!(library.add(5, a.clone()).unwrap(), 0);
    assert_eq!((library.first_layer(5), library.first_layer(0), library.first_layer(9)), (Some(0), None, None));
    let gpu = library.to_gpu();
    assert_eq!(gpu.first_layer, [NO_KERNEL, 32, NO_KERNEL, 0, NO_KERNEL, 0]);
    assert_eq!(
        (gpu.layers.len(), gpu.textures.len()),
        (2 * VIEW_ANGLES, 4 * VIEW_ANGLES * KERNEL_TEXELS * KERNEL_TEXELS)
    );
    // The look-up at nodes, between them and at the ends.
    let layer = 40 - VIEW_ANGLES;
    let found = library.look_up(1, view_cosine(layer) as f32).unwrap();
    assert_eq!([found.tan_beta, found.energy, found.grazing, found.core_share], gpu.layers[40]);
    let texture = |i: usize| &gpu.textures[1024 * i..1024 * (i + 1)];
    let tail = layer + 2 * VIEW_ANGLES;
    assert_eq!((&found.nearest.tail.texture[..], &found.nearest.core.texture[..]), (texture(tail), texture(tail + 32)));
    assert_eq!(gpu.narrowings[tail], found.nearest.tail.narrowing);
    let between = library.look_up(3, (view_cosine(9) + 0.75 / 32.0) as f32).unwrap();
    let expected = 0.25 * gpu.layers[9][0] + 0.75 * gpu.layers[10][0];
    assert!((between.tan_beta - expected).abs() < 1e-6);
    assert_eq!(between.nearest, &library.layers()[10]);
    assert_eq!(library.look_up(3, 0.0).unwrap().energy, gpu.layers[0][1]);
    assert_eq!(library.look_up(3, 1.0).unwrap().energy, gpu.layers[31][1]);
    assert!(library.look_up(2, 0.5).is_none());
    // Half way between two layers: what interpolation costs.
    for i in 3..VIEW_ANGLES - 1 {
        let mu = 0.5 * (view_cosine(i) + view_cosine(i + 1));
        let (exact, found) = (Kernel::new(&a, mu), library.look_up(3, mu as f32).unwrap());
        assert!((found.tan_beta / exact.tan_beta - 1.0).abs() < 0.02, "{mu}");
        assert!((found.energy / exact.energy - 1.0).abs() < 0.005, "{mu}");
    }
}

#[test]
fn library_refuses_impossible_lobes() {
    let mut library = KernelLibrary::new();
    for (lobe, expected) in [
        (Lobe::Ggx { alpha: 0.0 }, "kernels of material 7: alpha of GGX is 0"),
        (Lobe::Ggx { alpha: f32::NAN }, "alpha of GGX is NaN"),
        (Lobe::Anisotropic { alpha: 0.5 }, "0.5 stands for no lobe of two widths"),
        (Lobe::Phong { exponent: 1e9 }, "the exponent of Phong is 1000000000"),
    ] {
        let refused = library.add(7, lobe).unwrap_err().to_string();
        assert!(refused.contains(expected), "{refused}");
    }
    assert!(library.layers().is_empty() && library.first_layer(7).is_none());
}
