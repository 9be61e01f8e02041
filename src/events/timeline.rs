//! An episode and what was found in it as messages, in the order of its steps. Pure.

use std::sync::Arc;

use prost::Message;

use super::messages::{ActionChange, Event, KeyValuePair, StateChange, Timestamp};
use crate::model::{Episode, Extraction, JointExtraction, JointMode, Outcome, Segment};

/// What a message is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Subject {
    /// A composite action.
    Event,
    /// The state at a step.
    State,
    /// A joint at a step, by its index.
    Joint(usize),
}

/// Hands the messages of an episode to `sink`, with their times; stops at its first error.
///
/// Where no clock ran, a step's number stands for its time.
pub(super) fn tell<E>(
    episode: &Episode,
    outcome: &Outcome,
    mut sink: impl FnMut(Subject, u64, &[u8]) -> Result<(), E>,
) -> Result<(), E> {
    let Outcome::Extracted(extraction) = outcome else {
        return Ok(());
    };
    let mut joints: Vec<JointCursor<'_>> = (0..extraction.joints.len())
        .map(|index| JointCursor::new(episode, extraction, index))
        .collect();
    let mut bytes = Vec::new();
    let mut send = |subject, time: i64, message: &dyn EncodeInto| {
        bytes.clear();
        message.encode_into(&mut bytes);
        sink(subject, u64::try_from(time).unwrap_or(0), &bytes)
    };
    for step in 0..episode.n_steps() {
        let time = time_of(episode, step);
        for joint in &mut joints {
            if let Some(event) = joint.event(step) {
                send(Subject::Event, time, &event)?;
            }
        }
        send(
            Subject::State,
            time,
            &StateChange {
                episode: episode.key.episode,
                step: number(step),
                measure: extraction.state.measure[step],
                change: extraction.state.change[step],
                mask: extraction.state.mask[step],
            },
        )?;
        for joint in &mut joints {
            let change = joint.change(step);
            send(Subject::Joint(joint.index), time, &change)?;
        }
    }
    Ok(())
}

/// A message of any kind, encoded.
trait EncodeInto {
    fn encode_into(&self, bytes: &mut Vec<u8>);
}

impl<M: Message> EncodeInto for M {
    fn encode_into(&self, bytes: &mut Vec<u8>) {
        // A vector grows: there is always room.
        self.encode_raw(bytes);
    }
}

/// A joint while its steps are told.
struct JointCursor<'a> {
    episode: &'a Episode,
    extraction: &'a Extraction,
    index: usize,
    found: &'a JointExtraction,
    /// The segment that the step is in, or the next.
    segment: usize,
    /// The next boundary.
    boundary: usize,
}

impl<'a> JointCursor<'a> {
    fn new(episode: &'a Episode, extraction: &'a Extraction, index: usize) -> Self {
        Self {
            episode,
            extraction,
            index,
            found: &extraction.joints[index],
            segment: 0,
            boundary: 0,
        }
    }

    /// The composite action that begins at `step`.
    fn event(&mut self, step: usize) -> Option<Event> {
        let segments = &self.found.segments;
        if segments.get(self.segment)?.end_step <= step {
            self.segment += 1;
        }
        let segment = segments.get(self.segment)?;
        (segment.start_step == step).then(|| self.event_of(segment))
    }

    fn event_of(&self, segment: &Segment) -> Event {
        let episode = self.episode;
        let time = |step| Some(Timestamp::from_nanos(time_of(episode, step)));
        Event {
            start_time: time(segment.start_step),
            end_time: time(segment.end_step - 1),
            metadata: self.metadata(segment),
        }
    }

    fn metadata(&self, segment: &Segment) -> Vec<KeyValuePair> {
        let (episode, mode) = (self.episode, self.extraction.mode);
        let Segment {
            start_step,
            end_step,
            state_change_sum,
            state_change_peak,
            state_change_rank,
        } = *segment;
        let text = |text: &Arc<str>| text.to_string();
        let pairs = [
            ("episode", Some(episode.key.episode.to_string())),
            ("episode_id", episode.key.episode_id.as_ref().map(text)),
            ("joint", Some(mode.joint_number(self.index).to_string())),
            ("joint_name", episode.joint_name(mode, self.index).map(text)),
            ("segment", Some(self.segment.to_string())),
            ("start_step", Some(start_step.to_string())),
            ("end_step", Some(end_step.to_string())),
            ("n_steps", Some((end_step - start_step).to_string())),
            ("state_change_sum", Some(state_change_sum.to_string())),
            ("state_change_peak", Some(state_change_peak.to_string())),
            ("state_change_rank", Some(state_change_rank.to_string())),
            (
                "reward_sum",
                episode
                    .reward_sum(start_step..end_step)
                    .map(|sum| sum.to_string()),
            ),
        ];
        pairs
            .into_iter()
            .filter_map(|(key, value)| {
                value.map(|value| KeyValuePair {
                    key: key.to_owned(),
                    value,
                })
            })
            .collect()
    }

    fn change(&mut self, step: usize) -> ActionChange {
        let boundary = self.found.boundaries.get(self.boundary) == Some(&step);
        self.boundary += usize::from(boundary);
        let segment = self.found.segments.get(self.segment);
        let is_inside = segment.is_some_and(|s| (s.start_step..s.end_step).contains(&step));
        let is_one_joint = self.extraction.mode == JointMode::Each;
        let action = &self.found.action;
        ActionChange {
            episode: self.episode.key.episode,
            step: number(step),
            action: is_one_joint.then(|| self.episode.actions.column(self.index)[step]),
            measure: action.measure[step],
            change: action.change[step],
            mask: action.mask[step],
            correlated: self.found.correlated[step],
            boundary,
            segment: if is_inside {
                i32::try_from(self.segment).unwrap_or(i32::MAX)
            } else {
                -1
            },
        }
    }
}

fn time_of(episode: &Episode, step: usize) -> i64 {
    episode
        .times
        .as_ref()
        .map_or_else(|| i64::try_from(step).unwrap_or(i64::MAX), |t| t[step])
}

fn number(step: usize) -> u32 {
    u32::try_from(step).unwrap_or(u32::MAX)
}
