//! `coact extract`: its options, the configuration file that may hold the same, and what both come to.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize};

use super::plan::ShardOf;
use super::progress::When;
use super::reading::Reading;
use crate::extraction::{ExtractionParams, Measure, Profile, RawParams};
use crate::model::JointMode;
use crate::pipeline::{Config, DEFAULT_MAX_PART_ROWS, Plan, Shard};

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

    #[command(flatten)]
    file: ConfigFile,

    /// Extract the K-th of the N shards of the plan in the output directory (see `coact plan`)
    #[arg(long, value_name = "K/N", conflicts_with = "inputs")]
    shard: Option<ShardOf>,

    /// Print the options that would be used as TOML, and stop
    #[arg(long)]
    print_config: bool,
}

/// Where options may stand besides the command line.
#[derive(Debug, Args)]
pub(super) struct ConfigFile {
    /// Take options from a TOML file; the command line wins
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
}

impl ConfigFile {
    /// What is typed, else what is in the file.
    pub(super) fn under(&self, typed: Options) -> Result<Options, String> {
        let Some(path) = &self.config else {
            return Ok(typed);
        };
        let text = std::fs::read_to_string(path)
            .map_err(|e| format!("cannot read the configuration {}: {e}", path.display()))?;
        let file = Options::from_toml(&text)
            .map_err(|e| format!("configuration {}: {}", path.display(), e.trim_end()))?;
        Ok(typed.or(file))
    }
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
pub(super) struct Options {
    /// Directory for the tables; with the feature `cloud`, s3://, gs:// and az:// addresses too
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
        let options = self.file.under(self.options)?;
        let (shard, options) = match self.shard {
            Some(shard) => {
                let (shard, options) = shard.in_plan(options)?;
                (Some(shard), options)
            }
            None => (None, options),
        };
        if self.print_config {
            options.params()?;
            let text = toml::to_string(&options.filled()).map_err(|e| e.to_string())?;
            return Ok(Request::PrintConfig(text));
        }
        if !options.has_output() && options.events.is_none() && !options.dry_run {
            return Err(
                "no output directory given: --output DIR (or --events DIR alone, or --dry-run to write nothing)"
                    .to_owned(),
            );
        }
        Ok(Request::Run {
            progress: options.progress.unwrap_or_default(),
            summary: options.summary.unwrap_or_default(),
            quiet: options.quiet,
            verbose: options.verbose,
            config: Box::new(options.config(shard)?),
        })
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

    pub(super) fn has_output(&self) -> bool {
        self.output.is_some()
    }

    pub(super) fn output(&self) -> Option<&Path> {
        self.output.as_deref()
    }

    pub(super) fn is_dry_run(&self) -> bool {
        self.dry_run
    }

    /// How the summary is told, if it is.
    pub(super) fn told(&self) -> Option<SummaryFormat> {
        (!self.quiet).then(|| self.summary.unwrap_or_default())
    }

    fn params(&self) -> Result<ExtractionParams, String> {
        ExtractionParams::new(self.raw_params()).map_err(|e| e.to_string())
    }

    /// What the options come to, for a run or for one shard of it.
    pub(super) fn config(self, shard: Option<Shard>) -> Result<Config, String> {
        let params = self.params()?;
        self.filled().checked_config(params, shard)
    }

    fn checked_config(
        self,
        params: ExtractionParams,
        shard: Option<Shard>,
    ) -> Result<Config, String> {
        match shard {
            Some(_) => self.reading.check_numbers()?,
            None => self.reading.check()?,
        }
        Ok(Config {
            params,
            shard,
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
        })
    }

    /// What every shard of a plan is told: each option that does not belong to one process alone.
    pub(super) fn for_plan(&self) -> Result<serde_json::Map<String, serde_json::Value>, String> {
        let events = match &self.events {
            Some(path) => Some(std::path::absolute(path).map_err(|e| e.to_string())?),
            None => None,
        };
        let shared = Self {
            events,
            max_part_rows: self.max_part_rows,
            ..self.clone().filled().relevant()
        };
        let table = toml::Table::try_from(&shared).map_err(|e| e.to_string())?;
        match serde_json::to_value(table).map_err(|e| e.to_string())? {
            serde_json::Value::Object(mut map) => {
                map.remove("inputs");
                Ok(map)
            }
            _ => Ok(serde_json::Map::new()),
        }
    }

    /// What is typed beside `--shard`, joined with what the plan says, from which it may not differ.
    pub(super) fn of_plan(self, plan: &Plan) -> Result<Self, String> {
        if !self.reading.inputs.is_empty() {
            return Err(
                "inputs have no place beside --shard: the recordings are those of the plan"
                    .to_owned(),
            );
        }
        let planned: toml::Table = serde_json::from_value(plan.options.clone().into())
            .map_err(|e| format!("the options of the plan: {e}"))?;
        let planned = Self::from_toml(&planned.to_string())
            .map_err(|e| format!("the options of the plan: {}", e.trim_end()))?;
        let events = self.events.as_ref().map(std::path::absolute).transpose();
        let joined = Self {
            events: events.map_err(|e| e.to_string())?,
            ..self
        }
        .or(planned.clone());
        let shown = |options: &Self| -> BTreeMap<String, String> {
            let mut shown: BTreeMap<_, _> =
                options.clone().filled().parameters().into_iter().collect();
            if let Some(events) = &options.events {
                shown.insert("events".to_owned(), events.display().to_string());
            }
            shown
        };
        let (of_plan, typed) = (shown(&planned), shown(&joined));
        let differs: Vec<String> = typed
            .iter()
            .filter(|(name, value)| of_plan.get(*name) != Some(value))
            .map(|(name, value)| {
                let of_plan = of_plan.get(name).map_or("not given", String::as_str);
                format!("{name} is {of_plan}, not {value}")
            })
            .collect();
        if differs.is_empty() {
            Ok(joined)
        } else {
            Err(format!(
                "all shards have the options of the plan, where {}",
                differs.join("; ")
            ))
        }
    }

    /// Without the options that do not decide what the tables hold.
    fn relevant(self) -> Self {
        Self {
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
            ..self
        }
    }

    /// The options that decide what the tables hold, as text.
    fn parameters(&self) -> Vec<(String, String)> {
        let relevant = self.clone().relevant();
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
