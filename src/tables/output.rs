//! An output directory, locked, with what an earlier process of the same run has left in it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use arrow::array::{AsArray, BooleanArray};
use arrow::compute::filter_record_batch;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

use super::commit::{self, Commit, DoneRecording, OpenRecording, Run, Written};
use super::directory::{self, WHOLE, part_name};
use super::error::TableError;
use super::plan::{Plan, read_plan_at};
use super::schema::Table;
use super::writer::{Part, TableOptions, TableWriter};
use crate::model::{RecordingIdentity, RecordingStatus};
use crate::storage::Storage;

/// An output directory that nobody else writes to, as long as this lives.
#[derive(Debug)]
pub struct OutputDirectory {
    pub(super) directory: PathBuf,
    pub(super) options: TableOptions,
    pub(super) storage: Storage,
    pub(super) commits: BTreeMap<u32, Commit>,
    /// Parts in a store that no commit named when it was opened.
    leftovers: Vec<PathBuf>,
    lock: Arc<File>,
}

/// A recording of which some episodes are in the tables, and by what it is known again.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BegunRecording {
    /// By all of it, where it was read as one that is complete.
    pub whole: Option<RecordingIdentity>,
    /// By its beginning, where it was read while it was written.
    pub beginning: Option<RecordingIdentity>,
    /// What is there.
    pub written: Written,
}

impl OutputDirectory {
    /// Opens `directory` for the run that `options` describe, and removes what a process that was stopped left
    /// unfinished. With `overwrite`, or where the run in it has given no step, it begins empty, else with what is
    /// committed. The address of an object store will do as well (`s3://…`): nothing is locked there, and nothing
    /// removed that another process may be about to name.
    ///
    /// # Errors
    /// [`TableError::AnotherRun`] if it holds a run with other parameters, [`TableError::Locked`] if another process
    /// writes to it, or what the file system or the store says.
    pub fn open(
        directory: &Path,
        options: &TableOptions,
        overwrite: bool,
    ) -> Result<Self, TableError> {
        let need = |name: &str| directory::need(name, |shard| shard == options.shard);
        let (storage, place) = Storage::of(directory, options.faults.clone(), need)?;
        Self::open_at(storage, &place, options, overwrite).map_err(|e| e.named(directory))
    }

    fn open_at(
        storage: Storage,
        directory: &Path,
        options: &TableOptions,
        overwrite: bool,
    ) -> Result<Self, TableError> {
        let run = Run::new(options.steps, &options.metadata);
        if directory.exists() && !directory.is_dir() {
            let what = std::io::Error::from(std::io::ErrorKind::NotADirectory);
            return Err(TableError::io("write tables to", directory)(what));
        }
        let is_whole = options.shard == WHOLE;
        let gives_way = || is_whole && !storage.is_store() && is_without_steps(directory);
        let begins_empty = || overwrite || gives_way();
        if !begins_empty() {
            // Refused before anything is made or locked: nothing of it is ours.
            check_run(directory, &run, options.shard)?;
        }
        storage.create_folder(&commit::commits_folder(directory))?;
        let lock = lock(&storage, directory, options.shard)?;
        if let Some(plan) = &options.plan {
            // It was read before: a `coact plan` may have come between.
            check_plan(directory, plan)?;
        }
        if !begins_empty() {
            check_run(directory, &run, options.shard)?;
        } else if is_whole {
            let mut shards = BTreeMap::new();
            lock_shards(&storage, directory, &mut shards)?;
            directory::clear(&storage, directory)?;
        } else {
            check_run(directory, &run, options.shard)?;
            directory::clear_shard(&storage, directory, options.shard)?;
        }
        storage.create_folder(&commit::commits_folder(directory))?;
        let commits = commit::read_commits(directory, options.shard)?;
        let committed = || commits.values().flat_map(|c| &c.parts).map(String::as_str);
        let mut leftovers = Vec::new();
        if storage.is_store() {
            let unnamed = directory::unnamed_parts(directory, Some(options.shard), committed())?;
            leftovers.extend(unnamed.into_iter().map(|(_, path)| path));
        } else if is_whole {
            commit::remove_replaced(&storage, directory, WHOLE, &commits)?;
            directory::clear_unfinished(&storage, directory, Some(WHOLE), committed())?;
        } else {
            directory::clear_unfinished_shard(&storage, directory, options.shard)?;
        }
        if commit::read_run(directory)?.is_none() {
            write_run(&storage, directory, &run, options.shard)?;
        }
        Ok(Self {
            directory: directory.to_owned(),
            options: options.clone(),
            storage,
            commits,
            leftovers,
            lock: Arc::new(lock),
        })
    }

