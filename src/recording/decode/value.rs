//! One message as a tree of values: what `inspect` shows, what plans are made from, and the oracle that tests hold the
//! decoders against. Never made in the hot path.

use super::plan::Access;

/// A value of any encoding. Members are in the order of the message or of its schema.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value {
    /// Nothing is there: a JSON null, an optional field that is not set.
    Null,
    Bool(bool),
    /// An integer; those beyond i128 do not occur.
    Integer(i128),
    Number(f64),
    Text(String),
    Bytes(Vec<u8>),
    List(Vec<Value>),
    Map(Vec<(String, Value)>),
}

impl Value {
    /// The member `key`, if this is an object that has it.
    pub(crate) fn get(&self, key: &str) -> Option<&Self> {
        match self {
            Self::Map(members) => members.iter().find(|(k, _)| k == key).map(|(_, v)| v),
            _ => None,
        }
    }

    /// Names of its members, if it is an object.
    pub(crate) fn member_names(&self) -> Vec<String> {
        match self {
            Self::Map(members) => members.iter().map(|(key, _)| key.clone()).collect(),
            _ => Vec::new(),
        }
    }

    /// What stands at `path`; of an array that a name applies to, the first element that has it.
    pub(crate) fn at(&self, path: &[Access]) -> Option<&Self> {
        let Some((access, rest)) = path.split_first() else {
            return Some(self);
        };
        match (access, self) {
            (Access::Key(key), Self::Map(_)) => self.get(key)?.at(rest),
            (Access::Key(_), Self::List(items)) => items.iter().find_map(|item| item.at(path)),
            (Access::Items(range), Self::List(items)) => items.get(range.start)?.at(rest),
            (Access::Items(_), Self::Bytes(_)) if rest.is_empty() => Some(self),
            _ => None,
        }
    }
}
