//! Boundaries, partition and score: from correlated steps to composite actions.

use std::cmp::Ordering;

use super::params::Profile;
use crate::model::Segment;

/// The last step of each run of truths; in profile `authors` not of a run that reaches the end.
pub(super) fn boundaries(correlated: &[bool], profile: Profile) -> Vec<usize> {
    let n = correlated.len();
    (0..n)
        .filter(|&t| {
            correlated[t]
                && if t + 1 < n {
                    !correlated[t + 1]
                } else {
                    profile == Profile::Paper
                }
        })
        .collect()
}

/// PART: the steps between consecutive boundaries; with a single boundary, all up to it.
pub(super) fn segments(boundaries: &[usize], state_change: &[f64]) -> Vec<Segment> {
    let spans: Vec<(usize, usize)> = match boundaries {
        [] => Vec::new(),
        [only] => vec![(0, only + 1)],
        many => many.windows(2).map(|pair| (pair[0], pair[1])).collect(),
    };
    let mut segments: Vec<Segment> = spans
        .into_iter()
        .map(|(start_step, end_step)| {
            let inside = &state_change[start_step..end_step];
            Segment {
                start_step,
                end_step,
                state_change_sum: inside.iter().fold(0.0, |sum, x| sum + x),
                state_change_peak: inside.iter().fold(0.0, |peak: f64, &x| peak.max(x)),
                state_change_rank: 0,
            }
        })
        .collect();
    rank(&mut segments);
    segments
}

/// 1 for the largest sum; equal sums: the earlier segment first.
fn rank(segments: &mut [Segment]) {
    let mut order: Vec<usize> = (0..segments.len()).collect();
    order.sort_by(|&a, &b| {
        segments[b]
            .state_change_sum
            .partial_cmp(&segments[a].state_change_sum)
            .unwrap_or(Ordering::Equal)
    });
    for (i, index) in order.into_iter().enumerate() {
        segments[index].state_change_rank = i + 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_end_in_boundaries() {
        let mask = [true, true, false, true, false, false, true];
        assert_eq!(boundaries(&mask, Profile::Paper), [1, 3, 6]);
        assert_eq!(boundaries(&mask, Profile::Authors), [1, 3]);
    }

    #[test]
    fn a_single_boundary_takes_all_before_it() {
        let change = [0.0, 0.5, 1.0, 0.25];
        let found = segments(&[2], &change);
        assert_eq!(
            (
                found[0].start_step,
                found[0].end_step,
                found[0].state_change_sum,
                found[0].state_change_peak
            ),
            (0, 3, 1.5, 1.0)
        );
    }

    #[test]
    fn equal_sums_rank_in_time() {
        let change = [0.5, 0.5, 1.0, 0.5, 0.5, 0.0];
        let ranks: Vec<_> = segments(&[0, 2, 3, 5], &change)
            .iter()
            .map(|s| s.state_change_rank)
            .collect();
        assert_eq!(ranks, [1, 2, 3]);
    }
}
