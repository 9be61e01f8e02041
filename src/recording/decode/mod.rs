//! One message's payload to one [`Row`]: a plan says which fields are wanted, one file per encoding walks the bytes.
//!
//! ```text
//! selectors ──> Wanted ──> Node (plan.rs) ──compile──> Decoder ──decode──> Row
//!                          a tree of names   once a channel      a message
//! ```
//!
//! Encodings with a schema (protobuf, ROS) compile the tree against it; the others walk it as it is. No decoder builds
//! a tree of values, and none allocates per message once its row's buffers have grown.

mod cbor;
#[cfg(feature = "flatbuffer")]
mod flatbuffer;
mod json;
mod msgpack;
mod plan;
mod protobuf;
mod ros;
mod row;
#[cfg(test)]
mod test_support;
mod tree;
mod value;
mod walk_error;

use thiserror::Error;

pub(crate) use plan::{Access, Field, Node, Wanted};
pub(crate) use row::{ABSENT, Head, Names, Row, RowId, Target, is_absent};
pub(crate) use value::Value;

use super::wire::{Channel, Schema};

/// Why a message gives no step. The text holds nothing that differs from message to message: it is counted by.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub(crate) enum DecodeError {
    #[error("not {encoding}: {what}")]
    Malformed {
        encoding: &'static str,
        what: String,
    },
    #[error("a NaN or Infinity token, which JSON does not have")]
    NanToken,
    #[error("{0} is missing")]
    Missing(&'static str),
    #[error("{0} is empty")]
    Empty(&'static str),
    #[error("{0} has fewer values than its selector takes")]
    TooNarrow(&'static str),
    #[error("{0} is not finite")]
    NotFinite(&'static str),
    #[error("{0} is wider than any vector may be")]
    TooWide(&'static str),
    #[error("{0}")]
    WrongType(String),
}

impl DecodeError {
    /// `found` stands where `field` is expected.
    fn wrong_type(found: &str, field: Field, row: &Row) -> Self {
        Self::WrongType(format!("{found} where {} is expected", row.label(field)))
    }
}

/// Why no decoder can be made for a channel.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub(crate) enum PlanError {
    #[error("encoding {encoding:?} is not supported ({SUPPORTED} are)")]
    Encoding { encoding: String },
    #[error("schema {name:?} ({encoding}) cannot be used: {what}")]
    Schema {
        name: String,
        encoding: String,
        what: String,
    },
    /// A wanted path that the schema does not have, or that holds no numbers.
    #[error("{0}")]
    Path(String),
}

/// Encodings that are decoded, for messages to the user.
pub(crate) const SUPPORTED: &str = if cfg!(feature = "flatbuffer") {
    "json, protobuf, cdr, ros1, cbor, msgpack and flatbuffer"
} else {
    "json, protobuf, cdr, ros1, cbor and msgpack; flatbuffer in a build with the feature \"flatbuffer\""
};

/// The encodings, each with what it needs to read a message.
#[derive(Debug, Clone)]
enum Walk {
    /// JSON text.
    Json(json::Json),
    /// CBOR.
    Cbor(Vec<Node>),
    /// MessagePack.
    MessagePack(Vec<Node>),
    /// FlatBuffers.
    #[cfg(feature = "flatbuffer")]
    FlatBuffer(flatbuffer::Plan),
    /// ROS 2 (CDR) and ROS 1.
    Ros(Box<ros::Ros>),
    /// Protobuf, with a schema.
    Protobuf(protobuf::Plan),
}

/// A decoder compiled for one channel.
#[derive(Debug, Clone)]
pub(crate) struct Decoder {
    walk: Walk,
}

impl Decoder {
    /// Compiles what is wanted of the messages of a channel. `example` is its first message, see [`example`].
    pub(crate) fn compile(
        channel: &Channel,
        schema: Option<&Schema>,
        wanted: &[Wanted],
        example: &Value,
    ) -> Result<Self, PlanError> {
        let encoding = channel.encoding.to_ascii_lowercase();
        let walk = match encoding.as_str() {
            "json" => Walk::Json(json::Json::new(Node::trees(wanted, Some(example)))),
            "cbor" => Walk::Cbor(Node::trees(wanted, Some(example))),
            "msgpack" | "messagepack" => Walk::MessagePack(Node::trees(wanted, Some(example))),
            #[cfg(feature = "flatbuffer")]
            "flatbuffer" => Walk::FlatBuffer(flatbuffer::Plan::compile(schema, wanted)?),
            "cdr" | "ros1" => {
                let trees = Node::trees(wanted, Some(example));
                Walk::Ros(Box::new(ros::Ros::compile(channel, schema, &trees)?))
            }
            "protobuf" => {
                let trees = Node::trees(wanted, None);
                Walk::Protobuf(protobuf::Plan::compile(&trees, schema)?)
            }
            _ => return Err(unsupported(channel)),
        };
        Ok(Self { walk })
    }

    /// Decodes one message.
    pub(crate) fn decode(&mut self, data: &[u8], row: &mut Row) -> Result<(), DecodeError> {
        row.clear();
        match &mut self.walk {
            Walk::Json(json) => json.decode(data, row)?,
            Walk::Cbor(trees) => trees
                .iter()
                .try_for_each(|tree| cbor::decode(tree, data, row))?,
            Walk::MessagePack(trees) => trees
                .iter()
                .try_for_each(|tree| msgpack::decode(tree, data, row))?,
            #[cfg(feature = "flatbuffer")]
            Walk::FlatBuffer(plan) => plan.decode(data, row)?,
            Walk::Ros(ros) => ros.decode(data, row)?,
            Walk::Protobuf(plan) => plan.decode(data, row)?,
        }
        row.check()
    }
}

fn unsupported(channel: &Channel) -> PlanError {
    PlanError::Encoding {
        encoding: channel.encoding.clone(),
    }
}

/// Why a message cannot be made a [`Value`].
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub(crate) enum ExampleError {
    /// No message of the channel can be read.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// This one cannot.
    #[error(transparent)]
    Message(#[from] DecodeError),
}

/// One message as a tree of values: for plans and for people, never in the hot path.
pub(crate) fn example(
    channel: &Channel,
    schema: Option<&Schema>,
    data: &[u8],
) -> Result<Value, ExampleError> {
    let encoding = channel.encoding.to_ascii_lowercase();
    Ok(match encoding.as_str() {
        "json" => json::value(data)?,
        "cbor" => cbor::value(data)?,
        "msgpack" | "messagepack" => msgpack::value(data)?,
        #[cfg(feature = "flatbuffer")]
        "flatbuffer" => flatbuffer::value(schema, data)??,
        "cdr" | "ros1" => ros::value(channel, schema, data)?,
        "protobuf" => protobuf::value(schema, data)?,
        _ => return Err(unsupported(channel).into()),
    })
}
