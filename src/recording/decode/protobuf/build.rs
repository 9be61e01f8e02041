//! Puts the compiled fields of a message together.

use prost_reflect::FieldDescriptor;

use super::fields::{declared, is_explicit};
use super::plan::{Absent, FieldPlan, Message, Place, Slot, Take};
use super::scalar::Default;
use crate::recording::decode::plan::Field;

/// The plan of a message; `None` if nothing is wanted of it.
pub(super) fn build(mut plans: Vec<(FieldDescriptor, FieldPlan)>) -> Option<Message> {
    if plans.is_empty() {
        return None;
    }
    plans.sort_by_key(|(field, _)| declared(field));
    let mut slots: Vec<(u32, Slot)> = Vec::new();
    // A oneof with one member, as `optional` makes them, has nothing to displace.
    let mut oneofs: Vec<String> = Vec::new();
    for (index, (field, _)) in plans.iter().enumerate() {
        let oneof = field.containing_oneof().filter(|o| o.fields().len() > 1);
        let ordinal = oneof.map(|oneof| {
            let known = oneofs.iter().position(|name| name == oneof.full_name());
            known.unwrap_or_else(|| {
                let ordinal = oneofs.len();
                oneofs.push(oneof.full_name().to_owned());
                let members = oneof.fields().map(|member| {
                    let slot = Slot {
                        index: None,
                        oneof: Some(ordinal),
                    };
                    (member.number(), slot)
                });
                slots.extend(members);
                ordinal
            })
        });
        let slot = Slot {
            index: Some(index),
            oneof: ordinal,
        };
        // The member itself was put there among its siblings.
        slots.retain(|&(number, _)| number != field.number() || ordinal.is_none());
        slots.push((field.number(), slot));
    }
    let fields = plans.into_iter().map(|(_, plan)| plan).collect();
    Some(Message::new(fields, &slots))
}

/// What it means that a field which stands once is not in a message.
pub(super) fn absent(
    field: &FieldDescriptor,
    take: &Take,
    in_array: bool,
    is_flat: bool,
) -> Absent {
    let is_message = matches!(take, Take::Message(_));
    let may_be_missing = if is_message {
        in_array || field.containing_oneof().is_some()
    } else {
        is_explicit(field)
    };
    if !may_be_missing {
        return if is_message {
            Absent::Empty
        } else {
            Absent::Default(Default::of(field))
        };
    }
    if in_array {
        return Absent::Hole;
    }
    // Without it the values behind it would move up.
    match required(take, is_flat) {
        Some(field) => Absent::Refuse(field),
        None => Absent::Nothing,
    }
}

/// A field below that a message cannot do without.
fn required(take: &Take, any: bool) -> Option<Field> {
    match take {
        Take::Scalar {
            field, required, ..
        } => (*required || any).then_some(*field),
        Take::Bytes(_) => None,
        Take::Message(message) => message.fields.iter().find_map(|field| match &field.place {
            Place::One { take, .. } => required(take, any),
            Place::Many { parts, .. } => parts.iter().find_map(|(_, take)| required(take, any)),
        }),
    }
}
