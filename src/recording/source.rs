//! One topic of a recording: which of its numbers are taken, and how they are ordered by the names they carry.

use std::collections::BTreeSet;
use std::sync::Arc;

use thiserror::Error;

use super::decode::{
    ABSENT, Access, DecodeError, Decoder, ExampleError, Field, Names, PlanError, Row, RowId,
    Target, Value, Wanted, is_absent,
};
use super::names::{self, NameSets, NamesAt, names_of};
use super::plan::{END_FIELDS, ID_FIELDS, Use};
use super::selector::{PathPart, Selector};
use super::wire::{Channel, Schema};

/// What the values of a selector are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    Action,
    State,
}

impl Role {
    pub(crate) fn label(self) -> &'static str {
        match self {
            Self::Action => "action",
            Self::State => "state",
        }
    }
}

/// What a topic is asked for besides values.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each asks for something else"
)]
pub(crate) struct Extras {
    /// Step numbers and rewards, by their usual names.
    pub(crate) numbers: bool,
    /// Episode ids, by their usual names.
    pub(crate) ids: bool,
    /// End flags, by their usual names.
    pub(crate) flags: bool,
    /// The episode's id stands here.
    pub(crate) id: Option<Selector>,
    /// The end flag stands here.
    pub(crate) done: Option<Selector>,
    /// The message's own time counts.
    pub(crate) stamp: bool,
}

/// One topic that is read.
#[derive(Debug, Clone)]
pub(crate) struct Source {
    pub(crate) topic: String,
    /// Selectors with their roles: all actions first.
    pub(crate) takes: Vec<(Role, Selector)>,
    pub(crate) extras: Extras,
    pub(crate) uses: Vec<Use>,
    /// Members of its messages, for errors.
    pub(crate) fields: Vec<String>,
    pub(crate) row: Row,
    /// The values of the last message, selector after selector.
    pub(crate) values: Vec<f64>,
    /// Where the values of each selector end in `values`.
    pub(crate) ends: Vec<usize>,
    /// Joints are shared out among the messages: each holds its latest value.
    pub(crate) holds: bool,
    /// A message has other names than the first: only all messages together tell how they share the joints.
    pub(crate) has_other_names: bool,
    /// A message of it could be read.
    pub(crate) is_read: bool,
    /// What the first message of the topic says of the names of each selector.
    first_names: Vec<FirstNames>,
    /// What the values of each selector are called, once known.
    pub(crate) names: Vec<Option<Arc<[Arc<str>]>>>,
}

/// The names that a first message has: every channel of its topic, in every file, is ordered by them.
#[derive(Debug, Clone)]
struct FirstNames {
    /// Those of the selector's values; empty where the message names none.
    of_values: Vec<String>,
    /// All of them.
    all: Vec<String>,
}

/// How the messages of one channel are read.
#[derive(Debug, Clone)]
pub(crate) struct ChannelReader {
    decoder: Decoder,
    /// Targets of its rows: what each is for, and how many values it gets at least.
    targets: Vec<(&'static str, usize)>,
    binds: Vec<Bind>,
}

/// How the values of one selector come out of the row.
#[derive(Debug, Clone)]
enum Bind {
    /// As they are.
    All {
        target: usize,
        /// The first message had a list of names that was not one of these values: it was empty, or of something
        /// else. Others may tell.
        may_be_named: bool,
    },
    /// Ordered by name.
    Named {
        target: usize,
        names: Vec<String>,
        /// The names of the first message, as long as not all are known.
        known: Option<Vec<String>>,
        /// The message must have all of them.
        strict: bool,
        /// Each value comes with its own name, message by message.
        in_objects: bool,
        cache: Permutation,
    },
}

/// Where each wanted name stands in messages with the names `of`.
#[derive(Debug, Clone, Default)]
struct Permutation {
    of: Names,
    places: Vec<Option<usize>>,
}

/// Why a channel cannot be read, or not by this message.
#[derive(Debug, Error)]
pub(crate) enum CompileError {
    /// No message of the channel can.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// This one cannot.
    #[error(transparent)]
    Message(#[from] DecodeError),
}

impl From<ExampleError> for CompileError {
    fn from(e: ExampleError) -> Self {
        match e {
            ExampleError::Plan(e) => Self::Plan(e),
            ExampleError::Message(e) => Self::Message(e),
        }
    }
}

/// Finds the names that messages carry under a path.
pub(crate) type SetsAt<'a> = &'a dyn Fn(&[Access]) -> NameSets;

/// A selector resolved against a message: what to decode, and how to pick from it.
struct Resolved {
    values: Vec<Access>,
    names: Option<NamesAt>,
    pick: Option<String>,
}

impl Source {
    pub(crate) fn new(topic: &str) -> Self {
        Self {
            topic: topic.to_owned(),
            takes: Vec::new(),
            extras: Extras::default(),
            uses: Vec::new(),
            fields: Vec::new(),
            row: Row::default(),
            values: Vec::new(),
            ends: Vec::new(),
            holds: false,
            has_other_names: false,
            is_read: false,
            first_names: Vec::new(),
            names: Vec::new(),
        }
    }

