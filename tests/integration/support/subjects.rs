//! Good recordings for the sweeps to break: each layout that writers make, each small enough to be broken at every byte.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use prost_reflect::prost::Message as _;
use prost_reflect::prost_types::field_descriptor_proto::{Label, Type};
use prost_reflect::prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet,
};

use super::recording_builder::{Layout, STEP_NANOS, step_message};

/// A good recording and what the sweeps must know of it.
#[derive(Debug, Clone)]
pub(crate) struct Subject {
    pub(crate) name: &'static str,
    pub(crate) bytes: Vec<u8>,
    /// Channel of the messages that are steps.
    pub(crate) clock: u16,
    /// Every value is covered by the CRC of its chunk: what is read is right.
    pub(crate) has_chunk_crcs: bool,
    /// An episode that is whole when a cut comes after its last step; else any cut may have cost it steps.
    pub(crate) ends_by_flag: bool,
}

const N_STEPS: [usize; 2] = [11, 9];

/// All of them.
pub(crate) fn all() -> Vec<Subject> {
    let layout = |compression, chunked, summary| Layout {
        compression,
        chunked,
        summary,
        chunk_size: 700,
    };
    let zstd = Some(Compression::Zstd);
    let lz4 = Some(Compression::Lz4);
    vec![
        json("json, zstd", layout(zstd, true, true)),
        json("json, lz4, no summary", layout(lz4, true, false)),
        json("json, chunked plain", layout(None, true, true)),
        json("json, unchunked", layout(None, false, true)),
        json("json, unchunked, no summary", layout(None, false, false)),
        two_topics("cdr, two topics, zstd", layout(zstd, true, true)),
        two_topics("cdr, two topics, unchunked", layout(None, false, true)),
        protobuf("protobuf, lz4", layout(lz4, true, true)),
    ]
}

/// One chunk of several zstd or LZ4 blocks, so that a cut inside it leaves whole blocks.
pub(crate) fn large_chunk(compression: Option<Compression>) -> Subject {
    let mut subject = json_of(
        "json, one large chunk",
        Layout {
            compression,
            chunked: true,
            summary: true,
            chunk_size: 64 << 20,
        },
        &[1500, 1200],
    );
    subject.name = match compression {
        Some(Compression::Zstd) => "json, one large zstd chunk",
        Some(_) => "json, one large lz4 chunk",
        None => "json, one large plain chunk",
    };
    subject
}

struct Builder {
    writer: Writer<Cursor<Vec<u8>>>,
    n: u64,
}

impl Builder {
    fn new(layout: Layout) -> Self {
        let options = WriteOptions::new()
            .compression(layout.compression)
            .use_chunks(layout.chunked)
            .chunk_size(Some(layout.chunk_size))
            .emit_summary_records(layout.summary)
            .emit_summary_offsets(layout.summary);
        Self {
            writer: options.create(Cursor::new(Vec::new())).unwrap(),
            n: 0,
        }
    }

    fn channel(&mut self, topic: &str, encoding: &str, schema: (&str, &str, &[u8])) -> u16 {
        let (name, kind, data) = schema;
        let id = self.writer.add_schema(name, kind, data).unwrap();
        self.writer
            .add_channel(id, topic, encoding, &BTreeMap::new())
            .unwrap()
    }

    fn write(&mut self, channel_id: u16, data: &[u8]) {
        let time = self.n * STEP_NANOS;
        let header = MessageHeader {
            channel_id,
            sequence: self.n as u32,
            log_time: time,
            publish_time: time,
        };
        self.n += 1;
        self.writer.write_to_known_channel(&header, data).unwrap();
    }

    fn finish(mut self) -> Vec<u8> {
        self.writer.finish().unwrap();
        self.writer.into_inner().into_inner()
    }
}

fn json(name: &'static str, layout: Layout) -> Subject {
    json_of(name, layout, &N_STEPS)
}

fn json_of(name: &'static str, layout: Layout, n_steps: &[usize]) -> Subject {
    let mut b = Builder::new(layout);
    b.writer
        .write_metadata(&mcap::records::Metadata {
            name: "recording".to_owned(),
            metadata: BTreeMap::from([("env_id".to_owned(), "Test-v0".to_owned())]),
        })
        .unwrap();
    let clock = b.channel("/step", "json", ("Step", "jsonschema", b"{}"));
    for (episode, &n) in n_steps.iter().enumerate() {
        for step in 0..n {
            let message = step_message(episode as i64, step, step + 1 == n);
            b.write(clock, message.to_string().as_bytes());
        }
    }
    Subject {
        name,
        bytes: b.finish(),
        clock,
        has_chunk_crcs: layout.chunked,
        ends_by_flag: true,
    }
}

