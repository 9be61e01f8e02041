//! `coact extract`: its options, the configuration file that may hold the same, and what both come to.

use std::path::PathBuf;
use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::bytes::ByteSize;
use super::progress::When;
use crate::extraction::{ExtractionParams, Measure, Profile, RawParams};
use crate::model::JointMode;
use crate::pipeline::{Config, DEFAULT_MAX_PART_ROWS};
use crate::recording::{
    Align, Clock, EpisodeOption, Limits, OnDamage, ReadOptions, Selector, parse_seconds,
};

const EXAMPLES: &str = "\
Examples:
  coact extract fixtures -o out                     every recording below a folder
  coact extract run1.mcap 'logs/*.mcap' -o out      files and globs
  coact extract logs -o out --measure shannon --window 8 --threshold 0.3
  coact extract logs -o out --joints together --steps none
  coact extract bags -o out --action /command:data --state /joint_states:position
  coact extract logs -o out --events events         for Foxglove, Lichtblick or Rerun, too
  coact extract logs --dry-run                      read and check everything, write nothing
  coact extract --config run.toml -o out            options from a file; the command line wins

Exit codes:
  0  done (also with episodes that are too short)
  1  failed: no episode came out, or the output cannot be written
  2  bad arguments
  3  done, but a recording failed or was recovered, a message was refused, or an episode is incomplete
  130, 143  interrupted (Ctrl-C, SIGTERM); the same command goes on";

/// More threads than any machine has cores would only take its memory.
const MAX_THREADS: usize = 1024;

/// Arguments of `coact extract`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ExtractArgs {
    #[command(flatten)]
    options: Options,

    /// Take options from a TOML file; the command line wins
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,

    /// Print the options that would be used as TOML, and stop
    #[arg(long)]
    print_config: bool,
}

/// How the closing summary is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SummaryFormat {
    /// A table for people
    #[default]
    Text,
    /// One JSON object
    Json,
}

/// Whether the per-step table is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Steps {
    /// Write it
    #[default]
    Full,
    /// No such folder
    None,
}

/// Every option, as typed or as written in a configuration file.
#[derive(Debug, Clone, Default, Args, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag")]
struct Options {
    /// Recordings: files, folders (every *.mcap and *.mcap.zst below, rosbag2 directories), globs
    #[arg(value_name = "INPUT")]
    inputs: Vec<PathBuf>,

    /// Directory for the tables
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,

    /// Measure of change [default: earth-mover]
    #[arg(long, value_name = "NAME", value_parser = measure_parser(), help_heading = "Method")]
    measure: Option<Measure>,

    /// `paper`: the equations; `authors`: what the authors' program does [default: paper]
    #[arg(long, value_name = "NAME", value_parser = profile_parser(), help_heading = "Method")]
    profile: Option<Profile>,

    /// Bins per column, b [default: 64]
    #[arg(long, value_name = "N", help_heading = "Method")]
    bins: Option<usize>,

    /// Window in steps, w [default: 5]
    #[arg(long, value_name = "N", help_heading = "Method")]
    window: Option<usize>,

    /// Threshold on the normalised change, λ [default: 0.5]
    #[arg(
        long,
        value_name = "X",
        help_heading = "Method",
        allow_negative_numbers = true
    )]
    threshold: Option<f64>,

    /// m of approximate (3) and sample entropy (2), or ordinal order of permutation (3)
    #[arg(long, value_name = "N", help_heading = "Method")]
    order: Option<usize>,

    /// r of approximate and sample entropy, absolute [default: 0.2 × standard deviation; see the README]
    #[arg(
        long,
        value_name = "X",
        help_heading = "Method",
        allow_negative_numbers = true
    )]
    tolerance: Option<f64>,

    /// Cut each joint on its own, or the whole action as one [default: each]
    #[arg(long, value_name = "MODE", value_parser = joints_parser(), help_heading = "Method")]
    joints: Option<JointMode>,

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

    /// Write the per-step table [default: full]
    #[arg(long, value_enum, value_name = "WHAT", help_heading = "Output")]
    steps: Option<Steps>,

    /// Write composite actions and changes as an MCAP file beside each recording's name, for viewers
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    events: Option<PathBuf>,

    /// Start again in a directory that holds another run
    #[arg(long, help_heading = "Output")]
    #[serde(skip_serializing_if = "is_false")]
    overwrite: bool,

    /// Read and check everything, write nothing
    #[arg(long, help_heading = "Output")]
    #[serde(skip_serializing_if = "is_false")]
    dry_run: bool,

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

    /// Step rows after which a part is cut
    #[arg(long, value_name = "N", hide = true)]
    max_part_rows: Option<usize>,

    /// Threads; 0 = all cores [default: 0]
    #[arg(long, value_name = "N", help_heading = "Running")]
    threads: Option<usize>,

    /// Show progress on stderr [default: auto]
    #[arg(long, value_enum, value_name = "WHEN", help_heading = "Running")]
    progress: Option<When>,

    /// Form of the closing summary [default: text]
    #[arg(long, value_enum, value_name = "FORM", help_heading = "Running")]
    summary: Option<SummaryFormat>,

    /// No summary; only errors
    #[arg(short, long, help_heading = "Running")]
    #[serde(skip_serializing_if = "is_false")]
    quiet: bool,

    /// Say more: every recording, and what was read from it
    #[arg(short, long, help_heading = "Running")]
    #[serde(skip_serializing_if = "is_false")]
    verbose: bool,
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

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "the signature that serde asks for"
)]
fn is_false(flag: &bool) -> bool {
    !*flag
}

