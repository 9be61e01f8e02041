//! The types of a message, from the text of its `.msg` definition and of those it depends on.
//!
//! The text is read as `rosidl` and `gendeps` write it: the definition itself, then for each dependency a line of `=`
//! and a line `MSG: package/Type`. Comments, constants and default values hold nothing that is on the wire.

use std::collections::BTreeMap;

use super::builtin;
use super::line::{self, Line};
use crate::recording::MAX_DEPTH;

/// Which ROS wrote the definition; the two differ in `byte`, `time`, `Header` and empty types.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Dialect {
    Ros1,
    Ros2,
}

/// A number on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Number {
    /// Bytes on the wire, which is also its alignment.
    pub(super) fn size(self) -> usize {
        match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Self::Bool | Self::F32 | Self::F64)
    }

    fn name(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::I8 => "int8",
            Self::U8 => "uint8",
            Self::I16 => "int16",
            Self::U16 => "uint16",
            Self::I32 => "int32",
            Self::U32 => "uint32",
            Self::I64 => "int64",
            Self::U64 => "uint64",
            Self::F32 => "float32",
            Self::F64 => "float64",
        }
    }
}

/// The type of a member, or of its elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Type {
    Number(Number),
    Text,
    WideText,
    /// Index into [`Types::structs`].
    Struct(usize),
}

/// How many of its type a member is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    One,
    Array(usize),
    /// Any number; a bound in the definition changes nothing on the wire.
    Sequence,
}

#[derive(Debug, Clone)]
pub(super) struct Member {
    pub(super) name: String,
    pub(super) ty: Type,
    pub(super) shape: Shape,
}

#[derive(Debug, Clone)]
pub(super) struct Struct {
    /// `package/Type`.
    pub(super) name: String,
    pub(super) members: Vec<Member>,
    /// Bytes that stand for no member: ROS 2 gives an empty type one.
    pub(super) padding: usize,
    /// Fewest bytes it takes on the wire, whatever the alignment.
    pub(super) min_size: usize,
    /// It holds what can be a leaf.
    pub(super) has_numbers: bool,
    depth: usize,
}

/// A message type and all that it is made of. Every struct comes behind those it holds.
#[derive(Debug, Clone)]
pub(super) struct Types {
    pub(super) structs: Vec<Struct>,
    pub(super) root: usize,
}

impl Types {
    /// Reads the definition `text` of the type `name`; without text it must be built in.
    pub(super) fn parse(name: &str, text: &str, dialect: Dialect) -> Result<Self, String> {
        let root = normalized(name);
        let mut builder = Builder {
            dialect,
            sections: sections(&root, text),
            full_names: BTreeMap::new(),
            states: BTreeMap::new(),
            structs: Vec::new(),
        };
        for full in builder.sections.keys() {
            let base = full.rsplit('/').next().unwrap_or(full).to_owned();
            builder
                .full_names
                .entry(base)
                .and_modify(|known| *known = None)
                .or_insert_with(|| Some(full.clone()));
        }
        let root = builder.resolve(&root, MAX_DEPTH)?;
        Ok(Self {
            structs: builder.structs,
            root,
        })
    }

    pub(super) fn has_numbers(&self, ty: Type) -> bool {
        match ty {
            Type::Number(_) => true,
            Type::Text | Type::WideText => false,
            Type::Struct(index) => self.structs[index].has_numbers,
        }
    }

    /// Fewest bytes of one such value.
    pub(super) fn min_size(&self, ty: Type) -> usize {
        min_size(&self.structs, ty)
    }

    /// A type as its definition names it.
    pub(super) fn describe(&self, ty: Type, shape: Shape) -> String {
        let base = match ty {
            Type::Number(number) => number.name(),
            Type::Text => "string",
            Type::WideText => "wstring",
            Type::Struct(index) => &self.structs[index].name,
        };
        match shape {
            Shape::One => base.to_owned(),
            Shape::Array(n) => format!("{base}[{n}]"),
            Shape::Sequence => format!("{base}[]"),
        }
    }
}

/// `package/Type`, also for what is written `package/msg/Type`.
fn normalized(name: &str) -> String {
    name.trim().replacen("/msg/", "/", 1)
}

fn min_size(structs: &[Struct], ty: Type) -> usize {
    match ty {
        Type::Number(number) => number.size(),
        Type::Text | Type::WideText => 4,
        Type::Struct(index) => structs[index].min_size,
    }
}

/// The definitions of a schema, by the names of their types.
fn sections<'t>(root: &str, text: &'t str) -> BTreeMap<String, Vec<&'t str>> {
    let mut sections = BTreeMap::new();
    let mut name = root.to_owned();
    let mut lines = Vec::new();
    let mut close = |name: &str, lines: Vec<&'t str>| {
        // An empty schema defines nothing; an empty dependency is an empty type.
        if lines.iter().any(|line| !line.is_empty()) {
            sections.entry(name.to_owned()).or_insert(lines);
        }
    };
    for line in text.lines() {
        let line = line.trim();
        if line.len() >= 3 && line.bytes().all(|b| b == b'=') {
            continue;
        }
        if let Some(next) = line.strip_prefix("MSG:") {
            close(&name, std::mem::take(&mut lines));
            name = normalized(next);
        }
        // The heading stays in, so that the section of an empty type is not empty.
        lines.push(line);
    }
    close(&name, lines);
    sections
}

