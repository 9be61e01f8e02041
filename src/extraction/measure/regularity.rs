//! Approximate and sample entropy of all windows of a column (profile `paper`).
//!
//! Both count pairs of templates that match, and whether two do depends on their first steps alone, not on the window:
//! for each distance of the two ("lag") matches are found once for the whole column, and windows add them up. Counts of
//! bins are integers that f64 holds exactly, so no match hangs on a rounding. `entropy.rs` has the plain definitions,
//! which the tests hold these against.

use super::super::params::{ExtractionParams, Measure};
use super::super::probability::Frequencies;
use super::super::window::Windows;

/// Windows that are taken at a time: what is kept of them stays in the cache.
const CHUNK: usize = 2048;

/// Pairs of templates that are taken as the bits of an index into a table of entropies.
const MAX_BITS: usize = 12;

/// Largest table of sample entropies.
const MAX_TABLE: usize = 1 << 14;

/// r of the paper's profile, as a share of the standard deviation.
const TOLERANCE_SHARE: f64 = 0.2;

/// Two probabilities this much further apart than the tolerance still match.
const TOLERANCE_SLACK: f64 = 1e-12;

/// Approximate or sample entropy with its tables.
#[derive(Debug)]
pub(super) struct Regularity<'a> {
    frequencies: &'a Frequencies,
    /// By bin.
    counts: Vec<f64>,
    tolerance: Option<f64>,
    shape: Shape,
    n_starts: usize,
    method: Method,
}

/// Sizes of the templates in a window.
#[derive(Debug, Clone, Copy)]
struct Shape {
    width: usize,
    /// m
    order: usize,
    /// Templates of length m.
    n_short: usize,
    /// Templates of length m + 1.
    n_long: usize,
}

#[derive(Debug)]
enum Method {
    /// By the bits of the pairs that match.
    ApproximateByBits(Vec<f64>),
    /// By the number of templates that each template matches.
    Approximate,
    /// By the numbers of long and short pairs that match; empty if there are too many.
    Sample { table: Vec<f64> },
}

impl<'a> Regularity<'a> {
    pub(super) fn new(
        frequencies: &'a Frequencies,
        windows: &Windows,
        params: &ExtractionParams,
    ) -> Self {
        let (width, order) = (windows.width, params.order());
        let approximate = params.measure() == Measure::Approximate;
        let n_long = width - order;
        let n_short = if approximate { n_long + 1 } else { n_long };
        let shape = Shape {
            width,
            order,
            n_short,
            n_long,
        };
        let pairs = |n: usize| n * (n - 1) / 2;
        let method = if !approximate {
            Method::Sample {
                table: sample_table(pairs(n_long)),
            }
        } else if pairs(n_short) + pairs(n_long) <= MAX_BITS {
            Method::ApproximateByBits(approximate_table(shape))
        } else {
            Method::Approximate
        };
        Self {
            frequencies,
            counts: frequencies.counts.iter().map(|&c| c as f64).collect(),
            tolerance: params.tolerance(),
            shape,
            n_starts: windows.n_starts(),
            method,
        }
    }

    /// Adds to `sums[s]` the entropy of the window that starts at s.
    pub(super) fn add(&self, bins: &[u16], scratch: &mut Scratch, sums: &mut [f64]) {
        let Scratch { x, lags, pairs } = scratch;
        x.resize(bins.len(), 0.0);
        Frequencies::look_up_into(&self.counts, bins, x);
        let limit = self.largest_match(bins);
        for (chunk, sums) in sums[..self.n_starts].chunks_mut(CHUNK).enumerate() {
            let start = chunk * CHUNK;
            let x = &x[start..start + sums.len() + self.shape.width - 1];
            lags.find(x, limit, self.shape);
            match &self.method {
                Method::ApproximateByBits(table) => {
                    pairs.clear();
                    pairs.resize(sums.len(), 0);
                    collect_bits(lags, self.shape, pairs);
                    for (sum, &bits) in sums.iter_mut().zip(pairs.iter()) {
                        *sum += table[bits as usize];
                    }
                }
                Method::Approximate => add_approximate(lags, self.shape, sums),
                Method::Sample { table } => {
                    let all = self.shape.n_long * (self.shape.n_long - 1) / 2;
                    pairs.clear();
                    pairs.resize(2 * sums.len(), 0);
                    let (long, short) = pairs.split_at_mut(sums.len());
                    count_pairs(&lags.long, self.shape.n_long, long);
                    count_pairs(&lags.short, self.shape.n_short, short);
                    for ((sum, &long), &short) in sums.iter_mut().zip(&*long).zip(&*short) {
                        *sum += if table.is_empty() {
                            sample(long, short, all)
                        } else {
                            table[long as usize * (all + 1) + short as usize]
                        };
                    }
                }
            }
        }
    }

