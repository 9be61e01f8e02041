//! The reader against recordings built in memory: layouts, episodes, bad steps, foreign files.

use std::path::Path;
use std::sync::Arc;

use coact::model::{Episode, RecordingRow, RecordingStatus};
use coact::recording::{Limits, ReadOptions, RecordingReader};
use mcap::Compression;
use serde_json::json;

use crate::support::recording_builder::{Layout, RecordingBuilder, step_message};

/// Reads a file to its end; an error ends in the row, as in a run.
fn read_file(path: &Path, options: &ReadOptions) -> (Vec<Episode>, RecordingRow) {
    let name = Arc::from(path.file_name().unwrap().to_str().unwrap());
    let mut reader = match RecordingReader::open(path, Arc::clone(&name), options) {
        Ok(reader) => reader,
        Err(e) => {
            return (
                Vec::new(),
                RecordingReader::failed_row(name, 0, &e.to_string()),
            );
        }
    };
    let mut episodes = Vec::new();
    while !reader.is_done() {
        match reader.read(1) {
            Ok(more) => episodes.extend(more),
            Err(e) => return (episodes, reader.into_row(Some(&e.to_string()))),
        }
    }
    (episodes, reader.into_row(None))
}

fn read_with(bytes: &[u8], options: &ReadOptions) -> (Vec<Episode>, RecordingRow) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r.mcap");
    std::fs::write(&path, bytes).unwrap();
    let (episodes, row) = read_file(&path, options);
    assert_eq!(
        row.n_messages,
        row.n_messages_used + row.n_messages_refused,
        "{row:?}"
    );
    assert_eq!(
        row.n_messages_used,
        episodes.iter().map(|e| e.n_steps() as u64).sum::<u64>()
    );
    (episodes, row)
}

fn read(bytes: &[u8]) -> (Vec<Episode>, RecordingRow) {
    read_with(bytes, &ReadOptions::default())
}

fn reason(episode: &Episode) -> &str {
    episode
        .incomplete
        .as_ref()
        .map_or("", |i| i.reason.as_str())
}

#[test]
fn every_layout_gives_the_same_episodes() {
    let build = |layout| {
        let mut b = RecordingBuilder::with_layout(layout);
        b.metadata(&[("env_id", "Test-v0"), ("action_names", "[\"push\"]")])
            .episode(0, 40)
            .episode(1, 25);
        b.finish()
    };
    let (expected, row) = read(&build(Layout::default()));
    assert_eq!(
        (expected.len(), row.status, row.n_messages),
        (2, RecordingStatus::Ok, 65)
    );
    assert_eq!(expected[0].env_id.as_deref(), Some("Test-v0"));
    assert_eq!(
        expected[0].joint_names.as_deref().map(|n| n[0].to_string()),
        Some("push".to_owned())
    );
    for compression in [Some(Compression::Zstd), Some(Compression::Lz4), None] {
        for chunked in [true, false] {
            for summary in [true, false] {
                let layout = Layout {
                    compression,
                    chunked,
                    summary,
                    chunk_size: 700,
                };
                let (episodes, row) = read(&build(layout));
                assert_eq!(episodes, expected, "{layout:?}");
                assert_eq!(
                    (row.status, row.causes.len()),
                    (RecordingStatus::Ok, 0),
                    "{layout:?}: {row:?}"
                );
            }
        }
    }
}

#[test]
fn metadata_behind_the_messages_is_found() {
    let mut b = RecordingBuilder::new();
    b.episode(0, 12).metadata(&[("env_id", "Late-v0")]);
    assert_eq!(read(&b.finish()).0[0].env_id.as_deref(), Some("Late-v0"));
}

