//! What differs between the results of two runs: episodes and the boundaries of composite actions.
//!
//! Episodes are the same if recording and id are, segments are held against each other joint by joint (`pairing.rs`).
//! Values of changes, scores and times are not compared: where they differ and no segment does, nothing that an agent
//! would do differs.

mod pairing;
mod text;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde::Serialize;

use crate::model::EpisodeKey;
use crate::results::{EpisodeRow, Results, ResultsError, SegmentRow};
use pairing::Pair;

/// All that differs between two runs, A and B.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Difference {
    /// Something differs that counts: any episode or segment; parameters alone do not.
    pub is_different: bool,
    /// Steps within which a segment that is not where it was has moved.
    pub tolerance_steps: usize,
    /// Parameters that differ, by name.
    pub parameters: Vec<ParameterChange>,
    /// Episodes that differ.
    pub episodes: EpisodeChanges,
    /// How many segments there are of each kind, in episodes that both have.
    pub n_segments: SegmentCounts,
    /// Segments that differ, by episode, joint and time.
    pub segments: Vec<SegmentChange>,
}

/// A parameter that differs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ParameterChange {
    /// Name of the option.
    pub name: String,
    /// In A; none if it was not given.
    pub a: Option<String>,
    /// In B.
    pub b: Option<String>,
}

/// Episodes that differ.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct EpisodeChanges {
    /// Only B has them.
    pub added: Vec<EpisodeEntry>,
    /// Only A has them.
    pub gone: Vec<EpisodeEntry>,
    /// Both have them, with another status or number of steps.
    pub changed: Vec<EpisodeChange>,
}

/// What an episode is, as far as it is compared.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EpisodeEntry {
    /// Its recording.
    pub recording: Arc<str>,
    /// As in the tables.
    pub episode: i64,
    /// The logged id, if there is one.
    pub episode_id: Option<Arc<str>>,
    /// `ok`, `incomplete` or `too_short`.
    pub status: &'static str,
    /// Steps used.
    pub n_steps: usize,
    /// Composite actions, over all joints.
    pub n_segments: usize,
}

/// An episode that differs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EpisodeChange {
    /// In A.
    pub a: EpisodeEntry,
    /// In B.
    pub b: EpisodeEntry,
}

/// How many segments there are of each kind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct SegmentCounts {
    /// In both, from the same step to the same step.
    pub same: u64,
    /// In both, start and end at most the tolerance apart.
    pub moved: u64,
    /// Only in B.
    pub appeared: u64,
    /// Only in A.
    pub vanished: u64,
}

/// What became of a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ChangeKind {
    /// In both, start and end at most the tolerance apart.
    Moved,
    /// Only in B.
    Appeared,
    /// Only in A.
    Vanished,
}

impl ChangeKind {
    /// As it stands in text and JSON.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Moved => "moved",
            Self::Appeared => "appeared",
            Self::Vanished => "vanished",
        }
    }
}

/// Where a segment is: half-open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Span {
    /// First step.
    pub start_step: usize,
    /// One past the last step.
    pub end_step: usize,
}

/// A segment that differs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SegmentChange {
    /// How.
    pub change: ChangeKind,
    /// Its recording.
    pub recording: Arc<str>,
    /// As in the tables.
    pub episode: i64,
    /// The logged id, if there is one.
    pub episode_id: Option<Arc<str>>,
    /// 0, 1, …; −1 for all together.
    pub joint: i32,
    /// Its name.
    pub joint_name: Option<Arc<str>>,
    /// Where it was; none if it appeared.
    pub a: Option<Span>,
    /// Where it is; none if it vanished.
    pub b: Option<Span>,
}

/// How two runs are held against each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DiffOptions {
    /// Steps within which a segment that is not where it was has moved, and not vanished.
    pub tolerance_steps: usize,
    /// Segments that moved do not count.
    pub allow_moved: bool,
}

/// Holds run `b` against run `a`.
///
/// # Errors
/// If one of them cannot be read.
pub fn diff(a: &Results, b: &Results, options: DiffOptions) -> Result<Difference, ResultsError> {
    let mut difference = Difference {
        tolerance_steps: options.tolerance_steps,
        parameters: parameters(a, b),
        ..Difference::default()
    };
    let (in_a, in_b) = (episodes(a)?, episodes(b)?);
    difference.episodes = EpisodeChanges::of(&in_a, &in_b);
    let is_in_both = |id: &Id| in_a.contains_key(id) && in_b.contains_key(id);
    let (in_a, in_b) = (joints(a, is_in_both)?, joints(b, is_in_both)?);
    let nothing = Joint::default();
    for key in in_a.keys().chain(in_b.keys()).collect::<BTreeSet<_>>() {
        let of = |joints: &BTreeMap<_, _>| -> Joint { joints.get(key).unwrap_or(&nothing).clone() };
        difference.add_joint(key, &of(&in_a), &of(&in_b));
    }
    let n = difference.n_segments;
    let episodes = &difference.episodes;
    difference.is_different = n.appeared + n.vanished > 0
        || (n.moved > 0 && !options.allow_moved)
        || !(episodes.added.is_empty() && episodes.gone.is_empty() && episodes.changed.is_empty());
    Ok(difference)
}

