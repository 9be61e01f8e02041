//! Collects steps into episodes, closes them, and gives them out in the order in which they first appeared.
//!
//! The rules (which field ends an episode, what a bad step does, what becomes of a message for a closed id) are the
//! section "Recordings and episodes" of the README; `open_episode.rs` holds what happens inside one episode.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::closed_ids::ClosedIds;
use super::error::RecordingError;
use super::limits::Limits;
use super::open_episode::{Closed, OpenEpisode};
use super::step::{IdRef, Meta, Place, Step};
use super::tally::Tally;
use crate::model::{Episode, EpisodeKey};

/// What all episodes of one recording share.
#[derive(Debug, Clone)]
pub(crate) struct Common {
    pub(crate) recording: Arc<str>,
    pub(crate) env_id: Option<Arc<str>>,
    pub(crate) joint_names: Option<Arc<[Arc<str>]>>,
}

/// Where episodes begin and end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum EpisodeRule {
    /// By the id that each message carries.
    Id,
    /// After each message whose end flag is true.
    EndFlag,
    /// The recording is one episode.
    Recording,
    /// Where the timeline cuts: at markers, pauses, flags of other topics.
    Cut,
}

impl EpisodeRule {
    /// Does an end flag in a message of the action end its episode?
    fn ends_by_flag(self) -> bool {
        matches!(self, Self::Id | Self::EndFlag)
    }
}

/// The id of an episode, owned.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Id {
    /// No id is logged; the order of appearance stands for it.
    Nth(u64),
    Integer(i64),
    Text(Arc<str>),
}

impl Id {
    fn is(&self, logged: IdRef<'_>) -> bool {
        match (self, logged) {
            (Self::Integer(id), IdRef::Integer(other)) => *id == other,
            (Self::Text(id), IdRef::Text(other)) => **id == *other,
            _ => false,
        }
    }

    fn of(logged: IdRef<'_>) -> Option<Self> {
        match logged {
            IdRef::None => None,
            IdRef::Integer(id) => Some(Self::Integer(id)),
            IdRef::Text(id) => Some(Self::Text(Arc::from(id))),
        }
    }
}

struct Open {
    id: Id,
    /// Order of appearance.
    nth: u64,
    last_fed: u64,
    episode: OpenEpisode,
}

/// The episodes of one recording, while it is read.
pub(crate) struct Episodes {
    rule: Option<EpisodeRule>,
    limits: Limits,
    open: Vec<Open>,
    closed: ClosedIds,
    /// Closed, but an episode that appeared earlier is still open.
    waiting: BTreeMap<u64, (Id, Closed)>,
    n_appeared: u64,
    n_given: u64,
    clock: u64,
    /// Why the beginning of the next new episode may be missing.
    loss: Option<String>,
    n_used: u64,
    /// Steps of the episode that closed last.
    n_last: usize,
    /// Steps that were dropped before the next episode opens.
    n_dropped: u64,
    ready: Vec<(u64, Episode)>,
    /// Episodes do not wait for those that appeared before them.
    gives_early: bool,
}

impl Episodes {
    /// Without a rule, the first message decides: by its id, else its end flag, else the recording.
    pub(crate) fn new(limits: Limits, rule: Option<EpisodeRule>) -> Self {
        Self {
            rule,
            limits,
            open: Vec::new(),
            closed: ClosedIds::default(),
            waiting: BTreeMap::new(),
            n_appeared: 0,
            n_given: 0,
            clock: 0,
            loss: None,
            n_used: 0,
            n_last: 0,
            n_dropped: 0,
            ready: Vec::new(),
            gives_early: false,
        }
    }

    /// Gives episodes out in the order in which they close.
    pub(crate) fn give_early(&mut self) {
        self.gives_early = true;
    }

    /// Before the first message. What was lost until now stays lost.
    pub(crate) fn set_rule(&mut self, rule: Option<EpisodeRule>) {
        self.rule = rule;
    }

    pub(crate) fn rule(&self) -> Option<EpisodeRule> {
        self.rule
    }

    /// Messages that became steps of episodes given out so far.
    pub(crate) fn n_used(&self) -> u64 {
        self.n_used
    }

