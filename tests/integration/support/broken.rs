//! Files made by hand, each broken or odd in one way, with what must come of it. Three episodes of ten steps each, in
//! a chunk of their own where there are chunks.

use mcap::records::op;

use super::raw_mcap::{
    HEAD, MAGIC, RawChunk, channel, file, file_with, lz4, message, metadata, record, record_saying,
    schema,
};
use super::recording_builder::step_message;

/// One file and what must come of it.
#[derive(Debug, Clone)]
pub(crate) struct Broken {
    pub(crate) name: String,
    pub(crate) bytes: Vec<u8>,
    /// Steps of episodes.
    pub(crate) n_steps: usize,
    /// Nothing must be told of it.
    pub(crate) clean: bool,
    /// The recording gives episodes, and its status is `ok`: what is wrong is among its causes.
    pub(crate) status: &'static str,
    /// Stands in the reason, or in a cause.
    pub(crate) told: String,
}

/// Steps of an episode.
pub(crate) const N: usize = 10;

fn case(name: &str, bytes: Vec<u8>, n_steps: usize, status: &'static str, told: &str) -> Broken {
    Broken {
        name: name.to_owned(),
        bytes,
        n_steps,
        clean: false,
        status,
        told: told.to_owned(),
    }
}

/// Odd, and still as good as any.
fn harmless(name: &str, bytes: Vec<u8>) -> Broken {
    Broken {
        clean: true,
        ..case(name, bytes, 3 * N, "ok", "")
    }
}

fn recovered(name: &str, bytes: Vec<u8>, n_steps: usize, told: &str) -> Broken {
    case(name, bytes, n_steps, "recovered", told)
}

fn failed(name: &str, bytes: &[u8], told: &str) -> Broken {
    case(name, bytes.to_vec(), 0, "failed", told)
}

/// Schema 1 and channel 1, `/step`.
pub(crate) fn definitions() -> Vec<u8> {
    [
        schema(1, "Step", "jsonschema", b"{}"),
        channel(1, 1, "/step", "json"),
    ]
    .concat()
}

/// A message of channel 1 with this step.
pub(crate) fn step(episode: usize, step: usize) -> Vec<u8> {
    let text = step_message(episode as i64, step, step + 1 == N).to_string();
    message(1, (episode * N + step) as u64 * 1_000_000, text.as_bytes())
}

pub(crate) fn steps(episode: usize) -> Vec<u8> {
    (0..N).flat_map(|i| step(episode, i)).collect()
}

/// Definitions and the first episode; the second; the third.
fn thirds() -> [Vec<u8>; 3] {
    [[definitions(), steps(0)].concat(), steps(1), steps(2)]
}

/// A file of three chunks of which the second is `second`.
fn with_second(second: Vec<u8>) -> Vec<u8> {
    let [a, _, c] = thirds();
    file(&[
        RawChunk::of("zstd", &a).record(),
        second,
        RawChunk::of("zstd", &c).record(),
    ])
}

/// A file without chunks, with something between its first and its second episode.
fn unchunked_with(between: &[u8]) -> Vec<u8> {
    let [a, b, c] = thirds();
    file(&[a, between.to_vec(), b, c])
}

/// All of them.
pub(crate) fn all() -> Vec<Broken> {
    [
        lengths(),
        chunks(),
        bombs(),
        definitions_that_lie(),
        summaries(),
        ends(),
        foreign(),
        messages(),
    ]
    .concat()
}

