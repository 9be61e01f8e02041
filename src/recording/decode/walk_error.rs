//! Why a walk of a binary message without a schema stopped, for the deserializers that are written here.

use std::fmt;

use serde::de::{self, Expected, Unexpected, Visitor};

use super::DecodeError;

/// An error of a walk, its text free of anything that differs from message to message.
#[derive(Debug)]
pub(super) enum WalkError {
    /// The bytes are not the encoding.
    Malformed(&'static str),
    /// They are, but not what is wanted.
    WrongType(String),
}

impl WalkError {
    /// The message ends too early.
    pub(super) const SHORT: Self = Self::Malformed("it ends in the middle of a value");
    pub(super) const TOO_DEEP: Self = Self::Malformed("it is nested too deeply");
    pub(super) const NOT_UTF8: Self = Self::Malformed("a text is not UTF-8");
    pub(super) const TRAILING: Self = Self::Malformed("bytes follow the message");

    /// A well-formed value that we do not know how to read.
    pub(super) fn unsupported(what: &str) -> Self {
        Self::WrongType(format!("{what} is not supported"))
    }

    /// Something else stands where the text that `expected` describes must stand.
    pub(super) fn no_text(expected: &dyn Expected) -> Self {
        Self::WrongType(format!("no text where {expected} is expected"))
    }

    pub(super) fn into_decode_error(self, encoding: &'static str) -> DecodeError {
        match self {
            Self::Malformed(what) => DecodeError::Malformed {
                encoding,
                what: what.to_owned(),
            },
            Self::WrongType(what) => DecodeError::WrongType(what),
        }
    }
}

impl fmt::Display for WalkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Malformed(what) => f.write_str(what),
            Self::WrongType(what) => f.write_str(what),
        }
    }
}

impl std::error::Error for WalkError {}

impl de::Error for WalkError {
    fn custom<T: fmt::Display>(text: T) -> Self {
        Self::WrongType(text.to_string())
    }

    /// Unlike `serde`'s own text this one leaves out the value that was found.
    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        let found = match found {
            Unexpected::Bool(_) => "a boolean",
            Unexpected::Unsigned(_) | Unexpected::Signed(_) | Unexpected::Float(_) => "a number",
            Unexpected::Str(_) | Unexpected::Char(_) => "text",
            Unexpected::Bytes(_) => "bytes",
            Unexpected::Unit | Unexpected::Option => "null",
            Unexpected::Seq => "an array",
            Unexpected::Map => "an object",
            _ => "a number beyond 64 bits",
        };
        Self::WrongType(format!("{found} where {expected} is expected"))
    }
}

/// What becomes of a well-formed value that we do not know how to read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unreadable {
    /// It is an error: a wanted field would be made of it.
    Refused,
    /// It is null: the message is looked at by people or by a plan, which may want other fields only.
    Null,
}

impl Unreadable {
    pub(super) fn or_null<'de, V: Visitor<'de>>(
        self,
        refusal: WalkError,
        visitor: V,
    ) -> Result<V::Value, WalkError> {
        match self {
            Self::Refused => Err(refusal),
            Self::Null => visitor.visit_unit(),
        }
    }
}
