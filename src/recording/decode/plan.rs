//! Which fields of a message are wanted, as a tree that a decoder walks beside the message.
//!
//! A path names object members and array elements. A name that meets an array applies to each of its elements:
//! `joints.position` is the position of every joint. A path that ends on an object or an array takes its numeric leaves.

use std::ops::Range;
use std::sync::Arc;

use super::value::Value;

/// What a wanted field becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Field {
    /// Numeric leaves, appended to the values of this target of the row.
    Values(usize),
    /// Texts, appended to the names of this target: what its values are called, one by one.
    Names(usize),
    /// The episode's id; of several such fields the lowest rank counts.
    Episode { rank: u8 },
    /// The number of the step.
    Step,
    /// The reward.
    Reward,
    /// True on the last step of an episode.
    EndFlag,
    /// Whole seconds of the message's own time.
    StampSeconds,
    /// Nanoseconds to add to them.
    StampNanos,
}

/// One step of a path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Access {
    /// The member of an object.
    Key(String),
    /// Elements of an array, half-open.
    Items(Range<usize>),
}

/// A field that is wanted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Wanted {
    pub(crate) path: Vec<Access>,
    pub(crate) field: Field,
    /// A message, or a schema, without it is refused. What is not required is taken where it is there and fits.
    pub(crate) required: bool,
}

/// A place in a message: what is taken there, and what is wanted below.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Node {
    /// Taken here; nothing is wanted below then.
    pub(crate) leaf: Option<Leaf>,
    /// Wanted members, if an object stands here, or in each element, if an array of objects does.
    pub(crate) keys: Vec<(String, Node)>,
    /// Wanted elements, if an array stands here. No two ranges overlap.
    pub(crate) items: Vec<(Range<usize>, Node)>,
}

/// The end of a path.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Leaf {
    pub(crate) field: Field,
    pub(crate) required: bool,
    /// For encodings without a schema: the objects below, as the first message has them.
    pub(crate) template: Option<Arc<Template>>,
}

/// Order of the numeric leaves below a place of a message without a schema, learned from its first message. Later
/// messages may have their keys in any order.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Template {
    /// Numbers, booleans, bytes, and arrays of such.
    Numbers,
    /// Nothing numeric: text, or nothing.
    Nothing,
    /// An object, or an array of such, whose leaves come in this order.
    Object(Vec<(String, Template)>),
}

/// Deepest nesting that a plan is made for.
const MAX_DEPTH: usize = crate::recording::MAX_DEPTH;

impl Template {
    /// Learns from an example. Headers and MultiArray layouts are never leaves.
    pub(crate) fn of(example: &Value) -> Self {
        Self::below(example, MAX_DEPTH)
    }

    fn below(example: &Value, depth: usize) -> Self {
        let Some(depth) = depth.checked_sub(1) else {
            return Self::Nothing;
        };
        match example {
            Value::Number(_) | Value::Integer(_) | Value::Bool(_) | Value::Bytes(_) => {
                Self::Numbers
            }
            Value::Text(_) | Value::Null => Self::Nothing,
            // An empty array says nothing of what others hold: numbers are the rule.
            Value::List(items) => items
                .first()
                .map_or(Self::Numbers, |item| Self::below(item, depth)),
            Value::Map(members) => Self::Object(
                members
                    .iter()
                    .map(|(key, value)| {
                        let below = if is_never_a_leaf(key, value) {
                            Self::Nothing
                        } else {
                            Self::below(value, depth)
                        };
                        (key.clone(), below)
                    })
                    .collect(),
            ),
        }
    }

    /// Is there any number below?
    pub(crate) fn has_numbers(&self) -> bool {
        match self {
            Self::Numbers => true,
            Self::Nothing => false,
            Self::Object(members) => members.iter().any(|(_, below)| below.has_numbers()),
        }
    }
}

