//! `coact plan`, `coact finish` and `--shard`: a run in shards, as typed and as told.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use clap::Args;
use clap::builder::RangedU64ValueParser;
use serde_json::json;

use super::exit;
use super::extract::{ConfigFile, Options, SummaryFormat};
use crate::pipeline::{
    Config, Finish, Finished, MAX_SHARDS, MissingRecordings, Planned, Shard, read_plan,
};
use crate::text;

const PLAN_EXAMPLES: &str = "\
Examples:
  coact plan recordings --output out --shards 100     share the recordings out, by their bytes
  coact extract --shard 7/100 --output out            do the 7th share, on any machine that sees the same files
  coact finish out                                    check that nothing is missing, and mark the run as done

Options of `coact extract` are given here, once: each shard takes them from the plan.

Exit codes:
  0  done
  1  failed: no recordings, or the output cannot be written
  2  bad arguments, or the directory holds another run";

const FINISH_EXIT_CODES: &str = "\
Exit codes:
  0  done
  1  recordings are missing (the shards are named), a shard is being written, or no episode came out
  2  there is no plan
  3  done, but recordings failed or were recovered, or something of them was refused";

/// Recordings of a shard that are named where they are missing.
const NAMED_MISSING: usize = 3;

/// Arguments of `coact plan`.
#[derive(Debug, Args)]
#[command(after_help = PLAN_EXAMPLES)]
pub struct PlanArgs {
    #[command(flatten)]
    options: Options,

    #[command(flatten)]
    file: ConfigFile,

    /// How many shards to share the recordings out to
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u32>::new().range(1..=u64::from(MAX_SHARDS)))]
    shards: u32,
}

/// What `coact plan` is to do.
#[derive(Debug)]
pub struct PlanRequest {
    /// The run.
    pub config: Box<Config>,
    /// What each shard is told.
    pub options: serde_json::Map<String, serde_json::Value>,
    /// How many.
    pub n_shards: u32,
    /// How the plan is told.
    summary: Option<SummaryFormat>,
}

impl PlanArgs {
    /// Joins command line, configuration file and defaults, and checks what comes out.
    ///
    /// # Errors
    /// One line that says which option is wrong and what it must be.
    pub fn request(self) -> Result<PlanRequest, String> {
        let options = self.file.under(self.options)?;
        if !options.has_output() && !options.is_dry_run() {
            return Err("no output directory given: --output DIR".to_owned());
        }
        let summary = options.told();
        Ok(PlanRequest {
            options: options.for_plan()?,
            config: Box::new(options.config(None)?),
            n_shards: self.shards,
            summary,
        })
    }
}

impl PlanRequest {
    /// The plan as it is told; nothing with `--quiet`.
    pub fn told(&self, planned: &Planned) -> String {
        let shards = &planned.plan.shards;
        let n_recordings: usize = shards.iter().map(|s| s.recordings.len()).sum();
        let bytes: u64 = shards.iter().map(|s| s.bytes).sum();
        let largest = shards.iter().map(|s| s.bytes).max().unwrap_or(0);
        let n_empty = shards.iter().filter(|s| s.recordings.is_empty()).count();
        match self.summary {
            None => String::new(),
            Some(SummaryFormat::Json) => {
                let object = json!({
                    "n_shards": shards.len(),
                    "n_empty_shards": n_empty,
                    "n_recordings": n_recordings,
                    "bytes": bytes,
                    "largest_shard_bytes": largest,
                    "is_new": planned.is_new,
                });
                format!("{object:#}\n")
            }
            Some(SummaryFormat::Text) => {
                let mut told = format!(
                    "{}, {}, in {}; the largest has {}\n",
                    text::counted(n_recordings as u64, "recording"),
                    megabytes(bytes),
                    text::counted(shards.len() as u64, "shard"),
                    megabytes(largest),
                );
                if n_empty > 0 {
                    let _infallible = writeln!(
                        told,
                        "{} empty: there are fewer recordings",
                        text::counted(n_empty as u64, "shard")
                    );
                }
                if !planned.is_new {
                    told += "the same plan was there already, and stays with its results\n";
                }
                told
            }
        }
    }
}

/// `K/N`: which of how many.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ShardOf {
    number: u32,
    n_shards: u32,
}

