//! Eq. 9–11: which changes count, and where those of actions and states come together.

use super::normalize::Extent;
use super::params::{ExtractionParams, Profile};

/// A change this near the threshold equals it (profile `paper`), so that no result hangs on the last bit of a sum.
const TIE: f64 = 1e-9;

/// Eq. 9: true where the change passes the threshold.
pub(super) fn threshold(change: &[f64], extent: &Extent, params: &ExtractionParams) -> Vec<bool> {
    let lambda = params.threshold();
    if extent.is_constant() {
        return vec![false; change.len()];
    }
    match params.profile() {
        Profile::Paper => change.iter().map(|&x| x > lambda + TIE).collect(),
        Profile::Authors => change.iter().map(|&x| x >= lambda).collect(),
    }
}

/// Eq. 10–11: true where both masks hold a truth in the window of the step.
pub(super) fn correlate(action: &[bool], state: &[bool], params: &ExtractionParams) -> Vec<bool> {
    let n = action.len();
    let w = params.window();
    let (action, state) = (running_count(action), running_count(state));
    (0..n)
        .map(|t| {
            let (from, to) = match params.profile() {
                Profile::Paper if t + w < n => (t, t + w),
                Profile::Paper => ((t + 1).saturating_sub(w), t + 1),
                Profile::Authors if t >= params.left() => {
                    (t - params.left(), (t + params.right()).min(n))
                }
                Profile::Authors => (0, 0),
            };
            action[to] > action[from] && state[to] > state[from]
        })
        .collect()
}

/// Truths before each step, and in all: `n + 1` counts.
fn running_count(mask: &[bool]) -> Vec<u32> {
    let mut counts = Vec::with_capacity(mask.len() + 1);
    let mut count = 0;
    counts.push(0);
    counts.extend(mask.iter().map(|&m| {
        count += u32::from(m);
        count
    }));
    counts
}
