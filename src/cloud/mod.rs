//! Object stores (`s3://`, `gs://`, `az://`, `https://`): objects as files that are read, listed, and written whole.
//!
//! A thread that reads never waits for one request alone: a few ranges of the object are under way, in order, and the
//! next ones begin only once it has taken theirs, so memory is bounded. The stores of this process share connections;
//! that, and the threads of the requests, is the one state that all share (feature `cloud`).

#[cfg(not(feature = "cloud"))]
mod absent;
#[cfg(feature = "cloud")]
mod remote_file;
#[cfg(feature = "cloud")]
mod store;
#[cfg(feature = "cloud")]
mod writing;

use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hasher};
use std::path::Path;
use std::sync::LazyLock;

#[cfg(not(feature = "cloud"))]
pub(crate) use absent::{RemoteFile, about, check_writable, delete, list, put, put_new, read_all};
#[cfg(feature = "cloud")]
pub(crate) use remote_file::RemoteFile;
#[cfg(feature = "cloud")]
pub(crate) use store::{about, list, read_all};
#[cfg(feature = "cloud")]
pub(crate) use writing::{check_writable, delete, put, put_new};

/// What is known of an object without reading it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct About {
    pub(crate) bytes: u64,
    /// The store's word for what is in it (`ETag`): another for another content.
    pub(crate) tag: String,
}

/// An object in a listing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Object {
    pub(crate) address: String,
    pub(crate) about: About,
}

/// The address in a path, if it is one (`scheme://…`) and not a path of the file system.
pub(crate) fn address(path: &Path) -> Option<&str> {
    let text = path.to_str()?;
    let (scheme, _) = text.split_once("://")?;
    let is_scheme = scheme.len() > 1 && scheme.bytes().all(|b| b.is_ascii_alphanumeric());
    is_scheme.then_some(text)
}

/// What this process is known by to stores: no other has the same.
pub(crate) fn token() -> &'static str {
    static TOKEN: LazyLock<String> =
        LazyLock::new(|| format!("{:016x}", RandomState::new().build_hasher().finish()));
    &TOKEN
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_no_paths() {
        let is_address = |text: &str| address(Path::new(text)).is_some();
        assert!(is_address("s3://bucket/runs") && is_address("https://host/a.mcap"));
        for path in [
            "runs/a.mcap",
            "/a://b",
            "c://x",
            "a b://c",
            "://x",
            "s3:/bucket",
        ] {
            assert!(!is_address(path), "{path}");
        }
    }
}
