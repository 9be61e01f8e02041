//! What becomes of each record of a recording: definitions are kept, messages of the chosen topics decoded and made
//! steps, all else counted or passed over.

mod steps;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use super::channels::Channels;
use super::decode::{self, PlanError, SUPPORTED};
use super::decoded::{Decoded, Readers, ReadersCache};
use super::episodes::{Common, Episodes};
use super::error::RecordingError;
use super::layout::{Layout, NATIVE_TOPIC};
use super::metadata::{self, Names};
use super::names;
use super::options::{OnDamage, ReadOptions};
use super::plan::Plan;
use super::records::op;
use super::scan::{Damage, Sink};
use super::source::{ChannelReader, CompileError, SetsAt};
use super::survey::{Survey, at_offset, file_name};
use super::tally::Tally;
use super::timeline::Output;
use super::wire::{Channel, Message, Metadata, Schema, WireError};

/// What is done with the messages of one channel of the current file.
enum Route {
    Unwanted,
    Wanted {
        source: usize,
        /// Made from the first message that can be read.
        reader: Option<Box<ChannelReader>>,
        /// Why none of its messages can be, where those of another channel of the topic can.
        refusal: Option<String>,
    },
}

/// The state of one recording while its records come in.
pub(crate) struct Ingest {
    options: ReadOptions,
    files: Vec<PathBuf>,
    /// The file that is being read.
    at: usize,
    channels: Channels,
    routes: Vec<(u16, Route)>,
    /// Encoding and messages of each topic, in the files before this one.
    topics: BTreeMap<String, (String, u64)>,
    survey: Option<Survey>,
    /// The recording is still being written: nothing but what came can be known.
    is_live: bool,
    pub(crate) plan: Option<Plan>,
    pub(crate) episodes: Episodes,
    pub(crate) tally: Tally,
    pub(crate) common: Common,
    pub(crate) n_messages: u64,
    /// Encodings of the chosen topics.
    pub(crate) encodings: Vec<String>,
    /// The first damage, as a sentence, and how many there were.
    pub(crate) damage: Option<(String, u64)>,
    names_known: bool,
    held: Vec<f64>,
    /// Copies of what reads the channels, for messages that are decoded before their turn.
    readers: ReadersCache,
    /// What was decoded so of the chunk whose records come in.
    decoded: Decoded,
}

impl Ingest {
    /// Begins, perhaps with what a survey of the whole recording found.
    pub(crate) fn with_survey(
        recording: Arc<str>,
        files: Vec<PathBuf>,
        options: &ReadOptions,
        survey: Option<Survey>,
    ) -> Self {
        Self {
            options: options.clone(),
            files,
            at: 0,
            channels: Channels::default(),
            routes: Vec::new(),
            topics: BTreeMap::new(),
            survey,
            is_live: false,
            plan: None,
            episodes: Episodes::new(options.limits, None),
            tally: Tally::default(),
            common: Common {
                recording,
                env_id: None,
                joint_names: None,
            },
            n_messages: 0,
            encodings: Vec::new(),
            damage: None,
            names_known: false,
            held: Vec::new(),
            readers: ReadersCache::default(),
            decoded: Decoded::default(),
        }
    }

    /// Begins with a recording that is still being written: episodes are given out as soon as they are complete.
    pub(crate) fn live(recording: Arc<str>, files: Vec<PathBuf>, options: &ReadOptions) -> Self {
        let mut live = Self::with_survey(recording, files, options, None);
        live.is_live = true;
        live.episodes.give_early();
        live
    }

    pub(crate) fn is_live(&self) -> bool {
        self.is_live
    }

    /// The next file of the recording begins: ids mean other things there.
    pub(crate) fn next_file(&mut self) {
        self.count_topics();
        self.at += 1;
        self.channels = Channels::default();
        self.routes.clear();
        self.readers.outdate();
    }

    fn count_topics(&mut self) {
        for (channel, n) in self.channels.counted() {
            let (_, count) = self
                .topics
                .entry(channel.topic.clone())
                .or_insert_with(|| (channel.encoding.clone(), 0));
            *count += n;
        }
    }

    fn set_names(&mut self, names: Names) {
        self.common.env_id = names.env_id;
        self.common.joint_names = names.joint_names;
    }

