//! What is left of a run that is stopped: by a failing call to the file system, by a full disk, by a signal, by
//! `kill -9`; and what the same command then makes of it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use coact::extraction::{ExtractionParams, RawParams};
use coact::pipeline::{self, Config, Interrupt, RunError};
use coact::recording::ReadOptions;
use coact::summary::RunOutcome;
use coact::tables::Faults;

use rayon::prelude::*;

use crate::support::recording_builder::{RecordingBuilder, step_message};
use crate::support::rows::{check_all_open, rows, temporaries};

/// Kills in the short form of the sweep; `COACT_SWEEP` sets another number (see `scripts/fault_sweep.sh`).
const KILLS: u64 = 8;

fn kills() -> u64 {
    std::env::var("COACT_SWEEP")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(KILLS)
}

/// Was the long form asked for?
fn is_long() -> bool {
    kills() > KILLS
}

fn coact() -> Command {
    Command::new(env!("CARGO_BIN_EXE_coact"))
}

/// Recordings of several episodes, one of them large enough for several parts.
fn recordings(folder: &Path, n: usize) {
    fs::create_dir_all(folder).unwrap();
    for i in 0..n {
        let mut b = RecordingBuilder::new();
        let n_episodes = if i == 1 { 12 } else { 2 };
        for episode in 0..n_episodes {
            b.episode(episode, 60 + 7 * i);
        }
        fs::write(folder.join(format!("r{i}.mcap")), b.finish()).unwrap();
    }
}

pub(crate) fn config(inputs: &Path, output: &Path, faults: Option<Arc<Faults>>) -> Config {
    Config {
        inputs: vec![inputs.to_owned()],
        shard: None,
        output: Some(output.to_owned()),
        events: None,
        params: ExtractionParams::new(RawParams::default()).unwrap(),
        read: ReadOptions::default(),
        steps: true,
        overwrite: false,
        threads: 1,
        max_part_rows: 150,
        faults,
        parameters: vec![("bins".to_owned(), "64".to_owned())],
    }
}

fn run(config: &Config) -> Result<RunOutcome, RunError> {
    pipeline::run(config, &|_| {}, &Interrupt::default()).map(|summary| summary.outcome())
}

#[test]
fn any_call_to_the_file_system_may_fail_and_nothing_is_lost_or_doubled() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    recordings(&inputs, 3);
    let whole = dir.path().join("whole");
    let counter = Arc::new(Faults::none());
    run(&config(&inputs, &whole, Some(Arc::clone(&counter)))).unwrap();
    let expected = rows(&whole);
    let n_calls = counter.calls();
    assert!(n_calls > 100, "{n_calls} calls");
    // A disk that stays full is tried at every call in the long form of the sweep.
    let stride = if is_long() { 1 } else { 6 };
    let cases: Vec<(u64, bool)> = (0..n_calls)
        .map(|call| (call, false))
        .chain((0..n_calls).step_by(stride).map(|call| (call, true)))
        .collect();
    cases.par_iter().for_each(|&(call, for_good)| {
        let output = dir.path().join(format!("out-{for_good}-{call}"));
        let faults = Arc::new(Faults::at(call, for_good));
        let result = run(&config(&inputs, &output, Some(faults)));
        let told = match result {
            Err(RunError::Failed(e)) => format!("{e:#}"),
            other => panic!("call {call} failed and the run said {other:?}"),
        };
        assert!(told.contains("out-") && told.contains("fault"), "{told}");
        if output.is_dir() {
            check_all_open(&output);
            assert_eq!(temporaries(&output), [] as [PathBuf; 0], "call {call}");
            if output.join("_SUCCESS").exists() {
                // Only the very last call, which makes the mark durable, can fail behind it.
                assert_eq!(rows(&output), expected, "call {call}");
            }
        }
        run(&config(&inputs, &output, None)).unwrap();
        assert_eq!(rows(&output), expected, "call {call}, for good {for_good}");
        assert!(output.join("_SUCCESS").exists());
        fs::remove_dir_all(&output).unwrap();
    });
    eprintln!("{} failing calls; rows lost: 0, doubled: 0", cases.len());
}