    /// The largest difference of two counts that matches: `difference / total ≤ r + 1e-12`.
    fn largest_match(&self, bins: &[u16]) -> f64 {
        let total = self.frequencies.total as f64;
        let r = self
            .tolerance
            .unwrap_or_else(|| TOLERANCE_SHARE * self.standard_deviation(bins) / total);
        let bound = r + TOLERANCE_SLACK;
        if bound >= 1.0 {
            return f64::INFINITY;
        }
        let guess = (bound * total).floor();
        // The product is rounded: the last step is decided by the comparison itself.
        [guess + 1.0, guess, guess - 1.0]
            .into_iter()
            .find(|difference| difference / total <= bound)
            .unwrap_or(0.0)
            .max(0.0)
    }

    /// Population standard deviation of a column's counts, from exact sums.
    fn standard_deviation(&self, bins: &[u16]) -> f64 {
        let counts = &self.frequencies.counts;
        let n = bins.len() as u128;
        let of = |&bin: &u16| counts[usize::from(bin)];
        let largest = counts.iter().copied().max().unwrap_or(0);
        let fits = largest
            .checked_mul(largest)
            .and_then(|square| square.checked_mul(bins.len() as u64))
            .is_some();
        let (sum, squares) = if fits {
            let add = |(s, q): (u64, u64), c: u64| (s + c, q + c * c);
            let (s, q) = bins.iter().map(of).fold((0, 0), add);
            (u128::from(s), u128::from(q))
        } else {
            let add = |(s, q): (u128, u128), c: u128| (s + c, q + c * c);
            bins.iter().map(of).map(u128::from).fold((0, 0), add)
        };
        ((n * squares).saturating_sub(sum * sum) as f64).sqrt() / n as f64
    }
}

/// Buffers that are used for each column again.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    x: Vec<f64>,
    lags: Lags,
    pairs: Vec<u32>,
}

/// Which templates match the one that starts `lag` steps later, by the start of the first.
#[derive(Debug, Default)]
struct Lags {
    steps: Vec<u8>,
    /// By lag − 1: templates of length m.
    short: Vec<Vec<u8>>,
    /// By lag − 1: templates of length m + 1.
    long: Vec<Vec<u8>>,
}

impl Lags {
    fn find(&mut self, x: &[f64], limit: f64, shape: Shape) {
        self.short.resize_with(shape.n_short - 1, Vec::new);
        self.long.resize_with(shape.n_long - 1, Vec::new);
        for lag in 1..shape.n_short {
            self.steps.resize(x.len() - lag, 0);
            match_steps(x, lag, limit, &mut self.steps);
            let short = &mut self.short[lag - 1];
            short.clear();
            short.extend_from_slice(&self.steps[..self.steps.len() + 1 - shape.order]);
            for r in 1..shape.order {
                and(short, &self.steps[r..]);
            }
            if lag < shape.n_long {
                let long = &mut self.long[lag - 1];
                long.clear();
                long.extend_from_slice(&short[..short.len() - 1]);
                and(long, &self.steps[shape.order..]);
            }
        }
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
    "x86_64+avx2",
    "aarch64+neon"
))]
fn match_steps(x: &[f64], lag: usize, limit: f64, matches: &mut [u8]) {
    for ((found, a), b) in matches.iter_mut().zip(x).zip(&x[lag..]) {
        *found = u8::from((a - b).abs() <= limit);
    }
}

fn and(all: &mut [u8], more: &[u8]) {
    for (all, more) in all.iter_mut().zip(more) {
        *all &= more;
    }
}

/// Adds to `pairs[s]` how many pairs of the n templates from s on match.
fn count_pairs(lags: &[Vec<u8>], n: usize, pairs: &mut [u32]) {
    // Few are added up side by side, many slide along.
    const FEW: usize = 16;
    for (matches, n_pairs) in lags.iter().zip((1..n).rev()) {
        if n_pairs <= FEW {
            for i in 0..n_pairs {
                for (pairs, &found) in pairs.iter_mut().zip(&matches[i..]) {
                    *pairs += u32::from(found);
                }
            }
        } else {
            let mut count: u32 = matches[..n_pairs - 1].iter().map(|&m| u32::from(m)).sum();
            let entering = &matches[n_pairs - 1..];
            for ((pairs, &enters), &leaves) in pairs.iter_mut().zip(entering).zip(matches) {
                count += u32::from(enters);
                *pairs += count;
                count -= u32::from(leaves);
            }
        }
    }
}

/// The entropy for each number of long and of short pairs that match; empty if that would be a large table.
fn sample_table(all: usize) -> Vec<f64> {
    if (all + 1) * (all + 1) > MAX_TABLE {
        return Vec::new();
    }
    let counts = || 0..=u32::try_from(all).unwrap_or(0);
    counts()
        .flat_map(|long| counts().map(move |short| sample(long, short, all)))
        .collect()
}

