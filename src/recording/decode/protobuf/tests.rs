//! Plans are held against `DynamicMessage` on random messages, and against bytes written by hand.

mod hostile;
mod random;
mod support;

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use prost_reflect::prost_types::field_descriptor_proto::{Label, Type as Kind};
use prost_reflect::prost_types::{FieldDescriptorProto, FileDescriptorProto};

use super::super::plan::Field;
use super::super::row::{ABSENT, Row, RowId};
use super::super::value::Value;
use super::schema::Type;
use crate::recording::decode::{DecodeError, PlanError};
use random::{Entropy, bytes, tag, varint};
use support::*;

/// Paths of [`step_schema`] that give values.
const PATHS: [&str; 19] = [
    "action",
    "joints",
    "joints.x",
    "joints.y",
    "joints.z",
    "joints.deep",
    "joints.deep.f4",
    "pose",
    "pose.x",
    "pose.y",
    "pose.z",
    "a",
    "b",
    "b.x",
    "pixels",
    "one",
    "many",
    "many.f1",
    "parent.joints.x",
];

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(7),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

fn same(a: &[f64], b: &[f64]) -> bool {
    let is_same = |(a, b): (&f64, &f64)| {
        a.to_bits() == b.to_bits()
            || (a.is_nan()
                && b.is_nan()
                && a.to_bits() != ABSENT.to_bits()
                && b.to_bits() != ABSENT.to_bits())
    };
    a.len() == b.len() && a.iter().zip(b).all(is_same)
}

#[test]
fn plans_read_what_the_library_reads_whatever_the_order() {
    let schema = step_schema();
    let root = Type::of(Some(&schema)).unwrap();
    let plans = PATHS.map(|text| {
        let plan = plan(&schema, &[want(text, Field::Values(0), true)]).unwrap();
        (text, plan)
    });
    let entropy = prop::collection::vec(any::<u8>(), 0..400);
    let mut runner = proptest::test_runner::TestRunner::new(config(600));
    let check = |(entropy, tidy): (Vec<u8>, bool)| {
        let data = random::message(&root.message, tidy, 4, &mut Entropy(entropy.iter()));
        let message = reflected(&schema, &data).expect("a message that the library reads");
        for (text, plan) in &plans {
            let keys: Vec<&str> = text.split('.').collect();
            let mut expected = Vec::new();
            let expected = oracle(&message, &keys, false, &mut expected).map(|()| expected);
            let found = match values(plan, &data) {
                Err(DecodeError::Missing(_)) => None,
                other => other.unwrap(),
            };
            let is_same = match (&found, &expected) {
                (Some(found), Some(expected)) => same(found, expected),
                (found, expected) => found == expected,
            };
            prop_assert!(
                is_same,
                "{text}: {found:?}, not {expected:?}, of {data:02x?}"
            );
        }
        Ok(())
    };
    runner.run(&(entropy, any::<bool>()), check).unwrap();
}

/// A step as a common writer has it: `action`, `episode`, `step`, `reward`, `terminated`.
fn step_bytes() -> Vec<u8> {
    let mut out = Vec::new();
    let action: Vec<u8> = [1.5f64, -2.0, 0.1]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    bytes(4, &action, &mut out);
    tag(1, 0, &mut out);
    varint(12, &mut out);
    tag(2, 0, &mut out);
    varint(6, &mut out); // zigzag of 3
    tag(11, 0, &mut out);
    varint(1, &mut out);
    tag(104, 5, &mut out);
    out.extend(0.5f32.to_le_bytes());
    out
}

fn step_plan() -> super::Plan {
    let wanted = [
        want("action", Field::Values(0), true),
        want("episode", Field::Episode { rank: 0 }, false),
        want("episode_id", Field::Episode { rank: 1 }, false),
        want("step", Field::Step, false),
        want("reward", Field::Reward, false),
        want("terminated", Field::EndFlag, false),
        want("action", Field::EndFlag, false),
    ];
    plan(&step_schema(), &wanted).unwrap()
}

#[test]
fn a_step_fills_its_row() {
    let mut row = Row::new(&["action"]);
    step_plan().decode(&step_bytes(), &mut row).unwrap();
    assert_eq!(row.targets[0].values, [1.5, -2.0, 0.1]);
    assert_eq!((row.id, row.step), (RowId::Integer(12), Some(3)));
    assert_eq!(
        (row.reward, row.ended, row.has_end_flag),
        (Some(0.5), true, true)
    );
    row.check().unwrap();
}

