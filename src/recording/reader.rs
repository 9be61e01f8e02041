//! Drives one recording from its opening to its row in the `recordings` table.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::RecordingError;
use super::growth::Growth;
use super::ingest::{self, Ingest};
use super::layout::{self, Layout};
use super::options::{OnDamage, ReadOptions};
use super::plan::Plan;
use super::records::op;
use super::scan::{Damage, Scanner, Sink};
use super::survey::{Survey, at_offset, file_name};
use super::wire::{Channel, Message, Metadata, Schema};
use crate::model::{Cause, ChosenLayout, Episode, RecordingRow, RecordingStatus};

/// Bytes of a file after which reading pauses even where no episode is complete, so that a run can show progress and
/// be stopped.
const MAX_READ: u64 = 32 << 20;

/// One recording, read from front to back.
///
/// Pull [`read`](Self::read) until [`is_done`](Self::is_done), then take the [`row`](Self::into_row).
pub struct RecordingReader {
    files: Vec<PathBuf>,
    /// The file that is being read.
    at: usize,
    scanner: Scanner,
    ingest: Ingest,
    options: ReadOptions,
    /// Bytes of all files.
    bytes: u64,
    /// Bytes of the files that are done.
    bytes_before: u64,
    checked: bool,
    /// Bytes of the file that are there to be read, where it is still being written.
    readable: Option<u64>,
    done: bool,
    /// Why reading ended, kept back until the episodes before it are given out.
    error: Option<RecordingError>,
}

impl RecordingReader {
    /// Opens the file at `path`, which the tables will call `name`.
    ///
    /// # Errors
    /// If it cannot be opened, is no regular file, or is no MCAP file.
    pub fn open(
        path: &Path,
        name: Arc<str>,
        options: &ReadOptions,
    ) -> Result<Self, RecordingError> {
        Self::open_split(vec![path.to_owned()], name, options)
    }

    /// Opens files that are one recording, in their order; at least one.
    ///
    /// # Errors
    /// If there is none, or the first cannot be opened.
    pub fn open_split(
        files: Vec<PathBuf>,
        name: Arc<str>,
        options: &ReadOptions,
    ) -> Result<Self, RecordingError> {
        let (ingest, at, scanner) = begin(name, &files, options, None)?;
        let bytes = match files.as_slice() {
            [_] => scanner.bytes(),
            files => files
                .iter()
                .filter_map(|f| std::fs::metadata(f).ok())
                .map(|m| m.len())
                .sum(),
        };
        Ok(Self {
            ingest,
            files,
            at,
            scanner,
            options: options.clone(),
            bytes,
            bytes_before: 0,
            checked: false,
            readable: None,
            done: false,
            error: None,
        })
    }

    /// Begins with the file at `path`, which is still being written: of each episode as soon as it is complete.
    /// There is something to read once [`go_on`](Self::go_on) has said so.
    pub fn live(path: &Path, name: Arc<str>, options: &ReadOptions) -> Self {
        let files = vec![path.to_owned()];
        Self {
            ingest: Ingest::live(name, files.clone(), options),
            scanner: Scanner::live(path, &options.limits),
            files,
            at: 0,
            options: options.clone(),
            bytes: 0,
            bytes_before: 0,
            checked: false,
            readable: Some(0),
            done: false,
            error: None,
        }
    }

