//! Total variation, Kullback-Leibler and Jensen-Shannon of neighbouring windows (profile `paper`), many side by side.
//!
//! Windows are made of counts: as each is scaled to sum 1, the total of all counts does not matter. With
//! `P_i = p_i/Σp` and `Q_i = q_i/Σq`:
//!
//! - total variation: `½ Σ |P_i − Q_i| = Σ |p_i − (Σp/Σq)·q_i| / (2 Σp)`
//! - Kullback-Leibler: `Σ P_i ln(P_i/Q_i) = (Σ p_i ln p_i − Σ p_i ln q_i)/Σp + ln Σq − ln Σp`: the only logarithms are those
//!   of counts, from a table, and one for each window
//! - Jensen-Shannon: `½ (Σ P_i ln P_i + Σ Q_i ln Q_i − Σ M_i ln M_i) + ln 2` with `M_i = P_i + Q_i`
//!
//! `distance.rs` and `divergence.rs` have the plain definitions, which the tests hold these against.

use std::f64::consts::LN_2;

use super::super::params::{DEFAULT_WINDOW, Measure};
use super::super::probability::Frequencies;
use super::super::window::Windows;
use super::divergence;
use super::logarithm::ln;
use super::tail::Tail;

/// Windows side by side in one pass of the kernel; columns are padded for the last pass.
const LANES: usize = 32;

/// Kullback-Leibler divergences in this range are computed again by definition: logarithms of equal ratios cancel only
/// after rounding, and what is left must not be taken for a difference. Below it lies what counts as 0 either way.
const CANCELLED: std::ops::Range<f64> = 4e-15..1e-12;

/// Which measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    TotalVariation,
    KullbackLeibler,
    JensenShannon,
}

/// One of the three measures with its tables.
#[derive(Debug)]
pub(super) struct Pairs<'a> {
    kind: Kind,
    windows: &'a Windows,
    tail: Tail,
    /// By bin.
    counts: Vec<f64>,
    /// By bin: ln(count / typical count).
    logs: Vec<f64>,
    /// About what a count is: logarithms relative to it are small, and so is their rounding.
    typical: f64,
}

impl<'a> Pairs<'a> {
    /// `None` if `measure` is none of the three.
    pub(super) fn new(
        measure: Measure,
        frequencies: &Frequencies,
        windows: &'a Windows,
    ) -> Option<Self> {
        let kind = match measure {
            Measure::TotalVariation => Kind::TotalVariation,
            Measure::Kl => Kind::KullbackLeibler,
            Measure::JensenShannon => Kind::JensenShannon,
            _ => return None,
        };
        let counts: Vec<f64> = frequencies.counts.iter().map(|&c| c as f64).collect();
        let typical = counts.iter().fold(0.0, |sum, c| sum + c * c) / frequencies.total as f64;
        let logs = if kind == Kind::KullbackLeibler {
            // A bin that no value fell into is never looked up.
            counts.iter().map(|c| (c.max(1.0) / typical).ln()).collect()
        } else {
            Vec::new()
        };
        Some(Self {
            kind,
            windows,
            tail: Tail::new(windows),
            counts,
            logs,
            typical,
        })
    }

    /// Buffers for [`Self::add`].
    pub(super) fn scratch(&self) -> Scratch {
        let width = self.windows.width;
        let n_tail = self.tail.limits.len();
        let mut limits = self.tail.limits.clone();
        limits.resize(n_tail.next_multiple_of(LANES), 0);
        Scratch {
            regular: Series::new(
                self.windows.regular().len(),
                self.windows.n_steps,
                width,
                None,
            ),
            tail: Series::new(n_tail, n_tail, width, Some(limits)),
        }
    }

    /// Adds to `sums[t]` the least value of the window of step t against those it is compared with.
    pub(super) fn add(&self, bins: &[u16], scratch: &mut Scratch, sums: &mut [f64]) {
        let Scratch { regular, tail } = scratch;
        Frequencies::look_up_into(&self.counts, bins, &mut regular.x);
        self.tail.column(&regular.x[..bins.len()], &mut tail.x);
        if self.kind == Kind::KullbackLeibler {
            Frequencies::look_up_into(&self.logs, bins, &mut regular.logs);
            self.tail
                .column(&regular.logs[..bins.len()], &mut tail.logs);
        }
        let width = self.windows.width;
        for series in [&mut *regular, &mut *tail] {
            find_least(
                series,
                self.kind,
                width,
                1.0 / (self.typical * width as f64),
            );
            if self.kind == Kind::KullbackLeibler {
                series.settle_small(width);
            }
        }
        for (sum, &least) in sums[self.windows.regular()].iter_mut().zip(&regular.least) {
            *sum += rounded(least);
        }
        for &(at, t) in &self.tail.steps {
            sums[t] += rounded(tail.least[at]);
        }
    }
}

