//! Schemas and messages made by hand, and a slow, obvious reading of a path to hold plans against.

use prost_reflect::prost::Message as _;
use prost_reflect::prost_types::field_descriptor_proto::{Label, Type as Kind};
use prost_reflect::prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto,
    FileDescriptorProto, FileDescriptorSet, MessageOptions, OneofDescriptorProto,
};
use prost_reflect::{DynamicMessage, FieldDescriptor, MessageDescriptor, ReflectMessage as _};

use super::super::super::plan::{Access, Field, Node, Wanted};
use super::super::super::row::{ABSENT, Row};
use super::super::Plan;
use super::super::fields::{declared, is_explicit};
use super::super::schema::Type;
use crate::recording::decode::{DecodeError, PlanError};
use crate::recording::wire::Schema;

pub(super) fn field(name: &str, number: i32, kind: Kind) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        r#type: Some(kind.into()),
        label: Some(Label::Optional.into()),
        ..FieldDescriptorProto::default()
    }
}

pub(super) fn of_type(
    name: &str,
    number: i32,
    kind: Kind,
    type_name: &str,
) -> FieldDescriptorProto {
    FieldDescriptorProto {
        type_name: Some(type_name.to_owned()),
        ..field(name, number, kind)
    }
}

pub(super) fn nested(name: &str, number: i32, type_name: &str) -> FieldDescriptorProto {
    of_type(name, number, Kind::Message, type_name)
}

pub(super) fn repeated(field: FieldDescriptorProto) -> FieldDescriptorProto {
    FieldDescriptorProto {
        label: Some(Label::Repeated.into()),
        ..field
    }
}

pub(super) fn in_oneof(field: FieldDescriptorProto, index: i32) -> FieldDescriptorProto {
    FieldDescriptorProto {
        oneof_index: Some(index),
        ..field
    }
}

pub(super) fn message(
    name: &str,
    oneofs: &[&str],
    field: Vec<FieldDescriptorProto>,
) -> DescriptorProto {
    DescriptorProto {
        name: Some(name.to_owned()),
        field,
        oneof_decl: oneofs
            .iter()
            .map(|name| OneofDescriptorProto {
                name: Some((*name).to_owned()),
                options: None,
            })
            .collect(),
        ..DescriptorProto::default()
    }
}

pub(super) fn file(
    name: &str,
    package: &str,
    syntax: &str,
    message_type: Vec<DescriptorProto>,
) -> FileDescriptorProto {
    FileDescriptorProto {
        name: Some(name.to_owned()),
        package: Some(package.to_owned()),
        syntax: Some(syntax.to_owned()),
        message_type,
        ..FileDescriptorProto::default()
    }
}

pub(super) fn schema(name: &str, files: Vec<FileDescriptorProto>) -> Schema {
    Schema {
        id: 1,
        name: name.to_owned(),
        encoding: "protobuf".to_owned(),
        data: FileDescriptorSet { file: files }.encode_to_vec(),
    }
}

/// Every kind of scalar, of `shape`.
pub(super) const SCALARS: [Kind; 16] = [
    Kind::Double,
    Kind::Float,
    Kind::Int32,
    Kind::Int64,
    Kind::Uint32,
    Kind::Uint64,
    Kind::Sint32,
    Kind::Sint64,
    Kind::Fixed32,
    Kind::Fixed64,
    Kind::Sfixed32,
    Kind::Sfixed64,
    Kind::Bool,
    Kind::Enum,
    Kind::String,
    Kind::Bytes,
];

fn scalars(
    shape: impl Fn(FieldDescriptorProto) -> FieldDescriptorProto,
) -> Vec<FieldDescriptorProto> {
    (1..)
        .zip(SCALARS)
        .map(|(number, kind)| {
            let name = format!("f{number}");
            shape(if kind == Kind::Enum {
                of_type(&name, number, kind, ".t.Mode")
            } else {
                field(&name, number, kind)
            })
        })
        .collect()
}

/// Its fields are not declared in the order of their numbers.
fn step_type() -> DescriptorProto {
    let mut step = message(
        "Step",
        &["pick"],
        vec![
            repeated(field("action", 4, Kind::Double)),
            field("episode", 1, Kind::Int32),
            field("step", 2, Kind::Sint64),
            repeated(nested("joints", 3, ".t.Inner")),
            nested("pose", 7, ".t.Inner"),
            in_oneof(field("a", 8, Kind::Double), 0),
            in_oneof(nested("b", 9, ".t.Inner"), 0),
            in_oneof(field("c", 10, Kind::String), 0),
            field("terminated", 11, Kind::Bool),
            field("pixels", 12, Kind::Bytes),
            nested("one", 13, ".t.One"),
            nested("many", 14, ".t.Many"),
            repeated(nested("table", 100, ".t.Step.TableEntry")),
            nested("parent", 101, ".t.Step"),
            nested("header", 102, ".t.Header"),
            nested("stamp", 103, ".google.protobuf.Timestamp"),
            field("reward", 104, Kind::Float),
            repeated(field("names", 105, Kind::String)),
        ],
    );
    step.nested_type.push(DescriptorProto {
        options: Some(MessageOptions {
            map_entry: Some(true),
            ..MessageOptions::default()
        }),
        ..message(
            "TableEntry",
            &[],
            vec![
                field("key", 1, Kind::String),
                field("value", 2, Kind::Double),
            ],
        )
    });
    step
}