/// What is to be done.
#[derive(Debug)]
pub enum Request {
    /// Print this configuration and stop.
    PrintConfig(String),
    /// Run.
    Run {
        /// What.
        config: Box<Config>,
        /// How progress is shown.
        progress: When,
        /// How the summary is printed.
        summary: SummaryFormat,
        /// No summary.
        quiet: bool,
        /// Tell of every recording.
        verbose: bool,
    },
}

impl ExtractArgs {
    /// Joins command line, configuration file and defaults, and checks what comes out.
    ///
    /// # Errors
    /// One line that says which option is wrong and what it must be.
    pub fn request(self) -> Result<Request, String> {
        let file = match &self.config {
            Some(path) => {
                let text = std::fs::read_to_string(path).map_err(|e| {
                    format!("cannot read the configuration {}: {e}", path.display())
                })?;
                toml::from_str(&text).map_err(|e| {
                    format!(
                        "configuration {}: {}",
                        path.display(),
                        e.to_string().trim_end()
                    )
                })?
            }
            None => Options::default(),
        };
        let options = self.options.or(file);
        let params = ExtractionParams::new(options.raw_params()).map_err(|e| e.to_string())?;
        let filled = options.filled();
        let text = toml::to_string(&filled).map_err(|e| e.to_string())?;
        if self.print_config {
            return Ok(Request::PrintConfig(text));
        }
        filled.run(params)
    }
}

impl Options {
    /// What is given here, else what is given there.
    fn or(self, other: Self) -> Self {
        Self {
            inputs: or_if_empty(self.inputs, other.inputs),
            output: self.output.or(other.output),
            measure: self.measure.or(other.measure),
            profile: self.profile.or(other.profile),
            bins: self.bins.or(other.bins),
            window: self.window.or(other.window),
            threshold: self.threshold.or(other.threshold),
            order: self.order.or(other.order),
            tolerance: self.tolerance.or(other.tolerance),
            joints: self.joints.or(other.joints),
            action: or_if_empty(self.action, other.action),
            state: or_if_empty(self.state, other.state),
            episodes: self.episodes.or(other.episodes),
            align: self.align.or(other.align),
            max_age: self.max_age.or(other.max_age),
            clock: self.clock.or(other.clock),
            on_damage: self.on_damage.or(other.on_damage),
            steps: self.steps.or(other.steps),
            events: self.events.or(other.events),
            overwrite: self.overwrite || other.overwrite,
            dry_run: self.dry_run || other.dry_run,
            max_record: self.max_record.or(other.max_record),
            max_chunk: self.max_chunk.or(other.max_chunk),
            max_episode: self.max_episode.or(other.max_episode),
            max_open_episodes: self.max_open_episodes.or(other.max_open_episodes),
            max_part_rows: self.max_part_rows.or(other.max_part_rows),
            threads: self.threads.or(other.threads),
            progress: self.progress.or(other.progress),
            summary: self.summary.or(other.summary),
            quiet: self.quiet || other.quiet,
            verbose: self.verbose || other.verbose,
        }
    }

    fn raw_params(&self) -> RawParams {
        let default = RawParams::default();
        RawParams {
            measure: self.measure.unwrap_or(default.measure),
            profile: self.profile.unwrap_or(default.profile),
            bins: self.bins.unwrap_or(default.bins),
            window: self.window.unwrap_or(default.window),
            threshold: self.threshold.unwrap_or(default.threshold),
            joints: self.joints.unwrap_or(default.joints),
            order: self.order,
            tolerance: self.tolerance,
        }
    }

