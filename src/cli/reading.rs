//! Options that say which recordings are read and how: what commands that read them share.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::bytes::ByteSize;
use crate::recording::{
    Align, Clock, EpisodeOption, Limits, OnDamage, ReadOptions, Selector, parse_seconds,
};

/// More threads than any machine has cores would only take its memory.
const MAX_THREADS: usize = 1024;

/// As typed, or as written in a configuration file.
#[derive(Debug, Clone, Default, Args, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub(super) struct Reading {
    /// Recordings: files, folders (every *.mcap and *.mcap.zst below, rosbag2 directories), globs
    #[arg(value_name = "INPUT")]
    pub(super) inputs: Vec<PathBuf>,

    /// Where actions come from: TOPIC:PATH; repeatable, concatenated in order [default: found out]
    #[arg(long, value_name = "SELECTOR", help_heading = "Recordings")]
    #[serde(
        skip_serializing_if = "Vec::is_empty",
        deserialize_with = "one_or_many"
    )]
    action: Vec<Selector>,

    /// Where states come from: TOPIC:PATH; repeatable, concatenated in order [default: found out]
    #[arg(long, value_name = "SELECTOR", help_heading = "Recordings")]
    #[serde(
        skip_serializing_if = "Vec::is_empty",
        deserialize_with = "one_or_many"
    )]
    state: Vec<Selector>,

    /// auto, recording, field:SELECTOR, done:SELECTOR, marker:TOPIC or gap:SECONDS [default: auto]
    #[arg(long, value_name = "RULE", help_heading = "Recordings")]
    episodes: Option<EpisodeOption>,

    /// How states are put on the action's clock [default: before]
    #[arg(long, value_name = "HOW", value_parser = align_parser(), help_heading = "Recordings")]
    align: Option<Align>,

    /// Drop steps whose state is older than this [default: unlimited]
    #[arg(long, value_name = "SECONDS", help_heading = "Recordings")]
    max_age: Option<Seconds>,

    /// Which time of a message counts [default: log]
    #[arg(long, value_name = "CLOCK", value_parser = clock_parser(), help_heading = "Recordings")]
    clock: Option<Clock>,

    /// Damaged recordings: keep what is whole, or refuse them [default: recover]
    #[arg(long, value_name = "HOW", value_parser = on_damage_parser(), help_heading = "Recordings")]
    on_damage: Option<OnDamage>,

    /// Largest record that is looked into [default: 256MiB]
    #[arg(long, value_name = "BYTES", help_heading = "Limits")]
    max_record: Option<ByteSize>,

    /// Largest size of a chunk once inflated [default: 256MiB]
    #[arg(long, value_name = "BYTES", help_heading = "Limits")]
    max_chunk: Option<ByteSize>,

    /// Largest episode in memory [default: 4GiB]
    #[arg(long, value_name = "BYTES", help_heading = "Limits")]
    max_episode: Option<ByteSize>,

    /// Most episodes of a recording that are open at a time [default: 64]
    #[arg(long, value_name = "N", help_heading = "Limits")]
    max_open_episodes: Option<usize>,

    /// Threads; 0 = all cores [default: 0]
    #[arg(long, value_name = "N", help_heading = "Running")]
    threads: Option<usize>,
}

impl Reading {
    /// What is given here, else what is given there.
    pub(super) fn or(self, other: Self) -> Self {
        Self {
            inputs: or_if_empty(self.inputs, other.inputs),
            action: or_if_empty(self.action, other.action),
            state: or_if_empty(self.state, other.state),
            episodes: self.episodes.or(other.episodes),
            align: self.align.or(other.align),
            max_age: self.max_age.or(other.max_age),
            clock: self.clock.or(other.clock),
            on_damage: self.on_damage.or(other.on_damage),
            max_record: self.max_record.or(other.max_record),
            max_chunk: self.max_chunk.or(other.max_chunk),
            max_episode: self.max_episode.or(other.max_episode),
            max_open_episodes: self.max_open_episodes.or(other.max_open_episodes),
            threads: self.threads.or(other.threads),
        }
    }

    /// Every default written out.
    pub(super) fn filled(self) -> Self {
        let limits = Limits::default();
        Self {
            episodes: Some(self.episodes.unwrap_or_default()),
            align: Some(self.align.unwrap_or_default()),
            clock: Some(self.clock.unwrap_or_default()),
            on_damage: Some(self.on_damage.unwrap_or_default()),
            max_record: self.max_record.or(Some(ByteSize(limits.max_record))),
            max_chunk: self.max_chunk.or(Some(ByteSize(limits.max_chunk))),
            max_episode: self.max_episode.or(Some(ByteSize(limits.max_episode))),
            max_open_episodes: self.max_open_episodes.or(Some(limits.max_open_episodes)),
            threads: Some(self.threads.unwrap_or_default()),
            ..self
        }
    }

