//! The schema and the message are `flatc`'s, see `tests/data/README.md`.

use super::*;
use crate::recording::decode::ABSENT;
use crate::recording::decode::plan::Access;
use crate::recording::decode::test_support::{damaged, map, push_leaves, wanted};

const BFBS: &[u8] = include_bytes!("../../../../tests/data/robot.bfbs");
const MESSAGE: &[u8] = include_bytes!("../../../../tests/data/robot.bin");

fn schema(data: &[u8]) -> Schema {
    Schema {
        id: 1,
        name: "demo.Step".to_owned(),
        encoding: "flatbuffer".to_owned(),
        data: data.to_vec(),
    }
}

fn decode(wanted: &[Wanted], message: &[u8]) -> Result<Row, String> {
    let plan = Plan::compile(Some(&schema(BFBS)), wanted).map_err(|e| e.to_string())?;
    let mut row = Row::new(&["action", "state"]);
    plan.decode(message, &mut row).map_err(|e| e.to_string())?;
    Ok(row)
}

fn values(path: &[&str]) -> Result<Vec<f64>, String> {
    let mut row = decode(&[wanted(path, Field::Values(0))], MESSAGE)?;
    Ok(row.targets.remove(0).values)
}

#[track_caller]
fn check(path: &[&str], expected: &[f64]) {
    assert_eq!(values(path).as_deref(), Ok(expected), "{path:?}");
}

#[track_caller]
fn refused(path: &[&str], expected: &str) {
    assert_eq!(values(path), Err(expected.to_owned()), "{path:?}");
}

fn message() -> Value {
    value(Some(&schema(BFBS)), MESSAGE).unwrap().unwrap()
}

#[test]
fn numbers_of_tables_structs_and_vectors() {
    check(&["action"], &[0.5, -1.5, 2.25]);
    check(&["state"], &[1.0, 2.0, 3.0]);
    check(&["state", "values"], &[1.0, 2.0, 3.0]);
    check(&["pose"], &[0.1, 0.5, -3.0, 1.0, 1.0, 2.0, 3.0, 4.0]);
    check(&["pose", "quat"], &[1.0, 2.0, 3.0, 4.0]);
    check(&["poses", "at", "x"], &[1.0, 8.0]);
    check(
        &["poses", "quat"],
        &[4.0, 5.0, 6.0, 7.0, 11.0, 12.0, 13.0, 14.0],
    );
    check(&["raw"], &[1.0, 2.0, 255.0]);
    check(&["flags"], &[1.0, 0.0]);
    check(&["ints"], &[-1.0, 2_147_483_647.0]);
    check(&["next", "action"], &[9.0]);
}

#[test]
fn a_field_that_is_not_set_is_its_default_or_absent() {
    check(&["mode"], &[3.0]);
    check(&["joints", "limit"], &[2.5, 2.5, 7.5]);
    let positions = values(&["joints", "position"]).unwrap();
    assert_eq!(positions[1].to_bits(), ABSENT.to_bits());
    assert_eq!((positions[0], positions[2]), (0.25, -3.0));
    refused(&["joints"], "a field inside action is not set");
    refused(&["next", "state"], "action is missing");
    refused(&["next", "next", "action"], "action is missing");
}

#[test]
fn ranges_pick_elements() {
    for (field, expected) in [("action", [-1.5, 2.25]), ("raw", [2.0, 255.0])] {
        let mut want = wanted(&[field], Field::Values(0));
        want.path.push(Access::Items(1..9));
        let row = decode(&[want], MESSAGE).unwrap();
        assert_eq!(row.targets[0].values, expected);
    }
    let mut want = wanted(&["poses"], Field::Values(0));
    want.path.push(Access::Items(1..2));
    want.path.push(Access::Key("at".to_owned()));
    let row = decode(&[want], MESSAGE).unwrap();
    assert_eq!(row.targets[0].values, [8.0, 9.0, 10.0]);
}

#[test]
fn fields_that_are_no_vectors() {
    let wanted = [
        wanted(&["episode"], Field::Episode { rank: 0 }),
        wanted(&["step"], Field::Step),
        wanted(&["reward"], Field::Reward),
        wanted(&["done"], Field::EndFlag),
        wanted(&["header", "stamp", "sec"], Field::StampSeconds),
        wanted(&["header", "stamp", "nanosec"], Field::StampNanos),
        wanted(&["joints", "name"], Field::Names(0)),
        wanted(&["names"], Field::Names(1)),
    ];
    let row = decode(&wanted, MESSAGE).unwrap();
    assert_eq!(row.id_text, "e1");
    assert_eq!(
        (row.step, row.reward, row.ended),
        (Some(9), Some(-0.75), true)
    );
    assert_eq!(row.stamp(), Some(5_000_000_007));
    let names = |i: usize| row.targets[i].names.iter().collect::<Vec<_>>();
    assert_eq!((names(0), names(1)), (vec!["a", "b", "c"], vec!["p", "q"]));
}