fn rounded(least: f64) -> f64 {
    if least <= super::ROUNDING { 0.0 } else { least }
}

/// Buffers that are used for each column again.
#[derive(Debug)]
pub(super) struct Scratch {
    regular: Series,
    tail: Series,
}

/// A column and what its windows need, each window looking ahead; all padded to whole passes.
#[derive(Debug)]
struct Series {
    /// Counts by step.
    x: Vec<f64>,
    /// Logarithms of the counts by step.
    logs: Vec<f64>,
    /// Σp of each window.
    totals: Vec<f64>,
    /// 1/Σp of each window.
    inverse: Vec<f64>,
    /// ln Σp of each window, relative to a window of typical counts.
    log_totals: Vec<f64>,
    /// Of each window, Kullback-Leibler: Σ p ln p; Jensen-Shannon: Σ P ln P.
    own: Vec<f64>,
    /// How many windows ahead each window is compared with, if not with W.
    limits: Option<Vec<u32>>,
    /// The result.
    least: Vec<f64>,
}

impl Series {
    fn new(n_windows: usize, n_values: usize, width: usize, limits: Option<Vec<u32>>) -> Self {
        let n_windows = n_windows.next_multiple_of(LANES);
        // Made-up values: any will do that have a logarithm.
        let values = vec![
            1.0;
            (n_windows + LANES + 2 * width)
                .next_multiple_of(LANES)
                .max(n_values)
        ];
        let per_window = vec![1.0; n_windows + width.next_multiple_of(LANES)];
        Self {
            logs: values.clone(),
            x: values,
            totals: per_window.clone(),
            inverse: per_window.clone(),
            log_totals: per_window.clone(),
            own: per_window,
            limits,
            least: vec![0.0; n_windows],
        }
    }

    /// Computes small Kullback-Leibler divergences again, by definition.
    fn settle_small(&mut self, width: usize) {
        let is_in_doubt = |least: &f64| CANCELLED.contains(&least.abs());
        for (pass, least) in self.least.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            // Rare, so a whole pass is looked over at once.
            if least.iter().filter(|least| is_in_doubt(least)).count() == 0 {
                continue;
            }
            for (lane, least) in least.iter_mut().enumerate() {
                if is_in_doubt(least) {
                    let s = pass * LANES + lane;
                    let limit = match &self.limits {
                        Some(limits) => limits[s] as usize,
                        None => width,
                    };
                    let window = |s: usize| &self.x[s..s + width];
                    *least = (1..=limit)
                        .map(|j| divergence::kullback_leibler(window(s), window(s + j)))
                        .fold(f64::INFINITY, f64::min);
                }
            }
        }
    }
}

/// Fills `least`; `unit` is 1 / (what the counts of a window typically add up to).
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
    "x86_64+avx2",
    "aarch64+neon"
))]
fn find_least(series: &mut Series, kind: Kind, width: usize, unit: f64) {
    // A constant of its own lets the compiler unroll the loops over the default window.
    if width == DEFAULT_WINDOW {
        find_least_of(series, kind, DEFAULT_WINDOW, unit);
    } else {
        find_least_of(series, kind, width, unit);
    }
}

#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn find_least_of(series: &mut Series, kind: Kind, width: usize, unit: f64) {
    for start in (0..series.totals.len()).step_by(LANES) {
        prepare(series, kind, width, unit, start);
    }
    for start in (0..series.least.len()).step_by(LANES) {
        let least = least_of_lanes(series, kind, width, start);
        series.least[start..start + LANES].copy_from_slice(&least);
    }
}

/// `values[start..start + LANES]`, as an array.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn lanes<T>(values: &[T], start: usize) -> &[T; LANES] {
    values[start..]
        .first_chunk()
        .expect("columns are padded to whole passes")
}

