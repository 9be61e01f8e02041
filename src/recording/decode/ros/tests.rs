//! Hand-made messages with known values; random ones are in `random.rs`.

mod random;
mod schemas;
mod writer;

use std::collections::BTreeMap;

use super::super::plan::{Access, Field, Node, Wanted};
use super::super::row::{ABSENT, Row, RowId, is_absent};
use super::super::value::Value;
use super::super::{DecodeError, PlanError};
use super::Ros;
use crate::recording::wire::{Channel, Schema};

fn channel(encoding: &str) -> Channel {
    Channel {
        id: 1,
        schema_id: 1,
        topic: "/t".to_owned(),
        encoding: encoding.to_owned(),
        metadata: BTreeMap::new(),
    }
}

fn schema(name: &str, encoding: &str, text: &str) -> Schema {
    Schema {
        id: 1,
        name: name.to_owned(),
        encoding: encoding.to_owned(),
        data: text.as_bytes().to_vec(),
    }
}

/// A path such as `points[0:2].x`.
fn want(path: &str, field: Field) -> Wanted {
    let mut accesses = Vec::new();
    for part in path.split('.').filter(|part| !part.is_empty()) {
        let (key, items) = part
            .split_once('[')
            .map_or((part, None), |(k, i)| (k, Some(i)));
        accesses.push(Access::Key(key.to_owned()));
        if let Some((start, end)) = items.and_then(|i| i.trim_end_matches(']').split_once(':')) {
            accesses.push(Access::Items(start.parse().unwrap()..end.parse().unwrap()));
        }
    }
    Wanted {
        path: accesses,
        field,
        required: true,
    }
}

fn compile(encoding: &str, schema: &Schema, wanted: &[Wanted]) -> Result<Ros, PlanError> {
    Ros::compile(&channel(encoding), Some(schema), &Node::trees(wanted, None))
}

/// Decodes with a definition of type `p/T`.
fn decode(text: &str, wanted: &[Wanted], data: &[u8]) -> Result<Row, DecodeError> {
    let mut ros = compile("cdr", &schema("p/msg/T", "ros2msg", text), wanted).unwrap();
    let mut row = Row::new(&["action", "state"]);
    ros.decode(data, &mut row)?;
    Ok(row)
}

fn values(text: &str, path: &str, data: &[u8]) -> Result<Vec<f64>, DecodeError> {
    let row = decode(text, &[want(path, Field::Values(0))], data)?;
    Ok(row.targets[0].values.clone())
}

const LE: [u8; 4] = [0, 1, 0, 0];

fn cat(parts: &[&[u8]]) -> Vec<u8> {
    parts.concat()
}

/// Two joints: names of 2 and 4 bytes with their NUL, then 1.5 and -2.5.
fn joint_state(names: [&[u8]; 2]) -> Vec<u8> {
    cat(&[
        &LE,
        &7i32.to_le_bytes(),
        &9u32.to_le_bytes(),
        &1u32.to_le_bytes(),
        &[0, 0xcc, 0xcc, 0xcc],
        &2u32.to_le_bytes(),
        &2u32.to_le_bytes(),
        names[0],
        &[0, 0xcc, 0xcc],
        &4u32.to_le_bytes(),
        names[1],
        &[0],
        &2u32.to_le_bytes(),
        &1.5f64.to_le_bytes(),
        &(-2.5f64).to_le_bytes(),
        // Neither velocity nor effort: an empty sequence is its count alone.
        &0u32.to_le_bytes(),
        &0u32.to_le_bytes(),
    ])
}

fn names(row: &Row) -> Vec<&str> {
    row.targets[0].names.iter().collect()
}