fn lengths() -> Vec<Broken> {
    let cut = |declared| [thirds()[0].clone(), record_saying(0x42, declared, b"abc")].concat();
    let before = |declared| [MAGIC.to_vec(), cut(declared)].concat();
    vec![
        recovered("length of 2^64 - 1", before(u64::MAX), N, "the file is cut"),
        recovered(
            "length near 2^64",
            before(u64::MAX - 8),
            N,
            "the file is cut",
        ),
        recovered("length of 2^63", before(1 << 63), N, "the file is cut"),
        recovered(
            "length of 300 MB",
            before(300_000_000),
            N,
            "the file is cut",
        ),
        recovered(
            "message of 2^62 bytes",
            [
                MAGIC.to_vec(),
                thirds()[0].clone(),
                record_saying(op::MESSAGE, 1 << 62, b"abc"),
            ]
            .concat(),
            N,
            "the file is cut",
        ),
        harmless(
            "attachment with a short body",
            unchunked_with(&record(op::ATTACHMENT, &[0; 3])),
        ),
        harmless(
            "attachment whose lengths lie",
            unchunked_with(&record(op::ATTACHMENT, &[0xff; 60])),
        ),
        harmless("empty records of every kind that is not read", {
            let kinds = [
                op::FOOTER,
                op::ATTACHMENT,
                op::MESSAGE_INDEX,
                op::CHUNK_INDEX,
                op::STATISTICS,
            ];
            unchunked_with(&kinds.map(|kind| record(kind, b"")).concat())
        }),
        recovered(
            "message with a short body",
            unchunked_with(&record(op::MESSAGE, &[1, 0, 0])),
            3 * N,
            "record that cannot be read",
        ),
        recovered(
            "schema whose lengths lie",
            unchunked_with(&record(op::SCHEMA, &[9, 0, 0xff, 0xff, 0xff, 0xff])),
            3 * N,
            "record that cannot be read",
        ),
        recovered(
            "channel whose lengths lie",
            unchunked_with(&record(op::CHANNEL, &[9, 0, 1, 0, 0xff, 0xff, 0xff, 0x7f])),
            3 * N,
            "record that cannot be read",
        ),
        recovered(
            "metadata whose lengths lie",
            unchunked_with(&record(op::METADATA, &[0xff; 4])),
            3 * N,
            "record that cannot be read",
        ),
        recovered(
            "opcode 0",
            unchunked_with(&record(0, b"nothing")),
            N,
            "opcode 0",
        ),
    ]
}

