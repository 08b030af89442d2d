use super::grid::{WIDE_NODES, interval};
use super::*;
use crate::bsdf::{Reflectance, pdf_specular};
use std::f32::consts::TAU;
use std::sync::Arc;

/// Steps of the angle, dense towards grazing; ends at both ends.
fn cosines(count: usize) -> Vec<f32> {
    (0..count).map(|i| (0.5 * PI * i as f32 / (count - 1) as f32).sin().min(1.0)).collect()
}

/// Dense towards the plane of mirror reflection.
fn azimuths(count: usize) -> Vec<f32> {
    (0..count).map(|i| PI * (1.0 - (1.0 - i as f32 / (count - 1) as f32).powi(2))).collect()
}

fn ggx(alpha: f32) -> Reflectance {
    Reflectance { kd: Vec3::ZERO, f0: Vec3::ONE, f90: 1.0, alpha }
}

fn ggx_table(alpha: f32, count: usize) -> Table {
    let f = |wi: Vec3, wo: Vec3| {
        let [wi, wo] = [wi, wo].map(|w| Vec3::new(w.x, w.y, w.z.max(1e-3)).normalize());
        ggx(alpha).eval_specular(&[], Vec3::Z, wi, wo).x
    };
    Table::tabulate(&cosines(count), &azimuths(count), f).unwrap()
}

/// A lobe about the direction that light comes from.
fn retro_reflective() -> Table {
    let f = |wi: Vec3, wo: Vec3| 0.8 * 12.0 / TAU * wi.dot(wo).max(0.0).powi(11);
    Table::tabulate(&cosines(33), &azimuths(33).into_iter().rev().map(|a| PI - a).collect::<Vec<_>>(), f).unwrap()
}

/// A material with it, and its white reflectance.
fn white(table: Table) -> (Vec<Material>, Reflectance) {
    let alpha = number(0, &table);
    (vec![Material { lobe: Some(Arc::new(table)), ..Material::default() }], ggx(alpha))
}

fn from(degrees: f32) -> Vec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    Vec3::new(sin, 0.0, cos)
}

