//! ROS messages: CDR (ROS 2) and the serialization of ROS 1.
//!
//! ```text
//! schema text ──schema──> Types ──plan──> Program ──run──> Row
//!                            └─────────────value────────> Value
//! ```
//!
//! A program is compiled for each layout that a channel's messages may have; the bytes before a CDR message say which
//! it is. Specifications: DDS-XTypes 1.3 (7.4); <http://wiki.ros.org/msg>, <https://design.ros2.org>.

mod builtin;
mod fit;
mod input;
mod layout;
mod line;
mod numbers;
mod plan;
mod program;
mod run;
mod schema;
mod texts;
mod value;

#[cfg(test)]
mod tests;

use layout::{CDR, Encapsulation, Layout, ROS1};
use program::Program;
use schema::{Dialect, Types};

use super::plan::Node;
use super::row::Row;
use super::value::Value;
use super::{DecodeError, ExampleError, PlanError};
use crate::recording::wire::{Channel, Schema};

/// A decoder of the messages of one channel.
#[derive(Debug, Clone)]
pub(super) struct Ros {
    dialect: Dialect,
    /// As [`layouts`] has them.
    variants: Vec<Variant>,
}

#[derive(Debug, Clone)]
struct Variant {
    layout: Layout,
    /// One for each tree.
    programs: Vec<Program>,
}

impl Ros {
    /// Compiles what is wanted of the messages of a channel of encoding `cdr` or `ros1`.
    pub(super) fn compile(
        channel: &Channel,
        schema: Option<&Schema>,
        trees: &[Node],
    ) -> Result<Self, PlanError> {
        let dialect = dialect(channel);
        let (types, schema) = types(dialect, schema)?;
        let mut variants = Vec::new();
        for layout in layouts(dialect) {
            let programs = trees
                .iter()
                .map(|tree| plan::compile(&types, layout, tree))
                .collect::<Result<_, _>>()
                .map_err(|e| e.plan_error(&schema.name, &schema.encoding))?;
            variants.push(Variant {
                layout: *layout,
                programs,
            });
        }
        Ok(Self { dialect, variants })
    }

    /// Leaves the wanted fields of one message in `row`.
    pub(super) fn decode(&mut self, data: &[u8], row: &mut Row) -> Result<(), DecodeError> {
        let (encapsulation, body) = split(self.dialect, data)?;
        let Variant { layout, programs } = &mut self.variants[encapsulation.variant];
        programs.iter_mut().try_for_each(|program| {
            if encapsulation.is_big_endian {
                run::run::<true>(program, layout, body, row)
            } else {
                run::run::<false>(program, layout, body, row)
            }
        })
    }
}

/// One message of a channel of encoding `cdr` or `ros1`.
pub(super) fn value(
    channel: &Channel,
    schema: Option<&Schema>,
    data: &[u8],
) -> Result<Value, ExampleError> {
    let dialect = dialect(channel);
    let (types, _) = types(dialect, schema)?;
    let (encapsulation, body) = split(dialect, data)?;
    let layout = &layouts(dialect)[encapsulation.variant];
    Ok(if encapsulation.is_big_endian {
        value::value::<true>(&types, layout, body)?
    } else {
        value::value::<false>(&types, layout, body)?
    })
}

fn dialect(channel: &Channel) -> Dialect {
    if channel.encoding.eq_ignore_ascii_case("ros1") {
        Dialect::Ros1
    } else {
        Dialect::Ros2
    }
}

fn layouts(dialect: Dialect) -> &'static [Layout] {
    match dialect {
        Dialect::Ros1 => &[ROS1],
        Dialect::Ros2 => &CDR,
    }
}

/// Which layout a message has, and where it starts.
fn split(dialect: Dialect, data: &[u8]) -> Result<(Encapsulation, &[u8]), DecodeError> {
    match dialect {
        Dialect::Ros1 => Ok((Encapsulation::default(), data)),
        Dialect::Ros2 => Encapsulation::split(data),
    }
}

/// The types of a channel's messages. Older recorders write the name of the type and no definition.
fn types(dialect: Dialect, schema: Option<&Schema>) -> Result<(Types, &Schema), PlanError> {
    let unusable = |schema: &Schema, what: String| PlanError::Schema {
        name: schema.name.clone(),
        encoding: schema.encoding.clone(),
        what,
    };
    let Some(schema) = schema else {
        return Err(PlanError::Schema {
            name: String::new(),
            encoding: String::new(),
            what: "the channel has none, and its messages cannot be read without".to_owned(),
        });
    };
    let expected = match dialect {
        Dialect::Ros1 => "ros1msg",
        Dialect::Ros2 => "ros2msg",
    };
    let is_empty = schema.data.trim_ascii().is_empty();
    if !(schema.encoding.eq_ignore_ascii_case(expected) || schema.encoding.is_empty() && is_empty) {
        return Err(unusable(schema, format!("only {expected} is read")));
    }
    let text = std::str::from_utf8(&schema.data)
        .ok()
        .ok_or_else(|| unusable(schema, "it is not UTF-8".to_owned()))?;
    match Types::parse(&schema.name, text, dialect) {
        Ok(types) => Ok((types, schema)),
        Err(_) if is_empty => {
            let what = "it is empty, and its type is not one that is built in".to_owned();
            Err(unusable(schema, what))
        }
        Err(what) => Err(unusable(schema, what)),
    }
}
