//! Permutation entropy of all windows of a column (profile `paper`).
//!
//! The entropy of a window depends only on how often each of its ordinal patterns occurs. With five patterns or fewer
//! the number of equal pairs among them says all of it, and is counted for many windows side by side; with more, counts
//! slide along. `entropy.rs` has the plain definition, which orders above 8 use and the tests hold these against.

use super::super::probability::Frequencies;
use super::super::window::Windows;
use super::entropy;

/// Highest order whose patterns have a code of 16 bits: 8! = 40320.
const MAX_NARROW_ORDER: usize = 8;

/// Most patterns in a window of which the number of equal pairs says how often each occurs: of six, three twice each
/// have as many equal pairs as one three times.
const MAX_PAIRED: usize = 5;

/// Permutation entropy with its tables.
#[derive(Debug)]
pub(super) struct Ordinal {
    order: usize,
    /// By bin: the rank of its count among all counts. Patterns depend on nothing else.
    ranks: Vec<u16>,
    n_starts: usize,
    n_patterns: usize,
    entropies: Entropies,
}

#[derive(Debug)]
enum Entropies {
    /// By the number of equal pairs.
    ByPairs(Vec<f64>),
    /// By sums of integers.
    Sliding(Sliding),
    /// Each window by definition.
    Plain,
}

impl Ordinal {
    pub(super) fn new(frequencies: &Frequencies, windows: &Windows, order: usize) -> Self {
        let n_patterns = windows.width + 1 - order;
        Self {
            order,
            ranks: ranks(&frequencies.counts),
            n_starts: windows.n_starts(),
            n_patterns,
            entropies: if order > MAX_NARROW_ORDER {
                Entropies::Plain
            } else if n_patterns <= MAX_PAIRED {
                let mut table = vec![0.0; n_patterns * (n_patterns - 1) / 2 + 1];
                by_pairs(n_patterns, &mut Vec::new(), &mut table);
                Entropies::ByPairs(table)
            } else {
                Entropies::Sliding(Sliding::new(n_patterns))
            },
        }
    }

    /// Adds to `sums[s]` the entropy of the window that starts at s.
    pub(super) fn add(&self, bins: &[u16], scratch: &mut Scratch, sums: &mut [f64]) {
        let Scratch {
            ranks,
            codes,
            pairs,
            seen,
        } = scratch;
        ranks.resize(bins.len(), 0);
        Frequencies::look_up_into(&self.ranks, bins, ranks);
        let sums = &mut sums[..self.n_starts];
        if matches!(self.entropies, Entropies::Plain) {
            let codes = entropy::ordinal_patterns(ranks, self.order);
            let mut counter = entropy::Permutation::default();
            for (sum, window) in sums.iter_mut().zip(codes.windows(self.n_patterns)) {
                *sum += counter.entropy(window);
            }
            return;
        }
        codes.clear();
        codes.resize(bins.len() + 1 - self.order, 0);
        narrow_codes(ranks, self.order, codes);
        match &self.entropies {
            Entropies::ByPairs(table) => {
                pairs.clear();
                pairs.resize(self.n_starts, 0);
                equal_pairs(codes, self.n_patterns, pairs);
                for (sum, &pairs) in sums.iter_mut().zip(pairs.iter()) {
                    *sum += table[usize::from(pairs)];
                }
            }
            Entropies::Sliding(sliding) => sliding.add(codes, seen, sums),
            Entropies::Plain => {}
        }
    }
}

/// Buffers that are used for each column again.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    ranks: Vec<u16>,
    codes: Vec<u16>,
    pairs: Vec<u16>,
    seen: Vec<u16>,
}

/// The rank of each count among the different counts.
#[expect(clippy::cast_possible_truncation, reason = "at most 65536 bins")]
fn ranks(counts: &[u64]) -> Vec<u16> {
    let mut sorted = counts.to_vec();
    sorted.sort_unstable();
    sorted.dedup();
    counts
        .iter()
        .map(|count| sorted.partition_point(|other| other < count) as u16)
        .collect()
}

/// The entropy of each way to part `n_left` patterns into runs of equal ones, each no longer than the one before.
fn by_pairs(n_left: usize, runs: &mut Vec<usize>, table: &mut [f64]) {
    if n_left == 0 {
        let n = runs.iter().sum::<usize>() as f64;
        let pairs: usize = runs.iter().map(|r| r * (r - 1) / 2).sum();
        let sum = runs.iter().fold(0.0, |sum, &r| {
            let p = r as f64 / n;
            sum + p * p.log2()
        });
        table[pairs] = 0.0 - sum + 0.0;
        return;
    }
    let longest = runs.last().copied().unwrap_or(n_left).min(n_left);
    for run in 1..=longest {
        runs.push(run);
        by_pairs(n_left - run, runs, table);
        runs.pop();
    }
}

