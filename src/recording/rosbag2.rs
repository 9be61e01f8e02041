//! rosbag2 directories: which files belong to one recording, and in which order, as `metadata.yaml` says.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::Deserialize;

/// Describes a bag; in its directory.
pub const METADATA_FILE: &str = "metadata.yaml";

/// Largest `metadata.yaml` that is read, bytes.
const MAX_METADATA: u64 = 16 << 20;

#[derive(Deserialize)]
struct Document {
    rosbag2_bagfile_information: Information,
}

#[derive(Deserialize)]
struct Information {
    #[serde(default)]
    storage_identifier: String,
    #[serde(default)]
    compression_mode: String,
    relative_file_paths: Vec<PathBuf>,
}

/// The files of the bag in `folder`, in their order; `None` if it is no rosbag2 directory.
///
/// # Errors
/// One sentence if it is one whose files cannot be told, or are no MCAP.
pub fn files(folder: &Path) -> Option<Result<Vec<PathBuf>, String>> {
    let path = folder.join(METADATA_FILE);
    if !fs::metadata(&path).is_ok_and(|m| m.is_file()) {
        return None;
    }
    let mut text = String::new();
    let read = File::open(&path).and_then(|f| f.take(MAX_METADATA).read_to_string(&mut text));
    if let Err(e) = read {
        return Some(Err(format!("its {METADATA_FILE} cannot be read: {e}")));
    }
    if !text.contains("rosbag2_bagfile_information") {
        // Some other program's file of that name.
        return None;
    }
    Some(listed(folder, &text))
}

fn listed(folder: &Path, text: &str) -> Result<Vec<PathBuf>, String> {
    let document: Document = serde_saphyr::from_str(text).map_err(|e| {
        let what = e.to_string();
        let line = what.lines().next().unwrap_or("not YAML").to_owned();
        format!("its {METADATA_FILE} is not that of a bag: {line}")
    })?;
    let Information {
        storage_identifier,
        compression_mode,
        relative_file_paths,
    } = document.rosbag2_bagfile_information;
    if !matches!(storage_identifier.as_str(), "" | "mcap") {
        return Err(format!(
            "is a bag with storage {storage_identifier:?}, not \"mcap\" (convert it with `ros2 bag convert`)"
        ));
    }
    // Files compressed as a whole are read; what is inside compressed messages cannot be told from their encoding.
    if compression_mode.eq_ignore_ascii_case("message") {
        return Err(
            "is a bag whose messages are compressed one by one (convert it with `ros2 bag convert`)"
                .to_owned(),
        );
    }
    if relative_file_paths.is_empty() {
        return Err(format!("its {METADATA_FILE} lists no files"));
    }
    Ok(relative_file_paths
        .iter()
        .map(|path| found_at(folder, path))
        .collect())
}

/// Where a listed file is: older versions list it with the name of the directory in front.
fn found_at(folder: &Path, listed: &Path) -> PathBuf {
    let by_name = listed.file_name().map(|name| folder.join(name));
    match by_name {
        Some(path) if path.exists() => path,
        _ if folder.join(listed).exists() => folder.join(listed),
        Some(path) => path,
        None => folder.join(listed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BAG: &str = "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n  \
                       duration:\n    nanoseconds: 5\n  relative_file_paths:\n    - bag_1.mcap\n    - bag/bag_0.mcap\n";

    #[test]
    fn files_come_in_the_order_of_the_metadata() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(files(dir.path()), None);
        fs::write(dir.path().join(METADATA_FILE), BAG).unwrap();
        let expected = [dir.path().join("bag_1.mcap"), dir.path().join("bag_0.mcap")];
        assert_eq!(files(dir.path()), Some(Ok(expected.to_vec())));
    }

    #[test]
    fn what_is_no_bag_of_mcap_files_is_said() {
        let folder = Path::new("bag");
        let sqlite = BAG.replace("mcap\n  duration", "sqlite3\n  duration");
        assert!(listed(folder, &sqlite).unwrap_err().contains("sqlite3"));
        let squeezed = BAG.replace("  duration", "  compression_mode: MESSAGE\n  duration");
        let error = listed(folder, &squeezed).unwrap_err();
        assert!(error.contains("one by one"), "{error}");
        assert!(
            listed(folder, "rosbag2_bagfile_information: [1")
                .unwrap_err()
                .contains("is not that of a bag")
        );
    }
}
