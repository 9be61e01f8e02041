//! Batches to Parquet parts.
//!
//! The parts of one number, one in each table, form a *part group*: they hold the same episodes. A group is cut
//! between two batches, once it has enough rows; so the cut depends on the rows alone, never on time or threads.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow::array::RecordBatch;

use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;

use super::commit::{self, Commit, Mark, OpenRecording, Written};
use super::directory::{self, WHOLE, part_name};
use super::error::TableError;
use super::output::OutputDirectory;
use super::plan::Plan;
use super::rows::{Batches, RowsBuilder};
use super::schema::{TABLE_VERSION, Table};
use crate::model::JointMode;
use crate::storage::{Faults, NewFile, Storage, SyncTime};

/// Rows of `steps` (of `segments` and `episodes` without it) after which a part group is cut.
pub const DEFAULT_MAX_PART_ROWS: usize = 4 << 20;

/// Rows of a row group: a million would be read no faster, and is held in memory until it is complete.
const ROW_GROUP_ROWS: usize = 128 << 10;

/// Memory of a row group, bytes, at which it is closed: long lists of actions must not fill the memory.
const ROW_GROUP_BYTES: usize = 2 << 20;

/// The same for the per-step table, whose rows are many and narrow.
const STEPS_ROW_GROUP_BYTES: usize = 6 << 20;

/// zstd level: beyond it parts become hardly smaller and much slower to write.
const ZSTD_LEVEL: i32 = 3;

/// What is written besides the rows.
#[derive(Debug, Clone)]
pub struct TableOptions {
    /// Write the per-step table.
    pub steps: bool,
    /// Shard in the names of the parts, from 1; 0 when there is none.
    pub shard: u32,
    /// The plan that the shard is one of.
    pub plan: Option<Arc<Plan>>,
    /// Key-value metadata of each file.
    pub metadata: Vec<(String, String)>,
    /// See [`DEFAULT_MAX_PART_ROWS`].
    pub max_part_rows: usize,
    /// Calls to the file system that are to fail, in tests.
    pub faults: Option<Arc<Faults>>,
}

impl Default for TableOptions {
    fn default() -> Self {
        Self {
            steps: true,
            shard: 0,
            plan: None,
            metadata: Vec::new(),
            max_part_rows: DEFAULT_MAX_PART_ROWS,
            faults: None,
        }
    }
}

/// Writes the four tables below one directory.
pub struct TableWriter {
    directory: PathBuf,
    options: TableOptions,
    storage: Storage,
    group: Option<Group>,
    /// Number of the next commit.
    next: u32,
    /// Number of the next parts. Those of a shard that were never committed stay until the end, and keep theirs.
    next_part: u32,
    /// The recording whose rows are being written, and which of its episodes are.
    open: Option<OpenRecording>,
    empty: Batches,
    /// Parts in a store that were there before, and that no commit names.
    leftovers: Vec<PathBuf>,
    /// Held until the writer is gone.
    _lock: Arc<File>,
}

impl TableWriter {
    /// Begins a run in `directory`, which must not hold another.
    ///
    /// # Errors
    /// See [`OutputDirectory::open`].
    pub fn create(directory: &Path, options: &TableOptions) -> Result<Self, TableError> {
        OutputDirectory::open(directory, options, false)?.writer()
    }

    /// Writes on, from the next commit and the next part.
    pub(super) fn go_on(
        directory: &Path,
        options: &TableOptions,
        storage: Storage,
        (next, next_part): (u32, u32),
        leftovers: Vec<PathBuf>,
        lock: Arc<File>,
    ) -> Result<Self, TableError> {
        for table in tables(options) {
            storage.create_folder(&directory.join(table.name()))?;
        }
        let empty = RowsBuilder::new(JointMode::Each, options.steps).finish();
        Ok(Self {
            directory: directory.to_owned(),
            options: options.clone(),
            storage,
            group: None,
            next,
            next_part,
            open: None,
            empty,
            leftovers,
            _lock: lock,
        })
    }

    /// Appends rows to all tables; `marks` say which episodes and recordings they are, in order.
    ///
    /// # Errors
    /// If the file system refuses; what was committed before stays.
    pub fn write(&mut self, batches: &Batches, marks: &[Mark]) -> Result<(), TableError> {
        let group = match &mut self.group {
            Some(group) => group,
            none => none.insert(Group::create(
                &self.storage,
                &self.directory,
                &self.options,
                self.next_part,
            )?),
        };
        group.write(batches)?;
        for mark in marks {
            match mark {
                // In order: all in front of it are there.
                Mark::Episode(identity, nth) => {
                    self.open = Some(OpenRecording {
                        identity: identity.clone(),
                        written: Written::first(nth + 1),
                    });
                }
                Mark::Recording(done) => {
                    self.open = None;
                    group.commit.recordings.push(done.clone());
                }
            }
        }
        if group.n_rows >= self.options.max_part_rows {
            self.commit()?;
        }
        Ok(())
    }

