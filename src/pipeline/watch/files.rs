//! What the files of a recording look like from outside: without it they would have to be opened to see that nothing
//! has changed.

use std::fs;
use std::io;
use std::path::Path;
use std::time::SystemTime;

use crate::pipeline::inputs::Input;
use crate::recording::ROSBAG2_METADATA;

/// What changes when something is written to a recording's files: their size, and when the last was written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stamp {
    pub(super) bytes: u64,
    modified: Option<SystemTime>,
}

impl Stamp {
    pub(super) fn of(input: &Input) -> Self {
        let files = input.files.iter().filter_map(|f| fs::metadata(f).ok());
        let start = Self {
            bytes: 0,
            modified: None,
        };
        files.fold(start, |stamp, about| Self {
            bytes: stamp.bytes.saturating_add(about.len()),
            modified: stamp.modified.max(about.modified().ok()),
        })
    }
}

/// Are they files, which can be opened and do not block? A split recording may lack some: that is told when it is read.
pub(super) fn are_plain(input: &Input) -> io::Result<bool> {
    for file in &input.files {
        match fs::metadata(file) {
            Ok(about) if about.is_file() => {}
            Err(e) if input.files.len() == 1 => return Err(e),
            _ => return Ok(false),
        }
    }
    Ok(input.problem.is_none())
}

/// Is it compressed as a whole?
pub(super) fn is_compressed(input: &Input) -> bool {
    let extension = input.path.extension();
    extension.is_some_and(|e| e.eq_ignore_ascii_case("zst"))
}

/// Are they what rosbag2 is writing? Named after its folder, with a number; which files are one recording stands in
/// `metadata.yaml`, which comes at the end.
pub(super) fn are_of_unfinished_bag(input: &Input) -> bool {
    let Ok(path) = std::path::absolute(&input.path) else {
        return false;
    };
    let folder = path.parent();
    let name = |p: &Path| p.file_name().and_then(|n| n.to_str()).map(str::to_owned);
    let (Some(folder_name), Some(stem)) = (
        folder.and_then(name),
        path.file_stem().and_then(|s| s.to_str()),
    ) else {
        return false;
    };
    let number = stem
        .strip_prefix(&*folder_name)
        .and_then(|rest| rest.strip_prefix('_'));
    let is_numbered =
        number.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
    is_numbered && folder.is_some_and(|f| !f.join(ROSBAG2_METADATA).is_file())
}
