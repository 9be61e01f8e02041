//! The measures of profile `paper`, but for the earth mover: columns added up in f64, with tables and buffers that are
//! used again.

use super::super::params::{ExtractionParams, Measure};
use super::super::probability::Frequencies;
use super::super::tasks;
use super::super::window::Windows;
use super::ordinal::{self, Ordinal};
use super::pairs::{self, Pairs};
use super::regularity::{self, Regularity};

/// The mean over the columns of the measure of each step.
///
/// Columns are added in order within blocks, and the blocks in order.
pub(super) fn mean(
    columns: &[Vec<u16>],
    frequencies: &Frequencies,
    windows: &Windows,
    params: &ExtractionParams,
) -> Vec<f64> {
    let method = Method::new(frequencies, windows, params);
    let blocks = tasks::map_blocks(columns, windows.n_steps, |block| {
        let mut scratch = method.scratch();
        let mut sums = vec![0.0; windows.n_steps];
        for column in block {
            method.add(column, &mut scratch, &mut sums);
        }
        sums
    });
    let n = columns.len() as f64;
    let mut sums = blocks.into_iter().reduce(super::add).unwrap_or_default();
    for sum in &mut sums {
        *sum /= n;
    }
    match method {
        Method::Shannon(_) => windows.spread(&window_entropies(&sums, windows)),
        Method::Regularity(_) | Method::Ordinal(_) => windows.spread(&sums),
        Method::Pairs(_) => sums,
    }
}

/// What is added up for each column.
enum Method<'a> {
    /// By bin −p ln p, by step: windows are made of the mean.
    Shannon(Vec<f64>),
    /// By window start.
    Regularity(Regularity<'a>),
    /// By window start.
    Ordinal(Ordinal),
    /// By step.
    Pairs(Pairs<'a>),
}

impl<'a> Method<'a> {
    fn new(frequencies: &'a Frequencies, windows: &'a Windows, params: &ExtractionParams) -> Self {
        if let Some(pairs) = Pairs::new(params.measure(), frequencies, windows) {
            return Self::Pairs(pairs);
        }
        match params.measure() {
            Measure::Approximate | Measure::Sample => {
                Self::Regularity(Regularity::new(frequencies, windows, params))
            }
            Measure::Permutation => {
                Self::Ordinal(Ordinal::new(frequencies, windows, params.order()))
            }
            _ => Self::Shannon(
                frequencies
                    .probabilities()
                    .into_iter()
                    // A bin that no value fell into is never looked up.
                    .map(|p| if p > 0.0 { 0.0 - p * p.ln() } else { 0.0 })
                    .collect(),
            ),
        }
    }

    fn scratch(&self) -> Scratch {
        match self {
            Self::Shannon(_) => Scratch::None,
            Self::Regularity(_) => Scratch::Regularity(Box::default()),
            Self::Ordinal(_) => Scratch::Ordinal(Box::default()),
            Self::Pairs(pairs) => Scratch::Pairs(Box::new(pairs.scratch())),
        }
    }

    fn add(&self, column: &[u16], scratch: &mut Scratch, sums: &mut [f64]) {
        match (self, scratch) {
            (Self::Shannon(table), _) => {
                for (sum, &bin) in sums.iter_mut().zip(column) {
                    *sum += table[usize::from(bin)];
                }
            }
            (Self::Regularity(method), Scratch::Regularity(scratch)) => {
                method.add(column, scratch, sums);
            }
            (Self::Ordinal(method), Scratch::Ordinal(scratch)) => {
                method.add(column, scratch, sums);
            }
            (Self::Pairs(method), Scratch::Pairs(scratch)) => method.add(column, scratch, sums),
            _ => {}
        }
    }
}

/// Buffers of one block.
enum Scratch {
    None,
    Regularity(Box<regularity::Scratch>),
    Ordinal(Box<ordinal::Scratch>),
    Pairs(Box<pairs::Scratch>),
}

/// Shannon entropy is a sum over the steps of a window: it does not matter whether columns or steps are added first.
fn window_entropies(by_step: &[f64], windows: &Windows) -> Vec<f64> {
    let n = windows.n_starts();
    let mut sums = vec![0.0; n];
    for i in 0..windows.width {
        for (sum, term) in sums.iter_mut().zip(&by_step[i..i + n]) {
            *sum += term;
        }
    }
    sums
}
