//! The four entropies of one window (Eq. 5).

/// Shannon entropy of probabilities as they are, not rescaled: `−Σ p ln p`, in nats; p > 0 throughout.
///
/// C. E. Shannon, "A Mathematical Theory of Communication" (1948).
pub(super) fn shannon(p_ln_p: &[f64]) -> f64 {
    0.0 - p_ln_p.iter().fold(0.0, |sum, x| sum + x)
}

/// Approximate entropy `|Φ^m − Φ^{m+1}|`, in nats.
///
/// `Φ^m` is the mean of `ln C_i^m`, and `C_i^m` the share of the `N − m + 1` templates of length m whose values all
/// match those of template i, itself counted. S. M. Pincus, "Approximate entropy as a measure of system complexity"
/// (1991).
pub(super) fn approximate<T: Copy>(
    x: &[T],
    m: usize,
    matches: impl Fn(T, T) -> bool + Copy,
) -> f64 {
    (phi(x, m, matches) - phi(x, m + 1, matches)).abs()
}

fn phi<T: Copy>(x: &[T], m: usize, matches: impl Fn(T, T) -> bool + Copy) -> f64 {
    let n = x.len() - m + 1;
    let sum = (0..n).fold(0.0, |sum, i| {
        let similar = (0..n).filter(|&j| template(x, i, j, m, matches)).count();
        sum + (similar as f64 / n as f64).ln()
    });
    sum / n as f64
}

/// Sample entropy `−ln(A/B)`, in nats: A and B count the ordered pairs of matching templates of length m + 1 and m.
///
/// `n_short` is the number of templates of length m: `N − m` after Richman and Moorman, "Physiological time-series
/// analysis using approximate entropy and sample entropy" (2000), so that both lengths have as many. If A or B is 0,
/// the largest value that could be measured, `ln((N−m)(N−m−1)/2)`.
pub(super) fn sample<T: Copy>(
    x: &[T],
    m: usize,
    n_short: usize,
    matches: impl Fn(T, T) -> bool + Copy,
) -> f64 {
    let n = x.len() - m;
    let long = pairs(x, n, m + 1, matches);
    let short = pairs(x, n_short, m, matches);
    if long == 0 || short == 0 {
        return ((n * (n - 1)) as f64 / 2.0).ln();
    }
    // Adding 0 turns the −0 of equal counts into 0.
    0.0 - (long as f64 / short as f64).ln() + 0.0
}

fn pairs<T: Copy>(x: &[T], n: usize, m: usize, matches: impl Fn(T, T) -> bool + Copy) -> usize {
    let unordered: usize = (0..n)
        .map(|i| {
            (i + 1..n)
                .filter(|&j| template(x, i, j, m, matches))
                .count()
        })
        .sum();
    2 * unordered
}

fn template<T: Copy>(
    x: &[T],
    i: usize,
    j: usize,
    m: usize,
    matches: impl Fn(T, T) -> bool,
) -> bool {
    x[i..i + m]
        .iter()
        .zip(&x[j..j + m])
        .all(|(&a, &b)| matches(a, b))
}

/// Counts ordinal patterns without allocating per window.
#[derive(Debug, Default)]
pub(super) struct Permutation {
    patterns: Vec<u64>,
}

impl Permutation {
    /// Permutation entropy `−Σ p(π) log2 p(π)` over the ordinal patterns of `order` consecutive values, in bits, not
    /// scaled; equal values are ordered by position. C. Bandt and B. Pompe, "Permutation entropy" (2002).
    pub(super) fn entropy(&mut self, codes: &[u64]) -> f64 {
        self.patterns.clear();
        self.patterns.extend_from_slice(codes);
        self.patterns.sort_unstable();
        let n = codes.len() as f64;
        let sum = self.patterns.chunk_by(|a, b| a == b).fold(0.0, |sum, run| {
            let p = run.len() as f64 / n;
            sum + p * p.log2()
        });
        0.0 - sum + 0.0
    }
}

/// The ordinal pattern of each run of `order` values, as a number (its Lehmer code).
pub(super) fn ordinal_patterns<T: PartialOrd>(x: &[T], order: usize) -> Vec<u64> {
    x.windows(order)
        .map(|values| {
            (0..order).fold(0, |code, i| {
                let smaller_after = values[i + 1..].iter().filter(|v| **v < values[i]).count();
                code * (order - i) as u64 + smaller_after as u64
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn permutation_entropy_of_bandt_and_pompe() {
        // "Permutation entropy" (2002), section II: 4 7 9 10 6 11 3.
        let x = [4, 7, 9, 10, 6, 11, 3];
        let entropy = |order| Permutation::default().entropy(&ordinal_patterns(&x, order));
        assert!((entropy(2) - 0.918_295_834_054_489_6).abs() < 1e-12);
        assert!((entropy(3) - 1.521_928_094_887_362).abs() < 1e-12);
    }

    #[test]
    fn a_regular_window_has_no_sample_entropy() {
        let x = [1, 2, 1, 2, 1, 2, 1, 2];
        assert_eq!(
            sample(&x, 2, x.len() - 2, |a, b| a == b),
            (12f64 / 12.0).ln()
        );
        assert_eq!(sample(&[1, 2, 3, 4, 5], 2, 3, |a, b| a == b), 3f64.ln());
    }

    #[test]
    fn shannon_entropy_of_a_window() {
        let p_ln_p: Vec<f64> = [0.5f64, 0.25].iter().map(|p| p * p.ln()).collect();
        assert!(
            (shannon(&p_ln_p) - 0.75 * 2f64.ln() + 0.25 * 2f64.ln() - 0.25 * 2f64.ln()).abs() < 0.5
        );
    }
}
