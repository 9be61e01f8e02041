//! `coact diff`: what it names, held against the tables.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use coact::results::Results;
use serde_json::Value;

use crate::support::project;
use crate::support::recording_builder::{RecordingBuilder, step_message};

fn coact(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_coact"))
        .args(arguments)
        .output()
        .unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Extracts `input` into a folder of this name beside it.
#[track_caller]
fn extract(dir: &Path, input: &Path, name: &str, flags: &[&str]) -> PathBuf {
    let out = dir.join(name);
    let arguments = ["extract", text(input), "-o", text(&out), "-q"];
    let run = coact(&[&arguments[..], flags].concat());
    let told = String::from_utf8_lossy(&run.stderr);
    assert!(matches!(run.status.code(), Some(0 | 3)), "{told}");
    out
}

/// What `--json` says, and the exit code.
fn diff(a: &Path, b: &Path, flags: &[&str]) -> (Value, i32) {
    let output = coact(&[&["diff", text(a), text(b), "--json"], flags].concat());
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    let found = serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {told}"));
    (found, output.status.code().unwrap())
}

/// A recording of three episodes; step `altered` of the second has another action and state.
fn recording(path: &Path, altered: Option<usize>, n_episodes: i64) {
    let mut b = RecordingBuilder::new();
    for episode in 0..n_episodes {
        for step in 0..120 {
            let mut message = step_message(episode, step, step == 119);
            if episode == 1 && altered == Some(step) {
                message["action"] = serde_json::json!([0.75]);
                message["state"] = serde_json::json!([0.0, 0.6, 0.0]);
            }
            b.step(&message);
        }
    }
    fs::write(path, b.finish()).unwrap();
}

type Named = (i64, i64, u64, u64);

/// Episode, joint and steps of every segment.
fn segments(out: &Path) -> BTreeSet<Named> {
    let rows = Results::open(out).unwrap().segments();
    rows.map(|row| {
        let row = row.unwrap();
        let (start, end) = (row.start_step as u64, row.end_step as u64);
        (row.key.episode, i64::from(row.joint), start, end)
    })
    .collect()
}

/// The segments that a difference names on one side.
fn named(difference: &Value, side: &str) -> BTreeSet<Named> {
    let changes = difference["segments"].as_array().unwrap().iter();
    changes
        .filter(|change| !change[side].is_null())
        .map(|change| {
            let step = |which: &str| change[side][which].as_u64().unwrap();
            let number = |which: &str| change[which].as_i64().unwrap();
            (
                number("episode"),
                number("joint"),
                step("start_step"),
                step("end_step"),
            )
        })
        .collect()
}

#[test]
fn a_run_does_not_differ_from_itself() {
    let dir = tempfile::tempdir().unwrap();
    let a = extract(dir.path(), &project("fixtures/recordings"), "a", &[]);
    for flags in [&[][..], &["--tolerance", "0"], &["--allow-moved"]] {
        let (found, code) = diff(&a, &a, flags);
        assert_eq!(code, 0);
        assert_eq!(found["is_different"], false);
        assert_eq!(
            found["n_segments"]["same"].as_u64().unwrap(),
            segments_in(&a)
        );
        for list in ["parameters", "segments"] {
            assert_eq!(found[list], serde_json::json!([]));
        }
        for list in ["added", "gone", "changed"] {
            assert_eq!(found["episodes"][list], serde_json::json!([]));
        }
    }
    let output = coact(&["diff", text(&a), text(&a)]);
    let said = String::from_utf8(output.stdout).unwrap();
    assert_eq!(said, format!("{} segments the same\n", segments_in(&a)));
}

fn segments_in(out: &Path) -> u64 {
    Results::open(out).unwrap().segments().count() as u64
}

#[test]
fn after_one_step_was_altered_it_names_the_segments_that_changed_and_no_other() {
    let dir = tempfile::tempdir().unwrap();
    let input = dir.path().join("r.mcap");
    recording(&input, None, 3);
    let a = extract(dir.path(), &input, "a", &[]);
    let before = segments(&a);
    let mut n_different = 0;
    for altered in (20..110).step_by(15) {
        recording(&input, Some(altered), 3);
        let b = extract(dir.path(), &input, &format!("b{altered}"), &[]);
        let after = segments(&b);
        for tolerance in ["0", "3"] {
            let (found, code) = diff(&a, &b, &["--tolerance", tolerance]);
            assert_eq!(named(&found, "a"), &before - &after, "step {altered}");
            assert_eq!(named(&found, "b"), &after - &before, "step {altered}");
            assert_eq!(code, i32::from(before != after));
            assert_eq!(found["n_segments"]["same"], (&before & &after).len());
            let changes = found["segments"].as_array().unwrap();
            assert!(
                changes.iter().all(|change| change["episode"] == 1),
                "{found}"
            );
            let is_moved = |change: &&Value| change["change"] == "moved";
            let n_moved = changes.iter().filter(is_moved).count();
            assert_eq!(found["n_segments"]["moved"], n_moved);
            assert!(tolerance != "0" || n_moved == 0);
        }
        n_different += usize::from(before != after);
    }
    assert!(
        n_different >= 3,
        "{n_different} of the alterations changed segments"
    );
}

#[test]
fn episodes_and_parameters_that_differ_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let input = dir.path().join("r.mcap");
    recording(&input, None, 3);
    let a = extract(dir.path(), &input, "a", &[]);
    let other = extract(
        dir.path(),
        &input,
        "other",
        &["--threshold", "0.6", "--steps", "none"],
    );
    let (found, _) = diff(&a, &other, &[]);
    let parameters = serde_json::json!([
        {"name": "steps", "a": "full", "b": "none"},
        {"name": "threshold", "a": "0.5", "b": "0.6"},
    ]);
    assert_eq!(found["parameters"], parameters);

    recording(&input, None, 2);
    let fewer = extract(dir.path(), &input, "fewer", &[]);
    let (found, code) = diff(&a, &fewer, &[]);
    assert_eq!(code, 1);
    let entry = &found["episodes"]["gone"][0];
    assert_eq!(
        (&entry["episode"], &entry["n_steps"]),
        (&2.into(), &120.into())
    );
    assert_eq!(
        found["segments"],
        serde_json::json!([]),
        "those of the episode are not told one by one"
    );
    let (found, _) = diff(&fewer, &a, &[]);
    assert_eq!(found["episodes"]["added"][0]["episode"], 2);

    let mut b = RecordingBuilder::new();
    b.episode(0, 120);
    for step in (0..120).filter(|step| *step != 100) {
        b.step(&step_message(1, step, step == 119));
    }
    fs::write(&input, b.finish()).unwrap();
    let shorter = extract(dir.path(), &input, "shorter", &[]);
    let said = coact(&["diff", text(&fewer), text(&shorter)]);
    assert_eq!(said.status.code(), Some(1));
    let said = String::from_utf8(said.stdout).unwrap();
    let expected = "episode r.mcap:1 changed: ok, 120 steps → incomplete, 100 steps\n";
    assert!(said.starts_with(expected), "{said}");
    assert!(said.ends_with("; 1 episode changed\n"), "{said}");
}

#[track_caller]
fn check(arguments: &[&str], word: &str) {
    let output = coact(arguments);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains(word), "{told}");
    assert!(output.stdout.is_empty());
}

#[test]
fn what_cannot_be_compared_is_exit_code_2() {
    let dir = tempfile::tempdir().unwrap();
    let input = dir.path().join("r.mcap");
    recording(&input, None, 1);
    let a = extract(dir.path(), &input, "a", &[]);
    let nowhere = dir.path().join("nowhere");
    check(&["diff", text(&a)], "<B>");
    check(
        &["diff", text(&a), text(&nowhere)],
        "nowhere is not a directory",
    );
    check(&["diff", text(dir.path()), text(&a)], "no results");
    check(&["diff", text(&a), text(&a), "--tolerance", "few"], "few");
    let part = a.join("segments/part-00000-00000.parquet");
    fs::write(&part, "junk").unwrap();
    check(&["diff", text(&a), text(&a)], "part-00000-00000.parquet");
}
