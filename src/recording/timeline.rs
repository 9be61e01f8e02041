//! Puts the messages of several topics in the order of time, and on the clock of the actions.
//!
//! Messages are often out of order inside a file. They are held back, up to [`REORDER_BYTES`] of values (the whole
//! recording where it is one episode), and leave in the order of time; at equal times a marker comes before a state,
//! a state before an action, an action before an end flag. Each action becomes a step with the states of its time.

use std::collections::VecDeque;
use std::sync::Arc;

use super::align::{Held, Track};
use super::episodes::{Common, Episodes};
use super::error::RecordingError;
use super::limits::REORDER_BYTES;
use super::options::{Align, ReadOptions};
use super::segments::{Run, Segments};
use super::step::{IdRef, LoggedId, Meta, Place, Step};
use super::tally::Tally;

/// Under which cause a step is counted that has no state yet.
pub(crate) const BEFORE_FIRST_STATE: &str = "step before the first state";

/// Under which cause a step is counted that no episode has begun for.
pub(crate) const BEFORE_FIRST_MARKER: &str = "step before the first marker";

/// Under which cause a step is counted before each joint of its action had a value.
pub(crate) const BEFORE_ALL_JOINTS: &str = "step before every joint of its action had a value";

const TOO_OLD: &str = "step without a state within --max-age";
const TOO_LATE: &str = "message further out of the order of time than is held back";
const NO_INDEX: &str = "no state of its index";
const SHIFTED: &str = "positions no longer pair: messages in front are lost";
const NO_ACTION: &str = "state without an action of its index";

/// Which part of a step comes from where: the values of one selector of one source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Part {
    pub(crate) source: usize,
    /// Which of the source's selectors.
    pub(crate) take: usize,
}

/// When and where something happened.
#[derive(Debug, Clone, Copy)]
pub(crate) struct At {
    /// Nanoseconds.
    pub(crate) time: i64,
    /// Bytes from the beginning of the file.
    pub(crate) offset: u64,
    /// It stands for a message that is not of the clock, and is counted as used.
    pub(crate) counts: bool,
}

/// Something that happened at a time. There may be millions: it is kept small.
#[derive(Debug)]
struct Event {
    time: i64,
    /// Order in the file.
    nth: u64,
    offset: u64,
    values: Run,
    /// The source of held values, else where `whats` has it.
    index: u32,
    /// See [`What::rank`].
    rank: u8,
    is_held: bool,
    /// It stands for a message that is not of the clock, and is counted as used.
    counts: bool,
}

impl Event {
    fn bytes(&self) -> u64 {
        size_of::<Self>() as u64 + 8 * self.values.len() as u64
    }
}

/// Rank of a message of an aligned topic, and of what else goes with a state.
const STATE_RANK: u8 = 1;

#[derive(Debug)]
enum What {
    Marker,
    /// A message of an aligned topic that cannot be used; its position is taken all the same.
    BadHeld {
        source: usize,
    },
    Id(LoggedId),
    Action(OwnedMeta),
    BadAction {
        meta: OwnedMeta,
        cause: Arc<str>,
    },
    /// The episode ends at this time, as another topic says.
    Done,
    /// Part of the file is lost here.
    Loss(Arc<str>),
}

impl What {
    /// Order among events of equal time.
    fn rank(&self) -> u8 {
        match self {
            Self::Marker => 0,
            Self::BadHeld { .. } | Self::Id(_) => STATE_RANK,
            Self::Action(_) | Self::BadAction { .. } => 2,
            Self::Done => 3,
            Self::Loss(_) => 4,
        }
    }
}

#[derive(Debug, Clone)]
struct OwnedMeta {
    id: Option<LoggedId>,
    number: Option<i64>,
    reward: Option<f64>,
    ended: bool,
    has_end_flag: bool,
}

impl OwnedMeta {
    fn of(meta: Meta<'_>) -> Self {
        Self {
            id: LoggedId::of(meta.id),
            number: meta.number,
            reward: meta.reward,
            ended: meta.ended,
            has_end_flag: meta.has_end_flag,
        }
    }

