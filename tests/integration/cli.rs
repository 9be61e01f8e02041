//! The process as a user runs it: exit codes, streams, files.

use std::path::Path;
use std::process::{Command, Output};

use arrow::array::RecordBatch;
use coact::tables::Table;

use crate::support::project;
use crate::support::recording_builder::RecordingBuilder;
use crate::tables::read_table;

fn coact(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_coact"))
        .args(arguments)
        .output()
        .unwrap()
}

fn code(output: &Output) -> i32 {
    output.status.code().unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A folder with one good recording of two episodes.
fn one_recording() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let mut b = RecordingBuilder::new();
    b.metadata(&[("env_id", "Test-v0")])
        .episode(0, 60)
        .episode(1, 40);
    std::fs::write(dir.path().join("good.mcap"), b.finish()).unwrap();
    dir
}

fn all_tables(directory: &Path) -> Vec<Vec<RecordBatch>> {
    Table::ALL
        .iter()
        .map(|t| read_table(directory, *t))
        .collect()
}

#[test]
fn the_fixtures_give_tables_that_are_equal_for_any_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let fixtures = project("fixtures");
    let run = |threads: &str| {
        let out = dir.path().join(threads);
        let output = coact(&[
            "extract",
            text(&fixtures),
            "-o",
            text(&out),
            "--threads",
            threads,
        ]);
        assert_eq!(code(&output), 0, "{}", stderr(&output));
        assert_eq!(stderr(&output), "", "no progress into a pipe");
        assert!(
            stdout(&output).contains("composite actions in"),
            "{}",
            stdout(&output)
        );
        out
    };
    let (one, two) = (run("1"), run("2"));
    let tables = all_tables(&one);
    assert_eq!(tables, all_tables(&two));
    assert!(tables[0].iter().map(RecordBatch::num_rows).sum::<usize>() > 300);
}

#[test]
fn exit_code_1_and_one_line_where_nothing_can_be_extracted() {
    #[track_caller]
    fn check(input: &Path, word: &str) {
        let dir = tempfile::tempdir().unwrap();
        let output = coact(&["extract", text(input), "-o", text(&dir.path().join("out"))]);
        assert_eq!(code(&output), 1, "{}", stderr(&output));
        assert!(stderr(&output).contains(word), "{}", stderr(&output));
        assert!(stderr(&output).lines().count() <= 2, "{}", stderr(&output));
    }
    let dir = tempfile::tempdir().unwrap();
    check(dir.path(), "no recordings found");
    check(&dir.path().join("missing.mcap"), "no such file");
    let mut other = RecordingBuilder::new();
    other.message("/camera", "protobuf", b"x");
    std::fs::write(dir.path().join("other.mcap"), other.finish()).unwrap();
    check(
        &dir.path().join("other.mcap"),
        "/camera (protobuf, 1 messages)",
    );
    std::fs::write(dir.path().join("page.mcap"), b"<!DOCTYPE html>").unwrap();
    check(&dir.path().join("page.mcap"), "HTML");
}

#[test]
fn exit_code_2_for_bad_arguments() {
    #[track_caller]
    fn check(arguments: &[&str], word: &str) {
        let output = coact(arguments);
        assert_eq!(code(&output), 2, "{arguments:?}");
        assert!(stderr(&output).contains(word), "{}", stderr(&output));
    }
    check(
        &["extract", "x.mcap", "-o", "out", "--bins", "1"],
        "bins is 1",
    );
    check(
        &[
            "extract",
            "x.mcap",
            "-o",
            "out",
            "--measure",
            "sample",
            "--window",
            "3",
        ],
        "window is 3",
    );
    check(
        &["extract", "x.mcap", "-o", "out", "--measure", "entropy"],
        "earth-mover",
    );
    check(
        &["extract", "x.mcap", "-o", "out", "--threshold", "-1"],
        "threshold is -1",
    );
    check(
        &["extract", "x.mcap", "-o", "out", "--order", "3"],
        "earth-mover has none",
    );
    check(
        &["extract", "x.mcap", "-o", "out", "--max-chunk", "big"],
        "not a size",
    );
    check(
        &["extract", "x.mcap", "-o", "out", "--threads", "100000"],
        "threads is 100000",
    );
    check(&["extract", "x.mcap"], "--output");
    check(&["extract", "-o", "out"], "INPUT");
    check(&["frobnicate"], "frobnicate");
    check(
        &["extract", "--config", "no-such-file.toml"],
        "no-such-file.toml",
    );
}

#[test]
fn a_bad_recording_beside_a_good_one_is_listed_with_exit_code_3() {
    let dir = one_recording();
    std::fs::write(dir.path().join("bad.mcap"), b"\x1f\x8b\x08junk").unwrap();
    let out = dir.path().join("out");
    let output = coact(&["extract", text(dir.path()), "-o", text(&out)]);
    assert_eq!(code(&output), 3, "{}", stderr(&output));
    assert!(
        stderr(&output).contains("bad.mcap failed: is not an MCAP recording: it is gzip"),
        "{}",
        stderr(&output)
    );
    let recordings = read_table(&out, Table::Recordings);
    assert_eq!(recordings[0].num_rows(), 2);
    assert_eq!(read_table(&out, Table::Episodes)[0].num_rows(), 2);
}

#[test]
fn another_run_in_the_directory_is_not_touched_without_overwrite() {
    let dir = one_recording();
    let out = dir.path().join("out");
    let run =
        |extra: &[&str]| coact(&[&["extract", text(dir.path()), "-o", text(&out)], extra].concat());
    assert_eq!(code(&run(&[])), 0);
    let again = run(&["--bins", "32"]);
    assert_eq!(code(&again), 2);
    assert!(stderr(&again).contains("--overwrite"), "{}", stderr(&again));
    assert_eq!(code(&run(&["--bins", "32", "--overwrite"])), 0);
}