fn message(result: Result<Table>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn values_are_trilinear_and_constant_beyond_their_ends() {
    // Symmetric, and the same for all azimuths towards the normal.
    let f = |a: f32, b: f32, c: f32| 0.02 + 0.03 * (a + b) + 0.05 * a * b + 0.01 * c * (1.0 - a) * (1.0 - b);
    let (cos, azimuth) = (vec![0.1, 0.3, 0.9, 1.0], vec![0.0, 0.5, 2.0, PI]);
    let mut values = Vec::new();
    for &a in &cos {
        for &b in &cos {
            values.extend(azimuth.iter().map(|&c| f(a, b, c)));
        }
    }
    let table = Table::new(cos.clone(), cos, azimuth, values).unwrap();
    // Multilinear functions are reproduced; the sign of the azimuth does not matter.
    for (a, b, c) in [(0.2, 0.5, 1.0), (0.7, 0.9, -2.5), (0.3, 0.2, 0.5), (0.5, 0.6, 3.1)] {
        let found = table.eval(direction(a, 0.7 + c), direction(b, 0.7));
        let expected = f(a, b, c.abs());
        assert!((found - expected).abs() < 1e-5, "{a} {b} {c}: {found} for {expected}");
    }
    let found = table.eval(direction(0.05, 1.0), direction(0.4, 0.0));
    assert!((found - f(0.1, 0.4, 1.0)).abs() < 1e-5, "{found}");
}

#[test]
fn axes_are_joined_and_exchanged_directions_reflect_alike() {
    // Other nodes of each axis, and a table that is the same both ways to a tenth.
    let f = |i: f32, o: f32, azimuth: f32| 0.05 + 0.04 * (i + 0.9 * o) * (2.0 - azimuth.cos());
    let (cos_i, cos_o, azimuth) = (vec![0.0, 0.35, 0.8, 1.0], vec![0.2, 0.5, 0.95], vec![0.0, 1.0, 3.0]);
    let mut values = Vec::new();
    for &i in &cos_i {
        for &o in &cos_o {
            values.extend(azimuth.iter().map(|&a| f(i, o, a)));
        }
    }
    let raw = Raw { cos_i: cos_i.clone(), cos_o: cos_o.clone(), azimuth: azimuth.clone(), values: values.clone() };
    let table = Table::new(cos_i, cos_o, azimuth, values).unwrap();
    assert_eq!(table.exact.cosines, [0.0, 0.2, 0.35, 0.5, 0.8, 0.95, 1.0]);
    assert_eq!(table.exact.azimuths, [0.0, 1.0, 3.0, PI]);
    for (a, b, c) in [(0.2, 0.5, 1.0), (0.7, 0.9, 2.5), (0.1, 0.6, 0.2)] {
        let found = table.eval(direction(a, c), direction(b, 0.0));
        let expected = 0.5 * (raw.at(a, b, c) + raw.at(b, a, c));
        assert!((found - expected).abs() < 2e-2 * expected, "{a} {b} {c}: {found} for {expected}");
        assert!((table.eval(direction(b, 0.0), direction(a, c)) - found).abs() < 1e-6);
    }
}

#[test]
fn unusable_tables_are_refused() {
    let one = || vec![0.5];
    assert!(message(Table::new(vec![], one(), one(), one())).contains("cos_i has no nodes"));
    assert!(message(Table::new(one(), vec![0.5, 0.5], one(), one())).contains("must increase"));
    assert!(message(Table::new(one(), one(), vec![-0.1], one())).contains("azimuth has a node at -0.1"));
    assert!(message(Table::new(vec![f32::NAN], one(), one(), one())).contains("cos_i has a node at NaN"));
    assert!(message(Table::new(one(), one(), one(), vec![1.0; 2])).contains("2 values for 1 x 1 x 1 nodes"));
    let values = vec![1.0, 1.0, f32::INFINITY, 1.0];
    let refused = message(Table::new(vec![0.1, 0.2], one(), vec![0.3, 0.4], values));
    assert!(refused.contains("value 2, at cos_i 0.2, cos_o 0.5, azimuth 0.3, is inf"), "{refused}");
    assert!(message(Table::new(one(), one(), one(), vec![-1.0])).contains("not negative"));
    // A constant f reflects pi f.
    let refused = message(Table::new(one(), one(), one(), vec![0.5]));
    assert!(refused.contains("light from cosine 1 (0 degrees from the normal) is reflected 1.571 times"), "{refused}");
    // Light goes one way only.
    let refused = message(Table::new(vec![0.0, 1.0], one(), one(), vec![0.0, 0.3]));
    assert!(refused.contains("exchanged directions differ by") && refused.contains("cosines"), "{refused}");
    let many: Vec<f32> = (0..300).map(|i| i as f32 / 300.0).collect();
    let refused = message(Table::new(many.clone(), one(), one(), vec![0.1; 300]));
    assert!(refused.contains("301 different cosines and 3 azimuths; there may be 256"), "{refused}");
}

#[test]
fn albedos_just_above_one_are_lowered() {
    let table = Table::new(vec![0.5], vec![0.5], vec![0.5], vec![1.03 / PI]).unwrap();
    let albedos = table.exact.albedos();
    assert!(albedos.iter().all(|albedo| (albedo - 1.0).abs() < 1e-4), "{albedos:?}");
    let table = Table::new(vec![0.5], vec![0.5], vec![0.5], vec![0.0]).unwrap();
    assert!(table.exact.albedos().iter().all(|albedo| *albedo == 0.0));
    assert_eq!(table.exact.pdf(Vec3::Z, Vec3::Z, from(30.0)), 0.0);
    assert!(table.exact.sample(Vec3::Z, from(30.0), [0.3, 0.7]).is_finite());
}

#[test]
fn tables_are_read_from_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lobe.toml");
    let good = "cos_i = [0, 1]\ncos_o = [0, 1]\nazimuth = [0, 3.141592653589793]\nvalues = [0.1, 0.2, 0.2, 0.2, 0.2, 0.2, 0.3, 0.3]\n";
    std::fs::write(&path, good).unwrap();
    let table = Table::load(&path).unwrap();
    let values = vec![0.1, 0.2, 0.2, 0.2, 0.2, 0.2, 0.3, 0.3];
    assert_eq!(table, Table::new(vec![0.0, 1.0], vec![0.0, 1.0], vec![0.0, PI], values).unwrap());
    for (text, expected) in [
        (good.replace("cos_o", "cos_x"), "lobe.toml:2: unknown field `cos_x`"),
        (good.replace("[0.1", "[-0.1"), "lobe.toml: value 0"),
        (good.replace("0.3", "0.9"), "lobe.toml: light from cosine 1 (0 degrees from the normal) is reflected"),
    ] {
        std::fs::write(&path, text).unwrap();
        let refused = message(Table::load(&path));
        assert!(refused.contains(expected), "{refused}");
    }
    assert!(message(Table::load(&folder.path().join("none.toml"))).contains("reading failed"));
}