    /// `id` stands in for an episode that the message itself does not name.
    fn as_meta<'a>(&'a self, id: Option<&'a LoggedId>) -> Meta<'a> {
        Meta {
            id: LoggedId::as_ref(self.id.as_ref().or(id)),
            number: self.number,
            reward: self.reward,
            ended: self.ended,
            has_end_flag: self.has_end_flag,
        }
    }
}

/// An event of the action's clock that waits for states.
#[derive(Debug)]
struct Waiting {
    time: i64,
    offset: u64,
    what: What,
    values: Vec<f64>,
}

/// Where steps go.
pub(crate) struct Output<'a> {
    pub(crate) episodes: &'a mut Episodes,
    pub(crate) common: &'a Common,
    pub(crate) tally: &'a mut Tally,
}

/// The events of one recording that are held back, and what is known at the time that has been reached.
#[derive(Debug)]
pub(crate) struct Timeline {
    align: Align,
    max_age: Option<i64>,
    gap: Option<i64>,
    needs_marker: bool,
    /// Parts of action and state; source 0 is the clock.
    actions: Vec<Part>,
    states: Vec<Part>,
    tracks: Vec<Track>,
    events: Vec<Event>,
    /// What happened, where it is not that values came; taken when it is its turn.
    whats: Vec<Option<What>>,
    values: Segments,
    /// Bytes of events and values that are held back.
    bytes: u64,
    n_events: u64,
    newest: Option<i64>,
    /// Everything up to this time has left.
    released: Option<i64>,
    /// Bytes that may be held back.
    hold_bytes: u64,
    waiting: VecDeque<Waiting>,
    pool: Vec<Vec<f64>>,
    marked: bool,
    last_action: Option<i64>,
    id: Option<LoggedId>,
    /// Messages are lost: which state has the position of an action is not known any more.
    is_shifted: bool,
    n_used: u64,
    action: Vec<f64>,
    state: Vec<f64>,
}

impl Timeline {
    /// `n_sources` topics, of which number 0 is the clock.
    pub(crate) fn new(
        options: &ReadOptions,
        n_sources: usize,
        (actions, states): (Vec<Part>, Vec<Part>),
        gap: Option<i64>,
        needs_marker: bool,
    ) -> Self {
        Self {
            align: options.align,
            max_age: options.max_age_nanos,
            gap,
            needs_marker,
            actions,
            states,
            tracks: (0..n_sources).map(|_| Track::default()).collect(),
            events: Vec::new(),
            whats: Vec::new(),
            values: Segments::default(),
            bytes: 0,
            n_events: 0,
            newest: None,
            released: None,
            hold_bytes: REORDER_BYTES,
            waiting: VecDeque::new(),
            pool: Vec::new(),
            marked: false,
            last_action: None,
            id: None,
            is_shifted: false,
            n_used: 0,
            action: Vec::new(),
            state: Vec::new(),
        }
    }

    /// The recording is one episode: all of it may be held back, up to `bytes`.
    pub(crate) fn hold_all(&mut self, bytes: u64) {
        self.hold_bytes = bytes.max(REORDER_BYTES);
    }

    /// It is several episodes.
    pub(crate) fn hold_less(&mut self) {
        self.hold_bytes = REORDER_BYTES;
    }

    /// Messages of other topics than the action's that were of use.
    pub(crate) fn n_used(&self) -> u64 {
        self.n_used
    }

    /// Are the values of an aligned topic as wide as before? `ends` are where each selector's values end.
    pub(crate) fn fits(&mut self, source: usize, ends: &[usize]) -> bool {
        self.tracks[source].fits(ends)
    }

    /// A message of an aligned topic that fits; `holds` if values may be absent from it.
    pub(crate) fn held(&mut self, source: usize, values: &[f64], holds: bool, at: At) {
        self.tracks[source].set_holds(holds);
        self.push(
            u32::try_from(source).unwrap_or(0),
            STATE_RANK,
            true,
            values,
            at,
        );
    }

