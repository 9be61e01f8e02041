//! The types of a binary schema (`.bfbs`), which is a FlatBuffer itself: the fields that we need of `reflection.fbs`.

use super::buffer::{Budget, Buffer, Table};
use crate::recording::decode::DecodeError;

/// Tables and structs.
#[derive(Debug, Clone)]
pub(super) struct Types {
    objects: Vec<Object>,
}

#[derive(Debug, Clone)]
pub(super) struct Object {
    pub(super) name: String,
    /// In the order of their ids.
    pub(super) fields: Vec<FieldType>,
    is_struct: bool,
    n_bytes: usize,
}

#[derive(Debug, Clone)]
pub(super) struct FieldType {
    pub(super) name: String,
    pub(super) kind: Kind,
    /// In a table, the place in its list of offsets; in a struct, where its bytes are.
    pub(super) offset: u16,
    /// What a scalar is that is not set; nothing if it is optional.
    pub(super) default: Option<Number>,
    id: u16,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    One(Element),
    Vector(Element),
    /// An array of fixed length in a struct.
    Array(Element, u16),
    /// A union, or what came to the format later.
    Other,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Element {
    Scalar(Scalar),
    Text,
    /// The indices are those of objects that exist.
    Table(usize),
    Struct(usize),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
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

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Number {
    Bool(bool),
    Integer(i64),
    Unsigned(u64),
    Float(f64),
}

impl Number {
    pub(super) fn as_f64(self) -> f64 {
        match self {
            Self::Bool(value) => f64::from(u8::from(value)),
            Self::Integer(value) => value as f64,
            Self::Unsigned(value) => value as f64,
            Self::Float(value) => value,
        }
    }
}

impl Types {
    pub(super) fn parse(bfbs: &[u8]) -> Result<Self, DecodeError> {
        let root = Buffer(bfbs).root()?;
        let tables = tables(&root, 4)?;
        let shapes = tables
            .iter()
            .map(|table| Ok(scalar(table, 8, u8::from_le_bytes)? != 0))
            .collect::<Result<Vec<bool>, DecodeError>>()?;
        let mut budget = Budget::of(bfbs);
        let objects = tables
            .iter()
            .zip(&shapes)
            .map(|(table, &is_struct)| Object::parse(table, is_struct, &shapes, &mut budget))
            .collect::<Result<_, _>>()?;
        Ok(Self { objects })
    }

    /// The table `name`, or the only one whose name without its namespace is this.
    pub(super) fn table(&self, name: &str) -> Option<usize> {
        let tables = || (0..self.objects.len()).filter(|&i| !self.objects[i].is_struct);
        let mut short = tables().filter(|&i| {
            let full = self.objects[i].name.as_str();
            full.rsplit('.').next() == Some(name)
        });
        tables()
            .find(|&i| self.objects[i].name == name)
            .or_else(|| short.next().filter(|_| short.next().is_none()))
    }

    pub(super) fn object(&self, index: usize) -> &Object {
        &self.objects[index]
    }

    /// Bytes of an element inside a vector, a table or a struct.
    pub(super) fn size(&self, element: Element) -> usize {
        match element {
            Element::Scalar(scalar) => scalar.size(),
            Element::Text | Element::Table(_) => 4,
            Element::Struct(index) => self.objects[index].n_bytes,
        }
    }
}

impl Object {
    fn parse(
        table: &Table,
        is_struct: bool,
        shapes: &[bool],
        budget: &mut Budget,
    ) -> Result<Self, DecodeError> {
        let mut fields = Vec::new();
        for field in tables(table, 6)? {
            budget.charge(1)?;
            // A field that is deprecated has no accessor and is never written.
            if scalar(&field, 16, u8::from_le_bytes)? == 0 {
                fields.push(FieldType::parse(&field, shapes, budget)?);
            }
        }
        // They are written in the order of their names.
        fields.sort_by_key(|field| field.id);
        Ok(Self {
            name: text(table, 4, budget)?,
            fields,
            is_struct,
            n_bytes: usize::try_from(scalar(table, 12, i32::from_le_bytes)?).unwrap_or(0),
        })
    }

    pub(super) fn field(&self, name: &str) -> Option<usize> {
        self.fields.iter().position(|field| field.name == name)
    }
}

impl FieldType {
    fn parse(field: &Table, shapes: &[bool], budget: &mut Budget) -> Result<Self, DecodeError> {
        let kind = match field.field(6)? {
            Some(at) => Kind::parse(&field.buffer().table(at)?, shapes)?,
            None => Kind::Other,
        };
        let is_optional = scalar(field, 26, u8::from_le_bytes)? != 0;
        let default = match kind {
            Kind::One(Element::Scalar(kind)) if !is_optional => {
                let integer = scalar(field, 12, i64::from_le_bytes)?;
                Some(match kind {
                    Scalar::Bool => Number::Bool(integer != 0),
                    Scalar::U64 => Number::Unsigned(integer.cast_unsigned()),
                    Scalar::F32 | Scalar::F64 => {
                        Number::Float(scalar(field, 14, f64::from_le_bytes)?)
                    }
                    _ => Number::Integer(integer),
                })
            }
            _ => None,
        };
        Ok(Self {
            name: text(field, 4, budget)?,
            kind,
            offset: scalar(field, 10, u16::from_le_bytes)?,
            default,
            id: scalar(field, 8, u16::from_le_bytes)?,
        })
    }
}

impl Kind {
    fn parse(kind: &Table, shapes: &[bool]) -> Result<Self, DecodeError> {
        let base = scalar(kind, 4, u8::from_le_bytes)?;
        let element = scalar(kind, 6, u8::from_le_bytes)?;
        // The default is -1, which a FlatBuffer leaves out.
        let index = match kind.field(8)? {
            Some(at) => usize::try_from(i32::from_le_bytes(kind.buffer().array(at)?)).ok(),
            None => None,
        };
        let element_of = |base| Element::of(base, index, shapes);
        Ok(match base {
            14 => element_of(element).map_or(Self::Other, Self::Vector),
            17 => {
                let len = scalar(kind, 10, u16::from_le_bytes)?;
                element_of(element).map_or(Self::Other, |element| Self::Array(element, len))
            }
            base => element_of(base).map_or(Self::Other, Self::One),
        })
    }
}

impl Element {
    /// Numbers are those of `BaseType` in `reflection.fbs`.
    fn of(base: u8, index: Option<usize>, shapes: &[bool]) -> Option<Self> {
        Some(Self::Scalar(match base {
            2 => Scalar::Bool,
            3 => Scalar::I8,
            4 => Scalar::U8,
            5 => Scalar::I16,
            6 => Scalar::U16,
            7 => Scalar::I32,
            8 => Scalar::U32,
            9 => Scalar::I64,
            10 => Scalar::U64,
            11 => Scalar::F32,
            12 => Scalar::F64,
            13 => return Some(Self::Text),
            15 => {
                let index = index?;
                return Some(if *shapes.get(index)? {
                    Self::Struct(index)
                } else {
                    Self::Table(index)
                });
            }
            _ => return None,
        }))
    }
}

impl Scalar {
    pub(super) fn size(self) -> usize {
        match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    pub(super) fn read(self, buffer: Buffer, at: usize) -> Result<Number, DecodeError> {
        Ok(match self {
            Self::Bool => Number::Bool(buffer.array(at)? != [0]),
            Self::I8 => Number::Integer(i8::from_le_bytes(buffer.array(at)?).into()),
            Self::U8 => Number::Integer(u8::from_le_bytes(buffer.array(at)?).into()),
            Self::I16 => Number::Integer(i16::from_le_bytes(buffer.array(at)?).into()),
            Self::U16 => Number::Integer(u16::from_le_bytes(buffer.array(at)?).into()),
            Self::I32 => Number::Integer(i32::from_le_bytes(buffer.array(at)?).into()),
            Self::U32 => Number::Integer(u32::from_le_bytes(buffer.array(at)?).into()),
            Self::I64 => Number::Integer(i64::from_le_bytes(buffer.array(at)?)),
            Self::U64 => Number::Unsigned(u64::from_le_bytes(buffer.array(at)?)),
            Self::F32 => Number::Float(f32::from_le_bytes(buffer.array(at)?).into()),
            Self::F64 => Number::Float(f64::from_le_bytes(buffer.array(at)?)),
        })
    }
}

/// A scalar of a table of the schema; zero if it is not set.
fn scalar<T: Default, const N: usize>(
    table: &Table,
    slot: u16,
    read: fn([u8; N]) -> T,
) -> Result<T, DecodeError> {
    match table.field(slot)? {
        Some(at) => Ok(read(table.buffer().array(at)?)),
        None => Ok(T::default()),
    }
}

fn text(table: &Table, slot: u16, budget: &mut Budget) -> Result<String, DecodeError> {
    let Some(at) = table.field(slot)? else {
        return Ok(String::new());
    };
    let text = table.buffer().text(at)?;
    budget.charge(text.len())?;
    Ok(text.to_owned())
}

fn tables<'b>(table: &Table<'b>, slot: u16) -> Result<Vec<Table<'b>>, DecodeError> {
    let Some(at) = table.field(slot)? else {
        return Ok(Vec::new());
    };
    let buffer = table.buffer();
    let elements = buffer.elements(at, 4)?;
    (0..elements.n)
        .map(|i| buffer.table(elements.at + 4 * i))
        .collect()
}
