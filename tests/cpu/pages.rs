//! The pages of `docs/` name tests that exist.

use std::fs;
use std::path::{Path, PathBuf};

use lightsum::conform::ALL;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Whether a module of a test binary has this test; without a name, whether it exists.
fn exists(binary: &str, path: &str) -> bool {
    let folder = Path::new(ROOT).join("tests").join(binary);
    let (module, name) = path.rsplit_once("::").unwrap_or((path, ""));
    if let Some(group) = module.strip_prefix("checks").filter(|_| binary == "gpu") {
        let wanted = [group.trim_start_matches("::"), name].join("::");
        let wanted = wanted.trim_start_matches("::").trim_end_matches('*');
        return ALL.iter().any(|check| check.name.starts_with(wanted));
    }
    let file = |modules: &[&str]| {
        let path = folder.join(modules.join("/")).with_extension("rs");
        fs::read_to_string(path).ok()
    };
    let modules: Vec<&str> = module.split("::").collect();
    // A module has a file, or stands in that of the one around it.
    let text = match modules.split_last() {
        Some((last, around)) if !around.is_empty() => {
            file(&modules).or_else(|| file(around).filter(|text| text.contains(&format!("mod {last} {{"))))
        }
        _ => file(&modules),
    };
    let Some(text) = text else { return false };
    matches!(name, "" | "*") || is_test(&text, name)
}

/// Whether a source has a test of this name.
fn is_test(text: &str, name: &str) -> bool {
    text.match_indices(&format!("fn {name}(")).any(|(at, _)| {
        let attributes = text[..at].lines().rev().take_while(|line| !line.is_empty() && !line.starts_with('}'));
        attributes.into_iter().any(|line| line.trim() == "#[test]")
    })
}

/// All sources below a folder.
fn sources(folder: &Path, into: &mut String) {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        match path.extension() {
            None if path.is_dir() => sources(&path, into),
            Some(extension) if extension == "rs" => into.push_str(&fs::read_to_string(path).unwrap()),
            _ => {}
        }
    }
}

/// The words between back quotes that a page has, in lines that are no code, with their lines.
fn quoted(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut code = false;
    (1..).zip(text.lines()).flat_map(move |(number, line)| {
        code ^= line.starts_with("```");
        let words = line.split('`').skip(1).step_by(2).map(move |word| (number, word));
        words.take(if code { 0 } else { usize::MAX })
    })
}

#[test]
fn tests_that_pages_name_exist() {
    let mut all = String::new();
    ["src", "tests"].iter().for_each(|folder| sources(&Path::new(ROOT).join(folder), &mut all));
    let (mut named, mut missing) = (0, Vec::new());
    let pages = fs::read_dir(Path::new(ROOT).join("docs")).unwrap().map(|entry| entry.unwrap().path());
    for page in pages.filter(|path| path.extension().is_some_and(|extension| extension == "md")) {
        let text = fs::read_to_string(&page).unwrap();
        for (line, word) in quoted(&text) {
            let is_name = |name: &str| name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
            let there = match word.split_once(' ') {
                Some((binary @ ("cpu" | "gpu" | "cli"), path)) => exists(binary, path.trim_end_matches("::")),
                // Names of sentences are those of tests: `a_bake_keeps_the_passes_before_an_error`.
                None if word.matches('_').count() >= 4 => {
                    let name = word.rsplit("::").next().unwrap_or(word);
                    !is_name(name)
                        || is_test(&all, name)
                        || ALL.iter().any(|check| check.name.ends_with(&format!("::{name}")))
                }
                _ => continue,
            };
            named += 1;
            if !there {
                missing.push(format!("{}:{line}: {word}", page.display()));
            }
        }
    }
    assert!(missing.is_empty(), "there are no such tests:\n{}", missing.join("\n"));
    assert!(named > 50, "{named}");
}

#[test]
fn tests_that_do_not_exist_are_found() {
    assert!(exists("cli", "render") && exists("cpu", "ranges::*") && exists("cpu", "scene_gltf::damaged::*"));
    assert!(exists("cpu", "pages::tests_that_do_not_exist_are_found") && exists("gpu", "checks::film::*"));
    for [binary, path] in [
        ["cli", "rendering"],
        ["cli", "render::nothing_of_this_name"],
        ["cpu", "pages::exists"],
        ["gpu", "passes_film::finite_counts_the_pixels_that_are_no_numbers"],
        ["gpu", "checks::film::nothing_of_this_name"],
    ] {
        assert!(!exists(binary, path), "{binary} {path}");
    }
}
