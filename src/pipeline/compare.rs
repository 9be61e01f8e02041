//! Several measures on the same recordings, which are read once.
//!
//! A round of episodes is read, then each measure is run on it, one after the other, with all threads: so the time of
//! each is its own. Of a round only counts are kept.

mod agreement;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context;
use rayon::prelude::*;

use super::config::{RunError, check_is_file};
use super::inputs;
use super::resume;
use super::source::{Event, Round, Source};
use super::{Interrupt, Progress};
use crate::extraction::{self, ExtractionParams};
use crate::model::{AgreementRow, Comparison, Episode, MeasureRow, Outcome, environment_of};
use crate::recording::ReadOptions;
use crate::summary::RunSummary;
use crate::tables;
use agreement::boundaries;

/// A comparison, as asked for.
#[derive(Debug, Clone)]
pub struct CompareConfig {
    /// Files, folders, globs.
    pub inputs: Vec<PathBuf>,
    /// How recordings are read.
    pub read: ReadOptions,
    /// The measures with their parameters, at least one.
    pub params: Vec<ExtractionParams>,
    /// Steps within which two boundaries are the same.
    pub tolerance_steps: usize,
    /// Where the rows go as Parquet.
    pub output: Option<PathBuf>,
    /// Threads; 0 stands for all cores.
    pub threads: usize,
}

/// Runs all measures on all recordings. The summary is of the reading: what was refused, recovered or failed.
///
/// # Errors
/// As [`super::run`].
pub fn compare(
    config: &CompareConfig,
    on_progress: &(dyn Fn(Progress) + Sync),
    interrupt: &Interrupt,
) -> Result<(Comparison, RunSummary), RunError> {
    let started = Instant::now();
    check_is_file(config.output.as_deref(), "comparisons")?;
    let inputs = inputs::find(&config.inputs)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(config.threads)
        .build()
        .context("cannot start the threads")
        .map_err(RunError::Failed)?;
    pool.install(|| {
        let jobs = resume::all(&inputs);
        let mut source = Source::new(&jobs, &config.read);
        let mut summary = RunSummary::default();
        let mut counts = Counts::new();
        let mut progress = Progress {
            n_recordings_total: jobs.len() as u64,
            bytes_total: jobs.iter().map(|job| job.input.bytes()).sum(),
            ..Progress::default()
        };
        while let Some(round) = source.next_round() {
            if interrupt.is_raised() {
                return Err(RunError::Interrupted);
            }
            progress.bytes += round.bytes;
            measure(config, &round, &mut counts, &mut summary, &mut progress);
            on_progress(progress);
        }
        summary.set_elapsed(started.elapsed());
        let comparison = rows(config, &counts);
        if let Some(path) = &config.output {
            tables::write_comparison(path, &comparison)?;
        }
        Ok((comparison, summary))
    })
}

/// What is counted, by environment.
type Counts = BTreeMap<String, Environment>;

#[derive(Default)]
struct Environment {
    n_episodes: u64,
    n_steps: u64,
    /// By measure, in the order asked for.
    measures: Vec<Measured>,
    /// Boundaries that two measures share, by pair, in the order of [`pairs`].
    n_matched: Vec<u64>,
}

#[derive(Clone, Default)]
struct Measured {
    n_segments: u64,
    n_segment_steps: u64,
    n_boundaries: u64,
    elapsed: Duration,
}

/// Each pair of `n` measures once.
fn pairs(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).flat_map(move |a| (a + 1..n).map(move |b| (a, b)))
}

/// Runs all measures on a round.
fn measure(
    config: &CompareConfig,
    round: &Round,
    counts: &mut Counts,
    summary: &mut RunSummary,
    progress: &mut Progress,
) {
    let mut by_environment: BTreeMap<String, Vec<&Episode>> = BTreeMap::new();
    for event in &round.events {
        if let Event::Episode(_, _, episode) = event {
            let name = environment_of(episode.env_id.as_deref(), &episode.key.recording);
            by_environment
                .entry(name.to_owned())
                .or_default()
                .push(episode);
            progress.n_steps += episode.n_steps() as u64;
            progress.n_episodes += 1;
        }
    }
    for (name, episodes) in by_environment {
        counts.entry(name).or_default().add(config, &episodes);
    }
    let min_steps = config.params[0].min_steps();
    for event in &round.events {
        match event {
            // Only how it was read is told, and for this no measure is needed.
            Event::Episode(_, _, episode) => {
                summary.add_episode(episode, &Outcome::TooShort { min_steps });
            }
            Event::Recording(_, row) => {
                summary.add_recording(row);
                progress.n_recordings += 1;
            }
        }
    }
}

