//! Events files: read back with the official reader, held against the tables, and through stops and starts.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Arc;

use arrow::array::{Array, AsArray, RecordBatch};
use arrow::datatypes::{Float64Type, Int32Type, Int64Type, TimestampNanosecondType};
use coact::events::{ActionChange, Event, StateChange, Timestamp};
use coact::extraction::{ExtractionParams, RawParams};
use coact::pipeline::{self, Config, Interrupt, RunError};
use coact::recording::ReadOptions;
use coact::tables::{Faults, Table};
use mcap::{Message, MessageStream};
use prost::Message as _;
use rayon::prelude::*;

use crate::support::project;
use crate::support::recording_builder::{RecordingBuilder, step_message};
use crate::support::rows::{rows, temporaries};
use crate::tables::read_table;

fn coact(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_coact"))
        .args(arguments)
        .output()
        .unwrap()
}

#[track_caller]
fn succeeds(arguments: &[&str]) {
    let output = coact(arguments);
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {told}");
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Every file below a folder, by its path in it.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let entries = walkdir::WalkDir::new(folder)
        .into_iter()
        .map(Result::unwrap);
    entries
        .filter(|entry| entry.file_type().is_file())
        .map(|entry| {
            let path = entry.path().strip_prefix(folder).unwrap().to_owned();
            (path, fs::read(entry.path()).unwrap())
        })
        .collect()
}

/// What a table says of each row of some columns, by recording.
fn table_rows(
    out: &Path,
    table: Table,
    columns: &[&str],
) -> BTreeMap<String, Vec<Vec<Option<String>>>> {
    let mut found: BTreeMap<String, Vec<Vec<Option<String>>>> = BTreeMap::new();
    for batch in read_table(out, table) {
        for row in 0..batch.num_rows() {
            let recording = cell(&batch, "recording", row).unwrap();
            let cells = columns.iter().map(|c| cell(&batch, c, row)).collect();
            found.entry(recording).or_default().push(cells);
        }
    }
    found
}

fn cell(batch: &RecordBatch, column: &str, row: usize) -> Option<String> {
    use arrow::datatypes::{DataType, TimeUnit};
    let column = batch.column_by_name(column).unwrap();
    column.is_valid(row).then(|| match column.data_type() {
        DataType::Utf8 => column.as_string::<i32>().value(row).to_owned(),
        DataType::Int32 => column.as_primitive::<Int32Type>().value(row).to_string(),
        DataType::Int64 => column.as_primitive::<Int64Type>().value(row).to_string(),
        DataType::Float64 => column.as_primitive::<Float64Type>().value(row).to_string(),
        DataType::Boolean => column.as_boolean().value(row).to_string(),
        DataType::Timestamp(TimeUnit::Nanosecond, _) => {
            let times = column.as_primitive::<TimestampNanosecondType>();
            times.value(row).to_string()
        }
        other => panic!("{other} is no type of a cell here"),
    })
}

fn nanos(time: Option<Timestamp>) -> String {
    let time = time.unwrap();
    (time.seconds * 1_000_000_000 + i64::from(time.nanos)).to_string()
}

/// Messages of an events file, by topic, in the order of the file; the reader checks every CRC.
fn messages(bytes: &[u8]) -> BTreeMap<String, Vec<Message<'_>>> {
    let mut found: BTreeMap<String, Vec<Message<'_>>> = BTreeMap::new();
    for message in MessageStream::new(bytes).unwrap() {
        let message = message.unwrap();
        let topic = message.channel.topic.clone();
        found.entry(topic).or_default().push(message);
    }
    found
}

const SEGMENT_COLUMNS: [&str; 12] = [
    "episode",
    "episode_id",
    "joint",
    "joint_name",
    "segment",
    "start_step",
    "end_step",
    "n_steps",
    "state_change_sum",
    "state_change_peak",
    "state_change_rank",
    "reward_sum",
];

