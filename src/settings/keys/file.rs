//! Keys in files: tables of TOML, and the settings that lightsum writes into its images and statistics.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use serde::Deserialize;
use toml::Spanned;

use super::Key;
use super::table::RenderDefaults;
use crate::error::{Error, Result};
use crate::input;
#[cfg(feature = "images")]
use crate::scene::openexr;
use crate::settings::Settings;

/// A table of keys with their places in the file.
pub(crate) type Table = BTreeMap<Spanned<String>, Spanned<toml::Value>>;

impl RenderDefaults {
    /// Reads a table. Errors: the place of the key, and a message.
    pub(crate) fn of_table(table: &Table) -> Result<RenderDefaults, (Range<usize>, String)> {
        let mut keys = RenderDefaults::default();
        for (name, value) in table {
            let key = Key::find(name.get_ref()).map_err(|message| (name.span(), message))?;
            let wrong = |message| (value.span(), format!("{} = {}: {message}", key.name, value.get_ref()));
            keys.put_unchecked(key.name, &key.read(value.get_ref()).map_err(wrong)?);
        }
        Ok(keys)
    }

    /// Reads a file of settings: TOML with the keys of `[render]`; an OpenEXR image that lightsum has written; its statistics, or the
    /// settings alone, as JSON. Errors: [`Error::File`] with the line of the key.
    pub fn load(path: &Path) -> Result<RenderDefaults> {
        let bytes = input::read(path)?;
        #[cfg(feature = "images")]
        if openexr::is_one(&bytes) {
            let attribute =
                openexr::text_attribute(&bytes, "settings").map_err(|message| Error::file(path, message))?;
            let text = attribute.ok_or_else(|| Error::file(path, "holds no settings; lightsum did not write it"))?;
            return of_json(path, &text);
        }
        let text = String::from_utf8(bytes).map_err(|_| {
            Error::file(path, "is neither text in UTF-8 nor OpenEXR; give TOML, JSON or an image of lightsum (.exr)")
        })?;
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        if text.trim_start().starts_with('{') {
            return of_json(path, text);
        }
        let at = |span: Range<usize>, message| {
            let line = text.bytes().take(span.start).filter(|&b| b == b'\n').count() + 1;
            Error::at(path, line, message)
        };
        let table: Table =
            toml::from_str(text).map_err(|e| at(e.span().unwrap_or_default(), e.message().trim_end().into()))?;
        RenderDefaults::of_table(&table).map_err(|(span, message)| at(span, message))
    }
}

/// Statistics, of which the settings are a part.
#[derive(Deserialize)]
struct Whole {
    settings: Settings,
}

fn of_json(path: &Path, text: &str) -> Result<RenderDefaults> {
    let read = |error: serde_json::Error| Error::at(path, error.line(), format!("no settings of lightsum: {error}"));
    let whole: serde_json::Value = serde_json::from_str(text).map_err(read)?;
    let settings = match whole.get("settings") {
        Some(_) => serde_json::from_str::<Whole>(text).map_err(read)?.settings,
        None => serde_json::from_str::<Settings>(text).map_err(read)?,
    };
    settings.validate().map_err(|error| Error::file(path, error.to_string()))?;
    Ok(settings.keys())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn settings_come_back_from_json_and_statistics() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let settings = Settings { particles: 7, delta_lights: Some(3), ..Settings::plain() };
        let json = serde_json::to_string(&settings).unwrap();
        for text in [json.clone(), format!("{{\"passes\": 3, \"settings\": {json}}}")] {
            fs::write(&path, text).unwrap();
            assert_eq!(RenderDefaults::load(&path).unwrap(), settings.keys());
        }
        for (text, word) in [
            (json.replace("\"particles\":7", "\"particles\":0"), "--particles"),
            (json.replace("\"particles\":7", "\"particels\":7"), "particels"),
            (json.replace("\"particles\":7", "\"particles\":\"many\""), "many"),
            (String::from("{"), "a.json:1"),
            (String::from("{}x"), "a.json:1"),
        ] {
            fs::write(&path, &text).unwrap();
            let message = RenderDefaults::load(&path).unwrap_err().to_string();
            assert!(message.contains(word) && message.contains("a.json"), "{text}: {message}");
        }
    }

    #[test]
    fn toml_is_read_and_errors_name_the_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.toml");
        fs::write(&path, "particles = 9\nfilter = \"5x5\"\ninterleave = [2, 3]\ncompensation = false\nclip = 1\n")
            .unwrap();
        let keys = RenderDefaults::load(&path).unwrap();
        let texts: Vec<String> = keys.given().iter().map(|(name, given)| format!("{name}={given}")).collect();
        assert_eq!(texts, ["particles=9", "interleave=2x3", "clip=1", "compensation=off", "filter=5x5"]);
        for (text, words) in [
            ("seed = 1\nparticels = 3\n", ["a.toml:2", "\"particles\""]),
            ("\nparticles = 0\n", ["a.toml:2", "from 1 to 65536"]),
            ("clip = nan\n", ["a.toml:1", "a number of 0 or more"]),
            ("clip = [1]\n", ["a.toml:1", "a number of 0 or more"]),
            ("seed =\n", ["a.toml:1", ""]),
        ] {
            fs::write(&path, text).unwrap();
            let message = RenderDefaults::load(&path).unwrap_err().to_string();
            assert!(words.iter().all(|word| message.contains(word)), "{text}: {message}");
        }
    }
}
