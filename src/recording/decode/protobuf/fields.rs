//! What a field's descriptor says of its place and its presence.

use prost_reflect::{Cardinality, FieldDescriptor, Syntax};

/// Where a field stands among those of its message.
pub(super) fn declared(field: &FieldDescriptor) -> i32 {
    field.path().last().copied().unwrap_or(0)
}

/// Does the schema tell apart "not there" and "has its default"? Of proto2 only where no default can be meant.
pub(super) fn is_explicit(field: &FieldDescriptor) -> bool {
    let is_plain_proto2 = field.parent_file().syntax() == Syntax::Proto2
        && field.cardinality() == Cardinality::Optional
        && field.containing_oneof().is_none();
    field.supports_presence() && !is_plain_proto2
}