/// `sensor_msgs/JointState` as state, `std_msgs/Float64MultiArray` as action.
fn two_topics(name: &'static str, layout: Layout) -> Subject {
    let mut b = Builder::new(layout);
    let joint_state: &[u8] = b"std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort";
    let array: &[u8] = b"std_msgs/MultiArrayLayout layout\nfloat64[] data";
    let state = b.channel(
        "/joint_states",
        "cdr",
        ("sensor_msgs/msg/JointState", "ros2msg", joint_state),
    );
    let clock = b.channel(
        "/commands",
        "cdr",
        ("std_msgs/msg/Float64MultiArray", "ros2msg", array),
    );
    for step in 0..24 {
        let x = f64::from(step);
        b.write(
            state,
            &joint_state_cdr(&["shoulder", "elbow"], &[(x * 0.37).sin(), x * 0.01]),
        );
        let action = if (step / 7) % 2 == 0 { 0.25 } else { 1.5 };
        b.write(clock, &multi_array_cdr(&[action, x]));
    }
    Subject {
        name,
        bytes: b.finish(),
        clock,
        has_chunk_crcs: layout.chunked,
        ends_by_flag: false,
    }
}

fn protobuf(name: &'static str, layout: Layout) -> Subject {
    let mut b = Builder::new(layout);
    let set = step_descriptor();
    let clock = b.channel("/step", "protobuf", ("test.Step", "protobuf", &set));
    for (episode, n) in N_STEPS.into_iter().enumerate() {
        for step in 0..n {
            let x = step as f64;
            let state = [(x * 0.37).sin(), x * 0.01];
            b.write(clock, &step_protobuf(episode, step, &state, step + 1 == n));
        }
    }
    Subject {
        name,
        bytes: b.finish(),
        clock,
        has_chunk_crcs: layout.chunked,
        ends_by_flag: true,
    }
}

/// `message Step { int64 episode = 1; int64 step = 2; repeated double action = 3, state = 4; bool terminated = 5; }`
pub(crate) fn step_descriptor() -> Vec<u8> {
    let field = |name: &str, number, kind: Type, label: Label| FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        r#type: Some(kind.into()),
        label: Some(label.into()),
        ..FieldDescriptorProto::default()
    };
    let file = FileDescriptorProto {
        name: Some("step.proto".to_owned()),
        package: Some("test".to_owned()),
        syntax: Some("proto3".to_owned()),
        message_type: vec![DescriptorProto {
            name: Some("Step".to_owned()),
            field: vec![
                field("episode", 1, Type::Int64, Label::Optional),
                field("step", 2, Type::Int64, Label::Optional),
                field("action", 3, Type::Double, Label::Repeated),
                field("state", 4, Type::Double, Label::Repeated),
                field("terminated", 5, Type::Bool, Label::Optional),
            ],
            ..DescriptorProto::default()
        }],
        ..FileDescriptorProto::default()
    };
    FileDescriptorSet { file: vec![file] }.encode_to_vec()
}

/// One `test.Step`, by hand.
pub(crate) fn step_protobuf(episode: usize, step: usize, state: &[f64], last: bool) -> Vec<u8> {
    let doubles = |bytes: &mut Vec<u8>, tag: u8, values: &[f64]| {
        bytes.extend([tag, (8 * values.len()) as u8]);
        bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    };
    let mut bytes = vec![0x08, episode as u8, 0x10, step as u8];
    doubles(&mut bytes, 0x1a, &[f64::from((step / 4 % 2) as u8)]);
    doubles(&mut bytes, 0x22, state);
    bytes.extend([0x28, u8::from(last)]);
    bytes
}

/// Writes CDR, little-endian, aligned as XCDR1 wants it.
#[derive(Default)]
struct Cdr(Vec<u8>);

impl Cdr {
    fn align(&mut self, to: usize) -> &mut Self {
        while !self.0.len().is_multiple_of(to) {
            self.0.push(0);
        }
        self
    }

    fn u32(&mut self, value: u32) -> &mut Self {
        self.align(4).0.extend(value.to_le_bytes());
        self
    }

    fn string(&mut self, text: &str) -> &mut Self {
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
        self
    }

    fn doubles(&mut self, values: &[f64]) -> &mut Self {
        self.u32(values.len() as u32);
        if !values.is_empty() {
            self.align(8);
        }
        self.0.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        self
    }

    fn message(&self) -> Vec<u8> {
        [&[0, 1, 0, 0], self.0.as_slice()].concat()
    }
}

/// A `sensor_msgs/JointState` with positions alone.
pub(crate) fn joint_state_cdr(names: &[&str], position: &[f64]) -> Vec<u8> {
    let mut cdr = Cdr::default();
    cdr.u32(0).u32(0).string("").u32(names.len() as u32);
    for name in names {
        cdr.string(name);
    }
    cdr.doubles(position).doubles(&[]).doubles(&[]).message()
}

/// A `std_msgs/Float64MultiArray` without dimensions.
pub(crate) fn multi_array_cdr(values: &[f64]) -> Vec<u8> {
    Cdr::default().u32(0).u32(0).doubles(values).message()
}
