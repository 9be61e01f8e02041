//! The closing summary of a run: counted while rows are made, then told as text (`text.rs`) or as JSON.

mod text;
mod watch;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use serde::{Serialize, Serializer};

use crate::model::{
    Cause, ChosenLayout, Episode, EpisodeStatus, Extraction, Outcome, RecordingRow, environment_of,
};

pub use watch::WatchSummary;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RunOutcome {
    /// All done (exit 0).
    Done,
    /// Done, but something was refused, recovered or incomplete (exit 3).
    Partial,
    /// No episode came out (exit 1).
    Failed,
}

/// One joint of one environment.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct JointSummary {
    /// Its name, if all episodes agree on one.
    pub joint_name: Option<Arc<str>>,
    /// Composite actions found.
    pub n_segments: u64,
    /// Steps in them.
    pub n_segment_steps: u64,
}

impl JointSummary {
    /// Mean length of a composite action, steps.
    pub fn mean_segment_steps(&self) -> Option<f64> {
        (self.n_segments > 0).then(|| self.n_segment_steps as f64 / self.n_segments as f64)
    }
}

/// One environment: `env_id`, or the folder where the recording has none.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct EnvironmentSummary {
    /// Recordings that gave episodes.
    pub n_recordings: u64,
    /// Episodes, also those that gave nothing.
    pub n_episodes: u64,
    /// Steps used.
    pub n_steps: u64,
    /// By joint; −1 stands for all joints together.
    pub joints: BTreeMap<i32, JointSummary>,
}

impl EnvironmentSummary {
    /// Counts what was found in one episode; how many composite actions that is.
    fn add_joints(&mut self, episode: &Episode, extraction: &Extraction) -> u64 {
        let mode = extraction.mode;
        let mut n_segments = 0;
        for (index, joint) in extraction.joints.iter().enumerate() {
            let number = mode.joint_number(index);
            let name = episode.joint_name(mode, index).cloned();
            let summary = self.joints.entry(number).or_insert_with(|| JointSummary {
                joint_name: name.clone(),
                ..JointSummary::default()
            });
            if summary.joint_name != name {
                summary.joint_name = None;
            }
            summary.n_segments += joint.segments.len() as u64;
            summary.n_segment_steps += joint
                .segments
                .iter()
                .map(|s| (s.end_step - s.start_step) as u64)
                .sum::<u64>();
            n_segments += joint.segments.len() as u64;
        }
        n_segments
    }
}

/// A recording about which there is something to say.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Remark {
    /// Which.
    pub recording: Arc<str>,
    /// `ok`, `recovered` or `failed`.
    pub status: &'static str,
    /// Why.
    pub reason: Option<String>,
    /// What was refused.
    pub causes: Vec<CauseSummary>,
    /// Episodes used only in part, with the reason; the first few.
    pub incomplete: Vec<(String, String)>,
}

/// A cause and how often it came up.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct CauseSummary {
    /// The reason.
    pub cause: String,
    /// How often.
    pub count: u64,
    /// Bytes from the beginning of the file.
    pub first_offset: u64,
}

impl From<&Cause> for CauseSummary {
    fn from(c: &Cause) -> Self {
        Self {
            cause: c.cause.clone(),
            count: c.count,
            first_offset: c.first_offset,
        }
    }
}

/// Counts of a whole run.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RunSummary {
    /// Recordings by status.
    pub recordings: BTreeMap<&'static str, u64>,
    /// Episodes by status.
    pub episodes: BTreeMap<&'static str, u64>,
    /// Recordings that an earlier process of the same run had written.
    pub n_recordings_before: u64,
    /// Episodes of those, and of one that it had begun to write.
    pub n_episodes_before: u64,
    /// Something of those was refused, recovered or incomplete.
    #[serde(skip)]
    is_unclean_before: bool,
    /// It is one shard of a run; that no episode came of it says nothing of the run.
    #[serde(skip)]
    is_part_of_run: bool,
    /// Steps used.
    pub n_steps: u64,
    /// Steps read and not used.
    pub n_dropped_steps: u64,
    /// Composite actions.
    pub n_segments: u64,
    /// Messages on the chosen topics.
    pub n_messages: u64,
    /// Those that became steps.
    pub n_messages_used: u64,
    /// Those that did not.
    pub n_messages_refused: u64,
    /// By environment.
    pub environments: BTreeMap<String, EnvironmentSummary>,
    /// Layouts that were found out, and how many recordings have them.
    #[serde(serialize_with = "layouts_as_list")]
    pub layouts: BTreeMap<ChosenLayout, u64>,
    /// Recordings that failed, were recovered, or had something refused.
    pub remarks: Vec<Remark>,
    /// Bytes of the recordings.
    pub bytes: u64,
    /// Wall time.
    pub seconds: f64,
    /// How much of it was waiting for the disk to have what was written (fsync).
    pub sync_seconds: f64,
    /// One line a recording: what was read from it.
    #[serde(skip)]
    listing: Vec<String>,
    #[serde(skip)]
    of_recording: Current,
}

/// What is known of the recording whose episodes are being counted.
#[derive(Debug, Clone, Default, PartialEq)]
struct Current {
    environments: Vec<String>,
    incomplete: Vec<(String, String)>,
    n_incomplete: u64,
}