fn chunks() -> Vec<Broken> {
    let good = || RawChunk::of("zstd", &steps(1));
    let plain = || RawChunk::of("", &steps(1));
    let lost = |name: &str, chunk: &RawChunk, told| {
        recovered(name, with_second(chunk.record()), 2 * N, told)
    };
    let set = |f: &dyn Fn(&mut RawChunk)| {
        let mut chunk = good();
        f(&mut chunk);
        chunk
    };
    let mut broken_inside = steps(1);
    broken_inside.truncate(broken_inside.len() - 5);
    let nested = [steps(1), RawChunk::of("", &steps(2)).record()].concat();
    let odd_inside = [
        record(0x10, b"unknown"),
        record(0x80, b"private"),
        steps(1),
        record(0xff, b""),
    ]
    .concat();
    let longer =
        |chunk: &RawChunk| record(op::CHUNK, &[chunk.body(), b"later field".to_vec()].concat());
    vec![
        lost("chunk CRC", &set(&|c| c.crc ^= 4), "CRC"),
        lost("chunk bits", &set(&|c| c.compressed[20] ^= 0x10), "chunk"),
        lost(
            "chunk with unknown compression",
            &set(&|c| c.compression = "brotli"),
            "unknown compression",
        ),
        lost(
            "chunk with another compression",
            &set(&|c| c.compression = "lz4"),
            "does not inflate",
        ),
        lost(
            "chunk said to be plain",
            &set(&|c| c.compression = ""),
            "size",
        ),
        lost(
            "chunk that declares fewer bytes",
            &set(&|c| c.uncompressed_size -= 1),
            "chunk",
        ),
        lost(
            "chunk that declares more bytes",
            &set(&|c| c.uncompressed_size += 1),
            "size",
        ),
        lost(
            "chunk that declares no bytes",
            &set(&|c| c.uncompressed_size = 0),
            "chunk",
        ),
        lost(
            "chunk that declares 2^64 - 1 bytes",
            &set(&|c| c.uncompressed_size = u64::MAX),
            "--max-chunk",
        ),
        lost(
            "chunk whose records are said to be longer",
            &set(&|c| c.compressed_size += 1),
            "chunk",
        ),
        lost(
            "chunk whose records are said to be 2^64 - 1 bytes",
            &set(&|c| c.compressed_size = u64::MAX),
            "chunk",
        ),
        lost(
            "chunk whose records are said to be shorter",
            &set(&|c| c.compressed_size -= 3),
            "chunk",
        ),
        lost(
            "chunk whose records are said to be nothing",
            &set(&|c| c.compressed_size = 0),
            "chunk",
        ),
        recovered(
            "empty chunk record",
            with_second(record(op::CHUNK, b"")),
            2 * N,
            "chunk",
        ),
        recovered(
            "chunk with a short head",
            with_second(record(op::CHUNK, &[0; 30])),
            2 * N,
            "chunk",
        ),
        recovered(
            "chunk in a chunk",
            with_second(RawChunk::of("zstd", &nested).record()),
            3 * N,
            "chunk inside",
        ),
        // Its CRC is right: the writer made it so, and what can be read is read.
        recovered(
            "chunk whose last record is cut",
            with_second(RawChunk::of("", &broken_inside).record()),
            3 * N - 1,
            "records do not fit",
        ),
        harmless("chunk without a CRC", {
            let mut chunk = plain();
            chunk.crc = 0;
            with_second(chunk.record())
        }),
        harmless(
            "chunk called none",
            with_second(
                RawChunk {
                    compression: "none",
                    ..plain()
                }
                .record(),
            ),
        ),
        harmless(
            "chunk with bytes behind its records",
            with_second(longer(&good())),
        ),
        harmless(
            "unknown and private records in a chunk",
            with_second(RawChunk::of("lz4", &odd_inside).record()),
        ),
        harmless("empty chunks", {
            let [a, b, c] = thirds().map(|t| RawChunk::of("zstd", &t).record());
            let empty = ["", "zstd", "lz4"]
                .map(|kind| RawChunk::of(kind, b"").record())
                .concat();
            file(&[a, empty, b, c])
        }),
        case(
            "chunk that comes twice",
            {
                let [a, b, c] = thirds().map(|t| RawChunk::of("zstd", &t).record());
                file(&[a, b.clone(), b, c])
            },
            3 * N,
            "ok",
            "closed",
        ),
    ]
}

/// A few kilobytes that would become gigabytes.
fn bombs() -> Vec<Broken> {
    const GIANT: usize = 1 << 30;
    let zstd = zstd_bomb(4 * GIANT);
    let lz4 = lz4_bomb(GIANT / 4);
    let mut cases = Vec::new();
    for (compression, bomb) in [("zstd", zstd), ("lz4", lz4)] {
        for (size, told) in [
            (4 * GIANT as u64, "--max-chunk"),
            (1000, "chunk"),
            (48 << 20, "chunk"),
        ] {
            let chunk = RawChunk {
                uncompressed_size: size,
                crc: 0,
                compression,
                compressed_size: bomb.len() as u64,
                compressed: bomb.clone(),
            };
            let name = format!("{compression} bomb that declares {size} bytes");
            cases.push(recovered(&name, with_second(chunk.record()), 2 * N, told));
        }
        // Cut inside the bomb.
        let chunk = RawChunk {
            uncompressed_size: 48 << 20,
            crc: 0,
            compression,
            compressed_size: bomb.len() as u64,
            compressed: bomb,
        };
        let [a, ..] = thirds();
        let mut bytes = [
            MAGIC.to_vec(),
            RawChunk::of("zstd", &a).record(),
            chunk.record(),
        ]
        .concat();
        bytes.truncate(bytes.len() - 100);
        let name = format!("{compression} bomb that is cut");
        cases.push(recovered(&name, bytes, N, "the file is cut"));
    }
    cases
}