#[test]
fn what_a_message_leaves_out_has_its_default() {
    let mut row = Row::new(&["action"]);
    step_plan().decode(&[], &mut row).unwrap();
    assert_eq!((row.id, row.step), (RowId::Integer(0), Some(0)));
    assert_eq!(
        (row.reward, row.ended, row.has_end_flag),
        (Some(0.0), false, true)
    );
    assert!(row.targets[0].found);
    assert_eq!(row.check(), Err(DecodeError::Empty("action")));
}

#[test]
fn ranges_pick_elements_across_pieces_of_an_array() {
    let schema = step_schema();
    let mut data = Vec::new();
    let doubles = |values: &[f64]| {
        values
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    bytes(4, &doubles(&[0.0, 1.0, 2.0]), &mut data);
    tag(4, 1, &mut data);
    data.extend(3f64.to_le_bytes());
    bytes(4, &doubles(&[4.0, 5.0]), &mut data);
    bytes(12, &[10, 20, 30], &mut data);
    let wanted = [
        want("action[4:9]", Field::Values(0), true),
        want("action[1:4]", Field::Values(0), true),
        want("pixels[1:5]", Field::Values(1), true),
    ];
    let mut row = Row::new(&["action", "state"]);
    plan(&schema, &wanted)
        .unwrap()
        .decode(&data, &mut row)
        .unwrap();
    assert_eq!(row.targets[0].values, [1.0, 2.0, 3.0, 4.0, 5.0]);
    assert_eq!(row.targets[1].values, [20.0, 30.0]);
}

#[test]
fn names_and_values_of_an_array_of_structs_stay_parallel() {
    let schema = step_schema();
    let mut data = Vec::new();
    let mut joint = Vec::new();
    bytes(4, b"elbow", &mut joint);
    tag(2, 5, &mut joint);
    joint.extend(0.25f32.to_le_bytes());
    bytes(3, &joint, &mut data);
    bytes(3, &[0x22, 1, b'w'], &mut data);
    let wanted = [
        want("joints.y", Field::Values(0), true),
        want("joints.name", Field::Names(0), true),
    ];
    let mut row = Row::new(&["state"]);
    plan(&schema, &wanted)
        .unwrap()
        .decode(&data, &mut row)
        .unwrap();
    assert!(same(&row.targets[0].values, &[0.25, ABSENT]));
    assert_eq!(
        row.targets[0].names.iter().collect::<Vec<_>>(),
        ["elbow", "w"]
    );
}

#[test]
fn a_nan_never_passes_for_a_value_that_is_absent() {
    let mut data = Vec::new();
    bytes(4, &ABSENT.to_le_bytes(), &mut data);
    tag(4, 1, &mut data);
    data.extend(ABSENT.to_le_bytes());
    let mut row = Row::new(&["action"]);
    step_plan().decode(&data, &mut row).unwrap();
    assert_eq!(row.check(), Err(DecodeError::NotFinite("action")));
}

#[test]
fn a_required_field_of_a_message_may_be_missing() {
    let schema = step_schema();
    let mut row = Row::new(&["action"]);
    for (text, field) in [
        ("a", Field::Reward),
        ("c", Field::Episode { rank: 0 }),
        ("b.x", Field::Values(0)),
        ("names[2:3]", Field::Episode { rank: 0 }),
    ] {
        let plan = plan(&schema, &[want(text, field, true)]).unwrap();
        let found = plan.decode(&[], &mut row);
        assert_eq!(found, Err(DecodeError::Missing(row.label(field))), "{text}");
    }
}

#[track_caller]
fn refused(text: &str, field: Field, expected: &str) {
    let found = plan(&step_schema(), &[want(text, field, true)]).unwrap_err();
    assert_eq!(found, PlanError::Path(expected.to_owned()));
    plan(&step_schema(), &[want(text, field, false)]).unwrap();
}

#[test]
fn a_path_that_the_schema_cannot_serve_is_told_in_one_line() {
    let values = Field::Values(0);
    refused(
        "pose.w",
        values,
        "t.Inner has no field \"w\": it has name, x, y, z, deep",
    );
    refused(
        "action.x",
        values,
        "t.Step.action is repeated double, which has no fields",
    );
    refused(
        "episode[0:1]",
        values,
        "t.Step.episode is int32, which has no elements",
    );
    refused("pose[0:1]", values, "t.Inner is a message, not an array");
    refused(
        "names",
        values,
        "t.Step.names is repeated string, which is not what is wanted of it",
    );
    refused(
        "table",
        values,
        "t.Step.table is a map, whose entries have no order: its numbers cannot be taken",
    );
    refused(
        "table.value",
        values,
        "t.Step.table is a map, whose entries have no order: its numbers cannot be taken",
    );
    refused(
        "parent",
        values,
        "t.Step.table is a map, whose entries have no order: its numbers cannot be taken",
    );
    refused(
        "pose",
        Field::Reward,
        "t.Inner is a message: name a field of it",
    );
    refused(
        "action",
        Field::Reward,
        "t.Step.action is an array: name one of its elements",
    );
    refused(
        "reward",
        Field::Step,
        "t.Step.reward is float, which is not what is wanted of it",
    );
}

#[test]
fn headers_are_no_values_and_stamps_are_messages() {
    let outer = schema("t.Outer", vec![step_file()]);
    let mut data = Vec::new();
    bytes(1, &[0x10, 5], &mut data);
    tag(2, 1, &mut data);
    data.extend(2.5f64.to_le_bytes());
    let root = super::super::plan::Wanted {
        path: Vec::new(),
        field: Field::Values(0),
        required: true,
    };
    let found = values(&plan(&outer, &[root]).unwrap(), &data).unwrap();
    assert_eq!(found, Some(vec![2.5]));

    let wanted = [
        want("stamp.seconds", Field::StampSeconds, false),
        want("stamp.nanos", Field::StampNanos, false),
    ];
    let mut row = Row::new(&[]);
    let mut data = Vec::new();
    bytes(103, &[8, 2, 16, 7], &mut data);
    plan(&step_schema(), &wanted)
        .unwrap()
        .decode(&data, &mut row)
        .unwrap();
    assert_eq!(row.stamp(), Some(2_000_000_007));
}

#[test]
fn proto2_has_defaults_of_its_own_required_fields_and_groups() {
    let labelled = |label: Label, field: FieldDescriptorProto| FieldDescriptorProto {
        label: Some(label.into()),
        ..field
    };
    let with = |text: &str, field: FieldDescriptorProto| FieldDescriptorProto {
        default_value: Some(text.to_owned()),
        ..field
    };
    let old = FileDescriptorProto {
        syntax: None,
        ..file(
            "old.proto",
            "",
            "",
            vec![
                message(
                    "Old",
                    &[],
                    vec![
                        with("1.5", field("gain", 1, Kind::Double)),
                        labelled(Label::Required, field("must", 2, Kind::Int32)),
                        of_type("part", 3, Kind::Group, ".Part"),
                        with("left", field("side", 4, Kind::String)),
                    ],
                ),
                message("Part", &[], vec![field("v", 1, Kind::Double)]),
            ],
        )
    };
    let schema = schema("Old", vec![old]);
    let read = |text: &str, data: &[u8]| {
        values(
            &plan(&schema, &[want(text, Field::Values(0), true)]).unwrap(),
            data,
        )
    };
    assert_eq!(read("gain", &[]), Ok(Some(vec![1.5])));
    assert_eq!(read("must", &[]), Err(DecodeError::Missing("action")));
    // A group is skipped, whatever is in it.
    assert_eq!(
        read("must", &[0x1b, 0x08, 1, 0x1c, 0x10, 4]),
        Ok(Some(vec![4.0]))
    );
    assert!(
        matches!(plan(&schema, &[want("part.v", Field::Values(0), true)]), Err(PlanError::Path(text)) if text == "Old.part is a group")
    );
    let mut row = Row::new(&[]);
    plan(&schema, &[want("side", Field::Episode { rank: 0 }, true)])
        .unwrap()
        .decode(&[], &mut row)
        .unwrap();
    assert_eq!((row.id, row.id_text.as_str()), (RowId::Text, "left"));
}

#[test]
fn a_value_has_its_members_as_declared_and_null_for_what_is_not_there() {
    let Value::Map(members) = super::value(Some(&step_schema()), &step_bytes()).unwrap() else {
        panic!("an object")
    };
    let names: Vec<&str> = members.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(&names[..5], ["action", "episode", "step", "joints", "pose"]);
    assert_eq!(
        members[0].1,
        Value::List([1.5, -2.0, 0.1].map(Value::Number).into())
    );
    assert_eq!(
        (&members[2].1, &members[4].1),
        (&Value::Integer(3), &Value::Null)
    );
}
