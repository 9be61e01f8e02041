//! By what a recording is known again: name, size, and a hash of the first and last bytes of its files. Enough to tell
//! another recording from the same, without reading gigabytes. Of an object in a store, its tag stands for the hash.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use twox_hash::XxHash3_128;

use super::inputs::Input;
use crate::model::RecordingIdentity;

/// Bytes of each end of a file that are hashed.
pub(crate) const HASHED: u64 = 64 << 10;

/// The identity of a recording as it is now; of one that cannot be read, with an empty hash.
pub(crate) fn of(input: &Input) -> RecordingIdentity {
    let hash = match (&input.problem, &input.remote) {
        (None, Some(about)) => about.tag.clone(),
        (None, None) => hash(&input.files).unwrap_or_default(),
        (Some(_), _) => String::new(),
    };
    RecordingIdentity {
        name: Arc::clone(&input.name),
        bytes: input.bytes(),
        hash: Arc::from(hash),
    }
}

/// The identity of a recording that is being written: by its first `bytes` bytes, at most [`HASHED`]. Where it has not
/// as many, or cannot be read, with an empty hash.
pub(crate) fn of_beginning(input: &Input, bytes: u64) -> RecordingIdentity {
    let of_file = |file: &Path| hash_beginning(&File::open(file)?, bytes);
    let hash = input.files.first().map(|file| of_file(file));
    RecordingIdentity {
        name: Arc::clone(&input.name),
        bytes,
        hash: Arc::from(hash.and_then(Result::ok).unwrap_or_default()),
    }
}

/// Hash of the first `bytes` bytes of a file; empty if it has not as many.
pub(crate) fn hash_beginning(mut file: &File, bytes: u64) -> io::Result<String> {
    let mut beginning = Vec::new();
    file.rewind()?;
    file.take(bytes.min(HASHED)).read_to_end(&mut beginning)?;
    if (beginning.len() as u64) < bytes {
        return Ok(String::new());
    }
    Ok(format!("{:032x}", XxHash3_128::oneshot(&beginning)))
}

fn hash(files: &[impl AsRef<Path>]) -> io::Result<String> {
    let mut bytes = Vec::new();
    for file in files {
        let path = file.as_ref();
        // A pipe or a device would block.
        if !std::fs::metadata(path)?.is_file() {
            return Ok(String::new());
        }
        let mut file = File::open(path)?;
        let len = file.metadata()?.len();
        (&file).take(HASHED).read_to_end(&mut bytes)?;
        if len > HASHED {
            file.seek(SeekFrom::Start(HASHED.max(len.saturating_sub(HASHED))))?;
            (&file).take(HASHED).read_to_end(&mut bytes)?;
        }
        bytes.extend(len.to_le_bytes());
    }
    Ok(format!("{:032x}", XxHash3_128::oneshot(&bytes)))
}
