//! What an output directory remembers of its run: the parameters, and for each group of parts the recordings and
//! episodes that are in it. A group counts once its commit file is there; before, its parts are nobody's.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::directory::{own_temporary_name, parse_part_name};
use super::error::TableError;
use super::schema::{TABLE_VERSION, Table};
use crate::model::{RecordingIdentity, RecordingStatus};
use crate::storage::Storage;

/// What a batch of rows is about, in the order of the rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Mark {
    /// One episode of a recording, and its place in the order of appearance.
    Episode(RecordingIdentity, u64),
    /// The end of a recording.
    Recording(DoneRecording),
}

/// A recording whose rows are all there.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DoneRecording {
    /// Which.
    #[serde(flatten)]
    pub identity: RecordingIdentity,
    /// How it ended.
    pub status: RecordingStatus,
    /// Its episodes in the tables.
    pub n_episodes: u64,
    /// Nothing of it was refused, recovered or incomplete.
    pub clean: bool,
}

/// A recording of which only some episodes are there.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OpenRecording {
    /// Which.
    #[serde(flatten)]
    pub identity: RecordingIdentity,
    /// Those that are there.
    #[serde(flatten)]
    pub written: Written,
}

/// Which episodes of a recording are in the tables, by their places in the order of appearance.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Written {
    /// The first so many are.
    #[serde(rename = "n_episodes")]
    n_first: u64,
    /// And these, behind one that is not.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    more: BTreeSet<u64>,
}

impl Written {
    /// The first `n` episodes and no other.
    pub fn first(n: u64) -> Self {
        Self {
            n_first: n,
            more: BTreeSet::new(),
        }
    }

    /// Is this episode there?
    pub fn contains(&self, nth: u64) -> bool {
        nth < self.n_first || self.more.contains(&nth)
    }

    /// How many are there.
    pub fn n_episodes(&self) -> u64 {
        self.n_first + self.more.len() as u64
    }

    /// Takes an episode in.
    pub fn insert(&mut self, nth: u64) {
        if nth >= self.n_first {
            self.more.insert(nth);
        }
        self.close_up();
    }

    /// Takes in all that are there by another account.
    pub(super) fn join(&mut self, other: &Self) {
        self.n_first = self.n_first.max(other.n_first);
        self.more.extend(&other.more);
        self.close_up();
    }

    fn close_up(&mut self) {
        while let Some(&next) = self.more.first()
            && next <= self.n_first
        {
            self.more.pop_first();
            self.n_first = self.n_first.max(next + 1);
        }
    }
}

/// Commits by shard and number.
pub(super) type Commits = BTreeMap<(u32, u32), Commit>;

/// One part group, as its commit file has it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Commit {
    /// Paths of the parts, relative to the directory.
    pub(super) parts: Vec<String>,
    pub(super) recordings: Vec<DoneRecording>,
    /// The recording in which the group was cut.
    pub(super) open: Option<OpenRecording>,
    /// Recordings that were still being written, of those with episodes in the group; known by their beginnings.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) growing: Vec<OpenRecording>,
    /// Numbers of the groups whose rows are all in this one: they count no more.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) replaces: Vec<u32>,
    /// How often its rows were merged.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub(super) level: u32,
    /// Steps of the episodes in it.
    pub(super) n_steps: Option<u64>,
}

impl Commit {
    /// The number of the part of a table. Names are taken for nothing else: none is followed elsewhere.
    pub(super) fn part(&self, shard: u32, table: Table) -> Option<u32> {
        self.parts.iter().find_map(|path| {
            let name = path.strip_prefix(table.name())?.strip_prefix('/')?;
            let (of_shard, number) = parse_part_name(name)?;
            (of_shard == shard).then_some(number)
        })
    }
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "the signature that serde asks for"
)]
fn is_zero(n: &u32) -> bool {
    *n == 0
}

/// What run a directory holds.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Run {
    pub(super) table_version: u32,
    pub(super) steps: bool,
    pub(super) parameters: BTreeMap<String, String>,
}

impl Run {
    pub(super) fn new(steps: bool, parameters: &[(String, String)]) -> Self {
        Self {
            table_version: TABLE_VERSION,
            steps,
            parameters: parameters.iter().cloned().collect(),
        }
    }

