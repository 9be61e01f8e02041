//! The rows of a table, part by part and batch by batch.

use std::collections::VecDeque;
use std::fmt;
use std::path::{Path, PathBuf};

use arrow::array::RecordBatch;
use parquet::arrow::arrow_reader::ParquetRecordBatchReader;

use super::columns::Columns;
use super::error::ResultsError;
use super::part::Part;
use super::rows::{Context, MakeRow};
use crate::tables::Table;

/// Rows that are made at a time.
const BATCH_ROWS: usize = 1024;

/// The rows of a table in their order; after an error there are none.
pub struct RowIter<R> {
    table: Table,
    parts: std::iter::Enumerate<std::vec::IntoIter<PathBuf>>,
    without: &'static [&'static str],
    make: MakeRow<R>,
    part: Option<(PathBuf, ParquetRecordBatchReader)>,
    context: Context,
    rows: VecDeque<R>,
}

impl<R> RowIter<R> {
    pub(super) fn new(
        table: Table,
        parts: Vec<PathBuf>,
        without: &'static [&'static str],
        make: MakeRow<R>,
    ) -> Self {
        Self {
            table,
            parts: parts.into_iter().enumerate(),
            without,
            make,
            part: None,
            context: Context::default(),
            rows: VecDeque::new(),
        }
    }

    /// Makes the rows of the next batch; false if there is none.
    fn advance(&mut self) -> Result<bool, ResultsError> {
        loop {
            if let Some((path, batches)) = &mut self.part {
                if let Some(batch) = batches.next() {
                    let batch = batch.map_err(|e| ResultsError::parquet(path)(e.into()))?;
                    self.rows = rows(path, &batch, self.make, &mut self.context)?;
                    return Ok(true);
                }
                self.part = None;
            }
            let Some((index, path)) = self.parts.next() else {
                return Ok(false);
            };
            self.context.before.begin_part(index);
            let batches = Part::open(self.table, &path, false)?
                .reader(self.without)?
                .with_batch_size(BATCH_ROWS)
                .build()
                .map_err(ResultsError::parquet(&path))?;
            self.part = Some((path, batches));
        }
    }

    fn end(&mut self) {
        self.parts = Vec::new().into_iter().enumerate();
        self.part = None;
        self.rows.clear();
    }
}

fn rows<R>(
    path: &Path,
    batch: &RecordBatch,
    make: MakeRow<R>,
    context: &mut Context,
) -> Result<VecDeque<R>, ResultsError> {
    let columns = Columns(batch);
    (0..batch.num_rows())
        .map(|row| make(&columns, row, context))
        .collect::<Result<_, _>>()
        .map_err(|what| ResultsError::unexpected(path, what))
}

impl<R> Iterator for RowIter<R> {
    type Item = Result<R, ResultsError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(row) = self.rows.pop_front() {
                return Some(Ok(row));
            }
            match self.advance() {
                Ok(true) => {}
                Ok(false) => return None,
                Err(e) => {
                    self.end();
                    return Some(Err(e));
                }
            }
        }
    }
}

impl<R> fmt::Debug for RowIter<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RowIter")
            .field("table", &self.table)
            .field("parts", &self.parts.len())
            .finish_non_exhaustive()
    }
}
