//! FlatBuffers, with the binary schema (`.bfbs`) that the recording holds.
//!
//! Our own reader: the checked interface of the crate `flatbuffers-reflection` (0.1) gives no vector of tables, knows the
//! schema's root table only, panics on schemas with an index that leads nowhere, and makes a map per message.
//!
//! Numbers are taken in the order of the fields' ids. A union and what is in it is never taken, nor is a deprecated field.
//! A scalar that is not set has its default.

mod buffer;
mod compile;
mod schema;
#[cfg(test)]
mod tests;
mod value;
mod walk;

use std::ops::Range;

use self::buffer::{Budget, Buffer};
use self::schema::{Element, Kind, Types};
use self::walk::Walk;
use super::plan::{Field, Wanted};
use super::row::Row;
use super::{DecodeError, PlanError, Value};
use crate::recording::MAX_DEPTH;
use crate::recording::wire::Schema;

/// What to take of the messages of a schema.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    types: Types,
    root: usize,
    /// A walk each.
    trees: Vec<Step>,
}

/// What to do at a place of a message.
#[derive(Debug, Clone)]
enum Step {
    Take {
        field: Field,
        required: bool,
    },
    /// Go on in fields, each by its index in its object.
    Fields(Vec<(usize, Step)>),
    /// Do it in each element of a vector.
    Each(Box<Step>),
    /// Do it in some elements of a vector.
    Ranges(Vec<(Range<usize>, Step)>),
}

impl Plan {
    pub(super) fn compile(schema: Option<&Schema>, wanted: &[Wanted]) -> Result<Self, PlanError> {
        let (types, root) = types(schema)?;
        let trees = compile::trees(&types, root, wanted)?;
        Ok(Self { types, root, trees })
    }

    /// Leaves the wanted fields of `data` in `row`.
    pub(super) fn decode(&self, data: &[u8], row: &mut Row) -> Result<(), DecodeError> {
        let buffer = Buffer(data);
        let root = Kind::One(Element::Table(self.root));
        for step in &self.trees {
            let mut walk = Walk {
                types: &self.types,
                buffer,
                budget: Budget::of(data),
                row,
            };
            walk.step(step, root, 0, false)?;
        }
        Ok(())
    }
}

/// The whole message.
pub(super) fn value(
    schema: Option<&Schema>,
    data: &[u8],
) -> Result<Result<Value, DecodeError>, PlanError> {
    let (types, root) = types(schema)?;
    let mut reader = value::Reader {
        types: &types,
        buffer: Buffer(data),
        budget: Budget::of(data),
    };
    Ok(reader.element(Element::Table(root), 0, MAX_DEPTH))
}

fn types(schema: Option<&Schema>) -> Result<(Types, usize), PlanError> {
    let Some(schema) = schema else {
        return Err(PlanError::Schema {
            name: String::new(),
            encoding: String::new(),
            what: "a channel of FlatBuffers must have one".to_owned(),
        });
    };
    let unusable = |what: String| PlanError::Schema {
        name: schema.name.clone(),
        encoding: schema.encoding.clone(),
        what,
    };
    if !schema.encoding.eq_ignore_ascii_case("flatbuffer") {
        return Err(unusable("a binary FlatBuffers schema is needed".to_owned()));
    }
    let types = Types::parse(&schema.data).map_err(|e| unusable(e.to_string()))?;
    let root = types
        .table(&schema.name)
        .ok_or_else(|| unusable("it has no table of that name".to_owned()))?;
    Ok((types, root))
}
