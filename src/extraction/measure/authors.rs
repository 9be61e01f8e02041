//! The measures of profile `authors`: window by window in plain f64, in the order of operations of the authors' program.

use super::super::params::{ExtractionParams, Measure};
use super::super::probability::Frequencies;
use super::super::tasks;
use super::super::window::Windows;
use super::{ROUNDING, distance, divergence, entropy};

/// The mean of each step's values over the columns, added as NumPy does.
pub(super) fn mean(
    columns: &[Vec<u16>],
    frequencies: &Frequencies,
    windows: &Windows,
    params: &ExtractionParams,
) -> Vec<f64> {
    let column = Column {
        frequencies,
        probabilities: frequencies.probabilities(),
        windows,
        params,
    };
    let measures = tasks::map_each(columns, windows.n_steps, |bins| column.measure(bins));
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

/// Measures one column at a time.
struct Column<'a> {
    frequencies: &'a Frequencies,
    probabilities: Vec<f64>,
    windows: &'a Windows,
    params: &'a ExtractionParams,
}

impl Column<'_> {
    /// `E_w` of one column, length `n_steps`.
    fn measure(&self, bins: &[u16]) -> Vec<f64> {
        let p = Frequencies::look_up(&self.probabilities, bins);
        let (order, width) = (self.params.order(), self.windows.width);
        match self.params.measure() {
            Measure::Shannon => {
                let p_ln_p: Vec<f64> = p.iter().map(|p| p * p.ln()).collect();
                self.of_windows(|s, e| entropy::shannon(&p_ln_p[s..e]))
            }
            Measure::Approximate => {
                let r = self.params.tolerance().unwrap_or(0.0);
                let matches = |a: f64, b: f64| (a - b).abs() <= r;
                self.of_windows(|s, e| entropy::approximate(&p[s..e], order, matches))
            }
            Measure::Sample => {
                let r = self.params.tolerance().unwrap_or(1.0);
                let matches = |a: f64, b: f64| (a - b).abs() <= r;
                let n_short = width - order + 1;
                self.of_windows(|s, e| entropy::sample(&p[s..e], order, n_short, matches))
            }
            Measure::Permutation => {
                let counts = Frequencies::look_up(&self.frequencies.counts, bins);
                let codes = entropy::ordinal_patterns(&counts, order);
                let mut counter = entropy::Permutation::default();
                self.of_windows(|s, e| counter.entropy(&codes[s..=e - order]))
            }
            Measure::Kl => self.of_pairs(bins, &p, divergence::kullback_leibler),
            Measure::JensenShannon => {
                self.of_pairs(bins, &p, |p, q| divergence::jensen_shannon(p, q, true))
            }
            Measure::TotalVariation => {
                self.of_pairs(bins, &p, |p, q| distance::total_variation(p, q, false))
            }
            Measure::EarthMover => {
                let mut earth_mover = distance::AuthorsEarthMover::default();
                self.of_pairs(bins, &p, |p, q| earth_mover.distance(p, q))
            }
        }
    }

    /// A measure of single windows `[s, e)`: computed once per window, then spread over the steps.
    fn of_windows(&self, mut f: impl FnMut(usize, usize) -> f64) -> Vec<f64> {
        let by_start: Vec<f64> = (0..self.windows.n_starts())
            .map(|s| f(s, s + self.windows.width))
            .collect();
        self.windows.spread(&by_start)
    }

    /// A measure of pairs: the least over the compared windows (Eq. 7).
    ///
    /// Windows of the same bins have exactly the value 0 in each of these measures, and nothing is less than 0 but by
    /// rounding: then the search is over.
    fn of_pairs(
        &self,
        bins: &[u16],
        p: &[f64],
        mut f: impl FnMut(&[f64], &[f64]) -> f64,
    ) -> Vec<f64> {
        let windows = self.windows;
        let window = |t: usize| windows.start(t)..windows.start(t) + windows.width;
        (0..windows.n_steps)
            .map(|t| {
                let own = window(t);
                let mut least = f64::INFINITY;
                for other in windows.compared(t).map(window) {
                    if bins[own.clone()] == bins[other.clone()] {
                        return 0.0;
                    }
                    least = least.min(f(&p[own.clone()], &p[other]));
                    if least <= ROUNDING {
                        return 0.0;
                    }
                }
                least
            })
            .collect()
    }
}