impl FromStr for ShardOf {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text
            .split_once('/')
            .and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
        match parsed {
            Some((number, n_shards)) if (1..=n_shards).contains(&number) => {
                Ok(Self { number, n_shards })
            }
            _ => Err("expected K/N with K from 1 to N, as in 3/8".to_owned()),
        }
    }
}

impl ShardOf {
    /// The shard in the plan of an output directory, and the options that the plan has for it, joined with those that
    /// were typed, which may differ only in what does not show in the tables.
    pub(super) fn in_plan(self, typed: Options) -> Result<(Shard, Options), String> {
        let Some(output) = typed.output() else {
            return Err(
                "--shard needs the directory that `coact plan` was given: --output DIR".to_owned(),
            );
        };
        let plan = read_plan(output).map_err(|e| e.to_string())?;
        let n_planned = plan.shards.len();
        if self.n_shards as usize != n_planned {
            return Err(format!(
                "--shard {}/{}: the plan in {} has {n_planned} shards",
                self.number,
                self.n_shards,
                output.display()
            ));
        }
        let options = typed.of_plan(&plan)?;
        let shard = Shard {
            number: self.number,
            plan: Arc::new(plan),
        };
        Ok((shard, options))
    }
}

/// Arguments of `coact finish`.
#[derive(Debug, Args)]
#[command(after_help = FINISH_EXIT_CODES)]
pub struct FinishArgs {
    /// Output directory of a plan, whose shards are done
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,

    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

impl FinishArgs {
    /// The result, for stdout, what is wrong, for stderr, and the exit code.
    pub fn told(&self, finish: &Finish) -> (String, String, u8) {
        match finish {
            Finish::Done(finished) => {
                let result = if self.json {
                    format!("{:#}\n", json_of(finished))
                } else {
                    done(finished)
                };
                if finished.n_episodes == 0 {
                    return (
                        result,
                        "coact: no episode came out\n".to_owned(),
                        exit::FAILED,
                    );
                }
                let code = if finished.n_unclean > 0 {
                    exit::PARTIAL
                } else {
                    exit::DONE
                };
                (result, String::new(), code)
            }
            Finish::Missing(shards) => {
                let result = if self.json {
                    format!("{:#}\n", json_of_missing(shards))
                } else {
                    String::new()
                };
                (result, self.missing(shards), exit::FAILED)
            }
        }
    }

    fn missing(&self, shards: &[MissingRecordings]) -> String {
        let mut told = format!("coact: {} is not complete\n", self.directory.display());
        for lacking in shards {
            let names: Vec<&str> = lacking.missing.iter().map(|name| &**name).collect();
            let first = names[..names.len().min(NAMED_MISSING)].join(", ");
            let more = match names.len() - names.len().min(NAMED_MISSING) {
                0 => String::new(),
                n => format!(", and {n} more"),
            };
            let _infallible = writeln!(
                told,
                "shard {}: {} of {} recordings missing: {first}{more}",
                lacking.shard,
                names.len(),
                lacking.n_planned
            );
        }
        let numbers: Vec<String> = shards.iter().map(|s| s.shard.to_string()).collect();
        let _infallible = writeln!(told, "missing shards: {}", numbers.join(","));
        told
    }
}

fn done(finished: &Finished) -> String {
    let mut told = format!(
        "{}, {}, {}, from {}\n",
        text::counted(finished.n_recordings, "recording"),
        text::counted(finished.n_episodes, "episode"),
        text::counted(finished.n_steps, "step"),
        text::counted(finished.n_shards, "shard")
    );
    if finished.n_unclean > 0 {
        let _infallible = writeln!(
            told,
            "{} failed, recovered, or with something refused: see the recordings table",
            text::counted(finished.n_unclean, "recording")
        );
    }
    told
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}

fn json_of(finished: &Finished) -> serde_json::Value {
    json!({
        "is_complete": true,
        "n_shards": finished.n_shards,
        "n_recordings": finished.n_recordings,
        "n_episodes": finished.n_episodes,
        "n_steps": finished.n_steps,
        "n_unclean_recordings": finished.n_unclean,
    })
}

fn json_of_missing(shards: &[MissingRecordings]) -> serde_json::Value {
    let shards: Vec<serde_json::Value> = shards
        .iter()
        .map(|s| json!({"shard": s.shard, "n_planned": s.n_planned, "missing": s.missing}))
        .collect();
    json!({"is_complete": false, "missing_shards": shards})
}
