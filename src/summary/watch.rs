//! What a watch has done, while it goes on and when it ends.

use serde::Serialize;

use super::RunSummary;
use crate::text::{count, counted};

/// What a watch has added to the tables, and how it leaves the folder.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct WatchSummary {
    /// Commits made.
    pub n_commits: u64,
    /// Episodes.
    pub n_episodes: u64,
    /// Steps used.
    pub n_steps: u64,
    /// Composite actions.
    pub n_segments: u64,
    /// Recordings in the folder whose rows are all there.
    pub n_complete: u64,
    /// Those that are still being written, or are not read any further.
    pub n_growing: u64,
}

impl WatchSummary {
    /// Counts a commit.
    pub fn add(&mut self, committed: &RunSummary) {
        self.n_commits += 1;
        self.n_episodes += committed.episodes.values().sum::<u64>();
        self.n_steps += committed.n_steps;
        self.n_segments += committed.n_segments;
    }

    /// One line for people.
    pub fn to_text(&self) -> String {
        format!(
            "{} in {}; {} complete, {} not\n",
            found(self.n_episodes, self.n_steps, self.n_segments),
            counted(self.n_commits, "commit"),
            counted(self.n_complete, "recording"),
            count(self.n_growing),
        )
    }

    /// As one JSON object.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_default()
    }
}

impl RunSummary {
    /// What one commit holds, as a line for people.
    pub fn committed_text(&self) -> String {
        let n_episodes = self.episodes.values().sum();
        found(n_episodes, self.n_steps, self.n_segments) + "\n"
    }
}

fn found(n_episodes: u64, n_steps: u64, n_segments: u64) -> String {
    format!(
        "{}, {}: {}",
        counted(n_episodes, "episode"),
        counted(n_steps, "step"),
        counted(n_segments, "composite action"),
    )
}
