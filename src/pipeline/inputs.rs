//! From what a user typed (files, folders, globs) to a sorted list of recordings with names that are theirs alone.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fmt::Write as _;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use thiserror::Error;

use crate::cloud::{self, About, Object};
use crate::events::is_events_file;
use crate::recording::{ROSBAG2_METADATA, rosbag2_files};

/// One recording to be read, or why it cannot be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Input {
    /// What the tables call it: relative to the common ancestor of all inputs, `/` between.
    pub(crate) name: Arc<str>,
    /// The file, or the bag's directory.
    pub(crate) path: PathBuf,
    /// Its files in their order; more than one for a split bag.
    pub(crate) files: Vec<PathBuf>,
    /// Set if it is known already that it cannot be read.
    pub(crate) problem: Option<String>,
    /// What its object store says of it; `None` for files.
    pub(crate) remote: Option<About>,
}

/// Inputs among which there is nothing to read.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum InputError {
    /// No argument led to a file.
    #[error("no recordings found in {0} (looked for *.mcap and *.mcap.zst)")]
    Nothing(String),
    /// An address whose objects cannot be listed.
    #[error("cannot list {address}: {reason}")]
    NoListing {
        /// As typed.
        address: String,
        /// What the store said.
        reason: String,
    },
    /// A glob that cannot be parsed.
    #[error("{pattern:?} is not a glob: {reason}")]
    BadGlob {
        /// As typed.
        pattern: String,
        /// What is wrong with it.
        reason: String,
    },
}

/// Finds all recordings below `arguments`, each once, sorted by name.
pub(crate) fn find(arguments: &[PathBuf]) -> Result<Vec<Input>, InputError> {
    let mut found = Found::default();
    for argument in arguments {
        if let Some(address) = cloud::address(argument) {
            found.address(address)?;
        } else if !argument.exists() && is_glob(argument) {
            found.glob(argument)?;
        } else if argument.is_dir() {
            found.folder(argument);
        } else {
            found.file(
                argument,
                (!argument.exists()).then(|| "no such file".to_owned()),
            );
        }
    }
    if found.files.is_empty() {
        let typed: Vec<_> = arguments
            .iter()
            .map(|a| format!("{:?}", readable(a.as_os_str())))
            .collect();
        return Err(InputError::Nothing(typed.join(", ")));
    }
    Ok(found.named())
}

/// Finds all recordings below one folder. Their names are relative to it, whatever else is there: as others come, they
/// stay.
pub(crate) fn find_below(folder: &Path) -> Vec<Input> {
    let mut found = Found::default();
    if folder.is_dir() {
        found.folder(folder);
    }
    let ancestor = absolute(folder);
    // A folder that is a bag itself is called what it would be among others.
    let is_bag = found.files.contains_key(&ancestor);
    let ancestor = match ancestor.parent() {
        Some(above) if is_bag => above.to_owned(),
        _ => ancestor,
    };
    found.named_below(&ancestor)
}

impl Input {
    /// Bytes of its files, as far as they are there.
    pub(crate) fn bytes(&self) -> u64 {
        if let Some(about) = &self.remote {
            return about.bytes;
        }
        self.files
            .iter()
            .filter_map(|file| std::fs::metadata(file).ok())
            .map(|m| m.len())
            .sum()
    }
}

/// A recording that was found: its files, and what is wrong with it.
struct Entry {
    path: PathBuf,
    files: Vec<PathBuf>,
    problem: Option<String>,
    remote: Option<About>,
}

/// Recordings by the absolute path of their file or bag directory, which makes each unique.
#[derive(Default)]
struct Found {
    files: BTreeMap<PathBuf, Entry>,
    /// Files of bags, which are no recordings of their own.
    in_bags: BTreeSet<PathBuf>,
}

impl Found {
    fn file(&mut self, path: &Path, problem: Option<String>) {
        // Typed beside the files of its bag, as `bag/*` does.
        if path.file_name() == Some(OsStr::new(ROSBAG2_METADATA))
            && let Some(folder) = path.parent()
            && self.bag(if folder.as_os_str().is_empty() {
                Path::new(".")
            } else {
                folder
            })
        {
            return;
        }
        self.files.entry(absolute(path)).or_insert_with(|| Entry {
            path: path.to_owned(),
            files: vec![path.to_owned()],
            problem,
            remote: None,
        });
    }

