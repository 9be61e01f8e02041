//! The message type that a channel's schema names, from its binary `FileDescriptorSet`.
//!
//! Only what shapes the wire is kept of a file: no options, extensions or services. It is less to go wrong, and
//! `prost-reflect` trusts some of it (imports that go round, enums without values), so a schema is held against a few
//! rules first.

use std::collections::{BTreeMap, BTreeSet};

use prost_reflect::prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumOptions, FileDescriptorProto, FileDescriptorSet,
};
use prost_reflect::{DescriptorPool, MessageDescriptor, prost::Message as _};

use crate::recording::decode::PlanError;
use crate::recording::wire::Schema;

/// A message type.
#[derive(Debug)]
pub(super) struct Type {
    pub(super) message: MessageDescriptor,
    /// Full names of the messages that stand for the entries of maps.
    maps: BTreeSet<String>,
}

/// Most files in a schema; robots have tens.
const MAX_FILES: usize = 4096;

impl Type {
    pub(super) fn of(schema: Option<&Schema>) -> Result<Self, PlanError> {
        let Some(schema) = schema else {
            return Err(PlanError::Schema {
                name: String::new(),
                encoding: "protobuf".to_owned(),
                what: "the channel has none".to_owned(),
            });
        };
        Self::parse(schema).map_err(|what| PlanError::Schema {
            name: schema.name.clone(),
            encoding: schema.encoding.clone(),
            what,
        })
    }

    fn parse(schema: &Schema) -> Result<Self, String> {
        if !schema.encoding.eq_ignore_ascii_case("protobuf") {
            return Err("protobuf messages need a schema of encoding \"protobuf\"".to_owned());
        }
        let set = FileDescriptorSet::decode(&*schema.data)
            .map_err(|_bytes| "it is not a FileDescriptorSet".to_owned())?;
        let mut files = complete(set.file)?;
        let mut maps = BTreeSet::new();
        for file in &mut files {
            clean(file, &mut maps)?;
        }
        let pool = DescriptorPool::from_file_descriptor_set(FileDescriptorSet { file: files })
            .map_err(|e| first_line(&e.to_string()))?;
        let message = pool
            .get_message_by_name(schema.name.trim_start_matches('.'))
            .ok_or("it does not have a message of this name")?;
        Ok(Self { message, maps })
    }

    pub(super) fn is_map_entry(&self, message: &MessageDescriptor) -> bool {
        self.maps.contains(message.full_name())
    }
}

fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().to_owned()
}

/// Adds the well-known types that are imported and left out, and gives every file all that it may name.
fn complete(files: Vec<FileDescriptorProto>) -> Result<Vec<FileDescriptorProto>, String> {
    let mut by_name: BTreeMap<String, FileDescriptorProto> = BTreeMap::new();
    for file in files {
        by_name.insert(file.name().to_owned(), file);
    }
    let known = DescriptorPool::global();
    let mut wanted: Vec<String> = by_name
        .values()
        .flat_map(|f| f.dependency.clone())
        .collect();
    while let Some(name) = wanted.pop() {
        if !by_name.contains_key(&name)
            && let Some(file) = known.get_file_by_name(&name)
        {
            let file = file.file_descriptor_proto().clone();
            wanted.extend(file.dependency.clone());
            by_name.insert(name, file);
        }
    }
    if by_name.len() > MAX_FILES {
        return Err(format!("it has more than {MAX_FILES} files"));
    }
    let imports: Vec<Vec<String>> = by_name.values().map(|f| imports(f, &by_name)).collect();
    for (file, imports) in by_name.values_mut().zip(imports) {
        file.dependency = imports;
        file.public_dependency.clear();
        file.weak_dependency.clear();
    }
    Ok(by_name.into_values().collect())
}

/// The files that `file` sees: its imports, and what these import publicly. Those that are not in the set may have
/// served options only; if not, the name that is missing will be told.
fn imports(
    file: &FileDescriptorProto,
    by_name: &BTreeMap<String, FileDescriptorProto>,
) -> Vec<String> {
    let mut seen = BTreeSet::new();
    let mut open: Vec<&str> = file.dependency.iter().map(String::as_str).collect();
    while let Some(name) = open.pop() {
        let Some(import) = by_name.get(name) else {
            continue;
        };
        if seen.insert(name) {
            let public = import.public_dependency.iter().filter_map(|&i| {
                let i = usize::try_from(i).ok()?;
                import.dependency.get(i).map(String::as_str)
            });
            open.extend(public);
        }
    }
    seen.remove(file.name());
    seen.into_iter().map(str::to_owned).collect()
}

/// Drops what does not shape the wire, and holds the rest against the rules that the library takes for granted.
fn clean(file: &mut FileDescriptorProto, maps: &mut BTreeSet<String>) -> Result<(), String> {
    if !matches!(file.syntax(), "" | "proto2" | "proto3") {
        return Err(format!(
            "its syntax is {:?}: only proto2 and proto3 are read",
            file.syntax()
        ));
    }
    let package = file.package().to_owned();
    if !package.is_empty() && !package.split('.').all(is_identifier) {
        return Err(format!("{package:?} is no package name"));
    }
    file.service.clear();
    file.extension.clear();
    file.options = None;
    file.source_code_info = None;
    file.enum_type.iter_mut().try_for_each(clean_enum)?;
    let mut messages = file.message_type.iter_mut();
    messages.try_for_each(|message| clean_message(message, &package, maps))
}

/// Recursion is bounded: the set was parsed with a limit of its own.
fn clean_message(
    message: &mut DescriptorProto,
    scope: &str,
    maps: &mut BTreeSet<String>,
) -> Result<(), String> {
    let name = message.name();
    if !is_identifier(name) {
        return Err(format!("{name:?} is no message name"));
    }
    let full_name = if scope.is_empty() {
        name.to_owned()
    } else {
        format!("{scope}.{name}")
    };
    if message.options.take().is_some_and(|o| o.map_entry()) {
        maps.insert(full_name.clone());
    }
    message.extension.clear();
    message.extension_range.clear();
    message.reserved_range.clear();
    message.reserved_name.clear();
    for field in &mut message.field {
        if !is_identifier(field.name()) {
            return Err(format!("{:?} is no field name", field.name()));
        }
        field.options = None;
    }
    for oneof in &mut message.oneof_decl {
        if !is_identifier(oneof.name()) {
            return Err(format!("{:?} is no name of a oneof", oneof.name()));
        }
        oneof.options = None;
    }
    message.enum_type.iter_mut().try_for_each(clean_enum)?;
    let mut nested = message.nested_type.iter_mut();
    nested.try_for_each(|message| clean_message(message, &full_name, maps))
}

fn clean_enum(kind: &mut EnumDescriptorProto) -> Result<(), String> {
    let name = kind.name();
    if !is_identifier(name) || kind.value.is_empty() {
        return Err(format!("{name:?} is no enum with a name and values"));
    }
    kind.reserved_range.clear();
    kind.reserved_name.clear();
    kind.options = Some(EnumOptions {
        allow_alias: Some(true),
        ..EnumOptions::default()
    });
    for value in &mut kind.value {
        if !is_identifier(value.name()) {
            return Err(format!("{:?} is no name of an enum's value", value.name()));
        }
        value.options = None;
    }
    Ok(())
}

fn is_identifier(name: &str) -> bool {
    let mut bytes = name.bytes();
    bytes
        .next()
        .is_some_and(|b| b.is_ascii_alphabetic() || b == b'_')
        && bytes.all(|b| b.is_ascii_alphanumeric() || b == b'_')
}