/// The rows of `segments` that the events of a file tell, in the order of the table.
fn told_segments(messages: &BTreeMap<String, Vec<Message<'_>>>) -> Vec<Vec<Option<String>>> {
    let mut found: Vec<(usize, Vec<Option<String>>)> = Vec::new();
    let mut episodes: Vec<String> = Vec::new();
    for message in messages.get("/coact/events").into_iter().flatten() {
        let schema = message.channel.schema.as_ref().unwrap();
        assert_eq!(
            (&*schema.name, &*schema.encoding),
            ("foxglove.Event", "protobuf")
        );
        let event = Event::decode(&*message.data).unwrap();
        assert_eq!(message.log_time.to_string(), nanos(event.start_time));
        let metadata: BTreeMap<&str, &str> = event
            .metadata
            .iter()
            .map(|pair| (&*pair.key, &*pair.value))
            .collect();
        assert_eq!(metadata.len(), event.metadata.len(), "keys are unique");
        let value = |column: &&str| metadata.get(*column).map(ToString::to_string);
        let mut row: Vec<Option<String>> = SEGMENT_COLUMNS.iter().map(value).collect();
        row.push(Some(nanos(event.start_time)));
        row.push(Some(nanos(event.end_time)));
        let episode = row[0].clone().unwrap();
        if !episodes.contains(&episode) {
            episodes.push(episode.clone());
        }
        let of = episodes.iter().position(|e| *e == episode).unwrap();
        found.push((of, row));
    }
    let number =
        |row: &[Option<String>], i: usize| row[i].as_ref().unwrap().parse::<i32>().unwrap();
    found.sort_by_key(|(of, row)| (*of, number(row, 2), number(row, 4)));
    found.into_iter().map(|(_, row)| row).collect()
}

/// The rows of `steps` that the series of a file tell, in the order of the table.
fn told_steps(messages: &BTreeMap<String, Vec<Message<'_>>>) -> Vec<Vec<Option<String>>> {
    let mut states = BTreeMap::new();
    for message in messages.get("/coact/state").into_iter().flatten() {
        let state = StateChange::decode(&*message.data).unwrap();
        assert!(states.insert((state.episode, state.step), state).is_none());
    }
    let mut rows = Vec::new();
    for message in messages
        .iter()
        .filter(|(t, _)| t.starts_with("/coact/joints/"))
        .flat_map(|(_, m)| m)
    {
        let action = ActionChange::decode(&*message.data).unwrap();
        let state = states[&(action.episode, action.step)];
        let joint = message.channel.metadata["joint"].clone();
        rows.push(vec![
            Some(action.episode.to_string()),
            Some(joint),
            message.channel.metadata.get("joint_name").cloned(),
            Some(action.step.to_string()),
            Some(message.log_time.to_string()),
            action.action.map(|a| a.to_string()),
            Some(action.measure.to_string()),
            Some(action.change.to_string()),
            Some(action.mask.to_string()),
            Some(state.measure.to_string()),
            Some(state.change.to_string()),
            Some(state.mask.to_string()),
            Some(action.correlated.to_string()),
            Some(action.boundary.to_string()),
            Some(action.segment.to_string()),
        ]);
    }
    rows.sort();
    rows
}

const STEP_COLUMNS: [&str; 15] = [
    "episode",
    "joint",
    "joint_name",
    "step",
    "time",
    "action",
    "action_measure",
    "action_change",
    "action_mask",
    "state_measure",
    "state_change",
    "state_mask",
    "correlated",
    "boundary",
    "segment",
];

/// Holds the events files of a run against its tables; how many events there are.
#[track_caller]
fn check_against_tables(out: &Path, events: &Path) -> usize {
    let columns: Vec<&str> = SEGMENT_COLUMNS
        .into_iter()
        .chain(["start_time", "end_time"])
        .collect();
    let segments = table_rows(out, Table::Segments, &columns);
    let steps = table_rows(out, Table::Steps, &STEP_COLUMNS);
    let episodes = table_rows(out, Table::Episodes, &["n_steps"]);
    let files = files(events);
    assert_eq!(files.len(), episodes.len(), "one file a recording");
    let mut n_events = 0;
    for recording in episodes.keys() {
        let path = recording.strip_suffix(".mcap").unwrap().to_owned() + ".events.mcap";
        let messages = messages(&files[Path::new(&path)]);
        let told = told_segments(&messages);
        n_events += told.len();
        assert_eq!(
            Some(&told).filter(|t| !t.is_empty()),
            segments.get(recording),
            "{recording}"
        );
        let mut expected = steps[recording].clone();
        // Episodes that are too short have no series.
        expected.retain(|row| row[6].is_some());
        expected.sort();
        assert_eq!(told_steps(&messages), expected, "{recording}");
    }
    n_events
}

#[test]
fn events_and_series_are_what_the_tables_hold_and_the_same_for_any_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let fixtures = project("fixtures/recordings");
    for mode in ["each", "together"] {
        let run = |threads: &str| {
            let out = dir.path().join(format!("{mode}-{threads}"));
            let events = dir.path().join(format!("{mode}-{threads}-events"));
            succeeds(&[
                "extract",
                text(&fixtures),
                "-o",
                text(&out),
                "--events",
                text(&events),
                "--joints",
                mode,
                "--threads",
                threads,
            ]);
            (out, events)
        };
        let (out, events) = run("1");
        assert!(check_against_tables(&out, &events) > 200);
        let (_, events_of_two) = run("2");
        assert!(files(&events) == files(&events_of_two), "{mode}");
    }
}

