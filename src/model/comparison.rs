//! Measures side by side: what each finds, and how far they agree.

use std::sync::Arc;

use serde::Serialize;

/// What one measure finds in one environment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MeasureRow {
    /// Its name.
    pub measure: &'static str,
    /// `paper` or `authors`.
    pub profile: &'static str,
    /// As the summary of a run has it: `env_id`, else the folder of the recording, else its name.
    pub environment: Arc<str>,
    /// Episodes, also those that gave nothing.
    pub n_episodes: u64,
    /// Composite actions an episode, over all joints.
    pub mean_segments: f64,
    /// Steps of a composite action; none if there is none.
    pub mean_length: Option<f64>,
    /// Steps of an episode.
    pub mean_steps: f64,
    /// Time that extraction took, all threads at work on nothing else.
    pub seconds: f64,
}

/// How far two measures agree in one environment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AgreementRow {
    /// As in [`MeasureRow`].
    pub environment: Arc<str>,
    /// The first measure.
    pub a: &'static str,
    /// Its profile.
    pub a_profile: &'static str,
    /// The second.
    pub b: &'static str,
    /// Its profile.
    pub b_profile: &'static str,
    /// 2 × matched ÷ (boundaries of the one + of the other), 0 to 1; 1 where neither has any.
    pub f1: f64,
}

/// Several measures on the same recordings.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Comparison {
    /// By environment, then in the order of the measures.
    pub measures: Vec<MeasureRow>,
    /// Each pair of measures once, by environment.
    pub agreement: Vec<AgreementRow>,
    /// Steps within which two boundaries are the same.
    pub tolerance_steps: usize,
}
