//! What the tests of several decoders share: random messages, the row that a slow walk of their values gives, damage.

use proptest::collection::vec;
use proptest::prelude::*;

use super::plan::{Access, Field, Node, Wanted};
use super::row::{ABSENT, Row};
use super::{DecodeError, Value};

/// A random number generator for choices inside a case, seeded by the case.
pub(super) struct Choices(pub(super) u64);

impl Choices {
    pub(super) fn below(&mut self, n: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        usize::try_from(self.0 >> 33).unwrap() % n
    }

    /// Members of all objects in another order.
    pub(super) fn shuffled(&mut self, value: &Value) -> Value {
        match value {
            Value::Map(members) => {
                let mut left = members.clone();
                let mut out = Vec::new();
                while !left.is_empty() {
                    let (key, value) = left.swap_remove(self.below(left.len()));
                    out.push((key, self.shuffled(&value)));
                }
                Value::Map(out)
            }
            Value::List(items) => {
                Value::List(items.iter().map(|item| self.shuffled(item)).collect())
            }
            other => other.clone(),
        }
    }
}

pub(super) fn map<const N: usize>(members: [(&str, Value); N]) -> Value {
    Value::Map(members.map(|(key, value)| (key.to_owned(), value)).into())
}

fn number() -> impl Strategy<Value = Value> {
    prop_oneof![
        any::<i64>().prop_map(|n| Value::Integer(n.into())),
        any::<u64>().prop_map(|n| Value::Integer(n.into())),
        (-300i128..300).prop_map(Value::Integer),
        any::<bool>().prop_map(Value::Bool),
        prop::num::f64::NORMAL.prop_map(Value::Number),
        prop::num::f32::NORMAL.prop_map(|n| Value::Number(n.into())),
        (-2000i16..2000).prop_map(|n| Value::Number(f64::from(n) / 64.0)),
    ]
}

fn unique_keys(members: Vec<(String, Value)>) -> Value {
    let mut unique: Vec<(String, Value)> = Vec::new();
    for (key, value) in members {
        if unique.iter().all(|(seen, _)| *seen != key) {
            unique.push((key, value));
        }
    }
    Value::Map(unique)
}

/// Any value.
pub(super) fn any_value() -> impl Strategy<Value = Value> {
    let scalar = prop_oneof![
        4 => number(),
        1 => Just(Value::Null),
        1 => "[a-zäλ]{0,40}".prop_map(Value::Text),
        1 => vec(any::<u8>(), 0..40).prop_map(Value::Bytes),
    ];
    scalar.prop_recursive(4, 40, 20, |inner| {
        prop_oneof![
            vec(inner.clone(), 0..20).prop_map(Value::List),
            vec(("[a-e]{1,2}", inner), 0..18).prop_map(unique_keys),
        ]
    })
}

/// A value that an action may be: numbers, arrays of numbers, and objects of such beside texts.
fn leaves() -> impl Strategy<Value = Value> {
    let numbers = prop_oneof![
        number(),
        vec(number(), 1..20).prop_map(Value::List),
        vec(any::<u8>(), 1..10).prop_map(Value::Bytes),
        vec(vec(number(), 1..4).prop_map(Value::List), 1..4).prop_map(Value::List),
    ];
    numbers.prop_recursive(3, 20, 4, |inner| {
        let member = prop_oneof![
            4 => inner,
            1 => "[a-z]{0,5}".prop_map(Value::Text),
        ];
        vec(("[a-e]{1,2}", member), 1..5).prop_map(unique_keys)
    })
}

/// A message with every kind of field that can be wanted.
pub(super) fn any_message() -> impl Strategy<Value = Value> {
    let joint = ("[a-z]{1,6}", prop::option::of(number())).prop_map(|(name, position)| {
        let mut members = vec![("name".to_owned(), Value::Text(name))];
        members.extend(position.map(|p| ("position".to_owned(), p)));
        Value::Map(members)
    });
    let episode = prop_oneof![
        any::<i64>().prop_map(|n| Value::Integer(n.into())),
        "[a-z]{1,9}".prop_map(Value::Text),
    ];
    (
        leaves(),
        vec(number(), 4..8),
        vec(joint, 1..5),
        episode,
        any_value(),
        prop::num::f64::NORMAL,
        any::<bool>(),
    )
        .prop_map(|(action, state, joints, episode, noise, reward, done)| {
            map([
                ("action", action),
                ("state", Value::List(state)),
                ("joints", Value::List(joints)),
                ("episode", episode),
                ("noise", noise),
                ("reward", Value::Number(reward)),
                ("done", Value::Bool(done)),
            ])
        })
        // Without a number there is nothing to take.
        .prop_filter("an action with numbers", |message| {
            let mut values = Vec::new();
            push_leaves(message.get("action").unwrap(), &mut values);
            !values.is_empty()
        })
}

