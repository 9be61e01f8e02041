//! A run in shards: its plan made from what was typed, the recordings of one shard taken from it, and its end.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::balance;
use super::config::{Config, RunError};
use super::inputs::{self, Input};
use crate::cloud;
use crate::tables::{self, Plan, PlannedRecording, PlannedShard, TableOptions};

pub use crate::tables::{Finish, Finished, MissingRecordings};

/// Most shards of a plan: their numbers have five digits in the names of files.
pub const MAX_SHARDS: u32 = 99_999;

/// What a recording costs besides its bytes, in bytes: opening and closing it takes about as long as reading these.
const RECORDING_COST: u64 = 64 << 10;

/// One shard of a plan.
#[derive(Debug, Clone)]
pub struct Shard {
    /// Which, from 1.
    pub number: u32,
    /// The plan.
    pub plan: Arc<Plan>,
}

/// A plan that was made.
#[derive(Debug, Clone)]
pub struct Planned {
    /// What it says.
    pub plan: Plan,
    /// False if the same plan was there already; its results stay.
    pub is_new: bool,
}

/// Shares the recordings out among shards, and writes that down in the output directory, if there is one. `options` is
/// what each shard will be told.
///
/// # Errors
/// As [`super::run`].
pub fn plan(
    config: &Config,
    options: serde_json::Map<String, serde_json::Value>,
    n_shards: u32,
) -> Result<Planned, RunError> {
    config.check_outputs()?;
    let inputs = inputs::find(&config.inputs)?;
    let root = root(&inputs);
    let recordings: Vec<PlannedRecording> =
        inputs.iter().map(|input| planned(input, &root)).collect();
    let weights: Vec<u64> = recordings
        .iter()
        .map(|r| r.bytes.saturating_add(RECORDING_COST))
        .collect();
    let mut recordings = recordings.into_iter();
    let mut start = 0;
    let shards = balance::ends(&weights, n_shards as usize)
        .into_iter()
        .map(|end| {
            let recordings: Vec<_> = recordings.by_ref().take(end - start).collect();
            start = end;
            PlannedShard {
                bytes: recordings.iter().map(|r| r.bytes).sum(),
                recordings,
            }
        })
        .collect();
    let plan = Plan::new(inputs::readable(root.as_os_str()), options, shards);
    let is_new = match &config.output {
        Some(output) => {
            tables::write_plan(output, &table_options(config), &plan, config.overwrite)?
        }
        None => true,
    };
    Ok(Planned { plan, is_new })
}

/// The plan in an output directory.
///
/// # Errors
/// If there is none of this version, or it cannot be read.
pub fn read_plan(output: &Path) -> Result<Plan, RunError> {
    Ok(tables::read_plan(output)?)
}

/// Holds what is in the directory against its plan; marks the run as done if nothing is missing.
///
/// # Errors
/// [`RunError::Failed`], but for a directory without a plan.
pub fn finish(output: &Path) -> Result<Finish, RunError> {
    Ok(tables::finish(output)?)
}

pub(super) fn table_options(config: &Config) -> TableOptions {
    TableOptions {
        steps: config.steps,
        shard: config.shard.as_ref().map_or(0, |shard| shard.number),
        plan: config.shard.as_ref().map(|shard| Arc::clone(&shard.plan)),
        metadata: config.metadata(),
        max_part_rows: config.max_part_rows,
        faults: config.faults.clone(),
    }
}

impl Shard {
    /// The recordings of the shard.
    pub(super) fn inputs(&self) -> Vec<Input> {
        let root = inputs::from_readable(&self.plan.root);
        let shard = self.number.checked_sub(1);
        let planned = shard.and_then(|index| self.plan.shards.get(index as usize));
        let Some(planned) = planned else {
            return Vec::new();
        };
        let recordings = || planned.recordings.iter();
        let mut inputs: Vec<Input> = recordings().map(|r| input(r, &root)).collect();
        find_in_stores(&mut inputs);
        for (input, planned) in inputs.iter_mut().zip(recordings()) {
            check_unchanged(input, planned);
        }
        inputs
    }

    /// The names of all recordings of the run.
    pub(super) fn all_names(&self) -> impl Iterator<Item = &Arc<str>> {
        self.plan.recordings().map(|recording| &recording.name)
    }
}

/// The folder that names are relative to.
fn root(inputs: &[Input]) -> PathBuf {
    let of = |input: &Input| {
        let path = inputs::absolute(&input.path);
        let depth = input.name.split('/').count();
        path.ancestors().nth(depth).map(Path::to_owned)
    };
    inputs.first().and_then(of).unwrap_or_default()
}

fn planned(input: &Input, root: &Path) -> PlannedRecording {
    let files: Vec<PathBuf> = input
        .files
        .iter()
        .map(|file| match cloud::address(file) {
            Some(_) => file.clone(),
            None => std::path::absolute(file).unwrap_or_else(|_| file.clone()),
        })
        .collect();
    let is_named_so = files == [root.join(inputs::from_readable(&input.name))];
    PlannedRecording {
        name: Arc::clone(&input.name),
        bytes: input.bytes(),
        files: if is_named_so {
            Vec::new()
        } else {
            files
                .iter()
                .map(|f| inputs::readable(f.as_os_str()))
                .collect()
        },
        problem: input.problem.clone(),
    }
}

fn input(planned: &PlannedRecording, root: &Path) -> Input {
    let path = root.join(inputs::from_readable(&planned.name));
    let files: Vec<PathBuf> = if planned.files.is_empty() {
        vec![path.clone()]
    } else {
        planned
            .files
            .iter()
            .map(|f| inputs::from_readable(f))
            .collect()
    };
    Input {
        name: Arc::clone(&planned.name),
        path,
        files,
        problem: planned.problem.clone(),
        remote: None,
    }
}

/// Asks the stores what they have of recordings that are no files.
fn find_in_stores(inputs: &mut [Input]) {
    let mut remote: Vec<(String, &mut Input)> = inputs
        .iter_mut()
        .filter(|input| input.problem.is_none())
        .filter_map(|input| Some((cloud::address(&input.path)?.to_owned(), input)))
        .collect();
    let addresses: Vec<&str> = remote.iter().map(|(address, _)| address.as_str()).collect();
    let found = cloud::about(&addresses);
    for ((_, input), about) in remote.iter_mut().zip(found) {
        match about {
            Ok(about) => input.remote = Some(about),
            Err(e) => input.problem = Some(format!("cannot be read: {e}")),
        }
    }
}

fn check_unchanged(input: &mut Input, planned: &PlannedRecording) {
    let bytes = input.bytes();
    let is_gone = |file: &&PathBuf| cloud::address(file).is_none() && !file.exists();
    if input.problem.is_none() && bytes != planned.bytes {
        input.problem = Some(match input.files.iter().find(is_gone) {
            Some(file) => format!(
                "{} was there when the run was planned, and is gone",
                file.display()
            ),
            None => format!(
                "it has changed since the run was planned: it had {} bytes and has {bytes}",
                planned.bytes
            ),
        });
    }
}
