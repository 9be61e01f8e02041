//! Good recordings cut at every byte and with every byte changed. There are two outcomes and no third: the same
//! episodes and a clean row, or something that is reported. A cut keeps every step in front of it.
//!
//! `cargo test` runs a short form; the environment variable `COACT_SWEEP` asks for all of it (`scripts/fault_sweep.sh`).

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU64, Ordering};

use coact::model::RecordingStatus;
use coact::recording::ReadOptions;
use mcap::Compression;
use mcap::records::op;
use rayon::prelude::*;

use crate::support::checked::{Read, is_reported, n_steps, read, read_in, step_bits};
use crate::support::raw_mcap::{
    HEAD, MAGIC, RawChunk, channel, file_with, message, messages_before, walk,
};
use crate::support::recording_builder::step_message;
use crate::support::subjects::{self, Subject};

/// What is done to a byte; the long form does all of it to every byte.
const MASKS: [u8; 10] = [0x01, 0x02, 0x04, 0x08, 0x10, 0x20, 0x40, 0x80, 0xFF, 0x55];

/// In the short form of a sweep one place in so many is tried.
const STRIDE: usize = 5;

pub(crate) fn is_long() -> bool {
    std::env::var_os("COACT_SWEEP").is_some()
}

fn stride() -> usize {
    if is_long() { 1 } else { STRIDE }
}

/// Runs `check` on each case, with a folder of its thread's own.
fn sweep<T: Sync>(cases: &[T], check: impl Fn(&std::path::Path, &T) + Sync) {
    cases.par_iter().for_each_init(
        || tempfile::tempdir().unwrap(),
        |dir, case| check(dir.path(), case),
    );
}

#[test]
fn a_recording_cut_at_any_byte_keeps_every_step_before_the_cut() {
    for subject in subjects::all() {
        let cuts: Vec<usize> = (0..subject.bytes.len()).step_by(stride()).collect();
        check_cuts(&subject, &cuts);
    }
}

#[test]
fn of_the_chunk_that_is_cut_the_readable_part_is_kept() {
    for compression in [Some(Compression::Zstd), Some(Compression::Lz4), None] {
        let subject = subjects::large_chunk(compression);
        let n_cuts = if is_long() { 400 } else { 24 };
        let stride = subject.bytes.len() / n_cuts;
        let cuts: Vec<usize> = (0..subject.bytes.len()).step_by(stride).collect();
        let n_partial = check_cuts(&subject, &cuts);
        assert!(
            n_partial > 0,
            "{}: no part of the chunk came out",
            subject.name
        );
    }
}

/// Cuts a recording; how many cuts left some of the steps.
#[track_caller]
fn check_cuts(subject: &Subject, cuts: &[usize]) -> u64 {
    let Subject { name, bytes, .. } = subject;
    let expected = read(bytes);
    assert!(!is_reported(&expected), "{name}: {:?}", expected.1);
    let records = walk(bytes);
    let data_end = records
        .iter()
        .find(|at| at.opcode == op::DATA_END)
        .unwrap()
        .end;
    let (n_partial, n_kept) = (AtomicU64::new(0), AtomicU64::new(0));
    sweep(cuts, |folder, &cut| {
        let what = format!("{name}, cut at {cut}");
        let found = read_in(folder, &bytes[..cut], &ReadOptions::default());
        let (episodes, row) = &found;
        let n_before = messages_before(bytes, &records, cut)
            .iter()
            .filter(|&&id| id == subject.clock)
            .count();
        assert_eq!(n_steps(episodes), n_before, "{what}: {row:?}");
        check_prefixes(&expected, &found, &what);
        let status = if n_before == 0 {
            RecordingStatus::Failed
        } else {
            RecordingStatus::Recovered
        };
        assert_eq!(row.status, status, "{what}: {row:?}");
        let told = row.reason.as_deref().unwrap_or_default();
        if cut >= MAGIC.len() {
            let last = records.iter().rfind(|at| at.start <= cut && cut < at.end);
            let start = last.map_or(records.last().unwrap().end, |at| at.start);
            assert!(
                told.contains("the file is cut") && told.ends_with(&format!("at offset {start}")),
                "{what}: {told}"
            );
        } else {
            assert!(
                told.contains("empty") || told.contains("first 8 bytes"),
                "{what}: {told}"
            );
        }
        check_incomplete(subject, &expected, &found, cut >= data_end, &what);
        n_kept.fetch_add(n_before as u64, Ordering::Relaxed);
        n_partial.fetch_add(u64::from(n_before > 0 && cut < data_end), Ordering::Relaxed);
    });
    eprintln!(
        "{name}: {} cuts, {} steps in front of them kept, none lost",
        cuts.len(),
        n_kept.into_inner()
    );
    n_partial.into_inner()
}