/// By what an episode is known: its recording, and its logged id or, where there is none, its place.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Id {
    recording: Arc<str>,
    episode: Named,
}

/// Numbers in their order, then names.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Named {
    Number(i64),
    Text(Arc<str>),
}

impl Id {
    fn of(key: &EpisodeKey) -> Self {
        let episode = match &key.episode_id {
            // Of an id that is a text the number is its place, which changes with what is before it.
            Some(id) if **id != *key.episode.to_string() => Named::Text(Arc::clone(id)),
            _ => Named::Number(key.episode),
        };
        Self {
            recording: Arc::clone(&key.recording),
            episode,
        }
    }
}

fn episodes(results: &Results) -> Result<BTreeMap<Id, EpisodeEntry>, ResultsError> {
    let entry = |row: EpisodeRow| {
        let id = Id::of(&row.key);
        let entry = EpisodeEntry {
            recording: row.key.recording,
            episode: row.key.episode,
            episode_id: row.key.episode_id,
            status: row.status.as_str(),
            n_steps: row.n_steps,
            n_segments: row.n_segments,
        };
        (id, entry)
    };
    results.episodes().map(|row| row.map(entry)).collect()
}

impl EpisodeChanges {
    fn of(a: &BTreeMap<Id, EpisodeEntry>, b: &BTreeMap<Id, EpisodeEntry>) -> Self {
        let missing = |of: &BTreeMap<Id, EpisodeEntry>, from: &BTreeMap<Id, EpisodeEntry>| {
            let entries = of.iter().filter(|(id, _)| !from.contains_key(*id));
            entries.map(|(_, entry)| entry.clone()).collect()
        };
        let both = a.iter().filter_map(|(id, entry)| Some((entry, b.get(id)?)));
        let changed = both.filter(|(a, b)| (a.status, a.n_steps) != (b.status, b.n_steps));
        Self {
            added: missing(b, a),
            gone: missing(a, b),
            changed: changed
                .map(|(a, b)| EpisodeChange {
                    a: a.clone(),
                    b: b.clone(),
                })
                .collect(),
        }
    }
}

/// The segments of one joint in one episode.
#[derive(Debug, Clone, Default)]
struct Joint {
    /// The number of the episode, which is not its id.
    episode: i64,
    episode_id: Option<Arc<str>>,
    name: Option<Arc<str>>,
    /// In time, disjoint.
    spans: Vec<Span>,
}

type JointKey = (Id, i32);

fn joints(
    results: &Results,
    is_wanted: impl Fn(&Id) -> bool,
) -> Result<BTreeMap<JointKey, Joint>, ResultsError> {
    let mut joints: BTreeMap<JointKey, Joint> = BTreeMap::new();
    for row in results.segments() {
        let row: SegmentRow = row?;
        let id = Id::of(&row.key);
        if !is_wanted(&id) {
            continue;
        }
        let joint = joints.entry((id, row.joint)).or_insert_with(|| Joint {
            episode: row.key.episode,
            episode_id: row.key.episode_id,
            name: row.joint_name,
            spans: Vec::new(),
        });
        joint.spans.push(Span {
            start_step: row.start_step,
            end_step: row.end_step,
        });
    }
    Ok(joints)
}

impl Difference {
    fn add_joint(&mut self, (id, number): &JointKey, a: &Joint, b: &Joint) {
        let named = if a.spans.is_empty() { b } else { a };
        for pair in pairing::pairs(&a.spans, &b.spans, self.tolerance_steps) {
            let n = &mut self.n_segments;
            let (count, change) = match pair {
                Pair::Same => {
                    n.same += 1;
                    continue;
                }
                Pair::Moved(..) => (&mut n.moved, ChangeKind::Moved),
                Pair::OnlyA(_) => (&mut n.vanished, ChangeKind::Vanished),
                Pair::OnlyB(_) => (&mut n.appeared, ChangeKind::Appeared),
            };
            *count += 1;
            let (a, b) = pair.spans();
            self.segments.push(SegmentChange {
                change,
                recording: Arc::clone(&id.recording),
                episode: named.episode,
                episode_id: named.episode_id.clone(),
                joint: *number,
                joint_name: named.name.clone(),
                a,
                b,
            });
        }
    }
}

fn parameters(a: &Results, b: &Results) -> Vec<ParameterChange> {
    let (a, b) = (a.parameters(), b.parameters());
    let names: BTreeSet<&str> = a.iter().chain(b.iter()).map(|(name, _)| name).collect();
    let differ = names.into_iter().filter(|name| a.get(name) != b.get(name));
    differ
        .map(|name| ParameterChange {
            name: name.to_owned(),
            a: a.get(name).map(ToOwned::to_owned),
            b: b.get(name).map(ToOwned::to_owned),
        })
        .collect()
}
