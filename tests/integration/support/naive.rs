//! The method, slow and obvious: every formula as the paper has it, on windows of f64, nothing shared with the crate.

use coact::extraction::{Measure, Profile, RawParams};

/// Eq. 1, by counting inner edges. `None` for a constant column.
pub(crate) fn bins(column: &[f64], b: usize) -> Option<Vec<usize>> {
    let min = column.iter().copied().fold(f64::INFINITY, f64::min);
    let max = column.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if min == max {
        return None;
    }
    let edge = |k: usize| {
        let (k, b) = (k as f64, b as f64);
        if (max - min).is_infinite() {
            min * (1.0 - k / b) + max * (k / b)
        } else if (max - min) / b == 0.0 {
            min + (k / b) * (max - min)
        } else {
            min + k * ((max - min) / b)
        }
    };
    Some(
        column
            .iter()
            .map(|&x| (1..b).filter(|&k| edge(k) <= x).count())
            .collect(),
    )
}

/// Eq. 3 over all `columns` together.
pub(crate) fn probabilities(columns: &[Vec<usize>]) -> Vec<Vec<f64>> {
    let total: usize = columns.iter().map(Vec::len).sum();
    let mut counts = std::collections::HashMap::new();
    for bin in columns.iter().flatten() {
        *counts.entry(*bin).or_insert(0usize) += 1;
    }
    columns
        .iter()
        .map(|column| {
            column
                .iter()
                .map(|bin| counts[bin] as f64 / total as f64)
                .collect()
        })
        .collect()
}

/// Eq. 4: the window of every step, borders repeated.
pub(crate) fn windows(p: &[f64], raw: &RawParams) -> Vec<Vec<f64>> {
    let t_max = p.len();
    let left = raw.window / 2 + 1;
    let right = match raw.profile {
        Profile::Paper => raw.window - left,
        Profile::Authors => raw.window / 2,
    };
    let at = |t: usize| p[t - left..t + right].to_vec();
    (0..t_max)
        .map(|t| {
            if t < left {
                at(t + left)
            } else if t >= t_max - right {
                at(t - right)
            } else {
                at(t)
            }
        })
        .collect()
}

fn scaled(p: &[f64]) -> Vec<f64> {
    let sum: f64 = p.iter().sum();
    p.iter().map(|x| x / sum).collect()
}

fn kl(p: &[f64], q: &[f64]) -> f64 {
    scaled(p)
        .iter()
        .zip(scaled(q))
        .map(|(p, q)| p * (p / q).ln())
        .sum()
}

fn jensen_shannon(p: &[f64], q: &[f64], profile: Profile) -> f64 {
    let (p, q) = if profile == Profile::Paper {
        (scaled(p), scaled(q))
    } else {
        (p.to_vec(), q.to_vec())
    };
    let m: Vec<f64> = p.iter().zip(&q).map(|(p, q)| (p + q) / 2.0).collect();
    kl(&p, &m) / 2.0 + kl(&q, &m) / 2.0
}

fn total_variation(p: &[f64], q: &[f64], profile: Profile) -> f64 {
    let (p, q) = if profile == Profile::Paper {
        (scaled(p), scaled(q))
    } else {
        (p.to_vec(), q.to_vec())
    };
    p.iter().zip(&q).map(|(p, q)| (p - q).abs()).sum::<f64>() / 2.0
}

fn earth_mover(p: &[f64], q: &[f64]) -> f64 {
    let sorted = |x: &[f64]| {
        let mut x = x.to_vec();
        x.sort_by(f64::total_cmp);
        x
    };
    sorted(p)
        .iter()
        .zip(sorted(q))
        .map(|(p, q)| (p - q).abs())
        .sum::<f64>()
        / p.len() as f64
}

fn chebyshev_match(a: &[f64], b: &[f64], bound: f64) -> bool {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
        <= bound
}

fn approximate(x: &[f64], m: usize, bound: f64) -> f64 {
    let phi = |m: usize| {
        let templates: Vec<&[f64]> = x.windows(m).collect();
        let n = templates.len() as f64;
        templates
            .iter()
            .map(|a| {
                (templates
                    .iter()
                    .filter(|b| chebyshev_match(a, b, bound))
                    .count() as f64
                    / n)
                    .ln()
            })
            .sum::<f64>()
            / n
    };
    (phi(m) - phi(m + 1)).abs()
}

fn sample(x: &[f64], m: usize, bound: f64, profile: Profile) -> f64 {
    let n = x.len();
    let pairs = |length: usize, n_templates: usize| {
        let mut count = 0usize;
        for i in 0..n_templates {
            for j in 0..n_templates {
                if i != j && chebyshev_match(&x[i..i + length], &x[j..j + length], bound) {
                    count += 1;
                }
            }
        }
        count as f64
    };
    let (a, b) = (
        pairs(m + 1, n - m),
        pairs(
            m,
            if profile == Profile::Paper {
                n - m
            } else {
                n - m + 1
            },
        ),
    );
    if a == 0.0 || b == 0.0 {
        ((n - m) as f64 * (n - m - 1) as f64 / 2.0).ln()
    } else {
        -(a / b).ln()
    }
}