    /// Takes `file`, which is at the path, as far as it has grown.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn go_on(&mut self, file: File, growth: &Growth) -> io::Result<()> {
        self.scanner.go_on(file, growth)?;
        self.readable = Some(growth.end());
        self.bytes = growth.end();
        Ok(())
    }

    /// Is there more to read now?
    pub fn can_go_on(&self) -> bool {
        let is_there = |end: u64| self.scanner.is_done() || self.scanner.position() < end;
        self.error.is_some() || (!self.done && self.readable.is_none_or(is_there))
    }

    /// Size of its files at opening, bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Bytes of the recording read so far (inflated bytes of a `.mcap.zst`).
    pub fn position(&self) -> u64 {
        self.bytes_before + self.scanner.position()
    }

    /// Is there nothing more to read?
    pub fn is_done(&self) -> bool {
        self.done
    }

    /// Reads on until episodes of at least `budget` bytes are complete, some bytes are read, or the recording ends.
    ///
    /// # Errors
    /// If the file cannot be read on, nothing in it can be used, or one episode is beyond the limit. Episodes given
    /// out before stand.
    pub fn read(&mut self, budget: u64) -> Result<Vec<Episode>, RecordingError> {
        let episodes = self.read_numbered(budget)?;
        Ok(episodes.into_iter().map(|(_, episode)| episode).collect())
    }

    /// The same, each episode with its place in the order of appearance.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_numbered(&mut self, budget: u64) -> Result<Vec<(u64, Episode)>, RecordingError> {
        if let Some(e) = self.error.take() {
            return Err(e);
        }
        if self.options.on_damage == OnDamage::Fail && !std::mem::replace(&mut self.checked, true) {
            // Episodes that are given out stand: all must be known to be whole before the first.
            check(&self.files, &self.options)?;
        }
        let mut given = Given::default();
        let until = self.position().saturating_add(MAX_READ);
        while self.can_go_on() && given.bytes < budget && self.position() < until {
            let result = self.step(until, &mut |ingest| {
                given.take_from(ingest);
                given.bytes >= budget
            });
            given.take_from(&mut self.ingest);
            match result {
                Err(e) if given.episodes.is_empty() => return Err(e),
                Err(e) => {
                    self.error = Some(e);
                    break;
                }
                Ok(()) => {}
            }
        }
        Ok(given.episodes)
    }

    fn step(
        &mut self,
        until: u64,
        is_enough: &mut (dyn FnMut(&mut Ingest) -> bool + Send),
    ) -> Result<(), RecordingError> {
        if !self.scanner.is_done() {
            let until = until.saturating_sub(self.bytes_before);
            match self.scanner.run(&mut self.ingest, until, is_enough) {
                Err(RecordingError::OtherNames) if !self.ingest.is_live() => {
                    return self.begin_again();
                }
                result => result?,
            }
        }
        while self.scanner.is_done() && !self.done {
            self.next_file()?;
        }
        Ok(())
    }

    /// Joints are named otherwise than the first message let expect, and no episode is given out yet: reads all names,
    /// and starts over.
    fn begin_again(&mut self) -> Result<(), RecordingError> {
        let survey = Survey::of(&self.files, &self.options.limits)?;
        let name = Arc::clone(&self.ingest.common.recording);
        let (ingest, at, scanner) = begin(name, &self.files, &self.options, Some(survey))?;
        (self.ingest, self.at, self.scanner) = (ingest, at, scanner);
        self.bytes_before = 0;
        Ok(())
    }

    /// Goes on with the next file of a split recording, or ends.
    fn next_file(&mut self) -> Result<(), RecordingError> {
        self.at += 1;
        let Some(file) = self.files.get(self.at) else {
            self.done = true;
            return self.ingest.finish();
        };
        self.bytes_before += self.scanner.bytes();
        self.ingest.next_file();
        match Scanner::open(file, &self.options.limits) {
            Ok(scanner) => {
                self.scanner = scanner;
                Ok(())
            }
            Err(e) => file_is_missing(&mut self.ingest, &e),
        }
    }

    /// The row of the `recordings` table; `error` if reading ended with one.
    pub fn into_row(self, error: Option<&str>) -> RecordingRow {
        let options = self.options;
        let Ingest {
            episodes,
            tally,
            common,
            n_messages,
            encodings,
            damage,
            plan,
            ..
        } = self.ingest;
        let n_episodes = episodes.n_given();
        let causes = tally.causes();
        let damage = damage.map(|(what, n)| match n {
            1 => what,
            n => format!("{what}, and {} more", n - 1),
        });
        let (status, reason) = match (error, damage) {
            (Some(e), _) if n_episodes == 0 => (RecordingStatus::Failed, Some(e.to_owned())),
            (Some(e), _) => (RecordingStatus::Recovered, Some(e.to_owned())),
            (None, damage) if n_episodes == 0 => {
                let why = why_nothing(damage, &causes, plan.as_ref());
                (RecordingStatus::Failed, Some(why))
            }
            (None, Some(damage)) => (RecordingStatus::Recovered, Some(damage)),
            (None, None) => (RecordingStatus::Ok, None),
        };
        // What an error left unused belongs to the refused: used + refused is the number of messages, always.
        let n_held = plan.as_ref().map_or(0, Plan::n_held_used);
        let n_messages_used = (episodes.n_used() + n_held).min(n_messages);
        let of_plan = |f: &dyn Fn(&Plan) -> Option<String>| {
            plan.as_ref().filter(|_| n_messages > 0).and_then(f)
        };
        RecordingRow {
            recording: common.recording,
            bytes: self.bytes,
            status,
            reason,
            env_id: common.env_id,
            encoding: (!encodings.is_empty()).then(|| encodings.join(", ")),
            action_selector: of_plan(&|p| Some(layout::listing(&p.layout.actions))),
            state_selector: of_plan(&|p| Some(layout::listing(&p.layout.states))),
            episode_rule: of_plan(&|p| p.describe_rule(&options.episodes, episodes.rule())),
            clock: Some(options.clock.as_str().to_owned()),
            align: Some(options.align.as_str().to_owned()),
            chosen: plan
                .as_ref()
                .filter(|_| n_messages > 0)
                .and_then(|p| chosen(&p.layout)),
            n_messages,
            n_messages_used,
            n_messages_refused: n_messages - n_messages_used,
            causes,
            n_episodes,
        }
    }

    /// The row of a recording that could not even be opened.
    pub fn failed_row(name: Arc<str>, bytes: u64, error: &str) -> RecordingRow {
        RecordingRow {
            recording: name,
            bytes,
            status: RecordingStatus::Failed,
            reason: Some(error.to_owned()),
            env_id: None,
            encoding: None,
            action_selector: None,
            state_selector: None,
            episode_rule: None,
            clock: None,
            align: None,
            chosen: None,
            n_messages: 0,
            n_messages_used: 0,
            n_messages_refused: 0,
            causes: Vec::new(),
            n_episodes: 0,
        }
    }
}

