//! Where a message says what its values are called: `name` beside `position`, `joint_names` above
//! `points[0].positions`, `name` in each element of `joints`.

use std::sync::Arc;

use super::decode::{Access, Value};
use super::selector::{PathPart, Selector};

/// Members that name the values beside or below them.
const NAME_KEYS: [&str; 3] = ["name", "names", "joint_names"];

/// How deep in a message name lists are looked for.
const MAX_DEPTH: usize = 4;

/// The texts that name the elements of an array.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct NamesAt {
    pub(crate) path: Vec<Access>,
    /// Each element is an object that says its own name: it may come, or not, message by message.
    pub(crate) in_objects: bool,
}

/// The path of the texts that name the elements at `path`, if the message has such.
pub(crate) fn names_of(root: &Value, path: &[Access]) -> Option<NamesAt> {
    // In an array of objects, each says its own name.
    if let Some(at) = array_of_objects(root, path) {
        let mut names = path[..at].to_vec();
        names.push(Access::Key("name".to_owned()));
        let is_named = matches!(root.at(&names), Some(Value::Text(_)));
        return is_named.then_some(NamesAt {
            path: names,
            in_objects: true,
        });
    }
    // Else the nearest list of texts beside or above the array, if it is an array as a whole that is taken.
    if !matches!(path.last(), Some(Access::Key(_)))
        || !matches!(root.at(path), Some(Value::List(_)))
    {
        return None;
    }
    (0..path.len()).rev().find_map(|n| {
        NAME_KEYS.iter().find_map(|key| {
            let mut names = path[..n].to_vec();
            names.push(Access::Key((*key).to_owned()));
            is_list_of_texts(root.at(&names)?).then_some(NamesAt {
                path: names,
                in_objects: false,
            })
        })
    })
}

/// Does `path` lead through an array of objects that is empty?
pub(crate) fn is_below_nothing(root: &Value, path: &[Access]) -> bool {
    (0..path.len()).any(|n| {
        path[n..].iter().any(|a| matches!(a, Access::Key(_)))
            && matches!(root.at(&path[..n]), Some(Value::List(items)) if items.is_empty())
    })
}

/// How much of `path` leads to an array to whose elements a name applies.
fn array_of_objects(root: &Value, path: &[Access]) -> Option<usize> {
    (0..path.len()).find(|&n| {
        matches!(path[n], Access::Key(_)) && matches!(root.at(&path[..n]), Some(Value::List(_)))
    })
}

/// An empty list counts: others may be full.
fn is_list_of_texts(value: &Value) -> bool {
    matches!(value, Value::List(items) if items.iter().all(|i| matches!(i, Value::Text(_))))
}

/// What the elements are called that `selectors` take by index out of one array, where `names` has one for each
/// element of it.
pub(crate) fn by_index(
    names: &[Arc<str>],
    selectors: &[Selector],
    example: &Value,
) -> Option<Vec<Arc<str>>> {
    let mut array = None;
    let mut taken = Vec::new();
    for selector in selectors {
        let (last, above) = selector.path().split_last()?;
        if *array.get_or_insert(above) != above {
            return None;
        }
        taken.extend_from_slice(match last {
            PathPart::Index(index) => names.get(*index..=*index)?,
            PathPart::Items { start, end } => names.get(*start..*end)?,
            PathPart::Key(_) | PathPart::Name(_) => return None,
        });
    }
    let above = array?.iter().map(|part| match part {
        PathPart::Key(key) => Some(Access::Key(key.clone())),
        PathPart::Index(index) => Some(Access::Items(*index..index + 1)),
        PathPart::Items { .. } | PathPart::Name(_) => None,
    });
    let n_elements = match example.at(&above.collect::<Option<Vec<_>>>()?)? {
        Value::Bytes(bytes) => bytes.len(),
        Value::List(items) if !items.iter().any(is_compound) => items.len(),
        _ => return None,
    };
    (n_elements == names.len()).then_some(taken)
}

fn is_compound(value: &Value) -> bool {
    matches!(value, Value::List(_) | Value::Map(_) | Value::Bytes(_))
}

/// All paths in a message under which names stand.
pub(crate) fn all_names(root: &Value) -> Vec<Vec<Access>> {
    let mut found = Vec::new();
    collect(root, &mut Vec::new(), &mut found);
    found
}

fn collect(value: &Value, path: &mut Vec<Access>, found: &mut Vec<Vec<Access>>) {
    let Value::Map(members) = value else {
        return;
    };
    if path.len() >= MAX_DEPTH {
        return;
    }
    for (key, member) in members {
        path.push(Access::Key(key.clone()));
        match member {
            Value::List(_) if is_list_of_texts(member) && NAME_KEYS.contains(&key.as_str()) => {
                found.push(path.clone());
            }
            Value::List(items)
                if items
                    .first()
                    .is_some_and(|i| matches!(i.get("name"), Some(Value::Text(_)))) =>
            {
                path.push(Access::Key("name".to_owned()));
                found.push(path.clone());
                path.pop();
            }
            Value::Map(_) => collect(member, path, found),
            _ => {}
        }
        path.pop();
    }
}

