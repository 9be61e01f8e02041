//! The corpus of the fuzz targets, and every input that a fuzzer once found, through the functions that are fuzzed.

use std::fs;

use crate::support::project;

#[path = "../../fuzz/harness.rs"]
mod harness;

#[test]
fn the_corpus_of_every_target_runs_through() {
    for target in harness::TARGETS {
        let folder = project("fuzz/corpus").join(target);
        let mut paths: Vec<_> = fs::read_dir(&folder)
            .unwrap_or_else(|e| panic!("{}: {e}", folder.display()))
            .map(|entry| entry.unwrap().path())
            .collect();
        paths.sort();
        assert!(paths.len() >= 3, "{target}: {} inputs", paths.len());
        for path in &paths {
            // A find prints which input it was.
            eprintln!("{}", path.display());
            harness::run(target, &fs::read(path).unwrap());
        }
    }
    harness::clean_up();
}