    /// Episodes given out so far.
    pub(crate) fn n_given(&self) -> u64 {
        self.n_given
    }

    /// Takes the closed episodes whose turn it is, each with its place in the order of appearance.
    pub(crate) fn take_ready(&mut self) -> Vec<(u64, Episode)> {
        std::mem::take(&mut self.ready)
    }

    /// Adds one step, or refuses it.
    pub(crate) fn push(
        &mut self,
        step: &Step<'_>,
        common: &Common,
        tally: &mut Tally,
    ) -> Result<(), RecordingError> {
        let Step { meta, place, .. } = *step;
        let rule = *self.rule.get_or_insert(match meta {
            Meta {
                id: IdRef::Integer(_) | IdRef::Text(_),
                ..
            } => EpisodeRule::Id,
            Meta {
                has_end_flag: true, ..
            } => EpisodeRule::EndFlag,
            _ => EpisodeRule::Recording,
        });
        if rule == EpisodeRule::Id && meta.id == IdRef::None {
            self.bad(meta, "episode is missing", place, common, tally);
            return Ok(());
        }
        let Some(index) = self.find_or_open(meta, rule, place, common, tally) else {
            return Ok(());
        };
        let open = &mut self.open[index];
        open.episode.push(step, tally);
        if open.episode.bytes() > self.limits.max_episode {
            let episode = match &open.id {
                Id::Nth(n) => n.to_string(),
                Id::Integer(id) => id.to_string(),
                Id::Text(id) => id.to_string(),
            };
            return Err(RecordingError::EpisodeTooLarge {
                episode,
                limit: self.limits.max_episode,
            });
        }
        if meta.ended && rule.ends_by_flag() {
            self.close(index, common, tally);
        }
        Ok(())
    }

    /// Refuses one message; the episode it belongs to, if that can be told, is used up to here.
    pub(crate) fn bad(
        &mut self,
        meta: Meta<'_>,
        cause: &str,
        place: Place,
        common: &Common,
        tally: &mut Tally,
    ) {
        if meta.id == IdRef::None && self.rule == Some(EpisodeRule::Id) {
            // Whose step it was is not known. Where only one episode is open it is that one's; else the step numbers
            // will show a gap.
            tally.refuse(cause, place.offset);
            match self.open.as_mut_slice() {
                [only] => only.episode.lose_a_step(cause),
                many => many
                    .iter_mut()
                    .filter(|open| !open.episode.is_numbered())
                    .for_each(|open| open.episode.lose_a_step(cause)),
            }
            return;
        }
        let rule = match self.rule {
            Some(rule) => rule,
            None if meta.id != IdRef::None => *self.rule.insert(EpisodeRule::Id),
            None => {
                // Nothing good came yet: what the rule will be is not known.
                tally.refuse(cause, place.offset);
                self.loss = Some(cause.to_owned());
                return;
            }
        };
        let Some(index) = self.find_or_open(meta, rule, place, common, tally) else {
            return;
        };
        tally.refuse(cause, place.offset);
        self.open[index].episode.bad_step(meta.number, cause);
        if meta.ended && rule.ends_by_flag() {
            self.close(index, common, tally);
        }
    }

    /// Some part of the file is lost: open episodes may have lost steps.
    pub(crate) fn lose(&mut self, cause: &str) {
        for open in &mut self.open {
            open.episode.lose(cause);
        }
        self.loss = Some(cause.to_owned());
    }

    /// What was lost before any episode opened.
    pub(crate) fn take_loss(&mut self) -> Option<String> {
        self.loss.take()
    }

    /// Ends the open episode, if there is one; the next step begins another.
    pub(crate) fn cut(&mut self, common: &Common, tally: &mut Tally) {
        self.finish(common, tally);
    }

