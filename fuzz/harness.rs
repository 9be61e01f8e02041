//! What the fuzz targets do with their bytes, through the library's public functions alone. The corpus under version
//! control is run through the same functions by `cargo test` (`tests/integration/corpus.rs`).

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Parser;
use coact::cli::{Cli, Command};
use coact::recording::{
    Align, Clock, EpisodeOption, Limits, OnDamage, ReadOptions, RecordingReader, Selector, inspect,
    rosbag2_files,
};

/// Every target, by its name.
pub(crate) const TARGETS: [&str; 10] = [
    "records",
    "json",
    "protobuf",
    "cdr",
    "ros1",
    "cbor",
    "msgpack",
    "flatbuffer",
    "options",
    "bag",
];

/// Runs a target on some bytes. A panic, an abort or a broken promise is a find.
pub(crate) fn run(target: &str, data: &[u8]) {
    match target {
        "records" => records(data),
        "options" => options(data),
        "bag" => bag(data),
        encoding => messages(encoding, data),
    }
}

/// Small limits: a find is to be a bug, not a big file.
const LIMITS: Limits = Limits {
    max_record: 1 << 20,
    max_chunk: 4 << 20,
    max_episode: 16 << 20,
    max_open_episodes: 4,
};

/// A whole file, as it is; the first byte chooses how it is read.
fn records(data: &[u8]) {
    let Some((&how, file)) = data.split_first() else {
        return;
    };
    let options = ReadOptions {
        limits: LIMITS,
        on_damage: if how & 1 == 0 {
            OnDamage::Recover
        } else {
            OnDamage::Fail
        },
        ..ReadOptions::default()
    };
    let name = if how & 2 == 0 { "r.mcap" } else { "r.mcap.zst" };
    read(name, file, &options, how & 4 != 0);
}

/// Pairs of an action and a state; none: found out.
const SELECTORS: [(&str, &str); 8] = [
    ("", ""),
    ("/step:action", "/step:state"),
    ("/step", "/step:position"),
    ("/step:points[0].positions", "/step:data[1..3]"),
    ("/step:position[a]", "/step:position[b]"),
    ("/step:a.b.c", "/step:a"),
    ("/step:joints.position[a]", "/step:joints"),
    ("/step:linear", "/step:angular.x"),
];

const EPISODES: [&str; 4] = ["auto", "recording", "done:/step:done", "field:/step:a.b"];

/// Messages of one channel: two bytes that choose how they are read, the length of what follows, the schema (its name,
/// a line break, its text), and messages, each behind its length.
fn messages(encoding: &str, data: &[u8]) {
    let [how, selectors, low, high, rest @ ..] = data else {
        return;
    };
    let len = usize::from(u16::from_le_bytes([*low, *high])).min(rest.len());
    let (schema, mut rest) = rest.split_at(len);
    let mut file = File::new(encoding, schema);
    while let [low, high, after @ ..] = rest {
        let len = usize::from(u16::from_le_bytes([*low, *high])).min(after.len());
        let (message, after) = after.split_at(len);
        file.message(message);
        rest = after;
    }
    let (action, state) = SELECTORS[usize::from(selectors % 8)];
    let parsed = |text: &str| text.parse::<Selector>().ok().into_iter().collect();
    let options = ReadOptions {
        limits: LIMITS,
        actions: parsed(action),
        states: parsed(state),
        episodes: EPISODES[usize::from(how >> 6)].parse().unwrap_or_default(),
        align: [Align::Before, Align::Nearest, Align::Index][usize::from(how % 3)],
        clock: if how & 8 == 0 {
            Clock::Log
        } else {
            Clock::Header
        },
        ..ReadOptions::default()
    };
    read("r.mcap", &file.finish(), &options, how & 16 != 0);
}

/// Text: selectors, episode rules and a configuration file.
fn options(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    if let Ok(selector) = text.parse::<Selector>() {
        // As it is printed it is the same.
        assert_eq!(selector.to_string().parse().as_ref(), Ok(&selector));
    }
    if let Ok(rule) = text.parse::<EpisodeOption>() {
        assert_eq!(rule.to_string().parse().as_ref(), Ok(&rule));
    }
    let folder = folder();
    let path = folder.join("run.toml");
    fs::write(&path, text).expect("the folder can be written");
    let arguments = [
        "coact".as_ref(),
        "extract".as_ref(),
        "--config".as_ref(),
        path.as_os_str(),
    ];
    if let Ok(Cli {
        command: Command::Extract(arguments),
    }) = Cli::try_parse_from(arguments)
    {
        let _refused_or_not = arguments.request().is_ok();
    }
}

