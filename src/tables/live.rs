//! Tables of recordings that are still being written: each commit adds a small part group, and many small groups are
//! merged into one.
//!
//! A merge is a commit like any other: parts under a new number, then one commit file that names them and the groups it
//! replaces. Whoever reads the commits sees the groups or their merger, never both. The groups are removed behind it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::sync::Arc;

use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

use super::commit::{self, Commit, DoneRecording, Mark, OpenRecording};
use super::directory::part_name;
use super::error::TableError;
use super::output::{BegunRecording, OutputDirectory};
use super::rows::Batches;
use super::schema::Table;
use super::writer::{Part, TableWriter, tables};

/// Groups of more steps than half of this are not merged: they are no small ones.
const MAX_MERGED_STEPS: u64 = 4 << 20;

/// The tables of one directory, while recordings grow.
pub struct LiveTables {
    output: OutputDirectory,
    writer: TableWriter,
    /// By name.
    done: BTreeMap<Arc<str>, DoneRecording>,
    begun: BTreeMap<Arc<str>, BegunRecording>,
    /// Groups of one size after which they are merged.
    merge_after: usize,
}

impl LiveTables {
    /// Goes on in `output`; the tables are there from the first moment, if need be without rows.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn new(output: OutputDirectory, merge_after: usize) -> Result<Self, TableError> {
        let owned = |(name, done): (&str, &DoneRecording)| (Arc::from(name), done.clone());
        let mut live = Self {
            done: output.done().into_iter().map(owned).collect(),
            begun: output.begun(),
            writer: output.writer()?,
            output,
            merge_after: merge_after.max(2),
        };
        if live.output.commits.is_empty() {
            let empty = live.writer.empty_batches();
            live.commit(&[(empty, Vec::new())])?;
        }
        Ok(live)
    }

    /// The recording of this name, if all its rows are there.
    pub fn done(&self, name: &str) -> Option<&DoneRecording> {
        self.done.get(name)
    }

    /// The recording of this name, if some of its episodes are there.
    pub fn begun(&self, name: &str) -> Option<&BegunRecording> {
        self.begun.get(name)
    }

    /// Adds rows, and makes them count. The identities of episodes are those of their recordings' beginnings.
    ///
    /// # Errors
    /// If the file system refuses; what was committed before stays.
    pub fn commit(&mut self, rows: &[(Batches, Vec<Mark>)]) -> Result<(), TableError> {
        let mut growing = BTreeSet::new();
        let mut recordings = Vec::new();
        for (batches, marks) in rows {
            self.writer.write(batches, &[])?;
            for mark in marks {
                match mark {
                    Mark::Episode(identity, nth) => {
                        let name = Arc::clone(&identity.name);
                        let begun = self.begun.entry(Arc::clone(&name)).or_default();
                        begun.beginning = Some(identity.clone());
                        begun.written.insert(*nth);
                        growing.insert(name);
                    }
                    Mark::Recording(done) => {
                        let name = &done.identity.name;
                        self.begun.remove(name);
                        growing.remove(name);
                        self.done.insert(Arc::clone(name), done.clone());
                        recordings.push(done.clone());
                    }
                }
            }
        }
        let growing = growing.iter().filter_map(|name| {
            let begun = self.begun.get(name)?;
            Some(OpenRecording {
                identity: begun.beginning.clone()?,
                written: begun.written.clone(),
            })
        });
        let committed = self.writer.commit_group(|commit| {
            commit.growing = growing.collect();
            commit.recordings = recordings;
        })?;
        self.output.commits.extend(committed);
        self.merge_where_due()
    }

    /// Takes out the row of a recording that failed and is read again.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn forget(&mut self, name: &str) -> Result<(), TableError> {
        self.output.forget(&[name])?;
        self.done.remove(name);
        Ok(())
    }

    /// Merges the smallest groups and closes the tables; marks them as done if all recordings are.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn finish(mut self, is_whole: bool) -> Result<(), TableError> {
        let smallest = self.small_groups(0);
        if smallest.len() > 1 {
            self.merge(&smallest)?;
        }
        if is_whole {
            self.writer.finish()
        } else {
            Ok(())
        }
    }

    fn merge_where_due(&mut self) -> Result<(), TableError> {
        let levels: BTreeSet<u32> = self.output.commits.values().map(|c| c.level).collect();
        for level in levels {
            let groups = self.small_groups(level);
            if groups.len() >= self.merge_after {
                self.merge(&groups)?;
            }
        }
        Ok(())
    }

    /// The first small groups of a level, as many as one group may hold.
    fn small_groups(&self, level: u32) -> Vec<u32> {
        let mut n_steps = 0;
        let of = |commit: &Commit| commit.n_steps.unwrap_or(u64::MAX);
        self.output
            .commits
            .iter()
            .filter(|(_, c)| c.level == level && of(c) <= MAX_MERGED_STEPS / 2)
            .take_while(|(_, c)| {
                n_steps += of(c);
                n_steps <= MAX_MERGED_STEPS
            })
            .map(|(&number, _)| number)
            .collect()
    }

    /// Makes one group of several, and removes them.
    fn merge(&mut self, numbers: &[u32]) -> Result<(), TableError> {
        let OutputDirectory {
            directory,
            options,
            storage,
            commits,
            ..
        } = &mut self.output;
        let shard = options.shard;
        let number = self.writer.take_number();
        let name = part_name(shard, number);
        let mut parts = Vec::new();
        let mut merged = Commit {
            replaces: numbers.to_vec(),
            ..merged(numbers.iter().filter_map(|n| commits.get(n)))
        };
        for table in tables(options) {
            let folder = directory.join(table.name());
            let mut part = Part::create(storage, directory, table, &name, options)?;
            for &old in numbers {
                copy_rows(&folder.join(part_name(shard, old)), &mut part)?;
            }
            parts.push(part);
            merged.parts.push(format!("{}/{name}", table.name()));
        }
        // All at once, when all are written: who reads folders and no commits sees rows twice until the old are gone.
        parts.into_iter().try_for_each(Part::commit)?;
        commit::write_commit(storage, directory, (shard, number), &merged)?;
        for &old in numbers {
            for table in Table::ALL {
                let part = directory.join(table.name()).join(part_name(shard, old));
                storage.remove(&part)?;
            }
        }
        for &old in numbers {
            commit::remove_commit(storage, directory, (shard, old))?;
            commits.remove(&old);
        }
        commits.insert(number, merged);
        Ok(())
    }
}

