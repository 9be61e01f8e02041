//! Collects steps into episodes, closes them, and gives them out in the order in which they first appeared.
//!
//! The rules (which field ends an episode, what a bad step does, what becomes of a message for a closed id) are the
//! section "Recordings and episodes" of the README; `open_episode.rs` holds what happens inside one episode.

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;

use super::decode::{Row, RowId};
use super::error::RecordingError;
use super::limits::Limits;
use super::open_episode::{Closed, OpenEpisode, Place};
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
}

impl EpisodeRule {
    /// As it stands in the `recordings` table.
    pub(crate) fn describe(self) -> &'static str {
        match self {
            Self::Id => "field",
            Self::EndFlag => "done",
            Self::Recording => "recording",
        }
    }
}

/// The id of an episode, owned.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Id {
    /// No id is logged; the order of appearance stands for it.
    Nth(u64),
    Integer(i64),
    Text(Arc<str>),
}

impl Id {
    fn is(&self, row: &Row) -> bool {
        match (self, row.id) {
            (Self::Integer(id), RowId::Integer(other)) => *id == other,
            (Self::Text(id), RowId::Text) => **id == *row.id_text,
            _ => false,
        }
    }

    fn of(row: &Row) -> Option<Self> {
        match row.id {
            RowId::None => None,
            RowId::Integer(id) => Some(Self::Integer(id)),
            RowId::Text => Some(Self::Text(Arc::from(row.id_text.as_str()))),
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
    closed: HashSet<Id>,
    /// Closed, but an episode that appeared earlier is still open.
    waiting: BTreeMap<u64, (Id, Closed)>,
    n_appeared: u64,
    n_given: u64,
    clock: u64,
    /// Why the beginning of the next new episode may be missing.
    loss: Option<String>,
    n_used: u64,
    ready: Vec<Episode>,
}

impl Episodes {
    pub(crate) fn new(limits: Limits) -> Self {
        Self {
            rule: None,
            limits,
            open: Vec::new(),
            closed: HashSet::new(),
            waiting: BTreeMap::new(),
            n_appeared: 0,
            n_given: 0,
            clock: 0,
            loss: None,
            n_used: 0,
            ready: Vec::new(),
        }
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

    /// Takes the closed episodes whose turn it is.
    pub(crate) fn take_ready(&mut self) -> Vec<Episode> {
        std::mem::take(&mut self.ready)
    }

    /// Adds one step, or refuses it.
    pub(crate) fn push(
        &mut self,
        row: &Row,
        place: Place,
        common: &Common,
        tally: &mut Tally,
    ) -> Result<(), RecordingError> {
        let rule = *self.rule.get_or_insert(match row {
            Row {
                id: RowId::Integer(_) | RowId::Text,
                ..
            } => EpisodeRule::Id,
            Row {
                has_end_flag: true, ..
            } => EpisodeRule::EndFlag,
            _ => EpisodeRule::Recording,
        });
        if rule == EpisodeRule::Id && row.id == RowId::None {
            self.bad(row, "episode is missing", place, common, tally);
            return Ok(());
        }
        let Some(index) = self.find_or_open(row, rule, place, common, tally) else {
            return Ok(());
        };
        let open = &mut self.open[index];
        open.episode.push(row, place, tally);
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
        if row.ended && rule != EpisodeRule::Recording {
            self.close(index, common, tally);
        }
        Ok(())
    }

    /// Refuses one message; the episode it belongs to, if that can be told, is used up to here.
    pub(crate) fn bad(
        &mut self,
        row: &Row,
        cause: &str,
        place: Place,
        common: &Common,
        tally: &mut Tally,
    ) {
        if row.id == RowId::None && self.rule == Some(EpisodeRule::Id) {
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
            None if row.id != RowId::None => *self.rule.insert(EpisodeRule::Id),
            None => {
                // Nothing good came yet: what the rule will be is not known.
                tally.refuse(cause, place.offset);
                self.loss = Some(cause.to_owned());
                return;
            }
        };
        let Some(index) = self.find_or_open(row, rule, place, common, tally) else {
            return;
        };
        tally.refuse(cause, place.offset);
        self.open[index].episode.bad_step(row.step, cause);
        if row.ended && rule != EpisodeRule::Recording {
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

    /// Closes all that is open: the recording is at its end.
    pub(crate) fn finish(&mut self, common: &Common, tally: &mut Tally) {
        while let Some(index) = (0..self.open.len()).min_by_key(|&i| self.open[i].nth) {
            self.close(index, common, tally);
        }
    }

    /// Index of the open episode that `row` belongs to. `None`: the episode is closed, and the message refused.
    fn find_or_open(
        &mut self,
        row: &Row,
        rule: EpisodeRule,
        place: Place,
        common: &Common,
        tally: &mut Tally,
    ) -> Option<usize> {
        self.clock += 1;
        let found = match rule {
            EpisodeRule::Id => self.open.iter().position(|open| open.id.is(row)),
            EpisodeRule::EndFlag | EpisodeRule::Recording => (!self.open.is_empty()).then_some(0),
        };
        if let Some(index) = found {
            self.open[index].last_fed = self.clock;
            return Some(index);
        }
        let id = match rule {
            EpisodeRule::Id => Id::of(row)?,
            EpisodeRule::EndFlag | EpisodeRule::Recording => Id::Nth(self.n_appeared),
        };
        if self.closed.contains(&id) {
            tally.refuse("message for an episode that is closed", place.offset);
            return None;
        }
        if self.open.len() >= self.limits.max_open_episodes
            && let Some(stalest) = (0..self.open.len()).min_by_key(|&i| self.open[i].last_fed)
        {
            self.close(stalest, common, tally);
        }
        let mut episode = OpenEpisode::default();
        if let Some(loss) = &self.loss {
            let numbered = row.step.is_some();
            if row.step.is_none_or(|step| step > 0) {
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
        self.n_used += closed.actions.n_rows() as u64;
        if !matches!(id, Id::Nth(_)) {
            self.closed.insert(id.clone());
        }
        self.waiting.insert(nth, (id, closed));
        while let Some((id, closed)) = self.waiting.remove(&self.n_given) {
            self.ready
                .push(closed.named(key(common, &id, self.n_given), common));
            self.n_given += 1;
        }
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
