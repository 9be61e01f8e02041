//! The earth mover distance of neighbouring windows in integer counts (profile `paper`): exact, whatever the order.
//!
//! The distance of two windows as samples is `Σ |sort(p)_i − sort(q)_i| / W` (the 1-Wasserstein distance). Two windows
//! that start j apart share W − j values, and shared values cancel in it: only the j values that one window has in
//! front and the j that the other has behind are compared. Both are kept sorted while j grows, so that each j costs one
//! insertion on each side.

use super::super::probability::Frequencies;
use super::super::tasks;
use super::super::window::Windows;
use super::tail::Tail;

/// Windows that a kernel takes at a time: sums hold whole blocks of them, and columns are padded for the last one.
const LANES: usize = 64;

/// Widest window that has a kernel of its own.
const MAX_UNROLLED: usize = 16;

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
#[expect(
    clippy::cast_possible_truncation,
    reason = "the counts fit, as the caller has found"
)]
fn sums_narrow(columns: &[Vec<u16>], counts: &[u64], windows: &Windows, bound: u32) -> Vec<f64> {
    let counts: Vec<i32> = counts.iter().map(|&c| c as i32).collect();
    let tail = Tail::new(windows);
    // Sums of 32 bits are half the traffic of the kernel; they are emptied before they can overflow.
    let columns_that_fit = (u32::MAX / bound) as usize;
    let blocks = tasks::map_blocks(columns, windows.n_steps, |block| {
        let mut kernel = Kernel::new(windows, &tail);
        let mut sums = vec![0u64; windows.n_steps];
        for some in block.chunks(columns_that_fit) {
            for column in some {
                kernel.add(&counts, column);
            }
            kernel.empty_into(&mut sums);
        }
        sums
    });
    let sums = blocks.into_iter().reduce(super::add).unwrap_or_default();
    sums.into_iter().map(|sum| sum as f64).collect()
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
struct Kernel<'a> {
    windows: &'a Windows,
    tail: &'a Tail,
    limits: Vec<u32>,
    /// Counts of one column.
    x: Vec<i32>,
    tail_x: Vec<i32>,
    /// By window start of the regular steps.
    regular_sums: Vec<u32>,
    /// By window of the tail.
    tail_sums: Vec<u32>,
    rows: Rows,
}

impl<'a> Kernel<'a> {
    fn new(windows: &'a Windows, tail: &'a Tail) -> Self {
        let blocks = |n: usize| n.next_multiple_of(LANES);
        let n_regular = blocks(windows.regular().len());
        let n_tail = blocks(tail.limits.len());
        let padding = 2 * windows.width.max(MAX_UNROLLED);
        let mut limits = tail.limits.clone();
        limits.resize(n_tail, 0);
        Self {
            windows,
            tail,
            limits,
            x: vec![0; (n_regular + padding).max(windows.n_steps)],
            tail_x: vec![0; n_tail + padding],
            regular_sums: vec![0; n_regular],
            tail_sums: vec![0; n_tail],
            rows: Rows::default(),
        }
    }

    fn add(&mut self, counts: &[i32], column: &[u16]) {
        let (width, rows) = (self.windows.width, &mut self.rows);
        Frequencies::look_up_into(counts, column, &mut self.x);
        self.tail.column(&self.x[..column.len()], &mut self.tail_x);
        add_least(&self.x, width, None, rows, &mut self.regular_sums);
        let limits = Some(&self.limits[..]);
        add_least(&self.tail_x, width, limits, rows, &mut self.tail_sums);
    }

    fn empty_into(&mut self, sums: &mut [u64]) {
        let regular = &mut sums[self.windows.regular()];
        for (sum, part) in regular.iter_mut().zip(&self.regular_sums) {
            *sum += u64::from(*part);
        }
        for &(at, t) in &self.tail.steps {
            sums[t] += u64::from(self.tail_sums[at]);
        }
        self.regular_sums.fill(0);
        self.tail_sums.fill(0);
    }
}

/// `sums[s] += min over j of the distance of the windows that start at s and s + j`, j = 1..=W, or up to the limit of
/// the window.
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
    "x86_64+avx2",
    "aarch64+neon"
))]
fn add_least(x: &[i32], width: usize, limits: Option<&[u32]>, rows: &mut Rows, sums: &mut [u32]) {
    match width {
        2 => unrolled::<2>(x, limits, sums),
        3 => unrolled::<3>(x, limits, sums),
        4 => unrolled::<4>(x, limits, sums),
        5 => unrolled::<5>(x, limits, sums),
        6 => unrolled::<6>(x, limits, sums),
        7 => unrolled::<7>(x, limits, sums),
        8 => unrolled::<8>(x, limits, sums),
        9 => unrolled::<9>(x, limits, sums),
        10 => unrolled::<10>(x, limits, sums),
        11 => unrolled::<11>(x, limits, sums),
        12 => unrolled::<12>(x, limits, sums),
        13 => unrolled::<13>(x, limits, sums),
        14 => unrolled::<14>(x, limits, sums),
        15 => unrolled::<15>(x, limits, sums),
        16 => unrolled::<16>(x, limits, sums),
        _ => rolled(x, width, limits, rows, sums),
    }
}