#[test]
fn a_joint_state_without_a_definition_gives_positions_names_and_stamp() {
    let wanted = [
        want("position", Field::Values(0)),
        want("name", Field::Names(0)),
        want("header.stamp.sec", Field::StampSeconds),
        want("header.stamp.nanosec", Field::StampNanos),
    ];
    let of = schema("sensor_msgs/msg/JointState", "ros2msg", "");
    let mut ros = compile("cdr", &of, &wanted).unwrap();
    let mut row = Row::new(&["action"]);
    ros.decode(&joint_state([b"a", b"elb"]), &mut row).unwrap();
    assert_eq!(row.targets[0].values, [1.5, -2.5]);
    assert_eq!(names(&row), ["a", "elb"]);
    assert_eq!(row.stamp(), Some(7_000_000_009));
}

#[test]
fn names_are_remembered_only_while_their_bytes_are_the_same() {
    let of = schema("sensor_msgs/msg/JointState", "", "");
    let mut ros = compile("cdr", &of, &[want("name", Field::Names(0))]).unwrap();
    let mut row = Row::new(&["action"]);
    let mut decode = |names: [&[u8]; 2]| {
        row.clear();
        ros.decode(&joint_state(names), &mut row)?;
        let taken = row.targets[0].names.iter();
        Ok::<_, DecodeError>(taken.map(str::to_owned).collect::<Vec<_>>())
    };
    assert_eq!(decode([b"a", b"elb"]).unwrap(), ["a", "elb"]);
    assert_eq!(decode([b"a", b"elb"]).unwrap(), ["a", "elb"]);
    assert_eq!(decode([b"b", b"elb"]).unwrap(), ["b", "elb"]);
    let error = decode([b"b", b"el\xff"]).unwrap_err();
    assert_eq!(error.to_string(), "not CDR: a text is not UTF-8");
    assert!(decode([b"b", b"el\xff"]).is_err());
    assert_eq!(decode([b"b", b"elb"]).unwrap(), ["b", "elb"]);
}

#[test]
fn eight_bytes_align_to_eight_in_version_1_and_to_four_in_version_2() {
    let text = "uint32 a\nfloat64 b";
    let b = 0.25f64.to_le_bytes();
    let version_1 = cat(&[&LE, &[1, 0, 0, 0], &[0; 4], &b]);
    let version_2 = cat(&[&[0, 7, 0, 0], &[1, 0, 0, 0], &b]);
    let delimited = cat(&[&[0, 9, 0, 0], &[12, 0, 0, 0], &[1, 0, 0, 0], &b]);
    for data in [version_1, version_2, delimited] {
        assert_eq!(values(text, "", &data).unwrap(), [1.0, 0.25]);
    }
    let big = cat(&[
        &[0, 0, 0, 0],
        &[0, 0, 0, 1],
        &[0; 4],
        &0.25f64.to_be_bytes(),
    ]);
    assert_eq!(values(text, "", &big).unwrap(), [1.0, 0.25]);
}

#[test]
fn a_type_that_grew_is_read_as_far_as_it_is_known() {
    let data = cat(&[&[0, 9, 0, 0], &[8, 0, 0, 0], &[5, 0, 0, 0], &[9; 4]]);
    assert_eq!(values("uint32 a", "a", &data).unwrap(), [5.0]);
}

#[test]
fn an_empty_sequence_aligns_nothing_and_an_empty_type_takes_a_byte() {
    let text = "float64[] a\nuint32 b\nE c\nuint8 d\n====\nMSG: p/E\n# nothing\nint8 X=1";
    let data = cat(&[&LE, &[0; 4], &[3, 0, 0, 0], &[0], &[4]]);
    assert_eq!(values(text, "", &data).unwrap(), [3.0, 4.0]);
}

#[test]
fn headers_and_layouts_are_no_leaves_and_texts_are_skipped() {
    let data = cat(&[
        &LE,
        &1u32.to_le_bytes(),
        &2u32.to_le_bytes(),
        b"x\0\xcc\xcc",
        &8u32.to_le_bytes(),
        &9u32.to_le_bytes(),
        &10u32.to_le_bytes(),
        &1u32.to_le_bytes(),
        &2.5f32.to_le_bytes(),
    ]);
    let of = schema("std_msgs/msg/Float32MultiArray", "", "");
    let mut row = Row::new(&["action"]);
    let mut ros = compile("cdr", &of, &[want("", Field::Values(0))]).unwrap();
    ros.decode(&data, &mut row).unwrap();
    assert_eq!(row.targets[0].values, [2.5]);
    let refused = compile("cdr", &of, &[want("layout", Field::Values(0))]).unwrap_err();
    assert!(
        refused.to_string().contains("holds no numbers"),
        "{refused}"
    );
}