/// A ROS header or the layout of a MultiArray, told by its shape where there is no schema.
fn is_never_a_leaf(key: &str, value: &Value) -> bool {
    (key == "header" && value.get("stamp").is_some())
        || (key == "layout" && value.get("dim").is_some())
}

impl Node {
    /// The trees that take all of `wanted`, as few as can be: fields that lie inside each other need a walk each.
    pub(crate) fn trees(wanted: &[Wanted], example: Option<&Value>) -> Vec<Self> {
        let mut trees: Vec<Self> = Vec::new();
        for want in wanted {
            let template = example
                .filter(|_| matches!(want.field, Field::Values(_)))
                .and_then(|root| root.at(&want.path))
                .map(|value| Arc::new(Template::of(value)));
            let leaf = Leaf {
                field: want.field,
                required: want.required,
                template,
            };
            let taken = trees
                .iter_mut()
                .any(|tree| tree.insert(&want.path, leaf.clone()));
            if !taken {
                let mut tree = Self::default();
                tree.insert(&want.path, leaf);
                trees.push(tree);
            }
        }
        trees
    }

    /// Adds a leaf; false, and nothing added, if it would overlap another.
    fn insert(&mut self, path: &[Access], leaf: Leaf) -> bool {
        if self.leaf.is_some() {
            return false;
        }
        match path.split_first() {
            None => {
                let is_free = self.keys.is_empty() && self.items.is_empty();
                if is_free {
                    self.leaf = Some(leaf);
                }
                is_free
            }
            Some((Access::Key(key), rest)) => {
                if !self.items.is_empty() {
                    return false;
                }
                if let Some((_, child)) = self.keys.iter_mut().find(|(k, _)| k == key) {
                    return child.insert(rest, leaf);
                }
                let mut child = Self::default();
                child.insert(rest, leaf);
                self.keys.push((key.clone(), child));
                true
            }
            Some((Access::Items(range), rest)) => {
                if !self.keys.is_empty() {
                    return false;
                }
                if let Some((_, child)) = self.items.iter_mut().find(|(r, _)| r == range) {
                    return child.insert(rest, leaf);
                }
                if self
                    .items
                    .iter()
                    .any(|(r, _)| r.start < range.end && range.start < r.end)
                {
                    return false;
                }
                let mut child = Self::default();
                child.insert(rest, leaf);
                self.items.push((range.clone(), child));
                true
            }
        }
    }

    /// Is anything required here or below?
    pub(super) fn is_required(&self) -> bool {
        self.any_leaf(&|leaf| leaf.required)
    }

    /// Are values wanted here or below?
    pub(super) fn wants_values(&self) -> bool {
        self.any_leaf(&|leaf| matches!(leaf.field, Field::Values(_)))
    }

    fn any_leaf(&self, is_it: &impl Fn(&Leaf) -> bool) -> bool {
        self.leaf.as_ref().is_some_and(is_it)
            || self.keys.iter().any(|(_, child)| child.any_leaf(is_it))
            || self.items.iter().any(|(_, child)| child.any_leaf(is_it))
    }

    /// The child for the element `index` of an array; an array that is only named passes on to each element.
    pub(crate) fn item(&self, index: usize) -> Option<&Self> {
        if self.items.is_empty() {
            return Some(self);
        }
        self.items
            .iter()
            .find(|(range, _)| range.contains(&index))
            .map(|(_, child)| child)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn want(keys: &[&str], target: usize) -> Wanted {
        Wanted {
            path: keys.iter().map(|k| Access::Key((*k).to_owned())).collect(),
            field: Field::Values(target),
            required: true,
        }
    }

    #[test]
    fn fields_beside_each_other_share_a_walk_and_fields_inside_each_other_do_not() {
        let wanted = [want(&["a", "x"], 0), want(&["a", "y"], 1), want(&["a"], 2)];
        let trees = Node::trees(&wanted, None);
        assert_eq!(trees.len(), 2);
        assert_eq!(trees[0].keys[0].1.keys.len(), 2);
        assert!(trees[1].keys[0].1.leaf.is_some());
    }
}
