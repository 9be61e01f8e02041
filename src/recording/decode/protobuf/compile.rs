//! Compiles a tree of names against a message type.

use std::ops::Range;

use prost_reflect::{Cardinality, FieldDescriptor, MessageDescriptor};

use super::build::{absent, build};
use super::describe::{described, is_never_a_leaf, no_field};
use super::fields::declared;
use super::plan::{FieldPlan, Message, Place, Take};
use super::scalar::Scalar;
use super::schema::Type;
use crate::recording::MAX_DEPTH;
use crate::recording::decode::PlanError;
use crate::recording::decode::plan::{Field, Leaf, Node};

/// Most fields that a plan looks into: types that use each other twice over would have more than there is memory.
const MAX_FIELDS: usize = 1 << 16;

/// Compiles one tree; `None` if the type has nothing of it, and nothing of it is required.
pub(super) fn compile(root: &Type, tree: &Node) -> Result<Option<Message>, PlanError> {
    let mut compiler = Compiler {
        root,
        fields_left: MAX_FIELDS,
        open: Vec::new(),
    };
    let here = Here {
        in_array: false,
        is_flat: false,
        depth: MAX_DEPTH,
    };
    compiler.message(&root.message, tree, here)
}

struct Compiler<'s> {
    root: &'s Type,
    fields_left: usize,
    /// Names of the types whose numbers are being collected, outermost first.
    open: Vec<String>,
}

/// Where in a message a plan stands.
#[derive(Clone, Copy)]
struct Here {
    /// Inside the elements of an array.
    in_array: bool,
    /// Below a path that takes all numbers.
    is_flat: bool,
    /// Levels that may follow.
    depth: usize,
}

type Compiled<T> = Result<Option<T>, PlanError>;