/// A frame of so many zero bytes, of which each block of 128 KiB takes four.
fn zstd_bomb(len: usize) -> Vec<u8> {
    const BLOCK: usize = 128 << 10;
    // Magic; no single segment, no content size; a window of 128 KiB.
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x38];
    let n_blocks = len / BLOCK;
    for i in 0..n_blocks {
        // A run of one byte: type 1.
        let head = (BLOCK << 3) | (1 << 1) | usize::from(i + 1 == n_blocks);
        frame.extend(&head.to_le_bytes()[..3]);
        frame.push(0);
    }
    frame
}

/// A frame of so many zero bytes, in blocks of 4 MiB that are the same.
fn lz4_bomb(len: usize) -> Vec<u8> {
    const BLOCK: usize = 4 << 20;
    let block = lz4_flex::block::compress(&vec![0; BLOCK]);
    let head = lz4_flex::frame::FrameInfo::new().block_size(lz4_flex::frame::BlockSize::Max4MB);
    let mut frame = lz4_flex::frame::FrameEncoder::with_frame_info(head, Vec::new())
        .finish()
        .unwrap();
    // Without the mark of the end.
    frame.truncate(frame.len() - 4);
    for _ in 0..len / BLOCK {
        frame.extend((block.len() as u32).to_le_bytes());
        frame.extend(&block);
    }
    frame.extend([0; 4]);
    frame
}

fn definitions_that_lie() -> Vec<Broken> {
    let [a, b, c] = thirds();
    let between = |records: &[Vec<u8>]| unchunked_with(&records.concat());
    let odd = |name: &str, records: &[Vec<u8>], told: &str| {
        case(name, between(records), 3 * N, "ok", told)
    };
    let with_extra = |record: &[u8]| {
        let mut body = record[HEAD..].to_vec();
        body.extend(b"a later field");
        self::record(record[0], &body)
    };
    let lost = RawChunk {
        crc: 7,
        ..RawChunk::of("zstd", &a)
    };
    let of = |records: &[u8]| RawChunk::of("zstd", records).record();
    let summary = [definitions()];
    vec![
        odd(
            "schema id 0",
            &[schema(0, "Odd", "jsonschema", b"{}")],
            "reserved id 0",
        ),
        odd(
            "schema redefined",
            &[schema(1, "Step", "jsonschema", b"[]")],
            "schema \"Step\" redefined",
        ),
        odd(
            "channel redefined",
            &[channel(1, 1, "/other", "json")],
            "channel \"/step\" redefined",
        ),
        odd(
            "message of an unknown channel",
            &[message(77, 0, b"{}")],
            "channel that is not defined",
        ),
        odd(
            "channel with another encoding, redefined",
            &[channel(1, 1, "/step", "cbor")],
            "redefined",
        ),
        harmless(
            "definitions again",
            between(&[definitions(), definitions()]),
        ),
        harmless(
            "channel with a schema that is nowhere",
            between(&[channel(9, 99, "/other", "json"), message(9, 0, b"{}")]),
        ),
        harmless("the same topic on a second channel", {
            let second = [channel(2, 1, "/step", "json"), steps(1)].concat();
            file(&[a.clone(), second, c.clone()])
        }),
        harmless("bytes behind the fields of definitions", {
            let records = [
                with_extra(&schema(1, "Step", "jsonschema", b"{}")),
                with_extra(&channel(1, 1, "/step", "json")),
                with_extra(&metadata("recording", &[("env_id", "Odd-v0")])),
            ];
            file(&[records.concat(), steps(0), steps(1), steps(2)])
        }),
        harmless(
            "unknown and private records",
            between(&[
                record(0x10, b"x"),
                record(0x7f, &[0; 500]),
                record(0x80, b""),
                record(0xff, b"mine"),
            ]),
        ),
        recovered(
            "first chunk lost, definitions in the summary",
            file_with(&[lost.record(), of(&b), of(&c)], &summary, true),
            2 * N,
            "CRC",
        ),
        recovered(
            "first chunk lost, definitions nowhere",
            file_with(&[lost.record(), of(&b), of(&c)], &[], true),
            0,
            "",
        ),
        recovered(
            "first chunk of no known kind, definitions in the summary",
            {
                let mut first = of(&a);
                first[0] = 0x66;
                file_with(&[first, of(&b), of(&c)], &summary, false)
            },
            2 * N,
            "defined in the summary alone",
        ),
    ]
    .into_iter()
    .map(|case| {
        if case.n_steps == 0 {
            Broken {
                status: "failed",
                ..case
            }
        } else {
            case
        }
    })
    .collect()
}

