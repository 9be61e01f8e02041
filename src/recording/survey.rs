//! A first reading of a whole recording: its topics, how many messages each has, one message of each, and the names
//! that its messages carry. Made only where the layout must be found out, or joints be ordered by name.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::channels::Channels;
use super::decode::{self, Access, Decoder, Field, Row, Value, Wanted};
use super::error::RecordingError;
use super::limits::Limits;
use super::metadata::Names;
use super::names::{self, NameSets};
use super::records::op;
use super::scan::{Damage, Scanner, Sink};
use super::wire::{Channel, Message, Metadata, Schema};

/// What a recording holds.
#[derive(Debug, Default)]
pub(crate) struct Survey {
    /// By name.
    pub(crate) topics: Vec<Topic>,
    pub(crate) names: Option<Names>,
    /// What is wrong with it, as sentences; the first few.
    pub(crate) damage: Vec<String>,
    pub(crate) n_damages: u64,
    pub(crate) bytes: u64,
}

/// One topic of a recording.
#[derive(Debug, Default)]
pub(crate) struct Topic {
    pub(crate) name: String,
    /// Its channels, as first defined.
    pub(crate) channels: Vec<(Channel, Option<Schema>)>,
    pub(crate) n_messages: u64,
    /// Log time of its first and its last message, nanoseconds.
    pub(crate) times: Option<(u64, u64)>,
    /// Its first message that can be read.
    pub(crate) example: Option<Value>,
    /// Why none can, or the first could not.
    pub(crate) problem: Option<String>,
    /// Names that messages carry, by where they stand.
    pub(crate) name_sets: Vec<(Vec<Access>, NameSets)>,
}

/// Sentences of damage that are kept.
const KEPT_DAMAGE: usize = 8;

/// Messages of a channel that are looked into until names are found in one, where lists are empty.
const MAX_TRIES: u32 = 64;

/// Most topics that an error lists.
const LISTED_TOPICS: usize = 20;

impl Survey {
    /// Reads all files of a recording. One of several that cannot be opened is damage, as it is when steps are read.
    pub(crate) fn of(files: &[PathBuf], limits: &Limits) -> Result<Self, RecordingError> {
        let mut surveyor = Surveyor {
            limits: *limits,
            ..Surveyor::default()
        };
        let mut first_error = None;
        let mut n_opened = 0;
        for file in files {
            surveyor.file = (files.len() > 1).then(|| file_name(file));
            let mut scanner = match Scanner::open(file, limits) {
                Ok(scanner) => scanner,
                Err(e) => {
                    surveyor.note(&e.to_string(), 0);
                    first_error.get_or_insert(e);
                    continue;
                }
            };
            n_opened += 1;
            surveyor.channels = Channels::default();
            surveyor.readers.clear();
            surveyor.n_tries.clear();
            surveyor.path.clone_from(file);
            surveyor.bytes += scanner.bytes();
            while !scanner.is_done() {
                scanner.step(&mut surveyor)?;
            }
        }
        match first_error {
            Some(e) if n_opened == 0 => Err(e),
            _ => Ok(surveyor.finish()),
        }
    }

    pub(crate) fn topic(&self, name: &str) -> Option<&Topic> {
        self.topics.iter().find(|t| t.name == name)
    }

    /// One line of topics with types, encodings and message counts, for errors.
    pub(crate) fn describe(&self) -> String {
        let topics = self.topics.iter().map(|topic| {
            let encoding = topic.channels.first().map_or("", |(c, _)| &c.encoding);
            (topic.name.as_str(), encoding, topic.n_messages)
        });
        describe(topics)
    }
}

/// A sentence of damage with its place: in a split recording offsets are those of one of its files.
pub(crate) fn at_offset(what: &str, offset: u64, file: Option<&str>) -> String {
    match file {
        Some(file) => format!("{what} at offset {offset} of its file {file:?}"),
        None => format!("{what} at offset {offset}"),
    }
}

/// What a file of a split recording is called.
pub(crate) fn file_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// One line of topics with encodings and message counts, for errors.
pub(crate) fn describe<'a>(
    topics: impl ExactSizeIterator<Item = (&'a str, &'a str, u64)>,
) -> String {
    let n_topics = topics.len();
    if n_topics == 0 {
        return "the file has no topics".to_owned();
    }
    let mut text = String::from("topics found: ");
    for (i, (topic, encoding, n)) in topics.enumerate() {
        if i == LISTED_TOPICS {
            let _infallible = write!(text, " and {} more", n_topics - LISTED_TOPICS);
            break;
        }
        let separator = if i == 0 { "" } else { ", " };
        let _infallible = write!(text, "{separator}{topic} ({encoding}, {n} messages)");
    }
    text
}

impl Topic {
    /// The names that messages carry under a path.
    pub(crate) fn name_sets(&self, path: &[Access]) -> NameSets {
        self.name_sets
            .iter()
            .find(|(p, _)| p == path)
            .map(|(_, sets)| sets.clone())
            .unwrap_or_default()
    }

    /// The schema's name, or nothing.
    pub(crate) fn type_name(&self) -> &str {
        self.channels
            .iter()
            .find_map(|(_, schema)| schema.as_ref())
            .map_or("", |schema| &schema.name)
    }
}

/// What reads the names of one channel's messages; none if they carry none.
struct NameReader {
    decoder: Decoder,
    row: Row,
    paths: Vec<Vec<Access>>,
    last: Vec<decode::Names>,
}