#[test]
fn elements_are_picked_of_numbers_bytes_and_structs() {
    let text = "float64[] data\nuint8[4] raw\nP[] ps\n===\nMSG: p/P\nuint8 x\nstring n";
    let data = cat(&[
        &LE,
        &3u32.to_le_bytes(),
        &[0; 4],
        &1.0f64.to_le_bytes(),
        &2.0f64.to_le_bytes(),
        &3.0f64.to_le_bytes(),
        &[5, 6, 7, 8],
        &2u32.to_le_bytes(),
        &[40, 0, 0, 0, 2, 0, 0, 0, b'u', 0],
        &[41, 0, 2, 0, 0, 0, b'v', 0],
    ]);
    assert_eq!(values(text, "data[1:9]", &data).unwrap(), [2.0, 3.0]);
    assert_eq!(values(text, "raw[1:3]", &data).unwrap(), [6.0, 7.0]);
    assert_eq!(values(text, "ps[1:2].x", &data).unwrap(), [41.0]);
    assert_eq!(values(text, "ps.x", &data).unwrap(), [40.0, 41.0]);
    let wanted = [
        want("ps.n", Field::Names(0)),
        want("ps.x", Field::Values(0)),
        want("data[2:3]", Field::Reward),
        want("raw[0:1]", Field::Step),
        want("ps[1:2].n", Field::Episode { rank: 0 }),
    ];
    let row = decode(text, &wanted, &data).unwrap();
    assert_eq!(names(&row), ["u", "v"]);
    assert_eq!((row.reward, row.step), (Some(3.0), Some(5)));
    assert_eq!((row.id, row.id_text.as_str()), (RowId::Text, "v"));
    let missing = |path, field| decode(text, &[want(path, field)], &data).unwrap_err();
    assert_eq!(
        missing("data[3:4]", Field::Reward),
        DecodeError::Missing("reward")
    );
    assert_eq!(
        missing("ps[2:3].x", Field::Step),
        DecodeError::Missing("step")
    );
}

#[test]
fn numbers_are_exact_where_they_can_be() {
    let text = "bool a\nint8 b\nuint64 c\nfloat32 d\nbyte e";
    let data = cat(&[
        &LE,
        &[7, 0xff, 0, 0, 0, 0, 0, 0],
        &[0xff; 8],
        &0.1f32.to_le_bytes(),
        &[200],
    ]);
    let expected = [
        1.0,
        -1.0,
        18_446_744_073_709_551_616.0,
        f64::from(0.1f32),
        200.0,
    ];
    assert_eq!(values(text, "", &data).unwrap(), expected);
    let row = decode(text, &[want("a", Field::EndFlag)], &data).unwrap();
    assert!(row.ended);
}

#[test]
fn a_nan_with_the_bits_of_an_absent_value_is_refused_as_any_other() {
    let data = cat(&[&LE, &ABSENT.to_le_bytes()]);
    let mut row = decode("float64 a", &[want("a", Field::Values(0))], &data).unwrap();
    assert!(!is_absent(row.targets[0].values[0]));
    row.targets.truncate(1);
    assert_eq!(row.check(), Err(DecodeError::NotFinite("action")));
}

#[test]
fn wide_texts_are_skipped_and_refused_if_they_are_of_two_bytes_in_version_1() {
    let text = "wstring w\nuint8 x";
    let four = cat(&[&LE, &[1, 0, 0, 0], &[0x61, 0, 0, 0], &[9]]);
    assert_eq!(values(text, "x", &four).unwrap(), [9.0]);
    let two = cat(&[&[0, 7, 0, 0], &[2, 0, 0, 0], &[0x61, 0], &[9]]);
    assert_eq!(values(text, "x", &two).unwrap(), [9.0]);
    let wrong = cat(&[&LE, &[2, 0, 0, 0], &[0x61, 0, 0x62, 0], &[9; 5]]);
    let error = values(text, "x", &wrong).unwrap_err();
    assert!(error.to_string().contains("wstring"), "{error}");
}

