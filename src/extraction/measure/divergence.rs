//! The two divergences of a pair of windows (Eq. 7). All probabilities are above 0: each bin was seen.

/// Kullback-Leibler divergence `Σ p ln(p/q)` of both windows scaled to sum 1, in nats.
///
/// S. Kullback and R. A. Leibler, "On Information and Sufficiency" (1951); scaled as SciPy's `entropy` does.
pub(super) fn kullback_leibler(p: &[f64], q: &[f64]) -> f64 {
    let (sum_p, sum_q) = (total(p), total(q));
    p.iter().zip(q).fold(0.0, |sum, (p, q)| {
        let (p, q) = (p / sum_p, q / sum_q);
        sum + p * (p / q).ln()
    })
}

/// Jensen-Shannon divergence `½ KL(p‖m) + ½ KL(q‖m)` with `m = ½ (p + q)`, in nats, 0..=ln 2.
///
/// Both windows are scaled to sum 1 first; with `raw_mixture` m is made of the raw windows, as the authors' program
/// does. J. Lin, "Divergence Measures Based on the Shannon Entropy" (1991).
pub(super) fn jensen_shannon(p: &[f64], q: &[f64], raw_mixture: bool) -> f64 {
    let (sum_p, sum_q) = (total(p), total(q));
    let (scale_p, scale_q) = if raw_mixture {
        (1.0, 1.0)
    } else {
        (sum_p, sum_q)
    };
    let mixture = |p: f64, q: f64| 0.5 * (p / scale_p + q / scale_q);
    let sum_m = p
        .iter()
        .zip(q)
        .fold(0.0, |sum, (&p, &q)| sum + mixture(p, q));
    let (mut left, mut right) = (0.0, 0.0);
    for (&p, &q) in p.iter().zip(q) {
        let m = mixture(p, q) / sum_m;
        let (p, q) = (p / sum_p, q / sum_q);
        left += p * (p / m).ln();
        right += q * (q / m).ln();
    }
    0.5 * left + 0.5 * right
}

fn total(window: &[f64]) -> f64 {
    window.iter().fold(0.0, |sum, x| sum + x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worked_example_of_the_paper() {
        let x = [0.1, 0.2, 0.3, 0.1, 0.2, 0.3];
        let js = |j: usize| jensen_shannon(&x[0..3], &x[j..j + 3], false);
        assert!((js(1) - 0.066_152_062_359_449).abs() < 1e-14, "{}", js(1));
        assert!((js(2) - 0.066_152_062_359_449).abs() < 1e-14);
        assert!(js(3).abs() < 1e-15);
    }

    #[test]
    fn divergence_from_itself_is_nothing_and_scale_does_not_count() {
        let (p, q) = ([0.1, 0.2, 0.4], [0.2, 0.4, 0.8]);
        assert!(kullback_leibler(&p, &q).abs() < 1e-15);
        assert!(jensen_shannon(&p, &q, false).abs() < 1e-15);
    }
}