/// Each episode found is the beginning of the true one, to the bit.
#[track_caller]
fn check_prefixes(expected: &Read, found: &Read, what: &str) {
    for episode in &found.0 {
        let whole = expected.0.iter().find(|e| e.key == episode.key);
        let whole = whole.unwrap_or_else(|| panic!("{what}: no episode {:?}", episode.key));
        for step in 0..episode.n_steps() {
            assert_eq!(
                step_bits(episode, step),
                step_bits(whole, step),
                "{what}: step {step}"
            );
        }
    }
}

/// The episode that a cut falls in is incomplete, and no other.
#[track_caller]
fn check_incomplete(subject: &Subject, expected: &Read, found: &Read, all_data: bool, what: &str) {
    for (i, episode) in found.0.iter().enumerate() {
        let is_whole = episode.n_steps() == expected.0[i].n_steps();
        let is_certain = is_whole && (subject.ends_by_flag || all_data);
        assert_eq!(
            episode.incomplete.is_none(),
            is_certain,
            "{what}: {:?}",
            episode.incomplete
        );
    }
}

#[test]
fn a_changed_byte_changes_nothing_or_is_reported() {
    for subject in subjects::all() {
        let Subject { name, bytes, .. } = &subject;
        let expected = read(bytes);
        assert!(!is_reported(&expected), "{name}: {:?}", expected.1);
        let true_steps: BTreeSet<Vec<u64>> = expected
            .0
            .iter()
            .flat_map(|e| (0..e.n_steps()).map(|step| step_bits(e, step)))
            .collect();
        let chunks: Vec<_> = walk(bytes)
            .into_iter()
            .filter(|at| at.opcode == op::CHUNK)
            .collect();
        let cases = flips(bytes.len());
        let n_reported = AtomicU64::new(0);
        sweep(&cases, |folder, &(at, mask)| {
            let what = format!("{name}, byte {at} ^ {mask:#04x}");
            let mut broken = bytes.clone();
            broken[at] ^= mask;
            let found = read_in(folder, &broken, &ReadOptions::default());
            if is_reported(&found) {
                n_reported.fetch_add(1, Ordering::Relaxed);
            } else {
                assert_eq!(found, expected, "{what}");
            }
            assert!(
                n_steps(&found.0) <= n_steps(&expected.0),
                "{what}: steps came twice"
            );
            // Steps that are joined from two topics are others where a chunk passes for a record that nobody knows.
            let in_chunk = chunks.iter().any(|c| (c.start + HEAD..c.end).contains(&at));
            if subject.has_chunk_crcs && (subject.ends_by_flag || in_chunk) {
                for episode in &found.0 {
                    for step in 0..episode.n_steps() {
                        let bits = step_bits(episode, step);
                        assert!(
                            true_steps.contains(&bits),
                            "{what}: step {step} of {} is none of the true ones: {:?} {:?}",
                            episode.n_steps(),
                            episode.incomplete,
                            found.1
                        );
                    }
                }
            }
        });
        let n_reported = n_reported.into_inner();
        eprintln!(
            "{name}: {} bytes changed, {n_reported} reported, {} without effect; panics, silent losses, doubled steps: 0",
            cases.len(),
            cases.len() as u64 - n_reported
        );
    }
}

/// Places and masks: all of them in the long form, each place with another mask in the short one.
fn flips(len: usize) -> Vec<(usize, u8)> {
    if is_long() {
        (0..len)
            .flat_map(|at| MASKS.map(|mask| (at, mask)))
            .collect()
    } else {
        (0..len)
            .step_by(STRIDE)
            .map(|at| (at, MASKS[at / STRIDE % MASKS.len()]))
            .collect()
    }
}

