//! Wanted paths to steps, held against the types of a schema.

use std::collections::BTreeMap;

use super::Step;
use super::schema::{Element, Kind, Object, Scalar, Types};
use crate::recording::MAX_DEPTH;
use crate::recording::decode::PlanError;
use crate::recording::decode::plan::{Field, Node, Wanted};

/// A step tree for each walk.
pub(super) fn trees(types: &Types, root: usize, wanted: &[Wanted]) -> Result<Vec<Step>, PlanError> {
    let root = Kind::One(Element::Table(root));
    let mut trees = Vec::new();
    for node in Node::trees(wanted, None) {
        trees.extend(step(types, &node, root, "the message")?);
    }
    Ok(trees)
}

/// What `node` wants at a place of this kind, which `name` calls. None if nothing that is there and fits.
fn step(types: &Types, node: &Node, kind: Kind, name: &str) -> Result<Option<Step>, PlanError> {
    if let Some(leaf) = &node.leaf {
        return match misfit(types, kind, leaf.field) {
            None => Ok(Some(Step::Take {
                field: leaf.field,
                required: leaf.required,
            })),
            Some(what) if leaf.required => Err(PlanError::Path(format!("{name} {what}"))),
            Some(_) => Ok(None),
        };
    }
    match (kind, node.items.is_empty()) {
        (Kind::One(Element::Table(index) | Element::Struct(index)), true) => {
            fields(types, node, types.object(index))
        }
        (Kind::Vector(element) | Kind::Array(element, _), true) => {
            let each = step(types, node, Kind::One(element), name)?;
            Ok(each.map(|step| Step::Each(Box::new(step))))
        }
        (Kind::Vector(element) | Kind::Array(element, _), false) => {
            let mut ranges = Vec::new();
            for (range, child) in &node.items {
                let child = step(types, child, Kind::One(element), name)?;
                ranges.extend(child.map(|step| (range.clone(), step)));
            }
            Ok((!ranges.is_empty()).then_some(Step::Ranges(ranges)))
        }
        (_, wants_table) if is_required(node) => Err(PlanError::Path(format!(
            "{name} is no {}",
            if wants_table { "table" } else { "vector" }
        ))),
        _ => Ok(None),
    }
}

fn fields(types: &Types, node: &Node, object: &Object) -> Result<Option<Step>, PlanError> {
    let mut members = Vec::new();
    for (key, child) in &node.keys {
        let Some(index) = object.field(key) else {
            if is_required(child) {
                return Err(PlanError::Path(no_field(object, key)));
            }
            continue;
        };
        let name = format!("field {key:?} of {}", object.name);
        let child = step(types, child, object.fields[index].kind, &name)?;
        members.extend(child.map(|step| (index, step)));
    }
    Ok((!members.is_empty()).then_some(Step::Fields(members)))
}

fn no_field(object: &Object, key: &str) -> String {
    let there: Vec<&str> = object.fields.iter().map(|f| f.name.as_str()).collect();
    format!(
        "{} has no field {key:?}; it has {}",
        object.name,
        there.join(", ")
    )
}

fn is_required(node: &Node) -> bool {
    node.leaf.as_ref().is_some_and(|leaf| leaf.required)
        || node.keys.iter().any(|(_, child)| is_required(child))
        || node.items.iter().any(|(_, child)| is_required(child))
}

/// Why a field cannot be taken from a place of this kind.
fn misfit(types: &Types, kind: Kind, field: Field) -> Option<&'static str> {
    let scalar = match kind {
        Kind::One(Element::Scalar(scalar)) => Some(scalar),
        _ => None,
    };
    let is_text = kind == Kind::One(Element::Text);
    let fits = match field {
        Field::Values(_) => {
            return match numbers(types, kind, MAX_DEPTH, &mut Seen::new()) {
                Numbers::Some => None,
                Numbers::None => Some("holds no numbers"),
                Numbers::Recursive => {
                    Some("is of a type that holds itself: name the fields in it that are wanted")
                }
            };
        }
        Field::Names(_) => is_text || kind == Kind::Vector(Element::Text),
        Field::Episode { .. } => is_text || scalar.is_some_and(|s| s != Scalar::Bool),
        Field::Step | Field::StampSeconds | Field::StampNanos | Field::Reward => {
            scalar.is_some_and(|s| s != Scalar::Bool)
        }
        Field::EndFlag => scalar.is_some(),
    };
    (!fits).then_some("is of another type than what is wanted of it")
}

type Seen = BTreeMap<usize, Option<bool>>;

enum Numbers {
    Some,
    None,
    Recursive,
}

/// Are there numbers below? `seen` says it of the objects that are known already; of those that this place is in, nothing.
fn numbers(types: &Types, kind: Kind, depth: usize, seen: &mut Seen) -> Numbers {
    let (Kind::One(element) | Kind::Vector(element) | Kind::Array(element, _)) = kind else {
        return Numbers::None;
    };
    let index = match element {
        Element::Scalar(_) => return Numbers::Some,
        Element::Text => return Numbers::None,
        Element::Table(index) | Element::Struct(index) => index,
    };
    match seen.get(&index) {
        Some(Some(true)) => return Numbers::Some,
        Some(Some(false)) => return Numbers::None,
        Some(None) => return Numbers::Recursive,
        None => {}
    }
    let Some(depth) = depth.checked_sub(1) else {
        return Numbers::Recursive;
    };
    seen.insert(index, None);
    let mut has_numbers = false;
    for field in &types.object(index).fields {
        if is_never_a_leaf(types, &field.name, field.kind) {
            continue;
        }
        match numbers(types, field.kind, depth, seen) {
            Numbers::Some => has_numbers = true,
            Numbers::None => {}
            Numbers::Recursive => return Numbers::Recursive,
        }
    }
    seen.insert(index, Some(has_numbers));
    if has_numbers {
        Numbers::Some
    } else {
        Numbers::None
    }
}

/// A ROS header or the layout of a MultiArray: the same rule as for messages without a schema.
pub(super) fn is_never_a_leaf(types: &Types, name: &str, kind: Kind) -> bool {
    let has = |field| match kind {
        Kind::One(Element::Table(index) | Element::Struct(index)) => {
            types.object(index).field(field).is_some()
        }
        _ => false,
    };
    (name == "header" && has("stamp")) || (name == "layout" && has("dim"))
}
