//! A message as a tree of values.

use super::buffer::{Budget, Buffer, Elements, malformed};
use super::schema::{Element, Kind, Number, Scalar, Types};
use crate::recording::decode::{DecodeError, Value};

pub(super) struct Reader<'r, 'b> {
    pub(super) types: &'r Types,
    pub(super) buffer: Buffer<'b>,
    pub(super) budget: Budget,
}

impl Reader<'_, '_> {
    pub(super) fn element(
        &mut self,
        element: Element,
        at: usize,
        depth: usize,
    ) -> Result<Value, DecodeError> {
        match element {
            Element::Scalar(scalar) => Ok(scalar.read(self.buffer, at)?.into()),
            Element::Text => {
                let text = self.buffer.text(at)?;
                self.budget.charge(text.len())?;
                Ok(Value::Text(text.to_owned()))
            }
            Element::Table(index) | Element::Struct(index) => {
                let is_table = matches!(element, Element::Table(_));
                self.object(index, is_table, at, depth)
            }
        }
    }

    fn object(
        &mut self,
        index: usize,
        is_table: bool,
        at: usize,
        depth: usize,
    ) -> Result<Value, DecodeError> {
        let depth = depth
            .checked_sub(1)
            .ok_or_else(|| malformed("it is nested too deeply"))?;
        let table = if is_table {
            Some(self.buffer.table(at)?)
        } else {
            None
        };
        let types = self.types;
        let mut members = Vec::new();
        for field in &types.object(index).fields {
            self.budget.charge(1)?;
            let place = match table {
                Some(table) => table.field(field.offset)?,
                None => Some(at + usize::from(field.offset)),
            };
            let value = match place {
                Some(at) => self.field(field.kind, at, depth)?,
                None => field.default.map_or(Value::Null, Value::from),
            };
            members.push((field.name.clone(), value));
        }
        Ok(Value::Map(members))
    }

    fn field(&mut self, kind: Kind, at: usize, depth: usize) -> Result<Value, DecodeError> {
        let (Elements { at, n }, element) = match kind {
            Kind::One(element) => return self.element(element, at, depth),
            Kind::Other => return Ok(Value::Null),
            Kind::Vector(element) => {
                let elements = self.buffer.elements(at, self.types.size(element))?;
                (elements, element)
            }
            Kind::Array(element, n) => {
                let n = usize::from(n);
                (Elements { at, n }, element)
            }
        };
        self.budget.charge(n)?;
        if element == Element::Scalar(Scalar::U8) {
            return Ok(Value::Bytes(self.buffer.bytes(at, n)?.to_vec()));
        }
        let size = self.types.size(element);
        (0..n)
            .map(|i| self.element(element, at + i * size, depth))
            .collect::<Result<_, _>>()
            .map(Value::List)
    }
}

impl From<Number> for Value {
    fn from(number: Number) -> Self {
        match number {
            Number::Bool(value) => Self::Bool(value),
            Number::Integer(value) => Self::Integer(value.into()),
            Number::Unsigned(value) => Self::Integer(value.into()),
            Number::Float(value) => Self::Number(value),
        }
    }
}
