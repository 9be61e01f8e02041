//! One topic on the clock of the actions: which of its messages counts at a time.

use std::collections::VecDeque;

use super::decode::is_absent;
use super::options::Align;

/// When and where a message of an aligned topic stood.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Held {
    pub(crate) time: i64,
    /// When the oldest of its values came: joints may be shared out among messages.
    pub(crate) oldest: i64,
    pub(crate) offset: u64,
}

/// The messages of one topic that may still count.
#[derive(Debug, Default)]
pub(crate) struct Track {
    /// Where the values of each selector end; set by the first message.
    ends: Vec<usize>,
    /// Joints are shared out among messages: each holds its latest value.
    holds: bool,
    /// The latest value of each joint, and when it came.
    merged: Vec<f64>,
    times: Vec<i64>,
    /// The values that count now.
    current: Option<(Held, Vec<f64>)>,
    /// Values that will count, in the order of time; `None` stands for a message that cannot be used.
    queue: VecDeque<Option<(Held, Vec<f64>)>>,
}

impl Track {
    /// Are values that end so like those before?
    pub(crate) fn fits(&mut self, ends: &[usize]) -> bool {
        if self.ends.is_empty() {
            self.ends.extend_from_slice(ends);
        }
        self.ends == ends
    }

    /// Are joints shared out among its messages?
    pub(crate) fn set_holds(&mut self, holds: bool) {
        self.holds = holds;
    }

    /// Takes the values of a message; those that are absent stay as they were.
    pub(crate) fn merge(&mut self, values: &[f64], time: i64) {
        if !self.holds {
            self.merged.clear();
            self.merged.extend_from_slice(values);
            return;
        }
        if self.merged.len() != values.len() {
            self.merged = vec![super::decode::ABSENT; values.len()];
            self.times = vec![time; values.len()];
        }
        for ((value, merged), at) in values.iter().zip(&mut self.merged).zip(&mut self.times) {
            if !is_absent(*value) {
                *merged = *value;
                *at = time;
            }
        }
    }

    /// Has every joint had a value?
    pub(crate) fn is_complete(&self) -> bool {
        !self.holds || !self.merged.iter().any(|&v| is_absent(v))
    }

    /// Takes a message, in the order of time.
    pub(crate) fn hold(
        &mut self,
        held: Held,
        values: &[f64],
        align: Align,
        pool: &mut Vec<Vec<f64>>,
    ) {
        let (held, values) = if self.holds {
            self.merge(values, held.time);
            if !self.is_complete() {
                return;
            }
            let oldest = self.times.iter().copied().min().unwrap_or(held.time);
            (Held { oldest, ..held }, self.merged.as_slice())
        } else {
            (held, values)
        };
        if align == Align::Before
            && let Some((at, current)) = &mut self.current
        {
            *at = held;
            current.clear();
            current.extend_from_slice(values);
            return;
        }
        let mut buffer = pool.pop().unwrap_or_default();
        buffer.clear();
        buffer.extend_from_slice(values);
        if align == Align::Before {
            self.current = Some((held, buffer));
        } else {
            self.queue.push_back(Some((held, buffer)));
        }
    }

    /// Takes a message that cannot be used, but for its position.
    pub(crate) fn hold_nothing(&mut self) {
        self.queue.push_back(None);
    }

    /// Is it settled which message counts at `time`? Everything up to `now` has come.
    pub(crate) fn knows(&mut self, time: i64, now: i64, align: Align) -> bool {
        match align {
            Align::Before => true,
            Align::Index => !self.queue.is_empty(),
            Align::Nearest => {
                self.pass(time);
                !self.queue.is_empty()
                    || self.current.as_ref().is_some_and(|(held, _)| {
                        now.saturating_sub(time) >= time.saturating_sub(held.time)
                    })
            }
        }
    }

    /// Makes the message that counts at `time` the current one. Times only rise.
    pub(crate) fn advance(&mut self, time: i64, align: Align) {
        match align {
            Align::Before => {}
            Align::Index => self.current = self.queue.pop_front().flatten(),
            Align::Nearest => {
                self.pass(time);
                let distance = |held: &Held| held.time.saturating_sub(time).saturating_abs();
                if let Some(Some((next, values))) = self.queue.front()
                    && self
                        .current
                        .as_ref()
                        .is_none_or(|(held, _)| distance(next) < distance(held))
                {
                    // It stays in the queue too: it may be the one before the next action.
                    self.current = Some((*next, values.clone()));
                }
            }
        }
    }

    /// Lets the messages up to `time` pass; the last of them is the current one.
    fn pass(&mut self, time: i64) {
        while self
            .queue
            .front()
            .and_then(Option::as_ref)
            .is_some_and(|(held, _)| held.time <= time)
        {
            self.current = self.queue.pop_front().flatten();
        }
    }

    pub(crate) fn has_value(&self) -> bool {
        self.current.is_some()
    }

    /// Is the current message older, or newer, than may be?
    pub(crate) fn is_outside(&self, oldest: Option<i64>, newest: Option<i64>) -> bool {
        self.current.as_ref().is_some_and(|(held, _)| {
            oldest.is_some_and(|oldest| held.oldest < oldest)
                || newest.is_some_and(|newest| held.time > newest)
        })
    }

    /// The values of one selector: those that count now, or, on the clock itself, those that came last.
    pub(crate) fn values(&self, take: usize) -> &[f64] {
        let values = self.current.as_ref().map_or(&self.merged, |(_, v)| v);
        let start = take.checked_sub(1).map_or(0, |before| self.ends[before]);
        &values[start..self.ends[take]]
    }

    /// Messages that no action came for, and where the first of them stood.
    pub(crate) fn left(&self) -> (u64, u64) {
        let mut left = self.queue.iter().flatten().map(|(held, _)| held.offset);
        let first = left.next();
        (
            first.map_or(0, |_| 1 + left.count() as u64),
            first.unwrap_or(0),
        )
    }
}
