//! How a recording is read: its topics, what each is used for, and whether they must be put on one clock.

use std::sync::Arc;

use super::episodes::EpisodeRule;
use super::layout::Layout;
use super::options::{Clock, EpisodeOption, ReadOptions};
use super::selector::Selector;
use super::source::{Role, Source};
use super::timeline::{Part, Timeline};

/// What the messages of a topic are used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Use {
    /// Each is a step.
    Clock,
    /// Values that count until the next.
    Held,
    /// They say which episode it is.
    Id,
    /// They say when an episode is over.
    Done,
    /// They begin an episode.
    Marker,
}

/// How a recording is read.
#[derive(Debug)]
pub(crate) struct Plan {
    pub(crate) layout: Layout,
    /// The clock is number 0; those that are aligned come before those without values.
    pub(crate) sources: Vec<Source>,
    pub(crate) rule: Option<EpisodeRule>,
    /// None where each message is a whole step by itself.
    pub(crate) timeline: Option<Timeline>,
    /// All is held back, until it turns out that the recording is several episodes.
    pub(crate) may_hold_all: bool,
    actions: Vec<Part>,
}

impl Plan {
    pub(crate) fn new(layout: Layout, options: &ReadOptions) -> Self {
        let mut sources: Vec<Source> = Vec::new();
        let actions = parts(&mut sources, &layout.actions, Role::Action);
        let states = parts(&mut sources, &layout.states, Role::State);
        let n_aligned = sources.len();
        for (i, source) in sources.iter_mut().enumerate() {
            source
                .uses
                .push(if i == 0 { Use::Clock } else { Use::Held });
        }
        let rule = episode_rule(&mut sources, &options.episodes);
        for source in &mut sources {
            source.extras.stamp = options.clock == Clock::Header;
        }
        let gap = match options.episodes {
            EpisodeOption::Gap(nanos) => Some(nanos),
            _ => None,
        };
        let needs_marker = matches!(options.episodes, EpisodeOption::Marker(_));
        let is_timed = sources.len() > 1 || gap.is_some() || needs_marker;
        let mut timeline = is_timed.then(|| {
            let parts = (actions.clone(), states);
            Timeline::new(options, n_aligned, parts, gap, needs_marker)
        });
        // Until the first action tells, the recording may be one episode: its states may all come first.
        let may_be_one = [EpisodeOption::Auto, EpisodeOption::Recording];
        if let Some(timeline) = timeline
            .as_mut()
            .filter(|_| may_be_one.contains(&options.episodes))
        {
            timeline.hold_all(options.limits.max_episode);
        }
        Self {
            layout,
            sources,
            rule,
            timeline,
            may_hold_all: options.episodes == EpisodeOption::Auto,
            actions,
        }
    }

    pub(crate) fn source_of(&self, topic: &str) -> Option<usize> {
        self.sources.iter().position(|s| s.topic == topic)
    }

    /// Topics without which there is nothing to read.
    pub(crate) fn topics_needed(&self) -> impl Iterator<Item = &str> {
        let is_needed = |s: &&Source| s.uses.iter().any(|u| *u != Use::Done);
        self.sources
            .iter()
            .filter(is_needed)
            .map(|s| s.topic.as_str())
    }

    /// What the messages call each column of the action, if all have a name.
    pub(crate) fn action_names(&self) -> Option<Arc<[Arc<str>]>> {
        let mut names = Vec::new();
        for part in &self.actions {
            let of_part = self.sources[part.source].names.get(part.take)?.as_ref()?;
            names.extend(of_part.iter().cloned());
        }
        Some(names.into())
    }

    /// Are all actions taken from this source?
    pub(crate) fn actions_are_all_of(&self, source: usize) -> bool {
        self.actions.iter().all(|part| part.source == source)
    }

    /// Messages of other topics than the action's that were of use.
    pub(crate) fn n_held_used(&self) -> u64 {
        self.timeline.as_ref().map_or(0, Timeline::n_used)
    }

    /// Where episodes began and ended, as it could be asked for.
    pub(crate) fn describe_rule(
        &self,
        asked: &EpisodeOption,
        found: Option<EpisodeRule>,
    ) -> Option<String> {
        if *asked != EpisodeOption::Auto {
            return Some(asked.to_string());
        }
        let clock = self.sources.first()?;
        let field = |names: &[&str]| {
            names
                .iter()
                .find(|name| clock.fields.iter().any(|f| f == *name))
                .map(|name| Selector::of_key(&clock.topic, name).to_string())
        };
        Some(match found? {
            EpisodeRule::Id => format!("field:{}", field(&ID_FIELDS)?),
            EpisodeRule::EndFlag => format!("done:{}", field(&END_FIELDS)?),
            EpisodeRule::Recording | EpisodeRule::Cut => "recording".to_owned(),
        })
    }
}

/// Members that hold an episode's id, the first that is there.
pub(crate) const ID_FIELDS: [&str; 3] = ["episode", "episode_id", "episode_index"];

/// Members that are true on the last step of an episode.
pub(crate) const END_FIELDS: [&str; 3] = ["terminated", "truncated", "done"];

/// The source of a topic, made if there is none yet.
fn source_at(sources: &mut Vec<Source>, topic: &str) -> usize {
    sources
        .iter()
        .position(|s| s.topic == topic)
        .unwrap_or_else(|| {
            sources.push(Source::new(topic));
            sources.len() - 1
        })
}

/// Adds selectors to the sources of their topics.
fn parts(sources: &mut Vec<Source>, selectors: &[Selector], role: Role) -> Vec<Part> {
    selectors
        .iter()
        .map(|selector| {
            let source = source_at(sources, selector.topic());
            let takes = &mut sources[source].takes;
            takes.push((role, selector.clone()));
            Part {
                source,
                take: takes.len() - 1,
            }
        })
        .collect()
}

/// Sets up what episodes need of which topic.
fn episode_rule(sources: &mut Vec<Source>, asked: &EpisodeOption) -> Option<EpisodeRule> {
    let clock = &mut sources[0].extras;
    clock.numbers = true;
    match asked {
        EpisodeOption::Auto => {
            clock.ids = true;
            clock.flags = true;
            None
        }
        EpisodeOption::Recording => Some(EpisodeRule::Recording),
        EpisodeOption::Field(selector) => {
            clock.flags = true;
            let source = source_at(sources, selector.topic());
            sources[source].extras.id = Some(selector.clone());
            if source > 0 {
                sources[source].uses.push(Use::Id);
            }
            Some(EpisodeRule::Id)
        }
        EpisodeOption::Done(selector) => {
            let source = source_at(sources, selector.topic());
            sources[source].extras.done = Some(selector.clone());
            if source == 0 {
                return Some(EpisodeRule::EndFlag);
            }
            sources[source].uses.push(Use::Done);
            Some(EpisodeRule::Cut)
        }
        EpisodeOption::Marker(topic) => {
            let source = source_at(sources, topic);
            sources[source].uses.insert(0, Use::Marker);
            Some(EpisodeRule::Cut)
        }
        EpisodeOption::Gap(_) => Some(EpisodeRule::Cut),
    }
}
