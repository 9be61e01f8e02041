//! Cuts a list into runs of about the same weight: neighbours stay together, so that rows stay in the order of names.

/// Where each of `n_runs` runs over `weights` ends. No cut makes the heaviest run lighter; beyond that, runs are as
/// even as they come, and none is empty as long as there are enough weights.
pub(super) fn ends(weights: &[u64], n_runs: usize) -> Vec<usize> {
    let total: u128 = weights.iter().map(|&w| u128::from(w)).sum();
    let limit = lightest_limit(weights, n_runs, total);
    let needed = runs_needed(weights, limit);
    let mut ends = Vec::with_capacity(n_runs);
    let (mut start, mut left) = (0, total);
    for n_after in (0..n_runs).rev() {
        // From an even share of what is left, times the number of runs.
        let n_left = n_after as u128 + 1;
        let distance = |weight: u128| (weight * n_left).abs_diff(left);
        let (mut end, mut weight) = (start, 0);
        while end < weights.len() {
            let next = weight + u128::from(weights[end]);
            let is_enough = end > start
                && needed[end] <= n_after
                && (weights.len() - end <= n_after
                    || next > limit
                    || distance(next) > distance(weight));
            if is_enough {
                break;
            }
            (end, weight) = (end + 1, next);
        }
        ends.push(end);
        (start, left) = (end, left - weight);
    }
    ends
}

/// The least weight that no run need exceed.
fn lightest_limit(weights: &[u64], n_runs: usize, total: u128) -> u128 {
    let heaviest = weights.iter().copied().max().map_or(0, u128::from);
    let (mut low, mut high) = (heaviest, total);
    while low < high {
        let limit = low + (high - low) / 2;
        if runs_needed(weights, limit)[0] <= n_runs {
            high = limit;
        } else {
            low = limit + 1;
        }
    }
    low
}

/// For each place in the list, how many runs of at most `limit` what follows needs.
fn runs_needed(weights: &[u64], limit: u128) -> Vec<usize> {
    let mut needed = vec![0; weights.len() + 1];
    let (mut end, mut weight) = (weights.len(), 0);
    for start in (0..weights.len()).rev() {
        weight += u128::from(weights[start]);
        while weight > limit && end > start + 1 {
            end -= 1;
            weight -= u128::from(weights[end]);
        }
        needed[start] = needed[end] + 1;
    }
    needed
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn runs(weights: &[u64], n_runs: usize) -> Vec<u64> {
        let ends = ends(weights, n_runs);
        assert_eq!((ends.len(), *ends.last().unwrap()), (n_runs, weights.len()));
        let starts = std::iter::once(&0).chain(&ends);
        starts
            .zip(&ends)
            .map(|(&start, &end)| weights[start..end].iter().sum())
            .collect()
    }

    /// The heaviest run of the best cut, by trying all.
    fn best(weights: &[u64], n_runs: usize) -> u64 {
        if n_runs == 1 {
            return weights.iter().sum();
        }
        let cuts = 0..=weights.len();
        cuts.map(|at| {
            weights[..at]
                .iter()
                .sum::<u64>()
                .max(best(&weights[at..], n_runs - 1))
        })
        .min()
        .unwrap()
    }

    #[test]
    fn runs_are_even_and_none_is_empty_without_need() {
        assert_eq!(runs(&[1; 12], 6), [2; 6]);
        assert_eq!(runs(&[1; 10], 4), [3, 2, 3, 2]);
        assert_eq!(runs(&[1, 1, 100], 3), [1, 1, 100]);
        assert_eq!(runs(&[100, 1, 1], 3), [100, 1, 1]);
        assert_eq!(runs(&[5, 3], 4), [5, 3, 0, 0]);
        assert_eq!(runs(&[u64::MAX, u64::MAX, 0], 2)[0], u64::MAX);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn no_cut_is_better(weights in prop::collection::vec(0_u64..50, 1..9), n_runs in 1_usize..5) {
            let runs = runs(&weights, n_runs);
            prop_assert_eq!(runs.iter().copied().max().unwrap(), best(&weights, n_runs));
            let ends = ends(&weights, n_runs);
            let n_empty = ends.iter().zip(&ends[1..]).filter(|(a, b)| a == b).count();
            prop_assert_eq!(n_empty, n_runs.saturating_sub(weights.len()));
        }
    }
}