    /// Must its messages be looked into?
    pub(crate) fn is_decoded(&self) -> bool {
        !self.takes.is_empty() || self.extras != Extras::default()
    }

    /// Why nothing could be made that reads a message.
    pub(crate) fn why_not(
        &self,
        channel: &Channel,
        schema: Option<&Schema>,
        data: &[u8],
    ) -> DecodeError {
        let resolved = super::decode::example(channel, schema, data)
            .map_err(CompileError::from)
            .and_then(|example| {
                self.takes
                    .iter()
                    .try_for_each(|(role, s)| resolve(*role, s, &example).map(|_| ()))
            });
        match resolved {
            Err(CompileError::Message(e)) => e,
            _ => DecodeError::Missing("action or state"),
        }
    }

    /// Makes what reads a channel. `sets` finds the names that all messages of this topic have under a path; where
    /// that is not known, those of the example count, and a message with others is told of.
    pub(crate) fn compile(
        &mut self,
        channel: &Channel,
        schema: Option<&Schema>,
        example: &Value,
        sets: Option<SetsAt<'_>>,
    ) -> Result<ChannelReader, CompileError> {
        let mut wanted: Vec<Wanted> = Vec::new();
        let mut labels: Vec<(&'static str, usize)> = Vec::new();
        let mut targets: Vec<Vec<Access>> = Vec::new();
        let mut binds = Vec::new();
        let mut names = Vec::new();
        for (nth, (role, selector)) in self.takes.iter().enumerate() {
            let resolved = resolve(*role, selector, example)?;
            let known = targets.iter().position(|path| *path == resolved.values);
            // Selectors that pick by name from one array share its values.
            let target = known
                .filter(|_| resolved.pick.is_some())
                .unwrap_or_else(|| {
                    let min_len = fewest_values(&resolved.values);
                    labels.push((role.label(), min_len));
                    targets.push(resolved.values.clone());
                    let target = targets.len() - 1;
                    wanted.push(want(&resolved.values, Field::Values(target), true));
                    if let Some(names) = &resolved.names {
                        wanted.push(want(&names.path, Field::Names(target), false));
                    }
                    target
                });
            let sets_at = |path: &[Access]| match sets {
                Some(sets) if !sets(path).first().is_empty() => sets(path),
                _ => NameSets::of(example, path),
            };
            if let Some(missing) = resolved.missing_name(&sets_at) {
                if sets.is_some() {
                    let what = format!("{selector}: {missing}");
                    return Err(CompileError::Plan(PlanError::Path(what)));
                }
                // Another message may have it.
                self.has_other_names = true;
            }
            let mut bind = bind_values(
                &resolved,
                target,
                example,
                &sets_at,
                sets.is_some(),
                &mut self.holds,
            );
            if sets.is_none() {
                match self.first_names.get(nth) {
                    Some(first) => bind.take_over(first),
                    None => self.first_names.push(bind.first_names()),
                }
            }
            names.push(bind.names());
            binds.push(bind);
        }
        self.names = names;
        self.extras.want(&mut wanted, example)?;
        let decoder = Decoder::compile(channel, schema, &wanted, example)?;
        self.is_read = true;
        Ok(ChannelReader {
            decoder,
            targets: labels,
            binds,
        })
    }

    /// Decodes one message into `row` and `values`. A value that its names do not hold is [`ABSENT`].
    pub(crate) fn read(
        &mut self,
        reader: &mut ChannelReader,
        data: &[u8],
    ) -> Result<(), DecodeError> {
        self.values.clear();
        self.ends.clear();
        if !self.row.has_targets(&reader.targets) {
            self.row = Row::with_targets(&reader.targets);
        }
        reader.decoder.decode(data, &mut self.row)?;
        // Asked for by name: a message without it, or a name mistyped, must not pass for "false" or "as before".
        if self.extras.id.is_some() && self.row.id == RowId::None {
            return Err(DecodeError::Missing("episode"));
        }
        if self.extras.done.is_some() && !self.row.has_end_field {
            return Err(DecodeError::Missing("the end flag"));
        }
        for (bind, (role, _)) in reader.binds.iter_mut().zip(&self.takes) {
            let is_like_first = bind.append(&mut self.row, role.label(), &mut self.values)?;
            self.has_other_names |= !is_like_first;
            self.ends.push(self.values.len());
        }
        Ok(())
    }

    /// Episodes are given out that the first message's names ordered: a message that lacks one is bad from here on.
    pub(crate) fn keep_first_names(&mut self, reader: &mut ChannelReader) {
        self.has_other_names = false;
        reader.binds.iter_mut().for_each(Bind::keep_first_names);
    }

    /// How many of `values` are of actions; the rest are of states.
    pub(crate) fn n_action_values(&self) -> usize {
        let n_actions = self
            .takes
            .iter()
            .take_while(|(role, _)| *role == Role::Action)
            .count();
        n_actions.checked_sub(1).map_or(0, |last| self.ends[last])
    }
}

impl Resolved {
    /// What is wrong, if the selector picks by a name that no message has.
    fn missing_name(&self, sets: SetsAt<'_>) -> Option<String> {
        let (pick, at) = (self.pick.as_ref()?, self.names.as_ref()?);
        let names = sets(&at.path).union();
        let is_missing = !names.is_empty() && !names.contains(pick);
        is_missing.then(|| format!("no message names {pick:?}, they name {}", names.join(", ")))
    }
}

fn want(path: &[Access], field: Field, required: bool) -> Wanted {
    Wanted {
        path: path.to_vec(),
        field,
        required,
    }
}

/// How many values a path must give at least: as many as it asks for by index.
fn fewest_values(path: &[Access]) -> usize {
    match path.last() {
        Some(Access::Items(range)) => range.len(),
        _ => 1,
    }
}

/// Numbers at and below a value.
fn n_leaves(value: &Value) -> usize {
    match value {
        Value::Bool(_) | Value::Integer(_) | Value::Number(_) => 1,
        Value::Bytes(bytes) => bytes.len(),
        Value::List(items) => items.iter().map(n_leaves).sum(),
        Value::Map(members) => members.iter().map(|(_, member)| n_leaves(member)).sum(),
        Value::Null | Value::Text(_) => 0,
    }
}

/// Decides how a selector's values are ordered.
fn bind_values(
    resolved: &Resolved,
    target: usize,
    example: &Value,
    sets: SetsAt<'_>,
    is_final: bool,
    holds: &mut bool,
) -> Bind {
    let Some(at) = &resolved.names else {
        return Bind::All {
            target,
            may_be_named: false,
        };
    };
    let sets = sets(&at.path);
    let n_names = sets.first().len();
    let are_of_others =
        !is_final && !at.in_objects && n_names != example.at(&resolved.values).map_or(0, n_leaves);
    if resolved.pick.is_none() && (n_names == 0 || are_of_others) {
        return Bind::All {
            target,
            may_be_named: !is_final,
        };
    }
    let strict = !at.in_objects && !sets.are_shared_out();
    *holds |= !strict;
    let names = match &resolved.pick {
        Some(name) => vec![name.clone()],
        None if strict => sets.first().to_vec(),
        None => sets.union(),
    };
    Bind::Named {
        target,
        known: (!is_final).then(|| sets.union()),
        names,
        strict,
        in_objects: at.in_objects,
        cache: Permutation::default(),
    }
}

/// Turns a selector into paths, with a message that shows what stands where.
fn resolve(role: Role, selector: &Selector, example: &Value) -> Result<Resolved, CompileError> {
    let mut values: Vec<Access> = Vec::new();
    let mut pick = None;
    let fail = |what: String| CompileError::Plan(PlanError::Path(format!("{selector}: {what}")));
    for part in selector.path() {
        match part {
            PathPart::Key(key) => values.push(Access::Key(key.clone())),
            PathPart::Index(index) => values.push(Access::Items(*index..index + 1)),
            PathPart::Items { start, end } => values.push(Access::Items(*start..*end)),
            PathPart::Name(name) => match example.at(&values) {
                Some(Value::Map(_)) => values.push(Access::Key(name.clone())),
                _ if pick.is_some() => return Err(fail("two names in one selector".to_owned())),
                _ => pick = Some(name.clone()),
            },
        }
    }
    if names::is_below_nothing(example, &values) {
        // What its elements hold, and that they have names, the next message may tell.
        return Err(DecodeError::Empty(role.label()).into());
    }
    let names = names_of(example, &values);
    if let Some(name) = &pick
        && names.is_none()
    {
        return match example.at(&values) {
            // A schema would have told; here the next message may.
            None => Err(DecodeError::Missing(role.label()).into()),
            Some(_) => Err(fail(format!(
                "[{name}] picks by name, and the message has no list of names (name, names, joint_names) for it"
            ))),
        };
    }
    Ok(Resolved {
        values,
        names,
        pick,
    })
}

impl Extras {
    /// Adds the fields besides values.
    fn want(&self, wanted: &mut Vec<Wanted>, example: &Value) -> Result<(), CompileError> {
        let key = |name: &str| vec![Access::Key(name.to_owned())];
        if let Some(selector) = &self.id {
            let path = resolve(Role::State, selector, example)?.values;
            wanted.push(want(&path, Field::Episode { rank: 0 }, true));
        }
        if let Some(selector) = &self.done {
            let path = resolve(Role::State, selector, example)?.values;
            wanted.push(want(&path, Field::EndFlag, true));
        }
        if self.ids {
            for (rank, name) in (0..).zip(ID_FIELDS) {
                wanted.push(want(&key(name), Field::Episode { rank }, false));
            }
        }
        if self.flags {
            for name in END_FIELDS {
                wanted.push(want(&key(name), Field::EndFlag, false));
            }
        }
        if self.numbers {
            wanted.push(want(&key("step"), Field::Step, false));
            wanted.push(want(&key("reward"), Field::Reward, false));
        }
        if self.stamp && !stamp_fields(wanted, example) {
            let what = "--clock header, and its messages have no stamp in seconds and nanoseconds \
                        (header.stamp, timestamp, stamp)";
            return Err(CompileError::Plan(PlanError::Path(what.to_owned())));
        }
        Ok(())
    }
}

/// The message's own time: ROS headers, and the time stamps of Foxglove and protobuf. False if it has none.
fn stamp_fields(wanted: &mut Vec<Wanted>, example: &Value) -> bool {
    let stamps: [&[&str]; 3] = [&["header", "stamp"], &["timestamp"], &["stamp"]];
    for stamp in stamps {
        let path: Vec<Access> = stamp.iter().map(|k| Access::Key((*k).to_owned())).collect();
        let Some(value) = example.at(&path) else {
            continue;
        };
        let n_wanted = wanted.len();
        for (name, field) in [
            ("sec", Field::StampSeconds),
            ("secs", Field::StampSeconds),
            ("seconds", Field::StampSeconds),
            ("nanosec", Field::StampNanos),
            ("nsec", Field::StampNanos),
            ("nsecs", Field::StampNanos),
            ("nanos", Field::StampNanos),
        ] {
            if value.get(name).is_some() {
                let mut path = path.clone();
                path.push(Access::Key(name.to_owned()));
                wanted.push(want(&path, field, false));
            }
        }
        // A number or a text by that name has no unit that could be known.
        if wanted.len() > n_wanted {
            return true;
        }
    }
    false
}

impl Bind {
    fn names(&self) -> Option<Arc<[Arc<str>]>> {
        match self {
            Self::All { .. } => None,
            Self::Named { names, .. } => {
                Some(names.iter().map(|n| Arc::from(n.as_str())).collect())
            }
        }
    }

