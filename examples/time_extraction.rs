//! Times `extract` on arrays from a file, without reading or writing: what `scripts/compare_speed.py` holds against
//! Python.
//!
//! The file holds the columns of the actions, then those of the states, one after the other, as f64 in little-endian
//! order. JSON goes to stdout: the seconds that each repetition took and, with `--found`, all that was found.
//!
//! ```sh
//! cargo run --release --example time_extraction -- episode.f64 --joints 1 --state-dims 128
//! ```
#![expect(clippy::print_stdout, reason = "it tells how long it took")]

use std::fs;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use clap::Parser;
use coact::extraction::{
    DEFAULT_BINS, DEFAULT_THRESHOLD, DEFAULT_WINDOW, ExtractionParams, Measure, RawParams, extract,
};
use coact::model::{Columns, Episode, EpisodeKey, Extraction, JointExtraction, Outcome, Series};
use serde_json::{Value, json};

/// Times the extraction of one episode.
#[derive(Parser)]
struct Arguments {
    /// f64, little-endian: the columns of the actions, then those of the states.
    file: PathBuf,
    /// Columns of the actions.
    #[arg(long)]
    joints: usize,
    /// Columns of the states.
    #[arg(long)]
    state_dims: usize,
    /// How often it is timed.
    #[arg(long, default_value_t = 5)]
    repetitions: usize,
    /// Runs before those: until then the allocator asks the system for every buffer anew.
    #[arg(long, default_value_t = 10)]
    warm_up: usize,
    #[arg(long, default_value_t = 1)]
    threads: usize,
    #[arg(long, default_value_t = Measure::default())]
    measure: Measure,
    #[arg(long, default_value_t = DEFAULT_BINS)]
    bins: usize,
    #[arg(long, default_value_t = DEFAULT_WINDOW)]
    window: usize,
    #[arg(long, default_value_t = DEFAULT_THRESHOLD)]
    threshold: f64,
    /// Print what was found, too.
    #[arg(long)]
    found: bool,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads)
        .build_global()?;
    let params = ExtractionParams::new(RawParams {
        measure: arguments.measure,
        bins: arguments.bins,
        window: arguments.window,
        threshold: arguments.threshold,
        ..RawParams::default()
    })?;
    let episode = read_episode(&arguments.file, arguments.joints, arguments.state_dims)?;
    let Outcome::Extracted(found) = extract(&episode, &params) else {
        bail!("{} steps are too few", episode.n_steps());
    };
    for _ in 0..arguments.warm_up {
        black_box(extract(black_box(&episode), &params));
    }
    let seconds: Vec<f64> = (0..arguments.repetitions)
        .map(|_| {
            let start = Instant::now();
            let outcome = black_box(extract(black_box(&episode), &params));
            let seconds = start.elapsed().as_secs_f64();
            drop(outcome);
            seconds
        })
        .collect();
    let found = arguments.found.then(|| extraction(&found));
    println!("{}", json!({ "seconds": seconds, "found": found }));
    Ok(())
}

fn read_episode(path: &Path, n_joints: usize, n_state_dims: usize) -> Result<Episode> {
    let bytes = fs::read(path).with_context(|| path.display().to_string())?;
    let (values, rest) = bytes.as_chunks::<8>();
    let n_columns = n_joints + n_state_dims;
    let n_steps = values.len().checked_div(n_columns).unwrap_or(0);
    ensure!(
        rest.is_empty() && n_steps * n_columns == values.len(),
        "{} holds {} bytes: expected {n_columns} columns of f64",
        path.display(),
        bytes.len()
    );
    let column = |c: usize| {
        let values = &values[c * n_steps..(c + 1) * n_steps];
        values.iter().map(|&x| f64::from_le_bytes(x)).collect()
    };
    let columns =
        |range: std::ops::Range<usize>| Columns::new(n_steps, range.map(column).collect());
    Ok(Episode {
        key: EpisodeKey {
            recording: "arrays".into(),
            episode: 0,
            episode_id: None,
        },
        env_id: None,
        actions: columns(0..n_joints),
        states: columns(n_joints..n_columns),
        joint_names: None,
        times: None,
        rewards: None,
        incomplete: None,
        n_dropped_steps: 0,
    })
}

fn extraction(found: &Extraction) -> Value {
    json!({
        "state": series(&found.state),
        "joints": found.joints.iter().map(joint).collect::<Vec<_>>(),
    })
}

fn series(series: &Series) -> Value {
    json!({ "measure": series.measure, "change": series.change, "mask": series.mask })
}

fn joint(joint: &JointExtraction) -> Value {
    let segments: Vec<Value> = joint
        .segments
        .iter()
        .map(|s| {
            json!([
                s.start_step,
                s.end_step,
                s.state_change_sum,
                s.state_change_peak,
                s.state_change_rank
            ])
        })
        .collect();
    json!({
        "action": series(&joint.action),
        "correlated": joint.correlated,
        "boundaries": joint.boundaries,
        "segments": segments,
    })
}
