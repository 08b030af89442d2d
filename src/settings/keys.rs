//! The keys of `[render]`, which are the flags of a rendering: one table of names, values, ranges, defaults and help, by which flags, files
//! and [`Settings::validate`](super::Settings::validate) are read and checked.

mod apply;
mod file;
mod table;
mod value;

pub(crate) use file::Table;
pub use table::{KEYS, RenderDefaults};
pub use value::Given;

use std::fmt::Write;

/// A key of `[render]`, of `--set` and of files of `--settings`; most have a flag.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Its name.
    pub name: &'static str,
    /// Its flag: the name with dashes.
    pub flag: &'static str,
    /// A former name.
    pub alias: Option<&'static str>,
    /// Heading above it in help.
    pub heading: &'static str,
    /// Name of the value in help.
    pub value_name: &'static str,
    /// Its values.
    pub takes: Takes,
    /// The word for no value, if there is one.
    pub nothing: Option<&'static str>,
    /// Words that it takes, each with its meaning.
    pub words: &'static [(&'static str, &'static str)],
    /// Its default in words.
    pub default: &'static str,
    /// Help: the lines of a summary, an empty line, and more paragraphs.
    pub text: &'static [&'static str],
    /// The commands that it acts on.
    pub commands: &'static [&'static str],
    /// Whether these commands have its flag from here.
    pub has_flag: bool,
}

/// Values of a key, beside words.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Takes {
    /// True or false; the flag and its opposite with `no-`.
    Switch,
    /// A whole number.
    Count {
        /// The least.
        least: u64,
        /// The most.
        most: u64,
    },
    /// A number of bytes, with K, M, G or T for powers of 1024.
    Bytes,
    /// A number.
    Number {
        /// The least.
        least: f32,
        /// Whether that is excluded.
        above: bool,
        /// The most; `f32::MAX`: no limit.
        most: f32,
    },
    /// Width and height.
    Size {
        /// The least of both.
        least: u32,
        /// The most of both.
        most: u32,
    },
    /// Words only.
    Words,
}

const ALL: &[&str] = &["render", "animate", "bake", "view"];

impl Key {
    const fn new(flag: &'static str, heading: &'static str, takes: Takes, value_name: &'static str) -> Key {
        let (alias, nothing, words, default, text) = (None, None, &[], "", &[]);
        let (name, commands, has_flag) = ("", ALL, true);
        Key { name, flag, alias, heading, value_name, takes, nothing, words, default, text, commands, has_flag }
    }

    const fn switch(flag: &'static str, heading: &'static str, default: &'static str) -> Key {
        Key::new(flag, heading, Takes::Switch, "").or_by(default)
    }

    const fn count(flag: &'static str, heading: &'static str, least: u64, most: u64) -> Key {
        Key::new(flag, heading, Takes::Count { least, most }, "N")
    }

    const fn number(flag: &'static str, heading: &'static str, value_name: &'static str, least: f32, most: f32) -> Key {
        Key::new(flag, heading, Takes::Number { least, above: false, most }, value_name)
    }

    /// A number above 0.
    const fn above_0(flag: &'static str, heading: &'static str, value_name: &'static str, most: f32) -> Key {
        Key::new(flag, heading, Takes::Number { least: 0.0, above: true, most }, value_name)
    }

    const fn one_of(flag: &'static str, heading: &'static str, words: &'static [(&'static str, &'static str)]) -> Key {
        Key { words, ..Key::new(flag, heading, Takes::Words, "HOW") }
    }

    /// With this default, in words.
    const fn or_by(self, default: &'static str) -> Key {
        Key { default, ..self }
    }

    const fn also(self, words: &'static [(&'static str, &'static str)]) -> Key {
        Key { words, ..self }
    }

    /// With a word for no value, which is one of its words.
    const fn nothing_is(self, word: &'static str) -> Key {
        Key { nothing: Some(word), ..self }
    }

    const fn called(self, value_name: &'static str) -> Key {
        Key { value_name, ..self }
    }

    const fn formerly(self, alias: &'static str) -> Key {
        Key { alias: Some(alias), ..self }
    }

