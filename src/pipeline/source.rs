//! Reads many recordings in rounds: a few at a time in parallel, each up to a budget, given on in the order of their
//! names.
//!
//! What a round holds depends on the recordings alone, never on the number of threads.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use rayon::prelude::*;

use super::identity;
use super::inputs::Input;
use crate::model::{Episode, RecordingIdentity, RecordingRow};
use crate::recording::{ReadOptions, RecordingReader};
use crate::tables::Written;

/// Bytes of values that one recording gives in a round, at least; more only by its last episode.
const ROUND_BUDGET: u64 = 8 << 20;

/// Most recordings that are open at a time.
const MAX_OPEN: usize = 24;

/// No more recordings are opened once those that are open have this many bytes.
const MAX_OPEN_BYTES: u64 = 16 << 20;

/// What comes out of a recording, in order.
pub(crate) enum Event {
    /// An episode, and its place in the order of appearance.
    Episode(Arc<RecordingIdentity>, u64, Box<Episode>),
    /// The end of a recording.
    Recording(Arc<RecordingIdentity>, Box<RecordingRow>),
}

/// A recording to be read, and which of its episodes an earlier process has written.
#[derive(Debug, Clone)]
pub(crate) struct Job<'a> {
    pub(crate) input: &'a Input,
    pub(crate) written: Written,
}

impl Job<'_> {
    /// Are some of its episodes written?
    pub(crate) fn is_begun(&self) -> bool {
        self.written.n_episodes() > 0
    }
}

/// One round of reading.
#[derive(Default)]
pub(crate) struct Round {
    pub(crate) events: Vec<Event>,
    /// Bytes of input passed in this round.
    pub(crate) bytes: u64,
}

/// How far a recording is.
enum State {
    NotOpened,
    Reading(Box<RecordingReader>),
    /// At its end; the row is taken when it is this recording's turn.
    Ended(Box<RecordingRow>),
}

/// A recording of the current rounds, and what it gave that could not be passed on yet.
struct Active<'a> {
    input: &'a Input,
    identity: Arc<RecordingIdentity>,
    /// Episodes that are written already, and are to be passed over.
    written: Written,
    bytes: u64,
    /// Bytes that progress was told of.
    reported: u64,
    position: u64,
    state: State,
    held: Vec<(u64, Episode)>,
}

/// All recordings of a run.
pub(crate) struct Source<'a> {
    jobs: std::slice::Iter<'a, Job<'a>>,
    options: &'a ReadOptions,
    active: VecDeque<Active<'a>>,
}

impl<'a> Source<'a> {
    pub(crate) fn new(jobs: &'a [Job<'a>], options: &'a ReadOptions) -> Self {
        Self {
            jobs: jobs.iter(),
            options,
            active: VecDeque::new(),
        }
    }

    /// The next round; `None` at the end.
    pub(crate) fn next_round(&mut self) -> Option<Round> {
        while self.active.len() < MAX_OPEN
            && self.active.iter().map(|a| a.bytes).sum::<u64>() < MAX_OPEN_BYTES
        {
            let Some(job) = self.jobs.next() else {
                break;
            };
            self.active.push_back(Active::new(job));
        }
        if self.active.is_empty() {
            return None;
        }
        let options = self.options;
        self.active
            .par_iter_mut()
            .for_each(|active| active.advance(options));
        Some(self.in_order())
    }

    /// What the recordings gave, as far as the order allows.
    fn in_order(&mut self) -> Round {
        let mut round = Round::default();
        for active in &mut self.active {
            round.bytes += active.position.saturating_sub(active.reported);
            active.reported = active.position;
        }
        while let Some(front) = self.active.front_mut() {
            let identity = &front.identity;
            let episode = |(nth, e)| Event::Episode(Arc::clone(identity), nth, Box::new(e));
            round.events.extend(front.held.drain(..).map(episode));
            if !matches!(front.state, State::Ended(_)) {
                break;
            }
            if let Some(Active {
                state: State::Ended(row),
                identity,
                ..
            }) = self.active.pop_front()
            {
                round.events.push(Event::Recording(identity, row));
            }
        }
        round
    }
}

impl<'a> Active<'a> {
    fn new(job: &Job<'a>) -> Self {
        let identity = identity::of(job.input);
        Self {
            input: job.input,
            bytes: identity.bytes,
            identity: Arc::new(identity),
            written: job.written.clone(),
            reported: 0,
            position: 0,
            state: State::NotOpened,
            held: Vec::new(),
        }
    }

    /// Reads on by a round's budget, unless what came before still waits to be passed on.
    fn advance(&mut self, options: &ReadOptions) {
        if !self.held.is_empty() {
            return;
        }
        self.state = match std::mem::replace(&mut self.state, State::NotOpened) {
            State::NotOpened => match self.open(options) {
                Ok(reader) => self.read(reader),
                Err(row) => self.ended(*row),
            },
            State::Reading(reader) => self.read(reader),
            ended @ State::Ended(_) => ended,
        };
    }

    fn ended(&mut self, row: RecordingRow) -> State {
        self.position = self.bytes;
        State::Ended(Box::new(row))
    }

    fn open(&self, options: &ReadOptions) -> Result<Box<RecordingReader>, Box<RecordingRow>> {
        let name = || Arc::clone(&self.input.name);
        if let Some(problem) = &self.input.problem {
            return Err(Box::new(RecordingReader::failed_row(
                name(),
                self.bytes,
                problem,
            )));
        }
        match RecordingReader::open_split(self.input.files.clone(), name(), options) {
            Ok(reader) => Ok(Box::new(reader)),
            Err(e) => Err(Box::new(RecordingReader::failed_row(
                name(),
                self.bytes,
                &e.to_string(),
            ))),
        }
    }

    fn read(&mut self, mut reader: Box<RecordingReader>) -> State {
        // The last net: a bug in reading one recording must not cost the others.
        let result = catch_unwind(AssertUnwindSafe(|| reader.read_numbered(ROUND_BUDGET)));
        match result {
            Ok(Ok(mut episodes)) => {
                episodes.retain(|(nth, _)| !self.written.contains(*nth));
                self.held = episodes;
                self.position = reader.position().min(self.bytes);
                if reader.is_done() {
                    self.ended(reader.into_row(None))
                } else {
                    State::Reading(reader)
                }
            }
            Ok(Err(e)) => self.ended(reader.into_row(Some(&e.to_string()))),
            Err(_panic) => self.ended(reader.into_row(Some("internal error: the reader panicked"))),
        }
    }
}