fn summaries() -> Vec<Broken> {
    let data = || thirds().map(|t| RawChunk::of("zstd", &t).record()).to_vec();
    let with = |name: &str, summary: &[Vec<u8>]| harmless(name, file_with(&data(), summary, true));
    let index = |offset: u64, length: u64| {
        let mut body = vec![0; 16];
        body.extend(offset.to_le_bytes());
        body.extend(length.to_le_bytes());
        body.extend([0; 32]);
        record(op::CHUNK_INDEX, &body)
    };
    let statistics = |n: u64| {
        record(
            op::STATISTICS,
            &[&n.to_le_bytes()[..], &[0xff; 38]].concat(),
        )
    };
    let without_footer = {
        let mut bytes = file(&data());
        bytes.truncate(bytes.len() - MAGIC.len() - HEAD - 20);
        [bytes, MAGIC.to_vec()].concat()
    };
    let footer = |body: &[u8]| {
        let mut bytes = file(&data());
        bytes.truncate(bytes.len() - MAGIC.len() - HEAD - 20);
        [bytes, record(op::FOOTER, body), MAGIC.to_vec()].concat()
    };
    let mut wrong_crc = file(&data());
    let at = wrong_crc.len() - MAGIC.len() - HEAD - 20 - 4;
    wrong_crc[at] ^= 1;
    let without_data_end = [
        MAGIC.to_vec(),
        data().concat(),
        record(op::FOOTER, &[0; 20]),
        MAGIC.to_vec(),
    ]
    .concat();
    // A message index whose kind was changed by one bit, and whose first bytes read as "no CRC".
    let [a, b, c] = thirds().map(|t| RawChunk::of("zstd", &t).record());
    let early_end = file(&[a, record(op::DATA_END, &[0; 6]), b, c]);
    vec![
        with(
            "chunk index that points nowhere",
            &[index(u64::MAX, 5), index(0, u64::MAX)],
        ),
        with("chunk index of length 0", &[index(8, 0)]),
        with("chunk listed twice", &[index(8, 100), index(8, 100)]),
        with(
            "empty index records",
            &[
                record(op::CHUNK_INDEX, b""),
                record(op::ATTACHMENT_INDEX, b""),
                record(op::METADATA_INDEX, b""),
            ],
        ),
        with(
            "statistics that lie",
            &[statistics(0), statistics(u64::MAX)],
        ),
        with("short statistics", &[record(op::STATISTICS, b"abc")]),
        with(
            "other definitions in the summary",
            &[
                schema(1, "Other", "ros2msg", b""),
                channel(1, 1, "/other", "cdr"),
            ],
        ),
        with(
            "definitions that cannot be read in the summary",
            &[record(op::SCHEMA, b"x"), record(op::CHANNEL, b"x")],
        ),
        harmless("no footer", without_footer),
        harmless("footer that points nowhere", footer(&[0xff; 20])),
        harmless("short footer", footer(b"ab")),
        recovered("data CRC", wrong_crc, 3 * N, "data section CRC"),
        recovered(
            "no end of the data",
            without_data_end,
            3 * N,
            "no data end record",
        ),
        recovered(
            "data behind its end",
            early_end,
            3 * N,
            "behind the end of the data",
        ),
    ]
}

