//! Eq. 5–7: the measure of every window of every column, averaged over the columns.
//!
//! Profile `paper` leaves the order of operations open: `earth_mover`, `pairs`, `ordinal` and `regularity` use that to
//! take many windows side by side. Profile `authors` fixes it: `authors` follows the definitions in `distance`,
//! `divergence` and `entropy` window by window, and the fast ones are tested against these.

mod authors;
mod distance;
mod divergence;
mod earth_mover;
mod entropy;
mod logarithm;
mod look_up;
mod ordinal;
mod pairs;
mod paper;
mod regularity;
mod tail;

use super::params::{ExtractionParams, Measure, Profile};
use super::probability::Frequencies;
use super::window::Windows;

/// A divergence or distance up to this is rounding and counts as 0.
const ROUNDING: f64 = 1e-14;

/// `E_w`: the measure of each step, the mean over `columns`; length `n_steps`. Without columns it is 0.
pub(super) fn mean_measure(
    columns: &[Vec<u16>],
    frequencies: &Frequencies,
    windows: &Windows,
    params: &ExtractionParams,
) -> Vec<f64> {
    if columns.is_empty() {
        return vec![0.0; windows.n_steps];
    }
    match (params.profile(), params.measure()) {
        (Profile::Paper, Measure::EarthMover) => earth_mover::mean(columns, frequencies, windows),
        (Profile::Paper, _) => paper::mean(columns, frequencies, windows, params),
        (Profile::Authors, _) => authors::mean(columns, frequencies, windows, params),
    }
}

/// Adds two series; the signature is the one that `reduce` asks for.
#[expect(clippy::needless_pass_by_value, reason = "see above")]
fn add<T: std::ops::AddAssign + Copy>(mut a: Vec<T>, b: Vec<T>) -> Vec<T> {
    a.iter_mut().zip(&b).for_each(|(a, b)| *a += *b);
    a
}
