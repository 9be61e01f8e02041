//! Protobuf: a plan compiled against the channel's descriptor, and a walk of the wire for the chosen fields.
//!
//! ```text
//! FileDescriptorSet ──schema──> message type ──compile──> plan ──walk──> Row
//! ```
//!
//! Values come in the order in which the schema declares their fields, whatever the order on the wire. What a message
//! leaves out has its default, unless the schema tells apart "not there" (`optional`, members of a oneof, messages in
//! arrays): then it is not found, and in an array [`ABSENT`](super::row::ABSENT).

mod build;
mod compile;
mod describe;
mod fields;
mod merge;
mod plan;
mod scalar;
mod schema;
#[cfg(test)]
mod tests;
mod value;
mod walk;
mod wire;

use super::plan::Node;
use super::row::Row;
use super::value::Value;
use super::{DecodeError, ExampleError, PlanError};
use crate::recording::wire::Schema;
use schema::Type;
use walk::{Stop, Walk};

/// What is wanted of the messages of one channel.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    trees: Vec<plan::Message>,
}

impl Plan {
    /// Compiles what `trees` want against the schema of a channel.
    pub(super) fn compile(trees: &[Node], schema: Option<&Schema>) -> Result<Self, PlanError> {
        let root = Type::of(schema)?;
        let trees = trees
            .iter()
            .map(|tree| compile::compile(&root, tree))
            .filter_map(Result::transpose)
            .collect::<Result<_, _>>()?;
        Ok(Self { trees })
    }

    /// Walks `data` and leaves the wanted fields in `row`.
    pub(super) fn decode(&self, data: &[u8], row: &mut Row) -> Result<(), DecodeError> {
        match self.walk(data, row, false) {
            Ok(()) => Ok(()),
            Err(Stop::Error(e)) => Err(e),
            Err(Stop::Disorder) => {
                row.clear();
                match self.walk(data, row, true) {
                    Ok(()) => Ok(()),
                    Err(Stop::Error(e)) => Err(e),
                    // Never: a walk that merges takes any order.
                    Err(Stop::Disorder) => Err(malformed("its fields are not in order")),
                }
            }
        }
    }

    fn walk(&self, data: &[u8], row: &mut Row, is_merging: bool) -> Result<(), Stop> {
        let mut walk = Walk { row, is_merging };
        self.trees
            .iter()
            .try_for_each(|tree| walk.message(tree, data))
    }
}

/// The whole message.
pub(super) fn value(schema: Option<&Schema>, data: &[u8]) -> Result<Value, ExampleError> {
    let root = Type::of(schema)?;
    Ok(value::value(&root, data)?)
}

fn malformed(what: &str) -> DecodeError {
    DecodeError::Malformed {
        encoding: "protobuf",
        what: what.to_owned(),
    }
}
