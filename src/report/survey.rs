//! One pass over the small tables: counts, lengths, what was skipped, and the strongest composite actions.

use std::collections::{BTreeMap, HashMap};

use serde::Serialize;

use super::error::ReportError;
use crate::model::{EpisodeKey, EpisodeStatus, RecordingStatus};
use crate::results::{EpisodeRow, Results, SegmentRow};

/// Bins of a histogram: 1, 2, 3–4, 5–8, … steps; the last takes all that is longer.
pub(super) const LENGTH_BINS: usize = 20;

/// Composite actions of an environment that are ranked.
const RANKED: usize = 20;

/// Composite actions that are ranked in all.
const RANKED_IN_ALL: usize = 400;

/// Recordings and reasons that are named as skipped.
const NAMED_SKIPPED: usize = 200;

/// One joint of one environment.
#[derive(Debug, Default, Serialize)]
pub(super) struct JointSurvey {
    pub(super) joint: i32,
    pub(super) name: Option<String>,
    pub(super) n_segments: u64,
    pub(super) n_segment_steps: u64,
    pub(super) lengths: [u64; LENGTH_BINS],
    #[serde(skip)]
    names_differ: bool,
}

/// One environment.
#[derive(Debug, Default, Serialize)]
pub(super) struct EnvironmentSurvey {
    pub(super) name: String,
    pub(super) n_episodes: u64,
    pub(super) n_steps: u64,
    pub(super) n_segments: u64,
    pub(super) joints: Vec<JointSurvey>,
    #[serde(skip)]
    strongest: Vec<Ranked>,
}

/// A recording that was not read as it should be.
#[derive(Debug, Serialize)]
pub(super) struct SkippedRecording {
    recording: String,
    status: &'static str,
    reason: Option<String>,
    causes: Vec<(String, u64)>,
}

/// Episodes that were not used whole for one reason.
#[derive(Debug, Serialize)]
pub(super) struct SkippedEpisodes {
    status: &'static str,
    reason: String,
    count: u64,
    example: usize,
}

/// A composite action among the strongest.
#[derive(Debug, Clone)]
pub(super) struct Ranked {
    /// Index of its episode.
    pub(super) episode: usize,
    pub(super) row: SegmentRow,
}

/// All that the small tables say.
#[derive(Debug, Default)]
pub(super) struct Survey {
    pub(super) recordings: BTreeMap<&'static str, u64>,
    pub(super) n_messages: u64,
    pub(super) n_messages_refused: u64,
    pub(super) episodes: Vec<EpisodeRow>,
    /// By episode: its environment, and the largest change that one of its composite actions caused.
    pub(super) environment: Vec<usize>,
    pub(super) strongest: Vec<f64>,
    pub(super) environments: Vec<EnvironmentSurvey>,
    /// Joints of episodes by how many composite actions they have: none, 1, 2, 3–4, 5–8, …
    pub(super) per_episode: [u64; LENGTH_BINS + 1],
    pub(super) skipped_recordings: Vec<SkippedRecording>,
    pub(super) n_skipped_recordings: u64,
    pub(super) skipped_episodes: Vec<SkippedEpisodes>,
    /// The strongest composite actions of each environment, strongest first.
    pub(super) ranked: Vec<Ranked>,
}

impl Survey {
    pub(super) fn of(results: &Results) -> Result<Self, ReportError> {
        let mut survey = Self::default();
        survey.add_recordings(results)?;
        survey.add_episodes(results)?;
        survey.add_segments(results)?;
        Ok(survey)
    }

    fn add_recordings(&mut self, results: &Results) -> Result<(), ReportError> {
        for row in results.recordings() {
            let row = row?;
            *self.recordings.entry(row.status.as_str()).or_default() += 1;
            self.n_messages += row.n_messages;
            self.n_messages_refused += row.n_messages_refused;
            if row.status == RecordingStatus::Ok && row.causes.is_empty() {
                continue;
            }
            self.n_skipped_recordings += 1;
            if self.skipped_recordings.len() < NAMED_SKIPPED {
                self.skipped_recordings.push(SkippedRecording {
                    recording: row.recording.to_string(),
                    status: row.status.as_str(),
                    reason: row.reason,
                    causes: row.causes.into_iter().map(|c| (c.cause, c.count)).collect(),
                });
            }
        }
        Ok(())
    }

