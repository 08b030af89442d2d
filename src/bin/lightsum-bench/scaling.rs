//! `scaling`: cost of a frame of the generated room for growing numbers of triangles, lights or pixels.

use crate::args::{MAX_PIXELS, Scaling, Series};
use crate::passes::Passes;
use crate::report::{self, Fields, Table, milliseconds, percent};
use crate::scene;
use lightsum::accel::Bvh;
use lightsum::gpu::Context;
use lightsum::scene::Scene;
use lightsum::settings::Settings;
use lightsum::{Error, Renderer, Result};
use serde_json::{Value, json};
use std::time::Instant;

/// Approximate number of triangles of the room in the first series.
const TRIANGLES: [u32; 7] = [1_000, 4_000, 16_000, 64_000, 256_000, 1_000_000, 4_000_000];
/// Triangles of the room in the other two series.
const ROOM: u32 = 64_000;
/// Building is repeated only if it took less than this, in seconds.
const BUILDING: f64 = 1.0;

/// One measurement of a series.
struct Point {
    /// Triangles requested of the room.
    triangles: u32,
    particles: u32,
    resolution: [u32; 2],
}

/// Times to build the hierarchy over a scene, measured when the scene is new.
struct Built {
    triangles: u32,
    scene: Scene,
    seconds: Vec<f64>,
}

/// Runs the command. A point beyond the limits of the device is printed as refused and the others are still measured; the
/// command then fails with the first refusal.
pub fn run(args: &Scaling) -> Result<()> {
    let all = [Series::Triangles, Series::Lights, Series::Resolution];
    let chosen = if args.series.is_empty() { &all[..] } else { &args.series };
    let [width, height] = args.common.resolution;
    if chosen.contains(&Series::Resolution) && 4 * u64::from(width) * u64::from(height) > MAX_PIXELS {
        let message =
            format!("{width}x{height}: the series ends at twice the size, which is more than {MAX_PIXELS} pixels");
        return Err(Error::Setting { name: "--resolution", message });
    }
    let context = scene::open(&args.common)?;
    let environment = report::environment(context.info());
    if !args.common.json {
        report::print_environment(&environment)?;
    }
    let mut refusal = Ok(());
    for &series in chosen {
        let table = match args.common.json {
            true => None,
            false => Some(head(series)?),
        };
        let mut built: Option<Built> = None;
        for point in points(args, series) {
            let measured = match measure(&context, args.common.repeats, &point, &mut built) {
                Ok(measured) => measured,
                Err(error) if is_refusal(&error) => {
                    let text = error.to_string();
                    refusal = refusal.and(Err(error));
                    report::fields(json!({ "error": text }))
                }
                Err(error) => return Err(error),
            };
            match &table {
                Some(table) => row(table, series, &point, &measured)?,
                None => {
                    let mut line = report::fields(json!({
                        "mode": "scaling",
                        "series": name(series),
                        "scene": format!("room:{}", point.triangles),
                        "particles": point.particles,
                        "resolution": point.resolution,
                    }));
                    line.extend(measured);
                    report::print_json(Value::Object(line), &environment)?;
                }
            }
        }
    }
    refusal
}

fn name(series: Series) -> &'static str {
    match series {
        Series::Triangles => "triangles",
        Series::Lights => "lights",
        Series::Resolution => "resolution",
    }
}

/// The points of a series, in increasing order.
fn points(args: &Scaling, series: Series) -> Vec<Point> {
    let resolution = args.common.resolution;
    let particles = Settings::default().particles.min(args.max_particles);
    let triangles = ROOM.min(args.max_triangles);
    match series {
        Series::Triangles => {
            let within = TRIANGLES.into_iter().filter(|&n| n < args.max_triangles);
            // The maximum ends the series, whether the list is longer or shorter.
            within.chain([args.max_triangles]).map(|triangles| Point { triangles, particles, resolution }).collect()
        }
        Series::Lights => {
            let powers = (0..=16).map(|k| 1 << k).take_while(|&particles| particles <= args.max_particles);
            powers.map(|particles| Point { triangles, particles, resolution }).collect()
        }
        Series::Resolution => {
            let scaled = |k: u32| resolution.map(|side| (side * k / 4).max(1));
            [1, 2, 4, 8].map(|k| Point { triangles, particles, resolution: scaled(k) }).into()
        }
    }
}

/// Whether the error is a limit of the device rather than a mistake.
fn is_refusal(error: &Error) -> bool {
    matches!(error, Error::DeviceLimit { .. } | Error::OutOfMemory { .. })
}