#[test]
fn a_killed_run_goes_on_and_ends_with_the_same_rows() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    recordings(&inputs, 12);
    let extract = |output: &Path| {
        let mut command = coact();
        command
            .arg("extract")
            .arg(&inputs)
            .arg("--output")
            .arg(output)
            .args(["--max-part-rows", "150", "--threads", "1", "-q"])
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        command
    };
    let whole = dir.path().join("whole");
    let started = std::time::Instant::now();
    assert!(extract(&whole).status().unwrap().success());
    let whole_run = started.elapsed();
    let expected = rows(&whole);
    let n = kills();
    let mut n_interrupted = 0;
    for i in 0..n {
        let output = dir.path().join(format!("killed-{i}"));
        let mut process = extract(&output).spawn().unwrap();
        // Spread over the run, from before its first file to after its last.
        let moment = whole_run.mul_f64((i as f64 + 0.5) / n as f64);
        std::thread::sleep(moment);
        process.kill().unwrap();
        process.wait().unwrap();
        if output.is_dir() {
            check_all_open(&output);
            n_interrupted += u64::from(!output.join("_SUCCESS").exists());
        }
        assert!(extract(&output).status().unwrap().success(), "kill {i}");
        assert_eq!(rows(&output), expected, "kill {i}");
        assert_eq!(temporaries(&output), [] as [PathBuf; 0]);
        fs::remove_dir_all(&output).unwrap();
    }
    assert!(n_interrupted > 0, "no kill came in time");
    eprintln!("{n} kills, {n_interrupted} before the end; rows lost: 0, doubled: 0");
}

/// As if the process had been killed right behind its `n`-th commit.
fn cut_behind(output: &Path, n: usize) {
    let commits = output.join("_coact/commits");
    let mut names: Vec<PathBuf> = fs::read_dir(&commits)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    names.sort();
    for path in names.iter().skip(n) {
        fs::remove_file(path).unwrap();
    }
    fs::remove_file(output.join("_SUCCESS")).unwrap();
}

#[test]
fn a_run_killed_twice_behind_any_commits_ends_with_the_same_rows_and_outcome() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    recordings(&inputs, 3);
    // Tried again by every process, and in front of the recording that is cut.
    fs::write(inputs.join("bad.mcap"), b"not a recording").unwrap();
    let whole = dir.path().join("whole");
    run(&config(&inputs, &whole, None)).unwrap();
    let expected = rows(&whole);
    let n_commits = fs::read_dir(whole.join("_coact/commits")).unwrap().count();
    assert!(n_commits > 5, "{n_commits}");
    let cases: Vec<(usize, usize)> = (0..=n_commits)
        .flat_map(|first| [(first, first), (first, first + 1)])
        .collect();
    cases.par_iter().for_each(|&(first, second)| {
        let output = dir.path().join(format!("cut-{first}-{second}"));
        let go = || loop {
            match run(&config(&inputs, &output, None)) {
                // A process that another test has just forked holds all our files until it becomes its own program.
                Err(RunError::Failed(e)) if e.to_string().contains("in use by another") => {}
                result => break result.unwrap(),
            }
        };
        go();
        for n in [first, second] {
            cut_behind(&output, n);
            assert_eq!(go(), RunOutcome::Partial, "{first}, {second}");
        }
        assert_eq!(rows(&output), expected, "{first}, {second}");
    });
}

#[test]
fn a_recording_of_which_only_the_row_is_left_to_write_is_no_failure() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 1);
    let one_a_part = Config {
        max_part_rows: 1,
        ..config(&inputs, &output, None)
    };
    assert_eq!(run(&one_a_part).unwrap(), RunOutcome::Done);
    cut_behind(&output, 2);
    assert_eq!(run(&one_a_part).unwrap(), RunOutcome::Done);
}

#[test]
fn a_run_without_a_step_stands_in_the_way_of_no_other() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 1);
    let extract = |input: &Path, options: &[&str]| {
        let mut command = coact();
        command.arg("extract").arg(input).arg("-o").arg(&output);
        command.args(options).output().unwrap().status.code()
    };
    let mistyped = ["--action", "/x:y", "--state", "/x:z"];
    assert_eq!(extract(&inputs, &mistyped), Some(1));
    assert!(!output.join("_SUCCESS").exists());
    assert_eq!(extract(&inputs.join("gone.mcap"), &[]), Some(1));
    // Every step is bad.
    assert_eq!(extract(&inputs, &["--state", "/step:stat"]), Some(3));
    assert_eq!(extract(&inputs, &[]), Some(0));
    let fresh = dir.path().join("fresh");
    run(&Config {
        max_part_rows: coact::pipeline::DEFAULT_MAX_PART_ROWS,
        ..config(&inputs, &fresh, None)
    })
    .unwrap();
    assert_eq!(rows(&output), rows(&fresh));
    // One that gave episodes does.
    assert_eq!(extract(&inputs, &mistyped), Some(2));
}

