//! The decoder against the writer, on random types; and against damage.

use super::super::super::plan::{Access, Field, Node, Wanted};
use super::super::super::row::Row;
use super::super::super::value::Value;
use super::super::Ros;
use super::writer::{Kind, Many, Random, Rules, Schema, message};
use super::{channel, schema};
use crate::recording::wire;

const N_TYPES: u64 = 400;

fn rules(seed: u64) -> Rules {
    let version = if seed.is_multiple_of(3) { 2 } else { 1 };
    let is_ros1 = seed % 4 == 1;
    Rules {
        is_ros1,
        version: if is_ros1 { 1 } else { version },
        is_delimited: !is_ros1 && version == 2 && seed.is_multiple_of(2),
        is_big_endian: !is_ros1 && seed % 5 < 2,
    }
}

/// A random path, and whether numbers stand at its end.
fn path(schema: &Schema, random: &mut Random) -> Vec<Access> {
    let mut path = Vec::new();
    let mut at = schema.structs.len() - 1;
    while !schema.structs[at].is_empty() && random.below(5) > 0 {
        let m = random.below(schema.structs[at].len());
        let (kind, many) = schema.structs[at][m];
        path.push(Access::Key(format!("m{m}")));
        if !matches!(many, Many::One) && random.below(2) == 0 {
            let start = random.below(3);
            path.push(Access::Items(start..start + random.below(3) + 1));
        }
        match kind {
            Kind::Struct(s) => at = s,
            _ => break,
        }
    }
    path
}

/// What a path takes, the slow and obvious way.
fn naive(value: &Value, path: &[Access], taken: &mut Vec<u64>) {
    match (value, path) {
        (Value::Map(members), []) => members.iter().for_each(|(_, v)| naive(v, path, taken)),
        (Value::Map(_), [Access::Key(key), rest @ ..]) => {
            naive(value.get(key).unwrap(), rest, taken);
        }
        (Value::List(items), [Access::Items(range), rest @ ..]) => items
            .iter()
            .take(range.end)
            .skip(range.start)
            .for_each(|item| naive(item, rest, taken)),
        (Value::List(items), _) => items.iter().for_each(|item| naive(item, path, taken)),
        (Value::Bytes(bytes), [Access::Items(range)]) => taken.extend(
            bytes
                .iter()
                .take(range.end)
                .skip(range.start)
                .map(|&b| f64::from(b).to_bits()),
        ),
        (Value::Bytes(bytes), []) => taken.extend(bytes.iter().map(|&b| f64::from(b).to_bits())),
        (Value::Bool(b), []) => taken.push(f64::from(u8::from(*b)).to_bits()),
        (Value::Integer(i), []) => taken.push((*i as f64).to_bits()),
        (Value::Number(f), []) => taken.push(f.to_bits()),
        (Value::Text(_) | Value::Null, []) => {}
        _ => panic!("{path:?} does not fit {value:?}"),
    }
}

struct Case {
    channel: wire::Channel,
    schema: wire::Schema,
    paths: [Vec<Access>; 2],
    messages: Vec<(Value, Vec<u8>)>,
}

impl Case {
    fn of(seed: u64) -> Self {
        let mut random = Random(seed);
        let rules = rules(seed);
        let types = Schema::random(&mut random, rules.is_ros1);
        let encoding = if rules.is_ros1 { "ros1" } else { "cdr" };
        Self {
            channel: channel(encoding),
            schema: schema(
                "p/msg/Root",
                if rules.is_ros1 { "ros1msg" } else { "ros2msg" },
                &types.text(),
            ),
            paths: [path(&types, &mut random), path(&types, &mut random)],
            messages: (0..3)
                .map(|_| message(&types, rules, &mut random))
                .collect(),
        }
    }

    fn decoder(&self) -> Ros {
        let wanted: Vec<Wanted> = self
            .paths
            .iter()
            .enumerate()
            .map(|(target, path)| Wanted {
                path: path.clone(),
                field: Field::Values(target),
                required: false,
            })
            .collect();
        Ros::compile(
            &self.channel,
            Some(&self.schema),
            &Node::trees(&wanted, None),
        )
        .unwrap()
    }

    fn value(&self, bytes: &[u8]) -> Option<Value> {
        super::super::value(&self.channel, Some(&self.schema), bytes).ok()
    }
}

fn bits(value: &Value) -> String {
    // NaN is not equal to itself: compare as text.
    format!("{value:?}")
}

#[test]
fn random_messages_of_random_types_are_read_as_they_were_written() {
    for seed in 0..N_TYPES {
        let case = Case::of(seed);
        let mut decoder = case.decoder();
        let mut row = Row::new(&["action", "state"]);
        for (value, bytes) in &case.messages {
            let text = || String::from_utf8_lossy(&case.schema.data).into_owned();
            let read = super::super::value(&case.channel, Some(&case.schema), bytes);
            let read = read.unwrap_or_else(|e| panic!("seed {seed}: {e}\n{}{value:?}", text()));
            assert_eq!(bits(&read), bits(value), "seed {seed}");
            row.clear();
            decoder.decode(bytes, &mut row).unwrap();
            for (target, path) in case.paths.iter().enumerate() {
                let mut expected = Vec::new();
                naive(value, path, &mut expected);
                let values = &row.targets[target].values;
                let found: Vec<u64> = values.iter().map(|v| v.to_bits()).collect();
                assert_eq!(found, expected, "seed {seed}, {path:?} of\n{}", text());
            }
        }
    }
}

#[test]
fn damaged_messages_are_an_error_or_another_message_but_never_a_panic() {
    for seed in 0..N_TYPES / 2 {
        let case = Case::of(seed);
        let mut decoder = case.decoder();
        let mut row = Row::new(&["action", "state"]);
        let (_, bytes) = &case.messages[0];
        let mut check = |bytes: &[u8]| {
            row.clear();
            let result = decoder.decode(bytes, &mut row);
            let value = case.value(bytes);
            assert_eq!(result.is_ok(), value.is_some(), "seed {seed}: {result:?}");
        };
        for end in 0..bytes.len() {
            check(&bytes[..end]);
        }
        for at in 0..bytes.len() {
            for byte in [0, 1, 3, 0x7f, 0xff] {
                let mut damaged = bytes.clone();
                damaged[at] = byte;
                check(&damaged);
            }
        }
    }
}