#[test]
fn numbers_come_out_to_the_bit() {
    let mut b = RecordingBuilder::new();
    b.raw_step(r#"{"episode":0,"step":0,"action":-0.0,"state":[9007199254740993,5e-324,0.1,1.7976931348623157e308,true,[[3],[4]]]}"#);
    b.raw_step(r#"{"episode":0,"step":1,"\u0061ction":1,"state":[18446744073709551615,2.2250738585072011e-308,123456789.12345678901234567890,-1,false,[3,4]]}"#);
    let (episodes, row) = read(&b.finish());
    assert_eq!(row.causes, []);
    let first: Vec<f64> = episodes[0].states.iter().map(|c| c[0]).collect();
    assert_eq!(
        first,
        [
            9_007_199_254_740_992.0,
            5e-324,
            0.1,
            f64::MAX,
            1.0,
            3.0,
            4.0
        ]
    );
    let second: Vec<f64> = episodes[0].states.iter().map(|c| c[1]).collect();
    assert_eq!(
        second[..4],
        [
            18_446_744_073_709_551_616.0,
            2.225_073_858_507_201e-308,
            123_456_789.123_456_79,
            -1.0
        ]
    );
    assert!(episodes[0].actions.column(0)[0].is_sign_negative());
}

#[test]
fn interleaved_episodes_are_told_apart_and_come_in_order_of_appearance() {
    let mut b = RecordingBuilder::new();
    for step in 0..30 {
        for episode in [7, 3, 5] {
            let n = if episode == 3 { 20 } else { 30 };
            if step < n {
                b.step(&step_message(episode, step, step + 1 == n));
            }
        }
    }
    let (episodes, row) = read(&b.finish());
    let found: Vec<_> = episodes
        .iter()
        .map(|e| (e.key.episode, e.n_steps()))
        .collect();
    assert_eq!(found, [(7, 30), (3, 20), (5, 30)]);
    assert_eq!(
        (row.status, row.n_messages_refused),
        (RecordingStatus::Ok, 0)
    );
}

#[test]
fn text_ids_number_episodes_by_appearance() {
    let mut b = RecordingBuilder::new();
    for id in ["b", "a"] {
        for step in 0..12 {
            b.step(&json!({"episode": id, "step": step, "action": 1, "state": [step]}));
        }
    }
    let (episodes, _) = read(&b.finish());
    let found: Vec<_> = episodes
        .iter()
        .map(|e| (e.key.episode, e.key.episode_id.as_deref()))
        .collect();
    assert_eq!(found, [(0, Some("b")), (1, Some("a"))]);
}

#[test]
fn without_ids_end_flags_cut_and_without_flags_the_recording_is_one_episode() {
    let mut flags = RecordingBuilder::new();
    let mut plain = RecordingBuilder::new();
    for step in 0..30 {
        flags.step(&json!({"action": 1, "state": [step], "terminated": step == 11, "truncated": step == 29}));
        plain.step(&json!({"action": 1, "state": [step]}));
    }
    let sizes = |bytes: &[u8]| {
        read(bytes)
            .0
            .iter()
            .map(Episode::n_steps)
            .collect::<Vec<_>>()
    };
    assert_eq!(sizes(&flags.finish()), [12, 18]);
    assert_eq!(sizes(&plain.finish()), [30]);
}

#[test]
fn step_numbers_order_the_steps_and_may_start_anywhere() {
    let mut b = RecordingBuilder::new();
    for step in [101, 100, 103, 102, 104] {
        b.step(&json!({"episode": 0, "step": step, "action": step, "state": [step]}));
    }
    let (episodes, _) = read(&b.finish());
    assert_eq!(
        episodes[0].actions.column(0),
        [100.0, 101.0, 102.0, 103.0, 104.0]
    );
    assert_eq!(episodes[0].incomplete, None);
}

/// One episode of 20 steps with step 10 replaced by `bad`, and a good one after it.
#[track_caller]
fn check_bad_step(bad: &str, n_used: usize, expected: &str) {
    let mut b = RecordingBuilder::new();
    for step in 0..20 {
        if step == 10 {
            b.raw_step(bad);
        } else {
            b.step(&step_message(0, step, step == 19));
        }
    }
    b.episode(1, 15);
    let (episodes, row) = read(&b.finish());
    assert_eq!(episodes.len(), 2, "{bad}");
    assert_eq!(
        (episodes[0].n_steps(), episodes[1].n_steps()),
        (n_used, 15),
        "{bad}: {:?}",
        episodes[0].incomplete
    );
    assert!(
        reason(&episodes[0]).contains(expected),
        "{bad}: {:?}",
        episodes[0].incomplete
    );
    assert_eq!(episodes[1].incomplete, None, "{bad}");
    assert_eq!(row.n_messages_refused, 20 - n_used as u64, "{bad}");
    assert_eq!(
        row.causes.iter().map(|c| c.count).sum::<u64>(),
        row.n_messages_refused,
        "{bad}"
    );
}

#[test]
fn an_episode_is_used_up_to_its_first_bad_step() {
    let step = |rest: &str| format!(r#"{{"episode":0,"step":10,{rest}}}"#);
    check_bad_step(&step(r#""action":[NaN],"state":[1,2,3]"#), 10, "NaN");
    check_bad_step(
        &step(r#""action":[1],"state":[1,-Infinity,3]"#),
        10,
        "NaN or Infinity",
    );
    check_bad_step(
        &step(r#""action":[1],"state":[1,1e999,3]"#),
        10,
        "number out of range",
    );
    check_bad_step(&step(r#""action":[1],"state":[1,2]"#), 10, "another width");
    check_bad_step(&step(r#""action":[1],"state":[]"#), 10, "state is empty");
    check_bad_step(&step(r#""action":[1]"#), 10, "state is missing");
    check_bad_step(
        &step(r#""action":[1],"state":[1,"2",3]"#),
        10,
        "text where a number",
    );
    check_bad_step(
        &step(r#""action":[1],"action":[1],"state":[1,2,3]"#),
        10,
        "duplicate key",
    );
    check_bad_step(
        &step(&format!(
            r#""action":[1],"state":{}1{}"#,
            "[".repeat(200),
            "]".repeat(200)
        )),
        10,
        "recursion limit",
    );
    check_bad_step("garbage", 10, "step number 10 is missing: not JSON");
    check_bad_step("", 10, "step number 10 is missing: not JSON");
    check_bad_step(
        r#"{"episode":0,"step":9,"action":[1],"state":[1,2,3]}"#,
        10,
        "step number 9 came twice",
    );
    check_bad_step(
        r#"{"episode":0,"step":30,"action":[1],"state":[1,2,3]}"#,
        10,
        "step number 10 is missing",
    );
}

#[test]
fn a_message_for_a_closed_episode_is_refused_and_its_rows_stand() {
    let mut b = RecordingBuilder::new();
    b.episode(0, 15).episode(1, 15);
    b.step(&step_message(0, 15, false));
    let (episodes, row) = read(&b.finish());
    assert_eq!(
        episodes.iter().map(Episode::n_steps).collect::<Vec<_>>(),
        [15, 15]
    );
    assert_eq!((row.n_messages_refused, row.causes[0].count), (1, 1));
    assert!(row.causes[0].cause.contains("closed"));
}

#[test]
fn more_open_episodes_than_the_limit_close_the_stalest() {
    let mut b = RecordingBuilder::new();
    for episode in 0..5 {
        for step in 0..12 {
            b.step(&json!({"episode": episode, "step": step, "action": 1, "state": [step]}));
        }
    }
    b.step(&json!({"episode": 0, "step": 12, "action": 1, "state": [12]}));
    let options = ReadOptions {
        limits: Limits {
            max_open_episodes: 2,
            ..Limits::default()
        },
        ..ReadOptions::default()
    };
    let (episodes, row) = read_with(&b.finish(), &options);
    assert_eq!((episodes.len(), row.n_messages_refused), (5, 1));
}

#[test]
fn an_episode_beyond_its_limit_is_a_clear_error() {
    let mut b = RecordingBuilder::new();
    b.episode(0, 200);
    let options = ReadOptions {
        limits: Limits {
            max_episode: 2_000,
            ..Limits::default()
        },
        ..ReadOptions::default()
    };
    let (_, row) = read_with(&b.finish(), &options);
    assert_eq!(row.status, RecordingStatus::Failed);
    assert!(
        row.reason
            .as_deref()
            .is_some_and(|r| r.contains("--max-episode")),
        "{row:?}"
    );
}

#[test]
fn a_flipped_bit_in_a_chunk_loses_that_chunk_alone() {
    let mut b = RecordingBuilder::with_layout(Layout {
        compression: None,
        chunk_size: 1500,
        ..Layout::default()
    });
    for episode in 0..6 {
        b.episode(episode, 15);
    }
    let mut bytes = b.finish();
    let at = bytes
        .windows(12)
        .position(|w| w == br#""episode":2,"#)
        .unwrap();
    bytes[at + 10] ^= 1;
    let (episodes, row) = read(&bytes);
    assert_eq!(row.status, RecordingStatus::Recovered);
    assert!(
        row.reason.as_deref().is_some_and(|r| r.contains("CRC")),
        "{row:?}"
    );
    let whole: Vec<_> = episodes
        .iter()
        .filter(|e| e.incomplete.is_none())
        .map(|e| e.key.episode)
        .collect();
    assert!(whole.len() >= 4 && !whole.contains(&2), "{whole:?}");
}

#[test]
fn a_file_cut_anywhere_keeps_every_step_before_the_cut() {
    let mut b = RecordingBuilder::with_layout(Layout {
        chunked: false,
        summary: false,
        ..Layout::default()
    });
    b.episode(0, 15).episode(1, 15);
    let bytes = b.finish();
    let ends: Vec<usize> = {
        // End of each message record, found by walking the file as the format says.
        let (mut at, mut ends) = (8, Vec::new());
        while at + 9 <= bytes.len() && bytes[at..at + 8] != bytes[..8] {
            let length = usize::try_from(u64::from_le_bytes(
                bytes[at + 1..at + 9].try_into().unwrap(),
            ))
            .unwrap();
            if bytes[at] == mcap::records::op::MESSAGE {
                ends.push(at + 9 + length);
            }
            at += 9 + length;
        }
        ends
    };
    assert_eq!(ends.len(), 30);
    for cut in (ends[2]..bytes.len()).step_by(7) {
        let (episodes, row) = read(&bytes[..cut]);
        let n_before = ends.iter().filter(|&&end| end <= cut).count();
        assert_eq!(
            episodes.iter().map(Episode::n_steps).sum::<usize>(),
            n_before,
            "cut at {cut}"
        );
        assert_eq!(row.status, RecordingStatus::Recovered, "cut at {cut}");
        let open_at_cut = n_before != 15 && n_before != 30;
        assert_eq!(
            episodes.last().is_some_and(|e| e.incomplete.is_some()),
            open_at_cut,
            "cut at {cut}"
        );
    }
}

#[test]
fn what_is_no_recording_says_what_it_is() {
    #[track_caller]
    fn check(bytes: &[u8], word: &str) {
        let (episodes, row) = read(bytes);
        assert!(episodes.is_empty() && row.status == RecordingStatus::Failed);
        assert!(
            row.reason.as_deref().is_some_and(|r| r.contains(word)),
            "{row:?}"
        );
    }
    check(b"", "empty");
    check(b"SQLite format 3\0....", "SQLite");
    check(&RecordingBuilder::new().finish(), "no topic \"/step\"");
    let mut other = RecordingBuilder::new();
    other
        .message("/camera", "protobuf", b"x")
        .message("/camera", "protobuf", b"y");
    check(&other.finish(), "/camera (protobuf, 2 messages)");
    let mut foreign = RecordingBuilder::new();
    foreign.message("/step", "capnproto", b"x");
    check(&foreign.finish(), "encoding \"capnproto\"");
}

#[test]
fn a_recording_compressed_as_a_whole_reads_the_same() {
    let mut b = RecordingBuilder::new();
    b.episode(0, 20).metadata(&[("env_id", "Late-v0")]);
    let bytes = b.finish();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r.mcap.zst");
    std::fs::write(&path, zstd::encode_all(&bytes[..], 3).unwrap()).unwrap();
    let (episodes, row) = read_file(&path, &ReadOptions::default());
    assert_eq!(
        (
            row.status,
            episodes[0].n_steps(),
            episodes[0].env_id.as_deref()
        ),
        (RecordingStatus::Ok, 20, Some("Late-v0"))
    );
}
