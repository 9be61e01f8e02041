//! What is left to do in a directory that an earlier process of the same run has written to.

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::config::RunError;
use super::identity;
use super::inputs::Input;
use super::source::Job;
use crate::model::{RecordingIdentity, RecordingStatus};
use crate::tables::{DoneRecording, OutputDirectory};

/// What is left to do, and what is done.
pub(crate) struct Work<'a> {
    /// The recording that was written in part comes first: until it is whole, no other may be begun.
    pub(crate) jobs: Vec<Job<'a>>,
    pub(crate) before: Vec<DoneRecording>,
}

/// All recordings, from their beginnings.
pub(crate) fn all(inputs: &[Input]) -> Vec<Job<'_>> {
    inputs
        .iter()
        .map(|input| Job {
            input,
            n_written: 0,
        })
        .collect()
}

/// Takes recordings that are new, had failed, or were written in part.
pub(crate) fn work<'a>(
    inputs: &'a [Input],
    directory: &mut OutputDirectory,
) -> Result<Work<'a>, RunError> {
    let (stand, failed): (Vec<DoneRecording>, Vec<DoneRecording>) = directory
        .done()
        .into_values()
        .cloned()
        .partition(|done| done.status != RecordingStatus::Failed);
    let open = directory.open_recording().cloned();
    let known: Vec<&RecordingIdentity> = stand
        .iter()
        .map(|done| &done.identity)
        .chain(open.as_ref().map(|open| &open.identity))
        .collect();
    let is_gone = |done: &&DoneRecording| inputs.iter().all(|i| i.name != done.identity.name);
    if let Some(gone) = failed.iter().find(is_gone) {
        return Err(RunError::Arguments(vanished(&gone.identity.name)));
    }
    known
        .par_iter()
        .map(|identity| check(identity, inputs))
        .collect::<Result<(), String>>()
        .map_err(RunError::Arguments)?;
    let names: BTreeSet<&str> = stand.iter().map(|d| &*d.identity.name).collect();
    let mut jobs: Vec<Job<'a>> = inputs
        .iter()
        .filter(|input| !names.contains(&*input.name))
        .map(|input| Job {
            input,
            n_written: open
                .as_ref()
                .filter(|open| open.identity.name == input.name)
                .map_or(0, |open| open.n_episodes),
        })
        .collect();
    jobs.sort_by_key(|job| job.n_written == 0);
    let again: Vec<&str> = failed.iter().map(|done| &*done.identity.name).collect();
    directory.forget(&again)?;
    Ok(Work {
        jobs,
        before: stand,
    })
}

/// How a user settles that a recording is not what it was.
const SETTLE: &str = "give another directory, or --overwrite to start again";

fn vanished(name: &str) -> String {
    format!("{name} is in the tables and no longer among the inputs: {SETTLE}")
}

/// Is a recording, whose rows are in the tables, still there as it was?
fn check(known: &RecordingIdentity, inputs: &[Input]) -> Result<(), String> {
    let name = &known.name;
    let Some(input) = inputs.iter().find(|input| input.name == *name) else {
        return Err(vanished(name));
    };
    if identity::of(input) == *known {
        Ok(())
    } else {
        Err(format!(
            "{name} has changed since it was written to the tables: {SETTLE}"
        ))
    }
}
