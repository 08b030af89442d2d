//! Tells of flags that have no effect.

use std::path::PathBuf;

use lightsum::output::Format;
use lightsum::scene::{Camera, Scene, Surface};
use lightsum::settings::keys::Key;
use lightsum::settings::{
    Agreement, Compensation, Exposure, LightChoice, MirrorForm, RenderDefaults, Settings, Spread, Traversal,
};

use crate::args::{self, Curve};

/// Warns of each setting of the command line that has no effect on the rendering of a scene.
pub fn warn(given: &RenderDefaults, settings: &Settings, scene: &Scene) {
    for (flag, reason) in without_effect(given, settings, scene) {
        log::warn!("{flag} has no effect: {reason}");
    }
}

/// Warns of an exposure or a curve where no output takes them.
pub fn warn_display(exposure: Option<Exposure>, curve: Curve, outputs: &[PathBuf]) {
    for flag in without_display(exposure, curve, outputs) {
        log::warn!("{flag} has no effect: no output is a PNG file, and EXR files hold radiance as it is");
    }
}

/// Warns of flags of `render` that its outputs, its camera or what it renders do not take. `moves`: something moves while the shutter is open.
pub fn warn_render(args: &args::Render, camera: &Camera, moves: bool) {
    for (flag, reason) in idle_of_render(args, camera, moves) {
        log::warn!("{flag} has no effect: {reason}");
    }
}