/// All texts at a path, which may lead through an array of objects.
fn texts_at<'a>(value: &'a Value, path: &[Access], texts: &mut Vec<&'a str>) {
    match (value, path.split_first()) {
        (Value::List(items), _) => items.iter().for_each(|item| texts_at(item, path, texts)),
        (Value::Text(text), None) => texts.push(text),
        (Value::Map(_), Some((Access::Key(key), rest))) => {
            if let Some(member) = value.get(key) {
                texts_at(member, rest, texts);
            }
        }
        _ => {}
    }
}

/// The sets of names that the messages of one topic have under one path, each once, in order of appearance.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct NameSets {
    sets: Vec<Vec<String>>,
}

/// Most different sets that are kept; more say that these are no joints.
const MAX_SETS: usize = 64;

impl NameSets {
    /// The names of one message.
    pub(crate) fn of(message: &Value, path: &[Access]) -> Self {
        let mut sets = Self::default();
        let mut names = Vec::new();
        texts_at(message, path, &mut names);
        sets.add(names.into_iter());
        sets
    }

    pub(crate) fn add<'a>(&mut self, names: impl Iterator<Item = &'a str>) {
        if self.sets.len() >= MAX_SETS {
            return;
        }
        let names: Vec<String> = names.map(ToOwned::to_owned).collect();
        let is_new = |known: &Vec<String>| {
            known.len() != names.len() || names.iter().any(|n| !known.contains(n))
        };
        if !names.is_empty() && self.sets.iter().all(is_new) {
            self.sets.push(names);
        }
    }

    /// Do several messages share the joints out among them, none having any that another has?
    pub(crate) fn are_shared_out(&self) -> bool {
        self.sets.len() < MAX_SETS
            && self.sets.iter().enumerate().all(|(i, set)| {
                self.sets[..i]
                    .iter()
                    .all(|other| set.iter().all(|n| !other.contains(n)))
            })
    }

    /// The names of the first message.
    pub(crate) fn first(&self) -> &[String] {
        self.sets.first().map_or(&[], Vec::as_slice)
    }

    /// All names, in order of appearance.
    pub(crate) fn union(&self) -> Vec<String> {
        let mut union: Vec<String> = Vec::new();
        for name in self.sets.iter().flatten() {
            if !union.contains(name) {
                union.push(name.clone());
            }
        }
        union
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(t: &str) -> Value {
        Value::Text(t.to_owned())
    }

    fn map(members: Vec<(&str, Value)>) -> Value {
        Value::Map(
            members
                .into_iter()
                .map(|(k, v)| (k.to_owned(), v))
                .collect(),
        )
    }

    fn path(names: Option<NamesAt>) -> Vec<Access> {
        names.unwrap().path
    }

    fn key(k: &str) -> Access {
        Access::Key(k.to_owned())
    }

    #[test]
    fn names_are_found_beside_above_and_inside() {
        let numbers = Value::List(vec![Value::Number(1.0), Value::Number(2.0)]);
        let names = Value::List(vec![text("a"), text("b")]);
        let joint_state = map(vec![("name", names.clone()), ("position", numbers.clone())]);
        assert_eq!(
            path(names_of(&joint_state, &[key("position")])),
            [key("name")]
        );
        let trajectory = map(vec![
            ("joint_names", names),
            (
                "points",
                Value::List(vec![map(vec![("positions", numbers)])]),
            ),
        ]);
        assert_eq!(
            path(names_of(
                &trajectory,
                &[key("points"), Access::Items(0..1), key("positions")]
            )),
            [key("joint_names")]
        );
        let joint = |n| map(vec![("name", text(n)), ("position", Value::Number(0.5))]);
        let joints = map(vec![("joints", Value::List(vec![joint("a"), joint("b")]))]);
        assert_eq!(
            path(names_of(&joints, &[key("joints"), key("position")])),
            [key("joints"), key("name")]
        );
        assert_eq!(all_names(&joints), [vec![key("joints"), key("name")]]);
    }

    #[test]
    fn joints_are_shared_out_if_no_two_messages_have_one_in_common() {
        let mut sets = NameSets::default();
        for names in [vec!["a", "b"], vec!["c"], vec!["b", "a"]] {
            sets.add(names.into_iter());
        }
        assert!(sets.are_shared_out());
        assert_eq!(sets.union(), ["a", "b", "c"]);
        sets.add(["a", "c"].into_iter());
        assert!(!sets.are_shared_out());
    }
}