/// The kernel of narrow windows: written for one window, its inner loops unrolled, so that the compiler turns the loop
/// over the windows into vectors whose sorted values stay in registers.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn unrolled<const W: usize>(x: &[i32], limits: Option<&[u32]>, sums: &mut [u32]) {
    for (block, sums) in sums.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        let start = block * LANES;
        // Arrays of known length: no index in the loop is checked.
        let Some(x) = x[start..].first_chunk::<{ LANES + 2 * MAX_UNROLLED }>() else {
            return;
        };
        match limits.and_then(|limits| limits[start..].first_chunk::<LANES>()) {
            None => {
                for (s, sum) in sums.iter_mut().enumerate() {
                    *sum += least::<W>(x, s, u32::MAX);
                }
            }
            Some(limits) => {
                for (s, sum) in sums.iter_mut().enumerate() {
                    *sum += least::<W>(x, s, limits[s]);
                }
            }
        }
    }
}

/// Repeats a block for `$i` = 0..[`MAX_UNROLLED`], each time a constant. Loops that the compiler unrolls itself keep it
/// from making vectors of the loop around them where they are nested or long.
macro_rules! unroll {
    ($i:ident, $block:block) => {
        unroll!($i, $block, 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15);
    };
    ($i:ident, $block:block, $($n:literal)*) => {
        $({
            const $i: usize = $n;
            $block
        })*
    };
}

#[expect(
    clippy::inline_always,
    clippy::absurd_extreme_comparisons,
    reason = "must be compiled with the features of its caller; 0 is one of the constants"
)]
#[inline(always)]
fn least<const W: usize>(x: &[i32; LANES + 2 * MAX_UNROLLED], start: usize, limit: u32) -> u32 {
    let mut front = [0; MAX_UNROLLED];
    let mut behind = [0; MAX_UNROLLED];
    let mut least = if limit == 0 { 0 } else { i32::MAX };
    unroll!(J, {
        if J < W {
            insert::<J>(&mut front, x[start + J]);
            insert::<J>(&mut behind, x[start + W + J]);
            let mut distance = 0;
            unroll!(I, {
                if I <= J {
                    distance += (front[I] - behind[I]).abs();
                }
            });
            let nearer = distance < least && J < limit as usize;
            least = if nearer { distance } else { least };
        }
    });
    least.unsigned_abs()
}

/// Inserts a value into the `J` sorted ones.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn insert<const J: usize>(sorted: &mut [i32; MAX_UNROLLED], value: i32) {
    let mut carry = value;
    unroll!(I, {
        if I < J {
            let x = sorted[I];
            sorted[I] = x.min(carry);
            carry = x.max(carry);
        }
    });
    sorted[J] = carry;
}

/// Buffers of the kernel of wide windows.
#[derive(Debug, Default)]
struct Rows {
    front: Vec<[i32; LANES]>,
    behind: Vec<[i32; LANES]>,
}

/// The kernel of wide windows: [`LANES`] of them side by side, in rows that stay in the cache.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn rolled(x: &[i32], width: usize, limits: Option<&[u32]>, rows: &mut Rows, sums: &mut [u32]) {
    rows.front.resize(width, [0; LANES]);
    rows.behind.resize(width, [0; LANES]);
    for (block, sums) in sums.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        let start = block * LANES;
        let limits = limits.and_then(|limits| limits[start..].first_chunk());
        let least = rolled_block(
            &x[start..],
            width,
            limits.unwrap_or(&[u32::MAX; LANES]),
            rows,
        );
        for (sum, least) in sums.iter_mut().zip(least) {
            *sum += least.unsigned_abs();
        }
    }
}

#[expect(
    clippy::inline_always,
    clippy::cast_possible_truncation,
    reason = "must be compiled with the features of its caller; no window is wider than 1024"
)]
#[inline(always)]
fn rolled_block(x: &[i32], width: usize, limits: &[u32; LANES], rows: &mut Rows) -> [i32; LANES] {
    let Rows { front, behind } = rows;
    let mut least = [i32::MAX; LANES];
    for j in 0..width {
        insert_row(front, j, &x[j..]);
        insert_row(behind, j, &x[width + j..]);
        let mut distance = [0; LANES];
        for (front, behind) in front[..=j].iter().zip(&behind[..=j]) {
            for l in 0..LANES {
                distance[l] += (front[l] - behind[l]).abs();
            }
        }
        for l in 0..LANES {
            let nearer = distance[l] < least[l] && (j as u32) < limits[l];
            least[l] = if nearer { distance[l] } else { least[l] };
        }
    }
    for l in 0..LANES {
        least[l] = if limits[l] == 0 { 0 } else { least[l] };
    }
    least
}

/// Inserts one value per lane into the `j` sorted rows.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn insert_row(sorted: &mut [[i32; LANES]], j: usize, values: &[i32]) {
    let mut carry = [0; LANES];
    carry.copy_from_slice(&values[..LANES]);
    for row in &mut sorted[..j] {
        for l in 0..LANES {
            let (low, high) = (row[l].min(carry[l]), row[l].max(carry[l]));
            row[l] = low;
            carry[l] = high;
        }
    }
    sorted[j] = carry;
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
        for window in (2..=20).chain([33, 70]) {
            let params = ExtractionParams::new(RawParams {
                window,
                ..RawParams::default()
            })
            .unwrap();
            for n in [params.min_steps(), params.min_steps() + 3, 4 * window + 150] {
                let columns = [column(n), column(n), column(n)];
                let frequencies = Frequencies::of(columns.iter().map(Vec::as_slice), 64);
                let windows = Windows::new(n, &params);
                let wide = sums_wide(&columns, &frequencies, &windows);
                // Three columns, of which one or two fit into sums of 32 bits.
                for bound in [1 << 31, 1 << 30, 1] {
                    let narrow = sums_narrow(&columns, &frequencies.counts, &windows, bound);
                    assert_eq!(narrow, wide, "window {window}, {n} steps");
                }
            }
        }
    }
}
