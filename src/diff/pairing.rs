//! Which segment of one run is which of the other, for one joint of one episode.
//!
//! Segments of the same steps are the same. Between two of these, in the order of time, the next of A and the next of B
//! are one that moved, if their starts and their ends are at most the tolerance apart; else the one that starts earlier
//! has no partner.

use std::cmp::Ordering;

use super::Span;

/// Two segments that are one, or one that has no partner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pair {
    Same,
    Moved(Span, Span),
    OnlyA(Span),
    OnlyB(Span),
}

impl Pair {
    /// In A and in B, where they differ.
    pub(super) fn spans(self) -> (Option<Span>, Option<Span>) {
        match self {
            Self::Same => (None, None),
            Self::Moved(a, b) => (Some(a), Some(b)),
            Self::OnlyA(a) => (Some(a), None),
            Self::OnlyB(b) => (None, Some(b)),
        }
    }
}

/// All segments of both, each once, in the order of time.
pub(super) fn pairs(a: &[Span], b: &[Span], tolerance: usize) -> Vec<Pair> {
    let mut pairs = Vec::with_capacity(a.len().max(b.len()));
    let (mut rest_a, mut rest_b) = (a, b);
    // Both rise, so those of the same steps come in the same order.
    for (at_a, at_b) in same(a, b) {
        let (before_a, before_b) = (
            &rest_a[..at_a - (a.len() - rest_a.len())],
            &rest_b[..at_b - (b.len() - rest_b.len())],
        );
        between(before_a, before_b, tolerance, &mut pairs);
        pairs.push(Pair::Same);
        (rest_a, rest_b) = (&a[at_a + 1..], &b[at_b + 1..]);
    }
    between(rest_a, rest_b, tolerance, &mut pairs);
    pairs
}

/// Places of segments of the same steps, in order; each place once, even where a run has a segment twice.
fn same(a: &[Span], b: &[Span]) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let (mut at_a, mut at_b) = (0, 0);
    while let (Some(x), Some(y)) = (a.get(at_a), b.get(at_b)) {
        match x.cmp(y) {
            Ordering::Less => at_a += 1,
            Ordering::Greater => at_b += 1,
            Ordering::Equal => {
                found.push((at_a, at_b));
                (at_a, at_b) = (at_a + 1, at_b + 1);
            }
        }
    }
    found
}

/// Segments none of which is the same as another.
fn between(mut a: &[Span], mut b: &[Span], tolerance: usize, pairs: &mut Vec<Pair>) {
    while let (Some((&x, rest_a)), Some((&y, rest_b))) = (a.split_first(), b.split_first()) {
        if is_near(x, y, tolerance) {
            pairs.push(Pair::Moved(x, y));
            (a, b) = (rest_a, rest_b);
        } else if x < y {
            pairs.push(Pair::OnlyA(x));
            a = rest_a;
        } else {
            pairs.push(Pair::OnlyB(y));
            b = rest_b;
        }
    }
    pairs.extend(a.iter().map(|&span| Pair::OnlyA(span)));
    pairs.extend(b.iter().map(|&span| Pair::OnlyB(span)));
}

fn is_near(a: Span, b: Span, tolerance: usize) -> bool {
    a.start_step.abs_diff(b.start_step) <= tolerance && a.end_step.abs_diff(b.end_step) <= tolerance
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn spans(steps: &[(usize, usize)]) -> Vec<Span> {
        let span = |&(start_step, end_step): &(usize, usize)| Span {
            start_step,
            end_step,
        };
        steps.iter().map(span).collect()
    }

    #[track_caller]
    fn check(a: &[(usize, usize)], b: &[(usize, usize)], tolerance: usize, expected: &str) {
        let found = pairs(&spans(a), &spans(b), tolerance);
        let text = |pair: &Pair| match pair {
            Pair::Same => "=".to_owned(),
            Pair::Moved(a, b) => format!("{}>{}", a.start_step, b.start_step),
            Pair::OnlyA(a) => format!("-{}", a.start_step),
            Pair::OnlyB(b) => format!("+{}", b.start_step),
        };
        let found: Vec<String> = found.iter().map(text).collect();
        assert_eq!(found.join(" "), expected);
    }

    #[test]
    fn segments_are_the_same_moved_or_alone() {
        check(&[(1, 4), (4, 9)], &[(1, 4), (4, 9)], 3, "= =");
        check(&[(1, 4), (4, 9)], &[(1, 5), (5, 9)], 1, "1>1 4>5");
        check(&[(1, 4), (4, 9)], &[(1, 5), (5, 9)], 0, "-1 +1 -4 +5");
        check(&[(1, 40)], &[(1, 20), (20, 40)], 3, "+1 -1 +20");
        check(&[], &[(2, 3)], 3, "+2");
        check(&[(1, 4), (1, 4), (4, 9)], &[(1, 4), (4, 9)], 0, "= -1 =");
    }

    #[test]
    fn what_is_the_same_is_not_taken_by_what_is_only_near() {
        check(&[(10, 12), (12, 14)], &[(12, 14)], 3, "-10 =");
        check(&[(12, 14)], &[(10, 12), (12, 14), (14, 16)], 3, "+10 = +14");
    }

    prop_compose! {
        /// Disjoint, in time.
        fn partition()(cuts in prop::collection::btree_set(0_usize..60, 0..12), skip in any::<u16>()) -> Vec<Span> {
            let cuts: Vec<usize> = cuts.into_iter().collect();
            let all = cuts.windows(2).map(|w| Span { start_step: w[0], end_step: w[1] });
            all.enumerate().filter(|(i, _)| skip >> i & 1 == 0).map(|(_, span)| span).collect()
        }
    }

    proptest! {
        #[test]
        fn each_segment_comes_once_and_exact_is_exact(a in partition(), b in partition(), tolerance in 0_usize..5) {
            let found = pairs(&a, &b, tolerance);
            let n_same = a.iter().filter(|span| b.contains(span)).count();
            prop_assert_eq!(found.iter().filter(|p| **p == Pair::Same).count(), n_same);
            let of_a: Vec<Span> = found.iter().filter_map(|p| p.spans().0).collect();
            let of_b: Vec<Span> = found.iter().filter_map(|p| p.spans().1).collect();
            let only = |of: &[Span], other: &[Span]| of.iter().filter(|s| !other.contains(s)).copied().collect::<Vec<_>>();
            prop_assert_eq!(of_a, only(&a, &b));
            prop_assert_eq!(of_b, only(&b, &a));
            for pair in found {
                if let Pair::Moved(x, y) = pair {
                    prop_assert!(tolerance > 0 && x != y && is_near(x, y, tolerance));
                }
            }
            prop_assert!(pairs(&a, &a, tolerance).iter().all(|p| *p == Pair::Same));
        }
    }
}
