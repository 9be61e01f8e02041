//! Eq. 5–7: the measure of every window of every column, averaged over the columns.

mod distance;
mod divergence;
mod earth_mover;
mod entropy;

use rayon::prelude::*;

use super::params::{ExtractionParams, Measure, Profile};
use super::probability::Frequencies;
use super::window::Windows;

/// A divergence or distance up to this is rounding and counts as 0.
const ROUNDING: f64 = 1e-14;

/// Two probabilities this much further apart than the tolerance still match (profile `paper`).
const TOLERANCE_SLACK: f64 = 1e-12;

/// r of approximate and sample entropy in profile `paper`, as a share of the standard deviation.
const TOLERANCE_SHARE: f64 = 0.2;

/// Columns that one task takes: fixed, so that sums of f64 do not depend on the number of threads.
const BLOCK: usize = 64;

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
        (Profile::Paper, Measure::EarthMover) => {
            earth_mover_in_integers(columns, frequencies, windows)
        }
        (Profile::Paper, _) => mean_in_blocks(columns, frequencies, windows, params),
        (Profile::Authors, _) => mean_as_numpy(columns, frequencies, windows, params),
    }
}

fn earth_mover_in_integers(
    columns: &[Vec<u16>],
    frequencies: &Frequencies,
    windows: &Windows,
) -> Vec<f64> {
    let n = windows.n_steps;
    let scale = windows.width as f64 * frequencies.total as f64 * columns.len() as f64;
    let narrow: Option<Vec<i32>> = frequencies
        .counts
        .iter()
        .map(|&c| i32::try_from(c).ok())
        .collect::<Option<_>>()
        .filter(|_| frequencies.total.saturating_mul(windows.width as u64) < 1 << 31);
    if let Some(counts) = narrow {
        let sums = columns
            .par_chunks(BLOCK)
            .map(|block| {
                let mut scratch = earth_mover::Scratch::default();
                let mut sums = vec![0u64; n];
                for column in block {
                    earth_mover::add_narrow(
                        &Frequencies::look_up(&counts, column),
                        windows,
                        &mut scratch,
                        &mut sums,
                    );
                }
                sums
            })
            .reduce(|| vec![0; n], add);
        return sums.into_iter().map(|sum| sum as f64 / scale).collect();
    }
    let sums = columns
        .par_chunks(BLOCK)
        .map(|block| {
            let mut scratch = earth_mover::Scratch::default();
            let mut sums = vec![0u128; n];
            for column in block {
                let counts = Frequencies::look_up(&frequencies.counts, column);
                earth_mover::add_wide(&counts, windows, frequencies.total, &mut scratch, &mut sums);
            }
            sums
        })
        .reduce(|| vec![0; n], add);
    sums.into_iter().map(|sum| sum as f64 / scale).collect()
}

#[expect(
    clippy::needless_pass_by_value,
    reason = "the signature that reduce asks for"
)]
fn add<T: std::ops::AddAssign + Copy>(mut a: Vec<T>, b: Vec<T>) -> Vec<T> {
    a.iter_mut().zip(&b).for_each(|(a, b)| *a += *b);
    a
}

/// Columns are added in order within blocks, and the blocks in order.
fn mean_in_blocks(
    columns: &[Vec<u16>],
    frequencies: &Frequencies,
    windows: &Windows,
    params: &ExtractionParams,
) -> Vec<f64> {
    let blocks: Vec<Vec<f64>> = columns
        .par_chunks(BLOCK)
        .map(|block| {
            let mut column = Column::new(frequencies, windows, params);
            block
                .iter()
                .map(|bins| column.measure(bins))
                .reduce(add)
                .unwrap_or_default()
        })
        .collect();
    let n = columns.len() as f64;
    let sums = blocks.into_iter().reduce(add).unwrap_or_default();
    sums.into_iter().map(|sum| sum / n).collect()
}

/// The mean of each step's values over the columns, added as NumPy does.
fn mean_as_numpy(
    columns: &[Vec<u16>],
    frequencies: &Frequencies,
    windows: &Windows,
    params: &ExtractionParams,
) -> Vec<f64> {
    let measures: Vec<Vec<f64>> = columns
        .par_iter()
        .map_init(
            || Column::new(frequencies, windows, params),
            |column, bins| column.measure(bins),
        )
        .collect();
    let n = columns.len() as f64;
    let mut row = vec![0.0; columns.len()];
    (0..windows.n_steps)
        .map(|t| {
            for (value, measure) in row.iter_mut().zip(&measures) {
                *value = measure[t];
            }
            distance::numpy_sum(&row) / n
        })
        .collect()
}

/// Measures one column after the other, with tables and buffers that are used again.
struct Column<'a> {
    frequencies: &'a Frequencies,
    probabilities: Vec<f64>,
    windows: &'a Windows,
    params: &'a ExtractionParams,
}

impl<'a> Column<'a> {
    fn new(
        frequencies: &'a Frequencies,
        windows: &'a Windows,
        params: &'a ExtractionParams,
    ) -> Self {
        Self {
            frequencies,
            probabilities: frequencies.probabilities(),
            windows,
            params,
        }
    }

