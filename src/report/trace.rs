//! The traces of one episode, thinned and packed.

use serde::Serialize;

use super::choice::{MAX_JOINTS, stride};
use super::pack::{PackedChange, PackedValues, flags, seconds};
use crate::model::Series;
use crate::results::{EpisodeRow, EpisodeSteps, JointSteps, SegmentRow};

/// One episode, as the page has it.
#[derive(Debug, Serialize)]
pub(super) struct EpisodeTrace {
    n_steps: usize,
    /// Steps that a point stands for: its action is that of the first, its change the largest, its masks those of any.
    stride: usize,
    /// Joints that are left out.
    n_more_joints: usize,
    /// Nanoseconds since the Unix epoch of the first step; more than a double holds, so as text.
    start_time: Option<String>,
    seconds: Option<String>,
    state: StateTrace,
    joints: Vec<JointTrace>,
}

#[derive(Debug, Default, Serialize)]
struct StateTrace {
    change: Option<PackedChange>,
    mask: Option<String>,
}

#[derive(Debug, Serialize)]
struct JointTrace {
    joint: i32,
    name: Option<String>,
    action: Option<PackedValues>,
    change: Option<PackedChange>,
    /// 1 the mask, 2 correlated.
    flags: Option<String>,
    boundaries: Vec<usize>,
    /// First step, one past the last, sum, peak, rank.
    segments: Vec<(usize, usize, f64, f64, usize)>,
}

impl EpisodeTrace {
    /// Of an episode whose steps are there.
    pub(super) fn of_steps(
        episode: &EpisodeRow,
        steps: &EpisodeSteps,
        segments: &[SegmentRow],
    ) -> Self {
        let stride = stride(steps.n_steps);
        let joints = steps.joints.iter().take(MAX_JOINTS);
        let times = steps.times.as_deref().map(|times| first_of(times, stride));
        Self {
            n_steps: steps.n_steps,
            stride,
            n_more_joints: steps.joints.len().saturating_sub(MAX_JOINTS),
            start_time: episode.start_time.map(|t| t.to_string()),
            seconds: times.as_deref().map(seconds),
            state: StateTrace {
                change: change(&steps.state, stride),
                mask: Some(flags(
                    any_of(&steps.state.mask, stride).into_iter().map(u8::from),
                )),
            },
            joints: joints
                .map(|joint| JointTrace::of_steps(joint, segments, stride))
                .collect(),
        }
    }

    /// Of an episode without steps: what its composite actions hold.
    pub(super) fn of_segments(
        episode: &EpisodeRow,
        segments: &[SegmentRow],
        is_together: bool,
    ) -> Self {
        let stride = stride(episode.n_steps);
        let mut joints: Vec<(i32, Option<String>)> = Vec::new();
        for segment in segments {
            if joints
                .last()
                .is_none_or(|(joint, _)| *joint != segment.joint)
            {
                let name = segment.joint_name.as_deref().map(ToOwned::to_owned);
                joints.push((segment.joint, name));
            }
        }
        Self {
            n_steps: episode.n_steps,
            stride,
            n_more_joints: joints.len().saturating_sub(MAX_JOINTS),
            start_time: episode.start_time.map(|t| t.to_string()),
            seconds: None,
            state: StateTrace::default(),
            joints: joints
                .into_iter()
                .take(MAX_JOINTS)
                .map(|(joint, name)| {
                    let mut values = vec![f64::NAN; episode.n_steps];
                    for s in segments.iter().filter(|s| s.joint == joint) {
                        if let Some(place) = values.get_mut(s.start_step..s.end_step)
                            && place.len() == s.actions.len()
                        {
                            place.copy_from_slice(&s.actions);
                        }
                    }
                    JointTrace {
                        joint,
                        name,
                        action: (!is_together)
                            .then(|| PackedValues::new(&first_of(&values, stride))),
                        change: None,
                        flags: None,
                        boundaries: Vec::new(),
                        segments: ranges(segments, joint),
                    }
                })
                .collect(),
        }
    }
}

impl JointTrace {
    fn of_steps(joint: &JointSteps, segments: &[SegmentRow], stride: usize) -> Self {
        let mask = any_of(&joint.action.mask, stride);
        let correlated = any_of(&joint.correlated, stride);
        let bits = mask
            .into_iter()
            .zip(correlated)
            .map(|(mask, correlated)| u8::from(mask) | u8::from(correlated) << 1);
        Self {
            joint: joint.joint,
            name: joint.joint_name.as_deref().map(ToOwned::to_owned),
            action: (!joint.actions.is_empty())
                .then(|| PackedValues::new(&first_of(&joint.actions, stride))),
            change: change(&joint.action, stride),
            flags: Some(flags(bits)),
            boundaries: (0..joint.boundary.len())
                .filter(|&t| joint.boundary[t])
                .collect(),
            segments: ranges(segments, joint.joint),
        }
    }
}

fn ranges(segments: &[SegmentRow], joint: i32) -> Vec<(usize, usize, f64, f64, usize)> {
    segments
        .iter()
        .filter(|s| s.joint == joint)
        .map(|s| {
            (
                s.start_step,
                s.end_step,
                rounded(s.state_change_sum),
                rounded(s.state_change_peak),
                s.state_change_rank,
            )
        })
        .collect()
}

/// To as many digits as are shown, and some.
pub(super) fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

fn first_of<T: Copy>(values: &[T], stride: usize) -> Vec<T> {
    values.iter().step_by(stride).copied().collect()
}

fn any_of(values: &[bool], stride: usize) -> Vec<bool> {
    values.chunks(stride).map(|c| c.contains(&true)).collect()
}

fn change(series: &Series, stride: usize) -> Option<PackedChange> {
    let largest = |values: &[f64]| -> Vec<f64> {
        let max = |chunk: &[f64]| chunk.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        values.chunks(stride).map(max).collect()
    };
    PackedChange::new(&largest(&series.change), &largest(&series.measure))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thinned_trace_loses_no_change_and_no_mask() {
        assert_eq!(first_of(&[1, 2, 3, 4, 5], 2), [1, 3, 5]);
        assert_eq!(
            any_of(&[false, true, false, false, true], 2),
            [true, false, true]
        );
        let series = Series {
            measure: vec![0.0, 4.0, 2.0, 0.0],
            change: vec![0.0, 1.0, 0.5, 0.0],
            mask: Vec::new(),
        };
        let expected = PackedChange::new(&[1.0, 0.5], &[4.0, 2.0]);
        assert_eq!(change(&series, 2), expected);
    }
}
