//! One part of a table: opened, and its columns held against those of the table.

use std::fs::File;
use std::path::{Path, PathBuf};

use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder,
};
use parquet::file::metadata::PageIndexPolicy;

use super::error::ResultsError;
use crate::tables::Table;

/// A part whose columns are those of its table.
pub(super) struct Part {
    path: PathBuf,
    file: File,
    metadata: ArrowReaderMetadata,
}

impl Part {
    /// Opens a part; with `pages`, rows can be found in it without reading those before them.
    pub(super) fn open(table: Table, path: &Path, pages: bool) -> Result<Self, ResultsError> {
        let file = File::open(path).map_err(ResultsError::io(path))?;
        let policy = if pages {
            PageIndexPolicy::Optional
        } else {
            PageIndexPolicy::Skip
        };
        let options = ArrowReaderOptions::new().with_offset_index_policy(policy);
        let metadata =
            ArrowReaderMetadata::load(&file, options).map_err(ResultsError::parquet(path))?;
        let schema = table.schema();
        let found = metadata.schema();
        let differs = schema
            .fields()
            .iter()
            .zip(found.fields())
            .find(|(e, f)| e.name() != f.name() || e.data_type() != f.data_type());
        if let Some((expected, found)) = differs {
            let what = format!(
                "its column {} of {} stands where {} of {} is expected",
                found.name(),
                found.data_type(),
                expected.name(),
                expected.data_type()
            );
            return Err(ResultsError::unexpected(path, what));
        }
        if schema.fields().len() != found.fields().len() {
            let what = format!(
                "it has {} columns, where {} has {}",
                found.fields().len(),
                table.name(),
                schema.fields().len()
            );
            return Err(ResultsError::unexpected(path, what));
        }
        Ok(Self {
            path: path.to_owned(),
            file,
            metadata,
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn n_rows(&self) -> u64 {
        let n_rows = self.metadata.metadata().file_metadata().num_rows();
        u64::try_from(n_rows).unwrap_or(0)
    }

    /// A reader of its columns but for some.
    pub(super) fn reader(
        &self,
        without: &[&str],
    ) -> Result<ParquetRecordBatchReaderBuilder<File>, ResultsError> {
        let file = self
            .file
            .try_clone()
            .map_err(ResultsError::io(&self.path))?;
        let builder =
            ParquetRecordBatchReaderBuilder::new_with_metadata(file, self.metadata.clone());
        let wanted = (0..builder.schema().fields().len())
            .filter(|&i| !without.contains(&builder.schema().field(i).name().as_str()));
        let mask = ProjectionMask::roots(builder.parquet_schema(), wanted);
        Ok(builder.with_projection(mask))
    }
}