    /// Takes a folder as one recording if it is a rosbag2 directory; false if it is none.
    fn bag(&mut self, folder: &Path) -> bool {
        let Some(files) = rosbag2_files(folder) else {
            return false;
        };
        let entry = match files {
            Ok(files) => {
                self.in_bags.extend(files.iter().map(|f| absolute(f)));
                Entry {
                    path: folder.to_owned(),
                    files,
                    problem: None,
                    remote: None,
                }
            }
            Err(problem) => Entry {
                path: folder.to_owned(),
                files: vec![folder.to_owned()],
                problem: Some(problem),
                remote: None,
            },
        };
        self.files.entry(absolute(folder)).or_insert(entry);
        true
    }

    fn folder(&mut self, folder: &Path) {
        let mut named_like_recordings = Vec::new();
        for entry in walkdir::WalkDir::new(folder)
            .follow_links(true)
            .sort_by_file_name()
        {
            match entry {
                Ok(entry) if entry.file_type().is_dir() => {
                    self.bag(entry.path());
                    if entry.depth() > 0 && is_recording(entry.file_name()) {
                        named_like_recordings.push(entry.into_path());
                    }
                }
                Ok(entry) if is_events_file(entry.path()) => {}
                Ok(entry) if is_recording(entry.file_name()) => self.file(entry.path(), None),
                Ok(_) => {}
                // A link that loops or leads nowhere matters only where a recording was to be expected.
                Err(e) => {
                    if let Some(path) = e.path().filter(|p| {
                        p.file_name().is_some_and(is_recording) || e.loop_ancestor().is_none()
                    }) {
                        self.file(path, Some(format!("cannot be read: {e}")));
                    }
                }
            }
        }
        // Whoever named a folder so may expect a recording of it; one that holds recordings explains itself.
        for path in named_like_recordings {
            let absolute = absolute(&path);
            if !self.files.keys().any(|file| file.starts_with(&absolute)) {
                self.file(&path, None);
            }
        }
    }

    /// A recording in an object store, or all below a prefix.
    fn address(&mut self, address: &str) -> Result<(), InputError> {
        if is_glob(Path::new(address)) {
            return Err(InputError::BadGlob {
                pattern: address.to_owned(),
                reason: "object stores have none: name a recording, or what many begin with"
                    .to_owned(),
            });
        }
        if is_recording(OsStr::new(address)) {
            let about = cloud::about(&[address]).pop();
            match about.unwrap_or_else(|| Err(std::io::ErrorKind::NotFound.into())) {
                Ok(about) => self.object(address, Some(about), None),
                Err(e) => self.object(address, None, Some(format!("cannot be read: {e}"))),
            }
            return Ok(());
        }
        let objects = cloud::list(address).map_err(|e| InputError::NoListing {
            address: address.to_owned(),
            reason: e.to_string(),
        })?;
        for object in objects {
            let Object { address, about } = object;
            let name = address.rsplit('/').next().unwrap_or_default();
            // What is inside is not looked at: of events files the name must do, and a bag is not put together.
            if name == ROSBAG2_METADATA {
                let problem = "stands beside the files of a rosbag2 directory, which is read as one recording only \
                               from a file system; its files are recordings of their own here";
                self.object(&address, Some(about), Some(problem.to_owned()));
            } else if is_recording(OsStr::new(name)) && !name.ends_with(".events.mcap") {
                self.object(&address, Some(about), None);
            }
        }
        Ok(())
    }

    fn object(&mut self, address: &str, remote: Option<About>, problem: Option<String>) {
        let path = PathBuf::from(address);
        self.files.entry(path.clone()).or_insert_with(|| Entry {
            files: vec![path.clone()],
            path,
            problem,
            remote,
        });
    }

    fn glob(&mut self, pattern: &Path) -> Result<(), InputError> {
        let text = pattern.to_str().ok_or_else(|| InputError::BadGlob {
            pattern: readable(pattern.as_os_str()),
            reason: "it is not UTF-8".to_owned(),
        })?;
        let paths = glob::glob(text).map_err(|e| InputError::BadGlob {
            pattern: text.to_owned(),
            reason: e.msg.to_owned(),
        })?;
        for path in paths {
            match path {
                Ok(path) if path.is_dir() => self.folder(&path),
                Ok(path) if is_events_file(&path) => {}
                Ok(path) => self.file(&path, None),
                Err(e) => self.file(e.path(), Some(format!("cannot be read: {}", e.error()))),
            }
        }
        Ok(())
    }

    fn named(mut self) -> Vec<Input> {
        self.files.retain(|path, _| !self.in_bags.contains(path));
        let ancestor = common_ancestor(self.files.keys());
        self.named_below(&ancestor)
    }

