//! Settings by keys, and the keys of settings.

use super::table::RenderDefaults;
use crate::ring::Ring;
use crate::settings::{
    Clip, Filter, GlossyForm, MirrorForm, MirrorImages, MirrorSource, Preset, Settings, ShadowForm, SoftShadows,
    Splats, Superposition, Window,
};

/// Sets a value if it is given.
fn set<T: Copy>(value: &mut T, given: Option<T>) {
    if let Some(given) = given {
        *value = given;
    }
}

impl Settings {
    /// Applies a preset, which leaves the other settings as they are.
    pub fn apply_preset(&mut self, preset: Preset) {
        let preset = match preset {
            Preset::Progressive => Settings::default(),
            Preset::Interactive => Settings::interactive(),
        };
        self.particles = preset.particles;
        self.light_pool = preset.light_pool;
        self.direct_lights = preset.direct_lights;
        self.pattern = preset.pattern;
        self.clip = preset.clip;
        self.compensation = preset.compensation;
        self.jitter = preset.jitter;
        self.photons = preset.photons;
        self.mirror_lights = preset.mirror_lights;
        self.filter = preset.filter;
    }

    /// Applies the keys that are given, as of the `[render]` section of a scene file: their preset first. Another pattern has as many
    /// photons over all classes, unless their number is given too; with 1 x 1, where all pixels share their lights, there is no filter
    /// unless one is given.
    pub fn with_scene_defaults(mut self, keys: &RenderDefaults) -> Settings {
        if let Some(preset) = keys.preset {
            self.apply_preset(preset);
        }
        let of_all_classes = u64::from(self.photons) * u64::from(self.classes());
        set(&mut self.particles, keys.particles);
        set(&mut self.light_pool, keys.light_pool);
        set(&mut self.direct_lights, keys.direct_lights);
        set(&mut self.pattern, keys.interleave);
        if keys.interleave.is_some() {
            self.photons = of_all_classes.div_ceil(u64::from(self.classes().max(1))) as u32;
        }
        set(&mut self.photons, keys.photons);
        set(&mut self.photon_radius, keys.photon_radius);
        set(&mut self.interleave_photons, keys.interleave_photons);
        set(&mut self.max_depth, keys.max_depth);
        set(&mut self.max_specular, keys.max_specular);
        set(&mut self.split, keys.split);
        set(&mut self.glossy_paths, keys.glossy_paths);
        set(&mut self.antialias, keys.antialias);
        set(&mut self.shading_rate, keys.shading_rate);
        set(&mut self.mirror_lights, keys.mirror_lights);
        set(&mut self.clip, keys.clip_fraction.map(Clip::Fraction));
        set(&mut self.clip, keys.clip.map(Clip::Distance));
        set(&mut self.compensation, keys.compensation);
        set(&mut self.light_choice, keys.light_choice);
        set(&mut self.power_fraction, keys.power_fraction);
        set(&mut self.delta_lights, keys.delta_lights);
        set(&mut self.sequence, keys.sequence);
        set(&mut self.jitter, keys.jitter);
        set(&mut self.light_threshold, keys.light_threshold);
        set(&mut self.seed, keys.seed);
        set(&mut self.moving_passes, keys.moving_passes);
        set(&mut self.lookup, keys.lookup);
        set(&mut self.summands, keys.summands);
        set(&mut self.reflectance, keys.reflectance);
        set(&mut self.lights_per_dispatch, keys.lights_per_dispatch);
        set(&mut self.rounds, keys.rounds);
        set(&mut self.traversal, keys.traversal);
        set(&mut self.cluster_order, keys.cluster_order);
        self.filter = filter(self.filter, keys);
        self.superposition = superposition(self.superposition, keys);
        self.soft_shadows = SoftShadows::chosen(self.soft_shadows, keys.soft_shadows, keys.soft_shadow_lights);
        let numbers = (keys.splat_particles, keys.splat_width, keys.splat_alpha);
        self.splats = Splats::chosen(self.splats, keys.glossy, numbers);
        let ring = match keys.ring {
            Some(form) => form.map(|form| Ring { form, ..self.ring.unwrap_or(Ring::new(form)) }),
            None => self.ring,
        };
        self.ring = ring.map(|mut ring| {
            set(&mut ring.length, keys.ring_length);
            set(&mut ring.memory, keys.ring_memory);
            ring
        });
        self
    }

