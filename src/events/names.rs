//! What events files are called, and which files are ours.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::MAGIC;
use mcap::records::{Record, op};

/// Ends the name of an events file.
const SUFFIX: &str = ".events.mcap";

/// Ends the name of an events file that is not finished, behind the number of its process.
const TEMPORARY_SUFFIX: &str = ".tmp";

/// What the files say of who wrote them.
pub(super) const LIBRARY: &str = concat!("coact ", env!("CARGO_PKG_VERSION"));

/// Begins [`LIBRARY`] in every version.
const PROGRAM: &str = "coact ";

/// A header is no longer than this.
const MAX_HEADER: u64 = 4 << 10;

/// Under which path below a folder the events of each recording go.
///
/// `a/run.mcap` has `a/run.events.mcap`. Where that is the name for two, such as `run.mcap` and `run.mcap.zst`, each has
/// its whole name in front.
pub(super) fn paths<'a>(names: impl Iterator<Item = &'a Arc<str>>) -> BTreeMap<Arc<str>, PathBuf> {
    let names: Vec<&Arc<str>> = names.collect();
    let mut whole: BTreeSet<&str> = BTreeSet::new();
    loop {
        let mut by_path: BTreeMap<String, Vec<&Arc<str>>> = BTreeMap::new();
        for &name in &names {
            let stem = if whole.contains(&**name) {
                name
            } else {
                stem(name)
            };
            let path = format!("{stem}{SUFFIX}");
            by_path.entry(path).or_default().push(name);
        }
        let shared = by_path.values().filter(|of| of.len() > 1).flatten();
        let n_whole = whole.len();
        whole.extend(shared.map(|name| &***name));
        if whole.len() == n_whole {
            return by_path
                .into_iter()
                .flat_map(|(path, of)| {
                    of.into_iter()
                        .map(move |name| (Arc::clone(name), PathBuf::from(&path)))
                })
                .collect();
        }
    }
}

/// A recording's name without what its kind of file is called.
fn stem(name: &str) -> &str {
    let lower = name.to_ascii_lowercase();
    let kind = [".mcap.zst", ".mcap"]
        .into_iter()
        .find(|kind| lower.ends_with(kind));
    &name[..name.len() - kind.map_or(0, str::len)]
}

/// Under which name a file is written until it is finished: one of this process, so that two never write to one file.
pub(super) fn temporary(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}{TEMPORARY_SUFFIX}", std::process::id()));
    path.with_file_name(name)
}

/// The events file that a temporary file was to become, and the number of the process.
pub(super) fn finished(path: &Path) -> Option<(PathBuf, u32)> {
    let name = path.file_name()?.to_str()?;
    let name = name.strip_prefix('.')?.strip_suffix(TEMPORARY_SUFFIX)?;
    let (name, process) = name.rsplit_once('.')?;
    name.ends_with(SUFFIX)
        .then(|| Some((path.with_file_name(name), process.parse().ok()?)))?
}

/// Is this a file that `--events` wrote? Such a one is no recording, though it is named like one.
pub fn is_events_file(path: &Path) -> bool {
    let is_named_so = |name: &OsStr| {
        let name = name.as_encoded_bytes();
        name.ends_with(SUFFIX.as_bytes())
    };
    // A pipe or a device would block.
    path.file_name().is_some_and(is_named_so)
        && fs::metadata(path).is_ok_and(|m| m.is_file())
        && library(path).is_some_and(|library| library.starts_with(PROGRAM))
}

/// The library in the header of an MCAP file.
fn library(path: &Path) -> Option<String> {
    let mut file = File::open(path).ok()?;
    let mut start = [0; MAGIC.len() + 9];
    file.read_exact(&mut start).ok()?;
    let (magic, record) = start.split_at(MAGIC.len());
    let (&opcode, length) = record.split_first()?;
    let length = u64::from_le_bytes(length.try_into().ok()?);
    if magic != MAGIC || opcode != op::HEADER || length > MAX_HEADER {
        return None;
    }
    let mut body = Vec::new();
    file.take(length).read_to_end(&mut body).ok()?;
    match mcap::parse_record(opcode, &body) {
        Ok(Record::Header(header)) => Some(header.library),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paths_of(names: &[&str]) -> Vec<String> {
        let names: Vec<Arc<str>> = names.iter().map(|n| Arc::from(*n)).collect();
        let paths = paths(names.iter());
        names
            .iter()
            .map(|name| paths[name].to_string_lossy().into_owned())
            .collect()
    }

    #[test]
    fn every_recording_has_a_file_of_its_own() {
        assert_eq!(
            paths_of(&["a/x.mcap", "b/x.MCAP", "bag", "z.mcap.zst"]),
            [
                "a/x.events.mcap",
                "b/x.events.mcap",
                "bag.events.mcap",
                "z.events.mcap"
            ]
        );
        assert_eq!(
            paths_of(&["x.mcap", "x.mcap.mcap", "x.mcap.zst", "y.mcap"]),
            [
                "x.mcap.events.mcap",
                "x.mcap.mcap.events.mcap",
                "x.mcap.zst.events.mcap",
                "y.events.mcap"
            ]
        );
    }

    #[test]
    fn a_temporary_file_tells_what_it_was_to_become() {
        let path = Path::new("d/x.events.mcap");
        let temporary = temporary(path);
        assert_eq!(
            finished(&temporary),
            Some((path.to_owned(), std::process::id()))
        );
        for other in [".x.mcap.1.tmp", "x.events.mcap.1.tmp", ".x.events.mcap.tmp"] {
            assert_eq!(finished(Path::new(other)), None, "{other}");
        }
    }
}
