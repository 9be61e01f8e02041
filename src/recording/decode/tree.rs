//! Walks a self-describing message (CBOR, MessagePack) beside a plan, for any `serde` deserializer: a seed per wanted
//! place takes the numbers straight into the row, all else is skipped unread. JSON has a faster walk of its own that does
//! the same; there `serde_json` and these seeds are what tests hold it against.

use std::fmt;

use serde::Deserializer;
use serde::de::{DeserializeSeed, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::DecodeError;
use super::plan::{Field, Leaf, Node, Template};
use super::row::{ABSENT, Row, is_absent};
use super::value::Value;

/// Takes what `node` wants of the value that comes.
pub(super) struct NodeSeed<'p, 'r> {
    pub(super) node: &'p Node,
    pub(super) row: &'r mut Row,
    /// Inside an array that a name was applied to: a member that is missing is [`ABSENT`].
    pub(super) in_array: bool,
}

impl<'de> DeserializeSeed<'de> for NodeSeed<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        match &self.node.leaf {
            Some(leaf) => LeafSeed {
                leaf,
                row: self.row,
            }
            .deserialize(deserializer),
            None => deserializer.deserialize_any(self),
        }
    }
}

impl<'de> Visitor<'de> for NodeSeed<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.node.items.is_empty() {
            "an object"
        } else {
            "an array"
        })
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let Self {
            node,
            row,
            in_array,
        } = self;
        if !node.items.is_empty() {
            return Err(A::Error::custom("an object where an array is expected"));
        }
        let mut seen = Seen::default();
        while let Some(found) = map.next_key_seed(KeySeed(&node.keys))? {
            let Some(index) = found else {
                map.next_value::<IgnoredAny>()?;
                continue;
            };
            let (key, child) = &node.keys[index];
            if !seen.insert(index) {
                return Err(A::Error::custom(format_args!("duplicate key {key:?}")));
            }
            map.next_value_seed(NodeSeed {
                node: child,
                row: &mut *row,
                in_array,
            })?;
        }
        if in_array {
            for (index, (_, child)) in node.keys.iter().enumerate() {
                if !seen.contains(index)
                    && let Some(Leaf {
                        field: Field::Values(target),
                        ..
                    }) = child.leaf
                {
                    row.values(target).push(ABSENT);
                }
            }
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        let Self { node, row, .. } = self;
        let mut index = 0;
        loop {
            let more = match node.item(index) {
                Some(child) => seq
                    .next_element_seed(NodeSeed {
                        node: child,
                        row: &mut *row,
                        in_array: true,
                    })?
                    .is_some(),
                None => seq.next_element::<IgnoredAny>()?.is_some(),
            };
            if !more {
                return Ok(());
            }
            index += 1;
        }
    }

    fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<(), E> {
        if self.node.items.is_empty() {
            return Err(E::custom("bytes where an object is expected"));
        }
        for (range, child) in &self.node.items {
            let Some(Leaf {
                field: Field::Values(target),
                ..
            }) = child.leaf
            else {
                return Err(E::custom("bytes where an array of objects is expected"));
            };
            let picked = bytes.iter().take(range.end).skip(range.start);
            self.row
                .values(target)
                .extend(picked.map(|&b| f64::from(b)));
        }
        Ok(())
    }
}

/// Which of the wanted keys of an object have come.
#[derive(Default)]
pub(super) struct Seen {
    first: u64,
    more: Vec<usize>,
}

impl Seen {
    /// False if it was there already.
    pub(super) fn insert(&mut self, index: usize) -> bool {
        if self.contains(index) {
            return false;
        }
        match u32::try_from(index).ok().and_then(|i| 1u64.checked_shl(i)) {
            Some(bit) => self.first |= bit,
            None => self.more.push(index),
        }
        true
    }

    pub(super) fn contains(&self, index: usize) -> bool {
        match u32::try_from(index).ok().and_then(|i| 1u64.checked_shl(i)) {
            Some(bit) => self.first & bit != 0,
            None => self.more.contains(&index),
        }
    }
}