#[test]
fn the_same_command_again_takes_only_what_is_new_or_had_failed() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 2);
    fs::write(inputs.join("bad.mcap"), b"not a recording").unwrap();
    assert_eq!(
        run(&config(&inputs, &output, None)).unwrap(),
        RunOutcome::Partial
    );
    let first = rows(&output);
    assert_eq!(first["recordings"].len(), 3);
    // Nothing new: the same rows, and the same outcome.
    let before = rows(&output);
    assert_eq!(
        run(&config(&inputs, &output, None)).unwrap(),
        RunOutcome::Partial
    );
    assert_eq!(rows(&output), before);
    // The failed one is mended, and one is new.
    let mut b = RecordingBuilder::new();
    b.episode(0, 40);
    fs::write(inputs.join("bad.mcap"), b.finish()).unwrap();
    let mut b = RecordingBuilder::new();
    b.episode(0, 50);
    fs::write(inputs.join("new.mcap"), b.finish()).unwrap();
    assert_eq!(
        run(&config(&inputs, &output, None)).unwrap(),
        RunOutcome::Done
    );
    let fresh = dir.path().join("fresh");
    run(&config(&inputs, &fresh, None)).unwrap();
    assert_eq!(rows(&output), rows(&fresh));
}

#[test]
fn a_recording_that_changed_or_vanished_is_an_error_that_overwrite_settles() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 3);
    run(&config(&inputs, &output, None)).unwrap();
    let mut b = RecordingBuilder::new();
    b.episode(5, 40);
    fs::write(inputs.join("r0.mcap"), b.finish()).unwrap();
    let changed = run(&config(&inputs, &output, None));
    assert!(
        matches!(&changed, Err(RunError::Arguments(e)) if e.contains("r0.mcap has changed")),
        "{changed:?}"
    );
    fs::remove_file(inputs.join("r0.mcap")).unwrap();
    let vanished = run(&config(&inputs, &output, None));
    assert!(
        matches!(&vanished, Err(RunError::Arguments(e)) if e.contains("no longer among")),
        "{vanished:?}"
    );
    let again = Config {
        overwrite: true,
        ..config(&inputs, &output, None)
    };
    run(&again).unwrap();
    assert_eq!(rows(&output)["recordings"].len(), 2);
}

#[test]
fn another_run_in_the_directory_is_refused_and_says_what_differs() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 1);
    let run_with = |options: &[&str]| {
        let mut command = coact();
        command.arg("extract").arg(&inputs).arg("-o").arg(&output);
        command.args(options).output().unwrap()
    };
    assert_eq!(run_with(&[]).status.code(), Some(0));
    let refused = run_with(&["--window", "7"]);
    assert_eq!(refused.status.code(), Some(2));
    let told = String::from_utf8(refused.stderr).unwrap();
    assert!(told.contains("window was 5, is 7"), "{told}");
    assert_eq!(run_with(&["--threads", "1", "-q"]).status.code(), Some(0));
    assert_eq!(run_with(&["--steps", "none"]).status.code(), Some(2));
    assert_eq!(
        run_with(&["--window", "7", "--overwrite"]).status.code(),
        Some(0)
    );
}

#[test]
fn a_second_process_is_refused_and_the_lock_dies_with_its_holder() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 1);
    let held = coact::tables::OutputDirectory::open(
        &output,
        &coact::tables::TableOptions {
            metadata: vec![("coact.bins".to_owned(), "64".to_owned())],
            ..coact::tables::TableOptions::default()
        },
        false,
    )
    .unwrap();
    for overwrite in [false, true] {
        let second = Config {
            overwrite,
            ..config(&inputs, &output, None)
        };
        let refused = run(&second);
        assert!(
            matches!(&refused, Err(RunError::Failed(e)) if e.to_string().contains("in use by another process")),
            "{refused:?}"
        );
    }
    drop(held);
    run(&config(&inputs, &output, None)).unwrap();
}