/// Incomplete episodes that a remark names.
const NAMED_INCOMPLETE: usize = 3;

impl RunSummary {
    /// Of a run, or of one shard of it.
    pub fn of(is_part_of_run: bool) -> Self {
        Self {
            is_part_of_run,
            ..Self::default()
        }
    }

    /// Counts one episode. Its recording's row must follow, after all its episodes.
    pub fn add_episode(&mut self, episode: &Episode, outcome: &Outcome) {
        let status = EpisodeStatus::of(episode, outcome);
        *self.episodes.entry(status.as_str()).or_default() += 1;
        self.n_steps += episode.n_steps() as u64;
        self.n_dropped_steps += episode.n_dropped_steps;
        if let Some(incomplete) = &episode.incomplete {
            self.of_recording.n_incomplete += 1;
            if self.of_recording.incomplete.len() < NAMED_INCOMPLETE {
                let id = episode
                    .key
                    .episode_id
                    .as_deref()
                    .map_or_else(|| episode.key.episode.to_string(), ToOwned::to_owned);
                self.of_recording
                    .incomplete
                    .push((id, incomplete.reason.clone()));
            }
        }
        let name = environment_of(episode.env_id.as_deref(), &episode.key.recording).to_owned();
        if !self.of_recording.environments.contains(&name) {
            self.of_recording.environments.push(name.clone());
            self.environments
                .entry(name.clone())
                .or_default()
                .n_recordings += 1;
        }
        let environment = self.environments.entry(name).or_default();
        environment.n_episodes += 1;
        environment.n_steps += episode.n_steps() as u64;
        if let Outcome::Extracted(extraction) = outcome {
            self.n_segments += environment.add_joints(episode, extraction);
        }
    }

    /// Counts a recording that an earlier process has written; `clean` if nothing of it was lost.
    pub fn add_done_before(&mut self, n_episodes: u64, clean: bool) {
        self.n_recordings_before += 1;
        self.n_episodes_before += n_episodes;
        self.is_unclean_before |= !clean;
    }

    /// Counts the episodes of a recording that an earlier process has begun to write.
    pub fn add_begun_before(&mut self, n_episodes: u64) {
        self.n_episodes_before += n_episodes;
    }

    /// Counts one recording, whose episodes came before.
    pub fn add_recording(&mut self, row: &RecordingRow) {
        let current = std::mem::take(&mut self.of_recording);
        *self.recordings.entry(row.status.as_str()).or_default() += 1;
        self.n_messages += row.n_messages;
        self.n_messages_used += row.n_messages_used;
        self.n_messages_refused += row.n_messages_refused;
        self.bytes += row.bytes;
        if let Some(chosen) = &row.chosen {
            *self.layouts.entry(chosen.clone()).or_default() += 1;
        }
        self.listing.push(text::listed(row));
        if row.is_clean() && current.n_incomplete == 0 {
            return;
        }
        let mut incomplete = current.incomplete;
        let unnamed = current.n_incomplete - incomplete.len() as u64;
        if unnamed > 0 {
            incomplete.push((
                format!("{unnamed} more"),
                "see the episodes table".to_owned(),
            ));
        }
        self.remarks.push(Remark {
            recording: Arc::clone(&row.recording),
            status: row.status.as_str(),
            reason: row.reason.clone(),
            causes: row.causes.iter().map(CauseSummary::from).collect(),
            incomplete,
        });
    }

    /// How the run ended, which decides the exit code.
    pub fn outcome(&self) -> RunOutcome {
        let n_episodes = self.episodes.values().sum::<u64>() + self.n_episodes_before;
        if n_episodes == 0 && !self.is_part_of_run {
            RunOutcome::Failed
        } else if self.remarks.is_empty() && !self.is_unclean_before {
            RunOutcome::Done
        } else {
            RunOutcome::Partial
        }
    }

    /// Sets how much of the wall time was waiting for the disk.
    pub fn set_sync(&mut self, sync: Duration) {
        self.sync_seconds = sync.as_secs_f64();
    }

    /// Sets the wall time.
    pub fn set_elapsed(&mut self, elapsed: Duration) {
        self.seconds = elapsed.as_secs_f64();
    }

    /// As one JSON object.
    pub fn to_json(&self) -> String {
        #[derive(Serialize)]
        struct WithOutcome<'a> {
            outcome: RunOutcome,
            #[serde(flatten)]
            summary: &'a RunSummary,
        }
        serde_json::to_string_pretty(&WithOutcome {
            outcome: self.outcome(),
            summary: self,
        })
        .unwrap_or_default()
    }
}

/// JSON has no maps whose keys are objects.
fn layouts_as_list<S: Serializer>(
    layouts: &BTreeMap<ChosenLayout, u64>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Counted<'a> {
        #[serde(flatten)]
        layout: &'a ChosenLayout,
        n_recordings: u64,
    }
    serializer.collect_seq(layouts.iter().map(|(layout, &n_recordings)| Counted {
        layout,
        n_recordings,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_without_episodes_failed() {
        assert_eq!(RunSummary::default().outcome(), RunOutcome::Failed);
    }
}