/// Where a writer made no CRC, a changed digit is another number and nobody can tell; all else still holds.
#[test]
fn without_crcs_a_changed_byte_never_panics_and_never_makes_more_steps() {
    for compression in ["zstd", "lz4", ""] {
        let bytes = without_crcs(compression);
        let expected = read(&bytes);
        assert_eq!((n_steps(&expected.0), is_reported(&expected)), (20, false));
        let cases = flips(bytes.len());
        let n_changed = AtomicU64::new(0);
        sweep(&cases, |folder, &(at, mask)| {
            let mut broken = bytes.clone();
            broken[at] ^= mask;
            let found = read_in(folder, &broken, &ReadOptions::default());
            assert!(
                n_steps(&found.0) <= 20,
                "{compression}, byte {at} ^ {mask:#04x}"
            );
            let silent = !is_reported(&found) && found != expected;
            n_changed.fetch_add(u64::from(silent), Ordering::Relaxed);
        });
        eprintln!(
            "no CRC, {compression:?}: {} bytes changed, {} of them read as other data",
            cases.len(),
            n_changed.into_inner()
        );
    }
}

/// Two episodes in three chunks whose CRCs, and that of the data, are 0: not available.
fn without_crcs(compression: &'static str) -> Vec<u8> {
    let mut chunks = vec![channel(1, 0, "/step", "json")];
    let mut records = Vec::new();
    for (i, (episode, step)) in [0i64, 1]
        .iter()
        .flat_map(|e| (0..10).map(move |s| (*e, s)))
        .enumerate()
    {
        let text = step_message(episode, step, step == 9).to_string();
        records.extend(message(1, i as u64, text.as_bytes()));
        if i % 7 == 6 || i == 19 {
            let mut chunk = RawChunk::of(compression, &std::mem::take(&mut records));
            chunk.crc = 0;
            chunks.push(chunk.record());
        }
    }
    file_with(&chunks, &[], false)
}

#[test]
fn a_record_that_declares_any_length_is_reported_or_harmless() {
    for subject in subjects::all() {
        let Subject { name, bytes, .. } = &subject;
        let expected = read(bytes);
        let records = walk(bytes);
        // To the end of each later record: what a damaged length can swallow whole.
        let cases: Vec<(usize, u64)> = records
            .iter()
            .enumerate()
            .step_by(if is_long() { 1 } else { 3 })
            .flat_map(|(i, at)| {
                let whole = records[i..]
                    .iter()
                    .map(|later| (later.end - at.start - HEAD) as u64);
                let near = [0, 1, u64::MAX, u64::MAX - 8, 1 << 63, bytes.len() as u64];
                whole
                    .chain(near)
                    .map(|length| (at.start, length))
                    .collect::<Vec<_>>()
            })
            .collect();
        sweep(&cases, |folder, &(start, length)| {
            let mut broken = bytes.clone();
            broken[start + 1..start + HEAD].copy_from_slice(&length.to_le_bytes());
            let found = read_in(folder, &broken, &ReadOptions::default());
            if !is_reported(&found) {
                assert_eq!(
                    found, expected,
                    "{name}, record at {start} declares {length}"
                );
            }
        });
        eprintln!("{name}: {} lengths that lie", cases.len());
    }
}

#[test]
fn a_record_of_any_other_kind_is_reported_or_harmless() {
    for subject in subjects::all() {
        let Subject { name, bytes, .. } = &subject;
        let expected = read(bytes);
        let opcodes = (0u8..=0x12).chain([0x7f, 0x80, 0xff]);
        let cases: Vec<(usize, u8)> = walk(bytes)
            .iter()
            .flat_map(|at| opcodes.clone().map(|opcode| (at.start, opcode)))
            .step_by(stride())
            .collect();
        sweep(&cases, |folder, &(start, opcode)| {
            let mut broken = bytes.clone();
            broken[start] = opcode;
            let found = read_in(folder, &broken, &ReadOptions::default());
            if !is_reported(&found) {
                assert_eq!(found, expected, "{name}, opcode {opcode:#04x} at {start}");
            }
        });
        eprintln!("{name}: {} opcodes that lie", cases.len());
    }
}