#[test]
fn ros_1_has_no_padding_and_its_own_times_bytes_and_header() {
    let text = "Header header\nbyte b\nchar c\nduration d\n===\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id";
    let data = cat(&[
        &[1, 0, 0, 0],
        &3_000_000_000u32.to_le_bytes(),
        &[5, 0, 0, 0],
        &[1, 0, 0, 0, b'f'],
        &[0xff, 0xff],
        &(-1i32).to_le_bytes(),
        &[0; 4],
    ]);
    let of = schema("p/T", "ros1msg", text);
    let wanted = [
        want("", Field::Values(0)),
        want("header.stamp.secs", Field::StampSeconds),
        want("header.stamp.nanosec", Field::StampNanos),
    ];
    let mut row = Row::new(&["action"]);
    let mut ros = compile("ros1", &of, &wanted).unwrap();
    ros.decode(&data, &mut row).unwrap();
    assert_eq!(row.targets[0].values, [-1.0, 255.0, -1.0, 0.0]);
    assert_eq!(row.stamp(), Some(3_000_000_000_000_000_005));
    let value = super::value(&channel("ros1"), Some(&of), &data).unwrap();
    assert_eq!(value.get("b"), Some(&Value::Integer(-1)));
    let left = ros.decode(&[&data[..], &[0]].concat(), &mut row);
    assert!(left.unwrap_err().to_string().contains("left behind"));
}

#[test]
fn lengths_that_lie_are_errors_and_allocate_nothing() {
    let many = [0xff; 4];
    let rest = [0; 32];
    for text in ["float64[] a", "p/P[] a\n===\nMSG: p/P\nuint8 x\nstring y"] {
        let error = values(text, "a", &cat(&[&LE, &many, &rest])).unwrap_err();
        let text = "not CDR: it ends inside a field, or its schema is another";
        assert_eq!(error.to_string(), text);
    }
    for text in [
        "string[] s\nuint8 a",
        "wstring[] s\nuint8 a",
        "string s\nuint8 a",
    ] {
        assert!(values(text, "a", &cat(&[&LE, &many, &rest])).is_err());
    }
    let fixed =
        "float64[4294967295] s\nP[4294967295] t\nuint8 a\n===\nMSG: p/P\nfloat64[4294967295] x";
    assert!(values(fixed, "a", &cat(&[&LE, &rest])).is_err());
    assert!(values(fixed, "t", &cat(&[&LE, &rest])).is_err());
}

#[test]
fn elements_without_a_byte_cost_nothing_however_many_they_are_said_to_be() {
    let text = "E[] e\nE[4000000000] f\nuint8 a\n===\nMSG: p/E\nint8 X=1";
    let of = schema("p/T", "ros1msg", text);
    let data = [0xff, 0xff, 0xff, 0xff, 3];
    let mut ros = compile("ros1", &of, &[want("a", Field::Values(0))]).unwrap();
    let mut row = Row::new(&["action"]);
    ros.decode(&data, &mut row).unwrap();
    assert_eq!(row.targets[0].values, [3.0]);
    assert!(super::value(&channel("ros1"), Some(&of), &data).is_ok());
}

#[test]
fn representations_that_are_not_read_are_refused_by_name() {
    let refused = |header: &[u8]| values("uint8 a", "a", header).unwrap_err().to_string();
    for id in [0x02, 0x03, 0x0a, 0x0b] {
        assert!(refused(&[0, id, 0, 0, 1]).contains("PL_CDR"));
    }
    assert!(refused(&[0, 4, 0, 0, 1]).contains("no representation"));
    assert!(refused(&[0, 1, 0]).contains("shorter than its header"));
    assert!(refused(&[0, 1, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9]).contains("left behind"));
}