    /// Makes what has been written so far count: the parts get their names, then a commit file names them.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn commit(&mut self) -> Result<(), TableError> {
        let open = self.open.clone();
        self.commit_group(|commit| commit.open = open).map(|_| ())
    }

    /// The same for a group whose commit is to say more; what it says, if there was anything to commit.
    pub(super) fn commit_group(
        &mut self,
        complete: impl FnOnce(&mut Commit),
    ) -> Result<Option<(u32, Commit)>, TableError> {
        let Some(mut group) = self.group.take() else {
            return Ok(None);
        };
        complete(&mut group.commit);
        let number = self.next;
        let commit = if self.options.shard == WHOLE && !self.storage.is_store() {
            let commit = group.commit()?;
            commit::write_commit(&self.storage, &self.directory, (WHOLE, number), &commit)?;
            commit
        } else {
            self.commit_new(group)?
        };
        self.take_number();
        self.remove_leftovers()?;
        Ok(Some((number, commit)))
    }

    /// Removes parts in a store that are nobody's. They were there before this process took a number: whoever wrote them
    /// wanted that number or one before it, and no longer gets it.
    fn remove_leftovers(&mut self) -> Result<(), TableError> {
        while let Some(part) = self.leftovers.pop() {
            self.storage.remove(&part)?;
        }
        Ok(())
    }

    /// The number of the next group, which is taken with it.
    pub(super) fn take_number(&mut self) -> u32 {
        let number = self.next;
        self.next += 1;
        self.next_part += 1;
        number
    }

    /// Tables without rows.
    pub(super) fn empty_batches(&self) -> Batches {
        self.empty.clone()
    }

    /// The same for a shard, and in a store. Whether locks reach from machine to machine is not known: so the number of a
    /// commit goes to the first process that asks for it, and what another did meanwhile on the same rows counts for
    /// nothing.
    fn commit_new(&self, group: Group) -> Result<Commit, TableError> {
        let shard = self.options.shard;
        let overtaken = |e: TableError| {
            if e.is_taken() {
                let directory = self.storage.named(&self.directory);
                TableError::Overtaken { directory, shard }
            } else {
                e
            }
        };
        let commit = group.commit().map_err(overtaken)?;
        let id = (shard, self.next);
        let written = commit::write_new_commit(&self.storage, &self.directory, id, &commit);
        match written {
            Ok(()) => Ok(commit),
            Err(e) => {
                if e.is_taken() {
                    for part in &commit.parts {
                        // Should it stay, nothing names it, and `coact finish` removes it.
                        let _best_effort = self.storage.remove(&self.directory.join(part));
                    }
                }
                Err(overtaken(e))
            }
        }
    }

    /// How long writing has waited for the disk; it goes on counting after the writer is gone.
    pub fn sync_time(&self) -> SyncTime {
        self.storage.sync_time.clone()
    }

    /// Closes the last parts and marks the directory as done.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn finish(mut self) -> Result<(), TableError> {
        self.close()?;
        directory::mark_done(&self.storage, &self.directory)
    }

    /// Closes the last parts. Every table has one then, if need be without rows; and no part is left that no commit
    /// names.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn close(&mut self) -> Result<(), TableError> {
        let needs_commit = self.next == 0 || !self.leftovers.is_empty();
        if needs_commit && self.group.is_none() {
            let empty = self.empty.clone();
            self.write(&empty, &[])?;
        }
        self.commit()
    }
}

pub(super) fn tables(options: &TableOptions) -> impl Iterator<Item = Table> + use<> {
    let steps = options.steps;
    Table::ALL
        .into_iter()
        .filter(move |table| steps || *table != Table::Steps)
}

/// The parts of one number.
struct Group {
    parts: Vec<Part>,
    n_rows: usize,
    commit: Commit,
}

impl Group {
    fn create(
        storage: &Storage,
        directory: &Path,
        options: &TableOptions,
        number: u32,
    ) -> Result<Self, TableError> {
        let name = part_name(options.shard, number);
        let parts = tables(options)
            .map(|table| {
                let mut part = Part::create(storage, directory, table, &name, options)?;
                // In a store the smallest part takes the number for all: a large object has no name that must be free.
                part.is_new = if storage.is_store() {
                    table == Table::Recordings
                } else {
                    options.shard != WHOLE
                };
                Ok(part)
            })
            .collect::<Result<_, TableError>>()?;
        let commit = Commit {
            parts: tables(options)
                .map(|table| format!("{}/{name}", table.name()))
                .collect(),
            ..Commit::default()
        };
        Ok(Self {
            parts,
            n_rows: 0,
            commit,
        })
    }

