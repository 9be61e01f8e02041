//! An output directory, opened for reading.

use std::path::{Path, PathBuf};

use super::error::ResultsError;
use super::iter::RowIter;
use super::parameters::Parameters;
use super::rows::{self, EpisodeRow, MakeRow, RecordingRow, SegmentRow};
use super::steps::StepsReader;
use crate::tables::{Committed, TABLE_VERSION, Table};

/// The results of a run: what was committed when this was opened.
#[derive(Debug, Clone)]
pub struct Results {
    directory: PathBuf,
    committed: Committed,
    parameters: Parameters,
}

impl Results {
    /// Opens the output directory of a run, finished or not.
    ///
    /// # Errors
    /// If it is none, is of another version, or cannot be read.
    pub fn open(directory: &Path) -> Result<Self, ResultsError> {
        let owned = || directory.to_owned();
        if !directory.is_dir() {
            return Err(ResultsError::NoDirectory { directory: owned() });
        }
        let committed = Committed::read(directory)
            .map_err(|source| ResultsError::Protocol { source })?
            .ok_or_else(|| ResultsError::NoResults { directory: owned() })?;
        if committed.table_version() != TABLE_VERSION {
            return Err(ResultsError::OtherVersion {
                directory: owned(),
                version: committed.table_version(),
            });
        }
        Ok(Self {
            directory: owned(),
            parameters: Parameters::new(committed.parameters()),
            committed,
        })
    }

    /// Where it is.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// With what the run was made.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Has the run come to its end?
    pub fn is_finished(&self) -> bool {
        self.committed.is_done()
    }

    /// Is there a per-step table?
    pub fn has_steps(&self) -> bool {
        self.committed.has_steps()
    }

    /// All recordings, also those that failed.
    pub fn recordings(&self) -> RowIter<RecordingRow> {
        self.rows(Table::Recordings, &[], rows::recording)
    }

    /// All episodes, also those that gave nothing.
    pub fn episodes(&self) -> RowIter<EpisodeRow> {
        self.rows(Table::Episodes, &[], rows::episode)
    }

    /// All composite actions, by episode, joint and time, without the values of the actions.
    pub fn segments(&self) -> RowIter<SegmentRow> {
        self.rows(Table::Segments, &["actions"], rows::segment)
    }

    /// The same with the values of the actions.
    pub fn segments_with_actions(&self) -> RowIter<SegmentRow> {
        self.rows(Table::Segments, &[], rows::segment)
    }

    /// Reads the steps of episodes, one at a time.
    pub fn steps(&self) -> StepsReader {
        StepsReader::new(
            self.committed.parts(Table::Steps),
            self.parameters.is_together(),
        )
    }

    fn rows<R>(&self, table: Table, without: &'static [&str], make: MakeRow<R>) -> RowIter<R> {
        RowIter::new(table, self.committed.parts(table), without, make)
    }
}