    /// How `self`, which a directory holds, differs from what is asked for.
    pub(super) fn difference(&self, asked: &Self) -> String {
        if self.table_version != asked.table_version {
            return format!(
                "its tables have version {}, not {}",
                self.table_version, asked.table_version
            );
        }
        let value = |run: &Self, key: &str| {
            run.parameters
                .get(key)
                .map_or_else(|| "nothing".to_owned(), Clone::clone)
        };
        let mut keys: Vec<&String> = self
            .parameters
            .keys()
            .chain(asked.parameters.keys())
            .filter(|key| self.parameters.get(*key) != asked.parameters.get(*key))
            .collect();
        keys.sort();
        keys.dedup();
        let differences: Vec<String> = keys
            .iter()
            .map(|key| {
                let name = key.trim_start_matches("coact.");
                format!("{name} was {}, is {}", value(self, key), value(asked, key))
            })
            .collect();
        if differences.is_empty() {
            "the per-step table was asked for, or was not".to_owned()
        } else {
            differences.join("; ")
        }
    }
}

/// Folder of all that is not a table.
pub(super) const FOLDER: &str = "_coact";

/// Where the files of the protocol are.
pub(super) fn run_path(directory: &Path) -> PathBuf {
    directory.join(FOLDER).join("run.json")
}

pub(super) fn commits_folder(directory: &Path) -> PathBuf {
    directory.join(FOLDER).join("commits")
}

pub(super) fn plan_path(directory: &Path) -> PathBuf {
    directory.join(FOLDER).join("plan.json")
}

const LOCK_PREFIX: &str = "lock-";

pub(super) fn lock_path(directory: &Path, shard: u32) -> PathBuf {
    directory
        .join(FOLDER)
        .join(format!("{LOCK_PREFIX}{shard:05}"))
}

/// Shards that have been written to, finished or not.
pub(super) fn locked_shards(directory: &Path) -> Result<Vec<u32>, TableError> {
    let names = super::directory::names_in(&directory.join(FOLDER))?;
    let mut shards: Vec<u32> = names
        .iter()
        .filter_map(|path| path.file_name()?.to_str()?.strip_prefix(LOCK_PREFIX))
        .filter_map(|shard| shard.parse().ok())
        .collect();
    shards.sort_unstable();
    Ok(shards)
}

fn commit_name(shard: u32, number: u32) -> String {
    format!("{shard:05}-{number:05}.json")
}

/// Shard and number of a commit file's name.
pub(super) fn parse_commit_name(name: &str) -> Option<(u32, u32)> {
    let (shard, number) = name.strip_suffix(".json")?.split_once('-')?;
    (is_number(shard) && is_number(number)).then_some((shard.parse().ok()?, number.parse().ok()?))
}

/// Is this a number as it stands in names of ours: five digits, or more where it takes more?
pub(super) fn is_number(text: &str) -> bool {
    text.bytes().all(|b| b.is_ascii_digit())
        && (text.len() == 5 || (text.len() > 5 && !text.starts_with('0')))
}

/// Reads what run a directory holds; `None` if none.
pub(super) fn read_run(directory: &Path) -> Result<Option<Run>, TableError> {
    read(&run_path(directory))
}

/// Writes what run a directory holds; in a store, whose lock nobody holds, the name must be free.
pub(super) fn write_run(storage: &Storage, directory: &Path, run: &Run) -> Result<(), TableError> {
    let path = run_path(directory);
    let temporary = path.with_file_name(own_temporary_name("run.json"));
    let content = to_json(&path, run)?;
    if storage.is_store() {
        storage.write_whole_new(&path, &temporary, &content)?;
    } else {
        storage.write_whole(&path, &temporary, &content)?;
    }
    Ok(())
}

/// All commits of a shard, by number.
pub(super) fn read_commits(
    directory: &Path,
    shard: u32,
) -> Result<BTreeMap<u32, Commit>, TableError> {
    read_commits_where(directory, |of_shard| of_shard == shard).map(|commits| {
        commits
            .into_iter()
            .map(|((_, number), commit)| (number, commit))
            .collect()
    })
}

