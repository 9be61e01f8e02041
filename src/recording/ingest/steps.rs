//! What becomes of a message of a wanted channel: a step by itself, or something on the timeline.

use std::ops::Range;

use super::super::decode::{self, DecodeError};
use super::super::error::RecordingError;
use super::super::options::Clock;
use super::super::plan::{Plan, Use};
use super::super::source::Source;
use super::super::step::{IdRef, Meta, Place, Step};
use super::super::timeline::{At, BEFORE_ALL_JOINTS, Output, Timeline};
use super::super::wire::Message;
use super::{Ingest, Route};

const WITHOUT_TIME: &str = "message without a time that can be used";

/// Where the values of a message are, if it was decoded before its turn; and whether it could be decoded.
type Decoding = (Option<Range<usize>>, Result<(), DecodeError>);

impl Ingest {
    /// Reads one message of a wanted channel.
    pub(super) fn read(
        &mut self,
        route: usize,
        message: &Message<'_>,
        offset: u64,
    ) -> Result<(), RecordingError> {
        let Route::Wanted { source: index, .. } = self.routes[route].1 else {
            return Ok(());
        };
        let (ahead, result) = self.decode(route, message)?;
        let Some(plan) = &mut self.plan else {
            return Ok(());
        };
        let source = &mut plan.sources[index];
        let logged = match self.options.clock {
            Clock::Log => i64::try_from(message.log_time).ok(),
            Clock::Publish => i64::try_from(message.publish_time).ok(),
            Clock::Header if result.is_ok() => source.row.stamp(),
            Clock::Header => None,
        };
        let result = match result {
            Ok(()) if logged.is_none() && self.options.clock == Clock::Header => {
                Err(WITHOUT_TIME.to_owned())
            }
            result => result.map_err(|e| e.to_string()),
        };
        let place = Place {
            offset,
            time: logged,
        };
        let is_timed = plan.timeline.is_some();
        // The values stay where they are, in a buffer that goes back when they are taken.
        let buffer = if ahead.is_some() {
            std::mem::take(&mut self.decoded.values)
        } else {
            std::mem::take(&mut source.values)
        };
        let values = match &ahead {
            Some(taken) => &buffer[taken.clone()],
            None => &buffer,
        };
        let outcome = if is_timed {
            self.timed(index, values, place, result)
        } else {
            self.direct(index, values, place, result)
        };
        if ahead.is_some() {
            self.decoded.values = buffer;
        } else if let Some(plan) = &mut self.plan {
            plan.sources[index].values = buffer;
        }
        outcome
    }

    /// Decodes one message into its source, or takes what was decoded of it before its turn: then it says where among
    /// `self.decoded.values` its values are.
    fn decode(&mut self, route: usize, message: &Message<'_>) -> Result<Decoding, RecordingError> {
        let (
            Some(plan),
            (
                _,
                Route::Wanted {
                    source,
                    reader,
                    refusal,
                },
            ),
        ) = (&mut self.plan, &mut self.routes[route])
        else {
            return Ok((None, Ok(())));
        };
        let source = &mut plan.sources[*source];
        let Some(reader) = reader else {
            let result = match self.channels.channel(message.channel_id) {
                Some(channel) if source.is_decoded() => {
                    // What another channel's message of the topic said is not this one's.
                    source.row.clear();
                    let schema = self.channels.schema(channel.schema_id);
                    Err(match refusal {
                        Some(refusal) => DecodeError::WrongType(refusal.clone()),
                        None => source.why_not(channel, schema, message.data),
                    })
                }
                _ => Ok(()),
            };
            return Ok((None, result));
        };
        if let Some(values) = self.decoded.take(self.readers.version(), source) {
            return Ok((Some(values), Ok(())));
        }
        let result = source.read(reader, message.data);
        if !source.has_other_names || self.survey.is_some() {
            return Ok((None, result));
        }
        if self.episodes.n_given() == 0 {
            return Err(RecordingError::OtherNames);
        }
        source.keep_first_names(reader);
        self.readers.outdate();
        Ok((None, source.read(reader, message.data)))
    }