    /// Names may stand behind the messages; rows need them now.
    fn find_names(&mut self) {
        if std::mem::replace(&mut self.names_known, true) {
            return;
        }
        let limits = &self.options.limits;
        let found = self
            .files
            .iter()
            .find_map(|file| metadata::find(file, limits).ok().flatten());
        if let Some(names) = found {
            self.set_names(names);
        }
    }

    /// What cannot be told from one message: read it all.
    fn survey(&mut self) -> Result<&Survey, RecordingError> {
        let survey = match self.survey.take() {
            Some(survey) => survey,
            None if self.is_live => return Err(RecordingError::NotYet),
            None => Survey::of(&self.files, &self.options.limits)?,
        };
        Ok(self.survey.insert(survey))
    }

    /// Decides which topics are read, now that a message of `topic` has come.
    fn decide(&mut self, topic: &str) -> Result<(), RecordingError> {
        if self.plan.is_some() {
            return Ok(());
        }
        let options = self.options.clone();
        let layout = match Layout::asked_for(&options) {
            Some(layout) => layout,
            None if topic == NATIVE_TOPIC => Layout::native(&options),
            None => {
                Layout::choose(self.survey()?, &options).map_err(|undecided| undecided.error)?
            }
        };
        let mut plan = Plan::new(layout, &options);
        let loss = self.episodes.take_loss();
        self.episodes.set_rule(plan.rule);
        if let Some((loss, timeline)) = loss.as_deref().zip(plan.timeline.as_mut()) {
            timeline.loss(loss, 0);
        } else if let Some(loss) = loss {
            self.episodes.lose(&loss);
        }
        self.plan = Some(plan);
        Ok(())
    }

    /// The route of a channel; `None` if it is not wanted.
    fn route(&mut self, id: u16) -> Result<Option<usize>, RecordingError> {
        if let Some(index) = self.routes.iter().position(|(known, _)| *known == id) {
            let is_wanted = matches!(self.routes[index].1, Route::Wanted { .. });
            return Ok(is_wanted.then_some(index));
        }
        let Some(channel) = self.channels.channel(id).cloned() else {
            return Ok(None);
        };
        self.decide(&channel.topic)?;
        let source = self.plan.as_ref().and_then(|p| p.source_of(&channel.topic));
        let route = match source {
            None => Route::Unwanted,
            Some(source) => {
                if !self.encodings.contains(&channel.encoding) {
                    self.encodings.push(channel.encoding.clone());
                }
                if self.common.env_id.is_none() {
                    let env_id = channel.metadata.get("env_id");
                    self.common.env_id = env_id.map(|s| Arc::from(s.as_str()));
                }
                Route::Wanted {
                    source,
                    reader: None,
                    refusal: None,
                }
            }
        };
        self.routes.push((id, route));
        Ok(source.map(|_| self.routes.len() - 1))
    }

    fn message(&mut self, message: &Message<'_>, offset: u64) -> Result<(), RecordingError> {
        if !self.channels.count(message.channel_id) && !self.rescued(message.channel_id, offset)? {
            self.tally
                .note("message of a channel that is not defined", offset, 1);
            return Ok(());
        }
        self.find_names();
        let Some(route) = self.route(message.channel_id)? else {
            return Ok(());
        };
        self.n_messages += 1;
        self.compile(route, message)?;
        self.read(route, message, offset)
    }

    /// Is the channel defined in the summary, the data having lost its definition?
    fn rescued(&mut self, id: u16, offset: u64) -> Result<bool, RecordingError> {
        if self.is_live {
            // The summary is not there yet.
            return Err(RecordingError::NotYet);
        }
        // A recording that is to be whole or refused cannot be mended on the way.
        let is_there = self.options.on_damage == OnDamage::Recover
            && self
                .channels
                .rescue(&self.files[self.at], &self.options.limits)
            && self.channels.count(id);
        if is_there && self.damage.is_none() {
            // Where the definition was, messages may have been too.
            self.damage(Damage {
                cause: "definitions lost from the data",
                what: "a channel is defined in the summary alone, for the message",
                offset,
                loses_messages: true,
            })?;
        }
        Ok(is_there)
    }

