//! The flags of the settings, which the library's table of keys defines, `--set` and `--settings`.

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, ArgAction, ArgMatches, Command, FromArgMatches, value_parser};
use lightsum::Result;
use lightsum::scene::Scene;
use lightsum::settings::RenderDefaults;
use lightsum::settings::keys::{Given, KEYS, Key, Takes};

/// Settings that the command line gives.
#[derive(Clone, Debug, Default)]
pub struct Keys {
    /// Files of `--settings`, in order.
    files: Vec<PathBuf>,
    /// By `--set`, in order.
    set: Vec<RenderDefaults>,
    /// By their own flags.
    pub flags: RenderDefaults,
}

impl Keys {
    /// All of them: files first, then `--set`, then flags.
    pub fn given(&self) -> Result<RenderDefaults> {
        let mut keys = RenderDefaults::default();
        for file in &self.files {
            keys.override_by(&RenderDefaults::load(file)?);
        }
        keys.override_by(&self.typed());
        Ok(keys)
    }

    /// Those of `--set` and of flags alone.
    pub fn typed(&self) -> RenderDefaults {
        let mut keys = RenderDefaults::default();
        self.set.iter().chain([&self.flags]).for_each(|over| keys.override_by(over));
        keys
    }

    /// Lets them override `[render]` of a scene, which keeps those that the command takes; returns them.
    pub fn override_scene(&self, scene: &mut Scene, command: &str) -> Result<RenderDefaults> {
        let given = self.given()?;
        let typed = self.typed();
        // Files may be for several commands.
        for key in KEYS.iter().filter(|key| typed.has(key.name) && !key.acts_on(command)) {
            log::warn!("{} has no effect: `{command}` does not take it", key.name);
        }
        scene.render.override_by(&given);
        scene.render.only_for(command);
        scene.files.extend(self.files.iter().cloned());
        Ok(given)
    }
}

impl clap::Args for Keys {
    fn augment_args(command: Command) -> Command {
        let name = command.get_name().to_string();
        let command = command.args_override_self(true).next_help_heading("Settings").args([
            Arg::new("set")
                .long("set")
                .value_name("KEY=VALUE")
                .action(ArgAction::Append)
                .value_parser(RenderDefaults::assigned)
                .help("Set a key of [render], such as particles=64; can be repeated")
                .long_help(
                    "Set a key of [render], such as particles=64; can be repeated.\n\nKeys are the flags' names with underscores, values those of \
                     TOML or bare words. Flags override --set, which overrides --settings, which overrides the scene file's [render], which \
                     overrides the preset.",
                ),
            Arg::new("settings")
                .long("settings")
                .value_name("FILE")
                .action(ArgAction::Append)
                .value_parser(value_parser!(PathBuf))
                .help("Take the settings of a file: TOML with keys of [render], an EXR image by lightsum, or its JSON; can be repeated")
                .long_help(
                    "Take the settings of a file: TOML with keys of [render], an EXR image by lightsum, or its JSON; can be repeated.\n\nImages have \
                     all settings of their rendering, with the seed, but no number of passes.",
                ),
        ]);
        KEYS.iter().filter(|key| key.has_flag && key.acts_on(&name)).fold(command, |command, key| {
            let command = command.next_help_heading(key.heading);
            match key.takes {
                Takes::Switch => command.args(switches(key)),
                _ if key.name == "compensation" => command.args([valued(key), no_compensation()]),
                _ => command.arg(valued(key)),
            }
        })
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for Keys {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Keys, clap::Error> {
        let all = |id: &str| matches.get_many::<RenderDefaults>(id).unwrap_or_default().cloned().collect();
        let files = matches.get_many::<PathBuf>("settings").unwrap_or_default().cloned().collect();
        let mut keys = Keys { files, set: all("set"), flags: RenderDefaults::default() };
        // A key without a flag in this command has no value.
        let is_set = |id: &str| matches.try_get_one::<bool>(id).ok().flatten().is_some_and(|set| *set);
        for key in KEYS.iter().filter(|key| key.has_flag) {
            let given = match key.takes {
                Takes::Switch if is_set(key.name) => Some(Given::Switch(true)),
                Takes::Switch if is_set(&opposite(key)) => Some(Given::Switch(false)),
                Takes::Switch => None,
                _ if key.name == "compensation" && is_set("no_compensation") => Some(Given::Word("off")),
                _ => matches.try_get_one::<Given>(key.name).ok().flatten().cloned(),
            };
            if let Some(given) = given {
                let invalid = |message| clap::Error::raw(clap::error::ErrorKind::ValueValidation, message);
                keys.flags.put(key.name, &given).map_err(invalid)?;
            }
        }
        Ok(keys)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Keys::from_arg_matches(matches)?;
        Ok(())
    }
}

/// Name of the flag that turns a switch off.
fn opposite(key: &Key) -> String {
    format!("no_{}", key.name)
}

/// The summary with range and default, and the same with all paragraphs.
fn help(key: &Key) -> [String; 2] {
    let paragraphs = key.paragraphs();
    let (first, more) = paragraphs.split_first().map_or(("", &[][..]), |(first, more)| (first.as_str(), more));
    let note = key.note();
    let short = if note.is_empty() {
        first.trim_end_matches('.').to_string()
    } else {
        format!("{} [{note}]", first.trim_end_matches('.'))
    };
    let long = [format!("{short}.")].iter().chain(more).cloned().collect::<Vec<_>>().join("\n\n");
    [short, long]
}

/// A flag with a value.
fn valued(key: &'static Key) -> Arg {
    let [short, long] = help(key);
    let arg = Arg::new(key.name)
        .long(&key.flag[2..])
        .value_name(key.value_name)
        .help(short)
        .long_help(long)
        .allow_negative_numbers(true);
    let arg = match key.takes {
        Takes::Words => {
            let value = |(word, meaning): &(&'static str, &'static str)| {
                let value = PossibleValue::new(*word).help(*meaning);
                if key.name == "filter_agreement" && word.contains('-') { value.alias("paper") } else { value }
            };
            let words = PossibleValuesParser::new(key.words.iter().map(value));
            arg.value_parser(words.try_map(|word: String| key.parse(&word)))
        }
        _ => arg.value_parser(|text: &str| key.parse(text)),
    };
    let arg = match key.alias {
        Some(alias) => arg.visible_alias(alias.replace('_', "-")),
        None => arg,
    };
    if key.name == "clip" { arg.conflicts_with("clip_fraction") } else { arg }
}

/// A switch and its opposite, of which the last one given counts. Help shows the one that changes the default.
fn switches(key: &'static Key) -> [Arg; 2] {
    let [short, long] = help(key);
    let is_on = key.default == "true";
    let off = opposite(key);
    let on =
        Arg::new(key.name).long(&key.flag[2..]).help(short.clone()).long_help(long.clone()).overrides_with(off.clone());
    let not = Arg::new(off.clone()).long(off.replace('_', "-")).overrides_with(key.name);
    let not = not.help(format!("Not {}: {short}", key.flag)).long_help(format!("Not {}: {long}", key.flag));
    let arg = |arg: Arg, hidden: bool| arg.action(ArgAction::SetTrue).hide(hidden);
    [arg(on, is_on), arg(not, !is_on)]
}

fn no_compensation() -> Arg {
    let arg = Arg::new("no_compensation").long("no-compensation").action(ArgAction::SetTrue);
    arg.help("Short for --compensation off").overrides_with("compensation")
}
