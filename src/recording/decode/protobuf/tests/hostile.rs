//! Bytes that are no message, and schemas that are none.

use super::*;
use crate::recording::wire::Schema;

/// Each message cut at every byte, and every byte replaced.
fn mutations(data: &[u8]) -> impl Iterator<Item = Vec<u8>> + '_ {
    let cut = (0..data.len()).map(|n| data[..n].to_vec());
    let replaced = (0..data.len()).flat_map(move |i| {
        [
            0,
            1,
            0x7f,
            0x80,
            0xff,
            data[i] ^ 1,
            data[i] ^ 0x10,
            data[i].wrapping_add(1),
        ]
        .map(|byte| {
            let mut data = data.to_vec();
            data[i] = byte;
            data
        })
    });
    cut.chain(replaced)
}

#[test]
fn a_broken_message_is_an_error_or_another_message() {
    let schema = step_schema();
    let root = Type::of(Some(&schema)).unwrap();
    let plans = PATHS.map(|text| plan(&schema, &[want(text, Field::Values(0), true)]).unwrap());
    let random = |seed: u32| {
        let byte = |i: u32| (i.wrapping_mul(2_654_435_761) >> 13).to_le_bytes()[0];
        let entropy: Vec<u8> = (seed..seed + 600).map(byte).collect();
        random::message(&root.message, false, 3, &mut Entropy(entropy.iter()))
    };
    let mut messages = (1..).map(random);
    let random = messages
        .find(|data| (200..800).contains(&data.len()))
        .unwrap();
    for data in [step_bytes(), random] {
        for broken in mutations(&data) {
            for plan in &plans {
                let _read = values(plan, &broken);
            }
            let _shown = super::super::value(Some(&schema), &broken);
        }
    }
}

#[test]
fn a_broken_schema_is_an_error_or_another_schema() {
    let whole = step_schema();
    let wanted = [
        want("joints", Field::Values(0), false),
        want("a", Field::Reward, false),
    ];
    for data in mutations(&whole.data) {
        let schema = Schema {
            data,
            ..whole.clone()
        };
        if let Ok(plan) = plan(&schema, &wanted) {
            let _read = plan.decode(&step_bytes(), &mut Row::new(&["action"]));
        }
    }
}

#[track_caller]
fn malformed(data: &[u8], what: &str) {
    let mut row = Row::new(&["action"]);
    assert_eq!(
        step_plan().decode(data, &mut row),
        Err(super::super::malformed(what))
    );
}

#[test]
fn bytes_that_are_not_protobuf_are_refused_by_cause() {
    malformed(&[0x08], "it ends in the middle of a field");
    malformed(&[0x22, 200], "it ends in the middle of a field");
    malformed(
        &[
            0x22, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1,
        ],
        "it ends in the middle of a field",
    );
    malformed(
        &[
            0x08, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 2,
        ],
        "a varint of more than 64 bits",
    );
    malformed(&[0x00, 0], "a tag that is none");
    malformed(&[0xff, 0xff, 0xff, 0xff, 0x7f, 0], "a tag that is none");
    malformed(&[0x0e], "an unknown wire type");
    malformed(&[0x0c], "the end of a group that did not begin");
    malformed(&[0x0b, 0x14], "the end of another group");
    malformed(&vec![0x0b; 100_000], "it is nested too deep");
    malformed(
        &[0x22, 3, 0, 0, 0],
        "a packed run that ends in the middle of a value",
    );
    malformed(
        &[0x0a, 1, 0],
        "a field has another wire type than its schema says",
    );
    malformed(
        &[0x20, 1],
        "a field has another wire type than its schema says",
    );
}

#[test]
fn more_values_than_a_vector_may_have_are_refused_early() {
    let mut row = Row::new(&["action"]);
    let mut data = Vec::new();
    bytes(12, &vec![0; (1 << 20) + 1], &mut data);
    let plan = plan(&step_schema(), &[want("pixels", Field::Values(0), true)]).unwrap();
    assert_eq!(
        plan.decode(&data, &mut row),
        Err(DecodeError::TooWide("action"))
    );
}

#[test]
fn types_that_contain_themselves_or_explode_are_refused() {
    let ring = message(
        "Ring",
        &[],
        vec![field("v", 1, Kind::Double), nested("next", 2, ".t.Ring")],
    );
    let rings = schema("t.Ring", vec![file("r.proto", "t", "proto3", vec![ring])]);
    let text = |schema: &Schema, path: &str| {
        plan(schema, &[want(path, Field::Values(0), true)])
            .unwrap_err()
            .to_string()
    };
    assert_eq!(
        text(&rings, "next"),
        "t.Ring contains itself: name the fields that are wanted of it"
    );
    let long = vec!["next"; 500].join(".");
    assert_eq!(text(&rings, &long), "t.Ring is nested too deep");
    assert_eq!(
        values(
            &plan(&rings, &[want("next.next.v", Field::Values(0), true)]).unwrap(),
            &[0x12, 0]
        ),
        Ok(Some(vec![0.0]))
    );

    let mut types = vec![message("T40", &[], vec![field("v", 1, Kind::Double)])];
    for i in 0..40 {
        let below = format!(".t.T{}", i + 1);
        types.push(message(
            &format!("T{i}"),
            &[],
            vec![nested("a", 1, &below), nested("b", 2, &below)],
        ));
    }
    let tree = schema("t.T0", vec![file("t.proto", "t", "proto3", types)]);
    assert!(text(&tree, "a").ends_with("has too many fields in all"));
}

#[test]
fn a_schema_that_cannot_be_used_says_why() {
    let text = |schema: &Schema| Type::of(Some(schema)).unwrap_err().to_string();
    let whole = step_schema();
    assert_eq!(
        text(&Schema {
            data: vec![0xff],
            ..whole.clone()
        }),
        "schema \"t.Step\" (protobuf) cannot be used: it is not a FileDescriptorSet"
    );
    assert_eq!(
        text(&Schema {
            name: "t.Stop".to_owned(),
            ..whole.clone()
        }),
        "schema \"t.Stop\" (protobuf) cannot be used: it does not have a message of this name"
    );
    assert_eq!(
        text(&Schema {
            encoding: "jsonschema".to_owned(),
            ..whole
        }),
        "schema \"t.Step\" (jsonschema) cannot be used: protobuf messages need a schema of encoding \"protobuf\""
    );
    let lost = message("Lost", &[], vec![nested("m", 1, ".other.M")]);
    let lost = schema(
        "t.Lost",
        vec![FileDescriptorProto {
            dependency: vec!["other.proto".to_owned()],
            ..file("t.proto", "t", "proto3", vec![lost])
        }],
    );
    assert!(text(&lost).contains("other.M"), "{}", text(&lost));
    let new = schema(
        "t.New",
        vec![file(
            "n.proto",
            "t",
            "editions",
            vec![message("New", &[], Vec::new())],
        )],
    );
    assert!(text(&new).contains("only proto2 and proto3 are read"));
    // Imports that go round, publicly.
    let round = |name: &str, other: &str, kind: &str| FileDescriptorProto {
        dependency: vec![other.to_owned(), name.to_owned()],
        public_dependency: vec![0, 1, 7, -1],
        ..file(name, "t", "proto3", vec![message(kind, &[], Vec::new())])
    };
    Type::of(Some(&schema(
        "t.A",
        vec![
            round("a.proto", "b.proto", "A"),
            round("b.proto", "a.proto", "B"),
        ],
    )))
    .unwrap();
}
