//! One recording that is watched: how far it is, and what it gives when it is looked at.

use std::fs::{self, File};
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::Told;
use super::files::{self, Stamp};
use crate::model::{Episode, RecordingIdentity, RecordingRow, RecordingStatus};
use crate::pipeline::identity;
use crate::pipeline::inputs::Input;
use crate::pipeline::resume::SETTLE;
use crate::pipeline::source::Event;
use crate::recording::{
    Growth, OnDamage, ReadOptions, RecordingError, RecordingReader, Start, is_whole_zst,
};
use crate::tables::{BegunRecording, DoneRecording, Written};

/// Bytes of values that one recording gives at a look, at least; more only by its last episode.
const TURN_BUDGET: u64 = 4 << 20;

/// A file that is compressed as a whole is tried when it has not grown for so long.
const REST: Duration = Duration::from_secs(1);

/// A file that could not be read is tried again after so long.
const PAUSE: Duration = Duration::from_secs(1);

const CHANGED: &str = "is not the recording that it was, and is not read any further";
const SHORTER: &str = "is shorter than it was, and is not read any further";
const OF_A_BAG: &str =
    "is read when the metadata.yaml of its rosbag2 directory says which files are one recording";

/// What a look at one recording gave.
#[derive(Default)]
pub(super) struct Turn {
    pub(super) events: Vec<Event>,
    /// Bytes of the values in them.
    pub(super) bytes: u64,
    pub(super) told: Vec<Told>,
    /// A recording that failed and is read again: its row goes.
    pub(super) forget: Option<Arc<str>>,
    /// There is more to read already.
    pub(super) has_more: bool,
}

/// One recording in the folder.
pub(super) struct Watched {
    input: Input,
    state: State,
    /// By file.
    growth: Vec<Growth>,
    /// How it looked last.
    seen: Option<Stamp>,
    /// Since when it has looked so.
    at_rest_since: Instant,
    /// How it looked when it was read through to see whether it is complete.
    tried: Option<Stamp>,
    /// By what it is known while it grows.
    beginning: Arc<RecordingIdentity>,
    /// Its episodes that are in the tables, or on their way there.
    written: Written,
    /// What it was when it was opened or closed: its row tells of that, whatever is at its place when it is read.
    opened: Option<RecordingIdentity>,
    /// Why it could not be read, and since when, where it is tried again.
    trouble: Option<(String, Instant)>,
    /// What is to be said first.
    greeting: Option<&'static str>,
}

/// How far a recording is.
enum State {
    /// It is not known yet what it is.
    New,
    /// Read as it grows.
    Growing(Box<RecordingReader>),
    /// Read when it is complete.
    UntilComplete,
    /// Complete, and being read.
    Reading(Box<RecordingReader>),
    /// Its row is there.
    Done {
        identity: RecordingIdentity,
        has_failed: bool,
    },
    /// Not to be read any more.
    Left,
}

impl Watched {
    /// A recording that comes into sight, of which the tables may have rows.
    pub(super) fn new(
        input: Input,
        done: Option<&DoneRecording>,
        begun: Option<&BegunRecording>,
    ) -> Self {
        let begun = begun.cloned().unwrap_or_default();
        let (state, greeting) = match (done, begun.whole) {
            // What a run has begun to read from end to end must be what it was then.
            (_, Some(whole)) if identity::of(&input) != whole => (State::Left, Some(CHANGED)),
            (Some(done), _) => {
                let identity = done.identity.clone();
                let has_failed = done.status == RecordingStatus::Failed;
                let state = State::Done {
                    identity,
                    has_failed,
                };
                (state, None)
            }
            (None, _) if files::are_of_unfinished_bag(&input) => (State::Left, Some(OF_A_BAG)),
            (None, _) => (State::New, None),
        };
        Self {
            state,
            growth: vec![Growth::default(); input.files.len()],
            seen: None,
            at_rest_since: Instant::now(),
            tried: None,
            beginning: Arc::new(begun.beginning.unwrap_or_else(|| nothing(&input))),
            written: begun.written,
            opened: None,
            trouble: None,
            greeting,
            input,
        }
    }