#[test]
fn a_furnace_keeps_its_light_and_samples_have_their_density() {
    for (name, table, albedo) in
        [("GGX", ggx_table(0.3, 33), None), ("retro-reflective", retro_reflective(), Some(0.8))]
    {
        let expected: Vec<f64> = table.exact.albedos();
        let cosines = table.exact.cosines.clone();
        let (materials, r) = white(table);
        for degrees in [0.0, 20.0, 40.0, 60.0, 75.0, 88.0] {
            let wo = from(degrees);
            let n = 256;
            let (mut sampled, mut integrated, mut density) = (0.0, 0.0, 0.0);
            for i in 0..n * n {
                let u = [i % n, i / n].map(|k| (k as f32 + 0.5) / n as f32);
                let (wi, weight) = r.sample_lobe(&materials, false, Vec3::Z, wo, u[0], u[1]);
                assert!(wi.z >= 0.0 && (wi.length() - 1.0).abs() < 1e-4 && weight.x <= 1.001, "{name}: {wi} {weight}");
                sampled += f64::from(weight.x);
                // Even in the square root of the sine towards grazing, and in the azimuth.
                let wi = direction(u[0] * u[0], TAU * u[1]);
                let solid_angle = 2.0 * f64::from(u[0]) * 2.0 * std::f64::consts::PI;
                let f = r.eval_specular(&materials, Vec3::Z, wi, wo).x;
                integrated += f64::from(f * wi.z) * solid_angle;
                density += f64::from(pdf_specular(&materials, Vec3::Z, wi, wo, r.alpha)) * solid_angle;
                let exchanged = r.eval_specular(&materials, Vec3::Z, wo, wi).x;
                assert!((f - exchanged).abs() <= 1e-3 * f.max(1e-3), "{name}: {f} and {exchanged}");
            }
            let [sampled, integrated, density] = [sampled, integrated, density].map(|sum| sum / f64::from(n * n));
            let (k, t) = interval(&cosines, wo.z);
            let closed = expected[k] + (expected[k + 1] - expected[k]) * f64::from(t);
            println!("{name}, {degrees} degrees: {sampled:.4} {integrated:.4} {closed:.4}, density {density:.4}");
            assert!(
                (sampled - closed).abs() < 4e-3 && (integrated - closed).abs() < 6e-3,
                "{name}: {sampled} {integrated} {closed}"
            );
            assert!((density - 1.0).abs() < 6e-3, "{name}, {degrees} degrees: {density}");
            assert!(sampled < 1.001, "{name}: {sampled}");
            // f = 12 / 2 pi cos^11 about wo, a part of which the horizon cuts off.
            assert!(
                degrees > 0.0 || albedo.is_none_or(|albedo| (sampled - albedo * 12.0 / 13.0).abs() < 0.01),
                "{sampled}"
            );
            let sample = |u| r.sample_of_lobe(&materials, Vec3::Z, wo, u);
            let pdf = |wi| pdf_specular(&materials, Vec3::Z, wi, wo, r.alpha);
            if degrees < 80.0 {
                crate::bsdf::tests::check_sampling(name, sample, pdf);
            }
        }
    }
}

#[test]
fn a_table_of_ggx_is_ggx() {
    for (alpha, count) in [(0.3, 33), (0.5, 33), (0.15, 65)] {
        let table = ggx_table(alpha, count);
        assert!((table.alpha() / alpha - 1.0).abs() < 0.1, "width {} of alpha {alpha}", table.alpha());
        assert!(alpha > 0.3 || table.image_share() > 0.9, "{}", table.image_share());
        let (materials, r) = white(table);
        for degrees in [0.0, 30.0, 60.0, 75.0] {
            let wo = from(degrees);
            let found = r.lobe_albedo(&materials, Vec3::Z, wo);
            // Midpoints of the cosine and of the azimuth on one side.
            let n = 400;
            let part = |i: usize| {
                let [cos, turn] = [i / n, i % n].map(|k| (k as f32 + 0.5) / n as f32);
                f64::from(ggx(alpha).eval_specular(&[], Vec3::Z, direction(cos, PI * turn), wo).x * cos)
            };
            let expected = ((0..n * n).map(part).sum::<f64>() / (n * n) as f64 * 2.0 * std::f64::consts::PI) as f32;
            println!("alpha {alpha}, {degrees} degrees: {found:.4} for {expected:.4}");
            assert!((found / expected - 1.0).abs() < 0.01, "alpha {alpha}, {degrees}: {found} for {expected}");
        }
    }
}

