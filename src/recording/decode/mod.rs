//! One message's payload to one [`Row`]: a plan says which fields are wanted, one file per encoding walks the bytes.
//!
//! No decoder builds a tree of values, and none allocates per message once its row's buffers have grown.

mod json;

use thiserror::Error;

/// What the wanted field of a message becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Field {
    /// Numeric leaves, appended to the action of the step.
    Action,
    /// Numeric leaves, appended to the state of the step.
    State,
    /// The episode's id; of several such fields the lowest rank counts.
    Episode { rank: u8 },
    /// The number of the step.
    Step,
    /// The reward.
    Reward,
    /// True on the last step of an episode.
    EndFlag,
}

/// Which fields of a message are wanted, as a tree of names.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Plan {
    pub(crate) field: Option<Field>,
    pub(crate) names: Vec<(String, Plan)>,
}

impl Plan {
    /// The fields of the native convention, and the names that simulators give the same things.
    pub(crate) fn native() -> Self {
        let leaf = |field| Self {
            field: Some(field),
            names: Vec::new(),
        };
        let names = [
            ("episode", Field::Episode { rank: 0 }),
            ("episode_id", Field::Episode { rank: 1 }),
            ("episode_index", Field::Episode { rank: 2 }),
            ("step", Field::Step),
            ("action", Field::Action),
            ("state", Field::State),
            ("reward", Field::Reward),
            ("terminated", Field::EndFlag),
            ("truncated", Field::EndFlag),
            ("done", Field::EndFlag),
        ];
        Self {
            field: None,
            names: names
                .into_iter()
                .map(|(name, field)| (name.to_owned(), leaf(field)))
                .collect(),
        }
    }
}

/// The episode a message says it belongs to; text stands in [`Row::id_text`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum RowId {
    #[default]
    None,
    Integer(i64),
    Text,
}

/// The values of one message. A decoder that fails leaves what it had read by then.
#[derive(Debug, Default)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each says whether one field was there"
)]
pub(crate) struct Row {
    pub(crate) action: Vec<f64>,
    pub(crate) state: Vec<f64>,
    pub(crate) id: RowId,
    pub(crate) id_text: String,
    id_rank: u8,
    pub(crate) step: Option<i64>,
    pub(crate) reward: Option<f64>,
    /// Any of the end flags was true.
    pub(crate) ended: bool,
    /// Any of the end flags was there.
    pub(crate) has_end_flag: bool,
    has_action: bool,
    has_state: bool,
}

impl Row {
    fn clear(&mut self) {
        self.action.clear();
        self.state.clear();
        self.id = RowId::None;
        self.id_text.clear();
        self.step = None;
        self.reward = None;
        self.ended = false;
        self.has_end_flag = false;
        self.has_action = false;
        self.has_state = false;
    }

    fn set_id_integer(&mut self, rank: u8, id: i64) {
        if self.id == RowId::None || rank < self.id_rank {
            (self.id, self.id_rank) = (RowId::Integer(id), rank);
        }
    }

    fn set_id_text(&mut self, rank: u8, id: &str) {
        if self.id == RowId::None || rank < self.id_rank {
            (self.id, self.id_rank) = (RowId::Text, rank);
            self.id_text.clear();
            self.id_text.push_str(id);
        }
    }

    /// Holds the row against what a step must have.
    fn check(&self) -> Result<(), DecodeError> {
        for (has, values, name) in [
            (self.has_action, &self.action, "action"),
            (self.has_state, &self.state, "state"),
        ] {
            if !has {
                return Err(DecodeError::Missing(name));
            }
            if values.is_empty() {
                return Err(DecodeError::Empty(name));
            }
            if values.len() > super::limits::MAX_VECTOR_WIDTH {
                return Err(DecodeError::TooWide(name));
            }
            if !values.iter().all(|v| v.is_finite()) {
                return Err(DecodeError::NotFinite(name));
            }
        }
        Ok(())
    }
}

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
    #[error("{0} is not finite")]
    NotFinite(&'static str),
    #[error("{0} is wider than any vector may be")]
    TooWide(&'static str),
    #[error("{0}")]
    WrongType(String),
}

/// Encodings that are decoded, for messages to the user.
pub(crate) const SUPPORTED: &str = "json";

/// A decoder compiled for one channel.
#[derive(Debug, Clone)]
pub(crate) enum Decoder {
    /// JSON text.
    Json(Plan),
}

impl Decoder {
    /// Compiles the native convention for an encoding; `None` if the encoding is not decoded.
    pub(crate) fn native(encoding: &str) -> Option<Self> {
        encoding
            .eq_ignore_ascii_case("json")
            .then(|| Self::Json(Plan::native()))
    }

    /// Decodes one message.
    pub(crate) fn decode(&self, data: &[u8], row: &mut Row) -> Result<(), DecodeError> {
        row.clear();
        match self {
            Self::Json(plan) => json::decode(plan, data, row)?,
        }
        row.check()
    }
}