/// Recordings of several episodes, one of them large enough for several parts; one gives nothing.
fn recordings(folder: &Path, n: usize) {
    fs::create_dir_all(folder.join("deep")).unwrap();
    for i in 0..n {
        let mut b = RecordingBuilder::new();
        let n_episodes = if i == 1 { 12 } else { 2 };
        for episode in 0..n_episodes {
            b.episode(episode, 60 + 7 * i);
        }
        let name = if i % 2 == 0 { "r" } else { "deep/r" };
        fs::write(folder.join(format!("{name}{i}.mcap")), b.finish()).unwrap();
    }
}

fn config(inputs: &Path, output: Option<&Path>, events: Option<&Path>) -> Config {
    Config {
        inputs: vec![inputs.to_owned()],
        shard: None,
        output: output.map(ToOwned::to_owned),
        events: events.map(ToOwned::to_owned),
        params: ExtractionParams::new(RawParams::default()).unwrap(),
        read: ReadOptions::default(),
        steps: true,
        overwrite: false,
        threads: 1,
        max_part_rows: 150,
        faults: None,
        parameters: vec![("bins".to_owned(), "64".to_owned())],
    }
}

fn run(config: &Config) -> Result<(), RunError> {
    pipeline::run(config, &|_| {}, &Interrupt::default()).map(drop)
}

#[test]
fn any_call_to_the_file_system_may_fail_and_the_next_run_ends_with_the_same_files() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    recordings(&inputs, 3);
    let (whole, whole_events) = (dir.path().join("whole"), dir.path().join("whole-events"));
    let counter = Arc::new(Faults::none());
    let mut first = config(&inputs, Some(&whole), Some(&whole_events));
    first.faults = Some(Arc::clone(&counter));
    run(&first).unwrap();
    let expected = (rows(&whole), files(&whole_events));
    assert_eq!(expected.1.len(), 3);
    (0..counter.calls())
        .step_by(3)
        .par_bridge()
        .for_each(|call| {
            let output = dir.path().join(format!("out-{call}"));
            let events = dir.path().join(format!("events-{call}"));
            let mut failing = config(&inputs, Some(&output), Some(&events));
            failing.faults = Some(Arc::new(Faults::at(call, call % 2 == 0)));
            let Err(RunError::Failed(e)) = run(&failing) else {
                panic!("call {call} failed and the run did not say so");
            };
            let told = format!("{e:#}");
            assert!(
                told.contains(&format!("-{call}")) && told.contains("fault"),
                "{told}"
            );
            if events.is_dir() {
                assert_eq!(temporaries(&events), [] as [PathBuf; 0], "call {call}");
                for (path, bytes) in files(&events) {
                    assert!(expected.1[&path] == bytes, "{} is whole", path.display());
                }
            }
            run(&config(&inputs, Some(&output), Some(&events))).unwrap();
            assert!((rows(&output), files(&events)) == expected, "call {call}");
        });
}

#[test]
fn a_killed_run_goes_on_and_ends_with_the_same_files() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    recordings(&inputs, 12);
    let extract = |output: &Path, events: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_coact"));
        command
            .arg("extract")
            .arg(&inputs)
            .arg("--output")
            .arg(output)
            .arg("--events")
            .arg(events)
            .args(["--max-part-rows", "150", "--threads", "1", "-q"])
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        command
    };
    let (whole, whole_events) = (dir.path().join("whole"), dir.path().join("whole-events"));
    let started = std::time::Instant::now();
    assert!(extract(&whole, &whole_events).status().unwrap().success());
    let whole_run = started.elapsed();
    let expected = (rows(&whole), files(&whole_events));
    let n = 6;
    for i in 0..n {
        let (output, events) = (
            dir.path().join(format!("o{i}")),
            dir.path().join(format!("e{i}")),
        );
        let mut process = extract(&output, &events).spawn().unwrap();
        std::thread::sleep(whole_run * (i + 1) / (n + 1));
        process.kill().unwrap();
        process.wait().unwrap();
        if events.is_dir() {
            for (path, bytes) in files(&events) {
                // What the dead process left unfinished has another name.
                let is_named = path.extension().is_some_and(|e| e == "mcap");
                assert!(
                    !is_named || expected.1[&path] == bytes,
                    "{}",
                    path.display()
                );
            }
        }
        assert!(extract(&output, &events).status().unwrap().success());
        assert!((rows(&output), files(&events)) == expected, "kill {i}");
    }
}