    /// Is this the same recording in the same files?
    pub(super) fn is_of(&self, input: &Input) -> bool {
        self.input == *input
    }

    pub(super) fn is_done(&self) -> bool {
        matches!(self.state, State::Done { .. })
    }

    /// Is there something to look at?
    pub(super) fn is_due(&mut self) -> bool {
        if let Some((_, since)) = &self.trouble {
            return since.elapsed() >= PAUSE;
        }
        let is_reading = match &self.state {
            State::Left => return self.greeting.is_some(),
            State::Reading(_) => true,
            State::Growing(reader) => reader.can_go_on(),
            State::New | State::UntilComplete => {
                files::is_compressed(&self.input) && self.tried != self.seen
            }
            State::Done { .. } => false,
        };
        is_reading || self.seen != Some(Stamp::of(&self.input))
    }

    /// What there is to say where its files are gone.
    pub(super) fn farewell(&self) -> Option<Told> {
        let is_over = matches!(self.state, State::Done { .. } | State::Left);
        (!is_over && self.written.n_episodes() > 0)
            .then(|| self.remark("is gone before it was complete"))
    }

    /// A sentence about it.
    fn remark(&self, what: &str) -> Told {
        let name = &self.input.name;
        Told::Remark(match self.written.n_episodes() {
            0 => format!("{name} {what}"),
            n => format!("{name} {what}; its {n} episodes stay in the tables"),
        })
    }

    /// Looks at it, and reads on.
    pub(super) fn turn(&mut self, options: &ReadOptions) -> Turn {
        let mut turn = Turn::default();
        if let Some(greeting) = self.greeting.take() {
            turn.told.push(self.remark(greeting));
        }
        let before = self.trouble.take();
        match self.advance(options, &mut turn) {
            // That it is gone is told of when the folder is read.
            Err(e) if e.kind() == io::ErrorKind::NotFound => {}
            Err(_) if matches!(self.state, State::New) && self.written.n_episodes() == 0 => {
                self.open(options, &mut turn);
            }
            Err(e) => {
                let trouble = format!("cannot be read: {e}");
                if before.is_none_or(|(told, _)| told != trouble) {
                    turn.told.push(self.remark(&trouble));
                }
                self.trouble = Some((trouble, Instant::now()));
                // It may be read again without a change of its size or time.
                self.seen = None;
            }
            Ok(()) => {}
        }
        turn
    }

    fn advance(&mut self, options: &ReadOptions, turn: &mut Turn) -> io::Result<()> {
        match self.state {
            State::Left => return Ok(()),
            State::Reading(_) => {
                if self.is_replaced()? {
                    turn.told.push(self.remark(CHANGED));
                    self.state = State::Left;
                    return Ok(());
                }
                return self.read_on(turn);
            }
            _ => {}
        }
        let stamp = Stamp::of(&self.input);
        if self.seen.replace(stamp) != Some(stamp) {
            self.at_rest_since = Instant::now();
        }
        if let State::Done {
            identity,
            has_failed,
        } = &self.state
        {
            let is_same = identity::of(&self.input) == *identity;
            if is_same {
                return Ok(());
            }
            if !*has_failed {
                let changed = format!("has changed since it was written to the tables: {SETTLE}");
                turn.told
                    .push(Told::Remark(format!("{} {changed}", self.input.name)));
                self.state = State::Left;
                return Ok(());
            }
            turn.forget = Some(Arc::clone(&self.input.name));
            self.state = State::New;
            self.growth.fill(Growth::default());
            if self.written.n_episodes() == 0 {
                self.beginning = Arc::new(nothing(&self.input));
            }
        }
        if let Some(problem) = self.what_is_wrong()? {
            turn.told.push(self.remark(problem));
            self.state = State::Left;
            return Ok(());
        }
        let is_complete = self.look_at_files()?;
        self.begin_where_due(is_complete, options, turn)?;
        if let State::Growing(reader) = &mut self.state {
            let file = File::open(&self.input.files[0])?;
            reader.go_on(file, &self.growth[0])?;
        }
        self.read_on(turn)
    }