#[cfg(unix)]
#[test]
fn signals_stop_a_run_and_leave_nothing_half_done() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    recordings(&inputs, 3);
    // One recording that takes longer than the test waits.
    let mut b = RecordingBuilder::new();
    for episode in 0..400 {
        for step in 0..200 {
            b.step(&step_message(episode, step, step == 199));
        }
    }
    fs::write(inputs.join("r9.mcap"), b.finish()).unwrap();
    let extract = |output: &Path| {
        let mut command = coact();
        command
            .arg("extract")
            .arg(&inputs)
            .arg("-o")
            .arg(output)
            .args([
                "--max-part-rows",
                "500",
                "--threads",
                "1",
                "--measure",
                "sample",
                "-q",
            ])
            .stderr(Stdio::null());
        command
    };
    let whole = dir.path().join("whole");
    assert!(extract(&whole).status().unwrap().success());
    let expected = rows(&whole);
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let output = dir.path().join(signal);
        let mut stopped = false;
        for delay in [60, 30, 120, 15, 240] {
            let mut process = extract(&output).spawn().unwrap();
            std::thread::sleep(Duration::from_millis(delay));
            let sent = std::time::Instant::now();
            let id = process.id().to_string();
            Command::new("kill")
                .args(["-s", signal, &id])
                .status()
                .unwrap();
            let status = process.wait().unwrap();
            assert!(
                sent.elapsed() < Duration::from_secs(2),
                "{:?}",
                sent.elapsed()
            );
            if output.is_dir() {
                check_all_open(&output);
                assert_eq!(temporaries(&output), [] as [PathBuf; 0]);
            }
            if status.code() == Some(code) {
                stopped = true;
                assert!(extract(&output).status().unwrap().success());
                assert_eq!(rows(&output), expected, "after {signal}");
                break;
            }
            // Too early for the handler, or too late for the run.
            fs::remove_dir_all(&output).unwrap_or_default();
        }
        assert!(stopped, "no signal came in time");
    }
}

#[test]
fn a_killed_overwrite_is_no_run_that_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, whole) = (dir.path().join("in"), dir.path().join("whole"));
    recordings(&inputs, 3);
    run(&config(&inputs, &whole, None)).unwrap();
    let expected = rows(&whole);
    let mut n_refused = 0;
    for call in 0..40 {
        let output = dir.path().join(format!("out-{call}"));
        run(&config(&inputs, &output, None)).unwrap();
        let overwrite = |faults| {
            run(&Config {
                overwrite: true,
                ..config(&inputs, &output, faults)
            })
        };
        // Nothing after it is done either, as when the process is killed.
        overwrite(Some(Arc::new(Faults::at(call, true)))).unwrap_err();
        match run(&config(&inputs, &output, None)) {
            Err(RunError::Arguments(e)) => {
                assert!(e.contains("--overwrite"), "{e}");
                n_refused += 1;
                overwrite(None).unwrap();
            }
            result => {
                result.unwrap();
            }
        }
        assert_eq!(rows(&output), expected, "call {call}");
        fs::remove_dir_all(&output).unwrap();
    }
    assert!(n_refused > 5, "{n_refused}");
}

#[test]
fn the_mark_goes_before_the_rows_of_what_had_failed() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 1);
    fs::write(inputs.join("bad.mcap"), b"not a recording").unwrap();
    run(&config(&inputs, &output, None)).unwrap();
    let whole = rows(&output);
    for call in 0..20 {
        let faults = Some(Arc::new(Faults::at(call, true)));
        let _fails = run(&config(&inputs, &output, faults));
        let is_marked = output.join("_SUCCESS").exists();
        assert!(!is_marked || rows(&output) == whole, "call {call}");
        run(&config(&inputs, &output, None)).unwrap();
        assert_eq!(rows(&output), whole, "call {call}");
    }
}

#[cfg(unix)]
#[test]
fn a_signal_to_a_process_without_the_lock_costs_the_other_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("out");
    let folder = output.join("episodes");
    fs::create_dir_all(&folder).unwrap();
    let of_another = folder.join(".part-00000-00000.parquet.0123456789abcdef.tmp");
    fs::write(&of_another, b"").unwrap();
    pipeline::remove_temporaries(Some(&output), None);
    assert!(of_another.exists());
}