/// Finds a key among names.
struct KeySeed<'p, T>(&'p [(String, T)]);

impl<'de, T> DeserializeSeed<'de> for KeySeed<'_, T> {
    type Value = Option<usize>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        // Not `deserialize_str`: CBOR and MessagePack may have keys that are not text, which are no wanted name.
        deserializer.deserialize_any(self)
    }
}

impl<T> Visitor<'_> for KeySeed<'_, T> {
    type Value = Option<usize>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a key")
    }

    fn visit_str<E: Error>(self, key: &str) -> Result<Self::Value, E> {
        Ok(self.0.iter().position(|(name, _)| name == key))
    }

    fn visit_i64<E: Error>(self, _: i64) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_u64<E: Error>(self, _: u64) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_unit<E: Error>(self) -> Result<Self::Value, E> {
        Ok(None)
    }
}

/// Takes the value at the end of a path.
struct LeafSeed<'p, 'r> {
    leaf: &'p Leaf,
    row: &'r mut Row,
}

impl<'de> DeserializeSeed<'de> for LeafSeed<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        let Self { leaf, row } = self;
        match leaf.field {
            Field::Values(target) => {
                let label = row.label(leaf.field);
                deserializer.deserialize_any(Leaves {
                    label,
                    template: leaf.template.as_deref(),
                    values: row.values(target),
                })
            }
            field => deserializer.deserialize_any(ScalarVisitor { field, row }),
        }
    }
}

/// Takes an id, a number, a flag, or a list of names.
struct ScalarVisitor<'r> {
    field: Field,
    row: &'r mut Row,
}

fn custom<E: Error>(result: Result<(), DecodeError>) -> Result<(), E> {
    result.map_err(E::custom)
}

impl<'de> Visitor<'de> for ScalarVisitor<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.row.label(self.field))
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<(), E> {
        custom(self.row.boolean(self.field, value))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<(), E> {
        custom(self.row.integer(self.field, value))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<(), E> {
        custom(self.row.unsigned(self.field, value))
    }

    fn visit_i128<E: Error>(self, value: i128) -> Result<(), E> {
        custom(self.row.float(self.field, value as f64))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<(), E> {
        custom(self.row.float(self.field, value))
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<(), E> {
        custom(self.row.text(self.field, value))
    }

    fn visit_unit<E: Error>(self) -> Result<(), E> {
        custom(self.row.null(self.field))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        let Self { field, row } = self;
        if !matches!(field, Field::Names(_)) {
            return custom(Err(DecodeError::wrong_type("an array", field, row)));
        }
        while seq
            .next_element_seed(Name(ScalarVisitor {
                field,
                row: &mut *row,
            }))?
            .is_some()
        {}
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, _: A) -> Result<(), A::Error> {
        custom(Err(DecodeError::wrong_type(
            "an object",
            self.field,
            self.row,
        )))
    }
}

/// Takes a name out of an array of such.
struct Name<'r>(ScalarVisitor<'r>);

impl<'de> DeserializeSeed<'de> for Name<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_str(self.0)
    }
}

/// Takes all numbers below a value, nested arrays flattened, objects in the order of a template.
struct Leaves<'p, 'r> {
    label: &'static str,
    template: Option<&'p Template>,
    values: &'r mut Vec<f64>,
}

impl Leaves<'_, '_> {
    fn refuse<E: Error>(&self, found: &str) -> E {
        E::custom(format_args!(
            "{found} where a number is expected in {}",
            self.label
        ))
    }
}