pub(super) fn wanted(path: &[&str], field: Field) -> Wanted {
    Wanted {
        path: path.iter().map(|k| Access::Key((*k).to_owned())).collect(),
        field,
        required: true,
    }
}

/// What is wanted of [`any_message`].
pub(super) fn all_wanted() -> Vec<Wanted> {
    let mut state = wanted(&["state"], Field::Values(1));
    state.path.push(Access::Items(1..3));
    vec![
        wanted(&["action"], Field::Values(0)),
        state,
        wanted(&["joints", "position"], Field::Values(2)),
        wanted(&["joints", "name"], Field::Names(2)),
        wanted(&["episode"], Field::Episode { rank: 0 }),
        wanted(&["reward"], Field::Reward),
        wanted(&["done"], Field::EndFlag),
    ]
}

pub(super) fn new_row() -> Row {
    Row::new(&["action", "state", "joints"])
}

/// The row of a message, made the slow way. `first` has the order of the members.
pub(super) fn slow_row(message: &Value, first: &Value) -> Row {
    let mut row = new_row();
    push_in_order(
        message.get("action").unwrap(),
        first.get("action").unwrap(),
        row.values(0),
    );
    let Some(Value::List(state)) = message.get("state") else {
        panic!("a state is an array");
    };
    state[1..3]
        .iter()
        .for_each(|v| push_leaves(v, row.values(1)));
    let Some(Value::List(joints)) = message.get("joints") else {
        panic!("joints are an array");
    };
    for joint in joints {
        match joint.get("position") {
            Some(position) => push_leaves(position, row.values(2)),
            None => row.values(2).push(ABSENT),
        }
        if let Some(Value::Text(name)) = joint.get("name") {
            row.text(Field::Names(2), name).unwrap();
        }
    }
    let episode = Field::Episode { rank: 0 };
    match message.get("episode") {
        Some(Value::Text(id)) => row.text(episode, id).unwrap(),
        Some(Value::Integer(id)) => row.integer(episode, (*id).try_into().unwrap()).unwrap(),
        other => panic!("not an episode: {other:?}"),
    }
    if let Some(Value::Number(reward)) = message.get("reward") {
        row.float(Field::Reward, *reward).unwrap();
    }
    row.boolean(
        Field::EndFlag,
        message.get("done") == Some(&Value::Bool(true)),
    )
    .unwrap();
    row
}

/// The numbers below a value, objects in the order that the example has.
fn push_in_order(value: &Value, example: &Value, out: &mut Vec<f64>) {
    match example {
        Value::Map(members) => {
            for (key, example) in members {
                push_in_order(value.get(key).unwrap(), example, out);
            }
        }
        _ => push_leaves(value, out),
    }
}

pub(super) fn push_leaves(value: &Value, out: &mut Vec<f64>) {
    match value {
        Value::Null | Value::Text(_) => {}
        Value::Bool(b) => out.push(f64::from(u8::from(*b))),
        Value::Integer(n) => out.push(*n as f64),
        Value::Number(n) => out.push(*n),
        Value::Bytes(bytes) => out.extend(bytes.iter().map(|&b| f64::from(b))),
        Value::List(items) => items.iter().for_each(|item| push_leaves(item, out)),
        Value::Map(members) => members.iter().for_each(|(_, item)| push_leaves(item, out)),
    }
}

/// Walks all trees of what is wanted.
pub(super) fn walk_all(
    trees: &[Node],
    data: &[u8],
    decode: fn(&Node, &[u8], &mut Row) -> Result<(), DecodeError>,
) -> Result<Row, DecodeError> {
    let mut row = new_row();
    for tree in trees {
        decode(tree, data, &mut row)?;
    }
    row.check()?;
    Ok(row)
}

/// The values that one path takes, given the message itself as the example.
pub(super) fn values_at(
    path: &[&str],
    data: &[u8],
    value: fn(&[u8]) -> Result<Value, DecodeError>,
    decode: fn(&Node, &[u8], &mut Row) -> Result<(), DecodeError>,
) -> Result<Vec<f64>, DecodeError> {
    let example = value(data)?;
    let trees = Node::trees(&[wanted(path, Field::Values(0))], Some(&example));
    let mut row = new_row();
    decode(&trees[0], data, &mut row)?;
    Ok(row.targets.remove(0).values)
}

/// A message cut at every byte, and with every byte replaced by others.
pub(super) fn damaged(message: &[u8]) -> impl Iterator<Item = Vec<u8>> {
    let cut = (0..message.len()).map(|end| message[..end].to_vec());
    let replaced = (0..message.len()).flat_map(|at| {
        let old = message[at];
        [
            0x00,
            0x7f,
            0x80,
            0xff,
            old ^ 0x01,
            old ^ 0x20,
            old.wrapping_add(1),
        ]
        .map(|new| {
            let mut damaged = message.to_vec();
            damaged[at] = new;
            damaged
        })
    });
    cut.chain(replaced)
}