    /// Every default written out.
    fn filled(self) -> Self {
        let raw = self.raw_params();
        let limits = Limits::default();
        Self {
            measure: Some(raw.measure),
            profile: Some(raw.profile),
            bins: Some(raw.bins),
            window: Some(raw.window),
            threshold: Some(raw.threshold),
            joints: Some(raw.joints),
            episodes: Some(self.episodes.clone().unwrap_or_default()),
            align: Some(self.align.unwrap_or_default()),
            clock: Some(self.clock.unwrap_or_default()),
            on_damage: Some(self.on_damage.unwrap_or_default()),
            steps: Some(self.steps.unwrap_or_default()),
            max_record: self.max_record.or(Some(ByteSize(limits.max_record))),
            max_chunk: self.max_chunk.or(Some(ByteSize(limits.max_chunk))),
            max_episode: self.max_episode.or(Some(ByteSize(limits.max_episode))),
            max_open_episodes: self.max_open_episodes.or(Some(limits.max_open_episodes)),
            threads: Some(self.threads.unwrap_or_default()),
            progress: Some(self.progress.unwrap_or_default()),
            summary: Some(self.summary.unwrap_or_default()),
            ..self
        }
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

    fn read_options(&self) -> ReadOptions {
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

    fn run(self, params: ExtractionParams) -> Result<Request, String> {
        if self.inputs.is_empty() {
            return Err("no INPUT given: name files, folders or globs of recordings".to_owned());
        }
        if self.output.is_none() && self.events.is_none() && !self.dry_run {
            return Err(
                "no output directory given: --output DIR (or --events DIR alone, or --dry-run to write nothing)"
                    .to_owned(),
            );
        }
        if self.max_open_episodes == Some(0) {
            return Err("max-open-episodes is 0: at least 1 is needed".to_owned());
        }
        if let Some(threads) = self.threads.filter(|&n| n > MAX_THREADS) {
            return Err(format!(
                "threads is {threads}: expected at most {MAX_THREADS}"
            ));
        }
        let config = Config {
            params,
            read: self.read_options(),
            steps: self.steps != Some(Steps::None),
            max_part_rows: self.max_part_rows.unwrap_or(DEFAULT_MAX_PART_ROWS),
            faults: None,
            overwrite: self.overwrite,
            threads: self.threads.unwrap_or_default(),
            parameters: self.parameters(),
            output: self.output.filter(|_| !self.dry_run),
            events: self.events.filter(|_| !self.dry_run),
            inputs: self.inputs,
        };
        Ok(Request::Run {
            config: Box::new(config),
            progress: self.progress.unwrap_or_default(),
            summary: self.summary.unwrap_or_default(),
            quiet: self.quiet,
            verbose: self.verbose,
        })
    }

    /// The options that decide what the tables hold, as text.
    fn parameters(&self) -> Vec<(String, String)> {
        let relevant = Self {
            inputs: Vec::new(),
            output: None,
            events: None,
            overwrite: false,
            dry_run: false,
            max_part_rows: None,
            threads: None,
            progress: None,
            summary: None,
            quiet: false,
            verbose: false,
            ..self.clone()
        };
        let table = toml::Table::try_from(&relevant).unwrap_or_default();
        let text = |value: &toml::Value| {
            value
                .as_str()
                .map_or_else(|| value.to_string(), ToOwned::to_owned)
        };
        table
            .iter()
            .filter(|(key, _)| *key != "inputs")
            .map(|(key, value)| (key.clone(), text(value)))
            .collect()
    }
}

/// Parses one of the names that a type has, with the authors' short names as hidden aliases.
fn measure_parser() -> impl TypedValueParser<Value = Measure> {
    let values = Measure::ALL.map(|m| PossibleValue::new(m.name()).alias(m.short_name()));
    PossibleValuesParser::new(values).try_map(|name| name.parse::<Measure>())
}

fn profile_parser() -> impl TypedValueParser<Value = Profile> {
    PossibleValuesParser::new(["paper", "authors"]).map(|name| {
        if name == "authors" {
            Profile::Authors
        } else {
            Profile::Paper
        }
    })
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

fn joints_parser() -> impl TypedValueParser<Value = JointMode> {
    PossibleValuesParser::new(["each", "together"]).map(|name| {
        if name == "together" {
            JointMode::Together
        } else {
            JointMode::Each
        }
    })
}