impl<'de> DeserializeSeed<'de> for Leaves<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Leaves<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a number or an array of numbers as {}", self.label)
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<(), E> {
        self.values.push(f64::from(u8::from(value)));
        Ok(())
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<(), E> {
        self.values.push(value as f64);
        Ok(())
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<(), E> {
        self.values.push(value as f64);
        Ok(())
    }

    fn visit_i128<E: Error>(self, value: i128) -> Result<(), E> {
        self.values.push(value as f64);
        Ok(())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<(), E> {
        // A message may hold any NaN, also the one that stands for a value that is not there.
        let value = if is_absent(value) { f64::NAN } else { value };
        self.values.push(value);
        Ok(())
    }

    fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<(), E> {
        self.values.extend(bytes.iter().map(|&b| f64::from(b)));
        Ok(())
    }

    fn visit_unit<E: Error>(self) -> Result<(), E> {
        Err(self.refuse("null"))
    }

    fn visit_str<E: Error>(self, _: &str) -> Result<(), E> {
        Err(self.refuse("text"))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        while seq
            .next_element_seed(Leaves {
                label: self.label,
                template: self.template,
                values: &mut *self.values,
            })?
            .is_some()
        {}
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let Some(Template::Object(members)) = self.template else {
            return Err(self.refuse("an object"));
        };
        let start = self.values.len();
        // Where the values of each member of the template came to lie, in the order in which they came.
        let mut came: Vec<(usize, usize)> = Vec::with_capacity(members.len());
        while let Some(found) = map.next_key_seed(KeySeed(members))? {
            let member = found
                .map(|index| (index, &members[index].1))
                .filter(|(_, below)| below.has_numbers());
            let Some((index, below)) = member else {
                map.next_value::<IgnoredAny>()?;
                continue;
            };
            if came.iter().any(|&(seen, _)| seen == index) {
                let key = &members[index].0;
                return Err(A::Error::custom(format_args!("duplicate key {key:?}")));
            }
            map.next_value_seed(Leaves {
                label: self.label,
                template: Some(below),
                values: &mut *self.values,
            })?;
            came.push((index, self.values.len()));
        }
        let n_wanted = members.iter().filter(|(_, b)| b.has_numbers()).count();
        if came.len() < n_wanted {
            return Err(A::Error::custom(format_args!(
                "a member of {} that the first message has is missing",
                self.label
            )));
        }
        if !came.is_sorted_by_key(|&(index, _)| index) {
            reorder(self.values, start, &came);
        }
        Ok(())
    }
}

/// Puts the runs of values behind `start`, each `(member, end)`, in the order of their members.
fn reorder(values: &mut Vec<f64>, start: usize, came: &[(usize, usize)]) {
    let mut from = start;
    let mut runs: Vec<(usize, Vec<f64>)> = Vec::with_capacity(came.len());
    for &(index, end) in came {
        runs.push((index, values[from..end].to_vec()));
        from = end;
    }
    runs.sort_by_key(|&(index, _)| index);
    values.truncate(start);
    values.extend(runs.into_iter().flat_map(|(_, run)| run));
}

/// Makes a [`Value`] of anything.
pub(super) struct ValueSeed;

impl<'de> DeserializeSeed<'de> for ValueSeed {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for ValueSeed {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Bool(value))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Value, E> {
        Ok(Value::Integer(value.into()))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Value, E> {
        Ok(Value::Integer(value.into()))
    }

    fn visit_i128<E: Error>(self, value: i128) -> Result<Value, E> {
        Ok(Value::Integer(value))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        Ok(Value::Number(value))
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Value, E> {
        Ok(Value::Text(value.to_owned()))
    }

    fn visit_bytes<E: Error>(self, value: &[u8]) -> Result<Value, E> {
        Ok(Value::Bytes(value.to_owned()))
    }

    fn visit_unit<E: Error>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Value, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = seq.next_element_seed(ValueSeed)? {
            items.push(item);
        }
        Ok(Value::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Value, A::Error> {
        let mut members = Vec::new();
        while let Some(key) = map.next_key_seed(ValueSeed)? {
            // What no path can name is no member; a plan made from this value would look for it in vain.
            let Value::Text(key) = key else {
                map.next_value::<IgnoredAny>()?;
                continue;
            };
            members.push((key, map.next_value_seed(ValueSeed)?));
        }
        Ok(Value::Map(members))
    }
}
