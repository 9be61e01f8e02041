//! The earth mover distance of neighbouring windows in integer counts (profile `paper`): exact, whatever the order.
//!
//! The distance of two windows as samples is `Σ |sort(p)_i − sort(q)_i| / W` (the 1-Wasserstein distance). Two windows
//! that start j apart share W − j values, and shared values cancel in it: only the j values that one window has in
//! front and the j that the other has behind are compared. Both are kept sorted while j grows, so that each j costs one
//! insertion on each side (`lanes`).

mod lanes;

use super::super::probability::Frequencies;
use super::super::tasks;
use super::super::window::Windows;
use super::tail::Tail;
use lanes::{LANES, Lane, PADDING, Rows};

/// The mean over the columns of the least distance of each step's window from those it is compared with.
pub(super) fn mean(columns: &[Vec<u16>], frequencies: &Frequencies, windows: &Windows) -> Vec<f64> {
    let width = windows.width as u64;
    let largest = frequencies.counts.iter().copied().max().unwrap_or(0);
    let scale = windows.width as f64 * frequencies.total as f64;
    // In 31 bits no sum of a window overflows; and a distance that is not 0 is none that counts as rounding.
    let sums = match i32::try_from(largest.saturating_mul(width)) {
        Ok(bound) if 1.0 / scale > super::ROUNDING => sums_narrow(
            columns,
            &frequencies.counts,
            windows,
            bound.unsigned_abs().max(1),
        ),
        _ => sums_wide(columns, frequencies, windows),
    };
    let scale = scale * columns.len() as f64;
    sums.into_iter().map(|sum| sum / scale).collect()
}

/// Sums of the least distances, times W; none of them exceeds `bound`.
fn sums_narrow(columns: &[Vec<u16>], counts: &[u64], windows: &Windows, bound: u32) -> Vec<f64> {
    // Distances stay the same where every count is less by the same number.
    let offset = counts.iter().copied().filter(|&c| c > 0).min().unwrap_or(0);
    let counts = || counts.iter().map(|c| c.saturating_sub(offset));
    let short: Option<Vec<u16>> = counts().map(|c| c.try_into().ok()).collect();
    if let Some(counts) = short {
        return sums_of_lanes(columns, &counts, windows, bound);
    }
    let counts: Vec<u32> = counts().map(|c| c.try_into().unwrap_or(u32::MAX)).collect();
    sums_of_lanes(columns, &counts, windows, bound)
}

fn sums_of_lanes<C: Lane>(
    columns: &[Vec<u16>],
    counts: &[C],
    windows: &Windows,
    bound: u32,
) -> Vec<f64> {
    let tail = Tail::new(windows);
    // Integers: how the columns are shared out does not show in their sums.
    let sums = tasks::fold(
        columns,
        windows.n_steps,
        || Kernel::new(windows, &tail, u32::MAX / bound),
        |kernel, column| kernel.add(counts, column),
        Kernel::merge,
    );
    sums.finish().into_iter().map(|sum| sum as f64).collect()
}

/// The same for counts of any size; a distance (divided by `W·total`) up to 1e-14 is 0.
fn sums_wide(columns: &[Vec<u16>], frequencies: &Frequencies, windows: &Windows) -> Vec<f64> {
    let scale = windows.width as f64 * frequencies.total as f64;
    let blocks = tasks::map_blocks(columns, windows.n_steps, |block| {
        let mut sums = vec![0u128; windows.n_steps];
        for column in block {
            let x = Frequencies::look_up(&frequencies.counts, column);
            for (t, sum) in sums.iter_mut().enumerate() {
                let least = least_by_definition(&x, windows, t);
                if least as f64 / scale > super::ROUNDING {
                    *sum += u128::from(least);
                }
            }
        }
        sums
    });
    let sums = blocks.into_iter().reduce(super::add).unwrap_or_default();
    sums.into_iter().map(|sum| sum as f64).collect()
}

fn least_by_definition(x: &[u64], windows: &Windows, t: usize) -> u64 {
    let sorted = |t: usize| {
        let start = windows.start(t);
        let mut window = x[start..start + windows.width].to_vec();
        window.sort_unstable();
        window
    };
    let own = sorted(t);
    windows
        .compared(t)
        .map(|other| {
            let pairs = own.iter().zip(sorted(other));
            pairs.map(|(a, b)| a.abs_diff(b)).sum()
        })
        .min()
        .unwrap_or(0)
}