fn ends() -> Vec<Broken> {
    let whole = file(&thirds());
    let [a, b, _] = thirds();
    // Cut in the middle of a step of the second episode.
    let half = [MAGIC.to_vec(), a, b[..b.len() / 2].to_vec()].concat();
    let n_half = N
        + (0..N)
            .filter(|&i| (0..=i).map(|j| step(1, j).len()).sum::<usize>() <= b.len() / 2)
            .count();
    let chunked = {
        let [a, b, _] = thirds().map(|t| RawChunk::of("zstd", &t).record());
        [MAGIC.to_vec(), a, b[..b.len() / 2].to_vec()].concat()
    };
    let mut cases = Vec::new();
    for n in [1usize, 8, 9, 300, 600, 70_000] {
        for fill in [0u8, 0xff] {
            let tail = vec![fill; n];
            // A few bytes could be the end of a message; a sector is none.
            let place = |bytes: &[u8]| match n {
                0..512 => String::new(),
                _ => format!("bytes of {fill:#04x} at offset {}", cut_record(bytes)),
            };
            let told = place(&half);
            cases.push(recovered(
                &format!("cut, then {n} bytes of {fill:#04x}"),
                [half.clone(), tail.clone()].concat(),
                n_half,
                &told,
            ));
            let told = place(&chunked);
            cases.push(recovered(
                &format!("cut in a chunk, then {n} bytes of {fill:#04x}"),
                [chunked.clone(), tail.clone()].concat(),
                N,
                &told,
            ));
            cases.push(recovered(
                &format!("{n} bytes of {fill:#04x} behind the end"),
                [whole.clone(), tail].concat(),
                3 * N,
                "closing magic",
            ));
        }
    }
    cases.extend([
        recovered(
            "text behind the end",
            [whole.clone(), b"junk".to_vec()].concat(),
            3 * N,
            "4 bytes follow the closing magic",
        ),
        recovered(
            "two files in one",
            [whole.clone(), whole.clone()].concat(),
            3 * N,
            "closing magic",
        ),
        recovered(
            "no closing magic",
            whole[..whole.len() - 8].to_vec(),
            3 * N,
            "the file is cut",
        ),
        recovered(
            "closing magic of another version",
            {
                let mut b = whole.clone();
                let at = b.len() - 3;
                b[at] = b'1';
                b
            },
            3 * N,
            "closing magic",
        ),
    ]);
    cases
}

/// Where the record begins that the end of `bytes` falls into.
fn cut_record(bytes: &[u8]) -> usize {
    super::raw_mcap::walk(bytes).last().unwrap().start
}

fn foreign() -> Vec<Broken> {
    let empty = file(&[]);
    vec![
        failed("empty", b"", "empty"),
        failed("half a magic", &MAGIC[..5], "first 8 bytes"),
        failed("magic alone", MAGIC, "the file is cut"),
        failed("no record", &empty, "no topic \"/step\""),
        failed(
            "two magics",
            &[*MAGIC, *MAGIC].concat(),
            "no data end record",
        ),
        failed("gzip", b"\x1f\x8b\x08\0\0\0\0\0", "gzip"),
        failed("zip", b"PK\x03\x04\x14\0", "zip"),
        failed("sqlite", b"SQLite format 3\0\x10\0", "SQLite"),
        failed("ros 1 bag", b"#ROSBAG V2.0\n", "ROS 1 bag"),
        failed(
            "lfs pointer",
            b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n",
            "Git LFS",
        ),
        failed("html", b"\n<!doctype html><html></html>", "HTML"),
        failed("json", b"{\"episode\": 0}", "JSON"),
        failed(
            "zstd without its name",
            &zstd::bulk::compress(&empty, 1).unwrap(),
            "*.mcap.zst",
        ),
        failed("lz4", &lz4(&empty), "lz4"),
        failed("future version", b"\x89MCAP1\r\n", "major version '1'"),
        failed("zero bytes", &[0; 4096], "zero"),
        failed("0xff bytes", &[0xff; 4096], "unknown kind"),
        failed("text", b"hello", "unknown kind"),
    ]
}

