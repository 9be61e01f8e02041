//! One episode while it grows, and what is used of it once it closes: everything up to its first bad step.

use super::columns::ColumnsBuilder;
use super::episodes::Common;
use super::step::Step;
use super::tally::Tally;
use crate::model::{Columns, Episode, EpisodeKey, Incomplete};

/// The steps of one episode in the order in which they came.
#[derive(Debug, Default)]
pub(crate) struct OpenEpisode {
    columns: Option<(ColumnsBuilder, ColumnsBuilder)>,
    /// Steps of the episode before, which may well be as many as here.
    n_expected: usize,
    /// Logged step numbers, if the first step has one; else empty.
    steps: Vec<i64>,
    times: Vec<i64>,
    has_times: bool,
    /// NaN where a step has none.
    rewards: Vec<f64>,
    /// Where each step stood in the file.
    offsets: Vec<u64>,
    /// Nothing after the rows held is used: a bad step without a number, or a wrong width, came.
    stopped: Option<String>,
    /// The lowest step number that is bad, and why.
    bad: Option<(i64, String)>,
    /// Steps may have been lost after the last one held; the next number will tell.
    suspect: Option<String>,
    /// Why a gap in the step numbers would not surprise.
    lost: Option<String>,
    beginning_lost: Option<String>,
    /// Steps read and dropped.
    n_dropped: u64,
}

/// An episode after its end; all but its name.
#[derive(Debug)]
pub(crate) struct Closed {
    pub(crate) actions: Columns,
    states: Columns,
    times: Option<Vec<i64>>,
    rewards: Option<Vec<f64>>,
    incomplete: Option<Incomplete>,
    n_dropped_steps: u64,
}

/// Under which cause the steps after a bad one are counted.
const AFTER_BAD: &str = "step after the first bad step of its episode";

impl OpenEpisode {
    /// Expects about `n_expected` steps.
    pub(crate) fn new(n_expected: usize) -> Self {
        Self {
            n_expected,
            ..Self::default()
        }
    }

    /// Do its messages carry step numbers?
    pub(crate) fn is_numbered(&self) -> bool {
        !self.steps.is_empty()
    }

    /// Bytes of the values held.
    pub(crate) fn bytes(&self) -> u64 {
        let rows = self.times.len() as u64 * 32;
        rows + self
            .columns
            .as_ref()
            .map_or(0, |(a, s)| a.bytes() + s.bytes())
    }

    /// Adds one step; refuses it where a bad one came before.
    pub(crate) fn push(&mut self, step: &Step<'_>, tally: &mut Tally) {
        let place = step.place;
        if self.stopped.is_some() {
            self.n_dropped += 1;
            tally.refuse(AFTER_BAD, place.offset);
            return;
        }
        let (action, state) = (step.action.len(), step.state.len());
        if let Some((a, s)) = &self.columns {
            let numbered = self.is_numbered();
            let problem = if a.width() != action {
                Some(format!(
                    "action has another width than in the episode's first step ({action}, not {})",
                    a.width()
                ))
            } else if s.width() != state {
                Some(format!(
                    "state has another width than in the episode's first step ({state}, not {})",
                    s.width()
                ))
            } else if numbered != step.meta.number.is_some() {
                Some(
                    "step number is missing where others have one, or the other way round"
                        .to_owned(),
                )
            } else if self.has_times != place.time.is_some() {
                Some("message without a time that can be used, or the only one with one".to_owned())
            } else {
                None
            };
            if let Some(reason) = problem {
                let cause = reason.split(" (").next().unwrap_or(&reason);
                tally.refuse(cause, place.offset);
                self.bad_step(step.meta.number, &reason);
                return;
            }
        }
        let (actions, states) = self.columns.get_or_insert_with(|| {
            (
                ColumnsBuilder::new(action, self.n_expected),
                ColumnsBuilder::new(state, self.n_expected),
            )
        });
        actions.push(step.action);
        states.push(step.state);
        if let Some(number) = step.meta.number {
            if self.suspect.is_some()
                && self
                    .steps
                    .last()
                    .is_some_and(|&last| last.checked_add(1) == Some(number))
            {
                self.suspect = None;
            }
            self.steps.push(number);
        }
        self.has_times = place.time.is_some();
        self.times.push(place.time.unwrap_or(0));
        self.rewards.push(step.meta.reward.unwrap_or(f64::NAN));
        self.offsets.push(place.offset);
    }

    /// A step that cannot be used came; it is dropped.
    pub(crate) fn bad_step(&mut self, step: Option<i64>, reason: &str) {
        self.n_dropped += 1;
        match step {
            Some(step) if self.is_numbered() || self.columns.is_none() => {
                if self.bad.as_ref().is_none_or(|(first, _)| step < *first) {
                    self.bad = Some((step, reason.to_owned()));
                }
            }
            _ => self.lose_a_step_of_ours(reason),
        }
    }

    /// Steps were read for it that are not used.
    pub(crate) fn drop_steps(&mut self, n: u64) {
        self.n_dropped += n;
    }

