//! Large files are read ahead where there are threads for it: whatever is in them, the result is that of one thread.

use coact::recording::{EpisodeOption, ReadOptions};
use serde_json::json;

use crate::support::checked::{Read, read_path};
use crate::support::messages::{JOINT_STATE, joint_state};
use crate::support::raw_mcap::{RawChunk, channel, file, message, record, schema};
use crate::support::reading::Dice;

/// Chunks with so much on a topic that nobody asks for make a file large enough to be read ahead.
const N_CHUNKS: usize = 48;
const BALLAST: usize = 100 << 10;

/// A file of chunks, the messages of each made by `fill`.
fn chunks(dice: &mut Dice, mut fill: impl FnMut(&mut Dice, usize) -> Vec<u8>) -> Vec<Vec<u8>> {
    let ballast: Vec<u8> = (0..BALLAST).map(|_| dice.below(256) as u8).collect();
    (0..N_CHUNKS)
        .map(|nth| {
            let mut records = message(9, 0, &ballast);
            records.extend(fill(dice, nth));
            let compression = ["", "zstd", "lz4"][nth % 3];
            RawChunk::of(compression, &records).record()
        })
        .collect()
}

/// Reads it with one thread and with several.
fn read_both(bytes: &[u8], options: &ReadOptions) -> Read {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r.mcap");
    std::fs::write(&path, bytes).unwrap();
    let with = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n);
        pool.build().unwrap().install(|| read_path(&path, options))
    };
    let (one, several) = (with(1), with(3));
    assert_eq!(one.1, several.1);
    assert!(one.0 == several.0, "the episodes differ");
    one
}

fn definitions() -> Vec<Vec<u8>> {
    vec![
        channel(1, 0, "/step", "json"),
        channel(9, 0, "/camera", "raw"),
    ]
}

/// One step; some cannot be read, some belong to nobody.
fn step(dice: &mut Dice, id: &serde_json::Value, nth: usize) -> Vec<u8> {
    let (channel, data) = match dice.below(400) {
        0 => (1, b"{\"action\":[NaN]}".to_vec()),
        1 => (
            1,
            json!({"episode": id, "step": nth}).to_string().into_bytes(),
        ),
        2 => (7, b"{}".to_vec()),
        _ => {
            let state: Vec<f64> = (0..20).map(|_| dice.below(1 << 40) as f64 / 7.0).collect();
            let step = json!({"episode": id, "step": nth, "action": dice.below(5), "state": state,
                "reward": dice.below(9), "terminated": nth == 99});
            (1, step.to_string().into_bytes())
        }
    };
    message(channel, nth as u64, &data)
}

#[test]
fn steps_bad_steps_and_damage_are_those_of_one_thread() {
    for seed in 0..6 {
        let mut dice = Dice(seed);
        let mut nth = 0;
        let with_text = seed % 2 == 0;
        let mut data = chunks(&mut dice, |dice, _| {
            (0..20 + dice.below(30))
                .flat_map(|_| {
                    let id = nth / 100;
                    let id = if with_text {
                        json!(format!("run {id}"))
                    } else {
                        json!(id)
                    };
                    nth += 1;
                    step(dice, &id, (nth - 1) % 100)
                })
                .collect()
        });
        // A chunk whose CRC is wrong, one that does not inflate, records of other kinds between the chunks.
        let at = 5 + dice.below(20) as usize;
        *data[at].last_mut().unwrap() ^= 1;
        data[at + 9].truncate(200);
        let damaged = RawChunk::of("none", b"\x05no record").record();
        data[at + 10] = damaged;
        data.insert(at + 11, step(&mut dice, &json!(1000), 0));
        data.insert(at + 3, record(0x90, b"of an unknown kind"));
        data.insert(at + 4, channel(2, 0, "/step", "json"));
        data.truncate(N_CHUNKS);
        data[at + 9] = record(0x06, &data[at + 9][9..]);
        let bytes = file(&[definitions(), data].concat());
        assert!(bytes.len() > 4 << 20);
        let (episodes, row) = read_both(&bytes, &ReadOptions::default());
        assert!(episodes.len() > 3, "{row:?}");
        assert!(row.causes.len() > 2, "{row:?}");
    }
}

/// A topic with joints by name, and its schema.
fn joint_topic() -> Vec<Vec<u8>> {
    let (name, encoding, data) = JOINT_STATE;
    vec![
        schema(1, name, encoding, data),
        channel(1, 1, "/joint_states", "cdr"),
        channel(2, 1, "/command", "cdr"),
        channel(9, 0, "/camera", "raw"),
    ]
}

#[test]
fn topics_joints_and_pauses_are_those_of_one_thread() {
    let options = ReadOptions {
        actions: vec!["/command:position".parse().unwrap()],
        states: vec!["/joint_states:position".parse().unwrap()],
        episodes: EpisodeOption::Gap(1_000_000_000),
        ..ReadOptions::default()
    };
    // Names that stay, names in another order, a joint that only comes late, and one after episodes were given out.
    for late in [usize::MAX, 1, 3, 40] {
        let mut dice = Dice(late as u64);
        let mut time: u64 = 1_000_000;
        let data = chunks(&mut dice, |dice, nth| {
            let mut records = Vec::new();
            for _ in 0..40 {
                time += if dice.below(50) == 0 {
                    2_000_000_000
                } else {
                    10_000_000
                };
                let names = match dice.below(3) {
                    _ if nth == late => ["a", "c"],
                    0 => ["b", "a"],
                    _ => ["a", "b"],
                };
                let position = [dice.below(100) as f64, dice.below(7) as f64 / 3.0];
                let stray = dice.below(40_000_000);
                records.extend(message(
                    1,
                    time - stray.min(time),
                    &joint_state(0, &names, &position),
                ));
                records.extend(message(2, time, &joint_state(0, &["x", "y"], &position)));
            }
            records
        });
        let bytes = file(&[joint_topic(), data].concat());
        let (episodes, row) = read_both(&bytes, &options);
        assert!(!episodes.is_empty(), "{row:?}");
    }
}
