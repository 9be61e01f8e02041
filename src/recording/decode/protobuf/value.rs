//! A message as a tree of values, by the library's own decoder: slow, general, and what tests hold the walk against.

use prost_reflect::{DynamicMessage, FieldDescriptor, ReflectMessage as _, Value as Reflected};

use super::fields::{declared, is_explicit};
use super::schema::Type;
use super::{DecodeError, malformed};
use crate::recording::decode::value::Value;

/// Decodes `data`. What is not there and has no default is null; the members are in the order of their declaration.
pub(super) fn value(root: &Type, data: &[u8]) -> Result<Value, DecodeError> {
    // The library bounds the depth. Its own text would differ from message to message.
    let message = DynamicMessage::decode(root.message.clone(), data)
        .map_err(|_detail| malformed("it does not fit its schema"))?;
    Ok(members(&message))
}

fn members(message: &DynamicMessage) -> Value {
    let descriptor = message.descriptor();
    let mut fields: Vec<FieldDescriptor> = descriptor.fields().collect();
    fields.sort_by_key(declared);
    let member = |field: &FieldDescriptor| {
        let value = if !message.has_field(field) && is_null_if_absent(field) {
            Value::Null
        } else {
            convert(&message.get_field(field))
        };
        (field.name().to_owned(), value)
    };
    Value::Map(fields.iter().map(member).collect())
}

fn is_null_if_absent(field: &FieldDescriptor) -> bool {
    field.kind().as_message().is_some() && !field.is_list() || is_explicit(field)
}

fn convert(value: &Reflected) -> Value {
    match value {
        Reflected::Bool(v) => Value::Bool(*v),
        Reflected::I32(v) | Reflected::EnumNumber(v) => Value::Integer((*v).into()),
        Reflected::I64(v) => Value::Integer((*v).into()),
        Reflected::U32(v) => Value::Integer((*v).into()),
        Reflected::U64(v) => Value::Integer((*v).into()),
        Reflected::F32(v) => Value::Number((*v).into()),
        Reflected::F64(v) => Value::Number(*v),
        Reflected::String(v) => Value::Text(v.clone()),
        Reflected::Bytes(v) => Value::Bytes(v.to_vec()),
        Reflected::Message(v) => members(v),
        Reflected::List(items) => Value::List(items.iter().map(convert).collect()),
        // Never: the schema was relieved of what makes maps of entries, so that they keep their order.
        Reflected::Map(_) => Value::Null,
    }
}