/// Files that are whole, with messages that are not.
fn messages() -> Vec<Broken> {
    let text = |t: &str| message(1, 0, t.as_bytes());
    // Of the second episode, step 4 is replaced.
    let with = |bad: Vec<u8>| {
        let records: Vec<u8> = (0..N)
            .flat_map(|i| if i == 4 { bad.clone() } else { step(1, i) })
            .collect();
        file(&[definitions(), steps(0), records, steps(2)])
    };
    let bad =
        |name: &str, json: &str, told: &str| case(name, with(text(json)), 2 * N + 4, "ok", told);
    let deep = "[".repeat(100_000);
    let many: Vec<u8> = (0..5000)
        .flat_map(|i| text(&format!("garbage {i}")))
        .collect();
    vec![
        bad(
            "NaN",
            r#"{"episode":1,"step":4,"action":[NaN],"state":[1,2,3]}"#,
            "NaN",
        ),
        bad(
            "Infinity",
            r#"{"episode":1,"step":4,"action":[1],"state":[1,-Infinity,3]}"#,
            "NaN or Infinity",
        ),
        bad(
            "number beyond f64",
            r#"{"episode":1,"step":4,"action":[1],"state":[1,-1e400,3]}"#,
            "out of range",
        ),
        bad(
            "duplicate key",
            r#"{"episode":1,"step":4,"action":[1],"state":[1,2,3],"\u0073tate":[1,2,3]}"#,
            "duplicate",
        ),
        bad(
            "nesting bomb",
            &format!(r#"{{"episode":1,"step":4,"action":[1],"state":{deep}"#),
            "recursion limit",
        ),
        bad(
            "nesting bomb elsewhere",
            &format!(r#"{{"episode":1,"step":4,"other":{deep}"#),
            "JSON",
        ),
        bad(
            "text for a number",
            r#"{"episode":1,"step":4,"action":["1"],"state":[1,2,3]}"#,
            "text where",
        ),
        bad(
            "object for an array",
            r#"{"episode":1,"step":4,"action":[1],"state":{"a":[{"b":"c"}]}}"#,
            "state",
        ),
        bad(
            "other width",
            r#"{"episode":1,"step":4,"action":[1],"state":[1,2,3,4]}"#,
            "another width",
        ),
        bad(
            "empty action",
            r#"{"episode":1,"step":4,"action":[],"state":[1,2,3]}"#,
            "empty",
        ),
        bad(
            "no state",
            r#"{"episode":1,"step":4,"action":[1]}"#,
            "missing",
        ),
        bad(
            "step number that is text",
            r#"{"episode":1,"step":"x","action":[1],"state":[1,2,3]}"#,
            "step",
        ),
        bad(
            "step number beyond an integer",
            r#"{"episode":1,"step":1e30,"action":[1],"state":[1,2,3]}"#,
            "step",
        ),
        bad(
            "no step number",
            r#"{"episode":1,"action":[1],"state":[1,2,3]}"#,
            "step number",
        ),
        bad("message that is empty", "", "JSON"),
        bad("message that is not UTF-8", "\u{fffd}", "JSON"),
        case(
            "step number that goes back",
            with(step(1, 2)),
            2 * N + 3,
            "ok",
            "first bad step",
        ),
        case(
            "step number that comes twice",
            with(step(1, 3)),
            2 * N + 4,
            "ok",
            "first bad step",
        ),
        case(
            "step number that is missing",
            with(Vec::new()),
            2 * N + 4,
            "ok",
            "first bad step",
        ),
        case(
            "episode that comes back",
            file(&[
                definitions(),
                steps(0),
                steps(1),
                steps(2),
                step(0, 3),
                step(1, 12),
            ]),
            3 * N,
            "ok",
            "closed",
        ),
        case(
            "thousands of bad messages",
            file(&[definitions(), steps(0), many, steps(1), steps(2)]),
            3 * N,
            "ok",
            "JSON",
        ),
    ]
}