/// `−ln(long / short)`, or the largest value that could be measured.
fn sample(long: u32, short: u32, all: usize) -> f64 {
    if long == 0 || short == 0 {
        return (all as f64).ln();
    }
    // Adding 0 turns the −0 of equal counts into 0.
    0.0 - (f64::from(long) / f64::from(short)).ln() + 0.0
}

/// Sets a bit of `bits[s]` for each pair of templates of the window that match, in the order of [`bit_pairs`].
fn collect_bits(lags: &Lags, shape: Shape, bits: &mut [u32]) {
    let mut place = 0;
    for (lags, n) in [(&lags.short, shape.n_short), (&lags.long, shape.n_long)] {
        for (first, second) in bit_pairs(n) {
            let matches = &lags[second - first - 1][first..];
            for (bits, &found) in bits.iter_mut().zip(matches) {
                *bits |= u32::from(found) << place;
            }
            place += 1;
        }
    }
}

fn bit_pairs(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).flat_map(move |first| (first + 1..n).map(move |second| (first, second)))
}

/// The approximate entropy for each set of pairs that match.
fn approximate_table(shape: Shape) -> Vec<f64> {
    let n_bits = bit_pairs(shape.n_short).count() + bit_pairs(shape.n_long).count();
    (0..1u32 << n_bits)
        .map(|bits| {
            let mut place = 0;
            let [short, long] = [shape.n_short, shape.n_long].map(|n| {
                let mut similar = vec![1usize; n];
                for (first, second) in bit_pairs(n) {
                    let found = usize::from(bits >> place & 1 == 1);
                    similar[first] += found;
                    similar[second] += found;
                    place += 1;
                }
                let logs = similar.iter().map(|&c| (c as f64 / n as f64).ln());
                logs.fold(0.0, |sum, log| sum + log) / n as f64
            });
            (short - long).abs()
        })
        .collect()
}

/// Adds the approximate entropy of each window, from the number of templates that each template matches.
fn add_approximate(lags: &Lags, shape: Shape, sums: &mut [f64]) {
    let [short, long] =
        [(&lags.short, shape.n_short), (&lags.long, shape.n_long)].map(|(matches, n)| {
            let terms: Vec<f64> = (0..=n).map(|c| (c as f64 / n as f64).ln()).collect();
            let mut phi = vec![0.0; sums.len()];
            let mut similar = vec![0u16; sums.len()];
            for i in 0..n {
                similar.fill(1);
                for k in (0..n).filter(|&k| k != i) {
                    let found = &matches[i.abs_diff(k) - 1][i.min(k)..];
                    for (count, &found) in similar.iter_mut().zip(found) {
                        *count += u16::from(found);
                    }
                }
                for (phi, &count) in phi.iter_mut().zip(&similar) {
                    *phi += terms[usize::from(count)];
                }
            }
            for phi in &mut phi {
                *phi /= n as f64;
            }
            phi
        });
    for ((sum, short), long) in sums.iter_mut().zip(short).zip(long) {
        *sum += (short - long).abs();
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::params::RawParams;
    use super::super::entropy;
    use super::*;

    #[test]
    fn every_way_equals_the_definition() {
        for measure in [Measure::Approximate, Measure::Sample] {
            for (order, window) in [(3, 5), (2, 5), (1, 3), (2, 8), (1, 20), (2, 40)] {
                for tolerance in [None, Some(0.0), Some(0.1), Some(2.0)] {
                    let params = ExtractionParams::new(RawParams {
                        measure,
                        order: Some(order),
                        window,
                        tolerance,
                        ..RawParams::default()
                    })
                    .unwrap();
                    let n = if window == 40 { CHUNK + 150 } else { 150 };
                    let bins: Vec<u16> = (0..n)
                        .map(|i| i * i % 13 % 5 + i / 8 % 2)
                        .map(|bin| u16::try_from(bin).unwrap())
                        .collect();
                    let frequencies = Frequencies::of([&bins[..]], 8);
                    let windows = Windows::new(bins.len(), &params);
                    let regularity = Regularity::new(&frequencies, &windows, &params);
                    let mut sums = vec![0.0; bins.len()];
                    regularity.add(&bins, &mut Scratch::default(), &mut sums);
                    let counts = Frequencies::look_up(&regularity.counts, &bins);
                    let limit = regularity.largest_match(&bins);
                    let matches = |a: f64, b: f64| (a - b).abs() <= limit;
                    for (s, found) in sums[..windows.n_starts()].iter().enumerate() {
                        let x = &counts[s..s + window];
                        let expected = match measure {
                            Measure::Approximate => entropy::approximate(x, order, matches),
                            _ => entropy::sample(x, order, window - order, matches),
                        };
                        assert!(
                            (found - expected).abs() < 1e-14,
                            "{measure} {order} {window} {tolerance:?} {s}: {found} {expected}"
                        );
                    }
                }
            }
        }
    }
}
