//! Arrow columns of a batch to plain values. The batch's schema has been held against the table's before.

use std::sync::Arc;

use arrow::array::{Array, ArrayRef, AsArray, RecordBatch};
use arrow::datatypes::{Float64Type, Int32Type, Int64Type, TimestampNanosecondType};

/// The columns of a batch by name.
pub(super) struct Columns<'a>(pub(super) &'a RecordBatch);

impl Columns<'_> {
    fn column(&self, name: &str) -> Option<&ArrayRef> {
        self.0.column_by_name(name)
    }

    /// A number; nothing where it is null.
    pub(super) fn float(&self, name: &str, row: usize) -> Option<f64> {
        let column = self.column(name)?.as_primitive_opt::<Float64Type>()?;
        column.is_valid(row).then(|| column.value(row))
    }

    /// A count or index; 0 cannot come of a column that is there.
    pub(super) fn int32(&self, name: &str, row: usize) -> i32 {
        self.column(name)
            .and_then(|c| c.as_primitive_opt::<Int32Type>())
            .map_or(0, |c| c.value(row))
    }

    pub(super) fn int64(&self, name: &str, row: usize) -> i64 {
        self.column(name)
            .and_then(|c| c.as_primitive_opt::<Int64Type>())
            .map_or(0, |c| c.value(row))
    }

    /// Nanoseconds since the Unix epoch.
    pub(super) fn time(&self, name: &str, row: usize) -> Option<i64> {
        let column = self
            .column(name)?
            .as_primitive_opt::<TimestampNanosecondType>()?;
        column.is_valid(row).then(|| column.value(row))
    }

    pub(super) fn text(&self, name: &str, row: usize) -> Option<&str> {
        let column = self.column(name)?.as_string_opt::<i32>()?;
        column.is_valid(row).then(|| column.value(row))
    }

    /// The numbers of a list; nothing where the column was not asked for.
    pub(super) fn floats(&self, name: &str, row: usize) -> Option<Vec<f64>> {
        let list = self.column(name)?.as_list_opt::<i32>()?.value(row);
        Some(list.as_primitive_opt::<Float64Type>()?.values().to_vec())
    }

    /// The struct elements of a list, as columns of their own.
    pub(super) fn structs(&self, name: &str, row: usize) -> Option<RecordBatch> {
        let list = self.column(name)?.as_list_opt::<i32>()?.value(row);
        Some(RecordBatch::from(list.as_struct_opt()?))
    }
}

/// Keeps one copy of a text that many rows share.
#[derive(Debug, Default)]
pub(super) struct Interner(Option<Arc<str>>);

impl Interner {
    pub(super) fn share(&mut self, text: &str) -> Arc<str> {
        match &self.0 {
            Some(last) if **last == *text => Arc::clone(last),
            _ => Arc::clone(self.0.insert(Arc::from(text))),
        }
    }
}