/// Measures a point; `built` keeps the scene for the next one.
fn measure(context: &Context, repeats: u32, point: &Point, built: &mut Option<Built>) -> Result<Fields> {
    let kept = built.take().filter(|built| built.triangles == point.triangles);
    let built = built.insert(match kept {
        Some(kept) => kept,
        None => build(point.triangles, repeats)?,
    });
    let camera = scene::camera(&built.scene, point.resolution);
    // All lights light all points, so that rays grow with them.
    let (particles, all) = (point.particles, Some(point.particles));
    let settings = Settings { light_pool: 0, particles, direct_lights: all, ..Settings::default() };
    let mut renderer = Renderer::with_context(context.clone(), built.scene.clone(), camera, settings)?;
    let passes = Passes::measure(&mut renderer, repeats)?;
    let mut fields = passes.fields(&format!("room:{}", point.triangles), &renderer);
    fields.insert("bvh".into(), report::summary(&built.seconds));
    Ok(fields)
}

fn build(triangles: u32, repeats: u32) -> Result<Built> {
    let scene = scene::load(&format!("room:{triangles}"))?;
    let mut seconds: Vec<f64> = Vec::new();
    while seconds.len() < repeats as usize && seconds.iter().sum::<f64>() < BUILDING {
        let start = Instant::now();
        Bvh::build(&scene)?;
        seconds.push(start.elapsed().as_secs_f64());
    }
    Ok(Built { triangles, scene, seconds })
}

fn head(series: Series) -> Result<Table> {
    report::say("")?;
    let columns = [("frame ms", 9), ("+-", 5), ("M rays/s", 8), ("BVH ms", 8), ("scene MiB", 9), ("kernel", 7)];
    Table::head(&[&[(name(series), 10)], &columns[..]].concat())
}

fn row(table: &Table, series: Series, point: &Point, measured: &Fields) -> Result<()> {
    let [width, height] = point.resolution;
    let first = match series {
        // The room has somewhat fewer triangles than requested.
        Series::Triangles => measured.get("triangles").map_or(point.triangles.to_string(), Value::to_string),
        Series::Lights => measured.get("lights").map_or(format!("{} particles", point.particles), Value::to_string),
        Series::Resolution => format!("{width}x{height}"),
    };
    if let Some(error) = measured.get("error").and_then(Value::as_str) {
        return report::say(&format!("{first:10}  refused: {error}"));
    }
    let number = |value: Option<&Value>| value.and_then(Value::as_f64).unwrap_or(f64::NAN);
    let bvh = measured.get("bvh").and_then(|bvh| bvh.get("median_seconds"));
    table.row(&[
        first,
        milliseconds(number(measured.get("median_seconds"))),
        percent(number(measured.get("spread"))),
        format!("{:.2}", 1e-6 * number(measured.get("rays_per_second"))),
        milliseconds(number(bvh)),
        format!("{:.1}", number(measured.get("scene_bytes")) / f64::from(1 << 20)),
        measured.get("kernel").and_then(Value::as_str).unwrap_or_default().to_owned(),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::{Arguments, Command};
    use clap::Parser;

    fn series(line: &str, series: Series) -> Vec<(u32, u32, [u32; 2])> {
        let arguments = Arguments::try_parse_from(["bench", "scaling"].into_iter().chain(line.split_whitespace()));
        let Ok(Arguments { command: Command::Scaling(args) }) = arguments else { panic!("{line}") };
        points(&args, series).into_iter().map(|p| (p.triangles, p.particles, p.resolution)).collect()
    }

    #[test]
    fn series_grow_to_their_ends() {
        let triangles = |line: &str| series(line, Series::Triangles).into_iter().map(|p| p.0).collect::<Vec<_>>();
        assert_eq!(triangles(""), TRIANGLES);
        assert_eq!(triangles("--max-triangles 16000"), [1_000, 4_000, 16_000]);
        assert_eq!(triangles("--max-triangles 5000"), [1_000, 4_000, 5_000]);
        assert_eq!(triangles("--max-triangles 300"), [300]);
        let lights = series("--max-triangles 500", Series::Lights);
        assert_eq!(lights.iter().map(|p| p.1).collect::<Vec<_>>(), [1, 2, 4, 8, 16, 32, 64, 128, 256]);
        assert!(lights.iter().all(|p| (p.0, p.2) == (500, [640, 480])));
        let pixels = series("--max-particles 4", Series::Resolution);
        assert_eq!(pixels.iter().map(|p| p.2).collect::<Vec<_>>(), [[160, 120], [320, 240], [640, 480], [1280, 960]]);
        assert!(pixels.iter().all(|p| (p.0, p.1) == (ROOM, 4)));
        assert_eq!(series("--resolution 3x5", Series::Resolution)[0].2, [1, 1]);
    }

    #[test]
    fn limits_are_refusals_and_mistakes_are_not() {
        let limit = Error::DeviceLimit {
            resource: "scene wide nodes".into(),
            bytes: 2,
            limit: 1,
            limit_name: "maxStorageBufferRange",
            advice: "simplify the scene",
        };
        assert!(is_refusal(&limit));
        assert!(is_refusal(&Error::OutOfMemory { resource: "rays".into(), bytes: Some(1) }));
        assert!(!is_refusal(&Error::Scene("no light".into())));
    }
}