/// What one measure finds in one episode.
struct Found {
    n_segments: u64,
    n_segment_steps: u64,
    /// By joint.
    boundaries: Vec<Vec<usize>>,
}

impl Found {
    fn of(episode: &Episode, params: &ExtractionParams) -> Self {
        let joints = match extraction::extract(episode, params) {
            Outcome::Extracted(extraction) => extraction.joints,
            Outcome::TooShort { .. } => Vec::new(),
        };
        let segments = joints.iter().flat_map(|joint| &joint.segments);
        Self {
            n_segments: segments.clone().count() as u64,
            n_segment_steps: segments.map(|s| (s.end_step - s.start_step) as u64).sum(),
            boundaries: joints.iter().map(|j| boundaries(&j.segments)).collect(),
        }
    }

    fn n_boundaries(&self) -> u64 {
        self.boundaries.iter().map(|b| b.len() as u64).sum()
    }

    fn n_matched(&self, other: &Self, tolerance_steps: usize) -> u64 {
        let joints = self.boundaries.iter().zip(&other.boundaries);
        joints
            .map(|(a, b)| agreement::n_matched(a, b, tolerance_steps))
            .sum()
    }
}

impl Environment {
    fn add(&mut self, config: &CompareConfig, episodes: &[&Episode]) {
        self.n_episodes += episodes.len() as u64;
        self.n_steps += episodes.iter().map(|e| e.n_steps() as u64).sum::<u64>();
        let n = config.params.len();
        self.measures.resize(n, Measured::default());
        self.n_matched.resize(pairs(n).count(), 0);
        let mut found: Vec<Vec<Found>> = Vec::with_capacity(n);
        for (params, measured) in config.params.iter().zip(&mut self.measures) {
            let started = Instant::now();
            let of_measure: Vec<Found> = episodes
                .par_iter()
                .with_max_len(1)
                .map(|episode| Found::of(episode, params))
                .collect();
            measured.elapsed += started.elapsed();
            for found in &of_measure {
                measured.n_segments += found.n_segments;
                measured.n_segment_steps += found.n_segment_steps;
                measured.n_boundaries += found.n_boundaries();
            }
            found.push(of_measure);
        }
        for ((a, b), n_matched) in pairs(n).zip(&mut self.n_matched) {
            let episodes = found[a].iter().zip(&found[b]);
            *n_matched += episodes
                .map(|(a, b)| a.n_matched(b, config.tolerance_steps))
                .sum::<u64>();
        }
    }
}

fn rows(config: &CompareConfig, counts: &Counts) -> Comparison {
    let mut comparison = Comparison {
        tolerance_steps: config.tolerance_steps,
        ..Comparison::default()
    };
    let name = |i: usize| config.params[i].measure().name();
    let profile = |i: usize| config.params[i].profile().name();
    for (environment, found) in counts {
        let environment: Arc<str> = Arc::from(environment.as_str());
        let n_episodes = found.n_episodes as f64;
        for (i, measured) in found.measures.iter().enumerate() {
            let n_segments = measured.n_segments;
            comparison.measures.push(MeasureRow {
                measure: name(i),
                profile: profile(i),
                environment: Arc::clone(&environment),
                n_episodes: found.n_episodes,
                mean_segments: n_segments as f64 / n_episodes,
                mean_length: (n_segments > 0)
                    .then(|| measured.n_segment_steps as f64 / n_segments as f64),
                mean_steps: found.n_steps as f64 / n_episodes,
                seconds: measured.elapsed.as_secs_f64(),
            });
        }
        for ((a, b), &n_matched) in pairs(found.measures.len()).zip(&found.n_matched) {
            let n_boundaries = [a, b].map(|i| found.measures[i].n_boundaries);
            comparison.agreement.push(AgreementRow {
                environment: Arc::clone(&environment),
                a: name(a),
                a_profile: profile(a),
                b: name(b),
                b_profile: profile(b),
                f1: agreement::f1(n_matched, n_boundaries),
            });
        }
    }
    comparison
}