    fn named_below(mut self, ancestor: &Path) -> Vec<Input> {
        self.files.retain(|path, _| !self.in_bags.contains(path));
        let mut inputs: Vec<Input> = self
            .files
            .into_iter()
            .map(|(absolute, entry)| {
                let Entry {
                    path,
                    files,
                    problem,
                    remote,
                } = entry;
                let relative = absolute.strip_prefix(ancestor).unwrap_or(&absolute);
                let name: Vec<String> = relative
                    .components()
                    .map(|c| readable(c.as_os_str()))
                    .collect();
                Input {
                    name: Arc::from(name.join("/")),
                    path,
                    files,
                    problem,
                    remote,
                }
            })
            .collect();
        inputs.sort_by(|a, b| a.name.cmp(&b.name));
        inputs
    }
}

/// The deepest folder above all of `files`.
fn common_ancestor<'a>(mut files: impl Iterator<Item = &'a PathBuf>) -> PathBuf {
    let first = files
        .next()
        .and_then(|f| f.parent())
        .unwrap_or(Path::new(""))
        .to_owned();
    files.fold(first, |ancestor, file| {
        let parent = file.parent().unwrap_or(Path::new(""));
        ancestor
            .components()
            .zip(parent.components())
            .take_while(|(a, b)| a == b)
            .map(|(a, _)| a)
            .collect()
    })
}

/// Absolute, `.` and `..` taken out as they stand, so that one file typed in two ways is one file.
pub(super) fn absolute(path: &Path) -> PathBuf {
    if cloud::address(path).is_some() {
        return path.to_owned();
    }
    let mut clean = PathBuf::new();
    for component in std::path::absolute(path)
        .unwrap_or_else(|_| path.to_owned())
        .components()
    {
        match component {
            Component::ParentDir => {
                clean.pop();
            }
            other => clean.push(other),
        }
    }
    clean
}

fn is_glob(path: &Path) -> bool {
    path.as_os_str()
        .as_encoded_bytes()
        .iter()
        .any(|b| matches!(b, b'*' | b'?' | b'['))
}

/// `*.mcap` or `*.mcap.zst`, in any case.
fn is_recording(name: &OsStr) -> bool {
    let name = name.as_encoded_bytes().to_ascii_lowercase();
    name.ends_with(b".mcap") || name.ends_with(b".mcap.zst")
}

/// A name as text: bytes that are not UTF-8 stand as `\xNN`, and so does the backslash of a name that holds such text
/// already. Different names stay different.
pub(crate) fn readable(name: &OsStr) -> String {
    let mut text = String::new();
    for chunk in name.as_encoded_bytes().utf8_chunks() {
        let mut valid = chunk.valid();
        while let Some(at) = valid.find("\\x") {
            let is_escape = |b: &u8| b.is_ascii_digit() || (b'A'..=b'F').contains(b);
            let digits = valid.as_bytes().get(at + 2..at + 4);
            text.push_str(&valid[..at]);
            text.push_str(match digits {
                Some(digits) if digits.iter().all(is_escape) => "\\x5C",
                _ => "\\",
            });
            valid = &valid[at + 1..];
        }
        text.push_str(valid);
        for byte in chunk.invalid() {
            let _infallible = write!(text, "\\x{byte:02X}");
        }
    }
    text
}

/// The name of which [`readable`] made `text`.
pub(super) fn from_readable(text: &str) -> PathBuf {
    let mut name = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let escaped = match rest {
            [b'\\', b'x', high, low, ..] => digit(*high).zip(digit(*low)),
            _ => None,
        };
        if let Some((high, low)) = escaped {
            name.push(high << 4 | low);
            rest = &rest[4..];
        } else {
            name.push(first);
            rest = after;
        }
    }
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStringExt;
        PathBuf::from(std::ffi::OsString::from_vec(name))
    }
    #[cfg(not(unix))]
    {
        // Names that are not Unicode cannot be made again there; such a recording is then not found, and told of.
        PathBuf::from(String::from_utf8(name).unwrap_or_else(|_| text.to_owned()))
    }
}