    /// A step that is probably ours came and cannot be read at all.
    pub(crate) fn lose_a_step(&mut self, reason: &str) {
        self.lose_a_step_of_ours(reason);
    }

    fn lose_a_step_of_ours(&mut self, reason: &str) {
        if self.is_numbered() {
            self.lose(reason);
        } else {
            self.stopped.get_or_insert_with(|| reason.to_owned());
        }
    }

    /// Part of the file is lost; steps of ours may have been in it.
    pub(crate) fn lose(&mut self, reason: &str) {
        if self.is_numbered() {
            self.suspect.get_or_insert_with(|| reason.to_owned());
            self.lost.get_or_insert_with(|| reason.to_owned());
        } else {
            self.stopped
                .get_or_insert_with(|| format!("steps may be lost: {reason}"));
        }
    }

    /// Part of the file in front of our first step is lost.
    pub(crate) fn lose_the_beginning(&mut self, reason: &str) {
        self.beginning_lost = Some(format!("its first steps may be lost: {reason}"));
    }

    /// Orders the steps, finds the first bad one and keeps what is before it.
    pub(crate) fn close(mut self, tally: &mut Tally) -> Closed {
        let n = self.times.len();
        let order = if self.is_numbered() {
            order_of(&self.steps)
        } else if self.has_times {
            order_of(&self.times)
        } else {
            None
        };
        let at = |i: usize| order.as_ref().map_or(i, |o| o[i]);
        let (used, gap) = self.usable(n, at);
        let incomplete = gap
            .or_else(|| self.beginning_lost.take())
            .map(|reason| Incomplete { reason });
        let dropped = (n - used) as u64;
        if dropped > 0 {
            let first = (used..n).map(|i| self.offsets[at(i)]).min();
            tally.refuse_many(AFTER_BAD, first.unwrap_or(0), dropped);
        }
        let pick_times = |values: &[i64]| (0..used).map(|i| values[at(i)]).collect::<Vec<_>>();
        let pick = |values: &[f64]| (0..used).map(|i| values[at(i)]).collect::<Vec<_>>();
        let rewards = pick(&self.rewards);
        let times = self.has_times.then(|| pick_times(&self.times));
        let (actions, states) = match self.columns {
            Some((a, s)) => (
                a.finish(used, order.as_deref()),
                s.finish(used, order.as_deref()),
            ),
            None => (Columns::default(), Columns::default()),
        };
        Closed {
            actions,
            states,
            times,
            rewards: rewards.iter().any(|r| !r.is_nan()).then_some(rewards),
            incomplete,
            n_dropped_steps: self.n_dropped + dropped,
        }
    }

    /// How many of the ordered steps stand before the first bad one, and what is wrong with that.
    fn usable(&self, n: usize, at: impl Fn(usize) -> usize) -> (usize, Option<String>) {
        if !self.is_numbered() {
            let reason = self
                .stopped
                .clone()
                .or_else(|| self.bad.as_ref().map(|(_, reason)| reason.clone()));
            return (n, reason);
        }
        let number = |i: usize| self.steps[at(i)];
        let contiguous = (1..n).find(|&i| number(i - 1).checked_add(1) != Some(number(i)));
        let until_gap = contiguous.unwrap_or(n);
        let bad = self
            .bad
            .as_ref()
            .map(|(step, reason)| ((0..n).find(|&i| number(i) >= *step).unwrap_or(n), reason));
        if let Some((until_bad, reason)) = bad
            && until_bad <= until_gap
        {
            return (until_bad, Some(reason.clone()));
        }
        let reason = match contiguous {
            Some(i) if number(i) == number(i - 1) => {
                Some(format!("step number {} came twice", number(i)))
            }
            Some(i) => {
                let missing = format!("step number {} is missing", number(i - 1).saturating_add(1));
                Some(
                    self.lost
                        .as_ref()
                        .map_or(missing.clone(), |lost| format!("{missing}: {lost}")),
                )
            }
            None => self.stopped.clone().or_else(|| {
                self.suspect
                    .as_ref()
                    .map(|s| format!("its last steps may be lost: {s}"))
            }),
        };
        (until_gap, reason)
    }
}

/// The order that sorts `keys`, equal ones by position; `None` if they are sorted already.
fn order_of(keys: &[i64]) -> Option<Vec<usize>> {
    if keys.is_sorted() {
        return None;
    }
    let mut order: Vec<usize> = (0..keys.len()).collect();
    order.sort_by_key(|&i| keys[i]);
    Some(order)
}

impl Closed {
    /// The episode under its name.
    pub(crate) fn named(self, key: EpisodeKey, common: &Common) -> Episode {
        let n_joints = self.actions.n_columns();
        Episode {
            key,
            env_id: common.env_id.clone(),
            actions: self.actions,
            states: self.states,
            // Names that do not fit the action are worse than none.
            joint_names: common
                .joint_names
                .clone()
                .filter(|names| names.len() == n_joints),
            times: self.times,
            rewards: self.rewards,
            incomplete: self.incomplete,
            n_dropped_steps: self.n_dropped_steps,
        }
    }
}