    fn first_names(&self) -> FirstNames {
        match self {
            Self::All { .. } => FirstNames {
                of_values: Vec::new(),
                all: Vec::new(),
            },
            Self::Named { names, known, .. } => FirstNames {
                of_values: names.clone(),
                all: known.clone().unwrap_or_default(),
            },
        }
    }

    /// Orders by the names of the topic's first message, which was one of another channel.
    fn take_over(&mut self, first: &FirstNames) {
        if let Self::All {
            target,
            may_be_named: true,
        } = *self
            && !first.of_values.is_empty()
        {
            *self = Self::Named {
                target,
                names: first.of_values.clone(),
                known: Some(first.all.clone()),
                strict: true,
                in_objects: false,
                cache: Permutation::default(),
            };
        }
        if let Self::Named { names, known, .. } = self
            && known.is_some()
        {
            if !first.of_values.is_empty() {
                names.clone_from(&first.of_values);
            }
            *known = Some(first.all.clone());
        }
    }

    fn keep_first_names(&mut self) {
        match self {
            Self::All { may_be_named, .. } => *may_be_named = false,
            Self::Named {
                known,
                strict,
                in_objects,
                cache,
                ..
            } => {
                *known = None;
                *strict |= !*in_objects;
                *cache = Permutation::default();
            }
        }
    }