    /// Makes what reads the channel of a route, if that is still to be done and this message shows how.
    fn compile(&mut self, route: usize, message: &Message<'_>) -> Result<(), RecordingError> {
        let (
            id,
            Route::Wanted {
                source,
                reader,
                refusal,
            },
        ) = &self.routes[route]
        else {
            return Ok(());
        };
        let (id, source) = (*id, *source);
        let Some(plan) = &self.plan else {
            return Ok(());
        };
        if reader.is_some() || refusal.is_some() || !plan.sources[source].is_decoded() {
            return Ok(());
        }
        let Some(channel) = self.channels.channel(id).cloned() else {
            return Ok(());
        };
        let schema = self.channels.schema(channel.schema_id).cloned();
        let is_read = plan.sources[source].is_read;
        let made = self.reader_of(source, &channel, schema.as_ref(), message.data);
        let (
            _,
            Route::Wanted {
                reader, refusal, ..
            },
        ) = &mut self.routes[route]
        else {
            return Ok(());
        };
        self.readers.outdate();
        match made {
            Ok(made) => *reader = made.map(Box::new),
            // A stray channel costs its own messages, not the recording.
            Err(e @ (RecordingError::Encoding { .. } | RecordingError::Plan { .. })) if is_read => {
                *refusal = Some(e.to_string());
            }
            Err(e) => return Err(e),
        }
        Ok(())
    }

    /// `None` where this message cannot be read, and the next may.
    fn reader_of(
        &mut self,
        source: usize,
        channel: &Channel,
        schema: Option<&Schema>,
        data: &[u8],
    ) -> Result<Option<ChannelReader>, RecordingError> {
        let fail = |e: PlanError| match e {
            PlanError::Encoding { encoding } => RecordingError::Encoding {
                topic: channel.topic.clone(),
                encoding,
                supported: SUPPORTED,
            },
            e => RecordingError::Plan {
                topic: channel.topic.clone(),
                what: e.to_string(),
            },
        };
        let example = match decode::example(channel, schema, data).map_err(CompileError::from) {
            Ok(example) => example,
            Err(CompileError::Message(_)) => return Ok(None),
            Err(CompileError::Plan(e)) => return Err(fail(e)),
        };
        let Some(plan) = &mut self.plan else {
            return Ok(None);
        };
        let topic = self.survey.as_ref().and_then(|s| s.topic(&channel.topic));
        let sets_of = topic.map(|topic| |path: &[decode::Access]| topic.name_sets(path));
        let sets = sets_of.as_ref().map(|f| f as SetsAt<'_>);
        let is_first = !plan.sources[source].is_read;
        let made = match plan.sources[source].compile(channel, schema, &example, sets) {
            Ok(made) => Some(made),
            Err(CompileError::Message(_)) => None,
            Err(CompileError::Plan(e)) => return Err(fail(e)),
        };
        plan.sources[source].fields = example.member_names();
        if let Some(names) = plan.action_names() {
            self.common.joint_names = Some(names);
        } else if let Some(names) = &self.common.joint_names
            && is_first
            && plan.actions_are_all_of(source)
            && let Some(names) = names::by_index(names, &plan.layout.actions, &example)
        {
            self.common.joint_names = Some(names.into());
        }
        Ok(made)
    }

    /// The recording is at its end: closes what is open.
    pub(crate) fn finish(&mut self) -> Result<(), RecordingError> {
        if let Some(Plan {
            timeline: Some(timeline),
            ..
        }) = &mut self.plan
        {
            let mut out = Output {
                episodes: &mut self.episodes,
                common: &self.common,
                tally: &mut self.tally,
            };
            timeline.finish(&mut out)?;
        }
        self.episodes.finish(&self.common, &mut self.tally);
        self.count_topics();
        self.require_topics()
    }

    /// Was there anything to read?
    fn require_topics(&mut self) -> Result<(), RecordingError> {
        if self.plan.is_none() && self.topics.contains_key(NATIVE_TOPIC) {
            // Defined, and without a message.
            self.decide(NATIVE_TOPIC)?;
        }
        let counts = &self.topics;
        let n_of = |topic: &str| counts.get(topic).map_or(0, |(_, n)| *n);
        let wanted = match &self.plan {
            Some(plan) => match plan.topics_needed().find(|topic| n_of(topic) == 0) {
                None => return Ok(()),
                Some(topic) => format!("no message on topic {topic:?}"),
            },
            None => match Layout::asked_for(&self.options) {
                Some(layout) => format!("no message on topic {:?}", layout.actions[0].topic()),
                None => format!("no topic {NATIVE_TOPIC:?} with steps of an agent"),
            },
        };
        let topics = counts
            .iter()
            .map(|(topic, (encoding, n))| (topic.as_str(), encoding.as_str(), *n))
            .collect::<Vec<_>>();
        let damage = self
            .damage
            .as_ref()
            .map_or(String::new(), |(what, _)| format!("; {what}"));
        Err(RecordingError::NothingToRead {
            wanted,
            found: super::survey::describe(topics.into_iter()) + &damage,
        })
    }

    fn schema(&mut self, schema: Schema, offset: u64) {
        if let Err(e) = self.channels.add_schema(schema) {
            self.tally.note(&e.what, offset, 1);
        }
    }

    fn channel(&mut self, channel: Channel, offset: u64) {
        if let Err(e) = self.channels.add_channel(channel) {
            self.tally.note(&e.what, offset, 1);
        }
    }
}

impl Sink for Ingest {
    fn record(&mut self, opcode: u8, body: &[u8], offset: u64) -> Result<(), RecordingError> {
        let result = match opcode {
            op::SCHEMA => Schema::parse(body).map(|schema| self.schema(schema, offset)),
            op::CHANNEL => Channel::parse(body).map(|channel| self.channel(channel, offset)),
            op::MESSAGE => {
                self.decoded.pass();
                match Message::parse(body) {
                    Ok(message) => return self.message(&message, offset),
                    Err(e) => Err(e),
                }
            }
            op::METADATA => Metadata::parse(body).map(|record| {
                if !self.names_known
                    && let Some(names) = Names::of(&record)
                {
                    self.names_known = true;
                    self.set_names(names);
                }
            }),
            _ => Ok(()),
        };
        result.or_else(|e: WireError| {
            self.damage(Damage {
                cause: "record that cannot be read",
                what: &format!("{} record {e}", name(opcode)),
                offset,
                loses_messages: true,
            })
        })
    }