    /// While it is read: is another recording at its place? Not where only its time has changed.
    fn is_replaced(&mut self) -> io::Result<bool> {
        let stamp = Stamp::of(&self.input);
        if self.seen == Some(stamp) {
            return Ok(false);
        }
        for file in &self.input.files {
            fs::metadata(file)?;
        }
        self.seen = Some(stamp);
        Ok(self.opened.as_ref() != Some(&identity::of(&self.input)))
    }

    /// Is it another recording than it was?
    fn what_is_wrong(&self) -> io::Result<Option<&'static str>> {
        let known = &self.beginning;
        if let ([file], [growth]) = (&*self.input.files, &*self.growth) {
            let is_shorter = |there: u64| there < growth.end().max(known.bytes);
            if is_shorter(fs::metadata(file)?.len()) {
                return Ok(Some(SHORTER));
            }
        }
        if known.bytes == 0 {
            return Ok(None);
        }
        let file = File::open(&self.input.files[0])?;
        let is_same = *identity::hash_beginning(&file, known.bytes)? == *known.hash;
        Ok((!is_same).then_some(CHANGED))
    }

    /// How far its files have grown; true if they are complete.
    fn look_at_files(&mut self) -> io::Result<bool> {
        if !files::are_plain(&self.input)? {
            return Ok(true);
        }
        if files::is_compressed(&self.input) {
            // At first sight too: it may have been there for long.
            let is_at_rest =
                matches!(self.state, State::New) || self.at_rest_since.elapsed() > REST;
            if !is_at_rest || self.tried == self.seen {
                return Ok(false);
            }
            self.tried = self.seen;
            return is_whole_zst(&self.input.files[0]);
        }
        for (file, growth) in self.input.files.iter().zip(&mut self.growth) {
            growth.advance(&File::open(file)?)?;
        }
        let is_over = |growth: &Growth| growth.is_closed() || growth.start() == Start::Other;
        Ok(self.growth.iter().all(is_over))
    }

    /// Begins to read it, once it is known how.
    fn begin_where_due(
        &mut self,
        is_complete: bool,
        options: &ReadOptions,
        turn: &mut Turn,
    ) -> io::Result<()> {
        match &self.state {
            State::New | State::UntilComplete if is_complete => {
                if files::are_plain(&self.input)? {
                    self.take_beginning(&File::open(&self.input.files[0])?)?;
                }
                self.open(options, turn);
            }
            State::New => {
                let can_grow = self.input.files.len() == 1
                    && !files::is_compressed(&self.input)
                    && options.on_damage == OnDamage::Recover;
                if !can_grow {
                    self.state = State::UntilComplete;
                } else if self.growth[0].start() == Start::Mcap {
                    let (path, name) = (&self.input.files[0], Arc::clone(&self.input.name));
                    let reader = RecordingReader::live(path, name, options);
                    self.state = State::Growing(Box::new(reader));
                    self.take_beginning(&File::open(&self.input.files[0])?)?;
                }
            }
            State::Growing(_) => {
                self.take_beginning(&File::open(&self.input.files[0])?)?;
                if is_complete && self.opened.is_none() {
                    self.opened = Some(identity::of(&self.input));
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Takes as much of its beginning as there is to know it by.
    fn take_beginning(&mut self, file: &File) -> io::Result<()> {
        let there = match self.growth[0].end() {
            0 => file.metadata()?.len(),
            end => end,
        };
        let bytes = there.min(identity::HASHED);
        if bytes > self.beginning.bytes {
            self.beginning = Arc::new(RecordingIdentity {
                name: Arc::clone(&self.input.name),
                bytes,
                hash: Arc::from(identity::hash_beginning(file, bytes)?),
            });
        }
        Ok(())
    }

    /// Opens it as a recording that is complete.
    fn open(&mut self, options: &ReadOptions, turn: &mut Turn) {
        // Taken before: should it be replaced while it is opened, that shows at the next look.
        self.opened = Some(identity::of(&self.input));
        let name = || Arc::clone(&self.input.name);
        let opened = match &self.input.problem {
            Some(problem) => Err(problem.clone()),
            None => RecordingReader::open_split(self.input.files.clone(), name(), options)
                .map_err(|e| e.to_string()),
        };
        match opened {
            Ok(reader) => self.state = State::Reading(Box::new(reader)),
            Err(e) => {
                let row = RecordingReader::failed_row(name(), self.input.bytes(), &e);
                self.end(row, turn);
            }
        }
    }

    /// Reads on by a turn's budget.
    ///
    /// # Errors
    /// If the system refuses to read what is in the tables in part: it is read again, from its beginning.
    fn read_on(&mut self, turn: &mut Turn) -> io::Result<()> {
        let (State::Growing(reader) | State::Reading(reader)) = &mut self.state else {
            return Ok(());
        };
        // The last net: a bug in reading one recording must not cost the others.
        let result = catch_unwind(AssertUnwindSafe(|| reader.read_numbered(TURN_BUDGET)));
        let error = match result {
            Ok(Ok(episodes)) => {
                self.give(episodes, turn);
                None
            }
            Ok(Err(RecordingError::Io(e)))
                if self.written.n_episodes() > 0 && e.raw_os_error().is_some() =>
            {
                self.state = State::New;
                return Err(e);
            }
            Ok(Err(e)) => Some(e.to_string()),
            Err(_panic) => Some("internal error: the reader panicked".to_owned()),
        };
        self.state = match (std::mem::replace(&mut self.state, State::Left), error) {
            (State::Growing(_), Some(e)) => {
                let waits = format!("is read when it is complete: {e}");
                turn.told.push(self.remark(&waits));
                turn.has_more = true;
                // It may be complete already: it is looked at again.
                self.seen = None;
                State::UntilComplete
            }
            (State::Reading(reader), Some(e)) => {
                self.end(reader.into_row(Some(&e)), turn);
                return Ok(());
            }
            (State::Growing(reader) | State::Reading(reader), None) if reader.is_done() => {
                self.end(reader.into_row(None), turn);
                return Ok(());
            }
            (state, _) => {
                turn.has_more = match &state {
                    State::Growing(reader) => reader.can_go_on(),
                    State::Reading(_) => true,
                    _ => false,
                };
                state
            }
        };
        Ok(())
    }

    /// Passes on the episodes that are not in the tables.
    fn give(&mut self, episodes: Vec<(u64, Episode)>, turn: &mut Turn) {
        for (nth, episode) in episodes {
            if self.written.contains(nth) {
                continue;
            }
            self.written.insert(nth);
            let n_columns = episode.actions.n_columns() + episode.states.n_columns();
            turn.bytes += 8 * (episode.n_steps() * n_columns) as u64;
            let identity = Arc::clone(&self.beginning);
            turn.events
                .push(Event::Episode(identity, nth, Box::new(episode)));
        }
    }

    /// It is at its end.
    fn end(&mut self, row: RecordingRow, turn: &mut Turn) {
        let opened = self.opened.take();
        let identity = opened.unwrap_or_else(|| identity::of(&self.input));
        self.state = State::Done {
            identity: identity.clone(),
            has_failed: row.status == RecordingStatus::Failed,
        };
        turn.events
            .push(Event::Recording(Arc::new(identity), Box::new(row)));
    }
}

/// The identity of a recording of which nothing is known.
fn nothing(input: &Input) -> RecordingIdentity {
    RecordingIdentity {
        name: Arc::clone(&input.name),
        bytes: 0,
        hash: Arc::from(""),
    }
}