    /// Appends the values of a message; false if it has other names than the first, and not all are known yet.
    fn append(
        &mut self,
        row: &mut Row,
        label: &'static str,
        values: &mut Vec<f64>,
    ) -> Result<bool, DecodeError> {
        match self {
            Self::All {
                target,
                may_be_named,
            } => {
                let Target {
                    values: taken,
                    names,
                    ..
                } = &mut row.targets[*target];
                if *may_be_named && names.len() == taken.len() {
                    return Ok(false);
                }
                // All are looked at, whatever comes first: that becomes vector instructions.
                if taken.iter().fold(false, |any, &v| any | is_absent(v)) {
                    return Err(DecodeError::Missing(label));
                }
                if values.is_empty() {
                    std::mem::swap(values, taken);
                } else {
                    values.extend_from_slice(taken);
                }
            }
            Self::Named {
                target,
                names,
                known,
                strict,
                cache,
                ..
            } => {
                let target = &row.targets[*target];
                if target.names.len() != target.values.len() {
                    return Err(DecodeError::WrongType(format!(
                        "{label} does not have as many names as values"
                    )));
                }
                if cache.of != target.names || cache.places.len() != names.len() {
                    cache.learn(names, &target.names)?;
                    if known.as_ref().is_some_and(|k| !target.names.are(k)) {
                        return Ok(false);
                    }
                }
                if *strict && cache.places.iter().any(Option::is_none) {
                    return Err(DecodeError::WrongType(format!("{label} lacks a joint")));
                }
                values.extend(
                    cache
                        .places
                        .iter()
                        .map(|place| place.map_or(ABSENT, |i| target.values[i])),
                );
            }
        }
        Ok(true)
    }
}

impl Permutation {
    fn learn(&mut self, wanted: &[String], found: &Names) -> Result<(), DecodeError> {
        let mut seen = BTreeSet::new();
        if !found.iter().all(|name| seen.insert(name)) {
            return Err(DecodeError::WrongType("a joint is named twice".to_owned()));
        }
        self.places = wanted
            .iter()
            .map(|name| found.iter().position(|n| n == name))
            .collect();
        self.of.clone_from(found);
        Ok(())
    }
}