/// Sums of least distances over several columns, with buffers that are used for each of them.
struct Kernel<'a, C> {
    windows: &'a Windows,
    tail: &'a Tail,
    limits: Vec<u32>,
    /// Counts of one column.
    x: Vec<C>,
    tail_x: Vec<C>,
    rows: Rows<C>,
    /// By window start of the regular steps. 32 bits are half the traffic of 64; emptied before they can overflow.
    regular_sums: Vec<u32>,
    /// By window of the tail.
    tail_sums: Vec<u32>,
    /// Columns that are in the sums of 32 bits, and that fit.
    n_columns: u32,
    max_columns: u32,
    /// By step.
    sums: Vec<u64>,
}

impl<'a, C: Lane> Kernel<'a, C> {
    fn new(windows: &'a Windows, tail: &'a Tail, max_columns: u32) -> Self {
        let n_regular = windows.regular().len().next_multiple_of(LANES);
        let n_tail = tail.limits.len().next_multiple_of(LANES);
        let padding = PADDING + 2 * windows.width;
        let mut limits = tail.limits.clone();
        limits.resize(n_tail, 0);
        Self {
            windows,
            tail,
            limits,
            x: vec![C::default(); (n_regular + padding).max(windows.n_steps)],
            tail_x: vec![C::default(); n_tail + padding],
            rows: Rows::default(),
            regular_sums: vec![0; n_regular],
            tail_sums: vec![0; n_tail],
            n_columns: 0,
            max_columns,
            sums: vec![0; windows.n_steps],
        }
    }

    fn add(&mut self, counts: &[C], column: &[u16]) {
        if self.n_columns == self.max_columns {
            self.empty();
        }
        self.n_columns += 1;
        let (width, rows) = (self.windows.width, &mut self.rows);
        C::look_up(counts, column, &mut self.x);
        self.tail.column(&self.x[..column.len()], &mut self.tail_x);
        C::add_least(&self.x, width, None, rows, &mut self.regular_sums);
        let limits = Some(&self.limits[..]);
        C::add_least(&self.tail_x, width, limits, rows, &mut self.tail_sums);
    }

    fn empty(&mut self) {
        let regular = &mut self.sums[self.windows.regular()];
        for (sum, part) in regular.iter_mut().zip(&mut self.regular_sums) {
            *sum += u64::from(std::mem::take(part));
        }
        for &(at, t) in &self.tail.steps {
            self.sums[t] += u64::from(self.tail_sums[at]);
        }
        self.tail_sums.fill(0);
        self.n_columns = 0;
    }

    fn merge(mut self, other: Self) -> Self {
        for (sum, more) in self.sums.iter_mut().zip(other.finish()) {
            *sum += more;
        }
        self
    }

    /// By step.
    fn finish(mut self) -> Vec<u64> {
        self.empty();
        self.sums
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::params::{ExtractionParams, RawParams};
    use super::*;

    #[test]
    fn kernels_of_all_widths_equal_the_definition() {
        let mut x = 1u64;
        let mut column = |n: usize| -> Vec<u16> {
            (0..n)
                .map(|_| {
                    x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    ((x >> 40) % 7) as u16
                })
                .collect()
        };
        // Counts that need 16 bits, and sums of them more; and counts that need more.
        let counts: [Vec<u64>; 2] = [
            vec![65_535, 40, 1_000, 1, 60_000, 33_000, 2],
            vec![70_000, 4, 1_000_000, 65_537, 90, 65_536, 3],
        ];
        for window in (2..=20).chain([33, 70]) {
            let params = ExtractionParams::new(RawParams {
                window,
                ..RawParams::default()
            })
            .unwrap();
            let shortest = params.min_steps();
            for n in [shortest, shortest + 3, 4 * window + 150, lanes::LANES * 40] {
                let columns = [column(n), column(n), column(n)];
                let windows = Windows::new(n, &params);
                for counts in &counts {
                    let frequencies = Frequencies {
                        counts: counts.clone(),
                        total: counts.iter().sum(),
                    };
                    let wide = sums_wide(&columns, &frequencies, &windows);
                    // Three columns, of which one, two or all fit into sums of 32 bits.
                    for bound in [1 << 31, 1 << 30, 1 << 27] {
                        let narrow = sums_narrow(&columns, counts, &windows, bound);
                        assert_eq!(narrow, wide, "window {window}, {n} steps");
                    }
                }
            }
        }
    }
}
