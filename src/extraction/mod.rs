//! The method: composite actions of one episode. Pure and total.
//!
//! J. Laivins and M. Lee, "Automatic Composite Action Discovery for Hierarchical Reinforcement Learning". The steps,
//! one file each:
//!
//! 1. `bin`: each column into b bins (Eq. 1)
//! 2. `probability`: relative frequency of each step's bin (Eq. 3)
//! 3. `window`: windows of w steps, borders repeated (Eq. 4)
//! 4. `measure`: entropy, divergence or distance of the windows (Eq. 5–7)
//! 5. `normalize`: scaled to 0..=1 over the episode (Eq. 8)
//! 6. `mask`: what passes the threshold (Eq. 9), where actions and states do so together (Eq. 10–11)
//! 7. `segment`: boundaries, partition, score
//!
//! `tasks` shares the columns of large episodes out among threads.

mod bin;
mod mask;
mod measure;
mod normalize;
mod params;
mod probability;
mod segment;
mod tasks;
mod window;

pub use params::{
    BINS, DEFAULT_APPROXIMATE_ORDER, DEFAULT_BINS, DEFAULT_PERMUTATION_ORDER, DEFAULT_SAMPLE_ORDER,
    DEFAULT_THRESHOLD, DEFAULT_WINDOW, ExtractionParams, Measure, ORDERS, ParamsError, Profile,
    RawParams, WINDOWS,
};

use crate::model::{Columns, Episode, Extraction, JointExtraction, JointMode, Outcome, Series};
use bin::Binned;
use normalize::Extent;
use probability::Frequencies;
use window::Windows;

/// Finds the composite actions of one episode.
///
/// Total: every episode of finite values has an outcome, and no series holds a NaN. Results do not depend on the
/// number of threads.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use coact::extraction::{ExtractionParams, RawParams, extract};
/// use coact::model::{Columns, Episode, EpisodeKey, Outcome};
///
/// let push = (0..40).map(|t| if (t / 10) % 2 == 0 { 0.0 } else { 1.0 }).collect();
/// let position = (0..40).map(|t| f64::from(t / 10)).collect();
/// let episode = Episode {
///     key: EpisodeKey { recording: Arc::from("r.mcap"), episode: 0, episode_id: None },
///     env_id: None,
///     actions: Columns::new(40, vec![push]),
///     states: Columns::new(40, vec![position]),
///     joint_names: None,
///     times: None,
///     rewards: None,
///     incomplete: None,
///     n_dropped_steps: 0,
/// };
/// let params = ExtractionParams::new(RawParams::default()).unwrap();
/// let Outcome::Extracted(found) = extract(&episode, &params) else { panic!("too short") };
/// assert_eq!(found.joints.len(), 1);
/// assert!(found.joints[0].segments.iter().all(|s| s.start_step < s.end_step));
/// ```
pub fn extract(episode: &Episode, params: &ExtractionParams) -> Outcome {
    let n_steps = episode.n_steps();
    let min_steps = params.min_steps();
    if n_steps < min_steps || episode.actions.n_columns() == 0 {
        return Outcome::TooShort { min_steps };
    }
    let windows = Windows::new(n_steps, params);
    let (state_measure, action_measures) = tasks::join(
        tasks::are_worth_it(n_steps, episode.states.n_columns()),
        || pooled(&episode.states, &windows, params),
        || match params.joints() {
            JointMode::Each => per_joint(&episode.actions, &windows, params),
            JointMode::Together => vec![pooled(&episode.actions, &windows, params)],
        },
    );
    let state = series(state_measure, None, params);
    // The authors' program normalises all joints by one minimum and maximum.
    let shared = (params.profile() == Profile::Authors)
        .then(|| Extent::of(action_measures.iter().map(Vec::as_slice)));
    let joints = action_measures
        .into_iter()
        .map(|measure| joint(series(measure, shared, params), &state, params))
        .collect();
    Outcome::Extracted(Extraction {
        mode: params.joints(),
        state,
        joints,
    })
}

/// One measure for all columns together: bins pooled, the measure averaged.
fn pooled(columns: &Columns, windows: &Windows, params: &ExtractionParams) -> Vec<f64> {
    let n = columns.n_rows();
    let columns: Vec<&[f64]> = columns.iter().collect();
    // Counted while the bins are still in the cache.
    let blocks = tasks::map_blocks(&columns, n, |block| {
        let binned: Vec<Vec<u16>> = block
            .iter()
            .filter_map(|column| match bin::bin(column, params.bins()) {
                Binned::Bins(bins) => Some(bins),
                // Eq. 1 is undefined for it: the paper's profile leaves it out, NumPy's histogram takes the middle bin.
                Binned::Constant => (params.profile() == Profile::Authors)
                    .then(|| vec![middle_bin(params.bins()); n]),
            })
            .collect();
        let frequencies = Frequencies::of(binned.iter().map(Vec::as_slice), params.bins());
        (binned, frequencies)
    });
    let mut frequencies = Frequencies::none(params.bins());
    let mut binned = Vec::with_capacity(columns.len());
    for (block, counted) in blocks {
        frequencies.merge(&counted);
        binned.extend(block);
    }
    measure::mean_measure(&binned, &frequencies, windows, params)
}

#[expect(clippy::cast_possible_truncation, reason = "at most 65536 / 2")]
fn middle_bin(bins: usize) -> u16 {
    (bins / 2) as u16
}

/// One measure for each column, with frequencies of its own.
fn per_joint(columns: &Columns, windows: &Windows, params: &ExtractionParams) -> Vec<Vec<f64>> {
    let columns: Vec<&[f64]> = columns.iter().collect();
    tasks::map_each(&columns, windows.n_steps, |column| {
        let bins = match bin::bin(column, params.bins()) {
            Binned::Bins(bins) => bins,
            Binned::Constant => vec![middle_bin(params.bins()); column.len()],
        };
        let frequencies = Frequencies::of([&bins[..]], params.bins());
        measure::mean_measure(&[bins], &frequencies, windows, params)
    })
}

/// Eq. 8 and 9.
fn series(measure: Vec<f64>, extent: Option<Extent>, params: &ExtractionParams) -> Series {
    let extent = extent.unwrap_or_else(|| Extent::of([&measure[..]]));
    let change = extent.normalize(&measure);
    let mask = mask::threshold(&change, &extent, params);
    Series {
        measure,
        change,
        mask,
    }
}

fn joint(action: Series, state: &Series, params: &ExtractionParams) -> JointExtraction {
    let correlated = mask::correlate(&action.mask, &state.mask, params);
    let boundaries = segment::boundaries(&correlated, params.profile());
    let segments = segment::segments(&boundaries, &state.change);
    JointExtraction {
        action,
        correlated,
        boundaries,
        segments,
    }
}
