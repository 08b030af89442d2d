//! `lightsum manual`: completions of shells, pages of the manual, and docs/reference.md, all from the definitions of the flags.

use std::path::Path;

use clap::{Arg, Command};
use lightsum::settings::keys::{KEYS, Key, Takes};
use lightsum::{Error, Result, output};

use crate::args::{self, Manual};
use crate::say;

/// Runs the command.
pub fn run(args: &Manual) -> Result<()> {
    match args {
        Manual::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut args::command(), "lightsum", &mut script);
            say(String::from_utf8_lossy(&script).trim_end());
            Ok(())
        }
        Manual::Man { into } => {
            let mut root = args::command();
            root.build();
            write_page(into, &root, "lightsum")?;
            let of_users =
                root.get_subcommands().filter(|command| !command.is_hide_set() && command.get_name() != "help");
            for command in of_users {
                let name = format!("lightsum-{}", command.get_name());
                write_page(into, &command.clone().name(name.clone()), &name)?;
            }
            Ok(())
        }
        Manual::Reference { into } => output::write_file(&into.join("reference.md"), &[reference().as_bytes()]),
    }
}

fn write_page(folder: &Path, command: &Command, name: &str) -> Result<()> {
    let path = folder.join(format!("{name}.1"));
    let mut page = Vec::new();
    clap_mangen::Man::new(command.clone()).render(&mut page).map_err(Error::io("writing", &path))?;
    output::write_file(&path, &[&page])
}

/// All keys and flags, as Markdown.
fn reference() -> String {
    let mut text = String::from(
        "# Flags and keys\n\nWritten by `lightsum manual reference --into docs`; a test compares it with the program. [command-line.md](command-line.md) says \
         which one counts where several are given.\n\n# Settings\n\nFlags, keys of `[render]` and of `--set`, which have the same name with underscores.\n",
    );
    let mut headings: Vec<&str> = Vec::new();
    for key in KEYS {
        if !headings.contains(&key.heading) {
            headings.push(key.heading);
        }
    }
    for heading in headings {
        text +=
            &format!("\n## {heading}\n\n| flag | key | values | default | of | meaning |\n|---|---|---|---|---|---|\n");
        KEYS.iter().filter(|key| key.heading == heading).for_each(|key| text += &row_of_key(key));
    }
    text += "\n# Other flags\n";
    let root = args::command();
    text += "\n## All commands\n\n";
    text += &table(&root);
    for command in root.get_subcommands().filter(|command| !command.is_hide_set()) {
        let about = command.get_about().map(ToString::to_string).unwrap_or_default();
        text += &format!("\n## lightsum {}\n\n{about}\n\n{}", command.get_name(), table(command));
    }
    text
}

/// A cell of a table.
fn cell(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

fn row_of_key(key: &Key) -> String {
    let mut flag = match key.takes {
        Takes::Switch => format!("`{}`, `{}`", key.flag, key.flag.replacen("--", "--no-", 1)),
        _ => format!("`{} {}`", key.flag, key.value_name),
    };
    if key.name == "compensation" {
        flag += ", `--no-compensation`";
    }
    if let Some(alias) = key.alias {
        flag += &format!(", `--{}`", alias.replace('_', "-"));
    }
    let words: Vec<String> = key.words.iter().map(|(word, meaning)| format!("`{word}`: {meaning}")).collect();
    let mut meaning = key.paragraphs().join(" ");
    if !words.is_empty() {
        meaning += &format!(" {}.", words.join("; "));
    }
    let cells = [&flag, &format!("`{}`", key.name), &key.expected(), key.default, &key.commands.join(", "), &meaning];
    format!("| {} |\n", cells.map(|text: &str| cell(text)).join(" | "))
}

/// Whether the table of settings has a flag of a command.
fn is_setting(command: &Command, arg: &Arg) -> bool {
    let id = arg.get_id().as_str();
    let of_key = Key::named(id).or_else(|| id.strip_prefix("no_").and_then(Key::named));
    of_key.is_some_and(|key| key.has_flag && key.acts_on(command.get_name()))
}

/// The other flags of a command.
fn table(command: &Command) -> String {
    let mut text = String::from("| flag | values | default | meaning |\n|---|---|---|---|\n");
    for arg in command.get_arguments().filter(|arg| !is_setting(command, arg)) {
        let value = arg.get_value_names().map(|names| names.join(" ")).filter(|_| arg.get_action().takes_values());
        let value = value.map_or(String::new(), |value| format!(" {value}"));
        let mut flag = match (arg.get_long(), arg.get_short()) {
            (Some(long), Some(short)) => format!("`-{short}`, `--{long}{value}`"),
            (Some(long), None) => format!("`--{long}{value}`"),
            (None, _) => format!("`{}`", value.trim()),
        };
        for alias in arg.get_visible_aliases().unwrap_or_default() {
            flag += &format!(", `--{alias}`");
        }
        let possible = arg.get_possible_values();
        let words: Vec<&str> = possible.iter().map(|value| value.get_name()).collect();
        let values = if arg.get_action().takes_values() { words.join(", ") } else { String::new() };
        let default =
            arg.get_default_values().iter().map(|value| value.to_string_lossy()).collect::<Vec<_>>().join(", ");
        let default = if arg.get_action().takes_values() { default } else { String::new() };
        let help = arg.get_long_help().or(arg.get_help()).map(ToString::to_string).unwrap_or_default();
        text += &format!("| {} |\n", [flag, values, default, help].map(|text| cell(&text)).join(" | "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the window is left out, its command is too.
    #[cfg(feature = "viewer")]
    #[test]
    fn the_reference_in_the_documentation_is_up_to_date() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/reference.md");
        let written = std::fs::read_to_string(path).unwrap();
        assert!(written == reference(), "run `cargo run -- manual reference --into docs`");
    }

    #[test]
    fn no_flag_and_no_key_is_left_out() {
        let reference = reference();
        let root = args::command();
        let mut flags = 0;
        for command in root.get_subcommands().filter(|command| !command.is_hide_set()).chain([&root]) {
            for long in command.get_arguments().filter_map(|arg| arg.get_long()) {
                let known =
                    [format!("`--{long}`"), format!("`--{long} ")].iter().any(|flag| reference.contains(flag.as_str()));
                assert!(known, "{}: --{long}", command.get_name());
                flags += 1;
            }
        }
        for key in KEYS {
            assert!(reference.contains(&format!("| `{}` |", key.name)), "{}", key.name);
        }
        assert!(flags > 200, "{flags} flags");
    }
}
