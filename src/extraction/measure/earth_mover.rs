//! The earth mover distance of neighbouring windows in integer counts (profile `paper`): exact, whatever the order.
//!
//! Two windows of W values that start j apart share W − j values, and shared values cancel in the distance of sorted
//! samples: only the j values that one window has in front and the j that the other has behind are compared. Both are
//! kept sorted while j grows, so that each j costs one insertion on each side.

use super::super::window::Windows;

/// Windows side by side in one pass of the kernel.
const LANES: usize = 16;

/// Widest window that has a kernel of its own.
const MAX_UNROLLED: usize = 16;

/// Adds to `sums[t]` the smallest distance of the window of step t from those it is compared with, times W.
///
/// `x` holds the column's counts; no distance times W may reach 2^31. `windows` is of profile `paper`.
pub(super) fn add_narrow(x: &[i32], windows: &Windows, scratch: &mut Scratch, sums: &mut [u64]) {
    let interior = windows.interior();
    if windows.width <= MAX_UNROLLED && windows.neighbours == windows.width && !interior.is_empty()
    {
        // Interior step t has its window at t − w_l, so these are starts 0, 1, ….
        let n = interior.len();
        scratch.minimum.resize(n, 0);
        forward_minimum(x, windows.width, &mut scratch.minimum);
        for (sum, &distance) in sums[interior.clone()].iter_mut().zip(&scratch.minimum) {
            *sum += u64::from(distance.unsigned_abs());
        }
        for t in (0..interior.start).chain(interior.end..windows.n_steps) {
            sums[t] += minimum(t, windows, |s, e| {
                scratch.distance(
                    &x[s..s + windows.width],
                    &x[e..e + windows.width],
                    i64::from,
                )
            });
        }
    } else {
        for (t, sum) in sums.iter_mut().enumerate() {
            *sum += minimum(t, windows, |s, e| {
                scratch.distance(
                    &x[s..s + windows.width],
                    &x[e..e + windows.width],
                    i64::from,
                )
            });
        }
    }
}

/// The same for counts of any size; a distance (divided by `W·total`) up to 1e-14 is 0.
pub(super) fn add_wide(
    x: &[u64],
    windows: &Windows,
    total: u64,
    scratch: &mut Scratch,
    sums: &mut [u128],
) {
    let scale = windows.width as f64 * total as f64;
    for (t, sum) in sums.iter_mut().enumerate() {
        let distance = minimum(t, windows, |s, e| {
            scratch.distance(&x[s..s + windows.width], &x[e..e + windows.width], |c| {
                // Sums of counts below 2^63 by far: an episode has fewer values.
                c.cast_signed()
            })
        });
        if distance as f64 / scale > super::ROUNDING {
            *sum += u128::from(distance);
        }
    }
}

/// The smallest distance of step t's window from those it is compared with; 0 ends the search.
fn minimum(t: usize, windows: &Windows, mut distance: impl FnMut(usize, usize) -> u64) -> u64 {
    let start = windows.start(t);
    let mut least = u64::MAX;
    for other in windows.compared(t) {
        least = least.min(distance(start, windows.start(other)));
        if least == 0 {
            break;
        }
    }
    least
}

/// Buffers that are used for each column again.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    minimum: Vec<i32>,
    p: Vec<i64>,
    q: Vec<i64>,
}

impl Scratch {
    /// `Σ |sort(p) − sort(q)|`, by definition.
    fn distance<T: Copy>(&mut self, p: &[T], q: &[T], integer: impl Fn(T) -> i64) -> u64 {
        for (into, from) in [(&mut self.p, p), (&mut self.q, q)] {
            into.clear();
            into.extend(from.iter().map(|&c| integer(c)));
            into.sort_unstable();
        }
        self.p
            .iter()
            .zip(&self.q)
            .map(|(a, b)| a.abs_diff(*b))
            .sum()
    }
}

/// `out[s] = min over j of the distance of the windows that start at s and s + j`, j = 1..=width.
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
    "x86_64+avx2",
    "aarch64+neon"
))]
fn forward_minimum(x: &[i32], width: usize, out: &mut [i32]) {
    match width {
        2 => kernel::<2>(x, out),
        3 => kernel::<3>(x, out),
        4 => kernel::<4>(x, out),
        5 => kernel::<5>(x, out),
        6 => kernel::<6>(x, out),
        7 => kernel::<7>(x, out),
        8 => kernel::<8>(x, out),
        9 => kernel::<9>(x, out),
        10 => kernel::<10>(x, out),
        11 => kernel::<11>(x, out),
        12 => kernel::<12>(x, out),
        13 => kernel::<13>(x, out),
        14 => kernel::<14>(x, out),
        15 => kernel::<15>(x, out),
        _ => kernel::<16>(x, out),
    }
}

#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn kernel<const W: usize>(x: &[i32], out: &mut [i32]) {
    let n = out.len();
    let mut s = 0;
    while s + LANES <= n {
        let block: &mut [i32; LANES] = match out[s..].first_chunk_mut() {
            Some(block) => block,
            None => return,
        };
        *block = lanes::<W>(&x[s..s + 2 * W + LANES - 1]);
        s += LANES;
    }
    if s < n {
        // The last, incomplete block: what lies behind its end is not read but made up.
        let mut padded = [0; 2 * MAX_UNROLLED + LANES];
        let rest = &x[s..(n - 1 + 2 * W).min(x.len())];
        padded[..rest.len()].copy_from_slice(rest);
        let block = lanes::<W>(&padded[..2 * W + LANES - 1]);
        out[s..].copy_from_slice(&block[..n - s]);
    }
}

/// The minima of [`LANES`] windows side by side.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn lanes<const W: usize>(x: &[i32]) -> [i32; LANES] {
    let mut front = [[0; LANES]; W];
    let mut behind = [[0; LANES]; W];
    let mut least = [i32::MAX; LANES];
    for j in 0..W {
        insert(&mut front, j, &x[j..j + LANES]);
        insert(&mut behind, j, &x[W + j..W + j + LANES]);
        let mut distance = [0; LANES];
        for i in 0..=j {
            for l in 0..LANES {
                distance[l] += (front[i][l] - behind[i][l]).abs();
            }
        }
        for l in 0..LANES {
            least[l] = least[l].min(distance[l]);
        }
    }
    least
}

/// Inserts one value per lane into the `j` sorted ones.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn insert<const W: usize>(sorted: &mut [[i32; LANES]; W], j: usize, values: &[i32]) {
    let mut carry = [0; LANES];
    carry.copy_from_slice(&values[..LANES]);
    for row in sorted.iter_mut().take(j) {
        for l in 0..LANES {
            let (low, high) = (row[l].min(carry[l]), row[l].max(carry[l]));
            (row[l], carry[l]) = (low, high);
        }
    }
    sorted[j] = carry;
}