/// A step with one of everything.
pub(super) fn step_file() -> FileDescriptorProto {
    let inner = message(
        "Inner",
        &["_y"],
        vec![
            field("name", 4, Kind::String),
            field("x", 1, Kind::Double),
            FieldDescriptorProto {
                proto3_optional: Some(true),
                ..in_oneof(field("y", 2, Kind::Float), 0)
            },
            repeated(field("z", 3, Kind::Sint32)),
            nested("deep", 70, ".t.One"),
        ],
    );
    let header = message(
        "Header",
        &[],
        vec![
            nested("stamp", 1, ".google.protobuf.Timestamp"),
            field("seq", 2, Kind::Uint32),
        ],
    );
    let outer = message(
        "Outer",
        &[],
        vec![
            nested("header", 1, ".t.Header"),
            field("v", 2, Kind::Double),
        ],
    );
    let mut made = file(
        "t.proto",
        "t",
        "proto3",
        vec![
            inner,
            step_type(),
            header,
            outer,
            message("One", &[], scalars(|f| f)),
            message("Many", &[], scalars(repeated)),
        ],
    );
    made.dependency
        .push("google/protobuf/timestamp.proto".to_owned());
    made.enum_type.push(EnumDescriptorProto {
        name: Some("Mode".to_owned()),
        value: [("OFF", 0), ("ON", 1)]
            .map(|(name, number)| EnumValueDescriptorProto {
                name: Some(name.to_owned()),
                number: Some(number),
                options: None,
            })
            .into(),
        ..EnumDescriptorProto::default()
    });
    made
}

pub(super) fn step_schema() -> Schema {
    schema("t.Step", vec![step_file()])
}

/// `a.b` and `a[1:3]`.
pub(super) fn path(text: &str) -> Vec<Access> {
    text.split('.')
        .flat_map(|part| {
            let (name, range) = part
                .split_once('[')
                .map_or((part, None), |(n, r)| (n, Some(r)));
            let items = range.map(|range| {
                let (start, end) = range.trim_end_matches(']').split_once(':').unwrap();
                Access::Items(start.parse().unwrap()..end.parse().unwrap())
            });
            std::iter::once(Access::Key(name.to_owned())).chain(items)
        })
        .collect()
}

pub(super) fn want(text: &str, field: Field, required: bool) -> Wanted {
    Wanted {
        path: path(text),
        field,
        required,
    }
}

pub(super) fn plan(schema: &Schema, wanted: &[Wanted]) -> Result<Plan, PlanError> {
    Plan::compile(&Node::trees(wanted, None), Some(schema))
}

/// What a path of values gives for one message: the values, nothing, or an error.
pub(super) fn values(plan: &Plan, data: &[u8]) -> Result<Option<Vec<f64>>, DecodeError> {
    let mut row = Row::new(&["action"]);
    plan.decode(data, &mut row)?;
    Ok(row.targets[0].found.then(|| row.targets[0].values.clone()))
}

/// A message as the library reads it.
pub(super) fn reflected(schema: &Schema, data: &[u8]) -> Option<DynamicMessage> {
    let root = Type::of(Some(schema)).unwrap();
    DynamicMessage::decode(root.message, data).ok()
}

/// The values at `keys`, read the obvious way. `None`: not there.
pub(super) fn oracle(
    message: &DynamicMessage,
    keys: &[&str],
    in_array: bool,
    out: &mut Vec<f64>,
) -> Option<()> {
    let descriptor = message.descriptor();
    for (field, rest) in wanted_fields(&descriptor, keys) {
        let value = message.get_field(&field);
        if field.is_list() {
            for item in value.as_list().unwrap() {
                match item.as_message() {
                    Some(item) => oracle(item, rest, true, out)?,
                    None => numbers(item, out),
                }
            }
        } else if message.has_field(&field) || !may_be_missing(&field, in_array) {
            match value.as_message() {
                Some(value) => oracle(value, rest, in_array, out)?,
                None => numbers(&value, out),
            }
        } else if in_array {
            holes(&field, rest, out);
        } else {
            return None;
        }
    }
    Some(())
}

fn wanted_fields<'k>(
    message: &MessageDescriptor,
    keys: &'k [&'k str],
) -> Vec<(FieldDescriptor, &'k [&'k str])> {
    if let Some((key, rest)) = keys.split_first() {
        return vec![(message.get_field_by_name(key).unwrap(), rest)];
    }
    let mut fields: Vec<_> = message.fields().map(|f| (f, keys)).collect();
    fields.sort_by_key(|(f, _)| declared(f));
    fields
}

fn may_be_missing(field: &FieldDescriptor, in_array: bool) -> bool {
    if field.kind().as_message().is_some() {
        in_array || field.containing_oneof().is_some()
    } else {
        is_explicit(field)
    }
}

fn holes(field: &FieldDescriptor, keys: &[&str], out: &mut Vec<f64>) {
    let kind = field.kind();
    match kind.as_message() {
        None if kind == prost_reflect::Kind::String => {}
        None => out.push(ABSENT),
        Some(message) => {
            for (field, rest) in wanted_fields(message, keys) {
                if !field.is_list() {
                    holes(&field, rest, out);
                }
            }
        }
    }
}

fn numbers(value: &prost_reflect::Value, out: &mut Vec<f64>) {
    use prost_reflect::Value as V;
    match value {
        V::Bool(v) => out.push(f64::from(u8::from(*v))),
        V::I32(v) | V::EnumNumber(v) => out.push(f64::from(*v)),
        V::I64(v) => out.push(*v as f64),
        V::U32(v) => out.push(f64::from(*v)),
        V::U64(v) => out.push(*v as f64),
        V::F32(v) => out.push(f64::from(*v)),
        V::F64(v) => out.push(*v),
        V::Bytes(v) => out.extend(v.iter().map(|&b| f64::from(b))),
        _ => {}
    }
}