impl Compiler<'_> {
    fn message(
        &mut self,
        message: &MessageDescriptor,
        node: &Node,
        here: Here,
    ) -> Compiled<Message> {
        let Some(depth) = here.depth.checked_sub(1) else {
            return refuse(node, || {
                format!("{} is nested too deep", message.full_name())
            });
        };
        let here = Here { depth, ..here };
        if let Some(leaf) = &node.leaf {
            return match leaf.field {
                Field::Values(_) if here.is_flat => self.flat(message, node, here),
                Field::Values(_) => self.numbers(message, node, leaf, here),
                _ => refuse(node, || {
                    format!("{} is a message: name a field of it", message.full_name())
                }),
            };
        }
        if !node.items.is_empty() {
            return refuse(node, || {
                format!("{} is a message, not an array", message.full_name())
            });
        }
        let mut plans = Vec::new();
        for (key, child) in &node.keys {
            let plan = match message.get_field_by_name(key) {
                Some(field) => self.field(&field, child, here)?.map(|plan| (field, plan)),
                None => refuse(child, || no_field(message, key))?,
            };
            plans.extend(plan);
        }
        Ok(build(plans))
    }

    /// All numbers of a message that a path ends on.
    fn numbers(
        &mut self,
        message: &MessageDescriptor,
        node: &Node,
        leaf: &Leaf,
        here: Here,
    ) -> Compiled<Message> {
        // Below, whatever is there is wanted: what a path that is not required cannot have is dropped as a whole.
        let all = Node {
            leaf: Some(Leaf {
                required: true,
                ..leaf.clone()
            }),
            ..Node::default()
        };
        let here = Here {
            is_flat: true,
            ..here
        };
        self.open.clear();
        let text = match self.flat(message, &all, here) {
            Ok(Some(plan)) => return Ok(Some(plan)),
            Ok(None) => format!("{} holds no numbers", message.full_name()),
            Err(PlanError::Path(text)) => text,
            Err(e) => return Err(e),
        };
        refuse(node, || text)
    }

    /// All numbers of a message and of those in it, in the order of their declaration.
    fn flat(&mut self, message: &MessageDescriptor, node: &Node, here: Here) -> Compiled<Message> {
        let name = message.full_name();
        if self.open.iter().any(|open| open == name) {
            return refuse(node, || {
                format!("{name} contains itself: name the fields that are wanted of it")
            });
        }
        self.open.push(name.to_owned());
        let mut fields: Vec<FieldDescriptor> = message.fields().collect();
        fields.sort_by_key(declared);
        let mut plans = Vec::new();
        for field in fields {
            self.fields_left = match self.fields_left.checked_sub(1) {
                Some(left) => left,
                None => return refuse(node, || format!("{name} has too many fields in all")),
            };
            if Scalar::of(&field.kind()) == Some(Scalar::String) || is_never_a_leaf(&field) {
                continue;
            }
            let plan = self.field(&field, node, here)?;
            plans.extend(plan.map(|plan| (field, plan)));
        }
        self.open.pop();
        Ok(build(plans))
    }

    fn field(&mut self, field: &FieldDescriptor, node: &Node, here: Here) -> Compiled<FieldPlan> {
        if field.is_group() {
            return refuse(node, || format!("{} is a group", field.full_name()));
        }
        let place = if field.cardinality() == Cardinality::Repeated {
            self.many(field, node, here)?
        } else {
            let take = self.take(field, node, here)?;
            take.map(|take| Place::One {
                absent: absent(field, &take, here.in_array, here.is_flat),
                take,
            })
        };
        Ok(place.map(|place| FieldPlan { place }))
    }

    fn many(&mut self, field: &FieldDescriptor, node: &Node, here: Here) -> Compiled<Place> {
        if let Some(leaf) = &node.leaf
            && !matches!(leaf.field, Field::Values(_) | Field::Names(_))
        {
            return refuse(node, || {
                format!(
                    "{} is an array: name one of its elements",
                    field.full_name()
                )
            });
        }
        if self.is_map(field) && node.wants_values() {
            return map(field, node, here);
        }
        let here = Here {
            in_array: true,
            ..here
        };
        let mut parts: Vec<(Range<usize>, Take)> = Vec::new();
        if node.items.is_empty() {
            let take = self.take(field, node, here)?;
            parts.extend(take.map(|take| (0..usize::MAX, take)));
        }
        for (range, child) in &node.items {
            let take = self.take(field, child, here)?;
            parts.extend(take.map(|take| (range.clone(), take)));
        }
        parts.sort_by_key(|(range, _)| range.start);
        let mut targets = Vec::new();
        for (_, take) in &parts {
            take.targets(&mut targets);
        }
        targets.sort_unstable();
        targets.dedup();
        Ok((!parts.is_empty()).then(|| Place::Many {
            kind: Scalar::of(&field.kind()),
            parts,
            targets,
        }))
    }

    fn is_map(&self, field: &FieldDescriptor) -> bool {
        let kind = field.kind();
        kind.as_message()
            .is_some_and(|message| self.root.is_map_entry(message))
    }

    /// What is taken of one value of a field.
    fn take(&mut self, field: &FieldDescriptor, node: &Node, here: Here) -> Compiled<Take> {
        if let Some(message) = field.kind().as_message() {
            return Ok(self.message(message, node, here)?.map(Take::Message));
        }
        let Some(kind) = Scalar::of(&field.kind()) else {
            return Ok(None);
        };
        if kind == Scalar::Bytes && !node.items.is_empty() {
            return byte_ranges(field, node);
        }
        match &node.leaf {
            Some(leaf) if kind.fits(leaf.field, here.in_array) => Ok(Some(Take::Scalar {
                kind,
                field: leaf.field,
                required: leaf.required,
            })),
            Some(_) => refuse(node, || {
                let (name, kind) = (field.full_name(), described(field));
                format!("{name} is {kind}, which is not what is wanted of it")
            }),
            None => refuse(node, || {
                let (name, kind) = (field.full_name(), described(field));
                let part = if node.items.is_empty() {
                    "fields"
                } else {
                    "elements"
                };
                format!("{name} is {kind}, which has no {part}")
            }),
        }
    }
}

/// Refuses a map, unless it has nothing numeric below a path that takes whatever is numeric.
fn map(field: &FieldDescriptor, node: &Node, here: Here) -> Compiled<Place> {
    let is_text = field
        .kind()
        .as_message()
        .and_then(|entry| entry.get_field(2))
        .is_some_and(|value| Scalar::of(&value.kind()) == Some(Scalar::String));
    if here.is_flat && is_text {
        return Ok(None);
    }
    refuse(node, || {
        format!(
            "{} is a map, whose entries have no order: its numbers cannot be taken",
            field.full_name()
        )
    })
}

/// Ranges of a byte array.
fn byte_ranges(field: &FieldDescriptor, node: &Node) -> Compiled<Take> {
    let mut ranges = Vec::new();
    for (range, child) in &node.items {
        match &child.leaf {
            Some(Leaf {
                field: Field::Values(target),
                ..
            }) => ranges.push((range.clone(), *target)),
            _ => refuse(child, || {
                format!("{} is bytes, whose elements are numbers", field.full_name())
            })?
            .unwrap_or(()),
        }
    }
    ranges.sort_by_key(|(range, _)| range.start);
    Ok((!ranges.is_empty()).then_some(Take::Bytes(ranges)))
}

/// An error, if anything below `node` is required; else nothing is taken there.
fn refuse<T>(node: &Node, text: impl FnOnce() -> String) -> Compiled<T> {
    if node.is_required() {
        Err(PlanError::Path(text()))
    } else {
        Ok(None)
    }
}