    /// Those of all channels that were made; none before the first, which must be read to make it.
    fn readers(&mut self) -> Option<Arc<Readers>> {
        let plan = self.plan.as_ref()?;
        let (routes, knows_all_names) = (&self.routes, self.survey.is_some());
        let readers = self.readers.get(|version| Readers {
            version,
            knows_all_names,
            channels: routes
                .iter()
                .filter_map(|(id, route)| match route {
                    Route::Wanted {
                        source,
                        reader: Some(reader),
                        ..
                    } => Some((*id, plan.sources[*source].clone(), (**reader).clone())),
                    _ => None,
                })
                .collect(),
        });
        Some(readers)
    }

    fn exchange(&mut self, decoded: &mut Decoded) {
        std::mem::swap(&mut self.decoded, decoded);
    }

    /// Notes damage: it is counted by cause, described once, and steps may have been lost.
    fn damage(&mut self, damage: Damage<'_>) -> Result<(), RecordingError> {
        let Damage {
            cause,
            what,
            offset,
            loses_messages,
        } = damage;
        self.tally.note(cause, offset, 1);
        let file = (self.files.len() > 1).then(|| file_name(&self.files[self.at]));
        let description = at_offset(what, offset, file.as_deref());
        if self.options.on_damage == OnDamage::Fail {
            return Err(RecordingError::Damaged(description));
        }
        if loses_messages {
            match &mut self.plan {
                Some(Plan {
                    timeline: Some(timeline),
                    ..
                }) => timeline.loss(&description, offset),
                _ => self.episodes.lose(&description),
            }
        }
        match &mut self.damage {
            Some((_, n)) => *n += 1,
            none => *none = Some((description, 1)),
        }
        Ok(())
    }
}

/// What a record is called in messages.
pub(crate) fn name(opcode: u8) -> &'static str {
    match opcode {
        op::SCHEMA => "schema",
        op::CHANNEL => "channel",
        op::MESSAGE => "message",
        op::METADATA => "metadata",
        _ => "unknown",
    }
}