#[test]
fn what_the_schema_lacks_is_said_when_it_is_compiled() {
    refused(
        &["state", "velues"],
        "demo.FloatArray has no field \"velues\"; it has values",
    );
    refused(
        &["action", "x"],
        "field \"action\" of demo.Step is no table",
    );
    refused(
        &["episode"],
        "field \"episode\" of demo.Step holds no numbers",
    );
    refused(&["extra"], "field \"extra\" of demo.Step holds no numbers");
    refused(
        &["next"],
        "field \"next\" of demo.Step is of a type that holds itself: name the fields in it that are wanted",
    );
    assert!(
        values(&["old"])
            .unwrap_err()
            .contains("has no field \"old\"")
    );
    let optional = |path: &[&str], field| Wanted {
        required: false,
        ..wanted(path, field)
    };
    let wanted = [
        wanted(&["action"], Field::Values(0)),
        optional(&["nothing"], Field::Step),
        optional(&["episode", "x"], Field::Step),
        optional(&["names"], Field::Reward),
    ];
    assert_eq!(decode(&wanted, MESSAGE).unwrap().step, None);
}

#[test]
fn a_schema_that_cannot_be_used_is_refused() {
    let compile = |schema| Plan::compile(schema, &[]).unwrap_err().to_string();
    assert!(compile(None).contains("must have one"));
    let other_table = Schema {
        name: "demo.Nothing".to_owned(),
        ..schema(BFBS)
    };
    assert!(compile(Some(&other_table)).contains("no table of that name"));
    let short_name = Schema {
        name: "Joint".to_owned(),
        ..schema(BFBS)
    };
    assert!(Plan::compile(Some(&short_name), &[]).is_ok());
}

#[test]
fn people_see_all_fields_in_the_order_of_their_ids() {
    let message = message();
    let Value::Map(members) = &message else {
        panic!("a table is an object")
    };
    let names: Vec<&str> = members.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names[..4], ["header", "episode", "step", "action"]);
    let pose = map([
        (
            "at",
            map([
                ("x", Value::Number(0.1)),
                ("y", Value::Number(0.5)),
                ("z", Value::Integer(-3)),
            ]),
        ),
        ("ok", Value::Bool(true)),
        (
            "quat",
            Value::List((1..5).map(|n| Value::Number(f64::from(n))).collect()),
        ),
    ]);
    assert_eq!(message.get("pose"), Some(&pose));
    assert_eq!(message.get("raw"), Some(&Value::Bytes(vec![1, 2, 255])));
    assert_eq!(message.get("extra"), Some(&Value::Null));
    for field in ["action", "state", "poses", "pose", "raw", "flags", "ints"] {
        let mut leaves = Vec::new();
        push_leaves(message.get(field).unwrap(), &mut leaves);
        check(&[field], &leaves);
    }
}

fn all_wanted() -> Vec<Wanted> {
    vec![
        wanted(&["action"], Field::Values(0)),
        wanted(&["joints", "position"], Field::Values(1)),
        wanted(&["joints", "name"], Field::Names(1)),
        wanted(&["poses"], Field::Values(0)),
        wanted(&["pose"], Field::Values(1)),
        wanted(&["episode"], Field::Episode { rank: 0 }),
        wanted(&["step"], Field::Step),
        wanted(&["names"], Field::Names(0)),
    ]
}

#[test]
fn damage_is_an_error_or_another_value() {
    let schema = schema(BFBS);
    let plan = Plan::compile(Some(&schema), &all_wanted()).unwrap();
    let mut n_decoded = 0;
    for message in damaged(MESSAGE) {
        let mut row = Row::new(&["action", "state"]);
        n_decoded += usize::from(plan.decode(&message, &mut row).is_ok());
        drop(value(Some(&schema), &message).unwrap());
    }
    assert!(n_decoded > 0);
}

#[test]
fn a_damaged_schema_is_an_error_or_another_schema() {
    for data in damaged(BFBS) {
        let schema = schema(&data);
        let mut row = Row::new(&["action", "state"]);
        drop(
            Plan::compile(Some(&schema), &all_wanted()).map(|plan| plan.decode(MESSAGE, &mut row)),
        );
        drop(value(Some(&schema), MESSAGE));
    }
}

/// A step whose `n` joints are all the same table, with a name of `len` bytes.
fn same_joint(n: u32, len: u32) -> Vec<u8> {
    let joint = 40 + 4 * n;
    let mut words = vec![28];
    // The list of offsets of a step with nothing but joints, that of a joint with nothing but a name.
    words.extend([0x0008_0010, 0, 0, 0x0004_0000]);
    words.extend([0x0008_0006, 0x0000_0004]);
    words.extend([28 - 4, 4, n]);
    words.extend((0..n).map(|i| joint - (40 + 4 * i)));
    words.extend([joint - 20, 4, len]);
    let mut bytes: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
    bytes.extend(vec![b'a'; len as usize]);
    bytes
}

#[test]
fn offsets_that_lead_to_the_same_place_do_not_fill_the_memory() {
    let names = |message: &[u8]| decode(&[wanted(&["joints", "name"], Field::Names(0))], message);
    let row = names(&same_joint(2, 3)).unwrap();
    assert_eq!(
        row.targets[0].names.iter().collect::<Vec<_>>(),
        ["aaa", "aaa"]
    );
    // Ten gigabytes of names in half a megabyte.
    let message = same_joint(100_000, 100_000);
    let expected = "not FlatBuffers: its offsets lead to the same places again and again";
    assert_eq!(names(&message).unwrap_err(), expected);
    let error = value(Some(&schema(BFBS)), &message).unwrap().unwrap_err();
    assert_eq!(error.to_string(), expected);
}