#[test]
fn numbers_hold_tables_and_their_widths() {
    for (material, table) in
        [(0, ggx_table(0.3, 17)), (7, retro_reflective()), (MAX_MATERIALS as u32 - 1, ggx_table(0.12, 65))]
    {
        let alpha = number(material, &table);
        assert!(is_table(alpha) && !anisotropic::is_anisotropic(alpha), "{alpha}");
        assert!((width_of(alpha) / table.alpha() - 1.0).abs() < 0.008);
        let mut materials = vec![Material::default(); material as usize + 1];
        materials[material as usize].lobe = Some(Arc::new(table.clone()));
        assert_eq!(find(&materials, alpha), Some(&table.exact));
        let wide = widened(alpha, MIN_LIGHT_ALPHA);
        assert!(is_table(wide));
        assert_eq!(find(&materials, wide), Some(table.grids()[1]));
        assert!((width_of(wide) - table.alpha().max(MIN_LIGHT_ALPHA)).abs() < 0.005, "{}", width_of(wide));
        assert_eq!(widened(wide, MIN_LIGHT_ALPHA), wide);
    }
    assert!([1e-3, 0.5, 1.0, -1.0, -1e4, 2.0, 1e9].iter().all(|alpha| !is_table(*alpha)));
    assert_eq!(find(&[], f32::from_bits(BASE + 1)), None);
}

#[test]
fn lobes_of_lights_are_as_wide_as_they_must_be_and_keep_their_energy() {
    for (table, wide) in [(ggx_table(0.3, 33), false), (ggx_table(0.1, 96), true)] {
        let (materials, r) = white(table);
        for degrees in [0.0, 40.0, 70.0] {
            let n = Vec3::Z;
            let widened = r.widened(&materials, n, from(degrees), MIN_LIGHT_ALPHA);
            assert_eq!(widened != r, wide);
            let [before, after] = [r, widened].map(|r| r.lobe_albedo(&materials, n, from(degrees)));
            assert!((after / before - 1.0).abs() < 0.02, "{degrees} degrees: {after} for {before}");
            if wide {
                // Of GGX of that alpha, which is widened likewise.
                let usual = ggx(0.1).widened(&[], n, from(degrees), MIN_LIGHT_ALPHA);
                let mirrored = from(-degrees);
                let [found, expected] =
                    [widened, usual].map(|r| r.eval_specular(&materials, n, mirrored, from(degrees)).x);
                println!("{degrees} degrees: peak {found:.3}, of GGX {expected:.3}");
                // The kernel is as wide across the plane of incidence as along it, where GGX is narrower by the cosine.
                let least = 0.85 * from(degrees).z;
                assert!((least..1.3).contains(&(found / expected)), "{degrees} degrees: {found} for {expected}");
                let grid = materials[0].lobe.as_ref().unwrap().grids()[1];
                assert!((0.8..1.25).contains(&(grid.width() / MIN_LIGHT_ALPHA)), "{}", grid.width());
            }
        }
    }
}

#[test]
fn a_lobe_back_to_the_light_shows_no_mirror_image() {
    let table = retro_reflective();
    assert!(table.image_share() < 0.7, "{}", table.image_share());
    assert!((0.2..0.5).contains(&table.alpha()), "{}", table.alpha());
}

#[test]
fn words_begin_with_the_places_of_tables() {
    let table = Arc::new(ggx_table(0.1, 96));
    let with = |lobe: Option<&Arc<Table>>| Material { lobe: lobe.cloned(), ..Material::default() };
    let materials = [with(None), with(Some(&table)), with(Some(&table)), with(None)];
    let words = words(&materials);
    assert_eq!(words[2..4], words[4..6]);
    let [first, wide] = [words[2], words[3]].map(|at| &words[at as usize..]);
    assert_eq!((first[0], first[1]), (96, 96));
    assert_eq!((wide[0], wide[1]), (WIDE_NODES as u32, WIDE_NODES as u32));
    assert_eq!(f32::from_bits(first[2 + 95]), 1.0);
    let after = |grid: &[u32]| 2 + grid[0] + grid[1] + 2 * grid[0] * grid[0] * grid[1] + grid[0] * grid[0];
    assert_eq!(words[2] + after(first), words[3]);
    assert_eq!(words[3] + after(wide), words.len() as u32);
    assert_eq!(super::words(&[with(None)]), [0; 4]);
}