    /// All settings as keys: [`Settings::with_scene_defaults`] makes the same settings of them, but for the bound of loops.
    pub fn keys(&self) -> RenderDefaults {
        let [clip, clip_fraction] = match self.clip {
            Clip::Distance(distance) => [Some(distance), None],
            Clip::Fraction(fraction) => [None, Some(fraction)],
        };
        let (filter, superposition) = (self.filter.as_ref(), self.superposition.as_ref());
        let images = self.mirror_images();
        RenderDefaults {
            particles: Some(self.particles),
            light_pool: Some(self.light_pool),
            direct_lights: Some(self.direct_lights),
            interleave: Some(self.pattern),
            photons: Some(self.photons),
            photon_radius: Some(self.photon_radius),
            interleave_photons: Some(self.interleave_photons),
            max_depth: Some(self.max_depth),
            max_specular: Some(self.max_specular),
            split: Some(self.split),
            glossy_paths: Some(self.glossy_paths),
            antialias: Some(self.antialias),
            shading_rate: Some(self.shading_rate),
            mirror_lights: Some(self.mirror_lights),
            clip,
            clip_fraction,
            compensation: Some(self.compensation),
            light_choice: Some(self.light_choice),
            power_fraction: Some(self.power_fraction),
            delta_lights: Some(self.delta_lights),
            sequence: Some(self.sequence),
            jitter: Some(self.jitter),
            light_threshold: Some(self.light_threshold),
            seed: Some(self.seed),
            moving_passes: Some(self.moving_passes),
            lookup: Some(self.lookup),
            summands: Some(self.summands),
            reflectance: Some(self.reflectance),
            lights_per_dispatch: Some(self.lights_per_dispatch),
            rounds: Some(self.rounds),
            traversal: Some(self.traversal),
            cluster_order: Some(self.cluster_order),
            filter: Some(filter.map(|filter| filter.window.map_or(Window::Auto, Window::Size))),
            filter_direct: filter.map(|filter| filter.direct),
            filter_sparse: filter.map(|filter| filter.sparse),
            filter_agreement: filter.map(|filter| filter.agreement),
            superposition: Some(superposition.map(|superposition| superposition.spread)),
            occlusion: superposition.map(|superposition| superposition.occlusion),
            kernel_width: superposition.map(|superposition| superposition.kernel_width),
            convolution: superposition.map(|superposition| superposition.form),
            reflectors: superposition.map(|superposition| superposition.reflectors),
            mirror_source: superposition.map(|_| if images.is_some() { MirrorForm::Images } else { MirrorForm::Rays }),
            mirror_choice: images.map(|images| images.choice),
            mirror_merge: images.map(|images| images.merged),
            soft_shadows: Some(if self.soft_shadows.is_some() { ShadowForm::Splat } else { ShadowForm::Off }),
            soft_shadow_lights: self.soft_shadows.map(|soft| soft.lights),
            glossy: Some(if self.splats.is_some() { GlossyForm::Splats } else { GlossyForm::Paths }),
            splat_particles: self.splats.map(|splats| splats.particles),
            splat_width: self.splats.map(|splats| splats.width),
            splat_alpha: self.splats.map(|splats| splats.alpha),
            ring: Some(self.ring.map(|ring| ring.form)),
            ring_length: self.ring.map(|ring| ring.length),
            ring_memory: self.ring.map(|ring| ring.memory),
            ..RenderDefaults::default()
        }
    }
}

fn filter(before: Option<Filter>, keys: &RenderDefaults) -> Option<Filter> {
    let filter = match keys.filter {
        Some(window) => window.map(|window| {
            let window = if let Window::Size(size) = window { Some(size) } else { None };
            Filter { window, ..before.unwrap_or_default() }
        }),
        None if keys.interleave == Some([1, 1]) => None,
        None => before,
    };
    filter.map(|mut filter| {
        set(&mut filter.direct, keys.filter_direct);
        set(&mut filter.sparse, keys.filter_sparse);
        set(&mut filter.agreement, keys.filter_agreement);
        filter
    })
}