enum State {
    /// Its members are being resolved.
    Open,
    Done(usize),
}

struct Builder<'t> {
    dialect: Dialect,
    sections: BTreeMap<String, Vec<&'t str>>,
    /// From the bare name of a type to its full one, if there is only one of that name.
    full_names: BTreeMap<String, Option<String>>,
    states: BTreeMap<String, State>,
    structs: Vec<Struct>,
}

impl Builder<'_> {
    fn resolve(&mut self, name: &str, depth_left: usize) -> Result<usize, String> {
        match self.states.get(name) {
            Some(State::Done(index)) => return Ok(*index),
            Some(State::Open) => return Err(format!("type {name:?} holds itself")),
            None => {}
        }
        let Some(depth_left) = depth_left.checked_sub(1) else {
            return Err("its types are nested too deep".to_owned());
        };
        let lines = match self.sections.get(name) {
            Some(lines) => lines.clone(),
            None => match builtin::definition(name, self.dialect) {
                Some(text) => text.lines().collect(),
                None => return Err(format!("type {name:?} is not defined")),
            },
        };
        self.states.insert(name.to_owned(), State::Open);
        let mut members = Vec::new();
        for text in lines {
            let Some(Line { base, shape, field }) = line::parse(text)? else {
                continue;
            };
            members.push(Member {
                name: field.to_owned(),
                ty: self.type_of(base, name, depth_left)?,
                shape,
            });
        }
        self.push(name, members)
    }

    fn push(&mut self, name: &str, members: Vec<Member>) -> Result<usize, String> {
        let padding = usize::from(members.is_empty() && self.dialect == Dialect::Ros2);
        let (mut min, mut depth, mut has_numbers) = (padding, 1, false);
        for member in &members {
            let one = min_size(&self.structs, member.ty);
            min = min.saturating_add(match member.shape {
                Shape::One => one,
                Shape::Array(n) => one.saturating_mul(n),
                Shape::Sequence => 4,
            });
            match member.ty {
                Type::Number(_) => has_numbers = true,
                Type::Text | Type::WideText => {}
                Type::Struct(index) => {
                    has_numbers |= self.structs[index].has_numbers;
                    depth = depth.max(self.structs[index].depth + 1);
                }
            }
        }
        if depth > MAX_DEPTH {
            return Err("its types are nested too deep".to_owned());
        }
        self.structs.push(Struct {
            name: name.to_owned(),
            members,
            padding,
            min_size: min,
            has_numbers: has_numbers && !is_never_a_leaf(name),
            depth,
        });
        let index = self.structs.len() - 1;
        self.states.insert(name.to_owned(), State::Done(index));
        Ok(index)
    }

    /// The type that a member of `owner` calls `base`.
    fn type_of(&mut self, base: &str, owner: &str, depth_left: usize) -> Result<Type, String> {
        let is_ros1 = self.dialect == Dialect::Ros1;
        Ok(match base {
            "bool" => Type::Number(Number::Bool),
            "byte" if is_ros1 => Type::Number(Number::I8),
            "byte" | "char" | "uint8" => Type::Number(Number::U8),
            "int8" => Type::Number(Number::I8),
            "int16" => Type::Number(Number::I16),
            "uint16" => Type::Number(Number::U16),
            "int32" => Type::Number(Number::I32),
            "uint32" => Type::Number(Number::U32),
            "int64" => Type::Number(Number::I64),
            "uint64" => Type::Number(Number::U64),
            "float32" => Type::Number(Number::F32),
            "float64" => Type::Number(Number::F64),
            "string" => Type::Text,
            "wstring" if !is_ros1 => Type::WideText,
            "time" | "duration" if is_ros1 => Type::Struct(self.resolve(base, depth_left)?),
            _ => {
                let full = self.full_name(base, owner);
                Type::Struct(self.resolve(&full, depth_left)?)
            }
        })
    }

    /// A type without a package is one of its owner's; `Header` is known everywhere, and some tools leave out the
    /// package of others.
    fn full_name(&self, base: &str, owner: &str) -> String {
        if base.contains('/') {
            return normalized(base);
        }
        let package = owner.rsplit_once('/').map_or("", |(package, _)| package);
        let near = format!("{package}/{base}");
        if self.sections.contains_key(&near) || builtin::definition(&near, self.dialect).is_some() {
            return near;
        }
        match self.full_names.get(base) {
            Some(Some(full)) => full.clone(),
            _ if base == "Header" => "std_msgs/Header".to_owned(),
            _ => near,
        }
    }
}

fn is_never_a_leaf(name: &str) -> bool {
    matches!(name, "std_msgs/Header" | "std_msgs/MultiArrayLayout")
}