    /// A message of an aligned topic that cannot be used. Where positions count, the action of its position has no
    /// state, and those behind it keep theirs.
    pub(crate) fn bad_held(&mut self, source: usize, at: At) {
        if self.align == Align::Index && self.tracks.get(source).is_some() {
            let at = At {
                counts: false,
                ..at
            };
            self.event(What::BadHeld { source }, &[], at);
        }
    }

    /// A message of the clock; false if its values are not as wide as before.
    pub(crate) fn action(
        &mut self,
        meta: Meta<'_>,
        values: &[f64],
        ends: &[usize],
        holds: bool,
        at: At,
    ) -> bool {
        self.tracks[0].set_holds(holds);
        let fits = self.tracks[0].fits(ends);
        if fits {
            self.event(What::Action(OwnedMeta::of(meta)), values, at);
        }
        fits
    }

    /// A message of the clock that gives no action.
    pub(crate) fn bad_action(&mut self, meta: Meta<'_>, cause: &str, at: At) {
        let what = What::BadAction {
            meta: OwnedMeta::of(meta),
            cause: Arc::from(cause),
        };
        self.event(what, &[], at);
    }

    /// An episode begins.
    pub(crate) fn marker(&mut self, at: At) {
        self.event(What::Marker, &[], at);
    }

    /// The episode is over.
    pub(crate) fn done(&mut self, at: At) {
        self.event(What::Done, &[], at);
    }

    /// What follows belongs to the episode `id`.
    pub(crate) fn id(&mut self, id: IdRef<'_>, at: At) {
        if let Some(id) = LoggedId::of(id) {
            self.event(What::Id(id), &[], at);
        }
    }

    /// A message was read that changes nothing.
    pub(crate) fn of_use(&mut self) {
        self.n_used += 1;
    }

    /// Part of the file is lost behind all that came.
    pub(crate) fn loss(&mut self, cause: &str, offset: u64) {
        let time = self.newest.unwrap_or(i64::MIN);
        let at = At {
            time,
            offset,
            counts: false,
        };
        self.event(What::Loss(Arc::from(cause)), &[], at);
    }

    /// The newest time so far, for messages that do not say theirs.
    pub(crate) fn newest(&self) -> i64 {
        self.newest.unwrap_or(0)
    }

    fn event(&mut self, what: What, values: &[f64], at: At) {
        let index = u32::try_from(self.whats.len()).unwrap_or(u32::MAX);
        let rank = what.rank();
        self.whats.push(Some(what));
        self.push(index, rank, false, values, at);
    }

    fn push(&mut self, index: u32, rank: u8, is_held: bool, values: &[f64], at: At) {
        let At {
            time,
            offset,
            counts,
        } = at;
        self.newest = Some(self.newest.map_or(time, |newest| newest.max(time)));
        let event = Event {
            time,
            nth: self.n_events,
            offset,
            values: self.values.push(values),
            index,
            rank,
            is_held,
            counts,
        };
        self.bytes += event.bytes();
        self.events.push(event);
        self.n_events += 1;
    }

    /// Lets go of the older half of what is held, if that is more than may be.
    pub(crate) fn settle(&mut self, out: &mut Output<'_>) -> Result<(), RecordingError> {
        if self.bytes < self.hold_bytes {
            return Ok(());
        }
        let half = self.events.len() / 2;
        self.release(half, out)
    }

    /// Lets go of everything: the recording is at its end.
    pub(crate) fn finish(&mut self, out: &mut Output<'_>) -> Result<(), RecordingError> {
        self.release(self.events.len(), out)?;
        self.drain(true, out)?;
        if self.align == Align::Index {
            for track in &mut self.tracks {
                let (n_left, offset) = track.left();
                // One more state than actions is what an environment gives: the last observation.
                if n_left > 1 {
                    out.tally.refuse_many(NO_ACTION, offset, n_left);
                    self.n_used -= n_left;
                }
            }
        }
        Ok(())
    }

