//! Reading a recording: decoding against merely walking its records.
//!
//! Left out: the method and the tables. Recordings are written outside the timed closures, seeded, 100,000 messages
//! each (`COACT_BENCH_MESSAGES` sets another number).

use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use coact::recording::{ReadOptions, RecordingReader};
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use mcap::records::MessageHeader;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader};
use mcap::{Compression, WriteOptions};

fn main() {
    divan::main();
}

/// Joints of the arm in `joint_states`.
const N_JOINTS: usize = 14;

/// Nanoseconds between two messages.
const STEP_NANOS: u64 = 1_000_000;

/// A command comes after so many states.
const STATES_PER_COMMAND: u64 = 50;

const JOINT_STATE: &str = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n\
    float64[] effort\n================================================================================\n\
    MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n\
    ================================================================================\n\
    MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";

const MULTI_ARRAY: &str = "MultiArrayLayout layout\nfloat64[] data\n\
    ================================================================================\n\
    MSG: std_msgs/MultiArrayLayout\nMultiArrayDimension[] dim\nuint32 data_offset\n\
    ================================================================================\n\
    MSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n";

fn n_messages() -> u64 {
    std::env::var("COACT_BENCH_MESSAGES")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(100_000)
}

/// Little-endian CDR, aligned behind the four bytes of its header.
#[derive(Default)]
struct Cdr(Vec<u8>);

impl Cdr {
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn align(&mut self, to: usize) {
        while !(self.0.len() - 4).is_multiple_of(to) {
            self.0.push(0);
        }
    }

    fn u32(&mut self, value: usize) {
        self.align(4);
        self.0
            .extend(u32::try_from(value).expect("small").to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.u32(text.len() + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }

    fn doubles(&mut self, values: impl ExactSizeIterator<Item = f64>) {
        self.u32(values.len());
        self.align(8);
        values.for_each(|v| self.0.extend(v.to_le_bytes()));
    }
}

fn joint_state(step: u64) -> Vec<u8> {
    let mut cdr = Cdr::new();
    cdr.u32(usize::try_from(step).expect("small"));
    cdr.u32(0);
    cdr.text("base");
    cdr.u32(N_JOINTS);
    for joint in 0..N_JOINTS {
        cdr.text(&format!("arm_joint_{joint}"));
    }
    for scale in [0.01, 0.02, 0.03] {
        cdr.doubles((0..N_JOINTS).map(|joint| (step as f64 * scale + joint as f64).sin()));
    }
    cdr.0
}

/// A bag of joint states with a command now and then, written once.
fn bag(compression: Option<Compression>) -> PathBuf {
    let mut writer = WriteOptions::new()
        .compression(compression)
        .chunk_size(Some(1 << 20))
        .create(Cursor::new(Vec::new()))
        .expect("a writer in memory");
    let mut channel = |topic: &str, name: &str, schema: &str| {
        let id = writer
            .add_schema(name, "ros2msg", schema.as_bytes())
            .expect("a schema");
        writer
            .add_channel(id, topic, "cdr", &BTreeMap::new())
            .expect("a channel")
    };
    let states = channel("/joint_states", "sensor_msgs/msg/JointState", JOINT_STATE);
    let commands = channel("/command", "std_msgs/msg/Float64MultiArray", MULTI_ARRAY);
    let mut write = |channel_id, step: u64, data: &[u8]| {
        let header = MessageHeader {
            channel_id,
            sequence: 0,
            log_time: step * STEP_NANOS,
            publish_time: step * STEP_NANOS,
        };
        writer
            .write_to_known_channel(&header, data)
            .expect("a message");
    };
    for step in 0..n_messages() {
        write(states, step, &joint_state(step));
        if step.is_multiple_of(STATES_PER_COMMAND) {
            let mut cdr = Cdr::new();
            cdr.u32(0);
            cdr.u32(0);
            cdr.doubles([(step % 7) as f64].into_iter());
            write(commands, step, &cdr.0);
        }
    }
    writer.finish().expect("the end of the file");
    let name = format!("coact-bench-{}-{compression:?}.mcap", std::process::id());
    let path = std::env::temp_dir().join(name);
    fs::write(&path, writer.into_inner().into_inner()).expect("a file");
    path
}

fn plain() -> &'static PathBuf {
    static BAG: OnceLock<PathBuf> = OnceLock::new();
    BAG.get_or_init(|| bag(None))
}

fn zstd() -> &'static PathBuf {
    static BAG: OnceLock<PathBuf> = OnceLock::new();
    BAG.get_or_init(|| bag(Some(Compression::Zstd)))
}

/// The official reader, record by record, nothing decoded.
fn walk(path: &Path) -> u64 {
    let bytes = fs::read(path).expect("the bag");
    let mut rest = bytes.as_slice();
    let mut reader = LinearReader::new();
    let mut n = 0;
    while let Some(event) = reader.next_event() {
        match event.expect("a whole file") {
            LinearReadEvent::ReadRequest(wanted) => {
                let (given, left) = rest.split_at(wanted.min(rest.len()));
                reader.insert(given.len()).copy_from_slice(given);
                reader.notify_read(given.len());
                rest = left;
            }
            LinearReadEvent::Record { data, opcode } => {
                black_box(data);
                n += u64::from(opcode);
            }
        }
    }
    n
}

/// All of the reader: records, decoding, order of time, alignment.
fn read(path: &Path) -> usize {
    let options = ReadOptions {
        actions: vec!["/command:data".parse().expect("a selector")],
        states: vec!["/joint_states:position".parse().expect("a selector")],
        ..ReadOptions::default()
    };
    let mut reader =
        RecordingReader::open(path, Arc::from("bag"), &options).expect("the bag opens");
    let mut n = 0;
    while !reader.is_done() {
        n += reader.read(u64::MAX).expect("the bag is whole").len();
    }
    n
}

#[divan::bench(args = ["plain", "zstd"])]
fn walk_joint_states(bencher: Bencher<'_, '_>, compression: &str) {
    let path = if compression == "plain" {
        plain()
    } else {
        zstd()
    };
    bencher
        .counter(ItemsCount::new(n_messages()))
        .bench(|| walk(path));
}

#[divan::bench(args = ["plain", "zstd"])]
fn read_joint_states(bencher: Bencher<'_, '_>, compression: &str) {
    let path = if compression == "plain" {
        plain()
    } else {
        zstd()
    };
    bencher
        .counter(ItemsCount::new(n_messages()))
        .bench(|| read(path));
}
