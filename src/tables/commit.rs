//! What an output directory remembers of its run: the parameters, and for each group of parts the recordings and
//! episodes that are in it. A group counts once its commit file is there; before, its parts are nobody's.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::directory::{own_temporary_name, parse_part_name, temporary_name};
use super::error::TableError;
use super::schema::{TABLE_VERSION, Table};
use crate::model::{RecordingIdentity, RecordingStatus};
use crate::storage::Storage;

/// What a batch of rows is about, in the order of the rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Mark {
    /// One episode of a recording.
    Episode(RecordingIdentity),
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

/// A recording of which only the first episodes are there.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OpenRecording {
    /// Which.
    #[serde(flatten)]
    pub identity: RecordingIdentity,
    /// How many of its episodes are in the tables.
    pub n_episodes: u64,
}

/// One part group, as its commit file has it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Commit {
    /// Paths of the parts, relative to the directory.
    pub(super) parts: Vec<String>,
    pub(super) recordings: Vec<DoneRecording>,
    /// The recording in which the group was cut.
    pub(super) open: Option<OpenRecording>,
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
    let digits = |t: &str| t.len() == 5 && t.bytes().all(|b| b.is_ascii_digit());
    (digits(shard) && digits(number)).then_some((shard.parse().ok()?, number.parse().ok()?))
}

/// Reads what run a directory holds; `None` if none.
pub(super) fn read_run(directory: &Path) -> Result<Option<Run>, TableError> {
    read(&run_path(directory))
}

pub(super) fn write_run(storage: &Storage, directory: &Path, run: &Run) -> Result<(), TableError> {
    let path = run_path(directory);
    let temporary = path.with_file_name(temporary_name("run.json"));
    Ok(storage.write_whole(&path, &temporary, &to_json(&path, run)?)?)
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
pub(super) fn read_all_commits(
    directory: &Path,
) -> Result<BTreeMap<(u32, u32), Commit>, TableError> {
    read_commits_where(directory, |_| true)
}

fn read_commits_where(
    directory: &Path,
    is_wanted: impl Fn(u32) -> bool,
) -> Result<BTreeMap<(u32, u32), Commit>, TableError> {
    let folder = commits_folder(directory);
    let mut commits = BTreeMap::new();
    for path in super::directory::names_in(&folder)? {
        let name = path.file_name().and_then(|n| n.to_str());
        if let Some((shard, number)) = name.and_then(parse_commit_name)
            && is_wanted(shard)
            && let Some(commit) = read(&path)?
        {
            commits.insert((shard, number), commit);
        }
    }
    Ok(commits)
}

/// Writes a commit, also over an older one.
pub(super) fn write_commit(
    storage: &Storage,
    directory: &Path,
    (shard, number): (u32, u32),
    commit: &Commit,
) -> Result<(), TableError> {
    let name = commit_name(shard, number);
    let path = commits_folder(directory).join(&name);
    let temporary = path.with_file_name(own_temporary_name(&name));
    Ok(storage.write_whole(&path, &temporary, &to_json(&path, commit)?)?)
}

/// Writes a commit whose number must not be taken.
pub(super) fn write_new_commit(
    storage: &Storage,
    directory: &Path,
    (shard, number): (u32, u32),
    commit: &Commit,
) -> Result<(), TableError> {
    let name = commit_name(shard, number);
    let path = commits_folder(directory).join(&name);
    let temporary = path.with_file_name(own_temporary_name(&name));
    Ok(storage.write_whole_new(&path, &temporary, &to_json(&path, commit)?)?)
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