    fn write(&mut self, batches: &Batches) -> Result<(), TableError> {
        for part in &mut self.parts {
            part.write(batches)?;
        }
        let rows = |table| {
            batches
                .table(table)
                .map_or(0, arrow::array::RecordBatch::num_rows)
        };
        let n_steps = batches.n_steps() + self.commit.n_steps.unwrap_or(0);
        self.commit.n_steps = Some(n_steps);
        self.n_rows += rows(Table::Steps).max(rows(Table::Segments)) + rows(Table::Episodes);
        Ok(())
    }

    fn commit(mut self) -> Result<Commit, TableError> {
        // That which takes a number first.
        self.parts.sort_by_key(|part| !part.is_new);
        self.parts.into_iter().try_for_each(Part::commit)?;
        Ok(self.commit)
    }
}

/// One file while it is written, under a temporary name that no `*.parquet` matches.
pub(super) struct Part {
    storage: Storage,
    table: Table,
    path: PathBuf,
    temporary: PathBuf,
    /// Its name goes to the first that takes it.
    is_new: bool,
    writer: Option<ArrowWriter<NewFile>>,
}

impl Part {
    pub(super) fn create(
        storage: &Storage,
        directory: &Path,
        table: Table,
        name: &str,
        options: &TableOptions,
    ) -> Result<Self, TableError> {
        let folder = directory.join(table.name());
        let temporary = folder.join(directory::own_temporary_name(name));
        let file = storage.create(&temporary)?;
        let writer = ArrowWriter::try_new(file, table.schema(), Some(properties(table, options)))
            .map_err(TableError::parquet(&temporary))?;
        Ok(Self {
            storage: storage.clone(),
            table,
            path: folder.join(name),
            temporary,
            is_new: false,
            writer: Some(writer),
        })
    }

    fn write(&mut self, batches: &Batches) -> Result<(), TableError> {
        match batches.table(self.table) {
            Some(batch) => self.write_batch(batch),
            None => Ok(()),
        }
    }

    pub(super) fn write_batch(&mut self, batch: &RecordBatch) -> Result<(), TableError> {
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        writer
            .write(batch)
            .map_err(TableError::parquet(&self.temporary))?;
        let limit = match self.table {
            Table::Steps => STEPS_ROW_GROUP_BYTES,
            _ => ROW_GROUP_BYTES,
        };
        if writer.memory_size() >= limit {
            writer
                .flush()
                .map_err(TableError::parquet(&self.temporary))?;
        }
        Ok(())
    }

    pub(super) fn commit(mut self) -> Result<(), TableError> {
        let Some(writer) = self.writer.take() else {
            return Ok(());
        };
        let file = writer
            .into_inner()
            .map_err(TableError::parquet(&self.temporary))?;
        if self.is_new {
            self.storage.commit_new(file, &self.temporary, &self.path)?;
        } else {
            self.storage.commit(file, &self.temporary, &self.path)?;
        }
        Ok(())
    }
}

impl Drop for Part {
    /// A part that was not committed leaves nothing behind.
    fn drop(&mut self) {
        // An error here has no one to be told to; the next run removes what is left.
        let _best_effort = std::fs::remove_file(&self.temporary);
    }
}

fn properties(table: Table, options: &TableOptions) -> WriterProperties {
    let mut metadata = vec![
        KeyValue::new(
            "coact.version".to_owned(),
            env!("CARGO_PKG_VERSION").to_owned(),
        ),
        KeyValue::new("coact.table".to_owned(), table.name().to_owned()),
        KeyValue::new("coact.table_version".to_owned(), TABLE_VERSION.to_string()),
    ];
    metadata.extend(
        options
            .metadata
            .iter()
            .map(|(key, value)| KeyValue::new(key.clone(), value.clone())),
    );
    let level = ZstdLevel::try_new(ZSTD_LEVEL).unwrap_or_default();
    let mut builder = WriterProperties::builder()
        .set_created_by(concat!("coact ", env!("CARGO_PKG_VERSION")).to_owned())
        .set_compression(Compression::ZSTD(level))
        .set_max_row_group_row_count(Some(ROW_GROUP_ROWS))
        .set_statistics_enabled(EnabledStatistics::Page)
        .set_key_value_metadata(Some(metadata));
    if table == Table::Steps {
        // Step numbers rise by one: differences are nothing, where a dictionary would hold every number.
        for column in ["step", "time"] {
            let path = ColumnPath::from(column);
            builder = builder
                .set_column_dictionary_enabled(path.clone(), false)
                .set_column_encoding(path, Encoding::DELTA_BINARY_PACKED);
        }
        // Hardly a value comes twice: a dictionary is built for nothing (benches/README.md has the figures).
        let path = ColumnPath::from("state_change");
        builder = builder
            .set_column_dictionary_enabled(path.clone(), false)
            .set_column_encoding(path, Encoding::BYTE_STREAM_SPLIT);
    }
    builder.build()
}
