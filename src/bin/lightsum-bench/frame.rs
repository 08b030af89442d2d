//! `frame`: time of each GPU pass and of the whole frame, for scenes and settings.

use crate::args::Frame;
use crate::passes::{Passes, kernel};
use crate::report::{self, Table, milliseconds, percent};
use crate::scene;
use lightsum::settings::{Compensation, Settings, Splats, Superposition};
use lightsum::{Renderer, Result};
use serde_json::Value;

/// Runs the command.
pub fn run(args: &Frame) -> Result<()> {
    scene::check(&args.scenes)?;
    let context = scene::open(&args.common)?;
    let environment = report::environment(context.info());
    if !args.common.json {
        report::print_environment(&environment)?;
    }
    for name in &args.scenes {
        let scene = scene::load(name)?;
        let camera = scene::camera(&scene, args.common.resolution);
        let base = if args.interactive {
            Settings::interactive()
        } else {
            Settings::default().with_scene_defaults(&scene.render)
        };
        for settings in combinations(args, base) {
            let make = if args.dynamic { Renderer::with_context_dynamic } else { Renderer::with_context };
            let mut renderer = make(context.clone(), scene.clone(), camera, settings)?;
            let passes = Passes::measure(&mut renderer, args.common.repeats)?;
            if args.common.json {
                let mut line = passes.fields(name, &renderer);
                line.insert("mode".into(), "frame".into());
                line.insert("dynamic".into(), args.dynamic.into());
                report::print_json(Value::Object(line), &environment)?;
            } else {
                print(name, &renderer, &passes)?;
            }
        }
    }
    Ok(())
}

/// Every combination of the flags' values; a missing flag keeps the value in `base`.
fn combinations(args: &Frame, base: Settings) -> Vec<Settings> {
    fn each<T: Copy>(list: Vec<Settings>, values: &[T], set: impl Fn(&mut Settings, T)) -> Vec<Settings> {
        if values.is_empty() {
            return list;
        }
        let with = |settings: &Settings, value: T| {
            let mut settings = settings.clone();
            set(&mut settings, value);
            settings
        };
        list.iter().flat_map(|settings| values.iter().map(|&value| with(settings, value))).collect()
    }
    let compensation = if args.no_compensation { Compensation::Off } else { base.compensation };
    let list = vec![Settings { compensation, ..base }];
    let list = each(list, &args.particles, |s, v| s.particles = v);
    let list = each(list, &args.max_depth, |s, v| s.max_depth = v);
    let list = each(list, &args.shading_rate, |s, v| s.shading_rate = v);
    let list = each(list, &args.lights_per_dispatch, |s, v| s.lights_per_dispatch = v);
    let list = each(list, &args.traversal, |s, v| s.traversal = v);
    let list = each(list, &args.cluster_order, |s, v| s.cluster_order = v);
    let list = each(list, &args.splats, |s, particles| {
        s.splats = Some(Splats { particles, ..s.splats.unwrap_or_default() });
    });
    each(list, &args.reflectors, |s, reflectors| {
        s.superposition = Some(Superposition { reflectors, ..s.superposition.unwrap_or_default() });
    })
}

fn print(name: &str, renderer: &Renderer, passes: &Passes) -> Result<()> {
    let engine = renderer.engine();
    let p = engine.plan();
    let ([width, height], s) = (p.view.size(), &p.settings);
    report::say("")?;
    report::say(&format!(
        "{name}: {} triangles, {width}x{height}, {} lights of {} paths, depth {}{}{}, {} lights a dispatch, kernel {}",
        engine.bvh().triangle_count(),
        p.lights.slots(),
        s.particles,
        s.max_depth,
        match s.compensation {
            Compensation::Off => ", no compensation",
            Compensation::Near => ", near compensation",
            Compensation::Exact => "",
        },
        s.superposition.map_or(String::new(), |s| format!(", up to {} reflectors", s.reflectors))
            + &s.splats.map_or(String::new(), |s| format!(", splats of {} particles", s.particles)),
        s.lights_per_dispatch,
        kernel(renderer),
    ))?;
    let frame = report::median(&passes.seconds);
    let table = Table::head(&[("pass", 19), ("median ms", 9), ("+-", 5), ("of frame", 8)])?;
    let gpu = passes.gpu.iter().map(|(name, seconds)| (name.as_str(), seconds));
    for (name, seconds) in gpu.chain([("whole frame", &passes.seconds)]) {
        let median = report::median(seconds);
        let cells = [name.to_owned(), milliseconds(median), percent(report::spread(seconds)), percent(median / frame)];
        table.row(&cells)?;
    }
    report::say(&format!(
        "{:.2} M rays/s; sort and clusters are parts of eye and gather, near_* of near_light, upsample_* of upsample",
        passes.rays_per_second() * 1e-6
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::{Arguments, Command};
    use clap::Parser;
    use lightsum::settings::Traversal;

    fn chosen(line: &str, base: Settings) -> Vec<Settings> {
        let arguments = Arguments::try_parse_from(["bench", "frame"].into_iter().chain(line.split_whitespace()));
        let Ok(Arguments { command: Command::Frame(args) }) = arguments else { panic!("{line}") };
        combinations(&args, base)
    }

    #[test]
    fn every_combination_once() {
        let base = Settings { particles: 7, seed: 3, ..Settings::default() };
        assert_eq!(chosen("", base.clone()), vec![base.clone()]);
        let list = chosen("--particles 1,2 --traversal single,auto --max-depth 4 --no-compensation", base.clone());
        let key = |s: &Settings| (s.particles, s.traversal, s.max_depth, s.compensation, s.seed);
        let expected = [
            (1, Traversal::Single, 4, Compensation::Off, 3),
            (1, Traversal::Auto, 4, Compensation::Off, 3),
            (2, Traversal::Single, 4, Compensation::Off, 3),
            (2, Traversal::Auto, 4, Compensation::Off, 3),
        ];
        assert_eq!(list.iter().map(key).collect::<Vec<_>>(), expected);
        // The scene's own settings stay where no flag is given.
        let without = Settings { compensation: Compensation::Off, ..base };
        assert_eq!(
            chosen("--lights-per-dispatch 16", without.clone()),
            [Settings { lights_per_dispatch: 16, ..without }]
        );
    }
}