#[derive(Default)]
struct Surveyor {
    limits: Limits,
    /// The file that is being read.
    path: PathBuf,
    /// Its name, if it is one of several.
    file: Option<String>,
    channels: Channels,
    topics: BTreeMap<String, Topic>,
    /// By channel of the current file.
    readers: BTreeMap<u16, Option<NameReader>>,
    /// By channel of the current file: messages that were looked into for names.
    n_tries: BTreeMap<u16, u32>,
    names: Option<Names>,
    damage: Vec<String>,
    n_damages: u64,
    bytes: u64,
}

impl Surveyor {
    fn finish(self) -> Survey {
        Survey {
            topics: self.topics.into_values().collect(),
            names: self.names,
            damage: self.damage,
            n_damages: self.n_damages,
            bytes: self.bytes,
        }
    }

    fn note(&mut self, what: &str, offset: u64) {
        self.n_damages += 1;
        if self.damage.len() < KEPT_DAMAGE {
            self.damage
                .push(at_offset(what, offset, self.file.as_deref()));
        }
    }

    fn channel(&mut self, channel: &Channel) {
        let topic = self.topics.entry(channel.topic.clone()).or_default();
        topic.name.clone_from(&channel.topic);
        let schema = self.channels.schema(channel.schema_id);
        let is_known = topic.channels.iter().any(|(c, s)| {
            c.encoding == channel.encoding && s.as_ref().map(|s| &s.name) == schema.map(|s| &s.name)
        });
        if !is_known {
            topic.channels.push((channel.clone(), schema.cloned()));
        }
    }

    /// Takes definitions from the summary that the data has lost.
    fn rescue(&mut self) {
        if self.channels.rescue(&self.path, &self.limits) {
            let channels: Vec<Channel> = self.channels.iter().cloned().collect();
            for channel in &channels {
                self.channel(channel);
            }
        }
    }

    fn message(&mut self, message: &Message<'_>) {
        if self.channels.channel(message.channel_id).is_none() {
            self.rescue();
        }
        let Some(channel) = self.channels.channel(message.channel_id) else {
            return;
        };
        let topic = self.topics.entry(channel.topic.clone()).or_default();
        topic.n_messages += 1;
        let (first, last) = topic.times.unwrap_or((message.log_time, message.log_time));
        topic.times = Some((first.min(message.log_time), last.max(message.log_time)));
        if !self.readers.contains_key(&message.channel_id) {
            let schema = self.channels.schema(channel.schema_id);
            match decode::example(channel, schema, message.data) {
                Ok(example) => {
                    let reader = NameReader::new(channel, schema, &example);
                    // A list that is empty now may have elements with names later on.
                    let n_tries = self.n_tries.entry(message.channel_id).or_default();
                    *n_tries += 1;
                    if reader.is_some() || *n_tries == MAX_TRIES || !has_empty_list(&example) {
                        self.readers.insert(message.channel_id, reader);
                    }
                    topic.example.get_or_insert(example);
                }
                Err(e) => {
                    topic.problem.get_or_insert_with(|| e.to_string());
                }
            }
        }
        if let Some(Some(reader)) = self.readers.get_mut(&message.channel_id) {
            reader.read(message.data, &mut topic.name_sets);
        }
    }
}

impl Sink for Surveyor {
    fn record(&mut self, opcode: u8, body: &[u8], offset: u64) -> Result<(), RecordingError> {
        match opcode {
            op::SCHEMA => {
                if let Ok(schema) = Schema::parse(body) {
                    // A definition that contradicts an earlier one is counted when the recording is read for good.
                    let _counted_later = self.channels.add_schema(schema);
                }
            }
            op::CHANNEL => {
                if let Ok(channel) = Channel::parse(body)
                    && self.channels.add_channel(channel.clone()) == Ok(true)
                {
                    self.channel(&channel);
                }
            }
            op::MESSAGE => {
                if let Ok(message) = Message::parse(body) {
                    self.message(&message);
                }
            }
            op::METADATA if self.names.is_none() => {
                self.names = Metadata::parse(body).ok().as_ref().and_then(Names::of);
            }
            _ => {}
        }
        let _ = offset;
        Ok(())
    }

    fn damage(&mut self, damage: Damage<'_>) -> Result<(), RecordingError> {
        self.note(damage.what, damage.offset);
        Ok(())
    }
}

fn has_empty_list(value: &Value) -> bool {
    match value {
        Value::List(items) => items.is_empty(),
        Value::Map(members) => members.iter().any(|(_, member)| has_empty_list(member)),
        _ => false,
    }
}

impl NameReader {
    fn new(channel: &Channel, schema: Option<&Schema>, example: &Value) -> Option<Self> {
        let paths = names::all_names(example);
        if paths.is_empty() {
            return None;
        }
        let wanted: Vec<Wanted> = paths
            .iter()
            .enumerate()
            .map(|(target, path)| Wanted {
                path: path.clone(),
                field: Field::Names(target),
                required: false,
            })
            .collect();
        let decoder = Decoder::compile(channel, schema, &wanted, example).ok()?;
        Some(Self {
            decoder,
            row: Row::with_targets(&vec![("names", 0); paths.len()]),
            last: vec![decode::Names::default(); paths.len()],
            paths,
        })
    }

    fn read(&mut self, data: &[u8], sets: &mut Vec<(Vec<Access>, NameSets)>) {
        if self.decoder.decode(data, &mut self.row).is_err() {
            return;
        }
        for ((path, target), last) in self.paths.iter().zip(&self.row.targets).zip(&mut self.last) {
            if *last == target.names {
                continue;
            }
            last.clone_from(&target.names);
            let at = sets.iter().position(|(p, _)| p == path);
            let index = at.unwrap_or_else(|| {
                sets.push((path.clone(), NameSets::default()));
                sets.len() - 1
            });
            sets[index].1.add(target.names.iter());
        }
    }
}
