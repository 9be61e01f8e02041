//! How far two partitions of one episode agree: the boundaries that both have, give or take some steps.

use crate::model::Segment;

/// The boundaries of a joint: steps at which a composite action starts or ends, rising, each once.
pub(super) fn boundaries(segments: &[Segment]) -> Vec<usize> {
    let mut steps: Vec<usize> = segments
        .iter()
        .flat_map(|segment| [segment.start_step, segment.end_step])
        .collect();
    // Segments are disjoint and in time; where one begins where another ends, that is one boundary.
    steps.dedup();
    steps
}

/// Boundaries that find a partner at most `tolerance` steps away, each at most one: the most there can be.
///
/// Both lists rise, so the first of the one and the first of the other are partners if they are near enough; else the
/// earlier of them can have none.
pub(super) fn n_matched(a: &[usize], b: &[usize], tolerance: usize) -> u64 {
    let (mut of_a, mut of_b) = (a.iter().peekable(), b.iter().peekable());
    let mut n_matched = 0;
    while let (Some(&&step_a), Some(&&step_b)) = (of_a.peek(), of_b.peek()) {
        let is_match = step_a.abs_diff(step_b) <= tolerance;
        n_matched += u64::from(is_match);
        if is_match || step_a < step_b {
            of_a.next();
        }
        if is_match || step_a > step_b {
            of_b.next();
        }
    }
    n_matched
}

/// F1 of the one as a prediction of the other: 2 × matched ÷ (boundaries of both). Two that have none agree.
pub(super) fn f1(n_matched: u64, n_boundaries: [u64; 2]) -> f64 {
    match n_boundaries.iter().sum::<u64>() {
        0 => 1.0,
        n => 2.0 * n_matched as f64 / n as f64,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn boundaries_pair_within_the_tolerance_and_only_once() {
        assert_eq!(n_matched(&[10, 20, 30], &[12, 19, 50], 2), 2);
        assert_eq!(n_matched(&[10, 20, 30], &[12, 19, 50], 1), 1);
        assert_eq!(n_matched(&[10], &[9, 10, 11], 5), 1);
        assert_eq!(n_matched(&[], &[1], 5), 0);
        assert!((f1(2, [3, 3]) - 2.0 / 3.0).abs() < 1e-15);
        assert_eq!((f1(0, [0, 0]), f1(0, [1, 0])), (1.0, 0.0));
    }

    #[test]
    fn where_one_ends_and_the_next_begins_is_one_boundary() {
        let segment = |start_step, end_step| Segment {
            start_step,
            end_step,
            state_change_sum: 0.0,
            state_change_peak: 0.0,
            state_change_rank: 1,
        };
        assert_eq!(boundaries(&[segment(3, 7), segment(7, 9)]), [3, 7, 9]);
    }

    /// The most partners, by trying all ways.
    fn most(a: &[usize], b: &[usize], tolerance: usize) -> u64 {
        let Some((&first, rest)) = a.split_first() else {
            return 0;
        };
        let mut best = most(rest, b, tolerance);
        for (j, &y) in b.iter().enumerate() {
            if first.abs_diff(y) <= tolerance {
                let left: Vec<usize> = b
                    .iter()
                    .enumerate()
                    .filter(|(k, _)| *k != j)
                    .map(|(_, &y)| y)
                    .collect();
                best = best.max(1 + most(rest, &left, tolerance));
            }
        }
        best
    }

    proptest! {
        #[test]
        fn no_other_pairing_has_more(
            a in prop::collection::btree_set(0_usize..30, 0..6),
            b in prop::collection::btree_set(0_usize..30, 0..6),
            tolerance in 0_usize..6,
        ) {
            let (a, b): (Vec<_>, Vec<_>) = (a.into_iter().collect(), b.into_iter().collect());
            prop_assert_eq!(n_matched(&a, &b, tolerance), most(&a, &b, tolerance));
            prop_assert_eq!(n_matched(&a, &b, tolerance), n_matched(&b, &a, tolerance));
        }
    }
}