fn superposition(before: Option<Superposition>, keys: &RenderDefaults) -> Option<Superposition> {
    let chosen = match keys.superposition {
        Some(spread) => spread.map(|spread| Superposition { spread, ..before.unwrap_or_default() }),
        None => before,
    };
    chosen.map(|mut superposition| {
        set(&mut superposition.occlusion, keys.occlusion);
        set(&mut superposition.kernel_width, keys.kernel_width);
        set(&mut superposition.form, keys.convolution);
        set(&mut superposition.reflectors, keys.reflectors);
        match keys.mirror_source {
            Some(MirrorForm::Rays) => superposition.mirror_source = MirrorSource::Rays,
            Some(MirrorForm::Images) if superposition.mirror_source == MirrorSource::Rays => {
                superposition.mirror_source = MirrorSource::Images(MirrorImages::default());
            }
            Some(MirrorForm::Images) | None => {}
        }
        if let MirrorSource::Images(images) = &mut superposition.mirror_source {
            set(&mut images.choice, keys.mirror_choice);
            set(&mut images.merged, keys.mirror_merge);
        }
        superposition
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Given, KEYS, Key};
    use super::*;

    #[test]
    fn defaults_in_the_table_are_those_of_the_settings() {
        let keys = Settings::default().keys();
        let mut compared = 0;
        for (name, given) in keys.given() {
            let key = Key::named(name).unwrap();
            match key.parse(key.default) {
                Ok(default) => assert_eq!(default, given, "{name}"),
                // Those that differ by preset or pattern begin with the default.
                Err(_) => {
                    let first = key.default.split(';').next().and_then(|first| key.parse(first).ok());
                    assert!(first.is_none_or(|first| first == given), "{name}");
                }
            }
            compared += 1;
        }
        assert!(compared > 30, "{compared}");
        let all = Settings {
            superposition: Some(Superposition::default()),
            splats: Some(Splats::default()),
            soft_shadows: Some(SoftShadows::default()),
            ring: Some(Ring::new(crate::ring::Form::Images)),
            ..Settings::default()
        };
        let forms = ["superposition", "glossy", "soft_shadows", "ring"];
        for (name, given) in all.keys().given().into_iter().filter(|(name, _)| !forms.contains(name)) {
            let key = Key::named(name).unwrap();
            assert!(key.parse(key.default).is_ok_and(|default| default == given) || keys.has(name), "{name}");
        }
    }

    #[test]
    fn keys_of_settings_give_the_same_settings() {
        let filter = Filter { window: Some([5, 3]), direct: false, ..Filter::default() };
        let mirror_source = MirrorSource::Images(MirrorImages { merged: 5, ..MirrorImages::default() });
        let all = [
            Settings::default(),
            Settings::interactive(),
            Settings::plain(),
            Settings {
                filter: Some(filter),
                clip: Clip::Distance(0.25),
                superposition: Some(Superposition { occlusion: false, mirror_source, ..Superposition::default() }),
                splats: Some(Splats { width: 24.0, ..Splats::default() }),
                soft_shadows: Some(SoftShadows { lights: 2 }),
                ring: Some(Ring { length: 7, ..Ring::new(crate::ring::Form::Lights) }),
                delta_lights: Some(9),
                photon_radius: Some(0.5),
                seed: u64::MAX,
                ..Settings::default()
            },
        ];
        for (i, settings) in all.iter().enumerate() {
            assert_eq!(Settings::default().with_scene_defaults(&settings.keys()), *settings, "{i}");
            for before in &all {
                assert_eq!(before.clone().with_scene_defaults(&settings.keys()).keys(), settings.keys(), "{i}");
            }
        }
    }

    #[test]
    fn every_key_of_the_settings_changes_them() {
        let own = ["passes", "time", "target_error", "exposure", "preset"];
        let with = |keys: &RenderDefaults| Settings::default().with_scene_defaults(keys);
        for key in KEYS.iter().filter(|key| !own.contains(&key.name)) {
            // Sizes of mirror images are no settings of a frame.
            if key.name.starts_with("mirror_") && !all_on().keys().has(key.name) {
                continue;
            }
            let mut keys = all_on().keys();
            let before = with(&keys);
            let other = key.words.iter().map(|(word, _)| word.to_string());
            let numbers = ["true", "false", "1", "2", "0.5", "3x3", "5x5"].map(String::from);
            let changed = other.chain(numbers).filter_map(|text| key.parse(&text).ok()).any(|given: Given| {
                keys = all_on().keys();
                let mut over = RenderDefaults::default();
                over.put(key.name, &given).unwrap();
                keys.override_by(&over);
                with(&keys) != before
            });
            assert!(changed, "{} changes nothing", key.name);
        }
    }

    fn all_on() -> Settings {
        let mirror_source = MirrorSource::Images(MirrorImages { merged: 3, ..MirrorImages::default() });
        Settings {
            superposition: Some(Superposition { mirror_source, ..Superposition::default() }),
            splats: Some(Splats::default()),
            soft_shadows: Some(SoftShadows::default()),
            ring: Some(Ring::new(crate::ring::Form::Images)),
            ..Settings::default()
        }
    }
}
