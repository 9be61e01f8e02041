//! Walks a message along the steps of a plan.

use super::Step;
use super::buffer::{Budget, Buffer, Elements, malformed};
use super::compile::is_never_a_leaf;
use super::schema::{Element, FieldType, Kind, Number, Types};
use crate::recording::MAX_DEPTH;
use crate::recording::decode::DecodeError;
use crate::recording::decode::plan::Field;
use crate::recording::decode::row::{ABSENT, Row, is_absent};
use crate::recording::limits::MAX_VECTOR_WIDTH;

pub(super) struct Walk<'w, 'b> {
    pub(super) types: &'w Types,
    pub(super) buffer: Buffer<'b>,
    pub(super) budget: Budget,
    pub(super) row: &'w mut Row,
}

impl Walk<'_, '_> {
    /// Does a step at the place `at`. In an array, a value that is not there is [`ABSENT`].
    pub(super) fn step(
        &mut self,
        step: &Step,
        kind: Kind,
        at: usize,
        in_array: bool,
    ) -> Result<(), DecodeError> {
        match step {
            Step::Take { field, .. } => self.take(*field, kind, at),
            Step::Fields(members) => {
                let Kind::One(element) = kind else {
                    return Ok(());
                };
                self.fields(members, element, at, in_array)
            }
            Step::Each(each) => {
                let (elements, element) = self.elements(kind, at)?;
                let size = self.types.size(element);
                for i in 0..elements.n {
                    self.budget.charge(1)?;
                    self.step(each, Kind::One(element), elements.at + i * size, true)?;
                }
                Ok(())
            }
            Step::Ranges(ranges) => {
                let (elements, element) = self.elements(kind, at)?;
                let size = self.types.size(element);
                for (range, step) in ranges {
                    for i in range.start..range.end.min(elements.n) {
                        self.budget.charge(1)?;
                        self.step(step, Kind::One(element), elements.at + i * size, true)?;
                    }
                }
                Ok(())
            }
        }
    }

    fn fields(
        &mut self,
        members: &[(usize, Step)],
        element: Element,
        at: usize,
        in_array: bool,
    ) -> Result<(), DecodeError> {
        let types = self.types;
        match element {
            Element::Struct(index) => {
                for (field, step) in members {
                    let field = &types.object(index).fields[*field];
                    self.step(step, field.kind, at + usize::from(field.offset), in_array)?;
                }
            }
            Element::Table(index) => {
                self.budget.charge(1)?;
                let table = self.buffer.table(at)?;
                for (field, step) in members {
                    let field = &types.object(index).fields[*field];
                    match table.field(field.offset)? {
                        Some(at) => self.step(step, field.kind, at, in_array)?,
                        None => self.unset(step, field, in_array)?,
                    }
                }
            }
            Element::Scalar(_) | Element::Text => {}
        }
        Ok(())
    }

    /// A field that is not set: its default, if it has one.
    fn unset(&mut self, step: &Step, of: &FieldType, in_array: bool) -> Result<(), DecodeError> {
        match (step, of.default) {
            (Step::Take { field, .. }, Some(number)) => self.number(*field, number),
            _ => self.absent(step, in_array),
        }
    }

    fn absent(&mut self, step: &Step, in_array: bool) -> Result<(), DecodeError> {
        match step {
            Step::Take {
                field: Field::Values(target),
                ..
            } if in_array => {
                self.row.values(*target).push(ABSENT);
                Ok(())
            }
            Step::Take { field, required } if *required => {
                Err(DecodeError::Missing(self.row.label(*field)))
            }
            Step::Fields(members) => members
                .iter()
                .try_for_each(|(_, step)| self.absent(step, in_array)),
            Step::Take { .. } | Step::Each(_) | Step::Ranges(_) => Ok(()),
        }
    }

    fn take(&mut self, field: Field, kind: Kind, at: usize) -> Result<(), DecodeError> {
        match (field, kind) {
            (Field::Values(_), _) => self.leaves(field, kind, at, MAX_DEPTH),
            (_, Kind::One(Element::Scalar(scalar))) => {
                self.number(field, scalar.read(self.buffer, at)?)
            }
            (_, Kind::One(Element::Text)) => self.text(field, at),
            (_, Kind::Vector(Element::Text)) => {
                let elements = self.buffer.elements(at, 4)?;
                (0..elements.n).try_for_each(|i| self.text(field, elements.at + 4 * i))
            }
            _ => Ok(()),
        }
    }