    /// `E_w` of one column, length `n_steps`.
    fn measure(&mut self, bins: &[u16]) -> Vec<f64> {
        let p = Frequencies::look_up(&self.probabilities, bins);
        let paper = self.params.profile() == Profile::Paper;
        match self.params.measure() {
            Measure::Shannon => {
                let p_ln_p: Vec<f64> = p.iter().map(|p| p * p.ln()).collect();
                self.of_windows(|s, e| entropy::shannon(&p_ln_p[s..e]))
            }
            Measure::Approximate | Measure::Sample => self.regularity(bins, &p),
            Measure::Permutation => {
                let order = self.params.order();
                let codes = entropy::ordinal_patterns(
                    &Frequencies::look_up(&self.frequencies.counts, bins),
                    order,
                );
                let mut counter = entropy::Permutation::default();
                self.of_windows(|s, e| counter.entropy(&codes[s..=e - order]))
            }
            Measure::Kl => self.of_pairs(&p, divergence::kullback_leibler),
            Measure::JensenShannon => {
                self.of_pairs(&p, |p, q| divergence::jensen_shannon(p, q, !paper))
            }
            Measure::TotalVariation => {
                self.of_pairs(&p, |p, q| distance::total_variation(p, q, paper))
            }
            Measure::EarthMover => {
                let mut earth_mover = distance::AuthorsEarthMover::default();
                self.of_pairs(&p, |p, q| earth_mover.distance(p, q))
            }
        }
    }

    /// Approximate and sample entropy: in profile `paper` on integer counts, so that no match hangs on a rounding.
    fn regularity(&self, bins: &[u16], p: &[f64]) -> Vec<f64> {
        let (m, width) = (self.params.order(), self.windows.width);
        let approximate = self.params.measure() == Measure::Approximate;
        match self.params.profile() {
            Profile::Paper => {
                let counts = Frequencies::look_up(&self.frequencies.counts, bins);
                let limit = self.largest_match(&counts);
                let matches = |a: u64, b: u64| a.abs_diff(b) <= limit;
                if approximate {
                    self.of_windows(|s, e| entropy::approximate(&counts[s..e], m, matches))
                } else {
                    self.of_windows(|s, e| entropy::sample(&counts[s..e], m, width - m, matches))
                }
            }
            Profile::Authors => {
                let r = self
                    .params
                    .tolerance()
                    .unwrap_or(if approximate { 0.0 } else { 1.0 });
                let matches = |a: f64, b: f64| (a - b).abs() <= r;
                if approximate {
                    self.of_windows(|s, e| entropy::approximate(&p[s..e], m, matches))
                } else {
                    self.of_windows(|s, e| entropy::sample(&p[s..e], m, width - m + 1, matches))
                }
            }
        }
    }

    /// The largest difference of two counts that matches: `difference / total ≤ r + 1e-12`.
    fn largest_match(&self, counts: &[u64]) -> u64 {
        let total = self.frequencies.total as f64;
        let r = self
            .params
            .tolerance()
            .unwrap_or_else(|| TOLERANCE_SHARE * standard_deviation(counts) / total);
        let bound = r + TOLERANCE_SLACK;
        if bound >= 1.0 {
            return u64::MAX;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "0 ≤ bound < 1"
        )]
        let guess = (bound * total) as u64;
        // The product is rounded: the last step is decided by the comparison itself.
        let matches = |difference: u64| difference as f64 / total <= bound;
        (guess.saturating_sub(1)..=guess + 1)
            .rev()
            .find(|&d| matches(d))
            .unwrap_or(0)
    }

    /// A measure of single windows `[s, e)`: computed once per window, then spread over the steps.
    fn of_windows(&self, mut f: impl FnMut(usize, usize) -> f64) -> Vec<f64> {
        let by_start: Vec<f64> = (0..self.windows.n_starts())
            .map(|s| f(s, s + self.windows.width))
            .collect();
        self.windows.spread(&by_start)
    }

    /// A measure of pairs: the least over the compared windows (Eq. 7).
    fn of_pairs(&self, p: &[f64], mut f: impl FnMut(&[f64], &[f64]) -> f64) -> Vec<f64> {
        let windows = self.windows;
        let window = |t: usize| &p[windows.start(t)..windows.start(t) + windows.width];
        (0..windows.n_steps)
            .map(|t| {
                let least = windows
                    .compared(t)
                    .map(|other| f(window(t), window(other)))
                    .fold(f64::INFINITY, f64::min);
                if least <= ROUNDING { 0.0 } else { least }
            })
            .collect()
    }
}

/// Population standard deviation of counts, from exact sums.
fn standard_deviation(counts: &[u64]) -> f64 {
    let n = counts.len() as u128;
    let (sum, squares) = counts.iter().fold((0u128, 0u128), |(s, q), &c| {
        (s + u128::from(c), q + u128::from(c) * u128::from(c))
    });
    ((n * squares).saturating_sub(sum * sum) as f64).sqrt() / n as f64
}
