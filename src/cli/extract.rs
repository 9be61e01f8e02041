//! `coact extract`: its options, the configuration file that may hold the same, and what both come to.

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize};

use super::progress::When;
use super::reading::Reading;
use crate::extraction::{ExtractionParams, Measure, Profile, RawParams};
use crate::model::JointMode;
use crate::pipeline::{Config, DEFAULT_MAX_PART_ROWS};

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
#[serde(default, rename_all = "kebab-case")]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag")]
struct Options {
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

    #[command(flatten)]
    #[serde(flatten, skip_deserializing)]
    reading: Reading,

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

    /// Step rows after which a part is cut
    #[arg(long, value_name = "N", hide = true)]
    max_part_rows: Option<usize>,

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
                Options::from_toml(&text)
                    .map_err(|e| format!("configuration {}: {}", path.display(), e.trim_end()))?
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
    /// Parses a configuration file, in which every key is the name of an option.
    fn from_toml(text: &str) -> Result<Self, String> {
        let reading: Reading = toml::from_str(text).map_err(|e| e.to_string())?;
        let options: Self = toml::from_str(text).map_err(|e| e.to_string())?;
        let table: toml::Table = text.parse().map_err(|e: toml::de::Error| e.to_string())?;
        let command = Self::augment_args(clap::Command::new("coact"));
        let names: Vec<String> = command
            .get_arguments()
            .map(|arg| arg.get_id().as_str().replace('_', "-"))
            .collect();
        match table.keys().find(|key| !names.contains(key)) {
            Some(key) => Err(format!(
                "{key:?} is no option: expected one of {}",
                names.join(", ")
            )),
            None => Ok(Self { reading, ..options }),
        }
    }

    /// What is given here, else what is given there.
    fn or(self, other: Self) -> Self {
        Self {
            output: self.output.or(other.output),
            measure: self.measure.or(other.measure),
            profile: self.profile.or(other.profile),
            bins: self.bins.or(other.bins),
            window: self.window.or(other.window),
            threshold: self.threshold.or(other.threshold),
            order: self.order.or(other.order),
            tolerance: self.tolerance.or(other.tolerance),
            joints: self.joints.or(other.joints),
            reading: self.reading.or(other.reading),
            steps: self.steps.or(other.steps),
            events: self.events.or(other.events),
            overwrite: self.overwrite || other.overwrite,
            dry_run: self.dry_run || other.dry_run,
            max_part_rows: self.max_part_rows.or(other.max_part_rows),
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
        Self {
            measure: Some(raw.measure),
            profile: Some(raw.profile),
            bins: Some(raw.bins),
            window: Some(raw.window),
            threshold: Some(raw.threshold),
            joints: Some(raw.joints),
            reading: self.reading.filled(),
            steps: Some(self.steps.unwrap_or_default()),
            progress: Some(self.progress.unwrap_or_default()),
            summary: Some(self.summary.unwrap_or_default()),
            ..self
        }
    }

    fn run(self, params: ExtractionParams) -> Result<Request, String> {
        self.reading.check()?;
        if self.output.is_none() && self.events.is_none() && !self.dry_run {
            return Err(
                "no output directory given: --output DIR (or --events DIR alone, or --dry-run to write nothing)"
                    .to_owned(),
            );
        }
        let config = Config {
            params,
            read: self.reading.read_options(),
            steps: self.steps != Some(Steps::None),
            max_part_rows: self.max_part_rows.unwrap_or(DEFAULT_MAX_PART_ROWS),
            faults: None,
            overwrite: self.overwrite,
            threads: self.reading.threads(),
            parameters: self.parameters(),
            output: self.output.filter(|_| !self.dry_run),
            events: self.events.filter(|_| !self.dry_run),
            inputs: self.reading.inputs,
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
            reading: self.reading.relevant(),
            output: None,
            events: None,
            overwrite: false,
            dry_run: false,
            max_part_rows: None,
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

pub(super) fn joints_parser() -> impl TypedValueParser<Value = JointMode> {
    PossibleValuesParser::new(["each", "together"]).map(|name| {
        if name == "together" {
            JointMode::Together
        } else {
            JointMode::Each
        }
    })
}