    /// A message that is a whole step by itself.
    fn direct(
        &mut self,
        source: usize,
        values: &[f64],
        place: Place,
        result: Result<(), String>,
    ) -> Result<(), RecordingError> {
        let Some(plan) = &mut self.plan else {
            return Ok(());
        };
        let source = &mut plan.sources[source];
        let meta = Meta::of(&source.row);
        if let Err(cause) = result {
            self.episodes
                .bad(meta, &cause, place, &self.common, &mut self.tally);
            return Ok(());
        }
        let split = source.n_action_values();
        let values = if source.holds {
            if !hold(&mut self.held, values) {
                self.tally.refuse(BEFORE_ALL_JOINTS, place.offset);
                self.episodes.drop_step(meta, &self.common, &mut self.tally);
                return Ok(());
            }
            &self.held
        } else {
            values
        };
        let (action, state) = values.split_at(split);
        let step = Step {
            action,
            state,
            meta,
            place,
        };
        self.episodes.push(&step, &self.common, &mut self.tally)
    }

    /// A message that must be put in the order of time, and on the clock of the actions.
    fn timed(
        &mut self,
        index: usize,
        values: &[f64],
        place: Place,
        result: Result<(), String>,
    ) -> Result<(), RecordingError> {
        let Some(Plan {
            sources,
            timeline: Some(timeline),
            may_hold_all,
            ..
        }) = &mut self.plan
        else {
            return Ok(());
        };
        let source = &mut sources[index];
        let meta = Meta::of(&source.row);
        let is_clock = source.uses.contains(&Use::Clock);
        let result = result.and_then(|()| match place.time {
            Some(_) => Ok(()),
            None => Err(WITHOUT_TIME.to_owned()),
        });
        let at = At {
            time: place.time.unwrap_or_else(|| timeline.newest()),
            offset: place.offset,
            counts: !is_clock,
        };
        if let Err(cause) = result {
            if is_clock {
                timeline.bad_action(meta, &cause, at);
            } else {
                self.tally.refuse(&cause, place.offset);
                timeline.bad_held(index, at);
            }
            return Ok(());
        }
        if is_clock && *may_hold_all {
            if meta.id != IdRef::None || meta.has_end_flag {
                timeline.hold_less();
            }
            *may_hold_all = false;
        }
        if source.uses.contains(&Use::Held) && !timeline.fits(index, &source.ends) {
            let cause = "state has another width than in its first message";
            self.tally.refuse(cause, place.offset);
            timeline.bad_held(index, at);
        } else {
            put(timeline, index, source, values, at);
        }
        let mut out = Output {
            episodes: &mut self.episodes,
            common: &self.common,
            tally: &mut self.tally,
        };
        timeline.settle(&mut out)
    }
}

/// Puts a message of a source on the timeline, for each of its uses.
fn put(timeline: &mut Timeline, index: usize, source: &Source, values: &[f64], mut at: At) {
    let meta = Meta::of(&source.row);
    for used in &source.uses {
        match used {
            Use::Marker => timeline.marker(at),
            Use::Done if source.row.ended => timeline.done(at),
            Use::Done if at.counts => timeline.of_use(),
            Use::Done => {}
            Use::Id => timeline.id(meta.id, at),
            Use::Held => timeline.held(index, values, source.holds, at),
            Use::Clock => {
                if !timeline.action(meta, values, &source.ends, source.holds, at) {
                    let cause = "action has another width than in its first message";
                    timeline.bad_action(meta, cause, at);
                }
            }
        }
        // One message counts once, however many uses it has.
        at.counts = false;
    }
}

/// Puts the values that are there over those that were; false while some never came.
fn hold(held: &mut Vec<f64>, values: &[f64]) -> bool {
    if held.len() != values.len() {
        *held = vec![decode::ABSENT; values.len()];
    }
    for (held, &value) in held.iter_mut().zip(values) {
        if !decode::is_absent(value) {
            *held = value;
        }
    }
    !held.iter().any(|&v| decode::is_absent(v))
}
