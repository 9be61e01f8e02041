//! What a file that is not an MCAP recording seems to be, so that the error can say it.

use super::records::MAGIC;

/// How many bytes of a file are looked at.
pub(crate) const SNIFF_LEN: usize = 512;

/// What `head`, the first [`SNIFF_LEN`] bytes of a file, seem to be; `None` if they begin an MCAP file of version 0.
pub(crate) fn foreign(head: &[u8]) -> Option<String> {
    if head.starts_with(MAGIC) {
        return None;
    }
    if head.starts_with(b"\x89MCAP") && head.len() >= MAGIC.len() && head[6..8] == MAGIC[6..8] {
        return Some(format!(
            "MCAP of major version {:?}, and only version '0' is known",
            char::from(head[5])
        ));
    }
    let text = head.trim_ascii_start().to_ascii_lowercase();
    let what = match head {
        [] => "empty",
        h if MAGIC.starts_with(h) => "an MCAP file cut inside its first 8 bytes",
        h if h.starts_with(b"\x1f\x8b") => "gzip (decompress it first)",
        h if h.starts_with(b"PK\x03\x04") => "a zip archive",
        h if h.starts_with(b"SQLite format 3\0") => {
            "an SQLite database (a rosbag2 .db3? convert it with `ros2 bag convert`)"
        }
        h if h.starts_with(b"#ROSBAG V") => "a ROS 1 bag (convert it with `mcap convert`)",
        h if h.starts_with(b"version https://git-lfs") => "a Git LFS pointer (run `git lfs pull`)",
        h if h.starts_with(b"\x28\xb5\x2f\xfd") => {
            "zstd (a compressed recording is named *.mcap.zst)"
        }
        h if h.starts_with(b"\x04\x22\x4d\x18") => "lz4 (decompress it first)",
        h if h.starts_with(b"PAR1") => "a Parquet file",
        h if h.starts_with(b"\x89HDF") => "an HDF5 file",
        h if h.starts_with(b"%PDF") => "a PDF document",
        _ if text.starts_with(b"<!doctype") || text.starts_with(b"<html") => {
            "an HTML page (a failed download?)"
        }
        _ if text.starts_with(b"{") || text.starts_with(b"[") => "JSON text",
        h if h.iter().all(|&b| b == 0) => "nothing but zero bytes",
        _ => "of unknown kind",
    };
    Some(what.to_owned())
}

#[cfg(test)]
mod tests {
    use super::foreign;

    #[test]
    fn foreign_files_are_named() {
        let check = |head: &[u8], word: &str| {
            assert!(foreign(head).is_some_and(|s| s.contains(word)), "{word}");
        };
        assert_eq!(foreign(b"\x89MCAP0\r\nrest"), None);
        check(b"", "empty");
        check(b"\x89MCA", "cut");
        check(b"\x89MCAP1\r\n", "version '1'");
        check(b"\x1f\x8b\x08", "gzip");
        check(b"PK\x03\x04", "zip");
        check(b"SQLite format 3\0", "SQLite");
        check(b"#ROSBAG V2.0\n", "ROS 1 bag");
        check(b"version https://git-lfs.github.com/spec/v1", "LFS");
        check(b" <!DOCTYPE html>", "HTML");
        check(&[0; 64], "zero");
        check(b"abc", "unknown");
    }
}
