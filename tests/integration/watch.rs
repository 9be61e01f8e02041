//! Recordings that are watched while they grow, where calls to the file system fail. (What a process does beside a
//! recorder is in `tests/python/test_watch.py`.)

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use coact::extraction::{ExtractionParams, RawParams};
use coact::pipeline::{self, Config, Interrupt, RunError, WatchConfig};
use coact::recording::ReadOptions;
use coact::results::Results;
use coact::summary::WatchSummary;
use coact::tables::Faults;

use rayon::prelude::*;

use crate::support::recording_builder::{Layout, RecordingBuilder};
use crate::support::rows::{check_all_open, rows, temporaries};

fn config(inputs: &Path, output: &Path, faults: Option<Arc<Faults>>) -> Config {
    Config {
        inputs: vec![inputs.to_owned()],
        output: Some(output.to_owned()),
        events: None,
        params: ExtractionParams::new(RawParams::default()).unwrap(),
        read: ReadOptions::default(),
        steps: true,
        overwrite: false,
        threads: 1,
        max_part_rows: 1 << 20,
        faults,
        parameters: vec![("bins".to_owned(), "64".to_owned())],
        shard: None,
    }
}

/// One look, by a process that is asked to end before it begins: it takes what is complete.
fn look(
    inputs: &Path,
    output: &Path,
    faults: Option<Arc<Faults>>,
) -> Result<WatchSummary, RunError> {
    let interrupt = Interrupt::default();
    interrupt.raise();
    let config = WatchConfig {
        run: config(inputs, output, faults),
        interval: Duration::ZERO,
        merge_after: 2,
    };
    loop {
        match pipeline::watch(&config, &|_| {}, &interrupt) {
            // A process that another test has just forked holds all our files until it becomes its own program.
            Err(RunError::Failed(e)) if e.to_string().contains("in use by another") => {}
            result => break result,
        }
    }
}

/// A recording of small chunks, so that each episode is there soon after its end.
fn recording(n_episodes: i64) -> Vec<u8> {
    let mut b = RecordingBuilder::with_layout(Layout {
        chunk_size: 256,
        ..Layout::default()
    });
    for episode in 0..n_episodes {
        b.episode(episode, 30);
    }
    b.finish()
}

#[test]
fn any_call_to_the_file_system_may_fail_and_no_reader_misses_a_row_or_sees_it_twice() {
    let dir = tempfile::tempdir().unwrap();
    let data = [recording(4), recording(5)];
    let whole = dir.path().join("whole");
    fs::create_dir_all(&whole).unwrap();
    for (i, data) in data.iter().enumerate() {
        fs::write(whole.join(format!("r{i}.mcap")), data).unwrap();
    }
    let batch = dir.path().join("batch");
    pipeline::run(
        &config(&whole, &batch, None),
        &|_| {},
        &Interrupt::default(),
    )
    .unwrap();
    let expected = rows(&batch);
    // Five looks, at files that grow between them.
    let go = |folder: &Path, faults: &Arc<Faults>| {
        let (inputs, output) = (folder.join("in"), folder.join("out"));
        fs::create_dir_all(&inputs).unwrap();
        let mut n_failed = 0;
        let mut n_seen = 0;
        for fifth in 1..=5 {
            for (i, data) in data.iter().enumerate() {
                let there = &data[..data.len() * fifth / 5];
                fs::write(inputs.join(format!("r{i}.mcap")), there).unwrap();
            }
            if let Err(e) = look(&inputs, &output, Some(Arc::clone(faults))) {
                let told = format!("{e:#}");
                assert!(told.contains("out") && told.contains("fault"), "{told}");
                n_failed += 1;
                if output.join("_coact/run.json").exists() {
                    check_all_open(&output);
                    n_seen = n_seen.max(check_episodes(&output, n_seen));
                }
                look(&inputs, &output, None).unwrap();
            }
            assert_eq!(temporaries(&output).len(), 0);
            n_seen = check_episodes(&output, n_seen);
        }
        assert_eq!(rows(&output), expected);
        assert!(output.join("_SUCCESS").exists());
        n_failed
    };
    let counter = Arc::new(Faults::none());
    assert_eq!(go(&dir.path().join("counted"), &counter), 0);
    let n_calls = counter.calls();
    assert!(n_calls > 200, "{n_calls} calls");
    let n_failed: u64 = (0..n_calls)
        .into_par_iter()
        .map(|call| {
            let folder = dir.path().join(format!("failed-{call}"));
            let n_failed = go(&folder, &Arc::new(Faults::at(call, false)));
            fs::remove_dir_all(&folder).unwrap();
            n_failed
        })
        .sum();
    assert_eq!(n_failed, n_calls, "every call that fails is told of");
}

/// A reader of the commits sees each episode once, and all that were seen before.
#[track_caller]
fn check_episodes(output: &Path, n_seen: usize) -> usize {
    let episodes = Results::open(output).unwrap().episodes();
    let mut keys: Vec<(String, i64)> = episodes
        .map(|row| row.unwrap())
        .map(|row| (row.key.recording.to_string(), row.key.episode))
        .collect();
    let n = keys.len();
    keys.sort();
    keys.dedup();
    assert_eq!(keys.len(), n, "an episode is there twice");
    assert!(n >= n_seen, "{n} episodes where {n_seen} were");
    n
}