    const fn on(self, commands: &'static [&'static str]) -> Key {
        Key { commands, ..self }
    }

    /// The commands define the flag.
    const fn without_flag(self) -> Key {
        Key { has_flag: false, ..self }
    }

    const fn described(self, name: &'static str, text: &'static [&'static str]) -> Key {
        Key { name, text, ..self }
    }

    /// The key of a name or of a former name.
    pub fn named(name: &str) -> Option<&'static Key> {
        KEYS.iter().find(|key| key.name == name || key.alias == Some(name))
    }

    /// The key of a name. Errors: the nearest names.
    pub fn find(name: &str) -> Result<&'static Key, String> {
        Key::named(name).ok_or_else(|| {
            let known = nearest(name, KEYS.iter().map(|key| key.name));
            format!("there is no key {name:?}; the nearest are {known}")
        })
    }

    /// Whether a command takes it.
    pub fn acts_on(&self, command: &str) -> bool {
        self.commands.contains(&command)
    }

    /// The paragraphs of its help.
    pub fn paragraphs(&self) -> Vec<String> {
        let paragraphs = self.text.split(|line| line.trim().is_empty());
        let joined = paragraphs.map(|lines| lines.iter().map(|line| line.trim()).collect::<Vec<_>>().join(" "));
        joined.filter(|paragraph| !paragraph.is_empty()).collect()
    }

    /// Range and default in words, for help; of switches nothing.
    pub fn note(&self) -> String {
        let range = match self.takes {
            Takes::Switch => return String::new(),
            Takes::Count { most, .. } if most >= u64::from(u32::MAX) => String::new(),
            Takes::Count { least, most } => format!("{least} to {most}; "),
            Takes::Number { most: f32::MAX, .. } => String::new(),
            Takes::Number { least, above: true, most } => format!("above {least}, at most {most}; "),
            Takes::Number { least, above: false, most } => format!("{least} to {most}; "),
            Takes::Size { least, most } => format!("{least}x{least} to {most}x{most}; "),
            Takes::Bytes | Takes::Words => String::new(),
        };
        format!("{range}default: {}", self.default)
    }

    /// Its values in words, after "expected".
    pub fn expected(&self) -> String {
        let mut text = match self.takes {
            Takes::Switch => String::from("true or false"),
            Takes::Count { least, most } if most >= u64::from(u32::MAX) => format!("a whole number of {least} or more"),
            Takes::Count { least, most } => format!("a whole number from {least} to {most}"),
            Takes::Bytes => String::from("a number of bytes above 0, such as 1000000, 512M or 4G"),
            Takes::Number { least, above: true, most: f32::MAX } => format!("a number above {least}"),
            Takes::Number { least, above: false, most: f32::MAX } => format!("a number of {least} or more"),
            Takes::Number { least, above: true, most } => format!("a number above {least}, at most {most}"),
            Takes::Number { least, above: false, most } => format!("a number from {least} to {most}"),
            Takes::Size { least, most } => format!("a size from {least}x{least} to {most}x{most}, such as 3x3"),
            Takes::Words => String::new(),
        };
        for (i, (word, _)) in self.words.iter().enumerate() {
            let joint = match (text.is_empty(), i + 1 == self.words.len()) {
                (true, _) => "",
                (false, true) => " or ",
                (false, false) => ", ",
            };
            // Writing to a text does not fail.
            let _ = write!(text, "{joint}{word}");
        }
        text
    }

    /// Whether a value of its kind is within its range.
    pub fn allows(&self, given: &Given) -> bool {
        match (given, self.takes) {
            (Given::Nothing, _) => self.nothing.is_some(),
            (Given::Word(word), _) => self.words.iter().any(|(known, _)| known == word),
            (Given::Switch(_), Takes::Switch) => true,
            (Given::Count(n), Takes::Count { least, most }) => (least..=most).contains(n),
            (Given::Count(n), Takes::Bytes) => *n > 0,
            (Given::Number(v), Takes::Number { least, above, most }) => {
                v.is_finite() && *v <= most && if above { *v > least } else { *v >= least }
            }
            (Given::Size(size), Takes::Size { least, most }) => size.iter().all(|n| (least..=most).contains(n)),
            _ => false,
        }
    }
}