#[test]
fn dry_run_reads_everything_and_writes_nothing() {
    let dir = one_recording();
    let out = dir.path().join("out");
    let output = coact(&["extract", text(dir.path()), "-o", text(&out), "--dry-run"]);
    assert_eq!(code(&output), 0);
    assert!(
        stdout(&output).contains("2 episodes") && !out.exists(),
        "{}",
        stdout(&output)
    );
}

#[test]
fn the_summary_as_json_is_one_object() {
    let dir = one_recording();
    let output = coact(&[
        "extract",
        text(dir.path()),
        "--dry-run",
        "--summary",
        "json",
    ]);
    let summary: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(summary["outcome"], "done");
    assert_eq!(summary["episodes"]["ok"], 2);
    assert_eq!(summary["environments"]["Test-v0"]["n_steps"], 100);
    assert_eq!(
        (
            summary["n_messages"].as_u64(),
            summary["n_messages_used"].as_u64()
        ),
        (Some(100), Some(100))
    );
}

#[test]
fn a_configuration_gives_options_and_the_command_line_wins() {
    let dir = one_recording();
    let config = dir.path().join("run.toml");
    std::fs::write(
        &config,
        "measure = \"shannon\"\nwindow = 8\nmax-chunk = \"1MiB\"\n",
    )
    .unwrap();
    let output = coact(&[
        "extract",
        "--config",
        text(&config),
        "--window",
        "9",
        "--print-config",
    ]);
    let printed: toml::Table = stdout(&output).parse().unwrap();
    assert_eq!(printed["measure"].as_str(), Some("shannon"));
    assert_eq!(printed["window"].as_integer(), Some(9));
    assert_eq!(printed["max-chunk"].as_str(), Some("1MiB"));
    assert_eq!(printed["bins"].as_integer(), Some(64));
    let reprinted = dir.path().join("printed.toml");
    std::fs::write(&reprinted, stdout(&output)).unwrap();
    assert_eq!(
        stdout(&coact(&[
            "extract",
            "--config",
            text(&reprinted),
            "--print-config"
        ])),
        stdout(&output)
    );
    std::fs::write(&config, "windwo = 8\n").unwrap();
    let output = coact(&["extract", "--config", text(&config), "--print-config"]);
    assert_eq!(code(&output), 2);
    assert!(stderr(&output).contains("windwo"), "{}", stderr(&output));
}

#[test]
fn progress_goes_into_a_pipe_if_asked_for() {
    let dir = one_recording();
    let run = |when| {
        stderr(&coact(&[
            "extract",
            text(dir.path()),
            "--dry-run",
            "--progress",
            when,
        ]))
    };
    assert!(run("always").contains("1/1 recordings  2 episodes"));
    assert_eq!(run("auto") + &run("never"), "");
}

#[test]
fn episodes_before_one_that_is_too_large_are_in_the_tables() {
    let dir = tempfile::tempdir().unwrap();
    let mut b = RecordingBuilder::new();
    b.episode(0, 60).episode(1, 60).episode(2, 3_000);
    std::fs::write(dir.path().join("a.mcap"), b.finish()).unwrap();
    let out = dir.path().join("out");
    let output = coact(&[
        "extract",
        text(dir.path()),
        "-o",
        text(&out),
        "--max-episode",
        "20000",
        "--summary",
        "json",
    ]);
    assert_eq!(code(&output), 3, "{}", stderr(&output));
    let summary: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(summary["n_messages_used"], 120);
    assert_eq!(summary["n_steps"], 120);
    assert_eq!(read_table(&out, Table::Episodes)[0].num_rows(), 2);
}

#[test]
fn an_output_that_is_a_file_is_said_to_be_one() {
    let dir = one_recording();
    let file = dir.path().join("good.mcap");
    let output = coact(&["extract", text(dir.path()), "-o", text(&file)]);
    assert_eq!(code(&output), 1);
    assert!(
        stderr(&output).contains("not a directory"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn completions_and_help() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let output = coact(&["completions", shell]);
        assert!(
            code(&output) == 0 && stdout(&output).contains("extract"),
            "{shell}"
        );
    }
    let help = stdout(&coact(&["extract", "--help"]));
    assert!(
        help.contains("Examples:") && help.contains("Exit codes:"),
        "{help}"
    );
}

#[cfg(not(feature = "cloud"))]
#[test]
fn without_the_feature_an_address_is_refused_with_how_to_get_it() {
    for input in ["s3://bucket/runs", "s3://bucket/runs/a.mcap"] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_coact"));
        let output = command
            .args(["extract", input, "--dry-run"])
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(1));
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(told.contains("--features cloud"), "{told}");
    }
    let address = "s3://bucket/out";
    for (arguments, expected) in [
        (
            ["extract", "fixtures/recordings", "-o", address].as_slice(),
            2,
        ),
        (
            &[
                "plan",
                "fixtures/recordings",
                "--shards",
                "2",
                "-o",
                address,
            ],
            2,
        ),
        (&["extract", "--shard", "1/2", "-o", address], 2),
        (&["finish", address], 1),
    ] {
        let output = coact(arguments);
        let told = stderr(&output);
        assert_eq!(code(&output), expected, "{told}");
        assert!(
            told.contains(address) && told.contains("--features cloud"),
            "{told}"
        );
    }
    assert!(!Path::new("s3:").exists());
}
