//! `compare`: Embree and each kernel in turn on the same rays.

use crate::args::Compare;
use crate::scratch::Scratch;
use crate::shadow_rays::Bench;
use crate::{report, scene};
use lightsum::settings::Traversal;
use lightsum::{Error, Result};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;

/// Result of Embree with packets of one size.
struct Peer {
    packet: u64,
    segments: u64,
    visible: u64,
    rates: Vec<f64>,
}

/// Runs the command.
pub fn run(args: &Compare) -> Result<()> {
    scene::check(&args.rays.scenes)?;
    let own = Scratch::new()?;
    let dir = args.rays.dump_rays.as_deref().unwrap_or(own.path());
    args.rays.scenes.iter().try_for_each(|scene| compare(args, scene, dir))
}

fn compare(args: &Compare, scene: &str, dir: &Path) -> Result<()> {
    let rays = crate::args::ShadowRays { dump_rays: Some(dir.to_path_buf()), ..args.rays.clone() };
    let bench = Bench::new(&rays, scene)?;
    let environment = report::environment(bench.context.info());
    let traversals = bench.traversals();
    let mut ours: Vec<(Traversal, &'static str, u64, Vec<f64>)> =
        traversals.iter().map(|&t| (t, "", 0, Vec::new())).collect();
    let mut peers: Vec<Peer> = Vec::new();
    for _ in 0..args.turns {
        peer(&args.embree, dir, &mut peers)?;
        for (traversal, kernel, visible, rates) in &mut ours {
            let measured = bench.measure(*traversal, args.rays.common.repeats)?;
            (*kernel, *visible) = (measured.kernel, measured.visible);
            rates.push(bench.segments as f64 / report::median(&measured.times) * 1e-6);
        }
    }
    let best = peers.iter().max_by(|a, b| report::median(&a.rates).total_cmp(&report::median(&b.rates)));
    let best = best.ok_or_else(|| Error::file(&args.embree, "printed no measurement"))?;
    let turns = |rates: &[f64]| rates.iter().map(|r| (r * 100.0).round() / 100.0).collect::<Vec<_>>();
    for (_, kernel, visible, rates) in &ours {
        let ratios: Vec<f64> = rates.iter().zip(&best.rates).map(|(a, b)| a / b).collect();
        let line = json!({
            "mode": "compare",
            "scene": scene,
            "kernel": kernel,
            "segments": bench.segments,
            "visible": visible,
            "mega_segments_per_second": report::median(rates),
            "turns": turns(rates),
            "embree_packet": best.packet,
            "embree_segments": best.segments,
            "embree_visible": best.visible,
            "embree_mega_segments_per_second": report::median(&best.rates),
            "embree_turns": turns(&best.rates),
            "ratio": report::median(&ratios),
        });
        if args.rays.common.json {
            report::print_json(line, &environment)?;
        } else {
            report::say(&format!(
                "{scene}: {kernel} {:.2} M/s, Embree in packets of {} {:.2} M/s: ratio {:.3}  (visible {visible} and {} of {} and {})",
                report::median(rates),
                best.packet,
                report::median(&best.rates),
                report::median(&ratios),
                best.visible,
                bench.segments,
                best.segments,
            ))?;
        }
    }
    for other in &peers {
        let rates = turns(&other.rates);
        report::say_aside(&format!("{scene}: Embree, packets of {:2}: {rates:?} M/s", other.packet));
    }
    Ok(())
}

/// Runs the peer once and adds its results.
fn peer(program: &Path, dir: &Path, peers: &mut Vec<Peer>) -> Result<()> {
    let output = Command::new(program).arg(dir).output().map_err(Error::io("running", program))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        return Err(Error::file(program, format!("failed ({}): {}", output.status, said.trim())));
    }
    for line in String::from_utf8_lossy(&output.stdout).lines().filter(|line| !line.trim().is_empty()) {
        let value: Value =
            serde_json::from_str(line).map_err(|e| Error::file(program, format!("printed {line:?}: {e}")))?;
        let number = |key: &str| value.get(key).and_then(Value::as_f64);
        let (Some(packet), Some(segments), Some(visible), Some(rate)) = (
            number("packet"),
            number("segments"),
            number("visible"),
            number("mega_segments_per_second").filter(|&rate| rate > 0.0),
        ) else {
            return Err(Error::file(program, format!("printed {line:?}, which lacks a measurement")));
        };
        let (packet, segments, visible) = (packet as u64, segments as u64, visible as u64);
        match peers.iter_mut().find(|p| p.packet == packet) {
            Some(peer) => peer.rates.push(rate),
            None => peers.push(Peer { packet, segments, visible, rates: vec![rate] }),
        }
    }
    Ok(())
}