    /// A step was read, and is not used. It may be the one that ends its episode all the same.
    pub(crate) fn drop_step(&mut self, meta: Meta<'_>, common: &Common, tally: &mut Tally) {
        let is_one_of_many = self.rule == Some(EpisodeRule::Id);
        let open = &mut self.open;
        let index = open
            .iter()
            .position(|open| !is_one_of_many || open.id.is(meta.id));
        match index {
            Some(index) => open[index].episode.drop_steps(1),
            None => self.n_dropped += 1,
        }
        if let (Some(index), true) = (index, meta.ended)
            && self.rule.is_some_and(EpisodeRule::ends_by_flag)
        {
            self.close(index, common, tally);
        }
    }

    /// Closes all that is open: the recording is at its end.
    pub(crate) fn finish(&mut self, common: &Common, tally: &mut Tally) {
        while let Some(index) = (0..self.open.len()).min_by_key(|&i| self.open[i].nth) {
            self.close(index, common, tally);
        }
    }

    /// Index of the open episode that `row` belongs to. `None`: the episode is closed, and the message refused.
    fn find_or_open(
        &mut self,
        meta: Meta<'_>,
        rule: EpisodeRule,
        place: Place,
        common: &Common,
        tally: &mut Tally,
    ) -> Option<usize> {
        self.clock += 1;
        let found = match rule {
            EpisodeRule::Id => self.open.iter().position(|open| open.id.is(meta.id)),
            EpisodeRule::EndFlag | EpisodeRule::Recording | EpisodeRule::Cut => {
                (!self.open.is_empty()).then_some(0)
            }
        };
        if let Some(index) = found {
            self.open[index].last_fed = self.clock;
            return Some(index);
        }
        let id = match rule {
            EpisodeRule::Id if self.closed.contains(meta.id) => {
                tally.refuse("message for an episode that is closed", place.offset);
                return None;
            }
            EpisodeRule::Id => Id::of(meta.id)?,
            EpisodeRule::EndFlag | EpisodeRule::Recording | EpisodeRule::Cut => {
                Id::Nth(self.n_appeared)
            }
        };
        if self.open.len() >= self.limits.max_open_episodes
            && let Some(stalest) = (0..self.open.len()).min_by_key(|&i| self.open[i].last_fed)
        {
            self.close(stalest, common, tally);
        }
        let mut episode = OpenEpisode::new(self.n_last);
        episode.drop_steps(std::mem::take(&mut self.n_dropped));
        if let Some(loss) = &self.loss {
            let numbered = meta.number.is_some();
            if meta.number.is_none_or(|step| step > 0) {
                episode.lose_the_beginning(loss);
            }
            if !numbered {
                self.loss = None;
            }
        }
        self.open.push(Open {
            id,
            nth: self.n_appeared,
            last_fed: self.clock,
            episode,
        });
        self.n_appeared += 1;
        Some(self.open.len() - 1)
    }

    fn close(&mut self, index: usize, common: &Common, tally: &mut Tally) {
        let Open {
            id, nth, episode, ..
        } = self.open.swap_remove(index);
        let closed = episode.close(tally);
        self.n_last = closed.actions.n_rows();
        self.n_used += closed.actions.n_rows() as u64;
        match &id {
            Id::Nth(_) => {}
            Id::Integer(id) => self.closed.insert_integer(*id),
            Id::Text(id) => self.closed.insert_text(Arc::clone(id)),
        }
        if self.gives_early {
            self.give(nth, &id, closed, common);
            return;
        }
        self.waiting.insert(nth, (id, closed));
        while let Some((id, closed)) = self.waiting.remove(&self.n_given) {
            self.give(self.n_given, &id, closed, common);
        }
    }

    fn give(&mut self, nth: u64, id: &Id, closed: Closed, common: &Common) {
        let episode = closed.named(key(common, id, nth), common);
        self.ready.push((nth, episode));
        self.n_given += 1;
    }
}

fn key(common: &Common, id: &Id, nth: u64) -> EpisodeKey {
    let nth = i64::try_from(nth).unwrap_or(i64::MAX);
    let (episode, episode_id) = match id {
        Id::Nth(_) => (nth, None),
        Id::Integer(id) => (*id, Some(Arc::from(id.to_string()))),
        Id::Text(id) => (nth, Some(Arc::clone(id))),
    };
    EpisodeKey {
        recording: Arc::clone(&common.recording),
        episode,
        episode_id,
    }
}
