//! JSON: one walk over the text beside the plan, numbers straight into the row.
//!
//! Our own walk rather than `serde_json`'s, which takes two to three times as long for a number. Both accept the same
//! texts and give the same numbers to the bit, which tests hold: every number becomes the nearest f64, ties to even;
//! one beyond f64 is refused where it is wanted. The limit of depth is `serde_json`'s.

mod error;
mod float;
mod number;
mod scan;
#[cfg(test)]
mod tests;
mod walk;

use serde::de::DeserializeSeed;

use self::error::is_nan_token;
use self::scan::Scanner;
use self::walk::{Scratch, Walk};
use super::DecodeError;
use super::plan::Node;
use super::row::Row;
use super::tree::ValueSeed;
use super::value::Value;

/// What is wanted of the messages of a channel, with buffers that are used again.
#[derive(Debug, Clone)]
pub(super) struct Json {
    trees: Vec<Node>,
    scratch: Scratch,
}

impl Json {
    pub(super) fn new(trees: Vec<Node>) -> Self {
        Self {
            trees,
            scratch: Scratch::default(),
        }
    }

    /// Walks `data`, once for each tree, and leaves the wanted fields in `row`.
    pub(super) fn decode(&mut self, data: &[u8], row: &mut Row) -> Result<(), DecodeError> {
        let Self { trees, scratch } = self;
        trees
            .iter()
            .try_for_each(|tree| decode(tree, data, row, scratch))
    }
}

fn decode(
    node: &Node,
    data: &[u8],
    row: &mut Row,
    scratch: &mut Scratch,
) -> Result<(), DecodeError> {
    let mut walk = Walk::new(Scanner::new(data), scratch);
    walk.message(node, row)
        .map_err(|stop| stop.into_decode_error(data, walk.offset()))
}

/// The whole message.
pub(super) fn value(data: &[u8]) -> Result<Value, DecodeError> {
    let mut json = serde_json::Deserializer::from_slice(data);
    ValueSeed
        .deserialize(&mut json)
        .and_then(|value| json.end().map(|()| value))
        .map_err(|e| error(data, &e))
}

/// An error without the place in the message, which differs from one to the next.
fn error(data: &[u8], e: &serde_json::Error) -> DecodeError {
    let line_start: usize = data
        .split_inclusive(|&b| b == b'\n')
        .take(e.line().saturating_sub(1))
        .map(<[u8]>::len)
        .sum();
    if e.is_syntax() && is_nan_token(data, (line_start + e.column()).saturating_sub(1)) {
        return DecodeError::NanToken;
    }
    let text = e.to_string();
    let what = text.split(" at line ").next().unwrap_or(&text).to_owned();
    if e.is_data() {
        DecodeError::WrongType(what)
    } else {
        DecodeError::Malformed {
            encoding: "JSON",
            what,
        }
    }
}