/// Warns of those of some flags that are given for EXR files, where there is none.
pub fn warn_layers(flags: &[(&'static str, bool)], outputs: &[PathBuf]) {
    for (flag, reason) in without_layers(flags, outputs) {
        log::warn!("{flag} has no effect: {reason}");
    }
}

fn idle_of_render(args: &args::Render, camera: &Camera, moves: bool) -> Vec<(&'static str, &'static str)> {
    let (output, reference) = (&args.output, &args.reference);
    let summands = args.keys.typed().summands == Some(true) && output.display.is_none();
    let layers = [
        ("--float", output.float),
        ("--no-layers", output.no_layers),
        ("--surfaces", output.surfaces),
        ("--summands", summands),
    ];
    let rest = [
        ("--focus", args.camera.focus.is_some() && camera.aperture == 0.0, "--aperture is 0, and all is sharp"),
        (
            "--shutter",
            args.camera.shutter.is_some_and(|s| s > 0.0) && !moves,
            "nothing moves without --animation, --at or --path",
        ),
        ("--spp", reference.spp.is_some() && !reference.reference, "it needs --reference"),
        ("--specular-paths", reference.specular_paths.is_some() && !reference.reference, "it needs --reference"),
    ];
    let rest = rest.into_iter().filter(|(_, idle, _)| *idle).map(|(flag, _, reason)| (flag, reason));
    without_layers(&layers, &output.outputs).into_iter().chain(rest).collect()
}

/// Flags of EXR files where all outputs are PNG files.
fn without_layers(flags: &[(&'static str, bool)], outputs: &[PathBuf]) -> Vec<(&'static str, &'static str)> {
    let display = |path: &PathBuf| Format::of(path).is_ok_and(|format| format == Format::Png);
    if outputs.is_empty() || !outputs.iter().all(display) {
        return Vec::new();
    }
    flags.iter().filter(|(_, given)| *given).map(|(flag, _)| (*flag, "no output is an EXR file")).collect()
}

/// Flags of the display that outputs do not take. Films keep an exposure.
fn without_display(exposure: Option<Exposure>, curve: Curve, outputs: &[PathBuf]) -> Vec<&'static str> {
    let linear = |path: &PathBuf| Format::of(path).is_ok_and(|format| format == Format::Exr);
    if outputs.is_empty() || !outputs.iter().all(linear) {
        return Vec::new();
    }
    let flags = [("--exposure", exposure.is_some()), ("--tonemap", curve != Curve::default())];
    flags.into_iter().filter(|(_, given)| *given).map(|(flag, _)| flag).collect()
}

/// The flags without effect, and why.
fn without_effect(given: &RenderDefaults, settings: &Settings, scene: &Scene) -> Vec<(&'static str, String)> {
    let has = |surface: Surface| scene.materials.iter().any(|material| material.surface == surface);
    let specular = has(Surface::Mirror) || has(Surface::Glass);
    let superposition = settings.superposition.as_ref();
    let is_spread = |spread: Spread| superposition.is_some_and(|superposition| superposition.spread == spread);
    let off = |flag: &str| format!("{flag} is off");
    let images = given.mirror_source == Some(MirrorForm::Images) || settings.mirror_images().is_some();
    let rules: [(&[&str], bool, String); 18] = [
        (
            &[
                "particles",
                "light_pool",
                "direct_lights",
                "interleave",
                "mirror_lights",
                "clip",
                "clip_fraction",
                "compensation",
                "light_choice",
                "power_fraction",
                "delta_lights",
                "light_threshold",
                "filter",
                "filter_direct",
                "filter_sparse",
                "filter_agreement",
                "glossy",
                "splat_particles",
                "splat_width",
                "splat_alpha",
            ],
            scene.kept_light.is_some(),
            "light that was kept takes the place of virtual lights".into(),
        ),
        (
            &["photons", "photon_radius", "interleave_photons", "max_specular", "mirror_lights"],
            !specular,
            "the scene has no mirrors and no glass".into(),
        ),
        (
            &["shading_rate"],
            settings.shading_rate > 1 && settings.summands,
            "--summands are those of the points that are lit".into(),
        ),
        (&["photon_radius", "interleave_photons"], settings.photons == 0, "--photons is 0".into()),
        (
            &["reflectors", "convolution", "occlusion", "kernel_width", "mirror_source"],
            superposition.is_none(),
            off("--superposition"),
        ),
        (
            &["kernel_width"],
            superposition.is_some() && !is_spread(Spread::Invariant),
            "--superposition is not invariant".into(),
        ),
        (
            &[
                "mirror_hemispheres",
                "mirror_images",
                "mirror_side",
                "mirror_layers",
                "mirror_passes",
                "mirror_memory",
                "mirror_choice",
                "mirror_merge",
            ],
            !images,
            "--mirror-source is not images".into(),
        ),
        (
            &["splat_particles", "splat_width", "splat_alpha"],
            settings.splats.is_none(),
            "--glossy is not splats".into(),
        ),
        (&["soft_shadow_lights"], settings.soft_shadows.is_none(), off("--soft-shadows")),
        (&["filter_direct", "filter_sparse", "filter_agreement"], settings.filter.is_none(), off("--filter")),
        (
            &["filter_sparse"],
            settings.filter.is_some_and(|filter| filter.agreement == Agreement::DepthAndNormal),
            "--filter-agreement is depth-and-normal".into(),
        ),
        (&["power_fraction"], settings.light_choice == LightChoice::Power, "--light-choice is power".into()),
        (&["lookup"], scene.kept_light.is_none(), "it needs --light-from".into()),
        (&["ring_length", "ring_memory"], settings.ring.is_none(), off("--ring")),
        (
            &["particles", "light_pool", "direct_lights", "interleave", "filter"],
            settings.ring.is_some(),
            "each pass of a ring has one path".into(),
        ),
        (
            &["compensation"],
            !settings.clips() && settings.compensation != Compensation::Off,
            "nothing is clipped: --clip is 0".into(),
        ),
        (
            &["light_threshold", "cluster_order"],
            settings.traversal == Traversal::Single,
            "--traversal is single".into(),
        ),
        (
            &["delta_lights"],
            settings.delta_lights.is_some_and(|most| scene.lights.len() <= most as usize),
            format!("the scene has {} such lights", scene.lights.len()),
        ),
    ];
    let mut found: Vec<(&'static str, String)> = Vec::new();
    for (keys, applies, reason) in rules {
        for key in keys.iter().filter(|name| applies && given.has(name)).filter_map(|name| Key::named(name)) {
            // One reason is enough.
            if found.iter().all(|(flag, _)| *flag != key.flag) {
                found.push((key.flag, reason.clone()));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use lightsum::scene::{KeptLight, Material, builtin};
    use std::sync::Arc;

    fn told(line: &str, surface: Surface) -> Vec<(&'static str, String)> {
        let mut given = RenderDefaults::default();
        line.split_whitespace().for_each(|text| given.override_by(&RenderDefaults::assigned(text).unwrap()));
        let mut scene = builtin::furnace(0.5, 1.0);
        scene.materials.push(Material { surface, ..Material::default() });
        without_effect(&given, &Settings::default().with_scene_defaults(&given), &scene)
    }

    #[test]
    fn exposures_need_a_picture_for_display() {
        let told = |exposure, curve, names: &[&str]| {
            without_display(exposure, curve, &names.iter().map(PathBuf::from).collect::<Vec<_>>())
        };
        let stops = Some(Exposure::Stops(1.0));
        assert_eq!(told(stops, Curve::Aces, &["a.exr"]), ["--exposure", "--tonemap"]);
        assert_eq!(told(stops, Curve::default(), &["a.exr", "b.exr"]), ["--exposure"]);
        let none: [&str; 0] = [];
        for names in [&["a.exr", "a.png"][..], &["part.film"], &[]] {
            assert_eq!(told(stops, Curve::Aces, names), none, "{names:?}");
        }
        assert_eq!(told(None, Curve::default(), &["a.exr"]), none);
    }

    #[test]
    fn flags_that_outputs_and_camera_do_not_take_are_told() {
        let still = builtin::furnace(0.5, 1.0).camera.unwrap();
        let lens = Camera { aperture: 0.1, ..still };
        for (line, camera, moves, expected) in [
            ("-o a.png --float --no-layers --summands", still, false, &["--float", "--no-layers", "--summands"][..]),
            ("-o a.png --surfaces", still, false, &["--surfaces"]),
            ("-o a.png -o a.exr --float --surfaces --summands", still, false, &[]),
            ("-o a.film --shard 1/2 --float", still, false, &[]),
            ("-o a.png --focus 2", still, false, &["--focus"]),
            ("-o a.png --focus 2 --aperture 0.1", lens, false, &[]),
            ("-o a.png --shutter 1", still, false, &["--shutter"]),
            ("-o a.png --shutter 1 --at 0", still, true, &[]),
            ("-o a.png --shutter 0", still, false, &[]),
            ("-o a.png --spp 3 --specular-paths all --passes 2", still, false, &["--spp", "--specular-paths"]),
            ("-o a.png --spp 3 --reference", still, false, &[]),
        ] {
            let words = ["lightsum", "render", "a.toml"].into_iter().chain(line.split_whitespace());
            let arguments = args::Arguments::try_parse_from(words).unwrap_or_else(|error| panic!("{line}: {error}"));
            let Some(args::Command::Render(render)) = arguments.command else { panic!("{line}") };
            let found: Vec<_> = idle_of_render(&render, &camera, moves).into_iter().map(|(flag, _)| flag).collect();
            assert_eq!(found, expected, "{line}");
        }
    }

    #[test]
    fn keys_of_virtual_lights_have_no_effect_on_kept_light() {
        let mut scene = builtin::furnace(0.5, 1.0);
        scene.kept_light = Some(Arc::new(KeptLight { faces: Vec::new(), pages: Vec::new() }));
        for (assigned, flag) in
            [("particles=3", "--particles"), ("filter=off", "--filter"), ("glossy=splats", "--glossy")]
        {
            let given = RenderDefaults::assigned(assigned).unwrap();
            let found = without_effect(&given, &Settings::default().with_scene_defaults(&given), &scene);
            assert!(found.len() == 1 && found[0].0 == flag && found[0].1.contains("kept"), "{assigned}: {found:?}");
        }
        let given = RenderDefaults::assigned("lookup=bicubic").unwrap();
        assert_eq!(without_effect(&given, &Settings::default().with_scene_defaults(&given), &scene), []);
    }

    #[test]
    fn flags_without_effect_are_told_with_the_reason_and_others_are_not() {
        for (line, flag, reason) in [
            ("photon_radius=1", "--photon-radius", "no mirrors and no glass"),
            ("kernel_width=3", "--kernel-width", "--superposition is off"),
            ("kernel_width=3 superposition=variant", "--kernel-width", "not invariant"),
            ("mirror_side=16", "--mirror-side", "not images"),
            ("splat_width=9", "--splat-width", "not splats"),
            ("soft_shadow_lights=2", "--soft-shadow-lights", "--soft-shadows is off"),
            ("filter_direct=false filter=off", "--filter-direct", "--filter is off"),
            ("power_fraction=0.5", "--power-fraction", "is power"),
            ("lookup=bicubic", "--lookup", "--light-from"),
            ("ring_length=3", "--ring-length", "--ring is off"),
            ("ring=images particles=3", "--particles", "one path"),
            ("clip=0 compensation=exact", "--compensation", "nothing is clipped"),
            ("light_threshold=1 traversal=single", "--light-threshold", "is single"),
            ("cluster_order=space traversal=single", "--cluster-order", "is single"),
            ("delta_lights=2000", "--delta-lights", "such lights"),
        ] {
            let found = told(line, Surface::Opaque);
            assert!(found.len() == 1 && found[0].0 == flag && found[0].1.contains(reason), "{line}: {found:?}");
        }
        let glass = "photons=50 photon_radius=1 max_specular=3 superposition=invariant kernel_width=3 glossy=splats splat_width=9 \
                     filter=auto filter_direct=false light_choice=contribution power_fraction=0.5 compensation=exact particles=3";
        assert_eq!(told(glass, Surface::Glass), []);
        assert_eq!(told("photons=0 photon_radius=1", Surface::Mirror), [("--photon-radius", "--photons is 0".into())]);
    }
}