/// The value of a digit as [`readable`] writes them.
fn digit(byte: u8) -> Option<u8> {
    match byte {
        b'0'..=b'9' => Some(byte - b'0'),
        b'A'..=b'F' => Some(byte - b'A' + 10),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(arguments: &[PathBuf]) -> Vec<String> {
        find(arguments)
            .unwrap()
            .into_iter()
            .map(|i| i.name.to_string())
            .collect()
    }

    #[test]
    fn names_are_relative_to_the_common_ancestor_and_each_file_comes_once() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path();
        for file in [
            "a/x.mcap",
            "a/deep/y.MCAP",
            "b/x.mcap",
            "b/notes.txt",
            "b/z.mcap.zst",
        ] {
            let path = root.join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, b"").unwrap();
        }
        assert_eq!(
            names(&[root.to_owned()]),
            ["a/deep/y.MCAP", "a/x.mcap", "b/x.mcap", "b/z.mcap.zst"]
        );
        assert_eq!(names(&[root.join("a/x.mcap")]), ["x.mcap"]);
        assert_eq!(
            names(&[root.join("a"), root.join("a/../a/x.mcap")]),
            ["deep/y.MCAP", "x.mcap"]
        );
        assert_eq!(names(&[root.join("*/x.mcap")]), ["a/x.mcap", "b/x.mcap"]);
    }

    #[cfg(unix)]
    #[test]
    fn names_that_are_not_utf8_stay_apart_from_those_that_look_like_them() {
        use std::os::unix::ffi::OsStrExt;
        let of = |name: &[u8]| readable(OsStr::from_bytes(name));
        assert_eq!(of(b"a\xff.mcap"), "a\\xFF.mcap");
        assert_eq!(of(b"a\\xFF.mcap"), "a\\x5CxFF.mcap");
        assert_eq!(of(b"a\\x5CxFF"), "a\\x5Cx5CxFF");
        assert_eq!(of("b\\x \\xz \\n é".as_bytes()), "b\\x \\xz \\n é");
        for name in [
            b"a\xff.mcap".as_slice(),
            b"a\\xFF.mcap",
            b"a\\x5CxFF",
            "b\\x \\xz \\n é\\".as_bytes(),
        ] {
            assert_eq!(
                from_readable(&of(name)).as_os_str(),
                OsStr::from_bytes(name)
            );
        }
    }

    #[test]
    fn a_bag_directory_is_one_recording_named_after_it() {
        let dir = tempfile::tempdir().unwrap();
        let bag = dir.path().join("runs/bag");
        std::fs::create_dir_all(&bag).unwrap();
        for file in ["bag_0.mcap", "bag_1.mcap", "extra.mcap"] {
            std::fs::write(bag.join(file), b"").unwrap();
        }
        let metadata = "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths: [bag_1.mcap, bag_0.mcap]\n";
        std::fs::write(bag.join("metadata.yaml"), metadata).unwrap();
        assert_eq!(names(std::slice::from_ref(&bag)), ["bag", "bag/extra.mcap"]);
        let found = find(&[dir.path().to_owned()]).unwrap();
        assert_eq!(
            found[0].files,
            [bag.join("bag_1.mcap"), bag.join("bag_0.mcap")]
        );
    }

    #[test]
    fn a_bag_typed_as_all_its_files_is_one_recording() {
        let dir = tempfile::tempdir().unwrap();
        let bag = dir.path().join("bag");
        std::fs::create_dir_all(&bag).unwrap();
        for file in ["bag_0.mcap", "bag_1.mcap"] {
            std::fs::write(bag.join(file), b"").unwrap();
        }
        let file = bag.join("metadata.yaml");
        let metadata = "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths: [bag_0.mcap, bag_1.mcap]\n";
        std::fs::write(&file, metadata).unwrap();
        let (first, second) = (bag.join("bag_0.mcap"), bag.join("bag_1.mcap"));
        // `bag/*`, by the shell and by us.
        assert_eq!(
            names(&[first.clone(), second.clone(), file.clone()]),
            ["bag"]
        );
        assert_eq!(names(&[bag.join("*")]), ["bag"]);
        // Each file once, however it is typed.
        assert_eq!(names(&[first.clone(), bag.clone()]), ["bag"]);
        assert_eq!(names(&[bag.clone(), first.clone()]), ["bag"]);
        assert_eq!(names(&[first, second]), ["bag_0.mcap", "bag_1.mcap"]);
        // Another program's file of that name is a file like any other.
        std::fs::write(&file, "a: b").unwrap();
        assert_eq!(names(&[file]), ["metadata.yaml"]);
    }

    #[test]
    fn nothing_to_read_is_an_error_and_a_missing_file_a_problem() {
        let dir = tempfile::tempdir().unwrap();
        assert!(matches!(
            find(&[dir.path().to_owned()]),
            Err(InputError::Nothing(_))
        ));
        let missing = find(&[dir.path().join("gone.mcap")]).unwrap();
        assert_eq!(missing[0].problem.as_deref(), Some("no such file"));
    }
}