    /// Those that decide what is read from a recording.
    pub(super) fn relevant(&self) -> Self {
        Self {
            inputs: Vec::new(),
            threads: None,
            ..self.clone()
        }
    }

    /// Can this be done as asked?
    pub(super) fn check(&self) -> Result<(), String> {
        if self.inputs.is_empty() {
            return Err("no INPUT given: name files, folders or globs of recordings".to_owned());
        }
        self.check_numbers()
    }

    /// The same without what recordings are read.
    pub(super) fn check_numbers(&self) -> Result<(), String> {
        if self.max_open_episodes == Some(0) {
            return Err("max-open-episodes is 0: at least 1 is needed".to_owned());
        }
        if let Some(threads) = self.threads.filter(|&n| n > MAX_THREADS) {
            return Err(format!(
                "threads is {threads}: expected at most {MAX_THREADS}"
            ));
        }
        Ok(())
    }

    /// 0 stands for all cores.
    pub(super) fn threads(&self) -> usize {
        self.threads.unwrap_or_default()
    }

    fn limits(&self) -> Limits {
        let default = Limits::default();
        Limits {
            max_record: self.max_record.map_or(default.max_record, |b| b.0),
            max_chunk: self.max_chunk.map_or(default.max_chunk, |b| b.0),
            max_episode: self.max_episode.map_or(default.max_episode, |b| b.0),
            max_open_episodes: self.max_open_episodes.unwrap_or(default.max_open_episodes),
        }
    }

    pub(super) fn read_options(&self) -> ReadOptions {
        ReadOptions {
            limits: self.limits(),
            actions: self.action.clone(),
            states: self.state.clone(),
            episodes: self.episodes.clone().unwrap_or_default(),
            align: self.align.unwrap_or_default(),
            max_age_nanos: self.max_age.map(|s| s.0),
            clock: self.clock.unwrap_or_default(),
            on_damage: self.on_damage.unwrap_or_default(),
        }
    }
}

/// What is given, else what is given elsewhere.
fn or_if_empty<T>(given: Vec<T>, other: Vec<T>) -> Vec<T> {
    if given.is_empty() { other } else { given }
}

/// One selector may stand in a configuration file without brackets.
fn one_or_many<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Selector>, D::Error> {
    #[derive(Deserialize)]
    #[serde(
        untagged,
        expecting = "a selector or a list of selectors, each TOPIC:PATH"
    )]
    enum OneOrMany {
        One(Selector),
        Many(Vec<Selector>),
    }
    Ok(match OneOrMany::deserialize(deserializer)? {
        OneOrMany::One(selector) => vec![selector],
        OneOrMany::Many(selectors) => selectors,
    })
}

/// A time span, typed in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Seconds(i64);

impl FromStr for Seconds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        parse_seconds(text)
            .map(Self)
            .ok_or_else(|| format!("{text:?} is not a number of seconds"))
    }
}

impl Serialize for Seconds {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_f64(self.0 as f64 / 1e9)
    }
}

impl<'de> Deserialize<'de> for Seconds {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged, expecting = "a number of seconds")]
        enum Number {
            Integer(u32),
            Float(f64),
            Text(String),
        }
        let text = match Number::deserialize(deserializer)? {
            Number::Integer(n) => n.to_string(),
            Number::Float(x) => format!("{x}"),
            Number::Text(text) => text,
        };
        text.parse().map_err(serde::de::Error::custom)
    }
}

fn align_parser() -> impl TypedValueParser<Value = Align> {
    PossibleValuesParser::new(["before", "nearest", "index"]).map(|name| match name.as_str() {
        "nearest" => Align::Nearest,
        "index" => Align::Index,
        _ => Align::Before,
    })
}

fn clock_parser() -> impl TypedValueParser<Value = Clock> {
    PossibleValuesParser::new(["log", "publish", "header"]).map(|name| match name.as_str() {
        "publish" => Clock::Publish,
        "header" => Clock::Header,
        _ => Clock::Log,
    })
}

fn on_damage_parser() -> impl TypedValueParser<Value = OnDamage> {
    PossibleValuesParser::new(["recover", "fail"]).map(|name| match name.as_str() {
        "fail" => OnDamage::Fail,
        _ => OnDamage::Recover,
    })
}
