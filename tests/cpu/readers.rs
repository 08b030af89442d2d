//! The kept corpus of the fuzzer, in `fuzz/corpus`: each file is read or refused, as the fuzzer found it.

use std::path::Path;
use std::time::{Duration, Instant};

#[path = "../../fuzz/readers.rs"]
mod formats;

#[test]
fn the_kept_corpus_is_read_or_refused() {
    formats::watch_panics(|_| {});
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    let (mut bytes, mut all_refused) = (0, 0);
    for (name, _) in formats::READERS {
        let mut files: Vec<_> =
            std::fs::read_dir(corpus.join(name)).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        let (mut valid, mut refused) = (0, 0);
        for file in &files {
            let content = std::fs::read(file).unwrap();
            bytes += content.len();
            let start = Instant::now();
            let outcome = std::panic::catch_unwind(|| formats::read(name, &content));
            let panics = formats::panics();
            assert!(panics.is_empty() && outcome.is_ok(), "{}: {panics:?}", file.display());
            assert!(start.elapsed() < Duration::from_secs(10), "{}: {:?}", file.display(), start.elapsed());
            *(if outcome.unwrap() { &mut valid } else { &mut refused }) += 1;
        }
        println!("{name}: {valid} files are valid, {refused} are refused");
        assert!(valid > 0, "{name}: all {refused} are refused");
        all_refused += refused;
    }
    assert!(all_refused > 20, "{all_refused} are refused");
    assert!(bytes < 300_000, "{bytes} bytes; keep the corpus small");
}