/// The names most similar to a misspelt one, for a message.
pub(crate) fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> String {
    let mut known: Vec<&str> = known.collect();
    known.sort_unstable();
    known.dedup();
    known.sort_by_key(|k| strsim::levenshtein(&name.to_lowercase(), &k.to_lowercase()));
    let names: Vec<String> = known.iter().take(5).map(|k| format!("{k:?}")).collect();
    if names.is_empty() { String::from("none at all") } else { names.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::super::{Settings, Superposition};
    use super::*;

    #[test]
    fn misspelt_names_find_their_neighbours() {
        assert!(nearest("flor", ["ceiling", "Floor", "wall"].into_iter()).starts_with("\"Floor\""));
        let message = Key::find("particels").unwrap_err();
        assert!(message.contains("the nearest are \"particles\""), "{message}");
    }

    #[test]
    fn names_flags_words_and_texts_are_sound() {
        for (i, key) in KEYS.iter().enumerate() {
            assert_eq!(key.flag, format!("--{}", key.name.replace('_', "-")));
            assert!(KEYS[..i].iter().all(|other| other.name != key.name), "{} is there twice", key.name);
            assert!(key.paragraphs()[0].len() > 10 && !key.default.is_empty(), "{}", key.name);
            assert!(key.words.iter().all(|(word, meaning)| !word.contains('_') && meaning.len() > 2), "{}", key.name);
            assert!(key.takes != Takes::Words || key.words.len() > 1, "{}", key.name);
        }
    }

    /// Values at both ends of a range and just beyond them.
    fn ends(key: &Key) -> (Vec<String>, Vec<String>) {
        let text = |list: &[&dyn ToString]| list.iter().map(|value| value.to_string()).collect::<Vec<String>>();
        match key.takes {
            Takes::Switch => (text(&[&"true", &"false"]), text(&[&"yes", &"1"])),
            Takes::Count { least, most } => {
                let below = least.checked_sub(1).map_or(String::from("-1"), |n| n.to_string());
                let beyond = most.checked_add(1).map_or(String::from("18446744073709551616"), |n| n.to_string());
                (text(&[&least, &most]), text(&[&below, &beyond, &"1.5", &"nan"]))
            }
            Takes::Bytes => (text(&[&"1", &"16777215T"]), text(&[&"0", &"16777216T", &"nan", &"-1"])),
            Takes::Number { least, above, most } => {
                let (first, below) = if above { (least.next_up(), least) } else { (least, least.next_down()) };
                let beyond = most.next_up();
                (text(&[&first, &most]), text(&[&below, &beyond, &"nan", &"inf", &"-inf", &"wide"]))
            }
            Takes::Size { least, most } => {
                let size = |n: u32, m: u32| format!("{n}x{m}");
                let beyond = [size(least - 1, least), size(least, most + 1), size(most + 1, most)];
                let [a, b, c] = &beyond;
                (text(&[&size(least, least), &size(most, most)]), text(&[a, b, c, &"3", &"ax3"]))
            }
            Takes::Words => (Vec::new(), text(&[&"nonesuch", &"1"])),
        }
    }

    #[test]
    fn both_ends_of_every_range_are_read_and_what_is_beyond_is_refused_by_every_way() {
        for key in KEYS {
            let (inside, beyond) = ends(key);
            for text in inside.iter().cloned().chain(key.words.iter().map(|(word, _)| word.to_string())) {
                let given = key.parse(&text).unwrap_or_else(|e| panic!("{} = {text}: {e}", key.name));
                assert!(key.allows(&given), "{} = {text}", key.name);
                // The same as TOML, and as a text that is written again.
                if given != Given::Nothing {
                    assert_eq!(key.parse(&given.to_string()), Ok(given.clone()), "{} = {text}", key.name);
                }
                let assigned = RenderDefaults::assigned(&format!("{}={text}", key.name));
                let assigned = assigned.unwrap_or_else(|e| panic!("{} = {text}: {e}", key.name));
                assert_eq!(assigned.given(), [(key.name, given)], "{text}");
            }
            for text in &beyond {
                let error = key.parse(text).expect_err(&format!("{} = {text} is taken", key.name));
                assert!(error.starts_with("expected "), "{error}");
                assert!(RenderDefaults::assigned(&format!("{}={text}", key.name)).is_err(), "{} = {text}", key.name);
            }
        }
    }

    #[test]
    fn settings_beyond_a_range_name_its_flag() {
        let on =
            ["superposition=variant", "mirror_source=images", "glossy=splats", "soft_shadows=splat", "ring=images"];
        let mut all = RenderDefaults::default();
        on.iter().for_each(|text| all.override_by(&RenderDefaults::assigned(text).unwrap()));
        let settings = Settings::default().with_scene_defaults(&all);
        let mut checked = 0;
        for key in KEYS.iter().filter(|key| settings.keys().has(key.name)) {
            let beyond = match key.takes {
                Takes::Count { most, .. } if most < u64::from(u32::MAX) => Given::Count(most + 1),
                Takes::Number { most, .. } if most < f32::MAX => Given::Number(most.next_up()),
                Takes::Number { .. } => Given::Number(f32::NAN),
                Takes::Size { most, .. } => Given::Size([most + 1; 2]),
                _ => continue,
            };
            let mut keys = RenderDefaults::default();
            keys.put_unchecked(key.name, &beyond);
            let beyond = settings.clone().with_scene_defaults(&keys);
            checked += 1;
            let message = beyond.validate().expect_err(key.name).to_string();
            assert!(message.contains(&format!("setting {}: ", key.flag)), "{}: {message}", key.name);
        }
        assert!(checked > 20, "{checked}");
        let superposition = Some(Superposition { kernel_width: 4097, ..Superposition::default() });
        let message = Settings { superposition, ..Settings::default() }.validate().unwrap_err().to_string();
        assert_eq!(message, "setting --kernel-width: 4097 is not a whole number from 0 to 4096");
    }
}
