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
use crate::model::RecordingStatus;

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
                        // One that failed is read again: which of its episodes are there must stay known.
                        if done.status != RecordingStatus::Failed {
                            self.begun.remove(name);
                            growing.remove(name);
                        }
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

    /// Merges the smallest groups and closes the tables; marks them as done if all recordings are, those that are gone
    /// too.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn finish(mut self, is_whole: bool) -> Result<(), TableError> {
        while let Some(smallest) = self.small_groups(0, 2) {
            self.merge(&smallest)?;
        }
        if is_whole && self.begun.is_empty() {
            self.writer.finish()
        } else {
            Ok(())
        }
    }

    fn merge_where_due(&mut self) -> Result<(), TableError> {
        let levels: BTreeSet<u32> = self.output.commits.values().map(|c| c.level).collect();
        for level in levels {
            if let Some(groups) = self.small_groups(level, self.merge_after) {
                self.merge(&groups)?;
            }
        }
        Ok(())
    }

    /// Small groups of a level, `at_least` so many, in their order.
    fn small_groups(&self, level: u32, at_least: usize) -> Option<Vec<u32>> {
        // A commit says of one recording that an undisturbed run was cut in it: that cannot be merged with another.
        let is_cut = |commit: &Commit| {
            let open = commit.open.as_ref();
            open.is_some_and(|open| self.begun.contains_key(&open.identity.name))
        };
        let commits = self.output.commits.iter();
        let of_level = commits.filter(|(_, c)| c.level == level && !is_cut(c));
        fitting(
            of_level.filter_map(|(&number, c)| Some((number, c.n_steps?))),
            at_least,
        )
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

/// The first small groups in a row that one group can hold, `at_least` so many. Where larger ones among them leave room
/// for too few, those stay as they are, and do not hold up the groups behind them.
fn fitting(groups: impl Iterator<Item = (u32, u64)>, at_least: usize) -> Option<Vec<u32>> {
    let mut row = Vec::new();
    let mut n_in_row = 0;
    for (number, n_steps) in groups.filter(|&(_, n_steps)| n_steps <= MAX_MERGED_STEPS / 2) {
        if n_in_row + n_steps > MAX_MERGED_STEPS {
            if row.len() >= at_least {
                break;
            }
            row.clear();
            n_in_row = 0;
        }
        row.push(number);
        n_in_row += n_steps;
    }
    (row.len() >= at_least).then_some(row)
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
        // Which of two says more does not show in their order: one may be a merger.
        for open in &commit.growing {
            let known = growing.entry(Arc::clone(&open.identity.name));
            let known = known.or_insert_with(|| open.clone());
            if known.identity.bytes < open.identity.bytes {
                known.identity = open.identity.clone();
            }
            known.written.join(&open.written);
        }
    }
    for done in &merged.recordings {
        if done.status != RecordingStatus::Failed {
            growing.remove(&done.identity.name);
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    const LARGE: u64 = MAX_MERGED_STEPS / 7;

    #[test]
    fn large_groups_do_not_hold_up_the_small_ones_behind_them() {
        let large = (0..8).map(|number| (number, LARGE));
        let small = (8..138).map(|number| (number, 100));
        let row = fitting(large.clone().chain(small), 16).unwrap();
        assert_eq!(row, (7..138).collect::<Vec<u32>>());
        assert_eq!(fitting(large.clone(), 8), None);
        assert_eq!(fitting(large, 7).unwrap(), (0..7).collect::<Vec<u32>>());
    }

    #[test]
    fn what_is_larger_than_half_of_a_merged_group_is_passed_over() {
        let groups = [(0, 5), (1, MAX_MERGED_STEPS / 2 + 1), (2, 5)];
        assert_eq!(fitting(groups.into_iter(), 2), Some(vec![0, 2]));
        assert_eq!(fitting(groups.into_iter(), 3), None);
    }
}
