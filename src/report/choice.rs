//! Which episodes get their traces into the page: a rule that the page states.

use super::survey::Survey;
use crate::results::{EpisodeQuery, EpisodeRow};

/// Points of a trace; of a longer episode each point stands for several steps.
pub(super) const MAX_POINTS: usize = 20_000;

/// Joints of an episode whose traces are embedded.
pub(super) const MAX_JOINTS: usize = 32;

/// What may be embedded.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub(super) max_episodes: usize,
    pub(super) max_bytes: usize,
}

/// The episodes that are embedded, by index and in the order of the table, as far as the bounds go: those that are
/// asked for; if none is, then from one environment after another in turn those with the strongest composite action.
pub(super) fn choose(survey: &Survey, queries: &[EpisodeQuery], bounds: Bounds) -> Vec<usize> {
    let is_asked_for = |e: &EpisodeRow| queries.iter().any(|q| q.matches(&e.key));
    let order = if queries.is_empty() {
        in_turn(survey)
    } else {
        (0..survey.episodes.len())
            .filter(|&i| is_asked_for(&survey.episodes[i]))
            .collect()
    };
    let mut chosen: Vec<usize> = Vec::new();
    let mut bytes: usize = 0;
    for index in order {
        if chosen.len() >= bounds.max_episodes {
            break;
        }
        let size = size(&survey.episodes[index]);
        // A smaller one may still fit; the first is embedded whatever its size.
        if bytes + size <= bounds.max_bytes || chosen.is_empty() {
            bytes += size;
            chosen.push(index);
        }
    }
    chosen.sort_unstable();
    chosen
}

/// Episodes that have something to show: the strongest of each environment, then the second of each, …
fn in_turn(survey: &Survey) -> Vec<usize> {
    let mut order: Vec<usize> = (0..survey.episodes.len())
        .filter(|&i| survey.episodes[i].n_steps > 0)
        .collect();
    order.sort_by(|&a, &b| survey.strongest[b].total_cmp(&survey.strongest[a]));
    let mut n_before = vec![0_usize; survey.environments.len()];
    let mut rounds: Vec<(usize, usize)> = Vec::with_capacity(order.len());
    for index in order {
        let round = &mut n_before[survey.environment[index]];
        rounds.push((*round, index));
        *round += 1;
    }
    rounds.sort_by_key(|&(round, _)| round);
    rounds.into_iter().map(|(_, index)| index).collect()
}

/// Steps that one point of its traces stands for.
pub(super) fn stride(n_steps: usize) -> usize {
    n_steps.div_ceil(MAX_POINTS).max(1)
}

/// Characters that its traces take at most, but for its segments.
fn size(episode: &EpisodeRow) -> usize {
    let points = episode.n_steps.div_ceil(stride(episode.n_steps));
    let of_joint = 4 + 2 + 1;
    let of_state = 4 + 2 + 1;
    points * (episode.n_joints.min(MAX_JOINTS) * of_joint + of_state) * 4 / 3
}