/// What the commit of a merger says, but for its parts.
fn merged<'a>(commits: impl Iterator<Item = &'a Commit>) -> Commit {
    let mut merged = Commit {
        n_steps: Some(0),
        ..Commit::default()
    };
    let mut growing: BTreeMap<Arc<str>, OpenRecording> = BTreeMap::new();
    for commit in commits {
        merged.level = merged.level.max(commit.level + 1);
        merged.n_steps = merged.n_steps.zip(commit.n_steps).map(|(a, b)| a + b);
        merged.recordings.extend_from_slice(&commit.recordings);
        // The later one says more. One that an undisturbed run was cut in stands for itself.
        for open in &commit.growing {
            growing.insert(Arc::clone(&open.identity.name), open.clone());
        }
        if commit.open.is_some() {
            merged.open.clone_from(&commit.open);
        }
    }
    for done in &merged.recordings {
        growing.remove(&done.identity.name);
    }
    merged.growing = growing.into_values().collect();
    merged
}

/// Copies all rows of a part behind those of another.
fn copy_rows(from: &std::path::Path, to: &mut Part) -> Result<(), TableError> {
    let parquet = TableError::parquet(from);
    let file = File::open(from).map_err(TableError::io("open", from))?;
    let batches = ParquetRecordBatchReaderBuilder::try_new(file)
        .and_then(ParquetRecordBatchReaderBuilder::build)
        .map_err(parquet)?;
    for batch in batches {
        let batch = batch.map_err(|e| TableError::parquet(from)(e.into()))?;
        to.write_batch(&batch)?;
    }
    Ok(())
}
