//! Why a walk of a JSON text stopped.

use thiserror::Error;

use crate::recording::decode::DecodeError;

/// What is not JSON. The words are those of `serde_json`, which reads the first message of a channel.
#[derive(Debug, Error, Clone, Copy, PartialEq, Eq)]
pub(super) enum Malformed {
    #[error("EOF while parsing a list")]
    EndInList,
    #[error("EOF while parsing an object")]
    EndInObject,
    #[error("EOF while parsing a string")]
    EndInString,
    #[error("EOF while parsing a value")]
    EndInValue,
    #[error("expected `:`")]
    ExpectedColon,
    #[error("expected ident")]
    ExpectedIdent,
    #[error("expected value")]
    ExpectedValue,
    #[error("expected `,` or `]`")]
    ListCommaOrEnd,
    #[error("expected `,` or `}}`")]
    ObjectCommaOrEnd,
    #[error("key must be a string")]
    KeyMustBeAString,
    #[error("trailing comma")]
    TrailingComma,
    #[error("trailing characters")]
    TrailingCharacters,
    #[error("invalid number")]
    InvalidNumber,
    #[error("number out of range")]
    NumberOutOfRange,
    #[error("control character (\\u0000-\\u001F) found while parsing a string")]
    ControlCharacter,
    #[error("invalid escape")]
    InvalidEscape,
    #[error("unexpected end of hex escape")]
    EndOfHexEscape,
    #[error("lone leading surrogate in hex escape")]
    LoneSurrogate,
    #[error("invalid unicode code point")]
    InvalidUnicode,
    #[error("recursion limit exceeded")]
    TooDeep,
}

impl Malformed {
    fn is_end(self) -> bool {
        matches!(
            self,
            Self::EndInList | Self::EndInObject | Self::EndInString | Self::EndInValue
        )
    }

    /// The error for a message that is malformed at `offset`.
    fn at(self, data: &[u8], offset: usize) -> DecodeError {
        if !self.is_end() && is_nan_token(data, offset) {
            return DecodeError::NanToken;
        }
        DecodeError::Malformed {
            encoding: "JSON",
            what: self.to_string(),
        }
    }
}

/// Does the scanner stand at one of the tokens that Python writes for numbers that are not finite?
pub(super) fn is_nan_token(data: &[u8], offset: usize) -> bool {
    (offset.saturating_sub(1)..=offset.saturating_add(1)).any(|i| {
        data.get(i..)
            .is_some_and(|rest| rest.starts_with(b"NaN") || rest.starts_with(b"Infinity"))
    })
}

/// Why a walk stopped.
#[derive(Debug)]
pub(super) enum Stop {
    Malformed(Malformed),
    /// It is JSON, but not what is wanted. Boxed, so that a result of the hot path is small.
    Unwanted(Box<DecodeError>),
}

impl Stop {
    pub(super) fn wrong_type(what: String) -> Self {
        DecodeError::WrongType(what).into()
    }

    pub(super) fn into_decode_error(self, data: &[u8], offset: usize) -> DecodeError {
        match self {
            Self::Malformed(malformed) => malformed.at(data, offset),
            Self::Unwanted(error) => *error,
        }
    }
}

impl From<Malformed> for Stop {
    fn from(malformed: Malformed) -> Self {
        Self::Malformed(malformed)
    }
}

impl From<DecodeError> for Stop {
    fn from(error: DecodeError) -> Self {
        Self::Unwanted(Box::new(error))
    }
}
