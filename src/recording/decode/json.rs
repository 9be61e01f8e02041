//! JSON: `serde_json` walks the text (see `tree.rs`), numbers go straight into the row.
//!
//! Numbers are correctly rounded (feature `float_roundtrip`); integers beyond 2^53 become the nearest f64. The depth
//! limit of `serde_json` stays on.

use serde::de::DeserializeSeed;

use super::DecodeError;
use super::plan::Node;
use super::row::Row;
use super::tree::{NodeSeed, ValueSeed};
use super::value::Value;

/// Walks `data` and leaves the wanted fields in `row`.
pub(super) fn decode(node: &Node, data: &[u8], row: &mut Row) -> Result<(), DecodeError> {
    let mut json = serde_json::Deserializer::from_slice(data);
    NodeSeed {
        node,
        row,
        in_array: false,
    }
    .deserialize(&mut json)
    .and_then(|()| json.end())
    .map_err(|e| error(data, &e))
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
    if e.is_syntax() && is_nan_token(data, e) {
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

/// Does the parser stand at one of the tokens that Python writes for numbers that are not finite?
fn is_nan_token(data: &[u8], e: &serde_json::Error) -> bool {
    let line_start: usize = data
        .split_inclusive(|&b| b == b'\n')
        .take(e.line().saturating_sub(1))
        .map(<[u8]>::len)
        .sum();
    let at = line_start + e.column();
    (at.saturating_sub(2)..=at).any(|i| {
        data.get(i..)
            .is_some_and(|rest| rest.starts_with(b"NaN") || rest.starts_with(b"Infinity"))
    })
}