/// All commits, by shard and number.
pub(super) fn read_all_commits(directory: &Path) -> Result<Commits, TableError> {
    read_commits_where(directory, |_| true)
}

/// How often commits are listed again because one was gone before it was read.
const LIST_TRIES: u32 = 100;

fn read_commits_where(
    directory: &Path,
    is_wanted: impl Fn(u32) -> bool,
) -> Result<Commits, TableError> {
    for _ in 0..LIST_TRIES {
        if let Some(commits) = list_commits(directory, &is_wanted)? {
            return Ok(without_replaced(commits));
        }
    }
    let gone = io::Error::from(io::ErrorKind::NotFound);
    Err(TableError::io("read", &commits_folder(directory))(gone))
}

/// All commits; `None` if one is gone: it has just been merged into another, which the list does not have.
fn list_commits(
    directory: &Path,
    is_wanted: impl Fn(u32) -> bool,
) -> Result<Option<Commits>, TableError> {
    let mut commits = BTreeMap::new();
    for path in super::directory::names_in(&commits_folder(directory))? {
        let name = path.file_name().and_then(|n| n.to_str());
        if let Some((shard, number)) = name.and_then(parse_commit_name)
            && is_wanted(shard)
        {
            let Some(commit) = read(&path)? else {
                return Ok(None);
            };
            commits.insert((shard, number), commit);
        }
    }
    Ok(Some(commits))
}

/// Leaves out commits whose rows are in another.
fn without_replaced(mut commits: Commits) -> Commits {
    let replaced: BTreeSet<(u32, u32)> = commits
        .iter()
        .flat_map(|(&(shard, _), commit)| commit.replaces.iter().map(move |&n| (shard, n)))
        .collect();
    commits.retain(|id, _| !replaced.contains(id));
    commits
}

/// Removes the commit files of a shard that count no more.
pub(super) fn remove_replaced(
    storage: &Storage,
    directory: &Path,
    shard: u32,
    counting: &BTreeMap<u32, Commit>,
) -> Result<(), TableError> {
    for path in super::directory::names_in(&commits_folder(directory))? {
        let name = path.file_name().and_then(|n| n.to_str());
        if let Some((of_shard, number)) = name.and_then(parse_commit_name)
            && of_shard == shard
            && !counting.contains_key(&number)
        {
            storage.remove(&path)?;
        }
    }
    Ok(())
}

pub(super) fn remove_commit(
    storage: &Storage,
    directory: &Path,
    (shard, number): (u32, u32),
) -> Result<(), TableError> {
    storage.remove(&commits_folder(directory).join(commit_name(shard, number)))?;
    Ok(())
}

/// Writes a commit, also over an older one.
pub(super) fn write_commit(
    storage: &Storage,
    directory: &Path,
    id: (u32, u32),
    commit: &Commit,
) -> Result<(), TableError> {
    let (path, temporary) = places(directory, id);
    Ok(storage.write_whole(&path, &temporary, &to_json(&path, commit)?)?)
}

/// Writes a commit whose number must not be taken.
pub(super) fn write_new_commit(
    storage: &Storage,
    directory: &Path,
    id: (u32, u32),
    commit: &Commit,
) -> Result<(), TableError> {
    let (path, temporary) = places(directory, id);
    Ok(storage.write_whole_new(&path, &temporary, &to_json(&path, commit)?)?)
}

/// Where a commit file is, and where it is until it is whole.
fn places(directory: &Path, (shard, number): (u32, u32)) -> (PathBuf, PathBuf) {
    let name = commit_name(shard, number);
    let path = commits_folder(directory).join(&name);
    let temporary = path.with_file_name(own_temporary_name(&name));
    (path, temporary)
}

pub(super) fn read<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<Option<T>, TableError> {
    let text = match fs::read(path) {
        Ok(text) => text,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(TableError::io("read", path)(e)),
    };
    serde_json::from_slice(&text)
        .map(Some)
        .map_err(|e| TableError::io("read", path)(io::Error::new(io::ErrorKind::InvalidData, e)))
}

fn to_json<T: Serialize>(path: &Path, value: &T) -> Result<Vec<u8>, TableError> {
    serde_json::to_vec_pretty(value).map_err(|e| TableError::io("write", path)(io::Error::other(e)))
}