fn permutation(x: &[f64], order: usize) -> f64 {
    let mut patterns: Vec<Vec<usize>> = x
        .windows(order)
        .map(|w| {
            let mut places: Vec<usize> = (0..order).collect();
            places.sort_by(|&a, &b| w[a].total_cmp(&w[b]).then(a.cmp(&b)));
            places
        })
        .collect();
    patterns.sort();
    let n = patterns.len() as f64;
    -patterns
        .chunk_by(|a, b| a == b)
        .map(|run| (run.len() as f64 / n) * (run.len() as f64 / n).log2())
        .sum::<f64>()
}

/// Eq. 5–7 for one column of probabilities.
fn column_measure(p: &[f64], raw: &RawParams) -> Vec<f64> {
    let t_max = p.len();
    let windows = windows(p, raw);
    let width = windows[0].len();
    let order = raw.order.or(raw.measure.default_order()).unwrap_or(0);
    let deviation = {
        let mean = p.iter().sum::<f64>() / t_max as f64;
        (p.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / t_max as f64).sqrt()
    };
    let bound = match (raw.profile, raw.tolerance, raw.measure) {
        (Profile::Paper, r, _) => r.unwrap_or(0.2 * deviation) + 1e-12,
        (Profile::Authors, Some(r), _) => r,
        (Profile::Authors, None, Measure::Approximate) => 0.0,
        (Profile::Authors, None, _) => 1.0,
    };
    let pair: Box<dyn Fn(&[f64], &[f64]) -> f64> = match raw.measure {
        Measure::Shannon => {
            return windows
                .iter()
                .map(|w| -w.iter().map(|p| p * p.ln()).sum::<f64>())
                .collect();
        }
        Measure::Approximate => {
            return windows
                .iter()
                .map(|w| approximate(w, order, bound))
                .collect();
        }
        Measure::Sample => {
            return windows
                .iter()
                .map(|w| sample(w, order, bound, raw.profile))
                .collect();
        }
        Measure::Permutation => return windows.iter().map(|w| permutation(w, order)).collect(),
        Measure::Kl => Box::new(kl),
        Measure::JensenShannon => Box::new(|p, q| jensen_shannon(p, q, raw.profile)),
        Measure::TotalVariation => Box::new(|p, q| total_variation(p, q, raw.profile)),
        Measure::EarthMover => Box::new(earth_mover),
    };
    (0..t_max)
        .map(|t| {
            let (forward, last) = match raw.profile {
                Profile::Paper => (t + raw.window < t_max, raw.window),
                Profile::Authors => (t + 1 + width < t_max, width - 1),
            };
            let least = (1..=last)
                .map(|j| if forward { t + j } else { t - j })
                .map(|other| pair(&windows[t], &windows[other]))
                .fold(f64::INFINITY, f64::min);
            if least <= 1e-14 { 0.0 } else { least }
        })
        .collect()
}

/// `E_w` of several columns as one.
pub(crate) fn pooled_measure(columns: &[Vec<f64>], raw: &RawParams) -> Vec<f64> {
    let t_max = columns[0].len();
    let binned: Vec<Vec<usize>> = columns
        .iter()
        .filter_map(|c| {
            bins(c, raw.bins)
                .or_else(|| (raw.profile == Profile::Authors).then(|| vec![raw.bins / 2; t_max]))
        })
        .collect();
    if binned.is_empty() {
        return vec![0.0; t_max];
    }
    let measures: Vec<Vec<f64>> = probabilities(&binned)
        .iter()
        .map(|p| column_measure(p, raw))
        .collect();
    (0..t_max)
        .map(|t| measures.iter().map(|m| m[t]).sum::<f64>() / measures.len() as f64)
        .collect()
}

/// `E_w` of one joint.
pub(crate) fn joint_measure(column: &[f64], raw: &RawParams) -> Vec<f64> {
    let binned = bins(column, raw.bins).unwrap_or_else(|| vec![0; column.len()]);
    column_measure(&probabilities(&[binned])[0], raw)
}

/// Eq. 10 and 11.
pub(crate) fn correlated(action: &[bool], state: &[bool], raw: &RawParams) -> Vec<bool> {
    let t_max = action.len();
    let (left, right) = (raw.window / 2 + 1, raw.window / 2);
    (0..t_max)
        .map(|t| {
            let window: Vec<usize> = match raw.profile {
                Profile::Paper if t + raw.window < t_max => (t..t + raw.window).collect(),
                Profile::Paper => ((t + 1).saturating_sub(raw.window)..=t).collect(),
                Profile::Authors if t < left => Vec::new(),
                Profile::Authors => (t - left..(t + right).min(t_max)).collect(),
            };
            window.iter().any(|&i| action[i]) && window.iter().any(|&i| state[i])
        })
        .collect()
}

/// Boundaries and the segments between them.
pub(crate) fn partition(
    correlated: &[bool],
    profile: Profile,
) -> (Vec<usize>, Vec<(usize, usize)>) {
    let mut boundaries = Vec::new();
    for t in 0..correlated.len() {
        let ends = match correlated.get(t + 1) {
            Some(next) => !next,
            None => profile == Profile::Paper,
        };
        if correlated[t] && ends {
            boundaries.push(t);
        }
    }
    let segments = match boundaries.len() {
        1 => vec![(0, boundaries[0] + 1)],
        _ => boundaries.windows(2).map(|b| (b[0], b[1])).collect(),
    };
    (boundaries, segments)
}
