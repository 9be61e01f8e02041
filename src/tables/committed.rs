//! What an output directory holds for a reader: the parts that commits name, and nothing else.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::commit::{self, Commit};
use super::directory::{self, part_name};
use super::error::TableError;
use super::schema::Table;

/// The committed part of an output directory, as it was at one moment.
#[derive(Debug, Clone)]
pub struct Committed {
    directory: PathBuf,
    table_version: u32,
    has_steps: bool,
    is_done: bool,
    parameters: BTreeMap<String, String>,
    commits: BTreeMap<(u32, u32), Commit>,
}

impl Committed {
    /// Reads what `directory` says of itself; `None` if it holds no run.
    ///
    /// # Errors
    /// If what says so cannot be read.
    pub fn read(directory: &Path) -> Result<Option<Self>, TableError> {
        let Some(run) = commit::read_run(directory)? else {
            return Ok(None);
        };
        // Before the commits: a run that ends meanwhile then looks unfinished, never the other way round.
        let is_done = directory::is_marked_done(directory);
        Ok(Some(Self {
            directory: directory.to_owned(),
            table_version: run.table_version,
            has_steps: run.steps,
            is_done,
            parameters: run.parameters,
            commits: commit::read_all_commits(directory)?,
        }))
    }

    /// Version of its tables.
    pub fn table_version(&self) -> u32 {
        self.table_version
    }

    /// Was the per-step table asked for?
    pub fn has_steps(&self) -> bool {
        self.has_steps
    }

    /// Is the run done?
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    /// The parameters, by the names they have in the metadata of files.
    pub fn parameters(&self) -> &BTreeMap<String, String> {
        &self.parameters
    }

    /// The parts of a table, in the order of their rows. Parts of one position hold the same episodes in each table.
    pub fn parts(&self, table: Table) -> Vec<PathBuf> {
        self.commits
            .iter()
            .filter_map(|(&(shard, _), commit)| Some((shard, commit.part(shard, table)?)))
            .map(|(shard, number)| {
                let folder = self.directory.join(table.name());
                folder.join(part_name(shard, number))
            })
            .collect()
    }
}