/// The `metadata.yaml` of a bag.
fn bag(data: &[u8]) {
    let folder = folder();
    fs::write(folder.join("metadata.yaml"), data).expect("the folder can be written");
    let _files_or_a_reason = rosbag2_files(&folder);
}

/// Reads a file to its end and holds what comes out against what must always hold.
fn read(name: &str, bytes: &[u8], options: &ReadOptions, inspected: bool) {
    let path = folder().join(name);
    fs::write(&path, bytes).expect("the folder can be written");
    let name: Arc<str> = Arc::from(name);
    if inspected {
        let _report = inspect(Arc::clone(&name), std::slice::from_ref(&path), options);
    }
    let Ok(mut reader) = RecordingReader::open(&path, name, options) else {
        return;
    };
    let mut keys = BTreeSet::new();
    let mut n_episodes = 0;
    let mut error = None;
    while !reader.is_done() && error.is_none() {
        match reader.read(1) {
            Ok(episodes) => {
                for episode in episodes {
                    n_episodes += 1;
                    let is_new = keys.insert((episode.key.episode, episode.key.episode_id.clone()));
                    assert!(is_new, "an episode came twice: {:?}", episode.key);
                    let columns = episode.actions.iter().chain(episode.states.iter());
                    let values = columns.flatten();
                    assert!({ values }.all(|v| v.is_finite()), "a number that is none");
                    assert_eq!(episode.states.n_rows(), episode.n_steps());
                }
            }
            Err(e) => error = Some(e.to_string()),
        }
    }
    let row = reader.into_row(error.as_deref());
    assert_eq!(row.n_messages, row.n_messages_used + row.n_messages_refused);
    assert_eq!(row.n_episodes, n_episodes);
}

/// A folder of this thread's own, in memory where there is such a place.
fn folder() -> PathBuf {
    thread_local! {
        static FOLDER: RefCell<Option<PathBuf>> = const { RefCell::new(None) };
    }
    FOLDER.with_borrow_mut(|folder| {
        folder
            .get_or_insert_with(|| {
                let memory = Path::new("/dev/shm");
                let base = if memory.is_dir() {
                    memory.to_owned()
                } else {
                    std::env::temp_dir()
                };
                let thread = format!("{:?}", std::thread::current().id());
                let digits: String = thread.chars().filter(char::is_ascii_digit).collect();
                let folder = base.join(format!("coact-fuzz-{}-{digits}", std::process::id()));
                fs::create_dir_all(&folder).expect("a folder can be made");
                folder
            })
            .clone()
    })
}

/// Removes the folder of this thread.
pub(crate) fn clean_up() {
    let _gone_already = fs::remove_dir_all(folder());
}

/// An MCAP file of one channel, `/step`, without chunks and CRCs.
struct File {
    bytes: Vec<u8>,
    n_messages: u64,
}

const MAGIC: &[u8] = b"\x89MCAP0\r\n";

impl File {
    fn new(encoding: &str, schema: &[u8]) -> Self {
        let end = schema
            .iter()
            .position(|&b| b == b'\n')
            .unwrap_or(schema.len());
        let (name, text) = (&schema[..end], schema.get(end + 1..).unwrap_or_default());
        let kind = match encoding {
            "cdr" => "ros2msg",
            "ros1" => "ros1msg",
            "json" => "jsonschema",
            "flatbuffer" => "flatbuffer",
            other => other,
        };
        let mut file = Self {
            bytes: MAGIC.to_vec(),
            n_messages: 0,
        };
        let string = |text: &[u8]| [&(text.len() as u32).to_le_bytes(), text].concat();
        let name = String::from_utf8_lossy(name).into_owned();
        let schema = [
            &[1, 0][..],
            &string(name.as_bytes()),
            &string(kind.as_bytes()),
            &string(text),
        ];
        file.record(0x03, &schema.concat());
        let channel = [
            &[1, 0, 1, 0][..],
            &string(b"/step"),
            &string(encoding.as_bytes()),
            &[0; 4],
        ];
        file.record(0x04, &channel.concat());
        file
    }

    fn record(&mut self, opcode: u8, body: &[u8]) {
        self.bytes.push(opcode);
        self.bytes.extend((body.len() as u64).to_le_bytes());
        self.bytes.extend(body);
    }

    fn message(&mut self, data: &[u8]) {
        let time = (self.n_messages * 1_000_000).to_le_bytes();
        self.n_messages += 1;
        self.record(
            0x05,
            &[&[1, 0, 0, 0, 0, 0][..], &time, &time, data].concat(),
        );
    }

    fn finish(mut self) -> Vec<u8> {
        self.record(0x0f, &[0; 4]);
        self.bytes.extend(MAGIC);
        self.bytes
    }
}