/// What each window needs by itself.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn prepare(series: &mut Series, kind: Kind, width: usize, unit: f64, start: usize) {
    let mut totals = [0.0; LANES];
    let mut own = [0.0; LANES];
    for i in 0..width {
        let x = lanes(&series.x, start + i);
        for l in 0..LANES {
            totals[l] += x[l];
        }
    }
    let mut inverse = [0.0; LANES];
    for l in 0..LANES {
        inverse[l] = 1.0 / totals[l];
    }
    match kind {
        Kind::TotalVariation => {}
        Kind::KullbackLeibler => {
            let log_totals = &mut series.log_totals[start..start + LANES];
            for (log, total) in log_totals.iter_mut().zip(totals) {
                *log = ln(total * unit);
            }
            for i in 0..width {
                add_products(
                    &mut own,
                    lanes(&series.x, start + i),
                    lanes(&series.logs, start + i),
                );
            }
        }
        Kind::JensenShannon => {
            for i in 0..width {
                let x = lanes(&series.x, start + i);
                for l in 0..LANES {
                    let p = x[l] * inverse[l];
                    own[l] += p * ln(p);
                }
            }
        }
    }
    series.totals[start..start + LANES].copy_from_slice(&totals);
    series.inverse[start..start + LANES].copy_from_slice(&inverse);
    series.own[start..start + LANES].copy_from_slice(&own);
}

/// The least of each window from `start` on.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn least_of_lanes(series: &Series, kind: Kind, width: usize, start: usize) -> [f64; LANES] {
    let all = &series.x[start..start + LANES + 2 * width - 1];
    if all.iter().filter(|&&x| x != all[0]).count() == 0 {
        return [0.0; LANES];
    }
    let limits = series.limits.as_ref().map(|limits| lanes(limits, start));
    let mut least = [f64::INFINITY; LANES];
    for j in 1..=width {
        let found = match kind {
            Kind::TotalVariation => total_variation(series, width, start, start + j),
            Kind::KullbackLeibler => kullback_leibler(series, width, start, start + j),
            Kind::JensenShannon => jensen_shannon(series, width, start, start + j),
        };
        match limits {
            None => {
                for l in 0..LANES {
                    least[l] = if found[l] < least[l] {
                        found[l]
                    } else {
                        least[l]
                    };
                }
            }
            Some(limits) => {
                for l in 0..LANES {
                    let nearer = found[l] < least[l] && j <= limits[l] as usize;
                    least[l] = if nearer { found[l] } else { least[l] };
                }
            }
        }
    }
    least
}

/// Total variation distance of the windows from `p` on to those from `q` on.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn total_variation(series: &Series, width: usize, p: usize, q: usize) -> [f64; LANES] {
    let (totals, inverse) = (lanes(&series.totals, p), lanes(&series.inverse, q));
    let mut ratio = [0.0; LANES];
    for l in 0..LANES {
        ratio[l] = totals[l] * inverse[l];
    }
    let mut sum = [0.0; LANES];
    for i in 0..width {
        let (x, y) = (lanes(&series.x, p + i), lanes(&series.x, q + i));
        for l in 0..LANES {
            sum[l] += (x[l] - ratio[l] * y[l]).abs();
        }
    }
    let inverse = lanes(&series.inverse, p);
    for l in 0..LANES {
        sum[l] *= 0.5 * inverse[l];
    }
    sum
}

/// Kullback-Leibler divergence of the windows from `p` on from those from `q` on; exactly 0 where they are equal.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn kullback_leibler(series: &Series, width: usize, p: usize, q: usize) -> [f64; LANES] {
    let mut sum = [0.0; LANES];
    for i in 0..width {
        add_products(
            &mut sum,
            lanes(&series.x, p + i),
            lanes(&series.logs, q + i),
        );
    }
    let (own, inverse) = (lanes(&series.own, p), lanes(&series.inverse, p));
    let (log_p, log_q) = (lanes(&series.log_totals, p), lanes(&series.log_totals, q));
    for l in 0..LANES {
        sum[l] = (own[l] - sum[l]) * inverse[l] + (log_q[l] - log_p[l]);
    }
    sum
}

#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn add_products(sum: &mut [f64; LANES], x: &[f64; LANES], y: &[f64; LANES]) {
    for l in 0..LANES {
        sum[l] += x[l] * y[l];
    }
}

/// Jensen-Shannon divergence of the windows from `p` on and those from `q` on.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn jensen_shannon(series: &Series, width: usize, p: usize, q: usize) -> [f64; LANES] {
    let (inverse_p, inverse_q) = (lanes(&series.inverse, p), lanes(&series.inverse, q));
    let mut sum = [0.0; LANES];
    for i in 0..width {
        let (x, y) = (lanes(&series.x, p + i), lanes(&series.x, q + i));
        for l in 0..LANES {
            let mixed = x[l] * inverse_p[l] + y[l] * inverse_q[l];
            sum[l] += mixed * ln(mixed);
        }
    }
    let (own_p, own_q) = (lanes(&series.own, p), lanes(&series.own, q));
    for l in 0..LANES {
        sum[l] = 0.5 * (own_p[l] + own_q[l] - sum[l]) + LN_2;
    }
    sum
}