    fn release(&mut self, n: usize, out: &mut Output<'_>) -> Result<(), RecordingError> {
        let key = |e: &Event| (e.time, e.rank, e.nth);
        if !self.events.is_sorted_by_key(key) {
            self.events.sort_unstable_by_key(key);
        }
        let mut events = std::mem::take(&mut self.events);
        let mut values = std::mem::take(&mut self.values);
        let mut whats = std::mem::take(&mut self.whats);
        for event in events.drain(..n) {
            let what = match whats.get_mut(event.index as usize) {
                Some(what) if !event.is_held => what.take(),
                _ => None,
            };
            self.bytes -= event.bytes();
            self.take(&event, what, values.get(event.values), out)?;
        }
        for event in &mut events {
            if !event.is_held {
                let what = whats.get_mut(event.index as usize).and_then(Option::take);
                event.index = u32::try_from(self.whats.len()).unwrap_or(u32::MAX);
                self.whats.push(what);
            }
        }
        values.keep(events.iter().map(|event| event.values));
        self.values = values;
        self.events = events;
        Ok(())
    }

    /// Takes one event in the order of time.
    fn take(
        &mut self,
        event: &Event,
        what: Option<What>,
        values: &[f64],
        out: &mut Output<'_>,
    ) -> Result<(), RecordingError> {
        let Event {
            time,
            offset,
            counts,
            ..
        } = *event;
        if self.released.is_some_and(|released| time < released)
            && !matches!(what, Some(What::Loss(_)))
        {
            self.is_shifted = true;
            // Of several events of one message one stands for it.
            if counts || matches!(what, Some(What::Action(_) | What::BadAction { .. })) {
                out.tally.refuse(TOO_LATE, offset);
            }
            if let Some(What::Action(meta) | What::BadAction { meta, .. }) = what {
                // Where its end was has passed.
                let meta = Meta {
                    ended: false,
                    ..meta.as_meta(self.id.as_ref())
                };
                out.episodes.drop_step(meta, out.common, out.tally);
            }
            return Ok(());
        }
        self.released = Some(time.max(self.released.unwrap_or(time)));
        self.n_used += u64::from(counts);
        let Some(what) = what else {
            let held = Held {
                time,
                oldest: time,
                offset,
            };
            self.tracks[event.index as usize].hold(held, values, self.align, &mut self.pool);
            // Nothing waits but for states that come later.
            return if self.waiting.is_empty() {
                Ok(())
            } else {
                self.drain(false, out)
            };
        };
        if let What::BadHeld { source } = what {
            self.tracks[source].hold_nothing();
        } else {
            let mut buffer = self.pool.pop().unwrap_or_default();
            buffer.clear();
            buffer.extend_from_slice(values);
            self.waiting.push_back(Waiting {
                time,
                offset,
                what,
                values: buffer,
            });
        }
        self.drain(false, out)
    }

    /// Takes what waits, as far as its states are known.
    fn drain(&mut self, at_end: bool, out: &mut Output<'_>) -> Result<(), RecordingError> {
        while let Some(front) = self.waiting.front() {
            let time = front.time;
            let needs_states = match front.what {
                What::Action(_) => true,
                // Its state is passed over with it.
                What::BadAction { .. } => self.align == Align::Index,
                _ => false,
            };
            if needs_states && !at_end {
                let now = self.released.unwrap_or(time);
                let align = self.align;
                let known = |track: &mut Track| track.knows(time, now, align);
                if !self.tracks[1..].iter_mut().all(known) {
                    return Ok(());
                }
            }
            if let Some(waiting) = self.waiting.pop_front() {
                self.settle_one(waiting, out)?;
            }
        }
        Ok(())
    }