#[test]
fn events_may_be_asked_for_later_and_what_is_missing_or_spoilt_is_made_again() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    recordings(&inputs, 4);
    let (out, events, alone) = (
        dir.path().join("out"),
        dir.path().join("events"),
        dir.path().join("alone"),
    );
    run(&config(&inputs, None, Some(&alone))).unwrap();
    let expected = files(&alone);
    assert_eq!(expected.len(), 4);

    run(&config(&inputs, Some(&out), None)).unwrap();
    let tables = files(&out);
    let both = config(&inputs, Some(&out), Some(&events));
    run(&both).unwrap();
    assert!(files(&events) == expected);
    assert!(files(&out) == tables, "the tables are as they were");

    fs::remove_file(events.join("deep/r1.events.mcap")).unwrap();
    let cut = &expected[Path::new("r0.events.mcap")];
    fs::write(events.join("r0.events.mcap"), &cut[..cut.len() - 1]).unwrap();
    fs::write(events.join("notes.txt"), "mine").unwrap();
    run(&both).unwrap();
    fs::remove_file(events.join("notes.txt")).unwrap();
    assert!(files(&events) == expected && files(&out) == tables);

    // Of a run with other parameters.
    let mut other = config(&inputs, None, Some(&events));
    other.parameters = vec![("bins".to_owned(), "32".to_owned())];
    other.params = ExtractionParams::new(RawParams {
        bins: 32,
        ..RawParams::default()
    })
    .unwrap();
    run(&other).unwrap();
    assert!(files(&events) != expected);
    run(&both).unwrap();
    assert!(files(&events) == expected && files(&out) == tables);
}

#[test]
fn events_files_are_no_recordings_and_a_recording_named_like_one_is() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    recordings(&inputs, 2);
    let mut b = RecordingBuilder::new();
    b.episode(0, 40);
    fs::write(inputs.join("lab.events.mcap"), b.finish()).unwrap();
    for _ in 0..2 {
        succeeds(&["extract", text(&inputs), "--events", text(&inputs), "-q"]);
        let found = files(&inputs);
        let names: Vec<&str> = found.keys().map(|p| p.to_str().unwrap()).collect();
        assert_eq!(
            names,
            [
                "deep/r1.events.mcap",
                "deep/r1.mcap",
                "lab.events.events.mcap",
                "lab.events.mcap",
                "r0.events.mcap",
                "r0.mcap"
            ]
        );
    }
}

#[test]
fn a_recording_without_episodes_has_no_file_and_dry_runs_write_none() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    let events = dir.path().join("events");
    recordings(&inputs, 1);
    fs::write(inputs.join("bad.mcap"), b"junk").unwrap();
    let dry = coact(&[
        "extract",
        text(&inputs),
        "--events",
        text(&events),
        "--dry-run",
    ]);
    assert_eq!(dry.status.code(), Some(3));
    assert!(!events.exists());
    let run = coact(&["extract", text(&inputs), "--events", text(&events)]);
    assert_eq!(run.status.code(), Some(3));
    let found: Vec<PathBuf> = files(&events).into_keys().collect();
    assert_eq!(found, [PathBuf::from("r0.events.mcap")]);
}

#[test]
fn joints_whose_names_are_no_topics_go_by_their_numbers() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, events) = (dir.path().join("a.mcap"), dir.path().join("events"));
    let mut b = RecordingBuilder::new();
    let names = r#"["grip", "arm/left", "twin", "twin", "7", "käfer"]"#;
    b.metadata(&[("env_id", "Test-v0"), ("action_names", names)]);
    for step in 0..40 {
        let mut message = step_message(0, step, step == 39);
        message["action"] = serde_json::json!([step % 3, 0, 1, step % 5, step / 7, 1]);
        b.step(&message);
    }
    fs::write(&inputs, b.finish()).unwrap();
    succeeds(&["extract", text(&inputs), "--events", text(&events), "-q"]);
    let bytes = fs::read(events.join("a.events.mcap")).unwrap();
    let topics: Vec<String> = messages(&bytes)
        .into_iter()
        .filter(|(topic, _)| topic.starts_with("/coact/joints/"))
        .map(|(topic, messages)| {
            let metadata = &messages[0].channel.metadata;
            format!("{topic} {} {}", metadata["joint"], metadata["joint_name"])
        })
        .collect();
    assert_eq!(
        topics,
        [
            "/coact/joints/1 1 arm/left",
            "/coact/joints/2 2 twin",
            "/coact/joints/3 3 twin",
            "/coact/joints/4 4 7",
            "/coact/joints/5 5 käfer",
            "/coact/joints/grip 0 grip",
        ]
    );
}