/// The ordinal pattern of each run of `order` values, as its Lehmer code.
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
    "x86_64+avx2",
    "aarch64+neon"
))]
#[expect(clippy::cast_possible_truncation, reason = "at most 8")]
fn narrow_codes(x: &[u16], order: usize, codes: &mut [u16]) {
    let n = codes.len();
    for i in 0..order {
        let base = (order - i) as u16;
        for code in codes.iter_mut() {
            *code *= base;
        }
        for k in i + 1..order {
            for ((code, a), b) in codes.iter_mut().zip(&x[i..i + n]).zip(&x[k..k + n]) {
                *code += u16::from(b < a);
            }
        }
    }
}

/// `pairs[s]`: how many pairs of equal codes there are among the `n_patterns` from s on.
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
    "x86_64+avx2",
    "aarch64+neon"
))]
fn equal_pairs(codes: &[u16], n_patterns: usize, pairs: &mut [u16]) {
    let n = pairs.len();
    for i in 0..n_patterns {
        for k in i + 1..n_patterns {
            for ((pairs, a), b) in pairs.iter_mut().zip(&codes[i..i + n]).zip(&codes[k..k + n]) {
                *pairs += u16::from(a == b);
            }
        }
    }
}

/// `(n log2 n − Σ c log2 c) / n` over counts c that slide along.
///
/// The terms are integers (`c log2 c · 2^47`, rounded): what is added and taken away again leaves nothing behind, however
/// long the episode.
#[derive(Debug)]
struct Sliding {
    n_patterns: usize,
    /// By count.
    terms: Vec<i64>,
    /// 1 / (n·2^47)
    scale: f64,
}

impl Sliding {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "no sum exceeds 1024·10·2^47"
    )]
    fn new(n_patterns: usize) -> Self {
        const UNIT: f64 = (1u64 << 47) as f64;
        let terms = (0..=n_patterns)
            .map(|c| match c as f64 {
                0.0 => 0,
                c => (c * c.log2() * UNIT).round() as i64,
            })
            .collect();
        let n = n_patterns as f64;
        Self {
            n_patterns,
            terms,
            scale: 1.0 / (n * UNIT),
        }
    }

    fn add(&self, codes: &[u16], seen: &mut Vec<u16>, sums: &mut [f64]) {
        seen.clear();
        seen.resize(usize::from(codes.iter().copied().max().unwrap_or(0)) + 1, 0);
        let mut sum = 0;
        let mut change = |code: u16, enters: bool, sum: &mut i64| {
            let count = &mut seen[usize::from(code)];
            *sum -= self.terms[usize::from(*count)];
            *count = if enters { *count + 1 } else { *count - 1 };
            *sum += self.terms[usize::from(*count)];
        };
        for &code in &codes[..self.n_patterns - 1] {
            change(code, true, &mut sum);
        }
        let entering = &codes[self.n_patterns - 1..];
        for ((out, &enters), &leaves) in sums.iter_mut().zip(entering).zip(codes) {
            change(enters, true, &mut sum);
            *out += (self.terms[self.n_patterns] - sum) as f64 * self.scale;
            change(leaves, false, &mut sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::params::{ExtractionParams, Measure, RawParams};
    use super::*;

    #[test]
    fn every_way_equals_the_definition() {
        for (order, window) in [(3, 5), (2, 6), (1, 5), (3, 8), (4, 33), (8, 9), (9, 12)] {
            let params = ExtractionParams::new(RawParams {
                measure: Measure::Permutation,
                order: Some(order),
                window,
                ..RawParams::default()
            })
            .unwrap();
            let bins: Vec<u16> = (0..200u32).map(|i| (i * i * 7 % 11 % 5) as u16).collect();
            let frequencies = Frequencies::of([&bins[..]], 5);
            let windows = Windows::new(bins.len(), &params);
            let ordinal = Ordinal::new(&frequencies, &windows, order);
            let mut sums = vec![0.0; bins.len()];
            ordinal.add(&bins, &mut Scratch::default(), &mut sums);
            let counts = Frequencies::look_up(&frequencies.counts, &bins);
            for (s, found) in sums[..windows.n_starts()].iter().enumerate() {
                let codes = entropy::ordinal_patterns(&counts[s..s + window], order);
                let expected = entropy::Permutation::default().entropy(&codes);
                assert!(
                    (found - expected).abs() < 1e-14,
                    "order {order}, window {window}, start {s}: {found} {expected}"
                );
            }
        }
    }
}