    fn add_episodes(&mut self, results: &Results) -> Result<(), ReportError> {
        let mut environments: HashMap<String, usize> = HashMap::new();
        let mut reasons: BTreeMap<(&'static str, String), (u64, usize)> = BTreeMap::new();
        for row in results.episodes() {
            let row = row?;
            let index = self.episodes.len();
            let next = self.environments.len();
            let environment = *environments
                .entry(row.environment().to_owned())
                .or_insert(next);
            if environment == next {
                self.environments.push(EnvironmentSurvey {
                    name: row.environment().to_owned(),
                    ..EnvironmentSurvey::default()
                });
            }
            let of_environment = &mut self.environments[environment];
            of_environment.n_episodes += 1;
            of_environment.n_steps += row.n_steps as u64;
            of_environment.n_segments += row.n_segments as u64;
            if row.status != EpisodeStatus::Ok {
                let reason = row.reason.clone().unwrap_or_default();
                let counted = reasons.entry((row.status.as_str(), reason));
                counted.or_insert((0, index)).0 += 1;
            }
            self.environment.push(environment);
            self.episodes.push(row);
        }
        self.strongest = vec![0.0; self.episodes.len()];
        self.skipped_episodes = reasons
            .into_iter()
            .map(|((status, reason), (count, example))| SkippedEpisodes {
                status,
                reason,
                count,
                example,
            })
            .collect();
        self.skipped_episodes
            .sort_by_key(|s| std::cmp::Reverse(s.count));
        Ok(())
    }

    fn add_segments(&mut self, results: &Results) -> Result<(), ReportError> {
        let by_key: HashMap<&EpisodeKey, usize> = self
            .episodes
            .iter()
            .enumerate()
            .map(|(i, e)| (&e.key, i))
            .collect();
        let mut n_of_joint = 0;
        let mut of: Option<(usize, i32)> = None;
        for row in results.segments() {
            let row = row?;
            // A composite action of an episode that the table has not: of a part that was written meanwhile.
            let Some(&episode) = by_key.get(&row.key) else {
                continue;
            };
            if of != Some((episode, row.joint)) {
                of = Some((episode, row.joint));
                count_joint(&mut self.per_episode, n_of_joint);
                n_of_joint = 0;
            }
            n_of_joint += 1;
            let strongest = &mut self.strongest[episode];
            *strongest = strongest.max(row.state_change_sum);
            self.environments[self.environment[episode]].add(episode, row);
        }
        count_joint(&mut self.per_episode, n_of_joint);
        let n_joints: u64 = self.episodes.iter().map(|e| n_joints(e, results)).sum();
        self.per_episode[0] = n_joints.saturating_sub(self.per_episode.iter().sum());
        for environment in &mut self.environments {
            environment.joints.sort_by_key(|j| j.joint);
            environment.keep_strongest();
            self.ranked.append(&mut environment.strongest);
        }
        strongest_first(&mut self.ranked);
        self.ranked.truncate(RANKED_IN_ALL);
        self.environments_by_name();
        Ok(())
    }

    /// Environments come in the order of their names; episodes keep theirs.
    fn environments_by_name(&mut self) {
        let mut order: Vec<usize> = (0..self.environments.len()).collect();
        order.sort_by(|&a, &b| self.environments[a].name.cmp(&self.environments[b].name));
        let mut place = vec![0; order.len()];
        for (new, &old) in order.iter().enumerate() {
            place[old] = new;
        }
        for environment in &mut self.environment {
            *environment = place[*environment];
        }
        self.environments.sort_by(|a, b| a.name.cmp(&b.name));
    }

    /// Reasons for which episodes were not used whole, the most frequent first; and how many are not named.
    pub(super) fn named_skipped_episodes(&self) -> (&[SkippedEpisodes], usize) {
        let n = self.skipped_episodes.len().min(NAMED_SKIPPED);
        (&self.skipped_episodes[..n], self.skipped_episodes.len() - n)
    }
}

impl EnvironmentSurvey {
    fn add(&mut self, episode: usize, row: SegmentRow) {
        let index = self.joints.iter().position(|j| j.joint == row.joint);
        let index = index.unwrap_or_else(|| {
            self.joints.push(JointSurvey {
                joint: row.joint,
                name: row.joint_name.as_deref().map(ToOwned::to_owned),
                ..JointSurvey::default()
            });
            self.joints.len() - 1
        });
        let joint = &mut self.joints[index];
        if joint.name.as_deref() != row.joint_name.as_deref() || joint.names_differ {
            joint.name = None;
            joint.names_differ = true;
        }
        joint.n_segments += 1;
        joint.n_segment_steps += row.n_steps() as u64;
        joint.lengths[length_bin(row.n_steps())] += 1;
        self.strongest.push(Ranked { episode, row });
        if self.strongest.len() >= 8 * RANKED {
            self.keep_strongest();
        }
    }

    fn keep_strongest(&mut self) {
        strongest_first(&mut self.strongest);
        self.strongest.truncate(RANKED);
    }
}

/// Counts a joint of an episode by its composite actions.
fn count_joint(bins: &mut [u64; LENGTH_BINS + 1], n_segments: usize) {
    if n_segments > 0 {
        bins[length_bin(n_segments) + 1] += 1;
    }
}

/// Joints of an episode that are cut each on its own.
fn n_joints(episode: &EpisodeRow, results: &Results) -> u64 {
    if results.parameters().is_together() {
        1
    } else {
        episode.n_joints as u64
    }
}

/// The largest sum first; equal ones in the order of the table.
fn strongest_first(ranked: &mut [Ranked]) {
    ranked.sort_by(|a, b| {
        let place = |r: &Ranked| (r.episode, r.row.joint, r.row.segment);
        b.row
            .state_change_sum
            .total_cmp(&a.row.state_change_sum)
            .then_with(|| place(a).cmp(&place(b)))
    });
}

/// The bin of a length: 1, 2, 3–4, 5–8, …
fn length_bin(n_steps: usize) -> usize {
    let bin = n_steps
        .saturating_sub(1)
        .checked_ilog2()
        .map_or(0, |log| log + 1);
    (bin as usize).min(LENGTH_BINS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_double_from_bin_to_bin() {
        let bins = [1, 2, 3, 4, 5, 8, 9, 16, 17].map(length_bin);
        assert_eq!(bins, [0, 1, 2, 2, 3, 3, 4, 4, 5]);
        assert_eq!(length_bin(usize::MAX), LENGTH_BINS - 1);
    }
}