/// Episodes that one call gives out.
#[derive(Default)]
struct Given {
    episodes: Vec<(u64, Episode)>,
    /// Bytes of their values.
    bytes: u64,
}

impl Given {
    fn take_from(&mut self, ingest: &mut Ingest) {
        for (nth, episode) in ingest.episodes.take_ready() {
            let n_columns = episode.actions.n_columns() + episode.states.n_columns() + 2;
            self.bytes += 8 * (episode.n_steps() * n_columns) as u64;
            self.episodes.push((nth, episode));
        }
    }
}

/// Opens the first file that is there.
fn begin(
    name: Arc<str>,
    files: &[PathBuf],
    options: &ReadOptions,
    survey: Option<Survey>,
) -> Result<(Ingest, usize, Scanner), RecordingError> {
    let mut ingest = Ingest::with_survey(name, files.to_vec(), options, survey);
    let mut first_error = None;
    for (at, file) in files.iter().enumerate() {
        match Scanner::open(file, &options.limits) {
            Ok(scanner) => return Ok((ingest, at, scanner)),
            Err(e) => {
                if files.len() > 1 {
                    file_is_missing(&mut ingest, &e)?;
                    ingest.next_file();
                }
                first_error.get_or_insert(e);
            }
        }
    }
    Err(first_error.unwrap_or(RecordingError::NotAFile("nothing")))
}

/// The current file of a split recording is not there, or is none.
fn file_is_missing(ingest: &mut Ingest, e: &RecordingError) -> Result<(), RecordingError> {
    ingest.damage(Damage {
        cause: "file of a split recording cannot be read",
        what: &e.to_string(),
        offset: 0,
        loses_messages: true,
    })
}

/// What the layout is, if it was found out.
fn chosen(layout: &Layout) -> Option<ChosenLayout> {
    layout.why.as_ref().map(|why| ChosenLayout {
        flags: layout.flags(),
        why: why.clone(),
        is_native: layout.is_native(),
    })
}

/// Why no episode came out.
fn why_nothing(damage: Option<String>, causes: &[Cause], plan: Option<&Plan>) -> String {
    let mut why = damage
        .or_else(|| causes.first().map(|c| c.cause.clone()))
        .unwrap_or_else(|| "it holds no message".to_owned());
    if why.contains("is missing") {
        why += &plan.map(known_fields).unwrap_or_default();
    }
    format!("no episode came out: {why}")
}

/// The members that messages of each topic have, for an error that misses one.
fn known_fields(plan: &Plan) -> String {
    let known = plan.sources.iter().filter(|s| !s.fields.is_empty());
    let listed = known.map(|s| format!(" (fields of {}: {})", s.topic, s.fields.join(", ")));
    listed.collect::<Vec<_>>().concat()
}

/// Reads all files for damage alone.
fn check(files: &[PathBuf], options: &ReadOptions) -> Result<(), RecordingError> {
    struct Checker(Option<String>);
    impl Sink for Checker {
        fn record(&mut self, opcode: u8, body: &[u8], offset: u64) -> Result<(), RecordingError> {
            let parsed = match opcode {
                op::SCHEMA => Schema::parse(body).map(|_| ()),
                op::CHANNEL => Channel::parse(body).map(|_| ()),
                op::MESSAGE => Message::parse(body).map(|_| ()),
                op::METADATA => Metadata::parse(body).map(|_| ()),
                _ => Ok(()),
            };
            parsed.map_err(|e| {
                let name = ingest::name(opcode);
                RecordingError::Damaged(format!("{name} record {e} at offset {offset}"))
            })
        }
        fn damage(&mut self, damage: Damage<'_>) -> Result<(), RecordingError> {
            let Damage { what, offset, .. } = damage;
            let what = at_offset(what, offset, self.0.as_deref());
            Err(RecordingError::Damaged(what))
        }
    }
    for file in files {
        let mut checker = Checker((files.len() > 1).then(|| file_name(file)));
        let mut scanner = Scanner::open(file, &options.limits).map_err(|e| match &checker.0 {
            Some(name) => RecordingError::Damaged(format!("its file {name:?} {e}")),
            None => e,
        })?;
        while !scanner.is_done() {
            scanner.step(&mut checker)?;
        }
    }
    Ok(())
}
