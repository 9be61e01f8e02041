//! Fields and types in the words of errors, and those that are never taken.

use prost_reflect::{Cardinality, FieldDescriptor, Kind, MessageDescriptor};

use super::fields::declared;

/// Most fields of a type that an error lists.
const LISTED_FIELDS: usize = 20;

/// `message` has no field `key`, but others.
pub(super) fn no_field(message: &MessageDescriptor, key: &str) -> String {
    let mut fields: Vec<FieldDescriptor> = message.fields().collect();
    fields.sort_by_key(declared);
    let name = message.full_name();
    if fields.is_empty() {
        return format!("{name} has no field {key:?}: it has none at all");
    }
    let listed: Vec<&str> = fields
        .iter()
        .take(LISTED_FIELDS)
        .map(FieldDescriptor::name)
        .collect();
    let more = match fields.len().saturating_sub(LISTED_FIELDS) {
        0 => String::new(),
        n => format!(" and {n} more"),
    };
    format!(
        "{name} has no field {key:?}: it has {}{more}",
        listed.join(", ")
    )
}

/// The type of a field as its schema has it: `repeated double`.
pub(super) fn described(field: &FieldDescriptor) -> String {
    let kind = match field.kind() {
        Kind::Message(message) => message.full_name().to_owned(),
        Kind::Enum(kind) => format!("enum {}", kind.full_name()),
        // These print as the schema language calls them.
        scalar => format!("{scalar:?}"),
    };
    if field.cardinality() == Cardinality::Repeated {
        format!("repeated {kind}")
    } else {
        kind
    }
}

/// A ROS header or the layout of a `MultiArray`, told by type or by shape.
pub(super) fn is_never_a_leaf(field: &FieldDescriptor) -> bool {
    let kind = field.kind();
    let Some(message) = kind.as_message() else {
        return false;
    };
    let is_of = |name: &str| message.full_name().contains("std_msgs") && message.name() == name;
    is_of("Header")
        || is_of("MultiArrayLayout")
        || (field.name() == "header" && message.get_field_by_name("stamp").is_some())
        || (field.name() == "layout" && message.get_field_by_name("dim").is_some())
}
