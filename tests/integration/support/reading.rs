//! Reads recordings as a run would, with options as a user types them, and holds what must hold of every reading.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use coact::model::{Episode, RecordingRow};
use coact::recording::{
    Align, Clock, Inspection, ReadOptions, RecordingReader, inspect, parse_seconds,
};

/// What came of a recording.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Reading {
    pub(crate) episodes: Vec<Episode>,
    pub(crate) row: RecordingRow,
}

impl Reading {
    pub(crate) fn sizes(&self) -> Vec<usize> {
        self.episodes.iter().map(Episode::n_steps).collect()
    }

    /// The values of one action column over all episodes.
    pub(crate) fn actions(&self, joint: usize) -> Vec<f64> {
        let columns = self.episodes.iter().filter(|e| e.n_steps() > 0);
        columns
            .flat_map(|e| e.actions.column(joint).to_vec())
            .collect()
    }

    pub(crate) fn states(&self, dimension: usize) -> Vec<f64> {
        let columns = self.episodes.iter().filter(|e| e.n_steps() > 0);
        columns
            .flat_map(|e| e.states.column(dimension).to_vec())
            .collect()
    }

    /// How often messages were refused for a cause that has these words.
    pub(crate) fn refused(&self, words: &str) -> u64 {
        let causes = self.row.causes.iter().filter(|c| c.cause.contains(words));
        causes.map(|c| c.count).sum()
    }

    /// Why episode number `nth` is incomplete; nothing if it is whole.
    pub(crate) fn reason(&self, nth: usize) -> &str {
        let incomplete = self.episodes[nth].incomplete.as_ref();
        incomplete.map_or("", |i| i.reason.as_str())
    }

    /// Why the recording failed or was recovered.
    pub(crate) fn error(&self) -> &str {
        self.row.reason.as_deref().unwrap_or("")
    }

    pub(crate) fn joint_names(&self) -> Vec<String> {
        let names = self.episodes[0].joint_names.as_deref().unwrap_or(&[]);
        names.iter().map(ToString::to_string).collect()
    }
}

/// Options as they stand on a command line.
pub(crate) fn options(flags: &str) -> ReadOptions {
    let mut options = ReadOptions::default();
    let words = words(flags);
    for pair in words.chunks(2) {
        let [flag, value] = pair else {
            panic!("{flags}: a flag without a value");
        };
        match flag.as_str() {
            "--action" => options.actions.push(value.parse().unwrap()),
            "--state" => options.states.push(value.parse().unwrap()),
            "--episodes" => options.episodes = value.parse().unwrap(),
            "--max-age" => options.max_age_nanos = Some(parse_seconds(value).unwrap()),
            "--align" => {
                options.align = [Align::Before, Align::Nearest, Align::Index]
                    .into_iter()
                    .find(|a| a.as_str() == value)
                    .unwrap();
            }
            "--clock" => {
                options.clock = [Clock::Log, Clock::Publish, Clock::Header]
                    .into_iter()
                    .find(|c| c.as_str() == value)
                    .unwrap();
            }
            _ => panic!("{flag} is no flag of the reader"),
        }
    }
    options
}

/// The words of a command line, as a shell reads them: single quotes and backslashes.
fn words(line: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word = String::new();
    let mut is_quoted = false;
    let mut line = line.chars();
    while let Some(c) = line.next() {
        match c {
            '\\' if !is_quoted => word.extend(line.next()),
            '\'' => is_quoted = !is_quoted,
            c if c.is_whitespace() && !is_quoted => {
                words.extend(Some(std::mem::take(&mut word)).filter(|w| !w.is_empty()));
            }
            c => word.push(c),
        }
    }
    words.extend(Some(word).filter(|w| !w.is_empty()));
    words
}

/// Writes the files of one recording into `folder`; `None` for one that is not there.
pub(crate) fn write_files(folder: &Path, files: &[Option<&[u8]>]) -> Vec<PathBuf> {
    let write = |(i, bytes): (usize, Option<&[u8]>)| {
        let path = folder.join(format!("r_{i}.mcap"));
        if let Some(bytes) = bytes {
            std::fs::write(&path, bytes).unwrap();
        }
        path
    };
    files.iter().copied().enumerate().map(write).collect()
}

/// Reads one file.
#[track_caller]
pub(crate) fn read(bytes: &[u8], flags: &str) -> Reading {
    read_split(&[Some(bytes)], flags)
}

/// Reads the files of one recording; an error ends in the row, as in a run. Holds the accounts against each other.
#[track_caller]
pub(crate) fn read_split(files: &[Option<&[u8]>], flags: &str) -> Reading {
    let folder = tempfile::tempdir().unwrap();
    let paths = write_files(folder.path(), files);
    let whole = read_paths(&paths, flags, u64::MAX);
    let pulled = read_paths(&paths, flags, 1);
    assert_eq!(
        whole, pulled,
        "{flags}: how much is asked for at a time shows"
    );
    let row = &whole.row;
    assert_eq!(
        row.n_messages,
        row.n_messages_used + row.n_messages_refused,
        "{flags}: {row:?}"
    );
    let n_steps: usize = whole.episodes.iter().map(Episode::n_steps).sum();
    assert!(row.n_messages_used >= n_steps as u64, "{flags}: {row:?}");
    if row.reason.is_none() {
        let counted: u64 = row.causes.iter().map(|c| c.count).sum();
        assert_eq!(counted, row.n_messages_refused, "{flags}: {row:?}");
    }
    for episode in &whole.episodes {
        let columns = episode.actions.iter().chain(episode.states.iter());
        assert!(columns.flatten().all(|v| v.is_finite()), "{flags}: {row:?}");
        if let Some(times) = &episode.times {
            assert_eq!(times.len(), episode.n_steps());
        }
    }
    whole
}

fn read_paths(paths: &[PathBuf], flags: &str, budget: u64) -> Reading {
    let mut episodes = Vec::new();
    let opened = RecordingReader::open_split(paths.to_vec(), Arc::from("r"), &options(flags));
    let mut reader = match opened {
        Ok(reader) => reader,
        Err(e) => {
            let row = RecordingReader::failed_row(Arc::from("r"), 0, &e.to_string());
            return Reading { episodes, row };
        }
    };
    while !reader.is_done() {
        match reader.read(budget) {
            Ok(more) => episodes.extend(more),
            Err(e) => {
                let row = reader.into_row(Some(&e.to_string()));
                return Reading { episodes, row };
            }
        }
    }
    let row = reader.into_row(None);
    Reading { episodes, row }
}

/// What `inspect` says of one file.
pub(crate) fn inspection(bytes: &[u8], flags: &str) -> Inspection {
    inspection_of_split(&[Some(bytes)], flags)
}

pub(crate) fn inspection_of_split(files: &[Option<&[u8]>], flags: &str) -> Inspection {
    let folder = tempfile::tempdir().unwrap();
    let paths = write_files(folder.path(), files);
    inspect(Arc::from("r"), &paths, &options(flags))
}

/// Whole numbers in a fixed order that looks like none (`SplitMix64`).
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    pub(crate) fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % n
    }

    pub(crate) fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            let j = self.below(i as u64 + 1) as usize;
            items.swap(i, j);
        }
    }
}

/// `by`, `by + 1`, …
pub(crate) fn rising(n: usize, by: f64) -> Vec<f64> {
    (0..n).map(|i| i as f64 + by).collect()
}

/// The columns of the states of the first episode.
pub(crate) fn columns(reading: &Reading) -> Vec<Vec<f64>> {
    (0..reading.episodes[0].states.n_columns())
        .map(|c| reading.states(c))
        .collect()
}
