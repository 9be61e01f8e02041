//! What a user may ask of the reader: where actions, states and episodes come from, and how damage is taken.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use thiserror::Error;

use super::limits::Limits;
use super::selector::{Selector, SelectorError};

/// How recordings are read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Bounds on memory.
    pub limits: Limits,
    /// Where actions come from, concatenated in order; none: found out.
    pub actions: Vec<Selector>,
    /// Where states come from, concatenated in order; none: found out.
    pub states: Vec<Selector>,
    /// Where episodes begin and end.
    pub episodes: EpisodeOption,
    /// How states are put on the action's clock.
    pub align: Align,
    /// Oldest state that is used, nanoseconds; `None` for any age.
    pub max_age_nanos: Option<i64>,
    /// Which time counts.
    pub clock: Clock,
    /// What becomes of a damaged recording.
    pub on_damage: OnDamage,
}

/// How states are put on the action's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Align {
    /// The latest state at or before the action.
    #[default]
    Before,
    /// The state nearest in time, before or after; of two equally near the earlier.
    Nearest,
    /// The state of the same position in its topic.
    Index,
}

impl Align {
    /// As typed, and as it stands in the `recordings` table.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Before => "before",
            Self::Nearest => "nearest",
            Self::Index => "index",
        }
    }
}

/// Which time of a message counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Clock {
    /// When the recorder got it.
    #[default]
    Log,
    /// When it was published.
    Publish,
    /// The stamp inside the message (`header.stamp`, `timestamp`).
    Header,
}

impl Clock {
    /// As typed, and as it stands in the `recordings` table.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Log => "log",
            Self::Publish => "publish",
            Self::Header => "header",
        }
    }
}

/// What becomes of a damaged recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OnDamage {
    /// What is whole is used.
    #[default]
    Recover,
    /// The recording fails.
    Fail,
}

/// Where episodes begin and end.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum EpisodeOption {
    /// An episode field of the action's topic, else its end flags, else the recording.
    #[default]
    Auto,
    /// The recording is one episode.
    Recording,
    /// By the id in this field.
    Field(Selector),
    /// After each step on which this flag is true.
    Done(Selector),
    /// Each message on this topic starts one.
    Marker(String),
    /// A pause of the actions longer than this many nanoseconds starts one.
    Gap(i64),
}

/// Why a text names no episode rule.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum EpisodeOptionError {
    /// None of the forms.
    #[error(
        "{0:?} is no episode rule: auto, recording, field:SELECTOR, done:SELECTOR, marker:TOPIC or gap:SECONDS"
    )]
    Unknown(String),
    /// A selector that is none.
    #[error(transparent)]
    Selector(#[from] SelectorError),
    /// Not a number of seconds.
    #[error("{0:?} is not a number of seconds above 0")]
    Seconds(String),
}

impl FromStr for EpisodeOption {
    type Err = EpisodeOptionError;

    fn from_str(text: &str) -> Result<Self, EpisodeOptionError> {
        let unknown = || EpisodeOptionError::Unknown(text.chars().take(80).collect());
        Ok(match text.split_once(':') {
            None if text == "auto" => Self::Auto,
            None if text == "recording" => Self::Recording,
            Some(("field", selector)) => Self::Field(selector.parse()?),
            Some(("done", selector)) => Self::Done(selector.parse()?),
            Some(("marker", topic)) if !topic.is_empty() => Self::Marker(topic.to_owned()),
            Some(("gap", seconds)) => Self::Gap(
                parse_seconds(seconds)
                    .filter(|&nanos| nanos > 0)
                    .ok_or_else(|| EpisodeOptionError::Seconds(seconds.to_owned()))?,
            ),
            _ => return Err(unknown()),
        })
    }
}

/// Seconds, perhaps with a fraction, as nanoseconds; to the nanosecond for any decimal.
pub fn parse_seconds(text: &str) -> Option<i64> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits = |t: &str| t.bytes().all(|b| b.is_ascii_digit());
    if text.len() > 32 || !digits(whole) || !digits(fraction) || whole.len() + fraction.len() == 0 {
        return None;
    }
    let whole: i64 = if whole.is_empty() {
        0
    } else {
        whole.parse().ok()?
    };
    let nanos: String = fraction
        .chars()
        .chain("000000000".chars())
        .take(9)
        .collect();
    whole
        .checked_mul(1_000_000_000)?
        .checked_add(nanos.parse::<i64>().ok()?)
}

/// Nanoseconds as seconds, without zeros at the end.
pub fn format_seconds(nanos: i64) -> String {
    let text = format!("{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

impl fmt::Display for EpisodeOption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Recording => f.write_str("recording"),
            Self::Field(selector) => write!(f, "field:{selector}"),
            Self::Done(selector) => write!(f, "done:{selector}"),
            Self::Marker(topic) => write!(f, "marker:{topic}"),
            Self::Gap(nanos) => write!(f, "gap:{}", format_seconds(*nanos)),
        }
    }
}

impl Serialize for EpisodeOption {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for EpisodeOption {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?
            .parse()
            .map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_come_back_as_they_were_typed() {
        for text in [
            "auto",
            "recording",
            "field:/step:episode",
            "done:/step:done",
            "marker:/start",
            "gap:2.5",
            "gap:0.000000001",
        ] {
            assert_eq!(text.parse::<EpisodeOption>().unwrap().to_string(), text);
        }
        for text in [
            "", "gap:", "gap:0", "gap:-1", "gap:x", "gap:1e3", "marker:", "field:", "done", "x:1",
        ] {
            assert!(text.parse::<EpisodeOption>().is_err(), "{text}");
        }
        assert_eq!(parse_seconds("0.1"), Some(100_000_000));
        assert_eq!(parse_seconds("99999999999999999999"), None);
    }
}