    fn text(&mut self, field: Field, at: usize) -> Result<(), DecodeError> {
        let text = self.buffer.text(at)?;
        self.budget.charge(1 + text.len())?;
        self.row.text(field, text)
    }

    fn number(&mut self, field: Field, number: Number) -> Result<(), DecodeError> {
        match (field, number) {
            (Field::Values(target), number) => {
                let value = number.as_f64();
                let values = self.row.values(target);
                if values.len() >= MAX_VECTOR_WIDTH {
                    return Err(DecodeError::TooWide(self.row.label(field)));
                }
                // A message may hold any NaN, also the one that stands for a value that is not there.
                values.push(if is_absent(value) { f64::NAN } else { value });
                Ok(())
            }
            (_, Number::Bool(value)) => self.row.boolean(field, value),
            (_, Number::Integer(value)) => self.row.integer(field, value),
            (_, Number::Unsigned(value)) => self.row.unsigned(field, value),
            (_, Number::Float(value)) => self.row.float(field, value),
        }
    }

    /// All numbers below a place.
    fn leaves(
        &mut self,
        field: Field,
        kind: Kind,
        at: usize,
        depth: usize,
    ) -> Result<(), DecodeError> {
        if let Field::Values(target) = field {
            // An empty vector is there all the same.
            self.row.values(target);
        }
        let depth = depth
            .checked_sub(1)
            .ok_or_else(|| malformed("it is nested too deeply"))?;
        match kind {
            Kind::One(Element::Scalar(scalar)) => self.number(field, scalar.read(self.buffer, at)?),
            Kind::One(Element::Text) | Kind::Vector(Element::Text) | Kind::Other => Ok(()),
            Kind::One(element @ (Element::Table(index) | Element::Struct(index))) => {
                self.leaves_of_object(field, element, index, at, depth)
            }
            Kind::Vector(_) | Kind::Array(..) => {
                let (elements, element) = self.elements(kind, at)?;
                let size = self.types.size(element);
                for i in 0..elements.n {
                    self.budget.charge(1)?;
                    self.leaves(field, Kind::One(element), elements.at + i * size, depth)?;
                }
                Ok(())
            }
        }
    }

    fn leaves_of_object(
        &mut self,
        field: Field,
        element: Element,
        index: usize,
        at: usize,
        depth: usize,
    ) -> Result<(), DecodeError> {
        self.budget.charge(1)?;
        let table = match element {
            Element::Table(_) => Some(self.buffer.table(at)?),
            _ => None,
        };
        let types = self.types;
        for member in &types.object(index).fields {
            if is_never_a_leaf(types, &member.name, member.kind) {
                continue;
            }
            let place = match table {
                Some(table) => table.field(member.offset)?,
                None => Some(at + usize::from(member.offset)),
            };
            match (place, member.kind, member.default) {
                (Some(at), ..) => self.leaves(field, member.kind, at, depth)?,
                (None, _, Some(number)) => self.number(field, number)?,
                // Without these the numbers behind would move to the front.
                (
                    None,
                    Kind::One(Element::Scalar(_) | Element::Table(_) | Element::Struct(_)),
                    _,
                ) => {
                    return Err(DecodeError::WrongType(format!(
                        "a field inside {} is not set",
                        self.row.label(field)
                    )));
                }
                (None, ..) => {}
            }
        }
        Ok(())
    }

    fn elements(&self, kind: Kind, at: usize) -> Result<(Elements, Element), DecodeError> {
        match kind {
            Kind::Vector(element) => {
                let elements = self.buffer.elements(at, self.types.size(element))?;
                Ok((elements, element))
            }
            Kind::Array(element, n) => {
                let n = usize::from(n);
                Ok((Elements { at, n }, element))
            }
            Kind::One(_) | Kind::Other => Err(malformed("a value where a vector is expected")),
        }
    }
}