    /// Recordings whose rows are all there, by name.
    pub fn done(&self) -> BTreeMap<&str, &DoneRecording> {
        self.commits
            .values()
            .flat_map(|c| &c.recordings)
            .map(|r| (&*r.identity.name, r))
            .collect()
    }

    /// Recordings in which an earlier process was stopped, or which were still growing then, by name.
    pub fn begun(&self) -> BTreeMap<Arc<str>, BegunRecording> {
        let mut begun: BTreeMap<Arc<str>, BegunRecording> = BTreeMap::new();
        for commit in self.commits.values() {
            let mut add = |open: &OpenRecording, is_whole: bool| {
                let of_name = begun.entry(Arc::clone(&open.identity.name)).or_default();
                let known_by = if is_whole {
                    &mut of_name.whole
                } else {
                    &mut of_name.beginning
                };
                // A merger stands behind commits that say more. A beginning that is longer tells more.
                if known_by
                    .as_ref()
                    .is_none_or(|known| known.bytes <= open.identity.bytes)
                {
                    *known_by = Some(open.identity.clone());
                }
                of_name.written.join(&open.written);
            };
            commit.open.iter().for_each(|open| add(open, true));
            commit.growing.iter().for_each(|open| add(open, false));
        }
        // One that failed later is read again, and its episodes are there.
        let done = self.done();
        let stands = |name: &str| {
            let done = done.get(name);
            done.is_some_and(|done| done.status != RecordingStatus::Failed)
        };
        begun.retain(|name, _| !stands(name));
        begun
    }

    /// Is the run marked as done?
    pub fn is_complete(&self) -> bool {
        directory::is_marked_done(&self.directory)
    }

    /// Are there parts that are nobody's, and that the next commit takes away?
    pub fn has_leftovers(&self) -> bool {
        !self.leftovers.is_empty()
    }

    /// Takes out the rows of recordings that failed and are tried again.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn forget(&mut self, names: &[&str]) -> Result<(), TableError> {
        if names.is_empty() {
            return Ok(());
        }
        // First: who sees the mark must find all rows.
        directory::unmark_done(&self.storage, &self.directory)?;
        let names: BTreeSet<&str> = names.iter().copied().collect();
        for (number, commit) in &mut self.commits {
            let is_forgotten = |r: &DoneRecording| names.contains(&*r.identity.name);
            if !commit.recordings.iter().any(is_forgotten) {
                continue;
            }
            // Should this be cut short after the part, the commit still names them, and they are taken out again.
            let Some(part) = commit.part(self.options.shard, Table::Recordings) else {
                continue;
            };
            let name = part_name(self.options.shard, part);
            without_rows(&self.storage, &self.directory, &name, &names, &self.options)?;
            commit.recordings.retain(|r| !is_forgotten(r));
            let id = (self.options.shard, *number);
            commit::write_commit(&self.storage, &self.directory, id, commit)?;
        }
        Ok(())
    }

    /// Goes on writing behind what is committed.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn writer(&self) -> Result<TableWriter, TableError> {
        let next = self.commits.keys().next_back().map_or(0, |last| last + 1);
        let next_part = directory::next_part(&self.directory, self.options.shard)?;
        directory::unmark_done(&self.storage, &self.directory)?;
        TableWriter::go_on(
            &self.directory,
            &self.options,
            self.storage.clone(),
            (next, next_part),
            self.leftovers.clone(),
            Arc::clone(&self.lock),
        )
    }
}

/// Writes down what run a directory holds. Without locks another process may be at the same: then what it wrote must
/// be that, too.
pub(super) fn write_run(
    storage: &Storage,
    directory: &Path,
    run: &Run,
    shard: u32,
) -> Result<(), TableError> {
    match commit::write_run(storage, directory, run) {
        Err(e) if e.is_taken() => {
            storage.fetch(&commit::run_path(directory))?;
            check_run(directory, run, shard)
        }
        result => result,
    }
}

/// Holds what is asked for against what the directory says of its run.
pub(super) fn check_run(directory: &Path, asked: &Run, shard: u32) -> Result<(), TableError> {
    let another = |difference: String| TableError::AnotherRun {
        directory: directory.to_owned(),
        difference,
    };
    if shard == WHOLE && commit::plan_path(directory).exists() {
        return Err(another(
            "a plan, whose shards --shard K/N writes".to_owned(),
        ));
    }
    match commit::read_run(directory) {
        Ok(Some(run)) if run == *asked => Ok(()),
        Ok(Some(run)) => Err(another(run.difference(asked))),
        Ok(None) if directory::holds_rows(directory)? => Err(another(
            "there is nothing that says with which parameters".to_owned(),
        )),
        Ok(None) => Ok(()),
        Err(e) => Err(another(format!("{e}: {}", e.cause()))),
    }
}

