//! `public_api RUSTDOC.json LIST.txt [--bless]`: the public items of a crate, one a line, against the list that is kept.
//!
//! Differences are errors, so that a change of the interface is seen where it is made: removed and changed lines break hosts, added ones
//! do not. `--bless` writes the list.

use std::fs;
use std::process::ExitCode;

use public_api::{Builder, PublicApi};

/// The items, without what is implemented for all types and what compilers derive.
fn items(json: &str) -> Result<PublicApi, String> {
    let builder = Builder::from_rustdoc_json(json)
        .omit_blanket_impls(true)
        .omit_auto_trait_impls(true)
        .omit_auto_derived_impls(true);
    builder.build().map_err(|error| format!("{json}: {error}"))
}

/// Lines of one text that the other lacks.
fn lacking<'a>(from: &'a str, other: &str) -> Vec<&'a str> {
    let others: std::collections::BTreeSet<&str> = other.lines().collect();
    from.lines().filter(|line| !others.contains(line)).collect()
}

fn run(json: &str, list: &str, bless: bool) -> Result<(), String> {
    let found = format!("{}", items(json)?);
    if bless {
        return fs::write(list, &found).map_err(|error| format!("{list}: {error}"));
    }
    let kept = fs::read_to_string(list).map_err(|error| format!("{list}: {error}"))?;
    let (gone, new) = (lacking(&kept, &found), lacking(&found, &kept));
    if gone.is_empty() && new.is_empty() {
        println!("the public interface is that of {list}: {} items", found.lines().count());
        return Ok(());
    }
    gone.iter().for_each(|line| eprintln!("-{line}"));
    new.iter().for_each(|line| eprintln!("+{line}"));
    let breaking = if gone.is_empty() { "breaks no host" } else { "may break hosts (lines with -)" };
    Err(format!("the public interface differs from {list}, which {breaking}; `scripts/public_api.sh --bless` keeps it, with a line in CHANGELOG.md"))
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let result = match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [json, list] => run(json, list, false),
        [json, list, "--bless"] => run(json, list, true),
        _ => Err(String::from("usage: public_api RUSTDOC.json LIST.txt [--bless]")),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}