    fn settle_one(&mut self, waiting: Waiting, out: &mut Output<'_>) -> Result<(), RecordingError> {
        let Waiting {
            time,
            offset,
            what,
            values,
        } = waiting;
        let place = Place {
            offset,
            time: Some(time),
        };
        match what {
            What::Marker => {
                self.marked = true;
                out.episodes.cut(out.common, out.tally);
            }
            What::Done => out.episodes.cut(out.common, out.tally),
            What::Id(id) => self.id = Some(id),
            What::Loss(cause) => {
                self.is_shifted = true;
                out.episodes.lose(&cause);
            }
            What::BadAction { meta, cause } => {
                self.cut_at_gap(time, out);
                if self.align == Align::Index {
                    for track in &mut self.tracks[1..] {
                        track.advance(time, Align::Index);
                    }
                }
                let id = self.id.take();
                let meta = meta.as_meta(id.as_ref());
                if self.is_before_first() {
                    // It would not be used if it could be read: it spoils no episode.
                    out.tally.refuse(&cause, offset);
                    out.episodes.drop_step(meta, out.common, out.tally);
                } else {
                    out.episodes.bad(meta, &cause, place, out.common, out.tally);
                }
                self.id = id;
            }
            What::Action(meta) => {
                self.cut_at_gap(time, out);
                let id = self.id.take();
                let result = self.step(meta.as_meta(id.as_ref()), place, time, &values, out);
                self.id = id;
                result?;
            }
            What::BadHeld { .. } => {}
        }
        self.pool.push(values);
        Ok(())
    }

    /// Has no episode begun, or no state come, that an action could belong to?
    fn is_before_first(&self) -> bool {
        let has_no_marker = self.needs_marker && !self.marked;
        let has_no_state =
            self.align == Align::Before && self.tracks[1..].iter().any(|t| !t.has_value());
        has_no_marker || has_no_state
    }

    fn cut_at_gap(&mut self, time: i64, out: &mut Output<'_>) {
        let pause = self.last_action.map(|last| time.saturating_sub(last));
        self.last_action = Some(time);
        if let (Some(pause), Some(gap)) = (pause, self.gap)
            && pause > gap
        {
            out.episodes.cut(out.common, out.tally);
        }
    }

    /// Makes a step of an action and the states of its time.
    fn step(
        &mut self,
        meta: Meta<'_>,
        place: Place,
        time: i64,
        values: &[f64],
        out: &mut Output<'_>,
    ) -> Result<(), RecordingError> {
        let align = self.align;
        self.tracks[0].merge(values, time);
        for track in &mut self.tracks[1..] {
            track.advance(time, align);
        }
        let oldest = self.max_age.map(|age| time.saturating_sub(age));
        let newest = self.max_age.map(|age| time.saturating_add(age));
        let reason = if self.needs_marker && !self.marked {
            Some(BEFORE_FIRST_MARKER)
        } else if self.is_shifted && align == Align::Index && self.tracks.len() > 1 {
            Some(SHIFTED)
        } else if self.tracks[1..].iter().any(|t| !t.has_value()) {
            Some(if align == Align::Index {
                NO_INDEX
            } else {
                BEFORE_FIRST_STATE
            })
        } else if !self.tracks[0].is_complete() {
            Some(BEFORE_ALL_JOINTS)
        } else if self.tracks[1..]
            .iter()
            .any(|t| t.is_outside(oldest, newest))
        {
            Some(TOO_OLD)
        } else {
            None
        };
        if let Some(cause) = reason.filter(|r| [NO_INDEX, SHIFTED].contains(r)) {
            out.episodes.bad(meta, cause, place, out.common, out.tally);
            return Ok(());
        }
        if let Some(reason) = reason {
            out.tally.refuse(reason, place.offset);
            out.episodes.drop_step(meta, out.common, out.tally);
            return Ok(());
        }
        let step = Step {
            action: joined(&self.actions, &self.tracks, &mut self.action),
            state: joined(&self.states, &self.tracks, &mut self.state),
            meta,
            place,
        };
        out.episodes.push(&step, out.common, out.tally)
    }
}

/// The values of all parts, one after the other; in `buffer` where they are not together already.
fn joined<'a>(parts: &[Part], tracks: &'a [Track], buffer: &'a mut Vec<f64>) -> &'a [f64] {
    if let [part] = parts {
        return tracks[part.source].values(part.take);
    }
    buffer.clear();
    for part in parts {
        buffer.extend_from_slice(tracks[part.source].values(part.take));
    }
    buffer
}