/// Is the plan in the directory the one that a process goes by?
fn check_plan(directory: &Path, plan: &Plan) -> Result<(), TableError> {
    if read_plan_at(directory)? == *plan {
        Ok(())
    } else {
        Err(TableError::AnotherRun {
            directory: directory.to_owned(),
            difference: "it was planned anew while this shard began".to_owned(),
        })
    }
}

/// Does `directory` hold a run that has given no step, so that nothing is lost with it? Not where others may be
/// writing their shards of it.
fn is_without_steps(directory: &Path) -> bool {
    let is_run = matches!(commit::read_run(directory), Ok(Some(_)));
    let is_empty = |commit: &Commit| commit.n_steps == Some(0);
    is_run
        && !commit::plan_path(directory).exists()
        && commit::read_commits(directory, WHOLE).is_ok_and(|c| c.values().all(is_empty))
}

/// How often, and after which pauses, a lock is tried again.
const LOCK_TRIES: u32 = 5;
const LOCK_PAUSE: Duration = Duration::from_millis(20);

/// Locks all shards that there are, but for those that are held already, so that nobody writes.
pub(super) fn lock_shards(
    storage: &Storage,
    directory: &Path,
    held: &mut BTreeMap<u32, File>,
) -> Result<(), TableError> {
    for shard in commit::locked_shards(directory)? {
        if shard != WHOLE && !held.contains_key(&shard) {
            held.insert(shard, lock(storage, directory, shard)?);
        }
    }
    Ok(())
}

/// Locks a directory for a process that does no more than plan or finish. These go on where there are no locks: a plan
/// is the same whoever writes it, no shard goes by another one than it has read under its own lock, and what has been
/// finished holds what its commits said; a part that no commit names is written again by the shard that misses it.
pub(super) fn lock_for_plan(storage: &Storage, directory: &Path) -> Result<File, TableError> {
    lock_where(storage, directory, WHOLE, true)
}

/// A lock that the system releases when its holder ends, however that comes.
pub(super) fn lock(storage: &Storage, directory: &Path, shard: u32) -> Result<File, TableError> {
    // Where there are none, as on some network drives, two processes on one shard meet at the first commit.
    lock_where(storage, directory, shard, shard != WHOLE)
}

fn lock_where(
    storage: &Storage,
    directory: &Path,
    shard: u32,
    goes_without: bool,
) -> Result<File, TableError> {
    let path = commit::lock_path(directory, shard);
    let mut file = storage.open_lock(&path)?;
    let mut locked = storage.try_lock(&file);
    // A process that is just being started holds all our files for a moment, locks too.
    for _ in 0..LOCK_TRIES {
        if !matches!(locked, Err(TryLockError::WouldBlock)) {
            break;
        }
        std::thread::sleep(LOCK_PAUSE);
        locked = storage.try_lock(&file);
    }
    match locked {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            let mut holder = String::new();
            let _unknown: std::io::Result<usize> = (&file).take(32).read_to_string(&mut holder);
            return Err(TableError::Locked {
                directory: directory.to_owned(),
                shard,
                holder: holder.trim().to_owned(),
            });
        }
        Err(TryLockError::Error(_)) if goes_without => {}
        Err(TryLockError::Error(e)) => return Err(TableError::io("lock", &path)(e)),
    }
    // Only for the message that another process gives; the lock is what counts.
    let _best_effort = file
        .set_len(0)
        .and_then(|()| file.rewind())
        .and_then(|()| writeln!(file, "{}", std::process::id()));
    Ok(file)
}

/// Writes a part of `recordings` again without the rows of some.
fn without_rows(
    storage: &Storage,
    directory: &Path,
    name: &str,
    names: &BTreeSet<&str>,
    options: &TableOptions,
) -> Result<(), TableError> {
    let path = directory.join(Table::Recordings.name()).join(name);
    let parquet = TableError::parquet(&path);
    storage.fetch(&path)?;
    let file = File::open(&path).map_err(TableError::io("open", &path))?;
    let batches = ParquetRecordBatchReaderBuilder::try_new(file)
        .and_then(ParquetRecordBatchReaderBuilder::build)
        .map_err(parquet)?;
    let mut part = Part::create(storage, directory, Table::Recordings, name, options)?;
    for batch in batches {
        let kept = batch.and_then(|batch| {
            let recordings = batch.column(0).as_string::<i32>();
            let keep: BooleanArray = recordings
                .iter()
                .map(|name| Some(name.is_none_or(|name| !names.contains(name))))
                .collect();
            filter_record_batch(&batch, &keep)
        });
        let kept = kept.map_err(|e| TableError::parquet(&path)(e.into()))?;
        part.write_batch(&kept)?;
    }
    part.commit()
}
