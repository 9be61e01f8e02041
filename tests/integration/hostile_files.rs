//! Files made by hand, each broken in one way (`support/broken.rs` lists them), and what must come of each.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::sync::Arc;

use coact::model::RecordingRow;
use coact::recording::{OnDamage, ReadOptions, RecordingReader};

use crate::support::broken::{self, Broken, N};
use crate::support::checked::{is_reported, n_steps, read, read_path, read_with};
use crate::support::raw_mcap::{RawChunk, channel, file, message, walk};
use crate::support::recording_builder::{Layout, RecordingBuilder, step_message};
use crate::support::subjects;

/// All that a user is told: the reason and the causes.
fn told(row: &RecordingRow) -> String {
    let causes = row
        .causes
        .iter()
        .map(|c| format!("{} ({})", c.cause, c.count));
    let parts: Vec<String> = row.reason.clone().into_iter().chain(causes).collect();
    parts.join("; ")
}

#[test]
fn every_broken_file_gives_what_it_holds_and_says_what_is_wrong() {
    let mut wrong = Vec::new();
    for case in broken::all() {
        let found = read(&case.bytes);
        let (episodes, row) = &found;
        let Broken {
            name,
            n_steps: expected,
            clean,
            status,
            told: word,
            ..
        } = &case;
        let said = told(row);
        if n_steps(episodes) != *expected
            || row.status.as_str() != *status
            || is_reported(&found) == *clean
            || !said.contains(word.as_str())
        {
            let reasons: Vec<_> = episodes
                .iter()
                .map(|e| (e.n_steps(), e.incomplete.as_ref().map(|i| &i.reason)))
                .collect();
            wrong.push(format!(
                "{name}: {} {said:?} {reasons:?}, expected {expected} steps, {status}, {word:?}",
                row.status.as_str()
            ));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn damage_is_refused_whole_where_it_is_to_be_refused() {
    let options = ReadOptions {
        on_damage: OnDamage::Fail,
        ..ReadOptions::default()
    };
    for case in broken::all() {
        let (episodes, row) = read_with(&case.bytes, &options);
        let name = &case.name;
        if case.status == "recovered" {
            assert!(
                episodes.is_empty(),
                "{name}: {} episodes of a damaged file",
                episodes.len()
            );
            assert_eq!(row.status.as_str(), "failed", "{name}");
        } else {
            assert_eq!(
                (n_steps(&episodes), row.status.as_str()),
                (case.n_steps, case.status),
                "{name}"
            );
        }
    }
}

#[test]
fn thousands_of_bad_messages_are_a_count_and_the_place_of_the_first() {
    let case = broken::all()
        .into_iter()
        .find(|c| c.name.starts_with("thousands"))
        .unwrap();
    let (_, row) = read(&case.bytes);
    assert_eq!(row.n_messages_refused, 5000);
    assert_eq!(row.causes.len(), 1, "{:?}", row.causes);
    let first = walk(&case.bytes)[2 + N];
    assert_eq!(row.causes[0].first_offset, first.start as u64);
    // Each with another cause: they are kept apart up to a bound.
    let mut b = RecordingBuilder::new();
    b.episode(0, 12);
    for i in 0..3000 {
        b.raw_step(&format!(
            r#"{{"episode":1,"step":0,"action":1,"state":[1],"a{i}":1,"a{i}":2}}"#
        ));
        b.raw_step(&format!(
            r#"{{"episode":1,"step":0,"action":1,"state":{{"a{i}":"x"}}}}"#
        ));
    }
    let (_, row) = read(&b.finish());
    assert!(row.causes.len() <= 65, "{} causes", row.causes.len());
    assert_eq!(
        row.causes.iter().map(|c| c.count).sum::<u64>(),
        row.n_messages_refused
    );
}

#[test]
fn two_topics_find_their_lost_definitions_in_the_summary() {
    let subject = subjects::all()
        .into_iter()
        .find(|s| s.name.starts_with("cdr, two topics, zstd"))
        .unwrap();
    let (whole, _) = read(&subject.bytes);
    let mut bytes = subject.bytes.clone();
    let chunk = mcap::records::op::CHUNK;
    let first_chunk = walk(&bytes)
        .into_iter()
        .find(|at| at.opcode == chunk)
        .unwrap();
    bytes[first_chunk.end - 3] ^= 1;
    let (episodes, row) = read(&bytes);
    assert_eq!(row.status.as_str(), "recovered", "{row:?}");
    let n = n_steps(&episodes);
    assert!(n > 0 && n < n_steps(&whole), "{n} steps: {row:?}");
    assert!(episodes[0].incomplete.is_some());
}

/// A recording that is larger than what is read of a file at a time.
fn large() -> Vec<u8> {
    let mut b = RecordingBuilder::with_layout(Layout {
        compression: None,
        chunk_size: 20_000,
        ..Layout::default()
    });
    for episode in 0..40 {
        b.episode(episode, 120);
    }
    b.finish()
}

#[test]
fn of_a_file_that_changes_while_it_is_read_what_was_there_is_read_and_the_change_told() {
    let bytes = large();
    assert!(bytes.len() > 600_000, "{}", bytes.len());
    let (whole, _) = read(&bytes);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r.mcap");
    let changed = |change: &dyn Fn()| {
        fs::write(&path, &bytes).unwrap();
        let mut reader =
            RecordingReader::open(&path, Arc::from("r.mcap"), &ReadOptions::default()).unwrap();
        let mut episodes = reader.read(1).unwrap();
        change();
        while !reader.is_done() {
            episodes.extend(reader.read(1).unwrap());
        }
        (episodes, reader.into_row(None))
    };
    let (episodes, row) = changed(&|| {});
    assert_eq!((&episodes, row.is_clean()), (&whole, true));
    let (episodes, row) = changed(&|| {
        let mut file = OpenOptions::new().append(true).open(&path).unwrap();
        file.write_all(&bytes).unwrap();
    });
    assert_eq!(episodes, whole);
    assert!(
        told(&row).contains("grew while it was read"),
        "{}",
        told(&row)
    );
    let cut = bytes.len() * 3 / 4;
    let (episodes, row) = changed(&|| {
        let file = OpenOptions::new().write(true).open(&path).unwrap();
        file.set_len(cut as u64).unwrap();
    });
    assert!(
        episodes.len() > 20 && episodes.len() < whole.len(),
        "{}",
        episodes.len()
    );
    assert!(episodes.last().unwrap().incomplete.is_some());
    assert_eq!(episodes[..20], whole[..20]);
    assert!(
        told(&row).contains("shrank while it was read"),
        "{}",
        told(&row)
    );
    assert!(told(&row).contains("the file is cut"), "{}", told(&row));
}

#[test]
fn a_compressed_recording_that_is_cut_keeps_every_step_before_the_cut() {
    let bytes = large();
    let (whole, _) = read(&bytes);
    let compressed = zstd::bulk::compress(&bytes, 1).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r.mcap.zst");
    let mut n_before = 0;
    for i in 1..=20 {
        fs::write(&path, &compressed[..compressed.len() * i / 20]).unwrap();
        let found = read_path(&path, &ReadOptions::default());
        let (episodes, row) = &found;
        assert!(n_steps(episodes) >= n_before, "cut at {i}/20: {row:?}");
        n_before = n_steps(episodes);
        if i < 20 {
            assert!(
                is_reported(&found)
                    && (told(row).contains("cut") || told(row).contains("incomplete frame")),
                "{i}/20: {}",
                told(row)
            );
            let last = episodes.iter().find(|e| e.incomplete.is_some());
            assert!(
                episodes.is_empty() || last.is_none_or(|e| e.key == episodes.last().unwrap().key)
            );
        } else {
            assert_eq!(*episodes, whole);
            assert!(!is_reported(&found), "{row:?}");
        }
    }
    // Damaged in the middle, and with junk behind.
    let mut damaged = compressed.clone();
    damaged[compressed.len() / 2] ^= 0x55;
    fs::write(&path, &damaged).unwrap();
    let found = read_path(&path, &ReadOptions::default());
    assert!(is_reported(&found));
    fs::write(&path, [compressed, vec![0; 999]].concat()).unwrap();
    let found = read_path(&path, &ReadOptions::default());
    assert!(
        is_reported(&found) && found.0 == whole,
        "{}",
        told(&found.1)
    );
}

#[test]
fn the_ids_of_one_file_mean_nothing_in_the_next() {
    // In the second file of the recording channel 1 is the topic that was channel 2, in another encoding.
    let first: Vec<u8> = (0..N)
        .flat_map(|i| {
            let text = step_message(0, i, i + 1 == N).to_string();
            message(2, i as u64, text.as_bytes())
        })
        .collect();
    let channels = [
        channel(1, 0, "/other", "cbor"),
        channel(2, 0, "/step", "json"),
    ];
    let second = [broken::definitions(), broken::steps(1)].concat();
    let dir = tempfile::tempdir().unwrap();
    let paths = ["0.mcap", "1.mcap"].map(|name| dir.path().join(name));
    fs::write(&paths[0], file(&[channels.concat(), first])).unwrap();
    fs::write(&paths[1], file(&[RawChunk::of("zstd", &second).record()])).unwrap();
    let options = ReadOptions::default();
    let mut reader =
        RecordingReader::open_split(paths.to_vec(), Arc::from("bag"), &options).unwrap();
    let mut episodes = Vec::new();
    while !reader.is_done() {
        episodes.extend(reader.read(1).unwrap());
    }
    let found = (episodes, reader.into_row(None));
    assert_eq!(
        (n_steps(&found.0), is_reported(&found)),
        (2 * N, false),
        "{:?}",
        found.1
    );
}
